//! Cubes that cover the inside of a muscle, and how wide the way from each to the next is.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::super::attachment::over_triangle;
use super::super::solid::Solid;
use crate::mesh::TriangleMesh;

/// No cell.
pub const NONE: u32 = u32::MAX;
/// Share of a cell, or of a face between cells, that counts as open where the surface passes but no sample is inside:
/// a thin sheet stays joined, and hardly any flux leaves the muscle.
const LEAST: f64 = 0.02;

/// Cubes that the muscle meets.
#[derive(Clone, Debug)]
pub struct Cells {
    /// Lower corner of the box [m].
    pub low: Point3<f64>,
    /// Side of a cube [m].
    pub side: f64,
    /// Cubes of the box along each axis.
    pub dims: [usize; 3],
    /// Number of the cell at each place of the box, x first; [`NONE`] for a cube that the muscle does not meet.
    pub at: Vec<u32>,
    /// Place of each cell.
    pub places: Vec<[u32; 3]>,
    /// Share of each cell inside the muscle.
    pub shares: Vec<f64>,
    /// A point inside the muscle, near the middle of what is inside of the cell [m].
    pub inner: Vec<Option<Point3<f64>>>,
    /// Whether the surface passes through a cube or one beside it, for each place of the box.
    pub by_wall: Vec<bool>,
    /// Share of the face towards the next cell along x, y, z that is open; 0 where there is none.
    pub open: Vec<[f64; 3]>,
}

impl Cells {
    /// Covers the inside by cubes of `side` [m].
    pub fn new(solid: &Solid<'_>, side: f64) -> Self {
        let bounds = solid.mesh().bounding_box();
        // A cube of air on each side, so that every cell has a neighbour in the box.
        let low = bounds.min - Vector3::repeat(side * 1.001);
        let dims: [usize; 3] = std::array::from_fn(|k| ((bounds.max[k] - low[k]) / side) as usize + 2);
        let count = dims.iter().product();
        let mut this = Self {
            low,
            side,
            dims,
            at: vec![NONE; count],
            places: Vec::new(),
            shares: Vec::new(),
            inner: Vec::new(),
            by_wall: Vec::new(),
            open: Vec::new(),
        };
        let touched = this.touched(solid.mesh());
        let octants = this.classify(solid, &touched);
        this.list(&touched, &octants);
        this.join(&touched, &octants);
        this.by_wall = this.around(&touched, 1);
        this
    }

    /// Marks all places at most `reach` from one that is marked, along each axis.
    pub fn around(&self, marked: &[bool], reach: usize) -> Vec<bool> {
        let mut all = marked.to_vec();
        for axis in 0..3 {
            let step = self.step(axis);
            for _ in 0..reach {
                let before = all.clone();
                for (index, _) in before.iter().enumerate().filter(|(_, m)| **m) {
                    // Off the ends of a row this marks places of the next one: a few too many, never too few.
                    all[index.saturating_sub(step)] = true;
                    all[(index + step).min(before.len() - 1)] = true;
                }
            }
        }
        all
    }

