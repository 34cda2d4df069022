//! Skin, implant and what lies under them brought to rest together.
//!
//! Rounds: find what may touch, with planes through the nearest points; minimise the energy with these planes by Newton's
//! method; until nothing moves any more. A plane that holds at rest then lies in the nearest point itself.

use nalgebra::{Point3, Vector3};

use super::SkinError;
use super::contact::{Anchors, Over, Touch, Touching};
use super::envelope::Envelope;
use super::layers::Layers;
use crate::constraints::EnclosedVolume;
use crate::constraints::distance::Distance;
use crate::contact::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::greatest;
use crate::solvers::descent::{Settings, Unguarded};
use crate::solvers::energy::Energy;
use crate::solvers::newton::Newton;
use crate::solvers::potential::Quadratic;
use crate::solvers::quasi_static::QuasiStatic;

/// The stiffness of each spring [N/m].
pub type Stiffness = Vec<f64>;

/// Contact stiffness [N/m^3] times the square of the base over the skin's in-plane stiffness: under a tension that
/// stretches skin by a third, bodies then sink into each other by less than a thousandth of the base.
const PENALTY: f64 = 30_000.0;

/// Stiffness of what keeps the base of an implant in its place, over the skin's in-plane stiffness: it only decides where
/// nothing else does, as for a turn about the axis.
const POCKET: f64 = 1e-5;

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

/// Residual force at rest, as a share of what a strain of one exerts.
const TOLERANCE: f64 = 1e-5;

/// Rounds at most, and iterations in each.
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
    pub beds: Vec<Surface>,
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
    lower: Surface,
    implant: Option<Surface>,
}

impl<'a> Detector<'a> {
    fn new(model: &'a Model) -> Self {
        let bed = model.layers.bed();
        let mut areas = vec![0.0; model.layers.count()];
        areas.extend(bed.vertex_areas());
        areas.extend(model.implant.iter().flat_map(|i| i.mesh.vertex_areas()));
        let implant = model.implant.as_ref().map(|i| Surface::new(&i.mesh));
        Self { model, areas, lower: Surface::new(&bed), implant }
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
            touches.extend(lower.map(|vertex| Touch::new(vertex, over, self.stiffness(vertex, 1.0))));
        }
        if let Some(mut implant) = self.implant.take() {
            implant.refit(&x[2 * n..]);
            self.lower.refit(&x[n..2 * n]);
            touches
                .extend((n as u32..2 * n as u32).filter(free).filter_map(|v| self.over_implant(&implant, v, x, look)));
            touches.extend((2 * n as u32..x.len() as u32).filter_map(|v| self.under_skin(v, x)));
            self.implant = Some(implant);
        }
        for bed in &self.model.beds {
            touches.extend((n as u32..x.len() as u32).filter(free).filter_map(|v| self.over_bed(bed, v, x, look)));
        }
        let radius = BENDS * self.model.base;
        touches.iter_mut().for_each(|t| *t = t.found(x, radius));
        Touching { touches }
    }

    /// A vertex of the lower layer stays out of the implant.
    fn over_implant(&self, implant: &Surface, vertex: u32, x: &[Point3<f64>], look: f64) -> Option<Touch> {
        let on = implant.nearest(&x[vertex as usize], look)?;
        let first = 2 * self.model.layers.count() as u32;
        let corners = implant.triangles()[on.triangle as usize].map(|v| v + first);
        let over = Over::Carried(corners, on.weights, on.closest.normal);
        Some(Touch::new(vertex, over, self.stiffness(vertex, 0.5)))
    }

    /// A vertex of the implant stays under the lower layer.
    fn under_skin(&self, vertex: u32, x: &[Point3<f64>]) -> Option<Touch> {
        let at = x[vertex as usize];
        let on = self.lower.nearest(&at, 2.0 * self.model.layers.edge)?;
        let first = self.model.layers.count() as u32;
        let corners = self.lower.triangles()[on.triangle as usize].map(|v| v + first);
        let normal = -away(&at, &on.closest.point, &corners.map(|v| x[v as usize]));
        Some(Touch::new(vertex, Over::Carried(corners, on.weights, normal), self.stiffness(vertex, 0.5)))
    }

    /// A vertex stays over what lies below.
    fn over_bed(&self, bed: &Surface, vertex: u32, x: &[Point3<f64>], look: f64) -> Option<Touch> {
        let at = x[vertex as usize];
        let on = bed.nearest(&at, look)?;
        let corners = bed.triangles()[on.triangle as usize].map(|v| bed.positions()[v as usize]);
        let normal = away(&at, &on.closest.point, &corners);
        Some(Touch::new(vertex, Over::Plane(on.closest.point, normal), self.stiffness(vertex, 1.0)))
    }
}

