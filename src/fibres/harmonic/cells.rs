//! Cubes that cover the inside of a muscle, and the open area between neighbours.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::super::attachment::over_triangle;
use super::super::solid::{Solid, WallRow};
use crate::mesh::TriangleMesh;

/// No cell.
pub const NONE: u32 = u32::MAX;
/// Least open share of a cell or of a face between cells that the surface passes without a sample
/// inside: a thin sheet stays connected, and hardly any flux leaves the muscle.
const LEAST: f64 = 0.02;

/// Bits of a cube: all octants, the centre, and all of them.
const EIGHTHS: u16 = 0xff;
const MIDDLE: u16 = 0x100;
const WHOLE: u16 = EIGHTHS | MIDDLE;

/// Cubes that the muscle intersects.
#[derive(Clone, Debug)]
pub struct Cells {
    /// Lower corner of the box [m].
    pub low: Point3<f64>,
    /// Side of a cube [m].
    pub side: f64,
    /// Number of cubes of the box along each axis.
    pub dims: [usize; 3],
    /// Index of the cell at each place of the box, x first; [`NONE`] for a cube outside the muscle.
    pub at: Vec<u32>,
    /// Place of each cell.
    pub places: Vec<[u32; 3]>,
    /// Share of each cell's volume inside the muscle.
    pub shares: Vec<f64>,
    /// A point inside the muscle near the centre of the cell's inner part [m].
    pub inner: Vec<Option<Point3<f64>>>,
    /// One bit for each octant of a cell whose centre is inside.
    pub octants: Vec<u8>,
    /// True for each cell whose centre is inside the muscle.
    pub middle_inside: Vec<bool>,
    /// Distance of each cube's centre to a point of the surface in the cube [m]; infinite if the
    /// cube contains none.
    surface: Vec<f64>,
    /// True for each place of the box whose cube, or a neighbour of it, contains a part of the
    /// surface.
    by_wall: Vec<bool>,
    /// Open share of the face towards the next cell along x, y, z; 0 without a next cell.
    pub open: Vec<[f64; 3]>,
}

impl Cells {
    /// Covers the inside with cubes of side `side` [m].
    pub fn new(solid: &Solid<'_>, side: f64) -> Self {
        let bounds = solid.mesh().bounding_box();
        // A layer of cubes outside on each side, so that every cell has a neighbour in the box.
        let low = bounds.min - Vector3::repeat(side * 1.001);
        let dims: [usize; 3] =
            std::array::from_fn(|k| ((bounds.max[k] - low[k]) / side) as usize + 2);
        let count = dims.iter().product();
        let mut this = Self {
            low,
            side,
            dims,
            at: vec![NONE; count],
            places: Vec::new(),
            shares: Vec::new(),
            inner: Vec::new(),
            octants: Vec::new(),
            middle_inside: Vec::new(),
            surface: Vec::new(),
            by_wall: Vec::new(),
            open: Vec::new(),
        };
        this.surface = this.surface(solid.mesh());
        let touched: Vec<bool> = this.surface.iter().map(|d| d.is_finite()).collect();
        let bits = this.classify(solid, &touched);
        this.list(&touched, &bits);
        this.join(&touched, &bits);
        this.by_wall = this.around(&touched, 1);
        this
    }

