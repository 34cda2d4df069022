//! The subjects of a session: muscles, skin, a lattice, a geometric muscle, or the frames of a
//! finished run.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::recipe::Refused;
use super::session::Command;
use super::snapshot::Shot;
use pliant::progress::Progress;

/// Result of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Advanced {
    /// The frame is computed, and others can follow.
    Running,
    /// The frame is computed, and none follows automatically.
    Finished,
    /// The computation was interrupted for a waiting command; the display is unchanged.
    Interrupted,
    /// An earlier request is impossible, with the reason; the display is unchanged.
    Refused(String),
    /// The computation failed, with the cause; only a reset helps.
    Failed(String),
}

/// Cancellation of a long frame.
#[derive(Clone, Copy, Debug)]
pub struct Watch<'a> {
    pub(super) ended: &'a AtomicBool,
    pub(super) sent: &'a AtomicU64,
    pub(super) answered: u64,
}

impl Watch<'_> {
    /// True if the session ends.
    pub fn is_ended(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }

    /// True if a command waits.
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

/// An object with frames and commands. It lives in the thread of its session, which reports its
/// panics as failures.
pub trait Subject: Send {
    /// Frames per second in real time.
    fn frame_rate(&self) -> f64;

    /// The visible state.
    fn shot(&mut self) -> Shot;

    /// Computes the next frame; a long computation stops when the session ends.
    fn advance(&mut self, watch: Watch<'_>) -> Advanced;

    /// True if frames are necessary even in a pause, because a change shows only in them.
    fn wants_frames(&self) -> bool {
        false
    }

    /// Executes a command. A session itself handles [`Command::Pause`], [`Command::Run`],
    /// [`Command::Step`] and [`Command::Speed`], and passes only [`Command::Reset`] after a
    /// failure.
    ///
    /// # Errors
    /// The command is impossible; the subject is unchanged.
    fn apply(&mut self, command: &Command) -> Result<(), Refused>;
}
