//! The shell of an implant: it bears tension and no pressure, as a thin sheet that wrinkles instead.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::constraints::distance::Distance;
use crate::mesh::sum::NeumaierSum;
use crate::solvers::potential::Potential;
use crate::state::{DecodeError, Reader, State, Writer};

/// Share of its stiffness with which a spring pulls its ends together however long it is: it spreads the vertices of a
/// slack shell, whose places would be anyone's guess, and costs as much as a strain of one in a hundred.
const GATHER: f64 = 0.01;

/// The energy sum k (max(0, l - l0)^2 + l^2/100) / 2: convex, so that a shell has no folds to choose from.
#[derive(Clone, Debug)]
pub struct Envelope {
    springs: Vec<Distance>,
    stiffness: Vec<f64>,
    /// Whether forces are judged by what it exerts.
    alone: bool,
}

impl Envelope {
    /// Springs with a stiffness each [N/m].
    ///
    /// # Panics
    /// If the numbers differ.
    pub fn new(springs: Vec<Distance>, stiffness: Vec<f64>) -> Self {
        assert_eq!(
            springs.len(),
            stiffness.len(),
            "one stiffness for each spring"
        );
        Self {
            springs,
            stiffness,
            alone: false,
        }
    }

    /// The same without skin over it: forces are judged by what it exerts itself.
    pub fn alone(mut self) -> Self {
        self.alone = true;
        self
    }

    /// Each spring: its ends, the way from the second to the first, its length, its rest length and its stiffness.
    fn each<'a>(
        &'a self,
        x: &'a [Point3<f64>],
    ) -> impl Iterator<Item = ([u32; 2], Vector3<f64>, f64, f64, f64)> + 'a {
        self.springs.iter().zip(&self.stiffness).map(|(spring, k)| {
            let [a, b] = spring.points.map(|p| x[p as usize]);
            (spring.points, a - b, (a - b).norm(), spring.rest, *k)
        })
    }
}

impl State for Envelope {
    fn save(&self, _: &mut Writer) {}

    fn restore(&mut self, _: &mut Reader<'_>) -> Result<(), DecodeError> {
        Ok(())
    }
}

impl Potential for Envelope {
    fn name(&self) -> &'static str {
        "envelope"
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        for (_, _, length, rest, k) in self.each(x) {
            let over = (length - rest).max(0.0);
            sum.add(0.5 * k * (over * over + GATHER * length * length));
        }
        sum.total()
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        for ([a, b], d, length, rest, k) in self.each(x) {
            let taut = if length > rest {
                1.0 - rest / length
            } else {
                0.0
            };
            let force = d * (k * (taut + GATHER));
            gradient[a as usize] += force;
            gradient[b as usize] -= force;
        }
        self.energy(x)
    }

    fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        self.springs
            .iter()
            .for_each(|s| pair(s.points[0], s.points[1]));
    }

    fn hessian(&self, x: &[Point3<f64>], _: bool, add: &mut dyn FnMut(u32, u32, &Matrix3<f64>)) {
        for ([a, b], d, length, rest, k) in self.each(x) {
            let mut block = Matrix3::from_diagonal_element(k * GATHER);
            if length > rest {
                let n = d / length;
                let along = n * n.transpose();
                block += (along + (Matrix3::identity() - along) * (1.0 - rest / length)) * k;
            }
            add(a, a, &block);
            add(b, b, &block);
            add(a, b, &-block);
            add(b, a, &-block);
        }
    }

    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        for ([a, b], _, length, rest, k) in self.each(x) {
            let k = k * if length >= rest { 1.0 } else { GATHER };
            [(a, a, k), (b, b, k), (a, b, -k), (b, a, -k)]
                .into_iter()
                .for_each(|(i, j, k)| add(i, j, k));
        }
    }

    fn force_scale(&self, _: &[Point3<f64>]) -> f64 {
        // Under skin, forces are judged by what the springs of the skin exert.
        if !self.alone {
            return 0.0;
        }
        let mut sum = NeumaierSum::default();
        self.springs
            .iter()
            .zip(&self.stiffness)
            .for_each(|(spring, k)| sum.add((k * spring.rest).powi(2)));
        (sum.total() / self.springs.len().max(1) as f64).sqrt()
    }

    fn remember(&mut self, _: &[Point3<f64>]) {}

    fn bytes(&self) -> usize {
        self.springs.capacity() * size_of::<Distance>() + self.stiffness.capacity() * 8
    }
}
