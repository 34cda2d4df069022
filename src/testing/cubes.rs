//! Surfaces of voxels, as a segmentation has them before it is smoothed.

use std::collections::BTreeMap;

use crate::mesh::TriangleMesh;
use nalgebra::Point3;

/// The surface of some cubes of a grid, each with sides of 1 mm. No two of them may touch in an edge alone.
pub fn cubes(size: [i32; 3], is_in: impl Fn([i32; 3]) -> bool) -> TriangleMesh {
    let inside = |p: [i32; 3]| (0..3).all(|k| (0..size[k]).contains(&p[k])) && is_in(p);
    let mut mesh = TriangleMesh::default();
    let mut number = BTreeMap::new();
    let all = (0..size[0])
        .flat_map(|x| (0..size[1]).flat_map(move |y| (0..size[2]).map(move |z| [x, y, z])));
    for p in all.filter(|p| inside(*p)) {
        for (axis, out) in (0..3).flat_map(|axis| [(axis, -1), (axis, 1)]) {
            let mut beside = p;
            beside[axis] += out;
            if inside(beside) {
                continue;
            }
            let corner = |u: i32, v: i32| {
                let mut c = p;
                c[axis] += i32::from(out > 0);
                c[(axis + 1) % 3] += u;
                c[(axis + 2) % 3] += v;
                c
            };
            let mut square = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            if out < 0 {
                square.reverse();
            }
            let [a, b, c, d] = square.map(|c| {
                *number.entry(c).or_insert_with(|| {
                    let x = c.map(|k| 1e-3 * f64::from(k));
                    mesh.vertices.push(Point3::from(x));
                    mesh.vertices.len() as u32 - 1
                })
            });
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}
