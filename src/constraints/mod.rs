//! Constraints: scalar functions of a few points, zero where they hold, each with its analytic gradient.
//!
//! A constraint is written once, in its own file, as [`Constraint::value`] over any number and
//! [`Constraint::value_and_gradient`] over `f64`. The projection is written once, in [`batch`]. One line in the list
//! below makes a new constraint part of the crate and of the conformance suite.

mod angle;
pub mod batch;
pub mod blocks;
pub mod enclosed_volume;
pub mod lanes;
pub mod order;
mod projection;
mod rings;
mod scalar;
pub mod second;

pub use batch::{Batch, Project, Residual};
pub use enclosed_volume::EnclosedVolume;
pub use lanes::{Lane, Several, SimdWidth};
pub use order::Order;
pub use scalar::Scalar;

use nalgebra::{Point3, Vector3};

/// What a parameter of a constraint means: how the conformance suite draws, moves and scales it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// A length [m], scales with the shape.
    Length,
    /// An angle [rad], unchanged by scaling.
    Angle,
    /// A volume [m^3].
    Volume,
    /// One coordinate of a point in space [m] (0, 1, 2): moves with the shape.
    Coordinate(usize),
    /// One component of a unit direction (0, 1, 2).
    Direction(usize),
    /// A barycentric weight; the suite draws them to sum to 1.
    Weight,
}

/// A scalar function C(x) of `K` points, zero where the constraint holds.
pub trait Constraint<const K: usize>: Copy + Send + Sync + 'static {
    /// Name, as in `docs/notation.md`.
    const NAME: &'static str;
    /// Degree of homogeneity: C(s x) = s^DEGREE C(x) when the parameters scale with the shape.
    const DEGREE: i32;
    /// What `from_parameters` takes.
    const PARAMETERS: &'static [Parameter];

    /// A constraint on the particles `points` with parameters as listed in [`Self::PARAMETERS`].
    fn from_parameters(points: [u32; K], parameters: &[f64]) -> Self;

    /// The particles it acts on.
    fn points(&self) -> [u32; K];

    /// Called with C at each projection; only a constraint whose value is known up to a period has a memory.
    #[inline]
    fn remember(&mut self, _value: f64) {}

    /// What [`Self::remember`] noted last: the state of a constraint, as its points and parameters never change.
    #[inline]
    fn memory(&self) -> f64 {
        0.0
    }

    /// Whether C is known up to a period only: to be set with [`Self::remember`], which energies call only then,
    /// and with [`Self::memory`].
    const PERIODIC: bool = false;

    /// Whether the gradient at each point has length one wherever it is defined: a projection then need not measure it.
    const UNIT: bool = false;

    /// C(x), in any number.
    fn value<S: Scalar>(&self, x: &[Point3<S>; K]) -> S;

    /// C(x) and dC/dx_i; `None` where the gradient is undefined (each constraint says where).
    fn value_and_gradient(&self, x: &[Point3<f64>; K]) -> Option<(f64, [Vector3<f64>; K])>;

    /// Whether [`Self::in_lanes`] is written: a constraint may do without.
    const LANES: bool = false;

    /// C(x) and dC/dx_i of several constraints, one a lane, with the bits of [`Self::value_and_gradient`] wherever
    /// `usual` says so.
    #[inline(always)]
    fn in_lanes<N: Lane>(_these: &[Self], _machine: N::Machine, _x: &[[N; 3]; K]) -> Several<N, K> {
        unreachable!("{} says that it has no form in lanes", Self::NAME)
    }
}

/// Declares the constraints, and calls a macro on each: the one list that a new constraint must join.
macro_rules! constraints {
    ($($module:ident::$kind:ident<$points:literal>),* $(,)?) => {
        $(pub mod $module; pub use $module::$kind;)*

        /// Names of all constraints with a fixed number of points.
        pub const KINDS: &[&str] = &[$(<$kind as Constraint<$points>>::NAME),*];

        /// Something to be done for each kind of constraint.
        pub trait ForEachKind {
            /// Called once for each kind.
            fn visit<C: Constraint<K>, const K: usize>(&mut self);
        }

        /// Calls `visitor` once for each kind of constraint.
        pub fn for_each_kind(visitor: &mut impl ForEachKind) {
            $(visitor.visit::<$kind, $points>();)*
        }
    };
}

constraints! {
    distance::Distance<2>,
    bending::Bending<4>,
    tetrahedron_volume::TetrahedronVolume<4>,
    anchor::Anchor<1>,
    plane_contact::PlaneContact<1>,
    triangle_contact::TriangleContact<3>,
}

/// Length of `v` without underflow or overflow; zero only for the zero vector.
pub(crate) fn safe_norm(v: &Vector3<f64>) -> f64 {
    let squared = v.norm_squared();
    // Squares of components beyond these bounds lose digits or overflow.
    // A NaN passes through: `amax` below would lose it.
    if !(squared <= 1e-280 || squared >= 1e280) {
        return squared.sqrt();
    }
    let largest = v.amax();
    if largest == 0.0 || !largest.is_finite() {
        largest
    } else {
        (v / largest).norm() * largest
    }
}
