//! The joint of a sweep, and the motion of the scene that turns it.

use nalgebra::Isometry3;

use super::SweepError;
use crate::format::number;
use crate::mesh::measures::max_or_nan;
use crate::opensim::ModelDrive;
use crate::scene::{Joint, Key, Motion, Scene};

/// Greatest change of an angle from one frame to the next between two poses \[rad\].
const LARGEST_STEP: f64 = 0.1;

/// A pose is that of the file if it departs from it by at most this angle \[rad\], and by this share of its
/// distance from the origin.
const AT_REST: f64 = 1e-9;

/// The joint of that name or of a bone of that name, and which bones turn about it.
///
/// # Errors
/// A scene without such a joint.
pub fn joint(scene: &Scene, name: &str) -> Result<(Joint, Vec<bool>), SweepError> {
    let of_bones = scene.bones.iter().map(|b| b.motion.joint.as_ref());
    let named = |joint: &&Joint| joint.name.as_deref() == Some(name);
    let all = || of_bones.clone().flatten().filter(named);
    // A bone that glides has a path of its own.
    let turns = all().find(|joint| joint.path.is_empty());
    let named = turns.or_else(|| all().next());
    if let Some(found) = named {
        let turning = of_bones
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
    let known = joints(scene);
    let known = match known.is_empty() {
        true => NO_JOINT.to_owned(),
        false => format!("known: {}", known.join(", ")),
    };
    Err(SweepError::NoJoint {
        name: name.to_owned(),
        known,
    })
}

/// What a scene without a joint lacks.
pub const NO_JOINT: &str = "no bone has a motion with `centre` and `axis`, which make a joint";

/// The names of the joints of a scene. Bones whose joint has the same name share one; a joint without a name
/// has that of its bone.
pub fn joints(scene: &Scene) -> Vec<&str> {
    let mut known: Vec<(bool, &str)> = Vec::new();
    for bone in &scene.bones {
        if let Some(joint) = &bone.motion.joint {
            let name = joint.name.as_deref().unwrap_or(&bone.name);
            let one = (joint.name.is_some(), name);
            if !known.contains(&one) {
                known.push(one);
            }
        }
    }
    known.into_iter().map(|(_, name)| name).collect()
}

/// The joint of the bones that turn, and of each bone that glides as it turns, with the bones that they
/// move.
///
/// # Errors
/// A path that does not reach the angles, or belongs to another axis.
pub fn moved(
    scene: &Scene,
    (joint, turning): (&Joint, &[bool]),
    angles: &[f64],
) -> Result<Vec<(Joint, Vec<bool>)>, SweepError> {
    let mut turns = turning.to_vec();
    let mut all = Vec::new();
    for (b, bone) in scene.bones.iter().enumerate().filter(|(b, _)| turning[*b]) {
        let own = bone.motion.joint.as_ref();
        let Some((own, [least, most])) = own.and_then(|own| Some((own, own.path_range()?))) else {
            continue;
        };
        let name = &bone.name;
        if own.axis != joint.axis {
            return Err(SweepError::Range(format!(
                "the path of bone `{name}` is of another axis; leave the axis out, or the path"
            )));
        }
        let at_rest = own.pose(0.0);
        let size = own.centre.coords.norm() + at_rest.translation.vector.norm();
        let is_at_rest = at_rest.translation.vector.norm() <= AT_REST * size
            && at_rest.rotation.angle() <= AT_REST
            && least <= 0.0
            && most >= 0.0;
        if !is_at_rest {
            return Err(SweepError::Range(format!(
                "the path of bone `{name}` has another pose at 0 deg than the file, where a sweep begins"
            )));
        }
        let is_beyond = |angle: &&f64| !(least <= **angle && **angle <= most);
        if let Some(angle) = angles.iter().find(is_beyond) {
            let [angle, least, most] = [*angle, least, most].map(|a| number(a.to_degrees()));
            return Err(SweepError::Range(format!(
                "the path of bone `{name}` goes from {least} to {most} deg, and not to {angle} deg"
            )));
        }
        turns[b] = false;
        let only = (0..turning.len()).map(|other| other == b).collect();
        all.push((own.clone(), only));
    }
    let mut main = joint.clone();
    main.path.clear();
    all.insert(0, (main, turns));
    Ok(all)
}

/// The course of a scene: displacements of joints, frame by frame.
#[derive(Debug)]
pub(super) struct Course {
    /// Which bones each joint moves; a joint stands after the one that carries it.
    pub(super) moves: Vec<Vec<bool>>,
    /// Which bones are beyond each joint: a muscle that such a bone and another one hold crosses it.
    pub(super) beyond: Vec<Vec<bool>>,
    /// Displacement of each joint in each frame [m].
    pub(super) frames: Vec<Vec<Isometry3<f64>>>,
    /// Frame of each value.
    pub(super) values: Vec<usize>,
}

impl Course {
    /// Joints that turn by the same angle, from the given pose to the first angle and on, with some frames from one
    /// value to the next.
    pub(super) fn of_joint(
        joints: &[(Joint, Vec<bool>)],
        turning: Vec<bool>,
        (angles, step): (&[f64], f64),
        frames: usize,
    ) -> Self {
        let at = |angle: f64| joints.iter().map(|(joint, _)| joint.pose(angle)).collect();
        let mut course = vec![vec![Isometry3::identity(); joints.len()]];
        let from = angles[0];
        if from != 0.0 {
            let count = (from.abs() / step).ceil().max(1.0) as usize * frames;
            course.extend((1..=count).map(|k| at(from * k as f64 / count as f64)));
        }
        let mut values = vec![course.len() - 1];
        for pair in angles.windows(2) {
            for k in 1..=frames {
                let angle = match k == frames {
                    true => pair[1],
                    false => pair[0] + (pair[1] - pair[0]) * (k as f64 / frames as f64),
                };
                course.push(at(angle));
            }
            values.push(course.len() - 1);
        }
        Self {
            moves: joints.iter().map(|(_, moves)| moves.clone()).collect(),
            beyond: vec![turning],
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
        let moves: Vec<Vec<bool>> = (0..drive.joints()).map(|k| drive.moves(k)).collect();
        Self {
            beyond: moves.clone(),
            moves,
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
            path: Vec::new(),
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

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(joints: [&str; 3]) -> Scene {
        let bone = |(k, joint): (usize, &str)| {
            format!(
                "[[bone]]\nname = '{}'\nshape = 'soft-ball'\n[bone.motion]\n{joint}\n\
                 keys = [{{ frame = 0 }}]\n",
                ["femur", "tibia", "patella"][k]
            )
        };
        let bones: String = joints.into_iter().enumerate().map(bone).collect();
        let text = format!(
            "frames = 1\nframe_rate = '60 Hz'\n[[muscle]]\nname = 'calf'\nshape = 'tetrahedron'\n{bones}"
        );
        crate::scene::parse(&text, "leg.toml", std::path::Path::new(".")).expect("a scene")
    }

    #[test]
    fn bones_share_a_joint_by_its_name_alone() {
        let place = "centre = ['0 m', '0 m', '0 m']\naxis = [1, 0, 0]";
        let knee = format!("joint = 'knee'\n{place}");
        let of_tibia = format!("joint = 'tibia'\n{place}");
        assert_eq!(joints(&scene([&knee, &knee, ""])), ["knee"]);
        assert_eq!(joints(&scene(["", place, ""])), ["tibia"]);
        assert_eq!(joints(&scene([&knee, place, &knee])), ["knee", "tibia"]);
        // A joint with the name of another bone is another joint.
        assert_eq!(joints(&scene([&of_tibia, place, ""])), ["tibia"; 2]);
        assert!(joints(&scene([""; 3])).is_empty(), "control");
    }
}
