//! A triangle mesh with signed closest-point queries; the only file that uses parry.

use nalgebra::{Point3, Vector3};
use parry3d_f64::bounding_volume::{Aabb as ParryAabb, BoundingVolume};
use parry3d_f64::math::Vector as Glam;
use parry3d_f64::partitioning::{
    Bvh, BvhBuildStrategy, BvhNodeIndex, BvhWorkspace, TraversalAction,
};
use parry3d_f64::query::{PointQuery, Ray, RayCast};
use parry3d_f64::shape::Triangle;

use super::faces::{Faces, OnTriangle};
use super::nearest::{on_triangle, point_at};
use super::{Obstacle, Projection};
use crate::mesh::TriangleMesh;
use crate::mesh::inside::crossing;
use crate::mesh::measures::{Aabb, max_or_nan};
use crate::state::{DecodeError, Reader, State, Writer};

/// A triangle surface in a bounding volume hierarchy.
#[derive(Clone)]
pub struct Surface {
    faces: Faces,
    bvh: Bvh,
    workspace: BvhWorkspace,
}

fn glam(p: &Point3<f64>) -> Glam {
    Glam::new(p.x, p.y, p.z)
}

fn from_parry(bounds: &ParryAabb) -> Aabb {
    let point = |v: parry3d_f64::math::Vector| Point3::new(v.x, v.y, v.z);
    Aabb {
        min: point(bounds.mins),
        max: point(bounds.maxs),
    }
}

fn bounds(t: &[Point3<f64>; 3]) -> ParryAabb {
    ParryAabb::new(
        glam(&t[0].inf(&t[1]).inf(&t[2])),
        glam(&t[0].sup(&t[1]).sup(&t[2])),
    )
}

fn hierarchy(boxes: &[Aabb]) -> Bvh {
    let leaves: Vec<ParryAabb> = boxes
        .iter()
        .map(|b| ParryAabb::new(glam(&b.min), glam(&b.max)))
        .collect();
    Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves)
}

/// Pairs of boxes that meet, each once.
pub(super) fn box_pairs(boxes: &[Aabb]) -> Vec<[u32; 2]> {
    let mut found = Vec::new();
    let mut add = |a: u32, b: u32| found.push([a, b]);
    hierarchy(boxes).traverse_bvtt_single_tree::<false>(&mut BvhWorkspace::default(), &mut add);
    found
}

/// Pairs of a box of each list that meet.
#[cfg(feature = "sparse")]
pub(super) fn box_pairs_between(first: &[Aabb], second: &[Aabb]) -> Vec<[u32; 2]> {
    let (one, other) = (hierarchy(first), hierarchy(second));
    let meeting = one.leaf_pairs(&other, |a, b| a.intersects(b));
    meeting
        // The traversal does not test leaves directly below the roots.
        .filter(|&(s, t)| first[s as usize].intersects(&second[t as usize]))
        .map(|(s, t)| [s, t])
        .collect()
}

/// Tolerance factor of a bound on a distance.
const SLACK: f64 = 1.2;

impl Surface {
    /// The boxes of the hierarchy over its triangles, by levels: the first has the box of all. A triangle stays in all
    /// levels below its own, so that each level covers the surface. It ends before a level with more than `most` boxes.
    pub fn boxes_by_level(&self, most: usize) -> Vec<Vec<Aabb>> {
        let of = |found: &[(BvhNodeIndex, Aabb, bool)]| found.iter().map(|(_, b, _)| *b).collect();
        let (mut now, mut all) = (self.children(None), Vec::new());
        if !now.is_empty() {
            let root = self.bvh.root_aabb();
            all.push(vec![from_parry(&root)]);
        }
        while now.len() <= most
            && all
                .last()
                .is_some_and(|last: &Vec<Aabb>| last.len() < now.len())
        {
            all.push(of(&now));
            let below = |node: &(BvhNodeIndex, Aabb, bool)| match node {
                (_, _, true) => vec![*node],
                (index, _, false) => self.children(Some(*index)),
            };
            now = now.iter().flat_map(below).collect();
        }
        all
    }

