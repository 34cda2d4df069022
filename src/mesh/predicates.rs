//! Exact predicates of triangles: zero area, intersection, folding onto one another.
//!
//! Signs are those of the doubles as stored \[shewchuk1997\]. The few points of a query are scaled
//! by one power of two where their products could overflow or underflow, so a distant vertex does
//! not affect triangles without it. Within one query coordinates can differ by a factor of 1e60; a
//! coordinate that is smaller relative to the others can count as zero.

use nalgebra::Point3;
use robust::{Coord, Coord3D, orient2d, orient3d};

use super::measures::{Aabb, max_or_nan};

/// Products of three coordinates in this range neither overflow nor underflow.
const PLAIN: std::ops::Range<f64> = 1e-60..1e60;

/// The points scaled by the power of two that brings the greatest coordinate near 1, if it is far
/// from 1. No digit changes.
pub fn near_one<const N: usize>(points: [Point3<f64>; N]) -> [Point3<f64>; N] {
    let coordinates = || points.iter().flat_map(|p| p.coords.iter());
    // The usual case, fast.
    if coordinates().all(|c| c.abs() < PLAIN.end) && coordinates().any(|c| c.abs() >= PLAIN.start) {
        return points;
    }
    let greatest = max_or_nan(points.iter().flat_map(|p| p.coords.iter().map(|c| c.abs())));
    if PLAIN.contains(&greatest) || !(greatest > 0.0 && greatest.is_finite()) {
        return points;
    }
    // In two halves: a single factor for the smallest doubles would overflow.
    let exponent = -libm::ilogb(greatest);
    let half = exponent / 2;
    let (one, two) = (libm::ldexp(1.0, half), libm::ldexp(1.0, exponent - half));
    points.map(|p| p.map(|c| c * one * two))
}

/// The side of a triangle's plane on which a point lies: positive, negative or exactly 0.
pub(crate) fn side([a, b, c]: &[Point3<f64>; 3], p: &Point3<f64>) -> f64 {
    let at = |v: &Point3<f64>| Coord3D {
        x: v.x,
        y: v.y,
        z: v.z,
    };
    orient3d(at(a), at(b), at(c), at(p))
}

/// The orientation of a, b, c seen along `axis`: positive, negative or exactly 0.
pub(crate) fn turn(axis: usize, a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>) -> f64 {
    let at = |v: &Point3<f64>| Coord {
        x: v[(axis + 1) % 3],
        y: v[(axis + 2) % 3],
    };
    orient2d(at(a), at(b), at(c))
}

/// An axis along which the projected triangle has area; `None` where its corners are collinear.
fn open_axis([a, b, c]: &[Point3<f64>; 3]) -> Option<usize> {
    (0..3).find(|&axis| turn(axis, a, b, c) != 0.0)
}

/// True if the corners are collinear or coincide.
pub fn is_flat(triangle: &[Point3<f64>; 3]) -> bool {
    open_axis(&near_one(*triangle)).is_none()
}

/// True if a closed segment and a closed triangle with area share a point.
pub(crate) fn segment_meets(p: &Point3<f64>, q: &Point3<f64>, triangle: &[Point3<f64>; 3]) -> bool {
    let (above, below) = (side(triangle, p), side(triangle, q));
    if (above > 0.0 && below > 0.0) || (above < 0.0 && below < 0.0) {
        return false;
    }
    if above == 0.0 && below == 0.0 {
        return segment_meets_in_plane(p, q, triangle);
    }
    let [a, b, c] = triangle;
    let turns = [
        side(&[*p, *q, *a], b),
        side(&[*p, *q, *b], c),
        side(&[*p, *q, *c], a),
    ];
    turns.iter().all(|t| *t >= 0.0) || turns.iter().all(|t| *t <= 0.0)
}

