//! The kinds of scenes: muscles and bones, skin over implants, a lattice of points with springs, a
//! geometric muscle, or bodies of springs.

mod geometric;
mod spring_bodies;
pub use geometric::GeometricScene;
pub use spring_bodies::{SpringBodiesScene, SpringBodySpec};

use nalgebra::{Point3, Vector3};

use super::error::SceneError;
use super::limits::LIMITS;
use super::reader::Section;
use super::schema::Kind::{self, List, Plain, Table, Text};
use super::schema::{self, Schema};
use super::{
    Accuracy, Scene, SceneOrigin, Source, Uncertain, Variables, parse, parse_lattice, parse_skin,
};
use crate::encode::{Encode, Encoder};
use crate::mesh::repair;
use crate::skin::ImplantSpec;
use crate::skin::settle::SettleMethod;
use crate::springs::Neighbours;
use crate::springs::integrators::INTEGRATORS;
use crate::springs::lattice::{DEVICES, GPU_METHODS, Stiffness};

/// A checked scene of any kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Muscles around moving bones: a scene with `[[muscle]]`.
    Muscles(Box<Scene>),
    /// Skin over implants or over a ball, in equilibrium in every frame: a scene with `[[skin]]`.
    Skin(Box<SkinScene>),
    /// A box of points with springs, displaced and released or running to rest: a scene with
    /// `[lattice]`.
    Lattice(Box<LatticeScene>),
    /// A chain of frusta with constant volume: a scene with `radii`.
    Geometric(Box<GeometricScene>),
    /// Bodies of springs that collide with each other and with rigid ones: a scene with `[[spring_body]]`.
    SpringBodies(Box<SpringBodiesScene>),
}

/// A measure of a run: its name in the scenario and in a summary, its header in tables, and the
/// factor to the unit there.
pub type Measure = (&'static str, &'static str, f64);

/// The fields that a scene of every kind has.
trait Fields: Encode {
    fn name(&self) -> &str;
    fn frames(&self) -> usize;
    fn origin(&self) -> &SceneOrigin;
    fn origin_mut(&mut self) -> &mut SceneOrigin;
}

macro_rules! fields {
    ($($scene:ty),*) => {$(
        impl Fields for $scene {
            fn name(&self) -> &str {
                &self.name
            }
            fn frames(&self) -> usize {
                self.frames
            }
            fn origin(&self) -> &SceneOrigin {
                &self.origin
            }
            fn origin_mut(&mut self) -> &mut SceneOrigin {
                &mut self.origin
            }
        }
    )*};
}

fields!(
    Scene,
    SkinScene,
    LatticeScene,
    GeometricScene,
    SpringBodiesScene
);

/// The declaration of a kind of scenes.
pub(super) struct KindSpec {
    /// Name, also in the encoding of a scene.
    pub name: &'static str,
    /// Its keys besides the common ones.
    pub keys: &'static [(&'static str, Kind)],
    /// The key that decides that a scene is of this kind.
    pub deciding: &'static str,
    /// What to add where another of its keys stands without the deciding one.
    pub add: &'static str,
    /// Common keys that this kind does not have.
    pub without: &'static [&'static str],
    /// The measures of a run.
    pub measures: &'static [Measure],
    /// Reads a scene, given its name.
    pub read: fn(&Section<'_>, String) -> Result<Content, SceneError>,
}

/// Keys of scenes of every kind.
pub(super) const COMMON: [(&str, Kind); 3] =
    [("name", Text), ("frames", Plain), ("frame_rate", Text)];

