//! The energy of cords under tone: edges whose force is positive at every length and increases with
//! the length.

use nalgebra::{Point3, Vector3};

use crate::constraints::Stencils;
use crate::constraints::distance::Distance;
use crate::constraints::spring::{Between, Spring, SpringLaw};

/// Exponential growth of passive muscle force with strain. The force increases by a factor e when
/// the strain increases by the inverse of this value. The value is the exponent 4 over the strain
/// 0.6 at the greatest isometric force \[thelen2003\].
pub const STEEPNESS: f64 = 4.0 / 0.6;

/// The exponential law of passive muscle: energy `k d^2 exp(a e) / a^2` at strain `e`, with `d` the
/// rest length and `a` the value [`STEEPNESS`]. The force at rest is `k d / a`. The energy is
/// convex and smooth: a net of such cords has one equilibrium, and no cord buckles or suddenly
/// becomes slack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cord {
    /// Rest length [m].
    pub rest: f64,
    /// Stiffness at rest [N/m].
    pub stiffness: f64,
}

impl SpringLaw for Cord {
    fn energy(&self, length: f64) -> f64 {
        self.tension(length) * self.rest / STEEPNESS
    }

    fn tension(&self, length: f64) -> f64 {
        self.slope(length) * self.rest / STEEPNESS
    }

    fn slope(&self, length: f64) -> f64 {
        self.stiffness * libm::exp(STEEPNESS * (length - self.rest) / self.rest)
    }

    // One exponential for both results. A cord of length zero exerts no force in any direction.
    fn along(&self, d: &Vector3<f64>) -> (f64, f64) {
        let length = d.norm();
        let tension = self.tension(length);
        let per_length = if length > 0.0 { tension / length } else { 0.0 };
        (tension * self.rest / STEEPNESS, per_length)
    }

    fn factors(&self, d: &Vector3<f64>, _: bool) -> (f64, f64, f64) {
        let length = d.norm();
        let slope = self.slope(length);
        let tension = slope * self.rest / STEEPNESS;
        let per_length = if length > 0.0 { tension / length } else { 0.0 };
        (length, slope, per_length)
    }

    fn scalar(&self, _: f64) -> f64 {
        self.stiffness
    }

    fn force_scale(&self, _: &Vector3<f64>) -> f64 {
        self.stiffness * self.rest
    }
}

/// Edges under tone.
pub type Tension = Stencils<Spring<Between, Cord>, 2>;

/// Edges under tone with a stiffness at rest [N/m] each.
pub fn tension(edges: &[Distance], stiffness: &[f64]) -> Tension {
    let cord = |(edge, &stiffness): (&Distance, &f64)| Spring {
        arm: Between(edge.points),
        law: Cord {
            rest: edge.rest,
            stiffness,
        },
    };
    Stencils::new("tension", edges.iter().zip(stiffness).map(cord).collect())
}

/// The forces [N] on the vertices of a shape `x` [m] that balance cords with their forces at rest,
/// for any lengths.
pub fn support(cords: &Tension, x: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    let mut forces = vec![Vector3::zeros(); x.len()];
    for Spring { arm, law } in cords.terms() {
        let [a, b] = arm.0.map(|p| p as usize);
        let direction = (x[a] - x[b])
            .try_normalize(0.0)
            .unwrap_or_else(Vector3::zeros);
        let force = direction * (law.stiffness * law.rest / STEEPNESS);
        forces[a] += force;
        forces[b] -= force;
    }
    forces
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraints::Potential;
    use crate::testing::Draw;

    /// Cords, some shorter and some longer than at rest.
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
        let stiffness: Vec<f64> = edges.iter().map(|_| draw.between(10.0, 300.0)).collect();
        (tension(&edges, &stiffness), x)
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
        let at_rest = |cord: &Spring<Between, Cord>| {
            let [a, b] = cord.arm.0.map(|p| x[p as usize]);
            let law = Cord {
                rest: (a - b).norm(),
                ..cord.law
            };
            Spring { law, ..*cord }
        };
        let balanced = Stencils::new("tension", part.terms().iter().map(at_rest).collect());
        let greatest = |x: &[Point3<f64>]| {
            let mut gradient = vec![Vector3::zeros(); 6];
            balanced.energy_and_gradient(x, &mut gradient);
            let left = gradient
                .iter()
                .zip(support(&balanced, x))
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
