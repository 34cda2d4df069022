//! Collision response of two bodies: an impulse at a point of each, distributed to the points
//! around it.

use nalgebra::Vector3;

/// Restitution and friction of contacts; both zero by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Response {
    restitution: f64,
    friction: f64,
}

/// Error of [`Response::new`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ResponseError {
    /// Restitution outside 0 to 1: bodies would pass through each other or gain energy.
    #[error("the restitution is {0}; it has to be from 0 to 1")]
    Restitution(f64),
    /// Friction negative or not finite.
    #[error("the coefficient of friction is {0}; it has to be a number from 0 on")]
    Friction(f64),
}

impl Response {
    /// `restitution` e, 0 to 1, is the ratio of the separation speed to the approach speed.
    /// `friction` mu, at least 0, is the greatest ratio of the tangential impulse to the normal one
    /// (Coulomb).
    ///
    /// # Errors
    /// A coefficient out of its range.
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

/// The contact point of a body between `N` of its points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactPart<const N: usize> {
    /// Weights of the points; their sum is 1.
    pub weights: [f64; N],
    /// Inverse masses [1/kg]; 0 for a fixed or driven point.
    pub inverse_mass: [f64; N],
    /// Velocities [m/s].
    pub velocity: [Vector3<f64>; N],
}

impl<const N: usize> ContactPart<N> {
    /// Velocity of the contact point [m/s].
    pub fn at(&self) -> Vector3<f64> {
        self.weights
            .iter()
            .zip(&self.velocity)
            .map(|(w, v)| v * *w)
            .sum()
    }

    /// `sum a_i^2/m_i` [1/kg]: the mobility of the point under an impulse.
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

/// The impulse J on the second body [N s], with -J on the first; `None` if they do not approach or
/// neither can move.
///
/// `normal` is the unit vector n from the first body to the second, and `u` the velocity of the
/// second point minus that of the first. Along n, only for `u.n < 0`:
/// `j = -(1 + e) u.n/(sum a_i^2/m_i + sum b_k^2/m_k)` (errata B06, B12), after which
/// `u.n' = -e u.n`. Across n the impulse stops sliding, limited to `mu j`. The energy never
/// increases, because the mobility of such a point is equal in all directions. Momentum is
/// conserved. Angular momentum is conserved if the two points coincide, or without friction if they
/// lie along n.
pub fn impulse<const A: usize, const B: usize>(
    normal: &Vector3<f64>,
    first: &ContactPart<A>,
    second: &ContactPart<B>,
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
    // Extremely small masses or high speeds could make the impulse infinite or NaN and spoil every
    // point.
    all.iter().all(|c| c.is_finite()).then_some(all)
}
