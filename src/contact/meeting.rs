//! Contact of soft surfaces with each other, with themselves and with bones, edges included.
//!
//! Every near pair of a vertex and a triangle, or of two edges, has a **division plane**: a unit
//! normal along which one part is above the other one. A step moves all vertices along straight
//! lines. If the parts are in the same order along the normal at both ends of the step, they were
//! so at all times of it, because heights are linear in time. So no pair crosses, and with no
//! crossing at the start there is none afterwards. Pairs that are not listed are farther apart
//! than their vertices have moved since ([`lists`]).
//!
//! [`Meeting::respond`] pushes pairs apart to their distance. [`Meeting::hold`] is the guarantee: it
//! takes back motion until every pair is in order. Motion along a plane stays.
//!
//! A result depends on the start and the end of a step, and not on when a list was made: each
//! decision is taken with the gap at the start, and what is known from before only tells which
//! pairs are far from a decision.

mod bonds;
mod filter;
mod lists;
mod rows;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::PosedObstacle;
use super::gap::Parts;
use super::near_pairs::owned;
use super::patches::{Motion, split};
use super::rounded::mean_normals;
use super::surface::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::Aabb;
use crate::mesh::topology::Topology;
use crate::state::{DecodeError, Reader, State, Writer};
pub use bonds::BondSpec;
use bonds::Bonds;
use lists::Bucket;
pub use lists::StepMotions;
use rows::Row;

/// The lists of two patches hold for this relative motion beyond the present one, relative to the
/// median edge: shorter lists are made more often, longer ones take longer.
const MARGIN: f64 = 0.3;

/// Number of steps over which the motion of patches is summed before it is measured again.
const SUMMED: usize = 8;

/// Relative motion that wakes up two patches, relative to the median edge.
const WAKE: f64 = 0.1;

/// Two patches are looked at while each of them moves by this much, relative to the median edge.
const FAR: f64 = 1.5;

/// Greatest distance kept by a surface from itself, relative to the median edge: parts of
/// neighbouring triangles are not pushed apart.
const OWN: f64 = 0.25;

/// Share of the gap at the start that a step leaves at least.
const KEPT: f64 = 0.1;

/// Gap that does not shrink further, relative to the thickness: far above rounding, and far below
/// what can be seen.
const FLOOR: f64 = 1e-4;

/// Which surfaces meet, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeetingSettings {
    /// Distance kept between surfaces [m].
    pub thickness: f64,
    /// Distance kept between an edge or vertex of a bone and a muscle, relative to the thickness.
    pub over_bone: f64,
    /// Radius over which the direction away from a bone is a mean, relative to the median edge of the
    /// surface with the shortest ones; 0 for the direction from the nearest point.
    pub rounding: f64,
    /// Coefficient of Coulomb friction between soft surfaces.
    pub friction: f64,
    /// Soft surfaces meet each other.
    pub others: bool,
    /// Soft surfaces meet bones.
    pub bones: bool,
    /// Each surface meets itself.
    pub itself: bool,
}

/// Counts that certify that nothing crossed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certificate {
    /// Pairs that were nearer than the distance they keep, summed over steps.
    pub pairs: u64,
    /// Vertices whose motion was cut short, summed over steps.
    pub truncated: u64,
    /// Vertices that were held where they were, summed over steps.
    pub held: u64,
    /// Pairs that no motion of free vertices could keep in order: between bones that close, or at
    /// areas of attachment. They are not certified. A muscle that stops counts as one.
    pub open: u64,
    /// Least gap of a pair at the end of a frame [m]; infinite if none was below the thickness.
    pub least_gap: f64,
}

impl Default for Certificate {
    fn default() -> Self {
        Self {
            pairs: 0,
            truncated: 0,
            held: 0,
            open: 0,
            least_gap: f64::INFINITY,
        }
    }
}

/// A surface of a meeting.
struct Member {
    /// Number of the first of its vertices among those of the meeting.
    first: usize,
    /// Number of its vertices.
    count: usize,
    /// Its triangles, in numbers of the meeting, and what each owns.
    triangles: Vec<[u32; 3]>,
    owned: Vec<u8>,
    /// Its motion, if it is a bone.
    bone: Option<Bone>,
}

/// A bone of a meeting.
struct Bone {
    /// Index among the obstacles.
    obstacle: usize,
    surface: Arc<Surface>,
    /// The mean direction away from it at each of its vertices; none without rounding.
    normals: Vec<Vector3<f64>>,
    /// Poses at the reference, and at the start and the end of the step.
    reference: Isometry3<f64>,
    before: Isometry3<f64>,
    now: Isometry3<f64>,
}

