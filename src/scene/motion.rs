//! Rigid motion by key frames.
//!
//! With linear interpolation a body turns about one axis in space between two keys and slides along
//! it, both at constant speed: a screw. The speed jumps at each key. A smooth motion has a steady
//! speed and no acceleration at each key, and its pose, speed and acceleration are continuous (C2).

use nalgebra::{Isometry3, Translation3, Unit, Vector3};

use super::error::{SceneError, SceneProblem};
use super::reader::{Limit, Section};
use super::twist::{Twist, smooth_step};
use super::units::Dimension;
use super::{Joint, Key, Motion};
use crate::mesh::measures::max_or_nan;
use crate::opensim::Spline;
use crate::rigid::{screw_part, turned};

/// Greatest angle of a part of a rotation about one axis between two keys \[rad\], well below the
/// half turn, at which the axis of the relative pose is undefined.
const LARGEST_TURN: f64 = 2.0;
/// Greatest relative angle between two keys about different axes \[rad\], below the half turn.
const CLEAR_TURN: f64 = 3.0;
/// Number of poses in a frame of a bone on a path, and greatest number of frames that have as many.
const POSES: f64 = 8.0;
const MOST_FRAMES: f64 = 10_000.0;
/// Least angle between two poses of a path \[rad\].
const CLOSEST: f64 = 1e-6;
/// Number of parts of a path in which an angle is looked for, and of thirds that follow.
const LOOKED_AT: f64 = 200.0;
const THIRDS: usize = 60;
/// Greatest angle of a key \[rad\]; bounds the number of inserted keys.
const LARGEST_ANGLE: f64 = 1000.0;

impl Motion {
    /// The pose at a possibly fractional frame: the identity without keys, the pose of the first or
    /// last key outside their range, exactly the pose of a key at its frame, and between two keys
    /// the screw of a linear motion or the blend of a smooth one.
    ///
    /// The smooth motion blends the steady screws through both keys by a weight with two vanishing
    /// derivatives at its ends. From rest to rest this is the motion of least jerk (Flash and Hogan
    /// 1985). Turns about one axis never run past their keys. The common centre of all turns stays
    /// where it is.
    ///
    /// ```
    /// use nalgebra::{Isometry3, Vector3};
    /// use pliant::scene::{Key, Motion};
    /// let turned = Isometry3::rotation(Vector3::z());
    /// let keys = vec![Key { frame: 0.0, pose: Isometry3::identity() }, Key { frame: 10.0, pose: turned }];
    /// let motion = Motion { keys, joint: None, linear: false };
    /// assert!((motion.pose(5.0).rotation.angle() - 0.5).abs() < 1e-15);
    /// assert!(motion.pose(1.0).rotation.angle() < 0.01);
    /// let linear = Motion { linear: true, ..motion };
    /// assert!((linear.pose(1.0).rotation.angle() - 0.1).abs() < 1e-15);
    /// ```
    #[must_use]
    pub fn pose(&self, frame: f64) -> Isometry3<f64> {
        let next = self.keys.partition_point(|k| k.frame <= frame);
        match (
            next.checked_sub(1).and_then(|last| self.keys.get(last)),
            self.keys.get(next),
        ) {
            (None, None) => Isometry3::identity(),
            (Some(only), None) | (None, Some(only)) => only.pose,
            // At a key the pose has the bits of the key.
            (Some(before), Some(_)) if before.frame == frame => before.pose,
            (Some(before), Some(after)) => {
                let share = (frame - before.frame) / (after.frame - before.frame);
                if self.linear {
                    return before.pose * screw_part(&(before.pose.inverse() * after.pose), share);
                }
                let through = |key: usize| {
                    let Key { frame: at, pose } = self.keys[key];
                    pose * self.twist(key).times(frame - at).pose()
                };
                let [from, to] = [through(next - 1), through(next)];
                from * screw_part(&(from.inverse() * to), smooth_step(share))
            }
        }
    }

    /// The motion of a frame through a key: that of both neighbouring spans together, none where a
    /// motion begins, ends or reverses.
    fn twist(&self, key: usize) -> Twist {
        let speed = |key: usize| {
            let [before, after] = [self.keys.get(key)?, self.keys.get(key + 1)?];
            let whole = Twist::of(&(before.pose.inverse() * after.pose));
            Some(whole.times(1.0 / (after.frame - before.frame)))
        };
        match key.checked_sub(1).and_then(speed).zip(speed(key)) {
            Some((before, after)) => before.shared(&after),
            None => Twist::default(),
        }
    }
}

