//! Lists of near pairs that last: each pair of near patches keeps its own.
//!
//! What moves with its surroundings stays in its lists: a list holds for a motion of two patches
//! relative to each other. Relative motion is the difference of the mean motions and of what each
//! patch departs from its own. It is measured from positions of reference, and summed when they change.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::super::gap::{Gap, Parts, gap, height, max2};
use super::super::near_pairs::{Facet, near_pairs};
use super::super::patches::{Motion, Turn};
use super::super::plane::ContactPlane;
use super::super::surface::box_pairs;
use super::{Against, FAR, Meeting, Member, OF_A_GAP, OF_A_LISTED, Patch, SUMMED};
use crate::mesh::measures::Aabb;

/// The share by which a step may come nearer than its motion tells: a gap is at least the height of
/// one that is known, but for a thousandth, and a step keeps a share of it.
pub(super) const AHEAD: f64 = 1.2;

/// The distance to be kept, for decisions about a gap that is known but for a thousandth.
pub(super) const WIDE: f64 = 1.01;

/// Number of buckets that a thread looks at together.
pub(super) const CHUNK: usize = 32;

/// Number of buckets at which one thread looks alone.
const FEW: usize = 2048;

/// The motion of the patches of a soft surface in a step.
#[derive(Debug)]
pub struct StepMotions(Vec<Motion>);

/// A listed pair.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    /// Numbers of its corners.
    pub corners: [u32; 4],
    pub parts: Parts,
    /// A normal that separated the parts when it was last looked for; zero if none did.
    pub normal: Vector3<f64>,
    /// Gap when the list was made, or what is known of it since [m]: the gap is at least this less the
    /// relative motion from the list.
    pub listed: f64,
    /// Distance to be kept [m]; 0 for a pair that is certified and not pushed.
    pub distance: f64,
}

impl Pair {
    /// A height that [`gap`] gives at least, at given positions [m].
    pub fn at_least(&self, x: &[Point3<f64>]) -> f64 {
        0.999 * height(self.parts, &self.of(x), &self.normal)
    }

    /// What is known of the gap [m], as it is and beyond the distance to be kept.
    fn known(&self) -> [f64; 2] {
        let beyond = match self.distance > 0.0 {
            true => self.listed - WIDE * self.distance,
            false => f64::INFINITY,
        };
        [self.listed, beyond]
    }

    pub fn of(&self, x: &[Point3<f64>]) -> [Point3<f64>; 4] {
        self.corners.map(|v| x[v as usize])
    }
}

/// Two near patches, with their near pairs.
pub(super) struct Bucket {
    patches: [u32; 2],
    against: Against,
    pub pairs: Vec<Pair>,
    /// The least of what is known of their gaps [m], as they are and beyond the distances to be kept.
    nearest: [f64; 2],
    /// Pairs that are not listed were at least this far apart [m].
    pub reach: f64,
    /// Bound on the relative motion from the list to the reference [m].
    used: f64,
    /// True if the list was made just now.
    is_new: bool,
    /// Pairs that were read in the present look; a gap counts as several.
    read: usize,
}

/// Relative motion of two patches since the list was made, to the start of the step, and in the
/// step [m].
#[derive(Clone, Copy)]
pub(super) struct Moved {
    pub before: f64,
    pub step: f64,
}

impl Bucket {
    pub fn moved(&self, patches: &[Patch]) -> Moved {
        let [one, other] = self.patches.map(|p| &patches[p as usize]);
        Moved {
            before: self.used + one.start.relative(&other.start),
            step: one.step.relative(&other.step),
        }
    }

    /// Looks at the pairs that can be nearer than `distance` [m], `beyond` the distance that they keep
    /// or not, at the start of the step, after the motion `moved`. `look` gets a pair and a gap that it
    /// has at least there, and returns its gap or what is known of it [m].
    pub fn nearer(
        &mut self,
        (distance, beyond): (f64, bool),
        moved: Moved,
        start: &[Point3<f64>],
        mut look: impl FnMut(&mut Pair, f64) -> f64,
    ) {
        let most = distance + moved.before;
        if self.nearest[usize::from(beyond)] > most {
            return;
        }
        // What is known now holds for the motion from the reference on, forth and back.
        let known = self.used - (moved.before - self.used);
        self.nearest = [f64::INFINITY; 2];
        self.read += self.pairs.len();
        for pair in &mut self.pairs {
            // Not `<=`: a motion that is not a number looks at all pairs.
            if !(pair.known()[usize::from(beyond)] > most) {
                self.read += OF_A_GAP;
                let least = pair.at_least(start);
                pair.listed = pair.listed.max(look(pair, least) + known);
            }
            self.nearest = least_of(self.nearest, pair.known());
        }
    }
}

