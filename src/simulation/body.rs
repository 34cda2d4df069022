//! A muscle made ready to run: only what its plan names is built.

use std::sync::Arc;

use nalgebra::Vector3;

use super::assets::Assets;
use super::attachments::{self, Attached};
use super::equilibrium::{Equilibrium, Parts};
use super::fault::{Fault, LoadError};
use super::plan::MusclePlan;
use super::ready::{Fibres, Rest};
use super::tracked::Tracked;
use crate::constraints::bending::Bending;
use crate::constraints::distance::Distance;
use crate::constraints::{Batch, Constraint, EnclosedVolume, Order, Project};
use crate::contact::untangle::Untangled;
use crate::contact::{Contacts, Obstacle, PosedObstacle, Surface};
use crate::fibres::anisotropy;
use crate::fibres::binding::BoundLines;
use crate::mesh::TriangleMesh;
use crate::mesh::topology::Topology;
use crate::particles::{Numbering, Particles};
use crate::scene::{Area, ContactEffect, Mass, Muscle, Scene, Solver};
use crate::solvers::sparse::FactorError;
use crate::solvers::{Broken, Held, Settings, System, stiffness};
use crate::state::{DecodeError, Reader, State, Writer};

/// A muscle vertex may not be faster than this many muscle lengths a second.
const SPEED_LIMIT: f64 = 200.0;

/// An edge so many times as long as its muscle at rest was torn.
const TORN: f64 = 10.0;

/// A muscle that runs.
pub struct Body {
    /// Its name.
    pub name: String,
    /// State and effects.
    pub system: System,
    /// Surface at rest, after untangling.
    pub rest: TriangleMesh,
    /// Edges with their rest lengths [m].
    pub edges: Vec<Distance>,
    /// Its equilibrium, where the scene asks for that instead of motion.
    pub equilibrium: Option<Equilibrium>,
    /// How it tracks a prescribed shape, where it is to do that instead of what the scene asks for.
    pub tracked: Option<Tracked>,
    /// Vertices held by bones.
    pub attached: Vec<Attached>,
    /// Fibres bound to the surface.
    pub fibres: BoundLines,
    /// What untangling did.
    pub untangled: Untangled,
    /// Volume wanted [m^3]; 0 where none is kept.
    pub target_volume: f64,
    /// Enclosed volume of the rest surface [m^3].
    pub rest_volume: f64,
    /// Greatest extent at rest [m].
    pub length: f64,
    /// Median rest length of its edges [m].
    pub edge_length: f64,
    /// The frame and cause at which it was stopped.
    pub stopped: Option<(usize, Broken)>,
    /// Whether edges resist being stretched.
    resists_stretch: bool,
    /// Positions and velocities at the end of the last good frame.
    pub(super) good: Particles,
}

impl Body {
    /// Builds a muscle; `placed` are all obstacles at frame 0.
    ///
    /// # Errors
    /// An attachment that takes nothing, too much, or vertices that do not exist.
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
        let factors = if plan.stretch {
            factors(scene, plan, &rest, &fibres)
        } else {
            Vec::new()
        };
        let hinges = if plan.bending {
            stiffness::hinges(mesh, topology, muscle.material.bending)
        } else {
            Default::default()
        };
        let rest_volume = if topology.is_closed() {
            mesh.volume()
        } else {
            0.0
        };
        let pressure = scene.effects.volume.map_or(1.0, |v| v.pressure);
        let target_volume = if plan.volume {
            pressure * rest_volume
        } else {
            0.0
        };
        if plan.volume {
            system.volume = Some(volume(scene, muscle, mesh, target_volume, rest_volume));
        }
        system.held = hold(&attached, mesh, placed);
        system.forces = forces(scene, m, count)?;
        let mut equilibrium = None;
        if let Solver::QuasiStatic(settings) | Solver::ImplicitEuler(settings) = scene.solver {
            let step = matches!(scene.solver, Solver::ImplicitEuler(_)).then(|| time_step(scene));
            let k = edge_stiffness
                .iter()
                .zip(&factors)
                .map(|(k, f)| k * f)
                .collect();
            let edges = if plan.stretch {
                (edges.clone(), k)
            } else {
                Default::default()
            };
            let parts = Parts {
                edges,
                hinges,
                volume: system.volume.clone(),
            };
            let made = system.clock.time("equilibrium", || {
                Equilibrium::new(
                    parts,
                    &system.particles,
                    &system.forces,
                    &scene.effects,
                    settings,
                    step,
                )
            });
            equilibrium = Some(made.map_err(|error| unsolvable(scene, m, error))?);
        } else {
            let over = || Over {
                order: scene.solver.order(),
                numbering,
                count,
                loaded: &loaded,
            };
            if plan.stretch {
                system
                    .elastic
                    .push(stretch(scene, &edges, &edge_stiffness, &factors, over()));
            }
            if plan.bending {
                system
                    .elastic
                    .push(bending(scene, hinges.0, &hinges.1, over()));
            }
        }
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
            resists_stretch: plan.stretch,
            system,
            edge_length: crate::mesh::measures::median(lengths).unwrap_or(length),
            edges,
            equilibrium,
            tracked: None,
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

