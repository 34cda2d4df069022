//! Exact detection of the defects of a surface, with their repairs.
//!
//! Counts are topological. Exact signs of the doubles as stored ([`crate::mesh::predicates`])
//! decide whether a triangle has area and whether two triangles intersect, so no tolerance and no
//! unit enters. Only slivers have a threshold, an angle.

mod finding;

pub use finding::{Finding, FindingKind, FindingPlace, Repair};
use nalgebra::Point3;

use super::boundary::{Rim, rims};
use super::closest::SurfaceTree;
use super::coincident::{first_in_place, same_corners};
use super::crossings::{Crossed, Crossings, LISTED, self_crossings};
use super::measures::{Aabb, smallest_angle, volume};
use super::orientation::Orientation;
use super::topology::Topology;
use super::{TriangleMesh, predicates};

/// Least angle of a triangle that is no sliver \[rad\]: 1 degree, where the triangle is 57 times as
/// long as high.
pub const SLIVER: f64 = std::f64::consts::PI / 180.0;

/// All counts of a surface; lengths are in the unit of its coordinates.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Health {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of edges.
    pub edges: usize,
    /// Number of connected components.
    pub components: usize,
    /// Number of boundary loops: walks along edges with one triangle.
    pub boundary_loops: usize,
    /// Edges with one triangle.
    pub boundary_edges: usize,
    /// Edges with more than two triangles.
    pub non_manifold_edges: usize,
    /// Vertices where surfaces touch in a point.
    pub non_manifold_vertices: usize,
    /// Edges whose two triangles have opposite orientations.
    pub inconsistent_edges: usize,
    /// True if no component is one-sided, so that a consistent orientation exists.
    pub orientable: bool,
    /// Euler characteristic V - E + F of the vertices with triangles.
    pub euler_characteristic: i64,
    /// Total number of handles; `None` where the surface is not manifold or one-sided.
    pub genus: Option<i64>,
    /// Triangles with a smallest angle below 1 degree, without those of zero area.
    pub slivers: usize,
    /// Triangles with exactly collinear corners.
    pub zero_area: usize,
    /// Triangles beyond the first with the same three corners.
    pub duplicate_triangles: usize,
    /// Vertices beyond the first at exactly the same position.
    pub duplicate_vertices: usize,
    /// Vertices without triangles.
    pub unused_vertices: usize,
    /// Pairs of triangles that intersect where they are not joined.
    pub self_intersections: usize,
    /// True if all pairs were tested.
    pub self_intersections_complete: bool,
    /// Enclosed volume; for an open surface the volume of the cones from the centre of its box.
    pub volume: f64,
    /// Area.
    pub area: f64,
    /// Lowest corner of the bounding box.
    pub lowest: [f64; 3],
    /// Highest corner of the bounding box.
    pub highest: [f64; 3],
    /// Defects; those that reject a simulation come first.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub findings: Vec<Finding>,
}

impl Health {
    /// Examines a surface with valid indices and finite coordinates.
    pub fn of(mesh: &TriangleMesh) -> Self {
        Self::with_lines(mesh, &[])
    }

    /// The same as [`Self::of`]; vertices of `lines` count as used.
    pub fn with_lines(mesh: &TriangleMesh, lines: &[Vec<u32>]) -> Self {
        let mut parts = Parts::of(mesh);
        let mut on_line = vec![false; mesh.vertices.len()];
        lines
            .iter()
            .flatten()
            .for_each(|v| on_line[*v as usize] = true);
        parts.unused.retain(|v| !on_line[*v as usize]);
        let mut health = parts.counts(mesh);
        health.findings = finding::all(&parts, mesh, &health);
        health
    }

    /// True if a simulation accepts the surface as a muscle: closed, manifold along edges, oriented
    /// outward.
    pub fn is_fit(&self) -> bool {
        self.findings.iter().all(|f| !f.kind.refuses())
    }

    /// Longest side of the bounding box.
    pub fn length(&self) -> f64 {
        (0..3)
            .map(|k| self.highest[k] - self.lowest[k])
            .fold(0.0, |a, b| if b <= a { a } else { b })
    }
}

/// The crossings of a surface with itself, without `skipped` triangles.
fn crossings(mesh: &TriangleMesh, names: &[u32], skipped: &[bool]) -> Crossings {
    let surface = Crossed {
        vertices: &mesh.vertices,
        triangles: &mesh.triangles,
        names,
        skipped,
        tree: &SurfaceTree::new(&mesh.vertices, &mesh.triangles),
    };
    self_crossings(surface, LISTED)
}

