//! Times of impact: nothing is missed (P27, P29), and what is called near is near (P28).

use std::time::Instant;

use nalgebra::{Point3, Vector3};
use pliant::contact::{Impact, Parts, time_of_impact};
use pliant::testing::Draw;
use pliant::testing::internals::contact::{Advance, advance};

use super::{BOTH, Corners, distance, integers, largest, queries};
use crate::tolerances::cases;

/// Kinds of constructed contacts.
const KINDS: [&str; 9] = [
    "general",
    "at the start",
    "at the end",
    "at ends and corners",
    "coplanar",
    "grazing",
    "without length or area",
    "parallel",
    "touching all the time",
];

/// A way that makes the parts touch at a known time.
struct Contact {
    parts: Parts,
    start: Corners,
    end: Corners,
    time: f64,
}

/// Parts that touch at a time that is a multiple of 1/16, in places that are multiples of 1/8. All
/// coordinates are whole multiples of a power of two with few digits, so that nothing is rounded.
fn contact(draw: &mut Draw, parts: Parts, kind: usize) -> Contact {
    let eighths = |draw: &mut Draw, most: usize| draw.index(most + 1) as f64 / 8.0;
    let time = match kind {
        1 => 0.0,
        2 => 1.0,
        _ => draw.index(17) as f64 / 16.0,
    };
    let mut motion: [Vector3<f64>; 4] = std::array::from_fn(|_| integers(draw, 8));
    let mut x: Corners = std::array::from_fn(|_| Point3::from(integers(draw, 8)));
    let mut u = eighths(draw, 8);
    if kind == 3 {
        u = u.round();
    }
    let weights = match parts {
        Parts::VertexTriangle => {
            let v = if kind == 3 {
                (1.0 - u) * draw.index(2) as f64
            } else {
                eighths(draw, 8).min(1.0 - u)
            };
            if kind == 6 {
                x[3] = x[1] + (x[2] - x[1]) * draw.index(3) as f64;
            }
            x[0] = x[1] + (x[2] - x[1]) * u + (x[3] - x[1]) * v;
            [1.0, u + v - 1.0, -u, -v]
        }
        Parts::EdgeEdge => {
            let mut along = integers(draw, 8);
            if kind == 6 {
                x[1] = x[0] + (x[1] - x[0]) * draw.index(2) as f64;
                along *= draw.index(2) as f64;
            }
            if kind == 7 {
                along = (x[1] - x[0]) * (draw.index(5) as f64 - 2.0);
            }
            let v = if kind == 3 {
                draw.index(2) as f64
            } else {
                eighths(draw, 8)
            };
            let touched = x[0] + (x[1] - x[0]) * u;
            x[2] = touched - along * v;
            x[3] = touched + along * (1.0 - v);
            [1.0 - u, u, v - 1.0, -v]
        }
    };
    match kind {
        4 => {
            x.iter_mut().for_each(|p| p.z = 0.0);
            motion.iter_mut().for_each(|m| m.z = 0.0);
        }
        // The touching places have the same velocity: a double root.
        5 => {
            let fastest = (0..4).find(|k| weights[*k].abs() == 1.0);
            let relative: Vector3<f64> = (0..4).map(|k| motion[k] * weights[k]).sum();
            if let Some(k) = fastest {
                motion[k] -= relative * weights[k];
            } else {
                motion[0] -= relative;
                motion[1] -= relative;
            }
        }
        8 => motion = [motion[0]; 4],
        _ => {}
    }
    let scale = 2_f64.powi(draw.index(40) as i32 - 30);
    let offset = integers(draw, 1000) * draw.index(2) as f64;
    let axes = draw.index(3);
    let place = |p: Point3<f64>| {
        let p = (p.coords + offset) * scale;
        Point3::from(Vector3::from_fn(|k, _| p[(k + axes) % 3]))
    };
    Contact {
        parts,
        start: std::array::from_fn(|k| place(x[k] - motion[k] * time)),
        end: std::array::from_fn(|k| place(x[k] + motion[k] * (1.0 - time))),
        time,
    }
}

fn at(start: &Corners, end: &Corners, time: f64) -> Corners {
    std::array::from_fn(|k| start[k] + (end[k] - start[k]) * time)
}

fn size(start: &Corners, end: &Corners) -> f64 {
    largest(start).max(largest(end))
}

/// The normal of the triangle or of both edges, not normalised: distances of slivers and of nearly
/// parallel edges are beyond the brute-force distance.
fn normal(parts: Parts, x: &Corners) -> Vector3<f64> {
    match parts {
        Parts::VertexTriangle => (x[2] - x[1]).cross(&(x[3] - x[1])),
        Parts::EdgeEdge => (x[1] - x[0]).cross(&(x[3] - x[2])),
    }
}

