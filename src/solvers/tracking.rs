//! The energy of departing from a shape that is prescribed: what keeps a muscle as near as contact and volume let it to
//! where its bones' motion alone would carry it.

use nalgebra::{Matrix3, Point3, Vector3};

use super::potential::Potential;
use crate::mesh::sum::NeumaierSum;
use crate::state::{DecodeError, Reader, State, Writer};

/// The energy `sum k |d_a - d_b|^2 / 2` over edges, `d` the displacement from the target: a membrane of corrections. It
/// is quadratic, so that without obstacles its minimum is unique and moves smoothly with the target.
#[derive(Clone, Debug)]
pub struct Tracking {
    edges: Vec<[u32; 2]>,
    /// [N/m], one an edge.
    stiffness: Vec<f64>,
    /// Where every vertex would be [m].
    target: Vec<Point3<f64>>,
}

impl Tracking {
    /// Edges with a stiffness [N/m] each, over vertices that are where they should be.
    pub fn new(edges: Vec<[u32; 2]>, stiffness: Vec<f64>, target: Vec<Point3<f64>>) -> Self {
        Self {
            edges,
            stiffness,
            target,
        }
    }

    fn each<'a>(
        &'a self,
        x: &'a [Point3<f64>],
    ) -> impl Iterator<Item = ([usize; 2], Vector3<f64>, f64)> + 'a {
        let displacement = |v: usize| x[v] - self.target[v];
        self.edges
            .iter()
            .zip(&self.stiffness)
            .map(move |(edge, k)| {
                let [a, b] = edge.map(|v| v as usize);
                ([a, b], displacement(a) - displacement(b), *k)
            })
    }
}

impl Potential for Tracking {
    fn name(&self) -> &'static str {
        "tracking"
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        self.each(x)
            .for_each(|(_, d, k)| sum.add(0.5 * k * d.norm_squared()));
        sum.total()
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        for ([a, b], d, k) in self.each(x) {
            sum.add(0.5 * k * d.norm_squared());
            gradient[a] += d * k;
            gradient[b] -= d * k;
        }
        sum.total()
    }

    fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        self.edges.iter().for_each(|[a, b]| pair(*a, *b));
    }

    fn hessian(&self, _: &[Point3<f64>], _: bool, add: &mut dyn FnMut(u32, u32, &Matrix3<f64>)) {
        self.scalar_hessian(&[], &mut |a, b, k| {
            add(a, b, &Matrix3::from_diagonal_element(k))
        });
    }

    fn scalar_hessian(&self, _: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        for (&[a, b], &k) in self.edges.iter().zip(&self.stiffness) {
            add(a, a, k);
            add(b, b, k);
            add(a, b, -k);
            add(b, a, -k);
        }
    }

    fn force_scale(&self, x: &[Point3<f64>]) -> f64 {
        let force =
            |(edge, k): (&[u32; 2], &f64)| k * (x[edge[0] as usize] - x[edge[1] as usize]).norm();
        let squares: f64 = self
            .edges
            .iter()
            .zip(&self.stiffness)
            .map(force)
            .map(|f| f * f)
            .sum();
        (squares / self.edges.len().max(1) as f64).sqrt()
    }

    fn remember(&mut self, _: &[Point3<f64>]) {}

    fn aim(&mut self, target: &[Point3<f64>]) {
        self.target.copy_from_slice(target);
    }

    fn bytes(&self) -> usize {
        self.edges.capacity() * 8 + self.stiffness.capacity() * 8 + self.target.capacity() * 24
    }
}

/// Every step sets the target.
impl State for Tracking {
    fn save(&self, _: &mut Writer) {}

    fn restore(&mut self, _: &mut Reader<'_>) -> Result<(), DecodeError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::measures::max_or_nan;
    use crate::testing::Draw;

    fn drawn() -> (Tracking, Vec<Point3<f64>>) {
        let mut draw = Draw::new(3);
        let edges = vec![[0, 1], [1, 2], [2, 3], [0, 3], [1, 3]];
        let stiffness = (0..5).map(|_| draw.between(10.0, 300.0)).collect();
        (
            Tracking::new(edges, stiffness, draw.shape(4)),
            draw.shape(4),
        )
    }

    #[test]
    fn the_gradient_is_that_of_the_energy_and_the_hessian_that_of_the_gradient() {
        let (part, x) = drawn();
        let mut gradient = vec![Vector3::zeros(); 4];
        let energy = part.energy_and_gradient(&x, &mut gradient);
        let mut hessian = nalgebra::Matrix4::<f64>::zeros();
        part.scalar_hessian(&x, &mut |a, b, k| hessian[(a as usize, b as usize)] += k);
        // Quadratic: differences of any size are exact but for rounding.
        let h = 0.5;
        for v in 0..4 {
            for c in 0..3 {
                let (mut up, mut down) = (x.clone(), x.clone());
                up[v][c] += h;
                down[v][c] -= h;
                let slope = (part.energy(&up) - part.energy(&down)) / (2.0 * h);
                assert!(
                    (slope - gradient[v][c]).abs() <= 1e-13 * energy / h,
                    "{slope} {}",
                    gradient[v][c]
                );
                assert!(
                    (slope - 1.01 * gradient[v][c]).abs() > 1e-13 * energy / h,
                    "control"
                );
                let mut there = vec![Vector3::zeros(); 4];
                part.energy_and_gradient(&up, &mut there);
                for w in 0..4 {
                    let change = (there[w][c] - gradient[w][c]) / h;
                    assert!((change - hessian[(w, v)]).abs() <= 1e-13 * energy / (h * h));
                }
            }
        }
    }

    #[test]
    fn a_shifted_target_costs_nothing_and_is_where_it_rests() {
        let (mut part, x) = drawn();
        let shifted: Vec<Point3<f64>> = x
            .iter()
            .map(|p| p + Vector3::new(0.25, -0.5, 1.0))
            .collect();
        part.aim(&shifted);
        let size = max_or_nan(x.iter().map(|p| p.coords.norm())) + 1.25;
        assert!(part.energy(&x) <= 300.0 * 5.0 * (8.0 * f64::EPSILON * size).powi(2));
        assert!(drawn().0.energy(&x) > 1e-3, "control");
    }
}
