//! Removes triangles without area from a surface without moving a point of it.

use nalgebra::Point3;

use super::working::Working;
use super::{RepairStep, topology};
use crate::format::counted;
use crate::mesh::predicates::is_flat;
use crate::mesh::topology::Topology;

/// Greatest total number of examined triangles. Each round cuts triangles that do not touch, a row
/// of them one by one.
const EFFORT: usize = 20_000_000;

/// Least allowed number of rounds, for any number of triangles.
const ROUNDS: usize = 64;

/// Vertices with more triangles are skipped: each triangle without area would examine all of them.
const CROWD: usize = 1000;

/// The treatment of a triangle without area.
enum Cut {
    /// Two corners coincide: the second becomes the first.
    Collapse([u32; 2]),
    /// The middle corner lies on the long side: the triangle across the side is divided there.
    Flip {
        /// The triangle across the side, and the triangles that replace both.
        across: usize,
        halves: [[u32; 3]; 2],
    },
    /// The long side is on the boundary: the triangle is removed, and the boundary follows the
    /// other two sides.
    Drop,
}

/// Flips, collapses or removes every triangle without area where possible, exactly in place.
///
/// A triangle stays if an edge would get a third triangle, or if a vertex has more than 1000
/// triangles.
pub(super) fn cut(working: &mut Working) {
    let mut cut = Vec::new();
    for _ in 0..ROUNDS.max(EFFORT / (working.triangles.len() + 1)) {
        let before = cut.len();
        round(working, &mut cut);
        if cut.len() == before {
            break;
        }
    }
    let count = cut.len();
    let left = (0..working.triangles.len())
        .filter(|&t| is_flat(&working.corners(t)))
        .count();
    let message = || {
        let rest = if left > 0 {
            format!("; {left} are left")
        } else {
            String::new()
        };
        format!(
            "cut away {} without area, which moves nothing{rest}",
            counted(count, "triangle", "triangles")
        )
    };
    working.note(
        RepairStep::CutZeroArea,
        count,
        message,
        cut.into_iter().flatten().collect(),
    );
}

fn round(working: &mut Working, cut: &mut Vec<Option<u32>>) {
    let flat: Vec<usize> = (0..working.triangles.len())
        .filter(|&t| is_flat(&working.triangles[t].map(|v| working.vertices[v as usize])))
        .collect();
    if flat.is_empty() {
        return;
    }
    let topology = topology(working);
    // Triangles at a vertex with a changed triangle wait for the next round.
    let mut touched = vec![false; working.vertices.len()];
    let mut gone = vec![false; working.triangles.len()];
    for t in flat {
        let Some((deed, corners)) = plan(t, &working.triangles, &working.vertices, &topology)
        else {
            continue;
        };
        let around = || {
            corners
                .iter()
                .flat_map(|v| topology.triangles_of_vertex(*v as usize))
        };
        if around().any(|u| {
            working.triangles[*u as usize]
                .iter()
                .any(|v| touched[*v as usize])
        }) {
            continue;
        }
        corners.iter().for_each(|v| touched[*v as usize] = true);
        cut.push(working.triangle_origin[t]);
        match deed {
            Cut::Collapse([keep, drop]) => {
                for &u in topology.triangles_of_vertex(drop as usize) {
                    let corners = &mut working.triangles[u as usize];
                    gone[u as usize] |= corners.contains(&keep);
                    corners
                        .iter_mut()
                        .filter(|v| **v == drop)
                        .for_each(|v| *v = keep);
                }
                working
                    .lines
                    .iter_mut()
                    .flatten()
                    .filter(|v| **v == drop)
                    .for_each(|v| *v = keep);
            }
            Cut::Flip { across, halves } => {
                working.triangles[across] = halves[0];
                working.triangles[t] = halves[1];
            }
            Cut::Drop => gone[t] = true,
        }
    }
    working.retain(|t| !gone[t]);
}

