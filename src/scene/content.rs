//! What a scene may hold: muscles and bones, skin over implants, or a lattice of points on springs.

use nalgebra::{Point3, Vector3};

use super::{Accuracy, Origin, Scene, Source};
use crate::mesh::repair;
use crate::skin::ImplantSpec;
use crate::skin::settle::Method;
use crate::springs::Neighbours;

/// A checked scene of any kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Muscles that slide around moving bones: a scene with `[[muscle]]`.
    Muscles(Box<Scene>),
    /// Skin over implants or over a ball, at rest in every frame: a scene with `[[skin]]`.
    Skin(Box<SkinScene>),
    /// A box of points on springs, dragged and let go: a scene with `[lattice]`.
    Lattice(Box<LatticeScene>),
}

impl Content {
    /// Name, used for the folder of results.
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

    /// The error that the user allows; only muscles have one.
    pub fn accuracy(&self) -> Option<Accuracy> {
        match self {
            Self::Muscles(scene) => scene.accuracy,
            Self::Skin(_) | Self::Lattice(_) => None,
        }
    }

    /// Where it was read from.
    pub fn origin(&self) -> &Origin {
        match self {
            Self::Muscles(scene) => &scene.origin,
            Self::Skin(scene) => &scene.origin,
            Self::Lattice(scene) => &scene.origin,
        }
    }

    /// The same with another origin.
    pub(super) fn with_origin(mut self, origin: Origin) -> Self {
        *match &mut self {
            Self::Muscles(scene) => &mut scene.origin,
            Self::Skin(scene) => &mut scene.origin,
            Self::Lattice(scene) => &mut scene.origin,
        } = origin;
        self
    }
}

/// Skin and what lifts it.
#[derive(Clone, Debug, PartialEq)]
pub struct SkinScene {
    /// Name, used for the folder of results.
    pub name: String,
    /// Number of frames after the start; frame 0 is the skin before.
    pub frames: usize,
    /// The skin.
    pub skin: Skin,
    /// What lifts it.
    pub under: Under,
    /// What lies below: implants and the lower layer of the skin rest on it.
    pub obstacles: Vec<Obstacle>,
    /// Where it was read from, for errors that only its meshes show.
    pub origin: Origin,
}

/// A skin.
#[derive(Clone, Debug, PartialEq)]
pub struct Skin {
    /// Its name.
    pub name: String,
    /// Its surface.
    pub surface: SkinSurface,
    /// What is repaired before it is used, lengths in metres; `None` takes it as it is.
    pub repair: Option<repair::Options>,
    /// Stretch above which it is told to be stretched too far.
    pub stretch_limit: f64,
    /// How equilibria are sought; `None`: by its size.
    pub method: Option<Method>,
}

/// Where a skin comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum SkinSurface {
    /// A file, or a shape without parameters.
    Source(Source),
    /// A flat square in the plane z = 0 about the origin.
    Sheet {
        /// Its side [m].
        side: f64,
        /// Squares along it.
        cells: u32,
    },
}

/// What lifts a skin.
#[derive(Clone, Debug, PartialEq)]
pub enum Under {
    /// Implants, at least one.
    Implants(Vec<Filled>),
    /// A rigid ball that comes from below.
    Ball(Ball),
}

/// An implant and when it holds how much.
#[derive(Clone, Debug, PartialEq)]
pub struct Filled {
    /// Unique among implants.
    pub name: String,
    /// Place, shape, the skin over it; its volume is that of the last frame.
    pub order: ImplantSpec,
    /// Frames and volumes [m^3], sorted by frame; linear between them, from nothing in frame 0, the last one kept.
    pub fill: Vec<(usize, f64)>,
}

impl Filled {
    /// The volume at a frame [m^3].
    pub fn volume_at(&self, frame: usize) -> f64 {
        let mut before = (0, 0.0);
        for &(at, volume) in &self.fill {
            if frame <= at {
                let share = (frame - before.0) as f64 / (at - before.0) as f64;
                return before.1 + share * (volume - before.1);
            }
            before = (at, volume);
        }
        before.1
    }
}

/// A rigid ball that comes from below.
#[derive(Clone, Debug, PartialEq)]
pub struct Ball {
    /// Its radius [m].
    pub radius: f64,
    /// Its centre at the start [m]; `None`: so deep that it touches the skin from below.
    pub from: Option<Point3<f64>>,
    /// Its centre in the last frame [m].
    pub to: Point3<f64>,
    /// The skin over it, as for an implant of its size.
    pub order: ImplantSpec,
}

/// A body at rest under the skin.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// Unique among obstacles.
    pub name: String,
    /// Its surface.
    pub surface: Source,
    /// What is repaired before it is used, lengths in metres; `None` takes it as it is.
    pub repair: Option<repair::Options>,
}

/// A box of points on springs, its lowest layer (along z) held, its highest dragged and let go.
#[derive(Clone, Debug, PartialEq)]
pub struct LatticeScene {
    /// Name, used for the folder of results.
    pub name: String,
    /// Number of frames after the start; frame 0 is the start.
    pub frames: usize,
    /// Frames a second [1/s].
    pub frame_rate: f64,
    /// Points along x, y, z.
    pub points: [usize; 3],
    /// Length of the longest side [m].
    pub side: f64,
    /// Which springs there are.
    pub neighbours: Neighbours,
    /// Of each spring [N/m].
    pub stiffness: f64,
    /// Of each point [kg].
    pub mass: f64,
    /// Damping as a share of the second source's estimate.
    pub damping: f64,
    /// How far the highest layer is dragged [m].
    pub drag: Vector3<f64>,
    /// It gets there, and is let go, in this frame.
    pub release: usize,
    /// Where it was read from.
    pub origin: Origin,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skin::plan::Place;

    #[test]
    fn volumes_are_linear_between_the_frames_given() {
        let order = ImplantSpec::round(Place::Vertex(0), 0.05, 30e-6);
        let filled = Filled {
            name: "a".to_owned(),
            order,
            fill: vec![(2, 10e-6), (3, 30e-6), (5, 20e-6)],
        };
        let wanted = [0.0, 5e-6, 10e-6, 30e-6, 25e-6, 20e-6, 20e-6];
        for (frame, wanted) in wanted.into_iter().enumerate() {
            assert!((filled.volume_at(frame) - wanted).abs() <= 1e-18, "{frame}");
        }
    }
}
