//! The shape of a geometric muscle at one length.

use nalgebra::Point3;

use super::muscle::GeometricMuscle;
use super::surface::{Fineness, surface};
use crate::mesh::TriangleMesh;

/// Shape and measures of a muscle at one length.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// The surface \[m\].
    pub mesh: TriangleMesh,
    /// The bars \[m\]: free end, muscle, joint, muscle, free end; empty without a frame.
    pub bars: Vec<Point3<f64>>,
    /// Angle at the joint \[rad\].
    pub joint_angle: Option<f64>,
    /// Length \[m\].
    pub length: f64,
    /// Greatest radius \[m\].
    pub radius: f64,
    /// Relative departure of the volume from that at rest.
    pub volume_error: f64,
}

impl Pose {
    /// The pose of the muscle at its present length.
    pub fn of(muscle: &GeometricMuscle) -> Self {
        let chain = &muscle.chain;
        // The frame has a place for every length in the muscle's range.
        let placed = muscle
            .frame
            .and_then(|frame| frame.place(chain.length()).ok());
        let bars = placed.map_or(Vec::new(), |placed| {
            placed.points.map(|p| Point3::new(p.x, p.y, 0.0)).to_vec()
        });
        Self {
            mesh: surface(chain, Fineness::default()),
            bars,
            joint_angle: placed.map(|placed| placed.joint_angle),
            length: chain.length(),
            radius: chain.radii().iter().copied().fold(0.0, f64::max),
            volume_error: chain.volume_now() / chain.volume() - 1.0,
        }
    }
}

/// Poses at given lengths \[m\], each clamped to the range of the muscle.
pub fn at(muscle: &GeometricMuscle, lengths: impl Iterator<Item = f64>) -> Vec<Pose> {
    let mut muscle = muscle.clone();
    let [least, most] = muscle.range;
    let of_length = |length: f64| {
        muscle.chain.set_length(length.clamp(least, most)).ok()?;
        Some(Pose::of(&muscle))
    };
    lengths.filter_map(of_length).collect()
}
