//! Contact of soft surfaces with each other, with themselves and with bones, edges included.
//!
//! Every near pair of a vertex and a triangle, or of two edges, keeps a **division plane**: a unit
//! normal along which one part is above the other one. A step moves all vertices along straight
//! lines. If the parts are in the same order along the normal at both ends of the step, they were
//! so at all times of it, because heights are linear in time. So no pair crosses, and with no
//! crossing at the start there is none afterwards. Pairs that are not listed were farther apart
//! than their vertices have moved since.
//!
//! [`Meeting::respond`] pushes pairs apart to their distance. [`Meeting::hold`] is the guarantee: it
//! takes back motion until every pair is in order. Motion along a plane stays.

mod filter;
mod rows;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

use super::PosedObstacle;
use super::gap::Parts;
use super::near_pairs::{NearPair, Owned, Side, near_pairs};
use super::surface::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::{Aabb, max_or_nan};
use crate::mesh::topology::Topology;
use crate::state::{DecodeError, Reader, State, Writer};
use rows::Row;

/// The list of pairs holds for this motion of two vertices towards each other, relative to the
/// median edge: shorter lists are made more often, longer ones are searched for longer.
const MARGIN: f64 = 0.5;

/// Greatest distance kept by a surface from itself, relative to the median edge: parts of
/// neighbouring triangles are not pushed apart.
const OWN: f64 = 0.25;

/// Share of the gap at the start that a step leaves at least.
const KEPT: f64 = 0.1;

/// Which surfaces meet, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeetingSettings {
    /// Distance kept between surfaces [m].
    pub thickness: f64,
    /// Distance kept between an edge or vertex of a bone and a muscle, relative to the thickness.
    pub over_bone: f64,
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
    /// Pairs that were looked at, summed over steps.
    pub pairs: u64,
    /// Vertices whose motion was cut short, summed over steps.
    pub truncated: u64,
    /// Vertices that were held where they were, summed over steps.
    pub held: u64,
    /// Pairs that no motion of free vertices could keep in order: between bones that close, or at
    /// areas of attachment. They are not certified.
    pub open: u64,
    /// Least gap of a pair at the end of a step [m]; infinite if no pair was near.
    pub least_gap: f64,
    /// Lists made.
    pub lists: u64,
}

impl Default for Certificate {
    fn default() -> Self {
        Self {
            pairs: 0,
            truncated: 0,
            held: 0,
            open: 0,
            least_gap: f64::INFINITY,
            lists: 0,
        }
    }
}

/// A soft surface of a meeting.
struct Soft {
    surface: Surface,
    owned: Owned,
    /// Number of the first of its vertices among those of the meeting.
    first: usize,
    count: usize,
}

/// A bone of a meeting.
struct Rigid {
    /// Index among the obstacles.
    obstacle: usize,
    surface: Arc<Surface>,
    owned: Owned,
    /// Number of each vertex among those of the meeting; `u32::MAX` for one that no pair names.
    number: Vec<u32>,
    /// Pose when the list was made.
    pose: Isometry3<f64>,
}

/// A listed pair. Its corners are numbers of vertices of the meeting.
#[derive(Clone, Copy, Debug)]
struct Pair {
    corners: [u32; 4],
    parts: Parts,
    /// True if no normal separated the parts when they were last looked at.
    is_blind: bool,
    /// The row of this step.
    row: u32,
    /// Unit normal of the plane, from the second part to the first one.
    normal: Vector3<f64>,
    /// Height of the first part over the second one when the list was made, and when the plane was [m].
    listed: f64,
    planned: f64,
    /// Distance to be kept [m]; 0 for a pair that is certified and not pushed.
    distance: f64,
}