    /// The nodes below one, or below the root: each with its box, and whether it has one triangle.
    fn children(&self, of: Option<BvhNodeIndex>) -> Vec<(BvhNodeIndex, Aabb, bool)> {
        let mut found = Vec::new();
        self.bvh.traverse_indexed(of, |node, index| {
            if Some(index) == of {
                return TraversalAction::Continue;
            }
            found.push((index, from_parry(&node.aabb()), node.is_leaf()));
            TraversalAction::Prune
        });
        found
    }

    /// Builds the hierarchy. The signs come from angle-weighted pseudo-normals \[baerentzen2005\]
    /// for a closed and consistently oriented mesh, otherwise from the generalised winding number
    /// \[jacobson2013\].
    pub fn new(mesh: &TriangleMesh) -> Self {
        let leaves: Vec<ParryAabb> = (0..mesh.triangles.len())
            .map(|t| bounds(&mesh.corners(t)))
            .collect();
        Self {
            bvh: Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves),
            workspace: BvhWorkspace::default(),
            faces: Faces::new(mesh),
        }
    }

    /// True if the surface is closed and consistently oriented.
    pub fn is_sound(&self) -> bool {
        self.faces.is_sound()
    }

    /// Positions at the last refit [m].
    pub fn positions(&self) -> &[Point3<f64>] {
        &self.faces.mesh.vertices
    }

    /// The triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.faces.mesh.triangles
    }

    /// Edge length of equilateral triangles with the mean area of these [m]; zero without triangles.
    pub(super) fn mean_edge(&self) -> f64 {
        let mesh = &self.faces.mesh;
        let each = mesh.area() / mesh.triangles.len().max(1) as f64;
        (each * 4.0 / 3f64.sqrt()).sqrt()
    }

    /// Greatest distance of positions `x` from those of the last refit [m].
    pub fn farthest(&self, x: &[Point3<f64>]) -> f64 {
        let each = x.iter().zip(self.positions());
        max_or_nan(each.map(|(x, o)| (x - o).norm_squared())).sqrt()
    }

    /// Sets new positions; the hierarchy keeps its structure and updates its boxes.
    pub fn refit(&mut self, positions: &[Point3<f64>]) {
        self.faces.mesh.vertices.copy_from_slice(positions);
        for t in 0..self.faces.mesh.triangles.len() {
            let leaf = bounds(&self.faces.mesh.corners(t));
            self.bvh.insert_or_update_partially(leaf, t as u32, 0.0);
        }
        self.bvh.refit(&mut self.workspace);
    }

    /// The nearest point of the surface within `reach` [m].
    pub fn nearest(&self, point: &Point3<f64>, reach: f64) -> Option<OnTriangle> {
        let p = glam(point);
        let (triangle, _) = self.bvh.find_best(
            reach,
            |node, _| node.aabb().distance_to_local_point(p, true),
            |triangle, _| {
                let t = self.faces.mesh.corners(triangle as usize);
                Some((point_at(&t, &on_triangle(point, &t).0) - point).norm())
            },
        )?;
        Some(self.faces.on(point, triangle, &self.faces.mesh.vertices))
    }

    /// The nearest point of the surface; faster if its distance is at most `bound` [m].
    pub fn nearest_below(&self, point: &Point3<f64>, bound: f64) -> Option<OnTriangle> {
        // Slightly larger, since the nearest point itself can have given the bound.
        self.nearest(point, bound * (1.0 + 1e-9))
            .or_else(|| self.nearest(point, f64::MAX))
    }

    /// Distance from `point` to one triangle [m].
    pub fn distance_to(&self, point: &Point3<f64>, triangle: u32) -> f64 {
        let t = self.faces.mesh.corners(triangle as usize);
        (point_at(&t, &on_triangle(point, &t).0) - point).norm()
    }

    /// The first intersection of the surface with a ray from `from` along `direction`: triangle and
    /// barycentric weights.
    pub fn first_hit(
        &self,
        from: &Point3<f64>,
        direction: &Vector3<f64>,
    ) -> Option<(u32, [f64; 3])> {
        let ray = Ray::new(glam(from), Glam::new(direction.x, direction.y, direction.z));
        let (triangle, time) = self.bvh.cast_ray(&ray, f64::MAX, |triangle, best| {
            let [a, b, c] = self.faces.mesh.corners(triangle as usize).map(|v| glam(&v));
            Triangle::new(a, b, c).cast_local_ray(&ray, best, false)
        })?;
        let hit = from + direction * time;
        Some((
            triangle,
            on_triangle(&hit, &self.faces.mesh.corners(triangle as usize)).0,
        ))
    }

    /// A lower bound on the distance of a point [m] for a known distance to the surface, and a
    /// nearer triangle if the search finds one.
    pub fn lower_bound(&self, point: &Point3<f64>, known: f64) -> (f64, Option<u32>) {
        let p = glam(point);
        // Pruned parts are at least the best distance over SLACK away; this share of the search is
        // skipped.
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

    /// Appends all triangles within `reach` [m] of `point`, in descending order of the hierarchy's
    /// own index.
    pub fn within(&self, point: &Point3<f64>, reach: f64, found: &mut Vec<u32>) {
        let p = glam(point);
        let half = Glam::new(reach, reach, reach);
        let begin = found.len();
        found.extend(self.bvh.intersect_aabb(&ParryAabb::new(p - half, p + half)));
        found[begin..].sort_unstable();
    }

    /// Pairs of a triangle of this surface and one of another whose boxes meet at the last refits,
    /// ascending.
    pub fn pairs(&self, other: &Self) -> Vec<[u32; 2]> {
        let corners = |of: &Self, t: u32| bounds(&of.faces.mesh.corners(t as usize));
        let meeting = self.bvh.leaf_pairs(&other.bvh, |a, b| a.intersects(b));
        let mut pairs: Vec<[u32; 2]> = meeting
            // The traversal does not test leaves directly below the roots.
            .filter(|&(s, t)| corners(self, s).intersects(&corners(other, t)))
            .map(|(s, t)| [s, t])
            .collect();
        pairs.sort_unstable();
        pairs
    }

    /// The winding number of the surface at `point`, exact. `x` are its positions, none farther
    /// than `moved` [m] from the position at the last refit. With the number of triangles that it took.
    pub fn winds_about(&self, point: &Point3<f64>, x: &[Point3<f64>], moved: f64) -> (i32, usize) {
        // All triangles that the ray from the point along +x can hit.
        let slack = Glam::new(moved, moved, moved);
        let mut far = glam(point);
        far.x = self.bvh.root_aabb().maxs.x.max(far.x);
        let ray = ParryAabb::new(glam(point) - slack, far + slack);
        self.bvh
            .intersect_aabb(&ray)
            .map(|t| crossing(point, &self.faces.corners(t, x)))
            .fold((0, 0), |(sum, tested), by| (sum + by, tested + 1))
    }

    /// The nearest of the triangles `among`, for positions `x` that can be newer than the last
    /// refit; of several equally near the lowest index. Faster if the triangle `likely` is near.
    pub fn nearest_among(
        &self,
        point: &Point3<f64>,
        among: &[u32],
        likely: u32,
        x: &[Point3<f64>],
    ) -> Option<OnTriangle> {
        let squared =
            |t: &[Point3<f64>; 3]| (point_at(t, &on_triangle(point, t).0) - point).norm_squared();
        let mut best: Option<(f64, u32)> = None;
        if among.binary_search(&likely).is_ok() {
            best = Some((squared(&self.faces.corners(likely, x)), likely));
        }
        for &triangle in among {
            let t = self.faces.corners(triangle, x);
            if best.is_some_and(|(b, _)| is_beyond(point, &t, b)) {
                continue;
            }
            let squared = squared(&t);
            if best.is_none_or(|(b, least)| squared < b || (squared == b && triangle < least)) {
                best = Some((squared, triangle));
            }
        }
        best.map(|(_, triangle)| self.faces.on(point, triangle, x))
    }
}

