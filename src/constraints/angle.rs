//! The polar angle of a point of the plane from elementary operations of `f64`. The result has the
//! same bits on every machine. It is faster than the function of `libm`.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use super::Lane;

/// tan(pi/8): above it the octant is rotated by pi/4.
const TAN_PI_8: f64 = 0.414_213_562_373_095_03;

/// atan(z) = z + z^3 P(z^2) for |z| <= tan(pi/8): Chebyshev fit, error below 6e-18 relative to z.
const P: [f64; 11] = [
    -0.333_333_333_333_333_3,
    0.199_999_999_999_955_13,
    -0.142_857_142_846_648_2,
    0.111_111_110_151_176_26,
    -0.090_909_045_724_873_47,
    0.076_921_830_598_941_14,
    -0.066_645_096_032_553_86,
    0.058_581_328_944_279_22,
    -0.050_853_659_223_442_49,
    0.039_229_237_138_359_43,
    -0.019_173_922_285_547_93,
];

/// Angle of the point `(x, y)` [rad] in [-pi, pi], with an error of at most 4 units in the last
/// place.
#[inline(always)]
pub fn atan2(y: f64, x: f64) -> f64 {
    let (angle, usual) = atan2_in_lanes((), y, x);
    // Zeros, NaN, and numbers whose sum or quotient could overflow or lose digits.
    if usual { angle } else { libm::atan2(y, x) }
}

/// Angles [rad] as [`atan2`] gives them, and a mask of the lanes where they are valid. A lane is
/// invalid if its coordinates are very large, very small or both zero.
#[inline(always)]
pub fn atan2_in_lanes<N: Lane>(machine: N::Machine, y: N, x: N) -> (N, N::Mask) {
    let of = |value| N::splat(machine, value);
    let (ax, ay) = (x.abs(), y.abs());
    let steep = ax.lt(ay);
    let (small, large) = (N::select(steep, ax, ay), N::select(steep, ay, ax));
    // On an axis the argument of the polynomial is zero and the result is exact. Flat hinges are
    // common.
    let (tiny, huge) = (of(1e-140), of(1e140));
    let usual = (tiny.lt(small) | (small.le(of(0.0)) & tiny.lt(large))) & large.lt(huge);
    let turned = (of(TAN_PI_8) * large).lt(small);
    let top = N::select(turned, small - large, small);
    let bottom = N::select(turned, small + large, large);
    let base = N::select(turned, of(FRAC_PI_4), of(0.0));
    let z = top / bottom;
    let u = z * z;
    // The terms are added in pairs, so that the multiplications are independent.
    let (u2, pair) = (u * u, |k: usize| of(P[k]) + of(P[k + 1]) * u);
    let u4 = u2 * u2;
    let low = pair(0) + pair(2) * u2;
    let middle = pair(4) + pair(6) * u2;
    let high = pair(8) + of(P[10]) * u2;
    let angle = base + (z + z * u * (low + (middle + high * u4) * u4));
    let angle = N::select(steep, of(FRAC_PI_2) - angle, angle);
    let angle = N::select(x.lt(of(0.0)), of(PI) - angle, angle);
    (angle.copysign(y), usual)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Draw;

    fn units_off(y: f64, x: f64) -> f64 {
        let (found, known) = (atan2(y, x), libm::atan2(y, x));
        assert_eq!(
            found.is_sign_negative(),
            known.is_sign_negative(),
            "atan2({y:e}, {x:e})"
        );
        (found.abs().to_bits().abs_diff(known.abs().to_bits())) as f64
    }

    #[test]
    fn within_four_units_of_the_library_everywhere() {
        let mut draw = Draw::new(5);
        let mut worst = 0.0_f64;
        for _ in 0..1_000_000 {
            let (x, y) = (draw.between(-1.0, 1.0), draw.between(-1.0, 1.0));
            let scale = libm::exp2(draw.between(-60.0, 60.0));
            // All quadrants, then points near an axis, then points near a diagonal and near the
            // octant's border.
            for (y, x) in [
                (y, x),
                (y * scale, x),
                (x + y / scale.max(1.0 / scale), x),
                (x * TAN_PI_8 * (1.0 + y * 1e-15), x),
            ] {
                worst = worst.max(units_off(y, x));
            }
        }
        // The result of `libm` itself has an error of at most one unit.
        assert!(worst <= 3.0, "{worst} units");
        assert!(worst > 0.0, "compared with itself");
    }

    #[test]
    fn zeros_infinities_and_extremes_are_the_library_s() {
        let special = [
            0.0,
            -0.0,
            1.0,
            -1.0,
            f64::INFINITY,
            f64::NEG_INFINITY,
            5e-324,
            -5e-324,
            1e308,
            -1e308,
            1e-300,
        ];
        for y in special {
            for x in special {
                assert!(units_off(y, x) <= 3.0, "atan2({y:e}, {x:e})");
            }
        }
        assert!(atan2(f64::NAN, 1.0).is_nan() && atan2(1.0, f64::NAN).is_nan());
    }
}
