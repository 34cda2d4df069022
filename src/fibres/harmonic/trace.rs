//! Streamlines of the field from the origin to the insertion, along its walls.

use nalgebra::{Point3, Vector3};

use super::super::attachment::Area;
use super::cells::NONE;
use super::field::Field;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;

/// Length of a step, in sides of a cell.
const STEP: f64 = 0.4;
/// Within this distance of its area, in sides of a cell, a streamline goes to the area beside it.
/// The field has no finer resolution; where an area is smaller than a cell, streamlines would meet
/// in the centre of that cell.
const ARRIVED: f64 = 1.0;
/// The same distance where the field ends.
const ARRIVED_LATE: f64 = 2.0;
/// Share of its distance that a streamline comes nearer to its area in a step beside it.
const NEARER: f64 = 0.5;
/// Distance, in sides of a cell, below which the next step ends on the area.
const BESIDE: f64 = 0.03;
/// It goes the straighter, the more the field leads away from the area, and straight from 30 degrees on:
/// the inverse of the sine.
const AWAY: f64 = 2.0;
/// Greatest number of these steps. Each halves the distance, but for the bend of the area. Then it goes
/// straight.
const MOST_BESIDE: usize = 64;
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

/// How a streamline comes from a point to the next one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Advance {
    /// Along the field.
    Flow,
    /// To the next cell, where the field leads no further.
    Hop,
    /// Along the field and nearer to the area, beside it.
    Nearer,
    /// In one step to the area, in its direction.
    End,
    /// In one step to the closest point of the area.
    Straight,
}

/// One half of a streamline.
#[derive(Clone, Debug, Default)]
pub struct HalfStreamline {
    /// From the seed to the area [m].
    pub points: Vec<Point3<f64>>,
    /// The way from each point to the next one.
    pub advances: Vec<Advance>,
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

    /// A streamline beside its area also goes along it. This is the way along the area for each length
    /// `towards` it, at a `distance` [m]: that of its direction, but at most `flat` of the field. It is zero
    /// where the field leads away.
    fn along(
        &self,
        p: &Point3<f64>,
        sign: f64,
        (towards, distance): (Vector3<f64>, f64),
    ) -> Option<Vector3<f64>> {
        // At the height where it arrives: nearer to the area the field turns towards it.
        let above = p - towards * (self.side() * ARRIVED - distance).max(0.0);
        let direction = self
            .field
            .direction(&above, sign)
            .or_else(|| self.field.direction(p, sign))?;
        let nearer = direction.dot(&towards);
        let share = (1.0 + AWAY * nearer).clamp(0.0, 1.0);
        Some((direction - towards * nearer) * (share / nearer.max(1.0 / self.field.flat)))
    }

    /// The next point of a streamline beside its area, and how it comes there: as `given`, or by its
    /// distance. It keeps its direction: straight towards the area, all fibres that run along it would
    /// end in a hook. In one long step those that run along a bent area would pass through it and change
    /// places.
    fn beside(
        &self,
        p: &Point3<f64>,
        sign: f64,
        given: Option<Advance>,
    ) -> Option<(Point3<f64>, Advance)> {
        let area = &self.areas[usize::from(sign > 0.0)];
        let found = area.closest(p, f64::INFINITY)?;
        let (way, distance) = (found.point - p, found.distance);
        let onward = match given != Some(Advance::Straight) && self.field.flat > 0.0 {
            true if distance > 0.0 => self.along(p, sign, (way / distance, distance)),
            _ => None,
        };
        let onward = onward.map(|along| along * distance);
        let is_far = distance >= BESIDE * self.side();
        let advance = given.unwrap_or(match onward {
            Some(_) if is_far => Advance::Nearer,
            Some(_) => Advance::End,
            None => Advance::Straight,
        });
        let end = match advance {
            Advance::Nearer => return Some((p + (onward? + way) * NEARER, advance)),
            Advance::End => area.closest(&(p + onward?), f64::INFINITY)?.point,
            Advance::Straight | Advance::Flow | Advance::Hop => found.point,
        };
        let back = p - end;
        let left = match distance > 0.0 {
            true => LEFT.min(LEFT_MOST * self.length / back.norm()),
            false => 0.0,
        };
        Some((end + back * left, advance))
    }

