//! Rotation of a map so that its features coincide with those of another, and motion of features to
//! their targets (errata M10).

use nalgebra::{DMatrix, Matrix3, Point3, UnitQuaternion, Vector3};

use super::sphere::kernel::sees;
use super::sphere::rings::Rings;
use super::sphere::{SphereError, SphereMap, flipped};

/// Error of an alignment.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AlignError {
    /// The two sides have different numbers of features.
    #[error("{from} features here and {to} there; give one for each")]
    Counts {
        /// Number on the map that moves.
        from: usize,
        /// Number on the other map.
        to: usize,
    },
    /// There are too few features for a rotation.
    #[error("{0} pairs of features; a rotation needs at least 2")]
    TooFew(usize),
    /// An area has no points.
    #[error("an area of no points has no centre")]
    Empty,
    /// The points of an area cancel out.
    #[error("the {points} points of an area lie all around the sphere; such an area has no centre")]
    NoCentre {
        /// Number of points.
        points: usize,
    },
    /// A vertex does not exist.
    #[error("vertex {vertex} is named, but there are {count}")]
    Vertex {
        /// The vertex.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// Two features have one target, or one vertex has two targets.
    #[error("features {first} and {second} are the same vertex or have the same place")]
    Same {
        /// Index of one feature, from 0.
        first: usize,
        /// Index of the other feature, from 0.
        second: usize,
    },
    /// A feature cannot reach its target without a fold of the map.
    #[error(
        "feature {feature} (vertex {vertex}) is still {left} rad from its place after {steps} steps without a fold"
    )]
    Stuck {
        /// Index of the feature, from 0.
        feature: usize,
        /// Vertex of the feature.
        vertex: u32,
        /// Remaining angle \[rad\].
        left: f64,
        /// Number of steps.
        steps: usize,
    },
    /// The result is no valid map.
    #[error(transparent)]
    Sphere(#[from] SphereError),
}

/// The centre of an area: the normalised mean of the directions of its vertices.
///
/// # Errors
/// No vertices, a vertex that does not exist, or directions that cancel out.
pub fn centre(map: &SphereMap, area: &[u32]) -> Result<Point3<f64>, AlignError> {
    if area.is_empty() {
        return Err(AlignError::Empty);
    }
    let count = map.points().len();
    if let Some(&vertex) = area.iter().find(|v| **v as usize >= count) {
        return Err(AlignError::Vertex { vertex, count });
    }
    let sum: Vector3<f64> = area.iter().map(|&v| map.points()[v as usize].coords).sum();
    let least = 1e-12 * area.len() as f64;
    sum.try_normalize(least)
        .map(Point3::from)
        .ok_or(AlignError::NoCentre { points: area.len() })
}

/// The rotation with the least sum of squared distances from `from` to `to` \[kabsch1976\].
///
/// # Errors
/// Fewer than two pairs, or lists of different lengths.
pub fn nearest_rotation(
    from: &[Point3<f64>],
    to: &[Point3<f64>],
) -> Result<UnitQuaternion<f64>, AlignError> {
    if from.len() != to.len() {
        return Err(AlignError::Counts {
            from: from.len(),
            to: to.len(),
        });
    }
    if from.len() < 2 {
        return Err(AlignError::TooFew(from.len()));
    }
    let products = from
        .iter()
        .zip(to)
        .map(|(f, t)| t.coords * f.coords.transpose());
    Ok(rotation_of(&products.sum()))
}

/// The rotation nearest to a matrix U S V^T: U diag(1, 1, det U V^T) V^T.
pub(super) fn rotation_of(matrix: &Matrix3<f64>) -> UnitQuaternion<f64> {
    let svd = matrix.svd(true, true);
    let (Some(u), Some(v)) = (svd.u, svd.v_t) else {
        return UnitQuaternion::identity();
    };
    let sign = (u * v).determinant().signum();
    // nalgebra sorts singular values in descending order: the sign of the last one changes.
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v;
    UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(rotation))
}

/// Parameters of the motion of features.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moving {
    /// Radius around a feature within which vertices move with it, on the unit sphere.
    pub radius: f64,
    /// Greatest number of steps.
    pub steps: usize,
}

