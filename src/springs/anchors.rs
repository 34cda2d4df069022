//! Springs between points and fixed positions.

use nalgebra::Point3;

use super::hooke::Hooke;
use super::spring_set::{Law, PairError};
use crate::constraints::spring::{self, Anchors};

/// Creates anchors of `count` points from triples of point, fixed position [m] and spring, such as
/// the springs of rest length 0 that pull skin back. They are sorted, so that the order of the
/// input does not matter.
///
/// # Errors
/// A point out of range, or a position or a parameter that is not finite.
pub fn anchors(
    count: usize,
    anchors: impl IntoIterator<Item = (u32, Point3<f64>, Hooke)>,
) -> Result<Anchors<Hooke>, PairError> {
    let mut anchors: Vec<(u32, Point3<f64>, Hooke)> = anchors.into_iter().collect();
    for (spring, &(point, place, law)) in anchors.iter().enumerate() {
        if point as usize >= count {
            return Err(PairError::OutOfRange {
                spring,
                point,
                count,
            });
        }
        if !law.is_valid() || !place.coords.iter().all(|c| c.is_finite()) {
            return Err(PairError::Parameter { spring });
        }
    }
    let key = |&(point, place, law): &(u32, Point3<f64>, Hooke)| {
        (
            point,
            [place.x, place.y, place.z, law.rest, law.stiffness].map(|v| (v + 0.0).to_bits()),
        )
    };
    anchors.sort_by_key(key);
    Ok(spring::anchors("anchors", anchors))
}
