//! Removal of overlap between several muscles, and between muscles and bones, before the motion
//! begins.

mod crossing;
mod even;
mod overlap;
mod push;
mod settle;
mod shrink;
mod sides;
mod solid;
#[cfg(test)]
mod tests;

use std::cell::OnceCell;

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use crossing::{Candidates, Faced, Piercing, piercings};
use overlap::Overlap;
use push::{Pair, Push, Watch, apply};
use shrink::Stall;
use sides::Sides;
use solid::Solid;

use crate::contact::surface::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;

/// The attempts: few rounds are enough for most muscles.
const ATTEMPTS: [Attempt; 3] = [
    Attempt {
        rounds: 24,
        widened: 0.1,
        shrinks: 0,
    },
    Attempt {
        rounds: 80,
        widened: 0.3,
        shrinks: 0,
    },
    Attempt {
        rounds: 80,
        widened: 0.1,
        shrinks: 4,
    },
];
/// Rounds between two searches for vertices on a wrong side.
const LOOK: usize = 8;
/// Among these rounds, those between two searches for folds.
const UNFOLD: usize = 4;
/// Greatest number of rounds in which only pushes and volumes act.
const LAST: usize = 200;
/// Sweeps that smooth displacements, in the first to the last quarter of the rounds: a smooth
/// displacement neither folds a surface nor tears its walls apart.
const SMOOTHING: [usize; 4] = [5, 5, 5, 2];
/// Number of sweeps over the pushes of one round.
const SWEEPS: usize = 4;
/// Greatest motion by the pushes of one round, relative to the median edge.
const STRIDE: f64 = 0.15;
/// Inverse mass of a held vertex, relative to a free one.
const HELD: f64 = 0.25;
/// Motion for which the triangles that may cross are found at once, relative to the median edge.
const LASTING: f64 = 0.2;

/// A muscle to be parted from its neighbours.
pub struct SoftBody<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its surface as read, whose edges, angles and volume are kept as far as possible.
    pub mesh: &'a TriangleMesh,
    /// The same surface at its positions now.
    pub surface: &'a Surface,
    /// Vertices held by bones, which yield less than free ones.
    pub held: Vec<u32>,
    /// True if it may not move at all.
    pub fixed: bool,
}

/// A bone from which muscles are parted.
pub struct RigidBody<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its surface in its own frame.
    pub surface: &'a Surface,
    /// Its pose.
    pub pose: Isometry3<f64>,
}

/// Distances to keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaps {
    /// Between a muscle and a bone [m].
    pub to_bones: f64,
    /// Between two muscles [m].
    pub between: f64,
}

/// Motion of a muscle from its positions as read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moved {
    /// Root mean square over the vertices [m].
    pub rms: f64,
    /// Greatest of a vertex [m].
    pub max: f64,
    /// Relative change of the enclosed volume.
    pub volume_change: f64,
}

/// What the parting of two surfaces found and did.
#[derive(Clone, Debug, PartialEq)]
pub struct PartedPair {
    /// Names of the two surfaces; the first is a muscle.
    pub pair: [String; 2],
    /// Greatest depth of a vertex of one in the other before [m].
    pub depth: f64,
    /// Number of pairs of triangles that crossed before.
    pub crossings: usize,
    /// Number of vertices of the first in the second before, and of the second in the first.
    pub inside: [usize; 2],
    /// A place of the overlap [m].
    pub place: Point3<f64>,
    /// Motion of the muscle of the pair that moved more, over all its vertices.
    pub moved: Moved,
}

/// Muscles without overlap.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parted {
    /// New positions of each muscle [m]; `None` for a muscle that did not move.
    pub positions: Vec<Option<Vec<Point3<f64>>>>,
    /// Motion of each muscle.
    pub moved: Vec<Moved>,
    /// The pairs that overlapped.
    pub pairs: Vec<PartedPair>,
    /// Those that still cross; without one, no two surfaces do.
    pub left: Vec<Inseparable>,
}

