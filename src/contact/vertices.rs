//! Contact of the vertices of a muscle with one obstacle.

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::motion_bound::MotionBound;
use super::rounded::MeanNormals;
use super::vertex_plane::VertexPlane;
use super::{Obstacle, PosedObstacle, Projection};
use crate::state::{DecodeError, Reader, State, Value, Writer};

/// A vertex farther away than this, in contact thicknesses, has no plane, only a bound until its
/// next query.
const NEAR: f64 = 4.0;

/// Greatest number of steps of a walk along a path that possibly crosses the surface.
const WALK: usize = 64;

/// Contact state of one vertex, in the frame of the obstacle.
#[derive(Clone, Copy, Debug)]
struct Known {
    /// Position of the last query.
    from: Point3<f64>,
    /// Result of the query: the ball about `from` with this distance as radius is free.
    closest: Projection,
    /// Greatest motion before the next query [m].
    bound: f64,
    /// Sum of motion of the muscle at which a distant vertex needs a new query; infinite until the
    /// end of the step of its query, since its own motion is then known exactly.
    wake: f64,
    /// Direction of the contact plane, if the vertex is near.
    normal: Vector3<f64>,
}

impl Known {
    fn new(found: Option<Projection>, at: Point3<f64>, motion_bound: f64, thickness: f64) -> Self {
        let closest = found.unwrap_or(Projection {
            distance: f64::MAX,
            normal: Vector3::zeros(),
            point: at,
        });
        let bound = (closest.distance / 2.0).max(closest.distance - NEAR / 2.0 * thickness);
        Self {
            from: at,
            closest,
            bound,
            wake: motion_bound + bound,
            normal: closest.normal,
        }
    }
}

/// Contact state of each free vertex of a muscle with respect to one obstacle.
#[derive(Clone, Debug)]
pub(super) struct VertexContacts {
    vertices: Vec<u32>,
    known: Vec<Known>,
    /// Vertices with a query in this step.
    looked: Vec<u32>,
    /// Contact planes of near vertices, sorted by vertex.
    pub planes: Vec<VertexPlane>,
    thickness: f64,
    /// Directions of planes.
    normals: MeanNormals,
    /// Number of queries.
    pub lookups: u64,
    /// Number of walks that ended before their target.
    pub stopped: u64,
}

impl VertexContacts {
    /// Queries every vertex of `vertices` once, unless `near` gives the nearest point of every
    /// vertex of the muscle. The direction of a plane is a mean over `radius` [m].
    pub fn new(
        placed: &PosedObstacle,
        vertices: &[u32],
        x: &[Point3<f64>],
        (thickness, radius): (f64, f64),
        near: Option<&[Option<Projection>]>,
    ) -> Self {
        let inverse = placed.now.inverse();
        let known = vertices
            .par_iter()
            .map(|&v| {
                let at = inverse * x[v as usize];
                let found =
                    near.map_or_else(|| placed.obstacle.closest(&at), |near| near[v as usize]);
                Known::new(found, at, 0.0, thickness)
            })
            .collect();
        let mut new = Self {
            vertices: vertices.to_vec(),
            known,
            looked: Vec::new(),
            planes: Vec::new(),
            thickness,
            normals: MeanNormals::new(&*placed.obstacle, radius),
            lookups: vertices.len() as u64,
            stopped: 0,
        };
        let all: Vec<u32> = (0..vertices.len() as u32).collect();
        new.turn(&*placed.obstacle, &all);
        new
    }

    /// Gives those of the vertices `of` that are near the directions of their planes.
    fn turn(&mut self, obstacle: &dyn Obstacle, of: &[u32]) {
        let near = NEAR * self.thickness;
        let is_near = |k: &&u32| self.known[**k as usize].closest.distance <= near;
        let of: Vec<u32> = of.iter().filter(is_near).copied().collect();
        let place = |k: &u32| {
            (
                self.known[*k as usize].from,
                self.known[*k as usize].closest,
            )
        };
        let places: Vec<_> = of.iter().map(place).collect();
        let normals = self.normals.at(obstacle, &places);
        for (k, normal) in of.into_iter().zip(normals) {
            self.known[k as usize].normal = normal;
        }
    }

