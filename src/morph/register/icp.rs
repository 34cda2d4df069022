//! Iterated closest points in six stages \[rusinkiewicz2001\]: select, match, weigh, reject,
//! measure, minimise.

use crate::mesh::measures::max_or_nan;
use nalgebra::{Point3, Similarity3, Vector3};

use super::fit::{FitMotion, fit};
use super::{RegisterError, RegistrationSurface};

/// Selection of vertices of the moving surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Select {
    /// All vertices.
    All,
    /// Vertices at an equal index step, about this number of them.
    About(usize),
}

/// Weights of pairs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PairWeight {
    /// Equal weights.
    #[default]
    Even,
    /// 1 - d/d_max: near pairs have greater weights.
    Near,
}

/// Rejection of pairs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reject {
    /// No rejection.
    None,
    /// Pairs farther apart than this \[m\].
    Beyond(f64),
    /// This share of the pairs, those with the greatest distances.
    Worst(f64),
    /// Pairs farther apart than this multiple of the median, with opposite normals, or with a
    /// partner on an open edge.
    Median(f64),
}

/// The minimised measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Measure {
    /// Distances between the points of pairs.
    Points,
    /// Distances from the tangent planes of the partners: much faster convergence where surfaces
    /// slide along each other.
    #[default]
    Planes,
}

/// Settings of the six stages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Icp {
    /// Whether size may change.
    pub motion: FitMotion,
    /// Stage 1.
    pub select: Select,
    /// Stage 3; stage 2 is the closest point of the surface.
    pub weigh: PairWeight,
    /// Stage 4.
    pub reject: Reject,
    /// Stage 5.
    pub measure: Measure,
    /// Greatest number of rounds.
    pub rounds: usize,
    /// Greatest displacement of a vertex in a round, relative to the size of the surface, at which
    /// the iteration converges. The iteration also ends if the distances stop decreasing.
    pub threshold: f64,
}

impl Default for Icp {
    fn default() -> Self {
        Self {
            motion: FitMotion::Rigid,
            select: Select::All,
            weigh: PairWeight::Even,
            reject: Reject::Median(3.0),
            measure: Measure::Planes,
            rounds: 100,
            threshold: 1e-9,
        }
    }
}

/// Result of the iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registered {
    /// Motion of the moving surface to the fixed one.
    pub motion: Similarity3<f64>,
    /// Number of rounds.
    pub rounds: usize,
    /// True if the iteration ended by its threshold.
    pub converged: bool,
    /// Root mean square distance of the accepted pairs \[m\].
    pub distance: f64,
    /// Number of accepted pairs.
    pub pairs: usize,
}

/// A vertex and its match.
struct Pair {
    from: Point3<f64>,
    to: Point3<f64>,
    normal: Vector3<f64>,
    distance: f64,
}

/// A smaller relative decrease of the distance counts as none.
const BETTER: f64 = 1e-6;
/// The iteration ends after this number of rounds without a decrease, if displacements are small
/// relative to the size.
const PATIENCE: usize = 25;
const SMALL: f64 = 1e-3;

impl Icp {
    /// Registers `moving` to `fixed`, from the motion `start`.
    ///
    /// # Errors
    /// Too few pairs remain, or they determine no motion.
    pub fn run(
        &self,
        moving: &RegistrationSurface<'_>,
        fixed: &RegistrationSurface<'_>,
        start: &Similarity3<f64>,
    ) -> Result<Registered, RegisterError> {
        let chosen: Vec<u32> = match self.select {
            Select::All => (0..moving.points().len() as u32).collect(),
            Select::About(count) => {
                let step = (moving.points().len() / count.max(1)).max(1);
                (0..moving.points().len() as u32).step_by(step).collect()
            }
        };
        let mut motion = *start;
        let mut last = Registered {
            motion,
            rounds: 0,
            converged: false,
            distance: 0.0,
            pairs: 0,
        };
        let (mut least, mut since) = (f64::INFINITY, 0);
        for round in 1..=self.rounds {
            let mut pairs = self.matched(moving, fixed, &chosen, &motion);
            self.drop_bad(&mut pairs);
            if pairs.len() < 6 {
                return Err(RegisterError::Pairs {
                    pairs: pairs.len(),
                    of: chosen.len(),
                    round,
                });
            }
            let squares: f64 = pairs.iter().map(|p| p.distance * p.distance).sum();
            let step = self.step(&pairs).ok_or(RegisterError::Undetermined {
                pairs: pairs.len(),
                round,
            })?;
            let moved = max_or_nan(pairs.iter().map(|p| (step * p.from - p.from).norm()));
            motion = step * motion;
            last = Registered {
                motion,
                rounds: round,
                converged: moved <= self.threshold * fixed.size(),
                distance: (squares / pairs.len() as f64).sqrt(),
                pairs: pairs.len(),
            };
            // Where shapes differ, the accepted pairs can alternate without end.
            since = if last.distance < least * (1.0 - BETTER) {
                0
            } else {
                since + 1
            };
            least = least.min(last.distance);
            last.converged |= since >= PATIENCE && moved <= SMALL * fixed.size();
            if last.converged {
                break;
            }
        }
        Ok(last)
    }

