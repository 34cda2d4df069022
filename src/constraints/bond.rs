//! Distance of a vertex from its place over a moving triangle: C = |a - sum w_i p_i - h n|, the bond
//! between two surfaces.

use nalgebra::{Point3, Vector3};

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
        // Differences to the first corner: a translation changes no bit.
        let [e, f] = [x[2] - x[1], x[3] - x[1]];
        let normal = e.cross(&f);
        let foot = e * S::of(self.weights[1]) + f * S::of(self.weights[2]);
        let up = normal * (S::of(self.height) / normal.dot(&normal).sqrt());
        let d = x[0] - x[1] - foot - up;
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
