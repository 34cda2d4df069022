//! Makes a surface fit for simulation, and tells everything that it changed.
//!
//! Nothing is moved but vertices that are merged over a distance, which is asked for. What is joined stays joined:
//! only rims are closed, only edges with more than two triangles and vertices in which surfaces touch are taken apart.

mod deviation;
mod fill;
mod flat;
mod outward;
mod seams;
mod split;
mod working;

pub use deviation::{Deviation, deviation};

use super::TriangleMesh;
use super::topology::Topology;
use working::Working;

/// The longest rim that can be closed [edges]; time grows as its cube.
pub const LONGEST_RIM: usize = 500;

/// What may be changed beyond what moves and loses nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// Vertices on rims that are at most this far apart are merged [unit of the coordinates]; 0: those in one place.
    pub merge_within: f64,
    /// Rims of at most so many edges are closed, at most [`LONGEST_RIM`]; 0: none.
    pub close_holes: usize,
    /// Whether all pieces but the one of the greatest area are dropped.
    pub keep_largest: bool,
}

/// One thing that was changed.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Change {
    /// Which of the steps.
    pub step: Step,
    /// How many elements were changed.
    pub count: usize,
    /// In words.
    pub message: String,
    /// The elements, vertices or triangles as the step says, by their index in the mesh as read, ascending.
    pub elements: Vec<u32>,
}

/// The steps of a repair, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Step {
    /// Vertices on rims that were merged with another.
    MergedVertices,
    /// Triangles dropped because others have the same corners.
    DroppedDuplicateTriangles,
    /// Triangles without area that were flipped or collapsed away.
    CutZeroArea,
    /// Vertices that were given a second copy, where surfaces were taken apart.
    SplitVertices,
    /// Triangles of pieces that were dropped.
    DroppedPieces,
    /// Vertices of rims that were closed.
    ClosedHoles,
    /// Triangles that were turned round.
    TurnedTriangles,
    /// Vertices that were dropped because nothing names them.
    DroppedVertices,
}

/// A repaired surface and how it came about.
#[derive(Clone, Debug)]
pub struct Repaired {
    /// The surface.
    pub mesh: TriangleMesh,
    /// The polylines, with the new indices.
    pub lines: Vec<Vec<u32>>,
    /// What was changed, in order; empty for a mesh that needed nothing, which then has the same bits.
    pub changes: Vec<Change>,
    /// The furthest that a vertex was moved [unit of the coordinates].
    pub moved: f64,
}

/// Repairs a surface with valid indices and finite coordinates; `lines` are polylines over its vertices, which are kept.
pub fn repair(mesh: &TriangleMesh, lines: &[Vec<u32>], options: &Options) -> Repaired {
    let mut working = Working::new(mesh, lines);
    // A triangle over another hides a rim, and two rims over one another hide duplicates.
    working.drop_duplicates();
    seams::merge(&mut working, options.merge_within);
    working.drop_duplicates();
    // Where surfaces touch, triangles without area cannot be flipped; where such a triangle was, surfaces may touch.
    for round in 0..2 {
        flat::cut(&mut working);
        if round == 0 {
            // Taken apart, such triangles would be loose pieces, and the gaps between them one hole over which they lie.
            fill::close_gaps(&mut working, options.close_holes);
        }
        split::split(&mut working);
    }
    if options.keep_largest {
        working.keep_largest();
    }
    fill::close(&mut working, options.close_holes.min(LONGEST_RIM));
    outward::turn(&mut working);
    working.finish()
}

/// The topology of what is being repaired.
fn topology(working: &Working) -> Topology {
    Topology::of_triangles(working.vertices.len(), &working.triangles)
}

#[cfg(test)]
mod tests;