fn segment_meets_in_plane(p: &Point3<f64>, q: &Point3<f64>, triangle: &[Point3<f64>; 3]) -> bool {
    let Some(axis) = open_axis(triangle) else {
        return false;
    };
    let side_of = |k: usize| (&triangle[k], &triangle[(k + 1) % 3]);
    let covers = |v: &Point3<f64>| {
        let turns = [0, 1, 2].map(|k| turn(axis, side_of(k).0, side_of(k).1, v));
        turns.iter().all(|t| *t >= 0.0) || turns.iter().all(|t| *t <= 0.0)
    };
    covers(p)
        || covers(q)
        || (0..3).any(|k| segments_meet(axis, [p, q], [side_of(k).0, side_of(k).1]))
}

/// True if two coplanar closed segments share a point, seen along `axis`.
fn segments_meet(axis: usize, [p, q]: [&Point3<f64>; 2], [a, b]: [&Point3<f64>; 2]) -> bool {
    let (pa, pb) = (turn(axis, p, q, a), turn(axis, p, q, b));
    let (ap, aq) = (turn(axis, a, b, p), turn(axis, a, b, q));
    let apart = |s: f64, t: f64| (s > 0.0 && t > 0.0) || (s < 0.0 && t < 0.0);
    if apart(pa, pb) || apart(ap, aq) {
        return false;
    }
    // For collinear segments the boxes decide.
    let overlap = |k: usize| p[k].max(q[k]) >= a[k].min(b[k]) && a[k].max(b[k]) >= p[k].min(q[k]);
    let on_one_line = pa == 0.0 && pb == 0.0 && ap == 0.0 && aq == 0.0;
    !on_one_line || (overlap((axis + 1) % 3) && overlap((axis + 2) % 3))
}

/// True if two triangles with area intersect elsewhere than in common corners; `s` and `t` are
/// their vertex indices.
///
/// Two triangles with a common edge intersect elsewhere only where one is folded onto the other.
/// Two triangles with three common corners are duplicates; this function does not test for them.
pub fn intersect(s: [u32; 3], t: [u32; 3], at: impl Fn(u32) -> Point3<f64>) -> bool {
    let [s0, s1, s2, t0, t1, t2] = near_one([s[0], s[1], s[2], t[0], t[1], t[2]].map(at));
    let (of_s, of_t) = ([s0, s1, s2], [t0, t1, t2]);
    match s.iter().filter(|v| t.contains(v)).count() {
        // Corners strictly on one side of the other triangle's plane: the common case.
        0 if is_beside(&of_s, &of_t) || is_beside(&of_t, &of_s) => false,
        0 => {
            (0..3).any(|k| opposite_side_meets(&of_s, k, &of_t))
                || (0..3).any(|k| opposite_side_meets(&of_t, k, &of_s))
        }
        1 => {
            let shared = |one: [u32; 3], other: [u32; 3]| {
                one.iter().position(|v| other.contains(v)).unwrap_or(0)
            };
            opposite_side_meets(&of_s, shared(s, t), &of_t)
                || opposite_side_meets(&of_t, shared(t, s), &of_s)
        }
        2 => {
            let apex = |one: [u32; 3], other: [u32; 3]| one.iter().position(|v| !other.contains(v));
            match (apex(s, t), apex(t, s)) {
                (Some(c), Some(d)) => is_folded(&of_s, c, &of_t[d]),
                _ => false,
            }
        }
        _ => false,
    }
}

/// A point where two triangles that intersect do so, rounded. Where a corner or a side lies in the
/// plane of the other triangle it is a point near them.
pub fn crossing_point(s: &[Point3<f64>; 3], t: &[Point3<f64>; 3]) -> Point3<f64> {
    for (one, other) in [(s, t), (t, s)] {
        for k in 0..3 {
            let (p, q) = (&one[k], &one[(k + 1) % 3]);
            let [a, b, c, p, q] = near_one([other[0], other[1], other[2], *p, *q]);
            let (above, below) = (side(&[a, b, c], &p), side(&[a, b, c], &q));
            if above != below && segment_meets(&p, &q, &[a, b, c]) {
                let share = above / (above - below);
                let (p, q) = (one[k], one[(k + 1) % 3]);
                return p + (q - p) * share;
            }
        }
    }
    let [one, other] = [s, t].map(Aabb::of_points);
    one.intersection(&other).center()
}