    /// Steps by `dt` [s] while the bones go to where they are `placed`.
    ///
    /// # Errors
    /// A number that is not finite appeared.
    pub(super) fn step(&mut self, placed: &[PosedObstacle], dt: f64) -> Result<(), Broken> {
        let begin = std::time::Instant::now();
        let done = match (&mut self.tracked, &mut self.equilibrium) {
            (Some(tracked), _) => tracked.step(&mut self.system, placed),
            (None, Some(equilibrium)) => equilibrium.step(&mut self.system, placed, dt),
            (None, None) => return self.system.step(placed, dt),
        };
        self.system.clock.note("equilibrium", begin);
        done
    }

    /// Estimate of the solver's error [m], RMS over the vertices, from the greatest residual [m]: a residual adds up
    /// along a muscle, so it is taken times twice the edges along the length.
    pub fn error_estimate(&self, residual_max_m: f64) -> f64 {
        2.0 * self.length / self.edge_length * residual_max_m
    }

    /// A vertex that was torn away, where stretch acts: an edge is longer than ten times the muscle at rest, or so far
    /// off that its length is rounding. Contact with triangles of that size would take minutes a frame.
    pub fn torn(&self) -> Option<usize> {
        if !self.resists_stretch {
            return None;
        }
        let x = &self.system.particles.position;
        let is_torn = |e: &&Distance| {
            let [a, b] = e.points.map(|p| x[p as usize]);
            let reach = (a - b).norm();
            // Not `>`, which a NaN would pass.
            !(reach <= TORN * self.length)
                || !(a.coords.amax() * f64::EPSILON <= 1e-3 * self.edge_length)
        };
        self.edges
            .iter()
            .find(is_torn)
            .map(|e| e.points[0] as usize)
    }

    /// Whether vertex `v` is not held by a bone.
    pub fn is_free(&self, v: usize) -> bool {
        self.system.particles.inverse_mass[v] > 0.0
    }
}

