//! Deformation of one surface onto another: clusters with one rigid motion each, interpolated over
//! the surface.
//!
//! The scheme follows \[huang2008\]. Representatives are spread evenly over the surface. Each leads
//! a cluster with one rotation and translation about the representative. A vertex follows the
//! clusters near it along the surface, with smooth compact weights. The nearest point of the other
//! surface attracts a vertex to its tangent plane, and weakly to itself; each vertex of the other
//! surface attracts what is nearest to it in the same manner. Neighbouring clusters
//! should agree on the motion of each other's representative. This agreement is stiff at first, so
//! that the whole surface turns before parts bend, and decreases gradually. The method is the
//! embedded deformation of \[sumner2007\] with rotations instead of affine maps.

mod clusters;

use nalgebra::{Point3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::{RegisterError, RegistrationSurface, curved};
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::{max_or_nan, median};
use crate::progress::Progress;
use crate::solvers::sparse::Factor;
use clusters::Clusters;

/// Settings of the deformation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonRigid {
    /// Greatest number of clusters; fewer for fewer vertices.
    pub clusters: usize,
    /// Weight of the agreement relative to that of the data: first value, and least value.
    pub stiffness: [f64; 2],
    /// Weight of the distance between points, relative to that from planes.
    pub points: f64,
    /// Vertices farther from the other surface than this multiple of the median have no target,
    /// unless they are within `reach`.
    pub reject: f64,
    /// Distance within which all vertices have a target, relative to the size of the other surface:
    /// undeformed parts can be far from it.
    pub reach: f64,
    /// Greatest number of rounds.
    pub rounds: usize,
    /// Greatest displacement of a vertex in a round, relative to the size of the other surface, at
    /// which the stiffness decreases; it also decreases after eight rounds. At the least stiffness
    /// the deformation ends at this displacement, or if the distances stop decreasing.
    pub threshold: f64,
}

impl Default for NonRigid {
    fn default() -> Self {
        Self {
            clusters: 100,
            stiffness: [100.0, 0.01],
            points: 0.1,
            reject: 4.0,
            reach: 0.1,
            rounds: 200,
            threshold: 1e-4,
        }
    }
}

/// A deformed surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Bent {
    /// Vertices \[m\].
    pub points: Vec<Point3<f64>>,
    /// The cluster of the nearest representative, for each vertex.
    pub clusters: Vec<u32>,
    /// Number of clusters.
    pub count: usize,
    /// Number of rounds.
    pub rounds: usize,
    /// True if the deformation ended by its threshold.
    pub converged: bool,
    /// Number of pairs in the last round: of vertices of either surface that are near the other.
    pub pairs: usize,
    /// Greatest angle between the rotations of two neighbouring clusters \[rad\].
    pub bend_max: f64,
}

/// Factor of each decrease of the stiffness, and the greatest number of rounds before it.
const LET_GO: f64 = 0.5;
const EACH: usize = 8;
/// The deformation is at rest after this number of rounds with a smaller relative decrease of the
/// distance: pairs can alternate.
const BETTER: f64 = 1e-3;
const PATIENCE: usize = 12;
/// Least cosine between the normals of a vertex and of its target: 60 degrees.
const FACING: f64 = 0.5;
/// Regularisation of undetermined rotations, relative to the mean of the diagonal: rounding must
/// not make the matrix indefinite.
const HELD: f64 = 1e-9;

/// The motion of a cluster.
#[derive(Clone, Copy)]
struct Motion {
    turn: UnitQuaternion<f64>,
    shift: Vector3<f64>,
}

/// A vertex with its target, in units of the size.
struct Drawn {
    vertex: usize,
    to: Point3<f64>,
    normal: Vector3<f64>,
}

