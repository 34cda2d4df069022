//! Parted muscles lose the slivers and kinks that pushes leave.

use std::f64::consts::{PI, TAU};

use nalgebra::Point3;

use super::Scene;
use super::solid::Solid;
use crate::constraints::bending::dihedral;
use crate::mesh::measures::{max_or_nan, smallest_angle};

/// Sweeps over displacements in the first trials, each followed by pushes: what pushes move is smoothed in the next sweep.
const SWEEPS: usize = 8;
/// Greatest number of trials.
const MOST: usize = 24;
/// Rounds of one trial, in which pushes remove the overlap that comes back.
const ROUNDS: usize = 40;
/// A trial is better if it leaves at most this share.
const BETTER: f64 = 0.95;
/// Greatest RMS motion of all muscles from their shapes as read, relative to that before: another shape is worse than
/// a sliver. A muscle that moved less may move more.
pub(super) const FARTHER: f64 = 1.1;
/// A triangle is a sliver whose sharpest angle is less than this share of it as read.
const SLIVER: f64 = 0.5;
/// An edge is a kink whose triangles turned more than this against each other [rad].
const KINK: f64 = PI / 6.0;

impl Scene {
    /// Smooths the displacements of parted muscles around slivers and kinks, as far as the muscles stay parted.
    pub(super) fn even_out(&mut self) {
        let (mut left, mut sweeps) = (self.unevenness(), SWEEPS);
        let farthest = self.farthest();
        for _ in 0..MOST {
            if left == 0.0 || sweeps == 0 {
                break;
            }
            let muscles = &self.all[..self.soft];
            let before: Vec<Vec<Point3<f64>>> = muscles.iter().map(|s| s.x().to_vec()).collect();
            let around: Vec<Vec<bool>> = muscles
                .iter()
                .map(|solid| {
                    let (mut at, _) = solid.uneven();
                    solid.widen(&mut at);
                    at
                })
                .collect();
            for round in 0..sweeps {
                for (solid, around) in self.all.iter_mut().zip(&around) {
                    solid.smooth(around);
                    solid.refit();
                }
                let seen = self.look(false);
                self.push(&seen, round);
            }
            let is_parted = self.part_again(ROUNDS).is_ok();
            let is_near = self.farthest() <= FARTHER * farthest;
            let now = self.unevenness();
            if is_parted && is_near && now <= BETTER * left {
                left = now;
                continue;
            }
            sweeps /= 2;
            for (solid, before) in self.all.iter_mut().zip(before) {
                solid.particles.position = before;
                solid.refit();
            }
        }
    }

    /// The greatest motion of a muscle from its shape as read, RMS [m].
    fn farthest(&self) -> f64 {
        max_or_nan(self.all[..self.soft].iter().map(|s| s.moved().rms))
    }

    /// Sum over all muscles of how far slivers and kinks are beyond their limits, without unit.
    pub(super) fn unevenness(&self) -> f64 {
        self.all[..self.soft].iter().map(|s| s.uneven().1).sum()
    }
}

impl Solid {
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
