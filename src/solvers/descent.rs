//! Common parts of equilibrium solvers: energy and forces at a point, stopping criteria, and the
//! line search.

use nalgebra::{DMatrix, DVector, Point3, Vector3};

use super::energy::Energy;
use super::history::{Field, add_scaled, dot};
use super::unknowns::Unknowns;
use crate::constraints::EnclosedVolume;
use crate::contact::ContactPlane;
use crate::mesh::measures::{Aabb, max_or_nan};
use crate::rest::all_within;
use crate::state::{DecodeError, Reader, Value, Writer};

/// Least decrease of a step, relative to the decrease predicted by the slope.
const SUFFICIENT: f64 = 1e-4;

/// Greatest number of halvings of a step.
const HALVINGS: u32 = 30;

/// Farthest that a step takes a vertex, before corrections, relative to the diagonal of the box around all. A
/// matrix that is nearly singular gives directions that leave every scene.
const FARTHEST: f64 = 0.5;

/// Relative error of a volume that is rounding.
pub(super) const ROUNDED: f64 = 64.0 * f64::EPSILON;

/// Greatest number of rounds in which volumes are corrected and motion through something is taken
/// back.
pub(super) const KEEPING: usize = 4;

/// Greatest number of sweeps over several volumes.
const SWEEPS: u32 = 60;

/// Number of sweeps over the reactions of rows that share vertices: the force that is left falls by a
/// constant factor in each.
const SUPPORTING: usize = 100;

/// Stopping criteria.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DescentSettings {
    /// Root mean square of the residual force on free vertices, relative to the force of unit
    /// strain.
    pub tolerance: f64,
    /// Greatest number of iterations.
    pub iterations: u32,
}

impl Default for DescentSettings {
    fn default() -> Self {
        Self {
            tolerance: 1e-4,
            iterations: 500,
        }
    }
}

/// Result of a solution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DescentOutcome {
    /// Number of iterations.
    pub iterations: u32,
    /// Number of evaluations of energy and gradient.
    pub evaluations: u32,
    /// Root mean square of the residual force on free vertices [N].
    pub force: f64,
    /// The residual force relative to the force of unit strain.
    pub residual: f64,
    /// Energy [J].
    pub energy: f64,
    /// Pressure in the first volume [Pa]; 0 without a volume.
    pub pressure: f64,
    /// True if the residual is within the tolerance.
    pub converged: bool,
}

impl Value for DescentOutcome {
    const MIN_BYTES: usize = 4 + 4 + 4 * 8 + 1;

    fn encode(&self, to: &mut Writer) {
        let Self {
            iterations,
            evaluations,
            force,
            residual,
            energy,
            pressure,
            converged,
        } = self;
        to.put(&(*iterations, *evaluations));
        to.put(&((*force, *residual), (*energy, *pressure)));
        to.put(converged);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let (iterations, evaluations) = from.take()?;
        let ((force, residual), (energy, pressure)) = from.take()?;
        Ok(Self {
            iterations,
            evaluations,
            force,
            residual,
            energy,
            pressure,
            converged: from.take()?,
        })
    }
}

/// The multipliers of rows beside a matrix: solves the system of `areas` times `spreads` with
/// `compliance` on the diagonal. A row without effect, because all its vertices are fixed, has the
/// multiplier 0.
pub(super) fn multipliers(
    areas: &[Field],
    spreads: &[Field],
    compliance: impl Fn(usize) -> f64,
    right: impl Fn(usize) -> f64,
) -> Vec<f64> {
    let entry =
        |i: usize, j: usize| dot(&areas[i], &spreads[j]) + if i == j { compliance(i) } else { 0.0 };
    let moves: Vec<usize> = (0..areas.len()).filter(|&i| entry(i, i) > 0.0).collect();
    if moves.is_empty() {
        return vec![0.0; areas.len()];
    }
    let matrix = DMatrix::from_fn(moves.len(), moves.len(), |i, j| entry(moves[i], moves[j]));
    let right = DVector::from_fn(moves.len(), |i, _| right(moves[i]));
    let mut all = vec![0.0; areas.len()];
    if let Some(found) = matrix.lu().solve(&right) {
        moves
            .iter()
            .zip(found.iter())
            .for_each(|(i, m)| all[*i] = *m);
    }
    all
}

/// True if a volume is at its target up to rounding, of itself and of coordinates far from the
/// origin.
fn is_kept(volume: &EnclosedVolume, x: &[Point3<f64>]) -> bool {
    let (excess, area) = volume.value_and_gradient(x);
    let moved: f64 = area
        .iter()
        .zip(x)
        .map(|(a, p)| a.norm() * p.coords.norm())
        .sum();
    excess.abs() <= ROUNDED * volume.target().abs() + f64::EPSILON * moved
}

