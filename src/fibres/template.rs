//! Templates of muscles: a cube of fibres, and the regular grid of their points.
//!
//! Four curves c00, c10, c01, c11 from the corners of the origin to those of the insertion span a
//! template, `P(r, s, t) = (1-r)(1-s) c00(t) + r(1-s) c10(t) + (1-r)s c01(t) + r s c11(t)` with r,
//! s, t in 0..1: (r, s) is the fibre, t the position along it. The curves are cubic, in Bernstein
//! form, and stay in the unit cube with their control points. The source gives no curves; these are
//! ours.

use nalgebra::{Point3, Vector3};

use crate::mesh::TriangleMesh;
use crate::springs::lattice::LatticeShape;

/// Arrangement of the fibres between origin and insertion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Template {
    /// Areas on opposite faces and straight parallel fibres: long muscles, such as sartorius.
    #[default]
    Parallel,
    /// Areas on opposite sides, shifted along the muscle, and oblique fibres: such as vastus
    /// medialis.
    Pennate,
    /// Both areas on the same face, and fibres in arches: such as iliacus.
    Curved,
    /// Areas narrower than the belly: rectus femoris.
    Rectus,
}

/// Share of a side that an area of a pennate template occupies along the muscle.
const OBLIQUE: f64 = 0.6;
/// Share of the face that each area of a curved template occupies.
const FOOT: f64 = 0.4;
/// Height of the lowest and the highest arch of a curved template.
const ARCHES: [f64; 2] = [0.3, 1.0];
/// Share of a side that the areas of the template for rectus femoris occupy.
const NECK: f64 = 0.3;

impl Template {
    /// All templates with their names.
    pub const NAMED: [(&'static str, Self); 4] = [
        ("parallel", Self::Parallel),
        ("pennate", Self::Pennate),
        ("curved", Self::Curved),
        ("rectus", Self::Rectus),
    ];

    /// The template with that name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::NAMED
            .into_iter()
            .find(|(known, _)| *known == name)
            .map(|(_, template)| template)
    }

    /// Control points of the curve at the corner (r, s) of both areas, for r and s of 0 or 1.
    pub fn corner_curve(self, r: f64, s: f64) -> [Point3<f64>; 4] {
        match self {
            Self::Parallel => straight(Point3::new(r, s, 0.0), Point3::new(r, s, 1.0)),
            Self::Pennate => {
                let low = OBLIQUE * s;
                straight(
                    Point3::new(0.0, r, low),
                    Point3::new(1.0, r, 1.0 - OBLIQUE + low),
                )
            }
            Self::Curved => {
                let (foot, aside) = (FOOT * (1.0 - r), 1.0 - s);
                // A cubic with both handles at one height reaches three quarters of that height.
                let height = 4.0 / 3.0 * (ARCHES[0] + (ARCHES[1] - ARCHES[0]) * r);
                let at = |x: f64, z: f64| Point3::new(x, aside, z);
                [
                    at(foot, 0.0),
                    at(foot, height),
                    at(1.0 - foot, height),
                    at(1.0 - foot, 0.0),
                ]
            }
            Self::Rectus => {
                let narrow = |a: f64| 0.5 + NECK * (a - 0.5);
                let (x, y) = (narrow(r), narrow(s));
                let third = 1.0 / 3.0;
                [
                    Point3::new(x, y, 0.0),
                    Point3::new(r, s, third),
                    Point3::new(r, s, 2.0 * third),
                    Point3::new(x, y, 1.0),
                ]
            }
        }
    }

    /// The point of fibre (r, s) at t.
    pub fn at(self, r: f64, s: f64, t: f64) -> Point3<f64> {
        let u = 1.0 - t;
        let bernstein = [u * u * u, 3.0 * u * u * t, 3.0 * u * t * t, t * t * t];
        let mut sum = Vector3::zeros();
        for (weight, [i, j]) in [
            ((1.0 - r) * (1.0 - s), [0.0, 0.0]),
            (r * (1.0 - s), [1.0, 0.0]),
            ((1.0 - r) * s, [0.0, 1.0]),
            (r * s, [1.0, 1.0]),
        ] {
            for (b, p) in bernstein.iter().zip(self.corner_curve(i, j)) {
                sum += p.coords * (weight * b);
            }
        }
        Point3::from(sum)
    }
}

/// A straight curve; with equal handles t is the share of the length.
fn straight(from: Point3<f64>, to: Point3<f64>) -> [Point3<f64>; 4] {
    [0.0, 1.0, 2.0, 3.0].map(|k| from + (to - from) * (k / 3.0))
}

/// A regular grid over r, s and t, r running fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// Number of points along r, s and t, each at least 2.
    pub points: [usize; 3],
    /// Requested number of fibres, at most that of the grid.
    pub count: usize,
}

/// Greatest ratio of the sides of a grid across the fibres.
const LONGEST: usize = 2;

impl Sampling {
    /// The grid for `count` fibres of `points` points each; `None` for no fibre, or fewer than two
    /// points.
    ///
    /// The sides along r and s are the most equal factors of `count`. If the longer one exceeds
    /// twice the shorter one, as for a prime, the grid has the next greater number with better
    /// factors. Reading the fibres then skips the surplus ones, evenly distributed.
    pub fn new(count: usize, points: usize) -> Option<Self> {
        if count == 0 || points < 2 || count > u32::MAX as usize / points {
            return None;
        }
        let sides = (count.max(4)..).find_map(|n| {
            let less = (2..=n.isqrt()).rev().find(|a| n.is_multiple_of(*a))?;
            (n / less <= LONGEST * less).then_some([n / less, less])
        })?;
        Some(Self {
            points: [sides[0], sides[1], points],
            count,
        })
    }

