//! Reverses triangles so that neighbours have the same orientation and closed components face
//! outward.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::working::Working;
use super::{RepairStep, topology};
use crate::format::counted;
use crate::mesh::inside::Inside;
use crate::mesh::orientation::Orientation;

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
    let orientation = Orientation::new(&topology, &working.triangles);
    let mut turn = orientation.turn;
    let points = &working.vertices;
    let turned = |turn: &[bool], t: usize| {
        let [a, b, c] = working.triangles[t];
        if turn[t] { [b, a, c] } else { [a, b, c] }
    };
    // Components by their vertices; a component with a boundary has no inside.
    let components = topology.components();
    let label = |t: usize| components.labels[working.triangles[t][0] as usize];
    let mut pieces: Vec<Vec<usize>> = vec![Vec::new(); components.count];
    (0..turn.len()).for_each(|t| pieces[label(t) as usize].push(t));
    let mut closed = vec![true; components.count];
    for e in 0..topology.edges.len() {
        let around = topology.triangles_of_edge(e);
        closed[label(around[0] as usize) as usize] &= around.len() == 2;
    }
    let walls: Vec<[u32; 3]> = (0..turn.len())
        .filter(|t| closed[label(*t) as usize])
        .map(|t| turned(&turn, t))
        .collect();
    let inside = Inside::new(points, &walls);
    // The components that contain each closed component. The outermost one decides for all
    // components inside it.
    let mut within: Vec<Vec<u32>> = vec![Vec::new(); components.count];
    let mut inward = vec![false; components.count];
    let mut effort = 0;
    for (piece, members) in pieces
        .iter()
        .enumerate()
        .filter(|(piece, _)| closed[*piece])
    {
        let own: Vec<[u32; 3]> = members.iter().map(|t| turned(&turn, *t)).collect();
        inward[piece] = six_volumes(points, &own) < 0.0;
        // Each of several vertices must lie inside the other component: where components touch, one
        // vertex can lie on the wall.
        let step = own.len().div_ceil(VOTES);
        let votes: Vec<&Point3<f64>> = own
            .iter()
            .step_by(step)
            .map(|t| &points[t[0] as usize])
            .collect();
        effort += votes.iter().map(|p| inside.effort(p)).sum::<usize>();
        if effort > EFFORT.0 + EFFORT.1 * turn.len() {
            continue;
        }
        let mut found: BTreeMap<u32, usize> = BTreeMap::new();
        for p in &votes {
            let around = inside.winding_by(p, |wall| components.labels[walls[wall][0] as usize]);
            around
                .into_iter()
                .filter(|(_, winding)| *winding != 0)
                .for_each(|(w, _)| *found.entry(w).or_insert(0) += 1);
        }
        let holds = |(other, count): &(u32, usize)| *other != piece as u32 && *count == votes.len();
        within[piece] = found
            .into_iter()
            .filter(holds)
            .map(|(other, _)| other)
            .collect();
    }
    for (piece, members) in pieces
        .iter()
        .enumerate()
        .filter(|(piece, _)| closed[*piece])
    {
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
