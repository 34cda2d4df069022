//! The bones of a scene as bodies of a model.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::document::{ModelError, NO_FIT};
use super::model::{Model, ModelJoint, ModelMuscle};
use crate::encode::{Encode, Encoder};

/// Turn that shows the axis of a coordinate \[rad\].
const SMALL_TURN: f64 = 0.1;
/// Greatest angle between the axis of a joint of the scene and that of the model \[rad\].
const OTHER_AXIS: f64 = 0.35;
/// Least sine of the angle between an axis and the upward direction.
const LEAST_ACROSS: f64 = 0.1;

/// Centre [m] and axis of a joint of a scene.
type Joint = (Point3<f64>, Vector3<f64>);

/// A model that moves the bones of a scene.
///
/// The scene's meshes have the pose of the model at the values `rest` of its coordinates. With the
/// poses `X` of bodies, a joint between parent `p` and child `c` then displaces the child, and all
/// that hangs on it, by `D = X_p(rest) P J(q) C^-1 X_c(rest)^-1`. A bone's motion is the product of
/// the displacements of the joints between it and the nearest body that carries all driven bones,
/// which stays at rest. A joint whose place in the scene is known acts there, so that a model of
/// another subject moves this one.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelDrive {
    /// The model.
    pub model: Model,
    /// The body of each bone of the scene; `None` for a bone that rests.
    pub bones: Vec<Option<usize>>,
    /// Values of all coordinates where the meshes are \[rad or m\].
    pub rest: Vec<f64>,
    /// What a user of the result must know.
    pub notes: Vec<String>,
    /// Joints between driven bodies, each after the one of its parent.
    links: Vec<Link>,
}

/// A joint that moves bones.
#[derive(Clone, Debug, PartialEq)]
struct Link {
    joint: usize,
    /// The link of the parent body, if it has one.
    parent: Option<usize>,
    /// From the scene to the ground of the model with the joint at its place there.
    into: Isometry3<f64>,
    /// Pose of the parent at rest, and inverse of that of the child.
    around: [Isometry3<f64>; 2],
    /// Pose of the child on the parent at rest.
    across: Isometry3<f64>,
}

