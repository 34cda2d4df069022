//! Line plots as SVG.

use std::fmt::Write as _;

use super::html::escape;
use pliant_render::Ticks;

/// The size of a plot in its own units; the page scales it.
const SIZE: [f64; 2] = [560.0, 290.0];
/// Margins at the left for labels, at the right, and at the bottom for the axis.
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
const BOTTOM: f64 = 42.0;
/// Approximate width of a character of the small font.
const CHARACTER: f64 = 6.4;

/// Diameter of the dot of an isolated point.
const LONE: f64 = 8.0;

/// Colours that are distinguishable with any colour vision, on white and on black.
const COLOURS: [&str; 9] = [
    "#3b7dd8", "#e4572e", "#2a9d5c", "#b07aa1", "#e0a100", "#17a2b8", "#8d6e63", "#5c6670",
    "#c2185b",
];

/// A line of a plot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Name in the key.
    pub name: String,
    /// Points by increasing x. One that is not finite (or not positive on a logarithmic axis)
    /// interrupts the line.
    pub points: Vec<(f64, f64)>,
    /// Spread of points along x: y, least x, greatest x.
    pub bars: Vec<(f64, f64, f64)>,
    /// True for dots instead of a line.
    pub dots: bool,
}

impl Series {
    /// A series.
    pub fn new(name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self {
            name: name.into(),
            points: points.into_iter().collect(),
            ..Self::default()
        }
    }

    /// The series as dots, with their spread along x and a thin line through the lowest from the
    /// left.
    pub fn dotted(mut self, bars: impl IntoIterator<Item = (f64, f64, f64)>) -> Self {
        self.bars = bars.into_iter().collect();
        self.dots = true;
        self
    }
}

/// A plot of one or more lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinePlot {
    /// Title with the unit of y: "Volume error [%]".
    pub title: String,
    /// Name of x with its unit: "frame".
    pub x_label: String,
    /// True for a logarithmic y axis.
    pub log_y: bool,
    /// True for a logarithmic x axis.
    pub log_x: bool,
    /// Values of y below this are uncertain: a grey region with its name.
    pub unknown_below: Option<(String, f64)>,
    /// The lines.
    pub series: Vec<Series>,
    /// Limits as dashed lines, with their names.
    pub limits: Vec<(String, f64)>,
}

/// The mapping of numbers to positions in a plot.
struct Axes {
    x: (f64, f64),
    y: (f64, f64),
    log: bool,
    log_x: bool,
    top: f64,
}

impl Axes {
    /// The value of x at the left end.
    fn first_x(&self) -> f64 {
        if self.log_x {
            libm::pow(10.0, self.x.0)
        } else {
            self.x.0
        }
    }

    fn place(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        let scaled = |v: f64, log: bool| match (log, v > 0.0) {
            (false, _) => v,
            (true, true) => libm::log10(v),
            (true, false) => f64::NAN,
        };
        let (x, y) = (scaled(x, self.log_x), scaled(y, self.log));
        let across = (x - self.x.0) / (self.x.1 - self.x.0);
        let up = (y - self.y.0) / (self.y.1 - self.y.0);
        let bottom = SIZE[1] - BOTTOM;
        let place = (
            LEFT + across * (SIZE[0] - LEFT - RIGHT),
            bottom - up * (bottom - self.top),
        );
        (place.0.is_finite() && place.1.is_finite()).then_some(place)
    }
}

