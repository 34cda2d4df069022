//! The one loop over the frames of a scenario, and its observers.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use super::scenario::{Scenario, Stepped};
use crate::progress::Progress;

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The last frame was computed, or all motion has ended.
    Finished,
    /// The progress stopped the run.
    Interrupted,
    /// An observer stopped the run.
    ByObserver,
    /// A frame could not be computed, for this reason.
    Failed(String),
}

/// Receives the frames of a run, for example to write, measure or show them.
pub trait Observer<S: ?Sized> {
    /// Receives the first frame of a run, like [`Observer::frame`].
    fn start(&mut self, scenario: &S) -> ControlFlow<()> {
        self.frame(scenario, Duration::ZERO)
    }

    /// Receives the frame that `scenario` has just computed in the time `took`. `Break` ends the
    /// run.
    fn frame(&mut self, scenario: &S, took: Duration) -> ControlFlow<()>;
}

/// Runs a scenario from its present frame to its last, and passes every frame to the observers in
/// order.
///
/// The progress receives every frame, with an empty stage, after the observers. It also receives
/// the stages within a frame.
pub fn run<S: Scenario + ?Sized>(
    scenario: &mut S,
    observers: &mut [&mut dyn Observer<S>],
    progress: &dyn Progress,
) -> Ended {
    for observer in observers.iter_mut() {
        if observer.start(scenario).is_break() {
            return Ended::ByObserver;
        }
    }
    loop {
        let heard = progress.report("", scenario.frame(), scenario.frames());
        if scenario.is_finished() {
            return Ended::Finished;
        }
        if heard.is_break() {
            return Ended::Interrupted;
        }
        let begun = Instant::now();
        match scenario.step(progress) {
            Stepped::Done => {}
            Stepped::Interrupted => return Ended::Interrupted,
            Stepped::Failed(why) => return Ended::Failed(why),
        }
        let took = begun.elapsed();
        for observer in observers.iter_mut() {
            if observer.frame(scenario, took).is_break() {
                return Ended::ByObserver;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use crate::scene::builtin::load_content;
    use crate::simulation::scenario;

    /// Counts frames, and ends the run at a given frame.
    struct Count {
        seen: Vec<usize>,
        last: usize,
    }

    impl Observer<dyn Scenario> for Count {
        fn frame(&mut self, scenario: &(dyn Scenario + 'static), _: Duration) -> ControlFlow<()> {
            self.seen.push(scenario.frame());
            if scenario.frame() == self.last {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        }
    }

    #[test]
    fn a_run_ends_with_its_last_frame_or_where_somebody_ends_it() {
        let changes = ["frames=3", "lattice.release=2"].map(str::to_owned);
        let content = load_content("lattice", &changes).expect("a scene");
        let at_two = |_: &str, done: usize, _: usize| match done {
            2 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        };
        let runs: [(usize, &dyn Progress, Ended, usize); 3] = [
            (9, &Silent, Ended::Finished, 3),
            (1, &Silent, Ended::ByObserver, 1),
            (9, &at_two, Ended::Interrupted, 2),
        ];
        for (last, progress, ended, frames) in runs {
            let mut lattice = scenario(&content).expect("a lattice");
            let mut count = Count {
                seen: Vec::new(),
                last,
            };
            let found = run(lattice.as_mut(), &mut [&mut count], progress);
            assert_eq!(found, ended);
            assert_eq!(count.seen, (0..=frames).collect::<Vec<_>>());
        }
    }
}
