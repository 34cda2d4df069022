//! A model: bodies, joints, coordinates, meshes and muscles.

use std::collections::HashMap;
use std::path::Path;

use nalgebra::{Isometry3, Point3, Translation3, Vector3};

use super::document::{
    Element, MALFORMED, ModelError, Parsed, UNKNOWN_KIND, UNKNOWN_NAME, text_of,
};
use super::functions::Function;
use super::joints::{JointKind, turned_xyz};
use crate::spelling::{nearest, shown};
use crate::state::Hash;

/// Greatest number of frames from an offset frame to its body.
const LONGEST_CHAIN: usize = 16;

/// A model of OpenSim 4.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Name of the model.
    pub name: String,
    /// Bodies; the first is the ground.
    pub bodies: Vec<ModelBody>,
    /// Coordinates of all joints.
    pub coordinates: Vec<Coordinate>,
    /// Muscles, with their straight lines between path points.
    pub muscles: Vec<ModelMuscle>,
    /// What is in the file and does not count here, such as a constraint that closes a loop.
    pub notes: Vec<String>,
    /// Joints, each after the one of its parent.
    pub(super) joints: Vec<ModelJoint>,
    /// The joint of each body; `None` for the ground.
    pub(super) joint_of: Vec<Option<usize>>,
    couplers: Vec<Coupler>,
    /// Hash of the text.
    pub(super) hash: u128,
}

/// A body.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelBody {
    /// Name, unique among bodies.
    pub name: String,
    /// Meshes that display the body.
    pub meshes: Vec<ModelMesh>,
}

/// A mesh that is fixed to a body.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelMesh {
    /// Name of the file as written.
    pub file: String,
    /// Factors of x, y and z that convert its coordinates to metres.
    pub scale: Vector3<f64>,
    /// Pose of the mesh in the frame of the body [m].
    pub pose: Isometry3<f64>,
}

/// A coordinate of a joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Coordinate {
    /// Name, unique among coordinates.
    pub name: String,
    /// Absolute path, such as `/jointset/hip_r/hip_flexion_r`.
    pub path: String,
    /// Default value \[rad or m\].
    pub default: f64,
    /// Least and greatest value \[rad or m\].
    pub range: [f64; 2],
    /// True for an angle, false for a length.
    pub is_angle: bool,
    /// True for an angle that tables in degrees have in degrees. Others, such as one from which a
    /// spline computes a rotation, are in radians in any table.
    pub in_degrees: bool,
}

/// Parameters of a muscle.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelMuscle {
    /// Name, unique among muscles.
    pub name: String,
    /// Absolute path, such as `/forceset/glmax1_r`.
    pub path: String,
    /// Maximum isometric force \[N\].
    pub max_isometric_force: f64,
    /// Optimal fibre length [m].
    pub optimal_fibre_length: f64,
    /// Tendon slack length [m].
    pub tendon_slack_length: f64,
    /// Pennation angle at optimal fibre length \[rad\].
    pub pennation: f64,
    /// Points of the path: index of the body and place in its frame [m].
    pub points: Vec<(usize, Point3<f64>)>,
    /// True if the path is the polyline through these points: without wrapping, conditional or moving
    /// points.
    pub is_polyline: bool,
}

/// A joint.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ModelJoint {
    pub(super) name: String,
    pub(super) parent: usize,
    pub(super) child: usize,
    /// Frame of the joint on the parent, and on the child.
    pub(super) frames: [Isometry3<f64>; 2],
    pub(super) kind: JointKind,
    pub(super) coordinates: Vec<usize>,
}

/// A coordinate that is a function of others.
#[derive(Clone, Debug, PartialEq)]
struct Coupler {
    dependent: usize,
    arguments: Vec<usize>,
    function: Function,
    scale: f64,
}

