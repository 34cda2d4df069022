//! Distance of a vertex from its place over a moving triangle: C = |a - sum w_i p_i - h n|, the bond
//! between two surfaces.

use nalgebra::{Point3, Vector3};

use super::potential::positive_part;
use super::second::Second;
use super::stencil::{Blocks, Stencil};
use super::{Constraint, Scalar, safe_norm};

/// A triangle whose area is below this share of its longest edge squared has no usable normal. The
/// rule is relative: it does not change with the unit of length.
const FLAT: f64 = 1.0 / (1u64 << 40) as f64;

/// Greatest size of a weight of a place: it lies over the triangle or beside it, not far from it.
const MOST: f64 = 2.0;

/// Attracts the vertex a to its place over a triangle: C = |d|, d = a - sum w_i p_i - h n, with the
/// unit normal n of the triangle (p_1, p_2, p_3).
///
/// With u = d / C and g_i the gradient of the i-th barycentric weight in the plane of the triangle,
/// the gradient is u for a and -w_i u + h (u.g_i) n for p_i. C does not change if all points move
/// as a rigid body, so that momentum and angular momentum are conserved. The gradient is undefined
/// where the vertex is at its place, and where the triangle has no area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bond {
    /// The vertex, and the corners of the triangle.
    pub points: [u32; 4],
    /// Barycentric weights of the place, with sum 1.
    pub weights: [f64; 3],
    /// Height of the place over the triangle [m].
    pub height: f64,
}

impl Bond {
    /// The bond that is satisfied at the positions `x` [m]. `None` if the triangle has no area, or
    /// the foot of the vertex in its plane is far from it.
    pub fn at_rest(points: [u32; 4], x: &[Point3<f64>; 4]) -> Option<Self> {
        let (normal, squared) = area_normal(x)?;
        let [e, f, q] = [x[2] - x[1], x[3] - x[1], x[0] - x[1]];
        let second = q.cross(&f).dot(&normal) / squared;
        let third = e.cross(&q).dot(&normal) / squared;
        let bond = Self {
            points,
            weights: [1.0 - second - third, second, third],
            height: q.dot(&normal) / squared.sqrt(),
        };
        let is_near = bond.weights.iter().all(|w| w.abs() <= MOST);
        is_near.then_some(bond)
    }

    /// The vector d from the place to the vertex [m].
    fn offset<S: Scalar>(&self, x: &[Point3<S>; 4]) -> Vector3<S> {
        // Differences to the first corner: a translation changes no bit.
        let [e, f] = [x[2] - x[1], x[3] - x[1]];
        let normal = e.cross(&f);
        let foot = e * S::of(self.weights[1]) + f * S::of(self.weights[2]);
        let up = normal * (S::of(self.height) / normal.dot(&normal).sqrt());
        x[0] - x[1] - foot - up
    }
}

/// The energy k C^2 / 2 of a bond. Its second derivative is known also where the vertex is at its place
/// and the gradient of C is not.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ElasticBond {
    pub bond: Bond,
    /// Stiffness k [N/m].
    pub stiffness: f64,
}

impl Stencil<4> for ElasticBond {
    fn points(&self) -> [u32; 4] {
        self.bond.points
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        let (value, gradient) = self.bond.value_and_gradient(x)?;
        let force = self.stiffness * value;
        Some((0.5 * force * value, gradient.map(|g| g * force)))
    }

    fn hessian(&self, x: &[Point3<f64>; 4], convex: bool) -> Option<Blocks<4>> {
        area_normal(x)?;
        let d = self.bond.offset(&Second::variables(x));
        let energy = d.dot(&d);
        let half = 0.5 * self.stiffness;
        let blocks = energy.hessian.map(|row| row.map(|block| block * half));
        Some(match convex {
            true => positive_part(&blocks),
            false => blocks,
        })
    }

    /// That of a bond whose triangle does not turn: k w_i w_j, with the weights of d.
    fn scalar_hessian(&self, _: &[Point3<f64>; 4]) -> Option<[[f64; 4]; 4]> {
        let [a, b, c] = self.bond.weights;
        let weights = [1.0, -a, -b, -c];
        Some(weights.map(|row| weights.map(|column| self.stiffness * row * column)))
    }
}

/// Twice the area of the triangle times its normal, and the square of this vector; `None` without an
/// area.
fn area_normal(x: &[Point3<f64>; 4]) -> Option<(Vector3<f64>, f64)> {
    let [e, f] = [x[2] - x[1], x[3] - x[1]];
    let normal = e.cross(&f);
    let longest = e
        .norm_squared()
        .max(f.norm_squared())
        .max((f - e).norm_squared());
    let (squared, least) = (normal.norm_squared(), FLAT * longest);
    (squared > least * least && squared.is_finite()).then_some((normal, squared))
}

impl Constraint<4> for Bond {
    const NAME: &'static str = "bond";