impl Default for Moving {
    fn default() -> Self {
        Self {
            radius: 1.2,
            steps: 2000,
        }
    }
}

/// Greatest length of a step, relative to the radius; from one half on, vertices could pass each
/// other (M10).
const SHARE: f64 = 0.25;
/// Greatest number of halvings of the step of a vertex that does not see its ring from its new
/// position.
const HALVINGS: usize = 6;
/// The motion fails if the remaining angle does not decrease enough in this number of steps.
const PATIENCE: usize = 300;
const BETTER: f64 = 0.999;
/// A feature within this angle of its target is set to it \[rad\].
const THERE: f64 = 1e-9;

/// Moves vertices of a map, the features, to given targets, together with the vertices around them:
/// v := norm(v + sum over features of w_j b(|v - f_j|/d)), with a smooth bump b and w_j so that each
/// feature moves by its own step, of less than d/2. Where a triangle would be reversed, each vertex
/// moves only as far as it sees its ring, by halving.
///
/// The printed form, v := norm(v + h t (d - |v - f|)) one feature after the other, moves a feature
/// by d times the remaining distance (M10), and features in each other's neighbourhood drag each
/// other off their ways.
///
/// # Errors
/// Features that do not exist or coincide, and features that cannot move without a fold.
pub fn move_features(
    map: &SphereMap,
    features: &[u32],
    targets: &[Point3<f64>],
    how: &Moving,
) -> Result<SphereMap, AlignError> {
    move_features_while(map, features, targets, how, &|| true)
}

/// The same; gives up when `going` returns false.
pub(super) fn move_features_while(
    map: &SphereMap,
    features: &[u32],
    targets: &[Point3<f64>],
    how: &Moving,
    going: &dyn Fn() -> bool,
) -> Result<SphereMap, AlignError> {
    check_features(map, features, targets)?;
    let mut points = map.points().to_vec();
    let Some(rings) = Rings::new(points.len(), map.triangles()) else {
        return Err(SphereError::Vertex { vertex: 0 }.into());
    };
    let far = |points: &[Point3<f64>], i: usize| (targets[i] - points[features[i] as usize]).norm();
    let (mut least, mut since, mut steps) = (f64::INFINITY, 0, 0);
    while steps < how.steps && since <= PATIENCE && going() {
        if (0..features.len()).all(|i| far(&points, i) <= THERE) {
            return finish(map, points, features, targets);
        }
        steps += 1;
        let next = moved(&points, features, targets, how.radius, SHARE);
        if flipped(&next, map.triangles()).is_empty() {
            points = next;
        } else {
            // One thin triangle must not stop the motion: each vertex moves as far as it sees its
            // ring, and compressed regions expand.
            each_moved(&mut points, &rings, &next);
            relax(&mut points, &rings, features);
        }
        let left = (0..features.len()).map(|i| far(&points, i)).sum::<f64>();
        since = if left < least * BETTER { 0 } else { since + 1 };
        if since == 0 {
            least = left;
        }
    }
    let left = |i: usize| far(&points, i);
    let worst = (0..features.len())
        .max_by(|&i, &j| left(i).total_cmp(&left(j)))
        .unwrap_or(0);
    let left = 2.0 * libm::asin((0.5 * left(worst)).min(1.0));
    Err(AlignError::Stuck {
        feature: worst,
        vertex: features[worst],
        left,
        steps,
    })
}

fn check_features(
    map: &SphereMap,
    features: &[u32],
    targets: &[Point3<f64>],
) -> Result<(), AlignError> {
    let count = map.points().len();
    if features.len() != targets.len() {
        return Err(AlignError::Counts {
            from: features.len(),
            to: targets.len(),
        });
    }
    if let Some(&vertex) = features.iter().find(|v| **v as usize >= count) {
        return Err(AlignError::Vertex { vertex, count });
    }
    for second in 0..features.len() {
        let same = |first: &usize| {
            features[*first] == features[second] || targets[*first] == targets[second]
        };
        if let Some(first) = (0..second).find(same) {
            return Err(AlignError::Same { first, second });
        }
    }
    Ok(())
}

