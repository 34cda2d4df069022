//! Derivative of a length with respect to an angle, and its roughness.

/// Number of values on each side of a point in the local cubic fit.
pub const AROUND: usize = 4;

/// Moment arms `-dL/dq` [m] of lengths [m] at angles \[rad\] that are `step` apart. `around` = 0
/// means no smoothing: second-order differences, one-sided at the ends. Otherwise the slope is that
/// of the cubic fitted by least squares to `around` values on each side; near the ends, of the last
/// complete cubic. NaN for fewer than 3 lengths, or fewer than `2 around + 1`.
///
/// ```
/// use pliant::moment_arms::moment_arms;
/// let lengths: Vec<f64> = (0..9).map(|k| 0.3 - 0.04 * 0.1 * f64::from(k)).collect();
/// assert!(moment_arms(&lengths, 0.1, 0).iter().all(|r| (r - 0.04).abs() < 1e-15));
/// assert!(moment_arms(&lengths, 0.1, 4).iter().all(|r| (r - 0.04).abs() < 1e-14));
/// ```
pub fn moment_arms(lengths: &[f64], step: f64, around: usize) -> Vec<f64> {
    let n = lengths.len();
    if n < 3 || n < 2 * around + 1 {
        return vec![f64::NAN; n];
    }
    let l = lengths;
    let slope = |k: usize| match k {
        _ if around > 1 => {
            let middle = k.clamp(around, n - 1 - around);
            fitted_slope(
                &l[middle - around..=middle + around],
                k as f64 - middle as f64,
            )
        }
        0 => -1.5 * l[0] + 2.0 * l[1] - 0.5 * l[2],
        k if k + 1 == n => 1.5 * l[k] - 2.0 * l[k - 1] + 0.5 * l[k - 2],
        k => 0.5 * (l[k + 1] - l[k - 1]),
    };
    (0..n).map(|k| -slope(k) / step).collect()
}

/// Slope of the cubic fitted to an odd number of values, at least 5, at unit distances; `at` is the
/// position from the middle.
fn fitted_slope(values: &[f64], at: f64) -> f64 {
    let m = (values.len() / 2) as f64;
    let places: Vec<f64> = (0..values.len()).map(|k| k as f64 - m).collect();
    let sum = |power: i32| places.iter().map(|x| x.powi(power)).sum::<f64>();
    let of = |power: i32| {
        let both = values.iter().zip(&places);
        both.map(|(v, x)| (v - values[0]) * x.powi(power))
            .sum::<f64>()
    };
    let [s0, s2, s4, s6] = [0, 2, 4, 6].map(sum);
    let [t0, t1, t2, t3] = [0, 1, 2, 3].map(of);
    // On symmetric positions even and odd powers are independent.
    let odd = s2 * s6 - s4 * s4;
    let (linear, cubic) = ((t1 * s6 - t3 * s4) / odd, (t3 * s2 - t1 * s4) / odd);
    let square = (t2 * s0 - t0 * s2) / (s4 * s0 - s2 * s2);
    linear + 2.0 * square * at + 3.0 * cubic * at * at
}

/// Least and greatest of some numbers; both are NaN if one number is. `None` for no numbers.
pub fn extremes(numbers: impl IntoIterator<Item = f64>) -> Option<[f64; 2]> {
    let wider = |[low, high]: [f64; 2], [a, b]: [f64; 2]| match (low + a).is_nan() {
        true => [f64::NAN; 2],
        false => [low.min(a), high.max(b)],
    };
    numbers.into_iter().map(|n| [n, n]).reduce(wider)
}

/// Departure of a curve at even distances from the cubics fitted to it around each point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// Root mean square of the departures, relative to the curve's range.
    pub rms: f64,
    /// Greatest departure, relative to the curve's range.
    pub max: f64,
}

/// Departure of each inner value from the cubic fitted by least squares to the value and [`AROUND`]
/// values on each side, relative to the range of all values. `None` for fewer than `2 AROUND + 1`
/// values, or if all values are equal.
pub fn roughness(values: &[f64]) -> Option<Roughness> {
    let [least, most] = extremes(values.iter().copied())?;
    let range = most - least;
    if values.len() < 2 * AROUND + 1 || !(range > 0.0) || !values.iter().all(|v| v.is_finite()) {
        return None;
    }
    let weights = weights();
    let departure = |window: &[f64]| {
        let fitted: f64 = window
            .iter()
            .zip(&weights)
            .map(|(v, w)| (v - window[AROUND]) * w)
            .sum();
        fitted.abs() / range
    };
    let all: Vec<f64> = values.windows(2 * AROUND + 1).map(departure).collect();
    let squares: f64 = all.iter().map(|d| d * d).sum();
    Some(Roughness {
        rms: (squares / all.len() as f64).sqrt(),
        max: crate::mesh::measures::max_or_nan(all.iter().copied()),
    })
}

