//! A surface that takes part in the parting: positions, hierarchy, shape.

use nalgebra::{Isometry3, Point3, Vector3};

use super::Moved;
use super::crossing::{Candidates, Faced};
use crate::constraints::EnclosedVolume;
use crate::contact::Obstacle;
use crate::contact::surface::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::{Aabb, max_or_nan};
use crate::mesh::sum::tree_sum;
use crate::mesh::topology::Topology;
use crate::particles::{Particles, Slot};

/// A body is thin where it is at most this many median edges thick.
const THIN: f64 = 4.0;
/// Greatest relative error of a volume.
const VOLUME: f64 = 1e-9;
/// Motion for which the triangles that may cross each other are found at once, relative to the
/// median edge.
const LASTING: f64 = 0.3;
/// Share of the way back to its position as read that a free vertex makes in a round.
const RETURN: f64 = 0.05;

/// A soft or rigid surface in the common frame.
pub(super) struct Solid {
    /// Name of the muscle or bone.
    pub name: String,
    /// Positions, and inverse masses without unit: 1 for a vertex that may move freely, 0 for one
    /// that is fixed.
    pub particles: Particles,
    /// The surface at the last refit.
    pub surface: Surface,
    /// Connectivity.
    pub topology: Topology,
    /// Unit normals of the vertices at the last refit.
    pub normals: Vec<Vector3<f64>>,
    /// Bounds at the last refit [m].
    pub bounds: Aabb,
    /// The constraint of the volume of a muscle; `None` for a bone.
    enclosed: Option<EnclosedVolume>,
    /// The pairs of vertices across a soft body from each other.
    pub opposite: Vec<[u32; 2]>,
    /// Neighbours of each vertex along edges and struts: offsets and neighbours.
    pub neighbours: (Vec<u32>, Vec<u32>),
    /// Median length of the edges as read [m].
    pub edge: f64,
    /// Positions as read [m].
    pub start: Vec<Point3<f64>>,
    /// Enclosed volume at the start [m^3].
    pub volume: f64,
    /// Sum over the rounds of the greatest motion of a vertex [m].
    pub travelled: f64,
    /// Its triangles that may cross each other.
    candidates: Candidates,
}

impl Solid {
    /// A muscle, fixed at first.
    pub fn soft(name: &str, mesh: &TriangleMesh) -> Self {
        Self {
            enclosed: Some(EnclosedVolume::new(
                &mesh.triangles,
                mesh.vertices.len(),
                mesh.volume(),
                0.0,
            )),
            ..Self::rigid(name, &Surface::new(mesh), &Isometry3::identity())
        }
        .with_struts()
    }

    fn with_struts(mut self) -> Self {
        let count = self.x().len();
        let across = self.across();
        let mut joined: Vec<[u32; 2]> = self.topology.edges.clone();
        joined.extend(&across);
        let mut starts = vec![0u32; count + 1];
        joined
            .iter()
            .flatten()
            .for_each(|v| starts[*v as usize + 1] += 1);
        (0..count).for_each(|v| starts[v + 1] += starts[v]);
        let mut next = starts.clone();
        let mut neighbours = vec![0; 2 * joined.len()];
        for [a, b] in joined {
            for (from, to) in [(a, b), (b, a)] {
                neighbours[next[from as usize] as usize] = to;
                next[from as usize] += 1;
            }
        }
        self.neighbours = (starts, neighbours);
        self.opposite = across;
        self
    }

