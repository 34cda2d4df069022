//! The worst values of a muscle, with the vertices and frames that have them.

use nalgebra::Point3;
use pliant::state::{DecodeError, Reader, Value, Writer};

use super::super::output::{Spot, Verdict};

/// The worst values of a muscle so far; `None` for what was not measured.
#[derive(Clone, Copy, Debug, Default)]
pub struct Worst {
    pub(super) jitter: Option<Found>,
    /// Greatest motion of a free vertex in a frame [m].
    pub(super) way: Option<Found>,
    pub(super) lift: Option<Found>,
    pub(super) thinnest: Option<Found>,
    pub(super) hinge: Option<Found>,
    /// Greatest strain of an edge.
    pub(super) strain: Option<Found>,
}

/// A value, and the vertex that has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    pub(super) value: f64,
    pub(super) vertex: u32,
    pub(super) spot: Spot,
}

impl Found {
    /// The vertex with a value at these positions.
    pub(super) fn of(value: f64, vertex: u32, frame: usize, x: &[Point3<f64>]) -> Self {
        let point_m = x[vertex as usize].into();
        Self {
            value,
            vertex,
            spot: Spot { frame, point_m },
        }
    }

    /// Puts this in place of a smaller value. NaN stays.
    pub(super) fn keep_greatest(self, so_far: &mut Option<Self>) {
        let is_greater = |old: &Self| !(self.value <= old.value) && !old.value.is_nan();
        if so_far.as_ref().is_none_or(is_greater) {
            *so_far = Some(self);
        }
    }

    /// Puts this in place of a greater value. NaN stays.
    pub(super) fn keep_least(self, so_far: &mut Option<Self>) {
        let is_less = |old: &Self| !(self.value >= old.value) && !old.value.is_nan();
        if so_far.as_ref().is_none_or(is_less) {
            *so_far = Some(self);
        }
    }
}

impl Value for Found {
    const MIN_BYTES: usize = 44;
    fn encode(&self, to: &mut Writer) {
        to.put(&self.value);
        to.put(&self.vertex);
        to.put(&self.spot.frame);
        to.put(&self.spot.point_m);
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self {
            value: from.take()?,
            vertex: from.take()?,
            spot: Spot {
                frame: from.take()?,
                point_m: from.take()?,
            },
        })
    }
}

impl Value for Worst {
    const MIN_BYTES: usize = 6;
    fn encode(&self, to: &mut Writer) {
        for found in [
            &self.jitter,
            &self.way,
            &self.lift,
            &self.thinnest,
            &self.hinge,
            &self.strain,
        ] {
            to.put(found);
        }
    }
    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self {
            jitter: from.take()?,
            way: from.take()?,
            lift: from.take()?,
            thinnest: from.take()?,
            hinge: from.take()?,
            strain: from.take()?,
        })
    }
}

/// A verdict on a muscle; if it failed, with the place of the worst value.
pub(super) fn located(verdict: Verdict, muscle: &str, found: Option<Found>) -> Verdict {
    let Some(Found { vertex, spot, .. }) = found.filter(|_| !verdict.passed) else {
        return verdict.at(muscle);
    };
    let place = format!("{muscle}, frame {}, vertex {vertex}", spot.frame);
    verdict.at(place).seen(Some(spot))
}

impl Worst {
    /// A verdict on the strain of the edges of a muscle.
    pub(in super::super) fn of_strain(&self, verdict: Verdict, muscle: &str) -> Verdict {
        located(verdict, muscle, self.strain)
    }
}
