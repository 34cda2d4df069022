//! The contour of a plane and a surface.

use std::collections::BTreeMap;

use nalgebra::{Point2, Vector2, Vector3};

use crate::mesh::TriangleMesh;

/// A surface in the axes of its slices.
pub struct Slicer<'a> {
    triangles: &'a [[u32; 3]],
    /// Coordinates along the two transverse axes and the main axis.
    own: Vec<Vector3<f64>>,
}

impl<'a> Slicer<'a> {
    /// A surface with its axes, the main axis last.
    pub fn new(muscle: &'a TriangleMesh, axes: &[Vector3<f64>; 3]) -> Self {
        let own = muscle
            .vertices
            .iter()
            .map(|p| Vector3::from(axes.map(|a| a.dot(&p.coords))))
            .collect();
        Self {
            triangles: &muscle.triangles,
            own,
        }
    }

    /// The contour at a height, counter-clockwise about the main axis; of several contours the one
    /// with the greatest area.
    ///
    /// A vertex in the plane counts as above it, so the plane cuts every edge once or not at all. A
    /// straight line closes the open contours of an open surface.
    pub fn cut(&self, height: f64) -> Option<Vec<Point2<f64>>> {
        let above = |v: u32| self.own[v as usize].z >= height;
        let mut sides: Vec<[[u32; 2]; 2]> = Vec::new();
        for t in self.triangles {
            let edges = [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
            let mut found = edges
                .iter()
                .filter(|[a, b]| above(*a) != above(*b))
                .map(|&[a, b]| [a.min(b), a.max(b)]);
            if let (Some(first), Some(second)) = (found.next(), found.next()) {
                sides.push([first.min(second), first.max(second)]);
            }
        }
        // Duplicate triangles count once.
        sides.sort_unstable();
        sides.dedup();
        let lines = chains(&sides);
        let point = |[a, b]: [u32; 2]| {
            let (a, b) = (self.own[a as usize], self.own[b as usize]);
            Point2::from((a + (b - a) * ((height - a.z) / (b.z - a.z))).xy())
        };
        let contours = lines
            .into_iter()
            .map(|line| line.into_iter().map(point).collect::<Vec<_>>());
        let mut best =
            contours.max_by(|a, b| signed_area(a).abs().total_cmp(&signed_area(b).abs()))?;
        if signed_area(&best) < 0.0 {
            best.reverse();
        }
        Some(best)
    }
}

/// Twice the signed area \[m2\], positive for a counter-clockwise contour.
fn signed_area(contour: &[Point2<f64>]) -> f64 {
    let Some(&first) = contour.first() else {
        return 0.0;
    };
    let next = contour.iter().cycle().skip(1);
    let of = |(a, b): (&Point2<f64>, &Point2<f64>)| {
        let (a, b): (Vector2<f64>, Vector2<f64>) = (a - first, b - first);
        a.x * b.y - a.y * b.x
    };
    contour.iter().zip(next).map(of).sum()
}

/// Chains of sides: lists of edges, each cut once by the plane.
fn chains(sides: &[[[u32; 2]; 2]]) -> Vec<Vec<[u32; 2]>> {
    let mut at: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
    for (s, ends) in sides.iter().enumerate() {
        ends.iter()
            .for_each(|end| at.entry(*end).or_default().push(s));
    }
    let mut done = vec![false; sides.len()];
    let mut all = Vec::new();
    // Starts with loose ends, so that an open line is one chain.
    let loose = at
        .iter()
        .filter(|(_, s)| s.len() == 1)
        .map(|(edge, _)| *edge);
    let starts: Vec<[u32; 2]> = loose.chain(sides.iter().map(|s| s[0])).collect();
    for start in starts {
        let (mut line, mut edge) = (Vec::new(), start);
        while let Some(&s) = at
            .get(&edge)
            .and_then(|list| list.iter().find(|s| !done[**s]))
        {
            done[s] = true;
            line.push(edge);
            edge = if sides[s][0] == edge {
                sides[s][1]
            } else {
                sides[s][0]
            };
        }
        if !line.is_empty() {
            if edge != start {
                line.push(edge);
            }
            all.push(line);
        }
    }
    all
}
