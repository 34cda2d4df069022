//! Polylines bound to a surface; they follow its deformation.

use nalgebra::{Point3, Vector3};

use crate::contact::{OnTriangle, Surface};
use crate::mesh::measures::max_or_nan;

/// A point of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    corners: [u32; 3],
    weights: [f64; 3],
}

impl Place {
    fn at(&self, x: &[Point3<f64>]) -> Point3<f64> {
        let t = self.corners.map(|v| x[v as usize]);
        t[0] + (t[1] - t[0]) * self.weights[1] + (t[2] - t[0]) * self.weights[2]
    }
}

/// A point bound to the closest triangle of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Bound {
    /// A point on the surface or outside, with its height over the triangle along the normal [m].
    Over(Place, f64),
    /// A point inside, as a share of the line to the opposite triangle. Deep fibres then do not
    /// jump between two faces that bend.
    Between(Place, Place, f64),
}

/// Polylines that follow a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoundLines {
    lines: Vec<Vec<Bound>>,
    /// Greatest distance of a bound point outside the undeformed surface from it [m].
    pub outside: f64,
}

fn unit_normal(t: &[Point3<f64>; 3]) -> Vector3<f64> {
    (t[1] - t[0])
        .cross(&(t[2] - t[0]))
        .try_normalize(0.0)
        .unwrap_or_else(Vector3::zeros)
}

fn bind(surface: &Surface, p: &Point3<f64>, on: &OnTriangle) -> Bound {
    let corners = surface.triangles()[on.triangle as usize];
    let t = corners.map(|v| surface.positions()[v as usize]);
    let near = Place {
        corners,
        weights: on.weights,
    };
    let inwards = p - on.closest.point;
    let depth = inwards.norm();
    // At a smaller depth the direction is rounding error; the triangle size is the length scale.
    let deep = on.closest.distance < 0.0 && depth > 1e-6 * (t[1] - t[0]).norm();
    if deep && let Some((triangle, weights)) = surface.first_hit(p, &(inwards / depth)) {
        let far = Place {
            corners: surface.triangles()[triangle as usize],
            weights,
        };
        let thickness = (far.at(surface.positions()) - on.closest.point).norm();
        return Bound::Between(near, far, depth / thickness);
    }
    Bound::Over(near, inwards.dot(&unit_normal(&t)))
}

impl BoundLines {
    /// Binds each point of each line to the closest triangle of the surface; a point inside also to
    /// the opposite triangle.
    pub fn new(surface: &Surface, lines: &[Vec<Point3<f64>>]) -> Self {
        let mut outside = 0.0_f64;
        let mut bind = |p: &Point3<f64>| {
            let on = surface.nearest(p, f64::MAX)?;
            outside = max_or_nan([outside, on.closest.distance]);
            Some(bind(surface, p, &on))
        };
        let lines = lines
            .iter()
            .map(|line| line.iter().filter_map(&mut bind).collect())
            .collect();
        Self { lines, outside }
    }

    /// The lines for vertices of the surface at `x` [m].
    pub fn at(&self, x: &[Point3<f64>]) -> Vec<Vec<Point3<f64>>> {
        let place = |b: &Bound| match b {
            Bound::Over(place, height) => {
                place.at(x) + unit_normal(&place.corners.map(|v| x[v as usize])) * *height
            }
            Bound::Between(near, far, share) => {
                let from = near.at(x);
                from + (far.at(x) - from) * *share
            }
        };
        self.lines
            .iter()
            .map(|line| line.iter().map(place).collect())
            .collect()
    }

    /// Number of lines.
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// True for no lines.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn lines_follow_a_rigid_motion_exactly_and_stay_where_they_were() {
        let mesh = icosphere(0.1, 3);
        let line: Vec<Point3<f64>> = (0..10)
            .map(|k| Point3::new(0.01 * f64::from(k) - 0.05, 0.02, 0.06))
            .collect();
        let bound = BoundLines::new(&Surface::new(&mesh), std::slice::from_ref(&line));
        let here = &bound.at(&mesh.vertices)[0];
        let sideways =
            crate::mesh::measures::max_or_nan(line.iter().zip(here).map(|(a, b)| (a - b).norm()));
        // Inside, a point lies on the line between its two surface points; the limit is a few
        // roundings of a size of 0.1.
        assert!(sideways <= 64.0 * f64::EPSILON * 0.1, "{sideways}");
        let turn =
            nalgebra::Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -1.0, 0.5));
        let moved: Vec<Point3<f64>> = mesh.vertices.iter().map(|v| turn * v).collect();
        for (a, b) in here.iter().zip(&bound.at(&moved)[0]) {
            assert!((turn * a - b).norm() <= 1e-14 * 10.0);
        }
    }

    #[test]
    fn deep_lines_follow_any_affine_motion() {
        let mesh = icosphere(0.1, 3);
        let line: Vec<Point3<f64>> = (0..20)
            .map(|k| Point3::new(0.008 * f64::from(k) - 0.076, 0.01, 0.02))
            .collect();
        let bound = BoundLines::new(&Surface::new(&mesh), std::slice::from_ref(&line));
        let map = nalgebra::Matrix3::new(2.0, 0.5, 0.0, 0.0, 0.3, 0.1, -0.4, 0.0, 1.0);
        let moved: Vec<Point3<f64>> = mesh.vertices.iter().map(|v| map * v).collect();
        let errors = |other: f64| {
            let there = bound.at(&moved);
            crate::mesh::measures::max_or_nan(
                line.iter()
                    .zip(&there[0])
                    .map(|(a, b)| (map * a * other - b).norm()),
            )
        };
        assert!(errors(1.0) <= 64.0 * f64::EPSILON * 0.2, "{}", errors(1.0));
        assert!(
            errors(1.01) > 1e-4,
            "control: another motion is not followed"
        );
    }
}
