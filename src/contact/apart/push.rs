//! Pushes between two surfaces: points that must keep a gap to a triangle.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::crossing::Piercing;

use super::solid::Solid;
use crate::contact::OnTriangle;

/// A triangle faces the side of a vertex if its normal has at least this cosine with it.
const FACING: f64 = 0.2;

/// The way out that faces a surface may be this many times as long as the shortest one.
const FARTHER: f64 = 4.0;

/// The vertices of surface `a` with what is known of their distances to surface `b`.
#[derive(Default)]
pub(super) struct Watch {
    /// Motion of both surfaces up to which a vertex need not be looked up again [m].
    until: Vec<f64>,
}

/// A point of surface `of[0]` that must keep `gap` [m] along `normal` to a triangle of surface
/// `of[1]`.
pub(super) struct Push {
    /// The two surfaces.
    pub of: [usize; 2],
    /// Vertices of the point with their weights.
    pub point: [(u32, f64); 2],
    /// Vertices of the triangle with their weights.
    pub triangle: [(u32, f64); 3],
    /// Unit direction from the triangle to the point.
    pub normal: Vector3<f64>,
    /// Distance to keep [m].
    pub gap: f64,
    /// Greatest motion in one round [m].
    pub most: f64,
}

/// A pair of surfaces with what the pushes depend on.
pub(super) struct Pair<'a> {
    /// Indices of the surfaces.
    pub of: [usize; 2],
    /// The surface with the points.
    pub a: &'a Solid,
    /// The surface with the triangles.
    pub b: &'a Solid,
    /// Distance to keep [m].
    pub gap: f64,
    /// Greatest motion in one round [m].
    pub most: f64,
    /// Vertices of `a` that must leave `b` on a given side.
    pub sides: &'a [Option<Vector3<f64>>],
}

impl Pair<'_> {
    /// The pushes of vertices nearer than the gap or inside, and whether each vertex is inside.
    pub fn of_vertices(&self, watch: &mut Watch) -> (Vec<Push>, f64) {
        let count = self.a.x().len();
        let travelled = self.a.travelled + self.b.travelled;
        let reach = self.b.bounds.inflate(self.gap);
        if watch.until.len() != count {
            watch.until = vec![f64::NEG_INFINITY; count];
        }
        if !self.a.bounds.intersects(&reach) {
            return (Vec::new(), 0.0);
        }
        let looked: Vec<(Option<Push>, f64)> = watch
            .until
            .par_iter_mut()
            .enumerate()
            .with_min_len(128)
            .filter_map(|(v, until)| {
                let p = &self.a.x()[v];
                if travelled < *until || !reach.contains(p) {
                    return None;
                }
                let on =
                    self.nearest(p, self.sides.get(v).copied().flatten(), self.a.normals[v])?;
                let distance = on.closest.distance;
                *until = travelled + distance - self.gap;
                let push =
                    (distance < self.gap).then(|| self.push([(v as u32, 1.0), (0, 0.0)], &on));
                Some((push, -distance))
            })
            .collect();
        let deepest = crate::mesh::measures::max_or_nan(looked.iter().map(|(_, d)| d.max(0.0)));
        (
            looked.into_iter().filter_map(|(push, _)| push).collect(),
            deepest,
        )
    }

    /// The pushes of edges that pass through the body with both ends outside: a point in the middle
    /// of each way through it.
    pub fn of_edges(&self, piercings: &[Piercing]) -> Vec<Push> {
        let mut all = Vec::new();
        for group in piercings.chunk_by(|p, q| p.edge == q.edge) {
            let ends = self.a.topology.edges[group[0].edge as usize];
            let [p, q] = ends.map(|v| self.a.x()[v as usize]);
            let side = ends
                .iter()
                .find_map(|&v| self.sides.get(v as usize).copied().flatten());
            let own = ends.map(|v| self.a.normals[v as usize]);
            let own = own[0] + own[1];
            for two in group.windows(2) {
                let at = 0.5 * (two[0].at + two[1].at);
                let middle = p + (q - p) * at;
                let Some(on) = self.nearest(&middle, side, own) else {
                    continue;
                };
                if on.closest.distance < self.gap {
                    all.push(self.push([(ends[0], 1.0 - at), (ends[1], at)], &on));
                }
            }
        }
        all
    }

    /// The nearest point of the body; with a side the nearest that faces it. A point inside leaves
    /// through a triangle that faces the surface of which it is part, with the normal `own`: two
    /// surfaces in contact face each other.
    fn nearest(
        &self,
        p: &Point3<f64>,
        side: Option<Vector3<f64>>,
        own: Vector3<f64>,
    ) -> Option<OnTriangle> {
        let nearest = self.signed(p)?;
        let inside = nearest.closest.distance < 0.0;
        let towards = match side {
            Some(side) => side,
            None if inside && !self.faces(nearest.triangle, &-own) => -own,
            None => return Some(nearest),
        };
        let most = match side {
            Some(_) => self.b.bounds.extents().norm(),
            None => FARTHER * nearest.closest.distance.abs() + self.most,
        };
        let mut reach = 2.0 * nearest.closest.distance.abs() + self.gap;
        let mut near = Vec::new();
        while reach < 2.0 * most {
            near.clear();
            self.b.surface.within(p, reach, &mut near);
            near.retain(|t| self.faces(*t, &towards));
            let x = self.b.surface.positions();
            let on = self.b.surface.nearest_among(p, &near, u32::MAX, x);
            if let Some(on) = on.filter(|on| on.closest.distance.abs() <= reach.min(most)) {
                return Some(on);
            }
            reach *= 2.0;
        }
        Some(nearest)
    }

    /// True if a triangle of the body faces a direction.
    fn faces(&self, triangle: u32, towards: &Vector3<f64>) -> bool {
        let [p, q, r] = self.b.corners(triangle);
        let normal = (q - p).cross(&(r - p));
        normal.dot(towards) >= FACING * normal.norm() * towards.norm()
    }

    fn push(&self, point: [(u32, f64); 2], on: &OnTriangle) -> Push {
        let corners = self.b.triangles()[on.triangle as usize];
        Push {
            of: self.of,
            point,
            triangle: [0, 1, 2].map(|k| (corners[k], on.weights[k])),
            normal: on.closest.normal,
            gap: self.gap,
            most: self.most,
        }
    }

    /// For each vertex of `a` inside `b` the direction of the nearest way out.
    pub fn exits(&self) -> Vec<Option<Vector3<f64>>> {
        let exit = |p: &Point3<f64>| {
            let bounds = &self.b.bounds;
            let on = bounds.contains(p).then(|| self.signed(p)).flatten()?;
            (on.closest.distance < 0.0).then_some(on.closest.normal)
        };
        self.a.x().par_iter().with_min_len(128).map(exit).collect()
    }

    /// The nearest point of the body.
    fn signed(&self, p: &Point3<f64>) -> Option<OnTriangle> {
        let mut nearest = self.b.surface.nearest(p, f64::MAX)?;
        if !self.b.is_rigid() {
            // A surface that crosses itself for a while has wrong pseudo-normals there.
            let x = self.b.surface.positions();
            let inside = self.b.bounds.contains(p) && self.b.surface.winds_about(p, x, 0.0).0 > 0;
            if inside == (nearest.closest.distance >= 0.0) {
                nearest.closest.distance *= -1.0;
                nearest.closest.normal *= -1.0;
            }
        }
        Some(nearest)
    }
}

