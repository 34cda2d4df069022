//! Volume enclosed by a closed surface: C = V(x) - k V0, projected exactly.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::rings::{Rings, Terms};
use super::{Residual, SimdWidth};
use crate::particles::{Packed, Particles, SHARE, Slot, is_shared};
use crate::state::{DecodeError, Reader, State, Writer};

/// Keeps the volume enclosed by a closed, consistently oriented surface at `target` [m^3].
///
/// V = (1/6) sum p_i.(p_j x p_k) about the first vertex, g_i = (1/6) sum p_j x p_k over the
/// triangles of i in cyclic order (errata A06, A07). Along any displacement field the volume is a
/// cubic in the multiplier, which is solved to round-off. With a bulk modulus K [Pa] the compliance
/// is V0/K [m^6/J]; zero keeps the volume exactly.
#[derive(Clone, Debug)]
pub struct EnclosedVolume {
    triangles: Vec<[u32; 3]>,
    rings: Rings,
    width: SimdWidth,
    target: f64,
    compliance: f64,
    /// Of a step, and of one that is not divided.
    relaxation: f64,
    classic: f64,
    multiplier: f64,
    /// Of the multiplier, in the last projection.
    change: f64,
    packed: Packed,
    gradient: Vec<Slot>,
    field: Vec<Slot>,
    terms: Terms,
    calls: u64,
    unsolved: u64,
}

/// No multiple of the displacement field gives the target volume.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "no displacement along the allowed directions gives the volume {target} m3 (now {volume} m3)"
)]
pub struct Unsolvable {
    /// Volume before the projection [m^3].
    pub volume: f64,
    /// Target volume [m^3].
    pub target: f64,
}

impl EnclosedVolume {
    /// Creates the constraint of the volume enclosed by `triangles` over `count` vertices, with the
    /// target `target` [m^3] and the compliance `compliance` [m^6/J].
    pub fn new(triangles: &[[u32; 3]], count: usize, target: f64, compliance: f64) -> Self {
        Self {
            triangles: triangles.to_vec(),
            rings: Rings::new(triangles, count),
            width: SimdWidth::best(),
            target,
            compliance,
            relaxation: 1.0,
            classic: 1.0,
            multiplier: 0.0,
            change: 0.0,
            packed: Packed::default(),
            gradient: vec![Slot::default(); count],
            field: vec![Slot::default(); count],
            terms: Terms::default(),
            calls: 0,
            unsolved: 0,
        }
    }

    /// The same volume over `count` vertices, of which its own begin at `first`.
    #[must_use]
    pub fn shifted(&self, first: u32, count: usize) -> Self {
        let shift = |t: &[u32; 3]| t.map(|v| v + first);
        let triangles: Vec<[u32; 3]> = self.triangles.iter().map(shift).collect();
        Self::new(&triangles, count, self.target, self.compliance).with_width(self.width)
    }

    /// Classic stiffness 0..1: each projection makes only this share of the correction.
    #[must_use]
    pub fn with_relaxation(mut self, factor: f64) -> Self {
        (self.relaxation, self.classic) = (factor, factor);
        self
    }

    /// True if a projection reaches the target.
    pub fn is_exact(&self) -> bool {
        self.compliance == 0.0 && self.classic == 1.0
    }

    /// Divides a classic stiffness below 1 among `steps` steps: see [`super::stiffness_of_part`].
    pub fn divide(&mut self, steps: u32) {
        if self.classic < 1.0 {
            self.relaxation = super::stiffness_of_part(self.classic, steps);
        }
    }

    /// Sets the SIMD width, where the processor has it, instead of the widest. Changes no bit of
    /// any result.
    #[must_use]
    pub fn with_width(mut self, width: SimdWidth) -> Self {
        self.width = width;
        self
    }

    /// Sets the target volume [m^3].
    pub fn set_target(&mut self, target: f64) {
        self.target = target;
    }

    /// The target volume [m^3].
    pub fn target(&self) -> f64 {
        self.target
    }

    /// The triangles of the surface.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Compliance [m^6/J].
    pub fn compliance(&self) -> f64 {
        self.compliance
    }

