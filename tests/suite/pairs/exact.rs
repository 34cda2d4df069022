//! Signs of sums of products without rounding, by expansions: sums of numbers that do not overlap.

use nalgebra::{Point3, Vector3};
use pliant::contact::Parts;

use super::Corners;

/// The rounded sum, and what rounding took from it.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let part = sum - a;
    (sum, (a - (sum - part)) + (b - part))
}

/// The sign of a sum of products, exact as long as nothing under- or overflows.
pub fn sign(products: impl IntoIterator<Item = (f64, f64)>) -> f64 {
    // Parts in order of growing size.
    let mut parts: Vec<f64> = Vec::new();
    for (a, b) in products {
        let product = a * b;
        for term in [a.mul_add(b, -product), product] {
            let mut carried = term;
            for part in &mut parts {
                (carried, *part) = two_sum(carried, *part);
            }
            parts.push(carried);
        }
    }
    let last = parts.iter().rev().find(|part| **part != 0.0);
    last.map_or(0.0, |part| part.signum())
}

/// True if all corners of the first part are higher along `normal` than all of the second one, in
/// real numbers.
pub fn separates(parts: Parts, x: &Corners, normal: &Vector3<f64>) -> bool {
    let higher = |p: &Point3<f64>, q: &Point3<f64>| {
        sign((0..3).flat_map(|k| [(normal[k], p[k]), (-normal[k], q[k])])) > 0.0
    };
    let (first, second) = x.split_at(parts.first());
    first.iter().all(|p| second.iter().all(|q| higher(p, q)))
}

#[test]
fn signs_are_exact() {
    assert_eq!(sign([(1e16, 1.0), (1.0, 1.0), (-1e16, 1.0)]), 1.0);
    assert_eq!(
        sign([(0.1, 10.0), (-1.0, 1.0)]),
        1.0,
        "0.1 is a little more"
    );
    assert_eq!(sign([(3.0, 7.0), (-21.0, 1.0)]), 0.0);
    assert_eq!(sign([(1.0, 1e-200), (1e100, 1.0), (-1e100, 1.0)]), 1.0);
    // Against integers of 128 bits: sums that nearly vanish.
    let mut draw = pliant::testing::Draw::new(5);
    for _ in 0..2000 {
        let mut whole: Vec<(i128, i128)> = (0..6)
            .map(|_| (draw.bits() as i64 >> 11, draw.bits() as i64 >> 11))
            .map(|(a, b)| (i128::from(a), i128::from(b)))
            .collect();
        let (a, b) = whole[draw.index(6)];
        whole.extend([(-a, b - 1), (draw.index(9) as i128 - 4, 1)]);
        let sum: i128 = whole.iter().map(|(a, b)| a * b).sum();
        let found = sign(whole.iter().map(|(a, b)| (*a as f64, *b as f64)));
        assert_eq!(found, sum.signum() as f64);
    }
}
