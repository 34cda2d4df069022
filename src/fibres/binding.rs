//! Polylines bound to a surface, so that they follow its deformation.

use nalgebra::{Point3, Vector3};

use crate::contact::Surface;

/// A point bound to a triangle: barycentric weights, and a height over it along its normal [m].
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bound {
    corners: [u32; 3],
    weights: [f64; 3],
    height: f64,
}

/// Polylines that follow a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoundLines {
    lines: Vec<Vec<Bound>>,
    /// Farthest that a point of the lines lay from the surface when it was bound [m].
    pub farthest: f64,
}

fn unit_normal(t: &[Point3<f64>; 3]) -> Vector3<f64> {
    (t[1] - t[0]).cross(&(t[2] - t[0])).try_normalize(0.0).unwrap_or_else(Vector3::zeros)
}

impl BoundLines {
    /// Binds each point of each line to the closest triangle of the surface.
    pub fn new(surface: &Surface, lines: &[Vec<Point3<f64>>]) -> Self {
        let mut farthest = 0.0_f64;
        let mut bind = |p: &Point3<f64>| {
            let on = surface.nearest(p, f64::MAX)?;
            let corners = surface.triangles()[on.triangle as usize];
            let normal = unit_normal(&corners.map(|v| surface.positions()[v as usize]));
            farthest = farthest.max(on.closest.distance.abs());
            Some(Bound { corners, weights: on.weights, height: (p - on.closest.point).dot(&normal) })
        };
        let lines = lines.iter().map(|line| line.iter().filter_map(&mut bind).collect()).collect();
        Self { lines, farthest }
    }

    /// Where the lines are when the surface's vertices are at `x` [m].
    pub fn at(&self, x: &[Point3<f64>]) -> Vec<Vec<Point3<f64>>> {
        let place = |b: &Bound| {
            let t = b.corners.map(|v| x[v as usize]);
            t[0] + (t[1] - t[0]) * b.weights[1] + (t[2] - t[0]) * b.weights[2] + unit_normal(&t) * b.height
        };
        self.lines.iter().map(|line| line.iter().map(place).collect()).collect()
    }

    /// Number of lines.
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// Whether there is none.
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
        let line: Vec<Point3<f64>> = (0..10).map(|k| Point3::new(0.01 * f64::from(k) - 0.05, 0.02, 0.06)).collect();
        let bound = BoundLines::new(&Surface::new(&mesh), std::slice::from_ref(&line));
        let here = &bound.at(&mesh.vertices)[0];
        let sideways = crate::mesh::measures::greatest(line.iter().zip(here).map(|(a, b)| (a - b).norm()));
        // Deep points over an edge of two triangles are taken along the normal of one of them.
        assert!(sideways <= 0.02, "{sideways}");
        let turn = nalgebra::Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -1.0, 0.5));
        let moved: Vec<Point3<f64>> = mesh.vertices.iter().map(|v| turn * v).collect();
        for (a, b) in here.iter().zip(&bound.at(&moved)[0]) {
            assert!((turn * a - b).norm() <= 1e-14 * 10.0);
        }
    }
}
