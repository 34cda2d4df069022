//! Skin, implant and what lies under them brought to rest together.
//!
//! Rounds: find what may touch, with planes through the nearest points; minimise the energy with these planes by Newton's
//! method; go there as far as the energy falls with contact as it is found there; until nothing moves any more or nothing
//! more is gained. A plane that holds at rest then lies in the nearest point itself.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Point3;

use super::SkinError;
use super::contact::{Anchors, On, Over, Touch, Touching};
use super::elastic::Elastic;
use super::envelope::Envelope;
use super::layers::Layers;
use super::sheet::Sheet;
use super::thickness::Thickness;
use crate::constraints::EnclosedVolume;
use crate::constraints::distance::Distance;
use crate::contact::Surface;
use crate::mesh::measures::greatest;
use crate::mesh::{Topology, TriangleMesh};
use crate::solvers::descent::{Outcome, Settings, Unguarded};
use crate::solvers::energy::Energy;
use crate::solvers::newton::Newton;
use crate::solvers::quasi_static::QuasiStatic;
use crate::solvers::sparse::FactorError;

/// The stiffness of each spring [N/m].
pub type Stiffness = Vec<f64>;

/// Contact stiffness [N/m^3] times the square of the base over the skin's in-plane stiffness: under a tension that
/// stretches skin by a third, bodies then sink into each other by less than a thousandth of the base.
const PENALTY: f64 = 2_000.0;

/// Contact begins to press at this gap, over the base; a force that grows by a parabola from there to as much inside lets
/// Newton's method see what it is about to meet.
const SOFT: f64 = 3e-3;

/// A round ends when something has moved by this share of the base: what may touch is then looked for again.
const LEASH: f64 = 0.02;

/// Stiffness of what keeps the base of an implant in its place, over the skin's in-plane stiffness: it only decides where
/// nothing else does, as for a turn about the axis.
const POCKET: f64 = 1e-5;

/// Stiffness of skin that is pressed thin, over that of contact.
const FIRM: f64 = 0.1;

/// Vertices further apart than this share of the base are not looked at.
const LOOK: f64 = 0.15;

/// What presses is turned back along its plane as by a surface of this radius, over the base: smaller than what bends
/// least, so that no round runs away, and larger than what would make rounds slow.
const BENDS: f64 = 0.1;

/// At rest, no vertex of the skin moves in a round by more than this share of an edge. The slack shell under it slides about
/// by some tenths of an edge, for the nearest points jump from triangle to triangle; it is judged by its pressure.
const STILL: f64 = 0.05;

/// At rest, area and pressure change in a round by at most this share.
const STEADY: f64 = 1e-3;

/// Or: over so many rounds the energy falls by less than that, area changes by a fifth of it and pressure by ten times it.
const EXHAUSTED: usize = 6;

/// A round goes at least so far, over what it may.
const SHORTEST: f64 = 1.0 / 64.0;

/// Residual force at rest, as a share of what a strain of one exerts.
const TOLERANCE: f64 = 1e-5;

/// At rest, nothing is further inside another body than this share of the base.
const DEEP: f64 = 1e-3;

/// Where all is at rest but deeper than that, what is deeper than this share of it is lifted by its depth, so many times at
/// most: the rim of an implant bears all its pressure on a line, where springs are too soft.
const LIFTED: f64 = 0.5;
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
    /// The implant, if any.
    pub implant: Option<Filled>,
    /// What lower layer and implant rest on.
    pub beds: Vec<Sheet>,
    /// A rigid sphere under the lower layer: centre and radius [m].
    pub ball: Option<(Point3<f64>, f64)>,
    /// Length of the base, by which lengths are judged [m].
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
    /// Pressure in the implant [Pa].
    pub pressure: f64,
    /// Whether all is at rest.
    pub converged: bool,
}

/// Looks for what may touch.
struct Detector<'a> {
    model: &'a Model,
    /// Area of each unknown vertex at rest [m^2].
    areas: Vec<f64>,
    implant: Option<Surface>,
    /// Topology of the lower layer.
    lower: Arc<Topology>,
    soft: f64,
    /// How far touches were lifted [m].
    lifts: BTreeMap<(On, u32), f64>,
}

