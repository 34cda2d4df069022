//! A study of a scene: references, candidates measured against them, and recommendations.

use std::time::{Duration, Instant};

use super::candidates::{self, Candidate, SolverQuestion};
use super::choice::{Recommended, pareto, recommend};
use super::distance::FrameDistance;
use super::reference::{Reference, refine};
use super::trajectory::Trajectory;
use crate::constraints::lanes::SimdWidth;
use crate::contact::broad_phase::METHODS;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::simulation::{Assets, LoadError};

/// Options of a study.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StudyOptions {
    /// Approximate total time.
    pub budget: Duration,
    /// Number of frames; `None` for the number that the budget allows.
    pub frames: Option<usize>,
    /// Number of threads.
    pub threads: usize,
}

/// Result of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Every frame is within the solver's tolerance.
    Converged,
    /// The run completed, but some frame exceeds the tolerance.
    NotConverged,
    /// A number was not finite, or the error exceeded the length of the muscle.
    Diverged,
}

impl Status {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::NotConverged => "not converged",
            Self::Diverged => "diverged",
        }
    }
}

/// The run of a candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyRow {
    /// Solver and settings.
    pub candidate: Candidate,
    /// Result of the run.
    pub status: Status,
    /// Distance to the reference of the solver's problem [m].
    pub error: FrameDistance,
    /// Uncertainty of that reference, RMS [m].
    pub uncertainty_m: f64,
    /// Model error of a solver of another problem than the scene's, RMS [m].
    pub model_error_m: f64,
    /// Median wall time of the repeats [s].
    pub time_s: f64,
    /// Least and greatest time of the repeats [s].
    pub time_range_s: [f64; 2],
    /// Number of runs.
    pub repeats: usize,
    /// Greatest relative departure of a volume from its target.
    pub volume_error: f64,
    /// Greatest depth in a bone [m].
    pub penetration_m: f64,
    /// Mean fibre length minus the reference's [m].
    pub fibre_error_m: f64,
    /// Greatest residual [m].
    pub residual_m: f64,
    /// Error estimate of the run itself [m].
    pub error_estimate_m: f64,
    /// Number of iterations of all steps; 0 for solvers with sweeps.
    pub solver_iterations: u64,
}

impl StudyRow {
    /// A row without measurements.
    pub fn new(candidate: Candidate, status: Status) -> Self {
        let none = f64::NAN;
        let error = FrameDistance {
            rms: none,
            max: none,
            frame: 0,
        };
        Self {
            candidate,
            status,
            error,
            uncertainty_m: none,
            model_error_m: 0.0,
            time_s: none,
            time_range_s: [none; 2],
            repeats: 0,
            volume_error: none,
            penetration_m: none,
            fibre_error_m: none,
            residual_m: none,
            error_estimate_m: none,
            solver_iterations: 0,
        }
    }
}

/// Results of a study.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// Name of the scene.
    pub scene: String,
    /// Number of compared frames, from frame 1.
    pub frames: usize,
    /// Number of frames of the scene.
    pub frames_of_scene: usize,
    /// Length of the shortest muscle [m].
    pub length: f64,
    /// Number of vertices of all muscles.
    pub vertices: usize,
    /// Displacement of the vertices in the frame with the greatest, RMS [m].
    pub moved_m: f64,
    /// Problem of the scene's own solver.
    pub question: SolverQuestion,
    /// Reference of that problem.
    pub reference: Reference,
    /// Reference of the other problem, if there was time.
    pub other: Option<Reference>,
    /// Distance between both, RMS of the worst frame [m].
    pub model_distance_m: f64,
    /// All runs.
    pub rows: Vec<StudyRow>,
    /// Candidates that were not measured for lack of time.
    pub left_out: Vec<Candidate>,
    /// The cheapest row for each target.
    pub recommended: Vec<Recommended>,
    /// Rows on the Pareto front.
    pub front: Vec<usize>,
    /// True if the study was interrupted.
    pub interrupted: bool,
}

/// Error of a study.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The scene cannot run.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The solver is classic PBD.
    #[error(
        "classic PBD has no energy: what it tends to depends on its steps and sweeps, so there is no reference"
    )]
    NoEnergy,
    /// The reference cannot be computed.
    #[error("no reference: {0}")]
    NoReference(String),
}

