//! `pliant implant`: skin over implants, for planning.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use nalgebra::{Point3, Vector3};

use super::failure::Failure;
use super::run::stop_on_interrupt;
use super::{DONE, FAILED, INTERRUPTED, length_unit, say, say_json, warn};
use crate::io;
use crate::mesh::TriangleMesh;
use crate::report::folder::Folder;
use crate::report::frames::file_name;
use crate::report::implant::{Insertion, Point, ReportError};
use crate::scene::units::{Dimension, parse};
use crate::simulation::LoadError;
use crate::skin::implant::{Implant, SILICONE};
use crate::skin::layers::Tissue;
use crate::skin::plan::{Inserted, Place, Ready};
use crate::skin::settle::Progress;
use crate::skin::{Filling, Order, Schedule, Shape, SkinError};

/// Units of areas and volumes [m^2, m^3].
const AREAS: &[(&str, f64)] = &[("cm2", 1e-4), ("mm2", 1e-6), ("dm2", 1e-2), ("m2", 1.0)];
const VOLUMES: &[(&str, f64)] =
    &[("cc", 1e-6), ("cm3", 1e-6), ("ml", 1e-6), ("mm3", 1e-9), ("dm3", 1e-3), ("l", 1e-3), ("m3", 1.0)];

/// The settling of a skin is said to go on every so many rounds.
const SAY_EVERY: u32 = 10;

/// Lay skin over implants: areas before, deformed, retracted and grown; which volume gives a wanted area
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant implant body_quads.obj --unit dm --at=0.70,3.77,1.60 --shape round --base 14cm --volume 300cc
  pliant implant scalp.obj --unit m --near-vertex 60 --base 3cm --volume 8cc --depth 3mm --obstacle skull.obj
  pliant implant sheet.obj --unit cm --near-vertex 2112 --base 7cm --wanted-area 30cm2
  pliant implant sheet.obj --unit cm --near-vertex 2112 --base 7cm --volumes 50,100,150
  pliant implant sheet.obj --unit cm --near-vertex 2112 --base 7cm --fill 0:30cc,7:50cc,14:80cc,21:100cc
  pliant implant back.ply --unit mm --implant 'near-vertex=310 volume=100cc' --implant 'near-vertex=911 shape=oval volume=80cc'

Results: report.html, skin.vtp (with `stretch` and `over_limit`), implant_1.vtp, ..., pictures, summary.json; curve.csv and
curve.svg with --volumes and --fill. Exit code 1: skin or implant did not come to rest, or files could not be written.")]
pub(super) struct Arguments {
    /// The skin
    skin: PathBuf,
    /// Length unit of its file, of --at and of obstacles, such as dm
    #[arg(long, value_name = "UNIT")]
    unit: String,
    /// Middle of the implant: under this vertex of the file, counted from 0
    #[arg(long, value_name = "N", conflicts_with = "at")]
    near_vertex: Option<usize>,
    /// Middle of the implant: under the point of the skin nearest to this, in the unit of the file
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    at: Option<String>,
    /// Shape of the base: round, oval, crescent or rectangular
    #[arg(long, default_value = "round")]
    shape: String,
    /// Length of the base
    #[arg(long, value_name = "LENGTH", default_value = "7cm", allow_hyphen_values = true)]
    base: String,
    /// Direction of the longer side [default: an axis of space]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    long: Option<String>,
    /// Volume of the implant
    #[arg(long, value_name = "VOLUME", default_value = "100cc", allow_hyphen_values = true)]
    volume: String,
    /// How deep under the skin the implant goes
    #[arg(long, value_name = "LENGTH", default_value = "5mm", allow_hyphen_values = true)]
    depth: String,
    /// Edges of the skin in the region [default: the base over 20]
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true)]
    edge: Option<String>,
    /// Thickness of the skin that bears tension; assumed unless given
    #[arg(long, value_name = "LENGTH", default_value = "2mm", allow_hyphen_values = true)]
    thickness: String,
    /// Young's modulus of the skin; assumed unless given
    #[arg(long, value_name = "PRESSURE", default_value = "200 kPa", allow_hyphen_values = true)]
    modulus: String,
    /// One of several implants, as 'near-vertex=N volume=80cc shape=oval base=6cm' or with at=X,Y,Z, long=X,Y,Z or
    /// fill=0:30cc,7:60cc; what it does not name is as given by the other options
    #[arg(long, value_name = "KEYS")]
    implant: Vec<String>,
    /// Meshes under the skin that implants rest on, such as the skull [default: what is under the skin as it is]
    #[arg(long, value_name = "FILE", num_args = 1..)]
    obstacle: Vec<PathBuf>,
    /// Find the volume of which the region gains this area while the implant is in
    #[arg(long, value_name = "AREA", conflicts_with_all = ["volumes", "implant"], allow_hyphen_values = true)]
    wanted_area: Option<String>,
    /// Areas for each of these volumes, in cc where no unit is given; the last one is shown
    #[arg(long, value_name = "LIST", conflicts_with = "implant", allow_hyphen_values = true)]
    volumes: Option<String>,
    /// Fill the implant over days, as DAY:VOLUME,... : areas after each filling; the last one is shown
    #[arg(long, value_name = "LIST", conflicts_with_all = ["volumes", "wanted_area", "volume"], allow_hyphen_values = true)]
    fill: Option<String>,
    /// Stretch above which skin is marked as stretched too far
    #[arg(long, value_name = "RATIO", default_value_t = 1.5, allow_hyphen_values = true)]
    stretch_limit: f64,
    /// Folder of the results [default: pliant-out/NAME-implant]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write the result as JSON to standard output, and nothing else
    #[arg(long)]
    json: bool,
}

