//! Step control: a frame in which a surface jumps is undone, and repeated with shorter steps.
//!
//! Sweeps over constraints are stable only with steps that are short enough for the stiffness, the
//! shortest edges and the motion of a scene. Beyond that, single vertices fly off within a frame, and
//! contact with the triangles that they stretch takes minutes. Such a frame is not shown. It is
//! computed again from its start with twice as many steps, and the frames after it as well, until
//! some frames in a row are calm.
//!
//! The same holds for a frame that loses a volume, and, where a scene names no number of steps, for one
//! whose residual is above the tolerance. Shorter steps are not tried again where they did not lessen it.
//!
//! A shape depends a little on the number of steps, so that a number that doubles within a motion shifts
//! whole surfaces in one frame. Where a scene names none, it therefore follows the residual gently: by a
//! few per cent a frame, well before a residual reaches the tolerance.
//!
//! A step of classic PBD is not made shorter but in parts, and its stiffness is divided among them: its
//! material and its damping come from the length of its step, and remain as they are.

use crate::scene::Scene;
use crate::state::{DecodeError, Reader, State, Writer};

/// Greatest number of steps of a frame, relative to that of the scene, and to the first one where the
/// scene names none; greatest number of parts of a step of classic PBD.
const MOST: u32 = 16;
const MOST_ADAPTED: u32 = 64;
/// Greatest number that a residual asks for, relative to the first one: where it falls as slowly as that of a
/// muscle that crumples, more are too dear, and what is not converged is red.
const MOST_FOLLOWED: u32 = 32;
/// Frames that are longer than those of this rate [Hz] have as many times more, up to a limit: what a
/// motion needs is short steps, however its frames are cut.
const USUAL_RATE: f64 = 60.0;
const MOST_LONGER: f64 = 64.0;
const MOST_PARTS: u32 = 256;

/// Number of calm frames after which steps become longer again.
const CALM: u32 = 8;

/// Twice as many steps bring a residual below this share of itself, or they do not help: they bring an
/// error of the steps to a quarter.
const LESS: f64 = 0.7;

/// Greatest factor by which steps become shorter before this counts as no help: the first time, and later.
/// Where steps are far too long, steps half as long leave nine tenths of a residual. Only short ones leave a
/// quarter.
const PATIENCE: (u32, u32) = (8, 2);

/// A residual that shorter steps did not lessen is accepted up to this multiple of it.
const ACCEPTED: f64 = 1.5;

/// Steps become longer while the residual is below this share of the tolerance: twice the length
/// brings four times the residual.
const EASY: f64 = 0.2;

/// Where a scene names no number of steps, it rises by this factor a frame while the residual is above
/// this share of the tolerance, and falls by that one while it is below that share.
const RISE: (f64, f64) = (1.06, 0.3);
const FALL: (f64, f64) = (0.97, 0.2);

/// Steps that rose by this factor are compared once with longer ones, whether they help.
const PROVED: u32 = 2;

/// How many steps a frame takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StepControl {
    /// Number of steps of a frame, of at least `first` and at most `most` times as many: a power of two
    /// times `first`, unless it follows the residual.
    steps: u32,
    first: u32,
    most: u32,
    /// Greatest number for the sake of the residual, relative to the first one.
    most_followed: u32,
    /// Whether it follows the residual, the number up to which shorter steps are known to help, and
    /// whether the present frame proves it for a greater one.
    follows: bool,
    /// Whether a requested accuracy chooses the first one for each frame.
    is_told: bool,
    proved: u32,
    proof: Proof,
    /// Number of steps of the frame before, and whether any frame took more than the first.
    taken: u32,
    has_risen: bool,
    /// No number rises while the residual is below this, relative to the tolerance.
    rises_above: f64,
    /// Number of calm frames since it changed.
    calm: u32,
    /// Number of frames that were repeated for a jump, and for their residual.
    repeated: u64,
    refined: u64,
    /// The greatest residual that is accepted, relative to the tolerance, and the last one of the present
    /// frame that shorter steps lessened, with its number of steps.
    accepted: f64,
    tried: f64,
    tried_with: u32,
    /// Greatest factor by which steps become shorter before this counts as no help.
    patience: u32,
}

/// A frame that is made with half of the steps and with all, to see whether they help.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Proof {
    Not,
    Half,
    /// With the residual of half of the steps, relative to the tolerance.
    Whole(f64),
}