/// Of checkpoints: see [`crate::simulation::checkpoint`].
impl Body {
    pub(super) fn save(&self, to: &mut Writer) {
        let Self {
            name: _,
            system,
            rest: _,
            edges: _,
            equilibrium,
            tracked: _,
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
        equilibrium
            .iter()
            .for_each(|equilibrium| equilibrium.save(to));
        to.put(stopped);
        // A frame ends with both the same, unless somebody moved particles since.
        let differs = !same_bits(good, &system.particles);
        to.put(&differs);
        if differs {
            good.save(to);
        }
    }

    /// Takes the state among the obstacles as they are `placed` then.
    pub(super) fn restore(
        &mut self,
        from: &mut Reader<'_>,
        placed: &[PosedObstacle],
        contact: Option<ContactEffect>,
    ) -> Result<(), DecodeError> {
        self.system.restore(from)?;
        self.restore_contact(from, placed, contact)?;
        self.equilibrium
            .iter_mut()
            .try_for_each(|equilibrium| equilibrium.restore(from))?;
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

    /// Contact may have begun with obstacles that the plan did not foresee.
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

/// Factors on the stiffness of edges by their direction against the fibres; 1 without anisotropy.
fn factors(scene: &Scene, plan: &MusclePlan, rest: &Rest, fibres: &Fibres) -> Vec<f64> {
    match scene.effects.anisotropy.filter(|_| plan.anisotropy) {
        Some(a) => anisotropy::factors(&fibres.cosines(rest), a.strength, a.power),
        None => vec![1.0; fibres.points.len()],
    }
}

/// Contact at the start; what is near is known already, unless vertices are displaced.
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

/// Why a muscle has no equilibrium that could be computed.
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
    let per_frame = if let Solver::Pbd(s) = scene.solver {
        s.velocity_damping
    } else {
        1.0
    };
    let dt = time_step(scene);
    let damping = scene.effects.damping.unwrap_or(0.0);
    let velocity_factor =
        libm::exp(-damping * dt) * libm::pow(per_frame, 1.0 / f64::from(substeps));
    Settings {
        iterations,
        gravity: scene.effects.gravity.unwrap_or_else(Vector3::zeros),
        velocity_factor,
        force_factor: if matches!(scene.solver, Solver::Pbd(_)) {
            velocity_factor
        } else {
            1.0
        },
        speed_limit: SPEED_LIMIT * length,
    }
}

/// The time of a step [s].
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

/// In which order constraints are swept, over which particles.
struct Over<'a> {
    order: Order,
    numbering: &'a Numbering,
    count: usize,
    loaded: &'a [u32],
}

impl Over<'_> {
    fn batch<C: Constraint<K>, const K: usize>(
        &self,
        constraints: Vec<C>,
        compliance: Vec<f64>,
    ) -> Batch<C, K> {
        Batch::numbered(
            constraints,
            compliance,
            self.order,
            (self.numbering, self.count),
            self.loaded,
        )
    }
}

fn stretch(
    scene: &Scene,
    edges: &[Distance],
    k: &[f64],
    factors: &[f64],
    over: Over,
) -> Box<dyn Project> {
    match scene.solver {
        Solver::Xpbd(_) | Solver::QuasiStatic(_) | Solver::ImplicitEuler(_) => {
            // An edge without stiffness (along a fibre, at full strength) is no constraint.
            let weighed = edges
                .iter()
                .copied()
                .zip(k.iter().zip(factors).map(|(k, f)| k * f));
            let (edges, k): (Vec<_>, Vec<_>) = weighed.filter(|(_, k)| *k > 0.0).unzip();
            Box::new(over.batch(edges, stiffness::compliance(&k)))
        }
        Solver::Pbd(s) => {
            let relaxation: Vec<f64> = factors.iter().map(|f| f * s.stretch).collect();
            Box::new(
                over.batch(edges.to_vec(), vec![0.0; edges.len()])
                    .with_relaxation(&relaxation),
            )
        }
    }
}

fn bending(scene: &Scene, hinges: Vec<Bending>, k: &[f64], over: Over) -> Box<dyn Project> {
    match scene.solver {
        Solver::Xpbd(_) | Solver::QuasiStatic(_) | Solver::ImplicitEuler(_) => {
            Box::new(over.batch(hinges, stiffness::compliance(k)))
        }
        Solver::Pbd(s) => {
            let (relaxation, compliance) = (vec![s.bending; hinges.len()], vec![0.0; hinges.len()]);
            Box::new(over.batch(hinges, compliance).with_relaxation(&relaxation))
        }
    }
}

fn volume(
    scene: &Scene,
    muscle: &Muscle,
    mesh: &TriangleMesh,
    target: f64,
    rest: f64,
) -> EnclosedVolume {
    let count = mesh.vertices.len();
    match scene.solver {
        Solver::Xpbd(_) | Solver::QuasiStatic(_) | Solver::ImplicitEuler(_) => {
            let compliance = muscle.material.bulk.map_or(0.0, |bulk| rest / bulk);
            EnclosedVolume::new(&mesh.triangles, count, target, compliance)
        }
        Solver::Pbd(s) => {
            EnclosedVolume::new(&mesh.triangles, count, target, 0.0).with_relaxation(s.volume)
        }
    }
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
    // A handful of points (the tetrahedron scenes) may be held by choice.
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

/// Refuses an index beyond the mesh, with its number in the list.
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
            // An open or flat surface encloses nothing: as if it were a tenth of its size thick.
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
