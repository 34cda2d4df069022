//! Inside test for points and a closed surface, by signed crossings with exact predicates.
//!
//! This module is independent of the contact code on purpose: it audits the written frames.

use std::collections::BTreeMap;

use nalgebra::Point3;
use robust::{Coord, Coord3D, orient2d, orient3d};

use crate::mesh::measures::Aabb;

/// Greatest mean number of cells that contain a triangle.
const ENTRIES: usize = 16;

/// A surface in a grid over y and z, for rays along +x.
#[derive(Debug)]
pub struct Inside<'a> {
    vertices: &'a [Point3<f64>],
    triangles: &'a [[u32; 3]],
    bounds: Aabb,
    cells: usize,
    start: Vec<u32>,
    listed: Vec<u32>,
}

/// Number of cells in all ranges.
fn entries(ranges: &[[usize; 4]]) -> usize {
    ranges
        .iter()
        .map(|[y0, y1, z0, z1]| (y1 - y0 + 1) * (z1 - z0 + 1))
        .sum()
}

impl<'a> Inside<'a> {
    /// Sorts the triangles into about as many cells as triangles. Large triangles get fewer cells,
    /// so that the lists have only a few entries per triangle.
    pub fn new(vertices: &'a [Point3<f64>], triangles: &'a [[u32; 3]]) -> Self {
        let cells = ((triangles.len() as f64).sqrt() as usize).max(1);
        let bounds = Aabb::of_points(vertices);
        let mut this = Self {
            vertices,
            triangles,
            bounds,
            cells,
            start: Vec::new(),
            listed: Vec::new(),
        };
        let mut ranges = this.ranges();
        while this.cells > 1 && entries(&ranges) > ENTRIES * triangles.len() {
            this.cells /= 2;
            ranges = this.ranges();
        }
        let cells = this.cells;
        let visit = |action: &mut dyn FnMut(usize, usize)| {
            for (t, &[y0, y1, z0, z1]) in ranges.iter().enumerate() {
                (y0..=y1).for_each(|y| (z0..=z1).for_each(|z| action(t, y * cells + z)));
            }
        };
        let mut start = vec![0u32; cells * cells + 1];
        visit(&mut |_, cell| start[cell + 1] += 1);
        (0..cells * cells).for_each(|c| start[c + 1] += start[c]);
        let mut next = start.clone();
        let mut listed = vec![0u32; start[cells * cells] as usize];
        visit(&mut |t, cell| {
            listed[next[cell] as usize] = t as u32;
            next[cell] += 1;
        });
        (this.start, this.listed) = (start, listed);
        this
    }

    /// The cells of each triangle: the first and last along y, and along z.
    fn ranges(&self) -> Vec<[usize; 4]> {
        (0..self.triangles.len())
            .map(|t| self.cells_of(t))
            .collect()
    }

    fn cell(&self, value: f64, axis: usize) -> usize {
        let (low, extent) = (self.bounds.min[axis], self.bounds.extents()[axis]);
        let share = if extent > 0.0 {
            (value - low) / extent
        } else {
            0.0
        };
        // Monotonic in `value`, so the cell of a point lists its triangle; `as` saturates.
        ((share * self.cells as f64) as usize).min(self.cells - 1)
    }

    fn cells_of(&self, t: usize) -> [usize; 4] {
        let c = self.triangles[t].map(|v| self.vertices[v as usize]);
        let (low, high) = (c[0].inf(&c[1]).inf(&c[2]), c[0].sup(&c[1]).sup(&c[2]));
        [
            self.cell(low.y, 1),
            self.cell(high.y, 1),
            self.cell(low.z, 2),
            self.cell(high.z, 2),
        ]
    }

    /// The winding number of a closed surface about `p`: signed crossings of the ray from `p` along
    /// +x. A half-open rule counts points on shared edges once; a point on the surface is outside
    /// or inside.
    pub fn winding(&self, p: &Point3<f64>) -> i32 {
        self.list(p)
            .iter()
            .map(|&t| self.crossing(p, t as usize))
            .sum()
    }

    /// Number of triangles to test for a point.
    pub fn effort(&self, p: &Point3<f64>) -> usize {
        self.list(p).len()
    }

