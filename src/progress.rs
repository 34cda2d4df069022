//! Progress of a long computation, and its cancellation.

use std::ops::ControlFlow;

/// Hears how far a long computation is, and may end it.
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
    /// Reports that `done` of `of` parts of a `stage` are done; `of` is 0 where their number is unknown.
    ///
    /// `Break` ends the computation at the next place where it can end.
    fn report(&self, stage: &str, done: usize, of: usize) -> ControlFlow<()>;

    /// Reports that a stage begins whose length is unknown. The computation looks up later, with
    /// [`Progress::is_stopped`].
    fn begin(&self, stage: &str) {
        let _ = self.report(stage, 0, 0);
    }

    /// Whether the computation is to end; nothing new is done.
    fn is_stopped(&self) -> bool {
        self.report("", 0, 0).is_break()
    }
}

impl<F: Fn(&str, usize, usize) -> ControlFlow<()>> Progress for F {
    fn report(&self, stage: &str, done: usize, of: usize) -> ControlFlow<()> {
        self(stage, done, of)
    }
}

/// Shows nothing and ends nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn report(&self, _: &str, _: usize, _: usize) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}
