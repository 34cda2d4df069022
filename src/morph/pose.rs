//! How two maps lie to each other where nothing is named: turned so that places that are near each other on the bodies are near
//! on the sphere as well.

use nalgebra::{Matrix3, UnitQuaternion};

use super::align::rotation_of;
use super::shape_similarity::{Match, ShapeSimilarity};
use super::sphere::SphereMap;
use crate::mesh::TriangleMesh;

/// The axes must lay the bodies onto each other so much better than they lie: a body that is nearly round or flat has no axes,
/// bones and muscles of one limb fit as well the wrong way round, and where somebody placed them is right.
const BETTER: f64 = 0.4;

/// From what the turn of a map was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Bodies as they are placed, moved and scaled onto each other.
    Placed,
    /// Bodies turned by their principal axes.
    Axes,
    /// Features that were named.
    Features,
}

impl Start {
    /// As in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Placed => "placed",
            Self::Axes => "axes",
            Self::Features => "pairs",
        }
    }
}

/// How a first body and its map lie to a second.
pub struct InitialPose {
    /// Turn of the first map.
    pub turn: UnitQuaternion<f64>,
    /// From what it was found.
    pub start: Start,
    /// What is alike on the two.
    pub matches: Vec<Match>,
    /// How the first body is laid over the second, about their middles.
    pub pose: Matrix3<f64>,
}

/// The turn of the first map after which like parts of the bodies lie on like parts of the sphere.
///
/// The bodies are laid over each other as they are placed, and by their principal axes, with turns about the longest, for the other
/// two of a round shaft say nothing; like places are matched (by what lies around them), and those that are nearest to each other
/// win. Then the map is turned to the least sum of squares of the matches \[kabsch1976\].
pub fn by_shape(maps: [&SphereMap; 2], shape_similarity: &ShapeSimilarity) -> InitialPose {
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
