//! Skin, implant and what lies under them brought to rest together.
//!
//! Rounds: find what may touch, with planes through the nearest points; minimise the energy with these planes by Newton's
//! method; go there as far as the energy falls with contact as it is found there; until nothing moves any more or nothing
//! more is gained. A plane that holds at rest then lies in the nearest point itself.

use nalgebra::Point3;

use super::SkinError;
use super::contact::{Anchors, Touching};
pub use super::detector::deepest;
use super::detector::{Detector, PENALTY};
use super::elastic::Elastic;
use super::envelope::Envelope;
use super::layers::Layers;
use super::support_surface::SupportSurface;
use super::thickness::Thickness;
use crate::constraints::EnclosedVolume;
use crate::constraints::distance::Distance;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;
use crate::solvers::descent::{Outcome, Settings, Unguarded};
use crate::solvers::energy::Energy;
use crate::solvers::newton::Newton;
use crate::solvers::quasi_static::QuasiStatic;
use crate::solvers::sparse::FactorError;

/// The stiffness of each spring [N/m].
pub type Stiffness = Vec<f64>;

/// A round ends when something has moved by this share of the base: what may touch is then looked for again.
const LEASH: f64 = 0.02;

/// Stiffness of what keeps the base of an implant in its place, over the skin's in-plane stiffness: it only decides where
/// nothing else does, as for a turn about the axis.
const POCKET: f64 = 1e-5;

/// Stiffness of skin that is pressed thin, over that of contact.
const FIRM: f64 = 0.1;

/// At rest, no vertex of the skin moves in a round by more than this share of an edge. The slack shell under it slides about
/// by some tenths of an edge, for the nearest points jump from triangle to triangle; it is judged by its pressure.
const STILL: f64 = 0.05;

/// At rest, area and pressure change in a round by at most this share.
pub(super) const STEADY: f64 = 1e-3;

/// Or: over so many rounds the energy falls by less than that, area changes by a fifth of it and pressure by ten times it.
const EXHAUSTED: usize = 6;

/// A round goes at least so far, over what it may.
const SHORTEST: f64 = 1.0 / 64.0;

/// Residual force at rest, as a share of what a strain of one exerts.
const TOLERANCE: f64 = 1e-5;

/// Contact that is too deep at rest is lifted so many times at most.
const LIFTS: u32 = 8;

/// Rounds at most, also after each lift, and iterations in each.
const ROUNDS: u32 = 80;
const INNER: u32 = 6;

/// Iterations of the other method in each round.
const INNER_QUASI_STATIC: u32 = 60;

/// How an equilibrium is sought.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Newton's method, a factor of the whole second derivative in every iteration.
    #[default]
    Newton,
    /// L-BFGS over a constant factor: less memory, for tens of thousands of vertices.
    QuasiStatic,
}

/// An implant among the unknowns; its vertices follow those of the skin.
#[derive(Clone, Debug)]
pub struct Filled {
    /// Its shell as it starts.
    pub mesh: TriangleMesh,
    /// Springs of the shell, over all unknowns.
    pub springs: Vec<Distance>,
    /// Their stiffness [N/m].
    pub stiffness: Stiffness,
    /// The volume that it keeps [m^3].
    pub volume: f64,
    /// Vertices of its base, which keep their place as far as nothing moves them.
    pub pocket: Vec<u32>,
}

/// What is brought to rest.
pub struct Model {
    /// The skin.
    pub layers: Layers,
    /// In-plane stiffness of the skin [N/m].
    pub membrane: f64,
    /// Implants, one after the other.
    pub implants: Vec<Filled>,
    /// What lower layer and implants rest on.
    pub beds: Vec<SupportSurface>,
    /// A rigid sphere under the lower layer: centre and radius [m].
    pub ball: Option<(Point3<f64>, f64)>,
    /// Length of the base, of the smallest implant, by which lengths are judged [m].
    pub base: f64,
    /// How equilibrium is sought.
    pub method: Method,
}

/// How far a solution is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// Rounds done.
    pub rounds: u32,
    /// Iterations of the solver in all of them.
    pub iterations: u32,
    /// Force left, as a share of what a strain of one exerts.
    pub residual: f64,
    /// Greatest motion of a vertex of the skin in the last round [m].
    pub moved: f64,
    /// Greatest depth of one body in another [m].
    pub depth: f64,
    /// Pressure in the implant, of several the largest by magnitude [Pa].
    pub pressure: f64,
    /// Whether all is at rest.
    pub converged: bool,
    /// Whether that is so because nothing more was gained, whatever force is left.
    pub exhausted: bool,
}