    /// Index of a grid point.
    pub fn number(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.points[0] * (j + self.points[1] * k)
    }

    /// The grid as a lattice, for its patterns of springs.
    pub fn shape(&self) -> LatticeShape {
        LatticeShape {
            points: self.points,
            origin: [0.0; 3],
            spacing: self.points.map(|n| 1.0 / (n - 1) as f64),
        }
    }

    /// Parameters r, s and t of each point.
    pub fn parameters(&self) -> impl Iterator<Item = [f64; 3]> + use<> {
        let points = self.points;
        self.shape()
            .each()
            .map(move |at| [0, 1, 2].map(|c| at[c] as f64 / (points[c] - 1) as f64))
    }

    /// Positions in a template.
    pub fn positions(&self, template: Template) -> Vec<Point3<f64>> {
        self.parameters()
            .map(|[r, s, t]| template.at(r, s, t))
            .collect()
    }

    /// True for each point on the surface: r or s or t is 0 or 1.
    pub fn on_surface(&self) -> Vec<bool> {
        let shape = self.shape();
        shape.each().map(|at| shape.on_surface(at)).collect()
    }

    /// The points of the origin, t = 0.
    pub fn origin(&self) -> Vec<u32> {
        (0..(self.points[0] * self.points[1]) as u32).collect()
    }

    /// The points of the insertion, t = 1.
    pub fn insertion(&self) -> Vec<u32> {
        let layer = (self.points[0] * self.points[1]) as u32;
        let first = layer * (self.points[2] - 1) as u32;
        (first..first + layer).collect()
    }

    /// The triangles of the surface over the grid points, oriented outward; two per square.
    pub fn triangles(&self) -> Vec<[u32; 3]> {
        let mut all = Vec::new();
        for axis in 0..3 {
            let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
            for far in [false, true] {
                for (j, k) in (0..self.points[c] - 1)
                    .flat_map(|k| (0..self.points[b] - 1).map(move |j| (j, k)))
                {
                    let corner = |dj: usize, dk: usize| {
                        let mut at = [0; 3];
                        at[axis] = if far { self.points[axis] - 1 } else { 0 };
                        (at[b], at[c]) = (j + dj, k + dk);
                        self.number(at) as u32
                    };
                    let [p, q, r, s] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                    all.extend(if far {
                        [[p, q, r], [p, r, s]]
                    } else {
                        [[p, r, q], [p, s, r]]
                    });
                }
            }
        }
        all
    }

    /// The surface of a template, and the grid point of each of its vertices.
    pub fn surface(&self, template: Template) -> (TriangleMesh, Vec<u32>) {
        let flags = self.on_surface();
        let kept: Vec<u32> = (0..flags.len() as u32)
            .filter(|&p| flags[p as usize])
            .collect();
        let mut of = vec![0u32; flags.len()];
        kept.iter()
            .enumerate()
            .for_each(|(v, &p)| of[p as usize] = v as u32);
        let triangles = self
            .triangles()
            .into_iter()
            .map(|t| t.map(|p| of[p as usize]))
            .collect();
        let positions = self.positions(template);
        (
            TriangleMesh {
                vertices: kept.iter().map(|&p| positions[p as usize]).collect(),
                triangles,
            },
            kept,
        )
    }
}

/// A grid inside a muscle.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Numbers of points.
    pub sampling: Sampling,
    /// Positions of the points \[m\].
    pub points: Vec<Point3<f64>>,
}

impl Grid {
    /// The fibres, each from origin to insertion \[m\].
    pub fn fibres(&self) -> Vec<Vec<Point3<f64>>> {
        let [nr, ns, nt] = self.sampling.points;
        let all = nr * ns;
        // Evenly distributed over the fibres of the grid.
        let taken = (0..self.sampling.count).map(|n| n * all / self.sampling.count);
        taken
            .map(|fibre| (0..nt).map(|k| self.points[fibre + all * k]).collect())
            .collect()
    }

    /// Scaled Jacobian at each corner of each cell: the determinant of the three edges over the
    /// product of their lengths. It is 1 for a right angle, negative for a folded grid and 0 for an
    /// edge without length.
    pub fn jacobian(&self) -> Vec<f64> {
        let [nr, ns, nt] = self.sampling.points;
        let mut all = Vec::with_capacity(8 * (nr - 1) * (ns - 1) * (nt - 1));
        for at in self.sampling.shape().each() {
            if (0..3).any(|c| at[c] + 1 == self.sampling.points[c]) {
                continue;
            }
            for corner in 0..8usize {
                let side = [0, 1, 2].map(|c| corner >> c & 1);
                let here = [0, 1, 2].map(|c| at[c] + side[c]);
                let edge = |c: usize| {
                    let mut other = here;
                    other[c] = at[c] + 1 - side[c];
                    let direction = self.points[self.sampling.number(other)]
                        - self.points[self.sampling.number(here)];
                    if side[c] == 0 { direction } else { -direction }
                };
                let [a, b, c] = [edge(0), edge(1), edge(2)];
                let size = a.norm() * b.norm() * c.norm();
                all.push(if size > 0.0 {
                    a.cross(&b).dot(&c) / size
                } else {
                    size
                });
            }
        }
        all
    }
}