/// Keeps vertices out of obstacles during the minimisation.
pub trait ContactFilter {
    /// The contact planes of vertices near an obstacle.
    fn planes(&self) -> Vec<ContactPlane>;
    /// Height above a plane at which a vertex touches [m].
    fn touching(&self) -> f64;
    /// Moves vertices that entered an obstacle on their path from `start` back to its surface.
    fn push(&mut self, start: &[Point3<f64>], x: &mut [Point3<f64>]);
    /// Number of parts in which a motion to new poses is made.
    fn parts(&self, _displacement: &[Vector3<f64>]) -> usize {
        1
    }
    /// The obstacles move to where they are after this share of their motion.
    fn begin_part(&mut self, _share: f64, _start: &[Point3<f64>]) {}
    /// Takes back the motion of the trial that would pass through something. Returns true if vertices
    /// moved, and `None` if no motion of free vertices keeps everything apart.
    fn hold(&mut self, _x: &mut [Point3<f64>]) -> Option<bool> {
        Some(false)
    }
    /// The same for a motion that must be made: as far as anything can be kept apart.
    fn hold_all(&mut self, _x: &mut [Point3<f64>]) {}
    /// Whether the body is wanted no more: trials end at once. One can take long where many vertices
    /// touch.
    fn is_stopped(&self) -> bool {
        false
    }
    /// Notes work beside trials, in steps of a vertex.
    fn spend(&mut self, _steps: usize) {}
    /// Accepts the last push: the body stays there.
    fn accept(&mut self, x: &[Point3<f64>]);
}

/// No obstacles.
pub struct NoContact;

impl ContactFilter for NoContact {
    fn planes(&self) -> Vec<ContactPlane> {
        Vec::new()
    }
    fn touching(&self) -> f64 {
        0.0
    }
    fn push(&mut self, _: &[Point3<f64>], _: &mut [Point3<f64>]) {}
    fn accept(&mut self, _: &[Point3<f64>]) {}
}

/// Energy, gradient and volume at one point.
pub(super) struct State {
    pub energy: f64,
    /// Sum of the absolute values of the energy's terms [J]: the rounding error is proportional to
    /// this.
    pub magnitude: f64,
    pub gradient: Field,
    /// Gradient of each volume.
    pub areas: Vec<Field>,
    /// V minus its target [m^3], for each volume.
    pub excess: Vec<f64>,
}

/// The energy of a body, its unknown vertices, and its stopping criteria.
pub struct DescentProblem {
    /// The energy.
    pub energy: Energy,
    /// Stopping criteria.
    pub settings: DescentSettings,
    pub(super) unknowns: Unknowns,
    pub(super) force_scale: f64,
}

impl DescentProblem {
    /// The problem of a body at rest at `x`; vertices without inverse mass are fixed.
    pub fn new(
        energy: Energy,
        x: &[Point3<f64>],
        inverse_mass: &[f64],
        settings: DescentSettings,
    ) -> Self {
        let force_scale = energy.force_scale(x);
        Self {
            energy,
            settings,
            unknowns: Unknowns::new(inverse_mass),
            force_scale,
        }
    }

    /// The force [N] on a vertex that is the scale of residuals.
    pub fn force_scale(&self) -> f64 {
        self.force_scale
    }

    pub(super) fn state(&self, x: &[Point3<f64>]) -> State {
        let mut gradient = vec![Vector3::zeros(); x.len()];
        let energy = self.energy.value_and_gradient(x, &mut gradient);
        self.unknowns.release_held(&mut gradient);
        let (excess, mut areas): (Vec<f64>, Vec<Field>) = self
            .energy
            .volumes
            .iter()
            .map(|volume| volume.value_and_gradient(x))
            .unzip();
        areas
            .iter_mut()
            .for_each(|area| self.unknowns.release_held(area));
        let compressed = self.of_volumes(&excess);
        let magnitude = energy + 2.0 * self.energy.negative_terms(x) + compressed;
        State {
            energy: energy + compressed,
            magnitude,
            gradient,
            areas,
            excess,
        }
    }

    /// Energy of compressed volumes [J]; a volume without compliance is a constraint without
    /// energy.
    fn of_volumes(&self, excess: &[f64]) -> f64 {
        self.softness(excess)
            .zip(excess)
            .map(|(pressure, excess)| 0.5 * excess * pressure)
            .sum()
    }