impl LinePlot {
    /// A plot without lines.
    pub fn new(title: impl Into<String>, x_label: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            x_label: x_label.into(),
            ..Self::default()
        }
    }

    /// Adds a line.
    pub fn with(
        mut self,
        name: impl Into<String>,
        points: impl IntoIterator<Item = (f64, f64)>,
    ) -> Self {
        self.series.push(Series::new(name, points));
        self
    }

    /// Adds a dashed limit.
    pub fn with_limit(mut self, name: impl Into<String>, y: f64) -> Self {
        self.limits.push((name.into(), y));
        self
    }

    /// Makes y logarithmic.
    pub fn logarithmic(mut self) -> Self {
        self.log_y = true;
        self
    }

    /// Makes x and y logarithmic.
    pub fn logarithmic_both(mut self) -> Self {
        (self.log_x, self.log_y) = (true, true);
        self
    }

    /// The plot as an SVG element; equal numbers give equal text. It uses the text colour around
    /// it, so that it is readable on white and on black.
    pub fn to_svg(&self) -> String {
        let [width, height] = SIZE;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{title}\" \
             font-family=\"system-ui, sans-serif\" font-size=\"12\" fill=\"currentColor\">\n\
             <text x=\"{LEFT}\" y=\"18\" font-size=\"14\" font-weight=\"600\">{title}</text>\n",
            title = escape(&self.title)
        );
        let top = self.draw_key(&mut svg);
        match self.axes(top) {
            Some(axes) => {
                self.draw_unknown(&mut svg, &axes);
                self.draw_grid(&mut svg, &axes);
                self.draw_lines(&mut svg, &axes);
            }
            None => {
                let why = if self.log_y {
                    "nothing above zero"
                } else {
                    "nothing to plot"
                };
                let _ = writeln!(
                    svg,
                    "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\" opacity=\"0.6\">{why}</text>",
                    width / 2.0,
                    height / 2.0
                );
            }
        }
        svg + "</svg>\n"
    }

    /// Draws the names of the lines. Returns the start of the plot below them.
    fn draw_key(&self, svg: &mut String) -> f64 {
        let lines = self
            .series
            .iter()
            .enumerate()
            .map(|(i, s)| (&s.name, COLOURS[i % COLOURS.len()], ""));
        let limits = self
            .limits
            .iter()
            .map(|(name, _)| (name, "currentColor", " stroke-dasharray=\"5 4\""));
        let entries: Vec<_> = lines
            .chain(limits)
            .filter(|(name, ..)| !name.is_empty())
            .collect();
        let (mut x, mut y) = (LEFT, 36.0_f64);
        for (name, colour, dash) in &entries {
            let room = 26.0 + name.chars().count() as f64 * CHARACTER + 16.0;
            if x > LEFT && x + room > SIZE[0] {
                (x, y) = (LEFT, y + 16.0);
            }
            let _ = writeln!(
                svg,
                "<path d=\"M{x:.1} {line:.1}h20\" stroke=\"{colour}\" stroke-width=\"2.5\"{dash}/>\
                 <text x=\"{text:.1}\" y=\"{y:.1}\" opacity=\"0.85\">{name}</text>",
                line = y - 4.0,
                text = x + 26.0,
                name = escape(name)
            );
            x += room;
        }
        // A part of the plot remains for any number of lines.
        (if entries.is_empty() {
            32.0_f64
        } else {
            y + 14.0
        })
        .min(SIZE[1] - BOTTOM - 60.0)
    }

    /// The points and the ends of the bars in coordinates of the axes, without those that no axis can
    /// hold.
    fn drawable(&self) -> impl Iterator<Item = (f64, f64)> {
        self.series
            .iter()
            .flat_map(|s| {
                let bars = s.bars.iter().flat_map(|(y, a, b)| [(*a, *y), (*b, *y)]);
                s.points.iter().copied().chain(bars)
            })
            .map(|(x, y)| (on_axis(x, self.log_x), on_axis(y, self.log_y)))
            .filter(|(x, y)| x.abs() < 1e300 && y.abs() < 1e300)
    }

    /// The ranges of the drawable points; `None` if there are none.
    fn axes(&self, top: f64) -> Option<Axes> {
        let x = range(self.drawable().map(|(x, _)| x));
        let limits = self
            .limits
            .iter()
            .map(|(_, y)| on_axis(*y, self.log_y))
            .filter(|y| y.abs() < 1e300);
        let mut y = range(self.drawable().map(|(_, y)| y).chain(limits));
        if x.0 > x.1 {
            return None;
        }
        // An axis that starts near zero starts at zero.
        if !self.log_y && y.0 > 0.0 && y.0 < 0.5 * y.1 {
            y.0 = 0.0;
        }
        let padding = if self.log_y {
            (0.05 * (y.1 - y.0)).max(0.3)
        } else {
            0.05 * (y.1 - y.0)
        };
        let y = (
            if y.0 == 0.0 && !self.log_y {
                0.0
            } else {
                y.0 - padding
            },
            y.1 + padding,
        );
        // Dots must not lie on the border.
        let aside = if self.log_x {
            (0.03 * (x.1 - x.0)).max(0.05)
        } else {
            0.0
        };
        let x = widened((x.0 - aside, x.1 + aside));
        Some(Axes {
            x,
            y: widened(y),
            log: self.log_y,
            log_x: self.log_x,
            top,
        })
    }

    /// Draws the region of uncertain values.
    fn draw_unknown(&self, svg: &mut String, axes: &Axes) {
        let Some((name, bound)) = &self.unknown_below else {
            return;
        };
        let Some((_, y)) = axes.place(axes.first_x(), *bound) else {
            return;
        };
        let bottom = SIZE[1] - BOTTOM;
        let y = y.clamp(axes.top, bottom);
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {y:.1}H{}V{bottom}H{LEFT}Z\" fill=\"currentColor\" fill-opacity=\"0.1\"/>\n\
             <text x=\"{}\" y=\"{:.1}\" font-size=\"11\" opacity=\"0.7\">{}</text>",
            SIZE[0] - RIGHT,
            LEFT + 6.0,
            (y + 13.0).min(bottom - 3.0),
            escape(name)
        );
    }

    fn draw_grid(&self, svg: &mut String, axes: &Axes) {
        let (bottom, right) = (SIZE[1] - BOTTOM, SIZE[0] - RIGHT);
        let power = |y: f64| if axes.log { libm::pow(10.0, y) } else { y };
        let range = (power(axes.y.0), power(axes.y.1));
        let ticks = if axes.log {
            Ticks::logarithmic(range, 5)
        } else {
            Ticks::linear(range, 5)
        };
        svg.push_str("<g stroke=\"currentColor\" stroke-opacity=\"0.14\">\n");
        let reach = |x: f64| if axes.log_x { libm::pow(10.0, x) } else { x };
        let across = if axes.log_x {
            Ticks::logarithmic((reach(axes.x.0), reach(axes.x.1)), 8)
        } else {
            Ticks::linear(axes.x, 8)
        };
        let first = axes.first_x();
        let rows: Vec<_> = ticks
            .values
            .iter()
            .filter_map(|v| axes.place(first, *v))
            .map(|p| p.1)
            .collect();
        let columns: Vec<_> = across
            .values
            .iter()
            .filter_map(|v| axes.place(*v, power(axes.y.0)))
            .map(|p| p.0)
            .collect();
        for y in &rows {
            let _ = writeln!(svg, "<path d=\"M{LEFT} {y:.1}H{right}\"/>");
        }
        for x in &columns {
            let _ = writeln!(svg, "<path d=\"M{x:.1} {:.1}V{bottom}\"/>", axes.top);
        }
        let _ = writeln!(
            svg,
            "</g>\n<path d=\"M{LEFT} {bottom}H{right}\" stroke=\"currentColor\" stroke-opacity=\"0.6\"/>"
        );
        svg.push_str("<g opacity=\"0.75\">\n");
        for (y, label) in rows.iter().zip(&ticks.labels) {
            let _ = writeln!(
                svg,
                "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                LEFT - 7.0,
                y + 4.0
            );
        }
        for (x, label) in columns.iter().zip(&across.labels) {
            let _ = writeln!(
                svg,
                "<text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>",
                bottom + 17.0
            );
        }
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>\n</g>",
            f64::midpoint(LEFT, right),
            SIZE[1] - 7.0,
            escape(&self.x_label)
        );
    }

    fn draw_lines(&self, svg: &mut String, axes: &Axes) {
        for (_, limit) in &self.limits {
            if let Some((_, y)) = axes.place(axes.first_x(), *limit) {
                let _ = writeln!(
                    svg,
                    "<path d=\"M{LEFT} {y:.1}H{}\" stroke=\"currentColor\" stroke-opacity=\"0.7\" stroke-dasharray=\"5 4\"/>",
                    SIZE[0] - RIGHT
                );
            }
        }
        for (i, series) in self.series.iter().enumerate() {
            let colour = COLOURS[i % COLOURS.len()];
            if series.dots {
                draw_dots(svg, axes, series, colour);
                continue;
            }
            let places = thinned(series.points.iter().map(|(x, y)| axes.place(*x, *y)));
            for run in places.split(Option::is_none).filter(|run| !run.is_empty()) {
                let mut path = String::new();
                for (k, (x, y)) in run.iter().flatten().enumerate() {
                    let _ = write!(path, "{}{x:.1} {y:.1}", if k == 0 { 'M' } else { 'L' });
                }
                // An isolated point is a dot: a line of almost zero length (some viewers draw
                // nothing for zero) with round ends.
                path.push_str(if run.len() == 1 { "h0.1" } else { "" });
                let _ = writeln!(
                    svg,
                    "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{}\" stroke-linejoin=\"round\" \
                     stroke-linecap=\"round\"/>",
                    if run.len() == 1 { LONE } else { 1.8 }
                );
            }
        }
    }
}

