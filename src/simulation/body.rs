//! A muscle prepared for the simulation, with only the effects of its plan.

use std::sync::Arc;

use nalgebra::Vector3;

use super::assets::Assets;
use super::effects::MODELS;
use super::equilibrium::Equilibrium;
use super::fault::{Fault, LoadError};
use super::plan::MusclePlan;
use super::ready::{Fibres, Rest};
use super::tracked::Tracked;
use crate::constraints::distance::Distance;
use crate::constraints::{Batch, Constraint, EnclosedVolume, Project};
use crate::constraints::{Potential, Quadratic};
use crate::contact::untangle::Untangled;
use crate::contact::{Contacts, Obstacle, PosedObstacle, Surface};
use crate::fibres::binding::BoundLines;
use crate::mesh::TriangleMesh;
use crate::mesh::topology::Topology;
use crate::muscles::attachments::{self, Attached};
use crate::particles::Particles;
use crate::scene::{Area, ContactEffect, Mass, Muscle, Scene};
use crate::solvers::sparse::FactorError;
use crate::solvers::{Broken, Held, Settings, System, stiffness};
use crate::state::{Corrupt, Reader, State, Writer};

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
    resists_stretch: bool,
    /// Positions and velocities at the end of the last valid frame.
    pub(super) good: Particles,
}

