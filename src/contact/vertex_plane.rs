//! The plane that keeps a vertex out of an obstacle.

use nalgebra::{Point3, Vector3};

use crate::state::{DecodeError, Reader, Value, Writer};

/// A contact plane of a vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct VertexPlane {
    /// The vertex.
    pub vertex: u32,
    /// A point of the plane in the world [m].
    pub origin: Point3<f64>,
    /// Normal in the world.
    pub normal: Vector3<f64>,
    /// Sum of the corrections along the normal in this step, and of those that the volume would have
    /// made against it [m].
    pub push: f64,
}

impl VertexPlane {
    /// Height over the plane [m].
    pub fn height(&self, x: &[Point3<f64>]) -> f64 {
        (x[self.vertex as usize] - self.origin).dot(&self.normal)
    }

    /// Moves the vertex over the plane. Returns the distance [m].
    pub fn push_over(&mut self, x: &mut [Point3<f64>], thickness: f64) -> f64 {
        let lack = thickness - self.height(x);
        if lack > 0.0 {
            x[self.vertex as usize] += self.normal * lack;
            self.push += lack;
        }
        lack.max(0.0)
    }
}

impl Value for VertexPlane {
    const MIN_BYTES: usize = 4 + 24 + 24 + 8;

    fn encode(&self, to: &mut Writer) {
        let Self {
            vertex,
            origin,
            normal,
            push,
        } = self;
        to.put(vertex);
        to.put(origin);
        to.put(normal);
        to.put(push);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self {
            vertex: from.take()?,
            origin: from.take()?,
            normal: from.take()?,
            push: from.take()?,
        })
    }
}
