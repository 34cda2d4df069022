//! Contact of one muscle with all of its obstacles: closest points, corrections, friction, pinched
//! vertices.

use nalgebra::{Isometry3, Point3, Vector3};

use super::active_normals::ActiveNormals;
use super::motion_bound::MotionBound;
use super::plane::ContactPlane;
use super::surface::Surface;
use super::triangles::{TriangleContacts, plane_contact};
use super::vertices::VertexContacts;
use super::{Obstacle, PosedObstacle, Projection};
use crate::constraints::{Constraint, TriangleContact};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;
use crate::particles::Particles;
use crate::state::{DecodeError, Reader, State, Writer};

/// Distance between a bone vertex and a triangle, in contact thicknesses. It is smaller than that
/// between a vertex and a bone, so that a triangle whose corners rest on a gently curved bone does
/// not move.
pub(crate) const OVER_VERTEX: f64 = 0.5;

/// Number of rounds in which a vertex between two bones must find room before its distance to them
/// is reduced.
const ROUNDS: usize = 8;

/// Greatest number of sweeps over all planes of a step, and the greatest correction of the last
/// sweep relative to the thickness.
const SWEEPS: usize = 12;
const NEARLY: f64 = 0.02;

/// Number of triangles that are tested in about the time of a step of one vertex.
const OF_A_STEP: usize = 16;

/// Counts of one muscle's contact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Vertices in contact with a bone (within 1.5 thicknesses).
    pub touching: usize,
    /// Vertices between bones closer together than twice the thickness.
    pub pinched: usize,
    /// Number of closest-point queries so far.
    pub lookups: u64,
    /// Number of paths that ended before a bone so far.
    pub stopped: u64,
    /// Number of calls so far.
    pub calls: u64,
}

/// Contact of one muscle with every obstacle within its reach.
#[derive(Clone)]
pub struct Contacts {
    /// Indices into the scene's obstacles.
    obstacles: Vec<usize>,
    vertices: Vec<VertexContacts>,
    triangles: Vec<TriangleContacts>,
    surface: Surface,
    /// Mean edge of the surface as it was built [m].
    edge: f64,
    thickness: f64,
    friction: f64,
    /// Bound on the motion of every vertex relative to each obstacle since the beginning [m].
    motion_bound: Vec<f64>,
    start: Vec<Point3<f64>>,
    /// Positions before the corrections.
    unpushed: Vec<Point3<f64>>,
    pinched: Vec<u32>,
    calls: u64,
}

impl Contacts {
    /// Contact of a muscle with the given `obstacles` of `placed`; vertices with zero inverse mass
    /// are left out.
    pub fn new(
        mesh: &TriangleMesh,
        particles: &Particles,
        placed: &[PosedObstacle],
        obstacles: Vec<usize>,
        thickness: f64,
        friction: f64,
    ) -> Self {
        Self::known(
            Surface::new(mesh),
            particles,
            placed,
            obstacles,
            (thickness, friction),
            |_| None,
        )
    }

