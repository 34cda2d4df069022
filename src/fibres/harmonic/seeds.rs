//! Seed points of fibres: each next point is the one farthest from all earlier fibres.

use nalgebra::Point3;

use super::field::Field;
use crate::mesh::Aabb;

/// Number of cubes along each side of a block.
const BLOCK: usize = 4;
/// Number of points of a streamline that are tested together.
const RUN: usize = 8;

/// Distance from a streamline, in sides of a cell, at which a cell is on the streamline.
const BESIDE: f64 = 0.5;

/// Distance of each cell to the fibres so far, in blocks. A block is skipped if all its cells are
/// nearer to a fibre than to the new streamline.
#[derive(Debug)]
pub struct Seeds {
    blocks: Vec<Block>,
    /// Side of a cell [m].
    side: f64,
}

/// Neighbouring candidates.
#[derive(Clone, Debug)]
struct Block {
    bounds: Aabb,
    cells: Vec<u32>,
    /// Positions [m], by axis.
    at: [Vec<f64>; 3],
    /// Squared distances [m2]; negative for cells that are no candidates.
    squares: Vec<f64>,
    /// The greatest squared distance [m2].
    greatest: f64,
}

/// The seed of the next fibre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seed {
    /// Cell of the seed.
    pub cell: u32,
    /// A point inside [m].
    pub point: Point3<f64>,
    block: usize,
    slot: usize,
}

impl Seeds {
    /// Takes all cells with a point inside as candidates.
    pub fn new(field: &Field) -> Self {
        let cells = &field.cells;
        let [nx, ny, nz] = cells.dims.map(|n| n.div_ceil(BLOCK));
        let mut blocks = vec![Block::EMPTY; nx * ny * nz];
        for c in (0..cells.count()).filter(|&c| !field.values[c].is_nan()) {
            let Some(point) = cells.inner[c] else {
                continue;
            };
            let [i, j, k] = cells.places[c].map(|place| place as usize / BLOCK);
            blocks[(k * ny + j) * nx + i].push(c as u32, &point);
        }
        blocks.retain(|block| !block.cells.is_empty());
        Self {
            blocks,
            side: cells.side,
        }
    }

    /// The candidate farthest from all fibres; the first cell of several.
    pub fn farthest(&self) -> Option<Seed> {
        let mut best: Option<Seed> = None;
        let mut most = 0.0;
        for (n, block) in self
            .blocks
            .iter()
            .enumerate()
            .filter(|(_, block)| block.greatest >= 0.0)
        {
            let Some(slot) = block.squares.iter().position(|s| *s == block.greatest) else {
                continue;
            };
            let cell = block.cells[slot];
            if best
                .is_none_or(|b| block.greatest > most || (block.greatest == most && cell < b.cell))
            {
                most = block.greatest;
                best = Some(Seed {
                    cell,
                    point: block.point(slot),
                    block: n,
                    slot,
                });
            }
        }
        best
    }

    /// Removes a candidate.
    pub fn give_up(&mut self, seed: &Seed) {
        let block = &mut self.blocks[seed.block];
        block.squares[seed.slot] = -1.0;
        block.measure();
    }

    /// Removes the candidates on a lost streamline; their streamlines would be lost too.
    pub fn give_up_along(&mut self, points: &[Point3<f64>]) {
        let square = (BESIDE * self.side).powi(2);
        for block in &mut self.blocks {
            let whole = block.bounds.inflate(BESIDE * self.side);
            let near: Vec<&Point3<f64>> = points.iter().filter(|p| whole.contains(p)).collect();
            if block.greatest < 0.0 || near.is_empty() {
                continue;
            }
            for slot in 0..block.cells.len() {
                if near
                    .iter()
                    .any(|p| (*p - block.point(slot)).norm_squared() < square)
                {
                    block.squares[slot] = -1.0;
                }
            }
            block.measure();
        }
    }

    /// Adds a fibre, as points less than a cell apart.
    pub fn note(&mut self, points: &[Point3<f64>]) {
        let points = thinned(points, 0.8 * self.side);
        let runs: Vec<(Aabb, &[Point3<f64>])> = points
            .chunks(RUN)
            .map(|run| (Aabb::of_points(run), run))
            .collect();
        for block in &mut self.blocks {
            let before = block.greatest;
            for (bounds, run) in &runs {
                if apart(bounds, &block.bounds) < before {
                    run.iter().for_each(|p| block.note(p, before));
                }
            }
            if before >= 0.0 {
                block.measure();
            }
        }
    }
}

impl Block {
    const EMPTY: Self = Self {
        bounds: Aabb::EMPTY,
        cells: Vec::new(),
        at: [const { Vec::new() }; 3],
        squares: Vec::new(),
        greatest: -1.0,
    };

    fn push(&mut self, cell: u32, point: &Point3<f64>) {
        self.bounds = self.bounds.union(&Aabb::of_points([point]));
        self.cells.push(cell);
        (0..3).for_each(|k| self.at[k].push(point[k]));
        self.squares.push(f64::INFINITY);
        self.greatest = f64::INFINITY;
    }

    fn point(&self, slot: usize) -> Point3<f64> {
        Point3::from([0, 1, 2].map(|k: usize| self.at[k][slot]))
    }

