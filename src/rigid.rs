//! Rigid motions: rotations, and parts of screws.

use nalgebra::{Isometry3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};

/// Least sine of half a turn. Below this, squares underflow and the direction of the axis is lost; so
/// small a rotation has no effect.
pub(crate) const SMALLEST_SINE: f64 = 1e-150;

/// The part `share` (0..1) of the screw from the identity to `pose`, `exp(share log(pose))`.
///
/// Along the axis the translation is scaled. A rotation by `a` about a distant axis moves the body
/// along a chord of length `2 r sin(a/2)` at the angle `a/2` to the start. The part's chord is
/// therefore the whole one times `sin(share a/2) / sin(a/2)`, rotated back by `(1 - share) a/2`. No
/// logarithm is needed, and nothing is lost near `a = 0`.
pub(crate) fn screw_part(pose: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    let quaternion = pose.rotation.quaternion();
    // The quaternion of the shorter rotation.
    let sign = if quaternion.w < 0.0 { -1.0 } else { 1.0 };
    let (cosine, vector) = (sign * quaternion.w, sign * quaternion.imag());
    let sine = vector.norm();
    let moved = pose.translation.vector;
    if sine < SMALLEST_SINE {
        return Isometry3::from_parts(
            Translation3::from(moved * share),
            UnitQuaternion::identity(),
        );
    }
    let axis = Unit::new_unchecked(vector / sine);
    let half = libm::atan2(sine, cosine);
    let along = axis.as_ref() * axis.dot(&moved);
    let ratio = libm::sin(share * half) / sine;
    let across = turn(&axis, -(1.0 - share) * half) * (moved - along) * ratio;
    Isometry3::from_parts(
        Translation3::from(along * share + across),
        turn(&axis, 2.0 * share * half),
    )
}

/// Rotation by an angle \[rad\]; the functions of libm give the same bits on every system.
pub(crate) fn turn(axis: &Unit<Vector3<f64>>, angle: f64) -> UnitQuaternion<f64> {
    let (sine, cosine) = libm::sincos(0.5 * angle);
    UnitQuaternion::new_unchecked(Quaternion::from_parts(cosine, axis.as_ref() * sine))
}

/// The pose after a rotation by an angle \[rad\] about an axis through a centre \[m\].
pub(crate) fn turned(
    axis: &Unit<Vector3<f64>>,
    angle: f64,
    centre: &Vector3<f64>,
) -> Isometry3<f64> {
    let rotation = turn(axis, angle);
    let back = if angle == 0.0 {
        Vector3::zeros()
    } else {
        centre - rotation * centre
    };
    Isometry3::from_parts(Translation3::from(back), rotation)
}
