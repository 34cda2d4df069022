//! Evaluation of one kind of constraint in sweeps and energies: one by one or in lanes, with or
//! without a branch.

use nalgebra::{Point3, Vector3};

use super::Constraint;
use super::lanes::{Lane, Several, SimdWidth, unrolled};
use super::projection::{self, Span, Sweep};
use super::quadratic::{self, Forces};
use super::stencil::Blocks;

/// Greatest count of numbers of a constraint that its form in lanes reads.
pub const MOST_NUMBERS: usize = 3;

/// A constraint that can be evaluated in several lanes at once.
pub trait LaneConstraint<const K: usize>: Constraint<K> {
    /// Whether the gradient at each point has length one wherever it is defined. A projection then
    /// need not compute the length.
    const UNIT: bool = false;

    /// How many of [`Self::numbers`] the form in lanes reads. Batches store them side by side.
    const NUMBERS: usize;

    /// The numbers of the constraint beside its points. The first one of a [`Periodic`] constraint is its
    /// branch.
    fn numbers(&self) -> [f64; MOST_NUMBERS];

    /// C(x) and dC/dx_i of several constraints, one per lane, from their numbers. In the lanes of `usual`,
    /// the bits equal those of [`Constraint::value_and_gradient`].
    fn in_lanes<N: Lane>(
        machine: N::Machine,
        numbers: [N; MOST_NUMBERS],
        x: &[[N; 3]; K],
    ) -> Several<N, K>;
}

/// A constraint whose value is known up to a period. It stores a number of its last visit, and the value
/// nearest to it counts.
pub trait Periodic<const K: usize>: Constraint<K> {
    /// The number of the last visit. It is the whole state, because points and parameters never change.
    fn branch(&self) -> f64;

    /// Stores the number of a visit.
    fn set_branch(&mut self, branch: f64);

    /// The number of a visit at which C is `value`.
    fn branch_of(&self, value: f64) -> f64;
}

/// The numbers of one constraint, each in every lane of `these`.
#[inline(always)]
pub(crate) fn numbers_of<C: LaneConstraint<K>, N: Lane, const K: usize>(
    machine: N::Machine,
    these: &[C],
) -> [N; MOST_NUMBERS] {
    let mut numbers = [N::splat(machine, 0.0); MOST_NUMBERS];
    unrolled!(k in MOST_NUMBERS => {
        if k < C::NUMBERS {
            numbers[k] = N::each(machine, |l| these[l].numbers()[k]);
        }
    });
    numbers
}

/// Properties of a kind of constraint that the loops of sweeps and energies need at compile time.
pub(crate) trait Mode<C, const K: usize> {
    /// See [`LaneConstraint::UNIT`].
    const UNIT: bool;
    /// Whether each constraint stores its branch.
    const PERIODIC: bool;
    /// Sets the branch of a constraint that has one.
    fn set(constraint: &mut C, branch: f64);
    /// The branch that belongs to a value of C.
    fn branch(constraint: &C, value: f64) -> f64;
}

/// One by one, without a branch.
pub(crate) struct Plain;
/// In lanes, without a branch.
pub(crate) struct Lanes;
/// One by one, with a branch.
pub(crate) struct OnBranch;
/// In lanes, with a branch.
pub(crate) struct LanesOnBranch;

impl<C: Constraint<K>, const K: usize> Mode<C, K> for Plain {
    const UNIT: bool = false;
    const PERIODIC: bool = false;
    #[inline(always)]
    fn set(_: &mut C, _: f64) {}
    #[inline(always)]
    fn branch(_: &C, value: f64) -> f64 {
        value
    }
}

impl<C: LaneConstraint<K>, const K: usize> Mode<C, K> for Lanes {
    const UNIT: bool = C::UNIT;
    const PERIODIC: bool = false;
    #[inline(always)]
    fn set(_: &mut C, _: f64) {}
    #[inline(always)]
    fn branch(_: &C, value: f64) -> f64 {
        value
    }
}

impl<C: Periodic<K>, const K: usize> Mode<C, K> for OnBranch {
    const UNIT: bool = false;
    const PERIODIC: bool = true;
    #[inline(always)]
    fn set(constraint: &mut C, branch: f64) {
        constraint.set_branch(branch);
    }
    #[inline(always)]
    fn branch(constraint: &C, value: f64) -> f64 {
        constraint.branch_of(value)
    }
}

impl<C: Periodic<K> + LaneConstraint<K>, const K: usize> Mode<C, K> for LanesOnBranch {
    const UNIT: bool = C::UNIT;
    const PERIODIC: bool = true;
    #[inline(always)]
    fn set(constraint: &mut C, branch: f64) {
        constraint.set_branch(branch);
    }
    #[inline(always)]
    fn branch(constraint: &C, value: f64) -> f64 {
        constraint.branch_of(value)
    }
}

