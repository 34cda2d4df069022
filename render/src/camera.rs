//! Position and projection of a camera.

use nalgebra::{Point3, Vector3};

use super::lighting::unit;

/// Greatest width or height of a picture \[px\]; larger values are clamped.
pub const MAX_SIDE: u32 = 8192;

/// Size of a picture \[px\], and margins that the scene leaves free (for a legend or a caption).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Canvas {
    /// Width of the picture \[px\].
    pub width: u32,
    /// Height of the picture \[px\].
    pub height: u32,
    /// Margins at the left, top, right, bottom \[px\].
    pub insets: [f64; 4],
}

impl Canvas {
    /// A canvas with a margin of 4 % of its smaller side on all sides. Sides are clamped to
    /// 1..=[`MAX_SIDE`].
    pub fn new(width: u32, height: u32) -> Self {
        let (width, height) = (width.clamp(1, MAX_SIDE), height.clamp(1, MAX_SIDE));
        let margin = 0.04 * f64::from(width.min(height));
        Self {
            width,
            height,
            insets: [margin; 4],
        }
    }

    /// Adds `pixels` \[px\] to the right margin, for a legend.
    pub fn with_right(mut self, pixels: f64) -> Self {
        self.insets[2] += pixels;
        self
    }

    /// Adds `pixels` \[px\] to the top margin, for a caption.
    pub fn with_top(mut self, pixels: f64) -> Self {
        self.insets[1] += pixels;
        self
    }

    /// Centre and size of the area for the scene \[px\]; the whole picture where the margins leave
    /// nothing.
    fn free(&self) -> ([f64; 2], [f64; 2]) {
        let [left, top, right, bottom] = self.insets.map(|inset| {
            if inset.is_finite() {
                inset.max(0.0)
            } else {
                0.0
            }
        });
        let along = |before: f64, after: f64, all: f64| {
            let size = all - before - after;
            if size >= 1.0 {
                (before + size / 2.0, size)
            } else {
                (all / 2.0, all)
            }
        };
        let (x, width) = along(left, right, f64::from(self.width));
        let (y, height) = along(top, bottom, f64::from(self.height));
        ([x, y], [width, height])
    }
}

/// The direction of a view. Its rays are parallel, so that lengths are comparable everywhere in the
/// picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// From the scene to the viewer, of any length; +z if zero or not finite.
    pub from: Vector3<f64>,
    /// Up direction in the picture, of any length; another axis if parallel to `from` or not
    /// finite.
    pub up: Vector3<f64>,
}

impl View {
    /// A view with parallel rays.
    pub fn orthographic(from: Vector3<f64>, up: Vector3<f64>) -> Self {
        Self { from, up }
    }

    /// Right, up and viewing direction, orthonormal.
    fn axes(&self) -> [Vector3<f64>; 3] {
        let back = unit(self.from).unwrap_or_else(Vector3::z);
        let level = |up: Vector3<f64>| {
            let side = unit(up)?.cross(&back);
            // Below this sine of the angle between them, `up` does not define a horizon.
            if side.norm() > 1e-6 { unit(side) } else { None }
        };
        let right = [self.up, Vector3::y(), Vector3::z()]
            .into_iter()
            .find_map(level)
            .unwrap_or_else(Vector3::x);
        [right, back.cross(&right), -back]
    }
}

/// A camera: maps points of space to pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub(super) canvas: Canvas,
    pub(super) eye: Point3<f64>,
    /// Right, up, viewing direction: orthonormal.
    pub(super) axes: [Vector3<f64>; 3],
    /// Pixels per metre.
    pub(super) scale: f64,
    /// The pixel of the point straight ahead.
    pub(super) centre: [f64; 2],
}

impl Camera {
    /// The camera with all `points` \[m\] in the free area of the canvas, as large as possible. For
    /// an animation, give the points of all frames. Points that are not finite, or whose squares
    /// are not, are left out. Without a point, or with all points at one place, the camera shows a
    /// cube of 1 m.
    pub fn fit(points: impl IntoIterator<Item = Point3<f64>>, view: &View, canvas: Canvas) -> Self {
        let canvas = Canvas {
            width: canvas.width.clamp(1, MAX_SIDE),
            height: canvas.height.clamp(1, MAX_SIDE),
            insets: canvas.insets,
        };
        let axes = view.axes();
        let far = f64::MAX.sqrt() / 8.0;
        let seen = |p: &Point3<f64>| p.coords.iter().all(|c| c.abs() <= far);
        let mut local: Vec<Vector3<f64>> = points
            .into_iter()
            .filter(seen)
            .map(|p| {
                Vector3::new(
                    axes[0].dot(&p.coords),
                    axes[1].dot(&p.coords),
                    axes[2].dot(&p.coords),
                )
            })
            .collect();
        if local.is_empty() {
            local.push(Vector3::zeros());
        }
        let (mut low, mut high) = extent(&local);
        if low == high {
            local.extend([low.add_scalar(-0.5), low.add_scalar(0.5)]);
            (low, high) = extent(&local);
        }
        let middle = (low + high) / 2.0;
        let half = (high - low) / 2.0;
        let origin = Point3::from(axes[0] * middle.x + axes[1] * middle.y + axes[2] * middle.z);
        let (centre, size) = canvas.free();
        let scale = [size[0] / 2.0 / half.x, size[1] / 2.0 / half.y]
            .into_iter()
            .filter(|s| s.is_finite())
            .fold(f64::INFINITY, f64::min);
        // All points on one line of sight: any scale fits; use their depth.
        let scale = if scale.is_finite() {
            scale
        } else {
            size[0].min(size[1]) / 2.0 / half.z
        };
        Self {
            canvas,
            eye: origin,
            axes,
            scale,
            centre,
        }
    }

