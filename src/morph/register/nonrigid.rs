//! Bending one surface onto another: clusters that each turn and move as one, blended over the surface.
//!
//! After the scheme of \[huang2008\]: representatives are spread evenly over the surface, each leads a cluster that moves by one
//! turn and shift about it, and a vertex follows the clusters near it along the surface, with weights that end smoothly. What
//! is nearest on the other surface draws vertices to its tangent plane, and a little to itself; clusters that are neighbours
//! shall agree on where each other's representative goes. That agreement is stiff at first, so that the whole turns before parts
//! bend, and is let go by and by. It is the embedded deformation of \[sumner2007\] with rotations in place of affine maps.

mod clusters;

use nalgebra::{Point3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::{RegisterError, Surface};
use crate::mesh::measures::{greatest, median};
use crate::progress::Progress;
use crate::solvers::sparse::Factor;
use clusters::Clusters;

/// Settings of the bending.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonRigid {
    /// Clusters at most; fewer where there are fewer vertices.
    pub clusters: usize,
    /// Weight of agreement over that of the data at first, and the least that it is let go to.
    pub stiffness: [f64; 2],
    /// Weight of the distance between points, over that from planes.
    pub points: f64,
    /// Vertices further from the other surface than so many times the median are not drawn, unless they are within reach.
    pub reject: f64,
    /// How far all vertices are drawn, over the size of the other surface: what is to bend is off it by much here and there.
    pub reach: f64,
    /// Rounds at most.
    pub rounds: usize,
    /// Stiffness is let go when no vertex moves further in a round, over the size of the other surface, or after eight rounds; at
    /// its least the bending ends when no vertex does, or when distances get no less for long.
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

/// A surface that was bent.
#[derive(Clone, Debug, PartialEq)]
pub struct Bent {
    /// Its vertices \[m\].
    pub points: Vec<Point3<f64>>,
    /// The cluster of the nearest representative, for each vertex.
    pub clusters: Vec<u32>,
    /// How many clusters there are.
    pub count: usize,
    /// Rounds made.
    pub rounds: usize,
    /// Whether it ended by its threshold.
    pub converged: bool,
    /// Vertices that were drawn in the last round.
    pub pairs: usize,
    /// Greatest angle between the turns of two neighbours \[rad\].
    pub bend_max: f64,
}

/// How much less stiff it gets at a time, and after how many rounds at the latest.
const LET_GO: f64 = 0.5;
const EACH: usize = 8;
/// Distances that get less by less than this for so many rounds are at rest: pairs come and go in turn.
const BETTER: f64 = 1e-3;
const PATIENCE: usize = 12;
/// Vertices face what they are drawn to within 60 degrees.
const FACING: f64 = 0.5;
/// Against turns that no data determine, over the mean of the diagonal: rounding must not make the matrix indefinite.
const HELD: f64 = 1e-9;

/// The motion of a cluster.
#[derive(Clone, Copy)]
struct Motion {
    turn: UnitQuaternion<f64>,
    shift: Vector3<f64>,
}

/// A vertex that is drawn, in units of the size.
struct Drawn {
    vertex: usize,
    to: Point3<f64>,
    normal: Vector3<f64>,
}

impl NonRigid {
    /// Bends a surface, `start` being where its vertices are to begin with.
    ///
    /// # Errors
    /// Hardly any vertex is near the other surface, or the system cannot be solved.
    pub fn run(
        &self,
        moving: &Surface<'_>,
        fixed: &Surface<'_>,
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
                    of: start.len(),
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

/// What is being bent, in units of the size of the other surface.
struct Bending<'a> {
    fixed: &'a Surface<'a>,
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
        moving: &'a Surface<'a>,
        fixed: &'a Surface<'a>,
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

    /// The arm of a vertex about a representative, turned with its cluster.
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

    /// What vertices are drawn to: the nearest place that faces the same way, unless it is at a rim or far off.
    fn drawn(&self, reject: f64, reach: f64) -> Vec<Drawn> {
        let normals = crate::mesh::TriangleMesh {
            vertices: self.now.clone(),
            triangles: self.triangles.to_vec(),
        };
        let normals = normals.vertex_normals();
        let mut all: Vec<(f64, Drawn)> = Vec::new();
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
        let limit = reject * median(all.iter().map(|(d, _)| *d).collect()).unwrap_or(0.0);
        let limit = limit.max(reach * self.size);
        all.into_iter()
            .filter(|(d, _)| *d <= limit)
            .map(|(_, drawn)| drawn)
            .collect()
    }

    /// Mean square of the distances of what is drawn from the planes it is drawn to, over the size.
    fn off(&self, drawn: &[Drawn]) -> f64 {
        let square = |d: &Drawn| d.normal.dot(&(self.now[d.vertex] - d.to)).powi(2);
        drawn.iter().map(square).sum::<f64>() / drawn.len().max(1) as f64
    }

    /// One step of Gauss and Newton; how far a vertex moved at most.
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
            // Beyond half a radian the linear model says nothing.
            let share = 0.5 / turn.norm().max(0.5);
            motion.turn = UnitQuaternion::from_scaled_axis(turn * share) * motion.turn;
            motion.shift += Vector3::new(part[3], part[4], part[5]) * share;
        }
        let before = std::mem::take(&mut self.now);
        self.follow();
        Ok(greatest(
            before.iter().zip(&self.now).map(|(a, b)| (b - a).norm()),
        ))
    }

    /// A vertex is drawn to the plane, and a little to the point.
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

    /// Cluster `a` shall take the representative of `b` where `b` does.
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

    /// Greatest angle between the turns of two neighbours.
    fn bend(&self) -> f64 {
        let turn = |c: u32| self.motions[c as usize].turn;
        greatest(
            self.clusters
                .neighbours
                .iter()
                .map(|&[a, b]| turn(a).angle_to(&turn(b))),
        )
    }
}

/// Derivative of n . (turned arm + shift) by turn and shift.
fn row(arm: &Vector3<f64>, n: &Vector3<f64>, weight: f64) -> Part {
    let turn = arm.cross(n) * weight;
    let shift = n * weight;
    Part::from_column_slice(&[turn.x, turn.y, turn.z, shift.x, shift.y, shift.z])
}