impl Progress {
    /// By which rule it is at rest: `force` or `exhaustion`; `None` where it is not.
    pub fn rest_by(&self) -> Option<&'static str> {
        self.converged.then_some(if self.exhausted {
            "exhaustion"
        } else {
            "force"
        })
    }

    /// Whether it is at rest, for people.
    pub fn rest(&self) -> &'static str {
        match self.rest_by() {
            None => "NO",
            Some("force") => "yes",
            Some(_) => "yes, nothing more to gain",
        }
    }
}

/// The energy with contact as it is at the present positions, and how far a round may go from there.
struct Way {
    energy: Energy,
    /// Its value [J].
    value: f64,
    /// [m].
    leash: f64,
}

impl Way {
    fn new(detector: &mut Detector, x: &[Point3<f64>], start: &[Point3<f64>], leash: f64) -> Self {
        let energy = detector.model.energy(detector.touching(x), start);
        let value = energy.value(x);
        Self {
            energy,
            value,
            leash,
        }
    }

    /// Goes only so far from `before` to `x` that the energy falls with contact as it is found there: planes of before know
    /// nothing of what lies beyond them, and rounds that trust them may go in circles.
    fn descend(
        self,
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
struct Told(Vec<(f64, f64, Vec<f64>)>);

impl Told {
    /// Whether energy, area and each pressure differ by at most these shares between the last two of so many rounds.
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

    /// Whether nothing more is to be gained, as on an edge between facets, where no force vanishes.
    fn exhausted(&self) -> bool {
        self.within(EXHAUSTED, [STEADY, 0.2 * STEADY, 10.0 * STEADY])
    }
}

/// A model on its way to rest.
struct Descent<'a> {
    detector: Detector<'a>,
    newton: Option<Newton>,
    start: Vec<Point3<f64>>,
    inverse_mass: Vec<f64>,
    progress: Progress,
    /// In each implant [Pa].
    pressures: Vec<f64>,
}

/// The larger by magnitude; no number is larger than any.
fn larger(a: f64, b: f64) -> f64 {
    if b.abs() > a.abs() || b.is_nan() {
        b
    } else {
        a
    }
}

impl<'a> Descent<'a> {
    fn new(model: &'a Model) -> Self {
        let held = |v: usize| model.layers.held.get(v).copied().unwrap_or(false);
        let inverse_mass = (0..model.count())
            .map(|v| if held(v) { 0.0 } else { 1.0 })
            .collect();
        let (detector, progress) = (Detector::new(model), Progress::default());
        Self {
            detector,
            newton: None,
            start: model.rest(),
            inverse_mass,
            progress,
            pressures: Vec::new(),
        }
    }