impl Model {
    /// Reads a model from a file.
    ///
    /// # Errors
    /// A file that cannot be read, is no XML, is older than OpenSim 4.0, or has a joint or a
    /// function of an unknown kind.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        Self::parse(&text_of(path)?, &path.display().to_string())
    }

    /// The same as [`Self::read`] for a text; `file` appears in messages.
    ///
    /// # Errors
    /// See [`Self::read`].
    pub fn parse(text: &str, file: &str) -> Result<Self, ModelError> {
        let parsed = Parsed::new(text, file)?;
        let model = parsed.root().need("Model")?;
        let mut model = Reader::of(model)?.finish()?;
        model.hash = Hash::of(text.as_bytes());
        Ok(model)
    }

    /// Index of a coordinate by its name, or its path with or without `/value`.
    ///
    /// # Errors
    /// A name that no coordinate has.
    pub fn coordinate(&self, name: &str) -> Result<usize, ModelError> {
        let plain = name.strip_suffix("/value").unwrap_or(name);
        let found = |c: &Coordinate| c.name == plain || c.path == plain;
        let known = self.coordinates.iter().map(|c| c.name.as_str());
        self.coordinates
            .iter()
            .position(found)
            .ok_or_else(|| self.unknown("coordinate", name, known))
    }

    /// Index of the child body of a joint.
    pub fn child_of(&self, joint: &str) -> Option<usize> {
        let found = self.joints.iter().find(|j| j.name == joint);
        found.map(|joint| joint.child)
    }

    /// Names of all joints.
    pub fn joint_names(&self) -> impl Iterator<Item = &str> + Clone {
        self.joints.iter().map(|joint| joint.name.as_str())
    }

    /// Index of a body by its name.
    ///
    /// # Errors
    /// A name that no body has.
    pub fn body(&self, name: &str) -> Result<usize, ModelError> {
        let known = self.bodies.iter().map(|b| b.name.as_str());
        known
            .clone()
            .position(|n| n == name)
            .ok_or_else(|| self.unknown("body", name, known))
    }

    fn unknown<'a>(
        &self,
        what: &str,
        name: &str,
        known: impl Iterator<Item = &'a str> + Clone,
    ) -> ModelError {
        let meant = nearest(name, known.clone())
            .map_or_else(String::new, |n| format!(", did you mean `{}`?", shown(n)));
        let message = format!(
            "the model {} has no {what} `{}`{meant} (it has {})",
            shown(&self.name),
            shown(name),
            crate::spelling::listed(known)
        );
        ModelError::whole("", UNKNOWN_NAME, message)
    }

    /// The default values of all coordinates, with couplings.
    pub fn defaults(&self) -> Vec<f64> {
        let mut values: Vec<f64> = self.coordinates.iter().map(|c| c.default).collect();
        self.couple(&mut values);
        values
    }

    /// Sets each coupled coordinate to the value of its function.
    pub fn couple(&self, values: &mut [f64]) {
        for coupler in &self.couplers {
            let arguments: Vec<f64> = coupler.arguments.iter().map(|&k| values[k]).collect();
            values[coupler.dependent] = coupler.scale * coupler.function.at(&arguments);
        }
    }

    /// True for a coordinate that is a function of others.
    pub fn is_coupled(&self, coordinate: usize) -> bool {
        self.couplers.iter().any(|c| c.dependent == coordinate)
    }

    /// The pose of each body in the ground [m] at values of all coordinates \[rad or m\], which are
    /// not coupled here.
    ///
    /// # Panics
    /// Panics if there are not as many values as coordinates.
    pub fn poses(&self, values: &[f64]) -> Vec<Isometry3<f64>> {
        assert_eq!(
            values.len(),
            self.coordinates.len(),
            "a value for each coordinate"
        );
        let mut poses = vec![Isometry3::identity(); self.bodies.len()];
        for joint in &self.joints {
            poses[joint.child] = poses[joint.parent] * joint.across(values);
        }
        poses
    }

    /// Length of a muscle's polyline through its path points [m]: wrapping and moving points do not
    /// count.
    pub fn straight_length(&self, muscle: &ModelMuscle, poses: &[Isometry3<f64>]) -> f64 {
        let points: Vec<Point3<f64>> = muscle.points.iter().map(|(b, p)| poses[*b] * p).collect();
        points
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).norm())
            .sum()
    }
}

