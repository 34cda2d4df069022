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

/// Position and inverse mass of a particle side by side: x, y, z [m], w [1/kg]; half a cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Slot(pub [f64; 4]);

/// A copy of positions and inverse masses in the layout that sweeps over constraints are fast with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Packed {
    /// Shape `[count]`.
    pub slots: Vec<Slot>,
}

impl Packed {
    /// Copies positions and inverse masses from `particles`.
    pub fn read(&mut self, particles: &Particles) {
        let both = particles.position.iter().zip(&particles.inverse_mass);
        self.slots.clear();
        self.slots.extend(both.map(|(x, w)| Slot([x.x, x.y, x.z, *w])));
    }

    /// Copies the positions back to `particles`, which must be as many.
    pub fn write(&self, particles: &mut Particles) {
        for (x, Slot([a, b, c, _])) in particles.position.iter_mut().zip(&self.slots) {
            *x = Point3::new(*a, *b, *c);
        }
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.slots.capacity() * size_of::<Slot>()
    }
}
