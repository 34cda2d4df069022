//! Bodies that can meet take each step together; others are computed apart and in parallel.

use std::ops::Range;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::body::{Body, Stepper};
use super::bonds::Bonded;
use super::equilibrium::TOUCHING;
use super::frame::{FrameSteps, SETTLED, step_body};
use super::joint::Joint;
use super::{Simulation, place};
use crate::constraints::Potential;
use crate::contact::meeting::{Certificate, Meeting, MeetingSettings, SoftMember, StepMotions};
use crate::contact::response::OVER_VERTEX;
use crate::contact::{ContactPlane, Contacts, PosedObstacle};
use crate::mesh::union_find::UnionFind;
use crate::solvers::Broken;
use crate::solvers::descent::{DescentOutcome, DescentSettings};
use crate::solvers::sparse::FactorError;
use crate::state::{DecodeError, Reader, State, Writer};

/// Number of rounds in which volume and certificate are brought together.
const VOLUME_ROUNDS: usize = 4;

/// Greatest number of rounds after the last step of a frame.
const SETTLING: usize = 8;

/// Bodies that take their steps together.
pub(super) struct Group {
    /// Indices of the bodies, by name: the order in which a scene lists them changes nothing.
    pub members: Vec<usize>,
    /// What they do to each other, to themselves and to bones; `None` without contact.
    meeting: Option<Meeting>,
    /// The interfaces whose bonds it has, with the numbers of their springs.
    bonds: Vec<(usize, usize)>,
    /// The obstacles of each member when the meeting was made.
    obstacles: Vec<Vec<usize>>,
    /// Whether it is a minimum without a neighbour that crossed something.
    in_pairs: bool,
    /// Their common energy, if a step is the minimum of one.
    joint: Option<Joint>,
}

impl Simulation {
    /// The groups of bodies that can meet. Each body is in one.
    pub(super) fn gather(&mut self) {
        let known = |group: &Group| {
            let same = |(&b, obstacles): (&usize, &Vec<usize>)| {
                self.bodies.get(b).is_some_and(|body| {
                    let has_meeting = group.meeting.is_some();
                    obstacles_of(body) == *obstacles
                        && (!has_meeting || can_meet(body))
                        && group.in_pairs == body.in_pairs
                })
            };
            group.members.len() == group.obstacles.len()
                && group.members.iter().zip(&group.obstacles).all(same)
        };
        let count: usize = self.groups.iter().map(|group| group.members.len()).sum();
        if count == self.bodies.len() && self.groups.iter().all(known) {
            return;
        }
        let partners = self.partners();
        let mut sets = UnionFind::new(self.bodies.len());
        for &[a, b] in &partners {
            sets.join(a as u32, b as u32);
        }
        let mut members: Vec<Vec<usize>> = vec![Vec::new(); self.bodies.len()];
        for b in 0..self.bodies.len() {
            members[sets.root(b as u32) as usize].push(b);
        }
        members.retain(|members| !members.is_empty());
        for members in &mut members {
            members.sort_by(|&a, &b| self.bodies[a].name.cmp(&self.bodies[b].name));
        }
        let first = place(&self.scene, &self.surfaces);
        let before = std::mem::take(&mut self.groups);
        self.groups = members
            .into_iter()
            .map(|members| {
                let obstacles = members.iter().map(|&b| obstacles_of(&self.bodies[b]));
                let obstacles = obstacles.collect();
                let in_pairs = members.iter().any(|&b| self.bodies[b].in_pairs);
                let made = self.meeting(&members, &partners, &first);
                let (meeting, bonds) = made.unzip();
                Group {
                    obstacles,
                    in_pairs,
                    meeting,
                    bonds: bonds.unwrap_or_default(),
                    members,
                    joint: None,
                }
            })
            .collect();
        for group in self
            .groups
            .iter_mut()
            .filter(|group| group.meeting.is_some())
        {
            for &b in &group.members {
                let body = &mut self.bodies[b];
                if is_swept(body) {
                    let contacts = body.system.contacts.take();
                    body.system.contacts = contacts.map(Contacts::of_vertices_alone);
                }
            }
        }
        self.join(before);
    }