    /// The same as [`Self::new`], with the muscle's surface and, where available, the nearest
    /// points of obstacle `o` to each vertex.
    pub(crate) fn known<'a>(
        mut surface: Surface,
        particles: &Particles,
        placed: &[PosedObstacle],
        obstacles: Vec<usize>,
        (thickness, friction): (f64, f64),
        near: impl Fn(usize) -> Option<&'a [Option<Projection>]>,
    ) -> Self {
        let (free, x) = (free(particles).collect::<Vec<u32>>(), &particles.position);
        let edge = surface.mean_edge();
        let sizes = (thickness, edge);
        let vertices = |&o: &usize| VertexContacts::new(&placed[o], &free, x, sizes, near(o));
        let vertices = obstacles.iter().map(vertices).collect();
        let triangles = obstacles
            .iter()
            .map(|&o| of_triangles(&placed[o], sizes))
            .collect();
        surface.refit(x);
        Self {
            motion_bound: vec![0.0; obstacles.len()],
            obstacles,
            vertices,
            triangles,
            surface,
            edge,
            thickness,
            friction,
            start: particles.position.clone(),
            unpushed: particles.position.clone(),
            pinched: Vec::new(),
            calls: 0,
        }
    }

    /// This contact with other numbers between two steps, possibly with other free vertices of the
    /// same muscle. Queries happen only where the known bounds are not sufficient.
    #[must_use]
    pub(crate) fn with(
        &self,
        particles: &Particles,
        placed: &[PosedObstacle],
        (thickness, friction): (f64, f64),
    ) -> Self {
        let free: Vec<u32> = free(particles).collect();
        let mut next = Self {
            thickness,
            friction,
            ..self.clone()
        };
        for (k, &o) in self.obstacles.iter().enumerate() {
            next.vertices[k].change(
                &placed[o],
                &free,
                &particles.position,
                thickness,
                self.motion_bound[k],
            );
            if let Some(old) = self
                .triangles
                .get(k)
                .filter(|_| thickness != self.thickness)
            {
                next.triangles[k] = of_triangles(&placed[o], (thickness, self.edge));
                next.triangles[k].lookups = old.lookups;
            }
        }
        next
    }

    /// This contact without the points of bones: a [`Meeting`](super::meeting::Meeting) keeps them, and
    /// edges, out of triangles.
    #[must_use]
    pub(crate) fn of_vertices_alone(mut self) -> Self {
        self.triangles.clear();
        self
    }

    /// A superset of the free vertices in or near obstacle `o`, after the last correction.
    pub fn near(&self, o: usize) -> impl Iterator<Item = u32> {
        let of = self
            .vertices
            .iter()
            .zip(&self.obstacles)
            .filter(move |(_, known)| **known == o);
        of.flat_map(|(contacts, _)| contacts.near())
    }

    /// Indices of the obstacles.
    pub fn obstacles(&self) -> &[usize] {
        &self.obstacles
    }

    /// The work of points against triangles since the last call, in steps of a vertex.
    pub fn take_work(&mut self) -> usize {
        let each = self.triangles.iter_mut();
        each.map(|t| std::mem::take(&mut t.tested)).sum::<usize>() / OF_A_STEP
    }

    /// Stores the positions at the beginning of a step.
    pub fn begin_step(&mut self, x: &[Point3<f64>]) {
        self.start.copy_from_slice(x);
        self.vertices.iter_mut().for_each(|v| v.planes.clear());
    }

    /// Repeats the queries whose bounds are used up, then moves every vertex over its planes and
    /// every triangle off bone vertices. Call it once per sweep, after the other constraints.
    pub fn project(&mut self, placed: &[PosedObstacle], particles: &mut Particles) {
        self.calls += 1;
        let motion_bound = self.motion_bounds(placed, &particles.position);
        for ((contacts, &o), motion_bound) in self
            .vertices
            .iter_mut()
            .zip(&self.obstacles)
            .zip(&motion_bound)
        {
            contacts.update(
                &placed[o],
                &self.start,
                &mut particles.position,
                *motion_bound,
            );
        }
        // The penetration of vertices is undone first: as motion, it would trigger queries for all
        // bone points.
        for plane in self.vertices.iter_mut().flat_map(|c| &mut c.planes) {
            plane.push_over(&mut particles.position, self.thickness);
        }
        let motion_bound = match self.triangles.is_empty() {
            true => motion_bound,
            false => self.motion_bounds(placed, &particles.position),
        };
        self.look_up_triangles(placed, &particles.position, &motion_bound);
        self.push(placed, particles, &motion_bound);
    }

    /// The sum of motion relative to each obstacle up to the positions `x` of this step.
    fn motion_bounds(&self, placed: &[PosedObstacle], x: &[Point3<f64>]) -> Vec<MotionBound> {
        let each = self.obstacles.iter().zip(&self.motion_bound);
        each.map(|(&o, &before)| MotionBound::about(before, self.motion(&placed[o], x)))
            .collect()
    }

    /// Greatest motion of a vertex relative to an obstacle since the beginning of the step [m].
    fn motion(&self, placed: &PosedObstacle, x: &[Point3<f64>]) -> f64 {
        let carry = placed.now * placed.before.inverse();
        // A matrix transforms a point with half the operations of a quaternion, and most bones do
        // not move.
        let (turn, shift) = (
            carry.rotation.to_rotation_matrix(),
            carry.translation.vector,
        );
        if carry == Isometry3::identity() {
            return greatest_distance(x, self.start.iter().copied());
        }
        greatest_distance(x, self.start.iter().map(|s| turn * s + shift))
    }

    /// Tests for triangles that came near a bone vertex since their last query.
    fn look_up_triangles(
        &mut self,
        placed: &[PosedObstacle],
        x: &[Point3<f64>],
        motion_bound: &[MotionBound],
    ) {
        let has_looked = self.triangles.iter().any(TriangleContacts::has_looked);
        let since = if has_looked {
            self.surface.farthest(x)
        } else {
            0.0
        };
        if self
            .triangles
            .iter()
            .zip(motion_bound)
            .any(|(t, motion_bound)| t.is_due(*motion_bound, since))
        {
            self.surface.refit(x);
            for ((contacts, &o), motion_bound) in self
                .triangles
                .iter_mut()
                .zip(&self.obstacles)
                .zip(motion_bound)
            {
                contacts.update(&placed[o], &self.surface, *motion_bound, since);
            }
        }
    }

    /// Repeats the corrections until all are below a share of the thickness: planes of neighbours
    /// undo each other.
    fn push(
        &mut self,
        placed: &[PosedObstacle],
        particles: &mut Particles,
        motion_bound: &[MotionBound],
    ) {
        self.triangles.iter_mut().for_each(|t| t.active.clear());
        self.unpushed.copy_from_slice(&particles.position);
        for sweep in 0..SWEEPS {
            let mut largest = 0.0_f64;
            let pushed = if sweep == 0 {
                0.0
            } else {
                greatest_distance(&particles.position, self.unpushed.iter().copied())
            };
            for ((contacts, &o), motion_bound) in self
                .triangles
                .iter_mut()
                .zip(&self.obstacles)
                .zip(motion_bound)
            {
                largest = largest.max(contacts.project(
                    &placed[o],
                    &self.surface,
                    particles,
                    motion_bound.and(pushed),
                ));
            }
            for plane in self.vertices.iter_mut().flat_map(|c| &mut c.planes) {
                largest = largest.max(plane.push_over(&mut particles.position, self.thickness));
            }
            if largest <= NEARLY * self.thickness {
                break;
            }
        }
        let x = &mut particles.position;
        self.find_pinched(x);
        for k in 0..self.pinched.len() {
            self.resolve_pinch(self.pinched[k], x);
        }
    }

    /// Finds vertices that one bone pushed back into the thickness of another.
    fn find_pinched(&mut self, x: &[Point3<f64>]) {
        self.pinched.clear();
        if self.vertices.len() < 2 {
            return;
        }
        for contacts in &self.vertices {
            let low = contacts
                .planes
                .iter()
                .filter(|r| r.height(x) < self.thickness * (1.0 - 1e-9));
            self.pinched.extend(low.map(|r| r.vertex));
        }
        self.pinched.sort_unstable();
        self.pinched.dedup();
    }

    /// Gives a vertex between two bones the largest share of the thickness that fits.
    fn resolve_pinch(&mut self, vertex: u32, x: &mut [Point3<f64>]) {
        for share in [1.0, 0.5, 0.25, 0.1, 0.02] {
            let wanted = self.thickness * share;
            for _ in 0..ROUNDS {
                for contacts in &mut self.vertices {
                    if let Ok(k) = contacts.planes.binary_search_by_key(&vertex, |r| r.vertex) {
                        contacts.planes[k].push_over(x, wanted);
                    }
                }
            }
            let clear = self.vertices.iter().all(|c| {
                let k = c.planes.binary_search_by_key(&vertex, |r| r.vertex);
                k.map_or(true, |k| c.planes[k].height(x) >= wanted * 0.999)
            });
            if clear {
                return;
            }
        }
    }

    /// Distance between muscle and bone [m].
    pub fn thickness(&self) -> f64 {
        self.thickness
    }

    /// The contact planes of vertices near a bone and of triangles near a bone vertex, after the
    /// last correction.
    pub fn contact_planes(&self) -> Vec<ContactPlane> {
        let vertices = self
            .vertices
            .iter()
            .flat_map(|c| &c.planes)
            .map(|plane| ContactPlane {
                terms: [1.0, 0.0, 0.0, 0.0].map(|weight| (plane.vertex, weight)),
                normal: plane.normal,
                origin: plane.origin,
                distance: self.thickness,
            });
        let active = self
            .triangles
            .iter()
            .flat_map(TriangleContacts::last_active);
        let triangles = active.map(|plane| ContactPlane {
            // The fourth one repeats a vertex without weight.
            terms: std::array::from_fn(|k| match k {
                3 => (plane.points[0], 0.0),
                _ => (plane.points[k], plane.weights[k]),
            }),
            normal: -plane.normal,
            origin: plane.origin,
            distance: plane.thickness,
        });
        vertices.chain(triangles).collect()
    }

    /// The directions in which contact blocks vertices at `x`, with more vertices and directions in
    /// which they may move.
    pub fn barred(&self, x: &[Point3<f64>], more: &[(u32, Vector3<f64>)]) -> ActiveNormals {
        let planes = self.vertices.iter().flat_map(|c| &c.planes);
        let touching = planes
            .filter(|r| r.height(x) < 1.5 * self.thickness)
            .map(|r| (r.vertex, r.normal));
        let active = self.triangles.iter().flat_map(|c| &c.active);
        let corners = active.flat_map(|plane| plane.points.map(|v| (v, -plane.normal)));
        ActiveNormals(
            touching
                .chain(corners)
                .chain(more.iter().copied())
                .collect(),
        )
    }

    /// Adds what the volume would have moved each vertex against its planes [m] to the load of these
    /// planes, after their directions were taken from its displacement.
    pub fn bear(&mut self, withheld: impl Fn(u32) -> Vector3<f64>) {
        // Nothing but friction needs the load.
        if self.friction > 0.0 {
            for plane in self.vertices.iter_mut().flat_map(|c| &mut c.planes) {
                plane.push += (-withheld(plane.vertex).dot(&plane.normal)).max(0.0);
            }
        }
    }

    /// Ends the step: velocities lose the motion of corrections, and friction slows the sliding of
    /// corrected vertices.
    pub fn end_step(&mut self, placed: &[PosedObstacle], particles: &mut Particles, dt: f64) {
        for (contacts, &o) in self.vertices.iter().zip(&self.obstacles) {
            let carried = placed[o].before * placed[o].now.inverse();
            for plane in contacts.planes.iter().filter(|r| r.push > 0.0) {
                let v = plane.vertex as usize;
                let x = particles.position[v];
                let bone = (x - carried * x) / dt;
                let relative = particles.velocity[v] - bone;
                let along = relative.dot(&plane.normal);
                let mut sliding = relative - plane.normal * along;
                // Coulomb: at most friction times the normal impulse, here as a change of speed.
                let speed = sliding.norm();
                let limit = self.friction * (plane.push / dt - along.max(0.0));
                if speed > 0.0 && limit > 0.0 {
                    sliding *= (1.0 - limit / speed).max(0.0);
                }
                particles.velocity[v] = bone + sliding + plane.normal * along.min(0.0);
            }
        }
        // Triangles likewise: a triangle that a bone vertex pushed away does not fly off.
        for (contacts, &o) in self.triangles.iter().zip(&self.obstacles) {
            let carried = placed[o].before * placed[o].now.inverse();
            for TriangleContact { points, normal, .. } in &contacts.active {
                for v in points.map(|v| v as usize) {
                    if particles.inverse_mass[v] > 0.0 {
                        let x = particles.position[v];
                        let bone = (x - carried * x) / dt;
                        let away = (particles.velocity[v] - bone).dot(normal).min(0.0);
                        particles.velocity[v] -= normal * away;
                    }
                }
            }
        }
        let x = &particles.position;
        let since = greatest_distance(x, self.surface.positions().iter().copied());
        for k in 0..self.obstacles.len() {
            let placed = &placed[self.obstacles[k]];
            self.motion_bound[k] += self.motion(placed, x);
            self.vertices[k].end_step(placed, x, self.motion_bound[k]);
            if let Some(triangles) = self.triangles.get_mut(k) {
                triangles.end_step(self.motion_bound[k], since);
            }
        }
    }

    /// True if no vertex is deeper than `depth` [m] below the known bone surfaces, and no bone
    /// point is in the muscle.
    pub fn is_clear(&mut self, placed: &[PosedObstacle], x: &[Point3<f64>], depth: f64) -> bool {
        let each = self.obstacles.iter().zip(&self.motion_bound);
        let mut vertices = self.vertices.iter().zip(each);
        if !vertices.all(|(c, (&o, &motion))| c.is_clear(&placed[o], x, depth, motion)) {
            return false;
        }
        if self.triangles.is_empty() {
            return true;
        }
        self.surface.refit(x);
        let mut points = self.triangles.iter_mut().zip(&self.obstacles);
        points.all(|(c, &o)| c.is_clear(&placed[o], &self.surface))
    }

    /// Root mean square shortfall of the distances to the contact planes [m].
    pub fn residual(&self, x: &[Point3<f64>]) -> f64 {
        let (mut sum, mut count) = (0.0, 0_usize);
        for plane in self.vertices.iter().flat_map(|c| &c.planes) {
            let c = plane_contact(plane.vertex, plane.origin, plane.normal, self.thickness)
                .value(&[x[plane.vertex as usize]]);
            sum += c.min(0.0).powi(2);
            count += 1;
        }
        (sum / count.max(1) as f64).sqrt()
    }

    /// The vertices in contact with an obstacle, in ascending order.
    pub fn touching(&self, x: &[Point3<f64>]) -> Vec<u32> {
        let planes = self.vertices.iter().flat_map(|c| &c.planes);
        let mut all: Vec<u32> = planes
            .filter(|plane| plane.height(x) <= 1.5 * self.thickness)
            .map(|plane| plane.vertex)
            .collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Counts of the last step.
    pub fn counts(&self, x: &[Point3<f64>]) -> Counts {
        let mut heights = std::collections::BTreeMap::<u32, Vec<f64>>::new();
        for plane in self.vertices.iter().flat_map(|c| &c.planes) {
            heights
                .entry(plane.vertex)
                .or_default()
                .push(plane.height(x));
        }
        Counts {
            touching: heights
                .values()
                .filter(|h| h.iter().any(|h| *h <= 1.5 * self.thickness))
                .count(),
            pinched: heights
                .values()
                .filter(|h| h.len() > 1 && two_lowest(h) < 2.0 * self.thickness)
                .count(),
            lookups: self.vertices.iter().map(|c| c.lookups).sum::<u64>()
                + self.triangles.iter().map(|c| c.lookups).sum::<u64>(),
            stopped: self.vertices.iter().map(|c| c.stopped).sum(),
            calls: self.calls,
        }
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.vertices
            .iter()
            .map(VertexContacts::bytes)
            .sum::<usize>()
            + self
                .triangles
                .iter()
                .map(TriangleContacts::bytes)
                .sum::<usize>()
            + Obstacle::bytes(&self.surface)
            + (self.start.capacity() + self.unpushed.capacity()) * 24
    }
}

