//! Motion compared with exact solutions: modes of a chain, critical damping, the pendulum, a block
//! (P18, P37, P39).

use nalgebra::{Point3, Vector3};
use pliant::mesh::shapes::box_surface;
use pliant::solvers::System;

use super::{off_order, orders, powers};
use crate::bodies::{chain, elastic};
use crate::tolerances::{T4, T5, T10, worst};

/// Links, stiffness [N/m] and mass [kg] of the chain; its links are 1 m long.
const LINKS: usize = 4;
const STIFFNESS: f64 = 50.0;
const MASS: f64 = 0.5;

/// Angular frequency of mode `k` (from 1) of a chain that is fixed at one end.
fn frequency(k: usize) -> f64 {
    2.0 * (STIFFNESS / MASS).sqrt() * (angle(k) / 2.0).sin()
}

/// The shape of mode `k` is sin(j angle) at particle j.
fn angle(k: usize) -> f64 {
    std::f64::consts::PI * (2 * k - 1) as f64 / (2 * LINKS + 1) as f64
}

/// Displacements of the chain, `amplitude[k - 1]` of mode k.
fn shape(amplitude: &[f64]) -> Vec<f64> {
    let at = |j: usize| {
        amplitude
            .iter()
            .enumerate()
            .map(|(k, a)| a * (j as f64 * angle(k + 1)).sin())
            .sum()
    };
    (0..=LINKS).map(at).collect()
}

/// Displacements after `steps` of `dt` from a chain at rest in the shape of `amplitude`.
fn moved(amplitude: &[f64], iterations: u32, dt: f64, steps: usize) -> Vec<f64> {
    let mut system = chain(LINKS, 1.0, |_| MASS, 1.0 / STIFFNESS, iterations);
    let start = shape(amplitude);
    system
        .particles
        .position
        .iter_mut()
        .zip(&start)
        .for_each(|(p, u)| p.z -= u);
    (0..steps).for_each(|_| system.step(&[], dt).expect("finite"));
    system
        .particles
        .position
        .iter()
        .enumerate()
        .map(|(j, p)| -(j as f64) - p.z)
        .collect()
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    worst(a.iter().zip(b).map(|(a, b)| (a - b).abs()))
}

#[test]
fn p39_modes_of_a_chain_follow_implicit_euler() {
    let (dt, steps) = (0.02, 100);
    // Of implicit Euler: 1/(1 + i w h) to the power of the steps.
    let factor = |w: f64, n: i32| {
        (1.0 + (w * dt).powi(2)).powf(-0.5 * f64::from(n)) * (f64::from(n) * (w * dt).atan()).cos()
    };
    for k in 1..=LINKS {
        let mut amplitude = [0.0; LINKS];
        amplitude[k - 1] = 0.05;
        let found = moved(&amplitude, 400, dt, steps);
        let expected = shape(&amplitude.map(|a| a * factor(frequency(k), steps as i32)));
        let off = apart(&found, &expected);
        println!("modes: {k} of {LINKS}, {off:.1e} m from implicit Euler after {steps} steps");
        // Relative to the 4 m of the stored positions; each step divides their rounding by the
        // step.
        assert!(off <= 4.0 * T10, "mode {k}: {off:e}");
        let other = shape(&amplitude.map(|a| a * factor(1.001 * frequency(k), steps as i32)));
        assert!(
            k > 2 || !(apart(&found, &other) <= 4.0 * T10),
            "control: another frequency, mode {k}"
        );
    }
}

#[test]
fn p37_the_coupled_chain_converges_with_order_one() {
    let amplitude = [0.05, 0.03, -0.02, 0.01];
    let time = 0.3;
    let mut turned = amplitude;
    (1..=LINKS).for_each(|k| turned[k - 1] *= (frequency(k) * time).cos());
    let exact = shape(&turned);
    for iterations in [1, 50] {
        let error = |n: usize| apart(&moved(&amplitude, iterations, time / n as f64, n), &exact);
        let errors = [400, 800, 1600, 3200].map(error);
        println!(
            "coupled chain, {iterations} sweeps: errors {errors}, orders {:.4?}",
            orders(&errors),
            errors = powers(&errors)
        );
        assert!(off_order(&errors, 1.0) <= T4);
    }
    // Control: one frequency is wrong by a hundredth.
    turned[0] = amplitude[0] * (1.01 * frequency(1) * time).cos();
    let wrong = [800, 1600, 3200]
        .map(|n| apart(&moved(&amplitude, 1, time / n as f64, n), &shape(&turned)));
    assert!(!(off_order(&wrong, 1.0) <= T4));
}

/// Elongations of a mass of 1 kg on a spring of `omega`^2 N/m, 0.1 m at first, at each step.
fn damped(omega: f64, factor: f64, dt: f64, steps: usize) -> Vec<f64> {
    let mut system = chain(1, 1.0, |_| 1.0, 1.0 / (omega * omega), 1);
    system.settings.velocity_factor = factor;
    system.particles.position[1].z -= 0.1;
    let step = |_| {
        system.step(&[], dt).expect("finite");
        -1.0 - system.particles.position[1].z
    };
    (0..steps).map(step).collect()
}

