//! Progress of a run: a bar on a terminal, occasional lines on a pipe.

use std::cell::Cell;
use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::warn;
use pliant::mesh::measures::max_or_nan;
use pliant::simulation::Measures;
use pliant::springs::rest::StepRecord;

/// Number of frames between two lines on a pipe.
const LINE_EVERY: usize = 50;

/// Shows the progress of a run on standard error.
pub(super) struct Progress {
    bar: Option<ProgressBar>,
    frames: usize,
}

impl Progress {
    /// Starts the progress of a run of `frames` frames.
    pub(super) fn new(frames: usize) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(frames as u64);
            let style = ProgressStyle::with_template("  {bar:30} {pos}/{len}  {msg}  {eta} left");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        Self { bar, frames }
    }

    /// A frame is complete.
    pub(super) fn frame(&self, frame: usize, took: Duration, measures: &[Measures]) {
        let due = frame.is_multiple_of(LINE_EVERY) || frame == self.frames;
        if self.bar.is_none() && !due {
            return;
        }
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
            None => warn(&format!("frame {frame}/{}  {text}", self.frames)),
        }
    }

    /// Removes the bar.
    pub(super) fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// A bar of `steps` steps with an indicatif template; `None` on a pipe.
fn bar(steps: usize, template: &str) -> Option<ProgressBar> {
    std::io::stderr().is_terminal().then(|| {
        let style =
            ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        ProgressBar::new(steps as u64).with_style(style)
    })
}

/// Time between two lines on a pipe [s].
const SECONDS_BETWEEN: f64 = 5.0;

/// Shows the progress of a run to rest on standard error.
pub(super) struct Bar {
    bar: Option<ProgressBar>,
    steps: usize,
    said: Cell<Instant>,
}

impl Bar {
    /// Starts the progress of a run of at most `steps` steps.
    pub(super) fn new(steps: usize) -> Self {
        let bar = bar(steps, "  {bar:30} {pos}/at most {len}  {msg}");
        Self {
            bar,
            steps,
            said: Cell::new(Instant::now()),
        }
    }

    /// A step is complete.
    pub(super) fn step(&self, record: &StepRecord) {
        let text = || {
            format!(
                "force {:.1e} N  kinetic energy {:.1e} J",
                record.residual, record.energy.kinetic
            )
        };
        if let Some(bar) = &self.bar {
            bar.set_position(record.step as u64);
            bar.set_message(text());
        } else if self.said.get().elapsed().as_secs_f64() >= SECONDS_BETWEEN {
            self.said.set(Instant::now());
            warn(&format!(
                "step {} of at most {}  {}",
                record.step,
                self.steps,
                text()
            ));
        }
    }

    /// Removes the bar.
    pub(super) fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Shows the progress of a run of equilibria on standard error.
pub(super) struct Rounds {
    bar: Option<ProgressBar>,
    frames: usize,
    said: Cell<Instant>,
}

impl Rounds {
    /// Starts the progress of a run of `frames` frames.
    pub(super) fn new(frames: usize) -> Self {
        let bar = bar(frames, "  {bar:30} {pos}/{len}  {msg}");
        Self {
            bar,
            frames,
            said: Cell::new(Instant::now()),
        }
    }

    /// Sets the bar to `done` of `of`.
    pub(super) fn reach(&self, done: usize, of: usize) {
        if let Some(bar) = &self.bar {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        }
    }

    /// A frame is in progress.
    pub(super) fn part(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.set_message(text.to_owned()),
            None => self.now_and_then(text),
        }
    }

    /// A frame is complete.
    pub(super) fn frame(&self, frame: usize, took: Duration) {
        match &self.bar {
            Some(bar) => bar.set_position(frame as u64),
            None if frame == self.frames => warn(&format!("frame {frame}/{frame}")),
            None => self.now_and_then(&format!(
                "frame {frame}/{}  {:.1} s a frame",
                self.frames,
                took.as_secs_f64()
            )),
        }
    }

    fn now_and_then(&self, text: &str) {
        if self.said.get().elapsed().as_secs_f64() >= SECONDS_BETWEEN {
            self.said.set(Instant::now());
            warn(text);
        }
    }

    /// Removes the bar.
    pub(super) fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// A run of equilibria that Ctrl-C stops: shows each frame and each stage of one.
pub(super) struct Stoppable<'a> {
    pub(super) stop: &'a AtomicBool,
    pub(super) rounds: Rounds,
    /// When the last frame was done.
    last: Cell<Instant>,
}

impl<'a> Stoppable<'a> {
    /// Of a run of so many frames, which the flag stops.
    pub(super) fn new(frames: usize, stop: &'a AtomicBool) -> Self {
        Self {
            stop,
            rounds: Rounds::new(frames),
            last: Cell::new(Instant::now()),
        }
    }
}

impl pliant::progress::Progress for Stoppable<'_> {
    fn report(&self, stage: &str, done: usize, _: usize) -> ControlFlow<()> {
        if !stage.is_empty() {
            self.rounds.part(stage);
        } else {
            let took = self.last.replace(Instant::now()).elapsed();
            if done > 0 {
                self.rounds.frame(done, took);
            }
        }
        if_raised(self.stop)
    }
}

/// Ends a computation once the flag is raised.
pub(super) fn if_raised(stop: &AtomicBool) -> ControlFlow<()> {
    match stop.load(Ordering::Relaxed) {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    }
}