    /// Repeats the queries whose bounds can be used up, moves vertices back that can have crossed
    /// the surface, and creates the planes of this step. `start` holds the positions at the
    /// beginning of the step; `travel` bounds the relative motion of every vertex so far [m].
    pub fn update(
        &mut self,
        placed: &PosedObstacle,
        start: &[Point3<f64>],
        x: &mut [Point3<f64>],
        motion_bound: MotionBound,
    ) {
        let inverse = placed.now.inverse();
        let near = NEAR * self.thickness;
        let mut due = Vec::new();
        for (k, (known, &v)) in self.known.iter_mut().zip(&self.vertices).enumerate() {
            let is_far = known.closest.distance > near;
            if is_far && known.wake < f64::INFINITY && known.wake > motion_bound.at_most {
                continue;
            }
            let moved = (inverse * x[v as usize] - known.from).norm();
            let is_free = match is_far {
                true => moved <= known.bound,
                false => 2.0 * moved <= known.closest.distance,
            };
            if !is_free {
                due.push(k as u32);
            } else if is_far && known.wake < f64::INFINITY {
                // It went a shorter way than the sum of the greatest motions, or back.
                known.wake = motion_bound.at_least + known.bound - moved;
            }
        }
        let (this, positions): (&Self, &[Point3<f64>]) = (self, x);
        let again = |&k: &u32| {
            let v = this.vertices[k as usize] as usize;
            let [before, at] = [placed.before.inverse() * start[v], inverse * positions[v]];
            let obstacle = &*placed.obstacle;
            this.look_again(
                &this.known[k as usize],
                obstacle,
                [before, at],
                motion_bound,
            )
        };
        let found: Vec<(Known, Option<Point3<f64>>, bool)> =
            due.par_iter().with_min_len(32).map(again).collect();
        self.lookups += due.len() as u64;
        let mut lifted = Vec::new();
        for (&k, (known, moved, stopped)) in due.iter().zip(found) {
            self.known[k as usize] = Known {
                wake: f64::INFINITY,
                ..known
            };
            if let Some(end) = moved {
                let vertex = self.vertices[k as usize];
                let end = placed.now * end;
                lifted.push((vertex, end - x[vertex as usize]));
                x[vertex as usize] = end;
            }
            self.stopped += u64::from(stopped);
        }
        self.turn(&*placed.obstacle, &due);
        self.looked.extend(due);
        self.make_planes(&placed.now);
        // The displacement of a walk is a correction by the bone, which friction needs.
        for (vertex, by) in lifted {
            if let Ok(plane) = self.planes.binary_search_by_key(&vertex, |r| r.vertex) {
                self.planes[plane].push += by.dot(&self.planes[plane].normal).max(0.0);
            }
        }
    }

    /// Queries a vertex that moved from `start` to `at` in the obstacle's frame. Returns the new
    /// state, the new position if it differs from `at`, and whether the walk ended early.
    fn look_again(
        &self,
        before: &Known,
        obstacle: &dyn Obstacle,
        [start, at]: [Point3<f64>; 2],
        motion_bound: MotionBound,
    ) -> (Known, Option<Point3<f64>>, bool) {
        let (thickness, near) = (self.thickness, NEAR * self.thickness);
        let old = &before.closest;
        // Nothing can be crossed inside the free ball.
        if old.distance <= 0.0 || (at - before.from).norm() < old.distance {
            // A distant vertex needs only a lower bound.
            if old.distance > near {
                let (distance, point) = obstacle.clearance(&at, &old.point);
                if distance > near {
                    let closest = Projection {
                        distance,
                        point,
                        ..*old
                    };
                    return (
                        Known::new(Some(closest), at, motion_bound.at_least, thickness),
                        None,
                        false,
                    );
                }
            }
            let found = obstacle.closest_from(&at, &old.point);
            return (
                Known::new(found, at, motion_bound.at_least, thickness),
                None,
                false,
            );
        }
        let (from, closest) = base(obstacle, before, start);
        let (end, last, arrived) = walk(obstacle, &from, closest, &at, thickness);
        // The sum of motion was bounded before this vertex was moved back.
        let at_least = motion_bound.at_least - (end - at).norm();
        let found = obstacle.closest_from(&end, &last.point);
        (
            Known::new(found, end, at_least, thickness),
            (end != at).then_some(end),
            !arrived,
        )
    }