    /// Gives each group of minima that meet a common energy: that of the groups `before`, if they have
    /// the same members.
    fn join(&mut self, mut before: Vec<Group>) {
        let mut bodies: Vec<Option<&mut Body>> = self.bodies.iter_mut().map(Some).collect();
        for group in &mut self.groups {
            let members = group.members.iter();
            let mut bodies: Vec<&mut Body> = members.filter_map(|&b| bodies[b].take()).collect();
            let is_minimum = |body: &&mut Body| matches!(body.method, Stepper::Minimum(_));
            if group.meeting.is_none() || !bodies.iter().all(is_minimum) {
                continue;
            }
            let mut bonds = None;
            if let Some(meeting) = &mut group.meeting {
                meeting.push_once();
                bonds = meeting.elastic_bonds();
            }
            let same = before
                .iter_mut()
                .find(|known| known.members == group.members);
            group.joint = same.and_then(|known| known.joint.take());
            if group.joint.is_none() {
                match Joint::new(&mut bodies, bonds) {
                    Ok(joint) => group.joint = Some(joint),
                    Err(error) => {
                        group.meeting = None;
                        self.notes.push(format!(
                            "{}: computed without contact between muscles: {error}",
                            bodies[0].name
                        ));
                    }
                }
            }
        }
    }

    /// Pairs of bodies that can meet by the plan.
    fn partners(&self) -> Vec<[usize; 2]> {
        let body_of = |m: usize| {
            let name = &self.scene.muscles[m].name;
            self.bodies.iter().position(|body| body.name == *name)
        };
        let mut partners = Vec::new();
        for (m, plan) in self.plan.muscles.iter().enumerate() {
            for &other in &plan.partners {
                if let (Some(a), Some(b)) = (body_of(m), body_of(other))
                    && [a, b].iter().all(|&k| can_meet(&self.bodies[k]))
                {
                    partners.push([a, b]);
                }
            }
        }
        partners
    }

    fn meeting(
        &self,
        members: &[usize],
        partners: &[[usize; 2]],
        first: &[PosedObstacle],
    ) -> Option<(Meeting, Vec<(usize, usize)>)> {
        let contact = self.scene.effects.contact?;
        if !members.iter().all(|&b| can_meet(&self.bodies[b])) {
            return None;
        }
        // One minimum keeps out of bones by itself, in half the time, until it crosses something.
        if let &[one] = members
            && let body = &self.bodies[one]
            && !is_swept(body)
            && !body.in_pairs
        {
            return None;
        }
        // The planes of a common minimum have the directions of the gaps, and so must its pushes.
        let rounding = match members.iter().all(|&b| is_swept(&self.bodies[b])) {
            true => 1.0,
            false => 0.0,
        };
        let settings = MeetingSettings {
            thickness: contact.thickness,
            over_bone: OVER_VERTEX,
            rounding,
            friction: contact.friction,
            others: contact.between.muscles,
            bones: contact.between.bones,
            itself: contact.between.itself,
        };
        let obstacles: Vec<Vec<usize>> = members
            .iter()
            .map(|&b| obstacles_of(&self.bodies[b]))
            .collect();
        let soft: Vec<SoftMember<'_>> = members
            .iter()
            .zip(&obstacles)
            .map(|(&b, obstacles)| SoftMember {
                mesh: &self.bodies[b].rest,
                inverse_mass: &self.bodies[b].system.particles.inverse_mass,
                obstacles,
            })
            .collect();
        let partners: Vec<[usize; 2]> = partners
            .iter()
            .filter_map(|&[a, b]| Some([place_in(members, a)?, place_in(members, b)?]))
            .collect();
        let has_bones = obstacles
            .iter()
            .flatten()
            .any(|&o| self.surfaces.get(o).is_some());
        if !(settings.itself || has_bones || !partners.is_empty()) {
            return None;
        }
        let bone = |o: usize| self.surfaces.get(o).cloned();
        let mut meeting = Meeting::new(settings, &soft, &partners, first, bone);
        let (mut interfaces, mut specs) = (Vec::new(), Vec::new());
        for bonded in self.bonded() {
            let Bonded { interface, bodies } = &bonded;
            if let [Some(a), Some(b)] = bodies.map(|b| place_in(members, b)) {
                interfaces.push(*interface);
                specs.extend(self.bond_spec(&bonded, [a, b]));
            }
        }
        let counts = meeting.bond(&soft, &specs);
        Some((meeting, interfaces.into_iter().zip(counts).collect()))
    }
}

/// The place of body `b` among the members of a group.
fn place_in(members: &[usize], b: usize) -> Option<usize> {
    members.iter().position(|&m| m == b)
}

