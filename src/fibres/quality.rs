//! Quality measures of fibres, independent of their method.

use super::attachment::{Area, Attachment};
use super::fibre_measures::{Tendon, action, turned};
use super::polyline::length;
use super::solid::Closed;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::max_or_nan;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// A point is outside if its distance to the muscle exceeds this share of the muscle's length.
pub const OUTSIDE: f64 = 1e-9;
/// Number of sample points inside the muscle for the coverage.
const PROBES: f64 = 6_000.0;

/// Quality measures of fibres.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Quality {
    /// Number of fibres.
    pub fibres: usize,
    /// Total number of points of all fibres.
    pub points: usize,
    /// Number of points farther outside the muscle than [`OUTSIDE`] of its length.
    pub outside: usize,
    /// Greatest distance of an outside point to the surface [m].
    pub outside_max_m: f64,
    /// Greatest distance of a fibre end to its projected area [m].
    pub end_distance_max_m: f64,
    /// Greatest length of a straight tendon from a fibre end to a patch [m]; 0 without tendons.
    pub tendon_length_max_m: f64,
    /// Least Jacobian of the fibre map, relative to the start of each fibre; NaN without a map.
    pub jacobian_min: f64,
    /// Least distance of an inner fibre point to another fibre [m].
    pub spacing_min_m: f64,
    /// Share of the volume within one mean spacing of a fibre. The mean spacing is the square root
    /// of the volume over the total fibre length.
    pub coverage: f64,
    /// Mean length of the fibres, without tendons [m].
    pub length_mean_m: f64,
    /// Mean angle between fibres and line of action [rad]: from the mean of all origins to that of
    /// all insertions, or with aponeuroses from the middle of one area to that of the other;
    /// serialised in degrees.
    #[cfg_attr(
        feature = "serde",
        serde(rename = "pennation_mean_deg", serialize_with = "degrees")
    )]
    pub pennation_mean_rad: f64,
}

#[cfg(feature = "serde")]
fn degrees<S: serde::Serializer>(angle: &f64, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_f64(angle.to_degrees())
}

/// Measures the fibres of a muscle, each from origin to insertion. `jacobian` holds the Jacobians
/// of the fibre map.
pub fn measure(
    muscle: &TriangleMesh,
    closed: &Closed,
    attachment: &Attachment,
    fibres: &[Vec<Point3<f64>>],
    jacobian: impl IntoIterator<Item = f64>,
) -> Quality {
    let out = outside(muscle, closed, fibres);
    let limit = OUTSIDE * muscle.length();
    let total: f64 = fibres.iter().map(|f| length(f)).sum();
    let ends = [(&attachment.origin, false), (&attachment.insertion, true)];
    let at_end = |last: bool| {
        fibres
            .iter()
            .filter_map(move |f| if last { f.last() } else { f.first() })
    };
    let far = ends.iter().flat_map(|&(area, last)| {
        let tree = area.tree(muscle);
        at_end(last).map(|p| distance(&tree, p)).collect::<Vec<_>>()
    });
    let tendons = ends.iter().flat_map(|&(area, last)| {
        let tree = area
            .patch
            .as_ref()
            .map(|patch| SurfaceTree::new(&patch.vertices, &patch.triangles));
        at_end(last)
            .map(|p| tree.as_ref().map_or(0.0, |tree| distance(tree, p)))
            .collect::<Vec<_>>()
    });
    Quality {
        fibres: fibres.len(),
        points: fibres.iter().map(Vec::len).sum(),
        outside: out.iter().filter(|d| !(**d <= limit)).count(),
        outside_max_m: max_or_nan(out.iter().copied()),
        end_distance_max_m: max_or_nan(far),
        tendon_length_max_m: max_or_nan(tendons),
        jacobian_min: least(jacobian),
        spacing_min_m: spacing_min(fibres),
        coverage: coverage(closed, fibres),
        length_mean_m: total / fibres.len() as f64,
        pennation_mean_rad: pennation(fibres, attachment.action),
    }
}

/// Straight tendons from each fibre end to the closest point of a distant patch.
pub fn tendons(area: &Area, ends: &[Point3<f64>]) -> Vec<Tendon> {
    let Some(patch) = &area.patch else {
        return Vec::new();
    };
    let tree = SurfaceTree::new(&patch.vertices, &patch.triangles);
    ends.iter()
        .filter_map(|p| Some([*p, tree.closest(p, f64::INFINITY)?.point]))
        .collect()
}

