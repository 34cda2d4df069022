//! Forces that preserve the volume of a closed surface: by its gradient, and by the centre springs
//! of the thesis.

use nalgebra::{Point3, Vector3};

use super::force::Force;
use crate::constraints::enclosed_volume::EnclosedVolume;
use crate::mesh::measures::triangle_areas;
use crate::mesh::sum::tree_sum_by;

/// Error of a volume force.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum VolumeError {
    /// The surface encloses no volume.
    #[error("the surface encloses {0} m3; it has to be closed and turned outward")]
    NoVolume(f64),
    /// The numbers of weights and points differ.
    #[error("{weights} weights for {points} points")]
    Weights {
        /// Number of weights.
        weights: usize,
        /// Number of points.
        points: usize,
    },
    /// A parameter is not finite or has the wrong sign.
    #[error("{what} is {value}")]
    Parameter {
        /// Name of the parameter.
        what: &'static str,
        /// Value of the parameter.
        value: f64,
    },
    /// A triangle refers to a point that does not exist.
    #[error("triangle {triangle} names point {point}, but there are {count} points")]
    OutOfRange {
        /// Index of the triangle.
        triangle: usize,
        /// Index of the point.
        point: u32,
        /// Number of points.
        count: usize,
    },
}

fn check_triangles(triangles: &[[u32; 3]], count: usize) -> Result<(), VolumeError> {
    for (triangle, corners) in triangles.iter().enumerate() {
        if let Some(&point) = corners.iter().find(|&&p| p as usize >= count) {
            return Err(VolumeError::OutOfRange {
                triangle,
                point,
                count,
            });
        }
    }
    Ok(())
}

/// `f_i = -w_i K (V - V0)/V0 grad_i V`, K a bulk modulus [Pa] (errata B04).
///
/// The modulus is a material constant, independent of the mesh. There is no net force or torque if
/// all weights are equal. The weights w, 0 to 1, scale the force on each point \[jung2006\]. For
/// unequal weights the force has no energy and does not conserve momentum; [`Force::energy`] is
/// then that of weights of 1.
#[derive(Clone, Debug)]
pub struct TrueVolume {
    surface: EnclosedVolume,
    bulk: f64,
    rest: f64,
    weight: Vec<f64>,
    highest: Option<u32>,
}

impl TrueVolume {
    /// Keeps the volume enclosed by `triangles` over points at rest at `x` at its present value, or
    /// at `rest` [m3] if given. `weight` contains one number per point, or is empty for 1
    /// everywhere.
    ///
    /// # Errors
    /// A surface without volume, another number of weights, weights outside 0 to 1, or a modulus
    /// that is not positive.
    pub fn new(
        x: &[Point3<f64>],
        triangles: &[[u32; 3]],
        bulk: f64,
        rest: Option<f64>,
        weight: &[f64],
    ) -> Result<Self, VolumeError> {
        check_triangles(triangles, x.len())?;
        let mut surface = EnclosedVolume::new(triangles, x.len(), 0.0, 0.0);
        let volume = surface.value(x);
        let rest = rest.unwrap_or(volume);
        if !(rest > 0.0 && rest.is_finite()) {
            return Err(VolumeError::NoVolume(rest));
        }
        surface = EnclosedVolume::new(triangles, x.len(), rest, 0.0);
        if !(weight.is_empty() || weight.len() == x.len()) {
            return Err(VolumeError::Weights {
                weights: weight.len(),
                points: x.len(),
            });
        }
        if let Some(&value) = weight.iter().find(|w| !(0.0..=1.0).contains(*w)) {
            return Err(VolumeError::Parameter {
                what: "a weight",
                value,
            });
        }
        if !(bulk > 0.0 && bulk.is_finite()) {
            return Err(VolumeError::Parameter {
                what: "the bulk modulus [Pa]",
                value: bulk,
            });
        }
        let weight = if weight.is_empty() {
            vec![1.0; x.len()]
        } else {
            weight.to_vec()
        };
        let highest = triangles.iter().flatten().copied().max();
        Ok(Self {
            surface,
            bulk,
            rest,
            weight,
            highest,
        })
    }

    /// The target volume [m3].
    pub fn rest(&self) -> f64 {
        self.rest
    }

    /// The volume at positions `x` [m3].
    pub fn volume(&self, x: &[Point3<f64>]) -> f64 {
        self.surface.value(x) + self.rest
    }

