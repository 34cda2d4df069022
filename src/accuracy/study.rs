//! A scene measured: its references, every candidate against them, and what is recommended.

use std::time::{Duration, Instant};

use super::candidates::{self, Candidate, Question};
use super::choice::{Recommended, pareto, recommend};
use super::distance::Distance;
use super::reference::{Reference, refine};
use super::trajectory::Trajectory;
use crate::constraints::lanes::SimdWidth;
use crate::contact::broad_phase::METHODS;
use crate::scene::{Scene, Solver};
use crate::simulation::{Assets, LoadError};

/// What to measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Time for all of it, about.
    pub budget: Duration,
    /// Frames of the scene; `None` for as many as the budget allows.
    pub frames: Option<usize>,
    /// Threads.
    pub threads: usize,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Every frame met the solver's tolerance.
    Converged,
    /// It ran to its end, but some frame did not.
    NotConverged,
    /// A number was not finite, or a vertex went further off than the muscle is long.
    Diverged,
}

impl Status {
    /// For tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::NotConverged => "not converged",
            Self::Diverged => "diverged",
        }
    }
}

/// A candidate's run.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Solver and settings.
    pub candidate: Candidate,
    /// How it ended.
    pub status: Status,
    /// Distance to the reference of the question that the solver answers [m].
    pub error: Distance,
    /// What the reference may be off that it is compared with, RMS [m].
    pub uncertainty_m: f64,
    /// What a solver that answers another question than the scene asks leaves out, RMS [m].
    pub model_error_m: f64,
    /// Median wall time of the repeats [s].
    pub time_s: f64,
    /// Least and greatest of the repeats [s].
    pub time_range_s: [f64; 2],
    /// Runs.
    pub repeats: usize,
    /// Greatest departure of a volume from its target, as a share of it.
    pub volume_error: f64,
    /// Greatest depth in a bone [m].
    pub penetration_m: f64,
    /// Mean fibre length less the reference's [m].
    pub fibre_error_m: f64,
    /// Greatest residual [m].
    pub residual_m: f64,
    /// What a run estimates its error to be [m].
    pub error_estimate_m: f64,
    /// Iterations of all steps; 0 for solvers that sweep.
    pub solver_iterations: u64,
}

impl Row {
    /// A row without numbers.
    pub fn new(candidate: Candidate, status: Status) -> Self {
        let none = f64::NAN;
        let error = Distance {
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

/// Hears how far a study is, and may end it.
pub trait Watch {
    /// A new part begins.
    fn part(&mut self, text: &str);
    /// Whether to stop now, with what there is.
    fn stops(&self) -> bool;
}

/// What was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// The scene's name.
    pub scene: String,
    /// Frames that were compared, from 1 on.
    pub frames: usize,
    /// Frames that the scene has.
    pub frames_of_scene: usize,
    /// Length of the shortest muscle [m].
    pub length: f64,
    /// Vertices of all muscles.
    pub vertices: usize,
    /// How far they are from rest in the frame in which they are furthest, RMS [m].
    pub moved_m: f64,
    /// What the scene's own solver answers.
    pub question: Question,
    /// The reference for it.
    pub reference: Reference,
    /// The reference for the other question, where there was time for one.
    pub other: Option<Reference>,
    /// Distance between both, RMS of the worst frame [m].
    pub model_distance_m: f64,
    /// All runs.
    pub rows: Vec<Row>,
    /// What there was no time for.
    pub left_out: Vec<Candidate>,
    /// The cheapest for each target.
    pub recommended: Vec<Recommended>,
    /// Rows that no other beats.
    pub front: Vec<usize>,
    /// Whether it was interrupted.
    pub interrupted: bool,
}

/// Why nothing could be measured.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The scene cannot be run.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Classic PBD.
    #[error(
        "classic PBD has no energy: what it tends to depends on its steps and sweeps, so there is no reference"
    )]
    NoEnergy,
    /// No reference.
    #[error("no reference: {0}")]
    NoReference(String),
}

/// Share of the budget for the references.
const FOR_REFERENCES: f64 = 0.45;

/// Share of a reference's time for its first level: the second takes at least twice as long.
const FIRST_LEVEL: f64 = 0.3;

/// A run may end so much after the budget, as a share of it.
const LATE: f64 = 0.1;

/// The reference is refined until it stands still to this share of the length.
const CERTAIN: f64 = 1e-4;

/// Runs of each row on the front.
const REPEATS: usize = 3;

