//! An axis-aligned box divided into equal numbers of boxes along each axis.

use nalgebra::{Point3, Vector3};

use super::overlap::may_meet;
use crate::mesh::measures::Aabb;

/// Upper bound of the rounding error of a box's coordinate, relative to the largest coordinate.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Index of a box along each axis.
pub(in crate::contact) type Place = [usize; 3];

/// A uniform division of a box.
#[derive(Clone, Debug)]
pub(in crate::contact) struct Boxes {
    /// Bounds of all boxes [m].
    pub bounds: Aabb,
    /// Side lengths of one box [m].
    pub size: Vector3<f64>,
    /// Number of boxes along each axis.
    pub count: usize,
    /// Upper bound of the rounding error of a box's coordinates [m].
    pub slack: f64,
}

impl Boxes {
    /// Divides `bounds`; a flat box becomes as thick as long, since all sides must be positive.
    pub fn new(bounds: &Aabb, count: usize) -> Self {
        let count = count.max(1);
        let min = if bounds.is_empty() {
            Point3::origin()
        } else {
            bounds.min
        };
        let extents = bounds.extents();
        // Boxes of a single point can have any size.
        let longest = if extents.max() > 0.0 {
            extents.max()
        } else {
            1.0
        };
        let extents = extents.map(|e| if e > 0.0 { e } else { longest });
        let bounds = Aabb {
            min,
            max: min + extents,
        };
        let slack = ROUNDING * bounds.min.coords.amax().max(bounds.max.coords.amax());
        Self {
            bounds,
            size: extents / count as f64,
            count,
            slack,
        }
    }

    /// The box that contains a point, or the nearest box.
    pub fn at(&self, point: &Point3<f64>) -> Place {
        std::array::from_fn(|k| {
            (((point[k] - self.bounds.min[k]) / self.size[k]) as usize).min(self.count - 1)
        })
    }

    /// Index of a box in a list of all boxes.
    pub fn index(&self, [x, y, z]: Place) -> usize {
        (x * self.count + y) * self.count + z
    }

    /// Number of boxes.
    pub fn len(&self) -> usize {
        self.count.pow(3)
    }

    /// Lowest corner of a box [m].
    fn low(&self, place: Place) -> Point3<f64> {
        self.bounds.min + Vector3::from_fn(|k, _| place[k] as f64).component_mul(&self.size)
    }

    /// Centre of a box [m].
    pub fn centre(&self, place: Place) -> Point3<f64> {
        self.low(place) + 0.5 * self.size
    }

    /// The point of a box nearest to `point` [m].
    pub fn nearest(&self, place: Place, point: &Point3<f64>) -> Point3<f64> {
        let low = self.low(place);
        low.sup(&(low + self.size).inf(point))
    }

