//! The equilibrium of bodies that can meet: one minimum of the sum of their energies.
//!
//! Near pairs of two surfaces are rows of the minimisation beside those of bones, and the meeting
//! takes back the motion of each trial that would pass through something.

use std::ops::Range;

use nalgebra::{Point3, Vector3};

use super::body::{Body, Stepper};
use super::equilibrium::{Bones, Equilibrium, TOUCHING, first_non_finite};
use super::frame::{FrameSteps, Stop};
use crate::constraints::{EnclosedVolume, Potential};
use crate::contact::meeting::{Certificate, Meeting};
use crate::contact::{ContactPlane, PosedObstacle};
use crate::mesh::measures::{Aabb, max_or_nan};
use crate::solvers::Broken;
use crate::solvers::descent::{ContactFilter, DescentOutcome, DescentSettings, NoContact};
use crate::solvers::energy::{Energy, Inertia, Member};
use crate::solvers::newton::Newton;
use crate::solvers::quasi_static::QuasiStatic;
use crate::solvers::sparse::FactorError;
use crate::state::{DecodeError, Reader, State, Writer};

/// Greatest motion of a vertex in one part of the motion to new poses, in contact thicknesses, and
/// the greatest number of parts. A thickness below a share of an edge counts as that share: what is thin
/// beside its mesh needs no finer parts.
const PART: f64 = 0.05;
const MOST_PARTS: usize = 200;
const OF_EDGE: f64 = 0.1;

/// Share of all vertices beyond which a trial that crosses at more pairs is shortened as a whole.
const MANY: f64 = 0.02;

/// Bodies with one energy.
pub(super) struct Joint {
    solver: QuasiStatic,
    /// The vertices of each body among those of all.
    ranges: Vec<Range<usize>>,
}

impl Joint {
    /// Prepares bodies at rest, each with an energy of its own, with `bonds` between them.
    ///
    /// # Errors
    /// A part of a body without a fixed vertex, or too little memory.
    pub fn new(
        bodies: &mut [&mut Body],
        bonds: Option<Box<dyn Potential>>,
    ) -> Result<Self, FactorError> {
        let (mut ranges, mut x, mut mass) = (Vec::new(), Vec::new(), Vec::new());
        let mut settings = DescentSettings::default();
        for body in bodies.iter_mut() {
            let first = x.len();
            x.extend_from_slice(&body.rest.vertices);
            mass.extend_from_slice(&body.system.particles.inverse_mass);
            ranges.push(first..x.len());
            settings = equilibrium(body).settings();
        }
        let energy = combined(bodies, bonds);
        let mut solver = QuasiStatic::new(energy, &x, &mass, settings)?;
        give_back(bodies, &mut solver.problem.energy);
        Ok(Self { solver, ranges })
    }

    /// Changes the tolerance of later steps.
    pub fn set_tolerance(&mut self, tolerance: f64) {
        self.solver.problem.settings.tolerance = tolerance;
    }

    /// Moves the bodies with the bones to their present poses and minimises the energy.
    ///
    /// # Errors
    /// A body with a number that is not finite; all are restored to the state before.
    pub fn step(
        &mut self,
        meeting: &mut Meeting,
        bodies: &mut [&mut Body],
        placed: &[PosedObstacle],
        of: &FrameSteps<'_>,
    ) -> Result<(), Broken> {
        let dt = of.dt;
        let start = self.positions(bodies);
        let mut held = Vec::new();
        for (body, range) in bodies.iter_mut().zip(&self.ranges) {
            let system = &mut body.system;
            let first = range.start as u32;
            held.extend(
                system
                    .held
                    .iter()
                    .map(|h| (h.vertex + first, placed[h.bone].now * h.local)),
            );
            let Stepper::Minimum(equilibrium) = &mut body.method else {
                continue;
            };
            equilibrium.aim(system, dt);
        }
        take(bodies, &self.ranges, &mut self.solver.problem.energy);
        let mut x = start.clone();
        let mut around = Around::new(meeting, bodies, self.ranges.clone(), of, placed);
        around.bounds = Aabb::of_points(x.iter());
        around.begin(&x);
        self.solver.follow(&mut x, &held, &mut around);
        around.is_there = true;
        self.solver.settle(&mut x, &mut around);
        let outcome = self
            .solver
            .solve(&mut x, &mut around, |_, _| !of.stop.is_asked());
        around.end();
        give_back(bodies, &mut self.solver.problem.energy);
        let broken = first_non_finite(&x);
        let end = if broken.is_some() { &start } else { &x };
        for (body, range) in bodies.iter_mut().zip(&self.ranges) {
            let system = &mut body.system;
            system
                .particles
                .position
                .copy_from_slice(&end[range.clone()]);
            if let Stepper::Minimum(equilibrium) = &mut body.method {
                equilibrium.take_outcome(outcome, &start[range.clone()], &mut system.particles, dt);
            }
        }
        let Some(particle) = broken else {
            return Ok(());
        };
        let body = self.ranges.partition_point(|range| range.end <= particle);
        Err(Broken {
            effect: "equilibrium",
            particle: particle - self.ranges[body].start,
        })
    }