/// One step of all features, and what is around them with them: a smooth field that has at each
/// feature exactly its step. A sum of the steps of single features would drag those that lie near
/// each other off their ways.
fn moved(
    points: &[Point3<f64>],
    features: &[u32],
    targets: &[Point3<f64>],
    radius: f64,
    share: f64,
) -> Vec<Point3<f64>> {
    let from: Vec<Point3<f64>> = features.iter().map(|&f| points[f as usize]).collect();
    let step = |(f, target): (&Point3<f64>, &Point3<f64>)| {
        let offset = target - f;
        offset * (share * radius / offset.norm().max(share * radius))
    };
    let steps: Vec<Vector3<f64>> = from.iter().zip(targets).map(step).collect();
    let matrix = DMatrix::from_fn(from.len(), from.len(), |i, j| {
        bump((from[i] - from[j]).norm() / radius)
    });
    let right = DMatrix::from_fn(from.len(), 3, |i, k| steps[i][k]);
    // Features in one place have no such field.
    let Some(factor) = matrix.cholesky() else {
        return points.to_vec();
    };
    let weights = factor.solve(&right);
    let moved = |p: &Point3<f64>| {
        let mut by = Vector3::zeros();
        for (j, f) in from.iter().enumerate() {
            let near = bump((p - f).norm() / radius);
            (0..3).for_each(|k| by[k] += near * weights[(j, k)]);
        }
        if by == Vector3::zeros() {
            return *p;
        }
        Point3::from((p.coords + by).normalize())
    };
    points.iter().map(moved).collect()
}

/// Wendland's function of a distance, positive definite in space: 1 at 0, and 0 from 1 on.
fn bump(r: f64) -> f64 {
    let left = (1.0 - r).max(0.0);
    left * left * left * left * (4.0 * r + 1.0)
}

/// Moves vertices one after the other towards their targets, as far as they see their rings.
fn each_moved(points: &mut [Point3<f64>], rings: &Rings, goals: &[Point3<f64>]) {
    let mut ring = Vec::new();
    for v in 0..points.len() {
        if goals[v] != points[v] {
            go(points, rings, v, goals[v], &mut ring);
        }
    }
}

/// Moves a vertex towards a target, by halving, to a position that sees its ring.
fn go(
    points: &mut [Point3<f64>],
    rings: &Rings,
    v: usize,
    to: Point3<f64>,
    ring: &mut Vec<Point3<f64>>,
) {
    ring.clear();
    ring.extend(rings.of(v as u32).iter().map(|&w| points[w as usize]));
    let from = points[v].coords;
    let mut share = 1.0;
    for _ in 0..HALVINGS {
        let Some(target) = (from + (to.coords - from) * share)
            .try_normalize(0.0)
            .map(Point3::from)
        else {
            return;
        };
        if sees(&target, ring) {
            points[v] = target;
            return;
        }
        share *= 0.5;
    }
}

/// Moves all vertices but the features slightly towards the centroid of their neighbours, unless a
/// triangle is reversed.
fn relax(points: &mut [Point3<f64>], rings: &Rings, features: &[u32]) {
    let mut held = vec![false; points.len()];
    features.iter().for_each(|&f| held[f as usize] = true);
    let mut ring = Vec::new();
    for v in (0..points.len()).filter(|v| !held[*v]) {
        let sum: Vector3<f64> = rings
            .of(v as u32)
            .iter()
            .map(|&w| points[w as usize].coords)
            .sum();
        let Some(middle) = sum.try_normalize(0.0) else {
            continue;
        };
        let Some(half) = (points[v].coords + middle).try_normalize(0.0) else {
            continue;
        };
        go(points, rings, v, Point3::from(half), &mut ring);
    }
}

/// Sets the features exactly to their targets, unless a triangle is reversed.
fn finish(
    map: &SphereMap,
    mut points: Vec<Point3<f64>>,
    features: &[u32],
    targets: &[Point3<f64>],
) -> Result<SphereMap, AlignError> {
    for (&feature, target) in features.iter().zip(targets) {
        points[feature as usize] = *target;
    }
    Ok(SphereMap::new(points, map.triangles().to_vec())?)
}
