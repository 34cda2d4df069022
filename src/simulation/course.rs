//! Where the motion of a bone carries what it holds: into other bones, where no contact could keep it out.

use nalgebra::{Isometry3, Point3};

use crate::contact::{Obstacle, PosedObstacle};
use crate::scene::Scene;

/// Greatest number of frames at which the motion is looked at.
const LOOKED_AT: usize = 500;

/// The way of a bone past the others, over all keys of their motions: it does not depend on the number of
/// frames of a run.
pub(super) struct Course<'a> {
    /// The bones that move relative to it, with its pose in their frame in each frame looked at.
    others: Vec<(usize, &'a dyn Obstacle, Vec<Isometry3<f64>>)>,
    /// Number of frames between two looks.
    stride: usize,
    /// Contact thickness, and a length below which a mesh shows nothing [m].
    thickness: f64,
    edge: f64,
}

impl<'a> Course<'a> {
    /// The way of `bone`, which holds a muscle with edges of this length [m]; it leads past no other bone
    /// if contact with bones is left out.
    pub(super) fn new(scene: &Scene, bone: usize, placed: &'a [PosedObstacle], edge: f64) -> Self {
        let contact = scene.effects.contact.filter(|c| c.between.bones);
        let motion = |b: usize| &scene.bones[b].motion;
        let keys = scene.bones.iter().flat_map(|b| &b.motion.keys);
        let last = keys.map(|key| key.frame).max_by(f64::total_cmp);
        let last = last.unwrap_or(0.0) as usize;
        let stride = last / LOOKED_AT + 1;
        let start = motion(bone).pose(0.0).inverse();
        let of = |other: usize| {
            let frames = (0..=last).step_by(stride).map(|f| f as f64);
            let ways =
                frames.map(|f| motion(other).pose(f).inverse() * motion(bone).pose(f) * start);
            (other, &*placed[other].obstacle, ways.collect())
        };
        let others = (0..scene.bones.len()).filter(|&b| motion(b) != motion(bone));
        Self {
            others: contact.map_or(Vec::new(), |_| others.map(of).collect()),
            stride,
            thickness: contact.map_or(0.0, |c| c.thickness),
            edge,
        }
    }

    /// Whether a place [m] stays out of all other bones; otherwise notes where it enters one.
    pub(super) fn stays_out(&self, x: &Point3<f64>, entered: &mut Vec<(usize, usize)>) -> bool {
        let enters = self.enters(x);
        entered.extend(enters);
        enters.is_none()
    }

    /// The first bone into which a place [m] at frame 0 is carried, and the frame.
    pub(super) fn enters(&self, x: &Point3<f64>) -> Option<(usize, usize)> {
        self.others.iter().find_map(|(other, obstacle, ways)| {
            let frame = self.meets(x, *obstacle, ways)?;
            Some((*other, frame * self.stride))
        })
    }

    /// The first pose in which the place is nearer to the obstacle than half an edge, as triangles around
    /// it would be squeezed; if it is nearer than an edge at the start, than half the contact thickness;
    /// if it is nearer than that, deeper in it than at the start.
    fn meets(
        &self,
        x: &Point3<f64>,
        obstacle: &dyn Obstacle,
        ways: &[Isometry3<f64>],
    ) -> Option<usize> {
        let mut before = ways.first()? * x;
        let at_start = obstacle.closest(&before)?.distance;
        let least = if at_start >= self.edge.max(self.thickness) {
            0.5 * self.edge
        } else if at_start >= self.thickness {
            0.5 * self.thickness
        } else if at_start >= 0.0 {
            0.0
        } else {
            at_start - self.thickness
        };
        // Until it has come by this far, it cannot be there.
        let mut left = at_start - least;
        for (k, way) in ways.iter().enumerate() {
            let now = way * x;
            left -= (now - before).norm();
            before = now;
            if left > 0.0 {
                continue;
            }
            let distance = obstacle.closest(&now)?.distance;
            if k > 0 && distance < least {
                return Some(k);
            }
            left = distance - least;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin::load;
    use crate::simulation::Simulation;

    /// Where the upper plate of the press carries a place below it by this distance [m].
    fn entered(below: f64, more: &[&str]) -> Option<(usize, usize)> {
        let mut changes = vec!["muscle.0.edge_length='24 mm'".to_owned()];
        changes.extend(more.iter().map(|&c| c.to_owned()));
        let scene = load("press", &changes).expect("a scene");
        let run = Simulation::new(scene).expect("meshes");
        Course::new(&run.scene, 0, run.placed(), 2e-4).enters(&Point3::new(0.0, 0.022 - below, 0.0))
    }

    #[test]
    fn what_a_bone_carries_into_another_one_is_found_in_its_frame() {
        // The gap of 44 mm closes by 0.396 mm a frame; half the contact thickness is 0.1 mm.
        let frame = |below: f64| ((0.044 - below - 1e-4) / 0.000_396).ceil() as usize;
        assert_eq!(entered(0.010, &[]), Some((1, frame(0.010))));
        assert_eq!(entered(0.020, &[]), Some((1, frame(0.020))));
        // Controls: what the gap leaves free, no frames but those of the keys, and no contact.
        assert_eq!(entered(0.001, &[]), None);
        assert_eq!(entered(0.010, &["frames=3"]), entered(0.010, &[]));
        assert_eq!(entered(0.010, &["effects.contact=off"]), None);
    }

    #[test]
    fn an_attachment_of_which_nothing_can_stay_is_refused() {
        let attached = "muscle.0.attachment=[{bone='upper plate', near='9 mm', limit='8 %'}]";
        let loaded = |closed: &str| {
            let key = format!("bone.0.motion.keys.1.translation=['0 mm', '{closed}', '0 mm']");
            let changes = ["muscle.0.edge_length='8 mm'", attached, &key].map(str::to_owned);
            Simulation::new(load("press", &changes).expect("a scene"))
        };
        // Half an edge is left over the lower plate, whose top is at -2.2 mm in frame 100.
        let run = loaded("26 mm").unwrap_or_else(|error| panic!("{error}"));
        assert!(!run.bodies[0].attached.is_empty());
        let refused = loaded("12.2 mm").err().map(|error| error.terse());
        let refused = refused.unwrap_or_default();
        assert!(
            refused.contains("E083") && refused.contains("lower plate"),
            "{refused}"
        );
    }
}