    fn positions(&self, bodies: &[&mut Body]) -> Vec<Point3<f64>> {
        let each = bodies
            .iter()
            .map(|body| body.system.particles.position.as_slice());
        each.collect::<Vec<_>>().concat()
    }
}

impl State for Joint {
    fn save(&self, to: &mut Writer) {
        self.solver.save(to);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        self.solver.restore(from)
    }
}

fn equilibrium(body: &mut Body) -> &mut Equilibrium {
    match &mut body.method {
        Stepper::Minimum(equilibrium) => equilibrium,
        Stepper::Sweeps | Stepper::Tracked(_) => unreachable!("a joint is of minima alone"),
    }
}

/// One energy of bodies with `bonds` between them; it takes their elastic parts.
pub(super) fn combined(bodies: &mut [&mut Body], bonds: Option<Box<dyn Potential>>) -> Energy {
    let mut count = 0;
    let mut ranges = Vec::new();
    for body in bodies.iter() {
        ranges.push(count..count + body.count());
        count += body.count();
    }
    let mut energy = Energy {
        elastic: bonds.into_iter().collect(),
        ..Energy::default()
    };
    for (body, range) in bodies.iter_mut().zip(&ranges) {
        let shifted = |v: &EnclosedVolume| v.shifted(range.start as u32, count);
        let own = equilibrium(body).energy_mut();
        energy.volumes.extend(own.volumes.iter().map(shifted));
    }
    take(bodies, &ranges, &mut energy);
    energy
}

/// Brings bodies that stand among still obstacles to their common equilibrium by Newton's method; alone
/// with bones, or with all that they can meet.
///
/// # Errors
/// Too little memory, or a part that moves freely.
pub(super) fn refine(
    mut meeting: Option<&mut Meeting>,
    bodies: &mut [&mut Body],
    still: &[PosedObstacle],
    of: &FrameSteps<'_>,
    settings: DescentSettings,
) -> Result<DescentOutcome, FactorError> {
    let bonds = meeting.as_ref().and_then(|meeting| meeting.elastic_bonds());
    let (mut ranges, mut x, mut mass) = (Vec::new(), Vec::new(), Vec::new());
    for body in bodies.iter() {
        let (first, particles) = (x.len(), &body.system.particles);
        x.extend_from_slice(&particles.position);
        mass.extend_from_slice(&particles.inverse_mass);
        ranges.push(first..x.len());
    }
    let energy = combined(bodies, bonds);
    let mut newton = Newton::new(energy, &x, &mass, settings)?;
    let watch = |_: &DescentOutcome, _: &[Point3<f64>]| !of.stop.is_asked();
    let outcome = match (&mut meeting, &mut *bodies) {
        (Some(meeting), bodies) => {
            let mut around = Around::new(meeting, bodies, ranges.clone(), of, still);
            around.bounds = Aabb::of_points(x.iter());
            around.is_there = true;
            around.begin(&x);
            let outcome = newton.solve(&mut x, &mut around, watch);
            around.end();
            outcome
        }
        (None, [Body { system, method, .. }]) => match (&mut system.contacts, method) {
            (Some(contacts), Stepper::Minimum(equilibrium)) => {
                let mut bones = equilibrium.bones(contacts, still, of.stop);
                newton.solve(&mut x, &mut bones, watch)
            }
            _ => newton.solve(&mut x, &mut NoContact, watch),
        },
        (None, _) => newton.solve(&mut x, &mut NoContact, watch),
    };
    give_back(bodies, &mut newton.problem.energy);
    let outcome = outcome?;
    for (body, range) in bodies.iter_mut().zip(ranges) {
        let position = &mut body.system.particles.position;
        position.copy_from_slice(&x[range]);
    }
    Ok(outcome)
}