/// Share of the budget for the references.
const FOR_REFERENCES: f64 = 0.45;

/// Share of a reference's time for its first level: the second takes at least twice as long.
const FIRST_LEVEL: f64 = 0.3;

/// Greatest excess of a run over the budget, relative to it.
const LATE: f64 = 0.1;

/// The reference is refined to this uncertainty, relative to the length.
const CERTAIN: f64 = 1e-4;

/// Number of runs of each row on the front.
const REPEATS: usize = 3;

/// A study in progress.
pub(super) struct Measuring<'a> {
    pub(super) scene: &'a Scene,
    assets: &'a Assets,
    pub(super) options: StudyOptions,
    begin: Instant,
    length: f64,
    frames: usize,
    pub(super) interrupted: bool,
}

/// Measures a scene with its meshes.
///
/// # Errors
/// A scene that cannot run, that has no energy, or without a computable reference.
pub fn measure(
    scene: &Scene,
    assets: &Assets,
    options: StudyOptions,
    progress: &dyn Progress,
) -> Result<Study, StudyError> {
    let (mut measuring, mut study) = begin(scene, assets, options, progress)?;
    measuring.sweep(&mut study, progress);
    measuring.repeat(&mut study, progress);
    study.interrupted = measuring.interrupted;
    Ok(study)
}

/// Computes the references, without comparisons.
pub(super) fn begin<'a>(
    scene: &'a Scene,
    assets: &'a Assets,
    options: StudyOptions,
    progress: &dyn Progress,
) -> Result<(Measuring<'a>, Study), StudyError> {
    let question = SolverQuestion::of(&scene.solver).ok_or(StudyError::NoEnergy)?;
    let begin = Instant::now();
    let length = assets
        .muscles
        .iter()
        .map(|m| m.mesh.length())
        .fold(f64::INFINITY, f64::min);
    let vertices = assets.muscles.iter().map(|m| m.mesh.vertices.len()).sum();
    let mut measuring = Measuring {
        scene,
        assets,
        options,
        begin,
        length,
        frames: 0,
        interrupted: false,
    };
    measuring.frames = measuring.choose_frames(question, progress)?;
    let reference = measuring.reference(question, FOR_REFERENCES, progress)?;
    let reference = reference.ok_or_else(|| no_reference(&measuring))?;
    measuring.frames = reference.frames().len();
    let rest: Vec<_> = assets
        .muscles
        .iter()
        .flat_map(|m| m.mesh.vertices.iter().copied())
        .collect();
    let moved_m = FrameDistance::between(&vec![rest; measuring.frames], reference.frames()).rms;
    let turned = if question == SolverQuestion::Motion {
        SolverQuestion::Equilibrium
    } else {
        SolverQuestion::Motion
    };
    let other = if measuring.interrupted {
        None
    } else {
        measuring.other(turned, progress)
    };
    let model_distance_m = other.as_ref().map_or(f64::NAN, |o| {
        FrameDistance::between(o.frames(), reference.frames()).rms
    });
    let study = Study {
        scene: scene.name.clone(),
        frames: measuring.frames,
        frames_of_scene: scene.frames,
        length,
        vertices,
        moved_m,
        question,
        reference,
        other,
        model_distance_m,
        rows: Vec::new(),
        left_out: Vec::new(),
        recommended: Vec::new(),
        front: Vec::new(),
        interrupted: measuring.interrupted,
    };
    Ok((measuring, study))
}

fn no_reference(measuring: &Measuring<'_>) -> StudyError {
    StudyError::NoReference(if measuring.interrupted {
        "interrupted before there was one".to_owned()
    } else {
        "two levels of two frames did not fit into the budget, or a muscle was stopped".to_owned()
    })
}

