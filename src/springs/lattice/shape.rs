//! The points of a box, without springs.

use nalgebra::Point3;

use super::error::{LatticeError, value};

/// Greatest number of points of a lattice: indices fit into 32 bits.
const MOST_POINTS: usize = 1 << 30;

/// Points of a box at rest, x running fastest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatticeShape {
    /// Number of points along x, y, z.
    pub points: [usize; 3],
    /// Position of the first point \[m\].
    pub origin: [f64; 3],
    /// Distance of neighbours along x, y, z \[m\].
    pub spacing: [f64; 3],
}

impl LatticeShape {
    /// A cube of side 1 about the origin, `n` points along each side.
    pub fn unit_cube(n: usize) -> Self {
        let spacing = if n > 1 { 1.0 / (n - 1) as f64 } else { 1.0 };
        Self {
            points: [n; 3],
            origin: [-0.5; 3],
            spacing: [spacing; 3],
        }
    }

    /// A box with longest side `side` \[m\], the first point at the origin, and equal spacings.
    ///
    /// # Errors
    /// [`LatticeError`] for a side without points, too many points, or a length that is not
    /// positive.
    pub fn with_longest_side(points: [usize; 3], side: f64) -> Result<Self, LatticeError> {
        value("the longest side", side, false)?;
        let most = points
            .into_iter()
            .fold(1, usize::max)
            .saturating_sub(1)
            .max(1);
        let shape = Self {
            points,
            origin: [0.0; 3],
            spacing: [side / most as f64; 3],
        };
        shape.check()?;
        Ok(shape)
    }

    /// Number of points.
    pub fn count(&self) -> usize {
        self.points.iter().product()
    }

    /// Rest position of a point \[m\].
    pub fn at(&self, point: [usize; 3]) -> [f64; 3] {
        [0, 1, 2].map(|c| self.origin[c] + self.spacing[c] * point[c] as f64)
    }

    /// True if a point is on the surface of the box.
    pub fn on_surface(&self, point: [usize; 3]) -> bool {
        (0..3).any(|c| point[c] == 0 || point[c] + 1 == self.points[c])
    }

    /// All points, x first.
    pub fn each(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [nx, ny, nz] = self.points;
        (0..nz).flat_map(move |k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])))
    }

    /// Rest positions of all points \[m\].
    pub fn positions(&self) -> Vec<Point3<f64>> {
        // Growing lists take half as much again.
        let mut all = Vec::with_capacity(self.count());
        all.extend(self.each().map(|point| Point3::from(self.at(point))));
        all
    }

    /// The indices of the points on the surface.
    pub fn surface(&self) -> Vec<u32> {
        (0u32..)
            .zip(self.each())
            .filter(|(_, point)| self.on_surface(*point))
            .map(|(p, _)| p)
            .collect()
    }

    /// The outward triangles between the points on the surface.
    pub fn faces(&self) -> impl Iterator<Item = [[usize; 3]; 3]> + use<> {
        let last = self.points.map(|n| n - 1);
        let sides = (0..3).flat_map(move |axis| [(axis, 0), (axis, last[axis])]);
        sides.flat_map(move |(axis, side)| {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let cells = (0..last[u]).flat_map(move |i| (0..last[v]).map(move |j| (i, j)));
            cells.flat_map(move |(i, j)| {
                let corner = |a: usize, b: usize| {
                    let mut p = [0; 3];
                    (p[axis], p[u], p[v]) = (side, i + a, j + b);
                    p
                };
                let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                [[a, b, c], [a, c, d]]
                    .map(|[p, q, r]| if side == 0 { [p, r, q] } else { [p, q, r] })
            })
        })
    }

    /// Index of a point, x running fastest.
    pub fn index(&self, [i, j, k]: [usize; 3]) -> u32 {
        let [nx, ny, _] = self.points;
        ((k * ny + j) * nx + i) as u32
    }

    /// The point of an index.
    pub fn point(&self, index: u32) -> [usize; 3] {
        let ([nx, ny, _], index) = (self.points, index as usize);
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    /// Length of the longest side \[m\], and the spacing along it; `None` if no side has two
    /// points.
    pub(super) fn longest(&self) -> Option<(f64, f64)> {
        let sides = (0..3).filter(|&c| self.points[c] > 1).map(|c| {
            let spacing = self.spacing[c];
            (spacing * (self.points[c] - 1) as f64, spacing)
        });
        sides.reduce(|a, b| if b.0 > a.0 { b } else { a })
    }

    pub(super) fn check(&self) -> Result<(), LatticeError> {
        let count = self
            .points
            .iter()
            .try_fold(1usize, |all, &n| all.checked_mul(n));
        if !count.is_some_and(|n| (1..=MOST_POINTS).contains(&n)) {
            return Err(LatticeError::Points {
                points: self.points,
                most: MOST_POINTS,
            });
        }
        self.spacing
            .iter()
            .try_for_each(|&h| value("a spacing", h, false))?;
        match self.origin.iter().find(|o| !o.is_finite()) {
            Some(&value) => Err(LatticeError::Value {
                name: "an origin",
                value,
                zero_allowed: true,
            }),
            None => Ok(()),
        }
    }
}
