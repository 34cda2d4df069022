//! Fields that colour a surface, with their ranges and legends.

use super::snapshot::BodyShot;
use pliant::format::number;
use pliant_render::{ColourMap, Legend, Rgb, Ticks};

/// The field of a surface's colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Field {
    /// Mean absolute strain of the edges at a vertex.
    Stretch,
    /// Depth in the bones.
    Depth,
    /// Speed.
    Speed,
}

impl Field {
    /// All fields.
    pub const ALL: [Self; 3] = [Self::Stretch, Self::Depth, Self::Speed];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stretch => "Stretch",
            Self::Depth => "Depth",
            Self::Speed => "Speed",
        }
    }

    /// Displayed unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Stretch => "%",
            Self::Depth => "mm",
            Self::Speed => "mm/s",
        }
    }

    /// Factor from the unit of a snapshot to the displayed unit.
    fn factor(self) -> f64 {
        match self {
            Self::Stretch => 100.0,
            Self::Depth | Self::Speed => 1e3,
        }
    }

    /// Least upper end of a range in the displayed unit: smaller differences have no colours.
    fn least(self) -> f64 {
        match self {
            Self::Stretch => 1.0,
            Self::Depth => 0.01,
            Self::Speed => 1.0,
        }
    }

    /// The values of a body in the displayed unit, one per vertex.
    pub fn values(self, body: &BodyShot) -> Vec<f64> {
        let values = match self {
            Self::Stretch => &body.stretch,
            Self::Depth => &body.depth,
            Self::Speed => &body.speed,
        };
        values.iter().map(|value| value * self.factor()).collect()
    }
}

/// The colours of a field. The range starts at 0 and only grows, in steps of 1, 2, 5, 10, so that
/// colours do not flicker from frame to frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Colouring {
    /// Displayed field.
    pub field: Field,
    /// Values at the two ends of the map, in the displayed unit.
    pub range: (f64, f64),
}

impl Colouring {
    /// A colouring without values.
    pub fn new(field: Field) -> Self {
        Self {
            field,
            range: (0.0, field.least()),
        }
    }

    /// Widens the range to contain `values`; NaN is ignored.
    pub fn see(&mut self, values: &[f64]) {
        let largest = values
            .iter()
            .copied()
            .filter(|v| v.is_finite())
            .fold(0.0, f64::max);
        if largest > self.range.1 {
            self.range.1 = round_up(largest);
        }
    }

    /// A colour for each value; grey for NaN.
    pub fn colours(&self, values: &[f64]) -> Vec<Rgb> {
        values
            .iter()
            .map(|value| ColourMap::Viridis.colour(ColourMap::place(*value, self.range)))
            .collect()
    }

    /// Positions on the bar of the legend, 0 to 1, with their labels.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        let ticks = Ticks::linear(self.range, 6);
        let places = ticks
            .values
            .iter()
            .map(|value| ColourMap::place(*value, self.range).clamp(0.0, 1.0));
        places.zip(ticks.labels).collect()
    }

    /// The legend of a picture by the software renderer.
    pub fn legend(&self) -> Legend {
        Legend::new(
            self.field.name(),
            self.field.unit(),
            self.range,
            ColourMap::Viridis,
        )
    }

    /// A value as text.
    pub fn in_words(&self, value: f64) -> String {
        format!("{} {}", number(value), self.field.unit())
    }
}

/// The next of 1, 2, 5 times a power of ten.
fn round_up(value: f64) -> f64 {
    let power = libm::pow(10.0, libm::log10(value).floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power);
    steps
        .into_iter()
        .find(|step| *step >= value)
        .unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_grows_by_round_numbers_and_never_shrinks() {
        let mut colouring = Colouring::new(Field::Stretch);
        assert_eq!(colouring.range, (0.0, 1.0));
        for (seen, end) in [
            (0.3, 1.0),
            (1.2, 2.0),
            (4.0, 5.0),
            (1.0, 5.0),
            (700.0, 1000.0),
            (f64::NAN, 1000.0),
        ] {
            colouring.see(&[0.0, seen]);
            assert_eq!(colouring.range, (0.0, end), "{seen}");
        }
        let mut depth = Colouring::new(Field::Depth);
        depth.see(&[3e-5]);
        assert_eq!(depth.range.1, 0.01, "a hair is no depth");
        depth.see(&[f64::INFINITY, 0.011]);
        assert_eq!(depth.range.1, 0.02);
    }

    #[test]
    fn colours_rise_with_values_and_no_number_is_grey() {
        let mut colouring = Colouring::new(Field::Speed);
        let values = [0.0, 5.0, 10.0, f64::NAN, 20.0];
        colouring.see(&values[..3]);
        let colours = colouring.colours(&values);
        assert_eq!(colours[0], ColourMap::Viridis.colour(0.0));
        assert_eq!(colours[1], ColourMap::Viridis.colour(0.5));
        assert_eq!(colours[2], ColourMap::Viridis.colour(1.0));
        assert_eq!(colours[3], pliant_render::colour::NO_VALUE);
        assert_eq!(
            colours[4], colours[2],
            "beyond the end there is no colour of its own"
        );
        assert_ne!(colours[1], colours[2]);
    }

    #[test]
    fn ticks_stand_where_their_numbers_are() {
        for (field, seen) in [
            (Field::Stretch, 7.0),
            (Field::Depth, 0.3),
            (Field::Speed, 1234.0),
        ] {
            let mut colouring = Colouring::new(field);
            colouring.see(&[seen]);
            let ticks = colouring.ticks();
            assert!((3..=9).contains(&ticks.len()), "{ticks:?}");
            for (place, text) in &ticks {
                let value: f64 = text.parse().expect("a number");
                assert!(
                    (place * colouring.range.1 - value).abs() < 1e-9 * colouring.range.1,
                    "{text} at {place}"
                );
            }
            assert!(ticks.windows(2).all(|pair| pair[0].0 < pair[1].0));
        }
    }
}