/// The kinds of scenes. The first kind whose deciding key is in a scene reads it; without any, the
/// first kind reports what is missing.
pub(super) const KINDS: [KindSpec; 5] = [
    KindSpec {
        name: "muscles",
        keys: &[
            ("accuracy", Text),
            ("mesh_error", Plain),
            ("up", Plain),
            ("limits", Table(&Schema::Keys(&LIMITS))),
            ("bone", List(&schema::BONE)),
            ("opensim", Table(&schema::OPENSIM)),
            ("capsule", List(&schema::CAPSULE)),
            ("muscle", List(&schema::MUSCLE)),
            ("interface", List(&schema::INTERFACE)),
            ("effects", Table(&Schema::Effects)),
            ("solver", Table(&Schema::Solvers)),
        ],
        deciding: "muscle",
        add: "a section [[muscle]]",
        without: &[],
        measures: OF_MUSCLES,
        read: |root, name| Ok(Content::Muscles(Box::new(parse::scene(root, name)?))),
    },
    KindSpec {
        name: "skin",
        keys: &[
            ("skin", List(&schema::SKIN)),
            ("sheet", Table(&schema::SHEET)),
            ("implant", List(&schema::IMPLANT)),
            ("ball", Table(&schema::BALL)),
            ("obstacle", List(&schema::OBSTACLE)),
        ],
        deciding: "skin",
        add: "a section [[skin]], under which it goes",
        without: &["frame_rate"],
        measures: OF_SKIN,
        read: |root, name| Ok(Content::Skin(Box::new(parse_skin::scene(root, name)?))),
    },
    KindSpec {
        name: "lattice",
        keys: &[("lattice", Table(&schema::LATTICE))],
        deciding: "lattice",
        add: "a section [lattice]",
        without: &[],
        measures: OF_LATTICES,
        read: |root, name| {
            Ok(Content::Lattice(Box::new(parse_lattice::scene(
                root, name,
            )?)))
        },
    },
    KindSpec {
        name: "geometric",
        keys: geometric::KEYS,
        deciding: "radii",
        add: "`radii = [1.0, 2.0, 1.0]`",
        without: &[],
        measures: geometric::MEASURES,
        read: geometric::read,
    },
    KindSpec {
        name: "spring bodies",
        keys: spring_bodies::KEYS,
        deciding: "spring_body",
        add: "a section [[spring_body]]",
        without: &[],
        measures: spring_bodies::MEASURES,
        read: spring_bodies::read,
    },
];

impl Content {
    /// The scene as its kind.
    fn scene(&self) -> (&'static KindSpec, &dyn Fields) {
        match self {
            Self::Muscles(scene) => (&KINDS[0], &**scene),
            Self::Skin(scene) => (&KINDS[1], &**scene),
            Self::Lattice(scene) => (&KINDS[2], &**scene),
            Self::Geometric(scene) => (&KINDS[3], &**scene),
            Self::SpringBodies(scene) => (&KINDS[4], &**scene),
        }
    }

    /// Name of the kind: `muscles`, `skin`, `lattice`, `geometric` or `spring bodies`.
    pub fn kind(&self) -> &'static str {
        self.scene().0.name
    }

    /// Name, also of the results folder.
    pub fn name(&self) -> &str {
        self.scene().1.name()
    }

    /// Number of frames after the start.
    pub fn frames(&self) -> usize {
        self.scene().1.frames()
    }

    /// The accuracy that the user requests; only for muscles.
    pub fn accuracy(&self) -> Option<Accuracy> {
        match self {
            Self::Muscles(scene) => scene.accuracy,
            _ => None,
        }
    }

    /// The measures of a run.
    pub fn measures(&self) -> &'static [Measure] {
        self.scene().0.measures
    }

    /// The measures of all kinds.
    pub fn all_measures() -> impl Iterator<Item = &'static Measure> {
        KINDS.iter().flat_map(|kind| kind.measures)
    }

    /// Origin of the scene's text.
    pub fn origin(&self) -> &SceneOrigin {
        self.scene().1.origin()
    }

    /// The values with an interval.
    pub fn uncertain(&self) -> &[Uncertain] {
        self.origin().uncertain()
    }

    /// The same scene with values in place of some with an interval, by their keys and in SI units. A
    /// scene from code has no keys, and stays as it is.
    ///
    /// # Errors
    /// A value outside its limits, or a file that is no longer there.
    pub fn with_values(
        &self,
        values: &[(&str, f64)],
        variables: Variables,
    ) -> Result<Self, SceneError> {
        let read = self.origin().with_values(values, variables);
        read.unwrap_or_else(|| Ok(self.clone()))
    }

    /// The same scene with another origin.
    pub(super) fn with_origin(mut self, origin: SceneOrigin) -> Self {
        let scene: &mut dyn Fields = match &mut self {
            Self::Muscles(scene) => &mut **scene,
            Self::Skin(scene) => &mut **scene,
            Self::Lattice(scene) => &mut **scene,
            Self::Geometric(scene) => &mut **scene,
            Self::SpringBodies(scene) => &mut **scene,
        };
        *scene.origin_mut() = origin;
        self
    }
}

