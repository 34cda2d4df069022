//! A frame: its steps, the repetition with shorter ones, and the stop by a progress.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;
use std::sync::mpsc::RecvTimeoutError;
use std::thread;
use std::time::Duration;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::body::{Body, Stepper};
use super::measures::VOLUME_HELD;
use super::{Simulation, Stepped, body, carrier, measures, together};
use crate::contact::{Contacts, PosedObstacle};
use crate::mesh::measures::{Aabb, max_or_nan};
use crate::progress::Progress;
use crate::solvers::System;
use crate::state::{Reader, State, Writer};

/// Greatest depth of a vertex below a bone's surface at the end of a frame without another contact
/// query, relative to the contact thickness.
pub(super) const SETTLED: f64 = 2e-4;

/// A progress is asked after this time whether to stop.
const ASKED_EVERY: Duration = Duration::from_millis(20);

/// Number of steps that take about as long as a trial of a minimisation over the same vertices, with contact.
const OF_TRIAL: usize = 30;

/// Number of times in a frame that velocities even out.
const VISCOUS_STEPS: usize = 8;

impl Simulation {
    /// Computes the next frame.
    pub fn step_frame(&mut self) {
        self.frame_unless(None);
    }

    /// Computes the next frame, unless the progress stops it: it is asked many times a second.
    /// Then everything is as before the frame; so it is after one for which the work did not last. In a
    /// pool of threads the progress is not asked.
    pub fn step_frame_with(&mut self, progress: &dyn Progress) -> Stepped {
        // A thread of a pool that waits for others of it could wait for ever.
        if rayon::current_thread_index().is_some() {
            return match self.frame_unless(None) {
                true => Stepped::Done,
                false => Stepped::Interrupted,
            };
        }
        let asked = AtomicBool::new(false);
        let (held, dropped) = mpsc::channel::<()>();
        let done = thread::scope(|scope| {
            let worker = thread::Builder::new().spawn_scoped(scope, || {
                // Dropped at the end, after a panic as well.
                let _held = held;
                self.frame_unless(Some(&asked))
            });
            let worker = worker.ok()?;
            while dropped.recv_timeout(ASKED_EVERY) == Err(RecvTimeoutError::Timeout) {
                if progress.is_stopped() {
                    asked.store(true, Ordering::Relaxed);
                }
            }
            Some(worker.join())
        });
        match done {
            Some(Ok(true)) => Stepped::Done,
            Some(Ok(false)) => Stepped::Interrupted,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            // The system has no thread left.
            None => match self.frame_unless(None) {
                true => Stepped::Done,
                false => Stepped::Interrupted,
            },
        }
    }

    fn frame_unless(&mut self, asked: Option<&AtomicBool>) -> bool {
        let done = AtomicU64::new(self.work);
        let stop = Stop {
            asked,
            done: &done,
            most: self.most_work,
        };
        let ended = self.frame_in_pool(stop);
        self.work = done.into_inner();
        ended
    }

    fn frame_in_pool(&mut self, stop: Stop<'_>) -> bool {
        match self.pool.take() {
            Some(pool) => {
                let done = pool.install(|| self.next_frame(stop));
                self.pool = Some(pool);
                done
            }
            None => self.next_frame(stop),
        }
    }

    pub(super) fn next_frame(&mut self, stop: Stop<'_>) -> bool {
        let Some(mut finer) = self.finer.take() else {
            return self.next_of_this_mesh(stop);
        };
        // It can be a frame ahead, if only the other one was stopped.
        let done = finer.goes_to(self.frame + 1, stop) && self.next_of_this_mesh(stop);
        if done {
            finer.compare(self);
        }
        self.finer = Some(finer);
        done
    }

    fn next_of_this_mesh(&mut self, stop: Stop<'_>) -> bool {
        let Some(mut refinement) = self.refinement.take() else {
            return self.compute_frame(stop);
        };
        let done = refinement.next(self, stop);
        self.refinement = Some(refinement);
        done
    }

