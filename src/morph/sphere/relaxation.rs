//! Relaxation with anchors \[alexa2000\], as corrected: errata M5 to M8 and M21.
//!
//! Vertices are projected to a sphere about a point inside the body and move to the centroid of
//! their neighbours. In the first phase four vertices near the corners of a tetrahedron are fixed,
//! in the second the four nearest to their antipodes. The method ends when no triangle is reversed.
//! It can fail: a long, evenly triangulated body collapses into two clusters (M21).

use nalgebra::{Point3, Vector3};

use super::centre::{bounding_sphere, inside_near};
use super::{SphereError, SphereMap, check, flipped};
use crate::mesh::TriangleMesh;
use crate::mesh::shapes::tetrahedron;
use crate::random::Random;

/// Parameters of the relaxation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxation {
    /// Greatest displacement of a vertex in a sweep that ends a phase, on the unit sphere.
    pub threshold: f64,
    /// Greatest number of sweeps of a phase.
    pub sweeps: usize,
    /// Greatest number of tetrahedra.
    pub attempts: usize,
    /// Greatest distance from the antipode of an anchor to the nearest vertex, on the unit sphere;
    /// beyond it the attempt counts as collapsed. The printed limit, the edge of a tetrahedron,
    /// cannot be exceeded (M5).
    pub gap: f64,
    /// Seed of the random tetrahedra.
    pub seed: u64,
    /// Position of the centre \[m\]; `None` for a point inside the body near the centre of its
    /// bounding sphere.
    pub centre: Option<Point3<f64>>,
}

impl Default for Relaxation {
    fn default() -> Self {
        Self {
            threshold: 1e-3,
            sweeps: 10_000,
            attempts: 5,
            gap: 0.5,
            seed: 1,
            centre: None,
        }
    }
}

/// Effort of a relaxation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// Number of tetrahedra.
    pub attempts: usize,
    /// Number of sweeps of the first phase of the last attempt.
    pub first: usize,
    /// Number of sweeps of its second phase, until no triangle was reversed.
    pub second: usize,
}

/// State of one attempt.
struct State<'a> {
    start: &'a [u32],
    neighbours: &'a [u32],
    points: Vec<Point3<f64>>,
    next: Vec<Point3<f64>>,
}

impl Relaxation {
    /// Maps a surface to the sphere.
    ///
    /// # Errors
    /// A surface that is no topological sphere, see [`check`]; no point inside; collapse or
    /// reversed triangles in every attempt.
    pub fn map(&self, mesh: &TriangleMesh) -> Result<(SphereMap, Effort), SphereError> {
        let topology = check(mesh)?;
        let centre = match self.centre {
            Some(centre) => centre,
            None => inside_near(mesh, &bounding_sphere(&mesh.vertices).0)?,
        };
        let thrown: Vec<Point3<f64>> = mesh
            .vertices
            .iter()
            .map(|v| thrown(&(v - centre)))
            .collect();
        let (start, neighbours) = topology.vertex_neighbours();
        let mut draws = Random::new(self.seed);
        let mut last = SphereError::Collapsed {
            attempts: 0,
            anchor: 0,
            gap: 0.0,
        };
        for attempt in 1..=self.attempts {
            let state = State {
                start: &start,
                neighbours: &neighbours,
                points: thrown.clone(),
                next: thrown.clone(),
            };
            match self.attempt(state, mesh, &mut draws) {
                Ok((points, first, second)) => {
                    let map = SphereMap::of_positions(points, mesh.triangles.clone())?;
                    return Ok((
                        map,
                        Effort {
                            attempts: attempt,
                            first,
                            second,
                        },
                    ));
                }
                Err(SphereError::Collapsed { anchor, gap, .. }) => {
                    last = SphereError::Collapsed {
                        attempts: attempt,
                        anchor,
                        gap,
                    };
                }
                Err(error) => last = error,
            }
        }
        Err(last)
    }

