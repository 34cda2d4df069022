//! Clipping of triangles and segments.
//!
//! The planes are those of a guard band one picture wide on all sides, not the
//! border of the picture. Most triangles then need no clipping, and the rasteriser clips the rest
//! row by row in integers.

use nalgebra::Point3;

use super::camera::Camera;

/// Exact scale of coordinates relative to the eye, a power of two, so that sums and products of the
/// largest finite coordinates stay finite.
pub(super) const SAFE: f64 = 1.0 / (1u64 << 40) as f64;

/// A vertex seen from the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EyeVertex {
    /// Right, up, depth, in units of 1 / [`SAFE`] m.
    pub place: [f64; 3],
    /// Brightness of the front, brightness of the back, position in the range of the field, cosine
    /// to the viewer.
    pub shade: [f32; 4],
}

impl EyeVertex {
    /// `None` for coordinates that are not finite.
    pub fn new(camera: &Camera, point: &Point3<f64>, shade: [f32; 4]) -> Option<Self> {
        let from_eye = (point * SAFE) - (camera.eye * SAFE);
        let place = camera.axes.map(|axis| axis.dot(&from_eye));
        place
            .iter()
            .all(|c| c.is_finite())
            .then_some(Self { place, shade })
    }

    /// Interpolates; `t` = 0.5 is halfway. A weighted sum, not `a + t (b - a)`: the difference can
    /// overflow.
    fn between(inside: &Self, outside: &Self, t: f64) -> Self {
        let mix = |a: f64, b: f64| a * (1.0 - t) + b * t;
        Self {
            place: std::array::from_fn(|k| mix(inside.place[k], outside.place[k])),
            shade: std::array::from_fn(|k| {
                mix(f64::from(inside.shade[k]), f64::from(outside.shade[k])) as f32
            }),
        }
    }
}

/// Greatest number of corners of a triangle after four cuts.
const MOST_CORNERS: usize = 7;

/// A convex polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Polygon {
    corners: [EyeVertex; MOST_CORNERS],
    count: usize,
}

impl Polygon {
    fn empty(filler: EyeVertex) -> Self {
        Self {
            corners: [filler; MOST_CORNERS],
            count: 0,
        }
    }

    fn push(&mut self, corner: EyeVertex) {
        // Rounding could cut a thin polygon twice by one plane; the surplus corner is outside the
        // picture.
        if self.count < MOST_CORNERS {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    /// The corners in order.
    pub fn corners(&self) -> &[EyeVertex] {
        &self.corners[..self.count]
    }
}

/// The planes: inside is where `a x + b y + c >= 0`.
#[derive(Clone, Debug)]
pub(super) struct Clipper {
    planes: [[f64; 3]; 4],
}

impl Clipper {
    pub fn new(camera: &Camera) -> Self {
        let [width, height] = [camera.canvas.width, camera.canvas.height].map(f64::from);
        let [x, y] = camera.centre;
        let side = |right: f64, up: f64, pixels: f64| [right, up, pixels / camera.scale * SAFE];
        let planes = [
            side(1.0, 0.0, x + width),
            side(-1.0, 0.0, 2.0 * width - x),
            side(0.0, 1.0, 2.0 * height - y),
            side(0.0, -1.0, y + height),
        ];
        Self { planes }
    }

    /// The part of a triangle inside; fewer than 3 corners if it is empty.
    pub fn triangle(&self, triangle: &[EyeVertex; 3]) -> Polygon {
        let mut polygon = Polygon::empty(triangle[0]);
        triangle.iter().for_each(|corner| polygon.push(*corner));
        for plane in &self.planes {
            if polygon.corners().iter().all(|c| height(plane, c) >= 0.0) {
                continue;
            }
            let mut cut = Polygon::empty(triangle[0]);
            let corners = polygon.corners();
            for (k, to) in corners.iter().enumerate() {
                let from = &corners[(k + corners.len() - 1) % corners.len()];
                if let Some(crossing) = crossing(plane, from, to) {
                    cut.push(crossing);
                }
                if height(plane, to) >= 0.0 {
                    cut.push(*to);
                }
            }
            polygon = cut;
        }
        polygon
    }

    /// The part of a segment inside.
    pub fn segment(&self, segment: &[EyeVertex; 2]) -> Option<[EyeVertex; 2]> {
        let mut ends = *segment;
        for plane in &self.planes {
            let inside = ends.map(|end| height(plane, &end) >= 0.0);
            if inside == [false, false] {
                return None;
            }
            if let Some(crossing) = crossing(plane, &ends[0], &ends[1]) {
                ends[usize::from(inside[0])] = crossing;
            }
        }
        Some(ends)
    }
}

fn height(plane: &[f64; 3], vertex: &EyeVertex) -> f64 {
    let [x, y, _] = vertex.place;
    plane[0] * x + plane[1] * y + plane[2]
}

/// Intersection of an edge and a plane. It is always computed from the inner end, so that both
/// triangles at an edge get the same bits.
fn crossing(plane: &[f64; 3], from: &EyeVertex, to: &EyeVertex) -> Option<EyeVertex> {
    let (a, b) = (height(plane, from), height(plane, to));
    let (inside, outside, a, b) = match (a >= 0.0, b >= 0.0) {
        (true, false) => (from, to, a, b),
        (false, true) => (to, from, b, a),
        _ => return None,
    };
    Some(EyeVertex::between(inside, outside, a / (a - b)))
}

#[cfg(test)]
mod tests {
    use super::super::camera::{Canvas, View};
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn camera() -> Camera {
        let corners = [Point3::new(-1.0, -1.0, -1.0), Point3::new(1.0, 1.0, 1.0)];
        let view = View::orthographic(Vector3::z(), Vector3::y());
        Camera::fit(corners, &view, Canvas::new(64, 48))
    }

    fn vertex() -> impl Strategy<Value = EyeVertex> {
        let coordinate =
            prop_oneof![3 => -30.0..30.0f64, 1 => prop::sample::select(vec![1e300, -1e300, 0.0])];
        prop::array::uniform3(coordinate).prop_map(|place| EyeVertex {
            place: place.map(|c| c * SAFE),
            shade: [0.0; 4],
        })
    }

    proptest! {
        /// The clipped polygon is convex around the picture's axis, within the planes, and has at
        /// most 7 corners; both triangles at an edge are cut at the same bits.
        #[test]
        fn a_cut_stays_inside_and_fits_its_neighbour(a in vertex(), b in vertex(), c in vertex()) {
            let clipper = Clipper::new(&camera());
            let polygon = clipper.triangle(&[a, b, c]);
            for corner in polygon.corners() {
                for plane in &clipper.planes {
                    let size: f64 = [a, b, c].iter().flat_map(|v| v.place).fold(SAFE, |m, c| m.max(c.abs()));
                    prop_assert!(height(plane, corner) >= -1e-12 * size * plane.iter().fold(1.0, |m: f64, p| m.max(p.abs())));
                }
            }
            for plane in &clipper.planes {
                prop_assert_eq!(crossing(plane, &a, &b), crossing(plane, &b, &a));
            }
            let segment = clipper.segment(&[a, b]);
            prop_assert_eq!(segment.map(|[from, to]| [to, from]), clipper.segment(&[b, a]));
        }
    }
}
