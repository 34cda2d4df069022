//! The guarantee: motion is taken back until every pair is in order along its normal.

use nalgebra::{Point3, Vector3};

use super::super::gap::{Parts, ROUNDING, gap, height};
use super::super::patches::{Motion, Turn};
use super::lists::AHEAD;
use super::{Key, Meeting};
use crate::mesh::measures::Aabb;

/// Number of rounds in which pairs are moved apart along their normals before their vertices go
/// back towards the start of the step.
const ROUNDS: usize = 24;

/// Greatest number of all rounds: what moves back can be pushed again by vertices that bones hold.
const ALL_ROUNDS: usize = 200;

/// Number of times that the motion of a vertex is halved before it is held.
const HALVINGS: u8 = 5;

/// Greatest motion of a vertex in a step, relative to the mean of its surface and to the median
/// edge, besides that of bones: lists of pairs that move more are long.
const STRIDE: f64 = 0.5;

/// A pair that a step brings out of order.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    parts: Parts,
    corners: [u32; 4],
    /// The normal and the gap [m] at the start; `None` for parts that touch there.
    plane: Option<(Vector3<f64>, f64)>,
}

impl Meeting {
    /// Takes back motion of the given positions [m] of each soft surface until no pair crosses.
    /// Returns the numbers of changed vertices, ascending, for each surface.
    pub fn hold(&mut self, bodies: &mut [&mut [Point3<f64>]]) -> Vec<Vec<u32>> {
        let mut is_moved = self.set_end(bodies);
        let (mut found, mut halvings): (Vec<Crossing>, Vec<u8>) = Default::default();
        let mut round = 0;
        let open = loop {
            let now = self.crossings();
            let (open, known) = (now.len(), found.len());
            found.extend(now);
            found.sort_unstable_by_key(Crossing::key);
            found.dedup_by_key(|crossing| crossing.key());
            if found.len() == known || round >= ALL_ROUNDS {
                break open;
            }
            while round < ALL_ROUNDS && self.put_back(&found, round < ROUNDS, &mut halvings) {
                (round, is_moved) = (round + 1, true);
            }
            self.note_step();
        };
        self.certificate.open += open as u64;
        self.certificate.held += halvings.iter().filter(|h| **h > HALVINGS).count() as u64;
        if !is_moved {
            return vec![Vec::new(); bodies.len()];
        }
        let mut changed = Vec::new();
        for (member, wanted) in self.members.iter().zip(bodies.iter()) {
            let end = &self.end[member.first..member.first + member.count];
            let moved = (0..member.count).filter(|&v| end[v] != wanted[v]);
            changed.push(moved.map(|v| v as u32).collect::<Vec<u32>>());
        }
        self.certificate.truncated += changed.iter().map(|c| c.len() as u64).sum::<u64>();
        self.give_end(bodies);
        changed
    }

    /// Puts the pairs that are not in order back into it, in turn: by motion `along` their normals, or
    /// towards the start. Returns true if a vertex moved.
    fn put_back(&mut self, found: &[Crossing], along: bool, halvings: &mut Vec<u8>) -> bool {
        let mut is_moved = false;
        for crossing in found {
            if crossing.is_in_order(&self.start, &self.end, self.kept) {
                continue;
            }
            let back = !along || crossing.plane.is_none();
            let mut done = back && self.go_back(&crossing.corners, halvings);
            // Going back does not help against vertices that bones move.
            if let Some(plane) = crossing.plane.filter(|_| !done) {
                done = crossing.part(plane, self);
            }
            is_moved |= done;
        }
        is_moved
    }

