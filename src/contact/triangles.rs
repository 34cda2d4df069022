//! Contact of the vertices of one obstacle with the triangles of a muscle.

use std::collections::HashSet;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::motion_bound::MotionBound;
use super::surface::Surface;
use super::{Obstacle, OnTriangle, PosedObstacle};
use crate::constraints::{
    Constraint, plane_contact::PlaneContact, triangle_contact::TriangleContact,
};
use crate::mesh::measures::max_or_nan;
use crate::particles::Particles;
use crate::state::{DecodeError, Reader, Value, Writer};

/// A bone vertex farther from the muscle than this is inactive, in contact thicknesses: the least, and the
/// most, and between them [`MOST_EDGES`]. Of a half of it, one is the contact itself. The rest is for the
/// corrections of a step, during which nothing is queried.
const NEAR: [f64; 2] = [4.0, 6.0];

/// Below this distance from the surface, in contact thicknesses, the pseudo-normal alone decides on
/// the side of a point.
const DOUBT: f64 = 0.4;

/// Motion during which an active vertex needs no new query, in contact thicknesses: the least, which is
/// that of two corrections, and the most. A greater value makes its list of triangles longer.
const MARGIN: [f64; 2] = [2.0, 6.0];

/// Mean edges beyond which a greater thickness makes neither of them greater.
const MOST_EDGES: f64 = 2.0;

/// Of about this number of listed triangles one is tested, as boxes exclude the others.
const LISTED: usize = 4;

/// A due query triggers others that are due within this motion, in contact thicknesses: this saves
/// refits.
const EARLY: f64 = 0.5;

/// A bone vertex with the muscle's triangles that it can touch before its next query.
#[derive(Clone, Debug)]
struct Watched {
    point: u32,
    triangles: Vec<u32>,
}

/// Result of a query.
struct Found {
    triangle: u32,
    /// Signed distance, or a lower bound for a distant vertex [m].
    distance: f64,
    /// Motion for which the result is valid [m].
    bound: f64,
    watched: Option<Watched>,
}

/// Contact state of each vertex of an obstacle with respect to the muscle.
#[derive(Clone, Debug)]
pub(super) struct TriangleContacts {
    /// Sum of motion at which each inactive vertex gets a new query.
    wake: Vec<f64>,
    /// Signed distance of each vertex at its last query, and the sum of motion at that time.
    last: Vec<(f64, f64)>,
    /// The nearest triangle of each vertex at its last query.
    nearest: Vec<u32>,
    watched: Vec<Watched>,
    /// Contact planes that moved triangles in this step.
    pub active: Vec<TriangleContact>,
    thickness: f64,
    /// A bone vertex farther from the muscle than this is inactive [m].
    near: f64,
    /// Motion during which an active vertex needs no new query [m].
    margin: f64,
    /// Vertices with a query in this step, with the motion of the surface since the last refit for
    /// which the result is valid. They need no other query until the end of the step: their
    /// distance to the surface is known exactly, and the sum of motion only within twice the motion
    /// of the step.
    looked: Vec<(u32, f64)>,
    /// Number of queries.
    pub lookups: u64,
    /// Number of triangles that projections have tested, for a budget of work.
    pub tested: usize,
}

impl TriangleContacts {
    /// Contact within `thickness` [m] with a surface whose edges are about `edge` [m] long.
    pub fn new(obstacle: &dyn Obstacle, thickness: f64, edge: f64) -> Self {
        let wake = vec![f64::NEG_INFINITY; obstacle.contact_samples().len()];
        let last = vec![(0.0, f64::NEG_INFINITY); wake.len()];
        let nearest = vec![u32::MAX; wake.len()];
        let limited = |[least, most]: [f64; 2]| {
            (most * thickness)
                .min(MOST_EDGES * edge)
                .max(least * thickness)
        };
        Self {
            wake,
            last,
            nearest,
            watched: Vec::new(),
            active: Vec::new(),
            thickness,
            near: limited(NEAR),
            margin: limited(MARGIN),
            looked: Vec::new(),
            lookups: 0,
            tested: 0,
        }
    }

    /// True if some vertex needs a query and the surface must be refitted; the surface has moved by
    /// `since` [m] since its last refit.
    pub fn is_due(&self, motion_bound: MotionBound, since: f64) -> bool {
        self.wake.iter().any(|w| *w <= motion_bound.at_most)
            || self.looked.iter().any(|(_, bound)| *bound <= since)
    }

    /// True if any vertex had a query in this step.
    pub fn has_looked(&self) -> bool {
        !self.looked.is_empty()
    }

