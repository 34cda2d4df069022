//! Runs of scenes without muscles.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::Arguments;
use crate::commands::failure::Failure;
use crate::commands::options::Output;
use crate::commands::progress::Stoppable;
use crate::commands::{interrupted, warn};
use crate::report::folder::Folder;
use crate::report::run::{RunOptions, files, perform};
use pliant::scene::Content;
use pliant::simulation::{LoadError, scenario_with};

/// A run of a scene without muscles, from a file or from the options of a command.
pub(in crate::commands) struct Job<'a> {
    pub(in crate::commands) output: &'a Output,
    /// Folder of the results.
    pub(in crate::commands) out: PathBuf,
    pub(in crate::commands) options: RunOptions,
    /// A flag that stops the run.
    pub(in crate::commands) stop: &'a AtomicBool,
    /// The failure for a mesh or a number that cannot be used.
    pub(in crate::commands) refused: &'a dyn Fn(LoadError) -> Failure,
}

impl Job<'_> {
    /// Runs to the last frame or to Ctrl-C. Returns the exit code.
    pub(in crate::commands) fn run(self, scene: &Content) -> Result<u8, Failure> {
        Folder::check(&self.out, &files(scene))?;
        let progress = Stoppable::new(scene.frames(), self.stop);
        let mut scenario = match scenario_with(scene, &progress) {
            Err(_) if self.stop.load(Ordering::Relaxed) => {
                progress.bar.end();
                warn("interrupted before the first frame: nothing is written");
                return Ok(interrupted());
            }
            made => made.map_err(self.refused)?,
        };
        let folder = Folder::open(&self.out)?;
        let finished = perform(scenario.as_mut(), folder, &self.options, &progress)?;
        progress.bar.end();
        self.output.finish(&finished.folder, finished.output)
    }
}

/// Runs a scene of `pliant run`.
pub(super) fn run(
    arguments: &Arguments,
    scene: &Content,
    begun: Instant,
    stop: &AtomicBool,
) -> Result<u8, Failure> {
    if arguments.resume || arguments.checkpoint_every.is_some() {
        let message = "checkpoints are for scenes of muscles";
        return Err(Failure::usage(
            message,
            "leave --checkpoint-every and --resume out: this scene runs from its start",
        ));
    }
    Job {
        output: &arguments.output,
        out: arguments.output.folder(scene.name(), ""),
        options: RunOptions {
            kind: None,
            animate: arguments.animate.is_some(),
            stored: arguments.stored(),
            begun,
            settings: super::settings(arguments),
        },
        stop,
        refused: &Failure::from,
    }
    .run(scene)
}
