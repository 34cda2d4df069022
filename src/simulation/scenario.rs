//! A scene that runs frame by frame: one trait for scenes of every kind.

mod geometric;
mod lattice;
mod muscles;
pub(super) mod skin;
mod spring_bodies;
mod springs;
pub use geometric::GeometricRun;

use std::collections::HashSet;

use nalgebra::{Isometry3, Point3, Vector3};

use super::lattice::LatticeRun;
use super::skin::SkinRun;
use super::spring_bodies::SpringBodiesRun;
use super::springs::SpringsRun;
use super::{LeftOut, LoadError, Plan, Planned, Simulation};
use crate::constraints::distance::Distance;
use crate::fibres::binding::BoundLines;
use crate::io::names::file_name;
use crate::mesh::{Topology, TriangleMesh};
use crate::progress::{Progress, Silent};
use crate::scene::Content;
use crate::state::DecodeError;

/// How a frame ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stepped {
    /// The frame is computed.
    Done,
    /// The progress stopped the computation of the frame. The scenario is in the state before it.
    Interrupted,
    /// The frame cannot be computed, for this reason.
    Failed(String),
}

/// The constant data of a run: the bodies and bones whose positions a [`FrameState`] contains.
#[derive(Clone, Debug)]
pub struct SceneDescription {
    /// Deformable bodies, in the scene's order.
    pub bodies: Vec<BodyDescription>,
    /// File names of rigid bodies (bones, obstacles, a ball), and their meshes in their own frames
    /// [m].
    pub bones: Vec<(String, TriangleMesh)>,
    /// The direction that is up in pictures, of length 1.
    pub up: Vector3<f64>,
}

/// A deformable body of a [`SceneDescription`].
#[derive(Clone, Debug)]
pub struct BodyDescription {
    /// Name of its files. Each body and bone has a different name.
    pub file: String,
    /// Name of the files of its fibres.
    pub fibre_file: String,
    /// Name in the scene.
    pub name: String,
    /// Surface at rest [m].
    pub rest: TriangleMesh,
    /// Edges with rest lengths.
    pub edges: Vec<Distance>,
    /// Edges that belong to no triangle, as lines.
    pub lines: Vec<Vec<u32>>,
    /// Fibres bound to it.
    pub fibres: BoundLines,
    /// 1 for a vertex that is attached to a bone, else 0.
    pub attached: Vec<f64>,
}

impl BodyDescription {
    /// A surface whose edges have their rest lengths; `attached` may be empty.
    fn of_surface(
        name: &str,
        rest: TriangleMesh,
        attached: Vec<f64>,
        used: &mut HashSet<String>,
    ) -> Self {
        let topology = Topology::new(&rest);
        let lengths = topology.edge_lengths(&rest);
        let mut edges = Vec::new();
        for (&points, rest) in topology.edges.iter().zip(lengths) {
            if rest > 0.0 {
                edges.push(Distance { points, rest });
            }
        }
        let attached = if attached.is_empty() {
            vec![0.0; rest.vertices.len()]
        } else {
            attached
        };
        Self {
            file: unused(name, used),
            fibre_file: unused(&format!("{name}_fibres"), used),
            name: name.to_owned(),
            rest,
            edges,
            lines: Vec::new(),
            fibres: BoundLines::default(),
            attached,
        }
    }
}

/// Positions [m] and velocities [m/s] of a body's vertices.
pub type BodyState = (Vec<Point3<f64>>, Vec<Vector3<f64>>);

/// Positions and poses in one frame.
#[derive(Clone, Debug)]
pub struct FrameState {
    /// Frame.
    pub frame: usize,
    /// Time since the start [s].
    pub time: f64,
    /// Positions [m] and velocities [m/s] of each body.
    pub bodies: Vec<BodyState>,
    /// Pose of each bone.
    pub bones: Vec<Isometry3<f64>>,
}

/// Positions of a body with zero velocities.
fn at_rest(x: Vec<Point3<f64>>) -> BodyState {
    let count = x.len();
    (x, vec![Vector3::zeros(); count])
}

