//! `pliant accuracy`: the cost of accuracy in a scene, and the cheapest settings for it.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::failure::Failure;
use super::options::Output;
use super::progress::if_raised;
use super::run::stop_on_interrupt;
use super::{FAILED, environment, interrupted, note, warn};
use crate::report::folder::Folder;
use crate::report::output::RunOutput;
use crate::report::{skin_accuracy, work_precision};
use pliant::accuracy::{SkinStudyError, StudyError, StudyOptions, measure, measure_skin};
use pliant::progress::Progress;
use pliant::scene::SolverQuestion;
use pliant::scene::{Content, Scene, SkinScene};
use pliant::simulation::Assets;

/// Measure the cost of accuracy in a scene: errors and times of many solvers and settings against a
/// reference
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant accuracy hip
  pliant accuracy hip --budget 10min --set frames=100
  pliant accuracy flat-implant
  pliant accuracy examples/right-hip.toml --set solver=quasi_static --json > accuracy.json

Results in pliant-out/NAME-accuracy: report.html, work_precision.csv, work_precision.svg, summary.json. The error is the
distance to a refined solution of the same energy, of the worst frame; for skin it is that of the area gained in
the last frame, against a finer mesh. Exit code 1: no reference could be computed.")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene
    #[arg(default_value = "hip")]
    scene: String,
    /// Approximate time for the whole study: "90s", "10min"
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = duration)]
    budget: Duration,
    /// Number of frames to compare, from the first [default: as the budget permits]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: Option<u32>,
    #[command(flatten)]
    output: Output,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
}

/// Parses a time with its unit; a bare number is in seconds.
fn duration(text: &str) -> Result<Duration, String> {
    let text = text.trim();
    let digits = text
        .find(|c: char| !(c.is_ascii_digit() || c == '.'))
        .unwrap_or(text.len());
    let (number, unit) = (&text[..digits], text[digits..].trim());
    let scale = match unit {
        "" | "s" => 1.0,
        "ms" => 1e-3,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(format!("`{unit}` is no unit of time; known: ms, s, min, h")),
    };
    let seconds: f64 = number
        .parse()
        .map_err(|_| "expected a time such as 60s".to_owned())?;
    // A week is the limit.
    if !(seconds * scale > 0.0 && seconds * scale <= 604_800.0) {
        return Err("expected more than 0 s and at most 168 h".to_owned());
    }
    Ok(Duration::from_secs_f64(seconds * scale))
}

/// Prints the progress on standard error; Ctrl-C stops the study.
pub(super) struct Said<'a> {
    pub(super) stop: &'a AtomicBool,
}

impl Progress for Said<'_> {
    fn report(&self, stage: &str, _: usize, _: usize) -> ControlFlow<()> {
        if !stage.is_empty() {
            note(stage);
        }
        if_raised(self.stop)
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    match environment::load_content(&arguments.scene, &arguments.set)? {
        Content::Muscles(scene) => of_muscles(arguments, &scene),
        Content::Skin(scene) => of_skin(arguments, &scene),
        _ => {
            let hint = "compare scenes of other kinds in a study that varies a key such as `lattice.points`, see `pliant study --help`";
            Err(Failure::usage(
                "accuracy is measured for muscles and for skin",
                hint,
            ))
        }
    }
}

fn of_skin(arguments: &Arguments, scene: &SkinScene) -> Result<u8, Failure> {
    if arguments.frames.is_some() {
        let hint = "leave --frames out; with --set frames=N the fill ends there";
        return Err(Failure::usage(
            "the last frame of skin is what is compared",
            hint,
        ));
    }
    let stop = stop_on_interrupt("stopping after this frame");
    arguments.output.threads.start();
    let begun = Instant::now();
    let folder = Folder::open(&arguments.output.folder(&scene.name, "accuracy"))?;
    let study = match measure_skin(scene, arguments.budget, &Said { stop: &stop }) {
        Ok(study) => study,
        Err(SkinStudyError::Load(error)) => return Err(error.into()),
        Err(error @ SkinStudyError::NoReference(_)) => {
            warn(&format!("error: {error}"));
            return Ok(if stop.load(Ordering::Relaxed) {
                interrupted()
            } else {
                FAILED
            });
        }
    };
    let output = RunOutput {
        time_s: begun.elapsed().as_secs_f64(),
        ..skin_accuracy::output(&study)
    };
    arguments.output.finish(&folder, output)
}

fn of_muscles(arguments: &Arguments, scene: &Scene) -> Result<u8, Failure> {
    if SolverQuestion::of(&scene.solver).is_none() {
        return Err(no_energy());
    }
    let stop = stop_on_interrupt("stopping after this frame");
    let options = StudyOptions {
        budget: arguments.budget,
        frames: arguments.frames.map(|n| n as usize),
        threads: arguments.output.threads.count(),
    };
    let begun = Instant::now();
    let assets = Assets::load(scene)?;
    let folder = Folder::open(&arguments.output.folder(&scene.name, "accuracy"))?;
    let study = match measure(scene, &assets, options, &Said { stop: &stop }) {
        Ok(study) => study,
        Err(StudyError::Load(error)) => return Err(error.into()),
        Err(StudyError::NoEnergy) => return Err(no_energy()),
        Err(error @ StudyError::NoReference(_)) => {
            warn(&format!("error: {error}"));
            return Ok(if stop.load(Ordering::Relaxed) {
                interrupted()
            } else {
                FAILED
            });
        }
    };
    let output = RunOutput {
        time_s: begun.elapsed().as_secs_f64(),
        ..work_precision::output(&study)
    };
    arguments.output.finish(&folder, output)
}

fn no_energy() -> Failure {
    Failure::usage(
        StudyError::NoEnergy.to_string(),
        "choose another, as with --set solver=xpbd",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_units() {
        let seconds = |text: &str| duration(text).map(|d| d.as_secs_f64());
        assert_eq!(seconds("90s"), Ok(90.0));
        assert_eq!(seconds(" 1.5 min"), Ok(90.0));
        assert_eq!(seconds("2"), Ok(2.0));
        assert_eq!(seconds("250ms"), Ok(0.25));
        for wrong in [
            "",
            "s",
            "0s",
            "-3s",
            "1 fortnight",
            "1e9h",
            "999h",
            "1.2.3s",
            "nan",
        ] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
    }
}
