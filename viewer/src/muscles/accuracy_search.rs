//! Search for the settings of a requested accuracy: a study in its own thread.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use pliant::accuracy::{self, Chosen};
use pliant::progress::Progress;
use pliant::scene::{Accuracy, Scene};
use pliant::simulation::Assets;

/// Approximate greatest time of a study.
const BUDGET: Duration = Duration::from_secs(20);

/// Progress of the study, readable and cancellable from outside.
#[derive(Clone, Debug, Default)]
struct SearchProgress {
    stop: Arc<AtomicBool>,
    part: Arc<Mutex<String>>,
}

impl Progress for SearchProgress {
    fn report(&self, stage: &str, _: usize, _: usize) -> ControlFlow<()> {
        if !stage.is_empty() {
            stage.clone_into(&mut self.part.lock().unwrap_or_else(PoisonError::into_inner));
        }
        if self.stop.load(Ordering::Relaxed) {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

/// A running study. Dropping it cancels it without waiting.
#[derive(Debug)]
pub(super) struct AccuracySearch {
    progress: SearchProgress,
    found: Receiver<Result<Chosen, String>>,
}

impl AccuracySearch {
    /// Starts the search.
    ///
    /// # Errors
    /// The system could not start a thread.
    pub(super) fn new(scene: &Scene, assets: &Assets, accuracy: Accuracy) -> std::io::Result<Self> {
        let (scene, assets) = (scene.clone(), assets.clone());
        let progress = SearchProgress::default();
        let (sender, found) = channel();
        let shared = progress.clone();
        std::thread::Builder::new()
            .name("study".to_owned())
            .spawn(move || {
                let threads = rayon::current_num_threads();
                let chosen = accuracy::choose(&scene, &assets, accuracy, BUDGET, threads, &shared);
                // The receiver may be gone.
                let _ = sender.send(chosen.map_err(|error| error.to_string()));
            })?;
        Ok(Self { progress, found })
    }

    /// The present part of the study.
    pub(super) fn part(&self) -> String {
        self.progress
            .part
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// The result, if available within `longest`.
    pub(super) fn wait(&self, longest: Duration) -> Option<Result<Chosen, String>> {
        match self.found.recv_timeout(longest) {
            Ok(found) => Some(found),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => {
                Some(Err("the study ended without a choice".to_owned()))
            }
        }
    }
}

impl Drop for AccuracySearch {
    fn drop(&mut self) {
        self.progress.stop.store(true, Ordering::Relaxed);
    }
}

/// A solver with its settings as changes of a scene: paths and values.
pub(super) fn changes(chosen: &Chosen) -> Vec<(String, String)> {
    let name = chosen.candidate.solver_key();
    let mut all = vec![("solver".to_owned(), name.to_owned())];
    for (key, value) in chosen.candidate.settings() {
        // Other keys are settings of the study, not of the solver.
        if !["contact", "lanes", "threads"].contains(&key.as_str()) {
            let value = value
                .as_str()
                .map_or_else(|| value.to_string(), str::to_owned);
            all.push((format!("solver.{name}.{key}"), value));
        }
    }
    all
}
