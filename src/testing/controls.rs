//! Deliberately wrong gradients: the suite must reject each of them.

use nalgebra::{Point3, Vector3};

use super::subject::Subject;
use crate::constraints::Scalar;

/// A subject with a wrong gradient.
#[derive(Clone, Debug)]
pub struct BrokenConstraint<T> {
    /// The correct subject.
    pub subject: T,
    /// The change of its gradient.
    pub how: Deed,
}

/// A change that makes a gradient wrong.
pub type Deed = fn(&mut [Vector3<f64>]);

/// Name and change of each negative control.
pub const CONTROLS: &[(&str, Deed)] = &[
    ("one component NaN", |g| g[0].x = f64::NAN),
    ("all NaN", |g| g.fill(Vector3::repeat(f64::NAN))),
    ("six times too large", |g| {
        g.iter_mut().for_each(|g| *g *= 6.0)
    }),
    ("wrong sign", |g| g.iter_mut().for_each(|g| *g = -*g)),
    (
        "two points swapped, or two axes where there is one point",
        |g| {
            if g.len() > 1 && g[0] != g[1] {
                g.swap(0, 1);
            } else {
                g[0] = g[0].zxy();
            }
        },
    ),
    ("one point forgotten", |g| {
        *g.last_mut().expect("at least one point") = Vector3::zeros()
    }),
    ("all zero", |g| g.fill(Vector3::zeros())),
    ("one part in a million too large", |g| {
        g.iter_mut().for_each(|g| *g *= 1.0 + 1e-6)
    }),
];

impl<T: Subject> Subject for BrokenConstraint<T> {
    fn count(&self) -> usize {
        self.subject.count()
    }
    fn value<S: Scalar>(&self, x: &[Point3<S>]) -> S {
        self.subject.value(x)
    }
    fn value_and_gradient(&self, x: &[Point3<f64>]) -> Option<(f64, Vec<Vector3<f64>>)> {
        let (c, mut g) = self.subject.value_and_gradient(x)?;
        (self.how)(&mut g);
        Some((c, g))
    }
}