fn least_of(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].min(b[1])]
}

impl Meeting {
    /// Notes the motion of all patches to the start of the step, and that of bones in the step. If
    /// the positions are those at the end of the last step, its motion is summed.
    pub(super) fn note_start(&mut self, goes_on: bool) {
        let turns: Vec<Option<[Turn; 2]>> = (self.members.iter())
            .map(|member| {
                let bone = member.bone.as_ref()?;
                let to_start = Turn::new(&bone.reference, &bone.before);
                Some([to_start, Turn::new(&bone.before, &bone.now)])
            })
            .collect();
        let is_summed = goes_on && self.summed < SUMMED;
        self.summed = if is_summed { self.summed + 1 } else { 0 };
        let (reference, start) = (&self.reference, &self.start);
        let note = |patch: &mut Patch| match &turns[patch.member] {
            None if is_summed => patch.start = patch.start.then(&patch.step),
            None => patch.start = Motion::of_vertices(&patch.vertices, reference, start),
            Some([to_start, step]) => {
                patch.start = Motion::of_box(&patch.bounds, to_start);
                patch.step = Motion::of_box(&patch.bounds, step);
            }
        };
        // Threads cost more than a sum.
        if is_summed {
            self.patches.iter_mut().for_each(note);
        } else {
            let patches = self.patches.par_iter_mut().with_min_len(CHUNK);
            patches.for_each(note);
        }
        let near = self.patches.iter().filter(|patch| patch.is_near);
        // A quarter each for both patches, the rest for the steps to come.
        if !(near.map(|p| p.start.size()).fold(0.0, max2) <= 0.25 * self.wake) {
            self.refer();
        }
    }

    /// Counts motion from the start of the present step on.
    pub(super) fn refer(&mut self) {
        for bucket in &mut self.buckets {
            bucket.used = bucket.moved(&self.patches).before;
        }
        for patch in &mut self.patches {
            patch.used += patch.start.size();
            patch.start = Motion::default();
        }
        for member in &mut self.members {
            if let Some(bone) = &mut member.bone {
                bone.reference = bone.before;
            }
        }
        self.reference
            .copy_from_slice(&self.start[..self.soft_count]);
        self.extend_lists();
        self.wake_up();
    }

    /// Brings the buckets to the front that little motion wakes up.
    fn wake_up(&mut self) {
        let mut awake = 0;
        for k in 0..self.buckets.len() {
            let bucket = &self.buckets[k];
            if self.is_near(bucket) || self.is_short(bucket) {
                self.buckets.swap(k, awake);
                awake += 1;
            }
        }
        self.awake = awake;
    }

    /// True if little motion can bring listed pairs near.
    fn is_near(&self, bucket: &Bucket) -> bool {
        !(bucket
            .nearest
            .iter()
            .all(|gap| gap - bucket.used > self.wake))
    }

    /// True if little motion can bring pairs near that are not listed.
    fn is_short(&self, bucket: &Bucket) -> bool {
        !(bucket.reach - bucket.used - WIDE * self.keeps(bucket.against) > self.wake)
    }

    /// Makes the lists anew of buckets that nothing but the end of their reach would wake up.
    fn extend_lists(&mut self) {
        let mut buckets = std::mem::take(&mut self.buckets);
        buckets.par_chunks_mut(CHUNK).for_each(|buckets| {
            for bucket in buckets {
                if self.is_short(bucket) && !self.is_near(bucket) {
                    let step = bucket.moved(&self.patches).step;
                    self.list(bucket, step);
                    bucket.is_new = true;
                }
            }
        });
        for bucket in &mut buckets {
            if std::mem::take(&mut bucket.is_new) {
                self.read += std::mem::take(&mut bucket.read);
                for pair in &bucket.pairs {
                    self.activate(&pair.corners);
                }
            }
        }
        self.buckets = buckets;
    }

    /// The distance that two surfaces keep [m].
    fn keeps(&self, against: Against) -> f64 {
        match against {
            Against::Itself => self.own_distance,
            _ => self.settings.thickness,
        }
    }