impl Encode for Content {
    fn encode(&self, to: &mut Encoder<'_>) {
        self.scene().1.encode(to);
    }
}

/// Measures of scenes of muscles; the greatest over several muscles.
pub const OF_MUSCLES: &[Measure] = &[
    ("time_s", "time [s]", 1.0),
    ("volume_error", "volume error", 1.0),
    ("penetration_m", "depth in bones [mm]", 1e3),
    ("edge_stretch_rms_end", "edge stretch rms, end [%]", 100.0),
    (
        "edge_stretch_rms_worst",
        "edge stretch rms, worst [%]",
        100.0,
    ),
    (
        "distance_from_start_rms_m",
        "distance to start, end [mm]",
        1e3,
    ),
    ("residual_m", "residual [mm]", 1e3),
    ("error_estimate.solver_m", "error estimate [mm]", 1e3),
];

/// Measures of scenes of skin, for all implants together, in the last frame.
const OF_SKIN: &[Measure] = &[
    ("time_s", "time [s]", 1.0),
    ("implant_volume_m3", "volume [cc]", 1e6),
    ("area_before_m2", "area before [cm2]", 1e4),
    ("area_deformed_m2", "deformed [cm2]", 1e4),
    ("area_gain_m2", "gain [cm2]", 1e4),
    ("area_retracted_low_m2", "retracted, least [cm2]", 1e4),
    ("area_retracted_high_m2", "retracted, most [cm2]", 1e4),
    ("area_grown_low_m2", "grown, least [cm2]", 1e4),
    ("area_grown_high_m2", "grown, most [cm2]", 1e4),
    ("volume_difference_m3", "volume difference [cc]", 1e6),
    ("stretch_max", "greatest stretch", 1.0),
    ("pressure_pa", "pressure [kPa]", 1e-3),
    ("penetration_m", "depth in each other [mm]", 1e3),
];

/// Measures of scenes of a lattice.
const OF_LATTICES: &[Measure] = &[
    ("time_s", "time [s]", 1.0),
    (
        "distance_from_start_max_m",
        "distance to start, greatest [mm]",
        1e3,
    ),
    (
        "distance_from_start_end_m",
        "distance to start, end [mm]",
        1e3,
    ),
    ("steps", "steps", 1.0),
    ("simulated_s", "simulated time [s]", 1.0),
    ("residual_force_n", "greatest force [N]", 1.0),
    ("kinetic_energy_j", "kinetic energy [J]", 1.0),
    ("spring_energy_j", "energy of the springs [J]", 1.0),
];
/// Skin with the implants or the ball below.
#[derive(Clone, Debug, PartialEq)]
pub struct SkinScene {
    /// Name, also of the results folder.
    pub name: String,
    /// Number of frames after the start; frame 0 is the skin without implants.
    pub frames: usize,
    /// Day of each frame after the start; empty unless implants are filled on days.
    pub days: Vec<f64>,
    /// The skin.
    pub skin: SkinSpec,
    /// The implants or the ball.
    pub under: Support,
    /// Obstacles that support the implants and the lower layer of the skin.
    pub obstacles: Vec<ObstacleSpec>,
    /// Origin of the scene's text, for errors found in its meshes.
    pub origin: SceneOrigin,
}

