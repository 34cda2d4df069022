//! Interpolation of directions on the surface to the inside \[kohout2017\].
//!
//! Each of the three components of the direction is harmonic in the cells. Lines prescribe the
//! direction through a resistance that is small against that of a cell. Where the direction would
//! not rise, it is turned towards the gradient of the field between the areas until it rises, so
//! that every streamline ends at the insertion.

use nalgebra::{Point3, Vector3};

use super::cells::{Cells, NONE};
use crate::fibres::polyline::length;
use crate::solvers::sparse::{Factor, FactorError};

/// Conductance of a line per cell length, relative to that between two cells.
const HELD: f64 = 10.0;
/// Conductance of the field's gradient in every cell: small, so that the gradient only matters in
/// components without a line.
const LOOSE: f64 = 1e-6;
/// Spacing of the sample points of a line, in sides of a cell.
const APART: f64 = 0.25;
/// Least cosine between direction and gradient.
const RISE: f64 = 0.25;

/// Prescribed directions of the lines.
#[derive(Clone, Debug, Default)]
struct Held {
    /// Weight of each cell.
    weights: Vec<f64>,
    /// Sum of weighted unit vectors along the lines in each cell, from origin to insertion.
    sums: Vec<Vector3<f64>>,
}

/// Points of a line at most [`APART`] from each other, each with its vector along the line [m].
fn places(line: &[Point3<f64>], apart: f64) -> Vec<(Point3<f64>, Vector3<f64>)> {
    let mut all = Vec::new();
    for s in line.windows(2) {
        let along = s[1] - s[0];
        let n = (along.norm() / apart).ceil().clamp(1.0, 1e6);
        all.extend((0..n as u32).map(|k| (s[0] + along * ((f64::from(k) + 0.5) / n), along / n)));
    }
    all
}

/// The cell in or next to the cube of a point: the one with the greatest share inside, then the
/// nearest to the point.
fn cell_of(cells: &Cells, p: &Point3<f64>, usable: impl Fn(u32) -> bool) -> Option<u32> {
    let index = cells.holding(p);
    let [nx, ny, _] = cells.dims;
    let place = [index % nx, index / nx % ny, index / nx / ny];
    let range = |k: usize| place[k].saturating_sub(1)..(place[k] + 2).min(cells.dims[k]);
    let mut best: Option<(f64, u32)> = None;
    for k in range(2) {
        for j in range(1) {
            for i in range(0) {
                let c = cells.at[cells.index([i, j, k])];
                let inner = if c == NONE || !usable(c) {
                    None
                } else {
                    cells.inner[c as usize]
                };
                let Some(inner) = inner else { continue };
                let square = (inner - p).norm_squared();
                if best.is_none_or(|(d, _)| square < d) {
                    best = Some((square, c));
                }
            }
        }
    }
    best.map(|(_, c)| c)
}

impl Held {
    fn new(
        cells: &Cells,
        name: &[u32],
        gradients: &[Vector3<f64>],
        lines: &[Vec<Point3<f64>>],
    ) -> Self {
        let mut this = Self {
            weights: vec![0.0; cells.count()],
            sums: vec![Vector3::zeros(); cells.count()],
        };
        for line in lines.iter().filter(|line| length(line) > 0.0) {
            let places = places(line, APART * cells.side);
            let in_cell = |(p, along): (Point3<f64>, Vector3<f64>)| {
                Some((
                    cell_of(cells, &p, |c| name[c as usize] != NONE)?,
                    along / cells.side,
                ))
            };
            let held: Vec<(u32, Vector3<f64>)> = places.into_iter().filter_map(in_cell).collect();
            // The field along the whole line decides which end is which.
            let rise: f64 = held
                .iter()
                .map(|(c, along)| along.dot(&gradients[*c as usize]))
                .sum();
            let sign = if rise < 0.0 { -1.0 } else { 1.0 };
            for (c, along) in held {
                this.weights[c as usize] += HELD * along.norm();
                this.sums[c as usize] += along * (sign * HELD);
            }
        }
        this
    }
}

