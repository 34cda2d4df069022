//! Ends of muscles without a tendon over the joint.
//!
//! A bone that holds an end from afar carries it like a part of itself. That is right where a tendon
//! runs along the bone. Where a mesh ends before the joint that its tendon crosses, the end would turn
//! into the bone that rests.

use nalgebra::{Point3, Rotation3};

use super::joint::Joint;
use pliant::contact::{Obstacle, Surface};

/// Steps of the motion at which an end is looked at.
const LOOKED_AT: u32 = 12;

/// Whether the motion of a joint carries the middle of an end into one of the bones that rest.
pub fn is_carried_into(at: &Point3<f64>, joint: &Joint, bones: &[Surface]) -> bool {
    let centre = joint.fit.centre;
    (1..=LOOKED_AT).any(|step| {
        let share = f64::from(step) / f64::from(LOOKED_AT);
        let angle = share * f64::from(joint.known.degrees).to_radians();
        let there = centre + Rotation3::from_axis_angle(&joint.axis, angle) * (at - centre);
        let rests = (0..bones.len()).filter(|b| !joint.turns.contains(b));
        rests
            .filter_map(|b| bones[b].closest(&there))
            .any(|c| c.distance <= 0.0)
    })
}

/// The bone that rests and is nearest to an end, with its distance [m].
pub fn nearest_at_rest(at: &Point3<f64>, joint: &Joint, bones: &[Surface]) -> Option<(usize, f64)> {
    let rests = (0..bones.len()).filter(|b| !joint.turns.contains(b));
    let each = rests.filter_map(|b| Some((b, bones[b].closest(at)?.distance)));
    each.min_by(|a, b| a.1.total_cmp(&b.1))
}
