//! `pliant run --resume`: continues a run from the checkpoint in the folder of its results.

use std::path::Path;
use std::time::Instant;

use super::failure::Failure;
use crate::report::folder::CHECKPOINT;
use crate::report::gathered::Gathered;
use crate::report::results::Results;
use pliant::simulation::checkpoint::{Checkpoint, Fingerprint, Refused};
use pliant::simulation::{Scenario, Simulation};

/// The bytes of the checkpoint in a folder of results.
pub(super) fn read(folder: &Path) -> Result<Vec<u8>, Failure> {
    let path = folder.join(CHECKPOINT);
    std::fs::read(&path).map_err(|error| {
        let shown = path.display();
        match error.kind() {
            std::io::ErrorKind::NotFound => Failure::usage(
                format!("there is no checkpoint `{shown}` to go on from"),
                "name the folder of the results with --out, or run with --checkpoint-every N and without --resume",
            ),
            _ => Failure::usage(format!("the checkpoint `{shown}` cannot be read: {error}"), BEGIN_ANEW),
        }
    })
}

const BEGIN_ANEW: &str = "begin anew without --resume, which removes it with the other results";

/// Restores `simulation`, which is at its start, to the checkpoint, with all results so far.
/// Returns also the interval of the checkpoints.
pub(super) fn go_on(
    folder: &Path,
    bytes: &[u8],
    simulation: &mut Simulation,
    animate: bool,
    begun: Instant,
) -> Result<(Results, usize), Failure> {
    let refused = |why: Refused| {
        let hint = match &why {
            Refused::NoCheckpoint
            | Refused::Length { .. }
            | Refused::Checksum
            | Refused::DecodeError(_) => BEGIN_ANEW,
            Refused::Version { .. } => "go on with that version, or begin anew without --resume",
            Refused::Differs(_) => {
                "give the scene, the meshes, --set and --frames that it was written with, or begin anew without --resume"
            }
            Refused::Beyond { .. } => {
                "give at least as many --frames, or begin anew without --resume"
            }
        };
        Failure::usage(
            format!(
                "cannot go on from `{}`: {why}",
                folder.join(CHECKPOINT).display()
            ),
            hint,
        )
    };
    let checkpoint = Checkpoint::open(bytes).map_err(refused)?;
    let first = simulation.state();
    let fingerprint = Fingerprint::of(simulation);
    checkpoint
        .restore(simulation, &fingerprint)
        .map_err(refused)?;
    let gathered =
        Gathered::open(checkpoint.beside, simulation).map_err(|corrupt| refused(corrupt.into()))?;
    let every = gathered.every;
    Ok((
        Results::resume(folder, simulation, gathered, first, animate, begun)?,
        every,
    ))
}