/// The obstacles must be the same, see [`Contacts::obstacles`].
impl State for Contacts {
    fn save(&self, to: &mut Writer) {
        // Fields without state are reset at the beginning of each step.
        let Self {
            obstacles: _,
            vertices,
            triangles,
            surface,
            edge: _,
            thickness: _,
            friction: _,
            motion_bound,
            start: _,
            unpushed: _,
            pinched: _,
            calls,
        } = self;
        surface.save(to);
        vertices.iter().for_each(|contacts| contacts.save(to));
        to.put(&triangles.is_empty());
        triangles.iter().for_each(|contacts| contacts.save(to));
        to.list(motion_bound);
        to.put(calls);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        self.surface.restore(from)?;
        self.vertices
            .iter_mut()
            .try_for_each(|contacts| contacts.restore(from))?;
        if from.take()? {
            self.triangles.clear();
        } else {
            let all = self.triangles.len() == self.vertices.len();
            from.check(all, "points of bones in a contact that has none")?;
        }
        self.triangles
            .iter_mut()
            .try_for_each(|contacts| contacts.restore(from, &self.surface))?;
        from.fill(&mut self.motion_bound)?;
        self.calls = from.take()?;
        Ok(())
    }
}

/// Contact of an obstacle's points with triangles; `sizes` are the contact thickness and a mean edge [m].
fn of_triangles(placed: &PosedObstacle, sizes: (f64, f64)) -> TriangleContacts {
    TriangleContacts::new(&*placed.obstacle, sizes.0 * OVER_VERTEX, sizes.1)
}

/// The vertices with positive inverse mass.
fn free(particles: &Particles) -> impl Iterator<Item = u32> {
    (0..particles.len() as u32).filter(|&v| particles.inverse_mass[v as usize] > 0.0)
}

/// Greatest distance between points of the same index [m]; NaN if one is NaN.
fn greatest_distance(x: &[Point3<f64>], others: impl Iterator<Item = Point3<f64>>) -> f64 {
    max_or_nan(x.iter().zip(others).map(|(x, o)| (x - o).norm_squared())).sqrt()
}

fn two_lowest(heights: &[f64]) -> f64 {
    let mut sorted = heights.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[0] + sorted[1]
}
