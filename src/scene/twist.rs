//! Motions at constant speed, and what two of them share; `super::motion` blends them.

use nalgebra::{Isometry3, Matrix3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::rigid::{SMALLEST_SINE, turn};

/// Least product of two turns across each other, over the sum of their squares: below it both have one
/// axis, since less than half of the digits would be left for a centre along it.
const LEAST_ANGLE: f64 = 1e-7;

/// The blend from 0 to 1 whose first two derivatives vanish at both ends.
pub(crate) fn smooth_step(share: f64) -> f64 {
    share * share * share * (10.0 + share * (6.0 * share - 15.0))
}

/// A motion at constant speed in the coordinates of the body: the logarithm of a pose.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Twist {
    /// Axis times angle \[rad\].
    pub(super) turn: Vector3<f64>,
    /// Speed of the body's origin \[m\].
    slide: Vector3<f64>,
}

impl Twist {
    /// The screw to a pose, by the shorter rotation.
    pub(super) fn of(pose: &Isometry3<f64>) -> Self {
        let moved = pose.translation.vector;
        let quaternion = pose.rotation.quaternion();
        let sign = if quaternion.w < 0.0 { -1.0 } else { 1.0 };
        let sine = quaternion.imag().norm();
        if sine < SMALLEST_SINE {
            return Self {
                turn: Vector3::zeros(),
                slide: moved,
            };
        }
        let axis = Unit::new_unchecked(quaternion.imag() * (sign / sine));
        let half = libm::atan2(sine, sign * quaternion.w);
        let along = axis.as_ref() * axis.dot(&moved);
        Self {
            turn: axis.as_ref() * (2.0 * half),
            slide: along + turn(&axis, -half) * (moved - along) * (half / sine),
        }
    }

    pub(super) fn times(&self, factor: f64) -> Self {
        Self {
            turn: self.turn * factor,
            slide: self.slide * factor,
        }
    }

    /// The pose after this motion from the identity.
    pub(super) fn pose(&self) -> Isometry3<f64> {
        let angle = self.turn.norm();
        if angle < SMALLEST_SINE {
            return Isometry3::from_parts(
                Translation3::from(self.slide),
                UnitQuaternion::identity(),
            );
        }
        let axis = Unit::new_unchecked(self.turn / angle);
        let half = 0.5 * angle;
        let along = axis.as_ref() * axis.dot(&self.slide);
        let across = turn(&axis, half) * (self.slide - along) * (libm::sin(half) / half);
        Isometry3::from_parts(Translation3::from(along + across), turn(&axis, angle))
    }

    /// What two motions share: turn and motion of the centre that both turns keep best, each in the
    /// mean direction with the smaller size, and none if they are against each other.
    pub(super) fn shared(&self, other: &Self) -> Self {
        let both = [self, other];
        // The centre is where the squares of both speeds have the least sum. Along a common axis it
        // is free, and the nearest to the origin counts.
        let sum = self.turn.cross(&self.slide) + other.turn.cross(&other.slide);
        let [square, across] = [
            self.turn.norm_squared() + other.turn.norm_squared(),
            self.turn.cross(&other.turn).norm(),
        ];
        let centre = if across > LEAST_ANGLE * square {
            let matrix = Matrix3::from_diagonal_element(square)
                - self.turn * self.turn.transpose()
                - other.turn * other.turn.transpose();
            matrix.try_inverse().map(|inverse| inverse * sum)
        } else {
            Some(sum / square).filter(|_| square >= SMALLEST_SINE)
        };
        let centre = centre.unwrap_or_default();
        let [first, second] = both.map(|t| t.slide + t.turn.cross(&centre));
        let turn = smaller(&self.turn, &other.turn);
        Self {
            turn,
            slide: smaller(&first, &second) - turn.cross(&centre),
        }
    }
}

