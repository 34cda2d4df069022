//! `pliant sensitivities`: the intervals of a result, and what matters for them.

use std::time::Instant;

use super::accuracy::Said;
use super::failure::Failure;
use super::options::Output;
use super::run::stop_on_interrupt;
use super::{FAILED, environment, interrupted, warn};
use crate::report::folder::{Folder, FolderError};
use crate::report::output::RunOutput;
use crate::report::sensitivities;
use pliant::simulation::SensitivityError;

/// Compute the intervals of a result from those of its values, and what each value contributes
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant sensitivities flat-implant --set 'skin.modulus=200 kPa +- 60 %'
  pliant sensitivities hip --at 100 --set 'muscle.*.material.stretch=300 +- 90 N/m' --set 'muscle.*.material.wrinkle=1e-3 N m +- 50 %'

A value of a scene has an interval where its text has one: stretch = \"300 +- 90 N/m\", thickness = \"2 mm +- 10 %\". It is the
interval that contains the value with a probability of 95 %, and so is the interval of each measure. The values are independent.

The scene runs to the frame, whose equilibrium is then found. How it moves with a value follows from one linear system. Where
another value makes other vertices, as the base of an implant does, two whole runs at the ends of the interval tell it.

Results in pliant-out/NAME-sensitivities: report.html, sensitivities.csv, summary.json, and for each body BODY.vtp with the
interval of the position of each vertex. Exit codes: 0 done; 1 an equilibrium was not found; 2 bad usage or input, or no value
has an interval; 130 or 143 interrupted.")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene
    scene: String,
    /// Frame of the equilibrium [default: the last one]
    #[arg(long, value_name = "FRAME", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    at: Option<u32>,
    /// Tell every change by two whole runs at the ends of the interval, not by a derivative
    #[arg(long)]
    runs: bool,
    #[command(flatten)]
    output: Output,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let content = environment::load_content(&arguments.scene, &arguments.set)?;
    let (frames, at) = (content.frames(), arguments.at);
    let frame = at.map_or(frames, |frame| frame as usize);
    if frame > frames {
        return Err(Failure::usage(
            format!("--at {frame} is after the last frame of the scene"),
            format!("give a frame from 1 to {frames}"),
        ));
    }
    if content.uncertain().is_empty() {
        return Err(no_interval());
    }
    let stop = stop_on_interrupt("stopping");
    arguments.output.threads.start();
    let folder = Folder::open(&arguments.output.folder(content.name(), "sensitivities"))?;
    let said = Said { stop: &stop };
    let variables = environment::variable;
    let runs = arguments.runs;
    let found = pliant::simulation::sensitivities(&content, frame, runs, variables, &said);
    let found = match found {
        Ok(found) => found,
        Err(SensitivityError::Interrupted) => return Ok(interrupted()),
        Err(SensitivityError::NoInterval) => return Err(no_interval()),
        Err(SensitivityError::Scene(error)) => return Err(error.into()),
        Err(SensitivityError::Load(error)) => return Err(error.into()),
        Err(error @ SensitivityError::NotSupported(_)) => {
            let hint = "name a scene of muscles or of skin";
            return Err(Failure::usage(error.to_string(), hint));
        }
        Err(error @ SensitivityError::Failed(_)) => {
            warn(&format!("error: {error}"));
            return Ok(FAILED);
        }
    };
    let output = RunOutput {
        time_s: begun.elapsed().as_secs_f64(),
        ..sensitivities::output(content.name(), &found).map_err(FolderError::from)?
    };
    arguments.output.finish(&folder, output)
}

fn no_interval() -> Failure {
    Failure::usage(
        "no value of the scene has an interval",
        "write one, as in stretch = \"300 +- 90 N/m\", or with --set 'muscle.*.material.stretch=300 +- 90 N/m'",
    )
}
