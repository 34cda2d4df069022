//! Bones as a body feels them that cannot bend more sharply than its own edges.
//!
//! The direction from the nearest point turns at a ridge within less than a contact thickness, and jumps
//! where two points are equally near. A vertex slips there, or is thrown, within one frame. The mean
//! direction over a ball turns gradually while the vertex moves by the radius of the ball.

use std::collections::{BTreeSet, HashMap};

use nalgebra::{Point3, Unit, Vector3};
use rayon::prelude::*;

#[cfg(feature = "contact")]
use super::surface::Surface;
use super::{Obstacle, Projection};
use crate::mesh::measures::Aabb;

/// Cosine of the greatest angle between the mean direction and that from the nearest point. A plane
/// that is steeper to the surface lets the vertex sink while it slides.
const MOST: f64 = 0.5;

/// Bound on the rounding of the cosine of an angle between two directions.
const ROUNDING: f64 = 1e-12;

/// Number of points of a mean.
pub(crate) const POINTS: usize = 15;

/// A point and 14 points at distance `radius` [m] around it: seven directions along a spiral over a
/// hemisphere and their opposites. Along any line they are about evenly spread, so that few pass an
/// edge at once, and odd moments vanish.
pub(crate) fn around(middle: &Point3<f64>, radius: f64) -> [Point3<f64>; POINTS] {
    let half = POINTS / 2;
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    std::array::from_fn(|k| {
        if k == 0 {
            return *middle;
        }
        let (at, sign) = ((k - 1) / 2, if k % 2 == 0 { -radius } else { radius });
        let z = (at as f64 + 0.5) / half as f64;
        let (sin, cos) = libm::sincos(at as f64 * golden);
        let wide = (1.0 - z * z).sqrt();
        middle + Vector3::new(wide * cos, wide * sin, z) * sign
    })
}

/// The mean direction away from one obstacle, on a grid in its frame.
///
/// A value belongs to a place on the grid alone, so that it is computed once, at the first vertex near
/// it, and is the same whenever that is.
#[derive(Clone, Debug)]
pub(super) struct MeanNormals {
    /// A node of the grid [m].
    origin: Point3<f64>,
    /// Radius of the means, and edge of a cell [m].
    radius: f64,
    /// Sums of the normals around nodes; unused for an obstacle without edges.
    sums: Option<HashMap<Node, Vector3<f64>>>,
}

type Node = [i64; 3];

impl MeanNormals {
    /// Means over `radius` [m], which is at least zero.
    pub fn new(obstacle: &dyn Obstacle, radius: f64) -> Self {
        let Aabb { min, max } = obstacle.bounding_box();
        // Off the planes of symmetry of a body: two of its faces would be equally near there.
        let aside = Vector3::new(0.19, 0.23, 0.31) * radius;
        let has_edges = !obstacle.contact_samples().is_empty() && radius > 0.0;
        Self {
            origin: nalgebra::center(&min, &max) + aside,
            radius,
            sums: has_edges.then(HashMap::new),
        }
    }

    /// The mean direction at each place with its nearest point, of length one.
    pub fn at(
        &mut self,
        obstacle: &dyn Obstacle,
        places: &[(Point3<f64>, Projection)],
    ) -> Vec<Vector3<f64>> {
        self.prepare(obstacle, places);
        let mean = |(at, own): &(Point3<f64>, Projection)| match &self.sums {
            Some(sums) => leant(&own.normal, &self.between(sums, at)),
            None => own.normal,
        };
        places.par_iter().with_min_len(32).map(mean).collect()
    }

