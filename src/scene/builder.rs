//! Scenes from meshes in memory.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use super::motion::turn_and_move;
use super::{Joint, Scene, SceneError, Surroundings, parse_with};
use crate::mesh::TriangleMesh;

/// Builds a scene from meshes in memory, without a file.
///
/// It writes the text of a scene, which [`parse`](super::parse()) reads: the same keys, checks and
/// errors hold. A bone or a muscle begins a section; what follows belongs to it. Meshes are in
/// metres.
///
/// ```
/// use nalgebra::{Point3, Vector3};
/// use pliant::mesh::shapes::icosphere;
/// use pliant::scene::Joint;
/// use pliant::{Scene, Simulation};
///
/// let mut bone = icosphere(0.02, 2);
/// bone.vertices.iter_mut().for_each(|v| v.x += 0.0695);
/// let joint = Joint { name: None, centre: Point3::new(0.0, 0.3, 0.0), axis: Vector3::z_axis(),
///     path: Vec::new() };
/// let scene = Scene::builder("ball", 10, 60.0)
///     .bone("bone", bone)
///     .turn(&joint, &[(0.0, 0.0), (10.0, -0.02)])
///     .muscle("ball", icosphere(0.05, 2))
///     .attach("bone", 0.002)
///     .set("effects.stretch", "on")
///     .set("effects.volume", "on")
///     .set("muscle.ball.material.stretch", "500 N/m")
///     .build()
///     .unwrap();
/// let mut simulation = Simulation::new(scene).unwrap();
/// simulation.step_frame();
/// assert!(simulation.measure().iter().all(|body| body.converged));
/// ```
#[derive(Clone, Debug)]
pub struct SceneBuilder {
    name: String,
    text: String,
    meshes: BTreeMap<String, Arc<TriangleMesh>>,
    changes: Vec<String>,
}

/// A text in TOML.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

impl Scene {
    /// A scene without bodies: its name, its number of frames after the start, and the frames a
    /// second [1/s].
    #[must_use]
    pub fn builder(name: &str, frames: usize, frame_rate: f64) -> SceneBuilder {
        let name_in_text = quoted(name);
        SceneBuilder {
            name: name.to_owned(),
            text: format!(
                "name = {name_in_text}\nframes = {frames}\nframe_rate = \"{frame_rate} Hz\"\n"
            ),
            meshes: BTreeMap::new(),
            changes: Vec::new(),
        }
    }
}

impl SceneBuilder {
    /// Adds a bone at rest; vertices in metres.
    #[must_use]
    pub fn bone(self, name: &str, mesh: impl Into<Arc<TriangleMesh>>) -> Self {
        self.body("bone", name, mesh.into())
    }

    /// Turns the last bone about a joint. A key is a frame and the angle at it \[rad\].
    #[must_use]
    pub fn turn(mut self, joint: &Joint, keys: &[(f64, f64)]) -> Self {
        self.text.push_str("[bone.motion]\n");
        if let Some(name) = &joint.name {
            let _ = writeln!(self.text, "joint = {}", quoted(name));
        }
        let centre = joint.centre.coords.map(|c| format!("\"{c:?} m\""));
        let _ = writeln!(self.text, "centre = [{}]", listed(centre.iter()));
        let axis = joint.axis.map(|c| format!("{c:?}"));
        let _ = writeln!(self.text, "axis = [{}]", listed(axis.iter()));
        let key = |&(frame, angle): &(f64, f64)| {
            format!("{{ frame = {frame:?}, angle = \"{angle:?} rad\" }}")
        };
        let _ = writeln!(self.text, "keys = [{}]", listed(keys.iter().map(key)));
        let path = joint.path.iter().map(|key| {
            let (turn, moved) = turn_and_move(&key.pose, &joint.centre.coords);
            let angle = turn.norm();
            let axis = if angle > 0.0 { turn } else { joint.axis.into_inner() };
            let axis = axis.map(|c| format!("{c:?}"));
            let moved = moved.map(|c| format!("\"{c:?} m\""));
            format!(
                "{{ at = \"{:?} rad\", angle = \"{angle:?} rad\", axis = [{}], translation = [{}] }}",
                key.frame,
                listed(axis.iter()),
                listed(moved.iter())
            )
        });
        if !joint.path.is_empty() {
            let _ = writeln!(self.text, "path = [{}]", listed(path));
        }
        self
    }

    /// Adds a muscle; vertices in metres.
    #[must_use]
    pub fn muscle(self, name: &str, mesh: impl Into<Arc<TriangleMesh>>) -> Self {
        self.body("muscle", name, mesh.into())
    }

    /// Attaches the last muscle to a bone: all vertices within a distance \[m\] of it.
    #[must_use]
    pub fn attach(mut self, bone: &str, within: f64) -> Self {
        let _ = writeln!(
            self.text,
            "[[muscle.attachment]]\nbone = {}\nnear = \"{within:?} m\"",
            quoted(bone)
        );
        self
    }

    /// Sets any key, as `--set path=value` of the command does; see
    /// [`overrides`](super::overrides). The last value of a key holds.
    #[must_use]
    pub fn set(mut self, path: &str, value: &str) -> Self {
        self.changes.push(format!("{path}={value}"));
        self
    }

    fn body(mut self, kind: &str, name: &str, mesh: Arc<TriangleMesh>) -> Self {
        let file = format!("{name}.obj");
        let _ = writeln!(
            self.text,
            "\n[[{kind}]]\nname = {}\nmesh = {}\nunit = \"m\"",
            quoted(name),
            quoted(&file)
        );
        self.meshes.insert(file, mesh);
        self
    }

    /// Reads and checks the scene.
    ///
    /// # Errors
    /// Those of [`parse`](super::parse()), and a mesh with an index out of range or a coordinate
    /// that is not finite.
    pub fn build(&self) -> Result<Scene, SceneError> {
        let around = Surroundings {
            overrides: &self.changes,
            meshes: &self.meshes,
            ..Surroundings::of(Path::new("."))
        };
        parse_with(&self.text, &format!("{}.toml", self.name), &around)
    }
}

fn listed<T: AsRef<str>>(texts: impl Iterator<Item = T>) -> String {
    let texts: Vec<T> = texts.collect();
    let texts: Vec<&str> = texts.iter().map(AsRef::as_ref).collect();
    texts.join(", ")
}
