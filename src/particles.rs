//! Positions, velocities and inverse masses of a body, as arrays.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::state::{DecodeError, Reader, State, Writer};

/// The state of a body's particles; all arrays have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Particles {
    /// Positions [m], shape `[count]`.
    pub position: Vec<Point3<f64>>,
    /// Velocities [m/s], shape `[count]`.
    pub velocity: Vec<Vector3<f64>>,
    /// Inverse masses [1/kg], shape `[count]`; zero fixes a particle.
    pub inverse_mass: Vec<f64>,
}

impl Particles {
    /// Particles at rest.
    pub fn at_rest(position: Vec<Point3<f64>>, inverse_mass: Vec<f64>) -> Self {
        assert_eq!(
            position.len(),
            inverse_mass.len(),
            "one inverse mass for each position"
        );
        Self {
            velocity: vec![Vector3::zeros(); position.len()],
            position,
            inverse_mass,
        }
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// True for no particles.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// The first particle with a position or velocity that is not finite.
    pub fn first_non_finite(&self) -> Option<usize> {
        let finite = |v: &Vector3<f64>| v.iter().all(|c| c.is_finite());
        self.position
            .iter()
            .zip(&self.velocity)
            .position(|(x, v)| !(finite(&x.coords) && finite(v)))
    }
}

impl State for Particles {
    fn save(&self, to: &mut Writer) {
        // The constructor determines which particles are fixed, and the masses of the others.
        let Self {
            position,
            velocity,
            inverse_mass: _,
        } = self;
        to.list(position);
        to.list(velocity);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let Self {
            position,
            velocity,
            inverse_mass: _,
        } = self;
        from.fill(position)?;
        from.fill(velocity)
    }
}

/// Position and inverse mass of a particle side by side: x, y, z [m], w [1/kg]; half a cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Slot(pub [f64; 4]);

/// An order of particles in memory other than that of their indices: neighbours should be near each
/// other.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Numbering {
    /// Entry `k` of the first list is the particle at position `k`; entry `p` of the second list is
    /// the position of particle `p`. `None` if they are equal.
    both: Option<Arc<(Vec<u32>, Vec<u32>)>>,
}

impl Numbering {
    /// Creates the order of a permutation: entry `k` is the particle at place `k`.
    ///
    /// # Panics
    /// If `particles` does not contain each index below its length once.
    pub fn new(particles: Vec<u32>) -> Self {
        let mut places = vec![u32::MAX; particles.len()];
        for (place, &p) in particles.iter().enumerate() {
            assert_eq!(places[p as usize], u32::MAX, "particle {p} has two places");
            places[p as usize] = place as u32;
        }
        Self {
            both: Some(Arc::new((particles, places))),
        }
    }

    /// Place of particle `p`.
    pub fn place(&self, p: u32) -> u32 {
        self.both.as_ref().map_or(p, |both| both.1[p as usize])
    }
}

/// Number of particles from which several threads share a pass.
const SEVERAL: usize = 16_384;

/// Least number of particles per thread in such a pass; a multiple of all SIMD widths.
pub(crate) const SHARE: usize = 4_096;

/// True if several threads share a pass over this number of particles.
pub(crate) fn is_shared(count: usize) -> bool {
    count >= SEVERAL && rayon::current_num_threads() > 1
}

/// A copy of positions and inverse masses in the layout of the constraint sweeps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Packed {
    /// Shape `[count]`, by place.
    pub slots: Vec<Slot>,
    numbering: Numbering,
}

impl Packed {
    /// An empty copy in the order of `numbering`.
    pub fn new(numbering: Numbering) -> Self {
        Self {
            slots: Vec::new(),
            numbering,
        }
    }

    /// Place of particle `p` among the slots.
    pub fn place(&self, p: u32) -> u32 {
        self.numbering.place(p)
    }

    /// Copies positions and inverse masses from `particles`.
    pub fn read(&mut self, particles: &Particles) {
        let (x, w) = (&particles.position, &particles.inverse_mass);
        let copy = |p: usize| Slot([x[p].x, x[p].y, x[p].z, w[p]]);
        let fill = |first: usize, slots: &mut [Slot]| match &self.numbering.both {
            None => slots
                .iter_mut()
                .enumerate()
                .for_each(|(k, slot)| *slot = copy(first + k)),
            Some(both) => slots
                .iter_mut()
                .zip(&both.0[first..])
                .for_each(|(slot, &p)| *slot = copy(p as usize)),
        };
        self.slots.resize(x.len(), Slot::default());
        if is_shared(x.len()) {
            self.slots
                .par_chunks_mut(SHARE)
                .enumerate()
                .for_each(|(k, slots)| fill(k * SHARE, slots));
        } else {
            fill(0, &mut self.slots);
        }
    }

    /// Copies the positions back to `particles`, which must have the same number.
    pub fn write(&self, particles: &mut Particles) {
        let point = |k: usize| {
            let Slot([x, y, z, _]) = self.slots[k];
            Point3::new(x, y, z)
        };
        let fill = |(first, to): (usize, &mut [Point3<f64>])| match &self.numbering.both {
            None => to
                .iter_mut()
                .enumerate()
                .for_each(|(k, x)| *x = point(first + k)),
            Some(both) => to
                .iter_mut()
                .zip(&both.1[first..])
                .for_each(|(x, &place)| *x = point(place as usize)),
        };
        let x = &mut particles.position;
        if is_shared(x.len()) {
            x.par_chunks_mut(SHARE)
                .enumerate()
                .for_each(|(k, x)| fill((k * SHARE, x)));
        } else {
            fill((0, x));
        }
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.slots.capacity() * size_of::<Slot>()
    }
}
