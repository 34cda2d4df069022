//! Estimate of a file's length unit from the size of its mesh.

/// Plausible range of the longest side of a body: from a fingertip to a whole body [m].
const PLAUSIBLE: [f64; 2] = [0.01, 2.5];

/// Typical longest side: a thigh [m].
const TYPICAL: f64 = 0.25;

/// Length units of meshes, with their lengths [m].
const UNITS: [(&str, f64); 5] = [
    ("m", 1.0),
    ("dm", 0.1),
    ("cm", 0.01),
    ("mm", 0.001),
    ("in", 0.0254),
];

/// The units for which a longest side of `length` is plausible for a part of a body, the most
/// likely first, each with the side in metres. The result is an estimate for display only.
pub fn likely_units(length: f64) -> Vec<(&'static str, f64)> {
    let mut likely: Vec<_> = UNITS
        .iter()
        .map(|(name, metres)| (*name, length * metres))
        .collect();
    likely.retain(|(_, side)| (PLAUSIBLE[0]..=PLAUSIBLE[1]).contains(side));
    let distance = |side: f64| libm::log(side / TYPICAL).abs();
    likely.sort_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
    likely
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_bodies() {
        let first = |length| likely_units(length).first().map(|(name, _)| *name);
        // A femur in metres and millimetres, nothing, a planet.
        assert_eq!(
            [
                first(0.43),
                first(430.0),
                first(0.0),
                first(1e7),
                first(f64::NAN)
            ],
            [Some("m"), Some("mm"), None, None, None]
        );
        // A body of 17 dm could be one of 17 cm.
        assert!(likely_units(17.0).iter().any(|(name, _)| *name == "dm"));
    }
}