/// Number of constructed contacts that are missed, by kind. A contact is missed if the parts are
/// called apart at its time.
fn missed(count: usize, finds: impl Fn(&Contact, f64) -> Impact) -> [usize; 9] {
    let mut draw = Draw::new(27);
    std::array::from_fn(|kind| {
        let misses = |_: &usize| {
            let parts = BOTH[draw.index(2)];
            let contact = contact(&mut draw, parts, kind);
            let tolerance = draw.decades(-12.0, -3.0) * size(&contact.start, &contact.end);
            let impact = finds(&contact, tolerance);
            impact == Impact::Free || impact.apart_before() > contact.time
        };
        (0..count).filter(misses).count()
    })
}

#[test]
fn p27_no_constructed_contact_is_missed() {
    let count = 100 * cases(120);
    let found = missed(count, |c, tolerance| {
        let impact = time_of_impact(c.parts, &c.start, &c.end, tolerance);
        if let Impact::Near(time) = impact {
            let x = at(&c.start, &c.end, time);
            let size = size(&c.start, &c.end);
            let bound = 1.002 * tolerance + 2048.0 * f64::EPSILON * size;
            let apart = distance(c.parts, &x);
            assert!(
                apart <= bound || normal(c.parts, &x).norm() < 1e-6 * size * size,
                "{apart:e} of {tolerance:e}"
            );
        }
        impact
    });
    println!("of {count} contacts of each kind are missed: {found:?}");
    assert_eq!(found, [0; 9], "{KINDS:?}");
}

#[test]
fn p27_controls_miss_contacts() {
    let count = 300;
    let by = |numbers: Advance, tolerance: f64| {
        missed(count, |c, _| {
            advance(c.parts, &c.start, &c.end, tolerance, numbers).0
        })
    };
    let sound = Advance::default();
    let unbounded = by(
        Advance {
            rounding: 0.0,
            ..sound
        },
        0.0,
    );
    println!("without the bound of rounding: {unbounded:?}");
    assert!(unbounded.iter().sum::<usize>() > 0);
    let too_far = by(
        Advance {
            left: -0.05,
            ..sound
        },
        0.0,
    );
    println!("advances too far by a twentieth: {too_far:?}");
    assert!(too_far[0] > count / 100);
    let cubic = missed(count, |c, _| naive_cubic(c.parts, &c.start, &c.end));
    println!("a cubic: {cubic:?}");
    assert!(cubic.iter().sum::<usize>() > count / 100);
}

/// The usual method without bounds: the times at which the corners are coplanar, and a test whether
/// the parts touch then.
fn naive_cubic(parts: Parts, start: &Corners, end: &Corners) -> Impact {
    let value = |t: f64| {
        let x = at(start, end, t);
        (x[1] - x[0]).cross(&(x[2] - x[0])).dot(&(x[3] - x[0]))
    };
    // The cubic through four of its values.
    let [p, q, r, s] = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0].map(value);
    let b = 9.0 * (p - 2.5 * q + 2.0 * r - 0.5 * s);
    let c = 13.5 * (q - r) + 4.5 * (s - p);
    let a = s - p - b - c;
    let root = (b * b - 3.0 * a * c).max(0.0).sqrt();
    let mut times = vec![0.0, (-b - root) / (3.0 * c), (-b + root) / (3.0 * c), 1.0];
    times.retain(|t| (0.0..=1.0).contains(t));
    times.sort_by(f64::total_cmp);
    for ends in times.windows(2) {
        let [mut low, mut high] = [ends[0], ends[1]];
        if value(low) * value(high) > 0.0 {
            continue;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if value(low) * value(middle) <= 0.0 {
                high = middle;
            } else {
                low = middle;
            }
        }
        if distance(parts, &at(start, end, low)) <= 1e-12 * size(start, end) {
            return Impact::Near(low);
        }
    }
    Impact::Free
}

