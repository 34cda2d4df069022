//! Several bodies: conserved quantities of a step, friction, voxels as obstacles, driven
//! bodies, sheets.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use pliant::mesh::{Topology, TriangleMesh, shapes};
use pliant::springs::SpringSystem;
use pliant::testing::internals::contact::broad_phase::{BitGrid, Fill};
use pliant::testing::internals::springs::contact::{Bodies, CollidingBody, Drive, Response};
use pliant::testing::internals::springs::stiffness::{Negative, along_edges, membrane};
use pliant::testing::internals::springs::{TrueVolume, mass};

use super::moved;

/// A closed surface of springs, with an inner force that conserves its volume.
pub fn filled(mesh: &TriangleMesh, density: f64, e2: f64, bulk: f64) -> SpringSystem {
    let masses = mass::by_area(mesh, density * mesh.volume()).expect("masses");
    let mut system = SpringSystem::new(mesh.vertices.clone(), masses).expect("a system");
    let topology = Topology::new(mesh);
    let edges = membrane(mesh, &topology, e2, 1.0 / 3.0, Negative::Clamp);
    system
        .add(along_edges(mesh, &topology, &edges.stiffness).expect("springs"))
        .expect("points");
    system
        .add(TrueVolume::new(&mesh.vertices, &mesh.triangles, bulk, None, &[]).expect("a volume"))
        .expect("points");
    system
}

fn soft(mesh: &TriangleMesh) -> CollidingBody {
    CollidingBody::soft(filled(mesh, 1000.0, 50.0, 1e5), &mesh.triangles).expect("a body")
}

fn momentum(bodies: &Bodies) -> Vector3<f64> {
    let of = |s: &SpringSystem| {
        s.mass()
            .iter()
            .zip(&s.velocity)
            .map(|(m, v)| v * *m)
            .sum::<Vector3<f64>>()
    };
    bodies.bodies.iter().map(|b| of(&b.system)).sum()
}

fn spin(bodies: &Bodies) -> Vector3<f64> {
    let of = |s: &SpringSystem| {
        (0..s.len())
            .map(|i| s.position[i].coords.cross(&s.velocity[i]) * s.mass()[i])
            .sum::<Vector3<f64>>()
    };
    bodies.bodies.iter().map(|b| of(&b.system)).sum()
}

fn energy(bodies: &Bodies) -> f64 {
    bodies
        .bodies
        .iter()
        .map(|b| b.system.energy().total())
        .sum()
}

fn centre(body: &CollidingBody) -> Point3<f64> {
    let s = &body.system;
    let total: f64 = s.mass().iter().sum();
    Point3::from(
        s.mass()
            .iter()
            .zip(&s.position)
            .map(|(m, x)| x.coords * *m)
            .sum::<Vector3<f64>>()
            / total,
    )
}

/// Two balls of 2 cm that collide off centre.
pub fn two_balls(put_out: f64) -> Bodies {
    let ball = shapes::icosphere(0.01, 2);
    let offset = Vector3::new(0.0205, 0.005, 0.003);
    let mut both = Bodies::new(vec![soft(&ball), soft(&moved(&ball, offset))]);
    both.bodies[0]
        .system
        .velocity
        .iter_mut()
        .for_each(|v| v.x = 0.3);
    both.bodies[1]
        .system
        .velocity
        .iter_mut()
        .for_each(|v| v.x = -0.2);
    both.put_out = put_out;
    both
}

#[test]
fn balls_that_meet_keep_momentum_and_spin_and_gain_no_energy() {
    let mut both = two_balls(0.0);
    let dt = 0.25 * both.limit();
    let (p, l, e) = (momentum(&both), spin(&both), energy(&both));
    let (mut most, mut met, mut deepest) = (e, 0, 0.0_f64);
    let size = 0.5 * p.norm().max(1e-3);
    for _ in 0..(0.1 / dt) as usize {
        let found = both.step(dt).expect("a step");
        met += found.impulses;
        deepest = deepest.max(found.depth);
        most = most.max(energy(&both));
        assert!((momentum(&both) - p).norm() <= 1e-12 * size, "momentum");
        // Touching points coincide, or lie along the impulse.
        assert!(
            (spin(&both) - l).norm() <= 1e-12 * size * 0.02,
            "{:?}",
            spin(&both) - l
        );
    }
    assert!(met > 100, "{met} impulses");
    // The integrator's own energy oscillates by about w dt; contact only dissipates energy.
    assert!(most <= e * 1.02, "{most} of {e}");
    let apart = both.bodies[1].system.velocity[0] - both.bodies[0].system.velocity[0];
    assert!(
        apart.x > 0.0 || centre(&both.bodies[1]).x > centre(&both.bodies[0]).x,
        "{apart}"
    );
    assert!(deepest <= 0.02 * 0.02, "{deepest} m");
    // Control: without contact they pass through each other.
    let mut through = two_balls(0.0);
    through.sweeps = 0;
    (0..(0.1 / dt) as usize).for_each(|_| assert!(through.step(dt).is_ok()));
    assert!(centre(&through.bodies[0]).x > centre(&through.bodies[1]).x);
}