/// Input of the findings.
struct Parts {
    topology: Topology,
    orientation: Orientation,
    rims: Vec<Rim>,
    first_in_place: Vec<u32>,
    duplicates: Vec<Vec<u32>>,
    zero_area: Vec<u32>,
    slivers: Vec<u32>,
    crossings: Crossings,
    inconsistent: Vec<u32>,
    non_manifold_vertices: Vec<u32>,
    unused: Vec<u32>,
}

impl Parts {
    fn of(mesh: &TriangleMesh) -> Self {
        let topology = Topology::new(mesh);
        let corners = |t: &u32| mesh.corners(*t as usize);
        let all = 0..mesh.triangles.len() as u32;
        let zero_area: Vec<u32> = all
            .clone()
            .filter(|t| predicates::is_flat(&corners(t)))
            .collect();
        let is_sliver = |t: &u32| {
            smallest_angle(predicates::near_one(corners(t))) < SLIVER
                && zero_area.binary_search(t).is_err()
        };
        let slivers = all.filter(is_sliver).collect();
        let first_in_place = first_in_place(&mesh.vertices);
        let named: Vec<[u32; 3]> = mesh
            .triangles
            .iter()
            .map(|t| t.map(|v| first_in_place[v as usize]))
            .collect();
        let duplicates = same_corners(&named);
        let mut skipped = vec![false; mesh.triangles.len()];
        zero_area
            .iter()
            .chain(duplicates.iter().flat_map(|g| &g[1..]))
            .for_each(|t| skipped[*t as usize] = true);
        Self {
            crossings: crossings(mesh, &first_in_place, &skipped),
            orientation: Orientation::new(&topology, &mesh.triangles),
            rims: rims(&topology),
            inconsistent: topology.inconsistent_edges(),
            non_manifold_vertices: topology.non_manifold_vertices(mesh),
            unused: (0..mesh.vertices.len())
                .filter(|&v| topology.triangles_of_vertex(v).is_empty())
                .map(|v| v as u32)
                .collect(),
            topology,
            first_in_place,
            duplicates,
            zero_area,
            slivers,
        }
    }

    /// The enclosed volume. Vertices without triangles do not affect it, not even through the
    /// centre of the box.
    fn volume(&self, mesh: &TriangleMesh) -> f64 {
        let (Some(first), false) = (mesh.triangles.first(), self.unused.is_empty()) else {
            return mesh.volume();
        };
        let mut vertices = mesh.vertices.clone();
        self.unused
            .iter()
            .for_each(|v| vertices[*v as usize] = mesh.vertices[first[0] as usize]);
        volume(&vertices, &mesh.triangles)
    }

    fn counts(&self, mesh: &TriangleMesh) -> Health {
        let topology = &self.topology;
        let components = topology.components().count;
        let non_manifold_edges = topology.non_manifold_edges().len();
        let orientable = self.orientation.one_sided.is_none();
        let euler = topology.euler_characteristic();
        let manifold = non_manifold_edges == 0 && self.non_manifold_vertices.is_empty();
        // Each handle takes 2 from the Euler characteristic of a component, each boundary loop 1.
        let genus = (2 * components as i64 - self.rims.len() as i64 - euler) / 2;
        let bounds = if mesh.vertices.is_empty() {
            Aabb::of_points(&[Point3::origin()])
        } else {
            mesh.bounding_box()
        };
        Health {
            vertices: mesh.vertices.len(),
            triangles: mesh.triangles.len(),
            edges: topology.edges.len(),
            components,
            boundary_loops: self.rims.len(),
            boundary_edges: topology.boundary_edges().len(),
            non_manifold_edges,
            non_manifold_vertices: self.non_manifold_vertices.len(),
            inconsistent_edges: self.inconsistent.len(),
            orientable,
            euler_characteristic: euler,
            genus: (manifold && orientable).then_some(genus),
            slivers: self.slivers.len(),
            zero_area: self.zero_area.len(),
            duplicate_triangles: self.duplicates.iter().map(|g| g.len() - 1).sum(),
            duplicate_vertices: (0..mesh.vertices.len())
                .filter(|&v| self.first_in_place[v] != v as u32)
                .count(),
            unused_vertices: self.unused.len(),
            self_intersections: self.crossings.count,
            self_intersections_complete: self.crossings.complete,
            volume: self.volume(mesh),
            area: mesh.area(),
            lowest: bounds.min.into(),
            highest: bounds.max.into(),
            findings: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests;
