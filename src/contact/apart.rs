//! Removal of overlap between several muscles, and between muscles and bones, before the motion
//! begins.

mod crossing;
mod push;
mod sides;
mod solid;

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use crossing::{Piercing, crossings, piercings};
use push::{Pair, Push, Watch, apply};
use sides::Sides;
use solid::Solid;

use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;
use crate::particles::Slot;

/// Greatest number of rounds in which shapes relax.
const ROUNDS: usize = 80;
/// Rounds between two searches for vertices on a wrong side.
const LOOK: usize = 10;
/// Greatest number of rounds in which only pushes and volumes act.
const LAST: usize = 200;
/// Number of sweeps over the pushes of one round.
const SWEEPS: usize = 4;
/// Greatest relative error of a volume.
const VOLUME: f64 = 1e-9;

/// A muscle to be parted from its neighbours.
pub struct SoftBody<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its surface as read, whose edges, angles and volume are kept as far as possible.
    pub mesh: &'a TriangleMesh,
    /// Its positions now [m].
    pub start: &'a [Point3<f64>],
    /// Inverse mass of each vertex, without unit: 1 for one that may move freely, less for one that
    /// others should yield to, 0 for one that is fixed.
    pub inverse_mass: Vec<f64>,
}

/// A bone from which muscles are parted.
pub struct RigidBody<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its surface in its own frame.
    pub mesh: &'a TriangleMesh,
    /// Its pose.
    pub pose: Isometry3<f64>,
}

/// Distances to keep.
#[derive(Clone, Copy, Debug)]
pub struct Gaps {
    /// Between a muscle and a bone [m].
    pub to_bones: f64,
    /// Between two muscles [m].
    pub between: f64,
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
}

/// Muscles without overlap.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parted {
    /// Positions of each muscle [m].
    pub positions: Vec<Vec<Point3<f64>>>,
    /// The pairs that overlapped.
    pub pairs: Vec<PartedPair>,
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