impl StepControl {
    /// Begins with the number of steps of the scene, or with the first one if it names none.
    pub fn new(scene: &Scene) -> Self {
        let (first, follows) = (scene.solver.substeps(), scene.adapts_steps);
        let longer = USUAL_RATE / scene.frame_rate;
        let longer = longer.clamp(1.0, MOST_LONGER).ceil() as u32;
        let most = match scene.solver.has_classic_stiffness() {
            true => MOST_PARTS,
            false if follows => longer * MOST_ADAPTED,
            false => MOST,
        };
        Self {
            steps: first,
            first,
            follows,
            is_told: false,
            proved: first,
            proof: Proof::Not,
            taken: first,
            has_risen: false,
            rises_above: RISE.1,
            most,
            most_followed: match follows {
                true => most.min(longer * MOST_FOLLOWED),
                false => most,
            },
            calm: 0,
            repeated: 0,
            refined: 0,
            tried: f64::INFINITY,
            tried_with: first,
            patience: PATIENCE.0,
            accepted: 1.0,
        }
    }

    /// The same for a scene that takes over from another one.
    #[must_use]
    pub fn taken_over(&self, by: &Self) -> Self {
        let Self {
            first,
            most,
            most_followed,
            follows,
            ..
        } = *by;
        let factor = (self.steps / self.first).min(most);
        let steps = first.saturating_mul(1 << factor.ilog2());
        Self {
            steps,
            first,
            most,
            most_followed,
            follows,
            proved: steps,
            taken: steps,
            ..*self
        }
    }

    /// Gives later frames this number of steps, besides what jumps ask for.
    pub fn tell(&mut self, first: u32) {
        let factor = self.steps / self.first;
        let steps = first.saturating_mul(factor);
        (self.first, self.steps, self.proved, self.is_told) = (first, steps, steps, true);
    }

    /// Sets the greatest number of steps of a frame, relative to the first one.
    pub fn limit(&mut self, most: u32) {
        (self.most, self.most_followed) = (most, most);
        self.steps = self.steps.min(self.greatest());
    }

    /// Begins a frame.
    pub fn begin_frame(&mut self) {
        self.tried = f64::INFINITY;
        self.proof = Proof::Not;
        if self.follows && self.steps >= PROVED.saturating_mul(self.proved) {
            self.steps /= 2;
            self.proof = Proof::Half;
        }
    }

    /// Goes back to the number of steps of the frame before: what needed more has stopped.
    pub fn let_go(&mut self) {
        self.steps = self.taken.max(self.first);
        self.proved = self.proved.min(self.steps);
    }

    /// Greatest number of steps of a frame, relative to that at the start.
    pub fn most(&self) -> u32 {
        self.most
    }

    /// Number of steps of the present frame.
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// Number of steps of the frame before.
    pub fn taken(&self) -> u32 {
        self.taken
    }

    /// True if a number that follows the residual is above the first one for the first time.
    pub fn rises_first(&mut self) -> bool {
        let is_above = self.follows && self.steps > self.first;
        is_above && !std::mem::replace(&mut self.has_risen, true)
    }

    fn greatest(&self) -> u32 {
        self.first.saturating_mul(self.most)
    }

    /// Greatest number of steps for the sake of the residual.
    fn greatest_for_residual(&self) -> u32 {
        self.first.saturating_mul(self.most_followed.min(self.most))
    }

    /// True if no shorter steps are tried.
    pub fn is_shortest(&self) -> bool {
        self.steps >= self.greatest()
    }

    /// Takes shorter steps after a jump. Returns true the first time.
    pub fn shorten(&mut self) -> bool {
        self.double();
        self.proved = self.steps;
        self.proof = Proof::Not;
        self.repeated += 1;
        self.repeated == 1
    }

    fn double(&mut self) {
        self.steps = self.steps.saturating_mul(2).min(self.greatest());
        self.calm = 0;
    }

    /// Takes shorter steps after a frame with this residual, relative to the tolerance, if they can
    /// lessen it. Returns true if the frame is to be repeated.
    pub fn refines(&mut self, residual: f64) -> bool {
        match std::mem::replace(&mut self.proof, Proof::Not) {
            Proof::Half => {
                self.double();
                self.proved = self.steps;
                self.proof = Proof::Whole(residual);
                return true;
            }
            // More steps do not help: their number stays, up to a greater residual.
            Proof::Whole(half) if !(residual <= LESS * half) => {
                self.rises_above = ACCEPTED * residual;
            }
            Proof::Whole(_) | Proof::Not => {}
        }
        // NaN is not lessened.
        if !(residual > self.accepted) {
            return false;
        }
        let is_last = self.steps.saturating_mul(2) > self.greatest_for_residual();
        if residual > LESS * self.tried {
            if is_last || self.steps >= self.patience.saturating_mul(self.tried_with) {
                self.patience = PATIENCE.1;
                self.accepted = ACCEPTED * residual;
                self.steps = self.tried_with;
                self.proved = self.steps;
                return false;
            }
        } else {
            (self.tried, self.tried_with) = (residual, self.steps);
        }
        if is_last {
            return false;
        }
        self.refined += 1;
        self.double();
        self.proved = self.steps;
        true
    }