    /// Computes the sums at those corners of the cells of `places` where they are unknown.
    fn prepare(&mut self, obstacle: &dyn Obstacle, places: &[(Point3<f64>, Projection)]) {
        let (cells, Some(sums)) = (places.iter().map(|(at, _)| self.cell(at).0), &self.sums) else {
            return;
        };
        let missing: BTreeSet<Node> = cells
            .flat_map(corners)
            .filter(|node| !sums.contains_key(node))
            .collect();
        let sum = |node: Node| {
            let middle = self.origin + Vector3::from(node.map(|k| k as f64)) * self.radius;
            // What is found must not depend on the vertex that came first.
            let known = obstacle.closest(&middle).map_or(middle, |own| own.point);
            let found =
                around(&middle, self.radius / 2.0).map(|p| obstacle.closest_from(&p, &known));
            (node, found.into_iter().flatten().map(|f| f.normal).sum())
        };
        let missing: Vec<Node> = missing.into_iter().collect();
        let new: Vec<(Node, Vector3<f64>)> = missing.into_par_iter().map(sum).collect();
        if let Some(sums) = &mut self.sums {
            sums.extend(new);
        }
    }

    /// The cell of a place, and where in it, from 0 to 1 along each axis.
    fn cell(&self, at: &Point3<f64>) -> (Node, Vector3<f64>) {
        let scaled = (at - self.origin) / self.radius;
        let low = scaled.map(f64::floor);
        (low.map(|k| k as i64).into(), scaled - low)
    }

    /// The sum at a place, linear along each axis of its cell.
    fn between(&self, sums: &HashMap<Node, Vector3<f64>>, at: &Point3<f64>) -> Vector3<f64> {
        let (cell, within) = self.cell(at);
        let mut mean = Vector3::zeros();
        for (k, node) in corners(cell).iter().enumerate() {
            let share = |axis: usize| match k >> axis & 1 {
                0 => 1.0 - within[axis],
                _ => within[axis],
            };
            let sum = sums.get(node).copied().unwrap_or_default();
            mean += sum * (share(0) * share(1) * share(2));
        }
        mean
    }

    pub fn bytes(&self) -> usize {
        let each = std::mem::size_of::<(Node, Vector3<f64>)>();
        self.sums.as_ref().map_or(0, |sums| sums.capacity() * each)
    }
}

/// The mean direction away from a surface over `radius` [m], at each of its vertices; none for 0. It is
/// zero where it would lean farther from that of the vertex than a mean may: at a thin blade, and on a
/// surface that is inside out.
#[cfg(feature = "contact")]
pub(super) fn mean_normals(surface: &Surface, radius: f64) -> Vec<Vector3<f64>> {
    if !(radius > 0.0) {
        return Vec::new();
    }
    let each = surface.positions().par_iter();
    let at: Option<Vec<_>> = each.map(|x| Some((*x, surface.closest(x)?))).collect();
    let Some(at) = at else { return Vec::new() };
    let mut means = MeanNormals::new(surface, radius).at(surface, &at);
    for (mean, (_, own)) in means.iter_mut().zip(&at) {
        if !(mean.dot(&own.normal) > MOST + ROUNDING) {
            *mean = Vector3::zeros();
        }
    }
    means
}

/// The corners of a cell; bit `a` of the number of a corner is its place along axis `a`.
fn corners(cell: Node) -> [Node; 8] {
    std::array::from_fn(|k| {
        std::array::from_fn(|axis| cell[axis].saturating_add((k >> axis & 1) as i64))
    })
}