    /// Queries every vertex whose bound is used up, on a refitted surface that had moved by `since`
    /// [m] since the previous refit.
    pub fn update(
        &mut self,
        placed: &PosedObstacle,
        surface: &Surface,
        motion_bound: MotionBound,
        since: f64,
    ) {
        let points = placed.obstacle.contact_samples();
        // Queries that are due soon happen now, since the refit is already paid for.
        let early = EARLY * self.thickness;
        let soon = motion_bound.at_most + early;
        let mut due: Vec<u32> = (0..points.len() as u32)
            .filter(|&k| self.wake[k as usize] <= soon)
            .collect();
        self.looked.retain_mut(|(k, bound)| {
            *bound -= since;
            if *bound <= early {
                due.push(*k);
            }
            *bound > early
        });
        due.sort_unstable();
        let found: Vec<Found> = due
            .par_iter()
            .with_min_len(32)
            .map(|&k| self.look_up(k, placed, surface, motion_bound))
            .collect();
        self.lookups += due.len() as u64;
        let mut fresh = vec![false; points.len()];
        due.iter().for_each(|&k| fresh[k as usize] = true);
        self.watched.retain(|w| !fresh[w.point as usize]);
        for (&k, found) in due.iter().zip(found) {
            self.nearest[k as usize] = found.triangle;
            self.last[k as usize] = (found.distance, motion_bound.at_least);
            self.wake[k as usize] = f64::INFINITY;
            self.looked.push((k, found.bound));
            self.watched.extend(found.watched);
        }
        self.watched.sort_unstable_by_key(|w| w.point);
    }

    fn look_up(
        &self,
        k: u32,
        placed: &PosedObstacle,
        surface: &Surface,
        motion_bound: MotionBound,
    ) -> Found {
        let near = self.near;
        let p = placed.now * placed.obstacle.contact_samples()[k as usize];
        let triangle = self.nearest[k as usize];
        let asleep = |triangle, distance: f64| {
            let bound = (distance - near / 2.0).max(distance / 2.0);
            Found {
                triangle,
                distance,
                bound,
                watched: None,
            }
        };
        let known = if triangle == u32::MAX {
            f64::MAX
        } else {
            surface.distance_to(&p, triangle)
        };
        if known < f64::MAX && self.last[k as usize].0 > near {
            // A distant vertex needs only a lower bound.
            let (lower, nearer) = surface.lower_bound(&p, known);
            if lower > near {
                return asleep(nearer.unwrap_or(triangle), lower);
            }
        }
        let Some(on) = surface.nearest_below(&p, known) else {
            return asleep(triangle, f64::MAX);
        };
        let sign = self.side(k, on.closest.distance, motion_bound, || {
            surface.winds_about(&p, surface.positions(), 0.0).0
        });
        let distance = sign * on.closest.distance.abs();
        if distance > near {
            return asleep(on.triangle, distance);
        }
        let margin = (distance.abs() / 2.0).max(self.margin);
        let mut triangles = Vec::new();
        surface.within(&p, distance.abs() + 2.0 * margin, &mut triangles);
        Found {
            triangle: on.triangle,
            distance,
            bound: margin,
            watched: Some(Watched {
                point: k,
                triangles,
            }),
        }
    }

    /// Ends a step after a sum of motion of `motion_bound` [m]; the surface made `since` of it after its
    /// last refit.
    pub fn end_step(&mut self, motion_bound: f64, since: f64) {
        for (k, bound) in self.looked.drain(..) {
            self.wake[k as usize] = motion_bound + bound - since;
        }
    }

