//! Chains at rest: suspended at one end, and the catenary.

use nalgebra::{Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{Distance, SweepOrder};
use pliant::solvers::System;

use super::rest::Body;
use super::{off_order, orders, powers};
use crate::bodies::{batch, settings};
use crate::tolerances::{T4, T9, T14, T16, T17, worst};

/// Length and span of the chain.
const LENGTH: f64 = 2.0;
const SPAN: f64 = 1.0;

/// Half of the last digit of the values in the literature's digest.
const DIGIT: f64 = 5e-10;

/// The root of an increasing function between `low` and `high`.
fn root(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if f(middle) < 0.0 {
            low = middle
        } else {
            high = middle
        }
    }
    0.5 * (low + high)
}

/// The parameter a of y = a cosh(x/a), and the sag, of an inextensible catenary.
fn catenary() -> (f64, f64) {
    let a = root(0.05, 10.0, |a| LENGTH - 2.0 * a * (SPAN / (2.0 * a)).sinh());
    (a, a * ((SPAN / (2.0 * a)).cosh() - 1.0))
}

/// Rest positions of a chain of `n` rigid links, with half of the mass of a link at each of its
/// ends, in closed form except for the horizontal tension H: link i has the slope (i + 1/2 -
/// n/2)/(n H), total weight 1.
fn links_at_rest(n: usize) -> Vec<Point3<f64>> {
    let length = LENGTH / n as f64;
    let slope = |i: usize, tension: f64| (i as f64 + 0.5 - n as f64 / 2.0) / (n as f64 * tension);
    let span = |tension: f64| {
        (0..n)
            .map(|i| length / slope(i, tension).hypot(1.0))
            .sum::<f64>()
    };
    let tension = root(1e-3, 1e3, |h| span(h) - SPAN);
    let mut at = vec![Point3::origin()];
    for i in 0..n {
        let s = slope(i, tension);
        at.push(at[i] + Vector3::new(1.0, 0.0, s) * (length / s.hypot(1.0)));
    }
    at
}

fn sag(x: &[Point3<f64>]) -> f64 {
    worst(x.iter().map(|p| -p.z))
}

/// Links of length `rest` between successive points, each of stiffness `k`.
fn links(n: usize, rest: f64, k: f64) -> (Vec<Distance>, Vec<f64>) {
    (
        (0..n as u32)
            .map(|i| Distance {
                points: [i, i + 1],
                rest,
            })
            .collect(),
        vec![k; n],
    )
}

/// The points of a triangle with two sides as long as the chain, `n` links along them.
fn triangle(n: usize) -> Vec<Point3<f64>> {
    let deep = (LENGTH * LENGTH - SPAN * SPAN).sqrt() / 2.0;
    let along = |i: usize| i as f64 / n as f64;
    (0..=n)
        .map(|i| {
            Point3::new(
                SPAN * along(i),
                0.0,
                -2.0 * deep * along(i).min(1.0 - along(i)),
            )
        })
        .collect()
}

/// A chain of `n` inextensible links of weight 1 at rest between its ends; the share `heavier` of
/// the weight is moved to the middle.
fn hung(n: usize, heavier: f64) -> Vec<Point3<f64>> {
    let mut x = triangle(n);
    for soft in [1.0, 10.0, 100.0, 1e4] {
        let mut body = Body::new(
            links(n, LENGTH / n as f64, soft * n as f64),
            n + 1,
            1.0 / n as f64,
        );
        body.held = vec![0, n];
        body.forces
            .iter_mut()
            .for_each(|f| f.z = -(1.0 - heavier) / n as f64);
        body.forces[n / 2].z -= heavier;
        if soft < 1e4 {
            body.rest(&mut x);
        } else {
            let strain = body.rest_without_stretch(&mut x);
            assert!(strain <= T17, "the chain is stretched by {strain:e}");
        }
    }
    x
}