/// Bodies with a surface whose steps keep clear of other surfaces.
fn can_meet(body: &Body) -> bool {
    !matches!(body.method, Stepper::Tracked(_)) && !body.rest.triangles.is_empty()
}

/// Bodies with a surface whose steps are sweeps over constraints.
fn is_swept(body: &Body) -> bool {
    matches!(body.method, Stepper::Sweeps) && !body.rest.triangles.is_empty()
}

fn obstacles_of(body: &Body) -> Vec<usize> {
    body.system
        .contacts
        .as_ref()
        .map_or(Vec::new(), |c| c.obstacles().to_vec())
}

impl Group {
    /// Computes the steps of a frame; a jump of a member ends them.
    pub(super) fn compute(&mut self, bodies: &mut [&mut Body], of: &FrameSteps<'_>) {
        let Some(meeting) = &mut self.meeting else {
            bodies
                .par_iter_mut()
                .filter(|body| body.stopped.is_none())
                .for_each(|body| step_body(body, of));
            return;
        };
        if bodies.iter().all(|body| body.stopped.is_some()) {
            return;
        }
        for body in bodies.iter_mut() {
            if let Some(equilibrium) = body.equilibrium_mut() {
                equilibrium.begin_frame();
            }
        }
        if let Some(first) = of.steps.first() {
            meeting.begin_frame(&positions(bodies), first);
        }
        for (number, placed) in of.steps.iter().enumerate() {
            moving(bodies).for_each(|body| body.prepare(of, number));
            match &mut self.joint {
                None => step(meeting, bodies, placed, of),
                Some(joint) => joint_step(joint, meeting, bodies, placed, of),
            }
            moving(bodies).for_each(|body| {
                body.stops_or_jumps(of, number);
            });
            let jumps = bodies.iter().any(|body| body.jump.is_some());
            if of.stop.is_asked() || !of.is_last_try && jumps {
                return;
            }
        }
        moving(bodies).for_each(|body| body.stop_if_torn(of));
        // A minimum ends with contact and volume satisfied.
        if let Some(last) = of.steps.last().filter(|_| self.joint.is_none()) {
            settle(meeting, bodies, last, of);
            // What contact at the end threw apart is a jump as well.
            moving(bodies).for_each(|body| {
                body.stops_or_jumps(of, of.steps.len() - 1);
            });
            if !of.is_last_try && bodies.iter().any(|body| body.jump.is_some()) {
                return;
            }
        }
        meeting.note_gaps();
        of.stop.spend(meeting.take_work());
        // A muscle that goes back to the frame before is not kept in order with what moved on.
        let stops = bodies.iter().filter_map(|body| body.stopped.as_ref());
        let stopped = stops.filter(|(frame, _)| *frame == of.frame).count();
        meeting.count(&Certificate {
            open: stopped as u64,
            ..Certificate::default()
        });
        for body in bodies.iter_mut() {
            match body.stopped {
                None => body.good.clone_from(&body.system.particles),
                // It stands still, whatever met it.
                Some(_) => body.system.particles.clone_from(&body.good),
            }
        }
    }

    /// Changes the tolerance of a common energy in later steps.
    pub(super) fn set_tolerance(&mut self, tolerance: f64) {
        if let Some(joint) = &mut self.joint {
            joint.set_tolerance(tolerance);
        }
    }

    /// Whether pairs of triangles keep its members apart.
    pub(super) fn has_meeting(&self) -> bool {
        self.meeting.is_some()
    }

    /// The energy of the bonds between its members, numbered one after the other.
    pub(super) fn elastic_bonds(&self) -> Option<Box<dyn Potential>> {
        self.meeting.as_ref()?.elastic_bonds()
    }

    /// Brings its members to their equilibrium by Newton's method, among obstacles that stand still.
    pub(super) fn refine(
        &mut self,
        bodies: &mut [&mut Body],
        still: &[PosedObstacle],
        of: &FrameSteps<'_>,
        settings: DescentSettings,
    ) -> Result<DescentOutcome, FactorError> {
        super::joint::refine(self.meeting.as_mut(), bodies, still, of, settings)
    }

