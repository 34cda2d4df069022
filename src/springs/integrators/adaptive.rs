//! A step that grows while it is stable, and is halved and repeated if not \[baraff1998\].

use super::{Integrator, StepError};
use crate::springs::system::SpringSystem;

/// An integrator with an adaptive step.
pub struct Adaptive {
    /// The integrator of the steps.
    pub integrator: Box<dyn Integrator>,
    /// Length of the next step [s].
    pub dt: f64,
    /// Least step [s]; if it is unstable, the run ends.
    pub least: f64,
    /// Greatest step [s].
    pub greatest: f64,
    /// Growth factor of the step after each stable one.
    pub growth: f64,
    /// A step is unstable if it increases the total energy by more than this share of the greatest
    /// energy so far, without loads.
    pub rise: f64,
    /// Number of steps without growth after a repeated one.
    pub patience: usize,
    waiting: usize,
    most_energy: f64,
}

/// Result of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attempt {
    /// Length of the step [s].
    pub dt: f64,
    /// Number of rejected attempts before the step.
    pub redone: usize,
}

impl Adaptive {
    /// Starts with a step of `dt` [s], which can shrink to a millionth and grow to a thousand of
    /// it.
    pub fn new(integrator: Box<dyn Integrator>, dt: f64) -> Self {
        Self {
            integrator,
            dt,
            least: 1e-6 * dt,
            greatest: 1e3 * dt,
            growth: 1.1,
            rise: 0.05,
            patience: 20,
            waiting: 0,
            most_energy: 0.0,
        }
    }

    /// Makes one step.
    ///
    /// The total energy must not increase: only loads, whose energy is included, do work on a
    /// system.
    ///
    /// # Errors
    /// Even the least step is unstable; the system is then unchanged.
    pub fn step(&mut self, system: &mut SpringSystem) -> Result<Attempt, StepError> {
        let before = (system.position.clone(), system.velocity.clone());
        let remembered = self.integrator.fork();
        let energy = system.energy();
        let moving = energy.kinetic + energy.stored;
        self.most_energy = if self.most_energy >= moving {
            self.most_energy
        } else {
            moving
        };
        let mut redone = 0;
        loop {
            let dt = self.dt;
            let done = self.integrator.step(system, dt);
            let after = system.energy();
            let allowed = self.rise * self.most_energy.max((after.loads - energy.loads).abs());
            if done.is_ok() && after.total() - energy.total() <= allowed {
                self.grow();
                return Ok(Attempt { dt, redone });
            }
            system.position.clone_from(&before.0);
            system.velocity.clone_from(&before.1);
            self.integrator = remembered.fork();
            if !(0.5 * dt >= self.least) {
                return Err(StepError::TooLong { dt });
            }
            self.dt = 0.5 * dt;
            self.waiting = self.patience;
            redone += 1;
        }
    }

    fn grow(&mut self) {
        if self.waiting > 0 {
            self.waiting -= 1;
        } else {
            self.dt = (self.dt * self.growth).min(self.greatest);
        }
    }
}
