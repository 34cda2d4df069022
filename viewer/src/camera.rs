//! A camera that turns about its target: orbit, pan, roll and zoom, projection and rays.

use nalgebra::{
    Isometry3, Matrix4, Perspective3, Point2, Point3, Translation3, Unit, UnitQuaternion, Vector2,
    Vector3,
};

use pliant::mesh::measures::Aabb;

/// Height of the field of view [rad].
pub const FIELD: f64 = std::f64::consts::FRAC_PI_4;

/// Angle of a drag over the whole height of the window [rad].
const TURN: f64 = std::f64::consts::PI;

/// Least and greatest distance of the camera from its target, relative to the size of the fitted
/// bodies.
const REACH: (f64, f64) = (0.01, 20.0);

/// A perspective camera. Screen coordinates are relative to the height, from the centre to the
/// right and up.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// The target and centre of rotation [m].
    pub target: Point3<f64>,
    /// From camera axes (x right, y up, looking along -z) to world axes.
    pub rotation: UnitQuaternion<f64>,
    /// Distance from the target [m].
    pub distance: f64,
    /// Size of the fitted bodies [m].
    size: f64,
    home: Option<Box<Self>>,
}

impl Camera {
    /// Shows all of `bounds` from a direction, with `up` at the top.
    pub fn fit(bounds: &Aabb, from: Vector3<f64>, up: Vector3<f64>) -> Self {
        let size = bounds.extents().norm();
        // Bodies without size are seen from a metre.
        let size = if size.is_finite() && size > 0.0 {
            size
        } else {
            1.0
        };
        let along = from.try_normalize(0.0).unwrap_or_else(Vector3::z);
        // Another direction replaces an `up` along the view.
        let up = if along.cross(&up).norm() > 0.0 {
            up
        } else {
            Vector3::new(along.z, along.x, along.y)
        };
        // The view direction is -z.
        let rotation = UnitQuaternion::face_towards(&along, &up);
        let distance = 0.5 * size / libm::sin(0.5 * FIELD);
        let camera = Self {
            target: nalgebra::center(&bounds.min, &bounds.max),
            rotation,
            distance,
            size,
            home: None,
        };
        Self {
            home: Some(Box::new(camera.clone())),
            ..camera
        }
    }

    /// The fitted camera for a window with this aspect ratio: farther away for a narrow one.
    #[must_use]
    pub fn in_window(mut self, aspect: f64) -> Self {
        if aspect > 0.0 && aspect < 1.0 {
            self.home = None;
            self.zoom(1.0 / aspect);
            self.home = Some(Box::new(self.clone()));
        }
        self
    }

    /// The same distance and target, from another direction.
    #[must_use]
    pub fn seen_from(&self, from: Vector3<f64>, up: Vector3<f64>) -> Self {
        let nothing = Aabb {
            min: self.target,
            max: self.target,
        };
        Self {
            rotation: Self::fit(&nothing, from, up).rotation,
            ..self.clone()
        }
    }

    /// Restores the fitted camera.
    pub fn reset(&mut self) {
        if let Some(home) = self.home.clone() {
            *self = Self {
                home: Some(home.clone()),
                ..*home
            };
        }
    }

    /// Position of the eye [m].
    pub fn eye(&self) -> Point3<f64> {
        self.target + self.rotation * Vector3::z() * self.distance
    }

    /// Rotates about the target by a motion of the pointer.
    pub fn orbit(&mut self, by: Vector2<f64>) {
        let turn = by * TURN;
        let [across, up] = [Vector3::y_axis(), Vector3::x_axis()];
        self.turn(
            UnitQuaternion::from_axis_angle(&across, -turn.x)
                * UnitQuaternion::from_axis_angle(&up, turn.y),
        );
    }

