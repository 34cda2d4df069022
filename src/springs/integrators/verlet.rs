//! Verlet with backward-difference damping, the thesis's integrator.

use nalgebra::{Point3, Vector3};

use super::{Integrator, StepError, finite};
use crate::springs::stability::Mode;
use crate::springs::system::SpringSystem;

/// `x(t+dt) = 2 x(t) - x(t-dt) + dt^2 F/m`, `F = f(x(t)) - c (x(t) - x(t-dt))/dt`.
///
/// Of order 2 without damping, of order 1 with damping, which lags by half a step. Stable for
/// `k dt^2 + 2 c dt < 4 m` (errata M3). The resulting velocity of the system is that of the last
/// two moves, extrapolated by half a step.
#[derive(Clone, Debug, Default)]
pub struct Verlet {
    /// Positions [m] of the previous step, and its length [s].
    before: Option<(Vec<Point3<f64>>, f64)>,
    from_stillness: bool,
}

impl Verlet {
    /// Starts with x(-dt) = x(0) - v(0) dt, as the thesis does, without half of the acceleration:
    /// of order 1 in the first step.
    pub fn from_stillness() -> Self {
        Self {
            before: None,
            from_stillness: true,
        }
    }

    /// Positions at the time -`dt`.
    fn earlier(&mut self, system: &SpringSystem, a: &[Vector3<f64>], dt: f64) -> Vec<Point3<f64>> {
        let count = system.len();
        let drag = |i: usize| system.damping / system.mass()[i];
        match self.before.take() {
            Some((before, last)) if before.len() == count && last == dt => before,
            Some((before, last)) if before.len() == count => {
                let back = |i: usize| {
                    // The present velocity: that of half a step ago, extrapolated by half a step.
                    let half = (system.position[i] - before[i]) / last;
                    let a = a[i] - half * drag(i);
                    system.position[i] - (half + a * (0.5 * last)) * dt + a * (0.5 * dt * dt)
                };
                (0..count).map(back).collect()
            }
            _ => {
                let half = if self.from_stillness {
                    0.0
                } else {
                    0.5 * dt * dt
                };
                (0..count)
                    .map(|i| {
                        let a = a[i] - system.velocity[i] * drag(i);
                        system.position[i] - system.velocity[i] * dt + a * half
                    })
                    .collect()
            }
        }
    }
}

impl Integrator for Verlet {
    fn name(&self) -> &'static str {
        "verlet"
    }

    fn order(&self) -> u32 {
        2
    }

    fn step(&mut self, system: &mut SpringSystem, dt: f64) -> Result<(), StepError> {
        let mut a = Vec::new();
        // Without the damping, which is added with the difference of positions.
        let still = vec![Vector3::zeros(); system.len()];
        system.acceleration(&system.position, &still, &mut a);
        let mut before = self.earlier(system, &a, dt);
        for i in 0..system.len() {
            if system.pinned()[i] {
                before[i] = system.position[i];
                continue;
            }
            let x = system.position[i];
            let moved = x - before[i];
            let slowed = moved * (1.0 - system.damping * dt / system.mass()[i]);
            let step = slowed + a[i] * (dt * dt);
            before[i] = x;
            system.position[i] = x + step;
            system.velocity[i] = (step * 1.5 - moved * 0.5) / dt;
        }
        self.before = Some((before, dt));
        finite(system, dt)
    }

    fn limit(
        &self,
        Mode {
            angular_frequency_squared,
            damping_rate,
        }: Mode,
    ) -> f64 {
        // dt < (-c + sqrt(c^2 + 4 k m))/k, in a form without cancellation.
        let root =
            damping_rate + (damping_rate * damping_rate + 4.0 * angular_frequency_squared).sqrt();
        if root > 0.0 {
            4.0 / root
        } else {
            f64::INFINITY
        }
    }

    fn restart(&mut self) {
        self.before = None;
    }

    fn fork(&self) -> Box<dyn Integrator> {
        Box::new(self.clone())
    }
}
