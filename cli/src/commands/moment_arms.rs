//! `pliant moment-arms`: fibres of muscles during the rotation of a joint, or over poses of a model.

mod poses;

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use nalgebra::{Unit, Vector3};

use super::environment;
use super::failure::Failure;
use super::options::Output;
use super::progress::Stoppable;
use super::run::stop_on_interrupt;
use crate::report::folder::{Folder, FolderError};
use crate::report::moment_arms::{self as files, OpenSimNames, Swept};
use pliant::fibres::harmonic::HarmonicOptions;
use pliant::format::number;
use pliant::io::pvd::Collection;
use pliant::moment_arms::{
    Arms, CrossingMuscle, MuscleStepper, NO_JOINT, ReferenceError, Sweep, SweepError, SweepRun,
    Table, joints,
};
use pliant::scene::units::{Dimension, parse};
use pliant::scene::{Content, Scene};
use pliant::simulation::{self, Observer, Scenario};
use pliant_render::Frame;

/// Greatest number of fibre points of a muscle: each stores a number per vertex.
const MOST_POINTS: u64 = 20_000;

/// Compute lengths and moment arms of a muscle's fibres during the rotation of a joint
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant moment-arms hip --joint hip --from=-10deg --to 60deg
  pliant moment-arms examples/right-hip-muscles.toml --joint hip --compare literature_Blemker2005_envelopes.csv
  pliant moment-arms examples/right-hip-muscles.toml --joint hip --axis 0,0,1 --coordinate hip_adduction --to 20deg
  pliant moment-arms right-hip.toml --joint hip --opensim /jointset/hip_r/hip_flexion_r --forces 'gluteus maximus=glmax2_r'
  pliant moment-arms leg.toml --osim model.osim --coordinate hip_flexion_r=hip,hip_adduction_r=hip \
      --range hip_flexion_r=-10deg:60deg,hip_adduction_r=-20deg:20deg --forces 'gluteus maximus=glmax1_r+glmax2_r+glmax3_r' --splice

A moment arm is -dL/dq, of a fibre's length L over the joint's angle q: positive where pulling turns the joint towards greater
angles. Angle 0 is where the meshes are. A joint is a bone's motion with centre and axis; `joint = \"hip\"` there gives it a
name. A table to compare with has a column for the angle and one for each curve, named after the muscle and ending in its
unit (psoas_r_moment_arm_m), or rows muscle,coordinate,bound,angle_deg,moment_arm_cm; several curves of a muscle are an
envelope.

Results in pliant-out/NAME-moment-arms: moment_arms.csv (each muscle over the angle), fibres.csv (each fibre), a plot of each
muscle as .svg, fibres.pvd (open in ParaView; time is the angle in degrees), pictures, summary.json, report.html. With --opensim also
a set of paths that OpenSim 4.5 and later loads (ModOpReplacePathsWithFunctionBasedPaths) and tables of lengths, moment arms and angles
(.sto). Exit codes: 0 done; 1 a muscle was stopped;
2 bad usage or input; 130 or 143 interrupted.")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene
    #[arg(default_value = "hip")]
    scene: String,
    /// Name of the joint, or of the bone that rotates about it [default: the only joint of the scene]
    #[arg(long, value_name = "NAME")]
    joint: Option<String>,
    /// First angle, such as -10deg
    #[arg(
        long,
        value_name = "ANGLE",
        default_value = "-10deg",
        allow_hyphen_values = true
    )]
    from: String,
    /// Last angle
    #[arg(
        long,
        value_name = "ANGLE",
        default_value = "60deg",
        allow_hyphen_values = true
    )]
    to: String,
    /// Increment of the angle
    #[arg(
        long,
        value_name = "ANGLE",
        default_value = "1deg",
        allow_hyphen_values = true
    )]
    step: String,
    /// Axis of rotation instead of the axis of the joint
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = axis)]
    axis: Option<Unit<Vector3<f64>>>,
    /// Number of fibres per muscle
    #[arg(long, value_name = "N", default_value = "100", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    count: u32,
    /// Number of points per fibre
    #[arg(long, value_name = "N", default_value = "15", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    points: u32,
    /// What moves the muscles: the rotation spread over each muscle and corrected for bones and
    /// volume, or the scene's solver
    #[arg(long, value_name = "WHAT", default_value = "spread")]
    stepper: StepperName,
    /// Frames per increment of the angle, for the scene's solver
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
    /// Number of neighbouring values on each side for the cubic fit of the slope of the length; 0
    /// takes differences without a fit
    #[arg(long, value_name = "N", default_value = "4", value_parser = around)]
    smooth: usize,
    /// A table of moment arms for comparison; may be given several times
    #[arg(long, value_name = "FILE")]
    compare: Vec<PathBuf>,
    /// Name of the angle in tables [default: JOINT_flexion]; with --osim the coordinates, as
    /// NAME[=JOINT],..., with a joint of the scene where no model moves its bones
    #[arg(long, value_name = "NAME")]
    coordinate: Option<String>,
    #[command(flatten)]
    over: poses::OverPoses,
    /// Coordinate of a model of OpenSim, such as /jointset/hip_r/hip_flexion_r: also write paths for it
    #[arg(long, value_name = "PATH", value_parser = coordinate_path)]
    opensim: Option<String>,
    /// Forces of the model, as MUSCLE=FORCE,...; with --osim MUSCLE=FORCE+FORCE divides a muscle into
    /// bundles by the origins of its fibres [default: the names of the muscles]
    #[arg(long, value_name = "LIST", value_parser = forces)]
    forces: Option<Forces>,
    #[command(flatten)]
    output: Output,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum StepperName {
    Spread,
    Scene,
}

