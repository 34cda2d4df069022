//! Solver and settings for an accuracy that the user names, from a study of the scene's first frames.
//!
//! The first frames of a motion are seldom its worst. A run of the whole scene with the cheapest setting tells by how
//! much its residual grows after them, and every measured error is taken to grow so.

use std::time::Duration;

use super::candidates::{Candidate, Question};
use super::study::{Options, Row, Status, Study, StudyError, Watch, measure};
use super::trajectory::Trajectory;
use crate::scene::{Accuracy, Scene};
use crate::simulation::Assets;

/// What was chosen, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// The error asked for, RMS [m].
    pub target_m: f64,
    /// The solver and settings.
    pub candidate: Candidate,
    /// Error expected in the worst frame, with what the solver leaves out and what the reference may be off [m].
    pub expected_m: f64,
    /// By how much residuals grow after the frames of the study.
    pub growth: f64,
    /// Error for each metre of residual, as measured.
    pub per_residual: f64,
    /// The part of the error that no residual shows [m].
    pub fixed_m: f64,
    /// Frames of the study.
    pub frames: usize,
    /// In words.
    pub why: String,
}

impl Chosen {
    /// The error of a whole run, from its greatest residual [m].
    pub fn estimate(&self, residual_max_m: f64) -> f64 {
        self.per_residual * residual_max_m + self.fixed_m
    }

    /// Whether an estimate keeps what was asked for.
    pub fn keeps(&self, estimate_m: f64) -> bool {
        estimate_m <= self.target_m
    }
}

/// Error in the worst frame, with what the solver leaves out and what the reference may be off [m].
fn total(study: &Study, row: &Row, growth: f64) -> f64 {
    growth * row.error.rms + row.model_error_m + study.reference.uncertainty.rms
}

/// By how much the residual of the cheapest setting grows over the whole scene, at least 1.
fn growth(scene: &Scene, assets: &Assets, study: &Study, watch: &mut impl Watch) -> Result<f64, StudyError> {
    let own =
        |row: &&Row| row.status != Status::Diverged && Question::of(&row.candidate.solver) == Some(study.question);
    let Some(row) = study.rows.iter().filter(own).min_by(|a, b| a.time_s.total_cmp(&b.time_s)) else { return Ok(1.0) };
    if study.frames >= scene.frames || !(row.residual_m > 0.0) {
        return Ok(1.0);
    }
    watch.part(&format!("all frames at the least cost: {}, {}", row.candidate.name(), row.candidate.in_words()));
    let run = Trajectory::of(scene, assets, &row.candidate, scene.frames, &mut |_, _| !watch.stops())?;
    // Not `f64::max`, which would hide a NaN.
    let ratio = run.residual_m / row.residual_m;
    Ok(if ratio <= 1.0 { 1.0 } else { ratio })
}

/// Measures the first frames of `scene` within `budget` and chooses the fastest setting that keeps `accuracy`, or the
/// most accurate where none does.
///
/// # Errors
/// As [`measure`]; or every setting diverged.
pub fn choose(
    scene: &Scene,
    assets: &Assets,
    accuracy: Accuracy,
    budget: Duration,
    threads: usize,
    watch: &mut impl Watch,
) -> Result<Chosen, StudyError> {
    let study = measure(scene, assets, Options { budget, frames: None, threads }, watch)?;
    let target_m = accuracy.length(study.length);
    let growth = growth(scene, assets, &study, watch)?;
    let total = |row: &Row| total(&study, row, growth);
    let able: Vec<&Row> = study.rows.iter().filter(|row| row.status != Status::Diverged).collect();
    let fast = able.iter().filter(|row| total(row) <= target_m).min_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let exact = able.iter().min_by(|a, b| total(a).total_cmp(&total(b)));
    let Some(row) = fast.or(exact) else {
        return Err(StudyError::NoReference("every solver diverged".to_owned()));
    };
    let found = format!(
        "{} ({}) was {} mm off in frames 1 to {}, is expected to be {} mm off at worst, and takes {:.1} ms a frame",
        row.candidate.name(),
        row.candidate.in_words(),
        crate::render::number(row.error.rms * 1e3),
        study.frames,
        crate::render::number(total(row) * 1e3),
        row.time_s / study.frames.max(1) as f64 * 1e3
    );
    let why = if fast.is_some() {
        format!("the fastest of {} settings that keep it: {found}", study.rows.len())
    } else {
        format!("none of {} settings keeps it; the most accurate: {found}", study.rows.len())
    };
    Ok(Chosen {
        target_m,
        candidate: row.candidate,
        expected_m: total(row),
        growth,
        per_residual: if row.residual_m > 0.0 { row.error.rms / row.residual_m } else { 0.0 },
        fixed_m: row.model_error_m + study.reference.uncertainty.rms,
        frames: study.frames,
        why,
    })
}
