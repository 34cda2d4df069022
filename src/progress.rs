//! Progress and cancellation of a long computation.

use std::ops::ControlFlow;

/// Receives the progress of a long computation, and can end it.
///
/// ```
/// use pliant::progress::{Progress, Silent};
/// use std::ops::ControlFlow;
/// let three = |_: &str, done: usize, _: usize| match done {
///     0..3 => ControlFlow::Continue(()),
///     _ => ControlFlow::Break(()),
/// };
/// assert!(three.report("refining", 2, 10).is_continue());
/// assert!(three.report("refining", 3, 10).is_break());
/// assert!(Silent.report("refining", 3, 10).is_continue());
/// ```
pub trait Progress {
    /// Reports that `done` of `of` parts of a `stage` are done; `of` is 0 if their number is
    /// unknown.
    ///
    /// `Break` ends the computation at the next place where it can end.
    fn report(&self, stage: &str, done: usize, of: usize) -> ControlFlow<()>;

    /// Reports the beginning of a stage of unknown length. Such a stage checks later with
    /// [`Progress::is_stopped`] whether to end.
    fn begin(&self, stage: &str) {
        let _ = self.report(stage, 0, 0);
    }

    /// Whether the computation should end. Reports no further progress.
    fn is_stopped(&self) -> bool {
        self.report("", 0, 0).is_break()
    }
}

impl<F: Fn(&str, usize, usize) -> ControlFlow<()>> Progress for F {
    fn report(&self, stage: &str, done: usize, of: usize) -> ControlFlow<()> {
        self(stage, done, of)
    }
}

/// Ignores reports and never ends a computation.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn report(&self, _: &str, _: usize, _: usize) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}