    /// The size of the picture \[px\].
    pub fn canvas(&self) -> Canvas {
        self.canvas
    }

    /// The unit vector from the scene to the viewer, on the axis of the picture.
    pub fn towards_viewer(&self) -> Vector3<f64> {
        -self.axes[2]
    }

    /// Right and up of the picture, unit vectors in space.
    pub fn right_and_up(&self) -> [Vector3<f64>; 2] {
        [self.axes[0], self.axes[1]]
    }

    /// The pixel (right, down) \[px\] of a point and its depth along the line of sight \[m\].
    /// `None` for a point without a finite pixel.
    pub fn pixel(&self, point: &Point3<f64>) -> Option<([f64; 2], f64)> {
        let from_eye = point - self.eye;
        let depth = self.axes[2].dot(&from_eye);
        let x = self.centre[0] + self.scale * self.axes[0].dot(&from_eye);
        let y = self.centre[1] - self.scale * self.axes[1].dot(&from_eye);
        (x.is_finite() && y.is_finite() && depth.is_finite()).then_some(([x, y], depth))
    }
}

fn extent(points: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let mut low = Vector3::repeat(f64::INFINITY);
    let mut high = -low;
    for p in points {
        low = low.inf(p);
        high = high.sup(p);
    }
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point3<f64>> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(|[x, y, z]| Point3::new(x, y, z))
    }

    proptest! {
        /// Every point is in the free area of the canvas, and the fit is tight: some point touches
        /// its border.
        #[test]
        fn fits(points in prop::collection::vec(point(), 2..20), from in point(), up in point(),
                scale in prop::sample::select(vec![1e-6, 1.0, 1e6])) {
            let canvas = Canvas::new(320, 200).with_right(40.0);
            let view = View::orthographic(from.coords, up.coords);
            let camera = Camera::fit(points.iter().map(|p| p * scale), &view, canvas);
            let [left, top, right, bottom] = canvas.insets;
            let mut slack = f64::INFINITY;
            for p in &points {
                let pixel = camera.pixel(&(p * scale));
                prop_assert!(pixel.is_some());
                let Some(([x, y], _)) = pixel else { continue };
                let room = [x - left, 320.0 - right - x, y - top, 200.0 - bottom - y];
                prop_assert!(room.iter().all(|r| *r > -1e-6), "{:?}", room);
                slack = room.iter().copied().fold(slack, f64::min);
            }
            prop_assert!(slack < 1e-6, "loose by {}", slack);
        }
    }

    #[test]
    fn axes_are_a_right_handed_frame_for_any_view() {
        let odd = [0.0, 1.0, -1.0, f64::NAN, f64::INFINITY, 1e-300, 1e300];
        for &a in &odd {
            for &b in &odd {
                for &c in &odd {
                    let view = View::orthographic(Vector3::new(a, b, c), Vector3::new(c, b, a));
                    let [right, up, sight] = view.axes();
                    assert!((right.cross(&up) + sight).norm() < 1e-12, "{a} {b} {c}");
                    assert!((right.norm() - 1.0).abs() < 1e-12 && right.dot(&up).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn up_is_up_and_right_is_right() {
        let view = View::orthographic(Vector3::y(), Vector3::z());
        let corners = [Point3::new(-1.0, 0.0, -1.0), Point3::new(1.0, 0.0, 1.0)];
        let camera = Camera::fit(
            corners,
            &view,
            Canvas {
                width: 100,
                height: 100,
                insets: [0.0; 4],
            },
        );
        // Seen from +y with z up, +x is at the left.
        assert_eq!(
            camera.pixel(&Point3::new(-1.0, 0.0, 1.0)),
            Some(([100.0, 0.0], 0.0))
        );
    }

    #[test]
    fn nothing_to_see() {
        let view = View::orthographic(Vector3::z(), Vector3::y());
        for points in [
            vec![],
            vec![Point3::new(f64::NAN, 0.0, 0.0)],
            vec![Point3::new(3.0, 3.0, 3.0); 4],
        ] {
            let camera = Camera::fit(points, &view, Canvas::new(0, 70_000));
            assert_eq!(
                (camera.canvas().width, camera.canvas().height),
                (1, MAX_SIDE)
            );
            assert!(camera.scale.is_finite() && camera.scale > 0.0);
        }
    }
}
