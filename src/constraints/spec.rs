//! Properties of a constraint, beside its value and gradient, that the conformance suite needs.

use super::Constraint;

/// Meaning of a parameter of a constraint: how the conformance suite draws, moves and scales it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// A length [m]; scales with the shape.
    Length,
    /// A length [m] inside C that is not its rest value; scales with the shape.
    Height,
    /// An angle [rad]; unchanged by scaling.
    Angle,
    /// A volume [m^3].
    Volume,
    /// One coordinate of a point in space [m] (0, 1, 2); moves with the shape.
    Coordinate(usize),
    /// One component of a unit direction (0, 1, 2).
    Direction(usize),
    /// A barycentric weight; the suite draws them to sum to 1.
    Weight,
}

/// A constraint that the conformance suite can draw, move and scale.
pub trait Spec<const K: usize>: Constraint<K> {
    /// Degree of homogeneity: C(s x) = s^DEGREE C(x) when the parameters scale with the shape.
    const DEGREE: i32;
    /// Meaning of each parameter of [`Self::from_parameters`].
    const PARAMETERS: &'static [Parameter];

    /// A constraint on the particles `points` with parameters as listed in [`Self::PARAMETERS`].
    fn from_parameters(points: [u32; K], parameters: &[f64]) -> Self;
}

/// A task that runs once for each kind of constraint.
pub trait ForEachKind {
    /// Called once for each kind.
    fn visit<C: Spec<K>, const K: usize>(&mut self);
}
