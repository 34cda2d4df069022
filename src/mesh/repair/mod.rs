//! Repairs a surface for simulation and reports every change.
//!
//! Vertices move only by merging over a distance that the caller sets. Joined parts stay joined:
//! the repair only closes boundary loops, separates edges with more than two triangles and vertices in
//! which surfaces touch, and cuts handles up to a size that the caller sets.

mod deviation;
mod fill;
mod flat;
mod handles;
mod outward;
mod seams;
mod split;
mod working;

pub use deviation::{Deviation, deviation};

use super::TriangleMesh;
use super::topology::Topology;
use working::Working;

/// Greatest length of a boundary loop that can be closed [edges]; the time grows as its cube.
pub const LONGEST_RIM: usize = 500;

/// Optional changes that move or drop parts of the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RepairOptions {
    /// Boundary vertices at most this far apart are merged [unit of the coordinates]; 0 merges
    /// coincident vertices only.
    pub merge_within: f64,
    /// Boundary loops with at most this number of edges are closed, at most [`LONGEST_RIM`]; 0
    /// closes none.
    pub close_holes: usize,
    /// Handles are cut around which a loop of edges of at most this length leads [unit of the
    /// coordinates], in a closed surface; 0 cuts none.
    pub cut_handles: f64,
    /// Removes all components except the one with the greatest area.
    pub keep_largest: bool,
}

/// A change of a repair.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct RepairChange {
    /// The step of the repair.
    pub step: RepairStep,
    /// Number of changed elements.
    pub count: usize,
    /// Description.
    pub message: String,
    /// The changed vertices or triangles, by their index in the original mesh, ascending.
    pub elements: Vec<u32>,
}

/// The steps of a repair, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum RepairStep {
    /// Boundary vertices merged with another vertex.
    MergedVertices,
    /// Dropped triangles with the same corners as another one.
    DroppedDuplicateTriangles,
    /// Triangles without area, removed by flips or collapses.
    CutZeroArea,
    /// Vertices that got a copy where surfaces were separated.
    SplitVertices,
    /// Triangles of dropped components.
    DroppedPieces,
    /// Vertices of closed boundary loops.
    ClosedHoles,
    /// Reversed triangles.
    TurnedTriangles,
    /// Vertices of the loops around which handles were cut.
    CutHandles,
    /// Dropped vertices without a triangle or line.
    DroppedVertices,
}

/// A repaired surface with its changes.
#[derive(Clone, Debug)]
pub struct Repaired {
    /// The surface.
    pub mesh: TriangleMesh,
    /// The polylines, with the new indices.
    pub lines: Vec<Vec<u32>>,
    /// Changes in order; empty for a mesh without defects, whose bits are unchanged.
    pub changes: Vec<RepairChange>,
    /// Greatest displacement of a vertex [unit of the coordinates].
    pub moved: f64,
}

/// Repairs a surface with valid indices and finite coordinates; the polylines `lines` over its
/// vertices are kept.
///
/// ```
/// use pliant::Health;
/// use pliant::mesh::{RepairOptions, RepairStep, repair};
/// use pliant::mesh::shapes::box_surface;
///
/// let mut mesh = box_surface([1.0, 1.0, 1.0], 1.0);
/// mesh.triangles.pop();
/// mesh.triangles[0].reverse();
///
/// let options = RepairOptions { close_holes: 3, ..RepairOptions::default() };
/// let repaired = repair(&mesh, &[], &options);
/// let steps: Vec<RepairStep> = repaired.changes.iter().map(|change| change.step).collect();
/// assert_eq!(steps, [RepairStep::ClosedHoles, RepairStep::TurnedTriangles]);
/// assert!(Health::of(&repaired.mesh).is_fit());
/// assert_eq!(repaired.mesh.volume(), 1.0);
/// ```
pub fn repair(mesh: &TriangleMesh, lines: &[Vec<u32>], options: &RepairOptions) -> Repaired {
    let mut working = Working::new(mesh, lines);
    // A duplicate triangle hides a boundary, and coincident boundaries hide duplicates.
    working.drop_duplicates();
    seams::merge(&mut working, options.merge_within);
    working.drop_duplicates();
    // Triangles without area cannot flip where surfaces touch; surfaces can touch where such a
    // triangle was.
    for round in 0..2 {
        flat::cut(&mut working);
        if round == 0 {
            // After separation such triangles would be loose components, and the gaps between them
            // one hole.
            fill::close_gaps(&mut working, options.close_holes);
        }
        split::split(&mut working);
    }
    if options.keep_largest {
        working.keep_largest();
    }
    fill::close(&mut working, options.close_holes.min(LONGEST_RIM));
    outward::turn(&mut working);
    handles::cut(&mut working, options.cut_handles);
    working.finish()
}

/// The topology of the mesh under repair.
fn topology(working: &Working) -> Topology {
    Topology::of_triangles(working.vertices.len(), &working.triangles)
}

#[cfg(test)]
mod tests;