impl NonRigid {
    /// Deforms a surface; `start` holds the initial positions of its vertices.
    ///
    /// # Errors
    /// Too few vertices are near the other surface, or the system has no solution.
    pub fn run(
        &self,
        moving: &RegistrationSurface<'_>,
        fixed: &RegistrationSurface<'_>,
        start: &[Point3<f64>],
        progress: &dyn Progress,
    ) -> Result<Bent, RegisterError> {
        let clusters = Clusters::new(start, &moving.mesh().triangles, self.clusters);
        let mut bending = Bending::new(moving, fixed, start, &clusters)?;
        let mut stiffness = self.stiffness[0];
        let (mut rounds, mut converged, mut pairs) = (0, false, 0);
        let (mut level, mut least, mut since) = (0, f64::INFINITY, 0);
        while rounds < self.rounds {
            if progress.is_stopped() {
                return Err(RegisterError::Stopped);
            }
            rounds += 1;
            let drawn = bending.drawn(self.reject, self.reach);
            pairs = drawn.len();
            if pairs < 6 {
                return Err(RegisterError::Pairs {
                    pairs,
                    of: start.len() + fixed.points().len(),
                    round: rounds,
                });
            }
            let moved = bending.step(&drawn, stiffness, self.points)?;
            level += 1;
            if stiffness > self.stiffness[1] {
                if moved <= self.threshold || level >= EACH {
                    (stiffness, level) = ((stiffness * LET_GO).max(self.stiffness[1]), 0);
                }
                continue;
            }
            let distance = bending.off(&drawn);
            since = if distance < least * (1.0 - BETTER) {
                0
            } else {
                since + 1
            };
            least = least.min(distance);
            if moved <= self.threshold || since >= PATIENCE {
                converged = true;
                break;
            }
        }
        Ok(Bent {
            points: bending
                .now
                .iter()
                .map(|p| Point3::from(p.coords * bending.size))
                .collect(),
            clusters: clusters
                .labels
                .iter()
                .map(|l| l.first().map_or(0, |(c, _)| *c))
                .collect(),
            count: clusters.seeds.len(),
            rounds,
            converged,
            pairs,
            bend_max: bending.bend(),
        })
    }
}

/// State of the deformation, in units of the size of the other surface.
struct Bending<'a> {
    moving: &'a RegistrationSurface<'a>,
    fixed: &'a RegistrationSurface<'a>,
    clusters: &'a Clusters,
    triangles: &'a [[u32; 3]],
    outliers: Vec<bool>,
    size: f64,
    rest: Vec<Point3<f64>>,
    now: Vec<Point3<f64>>,
    motions: Vec<Motion>,
    factor: Factor<6>,
}

type Block = SMatrix<f64, 6, 6>;
type Part = SVector<f64, 6>;

impl<'a> Bending<'a> {
    fn new(
        moving: &'a RegistrationSurface<'a>,
        fixed: &'a RegistrationSurface<'a>,
        start: &[Point3<f64>],
        clusters: &'a Clusters,
    ) -> Result<Self, RegisterError> {
        let size = fixed.size();
        let rest: Vec<Point3<f64>> = start
            .iter()
            .map(|p| Point3::from(p.coords / size))
            .collect();
        let none = Motion {
            turn: UnitQuaternion::identity(),
            shift: Vector3::zeros(),
        };
        let factor = Factor::new(clusters.seeds.len(), &clusters.together)?;
        let (now, motions) = (rest.clone(), vec![none; clusters.seeds.len()]);
        let outliers = moving
            .normals()
            .iter()
            .map(|n| *n == Vector3::zeros())
            .collect();
        Ok(Self {
            moving,
            fixed,
            clusters,
            triangles: &moving.mesh().triangles,
            outliers,
            size,
            rest,
            now,
            motions,
            factor,
        })
    }

    /// The vector from a representative to a vertex, rotated with its cluster.
    fn arm(&self, cluster: u32, p: &Point3<f64>) -> Vector3<f64> {
        self.motions[cluster as usize].turn * (p - self.seed(cluster))
    }

    fn seed(&self, cluster: u32) -> Point3<f64> {
        self.rest[self.clusters.seeds[cluster as usize] as usize]
    }

    fn follow(&mut self) {
        let place = |(p, label): (&Point3<f64>, &Vec<(u32, f64)>)| {
            let of = |&(c, w): &(u32, f64)| {
                (self.seed(c).coords + self.arm(c, p) + self.motions[c as usize].shift) * w
            };
            Point3::from(label.iter().map(of).sum::<Vector3<f64>>())
        };
        let now = self
            .rest
            .iter()
            .zip(&self.clusters.labels)
            .map(place)
            .collect();
        self.now = now;
    }

