//! Energy over 1e5 steps of a body with forces only (P38).
//!
//! Without constraints a step is symplectic Euler. With velocities as means of two successive ones,
//! the same steps are Verlet. With a spring as a constraint a step is implicit Euler, which has
//! damping: it must fail here.

use nalgebra::{Point3, Vector3};
use pliant::Particles;
use pliant::solvers::System;

use crate::bodies::{chain, settings};
use crate::tolerances::{T1, worst};

const STEPS: usize = 100_000;

/// Relative tolerance of the first-order bounds in omega dt, as in the row of P38.
const HIGHER_ORDER: f64 = 1.05;

/// The velocity of a position.
#[derive(Clone, Copy, PartialEq)]
enum Read {
    /// The velocity that led to the position.
    Euler,
    /// The mean of the velocity that led to the position and the next one.
    Verlet,
}

/// E/E0 - 1 after each step of a mass of 1 kg with a force of -x [N], released at 1 m; `omega_dt`
/// is the step [s].
fn drift(omega_dt: f64, read: Read, velocity_factor: f64) -> Vec<f64> {
    let mut system = System::new(
        Particles::at_rest(vec![Point3::new(1.0, 0.0, 0.0)], vec![1.0]),
        settings(1),
    );
    system.settings.velocity_factor = velocity_factor;
    if read == Read::Verlet {
        system.particles.velocity[0].x = 0.5 * omega_dt;
    }
    let mut energies = Vec::with_capacity(STEPS);
    for _ in 0..STEPS {
        let (x, before) = (
            system.particles.position[0].x,
            system.particles.velocity[0].x,
        );
        system.forces = vec![(0, Vector3::new(-x, 0.0, 0.0))];
        system.step(&[], omega_dt).expect("finite");
        let after = system.particles.velocity[0].x;
        energies.push(match read {
            Read::Euler => after.powi(2) + system.particles.position[0].x.powi(2) - 1.0,
            Read::Verlet => (0.5 * (before + after)).powi(2) + x.powi(2) - 1.0,
        });
    }
    energies
}

fn max_or_nan(drift: &[f64]) -> f64 {
    worst(drift.iter().map(|e| e.abs()))
}

/// Slope of the means of 100 blocks, divided by its standard error.
fn trend(drift: &[f64]) -> f64 {
    let means: Vec<f64> = drift
        .chunks(STEPS / 100)
        .map(|b| b.iter().sum::<f64>() / b.len() as f64)
        .collect();
    let n = means.len() as f64;
    let middle = means.iter().sum::<f64>() / n;
    let at = |k: usize| k as f64 - 0.5 * (n - 1.0);
    let width: f64 = (0..means.len()).map(|k| at(k).powi(2)).sum();
    let slope = means
        .iter()
        .enumerate()
        .map(|(k, m)| at(k) * (m - middle))
        .sum::<f64>()
        / width;
    let left: f64 = means
        .iter()
        .enumerate()
        .map(|(k, m)| (m - middle - slope * at(k)).powi(2))
        .sum();
    slope / (left / (n - 2.0) / width).sqrt()
}

#[test]
fn p38_symplectic_euler_keeps_its_energy() {
    for omega_dt in [0.01, 0.02, 0.05, 0.09, 0.2, 0.5] {
        let found = drift(omega_dt, Read::Euler, 1.0);
        // x^2 + v^2 - omega dt x v is constant, and |x v| is at most half of x^2 + v^2.
        let half = 0.5 * omega_dt;
        let exact = half / (1.0 - half);
        let (off, steep) = (max_or_nan(&found), trend(&found));
        println!(
            "symplectic Euler, omega dt {omega_dt}: energy off by {off:.6}, trend {steep:.2} standard errors"
        );
        assert!(off <= exact * (1.0 + 1e-9), "omega dt {omega_dt}: {off}");
        assert!(
            omega_dt > 0.09 || off <= half * HIGHER_ORDER,
            "omega dt {omega_dt}: {off}"
        );
        assert!(
            off >= 0.9 * half,
            "nothing happened at omega dt {omega_dt}: {off}"
        );
        assert!(
            steep.abs() <= 3.0,
            "omega dt {omega_dt}: a trend of {steep} standard errors"
        );
    }
}

#[test]
fn p38_verlet_keeps_its_energy_to_second_order() {
    for omega_dt in [0.01, 0.02, 0.05, 0.2, 0.5] {
        let found = drift(omega_dt, Read::Verlet, 1.0);
        let bound = 0.25 * omega_dt * omega_dt;
        let (off, steep) = (max_or_nan(&found), trend(&found));
        println!(
            "Verlet, omega dt {omega_dt}: energy off by {off:.3e}, trend {steep:.2} standard errors"
        );
        assert!(off <= bound * HIGHER_ORDER, "omega dt {omega_dt}: {off:e}");
        assert!(
            off >= 0.9 * bound,
            "nothing happened at omega dt {omega_dt}: {off:e}"
        );
        // With the mean velocity the energy is at most that at the start.
        assert!(worst(found.iter().map(|e| e.max(0.0))) <= T1 * (STEPS as f64).sqrt());
        assert!(
            steep.abs() <= 3.0,
            "omega dt {omega_dt}: a trend of {steep} standard errors"
        );
    }
}

#[test]
fn a_drift_is_seen() {
    let omega_dt: f64 = 0.05;
    let bound = 0.5 * omega_dt * HIGHER_ORDER;
    // A damping that leaves the energy within the bound is still a trend.
    let damped = drift(omega_dt, Read::Euler, 1.0 - 1e-8);
    assert!(max_or_nan(&damped) <= bound, "{}", max_or_nan(&damped));
    assert!(
        !(trend(&damped).abs() <= 3.0),
        "control: {} standard errors",
        trend(&damped)
    );
    // Implicit Euler loses the energy, explicit Euler gains it.
    let mut spring = chain(1, 10.0, |_| 1.0, 1.0, 1);
    spring.particles.position[1].z = -11.0;
    let (mut x, mut v) = (1.0_f64, 0.0_f64);
    let (mut implicit, mut explicit) = (Vec::new(), Vec::new());
    for _ in 0..STEPS {
        spring.step(&[], omega_dt).expect("finite");
        let p = &spring.particles;
        implicit.push((p.position[1].z + 10.0).powi(2) + p.velocity[1].z.powi(2) - 1.0);
        (x, v) = (x + omega_dt * v, v - omega_dt * x);
        explicit.push(x * x + v * v - 1.0);
    }
    assert!(!(max_or_nan(&implicit) <= bound));
    assert!(!(max_or_nan(&explicit) <= bound));
    // Symplectic Euler does not conserve the energy of Verlet.
    assert!(
        !(max_or_nan(&drift(omega_dt, Read::Euler, 1.0))
            <= 0.25 * omega_dt * omega_dt * HIGHER_ORDER)
    );
}
