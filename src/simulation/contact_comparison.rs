//! Contact methods compared on a simulation: its bones move on at once, and its muscles stay.

use std::time::Duration;

use crate::contact::comparison::detection::{DetectionRow, compare_detection};
use crate::contact::comparison::responses::{
    MovedBone, ResponseRow, compare_responses, known_sides,
};
use crate::contact::comparison::{Query, queries};
use crate::mesh::measures::max_or_nan;

use super::Simulation;

/// Time limit of the queries of a method of detection.
const BUDGET: Duration = Duration::from_millis(500);

/// What contact methods make of the vertices that bones have swallowed.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ContactComparison {
    /// Frame of the muscles.
    pub frame: usize,
    /// Number of frames that the bones move on at once.
    pub ahead: usize,
    /// Number of free vertices of all muscles.
    pub vertices: usize,
    /// Number of these vertices in the bounding box of a bone; in two boxes they count twice.
    pub queries: usize,
    /// Number of these vertices inside a bone; inside two bones they count twice.
    pub inside: usize,
    /// Their greatest depth [m].
    pub depth_max_m: f64,
    /// Number of them that were outside of the bone before it moved.
    pub sides_known: usize,
    /// Each response to penetration, applied once.
    pub responses: Vec<ResponseRow>,
    /// Each method of detection.
    pub detection: Vec<DetectionRow>,
}

/// Moves the bones of a simulation `ahead` frames from its present frame at once, while the muscles
/// stay. Then compares the responses to penetration on the vertices inside bones, and the methods of
/// detection on the vertices in the bounding boxes of bones \[cervenka2019\]. The simulation does
/// not change. Without a free vertex inside a bone all rows of responses are zero.
pub fn compare_contact(simulation: &Simulation, ahead: usize) -> ContactComparison {
    let frame = simulation.frame();
    let mut vertices = Vec::new();
    for body in &simulation.bodies {
        let x = &body.system.particles.position;
        vertices.extend((0..x.len()).filter(|&v| body.is_free(v)).map(|v| x[v]));
    }
    let mut bones = Vec::new();
    let mut asked: Vec<Query> = Vec::new();
    for (b, mesh) in simulation.bones.iter().enumerate() {
        let before = simulation.pose(b, frame as f64);
        let now = simulation.pose(b, (frame + ahead) as f64);
        let bone = MovedBone::new(mesh, &before, &now);
        let places = vertices
            .iter()
            .map(|p| (now.inverse() * p, before.inverse() * p));
        asked.extend(queries(b, mesh, bone.surface(), places));
        bones.push(bone);
    }
    let inside = asked.iter().filter(|q| q.inside);
    ContactComparison {
        frame,
        ahead,
        vertices: vertices.len(),
        queries: asked.len(),
        inside: inside.clone().count(),
        depth_max_m: max_or_nan(inside.map(|q| -q.distance)),
        sides_known: known_sides(&bones, &asked),
        responses: compare_responses(&bones, &asked),
        detection: compare_detection(&simulation.bones, &asked, BUDGET),
    }
}