impl ModelDrive {
    /// A model with the bones that it moves: the body of each, or `None`. `places` are the places of
    /// joints in the scene [m], by their child bodies. `forward` and `up` are the directions of the
    /// model's x and y in the scene.
    ///
    /// # Errors
    /// No bone, or fewer than two bodies: nothing would move.
    pub fn new(
        model: Model,
        bones: Vec<Option<usize>>,
        places: &BTreeMap<usize, Point3<f64>>,
        rest: Vec<f64>,
        [forward, up]: [Vector3<f64>; 2],
    ) -> Result<Self, ModelError> {
        let bodies: Vec<usize> = bones.iter().flatten().copied().collect();
        let root = model.common(&bodies);
        let poses = model.poses(&rest);
        let axes = [forward, up, forward.cross(&up)];
        let turned = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&axes));
        let turned = UnitQuaternion::from_rotation_matrix(&turned);
        let place = |joint: &ModelJoint| poses[joint.child] * joint.frames[1] * Point3::origin();
        let moves = |joint: &&ModelJoint| {
            let carries = bodies.iter().any(|b| model.hangs_on(*b, joint.child));
            carries && joint.child != root && model.hangs_on(joint.child, root)
        };
        let moving: Vec<&ModelJoint> = model.joints.iter().filter(moves).collect();
        // The first joint with a known place puts the model there.
        let known = moving.iter().find_map(|joint| {
            let at = places.get(&joint.child)?;
            Some(at - turned * place(joint).coords)
        });
        let shift = known.map_or(Vector3::zeros(), |at: Point3<f64>| at.coords);
        let mut links: Vec<Link> = Vec::new();
        for joint in moving {
            let here = turned * place(joint) + shift;
            let at = places.get(&joint.child);
            let moved = at.map_or(Vector3::zeros(), |at| at - here);
            let from = Isometry3::from_parts(Translation3::from(shift + moved), turned);
            links.push(Link {
                joint: model.joint_of[joint.child].unwrap_or(0),
                parent: links
                    .iter()
                    .position(|l| model.joints[l.joint].child == joint.parent),
                into: from.inverse(),
                around: [poses[joint.parent], poses[joint.child].inverse()],
                across: joint.across(&rest),
            });
        }
        if links.is_empty() {
            let message = "the bones have no joint between them in the model; name bones of at least two bodies";
            return Err(ModelError::whole("", NO_FIT, message));
        }
        let notes = model.notes.clone();
        Ok(Self {
            bones,
            model,
            rest,
            notes,
            links,
        })
    }

    /// A model that moves the bones of a scene about joints of the scene. Each coordinate has a joint
    /// there, and the bones that turn about it. The axis of the first coordinate and the direction
    /// `up` give the model's orientation in the scene. Of each other joint only the place counts; its
    /// axis must agree with that of its first coordinate.
    ///
    /// # Errors
    /// No coordinate, one whose axis is upright, one that turns nothing, or a joint of the scene about
    /// another axis than the model's.
    pub fn about_joints(
        model: Model,
        joints: &[(usize, Joint, Vec<bool>)],
        up: Vector3<f64>,
    ) -> Result<Self, ModelError> {
        let rest = model.defaults();
        let fail = |message: String| Err(ModelError::whole("", NO_FIT, message));
        let mut axes = Vec::new();
        for (coordinate, ..) in joints {
            let Some((joint, axis)) = model.axis(*coordinate, &rest) else {
                let name = &model.coordinates[*coordinate].name;
                return fail(format!("the coordinate `{name}` turns no body"));
            };
            axes.push((joint, axis));
        }
        let (Some((_, (_, first), turning)), Some((_, own))) = (joints.first(), axes.first())
        else {
            return fail("no coordinate".to_owned());
        };
        // The model's axis with its upward direction, and those of the scene.
        let frames = [(*own, Vector3::y()), (*first, up)].map(|(axis, up)| {
            let across = (up - axis * axis.dot(&up)).try_normalize(LEAST_ACROSS)?;
            Some(nalgebra::Matrix3::from_columns(&[
                axis,
                across,
                axis.cross(&across),
            ]))
        });
        let [Some(model_frame), Some(scene_frame)] = frames else {
            return fail("the axis of the first coordinate is upright, so that it does not tell where the subject looks".to_owned());
        };
        let turned = scene_frame * model_frame.transpose();
        let parents: Vec<usize> = axes
            .iter()
            .map(|(joint, _)| model.joints[*joint].parent)
            .collect();
        let mut bones = vec![Some(model.common(&parents)); turning.len()];
        let mut places = BTreeMap::new();
        // A joint stands after the one that carries it.
        for k in 0..model.joints.len() {
            let of = axes.iter().position(|(joint, _)| *joint == k);
            let Some((at, (_, (centre, axis), turning))) = of.map(|at| (at, &joints[at])) else {
                continue;
            };
            let off = (turned * axes[at].1).angle(axis);
            if !(off <= OTHER_AXIS) {
                return fail(format!(
                    "the joint of the scene for `{}` turns about an axis that is {:.0} degrees from the model's; add a section [opensim] \
                     to the scene, or give the joint the model's axis",
                    model.coordinates[joints[at].0].name,
                    off.to_degrees()
                ));
            }
            let child = model.joints[k].child;
            places.insert(child, *centre);
            let all = bones.iter_mut().zip(turning).filter(|(_, turns)| **turns);
            all.for_each(|(bone, _)| *bone = Some(child));
        }
        let axes = [turned * Vector3::x(), turned * Vector3::y()];
        let first = &model.coordinates[joints[0].0].name;
        let note = format!(
            "the axis of the first joint of the scene is taken for that of the model's `{first}`"
        );
        let mut drive = Self::new(model, bones, &places, rest, axes)?;
        drive.notes.push(note);
        Ok(drive)
    }

    /// True if the joint of a body moves a bone against another.
    pub fn uses(&self, body: usize) -> bool {
        let own = |link: &Link| self.model.joints[link.joint].child == body;
        self.links.iter().any(own)
    }

    /// Number of joints that move bones.
    pub fn joints(&self) -> usize {
        self.links.len()
    }

    /// Name of a joint.
    pub fn joint_name(&self, joint: usize) -> &str {
        &self.model.joints[self.links[joint].joint].name
    }

    /// Place of a joint in the scene where the meshes are [m].
    pub fn place(&self, joint: usize) -> Point3<f64> {
        let Link {
            joint: k,
            into,
            around,
            ..
        } = &self.links[joint];
        let frame = self.model.joints[*k].frames[1];
        into.inverse() * around[1].inverse() * frame * Point3::origin()
    }

    /// The direction in the scene that is between forward and up: parts of muscles are numbered from
    /// the front and the top.
    pub fn front_and_top(&self) -> Vector3<f64> {
        self.links[0].into.rotation.inverse() * Vector3::new(1.0, 1.0, 0.0)
    }

    /// The end of a muscle's path that the first joint does not move, in the scene where the meshes
    /// are [m].
    pub fn origin(&self, muscle: &ModelMuscle) -> Option<Point3<f64>> {
        let poses = self.model.poses(&self.rest);
        let first = &self.links[0];
        let child = self.model.joints[first.joint].child;
        let ends = [muscle.points.first()?, muscle.points.last()?];
        let (body, at) = ends
            .into_iter()
            .find(|(body, _)| !self.model.hangs_on(*body, child))?;
        Some(first.into.inverse() * poses[*body] * at)
    }

    /// Which bones of the scene a joint moves.
    pub fn moves(&self, joint: usize) -> Vec<bool> {
        let child = self.model.joints[self.links[joint].joint].child;
        let moves = |body: &Option<usize>| body.is_some_and(|b| self.model.hangs_on(b, child));
        self.bones.iter().map(moves).collect()
    }

    /// Displacement of each joint in the scene [m] at values of all coordinates: that of the bodies
    /// behind it, all other joints being at rest.
    pub fn displacements(&self, values: &[f64]) -> Vec<Isometry3<f64>> {
        let of = |link: &Link| {
            let across = self.model.joints[link.joint].across(values);
            if across == link.across {
                return Isometry3::identity();
            }
            let moved = link.around[0] * across * link.around[1];
            unit(link.into.inverse() * moved * link.into)
        };
        self.links.iter().map(of).collect()
    }

    /// The pose of each bone relative to the pose of its mesh [m] at values of all coordinates.
    pub fn poses(&self, values: &[f64]) -> Vec<Isometry3<f64>> {
        let mut whole = self.displacements(values);
        for k in 0..whole.len() {
            if let Some(parent) = self.links[k].parent {
                whole[k] = unit(whole[parent] * whole[k]);
            }
        }
        let pose = |body: &Option<usize>| {
            let link = self
                .links
                .iter()
                .rposition(|l| Some(self.model.joints[l.joint].child) == *body);
            link.map_or(Isometry3::identity(), |k| whole[k])
        };
        self.bones.iter().map(pose).collect()
    }

    /// The coordinates of the joints that move bones, without coupled ones.
    pub fn coordinates(&self) -> Vec<usize> {
        let own = self
            .links
            .iter()
            .flat_map(|l| &self.model.joints[l.joint].coordinates);
        own.copied()
            .filter(|c| !self.model.is_coupled(*c))
            .collect()
    }
}

