//! The joint of a sweep, and the motion of the scene that turns it.

use nalgebra::Isometry3;

use super::SweepError;
use crate::mesh::measures::max_or_nan;
use crate::opensim::ModelDrive;
use crate::scene::{Joint, Key, Motion, Scene};

/// Greatest change of an angle from one frame to the next between two poses \[rad\].
const LARGEST_STEP: f64 = 0.1;

/// The joint of that name or of a bone of that name, and which bones turn about it.
///
/// # Errors
/// A scene without such a joint.
pub fn joint(scene: &Scene, name: &str) -> Result<(Joint, Vec<bool>), SweepError> {
    let joints = scene.bones.iter().map(|b| b.motion.joint.as_ref());
    let named = joints
        .clone()
        .flatten()
        .find(|j| j.name.as_deref() == Some(name));
    if let Some(found) = named {
        let turning = joints
            .map(|j| j.is_some_and(|j| j.name.as_deref() == Some(name)))
            .collect();
        return Ok((found.clone(), turning));
    }
    let of_bone = scene
        .bones
        .iter()
        .position(|b| b.name == name && b.motion.joint.is_some());
    if let Some((b, found)) = of_bone.and_then(|b| Some((b, scene.bones[b].motion.joint.clone()?)))
    {
        return Ok((found, (0..scene.bones.len()).map(|k| k == b).collect()));
    }
    let mut known: Vec<String> = Vec::new();
    for bone in &scene.bones {
        if let Some(joint) = &bone.motion.joint {
            let text = joint.name.as_ref().unwrap_or(&bone.name);
            if !known.contains(text) {
                known.push(text.clone());
            }
        }
    }
    let known = match known.is_empty() {
        true => "no bone has a motion with `centre` and `axis`, which make a joint".to_owned(),
        false => format!("known: {}", known.join(", ")),
    };
    Err(SweepError::NoJoint {
        name: name.to_owned(),
        known,
    })
}

/// The course of a scene: displacements of joints, frame by frame.
#[derive(Debug)]
pub(super) struct Course {
    /// Which bones each joint moves; a joint stands after the one that carries it.
    pub(super) moves: Vec<Vec<bool>>,
    /// Displacement of each joint in each frame [m].
    pub(super) frames: Vec<Vec<Isometry3<f64>>>,
    /// Frame of each value.
    pub(super) values: Vec<usize>,
}

impl Course {
    /// A joint that turns from the given pose to the first angle and on, with some frames from one
    /// value to the next.
    pub(super) fn of_joint(
        turning: Vec<bool>,
        joint: &Joint,
        angles: &[f64],
        step: f64,
        frames: usize,
    ) -> Self {
        let mut course = vec![vec![Isometry3::identity()]];
        let from = angles[0];
        if from != 0.0 {
            let count = (from.abs() / step).ceil().max(1.0) as usize * frames;
            let approach = (1..=count).map(|k| joint.pose(from * k as f64 / count as f64));
            course.extend(approach.map(|pose| vec![pose]));
        }
        let mut values = vec![course.len() - 1];
        for pair in angles.windows(2) {
            for k in 1..=frames {
                let angle = match k == frames {
                    true => pair[1],
                    false => pair[0] + (pair[1] - pair[0]) * (k as f64 / frames as f64),
                };
                course.push(vec![joint.pose(angle)]);
            }
            values.push(course.len() - 1);
        }
        Self {
            moves: vec![turning],
            frames: course,
            values,
        }
    }

    /// Poses of a model, with frames between two poses that are far from each other.
    pub(super) fn of_poses(drive: &ModelDrive, poses: &[Vec<f64>]) -> Self {
        let mut frames = vec![drive.displacements(&drive.rest)];
        let (mut values, mut before) = (Vec::new(), &drive.rest);
        for pose in poses {
            let farthest = (0..pose.len())
                .filter(|k| drive.model.coordinates[*k].is_angle)
                .map(|k| (pose[k] - before[k]).abs());
            let parts = (max_or_nan(farthest.chain([0.0])) / LARGEST_STEP)
                .ceil()
                .max(1.0);
            for part in 1..=parts as usize {
                let share = part as f64 / parts;
                let mix = before.iter().zip(pose).map(|(a, b)| a + (b - a) * share);
                // The last part is the pose itself.
                let mixed = if part == parts as usize {
                    pose.clone()
                } else {
                    mix.collect()
                };
                frames.push(drive.displacements(&mixed));
            }
            values.push(frames.len() - 1);
            before = pose;
        }
        Self {
            moves: (0..drive.joints()).map(|k| drive.moves(k)).collect(),
            frames,
            values,
        }
    }

    /// The first joint at its greatest turn, for pictures.
    pub(super) fn shown(&self, centre: nalgebra::Point3<f64>) -> Joint {
        let turns = self
            .frames
            .iter()
            .filter_map(|frame| frame.first()?.rotation.axis_angle());
        let greatest = turns.max_by(|a, b| a.1.total_cmp(&b.1));
        Joint {
            name: None,
            centre,
            axis: greatest.map_or_else(nalgebra::Vector3::z_axis, |(axis, _)| axis),
        }
    }

    /// The pose of a bone in a frame.
    fn pose(&self, bone: usize, frame: usize) -> Isometry3<f64> {
        let all = self.frames[frame].iter().zip(&self.moves);
        let own = all.filter(|(_, moves)| moves[bone]);
        own.fold(Isometry3::identity(), |pose, (by, _)| pose * by)
    }

    /// Writes the course into the motions of a scene.
    pub(super) fn write(&self, scene: &mut Scene) {
        for (b, bone) in scene.bones.iter_mut().enumerate() {
            let moves = self.moves.iter().any(|moves| moves[b]);
            let key = |frame: usize| Key {
                frame: frame as f64,
                pose: self.pose(b, frame),
            };
            bone.motion = Motion {
                keys: if moves {
                    (0..self.frames.len()).map(key).collect()
                } else {
                    Vec::new()
                },
                joint: bone.motion.joint.take(),
                linear: true,
            };
        }
        scene.frames = self.frames.len() - 1;
    }
}
