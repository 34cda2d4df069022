//! Volume enclosed by a closed surface: C = V(x) - k V0, projected exactly.

use nalgebra::{Point3, Vector3};

use super::Residual;
use crate::particles::Particles;

/// Keeps the volume enclosed by a closed, consistently oriented surface at `target` [m^3].
///
/// V = (1/6) sum p_i.(p_j x p_k) about the first vertex, g_i = (1/6) sum p_j x p_k over the triangles of i in cyclic
/// order (errata A06, A07). Along any field of displacements the volume is a cubic in the multiplier, which is solved
/// to round-off. With a bulk modulus K [Pa] the compliance is V0/K [m^6/J]; zero keeps the volume exactly.
#[derive(Clone, Debug)]
pub struct EnclosedVolume {
    triangles: Vec<[u32; 3]>,
    /// The other two corners of each triangle of each vertex, in cyclic order; `start[i]..start[i + 1]` for vertex i.
    pairs: Vec<[u32; 2]>,
    start: Vec<u32>,
    target: f64,
    compliance: f64,
    relaxation: f64,
    multiplier: f64,
    gradient: Vec<Vector3<f64>>,
    field: Vec<Vector3<f64>>,
    calls: u64,
    unsolved: u64,
}

/// The volume could not be brought to its target along the given field.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("no displacement along the allowed directions gives the volume {target} m3 (now {volume} m3)")]
pub struct Unsolvable {
    /// Volume before [m^3].
    pub volume: f64,
    /// Volume wanted [m^3].
    pub target: f64,
}

impl EnclosedVolume {
    /// The volume enclosed by `triangles` over `count` vertices, to be kept at `target` [m^3] with `compliance`
    /// [m^6/J].
    pub fn new(triangles: &[[u32; 3]], count: usize, target: f64, compliance: f64) -> Self {
        let mut start = vec![0u32; count + 1];
        for t in triangles {
            t.iter().for_each(|&v| start[v as usize + 1] += 1);
        }
        for i in 0..count {
            start[i + 1] += start[i];
        }
        let mut next = start.clone();
        let mut pairs = vec![[0; 2]; triangles.len() * 3];
        for &[a, b, c] in triangles {
            for (i, j, k) in [(a, b, c), (b, c, a), (c, a, b)] {
                pairs[next[i as usize] as usize] = [j, k];
                next[i as usize] += 1;
            }
        }
        Self {
            triangles: triangles.to_vec(),
            pairs,
            start,
            target,
            compliance,
            relaxation: 1.0,
            multiplier: 0.0,
            gradient: vec![Vector3::zeros(); count],
            field: vec![Vector3::zeros(); count],
            calls: 0,
            unsolved: 0,
        }
    }

    /// Classic stiffness 0..1: each projection goes only this share of the way.
    #[must_use]
    pub fn with_relaxation(mut self, factor: f64) -> Self {
        self.relaxation = factor;
        self
    }

    /// The volume that is kept [m^3].
    pub fn target(&self) -> f64 {
        self.target
    }

    /// The triangles that enclose it.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Its compliance [m^6/J].
    pub fn compliance(&self) -> f64 {
        self.compliance
    }

    /// Moves `x` along `field` until the volume is at its target exactly; returns the multiple of `field`.
    ///
    /// # Errors
    /// No multiple near zero does it; nothing is moved.
    pub fn retract(&self, x: &mut [Point3<f64>], field: &[Vector3<f64>]) -> Result<f64, Unsolvable> {
        let (excess, gradient) = self.value_and_gradient(x);
        let found = self.solve_along(x, &gradient, field, -excess, 0.0);
        let multiple = found.ok_or(Unsolvable { volume: excess + self.target, target: self.target })?;
        x.iter_mut().zip(field).for_each(|(x, d)| *x += d * multiple);
        Ok(multiple)
    }

    /// C(x), in any number.
    pub fn value<S: super::Scalar>(&self, x: &[Point3<S>]) -> S {
        let mut six = S::zero();
        if let Some(&origin) = x.first() {
            for &[a, b, c] in &self.triangles {
                let [a, b, c] = [a, b, c].map(|i| x[i as usize] - origin);
                six += a.dot(&b.cross(&c));
            }
        }
        six / S::of(6.0) - S::of(self.target)
    }

    /// C(x) and dC/dx_i of every vertex; defined everywhere.
    pub fn value_and_gradient(&self, x: &[Point3<f64>]) -> (f64, Vec<Vector3<f64>>) {
        let mut gradient = vec![Vector3::zeros(); x.len()];
        let volume = self.volume_and_gradient(x, &mut gradient);
        (volume - self.target, gradient)
    }

