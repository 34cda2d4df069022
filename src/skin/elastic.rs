//! The springs of the skin: as any constraint's energy, but with the second derivative of a spring written out.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::constraints::distance::Distance;
use crate::solvers::potential::{Potential, Quadratic};
use crate::state::{DecodeError, Reader, State, Writer};

/// The energy sum k (l - l0)^2 / 2.
#[derive(Clone, Debug)]
pub struct Elastic {
    energy: Quadratic<Distance, 2>,
    springs: Vec<(Distance, f64)>,
}

impl Elastic {
    /// Springs with a stiffness each [N/m].
    ///
    /// # Panics
    /// If the numbers differ.
    pub fn new(springs: &[Distance], stiffness: &[f64]) -> Self {
        let energy = Quadratic::new(springs.to_vec(), stiffness.to_vec());
        Self {
            energy,
            springs: springs
                .iter()
                .copied()
                .zip(stiffness.iter().copied())
                .collect(),
        }
    }
}

impl State for Elastic {
    fn save(&self, to: &mut Writer) {
        let Self { energy, springs: _ } = self;
        energy.save(to);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        self.energy.restore(from)
    }
}

impl Potential for Elastic {
    fn name(&self) -> &'static str {
        self.energy.name()
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        self.energy.energy(x)
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        self.energy.energy_and_gradient(x, gradient)
    }

    fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        self.energy.pairs(pair);
    }

    fn hessian(
        &self,
        x: &[Point3<f64>],
        convex: bool,
        add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
    ) {
        for (spring, k) in &self.springs {
            let [a, b] = spring.points;
            let d = x[a as usize] - x[b as usize];
            let length = d.norm();
            if length == 0.0 {
                continue;
            }
            let n = d / length;
            // Across a spring its tension alone resists; under pressure it gives way.
            let tension = 1.0 - spring.rest / length;
            let across = if convex { tension.max(0.0) } else { tension };
            let along = n * n.transpose();
            let block = (along + (Matrix3::identity() - along) * across) * *k;
            add(a, a, &block);
            add(b, b, &block);
            add(a, b, &-block);
            add(b, a, &-block);
        }
    }

    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        self.energy.scalar_hessian(x, add);
    }

    fn force_scale(&self, x: &[Point3<f64>]) -> f64 {
        self.energy.force_scale(x)
    }

    fn remember(&mut self, x: &[Point3<f64>]) {
        self.energy.remember(x);
    }

    fn bytes(&self) -> usize {
        self.energy.bytes() + self.springs.capacity() * size_of::<(Distance, f64)>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of the second derivative.
    fn blocks(of: &dyn Potential, x: &[Point3<f64>], convex: bool) -> [[Matrix3<f64>; 2]; 2] {
        let mut found = [[Matrix3::zeros(); 2]; 2];
        of.hessian(x, convex, &mut |i, j, block| {
            found[i as usize][j as usize] += block
        });
        found
    }

    #[test]
    fn the_second_derivative_is_that_of_the_constraint() {
        for (rest, to) in [
            (1.0, [0.3, -0.9, 1.2]),
            (2.0, [0.4, 0.1, 0.2]),
            (0.1, [0.05, 0.05, 0.05]),
        ] {
            let springs = [Distance {
                points: [0, 1],
                rest,
            }];
            let x = [Point3::new(0.2, 0.1, -0.3), Point3::from(to)];
            let (own, general) = (
                Elastic::new(&springs, &[3.0]),
                Quadratic::new(springs.to_vec(), vec![3.0]),
            );
            for convex in [false, true] {
                let (own, general) = (blocks(&own, &x, convex), blocks(&general, &x, convex));
                for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    assert!(
                        (own[i][j] - general[i][j]).norm() <= 1e-12 * general[i][j].norm(),
                        "{rest} {convex}"
                    );
                    assert!(general[i][j].norm() > 1.0);
                }
            }
        }
    }
}
