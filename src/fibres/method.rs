//! Methods of decomposition, one line each.

use std::sync::Arc;

use nalgebra::Point3;

use super::attachment::Attachment;
use super::harmonic::{self, Decomposition, DecompositionError, HarmonicOptions};
use super::slices::{self, SlicesError};
use super::smooth::{Smoothing, smooth};
use super::solid::Closed;
use super::springs::{self, SpringsError};
use super::template::{Grid, Template};
use crate::mesh::TriangleMesh;
use crate::progress::Progress;

/// Number of point moves in smoothing between two checks for cancellation.
const MOVES: usize = 200_000;

/// A method of decomposition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FibreMethod<'a> {
    /// Streamlines of a harmonic field between the areas.
    Harmonic,
    /// Directions of lines on the surface [m] ([`super::superficial::register`]), interpolated to
    /// the inside.
    Superficial(&'a [Vec<Point3<f64>>]),
    /// The surface of a template on that of the muscle, with springs inside ([`super::springs`]).
    Springs(Template),
    /// Contours of a template's box mapped to those of the muscle ([`super::slices`]).
    Slices(Template),
}

/// Error of a decomposition, by method.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MethodError {
    /// Error of a flow: harmonic or superficial.
    #[error(transparent)]
    Flow(#[from] DecompositionError),
    /// Error of the springs.
    #[error(transparent)]
    Springs(#[from] SpringsError),
    /// Error of the slices.
    #[error(transparent)]
    Slices(#[from] SlicesError),
}

/// The source of the fibres before smoothing.
#[derive(Clone, Debug)]
pub enum FibreSource {
    /// The flow; the fibres are its streamlines.
    Flow(Box<Decomposition>),
    /// The grid; the fibres are its lines.
    Grid(Grid),
}

/// Fibres of a muscle, by any method.
#[derive(Clone, Debug)]
pub struct Fibres {
    /// Each fibre from origin to insertion [m].
    pub lines: Vec<Vec<Point3<f64>>>,
    /// The surface that bounds the inside.
    pub closed: Arc<Closed>,
    /// The source of the fibres.
    pub source: FibreSource,
}

/// Decomposes a muscle by a method. The progress can stop the harmonic methods; springs and slices
/// run to their end.
///
/// # Errors
/// Those of the method: [`DecompositionError`], [`SpringsError`], [`SlicesError`];
/// [`DecompositionError::Stopped`] if the progress stopped it.
pub fn decompose_by(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    method: FibreMethod<'_>,
    options: HarmonicOptions,
    smoothing: Smoothing,
    progress: &dyn Progress,
) -> Result<Fibres, MethodError> {
    let HarmonicOptions { count, points } = options;
    let mut made = match method {
        FibreMethod::Harmonic => Fibres::of(harmonic::decompose_with(
            muscle,
            attachment,
            &[],
            options,
            progress,
        )?),
        FibreMethod::Superficial(lines) => Fibres::of(harmonic::decompose_with(
            muscle, attachment, lines, options, progress,
        )?),
        FibreMethod::Springs(template) => {
            let options = springs::SpringOptions {
                count,
                points,
                ..springs::SpringOptions::default()
            };
            Fibres::of_grid(
                muscle,
                springs::grid(muscle, attachment, template, options)?,
            )
        }
        FibreMethod::Slices(template) => Fibres::of_grid(
            muscle,
            slices::grid(
                muscle,
                attachment,
                template,
                slices::SliceOptions { count, points },
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
            source: FibreSource::Flow(Box::new(flow)),
        }
    }

    fn of_grid(muscle: &TriangleMesh, grid: Grid) -> Self {
        Self {
            lines: grid.fibres(),
            closed: Arc::new(Closed::new(muscle)),
            source: FibreSource::Grid(grid),
        }
    }

    /// The lines as the source has them, with all its points: streamlines before they become fibres
    /// of few points, or the lines of the grid.
    pub fn courses(&self) -> Vec<Vec<Point3<f64>>> {
        match &self.source {
            FibreSource::Flow(flow) => flow.streamlines.iter().map(harmonic::course).collect(),
            FibreSource::Grid(_) => self.lines.clone(),
        }
    }

    /// Jacobian of the fibre map. For a flow: at every point of every streamline, 1 at the seed.
    /// For a grid: the scaled Jacobian at every corner of every cell.
    pub fn jacobian(&self, muscle: &TriangleMesh, attachment: &Attachment) -> Vec<f64> {
        match &self.source {
            FibreSource::Flow(flow) => flow.jacobian(muscle, attachment),
            FibreSource::Grid(grid) => grid.jacobian(),
        }
    }
}
