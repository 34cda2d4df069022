//! A tendon for a muscle whose mesh ends before the bone that holds it: the end of the mesh is drawn out
//! to the bone.
//!
//! A bone that holds an end from afar carries it like a part of itself. That is right where a tendon
//! runs along the bone. Where the tendon crosses the joint, the end would turn into the other bone.

use nalgebra::{Point3, Rotation3, Vector3};

use super::attachments::tip;
use super::joint::Joint;
use pliant::contact::{Obstacle, Surface};
use pliant::mesh::TriangleMesh;

/// Steps of the motion at which an end is looked at.
const LOOKED_AT: u32 = 12;

/// Depth at which the middle of an end is in a bone [m]: less than what the measured bones and muscles
/// overlap at rest.
const IN: f64 = 0.0;

/// The part of a muscle's length that is drawn out, relative to the way; at least and at most of the length.
const PART: f64 = 1.5;
const PARTS: [f64; 2] = [0.15, 0.5];

/// Thickness of the new tendon, relative to that of the end.
const THIN: f64 = 0.5;

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
            .any(|c| c.distance <= IN)
    })
}

/// The mesh with the end at `from_tip` [shares of its length] drawn out until it touches the bone, and the
/// way [m]. `None` if the end touches already.
pub fn drawn_out(
    muscle: &TriangleMesh,
    from_tip: &[f64],
    length: f64,
    bone: &Surface,
) -> Option<(TriangleMesh, f64)> {
    // The way of the vertex of the tip that is nearest to the bone.
    let ways = tip(from_tip).filter_map(|v| {
        let x = muscle.vertices[v];
        let c = bone.closest(&x)?;
        Some((x, c.point - x))
    });
    let (nearest, way) = ways.min_by(|a, b| a.1.norm().total_cmp(&b.1.norm()))?;
    let reach = way.norm();
    let along = way.try_normalize(0.0)?;
    let part = (PART * reach / length).clamp(PARTS[0], PARTS[1]);
    let mut mesh = muscle.clone();
    for (x, &from) in mesh.vertices.iter_mut().zip(from_tip) {
        let share = smooth(1.0 - from / part);
        let off: Vector3<f64> = *x - nearest;
        let across = off - along * off.dot(&along);
        *x += way * share - across * (share * (1.0 - THIN));
    }
    Some((mesh, reach))
}

/// Rises from 0 to 1 with continuous slope.
fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::Health;
    use pliant::mesh::shapes::{box_surface, icosphere};

    #[test]
    fn an_end_is_drawn_to_the_bone_and_the_rest_stays() {
        let mut muscle = icosphere(0.1, 4);
        muscle
            .vertices
            .iter_mut()
            .for_each(|v| (v.x, v.y) = (0.2 * v.x, 0.2 * v.y));
        let from_tip: Vec<f64> = muscle.vertices.iter().map(|v| (v.z + 0.1) / 0.2).collect();
        let mut bone = box_surface([0.1, 0.1, 0.02], 0.01);
        bone.vertices.iter_mut().for_each(|v| v.z -= 0.14);
        let bone = Surface::new(&bone);
        let (drawn, way) = drawn_out(&muscle, &from_tip, 0.2, &bone).expect("drawn");
        assert!((way - 0.03).abs() <= 1e-12, "{way}");
        let nearest = |mesh: &TriangleMesh| {
            let each = mesh.vertices.iter().filter_map(|v| bone.closest(v));
            each.map(|c| c.distance).fold(f64::INFINITY, f64::min)
        };
        assert!(nearest(&drawn).abs() <= 1e-12, "{}", nearest(&drawn));
        assert!(nearest(&muscle) > 0.029, "control");
        // The half far from the end keeps its place, and the surface stays sound.
        let stays = muscle.vertices.iter().zip(&drawn.vertices);
        assert!(stays.filter(|(a, _)| a.z > 0.0).all(|(a, b)| a == b));
        assert!(Health::of(&drawn).is_fit());
        assert!(drawn.volume() > muscle.volume());
        // One that touches already needs none.
        assert!(drawn_out(&drawn, &from_tip, 0.2, &bone).is_none_or(|(_, way)| way <= 1e-12));
    }
}
