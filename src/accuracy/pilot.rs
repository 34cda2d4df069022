//! Selection of solver and settings for a requested accuracy, from a study of the scene's first
//! frames.
//!
//! The cost model decides which settings are measured, and in which order. The first frames of a
//! motion are seldom the worst. Two cheap settings therefore run over the whole scene: every
//! measured error is assumed to grow after the first frames as their distance does. (The residual
//! was tested for this purpose: it grows with the load, in the built-in hip twice as much as that
//! distance.)

use std::time::Duration;

use super::candidates::{self, Candidate, SolverQuestion};
use super::distance::FrameDistance;
use super::model::{Expected, Model};
use super::search::{floor, search, total};
use super::study::{Status, Study, StudyError, StudyOptions, StudyRow, begin};
use super::trajectory::Trajectory;
use crate::progress::Progress;
use crate::scene::{Accuracy, Scene};
use crate::simulation::Assets;

/// The chosen settings with the reason.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// Requested RMS error [m].
    pub target_m: f64,
    /// The solver and settings.
    pub candidate: Candidate,
    /// Expected error in the worst frame, including the model error and the uncertainty of the
    /// reference [m].
    pub expected_m: f64,
    /// Growth factor of errors after the frames of the study.
    pub growth: f64,
    /// Number of frames of the study.
    pub frames: usize,
    /// Description.
    pub why: String,
}

impl Chosen {
    /// True if the expected error is within the requested one.
    pub fn is_kept(&self) -> bool {
        self.expected_m <= self.target_m
    }
}

/// Ratio of two errors below which the first is clearly smaller.
const CLEARLY: f64 = 0.7;

/// Two settings that differ by less than this, relative to the length, differ by rounding.
const NOTHING: f64 = 1e-9;

/// The fastest settings within `target_m` [m] in the first frames, and the fastest that are clearly
/// more accurate.
fn cheap_settings(study: &Study, target_m: f64) -> Option<(&StudyRow, &StudyRow)> {
    let own = |row: &&StudyRow| {
        row.status != Status::Diverged
            && SolverQuestion::of(&row.candidate.solver) == Some(study.question)
    };
    let fastest = |most: f64| {
        let able = study
            .rows
            .iter()
            .filter(own)
            .filter(|row| row.error.rms <= most);
        able.min_by(|a, b| a.time_s.total_cmp(&b.time_s))
    };
    let rough = fastest(target_m).or_else(|| fastest(f64::INFINITY))?;
    Some((rough, fastest(CLEARLY * rough.error.rms)?))
}

/// Growth factor of the distance between two cheap settings over the whole scene, at least 1. The
/// settings are the fastest within `target_m` [m] in the first frames, and the fastest that is
/// clearly more accurate.
fn growth(
    scene: &Scene,
    assets: &Assets,
    study: &Study,
    target_m: f64,
    progress: &dyn Progress,
) -> Result<f64, StudyError> {
    let Some((rough, fine)) = cheap_settings(study, target_m) else {
        return Ok(1.0);
    };
    if study.frames >= scene.frames {
        return Ok(1.0);
    }
    let run = |row: &StudyRow| {
        progress.begin(&format!(
            "all frames: {}, {}",
            row.candidate.solver_key(),
            row.candidate.in_words()
        ));
        Trajectory::of(scene, assets, &row.candidate, scene.frames, &mut |_, _| {
            !progress.is_stopped()
        })
    };
    let (rough, fine) = (run(rough)?, run(fine)?);
    let first = |run: &Trajectory| run.frames[..study.frames.min(run.frames.len())].to_vec();
    let before = FrameDistance::between(&first(&rough), &first(&fine)).rms;
    if before <= NOTHING * study.length {
        let why = format!(
            "nothing happens in frames 1 to {}, for which there was time",
            study.frames
        );
        return Err(StudyError::NoReference(why));
    }
    let ratio = FrameDistance::between(&rough.frames, &fine.frames).rms / before;
    // Not `f64::max`, which would hide a NaN.
    Ok(if ratio <= 1.0 { 1.0 } else { ratio })
}