    fn matched(
        &self,
        moving: &RegistrationSurface<'_>,
        fixed: &RegistrationSurface<'_>,
        chosen: &[u32],
        motion: &Similarity3<f64>,
    ) -> Vec<Pair> {
        let strict = matches!(self.reject, Reject::Median(_));
        let pair = |&v: &u32| {
            let from = motion * moving.points()[v as usize];
            let near = fixed.tree().closest(&from, f64::INFINITY)?;
            let normal = fixed.normal(near.triangle);
            if strict {
                let own = motion.isometry.rotation * moving.normals()[v as usize];
                if own.dot(&normal) < 0.5 || fixed.is_on_rim(near.triangle, &near.point) {
                    return None;
                }
            }
            let (to, normal) = fixed.curved(&near);
            Some(Pair {
                from,
                to,
                normal,
                distance: (to - from).norm(),
            })
        };
        chosen.iter().filter_map(pair).collect()
    }

    fn drop_bad(&self, pairs: &mut Vec<Pair>) {
        let limit = match self.reject {
            Reject::None => return,
            Reject::Beyond(limit) => limit,
            Reject::Worst(share) => {
                let mut all: Vec<f64> = pairs.iter().map(|p| p.distance).collect();
                all.sort_by(f64::total_cmp);
                let kept = ((1.0 - share.clamp(0.0, 1.0)) * all.len() as f64).ceil() as usize;
                all.get(kept.saturating_sub(1)).copied().unwrap_or(0.0)
            }
            Reject::Median(times) => {
                let median =
                    crate::mesh::measures::median(pairs.iter().map(|p| p.distance).collect());
                times * median.unwrap_or(0.0)
            }
        };
        pairs.retain(|p| p.distance <= limit);
    }

    /// The motion that minimises the measure.
    fn step(&self, pairs: &[Pair]) -> Option<Similarity3<f64>> {
        let most = max_or_nan(pairs.iter().map(|p| p.distance));
        let weight = |p: &Pair| match self.weigh {
            PairWeight::Near if most > 0.0 => 1.0 - p.distance / most,
            _ => 1.0,
        };
        let weights: Vec<f64> = pairs.iter().map(weight).collect();
        if self.measure == Measure::Planes
            && let Some(step) = self.step_by_planes(pairs, &weights)
        {
            return Some(step);
        }
        let from: Vec<_> = pairs.iter().map(|p| p.from).collect();
        let to: Vec<_> = pairs.iter().map(|p| p.to).collect();
        fit(&from, &to, &weights, self.motion)
    }

    /// A Gauss-Newton step on distances from planes: rotation, translation and logarithm of the
    /// scale about the centre of the pairs. `None` where surfaces slide without a change of
    /// distance.
    fn step_by_planes(&self, pairs: &[Pair], weights: &[f64]) -> Option<Similarity3<f64>> {
        let total: f64 = weights.iter().sum();
        let middle = pairs
            .iter()
            .zip(weights)
            .map(|(p, w)| p.from.coords * *w)
            .sum::<Vector3<f64>>()
            / total;
        let size = (pairs
            .iter()
            .map(|p| (p.from.coords - middle).norm_squared())
            .sum::<f64>()
            / pairs.len() as f64)
            .sqrt();
        let mut matrix = nalgebra::SMatrix::<f64, 7, 7>::zeros();
        let mut rhs = nalgebra::SVector::<f64, 7>::zeros();
        for (p, w) in pairs.iter().zip(weights) {
            // In units of the size, so that all seven unknowns have similar magnitudes.
            let (arm, n) = ((p.from.coords - middle) / size, p.normal);
            let turn = arm.cross(&n);
            let swell = if self.motion == FitMotion::Similarity {
                arm.dot(&n)
            } else {
                0.0
            };
            let row = nalgebra::SVector::<f64, 7>::from_column_slice(&[
                turn.x, turn.y, turn.z, n.x, n.y, n.z, swell,
            ]);
            matrix += row * row.transpose() * *w;
            rhs -= row * ((p.from - p.to).dot(&n) / size * w);
        }
        if self.motion == FitMotion::Rigid {
            matrix[(6, 6)] = total;
        }
        let eigen = matrix.symmetric_eigen();
        let (least, greatest) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
        if !(least > 1e-9 * greatest) {
            return None;
        }
        let x = eigen.eigenvectors
            * (eigen.eigenvectors.transpose() * rhs).component_div(&eigen.eigenvalues);
        let (turn, shift) = (
            Vector3::new(x[0], x[1], x[2]),
            Vector3::new(x[3], x[4], x[5]) * size,
        );
        // A step of more than half a radian or half the size is outside the range of the linear
        // model.
        let share = 1.0f64.min(0.5 / turn.norm().max(x[6].abs()).max(1e-300));
        let rotation = nalgebra::UnitQuaternion::from_scaled_axis(turn * share);
        let scale = (x[6] * share).exp();
        let shift = middle + shift * share - rotation * middle * scale;
        let moved = nalgebra::Isometry3::from_parts(nalgebra::Translation3::from(shift), rotation);
        Some(Similarity3::from_isometry(moved, scale))
    }
}