/// Two surfaces that cannot be parted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{} and {} cannot be parted: {crossings} pairs of triangles cross, the first near ({:.4}, {:.4}, {:.4}) m",
    .pair[0], .pair[1], .place[0], .place[1], .place[2])]
pub struct Inseparable {
    /// Their names.
    pub pair: [String; 2],
    /// A place where they cross [m].
    pub place: [f64; 3],
    /// Number of pairs of triangles that still cross.
    pub crossings: usize,
}

/// The pairs that overlap, without a motion.
pub fn overlaps(soft: &[SoftBody<'_>], rigid: &[RigidBody<'_>]) -> Vec<PartedPair> {
    let name = |s: usize| match s.checked_sub(soft.len()) {
        None => soft[s].name,
        Some(bone) => rigid[bone].name,
    };
    let all = overlap::find(soft, rigid).into_iter();
    all.map(|overlap| overlap.pair(overlap.of.map(name), Moved::default()))
        .collect()
}

/// Moves muscles apart from each other and out of bones until no two triangles cross, with their
/// volumes kept. Muscles without overlap are unchanged. Pairs that still cross at the end are
/// [`Parted::left`].
pub fn part(soft: &[SoftBody<'_>], rigid: &[RigidBody<'_>], gaps: Gaps) -> Parted {
    let overlaps = overlap::find(soft, rigid);
    if overlaps.is_empty() {
        return Parted {
            positions: vec![None; soft.len()],
            moved: vec![Moved::default(); soft.len()],
            ..Parted::default()
        };
    }
    // What crosses itself as read is not parted from itself.
    let folded = OnceCell::new();
    let folded_as_read = || *folded.get_or_init(|| Scene::new(soft, rigid, gaps).folded());
    let mut best: Option<((usize, usize), Parted)> = None;
    for attempt in &ATTEMPTS {
        let mut scene = Scene::new(soft, rigid, gaps);
        let left = scene.part(attempt);
        // Pairs that cross, then muscles that cross themselves.
        let faults = match scene.unsound() {
            0 => (left.len(), 0),
            unsound => (left.len(), unsound.saturating_sub(folded_as_read())),
        };
        if best.as_ref().is_none_or(|(least, _)| faults < *least) {
            best = Some((faults, scene.result(&overlaps, left)));
        }
        if faults == (0, 0) {
            break;
        }
    }
    best.map_or_else(Parted::default, |(_, parted)| parted)
}

/// How an attempt parts.
struct Attempt {
    /// Rounds in which displacements are smoothed.
    rounds: usize,
    /// Least gap in these rounds, relative to the median edge. Neighbours that do not overlap yet
    /// follow those that do, so that a bone comes out of a thin end instead of a fold around it.
    widened: f64,
    /// Greatest number of times that surfaces draw back where nothing else parts them.
    shrinks: usize,
}

/// All surfaces, muscles first.
struct Scene {
    all: Vec<Solid>,
    soft: usize,
    gaps: Gaps,
    /// Least gap now, relative to the median edge.
    widened: f64,
    /// Of each pair: the triangles that may cross.
    candidates: Vec<Candidates>,
    /// Of each ordered pair: what is known of distances, and vertices with a side.
    watches: Vec<Watch>,
    sides: Vec<Sides>,
    /// True for muscles that may move.
    active: Vec<bool>,
    inverse_mass: Vec<Vec<f64>>,
}

/// What one look at all pairs finds.
#[derive(Default)]
struct Seen {
    pushes: Vec<Push>,
    /// Crossing triangles of each pair.
    crossing: Vec<([usize; 2], Vec<[u32; 2]>)>,
    /// Greatest depth of each pair [m].
    depth: Vec<f64>,
}

impl Seen {
    fn count(&self) -> usize {
        self.crossing.iter().map(|(_, c)| c.len()).sum()
    }

    fn is_clear(&self) -> bool {
        self.count() == 0 && self.depth.iter().all(|d| *d <= 0.0)
    }
}

