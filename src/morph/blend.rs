//! Interpolation between two shapes with common triangles.
//!
//! At t = 0 and t = 1 every blend equals its end shape.

use nalgebra::{Matrix3, Point3, UnitQuaternion, Vector3};

use super::align::rotation_of;
use crate::mesh::measures::{triangle_areas, volume};
use crate::mesh::{Topology, TriangleMesh};
use crate::solvers::sparse::{Factor, FactorError};

/// Error of a blend.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BlendError {
    /// The shapes have different numbers of vertices.
    #[error("{first} positions here and {second} there; both shapes must have the same vertices")]
    Counts {
        /// Number of the first shape, or the given number.
        first: usize,
        /// Number of the second shape, or the required number.
        second: usize,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {count}")]
    Vertex {
        /// Index of the triangle.
        triangle: usize,
        /// Index of the vertex.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A vertex has no connection to the others.
    #[error(
        "vertex {vertex} is not joined to vertex 0; the Laplacian of the shapes has no unique solution"
    )]
    Apart {
        /// Index of the vertex.
        vertex: u32,
    },
    /// The linear system has no solution.
    #[error(transparent)]
    Factor(#[from] FactorError),
}

/// The matrix of the rotation about `turn` by its length [rad].
fn matrix_of(turn: Vector3<f64>) -> Matrix3<f64> {
    *UnitQuaternion::from_scaled_axis(turn)
        .to_rotation_matrix()
        .matrix()
}

fn check(first: &[Point3<f64>], second: &[Point3<f64>]) -> Result<(), BlendError> {
    let (first, second) = (first.len(), second.len());
    if first == second {
        Ok(())
    } else {
        Err(BlendError::Counts { first, second })
    }
}

/// x(t) = (1 - t) x0 + t x1 \[m\].
///
/// # Errors
/// Shapes with different numbers of vertices.
pub fn linear(
    first: &[Point3<f64>],
    second: &[Point3<f64>],
    t: f64,
) -> Result<Vec<Point3<f64>>, BlendError> {
    check(first, second)?;
    Ok(first
        .iter()
        .zip(second)
        .map(|(a, b)| Point3::from(a.coords * (1.0 - t) + b.coords * t))
        .collect())
}

/// x(t) = h00 x0 + h10 g0 + h01 x1 + h11 g1, with the tangents `leaving` at t = 0 and `arriving` at t = 1 \[m\].
///
/// # Errors
/// Lists of different lengths.
pub fn hermite(
    ends: [&[Point3<f64>]; 2],
    leaving: &[Vector3<f64>],
    arriving: &[Vector3<f64>],
    t: f64,
) -> Result<Vec<Point3<f64>>, BlendError> {
    check(ends[0], ends[1])?;
    for tangents in [leaving, arriving] {
        if tangents.len() != ends[0].len() {
            return Err(BlendError::Counts {
                first: tangents.len(),
                second: ends[0].len(),
            });
        }
    }
    let (square, cube) = (t * t, t * t * t);
    let (h00, h01) = (2.0 * cube - 3.0 * square + 1.0, 3.0 * square - 2.0 * cube);
    let (h10, h11) = (cube - 2.0 * square + t, cube - square);
    let at = |i: usize| {
        ends[0][i].coords * h00 + leaving[i] * h10 + ends[1][i].coords * h01 + arriving[i] * h11
    };
    Ok((0..ends[0].len()).map(|i| Point3::from(at(i))).collect())
}

/// Tangents of [`hermite`] along the arcs of a rotation of the whole shape. At either end they are
/// the velocity of R(t) ((1 - t) a + t b) + c(t). Here a and b are both shapes about their centres,
/// b rotated back; R(t) is the part t of the best rotation from the one to the other, and c(t) the
/// interpolated centre.
///
/// # Errors
/// Shapes with different numbers of vertices.
pub fn turning(ends: [&[Point3<f64>]; 2]) -> Result<[Vec<Vector3<f64>>; 2], BlendError> {
    check(ends[0], ends[1])?;
    let (centres, whole) = whole_turn(ends);
    let (by, along) = (whole.to_rotation_matrix(), centres[1] - centres[0]);
    let axis = whole.scaled_axis();
    let both = || {
        ends[0]
            .iter()
            .zip(ends[1])
            .map(|(a, b)| (a.coords - centres[0], b.coords - centres[1]))
    };
    let leaving = both()
        .map(|(a, b)| axis.cross(&a) + by.inverse() * b - a + along)
        .collect();
    let arriving = both()
        .map(|(a, b)| axis.cross(&b) + b - by * a + along)
        .collect();
    Ok([leaving, arriving])
}

