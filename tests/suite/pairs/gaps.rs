//! The gap of a pair: at most the distance, equal to it, with a normal that separates in real
//! numbers; none for parts that touch or cross.

use nalgebra::{Point3, Vector3};
use pliant::contact::{Parts, gap};
use pliant::testing::Draw;
use pliant::testing::internals::contact::{difference, height};

use super::exact::separates;
use super::{BOTH, Corners, distance, integers, largest};
use crate::tolerances::cases;

/// A pair with each kind of degenerate part.
fn drawn(draw: &mut Draw) -> Corners {
    let mut x: Corners = std::array::from_fn(|_| Point3::from(integers(draw, 4)));
    match draw.index(8) {
        0 => x[3] = x[2],
        1 => x[1] = x[0],
        2 => x[3] = x[2] + (x[1] - x[0]),
        3 => x[3] = x[1] + (x[2] - x[1]) * 2.0,
        4 => x.iter_mut().for_each(|p| p.z = 1.0),
        5 => x[1..].iter_mut().for_each(|p| p.y = 0.0),
        _ => {}
    }
    x
}

#[test]
fn a_gap_is_there_exactly_if_the_parts_are_apart() {
    let mut draw = Draw::new(21);
    let (mut some, mut none) = (0, 0);
    for _ in 0..100 * cases(500) {
        for parts in BOTH {
            let grid = drawn(&mut draw);
            // Parts on this grid touch, or are apart by more than 1e-4.
            let apart = distance(parts, &grid);
            assert!(!(1e-12..1e-4).contains(&apart), "{grid:?}");
            let scale = 2_f64.powi(draw.index(40) as i32 - 30);
            let moved = integers(&mut draw, 1000) * if draw.index(2) == 0 { 1.0 } else { 0.0 };
            let x = grid.map(|p| Point3::from((p.coords + moved) * scale));
            let found = gap(parts, &x);
            assert_eq!(found.is_some(), apart > 1e-4, "{parts:?} {x:?} {apart}");
            let Some(found) = found else {
                none += 1;
                continue;
            };
            some += 1;
            let error = found.height / scale - apart;
            assert!(
                error <= 1e-12 * largest(&x) / scale && error >= -1e-3 * apart,
                "{parts:?} {x:?}: height {} of {apart}",
                found.height / scale
            );
            assert!((found.normal.norm() - 1.0).abs() <= 1e-14);
            assert!(separates(parts, &x, &found.normal), "{parts:?} {x:?}");
            assert!(!separates(parts, &x, &-found.normal), "control");
            // Closest points: inside of both parts and as far from each other.
            let sum: f64 = found.weights.iter().sum();
            assert!(sum.abs() <= 1e-15);
            for (k, w) in found.weights.iter().enumerate() {
                let side = if k < parts.first() { 1.0 } else { -1.0 };
                assert!((-1e-15..=1.0 + 1e-15).contains(&(w * side)));
            }
            let between = difference(&x, &found.weights).norm() / scale;
            assert!((between - apart).abs() <= 1e-3 * apart, "{parts:?} {x:?}");
        }
    }
    println!("{some} pairs with a gap, {none} that touch or cross");
    assert!(some > 1000 && none > 1000);
}

/// Parts on both sides of a slab of the given width [m] that lies oblique in space, with 1 to 3
/// corners on its faces, so that all pairs of features come to be the closest ones.
fn at_slab(draw: &mut Draw, parts: Parts, width: f64, offset: &Vector3<f64>) -> Corners {
    let turn = draw.rotation();
    let size = draw.decades(-3.0, 0.0);
    let first = parts.first();
    let on = [draw.index(first), first + draw.index(4 - first)];
    std::array::from_fn(|k| {
        let is_on = on.contains(&k) || draw.index(3) > 0;
        let beyond = if is_on { 0.0 } else { draw.between(0.0, size) };
        let height = if k < first { width + beyond } else { -beyond };
        let flat = [draw.between(-size, size), draw.between(-size, size)];
        Point3::from(turn * Vector3::new(flat[0], flat[1], height) + offset)
    })
}

#[test]
fn a_narrow_slab_between_the_parts_is_found() {
    let mut draw = Draw::new(22);
    let (mut touching, mut worst) = (0, f64::INFINITY);
    for _ in 0..100 * cases(500) {
        for parts in BOTH {
            let far = draw.decades(-9.0, 3.0) * draw.index(2) as f64;
            let offset = draw.direction() * far;
            // Rounding of the construction is a few eps of the greatest coordinate.
            let size = f64::EPSILON * (far + 1.0);
            let width = size * draw.decades(3.0, 13.0);
            let x = at_slab(&mut draw, parts, width, &offset);
            let found = gap(parts, &x).unwrap_or_else(|| panic!("{parts:?} {width:e} {x:?}"));
            worst = worst.min(found.height / width);
            assert!(separates(parts, &x, &found.normal));
            assert!(found.height <= distance(parts, &x) + 64.0 * size);
            // Control: parts that come from both sides to the same plane have no gap, or have one
            // beside each other.
            let x = at_slab(&mut draw, parts, 0.0, &offset);
            match gap(parts, &x) {
                None => touching += 1,
                Some(found) => assert!(separates(parts, &x, &found.normal)),
            }
        }
    }
    println!("least height {worst:.4} of the width; {touching} controls without gap");
    assert!(worst >= 0.98 && touching > 100);
}

#[test]
fn tiny_large_and_distant_pairs() {
    let mut draw = Draw::new(23);
    for _ in 0..100 * cases(100) {
        for parts in BOTH {
            let grid = drawn(&mut draw);
            let apart = distance(parts, &grid);
            let scale = draw.decades(-9.0, 3.0);
            let turn = draw.rotation();
            let x = grid.map(|p| turn * p * scale);
            let found = gap(parts, &x);
            if apart > 1e-4 {
                let height = found.map_or(f64::NAN, |found| found.height / scale);
                assert!((height / apart - 1.0).abs() <= 1.1e-3, "{parts:?} {x:?}");
            } else if let Some(found) = found {
                // Rounding moved parts that touch apart, by no more than it can.
                assert!(found.height <= 1e-13 * scale && separates(parts, &x, &found.normal));
            }
        }
    }
}

#[test]
fn no_gap_of_numbers_that_are_not_finite_or_far_too_small() {
    let x = [[0.2, 0.2, 1.0], [0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
    for parts in BOTH {
        assert!(gap(parts, &x).is_some());
        for k in 0..12 {
            for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut x = x;
                x[k / 3][k % 3] = wrong;
                assert_eq!(gap(parts, &x), None, "{parts:?} {x:?}");
            }
        }
        // Squares of these are no numbers.
        for scale in [1e-200, 1e200] {
            let found = gap(parts, &x.map(|p| p * scale));
            assert!(found.is_none_or(|found| found.height > 0.0 && found.height <= scale * 1.01));
        }
    }
    assert!(height(Parts::VertexTriangle, &x, &Vector3::z()) > 0.0);
}