#[test]
fn a_critically_damped_step_has_its_closed_form() {
    let (omega, dt) = (7.0_f64, 0.02);
    let w = (omega * dt).powi(2);
    // Both roots of the recurrence coincide where (1 - d)^2 = 4 d w; then x_n = (c + b n) r^n.
    let factor = 1.0 + 2.0 * w - 2.0 * (w * w + w).sqrt();
    let r = (1.0 + factor) / (2.0 * (1.0 + w));
    let b = 0.1 / (1.0 + w) / r - 0.1;
    let off = |factor: f64| {
        let found = damped(omega, factor, dt, 100);
        let expected: Vec<f64> = (1..=100)
            .map(|n| (0.1 + b * f64::from(n)) * r.powi(n))
            .collect();
        apart(&found, &expected)
    };
    println!(
        "critically damped: {:.1e} m from its recurrence",
        off(factor)
    );
    assert!(off(factor) <= T10, "{:e}", off(factor));
    assert!(!(off(0.999 * factor) <= T10), "control: another damping");
}

#[test]
fn p37_the_critically_damped_spring_converges_with_order_one() {
    let (omega, time) = (10.0_f64, 0.15);
    let exact = 0.1 * (1.0 + omega * time) * (-omega * time).exp();
    let errors = |share: f64| {
        [400, 800, 1600, 3200].map(|n: usize| {
            let dt = time / n as f64;
            (damped(omega, 1.0 - share * 2.0 * omega * dt, dt, n)[n - 1] - exact).abs()
        })
    };
    let found = errors(1.0);
    println!(
        "critically damped: exact {exact:.6} m, errors {found}, orders {:.4?}",
        orders(&found),
        found = powers(&found)
    );
    assert!(off_order(&found, 1.0) <= T4);
    assert!(
        !(off_order(&errors(0.99), 1.0) <= T4),
        "control: another damping"
    );
}

/// The elliptic sine sn(u, k), by arithmetic-geometric means.
fn elliptic_sine(u: f64, k: f64) -> f64 {
    let (mut a, mut b) = (1.0, (1.0 - k * k).sqrt());
    let mut ratios = Vec::new();
    while ratios.len() < 6 {
        let c = 0.5 * (a - b);
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
        ratios.push(c / a);
    }
    let mut phi = 2f64.powi(ratios.len() as i32) * a * u;
    for ratio in ratios.iter().rev() {
        phi = 0.5 * (phi + (ratio * phi.sin()).asin());
    }
    phi.sin()
}

#[test]
fn p37_the_pendulum_converges_with_order_one() {
    let (g, widest, time) = (9.81_f64, 1.2_f64, 0.4);
    let k = (widest / 2.0).sin();
    // A quarter of the period: pi/2 / agm(1, k').
    let quarter = {
        let (mut a, mut b) = (1.0_f64, (1.0 - k * k).sqrt());
        (0..8).for_each(|_| (a, b) = (0.5 * (a + b), (a * b).sqrt()));
        std::f64::consts::FRAC_PI_2 / a
    };
    assert!(
        (elliptic_sine(quarter, k) - 1.0).abs() <= T10,
        "the oracle is not at its end"
    );
    let angle = 2.0 * (k * elliptic_sine(quarter - g.sqrt() * time, k)).asin();
    let error = |n: usize, angle: f64| {
        let mut system = chain(1, 1.0, |_| 1.0, 0.0, 1);
        system.particles.position[1] = Point3::new(widest.sin(), 0.0, -widest.cos());
        system.settings.gravity = Vector3::new(0.0, 0.0, -g);
        (0..n).for_each(|_| system.step(&[], time / n as f64).expect("finite"));
        (system.particles.position[1] - Point3::new(angle.sin(), 0.0, -angle.cos())).norm()
    };
    let errors = [400, 800, 1600, 3200].map(|n| error(n, angle));
    println!(
        "pendulum: exact {angle:.6} rad, errors {errors}, orders {:.4?}",
        orders(&errors),
        errors = powers(&errors)
    );
    assert!(off_order(&errors, 1.0) <= T4);
    // Control: a pendulum of small oscillations.
    let small = widest * (g.sqrt() * time).cos();
    assert!(!(off_order(&[400, 800, 1600].map(|n| error(n, small)), 1.0) <= T4));
}

#[test]
fn p18_substeps_of_a_block_converge_with_order_one() {
    let mesh = box_surface([0.2, 0.1, 0.1], 0.1);
    let time = 0.1;
    let run = |n: usize, soft: f64| {
        let mut system: System = elastic(&mesh, 0.05, [soft, 10.0, 1e-7], 1);
        for (w, p) in system.particles.inverse_mass.iter_mut().zip(&mesh.vertices) {
            if p.x < -0.09 {
                *w = 0.0;
            }
        }
        system.settings.gravity = Vector3::new(0.0, 0.0, -9.81);
        (0..n).for_each(|_| system.step(&[], time / n as f64).expect("finite"));
        system.particles.position
    };
    let n = 200;
    let reference = run(64 * 4 * n, 1e-2);
    let error = |n: usize, soft: f64| {
        worst(
            run(n, soft)
                .iter()
                .zip(&reference)
                .map(|(x, y)| (x - y).norm()),
        )
    };
    let errors = [n, 2 * n, 4 * n].map(|n| error(n, 1e-2));
    println!(
        "block: errors {errors} m, orders {:.4?}",
        orders(&errors),
        errors = powers(&errors)
    );
    assert!(errors[2] > 1e-9, "no error to measure");
    assert!(off_order(&errors, 1.0) <= T5);
    assert!(
        !(off_order(&[n, 2 * n, 4 * n].map(|n| error(n, 1.05e-2)), 1.0) <= T5),
        "control: another stiffness"
    );
}