/// Surfaces that can meet, with the pairs that are near.
pub struct Meeting {
    settings: MeetingSettings,
    soft: Vec<Soft>,
    rigid: Vec<Rigid>,
    /// Pairs of soft surfaces that can meet.
    partners: Vec<[usize; 2]>,
    /// Bones that each soft surface can meet, as indices into `rigid`.
    bones: Vec<Vec<usize>>,
    /// Number of soft vertices; those of bones follow.
    soft_count: usize,
    /// Bone and vertex of each number after those of the soft surfaces.
    slots: Vec<(u32, u32)>,
    /// Positions at the start and at the end of the step [m], and inverse masses.
    start: Vec<Point3<f64>>,
    end: Vec<Point3<f64>>,
    mass: Vec<f64>,
    /// Positions when the list was made [m].
    listed_at: Vec<Point3<f64>>,
    pairs: Vec<Pair>,
    rows: Vec<Row>,
    /// Distance to other soft surfaces, to bones and to itself that each soft vertex had at rest, at
    /// most the one to be kept [m].
    at_rest: [Vec<f64>; 3],
    /// Greatest distance of a listed pair [m], without and within a surface: for bones at rest, and
    /// of the present list.
    base_reach: [f64; 2],
    reach: [f64; 2],
    /// Distance that a surface keeps from itself [m].
    own_distance: f64,
    /// Greatest motion since the list was made, of a soft vertex and of a bone in reach [m].
    moved: [f64; 2],
    /// Share of a gap that a step leaves at least.
    kept: f64,
    certificate: Certificate,
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
        members: &[SoftMember<'_>],
        partners: &[[usize; 2]],
        placed: &[PosedObstacle],
        bones: impl Fn(usize) -> Option<Arc<Surface>>,
    ) -> Self {
        let (mut soft, mut start, mut mass) = (Vec::new(), Vec::new(), Vec::new());
        let (mut rigid, mut of_member): (Vec<Rigid>, Vec<Vec<usize>>) = (Vec::new(), Vec::new());
        let mut edge = f64::INFINITY;
        for member in members {
            soft.push(Soft {
                surface: Surface::new(member.mesh),
                owned: Owned::new(&member.mesh.triangles),
                first: start.len(),
                count: member.mesh.vertices.len(),
            });
            start.extend_from_slice(&member.mesh.vertices);
            mass.extend_from_slice(member.inverse_mass);
            edge = edge.min(
                member
                    .mesh
                    .median_edge_length(&Topology::new(member.mesh))
                    .unwrap_or(edge),
            );
            let mut known = Vec::new();
            for &obstacle in member.obstacles.iter().filter(|_| settings.bones) {
                let Some(surface) = bones(obstacle) else {
                    continue;
                };
                let place = rigid.iter().position(|rigid| rigid.obstacle == obstacle);
                known.push(place.unwrap_or_else(|| {
                    rigid.push(Rigid {
                        obstacle,
                        owned: Owned::new(surface.triangles()),
                        number: vec![u32::MAX; surface.positions().len()],
                        surface,
                        pose: placed[obstacle].now,
                    });
                    rigid.len() - 1
                }));
            }
            of_member.push(known);
        }
        let edge = if edge.is_finite() {
            edge
        } else {
            settings.thickness
        };
        let own_distance = settings.thickness.min(OWN * edge);
        let soft_count = start.len();
        let mut meeting = Self {
            base_reach: [
                settings.thickness + MARGIN * edge,
                own_distance + MARGIN * edge,
            ],
            reach: [0.0; 2],
            own_distance,
            settings,
            soft,
            rigid,
            partners: if settings.others {
                partners.to_vec()
            } else {
                Vec::new()
            },
            bones: of_member,
            soft_count,
            slots: Vec::new(),
            listed_at: Vec::new(),
            end: start.clone(),
            start,
            mass,
            pairs: Vec::new(),
            rows: Vec::new(),
            at_rest: [
                vec![settings.thickness; soft_count],
                vec![settings.over_bone * settings.thickness; soft_count],
                vec![own_distance; soft_count],
            ],
            moved: [0.0; 2],
            kept: KEPT,
            certificate: Certificate::default(),
        };
        meeting.list(placed, |placed| placed.now);
        meeting.learn_rest();
        meeting.take_certificate();
        meeting
    }

