//! Bounds on the motion of a vertex relative to an obstacle.

/// Bounds on the sum of all motion so far, relative to the obstacles [m]. A vertex can move out and
/// back within a step, so stored values use the lower bound and queries the upper one. Their
/// difference bounds the motion between any two moments.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotionBound {
    pub at_least: f64,
    pub at_most: f64,
}

impl MotionBound {
    /// Bounds at a position `motion` [m] away from the beginning of the step, after a sum of motion
    /// of `before` [m].
    pub fn about(before: f64, motion: f64) -> Self {
        Self {
            at_least: before - motion,
            at_most: before + motion,
        }
    }

    /// Bounds after at most `more` [m] of further motion.
    pub fn and(self, more: f64) -> Self {
        Self {
            at_least: self.at_least - more,
            at_most: self.at_most + more,
        }
    }
}