    /// The motion in the step of each patch of soft surface `member` to the positions `x` [m].
    pub fn motions(&self, member: usize, x: &[Point3<f64>]) -> StepMotions {
        let first = self.members[member].first;
        let of = self.patches.partition_point(|p| p.member < member);
        let end = self.patches.partition_point(|p| p.member <= member);
        let motion = |patch: &Patch| {
            let way = |&v: &u32| x[v as usize - first] - self.start[v as usize];
            Motion::of_ways(&patch.vertices, way)
        };
        StepMotions(self.patches[of..end].iter().map(motion).collect())
    }

    /// Notes the motion of soft patches in the step.
    pub(super) fn note_step(&mut self) {
        let count = self.soft().len();
        let end = |member: usize| {
            let Member { first, count, .. } = self.members[member];
            &self.end[first..first + count]
        };
        let all = (0..count).into_par_iter();
        let motions: Vec<StepMotions> = all.map(|k| self.motions(k, end(k))).collect();
        self.take_motions(motions);
    }

    /// Takes the motion of all soft patches in the step.
    pub(super) fn take_motions(&mut self, motions: Vec<StepMotions>) {
        let motions = motions.into_iter().flat_map(|motions| motions.0);
        for (patch, step) in self.patches.iter_mut().zip(motions) {
            patch.step = step;
        }
    }

    /// Looks at all buckets that motion can have woken up, with lists that hold for the step to the
    /// present end. `look` gets the buckets, their motion, and the start and the end of the step.
    pub(super) fn look<T: Send>(
        &mut self,
        look: impl Fn(&mut Bucket, Moved, [&[Point3<f64>]; 2], &mut Vec<T>) + Sync,
    ) -> Vec<T> {
        let is_near = |p: &Patch| p.used + p.start.size() + AHEAD * p.step.size() <= p.limit;
        let is_far = !self.patches.iter().all(is_near);
        if is_far {
            self.find_near_patches();
        }
        let near = self.patches.iter().filter(|patch| patch.is_near);
        let most = near
            .map(|p| p.start.size() + AHEAD * p.step.size())
            .fold(0.0, max2);
        let awake = if 2.0 * most <= self.wake && !is_far {
            self.awake
        } else {
            self.buckets.len()
        };
        let mut buckets = std::mem::take(&mut self.buckets);
        // Few buckets take less time than it takes to wake up threads.
        let chunk = if awake > FEW { CHUNK } else { FEW };
        let found: Vec<(Vec<T>, Vec<&mut Bucket>, usize)> = buckets[..awake]
            .par_chunks_mut(chunk)
            .map(|buckets| {
                let (mut found, mut outdated, mut read) = (Vec::new(), Vec::new(), 0);
                for bucket in buckets {
                    let moved = bucket.moved(&self.patches);
                    if is_far || !(self.needs(bucket, moved) <= bucket.reach) {
                        outdated.push(bucket);
                    } else {
                        look(bucket, moved, [&self.start, &self.end], &mut found);
                        read += std::mem::take(&mut bucket.read);
                    }
                }
                (found, outdated, read)
            })
            .collect();
        let (mut all, mut outdated) = (Vec::new(), Vec::new());
        for (found, late, read) in found {
            self.read += read;
            all.extend(found);
            outdated.extend(late);
        }
        if !outdated.is_empty() {
            outdated.par_iter_mut().for_each(|bucket| {
                let moved = bucket.moved(&self.patches);
                if !(self.needs(bucket, moved) <= bucket.reach) {
                    self.list(bucket, moved.step);
                }
            });
            for bucket in &outdated {
                for pair in &bucket.pairs {
                    self.activate(&pair.corners);
                }
            }
            for bucket in outdated {
                let moved = bucket.moved(&self.patches);
                look(bucket, moved, [&self.start, &self.end], &mut all);
                self.read += std::mem::take(&mut bucket.read);
            }
        }
        self.buckets = buckets;
        all
    }

    /// Lets the vertices of bones move among `corners`.
    fn activate(&mut self, corners: &[u32; 4]) {
        for &v in corners {
            let Some(bone) = (v as usize).checked_sub(self.soft_count) else {
                continue;
            };
            if !std::mem::replace(&mut self.is_active[bone], true) {
                self.active.push(v);
                self.place(v);
            }
        }
    }

