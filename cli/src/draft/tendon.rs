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

/// An end crosses the joint if more than this share of what is held of it turns into a bone: a run, which
/// frees such vertices, is red if they are half of an attachment.
const CROSSES: f64 = 0.25;

/// Whether the motion of a joint carries an end, by points of what is held of it, into one of the bones that
/// rest.
pub fn is_carried_into(points: &[Point3<f64>], joint: &Joint, bones: &[Surface]) -> bool {
    let centre = joint.fit.centre;
    let turned = |step: u32| {
        let share = f64::from(step) / f64::from(LOOKED_AT);
        let angle = share * f64::from(joint.known.degrees).to_radians();
        Rotation3::from_axis_angle(&joint.axis, angle)
    };
    let turned: Vec<Rotation3<f64>> = (1..=LOOKED_AT).map(turned).collect();
    let rests: Vec<&Surface> = (0..bones.len())
        .filter(|b| !joint.turns.contains(b))
        .map(|b| &bones[b])
        .collect();
    let goes_in = |at: &&Point3<f64>| {
        let places = turned.iter().map(|turn| centre + turn * (*at - centre));
        places
            .flat_map(|there| rests.iter().filter_map(move |bone| bone.closest(&there)))
            .any(|closest| closest.distance <= 0.0)
    };
    points.iter().filter(goes_in).count() as f64 > CROSSES * points.len() as f64
}

/// The bone that rests and is nearest to an end, with its distance [m].
pub fn nearest_at_rest(at: &Point3<f64>, joint: &Joint, bones: &[Surface]) -> Option<(usize, f64)> {
    let rests = (0..bones.len()).filter(|b| !joint.turns.contains(b));
    let each = rests.filter_map(|b| Some((b, bones[b].closest(at)?.distance)));
    each.min_by(|a, b| a.1.total_cmp(&b.1))
}