    fn note(&mut self, p: &Point3<f64>, before: f64) {
        if !((p - self.bounds.min.sup(&self.bounds.max.inf(p))).norm_squared() < before) {
            return;
        }
        let [x, y, z] = &self.at;
        for (((square, x), y), z) in self.squares.iter_mut().zip(x).zip(y).zip(z) {
            let (x, y, z) = (p.x - x, p.y - y, p.z - z);
            let other = x * x + y * y + z * z;
            *square = if other < *square { other } else { *square };
        }
    }

    fn measure(&mut self) {
        self.greatest = self
            .squares
            .iter()
            .fold(-1.0, |most, s| if *s > most { *s } else { most });
    }
}

/// Squared distance between two boxes [m2].
fn apart(a: &Aabb, b: &Aabb) -> f64 {
    let gap = |k: usize| (b.min[k] - a.max[k]).max(a.min[k] - b.max[k]).max(0.0);
    (0..3).map(|k| gap(k) * gap(k)).sum()
}

/// Points of a line at least `apart` [m] from each other, and its last point.
fn thinned(points: &[Point3<f64>], apart: f64) -> Vec<Point3<f64>> {
    let mut kept: Vec<Point3<f64>> = Vec::new();
    for (k, p) in points.iter().enumerate() {
        if k + 1 == points.len() || kept.last().is_none_or(|q| (p - q).norm() >= apart) {
            kept.push(*p);
        }
    }
    kept
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::fibres::attachment::{AreaSource, Attachment};
    use crate::fibres::harmonic::cells::Cells;
    use crate::fibres::harmonic::field::Flux;
    use crate::fibres::solid::Closed;
    use crate::mesh::shapes::tube;
    use crate::testing::Draw;

    /// The field of a tube of radius 20 mm and length 200 mm between its ends.
    pub(in crate::fibres::harmonic) fn field() -> Field {
        let mesh = tube(0.02, 0.2, 24);
        let end = |sign: f64| -> Vec<u32> {
            let at = |v: &u32| sign * mesh.vertices[*v as usize].x > 0.0999;
            (0..mesh.vertices.len() as u32).filter(at).collect()
        };
        let (low, high) = (end(-1.0), end(1.0));
        let areas = Attachment::new(
            &mesh,
            AreaSource::Vertices(&low),
            AreaSource::Vertices(&high),
        )
        .expect("areas");
        let closed = Closed::new(&mesh);
        let solid = closed.solid();
        let cells = Cells::new(&solid, 0.005);
        Field::new(cells, &solid, &mesh, &areas, &[], (Flux::Even, 0.0)).expect("a field")
    }

    /// All cells in one list, without blocks.
    struct Plain(Vec<(u32, Point3<f64>, f64)>);

    impl Plain {
        fn farthest(&self) -> Option<(u32, f64)> {
            let open = self.0.iter().filter(|(_, _, square)| *square >= 0.0);
            open.fold(None, |best: Option<(u32, f64)>, &(c, _, s)| match best {
                Some((_, most)) if s <= most => best,
                _ => Some((c, s)),
            })
        }

        fn note(&mut self, points: &[Point3<f64>]) {
            for (_, at, square) in &mut self.0 {
                points
                    .iter()
                    .for_each(|p| *square = square.min((p - *at).norm_squared()));
            }
        }
    }

    #[test]
    fn blocks_find_what_a_search_of_all_finds() {
        let field = field();
        let inner = |c: usize| Some((c as u32, field.cells.inner[c]?, f64::INFINITY));
        let mut plain = Plain((0..field.cells.count()).filter_map(inner).collect());
        let mut seeds = Seeds::new(&field);
        let mut draw = Draw::new(8);
        for n in 0..200 {
            let (cell, square) = plain.farthest().expect("a cell");
            let seed = seeds.farthest().expect("a cell");
            assert_eq!(
                (seed.cell, seeds.blocks[seed.block].greatest),
                (cell, square),
                "at {n}"
            );
            seeds.give_up(&seed);
            plain
                .0
                .iter_mut()
                .filter(|(c, _, _)| *c == cell)
                .for_each(|(_, _, square)| *square = -1.0);
            if n % 3 == 0 {
                // Farther apart than the spacing of thinned points.
                let along = draw.direction() * 0.9 * field.cells.side;
                let line: Vec<Point3<f64>> = (-20..20)
                    .map(|k| seed.point + along * f64::from(k))
                    .collect();
                seeds.note(&line);
                plain.note(&line);
            }
        }
    }

    #[test]
    fn nothing_on_a_lost_streamline_is_asked_for_again() {
        let field = field();
        let mut seeds = Seeds::new(&field);
        let through = seeds.farthest().expect("a cell").point;
        let axis: Vec<Point3<f64>> = (-100..=100)
            .map(|k| Point3::new(0.001 * f64::from(k), through.y, through.z))
            .collect();
        seeds.give_up_along(&axis);
        let mut all = Vec::new();
        while let Some(seed) = seeds.farthest() {
            seeds.give_up(&seed);
            all.push(seed.point);
        }
        let off = |p: &Point3<f64>| {
            axis.iter()
                .map(|q| (p - q).norm())
                .fold(f64::INFINITY, f64::min)
        };
        let reach = BESIDE * field.cells.side;
        assert!(all.iter().all(|p| off(p) >= reach));
        let candidates = (0..field.cells.count()).filter_map(|c| field.cells.inner[c]);
        assert_eq!(all.len(), candidates.filter(|p| off(p) >= reach).count());
        assert!(all.len() > 1000 && all.len() < field.cells.inner.iter().flatten().count());
    }
}