    /// Targets of both surfaces: each vertex of the moving one is drawn to the nearest point of the
    /// other, and each vertex of the other draws what is nearest to it. With the first alone, the
    /// moving surface leaves parts of the other bare: no vertex is nearest to them.
    fn drawn(&self, reject: f64, reach: f64) -> Vec<Drawn> {
        let now = crate::mesh::TriangleMesh {
            vertices: self.now.clone(),
            triangles: self.triangles.to_vec(),
        };
        let near = |all: Vec<(f64, Drawn)>| {
            let limit = reject * median(all.iter().map(|(d, _)| *d).collect()).unwrap_or(0.0);
            let limit = limit.max(reach * self.size);
            all.into_iter()
                .filter(move |(d, _)| *d <= limit)
                .map(|(_, drawn)| drawn)
        };
        near(self.drawn_to_fixed(&now))
            .chain(near(self.drawn_by_fixed(&now)))
            .collect()
    }

    /// Targets of the moving vertices, with their distances: the nearest point with a similar
    /// normal, unless it is on a boundary.
    fn drawn_to_fixed(&self, now: &crate::mesh::TriangleMesh) -> Vec<(f64, Drawn)> {
        let normals = now.vertex_normals();
        let mut all = Vec::new();
        for (vertex, (p, normal)) in self.now.iter().zip(&normals).enumerate() {
            if self.outliers[vertex] {
                continue;
            }
            let at = Point3::from(p.coords * self.size);
            let Some(near) = self
                .fixed
                .tree()
                .closest_facing(&at, normal, FACING, f64::INFINITY)
            else {
                continue;
            };
            if self.fixed.is_on_rim(near.triangle, &near.point) {
                continue;
            }
            let (to, normal) = self.fixed.curved(&near);
            all.push((
                near.distance,
                Drawn {
                    vertex,
                    to: Point3::from(to.coords / self.size),
                    normal,
                },
            ));
        }
        all
    }

    /// Targets that the vertices of the other surface give: the vertex next to the nearest point
    /// of the moving surface is to move as that point would have to.
    fn drawn_by_fixed(&self, now: &crate::mesh::TriangleMesh) -> Vec<(f64, Drawn)> {
        let tree = SurfaceTree::new(&now.vertices, &now.triangles);
        let own = now.vertex_normals();
        let mut all = Vec::new();
        for (p, normal) in self.fixed.points().iter().zip(self.fixed.normals()) {
            let p = Point3::from(p.coords / self.size);
            // An outlier has no normal, and draws nothing.
            let Some(near) = tree.closest_facing(&p, normal, FACING, f64::INFINITY) else {
                continue;
            };
            let corners = self.triangles[near.triangle as usize];
            let at = now.corners(near.triangle as usize);
            if self.moving.is_on_moved_rim(near.triangle, &at, &near.point) {
                continue;
            }
            let unit = |v: u32| own[v as usize].try_normalize(0.0).unwrap_or_default();
            let (foot, _) = curved(&near.point, &at, &corners.map(unit));
            let away = |v: &u32| (self.now[*v as usize] - near.point).norm();
            let vertex = corners
                .into_iter()
                .min_by(|a, b| away(a).total_cmp(&away(b)));
            let Some(vertex) = vertex.filter(|v| !self.outliers[*v as usize]) else {
                continue;
            };
            all.push((
                near.distance * self.size,
                Drawn {
                    vertex: vertex as usize,
                    to: p + (self.now[vertex as usize] - foot),
                    normal: *normal,
                },
            ));
        }
        all
    }

    /// Mean squared distance of the vertices from their target planes, in units of the size.
    fn off(&self, drawn: &[Drawn]) -> f64 {
        let square = |d: &Drawn| d.normal.dot(&(self.now[d.vertex] - d.to)).powi(2);
        drawn.iter().map(square).sum::<f64>() / drawn.len().max(1) as f64
    }