    /// Ends a step after a sum of motion of `travel` [m]: sets the motion of each vertex since its
    /// query in this step.
    pub fn end_step(&mut self, placed: &PosedObstacle, x: &[Point3<f64>], motion_bound: f64) {
        for k in self.looked.drain(..).map(|k| k as usize) {
            let known = &mut self.known[k];
            let since = (x[self.vertices[k] as usize] - placed.now * known.from).norm();
            known.wake = motion_bound + known.bound - since;
        }
    }

    fn make_planes(&mut self, pose: &Isometry3<f64>) {
        let near = NEAR * self.thickness;
        // Friction needs the corrections of all sweeps of a step.
        let before = match self.planes.is_empty() {
            true => Vec::new(),
            false => std::mem::take(&mut self.planes),
        };
        let mut before = before.iter().peekable();
        for (known, &vertex) in self.known.iter().zip(&self.vertices) {
            if known.closest.distance <= near {
                // Where the vertex was looked up the height is its distance, whatever the direction.
                let foot = known.from - known.normal * known.closest.distance;
                let (origin, normal) = (pose * foot, pose * known.normal);
                while before.next_if(|plane| plane.vertex < vertex).is_some() {}
                let push = before.next_if(|plane| plane.vertex == vertex);
                self.planes.push(VertexPlane {
                    vertex,
                    origin,
                    normal,
                    push: push.map_or(0.0, |plane| plane.push),
                });
            }
        }
    }

    /// Continues at the end of a step, after a sum of motion of `travel` [m], with the vertices
    /// `free` at `x` and another thickness [m]. Queries happen only where the known bounds are not
    /// sufficient.
    pub fn change(
        &mut self,
        placed: &PosedObstacle,
        free: &[u32],
        x: &[Point3<f64>],
        thickness: f64,
        motion_bound: f64,
    ) {
        if self.vertices == free && self.thickness == thickness {
            return;
        }
        let inverse = placed.now.inverse();
        let again = |&v: &u32| {
            let at = inverse * x[v as usize];
            let known = self.vertices.binary_search(&v).ok().map(|k| &self.known[k]);
            // For a distant vertex only a bound is known.
            let is_known = |known: &&Known| {
                let distance = known.closest.distance;
                distance <= NEAR * self.thickness || distance > NEAR * thickness
            };
            match known.filter(is_known) {
                Some(known) if self.thickness == thickness => (*known, false),
                Some(known) => {
                    let Known { from, closest, .. } = known;
                    let bound = motion_bound - (at - from).norm();
                    let next = Known::new(Some(*closest), *from, bound, thickness);
                    let normal = known.normal;
                    (Known { normal, ..next }, false)
                }
                None => {
                    let found = placed.obstacle.closest(&at);
                    (Known::new(found, at, motion_bound, thickness), true)
                }
            }
        };
        let (known, looked): (Vec<Known>, Vec<bool>) = free.par_iter().map(again).unzip();
        self.lookups += looked.iter().filter(|looked| **looked).count() as u64;
        self.planes
            .retain(|plane| free.binary_search(&plane.vertex).is_ok());
        (self.known, self.vertices, self.thickness) = (known, free.to_vec(), thickness);
        self.looked.clear();
        let looked = looked.into_iter().zip(0..);
        let new: Vec<u32> = looked
            .filter_map(|(looked, k)| looked.then_some(k))
            .collect();
        self.turn(&*placed.obstacle, &new);
    }

    /// A superset of the vertices in or near the obstacle.
    pub fn near(&self) -> impl Iterator<Item = u32> {
        let near = |known: &Known| known.closest.distance <= NEAR * self.thickness;
        self.known
            .iter()
            .zip(&self.vertices)
            .filter(move |(known, _)| near(known))
            .map(|(_, v)| *v)
    }

