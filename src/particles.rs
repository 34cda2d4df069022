//! Positions, velocities and inverse masses of a body, as arrays.

use nalgebra::{Point3, Vector3};

/// The state of a body's particles; all arrays have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Particles {
    /// Positions [m], shape `[count]`.
    pub position: Vec<Point3<f64>>,
    /// Velocities [m/s], shape `[count]`.
    pub velocity: Vec<Vector3<f64>>,
    /// Inverse masses [1/kg], shape `[count]`; zero holds a particle where it is put.
    pub inverse_mass: Vec<f64>,
}

impl Particles {
    /// Particles at rest.
    pub fn at_rest(position: Vec<Point3<f64>>, inverse_mass: Vec<f64>) -> Self {
        assert_eq!(position.len(), inverse_mass.len(), "one inverse mass for each position");
        Self { velocity: vec![Vector3::zeros(); position.len()], position, inverse_mass }
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// The first particle with a position or velocity that is not finite.
    pub fn first_non_finite(&self) -> Option<usize> {
        let finite = |v: &Vector3<f64>| v.iter().all(|c| c.is_finite());
        self.position.iter().zip(&self.velocity).position(|(x, v)| !(finite(&x.coords) && finite(v)))
    }
}
