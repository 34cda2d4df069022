//! `pliant springs`: simulation of a mass-spring system to rest.

mod file;
mod memory;
mod nearing;
mod pictures;
mod speed;
mod sweep;
mod text;
mod written;

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::failure::Failure;
use super::options::{Output, PrintScene};
use super::progress::{Bar, if_raised};
use super::run::stop_on_interrupt;
use super::{DONE, note};
use crate::report::folder::Folder;
use crate::report::output::RunOutput;
use crate::report::springs::Summary;
use nearing::Nearing;
use pliant::scene::{Content, PRECISIONS};
use pliant::simulation::{self, Ended, Observer, Scenario, SpringsRun};
use pliant::springs::format::SpringFile;
use pliant::springs::integrators::INTEGRATORS;
use pliant::springs::lattice::{DEVICES, GPU_METHODS};
use pliant::springs::{Neighbours, RestEnd};
use written::Record;

/// Default greatest number of steps; and the number without damping, which only shows oscillations.
const STEPS: u32 = 10_000;
const UNDAMPED_STEPS: u32 = 1000;

/// The reason why there is no rest without damping.
const NEVER: &str =
    "without damping it never comes to rest: give --damping, or leave it out for the estimate";

/// Run a mass-spring system to rest: one from a file, or a lattice
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant springs examples/lattice-5x5x5.springs
  pliant springs examples/lattice-5x5x5.springs --mass 8 --damping 9 --dt 0.01 --every 50
  pliant springs --lattice 10x10x10 --neighbours 26
  pliant springs --lattice 5x5x5 --integrator implicit --dt 0.5 --json > rest.json
  pliant springs --lattice 100x100x100 --device gpu --method single
  pliant springs --sweep damping=1..15 --sweep mass=8,4,2,1,0.5,0.25,0.125
  pliant springs --speed 10,20,50,100
  pliant springs --lattice 5x5x5 --print-scene > rest.toml

A file holds points, surface triangles, springs with stiffness, fibres and attachment areas as text; docs/springs.md has the
format. Its springs are at rest as loaded, so the system is disturbed first: points of the surface are moved towards the
centre by --shrink and held there, the others follow. A lattice has stiffness 1/L [N/m] for springs of length L [m]. The
damping is, if not given, the thesis's estimate; the step half of the longest stable one, which is computed before the first
step: a longer one is refused. Numbers of files have no units and are read as m, kg, s.

The options of --lattice make a scene, which the command runs. --print-scene prints it; `pliant run`, `plan`, `study` and `view`
take it as a file.

