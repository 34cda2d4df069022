//! The section `[opensim]`: bones as bodies of a model, and a motion from a file.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

use super::error::{SceneError, SceneProblem};
use super::reader::{Item, Limit, Section};
use super::units::Dimension;
use super::{BoneSpec, Key, Motion, parse, paths, smooth_step};
use crate::opensim::{Model, ModelDrive, ModelError, MotionTable};

/// Share of the frames from the meshes' pose to the first pose of a motion.
const LEAD_IN: f64 = 0.2;
/// Greatest number of frames of a motion from a file: each bone has a key in each.
const MOST_FRAMES: usize = 1_000_000;
/// Least distance between two poses that differ [rad or m].
const SAME: f64 = 1e-12;

impl From<ModelError> for SceneProblem {
    fn from(error: ModelError) -> Self {
        let (code, help) = (error.code, error.help.to_owned());
        let message = error.to_string();
        Self::Unfit {
            code,
            // An error without a file is about a value of the scene, whose place stands in front.
            message: message.trim_start_matches(": ").to_owned(),
            help,
        }
    }
}

/// The value of a path as a file.
fn file(item: &Item<'_>, example: &str) -> Result<std::path::PathBuf, SceneError> {
    let around = item.context.surroundings;
    let text = item.text(example)?;
    paths::resolve(text, around.folder, around.variable).map_err(|p| item.error(p))
}

/// Reads the section and writes the motion into the bones.
pub(super) fn read(
    root: &Section<'_>,
    bones: &mut [BoneSpec],
    frames: Option<usize>,
) -> Result<Option<Arc<ModelDrive>>, SceneError> {
    let Some(section) = root.section("opensim")? else {
        return Ok(None);
    };
    let item = section.need("model", "\"model.osim\"")?;
    let model = Model::read(&file(&item, "model.osim")?).map_err(|e| item.error(e.into()))?;
    let named = named(&section, bones, &model)?;
    let rest = at_rest(&section, &model)?;
    let up = root.get("up").map(|item| item.direction()).transpose()?;
    let up = up.map_or_else(Vector3::y, |up| up.into_inner());
    let forward = match section.get("forward") {
        Some(item) => {
            let given = item.direction()?.into_inner();
            let across = given - up * up.dot(&given);
            if !(across.norm() > 1e-3) {
                let allowed = "a direction across `up`";
                return item.fail(SceneProblem::out_of_range("forward", allowed));
            }
            across.normalize()
        }
        None if up == Vector3::y() => Vector3::x(),
        None => {
            return section.fail(SceneProblem::missing(
                "forward",
                "`forward = [1, 0, 0]`: where the subject looks",
            ));
        }
    };
    let drive = ModelDrive::new(model, &named, rest, [forward, up])
        .map_err(|e| section.error_at("bones", e.into()))?;
    if let (Some(item), Some(frames)) = (section.get("motion"), frames) {
        move_bones(&section, &item, &drive, bones, frames)?;
    } else if let Some(unused) = ["from", "to", "lead_in"]
        .iter()
        .find_map(|k| section.get(k))
    {
        return unused.fail(SceneProblem::missing(
            "motion",
            "`motion = \"walk.mot\"`, which it is a part of",
        ));
    }
    Ok(Some(Arc::new(drive)))
}

/// The body of each bone, and the place of its joint.
fn named(
    section: &Section<'_>,
    bones: &[BoneSpec],
    model: &Model,
) -> Result<Vec<Option<crate::opensim::DrivenBone>>, SceneError> {
    let list = section.need("bones", "{ femur = \"femur_r\", pelvis = \"pelvis\" }")?;
    let Some(list) = section.section("bones")? else {
        return list.fail(SceneProblem::EmptyList {
            expected: "a bone of the scene and its body".to_owned(),
        });
    };
    let mut centres = BTreeMap::new();
    if let Some(given) = section.section("centres")? {
        for (name, item) in given.items() {
            let place = item.vector(Dimension::Length)?;
            let Some(body) = model.child_of(name) else {
                let known = model.joint_names();
                return item.fail(parse::unknown_name("joint of the model", name, known));
            };
            centres.insert(body, Point3::from(place));
        }
    }
    let mut named = vec![None; bones.len()];
    for (name, item) in list.items() {
        let Some(bone) = bones.iter().position(|b| b.name == name) else {
            let known = bones.iter().map(|b| b.name.as_str());
            return item.fail(parse::unknown_name("bone", name, known));
        };
        let body = model
            .body(item.text("femur_r")?)
            .map_err(|e| item.error(e.into()))?;
        // A bone with a joint of its own in the scene has its place.
        let own = bones[bone].motion.joint.as_ref().map(|joint| joint.centre);
        named[bone] = Some((body, centres.get(&body).copied().or(own)));
    }
    Ok(named)
}

