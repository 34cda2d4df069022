//! `pliant implant`: a scene of skin over implants, for planning.

mod text;

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Instant;

use super::failure::Failure;
use super::morph::nothing_written;
use super::options::{Output, PrintScene};
use super::progress::if_raised;
use super::run::{Job, settings_of_all, stop_on_interrupt};
use super::scene_text::SceneText;
use crate::report::folder::{Folder, FolderError};
use crate::report::frames::Stored;
use crate::report::implant::preview;
use crate::report::run::RunOptions;
use pliant::scene::{Content, FillCourse, ImplantFill, Support};
use pliant::simulation::SkinRun;
use pliant::skin::SkinError;

/// Simulate skin over implants: areas before, deformed, retracted and grown; the volume for a
/// target area
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant implant body_quads.obj --unit dm --at=0.70,3.77,1.60 --shape round --base 14cm --volume 300cc
  pliant implant scalp.obj --unit m --near-vertex 60 --base 3cm --volume 8cc --depth 3mm --obstacle skull.obj
  pliant implant sheet.obj --unit cm --near-vertex 2112 --base 7cm --target-area 30cm2
  pliant implant sheet.obj --unit cm --near-vertex 2112 --base 7cm --volumes 50,100,150
  pliant implant sheet.obj --unit cm --near-vertex 2112 --base 7cm --fill 0:30cc,7:50cc,14:80cc,21:100cc
  pliant implant body_quads.obj --unit dm --at=0.70,3.77,1.60 --base 14cm --preview
  pliant implant back.ply --unit mm --implant 'near-vertex=310 volume=100cc' --implant 'near-vertex=911 shape=oval volume=80cc'

The command makes a scene of these options and runs it. --print-scene prints the scene; `pliant run`, `plan`, `view`, `study` and
`accuracy` take it as a file.

Results: report.html, skin.vtp (with `stretch`, `over_limit`, `region` (its number; 0.5 less on its rim), `displacement`,
`lower_layer` (vector to the lower layer) and `lower_displacement`), implant_1.vtp, ..., pictures, measures.csv, summary.json, frames
for ParaView; curve.csv and curve.svg with --volumes and --fill. `verdicts` of summary.json has each check: skin and implants are
at rest in every frame. Skin stretched beyond --stretch-limit is no failed check but a finding (`findings`, `area_over_limit_m2`).

\"Volume difference\": the volume between the region before and the region over the implant, closed at its rim. It is more than
the implant's, by the gap beside it that taut skin spans. `void_volume_m3` is that gap below the lower layer.

The lower layer is bonded to what lies below it, outside of a pocket that is cut to the base, with --bond for each area: springs of
length zero that pull it back to where it lay. With --bond '0 N/m3' skin spans freely; with --pocket 0 it is bonded everywhere.

Where a region reaches the border of an open skin it ends there, and the border is held; a note says so.

Obstacles are meshes of bones and the like, in the unit of the skin, under it: at least one must lie under the implant, within
two bases below the skin. Implant and skin come to lie over them. Without any, the implant lies on what was under the skin
before, which is rigid.