#[test]
fn p28_parts_on_both_sides_of_a_slab_are_free() {
    let mut draw = Draw::new(28);
    let (mut gaps, mut most) = (0, 0);
    let count = 100 * cases(100);
    for _ in 0..count {
        for parts in BOTH {
            let scale = draw.decades(-9.0, 3.0);
            let turn = draw.rotation();
            // The slab moves with the parts.
            let (tolerance, drift) = (draw.decades(-10.0, -3.0) * scale, draw.direction() * scale);
            let side = |k: usize| if k < parts.first() { 1.0 } else { -1.0 };
            let mut place = |k: usize| {
                let high = draw.between(0.0, 1.0).powi(8) * scale + 0.6 * tolerance;
                let flat = [draw.between(-scale, scale), draw.between(-scale, scale)];
                turn * Point3::new(flat[0], flat[1], side(k) * high)
            };
            let start: Corners = std::array::from_fn(&mut place);
            let end: Corners = std::array::from_fn(&mut place).map(|p| p + drift);
            let (impact, needed) = advance(parts, &start, &end, tolerance, Advance::default());
            assert_eq!(impact, Impact::Free, "{parts:?} {start:?} {end:?}");
            (gaps, most) = (gaps + needed, most.max(needed));
        }
    }
    println!(
        "{:.2} gaps a query, at most {most}",
        gaps as f64 / (2 * count) as f64
    );
    assert!(gaps <= 8 * count);
}

#[test]
fn p28_what_is_near_is_near() {
    let mut draw = Draw::new(29);
    let (mut near, mut free) = (0, 0);
    for _ in 0..100 * cases(100) {
        for parts in BOTH {
            let size = draw.decades(-9.0, 3.0);
            let start: Corners = std::array::from_fn(|_| Point3::from(draw.direction() * size));
            let end = start.map(|p| p + draw.direction() * draw.between(0.0, 2.0 * size));
            let tolerance = draw.decades(-9.0, -1.0) * size;
            match time_of_impact(parts, &start, &end, tolerance) {
                Impact::Near(time) => {
                    let apart = distance(parts, &at(&start, &end, time));
                    assert!(apart <= 1.002 * tolerance + 1e-14 * size);
                    near += 1;
                }
                Impact::Free => {
                    // No sampled time is nearer than a tenth of the tolerance.
                    let apart =
                        (0..=20).map(|k| distance(parts, &at(&start, &end, f64::from(k) / 20.0)));
                    assert!(apart.fold(f64::INFINITY, f64::min) > 0.099 * tolerance);
                    free += 1;
                }
                Impact::Undecided(_) => panic!("undecided: {parts:?} {start:?} {end:?}"),
            }
        }
    }
    assert!(near > 1000 && free > 1000, "{near} {free}");
}

#[test]
fn numbers_that_are_not_finite_are_undecided() {
    let x = [[0.2, 0.2, 1.0], [0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
    for parts in BOTH {
        for wrong in [f64::NAN, f64::INFINITY] {
            let mut end = x;
            end[3].y = wrong;
            assert_eq!(
                time_of_impact(parts, &x, &end, 1e-6),
                Impact::Undecided(0.0)
            );
            assert_eq!(
                time_of_impact(parts, &end, &x, 1e-6),
                Impact::Undecided(0.0)
            );
        }
        // A tolerance that is no number is the smallest one.
        assert_eq!(time_of_impact(parts, &x, &x, f64::NAN), Impact::Free);
        assert_eq!(time_of_impact(parts, &x, &x, -1.0), Impact::Free);
        let large = x.map(|p| p * 1e300);
        assert_ne!(time_of_impact(parts, &large, &x, 1e-6), Impact::Free);
    }
}

#[test]
fn p29_no_public_query_is_missed() {
    let Some(queries) = queries::load() else {
        println!("skipped the public queries: they are absent");
        return;
    };
    let meeting = queries.iter().filter(|query| query.meets).count();
    for tolerance in [1e-3, 1e-6, 1e-9, 0.0] {
        let (mut missed, mut wrong, mut undecided, mut gaps) = (0, 0, 0, 0);
        let begin = Instant::now();
        for query in &queries {
            let found = advance(
                query.parts,
                &query.start,
                &query.end,
                tolerance,
                Advance::default(),
            );
            let free = found.0 == Impact::Free;
            missed += usize::from(query.meets && free);
            wrong += usize::from(!query.meets && !free);
            undecided += usize::from(matches!(found.0, Impact::Undecided(_)));
            gaps += found.1;
        }
        let each = begin.elapsed().as_secs_f64() * 1e9 / queries.len() as f64;
        println!(
            "tolerance {tolerance:e}: {missed} missed of {meeting}, {wrong} not free of {} that do \
             not meet, {undecided} undecided, {:.1} gaps a query, {each:.0} ns",
            queries.len() - meeting,
            gaps as f64 / queries.len() as f64,
        );
        assert_eq!((missed, undecided), (0, 0));
        assert!(tolerance > 0.0 || wrong <= 200, "{wrong}");
    }
    let cubic = |query: &&queries::Query| {
        query.meets && naive_cubic(query.parts, &query.start, &query.end) == Impact::Free
    };
    let missed = queries.iter().filter(cubic).count();
    println!("control: a cubic misses {missed}");
    assert!(missed > 0);
}