    /// Moves triangles off the vertices within the thickness. Returns the largest correction [m].
    pub fn project(
        &mut self,
        placed: &PosedObstacle,
        surface: &Surface,
        particles: &mut Particles,
        motion_bound: MotionBound,
    ) -> f64 {
        let points = placed.obstacle.contact_samples();
        let mut largest = 0.0_f64;
        // How far the surface has moved since its last refit [m], as soon as that is needed.
        let mut moved = None;
        let mut rays = 0;
        for watched in &self.watched {
            let (before, at) = self.last[watched.point as usize];
            if before - (motion_bound.at_most - at) >= self.thickness {
                continue;
            }
            let p = placed.now * points[watched.point as usize];
            let likely = self.nearest[watched.point as usize];
            self.tested += watched.triangles.len().div_ceil(LISTED);
            let found = surface.nearest_among(&p, &watched.triangles, likely, &particles.position);
            let Some(mut on) = found else { continue };
            self.nearest[watched.point as usize] = on.triangle;
            let sign = self.side(watched.point, on.closest.distance, motion_bound, || {
                let x = &particles.position;
                let moved = moved.get_or_insert_with(|| surface.farthest(x));
                let (winding, tested) = surface.winds_about(&p, x, *moved);
                rays += tested;
                winding
            });
            if sign * on.closest.distance < 0.0 {
                on.closest.distance = -on.closest.distance;
                on.closest.normal = -on.closest.normal;
            }
            self.last[watched.point as usize] = (on.closest.distance, motion_bound.at_least);
            if on.closest.distance >= self.thickness {
                continue;
            }
            let contact = self.contact(surface, &p, &on);
            let x = contact.points.map(|v| particles.position[v as usize]);
            let Some((c, gradient)) = contact.value_and_gradient(&x) else {
                continue;
            };
            let w = contact.points.map(|v| particles.inverse_mass[v as usize]);
            let each = || gradient.iter().zip(w).map(|(g, w)| (w, g.norm()));
            let weight: f64 = each().map(|(w, g)| w * g * g).sum();
            if weight <= 0.0 || c >= 0.0 {
                continue;
            }
            // Near a fixed corner the others have no lever: no corner moves farther than twice the
            // penetration.
            let weight = max_or_nan(each().map(|(w, g)| 0.5 * w * g).chain([weight]));
            // No corner moves farther than the thickness at once: deep penetrations resolve over
            // several sweeps.
            let c = c.max(-self.thickness);
            for ((v, g), w) in contact.points.into_iter().zip(gradient).zip(w) {
                let x = &mut particles.position[v as usize];
                *x -= g * (w * c / weight);
                moved = moved
                    .map(|moved: f64| moved.max((*x - surface.positions()[v as usize]).norm()));
            }
            largest = largest.max(-c);
            self.active.push(contact);
        }
        self.tested += rays;
        largest
    }

    /// The side of the muscle's surface on which a point lies: 1 outside, -1 inside.
    ///
    /// A point whose distance exceeds its motion since the last query is still on the same side.
    /// Where this and the pseudo-normal do not both give outside, and it matters, the exact winding
    /// number decides. A crumpled surface has misleading normals, and a point wrongly classified as
    /// inside would attract the muscle.
    fn side(
        &self,
        point: u32,
        distance: f64,
        motion_bound: MotionBound,
        winding: impl FnOnce() -> i32,
    ) -> f64 {
        let (before, at) = self.last[point as usize];
        let kept = before > 0.0 && before + distance.abs() > motion_bound.at_most - at;
        if kept && (distance > 0.0 || distance.abs() > self.thickness) {
            return 1.0;
        }
        if !kept && distance > 0.0 && before > 0.0 {
            return 1.0;
        }
        if distance.abs() <= DOUBT * self.thickness {
            return distance.signum();
        }
        if winding() == 0 { 1.0 } else { -1.0 }
    }

    /// True if no active point is inside the muscle, by exact winding numbers on a refitted surface.
    pub fn is_clear(&mut self, placed: &PosedObstacle, surface: &Surface) -> bool {
        // The surface was refitted; its earlier motion is unknown.
        self.looked
            .drain(..)
            .for_each(|(k, _)| self.wake[k as usize] = f64::NEG_INFINITY);
        let points = placed.obstacle.contact_samples();
        self.watched.iter().all(|w| {
            let p = placed.now * points[w.point as usize];
            let (before, _) = self.last[w.point as usize];
            let doubtful = before < 2.0 * self.thickness;
            !doubtful || surface.winds_about(&p, surface.positions(), 0.0).0 == 0
        })
    }

    /// The last contact of each point that moved triangles in this step. A point moves them in several
    /// sweeps, and each row makes the factor of a minimum greater.
    pub fn last_active(&self) -> Vec<&TriangleContact> {
        let bits = |contact: &TriangleContact| contact.origin.coords.map(f64::to_bits);
        let mut seen = HashSet::new();
        let newest = self.active.iter().rev();
        let mut last: Vec<_> = newest
            .filter(|contact| seen.insert(bits(contact)))
            .collect();
        last.reverse();
        last
    }

    fn contact(&self, surface: &Surface, p: &Point3<f64>, on: &OnTriangle) -> TriangleContact {
        TriangleContact {
            points: surface.triangles()[on.triangle as usize],
            origin: *p,
            normal: on.closest.normal,
            weights: on.weights,
            thickness: self.thickness,
        }
    }

    pub fn bytes(&self) -> usize {
        self.wake.capacity() * (8 + 16 + 4)
            + self
                .watched
                .iter()
                .map(|w| std::mem::size_of::<Watched>() + w.triangles.capacity() * 4)
                .sum::<usize>()
            + self.active.capacity() * std::mem::size_of::<TriangleContact>()
    }
}

