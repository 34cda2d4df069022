//! Seeded random numbers and shapes for difficult cases.

use nalgebra::{Point3, Rotation3, Unit, Vector3};

use crate::constraints::Parameter;
use crate::random::Random;

/// A small seeded generator (SplitMix64): the same seed gives the same draws on every machine.
#[derive(Clone, Debug)]
pub struct Draw {
    /// Printed with every failure.
    pub seed: u64,
    stream: Random,
}

impl Draw {
    /// Draws from `seed`.
    pub fn new(seed: u64) -> Self {
        Self {
            seed,
            stream: Random::new(seed),
        }
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.stream.bits()
    }

    /// Uniform in `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform among `0..count`.
    pub fn index(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// A multiple of 2^-20 in -1..1 (generator G1): sums and differences of such numbers are exact.
    pub fn dyadic(&mut self) -> f64 {
        (self.index(1 << 21) as f64 - (1 << 20) as f64) / (1 << 20) as f64
    }

    /// 10^U(low, high) (generator G2).
    pub fn decades(&mut self, low: f64, high: f64) -> f64 {
        10_f64.powf(self.between(low, high))
    }

    /// A unit vector.
    pub fn direction(&mut self) -> Vector3<f64> {
        loop {
            let v = Vector3::from_fn(|_, _| self.between(-1.0, 1.0));
            let squared = v.norm_squared();
            if squared > 0.01 && squared < 1.0 {
                return v / squared.sqrt();
            }
        }
    }

    /// A rotation.
    pub fn rotation(&mut self) -> Rotation3<f64> {
        let axis = Unit::new_normalize(self.direction());
        Rotation3::from_axis_angle(&axis, self.between(-3.0, 3.0))
    }

    /// `count` points with dyadic coordinates, no two nearer than 0.2 and no three nearly
    /// collinear.
    pub fn shape(&mut self, count: usize) -> Vec<Point3<f64>> {
        loop {
            let x: Vec<Point3<f64>> = (0..count)
                .map(|_| Point3::new(self.dyadic(), self.dyadic(), self.dyadic()))
                .collect();
            let apart = |i: usize, j: usize| (x[i] - x[j]).norm() > 0.2;
            let bent =
                |i: usize, j: usize, k: usize| (x[j] - x[i]).cross(&(x[k] - x[i])).norm() > 0.1;
            let pairs = (0..count).all(|i| (0..i).all(|j| apart(i, j)));
            if pairs && (0..count).all(|i| (0..i).all(|j| (0..j).all(|k| bent(i, j, k)))) {
                return x;
            }
        }
    }

    /// A value for each parameter, for a shape of size 1.
    pub fn parameters(&mut self, kinds: &[Parameter]) -> Vec<f64> {
        let direction = self.direction();
        let (a, b) = (self.between(0.1, 0.5), self.between(0.1, 0.4));
        let weights = [a, b, 1.0 - a - b];
        let mut next_weight = weights.into_iter();
        kinds
            .iter()
            .map(|kind| match kind {
                Parameter::Length => self.index(1 << 20) as f64 / (1 << 20) as f64,
                Parameter::Height => 0.5 * self.dyadic(),
                Parameter::Angle => self.between(-3.0, 3.0),
                Parameter::Volume => self.dyadic(),
                Parameter::Coordinate(_) => 2.0 + self.dyadic(),
                Parameter::Direction(axis) => direction[*axis],
                Parameter::Weight => next_weight.next().unwrap_or(0.0),
            })
            .collect()
    }
}
