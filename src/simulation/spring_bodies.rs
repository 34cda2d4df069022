//! Bodies of springs that collide with each other, with themselves and with rigid bodies.
//!
//! A step has the order of errata B05: forces, velocities, impulses, positions. Pairs that the step would bring
//! nearer than the thickness of the surfaces get impulses of equal size and opposite direction, with restitution and
//! friction. Then the engine of muscles ([`crate::contact::meeting`]) pushes apart what is still too near, which
//! gives no velocity, and takes back motion until no pair crosses.
//!
//! *Limitations.* The integrator is semi-implicit Euler. Its step is at most half of the longest stable one at rest,
//! and no longer than a point needs for a quarter of an edge.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::assets::{mended, named_at, read_scaled};
use super::fault::{Fault, LoadError};
use super::plan::{Plan, Planned};
use super::scenario::Stepped;
use crate::contact::meeting::{Certificate, Meeting, MeetingSettings, SoftMember};
use crate::contact::response::OVER_VERTEX;
use crate::contact::{Obstacle, PosedObstacle, Surface};
use crate::mesh::crossings::{Crossed, crossings_between, crossings_of};
use crate::mesh::measures::{Aabb, max_or_nan, volume};
use crate::mesh::predicates;
use crate::mesh::{SurfaceTree, Topology, TriangleMesh};
use crate::scene::content::{SpringBodiesScene, SpringBodySpec};
use crate::scene::{BoneSpec, Source};
use crate::springs::contact::{ContactPart, Response, impulse};
use crate::springs::hooke::Springs;
use crate::springs::integrators::SemiImplicitEuler;
use crate::springs::lattice::LatticeShape;
use crate::springs::volume::TrueVolume;
use crate::springs::{SpringSystem, limit, mass, patterns, stiffest};

/// Length of a step relative to the stability limit.
const STABLE: f64 = 0.5;

/// Greatest motion of a point in a step, relative to the median edge.
const STRIDE: f64 = 0.25;

/// Greatest number of steps a frame.
const MOST_STEPS: f64 = 1e5;

/// Greatest number of rounds over all pairs in which impulses are given.
const ROUNDS: usize = 16;

/// A body of springs.
pub(super) struct SoftBody {
    name: String,
    system: SpringSystem,
    /// The points of the surface, and its triangles among them.
    points: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    /// The surface at the start.
    start: TriangleMesh,
    /// The volume that it encloses at the start [m^3]; 0 for an open surface.
    volume: f64,
    springs: usize,
}

impl SoftBody {
    fn surface(&self) -> Vec<Point3<f64>> {
        let each = self.points.iter();
        each.map(|&p| self.system.position[p as usize]).collect()
    }

    fn velocities(&self) -> Vec<Vector3<f64>> {
        let each = self.points.iter();
        each.map(|&p| self.system.velocity[p as usize]).collect()
    }

    /// Change of its volume, relative to the start.
    fn volume_change(&self) -> f64 {
        match self.volume > 0.0 {
            true => volume(&self.surface(), &self.triangles) / self.volume - 1.0,
            false => 0.0,
        }
    }
}

/// A simulation of bodies of springs.
pub struct SpringBodiesRun {
    /// The scene.
    pub scene: SpringBodiesScene,
    /// The effects that run.
    pub plan: Plan,
    bodies: Vec<SoftBody>,
    rigid: Vec<TriangleMesh>,
    placed: Vec<PosedObstacle>,
    meeting: Meeting,
    response: Response,
    /// The longest step [s], and the median edge [m].
    longest: f64,
    edge: f64,
    frame: usize,
    steps: u64,
    certificate: Certificate,
    crossings: usize,
    volume_change: f64,
    time_s: f64,
}