/// Draws dots, each with its spread, and a thin line through those without another one to the left
/// and below.
fn draw_dots(svg: &mut String, axes: &Axes, series: &Series, colour: &str) {
    let (mut path, mut least) = (String::new(), f64::INFINITY);
    let mut points = series.points.clone();
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    for (x, y) in points {
        let Some(place) = axes.place(x, y).filter(|_| y < least) else {
            continue;
        };
        least = y;
        let _ = write!(
            path,
            "{}{:.1} {:.1}",
            if path.is_empty() { 'M' } else { 'L' },
            place.0,
            place.1
        );
    }
    let _ = writeln!(
        svg,
        "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1\" stroke-opacity=\"0.7\"/>"
    );
    for (x, y) in series.points.iter().filter_map(|(x, y)| axes.place(*x, *y)) {
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.6\" fill=\"{colour}\" fill-opacity=\"0.85\"/>"
        );
    }
    for (y, low, high) in &series.bars {
        if let (Some((a, y)), Some((b, _))) = (axes.place(*low, *y), axes.place(*high, *y)) {
            let _ = writeln!(
                svg,
                "<path d=\"M{a:.1} {y:.1}H{b:.1}\" stroke=\"{colour}\" stroke-width=\"1.5\"/>"
            );
        }
    }
}