impl From<ReportError> for Failure {
    fn from(error: ReportError) -> Self {
        match error {
            ReportError::Folder(error) => error.into(),
            ReportError::Picture(error) => Self::usage(error.to_string(), "choose another place"),
        }
    }
}

fn refused(error: &SkinError) -> Failure {
    Failure::usage(error.to_string(), error.help())
}

/// A number with one of some units; `bare` is the unit of a number without.
fn quantity(what: &str, text: &str, units: &[(&str, f64)], bare: Option<f64>) -> Result<f64, Failure> {
    let text = text.trim();
    let known: Vec<&str> = units.iter().map(|(name, _)| *name).collect();
    let hint = format!("write a number and a unit of {}", known.join(", "));
    // The unit is taken off first: what is left may be `nan`, which is a number that later checks refuse.
    let of = |(name, unit): (&str, f64)| Some(text.strip_suffix(name)?.trim_end().parse::<f64>().ok()? * unit);
    let with_unit = units.iter().copied().find_map(of);
    let found = with_unit.or_else(|| bare.and_then(|unit| of(("", unit))));
    found.ok_or_else(|| Failure::usage(format!("{what}: cannot read `{text}`"), hint))
}

fn length(what: &str, text: &str) -> Result<f64, Failure> {
    parse(text, Dimension::Length).map_err(|e| Failure::usage(format!("{what}: {e}"), e.help()))
}

fn triple(what: &str, text: &str) -> Result<[f64; 3], Failure> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse::<f64>()).collect();
    let numbers = numbers.ok().and_then(|n| <[f64; 3]>::try_from(n).ok()).filter(|n| n.iter().all(|c| c.is_finite()));
    numbers.ok_or_else(|| {
        Failure::usage(format!("{what}: cannot read `{text}`"), "write three numbers, as in 0.1,0.2,0.3")
    })
}

/// What a person says of one implant; what is missing is taken from the other options.
#[derive(Clone, Default)]
struct Said {
    near_vertex: Option<usize>,
    at: Option<String>,
    shape: Option<String>,
    base: Option<String>,
    volume: Option<String>,
    fill: Option<String>,
    long: Option<String>,
}

impl Said {
    fn of(text: &str) -> Result<Self, Failure> {
        let mut said = Self::default();
        for word in text.split_whitespace() {
            let (key, value) = word.split_once('=').unwrap_or((word, ""));
            let value = value.to_owned();
            match key {
                "near-vertex" => {
                    let number = value.parse().map_err(|_| {
                        Failure::usage(format!("--implant: `{value}` is no vertex"), "count vertices from 0")
                    })?;
                    said.near_vertex = Some(number);
                }
                "at" => said.at = Some(value),
                "shape" => said.shape = Some(value),
                "base" => said.base = Some(value),
                "volume" => said.volume = Some(value),
                "fill" => said.fill = Some(value),
                "long" => said.long = Some(value),
                _ => {
                    let hint = "known keys: near-vertex, at, shape, base, volume, fill, long";
                    return Err(Failure::usage(format!("--implant: unknown key `{key}`"), hint));
                }
            }
        }
        Ok(said)
    }
}

