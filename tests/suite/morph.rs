//! Morphing: maps to the sphere, overlays and blends, registration, and the bodies that its tests share.

mod correspondence;
mod overlay;
mod register;
mod sphere;
mod volume;

use nalgebra::Point3;
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::icosphere;

/// A closed tube of radius 1 along x with `rings` rings of `segments` vertices: uniform, as in the digest.
fn tube(segments: u32, rings: u32, length: f64) -> TriangleMesh {
    let mut vertices = Vec::new();
    for i in 0..rings {
        for j in 0..segments {
            let angle = std::f64::consts::TAU * f64::from(j) / f64::from(segments);
            let x = length * (f64::from(i) / f64::from(rings - 1) - 0.5);
            vertices.push(Point3::new(x, angle.cos(), angle.sin()));
        }
    }
    let at = |i: u32, j: u32| i * segments + j % segments;
    let (low, high) = (vertices.len() as u32, vertices.len() as u32 + 1);
    vertices.extend([-0.5, 0.5].map(|side| Point3::new(side * length, 0.0, 0.0)));
    let mut triangles = Vec::new();
    for j in 0..segments {
        for i in 0..rings - 1 {
            triangles.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
        }
        triangles.push([low, at(0, j + 1), at(0, j)]);
        triangles.push([high, at(rings - 1, j), at(rings - 1, j + 1)]);
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// A ball of radius 1, `times` as long along x.
fn stretched(subdivisions: u32, times: f64) -> TriangleMesh {
    let mut mesh = icosphere(1.0, subdivisions);
    mesh.vertices.iter_mut().for_each(|v| v.x *= times);
    mesh
}

/// The same, bent about an axis along z by `angle` \[rad\] from end to end.
fn bent(subdivisions: u32, times: f64, angle: f64) -> TriangleMesh {
    let mut mesh = stretched(subdivisions, times);
    let radius = 2.0 * times / angle;
    for v in &mut mesh.vertices {
        let (turn, r) = (v.x / radius, radius + v.y);
        *v = Point3::new(r * turn.sin(), r * turn.cos() - radius, v.z);
    }
    mesh
}
