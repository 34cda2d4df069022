//! `pliant run` for a scene without muscles.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::Arguments;
use crate::commands::failure::Failure;
use crate::commands::progress::Stoppable;
use crate::report::folder::Folder;
use crate::report::run::{RunOptions, perform};
use pliant::scene::Content;
use pliant::simulation::scenario;

/// Runs to the last frame or to Ctrl-C.
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
    let mut scenario = scenario(scene)?;
    let folder = Folder::open(&arguments.output.folder(scenario.name(), ""))?;
    let options = RunOptions {
        animate: arguments.animate.is_some(),
        begun,
        settings: super::settings(arguments),
    };
    let progress = Stoppable::new(scenario.frames(), stop);
    let finished = perform(scenario.as_mut(), folder, &options, &progress)?;
    progress.bar.end();
    super::conclude(arguments, finished)
}
