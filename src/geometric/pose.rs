//! The shape of a geometric muscle at one length.

use nalgebra::Point3;

use super::file::GeometricMuscle;
use super::surface::{Fineness, surface};
use crate::mesh::TriangleMesh;

/// Shape and measures of a muscle at one length.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// The surface \[m\].
    pub mesh: TriangleMesh,
    /// The bars \[m\], two polylines; empty without a frame.
    pub bars: Vec<Vec<Point3<f64>>>,
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
            let points = placed.points.map(|p| Point3::new(p.x, p.y, 0.0));
            vec![points[..3].to_vec(), points[2..].to_vec()]
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

/// The length at picture `k` of a cycle of `count` pictures: from rest to the longest, to the
/// shortest and back [m].
pub fn length_at(muscle: &GeometricMuscle, k: u32, count: u32) -> f64 {
    let ([least, most], rest) = (muscle.range, muscle.chain.rest().length);
    let s = libm::sin(2.0 * std::f64::consts::PI * f64::from(k) / f64::from(count));
    let length = if s >= 0.0 {
        rest + s * (most - rest)
    } else {
        rest + s * (rest - least)
    };
    length.clamp(least, most)
}

/// Poses from rest to the longest, to the shortest and back.
pub fn cycle(muscle: &GeometricMuscle, count: u32) -> Vec<Pose> {
    at(muscle, (0..count).map(|k| length_at(muscle, k, count)))
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
