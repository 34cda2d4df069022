//! Runs the combinations of a study, several at once, each with its own threads.

use std::collections::HashSet;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use nalgebra::Point3;

use super::combinations::{Combination, Combinations, Subject, muscles};
use super::outcome::{Outcome, Positions};
use crate::report::folder::{Folder, FolderError};
use crate::report::muscles::{MuscleSummary, summaries};
use crate::report::pictures::covered_stretch;
use crate::report::record::Record;
use pliant::io::write_whole;
use pliant::mesh::measures::{Aabb, max_or_nan};
use pliant::progress::Progress;
use pliant::scene::Scene;
use pliant::simulation::{
    Assets, Body, Ended, Observer, Scenario, ScenarioKind, SceneDescription, Simulation, run,
};
use pliant::solvers::DIVERGENCE;

/// Combinations without a result in the folder, equal ones once; all without a folder.
pub fn missing(study: &Combinations, folder: Option<&Path>) -> Vec<usize> {
    let mut seen = HashSet::new();
    let kept = |c: &Combination| {
        folder.is_some_and(|f| Outcome::read(&f.join(c.file()), &c.key).is_some())
    };
    let new = |(_, c): &(usize, &Combination)| seen.insert(c.key.clone()) && !kept(c);
    study
        .all
        .iter()
        .enumerate()
        .filter(new)
        .map(|(k, _)| k)
        .collect()
}

/// Where results of runs are kept.
#[derive(Clone, Copy, Debug)]
pub enum Kept<'a> {
    /// In a folder that no other program writes to.
    Alone(&'a Folder),
    /// In a folder to which several programs write at once, on one machine or on many. Equal runs
    /// write equal files, but for their times; the last one stays.
    Shared(&'a Path),
}

impl Kept<'_> {
    fn claim(self, file: &str) -> Result<(), FolderError> {
        match self {
            Self::Alone(folder) => folder.claim(file).map(|_| ()),
            Self::Shared(_) => Ok(()),
        }
    }

    fn write(self, combination: &Combination, outcome: &Outcome) -> Result<(), FolderError> {
        let file = combination.file();
        let root = match self {
            Self::Alone(folder) => {
                return folder.write(&file, |w| outcome.write(&combination.key, w));
            }
            Self::Shared(root) => root,
        };
        let path = root.join(&file);
        let failed = |source| FolderError::Io {
            path: path.clone(),
            source,
        };
        // Two writers must not share a partial file, and a rename is atomic, also on NFS.
        let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        let unique = since.map_or(0, |t| t.as_nanos()) ^ (u128::from(std::process::id()) << 64);
        let part = path.with_extension(format!("{unique:x}"));
        let written = std::fs::create_dir_all(root.join("runs"))
            .and_then(|()| write_whole(&part, |w| outcome.write(&combination.key, w)))
            .and_then(|()| std::fs::rename(&part, &path));
        written.map_err(|error| {
            let _ = std::fs::remove_file(&part);
            failed(error)
        })
    }
}

/// Runs the combinations `selected`, `threads` of them at once, and writes each complete result. A
/// run that `watch` stops leaves none. The results do not depend on the number of threads.
///
/// # Errors
/// A result that cannot be written; the other runs then stop.
pub fn execute(
    study: &Combinations,
    selected: &[usize],
    kept: Kept<'_>,
    threads: usize,
    progress: &(dyn Progress + Sync),
    done: &(dyn Fn(&Combination, &Outcome) + Sync),
) -> Result<(), FolderError> {
    // A foreign file in place of a result is reported before hours of computation.
    selected
        .iter()
        .try_for_each(|&k| kept.claim(&study.all[k].file()))?;
    let workers = threads.clamp(1, selected.len().max(1));
    let (next, failed) = (AtomicUsize::new(0), Mutex::new(None));
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                // A separate pool: a run that waits in a common one would include another run's
                // work in its time. If the system gives no threads, the present ones are used.
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads((threads / workers).max(1))
                    .build()
                    .ok();
                while let Some(&k) = selected.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let combination = &study.all[k];
                    let work = || {
                        let until_failed = |stage: &str, done: usize, of: usize| {
                            if failed.lock().map_or(true, |f| f.is_some()) {
                                return ControlFlow::Break(());
                            }
                            progress.report(stage, done, of)
                        };
                        simulate(combination, &study.frames, &until_failed)
                    };
                    let outcome = match &pool {
                        Some(pool) => pool.install(work),
                        None => work(),
                    };
                    let Some(outcome) = outcome else { return };
                    if let Err(error) = kept.write(combination, &outcome) {
                        if let Ok(mut failed) = failed.lock() {
                            failed.get_or_insert(error);
                        }
                        return;
                    }
                    done(combination, &outcome);
                }
            });
        }
    });
    failed
        .into_inner()
        .map_or(Err(FolderError::WriterEnded), |failed| {
            failed.map_or(Ok(()), Err)
        })
}

/// Runs one combination; `None` if it was stopped before its last frame.
fn simulate(
    combination: &Combination,
    frames: &[usize],
    progress: &dyn Progress,
) -> Option<Outcome> {
    match &combination.subject {
        Subject::Muscles { scene, assets } => of_muscles(scene, assets, frames, progress),
        other => match other.scenario() {
            Ok(mut scenario) => of_others(scenario.as_mut(), frames, progress),
            Err(error) => Some(Outcome::stopped_by(error.terse())),
        },
    }
}