/// Moves muscles apart from each other and out of bones until no two triangles cross, with their
/// volumes kept. Muscles without overlap are unchanged.
///
/// # Errors
/// Two surfaces that still cross at the end.
pub fn part(
    soft: &[SoftBody<'_>],
    rigid: &[RigidBody<'_>],
    gaps: Gaps,
) -> Result<Parted, Inseparable> {
    let mut scene = Scene::new(soft, rigid, gaps);
    let mut seen = scene.look(true);
    if seen.is_clear() {
        return Ok(scene.result(soft.len()));
    }
    let verbose = std::env::var("APART").is_ok();
    for round in 0..ROUNDS + LAST {
        let last = round >= ROUNDS;
        if verbose && (round % 10 == 0 || round < 6) {
            eprintln!("round {round}: {} crossings {} pushes {:?}", seen.count(), seen.pushes.len(), seen.crossing.iter().filter(|c| !c.1.is_empty()).map(|c| (&scene.all[c.0[0]].name[..8], &scene.all[c.0[1]].name[..8], c.1.len())).collect::<Vec<_>>()); eprintln!("   volumes {:?} worst lack {:?}", scene.all.iter().filter(|s| !s.is_rigid()).map(|s| (1e4*(s.present_volume()/s.volume-1.0)).round()).collect::<Vec<_>>(), seen.depth.iter().map(|d| (d*1e5).round()/100.0).collect::<Vec<_>>());
        }
        if last && seen.is_clear() && scene.holds_volumes() && scene.all[..scene.soft].iter().all(|s| s.folded().is_none()) {
            break;
        }
        scene.activate(&seen);
        apply(&mut scene.all, &seen.pushes, SWEEPS);
        let folded = scene.unfold();
        if last {
            scene.keep_volumes(&seen.pushes);
        } else {
            scene.relax(&seen.pushes);
        }
        if verbose && folded > 0 && round % 10 == 9 { eprintln!("   folded {folded}"); }
        seen = scene.look(std::env::var("NOSIDES").is_err() && round % LOOK == LOOK - 1);
    }
    match seen.crossing.iter().find(|(_, crossing)| !crossing.is_empty()) {
        None => Ok(scene.result(soft.len())),
        Some((of, crossing)) => {
            let place = scene.all[of[0]].corners(crossing[0][0])[0];
            if verbose {
                eprintln!("left {}", seen.count());
                return Ok(scene.result(soft.len()));
            }
            Err(Inseparable {
                pair: of.map(|s| scene.all[s].name.clone()),
                place: place.into(),
                crossings: crossing.len(),
            })
        }
    }
}

/// All surfaces, muscles first.
struct Scene {
    all: Vec<Solid>,
    soft: usize,
    gaps: Gaps,
    /// Of each ordered pair: what is known of distances, and vertices with a side.
    watches: Vec<Watch>,
    sides: Vec<Sides>,
    /// True for muscles that may move.
    active: Vec<bool>,
    inverse_mass: Vec<Vec<f64>>,
    pairs: Vec<PartedPair>,
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
            let count = body.start.len();
            let mut solid = Solid::soft(body.name, body.mesh, vec![0.0; count]);
            solid.particles.position.copy_from_slice(body.start);
            solid.refit();
            solid
        });
        let mut all: Vec<Solid> = muscles.collect();
        all.par_extend(
            rigid
                .par_iter()
                .map(|body| Solid::rigid(body.name, body.mesh, &body.pose)),
        );
        let count = all.len();
        Self {
            soft: soft.len(),
            gaps,
            watches: (0..count * count).map(|_| Watch::default()).collect(),
            sides: vec![Sides::new(); count * count],
            active: vec![false; count],
            inverse_mass: soft.iter().map(|body| body.inverse_mass.clone()).collect(),
            pairs: Vec::new(),
            all,
        }
    }

    /// The pairs that may touch, a muscle first.
    fn near(&self) -> Vec<[usize; 2]> {
        let gap = |j: usize| if j < self.soft { self.gaps.between } else { self.gaps.to_bones };
        (0..self.soft)
            .flat_map(|i| (i + 1..self.all.len()).map(move |j| [i, j]))
            .filter(|&[i, j]| self.all[i].bounds.inflate(gap(j)).intersects(&self.all[j].bounds))
            .collect()
    }

    /// Finds crossings and pushes; with `sides` also vertices on wrong sides.
    fn look(&mut self, sides: bool) -> Seen {
        let mut seen = Seen::default();
        for [i, j] in self.near() {
            let crossing = crossings(&self.all[i], &self.all[j]);
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
                let pair = self.pair(of);
                let (pushes, deepest) = pair.of_vertices(&mut watch);
                depth = max_or_nan([depth, deepest]);
                seen.pushes.extend(pushes);
                seen.pushes.extend(pair.of_edges(&pierced));
                self.watches[at] = watch;
            }
            seen.crossing.push(([i, j], crossing));
            seen.depth.push(depth);
        }
        seen
    }

    fn pair(&self, of: [usize; 2]) -> Pair<'_> {
        let soft = of[0].max(of[1]) < self.soft;
        Pair {
            of,
            a: &self.all[of[0]],
            b: &self.all[of[1]],
            gap: if soft { self.gaps.between } else { self.gaps.to_bones },
            most: self.gaps.to_bones,
            sides: &self.sides[of[0] * self.all.len() + of[1]],
        }
    }

    fn find_sides(&mut self, of: [usize; 2], pierced: &[Piercing]) {
        let pair = self.pair(of);
        let lost = sides::lost(pair.a, &pair.inside(), pierced);
        if !lost.contains(&true) {
            return;
        }
        let at = of[0] * self.all.len() + of[1];
        let mut sides = std::mem::take(&mut self.sides[at]);
        sides.resize(lost.len(), None);
        sides::directions(&self.all[of[0]], &self.all[of[1]], &lost, pierced, &mut sides);
        self.watches[at] = Watch::default();
        if std::env::var("APART").is_ok() {
            if false { eprintln!("sides {} in {}: {} lost, {} known", self.all[of[0]].name, self.all[of[1]].name, lost.iter().filter(|l| **l).count(), sides.iter().flatten().count()); }
        }
        self.sides[at] = sides;
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
                    self.all[s].particles.inverse_mass.clone_from(&self.inverse_mass[s]);
                }
            }
        }
    }

    fn relax(&mut self, pushes: &[Push]) {
        let held = self.held(pushes);
        self.all
            .par_iter_mut()
            .zip(&self.active)
            .zip(&held)
            .filter(|((_, active), _)| **active)
            .for_each(|((solid, _), held)| {
                solid.relax(held);
                solid.refit();
            });
    }

    /// Smooths muscles where they cross themselves. Returns the number of such muscles.
    fn unfold(&mut self) -> usize {
        self.all
            .par_iter_mut()
            .zip(&self.active)
            .filter(|(_, active)| **active)
            .map(|(solid, _)| match solid.folded() {
                None => 0,
                Some(folded) => {
                    solid.smooth(&folded);
                    solid.refit();
                    1
                }
            })
            .sum()
    }

    /// For each surface the vertices that pushes hold.
    fn held(&self, pushes: &[Push]) -> Vec<Vec<bool>> {
        let mut held: Vec<Vec<bool>> = self.all.iter().map(|s| vec![false; s.x().len()]).collect();
        for push in pushes {
            let [point, triangle] = push.of;
            push.point
                .iter()
                .filter(|(_, weight)| *weight > 0.0)
                .for_each(|(v, _)| held[point][*v as usize] = true);
            push.triangle
                .iter()
                .for_each(|(v, _)| held[triangle][*v as usize] = true);
        }
        held
    }

    /// Brings the volumes to those at the start, by motion of vertices that nothing pushes.
    fn keep_volumes(&mut self, pushes: &[Push]) {
        let held = self.held(pushes);
        self.all
            .par_iter_mut()
            .zip(&self.active)
            .zip(&held)
            .filter(|((_, active), _)| **active)
            .for_each(|((solid, _), held)| {
                let Solid { shape, particles, .. } = solid;
                for shape in shape.iter_mut() {
                    let free = |field: &mut [Slot], _: f64| {
                        let held = field.iter_mut().zip(held).filter(|(_, held)| **held);
                        held.for_each(|(slot, _)| *slot = Slot::default());
                    };
                    let _ = shape.volume.project_along(particles, 1.0, free);
                }
                solid.refit();
            });
    }

    fn holds_volumes(&self) -> bool {
        let muscles = self.all.iter().zip(&self.active).filter(|(_, active)| **active);
        muscles.map(|(s, _)| s).all(|s| (s.present_volume() / s.volume - 1.0).abs() <= VOLUME)
    }

    fn result(self, soft: usize) -> Parted {
        let positions = self.all.into_iter().take(soft).map(|s| s.particles.position);
        Parted {
            positions: positions.collect(),
            pairs: self.pairs,
        }
    }
}
