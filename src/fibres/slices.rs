//! Decomposition by slices: maps contours of a template's box to contours of the muscle, slice by
//! slice.
//!
//! The main axis joins the centres of the two areas, in the template and in the muscle. A box
//! around the template is scaled along the axis until it contains the muscle, and rotated about the
//! axis. Each plane across the axis cuts the box in a rectangle and the muscle in a contour
//! ([`contour`]). The corners of the contour map to the rectangle by their share of the perimeter.
//! Fibre points in the rectangle get mean-value coordinates over the mapped corners; the same
//! coordinates over the contour give their positions ([`coordinates`]).
//!
//! The surface need not be closed, manifold or consistently oriented. [`super::quality`] measures
//! the limits of the method: all fibres meet in a point where the muscle ends in a point, fibre
//! ends can be off the areas, and points of non-convex contours can lie outside or out of order.

pub(crate) mod contour;
pub(crate) mod coordinates;

pub(crate) use contour::Slicer;

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Point2, Point3, Vector2, Vector3};

use super::attachment::{Area, Attachment};
use super::template::{Grid, Sampling, Template};
use crate::mesh::TriangleMesh;

/// Number of fibres and of their points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SliceOptions {
    /// Number of fibres; see [`Sampling::new`] for numbers without a grid.
    pub count: usize,
    /// Number of points per fibre, at least 2.
    pub points: usize,
}

impl Default for SliceOptions {
    fn default() -> Self {
        Self {
            count: 100,
            points: 15,
        }
    }
}

/// Error of [`decompose`] and [`grid`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SlicesError {
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
    /// The areas define no main axis.
    #[error(
        "the middles of origin and insertion are {distance:.3e} m apart, in a muscle of {length:.3e} m: no axis joins them; \
         give areas that are apart"
    )]
    NoAxis {
        /// Distance between the centres of the areas \[m\].
        distance: f64,
        /// Length of the muscle's bounding box \[m\].
        length: f64,
    },
    /// A plane intersects no triangle.
    #[error(
        "the plane across the main axis at {share:.3} of the muscle, through ({}, {}, {}), cuts no contour; the surface has a \
         gap there",
        .at.x, .at.y, .at.z
    )]
    NoContour {
        /// Distance of the plane from the start of the muscle, relative to the muscle's extent
        /// along the axis.
        share: f64,
        /// A point of the plane \[m\].
        at: Point3<f64>,
    },
}

/// A direction shorter than this share of the body is no direction.
const NONE: f64 = 1e-9;
/// Distance of the first and last plane from the ends, relative to the extent: a plane at the very
/// end has no contour.
const IN_FROM_THE_END: f64 = 1e-6;
/// Least offset of a template's centre from the line between the areas, relative to the template's
/// size, that defines its rotation.
const LOPSIDED: f64 = 0.05;

/// Decomposes a muscle into fibres, each from the origin's end to the insertion's \[m\].
///
/// # Errors
/// See [`grid`].
pub fn decompose(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    template: Template,
    options: SliceOptions,
) -> Result<Vec<Vec<Point3<f64>>>, SlicesError> {
    Ok(grid(muscle, attachment, template, options)?.fibres())
}

/// The same as [`decompose`], but as a grid with Jacobians.
///
/// # Errors
/// Too few fibres or points, areas without an axis between them, planes that intersect nothing.
pub fn grid(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    template: Template,
    options: SliceOptions,
) -> Result<Grid, SlicesError> {
    let SliceOptions { count, points } = options;
    let sampling = Sampling::new(count, points).ok_or(SlicesError::TooFew { count, points })?;
    let shape = sampling.positions(template);
    let mean = |list: &[u32]| {
        list.iter()
            .map(|&p| shape[p as usize].coords)
            .sum::<Vector3<f64>>()
            / list.len() as f64
    };
    let of_template = Body::new(
        &shape,
        mean(&sampling.origin()),
        mean(&sampling.insertion()),
    );
    let used = used_vertices(muscle);
    let of_muscle = Body::new(
        &used,
        middle(muscle, &attachment.origin),
        middle(muscle, &attachment.insertion),
    );
    let length = muscle.length();
    let (Some(from), Some(to)) = (of_template, of_muscle) else {
        let direction = middle(muscle, &attachment.insertion) - middle(muscle, &attachment.origin);
        return Err(SlicesError::NoAxis {
            distance: direction.norm(),
            length,
        });
    };
    let to = to.turned_like(&from);
    // Points of the template by slice, lowest slice first.
    let mut slices: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (p, x) in shape.iter().enumerate() {
        // Shares are not negative, so their bits have the same order.
        let share = from.share(x).clamp(IN_FROM_THE_END, 1.0 - IN_FROM_THE_END);
        slices.entry(share.to_bits()).or_default().push(p);
    }
    let slicer = Slicer::new(muscle, &to.axes);
    let mut positions = vec![Point3::origin(); shape.len()];
    for (bits, points) in slices {
        let share = f64::from_bits(bits);
        let height = to.low.z + (to.high.z - to.low.z) * share;
        let contour = slicer.cut(height).ok_or_else(|| SlicesError::NoContour {
            share,
            at: to.place(0.0, 0.0, height),
        })?;
        let contour = coordinates::Outline::new(&contour);
        for p in points {
            let Point2 { coords } = contour.of(&from.across(&shape[p]));
            positions[p] = to.place(coords.x, coords.y, height);
        }
    }
    Ok(Grid {
        sampling,
        points: positions,
    })
}