    /// Excess pressure inside [Pa].
    pub fn pressure(&self, x: &[Point3<f64>]) -> f64 {
        -self.bulk * self.surface.value(x) / self.rest
    }
}

impl Force for TrueVolume {
    fn name(&self) -> &'static str {
        "volume"
    }

    fn elements(&self) -> usize {
        self.surface.triangles().len()
    }

    fn highest_point(&self) -> Option<u32> {
        self.highest
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let change = self.surface.value(x);
        0.5 * self.bulk * change * change / self.rest
    }

    fn add_force(&self, x: &[Point3<f64>], force: &mut [Vector3<f64>]) {
        let (change, gradient) = self.surface.value_and_gradient(x);
        let pressure = -self.bulk * change / self.rest;
        for ((f, g), w) in force.iter_mut().zip(&gradient).zip(&self.weight) {
            *f += g * (pressure * w);
        }
    }

    fn add_product(
        &self,
        x: &[Point3<f64>],
        p: &[Vector3<f64>],
        definite: bool,
        product: &mut [Vector3<f64>],
    ) {
        let (change, gradient) = self.surface.value_and_gradient(x);
        let pressure = -self.bulk * change / self.rest;
        // For unequal weights, K is replaced by its symmetric form with the geometric mean of the
        // weights.
        let root = |i: usize| self.weight[i].sqrt();
        let along = tree_sum_by(gradient.len(), |i| gradient[i].dot(&p[i]) * root(i));
        for (i, g) in gradient.iter().enumerate() {
            product[i] += g * (self.bulk / self.rest * along * root(i));
        }
        if definite {
            return;
        }
        // The volume is cubic: the change of its gradient is that of the products in the ring.
        for &[a, b, c] in self.surface.triangles() {
            for [i, j, k] in [[a, b, c], [b, c, a], [c, a, b]].map(|t| t.map(|v| v as usize)) {
                let (to_j, to_k) = (x[j] - x[i], x[k] - x[i]);
                let change = (p[j] - p[i]).cross(&to_k) + to_j.cross(&(p[k] - p[i]));
                product[i] -= change * (pressure / 6.0 * self.weight[i]);
            }
        }
    }

    fn add_row_sums(&self, x: &[Point3<f64>], sums: &mut [f64]) {
        let (change, gradient) = self.surface.value_and_gradient(x);
        let pressure = (self.bulk * change / self.rest).abs();
        let all = tree_sum_by(gradient.len(), |i| gradient[i].norm());
        sums.iter_mut()
            .zip(&gradient)
            .for_each(|(s, g)| *s += self.bulk / self.rest * g.norm() * all);
        for &[a, b, c] in self.surface.triangles() {
            for [i, j, k] in [[a, b, c], [b, c, a], [c, a, b]].map(|t| t.map(|v| v as usize)) {
                let around = (x[j] - x[i]).norm() + (x[k] - x[i]).norm();
                // Each term twice: for the neighbour's displacement and for the point's own.
                sums[i] += pressure * around / 3.0;
            }
        }
    }
}

/// The thesis's springs from every point to the centre of mass: `f_i = -c_i k (D + C d_i) u_i`,
/// `D = sum c_i d_i/3`. Here `d_i` is the change of the distance to the centre, `u_i` its
/// direction, and `c_i` the area of the point's triangles over the mean area.
///
/// This force exists for comparison with [`TrueVolume`] (errata B04). It grows with the number of
/// triangles, so k must be tuned for each mesh. It pushes bodies without symmetry, and treats a
/// change of shape at constant volume as a change of volume. All points have equal weight in the
/// centre. The energy is that of a fixed centre.
#[derive(Clone, Debug)]
pub struct CentreSprings {
    points: Vec<u32>,
    share: Vec<f64>,
    rest: Vec<f64>,
    stiffness: f64,
    keep: f64,
}

