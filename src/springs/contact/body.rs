//! A body that may touch others: a spring system with a surface, or a rigid surface that is driven.

use nalgebra::{Point3, Rotation3, Vector3};

use super::edges::{EdgeOwners, Sheet};
use super::hierarchy::Hierarchy;
use crate::contact::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::{Aabb, volume};
use crate::mesh::topology::Topology;
use crate::springs::system::{SpringSystem, SystemError};

/// Why a body is refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BodyError {
    /// A triangle names a point that does not exist.
    #[error("triangle {triangle} names point {point}, but there are {count} points")]
    OutOfRange {
        /// The triangle.
        triangle: usize,
        /// The point.
        point: u32,
        /// Number of points.
        count: usize,
    },
    /// A triangle names a point twice: an edge from a point to itself would be pushed with half of its mobility.
    #[error("triangle {triangle} names point {point} twice")]
    Twice {
        /// The triangle.
        triangle: usize,
        /// The point.
        point: u32,
    },
    /// A soft body cannot be driven: its forces move it.
    #[error("the body is soft: its forces move it, so it cannot be driven")]
    Soft,
    /// Nothing that could touch.
    #[error("the body has no triangles: nothing could touch it")]
    NoTriangles,
    /// A position that is not finite, or vertices that no system can have.
    #[error(transparent)]
    System(#[from] SystemError),
}

/// How a rigid body moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Velocity of the centre [m/s].
    pub linear: Vector3<f64>,
    /// Angular velocity [rad/s].
    pub angular: Vector3<f64>,
    /// What it turns about [m]; it goes with the body.
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

    /// Along a line, without turning.
    pub fn along(linear: Vector3<f64>) -> Self {
        Self {
            linear,
            ..Self::still()
        }
    }
}

/// A body of [`super::Bodies`].
pub struct Body {
    /// Its points, with what acts on them.
    pub system: SpringSystem,
    drive: Option<Drive>,
    triangles: Vec<[u32; 3]>,
    /// The points of the surface, ascending.
    points: Vec<u32>,
    hierarchy: Hierarchy,
    owners: EdgeOwners,
    /// The triangle across each side.
    neighbours: Vec<[Option<u32>; 3]>,
    /// Knows inside from outside, where the surface is closed and turned outward.
    closed: Option<Surface>,
}

impl Body {
    /// A spring system whose surface is `triangles`. Only a closed surface that is turned outward has an inside; any other is
    /// met by its edges and triangles alone.
    ///
    /// # Errors
    /// No triangles, or one of points that do not exist or are the same; numbers that are not finite.
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
            hierarchy: Hierarchy::new(&system.position, triangles),
            owners: EdgeOwners::new(count, triangles),
            neighbours: (0..triangles.len())
                .map(|t| topology.neighbours_of_triangle(t))
                .collect(),
            closed: has_inside.then(|| Surface::new(&mesh)),
            triangles: mesh.triangles,
            points,
            drive: None,
            system,
        })
    }

    /// A rigid surface. What touches it cannot move it.
    ///
    /// # Errors
    /// As [`Self::soft`].
    pub fn rigid(mesh: &TriangleMesh, drive: Drive) -> Result<Self, BodyError> {
        let count = mesh.vertices.len();
        // Masses are asked for, and count nowhere: all points are held.
        let mut system = SpringSystem::new(mesh.vertices.clone(), vec![1.0; count])?;
        system.pin(0..count as u32);
        Ok(Self {
            drive: Some(drive),
            ..Self::soft(system, &mesh.triangles)?
        })
    }

    /// How it moves, if it is rigid.
    pub fn drive(&self) -> Option<Drive> {
        self.drive
    }

    /// Lets a rigid body move otherwise from now on.
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

    /// 1/m of a point [1/kg]; 0 where it is held.
    pub fn inverse_mass(&self, point: u32) -> f64 {
        if self.system.pinned()[point as usize] {
            0.0
        } else {
            1.0 / self.system.mass()[point as usize]
        }
    }

    /// The points of a rigid body take its velocity.
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

    /// A rigid body goes on by a step of `dt` [s], without losing its shape.
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

    /// Boxes follow the points.
    pub(super) fn refit(&mut self) {
        self.hierarchy.refit(&self.system.position, &self.triangles);
    }

    /// Inside and outside follow the points.
    pub(super) fn refit_inside(&mut self) {
        self.closed
            .iter_mut()
            .for_each(|s| s.refit(&self.system.position));
    }

    /// Unit normal of a triangle; `None` for one without area.
    pub(super) fn normal(&self, triangle: u32) -> Option<Vector3<f64>> {
        let [a, b, c] = self.triangles[triangle as usize].map(|v| self.system.position[v as usize]);
        (b - a).cross(&(c - a)).try_normalize(0.0)
    }

    /// Unit direction out of a closed surface at a side of a triangle: between those of the two triangles there.
    pub(super) fn normal_of_side(&self, (triangle, side): (u32, usize)) -> Option<Vector3<f64>> {
        self.closed.as_ref()?;
        let across = self.neighbours[triangle as usize][side]?;
        // Triangles folded onto each other leave no direction but rounding's.
        (self.normal(triangle)? + self.normal(across)?).try_normalize(1e-6)
    }

    pub(super) fn bounds(&self) -> Aabb {
        self.hierarchy.bounds()
    }

    pub(super) fn inside(&self) -> Option<&Surface> {
        self.closed.as_ref()
    }

    pub(super) fn sheet(&self) -> Sheet<'_> {
        Sheet {
            x: &self.system.position,
            triangles: &self.triangles,
            hierarchy: &self.hierarchy,
            owners: &self.owners,
        }
    }
}
