//! Crossings: pairs of triangles of one surface, or of two, that share a point where they are not
//! joined. Exact.

use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::Aabb;
use crate::mesh::predicates;
use nalgebra::Point3;
use rayon::prelude::*;

/// Number of triangles between two checks of the budget.
const CHUNK: usize = 4096;

/// Greatest number of box pairs in a search, in all and per triangle. A normal surface has about
/// twenty per triangle; only thousands of triangles at one position would need their square.
const BUDGET: (usize, usize) = (1 << 22, 256);

/// Greatest number of listed pairs of an examination; the count covers all pairs.
pub const LISTED: usize = 100;

/// Crossings of a surface with itself or with another one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Crossings {
    /// Pairs of triangles, ascending, not more than the search may list: of one surface the lower
    /// index first, of two surfaces the triangle of the first one first.
    pub pairs: Vec<[u32; 2]>,
    /// Number of pairs.
    pub count: usize,
    /// True if all pairs were tested; false if too many triangles at one position ended the search
    /// early.
    pub complete: bool,
}

/// A surface in a search of crossings.
#[derive(Clone, Copy, Debug)]
pub struct Crossed<'a> {
    /// Vertex positions [m], shape `[vertex_count]`.
    pub vertices: &'a [Point3<f64>],
    /// Triangles, shape `[triangle_count]`.
    pub triangles: &'a [[u32; 3]],
    /// The representative of each vertex, at the same position: coincident vertices count as one.
    /// Shape `[vertex_count]`.
    pub names: &'a [u32],
    /// True for a triangle that is left out (zero area), shape `[triangle_count]`.
    pub skipped: &'a [bool],
    /// The tree over these triangles.
    pub tree: &'a SurfaceTree,
}

impl Crossed<'_> {
    fn bounds(&self, t: usize) -> Aabb {
        Aabb::of_points(&self.triangles[t].map(|v| self.vertices[v as usize]))
    }

    fn named(&self, t: usize) -> [u32; 3] {
        self.triangles[t].map(|v| self.names[v as usize])
    }
}

/// All pairs of triangles of one surface that share a point other than their common corners; at
/// most `listed` of them are named. Two triangles with the same three corners are no pair.
pub fn self_crossings(surface: Crossed<'_>, listed: usize) -> Crossings {
    let near = |t: usize, share: usize, near: &mut Vec<u32>| {
        let whole = surface.tree.meeting(&surface.bounds(t), share, near);
        let looked = near.len();
        near.retain(|&u| {
            let u = u as usize;
            u > t
                && !surface.skipped[u]
                && predicates::intersect(surface.named(t), surface.named(u), |v| {
                    surface.vertices[v as usize]
                })
        });
        (looked, whole)
    };
    search(surface, surface.triangles.len(), listed, near)
}

