//! Distance between two motions of the same bodies.

use nalgebra::Point3;

/// Distance of one motion from another, over all frames and bodies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameDistance {
    /// Root mean square over the vertices of a frame, in the worst frame [m].
    pub rms: f64,
    /// Greatest distance of any vertex in any frame [m].
    pub max: f64,
    /// The frame (from 1) with the greatest root mean square.
    pub frame: usize,
}

/// Raises `to` to `value` if that is greater or NaN, and returns true in that case. Not `f64::max`,
/// which would hide a NaN: a NaN stays.
pub(super) fn rise(to: &mut f64, value: f64) -> bool {
    let rises = !to.is_nan() && !(value <= *to);
    if rises {
        *to = value;
    }
    rises
}

impl FrameDistance {
    /// Distance between two motions, `[frame][vertex]`, over their common frames; NaN if a position
    /// is NaN.
    pub fn between(a: &[Vec<Point3<f64>>], b: &[Vec<Point3<f64>>]) -> Self {
        let mut all = Self::default();
        for (k, (a, b)) in a.iter().zip(b).enumerate() {
            let (mut sum, mut max) = (0.0, 0.0);
            for (a, b) in a.iter().zip(b) {
                let square = (a - b).norm_squared();
                sum += square;
                rise(&mut max, square);
            }
            let rms = (sum / a.len().max(1) as f64).sqrt();
            if rise(&mut all.rms, rms) {
                all.frame = k + 1;
            }
            rise(&mut all.max, max.sqrt());
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(x: &[f64]) -> Vec<Vec<Point3<f64>>> {
        x.iter()
            .map(|x| vec![Point3::new(*x, 0.0, 0.0), Point3::origin()])
            .collect()
    }

    #[test]
    fn the_worst_frame_counts() {
        let found = FrameDistance::between(&motion(&[0.0, 1.0, 2.0]), &motion(&[0.0, 4.0, 1.0]));
        assert_eq!((found.max, found.frame), (3.0, 2));
        assert!((found.rms - 4.5_f64.sqrt()).abs() <= 1e-15);
    }

    #[test]
    fn what_is_no_number_is_not_hidden() {
        let found = FrameDistance::between(&motion(&[0.0, f64::NAN, 2.0]), &motion(&[0.0; 3]));
        assert!(found.rms.is_nan() && found.max.is_nan());
    }
}
