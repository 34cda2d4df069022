//! From coarse to fine: the same skin with longer edges is brought to rest first, and the finer one begins where it came to
//! lie. What is smooth is then right already, and only what is as short as an edge is left to be found.

use nalgebra::{Point3, Vector3};

use super::layers::Layers;
use super::support_surface::SupportSurface;
use crate::mesh::TriangleMesh;

/// Displacements [m] over a surface at rest, taken over to places near it.
pub struct Prolongation<'a> {
    sheet: SupportSurface,
    moved: &'a [Vector3<f64>],
}

impl<'a> Prolongation<'a> {
    /// Displacements of the vertices of a surface.
    pub fn new(surface: TriangleMesh, moved: &'a [Vector3<f64>]) -> Self {
        Self {
            sheet: SupportSurface::new(surface),
            moved,
        }
    }

    /// The displacement of the nearest place.
    pub fn at(&self, p: &Point3<f64>) -> Vector3<f64> {
        self.sheet
            .nearest(p, f64::INFINITY)
            .map_or_else(Vector3::zeros, |near| {
                near.corners
                    .iter()
                    .zip(near.weights)
                    .map(|(v, w)| self.moved[*v as usize] * w)
                    .sum()
            })
    }
}

impl Layers {
    /// Where these layers lie if coarser ones of the same skin lie at `x` [m], which begins with both of them: each vertex
    /// moves as the nearest place of its layer, and what is held stays.
    pub fn follow(&self, coarse: &Layers, x: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let moved: Vec<Vector3<f64>> = coarse
            .rest
            .iter()
            .zip(x)
            .map(|(from, to)| to - from)
            .collect();
        let (n, m) = (self.count(), coarse.count());
        let upper = TriangleMesh {
            vertices: coarse.rest[..m].to_vec(),
            triangles: coarse.triangles.clone(),
        };
        // Both layers by the nearest place of the upper one: a vertex and the one under it belong together.
        let [upper, lower] = [
            Prolongation::new(upper.clone(), &moved[..m]),
            Prolongation::new(upper, &moved[m..]),
        ];
        let at = |v: usize| {
            if self.held[v] {
                return self.rest[v];
            }
            let carried = if v < n { &upper } else { &lower };
            self.rest[v] + carried.at(&self.rest[v % n])
        };
        (0..2 * n).map(at).collect()
    }
}