/// A study that goes on.
pub(super) struct Measuring<'a> {
    pub(super) scene: &'a Scene,
    assets: &'a Assets,
    pub(super) options: Options,
    begin: Instant,
    length: f64,
    frames: usize,
    pub(super) interrupted: bool,
}

/// Measures a scene with its meshes.
///
/// # Errors
/// A scene that cannot be run, that has no energy, or whose reference cannot be computed.
pub fn measure(
    scene: &Scene,
    assets: &Assets,
    options: Options,
    watch: &mut impl Watch,
) -> Result<Study, StudyError> {
    let (mut measuring, mut study) = begin(scene, assets, options, watch)?;
    measuring.sweep(&mut study, watch);
    measuring.repeat(&mut study, watch);
    study.interrupted = measuring.interrupted;
    Ok(study)
}

/// Computes the references; nothing is compared with them yet.
pub(super) fn begin<'a>(
    scene: &'a Scene,
    assets: &'a Assets,
    options: Options,
    watch: &mut impl Watch,
) -> Result<(Measuring<'a>, Study), StudyError> {
    let question = Question::of(&scene.solver).ok_or(StudyError::NoEnergy)?;
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
    measuring.frames = measuring.choose_frames(question, watch)?;
    let reference = measuring.reference(question, FOR_REFERENCES, watch)?;
    let reference = reference.ok_or_else(|| no_reference(&measuring))?;
    measuring.frames = reference.frames().len();
    let rest: Vec<_> = assets
        .muscles
        .iter()
        .flat_map(|m| m.mesh.vertices.iter().copied())
        .collect();
    let moved_m = Distance::between(&vec![rest; measuring.frames], reference.frames()).rms;
    let turned = if question == Question::Motion {
        Question::Equilibrium
    } else {
        Question::Motion
    };
    let other = if measuring.interrupted {
        None
    } else {
        measuring.other(turned, watch)
    };
    let model_distance_m = other.as_ref().map_or(f64::NAN, |o| {
        Distance::between(o.frames(), reference.frames()).rms
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
    /// Time that is left [s].
    pub(super) fn left_s(&self) -> f64 {
        self.options.budget.as_secs_f64() - self.begin.elapsed().as_secs_f64()
    }

    /// As many frames as the references have time for, found by a first level over two frames.
    fn choose_frames(
        &mut self,
        question: Question,
        watch: &mut impl Watch,
    ) -> Result<usize, StudyError> {
        if let Some(frames) = self.options.frames {
            return Ok(frames.min(self.scene.frames));
        }
        watch.part("a first look at what a frame costs");
        let solver = match question {
            Question::Equilibrium => candidates::quasi_static(1, 1e-4),
            Question::Motion => candidates::implicit_euler(1, 1e-4),
        };
        let candidate = Candidate::new(solver, self.options.threads);
        let mut a_frame = f64::INFINITY;
        // The first frame of all also waits for what is touched for the first time.
        let goes_on = &mut |_: usize, took: f64| {
            a_frame = a_frame.min(took);
            !watch.stops()
        };
        Trajectory::of(
            self.scene,
            self.assets,
            &candidate,
            self.scene.frames.min(2),
            goes_on,
        )?;
        self.interrupted |= watch.stops();
        // The levels of both references cost about as much as this many of the first, the candidates twice that.
        let affordable = self.left_s() / (60.0 * a_frame);
        Ok((affordable as usize).clamp(4.min(self.scene.frames), self.scene.frames))
    }

    fn run(
        &mut self,
        candidate: &Candidate,
        frames: usize,
        watch: &mut impl Watch,
    ) -> Result<Trajectory, LoadError> {
        let end = Instant::now()
            + Duration::from_secs_f64(
                self.left_s().max(0.0) + LATE * self.options.budget.as_secs_f64(),
            );
        let goes_on = &mut |_: usize, _: f64| !watch.stops() && Instant::now() <= end;
        let run = Trajectory::of(self.scene, self.assets, candidate, frames, goes_on)?;
        self.interrupted |= watch.stops();
        Ok(run)
    }

    fn reference(
        &mut self,
        question: Question,
        share: f64,
        watch: &mut impl Watch,
    ) -> Result<Option<Reference>, StudyError> {
        let (begin, budget) = (Instant::now(), share * self.left_s().max(0.0));
        let mut last = begin;
        // A level takes about twice as long as the one before.
        let allows = || {
            let took = last.elapsed().as_secs_f64();
            last = Instant::now();
            begin.elapsed().as_secs_f64() + 2.0 * took <= budget
        };
        let mut said = None;
        let mut listen = |candidate: &Candidate, level: u32, _: f64| {
            if said != Some(*candidate) {
                said = Some(*candidate);
                watch.part(&format!(
                    "reference by {}: {}",
                    candidate.name(),
                    candidate.in_words()
                ));
            }
            let share = if level == 0 { FIRST_LEVEL } else { 1.0 };
            !watch.stops() && begin.elapsed().as_secs_f64() <= share * budget
        };
        let wanted = CERTAIN * self.length;
        let found = refine(
            self.scene,
            self.assets,
            (question, self.options.threads),
            self.frames,
            wanted,
            allows,
            &mut listen,
        )?;
        self.interrupted |= watch.stops();
        Ok(found)
    }

    /// The other question's reference; a body without hold has motion, but no equilibrium.
    fn other(&mut self, question: Question, watch: &mut impl Watch) -> Option<Reference> {
        self.reference(question, 0.3, watch).ok().flatten()
    }

    fn sweep(&mut self, study: &mut Study, watch: &mut impl Watch) {
        let all = candidates::all(self.scene, self.options.threads);
        let mut costs: Vec<(&'static str, f64)> = Vec::new();
        for candidate in all {
            let known = costs
                .iter()
                .find(|(name, _)| *name == candidate.name())
                .map(|(_, s)| s * candidate.work());
            // A first row of each solver is always measured.
            if self.interrupted || known.is_some_and(|s| s > self.left_s()) {
                study.left_out.push(candidate);
                continue;
            }
            watch.part(&format!("{}: {}", candidate.name(), candidate.in_words()));
            let Some(row) = self.row(candidate, study, watch) else {
                study.left_out.push(candidate);
                continue;
            };
            costs.retain(|(name, _)| *name != candidate.name());
            costs.push((candidate.name(), row.time_s / candidate.work()));
            study.rows.push(row);
        }
    }

    /// `None` where the scene cannot be run so, or was interrupted.
    pub(super) fn row(
        &mut self,
        candidate: Candidate,
        study: &Study,
        watch: &mut impl Watch,
    ) -> Option<Row> {
        let question = Question::of(&candidate.solver)?;
        let own = question == study.question;
        let reference = if own {
            &study.reference
        } else {
            study.other.as_ref()?
        };
        let run = self.run(&candidate, study.frames, watch).ok()?;
        if self.interrupted || (run.cut_short && !run.stopped) {
            return None;
        }
        let error = Distance::between(reference.frames(), &run.frames);
        // Not `>`, which a NaN would pass.
        let lost = run.stopped || !(error.max <= self.length);
        let status = match (lost, run.converged) {
            (true, _) => Status::Diverged,
            (false, true) => Status::Converged,
            (false, false) => Status::NotConverged,
        };
        Some(Row {
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
            ..Row::new(candidate, status)
        })
    }

    /// The front again for its spread, and the fastest recommended setting on one lane and on one thread.
    fn repeat(&mut self, study: &mut Study, watch: &mut impl Watch) {
        study.front = pareto(&study.rows);
        for i in study.front.clone() {
            let mut times = vec![study.rows[i].time_s];
            watch.part(&format!("again: {}", study.rows[i].candidate.in_words()));
            while times.len() < REPEATS && times[0] < self.left_s() && !self.interrupted {
                let candidate = study.rows[i].candidate;
                let Ok(run) = self.run(&candidate, study.frames, watch) else {
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
        self.vary(study, watch);
        study.front = pareto(&study.rows);
        study.recommended = recommend(&study.rows, self.length);
    }

    /// What the recommended settings cost without lanes, on one thread, with other orders of a sweep and other ways to
    /// look for contact: the same error but for rounding and order, other times.
    fn vary(&mut self, study: &mut Study, watch: &mut impl Watch) {
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
            if matches!(candidate.solver, Solver::Xpbd(_)) && candidate.width != SimdWidth::One {
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
        // The finest that was found: in it a sweep and contact weigh most.
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
                        way: Some(way.name),
                        ..candidate
                    })
                });
            }
        }
        for candidate in variants {
            watch.part(&format!(
                "{}: {}, {}, threads {}{}",
                candidate.name(),
                candidate.in_words(),
                candidate.width,
                candidate.threads,
                candidate
                    .way
                    .map_or(String::new(), |way| format!(", contact by {way}"))
            ));
            if self.interrupted || self.left_s() < 0.0 {
                study.left_out.push(candidate);
            } else if let Some(row) = self.row(candidate, study, watch) {
                study.rows.push(row);
            }
        }
    }
}