/// Takes the elastic parts, forces and inertia of all bodies into one energy.
fn take(bodies: &mut [&mut Body], ranges: &[Range<usize>], all: &mut Energy) {
    let count = ranges.last().map_or(0, |range| range.end);
    let mut inertia = Inertia::default();
    all.forces.clear();
    for (body, range) in bodies.iter_mut().zip(ranges) {
        let own = equilibrium(body).energy_mut();
        all.members.push(Member {
            range: range.clone(),
            elastic: std::mem::take(&mut own.elastic),
        });
        if !own.forces.is_empty() {
            all.forces.resize(count, Vector3::zeros());
            all.forces[range.clone()].copy_from_slice(&own.forces);
        }
        if let Some(own) = &own.inertia {
            inertia.weight.extend_from_slice(&own.weight);
            inertia.target.extend_from_slice(&own.target);
        }
    }
    all.inertia = (!inertia.weight.is_empty()).then_some(inertia);
}

/// Gives the elastic parts back to their bodies.
fn give_back(bodies: &mut [&mut Body], all: &mut Energy) {
    for (body, member) in bodies.iter_mut().zip(all.members.drain(..)) {
        equilibrium(body).energy_mut().elastic = member.elastic;
    }
}

/// What is around the bodies of a joint during the trials of a minimisation: bones, and each other.
struct Around<'a> {
    meeting: &'a mut Meeting,
    /// The bones around each body; `None` for a body without contact.
    bones: Vec<Option<Bones<'a>>>,
    ranges: Vec<Range<usize>>,
    /// Bones with their motion from the last accepted positions on, and their whole motion.
    placed: Vec<PosedObstacle>,
    whole: Vec<PosedObstacle>,
    /// Counts of the accepted motion, and of the last trial.
    counts: [Certificate; 2],
    /// Near pairs at the last accepted positions.
    rows: Vec<ContactPlane>,
    /// The box of all bodies before the step.
    bounds: Aabb,
    /// True once the bones are where the step brings them.
    is_there: bool,
    thickness: f64,
    /// The shortest of the bodies' median edges [m].
    edge: f64,
    stop: Stop<'a>,
}

impl<'a> Around<'a> {
    fn new(
        meeting: &'a mut Meeting,
        bodies: &'a mut [&mut Body],
        ranges: Vec<Range<usize>>,
        of: &FrameSteps<'a>,
        placed: &[PosedObstacle],
    ) -> Self {
        let edges = bodies.iter().map(|body| body.edge_length);
        let edge = edges.min_by(f64::total_cmp).unwrap_or(0.0);
        let each = bodies.iter_mut().map(|body| {
            let Body { system, method, .. } = &mut **body;
            let Stepper::Minimum(equilibrium) = method else {
                return None;
            };
            let contacts = system.contacts.as_mut()?;
            Some(equilibrium.bones(contacts, placed, of.stop))
        });
        Self {
            bones: each.collect(),
            counts: [meeting.take_certificate(), Certificate::default()],
            meeting,
            ranges,
            placed: placed.to_vec(),
            whole: placed.to_vec(),
            rows: Vec::new(),
            bounds: Aabb::EMPTY,
            is_there: false,
            thickness: of.thickness,
            edge,
            stop: of.stop,
        }
    }

    /// Motion that each bone makes where the bodies are [m].
    fn of_bones(&self) -> impl Iterator<Item = f64> {
        let corners = self.bounds.corners();
        self.whole.iter().map(move |placed| {
            let to_end = placed.now * placed.before.inverse();
            max_or_nan(corners.iter().map(|x| (to_end * x - x).norm()))
        })
    }

    /// The next motion begins at `x` [m].
    fn begin(&mut self, x: &[Point3<f64>]) {
        self.meeting
            .begin_step(&slices(&self.ranges, x), &self.placed);
        self.rows.clear();
        if self.is_there {
            self.rows = self.meeting.planes(self.touching());
        }
    }

