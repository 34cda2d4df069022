//! A muscle prepared for the simulation, with only the effects of its plan.

mod builder;
mod given;

use std::sync::Arc;

use nalgebra::Vector3;

pub(super) use builder::Builder;
pub(super) use given::attach;
use given::{displace, forces, hold};

use super::assets::Assets;
use super::carriage::Carriage;
use super::contraction::Contraction;
use super::equilibrium::Equilibrium;
use super::fascia::Ties;
use super::fault::{Fault, LoadError};
use super::fibres::{self, Ends};
use super::frame::FrameSteps;
use super::plan::MusclePlan;
use super::ready::{Fibres, Rest};
use super::tracked::Tracked;
use crate::constraints::distance::Distance;
use crate::constraints::{Potential, Project};
use crate::contact::untangle::Untangled;
use crate::contact::{Contacts, PosedObstacle, Surface};
use crate::fibres::binding::BoundLines;
use crate::mesh::TriangleMesh;
use crate::mesh::topology::Topology;
use crate::particles::Particles;
use crate::scene::{ContactEffect, Mass, Muscle, Scene};
use crate::simulation::attachments::Attached;
use crate::solvers::sparse::FactorError;
use crate::solvers::viscosity::Viscosity;
use crate::solvers::{Broken, StepSettings, System, stiffness};
use crate::state::{DecodeError, Reader, State, Writer};

/// Greatest speed of a muscle vertex, in muscle lengths per second.
const SPEED_LIMIT: f64 = 200.0;

/// An edge of this multiple of the muscle's rest length is torn.
const TORN: f64 = 10.0;

/// How a step computes the positions of a muscle.
pub enum Stepper {
    /// Sweeps over constraints.
    Sweeps,
    /// The minimum of an energy.
    Minimum(Box<Equilibrium>),
    /// The shape nearest to a prescribed one.
    Tracked(Box<Tracked>),
}

/// A muscle in the simulation.
pub struct Body {
    /// Name of the muscle.
    pub name: String,
    /// State and effects.
    pub system: System,
    /// Surface at rest, after the removal of overlap.
    pub rest: TriangleMesh,
    /// Edges with their rest lengths [m].
    pub edges: Vec<Distance>,
    /// How a step computes its positions.
    pub method: Stepper,
    /// Vertices attached to bones.
    pub attached: Vec<Attached>,
    /// Fibres bound to the surface.
    pub fibres: BoundLines,
    /// Shortening of the fibres.
    pub(super) contraction: Contraction,
    /// What fascia holds.
    pub(super) ties: Ties,
    /// How bones carry it along.
    pub(super) carriage: Carriage,
    /// Dampers between neighbours.
    pub(super) viscosity: Option<Viscosity>,
    /// Measures of the removal of overlap.
    pub untangled: Untangled,
    /// Target volume [m^3]; 0 without a volume constraint.
    pub target_volume: f64,
    /// Enclosed volume of the rest surface [m^3].
    pub rest_volume: f64,
    /// Greatest extent at rest [m].
    pub length: f64,
    /// Median rest length of the edges [m].
    pub edge_length: f64,
    /// Frame and cause of a stop.
    pub stopped: Option<(usize, Broken)>,
    /// True if edges resist stretching.
    pub(super) resists_stretch: bool,
    /// Whether pairs of triangles keep a minimum without a neighbour apart: it crossed something.
    pub(super) in_pairs: bool,
    /// A vertex that jumped in the present frame.
    pub(super) jump: Option<usize>,
    /// Positions and velocities at the end of the last valid frame.
    pub(super) good: Particles,
}

