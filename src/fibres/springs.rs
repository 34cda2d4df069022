//! Decomposition by springs: a template's surface is laid onto the muscle's by way of the sphere and held there, and springs
//! bring the points between to rest.
//!
//! The muscle's surface must be a sphere: closed, manifold, of one piece, without handles, turned outward. It is spread over
//! the unit sphere ([`crate::morph::sphere`]), the template's surface is laid into that map such that its areas fill those of
//! the muscle ([`placing`]), and each of its points goes to the same place of the same triangle of the muscle. The inner
//! points come to rest between springs to their six neighbours ([`network`]). Fibres are lines of the grid.
//!
//! Nothing keeps inner points inside a muscle that is bent, nor the grid from folding: [`super::quality`] tells.

pub mod network;
pub mod placing;
pub mod rings;

use nalgebra::Point3;

use super::attachment::{Attachment, End};
use super::template::{Grid, Sampling, Template};
use crate::mesh::TriangleMesh;
use crate::morph::sphere::SphereError;
use crate::solvers::sparse::FactorError;

/// How many fibres of how many points, and how long springs are without tension.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Number of fibres; see [`Sampling::new`] for numbers that make no grid.
    pub count: usize,
    /// Points of each, at least 2.
    pub points: usize,
    /// Side of the template's cube at rest over the length of the muscle's box, at least 0. The source puts a cube of side 1
    /// into muscles of some 300 mm, 0.003; with 0 springs have no length of their own, and one linear system gives the rest.
    pub side: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            count: 100,
            points: 15,
            side: 0.0,
        }
    }
}

/// Why a muscle was not decomposed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpringsError {
    /// No fibre, or fibres of fewer than two points, asked for.
    #[error(
        "{count} fibres of {points} points make no grid; ask for at least 1 fibre of at least 2 points"
    )]
    TooFew {
        /// Fibres asked for.
        count: usize,
        /// Points asked for.
        points: usize,
    },
    /// The side of the template at rest is no length.
    #[error(
        "the template's side at rest is {0} times the muscle's length; give a number of at least 0"
    )]
    Side(f64),
    /// The surface is not a sphere.
    #[error(
        "the muscle's surface cannot be laid onto a sphere: {0}; harmonic decomposition needs no such surface"
    )]
    Surface(#[from] SphereError),
    /// The triangles are turned inward.
    #[error("the muscle's surface is inside out, its volume is {volume:.3e} m3; turn it outward")]
    InsideOut {
        /// The signed volume \[m3\].
        volume: f64,
    },
    /// An area that has no rim on the sphere, for it is all of the surface.
    #[error("the area of the {end} is the whole surface; make it smaller")]
    WholeSurface {
        /// Which area.
        end: End,
    },
    /// The centres of both areas are in one place of the sphere.
    #[error(
        "the centres of origin and insertion, near vertices {} and {}, meet on the sphere; the areas surround one another",
        vertices[0], vertices[1]
    )]
    OnePlace {
        /// A vertex of each.
        vertices: [u32; 2],
    },
    /// A place of the sphere that is in no triangle of the muscle's map.
    #[error("point {point} of the template's surface is in no triangle of the muscle's map")]
    NotFound {
        /// The point of the grid.
        point: usize,
    },
    /// The springs have no state of rest that was found.
    #[error(
        "the springs are not at rest after {steps} steps, {force:.1e} of the force that holds a point is left"
    )]
    NotAtRest {
        /// Steps of Newton's method.
        steps: usize,
        /// Greatest force over that of a spring as long as the muscle.
        force: f64,
    },
    /// The system could not be solved.
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
    options: Options,
) -> Result<Vec<Vec<Point3<f64>>>, SpringsError> {
    Ok(grid(muscle, attachment, template, options)?.fibres())
}

/// The same as a grid, which knows its Jacobian.
///
/// # Errors
/// Too few fibres or points, a surface that is no sphere or inside out, areas that cannot be told apart, springs that do not
/// come to rest.
pub fn grid(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    template: Template,
    options: Options,
) -> Result<Grid, SpringsError> {
    let Options {
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