    /// True if no vertex is deeper than `depth` [m] below the surface, after a step that ended with a sum of
    /// motion of `motion_bound` [m]: a vertex with a plane is not below it, another one in its free ball.
    pub fn is_clear(
        &self,
        placed: &PosedObstacle,
        x: &[Point3<f64>],
        depth: f64,
        motion_bound: f64,
    ) -> bool {
        let near = NEAR * self.thickness;
        let inverse = placed.now.inverse();
        let is_free = |(known, &v): (&Known, &u32)| {
            let distance = known.closest.distance;
            let has_plane = distance <= near;
            has_plane
                || known.wake > motion_bound
                || (inverse * x[v as usize] - known.from).norm() <= distance
        };
        self.planes.iter().all(|r| r.height(x) >= -depth)
            && self.known.iter().zip(&self.vertices).all(is_free)
    }

    pub fn bytes(&self) -> usize {
        self.known.capacity() * std::mem::size_of::<Known>()
            + self.vertices.capacity() * 4
            + self.planes.capacity() * std::mem::size_of::<VertexPlane>()
            + self.normals.bytes()
    }
}

impl Value for Known {
    const MIN_BYTES: usize = 24 + (8 + 24 + 24) + 16 + 24;

    fn encode(&self, to: &mut Writer) {
        let Self {
            from,
            closest:
                Projection {
                    distance,
                    normal,
                    point,
                },
            bound,
            wake,
            normal: of_plane,
        } = self;
        to.put(from);
        to.put(distance);
        to.put(normal);
        to.put(point);
        to.put(&(*bound, *wake));
        to.put(of_plane);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let at = from.take()?;
        let closest = Projection {
            distance: from.take()?,
            normal: from.take()?,
            point: from.take()?,
        };
        let (bound, wake) = from.take()?;
        Ok(Self {
            from: at,
            closest,
            bound,
            wake,
            normal: from.take()?,
        })
    }
}

impl State for VertexContacts {
    fn save(&self, to: &mut Writer) {
        let Self {
            vertices: _,
            known,
            looked,
            planes,
            thickness: _,
            normals: _,
            lookups,
            stopped,
        } = self;
        to.list(known);
        to.list(looked);
        to.list(planes);
        to.put(&(*lookups, *stopped));
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        from.fill(&mut self.known)?;
        self.looked = from.take()?;
        from.check(
            self.looked.iter().all(|&k| (k as usize) < self.known.len()),
            "a lookup of no vertex",
        )?;
        self.planes = from.take()?;
        // Both are ascending, and a plane is found by its vertex.
        let mut free = self.vertices.iter();
        from.check(
            self.planes
                .iter()
                .all(|plane| free.any(|v| *v == plane.vertex)),
            "a plane of no free vertex",
        )?;
        (self.lookups, self.stopped) = from.take()?;
        Ok(())
    }
}

/// Start of a walk: the position at the beginning of the step if the path to it from the last query
/// is free, otherwise the position of that query. A correction can have moved the vertex out of its
/// small free ball since.
fn base(obstacle: &dyn Obstacle, before: &Known, start: Point3<f64>) -> (Point3<f64>, Projection) {
    let old = (before.from, before.closest);
    let Some(closest) = obstacle.closest_from(&start, &before.closest.point) else {
        return old;
    };
    // Two balls that overlap contain the whole segment between their centres.
    let free = closest.distance > 0.0
        && (start - before.from).norm() < closest.distance + before.closest.distance;
    if free && closest.distance > before.closest.distance {
        (start, closest)
    } else {
        old
    }
}