    /// Visits a superset of the boxes that a triangle intersects.
    pub fn meeting(&self, t: &[Point3<f64>; 3], mut visit: impl FnMut(Place)) {
        let grown = Aabb::of_points(t).inflate(self.slack);
        let (low, high) = (self.at(&grown.min), self.at(&grown.max));
        let half = 0.5 * self.size + Vector3::repeat(self.slack);
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    if may_meet(t, &self.centre([x, y, z]), &half) {
                        visit([x, y, z]);
                    }
                }
            }
        }
    }

    /// Visits boxes in growing shells around the one nearest to `point`. `visit` gets the present
    /// search distance [m] and returns it, reduced if it found something nearer. Boxes beyond the
    /// search distance are not visited.
    pub fn search(
        &self,
        point: &Point3<f64>,
        reach: f64,
        mut visit: impl FnMut(Place, f64) -> f64,
    ) {
        let middle = self.at(point);
        let inner = self.bounds.min.sup(&self.bounds.max.inf(point));
        let away = (point - inner).norm_squared();
        let mut reach = reach;
        for ring in 0..self.count {
            let beyond = if ring == 0 {
                0.0
            } else {
                self.beyond(&inner, middle, ring)
            };
            // No point of the boxes is nearer to `point` than this, since their union is convex.
            if (away + beyond * beyond).sqrt() - self.slack > reach || beyond.is_infinite() {
                return;
            }
            self.shell(middle, ring, |place| reach = visit(place, reach));
        }
    }

    /// Distance of a point in the box `middle` from all boxes at least `ring` boxes away [m];
    /// infinite if there are none.
    fn beyond(&self, inner: &Point3<f64>, middle: Place, ring: usize) -> f64 {
        let mut least = f64::INFINITY;
        for k in 0..3 {
            let face = |index: usize| self.bounds.min[k] + index as f64 * self.size[k];
            if middle[k] >= ring {
                least = least.min(inner[k] - face(middle[k] + 1 - ring));
            }
            if middle[k] + ring < self.count {
                least = least.min(face(middle[k] + ring) - inner[k]);
            }
        }
        // Rounding can put the point slightly outside its box.
        least.max(0.0)
    }

    /// Visits the boxes exactly `ring` boxes away along some axis and no farther along any.
    fn shell(&self, middle: Place, ring: usize, mut visit: impl FnMut(Place)) {
        let low = middle.map(|m| m.saturating_sub(ring));
        let high = middle.map(|m| (m + ring).min(self.count - 1));
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                if x.abs_diff(middle[0]) == ring || y.abs_diff(middle[1]) == ring {
                    (low[2]..=high[2]).for_each(|z| visit([x, y, z]));
                    continue;
                }
                if middle[2] >= ring {
                    visit([x, y, middle[2] - ring]);
                }
                if middle[2] + ring < self.count {
                    visit([x, y, middle[2] + ring]);
                }
            }
        }
    }

    /// Positions where the path from `from` to `to` can pass from one box to another, as shares of
    /// the path, ascending from 0 to 1.
    pub fn cuts(&self, from: &Point3<f64>, to: &Point3<f64>) -> Vec<f64> {
        let mut cuts = vec![0.0, 1.0];
        for k in 0..3 {
            let along = to[k] - from[k];
            let share =
                |index: usize| (self.bounds.min[k] + index as f64 * self.size[k] - from[k]) / along;
            // A path parallel to the faces crosses none; the quotient is not finite then.
            cuts.extend((0..=self.count).map(share).filter(|s| *s > 0.0 && *s < 1.0));
        }
        cuts.sort_unstable_by(f64::total_cmp);
        cuts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Draw;

    #[test]
    fn shells_hold_every_box_once_and_in_order_of_distance() {
        let bounds = Aabb {
            min: Point3::new(-1.0, 2.0, 0.0),
            max: Point3::new(1.0, 2.5, 3.0),
        };
        let boxes = Boxes::new(&bounds, 5);
        let mut draw = Draw::new(72);
        for _ in 0..200 {
            let p = Point3::from(draw.direction() * draw.between(0.0, 5.0));
            let mut visits = vec![0; boxes.len()];
            boxes.search(&p, f64::INFINITY, |place, reach| {
                visits[boxes.index(place)] += 1;
                reach
            });
            assert!(visits.iter().all(|v| *v == 1), "{p}: {visits:?}");
            // Everything within the search distance is visited.
            let reach = draw.between(0.0, 4.0);
            let mut occupied = vec![false; boxes.len()];
            boxes.search(&p, reach, |place, reach| {
                occupied[boxes.index(place)] = true;
                reach
            });
            let mut skipped = 0;
            for x in 0..5 {
                for y in 0..5 {
                    for z in 0..5 {
                        let near = (boxes.nearest([x, y, z], &p) - p).norm() <= reach;
                        assert!(
                            !near || occupied[boxes.index([x, y, z])],
                            "{p} within {reach}: {x} {y} {z}"
                        );
                        skipped += usize::from(!occupied[boxes.index([x, y, z])]);
                    }
                }
            }
            assert!(
                reach > 0.5 || skipped > 0,
                "control: the reach does nothing"
            );
        }
    }

    #[test]
    fn a_flat_or_empty_box_has_boxes_with_sides() {
        let flat = Aabb {
            min: Point3::new(1.0, 1.0, 1.0),
            max: Point3::new(3.0, 1.0, 2.0),
        };
        assert_eq!(Boxes::new(&flat, 4).size, Vector3::new(0.5, 0.5, 0.25));
        for bounds in [
            Aabb::EMPTY,
            Aabb {
                min: flat.min,
                max: flat.min,
            },
        ] {
            assert_eq!(Boxes::new(&bounds, 4).size, Vector3::repeat(0.25));
        }
    }
}
