//! The classic Runge-Kutta method of order 4.

use nalgebra::{Complex, Point3, Vector3};

use super::{Integrator, StepError, finite};
use crate::springs::stability::Mode;
use crate::springs::system::SpringSystem;

/// Four evaluations of the forces per step.
///
/// Stable without damping for `w dt <= 2 sqrt(2)`; the loss of energy is of order 5 in the step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rk4;

/// Position of each evaluation in the step.
const STAGES: [f64; 4] = [0.0, 0.5, 0.5, 1.0];
/// Weight of each evaluation.
const WEIGHTS: [f64; 4] = [1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0];
/// Steps of the search for a limit along a ray, and halvings after it.
const RAY: usize = 4096;
const HALVINGS: usize = 60;

impl Integrator for Rk4 {
    fn name(&self) -> &'static str {
        "rk4"
    }

    fn order(&self) -> u32 {
        4
    }

    fn step(&mut self, system: &mut SpringSystem, dt: f64) -> Result<(), StepError> {
        let (x0, v0) = (system.position.clone(), system.velocity.clone());
        let (mut a, mut v) = (vec![Vector3::zeros(); x0.len()], v0.clone());
        let mut x: Vec<Point3<f64>> = x0.clone();
        let free: Vec<usize> = (0..x0.len()).filter(|&i| !system.pinned()[i]).collect();
        for (stage, weight) in STAGES.into_iter().zip(WEIGHTS) {
            for &i in &free {
                x[i] = x0[i] + v[i] * (stage * dt);
            }
            let slopes: Vec<Vector3<f64>> = v0
                .iter()
                .zip(&a)
                .map(|(v, a)| v + a * (stage * dt))
                .collect();
            v = slopes;
            system.acceleration(&x, &v, &mut a);
            for &i in &free {
                system.position[i] += v[i] * (weight * dt);
                system.velocity[i] += a[i] * (weight * dt);
            }
        }
        finite(system, dt)
    }

    fn limit(&self, mode: Mode) -> f64 {
        let (square, drag) = (mode.angular_frequency_squared, mode.damping_rate);
        let root = Complex::new(drag * drag - 4.0 * square, 0.0).sqrt();
        let lambda = [(root - drag) * 0.5, (-root - drag) * 0.5];
        let scale = lambda.iter().map(|l| l.norm()).fold(0.0, f64::max);
        if !(scale > 0.0) {
            return f64::INFINITY;
        }
        // |1 + z + z^2/2 + z^3/6 + z^4/24|, up to rounding.
        let grows = |dt: f64| {
            lambda.iter().any(|l| {
                let z = l * dt;
                let one = Complex::new(1.0, 0.0);
                (one + z * (one + z * (one + z * (one + z / 4.0) / 3.0) / 2.0)).norm() > 1.0 + 1e-12
            })
        };
        // The region of stability extends at most 3 from the origin.
        let at = |k: f64| 3.5 * k / (RAY as f64 * scale);
        let Some(first) = (1..=RAY).find(|&k| grows(at(k as f64))) else {
            return f64::INFINITY;
        };
        let (mut low, mut high) = (at(first as f64 - 1.0), at(first as f64));
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if grows(middle) {
                high = middle
            } else {
                low = middle
            }
        }
        low
    }

    fn fork(&self) -> Box<dyn Integrator> {
        Box::new(*self)
    }
}
