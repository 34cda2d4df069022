//! Orders, energies and equilibria of the step (P37 to P41).

use nalgebra::{Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{Batch, Distance, Project, SweepOrder};
use pliant::solvers::System;

use crate::bodies::{batch, chain};
use crate::tolerances::{T4, T9, T10, T11, T14, worst};

/// A mass of 1 kg on a spring of `stiffness` [N/m] and rest length 10 m, released 0.1 m below its
/// equilibrium along -z.
fn oscillator(stiffness: f64) -> System {
    let mut system = chain(1, 10.0, |_| 1.0, 1.0 / stiffness, 1);
    system.particles.position[1].z = -10.1;
    system
}

fn elongation(system: &System) -> f64 {
    -10.0 - system.particles.position[1].z
}

#[test]
fn p37_the_oscillator_converges_with_order_one() {
    let omega = 10.0_f64;
    let period = std::f64::consts::TAU / omega;
    // Slightly more than a quarter of the period, where neither amplitude nor phase error vanishes.
    let time = 0.3 * period;
    let error = |n: usize| {
        let mut system = oscillator(omega * omega);
        (0..n).for_each(|_| system.step(&[], time / n as f64).expect("finite"));
        (elongation(&system) - 0.1 * (omega * time).cos()).abs()
    };
    let errors: Vec<f64> = [400, 800, 1600, 3200].map(error).to_vec();
    let orders: Vec<f64> = errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect();
    assert!(
        worst(orders[1..].iter().map(|o| (o - 1.0).abs())) <= T4,
        "orders {orders:?}"
    );
    // Control: an error that does not decrease has no order.
    assert!(!(worst([1.0_f64, 1.0].map(|r| (r.log2() - 1.0).abs())) <= T4));
}

#[test]
fn p39_one_substep_is_implicit_euler() {
    let (omega, h) = (7.0_f64, 0.02);
    let mut system = oscillator(omega * omega);
    let (mut x, mut v, mut explicit) = (0.1_f64, 0.0_f64, (0.1_f64, 0.0_f64));
    let decay = 1.0 / (1.0 + (omega * h).powi(2)).sqrt();
    let size = |x: f64, v: f64| (x * x + (v / omega).powi(2)).sqrt();
    let start = size(x, v);
    for step in 1..=200 {
        system.step(&[], h).expect("finite");
        v = (v - h * omega * omega * x) / (1.0 + (omega * h).powi(2));
        x += h * v;
        explicit = (
            explicit.0 + h * explicit.1,
            explicit.1 - h * omega * omega * explicit.0,
        );
        // Relative to the 10 m of the stored position.
        assert!(
            (elongation(&system) - x).abs() <= 10.0 * T10,
            "step {step}: {} and {x}",
            elongation(&system)
        );
        let expected = start * decay.powi(step);
        assert!(
            (size(x, v) - expected).abs() <= T10 * start,
            "amplification of step {step}"
        );
    }
    assert!(
        !((elongation(&system) - explicit.0).abs() <= 10.0 * T10),
        "control: explicit Euler is as good"
    );
}

/// Kinetic and elastic energy of a straight chain of springs.
fn energy(system: &System, stiffness: f64, rest: f64) -> f64 {
    let p = &system.particles;
    let kinetic: f64 = p
        .velocity
        .iter()
        .zip(&p.inverse_mass)
        .filter(|(_, w)| **w > 0.0)
        .map(|(v, w)| v.norm_squared() / w)
        .sum();
    let elastic: f64 = p
        .position
        .windows(2)
        .map(|x| ((x[1] - x[0]).norm() - rest).powi(2) * stiffness)
        .sum();
    0.5 * (kinetic + elastic)
}

#[test]
fn p39_energy_of_an_undamped_chain_never_rises() {
    let (stiffness, rest) = (50.0, 1.0);
    let mut system = chain(4, rest, |_| 0.5, 1.0 / stiffness, 400);
    system
        .particles
        .position
        .iter_mut()
        .enumerate()
        .for_each(|(i, p)| p.z -= 0.02 * (i * i) as f64);
    let mut last = energy(&system, stiffness, rest);
    let first = last;
    for step in 0..200 {
        system.step(&[], 0.02).expect("finite");
        let now = energy(&system, stiffness, rest);
        // Lengths of about 1 m are stored to an ulp, so energies to stiffness times that times the
        // strain.
        assert!(
            now <= last * (1.0 + T11) + stiffness * T11 * 0.3,
            "step {step}: {last} to {now}"
        );
        last = now;
    }
    assert!(
        last < 0.5 * first && first > 0.1,
        "{first} to {last}: implicit Euler damps"
    );
    // Control: a negative damping is detected.
    system.settings.velocity_factor = 1.1;
    let before = energy(&system, stiffness, rest);
    (0..50).for_each(|_| system.step(&[], 0.002).expect("finite"));
    assert!(energy(&system, stiffness, rest) > before);
}

#[test]
fn a_hanging_chain_comes_to_its_analytic_length() {
    let (n, k, m, g) = (20_usize, 1e3, 0.01, 9.81);
    let expected = m * g * (n * (n + 1)) as f64 / (2.0 * k);
    assert!((expected - 0.020_601).abs() <= T14);
    let tip = |k: f64, damped: bool| {
        let mut system = chain(n, 0.05, |_| m, 1.0 / k, 200);
        system.settings.gravity = Vector3::new(0.0, 0.0, -g);
        // Damping of the velocity changes the path, not the equilibrium: it excludes gravity.
        system.settings.velocity_factor = if damped { 0.99 } else { 1.0 };
        (0..1500).for_each(|_| system.step(&[], 0.01).expect("finite"));
        -1.0 - system.particles.position[n].z
    };
    for damped in [false, true] {
        let found = tip(k, damped);
        assert!(
            (found - expected).abs() <= T9,
            "{found} for {expected}, damped: {damped}"
        );
    }
    assert!(
        !((tip(0.99 * k, false) - expected).abs() <= T9),
        "control: another stiffness gives the same"
    );
}

/// Every order of a sweep over a chain.
const ORDERS: [SweepOrder; 4] = [
    SweepOrder::Stored,
    SweepOrder::Reversed,
    SweepOrder::FromLoadedEnd,
    SweepOrder::Coloured,
];

// A straight chain, where C is linear: rotating edges make multipliers depend on the path, by about
// 1e-7 of the length.
#[test]
fn p40_a_taut_chain_has_one_solution_whatever_the_order() {
    let solve = |order: SweepOrder, ends: f64, bent: f64| {
        let n = 11;
        let position = (0..n)
            .map(|i| Point3::new(ends * i as f64 / 10.0, bent * (i % 3) as f64, 0.0))
            .collect();
        let inverse = (0..n)
            .map(|i| {
                if i == 0 || i == 10 {
                    0.0
                } else {
                    1.0 + i as f64
                }
            })
            .collect();
        let mut particles = Particles::at_rest(position, inverse);
        particles.position[10].y = 0.0;
        let all: Vec<Distance> = (0..10)
            .map(|i| Distance {
                points: [i, i + 1],
                rest: 0.1,
            })
            .collect();
        let mut batch = Batch::<Distance, 2>::new(all, vec![1e-4; 10], order, n, &[10]);
        (0..20_000).for_each(|_| batch.project(&mut particles, 0.1));
        let taut = particles
            .position
            .windows(2)
            .all(|x| (x[1] - x[0]).norm() > 0.1);
        (particles.position, taut)
    };
    let apart = |ends: f64, bent: f64| {
        let (reference, taut) = solve(SweepOrder::Stored, ends, bent);
        let off = worst(ORDERS.iter().flat_map(|&o| {
            let other = solve(o, ends, bent).0;
            reference
                .iter()
                .zip(other)
                .map(|(a, b)| (a - b).norm())
                .collect::<Vec<_>>()
        }));
        (off, taut)
    };
    let (off, taut) = apart(1.2, 0.0);
    assert!(taut, "the premise does not hold");
    assert!(off <= T9, "{off:e}");
    let (off, taut) = apart(0.8, 0.01);
    assert!(
        !taut && !(off <= T9),
        "control: a slack chain has many solutions, {off:e}"
    );
}

/// Errors of the edges of the chain of six after one sweep, the last point displaced by 1.
fn one_sweep(order: SweepOrder) -> Vec<f64> {
    let mut position: Vec<Point3<f64>> = (0..6)
        .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
        .collect();
    position[5].x += 1.0;
    let mut particles = Particles::at_rest(position, vec![1.0; 6]);
    let all: Vec<Distance> = (0..5)
        .map(|i| Distance {
            points: [i, i + 1],
            rest: 1.0,
        })
        .collect();
    Batch::<Distance, 2>::new(all, vec![0.0; 5], order, 6, &[5]).project(&mut particles, 1.0);
    particles
        .position
        .windows(2)
        .map(|x| (x[1] - x[0]).norm() - 1.0)
        .collect()
}

#[test]
fn p41_the_chain_of_six() {
    let from_loaded = [0.0, 1.0 / 32.0, 1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0];
    let errors = one_sweep(SweepOrder::FromLoadedEnd);
    let halves = one_sweep(SweepOrder::Stored);
    let off = |a: &[f64], b: &[f64]| worst(a.iter().zip(b).map(|(a, b)| (a - b).abs()));
    assert!(off(&errors, &from_loaded) <= T10, "{errors:?}");
    assert!(
        off(&halves, &[0.0, 0.0, 0.0, 0.5, 0.0]) <= T10,
        "{halves:?}"
    );
    assert!(!(off(&halves, &from_loaded) <= T10));
}

#[test]
fn residual_falls_with_sweeps_and_a_full_projection_leaves_none() {
    let x = [0.0, 2.0, 5.0, 6.0].map(|x| Point3::new(x, 0.0, 0.0));
    let mut particles = Particles::at_rest(x.to_vec(), vec![1.0, 3.0, 1.0, 1.0]);
    let all = vec![
        Distance {
            points: [0, 1],
            rest: 1.0,
        },
        Distance {
            points: [2, 3],
            rest: 1.0,
        },
    ];
    let mut one = batch(all, 0.0, SweepOrder::Stored, 4);
    assert!((one.residual(&particles, 1.0).max - 1.0 / 2.0_f64.sqrt()).abs() <= T10);
    one.project(&mut particles, 1.0);
    assert!(one.residual(&particles, 1.0).max <= T10);
    particles.position[0].x = f64::NAN;
    assert!(
        !(one.residual(&particles, 1.0).max <= T10),
        "a NaN must show"
    );
}