    /// Searches for the pairs of patches that can meet before one of them has moved far.
    fn find_near_patches(&mut self) {
        let start = &self.start;
        let boxes: Vec<Aabb> = (self.patches.par_iter())
            .map(|patch| match &self.members[patch.member].bone {
                None => Aabb::of_points(patch.vertices.iter().map(|&v| &start[v as usize])),
                Some(bone) => patch.bounds.transformed(&bone.before),
            })
            .collect();
        let keep = self.settings.thickness;
        let far = FAR * self.edge + self.margin + keep;
        let room = |patch: &Patch| far + 2.0 * AHEAD * patch.step.size();
        let (mut soft, mut most) = (Aabb::EMPTY, 0.0_f64);
        let mut wide = Vec::new();
        for (patch, bounds) in self.patches.iter().zip(&boxes) {
            wide.push(bounds.inflate(room(patch)));
            if self.members[patch.member].bone.is_none() {
                soft = soft.union(bounds);
                most = max2(most, room(patch));
            }
        }
        for (patch, bounds) in self.patches.iter_mut().zip(&boxes) {
            patch.is_near = false;
            patch.used = patch.start.size();
            patch.limit = match self.members[patch.member].bone {
                None => room(patch) - keep,
                // A part of a bone that is far from all soft surfaces can move farther.
                Some(_) => room(patch).max(bounds.distance(&soft) - most),
            };
        }
        let mut near = box_pairs(&wide);
        if self.settings.itself {
            near.extend((0..self.patches.len() as u32).map(|p| [p, p]));
        }
        let mut known: std::collections::HashMap<[u32; 2], Bucket> =
            std::mem::take(&mut self.buckets)
                .into_iter()
                .map(|bucket| (bucket.patches, bucket))
                .collect();
        for [a, b] in near {
            let patches = [a.min(b), a.max(b)];
            let [one, other] = patches.map(|p| &self.patches[p as usize]);
            if !self.partners.contains(&[one.member, other.member]) {
                continue;
            }
            let bucket = known.remove(&patches).unwrap_or_else(|| Bucket {
                patches,
                against: match &self.members[other.member].bone {
                    Some(_) => Against::Bone,
                    None if one.member == other.member => Against::Itself,
                    None => Against::Other,
                },
                pairs: Vec::new(),
                reach: if a == b {
                    0.0
                } else {
                    boxes[a as usize].distance(&boxes[b as usize])
                },
                nearest: [f64::INFINITY; 2],
                used: one.start.relative(&other.start),
                is_new: false,
                read: 0,
            });
            self.buckets.push(bucket);
            for p in patches {
                self.patches[p as usize].is_near = true;
            }
        }
        self.active.clear();
        self.is_active.fill(false);
        self.wake_up();
    }

    /// The distance within which a list must have all pairs [m].
    fn needs(&self, bucket: &Bucket, moved: Moved) -> f64 {
        moved.before + AHEAD * moved.step + WIDE * self.keeps(bucket.against)
    }

    /// Makes the list of a bucket at the start of the step, for a relative motion `step` [m].
    fn list(&self, bucket: &mut Bucket, step: f64) {
        let [one, other] = bucket
            .patches
            .map(|p| self.facets(&self.patches[p as usize]));
        let [a, b] = bucket.patches.map(|p| &self.patches[p as usize]);
        bucket.used = a.start.relative(&b.start);
        let before = 2.0 * bucket.used;
        bucket.reach = self.needs(bucket, Moved { before, step }) + self.margin;
        let itself = bucket.patches[0] == bucket.patches[1];
        let found = near_pairs(&one, (!itself).then_some(&*other), bucket.reach);
        bucket.reach = found.reach;
        bucket.pairs.clear();
        bucket.read += one.len() + other.len() + OF_A_LISTED * found.pairs.len();
        for near in found.pairs {
            if near.corners.iter().any(|&v| self.mass[v as usize] > 0.0) {
                let (listed, normal) = near
                    .gap
                    .map_or((0.0, Vector3::zeros()), |gap| (gap.height, gap.normal));
                bucket.pairs.push(Pair {
                    corners: near.corners,
                    parts: near.parts,
                    normal,
                    listed,
                    distance: self.distance(bucket.against, near.parts, &near.corners),
                });
            }
        }
        let known = bucket.pairs.iter().map(Pair::known);
        bucket.nearest = known.fold([f64::INFINITY; 2], least_of);
    }

    /// The triangles of a patch at the start of the step.
    fn facets(&self, patch: &Patch) -> Vec<Facet> {
        let member = &self.members[patch.member];
        let at = |v: u32| match &member.bone {
            None => self.start[v as usize],
            Some(bone) => bone.before * bone.surface.positions()[v as usize - member.first],
        };
        let facet = |&t: &u32| {
            let corners = member.triangles[t as usize];
            Facet::new(corners, member.owned[t as usize], corners.map(at))
        };
        patch.triangles.iter().map(facet).collect()
    }

