//! A step that grows while it is stable, and is halved and done again where it is not \[baraff1998\].

use super::{Integrator, StepError};
use crate::springs::system::SpringSystem;

/// An integrator with a step of its own choice.
pub struct Adaptive {
    /// What makes the steps.
    pub integrator: Box<dyn Integrator>,
    /// The step that is tried next [s].
    pub dt: f64,
    /// The shortest step [s]; where even that is not stable, the run ends.
    pub least: f64,
    /// The longest step [s].
    pub greatest: f64,
    /// The step grows by this factor after each stable one.
    pub growth: f64,
    /// A step is unstable if it raises the total energy by more than this share of the greatest so far, loads not counted in it.
    pub rise: f64,
    /// For so many steps after one was done again it does not grow.
    pub patience: usize,
    waiting: usize,
    most_energy: f64,
}

/// What a step was like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attempt {
    /// The step that was made [s].
    pub dt: f64,
    /// How many were taken back before it.
    pub redone: usize,
}

impl Adaptive {
    /// Begins with a step of `dt` [s], which may shrink to a millionth and grow to a thousand of it.
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
    /// The energy of everything must not rise: nothing but loads, whose energy is counted, does work on a system.
    ///
    /// # Errors
    /// Not even the shortest step is stable; the system is then as before.
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
