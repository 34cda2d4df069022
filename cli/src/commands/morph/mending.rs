//! Mends the surfaces of a morph: one piece, closed, turned outward, without handles.

use std::path::Path;

use nalgebra::Point3;

use super::Given;
use pliant::io::PointData;
use pliant::mesh::SurfaceTree;
use pliant::mesh::{LONGEST_RIM, RepairOptions, RepairStep, Topology, TriangleMesh, repair};

/// Least share of the area that mending has to keep: more in another piece is another body.
const KEPT: f64 = 0.8;

/// More handles are noise: a surface with them is refused.
const MOST_HANDLES: i64 = 50;

/// Surfaces that a sphere can be spread over.
pub(super) struct Mended {
    pub(super) surfaces: [Given; 2],
    /// The changes, a sentence for each surface with one.
    pub(super) notes: Vec<String>,
    /// Number of handles that were cut.
    pub(super) handles_cut: usize,
}

/// Mends what has a defect; a sound surface keeps its bits. With `solid`, a surface only has to
/// be closed: handles and pieces stay.
pub(super) fn mended(given: [Given; 2], paths: [&Path; 2], solid: bool) -> Mended {
    let (mut notes, mut handles_cut) = (Vec::new(), 0);
    let mut k = 0;
    let surfaces = given.map(|one| {
        let path = paths[k];
        k += 1;
        let is_fit = if solid { is_closed } else { is_sphere };
        if is_fit(&one.mesh) {
            return one;
        }
        let options = RepairOptions {
            close_holes: LONGEST_RIM,
            // Of any size: the surface has a map only without them.
            cut_handles: if solid { 0.0 } else { f64::MAX },
            keep_largest: !solid,
            merge_within: 0.0,
        };
        // Each handle takes a search over the whole surface.
        let closed = repair(
            &one.mesh,
            &[],
            &RepairOptions {
                cut_handles: 0.0,
                ..options
            },
        );
        if !solid && handles(&closed.mesh) > MOST_HANDLES {
            return one;
        }
        let found = repair(&one.mesh, &[], &options);
        let kept = found.mesh.area() / one.mesh.area();
        if found.changes.is_empty() || !is_fit(&found.mesh) || !(kept >= KEPT) {
            // The map refuses it, with the place of the defect.
            return one;
        }
        let changes: Vec<&str> = found.changes.iter().map(|c| c.message.as_str()).collect();
        notes.push(format!(
            "{} was mended first: {}; the shapes end at the mended surface",
            path.display(),
            changes.join("; ")
        ));
        let handles = found
            .changes
            .iter()
            .filter(|c| c.step == RepairStep::CutHandles);
        handles_cut += handles.map(|c| c.count).sum::<usize>();
        let nearest = nearest_vertices(&found.mesh, &one.mesh);
        let data = one.data.into_iter().map(|array| carried(array, &nearest));
        Given {
            data: data.collect(),
            mesh: found.mesh,
        }
    });
    Mended {
        surfaces,
        notes,
        handles_cut,
    }
}

/// Number of handles of a closed surface.
fn handles(mesh: &TriangleMesh) -> i64 {
    let topology = Topology::new(mesh);
    topology.components().count as i64 - topology.euler_characteristic() / 2
}

/// True for closed, oriented, outward surfaces.
fn is_closed(mesh: &TriangleMesh) -> bool {
    let topology = Topology::new(mesh);
    topology.is_closed() && topology.is_oriented() && mesh.volume() > 0.0
}

/// True for one closed, oriented, outward surface without handles whose vertices are all used.
fn is_sphere(mesh: &TriangleMesh) -> bool {
    let topology = Topology::new(mesh);
    is_closed(mesh)
        && topology.components().count == 1
        && topology.euler_characteristic() == 2
        && topology.non_manifold_vertices(mesh).is_empty()
}

/// For each vertex of a mesh the nearest vertex of another.
pub(super) fn nearest_vertices(of: &TriangleMesh, to: &TriangleMesh) -> Vec<u32> {
    let tree = SurfaceTree::new(&to.vertices, &to.triangles);
    let nearest = |p: &Point3<f64>| {
        let found = tree.closest(p, f64::INFINITY)?;
        let away = |v: &u32| (to.vertices[*v as usize] - p).norm();
        let corners = to.triangles[found.triangle as usize];
        corners
            .into_iter()
            .min_by(|a, b| away(a).total_cmp(&away(b)))
    };
    of.vertices
        .iter()
        .map(|p| nearest(p).unwrap_or(0))
        .collect()
}

fn carried(array: PointData, nearest: &[u32]) -> PointData {
    let count = array.components;
    let of = |v: &u32| {
        (0..count)
            .map(|k| *v as usize * count + k)
            .collect::<Vec<_>>()
    };
    let values = nearest.iter().flat_map(of);
    PointData {
        values: values
            .map(|at| array.values.get(at).copied().unwrap_or(f64::NAN))
            .collect(),
        ..array
    }
}
