//! Removal of overlap between muscle and bone before the motion begins.

use nalgebra::Isometry3;

use super::response::Contacts;
use super::{Obstacle, PosedObstacle, Projection, surface::Surface};
use crate::constraints::{
    Batch, EnclosedVolume, Project, bending, bending::Bending, distance::Distance,
    order::SweepOrder,
};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::{max_or_nan, median};
use crate::mesh::topology::Topology;
use crate::particles::Particles;

/// Greatest number of rounds of correction and relaxation.
const ROUNDS: usize = 60;

/// Measures of the removal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Untangled {
    /// Greatest depth of a vertex before [m].
    pub overlap: f64,
    /// Greatest displacement of a vertex [m].
    pub moved: f64,
    /// Relative change of the enclosed volume.
    pub volume_change: f64,
    /// Number of vertices nearer to a bone than the contact thickness.
    pub vertices: usize,
}

/// A removal that moves a vertex farther than this many times the overlap with the contact thickness
/// does not end.
const FAR: f64 = 5.0;

impl Untangled {
    /// The distance beyond which a removal does not end [m].
    pub(crate) fn farthest(&self, thickness: f64) -> f64 {
        FAR * (self.overlap + thickness)
    }
}

/// Moves the vertices of `mesh` out of the obstacles to `thickness` [m] while its edges and angles
/// relax, so that the start has no overlap. Returns the measures. A mesh without overlap is
/// unchanged.
pub fn untangle(
    mesh: &mut TriangleMesh,
    placed: &[PosedObstacle],
    obstacles: &[usize],
    thickness: f64,
) -> Untangled {
    let closest: Vec<Option<Projection>> = obstacles
        .iter()
        .flat_map(|&o| {
            let inverse = placed[o].now.inverse();
            mesh.vertices
                .iter()
                .map(move |v| placed[o].obstacle.closest(&(inverse * v)))
        })
        .collect();
    let found = overlap(&closest, thickness);
    let inside = |surface: &Surface| {
        obstacles
            .iter()
            .any(|&o| is_sample_inside(surface, &*placed[o].obstacle, &placed[o].now))
    };
    if found.vertices == 0 && !inside(&Surface::new(mesh)) {
        return found;
    }
    push_out(mesh, found, placed, obstacles, thickness)
}

/// Greatest depth of vertices in obstacles and the number nearer than `thickness` [m], from their
/// nearest points.
pub(crate) fn overlap<'a>(
    closest: impl IntoIterator<Item = &'a Option<Projection>>,
    thickness: f64,
) -> Untangled {
    let mut report = Untangled::default();
    for c in closest.into_iter().flatten() {
        report.overlap = report.overlap.max(-c.distance);
        report.vertices += usize::from(c.distance < thickness);
    }
    report
}

/// The same as [`untangle`] for a mesh with overlap; `report` contains the overlap.
pub(crate) fn push_out(
    mesh: &mut TriangleMesh,
    mut report: Untangled,
    placed: &[PosedObstacle],
    obstacles: &[usize],
    thickness: f64,
) -> Untangled {
    let before = mesh.clone();
    let mut particles = Particles::at_rest(mesh.vertices.clone(), vec![1.0; mesh.vertices.len()]);
    let mut contacts = Contacts::new(mesh, &particles, placed, obstacles.to_vec(), thickness, 0.0);
    let mut shape = Shape::new(mesh);
    let moved = |(a, b): (&nalgebra::Point3<f64>, &nalgebra::Point3<f64>)| (a - b).norm();
    let farthest =
        |x: &[nalgebra::Point3<f64>]| max_or_nan(x.iter().zip(&before.vertices).map(moved));
    let most = report.farthest(thickness);
    for _ in 0..ROUNDS {
        if !(farthest(&particles.position) <= most) {
            break;
        }
        contacts.begin_step(&particles.position);
        shape.relax(&mut particles);
        contacts.project(placed, &mut particles);
        contacts.end_step(placed, &mut particles, 1.0);
    }
    // Contact comes last.
    for _ in 0..ROUNDS {
        if !(farthest(&particles.position) <= most) {
            break;
        }
        contacts.begin_step(&particles.position);
        contacts.project(placed, &mut particles);
        contacts.end_step(placed, &mut particles, 1.0);
    }
    mesh.vertices = particles.position;
    report.moved = farthest(&mesh.vertices);
    report.volume_change = mesh.volume() / before.volume() - 1.0;
    report
}

/// True if a sample point of an obstacle at `pose` is inside a muscle's surface.
pub(crate) fn is_sample_inside(
    surface: &Surface,
    obstacle: &dyn Obstacle,
    pose: &Isometry3<f64>,
) -> bool {
    let bounds = surface.bounding_box();
    let points = obstacle.contact_samples().iter().map(|p| pose * p);
    points.filter(|p| bounds.contains(p)).any(|p| {
        surface
            .nearest(&p, f64::MAX)
            .is_some_and(|on| on.closest.distance < 0.0)
    })
}

/// The constraints that keep the shape during the removal.
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
        let edges: Vec<Distance> = topology
            .edges
            .iter()
            .zip(&lengths)
            .map(|(&points, &rest)| Distance { points, rest })
            .collect();
        let hinges: Vec<Bending> = topology
            .hinges
            .iter()
            .map(|&points| {
                Bending::new(
                    points,
                    bending::dihedral(&points.map(|p| mesh.vertices[p as usize])),
                )
            })
            .collect();
        // Soft against contact: a full projection of angles would displace slivers far.
        let soft = median(lengths.clone()).unwrap_or(0.0).powi(2);
        Self {
            stretch: Batch::new(
                edges.clone(),
                vec![1.0; edges.len()],
                SweepOrder::Coloured,
                count,
                &[],
            ),
            bending: Batch::new(
                hinges.clone(),
                vec![8.0 / soft.max(f64::MIN_POSITIVE); hinges.len()],
                SweepOrder::Coloured,
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
        // A volume without solution leaves the shape as it is; the report contains the change.
        let _ = self.volume.project(particles, 1.0);
    }
}