/// A patch of a surface.
struct Patch {
    member: usize,
    triangles: Vec<u32>,
    /// Numbers of its vertices, if it is soft.
    vertices: Vec<u32>,
    /// Its box in the frame of its bone, if it is rigid.
    bounds: Aabb,
    /// Motion from the reference to the start of the step, and in the step.
    start: Motion,
    step: Motion,
    /// Bound on the motion from the last search for near patches to the reference, and the motion for
    /// which that search holds [m].
    used: f64,
    limit: f64,
    /// True if a bucket has it.
    is_near: bool,
}

/// Number of pairs that are read in about the time of a step of one vertex, and in that of a gap and of a
/// pair that is listed.
const OF_A_STEP: usize = 32;
const OF_A_GAP: usize = 16;
const OF_A_LISTED: usize = 64;

/// Surfaces that can meet, with the pairs that are near.
pub struct Meeting {
    settings: MeetingSettings,
    /// Soft surfaces, then bones.
    members: Vec<Member>,
    /// Pairs of members that can meet.
    partners: Vec<[usize; 2]>,
    patches: Vec<Patch>,
    /// Pairs of near patches; the first ones are awake, and the others are until patches have moved
    /// by `wake` [m].
    buckets: Vec<Bucket>,
    awake: usize,
    wake: f64,
    /// Number of steps since motion was measured.
    summed: usize,
    /// Number of soft vertices; those of bones follow.
    soft_count: usize,
    /// Vertices of bones that pairs name.
    active: Vec<u32>,
    is_active: Vec<bool>,
    /// Positions at the start and at the end of the step [m], and inverse masses. Of the vertices of
    /// bones only the active ones are placed.
    start: Vec<Point3<f64>>,
    end: Vec<Point3<f64>>,
    mass: Vec<f64>,
    /// Positions of soft vertices from which motion is measured [m].
    reference: Vec<Point3<f64>>,
    /// The motion of each obstacle in the step.
    moved: Vec<Isometry3<f64>>,
    rows: Vec<Row>,
    /// Distance to other soft surfaces, to bones and to itself that each soft vertex had at rest, at
    /// most the one to be kept [m].
    at_rest: [Vec<f64>; 3],
    /// Distance that a surface keeps from itself [m].
    own_distance: f64,
    /// Median edge of the surface with the shortest ones [m].
    edge: f64,
    /// Share of a gap that a step leaves at least.
    kept: f64,
    /// Gap that does not shrink further [m].
    floor: f64,
    /// Pairs that are nearer than their distance by at most this are not pushed [m].
    slack: f64,
    /// Relative motion for which lists hold beyond the present one [m].
    margin: f64,
    certificate: Certificate,
    /// Pairs that were read since the last [`Meeting::take_work`]; a gap counts as several.
    read: usize,
    /// What holds soft surfaces together.
    bonds: Option<Bonds>,
}

/// A soft surface that takes part in a meeting.
pub struct SoftMember<'a> {
    /// Triangles, and positions at rest [m].
    pub mesh: &'a TriangleMesh,
    /// Inverse masses [1/kg]; zero for vertices that bones hold.
    pub inverse_mass: &'a [f64],
    /// Indices of the obstacles that it can meet.
    pub obstacles: &'a [usize],
}

