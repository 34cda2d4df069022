//! What solvers of equilibrium share: energy and forces at a place, when to stop, and the search along a direction.

use nalgebra::{Point3, Vector3};

use super::energy::Energy;
use super::history::{Field, add_scaled, dot};
use super::unknowns::Unknowns;
use crate::constraints::EnclosedVolume;
use crate::contact::Row;
use crate::state::{Corrupt, Reader, Value, Writer};

/// Share of the decrease that the slope promises which a step must bring.
const SUFFICIENT: f64 = 1e-4;

/// Halvings of a step before the search gives up.
const HALVINGS: u32 = 30;

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Root mean square of the force left on free vertices, as a share of that which a strain of one exerts.
    pub tolerance: f64,
    /// Iterations at most.
    pub iterations: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self { tolerance: 1e-4, iterations: 500 }
    }
}

/// How a solution ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Iterations done.
    pub iterations: u32,
    /// Times that energy and gradient were computed.
    pub evaluations: u32,
    /// Root mean square of the force left on free vertices [N].
    pub force: f64,
    /// The same as a share of what a strain of one exerts.
    pub residual: f64,
    /// Energy [J].
    pub energy: f64,
    /// Pressure inside [Pa]; 0 where no volume is kept.
    pub pressure: f64,
    /// Whether the residual is within its tolerance.
    pub converged: bool,
}

impl Value for Outcome {
    const LEAST: usize = 4 + 4 + 4 * 8 + 1;

    fn put(&self, to: &mut Writer) {
        let Self { iterations, evaluations, force, residual, energy, pressure, converged } = self;
        to.put(&(*iterations, *evaluations));
        to.put(&((*force, *residual), (*energy, *pressure)));
        to.put(converged);
    }

    fn take(from: &mut Reader<'_>) -> Result<Self, Corrupt> {
        let (iterations, evaluations) = from.take()?;
        let ((force, residual), (energy, pressure)) = from.take()?;
        Ok(Self { iterations, evaluations, force, residual, energy, pressure, converged: from.take()? })
    }
}

/// What keeps vertices out of obstacles while they move.
pub trait Guard {
    /// The planes that vertices near an obstacle must stay over.
    fn rows(&self) -> Vec<Row>;
    /// Room at which a vertex counts as touching [m].
    fn touching(&self) -> f64;
    /// Puts vertices that went from `start` into an obstacle back onto its surface.
    fn push(&mut self, start: &[Point3<f64>], x: &mut [Point3<f64>]);
    /// The last push is where the body stays.
    fn accept(&mut self, x: &[Point3<f64>]);
}

/// No obstacles.
pub struct Unguarded;

impl Guard for Unguarded {
    fn rows(&self) -> Vec<Row> {
        Vec::new()
    }
    fn touching(&self) -> f64 {
        0.0
    }
    fn push(&mut self, _: &[Point3<f64>], _: &mut [Point3<f64>]) {}
    fn accept(&mut self, _: &[Point3<f64>]) {}
}

/// Energy, gradient and volume at one place.
pub(super) struct State {
    pub energy: f64,
    /// Sum of the energy's terms without their signs [J]: its rounding is a share of this.
    pub magnitude: f64,
    pub gradient: Field,
    /// Gradient of the volume; empty where none is kept.
    pub area: Field,
    /// V less its target [m^3].
    pub excess: f64,
}

/// A body's energy, which of its vertices are unknown, and when it counts as at rest.
pub struct Problem {
    /// The energy.
    pub energy: Energy,
    /// When to stop.
    pub settings: Settings,
    pub(super) unknowns: Unknowns,
    pub(super) force_scale: f64,
}

impl Problem {
    /// The problem of a body that rests at `x`; vertices without inverse mass are held.
    pub fn new(energy: Energy, x: &[Point3<f64>], inverse_mass: &[f64], settings: Settings) -> Self {
        let force_scale = energy.force_scale(x);
        Self { energy, settings, unknowns: Unknowns::new(inverse_mass), force_scale }
    }

    /// The force [N] on a vertex that residuals are measured by.
    pub fn force_scale(&self) -> f64 {
        self.force_scale
    }

    pub(super) fn state(&self, x: &[Point3<f64>]) -> State {
        let mut gradient = vec![Vector3::zeros(); x.len()];
        let energy = self.energy.value_and_gradient(x, &mut gradient);
        self.unknowns.release_held(&mut gradient);
        let (excess, mut area) =
            self.energy.volume.as_ref().map_or((0.0, Vec::new()), |volume| volume.value_and_gradient(x));
        if !area.is_empty() {
            self.unknowns.release_held(&mut area);
        }
        let magnitude = energy + 2.0 * self.energy.negative_terms(x) + self.of_volume(excess);
        State { energy: energy + self.of_volume(excess), magnitude, gradient, area, excess }
    }

    /// Of the volume [m^6/J].
    pub(super) fn compliance(&self) -> f64 {
        self.energy.volume.as_ref().map_or(0.0, EnclosedVolume::compliance)
    }