/// The same pose with a rotation of length 1: products of many lose it.
fn unit(pose: Isometry3<f64>) -> Isometry3<f64> {
    let rotation = UnitQuaternion::new_normalize(pose.rotation.into_inner());
    Isometry3::from_parts(pose.translation, rotation)
}

impl Encode for ModelDrive {
    fn encode(&self, to: &mut Encoder<'_>) {
        let Self {
            model,
            bones,
            rest,
            notes: _,
            links,
        } = self;
        to.field("model", format!("{:032x}", model.hash).as_str());
        to.field("bones", bones);
        to.field("rest", rest);
        let into: Vec<Isometry3<f64>> = links.iter().map(|l| l.into).collect();
        to.field("into", &into);
    }
}

impl Model {
    /// The joint of a coordinate, and the axis about which it turns the child body in the ground.
    fn axis(&self, coordinate: usize, rest: &[f64]) -> Option<(usize, Vector3<f64>)> {
        let joint = self
            .joints
            .iter()
            .position(|j| j.coordinates.contains(&coordinate))?;
        let child = self.joints[joint].child;
        let mut moved = rest.to_vec();
        moved[coordinate] += SMALL_TURN;
        let [before, after] = [rest, &moved].map(|values| self.poses(values)[child].rotation);
        Some((joint, (after * before.inverse()).axis()?.into_inner()))
    }

    /// True if a body is `other`, or is connected to it through joints towards the ground.
    fn hangs_on(&self, body: usize, other: usize) -> bool {
        self.to_ground(body).contains(&other)
    }

    /// A body and all bodies between it and the ground, which is the last.
    fn to_ground(&self, body: usize) -> Vec<usize> {
        let up = |b: &usize| Some(self.joints[self.joint_of[*b]?].parent);
        std::iter::successors(Some(body), up).collect()
    }

    /// The nearest body that carries all of some bodies.
    fn common(&self, bodies: &[usize]) -> usize {
        let Some((first, rest)) = bodies.split_first() else {
            return 0;
        };
        let carries = |b: &usize| rest.iter().all(|other| self.hangs_on(*other, *b));
        self.to_ground(*first)
            .into_iter()
            .find(carries)
            .unwrap_or(0)
    }
}
