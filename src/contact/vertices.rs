//! Vertices of a muscle against one obstacle.

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::response::Travel;
use super::{Closest, Obstacle, Placed};

/// A vertex further away than this many thicknesses has no row, only a bound that says when to look again.
const NEAR: f64 = 4.0;

/// Steps of a walk along a suspicious path before it is given up where it is.
const WALK: usize = 64;

/// The known surroundings of one vertex, in the frame of the obstacle.
#[derive(Clone, Copy, Debug)]
struct Known {
    /// Where it was looked up.
    from: Point3<f64>,
    /// What was found: the ball about `from` with this distance as radius is free.
    closest: Closest,
    /// Travel of the whole muscle at which a far vertex is looked up again.
    wake: f64,
}

/// A row: a vertex and the plane that it must stay over.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    /// The vertex.
    pub vertex: u32,
    /// A point of the plane in the world [m].
    pub origin: Point3<f64>,
    /// Normal in the world.
    pub normal: Vector3<f64>,
    /// Sum of the corrections along the normal in this step [m].
    pub push: f64,
}

impl Row {
    /// Height over the plane [m].
    pub fn height(&self, x: &[Point3<f64>]) -> f64 {
        (x[self.vertex as usize] - self.origin).dot(&self.normal)
    }
}

/// What is known about each free vertex of a muscle with respect to one obstacle.
#[derive(Clone, Debug)]
pub(super) struct VertexContacts {
    vertices: Vec<u32>,
    known: Vec<Known>,
    /// Rows of near vertices, by vertex.
    pub rows: Vec<Row>,
    thickness: f64,
    /// Lookups done.
    pub lookups: u64,
    /// Walks that ended before their target.
    pub stopped: u64,
}

impl VertexContacts {
    /// Looks every vertex of `vertices` up once.
    pub fn new(placed: &Placed, vertices: &[u32], x: &[Point3<f64>], thickness: f64) -> Self {
        let inverse = placed.now.inverse();
        let known = vertices
            .par_iter()
            .map(|&v| look(&*placed.obstacle, inverse * x[v as usize], 0.0, thickness))
            .collect();
        Self { vertices: vertices.to_vec(), known, rows: Vec::new(), thickness, lookups: vertices.len() as u64, stopped: 0 }
    }

    /// Looks up again whatever may have used up its bound, walks vertices back that may have passed through, and makes
    /// the rows of this step. `travel` is a bound on the relative motion of every vertex so far [m].
    pub fn update(&mut self, placed: &Placed, x: &mut [Point3<f64>], travel: Travel) {
        let inverse = placed.now.inverse();
        let near = NEAR * self.thickness;
        let (known, vertices, thickness) = (&self.known, &self.vertices, self.thickness);
        let obstacle = &*placed.obstacle;
        let positions: &[Point3<f64>] = x;
        let due: Vec<u32> = (0..known.len() as u32)
            .filter(|&k| {
                let Known { from, closest, wake } = &known[k as usize];
                if closest.distance > near {
                    return *wake <= travel.at_most;
                }
                let at = inverse * positions[vertices[k as usize] as usize];
                !(2.0 * (at - from).norm() <= closest.distance)
            })
            .collect();
        let found: Vec<(Known, Option<Point3<f64>>, bool)> = due
            .par_iter()
            .with_min_len(32)
            .map(|&k| {
                let before = &known[k as usize];
                let at = inverse * positions[vertices[k as usize] as usize];
                // Inside the free ball nothing can have been crossed.
                if before.closest.distance <= 0.0 || (at - before.from).norm() < before.closest.distance {
                    return (look(obstacle, at, travel.at_least, thickness), None, false);
                }
                let (end, arrived) = walk(obstacle, &before.from, &at, thickness);
                (look(obstacle, end, travel.at_least, thickness), (end != at).then_some(end), !arrived)
            })
            .collect();
        self.lookups += due.len() as u64;
        for (&k, (known, moved, stopped)) in due.iter().zip(found) {
            self.known[k as usize] = known;
            if let Some(end) = moved {
                x[self.vertices[k as usize] as usize] = placed.now * end;
            }
            self.stopped += u64::from(stopped);
        }
        self.make_rows(&placed.now);
    }

    fn make_rows(&mut self, pose: &Isometry3<f64>) {
        let near = NEAR * self.thickness;
        self.rows.clear();
        for (known, &vertex) in self.known.iter().zip(&self.vertices) {
            if known.closest.distance <= near {
                let (origin, normal) = (pose * known.closest.point, pose * known.closest.normal);
                self.rows.push(Row { vertex, origin, normal, push: 0.0 });
            }
        }
    }

    /// Greatest depth of a vertex under the surface as known now [m], 0 where none is inside.
    pub fn deepest(&self, x: &[Point3<f64>]) -> f64 {
        self.rows.iter().map(|r| -r.height(x)).fold(0.0, f64::max)
    }

    pub fn bytes(&self) -> usize {
        self.known.capacity() * std::mem::size_of::<Known>()
            + self.vertices.capacity() * 4
            + self.rows.capacity() * std::mem::size_of::<Row>()
    }
}

fn look(obstacle: &dyn Obstacle, at: Point3<f64>, travel: f64, thickness: f64) -> Known {
    let closest = obstacle.closest(&at).unwrap_or(Closest {
        distance: f64::MAX,
        normal: Vector3::zeros(),
        point: at,
    });
    let bound = (closest.distance / 2.0).max(closest.distance - NEAR / 2.0 * thickness);
    Known { from: at, closest, wake: travel + bound }
}

/// Goes from a free point towards a target in steps that cannot cross the surface, sliding along it.
fn walk(obstacle: &dyn Obstacle, from: &Point3<f64>, to: &Point3<f64>, thickness: f64) -> (Point3<f64>, bool) {
    let mut at = *from;
    let mut left = to - from;
    for _ in 0..WALK {
        let Some(closest) = obstacle.closest(&at) else { return (*to, true) };
        let height = closest.distance;
        if height < left.norm() {
            // What points into the obstacle is spent; the rest slides.
            let inward = left.dot(&closest.normal);
            if inward < 0.0 && height <= thickness {
                left -= closest.normal * inward;
            }
        }
        let length = left.norm();
        if length == 0.0 {
            return (at, true);
        }
        let step = length.min((height * 0.5).max(0.0));
        if step == length {
            return (at + left, true);
        }
        if !(step > 1e-3 * thickness) {
            return (at, false);
        }
        let by = left * (step / length);
        at += by;
        left -= by;
    }
    (at, false)
}