/// Reads and stores the branch of a constraint.
#[derive(Clone, Copy)]
pub(crate) struct Branch<C> {
    pub get: fn(&C) -> f64,
    pub set: fn(&mut C, f64),
    /// The branch of a value of C.
    pub of: fn(&C, f64) -> f64,
}

/// The numbers of a constraint that batches store side by side, and how many there are.
#[derive(Clone, Copy)]
pub(crate) struct Numbers<C> {
    pub count: usize,
    pub of: fn(&C) -> [f64; MOST_NUMBERS],
}

/// A sweep over the spans of a block.
pub(crate) type SweepBlock<C, const K: usize> = fn(&mut Sweep<'_, C, K>, &[Span], SimdWidth);

/// The second derivative [N/m] of k C^2 / 2 for a stiffness k. With `true`, its nearest positive
/// semi-definite part.
pub type Hessian<C, const K: usize> = fn(&C, &[Point3<f64>; K], f64, bool) -> Option<Blocks<K>>;

/// The functions with which batches and energies evaluate constraints of one kind.
/// [`Constraint::kernel`] chooses them.
///
/// The choice changes the speed and, for a periodic constraint, the branch of C. It changes no
/// other bit of a result.
#[derive(Clone, Copy)]
pub struct Kernel<C, const K: usize> {
    pub(crate) sweep: SweepBlock<C, K>,
    pub(crate) forces: fn(Forces<'_, C, K>),
    pub(crate) hessian: Hessian<C, K>,
    pub(crate) branch: Option<Branch<C>>,
    pub(crate) numbers: Option<Numbers<C>>,
    pub(crate) shorten: Option<fn(&mut C, f64)>,
    pub(crate) turn: Option<fn(&mut C, &Vector3<f64>)>,
    unit: bool,
}

impl<C: Constraint<K>, const K: usize> Kernel<C, K> {
    /// One constraint after the other.
    pub fn one_by_one() -> Self {
        Self {
            sweep: projection::one_by_one::<C, Plain, K>,
            forces: quadratic::one_by_one,
            hessian: quadratic::hessian,
            branch: None,
            numbers: None,
            shorten: None,
            turn: None,
            unit: false,
        }
    }

    /// As many constraints at once as the register of the processor has lanes.
    pub fn in_lanes() -> Self
    where
        C: LaneConstraint<K>,
    {
        Self {
            sweep: projection::in_lanes::<C, Lanes, K>,
            forces: quadratic::in_lanes,
            numbers: Some(Numbers {
                count: C::NUMBERS,
                of: C::numbers,
            }),
            unit: C::UNIT,
            ..Self::one_by_one()
        }
    }

    /// One constraint after the other, each on its branch.
    pub fn periodic() -> Self
    where
        C: Periodic<K>,
    {
        Self {
            sweep: projection::one_by_one::<C, OnBranch, K>,
            branch: Some(Branch {
                get: C::branch,
                set: C::set_branch,
                of: C::branch_of,
            }),
            numbers: Some(Numbers {
                count: 1,
                of: |c| [c.branch(), 0.0, 0.0],
            }),
            ..Self::one_by_one()
        }
    }

    /// As many constraints at once as the register of the processor has lanes, each on its branch.
    pub fn periodic_in_lanes() -> Self
    where
        C: Periodic<K> + LaneConstraint<K>,
    {
        Self {
            sweep: projection::in_lanes::<C, LanesOnBranch, K>,
            branch: Self::periodic().branch,
            ..Self::in_lanes()
        }
    }

    /// Uses an explicit second derivative of the energy instead of the one computed from the value.
    #[must_use]
    pub fn with_hessian(self, hessian: Hessian<C, K>) -> Self {
        Self { hessian, ..self }
    }

    /// Changes a rest value with the shortening of fibres, relative to their length.
    #[must_use]
    pub fn with_shortening(self, shorten: fn(&mut C, f64)) -> Self {
        let shorten = Some(shorten);
        Self { shorten, ..self }
    }

    /// Changes the direction along which it keeps an edge.
    #[must_use]
    pub fn with_turning(self, turn: fn(&mut C, &Vector3<f64>)) -> Self {
        let turn = Some(turn);
        Self { turn, ..self }
    }

    /// Whether gradients are assumed to have length one; see [`LaneConstraint::UNIT`].
    pub fn has_unit_gradients(&self) -> bool {
        self.unit
    }
}
