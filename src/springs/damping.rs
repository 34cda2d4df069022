//! Damping for the fastest approach to rest.

use super::neighbours::Neighbours;

/// Critical damping [N s/m] of a mass [kg] on a spring [N/m]: `2 sqrt(k m)`.
pub fn critical(stiffness: f64, mass: f64) -> f64 {
    2.0 * (stiffness * mass).sqrt()
}

/// Critical damping [N s/m] of two free masses [kg] with one spring [N/m]: the relative motion has
/// twice the stiffness (errata M2).
pub fn critical_of_pair(stiffness: f64, mass: f64) -> f64 {
    critical(2.0 * stiffness, mass)
}

/// Critical damping of Verlet with backward differences at a step of `dt` [s],
/// `2 sqrt(k m) - k dt`: both roots of the recurrence are equal (errata M3). Negative beyond the
/// stability limit.
pub fn critical_in_steps(stiffness: f64, mass: f64, dt: f64) -> f64 {
    critical(stiffness, mass) - stiffness * dt
}

/// Parameters of a lattice or a similar body for [`estimate`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DampedBody {
    /// Mass of a point [kg].
    pub mass: f64,
    /// Stiffness times rest length of the springs [N]; 1 for the thesis's stiffness 1/L.
    pub tension: f64,
    /// Length of the longest side [m].
    pub side: f64,
    /// Mean rest length of the springs [m]; for 26 neighbours that of the shortest kind.
    pub spacing: f64,
}

/// The empirical damping (7.2) [N s/m], in a form for any size (errata M13): `c = sqrt(8 m k)`,
/// `k = tension (2 + 4 spacing/side)/side`.
///
/// For 26 neighbours the thesis has no formula; here `k = tension (9.43 + 6.64 spacing/side)/side`.
/// This is a straight line through the means of c^2/(8 m) in its table 7.5 for 5 and 20 points per
/// side. Its error for 10 points is 4 %, so 2 % in c. The thesis has no lattices with 18 neighbours: their line is such that
/// the damping of the shortest time to rest is the same share of the estimate as with 26 neighbours, to 0.05, for 5, 10 and 20
/// points per side (0.85, 0.80, 0.60 against 0.80, 0.75, 0.55).
pub fn estimate(neighbours: Neighbours, body: DampedBody) -> f64 {
    let share = body.spacing / body.side;
    let factor = match neighbours {
        Neighbours::Six => 2.0 + 4.0 * share,
        Neighbours::Eighteen => 6.0 + 5.0 * share,
        Neighbours::TwentySix => 9.43 + 6.64 * share,
    };
    (8.0 * body.mass * body.tension * factor / body.side).sqrt()
}