    /// Pairs of vertices across the body from each other, where it is thin.
    fn across(&self) -> Vec<[u32; 2]> {
        let edge = self.edge;
        let mut pairs: Vec<[u32; 2]> = Vec::new();
        for (v, (x, normal)) in self.start.iter().zip(&self.normals).enumerate() {
            let from = x - normal * (1e-3 * edge);
            let Some((triangle, weights)) = self.surface.first_hit(&from, &-normal) else {
                continue;
            };
            let corners = self.triangles()[triangle as usize];
            let far = (1..3).fold(0, |k, l| if weights[l] > weights[k] { l } else { k });
            let (v, w) = (v as u32, corners[far]);
            let away = (x - self.start[w as usize]).norm();
            if v != w && away <= THIN * edge && self.topology.find_edge(v, w).is_none() {
                pairs.push([v.min(w), v.max(w)]);
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }

    /// Makes the displacement smooth by `smoothing` sweeps, lets vertices that are not `held` return
    /// towards their positions as read, and restores the volume.
    pub fn relax(&mut self, held: &[bool], smoothing: usize) {
        let all = vec![true; held.len()];
        for _ in 0..smoothing {
            self.smooth(&all);
        }
        let start = self.start.iter().zip(&self.particles.inverse_mass);
        for ((x, held), (start, w)) in self.particles.position.iter_mut().zip(held).zip(start) {
            if !held && *w > 0.0 {
                *x += (*start - *x) * RETURN;
            }
        }
        self.keep_volume(&vec![false; held.len()]);
    }

    /// Moves all vertices this share of the way to their positions as read.
    pub fn go_back(&mut self, share: f64) {
        let start = self.start.iter().zip(&self.particles.inverse_mass);
        for (x, (start, w)) in self.particles.position.iter_mut().zip(start) {
            if *w > 0.0 {
                *x += (*start - *x) * share;
            }
        }
    }

    /// Restores the volume by motion of the vertices that are not `held`.
    pub fn keep_volume(&mut self, held: &[bool]) {
        let free = |field: &mut [Slot], _: f64| {
            let held = field.iter_mut().zip(held).filter(|(_, held)| **held);
            held.for_each(|(slot, _)| *slot = Slot::default());
        };
        if let Some(enclosed) = &mut self.enclosed {
            // Without a solution the volume stays; the caller tests it.
            let _ = enclosed.project_along(&mut self.particles, 1.0, free);
        }
    }

    /// True if the muscle has its volume and does not cross itself.
    pub fn is_sound(&mut self) -> bool {
        let error = (self.present_volume() / self.volume - 1.0).abs();
        error <= VOLUME && self.folded().is_none()
    }

    /// Motion from the positions as read.
    pub fn moved(&self) -> Moved {
        let moved: Vec<f64> = self
            .x()
            .iter()
            .zip(&self.start)
            .map(|(a, b)| (a - b).norm())
            .collect();
        let squares: Vec<f64> = moved.iter().map(|d| d * d).collect();
        Moved {
            rms: (tree_sum(&squares) / moved.len().max(1) as f64).sqrt(),
            max: max_or_nan(moved),
            volume_change: self.present_volume() / self.volume - 1.0,
        }
    }

    /// Brings the displacement of the vertices in `among` nearer to that of their neighbours.
    pub fn smooth(&mut self, among: &[bool]) {
        let (starts, neighbours) = &self.neighbours;
        let displaced = |v: usize| self.particles.position[v] - self.start[v];
        let mut new = self.particles.position.clone();
        for v in (0..among.len()).filter(|&v| among[v] && self.particles.inverse_mass[v] > 0.0) {
            let around = &neighbours[starts[v] as usize..starts[v + 1] as usize];
            let sum = around
                .iter()
                .fold(Vector3::zeros(), |sum, &w| sum + displaced(w as usize));
            new[v] = self.start[v] + 0.5 * (displaced(v) + sum / (around.len().max(1) as f64));
        }
        self.particles.position = new;
    }

    /// The vertices of triangles of this surface that cross others of it, with their neighbours;
    /// `None` if no two cross.
    pub fn folded(&mut self) -> Option<Vec<bool>> {
        let faced = Faced::new(self.surface.positions(), &self.surface);
        // Both triangles of a pair move.
        let travelled = 2.0 * self.travelled;
        let lasting = LASTING * self.edge;
        self.candidates.renew(&faced, &faced, travelled, lasting);
        let crossing = self.candidates.of_itself(self);
        if crossing.is_empty() {
            return None;
        }
        let mut at = vec![false; self.x().len()];
        let corners = crossing
            .iter()
            .flatten()
            .flat_map(|&t| self.triangles()[t as usize]);
        corners.for_each(|v| at[v as usize] = true);
        self.widen(&mut at);
        Some(at)
    }

    /// Adds the neighbours of the vertices `at`.
    pub fn widen(&self, at: &mut [bool]) {
        let (starts, neighbours) = &self.neighbours;
        let inner: Vec<usize> = (0..at.len()).filter(|&v| at[v]).collect();
        for v in inner {
            let around = starts[v] as usize..starts[v + 1] as usize;
            neighbours[around]
                .iter()
                .for_each(|&w| at[w as usize] = true);
        }
    }

    /// Moves the vertices `among` half the way to the middle of their neighbours along edges, in
    /// `sweeps`: the surface flows inward where it is convex, and a thin end draws back.
    pub fn flow(&mut self, among: &[bool], sweeps: usize) {
        let (starts, neighbours) = self.topology.vertex_neighbours();
        let mobile = |v: &usize| among[*v] && self.particles.inverse_mass[*v] > 0.0;
        let moved: Vec<usize> = (0..among.len()).filter(mobile).collect();
        for _ in 0..sweeps {
            let before = self.particles.position.clone();
            for &v in &moved {
                let around = &neighbours[starts[v] as usize..starts[v + 1] as usize];
                let mut sum = Vector3::zeros();
                around
                    .iter()
                    .for_each(|&w| sum += before[w as usize] - before[v]);
                self.particles.position[v] += sum * (0.5 / around.len().max(1) as f64);
            }
        }
    }

    /// A bone at a pose.
    pub fn rigid(name: &str, surface: &Surface, pose: &Isometry3<f64>) -> Self {
        let is_at_home = *pose == Isometry3::identity();
        let place = |v: &Point3<f64>| if is_at_home { *v } else { pose * v };
        let mesh = TriangleMesh {
            vertices: surface.positions().iter().map(place).collect(),
            triangles: surface.triangles().to_vec(),
        };
        let surface = match is_at_home {
            true => surface.clone(),
            false => Surface::new(&mesh),
        };
        let count = mesh.vertices.len();
        let topology = Topology::new(&mesh);
        Self {
            name: name.to_owned(),
            particles: Particles::at_rest(mesh.vertices.clone(), vec![0.0; count]),
            surface,
            edge: mesh.median_edge_length(&topology).unwrap_or(0.0),
            topology,
            normals: mesh.vertex_normals(),
            bounds: mesh.bounding_box(),
            enclosed: None,
            opposite: Vec::new(),
            neighbours: Default::default(),
            volume: mesh.volume(),
            start: mesh.vertices,
            travelled: 0.0,
            candidates: Candidates::default(),
        }
    }

    /// Present positions [m].
    pub fn x(&self) -> &[Point3<f64>] {
        &self.particles.position
    }

    /// The triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        self.surface.triangles()
    }

    /// Corners of a triangle at the present positions [m].
    pub fn corners(&self, triangle: u32) -> [Point3<f64>; 3] {
        self.triangles()[triangle as usize].map(|v| self.particles.position[v as usize])
    }

    /// True if no vertex can move.
    pub fn is_rigid(&self) -> bool {
        self.enclosed.is_none()
    }

    /// Brings the hierarchy to the present positions.
    pub fn refit(&mut self) {
        if self.is_rigid() {
            return;
        }
        let moved = self.surface.positions().iter().zip(self.x());
        let farthest = max_or_nan(moved.map(|(a, b)| (a - b).norm()));
        self.travelled += farthest;
        if farthest > 0.0 {
            self.surface.refit(&self.particles.position);
            self.bounds = self.surface.bounding_box();
            self.normals = self.mesh().vertex_normals();
        }
    }

    /// Enclosed volume at the present positions [m^3].
    fn present_volume(&self) -> f64 {
        crate::mesh::measures::volume(self.x(), self.triangles())
    }

    /// The present mesh.
    fn mesh(&self) -> TriangleMesh {
        TriangleMesh {
            vertices: self.x().to_vec(),
            triangles: self.triangles().to_vec(),
        }
    }
}
