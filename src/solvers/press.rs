//! Compliant obstacles: a band over their surface with a force that increases as the distance
//! decreases.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rayon::prelude::*;

use crate::constraints::Potential;
use crate::contact::smooth::{Smooth, SmoothDistance};
use crate::mesh::measures::max_or_nan;
use crate::mesh::sum::tree_sum_by;

/// A sample point of a surface that stays out of obstacles: the midpoint of two vertices, which can
/// be equal.
pub type Sample = [u32; 2];

/// The energy `k (h - d)^3 / (3 h)` of every surface sample nearer to an obstacle than `h`, where
/// `d` is its smoothed distance, negative inside. Its second derivative is continuous everywhere:
/// the minimisation needs no active set, and the minimum moves smoothly with the obstacles.
#[derive(Clone, Default)]
pub struct Press {
    /// Half of the stiffness at the surface, the derivative of the force with respect to the
    /// distance [N/m].
    pub stiffness: f64,
    /// Height of the band [m].
    pub thickness: f64,
    /// Samples of the surface.
    samples: Vec<Sample>,
    obstacles: Vec<Arc<SmoothDistance>>,
    /// Pairs of samples and the obstacles that they can touch.
    near: Vec<(u32, usize)>,
    poses: Vec<Isometry3<f64>>,
}

/// A sample in the band.
struct Touching {
    sample: Sample,
    /// Penetration into the band [m].
    short: f64,
    /// Derivatives of the distance.
    gradient: Vector3<f64>,
    hessian: Matrix3<f64>,
}

impl Press {
    /// Creates a band of a stiffness [N/m] and height [m] over obstacles, for samples of a surface.
    pub fn new(
        stiffness: f64,
        thickness: f64,
        samples: Vec<Sample>,
        obstacles: Vec<Arc<SmoothDistance>>,
    ) -> Self {
        let poses = vec![Isometry3::identity(); obstacles.len()];
        Self {
            stiffness,
            thickness,
            samples,
            obstacles,
            near: Vec::new(),
            poses,
        }
    }

    /// Sets the poses of the obstacles, and the samples of `x` [m] within `reach` [m] of them;
    /// others are ignored until the next call. Returns true if all samples now in a band were
    /// already included before.
    pub fn place(&mut self, poses: Vec<Isometry3<f64>>, x: &[Point3<f64>], reach: f64) -> bool {
        self.poses = poses;
        let count = self.obstacles.len();
        let all = (0..self.samples.len() * count)
            .into_par_iter()
            .with_min_len(256);
        let pair = |k: usize| ((k / count) as u32, k % count);
        let is_near = |k: usize| {
            self.distance(pair(k), x)
                .filter(|d| d.distance < reach)
                .map(|d| (pair(k), d.distance))
        };
        let found: Vec<((u32, usize), f64)> = all.filter_map(is_near).collect();
        let all_known = found
            .iter()
            .all(|(near, d)| *d >= self.thickness || self.near.binary_search(near).is_ok());
        self.near = found.into_iter().map(|(near, _)| near).collect();
        all_known
    }

    /// Distance of a sample from an obstacle, in the obstacle's frame.
    fn distance(&self, (s, o): (u32, usize), x: &[Point3<f64>]) -> Option<Smooth> {
        let [a, b] = self.samples[s as usize].map(|v| x[v as usize]);
        self.obstacles[o].at(&self.poses[o].inverse_transform_point(&nalgebra::center(&a, &b)))
    }

    fn touching(&self, x: &[Point3<f64>]) -> Vec<Touching> {
        let touching = |&near: &(u32, usize)| {
            let Smooth {
                distance,
                gradient,
                hessian,
            } = self.distance(near, x)?;
            let short = self.thickness - distance;
            if !(short > 0.0) {
                return None;
            }
            let turn = self.poses[near.1].rotation;
            let matrix = turn.to_rotation_matrix();
            let hessian = matrix * hessian * matrix.transpose();
            Some(Touching {
                sample: self.samples[near.0 as usize],
                short,
                gradient: turn * gradient,
                hessian,
            })
        };
        self.near
            .par_iter()
            .with_min_len(64)
            .filter_map(touching)
            .collect()
    }

    fn of(&self, touching: &[Touching]) -> f64 {
        self.stiffness / (3.0 * self.thickness)
            * tree_sum_by(touching.len(), |k| touching[k].short.powi(3))
    }

    /// Least height over an obstacle relative to the band; below 0 a sample is inside an obstacle.
    pub fn left(&self, x: &[Point3<f64>]) -> f64 {
        1.0 - max_or_nan(self.touching(x).iter().map(|t| t.short).chain([0.0])) / self.thickness
    }
}

