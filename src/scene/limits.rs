//! How far a muscle may depart from a believable motion: the section `[limits]`.

use super::error::SceneError;
use super::keys::{KeyKind, KeySpec, KeyValue, Limit};
use super::reader::Section;
use super::units::Dimension;

/// Jitter, relative to the length of a muscle: 0.1 mm of 25 cm, the width of a line in a picture of
/// the whole muscle.
const JITTER: f64 = 4e-4;
/// Greatest speed, relative to that of what holds the muscle: a fibre between two attachments moves
/// no faster than its ends, except where it slides over a bone.
const SNAP: f64 = 1.5;
/// Lift-off, relative to the length of a muscle: 3 mm of 27 cm.
const LIFT_OFF: f64 = 0.011;
/// Least thickness, relative to that at rest: a muscle that keeps its volume and is stretched to
/// twice its length still has 0.7 of it.
const THICKNESS: f64 = 0.5;
/// Angle between the normals of two triangles [deg]: smooth tissue has no sharper fold.
const HINGE_DEG: f64 = 60.0;

/// Limits of the quality of a motion. `None` is the default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// Jitter [m].
    pub jitter: Option<f64>,
    /// Greatest speed of a free vertex, relative to that of the attachments.
    pub snap: Option<f64>,
    /// Lift-off from bones [m].
    pub lift_off: Option<f64>,
    /// Least thickness, relative to that at rest.
    pub thickness: Option<f64>,
    /// Greatest angle between the normals of two triangles \[rad\].
    pub hinge: Option<f64>,
}

/// The keys of the section, in the order of the fields of [`Limits`].
pub(super) const LIMITS: [KeySpec; 5] = [
    KeySpec::new(
        "jitter",
        KeyKind::Quantity(Dimension::Length, Limit::Positive),
        "Greatest distance of a vertex from its mean over seven frames.",
    ),
    KeySpec::new(
        "snap",
        KeyKind::Number(Limit::Positive),
        "Greatest speed of a free vertex, relative to that of the attachments.",
    ),
    KeySpec::new(
        "lift_off",
        KeyKind::Quantity(Dimension::Length, Limit::Positive),
        "Greatest growth of the distance from bones.",
    ),
    KeySpec::new(
        "thickness",
        KeyKind::Number(Limit::Within(0.0, 1.0)),
        "Least thickness, relative to that at rest.",
    ),
    KeySpec::new(
        "hinge",
        KeyKind::Quantity(Dimension::Angle, Limit::Positive),
        "Greatest angle between the normals of two triangles.",
    ),
];

impl Limits {
    /// All limits for a muscle of this length [m], with the default where the scene has none.
    #[must_use]
    pub fn or_default(&self, length: f64) -> Self {
        Self {
            jitter: self.jitter.or(Some(JITTER * length)),
            snap: self.snap.or(Some(SNAP)),
            lift_off: self.lift_off.or(Some(LIFT_OFF * length)),
            thickness: self.thickness.or(Some(THICKNESS)),
            hinge: self.hinge.or(Some(HINGE_DEG.to_radians())),
        }
    }
}

/// Reads the limits of a scene.
pub(super) fn limits(root: &Section<'_>) -> Result<Limits, SceneError> {
    let mut limits = Limits::default();
    let Some(section) = root.section("limits")? else {
        return Ok(limits);
    };
    let fields = [
        &mut limits.jitter,
        &mut limits.snap,
        &mut limits.lift_off,
        &mut limits.thickness,
        &mut limits.hinge,
    ];
    for (key, field) in LIMITS.iter().zip(fields) {
        if let Some(item) = section.get(key.key)
            && let KeyValue::Number(number) = key.value(&item)?
        {
            *field = Some(number);
        }
    }
    Ok(limits)
}
