//! Regular bodies: tetrahedron, chain, sphere, tube, box.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::GeneratedShape;
use crate::mesh::TriangleMesh;
use crate::mesh::quarters::quarters;

/// The regular tetrahedron of circumradius 1 m around the origin, corner 3 on the z axis.
pub fn tetrahedron() -> TriangleMesh {
    let vertices = vec![
        Point3::new(0.942_809_041_582_063_4, 0.0, -1.0 / 3.0),
        Point3::new(-0.471_404_520_791_031_7, 0.816_496_580_927_726, -1.0 / 3.0),
        Point3::new(-0.471_404_520_791_031_7, -0.816_496_580_927_726, -1.0 / 3.0),
        Point3::new(0.0, 0.0, 1.0),
    ];
    TriangleMesh {
        vertices,
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    }
}

/// `count` points on the x axis, 1 m apart, joined by edges.
pub(super) fn chain(count: u32) -> GeneratedShape {
    let vertices = (0..count)
        .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
        .collect();
    let edges = (1..count).map(|i| [i - 1, i]).collect();
    GeneratedShape {
        mesh: TriangleMesh {
            vertices,
            triangles: Vec::new(),
        },
        edges,
        fibres: Vec::new(),
    }
}

/// A sphere of `radius` [m] around the origin: an icosahedron, each triangle split in four `subdivisions` times.
///
/// It has `10 4^n + 2` vertices, all on the sphere.
pub fn icosphere(radius: f64, subdivisions: u32) -> TriangleMesh {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let mut vertices: Vec<Vector3<f64>> = Vec::with_capacity(12);
    for (a, b) in [
        (-1.0, golden),
        (1.0, golden),
        (-1.0, -golden),
        (1.0, -golden),
    ] {
        // Three golden rectangles, one in each coordinate plane.
        vertices.extend([
            Vector3::new(a, b, 0.0),
            Vector3::new(0.0, a, b),
            Vector3::new(b, 0.0, a),
        ]);
    }
    vertices.iter_mut().for_each(|v| *v = v.normalize());
    let mut triangles = hull_of_icosahedron(&vertices);
    for _ in 0..subdivisions {
        let (quarters, middles) = quarters(&triangles, vertices.len() as u32);
        triangles = quarters;
        let at = |v: u32| vertices[v as usize];
        let middles: Vec<_> = middles
            .iter()
            .map(|&[a, b]| (at(a) + at(b)).normalize())
            .collect();
        vertices.extend(middles);
    }
    TriangleMesh {
        vertices: vertices.iter().map(|v| Point3::from(radius * v)).collect(),
        triangles,
    }
}

/// The triangles of 12 unit vectors at the corners of an icosahedron: all triples of mutual neighbours.
fn hull_of_icosahedron(corners: &[Vector3<f64>]) -> Vec<[u32; 3]> {
    // Neighbours have the cosine 1/sqrt(5), the next nearest its negative.
    let near = |i: u32, j: u32| corners[i as usize].dot(&corners[j as usize]) > 0.0;
    let mut triangles = Vec::with_capacity(20);
    for i in 0..12 {
        for j in (i + 1..12).filter(|&j| near(i, j)) {
            for k in (j + 1..12).filter(|&k| near(i, k) && near(j, k)) {
                let [a, b, c] = [i, j, k].map(|v| corners[v as usize]);
                triangles.push(if a.dot(&b.cross(&c)) > 0.0 {
                    [i, j, k]
                } else {
                    [i, k, j]
                });
            }
        }
    }
    triangles
}