impl Meeting {
    /// A meeting of soft surfaces, of which `partners` can meet each other, with bones: `bones`
    /// gives the surface of an obstacle, and `None` for one without triangles. The positions at
    /// rest must be free of crossings.
    pub fn new(
        settings: MeetingSettings,
        soft: &[SoftMember<'_>],
        partners: &[[usize; 2]],
        placed: &[PosedObstacle],
        bones: impl Fn(usize) -> Option<Arc<Surface>>,
    ) -> Self {
        let (mut members, mut start, mut mass) = (Vec::new(), Vec::new(), Vec::new());
        let mut edge = f64::INFINITY;
        for SoftMember {
            mesh, inverse_mass, ..
        } in soft
        {
            members.push(Member::new(start.len(), mesh, None));
            start.extend_from_slice(&mesh.vertices);
            mass.extend_from_slice(inverse_mass);
            let median = mesh.median_edge_length(&Topology::new(mesh));
            edge = edge.min(median.unwrap_or(edge));
        }
        let edge = if edge.is_finite() {
            edge
        } else {
            settings.thickness
        };
        let soft_count = start.len();
        let mut pairs: Vec<[usize; 2]> = Vec::new();
        if settings.itself {
            pairs.extend((0..soft.len()).map(|a| [a, a]));
        }
        if settings.others {
            pairs.extend(partners.iter().map(|&[a, b]| [a.min(b), a.max(b)]));
        }
        for (a, member) in soft.iter().enumerate() {
            for &obstacle in member.obstacles.iter().filter(|_| settings.bones) {
                let Some(surface) = bones(obstacle) else {
                    continue;
                };
                let is = |m: &Member| m.bone.as_ref().is_some_and(|b| b.obstacle == obstacle);
                let known = members.iter().position(is).unwrap_or_else(|| {
                    let pose = placed[obstacle].now;
                    let mesh = TriangleMesh {
                        vertices: surface.positions().to_vec(),
                        triangles: surface.triangles().to_vec(),
                    };
                    let bone = Bone {
                        obstacle,
                        normals: mean_normals(&surface, settings.rounding * edge),
                        surface,
                        reference: pose,
                        before: pose,
                        now: pose,
                    };
                    members.push(Member::new(start.len(), &mesh, Some(bone)));
                    start.extend_from_slice(&mesh.vertices);
                    members.len() - 1
                });
                pairs.push([a, known]);
            }
        }
        let own_distance = settings.thickness.min(OWN * edge);
        mass.resize(start.len(), 0.0);
        let mut meeting = Self {
            settings,
            patches: patches(&members, &start),
            partners: pairs,
            buckets: Vec::new(),
            awake: 0,
            wake: WAKE * edge,
            summed: 0,
            soft_count,
            active: Vec::new(),
            is_active: vec![false; start.len() - soft_count],
            end: start.clone(),
            reference: start[..soft_count].to_vec(),
            mass,
            moved: Vec::new(),
            rows: Vec::new(),
            at_rest: [
                vec![settings.thickness; soft_count],
                vec![settings.over_bone * settings.thickness; soft_count],
                vec![own_distance; soft_count],
            ],
            own_distance,
            edge,
            kept: KEPT,
            floor: FLOOR * settings.thickness,
            slack: 0.0,
            margin: MARGIN * edge,
            certificate: Certificate::default(),
            read: 0,
            bonds: None,
            members,
            start,
        };
        meeting.note_step();
        meeting.look(|_, _, _, _: &mut Vec<()>| ());
        meeting.learn_rest();
        meeting
    }

    /// Corners of soft surface `member` that something fixed pushes, each with the direction in which
    /// it must not go back. What is not fixed moves instead: otherwise it would not feel the load.
    pub fn blocked(&self, member: usize) -> impl Iterator<Item = (u32, Vector3<f64>)> + '_ {
        let member = &self.members[member];
        let pushed = self.rows.iter().filter(|row| row.is_pushed());
        pushed
            .flat_map(|row| row.directions(&self.mass))
            .filter_map(|(v, away)| Some((member.local(v)?, away)))
    }

    /// Leaves pairs that have nearly their distance where they are, so that what is pushed apart is not
    /// pushed again: for the trials of a minimisation.
    pub fn push_once(&mut self) {
        self.slack = rows::NEARLY * self.settings.thickness;
    }

    /// Adds to the counts.
    pub fn count(&mut self, counts: &Certificate) {
        self.certificate.add(counts);
    }

    /// The counts since the last call.
    pub fn take_certificate(&mut self) -> Certificate {
        std::mem::take(&mut self.certificate)
    }

    /// The work since the last call, in steps of a vertex.
    pub fn take_work(&mut self) -> usize {
        let steps = self.read / OF_A_STEP;
        self.read %= OF_A_STEP;
        steps
    }

    /// Begins a frame at the positions of each soft surface [m].
    pub fn begin_frame(&mut self, bodies: &[&[Point3<f64>]], placed: &[PosedObstacle]) {
        self.summed = SUMMED;
        self.begin_step(bodies, placed);
        self.refer();
    }

    /// Begins a step at the positions of each soft surface [m].
    pub fn begin_step(&mut self, bodies: &[&[Point3<f64>]], placed: &[PosedObstacle]) {
        let mut goes_on = true;
        for (member, x) in self.members.iter().zip(bodies) {
            let all = member.first..member.first + member.count;
            goes_on &= self.end[all.clone()] == **x;
            self.start[all].copy_from_slice(x);
        }
        for bone in self.members.iter_mut().filter_map(|m| m.bone.as_mut()) {
            let PosedObstacle { before, now, .. } = &placed[bone.obstacle];
            goes_on &= bone.now == *before;
            (bone.before, bone.now) = (*before, *now);
        }
        self.moved.clear();
        let moved = placed.iter().map(|p| p.now * p.before.inverse());
        self.moved.extend(moved);
        for k in 0..self.active.len() {
            self.place(self.active[k]);
        }
        self.note_start(goes_on);
        self.rows.clear();
        if let Some(bonds) = &mut self.bonds {
            bonds.begin_step();
        }
    }

