//! One step of a body: prediction, sweeps, velocities.

use std::collections::BTreeMap;
use std::time::Instant;

use nalgebra::{Point3, Vector3};

use super::parts::Parts;
use crate::constraints::fascia::FASCIA;
use crate::constraints::{EnclosedVolume, KINDS, Project, Residual};
use crate::contact::{Contacts, PosedObstacle};
use crate::mesh::measures::max_or_nan;
use crate::particles::{Numbering, Packed, Particles, Slot};
use crate::state::{DecodeError, Reader, State, Value, Writer};

/// A particle that a bone carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// The particle.
    pub vertex: u32,
    /// Index of the bone among the placed obstacles.
    pub bone: usize,
    /// Position in the bone's frame [m].
    pub local: Point3<f64>,
}

/// Settings of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSettings {
    /// Number of sweeps per step.
    pub iterations: u32,
    /// Acceleration of all particles [m/s^2].
    pub gravity: Vector3<f64>,
    /// Factor on the velocities at the beginning of each step, 0..1, relative to those with which bones
    /// carry the body along.
    pub velocity_factor: f64,
    /// Factor on the increments by gravity and forces in each step: 1, except in classic PBD, which
    /// damps after them \[mueller2007\].
    pub force_factor: f64,
    /// Limit on velocities [m/s]; clamped velocities are counted.
    pub speed_limit: f64,
}

/// Time and number of calls of each effect.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clock {
    /// Seconds and calls by name of the effect.
    pub effects: BTreeMap<&'static str, (f64, u64)>,
}

impl Clock {
    pub(crate) fn time<T>(&mut self, effect: &'static str, deed: impl FnOnce() -> T) -> T {
        let begin = Instant::now();
        let result = deed();
        self.note(effect, begin);
        result
    }

    /// Records a call that began at `begin`.
    pub(crate) fn note(&mut self, effect: &'static str, begin: Instant) {
        let entry = self.effects.entry(effect).or_default();
        entry.0 += begin.elapsed().as_secs_f64();
        entry.1 += 1;
    }
}

/// A number that is not finite appeared, or a body was torn apart. The body is restored to the
/// state before.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.in_words())]
pub struct Broken {
    /// The first effect with the error; [`DIVERGENCE`] if a body was torn apart.
    pub effect: &'static str,
    /// The first particle with the error.
    pub particle: usize,
}

/// Replaces the effect: connected particles are too far apart for meaningful numbers.
pub const DIVERGENCE: &str = "divergence";

impl Broken {
    fn in_words(&self) -> String {
        let Self { effect, particle } = self;
        match *effect {
            DIVERGENCE => {
                format!("it diverged, particle {particle} was torn away from its neighbours")
            }
            _ => format!("{effect} gave particle {particle} a position that is not finite"),
        }
    }
}

/// Effects on a body other than the kinds of constraints, and their combinations.
const EFFECTS: [&str; 7] = [
    "motion",
    "contact",
    FASCIA,
    "volume",
    "equilibrium",
    "step",
    DIVERGENCE,
];

/// The effect with a name from a file.
pub fn effect_of_name(name: &str) -> Option<&'static str> {
    EFFECTS
        .iter()
        .chain(KINDS)
        .find(|known| **known == name)
        .copied()
}

impl Value for Broken {
    const MIN_BYTES: usize = 16;

    fn encode(&self, to: &mut Writer) {
        let Self { effect, particle } = self;
        to.put(&(*effect).to_owned());
        to.put(particle);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let name: String = from.take()?;
        let effect = effect_of_name(&name).ok_or(from.corrupt("no effect has this name"))?;
        Ok(Self {
            effect,
            particle: from.take()?,
        })
    }
}