/// A skin.
#[derive(Clone, Debug, PartialEq)]
pub struct SkinSpec {
    /// Name of the skin.
    pub name: String,
    /// Surface of the skin.
    pub surface: SkinSurface,
    /// Repair of the surface, lengths in metres; `None` for none.
    pub repair: Option<repair::RepairOptions>,
    /// Stretch above which the result is a warning.
    pub stretch_limit: f64,
    /// Direction that is up in pictures; `None` for the axis of the greatest extent.
    pub up: Option<Vector3<f64>>,
    /// Method of the equilibrium; `None` selects it by size.
    pub method: Option<SettleMethod>,
}

/// Source of a skin's surface.
#[derive(Clone, Debug, PartialEq)]
pub enum SkinSurface {
    /// A file, or a shape without parameters.
    Source(Source),
    /// A flat square in the plane z = 0 about the origin.
    Sheet {
        /// Side of the square [m].
        side: f64,
        /// Number of squares along a side.
        cells: u32,
    },
}

/// The body that lifts a skin.
#[derive(Clone, Debug, PartialEq)]
pub enum Support {
    /// At least one implant.
    Implants(Vec<ImplantFill>),
    /// A rigid ball that rises from below.
    Ball(BallSpec),
}

/// An implant with its volumes over time.
#[derive(Clone, Debug, PartialEq)]
pub struct ImplantFill {
    /// Name, unique among implants.
    pub name: String,
    /// Place, shape and the skin above; the volume is that of the last frame.
    pub order: ImplantSpec,
    /// Frames and volumes [m^3], sorted by frame; constant after the last. Empty for a target area.
    pub fill: Vec<(usize, f64)>,
    /// How the volume changes between these frames.
    pub course: FillCourse,
}

/// How the volume of an implant changes over the frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FillCourse {
    /// Linear, from 0 in frame 0 to the one volume of the implant.
    Evenly,
    /// Linear between the frames of a list, from 0 in frame 0.
    Frames,
    /// Each volume of a list holds until the next filling; 0 before the first.
    Days,
    /// The one volume for which the region gains this area [m^2].
    Target(f64),
}

impl ImplantFill {
    /// The volume at a frame [m^3]; 0 for a target area, whose volume the equilibrium determines.
    pub fn volume_at(&self, frame: usize) -> f64 {
        let mut before = (0, 0.0);
        for &(at, volume) in &self.fill {
            if frame == at {
                return volume;
            }
            if frame < at && self.course == FillCourse::Days {
                return before.1;
            }
            if frame < at {
                let share = (frame - before.0) as f64 / (at - before.0) as f64;
                return before.1 + share * (volume - before.1);
            }
            before = (at, volume);
        }
        before.1
    }
}

/// A rigid ball that rises from below.
#[derive(Clone, Debug, PartialEq)]
pub struct BallSpec {
    /// Radius [m].
    pub radius: f64,
    /// Centre at the start [m]; `None` for contact with the skin from below.
    pub from: Option<Point3<f64>>,
    /// Centre in the last frame [m].
    pub to: Point3<f64>,
    /// Material and region of the skin above, as for an implant of that size.
    pub order: ImplantSpec,
}

/// A fixed body under the skin.
#[derive(Clone, Debug, PartialEq)]
pub struct ObstacleSpec {
    /// Name, unique among obstacles.
    pub name: String,
    /// Surface of the obstacle.
    pub surface: Source,
    /// Repair of the surface, lengths in metres; `None` for none.
    pub repair: Option<repair::RepairOptions>,
}

