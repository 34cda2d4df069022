//! `pliant check`: defects of meshes, their fitness for simulations, and repairs.

mod checked;
mod hierarchy;
mod overlaps;
mod words;

use std::collections::HashMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;
use serde_json::json;

use super::failure::Failure;
use super::options::Printing;
use super::{BAD_INPUT, length_unit};
use crate::report::output::{RunOutput, Verdict, json_text};
use checked::{Checked, Outcome};
use overlaps::Overlaps;
use pliant::io::write_whole;
use pliant::mesh::{LONGEST_RIM, RepairOptions};
use pliant::scene::units::{self, Dimension};

/// Show the defects of meshes and whether a simulation accepts them, and repair them
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant check femur.obj
  pliant check muscles/*.obj --unit mm --json > health.json
  pliant check psoas.vtk --repair repaired --close-holes
  pliant check scan.stl --unit mm --repair repaired --merge-within '0.01 mm' --keep-largest
  pliant check femur.obj --hierarchy pictures
  pliant check psoas.obj iliacus.obj --fixed femur.obj hip.obj --part parted

A repair merges vertices of rims that lie in one place, drops repeated triangles and unused vertices, cuts triangles
without area, takes surfaces apart where more than two triangles meet, and turns triangles outward. It moves nothing,
unless --merge-within is given. DIR gets each mesh under its own name (STL, which cannot hold vertices, OFF and DirectX get
.obj behind it; attributes such as colours are not kept) and changes.json, which lists the elements that each step changed.

Of several meshes in one frame, the check also shows which overlap: crossing triangles (exact), vertices inside, depth, place.
--part moves their vertices until no two triangles cross, with the volumes kept.

Exit codes: 0 a simulation takes every mesh (with --repair: every repaired mesh); 1 it refuses one (a code with E), or --part
leaves a pair that crosses;
2 a file cannot be read as a mesh, or the usage is wrong.")]
pub(super) struct Arguments {
    /// Mesh files
    #[arg(required = true, value_name = "MESH")]
    meshes: Vec<PathBuf>,
    /// Length unit of the files, such as mm; without it, sizes are in the unit of the file, and the
    /// unit is guessed
    #[arg(long, value_name = "UNIT")]
    unit: Option<String>,
    /// Write repaired meshes into this folder
    #[arg(long, value_name = "DIR")]
    repair: Option<PathBuf>,
    /// Part meshes that overlap and write them into this folder, each under its own name
    #[arg(long, value_name = "DIR", conflicts_with = "repair")]
    part: Option<PathBuf>,
    /// Write pictures of the hierarchy of boxes over each mesh, by levels, into this folder
    #[arg(long, value_name = "DIR")]
    hierarchy: Option<PathBuf>,
    /// Also search for overlap with these meshes, which --part does not move, such as bones
    #[arg(long, value_name = "MESH", num_args = 1..)]
    fixed: Vec<PathBuf>,
    /// Also close holes of at most N edges [1 to 500; 100 without a number]
    #[arg(long, value_name = "N", requires = "repair", num_args = 0..=1, require_equals = true, default_missing_value = "100",
        value_parser = clap::value_parser!(u16).range(1..=LONGEST_RIM as i64))]
    close_holes: Option<u16>,
    /// Also cut handles around which a loop of at most this length leads, such as '10 mm'; requires --unit
    #[arg(long, value_name = "LENGTH", requires_all = ["repair", "unit"])]
    cut_handles: Option<String>,
    /// Also remove all pieces except the one with the greatest area
    #[arg(long, requires = "repair")]
    keep_largest: bool,
    /// Also merge vertices of rims that are at most this far apart, such as '0.01 mm'; requires
    /// --unit
    #[arg(long, value_name = "LENGTH", requires_all = ["repair", "unit"])]
    merge_within: Option<String>,
    /// Overwrite existing repaired or parted meshes and changes.json
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    printing: Printing,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let unit = arguments.unit.as_deref().map(length_unit).transpose()?;
    let options = options(arguments, unit)?;
    let targets = targets(arguments)?;
    let (repaired, parted) = match arguments.part {
        None => (targets.as_slice(), [].as_slice()),
        Some(_) => ([].as_slice(), targets.as_slice()),
    };
    let work: Vec<(&PathBuf, Option<&PathBuf>)> = arguments
        .meshes
        .iter()
        .enumerate()
        .map(|(k, mesh)| (mesh, repaired.get(k)))
        .collect();
    let outcomes: Vec<Outcome> = work
        .into_par_iter()
        .map(|(mesh, target)| checked::check(mesh, unit, target.map(PathBuf::as_path), &options))
        .collect();
    let overlaps = match arguments.meshes.len() + arguments.fixed.len() {
        0 | 1 => Overlaps::default(),
        _ => overlaps::find(&arguments.meshes, &arguments.fixed, parted)?,
    };
    let mut output = output(arguments, &outcomes, repaired, &overlaps);
    if let Some(folder) = &arguments.hierarchy {
        let pictures = hierarchy::write(folder, &arguments.meshes)?;
        output
            .written
            .extend(pictures.iter().map(|path| path.display().to_string()));
    }
    output.time_s = begun.elapsed().as_secs_f64();
    if let Some(folder) = &arguments.repair {
        let path = folder.join(CHANGES);
        let text = json_text(&output.summary_without_folder());
        write_whole(&path, |w| w.write_all(text.as_bytes())).map_err(|e| {
            Failure::usage(
                format!("{}: cannot be written: {e}", path.display()),
                "name another folder",
            )
        })?;
    }
    let code = arguments.printing.finish(output);
    let failures: Vec<&Failure> = outcomes.iter().filter_map(Outcome::failure).collect();
    failures.iter().for_each(|failure| failure.show());
    Ok(if failures.is_empty() { code } else { BAD_INPUT })
}

/// The summary of a repair, in the folder of the repaired meshes.
const CHANGES: &str = "changes.json";

/// The result; `targets` are the repaired meshes.
fn output(
    arguments: &Arguments,
    outcomes: &[Outcome],
    targets: &[PathBuf],
    overlaps: &Overlaps,
) -> RunOutput<'static> {
    let verdicts = outcomes.iter().map(|outcome| {
        let fit = outcome.checked().is_some_and(Checked::is_fit);
        let verdict = Verdict::new("a simulation accepts the mesh", fit).at(outcome.file());
        verdict.else_do("see its errors; --repair DIR repairs many of them")
    });
    let name = match outcomes {
        [one] => one.file().to_owned(),
        all => format!("{} meshes", all.len()),
    };
    let repaired = targets.iter().zip(outcomes);
    let repaired = repaired.filter(|(_, outcome)| outcome.checked().is_some());
    let repaired = repaired.map(|(target, _)| target.display().to_string());
    let changes = arguments.repair.iter().map(|folder| folder.join(CHANGES));
    let changes = changes.map(|path| path.display().to_string());
    let parted = overlaps.written.iter();
    let parted = parted.map(|path| path.display().to_string());
    RunOutput {
        kind: "check",
        name,
        measures: json!({"meshes": outcomes, "overlaps": overlaps.measures()}),
        verdicts: verdicts.chain(overlaps.verdicts()).collect(),
        text: words::report(outcomes, arguments.unit.as_deref()) + &overlaps.text(),
        written: repaired.chain(changes).chain(parted).collect(),
        ..RunOutput::default()
    }
}

/// Options of a repair, lengths in the unit of the files.
fn options(arguments: &Arguments, unit: Option<f64>) -> Result<RepairOptions, Failure> {
    let length = |option: &str, given: &Option<String>| match (given, unit) {
        (Some(text), Some(unit)) => {
            let length = units::parse(text, Dimension::Length)
                .map_err(|e| Failure::usage(e.to_string(), e.help()))?;
            if length < 0.0 {
                return Err(Failure::usage(
                    format!("{option} {text} is negative"),
                    "give a length of at least zero",
                ));
            }
            Ok(length / unit)
        }
        _ => Ok(0.0),
    };
    let close_holes = arguments.close_holes.map_or(0, usize::from);
    Ok(RepairOptions {
        merge_within: length("--merge-within", &arguments.merge_within)?,
        close_holes,
        cut_handles: length("--cut-handles", &arguments.cut_handles)?,
        keep_largest: arguments.keep_largest,
    })
}

/// The path of each repaired or parted mesh; empty without --repair and --part. Input files are
/// never overwritten.
fn targets(arguments: &Arguments) -> Result<Vec<PathBuf>, Failure> {
    let Some(folder) = arguments.repair.as_ref().or(arguments.part.as_ref()) else {
        return Ok(Vec::new());
    };
    let mut taken: HashMap<PathBuf, &PathBuf> = HashMap::new();
    let mut targets = Vec::new();
    for mesh in &arguments.meshes {
        let target = folder.join(repaired_name(mesh));
        if let Some(other) = taken.insert(target.clone(), mesh) {
            let message = format!(
                "{} and {} would both become {}",
                other.display(),
                mesh.display(),
                target.display()
            );
            return Err(Failure::usage(message, "write them into different folders"));
        }
        targets.push(target);
    }
    std::fs::create_dir_all(folder).map_err(|e| {
        Failure::usage(
            format!("{}: no folder can be made there: {e}", folder.display()),
            "name another folder",
        )
    })?;
    let same = |a: &Path, b: &Path| {
        a.canonicalize()
            .is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b))
    };
    for target in &targets {
        if let Some(mesh) = arguments.meshes.iter().find(|mesh| same(mesh, target)) {
            let message = format!("{} would be written over", mesh.display());
            return Err(Failure::usage(message, "name another folder"));
        }
    }
    let lists = arguments.repair.iter().map(|folder| folder.join(CHANGES));
    let lists: Vec<PathBuf> = lists.collect();
    if let Some(old) = targets
        .iter()
        .chain(&lists)
        .find(|path| path.exists() && !arguments.force)
    {
        return Err(Failure::usage(
            format!("{} is there already", old.display()),
            "name another folder, or add --force",
        ));
    }
    Ok(targets)
}

/// The name of a repaired mesh: its own, in a writable format.
fn repaired_name(mesh: &Path) -> PathBuf {
    let name = PathBuf::from(mesh.file_name().unwrap_or(mesh.as_os_str()));
    let ending = name
        .extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default();
    if ["obj", "ply", "vtk", "vtp"].contains(&ending.as_str()) {
        name
    } else {
        let mut name = name.into_os_string();
        name.push(".obj");
        name.into()
    }
}
