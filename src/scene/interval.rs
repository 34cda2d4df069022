//! Values with an interval, such as `"300 +- 90 N/m"`: what is known of a value beside the value.

use std::cell::RefCell;

use super::units::{Dimension, UnitError, parse, split_number};

/// The signs between a value and half of its interval.
const PLUS_MINUS: [&str; 3] = ["+-", "+/-", "±"];

/// A value of a scene with its interval, which contains it with a probability of 95 %.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertain {
    /// The key of the value, such as `muscle.0.material.stretch`.
    pub key: String,
    /// The value and its interval as the scene writes them.
    pub text: String,
    /// The value in the SI unit of its dimension.
    pub value: f64,
    /// Half of the interval, in the same unit.
    pub half: f64,
}

/// The values of a text with an interval, and those that stand in place of some.
#[derive(Default)]
pub(super) struct Intervals<'a> {
    pub found: RefCell<Vec<Uncertain>>,
    /// Values in SI units by their keys.
    pub instead: &'a [(&'a str, f64)],
}

impl Intervals<'_> {
    /// Reads the quantity at `key`.
    pub fn read(&self, key: &str, text: &str, dimension: Dimension) -> Result<f64, UnitError> {
        let (value, half) = uncertain_quantity(text, dimension)?;
        if let Some(half) = half {
            let mut found = self.found.borrow_mut();
            // Some values are read twice.
            if found.iter().all(|known| known.key != key) {
                found.push(Uncertain {
                    key: key.to_owned(),
                    text: text.trim().to_owned(),
                    value,
                    half,
                });
            }
        }
        let instead = self.instead.iter().find(|(other, _)| *other == key);
        Ok(instead.map_or(value, |(_, value)| *value))
    }
}

/// True for the text of a value with an interval.
pub(super) fn has_interval(text: &str) -> bool {
    PLUS_MINUS.iter().any(|sign| text.contains(sign))
}

/// A quantity that can have an interval, such as `"300 +- 90 N/m"`, `"300 N/m +- 30 %"` or `"0.5 mm"`:
/// the value and half of the interval in the SI unit of the dimension. The value takes the unit of its
/// interval if it has none; a percentage is one of the value, but for a ratio.
///
/// # Errors
/// As of [`parse`]; half of an interval that is not positive.
///
/// ```
/// use pliant::scene::{uncertain_quantity, units::Dimension};
/// assert_eq!(uncertain_quantity("300 +- 90 N/m", Dimension::Stiffness), Ok((300.0, Some(90.0))));
/// assert!(uncertain_quantity("2 m +- 0 m", Dimension::Length).is_err());
/// ```
pub fn uncertain_quantity(
    text: &str,
    dimension: Dimension,
) -> Result<(f64, Option<f64>), UnitError> {
    let sign = PLUS_MINUS.iter().find_map(|sign| text.split_once(sign));
    let Some((value, half)) = sign else {
        return parse(text, dimension).map(|value| (value, None));
    };
    let (value, half) = (value.trim(), half.trim());
    let bad = || UnitError::NoInterval {
        text: crate::spelling::shown(text.trim()),
        dimension,
    };
    let unit = split_number(half).ok_or_else(bad)?.1.trim();
    let is_share = unit == "%" && dimension != Dimension::Ratio;
    let is_bare = split_number(value).is_some_and(|(_, unit)| unit.trim().is_empty());
    let value = match is_bare && !is_share {
        true => parse(&format!("{value} {unit}"), dimension)?,
        false => parse(value, dimension)?,
    };
    let half = match is_share {
        true => parse(half, Dimension::Ratio)? * value.abs(),
        false => parse(half, dimension)?,
    };
    if half > 0.0 && half.is_finite() {
        Ok((value, Some(half)))
    } else {
        Err(bad())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn intervals_are_read_and_half_intervals_refused() {
        let read = |text: &str| uncertain_quantity(text, Dimension::Pressure);
        for text in [
            "200 kPa +- 60 kPa",
            "200 +- 60 kPa",
            "200 kPa ± 30 %",
            "0.2 MPa +/- 60kPa",
        ] {
            let (value, half) = read(text).expect(text);
            assert_relative_eq!(value, 2e5, max_relative = 1e-15);
            assert_relative_eq!(half.expect(text), 6e4, max_relative = 1e-15);
        }
        assert_eq!(read("200 kPa"), Ok((2e5, None)));
        let ratio = uncertain_quantity("10 % +- 2 %", Dimension::Ratio);
        assert_eq!(ratio, Ok((0.1, Some(0.02))), "of a ratio, not of the value");
        for text in [
            "200 kPa +-",
            "200 kPa +- 0 kPa",
            "200 kPa +- -5 kPa",
            "+- 5 kPa",
            "200 kPa +- 5 mm",
            "200 +- 30 %",
            "0 kPa +- 30 %",
            "200 kPa +- 5 kPa +- 5 kPa",
            "200 kPa +- NaN",
        ] {
            assert!(read(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_value_is_noted_once_and_can_be_replaced() {
        let intervals = Intervals {
            instead: &[("a.b", 7.0)],
            ..Intervals::default()
        };
        let read = |key: &str| intervals.read(key, "2 +- 1 m", Dimension::Length);
        assert_eq!(
            (read("a.b"), read("a.b"), read("a.c")),
            (Ok(7.0), Ok(7.0), Ok(2.0))
        );
        let found = intervals.found.into_inner();
        let known: Vec<_> = found
            .iter()
            .map(|u| (u.key.as_str(), u.value, u.half))
            .collect();
        assert_eq!(known, [("a.b", 2.0, 1.0), ("a.c", 2.0, 1.0)]);
    }
}
