//! Moment arms over several coordinates of a model of OpenSim.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use nalgebra::Point3;

use super::super::environment;
use super::super::failure::Failure;
use super::super::progress::Stoppable;
use super::super::run::stop_on_interrupt;
use super::{Arguments, MOST_POINTS, Written, names_of_forces};
use crate::report::folder::{Folder, FolderError};
use crate::report::moment_arms::{self as files, OpenSimNames, Posed};
use pliant::fibres::harmonic::HarmonicOptions;
use pliant::io::pvd::Collection;
use pliant::moment_arms::{CrossingMuscle, PoseSet, SweepRun, bundles};
use pliant::opensim::{Model, ModelDrive, ModelError};
use pliant::scene::units::{Dimension, parse};
use pliant::scene::{Content, Scene};
use pliant::simulation::{self, Observer};

/// Seed of the samples: the same poses in every run.
const SEED: u64 = 1;

/// Coordinates of a model, with ranges of samples.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct OverPoses {
    /// Model of OpenSim 4: moment arms over the coordinates of `--coordinate`, and paths for it
    #[arg(long, value_name = "MODEL", requires = "coordinate", conflicts_with_all = ["opensim", "compare", "axis", "joint", "from", "to", "step", "stepper", "frames", "smooth"])]
    pub(super) osim: Option<PathBuf>,
    /// Ranges of coordinates, as NAME=FROM:TO,... such as hip_flexion_r=-10deg:60deg [default: the
    /// range in the model]
    #[arg(
        long,
        value_name = "LIST",
        requires = "osim",
        allow_hyphen_values = true
    )]
    range: Option<String>,
    /// Number of poses, in a Latin hypercube over the ranges
    #[arg(long, value_name = "N", requires = "osim", default_value = "100", value_parser = clap::value_parser!(u32).range(8..=1500))]
    samples: u32,
    /// Number of values of each coordinate, for a grid instead of a Latin hypercube
    #[arg(long, value_name = "N", requires = "osim", conflicts_with = "samples", value_parser = clap::value_parser!(u32).range(3..=1500))]
    grid: Option<u32>,
    /// Greatest order of a polynomial
    #[arg(long, value_name = "N", requires = "osim", default_value = "9", value_parser = clap::value_parser!(u32).range(2..=9))]
    order_up_to: u32,
    /// Also write the model with the paths in place of those of its forces
    #[arg(long, requires = "osim")]
    splice: bool,
    /// Also write the maximum isometric force, the optimal fibre length, the tendon slack length and
    /// the pennation of the fibres into that model
    #[arg(long, requires = "splice")]
    parameters: bool,
}

/// A coordinate of the model, and the joint of the scene that it turns.
struct Named {
    coordinate: usize,
    joint: Option<String>,
}

fn refused(error: &ModelError, option: &str) -> Failure {
    Failure::usage(
        format!("{option}: {}", error.to_string().trim_start_matches(": ")),
        error.help,
    )
}

/// The coordinates of `--coordinate`.
fn coordinates(text: &str, model: &Model) -> Result<Vec<Named>, Failure> {
    let mut all: Vec<Named> = Vec::new();
    for part in text.split(',').map(str::trim) {
        let (name, joint) = match part.split_once('=') {
            Some((name, joint)) => (name.trim(), Some(joint.trim().to_owned())),
            None => (part, None),
        };
        let coordinate = model
            .coordinate(name)
            .map_err(|e| refused(&e, "--coordinate"))?;
        if model.is_coupled(coordinate) {
            let message = format!("--coordinate: `{name}` is a function of another coordinate");
            return Err(Failure::usage(
                message,
                "name the coordinate that it depends on",
            ));
        }
        if all.iter().any(|n| n.coordinate == coordinate) {
            let message = format!("--coordinate: `{name}` is given twice");
            return Err(Failure::usage(message, "name each coordinate once"));
        }
        all.push(Named { coordinate, joint });
    }
    if all.len() > 6 {
        let hint = "paths of OpenSim have at most six; run twice for muscles of different joints";
        return Err(Failure::usage(
            "--coordinate: more than six coordinates",
            hint,
        ));
    }
    Ok(all)
}