/// A box of points with springs: the bottom layer (along z) is fixed, the top layer is displaced
/// and released; or the surface is moved, and the lattice runs to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct LatticeScene {
    /// Name, also of the results folder.
    pub name: String,
    /// Number of frames after the start; frame 0 is the start.
    pub frames: usize,
    /// Frames a second [1/s]; of pictures only where the lattice runs to rest.
    pub frame_rate: f64,
    /// Number of points along x, y, z.
    pub points: [usize; 3],
    /// Length of the longest side [m].
    pub side: f64,
    /// Number of neighbours with springs.
    pub neighbours: Neighbours,
    /// Stiffness of the springs.
    pub stiffness: Stiffness,
    /// Mass of each point [kg].
    pub mass: f64,
    /// Damping of each point.
    pub damping: SpringsDamping,
    /// Displacement of the top layer [m].
    pub drag: Vector3<f64>,
    /// Frame in which the top layer reaches its displacement and is released.
    pub release: usize,
    /// The run to rest in place of the displacement; each step is a frame.
    pub rest: Option<RestCourse>,
    /// Origin of the scene's text.
    pub origin: SceneOrigin,
}

/// Damping of each point of a spring system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpringsDamping {
    /// Relative to the estimate (7.2) of the VPHOP thesis.
    Share(f64),
    /// Force over velocity [N s/m].
    Absolute(f64),
}

impl SpringsDamping {
    /// The damping [N s/m] for an estimate [N s/m].
    pub fn of(self, estimate: f64) -> f64 {
        match self {
            Self::Share(share) => share * estimate,
            Self::Absolute(damping) => damping,
        }
    }
}

/// Names of single and double precision.
pub const PRECISIONS: [&str; 2] = ["f32", "f64"];

/// The course of a spring system to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct RestCourse {
    /// Displacement of the surface at the start, relative to the distance to the centre.
    pub shrink: f64,
    /// Whether the surface is fixed.
    pub held: bool,
    /// Name of the integrator.
    pub integrator: &'static str,
    /// Time step [s]; `None` for half of the longest stable one.
    pub time_step: Option<f64>,
    /// Whether the step grows while it is stable, and is halved and repeated where it is not.
    pub adaptive: bool,
    /// Greatest force at rest, relative to the force at a strain of one.
    pub tolerance: f64,
    /// Whether the numbers of a lattice have single precision.
    pub is_single: bool,
    /// Name of the device that computes a lattice.
    pub device: &'static str,
    /// Name of the method on a graphics card.
    pub method: &'static str,
}

impl RestCourse {
    /// Name of the precision of the numbers: f32 or f64.
    pub fn precision(&self) -> &'static str {
        PRECISIONS[usize::from(!self.is_single)]
    }

    /// Whether a graphics card computes.
    pub fn is_on_gpu(&self) -> bool {
        self.device == DEVICES[1]
    }

    /// Whether steps of a lattice need no list of springs.
    pub fn is_by_rows(&self) -> bool {
        self.integrator == INTEGRATORS[0] && !self.adaptive
    }
}

impl Default for RestCourse {
    fn default() -> Self {
        Self {
            shrink: 0.02,
            held: true,
            integrator: INTEGRATORS[0],
            time_step: None,
            adaptive: false,
            tolerance: 1e-6,
            is_single: false,
            device: DEVICES[0],
            method: GPU_METHODS[0],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skin::plan::ImplantPlace;

    #[test]
    fn volumes_are_linear_between_the_frames_given() {
        let order = ImplantSpec::round(ImplantPlace::Vertex(0), 0.05, 30e-6);
        let filled = ImplantFill {
            name: "a".to_owned(),
            order,
            fill: vec![(2, 10e-6), (3, 30e-6), (5, 20e-6)],
            course: FillCourse::Frames,
        };
        let expected = [0.0, 5e-6, 10e-6, 30e-6, 25e-6, 20e-6, 20e-6];
        for (frame, expected) in expected.into_iter().enumerate() {
            assert!(
                (filled.volume_at(frame) - expected).abs() <= 1e-18,
                "{frame}"
            );
        }
        let held = ImplantFill {
            course: FillCourse::Days,
            ..filled
        };
        let volumes = [0, 1, 2, 4, 5, 6].map(|frame| held.volume_at(frame));
        assert_eq!(volumes, [0.0, 0.0, 10e-6, 30e-6, 20e-6, 20e-6]);
    }
}