/// True if the box of a triangle is farther from `point` than the square root of `squared`, by more
/// than rounding.
fn is_beyond(point: &Point3<f64>, t: &[Point3<f64>; 3], squared: f64) -> bool {
    let outside = |k: usize| {
        let (low, high) = (
            t[0][k].min(t[1][k]).min(t[2][k]),
            t[0][k].max(t[1][k]).max(t[2][k]),
        );
        (low - point[k]).max(point[k] - high).max(0.0)
    };
    let (a, b, c) = (outside(0), outside(1), outside(2));
    a * a + b * b + c * c > squared * (1.0 + 1e-9)
}

/// Of a refitted surface: the positions determine the hierarchy, since its structure never changes.
impl State for Surface {
    fn save(&self, to: &mut Writer) {
        let Self {
            faces: _,
            bvh: _,
            workspace: _,
        } = self;
        to.list(self.positions());
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let positions = from.exactly::<Point3<f64>>(self.positions().len())?;
        let finite = positions
            .iter()
            .all(|p| p.coords.iter().all(|c| c.is_finite()));
        from.check(finite, "a surface whose positions are not finite")?;
        self.refit(&positions);
        Ok(())
    }
}

impl Obstacle for Surface {
    fn closest(&self, point: &Point3<f64>) -> Option<Projection> {
        self.nearest(point, f64::MAX).map(|on| on.closest)
    }