impl Scene {
    fn new(soft: &[SoftBody<'_>], rigid: &[RigidBody<'_>], gaps: Gaps) -> Self {
        let muscles = soft.par_iter().map(|body| {
            let mut solid = Solid::soft(body.name, body.mesh);
            solid
                .particles
                .position
                .copy_from_slice(body.surface.positions());
            solid.refit();
            solid
        });
        let mut all: Vec<Solid> = muscles.collect();
        let bones = rigid.par_iter();
        all.par_extend(bones.map(|body| Solid::rigid(body.name, body.surface, &body.pose)));
        let count = all.len();
        Self {
            soft: soft.len(),
            gaps,
            widened: 0.0,
            candidates: (0..count * count).map(|_| Candidates::default()).collect(),
            watches: (0..count * count).map(|_| Watch::default()).collect(),
            sides: vec![Sides::new(); count * count],
            active: vec![false; count],
            inverse_mass: soft.iter().map(inverse_mass).collect(),
            all,
        }
    }

    /// Parts all pairs. Returns those that still cross.
    fn part(&mut self, attempt: &Attempt) -> Vec<Inseparable> {
        let left = self.push_apart(attempt);
        if left.is_empty() {
            self.settle_back();
            self.even_out();
        }
        left
    }

    /// Pushes all pairs apart. Returns those that still cross.
    fn push_apart(&mut self, attempt: &Attempt) -> Vec<Inseparable> {
        self.widened = attempt.widened;
        let mut seen = self.look(true);
        for round in 0..attempt.rounds {
            self.activate(&seen);
            apply(&mut self.all, &seen.pushes, SWEEPS);
            if round % UNFOLD == 0 {
                self.unfold();
            }
            let smoothing = SMOOTHING[SMOOTHING.len() * round / attempt.rounds];
            self.relax(&seen.pushes, smoothing);
            seen = self.look(round % LOOK == LOOK - 1);
        }
        self.widened = 0.0;
        seen = self.push_out(attempt.shrinks);
        self.left(&seen)
    }

    /// Rounds in which only pushes and volumes act, until nothing overlaps or nothing helps.
    fn push_out(&mut self, mut shrinks: usize) -> Seen {
        let mut stall = Stall::default();
        let mut seen = self.look(false);
        for round in 0..LAST {
            if seen.is_clear() && self.is_sound() {
                break;
            }
            if stall.is_long(&seen) {
                if shrinks == 0 {
                    break;
                }
                shrinks -= 1;
                stall = Stall::default();
                seen = self.shrink(seen);
            }
            self.activate(&seen);
            self.push(&seen, round);
            seen = self.look(round % LOOK == LOOK - 1);
        }
        seen
    }

    /// The pairs that may touch, a muscle first.
    fn near(&self) -> Vec<[usize; 2]> {
        (0..self.soft)
            .flat_map(|i| (i + 1..self.all.len()).map(move |j| [i, j]))
            .filter(|&[i, j]| {
                self.all[i]
                    .bounds
                    .inflate(self.gap([i, j]))
                    .intersects(&self.all[j].bounds)
            })
            .collect()
    }

    /// Finds crossings and pushes; with `sides` also vertices on wrong sides.
    fn look(&mut self, sides: bool) -> Seen {
        let mut seen = Seen::default();
        for [i, j] in self.near() {
            let crossing = self.crossings([i, j]);
            let mut depth = 0.0;
            for (of, from) in [([i, j], 0), ([j, i], 1)] {
                let pierced = {
                    let pairs = crossing.iter().map(|c| (c[from], c[1 - from]));
                    piercings(&self.all[of[0]], &self.all[of[1]], pairs)
                };
                if sides && !crossing.is_empty() && of[0] < self.soft {
                    self.find_sides(of, &pierced);
                }
                let at = of[0] * self.all.len() + of[1];
                let mut watch = std::mem::take(&mut self.watches[at]);
                let mut pair = self.pair(of);
                // Two surfaces that do not cross are on the right sides of each other. A vertex
                // that has gone around an edge would still be sent to the side that it was given.
                let is_apart = crossing.is_empty() && !pair.sides.is_empty();
                if is_apart {
                    pair.sides = &[];
                    watch = Watch::default();
                }
                let (pushes, deepest) = pair.of_vertices(&mut watch);
                depth = max_or_nan([depth, deepest]);
                seen.pushes.extend(pushes);
                seen.pushes.extend(pair.of_edges(&pierced));
                self.watches[at] = if is_apart { Watch::default() } else { watch };
            }
            seen.crossing.push(([i, j], crossing));
            seen.depth.push(depth);
        }
        seen
    }