impl SpringBodiesRun {
    /// Makes the bodies of a scene.
    ///
    /// # Errors
    /// A mesh that cannot be read or used, a point that does not exist, bodies that cross at the start, or steps that
    /// would be too short.
    pub fn new(scene: SpringBodiesScene) -> Result<Self, LoadError> {
        let mut bodies = Vec::new();
        for (k, spec) in scene.bodies.iter().enumerate() {
            bodies.push(soft(&scene, spec, &format!("spring_body.{k}"))?);
        }
        let mut rigid = Vec::new();
        for (k, spec) in scene.rigid.iter().enumerate() {
            rigid.push(read(&scene, spec, &format!("rigid_body.{k}"))?);
        }
        let surfaces: Vec<Arc<Surface>> = rigid.iter().map(|m| Arc::new(Surface::new(m))).collect();
        let pose = |spec: &BoneSpec| spec.motion.pose(0.0);
        let placed = scene
            .rigid
            .iter()
            .zip(&surfaces)
            .map(|(spec, surface)| PosedObstacle {
                name: spec.name.clone(),
                obstacle: surface.clone() as Arc<dyn Obstacle>,
                before: pose(spec),
                now: pose(spec),
            });
        let placed: Vec<PosedObstacle> = placed.collect();
        let meeting = meeting(&scene, &bodies, &placed, &surfaces);
        let refused = |key: &str, why: String| {
            LoadError::at(
                &scene.origin,
                key,
                "bodies of springs".to_owned(),
                Fault::SpringBodies { why },
            )
        };
        let response = Response::new(scene.restitution, scene.friction)
            .map_err(|error| refused("collision", error.to_string()))?;
        let euler = SemiImplicitEuler::default();
        let limits = bodies
            .iter()
            .map(|body| limit(&euler, &stiffest(&body.system)));
        let longest = STABLE * limits.fold(f64::INFINITY, |a, b| if b < a { b } else { a });
        let frame = 1.0 / scene.frame_rate;
        if !(frame / longest <= MOST_STEPS) {
            let why = format!(
                "a frame would need more than {MOST_STEPS} steps of {longest:e} s: give a greater `mass`, a smaller `stiffness` or `bulk_modulus`"
            );
            return Err(refused("spring_body.0.stiffness", why));
        }
        let edges = bodies.iter().filter_map(|body| {
            let topology = Topology::new(&body.start);
            body.start.median_edge_length(&topology)
        });
        let edge = edges.fold(f64::INFINITY, |a, b| if b < a { b } else { a });
        let mut run = Self {
            plan: plan(&scene, &bodies),
            response,
            longest,
            edge,
            frame: 0,
            steps: 0,
            certificate: Certificate::default(),
            crossings: 0,
            volume_change: 0.0,
            time_s: 0.0,
            bodies,
            rigid,
            placed,
            meeting,
            scene,
        };
        let crossings = run.count_crossings();
        if crossings > 0 {
            let why = format!(
                "{crossings} pairs of triangles cross at the start: move the bodies apart with `at`"
            );
            let at = LoadError::at(
                &run.scene.origin,
                "spring_body.0.at",
                "bodies of springs".to_owned(),
                Fault::SpringBodies { why },
            );
            return Err(at);
        }
        run.meeting.take_certificate();
        Ok(run)
    }

    /// The last computed frame; 0 is the start.
    pub fn frame(&self) -> usize {
        self.frame
    }

    /// Counts that certify that nothing crossed.
    pub fn certificate(&self) -> Certificate {
        self.certificate
    }

    /// Number of steps so far.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Kinetic energy, and all energy with that of springs, volumes and weight [J]. That of the weight is zero at the
    /// origin.
    pub fn energy(&self) -> [f64; 2] {
        let (mut kinetic, mut all) = (0.0, 0.0);
        for body in &self.bodies {
            let of = body.system.energy();
            kinetic += of.kinetic;
            all += of.total();
        }
        [kinetic, all]
    }

    /// Momentum of all bodies [kg m/s].
    pub fn momentum(&self) -> Vector3<f64> {
        let of = |body: &SoftBody| -> Vector3<f64> {
            let each = body.system.velocity.iter().zip(body.system.mass());
            each.map(|(v, m)| v * *m).sum()
        };
        self.bodies.iter().map(of).sum()
    }

