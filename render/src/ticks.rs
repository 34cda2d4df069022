//! Round numbers along an axis.

use pliant::format::number;

/// Round numbers in a range, with their labels.
#[derive(Clone, Debug, PartialEq)]
pub struct Ticks {
    /// The numbers, in ascending order.
    pub values: Vec<f64>,
    /// Labels, all with the same number of decimals.
    pub labels: Vec<String>,
}

impl Ticks {
    /// About `count` multiples of 1, 2 or 5 times a power of ten inside `range`; none for a range
    /// that is not finite.
    pub fn linear(range: (f64, f64), count: usize) -> Self {
        let (low, high) = (range.0.min(range.1), range.0.max(range.1));
        // Beyond these sizes a step is no normal number.
        if range.0.is_nan() || range.1.is_nan() || !(low.abs() < 1e300 && high.abs() < 1e300) {
            return Self {
                values: Vec::new(),
                labels: Vec::new(),
            };
        }
        let step = round_step((high - low) / count.max(1) as f64);
        let Some(step) = step.filter(|step| *step > 4.0 * f64::EPSILON * low.abs().max(high.abs()))
        else {
            return Self {
                labels: vec![number(low)],
                values: vec![low],
            };
        };
        // A tolerance of a thousandth of a step, for ends that are round up to rounding.
        let (first, last) = ((low / step - 1e-3).ceil(), (high / step + 1e-3).floor());
        // Adding 0 makes -0 into 0.
        let values: Vec<f64> = (0..=(last - first).max(0.0) as usize)
            .map(|i| (first + i as f64) * step + 0.0)
            .collect();
        let labels = values
            .iter()
            .map(|v| label(*v, step, low.abs().max(high.abs())))
            .collect();
        Self { values, labels }
    }

    /// Powers of ten in a positive range; every second or third if there are many, with their
    /// multiples by 2 and 5 if there are few. None for another range.
    pub fn logarithmic(range: (f64, f64), count: usize) -> Self {
        let (low, high) = (range.0.min(range.1), range.0.max(range.1));
        if !(low > 0.0 && high.is_finite()) {
            return Self {
                values: Vec::new(),
                labels: Vec::new(),
            };
        }
        let (first, last) = (
            (libm::log10(low) - 1e-9).ceil() as i32,
            (libm::log10(high) + 1e-9).floor() as i32,
        );
        let every = ((last - first).max(0) as usize / count.max(1) + 1) as i32;
        let powers: Vec<i32> = (first..=last)
            .filter(|p| p.rem_euclid(every) == 0)
            .collect();
        if powers.len() < 3 {
            let multiples = (first - 1..=last)
                .flat_map(|p| [1.0, 2.0, 5.0].map(|m| m * libm::pow(10.0, f64::from(p))));
            let values: Vec<f64> = multiples.filter(|v| (low..=high).contains(v)).collect();
            if values.len() > powers.len() && values.len() <= count + 2 {
                return Self {
                    labels: values.iter().map(|v| number(*v)).collect(),
                    values,
                };
            }
        }
        Self {
            values: powers
                .iter()
                .map(|p| libm::pow(10.0, f64::from(*p)))
                .collect(),
            labels: powers
                .iter()
                .map(|p| {
                    if (-3..=4).contains(p) {
                        number(libm::pow(10.0, f64::from(*p)))
                    } else {
                        format!("1e{p}")
                    }
                })
                .collect(),
        }
    }
}

/// The number of the form 1, 2, 5 times a power of ten with the nearest logarithm; `None` for a
/// size that is not positive.
fn round_step(size: f64) -> Option<f64> {
    if !(size.is_finite() && size > 0.0) {
        return None;
    }
    let power = libm::pow(10.0, libm::log10(size).floor());
    // The limits are the geometric means of neighbours, except 3 between 2 and 5: no step is less
    // than 2/3 of the size.
    let digit = match size / power {
        d if d * d < 2.0 => 1.0,
        d if d < 3.0 => 2.0,
        d if d * d < 50.0 => 5.0,
        _ => 10.0,
    };
    Some(digit * power).filter(|step| step.is_finite() && *step > 0.0)
}

/// The label of a tick: plain if that is short, otherwise with an exponent.
fn label(value: f64, step: f64, largest: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let exponent = |v: f64| libm::log10(v).floor() as i32;
    if !(1e-3..1e5).contains(&largest) {
        let power = exponent(value.abs() * (1.0 + 1e-12));
        let decimals = (power - exponent(step * (1.0 + 1e-12))).clamp(0, 15) as usize;
        return format!(
            "{:.decimals$}e{power}",
            value / libm::pow(10.0, f64::from(power))
        );
    }
    let decimals = (-exponent(step * (1.0 + 1e-12))).clamp(0, 17) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn labels(low: f64, high: f64, count: usize) -> Vec<String> {
        Ticks::linear((low, high), count).labels
    }

    #[test]
    fn round_numbers() {
        assert_eq!(
            labels(0.0, 1.0, 5),
            ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"].map(|s| if s == "0.0" { "0" } else { s })
        );
        assert_eq!(labels(-7.0, 7.0, 3), ["-5", "0", "5"]);
        assert_eq!(
            labels(0.0, 300.0, 6),
            ["0", "50", "100", "150", "200", "250", "300"]
        );
        assert_eq!(labels(0.0, 3e-6, 3), ["0", "1e-6", "2e-6", "3e-6"]);
        assert_eq!(labels(1.0, 0.0, 2), ["0", "0.5", "1.0"]);
        assert_eq!(labels(3.0, 3.0, 5), ["3"]);
        assert_eq!(labels(0.0, f64::NAN, 5), Vec::<String>::new());
        assert_eq!(
            Ticks::logarithmic((1e-6, 10.0), 4).labels,
            ["1e-6", "1e-4", "0.01", "1"]
        );
        assert_eq!(
            Ticks::logarithmic((0.15, 7.0), 5).labels,
            ["0.2", "0.5", "1", "2", "5"]
        );
    }

    #[test]
    fn a_range_that_once_had_too_many() {
        // A step of 2 for a target of 3.16 gave 32 ticks for 19.
        let ticks = Ticks::linear((6.000955956386833e20, 0.0), 19);
        assert!(
            (10..=30).contains(&ticks.values.len()),
            "{}",
            ticks.values.len()
        );
    }

    proptest! {
        #[test]
        fn rising_inside_and_few(a in any::<f64>(), b in any::<f64>(), count in 1usize..20) {
            let ticks = Ticks::linear((a, b), count);
            prop_assert!(ticks.values.len() <= count * 3 / 2 + 2);
            prop_assert!(ticks.values.windows(2).all(|p| p[0] < p[1]));
            let ticks = Ticks::logarithmic((a.abs(), b.abs()), count);
            prop_assert!(ticks.values.len() <= count + 2);
            prop_assert!(ticks.values.windows(2).all(|p| p[0] < p[1]));
        }

        #[test]
        fn labels_tell_values_apart(low in -1e4..1e4f64, size in 1e-6..1e4f64, count in 2usize..12) {
            let ticks = Ticks::linear((low, low + size), count);
            prop_assert!(ticks.values.len() >= count / 2, "{:?}", ticks);
            for (value, text) in ticks.values.iter().zip(&ticks.labels) {
                let read: f64 = text.parse().expect("a number");
                prop_assert!((read - value).abs() <= 1e-6 * size, "{} {}", value, text);
            }
        }
    }
}