impl<'a> Detector<'a> {
    fn new(model: &'a Model) -> Self {
        let bed = model.layers.bed();
        let mut areas = vec![0.0; model.layers.count()];
        areas.extend(at_least_mean(bed.vertex_areas()));
        areas.extend(model.implant.iter().flat_map(|i| at_least_mean(i.mesh.vertex_areas())));
        let implant = model.implant.as_ref().map(|i| Surface::new(&i.mesh));
        Self {
            model,
            areas,
            implant,
            lower: Arc::new(Topology::new(&bed)),
            soft: SOFT * model.base,
            lifts: BTreeMap::new(),
        }
    }

    fn stiffness(&self, v: u32, share: f64) -> f64 {
        let Model { membrane, base, .. } = self.model;
        PENALTY * membrane / (base * base) * self.areas[v as usize] * share
    }

    /// All that may touch at positions `x`.
    fn touching(&mut self, x: &[Point3<f64>]) -> Touching {
        let (n, look) = (self.model.layers.count(), LOOK * self.model.base);
        let free = |v: &u32| (*v as usize) >= 2 * n || !self.model.layers.held[*v as usize];
        let mut touches = Vec::new();
        if let Some(ball) = self.model.ball {
            let over = Over::Ball(ball.0, ball.1);
            let lower = (n as u32..2 * n as u32).filter(free);
            touches
                .extend(lower.map(|vertex| Touch::new(vertex, On::Ball, over, self.stiffness(vertex, 1.0), self.soft)));
        }
        if n > 0
            && let Some(mut implant) = self.implant.take()
        {
            implant.refit(&x[2 * n..]);
            let lower = TriangleMesh { vertices: x[n..2 * n].to_vec(), triangles: self.model.layers.triangles.clone() };
            let lower = Sheet::with(lower, self.lower.clone());
            touches
                .extend((n as u32..2 * n as u32).filter(free).filter_map(|v| self.over_implant(&implant, v, x, look)));
            touches.extend((2 * n as u32..x.len() as u32).filter_map(|v| self.under_skin(&lower, v, x)));
            self.implant = Some(implant);
        }
        for k in 0..self.model.beds.len() {
            touches.extend((n as u32..x.len() as u32).filter(free).filter_map(|v| self.over_bed(k, v, x, look)));
        }
        let radius = BENDS * self.model.base;
        for t in &mut touches {
            t.lift = self.lifts.get(&(t.on, t.vertex)).copied().unwrap_or(0.0);
            *t = t.found(x, radius);
        }
        Touching { touches }
    }

    /// Lifts what is too deep, as far as it is.
    fn lift(&mut self, x: &[Point3<f64>]) {
        let deep = LIFTED * deepest(self.model.base);
        for touch in self.touching(x).touches {
            if let Some(depth) = touch.gap(x).map(|gap| -gap).filter(|depth| *depth > deep) {
                *self.lifts.entry((touch.on, touch.vertex)).or_insert(0.0) += depth;
            }
        }
    }

    /// How far the deepest is inside another body [m], however far that is for the skin in the implant.
    fn depth(&mut self, x: &[Point3<f64>]) -> f64 {
        let near = self.touching(x).depth(x);
        let n = self.model.layers.count();
        let Some(implant) = self.implant.as_ref().filter(|_| n > 0) else { return near };
        let free = (n..2 * n).filter(|v| !self.model.layers.held[*v]);
        let inside = free.filter_map(|v| implant.nearest(&x[v], f64::MAX)).map(|on| (-on.closest.distance).max(0.0));
        greatest(inside.chain([near]))
    }

    /// A vertex of the lower layer stays out of the implant.
    fn over_implant(&self, implant: &Surface, vertex: u32, x: &[Point3<f64>], look: f64) -> Option<Touch> {
        let on = implant.nearest(&x[vertex as usize], look)?;
        let first = 2 * self.model.layers.count() as u32;
        let corners = implant.triangles()[on.triangle as usize].map(|v| v + first);
        let over = Over::Carried(corners, on.weights, on.closest.normal);
        Some(Touch::new(vertex, On::Implant, over, self.stiffness(vertex, 0.5), self.soft))
    }