    /// Rounds until all is at rest, with contact lifted as it is.
    fn rounds(
        &mut self,
        x: &mut [Point3<f64>],
        watch: &mut dyn FnMut(&Progress) -> bool,
    ) -> Result<(), SkinError> {
        let Self {
            detector,
            newton,
            start,
            inverse_mass,
            progress,
            pressures,
        } = self;
        let model = detector.model;
        let mut way = Way::new(detector, x, start, LEASH * model.base);
        let mut told = Told::default();
        for _ in 0..ROUNDS {
            let before = x.to_owned();
            let outcome;
            (outcome, *pressures) =
                model.minimise(newton, way.energy, x, inverse_mass, way.leash)?;
            way = Way {
                energy: Energy::default(),
                ..way
            }
            .descend(detector, &before, x, start)?;
            progress.rounds += 1;
            progress.iterations += outcome.iterations;
            progress.residual = outcome.residual;
            progress.pressure = pressures.iter().copied().reduce(larger).unwrap_or(0.0);
            // Of an implant alone all its vertices.
            let judged = if model.layers.count() == 0 {
                x.len()
            } else {
                2 * model.layers.count()
            };
            progress.moved = max_or_nan(
                before
                    .iter()
                    .zip(x.iter())
                    .take(judged)
                    .map(|(a, b)| (a - b).norm()),
            );
            told.0.push((way.value, model.area(x), pressures.clone()));
            let still =
                outcome.converged && progress.moved <= STILL * model.layers.edge && told.steady();
            progress.exhausted = !still && told.exhausted();
            progress.converged = still || progress.exhausted;
            if progress.converged {
                return Ok(());
            }
            if !watch(progress) {
                return Err(SkinError::Stopped);
            }
        }
        Ok(())
    }
}

impl Model {
    /// Number of unknown vertices, held ones among them.
    pub fn count(&self) -> usize {
        self.layers.rest.len()
            + self
                .implants
                .iter()
                .map(|i| i.mesh.vertices.len())
                .sum::<usize>()
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

    /// Skin and implants at rest, before they touch [m].
    pub fn rest(&self) -> Vec<Point3<f64>> {
        let implants = self.implants.iter().flat_map(|i| i.mesh.vertices.iter());
        self.layers.rest.iter().chain(implants).copied().collect()
    }

    /// Greatest distance between the layers [m].
    fn depth(&self) -> f64 {
        let (upper, lower) = self.layers.rest.split_at(self.layers.count());
        max_or_nan(upper.iter().zip(lower).map(|(u, l)| (u - l).norm()))
    }

    /// As stiff as contact over the depth of the skin.
    fn thickness(&self) -> Thickness {
        Thickness::new(
            &self.layers,
            FIRM * PENALTY * self.membrane / (self.base * self.base) * self.depth(),
        )
    }

    fn energy(&self, touching: Touching, start: &[Point3<f64>]) -> Energy {
        let mut energy = Energy::default();
        energy.elastic.push(Box::new(Elastic::new(
            &self.layers.springs,
            &self.layers.stiffness,
        )));
        if self.layers.count() > 0 {
            energy.elastic.push(Box::new(self.thickness()));
        }
        for implant in &self.implants {
            let mut shell = Envelope::new(implant.springs.clone(), implant.stiffness.clone());
            if self.layers.springs.is_empty() {
                shell = shell.alone();
            }
            energy.elastic.push(Box::new(shell));
            let places = implant
                .pocket
                .iter()
                .map(|&v| (v, start[v as usize]))
                .collect();
            energy.elastic.push(Box::new(Anchors {
                places,
                stiffness: POCKET * self.membrane,
            }));
        }
        energy.volumes = self.volumes();
        energy.elastic.push(Box::new(touching));
        energy
    }

    /// Brings all to rest from `x`; `watch` sees every round and says whether to go on.
    ///
    /// # Errors
    /// No memory; equations without a solution; [`SkinError::Stopped`].
    pub fn settle(
        &self,
        x: &mut [Point3<f64>],
        watch: impl FnMut(&Progress) -> bool,
    ) -> Result<Progress, SkinError> {
        self.settle_each(x, watch).map(|(progress, _)| progress)
    }

    /// The same, and the pressure in each implant [Pa].
    ///
    /// # Errors
    /// See [`Model::settle`].
    pub fn settle_each(
        &self,
        x: &mut [Point3<f64>],
        mut watch: impl FnMut(&Progress) -> bool,
    ) -> Result<(Progress, Vec<f64>), SkinError> {
        self.fill(x)?;
        let mut descent = Descent::new(self);
        for _ in 0..=LIFTS {
            descent.rounds(x, &mut watch)?;
            let progress = &mut descent.progress;
            progress.depth = descent.detector.depth(x);
            let deep = !(progress.depth <= deepest(self.base));
            if !progress.converged || !deep {
                break;
            }
            progress.converged = false;
            if !descent.detector.lift(x) {
                break;
            }
        }
        Ok((descent.progress, descent.pressures))
    }

    /// Area of the upper layer [m^2].
    fn area(&self, x: &[Point3<f64>]) -> f64 {
        crate::mesh::measures::area(&x[..self.layers.count()], &self.layers.triangles)
    }

    /// The volumes of the implants, to be kept.
    fn volumes(&self) -> Vec<EnclosedVolume> {
        let volume = |(implant, first): (&Filled, u32)| {
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

    /// Brings the implants to their volumes: over a bed that is not flat a shell is not quite a dome.
    fn fill(&self, x: &mut [Point3<f64>]) -> Result<(), SkinError> {
        for volume in self.volumes() {
            let (_, gradient) = volume.value_and_gradient(x);
            volume
                .retract(x, &gradient)
                .map_err(|error| SkinError::Solver(error.to_string()))?;
        }
        Ok(())
    }

    /// A solver of this energy; the one of the round before is used again. And the pressures [Pa].
    fn minimise(
        &self,
        newton: &mut Option<Newton>,
        energy: Energy,
        x: &mut [Point3<f64>],
        inverse_mass: &[f64],
        leash: f64,
    ) -> Result<(Outcome, Vec<f64>), SkinError> {
        let failed = |error: FactorError| SkinError::Solver(error.to_string());
        if self.method == Method::QuasiStatic {
            let settings = Settings {
                tolerance: TOLERANCE,
                iterations: INNER_QUASI_STATIC,
            };
            let mut solver = QuasiStatic::new(energy, x, inverse_mass, settings).map_err(failed)?;
            let outcome = solver.solve(x, &mut Unguarded, |_, _| true);
            return Ok((outcome, solver.pressures));
        }
        let newton = match newton {
            Some(newton) => {
                newton.renew(energy).map_err(failed)?;
                newton
            }
            None => {
                let settings = Settings {
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
        let outcome = newton.solve(x, |_, now| near(now)).map_err(failed)?;
        Ok((outcome, newton.pressures.clone()))
    }
}