fn axis(text: &str) -> Result<Unit<Vector3<f64>>, String> {
    let parts: Vec<f64> = text
        .split(',')
        .map_while(|p| p.trim().parse().ok())
        .collect();
    let axis = match parts[..] {
        [x, y, z] if text.split(',').count() == 3 => Unit::try_new(Vector3::new(x, y, z), 0.0),
        _ => None,
    };
    axis.filter(|a| a.iter().all(|v| v.is_finite()))
        .ok_or_else(|| "expected three numbers, such as 0,0,1".to_owned())
}

/// Muscles of the scene with the forces of a model.
#[derive(Clone, Debug)]
struct Forces(Vec<(String, Vec<String>)>);

fn forces(text: &str) -> Result<Forces, String> {
    let pair = |part: &str| {
        let (muscle, force) = part.split_once('=')?;
        let (muscle, force) = (muscle.trim(), force.trim());
        // Names of muscles can have spaces, those of a model cannot.
        let is_path = |f: &&str| !f.is_empty() && !f.contains(char::is_whitespace);
        let forces: Vec<&str> = force.split('+').map(str::trim).collect();
        (forces.iter().all(is_path) && !muscle.is_empty()).then(|| {
            let forces = forces.into_iter().map(str::to_owned).collect();
            (muscle.to_owned(), forces)
        })
    };
    let all: Option<Vec<_>> = text.split(',').map(pair).collect();
    all.map(Forces).ok_or_else(|| {
        "expected MUSCLE=FORCE, such as gluteus=glmax1_r,iliacus=iliacus_r".to_owned()
    })
}

fn coordinate_path(text: &str) -> Result<String, String> {
    let is_path = text.starts_with('/') && text.len() > 1 && !text.contains(char::is_whitespace);
    is_path.then(|| text.to_owned()).ok_or_else(|| {
        "expected an absolute path, such as /jointset/hip_r/hip_flexion_r".to_owned()
    })
}

fn around(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|n| *n == 0 || (2..=100).contains(n))
        .ok_or_else(|| "expected 0, or 2 to 100".to_owned())
}

fn angle(name: &str, text: &str) -> Result<f64, Failure> {
    parse(text, Dimension::Angle)
        .map_err(|error| Failure::usage(format!("--{name}: {error}"), error.help()))
}

