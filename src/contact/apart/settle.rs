//! The return of parted muscles towards their shapes as read.

use nalgebra::Point3;
use rayon::prelude::*;

use super::{Scene, Seen};

/// Greatest number of attempts to return; most of the motion that is not needed is gone by then.
const RETURNS: usize = 8;
/// Share of its motion that a muscle gives up in the first attempt.
const FIRST: f64 = 0.25;
/// Least share: less is not worth an attempt.
const LEAST: f64 = 0.02;
/// Rounds of one attempt, in which pushes remove the overlap of a small motion.
const ROUNDS: usize = 10;

impl Scene {
    /// Moves parted muscles back towards their shapes as read, as far as they stay parted. A muscle
    /// in the way of which another one stands gives up less of its motion in the next attempt.
    pub(super) fn settle_back(&mut self) {
        let mut shares = vec![FIRST; self.soft];
        for _ in 0..RETURNS {
            let before: Vec<Vec<Point3<f64>>> = self.all[..self.soft]
                .iter()
                .map(|s| s.x().to_vec())
                .collect();
            for (solid, share) in self.all.iter_mut().zip(&shares) {
                solid.go_back(*share);
                solid.refit();
            }
            let Err(failed) = self.part_again(ROUNDS) else {
                continue;
            };
            for (solid, before) in self.all.iter_mut().zip(before) {
                solid.particles.position = before;
                solid.refit();
            }
            for (share, _) in shares.iter_mut().zip(failed).filter(|(_, failed)| *failed) {
                *share = if *share > LEAST { 0.5 * *share } else { 0.0 };
            }
            if shares.iter().all(|share| *share == 0.0) {
                break;
            }
        }
    }

    /// Pushes overlap of a small motion out again. The error is true for the muscles that still
    /// overlap or are unsound.
    pub(super) fn part_again(&mut self, most: usize) -> Result<(), Vec<bool>> {
        let mut seen = self.look(false);
        let mut rounds = 0;
        while !(seen.is_clear() && self.is_sound()) {
            if rounds == most {
                return Err(self.failed(&seen));
            }
            rounds += 1;
            self.push(&seen, rounds);
            seen = self.look(false);
        }
        Ok(())
    }

    /// True for muscles of pairs that overlap, and for those that are unsound.
    fn failed(&mut self, seen: &Seen) -> Vec<bool> {
        let muscles = self.all.par_iter_mut().zip(&self.active).take(self.soft);
        let mut failed: Vec<bool> = muscles
            .map(|(solid, active)| *active && !solid.is_sound())
            .collect();
        for ((of, crossing), depth) in seen.crossing.iter().zip(&seen.depth) {
            if !crossing.is_empty() || *depth > 0.0 {
                let muscles = of.iter().filter(|s| **s < self.soft);
                muscles.for_each(|s| failed[*s] = true);
            }
        }
        failed
    }
}
