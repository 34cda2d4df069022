//! Truncated steps of single pairs: certified in real numbers at both ends, therefore between.

use nalgebra::{Point3, Vector3};
use pliant::contact::{Parts, Truncation, gap, truncate};
use pliant::testing::Draw;
use pliant::testing::internals::contact::height;

use super::exact::separates;
use super::{BOTH, Corners, distance, integers, queries};
use crate::tolerances::cases;

/// True if one normal separates the parts at both ends in real numbers; the height along it is a
/// concave function of time.
fn certified(parts: Parts, start: &Corners, step: &Truncation) -> bool {
    step.normal
        .is_some_and(|n| separates(parts, start, &n) && separates(parts, &step.ends, &n))
}

/// The share of the way of all corners that is kept.
fn share(start: &Corners, wanted: &Corners, ends: &Corners) -> f64 {
    let way = |to: &Corners, from: &Corners| -> f64 {
        to.iter().zip(from).map(|(a, b)| (a - b).norm()).sum()
    };
    let all = way(wanted, start);
    if all > 0.0 {
        1.0 - way(wanted, ends) / all
    } else {
        1.0
    }
}

#[test]
fn steps_of_drawn_pairs_are_certified() {
    let mut draw = Draw::new(41);
    let (mut counts, mut failed) = ([0; 3], 0);
    for _ in 0..100 * cases(300) {
        for parts in BOTH {
            let size = draw.decades(-9.0, 3.0);
            let offset = draw.direction() * draw.decades(-3.0, 3.0) * draw.index(2) as f64;
            let start: Corners = std::array::from_fn(|_| {
                Point3::from(draw.direction() * draw.between(0.0, size) + offset)
            });
            let far = size * draw.decades(-4.0, 2.0);
            let wanted = start.map(|p| p + draw.direction() * draw.between(0.0, far));
            let fixed = std::array::from_fn(|_| draw.index(4) == 0);
            // Fixed corners at rest.
            let wanted = std::array::from_fn(|k| if fixed[k] { start[k] } else { wanted[k] });
            let step = truncate(parts, &start, &wanted, fixed);
            let Some(gap) = gap(parts, &start) else {
                assert_eq!(step.ends, start);
                assert!(step.normal.is_none() && (step.held > 0) == (wanted != start));
                counts[0] += 1;
                continue;
            };
            assert!(
                certified(parts, &start, &step),
                "{parts:?} {start:?} {wanted:?}"
            );
            assert_eq!(step.kept, step.ends == wanted);
            counts[1 + usize::from(step.kept)] += 1;
            let normal = gap.normal;
            for k in 0..4 {
                assert!(!fixed[k] || step.ends[k] == start[k]);
                // A corner is only moved back, and only along the normal.
                let [whole, cut] = [wanted[k] - start[k], step.ends[k] - start[k]];
                let along = |v: &Vector3<f64>| v - normal * normal.dot(v);
                let error = (along(&whole) - along(&cut)).norm();
                let rounding = 1e-14 * (whole.norm() + offset.norm() + size);
                assert!(step.held > 0 || error <= rounding);
                let back = (whole.dot(&normal), cut.dot(&normal));
                assert!(step.held > 0 || back.1.abs() <= back.0.abs() + rounding);
            }
            // Control: the plane is needed.
            failed += usize::from(!step.kept && !separates(parts, &wanted, &normal));
        }
    }
    println!("{counts:?} held, cut and kept; {failed} would not be separated");
    assert!(counts[1..].iter().all(|n| *n > 100) && failed > 100);
}

#[test]
fn touching_pairs_are_held_and_moving_fixed_corners_are_told() {
    let mut draw = Draw::new(42);
    let (mut held, mut refused) = (0, 0);
    for _ in 0..cases(2000) {
        for parts in BOTH {
            let start: Corners = std::array::from_fn(|_| Point3::from(integers(&mut draw, 3)));
            let wanted = start.map(|p| p + integers(&mut draw, 2));
            let fixed = std::array::from_fn(|_| draw.index(2) == 0);
            let step = truncate(parts, &start, &wanted, fixed);
            if distance(parts, &start) < 1e-9 {
                held += step.held;
                assert!(step.normal.is_none());
                for k in 0..4 {
                    assert_eq!(step.ends[k], if fixed[k] { wanted[k] } else { start[k] });
                }
            } else if step.normal.is_some() {
                assert!(certified(parts, &start, &step));
                (0..4).for_each(|k| assert!(!fixed[k] || step.ends[k] == wanted[k]));
            } else {
                // Only fixed corners can make a step that cannot be certified.
                refused += 1;
                let normal = gap(parts, &start).expect("a gap").normal;
                let stays: Corners =
                    std::array::from_fn(|k| if fixed[k] { wanted[k] } else { start[k] });
                assert!(!(height(parts, &stays, &normal) > 1e-12));
            }
        }
    }
    println!("{held} corners held, {refused} steps without certificate");
    assert!(held > 100 && refused > 100);
}

/// A1 of one kind of pairs: number of queries, of those that touch at the start, mean share and
/// number of whole steps of those that do not meet, and the mean share of those that meet.
fn public(parts: Parts) -> Option<[f64; 6]> {
    let (mut kept, mut whole, mut cut, mut touching) = (Vec::new(), 0, Vec::new(), 0);
    for query in queries::load()?.iter().filter(|query| query.parts == parts) {
        let step = truncate(parts, &query.start, &query.end, [false; 4]);
        if distance(parts, &query.start) <= 1e-12 && step.normal.is_none() {
            assert_eq!(step.ends, query.start);
            touching += 1;
        } else {
            assert!(certified(parts, &query.start, &step), "{:?}", query.start);
        }
        let share = share(&query.start, &query.end, &step.ends);
        if query.meets {
            assert!(!step.kept, "a way on which the parts meet is kept");
            cut.push(share);
        } else {
            kept.push(share);
            whole += usize::from(step.kept);
        }
    }
    let mean = |shares: &[f64]| shares.iter().sum::<f64>() / shares.len() as f64;
    Some([
        (kept.len() + cut.len()) as f64,
        f64::from(touching),
        kept.len() as f64,
        mean(&kept),
        f64::from(whole as u32) / kept.len() as f64,
        mean(&cut),
    ])
}

#[test]
fn a1_public_queries_are_certified_and_keep_most_of_their_steps() {
    for (parts, least) in [(Parts::EdgeEdge, 0.96), (Parts::VertexTriangle, 0.95)] {
        let Some([count, touching, free, kept, whole, cut]) = public(parts) else {
            println!("skipped the public queries: they are absent");
            return;
        };
        println!(
            "{parts:?}: {count} queries, {touching} touch at the start; {free} do not meet: share \
             {kept:.4}, whole steps {whole:.4}; share of those that meet {cut:.4}"
        );
        assert!(kept >= least && whole >= 0.88 && count > 1000.0);
    }
}
