//! Elastic energy: half the stiffness times the square of each constraint, with its first two derivatives.

use nalgebra::{DMatrix, Matrix3, Point3, Vector3};

use crate::constraints::batch::{restore_memory, save_memory};
use crate::constraints::lanes::{self, InLanes, Lane, Several, SimdWidth, unrolled};
use crate::constraints::second::Second;
use crate::constraints::{Constraint, EnclosedVolume};
use crate::mesh::measures::max_or_nan;
use crate::mesh::sum::NeumaierSum;
use crate::particles::Slot;
use crate::state::{DecodeError, Reader, State, Writer};

/// A part of a body's energy. Its state goes into checkpoints.
pub trait Potential: State + Send + Sync {
    /// The effect's name.
    fn name(&self) -> &'static str;
    /// Energy [J] at positions `x` [m].
    fn energy(&self, x: &[Point3<f64>]) -> f64;
    /// Energy [J]; adds its gradient [N] to `gradient`, one entry a vertex.
    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64;
    /// Calls `pair` with every two vertices between which the second derivative may differ from zero.
    fn pairs(&self, pair: &mut dyn FnMut(u32, u32));
    /// Calls `add` with the blocks of the second derivative [N/m], by row and column; with `convex`, of its nearest
    /// positive semi-definite part, constraint by constraint.
    fn hessian(
        &self,
        x: &[Point3<f64>],
        convex: bool,
        add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
    );
    /// Calls `add` with entries [N/m] of a positive semi-definite matrix over vertices that stands for the second
    /// derivative at `x` in every direction of space.
    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64));
    /// Greatest force [N] that a unit of strain or angle gives, a scale to judge forces by.
    fn force_scale(&self, x: &[Point3<f64>]) -> f64;
    /// Lets constraints whose value is known up to a period take note of where they are.
    fn remember(&mut self, x: &[Point3<f64>]);
    /// Takes note of the shape that the body is to track [m], one place a vertex; most parts track none.
    fn aim(&mut self, _target: &[Point3<f64>]) {}
    /// Heap memory held [bytes].
    fn bytes(&self) -> usize;
}

/// The energy k C^2 / 2 of constraints of one kind, k the stiffness of each [J per unit of C squared].
#[derive(Clone, Debug)]
pub struct Quadratic<C, const K: usize> {
    constraints: Vec<C>,
    stiffness: Vec<f64>,
}

impl<C: Constraint<K>, const K: usize> Quadratic<C, K> {
    /// Constraints with a stiffness each.
    ///
    /// # Panics
    /// If the number of stiffnesses differs from that of constraints.
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

    fn each(&self) -> impl Iterator<Item = (&C, f64)> {
        self.constraints.iter().zip(self.stiffness.iter().copied())
    }
}

impl<C: Constraint<K>, const K: usize> State for Quadratic<C, K> {
    fn save(&self, to: &mut Writer) {
        let Self {
            constraints,
            stiffness: _,
        } = self;
        save_memory(constraints, to);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        restore_memory(&mut self.constraints, from)
    }
}

impl<C: Constraint<K>, const K: usize> Potential for Quadratic<C, K> {
    fn name(&self) -> &'static str {
        C::NAME
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        for (constraint, k) in self.each() {
            let at = constraint.points().map(|p| x[p as usize]);
            // Where the gradient is undefined so is the value: an edge or hinge without extent exerts no force.
            if let Some((c, _)) = constraint.value_and_gradient(&at) {
                sum.add(0.5 * k * c * c);
            }
        }
        sum.total()
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
        lanes::run(
            if C::LANES {
                SimdWidth::best()
            } else {
                SimdWidth::One
            },
            forces,
        );
        sum.total()
    }

    fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        for constraint in &self.constraints {
            let points = constraint.points();
            for i in 0..K {
                points[..i].iter().for_each(|&q| pair(points[i], q));
            }
        }
    }

    fn hessian(
        &self,
        x: &[Point3<f64>],
        convex: bool,
        add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
    ) {
        for (constraint, k) in self.each() {
            let points = constraint.points();
            let at = points.map(|p| x[p as usize]);
            if constraint.value_and_gradient(&at).is_none() {
                continue;
            }
            let c = constraint.value(&Second::variables(&at));
            let block = |i: usize, j: usize| {
                (c.gradient[i] * c.gradient[j].transpose() + c.hessian[i][j] * c.value) * k
            };
            let mut blocks: [[Matrix3<f64>; K]; K] =
                std::array::from_fn(|i| std::array::from_fn(|j| block(i, j)));
            // A spring at rest or stretched, and any constraint that holds, has no negative curvature of its own.
            if convex && c.value != 0.0 {
                blocks = positive_part(&blocks);
            }
            for i in 0..K {
                (0..K).for_each(|j| add(points[i], points[j], &blocks[i][j]));
            }
        }
    }

    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        for (constraint, k) in self.each() {
            let points = constraint.points();
            let Some((_, g)) = constraint.value_and_gradient(&points.map(|p| x[p as usize])) else {
                continue;
            };
            // The trace of each block k g_i g_j^T: a Gram matrix, hence positive semi-definite.
            for i in 0..K {
                (0..K).for_each(|j| add(points[i], points[j], k * g[i].dot(&g[j])));
            }
        }
    }

    fn force_scale(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        for (constraint, k) in self.each() {
            let at = constraint.points().map(|p| x[p as usize]);
            if let Some((_, g)) = constraint.value_and_gradient(&at) {
                // The force at which C has changed by as much as a strain of one changes it.
                let longest = max_or_nan(at.iter().map(|p| (p - at[0]).norm_squared()));
                let force = k * g[0].norm_squared() * longest.sqrt();
                sum.add(force * force);
            }
        }
        (sum.total() / self.constraints.len().max(1) as f64).sqrt()
    }

    fn remember(&mut self, x: &[Point3<f64>]) {
        if !C::PERIODIC {
            return;
        }
        for constraint in &mut self.constraints {
            let at = constraint.points().map(|p| x[p as usize]);
            if let Some((c, _)) = constraint.value_and_gradient(&at) {
                constraint.remember(c);
            }
        }
    }

    fn bytes(&self) -> usize {
        self.constraints.capacity() * size_of::<C>() + self.stiffness.capacity() * 8
    }
}

