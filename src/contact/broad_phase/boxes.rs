//! A box along the axes, cut into equally many boxes along each of them.

use nalgebra::{Point3, Vector3};

use super::overlap::may_meet;
use crate::mesh::measures::Aabb;

/// Roundings of a coordinate of a box, relative to the largest coordinate; a generous count.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Where a box is along each axis.
pub(super) type Place = [usize; 3];

/// Boxes that fill a box.
#[derive(Clone, Debug)]
pub(super) struct Boxes {
    /// All of them [m].
    pub bounds: Aabb,
    /// Sides of one [m].
    pub size: Vector3<f64>,
    /// How many there are along each axis.
    pub count: usize,
    /// More than any coordinate of a box is off by rounding [m].
    pub slack: f64,
}

impl Boxes {
    /// Cuts `bounds`; what is flat is made as thick as it is long, for its boxes must have sides.
    pub fn new(bounds: &Aabb, count: usize) -> Self {
        let count = count.max(1);
        let min = if bounds.is_empty() {
            Point3::origin()
        } else {
            bounds.min
        };
        let extents = bounds.extents();
        // Boxes of a single point may have any size.
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

    /// The box that holds a point, or the nearest to it.
    pub fn at(&self, point: &Point3<f64>) -> Place {
        std::array::from_fn(|k| {
            (((point[k] - self.bounds.min[k]) / self.size[k]) as usize).min(self.count - 1)
        })
    }

    /// Index of a box in a list of all.
    pub fn index(&self, [x, y, z]: Place) -> usize {
        (x * self.count + y) * self.count + z
    }

    /// How many boxes there are.
    pub fn len(&self) -> usize {
        self.count.pow(3)
    }

    /// Lowest corner of a box [m].
    fn low(&self, place: Place) -> Point3<f64> {
        self.bounds.min + Vector3::from_fn(|k, _| place[k] as f64).component_mul(&self.size)
    }

    /// Middle of a box [m].
    pub fn centre(&self, place: Place) -> Point3<f64> {
        self.low(place) + 0.5 * self.size
    }

    /// The point of a box that is nearest to `point` [m].
    pub fn nearest(&self, place: Place, point: &Point3<f64>) -> Point3<f64> {
        let low = self.low(place);
        low.sup(&(low + self.size).inf(point))
    }

    /// Visits the boxes that a triangle may meet.
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

    /// Visits boxes in growing shells around the one nearest to `point`. `visit` is given the distance within which a
    /// search still wants to know of something [m] and returns it, less where it found something; boxes that are all
    /// further away are not visited.
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
            // No point of the boxes is nearer to `point` than this, as they are convex together.
            if (away + beyond * beyond).sqrt() - self.slack > reach || beyond.is_infinite() {
                return;
            }
            self.shell(middle, ring, |place| reach = visit(place, reach));
        }
    }

    /// Distance of a point in the box `middle` from all boxes at least `ring` boxes away [m]; infinite if there is none.
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
        // Rounding may put the point a little out of its box.
        least.max(0.0)
    }

    /// Visits the boxes exactly `ring` boxes away along some axis and no further along any.
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

    /// Where the way from `from` to `to` may pass from one box to another, as shares of it, ascending from 0 to 1.
    pub fn cuts(&self, from: &Point3<f64>, to: &Point3<f64>) -> Vec<f64> {
        let mut cuts = vec![0.0, 1.0];
        for k in 0..3 {
            let along = to[k] - from[k];
            let share =
                |index: usize| (self.bounds.min[k] + index as f64 * self.size[k] - from[k]) / along;
            // Parallel to the faces it passes none; the quotient is not finite then.
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
            // What is within a reach is visited.
            let reach = draw.between(0.0, 4.0);
            let mut met = vec![false; boxes.len()];
            boxes.search(&p, reach, |place, reach| {
                met[boxes.index(place)] = true;
                reach
            });
            let mut skipped = 0;
            for x in 0..5 {
                for y in 0..5 {
                    for z in 0..5 {
                        let near = (boxes.nearest([x, y, z], &p) - p).norm() <= reach;
                        assert!(
                            !near || met[boxes.index([x, y, z])],
                            "{p} within {reach}: {x} {y} {z}"
                        );
                        skipped += usize::from(!met[boxes.index([x, y, z])]);
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
