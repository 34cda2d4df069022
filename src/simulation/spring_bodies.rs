//! Bodies of springs that collide with each other, with themselves and with rigid bodies.
//!
//! A step has the order of errata B05: forces, velocities, impulses, positions. Pairs that the step would bring
//! nearer than the thickness of the surfaces get impulses of equal size and opposite direction, with restitution and
//! friction. The engine of muscles ([`crate::contact::meeting`]) finds them, and then takes back motion until no pair
//! crosses.
//!
//! *Limitations.* The integrator is semi-implicit Euler. Its step is at most an eighth of the longest stable one at rest,
//! and no longer than a point needs for half of the thickness.

mod body;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::fault::{Fault, LoadError};
use super::plan::{Plan, Planned};
use super::scenario::{BodyState, Stepped};
use crate::contact::meeting::{Certificate, Meeting, MeetingSettings, SoftMember};
use crate::contact::{Obstacle, PosedObstacle, Surface};
use crate::mesh::crossings::{Crossed, crossings_between, crossings_of};
use crate::mesh::measures::{Aabb, max_or_nan};
use crate::mesh::predicates;
use crate::mesh::{SurfaceTree, Topology, TriangleMesh};
use crate::scene::BoneSpec;
use crate::scene::content::SpringBodiesScene;
use crate::springs::contact::{ContactPart, Response, impulse};
use crate::springs::integrators::SemiImplicitEuler;
use crate::springs::{limit, stiffest};
use body::SoftBody;

/// Length of a step relative to the stability limit: the energy of the stiffest motion swings by half of its square.
const STABLE: f64 = 0.125;

/// Greatest motion of a point in a step, relative to the median edge and to the thickness: what comes near gets its
/// impulse before it touches.
const STRIDE: f64 = 0.25;
const NEARING: f64 = 0.5;

/// Distance that surfaces keep, relative to the shortest median edge of a body, if the scene gives none.
const THICKNESS: f64 = 0.05;

/// Greatest number of steps a frame.
const MOST_STEPS: f64 = 1e5;

/// Greatest number of rounds over all pairs in which impulses are given.
const ROUNDS: usize = 16;

