//! Angular springs: from a point to the midpoint of two opposite neighbours \[nedel1998\].

use super::hooke::Hooke;
use super::spring_set::{Law, PairError};
use crate::constraints::Stencils;
use crate::constraints::spring::{Spring, ToMiddle};

/// A spring between a point and the midpoint of two others; it resists changes of a surface's
/// curvature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AngularSpring {
    /// The point, and its two opposite neighbours.
    pub points: [u32; 3],
    /// Law of the distance to the midpoint.
    pub law: Hooke,
}

/// Angular springs.
pub type AngularSprings = Stencils<Spring<ToMiddle, Hooke>, 3>;

/// Creates angular springs between `count` points.
///
/// # Errors
/// A point out of range or twice in a spring, a parameter that is not finite, or a negative
/// rest length.
pub fn angular_springs(
    count: usize,
    springs: impl IntoIterator<Item = AngularSpring>,
) -> Result<AngularSprings, PairError> {
    let mut springs: Vec<AngularSpring> = springs.into_iter().collect();
    for (spring, s) in springs.iter_mut().enumerate() {
        let [a, b, c] = s.points;
        s.points = [a, b.min(c), b.max(c)];
        if let Some(&point) = s.points.iter().find(|&&p| p as usize >= count) {
            return Err(PairError::OutOfRange {
                spring,
                point,
                count,
            });
        }
        if a == b || a == c || b == c {
            return Err(PairError::Loop {
                spring,
                point: if a == b { a } else { c },
            });
        }
        if !s.law.is_valid() {
            return Err(PairError::Parameter { spring });
        }
    }
    springs.sort_by(|s, t| {
        let key = |s: &AngularSpring| [s.law.rest, s.law.stiffness].map(|v| (v + 0.0).to_bits());
        s.points.cmp(&t.points).then_with(|| key(s).cmp(&key(t)))
    });
    let spring = |AngularSpring { points, law }| Spring {
        arm: ToMiddle(points),
        law,
    };
    Ok(Stencils::new(
        "angular springs",
        springs.into_iter().map(spring).collect(),
    ))
}
