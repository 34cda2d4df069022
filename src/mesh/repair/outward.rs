//! Reverses triangles so that neighbours have the same orientation and closed components face
//! outward.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::working::Working;
use super::{RepairStep, topology};
use crate::format::counted;
use crate::mesh::inside::Inside;
use crate::mesh::orientation::Orientation;
use crate::mesh::topology::Topology;

/// Greatest number of triangle tests for the nesting of components, in all and per triangle;
/// components beyond count as not nested. Only thousands of components in one line come near it.
const EFFORT: (usize, usize) = (1 << 26, 64);

/// Number of vertices of a component in the test for nesting.
const VOTES: usize = 8;

/// Six times the volume of a closed component, seen from one of its corners; only the sign is used.
fn six_volumes(points: &[Point3<f64>], own: &[[u32; 3]]) -> f64 {
    let Some(first) = own.first() else { return 0.0 };
    let origin = points[first[0] as usize];
    let part = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| points[v as usize] - origin);
        a.dot(&b.cross(&c))
    };
    own.iter().map(part).sum()
}

/// Makes each patch consistent with the fewest reversals, then each closed component outward. A
/// component inside another is reversed only together with the outer one: it can be the wall of a
/// cavity or a body of its own.
pub(super) fn turn(working: &mut Working) {
    let topology = topology(working);
    let mut turn = Orientation::new(&topology, &working.triangles).turn;
    let mut triangles = working.triangles.clone();
    for (t, corners) in triangles.iter_mut().enumerate() {
        if turn[t] {
            corners.swap(0, 1);
        }
    }
    let labels = topology.components().labels;
    let pieces = closed_components(&triangles, &topology, &labels);
    let within = containers(&working.vertices, &triangles, &pieces, &labels);
    let mut inward = Vec::with_capacity(pieces.len());
    for members in &pieces {
        let own: Vec<[u32; 3]> = members.iter().map(|t| triangles[*t]).collect();
        inward.push(six_volumes(&working.vertices, &own) < 0.0);
    }
    // The outermost component decides for all components inside it.
    for (piece, members) in pieces.iter().enumerate() {
        let outermost = within[piece]
            .iter()
            .find(|other| within[**other as usize].is_empty());
        if inward[outermost.map_or(piece, |o| *o as usize)] {
            members.iter().for_each(|t| turn[*t] = !turn[*t]);
        }
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

/// The triangles of each component; none for a component with a boundary, which has no inside.
fn closed_components(
    triangles: &[[u32; 3]],
    topology: &Topology,
    labels: &[u32],
) -> Vec<Vec<usize>> {
    let label = |t: usize| labels[triangles[t][0] as usize] as usize;
    let count = (0..triangles.len()).map(|t| label(t) + 1).max();
    let mut pieces: Vec<Vec<usize>> = vec![Vec::new(); count.unwrap_or(0)];
    (0..triangles.len()).for_each(|t| pieces[label(t)].push(t));
    for e in 0..topology.edges.len() {
        let around = topology.triangles_of_edge(e);
        if around.len() != 2 {
            pieces[label(around[0] as usize)].clear();
        }
    }
    pieces
}

/// The components that contain each closed component.
fn containers(
    points: &[Point3<f64>],
    triangles: &[[u32; 3]],
    pieces: &[Vec<usize>],
    labels: &[u32],
) -> Vec<Vec<u32>> {
    let walls: Vec<[u32; 3]> = pieces.iter().flatten().map(|t| triangles[*t]).collect();
    let inside = Inside::new(points, &walls);
    let mut within: Vec<Vec<u32>> = vec![Vec::new(); pieces.len()];
    let mut effort = 0;
    for (piece, members) in pieces.iter().enumerate().filter(|(_, m)| !m.is_empty()) {
        // Each of several vertices must lie inside the other component: where components touch, one
        // vertex can lie on the wall.
        let votes: Vec<&Point3<f64>> = members
            .iter()
            .step_by(members.len().div_ceil(VOTES))
            .map(|t| &points[triangles[*t][0] as usize])
            .collect();
        effort += votes.iter().map(|p| inside.effort(p)).sum::<usize>();
        if effort > EFFORT.0 + EFFORT.1 * triangles.len() {
            continue;
        }
        let mut found: BTreeMap<u32, usize> = BTreeMap::new();
        for p in &votes {
            let around = inside.winding_by(p, |wall| labels[walls[wall][0] as usize]);
            for (other, _) in around.into_iter().filter(|(_, winding)| *winding != 0) {
                *found.entry(other).or_insert(0) += 1;
            }
        }
        found.retain(|other, count| *other != piece as u32 && *count == votes.len());
        within[piece] = found.into_keys().collect();
    }
    within
}