impl ModelJoint {
    /// The pose of the child body in the frame of the parent body.
    pub(super) fn across(&self, values: &[f64]) -> Isometry3<f64> {
        let own: Vec<f64> = self.coordinates.iter().map(|&k| values[k]).collect();
        self.frames[0] * self.kind.transform(&own, values) * self.frames[1].inverse()
    }
}

/// A model while it is read.
struct Reader<'p> {
    model: Element<'p>,
    bodies: Vec<ModelBody>,
    coordinates: Vec<Coordinate>,
    by_name: HashMap<&'p str, usize>,
    coordinate_index: HashMap<&'p str, usize>,
    /// Frames by their absolute paths: bodies, and frames that are fixed to another one.
    frames: HashMap<String, FrameOf<'p>>,
    /// The paths of frames that end in a name.
    ends: HashMap<&'p str, Vec<String>>,
    notes: Vec<String>,
}

/// A frame: a body, or an element that is fixed to another frame.
#[derive(Clone, Copy)]
enum FrameOf<'p> {
    Body(usize),
    Offset(Element<'p>),
}

impl<'p> Reader<'p> {
    fn of(model: Element<'p>) -> Result<Self, ModelError> {
        let mut reader = Self {
            model,
            bodies: Vec::new(),
            coordinates: Vec::new(),
            by_name: HashMap::from([("ground", 0)]),
            coordinate_index: HashMap::new(),
            frames: HashMap::from([("/ground".to_owned(), FrameOf::Body(0))]),
            ends: HashMap::from([("ground", vec!["/ground".to_owned()])]),
            notes: Vec::new(),
        };
        let ground = model.child("Ground");
        reader.bodies.push(ModelBody {
            name: "ground".to_owned(),
            meshes: ground.map_or(Ok(Vec::new()), meshes)?,
        });
        for element in model.components() {
            match element.tag() {
                "Body" if !element.name().is_empty() => {
                    let index = reader.bodies.len();
                    if reader.by_name.insert(element.name(), index).is_some() {
                        let message = format!("two bodies have the name{}", element.named());
                        return Err(element.error(MALFORMED, message));
                    }
                    reader.bodies.push(ModelBody {
                        name: element.name().to_owned(),
                        meshes: meshes(element)?,
                    });
                    reader.add(element, FrameOf::Body(index));
                }
                "PhysicalOffsetFrame" => reader.add(element, FrameOf::Offset(element)),
                _ => {}
            }
        }
        Ok(reader)
    }

    fn add(&mut self, element: Element<'p>, frame: FrameOf<'p>) {
        let path = path_of(element);
        self.ends
            .entry(element.name())
            .or_default()
            .push(path.clone());
        self.frames.insert(path, frame);
    }

    fn finish(mut self) -> Result<Model, ModelError> {
        let mut joints = self.joints()?;
        self.sort(&mut joints)?;
        let couplers = self.couplers()?;
        let muscles = self.muscles()?;
        let mut joint_of = vec![None; self.bodies.len()];
        for (k, (_, joint)) in joints.iter().enumerate() {
            joint_of[joint.child] = Some(k);
        }
        Ok(Model {
            notes: self.notes,
            joint_of,
            name: self.model.name().to_owned(),
            bodies: self.bodies,
            coordinates: self.coordinates,
            muscles,
            joints: joints.into_iter().map(|(_, joint)| joint).collect(),
            couplers,
            hash: 0,
        })
    }

