//! Search for the cheapest settings within one target, by the cost model: best first; each run
//! corrects the expectations of the others.

use super::candidates::{self, Candidate};
use super::model::{Expected, Model};
use super::study::{Measuring, Status, Study, StudyRow};
use crate::progress::Progress;

/// A run is worthwhile if its expected time is at most this share of the best time so far.
const WORTH: f64 = 0.97;

/// If nothing else remains, an expected time may be too long by this factor.
const DOUBT_OF_TIME: f64 = 1.6;

/// Settings with a smaller ratio of their times are run again before the choice of the faster.
const CLOSE: f64 = 1.2;

/// Error including the model error and the uncertainty of the reference [m].
pub(super) fn total(row: &StudyRow) -> f64 {
    row.error.rms + row.model_error_m + row.uncertainty_m
}

/// Measures settings until none remains that could be within `target_m` [m] in less time than the
/// fastest, or the time is up. Rows of an earlier search stay and count.
pub(super) fn search(
    measuring: &mut Measuring<'_>,
    study: &mut Study,
    model: &mut Model,
    target_m: f64,
    progress: &dyn Progress,
) {
    let all = candidates::all(measuring.scene, measuring.options.threads);
    let mut tried: Vec<Candidate> = study.rows.iter().map(|row| row.candidate).collect();
    while !measuring.interrupted {
        let left: Vec<Candidate> = all.iter().copied().filter(|c| !tried.contains(c)).collect();
        let Some(next) = next(&left, study, model, target_m, measuring.left_s()) else {
            break;
        };
        tried.push(next);
        progress.begin(&format!("{}: {}", next.solver_key(), next.in_words()));
        let mut row = measuring.row(next, study, progress);
        // The very first run includes the cost of first memory accesses.
        if let Some(first) = row
            .as_ref()
            .filter(|row| study.rows.is_empty() && row.time_s <= measuring.left_s())
        {
            row = measuring.row(next, study, progress).or(Some(first.clone()));
        }
        if let Some(row) = row {
            model.learn(&row);
            study.rows.push(row);
        } else {
            study.left_out.push(next);
        }
    }
    settle(measuring, study, target_m, progress);
}

/// Model error of a solver plus the uncertainty of its reference [m], a lower bound of its total
/// error. `None` without a reference.
pub(super) fn floor(candidate: &Candidate, study: &Study) -> Option<f64> {
    let question = candidates::SolverQuestion::of(&candidate.solver)?;
    if question == study.question {
        return Some(study.reference.uncertainty.rms);
    }
    Some(study.model_distance_m + study.other.as_ref()?.uncertainty.rms)
}

fn next(
    left: &[Candidate],
    study: &Study,
    model: &Model,
    target_m: f64,
    left_s: f64,
) -> Option<Candidate> {
    let best = study
        .rows
        .iter()
        .filter(|row| keeps(row, target_m))
        .map(|row| row.time_s)
        .fold(f64::INFINITY, f64::min);
    let mut open = Vec::new();
    for candidate in left {
        if let (Some(expected), Some(floor)) = (model.expect(candidate), floor(candidate, study)) {
            open.push(Open {
                candidate: *candidate,
                expected,
                floor,
            });
        }
    }
    for doubt in [1.0, DOUBT_OF_TIME] {
        let mut hopeful: Vec<&Open> = open.iter().collect();
        hopeful.retain(|o| {
            o.floor + o.expected.error_m / o.expected.doubt <= target_m
                && o.expected.time_s / doubt <= WORTH * best
                && o.expected.time_s <= left_s
        });
        // The likely ones first, then possible surprises.
        let likely = hopeful.iter().filter(|o| o.error_m() <= target_m);
        let found = fastest(likely.copied()).or_else(|| fastest(hopeful.iter().copied()));
        if found.is_some() {
            return found;
        }
    }
    if best.is_finite() {
        return None;
    }
    // No candidate is within the target, and none is expected to be: chooses the nearest one.
    let able = open.iter().filter(|o| o.expected.time_s <= left_s);
    let least = able.min_by(|a, b| a.error_m().total_cmp(&b.error_m()))?;
    let reached = study.rows.iter().map(total).fold(f64::INFINITY, f64::min);
    (least.error_m() < reached).then_some(least.candidate)
}

/// A candidate that is not measured yet.
struct Open {
    candidate: Candidate,
    expected: Expected,
    /// Lower bound of its error [m].
    floor: f64,
}

impl Open {
    /// Expected total error [m].
    fn error_m(&self) -> f64 {
        self.floor + self.expected.error_m
    }
}

fn fastest<'a>(of: impl Iterator<Item = &'a Open>) -> Option<Candidate> {
    of.min_by(|a, b| a.expected.time_s.total_cmp(&b.expected.time_s))
        .map(|open| open.candidate)
}

/// True if a run is within the target.
fn keeps(row: &StudyRow, target_m: f64) -> bool {
    row.status != Status::Diverged && total(row) <= target_m
}

/// Repeats the runs that are about as fast as the fastest: the time is the least of both.
fn settle(
    measuring: &mut Measuring<'_>,
    study: &mut Study,
    target_m: f64,
    progress: &dyn Progress,
) {
    let best = study
        .rows
        .iter()
        .filter(|row| keeps(row, target_m))
        .map(|row| row.time_s)
        .fold(f64::INFINITY, f64::min);
    let close = |row: &StudyRow| keeps(row, target_m) && row.time_s <= CLOSE * best;
    let close: Vec<usize> = (0..study.rows.len())
        .filter(|i| close(&study.rows[*i]))
        .collect();
    if close.len() < 2 {
        return;
    }
    for i in close {
        let (candidate, time_s) = (study.rows[i].candidate, study.rows[i].time_s);
        if measuring.interrupted || time_s > measuring.left_s() {
            return;
        }
        progress.begin(&format!("again: {}", candidate.in_words()));
        if let Some(again) = measuring.row(candidate, study, progress) {
            let row = &mut study.rows[i];
            row.time_range_s = [time_s.min(again.time_s), time_s.max(again.time_s)];
            (row.time_s, row.repeats) = (row.time_range_s[0], 2);
        }
    }
}
