//! A run to a requested accuracy: as many steps as the error asks for, frame by frame.
//!
//! The error of a sweep falls nearly as the length of its step. A second run beside the first, with steps
//! twice as long, therefore tells the error of the first by its distance. Equilibria have no steps of their
//! own: there the second run has a greater tolerance.
//!
//! An error takes some frames to come and to go, because a muscle that lags behind needs time to catch up.
//! Both runs are therefore some frames ahead of the one that is shown. Where the error leaves the target, all
//! frames that are not shown yet are made again, with more steps. Nothing here depends on the time that
//! anything takes.
//!
//! How far the muscles move is known when a motion has ended. Where the error is a share of that, a first run
//! with very few steps tells it.

mod motion;
mod rule;

use std::collections::VecDeque;
use std::time::Instant;

use motion::Pilot;
pub(super) use motion::Target;
use rule::{Effort, Rule};

use super::frame::Stop;
use super::{Body, Simulation};
use crate::mesh::measures::max_or_nan;
use crate::state::{DecodeError, Reader, State, Writer};

/// Number of frames that are computed before the first of them is shown, at this rate [Hz].
const AHEAD: f64 = 24.0;
const USUAL_RATE: f64 = 60.0;
const MOST_AHEAD: f64 = 96.0;

/// What an accuracy cost, and whether it was kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Attained {
    /// Requested RMS error [m].
    pub target_m: f64,
    /// How far the vertices are from their places at the start, RMS in the frame where it is most [m]; 0 if the
    /// error is no share of it. A first run with few steps tells it.
    pub motion_m: f64,
    /// The time of that run [s].
    pub motion_s: f64,
    /// Estimated RMS error of all vertices in the worst frame so far [m].
    pub error_m: f64,
    /// The frame with it.
    pub frame: usize,
    /// Estimated RMS error of each muscle in its worst frame so far [m].
    pub muscles_m: Vec<f64>,
    /// Number of steps of all frames in the run with longer steps, and in the one that is shown.
    pub steps: [u64; 2],
    /// Time of all frames of both [s].
    pub times_s: [f64; 2],
    /// Greatest tolerance of an equilibrium in any frame of the second one; 0 for solvers with steps.
    pub tolerance: f64,
    /// Greatest distance of both, RMS over the vertices of a frame [m].
    pub difference_m: f64,
    /// Number of frames that were made again with more steps.
    pub repeated: u64,
    /// The time that they took [s].
    pub repeated_s: f64,
}

impl Attained {
    /// Whether the error is within the target in every frame so far.
    #[must_use]
    pub fn is_reached(&self) -> bool {
        self.error_m <= self.target_m
    }
}

/// The runs of an accuracy, ahead of what is shown.
pub(super) struct Refinement {
    /// The run that is shown later, and the one with longer steps.
    fine: Simulation,
    coarse: Simulation,
    rule: Rule,
    usual: f64,
    /// The run that tells the motion, and whether it has.
    pilot: Option<Pilot>,
    is_known: bool,
    /// Both runs at the frame that is shown.
    shown: Both,
    /// Frames that are not shown yet.
    ahead: VecDeque<Ahead>,
    frames_ahead: usize,
    attained: Attained,
    /// The estimate of each muscle in the frame that is shown [m].
    errors: Vec<f64>,
}

/// States of both runs, and what chooses their next steps.
struct Both {
    fine: Vec<u8>,
    coarse: Vec<u8>,
    rule: Rule,
}

/// A frame that is computed and not shown.
struct Ahead {
    both: Both,
    /// Squared distances of the two runs [m^2], summed over each muscle.
    apart: Vec<f64>,
    /// Their estimate, and that of all vertices [m].
    errors: Vec<f64>,
    error: f64,
    effort: Effort,
    steps: [u64; 2],
    times_s: [f64; 2],
}