/// True if all corners lie strictly on one side of the plane of another triangle.
fn is_beside(one: &[Point3<f64>; 3], other: &[Point3<f64>; 3]) -> bool {
    let first = side(other, &one[0]);
    let agrees = |p: &Point3<f64>| match first > 0.0 {
        true => side(other, p) > 0.0,
        false => side(other, p) < 0.0,
    };
    first != 0.0 && agrees(&one[1]) && agrees(&one[2])
}

/// True if the side of a triangle opposite its corner `k` shares a point with another triangle.
fn opposite_side_meets(one: &[Point3<f64>; 3], k: usize, other: &[Point3<f64>; 3]) -> bool {
    segment_meets(&one[(k + 1) % 3], &one[(k + 2) % 3], other)
}

/// True if the corner `d` of the triangle beyond the side opposite corner `c` lies in the plane of
/// `triangle`, on the same side of that edge as `c`.
fn is_folded(triangle: &[Point3<f64>; 3], c: usize, d: &Point3<f64>) -> bool {
    // The usual case first.
    if side(triangle, d) != 0.0 {
        return false;
    }
    let Some(axis) = open_axis(triangle) else {
        return false;
    };
    let [a, b] = [[1, 2], [0, 2], [0, 1]][c].map(|k| &triangle[k]);
    (turn(axis, a, b, &triangle[c]) > 0.0) == (turn(axis, a, b, d) > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Draw;
    use nalgebra::Vector3;

    fn p(x: f64, y: f64, z: f64) -> Point3<f64> {
        Point3::new(x, y, z)
    }

    /// Tests two triangles given as points; equal points are one vertex.
    fn meet(s: [Point3<f64>; 3], t: [Point3<f64>; 3]) -> bool {
        let points: Vec<Point3<f64>> = [s, t].concat();
        let name = |k: usize| points.iter().position(|q| *q == points[k]).unwrap_or(k) as u32;
        let names = |from: usize| [name(from), name(from + 1), name(from + 2)];
        let both = intersect(names(0), names(3), |v| points[v as usize]);
        assert_eq!(
            both,
            intersect(names(3), names(0), |v| points[v as usize]),
            "{s:?} {t:?}"
        );
        both
    }

    fn floor() -> [Point3<f64>; 3] {
        [p(0.0, 0.0, 0.0), p(4.0, 0.0, 0.0), p(0.0, 4.0, 0.0)]
    }

    #[test]
    fn triangles_without_a_common_corner() {
        let through = [p(1.0, 1.0, -1.0), p(1.0, 1.0, 1.0), p(9.0, 9.0, 0.0)];
        let tip_on_it = [p(1.0, 1.0, 0.0), p(1.0, 1.0, 1.0), p(2.0, 1.0, 1.0)];
        let tip_an_ulp_above = [
            p(1.0, 1.0, f64::from_bits(1)),
            p(1.0, 1.0, 1.0),
            p(2.0, 1.0, 1.0),
        ];
        let beside = [p(5.0, 5.0, -1.0), p(5.0, 5.0, 1.0), p(9.0, 9.0, 0.0)];
        let within = [p(1.0, 1.0, 0.0), p(2.0, 1.0, 0.0), p(1.0, 2.0, 0.0)];
        let in_plane_apart = [p(4.0, 4.0, 0.0), p(5.0, 4.0, 0.0), p(4.0, 5.0, 0.0)];
        let in_line_with_a_side = [p(5.0, 0.0, 0.0), p(6.0, 0.0, 0.0), p(5.0, 0.0, 1.0)];
        for (t, expected) in [
            (through, true),
            (tip_on_it, true),
            (beside, false),
            (within, true),
            (in_plane_apart, false),
            (in_line_with_a_side, false),
        ] {
            assert_eq!(meet(floor(), t), expected, "{t:?}");
        }
        // The smallest double above the plane counts as above it, since it is not scaled down.
        assert!(!intersect([0, 1, 2], [3, 4, 5], |v| [
            floor(),
            tip_an_ulp_above
        ]
        .concat()[v as usize]));
    }

    #[test]
    fn triangles_with_common_corners() {
        let [a, b, c] = floor();
        let hinge = [b, a, p(0.0, 0.0, 3.0)];
        let flat = [b, a, p(1.0, -1.0, 0.0)];
        let folded = [b, a, p(1.0, 1.0, 0.0)];
        let fan = [a, p(-1.0, 0.0, 0.0), p(0.0, -1.0, 1.0)];
        let back_through = [a, p(3.0, 3.0, 1.0), p(1.0, 1.0, -1.0)];
        let over_it = [a, p(1.0, 0.5, 0.0), p(0.5, 1.0, 0.0)];
        let duplicate = [a, c, b];
        for (t, expected) in [
            (hinge, false),
            (flat, false),
            (folded, true),
            (fan, false),
            (back_through, true),
            (over_it, true),
            (duplicate, false),
        ] {
            assert_eq!(meet(floor(), t), expected, "{t:?}");
        }
    }

    #[test]
    fn flat_triangles_are_known_exactly() {
        assert!(is_flat(&[
            p(0.0, 0.0, 0.0),
            p(1.0, 1.0, 1.0),
            p(3.0, 3.0, 3.0)
        ]));
        assert!(is_flat(&[
            p(1.0, 0.0, 0.0),
            p(1.0, 0.0, 0.0),
            p(3.0, 3.0, 3.0)
        ]));
        // A tenth is not exactly representable, and three tenths are not three times it.
        assert!(!is_flat(&[
            p(0.0, 0.0, 0.0),
            p(0.1, 0.1, 0.1),
            p(0.3, 0.3, 0.30000000000000004)
        ]));
        for size in [1e-300, 1e-100, 1e100, 1e300] {
            let triangle = [p(0.0, 0.0, 0.0), p(size, 0.0, 0.0), p(0.0, size, 0.0)];
            assert!(!is_flat(&triangle), "{size}");
            let above = triangle.map(|v| v + Vector3::z() * size);
            let through = [
                p(0.1 * size, 0.1 * size, -size),
                p(0.1 * size, 0.1 * size, size),
                p(size, size, 0.0),
            ];
            assert!(!meet(triangle, above) && meet(triangle, through), "{size}");
        }
        assert_eq!(near_one([p(f64::from_bits(1), 0.0, 0.0)])[0].x, 1.0);
    }

    #[test]
    fn drawn_triangles_agree_with_a_search_for_a_common_point() {
        // On a grid of eighths the arithmetic is exact, and triangles often touch and cross.
        let mut draw = Draw::new(31);
        let mut seen = [0, 0];
        for _ in 0..3000 {
            let mut point = || {
                let mut c = || (draw.between(-2.0, 3.0)).floor();
                p(c(), c(), c())
            };
            let (s, t) = ([point(), point(), point()], [point(), point(), point()]);
            if is_flat(&s) || is_flat(&t) || s.iter().any(|v| t.contains(v)) {
                continue;
            }
            let crosses = meet(s, t);
            seen[usize::from(crosses)] += 1;
            // Disjoint triangles of this grid are more than a hundredth apart.
            assert_eq!(crosses, gap(&s, &t) <= 1e-3, "{s:?} {t:?}");
        }
        assert!(seen[0] > 300 && seen[1] > 300, "{seen:?}");
    }

    /// Distance of two triangles by alternating projections: slow and independent of signs.
    fn gap(s: &[Point3<f64>; 3], t: &[Point3<f64>; 3]) -> f64 {
        use crate::mesh::closest::closest_on_triangle;
        let mut x = s[0];
        let mut last = f64::INFINITY;
        for _ in 0..20_000 {
            let y = closest_on_triangle(&x, t);
            x = closest_on_triangle(&y, s);
            let now = (x - y).norm();
            if now <= 1e-10 || last - now <= 1e-16 {
                return now;
            }
            last = now;
        }
        last
    }
}
