//! The joint of a sweep, and the motion of the scene that turns it.

use nalgebra::Isometry3;

use super::SweepError;
use crate::scene::{Joint, Key, Motion, Scene};

/// The joint of that name or of a bone of that name, and which bones turn about it.
pub(super) fn joint(scene: &Scene, name: &str) -> Result<(Joint, Vec<bool>), SweepError> {
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

/// Writes the sweep into the motions of the scene. Returns the frame of the first value.
pub(super) fn prepare(
    scene: &mut Scene,
    turning: &[bool],
    joint: &Joint,
    angles: &[f64],
    step: f64,
    frames: usize,
) -> usize {
    let mut keys = vec![Key {
        frame: 0.0,
        pose: Isometry3::identity(),
    }];
    let mut frame = 0usize;
    let from = angles[0];
    if from != 0.0 {
        let count = (from.abs() / step).ceil().max(1.0);
        for k in 1..=count as usize {
            frame += frames;
            keys.push(Key {
                frame: frame as f64,
                pose: joint.pose(from * k as f64 / count),
            });
        }
    }
    let first = frame;
    for &angle in &angles[1..] {
        frame += frames;
        keys.push(Key {
            frame: frame as f64,
            pose: joint.pose(angle),
        });
    }
    for (bone, turns) in scene.bones.iter_mut().zip(turning) {
        let keys = if *turns { keys.clone() } else { Vec::new() };
        bone.motion = Motion {
            keys,
            joint: bone.motion.joint.take(),
            linear: true,
        };
    }
    scene.frames = frame;
    first
}
