//! What a window shows of a running simulation: a frame of it, made by its thread and never changed again.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3};

use crate::mesh::TriangleMesh;
use crate::scene::Scene;
use crate::simulation::measures::strain_at_vertices;
use crate::simulation::{Body, Simulation};

/// What stays the same through a session.
#[derive(Clone, Debug)]
pub struct Stage {
    /// Muscles, in the scene's order.
    pub muscles: Vec<StageMuscle>,
    /// Name and surface of each bone, in its own frame [m].
    pub bones: Vec<(String, TriangleMesh)>,
}

/// What stays the same of a muscle.
#[derive(Clone, Debug)]
pub struct StageMuscle {
    /// Its name.
    pub name: String,
    /// Its triangles; none for a body of edges alone.
    pub triangles: Vec<[u32; 3]>,
    /// Its edges.
    pub edges: Vec<[u32; 2]>,
    /// The vertices that a bone holds, and which.
    pub held: Vec<(u32, usize)>,
}

impl Stage {
    pub(super) fn of(simulation: &Simulation) -> Self {
        let muscle = |body: &Body| StageMuscle {
            name: body.name.clone(),
            triangles: body.rest.triangles.clone(),
            edges: body.edges.iter().map(|e| e.points).collect(),
            held: body.attached.clone(),
        };
        let names = simulation.scene.bones.iter().map(|b| b.name.clone());
        Self {
            muscles: simulation.bodies.iter().map(muscle).collect(),
            bones: names.zip(simulation.bones.iter().cloned()).collect(),
        }
    }
}

/// One moment of a session.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Rises by one from each to the next.
    pub serial: u64,
    /// Commands that were answered so far: the number that [`super::Session::send`] gave to the last of them.
    pub answered: u64,
    /// The last frame that was computed; 0 is the start.
    pub frame: usize,
    /// Whether frames follow by themselves.
    pub running: bool,
    /// Why the last command that was refused was, with its number.
    pub refused: Option<(u64, String)>,
    /// Why the simulation as a whole cannot go on, until it is reset.
    pub failed: Option<String>,
    /// The scene with the changes so far.
    pub scene: Arc<Scene>,
    /// Muscles, in the scene's order.
    pub muscles: Vec<MuscleShot>,
    /// Bones, in the scene's order.
    pub bones: Vec<BoneShot>,
    /// Time of each effect in the last frame, over all muscles [ms].
    pub effects: Vec<(&'static str, f64)>,
    /// Time of the last frame [ms].
    pub frame_ms: f64,
    /// Frames a second, over those of the last moments; 0 before two frames.
    pub frames_per_second: f64,
    /// Notes of reading and of running, for people.
    pub notes: Vec<String>,
}

/// A muscle at one moment; lists have an entry for each vertex.
#[derive(Clone, Debug)]
pub struct MuscleShot {
    /// Positions [m].
    pub positions: Vec<Point3<f64>>,
    /// Mean absolute strain of the edges that meet there.
    pub stretch: Vec<f64>,
    /// Depth in the bones [m], 0 outside.
    pub depth: Vec<f64>,
    /// Speed [m/s].
    pub speed: Vec<f64>,
    /// Volume over its target, less 1; 0 where no volume is kept.
    pub volume_error: f64,
    /// Vertices that somebody fixed.
    pub fixed: Vec<u32>,
    /// The vertex that is dragged, and where to [m].
    pub dragged: Option<(u32, Point3<f64>)>,
    /// The frame at which it was stopped, and why.
    pub stopped: Option<(usize, String)>,
}

/// A bone at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct BoneShot {
    /// Maps its own frame [m] to the world [m].
    pub pose: Isometry3<f64>,
    /// The angle about its joint [rad], in -pi..pi; `None` without a joint.
    pub angle: Option<f64>,
    /// What moves it.
    pub steering: Steering,
}

/// What moves a bone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Steering {
    /// The scene's motion.
    #[default]
    Motion,
    /// The hand.
    Hand,
    /// It is on its way from where the hand left it to where its motion is.
    Return,
}

impl MuscleShot {
    pub(super) fn of(simulation: &Simulation, m: usize) -> Self {
        let body = &simulation.bodies[m];
        let particles = &body.system.particles;
        let x = &particles.position;
        let volume_error = match body.target_volume {
            target if target > 0.0 => crate::mesh::measures::volume(x, &body.rest.triangles) / target - 1.0,
            _ => 0.0,
        };
        Self {
            stretch: strain_at_vertices(&body.edges, x),
            depth: depths(simulation, body),
            speed: particles.velocity.iter().map(|v| v.norm()).collect(),
            positions: x.clone(),
            volume_error,
            fixed: simulation.plan.muscles[m].fixed.clone(),
            dragged: None,
            stopped: body.stopped.as_ref().map(|(frame, broken)| (*frame, broken.to_string())),
        }
    }
}

/// Depth of each free vertex in the obstacles that its muscle is kept out of [m].
fn depths(simulation: &Simulation, body: &Body) -> Vec<f64> {
    let x = &body.system.particles.position;
    let mut depths = vec![0.0; x.len()];
    let Some(contacts) = &body.system.contacts else { return depths };
    for &o in contacts.obstacles() {
        let Some(placed) = simulation.placed().get(o) else { continue };
        let (bounds, back) = (placed.obstacle.bounding_box(), placed.now.inverse());
        for v in contacts.near(o).map(|v| v as usize) {
            let local = back * x[v];
            // What is outside of the box is outside of the bone.
            if !(0..3).all(|k| bounds.min[k] <= local[k] && local[k] <= bounds.max[k]) {
                continue;
            }
            if let Some(found) = placed.obstacle.closest(&local).filter(|found| -found.distance > depths[v]) {
                depths[v] = -found.distance;
            }
        }
    }
    depths
}