    /// Corners of soft surface `member` that are pushed, each with the direction in which it must not
    /// go back.
    pub fn blocked(&self, member: usize) -> impl Iterator<Item = (u32, Vector3<f64>)> + '_ {
        let Soft { first, count, .. } = self.soft[member];
        let pushed = self.rows.iter().filter(|row| row.is_pushed());
        pushed
            .flat_map(Row::directions)
            .filter_map(move |(v, normal)| {
                let v = (v as usize).checked_sub(first).filter(|v| *v < count)?;
                Some((v as u32, normal))
            })
    }

    /// The counts since the last call.
    pub fn take_certificate(&mut self) -> Certificate {
        std::mem::take(&mut self.certificate)
    }

    /// Begins a frame with a new list, so that its pairs do not depend on frames before.
    pub fn begin_frame(&mut self, bodies: &[&[Point3<f64>]], placed: &[PosedObstacle]) {
        self.take_start(bodies);
        self.list(placed, |placed| placed.before);
    }

    /// Begins a step at the positions of each soft surface [m].
    pub fn begin_step(&mut self, bodies: &[&[Point3<f64>]], placed: &[PosedObstacle]) {
        self.take_start(bodies);
        self.place(placed, |placed| placed.before, true);
        self.rows
            .iter()
            .for_each(|row| self.pairs[row.pair as usize].row = u32::MAX);
        self.rows.clear();
    }

    fn take_start(&mut self, bodies: &[&[Point3<f64>]]) {
        for (soft, x) in self.soft.iter().zip(bodies) {
            self.start[soft.first..soft.first + soft.count].copy_from_slice(x);
        }
    }

    fn take_end(&mut self, bodies: &[&mut [Point3<f64>]]) {
        for (soft, x) in self.soft.iter().zip(bodies) {
            self.end[soft.first..soft.first + soft.count].copy_from_slice(x);
        }
    }

    fn give_end(&self, bodies: &mut [&mut [Point3<f64>]]) {
        for (soft, x) in self.soft.iter().zip(bodies) {
            x.copy_from_slice(&self.end[soft.first..soft.first + soft.count]);
        }
    }

    /// Moves the vertices of bones to their poses at the start or end of the step.
    fn place(
        &mut self,
        placed: &[PosedObstacle],
        pose: impl Fn(&PosedObstacle) -> Isometry3<f64>,
        at_start: bool,
    ) {
        let poses: Vec<Isometry3<f64>> = self
            .rigid
            .iter()
            .map(|rigid| pose(&placed[rigid.obstacle]))
            .collect();
        let to = if at_start {
            &mut self.start
        } else {
            &mut self.end
        };
        for (&(rigid, vertex), x) in self.slots.iter().zip(&mut to[self.soft_count..]) {
            *x = poses[rigid as usize]
                * self.rigid[rigid as usize].surface.positions()[vertex as usize];
        }
    }

    /// Searches for all near pairs at the start of the step, with bones at the given pose.
    fn list(&mut self, placed: &[PosedObstacle], pose: impl Fn(&PosedObstacle) -> Isometry3<f64>) {
        // What bones move in a step cannot be taken back.
        let step = self.bone_motion(placed, |placed| placed.before);
        self.reach = self.base_reach.map(|reach| reach + 2.5 * step);
        let wide = self.reach[0].max(self.reach[1]);
        for soft in &mut self.soft {
            let x = &self.start[soft.first..soft.first + soft.count];
            soft.surface.refit_wide(x, 0.5 * wide);
        }
        for &(rigid, vertex) in &self.slots {
            self.rigid[rigid as usize].number[vertex as usize] = u32::MAX;
        }
        for rigid in &mut self.rigid {
            rigid.pose = pose(&placed[rigid.obstacle]);
        }
        self.slots.clear();
        self.pairs.clear();
        self.rows.clear();
        let side = |soft: usize| Side {
            surface: &self.soft[soft].surface,
            owned: &self.soft[soft].owned,
            pose: None,
        };
        let mut found = Vec::new();
        for a in (0..self.soft.len()).filter(|_| self.settings.itself) {
            found.push((
                Against::Itself,
                a,
                a,
                near_pairs(&side(a), None, self.reach[1]),
            ));
        }
        for &[a, b] in &self.partners {
            found.push((
                Against::Other,
                a,
                b,
                near_pairs(&side(a), Some(&side(b)), self.reach[0]),
            ));
        }
        for (a, bones) in self.bones.iter().enumerate() {
            for &b in bones {
                let rigid = &self.rigid[b];
                let bone = Side {
                    surface: &rigid.surface,
                    owned: &rigid.owned,
                    pose: Some(&rigid.pose),
                };
                found.push((
                    Against::Bone,
                    a,
                    b,
                    near_pairs(&side(a), Some(&bone), self.reach[0]),
                ));
            }
        }
        for (against, a, b, near) in found {
            for pair in near {
                self.add(against, a, b, &pair);
            }
        }
        let all = self.soft_count + self.slots.len();
        self.start.resize(all, Point3::origin());
        self.end.resize(all, Point3::origin());
        self.mass.resize(all, 0.0);
        self.place(placed, pose, true);
        self.listed_at.clone_from(&self.start);
        // The nearest first: a step looks at the pairs that can have come near since.
        let mut pairs = std::mem::take(&mut self.pairs);
        pairs.sort_by(|a, b| {
            a.listed
                .total_cmp(&b.listed)
                .then_with(|| self.key(a).cmp(&self.key(b)))
        });
        self.pairs = pairs;
        self.moved = [0.0; 2];
        self.certificate.lists += 1;
    }

    /// What names a pair. Numbers of bone vertices depend on the order of the search.
    fn key(&self, pair: &Pair) -> (Parts, [(u32, u32); 4]) {
        let name = |v: u32| match (v as usize).checked_sub(self.soft_count) {
            None => (u32::MAX, v),
            Some(slot) => self.slots[slot],
        };
        (pair.parts, pair.corners.map(name))
    }

    fn add(&mut self, against: Against, a: usize, b: usize, near: &NearPair) {
        let first = self.soft[a].first as u32;
        let split = near.parts.first();
        let mut corners = near.corners;
        for (k, corner) in corners.iter_mut().enumerate() {
            let is_of_a = (k < split) == near.in_order;
            *corner = match against {
                _ if is_of_a => first + *corner,
                Against::Itself | Against::Other => self.soft[b].first as u32 + *corner,
                Against::Bone => self.number(b, *corner),
            };
        }
        let is_fixed = |&v: &u32| {
            self.mass.get(v as usize).is_none_or(|w| *w <= 0.0) || v as usize >= self.soft_count
        };
        if corners.iter().all(is_fixed) {
            return;
        }
        let distance = match against {
            Against::Other => self.rest(0, &corners),
            // Vertices of a muscle near a bone have planes of their own.
            Against::Bone if near.parts == Parts::VertexTriangle && near.in_order => 0.0,
            Against::Bone => self.rest(1, &corners),
            Against::Itself => self.rest(2, &corners),
        };
        let (height, normal) = near
            .gap
            .map_or((0.0, Vector3::zeros()), |gap| (gap.height, gap.normal));
        self.pairs.push(Pair {
            corners,
            parts: near.parts,
            is_blind: near.gap.is_none(),
            row: u32::MAX,
            normal,
            listed: height,
            planned: height,
            distance,
        });
    }

    /// The least distance at rest of the soft corners of a pair [m].
    fn rest(&self, against: usize, corners: &[u32; 4]) -> f64 {
        let soft = corners.iter().filter(|&&v| (v as usize) < self.soft_count);
        soft.fold(f64::INFINITY, |least, &v| {
            least.min(self.at_rest[against][v as usize])
        })
    }

    fn number(&mut self, rigid: usize, vertex: u32) -> u32 {
        let number = &mut self.rigid[rigid].number[vertex as usize];
        if *number == u32::MAX {
            *number = (self.soft_count + self.slots.len()) as u32;
            self.slots.push((rigid as u32, vertex));
        }
        *number
    }

    /// Parts that are nearer than the thickness at rest keep the distance that they have: layers that
    /// lie on each other are not pushed apart.
    fn learn_rest(&mut self) {
        let soft_of = |v: u32| self.soft.partition_point(|soft| soft.first <= v as usize);
        for pair in &self.pairs {
            let kinds = pair.corners.map(|v| {
                if v as usize >= self.soft_count {
                    0
                } else {
                    soft_of(v)
                }
            });
            let against = match kinds {
                kinds if kinds.contains(&0) => 1,
                kinds if kinds.iter().all(|k| *k == kinds[0]) => 2,
                _ => 0,
            };
            for &v in pair
                .corners
                .iter()
                .filter(|&&v| (v as usize) < self.soft_count)
            {
                let rest = &mut self.at_rest[against][v as usize];
                *rest = rest.min(pair.listed);
            }
        }
    }

    /// Motion since the list was made, of soft vertices and of bones [m].
    fn motion(&self, placed: &[PosedObstacle]) -> [f64; 2] {
        let moved = self.end[..self.soft_count].iter().zip(&self.listed_at);
        let soft = max_or_nan(moved.map(|(x, from)| (x - from).norm_squared())).sqrt();
        let poses: Vec<Isometry3<f64>> = self.rigid.iter().map(|rigid| rigid.pose).collect();
        let mut of = poses.iter();
        [
            soft,
            self.bone_motion(placed, |_| *of.next().unwrap_or(&Isometry3::identity())),
        ]
    }

    /// Greatest motion of a bone near the soft surfaces, from given poses to the end of the step [m].
    fn bone_motion(
        &self,
        placed: &[PosedObstacle],
        mut from: impl FnMut(&PosedObstacle) -> Isometry3<f64>,
    ) -> f64 {
        let near =
            Aabb::of_points(&self.start[..self.soft_count]).inflate(8.0 * self.base_reach[0]);
        let bones = self.rigid.iter().map(|rigid| {
            let (from, now) = (from(&placed[rigid.obstacle]), placed[rigid.obstacle].now);
            if now == from {
                return 0.0;
            }
            let bounds = rigid.surface.root_box().transformed(&from);
            let by = |x: &Point3<f64>| (now * (from.inverse() * x) - x).norm();
            let most = |bounds: &Aabb| max_or_nan(bounds.corners().iter().map(by));
            let near = Aabb {
                min: bounds.min.sup(&near.min),
                max: bounds.max.inf(&near.max),
            };
            // What is farther away cannot have come near unless it moved that far.
            let far = most(&bounds);
            if far > 7.0 * self.base_reach[0] {
                far
            } else if near.is_empty() {
                0.0
            } else {
                most(&near)
            }
        });
        max_or_nan(bones)
    }

    /// True if pairs that are not listed can be near after the motion.
    fn is_outdated(&self, [soft, bone]: [f64; 2]) -> bool {
        let towards = soft + if soft > bone { soft } else { bone };
        !(towards <= self.reach[0] - self.settings.thickness
            && 2.0 * soft <= self.reach[1] - self.own_distance)
    }

    /// Sets the end of the step.
    fn set_end(&mut self, bodies: &[&mut [Point3<f64>]], placed: &[PosedObstacle]) {
        self.take_end(bodies);
        self.place(placed, |placed| placed.now, false);
        self.moved = self.motion(placed);
    }

    /// Sets the end of the step, and makes a new list at its start if the present one is outdated.
    fn update(&mut self, bodies: &[&mut [Point3<f64>]], placed: &[PosedObstacle]) {
        self.set_end(bodies, placed);
        if self.is_outdated(self.moved) && self.listed_at != self.start {
            self.list(placed, |placed| placed.before);
            self.set_end(bodies, placed);
        }
    }

    /// Number of pairs that can be nearer than `distance` [m].
    fn can_be_nearer(&self, distance: f64) -> usize {
        let [soft, bone] = self.moved;
        let towards = soft + if soft > bone { soft } else { bone };
        // Not `<`: a motion that is not a number looks at all pairs.
        self.pairs
            .partition_point(|pair| !(pair.listed >= distance + towards))
    }
}

/// What a soft surface meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Against {
    Itself,
    Other,
    Bone,
}

impl Certificate {
    /// Adds the counts of other steps.
    pub fn add(&mut self, other: &Self) {
        self.pairs += other.pairs;
        self.truncated += other.truncated;
        self.held += other.held;
        self.open += other.open;
        self.lists += other.lists;
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
            lists,
        } = self;
        to.put(&[*pairs, *truncated, *held, *open, *lists]);
        to.put(least_gap);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let [pairs, truncated, held, open, lists] = from.take()?;
        *self = Self {
            pairs,
            truncated,
            held,
            open,
            lists,
            least_gap: from.take()?,
        };
        Ok(())
    }
}
