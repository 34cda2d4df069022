//! A triangle mesh that answers which of its points is nearest, with a sign; the one file that touches parry.

use nalgebra::{Point3, Vector3};
use parry3d_f64::bounding_volume::Aabb as ParryAabb;
use parry3d_f64::math::Vector as Glam;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace};
use parry3d_f64::query::{PointQuery, Ray, RayCast};
use parry3d_f64::shape::Triangle;

use super::nearest::{Feature, angle_at, area_normal, on_triangle, point_at};
use super::{Closest, Obstacle};
use crate::constraints::bending::dihedral;
use crate::mesh::TriangleMesh;
use crate::mesh::inside::crossing;
use crate::mesh::measures::Aabb;
use crate::mesh::topology::Topology;
use crate::mesh::winding::WindingTree;

/// A triangle surface in a bounding volume hierarchy, with what its signs need.
pub struct Surface {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    topology: Topology,
    bvh: Bvh,
    workspace: BvhWorkspace,
    /// What is kept out of a muscle's triangles: vertices, and points along ridges.
    guards: Vec<Point3<f64>>,
    /// Decides the sign where the mesh is not closed and oriented.
    winding: Option<WindingTree>,
}

/// A place on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnTriangle {
    /// The triangle.
    pub triangle: u32,
    /// Barycentric weights.
    pub weights: [f64; 3],
    /// Signed distance, normal and point.
    pub closest: Closest,
}

fn glam(p: &Point3<f64>) -> Glam {
    Glam::new(p.x, p.y, p.z)
}

fn bounds(t: &[Point3<f64>; 3]) -> ParryAabb {
    ParryAabb::new(glam(&t[0].inf(&t[1]).inf(&t[2])), glam(&t[0].sup(&t[1]).sup(&t[2])))
}

/// A bound on a distance may be this many times too small.
const SLACK: f64 = 1.2;

/// A ridge turns by more than this [rad]; points along it are this share of the median edge apart.
const RIDGE: f64 = 0.35;
const SPACING: f64 = 0.5;

/// The vertices, and points along convex edges: a fold of a muscle that lies across a ridge between two of its vertices
/// would meet neither of them.
fn guards(mesh: &TriangleMesh, topology: &Topology) -> Vec<Point3<f64>> {
    let mut points = mesh.vertices.clone();
    let spacing = SPACING * mesh.median_edge_length(topology).unwrap_or(0.0);
    for hinge in &topology.hinges {
        let x = hinge.map(|v| mesh.vertices[v as usize]);
        if dihedral(&x) > RIDGE && spacing > 0.0 {
            let along = x[1] - x[0];
            let parts = (along.norm() / spacing).ceil().min(32.0) as u32;
            points.extend((1..parts).map(|k| x[0] + along * (f64::from(k) / f64::from(parts))));
        }
    }
    points
}