/// A pose as a turn about a centre, its axis times its angle \[rad\], and the translation after it \[m\].
pub(super) fn turn_and_move(
    pose: &Isometry3<f64>,
    centre: &Vector3<f64>,
) -> (Vector3<f64>, Vector3<f64>) {
    let moved = pose.translation.vector + pose.rotation * centre - centre;
    (Twist::of(pose).turn, moved)
}

/// The path of a joint as cubic splines of turn and translation, with the last piece like its neighbour at
/// both ends.
struct Glide<'a> {
    path: &'a [Key],
    centre: Vector3<f64>,
    /// Of the turn, as a vector, and of the translation after it.
    parts: [Spline; 6],
}

impl<'a> Glide<'a> {
    /// `None` without a path.
    fn new(joint: &'a Joint) -> Option<Self> {
        let (path, centre) = (&joint.path, joint.centre.coords);
        if path.len() < 2 {
            return None;
        }
        let of_key = |key: &Key| {
            let (turn, moved) = turn_and_move(&key.pose, &centre);
            [turn.x, turn.y, turn.z, moved.x, moved.y, moved.z]
        };
        let all: Vec<[f64; 6]> = path.iter().map(of_key).collect();
        let part = |k: usize| {
            let each = path.iter().zip(&all);
            let points: Vec<[f64; 2]> = each.map(|(key, of)| [key.frame, of[k]]).collect();
            Spline::new(&points)
        };
        Some(Self {
            path,
            centre,
            parts: std::array::from_fn(part),
        })
    }

    /// The pose at an angle of the joint; at a key it has the bits of the key.
    fn at(&self, angle: f64) -> Isometry3<f64> {
        let (first, last) = (&self.path[0], &self.path[self.path.len() - 1]);
        let angle = angle.max(first.frame).min(last.frame);
        let next = self.path.partition_point(|key| key.frame < angle);
        if let Some(key) = self.path.get(next).filter(|key| key.frame == angle) {
            return key.pose;
        }
        let at = |part: usize| self.parts[part].at(angle);
        let turn = Vector3::new(at(0), at(1), at(2));
        let moved = Vector3::new(at(3), at(4), at(5));
        let turned = match Unit::try_new_and_get(turn, 0.0) {
            Some((axis, angle)) => turned(&axis, angle, &self.centre),
            None => Isometry3::identity(),
        };
        Isometry3::from_parts(
            Translation3::from(turned.translation.vector + moved),
            turned.rotation,
        )
    }
}

/// The pose at an angle of a joint on its path.
pub(super) fn along(joint: &Joint, angle: f64) -> Isometry3<f64> {
    Glide::new(joint).map_or_else(Isometry3::identity, |glide| glide.at(angle))
}

/// The angle of a pose about an axis \[rad\], in -pi..pi.
fn about(axis: &Unit<Vector3<f64>>, pose: &Isometry3<f64>) -> f64 {
    let q = pose.rotation;
    // The quaternion of the shorter rotation.
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    2.0 * libm::atan2(sign * q.imag().dot(axis), sign * q.w)
}

/// The angle \[rad\] at which a joint has a pose: of its turn about the axis, or that of the nearest pose on
/// its path.
pub(super) fn angle_of(joint: &Joint, pose: &Isometry3<f64>) -> f64 {
    let (Some(glide), Some([least, most])) = (Glide::new(joint), joint.path_range()) else {
        return about(&joint.axis, pose);
    };
    let moved = |key: &Key| (key.pose * joint.centre - joint.centre).norm();
    let size = max_or_nan(joint.path.iter().map(moved));
    let off = |angle: f64| {
        let there = glide.at(angle);
        let turned = (there.inverse() * pose).rotation.imag().norm();
        let apart = (there * joint.centre - pose * joint.centre).norm();
        turned + if size > 0.0 { apart / size } else { 0.0 }
    };
    // The nearest of many angles, and then thirds of the range around it.
    let step = (most - least) / LOOKED_AT;
    let all = (0..=LOOKED_AT as usize).map(|k| least + step * k as f64);
    let near = all.min_by(|a, b| off(*a).total_cmp(&off(*b)));
    let near = near.unwrap_or(least);
    let (mut from, mut to) = ((near - step).max(least), (near + step).min(most));
    for _ in 0..THIRDS {
        let [one, other] = [1.0, 2.0].map(|third| from + (to - from) * third / 3.0);
        if off(one) <= off(other) {
            to = other;
        } else {
            from = one;
        }
    }
    0.5 * (from + to)
}

