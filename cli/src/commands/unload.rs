//! `pliant unload`: the shape at rest of a scan under a load.

use std::time::Instant;

use super::environment;
use super::failure::Failure;
use super::options::Output;
use super::progress::Stoppable;
use super::run::stop_on_interrupt;
use super::sensitivities::{frame_of, refused};
use crate::report::folder::{Folder, FolderError};
use crate::report::output::RunOutput;
use crate::report::unload;
use pliant::scene::units::{Dimension, parse};

/// Find the shape at rest of muscles that were scanned under a load, such as gravity
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant unload scene.toml
  pliant unload scene.toml --tolerance '0.05 mm' --set 'effects.gravity.acceleration=[\"0 m/s2\", \"0 m/s2\", \"-9.81 m/s2\"]'

The meshes of the scene are scans under its load: gravity, forces, activation. A run takes them for shapes at rest, and so they
sag a second time. The command finds the shapes whose equilibrium in --at is the scan, with bones as they are in that frame.
Give a frame in which the bones stand as they did while scanning; the first one if --at is left out.

Results in pliant-out/NAME-unload: NAME.obj of each muscle, the mesh for the scene in the unit m; NAME.vtp with the distance of its
equilibrium from the scan; unload.csv, summary.json, report.html.
Exit codes: 0 done; 1 the equilibrium does not meet the scan; 2 bad usage or input; 130 or 143 interrupted.")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene
    scene: String,
    /// Frame of the scan [default: 1]
    #[arg(long, value_name = "FRAME", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    at: u32,
    /// Greatest distance of the equilibrium from the scan, at any vertex
    #[arg(long, value_name = "LENGTH", default_value = "0.01 mm")]
    tolerance: String,
    #[command(flatten)]
    output: Output,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let content = environment::load_content(&arguments.scene, &arguments.set)?;
    let frame = frame_of(&content, Some(arguments.at))?;
    let text = &arguments.tolerance;
    let bad = |why: &str| {
        Failure::usage(
            format!("--tolerance {text}: {why}"),
            "give a length such as '0.01 mm'",
        )
    };
    let tolerance = parse(text, Dimension::Length).map_err(|error| bad(&error.to_string()))?;
    if !(tolerance > 0.0) {
        return Err(bad("it is not greater than zero"));
    }
    let stop = stop_on_interrupt("stopping");
    arguments.output.threads.start();
    let folder = Folder::open(&arguments.output.folder(content.name(), "unload"))?;
    let said = Stoppable::new(frame, &stop);
    let found = pliant::simulation::unload(&content, frame, tolerance, &said);
    said.bar.end();
    let found = match found {
        Ok(found) => found,
        Err(error) => return refused(error),
    };
    let output = unload::output(content.name(), (frame, tolerance), &found);
    let output = RunOutput {
        time_s: begun.elapsed().as_secs_f64(),
        ..output.map_err(FolderError::from)?
    };
    arguments.output.finish(&folder, output)
}