    /// Computes the next frame.
    pub fn step(&mut self) -> Stepped {
        let begun = std::time::Instant::now();
        let frame = 1.0 / self.scene.frame_rate;
        // What falls freely in the frame, and the poses of rigid bodies, make points faster.
        let fastest = self.fastest() + self.scene.gravity.norm() * frame;
        let stride = STRIDE * self.edge / fastest;
        let longest = if stride < self.longest {
            stride
        } else {
            self.longest
        };
        let steps = (frame / longest).ceil();
        if !(steps <= MOST_STEPS) {
            return Stepped::Failed(format!(
                "frame {}: a point moves at {fastest:e} m/s, and the frame would need {steps:e} steps",
                self.frame + 1
            ));
        }
        let steps = if steps > 1.0 { steps as u32 } else { 1 };
        for k in 0..steps {
            if let Err(why) = self.advance(frame / f64::from(steps), (k, steps)) {
                return Stepped::Failed(format!("frame {}: {why}", self.frame + 1));
            }
        }
        self.frame += 1;
        self.steps += u64::from(steps);
        self.meeting.note_gaps();
        self.certificate.add(&self.meeting.take_certificate());
        let crossings = self.count_crossings();
        self.crossings = self.crossings.max(crossings);
        let changes = self.bodies.iter().map(|body| body.volume_change().abs());
        self.volume_change = max_or_nan([self.volume_change, max_or_nan(changes)]);
        self.time_s += begun.elapsed().as_secs_f64();
        Stepped::Done
    }

    /// Makes a step of `dt` [s], the one of this number among those of a frame.
    fn advance(&mut self, dt: f64, (k, steps): (u32, u32)) -> Result<(), String> {
        let at = |k: u32| self.frame as f64 + f64::from(k) / f64::from(steps);
        let times = [at(k), at(k + 1)];
        for (placed, spec) in self.placed.iter_mut().zip(&self.scene.rigid) {
            [placed.before, placed.now] = times.map(|time| spec.motion.pose(time));
        }
        let euler = SemiImplicitEuler::default();
        self.bodies
            .par_iter_mut()
            .for_each(|body| euler.velocities(&mut body.system, dt));
        let start: Vec<Vec<Point3<f64>>> = self.bodies.iter().map(SoftBody::surface).collect();
        let views: Vec<&[Point3<f64>]> = start.iter().map(Vec::as_slice).collect();
        match k {
            0 => self.meeting.begin_frame(&views, &self.placed),
            _ => self.meeting.begin_step(&views, &self.placed),
        }
        let mut velocities: Vec<Vec<Vector3<f64>>> =
            self.bodies.iter().map(SoftBody::velocities).collect();
        let free = |velocities: &[Vec<Vector3<f64>>]| -> Vec<Vec<Point3<f64>>> {
            let each = start.iter().zip(velocities);
            each.map(|(x, v)| x.iter().zip(v).map(|(x, v)| x + v * dt).collect())
                .collect()
        };
        // What a step without contact brings too near gets impulses.
        let mut end = free(&velocities);
        self.meeting.respond(&mut slices(&mut end), None);
        if self.meeting.has_pushed() {
            let (response, none) = (self.response, still());
            self.meeting.collide(
                &mut slices(&mut velocities),
                (dt, ROUNDS),
                |normal, part| impulse(normal, &none, &part, response),
            );
            end = free(&velocities);
            self.meeting.respond(&mut slices(&mut end), None);
        }
        self.meeting.hold(&mut slices(&mut end), None);
        for ((body, end), velocities) in self.bodies.iter_mut().zip(end).zip(velocities) {
            let SoftBody { system, points, .. } = body;
            for ((&p, x), v) in points.iter().zip(end).zip(velocities) {
                system.velocity[p as usize] = v;
                // Where the free step would lead is taken off below.
                system.position[p as usize] = x - v * dt;
            }
            euler
                .positions(system, dt)
                .map_err(|error| format!("{}: {error}", body.name))?;
        }
        Ok(())
    }

