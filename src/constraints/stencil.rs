//! Stencils: terms of an energy that each depend on a few points, and the loops over them, written
//! once.

use nalgebra::{Matrix3, Point3, Vector3};

use super::potential::Potential;
use crate::mesh::sum::NeumaierSum;

/// Blocks of the second derivative of a stencil [N/m], by row and column.
pub type Blocks<const K: usize> = [[Matrix3<f64>; K]; K];

/// A term of an energy: a function of `K` points with its first two derivatives.
///
/// `None` means a term without energy and forces at these positions, such as an open contact or an
/// edge without extent.
///
/// ```
/// use nalgebra::{Matrix3, Point3, Vector3};
/// use pliant::constraints::{Potential, Stencil, Stencils};
///
/// /// A spring of 2 N/m that pulls a vertex down to the ground.
/// #[derive(Clone, Copy)]
/// struct Ground(u32);
///
/// impl Stencil<1> for Ground {
///     fn points(&self) -> [u32; 1] {
///         [self.0]
///     }
///     fn energy_and_gradient(&self, x: &[Point3<f64>; 1]) -> Option<(f64, [Vector3<f64>; 1])> {
///         let height = x[0].z;
///         Some((height * height, [Vector3::z() * (2.0 * height)]))
///     }
///     fn hessian(&self, _: &[Point3<f64>; 1], _: bool) -> Option<[[Matrix3<f64>; 1]; 1]> {
///         Some([[Matrix3::from_diagonal(&(Vector3::z() * 2.0))]])
///     }
///     fn scalar_hessian(&self, _: &[Point3<f64>; 1]) -> Option<[[f64; 1]; 1]> {
///         Some([[2.0]])
///     }
/// }
///
/// let part = Stencils::new("ground", vec![Ground(0)]);
/// assert_eq!(part.energy(&[Point3::new(1.0, 2.0, 3.0)]), 9.0);
/// ```
pub trait Stencil<const K: usize>: Copy + Send + Sync + 'static {
    /// The vertices it acts on.
    fn points(&self) -> [u32; K];

    /// Energy [J] and its gradient with respect to each point [N] at positions `x` [m].
    fn energy_and_gradient(&self, x: &[Point3<f64>; K]) -> Option<(f64, [Vector3<f64>; K])>;

    /// Second derivative [N/m]. With `convex`, its nearest positive semi-definite part.
    fn hessian(&self, x: &[Point3<f64>; K], convex: bool) -> Option<Blocks<K>>;

    /// Entries [N/m] of a positive semi-definite matrix over the points. The matrix approximates
    /// the second derivative, equally in all directions of space.
    fn scalar_hessian(&self, x: &[Point3<f64>; K]) -> Option<[[f64; K]; K]>;

    /// Energy [J].
    #[inline]
    fn energy(&self, x: &[Point3<f64>; K]) -> Option<f64> {
        self.energy_and_gradient(x).map(|(energy, _)| energy)
    }

    /// Force [N] at a strain or an angle of one; 0 if other terms define the scale of forces.
    fn force_scale(&self, _x: &[Point3<f64>; K]) -> f64 {
        0.0
    }

    /// The second derivative times displacements `p` [m] of the points [N].
    #[inline]
    fn product(
        &self,
        x: &[Point3<f64>; K],
        p: &[Vector3<f64>; K],
        convex: bool,
    ) -> Option<[Vector3<f64>; K]> {
        let blocks = self.hessian(x, convex)?;
        let row = |i: usize| (0..K).map(|j| blocks[i][j] * p[j]).sum();
        Some(std::array::from_fn(row))
    }

    /// Bounds on the sum of the norms of the blocks in the row of each point [N/m].
    #[inline]
    fn row_sums(&self, x: &[Point3<f64>; K]) -> Option<[f64; K]> {
        let blocks = self.hessian(x, false)?;
        Some(blocks.map(|row| row.iter().map(Matrix3::norm).sum()))
    }
}

/// The positions of a stencil's points.
#[inline]
pub(crate) fn at<T: Copy, const K: usize>(points: [u32; K], all: &[T]) -> [T; K] {
    points.map(|p| all[p as usize])
}

