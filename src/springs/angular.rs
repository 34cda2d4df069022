//! Angular springs: from a point to the midpoint of two opposite neighbours \[nedel1998\].

use nalgebra::{Point3, Vector3};

use super::force::Force;
use super::hooke::Hooke;
use super::pairs::{Law, PairError, block};
use crate::mesh::sum::tree_sum_by;

/// A spring between a point and the midpoint of two others; it resists changes of a surface's
/// curvature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AngularSpring {
    /// The point, and its two opposite neighbours.
    pub points: [u32; 3],
    /// Law of the distance to the midpoint.
    pub law: Hooke,
}

/// Weights of the three points in the vector along the spring.
const SHARES: [f64; 3] = [1.0, -0.5, -0.5];

/// Angular springs.
#[derive(Clone, Debug)]
pub struct AngularSprings {
    springs: Vec<AngularSpring>,
    start: Vec<usize>,
    /// Spring and corner of each point, in the order of the points.
    roles: Vec<(u32, u8)>,
}

impl AngularSprings {
    /// Creates angular springs between `count` points.
    ///
    /// # Errors
    /// A point out of range or twice in a spring, a parameter that is not finite, or a negative
    /// rest length.
    pub fn new(
        count: usize,
        springs: impl IntoIterator<Item = AngularSpring>,
    ) -> Result<Self, PairError> {
        let mut springs: Vec<AngularSpring> = springs.into_iter().collect();
        for (spring, s) in springs.iter_mut().enumerate() {
            let [a, b, c] = s.points;
            s.points = [a, b.min(c), b.max(c)];
            if let Some(&point) = s.points.iter().find(|&&p| p as usize >= count) {
                return Err(PairError::OutOfRange {
                    spring,
                    point,
                    count,
                });
            }
            if a == b || a == c || b == c {
                return Err(PairError::Loop {
                    spring,
                    point: if a == b { a } else { c },
                });
            }
            if !s.law.is_valid() {
                return Err(PairError::Parameter { spring });
            }
        }
        springs.sort_by(|s, t| {
            let key =
                |s: &AngularSpring| [s.law.rest, s.law.stiffness].map(|v| (v + 0.0).to_bits());
            s.points.cmp(&t.points).then_with(|| key(s).cmp(&key(t)))
        });
        let mut start = vec![0; count + 1];
        springs
            .iter()
            .flat_map(|s| s.points)
            .for_each(|p| start[p as usize + 1] += 1);
        (0..count).for_each(|i| start[i + 1] += start[i]);
        let (mut next, mut roles) = (start.clone(), vec![(0, 0); 3 * springs.len()]);
        for (s, spring) in springs.iter().enumerate() {
            for (corner, &p) in spring.points.iter().enumerate() {
                roles[next[p as usize]] = (s as u32, corner as u8);
                next[p as usize] += 1;
            }
        }
        Ok(Self {
            springs,
            start,
            roles,
        })
    }

    /// Vector from the point to the midpoint.
    fn along(points: [u32; 3], x: &[Point3<f64>]) -> Vector3<f64> {
        let [a, b, c] = points.map(|p| x[p as usize]);
        nalgebra::center(&b, &c) - a
    }

    fn gather<T>(&self, to: &mut [T], term: impl Fn(&AngularSpring, f64, &mut T)) {
        for (i, t) in to.iter_mut().enumerate() {
            for &(s, corner) in &self.roles[self.start[i]..self.start[i + 1]] {
                term(&self.springs[s as usize], SHARES[corner as usize], t);
            }
        }
    }
}

impl Force for AngularSprings {
    fn name(&self) -> &'static str {
        "angular springs"
    }

    fn elements(&self) -> usize {
        self.springs.len()
    }

    fn highest_point(&self) -> Option<u32> {
        self.springs.iter().flat_map(|s| s.points).max()
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        tree_sum_by(self.springs.len(), |s| {
            let AngularSpring { points, law } = self.springs[s];
            law.energy(Self::along(points, x).norm())
        })
    }

    fn add_force(&self, x: &[Point3<f64>], force: &mut [Vector3<f64>]) {
        self.gather(force, |s, share, force| {
            let d = Self::along(s.points, x);
            *force += d * (share * s.law.tension_per_length(d.norm()));
        });
    }

    fn add_product(
        &self,
        x: &[Point3<f64>],
        p: &[Vector3<f64>],
        definite: bool,
        product: &mut [Vector3<f64>],
    ) {
        self.gather(product, |s, share, product| {
            let [a, b, c] = s.points.map(|i| p[i as usize]);
            *product += block(
                &s.law,
                Self::along(s.points, x),
                a - (b + c) * 0.5,
                definite,
            ) * share;
        });
    }

    fn add_row_sums(&self, x: &[Point3<f64>], sums: &mut [f64]) {
        self.gather(sums, |s, share, sum| {
            let length = Self::along(s.points, x).norm();
            let most = s
                .law
                .slope(length)
                .abs()
                .max(s.law.tension_per_length(length).abs());
            // The weights of a row's three blocks add up to 2.
            *sum += 2.0 * share.abs() * most;
        });
    }
}