impl CentreSprings {
    /// Creates springs of a closed surface at rest at `x`; `stiffness` is k [N/m], `keep` is C from
    /// 0 to 1.
    ///
    /// # Errors
    /// A triangle with points that do not exist, a surface without area, or parameters out of
    /// range.
    pub fn new(
        x: &[Point3<f64>],
        triangles: &[[u32; 3]],
        stiffness: f64,
        keep: f64,
    ) -> Result<Self, VolumeError> {
        check_triangles(triangles, x.len())?;
        if !(stiffness >= 0.0 && stiffness.is_finite()) {
            return Err(VolumeError::Parameter {
                what: "the stiffness [N/m]",
                value: stiffness,
            });
        }
        if !(0.0..=1.0).contains(&keep) {
            return Err(VolumeError::Parameter {
                what: "the weight of each length",
                value: keep,
            });
        }
        let areas = triangle_areas(x, triangles);
        let mean = areas.iter().sum::<f64>() / areas.len() as f64;
        if !(mean > 0.0) {
            return Err(VolumeError::NoVolume(0.0));
        }
        let mut all = vec![0.0; x.len()];
        for (corners, area) in triangles.iter().zip(&areas) {
            corners.iter().for_each(|&v| all[v as usize] += area / mean);
        }
        let mut points: Vec<u32> = triangles.iter().flatten().copied().collect();
        points.sort_unstable();
        points.dedup();
        let share = points.iter().map(|&p| all[p as usize]).collect();
        let mut springs = Self {
            points,
            share,
            rest: Vec::new(),
            stiffness,
            keep,
        };
        springs.rest = springs.spokes(x).iter().map(Vector3::norm).collect();
        Ok(springs)
    }

    /// Vector from the centre to each point.
    fn spokes(&self, x: &[Point3<f64>]) -> Vec<Vector3<f64>> {
        let count = self.points.len();
        let mean = |k: usize| tree_sum_by(count, |i| x[self.points[i] as usize][k]) / count as f64;
        let centre = Point3::new(mean(0), mean(1), mean(2));
        self.points
            .iter()
            .map(|&p| x[p as usize] - centre)
            .collect()
    }

    /// D, the measure of the change of volume over the mean area [m], and d of each point [m].
    pub fn change(&self, x: &[Point3<f64>]) -> (f64, Vec<f64>) {
        let spokes = self.spokes(x);
        let d: Vec<f64> = spokes
            .iter()
            .zip(&self.rest)
            .map(|(s, rest)| s.norm() - rest)
            .collect();
        (tree_sum_by(d.len(), |i| self.share[i] * d[i]) / 3.0, d)
    }
}

impl Force for CentreSprings {
    fn name(&self) -> &'static str {
        "centre springs"
    }

    fn elements(&self) -> usize {
        self.points.len()
    }

    fn highest_point(&self) -> Option<u32> {
        self.points.last().copied()
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let (all, d) = self.change(x);
        let own = tree_sum_by(d.len(), |i| self.share[i] * d[i] * d[i]);
        0.5 * self.stiffness * (3.0 * all * all + self.keep * own)
    }

    fn add_force(&self, x: &[Point3<f64>], force: &mut [Vector3<f64>]) {
        let (all, d) = self.change(x);
        for (i, spoke) in self.spokes(x).iter().enumerate() {
            let Some(u) = spoke.try_normalize(0.0) else {
                continue;
            };
            force[self.points[i] as usize] -=
                u * (self.share[i] * self.stiffness * (all + self.keep * d[i]));
        }
    }

    fn add_product(
        &self,
        x: &[Point3<f64>],
        p: &[Vector3<f64>],
        _: bool,
        product: &mut [Vector3<f64>],
    ) {
        // The part along the spokes, which is symmetric and definite; their rotation is of second
        // order at rest.
        let spokes: Vec<Vector3<f64>> = self
            .spokes(x)
            .iter()
            .map(|s| s.try_normalize(0.0).unwrap_or_default())
            .collect();
        let along = |i: usize| spokes[i].dot(&p[self.points[i] as usize]);
        let all = tree_sum_by(spokes.len(), |i| self.share[i] * along(i)) / 3.0;
        for (i, u) in spokes.iter().enumerate() {
            let own = all + self.keep * along(i);
            product[self.points[i] as usize] += u * (self.share[i] * self.stiffness * own);
        }
    }

    fn add_row_sums(&self, _: &[Point3<f64>], sums: &mut [f64]) {
        let all = tree_sum_by(self.share.len(), |i| self.share[i]) / 3.0;
        for (share, &point) in self.share.iter().zip(&self.points) {
            sums[point as usize] += share * self.stiffness * (all + self.keep);
        }
    }
}