/// Centres of both shapes and the best rotation about them from the first to the second.
fn whole_turn(ends: [&[Point3<f64>]; 2]) -> ([Vector3<f64>; 2], UnitQuaternion<f64>) {
    let count = ends[0].len().max(1) as f64;
    let centres = ends.map(|x| x.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count);
    let about = ends[0]
        .iter()
        .zip(ends[1])
        .map(|(a, b)| (b.coords - centres[1]) * (a.coords - centres[0]).transpose());
    (centres, rotation_of(&about.sum()))
}

/// A path from one shape to another.
pub enum Path {
    /// Straight lines.
    Linear,
    /// Cubics with these tangents at either end.
    Hermite(Box<[Vec<Vector3<f64>>; 2]>),
    /// Rotated Laplacian vectors.
    Laplacian(Box<Laplacian>),
}

impl Path {
    /// The shape at t between the two ends of this path \[m\].
    ///
    /// # Errors
    /// Ends with another number of vertices.
    pub fn at(
        &mut self,
        ends: [&[Point3<f64>]; 2],
        t: f64,
    ) -> Result<Vec<Point3<f64>>, BlendError> {
        match self {
            Self::Linear => linear(ends[0], ends[1], t),
            Self::Hermite(tangents) => hermite(ends, &tangents[0], &tangents[1], t),
            Self::Laplacian(blend) => Ok(blend.at(t)),
        }
    }
}

/// Interpolation of rotated Laplacian vectors: preserves size and volume where parts rotate.
///
/// The source interpolates delta_i = sum_j w_ij (x_j - x_i) linearly and solves L x = delta(t).
/// With one matrix L this is the linear blend again, since both are linear in the positions. Here
/// each vertex has the rotation R_i that best takes its neighbourhood from the first shape to the
/// second. An intermediate edge is the blend of the first edge and of the second edge rotated back,
/// rotated by the part t of R_i. A rotation of the whole shape is removed before and applied after.
///
/// A neighbourhood is some [`REACH`] of the shape wide. Single rings of unlike shapes turn against
/// each other by where the map has put their triangles, and edges that keep their lengths at such
/// rotations swell and pit the shape. What is left of that goes by an even shift along the normals:
/// the volume of a closed shape is that of a body whose size is the blend of both sizes.
pub struct Laplacian {
    triangles: Vec<[u32; 3]>,
    /// An open shape has no volume.
    is_closed: bool,
    /// Volumes of both ends \[m^3\].
    volumes: [f64; 2],
    first: Vec<Point3<f64>>,
    second: Vec<Point3<f64>>,
    edges: Vec<[u32; 2]>,
    weights: Vec<f64>,
    /// Rotation of each vertex's ring relative to that of the whole shape, as a rotation vector
    /// \[rad\].
    turns: Vec<Vector3<f64>>,
    /// Rotation of the whole shape.
    whole: Vector3<f64>,
    centres: [Vector3<f64>; 2],
    factor: Factor<1>,
}

/// Width of the neighbourhood of a vertex's rotation, relative to the root of the area of the shape.
const REACH: f64 = 0.15;
/// Greatest number of steps of the shift along the normals, by Newton's method.
const SHIFTS: usize = 8;
/// Relative error of the volume at which it ends: some roundings.
const ROUND: f64 = 1e-12;
/// Least weight of an edge relative to the mean. Cotangents are negative where two opposite angles
/// exceed 180 degrees together. Merged surfaces are full of slivers and have hundreds of them; the
/// matrix is then not positive definite and has no Cholesky factor. The weights only distribute the
/// disagreement of the rotated edges, so any positive weights reproduce both ends. On evenly
/// triangulated surfaces no bound is active.
const LEAST: f64 = 1e-2;
/// Greatest weight relative to the mean: cotangents of slivers are unbounded, and one would
/// dominate all others of its vertices.
const MOST: f64 = 1e2;

