//! Relative rotation of two maps without named features: places that are near each other on the
//! bodies become near each other on the sphere.

use nalgebra::{Matrix3, UnitQuaternion};

use super::align::rotation_of;
use super::shape_similarity::{Match, ShapeSimilarity};
use super::sphere::SphereMap;
use crate::mesh::TriangleMesh;

/// Principal axes replace the given placement only if they reduce the distance to this share. A
/// nearly round or flat body has no axes, bones and muscles of one limb also fit in the wrong
/// direction, and a deliberate placement is right.
const BETTER: f64 = 0.4;

/// Source of the rotation of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The given placement of the bodies, translated and scaled onto each other.
    Placed,
    /// The principal axes of the bodies.
    Axes,
    /// Named features.
    Features,
}

impl Start {
    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Placed => "placed",
            Self::Axes => "axes",
            Self::Features => "pairs",
        }
    }
}

/// Pose of a first body and its map relative to a second.
pub struct InitialPose {
    /// Rotation of the first map.
    pub turn: UnitQuaternion<f64>,
    /// Source of the rotation.
    pub start: Start,
    /// Matched places of the two bodies.
    pub matches: Vec<Match>,
    /// Linear map from the first body to the second, relative to their centres.
    pub pose: Matrix3<f64>,
}

/// The rotation of the first map that puts similar parts of the bodies on similar parts of the
/// sphere.
///
/// The candidates are the given placement and the principal axes, with rotations about the longest
/// axis, since the other two of a round shaft are arbitrary. Similar places are matched by their
/// surroundings, and the candidate with the least distance wins. Then the map is rotated to the
/// least sum of squared distances of the matches \[kabsch1976\].
pub fn by_shape(maps: [&SphereMap; 2], shape_similarity: &ShapeSimilarity) -> InitialPose {
    let (start, pose, matches) = nearest_pose(shape_similarity);
    let mut product = Matrix3::zeros();
    for Match { vertices, weight } in &matches {
        let [from, to] = [0, 1].map(|side| maps[side].points()[vertices[side] as usize].coords);
        product += to * from.transpose() * *weight;
    }
    InitialPose {
        turn: rotation_of(&product),
        start,
        matches,
        pose,
    }
}

/// The linear map from the first body to the second after the better of the given placement and the
/// principal axes, with the matches there.
pub(super) fn nearest_pose(
    shape_similarity: &ShapeSimilarity,
) -> (Start, Matrix3<f64>, Vec<Match>) {
    let mut start = Start::Placed;
    let mut pose = shape_similarity.pose(&UnitQuaternion::identity());
    let (mut matches, mut least) = shape_similarity.matches(&pose);
    least *= BETTER;
    for turn in shape_similarity.by_axes() {
        let other = shape_similarity.pose(&turn);
        let (found, square) = shape_similarity.matches(&other);
        if square < least {
            (start, pose, matches, least) = (Start::Axes, other, found, square);
        }
    }
    (start, pose, matches)
}

/// Principal axes of a surface, the longest first, right-handed, as columns.
pub fn axes(mesh: &TriangleMesh) -> Matrix3<f64> {
    let middle = mesh.surface_centroid().unwrap_or_default();
    let mut spread = Matrix3::zeros();
    for (p, area) in mesh.vertices.iter().zip(mesh.vertex_areas()) {
        spread += (p - middle) * (p - middle).transpose() * area;
    }
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
    let [a, b] = [order[0], order[1]].map(|k| eigen.eigenvectors.column(k).into_owned());
    Matrix3::from_columns(&[a, b, a.cross(&b)])
}
