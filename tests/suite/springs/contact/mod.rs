//! Contact of spring systems: detection compared with brute force, response compared with the laws
//! of mechanics, bodies together.

mod bodies;
mod cube;
mod finding;
mod impulses;
mod laws;

use nalgebra::{Point3, Vector3};
use pliant::mesh::TriangleMesh;
use pliant::testing::Draw;

/// Poles, then rings of vertices from the top, by latitude and longitude; the source's spheres.
fn sphere(around: u32, rings: u32, radius: f64) -> TriangleMesh {
    let mut vertices = vec![
        Point3::new(0.0, 0.0, radius),
        Point3::new(0.0, 0.0, -radius),
    ];
    for ring in 1..=rings {
        let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings + 1);
        for k in 0..around {
            let turn = std::f64::consts::TAU * f64::from(k) / f64::from(around);
            let flat = Vector3::new(libm::cos(turn), libm::sin(turn), 0.0) * libm::sin(polar);
            vertices.push(Point3::from(
                (flat + Vector3::z() * libm::cos(polar)) * radius,
            ));
        }
    }
    let at = |ring: u32, k: u32| 2 + ring * around + k % around;
    let mut triangles = Vec::new();
    for k in 0..around {
        triangles.extend([
            [0, at(0, k), at(0, k + 1)],
            [1, at(rings - 1, k + 1), at(rings - 1, k)],
        ]);
        for ring in 0..rings - 1 {
            let [a, b, c, d] = [
                at(ring, k),
                at(ring + 1, k),
                at(ring + 1, k + 1),
                at(ring, k + 1),
            ];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// The triangles of one layer of the source's sheet (its 7.1): those of an n by n grid of side 1 with a vertex within 0.375.
fn region(n: u32) -> TriangleMesh {
    let at = |i: u32| f64::from(i) / f64::from(n) - 0.5;
    let vertices: Vec<_> = (0..=n)
        .flat_map(|i| (0..=n).map(move |j| Point3::new(at(i), at(j), 0.0)))
        .collect();
    let square = |a: u32| [[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]];
    let triangles = (0..n).flat_map(|i| (0..n).flat_map(move |j| square(i * (n + 1) + j)));
    let near = |v: &u32| vertices[*v as usize].coords.norm_squared() <= 0.375 * 0.375;
    TriangleMesh {
        triangles: triangles.filter(|t| t.iter().any(near)).collect(),
        vertices,
    }
}

/// Separate triangles of all sizes.
fn soup(draw: &mut Draw, count: usize) -> TriangleMesh {
    let mut vertices = Vec::new();
    for _ in 0..count {
        let (middle, size) = (
            draw.direction() * draw.between(0.0, 1.0),
            draw.decades(-2.0, -0.2),
        );
        (0..3).for_each(|_| vertices.push(Point3::from(middle + draw.direction() * size)));
    }
    let triangles = (0..count as u32)
        .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
        .collect();
    TriangleMesh {
        vertices,
        triangles,
    }
}

fn moved(mesh: &TriangleMesh, by: Vector3<f64>) -> TriangleMesh {
    TriangleMesh {
        vertices: mesh.vertices.iter().map(|p| p + by).collect(),
        triangles: mesh.triangles.clone(),
    }
}