    /// The multiplier of each volume with compliance, which follows from its compression; 0 for the
    /// others.
    fn softness(&self, excess: &[f64]) -> impl Iterator<Item = f64> {
        let each = self
            .energy
            .volumes
            .iter()
            .map(EnclosedVolume::compliance)
            .zip(excess);
        each.map(|(compliance, excess)| {
            if compliance > 0.0 {
                excess / compliance
            } else {
                0.0
            }
        })
    }

    /// The multipliers of the volumes, -pressure, that minimise the force.
    pub(super) fn first_multipliers(&self, state: &State) -> Vec<f64> {
        let State {
            areas, gradient, ..
        } = state;
        multipliers(areas, areas, |_| 0.0, |i| -dot(gradient, &areas[i]))
    }

    /// The direction of descent and the multipliers of the volumes, -pressure. `pull` is the
    /// inverse matrix times the force; `spreads` are the inverse matrix times the volumes'
    /// gradients, the rows beside the matrix.
    pub(super) fn direction(
        &self,
        state: &State,
        mut pull: Field,
        spreads: &[Field],
    ) -> (Field, Vec<f64>) {
        let compliance = |i: usize| self.energy.volumes[i].compliance();
        let found = multipliers(&state.areas, spreads, compliance, |i| {
            state.excess[i] + dot(&state.areas[i], &pull)
        });
        found
            .iter()
            .zip(spreads)
            .for_each(|(m, spread)| add_scaled(&mut pull, -m, spread));
        (pull, found)
    }

    /// The displacement `pull` without its part that changes the volumes; `spreads` are those of
    /// [`Self::direction`].
    pub(super) fn keeping(&self, state: &State, mut pull: Field, spreads: &[Field]) -> Field {
        let compliance = |i: usize| self.energy.volumes[i].compliance();
        let found = multipliers(&state.areas, spreads, compliance, |i| {
            dot(&state.areas[i], &pull)
        });
        let each = found.iter().zip(spreads);
        each.for_each(|(m, spread)| add_scaled(&mut pull, -m, spread));
        pull
    }

    /// Brings a trial from `x` out of obstacles, and volumes to their targets along `spreads`, without
    /// motion through something. Returns false if that is impossible.
    pub(super) fn complete_trial(
        &self,
        x: &[Point3<f64>],
        end: &mut [Point3<f64>],
        spreads: &[Field],
        contact: &mut impl ContactFilter,
    ) -> bool {
        contact.push(x, end);
        for _ in 0..KEEPING {
            if !self.keep_volumes(end, spreads) {
                return false;
            }
            match contact.hold(end) {
                Some(false) => return true,
                Some(true) => {}
                None => return false,
            }
        }
        false
    }

    /// True if all volumes without compliance are at their targets up to rounding.
    pub(super) fn volumes_kept(&self, x: &[Point3<f64>]) -> bool {
        self.energy
            .volumes
            .iter()
            .filter(|v| v.compliance() == 0.0)
            .all(|volume| is_kept(volume, x))
    }

    /// Brings volumes without compliance to their targets, each along its field in `spreads`.
    /// Returns false if that is impossible.
    pub(super) fn keep_volumes(&self, x: &mut [Point3<f64>], spreads: &[Field]) -> bool {
        let each = self.energy.volumes.iter().zip(spreads);
        let rigid: Vec<(&EnclosedVolume, &Field)> =
            each.filter(|(v, _)| v.compliance() == 0.0).collect();
        if let [(volume, spread)] = rigid[..] {
            return volume.retract(x, spread).is_ok();
        }
        // The correction of one volume changes the others slightly.
        for _ in 0..SWEEPS {
            if !rigid
                .iter()
                .all(|(volume, spread)| volume.retract(x, spread).is_ok())
            {
                return false;
            }
            if rigid.iter().all(|(volume, _)| is_kept(volume, x)) {
                return true;
            }
        }
        false
    }

    /// The force on each vertex [N], without the reactions of obstacles.
    pub(super) fn force(&self, state: &State, multipliers: &[f64]) -> Field {
        let mut force: Field = state.gradient.iter().map(|g| -g).collect();
        let each = self.exact(state, multipliers).zip(&state.areas);
        each.for_each(|(multiplier, area)| add_scaled(&mut force, -multiplier, area));
        force
    }

    /// The multipliers; that of a volume with compliance follows from its compression.
    fn exact(&self, state: &State, multipliers: &[f64]) -> impl Iterator<Item = f64> {
        let each = self
            .energy
            .volumes
            .iter()
            .map(EnclosedVolume::compliance)
            .zip(self.softness(&state.excess));
        each.zip(multipliers)
            .map(|((compliance, soft), free)| if compliance > 0.0 { soft } else { *free })
    }

