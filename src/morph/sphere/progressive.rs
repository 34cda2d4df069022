//! The robust map: vertices are taken out until a tetrahedron is left, and put back where they see their neighbours.
//!
//! A triangulated sphere with more than four vertices always has an edge that can be contracted (Steinitz), so that a
//! tetrahedron is reached. On the sphere its four triangles are turned outward. When a vertex u that was drawn into v is
//! put back, the places that see all of its ring are not empty: close to v, in the angle between the two edges that v keeps.
//! So every triangle is turned outward after every insertion, in exact arithmetic always \[praun2003\]; with doubles every
//! place is tested by an exact predicate before it is taken, and where none is left, that is an error.
//!
//! In between all vertices move to where the surface is stretched least. With a fair sample of the surface at every stage (see
//! [`super::removal`]) a long body does not crowd into two spots, as it does by relaxation (erratum M21).

use nalgebra::{Point3, Vector2, Vector3};

use super::SphereError;
use super::kernel::{kernel, middle, sees};
use super::removal::{oriented_points, reduce};
use super::rings::{Removed, Rings};
use super::stretch::{Patch, Stretch, energy, stretch};
use crate::mesh::TriangleMesh;
use crate::mesh::shapes::tetrahedron;

/// All vertices are moved whenever there are so many times more of them.
const GROWTH: f64 = 1.2;
/// Passes over all vertices each time.
const PASSES: usize = 4;
/// Passes at the end.
const LAST_PASSES: usize = 12;
/// Part of the mean area of a triangle that is added to areas and squares of lengths.
const LEAST: f64 = 1e-3;
/// Lengths of a step that are tried.
const STEPS: usize = 7;
/// Attempts to make room for a vertex.
const ATTEMPTS: usize = 20;
/// Steps towards the neighbour that a vertex was drawn into; beyond these nothing moves.
const HALVINGS: usize = 50;

/// Positions on the unit sphere of the vertices of a mesh that was checked.
pub fn map(mesh: &TriangleMesh) -> Result<Vec<Point3<f64>>, SphereError> {
    let Some(rings) = Rings::new(mesh.vertices.len(), &mesh.triangles) else {
        return Err(SphereError::Vertex { vertex: 0 });
    };
    let (rings, removed) = reduce(&oriented_points(mesh), rings)?;
    let base: Vec<u32> = (0..mesh.vertices.len() as u32)
        .filter(|&v| !rings.of(v).is_empty())
        .collect();
    let points = vec![Point3::origin(); mesh.vertices.len()];
    let area = mesh.area();
    let mut working = Working {
        rings,
        points,
        places: &mesh.vertices,
        least: 0.0,
        ring: Vec::new(),
        patches: Vec::new(),
    };
    working.place_base(base[0]);
    let mut placed = base;
    let mut next = 8.0;
    for last in removed.iter().rev() {
        working.least = LEAST * area / (2 * placed.len()) as f64;
        if !working.insert(last) {
            let (placed, vertices) = (placed.len(), mesh.vertices.len());
            return Err(SphereError::Crowded {
                vertex: last.vertex,
                placed,
                vertices,
            });
        }
        placed.push(last.vertex);
        working.open(last);
        working.settle(last.vertex);
        for &v in &last.ring {
            working.settle(v);
        }
        if placed.len() as f64 >= next {
            next *= GROWTH;
            placed.iter().for_each(|&v| working.smooth(v));
            (0..PASSES).for_each(|_| placed.iter().for_each(|&v| working.settle(v)));
        }
    }
    (0..LAST_PASSES).for_each(|_| placed.iter().for_each(|&v| working.settle(v)));
    Ok(working.points)
}

struct Working<'a> {
    rings: Rings,
    points: Vec<Point3<f64>>,
    /// Places of the vertices on the surface \[m\].
    places: &'a [Point3<f64>],
    /// Added to areas and squares of lengths \[m^2\].
    least: f64,
    /// Positions of one ring, and its triangles on the surface, kept to be filled again.
    ring: Vec<Point3<f64>>,
    patches: Vec<Patch>,
}

