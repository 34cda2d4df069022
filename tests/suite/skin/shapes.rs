//! Meshes of the second source's tests.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};
use pliant::mesh::TriangleMesh;

/// A square sheet of `n` by `n` cells about the origin with equal diagonals, facing along z.
pub fn sheet(n: u32, side: f64) -> TriangleMesh {
    let at = |k: u32| side * (f64::from(k) / f64::from(n) - 0.5);
    let vertices = (0..=n)
        .flat_map(|i| (0..=n).map(move |j| Point3::new(at(i), at(j), 0.0)))
        .collect();
    let mut triangles = Vec::new();
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let a = i * (n + 1) + j;
        triangles.extend([[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]]);
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// A cube from the origin, `n` by `n` squares on each face, closed and oriented outward.
pub fn cube(n: u32, side: f64) -> TriangleMesh {
    let mut number: HashMap<[u32; 3], u32> = HashMap::new();
    let mut mesh = TriangleMesh::default();
    let mut vertex = |mesh: &mut TriangleMesh, at: [u32; 3]| {
        *number.entry(at).or_insert_with(|| {
            mesh.vertices
                .push(Point3::from(at.map(|k| side * f64::from(k) / f64::from(n))));
            mesh.vertices.len() as u32 - 1
        })
    };
    for (axis, far) in (0..3).flat_map(|axis| [(axis, false), (axis, true)]) {
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let mut corner = |a: u32, b: u32| {
                let mut at = [0; 3];
                (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) =
                    (if far { n } else { 0 }, i + a, j + b);
                vertex(&mut mesh, at)
            };
            let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            mesh.triangles.extend(if far {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, c, b], [a, d, c]]
            });
        }
    }
    mesh
}

/// A sphere of `rings` rings of `around` vertices and two poles, closed and oriented outward.
pub fn sphere(around: u32, rings: u32, radius: f64, centre: Point3<f64>) -> TriangleMesh {
    let mut vertices = vec![centre + Vector3::z() * radius];
    for ring in 1..=rings {
        let down = PI * f64::from(ring) / f64::from(rings + 1);
        for k in 0..around {
            let turn = TAU * f64::from(k) / f64::from(around);
            let out = Vector3::new(down.sin() * turn.cos(), down.sin() * turn.sin(), down.cos());
            vertices.push(centre + out * radius);
        }
    }
    vertices.push(centre - Vector3::z() * radius);
    let at = |ring: u32, k: u32| 1 + ring * around + k % around;
    let last = vertices.len() as u32 - 1;
    let mut triangles = Vec::new();
    for k in 0..around {
        triangles.extend([
            [0, at(0, k), at(0, k + 1)],
            [last, at(rings - 1, k + 1), at(rings - 1, k)],
        ]);
        for ring in 1..rings {
            let [a, b, c, d] = [
                at(ring - 1, k),
                at(ring, k),
                at(ring, k + 1),
                at(ring - 1, k + 1),
            ];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}