    /// Joints with their elements, in the order of the file.
    fn joints(&mut self) -> Result<Vec<(Element<'p>, ModelJoint)>, ModelError> {
        let elements: Vec<Element<'p>> = self
            .model
            .components()
            .filter(|e| e.tag().ends_with("Joint") && !e.name().is_empty())
            .collect();
        // Functions of a joint can name coordinates of another.
        let mut owned = Vec::new();
        for &element in &elements {
            let given = element.child("coordinates");
            let given = given.iter().flat_map(|c| c.children());
            let mut own = Vec::new();
            for coordinate in given.filter(|e| e.tag() == "Coordinate") {
                let index = self.coordinates.len();
                if self
                    .coordinate_index
                    .insert(coordinate.name(), index)
                    .is_some()
                {
                    let message = format!("two coordinates have the name{}", coordinate.named());
                    return Err(coordinate.error(MALFORMED, message));
                }
                let [default] = coordinate.numbers_or("default_value", [0.0])?;
                self.coordinates.push(Coordinate {
                    name: coordinate.name().to_owned(),
                    path: format!("{}/{}", path_of(element), coordinate.name()),
                    default,
                    range: coordinate.numbers_or("range", [f64::NEG_INFINITY, f64::INFINITY])?,
                    is_angle: true,
                    in_degrees: true,
                });
                if coordinate.flag_or("prescribed", false) {
                    let note = format!(
                        "the coordinate {} is prescribed in the model, which is left out",
                        coordinate.name()
                    );
                    self.notes.push(note);
                }
                own.push(index);
            }
            owned.push(own);
        }
        let mut joints = Vec::new();
        for (element, coordinates) in elements.into_iter().zip(owned) {
            let index = |name: &str| self.coordinate_index.get(name).copied();
            let Some(kind) = JointKind::read(element, &index)? else {
                continue;
            };
            if kind.coordinates().is_some_and(|n| n != coordinates.len()) {
                let message = format!(
                    "<{}>{} has {} coordinates instead of {}",
                    element.tag(),
                    element.named(),
                    coordinates.len(),
                    kind.coordinates().unwrap_or(0)
                );
                return Err(element.error(MALFORMED, message));
            }
            for (k, &c) in coordinates.iter().enumerate() {
                let own = &mut self.coordinates[c];
                [own.is_angle, own.in_degrees] = kind.turns(k, c);
            }
            let [parent, child] = ["socket_parent_frame", "socket_child_frame"]
                .map(|tag| element.need(tag).and_then(|e| self.frame(e, element)));
            let ((parent, on_parent), (child, on_child)) = (parent?, child?);
            let joint = ModelJoint {
                name: element.name().to_owned(),
                parent,
                child,
                frames: [on_parent, on_child],
                kind,
                coordinates,
            };
            joints.push((element, joint));
        }
        Ok(joints)
    }

    /// The body of a frame that a socket of `owner` names, and the frame's pose on it.
    fn frame(
        &self,
        socket: Element<'p>,
        owner: Element<'p>,
    ) -> Result<(usize, Isometry3<f64>), ModelError> {
        let mut pose = Isometry3::identity();
        let (mut socket, mut owner) = (socket, owner);
        for _ in 0..LONGEST_CHAIN {
            match self.named(socket, owner)? {
                FrameOf::Body(body) => return Ok((body, pose)),
                FrameOf::Offset(offset) => {
                    pose = offset_pose(offset)? * pose;
                    (socket, owner) = (offset.need("socket_parent")?, offset);
                }
            }
        }
        Err(socket.error(MALFORMED, "frames that are fixed to each other in a circle"))
    }