/// The range of each coordinate \[rad or m\].
fn ranges(
    arguments: &OverPoses,
    model: &Model,
    named: &[Named],
) -> Result<Vec<(usize, [f64; 2])>, Failure> {
    let default = |n: &Named| (n.coordinate, model.coordinates[n.coordinate].range);
    let mut ranges: Vec<(usize, [f64; 2])> = named.iter().map(default).collect();
    let example = "write NAME=FROM:TO, such as hip_flexion_r=-10deg:60deg";
    let fail = |message: String| Failure::usage(format!("--range: {message}"), example);
    for part in arguments.range.iter().flat_map(|text| text.split(',')) {
        let pair = part.trim().split_once('=');
        let pair = pair.and_then(|(name, range)| Some((name, range.split_once(':')?)));
        let Some((name, (from, to))) = pair else {
            return Err(fail(format!("`{}` is no range", part.trim())));
        };
        let index = model
            .coordinate(name.trim())
            .map_err(|e| refused(&e, "--range"))?;
        let Some(range) = ranges.iter_mut().find(|(c, _)| *c == index) else {
            return Err(fail(format!(
                "`{}` is not among the coordinates",
                name.trim()
            )));
        };
        let dimension = match model.coordinates[index].is_angle {
            true => Dimension::Angle,
            false => Dimension::Length,
        };
        for (end, text) in range.1.iter_mut().zip([from, to]) {
            *end = parse(text.trim(), dimension).map_err(|e| fail(e.to_string()))?;
        }
    }
    for (index, [low, high]) in &ranges {
        let coordinate = &model.coordinates[*index];
        let wide = coordinate.is_angle && high - low > std::f64::consts::TAU;
        if !(low < high) || !low.is_finite() || !high.is_finite() || wide {
            let message = format!(
                "the range of `{}` is from {low} to {high} {}",
                coordinate.name,
                if coordinate.is_angle { "rad" } else { "m" }
            );
            return Err(Failure::usage(message, example));
        }
    }
    Ok(ranges)
}

/// The scene with a model that moves its bones: its own, or one about its joints.
fn driven(
    mut scene: Scene,
    model: Model,
    named: &[Named],
) -> Result<(Scene, Arc<ModelDrive>), Failure> {
    let with: Vec<&Named> = named.iter().filter(|n| n.joint.is_some()).collect();
    if let (Some(drive), true) = (&scene.opensim, with.is_empty()) {
        if drive.model != model {
            let message = "--osim: the model is not the one that moves the bones of the scene";
            let hint =
                "give the model of [opensim], or name joints of the scene: --coordinate NAME=JOINT";
            return Err(Failure::usage(message, hint));
        }
        let drive = drive.clone();
        return Ok((scene, drive));
    }
    if with.len() < named.len() {
        let message =
            "no model moves the bones of the scene, so that a coordinate needs a joint of it";
        let hint = "write --coordinate NAME=JOINT, or add a section [opensim] to the scene";
        return Err(Failure::usage(message, hint));
    }
    let joint = |n: &Named| {
        let name = n.joint.as_deref().unwrap_or_default();
        let found = pliant::moment_arms::joint_of(&scene, name)?;
        Ok((
            n.coordinate,
            (found.0.centre, found.0.axis.into_inner()),
            found.1,
        ))
    };
    let joints = named
        .iter()
        .map(joint)
        .collect::<Result<Vec<_>, pliant::moment_arms::SweepError>>()?;
    let drive = ModelDrive::about_joints(model, &joints, scene.up)
        .map_err(|e| refused(&e, "--coordinate"))?;
    let drive = Arc::new(drive);
    scene.opensim = Some(drive.clone());
    Ok((scene, drive))
}

/// Bundles of fibres of each muscle with their forces. Where the model has all forces of a muscle,
/// each goes to the nearest bundle.
fn bundled(
    muscles: &[CrossingMuscle],
    names: &OpenSimNames,
    drive: &ModelDrive,
) -> Vec<Vec<(String, Vec<usize>)>> {
    let of = |m: &CrossingMuscle| {
        let forces = names.of(&m.name);
        let mut left = bundles(&m.fibres, forces.len(), &drive.front_and_top());
        let mut found = Vec::new();
        for force in forces {
            if left.is_empty() {
                break;
            }
            let own = drive
                .model
                .muscles
                .iter()
                .find(|muscle| muscle.path == force);
            let origin = own.and_then(|muscle| drive.origin(muscle));
            let middle = |bundle: &Vec<usize>| {
                let sum: nalgebra::Vector3<f64> =
                    bundle.iter().map(|f| m.fibres[*f][0].coords).sum();
                Point3::from(sum / bundle.len() as f64)
            };
            let nearest = origin.and_then(|at| {
                let distances = left.iter().map(|b| (middle(b) - at).norm());
                let best = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
                best.map(|(k, _)| k)
            });
            found.push((force, left.remove(nearest.unwrap_or(0))));
        }
        found
    };
    muscles.iter().map(of).collect()
}