/// Sum of the energies [J].
pub(super) fn energy<T: Stencil<K>, const K: usize>(
    terms: impl Iterator<Item = T>,
    x: &[Point3<f64>],
) -> f64 {
    let mut sum = NeumaierSum::default();
    for term in terms {
        if let Some(energy) = term.energy(&at(term.points(), x)) {
            sum.add(energy);
        }
    }
    sum.total()
}

/// Sum of the energies [J]; adds the gradients [N].
pub(super) fn energy_and_gradient<T: Stencil<K>, const K: usize>(
    terms: impl Iterator<Item = T>,
    x: &[Point3<f64>],
    gradient: &mut [Vector3<f64>],
) -> f64 {
    let mut sum = NeumaierSum::default();
    for term in terms {
        let points = term.points();
        let Some((energy, slopes)) = term.energy_and_gradient(&at(points, x)) else {
            continue;
        };
        sum.add(energy);
        for (p, slope) in points.into_iter().zip(slopes) {
            gradient[p as usize] += slope;
        }
    }
    sum.total()
}

/// Calls `pair` with every two points of a term.
pub(super) fn pairs<T: Stencil<K>, const K: usize>(
    terms: impl Iterator<Item = T>,
    pair: &mut dyn FnMut(u32, u32),
) {
    for term in terms {
        let points = term.points();
        for i in 0..K {
            points[..i].iter().for_each(|&q| pair(points[i], q));
        }
    }
}

/// Calls `add` with the blocks of each term.
pub(super) fn hessian<T: Stencil<K>, const K: usize>(
    terms: impl Iterator<Item = T>,
    x: &[Point3<f64>],
    convex: bool,
    add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
) {
    for term in terms {
        let points = term.points();
        let Some(blocks) = term.hessian(&at(points, x), convex) else {
            continue;
        };
        for i in 0..K {
            (0..K).for_each(|j| add(points[i], points[j], &blocks[i][j]));
        }
    }
}

/// Calls `add` with the entries of each term's scalar matrix.
pub(super) fn scalar_hessian<T: Stencil<K>, const K: usize>(
    terms: impl Iterator<Item = T>,
    x: &[Point3<f64>],
    add: &mut dyn FnMut(u32, u32, f64),
) {
    for term in terms {
        let points = term.points();
        let Some(entries) = term.scalar_hessian(&at(points, x)) else {
            continue;
        };
        for i in 0..K {
            (0..K).for_each(|j| add(points[i], points[j], entries[i][j]));
        }
    }
}

/// Root mean square of the scales of force [N].
pub(super) fn force_scale<T: Stencil<K>, const K: usize>(
    terms: impl ExactSizeIterator<Item = T>,
    x: &[Point3<f64>],
) -> f64 {
    let (mut sum, count) = (NeumaierSum::default(), terms.len());
    for term in terms {
        let force = term.force_scale(&at(term.points(), x));
        sum.add(force * force);
    }
    (sum.total() / count.max(1) as f64).sqrt()
}

/// A potential that is a sum over stencils of one kind.
#[derive(Clone, Debug)]
pub struct Stencils<T, const K: usize> {
    name: &'static str,
    terms: Vec<T>,
}

impl<T: Stencil<K>, const K: usize> Stencils<T, K> {
    /// The sum over `terms`, as the effect `name`.
    pub fn new(name: &'static str, terms: Vec<T>) -> Self {
        Self { name, terms }
    }

    /// The terms, in the order in which they are added.
    pub fn terms(&self) -> &[T] {
        &self.terms
    }
}

impl<T: Stencil<K>, const K: usize> Potential for Stencils<T, K> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        energy(self.terms.iter().copied(), x)
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        energy_and_gradient(self.terms.iter().copied(), x, gradient)
    }

    fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        pairs(self.terms.iter().copied(), pair);
    }

    fn hessian(
        &self,
        x: &[Point3<f64>],
        convex: bool,
        add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
    ) {
        hessian(self.terms.iter().copied(), x, convex, add);
    }

    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        scalar_hessian(self.terms.iter().copied(), x, add);
    }

    fn force_scale(&self, x: &[Point3<f64>]) -> f64 {
        force_scale(self.terms.iter().copied(), x)
    }
}
