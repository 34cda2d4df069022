//! A contact as a linear inequality of positions.

use nalgebra::{Point3, Vector3};

use crate::state::{DecodeError, Reader, Value, Writer};

/// A half-space constraint on a weighted sum of up to four vertices: n.(sum w (x - o)) >= distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactPlane {
    /// Vertices and their weights; for a single vertex the others have weight zero. For two parts that
    /// both move the weights sum to zero.
    pub terms: [(u32, f64); 4],
    /// Unit direction away from the obstacle.
    pub normal: Vector3<f64>,
    /// A point of the obstacle [m]; without effect for two parts that both move.
    pub origin: Point3<f64>,
    /// Required height over the plane [m].
    pub distance: f64,
}

impl ContactPlane {
    /// Height above the required one [m]; negative if the constraint is violated.
    pub fn room(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = -self.distance;
        for &(v, w) in &self.terms {
            sum += w * (x[v as usize] - self.origin).dot(&self.normal);
        }
        sum
    }

    /// Dot product of the constraint gradient with a field.
    pub(crate) fn along(&self, field: &[Vector3<f64>]) -> f64 {
        self.terms
            .iter()
            .map(|&(v, w)| w * field[v as usize].dot(&self.normal))
            .sum()
    }

    /// Adds `factor` times the constraint gradient to a field.
    pub(crate) fn spread(&self, factor: f64, field: &mut [Vector3<f64>]) {
        self.terms
            .iter()
            .filter(|(_, w)| *w != 0.0)
            .for_each(|&(v, w)| field[v as usize] += self.normal * (w * factor));
    }

    /// True for two parts that both move.
    pub(crate) fn is_pair(&self) -> bool {
        self.terms.iter().map(|(_, w)| w).sum::<f64>().abs() < 0.5
    }

    /// True if a force presses against the obstacle.
    pub fn is_pressed(&self, force: &[Vector3<f64>]) -> bool {
        self.along(force) < 0.0
    }

    /// Removes the obstacle's reaction from a force.
    pub fn support(&self, force: &mut [Vector3<f64>]) {
        let square: f64 = self.terms.iter().map(|(_, w)| w * w).sum();
        let pressed = self.along(force) / square;
        if pressed < 0.0 {
            self.spread(-pressed, force);
        }
    }
}

impl Value for ContactPlane {
    const MIN_BYTES: usize = 4 * 12 + 24 + 24 + 8;

    fn encode(&self, to: &mut Writer) {
        let Self {
            terms,
            normal,
            origin,
            distance,
        } = self;
        to.put(terms);
        to.put(normal);
        to.put(origin);
        to.put(distance);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self {
            terms: from.take()?,
            normal: from.take()?,
            origin: from.take()?,
            distance: from.take()?,
        })
    }
}