/// A surface whose crossings are counted: positions, triangles, and whether it is rigid.
type Audited<'a> = (Vec<Point3<f64>>, &'a [[u32; 3]], bool);

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
    /// Distance that surfaces keep [m].
    thickness: f64,
    frame: usize,
    steps: u64,
    /// The last step [s].
    dt: f64,
    certificate: Certificate,
    /// Pairs that got impulses, summed over steps.
    contacts: u64,
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
            bodies.push(body::soft(&scene, spec, &format!("spring_body.{k}"))?);
        }
        let mut rigid = Vec::new();
        for (k, spec) in scene.rigid.iter().enumerate() {
            rigid.push(body::rigid(&scene, spec, &format!("rigid_body.{k}"))?);
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
        let edges = bodies.iter().filter_map(|body| {
            let topology = Topology::new(&body.start);
            body.start.median_edge_length(&topology)
        });
        let edge = edges.fold(f64::INFINITY, |a, b| if b < a { b } else { a });
        let thickness = scene.thickness.unwrap_or(THICKNESS * edge);
        let meeting = meeting(thickness, &bodies, &placed, &surfaces);
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
        let mut run = Self {
            plan: plan(&scene, &bodies, frame / longest),
            response,
            longest,
            edge,
            thickness,
            frame: 0,
            steps: 0,
            dt: 0.0,
            certificate: Certificate::default(),
            contacts: 0,
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
        let mut acceleration = Vec::new();
        for SoftBody { system, .. } in &self.bodies {
            system.acceleration(&system.position, &system.velocity, &mut acceleration);
            let of = system.energy();
            // Velocities are those of half a step before the positions.
            let each = system.velocity.iter().zip(&acceleration).zip(system.mass());
            let now = each.map(|((v, a), m)| 0.5 * m * (v + a * (0.5 * self.dt)).norm_squared());
            let now: f64 = now.sum();
            kinetic += now;
            all += of.total() - of.kinetic + now;
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
        let [of_edge, near] = [STRIDE * self.edge, NEARING * self.thickness];
        let stride = if near < of_edge { near } else { of_edge } / fastest;
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
        self.dt = frame / f64::from(steps);
        for k in 0..steps {
            if let Err(why) = self.advance(self.dt, (k, steps)) {
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
        // What a step without contact brings too near gets impulses.
        let mut end = moved(&start, &velocities, dt);
        let mut pushed = end.clone();
        self.meeting.respond(&mut slices(&mut pushed), None);
        let touching = self.meeting.pushed();
        if touching > 0 {
            self.contacts += touching as u64;
            self.collide(&mut velocities, dt, &[]);
            end = moved(&start, &velocities, dt);
        }
        let changed = self.meeting.hold(&mut slices(&mut end), None);
        if changed.iter().any(|of| !of.is_empty()) {
            self.collide(&mut velocities, dt, &changed);
        }
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

    /// Gives the pairs of a step of `dt` [s] their impulses; `changed` are the vertices that the engine held back.
    fn collide(&self, velocities: &mut [Vec<Vector3<f64>>], dt: f64, changed: &[Vec<u32>]) {
        let (response, none) = (self.response, still());
        let of = |normal: &Vector3<f64>, (weights, inverse_mass, velocity)| {
            let part = ContactPart::<4> {
                weights,
                inverse_mass,
                velocity,
            };
            impulse(normal, &none, &part, response)
        };
        let mut moving = slices(velocities);
        self.meeting.collide(&mut moving, (dt, ROUNDS), changed, of);
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
        let mut all: Vec<Audited<'_>> = soft
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
    pub(super) fn states(&self) -> Vec<BodyState> {
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
            ("contacts", self.contacts as f64),
            ("kinetic_energy_j", kinetic),
            ("energy_j", all),
            ("speed_m_s", self.fastest()),
        ]
    }
}

/// Where the points of each body go in a step of `dt` [s].
fn moved(
    from: &[Vec<Point3<f64>>],
    velocities: &[Vec<Vector3<f64>>],
    dt: f64,
) -> Vec<Vec<Point3<f64>>> {
    let each = from.iter().zip(velocities);
    each.map(|(x, v)| x.iter().zip(v).map(|(x, v)| x + v * dt).collect())
        .collect()
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
    thickness: f64,
    bodies: &[SoftBody],
    placed: &[PosedObstacle],
    surfaces: &[Arc<Surface>],
) -> Meeting {
    let settings = MeetingSettings {
        thickness,
        over_bone: 1.0,
        // Bodies hit corners and bounce off in the direction of what they hit.
        rounding: 0.0,
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

/// Time of a spring, of a triangle of a volume and of a point of a surface in a step [ns]; for estimates only, as measured
/// on the built-in scene.
const NS: [f64; 3] = [12.0, 30.0, 400.0];

/// The effects of a scene that makes this many steps a frame.
fn plan(scene: &SpringBodiesScene, bodies: &[SoftBody], steps: f64) -> Plan {
    let mut plan = Plan::default();
    for (body, spec) in bodies.iter().zip(&scene.bodies) {
        let mut run = |effect: &str, elements: usize, bytes: usize, ns: f64| {
            plan.run.push(Planned {
                muscle: body.name.clone(),
                effect: effect.to_owned(),
                elements,
                bytes: bytes * elements,
                ms_per_frame: 1e-6 * ns * elements as f64 * steps,
            });
        };
        run("springs", body.springs, 32, NS[0]);
        if spec.bulk_modulus.is_some() {
            run("volume", body.triangles.len(), 12, NS[1]);
        }
        run("contact", body.points.len(), 120, NS[2]);
    }
    plan
}
