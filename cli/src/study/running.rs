//! Runs the combinations of a study, several at once, each with its own threads.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use nalgebra::Point3;

use super::combinations::{Combination, Combinations, Subject};
use super::outcome::{Outcome, Positions};
use crate::report::folder::{Folder, FolderError};
use crate::report::frames::Cast;
use crate::report::pictures::covered_stretch;
use crate::report::record::Record;
use crate::report::run::ready;
use crate::report::summary::{Summary, Time};
use pliant::mesh::measures::{Aabb, greatest};
use pliant::scene::content::Staged;
use pliant::simulation::skin::Stepped;
use pliant::simulation::{Body, Plan, Simulation};
use pliant::solvers::DIVERGENCE;

/// Receives the progress of a study from several threads, and can stop it.
pub trait Watch: Sync {
    /// A combination has computed another frame.
    fn frame(&self);
    /// A combination is complete.
    fn done(&self, combination: &Combination, outcome: &Outcome);
    /// True to stop now.
    fn stops(&self) -> bool;
}

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

/// Runs the combinations `wanted`, `threads` of them at once, and writes each complete result. A
/// run that `watch` stops leaves none. The results do not depend on the number of threads.
///
/// # Errors
/// A result that cannot be written; the other runs then stop.
pub fn execute(
    study: &Combinations,
    wanted: &[usize],
    folder: &Folder,
    threads: usize,
    watch: &impl Watch,
) -> Result<(), FolderError> {
    // Foreign files in the way are reported before hours of computation.
    wanted
        .iter()
        .try_for_each(|&k| folder.claim(&study.all[k].file()).map(|_| ()))?;
    let workers = threads.clamp(1, wanted.len().max(1));
    let (next, failed) = (AtomicUsize::new(0), Mutex::new(None));
    let has_failed = || failed.lock().map_or(true, |f| f.is_some());
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                // A separate pool: a run that waits in a common one would include another run's
                // work in its time. If the system gives no threads, the present ones are used.
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads((threads / workers).max(1))
                    .build()
                    .ok();
                while let Some(&k) = wanted.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let combination = &study.all[k];
                    let goes_on = || !watch.stops() && !has_failed();
                    let work = || simulate(combination, &study.frames, &goes_on, watch);
                    let outcome = match &pool {
                        Some(pool) => pool.install(work),
                        None => work(),
                    };
                    let Some(outcome) = outcome else { return };
                    let write = |w: &mut std::io::BufWriter<std::fs::File>| {
                        outcome.write(&combination.key, w)
                    };
                    if let Err(error) = folder.write(&combination.file(), write) {
                        if let Ok(mut failed) = failed.lock() {
                            failed.get_or_insert(error);
                        }
                        return;
                    }
                    watch.done(combination, &outcome);
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
    goes_on: &dyn Fn() -> bool,
    watch: &impl Watch,
) -> Option<Outcome> {
    let (scene, assets) = match &combination.subject {
        Subject::Muscles { scene, assets } => ((**scene).clone(), (**assets).clone()),
        Subject::Staged(scene, _) => return perform(scene, frames, goes_on, watch),
    };
    let begun = Instant::now();
    let plan = Plan::new(&scene, &assets);
    // The simulation was created once before, and files are not read again, so this cannot fail.
    let mut simulation = Simulation::with(scene, assets, plan).ok()?;
    let cast = Cast::of(&simulation);
    let prepared = begun.elapsed();
    let mut record = Record::default();
    let mut looks = Looks {
        frames,
        cast: &cast,
        positions: Vec::new(),
        stretch: 0.0,
    };
    record.add(
        &simulation,
        simulation.measure(),
        Duration::ZERO,
        Duration::ZERO,
    );
    looks.look(&simulation);
    let mut diverged = false;
    while simulation.frame() < simulation.scene.frames {
        if !goes_on() {
            return None;
        }
        let before = Instant::now();
        simulation.step_frame();
        let step = before.elapsed();
        let measures = simulation.measure();
        record.add(&simulation, measures, step, before.elapsed() - step);
        let has_diverged = |body: &Body| {
            body.stopped
                .as_ref()
                .is_some_and(|(_, why)| why.effect == DIVERGENCE)
        };
        if simulation.bodies.iter().any(has_diverged) {
            diverged = true;
            break;
        }
        looks.look(&simulation);
        watch.frame();
        if simulation.bodies.iter().all(|b| b.stopped.is_some()) {
            break;
        }
    }
    let time = Time::of(
        &record,
        begun.elapsed().as_secs_f64(),
        prepared.as_secs_f64(),
        0.0,
    );
    let summary = Summary::of(&simulation, &record, false, time, None);
    let outcome = looks.outcome(&summary, &record);
    Some(Outcome {
        diverged,
        ..outcome
    })
}