/// The unit direction out of a surface of which one side counts as outside, through a point and the one nearest to it.
fn away(at: &Point3<f64>, nearest: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> Vector3<f64> {
    let (u, v) = (b - a, c - a);
    let face = u.cross(&v).try_normalize(0.0).unwrap_or_else(Vector3::z);
    let from = at - nearest;
    // Nearer than this the direction is rounding.
    if from.norm() <= 1e-6 * (u.norm() + v.norm()) {
        return face;
    }
    let sign = if from.dot(&face) < 0.0 { -1.0 } else { 1.0 };
    from.normalize() * sign
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

    fn energy(&self, touching: Touching, start: &[Point3<f64>]) -> Energy {
        let springs = Quadratic::<Distance, 2>::new(self.layers.springs.clone(), self.layers.stiffness.clone());
        let mut energy = Energy::default();
        energy.elastic.push(Box::new(springs));
        if let Some(implant) = &self.implant {
            let shell = Envelope::new(implant.springs.clone(), implant.stiffness.clone());
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
        let inverse_mass: Vec<f64> = (0..self.count())
            .map(|v| if self.layers.held.get(v).copied().unwrap_or(false) { 0.0 } else { 1.0 })
            .collect();
        let start = self.rest();
        self.fill(x)?;
        let mut detector = Detector::new(self);
        let mut progress = Progress::default();
        for round in 1..=ROUNDS {
            let before = x.to_owned();
            let (old_area, old_pressure) = (self.area(x), progress.pressure);
            let energy = self.energy(detector.touching(x), &start);
            let outcome = self.minimise(energy, x, &inverse_mass)?;
            progress.rounds = round;
            progress.iterations += outcome.iterations;
            progress.residual = outcome.residual;
            progress.pressure = outcome.pressure;
            progress.moved =
                greatest(before.iter().zip(x.iter()).take(2 * self.layers.count()).map(|(a, b)| (a - b).norm()));
            let steady = |old: f64, new: f64| (new - old).abs() <= STEADY * new.abs();
            progress.converged = outcome.converged
                && progress.moved <= STILL * self.layers.edge
                && steady(old_area, self.area(x))
                && steady(old_pressure, progress.pressure);
            if progress.converged {
                break;
            }
            if !watch(&progress) {
                return Err(SkinError::Stopped);
            }
        }
        progress.depth = detector.touching(x).depth(x);
        Ok(progress)
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

    fn minimise(
        &self,
        energy: Energy,
        x: &mut [Point3<f64>],
        inverse_mass: &[f64],
    ) -> Result<crate::solvers::descent::Outcome, SkinError> {
        let failed = |error: crate::solvers::sparse::FactorError| SkinError::Solver(error.to_string());
        match self.method {
            Method::Newton => {
                let settings = Settings { tolerance: TOLERANCE, iterations: INNER };
                let mut newton = Newton::new(energy, x, inverse_mass, settings).map_err(failed)?;
                newton.solve(x, |_, _| true).map_err(failed)
            }
            Method::QuasiStatic => {
                let settings = Settings { tolerance: TOLERANCE, iterations: INNER_QUASI_STATIC };
                let mut solver = QuasiStatic::new(energy, x, inverse_mass, settings).map_err(failed)?;
                Ok(solver.solve(x, &mut Unguarded, |_, _| true))
            }
        }
    }
}
