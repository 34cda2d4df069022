//! A mesh during remeshing: split, collapse, flip and move; each is rejected where it would damage
//! the surface.

use std::cell::Cell;

use nalgebra::{Point3, Vector3};

use super::QUERIES;
use crate::mesh::closest::{SurfaceTree, closest_on_triangle};
use crate::mesh::{Topology, TriangleMesh};
use crate::progress::Progress;

const NONE: u32 = u32::MAX;
/// A triangle is compared with parts of the original whose normal has a cosine above this value
/// with its own.
///
/// The value is negative, so that a triangle across a sharp edge still finds both sides. It
/// excludes the other side of a thin sheet.
const FACING: f64 = -0.3;
/// A vertex is projected onto parts of the original that face in its direction.
const VERTEX_FACING: f64 = 0.0;
/// Edges of the original whose fold has a cosine below this value are features with sample points.
const FEATURE_COSINE: f64 = 0.97;

/// Corners of a triangle [m].
pub(super) type Corners = [Point3<f64>; 3];

/// Limits of an operation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Largest distance between the surfaces [m].
    pub deviation: f64,
    /// Longest edge that an operation may make [m].
    pub longest: f64,
    /// Least sine of an angle after an operation, unless the worst was smaller before.
    pub sine: f64,
}

/// The mesh during remeshing; deleted triangles and vertices stay as holes until
/// [`Working::finish`].
pub(super) struct Working<'a> {
    pub points: Vec<Point3<f64>>,
    pub triangles: Vec<[u32; 3]>,
    /// Triangles of each vertex, in any order.
    pub rings: Vec<Vec<u32>>,
    pub boundary: Vec<bool>,
    original: &'a SurfaceTree,
    /// The part of the original near the last new triangle; the next query starts there.
    likely: Cell<u32>,
    /// Points of the original that must stay near the new surface.
    samples: Vec<Point3<f64>>,
    /// Samples of each triangle: the triangle must stay near them.
    carried: Vec<Vec<u32>>,
    /// Greatest distance of a projection [m].
    reach: f64,
    progress: &'a dyn Progress,
    /// Number of checks for cancellation.
    queries: usize,
    stopped: bool,
    /// Whether hairs were cut off, whose samples are gone.
    pub has_cut: bool,
}

/// The sine of the smallest angle of a triangle; zero for one without area.
pub(super) fn smallest_sine([a, b, c]: &Corners) -> f64 {
    let (ab, bc, ca) = (
        (b - a).norm_squared(),
        (c - b).norm_squared(),
        (a - c).norm_squared(),
    );
    let longer_two = ab * bc * ca / ab.min(bc).min(ca);
    let double_area = (b - a).cross(&(c - a)).norm();
    if double_area > 0.0 {
        double_area / longer_two.sqrt()
    } else {
        0.0
    }
}

fn cross([a, b, c]: &Corners) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

fn worst_sine(triangles: &[Corners]) -> f64 {
    triangles.iter().map(smallest_sine).fold(1.0, f64::min)
}

impl<'a> Working<'a> {
    pub fn new(
        mesh: &TriangleMesh,
        topology: &Topology,
        original: &'a SurfaceTree,
        edge_length: f64,
        progress: &'a dyn Progress,
    ) -> Self {
        let mut boundary = vec![false; mesh.vertices.len()];
        for e in topology.boundary_edges() {
            topology.edges[e as usize]
                .iter()
                .for_each(|&v| boundary[v as usize] = true);
        }
        let rings = (0..mesh.vertices.len())
            .map(|v| topology.triangles_of_vertex(v).to_vec())
            .collect();
        let mut working = Self {
            points: mesh.vertices.clone(),
            triangles: mesh.triangles.clone(),
            rings,
            boundary,
            original,
            likely: Cell::new(u32::MAX),
            samples: Vec::new(),
            carried: vec![Vec::new(); mesh.triangles.len()],
            reach: edge_length,
            progress,
            queries: 0,
            stopped: false,
            has_cut: false,
        };
        working.watch(mesh, topology, 0.5 * edge_length);
        working
    }

    /// True if the work continues with the next edge, vertex or triangle; after a stop always
    /// false.
    pub fn goes_on(&mut self) -> bool {
        if !self.stopped && self.queries.is_multiple_of(QUERIES) {
            self.stopped = self.progress.is_stopped();
        }
        self.queries += 1;
        !self.stopped
    }

