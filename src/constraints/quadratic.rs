//! The energy k C^2 / 2 of constraints, with its first two derivatives.

use nalgebra::{Matrix3, Point3, Vector3};

use super::batch::{restore_branches, save_branches, shorten};
use super::kernel::numbers_of;
use super::lanes::{self, InLanes, Lane, Several, SimdWidth, unrolled};
use super::potential::{Memory, Potential, positive_part};
use super::second::Second;
use super::stencil::{self, Blocks, Stencil};
use super::{Constraint, LaneConstraint};
use crate::mesh::measures::max_or_nan;
use crate::mesh::sum::NeumaierSum;
use crate::particles::Slot;
use crate::state::{DecodeError, Reader, State, Writer};

/// The energy k C^2 / 2 of constraints of one kind, with k the stiffness of each [J per unit of C
/// squared].
#[derive(Clone, Debug)]
pub struct Quadratic<C, const K: usize> {
    constraints: Vec<C>,
    stiffness: Vec<f64>,
}

impl<C: Constraint<K>, const K: usize> Quadratic<C, K> {
    /// Constraints with one stiffness each.
    ///
    /// # Panics
    /// If the number of stiffnesses differs from the number of constraints.
    pub fn new(constraints: Vec<C>, stiffness: Vec<f64>) -> Self {
        assert_eq!(
            constraints.len(),
            stiffness.len(),
            "one stiffness for each constraint"
        );
        Self {
            constraints,
            stiffness,
        }
    }

    fn terms(&self) -> impl ExactSizeIterator<Item = Squared<C>> {
        let each = self.constraints.iter().zip(&self.stiffness);
        each.map(|(&constraint, &stiffness)| Squared {
            constraint,
            stiffness,
        })
    }
}

/// The energy k C^2 / 2 of one constraint.
#[derive(Clone, Copy, Debug)]
pub struct Squared<C> {
    /// The constraint.
    pub constraint: C,
    /// Stiffness k [J per unit of C squared].
    pub stiffness: f64,
}

/// Where the gradient is undefined, an edge or hinge without extent exerts no force.
impl<C: Constraint<K>, const K: usize> Stencil<K> for Squared<C> {
    #[inline]
    fn points(&self) -> [u32; K] {
        self.constraint.points()
    }

    #[inline]
    fn energy_and_gradient(&self, x: &[Point3<f64>; K]) -> Option<(f64, [Vector3<f64>; K])> {
        let (value, gradient) = self.constraint.value_and_gradient(x)?;
        let force = self.stiffness * value;
        Some((0.5 * force * value, gradient.map(|g| g * force)))
    }

    fn hessian(&self, x: &[Point3<f64>; K], convex: bool) -> Option<Blocks<K>> {
        (C::kernel().hessian)(&self.constraint, x, self.stiffness, convex)
    }

    /// The trace of each block k g_i g_j^T. The result is a Gram matrix, therefore positive
    /// semi-definite.
    fn scalar_hessian(&self, x: &[Point3<f64>; K]) -> Option<[[f64; K]; K]> {
        let (_, g) = self.constraint.value_and_gradient(x)?;
        Some(std::array::from_fn(|i| {
            std::array::from_fn(|j| self.stiffness * g[i].dot(&g[j]))
        }))
    }

    /// The force at which C has changed as much as by a strain of one.
    fn force_scale(&self, x: &[Point3<f64>; K]) -> f64 {
        let Some((_, g)) = self.constraint.value_and_gradient(x) else {
            return 0.0;
        };
        let longest = max_or_nan(x.iter().map(|p| (p - x[0]).norm_squared()));
        self.stiffness * g[0].norm_squared() * longest.sqrt()
    }
}

/// The second derivative of k C^2 / 2 computed from the constraint's value; see [`Second`].
pub(crate) fn hessian<C: Constraint<K>, const K: usize>(
    constraint: &C,
    x: &[Point3<f64>; K],
    stiffness: f64,
    convex: bool,
) -> Option<Blocks<K>> {
    constraint.value_and_gradient(x)?;
    let c = constraint.value(&Second::variables(x));
    let block = |i: usize, j: usize| {
        (c.gradient[i] * c.gradient[j].transpose() + c.hessian[i][j] * c.value) * stiffness
    };
    let blocks = std::array::from_fn(|i| std::array::from_fn(|j| block(i, j)));
    // A spring that is at rest or stretched has no negative curvature, nor has any constraint that
    // holds.
    if convex && c.value != 0.0 {
        Some(positive_part(&blocks))
    } else {
        Some(blocks)
    }
}

impl<C: Constraint<K>, const K: usize> State for Quadratic<C, K> {
    fn save(&self, to: &mut Writer) {
        let Self {
            constraints,
            stiffness: _,
        } = self;
        save_branches(constraints, to);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        restore_branches(&mut self.constraints, from)
    }
}

