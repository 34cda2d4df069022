//! Obstacles that give way a little: a band over their surface that pushes back the more the less of it is left.

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use crate::contact::{Placed, Row};
use crate::mesh::sum::tree_sum_by;

/// The energy `k (h - d)^2 / 2` of every vertex nearer to an obstacle than `h`, `d` its distance, negative inside; and the
/// same of planes that triangles must stay over. Outside of an obstacle the distance to it has a continuous derivative but
/// where two of its places are equally near, so that a minimum can be found without knowing what touches.
#[derive(Clone, Default)]
pub struct Press {
    /// Force over how far something is in the band [N/m].
    pub stiffness: f64,
    /// Height of the band [m].
    pub thickness: f64,
    /// The obstacles that each of some vertices may touch.
    near: Vec<(u32, usize)>,
    placed: Vec<Placed>,
    back: Vec<Isometry3<f64>>,
    /// Planes that points of obstacles keep triangles over.
    pub rows: Vec<Row>,
}

impl Press {
    /// Without obstacles yet, of a stiffness [N/m].
    pub fn new(stiffness: f64) -> Self {
        Self { stiffness, ..Self::default() }
    }

    /// Takes note of the obstacles as they are placed now, and of the vertices of `x` [m] nearer to them than `reach` [m]:
    /// others are not looked at until the next time.
    pub fn place(&mut self, obstacles: &[usize], placed: &[Placed], x: &[Point3<f64>], reach: f64) {
        self.placed = obstacles.iter().map(|&o| placed[o].clone()).collect();
        self.back = self.placed.iter().map(|p| p.now.inverse()).collect();
        let count = self.placed.len();
        let all = (0..x.len() * count).into_par_iter().with_min_len(256);
        let is_near = |k: &usize| self.distance(k % count, &x[k / count]).is_some_and(|(d, _)| d < reach);
        self.near = all.filter(is_near).map(|k| ((k / count) as u32, k % count)).collect();
    }

    /// Distance to an obstacle [m], and the direction in which it grows.
    fn distance(&self, o: usize, x: &Point3<f64>) -> Option<(f64, Vector3<f64>)> {
        let found = self.placed[o].obstacle.closest(&(self.back[o] * x))?;
        Some((found.distance, self.placed[o].now * found.normal))
    }

    /// What is left of the band under a vertex [m], negative where it is in the band, and the direction out of it.
    fn room(&self, (v, o): (u32, usize), x: &[Point3<f64>]) -> Option<(f64, Vector3<f64>)> {
        self.distance(o, &x[v as usize]).map(|(d, normal)| (d - self.thickness, normal)).filter(|(room, _)| *room < 0.0)
    }

    /// All vertices in the band, what is left of it under each, and the direction out of it.
    fn touching(&self, x: &[Point3<f64>]) -> Vec<(u32, f64, Vector3<f64>)> {
        let found = self.near.par_iter().with_min_len(64);
        found.filter_map(|&near| self.room(near, x).map(|(room, normal)| (near.0, room, normal))).collect()
    }

    /// Energy [J] of vertices that touch at positions `x` [m].
    fn of(&self, touching: &[(u32, f64, Vector3<f64>)], x: &[Point3<f64>]) -> f64 {
        let vertex = |k: usize| touching[k].1 * touching[k].1;
        let row = |k: usize| self.rows[k].room(x).min(0.0).powi(2);
        0.5 * self.stiffness * (tree_sum_by(touching.len(), vertex) + tree_sum_by(self.rows.len(), row))
    }

    /// Energy [J] at positions `x` [m].
    pub fn energy(&self, x: &[Point3<f64>]) -> f64 {
        self.of(&self.touching(x), x)
    }

    /// Energy [J]; adds its gradient [N].
    pub fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let touching = self.touching(x);
        touching.iter().for_each(|&(v, room, normal)| gradient[v as usize] += normal * (self.stiffness * room));
        for row in &self.rows {
            let room = row.room(x);
            if room < 0.0 {
                row.spread(self.stiffness * room, gradient);
            }
        }
        self.of(&touching, x)
    }

    /// Least height over an obstacle that is left anywhere, as a share of the band: below 0 something is in an obstacle.
    pub fn left(&self, x: &[Point3<f64>]) -> f64 {
        let vertices = self.near.iter().filter_map(|&near| self.room(near, x)).map(|(room, _)| room);
        let rows = self.rows.iter().map(|row| row.room(x));
        let least = -crate::mesh::measures::greatest(vertices.chain(rows).chain([0.0]).map(|room| -room));
        1.0 + least / self.thickness
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::contact::capsule::Capsule;
    use crate::testing::Draw;

    fn drawn() -> (Press, Vec<Point3<f64>>) {
        let mut draw = Draw::new(9);
        let capsule = Capsule { ends: [Point3::origin(), Point3::new(0.3, 0.0, 0.0)], radius: 0.1 };
        let pose = Isometry3::new(Vector3::new(0.1, -0.2, 0.05), Vector3::new(0.3, 1.0, -0.5));
        let placed = Placed { name: "bone".into(), obstacle: Arc::new(capsule), before: pose, now: pose };
        // Some inside, some in the band, some beyond.
        let x: Vec<Point3<f64>> =
            (0..40).map(|_| pose * Point3::from(draw.direction() * draw.between(0.05, 0.16))).collect();
        let mut press = Press { stiffness: 50.0, thickness: 0.03, ..Press::default() };
        press.place(&[0], &[placed], &x, 0.08);
        let terms = [(0, 0.2), (1, 0.3), (2, 0.5)];
        press.rows = vec![Row { terms, normal: draw.direction(), origin: pose * Point3::origin(), distance: 0.1 }];
        (press, x)
    }

    #[test]
    fn the_gradient_is_that_of_the_energy() {
        let (press, x) = drawn();
        let mut gradient = vec![Vector3::zeros(); x.len()];
        let energy = press.energy_and_gradient(&x, &mut gradient);
        assert!(energy == press.energy(&x) && energy > 0.0);
        let h = 1e-6;
        for v in 0..x.len() {
            for c in 0..3 {
                let (mut up, mut down) = (x.clone(), x.clone());
                up[v][c] += h;
                down[v][c] -= h;
                let slope = (press.energy(&up) - press.energy(&down)) / (2.0 * h);
                // Rounding of the energy over the step, and the change of curvature at the edge of the band.
                let limit = 1e-15 * energy / h + press.stiffness * h;
                assert!((slope - gradient[v][c]).abs() <= limit, "{slope} {}", gradient[v][c]);
            }
        }
        let touched = gradient.iter().filter(|g| g.norm() > 0.0).count();
        assert!(touched > 5 && touched < x.len(), "control: {touched} are in the band");
    }

    #[test]
    fn what_is_left_of_the_band() {
        let (mut press, x) = drawn();
        press.rows.clear();
        assert!(press.left(&x) < 0.0, "some are inside");
        press.near.clear();
        assert!((press.left(&x) - 1.0).abs() <= f64::EPSILON);
    }
}
