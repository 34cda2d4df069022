//! Parted muscles lose the slivers and kinks that pushes leave.

use std::f64::consts::{PI, TAU};

use nalgebra::Point3;
use rayon::prelude::*;

use super::Scene;
use super::solid::Solid;
use crate::constraints::bending::dihedral;
use crate::mesh::measures::{max_or_nan, smallest_angle};

/// Sweeps over the displacements of a muscle in the first trial. Pushes follow each; the next sweep smooths
/// what they push.
const SWEEPS: usize = 8;
/// Greatest number of trials.
const MOST: usize = 24;
/// Rounds of one trial, in which pushes remove the overlap that comes back.
const ROUNDS: usize = 40;
/// A trial is better if it leaves at most this share.
const BETTER: f64 = 0.95;
/// Greatest RMS motion of a muscle from its shape as read, relative to that before: another shape is worse
/// than a sliver.
pub(super) const FARTHER: f64 = 1.1;
/// The same, relative to its median edge, for a muscle that hardly moved before.
const NEARBY: f64 = 0.1;
/// A triangle is a sliver whose sharpest angle is less than this share of it as read.
const SLIVER: f64 = 0.5;
/// An edge is a kink whose triangles turned more than this against each other [rad].
const KINK: f64 = PI / 6.0;

impl Scene {
    /// Smooths the displacements of parted muscles around slivers and kinks, as far as the muscles stay
    /// parted. A muscle that fails has half as many sweeps in the next trial.
    pub(super) fn even_out(&mut self) {
        // What crosses itself as read is never sound, so that no trial could pass.
        if !self.is_sound() {
            return;
        }
        let mut left = self.unevenness();
        let uneven = |left: &f64| if *left > 0.0 { SWEEPS } else { 0 };
        let mut sweeps: Vec<usize> = left.iter().map(uneven).collect();
        let limits: Vec<f64> = self.all[..self.soft].iter().map(farthest).collect();
        for _ in 0..MOST {
            let Some(most) = sweeps.iter().copied().max().filter(|most| *most > 0) else {
                break;
            };
            let muscles = &self.all[..self.soft];
            let before: Vec<Vec<Point3<f64>>> = muscles.iter().map(|s| s.x().to_vec()).collect();
            let around: Vec<Vec<bool>> = muscles.iter().map(Solid::around_uneven).collect();
            for round in 0..most {
                let each = self.moving().zip(&around).zip(&sweeps);
                each.for_each(|((solid, around), sweeps)| {
                    if let Some(solid) = solid.filter(|_| round < *sweeps) {
                        solid.smooth(around);
                        solid.refit();
                    }
                });
                let seen = self.look(false);
                self.push(&seen, round);
            }
            let parted = self.part_again(ROUNDS);
            let now = self.unevenness();
            let muscles = self.all[..self.soft].iter().zip(&limits);
            let is_near: Vec<bool> = muscles.map(|(s, most)| s.moved().rms <= *most).collect();
            let is_better = now.iter().sum::<f64>() <= BETTER * left.iter().sum::<f64>();
            let is_kept = parted.is_ok() && is_better && is_near.iter().all(|near| *near);
            let failed = parted.err().unwrap_or_else(|| vec![false; now.len()]);
            let tried = sweeps.clone();
            for (m, sweeps) in sweeps.iter_mut().enumerate() {
                let is_good = !failed[m] && is_near[m] && now[m] <= BETTER * left[m];
                *sweeps = if is_good && now[m] > 0.0 {
                    *sweeps
                } else {
                    *sweeps / 2
                };
            }
            if is_kept {
                left = now;
                continue;
            }
            // A muscle that is not smoothed failed: the same trial would fail again.
            if sweeps == tried {
                sweeps.iter_mut().for_each(|sweeps| *sweeps /= 2);
            }
            for (solid, before) in self.all.iter_mut().zip(before) {
                solid.particles.position = before;
                solid.refit();
            }
        }
    }

    /// Of each muscle: the sum of how far slivers and kinks are beyond their limits, without unit. 0 for one
    /// that does not move.
    pub(super) fn unevenness(&self) -> Vec<f64> {
        let muscles = self.all.iter().zip(&self.active).take(self.soft);
        let of = |(solid, active): (&Solid, &bool)| if *active { solid.uneven().1 } else { 0.0 };
        muscles.map(of).collect()
    }
}

/// Greatest RMS motion of a muscle from its shape as read in a trial [m].
fn farthest(muscle: &Solid) -> f64 {
    max_or_nan([FARTHER * muscle.moved().rms, NEARBY * muscle.edge])
}

impl Solid {
    /// The vertices of slivers and kinks, and their neighbours.
    fn around_uneven(&self) -> Vec<bool> {
        let (mut at, _) = self.uneven();
        self.widen(&mut at);
        at
    }

    /// The vertices of slivers and kinks, and how far these are beyond their limits, without unit.
    fn uneven(&self) -> (Vec<bool>, f64) {
        let mut at = vec![false; self.x().len()];
        let mut sum = 0.0;
        for triangle in self.triangles() {
            let sharpest = |x: &[Point3<f64>]| smallest_angle(triangle.map(|v| x[v as usize]));
            let limit = SLIVER * sharpest(&self.start);
            let now = sharpest(self.x());
            if now < limit {
                sum += 1.0 - now / limit;
                triangle.iter().for_each(|&v| at[v as usize] = true);
            }
        }
        for hinge in &self.topology.hinges {
            let angle = |x: &[Point3<f64>]| dihedral(&hinge.map(|v| x[v as usize]));
            let apart = (angle(self.x()) - angle(&self.start)).abs();
            // At a sharp rim the angle is near a half turn and can change its sign.
            let turned = apart.min(TAU - apart);
            if turned > KINK {
                sum += turned / KINK - 1.0;
                hinge.iter().for_each(|&v| at[v as usize] = true);
            }
        }
        (at, sum)
    }
}