impl Laplacian {
    /// Prepares the blend: rotations, weights, and the factorised matrix.
    ///
    /// # Errors
    /// Shapes with different numbers of vertices, triangles with invalid vertices, or vertices
    /// without a connection to the rest.
    pub fn new(
        first: &[Point3<f64>],
        second: &[Point3<f64>],
        triangles: &[[u32; 3]],
    ) -> Result<Self, BlendError> {
        check(first, second)?;
        let count = first.len();
        for (triangle, t) in triangles.iter().enumerate() {
            if let Some(&vertex) = t.iter().find(|v| **v as usize >= count) {
                return Err(BlendError::Vertex {
                    triangle,
                    vertex,
                    count,
                });
            }
        }
        let topology = Topology::of_triangles(count, triangles);
        if let Some(vertex) = topology.components().labels.iter().position(|&l| l != 0) {
            return Err(BlendError::Apart {
                vertex: vertex as u32,
            });
        }
        let weights = weights(&topology, triangles, [first, second]);
        let is_closed = topology.is_closed() && topology.is_oriented();
        let edges = topology.edges;
        let mut factor = Factor::new(count, &edges)?;
        for (&[a, b], &w) in edges.iter().zip(&weights) {
            factor.add(b, a, &[[-w]]);
            factor.add_diagonal(a, w);
            factor.add_diagonal(b, w);
        }
        // Vertex 0 is held near its linear blend; all vertices move to the interpolated centre
        // afterwards.
        factor.add_diagonal(0, weights.iter().sum::<f64>() / weights.len().max(1) as f64);
        factor.factorise()?;
        let (centres, whole) = whole_turn([first, second]);
        let mut products = vec![Matrix3::zeros(); count];
        for (&[a, b], &w) in edges.iter().zip(&weights) {
            let (before, after) = (
                first[b as usize] - first[a as usize],
                second[b as usize] - second[a as usize],
            );
            let product = after * before.transpose() * w;
            products[a as usize] += product;
            products[b as usize] += product;
        }
        spread(&mut products, [first, second], triangles, &edges, &weights)?;
        let back = whole.inverse().to_rotation_matrix();
        let turns = products
            .iter()
            .map(|m| rotation_of(&(back.matrix() * m)).scaled_axis())
            .collect();
        let volumes = [first, second].map(|x| volume(x, triangles));
        let (first, second) = (first.to_vec(), second.to_vec());
        Ok(Self {
            triangles: triangles.to_vec(),
            is_closed,
            volumes,
            first,
            second,
            edges,
            weights,
            turns,
            whole: whole.scaled_axis(),
            centres,
            factor,
        })
    }

    /// The shape at t \[m\].
    pub fn at(&mut self, t: f64) -> Vec<Point3<f64>> {
        let count = self.first.len();
        let whole = UnitQuaternion::from_scaled_axis(self.whole);
        let back = whole.inverse().to_rotation_matrix();
        // Both shapes about their centres, the second rotated back.
        let start: Vec<Vector3<f64>> = self
            .first
            .iter()
            .map(|p| p.coords - self.centres[0])
            .collect();
        let end: Vec<Vector3<f64>> = self
            .second
            .iter()
            .map(|p| back * (p.coords - self.centres[1]))
            .collect();
        let straight: Vec<Vector3<f64>> = start
            .iter()
            .zip(&end)
            .map(|(a, b)| a * (1.0 - t) + b * t)
            .collect();
        let turned: Vec<_> = self
            .turns
            .iter()
            .map(|turn| (matrix_of(turn * t), matrix_of(turn * (t - 1.0))))
            .collect();
        // Solves for the difference to the linear blend, so that it is zero at either end.
        let mut rhs = vec![0.0; 3 * count];
        for (&[a, b], &w) in self.edges.iter().zip(&self.weights) {
            let (a, b) = (a as usize, b as usize);
            let (before, after) = (start[b] - start[a], end[b] - end[a]);
            let bent = |v: usize| turned[v].0 * before * (1.0 - t) + turned[v].1 * after * t;
            let lack = ((bent(a) + bent(b)) * 0.5 - (straight[b] - straight[a])) * w;
            for k in 0..3 {
                rhs[k * count + a] -= lack[k];
                rhs[k * count + b] += lack[k];
            }
        }
        self.factor.solve(&mut rhs, 3);
        let added = |i: usize| Vector3::new(rhs[i], rhs[count + i], rhs[2 * count + i]);
        let middle = (0..count).map(added).sum::<Vector3<f64>>() / count.max(1) as f64;
        let centre = self.centres[0] * (1.0 - t) + self.centres[1] * t;
        let forward = UnitQuaternion::from_scaled_axis(self.whole * t).to_rotation_matrix();
        let mut shape: Vec<Point3<f64>> = (0..count)
            .map(|i| Point3::from(centre + forward * (straight[i] + added(i) - middle)))
            .collect();
        if t > 0.0 && t < 1.0 && self.is_closed {
            self.shift(&mut shape, t);
        }
        shape
    }