/// A body with all effects on it; an absent effect has no entry.
pub struct System {
    /// State of the particles.
    pub particles: Particles,
    /// Batches of constraints, swept in this order.
    pub elastic: Vec<Box<dyn Project>>,
    /// The enclosed volume.
    pub volume: Option<EnclosedVolume>,
    /// Contact with bones.
    pub contacts: Option<Contacts>,
    /// Particles that bones carry.
    pub held: Vec<Held>,
    /// By how far bones carry each particle along in the present step [m]; empty: not at all.
    pub carried: Vec<Vector3<f64>>,
    /// Constant forces [N].
    pub forces: Vec<(u32, Vector3<f64>)>,
    /// Settings of a step.
    pub settings: StepSettings,
    /// Time of each effect.
    pub clock: Clock,
    /// Number of clamped velocities so far.
    pub speed_cuts: u64,
    packed: Packed,
    parts: Parts,
    start: Vec<Point3<f64>>,
    start_velocity: Vec<Vector3<f64>>,
    last_dt: f64,
}

impl System {
    /// Creates a body without effects.
    pub fn new(particles: Particles, settings: StepSettings) -> Self {
        Self {
            start: particles.position.clone(),
            start_velocity: particles.velocity.clone(),
            particles,
            packed: Packed::default(),
            parts: Parts::default(),
            elastic: Vec::new(),
            volume: None,
            contacts: None,
            held: Vec::new(),
            carried: Vec::new(),
            forces: Vec::new(),
            settings,
            clock: Clock::default(),
            speed_cuts: 0,
            last_dt: 0.0,
        }
    }

    /// Stores particles in the order of `numbering` during the sweeps; the constraints must be made
    /// for it.
    #[must_use]
    pub fn with_numbering(mut self, numbering: Numbering) -> Self {
        self.packed = Packed::new(numbering);
        self
    }

    /// Makes a step of `dt` [s] while the bones move from `before` to `now`. A step of length 0
    /// leaves every bit unchanged.
    ///
    /// # Errors
    /// A number that is not finite appeared; the state is that of the beginning of the step.
    ///
    /// # Panics
    /// If `dt` is negative or not finite: the caller must check its settings.
    pub fn step(&mut self, placed: &[PosedObstacle], dt: f64) -> Result<(), Broken> {
        self.step_unless(placed, dt, &|| false)
    }

    /// The same as [`Self::step`], but ends after a sweep for which `is_stopped` is true; the state is
    /// then of no use.
    pub(crate) fn step_unless(
        &mut self,
        placed: &[PosedObstacle],
        dt: f64,
        is_stopped: &dyn Fn() -> bool,
    ) -> Result<(), Broken> {
        assert!(
            dt >= 0.0 && dt.is_finite(),
            "a step takes a finite time, not {dt} s"
        );
        if dt == 0.0 {
            return Ok(());
        }
        self.keep_start(dt);
        self.advance(placed, dt, (false, is_stopped))?;
        if self.particles.first_non_finite().is_none() {
            return Ok(());
        }
        // Repeats the step and tests after each effect, to name the cause.
        self.back_to_start();
        let found = self.advance(placed, dt, (true, is_stopped));
        self.back_to_start();
        found.and(Err(Broken {
            effect: "step",
            particle: 0,
        }))
    }

    /// From now on a step is made in `count` parts, each by a call of [`Self::step`] with its share of
    /// the time. Classic stiffness is divided among them.
    pub(crate) fn divide(&mut self, count: u32) {
        self.parts.divide(count);
        self.elastic
            .iter_mut()
            .for_each(|batch| batch.divide(count));
        if let Some(volume) = &mut self.volume {
            volume.divide(count);
        }
    }

    /// Stores the state at the beginning of a step of `dt` [s].
    fn keep_start(&mut self, dt: f64) {
        self.last_dt = dt;
        self.parts.keep();
        self.start.clone_from(&self.particles.position);
        self.start_velocity.clone_from(&self.particles.velocity);
    }

    /// Greatest way of a particle in the present step [m].
    pub(crate) fn longest_way(&self) -> f64 {
        let ways = self.particles.position.iter().zip(&self.start);
        max_or_nan(ways.map(|(x, start)| (x - start).norm_squared())).sqrt()
    }

