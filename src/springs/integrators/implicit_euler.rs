//! Implicit Euler.

use super::implicit::Equation;
use super::{Integrator, StepError, finite};
use crate::springs::stability::Mode;
use crate::springs::system::SpringSystem;

/// `v' = v + a(x', v') dt`, `x' = x + v' dt`.
///
/// Stable for every step; its damping increases with the step.
#[derive(Clone, Copy, Debug, Default)]
pub struct ImplicitEuler {}

impl Integrator for ImplicitEuler {
    fn name(&self) -> &'static str {
        "implicit"
    }

    fn order(&self) -> u32 {
        1
    }

    fn step(&mut self, system: &mut SpringSystem, dt: f64) -> Result<(), StepError> {
        let (x, v) = (system.position.clone(), system.velocity.clone());
        Equation {
            x: &x,
            v: &v,
            h: dt,
        }
        .solve(system, dt)?;
        finite(system, dt)
    }

    fn limit(&self, _: Mode) -> f64 {
        f64::INFINITY
    }

    fn fork(&self) -> Box<dyn Integrator> {
        Box::new(*self)
    }
}