    /// A vertex of the implant stays under the lower layer.
    fn under_skin(&self, lower: &Sheet, vertex: u32, x: &[Point3<f64>]) -> Option<Touch> {
        let at = x[vertex as usize];
        let on = lower.nearest(&at, 2.0 * self.model.layers.edge)?;
        let first = self.model.layers.count() as u32;
        let over = Over::Carried(on.corners.map(|v| v + first), on.weights, -on.away(&at));
        Some(Touch::new(vertex, On::Skin, over, self.stiffness(vertex, 0.5), self.soft))
    }

    /// A vertex stays over what lies below.
    fn over_bed(&self, bed: usize, vertex: u32, x: &[Point3<f64>], look: f64) -> Option<Touch> {
        let at = x[vertex as usize];
        let on = self.model.beds[bed].nearest(&at, look)?;
        let over = Over::Plane(on.point, on.away(&at));
        Some(Touch::new(vertex, On::Bed(bed as u32), over, self.stiffness(vertex, 1.0), self.soft))
    }
}

/// How far bodies may be inside each other at rest [m], for a base [m].
pub fn deepest(base: f64) -> f64 {
    DEEP * base
}

/// Areas, none less than their mean: a small triangle at a ridge may bear as much as others.
fn at_least_mean(areas: Vec<f64>) -> impl Iterator<Item = f64> {
    let mean = areas.iter().sum::<f64>() / areas.len().max(1) as f64;
    areas.into_iter().map(move |area| area.max(mean))
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
        Self { energy, value, leash }
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
            let leash = if share < 1.0 { share * self.leash } else { 2.0 * self.leash };
            let next = Self::new(detector, x, start, leash.clamp(SHORTEST * longest, longest));
            if next.value <= self.value || share <= SHORTEST {
                return Ok(next);
            }
            share *= 0.5;
            x.iter_mut().zip(before.iter().zip(&end)).for_each(|(x, (a, b))| *x = a + (b - a) * share);
            detector.model.fill(x)?;
        }
    }
}

/// Energy [J], area [m^2] and pressure [Pa] after the last rounds.
#[derive(Default)]
struct Told(Vec<[f64; 3]>);

impl Told {
    fn tell(&mut self, energy: f64, area: f64, pressure: f64) {
        self.0.push([energy, area, pressure]);
    }

    /// Whether energy, area and pressure differ by at most these shares between the last two of so many rounds.
    fn within(&self, rounds: usize, shares: [f64; 3]) -> bool {
        let Some(first) = self.0.len().checked_sub(rounds) else { return false };
        let last = self.0[self.0.len() - 1];
        let near = |old: &[f64; 3]| (0..3).all(|k| (old[k] - last[k]).abs() <= shares[k] * last[k].abs());
        self.0[first..].iter().all(near)
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
}

impl<'a> Descent<'a> {
    fn new(model: &'a Model) -> Self {
        let held = |v: usize| model.layers.held.get(v).copied().unwrap_or(false);
        let inverse_mass = (0..model.count()).map(|v| if held(v) { 0.0 } else { 1.0 }).collect();
        let (detector, progress) = (Detector::new(model), Progress::default());
        Self { detector, newton: None, start: model.rest(), inverse_mass, progress }
    }

