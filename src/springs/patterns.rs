//! Springs of a lattice, and springs at rest.

use nalgebra::Point3;

use super::hooke::Hooke;
use super::lattice::LatticeShape;
use super::neighbours::Neighbours;

/// The two ends of each spring of a lattice, the lower one first, in the order of the points.
pub fn lattice(
    shape: &LatticeShape,
    neighbours: Neighbours,
) -> impl Iterator<Item = [u32; 2]> + use<> {
    let points = shape.points;
    (0..)
        .zip(shape.each())
        .flat_map(move |(p, at): (i64, [usize; 3])| {
            neighbours.half().iter().filter_map(move |step| {
                let to = [0, 1, 2].map(|c| at[c] as i64 + i64::from(step[c]));
                let inside = (0..3).all(|c| (0..points[c] as i64).contains(&to[c]));
                let q = to[0] + points[0] as i64 * (to[1] + points[1] as i64 * to[2]);
                inside.then_some([p.min(q) as u32, p.max(q) as u32])
            })
        })
}

/// Springs of `stiffness` [N/m] along `pairs` that are at rest at `x`.
pub fn at_rest<'a>(
    x: &'a [Point3<f64>],
    pairs: impl IntoIterator<Item = [u32; 2]> + 'a,
    stiffness: impl Fn(f64) -> f64 + 'a,
) -> impl Iterator<Item = ([u32; 2], Hooke)> + 'a {
    pairs.into_iter().map(move |[a, b]| {
        let rest = (x[a as usize] - x[b as usize]).norm();
        (
            [a, b],
            Hooke {
                rest,
                stiffness: stiffness(rest),
            },
        )
    })
}
