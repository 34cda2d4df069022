//! The volume that two closed surfaces share.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::mesh::inside::Inside;
use crate::mesh::measures::Aabb;

/// Number of lines of an integration and the step of their lattice: neighbours in the sequence of
/// Fibonacci. Such lines are spread evenly along any direction, so that thin overlaps at any slant
/// meet their share of them.
const LINES: [usize; 2] = [6765, 4181];

/// Lines of one unit of work; partial sums are added in order, so that threads change no bit.
const CHUNK: usize = 123;

/// The volume that lies within both surfaces [m3]; `within` is a box that contains it.
///
/// The integral of the shared length over lines along x. The winding numbers of both surfaces are
/// exact on each line; the positions of their ends are rounded once. The error comes from the
/// number of lines: at most 0.5 % for convex overlaps that fill a quarter of the box or more
/// (spheres, boxes at any angle), in proportion more for overlaps that fill less of it.
pub fn shared_volume(first: &Inside<'_>, second: &Inside<'_>, within: &Aabb) -> f64 {
    if within.is_empty() {
        return 0.0;
    }
    let (low, sides) = (within.min, within.extents());
    let [count, step] = LINES;
    let chunk = |start: usize| -> f64 {
        let end = (start + CHUNK).min(count);
        (start..end)
            .map(|i| {
                let [v, w] = [i, i * step % count].map(|n| (n as f64 + 0.5) / count as f64);
                shared_length(first, second, low.y + sides.y * v, low.z + sides.z * w)
            })
            .sum()
    };
    let starts: Vec<usize> = (0..count).step_by(CHUNK).collect();
    let sums: Vec<f64> = starts.into_par_iter().map(chunk).collect();
    sums.iter().sum::<f64>() / count as f64 * sides.y * sides.z
}

/// The length of the line along x at `y`, `z` within both surfaces [m].
fn shared_length(first: &Inside<'_>, second: &Inside<'_>, y: f64, z: f64) -> f64 {
    let ends = |of: &Inside<'_>, k: usize| -> Vec<(f64, usize, i32)> {
        let ends = of.line(y, z).ends();
        ends.into_iter().map(|(x, turns)| (x, k, turns)).collect()
    };
    let mut all = ends(first, 0);
    if all.is_empty() {
        return 0.0;
    }
    let others = ends(second, 1);
    if others.is_empty() {
        return 0.0;
    }
    all.extend(others);
    all.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let (mut winding, mut length, mut before) = ([0, 0], 0.0, 0.0);
    for (x, k, turns) in all {
        if winding[0] != 0 && winding[1] != 0 {
            length += x - before;
        }
        winding[k] += turns;
        before = x;
    }
    length
}

/// The smallest box around the intersections of the boxes of pairs of triangles.
pub fn box_of_pairs(pairs: impl IntoIterator<Item = [[Point3<f64>; 3]; 2]>) -> Aabb {
    let mut all = Aabb::EMPTY;
    for pair in pairs {
        let [one, other] = pair.map(|corners| Aabb::of_points(&corners));
        all = all.union(&one.intersection(&other));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriangleMesh;
    use crate::mesh::shapes::{box_surface, icosphere};
    use crate::testing::Draw;
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    use std::f64::consts::PI;

    fn moved(mesh: &TriangleMesh, pose: &Isometry3<f64>) -> TriangleMesh {
        TriangleMesh {
            vertices: mesh.vertices.iter().map(|p| pose * p).collect(),
            triangles: mesh.triangles.clone(),
        }
    }

    fn shared(a: &TriangleMesh, b: &TriangleMesh) -> f64 {
        let (of_a, of_b) = (
            Inside::new(&a.vertices, &a.triangles),
            Inside::new(&b.vertices, &b.triangles),
        );
        let within = a.bounding_box().intersection(&b.bounding_box());
        let found = shared_volume(&of_a, &of_b, &within);
        let swapped = shared_volume(&of_b, &of_a, &within);
        assert!(
            (found - swapped).abs() <= 1e-12 * found.abs(),
            "{found} {swapped}"
        );
        found
    }

    #[test]
    fn lenses_of_spheres() {
        let ball = icosphere(1.0, 5);
        // The polyhedron is smaller than the sphere, by this share.
        let share = ball.volume() / (4.0 / 3.0 * PI);
        for apart in [0.2, 0.7, 1.2, 1.6, 1.9] {
            let direction = Vector3::new(0.6, -0.48, 0.64);
            let other = moved(
                &ball,
                &Isometry3::translation(
                    direction.x * apart,
                    direction.y * apart,
                    direction.z * apart,
                ),
            );
            let exact = PI / 12.0 * (4.0 + apart) * (2.0 - apart) * (2.0 - apart) * share;
            let found = shared(&ball, &other);
            let error = found / exact - 1.0;
            println!("spheres {apart} apart: {found:.6} of {exact:.6} m3, error {error:.1e}");
            let height = 2.0 - apart;
            assert!(error.abs() <= 5e-3 + 2e-3 / height, "{apart}: {error}");
        }
        let far = moved(&ball, &Isometry3::translation(2.5, 0.0, 0.0));
        assert_eq!(shared(&ball, &far), 0.0);
    }

    #[test]
    fn boxes_at_any_angle() {
        let mut draw = Draw::new(12);
        let one = box_surface([1.0, 0.8, 0.6], 0.2);
        for _ in 0..20 {
            // The second box is the first, moved along its own axes: a box is shared.
            let by = Vector3::new(
                draw.between(0.0, 0.7),
                draw.between(0.0, 0.5),
                draw.between(0.0, 0.4),
            );
            let turn = UnitQuaternion::from_scaled_axis(draw.direction() * draw.between(0.0, 3.0));
            let turned = Isometry3::from_parts(Vector3::new(3.0, -2.0, 1.0).into(), turn);
            let other = moved(&one, &Isometry3::translation(by.x, by.y, by.z));
            let exact = (1.0 - by.x) * (0.8 - by.y) * (0.6 - by.z);
            let (a, b) = (moved(&one, &turned), moved(&other, &turned));
            let error = shared(&a, &b) / exact - 1.0;
            assert!(error.abs() <= 1e-2, "{by}: {error}");
        }
    }

    #[test]
    fn a_surface_within_another_and_a_hollow_one() {
        let (outer, inner) = (icosphere(1.0, 3), icosphere(0.4, 3));
        let error = shared(&outer, &inner) / inner.volume() - 1.0;
        assert!(error.abs() <= 5e-3, "{error}");
        // The hole of a hollow body is not within it.
        let mut hollow = outer.clone();
        let first = hollow.vertices.len() as u32;
        hollow.vertices.extend(icosphere(0.7, 3).vertices);
        let inward = inner
            .triangles
            .iter()
            .map(|[a, b, c]| [first + b, first + a, first + c]);
        hollow.triangles.extend(inward);
        assert_eq!(shared(&hollow, &inner), 0.0);
    }
}
