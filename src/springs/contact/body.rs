//! A body for contact: a spring system with a surface, or a rigid surface with a given motion.

use nalgebra::{Point3, Rotation3, Vector3};

use super::edges::{EdgeOwners, Sheet};
use crate::contact::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::{Aabb, volume};
use crate::mesh::topology::Topology;
use crate::springs::system::{SpringSystem, SystemError};

/// Error of a body.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BodyError {
    /// A triangle refers to a point that does not exist.
    #[error("triangle {triangle} names point {point}, but there are {count} points")]
    OutOfRange {
        /// Index of the triangle.
        triangle: usize,
        /// Index of the point.
        point: u32,
        /// Number of points.
        count: usize,
    },
    /// A triangle refers to a point twice: an edge from a point to itself would have half of its
    /// mobility.
    #[error("triangle {triangle} names point {point} twice")]
    Twice {
        /// Index of the triangle.
        triangle: usize,
        /// Index of the point.
        point: u32,
    },
    /// A soft body cannot have a given motion: its forces move it.
    #[error("the body is soft: its forces move it, so it cannot be driven")]
    Soft,
    /// The body has no triangles.
    #[error("the body has no triangles: nothing could touch it")]
    NoTriangles,
    /// A position is not finite, or the vertices form no valid system.
    #[error(transparent)]
    System(#[from] SystemError),
}

/// Motion of a rigid body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Velocity of the centre [m/s].
    pub linear: Vector3<f64>,
    /// Angular velocity [rad/s].
    pub angular: Vector3<f64>,
    /// Centre of rotation [m]; it moves with the body.
    pub centre: Point3<f64>,
}

impl Drive {
    /// At rest.
    pub fn still() -> Self {
        Self {
            linear: Vector3::zeros(),
            angular: Vector3::zeros(),
            centre: Point3::origin(),
        }
    }

    /// A translation without rotation.
    pub fn along(linear: Vector3<f64>) -> Self {
        Self {
            linear,
            ..Self::still()
        }
    }
}

/// A body of [`super::Bodies`].
pub struct CollidingBody {
    /// Points and forces of the body.
    pub system: SpringSystem,
    drive: Option<Drive>,
    triangles: Vec<[u32; 3]>,
    /// The points of the surface, ascending.
    points: Vec<u32>,
    /// The box of the points, at the last [`CollidingBody::bound`] [m].
    bounds: Aabb,
    /// Detection, at the positions of the last [`CollidingBody::refit`].
    surface: Surface,
    owners: EdgeOwners,
    /// The triangle across each side of each triangle.
    neighbours: Vec<[Option<u32>; 3]>,
    /// True for a closed surface with outward orientation.
    has_inside: bool,
}

