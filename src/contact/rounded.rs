//! Bones as a body feels them that cannot bend more sharply than its own edges.
//!
//! The direction from the nearest point turns at a ridge within less than a contact thickness, and jumps
//! where two points are equally near. A vertex slips there, or is thrown, within one frame. The mean
//! direction over a ball turns gradually while the vertex moves by the radius of the ball.

use nalgebra::{Point3, Unit, Vector3};

use super::{Obstacle, Projection};

/// Cosine of the greatest angle between the mean direction and that from the nearest point. A plane
/// that is steeper to the surface lets the vertex sink while it slides.
const MOST: f64 = 0.5;

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

/// The mean direction away from an obstacle within `radius` [m] of a point whose nearest point is
/// `own`. An obstacle without edges has that of `own`.
pub(super) fn mean_normal(
    obstacle: &dyn Obstacle,
    at: &Point3<f64>,
    own: &Projection,
    radius: f64,
) -> Vector3<f64> {
    if obstacle.contact_samples().is_empty() {
        return own.normal;
    }
    let others = around(at, radius).into_iter().skip(1);
    let normals = others.filter_map(|p| Some(obstacle.closest_from(&p, &own.point)?.normal));
    leant(&own.normal, &(own.normal + normals.sum::<Vector3<f64>>()))
}

/// The direction of `mean`, but at most as far from the direction `own` as [`MOST`] tells.
fn leant(own: &Vector3<f64>, mean: &Vector3<f64>) -> Vector3<f64> {
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
    use crate::contact::Surface;
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
            mean_normal(&roof, &at(s), &own, radius).x
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
    fn the_mean_has_length_one_and_leans_by_sixty_degrees_at_most() {
        let (roof, mut draw) = (roof(), Draw::new(3));
        for _ in 0..200 {
            let at = Point3::from(draw.direction() * draw.between(0.1, 2.0));
            let own = roof.closest(&at).expect("a surface");
            let mean = mean_normal(&roof, &at, &own, draw.between(0.0, 3.0));
            assert!((mean.norm() - 1.0).abs() <= 1e-13, "{mean}");
            assert!(mean.dot(&own.normal) >= MOST - 1e-13);
        }
        let up = Vector3::z();
        assert_eq!(leant(&up, &Vector3::zeros()), up, "opposite directions");
        assert_eq!(leant(&up, &-up), up);
    }
}
