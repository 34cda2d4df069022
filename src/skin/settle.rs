//! Equilibrium of skin, implants and the surfaces below them.
//!
//! Each round finds possible contacts with planes through the nearest points, and minimises the
//! energy with these planes by Newton's method. The step is then shortened until the energy
//! decreases with contact as found at the new positions. The rounds end when nothing moves or the
//! energy no longer decreases. An active plane then contains the nearest point itself.

use nalgebra::Point3;

use super::SkinError;
use super::collapse::collapse;
use super::contact::Touching;
pub use super::detector::deepest;
use super::detector::{Detector, Lifts, PENALTY};
use super::envelope::envelope;
use super::hinges::bending;
use super::layers::Layers;
use super::soundness::crossings;
use super::support_surface::SupportSurface;
use super::thickness::{Thickness, thickness};
use crate::constraints::distance::Distance;
use crate::constraints::spring::{Linear, anchors};
use crate::constraints::{EnclosedVolume, Quadratic};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;
use crate::rest::{End, Relax, all_within, relax};
use crate::solvers::descent::{DescentOutcome, DescentSettings, NoContact};
use crate::solvers::energy::Energy;
use crate::solvers::newton::Newton;
use crate::solvers::quasi_static::QuasiStatic;
use crate::solvers::sparse::FactorError;

/// The stiffness of each spring [N/m].
pub type Stiffness = Vec<f64>;

/// A round ends when a vertex has moved by this share of the base; contacts are then searched
/// again.
const LEASH: f64 = 0.02;

/// Stiffness of the springs that hold the base of an implant in place, relative to the skin's
/// in-plane stiffness. They only determine otherwise free motions, such as a rotation about the
/// axis.
const POCKET: f64 = 1e-5;

/// Stiffness of compressed skin relative to that of contact.
const FIRM: f64 = 0.1;

/// Greatest motion of a vertex of the skin in a round at equilibrium, relative to an edge. The
/// slack shell below slides by some tenths of an edge, since the nearest points jump between
/// triangles; its criterion is the pressure.
const STILL: f64 = 0.05;

/// Greatest relative change of area and pressure in a round at equilibrium.
pub(super) const STEADY: f64 = 1e-3;

/// Alternative criterion: in this number of rounds the relative decrease of the energy is less than
/// `STEADY`, the change of area less than a fifth of it, and that of pressure less than ten times
/// it.
const EXHAUSTED: usize = 6;

/// Least share of its permitted length that a round moves.
const SHORTEST: f64 = 1.0 / 64.0;

/// Residual force at equilibrium, relative to the force of unit strain.
const TOLERANCE: f64 = 1e-5;

/// Greatest number of increases of the contact offsets at equilibrium.
const LIFTS: u32 = 20;

/// Greatest number of rounds, also after each increase of the offsets, and of iterations in each.
const ROUNDS: u32 = 100;
const INNER: u32 = 6;

/// Greatest number of iterations of the other method in each round.
const INNER_QUASI_STATIC: u32 = 60;

/// Method of the equilibrium.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SettleMethod {
    /// Newton's method, with a factorisation of the whole second derivative in every iteration.
    #[default]
    Newton,
    /// L-BFGS with a constant factor: less memory, for tens of thousands of vertices.
    QuasiStatic,
}

/// An implant among the unknowns; its vertices follow those of the skin.
#[derive(Clone, Debug)]
pub struct FilledImplant {
    /// Initial shell.
    pub mesh: TriangleMesh,
    /// Springs of the shell; indices refer to all unknowns.
    pub springs: Vec<Distance>,
    /// Stiffness of the springs [N/m].
    pub stiffness: Stiffness,
    /// Volume to keep [m^3].
    pub volume: f64,
    /// Vertices of the base, which weak springs hold in place.
    pub pocket: Vec<u32>,
}

/// The system of skin, implants and surfaces below.
pub struct SkinSystem {
    /// The skin.
    pub layers: Layers,
    /// In-plane stiffness of the skin [N/m].
    pub membrane: f64,
    /// Implants in order.
    pub implants: Vec<FilledImplant>,
    /// Surfaces that support the lower layer and the implants.
    pub supports: Vec<SupportSurface>,
    /// True if the supports are obstacles; otherwise they are the lower layer at the start.
    pub has_obstacles: bool,
    /// A rigid sphere under the lower layer: centre and radius [m].
    pub ball: Option<(Point3<f64>, f64)>,
    /// Base length of the smallest implant, the length scale of the tolerances [m].
    pub base: f64,
    /// Method of the equilibrium.
    pub method: SettleMethod,
}

