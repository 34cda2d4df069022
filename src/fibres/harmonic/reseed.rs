//! Exchange of redundant fibres for fibres through uncovered parts of the muscle.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::cells::{Cells, NONE};
use super::field::Field;
use super::trace::{HalfStreamline, Tracer};
use super::{DecompositionError, Order, through, whole};
use crate::fibres::polyline::length;
use crate::progress::Progress;

/// The exchange ends below this uncovered share of the volume.
const ENOUGH: f64 = 0.0075;
/// Range of cells around an uncovered cell that decides where the gain is greatest.
const AROUND: usize = 2;
/// Number of tries per fibre.
const TRIES: usize = 2;
/// Number of streamlines that are traced at once; constant, so that the result does not depend on
/// the number of threads.
const BATCH: usize = 8;
/// The exchange ends after this number of batches in a row without a gain.
const MAX_WITHOUT_GAIN: usize = 3;
/// The octants that represent a cell: those at the corners of a tetrahedron.
const SAMPLED: u8 = 0b0110_1001;

/// Exchanges fibres of `points` points for others of an `order` while this increases the covered volume,
/// unless the uncovered share exceeds `max_uncovered`. Returns the uncovered share that remains.
///
/// # Errors
/// The caller stopped the exchange.
pub fn reseed(
    tracer: &Tracer<'_>,
    streamlines: &mut [[HalfStreamline; 2]],
    points: usize,
    volume: f64,
    (max_uncovered, order): (f64, Order),
    progress: &dyn Progress,
) -> Result<f64, DecompositionError> {
    let cells = &tracer.field.cells;
    let lines: Vec<Vec<Point3<f64>>> = streamlines
        .iter()
        .map(|streamline| whole(streamline, points))
        .collect();
    let total: f64 = lines.iter().map(|line| length(line)).sum();
    let radius = (volume / total).sqrt();
    let mut cover = Cover::new(tracer.field, streamlines.len());
    let all: Vec<Near> = lines
        .par_iter()
        .map(|line| near(cells, line, radius))
        .collect();
    all.into_iter()
        .enumerate()
        .for_each(|(fibre, near)| cover.put(fibre as u32, near));
    if cover.uncovered_share() > max_uncovered {
        return Ok(cover.uncovered_share());
    }
    let mut tried = vec![false; cells.count()];
    let (mut tries, mut without_gain) = (0, 0);
    while tries < TRIES * streamlines.len()
        && without_gain < MAX_WITHOUT_GAIN
        && cover.uncovered_share() > ENOUGH
    {
        let heard = progress.report("others tried", tries, TRIES * streamlines.len());
        if heard.is_break() {
            return Err(DecompositionError::Stopped);
        }
        let seeds = cover.least_covered(&mut tried);
        if seeds.is_empty() {
            break;
        }
        tries += seeds.len();
        let follow = |&cell: &u32| {
            let streamline = through(tracer, &cells.inner[cell as usize]?, order).ok()?;
            let near = near(cells, &whole(&streamline, points), radius);
            Some((streamline, near))
        };
        let found: Vec<Option<([HalfStreamline; 2], Near)>> =
            seeds.par_iter().map(follow).collect();
        without_gain += 1;
        for (streamline, near) in found.into_iter().flatten() {
            if let Some(fibre) = cover.offer(near) {
                streamlines[fibre as usize] = streamline;
                without_gain = 0;
            }
        }
    }
    Ok(cover.uncovered_share())
}

/// Parts of cells that a line covers: a cell, and one bit for each octant.
type Near = Vec<(u32, u8)>;