impl<C: Constraint<K>, const K: usize> Potential for Quadratic<C, K> {
    fn name(&self) -> &'static str {
        C::NAME
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        stencil::energy(self.terms(), x)
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        let slots: Vec<Slot> = x.iter().map(|x| Slot([x.x, x.y, x.z, 0.0])).collect();
        let forces = Forces {
            of: self,
            x,
            slots: &slots,
            gradient,
            sum: &mut sum,
        };
        (C::kernel().forces)(forces);
        sum.total()
    }

    fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        stencil::pairs(self.terms(), pair);
    }

    fn hessian(
        &self,
        x: &[Point3<f64>],
        convex: bool,
        add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
    ) {
        stencil::hessian(self.terms(), x, convex, add);
    }

    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        stencil::scalar_hessian(self.terms(), x, add);
    }

    fn force_scale(&self, x: &[Point3<f64>]) -> f64 {
        stencil::force_scale(self.terms(), x)
    }

    fn shorten(&mut self, shortening: f64) {
        shorten(&mut self.constraints, shortening);
    }

    fn turn(&mut self, along: &[Vector3<f64>]) {
        if let Some(turn) = C::kernel().turn {
            for (i, c) in self.constraints.iter_mut().enumerate() {
                turn(c, along.get(i).unwrap_or(&Vector3::zeros()));
            }
        }
    }

    fn memory(&self) -> Option<&dyn Memory> {
        C::kernel().branch.map(|_| self as &dyn Memory)
    }

    fn memory_mut(&mut self) -> Option<&mut dyn Memory> {
        C::kernel().branch.map(|_| self as &mut dyn Memory)
    }
}

impl<C: Constraint<K>, const K: usize> Memory for Quadratic<C, K> {
    fn remember(&mut self, x: &[Point3<f64>]) {
        let Some(branch) = C::kernel().branch else {
            return;
        };
        for constraint in &mut self.constraints {
            let at = constraint.points().map(|p| x[p as usize]);
            if let Some((c, _)) = constraint.value_and_gradient(&at) {
                let now = (branch.of)(constraint, c);
                (branch.set)(constraint, now);
            }
        }
    }
}

/// Energy and forces. They are added in the order of the constraints, for any number of lanes.
pub(crate) struct Forces<'a, C, const K: usize> {
    of: &'a Quadratic<C, K>,
    x: &'a [Point3<f64>],
    slots: &'a [Slot],
    gradient: &'a mut [Vector3<f64>],
    sum: &'a mut NeumaierSum,
}

impl<C: Constraint<K>, const K: usize> Forces<'_, C, K> {
    #[inline(always)]
    fn add(&mut self, j: usize, value: f64, gradient: &[[f64; 3]; K]) {
        let force = self.of.stiffness[j] * value;
        self.sum.add(0.5 * force * value);
        for (p, g) in self.of.constraints[j].points().into_iter().zip(gradient) {
            self.gradient[p as usize] += Vector3::from(*g) * force;
        }
    }

    /// Where the gradient is undefined, an edge or hinge without extent exerts no force.
    fn alone(&mut self, j: usize) {
        let constraint = &self.of.constraints[j];
        let at = constraint.points().map(|p| self.x[p as usize]);
        if let Some((value, gradient)) = constraint.value_and_gradient(&at) {
            self.add(j, value, &gradient.map(Into::into));
        }
    }
}

impl<C: LaneConstraint<K>, const K: usize> Forces<'_, C, K> {
    #[inline(always)]
    fn side_by_side<N: Lane>(&mut self, machine: N::Machine, j: usize) {
        let these = &self.of.constraints[j..j + N::COUNT];
        // No closures: a function called from a closure would not be compiled for the lanes.
        let mut at = [[N::splat(machine, 0.0); 3]; K];
        unrolled!(k in K => {
            let [x, y, z, _] = N::gather(machine, self.slots, |l| these[l].points()[k]);
            at[k] = [x, y, z];
        });
        let Several {
            value,
            gradient,
            usual,
            ..
        } = C::in_lanes::<N>(machine, numbers_of(machine, these), &at);
        if !N::all(usual) {
            return (j..j + N::COUNT).for_each(|j| self.alone(j));
        }
        let (mut values, mut columns) = ([0.0; 8], [[[0.0; 8]; 3]; K]);
        value.store(&mut values);
        unrolled!(k in K => {
            gradient[k][0].store(&mut columns[k][0]);
            gradient[k][1].store(&mut columns[k][1]);
            gradient[k][2].store(&mut columns[k][2]);
        });
        for l in 0..N::COUNT {
            let mut gradient = [[0.0; 3]; K];
            for k in 0..K {
                gradient[k] = [columns[k][0][l], columns[k][1][l], columns[k][2][l]];
            }
            self.add(j + l, values[l], &gradient);
        }
    }
}

impl<C: LaneConstraint<K>, const K: usize> InLanes for Forces<'_, C, K> {
    #[inline(always)]
    fn run<N: Lane>(mut self, machine: N::Machine) {
        let (count, mut next) = (self.of.constraints.len(), 0);
        if N::COUNT > 1 {
            while next + N::COUNT <= count {
                self.side_by_side::<N>(machine, next);
                next += N::COUNT;
            }
        }
        (next..count).for_each(|j| self.alone(j));
    }
}

/// Adds the energy and forces of one constraint after the other.
pub(crate) fn one_by_one<C: Constraint<K>, const K: usize>(mut forces: Forces<'_, C, K>) {
    (0..forces.of.constraints.len()).for_each(|j| forces.alone(j));
}

/// Adds the energy and forces of as many constraints at once as the register of the processor has
/// lanes.
pub(crate) fn in_lanes<C: LaneConstraint<K>, const K: usize>(forces: Forces<'_, C, K>) {
    lanes::run(SimdWidth::best(), forces);
}