    /// The point that follows a point beside a streamline, where the streamline makes this `advance`; `None`
    /// for a hop, and where the field leads nowhere.
    pub fn follow(&self, p: &Point3<f64>, sign: f64, advance: Advance) -> Option<Point3<f64>> {
        match advance {
            Advance::Flow => self.step(p, sign),
            Advance::Hop => None,
            Advance::Nearer | Advance::End | Advance::Straight => {
                Some(self.beside(p, sign, Some(advance))?.0)
            }
        }
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
            advances: Vec::new(),
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
                streamline.advances.push(Advance::Flow);
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
            streamline.advances.push(Advance::Hop);
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
        let mut p = *p;
        for n in 0..=MOST_BESIDE {
            let given = (n == MOST_BESIDE).then_some(Advance::Straight);
            let Some((next, advance)) = self.beside(&p, sign, given) else {
                return Err(streamline);
            };
            p = next;
            streamline.points.push(p);
            streamline.advances.push(advance);
            if advance != Advance::Nearer {
                break;
            }
        }
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

#[cfg(test)]
mod tests {
    use super::super::super::attachment::{AreaSource, Attachment};
    use super::super::super::solid::Closed;
    use super::super::{Cells, FLAT, Flux, STEEP, jacobian};
    use super::*;
    use crate::mesh::shapes::tube;

    /// The halves of streamlines to the area round one end of a thin tube: the share that keeps the order
    /// beside it, and the greatest number of steps beside the area.
    fn kept(flat: f64) -> (f64, usize) {
        let mesh = tube(0.01, 0.3, 32);
        let end = |sign: f64| -> Vec<u32> {
            let at = |v: &u32| sign * mesh.vertices[*v as usize].x > 0.1;
            (0..mesh.vertices.len() as u32).filter(at).collect()
        };
        let ends = [end(-1.0), end(1.0)];
        let [low, high] = ends.each_ref().map(|end| AreaSource::Vertices(end));
        let areas = Attachment::new(&mesh, low, high).expect("areas");
        let closed = Closed::new(&mesh);
        let solid = closed.solid();
        let cells = Cells::new(&solid, 0.003);
        let field = Field::new(cells, &solid, &mesh, &areas, &[], (Flux::Even, flat));
        let field = field.expect("a field");
        let tracer = Tracer::new(&field, &mesh, &areas.origin, &areas.insertion);
        let (mut all, mut good, mut steps) = (0.0, 0.0, 0);
        for seed in field.cells.inner.iter().flatten().step_by(7) {
            let half = tracer.half(seed, 1.0, false).expect("it is not lost");
            let beside: Vec<f64> = half
                .points
                .iter()
                .zip(&half.advances)
                .filter(|(_, advance)| **advance == Advance::Nearer)
                .filter_map(|(p, _)| tracer.distance_to_area(p, 1.0, f64::INFINITY))
                .collect();
            // A step over the axis of the tube comes nearer to the other side.
            assert!(beside.windows(2).all(|d| d[1] < d[0]), "{beside:?}");
            steps = steps.max(beside.len());
            let end = half.points.last().expect("an end");
            let away = tracer.distance_to_area(end, 1.0, f64::INFINITY);
            // But for rounding.
            assert!(away.expect("an area") <= 1.001 * LEFT_MOST * mesh.length());
            all += 1.0;
            good += f64::from(u8::from(jacobian::keeps_order(&tracer, &half, 1.0)));
        }
        (good / all, steps)
    }

    #[test]
    fn streamlines_beside_an_area_come_nearer_by_halves_and_keep_their_order() {
        let (share, steps) = kept(FLAT);
        println!("{share} of all, {steps} steps");
        assert!(share >= 0.95, "{share}");
        // Six halve the side of a cell to a thirtieth.
        assert!((5..=8).contains(&steps), "{steps}");
        // Straight to the closest point there is no such step.
        let (share, steps) = kept(STEEP);
        assert!(share >= 0.95 && steps == 0, "{share} {steps}");
    }
}