    /// Computes a frame with steps so short that no surface jumps. Returns false if it was stopped,
    /// and then all is as before it.
    pub(super) fn compute_frame(&mut self, stop: Stop<'_>) -> bool {
        // Bodies can have been changed since the last frame.
        self.gather();
        let can_jump = self.bodies.iter().any(Body::can_jump);
        self.watch_lone();
        let start = (can_jump || stop.can_come() || !self.lone.is_empty()).then(|| {
            let mut start = Writer::default();
            self.save(&mut start);
            start.bytes
        });
        self.control.begin_frame();
        let (mut first, had_refined) = (None, self.control.has_refined());
        loop {
            let is_last_try = !can_jump || self.control.is_shortest();
            self.try_frame(is_last_try, stop);
            if stop.is_asked() {
                self.undo(start.as_deref());
                return false;
            }
            let jumped = self.bodies.iter().find_map(|body| {
                let vertex = body.jump?;
                Some(format!("{}: vertex {vertex}", body.name))
            });
            if let Some(jumped) = jumped.filter(|_| !is_last_try) {
                if self.control.shorten() {
                    first = Some(jumped);
                }
            } else if !can_jump || !self.control.refines(self.residual()) {
                let crossed = self.crossed_alone();
                if crossed.is_empty() {
                    break;
                }
                self.keep_apart(&crossed, start.as_deref());
                continue;
            }
            let control = self.control;
            self.undo(start.as_deref());
            self.control = control;
        }
        let stops = |body: &Body| matches!(body.stopped, Some((frame, _)) if frame == self.frame);
        if self.bodies.iter().any(stops) {
            self.control.let_go();
        }
        self.control.end_frame();
        if self.bodies.iter().all(|body| body.jump.is_none()) {
            self.control.note_calm(self.residual());
        }
        let (frame, most) = (self.frame, self.control.most());
        if let Some(vertex) = first {
            self.notes.push(format!(
                "{vertex} jumped in frame {frame}: this frame and others in which a vertex jumps \
                 take up to {most} times as many steps"
            ));
        }
        if self.control.rises_first() {
            self.notes.push(format!(
                "the scene names no `substeps`: from frame {frame} on their number follows the residual"
            ));
        }
        if self.control.has_refined() && !had_refined {
            let why = if self.scene.adapts_steps {
                "the scene names no `substeps`: a residual is above the tolerance"
            } else {
                "a volume is off its target"
            };
            self.notes.push(format!(
                "{why} with {} steps in frame {frame}: this frame and others like it take up to {most} \
                 times as many",
                self.substeps
            ));
        }
        self.watch_reach();
        self.gather();
        true
    }

    /// Goes back to a saved start of the frame.
    pub(super) fn undo(&mut self, start: Option<&[u8]>) {
        let restored = self.restore(&mut Reader::new(start.unwrap_or(&[])));
        debug_assert!(restored.is_ok());
        self.gather();
        self.watch_lone();
    }

    /// The greatest residual of muscles that sweep, relative to the tolerance: that of the volumes that
    /// are kept exactly, and of the elastic constraints if the scene has no number of steps.
    fn residual(&self) -> f64 {
        let tolerance = self.scene.solver.tolerance();
        let of = |body: &Body| {
            let volume = body.volume_residual() / VOLUME_HELD;
            if !self.scene.adapts_steps {
                return volume;
            }
            let elastic = measures::elastic_residual(body) / (tolerance * body.edge_length);
            max_or_nan([volume, elastic])
        };
        let swept = self.bodies.iter().filter(|body| body.can_jump());
        max_or_nan(swept.map(of))
    }

    /// Computes the steps of the next frame; a jump ends them, and stops the body in the last try.
    fn try_frame(&mut self, is_last_try: bool, stop: Stop<'_>) {
        let substeps = self.control.steps();
        for body in &mut self.bodies {
            stop.spend(substeps as usize * body.system.particles.len());
            body.jump = None;
            let (parts, whole) = if self.scene.solver.has_classic_stiffness() {
                (substeps / self.substeps, self.substeps)
            } else {
                (1, substeps)
            };
            body.system.divide(parts);
            let settings = body::settings(&self.scene, body.length, whole);
            let own = &mut body.system.settings;
            own.velocity_factor = settings.velocity_factor;
            own.force_factor = settings.force_factor;
        }
        let of_frame = FrameSteps {
            steps: (0..substeps).map(|s| self.placed_in(s, substeps)).collect(),
            dt: body::time_step(&self.scene, substeps),
            frame: self.frame + 1,
            thickness: self.scene.effects.contact.map_or(0.0, |c| c.thickness),
            is_last_try,
            stop,
        };
        let mut bodies: Vec<Option<&mut Body>> = self.bodies.iter_mut().map(Some).collect();
        let of_group = |group: &together::Group| -> Vec<&mut Body> {
            let members = group.members.iter();
            members.filter_map(|&b| bodies[b].take()).collect()
        };
        let bodies: Vec<Vec<&mut Body>> = self.groups.iter().map(of_group).collect();
        let groups = &mut self.groups;
        // From within the pool, threads that wait cost less than from outside.
        rayon::scope(|_| {
            groups
                .par_iter_mut()
                .zip(bodies)
                .for_each(|(group, mut bodies)| group.compute(&mut bodies, &of_frame));
        });
        for group in &mut self.groups {
            self.certificate.add(&group.take_certificate());
        }
        self.frame = of_frame.frame;
        self.placed = of_frame.steps.into_iter().next_back().unwrap_or_default();
    }

