//! A surface as a file of VTK has it, and geometry by sums over all triangles.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::Path;

pub type Vector = [f64; 3];

pub fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

pub fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// `a + s b`.
pub fn along(a: Vector, s: f64, b: Vector) -> Vector {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// A surface in a frame.
pub struct Shape {
    /// Vertices [m].
    pub x: Vec<Vector>,
    pub triangles: Vec<[usize; 3]>,
    /// Numbers of vertices by their names in the file.
    pub fields: BTreeMap<String, Vec<f64>>,
}

impl Shape {
    /// Reads a file of VTK.
    pub fn read(path: &Path) -> Self {
        let mesh = pliant::io::read(path).unwrap().mesh;
        let fields = pliant::io::read_point_data(path).unwrap();
        Self {
            x: mesh.vertices.iter().map(|p| [p.x, p.y, p.z]).collect(),
            triangles: mesh
                .triangles
                .iter()
                .map(|t| t.map(|v| v as usize))
                .collect(),
            fields: fields
                .into_iter()
                .map(|field| (field.name, field.values))
                .collect(),
        }
    }

    pub fn corners(&self, t: &[usize; 3]) -> [Vector; 3] {
        t.map(|v| self.x[v])
    }

    pub fn is_held(&self, v: usize) -> bool {
        self.fields["attached"][v] != 0.0
    }

    pub fn edges(&self) -> Vec<[usize; 2]> {
        let sides = |t: &[usize; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
        let each = self.triangles.iter().flat_map(sides);
        each.filter(|[a, b]| a < b).collect()
    }

    pub fn volume(&self) -> f64 {
        let each = self.triangles.iter().map(|t| {
            let [a, b, c] = self.corners(t);
            dot(a, cross(b, c)) / 6.0
        });
        each.sum()
    }

    /// The winding number by solid angles: one inside.
    pub fn contains(&self, p: Vector) -> bool {
        let each = self.triangles.iter().map(|t| {
            let [a, b, c] = self.corners(t).map(|q| sub(q, p));
            let [la, lb, lc] = [a, b, c].map(norm);
            let below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
            2.0 * dot(a, cross(b, c)).atan2(below)
        });
        each.sum::<f64>() > 2.0 * PI
    }

    pub fn distance(&self, p: Vector) -> f64 {
        let each = self.triangles.iter().map(|t| apart(p, self.corners(t)));
        each.fold(f64::INFINITY, |a, b| if b >= a { a } else { b })
    }

    /// Where a ray first meets the surface, as multiples of its direction.
    pub fn first_hit(&self, from: Vector, direction: Vector) -> Option<f64> {
        let each = self.triangles.iter();
        let hits = each.filter_map(|t| hit(from, direction, self.corners(t)));
        hits.filter(|s| *s > 0.0).min_by(f64::total_cmp)
    }

    /// Pairs of triangles that cross, of this surface and another one.
    pub fn crossings(&self, other: &Self) -> usize {
        let each = self.triangles.iter().flat_map(|a| {
            let a = self.corners(a);
            let b = other.triangles.iter().map(|b| other.corners(b));
            b.filter(move |b| cuts(&a, b) || cuts(b, &a))
        });
        each.count()
    }
}

/// The distance of a point from a triangle.
fn apart(p: Vector, [a, b, c]: [Vector; 3]) -> f64 {
    let normal = cross(sub(b, a), sub(c, a));
    let inside = [[a, b], [b, c], [c, a]]
        .iter()
        .all(|[a, b]| dot(cross(normal, sub(*b, *a)), sub(p, *a)) >= 0.0);
    if inside {
        return (dot(sub(p, a), normal) / norm(normal)).abs();
    }
    let edge = |[a, b]: [Vector; 2]| {
        let d = sub(b, a);
        let s = (dot(sub(p, a), d) / dot(d, d)).clamp(0.0, 1.0);
        norm(sub(p, along(a, s, d)))
    };
    [[a, b], [b, c], [c, a]]
        .map(edge)
        .into_iter()
        .min_by(f64::total_cmp)
        .unwrap()
}

/// Where a line meets a triangle.
pub fn hit(from: Vector, d: Vector, [a, b, c]: [Vector; 3]) -> Option<f64> {
    let [e, f] = [sub(b, a), sub(c, a)];
    let q = cross(d, f);
    let determinant = dot(e, q);
    let to = sub(from, a);
    let u = dot(to, q) / determinant;
    let r = cross(to, e);
    let v = dot(d, r) / determinant;
    let is_inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
    is_inside.then(|| dot(f, r) / determinant)
}

/// True if an edge of the first triangle meets the second one.
fn cuts(a: &[Vector; 3], b: &[Vector; 3]) -> bool {
    (0..3).any(|k| {
        let (from, to) = (a[k], a[(k + 1) % 3]);
        hit(from, sub(to, from), *b).is_some_and(|s| (0.0..=1.0).contains(&s))
    })
}