fn of_muscles(
    scene: &Scene,
    assets: &Assets,
    frames: &[usize],
    progress: &dyn Progress,
) -> Option<Outcome> {
    let mut simulation = match muscles(scene, assets) {
        Ok(simulation) => simulation,
        // Of a large study, not each combination was created before.
        Err(error) => return Some(Outcome::stopped_by(error.terse())),
    };
    let mut looks = Looks::new(frames, simulation.description());
    let mut recorded = Recorded::default();
    let ended = run(&mut simulation, &mut [&mut recorded, &mut looks], progress);
    if ended == Ended::Interrupted {
        return None;
    }
    let Recorded { record, diverged } = recorded;
    let outcome = looks.outcome(&simulation, &record);
    Some(Outcome {
        diverged,
        ..outcome
    })
}

/// The same as [`of_muscles`] for a scene without muscles.
fn of_others(
    scenario: &mut dyn Scenario,
    frames: &[usize],
    progress: &dyn Progress,
) -> Option<Outcome> {
    let mut looks = Looks::new(frames, scenario.description());
    let stopped = match run(scenario, &mut [&mut looks], progress) {
        Ended::Finished | Ended::ByObserver => None,
        Ended::Interrupted => return None,
        Ended::Failed(why) => Some(why),
    };
    let mut numbers = Vec::new();
    for (name, value) in scenario.measures() {
        numbers.push((name.to_owned(), value));
    }
    if numbers.iter().all(|(name, _)| name != "time_s") {
        numbers.push(("time_s".to_owned(), looks.frames_s));
    }
    Some(Outcome {
        frames: scenario.frame(),
        not_converged: usize::from(!scenario.converged()),
        stopped,
        diverged: false,
        numbers,
        bounds: bounds(&looks.positions),
        positions: looks.positions,
        stretch: looks.stretch,
    })
}

/// Measures each frame of muscles; ends the run where one diverges.
#[derive(Default)]
struct Recorded {
    record: Record,
    diverged: bool,
}

impl Observer<Simulation> for Recorded {
    fn frame(&mut self, simulation: &Simulation, took: Duration) -> ControlFlow<()> {
        let before = Instant::now();
        let measures = simulation.measure();
        self.record
            .add(simulation, measures, took, before.elapsed());
        let has_diverged = |body: &Body| {
            body.stopped
                .as_ref()
                .is_some_and(|(_, why)| why.effect == DIVERGENCE)
        };
        self.diverged = simulation.bodies.iter().any(has_diverged);
        match self.diverged {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }
}

/// Least and greatest corner of all positions.
fn bounds(positions: &[(usize, Positions)]) -> Option<[Point3<f64>; 2]> {
    let all = positions
        .iter()
        .flat_map(|(_, x)| x)
        .filter(|x| !x.is_empty());
    all.map(Aabb::of_points)
        .reduce(|a, b| a.union(&b))
        .map(|b| [b.min, b.max])
}

/// Collects positions at the compared frames.
struct Looks<'a> {
    frames: &'a [usize],
    scene: SceneDescription,
    positions: Vec<(usize, Positions)>,
    stretch: f64,
    /// Wall time of the frames [s].
    frames_s: f64,
}

impl<S: Scenario + ?Sized> Observer<S> for Looks<'_> {
    fn frame(&mut self, scenario: &S, took: Duration) -> ControlFlow<()> {
        self.frames_s += took.as_secs_f64();
        // A stopped body stays in place and gives no picture at that frame.
        let stopped = match scenario.kind() {
            ScenarioKind::Muscles(simulation) => {
                simulation.bodies.iter().any(|b| b.stopped.is_some())
            }
            _ => false,
        };
        if !stopped && self.frames.contains(&scenario.frame()) {
            let x: Positions = scenario.bodies().into_iter().map(|(x, _)| x).collect();
            let covered = covered_stretch(&self.scene, x.iter().map(Vec::as_slice));
            self.stretch = max_or_nan([self.stretch, covered]);
            self.positions.push((scenario.frame(), x));
        }
        ControlFlow::Continue(())
    }
}

impl<'a> Looks<'a> {
    fn new(frames: &'a [usize], scene: SceneDescription) -> Self {
        Self {
            frames,
            scene,
            positions: Vec::new(),
            stretch: 0.0,
            frames_s: 0.0,
        }
    }

    fn outcome(self, simulation: &Simulation, record: &Record) -> Outcome {
        let muscles = summaries(simulation, record);
        let most = |value: fn(&MuscleSummary) -> f64| max_or_nan(muscles.iter().map(value));
        let steps_s = record.times.iter().map(|t| t.step_ms).sum::<f64>() * 1e-3;
        let numbers = [
            ("time_s", steps_s),
            ("volume_error", most(|m| m.volume_error_max)),
            ("penetration_m", most(|m| m.penetration_max_m)),
            ("edge_stretch_rms_end", most(|m| m.edge_stretch_rms_end)),
            ("edge_stretch_rms_worst", most(|m| m.edge_stretch_rms_worst)),
            (
                "distance_from_start_rms_m",
                most(|m| m.distance_from_start_rms_m),
            ),
            ("residual_m", most(|m| m.residual_max_m)),
            (
                "error_estimate.solver_m",
                most(|m| m.error_estimate.solver_m),
            ),
        ];
        Outcome {
            frames: simulation.frame(),
            not_converged: muscles.iter().map(|m| m.frames_not_converged).sum(),
            stopped: muscles.iter().find_map(MuscleSummary::stop),
            diverged: false,
            numbers: numbers
                .map(|(name, value)| (name.to_owned(), value))
                .to_vec(),
            bounds: bounds(&self.positions),
            positions: self.positions,
            stretch: self.stretch,
        }
    }
}