    /// Moves `x` along `field` until the volume is exactly at its target. Returns the multiple of
    /// `field`.
    ///
    /// # Errors
    /// No multiple near zero gives the volume; `x` is unchanged.
    pub fn retract(
        &self,
        x: &mut [Point3<f64>],
        field: &[Vector3<f64>],
    ) -> Result<f64, Unsolvable> {
        let slots: Vec<Slot> = x.iter().map(|p| Slot([p.x, p.y, p.z, 0.0])).collect();
        let along: Vec<Slot> = field.iter().map(|d| Slot([d.x, d.y, d.z, 0.0])).collect();
        let (mut gradient, mut terms) = (vec![Slot::default(); x.len()], Terms::default());
        let mut weighed = gradient.clone();
        let both = [&mut gradient[..], &mut weighed[..]];
        let volume = self.rings.volume(self.width, &slots, both, &mut terms);
        let coefficients = self
            .rings
            .along(self.width, &slots, &gradient, &along, &mut terms);
        let found = nearest_root(coefficients, self.target - volume);
        let multiple = found.ok_or(Unsolvable {
            volume,
            target: self.target,
        })?;
        x.iter_mut()
            .zip(field)
            .for_each(|(x, d)| *x += d * multiple);
        Ok(multiple)
    }

    /// C(x) for any scalar type.
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
        let slots: Vec<Slot> = x.iter().map(|p| Slot([p.x, p.y, p.z, 0.0])).collect();
        let mut gradient = vec![Slot::default(); x.len()];
        let mut field = gradient.clone();
        let both = [&mut gradient[..], &mut field[..]];
        let volume = self
            .rings
            .volume(self.width, &slots, both, &mut Terms::default());
        (volume - self.target, gradient.iter().map(vector).collect())
    }

    /// Resets the multiplier at the beginning of a step.
    pub fn begin_step(&mut self) {
        self.multiplier = 0.0;
    }

    /// Moves the particles along inverse mass times gradient until the volume is at its target.
    ///
    /// No such displacement exists. The particles are unchanged.
    pub fn project(&mut self, particles: &mut Particles, dt: f64) -> Result<(), Unsolvable> {
        self.project_along(particles, dt, |_, _| ())
    }

    /// The same as [`Self::project`], after `restrict(field, sign)` has removed forbidden
    /// directions from the displacement field; particles move by a positive multiple of
    /// `sign * field`.
    ///
    /// No such displacement exists. The particles are unchanged.
    pub fn project_along(
        &mut self,
        particles: &mut Particles,
        dt: f64,
        restrict: impl FnOnce(&mut [Slot], f64),
    ) -> Result<(), Unsolvable> {
        self.calls += 1;
        self.change = 0.0;
        if dt == 0.0 {
            return Ok(());
        }
        self.packed.read(particles);
        let volume = self.rings.volume(
            self.width,
            &self.packed.slots,
            [&mut self.gradient, &mut self.field],
            &mut self.terms,
        );
        let compliance = self.compliance / (dt * dt);
        let wanted = -(volume - self.target) - compliance * self.multiplier;
        restrict(&mut self.field, wanted.signum());
        let found = self.solve_along_field(wanted, compliance);
        if let Some(change) = found {
            let change = change * self.relaxation;
            self.change = change;
            self.multiplier += change;
            let go = |(x, d): (&mut Point3<f64>, &Slot)| *x += vector(d) * change;
            if is_shared(self.field.len()) {
                particles
                    .position
                    .par_iter_mut()
                    .zip(&self.field)
                    .with_min_len(SHARE)
                    .for_each(go);
            } else {
                particles.position.iter_mut().zip(&self.field).for_each(go);
            }
        } else {
            self.unsolved += 1;
        }
        found.map(|_| ()).ok_or(Unsolvable {
            volume,
            target: self.target,
        })
    }

    /// What the restriction of the last projection took from the displacement of `vertex` [m].
    pub fn withheld(&self, vertex: u32) -> Vector3<f64> {
        if self.change == 0.0 {
            // Nothing moved, perhaps nothing was read.
            return Vector3::zeros();
        }
        let v = vertex as usize;
        let Slot([.., w]) = self.packed.slots[v];
        (vector(&self.gradient[v]) * w - vector(&self.field[v])) * self.change
    }

    /// Root nearest to zero of V(x + s d) - V(x) + compliance s = `wanted`, a cubic in s.
    fn solve_along_field(&mut self, wanted: f64, compliance: f64) -> Option<f64> {
        if wanted == 0.0 {
            return Some(0.0);
        }
        let x = &self.packed.slots;
        let [linear, square, cubic] =
            self.rings
                .along(self.width, x, &self.gradient, &self.field, &mut self.terms);
        nearest_root([linear + compliance, square, cubic], wanted)
    }

    /// Residual of the constraint: |C + alpha lambda| / |grad C| [m].
    pub fn residual(&self, particles: &Particles, dt: f64) -> Residual {
        let (c, gradient) = self.value_and_gradient(&particles.position);
        let steepness = gradient
            .iter()
            .map(Vector3::norm_squared)
            .sum::<f64>()
            .sqrt();
        let r = (c + self.compliance / (dt * dt) * self.multiplier).abs() / steepness;
        Residual {
            rms: r,
            max: r,
            count: 1,
        }
    }

    /// Number of projections so far.
    pub fn calls(&self) -> u64 {
        self.calls
    }

    /// Number of projections without a solution so far.
    pub fn unsolved(&self) -> u64 {
        self.unsolved
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.triangles.capacity() * 12
            + self.rings.bytes()
            + self.packed.bytes()
            + (self.gradient.capacity() + self.field.capacity()) * size_of::<Slot>()
            + self.terms.bytes()
    }
}