Results in pliant-out/NAME-springs: start.vtp, end.vtp and pictures of them (with --every frames/*.vtp and NAME.pvd),
measures.csv, summary.json, report.html; of a file also end.springs, the end state with its fibres and areas. Exit codes: 0 at rest; 1 not at rest within the steps, or a step failed; 2 bad usage or input;
130 or 143 interrupted.")]
pub(super) struct Arguments {
    /// A file of a spring system
    #[arg(conflicts_with_all = ["lattice", "print_scene"])]
    file: Option<PathBuf>,
    /// A lattice of points instead of a file, such as 50x50x50
    #[arg(long, value_name = "NxNxN", value_parser = text::sides)]
    lattice: Option<[usize; 3]>,
    /// Number of neighbours of each point of a lattice: 6, 18 or 26 [default: 6]
    #[arg(long, value_name = "N", conflicts_with = "file", value_parser = neighbours)]
    neighbours: Option<Neighbours>,
    /// Longest side of a lattice [m] [default: 1]
    #[arg(long, value_name = "LENGTH", conflicts_with = "file", allow_negative_numbers = true, value_parser = positive)]
    side: Option<f64>,
    /// Mass of each point [kg]
    #[arg(long, value_name = "M", default_value = "1", allow_negative_numbers = true, value_parser = positive)]
    mass: f64,
    /// Damping of each point: force over velocity [N s/m] [default: the estimate (7.2)]
    #[arg(long, value_name = "C", allow_negative_numbers = true, value_parser = not_negative)]
    damping: Option<f64>,
    /// Time step [s] [default: half of the longest stable one]
    #[arg(long, value_name = "DT", allow_negative_numbers = true, value_parser = positive)]
    dt: Option<f64>,
    /// Integrator
    #[arg(long, value_name = "NAME", default_value = "verlet", value_parser = INTEGRATORS)]
    integrator: String,
    /// Precision of a lattice: f64, or f32 for steps of twice the speed that tell rest less finely [default: f64; f32 on a
    /// graphics card]
    #[arg(long, value_name = "F", value_parser = PRECISIONS)]
    precision: Option<String>,
    /// Device of a lattice: cpu, or gpu for a graphics card
    #[arg(long, value_name = "NAME", default_value = "cpu", value_parser = DEVICES)]
    device: String,
    /// Method on a graphics card: single is one pass, in point each point gathers its forces, in edge each spring stores
    /// its force [default: single]
    #[arg(long, value_name = "NAME", value_parser = GPU_METHODS)]
    method: Option<String>,
    /// Adaptive time step: it grows while it is stable; an unstable step is repeated with half the
    /// length
    #[arg(long)]
    adaptive: bool,
    /// Fixed points: those of the surface, or none
    #[arg(long, value_name = "WHICH", default_value = "surface", value_parser = ["surface", "none"])]
    pin: String,
    /// Displacement of the surface at the start, as a share of the distance to the centre
    #[arg(long, value_name = "SHARE", default_value = "0.02", allow_negative_numbers = true, value_parser = share)]
    shrink: f64,
    /// Tolerance of rest: largest force relative to the force at a strain of one; motion must be
    /// equally small
    #[arg(long, value_name = "SHARE", default_value = "1e-6", allow_negative_numbers = true, value_parser = tolerance)]
    tolerance: f64,
    /// Greatest number of steps [default: 10000; 1000 without damping]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    steps: Option<u32>,
    /// Also write a frame every N steps
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    every: Option<u32>,
    /// Run lattices with all of these values to rest, and find the best damping of each mass and size: damping=1..15,
    /// mass=8,4,2 or points=5,10; may be given several times. Steps are 0.01 s long if --dt is not given
    #[arg(long, value_name = "KEY=LIST", value_parser = sweep::varied, conflicts_with_all = ["file", "print_scene", "every", "damping"])]
    sweep: Vec<sweep::Varied>,
    /// Measure the time of a step of cubes with these numbers of points along a side, by each device and method
    #[arg(long, value_name = "SIZES", value_parser = speed::sizes, conflicts_with_all = ["file", "lattice", "print_scene", "every", "sweep", "steps"])]
    speed: Option<speed::Sizes>,
    #[command(flatten)]
    print: PrintScene,
    #[command(flatten)]
    output: Output,
}

fn neighbours(text: &str) -> Result<Neighbours, String> {
    let kind = text.parse().ok().and_then(Neighbours::of_count);
    kind.ok_or_else(|| "a point has 6, 18 or 26 neighbours".to_owned())
}

fn parsed(text: &str, fits: impl Fn(f64) -> bool, wanted: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|n: &f64| n.is_finite() && fits(*n))
        .ok_or_else(|| format!("expected {wanted}"))
}

fn positive(text: &str) -> Result<f64, String> {
    parsed(text, |n| n > 0.0, "a positive number")
}

fn not_negative(text: &str) -> Result<f64, String> {
    parsed(text, |n| n >= 0.0, "a number of at least 0")
}

fn share(text: &str) -> Result<f64, String> {
    parsed(
        text,
        |n| (-1.0..1.0).contains(&n),
        "a share from -1 to less than 1, such as 0.02",
    )
}

fn tolerance(text: &str) -> Result<f64, String> {
    parsed(
        text,
        |n| n > 0.0 && n < 1.0,
        "a share between 0 and 1, such as 1e-6",
    )
}

/// The command with its system, ready to run.
struct Prepared {
    run: SpringsRun,
    /// The file of the system, which its end state is written into.
    file: Option<SpringFile>,
    notes: Vec<String>,
    /// True for a system without damping, which does not come to rest.
    undamped: bool,
}

/// The greatest number of steps, and whether the system has no damping at all.
fn steps(arguments: &Arguments) -> (usize, bool) {
    // These two have numerical damping.
    let damps = ["bdf2", "implicit"].contains(&arguments.integrator.as_str());
    let undamped = !damps && arguments.damping == Some(0.0);
    let default = if undamped { UNDAMPED_STEPS } else { STEPS };
    (arguments.steps.unwrap_or(default) as usize, undamped)
}

/// The system of the options, or `None` after its scene is printed.
fn prepared(arguments: &Arguments) -> Result<Option<Prepared>, Failure> {
    let (frames, undamped) = steps(arguments);
    let (run, notes, file) = match (&arguments.file, arguments.lattice) {
        (Some(file), _) => {
            let (model, notes, content) = file::read(file, arguments.mass)?;
            let (damping, course) = text::course(arguments)?;
            let run = SpringsRun::new(model, damping, &course, frames, 1.0);
            (
                run.map_err(|error| text::refused(&error))?,
                notes,
                Some(content),
            )
        }
        (None, Some(points)) => {
            let made = text::scene(arguments, points, frames);
            let Content::Lattice(scene) = made.content()? else {
                return Err(Failure::usage("no lattice", "give --lattice 10x10x10"));
            };
            if arguments.print.is_given(made.text()) {
                return Ok(None);
            }
            memory::check(&scene)?;
            let run = SpringsRun::of_lattice(&scene);
            (run.map_err(|error| made.of_load(error))?, Vec::new(), None)
        }
        (None, None) => {
            let hint = "name a file, as examples/lattice-5x5x5.springs, or give --lattice 10x10x10";
            return Err(Failure::usage("nothing to run", hint));
        }
    };
    Ok(Some(Prepared {
        run,
        file,
        notes,
        undamped,
    }))
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    arguments.output.threads.start();
    if !arguments.sweep.is_empty() {
        return sweep::run(arguments);
    }
    if let Some(sizes) = &arguments.speed {
        return speed::run(arguments, sizes);
    }
    let begun = Instant::now();
    let stop = stop_on_interrupt("stopping after this step");
    let Some(prepared) = prepared(arguments)? else {
        return Ok(DONE);
    };
    let Prepared {
        mut run,
        file,
        mut notes,
        undamped,
    } = prepared;
    run.skip_to(arguments.every.map(|every| every as usize));
    let path = arguments.output.folder(&run.name, "springs");
    let mut record = Record::begin(Folder::open(&path)?, &run, arguments.every, file)?;
    if undamped {
        note(
            "note: without damping nothing comes to rest, it swings for ever; give --damping, or leave it out for the estimate",
        );
    }
    let mut watch = Watch {
        bar: Bar::of_steps(run.frames()),
        nearing: Nearing::new(run.frames(), run.rest),
        record: &mut record,
        begun,
        first_step_s: None,
    };
    let until_raised = |_: &str, _: usize, _: usize| if_raised(&stop);
    let ended = simulation::run(&mut run, &mut [&mut watch], &until_raised);
    let Watch {
        bar,
        nearing,
        first_step_s,
        ..
    } = watch;
    bar.end();
    let mut summary = Summary::of(&run);
    summary.first_step_s = first_step_s;
    let hint = (summary.end_of_run == RestEnd::Steps).then(|| {
        if undamped {
            NEVER.to_owned()
        } else {
            nearing.hint()
        }
    });
    notes.extend(hint.clone());
    record.check()?;
    let output = RunOutput {
        interrupted: ended == Ended::Interrupted,
        verdicts: summary.verdicts(hint),
        notes,
        ..record.output(&run, &summary, begun.elapsed().as_secs_f64())?
    };
    arguments.output.finish(record.folder(), output)
}

/// Records and shows the steps of a run.
struct Watch<'a> {
    record: &'a mut Record,
    bar: Bar,
    nearing: Nearing,
    begun: Instant,
    first_step_s: Option<f64>,
}

impl Observer<SpringsRun> for Watch<'_> {
    fn start(&mut self, _: &SpringsRun) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn frame(&mut self, run: &SpringsRun, _: Duration) -> ControlFlow<()> {
        self.first_step_s
            .get_or_insert_with(|| self.begun.elapsed().as_secs_f64());
        self.record.step(run);
        self.bar.step(&run.last);
        self.nearing.step(&run.last);
        ControlFlow::Continue(())
    }
}