impl Body {
    /// Creates a muscle with its attached vertices and its shape at the start; `placed` are all
    /// obstacles at frame 0.
    ///
    /// # Errors
    /// A force or displacement of a vertex that does not exist, or an impossible equilibrium.
    pub(super) fn new(
        scene: &Scene,
        assets: &Assets,
        m: usize,
        plan: &MusclePlan,
        placed: &[PosedObstacle],
        (attached, rest, untangled): (Vec<Attached>, Arc<Rest>, Untangled),
    ) -> Result<Self, LoadError> {
        let (muscle, asset) = (&scene.muscles[m], &assets.muscles[m]);
        let (mesh, topology) = (&rest.mesh, &*rest.topology());
        let particles = particles_at_rest(scene, m, mesh, &attached, plan)?;
        let length = mesh.length();
        let substeps = scene.solver.substeps();
        let mut system = System::new(particles, settings(scene, length, substeps))
            .with_numbering((*rest.numbering()).clone());
        let (edges, edge_stiffness) =
            edges_of(mesh, topology, &asset.edges, muscle.material.stretch);
        let of_fibres = (&*rest, attached.as_slice(), placed);
        let (fibres, contraction) =
            contracting(scene, assets, m, plan, of_fibres, (&edges, &edge_stiffness))?;
        system.held = hold(&attached, mesh, placed);
        system.forces = forces(scene, m, mesh.vertices.len())?;
        let both = (edges.as_slice(), &contraction);
        let ties = Ties::new(scene, plan, &rest, &system.particles, placed);
        let with = (&*fibres, &ties);
        let mut builder = Builder::new(scene, m, plan, &rest, both, &edge_stiffness, with);
        builder.build();
        let (rest_volume, target_volume) = (builder.rest_volume, builder.target_volume);
        (system.volume, system.elastic) = (builder.volume, builder.elastic);
        let method = method(scene, &mut system, builder.potentials)
            .map_err(|error| unsolvable(scene, m, error))?;
        if let (Some(contact), false) = (scene.effects.contact, plan.obstacles.is_empty()) {
            let obstacles = &plan.obstacles;
            let found = contacts(&rest, &system.particles, placed, obstacles, contact);
            system.contacts = Some(found);
        }
        let carriage = Carriage::new(scene, plan, &rest, &attached, placed);
        let dampers = (edges.as_slice(), edge_stiffness.as_slice());
        let viscosity = viscosity(scene, &system.particles, dampers)
            .map_err(|error| unsolvable(scene, m, error))?;
        let lengths = edges.iter().map(|e| e.rest).collect();
        Ok(Self {
            name: muscle.name.clone(),
            good: system.particles.clone(),
            resists_stretch: plan.runs("stretch"),
            system,
            edge_length: crate::mesh::measures::median(lengths).unwrap_or(length),
            edges,
            method,
            attached,
            fibres: fibres.bound.clone(),
            contraction,
            ties,
            carriage,
            viscosity,
            untangled,
            target_volume,
            rest_volume,
            length,
            rest: mesh.clone(),
            stopped: None,
            in_pairs: false,
            jump: None,
        })
    }

    /// Makes a step of `dt` [s] while the bones move to their poses in `placed`.
    ///
    /// # Errors
    /// A number that is not finite appeared.
    pub(super) fn step(
        &mut self,
        placed: &[PosedObstacle],
        of: &FrameSteps<'_>,
    ) -> Result<(), Broken> {
        let begin = std::time::Instant::now();
        let done = match &mut self.method {
            Stepper::Tracked(tracked) => tracked.step(&mut self.system, placed),
            Stepper::Minimum(equilibrium) => equilibrium.step(&mut self.system, placed, of),
            Stepper::Sweeps => {
                let is_stopped = || of.stop.is_asked();
                return self.system.step_unless(placed, of.dt, &is_stopped);
            }
        };
        self.system.clock.note("equilibrium", begin);
        done
    }

    /// Its equilibrium, if a step is the minimum of an energy.
    #[must_use]
    pub fn equilibrium(&self) -> Option<&Equilibrium> {
        match &self.method {
            Stepper::Minimum(equilibrium) => Some(equilibrium),
            Stepper::Sweeps | Stepper::Tracked(_) => None,
        }
    }

    /// As [`Body::equilibrium`], to be changed between steps.
    pub(super) fn equilibrium_mut(&mut self) -> Option<&mut Equilibrium> {
        match &mut self.method {
            Stepper::Minimum(equilibrium) => Some(equilibrium),
            Stepper::Sweeps | Stepper::Tracked(_) => None,
        }
    }

    /// Estimated RMS error of the solver over the vertices [m], from the greatest residual [m]. A
    /// residual adds up along a muscle, so it is multiplied by twice the number of edges along the
    /// length.
    pub fn error_estimate(&self, residual_max_m: f64) -> f64 {
        2.0 * self.length / self.edge_length * residual_max_m
    }

