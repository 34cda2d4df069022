//! Decomposition by slices: contours of a template's box are laid onto those of the muscle, slice by slice.
//!
//! The main axis joins the middles of the areas, of the template and of the muscle; a box around the template is scaled along
//! it until the muscle is inside, and turned about it. Each plane across the axis cuts the box in a rectangle and the muscle
//! in a contour ([`contour`]), whose corners go to the rectangle by their share of the perimeter. Points of fibres in the
//! rectangle have mean-value coordinates over those places, and the same over the contour ([`coordinates`]).
//!
//! Nothing asks that the surface be closed, manifold or turned. What the method cannot do is not hidden but measured
//! ([`super::quality`]): where a muscle ends in a point all fibres do, ends need not be on the areas, and points of contours
//! that are not convex may lie outside or out of order.

pub mod contour;
pub mod coordinates;

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Point2, Point3, Vector2, Vector3};

use super::attachment::{Area, Attachment};
use super::template::{Grid, Sampling, Template};
use crate::mesh::TriangleMesh;
use contour::Slicer;

/// How many fibres of how many points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Number of fibres; see [`Sampling::new`] for numbers that make no grid.
    pub count: usize,
    /// Points of each, at least 2.
    pub points: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            count: 100,
            points: 15,
        }
    }
}

/// Why a muscle was not decomposed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SlicesError {
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
    /// The areas do not tell which way the muscle runs.
    #[error(
        "the middles of origin and insertion are {distance:.3e} m apart, in a muscle of {length:.3e} m: no axis joins them; \
         give areas that are apart"
    )]
    NoAxis {
        /// Distance of the middles \[m\].
        distance: f64,
        /// Length of the muscle's box \[m\].
        length: f64,
    },
    /// A plane meets no triangle.
    #[error(
        "the plane across the main axis at {share:.3} of the muscle, through ({}, {}, {}), cuts no contour; the surface has a \
         gap there",
        .at.x, .at.y, .at.z
    )]
    NoContour {
        /// From the muscle's start, as a share of its extent along the axis.
        share: f64,
        /// A point of the plane \[m\].
        at: Point3<f64>,
    },
}

/// Directions nearer than this share of the body are none.
const NONE: f64 = 1e-9;
/// The first and the last plane keep so much of the extent from the ends: there is nothing to cut at the very end.
const IN_FROM_THE_END: f64 = 1e-6;
/// How far off the line of the areas a template's middle must be, over its size, for that to say how it is turned.
const LOPSIDED: f64 = 0.05;

/// Decomposes a muscle into fibres, each from the origin's end to the insertion's \[m\].
///
/// # Errors
/// See [`grid`].
pub fn decompose(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    template: Template,
    options: Options,
) -> Result<Vec<Vec<Point3<f64>>>, SlicesError> {
    Ok(grid(muscle, attachment, template, options)?.fibres())
}

/// The same as a grid, which knows its Jacobian.
///
/// # Errors
/// Too few fibres or points, areas without an axis between them, planes that meet nothing.
pub fn grid(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    template: Template,
    options: Options,
) -> Result<Grid, SlicesError> {
    let Options { count, points } = options;
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
        let way = middle(muscle, &attachment.insertion) - middle(muscle, &attachment.origin);
        return Err(SlicesError::NoAxis {
            distance: way.norm(),
            length,
        });
    };
    let to = to.turned_like(&from);
    // Points of the template by their slices, lowest first.
    let mut slices: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (p, x) in shape.iter().enumerate() {
        // Shares are not negative, so that their bits are in order.
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

/// The middle of an area's surface \[m\].
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

/// A template or a muscle, in axes of its own.
struct Body {
    /// Two across the main axis, and that; right-handed.
    axes: [Vector3<f64>; 3],
    /// The least and the greatest coordinates along the axes.
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// From the line of the areas to the middle of the body, across the main axis.
    aside: Vector3<f64>,
    points: Vec<Point3<f64>>,
}

impl Body {
    /// Axes by the areas' middles, and across them the principal ones.
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
        // Of a body that is the same all around any direction will do.
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

    /// Turned about the main axis such that its middle is on the same side of the line of the areas as that of the template,
    /// if the template has such a side.
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

    /// How far along the main axis, 0 to 1.
    fn share(&self, p: &Point3<f64>) -> f64 {
        (self.axes[2].dot(&p.coords) - self.low.z) / (self.high.z - self.low.z)
    }

    /// Where in the rectangle of the box, 0 to 1 each.
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