    /// Places a vertex of a bone at the start and at the end of the step.
    fn place(&mut self, vertex: u32) {
        let at = self.bone_of(vertex).map(|(bone, local)| {
            let x = bone.surface.positions()[local];
            (bone.before * x, bone.now * x)
        });
        if let Some(at) = at {
            (self.start[vertex as usize], self.end[vertex as usize]) = at;
        }
    }

    /// The bone of a vertex, and the number of the vertex among those of the bone.
    fn bone_of(&self, vertex: u32) -> Option<(&Bone, usize)> {
        let v = vertex as usize;
        let member = &self.members[self.members.partition_point(|m| m.first <= v) - 1];
        Some((member.bone.as_ref()?, v - member.first))
    }

    /// Sets the end of the step, to which the patches make `motions` if these are known, without motion by which a vertex leaves its surroundings. Returns
    /// true if there was such motion.
    fn set_end(
        &mut self,
        bodies: &[&mut [Point3<f64>]],
        motions: Option<Vec<StepMotions>>,
    ) -> bool {
        for (member, x) in self.members.iter().zip(bodies) {
            self.end[member.first..member.first + member.count].copy_from_slice(x);
        }
        match motions {
            Some(motions) => self.take_motions(motions),
            None => self.note_step(),
        }
        let is_cut = self.cap();
        if is_cut {
            self.note_step();
        }
        is_cut
    }

    /// The mean direction away from a bone at a vertex of it, and how the bone lies at the start of the step.
    fn mean_normal(&self, vertex: u32) -> Option<(&UnitQuaternion<f64>, &Vector3<f64>)> {
        let (bone, local) = self.bone_of(vertex)?;
        Some((&bone.before.rotation, bone.normals.get(local)?))
    }

    fn give_end(&self, bodies: &mut [&mut [Point3<f64>]]) {
        for (member, x) in self.members.iter().zip(bodies) {
            x.copy_from_slice(&self.end[member.first..member.first + member.count]);
        }
    }

    /// Soft surfaces.
    fn soft(&self) -> &[Member] {
        let count = self.members.partition_point(|m| m.first < self.soft_count);
        &self.members[..count]
    }
}

impl Member {
    fn new(first: usize, mesh: &TriangleMesh, bone: Option<Bone>) -> Self {
        let shift = |t: &[u32; 3]| t.map(|v| v + first as u32);
        Self {
            first,
            count: mesh.vertices.len(),
            owned: owned(&mesh.triangles),
            triangles: mesh.triangles.iter().map(shift).collect(),
            bone,
        }
    }

    /// The number of a vertex of the meeting among those of this surface.
    fn local(&self, v: u32) -> Option<u32> {
        let v = (v as usize).checked_sub(self.first)?;
        (v < self.count).then_some(v as u32)
    }
}

/// The patches of all members with the vertices `x` [m].
fn patches(members: &[Member], x: &[Point3<f64>]) -> Vec<Patch> {
    let mut all = Vec::new();
    for (index, member) in members.iter().enumerate() {
        for triangles in split(&member.triangles, x) {
            let corners = triangles.iter().flat_map(|&t| member.triangles[t as usize]);
            let mut vertices: Vec<u32> = corners.collect();
            vertices.sort_unstable();
            vertices.dedup();
            all.push(Patch {
                member: index,
                triangles,
                bounds: Aabb::of_points(vertices.iter().map(|&v| &x[v as usize])),
                vertices: if member.bone.is_none() {
                    vertices
                } else {
                    Vec::new()
                },
                start: Motion::default(),
                step: Motion::default(),
                used: 0.0,
                limit: f64::NEG_INFINITY,
                is_near: false,
            });
        }
    }
    all
}

/// What a pair keeps its distance from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Against {
    Other,
    Bone,
    Itself,
}

/// The parts and corners of a pair name it.
type Key = (Parts, [u32; 4]);

impl Certificate {
    /// Adds the counts of other steps.
    pub fn add(&mut self, other: &Self) {
        self.pairs += other.pairs;
        self.truncated += other.truncated;
        self.held += other.held;
        self.open += other.open;
        self.least_gap = self.least_gap.min(other.least_gap);
    }
}

impl State for Certificate {
    fn save(&self, to: &mut Writer) {
        let Self {
            pairs,
            truncated,
            held,
            open,
            least_gap,
        } = self;
        to.put(&[*pairs, *truncated, *held, *open]);
        to.put(least_gap);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let [pairs, truncated, held, open] = from.take()?;
        *self = Self {
            pairs,
            truncated,
            held,
            open,
            least_gap: from.take()?,
        };
        Ok(())
    }
}