/// Measures the first frames of `scene` within `budget` and chooses the fastest settings within
/// `accuracy`, or the most accurate if none is.
///
/// # Errors
/// Those of [`super::measure`], or divergence of all settings.
pub fn choose(
    scene: &Scene,
    assets: &Assets,
    accuracy: Accuracy,
    budget: Duration,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Chosen, StudyError> {
    let (mut measuring, mut study) = begin(
        scene,
        assets,
        StudyOptions {
            budget,
            frames: None,
            threads,
        },
        progress,
    )?;
    let mut model = Model::shipped(&study);
    let target_m = accuracy.length(study.length);
    search(&mut measuring, &mut study, &mut model, target_m, progress);
    // Clearly more accurate settings, for the growth.
    let rough = study
        .rows
        .iter()
        .map(total)
        .filter(|e| *e <= target_m)
        .fold(target_m, f64::min);
    search(
        &mut measuring,
        &mut study,
        &mut model,
        CLEARLY * CLEARLY * rough,
        progress,
    );
    let growth = growth(scene, assets, &study, target_m, progress)?;
    search(
        &mut measuring,
        &mut study,
        &mut model,
        target_m / growth,
        progress,
    );
    let total = |row: &StudyRow| growth * total(row);
    let able: Vec<&StudyRow> = study
        .rows
        .iter()
        .filter(|row| row.status != Status::Diverged)
        .collect();
    let fast = able
        .iter()
        .filter(|row| total(row) <= target_m)
        .min_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let frames = study.frames;
    if fast.is_none()
        && let Some((candidate, expected)) =
            foreseen(scene, &study, &model, target_m / growth, threads)
    {
        let expected_m = growth * expected.error_m * expected.doubt;
        let why = format!(
            "none of {} settings that there was time to measure keeps it; by the cost model, corrected by them, {} ({}) does: \
             {} mm at worst, {:.1} ms a frame",
            study.rows.len(),
            candidate.solver_key(),
            candidate.in_words(),
            crate::format::number(expected_m * 1e3),
            expected.time_s / frames.max(1) as f64 * 1e3
        );
        return Ok(Chosen {
            target_m,
            candidate,
            expected_m,
            growth,
            frames,
            why,
        });
    }
    let exact = able.iter().min_by(|a, b| total(a).total_cmp(&total(b)));
    let Some(row) = fast.or(exact) else {
        return Err(StudyError::NoReference("every solver diverged".to_owned()));
    };
    let found = format!(
        "{} ({}) was {} mm off in frames 1 to {frames}, is expected to be {} mm off at worst, and takes {:.1} ms a frame",
        row.candidate.solver_key(),
        row.candidate.in_words(),
        crate::format::number(row.error.rms * 1e3),
        crate::format::number(total(row) * 1e3),
        row.time_s / frames.max(1) as f64 * 1e3
    );
    let why = if fast.is_some() {
        format!(
            "the fastest of {} settings that keep it: {found}",
            study.rows.len()
        )
    } else {
        format!(
            "none of {} settings keeps it; the most accurate: {found}",
            study.rows.len()
        )
    };
    Ok(Chosen {
        target_m,
        candidate: row.candidate,
        expected_m: total(row),
        growth,
        frames,
        why,
    })
}

/// The fastest settings that the model expects within `target_m` [m] by a margin, from families
/// with a measurement.
fn foreseen(
    scene: &Scene,
    study: &Study,
    model: &Model,
    target_m: f64,
    threads: usize,
) -> Option<(Candidate, Expected)> {
    let expected = |candidate: Candidate| {
        let mut expected = model.expect(&candidate).filter(|e| e.is_corrected)?;
        expected.error_m += floor(&candidate, study)? / expected.doubt;
        (expected.error_m * expected.doubt <= target_m).then_some((candidate, expected))
    };
    let able = candidates::all(scene, threads)
        .into_iter()
        .filter_map(expected);
    able.min_by(|a, b| a.1.time_s.total_cmp(&b.1.time_s))
}
