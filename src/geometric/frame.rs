//! Two bars joined at one end, with a muscle between them; the angles follow from the law of
//! cosines.

use nalgebra::{Point2, Rotation2, Vector2};

/// Lengths of the bars, from the free end of the first to that of the second \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// From the free end of the first bar to the muscle.
    pub first_free: f64,
    /// From the muscle to the joint along the first bar.
    pub first: f64,
    /// From the joint to the muscle along the second bar.
    pub second: f64,
    /// From the muscle to the free end of the second bar.
    pub second_free: f64,
}

/// Error of [`Frame::new`] and [`Frame::place`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FrameError {
    /// A bar length is not positive, or the length of a free end is negative.
    #[error("{what} of the frame is {value}; it must be {wanted}")]
    Length {
        /// Name of the length.
        what: &'static str,
        /// The rejected value.
        value: f64,
        /// The allowed values.
        wanted: &'static str,
    },
    /// No triangle has these sides.
    #[error("a muscle of {length} m does not fit between bars of {first} m and {second} m: from {} m to {} m do", (first - second).abs(), first + second)]
    Range {
        /// Length of the muscle \[m\].
        length: f64,
        /// Distance from the muscle to the joint on the first bar \[m\].
        first: f64,
        /// Distance from the joint to the muscle on the second bar \[m\].
        second: f64,
    },
}

/// The frame at one length of the muscle, in its plane. The muscle lies on the x axis from the
/// origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Angle at the joint \[rad\].
    pub joint_angle: f64,
    /// Angles between the muscle and the first and the second bar \[rad\].
    pub muscle_angles: [f64; 2],
    /// Free end, muscle, joint, muscle, free end \[m\].
    pub points: [Point2<f64>; 5],
}

/// The angle between the sides `b` and `c` of a triangle, opposite to `a` \[rad\]. The half-angle
/// formula stays accurate where the triangle is nearly flat; the cosine does not.
fn opposite(a: f64, b: f64, c: f64) -> f64 {
    let s = 0.5 * (a + b + c);
    let (up, down) = ((s - b) * (s - c), s * (s - a));
    2.0 * libm::atan2(up.max(0.0).sqrt(), down.max(0.0).sqrt())
}

impl Frame {
    /// Creates a frame of four lengths \[m\].
    ///
    /// # Errors
    /// An invalid length.
    pub fn new([first_free, first, second, second_free]: [f64; 4]) -> Result<Self, FrameError> {
        for (what, value, least) in [
            ("the free part of the first bar", first_free, 0.0),
            (
                "the first bar from muscle to joint",
                first,
                f64::MIN_POSITIVE,
            ),
            (
                "the second bar from joint to muscle",
                second,
                f64::MIN_POSITIVE,
            ),
            ("the free part of the second bar", second_free, 0.0),
        ] {
            if !(value.is_finite() && value >= least) {
                let wanted = if least > 0.0 {
                    "greater than 0"
                } else {
                    "at least 0"
                };
                return Err(FrameError::Length {
                    what,
                    value,
                    wanted,
                });
            }
        }
        Ok(Self {
            first_free,
            first,
            second,
            second_free,
        })
    }

    /// Least and greatest length of a muscle between the bars \[m\].
    pub fn range(&self) -> [f64; 2] {
        [(self.first - self.second).abs(), self.first + self.second]
    }

    /// Computes the frame for a length of the muscle \[m\].
    ///
    /// # Errors
    /// No triangle has these sides.
    pub fn place(&self, length: f64) -> Result<Placed, FrameError> {
        let (b, c) = (self.first, self.second);
        let [least, most] = self.range();
        if !(length > 0.0 && (least..=most).contains(&length)) {
            return Err(FrameError::Range {
                length,
                first: b,
                second: c,
            });
        }
        let at_first = opposite(c, length, b);
        let at_second = opposite(b, length, c);
        let along_first = Rotation2::new(-at_first) * Vector2::x();
        let joint = Point2::from(along_first * b);
        let end = Point2::new(length, 0.0);
        let along_second = Rotation2::new(std::f64::consts::PI + at_second) * Vector2::x();
        Ok(Placed {
            joint_angle: opposite(length, b, c),
            muscle_angles: [at_first, at_second],
            points: [
                Point2::from(-along_first * self.first_free),
                Point2::origin(),
                joint,
                end,
                end - along_second * self.second_free,
            ],
        })
    }
}
