//! One sweep of pliant compared with one substep of rapier3d on the same mesh and elements, one
//! thread, alternately.
//!
//! Both fix one end of a tube and bend the rest by gravity. The time of a rapier3d substep is the
//! increment by a second, third ... substep (its step also has work that happens once: broad phase,
//! islands). The mean over a step of three substeps is printed too, with that work included.
//! Pliant's step is prediction, one sweep over all edges, hinges and the enclosed volume, and
//! velocities.

#[path = "../../measured/lines.rs"]
mod lines;

use std::time::Instant;

use lines::{compare, quick, result};

use nalgebra::Vector3;
use pliant::constraints::{Batch, EnclosedVolume, SweepOrder};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::mesh::shapes::icosphere;
use pliant::Particles;
use pliant::solvers::{StepSettings, System, stiffness};
use rapier3d::prelude::{PhysicsWorld, SoftBodyBuilder, SoftBodyHandle, Vector};

const ROUNDS: usize = 40;
/// Number of rapier3d substeps in the longer step.
const SUBSTEPS: usize = 3;
const GRAVITY: f64 = -0.5;
const HELD: f64 = -0.98;

fn ours(mesh: &TriangleMesh, topology: &Topology) -> System {
    let count = mesh.vertices.len();
    let inverse_mass = mesh.vertices.iter().map(|p| if p.x < HELD { 0.0 } else { 1e3 }).collect();
    let settings = StepSettings {
        iterations: 1,
        gravity: Vector3::new(0.0, GRAVITY, 0.0),
        velocity_factor: 0.99,
        force_factor: 1.0,
        speed_limit: f64::INFINITY,
    };
    let mut system = System::new(Particles::at_rest(mesh.vertices.clone(), inverse_mass), settings);
    let (edges, stiff) = stiffness::edges(mesh, topology, 1e4);
    system.elastic.push(Box::new(Batch::new(edges, stiffness::compliance(&stiff), SweepOrder::Coloured, count, &[])));
    let (hinges, stiff) = stiffness::hinges(mesh, topology, 1e-3);
    system.elastic.push(Box::new(Batch::new(hinges, stiffness::compliance(&stiff), SweepOrder::Coloured, count, &[])));
    system.volume = Some(EnclosedVolume::new(&mesh.triangles, count, mesh.volume(), 0.0));
    system
}

fn theirs(mesh: &TriangleMesh, substeps: usize) -> (PhysicsWorld, SoftBodyHandle) {
    let mut world = PhysicsWorld::new();
    world.gravity = Vector::new(0.0, GRAVITY as f32, 0.0);
    world.integration_parameters.num_solver_iterations = substeps;
    world.integration_parameters.dt = 0.01;
    let vertices = mesh.vertices.iter().map(|p| Vector::new(p.x as f32, p.y as f32, p.z as f32)).collect();
    let held = mesh.vertices.iter().enumerate().filter(|(_, p)| p.x < HELD).map(|(i, _)| i as u32);
    let builder = SoftBodyBuilder::trimesh(vertices, mesh.triangles.clone())
        .expect("a mesh")
        .shape_matching(false)
        .volume_preservation(true)
        .self_contacts(false)
        .no_surface_collider()
        .can_sleep(false)
        .particle_mass(1e-3)
        .pinned_particles(held.collect::<Vec<_>>());
    let PhysicsWorld { soft_bodies, bodies, colliders, .. } = &mut world;
    let handle = soft_bodies.insert(builder, bodies, colliders);
    (world, handle)
}

/// Root mean square of the edges' strain.
fn strain(topology: &Topology, mesh: &TriangleMesh, at: impl Fn(u32) -> Vector3<f64>) -> f64 {
    let lengths = topology.edge_lengths(mesh);
    let of = |(&[a, b], l): (&[u32; 2], &f64)| ((at(a) - at(b)).norm() / l - 1.0).powi(2);
    (topology.edges.iter().zip(&lengths).map(of).sum::<f64>() / lengths.len() as f64).sqrt()
}

/// Checks both results and prints the relative volume errors and the strains of both.
fn check(mesh: &TriangleMesh, topology: &Topology, x: &System, theirs: &(PhysicsWorld, SoftBodyHandle)) {
    let position = &x.particles.position;
    let now = TriangleMesh { vertices: position.clone(), triangles: mesh.triangles.clone() };
    let volume = now.volume() / mesh.volume() - 1.0;
    let stretch = strain(topology, mesh, |v| position[v as usize].coords);
    assert!(x.particles.first_non_finite().is_none());
    assert!(volume.abs() <= 1e-6 && stretch < 0.05, "pliant: volume {volume:e}, strain {stretch}");
    let body = &theirs.0.soft_bodies[theirs.1];
    let of_body = f64::from(body.volume() / body.rest_volume()) - 1.0;
    let at = |v: u32| {
        let p = body.particle_position(v as usize);
        Vector3::new(f64::from(p.x), f64::from(p.y), f64::from(p.z))
    };
    let stretch_of_body = strain(topology, mesh, at);
    assert!(of_body.abs() <= 2e-3 && stretch_of_body < 0.05, "rapier3d: volume {of_body:e}, strain {stretch_of_body}");
    result("peers.volume.pliant", volume.abs(), "1");
    result("peers.volume.rapier3d", of_body.abs(), "1");
    result("peers.strain.pliant", stretch, "1");
    result("peers.strain.rapier3d", stretch_of_body, "1");
}

fn seconds(deed: impl FnOnce()) -> f64 {
    let begin = Instant::now();
    deed();
    begin.elapsed().as_secs_f64()
}

fn measure() {
    let (mesh, rounds) = if quick() { (icosphere(1.0, 3), 2) } else { (icosphere(1.0, 5), ROUNDS) };
    let topology = Topology::new(&mesh);
    let mut system = ours(&mesh, &topology);
    let (mut one, mut more) = (theirs(&mesh, 1), theirs(&mesh, SUBSTEPS));
    let body = &one.0.soft_bodies[one.1];
    assert_eq!(body.edges().len(), topology.edges.len(), "the same edges");
    assert_eq!(body.dihedrals().len(), topology.hinges.len(), "the same hinges");
    let (mut step, mut substep, mut whole, mut third) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for round in 0..rounds + 5 {
        let a = seconds(|| (0..4).for_each(|_| system.step(&[], 2.5e-3).expect("finite"))) / 4.0;
        let b = seconds(|| one.0.step());
        let c = seconds(|| more.0.step());
        if round >= 5 {
            step.push(a);
            whole.push(b);
            third.push(c / SUBSTEPS as f64);
            substep.push((c - b) / (SUBSTEPS - 1) as f64);
        }
    }
    check(&mesh, &topology, &system, &more);
    for (name, times) in [("substep", substep), ("third", third), ("whole", whole)] {
        compare(&format!("peers.{name}"), ["rapier3d", "pliant"], &[times, step.clone()]);
    }
    for (effect, (seconds, calls)) in &system.clock.effects {
        result(&format!("peers.pliant.{effect}"), seconds / *calls as f64 * 1e3, "ms");
    }
}

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread").install(measure);
}