    /// Takes the step back.
    pub(crate) fn back_to_start(&mut self) {
        self.parts.back();
        self.particles.position.clone_from(&self.start);
        self.particles.velocity.clone_from(&self.start_velocity);
    }

    fn advance(
        &mut self,
        placed: &[PosedObstacle],
        dt: f64,
        (watch, is_stopped): (bool, &dyn Fn() -> bool),
    ) -> Result<(), Broken> {
        self.predict(placed, dt);
        self.watch("motion", watch)?;
        self.begin_sweeps();
        for _ in 0..self.settings.iterations {
            if is_stopped() {
                return Ok(());
            }
            self.sweep(placed, dt, watch)?;
            self.project_volume(dt, &[], &[]);
            self.watch("volume", watch)?;
        }
        self.end_sweeps(placed, dt);
        Ok(())
    }

    fn begin_sweeps(&mut self) {
        self.elastic.iter_mut().for_each(|batch| batch.begin_step());
        if let Some(volume) = &mut self.volume {
            volume.begin_step();
        }
        if let Some(contacts) = &mut self.contacts {
            contacts.begin_step(&self.start);
        }
    }

    /// Takes the velocities, and ends a step of `dt` [s].
    fn end_sweeps(&mut self, placed: &[PosedObstacle], dt: f64) {
        self.take_velocities(dt);
        if let Some(contacts) = &mut self.contacts {
            self.clock.time("contact", || {
                contacts.end_step(placed, &mut self.particles, dt)
            });
        }
        self.limit_speed();
    }

    /// Begins a step of `dt` [s] whose sweeps [`Self::sweep_alone`], [`Self::project_volume`] and
    /// [`Self::end_alone`] continue, so that several bodies go through it together.
    pub(crate) fn begin_alone(&mut self, placed: &[PosedObstacle], dt: f64) {
        self.keep_start(dt);
        self.predict(placed, dt);
        self.begin_sweeps();
    }

    /// The elastic constraints, and contact of vertices with bones.
    pub(crate) fn sweep_alone(&mut self, placed: &[PosedObstacle], dt: f64) {
        // Without the tests for numbers that are not finite, no error occurs.
        let _ = self.sweep(placed, dt, false);
    }

    /// Ends a step that was begun with [`Self::begin_alone`].
    pub(crate) fn end_alone(&mut self, placed: &[PosedObstacle], dt: f64) {
        self.end_sweeps(placed, dt);
    }

    fn sweep(&mut self, placed: &[PosedObstacle], dt: f64, watch: bool) -> Result<(), Broken> {
        let last = self.elastic.len().wrapping_sub(1);
        for (k, batch) in self.elastic.iter_mut().enumerate() {
            let name = batch.name();
            self.clock.time(name, || {
                // Packed once for all batches: only the first reads, only the last writes.
                if k == 0 {
                    self.packed.read(&self.particles);
                }
                batch.project_packed(&mut self.packed, dt);
                if k == last || watch {
                    self.packed.write(&mut self.particles);
                }
            });
            watch_positions(&self.particles, name, watch)?;
        }
        if let Some(contacts) = &mut self.contacts {
            self.clock
                .time("contact", || contacts.project(placed, &mut self.particles));
            self.watch("contact", watch)?;
        }
        Ok(())
    }

    /// Projects the volume last and excludes vertices in contact, so that a step ends with both
    /// satisfied. Vertices of `blocked` do not move against their directions, those of `frozen` not at all.
    pub(crate) fn project_volume(
        &mut self,
        dt: f64,
        blocked: &[(u32, Vector3<f64>)],
        frozen: &[u32],
    ) {
        let Some(volume) = &mut self.volume else {
            return;
        };
        let barred = self
            .contacts
            .as_ref()
            .map(|contacts| contacts.barred(&self.particles.position, blocked));
        let restrict = |field: &mut [Slot], sign: f64| {
            if let Some(barred) = &barred {
                barred.restrict(field, sign);
            }
            frozen
                .iter()
                .for_each(|&v| field[v as usize] = Slot::default());
        };
        // Without a solution the volume is unchanged; the measures show it, and `unsolved` counts
        // it.
        let _ = self.clock.time("volume", || {
            volume.project_along(&mut self.particles, dt, restrict)
        });
        if let Some(contacts) = &mut self.contacts {
            contacts.bear(|vertex| volume.withheld(vertex));
        }
    }