/// A key as written: rotation about an axis through the joint's centre, translation along the axis,
/// then a further translation.
#[derive(Clone, Copy, Debug)]
struct Written {
    frame: f64,
    axis: Unit<Vector3<f64>>,
    angle: f64,
    slide: f64,
    translation: Vector3<f64>,
}

impl Written {
    fn pose(&self, centre: &Vector3<f64>) -> Isometry3<f64> {
        let turned = turned(&self.axis, self.angle, centre);
        let moved = turned.translation.vector + self.axis.as_ref() * self.slide + self.translation;
        Isometry3::from_parts(Translation3::from(moved), turned.rotation)
    }

    /// True for the same axis, or if one of both has no rotation.
    fn shares_axis(&self, other: &Self) -> bool {
        self.axis == other.axis
            || self.angle == 0.0 && self.slide == 0.0
            || other.angle == 0.0 && other.slide == 0.0
    }
}

/// Reads a section `[bone.motion]`.
pub(super) fn read(section: &Section<'_>) -> Result<Motion, SceneError> {
    let centre = section
        .get("centre")
        .map(|i| i.vector(Dimension::Length))
        .transpose()?;
    let axis = section.get("axis").map(|i| i.direction()).transpose()?;
    let keys = section.need(
        "keys",
        "[{ frame = 0, angle = \"0 rad\" }, { frame = 100, angle = \"1 rad\" }]",
    )?;
    let sections = section.sections("keys")?;
    if sections.is_empty() {
        return keys.fail(SceneProblem::EmptyList {
            expected: "at least one key".to_owned(),
        });
    }
    let joint = joint(section, centre, axis)?;
    let linear = is_linear(section)?;
    let at = |key: &Section<'_>| key.need("frame", "0")?.number(Limit::Within(0.0, 1e9));
    let (written, keys) = read_keys(section, &sections, (centre, axis), ("frame", &at))?;
    let Some(path) = section.get("path") else {
        return Ok(Motion {
            keys,
            joint,
            linear,
        });
    };
    let (Some(joint), Some(axis)) = (joint, axis) else {
        let missing = if centre.is_none() { "centre" } else { "axis" };
        return path.fail(SceneProblem::missing(
            missing,
            "`centre` and `axis` of the joint to the motion",
        ));
    };
    let steps = section.sections("path")?;
    if steps.len() < 2 {
        return path.fail(SceneProblem::OutOfRange {
            found: "a path of one pose".to_owned(),
            allowed: "poses at two angles at least".to_owned(),
        });
    }
    let half = Limit::Within(-std::f64::consts::PI, std::f64::consts::PI);
    let at = |key: &Section<'_>| {
        key.need("at", "\"0 deg\"")?
            .quantity(Dimension::Angle, half)
    };
    let (poses, keys_of_path) = read_keys(section, &steps, (centre, Some(axis)), ("at", &at))?;
    for (step, pose) in steps.iter().zip(&poses) {
        within(step, pose.angle, half)?;
    }
    let joint = Joint {
        path: keys_of_path,
        ..joint
    };
    let [least, most] = joint.path_range().unwrap_or_default();
    for (key, written) in sections.iter().zip(&written) {
        let other = [
            ("slide", written.slide != 0.0),
            ("translation", written.translation != Vector3::zeros()),
            ("axis", written.axis != axis && written.angle != 0.0),
        ];
        if let Some((other, _)) = other.into_iter().find(|(_, is_there)| *is_there) {
            return key.fail(SceneProblem::Conflict {
                first: "path".to_owned(),
                second: other.to_owned(),
            });
        }
        within(key, written.angle, Limit::Within(least, most))?;
    }
    let turning = Motion {
        keys,
        joint: None,
        linear,
    };
    let keys = glide(&turning, &joint);
    let mut numbers = keys
        .iter()
        .flat_map(|key| key.pose.translation.vector.iter());
    if numbers.any(|c| !c.is_finite()) {
        return path.fail(SceneProblem::OutOfRange {
            found: "a path whose poses are no numbers".to_owned(),
            allowed: "poses that are nearer to each other".to_owned(),
        });
    }
    Ok(Motion {
        keys,
        joint: Some(joint),
        linear,
    })
}

