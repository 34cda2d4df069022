//! Edges of two oriented surfaces that face each other.

use nalgebra::{Point3, Vector3};

use super::surface::box_pairs_between;
use crate::mesh::measures::Aabb;

/// Sine of the least angle between two edges that touch between their ends: of nearly parallel ones
/// a vertex is as near.
const PARALLEL: f64 = 1e-3;

/// Sine by which a triangle beside an edge may rise over the plane of a contact, without and with a
/// crossing: edges of a valley touch nothing, but a ridge that has passed through a surface bends
/// it.
const RISES: [f64; 2] = [0.1, 0.5];

/// Edges of an oriented surface with two triangles each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OrientedEdges<'a> {
    /// Positions [m].
    pub x: &'a [Point3<f64>],
    /// Each edge with the tips of its triangles, `[a, b, c, d]`: triangle (a, b, c) and triangle
    /// (b, a, d) face outward.
    pub hinges: &'a [[u32; 4]],
}

/// Two edges whose lines are nearest to each other between their ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FacingEdges {
    /// Indices of the hinges.
    pub hinges: [usize; 2],
    /// Place along each edge, from 0 to 1.
    pub places: [f64; 2],
    /// Unit normal of both edges, outward from the second surface.
    pub normal: Vector3<f64>,
    /// Height of the first place over the second one along the normal [m]; negative if the surfaces
    /// cross there.
    pub gap: f64,
}

/// An edge: its ends, its triangles, and the directions from it to their tips.
struct Edge {
    ends: [Point3<f64>; 2],
    triangles: [[Point3<f64>; 3]; 2],
    tips: [Vector3<f64>; 2],
    outward: Vector3<f64>,
}

impl Edge {
    /// `None` beside a triangle without area.
    fn new([a, b, c, d]: [Point3<f64>; 4]) -> Option<Self> {
        let unit = |v: Vector3<f64>| v.try_normalize(0.0);
        let along = unit(b - a)?;
        let across = |tip: Point3<f64>| unit((tip - a) - along * along.dot(&(tip - a)));
        let tips = [across(c)?, across(d)?];
        Some(Self {
            ends: [a, b],
            triangles: [[a, b, c], [b, a, d]],
            tips,
            // The sum of the unit normals of both triangles.
            outward: along.cross(&(tips[0] - tips[1])),
        })
    }

    /// True if no triangle beside the edge rises over a plane with this unit normal through it by
    /// more than this sine.
    fn is_below(&self, normal: &Vector3<f64>, rises: f64) -> bool {
        self.tips.iter().all(|tip| tip.dot(normal) <= rises)
    }

    /// True if another edge passes through a triangle beside this one.
    fn is_crossed_by(&self, other: &Self) -> bool {
        let [from, to] = other.ends;
        self.triangles.iter().any(|[a, b, c]| {
            let normal = (b - a).cross(&(c - a));
            let heights = [from, to].map(|end| (end - a).dot(&normal));
            if !(heights[0] * heights[1] < 0.0) {
                return false;
            }
            let at = from + (to - from) * (heights[0] / (heights[0] - heights[1]));
            [(a, b), (b, c), (c, a)]
                .iter()
                .all(|(p, q)| (*q - *p).cross(&(at - *p)).dot(&normal) >= 0.0)
        })
    }
}

impl OrientedEdges<'_> {
    /// The edges that can be within `reach` [m] of a box, with their boxes.
    fn near(&self, bounds: &Aabb, reach: f64) -> (Vec<usize>, Vec<Aabb>) {
        let boxes = self.hinges.iter().map(|&[a, b, ..]| {
            Aabb::of_points([a, b].map(|v| &self.x[v as usize])).inflate(0.5 * reach)
        });
        let near = boxes.enumerate().filter(|(_, own)| own.intersects(bounds));
        near.unzip()
    }

    fn edge(&self, hinge: usize) -> Option<Edge> {
        Edge::new(self.hinges[hinge].map(|v| self.x[v as usize]))
    }
}

/// The edges of two surfaces that face each other with a gap of at most `above` [m], or cross by at
/// most `below` [m], ascending.
pub(crate) fn facing_edges(
    one: OrientedEdges<'_>,
    other: OrientedEdges<'_>,
    [above, below]: [f64; 2],
) -> Vec<FacingEdges> {
    let reach = above.max(below);
    let bounds = |of: &OrientedEdges<'_>| Aabb::of_points(of.x.iter()).inflate(0.5 * reach);
    let first = one.near(&bounds(&other), reach);
    let second = other.near(&bounds(&one), reach);
    let mut found: Vec<FacingEdges> = box_pairs_between(&first.1, &second.1)
        .into_iter()
        .filter_map(|[s, t]| {
            facing(
                [&one, &other],
                [first.0[s as usize], second.0[t as usize]],
                [above, below],
            )
        })
        .collect();
    found.sort_unstable_by_key(|pair| pair.hinges);
    found
}

