//! The guarantee: motion is taken back until every pair is in order along its normal.

use std::cmp::Ordering;

use nalgebra::{Isometry3, Point3, Vector3};

use super::super::gap::{Parts, ROUNDING, gap, height, largest, max2};
use super::super::patches::{Motion, Turn};
use super::lists::AHEAD;
use super::{Key, Meeting, OF_A_GAP, StepMotions};
use crate::mesh::measures::Aabb;

/// Number of rounds in which both parts of a pair share the way along its normal.
const ROUNDS: usize = 24;

/// Number of rounds up to which a push then goes one way: what something fixed has moved moves others
/// and does not give way itself. Where both parts share the way, a push needs about as many rounds as
/// the square of the number of layers.
const PUSHED: usize = ROUNDS + 96;

/// Greatest number of all rounds: what moves back can be pushed again by vertices that bones hold.
const ALL_ROUNDS: usize = PUSHED + 176;

/// Number of times that the motion of a vertex is halved before it is held.
const HALVINGS: u8 = 5;

/// Share of the least gap that a step keeps: a rigid motion keeps all of it but for rounding.
const NEARLY_ALL: f64 = 1.0 - 1e-6;

/// Greatest distance of a held vertex from where the obstacle that carries it brings it, relative
/// to the median edge.
const CARRIED: f64 = 1e-6;

/// No carrier.
const NONE: u32 = u32::MAX;

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

/// What is known of vertices that go back.
#[derive(Default)]
struct Back {
    /// For each pair, when it was last in order; for each vertex, when it last moved. A pair none of
    /// whose corners moved since is still in order.
    in_order: Vec<u64>,
    moved: Vec<u64>,
    now: u64,
    /// Number of times that the motion of each soft vertex was halved.
    halvings: Vec<u8>,
    /// The obstacle that carries each soft vertex; [`NONE`] if it goes back to the start.
    carriers: Vec<u32>,
    /// Number of pushes from something fixed to each soft vertex; [`NONE`] if none has reached it.
    pushes: Vec<u32>,
}

/// What a round does with pairs that are not in order.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Round {
    /// Both parts move apart.
    Share,
    /// The part that a push reached first moves the other one.
    Push,
    /// Both move back towards the start.
    Back,
}

impl Round {
    fn of(round: usize) -> Self {
        if round < ROUNDS {
            Self::Share
        } else if round < PUSHED {
            Self::Push
        } else {
            Self::Back
        }
    }
}

impl Back {
    /// Begins with a list of pairs, of none of which anything is known.
    fn begin(&mut self, found: &[Crossing]) {
        self.now += 1;
        self.in_order.clear();
        self.in_order.resize(found.len(), 0);
        let corners = found.iter().flat_map(|crossing| crossing.corners);
        let count = corners.max().map_or(0, |v| v as usize + 1);
        self.moved.resize(count.max(self.moved.len()), 0);
    }

    /// Whether a pair was in order after the last motion of its corners.
    fn is_known(&self, pair: usize, corners: &[u32; 4]) -> bool {
        let since = self.in_order[pair];
        corners.iter().all(|&v| self.moved[v as usize] < since)
    }

    /// Notes that corners of a pair may move.
    fn move_corners(&mut self, corners: &[u32; 4]) {
        for &v in corners {
            self.moved[v as usize] = self.now;
        }
        self.now += 1;
    }
}

