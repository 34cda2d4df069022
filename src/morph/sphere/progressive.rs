//! The robust map: vertices are removed until a tetrahedron remains, and reinserted where they see
//! their neighbours.
//!
//! A triangulated sphere with more than four vertices always has an edge that can be contracted
//! (Steinitz), so the removal reaches a tetrahedron. On the sphere its four triangles are oriented
//! outward. A vertex u that was merged into v has a non-empty kernel at its reinsertion: close to
//! v, in the angle between the two edges that v keeps. So every triangle is oriented outward after
//! every insertion in exact arithmetic \[praun2003\]. In doubles an exact predicate tests every
//! position first; no valid position is an error.
//!
//! Between insertions all vertices move to positions of least stretch. Each stage is an even sample
//! of the surface (see [`super::removal`]), so a long body does not collapse into two clusters, as
//! in relaxation (erratum M21).

use nalgebra::{Point3, Vector2, Vector3};

use super::SphereError;
use super::kernel::{kernel, middle, sees};
use super::removal::{oriented_points, reduce};
use super::rings::{Removed, Rings};
use super::stretch::{Patch, Stretch, energy, stretch};
use crate::mesh::TriangleMesh;
use crate::mesh::shapes::tetrahedron;

/// All vertices move whenever their number has grown by this factor.
const GROWTH: f64 = 1.2;
/// Number of passes over all vertices each time.
const PASSES: usize = 4;
/// Number of passes at the end.
const LAST_PASSES: usize = 12;
/// Share of the mean triangle area that is added to areas and squared lengths.
const LEAST: f64 = 1e-3;
/// Number of step lengths that are tried.
const STEPS: usize = 7;
/// Number of attempts to make room for a vertex.
const ATTEMPTS: usize = 20;
/// Number of halvings towards the neighbour of the contraction; smaller steps change nothing.
const HALVINGS: usize = 50;

/// Positions on the unit sphere of the vertices of a checked mesh.
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
    /// Positions of the vertices on the surface \[m\].
    places: &'a [Point3<f64>],
    /// Addition to areas and squared lengths \[m^2\].
    least: f64,
    /// Positions of one ring, and its triangles on the surface, as reused buffers.
    ring: Vec<Point3<f64>>,
    patches: Vec<Patch>,
}

impl Working<'_> {
    fn place_base(&mut self, first: u32) {
        let corners = tetrahedron().vertices;
        self.points[first as usize] = corners[0];
        let ring: Vec<u32> = self.rings.of(first).to_vec();
        // Triangle (0, 1, 3) of the tetrahedron is oriented outward.
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

    /// Reinserts a vertex where it sees its neighbours; if doubles have no such position, the
    /// neighbours make room first.
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
            // Nearer to the neighbour of the contraction, where there is always room.
            place = (place.coords + near.coords)
                .try_normalize(0.0)
                .map(Point3::from)?;
        }
        None
    }

    /// Moves a reinserted vertex and its ring to the centroids of their stars. The kernel between
    /// them can be a sliver, and slivers persist: a single corner reduces the stretch only by
    /// moving against the others.
    fn open(&mut self, last: &Removed) {
        last.ring.iter().for_each(|&v| self.smooth(v));
        self.smooth(last.vertex);
    }

    /// Moves a vertex to the position of least stretch, as far as it sees its ring along the step.
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
        // A vertex in a thin star leaves it through the centroid.
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

    /// Moves a vertex to the area-weighted centroid of its star, as far as it sees its ring along
    /// the step.
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

    /// Sets the triangles at a vertex as they are on the surface.
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

/// Newton's step with the absolute values of the two curvatures, so that it descends also where the
/// energy is not convex; `None` for invalid numbers.
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