    /// A torn vertex: of an edge that is so distant that its length is rounding error or, if stretch
    /// acts, longer than ten times the muscle at rest. Contact with such triangles would take minutes
    /// per frame.
    pub fn torn(&self) -> Option<usize> {
        let most = if self.resists_stretch {
            TORN * self.length
        } else {
            f64::MAX
        };
        let x = &self.system.particles.position;
        let is_torn = |e: &&Distance| {
            let [a, b] = e.points.map(|p| x[p as usize]);
            let reach = (a - b).norm();
            // Not `>`, which is false for NaN.
            !(reach <= most) || !(a.coords.amax() * f64::EPSILON <= 1e-3 * self.edge_length)
        };
        self.edges
            .iter()
            .find(is_torn)
            .map(|e| e.points[0] as usize)
    }

    /// Number of vertices.
    pub(super) fn count(&self) -> usize {
        self.system.particles.len()
    }

    /// Sum over the vertices of the squared distance from the same muscle elsewhere [m^2].
    pub(super) fn squared_distance(&self, other: &Self) -> f64 {
        let (a, b) = (&self.system.particles, &other.system.particles);
        let each = a.position.iter().zip(&b.position);
        each.map(|(a, b)| (a - b).norm_squared()).sum()
    }

    /// True if vertex `v` is not fixed by a bone.
    pub fn is_free(&self, v: usize) -> bool {
        self.system.particles.inverse_mass[v] > 0.0
    }
}

/// State for checkpoints: see [`crate::simulation::checkpoint`].
impl Body {
    pub(super) fn save(&self, to: &mut Writer) {
        let Self {
            name: _,
            system,
            rest: _,
            edges: _,
            method,
            attached: _,
            fibres: _,
            contraction,
            // Found anew at the start of each frame.
            ties: _,
            carriage: _,
            viscosity: _,
            untangled: _,
            target_volume: _,
            rest_volume: _,
            length: _,
            edge_length: _,
            stopped,
            resists_stretch: _,
            in_pairs,
            // Only within a frame.
            jump: _,
            good,
        } = self;
        system.save(to);
        to.put(
            &system
                .contacts
                .as_ref()
                .map(|contacts| contacts.obstacles().to_vec()),
        );
        system
            .contacts
            .iter()
            .for_each(|contacts| contacts.save(to));
        if let Stepper::Minimum(equilibrium) = method {
            equilibrium.save(to);
        }
        contraction.save(to);
        to.put(in_pairs);
        to.put(stopped);
        // A frame ends with both equal, unless particles were moved since.
        let differs = !same_bits(good, &system.particles);
        to.put(&differs);
        if differs {
            good.save(to);
        }
    }

    /// Sets the shortening of the fibres among obstacles at `placed`, if they shorten.
    pub(super) fn shorten(&mut self, time: f64, done: f64, placed: &[PosedObstacle]) {
        let Some(by) = self.contraction.at(time, done) else {
            return;
        };
        self.each_part(|part| part.shorten(by), |part| part.shorten(by));
        let along = self.contraction.turned(placed);
        self.each_part(|part| part.turn(&along), |part| part.turn(&along));
    }

    /// Changes each of its constraints, and each part of its energy.
    pub(super) fn each_part(
        &mut self,
        swept: impl Fn(&mut dyn Project),
        minimised: impl Fn(&mut dyn Potential),
    ) {
        let parts = self.system.elastic.iter_mut();
        parts.for_each(|part| swept(part.as_mut()));
        if let Some(equilibrium) = self.equilibrium_mut() {
            let parts = equilibrium.energy_mut().elastic.iter_mut();
            parts.for_each(|part| minimised(part.as_mut()));
        }
    }

    /// Restores the state among obstacles at the poses `placed`.
    pub(super) fn restore(
        &mut self,
        from: &mut Reader<'_>,
        placed: &[PosedObstacle],
        contact: Option<ContactEffect>,
        frame: usize,
    ) -> Result<(), DecodeError> {
        self.system.restore(from)?;
        self.restore_contact(from, placed, contact)?;
        if let Some(equilibrium) = self.equilibrium_mut() {
            equilibrium.restore(from)?;
        }
        self.contraction.restore(from)?;
        self.shorten(frame as f64, 1.0, placed);
        self.in_pairs = from.take()?;
        self.stopped = from.take()?;
        if from.take()? {
            self.good.restore(from)?;
            return from.check(
                !same_bits(&self.good, &self.system.particles),
                "the same particles twice",
            );
        }
        self.good.clone_from(&self.system.particles);
        Ok(())
    }