    #[inline]
    fn points(&self) -> [u32; 4] {
        self.points
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; 4]) -> S {
        let d = self.offset(x);
        d.dot(&d).sqrt()
    }

    #[inline]
    fn value_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        let (area_normal, squared) = area_normal(x)?;
        let normal = area_normal / squared.sqrt();
        let [e, f] = [x[2] - x[1], x[3] - x[1]];
        let foot = e * self.weights[1] + f * self.weights[2];
        let d = x[0] - x[1] - foot - normal * self.height;
        let value = safe_norm(&d);
        if value == 0.0 {
            return None;
        }
        let u = d / value;
        // Gradients of the weights, times the height and along u.
        let along = area_normal.cross(&u) * (self.height / squared);
        let tilt = [(f - e).dot(&along), -f.dot(&along), e.dot(&along)];
        let corner = |k: usize| u * -self.weights[k] - normal * tilt[k];
        Some((value, [u, corner(0), corner(1), corner(2)]))
    }
}

#[cfg(any(test, feature = "testing"))]
impl super::Spec<4> for Bond {
    const DEGREE: i32 = 1;
    const PARAMETERS: &'static [super::Parameter] = &[
        super::Parameter::Weight,
        super::Parameter::Weight,
        super::Parameter::Weight,
        super::Parameter::Height,
    ];

    fn from_parameters(points: [u32; 4], p: &[f64]) -> Self {
        Self {
            points,
            weights: [p[0], p[1], p[2]],
            height: p[3],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Draw;

    #[test]
    fn the_second_derivative_is_that_of_the_forces_also_at_the_place() {
        let mut draw = Draw::new(32);
        let mut made = 0;
        for _ in 0..200 {
            let shape = draw.shape(4);
            let rest: [Point3<f64>; 4] = std::array::from_fn(|k| shape[k]);
            let Some(bond) = Bond::at_rest([0, 1, 2, 3], &rest) else {
                continue;
            };
            let [e, f] = [rest[2] - rest[1], rest[3] - rest[1]];
            if e.cross(&f).norm() <= 0.1 * e.norm() * f.norm() {
                continue;
            }
            made += 1;
            let elastic = ElasticBond {
                bond,
                stiffness: 3.0,
            };
            let forces = |x: &[Point3<f64>; 4]| {
                let found = elastic.energy_and_gradient(x);
                found.map_or([Vector3::zeros(); 4], |(_, gradient)| gradient)
            };
            let mut off = rest;
            off[0] += draw.direction() * (0.3 * e.norm());
            for x in [rest, off] {
                let blocks = elastic.hessian(&x, false).expect("a triangle with an area");
                let whole = blocks.iter().flatten().map(nalgebra::Matrix3::norm);
                let scale: f64 = whole.sum();
                let h = 1e-6 * e.norm();
                for (j, c) in (0..4).flat_map(|j| (0..3).map(move |c| (j, c))) {
                    let (mut up, mut down) = (x, x);
                    up[j][c] += h;
                    down[j][c] -= h;
                    let each = forces(&up).into_iter().zip(forces(&down)).zip(&blocks);
                    for ((up, down), row) in each {
                        let slope = (up - down) / (2.0 * h);
                        let error = (slope - row[j].column(c)).norm();
                        assert!(error <= 1e-6 * scale, "{error:e} of {scale:e}");
                    }
                }
            }
            // A triangle at whose height the vertex lies does not feel its turn: the scalar matrix is exact.
            let flat = Bond {
                height: 0.0,
                ..bond
            };
            let elastic = ElasticBond {
                bond: flat,
                stiffness: 3.0,
            };
            let mut place = rest;
            place[0] = rest[1] + e * bond.weights[1] + f * bond.weights[2];
            let exact = elastic
                .hessian(&place, false)
                .expect("a triangle with an area");
            let scalar = elastic.scalar_hessian(&place).expect("always");
            for (blocks, entries) in exact.iter().zip(&scalar) {
                for (block, entry) in blocks.iter().zip(entries) {
                    let error = (block - nalgebra::Matrix3::from_diagonal_element(*entry)).norm();
                    assert!(error <= 1e-12 * 3.0 * 25.0, "{error:e}");
                }
            }
        }
        assert!(made > 50, "{made}");
    }

    #[test]
    fn a_bond_is_satisfied_at_rest_and_after_any_rigid_motion() {
        let mut draw = Draw::new(31);
        let mut made = 0;
        for _ in 0..500 {
            let x: [Point3<f64>; 4] = {
                let shape = draw.shape(4);
                std::array::from_fn(|k| shape[k])
            };
            let Some(bond) = Bond::at_rest([0, 1, 2, 3], &x) else {
                continue;
            };
            made += 1;
            let turn = nalgebra::UnitQuaternion::from_axis_angle(
                &nalgebra::Unit::new_normalize(draw.direction()),
                draw.between(0.0, 3.0),
            );
            for there in [x, x.map(|p| turn * p + Vector3::new(3.0, -2.0, 1.0))] {
                assert!(bond.value(&there) <= 1e-13, "{}", bond.value(&there));
            }
            // Control: a vertex that slides is not at its place.
            let mut slid = x;
            slid[0] += (x[2] - x[1]) * 0.1;
            assert!(bond.value(&slid) >= 0.05 * (x[2] - x[1]).norm());
        }
        assert!(made > 100, "{made}");
        let flat =
            [[0.0, 1.0], [0.0, 0.0], [1.0, 0.0], [2.0, 0.0]].map(|[a, b]| Point3::new(a, b, 0.0));
        assert_eq!(Bond::at_rest([0, 1, 2, 3], &flat), None);
        let far =
            [[9.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[a, b]| Point3::new(a, b, 0.0));
        assert_eq!(Bond::at_rest([0, 1, 2, 3], &far), None);
    }
}