/// The direction of `mean`, but at most as far from the direction `own` as [`MOST`] tells; `own`
/// where there is no mean.
pub(super) fn leant(own: &Vector3<f64>, mean: &Vector3<f64>) -> Vector3<f64> {
    let along = mean.dot(own);
    let across = mean - own * along;
    let Some(sideways) = Unit::try_new(across, f64::EPSILON * mean.norm()) else {
        return *own;
    };
    if along >= MOST * mean.norm() {
        return mean.normalize();
    }
    own * MOST + sideways.into_inner() * (1.0 - MOST * MOST).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriangleMesh;
    use crate::testing::Draw;

    /// Two faces along y that meet at `x = z = 0` and fall by 45 degrees to both sides, and a floor.
    fn roof() -> Surface {
        let corner = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
        let vertices = vec![
            corner(0.0, -1.0, 0.0),
            corner(0.0, 1.0, 0.0),
            corner(-1.0, -1.0, -1.0),
            corner(-1.0, 1.0, -1.0),
            corner(1.0, -1.0, -1.0),
            corner(1.0, 1.0, -1.0),
        ];
        let triangles = vec![
            [0, 1, 3],
            [0, 3, 2],
            [0, 4, 5],
            [0, 5, 1],
            [2, 3, 5],
            [2, 5, 4],
            [0, 2, 4],
            [1, 5, 3],
        ];
        Surface::new(&TriangleMesh {
            vertices,
            triangles,
        })
    }

    #[test]
    fn the_points_are_spread_evenly_along_any_line() {
        let mut draw = Draw::new(7);
        let points = around(&Point3::origin(), 2.0);
        let mean: Vector3<f64> = points.iter().map(|p| p.coords).sum();
        assert!(mean.norm() <= 1e-14);
        assert!(
            points[1..]
                .iter()
                .all(|p| (p.coords.norm() - 2.0).abs() <= 1e-14)
        );
        for _ in 0..100 {
            let along = draw.direction();
            let mut at: Vec<f64> = points.iter().map(|p| p.coords.dot(&along)).collect();
            at.sort_by(f64::total_cmp);
            let gap = at.windows(2).map(|two| two[1] - two[0]);
            // Evenly spread ones would be 0.29 apart.
            assert!(crate::mesh::measures::max_or_nan(gap) <= 1.4, "{at:?}");
        }
    }

    #[test]
    fn over_a_ridge_the_mean_turns_gradually_and_far_from_it_it_is_that_of_the_face() {
        let roof = roof();
        let face = Vector3::new(1.0, 0.0, 1.0).normalize();
        let radius = 0.1;
        // Just above the surface, from one face over the ridge to the other.
        let at = |s: f64| Point3::new(s, 0.02, 1e-4 - s.abs());
        let turn = |s: f64, radius: f64| {
            let own = roof.closest(&at(s)).expect("a surface");
            MeanNormals::new(&roof, radius).at(&roof, &[(at(s), own)])[0].x
        };
        let steps = (-300..300).map(|k| f64::from(k) * 1e-3);
        let most = |radius: f64| {
            let each = steps
                .clone()
                .map(|s| turn(s + 1e-3, radius) - turn(s, radius));
            crate::mesh::measures::max_or_nan(each.map(f64::abs))
        };
        assert!(most(radius) <= 0.25, "{}", most(radius));
        assert!(
            most(0.0) >= 0.7,
            "control: the nearest point alone turns at once"
        );
        assert!((turn(0.29, radius) - face.x).abs() <= 1e-14);
        assert!((turn(-0.29, radius) + face.x).abs() <= 1e-14);
    }

    #[test]
    fn what_is_known_of_other_places_changes_no_bit() {
        let (roof, mut draw) = (roof(), Draw::new(11));
        let place = |draw: &mut Draw| {
            let at = Point3::from(draw.direction() * draw.between(0.5, 1.5));
            (at, roof.closest(&at).expect("a surface"))
        };
        let places: Vec<_> = (0..100).map(|_| place(&mut draw)).collect();
        let mut one = MeanNormals::new(&roof, 0.3);
        let together = one.at(&roof, &places);
        assert_eq!(one.at(&roof, &places), together);
        let mut backwards = MeanNormals::new(&roof, 0.3);
        for (place, normal) in places.iter().zip(together).rev() {
            assert_eq!(backwards.at(&roof, &[*place]), [normal]);
        }
        assert_eq!(one.bytes(), backwards.bytes());
    }

    #[test]
    fn the_mean_has_length_one_and_leans_by_sixty_degrees_at_most() {
        let (roof, mut draw) = (roof(), Draw::new(3));
        for _ in 0..200 {
            let at = Point3::from(draw.direction() * draw.between(0.1, 2.0));
            let own = roof.closest(&at).expect("a surface");
            let mean = MeanNormals::new(&roof, draw.between(0.0, 3.0)).at(&roof, &[(at, own)])[0];
            assert!((mean.norm() - 1.0).abs() <= 1e-13, "{mean}");
            assert!(mean.dot(&own.normal) >= MOST - 1e-13);
        }
        let up = Vector3::z();
        assert_eq!(leant(&up, &Vector3::zeros()), up, "opposite directions");
        assert_eq!(leant(&up, &-up), up);
    }
}
