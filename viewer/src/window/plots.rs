//! Drawings over the scene and in the panel: legend, plots, bars.

use kiss3d::egui::{
    Align2, Color32, FontId, Painter, Pos2, Rect, Sense, Shape, Stroke, Ui, Vec2, pos2, vec2,
};

use crate::colour::Colouring;
use crate::history::{Line, ranges};
use pliant_render::ColourMap;

/// Colours of the lines of a plot, in order.
const INKS: [Color32; 6] = [
    Color32::from_rgb(0x4c, 0x9f, 0xe0),
    Color32::from_rgb(0xe0, 0x8a, 0x3c),
    Color32::from_rgb(0x5c, 0xb8, 0x5c),
    Color32::from_rgb(0xd0, 0x5c, 0x9c),
    Color32::from_rgb(0x9c, 0x7c, 0xd8),
    Color32::from_rgb(0xb0, 0xa0, 0x50),
];

const HANDLE: Color32 = Color32::from_rgb(0x33, 0xe6, 0xe6);
const FAINT: Color32 = Color32::from_gray(90);
const TEXT: Color32 = Color32::from_gray(220);

/// The colour bar with its labels; `corner` is its lower left corner.
pub fn legend(painter: &Painter, corner: Pos2, colouring: &Colouring) {
    let (width, height, steps) = (14.0, 150.0, 64);
    let top = corner.y - height;
    for k in 0..steps {
        let colour = ColourMap::Viridis.colour((f64::from(k) + 0.5) / f64::from(steps));
        let [r, g, b] = colour.map(|c| (c * 255.0).round() as u8);
        let step = height / steps as f32;
        let low = pos2(corner.x, corner.y - step * (k + 1) as f32);
        painter.rect_filled(
            Rect::from_min_size(low, vec2(width, step + 0.5)),
            0.0,
            Color32::from_rgb(r, g, b),
        );
    }
    let font = FontId::proportional(13.0);
    for (place, text) in colouring.ticks() {
        let y = corner.y - height * place as f32;
        painter.hline(
            corner.x + width..=corner.x + width + 4.0,
            y,
            Stroke::new(1.0, TEXT),
        );
        painter.text(
            pos2(corner.x + width + 7.0, y),
            Align2::LEFT_CENTER,
            text,
            font.clone(),
            TEXT,
        );
    }
    let title = format!("{} [{}]", colouring.field.name(), colouring.field.unit());
    painter.text(
        pos2(corner.x, top - 8.0),
        Align2::LEFT_BOTTOM,
        title,
        font,
        TEXT,
    );
}

/// Pickable points on the screen.
pub fn handles(painter: &Painter, points: impl Iterator<Item = Pos2>) {
    for point in points.filter(|p| p.x >= 0.0) {
        painter.circle(point, 6.0, HANDLE, Stroke::new(1.5, Color32::from_gray(20)));
    }
}

/// Bars of milliseconds, one per effect.
pub fn bars(ui: &mut Ui, effects: &[(&'static str, f64)]) {
    let most = effects
        .iter()
        .map(|(_, ms)| *ms)
        .fold(f64::MIN_POSITIVE, f64::max);
    for (k, (name, ms)) in effects.iter().enumerate() {
        let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 16.0), Sense::hover());
        let font = FontId::proportional(12.0);
        let (from, until) = (rect.left() + 92.0, rect.right() - 62.0);
        let painter = ui.painter();
        painter.text(
            pos2(rect.left(), rect.center().y),
            Align2::LEFT_CENTER,
            *name,
            font.clone(),
            TEXT,
        );
        let share = (ms / most).clamp(0.0, 1.0) as f32;
        let bar = Rect::from_min_max(
            pos2(from, rect.top() + 3.0),
            pos2(from + (until - from) * share, rect.bottom() - 3.0),
        );
        painter.rect_filled(bar, 1.0, INKS[k % INKS.len()]);
        let text = format!("{ms:.2} ms");
        painter.text(
            pos2(rect.right(), rect.center().y),
            Align2::RIGHT_CENTER,
            text,
            font,
            TEXT,
        );
    }
}

/// A plot of lines over frames.
pub fn plot(ui: &mut Ui, name: &str, lines: &[&Line]) {
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 96.0), Sense::hover());
    let painter = ui.painter_at(rect);
    let font = FontId::proportional(12.0);
    let unit = lines.first().map_or("", |line| line.unit);
    let title = if unit.is_empty() {
        name.to_owned()
    } else {
        format!("{name} [{unit}]")
    };
    painter.text(rect.left_top(), Align2::LEFT_TOP, title, font.clone(), TEXT);
    let field = Rect::from_min_max(
        rect.left_top() + vec2(52.0, 18.0),
        rect.right_bottom() - vec2(4.0, 16.0),
    );
    painter.rect_stroke(
        field,
        0.0,
        Stroke::new(1.0, FAINT),
        kiss3d::egui::StrokeKind::Inside,
    );
    let seen = lines.iter().flat_map(|line| &line.points);
    let Some((x, y)) = ranges(seen.filter(|(_, y)| y.is_finite())) else {
        return;
    };
    for (k, line) in lines.iter().enumerate() {
        let ink = INKS[k % INKS.len()];
        curve(&painter, field, (x, y), line, ink);
        if let Some(now) = line.points.get(line.now) {
            let place = rect.right_top() + Vec2::new(0.0, 13.0 * k as f32);
            let text = format!("{} {}", line.of, short(now.1));
            painter.text(place, Align2::RIGHT_TOP, text.trim(), font.clone(), ink);
        }
    }
    let (left, bottom) = (field.left() - 4.0, field.bottom() + 2.0);
    for (text, at, align) in [
        (short(y.1), pos2(left, field.top()), Align2::RIGHT_TOP),
        (short(y.0), pos2(left, field.bottom()), Align2::RIGHT_BOTTOM),
        (
            format!("{:.0}", x.0),
            pos2(field.left(), bottom),
            Align2::LEFT_TOP,
        ),
        (
            format!("{:.0}", x.1),
            pos2(field.right(), bottom),
            Align2::RIGHT_TOP,
        ),
    ] {
        painter.text(at, align, text, font.clone(), TEXT);
    }
}

/// The finite points of a line, with a dot at the present frame.
fn curve(
    painter: &Painter,
    field: Rect,
    (x, y): ((f64, f64), (f64, f64)),
    line: &Line,
    ink: Color32,
) {
    let at = |(frame, value): &(f64, f64)| {
        let right = (frame - x.0) / (x.1 - x.0);
        let up = (value - y.0) / (y.1 - y.0);
        pos2(
            field.left() + field.width() * right as f32,
            field.bottom() - field.height() * up as f32,
        )
    };
    let finite = line.points.iter().filter(|(_, y)| y.is_finite());
    let points: Vec<Pos2> = finite.map(at).collect();
    painter.add(Shape::line(points, Stroke::new(1.5, ink)));
    if let Some(now) = line.points.get(line.now).filter(|now| now.1.is_finite()) {
        painter.circle_filled(at(now), 2.5, ink);
    }
}

/// A number as a short text.
fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        small if small < 1e-3 => format!("{value:.1e}"),
        small if small < 10.0 => format!("{value:.3}"),
        small if small < 1e5 => format!("{value:.1}"),
        _ => format!("{value:.2e}"),
    }
}