fn facing(
    of: [&OrientedEdges<'_>; 2],
    hinges: [usize; 2],
    [above, below]: [f64; 2],
) -> Option<FacingEdges> {
    let [one, other] = [of[0].edge(hinges[0])?, of[1].edge(hinges[1])?];
    let [d, e] = [&one, &other].map(|edge| edge.ends[1] - edge.ends[0]);
    let across = d.cross(&e);
    let squared = across.norm_squared();
    if !(squared > PARALLEL * PARALLEL * d.norm_squared() * e.norm_squared()) {
        return None;
    }
    let mut normal = across / squared.sqrt();
    if normal.dot(&other.outward) < 0.0 {
        normal = -normal;
    }
    let between = one.ends[0] - other.ends[0];
    let gap = between.dot(&normal);
    let is_facing = normal.dot(&one.outward) < 0.0;
    let is_near = gap <= above && -gap <= below;
    let rises = RISES[usize::from(gap < 0.0)];
    if !(is_facing && is_near && other.is_below(&normal, rises) && one.is_below(&-normal, rises)) {
        return None;
    }
    // The lines meet, seen along the normal.
    let places = [
        e.cross(&between).dot(&across) / squared,
        d.cross(&between).dot(&across) / squared,
    ];
    let is_inside = places.iter().all(|w| *w > 0.0 && *w < 1.0);
    // Edges of surfaces that pass each other at a distance can lie in this order too.
    let is_real = gap >= 0.0 || other.is_crossed_by(&one) || one.is_crossed_by(&other);
    (is_inside && is_real).then_some(FacingEdges {
        hinges,
        places,
        normal,
        gap,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    type Roof = (Vec<Point3<f64>>, Vec<[u32; 4]>);

    /// A roof with its ridge along y at height `z`, and one that hangs upside down with its ridge
    /// along x through the origin.
    fn roofs(z: f64) -> [Roof; 2] {
        let at = |points: [[f64; 3]; 4]| points.map(Point3::from).to_vec();
        let hanging = at([
            [-1.0, 0.1, 0.0],
            [1.0, 0.1, 0.0],
            [0.0, -1.0, 0.5],
            [0.0, 1.0, 0.5],
        ]);
        let standing = at([
            [0.2, -1.0, z],
            [0.2, 1.0, z],
            [-1.0, 0.0, z - 0.5],
            [1.0, 0.0, z - 0.5],
        ]);
        [
            (hanging, vec![[0, 1, 2, 3]]),
            (standing, vec![[0, 1, 2, 3]]),
        ]
    }

    fn edges((x, hinges): &Roof) -> OrientedEdges<'_> {
        OrientedEdges { x, hinges }
    }

    #[test]
    fn ridges_that_face_each_other_are_found_apart_and_crossed() {
        for z in [-0.2, 1e-9, 0.2] {
            let [hanging, standing] = roofs(z);
            let both = [edges(&hanging), edges(&standing)];
            // The hanging roof faces downward, the standing one upward.
            let found = facing_edges(both[0], both[1], [0.3; 2]);
            assert_eq!(found.len(), 1, "{z}");
            assert!((found[0].gap + z).abs() <= 1e-12 && found[0].normal.z == 1.0);
            assert!((found[0].places[0] - 0.6).abs() <= 1e-12);
            assert!((found[0].places[1] - 0.55).abs() <= 1e-12);
            let seen = facing_edges(both[1], both[0], [0.3; 2]);
            assert!(seen[0].gap == found[0].gap && seen[0].normal == -found[0].normal);
            assert!(facing_edges(both[0], both[1], [0.9 * z.abs(); 2]).is_empty());
        }
    }

    #[test]
    fn edges_that_face_away_valleys_and_parallel_edges_touch_nothing() {
        let [hanging, standing] = roofs(-0.1);
        let mut turned = hanging.clone();
        turned.1[0].swap(0, 1);
        assert!(facing_edges(edges(&turned), edges(&standing), [0.3; 2]).is_empty());
        let mut valley = standing.clone();
        valley.0[2].z = 0.9;
        valley.0[3].z = 0.9;
        assert!(facing_edges(edges(&hanging), edges(&valley), [0.3; 2]).is_empty());
        let mut parallel = standing;
        (parallel.0[0], parallel.0[1]) =
            (Point3::new(-1.0, 0.1, -0.1), Point3::new(1.0, 0.1, -0.1));
        parallel.0[2] = Point3::new(0.0, 1.0, -0.6);
        parallel.0[3] = Point3::new(0.0, -1.0, -0.6);
        assert!(facing_edges(edges(&hanging), edges(&parallel), [0.3; 2]).is_empty());
    }
}