/// A vector in the mean direction of two with the size of the shorter times the cosine between both;
/// zero if they are at right angles or against each other.
fn smaller(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    let [first, second] = [a.norm(), b.norm()];
    let product = first * second;
    if product.is_normal() && a.dot(b) > 0.0 {
        let mean = (a + b).normalize();
        mean * (first.min(second) * a.dot(b) / product)
    } else {
        Vector3::zeros()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Key, Motion};
    use super::*;
    use nalgebra::{Matrix4, Point3};
    use proptest::prelude::*;

    /// Keys of turns about axes through one centre.
    fn turns(centre: &Vector3<f64>, turns: &[(f64, Vector3<f64>)]) -> Motion {
        let keys = turns.iter().enumerate().map(|(k, &(frame, turn))| {
            let rotation = UnitQuaternion::from_scaled_axis(turn);
            let pose = Isometry3::from_parts((centre - rotation * centre).into(), rotation);
            let frame = 10.0 * k as f64 + frame;
            Key { frame, pose }
        });
        Motion {
            keys: keys.collect(),
            ..Motion::default()
        }
    }

    fn turn_vectors() -> impl Strategy<Value = Vec<(f64, Vector3<f64>)>> {
        let turn = prop::array::uniform3(-0.8..0.8_f64).prop_map(Vector3::from);
        prop::collection::vec((0.0..5.0_f64, turn), 2..6)
    }

    proptest! {
        #[test]
        fn a_pose_is_the_end_of_its_twist(
            turn in prop::array::uniform3(-1.8..1.8_f64), moved in prop::array::uniform3(-2.0..2.0_f64),
        ) {
            let rotation = UnitQuaternion::from_scaled_axis(turn.into());
            let pose = Isometry3::from_parts(Vector3::from(moved).into(), rotation);
            let back = Twist::of(&pose).pose();
            prop_assert!((back.to_homogeneous() - pose.to_homogeneous()).norm() <= 1e-13);
            prop_assert!((Twist::of(&pose).turn - Vector3::from(turn)).norm() <= 1e-13);
        }

        /// First and second differences on both sides of a key are equal but for the step. The third
        /// derivative is at most 60 times the turn over the cube of the span: below 3 here.
        #[test]
        fn speed_and_acceleration_are_continuous_at_keys(
            vectors in turn_vectors(), centre in prop::array::uniform3(-1.0..1.0_f64),
        ) {
            let motion = turns(&centre.into(), &vectors);
            let step = 1e-3;
            for key in &motion.keys {
                let at = |k: f64| motion.pose(key.frame + k * step).to_homogeneous();
                let speed = |side: f64| (at(side) - at(0.0)) * (side / step);
                prop_assert!((speed(1.0) - speed(-1.0)).norm() <= 20.0 * step);
                let bend = |side: f64| (at(2.0 * side) - at(side) * 2.0 + at(0.0)) / (step * step);
                prop_assert!((bend(1.0) - bend(-1.0)).norm() <= 20.0 * step, "{}", bend(1.0) - bend(-1.0));
            }
        }

        #[test]
        fn a_common_centre_stays(
            vectors in turn_vectors(), centre in prop::array::uniform3(-1.0..1.0_f64), share in 0.0..1.0_f64,
        ) {
            let motion = turns(&centre.into(), &vectors);
            let frame = share * motion.keys.last().unwrap().frame;
            let centre = Point3::from(centre);
            prop_assert!((motion.pose(frame) * centre - centre).norm() <= 1e-9);
        }

        /// About one axis the angle runs from key to key and never past one.
        #[test]
        fn a_turn_does_not_run_past_its_keys(
            angles in prop::collection::vec((0.0..5.0_f64, -1.4..1.4_f64), 2..6), share in 0.0..1.0_f64,
        ) {
            let axis = Vector3::new(0.6, 0.0, 0.8);
            let vectors: Vec<_> = angles.iter().map(|&(f, a)| (f, axis * a)).collect();
            let motion = turns(&Vector3::new(0.1, 0.2, -0.3), &vectors);
            let angle = |frame: f64| motion.pose(frame).rotation.scaled_axis().dot(&axis);
            for pair in motion.keys.windows(2) {
                let [from, to] = [angle(pair[0].frame), angle(pair[1].frame)];
                let [now, then] = [share, share + 1e-3]
                    .map(|s| angle(pair[0].frame + s.min(1.0) * (pair[1].frame - pair[0].frame)));
                prop_assert!((now - from) * (to - from) >= -1e-12);
                prop_assert!((to - now) * (to - from) >= -1e-12);
                prop_assert!((then - now) * (to - from) >= -1e-12);
            }
        }
    }

    #[test]
    fn even_keys_of_one_screw_keep_its_speed_but_at_both_ends() {
        let screw = Twist {
            turn: Vector3::new(0.1, -0.2, 0.05),
            slide: Vector3::new(0.01, 0.02, 0.03),
        };
        let key = |k: u8| Key {
            frame: 7.0 * f64::from(k),
            pose: screw.times(f64::from(k)).pose(),
        };
        let motion = Motion {
            keys: (0..6).map(key).collect(),
            ..Motion::default()
        };
        for share in [1.0, 1.3, 2.5, 3.99, 4.0] {
            let wanted: Matrix4<f64> = screw.times(share).pose().to_homogeneous();
            let found = motion.pose(7.0 * share).to_homogeneous();
            assert!(
                (found - wanted).norm() <= 1e-13,
                "{share}: {}",
                found - wanted
            );
        }
        // From rest: later than the screw, and half way in the middle of two keys alone.
        let alone = Motion {
            keys: vec![key(0), key(5)],
            ..Motion::default()
        };
        let begun = alone.pose(3.5).rotation.angle() / screw.turn.norm();
        assert!((begun - 5.0 * smooth_step(0.1)).abs() <= 1e-13, "{begun}");
    }

    #[test]
    fn at_a_reversal_a_body_rests() {
        let there = Twist {
            turn: Vector3::x(),
            slide: Vector3::zeros(),
        };
        let back = there.times(-0.5);
        let shared = there.shared(&back);
        assert_eq!(shared.turn, Vector3::zeros());
        assert_eq!(shared.slide, Vector3::zeros());
    }

    #[test]
    fn a_linear_motion_jumps_in_speed() {
        let vectors = [
            (0.0, Vector3::zeros()),
            (0.0, Vector3::x()),
            (0.0, Vector3::zeros()),
        ];
        let mut motion = turns(&Vector3::y(), &vectors);
        let jump = |motion: &Motion| {
            let [before, at, after] =
                [9.999, 10.0, 10.001].map(|f| motion.pose(f).rotation.scaled_axis().x);
            ((after - at) - (at - before)).abs() / 0.001
        };
        assert!(jump(&motion) <= 1e-4);
        motion.linear = true;
        assert!((jump(&motion) - 0.2).abs() <= 1e-4);
    }
}