/// The octants whose centres are inside and within `radius` [m] of a line.
fn near(cells: &Cells, line: &[Point3<f64>], radius: f64) -> Near {
    let mut seen = vec![0u8; cells.count()];
    let mut found = Vec::new();
    let side = cells.side;
    // From the centre of a cell to that of an octant.
    let reach = 0.25 * 3f64.sqrt() * side;
    let [all, none] = [(radius - reach).max(0.0).powi(2), (radius + reach).powi(2)];
    for s in line.windows(2) {
        let pieces = ((s[1] - s[0]).norm() / side).ceil().max(1.0);
        for n in 0..pieces as usize {
            let [a, b] = [n as f64, n as f64 + 1.0].map(|n| s[0] + (s[1] - s[0]) * (n / pieces));
            let (along, length) = (b - a, (b - a).norm_squared());
            let square = |p: &Point3<f64>| {
                let to = p - a;
                let t = if length > 0.0 {
                    (to.dot(&along) / length).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                (to - along * t).norm_squared()
            };
            around(cells, &a, &b, radius + 0.25 * side, |c, place| {
                let left = cells.octants[c as usize] & SAMPLED & !seen[c as usize];
                if left == 0 {
                    return;
                }
                let middle = cells.middle(place);
                let far = square(&middle);
                if far > none {
                    return;
                }
                let mut bits = left;
                if far > all {
                    let is_near =
                        |bit: &usize| square(&cells.octant(&middle, *bit)) <= radius * radius;
                    bits = (0..8)
                        .filter(|bit| left >> bit & 1 == 1)
                        .filter(is_near)
                        .fold(0, |bits, bit| bits | 1 << bit);
                }
                if bits != 0 && seen[c as usize] == 0 {
                    found.push(c);
                }
                seen[c as usize] |= bits;
            });
        }
    }
    found.into_iter().map(|c| (c, seen[c as usize])).collect()
}

/// All cells whose centres can be within `radius` [m] of a segment along each axis.
fn around(
    cells: &Cells,
    a: &Point3<f64>,
    b: &Point3<f64>,
    radius: f64,
    mut deed: impl FnMut(u32, [usize; 3]),
) {
    let by = Vector3::repeat(radius - 0.5 * cells.side);
    let [low, high] = [a.inf(b) - by, a.sup(b) + by].map(|p| cells.place(&p));
    for k in low[2]..=high[2] {
        for j in low[1]..=high[1] {
            let row = cells.index([0, j, k]);
            for i in low[0]..=high[0] {
                let c = cells.at[row + i];
                if c != NONE {
                    deed(c, [i, j, k]);
                }
            }
        }
    }
}

/// The octants of cells that each fibre covers.
struct Cover<'a> {
    cells: &'a Cells,
    /// Number of fibres that cover each octant, and the sum of their indices: for a single fibre,
    /// its index.
    counts: Vec<[u32; 8]>,
    sums: Vec<[u32; 8]>,
    /// Octants that each fibre covers.
    of: Vec<Near>,
    /// Number of octants that each fibre alone covers.
    alone: Vec<usize>,
    /// Number of uncovered octants of each cell.
    bare: Vec<u32>,
    /// Number of uncovered octants, and of all octants.
    bare_count: usize,
    count: usize,
}

impl<'a> Cover<'a> {
    fn new(field: &'a Field, fibres: usize) -> Self {
        let cells = &field.cells;
        let octants = |c: usize| {
            if field.values[c].is_nan() {
                0
            } else {
                (cells.octants[c] & SAMPLED).count_ones()
            }
        };
        let bare: Vec<u32> = (0..cells.count()).map(octants).collect();
        let count = bare.iter().map(|n| *n as usize).sum();
        let (counts, sums) = (vec![[0; 8]; cells.count()], vec![[0; 8]; cells.count()]);
        Self {
            cells,
            counts,
            sums,
            of: vec![Near::new(); fibres],
            alone: vec![0; fibres],
            bare,
            bare_count: count,
            count,
        }
    }

    fn uncovered_share(&self) -> f64 {
        self.bare_count as f64 / self.count.max(1) as f64
    }

    /// Replaces the fibre with that index.
    fn put(&mut self, fibre: u32, near: Near) {
        for (c, n) in octants(&std::mem::take(&mut self.of[fibre as usize])) {
            self.counts[c][n] -= 1;
            self.sums[c][n] -= fibre;
            match self.counts[c][n] {
                0 => {
                    self.bare[c] += 1;
                    self.bare_count += 1;
                }
                1 => self.alone[self.sums[c][n] as usize] += 1,
                _ => (),
            }
        }
        self.alone[fibre as usize] = 0;
        for (c, n) in octants(&near) {
            self.counts[c][n] += 1;
            match self.counts[c][n] {
                1 => {
                    self.bare[c] -= 1;
                    self.bare_count -= 1;
                    self.alone[fibre as usize] += 1;
                }
                2 => self.alone[self.sums[c][n] as usize] -= 1,
                _ => (),
            }
            self.sums[c][n] += fibre;
        }
        self.of[fibre as usize] = near;
    }

    /// Replaces the fibre with the fewest exclusive octants, if this is a gain. Returns its index.
    fn offer(&mut self, near: Near) -> Option<u32> {
        let mut gain = 0;
        let mut alone = self.alone.clone();
        for (c, n) in octants(&near) {
            match self.counts[c][n] {
                0 => gain += 1,
                1 => alone[self.sums[c][n] as usize] -= 1,
                _ => (),
            }
        }
        let least = (0..alone.len()).min_by_key(|&fibre| alone[fibre])?;
        if alone[least] >= gain {
            return None;
        }
        self.put(least as u32, near);
        Some(least as u32)
    }

    /// Cells with the most uncovered volume around them, no two near each other; marks them as
    /// tried.
    fn least_covered(&self, tried: &mut [bool]) -> Vec<u32> {
        let cells = self.cells;
        let bare: Vec<u32> = (0..cells.count() as u32)
            .filter(|c| self.bare[*c as usize] > 0)
            .collect();
        let mut uncovered_around = vec![0u32; cells.count()];
        for &c in &bare {
            visit(cells, c, |other| {
                uncovered_around[other as usize] += self.bare[c as usize]
            });
        }
        let open = |c: &u32| !tried[*c as usize] && cells.inner[*c as usize].is_some();
        let mut open: Vec<u32> = bare.into_iter().filter(open).collect();
        let mut chosen = Vec::new();
        while chosen.len() < BATCH
            && let Some(&seed) = open
                .iter()
                .max_by_key(|c| (uncovered_around[**c as usize], std::cmp::Reverse(**c)))
        {
            tried[seed as usize] = true;
            chosen.push(seed);
            let place = cells.places[seed as usize];
            open.retain(|c| {
                (0..3).any(|k| cells.places[*c as usize][k].abs_diff(place[k]) as usize > AROUND)
            });
        }
        chosen
    }
}

