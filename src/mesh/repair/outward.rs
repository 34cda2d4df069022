//! Reverses triangles so that neighbours have the same orientation and closed components face
//! outward.

use super::working::Working;
use super::{RepairStep, topology};
use crate::format::counted;
use crate::mesh::nesting;
use crate::mesh::orientation::Orientation;

/// Makes each patch consistent with the fewest reversals, then each closed component outward; see
/// [`nesting::inward`].
pub(super) fn turn(working: &mut Working) {
    let topology = topology(working);
    let mut turn = Orientation::new(&topology, &working.triangles).turn;
    let mut triangles = working.triangles.clone();
    for (t, corners) in triangles.iter_mut().enumerate() {
        if turn[t] {
            corners.swap(0, 1);
        }
    }
    for piece in nesting::inward(&working.vertices, &triangles, &topology) {
        piece.triangles.iter().for_each(|t| turn[*t] = !turn[*t]);
    }
    let changed: Vec<usize> = (0..turn.len()).filter(|t| turn[*t]).collect();
    let elements = changed
        .iter()
        .filter_map(|t| working.triangle_origin[*t])
        .collect();
    changed
        .iter()
        .for_each(|t| working.triangles[*t].swap(0, 1));
    let message = || {
        format!(
            "turned {} round",
            counted(changed.len(), "triangle", "triangles")
        )
    };
    working.note(
        RepairStep::TurnedTriangles,
        changed.len(),
        message,
        elements,
    );
}