Exit codes: 0 all is at rest and sound; 1 a skin or implant did not come to rest, crosses itself or another body, or is folded
beyond a right angle (the check names the place), or files could not be written;
2 bad usage or input, or a folder that cannot be written to, before anything is
computed; 130 or 143 interrupted, with the frames that are at rest.")]
pub(super) struct Arguments {
    /// The skin
    skin: PathBuf,
    /// Length unit of the skin's file, of --at and of obstacles, such as dm
    #[arg(long, value_name = "UNIT")]
    unit: String,
    /// Centre of the implant: under this vertex of the file, counted from 0
    #[arg(long, value_name = "N", conflicts_with = "at", allow_negative_numbers = true, value_parser = vertex)]
    near_vertex: Option<usize>,
    /// Centre of the implant: under the point of the skin nearest to this point, in the unit of the
    /// file
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    at: Option<String>,
    /// Shape of the base: round, oval, crescent or rectangular
    #[arg(long, default_value = "round")]
    shape: String,
    /// Length of the base; the moving region of the skin is 1.5 times as wide
    #[arg(
        long,
        value_name = "LENGTH",
        default_value = "7cm",
        allow_hyphen_values = true
    )]
    base: String,
    /// Direction of the longer side [default: an axis of space]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    long: Option<String>,
    /// Volume of the implant: at least that of a dome with a height of a hundredth of the base, at
    /// most what fits on the base
    #[arg(
        long,
        value_name = "VOLUME",
        default_value = "100cc",
        allow_hyphen_values = true
    )]
    volume: String,
    /// Depth of the implant under the skin, at most half of the base
    #[arg(
        long,
        value_name = "LENGTH",
        default_value = "5mm",
        allow_hyphen_values = true
    )]
    depth: String,
    /// Edge length of the skin, at most a quarter of the base; a coarser skin is refined. The edge
    /// length also changes the region, because it ends with whole triangles, and so the areas
    /// before and after [default: the base over 20]
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    edge: Option<String>,
    /// Thickness of the skin that bears tension, at most half of the base; the default is an
    /// assumption
    #[arg(
        long,
        value_name = "LENGTH",
        default_value = "2mm",
        allow_hyphen_values = true
    )]
    thickness: String,
    /// Young's modulus of the skin; the default is an assumption
    #[arg(
        long,
        value_name = "PRESSURE",
        default_value = "200 kPa",
        allow_hyphen_values = true
    )]
    modulus: String,
    /// Bond of the lower layer of the skin to what lies below, for each area, outside of the
    /// pocket; 0 N/m3 for skin that spans freely. The default is an assumption
    #[arg(
        long,
        value_name = "STIFFNESS",
        default_value = "2e6 N/m3",
        allow_hyphen_values = true
    )]
    bond: String,
    /// Size of the pocket without a bond, in outlines of the base
    #[arg(
        long,
        value_name = "RATIO",
        default_value_t = 1.0,
        allow_hyphen_values = true
    )]
    pocket: f64,
    /// One of several implants, as 'near-vertex=N volume=80cc shape=oval base=6cm' or with
    /// at=X,Y,Z, long=X,Y,Z or fill=0:30cc,7:60cc; the other options give the values of missing
    /// keys
    #[arg(long, value_name = "KEYS")]
    implant: Vec<String>,
    /// Meshes under the skin that support implants, such as the skull, in the unit of the skin
    /// [default: the rigid initial surface under the skin]
    #[arg(long, value_name = "FILE", num_args = 1..)]
    obstacle: Vec<PathBuf>,
    /// Find the volume for which the region gains this area while the implant is in
    #[arg(long, value_name = "AREA", conflicts_with_all = ["volumes", "implant"], allow_hyphen_values = true)]
    target_area: Option<String>,
    /// The former name of --target-area
    #[arg(long, hide = true, value_parser = renamed)]
    wanted_area: Option<String>,
    /// Compute the areas for each of these volumes, in cc if no unit is given; the last one is
    /// shown
    #[arg(
        long,
        value_name = "LIST",
        conflicts_with = "implant",
        allow_hyphen_values = true
    )]
    volumes: Option<String>,
    /// Fill the implant over days, as DAY:VOLUME,...: areas after each filling; the last one is
    /// shown
    #[arg(long, value_name = "LIST", conflicts_with_all = ["volumes", "target_area", "volume"], allow_hyphen_values = true)]
    fill: Option<String>,
    /// Stretch above which skin is reported as overstretched; this is a finding and does not change
    /// the exit code
    #[arg(
        long,
        value_name = "RATIO",
        default_value_t = 1.5,
        allow_hyphen_values = true
    )]
    stretch_limit: f64,
    /// Show where the implants will lie, upright, with the outlines of base and region, and stop
    #[arg(long)]
    preview: bool,
    /// Direction that is up in pictures [default: the axis of the greatest extent]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    up: Option<String>,
    /// Mend the skin after reading, as `pliant check --repair` does
    #[arg(long)]
    repair: bool,
    /// Method of the equilibrium: newton or quasi_static [default: by size]
    #[arg(long, value_name = "NAME")]
    method: Option<String>,
    #[command(flatten)]
    print: PrintScene,
    #[command(flatten)]
    output: Output,
}

