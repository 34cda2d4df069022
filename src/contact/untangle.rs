//! Overlap of muscle and bone at the start, removed gently before the motion begins.

use super::response::Contacts;
use super::{Placed, surface::Surface};
use crate::constraints::{Batch, EnclosedVolume, Project, bending, bending::Bending, distance::Distance, order::Order};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::{greatest, median};
use crate::mesh::topology::Topology;
use crate::particles::Particles;

/// Rounds of pushing and relaxing at most.
const ROUNDS: usize = 60;

/// What untangling did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Untangled {
    /// Deepest vertex before [m].
    pub overlap: f64,
    /// Farthest that a vertex was moved [m].
    pub moved: f64,
    /// Change of the enclosed volume, relative.
    pub volume_change: f64,
    /// Vertices that were nearer to a bone than the contact thickness.
    pub vertices: usize,
}

/// Moves the vertices of `mesh` out of the obstacles to `thickness` [m], its edges and angles relaxing with it, so
/// that the start is free of overlap; returns what it did. A mesh that is clear is not touched.
pub fn untangle(mesh: &mut TriangleMesh, placed: &[Placed], obstacles: &[usize], thickness: f64) -> Untangled {
    let mut report = Untangled::default();
    for &o in obstacles {
        let inverse = placed[o].now.inverse();
        for v in &mesh.vertices {
            if let Some(c) = placed[o].obstacle.closest(&(inverse * v)) {
                report.overlap = report.overlap.max(-c.distance);
                report.vertices += usize::from(c.distance < thickness);
            }
        }
    }
    if report.vertices == 0 && !bone_inside(mesh, placed, obstacles) {
        return report;
    }
    let before = mesh.clone();
    let mut particles = Particles::at_rest(mesh.vertices.clone(), vec![1.0; mesh.vertices.len()]);
    let mut contacts = Contacts::new(mesh, &particles, placed, obstacles.to_vec(), thickness, 0.0);
    let mut shape = Shape::new(mesh);
    for _ in 0..ROUNDS {
        contacts.begin_step(&particles.position);
        shape.relax(&mut particles);
        contacts.project(placed, &mut particles);
        contacts.end_step(placed, &mut particles, 1.0);
    }
    // Contact has the last word.
    for _ in 0..ROUNDS {
        contacts.begin_step(&particles.position);
        contacts.project(placed, &mut particles);
        contacts.end_step(placed, &mut particles, 1.0);
    }
    mesh.vertices = particles.position;
    let moved = |(a, b): (&nalgebra::Point3<f64>, &nalgebra::Point3<f64>)| (a - b).norm();
    report.moved = greatest(mesh.vertices.iter().zip(&before.vertices).map(moved));
    report.volume_change = mesh.volume() / before.volume() - 1.0;
    report
}

fn bone_inside(mesh: &TriangleMesh, placed: &[Placed], obstacles: &[usize]) -> bool {
    let surface = Surface::new(mesh);
    let bounds = mesh.bounding_box();
    obstacles.iter().any(|&o| {
        let points = placed[o].obstacle.guards().iter().map(|p| placed[o].now * p);
        points
            .filter(|p| bounds.contains(p))
            .any(|p| surface.nearest(&p, f64::MAX).is_some_and(|on| on.closest.distance < 0.0))
    })
}

/// The constraints that keep the shape while vertices are pushed out.
struct Shape {
    stretch: Batch<Distance, 2>,
    bending: Batch<Bending, 4>,
    volume: EnclosedVolume,
}

impl Shape {
    fn new(mesh: &TriangleMesh) -> Self {
        let topology = Topology::new(mesh);
        let count = mesh.vertices.len();
        let lengths = topology.edge_lengths(mesh);
        let edges: Vec<Distance> =
            topology.edges.iter().zip(&lengths).map(|(&points, &rest)| Distance { points, rest }).collect();
        let hinges: Vec<Bending> = topology
            .hinges
            .iter()
            .map(|&points| Bending::new(points, bending::dihedral(&points.map(|p| mesh.vertices[p as usize]))))
            .collect();
        // Soft against contact: a full projection of angles would throw slivers about.
        let soft = median(lengths.clone()).unwrap_or(0.0).powi(2);
        Self {
            stretch: Batch::new(edges.clone(), vec![1.0; edges.len()], Order::Coloured, count, &[]),
            bending: Batch::new(
                hinges.clone(),
                vec![8.0 / soft.max(f64::MIN_POSITIVE); hinges.len()],
                Order::Coloured,
                count,
                &[],
            ),
            volume: EnclosedVolume::new(&mesh.triangles, count, mesh.volume(), 0.0),
        }
    }

    fn relax(&mut self, particles: &mut Particles) {
        for _ in 0..2 {
            self.stretch.begin_step();
            self.bending.begin_step();
            self.stretch.project(particles, 1.0);
            self.bending.project(particles, 1.0);
        }
        // An unsolvable volume leaves the shape as it is; the change is reported.
        let _ = self.volume.project(particles, 1.0);
    }
}