#[test]
fn a_hanging_chain_has_its_printed_length() {
    let (n, k, weight) = (20_usize, 1e3, 0.01 * 9.81);
    let extension = |k: f64| {
        let mut body = Body::new(links(n, 0.05, k), n + 1, weight);
        body.held = vec![0];
        body.forces.iter_mut().for_each(|f| f.z = -weight);
        let mut x: Vec<Point3<f64>> = (0..=n)
            .map(|i| Point3::new(0.0, 0.0, -0.05 * i as f64))
            .collect();
        // An anchor keeps it upright while it carries no load.
        body.anchor = 1e-3 * k;
        body.rest(&mut x);
        body.anchor = 0.0;
        body.rest(&mut x);
        -1.0 - x[n].z
    };
    let exact = weight * (n * (n + 1)) as f64 / (2.0 * k);
    let found = extension(k);
    println!(
        "hanging chain: exact {exact:.6} m, error {:.1e} m",
        (found - exact).abs()
    );
    assert!((exact - 0.020_601).abs() <= T14);
    assert!((found - exact).abs() <= T9, "{found} for {exact}");
    assert!(
        !((extension(1.001 * k) - exact).abs() <= T9),
        "control: another stiffness"
    );
}

/// A chain of rigid links that fell from a triangle and came to rest by damped steps.
fn settled(n: usize, gravity: Vector3<f64>, dt: f64) -> Vec<Point3<f64>> {
    let inverse = (0..=n)
        .map(|i| if i == 0 || i == n { 0.0 } else { n as f64 })
        .collect();
    let mut system = System::new(Particles::at_rest(triangle(n), inverse), settings(200));
    system.settings.gravity = gravity;
    // Near the critical damping of the slowest mode.
    system.settings.velocity_factor = 1.0 - 5.0 * dt;
    let all = links(n, LENGTH / n as f64, 1.0).0;
    system
        .elastic
        .push(Box::new(batch(all, 0.0, SweepOrder::Stored, n + 1)));
    let steps = (10.0 / dt) as usize;
    (0..steps).for_each(|_| system.step(&[], dt).expect("finite"));
    system.particles.position
}

#[test]
fn the_catenary_has_its_printed_numbers() {
    let (a, deep) = catenary();
    let slope = (SPAN / (2.0 * a)).sinh().atan().to_degrees();
    assert!((a - 0.229_640_215).abs() <= DIGIT, "{a}");
    assert!((deep - 0.796_388_356).abs() <= DIGIT, "{deep}");
    assert!((slope - 77.066_82).abs() <= 5e-6, "{slope}");
}

#[test]
fn a_chain_at_rest_becomes_a_catenary() {
    let (_, exact) = catenary();
    let counts = [8, 16, 32, 64];
    let found = counts.map(|n| hung(n, 0.0));
    let off = |x: &[Point3<f64>]| {
        worst(
            x.iter()
                .zip(&links_at_rest(x.len() - 1))
                .map(|(x, y)| (x - y).norm()),
        )
    };
    let from_links = worst(found.iter().map(|x| off(x)));
    let errors = found.each_ref().map(|x| (sag(x) - exact).abs());
    println!(
        "catenary: exact sag {exact:.9}, errors {}, orders {:.4?}; {from_links:.1e} m from rigid links at rest",
        powers(&errors),
        orders(&errors)
    );
    assert!(from_links <= T17 * LENGTH, "{from_links:e}");
    assert!(off_order(&errors, 2.0) <= T4);
    let wrong = counts.map(|n| hung(n, 0.01));
    assert!(
        !(off(&wrong[0]) <= T17 * LENGTH),
        "control: a hundredth of the weight in the middle"
    );
    assert!(
        !(off_order(&wrong.map(|x| (sag(&x) - exact).abs()), 2.0) <= T4),
        "control: the same"
    );
}

#[test]
fn a_chain_by_steps_is_off_by_the_step_squared() {
    let down = Vector3::new(0.0, 0.0, -9.81);
    let off = |n: usize, gravity: Vector3<f64>, dt: f64| {
        worst(
            settled(n, gravity, dt)
                .iter()
                .zip(&links_at_rest(n))
                .map(|(x, y)| (x - y).norm()),
        )
    };
    // Two links have one free particle: nothing rotates, and its position is exact.
    assert!(off(2, down, 0.01) <= T17 * LENGTH);
    for n in [4, 6, 8] {
        let errors = [0.02, 0.01, 0.005].map(|dt| off(n, down, dt));
        println!(
            "chain of {n} by steps: errors {}, orders {:.4?}",
            powers(&errors),
            orders(&errors)
        );
        assert!(off_order(&errors, 2.0) <= T16);
    }
    let lean = Vector3::new(0.00981, 0.0, -9.81);
    assert!(
        !(off_order(&[0.02, 0.01, 0.005].map(|dt| off(4, lean, dt)), 2.0) <= T16),
        "control: gravity leans"
    );
}
