//! The energy of cords under tone: edges that pull at every length, the more the longer they are.

use nalgebra::{Matrix3, Point3, Vector3};

use super::potential::Potential;
use crate::constraints::distance::Distance;
use crate::mesh::sum::NeumaierSum;
use crate::state::{DecodeError, Reader, State, Writer};

/// How fast the force of passive muscle grows with its strain: by a factor e each time that the strain grows by the
/// inverse of this. The exponent 4 over the strain 0.6 at the greatest isometric force \[thelen2003\].
pub const STEEPNESS: f64 = 4.0 / 0.6;

/// The energy `sum k d^2 exp(a e) / a^2` over edges of rest length `d` and strain `e`, `a` being [`STEEPNESS`]. The force of an
/// edge grows from `k d / a` at rest by the exponential law of passive muscle. The energy is convex and smooth: a net of such
/// cords has one way to be taut, none to buckle, and no length at which it suddenly becomes slack.
#[derive(Clone, Debug)]
pub struct Tension {
    edges: Vec<Distance>,
    /// [N/m], one an edge.
    stiffness: Vec<f64>,
}

/// An edge as it is.
struct Cord {
    /// Its vector [m].
    vector: Vector3<f64>,
    length: f64,
    /// Its force [N].
    force: f64,
    /// Its change by length [N/m].
    slope: f64,
}

impl Tension {
    /// Edges with a stiffness at rest [N/m] each.
    pub fn new(edges: Vec<Distance>, stiffness: Vec<f64>) -> Self {
        Self { edges, stiffness }
    }

    /// The forces [N] on the vertices of a shape `x` [m] that balance edges which pull as at rest, whatever their lengths.
    pub fn support(&self, x: &[Point3<f64>]) -> Vec<Vector3<f64>> {
        let mut forces = vec![Vector3::zeros(); x.len()];
        for (edge, k) in self.edges.iter().zip(&self.stiffness) {
            let [a, b] = edge.points.map(|p| p as usize);
            let along = (x[a] - x[b])
                .try_normalize(0.0)
                .unwrap_or_else(Vector3::zeros);
            let force = along * (k * edge.rest / STEEPNESS);
            forces[a] += force;
            forces[b] -= force;
        }
        forces
    }

    fn cord(&self, e: usize, x: &[Point3<f64>]) -> Cord {
        let Distance {
            points: [a, b],
            rest,
        } = self.edges[e];
        let vector = x[a as usize] - x[b as usize];
        let length = vector.norm();
        let slope = self.stiffness[e] * libm::exp(STEEPNESS * (length - rest) / rest);
        Cord {
            vector,
            length,
            force: slope * rest / STEEPNESS,
            slope,
        }
    }

    /// Energy of an edge [J].
    fn of(&self, e: usize, cord: &Cord) -> f64 {
        cord.force * self.edges[e].rest / STEEPNESS
    }
}

impl Potential for Tension {
    fn name(&self) -> &'static str {
        "tension"
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        (0..self.edges.len()).for_each(|e| sum.add(self.of(e, &self.cord(e, x))));
        sum.total()
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        for (e, edge) in self.edges.iter().enumerate() {
            let cord = self.cord(e, x);
            sum.add(self.of(e, &cord));
            // An edge without extent pulls in no direction.
            let pull = if cord.length > 0.0 {
                cord.vector * (cord.force / cord.length)
            } else {
                Vector3::zeros()
            };
            gradient[edge.points[0] as usize] += pull;
            gradient[edge.points[1] as usize] -= pull;
        }
        sum.total()
    }

    fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        self.edges
            .iter()
            .for_each(|e| pair(e.points[0], e.points[1]));
    }

    fn hessian(&self, x: &[Point3<f64>], _: bool, add: &mut dyn FnMut(u32, u32, &Matrix3<f64>)) {
        for (e, edge) in self.edges.iter().enumerate() {
            let cord = self.cord(e, x);
            if !(cord.length > 0.0) {
                continue;
            }
            let unit = cord.vector / cord.length;
            let across = cord.force / cord.length;
            let block =
                Matrix3::identity() * across + unit * unit.transpose() * (cord.slope - across);
            let [a, b] = edge.points;
            add(a, a, &block);
            add(b, b, &block);
            add(a, b, &-block);
            add(b, a, &-block);
        }
    }

    fn scalar_hessian(&self, _: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        for (edge, &k) in self.edges.iter().zip(&self.stiffness) {
            let [a, b] = edge.points;
            add(a, a, k);
            add(b, b, k);
            add(a, b, -k);
            add(b, a, -k);
        }
    }

    fn force_scale(&self, _: &[Point3<f64>]) -> f64 {
        let squares: f64 = self
            .edges
            .iter()
            .zip(&self.stiffness)
            .map(|(e, k)| (k * e.rest).powi(2))
            .sum();
        (squares / self.edges.len().max(1) as f64).sqrt()
    }

    fn remember(&mut self, _: &[Point3<f64>]) {}

    fn bytes(&self) -> usize {
        self.edges.capacity() * std::mem::size_of::<Distance>() + self.stiffness.capacity() * 8
    }
}