/// Refuses an angle of a pose outside of a limit, also one that is not written.
fn within(pose: &Section<'_>, angle: f64, limit: Limit) -> Result<(), SceneError> {
    match pose.get("angle") {
        Some(written) => written.quantity(Dimension::Angle, limit).map(|_| ()),
        None if limit.allows(angle) => Ok(()),
        None => pose.fail(SceneProblem::OutOfRange {
            found: "a pose without `angle`, which is 0 rad,".to_owned(),
            allowed: limit.describe("angle", "rad"),
        }),
    }
}

/// The poses on the path of a joint in the frames of a motion that turns it, and between them.
fn glide(turning: &Motion, joint: &Joint) -> Vec<Key> {
    let Some(glide) = Glide::new(joint) else {
        return Vec::new();
    };
    let at = |frame: f64| Key {
        frame,
        pose: glide.at(about(&joint.axis, &turning.pose(frame))),
    };
    let spans = || {
        turning
            .keys
            .windows(2)
            .filter(|pair| pair[0].pose != pair[1].pose)
    };
    let moving: f64 = spans().map(|pair| pair[1].frame - pair[0].frame).sum();
    let stride = (moving / MOST_FRAMES).ceil().max(1.0) / POSES;
    let mut keys = Vec::new();
    for pair in turning.keys.windows(2) {
        let (from, to) = (pair[0].frame, pair[1].frame);
        keys.push(at(from));
        if pair[0].pose != pair[1].pose {
            let mut step = 1.0;
            while from.floor() + step * stride < to {
                let frame = from.floor() + step * stride;
                if frame > from {
                    keys.push(at(frame));
                }
                step += 1.0;
            }
        }
    }
    keys.extend(turning.keys.last().map(|last| at(last.frame)));
    keys
}

