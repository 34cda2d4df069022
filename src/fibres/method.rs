//! How a muscle is decomposed: one line a method.

use std::sync::Arc;

use nalgebra::Point3;

use super::attachment::Attachment;
use super::harmonic::{Decomposition, DecompositionError, Options, decompose_along};
use super::smooth::{Smoothing, smooth};
use super::solid::Closed;
use crate::mesh::TriangleMesh;

/// A way to decompose a muscle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method<'a> {
    /// Along the gradient of a harmonic field between the areas.
    Harmonic,
    /// Along directions of lines on the surface [m] ([`super::superficial::register`]), spread through the inside.
    Superficial(&'a [Vec<Point3<f64>>]),
}

/// A muscle decomposed into fibres by any method.
#[derive(Clone, Debug)]
pub struct Fibres {
    /// Each fibre from origin to insertion [m].
    pub lines: Vec<Vec<Point3<f64>>>,
    /// The surface that bounds the inside.
    pub closed: Arc<Closed>,
    /// The flow whose streamlines they are, before they were made smooth.
    pub flow: Option<Decomposition>,
}

/// Decomposes a muscle.
///
/// # Errors
/// Too few fibres or points, nothing inside, areas that are not joined, ways that are not found, no memory.
pub fn decompose(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    method: Method<'_>,
    options: Options,
    smoothing: Smoothing,
) -> Result<Fibres, DecompositionError> {
    let mut made = match method {
        Method::Harmonic => Fibres::of(decompose_along(muscle, attachment, &[], options)?),
        Method::Superficial(lines) => Fibres::of(decompose_along(muscle, attachment, lines, options)?),
    };
    if smoothing.steps > 0 {
        smooth(&mut made.lines, smoothing, &made.closed.solid());
    }
    Ok(made)
}

impl Fibres {
    fn of(mut flow: Decomposition) -> Self {
        Self { lines: std::mem::take(&mut flow.fibres), closed: flow.closed.clone(), flow: Some(flow) }
    }

    /// Jacobian of the fibre map at every point of every streamline, 1 at its seed; none where a method has no flow.
    pub fn jacobian(&self, muscle: &TriangleMesh, attachment: &Attachment) -> Vec<f64> {
        self.flow.as_ref().map_or_else(Vec::new, |flow| flow.jacobian(muscle, attachment))
    }
}