    /// What touches where its members rest: bones, and each other. Each member comes with its range in
    /// the numbers of the rows.
    pub(super) fn touching(
        &mut self,
        bodies: &[Body],
        members: &[(usize, Range<usize>)],
        still: &[PosedObstacle],
    ) -> Vec<ContactPlane> {
        let (mut rows, mut reach) = (Vec::new(), 0.0);
        for (b, range) in members {
            let system = &bodies[*b].system;
            let Some(contacts) = &system.contacts else {
                continue;
            };
            reach = TOUCHING * contacts.thickness();
            for mut row in contacts.contact_planes() {
                if row.room(&system.particles.position) <= reach {
                    let vertices = row.terms.iter_mut();
                    vertices.for_each(|(v, _)| *v += range.start as u32);
                    rows.push(row);
                }
            }
        }
        if let Some(meeting) = &mut self.meeting {
            let own = members.iter().map(|(b, _)| &bodies[*b].system.particles);
            let x: Vec<&[Point3<f64>]> = own.map(|own| own.position.as_slice()).collect();
            meeting.begin_step(&x, still);
            rows.extend(meeting.planes(reach));
        }
        rows
    }

    /// The interfaces whose bonds it has, with the numbers of their springs.
    pub(super) fn bonds(&self) -> &[(usize, usize)] {
        &self.bonds
    }

    /// The counts since the last call.
    pub(super) fn take_certificate(&mut self) -> Certificate {
        self.meeting
            .as_mut()
            .map_or(Certificate::default(), Meeting::take_certificate)
    }
}

impl State for Group {
    fn save(&self, to: &mut Writer) {
        // Lists of pairs are made anew in each frame.
        let Self {
            members: _,
            meeting: _,
            obstacles: _,
            in_pairs: _,
            bonds: _,
            joint,
        } = self;
        joint.iter().for_each(|joint| joint.save(to));
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        // The meeting is made anew with the restored bodies.
        self.obstacles.clear();
        self.joint
            .iter_mut()
            .try_for_each(|joint| joint.restore(from))
    }
}

/// A step of bodies with a common energy; if one breaks, all stop.
fn joint_step(
    joint: &mut Joint,
    meeting: &mut Meeting,
    bodies: &mut [&mut Body],
    placed: &[PosedObstacle],
    of: &FrameSteps<'_>,
) {
    if bodies.iter().any(|body| body.stopped.is_some()) {
        return;
    }
    let begin = std::time::Instant::now();
    if let Err(broken) = joint.step(meeting, bodies, placed, of) {
        for body in bodies.iter_mut() {
            body.stop(of.frame, broken.clone());
        }
    }
    if let Some(body) = bodies.first_mut() {
        body.system.clock.note("equilibrium", begin);
    }
}

/// A step of all bodies of a group; those that stopped stand still.
fn step(
    meeting: &mut Meeting,
    bodies: &mut [&mut Body],
    placed: &[PosedObstacle],
    of: &FrameSteps<'_>,
) {
    let dt = of.dt;
    meeting.begin_step(&positions(bodies), placed);
    let iterations = bodies
        .first()
        .map_or(1, |body| body.system.settings.iterations);
    for iteration in 0..iterations {
        // The frame is undone.
        if of.stop.is_asked() {
            return;
        }
        let motions = with_motions(meeting, bodies, |_, body| {
            if iteration == 0 {
                body.system.begin_alone(placed, dt);
            }
            body.system.sweep_alone(placed, dt);
        });
        let mut motions = Some(motions);
        for body in bodies.iter_mut().filter(|body| body.stopped.is_none()) {
            // A number that is not finite would reach every neighbour.
            if let Some(particle) = body.system.particles.first_non_finite() {
                motions = None;
                body.system.back_to_start();
                let broken = body.step(placed, of).err();
                let of_step = Broken {
                    effect: "step",
                    particle,
                };
                body.stop(of.frame, broken.unwrap_or(of_step));
            }
        }
        if burst(bodies, of, &mut motions) {
            return;
        }
        let begin = std::time::Instant::now();
        if meeting.project_bonds(&mut positions_mut(bodies), dt) {
            motions = None;
        }
        meeting.respond(&mut positions_mut(bodies), motions);
        of.stop.spend(meeting.take_work());
        note(bodies, begin);
        project_volumes(meeting, bodies, of);
    }
    moving(bodies).for_each(|body| body.system.end_alone(placed, dt));
    let mut velocities: Vec<&mut [Vector3<f64>]> = bodies
        .iter_mut()
        .map(|body| body.system.particles.velocity.as_mut_slice())
        .collect();
    meeting.end_step(&mut velocities, dt);
}

