//! Areas of skin over an implant: before, under tension, after retraction, and after growth, with
//! the published intervals.

use nalgebra::{Matrix2, Point3};

use super::layers::Layers;
use crate::mesh::measures::{area, max_or_nan};
use crate::mesh::sum::tree_sum_by;

/// Limitations of every prediction, for reports.
pub const CAVEATS: [&str; 4] = [
    "The deformed area is elastic and an upper bound: in pigs about a third of the gain remained when the expander was taken out.",
    "The intervals are published ratios of a few animals, applied to the area found here; they are not predictions for a patient.",
    "The stiffness of the skin is assumed unless it was given. With two and a half times as much, a flat skin over 100 cc gains a tenth less, and presses twice as hard; `pliant sensitivities` tells the intervals.",
    "The limit of the stretch is a setting, not a measured threshold of perfusion.",
];

/// The share of the gained area that remains when the implant is removed, as published for pigs:
/// about 35 % \[vanrappard1988\], by shape 25 % (round), 32 % (crescent), 38 % (rectangular).
pub const RETRACTED: Interval = Interval {
    low: 0.25,
    high: 0.38,
};

/// Ratio of growth to elastic stretch, both as ratios of areas, as published for expanders of 60 cc
/// under the skin of minipigs after an hour to a week \[janes2020\]: 1.03, 0.82, 0.85, 0.95.
pub const GROWTH: Interval = Interval {
    low: 0.82,
    high: 1.03,
};

/// Source of the interval of the retracted area.
pub const RETRACTED_SOURCE: &str = "25 to 38 % of the gain remains: pigs, by shape (round 25, crescent 32, rectangular 38, all 35) [vanrappard1988]";

/// Source of the interval of the grown area.
pub const GROWN_SOURCE: &str = "growth is 0.82 to 1.03 times the elastic stretch: minipigs, 60 cc, an hour to a week [janes2020]";

/// An interval of values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Interval {
    /// The image of the interval under an increasing function.
    pub fn map(self, change: impl Fn(f64) -> f64) -> Self {
        Self {
            low: change(self.low),
            high: change(self.high),
        }
    }
}

/// Areas of a region of skin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Areas {
    /// Area before the insertion [m^2].
    pub before: f64,
    /// Area over the implant, stretched [m^2]: an upper bound of the usable area.
    pub deformed: f64,
    /// Area after removal of the implant, without stretch [m^2].
    pub retracted: Interval,
    /// Grown area without elastic stretch, if the deformed area is kept long enough [m^2].
    pub grown: Interval,
    /// Volume between the region before and the region over the implant, closed at its fixed
    /// boundary [m^3].
    pub volume_difference: f64,
    /// The same of the lower layer [m^3]: the room for the implant and the void beside it.
    pub room: f64,
    /// Greatest stretch of a triangle in any direction.
    pub stretch_max: f64,
}

impl Areas {
    /// Measures the upper layer at positions `x`.
    pub fn of(layers: &Layers, x: &[Point3<f64>]) -> Self {
        let n = layers.count();
        let (before, deformed) = (
            area(&layers.rest[..n], &layers.triangles),
            area(&x[..n], &layers.triangles),
        );
        Self {
            volume_difference: volume_between(&layers.rest[..n], &x[..n], &layers.triangles),
            room: volume_between(&layers.rest[n..2 * n], &x[n..2 * n], &layers.triangles),
            stretch_max: max_or_nan(stretches(&layers.rest[..n], &x[..n], &layers.triangles)),
            ..Self::between(before, deformed)
        }
    }

    /// Predictions from two areas [m^2] by the published ratios.
    pub fn between(before: f64, deformed: f64) -> Self {
        let gain = deformed - before;
        let grown = |ratio: f64| before * (ratio * deformed / before).sqrt().max(1.0);
        Self {
            before,
            deformed,
            retracted: RETRACTED.map(|share| before + share * gain),
            grown: GROWTH.map(grown),
            ..Self::default()
        }
    }

    /// Area gained while the implant is in place [m^2].
    pub fn gain(&self) -> f64 {
        self.deformed - self.before
    }
}

