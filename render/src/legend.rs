//! The colour bar of a field.

use super::colour::{ColourMap, Rgb};
use super::frame::Frame;
use super::text::TextStyle;
use super::ticks::Ticks;

const INK: Rgb = [0.16, 0.17, 0.19];
const TICK: i64 = 5;
const GAP: i64 = 6;
const MARGIN: i64 = 20;
/// Length of a mark beyond the bar on both sides [px].
const MARK: i64 = 3;

/// A colour bar with its title and unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Legend {
    /// Name of the field.
    pub title: String,
    /// Unit of the field; empty for none.
    pub unit: String,
    /// Values at the two ends of the bar, as for the surface.
    pub range: (f64, f64),
    /// The colours, as for the surface.
    pub map: ColourMap,
    /// Size of the text and the bar.
    pub style: TextStyle,
    /// A marked value and its colour; values outside the range are not marked.
    pub mark: Option<(f64, Rgb)>,
}

impl Legend {
    /// A legend with small text.
    pub fn new(
        title: impl Into<String>,
        unit: impl Into<String>,
        range: (f64, f64),
        map: ColourMap,
    ) -> Self {
        Self {
            title: title.into(),
            unit: unit.into(),
            range,
            map,
            style: TextStyle::Small,
            mark: None,
        }
    }

    /// The same with large text, for a picture that is displayed at a smaller size.
    pub fn large(self) -> Self {
        Self {
            style: TextStyle::Large,
            ..self
        }
    }

    /// The same with a marked value.
    pub fn with_mark(self, value: f64, colour: Rgb) -> Self {
        Self {
            mark: Some((value, colour)),
            ..self
        }
    }

    fn bar_width(&self) -> i64 {
        self.style.height() + 2
    }

    fn headings(&self) -> Vec<String> {
        let unit = if self.unit.is_empty() {
            String::new()
        } else {
            format!("[{}]", self.unit)
        };
        [self.title.clone(), unit]
            .into_iter()
            .filter(|line| !line.is_empty())
            .collect()
    }

    fn ticks(&self) -> Ticks {
        Ticks::linear(self.range, 6)
    }

    /// The width of the legend at the right of a picture \[px\], for [`super::Canvas::with_right`].
    pub fn width(&self) -> f64 {
        let style = self.style;
        let labels = self
            .ticks()
            .labels
            .iter()
            .map(|label| style.width(label))
            .max()
            .unwrap_or(0);
        let headings = self
            .headings()
            .iter()
            .map(|line| style.width(line))
            .max()
            .unwrap_or(0);
        (headings.max(self.bar_width() + TICK + GAP + labels) + MARGIN) as f64
    }

    /// Draws the legend at the right of a picture.
    pub fn draw(&self, frame: &mut Frame) {
        let (style, bar_width) = (self.style, self.bar_width());
        let left = frame.width() as i64 - self.width() as i64;
        let (top, bottom) = (frame.height() as i64 / 8, frame.height() as i64 * 7 / 8);
        frame.pale(
            left - 1..frame.width() as i64,
            top - 4..bottom + style.height() / 2 + 4,
        );
        let mut row = top;
        for line in self.headings() {
            frame.text(left, row, &line, style, INK);
            row += style.height() + 2;
        }
        let top = row + 10;
        let height = (bottom - top).max(2);
        frame.rectangle(
            left - 1..left + bar_width + 1,
            top - 1..top + height + 1,
            INK,
        );
        for down in 0..height {
            let t = 1.0 - (down as f64 + 0.5) / height as f64;
            frame.rectangle(
                left..left + bar_width,
                top + down..top + down + 1,
                self.map.colour(t),
            );
        }
        if let Some((value, colour)) = self.mark {
            let t = ColourMap::place(value, self.range);
            if (0.0..=1.0).contains(&t) {
                let at = top + ((1.0 - t) * height as f64).round() as i64;
                frame.rectangle(left - MARK..left + bar_width + MARK, at - 1..at + 2, colour);
            }
        }
        let ticks = self.ticks();
        for (value, label) in ticks.values.iter().zip(&ticks.labels) {
            let t = ColourMap::place(*value, self.range).clamp(0.0, 1.0);
            let at = top + ((1.0 - t) * height as f64).round() as i64;
            let from = left + bar_width + 1;
            frame.rectangle(from..from + TICK, at..at + 1, INK);
            frame.text(
                from + TICK + GAP - 2,
                at - style.height() / 2,
                label,
                style,
                INK,
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::colour::quantise;
    use super::*;

    #[test]
    fn a_legend_has_its_bar_its_ticks_and_its_words() {
        let legend = Legend::new("Strain", "%", (-10.0, 10.0), ColourMap::Diverging);
        let mut frame = Frame::plain(200, 300, [1.0; 3]);
        legend.draw(&mut frame);
        let column = 200 - legend.width() as usize + 4;
        let bar: Vec<_> = (0..300)
            .filter_map(|row| frame.pixel(column, row))
            .collect();
        for t in [0.02, 0.5, 0.98] {
            let expected = quantise(ColourMap::Diverging.colour(t));
            let near = |p: &[u8; 3]| p.iter().zip(&expected).all(|(a, b)| a.abs_diff(*b) < 4);
            assert!(bar.iter().any(near), "no {expected:?} in the bar");
        }
        let ticks = (0..300)
            .filter(|row| frame.pixel(column + 18, *row) == Some(quantise(INK)))
            .count();
        assert_eq!(ticks, 5, "-10, -5, 0, 5, 10");
        let clear = 200 - legend.width() as usize - 2;
        assert!(
            (0..300).all(|row| (0..clear).all(|x| frame.pixel(x, row) == Some([255; 3]))),
            "drawn too wide"
        );
    }

    #[test]
    fn a_mark_is_drawn_where_its_value_is_and_not_elsewhere() {
        let red = [1.0, 0.0, 0.0];
        let rows = |value: f64| -> Vec<usize> {
            let legend =
                Legend::new("Stretch", "", (1.0, 2.0), ColourMap::Viridis).with_mark(value, red);
            let mut frame = Frame::plain(200, 300, [1.0; 3]);
            legend.draw(&mut frame);
            let column = 200 - legend.width() as usize + 4;
            (0..300)
                .filter(|row| frame.pixel(column, *row) == Some(quantise(red)))
                .collect()
        };
        let (low, high) = (rows(1.25), rows(1.75));
        assert!(
            low.len() == 3 && high.len() == 3 && low[0] > high[0] + 50,
            "{low:?} {high:?}"
        );
        assert!(rows(2.5).is_empty() && rows(f64::NAN).is_empty());
    }

    #[test]
    fn any_range_and_any_size() {
        for range in [
            (0.0, 0.0),
            (f64::NAN, 1.0),
            (-f64::MAX, f64::MAX),
            (1.0, 0.0),
            (0.0, 1e-300),
        ] {
            for side in [1, 5, 200] {
                let legend = Legend::new("a rather long title", "", range, ColourMap::Viridis);
                legend.draw(&mut Frame::plain(side, side, [1.0; 3]));
            }
        }
    }
}
