//! How many steps the frames of an accuracy take.

use super::super::Simulation;
use crate::state::{DecodeError, Reader, State, Writer};

/// Ratio of the lengths of steps of the two runs.
const RATIO: u32 = 2;

/// Error relative to the distance of the two runs: where steps are as many as stability and stiffness ask
/// for, and what it rises by for each halving of their number. There are too few sweeps then, and both runs
/// lag behind alike.
const OF_DISTANCE: f64 = 0.65;
const FOR_HALF: f64 = 0.4;
const MOST_OF_DISTANCE: f64 = 1.6;

/// Greatest factor by which jumps shorten the steps of the run with longer ones.
const COARSE_MOST: u32 = 4;

/// Ratio of the tolerances of two equilibria, and their error relative to their distance: a descent ends
/// anywhere below its tolerance.
const LOOSER: f64 = 16.0;
const OF_LOOSER: f64 = 0.5;

/// The steps aim at this share of the target.
const AIM: f64 = 0.7;

/// Frames are made again from the last one whose error is at most this share of the target: for the first
/// time, and the second. After that, all are that are not shown.
const FROM: [f64; 2] = [0.5, 0.25];

/// By how much the number of steps changes from frame to frame: a power of the error over what it aims at,
/// and the greatest change. Least and greatest factor where frames are made again.
const FALL: (f64, f64) = (0.1, 0.96);
const RISE: (f64, f64) = (0.3, 1.05);
const AGAIN: (f64, f64) = (1.3, 4.0);

/// A peak of the error fades by this factor a frame, and has passed when the error is below this share of it.
const FADES: f64 = 0.98;
const PASSED: f64 = 0.9;

/// Twice as many steps help if they bring an error below this share of itself. Two runs can differ for ever
/// where a surface folds in different ways.
const LESS: f64 = 0.8;

/// What more steps do not lessen is accepted up to this multiple of it.
const ACCEPTED: f64 = 1.25;

/// For this error, relative to the length of the shortest muscle, a run begins with half of the usual steps;
/// for another one with more as the root of it, within these factors. Where errors add up, steps that are few
/// at first are never made good; too many at first cost most where a motion is short.
const USUAL_ERROR: f64 = 1e-2;
const FIRST: f64 = 0.5;
const GUESSES: (f64, f64) = (0.25, 4.0);

/// Least and greatest number of steps of a frame, relative to the usual one: with fewer, surfaces fold that
/// stay folded.
const LEAST: f64 = 0.3;
const MOST: f64 = 16.0;

/// Tolerance of an equilibrium at first, and the least and the greatest one.
const FIRST_TOLERANCE: f64 = 1e-3;
const LEAST_TOLERANCE: f64 = 1e-9;
const MOST_TOLERANCE: f64 = 1e-2;

/// How much a frame may cost: a number of steps, or a factor on the exactness of an equilibrium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Effort {
    /// The number of steps, or what divides the first tolerance.
    pub amount: f64,
    /// The usual number of steps; `None` for equilibria.
    usual: Option<f64>,
}

impl Effort {
    /// A guess for the first frames of a run.
    pub fn of(run: &Simulation, usual: f64, target: f64) -> Self {
        let lengths = run.bodies.iter().map(|body| body.length);
        let share = target / lengths.fold(f64::INFINITY, f64::min);
        let effort = Self {
            amount: 1.0,
            usual: run.scene.solver.has_inertia().then_some(usual),
        };
        match effort.usual {
            None => effort,
            Some(usual) => {
                let guess = FIRST * (USUAL_ERROR / share).sqrt();
                effort.times(guess.clamp(GUESSES.0, GUESSES.1) * usual)
            }
        }
    }

    fn range(self) -> (f64, f64) {
        match self.usual {
            None => (
                FIRST_TOLERANCE / MOST_TOLERANCE,
                FIRST_TOLERANCE / LEAST_TOLERANCE,
            ),
            Some(usual) => (LEAST * usual, MOST * usual),
        }
    }

    pub fn times(self, factor: f64) -> Self {
        let (least, most) = self.range();
        // A NaN asks for as much as there is.
        let amount = match self.amount * factor {
            amount if amount <= most => amount.max(least),
            _ => most,
        };
        Self { amount, ..self }
    }

    pub fn is_greatest(self) -> bool {
        self.amount >= self.range().1
    }

    /// Error relative to the distance of the runs.
    pub fn of_distance(self) -> f64 {
        let Some(usual) = self.usual else {
            return OF_LOOSER;
        };
        let fewer = FOR_HALF * libm::log2(usual / self.amount);
        (OF_DISTANCE + fewer).clamp(OF_DISTANCE, MOST_OF_DISTANCE)
    }

