//! Forces along the line between two points: one loop for all laws.

use std::cmp::Ordering;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::force::Force;
use crate::constraints::spring::SpringLaw;
use crate::mesh::sum::tree_sum_by;
use crate::particles::{SHARE, is_shared};

/// A law of springs that can be sorted and checked.
pub trait Law: SpringLaw {
    /// Name of such springs in reports.
    const NAME: &'static str;

    /// All parameters, for sorting.
    fn parameters(&self) -> [f64; 3];

    /// True if the law is defined for the parameters.
    fn is_valid(&self) -> bool;
}

/// Error of [`SpringSet::new`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PairError {
    /// A point does not exist.
    #[error("spring {spring} names point {point}, but there are {count} points")]
    OutOfRange {
        /// Index of the spring in the input.
        spring: usize,
        /// Index of the point.
        point: u32,
        /// Number of points.
        count: usize,
    },
    /// Both ends are the same point.
    #[error("spring {spring} joins point {point} to itself")]
    Loop {
        /// Index of the spring in the input.
        spring: usize,
        /// Index of the point.
        point: u32,
    },
    /// A parameter is not finite or has the wrong sign.
    #[error("spring {spring} has a parameter that its law does not take")]
    Parameter {
        /// Index of the spring in the input.
        spring: usize,
    },
}

/// Sorted springs of one law, with the neighbours of each point in sequence.
///
/// Each force is computed at both ends, so that every point sums its own neighbours in their order.
/// No two threads write to one place, and the bits depend neither on threads nor on the order of
/// the input.
#[derive(Clone, Debug)]
pub struct SpringSet<L> {
    springs: Vec<([u32; 2], L)>,
    start: Vec<usize>,
    around: Vec<(u32, L)>,
}

impl<L: Law> SpringSet<L> {
    /// Creates springs between `count` points.
    ///
    /// # Errors
    /// A point out of range, a spring from a point to itself, or an invalid parameter of the law.
    pub fn new(
        count: usize,
        springs: impl IntoIterator<Item = ([u32; 2], L)>,
    ) -> Result<Self, PairError> {
        let springs = springs
            .into_iter()
            .map(|([a, b], law)| ([a.min(b), a.max(b)], law));
        let mut springs: Vec<([u32; 2], L)> = springs.collect();
        for (spring, &([a, b], law)) in springs.iter().enumerate() {
            if b as usize >= count {
                return Err(PairError::OutOfRange {
                    spring,
                    point: b,
                    count,
                });
            }
            if a == b {
                return Err(PairError::Loop { spring, point: a });
            }
            if !law.is_valid() {
                return Err(PairError::Parameter { spring });
            }
        }
        springs.par_sort_by(|a, b| a.0.cmp(&b.0).then_with(|| by_parameters(&a.1, &b.1)));
        let mut start = vec![0; count + 1];
        springs
            .iter()
            .flat_map(|(ends, _)| ends)
            .for_each(|&p| start[p as usize + 1] += 1);
        (0..count).for_each(|i| start[i + 1] += start[i]);
        let mut next = start.clone();
        let mut around: Vec<Option<(u32, L)>> = vec![None; 2 * springs.len()];
        // Lower neighbours of a point come first, both parts ascending: the springs are sorted by
        // their lower, then higher end.
        for pass in [1, 0] {
            for &(ends, law) in &springs {
                let place = &mut next[ends[pass] as usize];
                around[*place] = Some((ends[1 - pass], law));
                *place += 1;
            }
        }
        Ok(Self {
            springs,
            start,
            around: around.into_iter().flatten().collect(),
        })
    }

    /// The springs, sorted by their points (lower first), then by their parameters.
    pub fn springs(&self) -> &[([u32; 2], L)] {
        &self.springs
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        let (spring, around) = (size_of::<([u32; 2], L)>(), size_of::<(u32, L)>());
        self.springs.capacity() * spring
            + self.around.capacity() * around
            + self.start.capacity() * size_of::<usize>()
    }

    /// Adds to each point the terms of its neighbours.
    fn gather<T: Send>(&self, to: &mut [T], term: impl Fn(usize, &[(u32, L)], &mut T) + Sync) {
        let one = |i: usize, t: &mut T| term(i, &self.around[self.start[i]..self.start[i + 1]], t);
        if is_shared(to.len()) {
            let chunks = to.par_chunks_mut(SHARE).enumerate();
            chunks.for_each(|(k, chunk)| {
                chunk
                    .iter_mut()
                    .enumerate()
                    .for_each(|(i, t)| one(k * SHARE + i, t))
            });
        } else {
            to.iter_mut().enumerate().for_each(|(i, t)| one(i, t));
        }
    }
}

fn by_parameters<L: Law>(a: &L, b: &L) -> Ordering {
    let pairs = a.parameters().into_iter().zip(b.parameters());
    pairs.fold(Ordering::Equal, |order, (a, b)| order.then(a.total_cmp(&b)))
}

impl<L: Law> Force for SpringSet<L> {
    fn name(&self) -> &'static str {
        L::NAME
    }

    fn elements(&self) -> usize {
        self.springs.len()
    }

    fn highest_point(&self) -> Option<u32> {
        self.springs.iter().map(|(ends, _)| ends[1]).max()
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        tree_sum_by(self.springs.len(), |s| {
            let ([a, b], law) = self.springs[s];
            law.energy((x[b as usize] - x[a as usize]).norm())
        })
    }

    fn add_force(&self, x: &[Point3<f64>], force: &mut [Vector3<f64>]) {
        self.gather(force, |i, around, force| {
            for &(j, law) in around {
                let d = x[j as usize] - x[i];
                *force += d * law.tension_per_length(d.norm());
            }
        });
    }

    fn add_product(
        &self,
        x: &[Point3<f64>],
        p: &[Vector3<f64>],
        definite: bool,
        product: &mut [Vector3<f64>],
    ) {
        self.gather(product, |i, around, product| {
            for &(j, law) in around {
                *product += law.product(&(x[j as usize] - x[i]), p[i] - p[j as usize], definite);
            }
        });
    }

    fn add_row_sums(&self, x: &[Point3<f64>], sums: &mut [f64]) {
        self.gather(sums, |i, around, sum| {
            for &(j, law) in around {
                let length = (x[j as usize] - x[i]).norm();
                *sum += 2.0 * law.stiffest(length);
            }
        });
    }
}