    /// One Gauss-Newton step. Returns the greatest displacement of a vertex.
    fn step(&mut self, drawn: &[Drawn], stiffness: f64, points: f64) -> Result<f64, RegisterError> {
        self.factor.clear();
        let mut rhs = vec![0.0; 6 * self.motions.len()];
        for d in drawn {
            self.draw(d, points, &mut rhs);
        }
        let each = stiffness * drawn.len() as f64 / self.clusters.neighbours.len().max(1) as f64;
        for &[a, b] in &self.clusters.neighbours {
            self.agree(a, b, each, &mut rhs);
            self.agree(b, a, each, &mut rhs);
        }
        let held = HELD * self.factor.trace() / rhs.len() as f64;
        (0..self.motions.len() as u32).for_each(|c| self.factor.add_diagonal(c, held));
        self.factor.factorise()?;
        self.factor.solve(&mut rhs, 1);
        for (motion, part) in self.motions.iter_mut().zip(rhs.chunks(6)) {
            let turn = Vector3::new(part[0], part[1], part[2]);
            // Beyond half a radian the linear model is invalid.
            let share = 0.5 / turn.norm().max(0.5);
            motion.turn = UnitQuaternion::from_scaled_axis(turn * share) * motion.turn;
            motion.shift += Vector3::new(part[3], part[4], part[5]) * share;
        }
        let before = std::mem::take(&mut self.now);
        self.follow();
        Ok(max_or_nan(
            before.iter().zip(&self.now).map(|(a, b)| (b - a).norm()),
        ))
    }

    /// Adds the attraction of a vertex to its plane, and weakly to its point.
    fn draw(&mut self, d: &Drawn, points: f64, rhs: &mut [f64]) {
        let label = &self.clusters.labels[d.vertex];
        let (p, off) = (self.rest[d.vertex], self.now[d.vertex] - d.to);
        let directions = [
            (d.normal, 1.0),
            (Vector3::x(), points),
            (Vector3::y(), points),
            (Vector3::z(), points),
        ];
        let arms: Vec<(u32, f64, Vector3<f64>)> = label
            .iter()
            .map(|&(c, w)| (c, w, self.arm(c, &p)))
            .collect();
        for (n, weight) in directions {
            let row = |(c, w, arm): &(u32, f64, Vector3<f64>)| (*c, row(arm, &n, *w));
            let rows: Vec<(u32, Part)> = arms.iter().map(row).collect();
            self.add(&rows, n.dot(&off), weight, rhs);
        }
    }

    /// Adds the agreement that cluster `a` moves the representative of `b` as `b` does.
    fn agree(&mut self, a: u32, b: u32, weight: f64, rhs: &mut [f64]) {
        let arm = self.arm(a, &self.seed(b));
        let there = self.seed(a).coords + arm + self.motions[a as usize].shift;
        let off = there - self.seed(b).coords - self.motions[b as usize].shift;
        for n in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let rows = [
                (a, row(&arm, &n, 1.0)),
                (b, row(&Vector3::zeros(), &n, -1.0)),
            ];
            self.add(&rows, n.dot(&off), weight, rhs);
        }
    }

    fn add(&mut self, rows: &[(u32, Part)], residual: f64, weight: f64, rhs: &mut [f64]) {
        for (i, (a, u)) in rows.iter().enumerate() {
            for (k, value) in u.iter().enumerate() {
                rhs[6 * *a as usize + k] -= weight * residual * value;
            }
            for (b, v) in &rows[..=i] {
                let (low, high, block): (u32, u32, Block) = if a >= b {
                    (*b, *a, u * v.transpose() * weight)
                } else {
                    (*a, *b, v * u.transpose() * weight)
                };
                let columns: [[f64; 6]; 6] = block.into();
                self.factor.add(high, low, &columns);
            }
        }
    }

    /// Greatest angle between the rotations of two neighbouring clusters.
    fn bend(&self) -> f64 {
        let turn = |c: u32| self.motions[c as usize].turn;
        max_or_nan(
            self.clusters
                .neighbours
                .iter()
                .map(|&[a, b]| turn(a).angle_to(&turn(b))),
        )
    }
}

/// Derivative of n . (rotated arm + translation) with respect to rotation and translation.
fn row(arm: &Vector3<f64>, n: &Vector3<f64>, weight: f64) -> Part {
    let turn = arm.cross(n) * weight;
    let shift = n * weight;
    Part::from_column_slice(&[turn.x, turn.y, turn.z, shift.x, shift.y, shift.z])
}
