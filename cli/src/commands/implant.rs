//! `pliant implant`: skin over implants, for planning.

mod orders;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::failure::Failure;
use super::options::Output;
use super::progress::if_raised;
use super::run::stop_on_interrupt;
use super::{INTERRUPTED, length_unit, warn};
use crate::report::folder::{Folder, FolderError};
use crate::report::implant::{Insertion, Point};
use orders::{Question, Said, hint, limit, order, question, refused};
use pliant::io;
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::max_or_nan;
use pliant::simulation::LoadError;
use pliant::skin::{
    Group, ImplantSpec, Inserted, PreparedPatch, SettleProgress, SkinError, grouped, halved_near,
};

/// Number of rounds between two lines of progress.
const SAY_EVERY: u32 = 10;

/// Greatest size of a small implant relative to the skin, and number of triangles per original one
/// after much refinement: both together suggest a wrong unit.
const SMALL: f64 = 0.01;
const REFINED: usize = 10;

/// Simulate skin over implants: areas before, deformed, retracted and grown; the volume for a
/// target area
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
curve.svg with --volumes and --fill. What was checked is in `verdicts` of summary.json: that skin and implant are at rest, for
each volume of a curve. Skin stretched beyond --stretch-limit is no failed check but a finding (`findings`,
`area_over_limit_m2`).

\"Volume difference\": the volume between the region before and the region over the implant, closed at its rim. It is more than
the implant's, by the gap beside it that taut skin spans.

Obstacles are meshes of bones and the like, in the unit of the skin, under it: at least one must lie under the implant, within
two bases below the skin. Implant and skin come to lie over them. Without any, the implant lies on what was under the skin
before, which does not give way.

Exit codes: 0 all is at rest; 1 a skin or implant did not come to rest, or files could not be written; 2 bad usage or input, or a
folder that cannot be written to, before anything is computed; 130 after Ctrl-C, with what was at rest by then written.")]
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
    #[arg(long, value_name = "LIST", conflicts_with_all = ["volumes", "wanted_area", "volume"], allow_hyphen_values = true)]
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
    #[command(flatten)]
    output: Output,
}

fn vertex(text: &str) -> Result<usize, String> {
    text.parse()
        .map_err(|_| "vertices count from 0: give a whole number of at least 0".to_owned())
}

fn read(path: &std::path::Path, unit: f64) -> Result<TriangleMesh, Failure> {
    let mut mesh = io::read(path)
        .map_err(|e| Failure::of_meshes(LoadError::from(Box::new(e))))?
        .mesh;
    mesh.vertices.iter_mut().for_each(|v| v.coords *= unit);
    if mesh.triangles.is_empty() {
        return Err(Failure::usage(
            format!("{} has no triangles", path.display()),
            SkinError::Empty.help(),
        ));
    }
    Ok(mesh)
}

/// Prints the size of the skin and of its implants: it reveals a wrong unit.
fn say_sizes(extent: f64, orders: &[ImplantSpec]) {
    let bases: Vec<String> = orders
        .iter()
        .map(|o| format!("{:.1} cm", o.implant.base * 1e2))
        .collect();
    let (size, unit) = if extent >= 1.0 {
        (extent, "m")
    } else {
        (extent * 1e2, "cm")
    };
    warn(&format!(
        "skin {size:.1} {unit} across, base {}",
        bases.join(", ")
    ));
}

