//! Explicit Euler, as a counter-example.

use super::{Integrator, StepError, finite};
use crate::springs::stability::Mode;
use crate::springs::system::SpringSystem;

/// `x' = x + v dt`, `v' = v + a dt` with the old velocity and acceleration.
///
/// The amplitude of an undamped spring grows by the factor `sqrt(1 + (w dt)^2)` in every step
/// (errata B05): without damping no step is stable. For comparison only.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExplicitEuler;

impl Integrator for ExplicitEuler {
    fn name(&self) -> &'static str {
        "explicit"
    }

    fn order(&self) -> u32 {
        1
    }

    fn step(&mut self, system: &mut SpringSystem, dt: f64) -> Result<(), StepError> {
        let mut a = Vec::new();
        system.acceleration(&system.position, &system.velocity, &mut a);
        for (i, a) in a.into_iter().enumerate() {
            if !system.pinned()[i] {
                let v = system.velocity[i];
                system.position[i] += v * dt;
                system.velocity[i] = v + a * dt;
            }
        }
        finite(system, dt)
    }

    fn limit(&self, mode: Mode) -> f64 {
        let (square, drag) = (mode.angular_frequency_squared, mode.damping_rate);
        // z^2 - (2 - b) z + 1 - b + a = 0 with a = w^2 dt^2, b = d dt: a < b and 4 - 2 b + a > 0.
        let first = if square > 0.0 {
            drag / square
        } else {
            f64::INFINITY
        };
        let root = drag * drag - 4.0 * square;
        // Avoids cancellation for a slow mode.
        let second = if root < 0.0 || drag == 0.0 {
            f64::INFINITY
        } else {
            4.0 / (drag + root.sqrt())
        };
        first.min(second)
    }

    fn fork(&self) -> Box<dyn Integrator> {
        Box::new(*self)
    }
}
