//! The three tetrahedron scenes and the chain, as run by a user.

use pliant::mesh::measures::{area, volume};
use pliant::scene::builtin::load;
use pliant::simulation::Simulation;

use crate::bodies::finite;
use crate::tolerances::{T7, T10, worst};

fn simulation(name: &str, overrides: &[&str]) -> Simulation {
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    let scene = load(name, &overrides).unwrap_or_else(|e| panic!("{}", e.terse()));
    Simulation::new(scene).expect("a scene that runs")
}

/// Largest relative error of an edge over all frames.
fn edge_error(overrides: &[&str]) -> f64 {
    let mut sim = simulation("distance", overrides);
    worst((0..600).map(|_| {
        sim.step_frame();
        assert!(finite(&sim.bodies[0].system.particles));
        sim.measure()[0].edge_stretch_max
    }))
}

#[test]
fn distance_keeps_the_edges_of_a_swinging_tetrahedron() {
    // Greatest of 600 frames in the digest; its run has another order of the edges, so 1.5 times is
    // allowed.
    for (iterations, digest) in [(1, 2.0e-3), (3, 1.0e-4), (10, 8.5e-8)] {
        let error = edge_error(&[&format!("iterations={iterations}")]);
        assert!(
            error <= 1.5 * digest,
            "{iterations} iterations: {error:e} for {digest:e}"
        );
    }
    assert!(
        !(edge_error(&["pbd.stretch=0.5", "iterations=3"]) <= 1.5e-4),
        "control: soft edges are as good"
    );
}

#[test]
fn shape_grows_evenly() {
    let mut sim = simulation("shape", &[]);
    let expected = [(60, 1.144), (120, 1.507), (240, 2.588), (480, 5.179)];
    let start = sim.bodies[0].edges[0].rest;
    for frame in 1..=480 {
        sim.step_frame();
        let body = &sim.bodies[0];
        let x = &body.system.particles.position;
        let lengths = body
            .edges
            .iter()
            .map(|e| (x[e.points[0] as usize] - x[e.points[1] as usize]).norm());
        let ratios: Vec<f64> = lengths.map(|l| l / start).collect();
        let spread = worst(ratios.iter().map(|r| (r / ratios[0] - 1.0).abs()));
        assert!(spread <= 1e-4, "frame {frame}: {ratios:?}");
        if let Some((_, ratio)) = expected.iter().find(|(f, _)| *f == frame) {
            // Three printed digits, and the residual of three sweeps.
            assert!(
                (ratios[0] - ratio).abs() <= 2e-3 * ratio,
                "frame {frame}: {} for {ratio}",
                ratios[0]
            );
        }
    }
}

#[test]
fn volume_flattens_at_constant_volume() {
    let mut sim = simulation("volume", &[]);
    let mut last = f64::INFINITY;
    for frame in 1..=480 {
        sim.step_frame();
        let body = &sim.bodies[0];
        let x = &body.system.particles.position;
        let v = volume(x, &body.rest.triangles);
        assert!(
            (v / body.rest_volume - 1.0).abs() <= T7,
            "frame {frame}: {v}"
        );
        let thickness = 3.0 * v / area(x, &body.rest.triangles);
        assert!(
            thickness < last,
            "frame {frame}: thickness {last} to {thickness}"
        );
        last = thickness;
    }
    assert!(last < 0.3, "hardly flatter: {last}");
    let mut off = simulation("volume", &["effects.volume=off", "effects.stretch=on"]);
    (0..60).for_each(|_| off.step_frame());
    let body = &off.bodies[0];
    let v = volume(&body.system.particles.position, &body.rest.triangles);
    assert!(
        !((v / body.rest_volume - 1.0).abs() <= T7),
        "control: the volume is kept without its effect"
    );
}

#[test]
fn chain_shows_the_order_of_a_sweep() {
    let errors = |overrides: &[&str]| {
        let mut sim = simulation("chain", overrides);
        sim.step_frame();
        let body = &sim.bodies[0];
        let x = &body.system.particles.position;
        let error = |e: &pliant::constraints::Distance| {
            ((x[e.points[0] as usize] - x[e.points[1] as usize]).norm() - e.rest) / 0.5
        };
        body.edges.iter().map(error).collect::<Vec<f64>>()
    };
    let off = |a: &[f64], b: &[f64]| worst(a.iter().zip(b).map(|(a, b)| (a - b).abs()));
    let loaded = [0.0, 1.0 / 32.0, 1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0];
    let found = errors(&[]);
    assert!(off(&found, &loaded) <= T10, "{found:?}");
    let stored = errors(&["order=stored"]);
    assert!(
        off(&stored, &[0.0, 0.0, 0.0, 0.5, 0.0]) <= T10,
        "{stored:?}"
    );
}
