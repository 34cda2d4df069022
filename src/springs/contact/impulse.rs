//! What two bodies do to each other in an instant: an impulse at a point of each, shared by the points around it.

use nalgebra::Vector3;

/// How bodies answer contact; by default with neither bounce nor friction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Response {
    restitution: f64,
    friction: f64,
}

/// Why a response is refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ResponseError {
    /// Outside of 0 to 1: bodies would pass through each other, or gain energy.
    #[error("the restitution is {0}; it has to be from 0 to 1")]
    Restitution(f64),
    /// Negative or not finite.
    #[error("the coefficient of friction is {0}; it has to be a number from 0 on")]
    Friction(f64),
}

impl Response {
    /// `restitution` e, 0 to 1: the share of the speed of approach with which they part. `friction` mu, from 0 on: the
    /// greatest impulse along the contact over that across it (Coulomb).
    ///
    /// # Errors
    /// Either out of its range.
    pub fn new(restitution: f64, friction: f64) -> Result<Self, ResponseError> {
        if !(0.0..=1.0).contains(&restitution) {
            return Err(ResponseError::Restitution(restitution));
        }
        if !(friction >= 0.0 && friction.is_finite()) {
            return Err(ResponseError::Friction(friction));
        }
        Ok(Self {
            restitution,
            friction,
        })
    }

    /// Restitution e.
    pub fn restitution(&self) -> f64 {
        self.restitution
    }

    /// Coefficient of friction mu.
    pub fn friction(&self) -> f64 {
        self.friction
    }
}

/// The point of a body that touches, between `N` of its points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part<const N: usize> {
    /// Weights of its points; they sum to 1.
    pub weights: [f64; N],
    /// Inverse masses [1/kg]; 0 for a point that is held or driven.
    pub inverse_mass: [f64; N],
    /// Velocities [m/s].
    pub velocity: [Vector3<f64>; N],
}

impl<const N: usize> Part<N> {
    /// Velocity of the point that touches [m/s].
    pub fn at(&self) -> Vector3<f64> {
        self.weights
            .iter()
            .zip(&self.velocity)
            .map(|(w, v)| v * *w)
            .sum()
    }

    /// `sum a_i^2/m_i` [1/kg]: how far an impulse at the point moves it.
    pub fn mobility(&self) -> f64 {
        self.weights
            .iter()
            .zip(&self.inverse_mass)
            .map(|(a, w)| a * a * w)
            .sum()
    }

    /// The velocities after an impulse at the point [N s]: `v_i + a_i J/m_i`.
    #[must_use]
    pub fn after(&self, impulse: &Vector3<f64>) -> [Vector3<f64>; N] {
        std::array::from_fn(|i| {
            self.velocity[i] + impulse * (self.weights[i] * self.inverse_mass[i])
        })
    }
}

/// The impulse J on the second body [N s], that on the first is -J; `None` where they do not approach or neither can move.
///
/// `normal` is the unit vector n from the first body to the second, `u` the velocity of the second's point less that of the
/// first's. Along n, only for `u.n < 0`: `j = -(1 + e) u.n/(sum a_i^2/m_i + sum b_k^2/m_k)` (errata B06, B12), after which
/// `u.n' = -e u.n`. Across n the impulse stops sliding, or is `mu j` if that is less. Energy never rises, because the mobility
/// of such a point is the same in every direction. Momentum is kept, and angular momentum where the two points are one, or
/// without friction where they lie along n.
pub fn impulse<const A: usize, const B: usize>(
    normal: &Vector3<f64>,
    first: &Part<A>,
    second: &Part<B>,
    response: Response,
) -> Option<Vector3<f64>> {
    let mobility = first.mobility() + second.mobility();
    let relative = second.at() - first.at();
    let approach = relative.dot(normal);
    if !(approach < 0.0 && mobility > 0.0) {
        return None;
    }
    let along = -(1.0 + response.restitution) * approach / mobility;
    let mut all = normal * along;
    let sliding = relative - normal * approach;
    let speed = sliding.norm();
    if response.friction > 0.0 && speed > 0.0 {
        all -= sliding * ((speed / mobility).min(response.friction * along) / speed);
    }
    // Masses so small or speeds so high that the impulse is no number would spoil every point.
    all.iter().all(|c| c.is_finite()).then_some(all)
}