impl From<SweepError> for Failure {
    fn from(error: SweepError) -> Self {
        let hint = match &error {
            SweepError::Load(_) => "",
            SweepError::Range(_) | SweepError::NoJoint { .. } => {
                "`pliant moment-arms --help` has examples"
            }
            SweepError::NothingCrosses(_) => {
                "attach a muscle to bones on both sides, or name another joint"
            }
            SweepError::NoModel => "add a section [opensim] to the scene",
            SweepError::Open(_) => "`pliant check` tells what is wrong with a mesh",
            SweepError::Areas { .. } => "change the attachments of the muscle in the scene",
            SweepError::Factor { .. } => "attach every piece of the muscle to a bone",
            SweepError::Fibres { .. } => {
                "change --count, or the attachments of the muscle in the scene"
            }
        };
        match error {
            SweepError::Load(error) => error.into(),
            error => Self::usage(error.to_string(), hint),
        }
    }
}

fn refused(error: ReferenceError) -> Failure {
    Failure::usage(
        error.to_string(),
        "`pliant moment-arms --help` tells what a table looks like",
    )
}

/// Writes the fibres at each value of the angle, and keeps pictures of some.
struct Written<'a> {
    folder: &'a Folder,
    /// The values that pictures show.
    shown: [usize; 3],
    /// Values that are written.
    done: usize,
    series: Collection,
    pictures: Vec<(String, Frame)>,
    /// The error that prevented a file from being written.
    failed: Option<FolderError>,
}

impl Observer<SweepRun> for Written<'_> {
    fn frame(&mut self, running: &SweepRun, _: Duration) -> ControlFlow<()> {
        if running.done() == self.done {
            return ControlFlow::Continue(());
        }
        let k = running.done() - 1;
        let angle = running.angles[k].to_degrees();
        self.write(running, (k, angle), format!("at {} degrees", number(angle)))
    }
}

impl Written<'_> {
    /// Writes value `k`, whose time in the series is `time`.
    fn write(
        &mut self,
        running: &SweepRun,
        (k, time): (usize, f64),
        title: String,
    ) -> ControlFlow<()> {
        self.done = k + 1;
        if let Err(error) = files::write_fibres(self.folder, running, (k, time), &mut self.series) {
            self.failed = Some(error);
            return ControlFlow::Break(());
        }
        if self.shown.contains(&k) {
            self.pictures.push((title, files::picture(running)));
        }
        ControlFlow::Continue(())
    }
}

/// Rejects forces of unknown muscles, and a force of two muscles.
fn names_of_forces(names: &OpenSimNames, muscles: &[CrossingMuscle]) -> Result<(), Failure> {
    let is_known = |name: &str| muscles.iter().any(|m| m.name == name);
    if let Some((name, _)) = names.forces.iter().find(|(name, _)| !is_known(name)) {
        let known: Vec<&str> = muscles.iter().map(|m| m.name.as_str()).collect();
        return Err(Failure::usage(
            format!("--forces: no muscle `{name}` crosses the joint"),
            format!("the muscles are {}", known.join(", ")),
        ));
    }
    if let Some(force) = names.shared(muscles.iter().map(|m| m.name.as_str())) {
        return Err(Failure::usage(
            format!("two muscles have the force {force}"),
            "give each its own with --forces",
        ));
    }
    Ok(())
}

/// The sweep that is described.
fn sweep(arguments: &Arguments) -> Result<Sweep, Failure> {
    if u64::from(arguments.count) * u64::from(arguments.points) > MOST_POINTS {
        let message = format!(
            "{} fibres of {} points are too many to carry",
            arguments.count, arguments.points
        );
        return Err(Failure::usage(
            message,
            format!("give --count and --points whose product is at most {MOST_POINTS}"),
        ));
    }
    Ok(Sweep {
        joint: arguments.joint.clone().unwrap_or_default(),
        axis: arguments.axis,
        from: angle("from", &arguments.from)?,
        to: angle("to", &arguments.to)?,
        step: angle("step", &arguments.step)?,
        frames: arguments.frames,
        fibres: HarmonicOptions {
            count: arguments.count as usize,
            points: arguments.points as usize,
        },
        by: if arguments.stepper == StepperName::Spread {
            MuscleStepper::Spread
        } else {
            MuscleStepper::Scene
        },
    })
}

