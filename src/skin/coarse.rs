//! Refinement of skin with triangles that are large relative to an implant, such as a box of twelve
//! triangles. Bisection near the implant keeps the extracted and refined patch no larger than
//! necessary.

use std::collections::{BTreeMap, BinaryHeap};

use nalgebra::{Point3, center};

use super::patch::MARGIN;
use super::place::middle;
use super::plan::ImplantSpec;
use super::region::REACH;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::closest_on_triangle;

/// Edges near an implant are bisected down to this share of the radius of its region.
const LONG: f64 = 0.5;

/// Greatest number of bisections. A triangle of any size needs about a hundred; a later check
/// rejects skin that needs more by its area.
const MOST: usize = 200_000;

/// An edge with its length, longest first; the ends decide between equal lengths.
#[derive(PartialEq)]
struct Long(f64, [u32; 2]);

impl Eq for Long {}

impl Ord for Long {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0
            .total_cmp(&other.0)
            .then_with(|| other.1.cmp(&self.1))
    }
}

impl PartialOrd for Long {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// The same surface with triangles fine enough near each implant: edges longer than half of the
/// radius of its region are bisected, longest first, with all their triangles. Vertices keep their
/// indices and new ones follow; sufficiently fine skin is unchanged. [`super::plan::Ready::new`]
/// reports invalid orders.
pub fn halved_near(mut skin: TriangleMesh, orders: &[ImplantSpec]) -> TriangleMesh {
    if skin
        .triangles
        .iter()
        .flatten()
        .any(|v| *v as usize >= skin.vertices.len())
    {
        return skin;
    }
    for order in orders {
        if order.check().is_err() {
            continue;
        }
        let Ok((centre, _)) = middle(&skin, order) else {
            continue;
        };
        let radius = REACH * 0.5 * order.implant.base;
        skin = halved(
            skin,
            &centre,
            MARGIN * radius + 2.0 * order.edge(),
            LONG * radius,
        );
    }
    skin
}

fn key(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Bisects edges longer than `longest` [m] of triangles within `within` [m] of a point.
fn halved(skin: TriangleMesh, centre: &Point3<f64>, within: f64, longest: f64) -> TriangleMesh {
    let mut bisection = Bisection {
        skin,
        centre: *centre,
        within,
        longest,
        open: BinaryHeap::new(),
        beside: BTreeMap::new(),
    };
    for t in 0..bisection.skin.triangles.len() {
        bisection.offer(bisection.skin.triangles[t]);
    }
    if !bisection.open.is_empty() {
        bisection.list_triangles();
        for _ in 0..MOST {
            let Some(Long(_, side)) = bisection.open.pop() else {
                break;
            };
            bisection.bisect(side);
        }
    }
    bisection.skin
}

fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [key(a, b), key(b, c), key(c, a)]
}

/// A surface with long edges near a point that are to be bisected.
struct Bisection {
    skin: TriangleMesh,
    centre: Point3<f64>,
    /// Greatest distance of a bisected triangle from the point [m].
    within: f64,
    /// Length of the longest edge that stays [m].
    longest: f64,
    /// Edges to bisect; an edge with two triangles is listed twice.
    open: BinaryHeap<Long>,
    /// The triangles of each edge.
    beside: BTreeMap<[u32; 2], Vec<u32>>,
}

impl Bisection {
    /// Lists the long edges of a triangle if it is near.
    fn offer(&mut self, t: [u32; 3]) {
        let corners = t.map(|v| self.skin.vertices[v as usize]);
        let is_near =
            || (closest_on_triangle(&self.centre, &corners) - self.centre).norm() <= self.within;
        let long = sides(t).map(|side| {
            let [a, b] = side.map(|v| self.skin.vertices[v as usize]);
            Long((a - b).norm(), side)
        });
        if long.iter().any(|side| side.0 > self.longest) && is_near() {
            // A NaN or infinite length is not bisected.
            self.open.extend(
                long.into_iter()
                    .filter(|side| side.0 > self.longest && side.0.is_finite()),
            );
        }
    }

    fn list_triangles(&mut self) {
        for (t, corners) in self.skin.triangles.iter().enumerate() {
            for side in sides(*corners) {
                let all = self.beside.entry(side).or_default();
                // A triangle with a repeated vertex has a repeated side.
                if all.last() != Some(&(t as u32)) {
                    all.push(t as u32);
                }
            }
        }
    }