    fn list(&self, p: &Point3<f64>) -> &[u32] {
        if !self.bounds.contains(p) {
            return &[];
        }
        let cell = self.cell(p.y, 1) * self.cells + self.cell(p.z, 2);
        &self.listed[self.start[cell] as usize..self.start[cell + 1] as usize]
    }

    /// The same as [`Self::winding`], separately for each group; `group` maps a triangle to its
    /// group.
    pub fn winding_by(&self, p: &Point3<f64>, group: impl Fn(usize) -> u32) -> BTreeMap<u32, i32> {
        let mut all = BTreeMap::new();
        for &t in self.list(p) {
            *all.entry(group(t as usize)).or_insert(0) += self.crossing(p, t as usize);
        }
        all
    }

    fn crossing(&self, p: &Point3<f64>, t: usize) -> i32 {
        crossing(p, &self.corners(t))
    }

    fn corners(&self, t: usize) -> [Point3<f64>; 3] {
        self.triangles[t].map(|v| self.vertices[v as usize])
    }

    /// The line along x at `y`, `z` [m], for tests of many points on it.
    pub fn line(&self, y: f64, z: f64) -> ParityLine<'_> {
        let at = Point3::new(self.bounds.min.x, y, z);
        let covering = self.list(&at).iter().filter_map(|&t| {
            let turns = turns(&at, &self.corners(t as usize));
            (turns != 0).then_some((t, turns))
        });
        ParityLine {
            inside: self,
            at,
            covering: covering.collect(),
        }
    }
}

/// A line along x, with the triangles that it can cross.
#[derive(Debug)]
pub struct ParityLine<'a> {
    inside: &'a Inside<'a>,
    at: Point3<f64>,
    /// Each triangle with its turns about the line.
    covering: Vec<(u32, i32)>,
}

impl ParityLine<'_> {
    /// [`Inside::winding`] about the point of the line at `x` [m].
    pub fn winding(&self, x: f64) -> i32 {
        let p = Point3::new(x, self.at.y, self.at.z);
        if !self.inside.bounds.contains(&p) {
            return 0;
        }
        self.covering
            .iter()
            .map(|&(t, turns)| ahead(&p, &self.inside.corners(t as usize), turns))
            .sum()
    }

    /// Where the line crosses the surface: x [m] and the change of the winding number there, in the
    /// order of the triangles. The changes are exact; each x is rounded.
    pub fn ends(&self) -> Vec<(f64, i32)> {
        let end = |&(t, turns): &(u32, i32)| {
            let c = self.inside.corners(t as usize);
            let normal = (c[1] - c[0]).cross(&(c[2] - c[0]));
            let (dy, dz) = (self.at.y - c[0].y, self.at.z - c[0].z);
            let x = c[0].x - (normal.y * dy + normal.z * dz) / normal.x;
            let low = c[0].x.min(c[1].x).min(c[2].x);
            let high = c[0].x.max(c[1].x).max(c[2].x);
            // A triangle nearly along the line is crossed somewhere within its extent.
            let x = if x.is_finite() { x } else { 0.5 * (low + high) };
            (x.max(low).min(high), -turns)
        };
        self.covering.iter().map(end).collect()
    }
}

/// Signed number of crossings of the triangle `c` and the ray from `p` along +x.
pub(crate) fn crossing(p: &Point3<f64>, c: &[Point3<f64>; 3]) -> i32 {
    // The ray misses the triangle's box. This comparison and those of `turns` are exact and decide
    // nearly all cases.
    if c.iter().all(|v| v.x < p.x) {
        0
    } else {
        ahead(p, c, turns(p, c))
    }
}

/// Turns of the triangle about the line along x through `p`: 0 where the triangle does not cover
/// `p` in projection.
fn turns(p: &Point3<f64>, c: &[Point3<f64>; 3]) -> i32 {
    let above = |axis: usize| c.iter().all(|v| v[axis] > p[axis]);
    let below = |axis: usize| c.iter().all(|v| v[axis] < p[axis]);
    if above(1) || below(1) || above(2) || below(2) {
        return 0;
    }
    (0..3).map(|k| half_open(p, &c[k], &c[(k + 1) % 3])).sum()
}