/// The joint that nobody has to name.
fn only_joint(scene: &Scene) -> Result<String, Failure> {
    match joints(scene)[..] {
        [] if scene.opensim.is_some() => Err(Failure::usage(
            "a model of OpenSim moves the bones, and the scene has no joint of its own",
            "give --osim MODEL --coordinate NAME",
        )),
        [] => Err(Failure::usage(
            NO_JOINT,
            "name a scene with a joint; `pliant init` finds one between two bones",
        )),
        [one] => Ok(one.to_owned()),
        ref several => Err(Failure::usage(
            format!("the scene has several joints: {}", several.join(", ")),
            format!("name one, for example --joint '{}'", several[0]),
        )),
    }
}

/// Rejects fewer values of the angle than the smoothing of the curve needs.
fn check_smooth(values: usize, smooth: usize) -> Result<(), Failure> {
    let needed = 2 * smooth + 1;
    if values >= needed {
        return Ok(());
    }
    Err(Failure::usage(
        format!("{values} values of the angle are too few to smooth over"),
        format!("--smooth {smooth} needs {needed}, or give --smooth 0"),
    ))
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    if let Some(osim) = &arguments.over.osim {
        return poses::run(arguments, osim);
    }
    if arguments.forces.is_some() && arguments.opensim.is_none() {
        let hint = "give --osim MODEL or --opensim COORDINATE";
        return Err(Failure::usage(
            "--forces are those of a model of OpenSim",
            hint,
        ));
    }
    let begun = Instant::now();
    let mut sweep = sweep(arguments)?;
    check_smooth(sweep.angles()?.len(), arguments.smooth)?;
    let tables = arguments
        .compare
        .iter()
        .map(|path| Table::read(path))
        .collect::<Result<Vec<_>, _>>();
    let tables = tables.map_err(refused)?;
    let Content::Muscles(scene) = environment::load_content(&arguments.scene, &arguments.set)?
    else {
        let hint = "name a scene of muscles and bones; `pliant scenes` lists the built-in ones";
        return Err(Failure::usage(
            "moment arms are those of muscles, and this scene has none",
            hint,
        ));
    };
    if arguments.joint.is_none() {
        sweep.joint = only_joint(&scene)?;
    }
    arguments.output.threads.start();
    let stop = stop_on_interrupt("stopping after this angle");
    let name = scene.name.clone();
    let out = arguments.output.folder(&name, "moment-arms");
    let mut running = SweepRun::new(*scene, &sweep)?;
    let opensim = arguments.opensim.clone().map(|coordinate| OpenSimNames {
        coordinate,
        forces: arguments
            .forces
            .clone()
            .map_or(Vec::new(), |forces| forces.0),
    });
    if let Some(names) = &opensim {
        names_of_forces(names, &running.muscles)?;
        if names.forces.iter().any(|(_, forces)| forces.len() > 1) {
            let hint = "give --osim and --coordinate for bundles";
            return Err(Failure::usage(
                "--forces: one force for each muscle of a sweep",
                hint,
            ));
        }
    }
    let folder = Folder::open(&out)?;
    let values = running.angles.len();
    let mut written = Written {
        folder: &folder,
        shown: [0, values / 2, values - 1],
        done: 0,
        series: Collection::new(),
        pictures: Vec::new(),
        failed: None,
    };
    let progress = Stoppable::new(running.frames(), &stop);
    simulation::run(&mut running, &mut [&mut written], &progress);
    progress.bar.end();
    if let Some(error) = written.failed {
        return Err(error.into());
    }
    let (series, pictures) = (written.series, written.pictures);
    let coordinate = arguments
        .coordinate
        .clone()
        .unwrap_or_else(|| format!("{}_flexion", sweep.joint));
    let mut arms: Vec<Arms> = running
        .muscles
        .iter()
        .map(|m| Arms::new(m, &running, arguments.smooth))
        .collect();
    arms.iter_mut()
        .try_for_each(|a| a.compare(&tables, &coordinate))
        .map_err(refused)?;
    let swept = Swept {
        scene: name,
        joint: sweep.joint.clone(),
        coordinate,
        by: sweep.by,
        time_s: begun.elapsed().as_secs_f64(),
        interrupted: running.done() < running.angles.len() && stop.load(Ordering::Relaxed),
        opensim,
    };
    let output =
        files::output(&swept, &running, &arms, series, &pictures).map_err(FolderError::from)?;
    arguments.output.finish(&folder, output)
}
