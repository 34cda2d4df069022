//! Closed-form oracles: behaviour of bodies with known exact solutions.
//!
//! `cargo test --test suite oracles -- --nocapture` prints the numbers of the section "Oracles" of
//! `docs/verification.md`.

mod chains;
mod membrane;
mod motion;
mod plate;
mod rest;
mod shapes;
mod strip;
mod sweeps;

/// Observed orders: log2 of the ratio of each error to the next, at twice the resolution.
fn orders(errors: &[f64]) -> Vec<f64> {
    errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect()
}

/// Errors with three digits each.
fn powers(errors: &[f64]) -> String {
    errors
        .iter()
        .map(|e| format!("{e:.2e}"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// Distance of the observed orders of the two finest pairs from `expected`; NaN if one is NaN.
fn off_order(errors: &[f64], expected: f64) -> f64 {
    let all = orders(errors);
    crate::tolerances::worst(
        all[all.len().saturating_sub(2)..]
            .iter()
            .map(|o| (o - expected).abs()),
    )
}

#[test]
fn an_order_that_is_not_there_is_seen() {
    use crate::tolerances::T4;
    assert!(off_order(&[1.0, 0.25, 0.0625], 2.0) <= T4);
    assert!(
        !(off_order(&[1.0, 0.5, 0.25], 2.0) <= T4),
        "control: order one"
    );
    assert!(
        !(off_order(&[1.0, 0.25, 0.25], 2.0) <= T4),
        "control: an error that stays"
    );
    assert!(
        !(off_order(&[1.0, f64::NAN, 0.25], 2.0) <= T4),
        "control: no number"
    );
}