    /// The obstacles in a step of the next frame, which has `steps`.
    pub(super) fn placed_in(&self, step: u32, steps: u32) -> Vec<PosedObstacle> {
        let at = |s: u32| self.frame as f64 + f64::from(s) / f64::from(steps);
        let poses = |bone: usize| (self.pose(bone, at(step)), self.pose(bone, at(step + 1)));
        self.placed
            .iter()
            .enumerate()
            .map(|(o, placed)| {
                let (before, now) = poses(carrier(&self.scene, o));
                PosedObstacle {
                    before,
                    now,
                    ..placed.clone()
                }
            })
            .collect()
    }

    /// Extends the contact of a muscle that leaves the box of the plan.
    fn watch_reach(&mut self) {
        let Some(contact) = self.scene.effects.contact else {
            return;
        };
        for body in &mut self.bodies {
            if body.rest.triangles.is_empty() {
                continue;
            }
            let mut obstacles = body
                .system
                .contacts
                .as_ref()
                .map_or(Vec::new(), |c| c.obstacles().to_vec());
            let bounds =
                Aabb::of_points(&body.system.particles.position).inflate(0.02 * body.length);
            let newly_reached: Vec<usize> = (0..self.placed.len())
                .filter(|o| !obstacles.contains(o))
                .filter(|&o| {
                    let placed = &self.placed[o];
                    placed
                        .obstacle
                        .bounding_box()
                        .transformed(&placed.now)
                        .intersects(&bounds)
                })
                .collect();
            if newly_reached.is_empty() {
                continue;
            }
            for &o in &newly_reached {
                self.notes.push(format!(
                    "{}: left the box that the plan foresaw at frame {} and came near {}; contact with it runs from there",
                    body.name, self.frame, self.placed[o].name
                ));
            }
            obstacles.extend(newly_reached);
            obstacles.sort_unstable();
            let particles = &body.system.particles;
            body.system.contacts = Some(Contacts::new(
                &body.rest,
                particles,
                &self.placed,
                obstacles,
                contact.thickness,
                contact.friction,
            ));
        }
    }
}

/// Whether the computation of a frame is to end: somebody asks for it, or the work is spent. A frame that
/// spends it ends at another place with other threads, but is undone with any.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stop<'a> {
    asked: Option<&'a AtomicBool>,
    done: &'a AtomicU64,
    most: u64,
}

impl<'a> Stop<'a> {
    /// Nothing ends the computation; `done` counts its work.
    pub(super) fn never(done: &'a AtomicU64) -> Self {
        Self {
            asked: None,
            done,
            most: u64::MAX,
        }
    }
}

impl Stop<'_> {
    /// False if nothing can stop the frame.
    pub(super) fn can_come(self) -> bool {
        self.asked.is_some() || self.most < u64::MAX
    }

    pub(super) fn is_asked(self) -> bool {
        let asked = self
            .asked
            .is_some_and(|asked| asked.load(Ordering::Relaxed));
        asked || self.done.load(Ordering::Relaxed) > self.most
    }

    /// Notes steps, times vertices.
    pub(super) fn spend(self, steps: usize) {
        self.done.fetch_add(steps as u64, Ordering::Relaxed);
    }

    /// Notes one trial of a minimisation over this number of vertices.
    pub(super) fn spend_trial(self, vertices: usize) {
        self.spend(OF_TRIAL * vertices);
    }
}

/// The steps of a frame.
pub(super) struct FrameSteps<'a> {
    /// The obstacles in each step.
    pub steps: Vec<Vec<PosedObstacle>>,
    /// Length of a step [s].
    pub dt: f64,
    /// Number of the frame.
    pub frame: usize,
    /// Contact thickness [m].
    pub thickness: f64,
    /// True if the frame is not repeated with shorter steps.
    pub is_last_try: bool,
    /// Ends the frame early.
    pub stop: Stop<'a>,
}