impl Measuring<'_> {
    /// Remaining time [s].
    pub(super) fn left_s(&self) -> f64 {
        self.options.budget.as_secs_f64() - self.begin.elapsed().as_secs_f64()
    }

    /// The number of frames that the time of the references allows, from a first level over two
    /// frames.
    fn choose_frames(
        &mut self,
        question: SolverQuestion,
        progress: &dyn Progress,
    ) -> Result<usize, StudyError> {
        if let Some(frames) = self.options.frames {
            return Ok(frames.min(self.scene.frames));
        }
        progress.begin("a first look at what a frame costs");
        let candidate = Candidate::new(question.minimised(1, 1e-4), self.options.threads);
        let mut a_frame = f64::INFINITY;
        // The very first frame includes the cost of first memory accesses.
        let goes_on = &mut |_: usize, took: f64| {
            a_frame = a_frame.min(took);
            !progress.is_stopped()
        };
        Trajectory::of(
            self.scene,
            self.assets,
            &candidate,
            self.scene.frames.min(2),
            goes_on,
        )?;
        self.interrupted |= progress.is_stopped();
        // The levels of both references cost about this multiple of the first, the candidates twice
        // that.
        let affordable = self.left_s() / (60.0 * a_frame);
        Ok((affordable as usize).clamp(4.min(self.scene.frames), self.scene.frames))
    }

    fn run(
        &mut self,
        candidate: &Candidate,
        frames: usize,
        progress: &dyn Progress,
    ) -> Result<Trajectory, LoadError> {
        let end = Instant::now()
            + Duration::from_secs_f64(
                self.left_s().max(0.0) + LATE * self.options.budget.as_secs_f64(),
            );
        let goes_on = &mut |_: usize, _: f64| !progress.is_stopped() && Instant::now() <= end;
        let run = Trajectory::of(self.scene, self.assets, candidate, frames, goes_on)?;
        self.interrupted |= progress.is_stopped();
        Ok(run)
    }

    fn reference(
        &mut self,
        question: SolverQuestion,
        share: f64,
        progress: &dyn Progress,
    ) -> Result<Option<Reference>, StudyError> {
        let (begin, budget) = (Instant::now(), share * self.left_s().max(0.0));
        let mut last = begin;
        // A level takes about twice as long as the previous one.
        let allows = || {
            let took = last.elapsed().as_secs_f64();
            last = Instant::now();
            begin.elapsed().as_secs_f64() + 2.0 * took <= budget
        };
        let mut said = None;
        let mut listen = |candidate: &Candidate, level: u32, _: f64| {
            if said != Some(*candidate) {
                said = Some(*candidate);
                progress.begin(&format!(
                    "reference by {}: {}",
                    candidate.solver_key(),
                    candidate.in_words()
                ));
            }
            let share = if level == 0 { FIRST_LEVEL } else { 1.0 };
            !progress.is_stopped() && begin.elapsed().as_secs_f64() <= share * budget
        };
        let tolerance = CERTAIN * self.length;
        let found = refine(
            self.scene,
            self.assets,
            (question, self.options.threads),
            self.frames,
            tolerance,
            allows,
            &mut listen,
        )?;
        self.interrupted |= progress.is_stopped();
        Ok(found)
    }

    /// The reference of the other problem; a body without attachment has motion, but no
    /// equilibrium.
    fn other(&mut self, question: SolverQuestion, progress: &dyn Progress) -> Option<Reference> {
        self.reference(question, 0.3, progress).ok().flatten()
    }

    fn sweep(&mut self, study: &mut Study, progress: &dyn Progress) {
        let all = candidates::all(self.scene, self.options.threads);
        let mut costs: Vec<(&'static str, f64)> = Vec::new();
        for candidate in all {
            let known = costs
                .iter()
                .find(|(name, _)| *name == candidate.solver_key())
                .map(|(_, s)| s * candidate.work());
            // A first row of each solver is always measured.
            if self.interrupted || known.is_some_and(|s| s > self.left_s()) {
                study.left_out.push(candidate);
                continue;
            }
            progress.begin(&format!(
                "{}: {}",
                candidate.solver_key(),
                candidate.in_words()
            ));
            let Some(row) = self.row(candidate, study, progress) else {
                study.left_out.push(candidate);
                continue;
            };
            costs.retain(|(name, _)| *name != candidate.solver_key());
            costs.push((candidate.solver_key(), row.time_s / candidate.work()));
            study.rows.push(row);
        }
    }

    /// `None` if the candidate cannot run the scene, or was interrupted.
    pub(super) fn row(
        &mut self,
        candidate: Candidate,
        study: &Study,
        progress: &dyn Progress,
    ) -> Option<StudyRow> {
        let question = SolverQuestion::of(&candidate.solver)?;
        let own = question == study.question;
        let reference = if own {
            &study.reference
        } else {
            study.other.as_ref()?
        };
        let run = self.run(&candidate, study.frames, progress).ok()?;
        if self.interrupted || (run.cut_short && !run.stopped) {
            return None;
        }
        let error = FrameDistance::between(reference.frames(), &run.frames);
        // Not `>`, which is false for NaN.
        let lost = run.stopped || !(error.max <= self.length);
        let status = match (lost, run.converged) {
            (true, _) => Status::Diverged,
            (false, true) => Status::Converged,
            (false, false) => Status::NotConverged,
        };
        Some(StudyRow {
            error,
            uncertainty_m: reference.uncertainty.rms,
            model_error_m: if own { 0.0 } else { study.model_distance_m },
            time_s: run.time_s,
            time_range_s: [run.time_s; 2],
            repeats: 1,
            volume_error: run.volume_error,
            penetration_m: run.penetration_m,
            fibre_error_m: run.fibre_length_m - reference.run.fibre_length_m,
            residual_m: run.residual_m,
            error_estimate_m: run.error_estimate_m,
            solver_iterations: run.iterations,
            ..StudyRow::new(candidate, status)
        })
    }

    /// Repeats the front for the spread of times, and the fastest recommended settings with one
    /// lane and with one thread.
    fn repeat(&mut self, study: &mut Study, progress: &dyn Progress) {
        study.front = pareto(&study.rows);
        for i in study.front.clone() {
            let mut times = vec![study.rows[i].time_s];
            progress.begin(&format!("again: {}", study.rows[i].candidate.in_words()));
            while times.len() < REPEATS && times[0] < self.left_s() && !self.interrupted {
                let candidate = study.rows[i].candidate;
                let Ok(run) = self.run(&candidate, study.frames, progress) else {
                    break;
                };
                if !run.cut_short {
                    times.push(run.time_s);
                }
            }
            times.sort_by(f64::total_cmp);
            let row = &mut study.rows[i];
            (row.time_s, row.repeats) = (times[times.len() / 2], times.len());
            row.time_range_s = [times[0], times[times.len() - 1]];
        }
        self.vary(study, progress);
        study.front = pareto(&study.rows);
        study.recommended = recommend(&study.rows, self.length);
    }

    /// Measures the recommended settings without lanes, on one thread, with other orders of a sweep
    /// and other methods of contact search: the error is the same up to rounding and order, the
    /// time differs.
    fn vary(&mut self, study: &mut Study, progress: &dyn Progress) {
        let mut variants = Vec::new();
        let mut add = |variant: Candidate| {
            if !variants.contains(&variant) {
                variants.push(variant);
            }
        };
        let chosen = recommend(&study.rows, self.length);
        for candidate in chosen
            .iter()
            .filter_map(|r| r.row)
            .map(|row| study.rows[row].candidate)
        {
            if candidate.solver.minimisation().is_none() && candidate.width != SimdWidth::One {
                add(Candidate {
                    width: SimdWidth::One,
                    ..candidate
                });
            }
            if candidate.threads > 1 {
                add(Candidate {
                    threads: 1,
                    ..candidate
                });
            }
        }
        // The finest recommended setting, where sweeps and contact matter most.
        if let Some(candidate) = chosen
            .iter()
            .rev()
            .find_map(|r| r.row)
            .map(|row| study.rows[row].candidate)
        {
            candidates::in_other_orders(&candidate)
                .into_iter()
                .for_each(&mut add);
            if self.scene.effects.contact.is_some() {
                METHODS.iter().for_each(|way| {
                    add(Candidate {
                        broad_phase: Some(way.name),
                        ..candidate
                    })
                });
            }
        }
        for candidate in variants {
            progress.begin(&format!(
                "{}: {}, {}, threads {}{}",
                candidate.solver_key(),
                candidate.in_words(),
                candidate.width,
                candidate.threads,
                candidate
                    .broad_phase
                    .map_or(String::new(), |way| format!(", contact by {way}"))
            ));
            if self.interrupted || self.left_s() < 0.0 {
                study.left_out.push(candidate);
            } else if let Some(row) = self.row(candidate, study, progress) {
                study.rows.push(row);
            }
        }
    }
}
