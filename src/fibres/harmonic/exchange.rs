//! Fibres that cover little that no other covers give way to fibres through what none covers.

use nalgebra::Point3;

use super::cells::{Cells, NONE};
use super::field::Field;
use super::trace::{Tracer, Way};
use crate::fibres::polyline::length;

/// Below this uncovered share of the volume nothing is exchanged.
const ENOUGH: f64 = 0.005;
/// Cells around an uncovered one that are looked at, to begin where most is to be gained.
const AROUND: usize = 2;

struct Cover<'a> {
    field: &'a Field,
    /// How many fibres cover each cell.
    counts: Vec<u32>,
    /// How many bare cells are at most [`AROUND`] away from each, itself among them.
    bare: Vec<u32>,
    /// Cells covered by each fibre.
    of: Vec<Vec<u32>>,
    /// The last look for cells of a fibre that found each.
    found: Vec<u32>,
    looks: u32,
    radius: f64,
}

/// Tries for each fibre.
const TRIES: usize = 2;

/// Exchanges fibres while that covers more of the volume, in at most `more` times [`TRIES`] tries a fibre; the share of the
/// volume that stays bare.
pub fn exchange(tracer: &Tracer<'_>, ways: &mut [[Way; 2]], volume: f64, more: usize) -> f64 {
    let field = tracer.field;
    let total: f64 = ways.iter().flatten().map(|w| length(&w.points)).sum();
    let mut cover = Cover::new(field, (volume / total).sqrt());
    for way in ways.iter() {
        let cells = cover.cells_of(way);
        cover.add(&cells);
        cover.of.push(cells);
    }
    let usable = |c: &u32| field.cells.inner[*c as usize].is_some() && !field.values[*c as usize].is_nan();
    let cells: Vec<u32> = (0..field.cells.count() as u32).filter(usable).collect();
    let whole: f64 = cells.iter().map(|&c| field.cells.shares[c as usize]).sum();
    let mut tried = vec![false; field.cells.count()];
    for _ in 0..TRIES * more * ways.len() {
        let bare: Vec<u32> = cells.iter().copied().filter(|&c| cover.counts[c as usize] == 0).collect();
        if cover.sum(bare.iter()) <= ENOUGH * whole {
            break;
        }
        let seed = bare.iter().filter(|c| !tried[**c as usize]).max_by_key(|c| (cover.bare[**c as usize], !**c));
        let Some(&seed) = seed else { break };
        tried[seed as usize] = true;
        let Some(point) = field.cells.inner[seed as usize] else { continue };
        if let Some(way) = super::through(tracer, &point, false) {
            cover.offer(way, ways);
        }
    }
    cover.sum(cells.iter().filter(|c| cover.counts[**c as usize] == 0)) / whole
}

impl<'a> Cover<'a> {
    fn new(field: &'a Field, radius: f64) -> Self {
        let count = field.cells.count();
        let (counts, found) = (vec![0; count], vec![0; count]);
        let mut this = Self { field, counts, bare: vec![0; count], of: Vec::new(), found, looks: 0, radius };
        (0..count as u32).for_each(|c| this.around(c, |bare| *bare += 1));
        this
    }

    /// Changes the numbers of bare cells around a cell.
    fn around(&mut self, cell: u32, change: impl Fn(&mut u32)) {
        let cells = &self.field.cells;
        let index = cells.index(cells.places[cell as usize].map(|k| k as usize));
        visit(cells, index, AROUND, |c| change(&mut self.bare[c as usize]));
    }

    fn add(&mut self, cells: &[u32]) {
        for &c in cells {
            self.counts[c as usize] += 1;
            if self.counts[c as usize] == 1 {
                self.around(c, |bare| *bare -= 1);
            }
        }
    }

    fn remove(&mut self, cells: &[u32]) {
        for &c in cells {
            self.counts[c as usize] -= 1;
            if self.counts[c as usize] == 0 {
                self.around(c, |bare| *bare += 1);
            }
        }
    }

    fn sum<'c>(&self, cells: impl Iterator<Item = &'c u32>) -> f64 {
        cells.map(|&c| self.field.cells.shares[c as usize]).sum()
    }

    /// Takes a fibre in for the one that then covers least alone, if that is a gain.
    fn offer(&mut self, way: [Way; 2], ways: &mut [[Way; 2]]) {
        let new = self.cells_of(&way);
        let gain = self.sum(new.iter().filter(|c| self.counts[**c as usize] == 0));
        self.add(&new);
        let alone = |of: &Vec<u32>| self.sum(of.iter().filter(|c| self.counts[**c as usize] == 1));
        let losses: Vec<f64> = self.of.iter().map(alone).collect();
        let least = (0..losses.len()).min_by(|&a, &b| losses[a].total_cmp(&losses[b]));
        match least {
            Some(least) if losses[least] < gain => {
                let old = std::mem::replace(&mut self.of[least], new);
                self.remove(&old);
                ways[least] = way;
            }
            _ => self.remove(&new),
        }
    }

    fn cells_of(&mut self, way: &[Way; 2]) -> Vec<u32> {
        let cells = &self.field.cells;
        let reach = (self.radius / cells.side).ceil() as usize;
        self.looks += 1;
        let (seen, look, radius) = (&mut self.found, self.looks, self.radius);
        let mut found = Vec::new();
        for p in way.iter().flat_map(|w| &w.points) {
            visit(cells, cells.holding(p), reach, |c| {
                let near = |at: Point3<f64>| (at - p).norm() <= radius;
                if seen[c as usize] != look && cells.inner[c as usize].is_some_and(near) {
                    seen[c as usize] = look;
                    found.push(c);
                }
            });
        }
        found.sort_unstable();
        found
    }
}

/// All cells at most `reach` places from one of the box, along each axis.
fn visit(cells: &Cells, index: usize, reach: usize, mut deed: impl FnMut(u32)) {
    let [nx, ny, _] = cells.dims;
    let place = [index % nx, index / nx % ny, index / nx / ny];
    let range = |k: usize| place[k].saturating_sub(reach)..(place[k] + reach + 1).min(cells.dims[k]);
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