impl Potential for Press {
    fn name(&self) -> &'static str {
        "contact"
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        self.of(&self.touching(x))
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let touching = self.touching(x);
        for Touching {
            sample,
            short,
            gradient: up,
            ..
        } in &touching
        {
            let force = up * (self.stiffness / self.thickness * short * short);
            sample
                .iter()
                .for_each(|v| gradient[*v as usize] -= force * 0.5);
        }
        self.of(&touching)
    }

    /// The two vertices of a sample are the ends of an edge, which a spring couples already.
    fn pairs(&self, _: &mut dyn FnMut(u32, u32)) {}

    /// With `convex`, without possibly indefinite parts.
    fn hessian(
        &self,
        x: &[Point3<f64>],
        convex: bool,
        add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
    ) {
        for Touching {
            sample: [a, b],
            short,
            gradient,
            hessian,
        } in self.touching(x)
        {
            let mut block = gradient * gradient.transpose() * (2.0 * short);
            if !convex {
                block -= hessian * (short * short);
            }
            // Each vertex of a sample contributes half of its motion.
            block *= 0.25 * self.stiffness / self.thickness;
            add(a, a, &block);
            add(b, b, &block);
            add(a, b, &block);
            add(b, a, &block);
        }
    }

    /// Zero: the matrix does not depend on the samples in the band.
    fn scalar_hessian(&self, _: &[Point3<f64>], _: &mut dyn FnMut(u32, u32, f64)) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::capsule::Capsule;
    use crate::testing::Draw;

    /// Points of which some are inside, some in the band, some beyond; samples are the points and
    /// some midpoints.
    fn drawn() -> (Press, Vec<Point3<f64>>) {
        let mut draw = Draw::new(9);
        let capsule = Capsule {
            ends: [Point3::origin(), Point3::new(0.3, 0.0, 0.0)],
            radius: 0.1,
        };
        let pose = Isometry3::new(Vector3::new(0.1, -0.2, 0.05), Vector3::new(0.3, 1.0, -0.5));
        let x: Vec<Point3<f64>> = (0..40)
            .map(|_| pose * Point3::from(draw.direction() * draw.between(0.05, 0.16)))
            .collect();
        let samples = (0..40)
            .map(|v| [v, v])
            .chain((0..5).map(|v| [v, 39 - v]))
            .collect();
        let smooth = Arc::new(SmoothDistance::new(&capsule, 0.01, 0.1));
        let mut press = Press::new(50.0, 0.03, samples, vec![smooth]);
        press.place(vec![pose], &x, 0.08);
        (press, x)
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let (press, x) = drawn();
        let gradient = |x: &[Point3<f64>]| {
            let mut gradient = vec![Vector3::zeros(); x.len()];
            press.energy_and_gradient(x, &mut gradient);
            gradient
        };
        let (here, energy) = (gradient(&x), press.energy(&x));
        let mut blocks = std::collections::BTreeMap::new();
        press.hessian(&x, false, &mut |a, b, block| {
            *blocks.entry((a, b)).or_insert_with(Matrix3::zeros) += block
        });
        let h = 1e-6;
        for v in 0..x.len() {
            for c in 0..3 {
                let moved = |sign: f64| {
                    let mut x = x.clone();
                    x[v][c] += sign * h;
                    x
                };
                let (up, down) = (moved(1.0), moved(-1.0));
                let slope = (press.energy(&up) - press.energy(&down)) / (2.0 * h);
                // Rounding of the energy over the step, and third derivatives.
                let limit = 1e-15 * energy / h + 1e-4 * press.stiffness * h;
                assert!(
                    (slope - here[v][c]).abs() <= limit,
                    "{slope} {}",
                    here[v][c]
                );
                let (up, down) = (gradient(&up), gradient(&down));
                for w in 0..x.len() {
                    let change = (up[w] - down[w]) / (2.0 * h);
                    let wanted = blocks
                        .get(&(w as u32, v as u32))
                        .map_or_else(Vector3::zeros, |b| b.column(c).into());
                    assert!(
                        (change - wanted).norm() <= 1e-3 * press.stiffness,
                        "{change} {wanted}"
                    );
                }
            }
        }
        let touched = here.iter().filter(|g| g.norm() > 0.0).count();
        assert!(
            touched > 5 && touched < x.len(),
            "control: {touched} are in the band"
        );
        let steep = crate::mesh::measures::max_or_nan(blocks.values().map(Matrix3::norm));
        assert!(steep > 0.1 * press.stiffness, "control: {steep}");
    }

    #[test]
    fn what_is_left_of_the_band_and_what_was_not_looked_at() {
        let (mut press, x) = drawn();
        assert!(press.left(&x) < 0.0, "some are inside");
        let poses = press.poses.clone();
        assert!(press.place(poses.clone(), &x, 0.08), "all were looked at");
        press.near.clear();
        assert!((press.left(&x) - 1.0).abs() <= f64::EPSILON);
        assert!(!press.place(poses, &x, 0.08), "none was looked at");
    }
}
