//! The enclosed volume is kept exactly, or balances its pressure (P36, acceptance numbers of the digest).

use nalgebra::{Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{EnclosedVolume, Project, SweepOrder, TetrahedronVolume};
use pliant::mesh::measures::volume;
use pliant::mesh::shapes::{icosphere, tetrahedron, tube};
use pliant::mesh::{Topology, TriangleMesh};

use crate::bodies::{batch, edges, elastic, finite};
use crate::tolerances::{T6, T7, T14, worst};

fn scaled(mesh: &TriangleMesh, by: f64) -> Particles {
    let count = mesh.vertices.len();
    Particles::at_rest(
        mesh.vertices.iter().map(|p| p * by).collect(),
        vec![1.0; count],
    )
}

/// One linear step x += w g (-C / sum w g^2) with the value and the gradient multiplied by the
/// given factors.
fn linear_step(mesh: &TriangleMesh, particles: &mut Particles, value: f64, gradient: f64) {
    let closed = EnclosedVolume::new(&mesh.triangles, mesh.vertices.len(), 0.0, 0.0);
    let (v, g) = closed.value_and_gradient(&particles.position);
    let c = v * value - mesh.volume();
    let weight: f64 = g.iter().map(|g| (g * gradient).norm_squared()).sum();
    particles
        .position
        .iter_mut()
        .zip(&g)
        .for_each(|(x, g)| *x += g * gradient * (-c / weight));
}

#[test]
fn numbers_of_the_tetrahedron() {
    let mesh = tetrahedron();
    assert!((mesh.volume() - 0.513_200).abs() <= T14);
    assert!(
        edges(&mesh)
            .iter()
            .all(|e| (e.rest - 1.632_993).abs() <= T14)
    );
    for hinge in crate::bodies::hinges(&mesh) {
        // A ridge: signed angle 109.4712 degrees, between outward normals; 70.5288 between the faces.
        assert!(
            (hinge.rest.abs().to_degrees() - 109.471_2).abs() <= 1e2 * T14,
            "{}",
            hinge.rest.to_degrees()
        );
        assert!((180.0 - hinge.rest.abs().to_degrees() - 70.528_8).abs() <= 1e2 * T14);
    }
}

#[test]
fn a_linear_projection_gives_the_printed_numbers_and_ours_lands_at_once() {
    let mesh = tetrahedron();
    let printed = [1.331, 1.02668, 1.00023, 1.000_000_02];
    let digits = [5e-4, 5e-6, 5e-6, 5e-9];
    let mut linear = scaled(&mesh, 1.1);
    let mut kind = scaled(&mesh, 1.1);
    let tet = TetrahedronVolume {
        points: [0, 1, 2, 3],
        rest: 0.0,
    };
    let sign =
        pliant::constraints::Constraint::value(&tet, &std::array::from_fn(|k| mesh.vertices[k]))
            .signum();
    let rest = sign * mesh.volume();
    let mut one = batch(
        vec![TetrahedronVolume { rest, ..tet }],
        0.0,
        SweepOrder::Stored,
        4,
    );
    for (expected, digit) in printed.into_iter().zip(digits) {
        for particles in [&linear, &kind] {
            let ratio = volume(&particles.position, &mesh.triangles) / mesh.volume();
            assert!((ratio - expected).abs() <= digit, "{ratio} for {expected}");
        }
        linear_step(&mesh, &mut linear, 1.0, 1.0);
        one.project(&mut kind, 1.0);
    }
    for scale in [0.3, 0.9, 1.1, 3.0] {
        let mut exact = scaled(&mesh, scale);
        EnclosedVolume::new(&mesh.triangles, 4, mesh.volume(), 0.0)
            .project(&mut exact, 1.0)
            .expect("a root");
        let off = volume(&exact.position, &mesh.triangles) / mesh.volume() - 1.0;
        assert!(off.abs() <= T7, "from scale {scale}: {off:e}");
    }
}

#[test]
fn the_printed_factors_fail() {
    let mesh = tetrahedron();
    // A06, A07: six volumes with a true rest volume: shrinks to a sixth, edges to 0.550.
    let mut printed = scaled(&mesh, 1.0);
    (0..100).for_each(|_| linear_step(&mesh, &mut printed, 6.0, 6.0));
    let ratio = volume(&printed.position, &mesh.triangles) / mesh.volume();
    assert!((ratio - 1.0 / 6.0).abs() <= T6, "{ratio}");
    assert!((ratio.cbrt() - 0.550).abs() <= 5e-4);
    // Value with 1/6, gradient without: 5/6 of a small error remains.
    let mut mixed = scaled(&mesh, 1.0 + 1e-6);
    linear_step(&mesh, &mut mixed, 1.0, 6.0);
    let left = (volume(&mixed.position, &mesh.triangles) / mesh.volume() - 1.0) / 3e-6;
    assert!((left - 5.0 / 6.0).abs() <= 1e-3, "{left}");
    // Control: the right factors leave no first-order error.
    let mut right = scaled(&mesh, 1.0 + 1e-6);
    linear_step(&mesh, &mut right, 1.0, 1.0);
    assert!((volume(&right.position, &mesh.triangles) / mesh.volume() - 1.0).abs() <= 1e-10);
}

#[test]
fn p36_the_volume_is_kept_through_twisting() {
    let mesh = tube(0.05, 0.3, 10);
    for pressure in [0.5, 1.0, 2.0] {
        let count = mesh.vertices.len();
        let mut system = elastic(&mesh, 1e-3, [1e-3, 1e2, 0.0], 1);
        let target = pressure * mesh.volume();
        system.volume = Some(EnclosedVolume::new(&mesh.triangles, count, target, 0.0));
        let end = mesh.vertices.iter().map(|p| p.x).fold(0.0, f64::max);
        let ends: Vec<usize> = (0..count)
            .filter(|&v| mesh.vertices[v].x.abs() > end - 1e-9)
            .collect();
        ends.iter()
            .for_each(|&v| system.particles.inverse_mass[v] = 0.0);
        let mut errors = Vec::new();
        for step in 0..1000 {
            // One end rotates to half a turn and back, twice.
            let angle = 1.5 * (f64::from(step) * 0.0126).sin();
            for &v in ends.iter().filter(|&&v| mesh.vertices[v].x > 0.0) {
                system.particles.position[v] =
                    nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), angle)
                        * mesh.vertices[v];
            }
            system.step(&[], 0.002).expect("finite");
            assert!(finite(&system.particles));
            errors.push((volume(&system.particles.position, &mesh.triangles) / target - 1.0).abs());
        }
        assert!(
            worst(errors.iter().copied()) <= T6,
            "pressure {pressure}: {}",
            worst(errors)
        );
    }
}

