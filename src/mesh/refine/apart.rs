//! Ends crossings of a remeshed surface whose original does not cross: long triangles deviate from it, and
//! the two sides of a thin part can deviate into each other.

use crate::mesh::crossings::crossings_of;
use crate::mesh::repair::{LONGEST_RIM, RepairOptions, repair};
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceTree, TriangleMesh};

/// How far a vertex of a triangle that crosses moves in a round, in target edge lengths.
const STEP: f64 = 0.02;
/// Greatest number of rounds: a vertex then has moved by a fifth of an edge, twice what a side deviates.
const ROUNDS: usize = 10;
/// How far from a crossing a part is cut out, in target edge lengths.
const REACHES: [f64; 3] = [0.5, 1.0, 1.5];

/// The vertices of triangles that cross, ascending.
fn crossed(mesh: &TriangleMesh) -> Vec<u32> {
    let pairs = crossings_of(&mesh.vertices, &mesh.triangles).pairs;
    let triangles = pairs.iter().flatten();
    let mut all: Vec<u32> = triangles
        .flat_map(|&t| mesh.triangles[t as usize])
        .collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// Whether a closed surface crosses itself.
pub(super) fn crosses(mesh: &TriangleMesh) -> bool {
    Topology::new(mesh).is_closed() && !crossed(mesh).is_empty()
}

/// What becomes of crossings.
pub(super) enum Outcome {
    /// There are none.
    Clear,
    /// They are ended by motions of vertices.
    Parted,
    /// Motions do not end them, and nothing has moved.
    Left,
}

/// Moves the vertices of triangles that cross along their normals until nothing crosses: outward where the
/// body is thin, inward where a gap is.
pub(super) fn part(mesh: &mut TriangleMesh, edge_length: f64) -> Outcome {
    let first = crossed(mesh);
    if first.is_empty() {
        return Outcome::Clear;
    }
    let outward = STEP * edge_length * mesh.volume().signum();
    for step in [outward, -outward] {
        let (mut moved, mut crossing) = (mesh.clone(), first.clone());
        for _ in 0..ROUNDS {
            let normals = moved.vertex_normals();
            for v in crossing {
                moved.vertices[v as usize] += step * normals[v as usize];
            }
            crossing = crossed(&moved);
            if crossing.is_empty() {
                *mesh = moved;
                return Outcome::Parted;
            }
        }
    }
    Outcome::Left
}

/// A closed surface without what lies around its crossings, such as a hair that is thinner than a tenth of
/// an edge, and closed again. `None` if it crosses still, or is of another kind.
pub(super) fn without(mesh: &TriangleMesh, edge_length: f64) -> Option<TriangleMesh> {
    let before = Topology::new(mesh);
    let places: Vec<_> = crossed(mesh)
        .into_iter()
        .map(|v| mesh.vertices[v as usize])
        .collect();
    REACHES.iter().find_map(|reach| {
        let reach = reach * edge_length;
        let is_near = |v: &u32| {
            let x = mesh.vertices[*v as usize];
            places.iter().any(|place| (x - place).norm() <= reach)
        };
        let all = mesh.triangles.iter();
        let rest = TriangleMesh {
            vertices: mesh.vertices.clone(),
            triangles: all.filter(|t| !t.iter().any(is_near)).copied().collect(),
        };
        let options = RepairOptions {
            close_holes: LONGEST_RIM,
            // The end of a hair.
            keep_largest: before.components().count == 1,
            ..RepairOptions::default()
        };
        let closed = repair(&rest, &[], &options).mesh;
        let topology = Topology::new(&closed);
        let is_sound = topology.is_closed()
            && topology.is_oriented()
            && topology.non_manifold_vertices(&closed).is_empty()
            && topology.components().count == before.components().count
            && topology.euler_characteristic() == before.euler_characteristic();
        (is_sound && crossed(&closed).is_empty()).then_some(closed)
    })
}

/// Greatest distance of a vertex of `mesh` from another surface.
pub(super) fn farthest(mesh: &TriangleMesh, from: &TriangleMesh) -> f64 {
    let tree = SurfaceTree::new(&from.vertices, &from.triangles);
    let distances = mesh.vertices.iter().map(|v| {
        let closest = tree.closest(v, f64::INFINITY);
        closest.map_or(0.0, |c| c.distance)
    });
    crate::mesh::measures::max_or_nan(distances)
}