    /// The greatest speed [m/s], of rigid bodies too.
    fn fastest(&self) -> f64 {
        let soft = self.bodies.iter().flat_map(|body| &body.system.velocity);
        let soft = max_or_nan(soft.map(Vector3::norm));
        let frame = self.frame as f64;
        let rigid = self
            .scene
            .rigid
            .iter()
            .zip(&self.rigid)
            .map(|(spec, mesh)| {
                let [before, now] = [frame, frame + 1.0].map(|time| spec.motion.pose(time));
                let corners = mesh.bounding_box().corners();
                let moved = corners.map(|p| (now * p - before * p).norm());
                max_or_nan(moved) * self.scene.frame_rate
            });
        max_or_nan([soft, max_or_nan(rigid)])
    }

    /// The surface of a rigid body at its pose.
    fn posed(&self, b: usize) -> Vec<Point3<f64>> {
        let pose = self.placed[b].now;
        self.rigid[b].vertices.iter().map(|v| pose * v).collect()
    }

    /// Number of pairs of triangles that cross: of two bodies, of a body and a rigid one, of one body.
    fn count_crossings(&self) -> usize {
        let soft = self.bodies.iter();
        let mut all: Vec<(Vec<Point3<f64>>, &[[u32; 3]], bool)> = soft
            .map(|body| (body.surface(), &body.triangles[..], false))
            .collect();
        let rigid = self.rigid.iter().enumerate();
        all.extend(rigid.map(|(b, mesh)| (self.posed(b), &mesh.triangles[..], true)));
        let trees: Vec<SurfaceTree> = all
            .iter()
            .map(|(x, triangles, _)| SurfaceTree::new(x, triangles))
            .collect();
        let boxes: Vec<Aabb> = all.iter().map(|(x, ..)| Aabb::of_points(x)).collect();
        let named: Vec<(Vec<u32>, Vec<bool>)> = all
            .iter()
            .map(|(x, triangles, _)| {
                let flat = |t: &[u32; 3]| predicates::is_flat(&t.map(|v| x[v as usize]));
                let flat = triangles.iter().map(flat).collect();
                ((0..x.len() as u32).collect(), flat)
            })
            .collect();
        let crossed = |k: usize| Crossed {
            vertices: &all[k].0,
            triangles: all[k].1,
            names: &named[k].0,
            skipped: &named[k].1,
            tree: &trees[k],
        };
        let mut count = 0;
        for a in 0..all.len() {
            if !all[a].2 {
                count += crossings_of(&all[a].0, all[a].1).count;
            }
            for b in a + 1..all.len() {
                let is_fixed = all[a].2 && all[b].2;
                if !is_fixed && boxes[a].intersects(&boxes[b]) {
                    count += crossings_between(crossed(a), crossed(b), 0).count;
                }
            }
        }
        count
    }

    /// Positions and velocities of the surface of each body.
    pub(super) fn states(&self) -> Vec<(Vec<Point3<f64>>, Vec<Vector3<f64>>)> {
        let each = self.bodies.iter();
        each.map(|body| (body.surface(), body.velocities()))
            .collect()
    }

    /// Name, surface at the start, and which of its vertices are held, of each body.
    pub(super) fn surfaces(&self) -> Vec<(&str, &TriangleMesh, Vec<f64>)> {
        let each = self.bodies.iter();
        each.map(|body| {
            let held = body
                .points
                .iter()
                .map(|&p| body.system.pinned()[p as usize]);
            let held = held.map(|held| f64::from(u8::from(held))).collect();
            (&*body.name, &body.start, held)
        })
        .collect()
    }

    /// Name and surface of each rigid body, in its own frame.
    pub(super) fn rigid_bodies(&self) -> Vec<(&str, &TriangleMesh)> {
        let each = self.scene.rigid.iter().zip(&self.rigid);
        each.map(|(spec, mesh)| (&*spec.name, mesh)).collect()
    }

    /// The pose of each rigid body in a frame.
    pub(super) fn poses_at(&self, frame: usize) -> Vec<Isometry3<f64>> {
        let each = self.scene.rigid.iter();
        each.map(|spec| spec.motion.pose(frame as f64)).collect()
    }