/// State of a solution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SettleProgress {
    /// Number of rounds.
    pub rounds: u32,
    /// Number of solver iterations in all rounds.
    pub iterations: u32,
    /// Residual force, relative to the force of unit strain.
    pub residual: f64,
    /// Greatest motion of a vertex of the skin in the last round [m].
    pub moved: f64,
    /// Greatest penetration of one body into another [m].
    pub depth: f64,
    /// Pressure in the implant; of several the largest by magnitude [Pa].
    pub pressure: f64,
    /// True at equilibrium.
    pub converged: bool,
    /// True if the energy no longer decreases, for any residual force.
    pub exhausted: bool,
}

/// A system at the end of its rounds.
pub(super) struct Settled {
    pub progress: SettleProgress,
    /// The pressure in each implant [Pa].
    pub pressures: Vec<f64>,
    /// The offsets of contacts.
    pub lifts: Lifts,
}

impl SettleProgress {
    /// The criterion of the equilibrium: `force` or `exhaustion`; `None` without equilibrium.
    pub fn rest_by(&self) -> Option<&'static str> {
        self.converged.then_some(if self.exhausted {
            "exhaustion"
        } else {
            "force"
        })
    }

    /// The state of the equilibrium as text.
    pub fn rest(&self) -> &'static str {
        match self.rest_by() {
            None => "NO",
            Some("force") => "yes",
            Some(_) => "yes, nothing more to gain",
        }
    }
}

/// The energy with contact at the present positions, and the greatest step of a round from there.
struct Path {
    energy: Energy,
    /// Value of the energy [J].
    value: f64,
    /// Greatest motion [m].
    leash: f64,
}

impl Path {
    fn new(detector: &mut Detector, x: &[Point3<f64>], start: &[Point3<f64>], leash: f64) -> Self {
        let touching = detector.touching(x);
        let energy = detector.model.energy(&touching, start, x);
        let value = energy.value(x);
        Self {
            energy,
            value,
            leash,
        }
    }

    /// Shortens the step from `before` to `x` until the energy decreases with contact as found at
    /// the new positions. Planes of the old positions do not describe the surface beyond them, and
    /// rounds that rely on them can cycle.
    fn descend(
        &self,
        detector: &mut Detector,
        before: &[Point3<f64>],
        x: &mut [Point3<f64>],
        start: &[Point3<f64>],
    ) -> Result<Self, SkinError> {
        let (end, longest) = (x.to_owned(), LEASH * detector.model.base);
        let mut share = 1.0;
        loop {
            let leash = if share < 1.0 {
                share * self.leash
            } else {
                2.0 * self.leash
            };
            let next = Self::new(detector, x, start, leash.clamp(SHORTEST * longest, longest));
            if next.value <= self.value || share <= SHORTEST {
                return Ok(next);
            }
            share *= 0.5;
            x.iter_mut()
                .zip(before.iter().zip(&end))
                .for_each(|(x, (a, b))| *x = a + (b - a) * share);
            detector.model.fill(x)?;
        }
    }
}

/// Energy [J], area [m^2] and pressures [Pa] after the last rounds.
#[derive(Default)]
struct History(Vec<(f64, f64, Vec<f64>)>);

impl History {
    /// True if energy, area and each pressure changed by at most these relative amounts over the
    /// last `rounds` rounds.
    fn within(&self, rounds: usize, shares: [f64; 3]) -> bool {
        let Some(first) = self.0.len().checked_sub(rounds) else {
            return false;
        };
        let last = &self.0[self.0.len() - 1];
        let near = |old: f64, last: f64, share: f64| (old - last).abs() <= share * last.abs();
        self.0[first..].iter().all(|old| {
            let mut pressures = old.2.iter().zip(&last.2);
            near(old.0, last.0, shares[0])
                && near(old.1, last.1, shares[1])
                && pressures.all(|(old, last)| near(*old, *last, shares[2]))
        })
    }

    fn steady(&self) -> bool {
        self.within(2, [f64::INFINITY, STEADY, STEADY])
    }

