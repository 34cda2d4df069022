//! Jumps: an edge that grows within a frame as no stable step lets it grow.

use nalgebra::Point3;

use super::body::{Body, Stepper};
use super::frame::FrameSteps;
use crate::constraints::distance::Distance;
use crate::solvers::grip::DRAG;
use crate::solvers::{Broken, DIVERGENCE};

/// An edge jumps if it grows in a frame to this multiple of its length at the start of the frame and
/// at rest: springs in a stable step bring it nearer to its rest length.
const JUMP: f64 = 2.0;

/// A surface that grows less than this under the shortest steps moves fast, and does not jump.
const LAST_JUMP: f64 = 4.0;

/// A surface of which a sweep makes an edge this much longer has burst. Contact with what it passes,
/// millions of pairs, would take minutes, and it cannot mend it.
const BURST: f64 = 8.0;

/// A jump is looked for after this number of steps, and at the end of a frame.
const EVERY: usize = 4;

impl Body {
    /// True if shorter steps can help the body; what a user drags may stretch.
    pub(super) fn can_jump(&self) -> bool {
        let is_swept = matches!(self.method, Stepper::Sweeps);
        self.resists_stretch && is_swept && !self.is_dragged() && self.stopped.is_none()
    }

    fn is_dragged(&self) -> bool {
        self.system.elastic.iter().any(|part| part.name() == DRAG)
    }

    /// Notes a jump up to a step; in the last try it stops the body. Returns true if the body goes no
    /// further.
    pub(super) fn stops_or_jumps(&mut self, of: &FrameSteps<'_>, step: usize) -> bool {
        let is_looked_at = (step + 1).is_multiple_of(EVERY) || step + 1 == of.steps.len();
        if is_looked_at && self.can_jump() && self.jump.is_none() {
            self.jump = self.jumped(if of.is_last_try { LAST_JUMP } else { JUMP });
            if let Some(particle) = self.jump.filter(|_| of.is_last_try) {
                let effect = DIVERGENCE;
                self.stop(of.frame, Broken { effect, particle });
            }
        }
        self.jump.is_some() || self.stopped.is_some()
    }

    /// Notes that a sweep burst the surface, before contact sees it; in the last try it stops the body.
    /// Returns true if the body goes no further.
    pub(super) fn bursts(&mut self, of: &FrameSteps<'_>) -> bool {
        // Most steps end here.
        if self.system.longest_way() <= self.edge_length || self.is_dragged() {
            return false;
        }
        let Some(particle) = self.jumped(BURST) else {
            return false;
        };
        if of.is_last_try {
            let effect = DIVERGENCE;
            self.system.back_to_start();
            self.stop(of.frame, Broken { effect, particle });
        } else {
            self.jump = Some(particle);
        }
        true
    }

    /// Stops the body if it was torn apart in a frame.
    pub(super) fn stop_if_torn(&mut self, of: &FrameSteps<'_>) {
        if let Some(particle) = self.torn() {
            let effect = DIVERGENCE;
            self.stop(of.frame, Broken { effect, particle });
        }
    }

    /// Stops the body at its last valid frame.
    pub(super) fn stop(&mut self, frame: usize, broken: Broken) {
        self.system.particles = self.good.clone();
        self.stopped = Some((frame, broken));
    }

    /// A vertex of an edge that grew to more than `times` its length since the last frame.
    fn jumped(&self, times: f64) -> Option<usize> {
        let squared =
            |x: &[Point3<f64>], [a, b]: [u32; 2]| (x[a as usize] - x[b as usize]).norm_squared();
        let now = &self.system.particles.position;
        let jumps = |edge: &&Distance| {
            let before = squared(&self.good.position, edge.points);
            let most = times * times * before.max(edge.rest * edge.rest);
            // Not `>`, which is false for NaN. What bones hold moves as they do.
            !(squared(now, edge.points) <= most)
                && edge.points.iter().any(|&v| self.is_free(v as usize))
        };
        let edge = self.edges.iter().find(jumps)?;
        let free = edge.points.iter().find(|&&v| self.is_free(v as usize));
        free.map(|&v| v as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Simulation;
    use crate::scene::builtin::load;

    #[test]
    fn a_surface_that_bursts_in_a_sweep_is_no_matter_for_contact() {
        // Long steps under pressure: a sweep throws a vertex across a whole plate.
        let changes = [
            "frames=30",
            "frame_rate='6 Hz'",
            "muscle.0.edge_length='20 mm'",
            "solver=pbd",
            "effects.volume.pressure=1.14",
            "bone.0.motion.keys.1.frame=10",
            "bone.0.motion.keys.2.frame=20",
            "bone.1.motion.keys.1.frame=10",
            "bone.1.motion.keys.2.frame=20",
        ];
        let scene = load("press", &changes.map(str::to_owned)).expect("a scene");
        let mut run = Simulation::new(scene).expect("meshes");
        (0..8).for_each(|_| run.step_frame());
        // With contact after such a sweep more than five million pairs were looked at in a step.
        let certificate = run.certificate();
        assert!(certificate.pairs < 1_000_000, "{certificate:?}");
        assert!(run.control.most() > 1, "control: some step is too long");
    }
}
