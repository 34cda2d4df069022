//! The guarantee: motion is taken back until every pair is in order along its normal.

use nalgebra::Point3;

use super::super::PosedObstacle;
use super::super::gap::{ROUNDING, gap, height};
use super::{Meeting, Pair};

/// Number of rounds in which pairs are moved apart along their normals before their vertices go
/// back towards the start of the step.
const ROUNDS: usize = 24;

/// Number of times that the motion of a vertex is halved before it is held.
const HALVINGS: u8 = 5;

impl Meeting {
    /// Takes back motion of the given positions [m] of each soft surface until no pair crosses.
    /// Returns the numbers of changed vertices, ascending, for each surface.
    pub fn hold(
        &mut self,
        bodies: &mut [&mut [Point3<f64>]],
        placed: &[PosedObstacle],
    ) -> Vec<Vec<u32>> {
        self.set_end(bodies, placed);
        let wanted = self.end[..self.soft_count].to_vec();
        let mut halvings = vec![0_u8; self.soft_count];
        let mut is_moved = self.cap();
        let mut open = 0;
        for round in 0.. {
            self.moved = self.motion(placed);
            let near = self.can_be_nearer(0.0);
            let (mut is_in_order, mut stuck) = (true, 0);
            for k in 0..near {
                if self.is_in_order(k) {
                    continue;
                }
                let pair = self.pairs[k];
                let done = if round < ROUNDS && !pair.is_blind {
                    part(&pair, self.kept, &self.start, &mut self.end, &self.mass)
                } else {
                    self.go_back(&pair, &mut halvings)
                };
                (is_in_order, stuck) = if done {
                    (false, stuck)
                } else {
                    (is_in_order, stuck + 1)
                };
                is_moved |= done;
            }
            open = stuck;
            if is_in_order {
                break;
            }
        }
        self.certificate.open += open;
        self.certificate.held += halvings.iter().filter(|h| **h > HALVINGS).count() as u64;
        if !is_moved {
            return vec![Vec::new(); self.soft.len()];
        }
        let changed = |soft: &super::Soft| -> Vec<u32> {
            (0..soft.count as u32)
                .filter(|&v| {
                    let v = soft.first + v as usize;
                    self.end[v] != wanted[v]
                })
                .collect()
        };
        let changed: Vec<Vec<u32>> = self.soft.iter().map(changed).collect();
        self.certificate.truncated += changed.iter().map(|c| c.len() as u64).sum::<u64>();
        self.give_end(bodies);
        changed
    }

    /// Notes the least gap at the end of a step.
    pub fn note_gaps(&mut self) {
        let near = self.can_be_nearer(self.settings.thickness);
        for pair in &self.pairs[..near] {
            let end = pair.corners.map(|v| self.end[v as usize]);
            self.certificate.least_gap =
                self.certificate
                    .least_gap
                    .min(height(pair.parts, &end, &pair.normal));
        }
    }

    /// Shortens motion with which a vertex could reach one that is not listed.
    fn cap(&mut self) -> bool {
        let most = 0.49 * self.reach[0].min(self.reach[1]);
        let mut is_moved = false;
        for v in (0..self.soft_count).filter(|&v| self.mass[v] > 0.0) {
            let (from, x) = (self.listed_at[v], self.end[v]);
            if !((x - from).norm() <= most) {
                let start = self.start[v];
                let room = (most - (start - from).norm()).max(0.0);
                let way = x - start;
                self.end[v] = start + way * (room / way.norm()).min(1.0);
                is_moved = true;
            }
        }
        is_moved
    }

    /// True if a pair is in order along its normal, or along the one that its closest points at the
    /// start give.
    fn is_in_order(&mut self, k: usize) -> bool {
        let pair = self.pairs[k];
        let end = pair.corners.map(|v| self.end[v as usize]);
        if !pair.is_blind {
            let left = height(pair.parts, &end, &pair.normal);
            if left >= self.kept * pair.planned && pair.planned > 0.0 {
                return true;
            }
        }
        let start = pair.corners.map(|v| self.start[v as usize]);
        let Some(found) = gap(pair.parts, &start) else {
            // Without a certificate the pair may only stay as it is.
            self.pairs[k].is_blind = true;
            return end == start;
        };
        let pair = &mut self.pairs[k];
        pair.is_blind = false;
        let before = height(pair.parts, &start, &pair.normal);
        if !(before > 0.0 && height(pair.parts, &end, &pair.normal) >= self.kept * before) {
            (pair.normal, pair.planned) = (found.normal, found.height);
        } else {
            pair.planned = before;
        }
        height(pair.parts, &end, &pair.normal) >= self.kept * pair.planned
    }

    /// Moves the free vertices of a pair back towards the start. Returns false if all are there.
    fn go_back(&mut self, pair: &Pair, halvings: &mut [u8]) -> bool {
        let mut is_moved = false;
        for v in pair.corners.map(|v| v as usize) {
            if !(self.mass[v] > 0.0) || self.end[v] == self.start[v] {
                continue;
            }
            halvings[v] += 1;
            self.end[v] = if halvings[v] > HALVINGS {
                self.start[v]
            } else {
                self.start[v] + (self.end[v] - self.start[v]) * 0.5
            };
            is_moved = true;
        }
        is_moved
    }
}

/// Moves the free vertices of a pair along its normal until its parts are in order again. The parts
/// share the way; one that cannot move leaves it to the other. Returns false if no vertex moved.
fn part(
    pair: &Pair,
    kept: f64,
    start: &[Point3<f64>],
    end: &mut [Point3<f64>],
    mass: &[f64],
) -> bool {
    let split = pair.parts.first();
    let origin = start[pair.corners[0] as usize];
    let heights = pair
        .corners
        .map(|v| (end[v as usize] - origin).dot(&pair.normal));
    let is_free = pair.corners.map(|v| mass[v as usize] > 0.0);
    // Least height of the first part and greatest of the second one: of all corners and of fixed ones.
    let [mut low, mut top, mut low_fixed, mut top_fixed] = [f64::INFINITY; 4];
    for k in 0..4 {
        let (least, fixed, height) = if k < split {
            (&mut low, &mut low_fixed, heights[k])
        } else {
            (&mut top, &mut top_fixed, -heights[k])
        };
        *least = least.min(height);
        if !is_free[k] {
            *fixed = fixed.min(height);
        }
    }
    let [top, top_fixed] = [-top, -top_fixed];
    // Twice the share that must be kept, so that rounds end.
    let gap = 2.0 * kept * pair.planned;
    let middle = 0.5 * (low + top);
    // The plane gives way to vertices that cannot move.
    let (mut floor, mut ceiling) = (middle + 0.5 * gap, middle - 0.5 * gap);
    if floor > low_fixed {
        (floor, ceiling) = (low_fixed, low_fixed - gap);
    }
    if ceiling < top_fixed {
        (floor, ceiling) = (top_fixed + gap, top_fixed);
    }
    let mut is_moved = false;
    for (k, &v) in pair.corners.iter().enumerate().filter(|(k, _)| is_free[*k]) {
        let to = if k < split {
            heights[k].max(floor)
        } else {
            heights[k].min(ceiling)
        };
        let (at, by) = (&mut end[v as usize], to - heights[k]);
        if by != 0.0 {
            *at += pair.normal * by;
            is_moved |= by.abs() > ROUNDING * at.coords.amax();
        }
    }
    is_moved
}