    /// What was taken from the displacement of `vertex` in the last projection of the volume [m].
    pub(crate) fn withheld(&self, vertex: u32) -> Vector3<f64> {
        let volume = self.volume.as_ref();
        volume.map_or_else(Vector3::zeros, |volume| volume.withheld(vertex))
    }

    fn predict(&mut self, placed: &[PosedObstacle], dt: f64) {
        let StepSettings {
            gravity,
            velocity_factor,
            force_factor,
            ..
        } = self.settings;
        let (particles, parts) = (&mut self.particles, &mut self.parts);
        if parts.begins() {
            let velocities = particles.velocity.iter_mut();
            if self.carried.is_empty() {
                velocities.for_each(|v| *v *= velocity_factor);
            } else {
                let each = velocities.zip(&self.carried);
                each.for_each(|(v, by)| *v = damped(v, by, velocity_factor, dt));
            }
            let pull = parts.whole(dt) * force_factor;
            for &(vertex, force) in &self.forces {
                particles.velocity[vertex as usize] +=
                    force * (particles.inverse_mass[vertex as usize] * pull);
            }
            let free = particles.velocity.iter_mut().zip(&particles.inverse_mass);
            free.filter(|(_, w)| **w > 0.0)
                .for_each(|(v, _)| *v += gravity * pull);
            parts.begin(particles);
        } else {
            parts.predict(particles);
        }
        for ((x, v), w) in particles
            .position
            .iter_mut()
            .zip(&particles.velocity)
            .zip(&particles.inverse_mass)
        {
            if *w > 0.0 {
                *x += *v * dt;
            }
        }
        for held in &self.held {
            particles.position[held.vertex as usize] = placed[held.bone].now * held.local;
        }
    }

    /// Where inertia takes each particle in a step of `dt` [s] without forces [m].
    pub(crate) fn coasting(&self, dt: f64) -> impl Iterator<Item = Point3<f64>> {
        let factor = self.settings.velocity_factor;
        let each = self.particles.position.iter().zip(&self.particles.velocity);
        each.enumerate()
            .map(move |(i, (x, v))| match self.carried.get(i) {
                Some(by) => x + damped(v, by, factor, dt) * dt,
                None => x + v * (factor * dt),
            })
    }

    fn take_velocities(&mut self, dt: f64) {
        let (particles, parts) = (&mut self.particles, &mut self.parts);
        let (start, time) = parts.end(&self.start, dt);
        for ((v, x), start) in particles
            .velocity
            .iter_mut()
            .zip(&particles.position)
            .zip(start)
        {
            *v = (x - start) / time;
        }
    }

    fn limit_speed(&mut self) {
        let limit = self.settings.speed_limit;
        for v in &mut self.particles.velocity {
            let speed = v.norm();
            if speed > limit {
                *v *= limit / speed;
                self.speed_cuts += 1;
            }
        }
    }

    fn watch(&self, effect: &'static str, watch: bool) -> Result<(), Broken> {
        watch_positions(&self.particles, effect, watch)
    }

    /// After the last step of a frame: repeats contact and volume, with new queries, until both are
    /// satisfied.
    pub fn settle(&mut self, placed: &[PosedObstacle], depth: f64) {
        let still: Vec<PosedObstacle> = placed
            .iter()
            .map(|p| PosedObstacle {
                before: p.now,
                ..p.clone()
            })
            .collect();
        let dt = self.last_dt;
        for _ in 0..8 {
            if self.contacts.is_none() {
                return;
            }
            self.settle_contact(&still);
            self.project_volume(dt, &[], &[]);
            if self.is_settled(&still, depth) {
                return;
            }
        }
    }

