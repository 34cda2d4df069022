//! Decomposition by springs: maps a template's surface to the muscle's surface through the sphere
//! and fixes it there; springs bring the inner points to equilibrium.
//!
//! The muscle's surface must be a topological sphere: closed, manifold, connected, without handles,
//! oriented outward. [`crate::morph::sphere`] maps it to the unit sphere. [`placing`] maps the
//! template's surface into the sphere so that its areas fill those of the muscle. Each point then
//! goes to the same position of the same triangle of the muscle. The inner points come to
//! equilibrium between springs to their six neighbours ([`network`]). Fibres are lines of the grid.
//!
//! Inner points can leave a bent muscle, and the grid can fold; [`super::quality`] measures both.

pub(crate) mod network;
pub(crate) mod placing;
pub(crate) mod rings;

pub use network::springs;

use nalgebra::Point3;

use super::attachment::{Attachment, MuscleEnd};
use super::template::{Grid, Sampling, Template};
use crate::mesh::TriangleMesh;
use crate::morph::sphere::SphereError;
use crate::solvers::sparse::FactorError;

/// Number of fibres and of their points, and rest length of the springs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpringOptions {
    /// Number of fibres; see [`Sampling::new`] for numbers without a grid.
    pub count: usize,
    /// Number of points per fibre, at least 2.
    pub points: usize,
    /// Side of the template's cube at rest, relative to the length of the muscle's bounding box, at
    /// least 0. The source puts a cube of side 1 into muscles of about 300 mm: 0.003. With 0 the
    /// springs have no rest length, and one linear system gives the equilibrium.
    pub side: f64,
}

impl Default for SpringOptions {
    fn default() -> Self {
        Self {
            count: 100,
            points: 15,
            side: 0.0,
        }
    }
}

/// Error of [`decompose`] and [`grid`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpringsError {
    /// The options ask for no fibre or for fibres of fewer than two points.
    #[error(
        "{count} fibres of {points} points make no grid; ask for at least 1 fibre of at least 2 points"
    )]
    TooFew {
        /// Requested number of fibres.
        count: usize,
        /// Requested number of points.
        points: usize,
    },
    /// The side of the template at rest is negative or not finite.
    #[error(
        "the template's side at rest is {0} times the muscle's length; give a number of at least 0"
    )]
    Side(f64),
    /// The surface is no topological sphere.
    #[error(
        "the muscle's surface has no map to the sphere: {0}; harmonic decomposition needs no such surface"
    )]
    Surface(#[from] SphereError),
    /// The triangles are oriented inward.
    #[error("the muscle's surface is inside out, its volume is {volume:.3e} m3; turn it outward")]
    InsideOut {
        /// The signed volume \[m3\].
        volume: f64,
    },
    /// An area covers the whole surface and so has no boundary on the sphere.
    #[error("the area of the {end} is the whole surface; make it smaller")]
    WholeSurface {
        /// Which area.
        end: MuscleEnd,
    },
    /// The centres of both areas coincide on the sphere.
    #[error(
        "the centres of origin and insertion, near vertices {} and {}, meet on the sphere; the areas surround one another",
        vertices[0], vertices[1]
    )]
    OnePlace {
        /// A vertex of each area.
        vertices: [u32; 2],
    },
    /// A point of the sphere is in no triangle of the muscle's map.
    #[error("point {point} of the template's surface is in no triangle of the muscle's map")]
    NotFound {
        /// The point of the grid.
        point: usize,
    },
    /// The springs do not come to equilibrium.
    #[error(
        "the springs are not at rest after {steps} steps, {force:.1e} of the force that holds a point is left"
    )]
    NotAtRest {
        /// Steps of Newton's method.
        steps: usize,
        /// Root mean square of the residual force, relative to that of the tension of springs
        /// without rest length.
        force: f64,
    },
    /// The linear system has no solution.
    #[error("the springs' system could not be solved: {0}")]
    Factor(#[from] FactorError),
}

/// Decomposes a muscle into fibres, each from origin to insertion \[m\].
///
/// # Errors
/// See [`grid`].
pub fn decompose(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    template: Template,
    options: SpringOptions,
) -> Result<Vec<Vec<Point3<f64>>>, SpringsError> {
    Ok(grid(muscle, attachment, template, options)?.fibres())
}

/// The same as [`decompose`], but as a grid with Jacobians.
///
/// # Errors
/// Too few fibres or points, a surface that is no topological sphere or inside out, areas with a
/// common centre, or springs without equilibrium.
pub fn grid(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    template: Template,
    options: SpringOptions,
) -> Result<Grid, SpringsError> {
    let SpringOptions {
        count,
        points,
        side,
    } = options;
    let sampling = Sampling::new(count, points).ok_or(SpringsError::TooFew { count, points })?;
    if !(side >= 0.0 && side.is_finite()) {
        return Err(SpringsError::Side(side));
    }
    let mut positions = placing::place(muscle, attachment, &sampling)?;
    network::rest(&sampling, template, side * muscle.length(), &mut positions)?;
    Ok(Grid {
        sampling,
        points: positions,
    })
}