    /// The last motion was accepted.
    fn end(self) {
        self.stop.spend(self.meeting.take_work());
        self.meeting.count(&self.counts[0]);
    }
}

impl ContactFilter for Around<'_> {
    fn planes(&self) -> Vec<ContactPlane> {
        let mut all = self.rows.clone();
        for (bones, range) in self.bones.iter().zip(&self.ranges) {
            for mut plane in bones.iter().flat_map(Bones::planes) {
                plane
                    .terms
                    .iter_mut()
                    .for_each(|(v, _)| *v += range.start as u32);
                all.push(plane);
            }
        }
        all
    }

    fn touching(&self) -> f64 {
        // Also where no bone is near.
        TOUCHING * self.thickness
    }

    fn parts(&self, displacement: &[Vector3<f64>]) -> usize {
        let most = max_or_nan(displacement.iter().map(|d| d.norm()).chain(self.of_bones()));
        let parts = most / (PART * self.thickness.max(OF_EDGE * self.edge));
        if parts >= 1.0 {
            (parts.ceil() as usize).min(MOST_PARTS)
        } else {
            1
        }
    }

    fn begin_part(&mut self, share: f64, start: &[Point3<f64>]) {
        for (placed, whole) in self.placed.iter_mut().zip(&self.whole) {
            let between = whole.before.try_lerp_slerp(&whole.now, share, 0.0);
            placed.now = between.filter(|_| share < 1.0).unwrap_or(whole.now);
        }
        for bones in self.bones.iter_mut().flatten() {
            bones.place(&self.placed);
        }
        self.meeting
            .begin_step(&slices(&self.ranges, start), &self.placed);
    }

    fn push(&mut self, start: &[Point3<f64>], x: &mut [Point3<f64>]) {
        for (bones, range) in self.bones.iter_mut().zip(&self.ranges) {
            match bones {
                Some(bones) => bones.push(&start[range.clone()], &mut x[range.clone()]),
                None => self.stop.spend_trial(range.len()),
            }
        }
        self.meeting.respond(&mut slices_mut(&self.ranges, x), None);
        self.stop.spend(self.meeting.take_work());
    }

    fn hold(&mut self, x: &mut [Point3<f64>]) -> Option<bool> {
        let most = (MANY * x.len() as f64) as usize;
        let mut bodies = slices_mut(&self.ranges, x);
        let changed = self.meeting.hold_few(&mut bodies, most);
        self.stop.spend(self.meeting.take_work());
        let changed = changed?;
        self.counts[1] = self.meeting.take_certificate();
        match changed.iter().all(Vec::is_empty) {
            _ if self.counts[1].open > 0 => None,
            true => Some(false),
            false => Some(true),
        }
    }

    fn hold_all(&mut self, x: &mut [Point3<f64>]) {
        self.meeting.hold(&mut slices_mut(&self.ranges, x), None);
        self.stop.spend(self.meeting.take_work());
        self.counts[1] = self.meeting.take_certificate();
    }

    fn is_stopped(&self) -> bool {
        self.stop.is_asked()
    }

    fn spend(&mut self, steps: usize) {
        self.stop.spend(steps);
    }

    fn accept(&mut self, x: &[Point3<f64>]) {
        for (bones, range) in self.bones.iter_mut().zip(&self.ranges) {
            if let Some(bones) = bones {
                bones.accept(&x[range.clone()]);
            }
        }
        let [sum, last] = &mut self.counts;
        sum.add(&std::mem::take(last));
        // The bones do not move from here on.
        self.placed.iter_mut().for_each(|p| p.before = p.now);
        self.begin(x);
    }
}

fn slices<'a>(ranges: &[Range<usize>], x: &'a [Point3<f64>]) -> Vec<&'a [Point3<f64>]> {
    ranges.iter().map(|range| &x[range.clone()]).collect()
}

fn slices_mut<'a>(ranges: &[Range<usize>], x: &'a mut [Point3<f64>]) -> Vec<&'a mut [Point3<f64>]> {
    let mut rest = x;
    let mut all = Vec::new();
    for range in ranges {
        let (own, after) = rest.split_at_mut(range.len());
        all.push(own);
        rest = after;
    }
    all
}
