//! The source's cube (its 7.2): a sphere presses it from above, and its volume is constant.

use nalgebra::Vector3;
use pliant::contact::{Obstacle, Surface};
use pliant::mesh::{TriangleMesh, shapes};
use pliant::testing::internals::springs::contact::{Bodies, CollidingBody, Drive};

use super::bodies::filled;
use super::{moved, sphere};

/// Side of the cube and radius of the sphere [m].
const SIDE: f64 = 0.02;
const RADIUS: f64 = 0.01;
/// Distance and speed of the sphere [m], [m/s].
const PRESS: f64 = 0.004;
const SPEED: f64 = 0.1;
/// Greatest number of steps of half the stability limit.
const STEPS: usize = 4000;

/// Result of a run.
struct Pressed {
    /// Greatest relative change of volume in any step.
    volume: f64,
    /// Penetration of each body into the other at the end, and the greatest of all steps [m].
    inside: [f64; 2],
    /// Displacement of the centre of the top downwards, and of the sides outwards [m].
    down: f64,
    out: f64,
    steps: usize,
    rest: f64,
}

fn press(bulk: f64, steps: usize) -> Pressed {
    let cube = shapes::box_surface([SIDE; 3], SIDE / 8.0);
    let ball = moved(
        &sphere(12, 11, RADIUS),
        Vector3::z() * (0.5 * SIDE + RADIUS + 1e-5),
    );
    assert_eq!((cube.vertices.len(), cube.triangles.len()), (386, 768));
    assert_eq!((ball.vertices.len(), ball.triangles.len()), (134, 264));
    assert!(
        (ball.volume() - 3.932e-6).abs() <= 5e-10,
        "{}",
        ball.volume()
    );
    let mut system = filled(&cube, 1000.0, 20.0, bulk);
    system.damping = 2e-3;
    let bottom = cube
        .vertices
        .iter()
        .enumerate()
        .filter(|(_, p)| p.z < -0.499 * SIDE)
        .map(|(i, _)| i as u32);
    system.pin(bottom);
    let driven = CollidingBody::rigid(&ball, Drive::along(Vector3::z() * -SPEED)).expect("a ball");
    let mut both = Bodies::new(vec![
        CollidingBody::soft(system, &cube.triangles).expect("a cube"),
        driven,
    ]);
    let dt = 0.5 * both.limit();
    let (mut volume, mut deepest) = (0.0_f64, 0.0_f64);
    for step in 0..steps {
        if step as f64 * dt >= PRESS / SPEED {
            both.bodies[1]
                .set_drive(Drive::still())
                .expect("it is rigid");
        }
        let met = both.step(dt).expect("a step");
        deepest = deepest.max(met.depth);
        let change = both.bodies[0].volume() / cube.volume() - 1.0;
        volume = if change.abs() <= volume {
            volume
        } else {
            change.abs()
        };
    }
    let x = &both.bodies[0].system.position;
    let now = |k: usize| TriangleMesh {
        vertices: both.bodies[k].system.position.clone(),
        triangles: both.bodies[k].triangles().to_vec(),
    };
    let surfaces = [Surface::new(&now(0)), Surface::new(&now(1))];
    let depth = |k: usize| {
        let of = &both.bodies[1 - k].system.position;
        of.iter()
            .map(|p| -surfaces[k].closest(p).expect("triangles").distance)
            .fold(0.0, f64::max)
    };
    let top = cube
        .vertices
        .iter()
        .position(|p| p.z > 0.499 * SIDE && p.x.hypot(p.y) < 1e-9)
        .expect("a middle");
    Pressed {
        volume,
        inside: [depth(0).max(depth(1)), deepest],
        down: cube.vertices[top].z - x[top].z,
        out: x
            .iter()
            .map(|p| p.x.abs().max(p.y.abs()))
            .fold(0.0, f64::max)
            - 0.5 * SIDE,
        steps,
        rest: both.bodies[0].system.energy().kinetic,
    }
}

#[test]
fn a_cube_pressed_by_a_sphere_keeps_its_volume() {
    let found = press(1e6, STEPS);
    println!(
        "volume {:.2e}, inside {:?}, down {:.2e}, out {:.2e}, {} steps, {:.2e} J left",
        found.volume, found.inside, found.down, found.out, found.steps, found.rest
    );
    // The source's own lost 0.4 and 0.5 %.
    assert!(found.volume <= 1e-3, "{}", found.volume);
    // The cube was really compressed: the centre of the top is at the sphere's lowest point, and
    // the sides moved outwards.
    assert!((found.down - PRESS).abs() <= 0.05 * PRESS, "{}", found.down);
    assert!(found.out >= 2e-4, "{}", found.out);
    assert!(
        found.inside[0] <= 1e-4 * SIDE && found.inside[1] <= 5e-3 * SIDE,
        "{:?}",
        found.inside
    );
    // Control: with a thousandth of the modulus the volume changes.
    let soft = press(1e3, STEPS / 8);
    assert!(soft.volume > 5e-3, "{}", soft.volume);
}