/// The turns of a triangle that covers `p` in projection if the triangle lies ahead of `p`,
/// exactly; otherwise 0.
fn ahead(p: &Point3<f64>, c: &[Point3<f64>; 3], turns: i32) -> i32 {
    if turns == 0 || c.iter().all(|v| v.x < p.x) {
        return 0;
    }
    // `orient3d` is positive where p lies below the plane, seen with a, b, c counter-clockwise.
    let at = |v: &Point3<f64>| Coord3D {
        x: v.x,
        y: v.y,
        z: v.z,
    };
    let below = orient3d(at(&c[0]), at(&c[1]), at(&c[2]), at(p));
    let ahead = if turns > 0 { below > 0.0 } else { below < 0.0 };
    if ahead { turns } else { 0 }
}

/// Contribution of a directed edge to the turns about p in the y-z plane: +-1 where the edge
/// crosses the half line z >= p.z, y = p.y. The test always runs from the lower to the higher end,
/// so both triangles of an edge agree.
fn half_open(p: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>) -> i32 {
    let rises = a.y <= p.y && p.y < b.y;
    let falls = b.y <= p.y && p.y < a.y;
    if !(rises || falls) {
        return 0;
    }
    let (low, high) = if rises { (a, b) } else { (b, a) };
    let at = |v: &Point3<f64>| Coord { x: v.y, y: v.z };
    // Left of the rising edge, or on it: the edge does not cross the half line towards -z.
    let left = orient2d(at(low), at(high), at(p)) >= 0.0;
    match (left, rises) {
        (true, _) => 0,
        (false, true) => -1,
        (false, false) => 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;
    use crate::mesh::winding::winding_number_direct;
    use crate::testing::Draw;

    #[test]
    fn agrees_with_the_solid_angle() {
        let mesh = icosphere(1.0, 3);
        let inside = Inside::new(&mesh.vertices, &mesh.triangles);
        let mut draw = Draw::new(6);
        let mut seen = [0, 0];
        for _ in 0..4000 {
            let p = Point3::from(draw.direction() * draw.between(0.8, 1.2));
            let expected = winding_number_direct(&mesh, &p).round() as i32;
            assert_eq!(inside.winding(&p), expected, "at {p}");
            seen[expected as usize] += 1;
        }
        assert!(seen[0] > 100 && seen[1] > 100);
    }

    #[test]
    fn points_in_line_with_vertices_and_edges_are_counted_once() {
        let mesh = icosphere(1.0, 2);
        let inside = Inside::new(&mesh.vertices, &mesh.triangles);
        for v in &mesh.vertices {
            // The ray along x passes exactly through this vertex.
            for x in [-1.5, 1.5] {
                assert_eq!(inside.winding(&Point3::new(x, v.y, v.z)), 0);
            }
            let within = Point3::new(0.0, v.y, v.z);
            if winding_number_direct(&mesh, &within) > 0.99 {
                assert_eq!(inside.winding(&within), 1);
            }
        }
    }

    #[test]
    fn a_line_knows_what_its_points_know() {
        let mut mesh = icosphere(1.0, 2);
        let first = mesh.vertices.len() as u32;
        let shifted: Vec<Point3<f64>> = mesh
            .vertices
            .iter()
            .map(|v| v + nalgebra::Vector3::new(0.7, 0.1, 0.0))
            .collect();
        mesh.triangles
            .extend(mesh.triangles.clone().iter().map(|t| t.map(|v| v + first)));
        mesh.vertices.extend(shifted);
        let inside = Inside::new(&mesh.vertices, &mesh.triangles);
        let mut draw = Draw::new(9);
        let mut seen = [0; 3];
        for n in 0..600 {
            // Half of the points have a ray exactly through a vertex.
            let v = mesh.vertices[n % mesh.vertices.len()];
            let (y, z) = if n % 2 == 0 {
                (v.y, v.z)
            } else {
                (draw.between(-1.2, 1.2), draw.between(-1.2, 1.2))
            };
            let line = inside.line(y, z);
            for x in [-1.5, v.x, 0.35, draw.between(-1.1, 1.9), 2.5] {
                let expected = inside.winding(&Point3::new(x, y, z));
                assert_eq!(line.winding(x), expected, "at {x} {y} {z}");
                seen[expected as usize] += 1;
            }
        }
        assert!(seen.iter().all(|n| *n > 100), "{seen:?}");
    }
}