#[test]
fn without_the_constraint_twisting_loses_volume() {
    let mesh = tube(0.05, 0.3, 10);
    let mut twisted = mesh.vertices.clone();
    for p in &mut twisted {
        let angle = 1.5 * p.x / 0.3;
        *p = nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), angle) * *p;
    }
    assert!(!((volume(&twisted, &mesh.triangles) / mesh.volume() - 1.0).abs() <= T6));
}

#[test]
fn a_finite_bulk_modulus_balances_the_pressure_applied() {
    let mesh = icosphere(0.1, 2);
    let count = mesh.vertices.len();
    let (bulk, pressure, v0) = (2e4, 1e3, mesh.volume());
    let settle = |compliance: f64| {
        let mut particles = Particles::at_rest(mesh.vertices.clone(), vec![1e3; count]);
        let mut closed = EnclosedVolume::new(&mesh.triangles, count, v0, compliance);
        let gradient = EnclosedVolume::new(&mesh.triangles, count, 0.0, 0.0);
        // Small relative to the period of the breathing mode, 9 ms: the gradient is that of the
        // predicted shape.
        let dt = 4e-6;
        let mut velocity: Vec<Vector3<f64>> = vec![Vector3::zeros(); count];
        for _ in 0..20_000 {
            let start = particles.position.clone();
            // An external pressure: the force on a vertex is -p times the gradient of the volume.
            let (_, g) = gradient.value_and_gradient(&start);
            for k in 0..count {
                velocity[k] = velocity[k] * 0.994 - g[k] * (pressure * 1e3 * dt);
                particles.position[k] += velocity[k] * dt;
            }
            closed.begin_step();
            closed.project(&mut particles, dt).expect("a root");
            velocity
                .iter_mut()
                .enumerate()
                .for_each(|(k, v)| *v = (particles.position[k] - start[k]) / dt);
        }
        assert!(finite(&particles));
        volume(&particles.position, &mesh.triangles) / v0 - 1.0
    };
    // p = -K (V/V0 - 1).
    let strain = settle(v0 / bulk);
    assert!(
        (-bulk * strain / pressure - 1.0).abs() <= T6,
        "{}",
        -bulk * strain
    );
    assert!(
        !((-bulk * settle(6.0 * v0 / bulk) / pressure - 1.0).abs() <= T6),
        "control: six times softer"
    );
}

#[test]
fn the_volume_is_the_sum_of_tetrahedra() {
    let mesh = icosphere(1.0, 2);
    assert!(Topology::new(&mesh).is_closed());
    let apex = Point3::new(0.2, -0.1, 0.3);
    let cone = |&[a, b, c]: &[u32; 3]| {
        let [a, b, c] = [a, b, c].map(|i| mesh.vertices[i as usize] - apex);
        a.dot(&b.cross(&c)) / 6.0
    };
    let cones: Vec<f64> = mesh.triangles.iter().map(cone).collect();
    let size: f64 = cones.iter().map(|v| v.abs()).sum();
    assert!((cones.iter().sum::<f64>() - mesh.volume()).abs() <= 64.0 * f64::EPSILON * size);
}
