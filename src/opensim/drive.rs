//! The bones of a scene as bodies of a model.

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::document::{MALFORMED, ModelError};
use super::model::{Model, ModelMuscle};
use crate::encode::{Encode, Encoder};

/// Turn that shows the axis of a coordinate \[rad\].
const SMALL_TURN: f64 = 0.1;
/// Least sine of the angle between an axis and the upward direction.
const LEAST_ACROSS: f64 = 0.1;

/// A bone of a scene: the index of its body, and the place of the joint between this body and its
/// parent in the scene [m], if it is known.
pub(crate) type DrivenBone = (usize, Option<Point3<f64>>);

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
    /// A model with the bones that it moves. `forward` and `up` are the directions of the model's
    /// x and y in the scene.
    ///
    /// # Errors
    /// No bone, or fewer than two bodies: nothing would move.
    pub fn new(
        model: Model,
        bones: &[Option<DrivenBone>],
        rest: Vec<f64>,
        [forward, up]: [Vector3<f64>; 2],
    ) -> Result<Self, ModelError> {
        let bodies: Vec<usize> = bones.iter().flatten().map(|(body, _)| *body).collect();
        let root = model.common(&bodies);
        let poses = model.poses(&rest);
        let axes = [forward, up, forward.cross(&up)];
        let turned = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&axes));
        let turned = UnitQuaternion::from_rotation_matrix(&turned);
        let joint_of = |body: usize| model.joints.iter().position(|j| j.child == body);
        let place = |joint: usize| {
            let joint = &model.joints[joint];
            poses[joint.child] * joint.frames[1] * Point3::origin()
        };
        // The first joint with a known place puts the model there.
        let known = bones.iter().flatten().find_map(|&(body, at)| {
            let joint = joint_of(body).filter(|_| body != root)?;
            at.map(|at| at - turned * place(joint).coords)
        });
        let shift = known.map_or(Vector3::zeros(), |at: Point3<f64>| at.coords);
        let mut links: Vec<Link> = Vec::new();
        for (k, joint) in model.joints.iter().enumerate() {
            let carries = bodies.iter().any(|b| model.hangs_on(*b, joint.child));
            if !carries || joint.child == root || !model.hangs_on(joint.child, root) {
                continue;
            }
            let at = bones
                .iter()
                .flatten()
                .find(|(body, _)| *body == joint.child);
            let here = turned * place(k) + shift;
            let moved = at
                .and_then(|(_, at)| *at)
                .map_or(Vector3::zeros(), |at| at - here);
            let from = Isometry3::from_parts(Translation3::from(shift + moved), turned);
            links.push(Link {
                joint: k,
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
            return Err(ModelError::whole("", MALFORMED, message));
        }
        Ok(Self {
            bones: bones.iter().map(|b| b.map(|(body, _)| body)).collect(),
            model,
            rest,
            links,
        })
    }

    /// A model that moves the bones of a scene about joints of the scene. Each coordinate has the
    /// place and the axis of its joint there, and the bones that turn about it. The axis of the first
    /// coordinate and the direction `up` give the model's orientation in the scene.
    ///
    /// # Errors
    /// No coordinate, or one whose axis is upright.
    pub fn about_joints(
        model: Model,
        joints: &[(usize, (Point3<f64>, Vector3<f64>), Vec<bool>)],
        up: Vector3<f64>,
    ) -> Result<Self, ModelError> {
        let rest = model.defaults();
        let fail = |message: &str| Err(ModelError::whole("", MALFORMED, message));
        let of = |coordinate: usize| {
            model
                .joints
                .iter()
                .find(|j| j.coordinates.contains(&coordinate))
        };
        let Some((first, (_, axis), turning)) = joints.first() else {
            return fail("no coordinate");
        };
        let Some(root) = of(*first).map(|joint| joint.parent) else {
            return fail("no joint has the coordinate");
        };
        let mut moved = rest.clone();
        moved[*first] += SMALL_TURN;
        let child = of(*first).map_or(0, |joint| joint.child);
        let [before, after] = [&rest, &moved].map(|values| model.poses(values)[child]);
        let Some(own) = (after.rotation * before.rotation.inverse()).axis() else {
            return fail("the coordinate turns nothing");
        };
        // The model's axis with its upward direction, and those of the scene.
        let frames = [(own.into_inner(), Vector3::y()), (*axis, up)].map(|(axis, up)| {
            let across = up - axis * axis.dot(&up);
            let across = across.try_normalize(LEAST_ACROSS)?;
            Some(nalgebra::Matrix3::from_columns(&[
                axis,
                across,
                axis.cross(&across),
            ]))
        });
        let [Some(model_frame), Some(scene_frame)] = frames else {
            return fail(
                "the axis of the first coordinate is upright, so that it does not tell where the subject looks",
            );
        };
        let turned = scene_frame * model_frame.transpose();
        let mut bones = vec![Some((root, None)); turning.len()];
        // A joint stands after the one that carries it.
        for joint in &model.joints {
            for (coordinate, (centre, _), turning) in joints {
                if joint.coordinates.contains(coordinate) {
                    let all = bones.iter_mut().zip(turning).filter(|(_, turns)| **turns);
                    all.for_each(|(bone, _)| *bone = Some((joint.child, Some(*centre))));
                }
            }
        }
        let axes = [turned * Vector3::x(), turned * Vector3::y()];
        Self::new(model, &bones, rest, axes)
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
    /// True if a body is `other`, or is connected to it through joints towards the ground.
    fn hangs_on(&self, body: usize, other: usize) -> bool {
        self.to_ground(body).contains(&other)
    }

    /// A body and all bodies between it and the ground, which is the last.
    fn to_ground(&self, body: usize) -> Vec<usize> {
        let up = |b: &usize| self.joints.iter().find(|j| j.child == *b).map(|j| j.parent);
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