/// It knows nothing but its edges.
impl State for Tension {
    fn save(&self, _: &mut Writer) {}

    fn restore(&mut self, _: &mut Reader<'_>) -> Result<(), DecodeError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Draw;

    /// Cords of which some are shorter and some longer than at rest.
    fn drawn() -> (Tension, Vec<Point3<f64>>) {
        let mut draw = Draw::new(11);
        let x = draw.shape(6);
        let mut edges = Vec::new();
        for a in 0..6u32 {
            for b in 0..a {
                let length = (x[a as usize] - x[b as usize]).norm();
                let share = if (a + b) % 2 == 0 { 0.8 } else { 1.25 };
                edges.push(Distance {
                    points: [a, b],
                    rest: share * length,
                });
            }
        }
        let stiffness = edges.iter().map(|_| draw.between(10.0, 300.0)).collect();
        (Tension::new(edges, stiffness), x)
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let (part, x) = drawn();
        let mut gradient = vec![Vector3::zeros(); 6];
        let energy = part.energy_and_gradient(&x, &mut gradient);
        assert_eq!(part.energy(&x), energy);
        let scale = part.force_scale(&x);
        let mut hessian = nalgebra::SMatrix::<f64, 18, 18>::zeros();
        part.hessian(&x, false, &mut |a, b, block| {
            let mut view = hessian.fixed_view_mut::<3, 3>(3 * a as usize, 3 * b as usize);
            view += block;
        });
        // Central differences with the step that balances truncation and rounding.
        let h = 1e-5;
        for v in 0..6 {
            for c in 0..3 {
                let (mut up, mut down) = (x.clone(), x.clone());
                up[v][c] += h;
                down[v][c] -= h;
                let slope = (part.energy(&up) - part.energy(&down)) / (2.0 * h);
                assert!(
                    (slope - gradient[v][c]).abs() <= 1e-8 * scale,
                    "{slope} {}",
                    gradient[v][c]
                );
                assert!(
                    (slope - 1.001 * gradient[v][c]).abs() > 1e-8 * scale,
                    "control"
                );
                let (mut g, mut l) = (vec![Vector3::zeros(); 6], vec![Vector3::zeros(); 6]);
                part.energy_and_gradient(&up, &mut g);
                part.energy_and_gradient(&down, &mut l);
                for w in 0..6 {
                    for d in 0..3 {
                        let change = (g[w][d] - l[w][d]) / (2.0 * h);
                        let wanted = hessian[(3 * w + d, 3 * v + c)];
                        assert!((change - wanted).abs() <= 1e-6 * 300.0, "{change} {wanted}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_shape_at_rest_lengths_is_in_balance_with_its_support() {
        let (part, _) = drawn();
        let x = Draw::new(5).shape(6);
        let at_rest = |e: &Distance| {
            let [a, b] = e.points.map(|p| x[p as usize]);
            Distance {
                points: e.points,
                rest: (a - b).norm(),
            }
        };
        let edges: Vec<Distance> = part.edges.iter().map(at_rest).collect();
        let balanced = Tension::new(edges, part.stiffness.clone());
        let greatest = |x: &[Point3<f64>]| {
            let mut gradient = vec![Vector3::zeros(); 6];
            balanced.energy_and_gradient(x, &mut gradient);
            let left = gradient
                .iter()
                .zip(balanced.support(x))
                .map(|(g, f)| (g - f).norm());
            crate::mesh::measures::max_or_nan(left)
        };
        let scale = balanced.force_scale(&x);
        assert!(greatest(&x) <= 1e-13 * scale, "{}", greatest(&x));
        let longer: Vec<Point3<f64>> = x.iter().map(|p| p * 1.1).collect();
        assert!(
            greatest(&longer) > 0.01 * scale,
            "control: longer edges pull"
        );
    }
}
