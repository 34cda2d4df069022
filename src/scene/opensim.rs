//! The section `[opensim]`: bones as bodies of a model, and a motion from a file.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

use super::error::{SceneError, SceneProblem};
use super::reader::{Item, Limit, Section};
use super::units::Dimension;
use super::{BoneSpec, Key, Motion, parse, paths, smooth_step};
use crate::format::number;
use crate::opensim::{Model, ModelDrive, ModelError, MotionTable};

/// Number of frames from the meshes' pose to the first pose of a motion.
const LEAD_IN: u32 = 30;
/// Greatest number of frames of a motion from a file: each bone has a key in each.
const MOST_FRAMES: usize = 1_000_000;
/// Least sine of the angle between forward and up.
const LEAST_ACROSS: f64 = 1e-3;

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

/// The values of the section that need no model.
struct Given<'a> {
    forward: Option<Vector3<f64>>,
    bones: Option<Section<'a>>,
    at: Option<Section<'a>>,
    centres: Option<Section<'a>>,
    motion: Option<(Item<'a>, std::path::PathBuf)>,
    span: [Option<f64>; 2],
    speed: f64,
    lead_in: Option<u32>,
}

/// Reads the section and writes the motion into the bones.
pub(super) fn read(
    root: &Section<'_>,
    bones: &mut [BoneSpec],
    (frames, rate): (Option<usize>, Option<f64>),
) -> Result<Option<Arc<ModelDrive>>, SceneError> {
    let Some(section) = root.section("opensim")? else {
        return Ok(None);
    };
    let given = given(&section)?;
    let up = root.get("up").map(|item| item.direction()).transpose()?;
    let up = up.map_or_else(Vector3::y, |up| up.into_inner());
    let axes = [forward(&section, given.forward, &up)?, up];
    let item = section.need("model", "\"model.osim\"")?;
    let model = Model::read(&file(&item, "model.osim")?).map_err(|e| item.error(e.into()))?;
    let named = named(&section, &given, bones, &model)?;
    let rest = at_rest(&given, &model)?;
    let places = places(&given, bones, &named, &model)?;
    let drive = ModelDrive::new(model, named, &places, rest, axes);
    let mut drive = drive.map_err(|e| section.error_at("bones", e.into()))?;
    for (name, item) in given.centres.iter().flat_map(Section::items) {
        if !drive
            .model
            .child_of(name)
            .is_some_and(|body| drive.uses(body))
        {
            let allowed = "a joint between two bodies of `bones`";
            return item.fail(SceneProblem::out_of_range(name, allowed));
        }
    }
    if let Some(timing) = frames.zip(rate) {
        let note = move_bones(&section, &given, &drive, bones, timing)?;
        drive.notes.extend(note);
    }
    Ok(Some(Arc::new(drive)))
}

fn given<'a>(section: &Section<'a>) -> Result<Given<'a>, SceneError> {
    let direction = section.get("forward").map(|item| item.direction());
    let time = |key: &str| {
        let item = section.get(key);
        item.map(|item| item.quantity(Dimension::Time, Limit::Any))
            .transpose()
    };
    let most = u32::try_from(MOST_FRAMES).unwrap_or(u32::MAX);
    let lead_in = section.get("lead_in").map(|item| item.whole(0, most));
    let motion = match section.get("motion") {
        Some(item) => {
            let path = file(&item, "walk.mot")?;
            Some((item, path))
        }
        None => None,
    };
    Ok(Given {
        forward: direction.transpose()?.map(|d| d.into_inner()),
        bones: section.section("bones")?,
        at: section.section("at")?,
        centres: section.section("centres")?,
        motion,
        span: [time("from")?, time("to")?],
        speed: section.number_or("speed", Limit::Positive, 1.0)?,
        lead_in: lead_in.transpose()?,
    })
}

/// The direction in which the subject looks, across `up`.
fn forward(
    section: &Section<'_>,
    given: Option<Vector3<f64>>,
    up: &Vector3<f64>,
) -> Result<Vector3<f64>, SceneError> {
    match given {
        Some(given) => {
            let across = given - up * up.dot(&given);
            if !(across.norm() > LEAST_ACROSS) {
                let problem = SceneProblem::out_of_range("forward", "a direction across `up`");
                return Err(section.error_at("forward", problem));
            }
            Ok(across.normalize())
        }
        None if *up == Vector3::y() => Ok(Vector3::x()),
        None => section.fail(SceneProblem::missing(
            "forward",
            "`forward = [1, 0, 0]`: where the subject looks",
        )),
    }
}

/// The body of each bone.
fn named(
    section: &Section<'_>,
    given: &Given<'_>,
    bones: &[BoneSpec],
    model: &Model,
) -> Result<Vec<Option<usize>>, SceneError> {
    section.need("bones", "{ femur = \"femur_r\", pelvis = \"pelvis\" }")?;
    let mut named = vec![None; bones.len()];
    for (name, item) in given.bones.iter().flat_map(Section::items) {
        let Some(bone) = bones.iter().position(|b| b.name == name) else {
            let known = bones.iter().map(|b| b.name.as_str());
            return item.fail(parse::unknown_name("bone", name, known));
        };
        let body = model.body(item.text("femur_r")?);
        named[bone] = Some(body.map_err(|e| item.error(e.into()))?);
    }
    Ok(named)
}