/// A block of 2 cm that slides on a rigid plate under gravity.
fn sliding(mu: f64, speed: f64) -> Bodies {
    let block = moved(
        &shapes::box_surface([0.02; 3], 0.005),
        Vector3::z() * 0.010_02,
    );
    let plate = moved(
        &shapes::box_surface([0.4, 0.1, 0.02], 0.05),
        Vector3::new(0.1, 0.0, -0.01),
    );
    let mut body = soft(&block);
    let system = &mut body.system;
    system.load = system
        .mass()
        .iter()
        .map(|m| Vector3::new(0.0, 0.0, -9.81 * m))
        .collect();
    system.velocity.iter_mut().for_each(|v| v.x = speed);
    let mut all = Bodies::new(vec![
        body,
        CollidingBody::rigid(&plate, Drive::still()).expect("a plate"),
    ]);
    all.response = Response::new(0.0, mu).expect("in range");
    all
}

#[test]
fn a_block_slides_as_coulomb_says() {
    let (mu, speed, time) = (0.3, 0.5, 0.08);
    let mean = |all: &Bodies| {
        let s = &all.bodies[0].system;
        s.mass()
            .iter()
            .zip(&s.velocity)
            .map(|(m, v)| v * *m)
            .sum::<Vector3<f64>>()
            / s.mass().iter().sum::<f64>()
    };
    let run = |mu: f64| {
        let mut all = sliding(mu, speed);
        let dt = 0.5 * all.limit();
        let steps = (time / dt).round() as usize;
        (0..steps).for_each(|_| assert!(all.step(dt).is_ok()));
        let lowest = all.bodies[0]
            .system
            .position
            .iter()
            .map(|p| p.z)
            .fold(f64::INFINITY, f64::min);
        (mean(&all), steps as f64 * dt, lowest)
    };
    let (left, after, lowest) = run(mu);
    // The block falls 20 um first and bounces slightly on its own springs. The push of the floor
    // follows from gravity and the upward velocity.
    let expected = speed - mu * (9.81 * after + left.z);
    // A few contacts at the edge of the block have the normal of that edge instead of the
    // floor's.
    assert!(
        (left.x - expected).abs() <= 0.01 * (speed - expected),
        "{} for {expected}",
        left.x
    );
    assert!((-1e-5..=1e-4).contains(&lowest), "{lowest}");
    // Without friction the block keeps its speed, except for the effect of a bottom that is not
    // quite flat. Edges of the plate that pass through its sides would take a fifteenth of the
    // speed if only normals of triangles counted.
    let free = run(0.0).0.x;
    assert!((free - speed).abs() <= 1e-4 * speed, "{free}");
}

#[test]
fn solid_voxels_hold_what_falls_on_them() {
    let ball = moved(&shapes::icosphere(0.01, 2), Vector3::z() * 0.02);
    let ground = shapes::box_surface([0.06, 0.06, 0.01], 0.02);
    let fall = |obstacle: bool| {
        let mut body = soft(&ball);
        body.system.load = body
            .system
            .mass()
            .iter()
            .map(|m| Vector3::new(0.0, 0.0, -9.81 * m))
            .collect();
        body.system.damping = 2e-4;
        let mut all = Bodies::new(vec![body]);
        if obstacle {
            all.obstacles
                .push(Arc::new(BitGrid::new(&ground, 24, Fill::Touch)));
        }
        let dt = 0.5 * all.limit();
        let mut inside = 0;
        (0..(0.12 / dt) as usize).for_each(|_| inside += all.step(dt).expect("a step").inside);
        let lowest = all.bodies[0]
            .system
            .position
            .iter()
            .map(|p| p.z)
            .fold(f64::INFINITY, f64::min);
        (lowest, inside)
    };
    let (lowest, inside) = fall(true);
    // The top of the boxes is at most one box, of 0.06/21 m, above the ground.
    assert!(
        inside > 0 && (0.0049..=0.005 + 0.003).contains(&lowest),
        "{lowest} after {inside}"
    );
    assert!(fall(false).0 < -0.01, "control: nothing holds it");
}