    /// Rounds until all is at rest, with contact lifted as it is.
    fn rounds(&mut self, x: &mut [Point3<f64>], watch: &mut dyn FnMut(&Progress) -> bool) -> Result<(), SkinError> {
        let Self { detector, newton, start, inverse_mass, progress } = self;
        let model = detector.model;
        let mut way = Way::new(detector, x, start, LEASH * model.base);
        let mut told = Told::default();
        for _ in 0..ROUNDS {
            let before = x.to_owned();
            let outcome = model.minimise(newton, way.energy, x, inverse_mass, way.leash)?;
            way = Way { energy: Energy::default(), ..way }.descend(detector, &before, x, start)?;
            progress.rounds += 1;
            progress.iterations += outcome.iterations;
            progress.residual = outcome.residual;
            progress.pressure = outcome.pressure;
            // Of an implant alone all its vertices.
            let judged = if model.layers.count() == 0 { x.len() } else { 2 * model.layers.count() };
            progress.moved = greatest(before.iter().zip(x.iter()).take(judged).map(|(a, b)| (a - b).norm()));
            told.tell(way.value, model.area(x), progress.pressure);
            let still = outcome.converged && progress.moved <= STILL * model.layers.edge && told.steady();
            progress.converged = still || told.exhausted();
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
        self.layers.rest.len() + self.implant.as_ref().map_or(0, |i| i.mesh.vertices.len())
    }

    /// Skin and implant at rest, before they touch [m].
    pub fn rest(&self) -> Vec<Point3<f64>> {
        let implant = self.implant.iter().flat_map(|i| i.mesh.vertices.iter());
        self.layers.rest.iter().chain(implant).copied().collect()
    }

    /// Greatest distance between the layers [m].
    fn depth(&self) -> f64 {
        let (upper, lower) = self.layers.rest.split_at(self.layers.count());
        greatest(upper.iter().zip(lower).map(|(u, l)| (u - l).norm()))
    }

    /// As stiff as contact over the depth of the skin.
    fn thickness(&self) -> Thickness {
        Thickness::new(&self.layers, FIRM * PENALTY * self.membrane / (self.base * self.base) * self.depth())
    }

    fn energy(&self, touching: Touching, start: &[Point3<f64>]) -> Energy {
        let mut energy = Energy::default();
        energy.elastic.push(Box::new(Elastic::new(&self.layers.springs, &self.layers.stiffness)));
        if self.layers.count() > 0 {
            energy.elastic.push(Box::new(self.thickness()));
        }
        if let Some(implant) = &self.implant {
            let mut shell = Envelope::new(implant.springs.clone(), implant.stiffness.clone());
            if self.layers.springs.is_empty() {
                shell = shell.alone();
            }
            energy.elastic.push(Box::new(shell));
            let places = implant.pocket.iter().map(|&v| (v, start[v as usize])).collect();
            energy.elastic.push(Box::new(Anchors { places, stiffness: POCKET * self.membrane }));
            energy.volume = Some(self.volume(implant));
        }
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
        mut watch: impl FnMut(&Progress) -> bool,
    ) -> Result<Progress, SkinError> {
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
            descent.detector.lift(x);
        }
        Ok(descent.progress)
    }

    /// Area of the upper layer [m^2].
    fn area(&self, x: &[Point3<f64>]) -> f64 {
        crate::mesh::measures::area(&x[..self.layers.count()], &self.layers.triangles)
    }

    /// The volume of the implant, to be kept.
    fn volume(&self, implant: &Filled) -> EnclosedVolume {
        let first = 2 * self.layers.count() as u32;
        let triangles: Vec<[u32; 3]> = implant.mesh.triangles.iter().map(|t| t.map(|v| v + first)).collect();
        EnclosedVolume::new(&triangles, self.count(), implant.volume, 0.0)
    }

    /// Brings the implant to its volume: over a bed that is not flat its shell is not quite a dome.
    fn fill(&self, x: &mut [Point3<f64>]) -> Result<(), SkinError> {
        let Some(implant) = &self.implant else { return Ok(()) };
        let volume = self.volume(implant);
        let (_, gradient) = volume.value_and_gradient(x);
        volume.retract(x, &gradient).map(|_| ()).map_err(|error| SkinError::Solver(error.to_string()))
    }

    /// A solver of this energy; the one of the round before is used again.
    fn minimise(
        &self,
        newton: &mut Option<Newton>,
        energy: Energy,
        x: &mut [Point3<f64>],
        inverse_mass: &[f64],
        leash: f64,
    ) -> Result<Outcome, SkinError> {
        let failed = |error: FactorError| SkinError::Solver(error.to_string());
        if self.method == Method::QuasiStatic {
            let settings = Settings { tolerance: TOLERANCE, iterations: INNER_QUASI_STATIC };
            let mut solver = QuasiStatic::new(energy, x, inverse_mass, settings).map_err(failed)?;
            return Ok(solver.solve(x, &mut Unguarded, |_, _| true));
        }
        match newton {
            Some(newton) => newton.renew(energy).map_err(failed)?,
            None => {
                let settings = Settings { tolerance: TOLERANCE, iterations: INNER };
                *newton = Some(Newton::new(energy, &self.rest(), inverse_mass, settings).map_err(failed)?);
            }
        }
        let from = x.to_owned();
        let near = |now: &[Point3<f64>]| from.iter().zip(now).all(|(a, b)| (a - b).norm() <= leash);
        let outcome = newton.as_mut().map(|newton| newton.solve(x, |_, now| near(now)));
        outcome.unwrap_or_else(|| Ok(Outcome::default())).map_err(failed)
    }
}