    /// Creates the contact with obstacles outside the plan, if the saved state has them.
    fn restore_contact(
        &mut self,
        from: &mut Reader<'_>,
        placed: &[PosedObstacle],
        contact: Option<ContactEffect>,
    ) -> Result<(), DecodeError> {
        let obstacles: Option<Vec<usize>> = from.take()?;
        let System {
            contacts,
            particles,
            ..
        } = &mut self.system;
        if contacts.as_ref().map(Contacts::obstacles) != obstacles.as_deref() {
            let Some((contact, obstacles)) = contact
                .zip(obstacles)
                .filter(|_| !self.rest.triangles.is_empty())
            else {
                return Err(from.corrupt("contact where there can be none"));
            };
            let sound =
                obstacles.is_sorted_by(|a, b| a < b) && obstacles.iter().all(|&o| o < placed.len());
            from.check(sound, "contact with what is not there")?;
            let ContactEffect {
                thickness,
                friction,
                ..
            } = contact;
            *contacts = Some(Contacts::new(
                &self.rest, particles, placed, obstacles, thickness, friction,
            ));
        }
        contacts
            .iter_mut()
            .try_for_each(|contacts| contacts.restore(from))
    }
}

fn same_bits(a: &Particles, b: &Particles) -> bool {
    let same = |a: &Vector3<f64>, b: &Vector3<f64>| {
        a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
    };
    let positions = a
        .position
        .iter()
        .zip(&b.position)
        .all(|(a, b)| same(&a.coords, &b.coords));
    positions && a.velocity.iter().zip(&b.velocity).all(|(a, b)| same(a, b))
}

/// The particles at the start: those that are held or fixed have no inverse mass.
fn particles_at_rest(
    scene: &Scene,
    m: usize,
    mesh: &TriangleMesh,
    attached: &[Attached],
    plan: &MusclePlan,
) -> Result<Particles, LoadError> {
    let masses = inverse_masses(&scene.muscles[m], mesh);
    let mut particles = Particles::at_rest(mesh.vertices.clone(), masses);
    for &(vertex, _) in attached {
        particles.inverse_mass[vertex as usize] = 0.0;
    }
    for &vertex in &plan.fixed {
        if let Some(inverse) = particles.inverse_mass.get_mut(vertex as usize) {
            *inverse = 0.0;
        }
    }
    displace(scene, m, &mut particles)?;
    Ok(particles)
}

/// Contact at the start; the nearest points are already known, unless vertices are displaced.
fn contacts(
    rest: &Rest,
    particles: &Particles,
    placed: &[PosedObstacle],
    obstacles: &[usize],
    contact: ContactEffect,
) -> Contacts {
    let is_at_rest = particles.position == rest.mesh.vertices;
    let near: Vec<_> = match is_at_rest {
        true => obstacles
            .iter()
            .map(|&o| (o, rest.near(&placed[o].obstacle, &placed[o].now)))
            .collect(),
        false => Vec::new(),
    };
    let of = |o: usize| {
        near.iter()
            .find(|(known, _)| *known == o)
            .map(|(_, near)| near.closest.as_slice())
    };
    let ContactEffect {
        thickness,
        friction,
        ..
    } = contact;
    let surface = Surface::clone(&rest.surface());
    Contacts::known(
        surface,
        particles,
        placed,
        obstacles.to_vec(),
        (thickness, friction),
        of,
    )
}

/// The dampers of a muscle, if the scene has some. Classic PBD has no stiffness for them.
fn viscosity(
    scene: &Scene,
    particles: &Particles,
    (edges, stiffness): (&[Distance], &[f64]),
) -> Result<Option<Viscosity>, FactorError> {
    let (solver, time) = (&scene.solver, scene.effects.retardation);
    let has_any = time > 0.0 && solver.has_inertia() && !solver.has_classic_stiffness();
    if !has_any || edges.is_empty() {
        return Ok(None);
    }
    Viscosity::new(particles.position.len(), edges, stiffness, time).map(Some)
}

/// The error for a muscle without a computable equilibrium.
fn unsolvable(scene: &Scene, m: usize, error: FactorError) -> LoadError {
    let part = format!("muscle `{}`", scene.muscles[m].name);
    let fault = match error {
        FactorError::NotPositiveDefinite { .. } => Fault::Unheld,
        FactorError::OutOfMemory { bytes } => Fault::FactorTooLarge { bytes },
    };
    LoadError::new(scene, "solver.quasi_static", part, fault)
}