impl Push {
    /// Distance from the triangle to the point along the normal, negative inside [m].
    pub fn distance(&self, solids: &[Solid]) -> f64 {
        let [a, b] = self.of.map(|s| solids[s].x());
        let point = self
            .point
            .iter()
            .map(|(v, weight)| a[*v as usize].coords * *weight);
        let on = self
            .triangle
            .iter()
            .map(|(v, weight)| b[*v as usize].coords * *weight);
        self.normal
            .dot(&(point.sum::<Vector3<f64>>() - on.sum::<Vector3<f64>>()))
    }

    /// The surfaces and vertices of the point and of the triangle.
    pub fn vertices(&self) -> impl Iterator<Item = (usize, u32)> {
        let point = self.point.iter().filter(|(_, weight)| *weight > 0.0);
        let point = point.map(|(v, _)| (self.of[0], *v));
        point.chain(self.triangle.iter().map(|(v, _)| (self.of[1], *v)))
    }
}

/// Applies pushes to all surfaces at once: each vertex moves by the mean of its pushes, so that
/// no order enters.
pub(super) fn apply(solids: &mut [Solid], pushes: &[Push], sweeps: usize) {
    let mut moves: Vec<Vec<(Vector3<f64>, f64)>> = solids
        .iter()
        .map(|s| vec![(Vector3::zeros(), 0.0); s.x().len()])
        .collect();
    for _ in 0..sweeps {
        moves
            .iter_mut()
            .flatten()
            .for_each(|m| *m = (Vector3::zeros(), 0.0));
        for push in pushes {
            add(solids, push, &mut moves);
        }
        for (solid, moves) in solids.iter_mut().zip(&moves) {
            for (x, (sum, weight)) in solid.particles.position.iter_mut().zip(moves) {
                *x += sum / weight.max(1.0);
            }
        }
    }
}

fn add(solids: &[Solid], push: &Push, moves: &mut [Vec<(Vector3<f64>, f64)>]) {
    let [a, b] = push.of;
    let (mut distance, mut give) = (0.0, 0.0);
    let parts = push.point.iter().map(|p| (a, p, 1.0));
    let parts: Vec<_> = parts
        .chain(push.triangle.iter().map(|p| (b, p, -1.0)))
        .collect();
    for &(s, &(v, weight), sign) in &parts {
        let particles = &solids[s].particles;
        distance += sign * weight * push.normal.dot(&particles.position[v as usize].coords);
        give += weight * weight * particles.inverse_mass[v as usize];
    }
    // Deep overlap goes in several rounds, so that the shape can follow.
    let lack = (push.gap - distance).min(push.most);
    if !(lack > 0.0 && give > 0.0) {
        return;
    }
    for (s, &(v, weight), sign) in parts {
        let share = weight * solids[s].particles.inverse_mass[v as usize];
        if share > 0.0 {
            let (sum, total) = &mut moves[s][v as usize];
            *sum += push.normal * (sign * share * lack / give);
            *total += weight;
        }
    }
}