/// All crossings of a surface with itself, as it is: coincident vertices stay apart.
pub(crate) fn crossings_of(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Crossings {
    let flat = |t: &[u32; 3]| predicates::is_flat(&t.map(|v| vertices[v as usize]));
    let surface = Crossed {
        vertices,
        triangles,
        names: &(0..vertices.len() as u32).collect::<Vec<_>>(),
        skipped: &triangles.par_iter().map(flat).collect::<Vec<_>>(),
        tree: &SurfaceTree::new(vertices, triangles),
    };
    self_crossings(surface, usize::MAX)
}

/// All pairs of a triangle of `first` and a triangle of `second` that share a point; at most `listed`
/// of them are named.
pub fn crossings_between(first: Crossed<'_>, second: Crossed<'_>, listed: usize) -> Crossings {
    let near = |t: usize, share: usize, near: &mut Vec<u32>| {
        let corners = first.triangles[t].map(|v| first.vertices[v as usize]);
        let whole = second.tree.meeting(&first.bounds(t), share, near);
        let looked = near.len();
        near.retain(|&u| {
            let u = u as usize;
            let others = second.triangles[u].map(|v| second.vertices[v as usize]);
            !second.skipped[u]
                && predicates::intersect([0, 1, 2], [3, 4, 5], |v| match v {
                    0..3 => corners[v as usize],
                    _ => others[v as usize - 3],
                })
        });
        (looked, whole)
    };
    let triangles = first.triangles.len() + second.triangles.len();
    search(first, triangles, listed, near)
}

/// Searches the partners of each triangle of a surface. `near` appends the partners of a triangle,
/// looks at no more boxes than given, and returns their number and whether it saw all of them. The
/// budget grows with the number of `triangles`.
fn search(
    surface: Crossed<'_>,
    triangles: usize,
    listed: usize,
    near: impl Fn(usize, usize, &mut Vec<u32>) -> (usize, bool) + Sync,
) -> Crossings {
    let budget = BUDGET.0 + BUDGET.1 * triangles;
    let count = surface.triangles.len();
    let mut all = Crossings {
        complete: true,
        ..Crossings::default()
    };
    let mut looked = 0;
    for start in (0..count).step_by(CHUNK) {
        let end = (start + CHUNK).min(count);
        let share = (budget - looked) / (end - start);
        let of_triangle = |t: usize| {
            let mut partners = Vec::new();
            if surface.skipped[t] {
                return (partners, 0, 0, true);
            }
            let (boxes, whole) = near(t, share, &mut partners);
            partners.sort_unstable();
            let count = partners.len();
            partners.truncate(listed);
            partners.shrink_to_fit();
            (partners, count, boxes, whole)
        };
        let found: Vec<_> = (start..end).into_par_iter().map(of_triangle).collect();
        for (t, (partners, count, boxes, whole)) in (start..end).zip(found) {
            looked += boxes;
            all.complete &= whole;
            all.count += count;
            let room = listed.saturating_sub(all.pairs.len());
            let pairs = partners.iter().take(room).map(|&u| [t as u32, u]);
            all.pairs.extend(pairs);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;
    use crate::testing::Draw;
    use nalgebra::Vector3;

    /// Two surfaces of random triangles, by the search and by all pairs.
    #[test]
    fn pairs_between_surfaces_are_those_of_all_pairs() {
        let mut draw = Draw::new(77);
        let mut seen = 0;
        for round in 0..60 {
            let mut soup = |count: usize, offset: f64| {
                let vertices: Vec<Point3<f64>> = (0..3 * count)
                    .map(|_| {
                        Point3::from(draw.direction() * draw.between(0.0, 0.6))
                            + Vector3::x() * offset
                    })
                    .collect();
                let triangles: Vec<[u32; 3]> = (0..count as u32)
                    .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
                    .collect();
                (vertices, triangles)
            };
            let (first, second) = (soup(25, 0.0), soup(40, 0.02 * f64::from(round)));
            let found = between(&first, &second);
            let mut expected = Vec::new();
            for (s, one) in first.1.iter().enumerate() {
                for (t, other) in second.1.iter().enumerate() {
                    let at = |v: u32| match v {
                        0..3 => first.0[one[v as usize] as usize],
                        _ => second.0[other[v as usize - 3] as usize],
                    };
                    if predicates::intersect([0, 1, 2], [3, 4, 5], at) {
                        expected.push([s as u32, t as u32]);
                    }
                }
            }
            seen += expected.len();
            assert_eq!(found.pairs, expected);
            assert_eq!(found.count, expected.len());
            assert!(found.complete);
            let back: Vec<[u32; 2]> = between(&second, &first).pairs;
            let mut back: Vec<[u32; 2]> = back.iter().map(|[t, s]| [*s, *t]).collect();
            back.sort_unstable();
            assert_eq!(back, expected, "the order of the surfaces");
        }
        assert!(seen > 500, "{seen}");
    }

    type Soup = (Vec<Point3<f64>>, Vec<[u32; 3]>);

    fn between(first: &Soup, second: &Soup) -> Crossings {
        let trees = [first, second].map(|(v, t)| SurfaceTree::new(v, t));
        let names: Vec<u32> = (0..first.0.len().max(second.0.len()) as u32).collect();
        let skipped = vec![false; names.len()];
        let first = Crossed {
            vertices: &first.0,
            triangles: &first.1,
            names: &names,
            skipped: &skipped,
            tree: &trees[0],
        };
        let second = Crossed {
            vertices: &second.0,
            triangles: &second.1,
            tree: &trees[1],
            ..first
        };
        crossings_between(first, second, usize::MAX)
    }

    #[test]
    fn a_refitted_tree_finds_what_a_new_one_finds() {
        let mesh = icosphere(1.0, 3);
        let mut tree = SurfaceTree::new(&mesh.vertices, &mesh.triangles);
        let mut draw = Draw::new(5);
        let moved: Vec<Point3<f64>> = mesh
            .vertices
            .iter()
            .map(|p| Point3::from(p.coords.component_mul(&Vector3::new(2.0, 0.3, 1.0))))
            .map(|p| p + draw.direction() * 0.05)
            .collect();
        tree.refit(&moved, &mesh.triangles);
        let fresh = SurfaceTree::new(&moved, &mesh.triangles);
        let names: Vec<u32> = (0..moved.len() as u32).collect();
        let skipped = vec![false; mesh.triangles.len()];
        let of = |tree| {
            let surface = Crossed {
                vertices: &moved,
                triangles: &mesh.triangles,
                names: &names,
                skipped: &skipped,
                tree,
            };
            self_crossings(surface, usize::MAX)
        };
        let found = of(&tree);
        assert_eq!(found, of(&fresh));
        assert!(found.count > 0);
        for _ in 0..200 {
            let p = Point3::from(draw.direction() * draw.between(0.0, 2.0));
            let one = tree.closest(&p, f64::INFINITY).map(|c| c.distance);
            assert_eq!(one, fresh.closest(&p, f64::INFINITY).map(|c| c.distance));
        }
    }
}