fn vertex(text: &str) -> Result<usize, String> {
    text.parse()
        .map_err(|_| "vertices count from 0: give a whole number of at least 0".to_owned())
}

fn renamed(_: &str) -> Result<String, String> {
    Err("the option is now --target-area".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    arguments.output.threads.start();
    let (name, made) = text::scene(arguments)?;
    let content = made.content()?;
    check(&made, &content)?;
    if arguments.print.is_given(made.text()) {
        return Ok(super::DONE);
    }
    if let (true, Content::Skin(scene)) = (arguments.preview, &content) {
        let stop = stop_on_interrupt("stopping; nothing will be written");
        let out = arguments.output.folder(&name, "implant");
        let files = ["overview.png", "summary.json", "report.html"].map(str::to_owned);
        Folder::check(&out, &files)?;
        let heard = |_: &str, _: usize, _: usize| if_raised(&stop);
        let run = SkinRun::new_with(scene.as_ref().clone(), &heard);
        if stop.load(Ordering::Relaxed) {
            return Ok(nothing_written());
        }
        let run = run.map_err(|error| made.of_load(error))?;
        let time_s = begun.elapsed().as_secs_f64();
        let output = preview(&run, time_s).map_err(FolderError::from)?;
        return arguments.output.finish(&Folder::open(&out)?, output);
    }
    let stop = stop_on_interrupt("stopping; the frames that are at rest will be written");
    Job {
        output: &arguments.output,
        out: arguments.output.folder(&name, "implant"),
        options: RunOptions {
            kind: Some("implant"),
            animate: false,
            stored: Stored::default(),
            begun,
            settings: settings_of_all().to_vec(),
        },
        stop: &stop,
        refused: &|error| made.of_load(error),
    }
    .run(&content)
}

/// Rejects numbers of implants that a scene accepts, but that describe no implant.
fn check(made: &SceneText, content: &Content) -> Result<(), Failure> {
    let Content::Skin(scene) = content else {
        return Ok(());
    };
    let Support::Implants(implants) = &scene.under else {
        return Ok(());
    };
    for (k, filled) in implants.iter().enumerate() {
        let refused = |(key, error): (&str, SkinError)| {
            let key = match key.strip_prefix("skin.") {
                Some(_) => key.to_owned(),
                None => format!("implant.{k}.{key}"),
            };
            let place = filled.order.place;
            made.refused(&key, &format!("at {place}: {error}"), error.help())
        };
        checked(filled).map_err(refused)?;
    }
    Ok(())
}

/// The key of a wrong number of an implant, with its error.
fn checked(filled: &ImplantFill) -> Result<(), (&'static str, SkinError)> {
    let order = &filled.order;
    order.check_edge().map_err(|error| match error {
        SkinError::TooThick { what: "depth", .. } => ("depth", error),
        SkinError::TooThick { .. } => ("skin.0.thickness", error),
        SkinError::TooLong { .. } => ("skin.0.edge_length", error),
        _ => ("", error),
    })?;
    let key = match filled.course {
        FillCourse::Evenly => "volume",
        _ => "fill",
    };
    let volumes = filled.fill.iter().map(|(_, volume)| *volume);
    volumes
        .into_iter()
        .try_for_each(|volume| order.check_volume(volume))
        .map_err(|error| (key, error))
}
