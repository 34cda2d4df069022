//! Soft bodies and skins of the built-in scenes: a cube and its press, a sheet, a scalp over a
//! skull.

use nalgebra::Point3;

use super::{box_surface, icosphere};
use crate::mesh::TriangleMesh;
use crate::mesh::topology::NONE;

/// Side of the cube [m] and the number of squares along it, as in the second source.
const SIDE: f64 = 0.02;
const SQUARES: f64 = 8.0;

/// Radius of the ball that presses the cube [m].
const BALL: f64 = 0.01;

/// Size of the table under the cube [m].
const TABLE: [f64; 3] = [0.028, 0.004, 0.028];

/// Radius of the scalp's outside and of the skull [m].
const SCALP: f64 = 0.09;
const SKULL: f64 = 0.084;

/// A cube about the origin: 386 vertices, 768 triangles.
pub(super) fn cube() -> TriangleMesh {
    box_surface([SIDE; 3], SIDE / SQUARES)
}

/// A flat box about the origin, its large faces normal to y.
pub(super) fn table() -> TriangleMesh {
    box_surface(TABLE, 0.004)
}

/// A ball about the origin, its poles on the y axis: 134 vertices, 264 triangles.
pub(super) fn ball() -> TriangleMesh {
    globe(BALL, 12, 11)
}

/// A sphere of `radius` [m] about the origin by meridians and circles of latitude, its poles on the y axis.
fn globe(radius: f64, meridians: u32, circles: u32) -> TriangleMesh {
    let mut vertices = vec![Point3::new(0.0, radius, 0.0)];
    for i in 1..=circles {
        let down = std::f64::consts::PI * f64::from(i) / f64::from(circles + 1);
        for j in 0..meridians {
            let round = std::f64::consts::TAU * f64::from(j) / f64::from(meridians);
            let (out, up) = (radius * libm::sin(down), radius * libm::cos(down));
            vertices.push(Point3::new(
                out * libm::sin(round),
                up,
                out * libm::cos(round),
            ));
        }
    }
    vertices.push(Point3::new(0.0, -radius, 0.0));
    let last = vertices.len() as u32 - 1;
    let at = |i: u32, j: u32| 1 + (i - 1) * meridians + j % meridians;
    let mut triangles = Vec::new();
    for j in 0..meridians {
        triangles.push([0, at(1, j), at(1, j + 1)]);
        for i in 1..circles {
            let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)];
            triangles.extend([[a, c, d], [a, d, b]]);
        }
        triangles.push([last, at(circles, j + 1), at(circles, j)]);
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// A flat square of `side` [m] in the plane z = 0 about the origin, looking along z: `cells` by `cells` squares, all
/// diagonals alike.
pub fn sheet(side: f64, cells: u32) -> TriangleMesh {
    let at = |k: u32| side * (f64::from(k) / f64::from(cells) - 0.5);
    let vertices = (0..=cells)
        .flat_map(|i| (0..=cells).map(move |j| Point3::new(at(i), at(j), 0.0)))
        .collect();
    let mut triangles = Vec::with_capacity(2 * (cells as usize).pow(2));
    for (i, j) in (0..cells).flat_map(|i| (0..cells).map(move |j| (i, j))) {
        let a = i * (cells + 1) + j;
        triangles.extend([[a, a + cells + 1, a + cells + 2], [a, a + cells + 2, a + 1]]);
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// The upper half, along z, of a sphere of 90 mm about the origin: similar to a scalp, open below.
pub fn scalp() -> TriangleMesh {
    let whole = icosphere(SCALP, 5);
    // Triangles across the equator are left out, so that the boundary is even.
    let kept = |t: &&[u32; 3]| t.iter().all(|v| whole.vertices[*v as usize].z >= 0.0);
    let mut number = vec![NONE; whole.vertices.len()];
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for t in whole.triangles.iter().filter(kept) {
        triangles.push(t.map(|v| {
            let number = &mut number[v as usize];
            if *number == NONE {
                *number = vertices.len() as u32;
                vertices.push(whole.vertices[v as usize]);
            }
            *number
        }));
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// A sphere of 84 mm about the origin: similar to a skull.
pub(super) fn skull() -> TriangleMesh {
    icosphere(SKULL, 4)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;

    #[test]
    fn counts_are_those_of_the_source() {
        for (mesh, counts) in [(cube(), (386, 768)), (ball(), (134, 264))] {
            assert_eq!((mesh.vertices.len(), mesh.triangles.len()), counts);
        }
        assert!((cube().volume() - 8e-6).abs() <= 1e-18);
        // 3.93 of a sphere of radius 1 cm in this mesh.
        assert!(
            (ball().volume() - 3.932e-6).abs() <= 1e-9,
            "{}",
            ball().volume()
        );
    }

    #[test]
    fn skins_are_open_and_look_outward() {
        for (mesh, out) in [(sheet(0.2, 16), None), (scalp(), Some(Point3::origin()))] {
            let topology = Topology::new(&mesh);
            assert!(topology.is_oriented() && !topology.is_closed());
            assert_eq!(
                (topology.components().count, topology.euler_characteristic()),
                (1, 1)
            );
            for (t, [a, b, c]) in (0..mesh.triangles.len()).map(|t| (t, mesh.corners(t))) {
                let normal = (b - a).cross(&(c - a));
                let away = out.map_or_else(nalgebra::Vector3::z, |o| a - o);
                assert!(normal.dot(&away) > 0.0, "triangle {t}");
            }
        }
        assert_eq!(sheet(0.2, 64).vertices.len(), 4225);
    }
}