    /// The distance that a pair keeps [m].
    fn distance(&self, against: Against, parts: Parts, corners: &[u32; 4]) -> f64 {
        let is_soft = |v: &&u32| (**v as usize) < self.soft_count;
        // Vertices of a muscle near a bone have planes of their own.
        let [first, second] = [&corners[0], &corners[1]];
        if against == Against::Bone
            && parts == Parts::VertexTriangle
            && is_soft(&first)
            && !is_soft(&second)
        {
            return 0.0;
        }
        let at_rest = &self.at_rest[against as usize];
        let soft = corners.iter().filter(is_soft);
        soft.fold(f64::INFINITY, |least, &v| least.min(at_rest[v as usize]))
    }

    /// Parts that are nearer than the thickness at rest keep the distance that they have: layers that
    /// lie on each other are not pushed apart.
    pub(super) fn learn_rest(&mut self) {
        for bucket in &self.buckets {
            let at_rest = &mut self.at_rest[bucket.against as usize];
            for pair in &bucket.pairs {
                for &v in pair
                    .corners
                    .iter()
                    .filter(|&&v| (v as usize) < self.soft_count)
                {
                    let rest = &mut at_rest[v as usize];
                    *rest = rest.min(pair.listed);
                }
            }
        }
        for bucket in &mut self.buckets {
            // Lists of the rest have other distances.
            bucket.reach = f64::NEG_INFINITY;
        }
        self.wake_up();
    }

    /// The pairs of surfaces whose gap at the start of the step is at most `touching` [m] above
    /// the distance that they keep, as constraints on the numbers of soft vertices, in the order of
    /// their parts.
    pub fn planes(&mut self, touching: f64) -> Vec<ContactPlane> {
        self.end.copy_from_slice(&self.start);
        self.note_step();
        // Buckets that sleep can have such pairs.
        self.awake = self.buckets.len();
        let mut found = self.look(|bucket, moved, [start, _], found| {
            bucket.nearer((touching, true), moved, start, |pair, known| {
                let reach = pair.distance + touching;
                // Vertices of a muscle near a bone have planes of their own.
                if !(pair.distance > 0.0) || !(known <= reach) {
                    return known;
                }
                let gap = gap(pair.parts, &pair.of(start)).filter(|gap| gap.height <= reach);
                // A vertex at the end of an edge has a pair of its own.
                let is_own = |gap: &Gap| pair.parts.first() == 1 || gap.inner;
                if let Some(gap) = gap.filter(is_own) {
                    found.push(((pair.parts, pair.corners), gap, pair.distance));
                }
                known
            });
        });
        self.wake_up();
        found.sort_unstable_by_key(|(key, ..)| *key);
        let found = found.into_iter();
        found
            .map(|((_, corners), gap, distance)| self.plane(corners, &gap, distance))
            .collect()
    }

    /// The plane of a pair at the start of the step. Bones stand still: the place on one is its origin.
    fn plane(&self, corners: [u32; 4], gap: &Gap, distance: f64) -> ContactPlane {
        let is_soft = corners.map(|v| (v as usize) < self.soft_count);
        let (mut on_bone, mut share) = (Vector3::zeros(), 0.0);
        for k in (0..4).filter(|&k| !is_soft[k]) {
            on_bone += self.start[corners[k] as usize].coords * gap.weights[k];
            share += gap.weights[k];
        }
        let any = corners[is_soft.iter().position(|soft| *soft).unwrap_or(0)];
        let origin = match is_soft.contains(&false) {
            true => Point3::from(on_bone / share),
            false => self.start[any as usize],
        };
        let term = |k: usize| match is_soft[k] {
            true => (corners[k], gap.weights[k]),
            false => (any, 0.0),
        };
        ContactPlane {
            terms: std::array::from_fn(term),
            normal: gap.normal,
            origin,
            distance,
        }
    }

    /// Notes the least gap at the end of a frame.
    pub fn note_gaps(&mut self) {
        let most = self.settings.thickness;
        let found = self.look(|bucket, moved, [start, end], found| {
            let mut least = most;
            bucket.nearer((most + moved.step, false), moved, start, |pair, known| {
                if !(pair.at_least(end) >= least) {
                    let gap = gap(pair.parts, &pair.of(end));
                    least = least.min(gap.map_or(0.0, |gap| gap.height));
                }
                known
            });
            found.extend((least < most).then_some(least));
        });
        let least = &mut self.certificate.least_gap;
        *least = found.into_iter().fold(*least, f64::min);
    }
}
