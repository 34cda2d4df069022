//! What a session runs: muscles, skin, a lattice, a geometric muscle, or the frames of a finished run.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::recipe::Refused;
use super::session::Command;
use super::snapshot::Shot;
use pliant::progress::Progress;

/// How a frame ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Advanced {
    /// It is there, and others may follow.
    On,
    /// It is there, and nothing follows by itself.
    Rests,
    /// It was given up for a command that waits; what is seen is as it was.
    GivenUp,
    /// What was asked for before cannot be, and why; what is seen is as it was.
    Refused(String),
    /// There is none, and why; nothing but a reset helps.
    Failed(String),
}

/// Says to a long frame whether it is still wanted.
#[derive(Clone, Copy, Debug)]
pub struct Watch<'a> {
    pub(super) ended: &'a AtomicBool,
    pub(super) sent: &'a AtomicU64,
    pub(super) answered: u64,
}

impl Watch<'_> {
    /// Whether the session is at its end.
    pub fn is_ended(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }

    /// Whether a command waits.
    pub fn is_called(&self) -> bool {
        self.sent.load(Ordering::Relaxed) > self.answered
    }
}

/// A computation ends where the session does or where a command waits.
impl Progress for Watch<'_> {
    fn report(&self, _: &str, _: usize, _: usize) -> ControlFlow<()> {
        if self.is_ended() || self.is_called() {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

/// Something that has frames and takes commands. It lives in the thread of its session; a panic in it is told as a
/// failure.
pub trait Subject: Send {
    /// Frames a second in real time.
    fn frame_rate(&self) -> f64;

    /// What is seen now.
    fn shot(&mut self) -> Shot;

    /// Computes the next frame; where that is long, it is given up when the session ends.
    fn advance(&mut self, watch: Watch<'_>) -> Advanced;

    /// Whether frames are wanted also while it is paused, for what was asked for shows only in them.
    fn wants_frames(&self) -> bool {
        false
    }

    /// Does what it is told; a session itself does [`Command::Pause`], [`Command::Run`], [`Command::Step`] and
    /// [`Command::Speed`], and passes nothing but [`Command::Reset`] on after a failure.
    ///
    /// # Errors
    /// Whatever cannot be done; everything is then as it was.
    fn obey(&mut self, command: &Command) -> Result<(), Refused>;
}