    /// Rotates about the line of sight by an angle [rad], the picture counter-clockwise.
    pub fn roll(&mut self, angle: f64) {
        self.turn(UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -angle));
    }

    fn turn(&mut self, own: UnitQuaternion<f64>) {
        // Normalised, so that rounding does not add up over thousands of motions.
        self.rotation = UnitQuaternion::new_normalize((self.rotation * own).into_inner());
    }

    /// Moves so that the plane of the target follows the pointer.
    pub fn pan(&mut self, by: Vector2<f64>) {
        self.target -= self.in_world(by);
    }

    /// A motion on the screen as a motion in the plane of the target [m].
    pub fn in_world(&self, by: Vector2<f64>) -> Vector3<f64> {
        self.in_plane_at(&self.target, by)
    }

    /// A motion on the screen as a motion of a point, in the parallel plane through it [m].
    pub fn in_plane_at(&self, point: &Point3<f64>, by: Vector2<f64>) -> Vector3<f64> {
        let depth = (self.eye() - point).dot(&(self.rotation * Vector3::z()));
        self.rotation * Vector3::new(by.x, by.y, 0.0) * (2.0 * depth * libm::tan(0.5 * FIELD))
    }

    /// Moves nearer for a factor below 1, farther for a factor above.
    pub fn zoom(&mut self, factor: f64) {
        if factor.is_finite() && factor > 0.0 {
            self.distance =
                (self.distance * factor).clamp(REACH.0 * self.size, REACH.1 * self.size);
        }
    }

    /// From world to camera axes.
    pub fn view(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.eye().coords), self.rotation).inverse()
    }

    /// Nearest and farthest visible depth [m].
    pub fn planes(&self) -> (f64, f64) {
        let far = self.distance + 4.0 * self.size;
        ((self.distance - 2.0 * self.size).max(1e-3 * self.size), far)
    }

    /// From camera axes to the cube -1..1, for a window with this aspect ratio.
    pub fn projection(&self, aspect: f64) -> Matrix4<f64> {
        let (near, far) = self.planes();
        Perspective3::new(aspect, FIELD, near, far).to_homogeneous()
    }

    /// Screen position of a point; `None` behind the eye.
    pub fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        let seen = self.view() * point;
        let scale = 0.5 / libm::tan(0.5 * FIELD);
        (seen.z < 0.0).then(|| Point2::new(-seen.x / seen.z, -seen.y / seen.z) * scale)
    }

    /// The ray through a screen position: origin and direction.
    pub fn ray(&self, at: Point2<f64>) -> (Point3<f64>, Unit<Vector3<f64>>) {
        let tall = 2.0 * libm::tan(0.5 * FIELD);
        let direction = self.rotation * Vector3::new(at.x * tall, at.y * tall, -1.0);
        (self.eye(), Unit::new_normalize(direction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let bounds = Aabb {
            min: Point3::new(0.1, -0.2, 0.3),
            max: Point3::new(0.3, 0.2, 0.35),
        };
        Camera::fit(&bounds, Vector3::new(1.0, 0.3, 2.0), Vector3::y())
    }

    fn corners() -> Vec<Point3<f64>> {
        Aabb {
            min: Point3::new(0.1, -0.2, 0.3),
            max: Point3::new(0.3, 0.2, 0.35),
        }
        .corners()
        .to_vec()
    }

    #[test]
    fn what_it_is_fitted_to_is_seen_upright() {
        let camera = camera();
        let seen: Vec<_> = corners().iter().filter_map(|p| camera.project(p)).collect();
        assert_eq!(seen.len(), 8);
        assert!(
            seen.iter().all(|p| p.x.abs() <= 0.5 && p.y.abs() <= 0.5),
            "{seen:?}"
        );
        assert!(seen.iter().any(|p| p.y.abs() > 0.2), "too small: {seen:?}");
        let [low, high] =
            [-0.2, 0.2].map(|y| camera.project(&Point3::new(0.2, y, 0.3)).expect("seen"));
        assert!(high.y > low.y && (high.x - low.x).abs() < 0.05 * (high.y - low.y));
        let right = camera
            .project(&(camera.target + camera.rotation * Vector3::x() * 0.1))
            .expect("seen");
        assert!(right.x > 0.0 && right.y.abs() < 1e-12);
        assert!(
            (camera.view() * camera.target - Point3::new(0.0, 0.0, -camera.distance)).norm()
                < 1e-12
        );
    }

    #[test]
    fn a_ray_goes_through_what_is_seen_there() {
        let mut camera = camera();
        camera.orbit(Vector2::new(0.3, -0.2));
        camera.roll(0.4);
        camera.pan(Vector2::new(0.1, 0.05));
        for point in corners() {
            let (eye, along) = camera.ray(camera.project(&point).expect("seen"));
            let off = (point - eye).cross(&along).norm();
            assert!(off < 1e-12, "{off}");
        }
        // The matrices for the graphics card agree.
        let p = corners()[3];
        let clip = camera.projection(1.5) * (camera.view() * p).to_homogeneous();
        let seen = camera.project(&p).expect("seen");
        assert!(
            (clip.x / clip.w * 0.5 * 1.5 - seen.x).abs() < 1e-12
                && (clip.y / clip.w * 0.5 - seen.y).abs() < 1e-12
        );
        assert!(
            camera
                .project(&(camera.eye() + camera.rotation * Vector3::z()))
                .is_none(),
            "behind"
        );
    }

    #[test]
    fn what_is_under_the_hand_follows_it() {
        let mut panned = camera();
        let by = Vector2::new(0.07, -0.11);
        let before = panned.project(&panned.target).expect("seen");
        let target = panned.target;
        panned.pan(by);
        let after = panned.project(&target).expect("seen");
        assert!((after - before - by).norm() < 1e-12);
        let camera = camera();
        let p = corners()[5];
        let moved = p + camera.in_plane_at(&p, by);
        let [before, after] = [p, moved].map(|p| camera.project(&p).expect("seen"));
        assert!((after - before - by).norm() < 1e-12);
        let mut orbited = camera.clone();
        let near = orbited.target + orbited.rotation * Vector3::z() * 0.01;
        orbited.orbit(Vector2::new(0.01, 0.02));
        let seen = orbited.project(&near).expect("seen");
        assert!(
            seen.x > 0.0 && seen.y > 0.0,
            "what is in front goes with the hand: {seen}"
        );
        assert!((orbited.eye() - orbited.target).norm() - camera.distance < 1e-12);
    }

    #[test]
    fn roll_zoom_and_reset() {
        let start = camera();
        let mut camera = start.clone();
        let above = camera.target + camera.rotation * Vector3::y() * 0.1;
        camera.roll(0.3);
        let seen = camera.project(&above).expect("seen");
        assert!(
            (libm::atan2(-seen.x, seen.y) - 0.3).abs() < 1e-9,
            "against the clock: {seen}"
        );
        for _ in 0..200 {
            camera.zoom(0.5);
        }
        assert!(camera.distance > 0.0 && camera.planes().0 > 0.0);
        (0..200).for_each(|_| camera.zoom(3.0));
        camera.zoom(f64::NAN);
        camera.zoom(-1.0);
        assert!(camera.distance.is_finite());
        assert_ne!(camera, start);
        camera.reset();
        assert_eq!(camera, start);
        camera.orbit(Vector2::new(0.1, 0.1));
        camera.reset();
        assert_eq!(camera, start, "as often as one likes");
    }

    #[test]
    fn a_narrow_window_shows_all_as_well() {
        for aspect in [0.3, 0.8, 2.0] {
            let mut camera = camera().in_window(aspect);
            let seen: Vec<_> = corners().iter().filter_map(|p| camera.project(p)).collect();
            assert!(
                seen.iter()
                    .all(|p| p.x.abs() <= 0.5 * aspect.min(1.0) && p.y.abs() <= 0.5),
                "{aspect}: {seen:?}"
            );
            let fitted = camera.clone();
            camera.zoom(0.5);
            camera.reset();
            assert_eq!(camera, fitted);
        }
    }

    #[test]
    fn nothing_and_odd_directions_have_a_view() {
        let nothing = Aabb {
            min: Point3::origin(),
            max: Point3::origin(),
        };
        for (from, up) in [
            (Vector3::y(), Vector3::y()),
            (Vector3::zeros(), Vector3::y()),
            (Vector3::x(), Vector3::zeros()),
        ] {
            let camera = Camera::fit(&nothing, from, up);
            assert!(
                camera.eye().coords.iter().all(|c| c.is_finite()),
                "{from} {up}"
            );
            assert!(camera.project(&Point3::origin()).is_some());
        }
    }
}