#[test]
fn driven_bodies_go_their_way_and_keep_their_shape() {
    let mesh = shapes::icosphere(0.01, 1);
    let drive = Drive {
        linear: Vector3::new(0.1, 0.0, 0.02),
        angular: Vector3::new(0.0, 3.0, 4.0),
        centre: Point3::new(0.001, 0.0, 0.002),
    };
    let mut one = Bodies::new(vec![CollidingBody::rigid(&mesh, drive).expect("a body")]);
    assert_eq!(one.limit(), f64::INFINITY);
    let before = one.bodies[0].volume();
    (0..1000).for_each(|_| assert!(one.step(1e-3).is_ok()));
    let now = one.bodies[0].drive().expect("driven");
    assert!((now.centre - drive.centre - drive.linear).norm() <= 1e-13);
    assert!((one.bodies[0].volume() - before).abs() <= 1e-12 * before);
    // After a second: rotated by 5 about (0, 0.6, 0.8).
    let axis = nalgebra::Unit::new_normalize(drive.angular);
    let turn = nalgebra::Rotation3::from_axis_angle(&axis, 5.0);
    for (x, from) in one.bodies[0].system.position.iter().zip(&mesh.vertices) {
        assert!((x - (now.centre + turn * (from - drive.centre))).norm() <= 1e-13);
    }
    let v = one.bodies[0].system.velocity[0];
    assert!(
        v != Vector3::zeros(),
        "points have the velocity that contact needs"
    );
}

#[test]
fn a_sheet_that_has_no_inside_is_carried_by_a_ball() {
    // The source's 7.1, coarser: a ball pushes the middle of a sheet with a fixed border.
    let n = 24;
    let mut sheet = TriangleMesh::default();
    for i in 0..=n {
        for j in 0..=n {
            sheet.vertices.push(
                Point3::new(f64::from(i) / 24.0 - 0.5, f64::from(j) / 24.0 - 0.5, 0.0) * 0.04,
            );
            if i < n && j < n {
                let a = (i * (n + 1) + j) as u32;
                let b = a + n as u32 + 1;
                sheet.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
            }
        }
    }
    let topology = Topology::new(&sheet);
    let masses = mass::of_sheet(&sheet, 1000.0, 1e-3).expect("masses");
    let mut system = SpringSystem::new(sheet.vertices.clone(), masses).expect("a system");
    let stiffness = membrane(&sheet, &topology, 100.0, 1.0 / 3.0, Negative::Clamp).stiffness;
    system
        .add(along_edges(&sheet, &topology, &stiffness).expect("springs"))
        .expect("points");
    system.pin(
        topology
            .boundary_edges()
            .iter()
            .flat_map(|&e| topology.edges[e as usize]),
    );
    system.damping = 1e-3;
    let area = sheet.area();
    let body = CollidingBody::soft(system, &sheet.triangles).expect("a sheet");
    // The ball begins slightly below the sheet. The first crossing edge has its longer part
    // above the sheet.
    let ball = moved(
        &super::sphere(16, 15, 0.008),
        Vector3::new(3e-4, 2e-4, -0.0081),
    );
    let drive = Drive::along(Vector3::z() * 0.2);
    let mut all = Bodies::new(vec![
        body,
        CollidingBody::rigid(&ball, drive).expect("a ball"),
    ]);
    let dt = 0.25 * all.limit();
    (0..(0.008 / 0.2 / dt) as usize).for_each(|_| assert!(all.step(dt).is_ok()));
    let x = &all.bodies[0].system.position;
    let top = x.iter().map(|p| p.z).fold(0.0, f64::max);
    let reached = all.bodies[1].system.position[0].z;
    assert!(
        (reached - 0.0079).abs() <= 1e-4 && (top - reached).abs() <= 8e-4,
        "{top} for {reached}"
    );
    let now = TriangleMesh {
        vertices: x.clone(),
        ..sheet
    };
    assert!(now.area() > 1.05 * area, "{} of {area}", now.area());
}