/// Weights of the values in the middle of a cubic fitted to `2 AROUND + 1` values: the
/// Savitzky-Golay weights in closed form.
fn weights() -> [f64; 2 * AROUND + 1] {
    let m = AROUND as f64;
    let scale = (2.0 * m - 1.0) * (2.0 * m + 1.0) * (2.0 * m + 3.0);
    std::array::from_fn(|k| {
        let i = k as f64 - m;
        3.0 * (3.0 * m * m + 3.0 * m - 1.0 - 5.0 * i * i) / scale
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Second-order differences are exact on parabolas; cubics are not rough.
        #[test]
        fn exact_on_polynomials(c in prop::array::uniform4(-1.0..1.0_f64), step in 0.01..0.5_f64, n in 9usize..40) {
            let at = |k: usize, terms: usize| (0..terms).rev().fold(0.0, |v, i| v * (k as f64 * step) + c[i]);
            let parabola: Vec<f64> = (0..n).map(|k| at(k, 3)).collect();
            let size = n as f64 * step;
            for (k, r) in moment_arms(&parabola, step, 0).iter().enumerate() {
                let exact = -(c[1] + 2.0 * c[2] * k as f64 * step);
                // Rounding of lengths of size 1 + size^2, divided by the step.
                prop_assert!((r - exact).abs() <= 16.0 * f64::EPSILON * (1.0 + size * size) / step, "{r} {exact}");
            }
            let slopes = moment_arms(&(0..n).map(|k| at(k, 4)).collect::<Vec<_>>(), step, 4);
            for (k, r) in slopes.iter().enumerate() {
                let q = k as f64 * step;
                let exact = -(c[1] + 2.0 * c[2] * q + 3.0 * c[3] * q * q);
                // Rounding as above, and sums of sixth powers of four.
                prop_assert!((r - exact).abs() <= 512.0 * f64::EPSILON * (1.0 + size.powi(3)) / step, "{r} {exact}");
            }
            let cubic: Vec<f64> = (0..n).map(|k| at(k, 4)).collect();
            let range = crate::mesh::measures::max_or_nan(cubic.iter().flat_map(|a| cubic.iter().map(move |b| a - b)));
            prop_assume!(range > 1e-3);
            let found = roughness(&cubic).map_or(f64::NAN, |r| r.max);
            prop_assert!(found <= 32.0 * f64::EPSILON * (1.0 + size.powi(3)) / range, "{found}");
        }
    }

    #[test]
    fn a_cubic_smooths_noise_and_keeps_slopes() {
        // Two up, two down: the noise with the greatest effect on central differences.
        let noise = |k: usize| if k % 4 < 2 { 1e-3 } else { -1e-3 };
        let noisy: Vec<f64> = (0..40).map(|k| 0.1 * k as f64 + noise(k)).collect();
        let worst = |around| {
            let arms = moment_arms(&noisy, 1.0, around);
            crate::mesh::measures::max_or_nan(arms.iter().skip(4).take(32).map(|r| (r + 0.1).abs()))
        };
        assert!(
            worst(4) <= 0.5 * worst(0) && worst(0) > 0.9e-3,
            "{} {}",
            worst(4),
            worst(0)
        );
    }

    #[test]
    fn extremes_of_any_sign_and_of_none() {
        assert_eq!(extremes([-3.0, -1.0, -2.0]), Some([-3.0, -1.0]));
        assert_eq!(extremes([]), None);
        for numbers in [[f64::NAN, 1.0], [1.0, f64::NAN]] {
            assert!(extremes(numbers).is_some_and(|e| e.iter().all(|v| v.is_nan())));
        }
    }

    #[test]
    fn a_jump_is_rough() {
        let jump: Vec<f64> = (0..40)
            .map(|k| f64::from(k) * 0.1 + if k < 20 { 0.0 } else { 0.04 })
            .collect();
        let found = roughness(&jump).expect("a range");
        assert!(found.max > 0.002 && found.rms > 0.0005, "{found:?}");
        assert_eq!(roughness(&[1.0; 20]), None);
        assert_eq!(roughness(&[1.0, 2.0]), None);
        assert!(
            moment_arms(&[1.0, 2.0, 3.0], 0.1, 4)
                .iter()
                .all(|r| r.is_nan())
        );
        assert!(moment_arms(&[1.0, 2.0], 0.1, 0).iter().all(|r| r.is_nan()));
    }
}