/// The least of some numbers; NaN if one is NaN or if there is none.
fn least(numbers: impl IntoIterator<Item = f64>) -> f64 {
    numbers
        .into_iter()
        .reduce(|a, b| if a.is_nan() || a <= b { a } else { b })
        .unwrap_or(f64::NAN)
}

fn distance(tree: &SurfaceTree, p: &Point3<f64>) -> f64 {
    tree.closest(p, f64::INFINITY)
        .map_or(f64::INFINITY, |found| found.distance)
}

/// Distance of each point to the inside [m]: 0 for points inside, otherwise the distance to the
/// given or the closed surface.
fn outside(muscle: &TriangleMesh, closed: &Closed, fibres: &[Vec<Point3<f64>>]) -> Vec<f64> {
    let solid = closed.solid();
    let tree = SurfaceTree::new(&muscle.vertices, &muscle.triangles);
    let distance = |p: &Point3<f64>| match solid.contains_as_given(p) {
        true => 0.0,
        false => distance(&tree, p).min(
            solid
                .wall(p, f64::INFINITY)
                .map_or(f64::INFINITY, |w| w.distance),
        ),
    };
    fibres.iter().flatten().map(distance).collect()
}

/// A tree over the fibre segments, as triangles of zero area.
fn segments(fibres: &[Vec<Point3<f64>>]) -> SurfaceTree {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for fibre in fibres {
        for s in fibre.windows(2) {
            let first = vertices.len() as u32;
            vertices.extend_from_slice(s);
            triangles.push([first, first + 1, first + 1]);
        }
    }
    SurfaceTree::new(&vertices, &triangles)
}

/// Share of the volume within one mean spacing of a fibre. The mean spacing is the square root of
/// the volume over the total fibre length.
pub fn coverage(closed: &Closed, fibres: &[Vec<Point3<f64>>]) -> f64 {
    let total: f64 = fibres.iter().map(|f| length(f)).sum();
    let solid = closed.solid();
    let volume = closed.mesh.volume().abs();
    let spacing = (volume / total).sqrt();
    let side = (volume / PROBES).cbrt();
    let tree = segments(fibres);
    let bounds = closed.mesh.bounding_box();
    let counts: [u32; 3] =
        std::array::from_fn(|k| (bounds.extents()[k] / side).ceil().max(1.0) as u32);
    let (mut inside, mut covered) = (0usize, 0usize);
    for k in 0..counts[2] {
        for j in 0..counts[1] {
            for i in 0..counts[0] {
                let p = bounds.min
                    + Vector3::new(f64::from(i) + 0.5, f64::from(j) + 0.5, f64::from(k) + 0.5)
                        * side;
                if solid.contains(&p) {
                    inside += 1;
                    covered += usize::from(tree.closest(&p, spacing).is_some());
                }
            }
        }
    }
    covered as f64 / inside as f64
}

fn spacing_min(fibres: &[Vec<Point3<f64>>]) -> f64 {
    let tree = segments(fibres);
    let mut fibre_of = Vec::new();
    for (n, fibre) in fibres.iter().enumerate() {
        fibre_of.extend(std::iter::repeat_n(n, fibre.len().saturating_sub(1)));
    }
    let nearest = |(n, fibre): (usize, &Vec<Point3<f64>>)| {
        let inner = fibre.iter().skip(1).take(fibre.len().saturating_sub(2));
        let to = |p| tree.closest_of(p, f64::INFINITY, |t| fibre_of[t as usize] != n);
        least(inner.map(|p| to(p).map_or(f64::INFINITY, |found| found.distance)))
    };
    least(
        fibres
            .par_iter()
            .enumerate()
            .map(nearest)
            .collect::<Vec<f64>>(),
    )
}

fn pennation(fibres: &[Vec<Point3<f64>>], along: Option<Vector3<f64>>) -> f64 {
    let action = along.unwrap_or_else(|| action(fibres));
    let angles: f64 = fibres.iter().map(|f| turned(f, &action)).sum();
    angles / fibres.iter().map(|f| length(f)).sum::<f64>()
}
