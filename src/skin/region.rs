//! The part of the skin that can move: the triangles around the implant, by the rule of the source.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::mesh::topology::NONE;
use crate::mesh::{Topology, TriangleMesh};

/// Radius of the region relative to the base of the implant.
pub const REACH: f64 = 1.5;

/// A part of a surface as a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// Mesh of the part.
    pub mesh: TriangleMesh,
    /// The vertex of the whole mesh for each vertex, ascending.
    pub vertices: Vec<u32>,
    /// The triangle of the whole mesh for each triangle, ascending.
    pub triangles: Vec<u32>,
}

impl Region {
    /// Every triangle with at least one vertex inside, connected to vertex `seed` by vertices
    /// inside.
    pub fn around(
        mesh: &TriangleMesh,
        topology: &Topology,
        seed: u32,
        inside: impl Fn(u32) -> bool,
    ) -> Self {
        let mut seen = vec![false; mesh.vertices.len()];
        let mut taken = vec![false; mesh.triangles.len()];
        let mut open = vec![seed];
        seen[seed as usize] = true;
        while let Some(v) = open.pop() {
            for &t in topology.triangles_of_vertex(v as usize) {
                taken[t as usize] = true;
                for w in mesh.triangles[t as usize] {
                    if !seen[w as usize] && inside(w) {
                        seen[w as usize] = true;
                        open.push(w);
                    }
                }
            }
        }
        Self::of(
            mesh,
            (0..mesh.triangles.len() as u32)
                .filter(|t| taken[*t as usize])
                .collect(),
        )
    }

    /// The given triangles.
    pub fn of(mesh: &TriangleMesh, triangles: Vec<u32>) -> Self {
        let mut number = vec![NONE; mesh.vertices.len()];
        triangles
            .iter()
            .flat_map(|&t| mesh.triangles[t as usize])
            .for_each(|v| number[v as usize] = 0);
        let vertices: Vec<u32> = (0..mesh.vertices.len() as u32)
            .filter(|v| number[*v as usize] == 0)
            .collect();
        vertices
            .iter()
            .enumerate()
            .for_each(|(i, v)| number[*v as usize] = i as u32);
        let part = TriangleMesh {
            vertices: vertices
                .iter()
                .map(|v| mesh.vertices[*v as usize])
                .collect(),
            triangles: triangles
                .iter()
                .map(|t| mesh.triangles[*t as usize].map(|v| number[v as usize]))
                .collect(),
        };
        Self {
            mesh: part,
            vertices,
            triangles,
        }
    }

    /// True for each vertex on the boundary of the region, which is fixed.
    pub fn rim(&self, topology: &Topology) -> Vec<bool> {
        let mut held = vec![false; self.mesh.vertices.len()];
        let ends = topology
            .boundary_edges()
            .into_iter()
            .flat_map(|e| topology.edges[e as usize]);
        ends.for_each(|v| held[v as usize] = true);
        held
    }
}

/// The frame of an implant at a point of the skin: z along the `normal` out of the body, x along
/// the transverse component of `long`; if that is zero, along the coordinate axis most
/// perpendicular to z.
pub fn frame(
    at: &Point3<f64>,
    normal: &Vector3<f64>,
    long: Option<&Vector3<f64>>,
) -> Isometry3<f64> {
    let z = normal.try_normalize(0.0).unwrap_or_else(Vector3::z);
    let across = |v: &Vector3<f64>| (v - z * v.dot(&z)).try_normalize(1e-6 * v.norm());
    let axis = Vector3::ith(z.map(f64::abs).imin(), 1.0);
    // The most perpendicular coordinate axis always has a transverse component.
    let x = long
        .and_then(across)
        .or_else(|| across(&axis))
        .unwrap_or_else(Vector3::x);
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, z.cross(&x), z]));
    Isometry3::from_parts(
        Translation3::from(at.coords),
        UnitQuaternion::from_rotation_matrix(&rotation),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_right_handed_and_look_out() {
        for normal in [
            Vector3::x(),
            Vector3::y(),
            -Vector3::z(),
            Vector3::new(1.0, 2.0, -0.5),
        ] {
            for long in [None, Some(Vector3::new(0.3, -1.0, 2.0)), Some(normal)] {
                let frame = frame(&Point3::new(1.0, 2.0, 3.0), &normal, long.as_ref());
                assert!((frame * Vector3::z() - normal.normalize()).norm() <= 1e-12);
                let [x, y] = [frame * Vector3::x(), frame * Vector3::y()];
                assert!((x.cross(&y) - normal.normalize()).norm() <= 1e-12);
            }
            // A direction has no length.
            let along = |size: f64| {
                let long = Vector3::new(0.3, -1.0, 2.0) * size;
                frame(&Point3::origin(), &normal, Some(&long)) * Vector3::x()
            };
            for size in [1e-9, 1e9] {
                assert!((along(size) - along(1.0)).norm() <= 1e-12, "{size}");
            }
        }
    }
}