/// Each octant: its cell, and its index in the cell.
fn octants(near: &Near) -> impl Iterator<Item = (usize, usize)> + '_ {
    near.iter().flat_map(|&(c, bits)| {
        (0..8)
            .filter(move |n| bits >> n & 1 == 1)
            .map(move |n| (c as usize, n))
    })
}

/// All cells within [`AROUND`] places of a cell along each axis.
fn visit(cells: &Cells, cell: u32, mut deed: impl FnMut(u32)) {
    let place = cells.places[cell as usize].map(|k| k as usize);
    let range =
        |k: usize| place[k].saturating_sub(AROUND)..(place[k] + AROUND + 1).min(cells.dims[k]);
    for k in range(2) {
        for j in range(1) {
            for i in range(0) {
                let c = cells.at[cells.index([i, j, k])];
                if c != NONE {
                    deed(c);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fibres::harmonic::seeds::tests::field;
    use crate::testing::Draw;

    /// Lines of three points in a box around a tube.
    fn lines(draw: &mut Draw, count: usize) -> Vec<Vec<Point3<f64>>> {
        let mut point = || {
            Point3::new(
                draw.between(-0.12, 0.12),
                draw.between(-0.025, 0.025),
                draw.between(-0.025, 0.025),
            )
        };
        (0..count)
            .map(|_| vec![point(), point(), point()])
            .collect()
    }

    #[test]
    fn near_a_line_is_what_a_search_of_all_finds() {
        let field = field();
        let cells = &field.cells;
        let mut most = 0;
        for (n, line) in lines(&mut Draw::new(3), 40).iter().enumerate() {
            let radius = cells.side * (0.2 + 0.1 * n as f64);
            let to = |p: &Point3<f64>| {
                let part = |s: &[Point3<f64>]| {
                    let along = s[1] - s[0];
                    let t = ((p - s[0]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
                    (p - s[0] - along * t).norm()
                };
                line.windows(2).map(part).fold(f64::INFINITY, f64::min)
            };
            let bits = |c: usize| {
                let middle = cells.middle(cells.places[c].map(|k| k as usize));
                let is_near = |n: &usize| to(&cells.octant(&middle, *n)) <= radius;
                (0..8)
                    .filter(|n| cells.octants[c] & SAMPLED & 1 << n != 0)
                    .filter(is_near)
                    .fold(0, |b, n| b | 1 << n)
            };
            let expected: Near = (0..cells.count())
                .map(|c| (c as u32, bits(c)))
                .filter(|(_, b)| *b != 0)
                .collect();
            let mut found = near(cells, line, radius);
            found.sort_unstable();
            assert_eq!(found, expected, "radius {radius}");
            most = most.max(expected.len());
        }
        assert!(most > 100, "{most}");
    }

    #[test]
    fn counts_are_those_of_what_is_there() {
        let field = field();
        let cells = &field.cells;
        let mut cover = Cover::new(&field, 6);
        let (mut taken, mut refused) = (0, 0);
        for (n, line) in lines(&mut Draw::new(4), 60).iter().enumerate() {
            let near = near(cells, line, 1.5 * cells.side);
            let before = cover.bare_count;
            if n < 6 {
                cover.put(n as u32, near);
            } else if cover.offer(near).is_some() {
                taken += 1;
                assert!(cover.bare_count < before, "a gain");
            } else {
                refused += 1;
                assert_eq!(cover.bare_count, before);
            }
            let times = |c: usize, n: usize| {
                cover
                    .of
                    .iter()
                    .flat_map(octants)
                    .filter(|at| *at == (c, n))
                    .count()
            };
            for c in (0..cells.count()).step_by(17) {
                let octants: Vec<usize> = (0..8)
                    .filter(|n| cells.octants[c] & SAMPLED & 1 << n != 0)
                    .collect();
                assert!(
                    octants
                        .iter()
                        .all(|&n| cover.counts[c][n] as usize == times(c, n))
                );
                assert_eq!(
                    cover.bare[c] as usize,
                    octants.iter().filter(|n| times(c, **n) == 0).count()
                );
            }
            assert_eq!(cover.bare.iter().sum::<u32>() as usize, cover.bare_count);
            let covered_once: usize = cover.counts.iter().flatten().filter(|n| **n == 1).count();
            assert_eq!(cover.alone.iter().sum::<usize>(), covered_once);
        }
        assert!(taken > 3 && refused > 3, "{taken} {refused}");
    }
}