    /// Sets both runs for the next frame.
    pub fn set(self, fine: &mut Simulation, coarse: &mut Simulation) {
        if self.usual.is_none() {
            let tolerance = self.tolerance();
            fine.set_tolerance(tolerance);
            coarse.set_tolerance(LOOSER * tolerance);
        } else {
            let fewer = (self.amount / f64::from(RATIO)).ceil() as u32;
            fine.control.tell(RATIO * fewer);
            coarse.control.tell(fewer);
            coarse.control.limit(COARSE_MOST);
        }
    }

    /// The tolerance of the run that is shown; 0 for solvers with steps.
    pub fn tolerance(self) -> f64 {
        match self.usual {
            None => FIRST_TOLERANCE / self.amount,
            Some(_) => 0.0,
        }
    }
}

/// Chooses the steps of each frame. All errors are relative to the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rule {
    pub effort: Effort,
    /// No frame up to this one takes less, and how much.
    floor: (usize, f64),
    /// The last frame for which frames were made again, how often in its surroundings, and the effort before.
    again: (usize, u32, f64),
    /// Errors up to this one are accepted.
    accepted: f64,
    /// The effort and the error when it began to rise; zero if it does not.
    rise: (f64, f64),
    /// Whether rising was in vain.
    is_vain: bool,
    /// A recent peak of the error: before one, few steps would be too few later.
    peak: f64,
}

impl Rule {
    pub fn new(effort: Effort) -> Self {
        Self {
            effort,
            floor: (0, 0.0),
            again: (0, 0, 0.0),
            accepted: 0.0,
            rise: (0.0, 0.0),
            is_vain: false,
            peak: 0.0,
        }
    }

    /// Chooses the steps of the frame after `frame` by the error there. They follow it slowly: it comes
    /// from many frames, and the steps of one hardly change it.
    pub fn choose(&mut self, frame: usize, error: f64) {
        let share = error / AIM;
        let faded = FADES * self.peak;
        self.peak = if error <= faded { faded } else { error };
        if share <= 1.0 {
            (self.rise, self.is_vain) = ((0.0, 0.0), false);
            if error <= PASSED * self.peak {
                let factor = libm::pow(share, FALL.0).clamp(FALL.1, 1.0);
                self.effort = self.effort.times(factor);
            }
        } else if !self.is_vain {
            if self.rise.0 == 0.0 {
                self.rise = (self.effort.amount, error);
            }
            let (amount, before) = self.rise;
            if self.effort.amount >= 2.0 * amount && !(error <= LESS * before) {
                self.is_vain = true;
                self.effort.amount = amount;
            } else {
                let factor = libm::pow(share, RISE.0).clamp(1.0, RISE.1);
                self.effort = self.effort.times(factor);
            }
        }
        if frame < self.floor.0 && !(self.effort.amount >= self.floor.1) {
            self.effort.amount = self.floor.1;
        }
    }

    /// Whether the error of `frame` asks for more steps in it and in the frames before, of which up to
    /// `ahead` can be made again.
    pub fn goes_back(&mut self, frame: usize, error: f64, ahead: usize) -> bool {
        let is_near = self.again.1 > 0 && frame <= self.again.0 + ahead;
        if !is_near {
            (self.again, self.accepted) = ((frame, 0, self.effort.amount), 0.0);
        }
        if error <= 1.0 {
            return false;
        }
        let (last, times, amount) = self.again;
        self.again.0 = last.max(frame);
        if error <= self.accepted {
            return false;
        }
        if times as usize > FROM.len() || self.effort.is_greatest() {
            self.accepted = ACCEPTED * error;
            (self.effort.amount, self.floor, self.is_vain) = (amount, (0, 0.0), true);
            return false;
        }
        self.again.1 += 1;
        true
    }

    /// Frames whose error is at most this are good enough to begin again from.
    pub fn calm(&self) -> f64 {
        let times = self.again.1.saturating_sub(1) as usize;
        FROM.get(times).copied().unwrap_or(0.0)
    }

    /// Begins again with the rule of an earlier frame, and more than the `amount` with which the error of
    /// `frame` came about.
    pub fn begin_again(&mut self, from: Self, frame: usize, amount: f64, error: f64) {
        let factor = (error / AIM).clamp(AGAIN.0, AGAIN.1);
        let effort = Effort {
            amount,
            ..self.effort
        }
        .times(factor);
        *self = Self {
            effort,
            floor: (frame, effort.amount),
            again: self.again,
            accepted: self.accepted,
            ..from
        };
    }
}

