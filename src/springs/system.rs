//! Points with masses, and the forces on them.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::force::Force;
use crate::mesh::sum::tree_sum_by;
use crate::particles::is_shared;

/// Error of a system.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SystemError {
    /// There are no points.
    #[error("the system has no points")]
    Empty,
    /// The numbers of masses and points differ.
    #[error("{masses} masses for {points} points")]
    Masses {
        /// Number of masses.
        masses: usize,
        /// Number of points.
        points: usize,
    },
    /// A mass is not positive and finite.
    #[error("point {point} has the mass {mass} kg; a positive one is needed")]
    Mass {
        /// Index of the point.
        point: usize,
        /// The mass [kg].
        mass: f64,
    },
    /// A coordinate is not finite.
    #[error("point {point} has a coordinate that is not finite")]
    NotFinite {
        /// Index of the point.
        point: usize,
    },
    /// A force acts on a point that does not exist.
    #[error("{force} act on point {point}, but there are {count} points")]
    OutOfRange {
        /// Name of the force.
        force: &'static str,
        /// Index of the point.
        point: u32,
        /// Number of points.
        count: usize,
    },
}

/// Energy of a system [J].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpringEnergy {
    /// Kinetic energy.
    pub kinetic: f64,
    /// Stored in springs and volumes.
    pub stored: f64,
    /// Energy of the loads: minus force times position.
    pub loads: f64,
}

impl SpringEnergy {
    /// Total energy [J]; constant without damping.
    pub fn total(self) -> f64 {
        self.kinetic + self.stored + self.loads
    }
}

/// A mass-spring system: `m x'' + c x' = forces + load` for all points that are not pinned.
pub struct SpringSystem {
    /// Positions [m], shape `[point_count]`.
    pub position: Vec<Point3<f64>>,
    /// Velocities [m/s], shape `[point_count]`; those of pinned points are 0.
    pub velocity: Vec<Vector3<f64>>,
    /// Damping coefficient of each point, c [N s/m].
    pub damping: f64,
    /// Constant force on each point [N], shape `[point_count]`, or empty for none.
    pub load: Vec<Vector3<f64>>,
    mass: Vec<f64>,
    pinned: Vec<bool>,
    forces: Vec<Box<dyn Force>>,
}

impl SpringSystem {
    /// Creates points at rest with masses [kg], without forces.
    ///
    /// # Errors
    /// No points, another number of masses, a mass that is not positive, or a coordinate that is
    /// not finite.
    pub fn new(position: Vec<Point3<f64>>, mass: Vec<f64>) -> Result<Self, SystemError> {
        let points = position.len();
        if points == 0 {
            return Err(SystemError::Empty);
        }
        if mass.len() != points {
            return Err(SystemError::Masses {
                masses: mass.len(),
                points,
            });
        }
        if let Some(point) = mass.iter().position(|m| !(*m > 0.0 && m.is_finite())) {
            return Err(SystemError::Mass {
                point,
                mass: mass[point],
            });
        }
        if let Some(point) = position
            .iter()
            .position(|p| !p.coords.iter().all(|c| c.is_finite()))
        {
            return Err(SystemError::NotFinite { point });
        }
        let (velocity, pinned) = (vec![Vector3::zeros(); points], vec![false; points]);
        Ok(Self {
            position,
            velocity,
            damping: 0.0,
            load: Vec::new(),
            mass,
            pinned,
            forces: Vec::new(),
        })
    }

    /// Adds a force.
    ///
    /// # Errors
    /// A force on a point that does not exist.
    pub fn add(&mut self, force: impl Force + 'static) -> Result<(), SystemError> {
        let count = self.len();
        match force.highest_point() {
            Some(point) if point as usize >= count => Err(SystemError::OutOfRange {
                force: force.name(),
                point,
                count,
            }),
            _ => {
                self.forces.push(Box::new(force));
                Ok(())
            }
        }
    }