/// The corner between the other two of a triangle with distinct collinear corners.
fn middle_corner(corners: &[Point3<f64>; 3]) -> usize {
    // In either order along the line the second is the middle one.
    let mut order = [0, 1, 2];
    order.sort_by(|i, j| {
        let (p, q): (&Point3<f64>, &Point3<f64>) = (&corners[*i], &corners[*j]);
        p.x.total_cmp(&q.x)
            .then(p.y.total_cmp(&q.y))
            .then(p.z.total_cmp(&q.z))
    });
    order[1]
}

/// The treatment of triangle `t` and the vertices that it affects; `None` where nothing is possible
/// now.
fn plan(
    t: usize,
    triangles: &[[u32; 3]],
    points: &[Point3<f64>],
    topology: &Topology,
) -> Option<(Cut, Vec<u32>)> {
    let corners = triangles[t];
    if corners
        .iter()
        .any(|v| topology.triangles_of_vertex(*v as usize).len() > CROWD)
    {
        return None;
    }
    let at = |v: u32| points[v as usize];
    for k in 0..3 {
        let (u, v) = (corners[k], corners[(k + 1) % 3]);
        if at(u) == at(v) {
            let [keep, drop] = [u.min(v), u.max(v)];
            let allowed = link_is_free(keep, drop, topology, triangles);
            return allowed.then(|| (Cut::Collapse([keep, drop]), vec![keep, drop]));
        }
    }
    let long = (middle_corner(&corners.map(at)) + 1) % 3;
    let [a, c, b] = [
        corners[long],
        corners[(long + 1) % 3],
        corners[(long + 2) % 3],
    ];
    match *topology.triangles_of_edge(topology.triangle_edges[t][long] as usize) {
        [_] => Some((Cut::Drop, corners.to_vec())),
        [s, u] => {
            let across = if s as usize == t { u } else { s } as usize;
            let apex = *triangles[across].iter().find(|v| **v != a && **v != c)?;
            // A neighbour without area is cut first; otherwise both would flip back and forth.
            if apex == b
                || topology.find_edge(apex, b).is_some()
                || is_flat(&triangles[across].map(at))
            {
                return None;
            }
            // Each half is the triangle across the side with one end of the long side moved to the
            // middle corner.
            let with = |end: u32| triangles[across].map(|v| if v == end { b } else { v });
            Some((
                Cut::Flip {
                    across,
                    halves: [with(a), with(c)],
                },
                vec![a, b, c, apex],
            ))
        }
        _ => None,
    }
}

/// True if the common neighbours of both ends of an edge are those opposite the edge, so that a
/// collapse joins nothing else.
fn link_is_free(a: u32, b: u32, topology: &Topology, triangles: &[[u32; 3]]) -> bool {
    let around = |v: u32| {
        let ring = topology.triangles_of_vertex(v as usize);
        let mut ring: Vec<u32> = ring
            .iter()
            .flat_map(|t| triangles[*t as usize])
            .filter(|w| *w != v)
            .collect();
        ring.sort_unstable();
        ring.dedup();
        ring
    };
    let Some(edge) = topology.find_edge(a, b) else {
        return false;
    };
    let (around_a, around_b) = (around(a), around(b));
    let common = around_a
        .iter()
        .filter(|v| around_b.binary_search(v).is_ok())
        .count();
    let opposite = topology.triangles_of_edge(edge as usize).len();
    // A collapse must not join two boundary loops.
    let on_rim = |v: u32| {
        let ring = topology.triangles_of_vertex(v as usize);
        let sides = ring
            .iter()
            .flat_map(|t| topology.triangle_edges[*t as usize]);
        sides.into_iter().any(|e| {
            topology.edges[e as usize].contains(&v)
                && topology.triangles_of_edge(e as usize).len() == 1
        })
    };
    common == opposite && (opposite == 1 || !(on_rim(a) && on_rim(b)))
}