    /// Its measures so far, with the names of scenes.
    pub(super) fn measured(&self) -> Vec<(&'static str, f64)> {
        let [kinetic, all] = self.energy();
        vec![
            ("time_s", self.time_s),
            ("crossings", self.crossings as f64),
            ("volume_change", self.volume_change),
            ("contacts", self.certificate.pairs as f64),
            ("kinetic_energy_j", kinetic),
            ("energy_j", all),
            ("speed_m_s", self.fastest()),
        ]
    }
}

fn slices<T>(of: &mut [Vec<T>]) -> Vec<&mut [T]> {
    of.iter_mut().map(Vec::as_mut_slice).collect()
}

/// The side of a contact that no impulse moves.
fn still() -> ContactPart<1> {
    ContactPart {
        weights: [0.0],
        inverse_mass: [0.0],
        velocity: [Vector3::zeros()],
    }
}

/// The engine of contact between the surfaces of all bodies.
fn meeting(
    scene: &SpringBodiesScene,
    bodies: &[SoftBody],
    placed: &[PosedObstacle],
    surfaces: &[Arc<Surface>],
) -> Meeting {
    let settings = MeetingSettings {
        thickness: scene.thickness,
        over_bone: OVER_VERTEX,
        // Impulses have the friction.
        friction: 0.0,
        others: true,
        bones: true,
        itself: true,
    };
    let obstacles: Vec<usize> = (0..placed.len()).collect();
    let masses: Vec<Vec<f64>> = bodies
        .iter()
        .map(|body| {
            let each = body.points.iter().map(|&p| p as usize);
            each.map(|p| match body.system.pinned()[p] {
                true => 0.0,
                false => 1.0 / body.system.mass()[p],
            })
            .collect()
        })
        .collect();
    let soft: Vec<SoftMember<'_>> = bodies
        .iter()
        .zip(&masses)
        .map(|(body, inverse_mass)| SoftMember {
            mesh: &body.start,
            inverse_mass,
            obstacles: &obstacles,
        })
        .collect();
    let all = 0..bodies.len();
    let partners: Vec<[usize; 2]> = all
        .clone()
        .flat_map(|a| (a + 1..bodies.len()).map(move |b| [a, b]))
        .collect();
    Meeting::new(settings, &soft, &partners, placed, |o| {
        surfaces.get(o).cloned()
    })
}

/// The mesh of a rigid body.
fn read(scene: &SpringBodiesScene, spec: &BoneSpec, key: &str) -> Result<TriangleMesh, LoadError> {
    let mesh = mesh_of(scene, &spec.surface, (key, &spec.name))?;
    Ok(mended(mesh, spec.repair.as_ref(), &mut Vec::new()))
}

/// A mesh that must have triangles.
fn mesh_of(
    scene: &SpringBodiesScene,
    source: &Source,
    (key, name): (&str, &str),
) -> Result<TriangleMesh, LoadError> {
    let mesh = read_scaled(source)?.mesh;
    if mesh.triangles.is_empty() {
        let fault = Fault::NoTriangles {
            file: name.to_owned(),
        };
        let key = named_at(source, key, "mesh");
        return Err(LoadError::at(&scene.origin, &key, name.to_owned(), fault));
    }
    Ok(mesh)
}

