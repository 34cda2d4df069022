//! Bodies for the tests of several properties.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{Batch, Bending, Distance, EnclosedVolume, SweepOrder, dihedral};
use pliant::contact::{Obstacle, PosedObstacle, Surface};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::{StepSettings, System};

/// No gravity, no damping, no limit.
pub fn settings(iterations: u32) -> StepSettings {
    StepSettings {
        iterations,
        gravity: Vector3::zeros(),
        velocity_factor: 1.0,
        force_factor: 1.0,
        speed_limit: f64::MAX,
    }
}

/// Edges of a mesh at rest.
pub fn edges(mesh: &TriangleMesh) -> Vec<Distance> {
    let topology = Topology::new(mesh);
    let lengths = topology.edge_lengths(mesh);
    topology
        .edges
        .iter()
        .zip(&lengths)
        .map(|(&points, &rest)| Distance { points, rest })
        .collect()
}

/// Hinges of a mesh at rest.
pub fn hinges(mesh: &TriangleMesh) -> Vec<Bending> {
    let at = |p: u32| mesh.vertices[p as usize];
    let hinge = |&points: &[u32; 4]| Bending::new(points, dihedral(&points.map(at)));
    Topology::new(mesh).hinges.iter().map(hinge).collect()
}

/// A batch in colour order with one compliance for all.
pub fn batch<C: pliant::constraints::Constraint<K>, const K: usize>(
    all: Vec<C>,
    compliance: f64,
    order: SweepOrder,
    count: usize,
) -> Batch<C, K> {
    let compliance = vec![compliance; all.len()];
    Batch::new(all, compliance, order, count, &[])
}

/// A closed body with edges, hinges and conserved volume; a mass of `mass` [kg] at each vertex.
pub fn elastic(mesh: &TriangleMesh, mass: f64, compliance: [f64; 3], iterations: u32) -> System {
    let count = mesh.vertices.len();
    let particles = Particles::at_rest(mesh.vertices.clone(), vec![1.0 / mass; count]);
    let mut system = System::new(particles, settings(iterations));
    system.elastic.push(Box::new(batch(
        edges(mesh),
        compliance[0],
        SweepOrder::Coloured,
        count,
    )));
    system.elastic.push(Box::new(batch(
        hinges(mesh),
        compliance[1],
        SweepOrder::Coloured,
        count,
    )));
    system.volume = Some(EnclosedVolume::new(
        &mesh.triangles,
        count,
        mesh.volume(),
        compliance[2],
    ));
    system
}

/// A chain of `links` links of `length` [m] each along -z from the origin; particle 0 is fixed.
pub fn chain(
    links: usize,
    length: f64,
    mass: impl Fn(usize) -> f64,
    compliance: f64,
    iterations: u32,
) -> System {
    let position = (0..=links)
        .map(|i| Point3::new(0.0, 0.0, -length * i as f64))
        .collect();
    let inverse = (0..=links)
        .map(|i| if i == 0 { 0.0 } else { 1.0 / mass(i) })
        .collect();
    let mut system = System::new(Particles::at_rest(position, inverse), settings(iterations));
    let all: Vec<Distance> = (0..links as u32)
        .map(|i| Distance {
            points: [i, i + 1],
            rest: length,
        })
        .collect();
    system.elastic.push(Box::new(batch(
        all,
        compliance,
        SweepOrder::Stored,
        links + 1,
    )));
    system
}

/// An obstacle at rest at the origin.
pub fn still(mesh: &TriangleMesh) -> PosedObstacle {
    let obstacle: Arc<dyn Obstacle> = Arc::new(Surface::new(mesh));
    PosedObstacle {
        name: "bone".into(),
        obstacle,
        before: Isometry3::identity(),
        now: Isometry3::identity(),
    }
}

/// The bits of all positions and velocities.
pub fn bits(particles: &Particles) -> Vec<u64> {
    let position = particles.position.iter().flat_map(|x| [x.x, x.y, x.z]);
    let velocity = particles.velocity.iter().flat_map(|v| [v.x, v.y, v.z]);
    position.chain(velocity).map(f64::to_bits).collect()
}

/// Positions as plain numbers. All must be finite.
pub fn finite(particles: &Particles) -> bool {
    particles.first_non_finite().is_none()
}