    /// Index in the box of a place.
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.dims[1] + j) * self.dims[0] + i
    }

    fn step(&self, axis: usize) -> usize {
        [1, self.dims[0], self.dims[0] * self.dims[1]][axis]
    }

    /// Index in the box of the cube that holds a point; points off the box go to its border.
    pub fn holding(&self, p: &Point3<f64>) -> usize {
        let place = |k: usize| (((p[k] - self.low[k]) / self.side) as usize).min(self.dims[k] - 1);
        self.index([place(0), place(1), place(2)])
    }

    /// The middle of a cube [m].
    pub fn middle(&self, place: [usize; 3]) -> Point3<f64> {
        self.low + Vector3::from(place.map(|k| (k as f64 + 0.5) * self.side))
    }

    /// Cubes that hold a part of the surface; sampled, so that a cube that a corner only grazes may be missed.
    fn touched(&self, mesh: &TriangleMesh) -> Vec<bool> {
        let mut touched = vec![false; self.at.len()];
        for t in 0..mesh.triangles.len() {
            let corners = mesh.corners(t);
            corners.iter().for_each(|p| touched[self.holding(p)] = true);
            over_triangle(&corners, 0.5 * self.side).iter().for_each(|p| touched[self.holding(p)] = true);
        }
        touched
    }

    /// One bit for each eighth of a cube whose middle is inside.
    fn classify(&self, solid: &Solid<'_>, touched: &[bool]) -> Vec<u8> {
        let mut octants = vec![0u8; self.at.len()];
        octants.par_chunks_mut(self.dims[0]).enumerate().for_each(|(row, octants)| {
            let (j, k) = (row % self.dims[1], row / self.dims[1]);
            // Between two cubes that the surface does not meet nothing changes; the first is air.
            let mut known = Some(false);
            for (i, octants) in octants.iter_mut().enumerate() {
                if touched[row * self.dims[0] + i] {
                    *octants = self.octants_of(solid, [i, j, k]);
                    known = None;
                    continue;
                }
                let inside = known.unwrap_or_else(|| solid.contains(&self.middle([i, j, k])));
                *octants = if inside { 0xff } else { 0 };
                known = Some(inside);
            }
        });
        octants
    }

    fn octants_of(&self, solid: &Solid<'_>, place: [usize; 3]) -> u8 {
        let middle = self.middle(place);
        let inside = |bit: &usize| solid.contains(&self.eighth(&middle, *bit));
        (0..8).filter(inside).fold(0, |bits, bit| bits | 1 << bit)
    }

    fn eighth(&self, middle: &Point3<f64>, bit: usize) -> Point3<f64> {
        let quarter = |axis: usize| if bit >> axis & 1 == 1 { 0.25 } else { -0.25 } * self.side;
        middle + Vector3::new(quarter(0), quarter(1), quarter(2))
    }

    fn list(&mut self, touched: &[bool], octants: &[u8]) {
        for k in 0..self.dims[2] {
            for j in 0..self.dims[1] {
                for i in 0..self.dims[0] {
                    let index = self.index([i, j, k]);
                    let bits = octants[index];
                    if bits == 0 && !touched[index] {
                        continue;
                    }
                    self.at[index] = self.places.len() as u32;
                    self.places.push([i as u32, j as u32, k as u32]);
                    self.shares.push((f64::from(bits.count_ones()) / 8.0).max(LEAST));
                    self.inner.push(self.inner_point([i, j, k], bits));
                }
            }
        }
    }

    /// Of the sampled points inside the one nearest to their mean; the middle of a full cube.
    fn inner_point(&self, place: [usize; 3], bits: u8) -> Option<Point3<f64>> {
        let middle = self.middle(place);
        if bits == 0xff {
            return Some(middle);
        }
        let inside: Vec<Point3<f64>> =
            (0..8).filter(|bit| bits >> bit & 1 == 1).map(|bit| self.eighth(&middle, bit)).collect();
        let mean = inside.iter().map(|p| p.coords).sum::<Vector3<f64>>() / inside.len().max(1) as f64;
        inside.into_iter().min_by(|a, b| (a.coords - mean).norm().total_cmp(&(b.coords - mean).norm()))
    }

    fn join(&mut self, touched: &[bool], octants: &[u8]) {
        self.open = vec![[0.0; 3]; self.places.len()];
        for c in 0..self.places.len() {
            let index = self.index(self.places[c].map(|k| k as usize));
            for axis in 0..3 {
                let next = index + self.step(axis);
                if next >= self.at.len() || self.at[next] == NONE {
                    continue;
                }
                let pair = |bit: &usize| octants[index] >> (bit | 1 << axis) & 1 == 1 && octants[next] >> bit & 1 == 1;
                let pairs = (0..8).filter(|bit| bit >> axis & 1 == 0).filter(pair).count();
                let least = if touched[index] && touched[next] { LEAST } else { 0.0 };
                self.open[c][axis] = (pairs as f64 / 4.0).max(least);
            }
        }
    }

    /// Pairs of neighbours `(cell, next, axis)` with an open face.
    pub fn links(&self) -> impl Iterator<Item = (u32, u32, usize)> + '_ {
        (0..self.places.len()).flat_map(move |c| {
            let index = self.index(self.places[c].map(|k| k as usize));
            (0..3)
                .filter(move |&axis| self.open[c][axis] > 0.0)
                .map(move |axis| (c as u32, self.at[index + self.step(axis)], axis))
        })
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        self.places.len()
    }
}
