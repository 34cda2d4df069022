//! Coarse-to-fine solution: skin with longer edges comes to equilibrium first, and the finer skin
//! starts from its result. Smooth parts are then already right, and only details of the length of
//! an edge remain.

use nalgebra::{Point3, Vector3};

use super::layers::Layers;
use super::support_surface::SupportSurface;
use crate::mesh::TriangleMesh;

/// Displacements [m] over a surface at rest, interpolated at points near it.
pub struct Prolongation<'a> {
    sheet: SupportSurface,
    moved: &'a [Vector3<f64>],
}

impl<'a> Prolongation<'a> {
    /// Creates the interpolation from displacements of the vertices of a surface.
    pub fn new(surface: TriangleMesh, moved: &'a [Vector3<f64>]) -> Self {
        Self {
            sheet: SupportSurface::new(surface),
            moved,
        }
    }

    /// The displacement at the nearest point of the surface.
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
    /// Positions of these layers for coarser ones of the same skin at `x` [m], which begins with
    /// both layers: each vertex moves like the nearest point of its layer, and fixed vertices stay.
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
        // Both layers use the nearest point of the upper one: a vertex and the one below it belong
        // together.
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
