//! A box that is divided in eight wherever it contains too many triangles.

use nalgebra::{Point3, Vector3};

use super::overlap::may_meet;
use super::{Best, BroadPhase, NearestTriangle, boxes::Boxes};
use crate::mesh::TriangleMesh;

/// Entry in the list of methods.
pub(super) const METHOD: BroadPhase = BroadPhase {
    name: "octree",
    sizes: &[4, 8, 16],
    usual: 8,
    sort: |mesh, k| Box::new(Octree::new(mesh, k, DEPTH)),
};

/// Default depth of the tree: at a vertex with more triangles than a cell may contain (nearly any
/// vertex for a limit of four) the division would never end. The smallest cells are as large as
/// those of 1024^3 voxels.
pub const DEPTH: u32 = 10;

/// A cell: eight children from index `link`, or a leaf with the triangles `link..end`.
#[derive(Clone, Copy, Debug)]
struct Cell {
    link: u32,
    /// [`CUT`] for a cell with children.
    end: u32,
}

const CUT: u32 = u32::MAX;

/// At a greater depth a cell is no larger than the rounding of its position.
const DEEPEST: u32 = 40;

/// The division ends at this number of cells or entries, since their indices have 32 bits.
const FULL: usize = 1 << 30;

/// A tree of cells with a limited number of triangles per leaf, except at the greatest depth
/// \[cervenka2019\]. The nearest triangle is exact: a cell is skipped if it is farther away than
/// the best triangle.
#[derive(Clone, Debug)]
pub struct Octree {
    /// Centre [m], half sides [m] and rounding [m] of the first cell.
    centre: Point3<f64>,
    half: Vector3<f64>,
    slack: f64,
    cells: Vec<Cell>,
    listed: Vec<u32>,
}

/// A cell during the search.
#[derive(Clone, Copy)]
struct Visit {
    cell: u32,
    centre: Point3<f64>,
    half: Vector3<f64>,
}

impl Visit {
    /// Child `k`, upper along the axes whose bits are set; `first` is the index of the first of the
    /// eight.
    fn child(&self, first: u32, k: usize) -> Self {
        let half = 0.5 * self.half;
        let towards = Vector3::from_fn(|axis, _| {
            if k >> axis & 1 == 0 {
                -half[axis]
            } else {
                half[axis]
            }
        });
        Self {
            cell: first + k as u32,
            centre: self.centre + towards,
            half,
        }
    }

    fn distance(&self, point: &Point3<f64>) -> f64 {
        ((point - self.centre).abs() - self.half)
            .sup(&Vector3::zeros())
            .norm()
    }
}

impl Octree {
    /// Divides every cell with more than `most` triangles, up to depth `depth`. The limit is at
    /// least two; otherwise all cells along every edge would reach the greatest depth.
    pub fn new(mesh: &TriangleMesh, most: usize, depth: u32) -> Self {
        let (most, depth) = (most.max(2), depth.min(DEEPEST));
        // One box, for its rounding and its sides.
        let whole = Boxes::new(&mesh.bounding_box(), 1);
        let root = Visit {
            cell: 0,
            centre: whole.centre([0; 3]),
            half: 0.5 * whole.size,
        };
        let mut this = Self {
            centre: root.centre,
            half: root.half,
            slack: whole.slack,
            cells: vec![Cell { link: 0, end: 0 }],
            listed: Vec::new(),
        };
        let mut open = vec![(
            root,
            depth,
            (0..mesh.triangles.len() as u32).collect::<Vec<_>>(),
        )];
        while let Some((visit, depth, triangles)) = open.pop() {
            if triangles.len() <= most
                || depth == 0
                || this.cells.len().max(this.listed.len()) > FULL
            {
                let begin = this.listed.len() as u32;
                this.listed.extend(triangles);
                this.cells[visit.cell as usize] = Cell {
                    link: begin,
                    end: this.listed.len() as u32,
                };
                continue;
            }
            let first = this.cells.len() as u32;
            this.cells[visit.cell as usize] = Cell {
                link: first,
                end: CUT,
            };
            this.cells
                .resize(this.cells.len() + 8, Cell { link: 0, end: 0 });
            for child in (0..8).map(|k| visit.child(first, k)) {
                let grown = child.half + Vector3::repeat(whole.slack);
                let meets = |t: &u32| may_meet(&mesh.corners(*t as usize), &child.centre, &grown);
                open.push((
                    child,
                    depth - 1,
                    triangles.iter().copied().filter(meets).collect(),
                ));
            }
        }
        this.cells.shrink_to_fit();
        this.listed.shrink_to_fit();
        this
    }

    fn visit(&self, at: Visit, mesh: &TriangleMesh, point: &Point3<f64>, best: &mut Best) {
        let Cell { link, end } = self.cells[at.cell as usize];
        if end != CUT {
            self.listed[link as usize..end as usize]
                .iter()
                .for_each(|&t| best.look_at(mesh, point, t));
            return;
        }
        let mut children: [(f64, Visit); 8] = std::array::from_fn(|k| {
            let child = at.child(link, k);
            (child.distance(point), child)
        });
        children.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cell.cmp(&b.1.cell)));
        for (distance, child) in children {
            if distance - self.slack > best.distance {
                break;
            }
            self.visit(child, mesh, point, best);
        }
    }
}

impl NearestTriangle for Octree {
    fn nearest(&self, mesh: &TriangleMesh, point: &Point3<f64>, reach: f64) -> Option<u32> {
        let mut best = Best::within(reach);
        self.visit(
            Visit {
                cell: 0,
                centre: self.centre,
                half: self.half,
            },
            mesh,
            point,
            &mut best,
        );
        best.triangle
    }

    fn bytes(&self) -> usize {
        self.cells.capacity() * std::mem::size_of::<Cell>() + self.listed.capacity() * 4
    }
}