impl Refinement {
    /// The two runs of a scene from the start of a simulation, to the requested error.
    pub fn new(fine: Simulation, coarse: Simulation, usual: u32, target: Target) -> Self {
        let usual = f64::from(usual);
        // Until a motion is known no error is within the target.
        let (target, pilot) = match target {
            Target::Error(target) => (target, None),
            Target::ShareOfMotion(share, run) => (f64::NAN, Some(Pilot::new(run, share, usual))),
        };
        let rule = Rule::new(Effort::of(&fine, usual, target));
        let frames = fine.scene.frame_rate / USUAL_RATE;
        let count = fine.bodies.len();
        let mut new = Self {
            shown: Both {
                fine: Vec::new(),
                coarse: Vec::new(),
                rule,
            },
            fine,
            coarse,
            rule,
            usual,
            is_known: pilot.is_none(),
            pilot,
            ahead: VecDeque::new(),
            frames_ahead: (AHEAD * frames).ceil().clamp(1.0, MOST_AHEAD) as usize,
            attained: Attained {
                target_m: target,
                motion_m: 0.0,
                motion_s: 0.0,
                error_m: 0.0,
                frame: 0,
                muscles_m: vec![0.0; count],
                steps: [0; 2],
                times_s: [0.0; 2],
                tolerance: 0.0,
                difference_m: 0.0,
                repeated: 0,
                repeated_s: 0.0,
            },
            errors: vec![0.0; count],
        };
        new.rule.effort.set(&mut new.fine, &mut new.coarse);
        new.shown = new.both();
        new
    }

    /// What it cost so far, and whether it was kept.
    pub fn attained(&self) -> &Attained {
        &self.attained
    }

    /// The estimated error of a muscle in the frame that is shown [m].
    pub fn error(&self, body: usize) -> f64 {
        self.errors[body]
    }

    /// Whether the error of the frame that is shown is within the target.
    pub fn is_kept(&self) -> bool {
        let counts = self.fine.bodies.iter().map(Body::count);
        let squares = self.errors.iter().zip(counts.clone());
        let sum: f64 = squares.map(|(e, n)| e * e * n as f64).sum();
        let count: usize = counts.sum();
        (sum / count.max(1) as f64).sqrt() <= self.attained.target_m
    }

    /// Goes on from `from`, whatever brought it where it is: both runs begin there.
    pub fn begin_at(&mut self, from: &Simulation) {
        self.fine.continue_from(from);
        self.coarse.continue_from(from);
        self.ahead.clear();
        self.errors.fill(0.0);
        self.shown = self.both();
    }

    /// Leaves `front` able to go on alone.
    pub fn leave(self, front: &mut Simulation) {
        front.undo(Some(&self.shown.fine));
    }

    /// Brings `front` to its next frame. Returns false if it was stopped, and then all is as before.
    pub fn next(&mut self, front: &mut Simulation, stop: Stop<'_>) -> bool {
        if !self.look_ahead(stop) {
            return false;
        }
        let last = front.scene.frames;
        while self.ahead.is_empty()
            || (self.ahead.len() < self.frames_ahead && self.fine.frame() < last)
        {
            if !self.compute(stop) {
                return false;
            }
        }
        if let Some(frame) = self.ahead.pop_front() {
            self.show(front, frame);
        }
        true
    }

    /// Finds the target, if it is a share of the motion. Returns false if it was stopped.
    fn look_ahead(&mut self, stop: Stop<'_>) -> bool {
        let Some(pilot) = self.pilot.as_mut().filter(|_| !self.is_known) else {
            return true;
        };
        let begin = Instant::now();
        let has_ended = pilot.runs_to_its_end(stop);
        self.attained.motion_s += begin.elapsed().as_secs_f64();
        if !has_ended {
            return false;
        }
        (self.attained.target_m, self.attained.motion_m) = (pilot.target(), pilot.motion());
        self.fine.notes.extend(pilot.note());
        self.is_known = true;
        let effort = Effort::of(&self.fine, self.usual, self.attained.target_m);
        self.rule = Rule::new(effort);
        effort.set(&mut self.fine, &mut self.coarse);
        self.shown = self.both();
        true
    }