/// A closed cylinder along x, centred at the origin, of `radius` and `length` [m], with `segments` (at least 3) around.
///
/// Rings lie as far apart as the vertices of a ring; each end is a flat fan.
pub fn tube(radius: f64, length: f64, segments: u32) -> TriangleMesh {
    let segments = segments.max(3);
    let turn = std::f64::consts::TAU / f64::from(segments);
    let steps = ((length / (radius * turn)).round() as u32).max(1);
    let mut vertices = Vec::new();
    for i in 0..=steps {
        let x = length * (f64::from(i) / f64::from(steps) - 0.5);
        for j in 0..segments {
            // Every other ring is turned by half a step, which makes the triangles nearly equilateral.
            let angle = turn * (f64::from(j) + 0.5 * f64::from(i % 2));
            vertices.push(Point3::new(
                x,
                radius * libm::cos(angle),
                radius * libm::sin(angle),
            ));
        }
    }
    let at = |i: u32, j: u32| i * segments + j % segments;
    let mut triangles = Vec::new();
    for i in 0..steps {
        for j in 0..segments {
            if i % 2 == 0 {
                triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
                triangles.push([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
            } else {
                triangles.push([at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
                triangles.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
            }
        }
    }
    let (low, high) = (vertices.len() as u32, vertices.len() as u32 + 1);
    vertices.push(Point3::new(-0.5 * length, 0.0, 0.0));
    vertices.push(Point3::new(0.5 * length, 0.0, 0.0));
    for j in 0..segments {
        triangles.push([low, at(0, j + 1), at(0, j)]);
        triangles.push([high, at(steps, j), at(steps, j + 1)]);
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// The surface of a box along the axes, centred at the origin, with sides of `size` and edges of about `cell` [m].
///
/// Each face is a grid of squares, split along diagonals that alternate.
pub fn box_surface(size: [f64; 3], cell: f64) -> TriangleMesh {
    let counts = size.map(|s| ((s / cell).round() as u32).max(1));
    let mut vertices = Vec::new();
    let mut ids = BTreeMap::new();
    let mut vertex = |lattice: [u32; 3]| {
        *ids.entry(lattice).or_insert_with(|| {
            vertices.push(Point3::from([0, 1, 2].map(|k| {
                size[k] * (f64::from(lattice[k]) / f64::from(counts[k]) - 0.5)
            })));
            vertices.len() as u32 - 1
        })
    };
    let mut triangles = Vec::new();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in [0, counts[axis]] {
            for (i, j) in (0..counts[u]).flat_map(|i| (0..counts[v]).map(move |j| (i, j))) {
                let mut corner = |a: u32, b: u32| {
                    let mut lattice = [0; 3];
                    (lattice[axis], lattice[u], lattice[v]) = (side, i + a, j + b);
                    vertex(lattice)
                };
                let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                let pair = if (i + j) % 2 == 0 {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[a, b, d], [b, c, d]]
                };
                triangles
                    .extend(pair.map(|[p, q, r]| if side == 0 { [p, r, q] } else { [p, q, r] }));
            }
        }
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;
    use proptest::prelude::*;

    #[test]
    fn chain_of_six() {
        let shape = chain(6);
        assert_eq!(shape.edges, [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5]]);
        assert_eq!(shape.mesh.vertices[5], Point3::new(5.0, 0.0, 0.0));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn icospheres(radius in 0.01f64..100.0, n in 0u32..4) {
            let m = icosphere(radius, n);
            prop_assert_eq!(m.vertices.len(), 10 * 4usize.pow(n) + 2);
            prop_assert_eq!(m.triangles.len(), 20 * 4usize.pow(n));
            prop_assert!(m.vertices.iter().all(|p| (p.coords.norm() - radius).abs() < 1e-14 * radius));
            let t = Topology::new(&m);
            prop_assert!(t.is_closed() && t.is_oriented() && t.euler_characteristic() == 2);
            prop_assert!(m.volume() > 2.5 * radius.powi(3));
        }

        #[test]
        fn tubes(radius in 0.1f64..2.0, length in 0.1f64..5.0, segments in 3u32..40) {
            let m = tube(radius, length, segments);
            let t = Topology::new(&m);
            prop_assert!(t.is_closed() && t.is_oriented() && t.euler_characteristic() == 2);
            let n = f64::from(segments);
            let prism = 0.5 * n * radius * radius * (std::f64::consts::TAU / n).sin() * length;
            // Turned rings cut corners off, or add them, by less than the step of the polygon.
            let circle = std::f64::consts::PI * radius * radius * length;
            prop_assert!((m.volume() - prism).abs() <= 0.51 * (circle - prism) + 0.2 * prism / n);
        }

        #[test]
        fn boxes(size in prop::array::uniform3(0.1f64..3.0), cell in 0.1f64..0.5) {
            let m = box_surface(size, cell);
            let t = Topology::new(&m);
            prop_assert!(t.is_closed() && t.is_oriented() && t.euler_characteristic() == 2);
            let volume = size[0] * size[1] * size[2];
            prop_assert!((m.volume() - volume).abs() < 1e-13 * volume);
            let area = 2.0 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0]);
            prop_assert!((m.area() - area).abs() < 1e-13 * area);
        }
    }
}