fn used_vertices(muscle: &TriangleMesh) -> Vec<Point3<f64>> {
    let mut used = vec![false; muscle.vertices.len()];
    muscle
        .triangles
        .iter()
        .flatten()
        .for_each(|&v| used[v as usize] = true);
    muscle
        .vertices
        .iter()
        .zip(used)
        .filter(|(_, used)| *used)
        .map(|(v, _)| *v)
        .collect()
}

/// The centre of an area's surface \[m\].
fn middle(muscle: &TriangleMesh, area: &Area) -> Vector3<f64> {
    let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
    for &t in &area.triangles {
        let [a, b, c] = muscle.corners(t as usize).map(|p| p.coords);
        let size = (b - a).cross(&(c - a)).norm();
        sum += (a + b + c) * (size / 3.0);
        weight += size;
    }
    if weight > 0.0 {
        sum / weight
    } else {
        muscle.vertices[area.vertices[0] as usize].coords
    }
}

/// A template or a muscle in its own axes.
struct Body {
    /// Two axes across the main axis, then the main axis; right-handed.
    axes: [Vector3<f64>; 3],
    /// Least and greatest coordinates along the axes.
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// Vector from the line between the areas to the centre of the body, across the main axis.
    aside: Vector3<f64>,
    points: Vec<Point3<f64>>,
}

impl Body {
    /// Creates the main axis from the centres of the areas, and the principal axes across it.
    fn new(points: &[Point3<f64>], origin: Vector3<f64>, insertion: Vector3<f64>) -> Option<Self> {
        let bounds = crate::mesh::Aabb::of_points(points);
        let main = (insertion - origin).try_normalize(NONE * bounds.extents().norm())?;
        let any = main.cross(&Vector3::ith(main.iamin(), 1.0)).normalize();
        let (u, v) = (any, main.cross(&any));
        let centre = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
        let mut spread = Matrix2::zeros();
        for p in points {
            let off = p.coords - centre;
            let off = Vector2::new(off.dot(&u), off.dot(&v));
            spread += off * off.transpose();
        }
        let [a, b] = [spread[(0, 0)] - spread[(1, 1)], 2.0 * spread[(0, 1)]];
        // Any direction serves for a body that is symmetric about the axis.
        let turn = if a.hypot(b) > NONE * spread.trace() {
            0.5 * libm::atan2(b, a)
        } else {
            0.0
        };
        let (sin, cos) = libm::sincos(turn);
        let off = centre - origin;
        let body = Self {
            axes: [Vector3::zeros(); 3],
            low: Vector3::zeros(),
            high: Vector3::zeros(),
            aside: off - main * main.dot(&off),
            points: points.to_vec(),
        };
        Some(body.with_axes(u * cos + v * sin, main))
    }

    fn with_axes(mut self, across: Vector3<f64>, main: Vector3<f64>) -> Self {
        self.axes = [across, main.cross(&across), main];
        let own = |p: &Point3<f64>| Vector3::from(self.axes.map(|a| a.dot(&p.coords)));
        let all = self.points.iter().map(own);
        (self.low, self.high) = all.fold(
            (
                Vector3::repeat(f64::INFINITY),
                Vector3::repeat(f64::NEG_INFINITY),
            ),
            |m, p| (m.0.inf(&p), m.1.sup(&p)),
        );
        self
    }

    /// The body rotated about the main axis so that its centre is on the same side of the line
    /// between the areas as that of the template, if the template has such a side.
    fn turned_like(self, template: &Self) -> Self {
        let size = (template.high - template.low).norm();
        let (side, own) = (
            template.aside,
            self.aside
                .try_normalize(NONE * (self.high - self.low).norm()),
        );
        let Some(own) = own.filter(|_| side.norm() > LOPSIDED * size) else {
            return self;
        };
        let angle = libm::atan2(side.dot(&template.axes[1]), side.dot(&template.axes[0]));
        let main = self.axes[2];
        let (sin, cos) = libm::sincos(-angle);
        self.with_axes(own * cos + main.cross(&own) * sin, main)
    }

    /// Position along the main axis, 0 to 1.
    fn share(&self, p: &Point3<f64>) -> f64 {
        (self.axes[2].dot(&p.coords) - self.low.z) / (self.high.z - self.low.z)
    }

    /// Position in the rectangle of the box, 0 to 1 in both coordinates.
    fn across(&self, p: &Point3<f64>) -> Point2<f64> {
        let of = |c: usize| {
            ((self.axes[c].dot(&p.coords) - self.low[c]) / (self.high[c] - self.low[c]))
                .clamp(0.0, 1.0)
        };
        Point2::new(of(0), of(1))
    }

    fn place(&self, x: f64, y: f64, z: f64) -> Point3<f64> {
        Point3::from(self.axes[0] * x + self.axes[1] * y + self.axes[2] * z)
    }
}