/// Days and volumes.
fn schedule(text: &str) -> Result<Schedule, Failure> {
    let filling = |pair: &str| {
        let hint = "write a day and a volume each, as in 0:30cc,7:60cc";
        let wrong = || Failure::usage(format!("--fill: cannot read `{pair}`"), hint);
        let (day, volume) = pair.split_once(':').ok_or_else(wrong)?;
        let day = day.trim().parse().map_err(|_| wrong())?;
        Ok(Filling { day, volume: quantity("--fill", volume, VOLUMES, None)? })
    };
    let fillings: Result<Vec<Filling>, Failure> = text.split(',').map(filling).collect();
    Schedule::new(fillings?).map_err(|e| refused(&e))
}

/// The order of one implant.
fn order(arguments: &Arguments, said: &Said, unit: f64) -> Result<Order, Failure> {
    let (at, vertex) = match (said.near_vertex, &said.at) {
        (None, None) => (arguments.at.as_ref(), arguments.near_vertex),
        (vertex, at) => (at.as_ref(), vertex),
    };
    let place = match (vertex, at) {
        (Some(vertex), _) => Place::Vertex(vertex),
        (None, Some(at)) => Place::Point(Point3::from(triple("--at", at)?) * unit),
        (None, None) => {
            return Err(Failure::usage(
                "no place for the implant",
                "name a vertex with --near-vertex or a point with --at",
            ));
        }
    };
    let name = said.shape.as_ref().unwrap_or(&arguments.shape);
    let shape = Shape::ALL
        .iter()
        .find(|(known, _)| known == name)
        .map(|(_, shape)| *shape)
        .ok_or_else(|| Failure::usage(format!("no shape `{name}`"), "known: round, oval, crescent, rectangular"))?;
    let long = said.long.as_ref().or(arguments.long.as_ref());
    let long = long.map(|text| triple("--long", text)).transpose()?.map(Vector3::from);
    let modulus = parse(&arguments.modulus, Dimension::Pressure)
        .map_err(|e| Failure::usage(format!("--modulus: {e}"), e.help()))?;
    Ok(Order {
        place,
        implant: Implant {
            shape,
            base: length("--base", said.base.as_ref().unwrap_or(&arguments.base))?,
            volume: quantity("--volume", said.volume.as_ref().unwrap_or(&arguments.volume), VOLUMES, None)?,
            membrane: SILICONE,
        },
        long,
        tissue: Tissue {
            modulus,
            thickness: length("--thickness", &arguments.thickness)?,
            depth: length("--depth", &arguments.depth)?,
        },
        edge: arguments.edge.as_ref().map(|text| length("--edge", text)).transpose()?,
    })
}

fn read(path: &std::path::Path, unit: f64) -> Result<TriangleMesh, Failure> {
    let mut mesh = io::read(path).map_err(|e| Failure::of_meshes(LoadError::from(Box::new(e))))?.mesh;
    mesh.vertices.iter_mut().for_each(|v| v.coords *= unit);
    if mesh.triangles.is_empty() {
        return Err(Failure::usage(format!("{} has no triangles", path.display()), SkinError::Empty.help()));
    }
    Ok(mesh)
}

/// Prepares each implant; two may not share skin.
fn prepare(orders: &[Order], skin: &TriangleMesh, obstacles: &[TriangleMesh]) -> Result<Vec<Ready>, SkinError> {
    let mut all: Vec<Ready> = Vec::new();
    let mut owner = vec![usize::MAX; skin.triangles.len()];
    for order in orders {
        let ready = Ready::new(skin, order, obstacles)?;
        let mut outside = vec![false; skin.triangles.len()];
        ready.outside.iter().for_each(|t| outside[*t as usize] = true);
        for t in (0..owner.len()).filter(|t| !outside[*t]) {
            if owner[t] != usize::MAX {
                return Err(SkinError::Overlap { first: owner[t] + 1, second: all.len() + 1 });
            }
            owner[t] = all.len();
        }
        all.push(ready);
    }
    Ok(all)
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let stop = stop_on_interrupt();
    let unit = length_unit(&arguments.unit)?;
    let said: Result<Vec<Said>, Failure> = arguments.implant.iter().map(|text| Said::of(text)).collect();
    let mut said = said?;
    if said.is_empty() {
        said.push(Said::default());
    }
    let orders: Result<Vec<Order>, Failure> = said.iter().map(|s| order(arguments, s, unit)).collect();
    let orders = orders?;
    let questions: Result<Vec<Question>, Failure> = said.iter().map(|s| question(arguments, s)).collect();
    let questions = questions?;
    limit(arguments.stretch_limit)?;
    let skin = read(&arguments.skin, unit)?;
    let obstacles: Result<Vec<TriangleMesh>, Failure> =
        arguments.obstacle.iter().map(|path| read(path, unit)).collect();
    let obstacles = obstacles?;
    let stem = arguments.skin.file_stem().map_or("skin".into(), |s| s.to_string_lossy().into_owned());
    let out = PathBuf::from("pliant-out").join(format!("{}-implant", file_name(&stem)));
    let out = arguments.out.clone().unwrap_or(out);
    let ready = prepare(&orders, &skin, &obstacles).map_err(|e| refused(&e))?;
    let found = match settle(ready, &questions, &stop) {
        Err(SkinError::Stopped) => return Ok(INTERRUPTED),
        other => other.map_err(|e| refused(&e))?,
    };
    let insertion = Insertion {
        name: stem,
        skin: &skin,
        implants: found.0,
        obstacles: &obstacles,
        curve: found.1,
        limit: arguments.stretch_limit,
        wanted: questions.iter().find_map(|q| if let Question::Area(wanted) = q { Some(*wanted) } else { None }),
        time: begun.elapsed().as_secs_f64(),
    };
    insertion.write(&Folder::open(&out)?)?;
    if arguments.json {
        say_json(&insertion.to_json());
    } else {
        let page = out.join("report.html");
        let tables: Vec<String> = insertion.tables().iter().map(|table| table.to_text()).collect();
        let results = format!("Results in {}\n  open {} in a browser\n", out.display(), page.display());
        say(&format!("{}\n{results}", tables.join("\n")));
    }
    Ok(if insertion.converged() { DONE } else { FAILED })
}