    /// Shifts all vertices evenly along their normals until the volume is that of a body whose
    /// size is the blend of both.
    fn shift(&self, shape: &mut [Point3<f64>], t: f64) {
        let [a, b] = self.volumes.map(libm::cbrt);
        let size = a * (1.0 - t) + b * t;
        let goal = size * size * size;
        if !(self.volumes[0] > 0.0 && self.volumes[1] > 0.0) {
            return;
        }
        for _ in 0..SHIFTS {
            let lack = goal - volume(shape, &self.triangles);
            if lack.abs() <= ROUND * goal {
                return;
            }
            let now = TriangleMesh {
                vertices: shape.to_vec(),
                triangles: self.triangles.clone(),
            };
            let normals: Vec<Vector3<f64>> = now
                .vertex_normals()
                .iter()
                .map(|n| n.try_normalize(0.0).unwrap_or_default())
                .collect();
            // The derivative of the volume by the shift.
            let mut slope = 0.0;
            for (t, [a, b, c]) in (0..now.triangles.len()).map(|t| (t, now.corners(t))) {
                let third = (b - a).cross(&(c - a)) / 6.0;
                let corners = self.triangles[t].map(|v| normals[v as usize]);
                slope += third.dot(&(corners[0] + corners[1] + corners[2]));
            }
            if !(slope > 0.0) {
                return;
            }
            for (p, normal) in shape.iter_mut().zip(normals) {
                *p += normal * (lack / slope);
            }
        }
    }
}

/// Diffuses a matrix of each vertex over its neighbourhood.
fn spread(
    products: &mut [Matrix3<f64>],
    shapes: [&[Point3<f64>]; 2],
    triangles: &[[u32; 3]],
    edges: &[[u32; 2]],
    weights: &[f64],
) -> Result<(), BlendError> {
    let count = products.len();
    let mut areas = vec![0.0; count];
    for x in shapes {
        for (t, area) in triangles.iter().zip(triangle_areas(x, triangles)) {
            t.iter().for_each(|&v| areas[v as usize] += area / 6.0);
        }
    }
    let whole: f64 = areas.iter().sum();
    // Vertices of triangles without area have the least part of the whole.
    let least = LEAST * whole / count.max(1) as f64;
    let conductance = REACH * REACH * whole;
    let mut factor = Factor::<1>::new(count, edges)?;
    for (&[a, b], &w) in edges.iter().zip(weights) {
        factor.add(b, a, &[[-w * conductance]]);
        factor.add_diagonal(a, w * conductance);
        factor.add_diagonal(b, w * conductance);
    }
    for (v, area) in areas.iter().enumerate() {
        factor.add_diagonal(v as u32, area.max(least));
    }
    factor.factorise()?;
    for j in 0..3 {
        let mut column = vec![0.0; 3 * count];
        for (v, product) in products.iter().enumerate() {
            (0..3).for_each(|i| column[i * count + v] = product[(i, j)]);
        }
        factor.solve(&mut column, 3);
        for (v, product) in products.iter_mut().enumerate() {
            (0..3).for_each(|i| product[(i, j)] = column[i * count + v]);
        }
    }
    Ok(())
}

/// Half the cotangents of the angles opposite each edge, mean of both shapes, bounded relative to
/// their mean.
fn weights(topology: &Topology, triangles: &[[u32; 3]], shapes: [&[Point3<f64>]; 2]) -> Vec<f64> {
    let mut sums = vec![0.0; topology.edges.len()];
    for x in shapes {
        for (t, corners) in triangles.iter().enumerate() {
            for k in 0..3 {
                let at = |j: usize| x[corners[(k + j) % 3] as usize];
                let (u, v) = (at(0) - at(2), at(1) - at(2));
                let cotangent = u.dot(&v) / u.cross(&v).norm();
                let bounded = if cotangent.is_finite() {
                    cotangent.clamp(-MOST, MOST)
                } else {
                    MOST
                };
                sums[topology.triangle_edges[t][k] as usize] += 0.25 * bounded;
            }
        }
    }
    let mean = sums.iter().map(|w| w.abs()).sum::<f64>() / sums.len().max(1) as f64;
    let mean = if mean > 0.0 { mean } else { 1.0 };
    sums.iter_mut()
        .for_each(|w| *w = w.clamp(LEAST * mean, MOST * mean));
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn bounds_on_weights_are_met_by_slivers_only() {
        let ball = icosphere(1.0, 3);
        let at_bounds = |x: &[Point3<f64>], triangles: &[[u32; 3]]| {
            let topology = Topology::of_triangles(x.len(), triangles);
            let found = weights(&topology, triangles, [x, x]);
            let least = found.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(least > 0.0);
            found.iter().filter(|w| **w == least).count()
        };
        assert!(
            at_bounds(&ball.vertices, &ball.triangles) < 100,
            "an even ball has weights of its own"
        );
        // Flattened to a hundredth, opposite angles exceed half a turn: weights would be negative.
        let flat: Vec<Point3<f64>> = ball
            .vertices
            .iter()
            .map(|p| Point3::new(p.x, p.y, 0.01 * p.z))
            .collect();
        let thin: Vec<Point3<f64>> = flat
            .iter()
            .map(|p| Point3::new(p.x, 0.1 * p.y, p.z))
            .collect();
        assert!(at_bounds(&thin, &ball.triangles) > 100);
    }
}