    fn attempt(
        &self,
        mut state: State<'_>,
        mesh: &TriangleMesh,
        draws: &mut Random,
    ) -> Result<(Vec<Point3<f64>>, usize, usize), SphereError> {
        let anchors = state.anchors(draws);
        let first = state.relax(&anchors, self.threshold, self.sweeps);
        let antipodes = anchors.map(|a| -state.points[a as usize]);
        let opposite = antipodes.map(|p| state.nearest(&p));
        let gaps: [f64; 4] =
            std::array::from_fn(|k| (state.points[opposite[k] as usize] - antipodes[k]).norm());
        let worst = (0..4)
            .max_by(|&i, &j| gaps[i].total_cmp(&gaps[j]))
            .unwrap_or(0);
        if !(gaps[worst] <= self.gap) {
            return Err(SphereError::Collapsed {
                attempts: 0,
                anchor: anchors[worst],
                gap: gaps[worst],
            });
        }
        let (mut second, mut threshold) = (0, self.threshold);
        loop {
            let left = self.sweeps - second;
            second += state.relax(&opposite, threshold, left);
            let bad = flipped(&state.points, &mesh.triangles);
            let Some(&triangle) = bad.first() else {
                return Ok((state.points, first, second));
            };
            threshold *= 0.5;
            // Below this value displacements are rounding error.
            if second >= self.sweeps || threshold < 1e-15 {
                let (flipped, triangles) = (bad.len(), mesh.triangles.len());
                return Err(SphereError::Flipped {
                    flipped,
                    triangles,
                    triangle,
                    sweeps: second,
                });
            }
        }
    }
}

/// A direction as a point of the unit sphere; the pole for a zero vector.
fn thrown(direction: &Vector3<f64>) -> Point3<f64> {
    Point3::from(direction.try_normalize(0.0).unwrap_or_else(Vector3::z))
}

impl State<'_> {
    /// The four vertices nearest to the corners of a random tetrahedron.
    fn anchors(&self, draws: &mut Random) -> [u32; 4] {
        let mut found = [0, 1, 2, 3];
        for _ in 0..100 {
            let turn = draws.rotation();
            let corners = tetrahedron().vertices;
            let nearest: [u32; 4] = std::array::from_fn(|k| self.nearest(&(turn * corners[k])));
            if (0..4).all(|i| (0..i).all(|j| nearest[i] != nearest[j])) {
                return nearest;
            }
            found = if nearest[0] > 3 {
                [nearest[0], 0, 1, 2]
            } else {
                found
            };
        }
        found
    }

    fn nearest(&self, to: &Point3<f64>) -> u32 {
        let square = |v: &u32| (self.points[*v as usize] - to).norm_squared();
        (0..self.points.len() as u32)
            .min_by(|a, b| square(a).total_cmp(&square(b)))
            .unwrap_or(0)
    }

    /// Moves all vertices but the fixed ones to the centroid of their neighbours, all at once.
    /// Returns the number of sweeps.
    fn relax(&mut self, held: &[u32; 4], threshold: f64, most: usize) -> usize {
        for sweep in 1..=most {
            let mut greatest = 0.0f64;
            for v in 0..self.points.len() {
                let ring = &self.neighbours[self.start[v] as usize..self.start[v + 1] as usize];
                let sum: Vector3<f64> = ring.iter().map(|&n| self.points[n as usize].coords).sum();
                // A vertex stays where its neighbours cancel out.
                self.next[v] = sum.try_normalize(0.0).map_or(self.points[v], Point3::from);
            }
            for &v in held {
                self.next[v as usize] = self.points[v as usize];
            }
            for (old, new) in self.points.iter().zip(&self.next) {
                greatest = greatest.max((new - old).norm_squared());
            }
            std::mem::swap(&mut self.points, &mut self.next);
            if greatest.sqrt() < threshold {
                return sweep;
            }
        }
        most
    }
}
