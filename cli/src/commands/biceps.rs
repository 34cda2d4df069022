//! `pliant biceps`: the geometric muscle, at one length or over its whole range.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::failure::Failure;
use super::{DONE, say, say_json};
use crate::report::biceps;
use crate::report::folder::Folder;
use pliant::geometric::file::{self, Muscle};
use pliant::geometric::pose::Pose;
use pliant::io::names::file_name;
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

Exit codes: 0 done; 2 bad usage or input, or a length that the muscle cannot take.")]
pub(super) struct Arguments {
    /// The file of the muscle
    file: PathBuf,
    /// Length from the first node to the last, such as '14 cm'
    #[arg(long, value_name = "LENGTH", conflicts_with = "animate")]
    length: Option<String>,
    /// Contract and stretch it over all lengths that it may take
    #[arg(long)]
    animate: bool,
    /// Pictures of an animation
    #[arg(long, value_name = "N", default_value = "48", requires = "animate", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    frames: u32,
    /// Folder of the results [default: pliant-out/NAME-biceps]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write the summary as JSON to standard output
    #[arg(long)]
    json: bool,
}

/// Results of a muscle.
#[derive(Serialize)]
struct Summary {
    name: String,
    nodes: usize,
    length_m: f64,
    length_at_rest_m: f64,
    shortest_m: f64,
    longest_m: f64,
    volume_m3: f64,
    volume_error: f64,
    radius_max_m: f64,
    radius_min_m: f64,
    joint_angle_rad: Option<f64>,
    poses: usize,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
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
    let path = arguments.out.clone();
    let path = path.unwrap_or_else(|| {
        PathBuf::from("pliant-out").join(format!("{}-biceps", file_name(&name)))
    });
    let folder = Folder::open(&path)?;
    let pose = Pose::of(&muscle);
    let animated = if arguments.animate {
        Some(arguments.frames)
    } else {
        None
    };
    let summary = summary(&name, &muscle, &pose, animated);
    biceps::write(
        &folder,
        &name,
        &muscle,
        animated,
        &serde_json::to_value(&summary).unwrap_or_default(),
    )?;
    if arguments.json {
        say_json(&summary);
    } else {
        tell(&summary, &muscle, &path);
    }
    Ok(DONE)
}

fn read(path: &Path) -> Result<Muscle, Failure> {
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

fn set(muscle: &mut Muscle, length: f64) -> Result<(), Failure> {
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

fn summary(name: &str, muscle: &Muscle, pose: &Pose, animated: Option<u32>) -> Summary {
    let chain = &muscle.chain;
    let radii = || chain.radii().iter().copied();
    Summary {
        name: name.to_owned(),
        nodes: chain.radii().len(),
        length_m: chain.length(),
        length_at_rest_m: chain.rest().length,
        shortest_m: muscle.range[0],
        longest_m: muscle.range[1],
        volume_m3: chain.volume_now(),
        volume_error: chain.volume_now() / chain.volume() - 1.0,
        radius_max_m: radii().fold(0.0, f64::max),
        radius_min_m: radii().fold(f64::INFINITY, f64::min),
        joint_angle_rad: pose.joint_angle,
        poses: animated.unwrap_or(1) as usize,
    }
}

fn tell(summary: &Summary, muscle: &Muscle, path: &Path) {
    let number = |value: f64| pliant::format::number(value / muscle.unit);
    say(&format!(
        "{}: {} nodes, length {} (from {} to {}), greatest radius {}, volume kept to {:.1e}\n",
        summary.name,
        summary.nodes,
        number(summary.length_m),
        number(summary.shortest_m),
        number(summary.longest_m),
        number(summary.radius_max_m),
        summary.volume_error.abs()
    ));
    if let Some(angle) = summary.joint_angle_rad {
        say(&format!("joint at {:.1} degrees\n", angle.to_degrees()));
    }
    say(&format!(
        "\nResults in {}\n  open {} in a browser\n",
        path.display(),
        path.join("report.html").display()
    ));
}
