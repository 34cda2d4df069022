//! A smooth distance: cubic B-splines with samples of an obstacle's signed distance.
//!
//! The derivatives of the distance to a triangle mesh jump where the nearest triangle changes, and
//! where two points are equally near. A body that slides over the mesh feels every jump. Splines
//! whose coefficients are distance samples average it over a few cells: their second derivatives
//! are continuous everywhere.

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use super::Obstacle;
use crate::mesh::measures::Aabb;

/// Samples along the edge of a block that is tested as a whole.
const BLOCK: usize = 4;

/// Greatest number of samples of one obstacle: 40 MB, twice that during the sampling.
pub const MOST_SAMPLES: usize = 5_000_000;

/// Least spacing of samples relative to the obstacle's length. If most edges of a mesh have no
/// length, the median is meaningless, and coarsening from there would not end.
const FINEST: f64 = 1.0 / 4096.0;

/// A smoothed signed distance in an obstacle's own frame.
#[derive(Clone, Debug)]
pub struct SmoothDistance {
    /// Position of the first sample [m].
    origin: Point3<f64>,
    /// Distance between samples [m].
    spacing: f64,
    count: [usize; 3],
    /// Samples in x-major order [m].
    values: Vec<f64>,
}

/// A value [m] with its first and second derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smooth {
    /// Smoothed signed distance [m], negative inside.
    pub distance: f64,
    /// Gradient of the distance, of length about 1.
    pub gradient: Vector3<f64>,
    /// Second derivative of the distance [1/m].
    pub hessian: Matrix3<f64>,
}

/// Number of samples along each axis, in whole blocks.
fn sample_counts(bounds: &Aabb, spacing: f64, reach: f64) -> [usize; 3] {
    let margin = reach + 2.0 * spacing;
    let extents: [f64; 3] = bounds.inflate(margin).extents().into();
    extents.map(|length| ((length / spacing).ceil() as usize + 1).next_multiple_of(BLOCK))
}

impl SmoothDistance {
    /// Samples the distance to an obstacle every `spacing` [m] where it is below `reach` [m]; the
    /// spacing increases if there would be more than [`MOST_SAMPLES`]. Over a surface of mean
    /// curvature H the smoothed distance differs by spacing^2 H / 3.
    pub fn new(obstacle: &dyn Obstacle, spacing: f64, reach: f64) -> Self {
        let bounds = obstacle.bounding_box();
        let total = |spacing: f64| {
            let counts = sample_counts(&bounds, spacing, reach);
            counts.iter().map(|n| *n as f64).product::<f64>()
        };
        // NaN is no spacing either.
        let mut spacing = spacing.max(FINEST * bounds.inflate(reach).extents().amax());
        while total(spacing) > MOST_SAMPLES as f64 {
            spacing *= 1.25;
        }
        let count = sample_counts(&bounds, spacing, reach);
        let origin = bounds.inflate(reach + 2.0 * spacing).min;
        let mut made = Self {
            origin,
            spacing,
            count,
            values: Vec::new(),
        };
        made.values = made.sample(obstacle, reach);
        made
    }

    fn place(&self, at: [usize; 3]) -> Point3<f64> {
        self.origin + Vector3::from(at.map(|k| k as f64)) * self.spacing
    }

