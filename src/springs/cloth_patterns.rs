//! Patterns of springs in a grid of cloth or a mesh.

use nalgebra::Point3;

use super::angular::AngularSpring;
use super::hooke::Hooke;
use crate::mesh::TriangleMesh;
use crate::mesh::topology::Topology;

/// Springs of a flat grid of cloth.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GridPattern {
    /// Between neighbours along rows and columns.
    pub structural: Vec<[u32; 2]>,
    /// Across the diagonals of squares.
    pub shear: Vec<[u32; 2]>,
    /// Between points at distance two along rows and columns.
    pub bending: Vec<[u32; 2]>,
    /// A point and its two opposite neighbours along a row or column.
    pub angular: Vec<[u32; 3]>,
}

/// The pattern of a grid of `columns` by `rows` points in row order; empty if the product exceeds
/// 2^32.
pub fn grid(columns: u32, rows: u32) -> GridPattern {
    let mut pattern = GridPattern::default();
    if columns.checked_mul(rows).is_none() {
        return pattern;
    }
    let at = |c: u32, r: u32| c + columns * r;
    for r in 0..rows {
        for c in 0..columns {
            let (right, up) = (c + 1 < columns, r + 1 < rows);
            if right {
                pattern.structural.push([at(c, r), at(c + 1, r)]);
            }
            if up {
                pattern.structural.push([at(c, r), at(c, r + 1)]);
            }
            if right && up {
                pattern.shear.push([at(c, r), at(c + 1, r + 1)]);
                pattern.shear.push([at(c + 1, r), at(c, r + 1)]);
            }
            if c + 2 < columns {
                pattern.bending.push([at(c, r), at(c + 2, r)]);
                pattern.angular.push([at(c + 1, r), at(c, r), at(c + 2, r)]);
            }
            if r + 2 < rows {
                pattern.bending.push([at(c, r), at(c, r + 2)]);
                pattern.angular.push([at(c, r + 1), at(c, r), at(c, r + 2)]);
            }
        }
    }
    pattern
}

/// The pattern of a triangle mesh. Structural springs are its edges. One spring crosses each edge
/// between the opposite corners of its two triangles and resists shear and bending. Angular springs
/// join each inner vertex with the opposite neighbours of its ring. `shear` is empty.
pub fn of_mesh(mesh: &TriangleMesh, topology: &Topology) -> GridPattern {
    let mut pattern = GridPattern {
        structural: topology.edges.clone(),
        ..GridPattern::default()
    };
    // Two triangles with the same corners have no other corners to join.
    let across = topology
        .hinges
        .iter()
        .map(|h| [h[2], h[3]])
        .filter(|[a, b]| a != b);
    pattern.bending = across.collect();
    for v in 0..topology.vertex_count() {
        let ring = ring(mesh, topology, v as u32);
        let half = ring.len() / 2;
        let opposite = (0..half).map(|k| [v as u32, ring[k], ring[k + half]]);
        pattern.angular.extend(opposite.filter(|[_, a, b]| a != b));
    }
    pattern
}

/// The neighbours of an inner vertex in cyclic order; empty for a boundary vertex or one with
/// several fans.
fn ring(mesh: &TriangleMesh, topology: &Topology, v: u32) -> Vec<u32> {
    let mut left: Vec<[u32; 2]> = Vec::new();
    for &t in topology.triangles_of_vertex(v as usize) {
        let [a, b, c] = mesh.triangles[t as usize];
        left.push(if a == v {
            [b, c]
        } else if b == v {
            [c, a]
        } else {
            [a, b]
        });
    }
    let Some([first, mut next]) = left.pop() else {
        return Vec::new();
    };
    let mut ring = vec![first];
    while next != first {
        ring.push(next);
        let Some(k) = left.iter().position(|pair| pair[0] == next) else {
            return Vec::new();
        };
        next = left.swap_remove(k)[1];
    }
    if left.is_empty() { ring } else { Vec::new() }
}

/// Angular springs of `stiffness` [N/m] that are at rest at `x`.
pub fn angular_at_rest(
    x: &[Point3<f64>],
    triples: &[[u32; 3]],
    stiffness: f64,
) -> Vec<AngularSpring> {
    let spring = |&points: &[u32; 3]| {
        let [a, b, c] = points.map(|p| x[p as usize]);
        AngularSpring {
            points,
            law: Hooke {
                rest: (nalgebra::center(&b, &c) - a).norm(),
                stiffness,
            },
        }
    };
    triples.iter().map(spring).collect()
}
