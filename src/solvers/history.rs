//! Curvature estimates from the last steps of a minimisation (L-BFGS) \[nocedal1980\].

use std::collections::VecDeque;

use nalgebra::Vector3;

use crate::mesh::sum::tree_sum_by;
use crate::state::{DecodeError, Reader, Value, Writer};

/// A displacement of all vertices.
pub type Field = Vec<Vector3<f64>>;

/// Dot product of two fields, over a fixed tree.
pub fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    tree_sum_by(a.len(), |i| a[i].dot(&b[i]))
}

/// Adds `factor` times `b` to `a`.
pub fn add_scaled(a: &mut [Vector3<f64>], factor: f64, b: &[Vector3<f64>]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b * factor);
}

struct Pair {
    step: Field,
    change: Field,
    per_product: f64,
}

/// The last few steps with their changes of the gradient.
pub struct History {
    pairs: VecDeque<Pair>,
    depth: usize,
}

impl History {
    /// Stores at most `depth` steps.
    pub fn new(depth: usize) -> Self {
        Self {
            pairs: VecDeque::new(),
            depth,
        }
    }

    /// Removes all steps.
    pub fn clear(&mut self) {
        self.pairs.clear();
    }

    /// True without steps.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Adds a step with its change of the gradient. A step without positive curvature is left out.
    pub fn note(&mut self, step: Field, change: Field) {
        let product = dot(&step, &change);
        let size = dot(&step, &step).sqrt() * dot(&change, &change).sqrt();
        if !(product > 1e-12 * size) {
            return;
        }
        if self.pairs.len() == self.depth {
            self.pairs.pop_front();
        }
        self.pairs.push_back(Pair {
            step,
            change,
            per_product: 1.0 / product,
        });
    }

    /// Applies the inverse of the estimated second derivative to the fields, in place; `constant`
    /// is the inverse without history.
    pub fn apply(
        &self,
        fields: &mut [&mut [Vector3<f64>]],
        constant: impl FnOnce(&mut [&mut [Vector3<f64>]]),
    ) {
        let mut factors = vec![vec![0.0; self.pairs.len()]; fields.len()];
        for (field, factors) in fields.iter_mut().zip(&mut factors) {
            for (pair, factor) in self.pairs.iter().zip(factors).rev() {
                *factor = dot(&pair.step, field) * pair.per_product;
                add_scaled(field, -*factor, &pair.change);
            }
        }
        constant(fields);
        for (field, factors) in fields.iter_mut().zip(&factors) {
            for (pair, factor) in self.pairs.iter().zip(factors) {
                let back = dot(&pair.change, field) * pair.per_product;
                add_scaled(field, factor - back, &pair.step);
            }
        }
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.pairs
            .iter()
            .map(|p| (p.step.capacity() + p.change.capacity()) * 24)
            .sum()
    }
}

impl Value for Pair {
    const MIN_BYTES: usize = 24;

    fn encode(&self, to: &mut Writer) {
        let Self {
            step,
            change,
            per_product,
        } = self;
        to.list(step);
        to.list(change);
        to.put(per_product);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self {
            step: from.take()?,
            change: from.take()?,
            per_product: from.take()?,
        })
    }
}

impl History {
    /// Appends the state.
    pub fn save(&self, to: &mut Writer) {
        let Self { pairs, depth: _ } = self;
        to.put(&pairs.len());
        pairs.iter().for_each(|pair| to.put(pair));
    }

    /// Restores the state, of fields over `count` vertices.
    pub fn restore(&mut self, from: &mut Reader<'_>, count: usize) -> Result<(), DecodeError> {
        self.pairs = from.take::<Vec<Pair>>()?.into();
        let sound = |pair: &Pair| pair.step.len() == count && pair.change.len() == count;
        from.check(
            self.pairs.len() <= self.depth && self.pairs.iter().all(sound),
            "a history of another body",
        )
    }
}
