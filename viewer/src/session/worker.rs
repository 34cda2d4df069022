//! The thread of a session: executes commands between frames, computes frames, publishes snapshots.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use super::super::recipe::{Refused, check_number, words};
use super::super::snapshot::Snapshot;
use super::super::subject::{Advanced, Subject, Watch};
use super::{Command, Pace, Speed};

/// Number of frames in the mean frame rate.
const RATED: usize = 30;

/// Greatest waiting time before a frame.
const LONGEST_WAIT: Duration = Duration::from_secs(3600);

pub(super) struct Worker {
    subject: Box<dyn Subject>,
    pace: Pace,
    sent: Arc<AtomicU64>,
    ended: Arc<AtomicBool>,
    serial: u64,
    answered: u64,
    refused: Option<(u64, String)>,
    failed: Option<String>,
    frame_ms: f64,
    ends: VecDeque<Instant>,
    /// Time of the next frame.
    due: Instant,
}

impl Worker {
    pub(super) fn new(
        subject: Box<dyn Subject>,
        pace: Pace,
        (sent, ended): (Arc<AtomicU64>, Arc<AtomicBool>),
    ) -> Self {
        Self {
            subject,
            pace,
            sent,
            ended,
            serial: 0,
            answered: 0,
            refused: None,
            failed: None,
            frame_ms: 0.0,
            ends: VecDeque::new(),
            due: Instant::now(),
        }
    }

    /// Runs until all senders are gone.
    pub(super) fn run(mut self, commands: &Receiver<(u64, Command)>, publish: impl Fn(Snapshot)) {
        loop {
            let first = if self.wants_frames() {
                commands.try_recv().ok()
            } else if self.pace.running {
                match commands.recv_timeout(self.due.saturating_duration_since(Instant::now())) {
                    Ok(command) => Some(command),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => return,
                }
            } else {
                match commands.recv() {
                    Ok(command) => Some(command),
                    Err(_) => return,
                }
            };
            let batch: Vec<_> = first.into_iter().chain(commands.try_iter()).collect();
            if !batch.is_empty() {
                self.apply_all(&batch);
                publish(self.snapshot());
            }
            // Also after commands, so that a continuous motion of the pointer does not delay the
            // frames.
            if self.wants_frames() || self.pace.running && Instant::now() >= self.due {
                self.advance();
                publish(self.snapshot());
            }
        }
    }

    fn wants_frames(&self) -> bool {
        let is_needed = self.failed.is_none() && !self.ended.load(Ordering::Relaxed);
        is_needed && self.subject.wants_frames()
    }

    fn apply_all(&mut self, batch: &[(u64, Command)]) {
        for (k, (number, command)) in batch.iter().enumerate() {
            // Only the last position of a slider or handle that moved during a frame counts.
            let next = batch.get(k + 1).map(|(_, next)| next);
            let is_overtaken = next.is_some_and(|next| overtakes(next, command));
            // Before the execution: a step must not take its own command for another one.
            self.answered = *number;
            if !is_overtaken && let Err(refused) = self.apply(command) {
                self.refused = Some((*number, refused.to_string()));
            }
        }
    }

    fn apply(&mut self, command: &Command) -> Result<(), Refused> {
        match command {
            Command::Pause => self.pace.running = false,
            Command::Run => {
                self.check_sound()?;
                (self.pace.running, self.due) = (true, Instant::now());
            }
            Command::Step => {
                self.check_sound()?;
                self.pace.running = false;
                self.advance();
            }
            Command::Speed(speed) => {
                if let Speed::Share(share) = *speed {
                    check_number("the speed", share, true)?;
                }
                (self.pace.speed, self.due) = (*speed, Instant::now());
            }
            Command::Reset => {
                self.pass_on(command)?;
                self.failed = None;
                (self.frame_ms, self.due) = (0.0, Instant::now());
                self.ends.clear();
            }
            other => {
                self.check_sound()?;
                return self.pass_on(other);
            }
        }
        Ok(())
    }

    fn pass_on(&mut self, command: &Command) -> Result<(), Refused> {
        let subject = &mut self.subject;
        catch_unwind(AssertUnwindSafe(|| subject.apply(command)))
            .unwrap_or_else(|panic| Err(Refused::Panicked(words(&*panic))))
    }

    fn check_sound(&self) -> Result<(), Refused> {
        self.failed
            .clone()
            .map_or(Ok(()), |why| Err(Refused::Failed(why)))
    }

    fn advance(&mut self) {
        if self.failed.is_some() {
            return;
        }
        let begun = Instant::now();
        let watch = Watch {
            ended: &self.ended,
            sent: &self.sent,
            answered: self.answered,
        };
        let subject = &mut self.subject;
        let advanced = catch_unwind(AssertUnwindSafe(|| subject.advance(watch)))
            .unwrap_or_else(|panic| Advanced::Failed(format!("it panicked: {}", words(&*panic))));
        match advanced {
            Advanced::Failed(why) => {
                self.failed = Some(why);
                self.pace.running = false;
                return;
            }
            // The frame restarts after the command.
            Advanced::Interrupted => return,
            Advanced::Refused(why) => {
                self.refused = Some((self.answered, why));
                return;
            }
            Advanced::Finished => self.pace.running = false,
            Advanced::Running => {}
        }
        let ended = Instant::now();
        self.frame_ms = (ended - begun).as_secs_f64() * 1e3;
        self.ends.push_back(ended);
        if self.ends.len() > RATED {
            self.ends.pop_front();
        }
        let period = match self.pace.speed {
            Speed::Share(share) => {
                Duration::try_from_secs_f64(1.0 / (self.subject.frame_rate() * share))
            }
            Speed::Free => Ok(Duration::ZERO),
        };
        // Late frames are not repeated.
        self.due = (self.due + period.unwrap_or(LONGEST_WAIT).min(LONGEST_WAIT)).max(ended);
    }

    pub(super) fn snapshot(&mut self) -> Snapshot {
        self.serial += 1;
        let rate = match (self.ends.front(), self.ends.back()) {
            (Some(first), Some(last)) if last > first => {
                (self.ends.len() - 1) as f64 / (*last - *first).as_secs_f64()
            }
            _ => 0.0,
        };
        Snapshot {
            serial: self.serial,
            answered: self.answered,
            running: self.pace.running,
            speed: self.pace.speed,
            refused: self.refused.clone(),
            failed: self.failed.clone(),
            frame_ms: self.frame_ms,
            frames_per_second: rate,
            view: self.subject.shot(),
        }
    }
}

/// True if a command replaces the previous one.
fn overtakes(next: &Command, before: &Command) -> bool {
    match (before, next) {
        (Command::Set { path, .. }, Command::Set { path: later, .. }) => path == later,
        (Command::Turn { bone, .. }, Command::Turn { bone: later, .. }) => bone == later,
        (
            Command::Drag { body, vertex, .. },
            Command::Drag {
                body: b, vertex: v, ..
            },
        ) => (body, vertex) == (b, v),
        (Command::Move { handle, .. }, Command::Move { handle: later, .. }) => handle == later,
        (Command::Seek { .. }, Command::Seek { .. })
        | (Command::Speed(_), Command::Speed(_))
        | (Command::Probe(_), Command::Probe(_)) => true,
        _ => false,
    }
}