    /// Energy of a compressed volume [J]; one without compliance is a constraint and has none.
    fn of_volume(&self, excess: f64) -> f64 {
        let compliance = self.compliance();
        if compliance > 0.0 { 0.5 * excess * excess / compliance } else { 0.0 }
    }

    /// The volume's multiplier, -pressure, that leaves the least force.
    pub(super) fn first_multiplier(&self, state: &State) -> f64 {
        let square = dot(&state.area, &state.area);
        if square > 0.0 { -dot(&state.gradient, &state.area) / square } else { 0.0 }
    }

    /// The direction of descent and the volume's multiplier, -pressure: `pull` is the inverse matrix times the force,
    /// `spread` that times the volume's gradient, the row beside the matrix.
    pub(super) fn direction(&self, state: &State, mut pull: Field, spread: &[Vector3<f64>]) -> (Field, f64) {
        if state.area.is_empty() {
            return (pull, 0.0);
        }
        let across = dot(&state.area, spread) + self.compliance();
        // All that encloses it is held: nothing changes the volume.
        let multiplier = if across > 0.0 { (state.excess + dot(&state.area, &pull)) / across } else { 0.0 };
        add_scaled(&mut pull, -multiplier, spread);
        (pull, multiplier)
    }

    /// Brings a volume without compliance to its target along `spread`; whether that can be done.
    pub(super) fn keep_volume(&self, x: &mut [Point3<f64>], spread: &[Vector3<f64>]) -> bool {
        let rigid = self.energy.volume.as_ref().filter(|v| v.compliance() == 0.0);
        rigid.is_none_or(|volume| volume.retract(x, spread).is_ok())
    }

    /// The force on each vertex [N], without what obstacles exert.
    pub(super) fn force(&self, state: &State, multiplier: f64) -> Field {
        let multiplier = self.exact(state, multiplier);
        let mut force: Field = state.gradient.iter().map(|g| -g).collect();
        if !state.area.is_empty() {
            add_scaled(&mut force, -multiplier, &state.area);
        }
        force
    }

    /// The multiplier: a volume with compliance has its own.
    fn exact(&self, state: &State, multiplier: f64) -> f64 {
        let compliance = self.compliance();
        if compliance > 0.0 { state.excess / compliance } else { multiplier }
    }

    /// The rows that hold: those that are touched and pressed against.
    pub(super) fn pressed(
        &self,
        x: &[Point3<f64>],
        state: &State,
        multiplier: f64,
        rows: &[Row],
        touching: f64,
    ) -> Vec<Row> {
        if rows.is_empty() {
            return Vec::new();
        }
        let force = self.force(state, multiplier);
        rows.iter().filter(|row| row.room(x) <= touching && row.is_pressed(&force)).copied().collect()
    }

    pub(super) fn judge(&self, state: &State, multiplier: f64, holding: &[Row], outcome: &mut Outcome) {
        let mut force = self.force(state, multiplier);
        // Twice, as rows of one vertex share it.
        (0..2).for_each(|_| holding.iter().for_each(|row| row.support(&mut force)));
        self.unknowns.release_held(&mut force);
        outcome.force = (dot(&force, &force) / self.unknowns.free.len().max(1) as f64).sqrt();
        outcome.residual = outcome.force / self.force_scale;
        outcome.energy = state.energy;
        outcome.pressure = -self.exact(state, multiplier);
        outcome.converged = outcome.residual <= self.settings.tolerance;
    }

    /// Shortens the step until the energy falls by a share of what the slope promises; `complete` makes a trial keep
    /// obstacles and volume, or says that it cannot.
    pub(super) fn search(
        &self,
        x: &[Point3<f64>],
        state: &State,
        direction: &[Vector3<f64>],
        outcome: &mut Outcome,
        mut complete: impl FnMut(&mut [Point3<f64>]) -> bool,
    ) -> Option<(Vec<Point3<f64>>, State)> {
        let soft = if self.compliance() > 0.0 { state.excess / self.compliance() } else { 0.0 };
        let along =
            |s: &State| dot(&s.gradient, direction) + if soft == 0.0 { 0.0 } else { soft * dot(&s.area, direction) };
        let slope = along(state);
        if !(slope < 0.0) {
            return None;
        }
        // Below this, differences of energy are rounding; then the slope decides.
        let rounding = 16.0 * f64::EPSILON * state.magnitude;
        let mut length = 1.0;
        for _ in 0..HALVINGS {
            let mut end: Vec<Point3<f64>> = x.iter().zip(direction).map(|(x, d)| x + d * length).collect();
            if !complete(&mut end) {
                length *= 0.5;
                continue;
            }
            let new = self.state(&end);
            outcome.evaluations += 1;
            let falls = new.energy <= state.energy + SUFFICIENT * length * slope;
            let level = (new.energy - state.energy).abs() <= rounding && along(&new).abs() <= 0.9 * -slope;
            if falls || level {
                return Some((end, new));
            }
            // The parabola through both energies and the slope, kept between a tenth and a half.
            let over = new.energy - state.energy - length * slope;
            let best = -0.5 * slope * length * length / over;
            length = if best.is_finite() { best.clamp(0.1 * length, 0.5 * length) } else { 0.1 * length };
        }
        None
    }
}
