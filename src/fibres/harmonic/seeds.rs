//! Through which points fibres go: each next one through the point farthest from all that are there.

use nalgebra::Point3;

use super::cells::NONE;
use super::field::Field;

/// Distance of each cell to the fibres so far.
#[derive(Debug)]
pub struct Seeds<'a> {
    field: &'a Field,
    /// Square of the distance [m2]; negative where no fibre can begin.
    squares: Vec<f64>,
    candidates: Vec<u32>,
}

impl<'a> Seeds<'a> {
    /// All cells with a point inside are candidates.
    pub fn new(field: &'a Field) -> Self {
        let usable = |c: &usize| field.cells.inner[*c].is_some() && !field.values[*c].is_nan();
        let candidates: Vec<u32> = (0..field.cells.count()).filter(usable).map(|c| c as u32).collect();
        let mut squares = vec![-1.0; field.cells.count()];
        candidates.iter().for_each(|&c| squares[c as usize] = f64::INFINITY);
        Self { field, squares, candidates }
    }

    /// The candidate farthest from all fibres, and its distance to them [m]; the first of several.
    pub fn farthest(&self) -> Option<(u32, Point3<f64>, f64)> {
        let mut best: Option<u32> = None;
        for &c in &self.candidates {
            let square = self.squares[c as usize];
            if square >= 0.0 && best.is_none_or(|b| square > self.squares[b as usize]) {
                best = Some(c);
            }
        }
        let c = best?;
        Some((c, self.field.cells.inner[c as usize]?, self.squares[c as usize].sqrt()))
    }

    /// Takes a candidate out.
    pub fn give_up(&mut self, cell: u32) {
        self.squares[cell as usize] = -1.0;
    }

    /// Notes a fibre, by points less than a cell apart; `farthest` [m] is the distance of the farthest candidate before.
    pub fn note(&mut self, points: &[Point3<f64>], farthest: f64) {
        let cells = &self.field.cells;
        let points = &thinned(points, 0.8 * cells.side);
        let reach = (farthest / cells.side).ceil() + 1.0;
        let around = (2.0 * reach + 1.0).powi(3);
        if !(around < self.candidates.len() as f64) {
            for &c in &self.candidates {
                let Some(at) = cells.inner[c as usize] else { continue };
                let square = &mut self.squares[c as usize];
                for p in points {
                    *square = square.min((p - at).norm_squared());
                }
            }
            return;
        }
        let reach = reach as usize;
        for p in points {
            let index = cells.holding(p);
            let place =
                [index % cells.dims[0], index / cells.dims[0] % cells.dims[1], index / cells.dims[0] / cells.dims[1]];
            let range = |k: usize| place[k].saturating_sub(reach)..(place[k] + reach + 1).min(cells.dims[k]);
            for k in range(2) {
                for j in range(1) {
                    for i in range(0) {
                        let c = cells.at[cells.index([i, j, k])];
                        if c == NONE || !(self.squares[c as usize] >= 0.0) {
                            continue;
                        }
                        if let Some(at) = cells.inner[c as usize] {
                            let square = &mut self.squares[c as usize];
                            *square = square.min((p - at).norm_squared());
                        }
                    }
                }
            }
        }
    }
}

/// Points of a line that are at least so far apart [m], and its last.
fn thinned(points: &[Point3<f64>], apart: f64) -> Vec<Point3<f64>> {
    let mut kept: Vec<Point3<f64>> = Vec::new();
    for (k, p) in points.iter().enumerate() {
        if k + 1 == points.len() || kept.last().is_none_or(|q| (p - q).norm() >= apart) {
            kept.push(*p);
        }
    }
    kept
}
