//! Subjects of the conformance suite: any function of points with an analytic gradient.

use nalgebra::{Point3, Vector3};

use crate::constraints::{Constraint, EnclosedVolume, Scalar};

/// A scalar function of points with its gradient, of any number of points.
pub trait Subject {
    /// Number of points.
    fn count(&self) -> usize;
    /// The function for any scalar type.
    fn value<S: Scalar>(&self, x: &[Point3<S>]) -> S;
    /// The function and its gradient.
    fn value_and_gradient(&self, x: &[Point3<f64>]) -> Option<(f64, Vec<Vector3<f64>>)>;
}

/// A constraint with a fixed number of points as a subject.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fixed<C, const K: usize>(pub C);

impl<C: Constraint<K>, const K: usize> Subject for Fixed<C, K> {
    fn count(&self) -> usize {
        K
    }
    fn value<S: Scalar>(&self, x: &[Point3<S>]) -> S {
        self.0.value(&std::array::from_fn(|k| x[k]))
    }
    fn value_and_gradient(&self, x: &[Point3<f64>]) -> Option<(f64, Vec<Vector3<f64>>)> {
        self.0
            .value_and_gradient(&std::array::from_fn(|k| x[k]))
            .map(|(c, g)| (c, g.to_vec()))
    }
}

/// The enclosed volume of a surface with some number of vertices as a subject.
#[derive(Clone, Debug)]
pub struct VolumeSubject {
    /// The constraint.
    pub constraint: EnclosedVolume,
    /// Number of vertices.
    pub count: usize,
}

impl Subject for VolumeSubject {
    fn count(&self) -> usize {
        self.count
    }
    fn value<S: Scalar>(&self, x: &[Point3<S>]) -> S {
        self.constraint.value(x)
    }
    fn value_and_gradient(&self, x: &[Point3<f64>]) -> Option<(f64, Vec<Vector3<f64>>)> {
        Some(self.constraint.value_and_gradient(x))
    }
}