impl Body {
    /// Creates a muscle; `placed` are all obstacles at frame 0.
    ///
    /// # Errors
    /// An attachment with no vertices, too many, or vertices that do not exist.
    pub fn new(
        scene: &Scene,
        assets: &Assets,
        m: usize,
        plan: &MusclePlan,
        placed: &[PosedObstacle],
    ) -> Result<Self, LoadError> {
        let (muscle, asset) = (&scene.muscles[m], &assets.muscles[m]);
        let mut rest = assets.ready.rest(&asset.mesh);
        let attached = attach(scene, m, &rest, assets, placed)?;
        let mut untangled = Untangled::default();
        if let Some(mesh) = &plan.rest {
            rest = assets.ready.rest(mesh);
        } else if let (Some(contact), false) = (scene.effects.contact, plan.obstacles.is_empty()) {
            let clear = assets
                .ready
                .clear(&rest, placed, &plan.obstacles, contact.thickness);
            (rest, untangled) = (clear.rest.clone(), clear.done);
        }
        let (mesh, topology) = (&rest.mesh, &*rest.topology());
        let mut particles = Particles::at_rest(mesh.vertices.clone(), inverse_masses(muscle, mesh));
        attached
            .iter()
            .for_each(|&(v, _)| particles.inverse_mass[v as usize] = 0.0);
        let count = mesh.vertices.len();
        plan.fixed
            .iter()
            .filter(|v| (**v as usize) < count)
            .for_each(|&v| particles.inverse_mass[v as usize] = 0.0);
        displace(scene, m, &mut particles)?;
        let length = mesh.length();
        let numbering = &*rest.numbering();
        let mut system =
            System::new(particles, settings(scene, length)).with_numbering(numbering.clone());
        let (edges, edge_stiffness) =
            edges_of(mesh, topology, &asset.edges, muscle.material.stretch);
        let points: Vec<[u32; 2]> = edges.iter().map(|e| e.points).collect();
        let fibres = rest.fibres(&asset.fibres, &points);
        let loaded = loaded_vertices(muscle);
        let rest_volume = if topology.is_closed() {
            mesh.volume()
        } else {
            0.0
        };
        let pressure = scene.effects.volume.map_or(1.0, |v| v.pressure);
        let target_volume = if plan.runs("volume") {
            pressure * rest_volume
        } else {
            0.0
        };
        system.held = hold(&attached, mesh, placed);
        system.forces = forces(scene, m, count)?;
        let mut builder = Builder {
            scene,
            muscle,
            plan,
            rest: &rest,
            edges: &edges,
            edge_stiffness: &edge_stiffness,
            fibres: &fibres,
            loaded: &loaded,
            target_volume,
            rest_volume,
            volume: None,
            elastic: Vec::new(),
            potentials: Vec::new(),
        };
        builder.build();
        let Builder {
            volume,
            elastic,
            potentials,
            ..
        } = builder;
        (system.volume, system.elastic) = (volume, elastic);
        let method =
            method(scene, &mut system, potentials).map_err(|error| unsolvable(scene, m, error))?;
        if let (Some(contact), false) = (scene.effects.contact, plan.obstacles.is_empty()) {
            system.contacts = Some(contacts(
                &rest,
                &system.particles,
                placed,
                &plan.obstacles,
                contact,
            ));
        }
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
            untangled,
            target_volume,
            rest_volume,
            length,
            rest: mesh.clone(),
            stopped: None,
        })
    }

    /// Makes a step of `dt` [s] while the bones move to their poses in `placed`.
    ///
    /// # Errors
    /// A number that is not finite appeared.
    pub(super) fn step(&mut self, placed: &[PosedObstacle], dt: f64) -> Result<(), Broken> {
        let begin = std::time::Instant::now();
        let done = match &mut self.method {
            Stepper::Tracked(tracked) => tracked.step(&mut self.system, placed),
            Stepper::Minimum(equilibrium) => equilibrium.step(&mut self.system, placed, dt),
            Stepper::Sweeps => return self.system.step(placed, dt),
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

    /// A torn vertex, if stretch acts: an edge is longer than ten times the muscle at rest, or so
    /// distant that its length is rounding error. Contact with such triangles would take minutes
    /// per frame.
    pub fn torn(&self) -> Option<usize> {
        if !self.resists_stretch {
            return None;
        }
        let x = &self.system.particles.position;
        let is_torn = |e: &&Distance| {
            let [a, b] = e.points.map(|p| x[p as usize]);
            let reach = (a - b).norm();
            // Not `>`, which is false for NaN.
            !(reach <= TORN * self.length)
                || !(a.coords.amax() * f64::EPSILON <= 1e-3 * self.edge_length)
        };
        self.edges
            .iter()
            .find(is_torn)
            .map(|e| e.points[0] as usize)
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
            untangled: _,
            target_volume: _,
            rest_volume: _,
            length: _,
            edge_length: _,
            stopped,
            resists_stretch: _,
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
        to.put(stopped);
        // A frame ends with both equal, unless particles were moved since.
        let differs = !same_bits(good, &system.particles);
        to.put(&differs);
        if differs {
            good.save(to);
        }
    }

    /// Restores the state among obstacles at the poses `placed`.
    pub(super) fn restore(
        &mut self,
        from: &mut Reader<'_>,
        placed: &[PosedObstacle],
        contact: Option<ContactEffect>,
    ) -> Result<(), Corrupt> {
        self.system.restore(from)?;
        self.restore_contact(from, placed, contact)?;
        if let Some(equilibrium) = self.equilibrium_mut() {
            equilibrium.restore(from)?;
        }
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
    ) -> Result<(), Corrupt> {
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

/// The error for a muscle without a computable equilibrium.
fn unsolvable(scene: &Scene, m: usize, error: FactorError) -> LoadError {
    let part = format!("muscle `{}`", scene.muscles[m].name);
    let fault = match error {
        FactorError::NotPositiveDefinite { .. } => Fault::Unheld,
        FactorError::OutOfMemory { bytes } => Fault::FactorTooLarge { bytes },
    };
    LoadError::new(scene, "solver.quasi_static", part, fault)
}

fn settings(scene: &Scene, length: f64) -> Settings {
    let (substeps, iterations) = (scene.solver.substeps(), scene.solver.iterations());
    let own = scene.solver.velocity_damping();
    let per_frame = own.unwrap_or(1.0);
    let dt = time_step(scene);
    let damping = scene.effects.damping.unwrap_or(0.0);
    let velocity_factor =
        libm::exp(-damping * dt) * libm::pow(per_frame, 1.0 / f64::from(substeps));
    Settings {
        iterations,
        gravity: scene.effects.gravity.unwrap_or_else(Vector3::zeros),
        velocity_factor,
        force_factor: if own.is_some() { velocity_factor } else { 1.0 },
        speed_limit: SPEED_LIMIT * length,
    }
}

/// Length of a step [s].
fn time_step(scene: &Scene) -> f64 {
    1.0 / (scene.frame_rate * f64::from(scene.solver.substeps()))
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

/// A muscle whose effects are being built: each effect reads what the muscle is made of and adds a part.
pub(super) struct Builder<'a> {
    pub scene: &'a Scene,
    pub muscle: &'a Muscle,
    pub plan: &'a MusclePlan,
    pub rest: &'a Rest,
    pub edges: &'a [Distance],
    /// Stiffness of the edges [N/m].
    pub edge_stiffness: &'a [f64],
    pub fibres: &'a Fibres,
    /// Vertices that forces or displacements act on.
    loaded: &'a [u32],
    /// Volume to keep [m^3].
    pub target_volume: f64,
    /// Volume at rest [m^3].
    pub rest_volume: f64,
    /// The enclosed volume, where it is kept.
    pub volume: Option<EnclosedVolume>,
    /// Constraints of a solver that sweeps.
    elastic: Vec<Box<dyn Project>>,
    /// Energies of a solver that minimises.
    potentials: Vec<Box<dyn Potential>>,
}

impl Builder<'_> {
    fn build(&mut self) {
        for model in &MODELS {
            if let Some(build) = model.build.filter(|_| self.plan.runs(model.key)) {
                build(self);
            }
        }
    }

    /// Adds constraints with their stiffness, as batch or as energy, whichever the solver takes.
    pub fn add<C: Constraint<K> + 'static, const K: usize>(
        &mut self,
        constraints: Vec<C>,
        stiffness: Vec<f64>,
    ) {
        if self.scene.solver.minimisation().is_none() {
            let compliance = stiffness::compliance(&stiffness);
            let batch = self.batch(constraints, compliance);
            self.elastic.push(Box::new(batch));
        } else if !constraints.is_empty() {
            let energy = Quadratic::<C, K>::new(constraints, stiffness);
            self.potentials.push(Box::new(energy));
        }
    }

    /// Adds constraints that are projected by a share of their own, 0..1, each.
    pub fn add_relaxed<C: Constraint<K> + 'static, const K: usize>(
        &mut self,
        constraints: Vec<C>,
        relaxation: &[f64],
    ) {
        let compliance = vec![0.0; constraints.len()];
        let batch = self.batch(constraints, compliance);
        self.elastic
            .push(Box::new(batch.with_relaxation(relaxation)));
    }

    fn batch<C: Constraint<K>, const K: usize>(
        &self,
        constraints: Vec<C>,
        compliance: Vec<f64>,
    ) -> Batch<C, K> {
        let count = self.rest.mesh.vertices.len();
        let numbering = self.rest.numbering();
        let order = self.scene.solver.order();
        let particles = (&*numbering, count);
        Batch::numbered(constraints, compliance, order, particles, self.loaded)
    }
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
    let step = scene.solver.has_inertia().then(|| time_step(scene));
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

fn attach(
    scene: &Scene,
    m: usize,
    rest: &Rest,
    assets: &Assets,
    placed: &[PosedObstacle],
) -> Result<Vec<Attached>, LoadError> {
    let (muscle, mesh) = (&scene.muscles[m], &rest.mesh);
    let mut choices = Vec::new();
    for (a, (attachment, patch)) in muscle
        .attachments
        .iter()
        .zip(&assets.patches[m])
        .enumerate()
    {
        let bone = attachment.bone;
        let part = || {
            format!(
                "attachment of muscle `{}` to `{}`",
                muscle.name, placed[bone].name
            )
        };
        let key = format!("muscle.{m}.attachment.{a}");
        let obstacle = match patch {
            Some(patch) => assets.ready.surface(patch) as Arc<dyn Obstacle>,
            None => placed[bone].obstacle.clone(),
        };
        let near = || rest.near(&obstacle, &placed[bone].now);
        let found = match (&attachment.area, patch) {
            (Area::Vertices(list), _) => {
                check_indices(list, mesh.vertices.len(), muscle.edge_length.is_some()).map_err(
                    |(at, fault)| {
                        LoadError::new(scene, &format!("{key}.vertices.{at}"), part(), fault)
                    },
                )?;
                list.clone()
            }
            (Area::Near(within), _) => {
                attachments::among(&near().closest, true, *within, attachment.limit)
            }
            (Area::Patch { within, .. }, Some(_)) => {
                attachments::among(&near().closest, false, *within, attachment.limit)
            }
            (Area::Patch { .. }, None) => Vec::new(),
        };
        if found.is_empty() {
            let near = near();
            let distances = near.closest.iter().flatten().map(|c| c.distance.abs());
            let nearest_mm = distances.fold(f64::INFINITY, f64::min) * 1e3;
            let area = if patch.is_some() { "within" } else { "near" };
            let fault = Fault::NothingAttached { nearest_mm };
            return Err(LoadError::new(
                scene,
                &format!("{key}.{area}"),
                part(),
                fault,
            ));
        }
        choices.push((bone, found));
    }
    let attached = attachments::join(&choices);
    let count = mesh.vertices.len();
    // A body of few points (the tetrahedron scenes) can be held deliberately.
    if attached.len() as f64 > scene.most_held * count as f64 && count > 100 {
        let fault = Fault::TooManyAttached {
            held: attached.len(),
            count,
        };
        return Err(LoadError::new(
            scene,
            &format!("muscle.{m}.attachment"),
            format!("muscle `{}`", muscle.name),
            fault,
        ));
    }
    Ok(attached)
}

/// Rejects an index beyond the mesh, with its position in the list.
fn check_indices(list: &[u32], count: usize, refined: bool) -> Result<(), (usize, Fault)> {
    match list.iter().position(|&v| v as usize >= count) {
        Some(at) => Err((
            at,
            Fault::NoSuchVertex {
                index: list[at],
                count,
                refined,
            },
        )),
        None => Ok(()),
    }
}

fn hold(attached: &[Attached], mesh: &TriangleMesh, placed: &[PosedObstacle]) -> Vec<Held> {
    let local = |v: u32, bone: usize| placed[bone].now.inverse() * mesh.vertices[v as usize];
    attached
        .iter()
        .map(|&(vertex, bone)| Held {
            vertex,
            bone,
            local: local(vertex, bone),
        })
        .collect()
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

fn loaded_vertices(muscle: &Muscle) -> Vec<u32> {
    let forces = muscle.forces.iter().flat_map(|f| &f.vertices);
    let displaced = muscle.displacements.iter().flat_map(|d| &d.vertices);
    forces.chain(displaced).copied().collect()
}

fn displace(scene: &Scene, m: usize, particles: &mut Particles) -> Result<(), LoadError> {
    let (muscle, count) = (&scene.muscles[m], particles.len());
    for (d, displacement) in muscle.displacements.iter().enumerate() {
        check_indices(&displacement.vertices, count, muscle.edge_length.is_some()).map_err(
            |(at, fault)| {
                let key = format!("muscle.{m}.displace.{d}.vertices.{at}");
                LoadError::new(
                    scene,
                    &key,
                    format!("displacement of muscle `{}`", muscle.name),
                    fault,
                )
            },
        )?;
        displacement
            .vertices
            .iter()
            .for_each(|&v| particles.position[v as usize] += displacement.by);
    }
    Ok(())
}

fn forces(scene: &Scene, m: usize, count: usize) -> Result<Vec<(u32, Vector3<f64>)>, LoadError> {
    let muscle = &scene.muscles[m];
    let mut all = Vec::new();
    for (f, force) in muscle.forces.iter().enumerate() {
        check_indices(&force.vertices, count, muscle.edge_length.is_some()).map_err(
            |(at, fault)| {
                let key = format!("muscle.{m}.force.{f}.vertices.{at}");
                LoadError::new(
                    scene,
                    &key,
                    format!("force on muscle `{}`", muscle.name),
                    fault,
                )
            },
        )?;
        all.extend(force.vertices.iter().map(|&v| (v, force.force)));
    }
    Ok(all)
}
