//! Springs between points and fixed positions.

use nalgebra::{Point3, Vector3};

use super::force::Force;
use super::hooke::Hooke;
use super::pairs::{Law, PairError, block};
use crate::mesh::sum::tree_sum_by;

/// Springs between points and fixed positions, such as the springs of rest length 0 that pull skin
/// back.
#[derive(Clone, Debug)]
pub struct Anchors {
    anchors: Vec<(u32, Point3<f64>, Hooke)>,
}

impl Anchors {
    /// Creates anchors of `count` points from triples of point, fixed position [m] and spring.
    ///
    /// # Errors
    /// A point out of range, or a position or a parameter that is not finite.
    pub fn new(
        count: usize,
        anchors: impl IntoIterator<Item = (u32, Point3<f64>, Hooke)>,
    ) -> Result<Self, PairError> {
        let mut anchors: Vec<(u32, Point3<f64>, Hooke)> = anchors.into_iter().collect();
        for (spring, &(point, place, law)) in anchors.iter().enumerate() {
            if point as usize >= count {
                return Err(PairError::OutOfRange {
                    spring,
                    point,
                    count,
                });
            }
            if !law.is_valid() || !place.coords.iter().all(|c| c.is_finite()) {
                return Err(PairError::Parameter { spring });
            }
        }
        let key = |&(point, place, law): &(u32, Point3<f64>, Hooke)| {
            (
                point,
                [place.x, place.y, place.z, law.rest, law.stiffness].map(|v| (v + 0.0).to_bits()),
            )
        };
        anchors.sort_by_key(key);
        Ok(Self { anchors })
    }
}

impl Force for Anchors {
    fn name(&self) -> &'static str {
        "anchors"
    }

    fn elements(&self) -> usize {
        self.anchors.len()
    }

    fn highest_point(&self) -> Option<u32> {
        self.anchors.last().map(|a| a.0)
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        tree_sum_by(self.anchors.len(), |a| {
            let (point, place, law) = self.anchors[a];
            law.energy((place - x[point as usize]).norm())
        })
    }

    fn add_force(&self, x: &[Point3<f64>], force: &mut [Vector3<f64>]) {
        for &(point, place, law) in &self.anchors {
            let d = place - x[point as usize];
            force[point as usize] += d * law.tension_per_length(d.norm());
        }
    }

    fn add_product(
        &self,
        x: &[Point3<f64>],
        p: &[Vector3<f64>],
        definite: bool,
        product: &mut [Vector3<f64>],
    ) {
        for &(point, place, law) in &self.anchors {
            let i = point as usize;
            product[i] += block(&law, place - x[i], p[i], definite);
        }
    }

    fn add_row_sums(&self, x: &[Point3<f64>], sums: &mut [f64]) {
        for &(point, place, law) in &self.anchors {
            let length = (place - x[point as usize]).norm();
            sums[point as usize] += law
                .slope(length)
                .abs()
                .max(law.tension_per_length(length).abs());
        }
    }
}