/// A scenario by its kind, for readers of data that only one kind has.
#[derive(Clone, Copy)]
pub enum ScenarioKind<'a> {
    /// Muscles that slide around bones.
    Muscles(&'a Simulation),
    /// Skin over implants or over a ball.
    Skin(&'a SkinRun),
    /// A box of points on springs.
    Lattice(&'a LatticeRun),
    /// A spring system on its way to rest.
    Springs(&'a SpringsRun),
    /// A chain of frusta with constant volume.
    Geometric(&'a GeometricRun),
    /// Bodies of springs that collide.
    SpringBodies(&'a SpringBodiesRun),
    /// A kind outside of the library.
    Other,
}

impl ScenarioKind<'_> {
    /// Name of the kind, as [`Content::kind`] has it; `springs` for a spring system on its way to rest,
    /// `other` for a kind outside of the library.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Muscles(_) => "muscles",
            Self::Skin(_) => "skin",
            Self::Lattice(_) => "lattice",
            Self::Springs(_) => "springs",
            Self::Geometric(_) => "geometric",
            Self::SpringBodies(_) => "spring_bodies",
            Self::Other => "other",
        }
    }
}

/// The reason why a scenario rejected an operation.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScenarioError {
    /// This kind of scenario does not support the operation.
    #[error("this kind of scene cannot {0}")]
    NotSupported(&'static str),
    /// The bytes are no saved state of this scenario.
    #[error(transparent)]
    DecodeError(#[from] DecodeError),
}

/// A scene that runs frame by frame.
///
/// A finished run that the viewer replays is no scenario: its frames are read from files in any
/// order, it has no plan and nothing to compute, and a frame can be missing.
pub trait Scenario: Send {
    /// The scenario by its kind.
    fn kind(&self) -> ScenarioKind<'_> {
        ScenarioKind::Other
    }

    /// Name of the scene.
    fn name(&self) -> &str;

    /// Number of the scene's last frame.
    fn frames(&self) -> usize;

    /// The last frame that was computed; 0 is the start.
    fn frame(&self) -> usize;

    /// Frames per second [1/s]. Equilibria have no time; pictures show them at this rate.
    fn frame_rate(&self) -> f64;

    /// The effects that run, and their costs.
    fn plan(&self) -> &Plan;

    /// The bodies and bones.
    fn description(&self) -> SceneDescription;

    /// Poses of the bones at a frame.
    fn poses(&self, frame: usize) -> Vec<Isometry3<f64>>;

    /// Positions and velocities of the bodies in the last frame.
    fn bodies(&self) -> Vec<BodyState>;

    /// Positions and poses in the last frame.
    fn state(&self) -> FrameState {
        FrameState {
            bodies: self.bodies(),
            ..self.state_of_bones(self.frame())
        }
    }

    /// Poses at any frame, without bodies.
    fn state_of_bones(&self, frame: usize) -> FrameState {
        FrameState {
            frame,
            time: frame as f64 / self.frame_rate(),
            bodies: Vec::new(),
            bones: self.poses(frame),
        }
    }

    /// Computes the next frame.
    fn step(&mut self, progress: &dyn Progress) -> Stepped;

    /// Whether no frame follows, because the last frame is computed or all motion has ended.
    fn is_finished(&self) -> bool {
        self.frame() >= self.frames()
    }

    /// Whether every frame that must be at rest is at rest.
    fn converged(&self) -> bool;

    /// Measures up to the last frame, with the names that studies and summaries use.
    fn measures(&self) -> Vec<(&'static str, f64)>;

    /// Measures that have an upper limit, and the limit.
    fn limits(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }

    /// A measure of the last frame. Its greatest value marks the worst frame.
    fn severity(&self) -> f64;

    /// The name of [`Scenario::severity`].
    fn severity_name(&self) -> &'static str;

    /// The state that later frames depend on, as bytes.
    ///
    /// # Errors
    /// This kind of scenario cannot be saved.
    fn save_state(&self) -> Result<Vec<u8>, ScenarioError> {
        Err(ScenarioError::NotSupported("save its state"))
    }

    /// Restores the state that [`Scenario::save_state`] saved for the same scene.
    ///
    /// # Errors
    /// This kind of scenario cannot be restored, or the bytes are damaged. After an error the
    /// scenario is unusable.
    fn restore_state(&mut self, _bytes: &[u8]) -> Result<(), ScenarioError> {
        Err(ScenarioError::NotSupported("restore a saved state"))
    }

    /// Continues from the state of `other`, a scenario of the same scene with other numbers.
    ///
    /// # Errors
    /// This kind of scenario cannot continue with other numbers, or `other` is of another kind.
    fn continue_from(&mut self, _other: &dyn Scenario) -> Result<(), ScenarioError> {
        Err(ScenarioError::NotSupported("continue with other numbers"))
    }
}

/// Makes a scene of any kind ready to run.
///
/// # Errors
/// A mesh that cannot be read or used, or values that are valid for no scenario.
///
/// ```
/// use pliant::{progress::Silent, scene::builtin, simulation};
/// let content = builtin::load_content("distance", &[]).unwrap();
/// let mut scenario = simulation::scenario(&content).unwrap();
/// assert_eq!(scenario.step(&Silent), simulation::Stepped::Done);
/// assert_eq!(scenario.state().frame, 1);
/// ```
pub fn scenario(content: &Content) -> Result<Box<dyn Scenario>, LoadError> {
    scenario_with(content, &Silent)
}

/// The same; the progress may stop the refinement of skin.
///
/// # Errors
/// As of [`scenario`]; also where the progress stops it.
pub fn scenario_with(
    content: &Content,
    progress: &dyn Progress,
) -> Result<Box<dyn Scenario>, LoadError> {
    Ok(match content {
        Content::Muscles(scene) => Box::new(Simulation::new((**scene).clone())?),
        Content::Skin(scene) => Box::new(SkinRun::new_with((**scene).clone(), progress)?),
        Content::Lattice(scene) if scene.rest.is_some() => Box::new(SpringsRun::of_lattice(scene)?),
        Content::Lattice(scene) => Box::new(LatticeRun::new((**scene).clone())?),
        Content::Geometric(scene) => Box::new(GeometricRun::new((**scene).clone())),
        Content::SpringBodies(scene) => Box::new(SpringBodiesRun::new((**scene).clone())?),
    })
}

/// A file name that differs from all earlier ones, even if case is ignored.
fn unused(name: &str, used: &mut HashSet<String>) -> String {
    let name = file_name(name);
    let mut chosen = name.clone();
    let mut next = 2;
    while !used.insert(chosen.to_lowercase()) {
        chosen = format!("{name}-{next}");
        next += 1;
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin::load_content;

    #[test]
    fn names_of_files_are_safe_and_unlike() {
        let mut used = HashSet::new();
        assert_eq!(unused("gluteus maximus", &mut used), "gluteus_maximus");
        assert_eq!(unused("Gluteus_maximus", &mut used), "Gluteus_maximus-2");
        assert_eq!(unused("a&b#c%", &mut used), "a_b_c_");
    }

    #[test]
    fn what_a_kind_cannot_do_is_a_typed_error() {
        let content = |name: &str| load_content(name, &[]).expect("a scene");
        let mut lattice = scenario(&content("lattice")).expect("a lattice");
        let muscles = scenario(&content("distance")).expect("muscles");
        let refused = |done| matches!(done, Err(ScenarioError::NotSupported(_)));
        assert!(lattice.save_state().is_err());
        assert!(refused(lattice.restore_state(&[])));
        assert!(refused(lattice.continue_from(muscles.as_ref())));
        // Control: supported operations succeed.
        assert!(muscles.save_state().is_ok());
    }

    #[test]
    fn a_saved_state_leads_to_the_same_frame() {
        let content = load_content("distance", &[]).expect("a scene");
        let mut first = scenario(&content).expect("muscles");
        assert_eq!(first.step(&Silent), Stepped::Done);
        let saved = first.save_state().expect("bytes");
        let mut second = scenario(&content).expect("muscles");
        second.restore_state(&saved).expect("a state");
        assert_eq!(first.step(&Silent), second.step(&Silent));
        assert_eq!(first.state().bodies, second.state().bodies);
        assert!(second.restore_state(&saved[1..]).is_err(), "control");
    }
}