impl Meeting {
    /// Takes back motion of the given positions [m] of each soft surface until no pair crosses.
    /// Returns the numbers of changed vertices, ascending, for each surface. [`Self::motions`] of each
    /// surface need not be computed again.
    pub fn hold(
        &mut self,
        bodies: &mut [&mut [Point3<f64>]],
        motions: Option<Vec<StepMotions>>,
    ) -> Vec<Vec<u32>> {
        let mut is_moved = self.set_end(bodies, motions);
        let (mut found, mut back): (Vec<Crossing>, Back) = Default::default();
        let mut round = 0;
        let open = loop {
            let mut now = self.crossings();
            now.retain(|crossing| !crossing.is_in_order(self, &back));
            let (open, known) = (now.len(), found.len());
            found.extend(now);
            found.sort_unstable_by_key(Crossing::key);
            found.dedup_by_key(|crossing| crossing.key());
            back.begin(&found);
            if found.len() == known || round >= ALL_ROUNDS {
                break open;
            }
            while round < ALL_ROUNDS && self.put_back(&found, Round::of(round), &mut back) {
                (round, is_moved) = (round + 1, true);
            }
            self.note_step();
        };
        self.certificate.open += open as u64;
        self.certificate.held += back.halvings.iter().filter(|h| **h > HALVINGS).count() as u64;
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

    /// As [`Self::hold`], for a trial; `None` if more than `most` pairs cross, and then nothing moves.
    pub fn hold_few(
        &mut self,
        bodies: &mut [&mut [Point3<f64>]],
        most: usize,
    ) -> Option<Vec<Vec<u32>>> {
        self.set_end(bodies, None);
        (self.crossings().len() <= most).then(|| self.hold(bodies, None))
    }

    /// Puts the pairs that are not in order back into it, in turn: by motion along their normals, or
    /// back towards the start. Returns true if a vertex moved.
    fn put_back(&mut self, found: &[Crossing], round: Round, back: &mut Back) -> bool {
        let mut is_moved = false;
        for (k, crossing) in found.iter().enumerate() {
            if back.is_known(k, &crossing.corners) {
                continue;
            }
            self.read += OF_A_GAP;
            if crossing.is_in_order(self, back) {
                back.in_order[k] = back.now;
                continue;
            }
            // What it moves, others have to look at anew; so has it itself.
            back.move_corners(&crossing.corners);
            let goes_back = round == Round::Back || crossing.plane.is_none();
            let mut done = goes_back && self.go_back(&crossing.corners, back);
            // Going back does not help against vertices that bones move.
            if let Some(plane) = crossing.plane.filter(|_| !done) {
                let yields = match round {
                    Round::Push => crossing.pushed(self, back),
                    Round::Share | Round::Back => [true; 2],
                };
                done = crossing.part(plane, yields, self);
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

    /// The gap that a pair keeps at least that has `gap` at the start [m].
    fn least(&self, gap: f64) -> f64 {
        least(self.kept, self.floor, gap)
    }

    /// The pairs that are not in order at the end of the step, seen from the world.
    fn crossings(&mut self) -> Vec<Crossing> {
        let (kept, floor) = (self.kept, self.floor);
        self.look(|bucket, moved, [start, end], found| {
            // A pair with this gap stays in order, whatever its normal is.
            let safe = max2(moved.step / (0.999 - kept), floor / kept);
            bucket.nearer(
                (max2(AHEAD * moved.step, safe), false),
                moved,
                start,
                |pair, known| {
                    if known >= safe {
                        return known;
                    }
                    let gap = gap(pair.parts, &pair.of(start));
                    if let Some(gap) = gap {
                        pair.normal = gap.normal;
                        let end = height(pair.parts, &pair.of(end), &gap.normal);
                        if end >= least(kept, floor, gap.height) {
                            return 0.999 * gap.height;
                        }
                    }
                    found.push(Crossing {
                        parts: pair.parts,
                        corners: pair.corners,
                        plane: gap.map(|gap| (gap.normal, gap.height)),
                    });
                    known
                },
            );
        })
    }

    /// Moves the free vertices of a pair back: towards the start, or, near a bone that moves, towards
    /// where its motion carries them. Returns false if all are there.
    fn go_back(&mut self, corners: &[u32; 4], back: &mut Back) -> bool {
        back.halvings.resize(self.soft_count, 0);
        back.carriers.resize(self.soft_count, NONE);
        // The pair is carried as a whole.
        let carrier = corners.iter().map(|&v| self.carrier(v, back)).min();
        let carrier = carrier.filter(|c| *c != NONE);
        let mut is_moved = false;
        for v in corners.map(|v| v as usize) {
            if !(self.mass[v] > 0.0) {
                continue;
            }
            if let Some(carrier) = carrier.filter(|_| back.carriers[v] == NONE) {
                (back.carriers[v], back.halvings[v]) = (carrier, 0);
            }
            let home = match back.carriers[v] {
                NONE => self.start[v],
                carrier => self.moved[carrier as usize] * self.start[v],
            };
            if self.end[v] == home {
                continue;
            }
            back.halvings[v] = back.halvings[v].saturating_add(1);
            self.end[v] = if back.halvings[v] > HALVINGS {
                home
            } else {
                home + (self.end[v] - home) * 0.5
            };
            is_moved = true;
        }
        is_moved
    }

    /// The obstacle that carries a vertex: that of a bone, that which holds a fixed one, or that to
    /// which a free one goes back. [`NONE`] without one.
    fn carrier(&self, vertex: u32, back: &Back) -> u32 {
        let v = vertex as usize;
        if v >= self.soft_count {
            let member = self.members.partition_point(|m| m.first <= v) - 1;
            let bone = self.members[member].bone.as_ref();
            return bone.map_or(NONE, |bone| bone.obstacle as u32);
        }
        if self.mass[v] > 0.0 {
            return back.carriers.get(v).copied().unwrap_or(NONE);
        }
        let departs = |moved: &Isometry3<f64>| (moved * self.start[v] - self.end[v]).norm();
        let all = self.moved.iter().map(departs).enumerate();
        let nearest = all.min_by(|a, b| a.1.total_cmp(&b.1));
        nearest
            .filter(|(_, by)| *by <= CARRIED * self.edge)
            .map_or(NONE, |(obstacle, _)| obstacle as u32)
    }
}

/// The gap that a pair keeps at least that has `gap` at the start [m].
fn least(kept: f64, floor: f64, gap: f64) -> f64 {
    max2(kept * gap, NEARLY_ALL * gap.min(floor))
}

impl Crossing {
    fn key(&self) -> Key {
        (self.parts, self.corners)
    }

    /// True if the parts are in the order of the start at the end, seen from the world or from an
    /// obstacle that carries one of them: a motion of all does not change their order.
    fn is_in_order(&self, of: &Meeting, back: &Back) -> bool {
        let at = |x: &[Point3<f64>]| self.corners.map(|v| x[v as usize]);
        let [start, end] = [at(&of.start), at(&of.end)];
        if self.is_kept(&start, &end, of) {
            return true;
        }
        let mut seen = [NONE; 4];
        for (k, &v) in self.corners.iter().enumerate() {
            let carrier = of.carrier(v, back);
            if carrier != NONE && !seen.contains(&carrier) {
                let to_start = of.moved[carrier as usize].inverse();
                if self.is_kept(&start, &end.map(|x| to_start * x), of) {
                    return true;
                }
            }
            seen[k] = carrier;
        }
        false
    }

    /// True if the parts have a share of their gap at the end.
    fn is_kept(&self, start: &[Point3<f64>; 4], end: &[Point3<f64>; 4], of: &Meeting) -> bool {
        match &self.plane {
            Some((normal, gap)) => height(self.parts, end, normal) >= of.least(*gap),
            // Without a certificate the pair may only stay as it is.
            None => {
                let most = ROUNDING * largest(start);
                start.iter().zip(end).all(|(a, b)| (a - b).norm() <= most)
            }
        }
    }

    /// Which of both parts moves when a push goes one way: not the one that it reached first. Notes
    /// that the other one is reached.
    fn pushed(&self, of: &Meeting, back: &mut Back) -> [bool; 2] {
        back.pushes.resize(of.soft_count, NONE);
        let (first, second) = self.corners.split_at(self.parts.first());
        let reached = |part: &[u32]| {
            let pushes = part.iter().map(|&v| match of.mass[v as usize] > 0.0 {
                true => back.pushes[v as usize],
                false => 0,
            });
            pushes.min().unwrap_or(NONE)
        };
        let after = [reached(first), reached(second)];
        let (from, to) = match after[0].cmp(&after[1]) {
            Ordering::Less => (after[0], second),
            Ordering::Equal => return [true; 2],
            Ordering::Greater => (after[1], first),
        };
        for &v in to.iter().filter(|v| of.mass[**v as usize] > 0.0) {
            let pushes = &mut back.pushes[v as usize];
            *pushes = (*pushes).min(from + 1);
        }
        [after[0] > after[1], after[1] > after[0]]
    }

    /// Moves the free vertices of a pair along its normal until its parts are in order again. The
    /// parts that yield share the way; one that cannot move leaves it to the other. Returns false if
    /// no vertex moved.
    fn part(
        &self,
        (normal, planned): (Vector3<f64>, f64),
        yields: [bool; 2],
        of: &mut Meeting,
    ) -> bool {
        let split = self.parts.first();
        let origin = of.start[self.corners[0] as usize];
        let heights = self
            .corners
            .map(|v| (of.end[v as usize] - origin).dot(&normal));
        let is_free: [bool; 4] = std::array::from_fn(|k| {
            yields[usize::from(k >= split)] && of.mass[self.corners[k] as usize] > 0.0
        });
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
        let gap = (2.0 * of.kept * planned).max(planned.min(of.floor));
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
