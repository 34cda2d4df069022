//! Closed pieces of a surface, which lie in which, and which are turned inward.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::inside::Inside;
use super::topology::Topology;

/// Greatest number of triangle tests for the nesting of components, in all and per triangle;
/// components beyond count as not nested. Only thousands of components in one line come near it.
const EFFORT: (usize, usize) = (1 << 26, 64);

/// Number of vertices of a component in the test for nesting.
const VOTES: usize = 8;

/// A piece is turned inward if its volume is below minus this share of the sum of the volumes that
/// its triangles span with one of its corners: more than the rounding of the sum.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// A closed piece whose outermost container, or itself without one, is turned inward.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct InwardPiece {
    /// Its triangles.
    pub triangles: Vec<usize>,
    /// The volume of the piece that decides: the outermost around it, or itself.
    pub volume: f64,
}

/// The closed pieces of consistently oriented `triangles` that have to be turned. A piece within another
/// is turned only together with the outer one: it can be the wall of a cavity or a body of its own.
pub(crate) fn inward(
    points: &[Point3<f64>],
    triangles: &[[u32; 3]],
    topology: &Topology,
) -> Vec<InwardPiece> {
    let labels = topology.components().labels;
    let pieces = closed_components(triangles, topology, &labels);
    let volume = |members: &Vec<usize>| volume(points, members.iter().map(|t| triangles[*t]));
    let volumes: Vec<f64> = pieces.iter().map(volume).collect();
    // Most surfaces have nothing to be turned.
    if volumes.iter().all(|volume| !(*volume < 0.0)) {
        return Vec::new();
    }
    let within = containers(points, triangles, &pieces, &labels);
    let outermost = |piece: usize| {
        let of = within[piece]
            .iter()
            .find(|other| within[**other as usize].is_empty());
        of.map_or(piece, |other| *other as usize)
    };
    let turned = pieces.into_iter().enumerate();
    turned
        .filter(|(piece, _)| volumes[outermost(*piece)] < 0.0)
        .map(|(piece, triangles)| InwardPiece {
            triangles,
            volume: volumes[outermost(piece)],
        })
        .collect()
}

/// The volume of a closed piece, seen from one of its corners; 0 where only rounding decides its sign.
fn volume(points: &[Point3<f64>], own: impl Iterator<Item = [u32; 3]>) -> f64 {
    let mut own = own.peekable();
    let Some(first) = own.peek() else { return 0.0 };
    let origin = points[first[0] as usize];
    let (mut sum, mut sizes) = (0.0, 0.0);
    for t in own {
        let [a, b, c] = t.map(|v| points[v as usize] - origin);
        let part = a.dot(&b.cross(&c));
        sum += part;
        sizes += part.abs();
    }
    if sum.abs() <= ROUNDING * sizes {
        0.0
    } else {
        sum / 6.0
    }
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
