//! Every tolerance of the suite; `docs/verification.md` explains each.

/// T1: exact identities, multiples of machine precision of the sum of absolute terms.
pub const T1: f64 = 64.0 * f64::EPSILON;
/// T2: rounding bound of the dual-number oracle times this (the analytic form rounds elsewhere).
pub const T2: f64 = 64.0 * f64::EPSILON;
/// T3: departure of an observed order of convergence of a projection, median over shapes.
pub const T3: f64 = 0.2;
/// T4: departure of the observed order of a time integrator on its two finest pairs.
pub const T4: f64 = 0.05;
/// T5: the same where the reference is a run with 64 times more steps.
pub const T5: f64 = 0.1;
/// T6: relative error of an enclosed volume after a step.
pub const T6: f64 = 1e-6;
/// T7: relative error of an exact volume projection.
pub const T7: f64 = 1e-14;
/// T8: impulses of a constraint, relative to the sum of their sizes.
pub const T8: f64 = 8.0 * f64::EPSILON;
/// T9: converged solutions of other sweeps, relative to the length of the body.
pub const T9: f64 = 1e-9;
/// T10: one-substep XPBD against implicit Euler, relative.
pub const T10: f64 = 1e-13;
/// T11: rise of the energy of an undamped linear system in a step, relative.
pub const T11: f64 = 64.0 * f64::EPSILON;
/// T12: gradient of a hinge against 1/height, relative.
pub const T12: f64 = 1e-14;
/// T13: depth of a resting body below a surface, relative to its size.
pub const T13: f64 = 1e-6;
/// T14: deviation from an acceptance number of a digest, within its printed digits.
pub const T14: f64 = 5e-7;
/// T15: equilibria of two solvers whose forces are below 1e-9 of the scale, relative to the length
/// of the body.
pub const T15: f64 = 1e-6;
/// T16: departure of an observed order of convergence in a mesh's resolution or in a strain, on the
/// two finest pairs.
pub const T16: f64 = 0.1;
/// T17: deviation of a body at rest from its exact equilibrium relative to its size, and the
/// residual load on it.
pub const T17: f64 = 1e-8;
/// T18: ends of blends, surfaces cut by an overlay, exact fits, relative to their size.
pub const T18: f64 = 1e-12;
/// T19: a known motion computed from a part of a surface: greatest error relative to the size of
/// the surface.
pub const T19: f64 = 1e-3;
/// T20: a known motion computed from the same vertices: error relative to the size of the surface.
pub const T20: f64 = 1e-6;
/// T21: angle between two equal rotations \[rad\].
pub const T21: f64 = 1e-7;
/// T22: moment arm of a straight muscle against its distance to the axis, relative.
pub const T22: f64 = 0.024;
/// T23: two shapes at the same angle, reached on different paths, relative to the length of the
/// muscle.
pub const T23: f64 = 2e-7;
/// T24: a whole scene in other units, relative to its size.
pub const T24: f64 = 1e-9;
/// T25: a law of physics for a whole scene, relative.
pub const T25: f64 = 1e-3;
/// T26: momentum of bodies that nothing else touches, after a run, relative.
pub const T26: f64 = 1e-9;

/// T27: derivative of an equilibrium by a parameter, against differences of equilibria and against
/// its adjoint, relative.
pub const T27: f64 = 1e-6;

/// All tolerances by name, in order.
pub const ALL: &[(&str, f64)] = &[
    ("T1", T1),
    ("T2", T2),
    ("T3", T3),
    ("T4", T4),
    ("T5", T5),
    ("T6", T6),
    ("T7", T7),
    ("T8", T8),
    ("T9", T9),
    ("T10", T10),
    ("T11", T11),
    ("T12", T12),
    ("T13", T13),
    ("T14", T14),
    ("T15", T15),
    ("T16", T16),
    ("T17", T17),
    ("T18", T18),
    ("T19", T19),
    ("T20", T20),
    ("T21", T21),
    ("T22", T22),
    ("T23", T23),
    ("T24", T24),
    ("T25", T25),
    ("T26", T26),
    ("T27", T27),
];

/// Number of random cases: `default`, or the value of `PLIANT_CASES`.
pub fn cases(default: usize) -> usize {
    std::env::var("PLIANT_CASES")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(default)
}

/// The largest of some errors; NaN if one is NaN, which `f64::max` would hide.
pub fn worst(errors: impl IntoIterator<Item = f64>) -> f64 {
    errors.into_iter().fold(0.0, |worst: f64, e| {
        if worst.is_nan() || e <= worst {
            worst
        } else {
            e
        }
    })
}