/// Places of joints of the model in the scene [m], by their child bodies: those of `centres`, and of
/// bones with a joint of their own.
fn places(
    given: &Given<'_>,
    bones: &[BoneSpec],
    named: &[Option<usize>],
    model: &Model,
) -> Result<BTreeMap<usize, Point3<f64>>, SceneError> {
    let mut places = BTreeMap::new();
    let joints = bones.iter().map(|bone| bone.motion.joint.as_ref());
    for (joint, body) in joints.zip(named) {
        if let Some((joint, body)) = joint.zip(*body) {
            places.insert(body, joint.centre);
        }
    }
    for (name, item) in given.centres.iter().flat_map(Section::items) {
        let place = item.vector(Dimension::Length)?;
        let Some(body) = model.child_of(name) else {
            let known = model.joint_names();
            return item.fail(parse::unknown_name("joint of the model", name, known));
        };
        places.insert(body, Point3::from(place));
    }
    Ok(places)
}

/// The values of the coordinates where the meshes are: defaults, and those of `at`.
fn at_rest(given: &Given<'_>, model: &Model) -> Result<Vec<f64>, SceneError> {
    let mut values: Vec<f64> = model.coordinates.iter().map(|c| c.default).collect();
    for (name, item) in given.at.iter().flat_map(Section::items) {
        let index = model.coordinate(name).map_err(|e| item.error(e.into()))?;
        let dimension = match model.coordinates[index].is_angle {
            true => Dimension::Angle,
            false => Dimension::Length,
        };
        values[index] = item.quantity(dimension, Limit::Any)?;
    }
    model.couple(&mut values);
    Ok(values)
}

/// Writes the poses of a motion into the bones that the model moves. Returns a note where frames are too
/// few.
fn move_bones(
    section: &Section<'_>,
    given: &Given<'_>,
    drive: &ModelDrive,
    bones: &mut [BoneSpec],
    (frames, rate): (usize, f64),
) -> Result<Option<String>, SceneError> {
    let Some((item, path)) = &given.motion else {
        let keys = ["from", "to", "speed", "lead_in"];
        let unused = keys.iter().find_map(|key| section.get(key));
        let add = "`motion = \"walk.mot\"`, which it is a part of";
        return unused.map_or(Ok(None), |item| {
            item.fail(SceneProblem::missing("motion", add))
        });
    };
    if frames > MOST_FRAMES {
        let allowed = format!("a motion from a file for at most {MOST_FRAMES} frames");
        return item.fail(SceneProblem::out_of_range(&frames.to_string(), &allowed));
    }
    let table = MotionTable::read(path).map_err(|e| item.error(e.into()))?;
    let columns = table
        .coordinates(&drive.model)
        .map_err(|e| item.error(e.into()))?;
    let [first, last] = table.span();
    let [from, to] = [
        given.span[0].unwrap_or(first),
        given.span[1].unwrap_or(last),
    ];
    for (key, time, low) in [("from", from, first), ("to", to, from)] {
        if !(low..=last).contains(&time) {
            let allowed = format!("a time from {low} to {last} s");
            let problem = SceneProblem::out_of_range(&format!("{time} s"), &allowed);
            return Err(section.error_at(key, problem));
        }
    }
    let start = table.values(&drive.model, &columns, from);
    let rests = start == drive.rest;
    let lead_in = given.lead_in.unwrap_or(if rests { 0 } else { LEAD_IN }) as usize;
    for frame in 0..=frames {
        let time = from + given.speed * (frame as f64 - lead_in as f64) / rate;
        let values = if frame < lead_in {
            let share = smooth_step(frame as f64 / lead_in as f64);
            let both = drive.rest.iter().zip(&start);
            let mut mixed: Vec<f64> = both.map(|(a, b)| a + (b - a) * share).collect();
            drive.model.couple(&mut mixed);
            mixed
        } else {
            table.values(&drive.model, &columns, time.min(to))
        };
        let poses = drive.poses(&values);
        for ((bone, body), pose) in bones.iter_mut().zip(&drive.bones).zip(poses) {
            if body.is_none() {
                continue;
            }
            if frame == 0 {
                let joint = bone.motion.joint.take();
                bone.motion = Motion {
                    joint,
                    ..Motion::default()
                };
            }
            let frame = frame as f64;
            bone.motion.keys.push(Key { frame, pose });
        }
        // After the last key the pose stays.
        if frame >= lead_in && time >= to {
            break;
        }
    }
    for bone in bones.iter_mut() {
        let rests = |key: &Key| key.pose == Isometry3::identity();
        if bone.motion.keys.iter().all(rests) {
            bone.motion.keys.clear();
        }
    }
    let end = from + given.speed * (frames as f64 - lead_in as f64) / rate;
    let needed = lead_in as f64 + (to - from) * rate / given.speed;
    // Half a frame is the rounding of times to frames.
    Ok((needed > frames as f64 + 0.5).then(|| {
        format!(
            "the motion goes on to {} s, and the last frame is at {} s: all of it needs {} frames",
            number(to),
            number(end),
            needed.ceil()
        )
    }))
}
