//! The thread of a session: obeys commands between frames, computes frames, publishes.

use std::collections::{BTreeMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use nalgebra::{Isometry3, Point3};

use super::super::recipe::{Recipe, Refused, StartError};
use super::super::snapshot::{BoneShot, MuscleShot, Snapshot, Stage, Steering};
use super::{Command, Pace, Speed};
use crate::scene::{Joint, Key, Motion, Scene};
use crate::simulation::{Assets, Plan, Simulation};

/// A hand turns a bone by at most this a frame [rad]: about as fast as the built-in hip turns, times three. Bones that jump
/// tear muscles.
pub const MOST_TURN: f64 = 0.03;

/// The hand's spring, over the stiffness of the muscle's surface.
const DRAG: f64 = 3.0;

/// Frames over which their rate is taken.
const RATED: usize = 30;

/// A bone that is turned by hand.
#[derive(Clone, Copy, Debug)]
struct Hand {
    /// The angle [rad], and the one that is wanted.
    angle: f64,
    wanted: f64,
    /// What its motion did beside turning: pose = turn(angle) offset.
    offset: Isometry3<f64>,
}

pub(super) struct Worker {
    recipe: Recipe,
    scene: Arc<Scene>,
    assets: Assets,
    simulation: Simulation,
    step: fn(&mut Simulation),
    steering: Vec<Steering>,
    hands: Vec<Option<Hand>>,
    fixed: Vec<Vec<u32>>,
    drags: Vec<Option<(u32, Point3<f64>, f64)>>,
    pace: Pace,
    serial: u64,
    answered: u64,
    refused: Option<(u64, String)>,
    failed: Option<String>,
    /// Seconds of each effect up to the last frame, and in it.
    clock: BTreeMap<&'static str, f64>,
    effects: Vec<(&'static str, f64)>,
    frame_ms: f64,
    ends: VecDeque<Instant>,
    /// When the next frame is due.
    due: Instant,
}

impl Worker {
    pub(super) fn new(recipe: Recipe, pace: Pace, step: fn(&mut Simulation)) -> Result<Self, StartError> {
        let scene = recipe.scene()?;
        let assets = Assets::load(&scene)?;
        let plan = Plan::new(&scene, &assets);
        let simulation = Simulation::with(scene.clone(), assets.clone(), plan)?;
        Ok(Self {
            steering: vec![Steering::Motion; scene.bones.len()],
            hands: vec![None; scene.bones.len()],
            fixed: vec![Vec::new(); scene.muscles.len()],
            drags: vec![None; scene.muscles.len()],
            scene: Arc::new(scene),
            recipe,
            assets,
            simulation,
            step,
            pace,
            serial: 0,
            answered: 0,
            refused: None,
            failed: None,
            clock: BTreeMap::new(),
            effects: Vec::new(),
            frame_ms: 0.0,
            ends: VecDeque::new(),
            due: Instant::now(),
        })
    }

    pub(super) fn stage(&self) -> Stage {
        Stage::of(&self.simulation)
    }

    /// Until nobody can send commands any more.
    pub(super) fn run(mut self, commands: &Receiver<(u64, Command)>, publish: impl Fn(Snapshot)) {
        loop {
            let first = if self.pace.running {
                match commands.recv_timeout(self.due.saturating_duration_since(Instant::now())) {
                    Ok(command) => Some(command),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => return,
                }
            } else {
                match commands.recv() {
                    Ok(command) => Some(command),
                    Err(_) => return,
                }
            };
            let batch: Vec<_> = first.into_iter().chain(commands.try_iter()).collect();
            if !batch.is_empty() {
                self.obey_all(&batch);
                publish(self.snapshot());
            }
            // Also after commands, so that a hand that never rests does not hold up the frames.
            if self.pace.running && Instant::now() >= self.due {
                self.advance();
                publish(self.snapshot());
            }
        }
    }

    fn obey_all(&mut self, batch: &[(u64, Command)]) {
        for (k, (number, command)) in batch.iter().enumerate() {
            // Of a slider that moved while a frame was computed only the last place counts.
            let next = batch.get(k + 1).map(|(_, next)| next);
            let is_overtaken = match (command, next) {
                (Command::Set { path, .. }, Some(Command::Set { path: later, .. })) => path == later,
                _ => false,
            };
            if !is_overtaken && let Err(refused) = self.obey(command) {
                self.refused = Some((*number, refused.to_string()));
            }
            self.answered = *number;
        }
    }

    fn obey(&mut self, command: &Command) -> Result<(), Refused> {
        match command {
            Command::Pause => self.pace.running = false,
            Command::Run => {
                self.check_sound()?;
                (self.pace.running, self.due) = (true, Instant::now());
            }
            Command::Step => {
                self.check_sound()?;
                self.pace.running = false;
                self.advance();
            }
            Command::Reset => return self.reset(),
            Command::Speed(speed) => {
                if let Speed::Share(share) = *speed {
                    check_number("the speed", share, true)?;
                }
                (self.pace.speed, self.due) = (*speed, Instant::now());
            }
            Command::Set { path, value } => return self.change(path, self.recipe.with(path, value)),
            Command::Restore { path } => return self.change(path, self.recipe.without(path)),
            Command::Turn { bone, angle } => return self.turn(*bone, *angle),
            Command::Hold { bone } => {
                check_index("bone", *bone, self.hands.len())?;
                let pose = self.simulation.pose(*bone, self.simulation.frame() as f64);
                let now = self.scene.bones[*bone].motion.joint.as_ref().map_or(0.0, |joint| angle(joint, &pose));
                return self.turn(*bone, now);
            }
            Command::ByMotion { bone } => {
                check_index("bone", *bone, self.hands.len())?;
                if self.hands[*bone].take().is_some() {
                    self.steering[*bone] = Steering::Return;
                }
            }
            Command::Drag { muscle, vertex, to, stiffness } => return self.drag(*muscle, *vertex, *to, *stiffness),
            Command::LetGo { muscle } => {
                check_index("muscle", *muscle, self.drags.len())?;
                self.drags[*muscle] = None;
                self.simulation.let_go(*muscle);
            }
            Command::Fix { muscle, vertex } => return self.fix(*muscle, *vertex),
            Command::Free { muscle, vertex } => {
                self.vertex(*muscle, *vertex)?;
                let mut fixed = self.fixed.clone();
                fixed[*muscle].retain(|v| *v as usize != *vertex);
                return self.hold(fixed);
            }
        }
        Ok(())
    }

    fn check_sound(&self) -> Result<(), Refused> {
        self.failed.clone().map_or(Ok(()), |why| Err(Refused::Failed(why)))
    }

    fn vertex(&self, muscle: usize, vertex: usize) -> Result<u32, Refused> {
        check_index("muscle", muscle, self.simulation.bodies.len())?;
        check_index("vertex", vertex, self.simulation.bodies[muscle].system.particles.len())?;
        Ok(vertex as u32)
    }

    fn reset(&mut self) -> Result<(), Refused> {
        let none = vec![Vec::new(); self.fixed.len()];
        self.simulation = self.made(&self.scene, &none, false)?;
        self.fixed = none;
        self.drags.fill(None);
        self.hands.fill(None);
        self.steering.fill(Steering::Motion);
        self.failed = None;
        self.forget_times();
        self.effects.clear();
        (self.frame_ms, self.due) = (0.0, Instant::now());
        self.ends.clear();
        Ok(())
    }

    fn forget_times(&mut self) {
        self.clock = seconds(&self.simulation);
    }

    /// A simulation of a scene with the meshes at hand, at its start; one that `goes_on` keeps the muscles' shapes at rest.
    fn made(&self, scene: &Scene, fixed: &[Vec<u32>], goes_on: bool) -> Result<Simulation, Refused> {
        let make = || {
            let mut plan = Plan::new(scene, &self.assets);
            plan.muscles.iter_mut().zip(fixed).for_each(|(plan, fixed)| plan.fixed.clone_from(fixed));
            if goes_on {
                let bodies = self.simulation.bodies.iter();
                let rests = bodies.map(|body| Some(Arc::new(body.rest.clone())));
                plan.muscles.iter_mut().zip(rests).for_each(|(plan, rest)| plan.rest = rest);
            }
            Simulation::with(scene.clone(), self.assets.clone(), plan)
        };
        catch_unwind(AssertUnwindSafe(make)).map_err(|panic| Refused::Panicked(words(&*panic)))?.map_err(Refused::Load)
    }

    /// Goes on with other numbers.
    fn change(&mut self, path: &str, recipe: Recipe) -> Result<(), Refused> {
        self.check_sound()?;
        let scene = recipe.checked(path, &self.scene, &self.assets)?;
        self.go_on_as(&scene, self.fixed.clone())?;
        (self.recipe, self.scene) = (recipe, Arc::new(scene));
        Ok(())
    }

    /// Goes on with other vertices fixed.
    fn hold(&mut self, fixed: Vec<Vec<u32>>) -> Result<(), Refused> {
        self.check_sound()?;
        let scene = self.scene.clone();
        self.go_on_as(&scene, fixed)
    }

    fn go_on_as(&mut self, scene: &Scene, fixed: Vec<Vec<u32>>) -> Result<(), Refused> {
        let mut simulation = self.made(scene, &fixed, true)?;
        for (bone, steering) in self.steering.iter().enumerate() {
            if *steering != Steering::Motion {
                let pose = self.simulation.pose(bone, self.simulation.frame() as f64);
                let joint = simulation.scene.bones[bone].motion.joint.take();
                let key = Key { frame: self.simulation.frame() as f64, pose };
                simulation.scene.bones[bone].motion = Motion { keys: vec![key], joint };
            }
        }
        simulation.continue_from(&self.simulation);
        for (muscle, drag) in self.drags.iter().enumerate() {
            if let Some((vertex, to, stiffness)) = *drag {
                simulation.drag(muscle, vertex, to, stiffness);
            }
        }
        self.simulation = simulation;
        self.fixed = fixed;
        self.forget_times();
        Ok(())
    }

    fn drag(&mut self, muscle: usize, vertex: usize, to: Point3<f64>, stiffness: Option<f64>) -> Result<(), Refused> {
        let v = self.vertex(muscle, vertex)?;
        let body = &self.simulation.bodies[muscle];
        if body.attached.iter().any(|(held, _)| *held == v) {
            return Err(Refused::Held { vertex });
        }
        to.iter().try_for_each(|c| check_number("a coordinate of the place to drag to", *c, false))?;
        // A surface without stiffness of its own is dragged by its weight in a second.
        let surface = match self.scene.muscles[muscle].material.stretch {
            stretch if stretch > 0.0 => DRAG * stretch,
            _ => DRAG / body.system.particles.inverse_mass[vertex].max(f64::MIN_POSITIVE),
        };
        let stiffness = stiffness.unwrap_or(surface);
        check_number("the stiffness of the spring", stiffness, true)?;
        self.drags[muscle] = Some((v, to, stiffness));
        self.simulation.drag(muscle, v, to, stiffness);
        Ok(())
    }

    fn fix(&mut self, muscle: usize, vertex: usize) -> Result<(), Refused> {
        let v = self.vertex(muscle, vertex)?;
        if self.simulation.bodies[muscle].attached.iter().any(|(held, _)| *held == v) {
            return Err(Refused::Held { vertex });
        }
        let mut fixed = self.fixed.clone();
        if !fixed[muscle].contains(&v) {
            fixed[muscle].push(v);
        }
        self.hold(fixed)
    }

    fn turn(&mut self, bone: usize, wanted: f64) -> Result<(), Refused> {
        check_index("bone", bone, self.hands.len())?;
        check_number("an angle", wanted, false)?;
        let frame = self.simulation.frame() as f64;
        let pose = self.simulation.pose(bone, frame);
        let scene = &self.scene.bones[bone];
        let Some(joint) = &scene.motion.joint else {
            return Err(Refused::NoJoint { bone: scene.name.clone() });
        };
        match &mut self.hands[bone] {
            Some(hand) => hand.wanted = wanted,
            none => {
                let angle = angle(joint, &pose);
                *none = Some(Hand { angle, wanted, offset: joint.pose(angle).inverse() * pose });
                self.steering[bone] = Steering::Hand;
                self.simulation.move_bone(bone, pose);
            }
        }
        Ok(())
    }

    /// Moves what the hand moves; what it does not touch keeps its motion to the bit.
    fn steer_bones(&mut self) {
        let frame = self.simulation.frame() as f64;
        for bone in 0..self.steering.len() {
            let motion = &self.scene.bones[bone].motion;
            match (self.steering[bone], &mut self.hands[bone], &motion.joint) {
                (Steering::Hand, Some(hand), Some(joint)) if hand.angle != hand.wanted => {
                    let left = hand.wanted - hand.angle;
                    hand.angle =
                        if left.abs() <= MOST_TURN { hand.wanted } else { hand.angle + MOST_TURN.copysign(left) };
                    self.simulation.move_bone(bone, joint.pose(hand.angle) * hand.offset);
                }
                (Steering::Return, ..) => {
                    let (now, there) = (self.simulation.pose(bone, frame), motion.pose(frame + 1.0));
                    if now == motion.pose(frame) {
                        self.steering[bone] = Steering::Motion;
                        self.simulation.scene.bones[bone].motion = motion.clone();
                        continue;
                    }
                    let turn = (now.inverse() * there).rotation.angle();
                    let keys = vec![Key { frame: 0.0, pose: now }, Key { frame: 1.0, pose: there }];
                    let share = if turn > MOST_TURN { MOST_TURN / turn } else { 1.0 };
                    self.simulation.move_bone(bone, Motion { keys, joint: None }.pose(share));
                }
                _ => {}
            }
        }
    }

    fn advance(&mut self) {
        if self.failed.is_some() {
            return;
        }
        let begun = Instant::now();
        self.steer_bones();
        let (step, simulation) = (self.step, &mut self.simulation);
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| step(simulation))) {
            let why = format!("frame {}: the simulation panicked: {}", self.simulation.frame() + 1, words(&*panic));
            self.failed = Some(why);
            self.pace.running = false;
            return;
        }
        let ended = Instant::now();
        self.frame_ms = (ended - begun).as_secs_f64() * 1e3;
        let now = seconds(&self.simulation);
        let spent = |(name, s): (&&'static str, &f64)| (*name, (s - self.clock.get(name).unwrap_or(&0.0)) * 1e3);
        self.effects = now.iter().map(spent).collect();
        self.clock = now;
        self.ends.push_back(ended);
        if self.ends.len() > RATED {
            self.ends.pop_front();
        }
        let period = match self.pace.speed {
            Speed::Share(share) => Duration::try_from_secs_f64(1.0 / (self.scene.frame_rate * share)),
            Speed::Free => Ok(Duration::ZERO),
        };
        // What is late is not made up for.
        self.due = (self.due + period.unwrap_or(Duration::from_secs(3600)).min(Duration::from_secs(3600))).max(ended);
        if self.simulation.bodies.iter().all(|body| body.stopped.is_some()) {
            self.pace.running = false;
        }
    }

    pub(super) fn snapshot(&mut self) -> Snapshot {
        self.serial += 1;
        let simulation = &self.simulation;
        let mut muscles: Vec<MuscleShot> =
            (0..simulation.bodies.len()).map(|m| MuscleShot::of(simulation, m)).collect();
        for (shot, drag) in muscles.iter_mut().zip(&self.drags) {
            shot.dragged = drag.map(|(vertex, to, _)| (vertex, to));
        }
        let frame = simulation.frame();
        let bone = |b: usize| {
            let pose = simulation.pose(b, frame as f64);
            let angle = self.scene.bones[b].motion.joint.as_ref().map(|joint| angle(joint, &pose));
            BoneShot { pose, angle, steering: self.steering[b] }
        };
        let rate = match (self.ends.front(), self.ends.back()) {
            (Some(first), Some(last)) if last > first => (self.ends.len() - 1) as f64 / (*last - *first).as_secs_f64(),
            _ => 0.0,
        };
        Snapshot {
            serial: self.serial,
            answered: self.answered,
            frame,
            running: self.pace.running,
            refused: self.refused.clone(),
            failed: self.failed.clone(),
            scene: self.scene.clone(),
            muscles,
            bones: (0..self.scene.bones.len()).map(bone).collect(),
            effects: self.effects.clone(),
            frame_ms: self.frame_ms,
            frames_per_second: rate,
            notes: simulation.notes.clone(),
        }
    }
}

/// Seconds of each effect so far, over all muscles.
fn seconds(simulation: &Simulation) -> BTreeMap<&'static str, f64> {
    let mut all = BTreeMap::new();
    for (name, (s, _)) in simulation.bodies.iter().flat_map(|body| &body.system.clock.effects) {
        *all.entry(*name).or_insert(0.0) += s;
    }
    all
}

/// The angle [rad] of a pose about the axis of a joint, in -pi..pi.
fn angle(joint: &Joint, pose: &Isometry3<f64>) -> f64 {
    let q = pose.rotation.quaternion();
    // Of the two quaternions of a rotation, the one of the shorter way.
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    2.0 * libm::atan2(sign * q.imag().dot(&joint.axis), sign * q.w)
}

fn check_index(what: &'static str, index: usize, count: usize) -> Result<(), Refused> {
    if index < count { Ok(()) } else { Err(Refused::Nothing { what, index, count }) }
}

fn check_number(what: &'static str, value: f64, positive: bool) -> Result<(), Refused> {
    let does = value.is_finite() && (value > 0.0 || !positive);
    if does { Ok(()) } else { Err(Refused::Number { what, value, positive }) }
}

/// What a panic says.
fn words(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
    text.unwrap_or("it gave no reason").to_owned()
}
