//! Stiffness factor of an edge as a function of its angle to the nearest fibre:
//! `1 - A |u.v|^power`.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::mesh::closest::place_on_segment;
use crate::mesh::measures::{Aabb, max_or_nan};

/// Factor 0..1 of each edge: 1 - A |u.v|^power, with the unit vectors u along the edge and v along
/// the nearest fibre segment (erratum A12: without the absolute value half of all edges would get
/// more than 1). The factor is 1 for edges without length and for muscles without fibres.
pub fn factors(cosines: &[Option<f64>], strength: f64, power: f64) -> Vec<f64> {
    let factor =
        |cosine: &Option<f64>| cosine.map_or(1.0, |cosine| factor(cosine, strength, power));
    cosines.iter().map(factor).collect()
}

/// |u.v| of [`factors`] for each edge, at most 1; `None` for an edge without length or without
/// fibres.
pub fn cosines(
    vertices: &[Point3<f64>],
    edges: &[[u32; 2]],
    fibres: &[Vec<Point3<f64>>],
) -> Vec<Option<f64>> {
    let segments = Segments::new(fibres);
    edges
        .par_iter()
        .map(|&[a, b]| {
            let (a, b) = (vertices[a as usize], vertices[b as usize]);
            let v = segments.nearest_direction(&nalgebra::center(&a, &b))?;
            let u = (b - a).try_normalize(0.0)?;
            Some(u.dot(&v).abs().min(1.0))
        })
        .collect()
}

/// The factor for a cosine |u.v|.
pub fn factor(cosine: f64, strength: f64, power: f64) -> f64 {
    (1.0 - strength * cosine.powf(power)).clamp(0.0, 1.0)
}

/// Number of fibre segments that share a box.
const TOGETHER: usize = 8;

/// Rounding error of a difference of coordinates, relative to the coordinates.
const ROUNDED: f64 = 16.0 * f64::EPSILON;

/// The segments of all fibres with positive length, in boxes.
struct Segments {
    all: Vec<Segment>,
    /// Bounding box of each group of [`TOGETHER`] segments.
    boxes: Vec<Aabb>,
    /// Greatest coordinate \[m\].
    size: f64,
}

/// A part of a fibre, with the directions of the fibre at its ends.
struct Segment {
    ends: [Point3<f64>; 2],
    tangents: [Vector3<f64>; 2],
}

impl Segment {
    /// The parts of a fibre. A bend has the mean of the directions on its two sides: a point outside
    /// the bend is as near to one side as to the other, and rounding alone would choose.
    fn of(fibre: &[Point3<f64>]) -> Vec<Self> {
        let parts = fibre.windows(2).filter_map(|ends| {
            let along = (ends[1] - ends[0]).try_normalize(0.0)?;
            let (ends, tangents) = ([ends[0], ends[1]], [along; 2]);
            Some(Self { ends, tangents })
        });
        let mut parts: Vec<Self> = parts.collect();
        for k in 1..parts.len() {
            let both = [parts[k - 1].tangents[1], parts[k].tangents[0]];
            // A fibre that turns back has no mean.
            if let Some(mean) = (both[0] + both[1]).try_normalize(1e-9) {
                parts[k - 1].tangents[1] = mean;
                parts[k].tangents[0] = mean;
            }
        }
        parts
    }
}

impl Segments {
    fn new(fibres: &[Vec<Point3<f64>>]) -> Self {
        let all: Vec<Segment> = fibres.iter().flat_map(|line| Segment::of(line)).collect();
        let boxes = all
            .chunks(TOGETHER)
            .map(|some| Aabb::of_points(some.iter().flat_map(|s| &s.ends)))
            .collect();
        let size = max_or_nan(all.iter().flat_map(|s| &s.ends).map(|p| p.coords.amax()));
        Self { all, boxes, size }
    }

