//! Pairs that are pushed apart to their distance, with friction.

use nalgebra::{Point3, Vector3};

use super::super::PosedObstacle;
use super::super::gap::{difference, gap, height};
use super::Meeting;

/// Greatest number of sweeps over all rows of a step, and the greatest correction of the last sweep
/// relative to the thickness.
const SWEEPS: usize = 12;
const NEARLY: f64 = 0.02;

/// A pair that is pushed apart in this step: C = n.(sum w x) - distance >= 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub pair: u32,
    corners: [u32; 4],
    weights: [f64; 4],
    normal: Vector3<f64>,
    distance: f64,
    /// Sum of the corrections in this step [m].
    push: f64,
}

impl Meeting {
    /// Pushes apart all pairs that are nearer than their distance, in a step to the given positions
    /// of each soft surface [m].
    pub fn respond(&mut self, bodies: &mut [&mut [Point3<f64>]], placed: &[PosedObstacle]) {
        self.update(bodies, placed);
        self.find_rows();
        if self.rows.is_empty() {
            return;
        }
        for _ in 0..SWEEPS {
            let mut largest = 0.0_f64;
            for row in &mut self.rows {
                let most = row.distance.max(NEARLY * self.settings.thickness);
                let by = row.push(&mut self.end, &self.mass, most);
                largest = largest.max(by);
            }
            if largest <= NEARLY * self.settings.thickness {
                break;
            }
        }
        self.give_end(bodies);
    }

    /// Looks again at every pair that comes nearer than its distance. Its closest points are those at
    /// the start of the step, where no pair crosses, so that the normal cannot point the wrong way.
    fn find_rows(&mut self) {
        let near = self.can_be_nearer(self.settings.thickness);
        self.certificate.pairs += near as u64;
        for (k, pair) in self.pairs[..near].iter_mut().enumerate() {
            if !(pair.distance > 0.0) || pair.row != u32::MAX {
                continue;
            }
            let end = pair.corners.map(|v| self.end[v as usize]);
            if height(pair.parts, &end, &pair.normal) >= pair.distance {
                continue;
            }
            let start = pair.corners.map(|v| self.start[v as usize]);
            let Some(found) = gap(pair.parts, &start) else {
                continue;
            };
            (pair.normal, pair.planned) = (found.normal, found.height);
            // A vertex at the end of an edge has a pair of its own.
            let is_own = pair.parts.first() == 1 || found.inner;
            if !is_own || found.normal.dot(&difference(&end, &found.weights)) >= pair.distance {
                continue;
            }
            pair.row = self.rows.len() as u32;
            self.rows.push(Row {
                pair: k as u32,
                corners: pair.corners,
                weights: found.weights,
                normal: found.normal,
                distance: pair.distance,
                push: 0.0,
            });
        }
    }

    /// Velocities lose the motion of corrections along the normal, and friction slows sliding; both
    /// as impulses of equal size and opposite direction.
    pub fn end_step(&mut self, bodies: &mut [&mut [Vector3<f64>]], dt: f64) {
        if self.rows.iter().all(|row| !(row.push > 0.0)) {
            return;
        }
        let mut velocity: Vec<Vector3<f64>> = self
            .end
            .iter()
            .zip(&self.start)
            .map(|(x, start)| (x - start) / dt)
            .collect();
        for (soft, v) in self.soft.iter().zip(bodies.iter()) {
            velocity[soft.first..soft.first + soft.count].copy_from_slice(v);
        }
        for row in self.rows.iter().filter(|row| row.push > 0.0) {
            row.slow(&mut velocity, &self.mass, self.settings.friction / dt);
        }
        for (soft, v) in self.soft.iter().zip(bodies) {
            v.copy_from_slice(&velocity[soft.first..soft.first + soft.count]);
        }
    }
}

impl Row {
    pub fn is_pushed(&self) -> bool {
        self.push > 0.0
    }

    /// The corners that the contact touches, each with the direction away from the other part.
    pub fn directions(&self) -> impl Iterator<Item = (u32, Vector3<f64>)> + '_ {
        let each = self.corners.iter().zip(&self.weights);
        each.filter(|(_, w)| **w != 0.0)
            .map(|(&v, w)| (v, self.normal * w.signum()))
    }

    /// Pushes the pair apart, at most by `most` [m]. Returns the correction [m].
    fn push(&mut self, x: &mut [Point3<f64>], mass: &[f64], most: f64) -> f64 {
        let at = self.corners.map(|v| x[v as usize]);
        let lack = self.distance - self.normal.dot(&difference(&at, &self.weights));
        if !(lack > 0.0) {
            return 0.0;
        }
        let w = self.corners.map(|v| mass[v as usize]);
        let Some(share) = self.share(&w) else {
            return 0.0;
        };
        let lack = lack.min(most);
        for ((v, w), weight) in self.corners.into_iter().zip(w).zip(self.weights) {
            x[v as usize] += self.normal * (w * weight * share * lack);
        }
        self.push += lack;
        lack
    }

    /// The reciprocal of the sum of inverse masses times squared weights. Near a fixed corner the
    /// others have no lever: no corner moves farther than twice the correction.
    fn share(&self, w: &[f64; 4]) -> Option<f64> {
        let (mut sum, mut most) = (0.0, 0.0_f64);
        for (w, weight) in w.iter().zip(&self.weights) {
            sum += w * weight * weight;
            most = most.max(0.5 * w * weight.abs());
        }
        let weight = sum.max(most);
        (weight > 0.0).then(|| 1.0 / weight)
    }

    /// Takes the velocity of separation away, and at most `limit` times the push of the sliding.
    fn slow(&self, velocity: &mut [Vector3<f64>], mass: &[f64], limit: f64) {
        let w = self.corners.map(|v| mass[v as usize]);
        let Some(share) = self.share(&w) else { return };
        let mut relative = Vector3::zeros();
        for (&v, weight) in self.corners.iter().zip(&self.weights) {
            relative += velocity[v as usize] * *weight;
        }
        let along = relative.dot(&self.normal);
        let sliding = relative - self.normal * along;
        let speed = sliding.norm();
        let mut change = self.normal * -along.max(0.0);
        let limit = limit * self.push;
        if speed > 0.0 && limit > 0.0 {
            change -= sliding * (limit / speed).min(1.0);
        }
        for ((&v, w), weight) in self.corners.iter().zip(w).zip(&self.weights) {
            velocity[v as usize] += change * (w * weight * share);
        }
    }
}