/// Directions in the cells with a `name` (their index in the system) as unit vectors, from the
/// directions of `lines` [m]. `links` are pairs of names with their conductance; `gradients` are
/// those of the field between the areas.
///
/// # Errors
/// Too little memory.
pub fn extend_directions(
    cells: &Cells,
    name: &[u32],
    links: &[([u32; 2], f64)],
    gradients: &[Vector3<f64>],
    lines: &[Vec<Point3<f64>>],
) -> Result<Vec<Vector3<f64>>, FactorError> {
    let held = Held::new(cells, name, gradients, lines);
    let count = name.iter().filter(|n| **n != NONE).count();
    let pairs: Vec<[u32; 2]> = links.iter().map(|(pair, _)| *pair).collect();
    let mut factor = Factor::<1>::new(count, &pairs)?;
    for &([i, j], conductance) in links {
        factor.add(i.max(j), i.min(j), &[[-conductance]]);
        factor.add_diagonal(i, conductance);
        factor.add_diagonal(j, conductance);
    }
    let mut right = vec![0.0; 3 * count];
    let up = |c: usize| {
        gradients[c]
            .try_normalize(0.0)
            .unwrap_or_else(Vector3::zeros)
    };
    for (c, &n) in name.iter().enumerate().filter(|(_, n)| **n != NONE) {
        factor.add_diagonal(n, held.weights[c] + LOOSE);
        let sum = held.sums[c] + up(c) * LOOSE;
        (0..3).for_each(|k| right[k * count + n as usize] = sum[k]);
    }
    factor.factorise()?;
    factor.solve(&mut right, 3);
    let direction = |(c, n): (usize, &u32)| match *n {
        NONE => Vector3::zeros(),
        n => rising(
            &Vector3::from_fn(|k, _| right[k * count + n as usize]),
            &up(c),
        ),
    };
    Ok(name.iter().enumerate().map(direction).collect())
}

/// The unit vector along `direction`, turned towards the unit vector `up` if it rises too little.
fn rising(direction: &Vector3<f64>, up: &Vector3<f64>) -> Vector3<f64> {
    let Some(unit) = direction.try_normalize(0.0) else {
        return *up;
    };
    let rise = unit.dot(up);
    if rise >= RISE || up.norm_squared() == 0.0 {
        return unit;
    }
    let across = (unit - up * rise).try_normalize(0.0);
    across.map_or(*up, |across| {
        across * (1.0 - RISE * RISE).sqrt() + up * RISE
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_leads_back_is_turned_and_nothing_else() {
        let up = Vector3::z();
        for (x, z) in [(0.0, 1.0), (1.0, 1.0), (1.0, 0.3)] {
            let direction = Vector3::new(x, 0.0, z);
            assert!(
                (rising(&(direction * 7.0), &up) - direction.normalize()).norm()
                    <= 4.0 * f64::EPSILON
            );
        }
        for (x, z) in [(1.0, 0.2), (1.0, 0.0), (1.0, -5.0), (0.0, -1.0), (0.0, 0.0)] {
            let turned = rising(&Vector3::new(x, 0.0, z), &up);
            assert!(
                turned.z >= RISE - f64::EPSILON
                    && (turned.norm() - 1.0).abs() <= 4.0 * f64::EPSILON,
                "{turned}"
            );
        }
        // Without a field no direction rises.
        assert_eq!(
            rising(&Vector3::new(0.0, -2.0, 0.0), &Vector3::zeros()),
            -Vector3::y()
        );
    }

    #[test]
    fn places_of_a_line_add_up_to_it() {
        let line = [
            Point3::origin(),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(1.0, 0.05, 0.0),
        ];
        let found = places(&line, 0.1);
        let sum: Vector3<f64> = found.iter().map(|(_, along)| along).sum();
        assert!(
            (sum - Vector3::new(1.0, 0.05, 0.0)).norm() <= 1e-14,
            "{sum}"
        );
        assert_eq!(found.len(), 11);
    }
}
