//! Constraints: scalar functions of a few points, zero where the constraint holds, each with its
//! analytic gradient.
//!
//! A constraint is written once, in its own file, as [`Constraint::value`] over any scalar type and
//! [`Constraint::value_and_gradient`] over `f64`. The projection is written once, in [`batch`]. The
//! energy k C^2 / 2 with its forces and second derivatives is written once, in [`quadratic`]. One
//! line in the list below adds a new constraint to the crate and to the conformance suite.

mod angle;
pub(crate) mod batch;
pub(crate) mod blocks;
pub(crate) mod enclosed_volume;
pub(crate) mod fascia;
pub(crate) mod kernel;
pub(crate) mod lanes;
pub(crate) mod order;
pub(crate) mod potential;
mod projection;
pub(crate) mod quadratic;
mod rings;
mod scalar;
pub(crate) mod second;
pub(crate) mod spring;
pub(crate) mod stencil;
#[cfg(any(test, feature = "testing"))]
mod spec;

pub(crate) mod anchor;
pub(crate) mod bending;
pub(crate) mod bond;
pub(crate) mod direction;
pub(crate) mod distance;
pub(crate) mod fibre_distance;
pub(crate) mod plane_contact;
pub(crate) mod tetrahedron_volume;
pub(crate) mod triangle_contact;

pub use bending::dihedral;
pub use spring::{Between, Spring, SpringLaw};

pub use anchor::Anchor;
pub(crate) use batch::Residual;
pub use batch::{Batch, Project, stiffness_of_part};
pub use bending::Bending;
pub use bond::Bond;
pub(crate) use direction::Direction;
pub use distance::Distance;
pub use enclosed_volume::EnclosedVolume;
pub(crate) use fibre_distance::FibreDistance;
pub(crate) use kernel::Kernel;
pub(crate) use kernel::LaneConstraint;
pub(crate) use lanes::{Lane, Several, SimdWidth};
pub use order::SweepOrder;
pub use plane_contact::PlaneContact;
pub use potential::Potential;
pub use quadratic::Quadratic;
pub use scalar::Scalar;
#[cfg(any(test, feature = "testing"))]
pub use spec::{ForEachKind, Parameter, Spec};
pub use stencil::{Stencil, Stencils};
pub use tetrahedron_volume::TetrahedronVolume;
pub use triangle_contact::TriangleContact;

use nalgebra::{Point3, Vector3};

/// A scalar function C(x) of `K` points, zero where the constraint holds.
///
/// The points, the value and the gradient are all that a new constraint must define. [`Batch`]
/// projects it and [`Quadratic`] uses its square as an energy:
///
/// ```
/// use nalgebra::{Point3, Vector3};
/// use pliant::constraints::{Batch, Constraint, SweepOrder, Project, Scalar};
/// use pliant::Particles;
///
/// /// Height of a particle over the ground [m].
/// #[derive(Clone, Copy)]
/// struct Height(u32);
///
/// impl Constraint<1> for Height {
///     fn points(&self) -> [u32; 1] {
///         [self.0]
///     }
///     fn value<S: Scalar>(&self, x: &[Point3<S>; 1]) -> S {
///         x[0].z
///     }
///     fn value_and_gradient(&self, x: &[Point3<f64>; 1]) -> Option<(f64, [Vector3<f64>; 1])> {
///         Some((x[0].z, [Vector3::z()]))
///     }
/// }
///
/// let mut particles = Particles::at_rest(vec![Point3::new(1.0, 2.0, 3.0)], vec![1.0]);
/// let mut batch = Batch::new(vec![Height(0)], vec![0.0], SweepOrder::Stored, 1, &[]);
/// batch.project(&mut particles, 0.01);
/// assert_eq!(particles.position[0], Point3::new(1.0, 2.0, 0.0));
/// ```
pub trait Constraint<const K: usize>: Copy + Send + Sync + 'static {
    /// Name of the effect in messages, times and measures, as in `docs/notation.md`.
    const NAME: &'static str = "constraint";

    /// The particles it acts on.
    fn points(&self) -> [u32; K];

    /// C(x) for any scalar type.
    fn value<S: Scalar>(&self, x: &[Point3<S>; K]) -> S;

    /// C(x) and dC/dx_i; `None` where the gradient is undefined (each constraint says where).
    fn value_and_gradient(&self, x: &[Point3<f64>; K]) -> Option<(f64, [Vector3<f64>; K])>;

    /// The functions that batches and energies evaluate it with: one by one, unless the constraint
    /// has a form in lanes ([`LaneConstraint`]) or a branch ([`Periodic`]).
    fn kernel() -> Kernel<Self, K> {
        Kernel::one_by_one()
    }
}

/// Names the kinds of constraints and calls a visitor for each kind. A new constraint needs an
/// entry in this one list.
macro_rules! constraints {
    ($($module:ident::$kind:ident<$points:literal>),* $(,)?) => {
        /// Names of all constraints with a fixed number of points.
        pub const KINDS: &[&str] = &[$(<$kind as Constraint<$points>>::NAME),*];

        /// Calls `visitor` once for each kind of constraint.
        #[cfg(any(test, feature = "testing"))]
        pub fn for_each_kind(visitor: &mut impl ForEachKind) {
            $(visitor.visit::<$module::$kind, $points>();)*
        }
    };
}

constraints! {
    distance::Distance<2>,
    fibre_distance::FibreDistance<2>,
    direction::Direction<2>,
    bending::Bending<4>,
    tetrahedron_volume::TetrahedronVolume<4>,
    anchor::Anchor<1>,
    plane_contact::PlaneContact<1>,
    triangle_contact::TriangleContact<3>,
    bond::Bond<4>,
}

/// Length of `v` without underflow or overflow; zero only for the zero vector.
pub(crate) fn safe_norm(v: &Vector3<f64>) -> f64 {
    let squared = v.norm_squared();
    // Squares of components beyond these bounds lose digits or overflow. A NaN passes through,
    // because `amax` below would ignore it.
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