    /// The pressure in each volume [Pa].
    pub(super) fn pressures(&self, state: &State, multipliers: &[f64]) -> Vec<f64> {
        self.exact(state, multipliers).map(|m| -m).collect()
    }

    /// Adds the reactions of rows that share vertices to a force: those with which the least is left.
    pub(super) fn support_together(&self, rows: &[ContactPlane], force: &mut Field) {
        let is_free = |v: u32| self.unknowns.of(v).is_some();
        let mut free: Vec<ContactPlane> = rows.to_vec();
        let terms = free.iter_mut().flat_map(|row| &mut row.terms);
        terms.for_each(|(v, w)| *w = if is_free(*v) { *w } else { 0.0 });
        let mut reactions = vec![0.0; rows.len()];
        for _ in 0..SUPPORTING {
            for (row, reaction) in free.iter().zip(&mut reactions) {
                let square: f64 = row.terms.iter().map(|(_, w)| w * w).sum();
                if square > 0.0 {
                    let after = (*reaction - row.along(force) / square).max(0.0);
                    row.spread(after - *reaction, force);
                    *reaction = after;
                }
            }
        }
    }

    /// Judges the force that is left with the reactions of obstacles, which `support` adds.
    pub(super) fn judge(
        &self,
        state: &State,
        multipliers: &[f64],
        support: impl FnOnce(&mut Field),
        outcome: &mut DescentOutcome,
    ) {
        let mut force = self.force(state, multipliers);
        support(&mut force);
        self.unknowns.release_held(&mut force);
        outcome.force = (dot(&force, &force) / self.unknowns.free.len().max(1) as f64).sqrt();
        outcome.residual = outcome.force / self.force_scale;
        outcome.energy = state.energy;
        outcome.pressure = self.exact(state, multipliers).next().map_or(0.0, |m| -m);
        outcome.converged = all_within([(outcome.residual, self.settings.tolerance)]);
    }

    /// Shortens the step until the energy decreases by a share of the prediction from the slope.
    /// `complete` corrects obstacles and volumes of a trial, or returns false if it cannot. The slope
    /// is that of the Lagrangian: near the minimum the slope of the energy alone is rounding errors of
    /// the volumes.
    pub(super) fn search(
        &self,
        x: &[Point3<f64>],
        (state, multipliers): (&State, &[f64]),
        direction: &[Vector3<f64>],
        outcome: &mut DescentOutcome,
        mut complete: impl FnMut(&mut [Point3<f64>]) -> bool,
    ) -> Option<(Vec<Point3<f64>>, State)> {
        let exact: Vec<f64> = self.exact(state, multipliers).collect();
        let along = |s: &State| {
            let pressed = exact.iter().zip(&s.areas).filter(|(m, _)| **m != 0.0);
            pressed.fold(dot(&s.gradient, direction), |sum, (m, area)| {
                sum + m * dot(area, direction)
            })
        };
        let slope = along(state);
        if !(slope < 0.0) {
            return None;
        }
        // Below this, differences of energy are rounding error; then the slope decides.
        let rounding = 16.0 * f64::EPSILON * state.magnitude;
        let far = FARTHEST * Aabb::of_points(x).extents().norm();
        let moved = max_or_nan(direction.iter().map(|d| d.norm()));
        if !moved.is_finite() {
            return None;
        }
        let mut length = if far > 0.0 && moved > far {
            far / moved
        } else {
            1.0
        };
        for _ in 0..HALVINGS {
            let mut end: Vec<Point3<f64>> = x
                .iter()
                .zip(direction)
                .map(|(x, d)| x + d * length)
                .collect();
            if !complete(&mut end) {
                length *= 0.5;
                continue;
            }
            let new = self.state(&end);
            outcome.evaluations += 1;
            let falls = new.energy <= state.energy + SUFFICIENT * length * slope;
            let level =
                (new.energy - state.energy).abs() <= rounding && along(&new).abs() <= 0.9 * -slope;
            if falls || level {
                return Some((end, new));
            }
            // The minimum of the parabola through both energies and the slope, limited to between a
            // tenth and a half.
            let over = new.energy - state.energy - length * slope;
            let best = -0.5 * slope * length * length / over;
            length = if best.is_finite() {
                best.clamp(0.1 * length, 0.5 * length)
            } else {
                0.1 * length
            };
        }
        None
    }
}
