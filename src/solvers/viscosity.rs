//! Dampers beside the springs of the edges: velocities of neighbours, relative to those with which bones
//! carry them along, even out.
//!
//! A damper of `time` times the stiffness of its edge makes a Kelvin-Voigt solid of that retardation
//! time (Rayleigh's damping in proportion to stiffness). A damping in proportion to mass slows the long
//! waves of a soft muscle most, which need no damping, and short ones least, which ring.

use nalgebra::Vector3;

use super::sparse::{Factor, FactorError};
use crate::constraints::Distance;
use crate::particles::Particles;

/// The dampers of a body.
pub(crate) struct Viscosity {
    /// Ends and damping [N s/m] of each edge.
    dampers: Vec<([u32; 2], f64)>,
    /// Factor of `m + h c`, and its `h` [s].
    factor: Factor<1>,
    time_step: f64,
    /// Right-hand sides: one column for each axis.
    rhs: Vec<f64>,
}

impl Viscosity {
    /// Dampers beside `edges` of this `stiffness` [N/m], with a retardation `time` [s].
    ///
    /// # Errors
    /// Too little memory for the factor.
    pub fn new(
        count: usize,
        edges: &[Distance],
        stiffness: &[f64],
        time: f64,
    ) -> Result<Self, FactorError> {
        let points: Vec<[u32; 2]> = edges.iter().map(|e| e.points).collect();
        let dampers = points.iter().zip(stiffness).map(|(&p, k)| (p, k * time));
        Ok(Self {
            dampers: dampers.collect(),
            factor: Factor::new(count, &points)?,
            time_step: 0.0,
            rhs: vec![0.0; 3 * count],
        })
    }

    /// Evens out the velocities of `particles` over `h` [s], by an implicit step, which is stable for any
    /// `h`. `carried` are the velocities [m/s] with which bones carry them, those of `None` zero.
    /// Particles without an inverse mass go with the bones.
    pub fn even_out(
        &mut self,
        particles: &mut Particles,
        carried: impl Fn(usize) -> Vector3<f64>,
        h: f64,
    ) {
        let Particles {
            velocity,
            inverse_mass,
            ..
        } = particles;
        if h != self.time_step {
            self.time_step = 0.0;
            if self.factorise(inverse_mass, h).is_err() {
                return;
            }
            self.time_step = h;
        }
        let count = velocity.len();
        for (i, (v, w)) in velocity.iter().zip(inverse_mass.iter()).enumerate() {
            let momentum = match *w > 0.0 {
                true => (v - carried(i)) / *w,
                false => Vector3::zeros(),
            };
            (0..3).for_each(|axis| self.rhs[axis * count + i] = momentum[axis]);
        }
        self.factor.solve(&mut self.rhs, 3);
        for (i, (v, w)) in velocity.iter_mut().zip(inverse_mass.iter()).enumerate() {
            if *w > 0.0 {
                let relative = [0, 1, 2].map(|axis| self.rhs[axis * count + i]);
                *v = carried(i) + Vector3::from(relative);
            }
        }
    }

    /// Factorises `m + h c`; the rows of particles without an inverse mass are those of the identity.
    fn factorise(&mut self, inverse_mass: &[f64], h: f64) -> Result<(), FactorError> {
        self.factor.clear();
        for (i, &w) in inverse_mass.iter().enumerate() {
            let mass = if w > 0.0 { 1.0 / w } else { 1.0 };
            self.factor.add_diagonal(i as u32, mass);
        }
        let is_free = |p: u32| inverse_mass[p as usize] > 0.0;
        for &([a, b], c) in &self.dampers {
            for p in [a, b].into_iter().filter(|&p| is_free(p)) {
                self.factor.add_diagonal(p, h * c);
            }
            if is_free(a) && is_free(b) {
                self.factor.add(a.max(b), a.min(b), &[[-h * c]]);
            }
        }
        self.factor.factorise()
    }
}