impl CollidingBody {
    /// Creates a spring system with the surface `triangles`. Only a closed, outward surface has an
    /// inside; any other touches with its edges and triangles alone.
    ///
    /// # Errors
    /// No triangles, a triangle with missing or equal points, or numbers that are not finite.
    pub fn soft(system: SpringSystem, triangles: &[[u32; 3]]) -> Result<Self, BodyError> {
        let count = system.len();
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&point) = corners.iter().find(|&&p| p as usize >= count) {
                return Err(BodyError::OutOfRange {
                    triangle,
                    point,
                    count,
                });
            }
            let [a, b, c] = *corners;
            if a == b || b == c || c == a {
                return Err(BodyError::Twice {
                    triangle,
                    point: if b == c { b } else { a },
                });
            }
        }
        if triangles.is_empty() {
            return Err(BodyError::NoTriangles);
        }
        if let Some(point) = system.first_non_finite() {
            return Err(SystemError::NotFinite { point }.into());
        }
        let topology = Topology::of_triangles(count, triangles);
        let mesh = TriangleMesh {
            vertices: system.position.clone(),
            triangles: triangles.to_vec(),
        };
        let has_inside = topology.is_closed() && topology.is_oriented() && mesh.volume() > 0.0;
        let mut points: Vec<u32> = triangles.iter().flatten().copied().collect();
        points.sort_unstable();
        points.dedup();
        Ok(Self {
            owners: EdgeOwners::new(count, triangles),
            neighbours: (0..triangles.len())
                .map(|t| topology.neighbours_of_triangle(t))
                .collect(),
            bounds: mesh.bounding_box(),
            surface: Surface::new(&mesh),
            has_inside,
            triangles: mesh.triangles,
            points,
            drive: None,
            system,
        })
    }

    /// Creates a rigid surface. Contacts cannot move it.
    ///
    /// # Errors
    /// Those of [`Self::soft`].
    pub fn rigid(mesh: &TriangleMesh, drive: Drive) -> Result<Self, BodyError> {
        let count = mesh.vertices.len();
        // The system needs masses, but they have no effect: all points are fixed.
        let mut system = SpringSystem::new(mesh.vertices.clone(), vec![1.0; count])?;
        system.pin(0..count as u32);
        Ok(Self {
            drive: Some(drive),
            ..Self::soft(system, &mesh.triangles)?
        })
    }

    /// The motion of a rigid body.
    pub fn drive(&self) -> Option<Drive> {
        self.drive
    }

    /// Sets another motion of a rigid body.
    ///
    /// # Errors
    /// A soft body.
    pub fn set_drive(&mut self, drive: Drive) -> Result<(), BodyError> {
        *self.drive.as_mut().ok_or(BodyError::Soft)? = drive;
        Ok(())
    }

    /// The triangles of the surface.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The points of the surface, ascending.
    pub fn points(&self) -> &[u32] {
        &self.points
    }

    /// The enclosed volume [m3].
    pub fn volume(&self) -> f64 {
        volume(&self.system.position, &self.triangles)
    }

    /// Inverse mass of a point [1/kg]; 0 for a fixed point.
    pub fn inverse_mass(&self, point: u32) -> f64 {
        if self.system.pinned()[point as usize] {
            0.0
        } else {
            1.0 / self.system.mass()[point as usize]
        }
    }

    /// Sets the points of a rigid body to its velocity.
    pub(super) fn begin_step(&mut self) {
        if let Some(Drive {
            linear,
            angular,
            centre,
        }) = self.drive
        {
            let SpringSystem {
                position, velocity, ..
            } = &mut self.system;
            velocity
                .iter_mut()
                .zip(position)
                .for_each(|(v, x)| *v = linear + angular.cross(&(*x - centre)));
        }
    }

    /// Moves a rigid body by a step of `dt` [s] without a change of shape.
    pub(super) fn carry(&mut self, dt: f64) {
        if let Some(drive) = &mut self.drive {
            let (from, by) = (
                drive.centre,
                Rotation3::from_scaled_axis(drive.angular * dt),
            );
            drive.centre += drive.linear * dt;
            let to = drive.centre;
            let turns = drive.angular != Vector3::zeros();
            let go = |x: &Point3<f64>| {
                if turns {
                    to + by * (x - from)
                } else {
                    x + drive.linear * dt
                }
            };
            self.system.position.iter_mut().for_each(|x| *x = go(x));
        }
    }

    /// Updates the box.
    pub(super) fn bound(&mut self) {
        let points = self.points.iter();
        self.bounds = Aabb::of_points(points.map(|&v| &self.system.position[v as usize]));
    }

    /// Updates the surface.
    pub(super) fn refit(&mut self) {
        self.surface.refit(&self.system.position);
    }

    /// Unit normal of a triangle; `None` for one without area.
    pub(super) fn normal(&self, triangle: u32) -> Option<Vector3<f64>> {
        let [a, b, c] = self.triangles[triangle as usize].map(|v| self.system.position[v as usize]);
        (b - a).cross(&(c - a)).try_normalize(0.0)
    }

    /// Unit direction out of a closed surface at a side of a triangle: the mean of the normals of
    /// its two triangles.
    pub(super) fn normal_of_side(&self, (triangle, side): (u32, usize)) -> Option<Vector3<f64>> {
        self.inside()?;
        let across = self.neighbours[triangle as usize][side]?;
        // Triangles folded onto each other define no direction.
        (self.normal(triangle)? + self.normal(across)?).try_normalize(1e-6)
    }

    pub(super) fn bounds(&self) -> Aabb {
        self.bounds
    }

    pub(super) fn surface(&self) -> &Surface {
        &self.surface
    }

    /// The surface, if it has an inside.
    pub(super) fn inside(&self) -> Option<&Surface> {
        self.has_inside.then_some(&self.surface)
    }

    pub(super) fn sheet(&self) -> Sheet<'_> {
        Sheet {
            x: &self.system.position,
            triangles: &self.triangles,
            owners: &self.owners,
        }
    }
}
