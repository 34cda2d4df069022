//! `pliant run`: runs a scene to its last frame and writes its files.

mod staged;

pub(super) use staged::Job;

use std::cell::Cell;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::ValueEnum;

use super::failure::Failure;
use super::from_meshes::{self, Meshes};
use super::options::Output;
use super::progress::{Bar, if_raised};
use super::{BY_CTRL_C, BY_SIGTERM, INTERRUPTED, environment, interrupted, resume, warn};
use crate::report::folder::Folder;
use crate::report::frames::{FIELDS, Stored};
use crate::report::plan::bytes_of_run;
use crate::report::results::Results;
use crate::report::run::{FILES, Finished};
use pliant::format::number;
use pliant::scene::{Content, Scene};
use pliant::simulation::checkpoint::Fingerprint;
use pliant::simulation::{self, Assets, Observer, Plan, Simulation};

/// The default scene.
const FIRST_SCENE: &str = "hip";

/// Run a scene and write frames, measures, a summary and a report
#[derive(Debug, Default, clap::Args)]
#[command(after_help = "\
Examples:
  pliant run hip
  pliant run hip --accuracy \"1 %\"
  pliant run hip --frames 50 --set effects.contact=off --out without-contact
  pliant run examples/right-hip.toml --json > summary.json
  pliant run hip --checkpoint-every 50
  pliant run hip --resume
  pliant run flat-implant --set implant.volume=50cc
  pliant run leg.toml --motion walk.mot
  pliant run --muscles psoas.obj --bones femur.obj pelvis.obj --fibre-lines psoas.vtk --unit mm --animate gif

