//! A surface that takes part in the parting: positions, hierarchy, shape.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::contact::surface::Surface;
use crate::contact::untangle::Shape;
use crate::contact::Obstacle;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::Aabb;
use crate::mesh::topology::Topology;
use crate::particles::Particles;

/// A soft or rigid surface in the common frame.
pub(super) struct Solid {
    /// Name of the muscle or bone.
    pub name: String,
    /// Positions, and inverse masses without unit: 1 for a vertex that may move freely, 0 for one
    /// that is fixed.
    pub particles: Particles,
    /// The surface at the last refit.
    pub surface: Surface,
    /// Connectivity.
    pub topology: Topology,
    /// Unit normals of the vertices at the last refit.
    pub normals: Vec<Vector3<f64>>,
    /// Bounds at the last refit [m].
    pub bounds: Aabb,
    /// The constraints that keep a soft shape; `None` for a bone.
    pub shape: Option<Shape>,
    /// Positions at the start [m].
    pub start: Vec<Point3<f64>>,
    /// Enclosed volume at the start [m^3].
    pub volume: f64,
    /// Sum over the rounds of the greatest motion of a vertex [m].
    pub travelled: f64,
}

impl Solid {
    /// A muscle; `inverse_mass` of 0 fixes a vertex.
    pub fn soft(name: &str, mesh: &TriangleMesh, inverse_mass: Vec<f64>) -> Self {
        Self {
            shape: Some(Shape::new(mesh)),
            particles: Particles::at_rest(mesh.vertices.clone(), inverse_mass),
            ..Self::rigid(name, mesh, &Isometry3::identity())
        }
    }

    /// A bone at a pose.
    pub fn rigid(name: &str, mesh: &TriangleMesh, pose: &Isometry3<f64>) -> Self {
        let vertices = mesh.vertices.iter().map(|v| pose * v).collect();
        let mesh = TriangleMesh {
            vertices,
            triangles: mesh.triangles.clone(),
        };
        let count = mesh.vertices.len();
        Self {
            name: name.to_owned(),
            particles: Particles::at_rest(mesh.vertices.clone(), vec![0.0; count]),
            surface: Surface::new(&mesh),
            topology: Topology::new(&mesh),
            normals: mesh.vertex_normals(),
            bounds: mesh.bounding_box(),
            shape: None,
            volume: mesh.volume(),
            start: mesh.vertices,
            travelled: 0.0,
        }
    }

    /// Present positions [m].
    pub fn x(&self) -> &[Point3<f64>] {
        &self.particles.position
    }

    /// The triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        self.surface.triangles()
    }

    /// Corners of a triangle at the present positions [m].
    pub fn corners(&self, triangle: u32) -> [Point3<f64>; 3] {
        self.triangles()[triangle as usize].map(|v| self.particles.position[v as usize])
    }

    /// True if no vertex can move.
    pub fn is_rigid(&self) -> bool {
        self.shape.is_none()
    }

    /// Brings the hierarchy to the present positions.
    pub fn refit(&mut self) {
        if self.is_rigid() {
            return;
        }
        let moved = self.surface.positions().iter().zip(self.x());
        let farthest = crate::mesh::measures::max_or_nan(moved.map(|(a, b)| (a - b).norm()));
        self.travelled += farthest;
        if farthest > 0.0 {
            self.surface.refit(&self.particles.position);
            self.bounds = self.surface.bounding_box();
            self.normals = self.mesh().vertex_normals();
        }
    }

    /// Enclosed volume at the present positions [m^3].
    pub fn present_volume(&self) -> f64 {
        crate::mesh::measures::volume(self.x(), self.triangles())
    }

    /// The present mesh.
    pub fn mesh(&self) -> TriangleMesh {
        TriangleMesh {
            vertices: self.x().to_vec(),
            triangles: self.triangles().to_vec(),
        }
    }
}