    /// After the last step of a frame, for bodies that step together: contact of vertices with bones
    /// once more.
    pub(crate) fn settle_contact(&mut self, still: &[PosedObstacle]) {
        self.start.clone_from(&self.particles.position);
        if let Some(contacts) = &mut self.contacts {
            contacts.begin_step(&self.start);
            self.clock
                .time("contact", || contacts.project(still, &mut self.particles));
        }
    }

    /// Ends a round of [`Self::settle_contact`]. True if no vertex is deeper than `depth` [m] in a bone.
    pub(crate) fn is_settled(&mut self, still: &[PosedObstacle], depth: f64) -> bool {
        let Some(contacts) = &mut self.contacts else {
            return true;
        };
        let mut copy = Particles::at_rest(
            self.particles.position.clone(),
            self.particles.inverse_mass.clone(),
        );
        contacts.end_step(still, &mut copy, self.last_dt.max(f64::MIN_POSITIVE));
        contacts.is_clear(still, &self.particles.position, depth)
    }

    /// Residual of each effect after the last step.
    pub fn residuals(&self) -> Vec<(&'static str, Residual)> {
        let dt = self.last_dt;
        let mut all: Vec<_> = self
            .elastic
            .iter()
            .map(|b| (b.name(), b.residual(&self.particles, dt)))
            .collect();
        if let Some(volume) = &self.volume {
            all.push(("volume", volume.residual(&self.particles, dt)));
        }
        all
    }

    /// Greatest residual [m] of the constraints of each kind on a particle after the last step;
    /// empty before the first step.
    pub fn residuals_at(&self, particle: u32) -> Vec<(&'static str, f64)> {
        let dt = self.last_dt;
        if !(dt > 0.0) {
            return Vec::new();
        }
        let each = self
            .elastic
            .iter()
            .map(|b| (b.name(), b.residual_at(&self.particles, dt, particle)));
        each.filter_map(|(name, off)| Some((name, off?))).collect()
    }
}

/// A velocity [m/s] at the beginning of a step of `dt` [s] in which bones carry the particle by `by` [m].
fn damped(v: &Vector3<f64>, by: &Vector3<f64>, factor: f64, dt: f64) -> Vector3<f64> {
    let along = by / dt;
    along + (v - along) * factor
}

/// Without contact, whose obstacles belong to the whole simulation.
impl State for System {
    fn save(&self, to: &mut Writer) {
        let Self {
            particles,
            elastic,
            volume,
            contacts: _,
            held: _,
            // Of the present step.
            carried: _,
            forces: _,
            settings: _,
            // Times are no part of the results.
            clock: _,
            speed_cuts,
            packed: _,
            // A frame begins with a whole step.
            parts: _,
            start: _,
            start_velocity: _,
            last_dt,
        } = self;
        particles.save(to);
        elastic.iter().for_each(|batch| batch.save(to));
        volume.iter().for_each(|volume| volume.save(to));
        to.put(speed_cuts);
        to.put(last_dt);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        self.particles.restore(from)?;
        self.elastic
            .iter_mut()
            .try_for_each(|batch| batch.restore(from))?;
        self.volume
            .iter_mut()
            .try_for_each(|volume| volume.restore(from))?;
        self.speed_cuts = from.take()?;
        self.last_dt = from.take()?;
        Ok(())
    }
}

/// Names the effect after which a position is not finite, if `watch` is set.
fn watch_positions(particles: &Particles, effect: &'static str, watch: bool) -> Result<(), Broken> {
    if !watch {
        return Ok(());
    }
    let finite = |x: &Point3<f64>| x.coords.iter().all(|c| c.is_finite());
    match particles.position.iter().position(|x| !finite(x)) {
        Some(particle) => Err(Broken { effect, particle }),
        None => Ok(()),
    }
}