    /// Computes one more frame. Returns false if it was stopped.
    fn compute(&mut self, stop: Stop<'_>) -> bool {
        self.rule.effort.set(&mut self.fine, &mut self.coarse);
        let timed = |run: &mut Simulation| {
            let begin = Instant::now();
            (run.compute_frame(stop), begin.elapsed().as_secs_f64())
        };
        let (fine, coarse) = rayon::join(|| timed(&mut self.fine), || timed(&mut self.coarse));
        if !(fine.0 && coarse.0) {
            // One of them can have ended before the other was stopped.
            let at = self.ahead.back().map_or(&self.shown, |frame| &frame.both);
            at.restore(&mut self.fine, &mut self.coarse);
            return false;
        }
        let effort = self.rule.effort;
        let steps = [&self.coarse, &self.fine].map(|run| u64::from(run.control.taken()));
        let times_s = [coarse.1, fine.1];
        let pairs = self.fine.bodies.iter().zip(&self.coarse.bodies);
        let apart: Vec<f64> = pairs.map(|(a, b)| a.squared_distance(b)).collect();
        let (distance, of) = (rms(&apart, self.vertices()), effort.of_distance());
        let error = of * distance;
        let (frame, share) = (self.fine.frame(), error / self.attained.target_m);
        if self.rule.goes_back(frame, share, self.frames_ahead) {
            self.go_back(error, times_s);
            return true;
        }
        self.rule.choose(frame, share);
        let each = apart.iter().zip(&self.fine.bodies);
        let errors = each.map(|(sum, body)| of * rms(&[*sum], body.count()));
        let (errors, both) = (errors.collect(), self.both());
        self.ahead.push_back(Ahead {
            both,
            apart,
            errors,
            error,
            effort,
            steps,
            times_s,
        });
        true
    }

    /// Goes back to the last calm frame that is not shown yet, or to the one that is, with more steps from
    /// there up to the present frame.
    fn go_back(&mut self, error: f64, times_s: [f64; 2]) {
        let (frame, target) = (self.fine.frame(), self.attained.target_m);
        let calm = self.rule.calm();
        let is_calm = |ahead: &Ahead| ahead.error <= calm * target;
        let kept = self
            .ahead
            .iter()
            .rposition(is_calm)
            .map_or(0, |last| last + 1);
        let lost: Vec<Ahead> = self.ahead.drain(kept..).collect();
        let at = self.ahead.back().map_or(&self.shown, |frame| &frame.both);
        at.restore(&mut self.fine, &mut self.coarse);
        // What these frames took, in the mean.
        let taken = lost.iter().map(|frame| frame.effort.amount);
        let sum = taken.sum::<f64>() + self.rule.effort.amount;
        let amount = sum / (lost.len() + 1) as f64;
        self.rule
            .begin_again(at.rule, frame, amount, error / target);
        let lost_s = lost.iter().flat_map(|frame| frame.times_s);
        self.attained.repeated_s += lost_s.chain(times_s).sum::<f64>();
        self.attained.repeated += (frame - self.fine.frame()) as u64;
    }

    fn show(&mut self, front: &mut Simulation, frame: Ahead) {
        let Ahead {
            both,
            apart,
            errors,
            error,
            effort,
            steps,
            times_s,
        } = frame;
        let shown = front.restore_shown(&mut Reader::new(&both.fine));
        debug_assert!(shown.is_ok());
        for (shown, fine) in front.bodies.iter_mut().zip(&self.fine.bodies) {
            shown.system.clock = fine.system.clock.clone();
        }
        self.errors = errors;
        let difference = rms(&apart, self.vertices());
        let attained = &mut self.attained;
        for (most, now) in attained.muscles_m.iter_mut().zip(&self.errors) {
            *most = max_or_nan([*most, *now]);
        }
        attained.difference_m = max_or_nan([attained.difference_m, difference]);
        // A NaN stays.
        if !attained.error_m.is_nan() && !(error <= attained.error_m) {
            (attained.error_m, attained.frame) = (error, front.frame());
        }
        for k in 0..2 {
            attained.steps[k] += steps[k];
            attained.times_s[k] += times_s[k];
        }
        attained.tolerance = max_or_nan([attained.tolerance, effort.tolerance()]);
        self.shown = both;
    }