/// What is asked of an implant.
enum Question {
    /// What its volume does.
    Volume,
    /// Which volume gains this area [m^2].
    Area(f64),
    /// What each of these volumes does [m^3].
    Volumes(Vec<f64>),
    /// What it does as it is filled.
    Fill(Schedule),
}

fn question(arguments: &Arguments, said: &Said) -> Result<Question, Failure> {
    if let Some(text) = &arguments.wanted_area {
        return Ok(Question::Area(quantity("--wanted-area", text, AREAS, None)?));
    }
    if let Some(list) = &arguments.volumes {
        let volumes: Result<Vec<f64>, Failure> =
            list.split(',').map(|v| quantity("--volumes", v, VOLUMES, Some(1e-6))).collect();
        return Ok(Question::Volumes(volumes?));
    }
    // An implant with a volume of its own is not filled as the others are.
    let fill = said.fill.as_ref().or(arguments.fill.as_ref().filter(|_| said.volume.is_none()));
    fill.map_or(Ok(Question::Volume), |text| Ok(Question::Fill(schedule(text)?)))
}

fn limit(ratio: f64) -> Result<(), Failure> {
    if ratio > 1.0 && ratio.is_finite() {
        return Ok(());
    }
    Err(Failure::usage(format!("--stretch-limit: {ratio} is no stretch"), "give a ratio above 1, as in 1.5"))
}

type Found = (Vec<(Ready, Inserted)>, Vec<Point>);

/// Brings all to rest: each implant, or the one of a wanted area, or of each of several volumes.
fn settle(ready: Vec<Ready>, questions: &[Question], stop: &AtomicBool) -> Result<Found, SkinError> {
    let mut curve = Vec::new();
    let mut implants = Vec::new();
    for (k, (ready, question)) in ready.into_iter().zip(questions).enumerate() {
        let mut watch = |p: &Progress| {
            if p.rounds.is_multiple_of(SAY_EVERY) {
                warn(&format!("implant {}: round {}, moved {:.3} mm", k + 1, p.rounds, p.moved * 1e3));
            }
            !stop.load(Ordering::Relaxed)
        };
        let (days, mut all): (Vec<f64>, Vec<Inserted>) = match question {
            Question::Volume => (Vec::new(), vec![ready.insert(ready.order.implant.volume, &mut watch)?]),
            Question::Area(wanted) => (Vec::new(), vec![ready.seek(*wanted, &mut watch)?]),
            Question::Volumes(volumes) => (Vec::new(), ready.curve(volumes, &mut watch)?),
            Question::Fill(schedule) => {
                (schedule.fillings().iter().map(|f| f.day).collect(), ready.fill(schedule, &mut watch)?)
            }
        };
        if matches!(question, Question::Volumes(_) | Question::Fill(_)) {
            curve.extend(all.iter().enumerate().map(|(i, done)| Point {
                implant: k + 1,
                day: days.get(i).copied(),
                volume: done.implant_volume,
                areas: done.areas,
                progress: done.progress,
            }));
        }
        if let Some(last) = all.pop() {
            implants.push((ready, last));
        }
    }
    Ok((implants, curve))
}