impl State for EnclosedVolume {
    fn save(&self, to: &mut Writer) {
        let Self {
            triangles: _,
            rings: _,
            width: _,
            target: _,
            compliance: _,
            relaxation: _,
            classic: _,
            multiplier,
            change: _,
            packed: _,
            gradient: _,
            field: _,
            terms: _,
            calls,
            unsolved,
        } = self;
        to.put(multiplier);
        to.put(&(*calls, *unsolved));
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        self.multiplier = from.take()?;
        (self.calls, self.unsolved) = from.take()?;
        Ok(())
    }
}

/// Root nearest to zero of linear s + square s^2 + cubic s^3 = `wanted`, by Newton's method.
fn nearest_root([linear, square, cubic]: [f64; 3], wanted: f64) -> Option<f64> {
    if wanted == 0.0 {
        return Some(0.0);
    }
    // A surface without extent, or with all vertices fixed: no displacement changes the volume.
    if !(linear > 0.0) {
        return None;
    }
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

fn vector(&Slot([x, y, z, _]): &Slot) -> Vector3<f64> {
    Vector3::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn what_is_withheld_completes_the_displacement() {
        let ball = icosphere(1.0, 1);
        let count = ball.vertices.len();
        let mut volume = EnclosedVolume::new(&ball.triangles, count, 4.5, 0.0);
        let mut particles = Particles::at_rest(ball.vertices.clone(), vec![2.0; count]);
        let project = |volume: &mut EnclosedVolume, particles: &mut Particles, dt| {
            let hold = |field: &mut [Slot], _| field[3] = Slot::default();
            volume.project_along(particles, dt, hold).unwrap();
            [3, 4].map(|v| volume.withheld(v))
        };
        let (_, gradient) = volume.value_and_gradient(&particles.position);
        let nothing = [Vector3::zeros(); 2];
        assert_eq!(project(&mut volume, &mut particles, 0.0), nothing);
        let [held, free] = project(&mut volume, &mut particles, 1e-3);
        assert_eq!(
            (particles.position[3], free),
            (ball.vertices[3], nothing[0])
        );
        // The same multiple of its gradient as that of a vertex that moved.
        let moved = particles.position[4] - ball.vertices[4];
        let multiple = moved.dot(&gradient[4]) / gradient[4].norm_squared();
        let rounding = 64.0 * f64::EPSILON;
        assert!((held - gradient[3] * multiple).norm() <= rounding * held.norm());
        assert!(held.norm() > 0.0);
        assert_eq!(project(&mut volume, &mut particles, 0.0), nothing);
    }
}