    /// The direction of the nearest fibre at its place nearest to `p`, of several equally near segments
    /// of the first.
    fn nearest_direction(&self, p: &Point3<f64>) -> Option<Vector3<f64>> {
        let mut best: Option<(f64, f64, &Segment)> = None;
        let slack = ROUNDED * (self.size + p.coords.amax());
        for (some, bounds) in self.all.chunks(TOGETHER).zip(&self.boxes) {
            let away = (p - bounds.min.sup(&bounds.max.inf(p))).norm();
            // A box that is farther by rounding alone can contain the nearest segment.
            if best.is_some_and(|(d, ..)| away > d.sqrt() + slack) {
                continue;
            }
            for segment in some {
                let [a, b] = segment.ends;
                let place = place_on_segment(p, &a, &b);
                let squared = (a + (b - a) * place - p).norm_squared();
                if best.is_none_or(|(d, ..)| squared < d) {
                    best = Some((squared, place, segment));
                }
            }
        }
        let (_, place, Segment { ends, tangents }) = best?;
        let along = tangents[0].lerp(&tangents[1], place).try_normalize(0.0);
        along.or_else(|| (ends[1] - ends[0]).try_normalize(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Draw;

    #[test]
    fn random_edges_have_mean_one_half_and_stay_in_range() {
        let mut draw = Draw::new(7);
        let v = Vector3::z();
        let mut sum = 0.0;
        let mut printed_form_exceeds = 0;
        for _ in 0..100_000 {
            let u = draw.direction();
            let k = factor(u.dot(&v).abs(), 1.0, 1.0);
            assert!((0.0..=1.0).contains(&k));
            sum += k;
            printed_form_exceeds += usize::from(1.0 - u.dot(&v) > 1.0);
        }
        assert!((sum / 1e5 - 0.5).abs() <= 0.005);
        // The printed form of the source gives half of all edges more than full stiffness.
        assert!(printed_form_exceeds > 49_000);
    }

    #[test]
    fn the_direction_is_that_of_the_nearest_fibre() {
        let p = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let fibres = vec![
            vec![p(0.0, 0.0), p(1.0, 0.0)],
            vec![p(0.0, 5.0), p(0.0, 6.0)],
        ];
        let vertices = [p(0.0, 0.1), p(1.0, 0.1), p(0.1, 5.0), p(1.1, 5.0)];
        let k = factors(&cosines(&vertices, &[[0, 1], [2, 3]], &fibres), 0.5, 1.0);
        assert!((k[0] - 0.5).abs() <= 1e-12 && (k[1] - 1.0).abs() <= 1e-12);
    }

    #[test]
    fn a_bend_has_the_mean_direction_of_its_sides() {
        let p = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let fibre = |points: &[Point3<f64>]| Segments::new(&[points.to_vec()]);
        let bent = fibre(&[p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0)]);
        let mean = Vector3::new(1.0, 1.0, 0.0).normalize();
        // As near to one side as to the other, whatever the rounding of the place.
        for by in [0.1, 0.1 + f64::EPSILON, 1e-3, 1e3] {
            let found = bent.nearest_direction(&p(1.0 + by, -by)).expect("a fibre");
            assert!((found - mean).norm() <= 1e-12, "{by}: {found}");
        }
        let end = bent.nearest_direction(&p(0.0, -1.0)).expect("a fibre");
        assert_eq!(end, Vector3::x());
        let middle = bent.nearest_direction(&p(0.5, -1.0)).expect("a fibre");
        assert!((middle - (end + mean).normalize()).norm() <= 1e-12);
        // Back on itself: a direction of one of its sides.
        let back = fibre(&[p(0.0, 0.0), p(1.0, 0.0), p(0.0, 0.0)]);
        let found = back.nearest_direction(&p(2.0, 0.0)).expect("a fibre");
        assert!((found.x.abs() - 1.0).abs() <= 1e-12);
    }

    #[test]
    fn boxes_leave_out_nothing_that_is_nearest() {
        let mut draw = Draw::new(11);
        let mut line = || {
            let start = Point3::from(draw.direction());
            (0..12).map(|_| start + draw.direction() * 0.05).collect()
        };
        let fibres: Vec<Vec<Point3<f64>>> = (0..40).map(|_| line()).collect();
        let boxed = |bounds: Option<Aabb>| {
            let mut segments = Segments::new(&fibres);
            bounds
                .iter()
                .for_each(|bounds| segments.boxes.fill(*bounds));
            segments
        };
        let [tight, none, wrong] = [
            None,
            Some(Aabb::of_points(fibres.iter().flatten())),
            Some(Aabb::of_points(&[Point3::new(9.0, 9.0, 9.0)])),
        ]
        .map(boxed);
        let points: Vec<Point3<f64>> = (0..2000)
            .map(|_| Point3::from(draw.direction() * 0.9))
            .collect();
        assert!(
            points
                .iter()
                .all(|p| tight.nearest_direction(p) == none.nearest_direction(p))
        );
        assert!(
            points
                .iter()
                .any(|p| wrong.nearest_direction(p) != none.nearest_direction(p)),
            "no box counts"
        );
    }
}