    /// True if the caller stopped the work before its end.
    pub fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// Takes samples at all vertices and, `spacing` apart, on folded edges.
    fn watch(&mut self, mesh: &TriangleMesh, topology: &Topology, spacing: f64) {
        for v in 0..mesh.vertices.len() {
            if let Some(&t) = topology.triangles_of_vertex(v).first() {
                self.add_sample(t, mesh.vertices[v]);
            }
        }
        for (e, &[a, b]) in topology.edges.iter().enumerate() {
            let around = topology.triangles_of_edge(e);
            let folded = match *around {
                [t, u] => {
                    let (m, n) = (
                        cross(&mesh.corners(t as usize)),
                        cross(&mesh.corners(u as usize)),
                    );
                    m.dot(&n) < FEATURE_COSINE * m.norm() * n.norm()
                }
                _ => true,
            };
            if !folded {
                continue;
            }
            let (a, b) = (mesh.vertices[a as usize], mesh.vertices[b as usize]);
            let parts = ((b - a).norm() / spacing).ceil().max(2.0) as usize;
            for k in 1..parts {
                self.add_sample(around[0], a + (b - a) * (k as f64 / parts as f64));
            }
        }
    }

    fn add_sample(&mut self, triangle: u32, point: Point3<f64>) {
        self.carried[triangle as usize].push(self.samples.len() as u32);
        self.samples.push(point);
    }

    pub fn corners(&self, t: u32) -> Corners {
        self.triangles[t as usize].map(|v| self.points[v as usize])
    }

    pub fn is_alive(&self, t: u32) -> bool {
        self.triangles[t as usize][0] != NONE
    }

    pub fn length(&self, a: u32, b: u32) -> f64 {
        (self.points[b as usize] - self.points[a as usize]).norm()
    }

    /// The triangle that traverses an edge from `a` to `b`, and the one in the opposite direction,
    /// each with its wing tip.
    fn sides(&self, a: u32, b: u32) -> [Option<(u32, u32)>; 2] {
        let mut found = [None; 2];
        for &t in &self.rings[a as usize] {
            let corners = self.triangles[t as usize];
            for k in 0..3 {
                let (p, q, r) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
                if (p, q) == (a, b) {
                    found[0] = Some((t, r));
                } else if (p, q) == (b, a) {
                    found[1] = Some((t, r));
                }
            }
        }
        found
    }

    /// Neighbours of a vertex along edges, ascending.
    fn neighbours(&self, v: u32) -> Vec<u32> {
        let ring = self.rings[v as usize]
            .iter()
            .flat_map(|&t| self.triangles[t as usize]);
        let mut all: Vec<u32> = ring.filter(|&w| w != v).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// All edges whose length satisfies `selects`, shortest first, ties in vertex order.
    pub fn edges_by_length(&self, selects: impl Fn(f64) -> bool) -> Vec<(f64, u32, u32)> {
        let mut edges = Vec::new();
        for t in self.triangles.iter().filter(|t| t[0] != NONE) {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                // A boundary edge has no triangle in the other direction.
                let once = a < b
                    || (self.boundary[a as usize]
                        && self.boundary[b as usize]
                        && self.is_rim(a, b));
                if once {
                    let length = self.length(a, b);
                    if selects(length) {
                        edges.push((length, a.min(b), a.max(b)));
                    }
                }
            }
        }
        edges.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
        edges
    }

    fn is_rim(&self, a: u32, b: u32) -> bool {
        self.sides(a, b).iter().flatten().count() == 1
    }

    /// Area-weighted normal of a vertex; zero if its triangles cancel.
    pub fn normal(&self, v: u32) -> Vector3<f64> {
        let sum: Vector3<f64> = self.rings[v as usize]
            .iter()
            .map(|&t| cross(&self.corners(t)))
            .sum();
        sum.try_normalize(0.0).unwrap_or_default()
    }