    /// Shortens motion by which a vertex leaves its surroundings. Returns true if there was any.
    pub(super) fn cap(&mut self) -> bool {
        let count = self.soft().len();
        let bounds = Aabb::of_points(&self.start[..self.soft_count]);
        let mut most = 0.0_f64;
        for bone in self.members.iter().filter_map(|m| m.bone.as_ref()) {
            let near = bounds.transformed(&bone.before.inverse());
            most = most.max(Motion::of_box(&near, &Turn::new(&bone.before, &bone.now)).size());
        }
        most += STRIDE * self.edge;
        let mut is_moved = false;
        for member in 0..count {
            let (first, count) = (self.members[member].first, self.members[member].count);
            let all = first..first + count;
            let way = |v: usize| self.end[v] - self.start[v];
            let mean = all.clone().map(way).sum::<Vector3<f64>>() / count as f64;
            let mut patches = self.patches.iter().filter(|p| p.member == member);
            if patches.all(|p| p.step.relative(&Motion::along(mean)) <= most) {
                continue;
            }
            for v in all.filter(|&v| self.mass[v] > 0.0) {
                let way = self.end[v] - self.start[v] - mean;
                let long = way.norm();
                if long <= most {
                    continue;
                }
                let to = self.start[v] + mean + way * (most / long);
                let is_sound = to.iter().all(|c| c.is_finite());
                self.end[v] = if is_sound { to } else { self.start[v] };
                is_moved = true;
            }
        }
        is_moved
    }

    /// The pairs that are not in order at the end of the step.
    fn crossings(&mut self) -> Vec<Crossing> {
        let kept = self.kept;
        self.look(|bucket, moved, [start, end], found| {
            // A pair with this gap stays in order, whatever its normal is.
            let safe = moved.step / (0.999 - kept);
            for pair in bucket.nearer(AHEAD * moved.step, moved.before) {
                if pair.at_least(start) >= safe {
                    continue;
                }
                let gap = gap(pair.parts, &pair.of(start));
                if let Some(gap) = gap {
                    pair.normal = gap.normal;
                }
                let crossing = Crossing {
                    parts: pair.parts,
                    corners: pair.corners,
                    plane: gap.map(|gap| (gap.normal, gap.height)),
                };
                if !crossing.is_in_order(start, end, kept) {
                    found.push(crossing);
                }
            }
        })
    }

    /// Moves the free vertices of a pair back towards the start. Returns false if all are there.
    fn go_back(&mut self, corners: &[u32; 4], halvings: &mut Vec<u8>) -> bool {
        halvings.resize(self.soft_count, 0);
        let mut is_moved = false;
        for v in corners.map(|v| v as usize) {
            if !(self.mass[v] > 0.0) || self.end[v] == self.start[v] {
                continue;
            }
            halvings[v] = halvings[v].saturating_add(1);
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

impl Crossing {
    fn key(&self) -> Key {
        (self.parts, self.corners)
    }

    /// True if the parts are in the order of the start at the end, with a share of their gap.
    fn is_in_order(&self, start: &[Point3<f64>], end: &[Point3<f64>], kept: f64) -> bool {
        let at = |x: &[Point3<f64>]| self.corners.map(|v| x[v as usize]);
        match &self.plane {
            Some((normal, gap)) => height(self.parts, &at(end), normal) >= kept * gap,
            // Without a certificate the pair may only stay as it is.
            None => at(end) == at(start),
        }
    }

    /// Moves the free vertices of a pair along its normal until its parts are in order again. The
    /// parts share the way; one that cannot move leaves it to the other. Returns false if no vertex
    /// moved.
    fn part(&self, (normal, planned): (Vector3<f64>, f64), of: &mut Meeting) -> bool {
        let split = self.parts.first();
        let origin = of.start[self.corners[0] as usize];
        let heights = self
            .corners
            .map(|v| (of.end[v as usize] - origin).dot(&normal));
        let is_free = self.corners.map(|v| of.mass[v as usize] > 0.0);
        // Least height of the first part and greatest of the second one: of all corners and of
        // fixed ones.
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
        let gap = 2.0 * of.kept * planned;
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
        for (k, &v) in self.corners.iter().enumerate().filter(|(k, _)| is_free[*k]) {
            let to = if k < split {
                heights[k].max(floor)
            } else {
                heights[k].min(ceiling)
            };
            let (at, by) = (&mut of.end[v as usize], to - heights[k]);
            if by != 0.0 {
                *at += normal * by;
                is_moved |= by.abs() > ROUNDING * at.coords.amax();
            }
        }
        is_moved
    }
}
