//! The camera in the form of the graphics card.

use kiss3d::glamx::Mat4;
use kiss3d::prelude::{Camera3d, Canvas, Pose3, Vec3, WindowEvent};
use nalgebra::Matrix4;

use super::scene_nodes::pose;
use crate::camera::Camera;

/// A camera whose picture fills the left part of a window; the panel is on the right.
#[derive(Clone, Debug)]
pub struct Lens {
    pub camera: Camera,
    /// Width and height of the window [px].
    pub window: (f64, f64),
    /// Width of the panel [px].
    pub panel: f64,
}

impl Lens {
    /// From camera axes to the cube of the graphics card.
    fn matrix(&self) -> Mat4 {
        let (width, height) = (self.window.0.max(1.0), self.window.1.max(1.0));
        let projection = self.camera.projection(width / height);
        // The centre of the free part is the centre of the picture.
        let mut shifted = Matrix4::identity();
        shifted[(0, 3)] = -self.panel / width;
        // The graphics card uses depths of 0..1.
        (shifted[(2, 2)], shifted[(2, 3)]) = (0.5, 0.5);
        let all = shifted * projection;
        let mut columns = [0.0_f32; 16];
        columns
            .iter_mut()
            .zip(all.iter())
            .for_each(|(to, from)| *to = *from as f32);
        Mat4::from_cols_array(&columns)
    }
}

impl Camera3d for Lens {
    /// Other code handles mouse and keyboard.
    fn handle_event(&mut self, _: &Canvas, _: &WindowEvent) {}

    fn eye(&self) -> Vec3 {
        let eye = self.camera.eye();
        Vec3::new(eye.x as f32, eye.y as f32, eye.z as f32)
    }

    fn view_transform(&self) -> Pose3 {
        pose(&self.camera.view())
    }

    fn transformation(&self) -> Mat4 {
        self.matrix() * self.view_transform().to_mat4()
    }

    fn inverse_transformation(&self) -> Mat4 {
        self.transformation().inverse()
    }

    fn clip_planes(&self) -> (f32, f32) {
        let (near, far) = self.camera.planes();
        (near as f32, far as f32)
    }

    fn update(&mut self, _: &Canvas) {}

    fn view_transform_pair(&self, _: usize) -> (Pose3, Mat4) {
        (self.view_transform(), self.matrix())
    }
}