/// Widens a range of zero width.
fn widened((low, high): (f64, f64)) -> (f64, f64) {
    if high - low > 4.0 * f64::EPSILON * low.abs().max(high.abs()) {
        return (low, high);
    }
    let room = if low == 0.0 { 1.0 } else { low.abs() / 2.0 };
    (low - room, high + room)
}

/// The coordinate of a value on an axis: its decimal logarithm on a logarithmic one.
fn on_axis(value: f64, is_logarithmic: bool) -> f64 {
    if is_logarithmic {
        libm::log10(value.max(0.0))
    } else {
        value
    }
}

/// The least and the greatest value; an inverted range without values.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    })
}

/// The column of half a pixel that holds a place.
fn column(place: &Option<(f64, f64)>) -> Option<f64> {
    place.map(|(x, _)| (x * 2.0).floor())
}

/// The first, the lowest, the highest and the last point of each column of pixels: long runs give
/// small files, and no spike is lost.
fn thinned(places: impl Iterator<Item = Option<(f64, f64)>>) -> Vec<Option<(f64, f64)>> {
    let places: Vec<_> = places.collect();
    let mut kept = Vec::new();
    for group in places.chunk_by(|a, b| a.is_some() && column(a) == column(b)) {
        if group.len() <= 4 {
            kept.extend_from_slice(group);
            continue;
        }
        let height = |i: &usize| group[*i].map_or(0.0, |p| p.1);
        let by_height = |a: &usize, b: &usize| height(a).total_cmp(&height(b));
        let ends = [0, group.len() - 1].map(Some);
        let [lowest, highest] = [
            (0..group.len()).min_by(by_height),
            (0..group.len()).max_by(by_height),
        ];
        let mut chosen: Vec<usize> = ends
            .into_iter()
            .chain([lowest, highest])
            .flatten()
            .collect();
        chosen.sort_unstable();
        chosen.dedup();
        kept.extend(chosen.into_iter().map(|i| group[i]));
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn paths(svg: &str) -> usize {
        svg.matches("stroke-linejoin").count()
    }

    #[test]
    fn lines_break_where_there_is_no_number() {
        let points = [1.0, 2.0, f64::NAN, 3.0, 4.0, f64::INFINITY, 5.0];
        let plot = LinePlot::new("t", "x").with("a", (0..).map(f64::from).zip(points));
        assert_eq!(paths(&plot.to_svg()), 3);
        let plot = LinePlot::new("t", "x")
            .with("a", [(0.0, 1.0), (1.0, 0.0), (2.0, 1.0)])
            .logarithmic();
        assert_eq!(paths(&plot.to_svg()), 2);
        assert!(
            LinePlot::new("t", "x")
                .with("a", [(0.0, 0.0)])
                .logarithmic()
                .to_svg()
                .contains("nothing above zero")
        );
        assert!(LinePlot::new("t", "x").to_svg().contains("nothing to plot"));
    }

    #[test]
    fn dots_lie_inside_and_what_is_unknown_is_grey() {
        let series =
            Series::new("a", [(1e-3, 1e-2), (10.0, 1e-5), (0.0, 1.0)]).dotted([(1e-2, 5e-4, 2e-3)]);
        let plot = LinePlot {
            series: vec![series],
            ..LinePlot::new("t", "x").logarithmic_both()
        };
        let svg = LinePlot {
            unknown_below: Some(("?<".into(), 1e-4)),
            ..plot.clone()
        }
        .to_svg();
        assert_eq!(
            svg.matches("<circle").count(),
            2,
            "a time of zero has no place on a logarithmic axis"
        );
        assert!(
            svg.contains("fill-opacity=\"0.1\"")
                && svg.contains("?&lt;")
                && !plot.to_svg().contains("fill-opacity=\"0.1\"")
        );
        for part in svg.split("cx=\"").skip(1) {
            let x: f64 = part
                .split('"')
                .next()
                .and_then(|x| x.parse().ok())
                .expect("a number");
            assert!(x > LEFT && x < SIZE[0] - RIGHT, "{x}");
        }
    }

    #[test]
    fn numbers_stand_along_both_axes() {
        let plot = LinePlot::new("t", "x").with("a", [(0.0, 0.0), (8.0, 40.0)]);
        let has = |plot: &LinePlot, all: &[&str]| {
            let svg = plot.to_svg();
            for one in all {
                assert!(svg.contains(&format!(">{one}</text>")), "{one}: {svg}");
            }
        };
        has(&plot, &["2", "4", "6", "20"]);
        let both = LinePlot::new("t", "x").logarithmic_both();
        has(
            &both.with("a", [(0.01, 10.0), (100.0, 1e5)]),
            &["0.1", "10", "1000"],
        );
    }

    #[test]
    fn every_text_is_escaped() {
        let evil = "<script>alert('&\"')</script>";
        let svg = LinePlot::new(evil, evil)
            .with(evil, [(0.0, 1.0)])
            .with_limit(evil, 2.0)
            .to_svg();
        assert!(!svg.contains("<script"));
        assert_eq!(svg.matches("&lt;script").count(), 5);
    }

    #[test]
    fn a_long_run_is_a_small_file_and_keeps_its_spike() {
        let points = (0..200_000).map(|i| (f64::from(i), if i == 123_456 { 100.0 } else { 1.0 }));
        let svg = LinePlot::new("t", "x").with("a", points).to_svg();
        assert!(svg.len() < 100_000, "{}", svg.len());
        let highest = Axes {
            x: (0.0, 1.0),
            y: (0.0, 100.0 * 1.05 - 0.0),
            log: false,
            log_x: false,
            top: 50.0,
        }
        .place(0.0, 100.0);
        assert!(
            highest.is_some_and(|(_, y)| svg.contains(&format!(" {y:.1}L"))),
            "{highest:?}"
        );
    }

    proptest! {
        #[test]
        fn any_numbers(points in prop::collection::vec((any::<f64>(), any::<f64>()), 0..30), log in any::<bool>(), limit in any::<f64>()) {
            let svg = LinePlot { log_y: log, ..LinePlot::new("t", "x").with("a", points).with_limit("l", limit) }.to_svg();
            prop_assert!(!svg.contains("NaN") && !svg.contains("inf"), "{}", svg);
        }
    }
}
