//! Progress of a run: a bar on a terminal, occasional lines on a pipe.

use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::{note, quiet};
use pliant::mesh::measures::max_or_nan;
use pliant::progress::Progress;
use pliant::simulation::Measures;
use pliant::springs::StepRecord;

/// Number of frames of muscles between two lines on a pipe.
const LINE_EVERY: usize = 50;

/// Time between two other lines on a pipe [s].
const SECONDS_BETWEEN: f64 = 1.0;

/// Shows the progress of a computation on standard error.
pub(super) struct Bar {
    /// Present on a terminal.
    bar: Option<ProgressBar>,
    steps: usize,
    /// When the last line was written to a pipe.
    said: Mutex<Instant>,
    /// When the last frame was done.
    last: Mutex<Instant>,
}

impl Bar {
    /// A bar with this number of steps and this template of indicatif.
    fn new(steps: usize, template: &str) -> Self {
        let shown = std::io::stderr().is_terminal() && !quiet();
        let bar = shown.then(|| {
            let style = ProgressStyle::with_template(template)
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(steps as u64).with_style(style)
        });
        Self {
            bar,
            steps,
            said: Mutex::new(Instant::now()),
            last: Mutex::new(Instant::now()),
        }
    }

    /// For a run of this number of frames.
    pub(super) fn of_frames(frames: usize) -> Self {
        Self::new(frames, "  {bar:30} {pos}/{len}  {msg}  {eta} left")
    }

    /// For this number of frames or parts, with messages about the present one.
    pub(super) fn of_parts(parts: usize) -> Self {
        Self::new(parts, "  {bar:30} {pos}/{len}  {msg}")
    }

    /// For a run to rest of at most this number of steps.
    pub(super) fn of_steps(steps: usize) -> Self {
        Self::new(steps, "  {bar:30} {pos}/at most {len}  {msg}")
    }

    /// For this number of frames of several runs.
    pub(super) fn of_runs(frames: usize) -> Self {
        Self::new(frames, "  {bar:30} {pos}/{len} frames  {eta} left")
    }

    /// Reports a completed frame of muscles.
    pub(super) fn muscles(&self, frame: usize, took: Duration, measures: &[Measures]) {
        restart(&self.last);
        let due = frame.is_multiple_of(LINE_EVERY) || frame == self.steps;
        if self.bar.is_none() && !due && !self.is_silent() {
            return;
        }
        restart(&self.said);
        let volume = max_or_nan(measures.iter().map(|m| m.volume_error.abs()));
        let inside: usize = measures
            .iter()
            .map(|m| m.vertices_inside_bones + m.bone_vertices_inside)
            .sum();
        let ms = took.as_secs_f64() * 1e3;
        let text = format!("{ms:.0} ms/frame  volume error {volume:.1e}  inside {inside}");
        match &self.bar {
            Some(bar) => {
                bar.set_message(text);
                bar.set_position(frame as u64);
            }
            None => note(&format!("frame {frame}/{}  {text}", self.steps)),
        }
    }

    /// Reports that the frame after this one is being computed.
    pub(super) fn waits(&self, frame: usize) {
        let seconds = lock(&self.last).elapsed().as_secs_f64();
        match &self.bar {
            Some(bar) => bar.tick(),
            None if seconds < SECONDS_BETWEEN => {}
            None => self.now_and_then(|| {
                format!("frame {}/{}  {seconds:.0} s so far", frame + 1, self.steps)
            }),
        }
    }

    /// Reports a completed step of a run to rest.
    pub(super) fn step(&self, record: &StepRecord) {
        let text = || {
            format!(
                "force {:.1e} N  kinetic energy {:.1e} J",
                record.residual, record.energy.kinetic
            )
        };
        match &self.bar {
            Some(bar) => {
                bar.set_position(record.step as u64);
                bar.set_message(text());
            }
            None => self.now_and_then(|| {
                let (step, most) = (record.step, self.steps);
                format!("step {step} of at most {most}  {}", text())
            }),
        }
    }

    /// Reports a completed part.
    pub(super) fn part(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.set_message(text.to_owned()),
            None => self.now_and_then(|| text.to_owned()),
        }
    }

    /// Sets the numbers of completed steps and of all steps, on a terminal.
    pub(super) fn reach(&self, done: usize, of: usize) {
        if let Some(bar) = &self.bar {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        }
    }

    /// Reports a frame in progress.
    pub(super) fn advance(&self) {
        if let Some(bar) = &self.bar {
            bar.inc(1);
        }
    }

    /// Reports a completed frame.
    fn frame(&self, frame: usize) {
        let took = restart(&self.last);
        match &self.bar {
            Some(bar) => bar.set_position(frame as u64),
            None if frame == 0 => {}
            None if frame == self.steps => note(&format!("frame {frame}/{frame}")),
            None => self.now_and_then(|| {
                let seconds = took.as_secs_f64();
                format!("frame {frame}/{}  {seconds:.1} s a frame", self.steps)
            }),
        }
    }

    /// Prints a line above the bar; on a pipe with the text of `more`.
    pub(super) fn say(&self, line: &str, more: impl FnOnce() -> String) {
        match &self.bar {
            Some(bar) => bar.println(line),
            None => note(&format!("{line}{}", more())),
        }
    }

    fn now_and_then(&self, text: impl FnOnce() -> String) {
        if self.is_silent() {
            restart(&self.said);
            note(&text());
        }
    }

    /// True if the last line on a pipe was some time ago.
    fn is_silent(&self) -> bool {
        lock(&self.said).elapsed().as_secs_f64() >= SECONDS_BETWEEN
    }

    /// Removes the bar.
    pub(super) fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Sets a clock to the present time. Returns the time since it was last set.
fn restart(clock: &Mutex<Instant>) -> Duration {
    std::mem::replace(&mut *lock(clock), Instant::now()).elapsed()
}

fn lock(clock: &Mutex<Instant>) -> MutexGuard<'_, Instant> {
    clock.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A bar over the frames of a run that Ctrl-C can stop.
pub(super) struct Stoppable<'a> {
    pub(super) bar: Bar,
    stop: &'a AtomicBool,
}

impl<'a> Stoppable<'a> {
    /// For a run of this number of frames, stopped by the flag.
    pub(super) fn new(frames: usize, stop: &'a AtomicBool) -> Self {
        let bar = Bar::of_parts(frames);
        Self { bar, stop }
    }
}

impl Progress for Stoppable<'_> {
    fn report(&self, stage: &str, done: usize, of: usize) -> ControlFlow<()> {
        if !stage.is_empty() {
            self.bar.part(stage);
        } else if of > 0 {
            self.bar.frame(done);
        }
        if_raised(self.stop)
    }
}

/// Ends a computation when the flag is set.
pub(super) fn if_raised(stop: &AtomicBool) -> ControlFlow<()> {
    match stop.load(Ordering::Relaxed) {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    }
}
