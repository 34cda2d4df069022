//! Expansion and orientation of the flow between cross-sections near a fibre.

use nalgebra::{Point3, Vector3};

use super::trace::{HalfStreamline, Tracer};

/// Size of the test triangle, in sides of a cell.
const SIZE: f64 = 1e-5;

/// Area across the fibre relative to that at the seed, at each point of one half of a streamline;
/// negative where the orientation about the fibre is reversed.
pub fn along(tracer: &Tracer<'_>, streamline: &HalfStreamline, sign: f64) -> Vec<f64> {
    areas(
        streamline,
        SIZE * tracer.field.cells.side,
        onward(tracer, streamline, sign),
    )
}

/// True if all values of [`along`] are above 0; stops at the first that is not.
pub fn keeps_order(tracer: &Tracer<'_>, streamline: &HalfStreamline, sign: f64) -> bool {
    let map = onward(tracer, streamline, sign);
    let mut area = 1.0;
    (0..streamline.advances.len()).all(|k| {
        area *= factor(streamline, k, SIZE * tracer.field.cells.side, &map);
        area > 0.0
    })
}

/// The image under the flow of a point beside point k of the streamline.
fn onward<'a>(
    tracer: &'a Tracer<'_>,
    streamline: &'a HalfStreamline,
    sign: f64,
) -> impl Fn(usize, &Point3<f64>) -> Option<Point3<f64>> + 'a {
    move |k, q| tracer.follow(q, sign, streamline.advances[k])
}

/// The areas. `map` takes points beside one point of the streamline to points beside the next
/// one. Two points at the distance `size` [m] beside each point are mapped. Where the map has no
/// value, the area is unchanged.
pub fn areas(
    streamline: &HalfStreamline,
    size: f64,
    map: impl Fn(usize, &Point3<f64>) -> Option<Point3<f64>>,
) -> Vec<f64> {
    let mut areas = vec![1.0];
    for k in 0..streamline.advances.len() {
        areas.push(areas[k] * factor(streamline, k, size, &map));
    }
    areas
}

/// Ratio of the area at point k + 1 to that at point k.
fn factor(
    streamline: &HalfStreamline,
    k: usize,
    size: f64,
    map: &impl Fn(usize, &Point3<f64>) -> Option<Point3<f64>>,
) -> f64 {
    // A new pair at each point: only the size and orientation of the previous pair matter.
    let factor = heading(streamline, k).and_then(|direction| {
        let onward = heading(streamline, k + 1).unwrap_or(direction);
        let carried = |f: Vector3<f64>| {
            Some((map(k, &(streamline.points[k] + f * size))? - streamline.points[k + 1]) / size)
        };
        let [first, second] = across(&direction).map(carried);
        Some(first?.cross(&second?).dot(&onward))
    });
    factor.unwrap_or(1.0)
}

fn heading(streamline: &HalfStreamline, k: usize) -> Option<Vector3<f64>> {
    (*streamline.points.get(k + 1)? - *streamline.points.get(k)?).try_normalize(0.0)
}

/// Two unit vectors across a direction, in right-handed order with it.
fn across(direction: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let helper = Vector3::ith(direction.iamin(), 1.0);
    let first = direction.cross(&helper).normalize();
    [first, direction.cross(&first)]
}

#[cfg(test)]
mod tests {
    use super::super::trace::Advance;
    use super::*;

    fn straight() -> HalfStreamline {
        let points = (0..6)
            .map(|k| Point3::new(f64::from(k), 0.0, 0.0))
            .collect();
        HalfStreamline {
            points,
            advances: vec![Advance::Flow; 5],
        }
    }

    #[test]
    fn a_flow_that_spreads_has_growing_areas() {
        let spread =
            |k: usize, q: &Point3<f64>| Some(Point3::new(k as f64 + 1.0, 2.0 * q.y, 3.0 * q.z));
        let found = areas(&straight(), 1e-6, spread);
        assert!(
            found
                .iter()
                .enumerate()
                .all(|(k, a)| (a / 6f64.powi(k as i32) - 1.0).abs() <= 1e-9),
            "{found:?}"
        );
    }

    #[test]
    fn a_flow_that_mirrors_is_seen() {
        let mirror = |k: usize, q: &Point3<f64>| {
            let turned = if k == 2 { -1.0 } else { 1.0 };
            Some(Point3::new(k as f64 + 1.0, turned * q.y, q.z))
        };
        let found = areas(&straight(), 1e-6, mirror);
        assert_eq!(
            found.iter().map(|a| *a > 0.0).collect::<Vec<_>>(),
            [true, true, true, false, false, false]
        );
    }

    #[test]
    fn a_flow_that_folds_into_a_plane_is_seen() {
        let folded = areas(&straight(), 1e-6, |k, q| {
            Some(Point3::new(k as f64 + 1.0, q.y, q.y))
        });
        assert!(folded.iter().skip(1).all(|a| !(*a > 0.0)), "{folded:?}");
    }
}