    /// Marks all places within `reach` of a marked place along each axis.
    pub fn around(&self, marked: &[bool], reach: usize) -> Vec<bool> {
        let mut all = marked.to_vec();
        for axis in 0..3 {
            let step = self.step(axis);
            for _ in 0..reach {
                let before = all.clone();
                for (index, _) in before.iter().enumerate().filter(|(_, m)| **m) {
                    // Past the ends of a row this marks places of the next row: some too many,
                    // never too few.
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

    /// Index in the box of the cube that contains a point; a point outside the box gets a cube at
    /// its border.
    pub fn holding(&self, p: &Point3<f64>) -> usize {
        self.index(self.place(p))
    }

    /// Place of the cube that contains a point.
    pub fn place(&self, p: &Point3<f64>) -> [usize; 3] {
        std::array::from_fn(|k| (((p[k] - self.low[k]) / self.side) as usize).min(self.dims[k] - 1))
    }

    /// The centre of a cube [m].
    pub fn middle(&self, place: [usize; 3]) -> Point3<f64> {
        self.low + Vector3::from(place.map(|k| (k as f64 + 0.5) * self.side))
    }

    /// Distance of each cube's centre to a point of the surface in the cube [m]; infinite if the
    /// cube contains none. The surface is sampled, so the result can miss a cube that the surface
    /// only grazes.
    fn surface(&self, mesh: &TriangleMesh) -> Vec<f64> {
        let mut squares = vec![f64::INFINITY; self.at.len()];
        let mut note = |p: &Point3<f64>| {
            let place = self.place(p);
            let square = &mut squares[self.index(place)];
            *square = square.min((p - self.middle(place)).norm_squared());
        };
        for t in 0..mesh.triangles.len() {
            let corners = mesh.corners(t);
            corners.iter().for_each(&mut note);
            over_triangle(&corners, 0.5 * self.side)
                .iter()
                .for_each(&mut note);
        }
        squares.into_iter().map(f64::sqrt).collect()
    }

    /// Search radius for the surface from the centre of a cube [m], at most a cell; `None` where
    /// the surface is farther.
    pub fn wall_within(&self, index: usize) -> Option<f64> {
        // Slightly larger than the distance to a point of the surface, for rounding.
        self.by_wall[index].then(|| (self.surface[index] * (1.0 + 1e-9)).min(self.side))
    }

    /// One bit for each octant of a cube whose centre is inside, and one for the cube's centre.
    fn classify(&self, solid: &Solid<'_>, touched: &[bool]) -> Vec<u16> {
        let mut bits = vec![0; self.at.len()];
        bits.par_chunks_mut(self.dims[0])
            .enumerate()
            .for_each(|(row, bits)| {
                let touched = &touched[row * self.dims[0]..][..self.dims[0]];
                if touched.iter().any(|t| *t) {
                    self.classify_row(
                        solid,
                        touched,
                        [row % self.dims[1], row / self.dims[1]],
                        bits,
                    );
                }
            });
        bits
    }

    fn classify_row(
        &self,
        solid: &Solid<'_>,
        touched: &[bool],
        [j, k]: [usize; 2],
        bits: &mut [u16],
    ) {
        let middle = self.middle([0, j, k]);
        let through = |p: &Point3<f64>| solid.row(p.y, p.z);
        let octants: [WallRow<'_>; 4] =
            std::array::from_fn(|n| through(&self.octant(&middle, n << 1)));
        let middles = through(&middle);
        // The state is constant between two cubes without surface; the first cube is outside.
        let mut known = Some(false);
        for (i, bits) in bits.iter_mut().enumerate() {
            let middle = self.middle([i, j, k]);
            if touched[i] {
                let inside = |bit: &usize| octants[bit >> 1].contains(self.octant(&middle, *bit).x);
                let octants = (0..8).filter(inside).fold(0, |bits, bit| bits | 1 << bit);
                *bits = octants
                    | if middles.contains(middle.x) {
                        MIDDLE
                    } else {
                        0
                    };
                known = None;
                continue;
            }
            let inside = known.unwrap_or_else(|| middles.contains(middle.x));
            *bits = if inside { WHOLE } else { 0 };
            known = Some(inside);
        }
    }

    /// The centre of an octant of the cube with that centre [m]; bit k of `bit` is its side along
    /// axis k.
    pub fn octant(&self, middle: &Point3<f64>, bit: usize) -> Point3<f64> {
        let quarter = |axis: usize| if bit >> axis & 1 == 1 { 0.25 } else { -0.25 } * self.side;
        middle + Vector3::new(quarter(0), quarter(1), quarter(2))
    }

    fn list(&mut self, touched: &[bool], all: &[u16]) {
        for k in 0..self.dims[2] {
            for j in 0..self.dims[1] {
                for i in 0..self.dims[0] {
                    let index = self.index([i, j, k]);
                    let bits = all[index] & EIGHTHS;
                    if bits == 0 && !touched[index] {
                        continue;
                    }
                    self.at[index] = self.places.len() as u32;
                    self.places.push([i as u32, j as u32, k as u32]);
                    self.shares
                        .push((f64::from(bits.count_ones()) / 8.0).max(LEAST));
                    self.inner.push(self.inner_point([i, j, k], bits));
                    self.octants.push(bits as u8);
                    self.middle_inside.push(all[index] & MIDDLE != 0);
                }
            }
        }
    }

    /// The inner sample point nearest to the mean of all inner sample points; the centre for a full
    /// cube.
    fn inner_point(&self, place: [usize; 3], bits: u16) -> Option<Point3<f64>> {
        let middle = self.middle(place);
        if bits == EIGHTHS {
            return Some(middle);
        }
        let inside: Vec<Point3<f64>> = (0..8)
            .filter(|bit| bits >> bit & 1 == 1)
            .map(|bit| self.octant(&middle, bit))
            .collect();
        let mean =
            inside.iter().map(|p| p.coords).sum::<Vector3<f64>>() / inside.len().max(1) as f64;
        inside.into_iter().min_by(|a, b| {
            (a.coords - mean)
                .norm()
                .total_cmp(&(b.coords - mean).norm())
        })
    }

    fn join(&mut self, touched: &[bool], bits: &[u16]) {
        self.open = vec![[0.0; 3]; self.places.len()];
        for c in 0..self.places.len() {
            let index = self.index(self.places[c].map(|k| k as usize));
            for axis in 0..3 {
                let next = index + self.step(axis);
                if next >= self.at.len() || self.at[next] == NONE {
                    continue;
                }
                let pair = |bit: &usize| {
                    bits[index] >> (bit | 1 << axis) & 1 == 1 && bits[next] >> bit & 1 == 1
                };
                let pairs = (0..8)
                    .filter(|bit| bit >> axis & 1 == 0)
                    .filter(pair)
                    .count();
                let least = if touched[index] && touched[next] {
                    LEAST
                } else {
                    0.0
                };
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
