//! An oriented surface with nearest-point queries.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use crate::contact::{on_triangle, pseudo_normal};
use crate::mesh::closest::SurfaceTree;
use crate::mesh::{Topology, TriangleMesh};

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SupportPlace {
    /// Position [m].
    pub point: Point3<f64>,
    /// Corners of its triangle.
    pub corners: [u32; 3],
    /// Barycentric weights.
    pub weights: [f64; 3],
    /// Unit pseudo-normal of the face, side or corner that contains it \[baerentzen2005\].
    pub outward: Vector3<f64>,
    /// Size of the triangle [m].
    pub size: f64,
}

impl SupportPlace {
    /// The unit direction from the surface to `p`, whose nearest point this is.
    pub fn away(&self, p: &Point3<f64>) -> Vector3<f64> {
        let from = p - self.point;
        // At a smaller distance the direction is rounding error.
        if from.norm() <= 1e-6 * self.size {
            return self.outward;
        }
        from.normalize()
            * if from.dot(&self.outward) < 0.0 {
                -1.0
            } else {
                1.0
            }
    }
}

/// An open or closed surface, oriented outward.
///
/// The surface has no global sign: skin and bones are often open, and the side of a body follows
/// from the side from which it came.
#[derive(Clone, Debug)]
pub struct SupportSurface {
    mesh: TriangleMesh,
    topology: Arc<Topology>,
    tree: SurfaceTree,
}

impl SupportSurface {
    /// Creates a sheet from a surface with valid indices.
    pub fn new(mesh: TriangleMesh) -> Self {
        let topology = Arc::new(Topology::new(&mesh));
        Self::with(mesh, topology)
    }

    /// The same with a known topology.
    pub fn with(mesh: TriangleMesh, topology: Arc<Topology>) -> Self {
        let tree = SurfaceTree::new(&mesh.vertices, &mesh.triangles);
        Self {
            mesh,
            topology,
            tree,
        }
    }

    /// The surface.
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// Its edges and their triangles.
    pub fn topology(&self) -> &Topology {
        &self.topology
    }

    /// The surface, reversed if it faces inward: a closed surface by its volume, an open one if
    /// most of the points `outside` are on its inner side.
    pub fn facing(mut mesh: TriangleMesh, outside: &[Point3<f64>], within: f64) -> Self {
        let sheet = Self::new(mesh.clone());
        let turned = if sheet.topology.is_closed() && sheet.topology.is_oriented() {
            mesh.volume() < 0.0
        } else {
            let above = |p: &Point3<f64>| {
                sheet
                    .nearest(p, within)
                    .map(|on| (p - on.point).dot(&on.outward) >= 0.0)
            };
            let (mut over, mut under) = (0usize, 0usize);
            outside
                .iter()
                .filter_map(above)
                .for_each(|above| if above { over += 1 } else { under += 1 });
            under > over
        };
        if !turned {
            return sheet;
        }
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        Self::new(mesh)
    }

    /// The nearest point within `within` [m].
    pub fn nearest(&self, p: &Point3<f64>, within: f64) -> Option<SupportPlace> {
        let triangle = self.tree.closest(p, within)?.triangle;
        let corners = self.mesh.triangles[triangle as usize];
        let at @ [a, b, c] = corners.map(|v| self.mesh.vertices[v as usize]);
        let (weights, feature) = on_triangle(p, &at);
        let outward = pseudo_normal(
            &self.mesh.triangles,
            &self.topology,
            &self.mesh.vertices,
            triangle,
            feature,
        );
        let point = a + (b - a) * weights[1] + (c - a) * weights[2];
        Some(SupportPlace {
            point,
            corners,
            weights,
            outward,
            size: (b - a).norm() + (c - a).norm(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> TriangleMesh {
        let vertices = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[x, y]| Point3::new(x, y, 0.0))
            .to_vec();
        TriangleMesh {
            vertices,
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    #[test]
    fn weights_give_the_place_back() {
        let sheet = SupportSurface::new(square());
        for p in [
            [0.3, 0.2, 0.1],
            [0.2, 0.9, -0.4],
            [-1.0, 0.5, 0.0],
            [0.5, 0.5, 0.0],
        ]
        .map(Point3::from)
        {
            let near = sheet.nearest(&p, 2.0).expect("near");
            let corner = |k: usize| sheet.mesh.vertices[near.corners[k] as usize].coords;
            let back = (0..3)
                .map(|k| corner(k) * near.weights[k])
                .sum::<Vector3<f64>>();
            assert!((back - near.point.coords).norm() <= 1e-15, "{near:?}");
        }
        assert!(sheet.nearest(&Point3::new(0.5, 0.5, 1.0), 0.9).is_none());
    }

    #[test]
    fn sides_beside_a_sharp_edge_are_told_apart() {
        // A roof of 20 degrees that faces up at its ridge; beside the ridge a point is under the
        // plane of one face.
        let half = 10f64.to_radians();
        let (out, low) = (half.sin(), -half.cos());
        let vertices = [
            [0.0, -1.0, 0.0],
            [0.0, 1.0, 0.0],
            [out, 0.0, low],
            [-out, 0.0, low],
        ]
        .map(Point3::from)
        .to_vec();
        let roof = TriangleMesh {
            vertices,
            triangles: vec![[1, 0, 2], [0, 1, 3]],
        };
        let sheet = SupportSurface::new(roof);
        for (x, up) in [(0.1, 1.0), (-0.1, 1.0)] {
            let p = Point3::new(x, 0.0, 0.1);
            let near = sheet.nearest(&p, 1.0).expect("near");
            assert!(
                near.point.coords.norm() <= 1e-15 && near.away(&p).z * up > 0.0,
                "{near:?}"
            );
        }
        let inside = Point3::new(0.0, 0.0, -0.5);
        let near = sheet.nearest(&inside, 1.0).expect("near");
        assert!(near.away(&inside).x.abs() > 0.9 && near.away(&inside).x * near.point.x > 0.0);
    }

    #[test]
    fn a_surface_is_turned_to_what_is_outside() {
        let looks = |sheet: &SupportSurface| sheet.mesh.triangles[0] == [0, 1, 2];
        let (above, below) = (Point3::new(0.4, 0.3, 0.1), Point3::new(0.4, 0.3, -0.1));
        assert!(looks(&SupportSurface::facing(
            square(),
            &[above, above, below],
            1.0
        )));
        assert!(!looks(&SupportSurface::facing(
            square(),
            &[above, below, below],
            1.0
        )));
        // Distant points have no influence.
        assert!(looks(&SupportSurface::facing(square(), &[below], 0.01)));
    }
}