    /// The frame that a socket names: by an absolute path, by one that is relative to its owner, or by
    /// a last name that only one frame has.
    fn named(&self, socket: Element<'p>, owner: Element<'p>) -> Result<FrameOf<'p>, ModelError> {
        let text = socket.text();
        let path = if text.starts_with('/') {
            text.to_owned()
        } else {
            let own = path_of(owner);
            let mut parts: Vec<&str> = own.split('/').skip(1).collect();
            for part in text.split('/') {
                match part {
                    ".." => drop(parts.pop()),
                    "." | "" => {}
                    part => parts.push(part),
                }
            }
            format!("/{}", parts.join("/"))
        };
        if let Some(frame) = self.frames.get(&path) {
            return Ok(*frame);
        }
        let name = text.rsplit('/').next().unwrap_or_default();
        match self.ends.get(name).map(Vec::as_slice) {
            Some([only]) => Ok(self.frames[only]),
            Some(several) => {
                let message = format!(
                    "`{}` can be each of {}",
                    shown(text),
                    crate::spelling::listed(several.iter().map(String::as_str))
                );
                Err(socket.error(UNKNOWN_NAME, message))
            }
            None => {
                let message = format!("no frame or body `{}`", shown(text));
                Err(socket.error(UNKNOWN_NAME, message))
            }
        }
    }

    /// Brings joints into an order in which each stands after the joint of its parent.
    fn sort(&self, joints: &mut Vec<(Element<'p>, ModelJoint)>) -> Result<(), ModelError> {
        let mut of_child: HashMap<usize, usize> = HashMap::new();
        for (k, (element, joint)) in joints.iter().enumerate() {
            let body = &self.bodies[joint.child].name;
            if joint.child == 0 || of_child.insert(joint.child, k).is_some() {
                let message = format!(
                    "the body {} is the child of several joints, or the ground",
                    shown(body)
                );
                return Err(element.error(UNKNOWN_KIND, message));
            }
        }
        let free = (1..self.bodies.len()).find(|body| !of_child.contains_key(body));
        if let Some(body) = free {
            let message = format!(
                "no joint positions the body {}",
                shown(&self.bodies[body].name)
            );
            return Err(self.model.error(MALFORMED, message));
        }
        let mut depth = vec![usize::MAX; self.bodies.len()];
        depth[0] = 0;
        for (element, joint) in joints.iter() {
            let mut chain = vec![joint.child];
            let mut at = joint.child;
            while depth[at] == usize::MAX {
                let (_, up) = &joints[of_child[&at]];
                at = up.parent;
                if chain.len() > self.bodies.len() {
                    return Err(element.error(MALFORMED, "joints that form a circle"));
                }
                chain.push(at);
            }
            let base = depth[at];
            for (k, body) in chain.iter().rev().enumerate() {
                depth[*body] = base + k;
            }
        }
        joints.sort_by_key(|(_, joint)| depth[joint.child]);
        Ok(())
    }

    /// The couplers, each after those of its arguments.
    fn couplers(&mut self) -> Result<Vec<Coupler>, ModelError> {
        let mut left: Vec<(Element<'p>, Coupler)> = Vec::new();
        let constraints = self
            .model
            .components()
            .filter(|e| e.tag().ends_with("Constraint"));
        let enforced =
            constraints.filter(|e| e.flag_or("isEnforced", true) && !e.name().is_empty());
        for element in enforced.collect::<Vec<_>>() {
            if element.tag() != "CoordinateCouplerConstraint" {
                let tag = element.tag();
                let note = format!(
                    "the constraint <{tag}>{} of the model is left out",
                    element.named()
                );
                self.notes.push(note);
                continue;
            }
            let coupler = self.coupler(element)?;
            if left
                .iter()
                .any(|(_, other)| other.dependent == coupler.dependent)
            {
                let name = element.text_of("dependent_coordinate_name");
                let message = format!("two constraints determine the coordinate `{}`", shown(name));
                return Err(element.error(MALFORMED, message));
            }
            left.push((element, coupler));
        }
        let mut sorted = Vec::new();
        while !left.is_empty() {
            let depends = |c: &Coupler, k: usize| c.arguments.contains(&k);
            let is_free = |c: &Coupler| !left.iter().any(|(_, other)| depends(c, other.dependent));
            let Some(next) = left.iter().position(|(_, c)| is_free(c)) else {
                let message = "constraints that determine coordinates by each other";
                return Err(left[0].0.error(MALFORMED, message));
            };
            sorted.push(left.remove(next).1);
        }
        Ok(sorted)
    }

    fn coupler(&self, element: Element<'p>) -> Result<Coupler, ModelError> {
        let named = |name: &str| {
            self.coordinate_index.get(name).copied().ok_or_else(|| {
                let message = format!("no coordinate `{}`", shown(name));
                element.error(UNKNOWN_NAME, message)
            })
        };
        let names = element.text_of("independent_coordinate_names");
        let arguments = names.split_ascii_whitespace().map(named);
        let arguments = arguments.collect::<Result<Vec<_>, _>>()?;
        let function = Function::read(element.need("coupled_coordinates_function")?)?;
        if function.arguments().is_some_and(|n| n != arguments.len()) {
            let message = format!(
                "a function that does not fit {} coordinates",
                arguments.len()
            );
            return Err(element.error(MALFORMED, message));
        }
        let [scale] = element.numbers_or("scale_factor", [1.0])?;
        Ok(Coupler {
            dependent: named(element.text_of("dependent_coordinate_name"))?,
            arguments,
            function,
            scale,
        })
    }

    fn muscles(&self) -> Result<Vec<ModelMuscle>, ModelError> {
        let mut muscles = Vec::new();
        for element in self.model.components() {
            let has_force = element.child("max_isometric_force").is_some();
            if !has_force
                || element.child("optimal_fiber_length").is_none()
                || element.name().is_empty()
            {
                continue;
            }
            let one = |tag: &str| element.numbers_or(tag, [0.0]).map(|[v]| v);
            let (mut points, mut is_polyline) = (Vec::new(), true);
            let geometry = element.children().find(|e| e.tag() == "GeometryPath");
            let given = geometry.and_then(|g| g.child("PathPointSet")?.child("objects"));
            let wraps = geometry.and_then(|g| g.child("PathWrapSet")?.child("objects"));
            is_polyline &= wraps.is_none_or(|wraps| wraps.children().next().is_none());
            for point in given.iter().flat_map(|o| o.children()) {
                is_polyline &= point.tag() == "PathPoint";
                // A conditional point counts, a moving one has no place here.
                let Some(location) = point.child("location") else {
                    continue;
                };
                let (body, frame) = self.frame(point.need("socket_parent_frame")?, point)?;
                points.push((
                    body,
                    frame * Point3::from(Vector3::from(location.exactly::<3>()?)),
                ));
            }
            muscles.push(ModelMuscle {
                name: element.name().to_owned(),
                path: path_of(element),
                max_isometric_force: one("max_isometric_force")?,
                optimal_fibre_length: one("optimal_fiber_length")?,
                tendon_slack_length: one("tendon_slack_length")?,
                pennation: one("pennation_angle_at_optimal")?,
                points,
                is_polyline,
            });
        }
        Ok(muscles)
    }
}

/// The absolute path of a component: names of the sets above it and its own.
pub(super) fn path_of(element: Element<'_>) -> String {
    let mut names = vec![element.name()];
    let mut at = element.parent();
    while let Some(up) = at {
        if up.tag() == "Model" {
            break;
        }
        if !up.name().is_empty() {
            names.push(up.name());
        }
        at = up.parent();
    }
    names
        .iter()
        .rev()
        .fold(String::new(), |path, name| format!("{path}/{name}"))
}

/// The pose of an offset frame on the frame that it is fixed to.
fn offset_pose(element: Element<'_>) -> Result<Isometry3<f64>, ModelError> {
    let translation = Vector3::from(element.numbers_or("translation", [0.0; 3])?);
    let rotation = turned_xyz(element.numbers_or("orientation", [0.0; 3])?);
    Ok(Isometry3::from_parts(
        Translation3::from(translation),
        rotation,
    ))
}

/// The meshes of a body, also those on frames that belong to it.
fn meshes(body: Element<'_>) -> Result<Vec<ModelMesh>, ModelError> {
    let mut meshes = Vec::new();
    for mesh in body.descendants().filter(|e| e.tag() == "Mesh") {
        let frames = std::iter::successors(mesh.parent(), |e| e.parent());
        let frames = frames.take_while(|e| e.range() != body.range());
        let mut pose = Isometry3::identity();
        for frame in frames.filter(|e| e.tag() == "PhysicalOffsetFrame") {
            pose = offset_pose(frame)? * pose;
        }
        let file = mesh.text_of("mesh_file");
        if !file.is_empty() {
            meshes.push(ModelMesh {
                file: file.to_owned(),
                scale: Vector3::from(mesh.numbers_or("scale_factors", [1.0; 3])?),
                pose,
            });
        }
    }
    Ok(meshes)
}
