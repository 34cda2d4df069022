//! Which points of a grid or a mesh are joined.

use nalgebra::Point3;

use super::angular::AngularSpring;
use super::damping::Neighbours;
use super::hooke::Hooke;
use crate::mesh::TriangleMesh;
use crate::mesh::topology::Topology;

/// Why a lattice is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LatticeError {
    /// A side with fewer than two points.
    #[error("a lattice needs at least 2 points along each side, not {0}")]
    TooFew(usize),
    /// More points than an index counts.
    #[error("{0} x {1} x {2} points are more than 2^32 - 1")]
    TooMany(usize, usize, usize),
}

/// A block of points, x running fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lattice {
    sides: [usize; 3],
}

/// Half of the 26 neighbours, in order of their distance: the others are their opposites.
const HALF: [[i64; 3]; 13] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, -1, 0],
    [1, 0, 1],
    [1, 0, -1],
    [0, 1, 1],
    [0, 1, -1],
    [1, 1, 1],
    [1, 1, -1],
    [1, -1, 1],
    [1, -1, -1],
];

impl Lattice {
    /// A block of so many points along x, y and z.
    ///
    /// # Errors
    /// Fewer than 2 along a side, or more in all than an index counts.
    pub fn new(sides: [usize; 3]) -> Result<Self, LatticeError> {
        if let Some(&few) = sides.iter().find(|n| **n < 2) {
            return Err(LatticeError::TooFew(few));
        }
        let all = sides.iter().try_fold(1usize, |all, n| all.checked_mul(*n));
        match all {
            Some(all) if u32::try_from(all).is_ok() => Ok(Self { sides }),
            _ => Err(LatticeError::TooMany(sides[0], sides[1], sides[2])),
        }
    }

    /// Points along x, y and z.
    pub fn sides(&self) -> [usize; 3] {
        self.sides
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.sides.iter().product()
    }

    /// Number of springs, exactly; for n^3 points and 6 neighbours 3 n^2 (n - 1), with 26 also 6 n (n - 1)^2 + 4 (n - 1)^3.
    ///
    /// It is at most 13 times the number of points, so always a number.
    pub fn springs(&self, neighbours: Neighbours) -> u64 {
        let along = |offset: &[i64; 3]| -> u64 {
            (0..3).map(|k| (self.sides[k] - offset[k].unsigned_abs() as usize) as u64).product()
        };
        kinds(neighbours).iter().map(along).sum()
    }

    /// Positions [m]: the longest side has the length `side`, all spacings are equal.
    pub fn positions(&self, side: f64) -> Vec<Point3<f64>> {
        let [nx, ny, nz] = self.sides;
        let most = nx.max(ny).max(nz) - 1;
        let at = |i: usize| side * i as f64 / most as f64;
        let mut points = Vec::with_capacity(self.points());
        for z in 0..nz {
            for y in 0..ny {
                points.extend((0..nx).map(|x| Point3::new(at(x), at(y), at(z))));
            }
        }
        points
    }

    /// Points on the surface of the block.
    pub fn surface(&self) -> Vec<u32> {
        let outer = |p: &u32| {
            let p = *p as usize;
            let [nx, ny, nz] = self.sides;
            let at = [p % nx, p / nx % ny, p / (nx * ny)];
            (0..3).any(|k| at[k] == 0 || at[k] + 1 == [nx, ny, nz][k])
        };
        (0..self.points() as u32).filter(outer).collect()
    }

    /// The two ends of each spring, lower first, point by point.
    pub fn edges(&self, neighbours: Neighbours) -> impl Iterator<Item = [u32; 2]> + '_ {
        let [nx, ny, nz] = self.sides.map(|n| n as i64);
        let points = 0..self.points() as i64;
        points.flat_map(move |p| {
            let at = [p % nx, p / nx % ny, p / (nx * ny)];
            kinds(neighbours).iter().filter_map(move |o| {
                let to = [at[0] + o[0], at[1] + o[1], at[2] + o[2]];
                let inside = (0..3).all(|k| (0..[nx, ny, nz][k]).contains(&to[k]));
                let q = to[0] + nx * (to[1] + ny * to[2]);
                inside.then_some([p.min(q) as u32, p.max(q) as u32])
            })
        })
    }
}

fn kinds(neighbours: Neighbours) -> &'static [[i64; 3]] {
    match neighbours {
        Neighbours::Six => &HALF[..3],
        Neighbours::TwentySix => &HALF,
    }
}

/// Springs of a flat grid of cloth.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GridPattern {
    /// Between neighbours along rows and columns.
    pub structural: Vec<[u32; 2]>,
    /// Across squares.
    pub shear: Vec<[u32; 2]>,
    /// Between points at distance two along rows and columns.
    pub bending: Vec<[u32; 2]>,
    /// A point and its two opposite neighbours along a row or column.
    pub angular: Vec<[u32; 3]>,
}

/// The pattern of a grid of `columns` by `rows` points, rows one after the other; empty if the product is beyond 2^32.
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

/// The pattern of a triangle mesh: structural springs are its edges; each pair of triangles at an edge is crossed by one
/// between their other corners, which resists shear and bending at once; angular springs join each inner vertex with the
/// opposite neighbours of its ring. `shear` is empty.
pub fn of_mesh(mesh: &TriangleMesh, topology: &Topology) -> GridPattern {
    let mut pattern = GridPattern { structural: topology.edges.clone(), ..GridPattern::default() };
    // Two triangles with the same corners have no other ones to join.
    let across = topology.hinges.iter().map(|h| [h[2], h[3]]).filter(|[a, b]| a != b);
    pattern.bending = across.collect();
    for v in 0..topology.vertex_count() {
        let ring = ring(mesh, topology, v as u32);
        let half = ring.len() / 2;
        let opposite = (0..half).map(|k| [v as u32, ring[k], ring[k + half]]);
        pattern.angular.extend(opposite.filter(|[_, a, b]| a != b));
    }
    pattern
}

/// The neighbours of an inner vertex, walked around once; none for a vertex on a rim or where several fans meet.
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
    let Some([first, mut next]) = left.pop() else { return Vec::new() };
    let mut ring = vec![first];
    while next != first {
        ring.push(next);
        let Some(k) = left.iter().position(|pair| pair[0] == next) else { return Vec::new() };
        next = left.swap_remove(k)[1];
    }
    if left.is_empty() { ring } else { Vec::new() }
}

/// Angular springs of `stiffness` [N/m] that are at rest at `x`.
pub fn angular_at_rest(x: &[Point3<f64>], triples: &[[u32; 3]], stiffness: f64) -> Vec<AngularSpring> {
    let spring = |&points: &[u32; 3]| {
        let [a, b, c] = points.map(|p| x[p as usize]);
        AngularSpring { points, law: Hooke { rest: (nalgebra::center(&b, &c) - a).norm(), stiffness } }
    };
    triples.iter().map(spring).collect()
}

/// Springs of `stiffness` [N/m] along `pairs` that are at rest at `x`.
pub fn at_rest<'a>(
    x: &'a [Point3<f64>],
    pairs: impl IntoIterator<Item = [u32; 2]> + 'a,
    stiffness: impl Fn(f64) -> f64 + 'a,
) -> impl Iterator<Item = ([u32; 2], Hooke)> + 'a {
    pairs.into_iter().map(move |[a, b]| {
        let rest = (x[a as usize] - x[b as usize]).norm();
        ([a, b], Hooke { rest, stiffness: stiffness(rest) })
    })
}
