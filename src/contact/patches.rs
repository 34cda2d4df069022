//! Patches of a surface: neighbouring triangles that a search treats together, and their motion.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::gap::max2;
use crate::mesh::measures::Aabb;

/// Greatest number of triangles in a patch: smaller ones move more nearly as one, larger ones are
/// fewer.
const MOST: usize = 32;

/// Divides triangles into patches by the middle of their longest extent, again and again.
pub(super) fn split(triangles: &[[u32; 3]], x: &[Point3<f64>]) -> Vec<Vec<u32>> {
    let centres: Vec<Vector3<f64>> = triangles
        .iter()
        .map(|t| t.iter().map(|&v| x[v as usize].coords).sum())
        .collect();
    let (mut patches, mut open) = (Vec::new(), Vec::new());
    open.push((0..triangles.len() as u32).collect::<Vec<u32>>());
    while let Some(mut patch) = open.pop() {
        if patch.len() <= MOST {
            patches.extend((!patch.is_empty()).then_some(patch));
            continue;
        }
        let places: Vec<Point3<f64>> = patch.iter().map(|&t| centres[t as usize].into()).collect();
        let sides = Aabb::of_points(&places).extents();
        let axis = sides.imax();
        let middle = patch.len() / 2;
        patch.select_nth_unstable_by(middle, |&s, &t| {
            let place = |t: u32| centres[t as usize][axis];
            place(s).total_cmp(&place(t)).then(s.cmp(&t))
        });
        let rest = patch.split_off(middle);
        open.extend([rest, patch]);
    }
    patches
}

/// Rigid motion from one pose to another one: a point moves by `matrix` times its place and `shift`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    matrix: Matrix3<f64>,
    shift: Vector3<f64>,
}

impl Turn {
    pub fn new(from: &Isometry3<f64>, to: &Isometry3<f64>) -> Self {
        let turned = |pose: &Isometry3<f64>| *pose.rotation.to_rotation_matrix().matrix();
        Self {
            matrix: turned(to) - turned(from),
            shift: to.translation.vector - from.translation.vector,
        }
    }
}

/// The motion of a patch: no vertex moves by more than `spread` [m] from the mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    mean: Vector3<f64>,
    spread: f64,
}

impl Motion {
    /// The motion of points that all move by `mean` [m].
    pub fn along(mean: Vector3<f64>) -> Self {
        Self { mean, spread: 0.0 }
    }

    /// The motion of vertices between two lists of positions [m].
    pub fn of_vertices(vertices: &[u32], from: &[Point3<f64>], to: &[Point3<f64>]) -> Self {
        Self::of_ways(vertices, |&v| to[v as usize] - from[v as usize])
    }

    /// The motion of vertices of which each moves by `way` [m].
    pub fn of_ways(vertices: &[u32], way: impl Fn(&u32) -> Vector3<f64>) -> Self {
        let mean = vertices.iter().map(&way).sum::<Vector3<f64>>() / vertices.len() as f64;
        let squares = vertices.iter().map(|v| (way(v) - mean).norm_squared());
        Self {
            mean,
            spread: squares.fold(0.0, max2).sqrt(),
        }
    }

    /// The motion of a rigid box.
    pub fn of_box(bounds: &Aabb, turn: &Turn) -> Self {
        let half = bounds.extents() * 0.5;
        let centre = bounds.min + half;
        Self {
            mean: turn.matrix * centre.coords + turn.shift,
            // A corner departs from the centre by this much, or less.
            spread: (turn.matrix.abs() * half).norm(),
        }
    }

    /// This motion and then another one.
    #[must_use]
    pub fn then(&self, other: &Self) -> Self {
        Self {
            mean: self.mean + other.mean,
            spread: self.spread + other.spread,
        }
    }

    /// The greatest motion of a vertex, or more [m].
    pub fn size(&self) -> f64 {
        self.mean.norm() + self.spread
    }

    /// The greatest motion of a vertex of one patch relative to one of another patch, or more [m].
    pub fn relative(&self, other: &Self) -> f64 {
        (self.mean - other.mean).norm() + self.spread + other.spread
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;
    use crate::testing::Draw;

    #[test]
    fn patches_divide_a_surface_and_bound_the_motion_of_their_vertices() {
        let mesh = icosphere(0.1, 3);
        let patches = split(&mesh.triangles, &mesh.vertices);
        let mut all: Vec<u32> = patches.concat();
        all.sort_unstable();
        assert_eq!(all, (0..mesh.triangles.len() as u32).collect::<Vec<_>>());
        assert!(patches.iter().all(|patch| patch.len() <= MOST));
        assert!(patches.len() <= 3 * mesh.triangles.len() / MOST);
        let mut draw = Draw::new(1);
        let x = &mesh.vertices;
        let to: Vec<Point3<f64>> = x.iter().map(|x| x + draw.direction() * 0.01).collect();
        let pose = Isometry3::new(Vector3::new(0.1, 0.0, 0.2), Vector3::new(0.3, -0.1, 0.2));
        let from = Isometry3::translation(0.0, 0.1, 0.0);
        let both = [&patches[0], &patches[1]].map(|patch| {
            let mut vertices: Vec<u32> = patch
                .iter()
                .flat_map(|&t| mesh.triangles[t as usize])
                .collect();
            vertices.dedup();
            vertices
        });
        let [one, other] = both.clone().map(|of| Motion::of_vertices(&of, x, &to));
        let rigid = both.each_ref().map(|of| {
            let bounds = Aabb::of_points(of.iter().map(|&v| &x[v as usize]));
            Motion::of_box(&bounds, &Turn::new(&from, &pose))
        });
        for &v in &both[0] {
            let by = to[v as usize] - x[v as usize];
            assert!(by.norm() <= one.size() * (1.0 + 1e-12));
            let turned = |v: u32| pose * x[v as usize] - from * x[v as usize];
            for &w in &both[1] {
                let other_by = to[w as usize] - x[w as usize];
                assert!((by - other_by).norm() <= one.relative(&other) * (1.0 + 1e-12));
                let apart = (turned(v) - turned(w)).norm();
                assert!(apart <= rigid[0].relative(&rigid[1]) * (1.0 + 1e-12));
                let mixed = (by - turned(w)).norm();
                assert!(mixed <= one.relative(&rigid[1]) * (1.0 + 1e-12));
            }
        }
        let twice = one.then(&other);
        assert!(twice.size() <= one.size() + other.size() + 1e-15);
        // A motion that is not a number is not hidden.
        let mut torn = to;
        torn[both[0][0] as usize].x = f64::NAN;
        let torn = Motion::of_vertices(&both[0], x, &torn);
        assert!(torn.size().is_nan() && torn.relative(&other).is_nan());
    }
}