/// Energy and forces, added in the order of the constraints however many are computed at once.
struct Forces<'a, C, const K: usize> {
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

    /// Where the gradient is undefined an edge or hinge without extent exerts no force.
    fn alone(&mut self, j: usize) {
        let constraint = &self.of.constraints[j];
        let at = constraint.points().map(|p| self.x[p as usize]);
        if let Some((value, gradient)) = constraint.value_and_gradient(&at) {
            self.add(j, value, &gradient.map(Into::into));
        }
    }

    #[inline(always)]
    fn side_by_side<N: Lane>(&mut self, machine: N::Machine, j: usize) {
        let these = &self.of.constraints[j..j + N::COUNT];
        // Without closures: what they call would not be compiled for the lanes that they are called from.
        let mut at = [[N::splat(machine, 0.0); 3]; K];
        unrolled!(k in K => {
            let [x, y, z, _] = N::gather(machine, self.slots, |l| these[l].points()[k]);
            at[k] = [x, y, z];
        });
        let Several {
            value,
            gradient,
            usual,
        } = C::in_lanes::<N>(these, machine, &at);
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

impl<C: Constraint<K>, const K: usize> InLanes for Forces<'_, C, K> {
    #[inline(always)]
    fn run<N: Lane>(mut self, machine: N::Machine) {
        let (count, mut next) = (self.of.constraints.len(), 0);
        if C::LANES && N::COUNT > 1 {
            while next + N::COUNT <= count {
                self.side_by_side::<N>(machine, next);
                next += N::COUNT;
            }
        }
        (next..count).for_each(|j| self.alone(j));
    }
}

/// The nearest positive semi-definite matrix: negative eigenvalues become zero.
fn positive_part<const K: usize>(blocks: &[[Matrix3<f64>; K]; K]) -> [[Matrix3<f64>; K]; K] {
    let whole = DMatrix::from_fn(3 * K, 3 * K, |r, c| blocks[r / 3][c / 3][(r % 3, c % 3)]);
    let mut split = whole.symmetric_eigen();
    split.eigenvalues.iter_mut().for_each(|v| *v = v.max(0.0));
    let whole = split.recompose();
    std::array::from_fn(|i| {
        std::array::from_fn(|j| whole.fixed_view::<3, 3>(3 * i, 3 * j).into_owned())
    })
}

/// Second derivative of the enclosed volume: calls `add` with its blocks times `factor`, by row and column.
pub fn volume_hessian(
    volume: &EnclosedVolume,
    x: &[Point3<f64>],
    factor: f64,
    add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
) {
    for t in volume.triangles() {
        let p = t.map(|v| x[v as usize]);
        for k in 0..3 {
            // V = a.(b x c)/6: d2V/(da db) v = (v x c)/6. On a closed surface only the difference of c to that of the
            // edge's other triangle survives, so both may count from the middle of the edge.
            let (i, j, c) = (t[k], t[(k + 1) % 3], p[(k + 2) % 3]);
            let middle = nalgebra::center(&p[k], &p[(k + 1) % 3]);
            let block = (c - middle).cross_matrix() * (-factor / 6.0);
            add(i, j, &block);
            add(j, i, &block.transpose());
        }
    }
}