    /// All samples; blocks farther than `reach` get the distance of their centres.
    fn sample(&self, obstacle: &dyn Obstacle, reach: f64) -> Vec<f64> {
        let blocks = self.count.map(|n| n / BLOCK);
        let half = 0.5 * (BLOCK - 1) as f64 * self.spacing;
        // Every sample in the support of a spline within `reach` must be exact.
        let far = reach + (half + 2.0 * self.spacing) * 3f64.sqrt();
        let of = |b: usize| -> [f64; BLOCK * BLOCK * BLOCK] {
            let first = [
                b % blocks[0],
                b / blocks[0] % blocks[1],
                b / blocks[0] / blocks[1],
            ]
            .map(|k| k * BLOCK);
            let distance = |p: &Point3<f64>| obstacle.closest(p).map_or(f64::MAX, |c| c.distance);
            let middle = distance(&(self.place(first) + Vector3::repeat(half)));
            if middle.abs() > far {
                return [middle; BLOCK * BLOCK * BLOCK];
            }
            std::array::from_fn(|k| {
                let within = [k % BLOCK, k / BLOCK % BLOCK, k / BLOCK / BLOCK];
                distance(&self.place(std::array::from_fn(|c| first[c] + within[c])))
            })
        };
        let found: Vec<_> = (0..blocks.iter().product::<usize>())
            .into_par_iter()
            .map(of)
            .collect();
        let [nx, ny, nz] = self.count;
        let mut values = Vec::with_capacity(nx * ny * nz);
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let block = x / BLOCK + blocks[0] * (y / BLOCK + blocks[1] * (z / BLOCK));
                    values
                        .push(found[block][x % BLOCK + BLOCK * (y % BLOCK + BLOCK * (z % BLOCK))]);
                }
            }
        }
        values
    }

    /// The distance at a point in the obstacle's frame [m]; `None` beyond the samples, farther than
    /// `reach`.
    pub fn at(&self, point: &Point3<f64>) -> Option<Smooth> {
        let local = (point - self.origin) / self.spacing;
        let mut first = [0; 3];
        let mut weights = [[[0.0; 4]; 3]; 3];
        for c in 0..3 {
            let cell = local[c].floor();
            if !(cell >= 1.0 && cell + 2.0 < self.count[c] as f64) {
                return None;
            }
            first[c] = cell as usize - 1;
            weights[c] = splines(local[c] - cell);
        }
        let (mut value, mut gradient, mut hessian) = (0.0, Vector3::zeros(), Matrix3::zeros());
        let [x, y, z] = &weights;
        for (j, k) in (0..16).map(|n| (n % 4, n / 4)) {
            let row = first[0] + self.count[0] * (first[1] + j + self.count[1] * (first[2] + k));
            let samples = &self.values[row..row + 4];
            let along = |order: usize| {
                x[order]
                    .iter()
                    .zip(samples)
                    .map(|(w, f)| w * f)
                    .sum::<f64>()
            };
            let [f, fx, fxx] = [along(0), along(1), along(2)];
            let [y, y1, y2] = [y[0][j], y[1][j], y[2][j]];
            let [z, z1, z2] = [z[0][k], z[1][k], z[2][k]];
            value += f * y * z;
            gradient += Vector3::new(fx * y * z, f * y1 * z, f * y * z1);
            hessian += Matrix3::new(
                fxx * y * z,
                0.0,
                0.0,
                fx * y1 * z,
                f * y2 * z,
                0.0,
                fx * y * z1,
                f * y1 * z1,
                f * y * z2,
            );
        }
        hessian.fill_upper_triangle_with_lower_triangle();
        let distance = value;
        Some(Smooth {
            distance,
            gradient: gradient / self.spacing,
            hessian: hessian / self.spacing.powi(2),
        })
    }
}