/// Notes what burst in a sweep. Returns true if the frame is undone; otherwise what burst has stopped,
/// and the motions are no longer known.
fn burst(
    bodies: &mut [&mut Body],
    of: &FrameSteps<'_>,
    motions: &mut Option<Vec<StepMotions>>,
) -> bool {
    let ends = moving(bodies)
        .filter_map(|body| body.bursts(of).then_some(()))
        .count();
    if ends > 0 {
        *motions = None;
    }
    ends > 0 && !of.is_last_try
}

/// Projects the volumes and holds the certificate, until both are satisfied: vertices that the
/// certificate took back do not move for the volume.
fn project_volumes(meeting: &mut Meeting, bodies: &mut [&mut Body], of: &FrameSteps<'_>) {
    let mut frozen: Vec<Vec<u32>> = vec![Vec::new(); bodies.len()];
    for round in 0..VOLUME_ROUNDS {
        let blocked: Vec<Vec<_>> = (0..bodies.len())
            .map(|k| meeting.blocked(k).collect())
            .collect();
        let is_moved = |k: usize| round == 0 || !frozen[k].is_empty();
        let motions = with_motions(meeting, bodies, |k, body| {
            if is_moved(k) {
                body.system.project_volume(of.dt, &blocked[k], &frozen[k]);
            }
        });
        for (k, body) in bodies.iter().enumerate() {
            if is_moved(k) && body.stopped.is_none() {
                meeting.bear(k, |vertex| body.system.withheld(vertex));
            }
        }
        let mut motions = Some(motions);
        if burst(bodies, of, &mut motions) {
            return;
        }
        let begin = std::time::Instant::now();
        let changed = meeting.hold(&mut positions_mut(bodies), motions);
        of.stop.spend(meeting.take_work());
        note(bodies, begin);
        if changed.iter().all(Vec::is_empty) {
            return;
        }
        for (frozen, changed) in frozen.iter_mut().zip(changed) {
            frozen.extend(changed);
            frozen.sort_unstable();
            frozen.dedup();
        }
    }
}

/// After the last step of a frame: repeats contact and volume, with new queries, until both are
/// satisfied.
fn settle(
    meeting: &mut Meeting,
    bodies: &mut [&mut Body],
    placed: &[PosedObstacle],
    of: &FrameSteps<'_>,
) {
    let depth = SETTLED * of.thickness;
    let still: Vec<PosedObstacle> = placed.iter().map(PosedObstacle::still).collect();
    for _ in 0..SETTLING {
        meeting.begin_step(&positions(bodies), &still);
        moving(bodies).for_each(|body| body.system.settle_contact(&still));
        meeting.respond(&mut positions_mut(bodies), None);
        of.stop.spend(meeting.take_work());
        project_volumes(meeting, bodies, of);
        // The frame is undone.
        if of.stop.is_asked() || bodies.iter().any(|body| body.jump.is_some()) {
            return;
        }
        let clear: Vec<bool> = bodies
            .par_iter_mut()
            .map(|body| body.stopped.is_some() || body.system.is_settled(&still, depth))
            .collect();
        if clear.into_iter().all(|clear| clear) {
            return;
        }
    }
}

/// Moves all bodies that have not stopped, in parallel. Returns the motion of all in the step.
fn with_motions(
    meeting: &Meeting,
    bodies: &mut [&mut Body],
    moves: impl Fn(usize, &mut Body) + Sync,
) -> Vec<StepMotions> {
    let all = bodies.par_iter_mut().enumerate().map(|(k, body)| {
        if body.stopped.is_none() {
            moves(k, body);
        }
        meeting.motions(k, &body.system.particles.position)
    });
    all.collect()
}

fn moving<'a, 'b>(
    bodies: &'a mut [&'b mut Body],
) -> impl ParallelIterator<Item = &'a mut &'b mut Body> {
    bodies.par_iter_mut().filter(|body| body.stopped.is_none())
}

fn positions<'a>(bodies: &'a [&mut Body]) -> Vec<&'a [Point3<f64>]> {
    bodies
        .iter()
        .map(|body| body.system.particles.position.as_slice())
        .collect()
}

fn positions_mut<'a>(bodies: &'a mut [&mut Body]) -> Vec<&'a mut [Point3<f64>]> {
    bodies
        .iter_mut()
        .map(|body| body.system.particles.position.as_mut_slice())
        .collect()
}

/// The time of a group is noted for its first body.
fn note(bodies: &mut [&mut Body], begin: std::time::Instant) {
    if let Some(body) = bodies.first_mut() {
        body.system.clock.note("contact", begin);
    }
}
