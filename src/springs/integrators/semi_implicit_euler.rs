//! Semi-implicit (symplectic) Euler.

use super::{Integrator, StepError, finite};
use crate::springs::stability::Mode;
use crate::springs::system::SpringSystem;

/// `v' = factor (v + a dt)`, `x' = x + v' dt`: positions with the new velocity (errata B05).
///
/// [`Self::velocities`] and [`Self::positions`] are its halves, for callers that change velocities
/// in between, such as contact impulses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SemiImplicitEuler {
    /// Remaining share of the velocity after each step, 0..1; 1 means no such damping. The effect
    /// depends on the step.
    pub factor: f64,
}

impl Default for SemiImplicitEuler {
    fn default() -> Self {
        Self { factor: 1.0 }
    }
}

impl SemiImplicitEuler {
    /// The first half: new velocities.
    pub fn velocities(&self, system: &mut SpringSystem, dt: f64) {
        let mut a = Vec::new();
        system.acceleration(&system.position, &system.velocity, &mut a);
        for (i, a) in a.iter().enumerate() {
            if !system.pinned()[i] {
                system.velocity[i] = (system.velocity[i] + a * dt) * self.factor;
            }
        }
    }

    /// The second half: new positions.
    ///
    /// # Errors
    /// Numbers that are not finite.
    pub fn positions(&self, system: &mut SpringSystem, dt: f64) -> Result<(), StepError> {
        for i in 0..system.len() {
            if !system.pinned()[i] {
                let v = system.velocity[i];
                system.position[i] += v * dt;
            }
        }
        finite(system, dt)
    }
}

impl Integrator for SemiImplicitEuler {
    fn name(&self) -> &'static str {
        "semi-implicit"
    }

    fn order(&self) -> u32 {
        1
    }

    fn step(&mut self, system: &mut SpringSystem, dt: f64) -> Result<(), StepError> {
        self.velocities(system, dt);
        self.positions(system, dt)
    }

    fn limit(&self, mode: Mode) -> f64 {
        let (square, drag) = (mode.angular_frequency_squared, mode.damping_rate);
        // f w^2 dt^2 + 2 f d dt < 2 (1 + f).
        let f = self.factor;
        let room = 2.0 * (1.0 + f) / f;
        let root = (drag * drag + room * square).sqrt() + drag;
        if root > 0.0 {
            room / root
        } else {
            f64::INFINITY
        }
    }

    fn fork(&self) -> Box<dyn Integrator> {
        Box::new(*self)
    }
}
