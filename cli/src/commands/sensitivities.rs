//! `pliant sensitivities`: the intervals of a result, and what matters for them.

use std::time::Instant;

use super::failure::Failure;
use super::options::Output;
use super::progress::Stoppable;
use super::run::stop_on_interrupt;
use super::{FAILED, environment, interrupted, warn};
use crate::report::folder::{Folder, FolderError};
use crate::report::output::RunOutput;
use crate::report::sensitivities;
use pliant::scene::Content;
use pliant::simulation::{ByRuns, SensitivityError};

/// Compute the intervals of a result from those of its values, and what each value contributes
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant sensitivities flat-implant --set 'skin.modulus=200 kPa +- 60 %'
  pliant sensitivities hip --at 100 --set 'muscle.*.material.stretch=300 +- 90 N/m' --set 'muscle.*.material.bending=1e-3 N m +- 50 %'

A value of a scene has an interval where its text has one: stretch = \"300 +- 90 N/m\", thickness = \"2 mm +- 10 %\". It is the
interval that contains the value with a probability of 95 %, and so is the interval of each measure. The values are independent.

The scene runs to the frame, whose equilibrium is then found. How it moves with a value follows from one linear system. A run with
the value at the upper end of its interval shows what a derivative cannot: a muscle that folds in another way, or touches something
else. The greater change counts. Where another value makes other vertices, as the base of an implant does, two runs tell it.

Results in pliant-out/NAME-sensitivities: report.html, sensitivities.csv, summary.json, and for each body BODY.vtp with the
interval of the position of each vertex. Exit codes: 0 done; 1 an equilibrium was not found; 2 bad usage or input, or no value
has an interval; 130 or 143 interrupted.")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene
    scene: String,
    /// Frame of the equilibrium [default: the last one]
    #[arg(long, value_name = "FRAME", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    at: Option<u32>,
    /// Runs beside the derivatives: check is one at the end of each interval, instead is two in place of the derivative
    #[arg(long, value_enum, default_value_t = Runs::Check)]
    runs: Runs,
    #[command(flatten)]
    output: Output,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
}

/// The choices of `--runs`.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Runs {
    Check,
    Instead,
    Never,
}

impl From<Runs> for ByRuns {
    fn from(runs: Runs) -> Self {
        match runs {
            Runs::Check => Self::Check,
            Runs::Instead => Self::Instead,
            Runs::Never => Self::Never,
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let content = environment::load_content(&arguments.scene, &arguments.set)?;
    let frame = frame_of(&content, arguments.at)?;
    if content.uncertain().is_empty() {
        return Err(no_interval());
    }
    let stop = stop_on_interrupt("stopping");
    arguments.output.threads.start();
    let folder = Folder::open(&arguments.output.folder(content.name(), "sensitivities"))?;
    let said = Stoppable::new(frame, &stop);
    let variables = environment::variable;
    let runs = arguments.runs.into();
    let found = pliant::simulation::sensitivities(&content, frame, runs, variables, &said);
    said.bar.end();
    let found = match found {
        Ok(found) => found,
        Err(error) => return refused(error),
    };
    let output = RunOutput {
        time_s: begun.elapsed().as_secs_f64(),
        ..sensitivities::output(content.name(), &found).map_err(FolderError::from)?
    };
    arguments.output.finish(&folder, output)
}

/// The frame of an equilibrium: as given, or the last one.
pub(super) fn frame_of(content: &Content, at: Option<u32>) -> Result<usize, Failure> {
    let frames = content.frames();
    let frame = at.map_or(frames, |frame| frame as usize);
    if frame > frames {
        return Err(Failure::usage(
            format!("--at {frame} is after the last frame of the scene"),
            format!("give a frame from 1 to {frames}"),
        ));
    }
    Ok(frame)
}

/// The end of a command whose intervals could not be computed.
pub(super) fn refused(error: SensitivityError) -> Result<u8, Failure> {
    match error {
        SensitivityError::Interrupted => Ok(interrupted()),
        SensitivityError::NoInterval => Err(no_interval()),
        SensitivityError::Scene(error) => Err(error.into()),
        SensitivityError::Load(error) => Err(error.into()),
        SensitivityError::NoTarget(message) => Err(Failure::usage(
            message,
            "see --help for what can be measured",
        )),
        error @ SensitivityError::NotSupported(_) => {
            let hint = "name a scene of muscles or of skin";
            Err(Failure::usage(error.to_string(), hint))
        }
        error @ SensitivityError::Failed(_) => {
            warn(&format!("error: {error}"));
            Ok(FAILED)
        }
    }
}

fn no_interval() -> Failure {
    Failure::usage(
        "no value of the scene has an interval",
        "write one, as in stretch = \"300 +- 90 N/m\", or with --set 'muscle.*.material.stretch=300 +- 90 N/m'",
    )
}