    /// True if a frame was repeated for its residual.
    pub fn has_refined(&self) -> bool {
        self.refined > 0
    }

    /// Ends a frame.
    pub fn end_frame(&mut self) {
        self.taken = self.steps;
        (self.tried, self.tried_with) = (f64::INFINITY, self.first);
    }

    /// Notes a frame without a jump, with its residual relative to the tolerance.
    pub fn note_calm(&mut self, residual: f64) {
        if residual <= 1.0 {
            self.accepted = 1.0;
        }
        if self.follows {
            return self.follow(residual);
        }
        if !(residual <= EASY || residual > 1.0) {
            self.calm = 0;
            return;
        }
        self.calm += 1;
        if self.calm >= CALM && self.steps > self.first {
            (self.steps, self.calm) = (self.steps / 2, 0);
        }
    }

    /// Lets the number of steps follow the residual.
    fn follow(&mut self, residual: f64) {
        let steps = f64::from(self.steps);
        if residual > self.rises_above {
            self.calm = 0;
            let most = self.greatest_for_residual().max(self.steps);
            self.steps = ((RISE.0 * steps).ceil() as u32).min(most);
        } else if residual < FALL.1 || residual > 1.0 {
            // More steps are in vain for what is above the tolerance here.
            if residual < FALL.1 {
                self.rises_above = RISE.1;
            }
            self.calm += 1;
            if self.calm >= CALM {
                self.steps = ((FALL.0 * steps).floor() as u32).max(self.first);
                self.proved = self.proved.min(self.steps);
            }
        } else {
            self.calm = 0;
        }
    }
}

impl State for StepControl {
    fn save(&self, to: &mut Writer) {
        let Self {
            steps,
            first,
            most: _,
            most_followed: _,
            follows: _,
            is_told,
            proved,
            // Each frame begins with it.
            proof: _,
            taken,
            has_risen,
            rises_above,
            calm,
            repeated,
            refined,
            accepted,
            patience,
            // Each frame begins without one.
            tried: _,
            tried_with: _,
        } = self;
        to.put(is_told);
        to.put(first);
        to.put(steps);
        to.put(proved);
        to.put(taken);
        to.put(has_risen);
        to.put(rises_above);
        to.put(calm);
        to.put(repeated);
        to.put(refined);
        to.put(accepted);
        to.put(patience);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let is_told: bool = from.take()?;
        let first: u32 = from.take()?;
        from.check(
            is_told && first > 0 || first == self.first,
            "another number of steps",
        )?;
        *self = Self {
            is_told,
            first,
            steps: from.take()?,
            proved: from.take()?,
            taken: from.take()?,
            has_risen: from.take()?,
            rises_above: from.take()?,
            calm: from.take()?,
            repeated: from.take()?,
            refined: from.take()?,
            accepted: from.take()?,
            patience: from.take()?,
            ..*self
        };
        let (steps, range) = (self.steps, self.first..=self.greatest());
        let is_fit =
            self.follows || steps % self.first == 0 && (steps / self.first).is_power_of_two();
        let is_sound = range.contains(&steps)
            && range.contains(&self.proved)
            && (range.contains(&self.taken) || self.is_told && self.taken > 0)
            && is_fit;
        from.check(is_sound, "a number of steps that no frame takes")
    }
}

#[cfg(test)]
mod tests {
    use super::super::Simulation;
    use crate::scene::builtin::load;

    use super::StepControl;
    use crate::state::{Reader, State, Writer};

    /// A control that follows residuals, with 20 steps at first.
    fn following() -> StepControl {
        let scene = load("volume", &[]).expect("a scene");
        StepControl {
            tried_with: 20,
            steps: 20,
            first: 20,
            most: 64,
            most_followed: super::MOST_FOLLOWED,
            follows: true,
            proved: 20,
            taken: 20,
            ..StepControl::new(&scene)
        }
    }

    /// Makes a frame with this residual for a number of steps. Returns the number that it took in the end,
    /// and how often it was made.
    fn frame(control: &mut StepControl, residual: impl Fn(u32) -> f64) -> (u32, usize) {
        control.begin_frame();
        let mut made = 1;
        while control.refines(residual(control.steps())) {
            made += 1;
        }
        control.end_frame();
        let taken = control.taken();
        control.note_calm(residual(control.steps()));
        (taken, made)
    }