/// The four cubic B-splines at a position from 0 to 1 between the two middle samples, with two
/// derivatives.
fn splines(t: f64) -> [[f64; 4]; 3] {
    let s = 1.0 - t;
    let inner = |t: f64| (3.0 * t - 6.0) * t * t + 4.0;
    let value = [s * s * s, inner(t), inner(s), t * t * t].map(|w| w / 6.0);
    let slope = [
        -0.5 * s * s,
        (1.5 * t - 2.0) * t,
        (2.0 - 1.5 * s) * s,
        0.5 * t * t,
    ];
    [value, slope, [s, 3.0 * t - 2.0, 3.0 * s - 2.0, t]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::capsule::Capsule;
    use crate::testing::Draw;

    const RADIUS: f64 = 0.02;
    const SPACING: f64 = 0.0015;
    const REACH: f64 = 0.004;

    fn capsule() -> Capsule {
        Capsule {
            ends: [Point3::new(0.1, 0.2, -0.3), Point3::new(0.13, 0.22, -0.3)],
            radius: RADIUS,
        }
    }

    #[test]
    fn it_is_the_distance_but_for_what_curvature_makes() {
        let (capsule, mut draw) = (capsule(), Draw::new(17));
        let smooth = SmoothDistance::new(&capsule, SPACING, REACH);
        let (mut seen, mut worst) = (0, 0.0f64);
        // Twice the mean curvature of a ball, plus a half for the next order.
        let bound = 1.5 * SPACING * SPACING / 6.0 * 2.0 / (RADIUS - REACH);
        for _ in 0..500 {
            let end = capsule.ends[usize::from(draw.between(0.0, 1.0) > 0.5)];
            let p = end + draw.direction() * draw.between(RADIUS - REACH, RADIUS + REACH);
            let exact = capsule.closest(&p).expect("a surface");
            if exact.distance.abs() > REACH {
                continue;
            }
            seen += 1;
            let found = smooth.at(&p).expect("within reach");
            assert!(
                (found.distance - exact.distance).abs() <= bound,
                "{} {}",
                found.distance,
                exact.distance
            );
            worst = worst.max((found.distance - exact.distance).abs());
            // Where a ball becomes a cylinder, its curvature halves within a cell.
            let turned = (found.gradient - exact.normal).norm();
            assert!(turned <= SPACING / (4.0 * (RADIUS - REACH)), "{turned}");
            assert!(
                turned < 0.1 * (found.gradient - draw.direction()).norm(),
                "control"
            );
        }
        assert!(seen > 300, "{seen}");
        assert!(
            worst > 0.1 * bound,
            "control: samples twice as close, or none at all, would do as well: {worst} {bound}"
        );
        let coarse = SmoothDistance::new(&capsule, 4.0 * SPACING, REACH);
        let apex = capsule.ends[0] - Vector3::y() * RADIUS;
        assert!(
            coarse.at(&apex).expect("near").distance.abs() > bound,
            "control: coarse samples do not pass"
        );
        let far = capsule.ends[0] - Vector3::x() * (RADIUS + REACH + 5.0 * SPACING);
        assert!(smooth.at(&far).is_none());
    }

    #[test]
    fn derivatives_agree_with_differences_and_are_continuous() {
        let (capsule, mut draw) = (capsule(), Draw::new(18));
        let smooth = SmoothDistance::new(&capsule, SPACING, REACH);
        let h = 1e-3 * SPACING;
        let scale = 1.0 / RADIUS;
        let (mut seen, mut rejected) = (0, 0);
        for _ in 0..100 {
            let p = capsule.ends[0] + draw.direction() * draw.between(RADIUS, RADIUS + 0.5 * REACH);
            if capsule.closest(&p).expect("a surface").distance.abs() > REACH {
                continue;
            }
            let here = smooth.at(&p).expect("near");
            for c in 0..3 {
                let at = |sign: f64| {
                    let mut q = p;
                    q[c] += sign * h;
                    smooth.at(&q).expect("near")
                };
                let (up, down) = (at(1.0), at(-1.0));
                let slope = (up.distance - down.distance) / (2.0 * h);
                // Rounding of coordinates over the step, and third derivatives over the spacing.
                assert!(
                    (slope - here.gradient[c]).abs() <= 1e-8,
                    "{slope} {}",
                    here.gradient[c]
                );
                let turn = (up.gradient - down.gradient) / (2.0 * h);
                assert!(
                    (turn - here.hessian.column(c)).norm() <= 1e-3 * scale,
                    "{turn} {}",
                    here.hessian
                );
                seen += 1;
                rejected +=
                    usize::from(!((turn - here.hessian.column(c) * 1.1).norm() <= 1e-3 * scale));
            }
        }
        // Columns along the normal are nearly zero, as are a tenth of them.
        assert!(
            seen > 100 && rejected > seen / 2,
            "control: {rejected} of {seen} see a tenth"
        );
    }

    #[test]
    fn a_spacing_that_is_none_ends() {
        for spacing in [0.0, f64::NAN, 1e-300, -1.0] {
            let smooth = SmoothDistance::new(&capsule(), spacing, REACH);
            assert!(
                smooth.values.len() <= MOST_SAMPLES && smooth.spacing > 0.0,
                "{spacing}"
            );
            let found = smooth
                .at(&(capsule().ends[0] - Vector3::x() * RADIUS))
                .expect("near");
            assert!(found.distance.abs() <= SPACING, "{}", found.distance);
        }
    }
}