impl Value for Watched {
    const MIN_BYTES: usize = 4 + 8;

    fn encode(&self, to: &mut Writer) {
        let Self { point, triangles } = self;
        to.put(point);
        to.list(triangles);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self {
            point: from.take()?,
            triangles: from.take()?,
        })
    }
}

impl Value for TriangleContact {
    const MIN_BYTES: usize = 12 + 24 + 24 + 24 + 8;

    fn encode(&self, to: &mut Writer) {
        let Self {
            points,
            origin,
            normal,
            weights,
            thickness,
        } = self;
        to.put(points);
        to.put(origin);
        to.put(normal);
        to.put(weights);
        to.put(thickness);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let (points, origin, normal) = (from.take()?, from.take()?, from.take()?);
        Ok(Self {
            points,
            origin,
            normal,
            weights: from.take()?,
            thickness: from.take()?,
        })
    }
}

impl TriangleContacts {
    /// Appends the state.
    pub fn save(&self, to: &mut Writer) {
        let Self {
            wake,
            last,
            nearest,
            watched,
            active,
            thickness: _,
            near: _,
            margin: _,
            looked,
            lookups,
            tested: _,
        } = self;
        to.list(wake);
        to.list(last);
        to.list(nearest);
        to.list(watched);
        to.list(active);
        to.list(looked);
        to.put(lookups);
    }

    /// Restores the state of contact with `surface`.
    pub fn restore(&mut self, from: &mut Reader<'_>, surface: &Surface) -> Result<(), DecodeError> {
        let (points, triangles) = (self.wake.len(), surface.triangles().len());
        let (is_point, is_triangle) = (
            |k: u32| (k as usize) < points,
            |t: u32| (t as usize) < triangles,
        );
        let vertices = surface.positions().len();
        from.fill(&mut self.wake)?;
        from.fill(&mut self.last)?;
        from.fill(&mut self.nearest)?;
        from.check(
            self.nearest
                .iter()
                .all(|&t| t == u32::MAX || is_triangle(t)),
            "no such triangle is nearest",
        )?;
        self.watched = from.take()?;
        let sound = |w: &Watched| is_point(w.point) && w.triangles.iter().all(|&t| is_triangle(t));
        from.check(
            self.watched.iter().all(sound),
            "a point or triangle that is not there is watched",
        )?;
        self.active = from.take()?;
        let sound =
            |contact: &TriangleContact| contact.points.iter().all(|&v| (v as usize) < vertices);
        from.check(self.active.iter().all(sound), "a contact of no triangle")?;
        self.looked = from.take()?;
        from.check(
            self.looked.iter().all(|&(k, _)| is_point(k)),
            "a lookup of no point",
        )?;
        self.lookups = from.take()?;
        Ok(())
    }
}

/// The contact plane of a vertex as a constraint, for residuals and for the conformance suite.
pub(super) fn plane_contact(
    vertex: u32,
    origin: Point3<f64>,
    normal: Vector3<f64>,
    thickness: f64,
) -> PlaneContact {
    PlaneContact {
        points: [vertex],
        origin,
        normal,
        thickness,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn a_point_that_pushes_in_several_sweeps_gives_one_row() {
        let bone = Surface::new(&icosphere(1.0, 1));
        let mut contacts = TriangleContacts::new(&bone, 0.1, 1.0);
        let contact = |x: f64, share: f64| TriangleContact {
            points: [0, 1, 2],
            origin: Point3::new(x, 0.0, 0.0),
            normal: Vector3::x(),
            weights: [share, 1.0 - share, 0.0],
            thickness: 0.1,
        };
        contacts.active = vec![contact(1.0, 0.2), contact(2.0, 0.3), contact(1.0, 0.4)];
        let of = |contact: &&TriangleContact| (contact.origin.x, contact.weights[0]);
        let last: Vec<_> = contacts.last_active().iter().map(of).collect();
        assert_eq!(last, [(2.0, 0.3), (1.0, 0.4)]);
    }

    #[test]
    fn reaches_end_at_two_edges_but_leave_room_for_corrections() {
        let bone = Surface::new(&icosphere(1.0, 1));
        let reach = |thickness: f64| {
            let contacts = TriangleContacts::new(&bone, thickness, 1.0);
            [contacts.near, contacts.margin]
        };
        assert_eq!(reach(0.25), [1.5, 1.5]);
        assert_eq!(reach(0.4375), [2.0, 2.0]);
        assert_eq!(reach(4.0), [16.0, 8.0]);
    }
}