    /// The pairs of triangles of two surfaces that share a point.
    fn crossings(&mut self, of: [usize; 2]) -> Vec<[u32; 2]> {
        let [a, b] = of.map(|s| &self.all[s]);
        let [one, other] = [a, b].map(|s| Faced::new(s.x(), &s.surface));
        let lasting = LASTING * self.edge(of);
        let candidates = &mut self.candidates[of[0] * self.all.len() + of[1]];
        candidates.renew(&one, &other, a.travelled + b.travelled, lasting);
        candidates.crossings(&one, &other)
    }

    fn pair(&self, of: [usize; 2]) -> Pair<'_> {
        Pair {
            of,
            a: &self.all[of[0]],
            b: &self.all[of[1]],
            gap: self.gap(of),
            most: self.stride(of),
            sides: &self.sides[of[0] * self.all.len() + of[1]],
        }
    }

    /// Gap to keep between two surfaces [m].
    fn gap(&self, of: [usize; 2]) -> f64 {
        let gap = match of[0].max(of[1]) < self.soft {
            true => self.gaps.between,
            false => self.gaps.to_bones,
        };
        gap.max(self.widened * self.edge(of))
    }

    /// Median edge of the finer muscle of a pair [m].
    fn edge(&self, of: [usize; 2]) -> f64 {
        let soft = of.iter().filter(|&&s| s < self.soft);
        soft.map(|&s| self.all[s].edge)
            .fold(f64::INFINITY, f64::min)
    }

    /// Greatest motion by the pushes of one round [m].
    fn stride(&self, of: [usize; 2]) -> f64 {
        STRIDE * self.edge(of)
    }

    /// Finds the vertices of a muscle that must leave another surface on a given side.
    fn find_sides(&mut self, of: [usize; 2], pierced: &[Piercing]) {
        let pair = self.pair(of);
        let exits = pair.exits();
        let inside: Vec<bool> = exits.iter().map(Option::is_some).collect();
        let lost = sides::lost(pair.a, &inside, pierced);
        let at = of[0] * self.all.len() + of[1];
        let mut sides = std::mem::take(&mut self.sides[at]);
        sides.resize(lost.len(), None);
        let [a, b] = of.map(|s| &self.all[s]);
        sides::directions(a, b, &lost, pierced, &mut sides);
        sides::common(a, &exits, &mut sides);
        self.watches[at] = Watch::default();
        self.sides[at] = sides;
    }

    /// Applies the pushes of one look, and restores volumes. Folds are searched for only in some
    /// rounds, and where nothing else is left.
    fn push(&mut self, seen: &Seen, round: usize) {
        apply(&mut self.all, &seen.pushes, SWEEPS);
        if round.is_multiple_of(UNFOLD) || seen.is_clear() {
            self.unfold();
        }
        self.keep_volumes(&seen.pushes);
    }

    /// Lets the muscles of overlapping pairs move.
    fn activate(&mut self, seen: &Seen) {
        for ((of, crossing), depth) in seen.crossing.iter().zip(&seen.depth) {
            if crossing.is_empty() && *depth <= 0.0 {
                continue;
            }
            for &s in of.iter().filter(|&&s| s < self.soft) {
                if !self.active[s] {
                    self.active[s] = true;
                    self.all[s]
                        .particles
                        .inverse_mass
                        .clone_from(&self.inverse_mass[s]);
                }
            }
        }
    }

    /// Smooths the displacements of all muscles that move.
    fn relax(&mut self, pushes: &[Push], smoothing: usize) {
        let held = self.held(pushes);
        self.moving().zip(&held).for_each(|(solid, held)| {
            if let Some(solid) = solid {
                solid.relax(held, smoothing);
                solid.refit();
            }
        });
    }

    /// Each surface, `None` if it does not move.
    fn moving(&mut self) -> impl IndexedParallelIterator<Item = Option<&mut Solid>> {
        self.all
            .par_iter_mut()
            .zip(&self.active)
            .map(|(solid, active)| active.then_some(solid))
    }

    /// Smooths muscles where they cross themselves.
    fn unfold(&mut self) {
        self.moving().flatten().for_each(|solid| {
            if let Some(folded) = solid.folded() {
                solid.smooth(&folded);
                solid.refit();
            }
        });
    }

    /// For each surface the vertices that pushes hold.
    fn held(&self, pushes: &[Push]) -> Vec<Vec<bool>> {
        let mut held: Vec<Vec<bool>> = self.all.iter().map(|s| vec![false; s.x().len()]).collect();
        for push in pushes {
            push.vertices()
                .for_each(|(s, v)| held[s][v as usize] = true);
        }
        held
    }

    /// Brings the volumes to those at the start, by motion of vertices that nothing pushes.
    fn keep_volumes(&mut self, pushes: &[Push]) {
        let held = self.held(pushes);
        self.moving().zip(&held).for_each(|(solid, held)| {
            if let Some(solid) = solid {
                solid.keep_volume(held);
                solid.refit();
            }
        });
    }

    /// True if all muscles have their volumes, and none crosses itself.
    fn is_sound(&mut self) -> bool {
        self.moving().flatten().all(Solid::is_sound)
    }

    /// Number of muscles that cross themselves.
    fn folded(&mut self) -> usize {
        let soft = self.all[..self.soft].par_iter_mut();
        soft.filter_map(Solid::folded).count()
    }

    /// Number of muscles that lost their volume or cross themselves.
    fn unsound(&mut self) -> usize {
        let sound = self.moving().map(|solid| solid.is_none_or(Solid::is_sound));
        sound.filter(|sound| !sound).count()
    }

    /// The pairs that cross, or of which one is in the other; most crossings first.
    fn left(&self, seen: &Seen) -> Vec<Inseparable> {
        let pairs = seen.crossing.iter().zip(&seen.depth);
        let left = pairs.filter(|((_, crossing), depth)| !crossing.is_empty() || **depth > 0.0);
        let mut left: Vec<Inseparable> = left
            .map(|((of, crossing), _)| {
                let first = &self.all[of[0]];
                let place = crossing
                    .first()
                    .map_or(first.x()[0], |[s, _]| first.corners(*s)[0]);
                Inseparable {
                    pair: of.map(|s| self.all[s].name.clone()),
                    place: place.into(),
                    crossings: crossing.len(),
                }
            })
            .collect();
        left.sort_by_key(|pair| std::cmp::Reverse(pair.crossings));
        left
    }

    fn result(self, overlaps: &[Overlap], left: Vec<Inseparable>) -> Parted {
        let mut parted = Parted {
            left,
            ..Parted::default()
        };
        for (solid, active) in self.all.iter().zip(&self.active).take(self.soft) {
            parted.moved.push(solid.moved());
            parted.positions.push(active.then(|| solid.x().to_vec()));
        }
        for overlap in overlaps {
            let muscles = overlap.of.iter().filter(|&&s| s < self.soft);
            let moved = muscles.map(|&s| parted.moved[s]);
            let most = moved.max_by(|a, b| a.rms.total_cmp(&b.rms));
            let names = overlap.of.map(|s| self.all[s].name.as_str());
            parted
                .pairs
                .push(overlap.pair(names, most.unwrap_or_default()));
        }
        parted
    }
}

/// Inverse mass of each vertex of a muscle, without unit.
fn inverse_mass(body: &SoftBody<'_>) -> Vec<f64> {
    let free = if body.fixed { 0.0 } else { 1.0 };
    let mut all = vec![free; body.mesh.vertices.len()];
    for &v in &body.held {
        all[v as usize] = HELD * free;
    }
    all
}