impl Working<'_> {
    fn place_base(&mut self, first: u32) {
        let corners = tetrahedron().vertices;
        self.points[first as usize] = corners[0];
        let ring: Vec<u32> = self.rings.of(first).to_vec();
        // Triangle (0, 1, 3) of the tetrahedron is turned outward.
        ring.iter()
            .zip([1, 3, 2])
            .for_each(|(&v, k)| self.points[v as usize] = corners[k]);
    }

    fn gather(&mut self, vertex: u32) {
        self.ring.clear();
        self.ring.extend(
            self.rings
                .of(vertex)
                .iter()
                .map(|&v| self.points[v as usize]),
        );
    }

    /// Puts a vertex back where it sees its neighbours; where doubles leave no such place they make room first.
    fn insert(&mut self, removed: &Removed) -> bool {
        for _ in 0..ATTEMPTS {
            self.rings.restore(removed);
            if let Some(place) = self.place_of(removed) {
                self.points[removed.vertex as usize] = place;
                return true;
            }
            self.rings.draw(removed.vertex, removed.ring[0]);
            for &v in removed.ring[1..].iter().chain(&removed.ring[..1]) {
                self.smooth(v);
                self.settle(v);
            }
        }
        false
    }

    fn place_of(&mut self, removed: &Removed) -> Option<Point3<f64>> {
        self.gather(removed.vertex);
        let near = self.points[removed.ring[0] as usize];
        let mut place = middle(&kernel(&near, &self.ring))?;
        for _ in 0..HALVINGS {
            if sees(&place, &self.ring) {
                return Some(place);
            }
            // Nearer to the neighbour that it was drawn into, where there is always room.
            place = (place.coords + near.coords)
                .try_normalize(0.0)
                .map(Point3::from)?;
        }
        None
    }

    /// Moves a vertex that was put back and its ring to the middles of their stars. The place that was left between them may be
    /// a sliver, and a sliver keeps itself: each of its corners alone finds less stretch only where it runs against the others.
    fn open(&mut self, last: &Removed) {
        last.ring.iter().for_each(|&v| self.smooth(v));
        self.smooth(last.vertex);
    }

    /// Moves a vertex to where its triangles are stretched least, as far as it sees its ring on the way.
    fn settle(&mut self, vertex: u32) {
        self.gather(vertex);
        self.compare(vertex);
        let at = self.points[vertex as usize];
        let aside = Vector3::ith(at.coords.iamin(), 1.0);
        let first = at.coords.cross(&aside).normalize();
        let frame = [first, at.coords.cross(&first)];
        let now = stretch(&at, &self.ring, &self.patches, &frame);
        let step = downhill(&now).map(|step| frame[0] * step.x + frame[1] * step.y);
        let middle = self
            .ring
            .iter()
            .map(|p| p.coords)
            .sum::<Vector3<f64>>()
            .try_normalize(0.0);
        // A vertex that is caught in a thin star gets out of it by way of the middle.
        for (step, steps) in [(step, STEPS), (middle.map(|m| m - at.coords), 3)] {
            let Some(step) = step else { continue };
            let mut share = 1.0;
            for _ in 0..steps {
                let Some(target) = (at.coords + step * share)
                    .try_normalize(0.0)
                    .map(Point3::from)
                else {
                    break;
                };
                if sees(&target, &self.ring)
                    && energy(&target, &self.ring, &self.patches) < now.energy
                {
                    self.points[vertex as usize] = target;
                    return;
                }
                share *= 0.4;
            }
        }
    }

    /// Moves a vertex to the middle of its star, weighted by area, as far as it sees its ring on the way.
    fn smooth(&mut self, vertex: u32) {
        self.gather(vertex);
        let at = self.points[vertex as usize];
        let mut sum = Vector3::zeros();
        for i in 0..self.ring.len() {
            let (a, b) = (
                &self.ring[i],
                &self.ring[if i + 1 == self.ring.len() { 0 } else { i + 1 }],
            );
            let area = (a - at).cross(&(b - at)).norm();
            sum += (at.coords + a.coords + b.coords) * area;
        }
        let Some(mut target) = sum.try_normalize(0.0).map(Point3::from) else {
            return;
        };
        for _ in 0..3 {
            if sees(&target, &self.ring) {
                self.points[vertex as usize] = target;
                return;
            }
            let Some(half) = (target.coords + at.coords).try_normalize(0.0) else {
                return;
            };
            target = Point3::from(half);
        }
    }

    /// What the triangles at a vertex are on the surface.
    fn compare(&mut self, vertex: u32) {
        let at = |v: u32| &self.places[v as usize];
        let (ring, own) = (self.rings.of(vertex), at(vertex));
        self.patches.clear();
        let next = |i: usize| if i + 1 == ring.len() { 0 } else { i + 1 };
        self.patches.extend(
            (0..ring.len()).map(|i| Patch::new(own, at(ring[i]), at(ring[next(i)]), self.least)),
        );
    }
}

/// Newton's step with the sizes of the two curvatures, so that it goes down where the energy is not convex as well; `None`
/// where numbers fail.
fn downhill(now: &Stretch) -> Option<Vector2<f64>> {
    let h = now.hessian;
    let (mean, half) = (0.5 * (h.m11 + h.m22), 0.5 * (h.m11 - h.m22));
    let radius = (half * half + h.m12 * h.m12).sqrt();
    let (high, low) = (mean + radius, mean - radius);
    // Direction of the greater curvature, from the better conditioned of its two forms.
    let along = if half > 0.0 {
        Vector2::new(half + radius, h.m12)
    } else {
        Vector2::new(h.m12, radius - half)
    };
    let along = along.try_normalize(0.0).unwrap_or_else(Vector2::x);
    let across = Vector2::new(-along.y, along.x);
    let floor = 1e-12 * high.abs().max(low.abs());
    let size = |bend: f64| bend.abs().max(floor);
    let step = along * (-now.gradient.dot(&along) / size(high))
        + across * (-now.gradient.dot(&across) / size(low));
    step.iter().all(|c| c.is_finite()).then_some(step)
}