    fn closest_from(&self, point: &Point3<f64>, known: &Point3<f64>) -> Option<Projection> {
        self.nearest_below(point, (point - known).norm())
            .map(|on| on.closest)
    }

    fn clearance(&self, point: &Point3<f64>, known: &Point3<f64>) -> (f64, Point3<f64>) {
        let bound = (point - known).norm();
        match self.lower_bound(point, bound) {
            (lower, Some(triangle)) => {
                let t = self.faces.mesh.corners(triangle as usize);
                (lower, point_at(&t, &on_triangle(point, &t).0))
            }
            (lower, None) => (lower, *known),
        }
    }

    fn bounding_box(&self) -> Aabb {
        Aabb::of_points(&self.faces.mesh.vertices)
    }

    fn contact_samples(&self) -> &[Point3<f64>] {
        &self.faces.contact_samples
    }

    fn bytes(&self) -> usize {
        // parry reports the index of a leaf as a number, but it is optional and takes twice the
        // size. The workspace, whose size is private, is empty up to the first refit.
        let places = self.faces.mesh.triangles.len() * std::mem::size_of::<usize>();
        self.bvh.heap_memory_size() + places + self.faces.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;
    use crate::testing::Draw;
    use nalgebra::Vector3;

    #[test]
    fn a_surface_that_has_moved_winds_about_what_lies_in_it() {
        let ball = icosphere(1.0, 2);
        let surface = Surface::new(&ball);
        let mut draw = Draw::new(23);
        let mut inside = 0;
        for _ in 0..300 {
            // As far as the caller says, and in any direction.
            let by: Vector3<f64> = draw.direction() * 0.4;
            let x: Vec<Point3<f64>> = ball.vertices.iter().map(|v| v + by).collect();
            for _ in 0..20 {
                let out = draw.direction();
                let share = draw.between(0.0, 1.5);
                // Between these the triangles of the ball are.
                if (0.9..=1.0).contains(&share) {
                    continue;
                }
                let point = Point3::from(by + out * share);
                let (found, _) = surface.winds_about(&point, &x, 0.4);
                assert_eq!(found, i32::from(share < 0.9), "{by} {point}");
                inside += found;
            }
        }
        assert!(inside > 1000, "{inside}");
    }
}