/// Warns if an implant is small relative to the skin and needed much refinement.
fn warn_of_small(extent: f64, skin: &TriangleMesh, groups: &[Group]) {
    for (ready, members) in groups {
        let (share, taken) = (
            ready.order.implant.base / extent,
            skin.triangles.len() - ready.outside.len(),
        );
        if share < SMALL && ready.patch.triangles.len() > REFINED * taken {
            warn(&format!(
                "note: the base of implant {} is {:.2} % of the skin's extent, and {taken} triangles of the skin became {}: are \
                 --unit and --base right?",
                members[0] + 1,
                share * 1e2,
                ready.patch.triangles.len()
            ));
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    arguments.output.threads.start();
    let stop = stop_on_interrupt(
        "stopping; volumes and implants that are at rest already will be written",
    );
    let unit = length_unit(&arguments.unit)?;
    let said: Result<Vec<Said>, Failure> = arguments
        .implant
        .iter()
        .map(|text| Said::of(text))
        .collect();
    let mut said = said?;
    if said.is_empty() {
        said.push(Said::default());
    }
    let orders: Result<Vec<ImplantSpec>, Failure> =
        said.iter().map(|s| order(arguments, s, unit)).collect();
    let orders = orders?;
    let questions: Result<Vec<Question>, Failure> =
        said.iter().map(|s| question(arguments, s)).collect();
    let questions = questions?;
    for (k, (question, order)) in questions.iter().zip(&orders).enumerate() {
        question
            .check(order)
            .map_err(|error| refused_of(k, orders.len(), &error))?;
    }
    limit(arguments.stretch_limit)?;
    let stem = arguments
        .skin
        .file_stem()
        .map_or("skin".into(), |s| s.to_string_lossy().into_owned());
    let out = arguments.output.folder(&stem, "implant");
    Folder::check(
        &out,
        &Insertion::files(orders.len(), questions.iter().any(Question::is_curve)),
    )?;
    let skin = read(&arguments.skin, unit)?;
    let obstacles: Result<Vec<TriangleMesh>, Failure> = arguments
        .obstacle
        .iter()
        .map(|path| read(path, unit))
        .collect();
    let obstacles = obstacles?;
    let extent = max_or_nan(skin.bounding_box().extents().iter().copied());
    say_sizes(extent, &orders);
    let skin = halved_near(skin, &orders);
    let groups = match grouped(
        &skin,
        &orders,
        |_| obstacles.clone(),
        &|_: &str, _: usize, _: usize| if_raised(&stop),
    ) {
        Err((_, SkinError::Stopped)) => return Ok(nothing_written()),
        other => other.map_err(|(k, error)| refused_of(k, orders.len(), &error))?,
    };
    warn_of_small(extent, &skin, &groups);
    let found = settle(groups, &questions, &stop).map_err(|e| refused(&e))?;
    if found.implants.is_empty() {
        return Ok(nothing_written());
    }
    let insertion = Insertion {
        name: stem,
        skin: &skin,
        implants: found.implants,
        numbers: found.numbers,
        obstacles: &obstacles,
        curve: found.curve,
        limit: arguments.stretch_limit,
        interrupted: found.interrupted,
        wanted: questions.iter().find_map(|q| {
            if let Question::Area(wanted) = q {
                Some(*wanted)
            } else {
                None
            }
        }),
        time: begun.elapsed().as_secs_f64(),
        under: "implant",
    };
    let output = insertion.output().map_err(FolderError::from)?;
    arguments.output.finish(&Folder::open(&out)?, output)
}

/// The rejection of one of several implants, with its index.
fn refused_of(k: usize, of: usize, error: &SkinError) -> Failure {
    if of == 1 {
        refused(error)
    } else {
        Failure::usage(format!("implant {}: {error}", k + 1), hint(error))
    }
}

/// After Ctrl-C, before any equilibrium.
fn nothing_written() -> u8 {
    warn("interrupted before any implant was at rest: nothing is written");
    INTERRUPTED
}

/// Equilibria.
#[derive(Default)]
struct Found {
    implants: Vec<(PreparedPatch, Inserted)>,
    numbers: Vec<Vec<usize>>,
    curve: Vec<Point>,
    interrupted: bool,
}

/// Computes all equilibria: groups of implants that share skin, or the one with the requested area,
/// or those of several volumes. After Ctrl-C returns the present results.
fn settle(
    groups: Vec<Group>,
    questions: &[Question],
    stop: &AtomicBool,
) -> Result<Found, SkinError> {
    let mut found = Found::default();
    for (ready, members) in groups {
        let names: Vec<String> = members.iter().map(|k| (k + 1).to_string()).collect();
        let name = format!(
            "implant{} {}",
            if names.len() == 1 { "" } else { "s" },
            names.join(" and ")
        );
        let mut watch = |p: &SettleProgress| {
            if p.rounds.is_multiple_of(SAY_EVERY) {
                warn(&format!(
                    "{name}: round {}, moved {:.3} mm",
                    p.rounds,
                    p.moved * 1e3
                ));
            }
            !stop.load(Ordering::Relaxed)
        };
        let mut last: Option<Inserted> = None;
        let keep = |result: Result<Inserted, SkinError>| match result {
            Err(SkinError::Stopped) => Ok(None),
            other => other.map(Some),
        };
        let own: Vec<&Question> = members.iter().map(|k| &questions[*k]).collect();
        if let [Question::Area(wanted)] = own[..] {
            last = keep(ready.solve_for_area(*wanted, &mut watch))?;
            found.interrupted = last.is_none();
        }
        for (volumes, day) in steps(&own, &ready) {
            let Some(done) = keep(ready.insert_after(last.as_ref(), &volumes, &mut watch))? else {
                found.interrupted = true;
                break;
            };
            if own.iter().any(|question| question.is_curve()) {
                let (volume, areas, progress) = (done.volume(), done.areas, done.progress);
                found.curve.push(Point {
                    implant: members[0] + 1,
                    day,
                    volume,
                    areas,
                    progress,
                });
                let rest = if progress.converged {
                    "is at rest"
                } else {
                    "is NOT at rest"
                };
                warn(&format!("{name}: {:.1} cc {rest}", volume * 1e6));
            }
            last = Some(done);
        }
        if let Some(done) = last.as_mut().filter(|_| !found.interrupted) {
            ready.compare(done, &mut watch);
        }
        found.numbers.extend(last.is_some().then_some(members));
        found.implants.extend(last.map(|done| (ready, done)));
        if found.interrupted {
            break;
        }
    }
    Ok(found)
}

/// Volumes of the implants of a group that are known in advance [m^3], in order, with the day of
/// each. Implants with other filling days keep their volume; before its first filling an implant is
/// as flat as permitted.
fn steps(questions: &[&Question], ready: &PreparedPatch) -> Vec<(Vec<f64>, Option<f64>)> {
    if let [one] = questions {
        return one
            .volumes(&ready.order)
            .into_iter()
            .map(|(volume, day)| (vec![volume], day))
            .collect();
    }
    let schedules = questions.iter().filter_map(|q| {
        if let Question::Fill(schedule) = q {
            Some(schedule)
        } else {
            None
        }
    });
    let mut days: Vec<f64> = schedules
        .flat_map(|schedule| schedule.fillings())
        .map(|filling| filling.day)
        .collect();
    days.sort_by(f64::total_cmp);
    days.dedup();
    let at = |day: f64| {
        let each = ready
            .sites()
            .zip(questions)
            .map(|((order, _), question)| match question {
                Question::Fill(schedule) => schedule
                    .volume(day)
                    .max(order.implant.least(ready.layers.edge)),
                _ => order.implant.volume,
            });
        each.collect()
    };
    if days.is_empty() {
        return vec![(ready.volumes(), None)];
    }
    days.into_iter().map(|day| (at(day), Some(day))).collect()
}
