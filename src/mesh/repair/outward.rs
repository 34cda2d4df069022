//! Turns triangles so that neighbours agree and closed pieces face outward.

use super::working::Working;
use super::{Step, topology};
use crate::mesh::health::counted;
use crate::mesh::inside::Inside;
use crate::mesh::measures::volume;
use crate::mesh::orientation::Orientation;
use crate::mesh::predicates::scaled;

/// Triangles that may be looked at to find what lies in what, in all and for each triangle; pieces beyond are taken as lying
/// in none. Only thousands of pieces one behind the other come near it.
const EFFORT: (usize, usize) = (1 << 26, 64);

/// Turns the fewer triangles of each patch that disagrees with itself; then each closed piece outward. A piece within
/// another is turned only if that one is: whether it is the wall of a cavity or a body of its own, only its maker knows.
pub(super) fn turn(working: &mut Working) {
    let topology = topology(working);
    let orientation = Orientation::new(&topology, &working.triangles);
    let mut turn = orientation.turn;
    let points = scaled(&working.vertices);
    let turned = |turn: &[bool], t: usize| {
        let [a, b, c] = working.triangles[t];
        if turn[t] { [b, a, c] } else { [a, b, c] }
    };
    // Pieces by their vertices; one that is open anywhere has no inside.
    let components = topology.components();
    let label = |t: usize| components.labels[working.triangles[t][0] as usize];
    let mut pieces: Vec<Vec<usize>> = vec![Vec::new(); components.count];
    (0..turn.len()).for_each(|t| pieces[label(t) as usize].push(t));
    let mut closed = vec![true; components.count];
    for e in 0..topology.edges.len() {
        let around = topology.triangles_of_edge(e);
        closed[label(around[0] as usize) as usize] &= around.len() == 2;
    }
    let walls: Vec<[u32; 3]> =
        (0..turn.len()).filter(|t| closed[label(*t) as usize]).map(|t| turned(&turn, t)).collect();
    let inside = Inside::new(&points, &walls);
    // The pieces that each closed piece lies in; the outermost decides, and what lies in it is turned with it.
    let mut within: Vec<Vec<u32>> = vec![Vec::new(); components.count];
    let mut inward = vec![false; components.count];
    let mut effort = 0;
    for (piece, members) in pieces.iter().enumerate().filter(|(piece, _)| closed[*piece]) {
        let own: Vec<[u32; 3]> = members.iter().map(|t| turned(&turn, *t)).collect();
        inward[piece] = volume(&points, &own) < 0.0;
        let x = |v: &u32| points[*v as usize].x;
        // A point of the piece with nothing else of it before or behind.
        let Some(lowest) = own.iter().flatten().min_by(|a, b| x(a).total_cmp(&x(b)).then(a.cmp(b))) else { continue };
        effort += inside.effort(&points[*lowest as usize]);
        if effort > EFFORT.0 + EFFORT.1 * turn.len() {
            continue;
        }
        let around = inside.winding_by(&points[*lowest as usize], |wall| components.labels[walls[wall][0] as usize]);
        let others = around.into_iter().filter(|(other, winding)| *other != piece as u32 && *winding != 0);
        within[piece] = others.map(|(other, _)| other).collect();
    }
    for (piece, members) in pieces.iter().enumerate().filter(|(piece, _)| closed[*piece]) {
        let outermost = within[piece].iter().find(|other| within[**other as usize].is_empty());
        if inward[outermost.map_or(piece, |o| *o as usize)] {
            members.iter().for_each(|t| turn[*t] = !turn[*t]);
        }
    }
    let changed: Vec<usize> = (0..turn.len()).filter(|t| turn[*t]).collect();
    let elements = changed.iter().filter_map(|t| working.triangle_origin[*t]).collect();
    changed.iter().for_each(|t| working.triangles[*t].swap(0, 1));
    let message = || format!("turned {} round", counted(changed.len(), "triangle", "triangles"));
    working.note(Step::TurnedTriangles, changed.len(), message, elements);
}