    #[test]
    fn steps_follow_a_residual_gently_and_go_back() {
        let mut control = following();
        let (mut before, mut most, mut repeated) = (20, 20, 0);
        // A load that rises and falls; twice the steps bring a quarter of the residual.
        for k in 0..800 {
            let angle = std::f64::consts::TAU * f64::from(k.min(600)) / 600.0;
            let load = 20.0 * (1.0 - libm::cos(angle));
            let of = |steps: u32| load * (20.0 / f64::from(steps)).powi(2);
            let (taken, made) = frame(&mut control, of);
            assert!(of(taken) <= 1.0, "frame {k}: {}", of(taken));
            let change = f64::from(taken.abs_diff(before));
            assert!(
                change <= (0.06 * f64::from(before)).ceil(),
                "frame {k}: {before} {taken}"
            );
            (before, most) = (taken, most.max(taken));
            repeated += made - 1;
        }
        assert!(
            most >= 200,
            "control: the load needs many steps, not {most}"
        );
        assert_eq!(control.steps(), 20);
        // Only to prove that more steps help.
        assert!(repeated <= 8, "{repeated}");
    }

    #[test]
    fn steps_that_do_not_help_do_not_rise() {
        let mut control = following();
        let greatest = (0..200).map(|_| frame(&mut control, |_| 0.5).0).max();
        assert_eq!(greatest, Some(40), "once, to see whether they help");
        // A greater residual is looked at anew.
        for _ in 0..40 {
            frame(&mut control, |_| 0.9);
        }
        assert!(control.steps() > 40);
        // Above the tolerance as well, and then there are fewer again.
        for _ in 0..200 {
            frame(&mut control, |_| 1.2);
        }
        assert_eq!(control.steps(), 20);
    }

    #[test]
    fn a_residual_that_falls_slowly_is_not_followed_at_any_price() {
        let mut control = following();
        // Twice as many steps leave two thirds.
        let slow = |load: f64| move |steps: u32| load * (20.0 / f64::from(steps)).powf(0.585);
        for k in 0..300 {
            frame(&mut control, slow(f64::from(k) * 0.04));
        }
        assert_eq!(control.steps(), 20 * super::MOST_FOLLOWED);
        // It goes back with the load.
        (0..400).for_each(|_| _ = frame(&mut control, slow(0.1)));
        assert_eq!(control.steps(), 20);
        // Control: one that falls fast has the steps that it needs.
        let mut control = following();
        let of = |steps: u32| 200.0 * (20.0 / f64::from(steps)).powi(2);
        let taken = (0..300).map(|_| frame(&mut control, of).0).last();
        assert!(of(taken.expect("frames")) <= 0.4);
    }

    #[test]
    fn steps_that_are_far_too_long_become_short_enough() {
        // The press with a tenth of its frames: 20 to 640 steps of a frame.
        let measured = |steps: u32| match steps {
            0..40 => 1.6,
            40..80 => 1.46,
            80..160 => 1.18,
            160..320 => 0.7,
            320..640 => 0.26,
            _ => 0.08,
        };
        let mut control = following();
        let (taken, made) = frame(&mut control, measured);
        assert_eq!((taken, made), (160, 4));
        // Control: what no steps lessen is found out once, and the number goes back.
        let mut control = following();
        assert_eq!(frame(&mut control, |_| 1.6), (20, 4));
        assert_eq!(frame(&mut control, |_| 1.7).1, 1);
        assert_eq!(
            frame(&mut control, |_| 4.0).1,
            2,
            "once with so much patience"
        );
    }

    #[test]
    fn a_state_of_the_control_comes_back() {
        let mut control = following();
        for _ in 0..30 {
            frame(&mut control, |steps| 100.0 / f64::from(steps));
        }
        let mut bytes = Writer::default();
        control.save(&mut bytes);
        let mut other = following();
        other
            .restore(&mut Reader::new(&bytes.bytes))
            .expect("a state");
        assert_eq!(other, control);
        // One that follows no residual takes no such number.
        let mut strict = StepControl {
            follows: false,
            ..following()
        };
        assert!(!control.steps().is_power_of_two(), "control");
        assert!(strict.restore(&mut Reader::new(&bytes.bytes)).is_err());
    }

    /// A muscle by classic PBD of one step a frame, between plates that close on it.
    fn pressed() -> Simulation {
        let changes = [
            "frames=80",
            "muscle.0.edge_length='24 mm'",
            "solver=pbd",
            "solver.pbd.stretch=0.1",
            "effects.damping=off",
        ];
        let scene = load("press", &changes.map(str::to_owned)).expect("a scene");
        Simulation::new(scene).expect("meshes")
    }

    /// The error of the volume after 80 frames.
    fn lost(run: &mut Simulation) -> f64 {
        (0..80).for_each(|_| run.step_frame());
        run.bodies[0].volume_residual()
    }

    #[test]
    fn a_frame_of_classic_pbd_that_loses_the_volume_is_made_in_parts() {
        let mut run = pressed();
        let found = lost(&mut run);
        assert!(found <= 1e-12, "{found}");
        assert_eq!(run.bodies[0].stopped, None);
        assert!(run.control.has_refined());
        // Control: in one part.
        let mut run = pressed();
        run.control.most = 1;
        let found = lost(&mut run);
        assert!(!(found <= 1e-6), "{found}");
    }
}