    /// True if the energy no longer decreases, for example on an edge between facets where no force
    /// vanishes.
    fn exhausted(&self) -> bool {
        self.within(EXHAUSTED, [STEADY, 0.2 * STEADY, 10.0 * STEADY])
    }
}

/// A model on its path to equilibrium.
struct Descent<'a> {
    detector: Detector<'a>,
    newton: Option<Newton>,
    start: Vec<Point3<f64>>,
    inverse_mass: Vec<f64>,
    progress: SettleProgress,
    /// Pressure in each implant [Pa].
    pressures: Vec<f64>,
}

/// The larger by magnitude; NaN exceeds every number.
fn larger(a: f64, b: f64) -> f64 {
    if b.abs() > a.abs() || b.is_nan() {
        b
    } else {
        a
    }
}

impl<'a> Descent<'a> {
    fn new(model: &'a SkinSystem) -> Self {
        let inverse_mass = model.inverse_mass();
        let (detector, progress) = (Detector::new(model), SettleProgress::default());
        Self {
            detector,
            newton: None,
            start: model.rest(),
            inverse_mass,
            progress,
            pressures: Vec::new(),
        }
    }

    /// Runs rounds until equilibrium, with constant contact offsets.
    fn rounds(
        &mut self,
        x: &mut [Point3<f64>],
        watch: &mut dyn FnMut(&SettleProgress) -> bool,
    ) -> Result<(), SkinError> {
        let leash = LEASH * self.detector.model.base;
        let mut rounds = Rounds {
            path: Path::new(&mut self.detector, x, &self.start, leash),
            descent: self,
            x,
            history: History::default(),
            done: 0,
        };
        let end = relax(&mut rounds, ROUNDS as usize, |now| {
            let progress = &now.descent.progress;
            now.done == 0 || progress.converged || watch(progress)
        })?;
        match end {
            End::Stopped => Err(SkinError::Stopped),
            End::Rest | End::Steps | End::Stuck => Ok(()),
        }
    }
}

/// Rounds of a model with contact lifted as it is.
struct Rounds<'d, 'a> {
    descent: &'d mut Descent<'a>,
    x: &'d mut [Point3<f64>],
    path: Path,
    history: History,
    done: usize,
}

impl Relax for Rounds<'_, '_> {
    type Error = SkinError;

    fn judge(&mut self) -> Result<bool, SkinError> {
        Ok(self.descent.progress.converged)
    }

    fn steps(&self) -> usize {
        self.done
    }

    fn advance(&mut self) -> Result<bool, SkinError> {
        let Descent {
            detector,
            newton,
            start,
            inverse_mass,
            progress,
            pressures,
        } = &mut *self.descent;
        let (model, x) = (detector.model, &mut *self.x);
        let before = x.to_owned();
        let energy = std::mem::take(&mut self.path.energy);
        let outcome;
        (outcome, *pressures) = model.minimise(newton, energy, x, inverse_mass, self.path.leash)?;
        self.path = self.path.descend(detector, &before, x, start)?;
        progress.rounds += 1;
        progress.iterations += outcome.iterations;
        progress.residual = outcome.residual;
        progress.pressure = pressures.iter().copied().reduce(larger).unwrap_or(0.0);
        // For an implant alone, all its vertices.
        let judged = if model.layers.count() == 0 {
            x.len()
        } else {
            2 * model.layers.count()
        };
        let moves = before.iter().zip(x.iter()).take(judged);
        progress.moved = max_or_nan(moves.map(|(a, b)| (a - b).norm()));
        let area = model.area(x);
        self.history
            .0
            .push((self.path.value, area, pressures.clone()));
        let is_still = all_within([(progress.moved, STILL * model.layers.edge)]);
        let still = outcome.converged && is_still && self.history.steady();
        progress.exhausted = !still && self.history.exhausted();
        progress.converged = still || progress.exhausted;
        self.done += 1;
        Ok(true)
    }
}

impl SkinSystem {
    /// Number of unknown vertices, including fixed ones.
    pub fn count(&self) -> usize {
        self.layers.rest.len()
            + self
                .implants
                .iter()
                .map(|i| i.mesh.vertices.len())
                .sum::<usize>()
    }

    /// Zero for each fixed vertex.
    pub(super) fn inverse_mass(&self) -> Vec<f64> {
        let held = |v: usize| self.layers.held.get(v).copied().unwrap_or(false);
        let of = |v: usize| if held(v) { 0.0 } else { 1.0 };
        (0..self.count()).map(of).collect()
    }