    fn vertices(&self) -> usize {
        self.fine.bodies.iter().map(Body::count).sum()
    }

    fn both(&self) -> Both {
        let state = |run: &Simulation| {
            let mut to = Writer::default();
            run.save(&mut to);
            to.bytes
        };
        Both {
            fine: state(&self.fine),
            coarse: state(&self.coarse),
            rule: self.rule,
        }
    }
}

impl Both {
    fn restore(&self, fine: &mut Simulation, coarse: &mut Simulation) {
        fine.undo(Some(&self.fine));
        coarse.undo(Some(&self.coarse));
    }
}

/// Beside the state of the frame that is shown: that of the run with longer steps. Times are not kept.
impl Refinement {
    pub fn save(&self, to: &mut Writer) {
        let Self {
            fine: _,
            coarse: _,
            // The same as that of the frame that is shown, but for the present frame.
            rule: _,
            shown: Both { fine, coarse, rule },
            // Made again.
            ahead: _,
            frames_ahead: _,
            usual: _,
            // It runs anew.
            pilot: _,
            is_known,
            attained,
            errors,
        } = self;
        to.put(is_known);
        to.list(fine);
        to.list(coarse);
        rule.save(to);
        let Attained {
            target_m,
            motion_m,
            motion_s: _,
            error_m,
            frame,
            muscles_m,
            steps,
            times_s: _,
            tolerance,
            difference_m,
            repeated,
            repeated_s: _,
        } = attained;
        to.put(&[*target_m, *motion_m, *error_m, *difference_m]);
        to.put(frame);
        to.put(repeated);
        to.list(muscles_m);
        to.list(errors);
        to.put(steps);
        to.put(tolerance);
    }

    /// Restores both runs, and what `front` shows of them.
    pub fn restore(
        &mut self,
        front: &mut Simulation,
        from: &mut Reader<'_>,
    ) -> Result<(), DecodeError> {
        let is_known = from.take::<bool>()?;
        let (fine, coarse): (Vec<u8>, Vec<u8>) = (from.take()?, from.take()?);
        self.rule.restore(from)?;
        let [target_m, motion_m, error_m, difference_m] = from.take()?;
        let (frame, repeated) = (from.take()?, from.take()?);
        let (muscles_m, errors): (Vec<f64>, Vec<f64>) = (from.take()?, from.take()?);
        let count = self.fine.bodies.len();
        from.check(
            [&muscles_m, &errors].iter().all(|e| e.len() == count),
            "another number of muscles",
        )?;
        self.errors = errors;
        let (steps, tolerance) = (from.take()?, from.take()?);
        self.is_known = is_known;
        self.attained = Attained {
            target_m,
            motion_m,
            error_m,
            difference_m,
            frame,
            repeated,
            muscles_m,
            steps,
            tolerance,
            ..self.attained.clone()
        };
        self.shown = Both {
            fine,
            coarse,
            rule: self.rule,
        };
        front.restore_shown(&mut Reader::new(&self.shown.fine))?;
        self.ahead.clear();
        self.fine.restore(&mut Reader::new(&self.shown.fine))?;
        self.coarse.restore(&mut Reader::new(&self.shown.coarse))
    }
}

/// Root of the mean over `count` vertices [m] of squared distances that are summed over muscles [m^2].
fn rms(sums: &[f64], count: usize) -> f64 {
    (sums.iter().sum::<f64>() / count.max(1) as f64).sqrt()
}