pub(super) fn run(arguments: &Arguments, osim: &std::path::Path) -> Result<u8, Failure> {
    let begun = Instant::now();
    let options = &arguments.over;
    let model = Model::read(osim).map_err(|e| Failure::usage(e.to_string(), e.help))?;
    let named = coordinates(arguments.coordinate.as_deref().unwrap_or_default(), &model)?;
    let ranges = ranges(options, &model, &named)?;
    let Content::Muscles(scene) = environment::load_content(&arguments.scene, &arguments.set)?
    else {
        let hint = "name a scene of muscles and bones; `pliant scenes` lists the built-in ones";
        return Err(Failure::usage(
            "moment arms are those of muscles, and this scene has none",
            hint,
        ));
    };
    let (scene, drive) = driven(*scene, model, &named)?;
    let moved = drive.coordinates();
    if let Some(idle) = named.iter().find(|n| !moved.contains(&n.coordinate)) {
        let name = &drive.model.coordinates[idle.coordinate].name;
        let message = format!("--coordinate: `{name}` moves no bone of the scene against another");
        return Err(Failure::usage(
            message,
            "name a coordinate of a joint between its bones",
        ));
    }
    let most = PoseSet::most(ranges.len());
    let count = match options.grid {
        Some(n) => (n as usize).saturating_pow(ranges.len() as u32),
        None => options.samples as usize,
    };
    if count > most || u64::from(arguments.count) * u64::from(arguments.points) > MOST_POINTS {
        let message = format!("{count} samples of {} fibres are too many", arguments.count);
        let hint = format!("at most {most} samples, and {MOST_POINTS} points of fibres a muscle");
        return Err(Failure::usage(message, hint));
    }
    let set = match options.grid {
        Some(n) => PoseSet::grid(&drive.model, &drive.rest, &ranges, n as usize),
        None => PoseSet::hypercube(&drive.model, &drive.rest, &ranges, count, SEED),
    };
    arguments.output.threads.start();
    let stop = stop_on_interrupt("stopping after this pose");
    let name = scene.name.clone();
    let out = arguments.output.folder(&name, "moment-arms");
    let fibres = HarmonicOptions {
        count: arguments.count as usize,
        points: arguments.points as usize,
    };
    let mut running = SweepRun::through(scene, &set.poses, fibres)?;
    let names = OpenSimNames {
        coordinate: String::new(),
        forces: arguments
            .forces
            .clone()
            .map_or(Vec::new(), |forces| forces.0),
    };
    names_of_forces(&names, &running.muscles)?;
    let folder = Folder::open(&out)?;
    let samples = set.samples.len();
    let mut written = OfSamples {
        each: set.each(),
        written: Written {
            folder: &folder,
            shown: [0, samples / 2, samples - 1],
            done: 0,
            series: Collection::new(),
            pictures: Vec::new(),
            failed: None,
        },
    };
    let progress = Stoppable::new(simulation::Scenario::frames(&running), &stop);
    simulation::run(&mut running, &mut [&mut written], &progress);
    progress.bar.end();
    let written = written.written;
    if let Some(error) = written.failed {
        return Err(error.into());
    }
    let splice = match options.splice {
        true => {
            let text = std::fs::read_to_string(osim);
            let text = text.map_err(|e| {
                Failure::usage(format!("{}: {e}", osim.display()), "check the path")
            })?;
            Some((osim.display().to_string(), text))
        }
        false => None,
    };
    let posed = Posed {
        scene: name,
        bundles: bundled(&running.muscles, &names, &drive),
        interrupted: running.done() < running.angles.len() && stop.load(Ordering::Relaxed),
        drive,
        set,
        most_order: options.order_up_to as usize,
        splice,
        replaces_parameters: options.parameters,
        time_s: begun.elapsed().as_secs_f64(),
    };
    let output = files::output_of_poses(&posed, &running, written.series, &written.pictures)
        .map_err(FolderError::from)?;
    arguments.output.finish(&folder, output)
}

/// Writes the fibres of each sample, without those of its neighbours.
struct OfSamples<'a> {
    each: usize,
    written: Written<'a>,
}

impl Observer<SweepRun> for OfSamples<'_> {
    fn frame(&mut self, running: &SweepRun, _: Duration) -> ControlFlow<()> {
        let reached = running.done();
        // The first pose of a sample is the sample itself.
        if reached == 0
            || !(reached - 1).is_multiple_of(self.each)
            || (reached - 1) / self.each < self.written.done
        {
            return ControlFlow::Continue(());
        }
        let k = (reached - 1) / self.each;
        self.written
            .write(running, (k, k as f64), format!("sample {k}"))
    }
}
