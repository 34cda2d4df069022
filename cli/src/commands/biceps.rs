//! `pliant biceps`: the geometric muscle, at one length or over its whole range.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::failure::Failure;
use super::options::Output;
use crate::report::biceps;
use crate::report::folder::{Folder, FolderError};
use crate::report::output::RunOutput;
use pliant::geometric::file::{self, GeometricMuscle};
use pliant::scene::units::{Dimension, parse};

/// Change the length of a muscle of frusta that keeps its volume
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant biceps examples/biceps.toml
  pliant biceps examples/biceps.toml --length '14 cm'
  pliant biceps examples/biceps.toml --animate --frames 60

The file is TOML: radii and grow_mults of the nodes, length, and if wanted unit, frame (four lengths of two bars), min_part and
max_part (shortest and longest, as shares of the length), insert (nodes between each two), caps (\"in\": hemispheres at the ends
belong to the volume). Without --length the muscle is at rest; --animate goes from there to the longest, to the shortest and back.

Results in pliant-out/NAME-biceps: muscle.vtp and muscle.png (with --animate frames/*.vtp, NAME.pvd, NAME.gif), lengths.csv with
radii and angles over all lengths, summary.json, report.html.

Exit codes: 0 done; 1 the volume is not kept; 2 bad usage or input, or a length that the muscle cannot take.")]
pub(super) struct Arguments {
    /// The file of the muscle
    file: PathBuf,
    /// Length from the first node to the last, such as '14 cm'
    #[arg(long, value_name = "LENGTH", conflicts_with = "animate")]
    length: Option<String>,
    /// Contract and stretch the muscle over its whole range of lengths
    #[arg(long)]
    animate: bool,
    /// Number of pictures of the animation
    #[arg(long, value_name = "N", default_value = "48", requires = "animate", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    frames: u32,
    #[command(flatten)]
    output: Output,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let mut muscle = read(&arguments.file)?;
    let name = arguments.file.file_stem().map_or_else(
        || "muscle".into(),
        |stem| stem.to_string_lossy().into_owned(),
    );
    if let Some(text) = &arguments.length {
        let length = parse(text, Dimension::Length)
            .map_err(|error| Failure::usage(format!("--length: {error}"), error.help()))?;
        set(&mut muscle, length)?;
    }
    let path = arguments.output.folder(&name, "biceps");
    arguments.output.threads.start();
    let animated = Some(arguments.frames).filter(|_| arguments.animate);
    let output = biceps::output(&name, &muscle, animated).map_err(FolderError::from)?;
    let output = RunOutput {
        time_s: begun.elapsed().as_secs_f64(),
        ..output
    };
    arguments.output.finish(&Folder::open(&path)?, output)
}

fn read(path: &Path) -> Result<GeometricMuscle, Failure> {
    let shown = path.display();
    let text = std::fs::read_to_string(path).map_err(|error| {
        Failure::usage(
            format!("cannot read `{shown}`: {error}"),
            "name a TOML file of a muscle",
        )
    })?;
    file::parse(&text).map_err(|error| {
        Failure::usage(
            format!("{shown}: {error}"),
            "`pliant biceps --help` tells the keys",
        )
    })
}

fn set(muscle: &mut GeometricMuscle, length: f64) -> Result<(), Failure> {
    let [least, most] = muscle.range;
    if !(least..=most).contains(&length) {
        let [length, least, most] =
            [length, least, most].map(|l| pliant::format::number(l / muscle.unit));
        let message = format!(
            "the muscle cannot take a length of {length}: from {least} to {most} it can, in the unit of its file"
        );
        return Err(Failure::usage(
            message,
            "choose another --length, or change min_part, max_part or frame",
        ));
    }
    muscle
        .chain
        .set_length(length)
        .map_err(|error| Failure::usage(error.to_string(), "choose another --length"))
}