impl Surface {
    /// Builds the hierarchy. Where the mesh is closed and consistently oriented the sign comes from angle-weighted
    /// pseudo-normals \[baerentzen2005\], else from the generalised winding number \[jacobson2013\].
    pub fn new(mesh: &TriangleMesh) -> Self {
        let topology = Topology::new(mesh);
        let leaves: Vec<ParryAabb> = (0..mesh.triangles.len()).map(|t| bounds(&mesh.corners(t))).collect();
        let sound = topology.is_closed() && topology.is_oriented() && mesh.volume() > 0.0;
        Self {
            vertices: mesh.vertices.clone(),
            triangles: mesh.triangles.clone(),
            bvh: Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves),
            workspace: BvhWorkspace::default(),
            guards: guards(mesh, &topology),
            winding: (!sound).then(|| WindingTree::new(mesh)),
            topology,
        }
    }

    /// Positions as of the last refit [m].
    pub fn positions(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// The triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    fn corners(&self, triangle: u32, x: &[Point3<f64>]) -> [Point3<f64>; 3] {
        self.triangles[triangle as usize].map(|v| x[v as usize])
    }

    /// Takes new positions; the hierarchy keeps its shape and follows.
    pub fn refit(&mut self, positions: &[Point3<f64>]) {
        self.vertices.copy_from_slice(positions);
        for t in 0..self.triangles.len() {
            let leaf = bounds(&self.corners(t as u32, &self.vertices));
            self.bvh.insert_or_update_partially(leaf, t as u32, 0.0);
        }
        self.bvh.refit(&mut self.workspace);
    }

    /// The nearest place of the surface, at most `reach` [m] away.
    pub fn nearest(&self, point: &Point3<f64>, reach: f64) -> Option<OnTriangle> {
        let p = glam(point);
        let (triangle, _) = self.bvh.find_best(
            reach,
            |node, _| node.aabb().distance_to_local_point(p, true),
            |triangle, _| {
                let t = self.corners(triangle, &self.vertices);
                Some((point_at(&t, &on_triangle(point, &t).0) - point).norm())
            },
        )?;
        Some(self.on(point, triangle, &self.vertices))
    }

    /// The nearest place of the surface, found faster where it is no further than `bound` [m].
    pub fn nearest_below(&self, point: &Point3<f64>, bound: f64) -> Option<OnTriangle> {
        // A little more, for what is nearest may itself have given the bound.
        self.nearest(point, bound * (1.0 + 1e-9)).or_else(|| self.nearest(point, f64::MAX))
    }

    /// Distance from `point` to one triangle [m].
    pub fn distance_to(&self, point: &Point3<f64>, triangle: u32) -> f64 {
        let t = self.corners(triangle, &self.vertices);
        (point_at(&t, &on_triangle(point, &t).0) - point).norm()
    }

    /// The first place of the surface that a ray from `from` along `direction` meets: triangle and barycentric weights.
    pub fn first_hit(&self, from: &Point3<f64>, direction: &Vector3<f64>) -> Option<(u32, [f64; 3])> {
        let ray = Ray::new(glam(from), Glam::new(direction.x, direction.y, direction.z));
        let (triangle, time) = self.bvh.cast_ray(&ray, f64::MAX, |triangle, best| {
            let [a, b, c] = self.corners(triangle, &self.vertices).map(|v| glam(&v));
            Triangle::new(a, b, c).cast_local_ray(&ray, best, false)
        })?;
        let hit = from + direction * time;
        Some((triangle, on_triangle(&hit, &self.corners(triangle, &self.vertices)).0))
    }

    /// A lower bound on the distance of a point [m] of which some distance to the surface is known, and the triangle
    /// that is nearer than that, if one was met.
    pub fn lower_bound(&self, point: &Point3<f64>, known: f64) -> (f64, Option<u32>) {
        let p = glam(point);
        // What is pruned is at least the best over SLACK away; so much of the search is never begun.
        let better = self.bvh.find_best(
            known,
            |node, _| node.aabb().distance_to_local_point(p, true) * SLACK,
            |triangle, _| Some(self.distance_to(point, triangle)),
        );
        match better {
            Some((triangle, distance)) if distance < known => (distance / SLACK, Some(triangle)),
            _ => (known / SLACK, None),
        }
    }

    /// Appends all triangles at most `reach` [m] from `point`, by falling index of the hierarchy's own order.
    pub fn within(&self, point: &Point3<f64>, reach: f64, found: &mut Vec<u32>) {
        let p = glam(point);
        let half = Glam::new(reach, reach, reach);
        let begin = found.len();
        found.extend(self.bvh.intersect_aabb(&ParryAabb::new(p - half, p + half)));
        found[begin..].sort_unstable();
    }

    /// The winding number about `point` of the surface with positions `x`, of which none is further than `moved` [m] from
    /// where it was at the last refit; exact.
    pub fn winds_about(&self, point: &Point3<f64>, x: &[Point3<f64>], moved: f64) -> i32 {
        // All that the ray from the point along +x may meet.
        let slack = Glam::new(moved, moved, moved);
        let mut far = glam(point);
        far.x = self.bvh.root_aabb().maxs.x.max(far.x);
        let ray = ParryAabb::new(glam(point) - slack, far + slack);
        self.bvh.intersect_aabb(&ray).map(|t| crossing(point, &self.corners(t, x))).sum()
    }

    /// The nearest of the triangles `among`, with positions `x` that may be newer than the last refit.
    pub fn nearest_among(&self, point: &Point3<f64>, among: &[u32], x: &[Point3<f64>]) -> Option<OnTriangle> {
        let mut best: Option<(f64, u32)> = None;
        for &triangle in among {
            let t = self.corners(triangle, x);
            let squared = (point_at(&t, &on_triangle(point, &t).0) - point).norm_squared();
            if best.is_none_or(|(b, _)| squared < b) {
                best = Some((squared, triangle));
            }
        }
        best.map(|(_, triangle)| self.on(point, triangle, x))
    }

    fn on(&self, point: &Point3<f64>, triangle: u32, x: &[Point3<f64>]) -> OnTriangle {
        let t = self.corners(triangle, x);
        let (weights, feature) = on_triangle(point, &t);
        let nearest = point_at(&t, &weights);
        let away = point - nearest;
        let pseudo = self.pseudo_normal(triangle, feature, x);
        let outside = match &self.winding {
            Some(winding) => winding.number(point).abs() < 0.5,
            None => away.dot(&pseudo) >= 0.0,
        };
        let sign = if outside { 1.0 } else { -1.0 };
        let distance = away.norm();
        // Nearer than this the direction is rounding; the size of the triangle is the length scale.
        let size = (t[1] - t[0]).norm() + (t[2] - t[0]).norm();
        let normal = if distance > 1e-9 * size { away * (sign / distance) } else { pseudo };
        OnTriangle { triangle, weights, closest: Closest { distance: sign * distance, normal, point: nearest } }
    }

    /// Unit pseudo-normal of the feature of a triangle; the face's own where neighbours cancel it.
    fn pseudo_normal(&self, triangle: u32, feature: Feature, x: &[Point3<f64>]) -> Vector3<f64> {
        let t = self.corners(triangle, x);
        let unit = |triangle: u32| {
            let n = area_normal(&self.corners(triangle, x));
            n.try_normalize(0.0).unwrap_or_else(Vector3::zeros)
        };
        let face = area_normal(&t).try_normalize(0.0).unwrap_or_else(Vector3::z);
        let sum = match feature {
            Feature::Face => face,
            Feature::Side(k) => {
                let beside = self.topology.neighbours_of_triangle(triangle as usize)[k];
                face + beside.map_or_else(Vector3::zeros, unit)
            }
            Feature::Corner(k) => {
                let v = self.triangles[triangle as usize][k];
                self.topology.triangles_of_vertex(v as usize).iter().fold(Vector3::zeros(), |sum, &other| {
                    let corner = self.triangles[other as usize].iter().position(|&c| c == v).unwrap_or(0);
                    sum + unit(other) * angle_at(&self.corners(other, x), corner)
                })
            }
        };
        sum.try_normalize(1e-6).unwrap_or(face)
    }
}

impl Obstacle for Surface {
    fn closest(&self, point: &Point3<f64>) -> Option<Closest> {
        self.nearest(point, f64::MAX).map(|on| on.closest)
    }

    fn closest_from(&self, point: &Point3<f64>, known: &Point3<f64>) -> Option<Closest> {
        self.nearest_below(point, (point - known).norm()).map(|on| on.closest)
    }

    fn clearance(&self, point: &Point3<f64>, known: &Point3<f64>) -> (f64, Point3<f64>) {
        let bound = (point - known).norm();
        match self.lower_bound(point, bound) {
            (lower, Some(triangle)) => {
                let t = self.corners(triangle, &self.vertices);
                (lower, point_at(&t, &on_triangle(point, &t).0))
            }
            (lower, None) => (lower, *known),
        }
    }

    fn bounding_box(&self) -> Aabb {
        Aabb::of_points(&self.vertices)
    }

    fn guards(&self) -> &[Point3<f64>] {
        &self.guards
    }

    fn bytes(&self) -> usize {
        self.bvh.heap_memory_size() + self.vertices.capacity() * 24 + self.triangles.capacity() * 12
    }
}