/// The same as [`simulate`] for a scene without muscles.
fn perform(
    scene: &Staged,
    frames: &[usize],
    goes_on: &dyn Fn() -> bool,
    watch: &impl Watch,
) -> Option<Outcome> {
    let mut run = ready(scene).ok()?;
    let cast = run.cast();
    let (mut positions, mut stretch, mut stopped) = (Vec::new(), 0.0, None);
    loop {
        if frames.contains(&run.frame()) {
            let x: Vec<Vec<Point3<f64>>> =
                run.snapshot().muscles.into_iter().map(|(x, _)| x).collect();
            stretch = greatest([stretch, covered_stretch(&cast, x.iter().map(Vec::as_slice))]);
            positions.push((run.frame(), x));
        }
        if run.frame() >= run.frames() {
            break;
        }
        if !goes_on() {
            return None;
        }
        match run.step(&mut |_| goes_on()) {
            Stepped::Done => watch.frame(),
            Stepped::Interrupted => return None,
            Stepped::Failed(why) => {
                stopped = Some(why);
                break;
            }
        }
    }
    let numbers = run.account().numbers;
    Some(Outcome {
        frames: run.frame(),
        not_converged: usize::from(!run.converged()),
        stopped,
        diverged: false,
        numbers: numbers
            .into_iter()
            .map(|(name, value)| (name.to_owned(), value))
            .collect(),
        bounds: bounds(&positions),
        positions,
        stretch,
    })
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
    cast: &'a Cast,
    positions: Vec<(usize, Vec<Vec<Point3<f64>>>)>,
    stretch: f64,
}

impl Looks<'_> {
    fn look(&mut self, simulation: &Simulation) {
        // A stopped body stays in place and gives no picture at that frame.
        let stopped = simulation.bodies.iter().any(|b| b.stopped.is_some());
        if stopped || !self.frames.contains(&simulation.frame()) {
            return;
        }
        let x: Vec<_> = simulation
            .bodies
            .iter()
            .map(|b| b.system.particles.position.clone())
            .collect();
        self.stretch = greatest([
            self.stretch,
            covered_stretch(self.cast, x.iter().map(Vec::as_slice)),
        ]);
        self.positions.push((simulation.frame(), x));
    }

    fn outcome(self, summary: &Summary, record: &Record) -> Outcome {
        let muscles = &summary.muscles;
        let most = |value: fn(&crate::report::summary::MuscleSummary) -> f64| {
            greatest(muscles.iter().map(value))
        };
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
            ("error_estimate_m", summary.error_estimate_m),
        ];
        let at = |m: &crate::report::summary::MuscleSummary| {
            let at = m.stopped.as_ref()?;
            Some(format!(
                "{} at vertex {} of {} in frame {}",
                at.effect, at.particle, m.name, at.frame
            ))
        };
        Outcome {
            frames: summary.frames,
            not_converged: muscles.iter().map(|m| m.frames_not_converged).sum(),
            stopped: muscles.iter().find_map(at),
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