pub(super) fn step_body(body: &mut Body, of: &FrameSteps<'_>) {
    if let Some(equilibrium) = body.equilibrium_mut() {
        equilibrium.begin_frame();
    }
    for (step, placed) in of.steps.iter().enumerate() {
        body.prepare(of, step);
        if let Err(broken) = body.step(placed, of) {
            body.stop(of.frame, broken);
        }
        if body.stops_or_jumps(of, step) || of.stop.is_asked() {
            return;
        }
    }
    body.stop_if_torn(of);
    if body.stopped.is_some() {
        return;
    }
    // An equilibrium ends with contact and volume satisfied.
    let at_rest = !matches!(body.method, Stepper::Sweeps);
    if let Some(last) = of.steps.last().filter(|_| !at_rest) {
        body.system.settle(last, SETTLED * of.thickness);
    }
    body.good.clone_from(&body.system.particles);
}

impl Body {
    /// Greatest error of a volume that is kept exactly, relative to its target; 0 without one.
    pub(super) fn volume_residual(&self) -> f64 {
        let Some(volume) = self.system.volume.as_ref().filter(|v| v.is_exact()) else {
            return 0.0;
        };
        (volume.value(&self.system.particles.position) / volume.target()).abs()
    }

    /// Sets what changes with time in a step: the shortening of fibres, and a volume under pressure.
    pub(super) fn prepare(&mut self, of: &FrameSteps<'_>, step: usize) {
        if let (0, Some(placed)) = (step, of.steps.last()) {
            self.begin_frame(&of.steps[0], placed);
        }
        let x = &self.system.particles.position;
        self.carriage
            .carry(x, &of.steps[step], &mut self.system.carried);
        self.even_out(of, step);
        let done = (step + 1) as f64 / of.steps.len() as f64;
        self.set_to((of.frame - 1) as f64 + done, done, &of.steps[step]);
        self.press(of, step);
    }

    /// Prepares a body that stands still among obstacles at `placed`, as at the end of a frame.
    pub(super) fn prepare_still(&mut self, frame: usize, placed: &[PosedObstacle]) {
        self.begin_frame(placed, placed);
        self.set_to(frame as f64, 1.0, placed);
    }

    /// Begins a frame with obstacles at their poses in its first step and at its end.
    fn begin_frame(&mut self, first: &[PosedObstacle], last: &[PosedObstacle]) {
        let particles = &self.system.particles;
        let (x, w) = (&particles.position, &particles.inverse_mass);
        self.contraction.begin_frame(x, w, last);
        let obstacles = self.system.contacts.as_ref();
        let obstacles = obstacles.map_or(&[][..], |contacts| contacts.obstacles());
        self.ties.begin_frame(x, obstacles, first);
    }

    /// Sets what follows the bones and the time, in frames.
    fn set_to(&mut self, time: f64, done: f64, placed: &[PosedObstacle]) {
        let planes = self.ties.planes(placed);
        if !planes.is_empty() {
            self.each_part(|part| part.place(&planes), |part| part.place(&planes));
        }
        self.shorten(time, done, placed);
    }

    /// Evens out velocities at equal distances in a frame: its implicit step is stable for any length,
    /// and costs more than a sweep.
    fn even_out(&mut self, of: &FrameSteps<'_>, step: usize) {
        let Some(viscosity) = &mut self.viscosity else {
            return;
        };
        let (count, steps) = (VISCOUS_STEPS.min(of.steps.len()), of.steps.len());
        // True for `count` of the steps, the first among them.
        if step * count % steps >= count {
            return;
        }
        let System {
            particles, carried, ..
        } = &mut self.system;
        let dt = of.dt;
        let by = |v: usize| carried.get(v).map_or_else(Vector3::zeros, |by| by / dt);
        viscosity.even_out(particles, by, dt * steps as f64 / count as f64);
    }

    /// In the first frame a volume that sweeps keep goes to its target in equal parts, one a step: in
    /// the time of one short step no solver makes a body twice as large.
    fn press(&mut self, of: &FrameSteps<'_>, step: usize) {
        let is_due = of.frame == 1 && matches!(self.method, Stepper::Sweeps);
        let Some(volume) = self.system.volume.as_mut().filter(|_| is_due) else {
            return;
        };
        let left = (of.steps.len() - 1 - step) as f64 / of.steps.len() as f64;
        volume.set_target(self.target_volume + left * (self.rest_volume - self.target_volume));
    }
}