    /// The closest point of the original to `p` among parts that face along `normal`.
    pub fn project(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> Option<Point3<f64>> {
        self.original
            .closest_facing(p, normal, VERTEX_FACING, self.reach)
            .map(|c| c.point)
    }

    /// True if the triangles `new`, the changed corner first, may replace the triangles `old`.
    fn may_replace(&self, old: &[u32], new: &[Corners], limits: &Limits) -> bool {
        let before = old
            .iter()
            .map(|&t| smallest_sine(&self.corners(t)))
            .fold(1.0, f64::min);
        if worst_sine(new) < limits.sine.min(before) {
            return false;
        }
        for corners in new {
            let [a, b, c] = corners;
            let Some(normal) = cross(corners).try_normalize(0.0) else {
                return false;
            };
            let third = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            let near = |p: &Point3<f64>| {
                self.original.is_near_facing_from(
                    &self.likely,
                    p,
                    &normal,
                    FACING,
                    limits.deviation,
                )
            };
            if !near(&third) || ![0.5, 0.25, 0.75].iter().all(|&s| near(&(a + (b - a) * s))) {
                return false;
            }
        }
        let watched = old.iter().flat_map(|&t| &self.carried[t as usize]);
        let square = limits.deviation * limits.deviation;
        watched.map(|&s| &self.samples[s as usize]).all(|s| {
            new.iter()
                .any(|corners| (s - closest_on_triangle(s, corners)).norm_squared() <= square)
        })
    }

    /// Gives samples of changed triangles to the nearest of the new triangles.
    fn hand_over(&mut self, samples: Vec<u32>, to: &[u32]) {
        for s in samples {
            let point = self.samples[s as usize];
            let distance =
                |&t: &u32| (point - closest_on_triangle(&point, &self.corners(t))).norm_squared();
            let nearest = to
                .iter()
                .copied()
                .min_by(|t, u| distance(t).total_cmp(&distance(u)));
            if let Some(t) = nearest {
                self.carried[t as usize].push(s);
            }
        }
    }

    fn take_samples(&mut self, triangles: &[u32]) -> Vec<u32> {
        triangles
            .iter()
            .flat_map(|&t| std::mem::take(&mut self.carried[t as usize]))
            .collect()
    }

    /// Splits the edge at its midpoint.
    pub fn split(&mut self, a: u32, b: u32) {
        let sides = self.sides(a, b);
        let m = self.points.len() as u32;
        self.points.push(nalgebra::center(
            &self.points[a as usize],
            &self.points[b as usize],
        ));
        self.rings.push(Vec::new());
        self.boundary.push(sides.iter().flatten().count() == 1);
        for (side, (from, to)) in sides.into_iter().zip([(a, b), (b, a)]) {
            let Some((t, tip)) = side else { continue };
            let samples = self.take_samples(&[t]);
            let u = self.triangles.len() as u32;
            self.triangles[t as usize] = [from, m, tip];
            self.triangles.push([m, to, tip]);
            self.carried.push(Vec::new());
            self.replace_in_ring(to, t, u);
            self.rings[tip as usize].push(u);
            self.rings[m as usize].extend([t, u]);
            self.hand_over(samples, &[t, u]);
        }
    }

    fn replace_in_ring(&mut self, v: u32, old: u32, new: u32) {
        self.rings[v as usize]
            .iter_mut()
            .filter(|t| **t == old)
            .for_each(|t| *t = new);
    }

    fn remove_from_ring(&mut self, v: u32, old: u32) {
        self.rings[v as usize].retain(|&t| t != old);
    }

    /// Collapses the edge to a point on the original, if the limits and the topology allow it.
    pub fn collapse(&mut self, a: u32, b: u32, limits: &Limits) -> bool {
        let (a, b) = if self.boundary[b as usize] {
            (b, a)
        } else {
            (a, b)
        };
        let [Some((t, c)), Some((u, d))] = self.sides(a, b) else {
            return false;
        };
        if self.boundary[b as usize] || !self.link_condition(a, b, c, d) {
            return false;
        }
        let (p, q) = (self.points[a as usize], self.points[b as usize]);
        let normal = self.normal(a) + self.normal(b);
        let middle = self.project(&nalgebra::center(&p, &q), &normal);
        let targets = if self.boundary[a as usize] {
            [None, Some(p), None]
        } else {
            [middle, Some(p), Some(q)]
        };
        let around = |v: u32| {
            self.rings[v as usize]
                .iter()
                .copied()
                .filter(move |&s| s != t && s != u)
        };
        let kept: Vec<(u32, u32)> = around(a)
            .map(|s| (s, a))
            .chain(around(b).map(|s| (s, b)))
            .collect();
        let old: Vec<u32> = kept.iter().map(|&(s, _)| s).chain([t, u]).collect();
        let allowed = targets.into_iter().flatten().find(|target| {
            let new: Vec<Corners> = kept
                .iter()
                .map(|&(s, v)| self.with_corner(s, v, target))
                .collect();
            new.iter().all(|[x, y, _]| (y - x).norm() <= limits.longest)
                && self.may_replace(&old, &new, limits)
        });
        let Some(target) = allowed else { return false };
        self.merge(a, b, [(t, c), (u, d)], target, &kept);
        true
    }

    /// Corners of a triangle, `vertex` first and moved to `target`.
    fn with_corner(&self, t: u32, vertex: u32, target: &Point3<f64>) -> Corners {
        let mut corners = self.triangles[t as usize];
        while corners[0] != vertex {
            corners.rotate_left(1);
        }
        [
            *target,
            self.points[corners[1] as usize],
            self.points[corners[2] as usize],
        ]
    }

    fn merge(
        &mut self,
        a: u32,
        b: u32,
        gone: [(u32, u32); 2],
        target: Point3<f64>,
        kept: &[(u32, u32)],
    ) {
        let kept: Vec<u32> = kept.iter().map(|&(s, _)| s).collect();
        let mut samples = self.take_samples(&kept);
        samples.extend(self.take_samples(&gone.map(|(t, _)| t)));
        for (t, tip) in gone {
            self.triangles[t as usize] = [NONE; 3];
            self.remove_from_ring(tip, t);
        }
        for &s in &kept {
            self.triangles[s as usize]
                .iter_mut()
                .filter(|v| **v == b)
                .for_each(|v| *v = a);
        }
        self.points[a as usize] = target;
        self.rings[a as usize] = kept.clone();
        self.rings[b as usize].clear();
        self.hand_over(samples, &kept);
    }

    /// Cuts a hair off where three edges that are no triangle, one of them from `a` to `b`, are at most
    /// `longest` together, and closes the end by a triangle. What is cut off has at most an area of `most`.
    pub fn cut_hair(&mut self, a: u32, b: u32, longest: f64, most: f64) -> bool {
        let [Some((t, c)), Some((u, d))] = self.sides(a, b) else {
            return false;
        };
        let near_b = self.neighbours(b);
        let is_ring = |w: &u32| {
            let length = self.length(a, b) + self.length(b, *w) + self.length(*w, a);
            ![c, d].contains(w) && near_b.binary_search(w).is_ok() && length <= longest
        };
        let rings: Vec<u32> = self.neighbours(a).into_iter().filter(is_ring).collect();
        let ends = rings
            .into_iter()
            .flat_map(|w| [(t, [a, b, w]), (u, [b, a, w])]);
        let hair = ends
            .filter_map(|(first, ring)| Some((self.beyond(first, ring, most)?, ring)))
            .min_by_key(|(hair, _)| hair.len());
        let Some((hair, ring)) = hair else {
            return false;
        };
        self.take_samples(&hair);
        for t in hair {
            for v in std::mem::replace(&mut self.triangles[t as usize], [NONE; 3]) {
                self.remove_from_ring(v, t);
            }
        }
        let end = self.triangles.len() as u32;
        self.triangles.push(ring);
        self.carried.push(Vec::new());
        ring.iter().for_each(|v| self.rings[*v as usize].push(end));
        self.has_cut = true;
        true
    }

    /// The triangles on the side of `first` of three edges that divide the surface; `None` if they do not,
    /// or their area is greater than `most`.
    fn beyond(&self, first: u32, ring: [u32; 3], most: f64) -> Option<Vec<u32>> {
        let (mut found, mut area, mut next) = (vec![first], 0.0, 0);
        while let Some(&t) = found.get(next) {
            let [a, b, c] = self.triangles[t as usize];
            area += 0.5 * cross(&self.corners(t)).norm();
            if !(area <= most) {
                return None;
            }
            for (p, q) in [(a, b), (b, c), (c, a)] {
                if ring.contains(&p) && ring.contains(&q) {
                    continue;
                }
                let [_, across] = self.sides(p, q);
                let (across, _) = across?;
                if !found.contains(&across) {
                    found.push(across);
                }
            }
            next += 1;
        }
        // Both sides of an edge of the ring are one where it does not divide the surface.
        let [a, b, _] = ring;
        let is_one = |t: u32| found.contains(&t);
        let whole = self
            .sides(a, b)
            .into_iter()
            .flatten()
            .all(|(t, _)| is_one(t));
        (!whole).then_some(found)
    }

    /// True if the surface stays a manifold of the same genus: only the wing tips are neighbours of
    /// both ends.
    fn link_condition(&self, a: u32, b: u32, c: u32, d: u32) -> bool {
        let (near_a, near_b) = (self.neighbours(a), self.neighbours(b));
        let shared = near_a
            .iter()
            .filter(|v| near_b.binary_search(v).is_ok())
            .count();
        let enough =
            |v: u32| self.rings[v as usize].len() > if self.boundary[v as usize] { 1 } else { 3 };
        c != d && shared == 2 && enough(c) && enough(d)
    }

    /// Flips the edge in its quad if the limits allow it and `better(old, new)` holds for the two
    /// pairs of triangles.
    pub fn flip(
        &mut self,
        a: u32,
        b: u32,
        limits: &Limits,
        better: impl Fn(&Self, [u32; 4], f64, f64) -> bool,
    ) -> bool {
        let [Some((t, c)), Some((u, d))] = self.sides(a, b) else {
            return false;
        };
        let enough =
            |v: u32| self.rings[v as usize].len() > if self.boundary[v as usize] { 2 } else { 3 };
        if c == d
            || !enough(a)
            || !enough(b)
            || self.sides(c, d) != [None; 2]
            || self.length(c, d) > limits.longest
        {
            return false;
        }
        let [p, q, r, s] = [a, b, c, d].map(|v| self.points[v as usize]);
        let (old, new) = ([self.corners(t), self.corners(u)], [[s, r, p], [r, s, q]]);
        // A triangle with a normal opposite to the replaced pair would fold over.
        let facing = cross(&old[0]) + cross(&old[1]);
        if new.iter().any(|n| cross(n).dot(&facing) <= 0.0)
            || !better(self, [a, b, c, d], worst_sine(&old), worst_sine(&new))
        {
            return false;
        }
        if !self.may_replace(&[t, u], &new, limits) {
            return false;
        }
        let samples = self.take_samples(&[t, u]);
        self.triangles[t as usize] = [a, d, c];
        self.triangles[u as usize] = [d, b, c];
        self.remove_from_ring(a, u);
        self.remove_from_ring(b, t);
        self.rings[c as usize].push(u);
        self.rings[d as usize].push(t);
        self.hand_over(samples, &[t, u]);
        true
    }

    /// The least sine around a vertex for the position `target`.
    pub fn sine_with(&self, v: u32, target: &Point3<f64>) -> f64 {
        let ring = self.rings[v as usize].iter();
        ring.map(|&t| smallest_sine(&self.with_corner(t, v, target)))
            .fold(1.0, f64::min)
    }

    /// Moves a vertex to a point of the original, if the limits allow it.
    pub fn shift(&mut self, v: u32, target: Point3<f64>, limits: &Limits) -> bool {
        let ring = self.rings[v as usize].clone();
        let new: Vec<Corners> = ring
            .iter()
            .map(|&t| self.with_corner(t, v, &target))
            .collect();
        let folds = ring.iter().zip(&new).any(|(&t, n)| {
            let before = cross(&self.corners(t));
            before.norm_squared() > 0.0 && cross(n).dot(&before) <= 0.0
        });
        if folds || !self.may_replace(&ring, &new, limits) {
            return false;
        }
        let samples = self.take_samples(&ring);
        self.points[v as usize] = target;
        self.hand_over(samples, &ring);
        true
    }

    /// The mesh without holes, its vertices in the present order, the new index of each vertex, and
    /// the largest distance of a sample point from the mesh [m].
    pub fn finish(self) -> (TriangleMesh, Vec<u32>, f64) {
        let mut drift: f64 = 0.0;
        let mut names = vec![NONE; self.points.len()];
        let mut mesh = TriangleMesh::default();
        for (v, ring) in self.rings.iter().enumerate() {
            if !ring.is_empty() {
                names[v] = mesh.vertices.len() as u32;
                mesh.vertices.push(self.points[v]);
            }
        }
        for t in (0..self.triangles.len() as u32).filter(|&t| self.is_alive(t)) {
            let corners = self.corners(t);
            for &s in &self.carried[t as usize] {
                let point = &self.samples[s as usize];
                drift = drift.max((point - closest_on_triangle(point, &corners)).norm());
            }
            mesh.triangles
                .push(self.triangles[t as usize].map(|v| names[v as usize]));
        }
        (mesh, names, drift)
    }
}