    /// The first vertex of each implant.
    pub(super) fn firsts(&self) -> impl Iterator<Item = u32> {
        self.implants
            .iter()
            .scan(self.layers.rest.len() as u32, |next, implant| {
                let first = *next;
                *next += implant.mesh.vertices.len() as u32;
                Some(first)
            })
    }

    /// Skin and implants at rest, before contact [m].
    pub fn rest(&self) -> Vec<Point3<f64>> {
        let implants = self.implants.iter().flat_map(|i| i.mesh.vertices.iter());
        self.layers.rest.iter().chain(implants).copied().collect()
    }

    /// Greatest distance between the layers [m].
    fn depth(&self) -> f64 {
        let (upper, lower) = self.layers.rest.split_at(self.layers.count());
        max_or_nan(upper.iter().zip(lower).map(|(u, l)| (u - l).norm()))
    }

    /// The resistance to thinning, as stiff as contact over the depth of the skin.
    fn thickness(&self) -> Thickness {
        thickness(
            &self.layers,
            FIRM * PENALTY * self.membrane / (self.base * self.base) * self.depth(),
        )
    }

    /// The energy with contacts as found at `x`.
    pub(super) fn energy(
        &self,
        touching: &Touching,
        start: &[Point3<f64>],
        x: &[Point3<f64>],
    ) -> Energy {
        let mut energy = Energy::default();
        energy.elastic.push(Box::new(Quadratic::new(
            self.layers.springs.clone(),
            self.layers.stiffness.clone(),
        )));
        if self.layers.count() > 0 {
            energy.elastic.push(Box::new(self.thickness()));
        }
        if self.ball.is_none() && !self.layers.hinges.is_empty() {
            energy.elastic.push(Box::new(bending(&self.layers, x)));
            let facets = collapse(&self.layers, self.membrane);
            energy.elastic.push(Box::new(facets));
        }
        let n = self.layers.count();
        let bonds = self
            .layers
            .bonds
            .iter()
            .enumerate()
            .filter(|(_, k)| **k > 0.0);
        let bonds = bonds.map(|(v, k)| ((n + v) as u32, start[n + v], Linear::new(*k)));
        if !self.layers.bonds.is_empty() {
            energy.elastic.push(Box::new(anchors("bonds", bonds)));
        }
        for implant in &self.implants {
            let alone = self.layers.springs.is_empty();
            let shell = envelope(&implant.springs, &implant.stiffness, alone);
            energy.elastic.push(Box::new(shell));
            let law = Linear::new(POCKET * self.membrane);
            let places = implant.pocket.iter();
            let pocket = anchors("anchors", places.map(|&v| (v, start[v as usize], law)));
            energy.elastic.push(Box::new(pocket));
        }
        energy.volumes = self.volumes();
        energy.elastic.push(Box::new(touching.potential()));
        energy
    }

    /// Brings the system to equilibrium from `x`; `watch` sees every round and stops the solution
    /// by returning false.
    ///
    /// # Errors
    /// Too little memory; equations without a solution; [`SkinError::Stopped`].
    pub fn settle(
        &self,
        x: &mut [Point3<f64>],
        watch: impl FnMut(&SettleProgress) -> bool,
    ) -> Result<SettleProgress, SkinError> {
        self.settle_each(x, watch).map(|settled| settled.progress)
    }

    /// The same, with the pressures and what presses.
    ///
    /// # Errors
    /// See [`SkinSystem::settle`].
    pub(super) fn settle_each(
        &self,
        x: &mut [Point3<f64>],
        mut watch: impl FnMut(&SettleProgress) -> bool,
    ) -> Result<Settled, SkinError> {
        self.fill(x)?;
        let mut descent = Descent::new(self);
        for lifted in 0..=LIFTS {
            descent.rounds(x, &mut watch)?;
            let progress = &mut descent.progress;
            progress.depth = descent.detector.depth(x);
            let deep = !(progress.depth <= deepest(self.base));
            if !progress.converged {
                break;
            }
            if !deep && (lifted == LIFTS || !self.is_crossed(x)) {
                break;
            }
            progress.converged = false;
            if !descent.detector.lift(x) {
                progress.converged = !deep;
                break;
            }
        }
        Ok(Settled {
            progress: descent.progress,
            pressures: descent.pressures,
            lifts: descent.detector.lifts,
        })
    }