impl State for Rule {
    fn save(&self, to: &mut Writer) {
        let Self {
            effort: Effort { amount, usual: _ },
            floor,
            again,
            accepted,
            rise,
            is_vain,
            peak,
        } = self;
        to.put(&[*amount, floor.1, again.2, *accepted]);
        to.put(&[rise.0, rise.1, *peak]);
        to.put(&[floor.0, again.0]);
        to.put(&again.1);
        to.put(is_vain);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let [amount, least, before, accepted] = from.take()?;
        let [rise, error, peak] = from.take()?;
        let [until, last] = from.take()?;
        let range = self.effort.range();
        let is_sound = amount >= range.0 && amount <= range.1;
        from.check(is_sound, "a number of steps that no frame takes")?;
        *self = Self {
            effort: Effort {
                amount,
                ..self.effort
            },
            floor: (until, least),
            again: (last, from.take()?, before),
            accepted,
            rise: (rise, error),
            is_vain: from.take()?,
            peak,
        };
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AHEAD: usize = 24;

    fn begun(amount: f64) -> Rule {
        Rule::new(Effort {
            amount,
            usual: Some(64.0),
        })
    }

    /// Runs 200 frames with the error that a frame and its effort make. Frames are made again where the
    /// rule asks for it, each time all that are not older than `AHEAD`. Returns the last error of each
    /// frame, the mean effort and the number of all frames that were made.
    fn frames(mut rule: Rule, error: impl Fn(usize, f64) -> f64) -> (Vec<f64>, f64, usize) {
        let mut kept: Vec<(Rule, f64, f64)> = Vec::new();
        let mut made = 0;
        while kept.len() < 200 {
            made += 1;
            assert!(made <= 20_000, "it goes on for ever");
            let (frame, before) = (kept.len() + 1, rule);
            let found = error(frame, rule.effort.amount);
            if rule.goes_back(frame, found, AHEAD) {
                let amount = rule.effort.amount;
                let least = kept.len().saturating_sub(AHEAD);
                let calm = rule.calm();
                let new = kept[least..].iter().rposition(|(_, e, _)| *e <= calm);
                kept.truncate(new.map_or(least, |last| least + last + 1));
                let from = kept.last().map_or(begun(before.effort.amount), |k| k.0);
                rule.begin_again(from, frame, amount, found);
                continue;
            }
            let amount = rule.effort.amount;
            rule.choose(frame, found);
            kept.push((rule, found, amount));
        }
        let mean = kept.iter().map(|k| k.2).sum::<f64>() / 200.0;
        (kept.into_iter().map(|k| k.1).collect(), mean, made)
    }

    #[test]
    fn an_error_that_more_steps_lessen_is_kept_at_the_price_of_few_frames() {
        let (errors, mean, made) = frames(begun(8.0), |_, amount| 40.0 / amount);
        assert!(errors.iter().all(|e| *e <= 1.0));
        assert!(mean <= 80.0 && made <= 300, "{mean} {made}");
        // A start with far too many steps goes down.
        let (_, mean, _) = frames(begun(200.0), |frame, amount| match frame {
            1..=20 => 60.0 / amount,
            _ => 4.0 / amount,
        });
        assert!(mean <= 120.0, "{mean}");
    }

    #[test]
    fn a_sudden_motion_has_its_frames_made_again() {
        let jerk = |frame: usize, amount: f64| match frame {
            100..=110 => 90.0 / amount,
            _ => 20.0 / amount,
        };
        let (errors, mean, made) = frames(begun(32.0), jerk);
        assert!(errors.iter().all(|e| *e <= 1.0));
        assert!(made > 200 && made <= 400, "{made}");
        assert!(mean <= 90.0, "steps for the jerk alone: {mean}");
    }

    #[test]
    fn what_more_steps_do_not_lessen_costs_little_and_is_not_within_the_target() {
        let (errors, mean, made) = frames(begun(64.0), |_, _| 1.5);
        assert!(errors.iter().all(|e| *e > 1.0));
        assert!(made <= 500 && mean <= 300.0, "{made} {mean}");
        // NaN is not within a target either, and does not hang.
        let (errors, _, made) = frames(begun(64.0), |_, _| f64::NAN);
        assert!(errors.iter().all(|e| e.is_nan()) && made <= 1000, "{made}");
    }

    #[test]
    fn a_rule_survives_its_bytes() {
        let mut rule = begun(64.0);
        rule.choose(3, 0.9);
        assert!(rule.goes_back(4, 1.2, AHEAD));
        let mut to = Writer::default();
        rule.save(&mut to);
        let mut other = begun(20.0);
        other
            .restore(&mut Reader::new(&to.bytes))
            .expect("its own bytes");
        assert_eq!(other, rule);
    }
}
