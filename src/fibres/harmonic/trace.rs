//! Streamlines of the field from the origin to the insertion, along its walls.

use nalgebra::Point3;

use super::super::attachment::Area;
use super::cells::NONE;
use super::field::Field;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;

/// Length of a step, in sides of a cell.
const STEP: f64 = 0.4;
/// Within this distance of its area, in sides of a cell, a streamline goes straight to the area.
/// The field has no finer resolution; where an area is smaller than a cell, streamlines would meet
/// in the centre of that cell.
const ARRIVED: f64 = 1.0;
/// The same distance where the field ends.
const ARRIVED_LATE: f64 = 2.0;
/// Remaining share of the distance to the closest point of the area. With 0, all streamlines that
/// arrive beside an area would end in one point of its boundary.
const LEFT: f64 = 1e-3;
/// Upper bound of that remainder, in lengths of the muscle.
const LEFT_MOST: f64 = 2e-6;
/// A streamline is lost in a corner if it advances by less than [`PROGRESS`] steps in this number
/// of steps.
const PATIENCE: usize = 16;
const PROGRESS: f64 = 2.0;
/// Greatest number of steps of half a streamline, per cell along the sides of the box.
const MOST_STEPS: usize = 24;

/// One half of a streamline.
#[derive(Clone, Debug, Default)]
pub struct HalfStreamline {
    /// From the seed to the area [m].
    pub points: Vec<Point3<f64>>,
    /// True if the step to the next point follows the field; false for a hop or the last step to
    /// the area.
    pub flows: Vec<bool>,
}

/// Traces streamlines of the field in a muscle.
#[derive(Debug)]
pub struct Tracer<'a> {
    /// The field.
    pub field: &'a Field,
    areas: [SurfaceTree; 2],
    length: f64,
}

impl<'a> Tracer<'a> {
    /// Creates a tracer between two areas of `muscle`.
    pub fn new(field: &'a Field, muscle: &TriangleMesh, origin: &Area, insertion: &Area) -> Self {
        Self {
            field,
            areas: [origin, insertion].map(|area| area.tree(muscle)),
            length: muscle.length(),
        }
    }

    fn side(&self) -> f64 {
        self.field.cells.side
    }

    fn by_area(&self, p: &Point3<f64>, end: usize) -> bool {
        self.field.by_area[end][self.field.cells.holding(p)]
    }

    /// One step of the midpoint rule.
    pub fn step(&self, p: &Point3<f64>, sign: f64) -> Option<Point3<f64>> {
        let length = STEP * self.side();
        let half = p + self.field.direction(p, sign)? * (0.5 * length);
        Some(p + self.field.direction(&half, sign)? * length)
    }

    /// The point where a streamline through `p` reaches the area: it goes on in its direction, but
    /// at most `flat` of the field times as far along the area as towards it. Straight towards the area, all
    /// fibres that run along it would end in a hook.
    pub fn landing(&self, p: &Point3<f64>, sign: f64) -> Option<Point3<f64>> {
        let area = &self.areas[usize::from(sign > 0.0)];
        let found = area.closest(p, f64::INFINITY)?;
        if !(found.distance > 0.0) {
            return Some(found.point);
        }
        let towards = (found.point - p) / found.distance;
        let onward = self.field.direction(p, sign).map(|direction| {
            let nearer = direction.dot(&towards);
            let along = direction - towards * nearer;
            along * (found.distance / nearer.max(along.norm() / self.field.flat))
        });
        let found = match onward.filter(|onward| onward.iter().all(|c| c.is_finite())) {
            Some(onward) => area.closest(&(p + onward), f64::INFINITY)?,
            None => found,
        };
        Some(
            found.point
                + (p - found.point) * LEFT.min(LEFT_MOST * self.length / (p - found.point).norm()),
        )
    }

    fn distance_to_area(&self, p: &Point3<f64>, sign: f64, within: f64) -> Option<f64> {
        self.areas[usize::from(sign > 0.0)]
            .closest(p, within)
            .map(|found| found.distance)
    }

    /// Follows the field from a seed to the area.
    ///
    /// # Errors
    /// A lost streamline, as far as the tracer came, if `hop` does not allow it to continue by
    /// cells.
    pub fn half(
        &self,
        seed: &Point3<f64>,
        sign: f64,
        hop: bool,
    ) -> Result<HalfStreamline, HalfStreamline> {
        let mut streamline = HalfStreamline {
            points: vec![*seed],
            flows: Vec::new(),
        };
        let mut p = *seed;
        let mut since = 0;
        for _ in 0..MOST_STEPS * self.field.cells.dims.iter().sum::<usize>() {
            let stuck = streamline.points.len() > since + PATIENCE && {
                let before = streamline.points[streamline.points.len() - 1 - PATIENCE];
                (p - before).norm() < PROGRESS * STEP * self.side()
            };
            let reach = self.side() * if stuck { ARRIVED_LATE } else { ARRIVED };
            if self.by_area(&p, usize::from(sign > 0.0))
                && self.distance_to_area(&p, sign, reach).is_some()
            {
                return self.arrive(streamline, &p, sign);
            }
            let next = if stuck { None } else { self.step(&p, sign) };
            if let Some(next) = next {
                p = next;
                streamline.flows.push(true);
                streamline.points.push(p);
                continue;
            }
            if !hop {
                return Err(streamline);
            }
            since = streamline.points.len();
            let Some(next) = self.hop(&p, sign) else {
                return self.arrive(streamline, &p, sign);
            };
            streamline.flows.push(false);
            streamline.points.push(next);
            p = next;
        }
        Err(streamline)
    }

    fn arrive(
        &self,
        mut streamline: HalfStreamline,
        p: &Point3<f64>,
        sign: f64,
    ) -> Result<HalfStreamline, HalfStreamline> {
        let Some(landing) = self.landing(p, sign) else {
            return Err(streamline);
        };
        streamline.points.push(landing);
        streamline.flows.push(false);
        Ok(streamline)
    }

    /// The next cell towards the area that has a point inside.
    fn hop(&self, p: &Point3<f64>, sign: f64) -> Option<Point3<f64>> {
        let mut cell = self.field.cells.at[self.field.cells.holding(p)];
        if cell == NONE || self.field.values[cell as usize].is_nan() {
            return None;
        }
        loop {
            cell = self.field.onward(cell, sign)?;
            if let Some(point) = self.field.cells.inner[cell as usize] {
                return Some(point);
            }
        }
    }
}
