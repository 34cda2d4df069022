//! A soft body and a moving bone, without a scene file: a bone presses into a ball of soft tissue.
//!
//! The body has springs along its edges, hinges between its triangles, a volume that it keeps, and contact with the
//! bone. All numbers are in SI units.

use std::error::Error;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use pliant::mesh::Inside;
use pliant::mesh::measures::volume;
use pliant::mesh::shapes::icosphere;
use pliant::solvers::{StepSettings, stiffness};
use pliant::{
    Batch, Bending, Contacts, Distance, EnclosedVolume, Particles, PosedObstacle, Surface,
    SweepOrder, System, Topology, TriangleMesh,
};

/// Mass of the body [kg].
const MASS: f64 = 0.5;
/// Stiffness of the surface in its plane [N/m] and against bending [N m].
const STIFFNESS: [f64; 2] = [200.0, 1e-3];
/// Distance that the body keeps from the bone [m].
const THICKNESS: f64 = 1e-3;
/// Time step [s].
const DT: f64 = 1.0 / 120.0;

/// Runs the example.
pub fn main() -> Result<(), Box<dyn Error>> {
    // The body is a ball of 5 cm, the bone a ball of 2 cm. Every mesh of triangles can take their place.
    let body = icosphere(0.05, 3);
    let bone = icosphere(0.02, 2);

    // The bone begins 1 cm to the right of the body.
    let start = Isometry3::translation(0.08, 0.0, 0.0);
    let mut placed = vec![PosedObstacle {
        name: "bone".into(),
        obstacle: Arc::new(Surface::new(&bone)),
        before: start,
        now: start,
    }];
    let mut system = soft_body(&body, &placed);

    // The bone moves 3 cm to the left in half a second: 2 cm into the ball.
    for step in 1..=60 {
        let moved = 0.03 * f64::from(step) / 60.0;
        placed[0].before = placed[0].now;
        placed[0].now = Isometry3::translation(0.08 - moved, 0.0, 0.0);
        system.step(&placed, DT)?;
    }

    // The body keeps its volume.
    let x = &system.particles.position;
    let error = volume(x, &body.triangles) / body.volume() - 1.0;
    assert!(error.abs() <= 1e-9, "the volume is off by {error:e}");

    // No vertex of the body is inside the bone, and none of the bone inside the body. This test is exact, and it does
    // not use the code of the contact.
    let bone_now: Vec<Point3<f64>> = bone.vertices.iter().map(|p| placed[0].now * p).collect();
    assert_eq!(inside(x, &bone_now, &bone), 0);
    assert_eq!(inside(&bone_now, x, &body), 0);

    // The same bone would be inside the body without contact.
    assert!(inside(&bone_now, &body.vertices, &body) > 0);
    Ok(())
}

/// A body with all effects on it.
fn soft_body(body: &TriangleMesh, placed: &[PosedObstacle]) -> System {
    let count = body.vertices.len();
    // The leftmost centimetre of the body is held: its inverse mass is 0.
    let inverse_mass = body
        .vertices
        .iter()
        .map(|p| match p.x < -0.04 {
            true => 0.0,
            false => count as f64 / MASS,
        })
        .collect();
    let settings = StepSettings {
        iterations: 5,
        gravity: Vector3::zeros(),
        velocity_factor: 0.95,
        force_factor: 1.0,
        speed_limit: 10.0,
    };
    let particles = Particles::at_rest(body.vertices.clone(), inverse_mass);
    let mut system = System::new(particles, settings);

    // Constraints at rest in the shape of the mesh. The stiffness of each follows from that of the material, so that a
    // finer mesh is as stiff.
    let topology = Topology::new(body);
    let (edges, k) = stiffness::edges(body, &topology, STIFFNESS[0]);
    let (hinges, b) = stiffness::hinges(body, &topology, STIFFNESS[1]);
    let [k, b] = [k, b].map(|stiffness| stiffness::compliance(&stiffness));
    let edges = Batch::<Distance, 2>::new(edges, k, SweepOrder::Coloured, count, &[]);
    let hinges = Batch::<Bending, 4>::new(hinges, b, SweepOrder::Coloured, count, &[]);
    system.elastic.push(Box::new(edges));
    system.elastic.push(Box::new(hinges));

    // A compliance of 0: the volume is exact.
    let target = body.volume();
    system.volume = Some(EnclosedVolume::new(&body.triangles, count, target, 0.0));

    // Contact with obstacle 0 of `placed`, with a coefficient of friction of 0.2.
    let obstacles = vec![0];
    let contacts = Contacts::new(body, &system.particles, placed, obstacles, THICKNESS, 0.2);
    system.contacts = Some(contacts);
    system
}

/// Number of points inside the closed surface of `mesh` with its vertices at `x`.
fn inside(points: &[Point3<f64>], x: &[Point3<f64>], mesh: &TriangleMesh) -> usize {
    let inside = Inside::new(x, &mesh.triangles);
    points.iter().filter(|p| inside.winding(p) != 0).count()
}