/// Reads poses in the order of their frames or angles, with inserted ones in a large turn about one axis.
fn read_keys(
    section: &Section<'_>,
    sections: &[Section<'_>],
    (centre, axis): (Option<Vector3<f64>>, Option<Unit<Vector3<f64>>>),
    (name, at): (&'static str, ReadNumber<'_>),
) -> Result<(Vec<Written>, Vec<Key>), SceneError> {
    let point = centre.unwrap_or_default();
    let (mut all, mut keys) = (Vec::<Written>::new(), Vec::new());
    for key in sections {
        let written = read_key(key, axis, at)?;
        if written.angle != 0.0 && centre.is_none() {
            return section.fail(SceneProblem::missing(
                "centre",
                "`centre = [\"0 mm\", \"0 mm\", \"0 mm\"]`",
            ));
        }
        if let Some(before) = all.last() {
            let (what, closest, unit) = match name {
                "at" => ("angle [deg]", CLOSEST, 1.0_f64.to_degrees()),
                _ => (name, 0.0, 1.0),
            };
            if !(written.frame > before.frame + closest) {
                return key.need(name, "0")?.fail(SceneProblem::KeysOutOfOrder {
                    what,
                    frame: written.frame * unit,
                    before: before.frame * unit,
                });
            }
            between(before, &written, &point, key, &mut keys)?;
        }
        keys.push(Key {
            frame: written.frame,
            pose: written.pose(&point),
        });
        all.push(written);
    }
    Ok((all, keys))
}

/// Reads the number at which a pose stands.
type ReadNumber<'a> = &'a dyn Fn(&Section<'_>) -> Result<f64, SceneError>;

/// The key `interpolation`, smooth if it is absent.
fn is_linear(section: &Section<'_>) -> Result<bool, SceneError> {
    let Some(item) = section.get("interpolation") else {
        return Ok(false);
    };
    match item.text("smooth")? {
        "smooth" => Ok(false),
        "linear" => Ok(true),
        name => {
            let known = ["smooth", "linear"].into_iter();
            item.fail(super::parse::unknown_name("interpolation", name, known))
        }
    }
}

/// The joint of a motion with a centre and an axis; only such a motion can name one.
fn joint(
    section: &Section<'_>,
    centre: Option<Vector3<f64>>,
    axis: Option<Unit<Vector3<f64>>>,
) -> Result<Option<Joint>, SceneError> {
    let name = section
        .get("joint")
        .map(|item| item.text("hip").map(str::to_owned))
        .transpose()?;
    match (centre, axis) {
        (Some(centre), Some(axis)) => Ok(Some(Joint {
            name,
            centre: centre.into(),
            axis,
            path: Vec::new(),
        })),
        (None, _) if name.is_some() => section.fail(SceneProblem::missing(
            "centre",
            "`centre = [\"0 mm\", \"0 mm\", \"0 mm\"]`",
        )),
        (_, None) if name.is_some() => {
            section.fail(SceneProblem::missing("axis", "`axis = [-1, 0, 0]`"))
        }
        _ => Ok(None),
    }
}

fn read_key(
    key: &Section<'_>,
    axis: Option<Unit<Vector3<f64>>>,
    at: ReadNumber<'_>,
) -> Result<Written, SceneError> {
    let frame = at(key)?;
    let limit = Limit::Within(-LARGEST_ANGLE, LARGEST_ANGLE);
    let angle = key.quantity_or("angle", Dimension::Angle, limit, 0.0)?;
    let slide = key.quantity_or("slide", Dimension::Length, Limit::Any, 0.0)?;
    let axis = match key.get("axis") {
        Some(item) => Some(item.direction()?),
        None => axis,
    };
    if axis.is_none() && (angle != 0.0 || slide != 0.0) {
        return key.fail(SceneProblem::missing(
            "axis",
            "`axis = [-1, 0, 0]` to the motion",
        ));
    }
    let translation = key
        .get("translation")
        .map(|i| i.vector(Dimension::Length))
        .transpose()?;
    Ok(Written {
        frame,
        axis: axis.unwrap_or_else(Vector3::x_axis),
        angle,
        slide,
        translation: translation.unwrap_or_default(),
    })
}

/// Checks the path between two keys, and inserts keys if it is a large rotation about one axis.
fn between(
    before: &Written,
    after: &Written,
    centre: &Vector3<f64>,
    section: &Section<'_>,
    keys: &mut Vec<Key>,
) -> Result<(), SceneError> {
    if !before.shares_axis(after) {
        let relative = before.pose(centre).inverse() * after.pose(centre);
        let wide = before.angle.abs().max(after.angle.abs()) > std::f64::consts::PI;
        if wide || relative.rotation.angle() > CLEAR_TURN {
            return section.fail(SceneProblem::UnclearTurn {
                why: "the axis changes and the turn is near half a turn or more",
            });
        }
        return Ok(());
    }
    // Angles are at most 1000 rad, so there are at most 1000 parts.
    let parts = ((after.angle - before.angle).abs() / LARGEST_TURN)
        .ceil()
        .max(1.0);
    let axis = if before.angle == 0.0 && before.slide == 0.0 {
        after.axis
    } else {
        before.axis
    };
    let mut part = 1.0;
    while part < parts {
        let share = part / parts;
        let mix = |from: f64, to: f64| from + (to - from) * share;
        let written = Written {
            frame: mix(before.frame, after.frame),
            axis,
            angle: mix(before.angle, after.angle),
            slide: mix(before.slide, after.slide),
            translation: before.translation + (after.translation - before.translation) * share,
        };
        keys.push(Key {
            frame: written.frame,
            pose: written.pose(centre),
        });
        part += 1.0;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::{Point3, UnitQuaternion};
    use proptest::prelude::*;

    fn off_origin(angle: f64, slide: f64) -> Isometry3<f64> {
        let axis = Unit::new_normalize(Vector3::new(1.0, -2.0, 0.5));
        let written = Written {
            frame: 0.0,
            axis,
            angle,
            slide,
            translation: Vector3::zeros(),
        };
        written.pose(&Vector3::new(-0.083, 0.86, -0.005))
    }

    fn two(first: Isometry3<f64>, last: Isometry3<f64>) -> Motion {
        Motion {
            keys: vec![
                Key {
                    frame: 10.0,
                    pose: first,
                },
                Key {
                    frame: 30.0,
                    pose: last,
                },
            ],
            joint: None,
            linear: true,
        }
    }

    #[test]
    fn half_way_of_a_turn_about_a_distant_axis_is_half_the_turn() {
        for angle in [1e-12, 1e-6, 0.1, 1.0, 2.0, 3.0, -1.0] {
            let motion = two(Isometry3::identity(), off_origin(angle, 0.0));
            assert_relative_eq!(
                motion.pose(20.0),
                off_origin(angle / 2.0, 0.0),
                epsilon = 1e-15,
                max_relative = 1e-14
            );
            assert_relative_eq!(
                motion.pose(15.0),
                off_origin(angle / 4.0, 0.0),
                epsilon = 1e-15,
                max_relative = 1e-14
            );
        }
    }

    #[test]
    fn a_slide_is_even() {
        let motion = two(off_origin(0.3, 0.0), off_origin(1.3, 0.02));
        for share in [0.0, 0.1, 0.5, 0.9, 1.0] {
            let wanted = off_origin(0.3 + share, 0.02 * share);
            assert_relative_eq!(
                motion.pose(10.0 + 20.0 * share),
                wanted,
                epsilon = 1e-15,
                max_relative = 1e-14
            );
        }
        let moved = Isometry3::translation(0.1, 0.2, 0.3);
        assert_relative_eq!(
            two(Isometry3::identity(), moved).pose(15.0),
            Isometry3::translation(0.025, 0.05, 0.075)
        );
    }

    #[test]
    fn at_and_outside_the_keys_the_pose_is_the_keys_to_the_bit() {
        let (first, last) = (off_origin(0.7, 0.01), off_origin(-0.4, 0.02));
        let motion = two(first, last);
        for frame in [f64::NEG_INFINITY, 0.0, 10.0] {
            assert_eq!(motion.pose(frame), first);
        }
        for frame in [30.0, 31.0, f64::INFINITY] {
            assert_eq!(motion.pose(frame), last);
        }
        assert_eq!(Motion::default().pose(3.0), Isometry3::identity());
        assert!(
            motion
                .pose(f64::NAN)
                .translation
                .vector
                .iter()
                .all(|x| x.is_finite())
        );
    }

    #[test]
    fn the_longer_quaternion_takes_the_same_way() {
        let pose = off_origin(1.0, 0.0);
        let other = UnitQuaternion::new_unchecked(-pose.rotation.into_inner());
        let negative = Isometry3::from_parts(pose.translation, other);
        assert_relative_eq!(
            screw_part(&negative, 0.5),
            screw_part(&pose, 0.5),
            epsilon = 1e-15
        );
    }

    #[test]
    fn a_zero_turn_keeps_the_centre_to_the_bit() {
        assert_eq!(off_origin(0.0, 0.0), Isometry3::identity());
    }

    proptest! {
        /// Screws along one axis add up: `screw(a + b) = screw(a) screw(b)`, and the whole screw is
        /// the pose.
        #[test]
        fn parts_of_a_screw_add_up(
            angle in -3.1..3.1_f64, turn in 0.0..1.0_f64, rest in 0.0..1.0_f64,
            axis in prop::array::uniform3(-1.0..1.0_f64), moved in prop::array::uniform3(-2.0..2.0_f64),
            point in prop::array::uniform3(-2.0..2.0_f64),
        ) {
            let axis = Vector3::from(axis);
            prop_assume!(axis.norm() > 1e-3);
            let pose = Isometry3::from_parts(
                Translation3::from(Vector3::from(moved)),
                crate::rigid::turn(&Unit::new_normalize(axis), angle),
            );
            let point = Point3::from(point);
            let sum = screw_part(&pose, turn) * (screw_part(&pose, rest) * point);
            // Near the half turn the chord of a screw with a given translation is long, but never
            // longer than this.
            let bound = 1e-13 * (10.0 + 2.0 / libm::cos(angle / 2.0).abs());
            prop_assert!((sum - screw_part(&pose, turn + rest) * point).norm() <= bound);
            prop_assert!((screw_part(&pose, 1.0) * point - pose * point).norm() <= bound);
        }
    }
}