    /// g_i = (1/6) sum p_j x p_k and V = (1/3) sum p_i.g_i, as V is homogeneous of degree 3.
    fn volume_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let Some(&origin) = x.first() else { return 0.0 };
        let gather = |i: usize| {
            let ring = &self.pairs[self.start[i] as usize..self.start[i + 1] as usize];
            let at = x[i];
            // Of p_j x p_k only the part relative to p_i changes with the triangle; on a closed surface the rest
            // cancels, so differences to p_i are exact where coordinates are large.
            ring.iter().fold(Vector3::zeros(), |sum, &[j, k]| sum + (x[j as usize] - at).cross(&(x[k as usize] - at)))
        };
        gradient.iter_mut().enumerate().for_each(|(i, g)| *g = gather(i) / 6.0);
        crate::mesh::sum::tree_sum_by(x.len(), |i| (x[i] - origin).dot(&gradient[i])) / 3.0
    }

    /// Forgets the multiplier: a new step begins.
    pub fn begin_step(&mut self) {
        self.multiplier = 0.0;
    }

    /// Brings the volume to its target along inverse mass times gradient.
    ///
    /// # Errors
    /// No such displacement exists; nothing is moved.
    pub fn project(&mut self, particles: &mut Particles, dt: f64) -> Result<(), Unsolvable> {
        self.project_along(particles, dt, |_, _| ())
    }

    /// As [`Self::project`], after `restrict(field, sign)` has taken forbidden directions out of the field of
    /// displacements; particles will move by a positive multiple of `sign * field`.
    ///
    /// # Errors
    /// No such displacement exists; nothing is moved.
    pub fn project_along(
        &mut self,
        particles: &mut Particles,
        dt: f64,
        restrict: impl FnOnce(&mut [Vector3<f64>], f64),
    ) -> Result<(), Unsolvable> {
        self.calls += 1;
        if dt == 0.0 {
            return Ok(());
        }
        let mut gradient = std::mem::take(&mut self.gradient);
        let mut field = std::mem::take(&mut self.field);
        let volume = self.volume_and_gradient(&particles.position, &mut gradient);
        for ((d, g), w) in field.iter_mut().zip(&gradient).zip(&particles.inverse_mass) {
            *d = g * *w;
        }
        let compliance = self.compliance / (dt * dt);
        let wanted = -(volume - self.target) - compliance * self.multiplier;
        restrict(&mut field, wanted.signum());
        let found = self.solve_along(&particles.position, &gradient, &field, wanted, compliance);
        if let Some(change) = found {
            let change = change * self.relaxation;
            self.multiplier += change;
            particles.position.iter_mut().zip(&field).for_each(|(x, d)| *x += d * change);
        } else {
            self.unsolved += 1;
        }
        self.gradient = gradient;
        self.field = field;
        found.map(|_| ()).ok_or(Unsolvable { volume, target: self.target })
    }

    /// The root nearest to zero of V(x + s d) - V(x) + compliance s = wanted, a cubic in s, by Newton's iteration.
    fn solve_along(
        &self,
        x: &[Point3<f64>],
        gradient: &[Vector3<f64>],
        field: &[Vector3<f64>],
        wanted: f64,
        compliance: f64,
    ) -> Option<f64> {
        use crate::mesh::sum::tree_sum_by;
        let n = x.len();
        let linear = tree_sum_by(n, |i| gradient[i].dot(&field[i])) + compliance;
        if wanted == 0.0 {
            return Some(0.0);
        }
        // A surface without extent, or all of it held: no direction changes the volume.
        if !(linear > 0.0) {
            return None;
        }
        // V is a symmetric trilinear form: V(x + s d) has T(x,d,d) before s^2 and T(d,d,d) before s^3.
        let origin = x[0];
        let corners = |t: usize| self.triangles[t].map(|v| field[v as usize]);
        let count = self.triangles.len();
        let cubic = tree_sum_by(count, |t| {
            let [a, b, c] = corners(t);
            a.dot(&b.cross(&c))
        }) / 6.0;
        let square = tree_sum_by(count, |t| {
            let [a, b, c] = corners(t);
            let [p, q, r] = self.triangles[t].map(|v| x[v as usize] - origin);
            p.dot(&b.cross(&c)) + q.dot(&c.cross(&a)) + r.dot(&a.cross(&b))
        }) / 6.0;
        let mut s = wanted / linear;
        for _ in 0..32 {
            let f = ((cubic * s + square) * s + linear) * s - wanted;
            let slope = (3.0 * cubic * s + 2.0 * square) * s + linear;
            if !(slope > 0.0) {
                return None;
            }
            let step = f / slope;
            s -= step;
            if step.abs() <= 4.0 * f64::EPSILON * s.abs() {
                break;
            }
        }
        s.is_finite().then_some(s)
    }

    /// Distance from satisfaction: |C + alpha lambda| / |grad C| [m].
    pub fn residual(&self, particles: &Particles, dt: f64) -> Residual {
        let (c, gradient) = self.value_and_gradient(&particles.position);
        let steepness = gradient.iter().map(Vector3::norm_squared).sum::<f64>().sqrt();
        let r = (c + self.compliance / (dt * dt) * self.multiplier).abs() / steepness;
        Residual { rms: r, max: r, count: 1 }
    }

    /// Projections so far.
    pub fn calls(&self) -> u64 {
        self.calls
    }

    /// Projections without a solution so far.
    pub fn unsolved(&self) -> u64 {
        self.unsolved
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.triangles.capacity() * 12
            + self.pairs.capacity() * 8
            + self.start.capacity() * 4
            + (self.gradient.capacity() + self.field.capacity()) * 24
    }
}