    /// Fixes points at their positions; indices out of range are ignored.
    pub fn pin(&mut self, points: impl IntoIterator<Item = u32>) {
        for p in points {
            let p = p as usize;
            if p < self.len() {
                self.pinned[p] = true;
                self.velocity[p] = Vector3::zeros();
            }
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Always false: a system has at least one point.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Masses [kg], shape `[point_count]`.
    pub fn mass(&self) -> &[f64] {
        &self.mass
    }

    /// True for each fixed point, shape `[point_count]`.
    pub fn pinned(&self) -> &[bool] {
        &self.pinned
    }

    /// The forces in the order of their addition.
    pub fn forces(&self) -> &[Box<dyn Force>] {
        &self.forces
    }

    /// Forces without damping on each point at positions `x` [N]; 0 for pinned points.
    pub fn static_force(&self, x: &[Point3<f64>], force: &mut Vec<Vector3<f64>>) {
        force.clear();
        force.extend((0..self.len()).map(|i| self.load.get(i).copied().unwrap_or_default()));
        self.forces.iter().for_each(|f| f.add_force(x, force));
        force
            .iter_mut()
            .zip(&self.pinned)
            .filter(|(_, pinned)| **pinned)
            .for_each(|(f, _)| *f = Vector3::zeros());
    }

    /// Accelerations at positions `x` and velocities `v` [m/s2]; 0 for pinned points.
    pub fn acceleration(
        &self,
        x: &[Point3<f64>],
        v: &[Vector3<f64>],
        acceleration: &mut Vec<Vector3<f64>>,
    ) {
        self.static_force(x, acceleration);
        let one = |i: usize, a: &mut Vector3<f64>| {
            *a = if self.pinned[i] {
                Vector3::zeros()
            } else {
                (*a - v[i] * self.damping) / self.mass[i]
            };
        };
        if is_shared(self.len()) {
            acceleration
                .par_iter_mut()
                .enumerate()
                .for_each(|(i, a)| one(i, a));
        } else {
            acceleration
                .iter_mut()
                .enumerate()
                .for_each(|(i, a)| one(i, a));
        }
    }

    /// K p at positions `x` [N], without the rows and columns of pinned points. `free` is a work
    /// array.
    pub fn product(
        &self,
        x: &[Point3<f64>],
        p: &[Vector3<f64>],
        definite: bool,
        free: &mut Vec<Vector3<f64>>,
        product: &mut Vec<Vector3<f64>>,
    ) {
        let zero = Vector3::zeros();
        free.clear();
        free.extend(
            p.iter()
                .zip(&self.pinned)
                .map(|(p, pinned)| if *pinned { zero } else { *p }),
        );
        product.clear();
        product.resize(self.len(), zero);
        self.forces
            .iter()
            .for_each(|f| f.add_product(x, free, definite, product));
        product
            .iter_mut()
            .zip(&self.pinned)
            .filter(|(_, pinned)| **pinned)
            .for_each(|(f, _)| *f = zero);
    }

    /// Energy at the present positions and velocities.
    pub fn energy(&self) -> SpringEnergy {
        let kinetic = tree_sum_by(self.len(), |i| {
            0.5 * self.mass[i] * self.velocity[i].norm_squared()
        });
        let stored = self.forces.iter().map(|f| f.energy(&self.position)).sum();
        let loads = tree_sum_by(self.load.len().min(self.len()), |i| {
            -self.load[i].dot(&self.position[i].coords)
        });
        SpringEnergy {
            kinetic,
            stored,
            loads,
        }
    }

    /// The first point whose position or velocity is not finite.
    pub fn first_non_finite(&self) -> Option<usize> {
        let finite = |i: usize| {
            self.position[i]
                .coords
                .iter()
                .chain(self.velocity[i].iter())
                .all(|c| c.is_finite())
        };
        (0..self.len()).find(|&i| !finite(i))
    }
}
