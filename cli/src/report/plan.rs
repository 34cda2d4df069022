//! A scene of muscles before its first frame: attachments, overlaps, the size of its results, a picture.

use std::sync::Arc;

use nalgebra::Isometry3;
use serde_json::{Value, json};

use super::Table;
use super::frames::{self, Stored};
use super::muscles::{start_checks, starts};
use super::output::Verdict;
use super::pictures::Painter;
use super::shots::Shots;
use pliant::contact::Obstacle;
use pliant::format::number;
use pliant::mesh::measures::{max_or_nan, median};
use pliant::simulation::{Scenario, Simulation};
use pliant_render::PictureError;

/// Number of frames at which the motion of bones is looked at.
const LOOKED_AT: usize = 1000;

/// What is known of a scene before its first frame.
pub struct Prepared<'a> {
    simulation: &'a Simulation,
    attachments: Vec<Attachment>,
}

/// The vertices of a muscle that a bone holds.
struct Attachment {
    muscle: String,
    bone: String,
    /// Number of vertices, and their share of all.
    vertices: usize,
    share: f64,
    /// Median and greatest distance of the vertices from the bone; 0 inside of it [m].
    distances: [f64; 2],
}

impl<'a> Prepared<'a> {
    /// A scene before its first frame.
    pub fn new(simulation: &'a Simulation) -> Self {
        let muscles = 0..simulation.bodies.len();
        let attachments = muscles.flat_map(|m| attachments(simulation, m)).collect();
        Self {
            simulation,
            attachments,
        }
    }

    /// The checks that a run would make of its start.
    pub fn verdicts(&self) -> Vec<Verdict> {
        start_checks(self.simulation)
    }

    /// The parted pairs of surfaces, as in the summary of a run.
    pub fn start(&self) -> Value {
        starts(self.simulation)
    }

    /// The attachments, for the summary.
    pub fn attachments(&self) -> Value {
        let one = |of: &Attachment| {
            json!({
                "muscle": of.muscle,
                "bone": of.bone,
                "vertices": of.vertices,
                "share": of.share,
                "distance_median_m": of.distances[0],
                "distance_max_m": of.distances[1],
            })
        };
        self.attachments.iter().map(one).collect()
    }

    /// Tables of the attachments and of the parted pairs.
    pub fn tables(&self) -> [Table; 2] {
        let heads = [
            "muscle",
            "bone",
            "vertices held",
            "of all [%]",
            "median distance [mm]",
            "greatest [mm]",
        ];
        let mut held = Table::new("Attachments", heads);
        for of in &self.attachments {
            let share = format!("{:.1}", 100.0 * of.share);
            let [middle, most] = of.distances.map(|d| format!("{:.2}", d * 1e3));
            let (muscle, bone) = (of.muscle.clone(), of.bone.clone());
            held.row([muscle, bone, of.vertices.to_string(), share, middle, most]);
        }
        let heads = [
            "pair",
            "crossings",
            "depth [mm]",
            "moved, RMS [mm]",
            "moved most [mm]",
        ];
        let mut parted = Table::new(
            "Overlap at the start, removed before the first frame",
            heads,
        );
        for pair in &self.simulation.parted {
            let mm = |length: f64| format!("{:.2}", length * 1e3);
            parted.row([
                pair.pair.join(" and "),
                pair.crossings.to_string(),
                mm(pair.depth),
                mm(pair.moved.rms),
                mm(pair.moved.max),
            ]);
        }
        [held, parted]
    }

    /// Approximate size of the frames of a run [bytes].
    pub fn bytes_on_disk(&self) -> u64 {
        bytes_of_run(self.simulation, &Stored::default())
    }

    /// Notes on the start, and the size of the results.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = self.simulation.notes.clone();
        let loose = self
            .simulation
            .bodies
            .iter()
            .zip(&self.simulation.scene.muscles);
        let loose = loose.filter(|(body, _)| body.attached.is_empty());
        notes.extend(loose.map(|(_, muscle)| format!("{}: no bone holds it", muscle.name)));
        let megabytes = number(self.bytes_on_disk() as f64 * 1e-6);
        notes.push(format!("a run writes about {megabytes} MB of frames"));
        notes
    }

    /// A picture of the start, with the attached vertices in colour, as PNG.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn preview(&self) -> Result<Vec<u8>, PictureError> {
        let description = self.simulation.description();
        let mut shots = Shots::new(false);
        shots.add(&Arc::new(self.simulation.state()), 0.0);
        match Painter::new(&description, &shots) {
            Some(painter) => painter.of_attachments(&self.simulation.state()).to_png(),
            None => Ok(Vec::new()),
        }
    }
}

/// The vertices of a muscle that each bone holds.
fn attachments(simulation: &Simulation, m: usize) -> Vec<Attachment> {
    let (scene, body) = (&simulation.scene, &simulation.bodies[m]);
    let mut all = Vec::new();
    for (b, bone) in scene.bones.iter().enumerate() {
        let back = simulation.pose(b, 0.0).inverse();
        let held = body.attached.iter().filter(|(_, of)| *of == b);
        let distance = |(v, _): &(u32, usize)| {
            let nearest = simulation
                .surface(b)
                .closest(&(back * body.rest.vertices[*v as usize]));
            nearest.map(|nearest| nearest.distance.max(0.0))
        };
        let distances: Vec<f64> = held.clone().filter_map(distance).collect();
        if distances.is_empty() {
            continue;
        }
        all.push(Attachment {
            muscle: scene.muscles[m].name.clone(),
            bone: bone.name.clone(),
            vertices: distances.len(),
            share: distances.len() as f64 / body.rest.vertices.len() as f64,
            distances: [
                median(distances.clone()).unwrap_or(f64::NAN),
                max_or_nan(distances),
            ],
        });
    }
    all
}

/// Approximate size of the frames of a run [bytes].
pub fn bytes_of_run(simulation: &Simulation, stored: &Stored) -> u64 {
    let frames = simulation.scene.frames;
    let first = frames::bytes(&simulation.description(), &simulation.state(), stored);
    let bones = first.bones.iter().enumerate();
    let of_bones: u64 = bones
        .map(|(bone, bytes)| bytes * (1 + frames_of_motion(simulation, bone)))
        .sum();
    of_bones + first.muscles * (frames as u64 + 1)
}

/// Approximate number of frames in which a bone has another pose than in the frame before.
fn frames_of_motion(simulation: &Simulation, bone: usize) -> u64 {
    let frames = simulation.scene.frames;
    let every = frames.div_ceil(LOOKED_AT).max(1);
    let pose = |frame: usize| -> Isometry3<f64> { simulation.pose(bone, frame as f64) };
    let moves = |frame: &usize| pose(*frame) != pose(frame - 1);
    let looked_at = (1..=frames).step_by(every);
    let moving = looked_at.clone().filter(moves).count();
    (moving as f64 / looked_at.count().max(1) as f64 * frames as f64).round() as u64
}