Results: report.html, NAME.vtm.series (open in ParaView), NAME.pvd, frames/*.vtp, measures.csv, times.csv, summary.json; NAME.gif with
--animate, scene.toml with --muscles, checkpoint.pliant with --checkpoint-every. Without --resume a run removes the
results of an earlier one from its folder, its checkpoint too. Exit code 1: a check failed (not with --lenient), a muscle
was stopped (it diverged, or a number was not finite), skin did not come to rest, or files could not be written.")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene [default: hip]
    #[arg(conflicts_with_all = ["muscles", "bones", "fibre_lines", "unit"])]
    scene: Option<String>,
    #[command(flatten)]
    output: Output,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
    /// Number of frames, instead of the number in the scene
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    frames: Option<u32>,
    /// Permitted error, "0.5 mm", "1 %" of the muscle's length or "1 % of motion": the number of steps
    /// follows the error of each frame, which a second run beside it tells
    #[arg(long, value_name = "ERROR")]
    accuracy: Option<String>,
    /// Motion from a file of OpenSim (.mot, .sto), for a scene with a section [opensim]
    #[arg(long, value_name = "FILE")]
    motion: Option<PathBuf>,
    /// Also run the scene on triangles a quarter as large, and state the error of the mesh: about eight times as long
    #[arg(long)]
    mesh_error: bool,
    /// Gone: failed checks end with exit code 1
    #[arg(long, hide = true)]
    strict: bool,
    /// Also write NAME.gif, an animation of every fourth frame
    #[arg(long, value_name = "FORMAT")]
    animate: Option<Animation>,
    /// Write checkpoint.pliant into the folder of the results every N frames, at the end and on
    /// Ctrl-C
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    checkpoint_every: Option<u32>,
    /// Continue from the checkpoint in the folder of the results, with the results of an
    /// uninterrupted run; give the same scene and changes. --frames may be larger than before; the
    /// interval of checkpoints stays the same
    #[arg(long)]
    resume: bool,
    /// Numbers at the points of muscles in frames, some of displacement_m, edge_stretch, speed_m_s, attached; or none
    /// [default: all]
    #[arg(long, value_name = "NAME,...", conflicts_with = "resume", value_parser = fields)]
    fields: Option<FrameFields>,
    /// Frames with all digits of the computation, two to three times as large; without it, positions are Float32 and
    /// numbers at points have 13 bits. bones.csv has the poses of bones with all digits in either case
    #[arg(long, conflicts_with = "resume")]
    exact: bool,
    #[command(flatten)]
    meshes: Meshes,
}

/// Names of numbers at points.
#[derive(Clone, Debug)]
struct FrameFields(Vec<&'static str>);

/// Reads names of numbers at points.
fn fields(text: &str) -> Result<FrameFields, String> {
    if text == "none" {
        return Ok(FrameFields(Vec::new()));
    }
    let known = |name: &str| {
        let found = FIELDS.into_iter().find(|field| *field == name);
        found.ok_or_else(|| {
            format!(
                "no number is named `{name}`; there are {}, or none",
                FIELDS.join(", ")
            )
        })
    };
    let names = text.split(',').map(|name| known(name.trim()));
    let names = names.collect::<Result<Vec<_>, _>>()?;
    // In the order of the files, each once.
    let chosen = FIELDS.into_iter().filter(|field| names.contains(field));
    Ok(FrameFields(chosen.collect()))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Animation {
    Gif,
}

impl Arguments {
    /// Contents of the files of frames.
    fn stored(&self) -> Stored {
        let fields = self
            .fields
            .clone()
            .map_or(FIELDS.to_vec(), |FrameFields(names)| names);
        Stored {
            fields,
            exact: self.exact,
        }
    }

    /// The first frames of a scene in a file.
    pub(super) fn of_first_frames(scene: &Path, frames: u32, output: Output) -> Self {
        Self {
            scene: Some(scene.display().to_string()),
            frames: Some(frames),
            output,
            ..Self::default()
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    if arguments.strict {
        let message = "--strict is gone: a failed check ends with exit code 1";
        let hint = "leave it out; with --lenient failed checks end with exit code 0";
        return Err(Failure::usage(message, hint));
    }
    let begun = Instant::now();
    let stop = stop_on_interrupt("stopping");
    arguments.output.threads.start();
    let mut changes = arguments.set.clone();
    changes.extend(arguments.frames.map(|n| format!("frames={n}")));
    changes.extend(
        arguments
            .accuracy
            .as_ref()
            .map(|error| format!("accuracy={error}")),
    );
    if let Some(motion) = &arguments.motion {
        // A path of a scene starts in its folder, one of the command line where the command runs.
        let path = std::path::absolute(motion).unwrap_or_else(|_| motion.clone());
        changes.push(format!("opensim.motion={}", path.display()));
    }
    changes.extend(arguments.mesh_error.then(|| "mesh_error=true".to_owned()));
    if arguments.meshes.are_given() {
        let (scene, toml) = from_meshes::scene(&arguments.meshes, &changes)?;
        return of_muscles(arguments, scene, Some(toml), begun, &stop);
    }
    match environment::load_content(arguments.scene.as_deref().unwrap_or(FIRST_SCENE), &changes)? {
        Content::Muscles(scene) => of_muscles(arguments, *scene, None, begun, &stop),
        other => staged::run(arguments, &other, begun, &stop),
    }
}

/// Runs a scene of muscles; `written` is its text if it was generated.
fn of_muscles(
    arguments: &Arguments,
    scene: Scene,
    written: Option<String>,
    begun: Instant,
    stop: &AtomicBool,
) -> Result<u8, Failure> {
    let made = written.is_some();
    let refused = |error| {
        if made {
            Failure::of_meshes(error)
        } else {
            Failure::from(error)
        }
    };
    let out = arguments.output.folder(&scene.name, "");
    Folder::check(&out, &FILES.map(str::to_owned))?;
    let resumed = if arguments.resume {
        Some(resume::read(&out)?)
    } else {
        None
    };
    let assets = Assets::load(&scene).map_err(refused)?;
    let plan = Plan::new(&scene, &assets);
    if stop.load(Ordering::Relaxed) {
        return Ok(interrupted());
    }
    PREPARING.store(true, Ordering::Relaxed);
    let simulation = Simulation::with(scene, assets, plan);
    PREPARING.store(false, Ordering::Relaxed);
    let mut simulation = simulation.map_err(refused)?;
    if !arguments.output.printing.quiet && !arguments.resume {
        let megabytes = number(bytes_of_run(&simulation, &arguments.stored()) as f64 * 1e-6);
        let folder = out.display();
        warn(&format!(
            "{} frames, about {megabytes} MB, into {folder}",
            simulation.scene.frames
        ));
    }
    let animate = arguments.animate.is_some();
    let (mut results, every) = match resumed {
        Some(bytes) => resume::go_on(&out, &bytes, &mut simulation, animate, begun)?,
        None => (
            Results::begin(
                Folder::open(&out)?,
                &simulation,
                arguments.stored(),
                animate,
                begun,
            ),
            0,
        ),
    };
    if let Some(toml) = written {
        results.write("scene.toml", &toml)?;
    }
    let every = arguments.checkpoint_every.map_or(every, |n| n as usize);
    if every > 0 {
        results.keep_every(every, Fingerprint::of(&simulation));
    }
    let settings = settings(arguments);
    let finished = advance(&mut simulation, results, &settings, stop)?;
    arguments.output.finish(&finished.folder, finished.output)
}

/// Runs until the last frame, Ctrl-C, or until every muscle has stopped.
fn advance(
    simulation: &mut Simulation,
    results: Results,
    settings: &[(String, String)],
    stop: &AtomicBool,
) -> Result<Finished<'static>, Failure> {
    let bar = Bar::of_frames(simulation.scene.frames);
    let mut shown = Shown { results, bar: &bar };
    let frame = Cell::new(simulation.frame());
    let until_raised = |_: &str, done: usize, of: usize| {
        match of {
            0 => bar.waits(frame.get()),
            _ => frame.set(done),
        }
        if_raised(stop)
    };
    let ended = simulation::run(simulation, &mut [&mut shown], &until_raised);
    let Shown { mut results, .. } = shown;
    // The error of a failed writer is reported at the end.
    let _ = results.checkpoint(simulation, true);
    bar.end();
    Ok(results.finish(simulation, settings, &ended)?)
}

/// Collects results, and shows the measures of each frame in a bar.
struct Shown<'a> {
    results: Results,
    bar: &'a Bar,
}

impl Observer<Simulation> for Shown<'_> {
    fn start(&mut self, simulation: &Simulation) -> ControlFlow<()> {
        self.results.start(simulation)
    }

    fn frame(&mut self, simulation: &Simulation, took: Duration) -> ControlFlow<()> {
        let goes_on = Observer::frame(&mut self.results, simulation, took);
        self.bar
            .muscles(simulation.frame(), took, self.results.last());
        goes_on
    }
}

/// The options, for the report.
fn settings(arguments: &Arguments) -> Vec<(String, String)> {
    let scene = match arguments.meshes.are_given() {
        true => "scene.toml, made of the meshes named".to_owned(),
        false => arguments
            .scene
            .clone()
            .unwrap_or_else(|| FIRST_SCENE.to_owned()),
    };
    let mut all = vec![("scene".to_owned(), scene)];
    all.extend(
        arguments
            .set
            .iter()
            .map(|change| ("--set".to_owned(), change.clone())),
    );
    all.extend(
        arguments
            .frames
            .map(|n| ("--frames".to_owned(), n.to_string())),
    );
    let others = arguments
        .accuracy
        .iter()
        .map(|error| ("--accuracy".to_owned(), error.clone()));
    all.extend(others);
    all.extend(
        arguments
            .mesh_error
            .then(|| ("--mesh-error".to_owned(), "on".to_owned())),
    );
    all.extend(settings_of_all());
    all
}

/// The settings of every run, for the report.
pub(super) fn settings_of_all() -> [(String, String); 2] {
    let threads = rayon::current_num_threads().to_string();
    [
        ("threads".to_owned(), threads),
        ("pliant".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
    ]
}

/// True while a run has no frame yet that Ctrl-C could leave complete.
static PREPARING: AtomicBool = AtomicBool::new(false);

/// A flag that Ctrl-C or SIGTERM sets, with a message; a second one ends the process at once.
pub(super) fn stop_on_interrupt(what: &'static str) -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let raised = stop.clone();
    let end = move |code: u8| {
        INTERRUPTED.store(code, Ordering::Relaxed);
        if raised.swap(true, Ordering::Relaxed) || PREPARING.load(Ordering::Relaxed) {
            // Files appear only when complete, so only unfinished work is lost.
            std::process::exit(code.into());
        }
        warn(&format!("{what}; press Ctrl-C again to stop at once"));
    };
    let by_system = end.clone();
    let set = ctrlc::set_handler(move || end(BY_CTRL_C))
        .map_err(|error| error.to_string())
        .and_then(|()| on_sigterm(move || by_system(BY_SIGTERM)).map_err(|e| e.to_string()));
    if let Err(error) = set {
        warn(&format!(
            "note: Ctrl-C or SIGTERM will end the run without its last files: {error}"
        ));
    }
    stop
}

/// Calls `end` at each SIGTERM.
#[cfg(unix)]
fn on_sigterm(end: impl Fn() + Send + 'static) -> std::io::Result<()> {
    let mut signals = signal_hook::iterator::Signals::new([signal_hook::consts::SIGTERM])?;
    let wait = move || signals.forever().for_each(|_| end());
    std::thread::Builder::new()
        .name("sigterm".to_owned())
        .spawn(wait)?;
    Ok(())
}

/// Other systems have no SIGTERM.
#[cfg(not(unix))]
fn on_sigterm(_: impl Fn() + Send + 'static) -> std::io::Result<()> {
    Ok(())
}
