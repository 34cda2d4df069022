//! The backward differentiation formula of order 2.

use nalgebra::{Point3, Vector3};

use super::implicit::Equation;
use super::{Integrator, StepError, finite};
use crate::springs::stability::Mode;
use crate::springs::system::SpringSystem;

/// Positions, velocities and length of the previous step.
type Past = (Vec<Point3<f64>>, Vec<Vector3<f64>>, f64);

/// `(1 + 2r)/(1 + r) y' - (1 + r) y + r^2/(1 + r) y_before = dt f(y')`, where r is the ratio of
/// this step to the last; for equal steps `3/2 y' - 2 y + 1/2 y_before = dt f(y')`. The first step
/// is implicit Euler.
///
/// Stable for every constant step, and with much less damping than implicit Euler.
#[derive(Clone, Debug, Default)]
pub struct Bdf2 {
    past: Option<Past>,
}

impl Integrator for Bdf2 {
    fn name(&self) -> &'static str {
        "bdf2"
    }

    fn order(&self) -> u32 {
        2
    }

    fn step(&mut self, system: &mut SpringSystem, dt: f64) -> Result<(), StepError> {
        let (x, v) = (system.position.clone(), system.velocity.clone());
        let past = self.past.take().filter(|past| past.0.len() == x.len());
        match past {
            None => Equation {
                x: &x,
                v: &v,
                h: dt,
            }
            .solve(system, dt)?,
            Some((x_before, v_before, last)) => {
                let r = dt / last;
                let first = (1.0 + 2.0 * r) / (1.0 + r);
                // This form loses fewer digits: small differences are added to large numbers.
                let ahead = r * r / ((1.0 + r) * first);
                let at_x: Vec<_> = x
                    .iter()
                    .zip(&x_before)
                    .map(|(x, b)| x + (x - b) * ahead)
                    .collect();
                let at_v: Vec<_> = v
                    .iter()
                    .zip(&v_before)
                    .map(|(v, b)| v + (v - b) * ahead)
                    .collect();
                Equation {
                    x: &at_x,
                    v: &at_v,
                    h: dt / first,
                }
                .solve(system, dt)?;
            }
        }
        self.past = Some((x, v, dt));
        finite(system, dt)
    }

    fn limit(&self, _: Mode) -> f64 {
        f64::INFINITY
    }

    fn restart(&mut self) {
        self.past = None;
    }

    fn fork(&self) -> Box<dyn Integrator> {
        Box::new(self.clone())
    }
}