impl std::iter::Sum for Areas {
    /// Sum over disjoint parts of skin; the stretch is the greatest.
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        let add = |a: Interval, b: Interval| Interval {
            low: a.low + b.low,
            high: a.high + b.high,
        };
        parts.fold(Self::default(), |sum, a| Self {
            before: sum.before + a.before,
            deformed: sum.deformed + a.deformed,
            retracted: add(sum.retracted, a.retracted),
            grown: add(sum.grown, a.grown),
            volume_difference: sum.volume_difference + a.volume_difference,
            room: sum.room + a.room,
            stretch_max: max_or_nan([sum.stretch_max, a.stretch_max]),
        })
    }
}

/// The volume that a surface with a fixed boundary sweeps between two positions [m^3], positive
/// outward.
pub fn volume_between(from: &[Point3<f64>], to: &[Point3<f64>], triangles: &[[u32; 3]]) -> f64 {
    let Some(origin) = from.first() else {
        return 0.0;
    };
    let six = |x: &[Point3<f64>], t: [u32; 3]| {
        let [a, b, c] = t.map(|v| x[v as usize] - origin);
        a.dot(&b.cross(&c))
    };
    tree_sum_by(triangles.len(), |t| {
        six(to, triangles[t]) - six(from, triangles[t])
    }) / 6.0
}

/// The greatest stretch of each triangle in any direction.
pub fn stretches(rest: &[Point3<f64>], x: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<f64> {
    let metric = |x: &[Point3<f64>], t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| x[v as usize]);
        let (u, v) = (b - a, c - a);
        Matrix2::new(u.dot(&u), u.dot(&v), u.dot(&v), v.dot(&v))
    };
    let stretch = |t: &[u32; 3]| {
        // The squared principal stretches are the eigenvalues of one metric relative to the other.
        let Some(inverse) = metric(rest, t).try_inverse() else {
            return f64::NAN;
        };
        let by = inverse * metric(x, t);
        let (half, product) = (0.5 * by.trace(), by.determinant());
        (half + (half * half - product).max(0.0).sqrt()).sqrt()
    };
    triangles.iter().map(stretch).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sum_hides_no_part_that_is_no_number() {
        let part = |stretch_max| Areas {
            stretch_max,
            ..Areas::between(1.0, 1.2)
        };
        let both: Areas = [part(1.1), part(1.3)].into_iter().sum();
        assert!((both.gain() - 0.4).abs() <= 1e-12 && both.stretch_max == 1.3);
        for parts in [[part(1.1), part(f64::NAN)], [part(f64::NAN), part(1.1)]] {
            assert!(!(parts.into_iter().sum::<Areas>().stretch_max <= f64::MAX));
        }
    }

    #[test]
    fn a_stretched_triangle_tells_its_greater_stretch() {
        let rest = [
            Point3::origin(),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(0.3, 1.0, 0.0),
        ];
        // Stretched by 1.5 and 0.8 along axes rotated by 0.4, then rotated out of its plane.
        let turn = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), 0.4);
        let out = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::x_axis(), 1.0);
        let stretch = nalgebra::Vector3::new(1.5, 0.8, 1.0);
        let x = rest.map(|p| {
            out * (turn * Point3::from((turn.inverse() * p).coords.component_mul(&stretch)))
        });
        let found = stretches(&rest, &x, &[[0, 1, 2]])[0];
        assert!((found - 1.5).abs() <= 1e-12, "{found}");
    }

    #[test]
    fn intervals_lie_between_before_and_deformed() {
        let areas = Areas::between(0.01, 0.014);
        assert!(
            (areas.retracted.low - 0.011).abs() <= 1e-12
                && (areas.retracted.high - 0.01152).abs() <= 1e-12
        );
        for interval in [areas.retracted, areas.grown] {
            assert!(
                interval.low >= areas.before
                    && interval.high <= areas.deformed
                    && interval.low < interval.high
            );
        }
        // No gain: no retraction and no growth.
        let none = Areas::between(0.01, 0.01);
        assert!((none.retracted.high - 0.01).abs() <= 1e-15 && none.grown.low == 0.01);
    }
}