/// Moves from a free point towards a target in steps that cannot cross the surface, and slides
/// along the surface at about the contact thickness. `closest` is the nearest point of the surface
/// to `from`. Returns the end, its nearest point, and whether the surface allows no further motion.
fn walk(
    obstacle: &dyn Obstacle,
    from: &Point3<f64>,
    mut closest: Projection,
    to: &Point3<f64>,
    thickness: f64,
) -> (Point3<f64>, Projection, bool) {
    let mut at = *from;
    let mut left = to - from;
    for _ in 0..WALK {
        let height = closest.distance;
        if left.norm() < height {
            return (at + left, closest, true);
        }
        let mut lift = 0.0;
        if height <= thickness {
            // The component into the obstacle is removed; the rest slides, and rises to the height
            // of the plane.
            left -= closest.normal * left.dot(&closest.normal).min(0.0);
            lift = (thickness - height).min(0.4 * height);
        }
        let length = left.norm();
        // At most half a thickness down, or half of the height below that: never out of the free
        // ball.
        let step = length.min((height - 0.5 * thickness).max(0.5 * height));
        if !(length > 1e-3 * thickness && step > 1e-3 * thickness) {
            return (at, closest, length <= 1e-3 * thickness);
        }
        let by = left * (step / length);
        at += by + closest.normal * lift;
        left -= by;
        match obstacle.closest_from(&at, &closest.point) {
            Some(found) => closest = found,
            None => return (*to, closest, true),
        }
    }
    (at, closest, false)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::contact::Surface;
    use crate::mesh::shapes::icosphere;
    use crate::testing::Draw;

    /// Vertices around a ball of 0.1 m after their queries, and their positions after a motion.
    fn around(
        draw: &mut Draw,
        thickness: f64,
    ) -> (PosedObstacle, VertexContacts, Vec<Point3<f64>>, f64) {
        let still = Isometry3::identity();
        let obstacle = Arc::new(Surface::new(&icosphere(0.1, 3)));
        let placed = PosedObstacle {
            name: "ball".to_owned(),
            obstacle,
            before: still,
            now: still,
        };
        let x: Vec<Point3<f64>> = (0..400)
            .map(|k| Point3::from(draw.direction() * (0.1 + 1e-4 * f64::from(k))))
            .collect();
        let all: Vec<u32> = (0..400).collect();
        let contacts = VertexContacts::new(&placed, &all, &x, (thickness, 0.02), None);
        // Up to half of the motion of the nearest vertex before its next query.
        let away = |x: &Point3<f64>| placed.obstacle.closest(x).map_or(f64::MAX, |c| c.distance);
        let moved: Vec<Point3<f64>> = x
            .iter()
            .map(|x| x + draw.direction() * (0.25 * away(x).max(0.0)))
            .collect();
        let motion_bound = x
            .iter()
            .zip(&moved)
            .map(|(a, b)| (b - a).norm())
            .fold(0.0, f64::max);
        (placed, contacts, moved, motion_bound)
    }

    #[test]
    fn after_a_change_nothing_near_is_left_out_and_not_all_is_looked_up() {
        let mut draw = Draw::new(5);
        let mut forgotten = 0;
        for (thickness, other) in [(1e-3, 4e-3), (4e-3, 1e-3), (1e-3, 1.1e-3), (2e-3, 2e-3)] {
            let (placed, mut contacts, mut x, motion_bound) = around(&mut draw, thickness);
            // Some vertices are no longer free.
            let free: Vec<u32> = (0..400).filter(|v| v % 7 != 3).collect();
            let before = contacts.lookups;
            contacts.change(&placed, &free, &x, other, motion_bound);
            assert!(
                contacts.lookups - before < free.len() as u64,
                "{thickness} to {other}: all were looked up"
            );
            let missing = |contacts: &VertexContacts, x: &[Point3<f64>], within: f64| {
                let near: Vec<u32> = contacts.near().collect();
                let is_near = |v: &&u32| {
                    placed
                        .obstacle
                        .closest(&x[**v as usize])
                        .is_some_and(|c| c.distance < within)
                };
                free.iter()
                    .filter(is_near)
                    .filter(|v| !near.contains(v))
                    .count()
            };
            let start = x.clone();
            contacts.update(
                &placed,
                &start,
                &mut x,
                MotionBound {
                    at_least: motion_bound,
                    at_most: motion_bound,
                },
            );
            assert_eq!(missing(&contacts, &x, other), 0, "{thickness} to {other}");
            let (_, old, ..) = around(&mut draw, thickness);
            forgotten += missing(&old, &x, NEAR * other);
        }
        assert!(
            forgotten > 0,
            "control: what was known for a thin layer does not do for a thick one"
        );
    }
}