/// The settings of steps of which a frame has `substeps`, for a muscle of this length [m].
pub(super) fn settings(scene: &Scene, length: f64, substeps: u32) -> StepSettings {
    let own = scene.solver.velocity_damping();
    let per_frame = own.unwrap_or(1.0);
    let dt = time_step(scene, substeps);
    let damping = scene.effects.damping.unwrap_or(0.0);
    let velocity_factor =
        libm::exp(-damping * dt) * libm::pow(per_frame, 1.0 / f64::from(substeps));
    StepSettings {
        iterations: scene.solver.iterations(),
        gravity: scene.effects.gravity.unwrap_or_else(Vector3::zeros),
        velocity_factor,
        force_factor: if own.is_some() { velocity_factor } else { 1.0 },
        speed_limit: SPEED_LIMIT * length,
    }
}

/// Length of a step [s] of which a frame has `substeps`.
pub(super) fn time_step(scene: &Scene, substeps: u32) -> f64 {
    1.0 / (scene.frame_rate * f64::from(substeps))
}

/// The fibres of a muscle, and how they shorten.
fn contracting(
    scene: &Scene,
    assets: &Assets,
    m: usize,
    plan: &MusclePlan,
    (rest, attached, placed): (&Rest, &[Attached], &[PosedObstacle]),
    (edges, stiffness): (&[Distance], &[f64]),
) -> Result<(Arc<Fibres>, Contraction), LoadError> {
    let (muscle, asset) = (&scene.muscles[m], &assets.muscles[m]);
    let unfit = |key: &str, fault| {
        let part = format!("muscle `{}`", muscle.name);
        LoadError::new(scene, key, part, fault)
    };
    let points: Vec<[u32; 2]> = edges.iter().map(|e| e.points).collect();
    let ends = Ends::of(&rest.mesh, attached);
    let fibres = fibres::of_muscle(muscle, asset, rest, ends.as_ref(), &points)
        .map_err(|fault| unfit(&format!("muscle.{m}.fibres"), fault))?;
    let at = (ends.as_ref(), placed);
    let contraction = Contraction::new(scene, muscle, plan, rest, (edges, stiffness), &fibres, at)
        .map_err(|fault| unfit("effects.tone", fault))?;
    Ok((fibres, contraction))
}

fn edges_of(
    mesh: &TriangleMesh,
    topology: &Topology,
    extra: &[[u32; 2]],
    membrane: f64,
) -> (Vec<Distance>, Vec<f64>) {
    let (mut edges, mut k) = stiffness::edges(mesh, topology, membrane);
    for &points in extra {
        let [a, b] = points.map(|p| mesh.vertices[p as usize]);
        edges.push(Distance {
            points,
            rest: (a - b).norm(),
        });
        k.push(membrane);
    }
    (edges, k)
}

/// The method of the scene's solver.
fn method(
    scene: &Scene,
    system: &mut System,
    potentials: Vec<Box<dyn Potential>>,
) -> Result<Stepper, FactorError> {
    let Some(settings) = scene.solver.minimisation() else {
        return Ok(Stepper::Sweeps);
    };
    let step = scene
        .solver
        .has_inertia()
        .then(|| time_step(scene, scene.solver.substeps()));
    let begin = std::time::Instant::now();
    let volume = system.volume.clone();
    let made = Equilibrium::new(
        (potentials, volume),
        &system.particles,
        &system.forces,
        &scene.effects,
        settings,
        step,
    )?;
    system.clock.note("equilibrium", begin);
    Ok(Stepper::Minimum(Box::new(made)))
}

fn inverse_masses(muscle: &Muscle, mesh: &TriangleMesh) -> Vec<f64> {
    let count = mesh.vertices.len();
    match muscle.material.mass {
        Mass::PerVertex(mass) => vec![1.0 / mass; count],
        Mass::Density(density) => {
            let areas = mesh.vertex_areas();
            let total: f64 = crate::mesh::sum::tree_sum(&areas);
            // An open or flat surface encloses no volume: assumes a thickness of a tenth of its
            // size.
            let volume = mesh.volume();
            let volume = if volume > 0.0 {
                volume
            } else {
                0.1 * total * total.sqrt()
            };
            areas
                .iter()
                .map(|a| total / (density * volume * a))
                .map(|w| if w.is_finite() { w } else { 0.0 })
                .collect()
        }
    }
}