    /// True if triangles of the lower layer and of implants cross each other or an obstacle, of which
    /// one can move.
    fn is_crossed(&self, x: &[Point3<f64>]) -> bool {
        let n = self.layers.count();
        let mut bodies = vec![(n, x.get(n..2 * n).unwrap_or(&[]), &self.layers.triangles)];
        for (implant, first) in self.implants.iter().zip(self.firsts()) {
            let first = first as usize;
            let own = first..first + implant.mesh.vertices.len();
            bodies.push((first, &x[own], &implant.mesh.triangles));
        }
        // What is held lies where it lay.
        let held = &self.layers.held;
        let is_held = |v: usize| held.get(v).copied().unwrap_or(false);
        let is_free = |(first, _, triangles): &(usize, _, &Vec<[u32; 3]>), t: u32| {
            let corners = triangles[t as usize];
            corners.iter().any(|&v| !is_held(first + v as usize))
        };
        bodies.iter().enumerate().any(|(k, one)| {
            let with_bodies = bodies[k + 1..].iter().any(|other| {
                let found = crossings((one.1, one.2), Some((other.1, other.2)));
                let mut pairs = found.pairs.iter();
                pairs.any(|&[s, t]| is_free(one, s) || is_free(other, t))
            });
            let mut supports = self.supports.iter().filter(|_| self.has_obstacles);
            with_bodies
                || supports.any(|support| {
                    let mesh = support.mesh();
                    let found = crossings((one.1, one.2), Some((&mesh.vertices, &mesh.triangles)));
                    found.pairs.iter().any(|&[s, _]| is_free(one, s))
                })
        })
    }

    /// Area of the upper layer [m^2].
    fn area(&self, x: &[Point3<f64>]) -> f64 {
        crate::mesh::measures::area(&x[..self.layers.count()], &self.layers.triangles)
    }

    /// The volume constraints of the implants.
    fn volumes(&self) -> Vec<EnclosedVolume> {
        let volume = |(implant, first): (&FilledImplant, u32)| {
            let triangles: Vec<[u32; 3]> = implant
                .mesh
                .triangles
                .iter()
                .map(|t| t.map(|v| v + first))
                .collect();
            EnclosedVolume::new(&triangles, self.count(), implant.volume, 0.0)
        };
        self.implants
            .iter()
            .zip(self.firsts())
            .map(volume)
            .collect()
    }

    /// Scales the implants to their volumes: over a curved surface a shell is not exactly a dome.
    fn fill(&self, x: &mut [Point3<f64>]) -> Result<(), SkinError> {
        for volume in self.volumes() {
            let (_, gradient) = volume.value_and_gradient(x);
            volume
                .retract(x, &gradient)
                .map_err(|error| SkinError::Solver(error.to_string()))?;
        }
        Ok(())
    }

    /// Minimises the energy with the solver of the previous round. Returns also the pressures [Pa].
    fn minimise(
        &self,
        newton: &mut Option<Newton>,
        energy: Energy,
        x: &mut [Point3<f64>],
        inverse_mass: &[f64],
        leash: f64,
    ) -> Result<(DescentOutcome, Vec<f64>), SkinError> {
        let failed = |error: FactorError| SkinError::Solver(error.to_string());
        if self.method == SettleMethod::QuasiStatic {
            let settings = DescentSettings {
                tolerance: TOLERANCE,
                iterations: INNER_QUASI_STATIC,
            };
            let mut solver = QuasiStatic::new(energy, x, inverse_mass, settings).map_err(failed)?;
            let outcome = solver.solve(x, &mut NoContact, |_, _| true);
            return Ok((outcome, solver.pressures));
        }
        let newton = match newton {
            Some(newton) => {
                newton.renew(energy).map_err(failed)?;
                newton
            }
            None => {
                let settings = DescentSettings {
                    tolerance: TOLERANCE,
                    iterations: INNER,
                };
                newton.insert(
                    Newton::new(energy, &self.rest(), inverse_mass, settings).map_err(failed)?,
                )
            }
        };
        let from = x.to_owned();
        let near = |now: &[Point3<f64>]| from.iter().zip(now).all(|(a, b)| (a - b).norm() <= leash);
        let outcome = newton
            .solve(x, &mut NoContact, |_, now| near(now))
            .map_err(failed)?;
        Ok((outcome, newton.pressures.clone()))
    }
}
