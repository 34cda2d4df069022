//! `pliant biceps`: a scene of the geometric muscle, at one length or over its whole range.

use std::time::Instant;

use super::failure::Failure;
use super::options::{Output, PrintScene};
use super::{DONE, environment};
use crate::report::biceps::{self, Animation};
use crate::report::folder::{Folder, FolderError};
use crate::report::output::RunOutput;
use pliant::progress::Silent;
use pliant::scene::Content;
use pliant::scene::units::{Dimension, parse};
use pliant::simulation::{self, GeometricRun, Observer};

/// Change the length of a muscle of frusta that keeps its volume
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant biceps examples/biceps.toml
  pliant biceps examples/biceps.toml --length '14 cm'
  pliant biceps examples/biceps.toml --animate --frames 60
  pliant biceps examples/biceps.toml --length '14 cm' --print-scene > short.toml

The file is a scene, which `pliant run`, `plan`, `study` and `view` take too: radii and grow_mults of the nodes, length, and
optionally unit, frame (four lengths of two bars), min_part and max_part (shortest and longest length, relative to the length at
rest), insert (nodes between each two), caps (\"in\": hemispheres at the ends belong to the volume), fixed_length, frames, frame_rate.
Without --length the muscle is at rest; --animate changes its length from there to the longest, to the shortest and back.

Results in pliant-out/NAME-biceps: muscle.vtp and muscle.png (with --animate frames/*.vtp, NAME.pvd, NAME.gif), lengths.csv with
radii and angles over all lengths, summary.json, report.html.

Exit codes: 0 done; 1 the volume is not kept; 2 bad usage or input, or a length that the muscle cannot take.")]
pub(super) struct Arguments {
    /// The file of the muscle
    file: String,
    /// Length from the first node to the last, such as '14 cm'
    #[arg(long, value_name = "LENGTH", conflicts_with = "animate")]
    length: Option<String>,
    /// Contract and stretch the muscle over its whole range of lengths
    #[arg(long)]
    animate: bool,
    /// Number of pictures of the animation [default: the frames of the file, or 60]
    #[arg(long, value_name = "N", requires = "animate", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    frames: Option<u32>,
    #[command(flatten)]
    print: PrintScene,
    #[command(flatten)]
    output: Output,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let mut run = made(arguments)?;
    if arguments.print.is_given(&run.scene.to_toml()) {
        return Ok(DONE);
    }
    let path = arguments.output.folder(&run.scene.name, "biceps");
    arguments.output.threads.start();
    let mut animation = arguments.animate.then(Animation::default);
    let mut observers: Vec<&mut dyn Observer<GeometricRun>> = Vec::new();
    if let Some(animation) = &mut animation {
        observers.push(animation);
    }
    simulation::run(&mut run, &mut observers, &Silent);
    let output = biceps::output(&run, animation).map_err(FolderError::from)?;
    let output = RunOutput {
        time_s: begun.elapsed().as_secs_f64(),
        ..output
    };
    arguments.output.finish(&Folder::open(&path)?, output)
}

/// The scene of the options, ready to run: one length, or the whole range.
fn made(arguments: &Arguments) -> Result<GeometricRun, Failure> {
    let mut changes = Vec::new();
    if let Some(text) = &arguments.length {
        parse(text, Dimension::Length)
            .map_err(|error| Failure::usage(format!("--length: {error}"), error.help()))?;
        changes.push(format!("fixed_length={text}"));
    }
    if arguments.animate {
        changes.push("fixed_length=none".to_owned());
    }
    changes.extend(arguments.frames.map(|n| format!("frames={n}")));
    let content = environment::load_content(&arguments.file, &changes)?;
    let Content::Geometric(mut scene) = content else {
        return Err(Failure::usage(
            format!("{} is a scene of another kind", arguments.file),
            "`pliant run` runs scenes of all kinds",
        ));
    };
    if !arguments.animate {
        scene.frames = 1;
        scene.fixed_length.get_or_insert(scene.shape.length);
    }
    Ok(GeometricRun::new(*scene))
}