/// The values of the coordinates where the meshes are: defaults, and those of `at`.
fn at_rest(section: &Section<'_>, model: &Model) -> Result<Vec<f64>, SceneError> {
    let mut values: Vec<f64> = model.coordinates.iter().map(|c| c.default).collect();
    if let Some(given) = section.section("at")? {
        for (name, item) in given.items() {
            let index = model.coordinate(name).map_err(|e| item.error(e.into()))?;
            let dimension = match model.coordinates[index].is_angle {
                true => Dimension::Angle,
                false => Dimension::Length,
            };
            values[index] = item.quantity(dimension, Limit::Any)?;
        }
    }
    model.couple(&mut values);
    Ok(values)
}

/// Writes the poses of a motion into the bones that the model moves.
fn move_bones(
    section: &Section<'_>,
    item: &Item<'_>,
    drive: &ModelDrive,
    bones: &mut [BoneSpec],
    frames: usize,
) -> Result<(), SceneError> {
    if frames > MOST_FRAMES {
        let allowed = format!("a motion from a file for at most {MOST_FRAMES} frames");
        return item.fail(SceneProblem::out_of_range(&frames.to_string(), &allowed));
    }
    let table = MotionTable::read(&file(item, "walk.mot")?).map_err(|e| item.error(e.into()))?;
    let columns = table
        .coordinates(&drive.model)
        .map_err(|e| item.error(e.into()))?;
    let [first, last] = table.span();
    let within = Limit::Within(first, last);
    let from = section.quantity_or("from", Dimension::Time, within, first)?;
    let to = section.quantity_or("to", Dimension::Time, within, last)?;
    if !(to >= from) {
        let allowed = "a time after `from`";
        return section
            .need("to", "\"1 s\"")?
            .fail(SceneProblem::out_of_range(&to.to_string(), allowed));
    }
    let start = table.values(&drive.model, &columns, from);
    let rests = start
        .iter()
        .zip(&drive.rest)
        .all(|(a, b)| (a - b).abs() <= SAME);
    let longest = u32::try_from(frames - 1).unwrap_or(u32::MAX);
    let lead_in = match section.get("lead_in") {
        Some(item) => item.whole(0, longest)? as usize,
        None if rests || frames == 1 => 0,
        None => ((LEAD_IN * frames as f64).ceil() as usize).clamp(1, frames - 1),
    };
    let mut values = vec![0.0; start.len()];
    for frame in 0..=frames {
        let poses = if frame < lead_in {
            let share = smooth_step(frame as f64 / lead_in as f64);
            let mixed = drive.rest.iter().zip(&start);
            values
                .iter_mut()
                .zip(mixed)
                .for_each(|(v, (a, b))| *v = a + (b - a) * share);
            drive.model.couple(&mut values);
            drive.poses(&values)
        } else {
            let share = (frame - lead_in) as f64 / (frames - lead_in) as f64;
            let time = from + (to - from) * share;
            drive.poses(&table.values(&drive.model, &columns, time))
        };
        for ((bone, body), pose) in bones.iter_mut().zip(&drive.bones).zip(poses) {
            if body.is_none() {
                continue;
            }
            if frame == 0 {
                bone.motion = Motion {
                    joint: bone.motion.joint.take(),
                    ..Motion::default()
                };
            }
            bone.motion.keys.push(Key {
                frame: frame as f64,
                pose,
            });
        }
    }
    for bone in bones.iter_mut() {
        let rests = |key: &Key| key.pose == Isometry3::identity();
        if bone.motion.keys.iter().all(rests) {
            bone.motion.keys.clear();
        }
    }
    Ok(())
}