    /// Bisects an edge with all its triangles.
    fn bisect(&mut self, side: [u32; 2]) {
        let ends = side.map(|v| self.skin.vertices[v as usize]);
        let middle = center(&ends[0], &ends[1]);
        // The edge is so short relative to its coordinates that no number lies between them.
        if ends.contains(&middle) {
            return;
        }
        // Listed by two triangles and already bisected.
        let Some(halved) = self.beside.remove(&side) else {
            return;
        };
        let new = self.skin.vertices.len() as u32;
        self.skin.vertices.push(middle);
        for t in halved {
            self.halve(t, side, new);
        }
    }

    /// Divides a triangle at the new vertex of its edge `[a, b]`.
    fn halve(&mut self, t: u32, [a, b]: [u32; 2], new: u32) {
        let old = self.skin.triangles[t as usize];
        let [first, second] =
            [(a, new), (b, new)].map(|(from, to)| old.map(|v| if v == from { to } else { v }));
        let added = self.skin.triangles.len() as u32;
        self.skin.triangles[t as usize] = first;
        self.skin.triangles.push(second);
        // The original triangle becomes the one with `b`.
        for side in sides(old) {
            if side.contains(&a) && !side.contains(&b) {
                for other in self.beside.entry(side).or_default() {
                    if *other == t {
                        *other = added;
                    }
                }
            }
        }
        for (t, corners) in [(t, first), (added, second)] {
            for side in sides(corners).into_iter().filter(|s| s[1] == new) {
                let all = self.beside.entry(side).or_default();
                if !all.contains(&t) {
                    all.push(t);
                }
            }
            self.offer(corners);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::plan::ImplantPlace;
    use super::*;
    use crate::mesh::Topology;
    use crate::mesh::measures::max_or_nan;
    use crate::mesh::shapes::box_surface;

    fn order(at: Point3<f64>) -> ImplantSpec {
        ImplantSpec::round(ImplantPlace::Point(at), 0.02, 1e-6)
    }

    #[test]
    fn a_box_is_halved_near_the_implant_only_and_stays_the_same_box() {
        let skin = box_surface([2.0; 3], 2.0);
        let place = Point3::new(0.31, 0.17, 1.0);
        let after = halved_near(skin.clone(), &[order(place)]);
        let topology = Topology::new(&after);
        assert!(topology.is_closed() && topology.is_oriented());
        assert!(
            topology.non_manifold_edges().is_empty()
                && topology.non_manifold_vertices(&after).is_empty()
        );
        assert!(
            (after.area() / skin.area() - 1.0).abs() <= 1e-12
                && (after.volume() / skin.volume() - 1.0).abs() <= 1e-12
        );
        assert_eq!(after.vertices[..skin.vertices.len()], skin.vertices[..]);
        let added = after.triangles.len() - skin.triangles.len();
        assert!((20..1000).contains(&added), "{added} more triangles");
        // No edge near the implant exceeds the limit; distant triangles are unchanged.
        let radius = REACH * 0.5 * 0.02;
        for t in &after.triangles {
            let corners = t.map(|v| after.vertices[v as usize]);
            let longest = max_or_nan((0..3).map(|k| (corners[k] - corners[(k + 1) % 3]).norm()));
            let far = (closest_on_triangle(&place, &corners) - place).norm();
            assert!(
                far > MARGIN * radius || longest <= LONG * radius,
                "{longest} m at {far} m"
            );
        }
        assert!(
            after
                .triangles
                .iter()
                .filter(|t| skin.triangles.contains(t))
                .count()
                * 2
                >= skin.triangles.len()
        );
    }

    #[test]
    fn skin_that_is_fine_enough_and_orders_that_are_wrong_change_nothing() {
        let skin = box_surface([0.1; 3], 0.004);
        let top = Point3::new(0.0, 0.0, 0.05);
        assert_eq!(halved_near(skin.clone(), &[order(top)]), skin);
        let coarse = box_surface([0.1; 3], 0.1);
        let wrong = ImplantSpec {
            place: ImplantPlace::Vertex(1_000_000),
            ..order(top)
        };
        assert_eq!(halved_near(coarse.clone(), &[wrong]), coarse);
        let mut broken = coarse;
        broken.vertices[0].x = f64::INFINITY;
        assert!(halved_near(broken, &[order(top)]).triangles.len() < 10_000);
    }
}
