//! How a muscle is decomposed: one line a method.

use std::sync::Arc;

use nalgebra::Point3;

use super::attachment::Attachment;
use super::harmonic::{self, Decomposition, DecompositionError, Options};
use super::slices::{self, SlicesError};
use super::smooth::{Smoothing, smooth};
use super::solid::Closed;
use super::springs::{self, SpringsError};
use super::template::{Grid, Template};
use crate::mesh::TriangleMesh;
use crate::progress::{Progress, Silent};

/// Moves of points in smoothing from one question whether to go on to the next.
const MOVES: usize = 200_000;

/// A way to decompose a muscle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method<'a> {
    /// Along the gradient of a harmonic field between the areas.
    Harmonic,
    /// Along directions of lines on the surface [m] ([`super::superficial::register`]), spread through the inside.
    Superficial(&'a [Vec<Point3<f64>>]),
    /// A template's surface on the muscle's, and springs between ([`super::springs`]).
    Springs(Template),
    /// Contours of a template's box on those of the muscle ([`super::slices`]).
    Slices(Template),
}

/// Why a muscle was not decomposed, by the method that was asked to.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MethodError {
    /// Along a flow: harmonic, superficial.
    #[error(transparent)]
    Flow(#[from] DecompositionError),
    /// By springs.
    #[error(transparent)]
    Springs(#[from] SpringsError),
    /// By slices.
    #[error(transparent)]
    Slices(#[from] SlicesError),
}

/// What fibres were read from, before they were made smooth.
#[derive(Clone, Debug)]
pub enum Source {
    /// The flow whose streamlines they are.
    Flow(Box<Decomposition>),
    /// The grid whose lines they are.
    Grid(Grid),
}

/// A muscle decomposed into fibres by any method.
#[derive(Clone, Debug)]
pub struct Fibres {
    /// Each fibre from origin to insertion [m].
    pub lines: Vec<Vec<Point3<f64>>>,
    /// The surface that bounds the inside.
    pub closed: Arc<Closed>,
    /// What they were read from.
    pub source: Source,
}

/// Decomposes a muscle.
///
/// # Errors
/// Those of the method: [`DecompositionError`], [`SpringsError`], [`SlicesError`].
pub fn decompose(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    method: Method<'_>,
    options: Options,
    smoothing: Smoothing,
) -> Result<Fibres, MethodError> {
    decompose_with(muscle, attachment, method, options, smoothing, &Silent)
}

/// As [`decompose`]; `progress` may end it, but for springs and slices.
///
/// # Errors
/// As [`decompose`], or [`DecompositionError::Stopped`].
pub fn decompose_with(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    method: Method<'_>,
    options: Options,
    smoothing: Smoothing,
    progress: &dyn Progress,
) -> Result<Fibres, MethodError> {
    let Options { count, points } = options;
    let mut made = match method {
        Method::Harmonic => Fibres::of(harmonic::decompose_with(
            muscle,
            attachment,
            &[],
            options,
            progress,
        )?),
        Method::Superficial(lines) => Fibres::of(harmonic::decompose_with(
            muscle, attachment, lines, options, progress,
        )?),
        Method::Springs(template) => {
            let options = springs::Options {
                count,
                points,
                ..springs::Options::default()
            };
            Fibres::of_grid(
                muscle,
                springs::grid(muscle, attachment, template, options)?,
            )
        }
        Method::Slices(template) => Fibres::of_grid(
            muscle,
            slices::grid(
                muscle,
                attachment,
                template,
                slices::Options { count, points },
            )?,
        ),
    };
    let mut done = 0;
    while done < smoothing.steps {
        let (passes, of) = (done as usize, smoothing.steps as usize);
        let heard = progress.report("passes of smoothing", passes, of);
        if heard.is_break() {
            return Err(DecompositionError::Stopped.into());
        }
        let steps = (MOVES / count.saturating_mul(points).max(1))
            .clamp(1, (smoothing.steps - done) as usize) as u32;
        smooth(
            &mut made.lines,
            Smoothing { steps, ..smoothing },
            &made.closed.solid(),
        );
        done += steps;
    }
    Ok(made)
}

impl Fibres {
    fn of(mut flow: Decomposition) -> Self {
        Self {
            lines: std::mem::take(&mut flow.fibres),
            closed: flow.closed.clone(),
            source: Source::Flow(Box::new(flow)),
        }
    }

    fn of_grid(muscle: &TriangleMesh, grid: Grid) -> Self {
        Self {
            lines: grid.fibres(),
            closed: Arc::new(Closed::new(muscle)),
            source: Source::Grid(grid),
        }
    }

    /// Jacobian of the fibre map: of a flow at every point of every streamline, 1 at its seed; of a grid the scaled one at
    /// every corner of every cell.
    pub fn jacobian(&self, muscle: &TriangleMesh, attachment: &Attachment) -> Vec<f64> {
        match &self.source {
            Source::Flow(flow) => flow.jacobian(muscle, attachment),
            Source::Grid(grid) => grid.jacobian(),
        }
    }
}
