//! The kinds of scenes: muscles and bones, skin over implants, or a lattice of points with springs.

use nalgebra::{Point3, Vector3};

use super::{Accuracy, Scene, SceneOrigin, Source};
use crate::mesh::repair;
use crate::skin::ImplantSpec;
use crate::skin::settle::SettleMethod;
use crate::springs::Neighbours;

/// A checked scene of any kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Muscles around moving bones: a scene with `[[muscle]]`.
    Muscles(Box<Scene>),
    /// Skin over implants or over a ball, in equilibrium in every frame: a scene with `[[skin]]`.
    Skin(Box<SkinScene>),
    /// A box of points with springs, displaced and released: a scene with `[lattice]`.
    Lattice(Box<LatticeScene>),
}

impl Content {
    /// Name, also of the results folder.
    pub fn name(&self) -> &str {
        match self {
            Self::Muscles(scene) => &scene.name,
            Self::Skin(scene) => &scene.name,
            Self::Lattice(scene) => &scene.name,
        }
    }

    /// Number of frames after the start.
    pub fn frames(&self) -> usize {
        match self {
            Self::Muscles(scene) => scene.frames,
            Self::Skin(scene) => scene.frames,
            Self::Lattice(scene) => scene.frames,
        }
    }

    /// The accuracy that the user requests; only for muscles.
    pub fn accuracy(&self) -> Option<Accuracy> {
        match self {
            Self::Muscles(scene) => scene.accuracy,
            Self::Skin(_) | Self::Lattice(_) => None,
        }
    }

    /// Origin of the scene's text.
    pub fn origin(&self) -> &SceneOrigin {
        match self {
            Self::Muscles(scene) => &scene.origin,
            Self::Skin(scene) => &scene.origin,
            Self::Lattice(scene) => &scene.origin,
        }
    }

    /// The same scene with another origin.
    pub(super) fn with_origin(mut self, origin: SceneOrigin) -> Self {
        *match &mut self {
            Self::Muscles(scene) => &mut scene.origin,
            Self::Skin(scene) => &mut scene.origin,
            Self::Lattice(scene) => &mut scene.origin,
        } = origin;
        self
    }
}

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
/// and released.
#[derive(Clone, Debug, PartialEq)]
pub struct LatticeScene {
    /// Name, also of the results folder.
    pub name: String,
    /// Number of frames after the start; frame 0 is the start.
    pub frames: usize,
    /// Frames a second [1/s].
    pub frame_rate: f64,
    /// Number of points along x, y, z.
    pub points: [usize; 3],
    /// Length of the longest side [m].
    pub side: f64,
    /// Number of neighbours with springs.
    pub neighbours: Neighbours,
    /// Stiffness of each spring [N/m].
    pub stiffness: f64,
    /// Mass of each point [kg].
    pub mass: f64,
    /// Damping relative to the second source's estimate.
    pub damping: f64,
    /// Displacement of the top layer [m].
    pub drag: Vector3<f64>,
    /// Frame in which the top layer reaches its displacement and is released.
    pub release: usize,
    /// Origin of the scene's text.
    pub origin: SceneOrigin,
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