/// A body of springs at its place, with its velocity.
fn soft(
    scene: &SpringBodiesScene,
    spec: &SpringBodySpec,
    key: &str,
) -> Result<SoftBody, LoadError> {
    let refused = |below: &str, fault: Fault| {
        LoadError::at(
            &scene.origin,
            &format!("{key}.{below}"),
            spec.name.clone(),
            fault,
        )
    };
    let unfit = |why: &dyn std::fmt::Display| Fault::SpringBodies {
        why: why.to_string(),
    };
    let (mut x, triangles, pairs) = match (&spec.lattice, &spec.surface) {
        (Some((points, side, neighbours)), _) => {
            let shape = LatticeShape::with_longest_side(*points, *side)
                .map_err(|error| refused("lattice", error.into()))?;
            let faces = shape.faces().map(|corners| corners.map(|p| shape.index(p)));
            let pairs: Vec<[u32; 2]> = patterns::lattice(&shape, *neighbours).collect();
            (shape.positions(), faces.collect(), pairs)
        }
        (None, Some(source)) => {
            let mesh = mesh_of(scene, source, (key, &spec.name))?;
            let topology = Topology::new(&mesh);
            (mesh.vertices, mesh.triangles, topology.edges)
        }
        (None, None) => (Vec::new(), Vec::new(), Vec::new()),
    };
    x.iter_mut().for_each(|x| *x += spec.at);
    let whole = TriangleMesh {
        vertices: x.clone(),
        triangles: triangles.clone(),
    };
    let masses = match spec.lattice {
        Some(_) => vec![spec.mass / x.len() as f64; x.len()],
        None => mass::by_area(&whole, spec.mass).map_err(|error| refused("mass", unfit(&error)))?,
    };
    let springs = patterns::at_rest(&x, pairs, |_| spec.stiffness);
    let springs = Springs::new(x.len(), springs).map_err(|e| refused("stiffness", unfit(&e)))?;
    let count = springs.springs().len();
    let mut system =
        SpringSystem::new(x, masses).map_err(|error| refused("mass", unfit(&error)))?;
    system
        .add(springs)
        .map_err(|e| refused("stiffness", unfit(&e)))?;
    if let Some(bulk) = spec.bulk_modulus {
        let held = TrueVolume::new(&system.position, &triangles, bulk, None, &[])
            .map_err(|error| refused("bulk_modulus", unfit(&error)))?;
        system
            .add(held)
            .map_err(|e| refused("bulk_modulus", unfit(&e)))?;
    }
    system.damping = spec.damping;
    if scene.gravity != Vector3::zeros() {
        system.load = system.mass().iter().map(|m| scene.gravity * *m).collect();
    }
    if let Some(&index) = spec.held.iter().find(|&&v| v as usize >= system.len()) {
        let fault = Fault::NoSuchVertex {
            index,
            count: system.len(),
            refined: false,
        };
        return Err(refused("held", fault));
    }
    let velocity = spec.velocity;
    system.velocity.iter_mut().for_each(|v| *v = velocity);
    let lowest = system.position.iter().map(|x| x.y);
    let lowest = lowest.fold(f64::INFINITY, |a, b| if b < a { b } else { a });
    let extent = Aabb::of_points(&system.position).extents().amax();
    let is_lowest = |x: &Point3<f64>| spec.holds_lowest && x.y <= lowest + 1e-9 * extent;
    let each = (0u32..).zip(&system.position);
    let mut held: Vec<u32> = each.filter(|(_, x)| is_lowest(x)).map(|(p, _)| p).collect();
    held.extend(&spec.held);
    system.pin(held);
    let mut points: Vec<u32> = triangles.iter().flatten().copied().collect();
    points.sort_unstable();
    points.dedup();
    let place = |p: u32| points.binary_search(&p).map_or(0, |k| k as u32);
    let triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(place)).collect();
    let start = TriangleMesh {
        vertices: points
            .iter()
            .map(|&p| system.position[p as usize])
            .collect(),
        triangles: triangles.clone(),
    };
    let is_closed = Topology::new(&start).is_closed();
    Ok(SoftBody {
        name: spec.name.clone(),
        volume: if is_closed { start.volume() } else { 0.0 },
        springs: count,
        system,
        points,
        triangles,
        start,
    })
}

/// The effects of a scene.
fn plan(scene: &SpringBodiesScene, bodies: &[SoftBody]) -> Plan {
    let mut plan = Plan::default();
    for (body, spec) in bodies.iter().zip(&scene.bodies) {
        let mut run = |effect: &str, elements: usize, bytes: usize| {
            plan.run.push(Planned {
                muscle: body.name.clone(),
                effect: effect.to_owned(),
                elements,
                bytes,
                ms_per_frame: 0.0,
            });
        };
        run("springs", body.springs, 32 * body.springs);
        if spec.bulk_modulus.is_some() {
            run("volume", body.triangles.len(), 12 * body.triangles.len());
        }
        run("contact", body.points.len(), 120 * body.points.len());
    }
    plan
}
