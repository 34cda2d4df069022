//! Selection of the cheapest measured settings.

use super::study::{Status, StudyRow};

/// Target accuracies of the recommendations, relative to the muscles' length.
pub const TARGETS: [f64; 3] = [0.1, 0.01, 0.001];

/// The fastest row that reaches a target.
#[derive(Clone, Debug, PartialEq)]
pub struct Recommended {
    /// The target relative to the length.
    pub target: f64,
    /// Index of the row; `None` if none reached the target.
    pub row: Option<usize>,
}

/// True if a row reaches an error [m], including the model error of its solver. An error below the
/// reference's uncertainty counts as that uncertainty.
pub fn reaches(row: &StudyRow, error: f64) -> bool {
    row.status != Status::Diverged
        && row.uncertainty_m <= error
        && row.error.rms + row.model_error_m <= error
}

/// True if a scene can use these settings: other methods of contact search exist for comparison
/// only.
fn can_be_run(row: &StudyRow) -> bool {
    row.candidate.broad_phase.is_none()
}

/// The fastest row that reaches each target; `length` [m] is the scale of the targets.
pub fn recommend(rows: &[StudyRow], length: f64) -> Vec<Recommended> {
    let best = |target: f64| {
        let error = target * length;
        let able = rows
            .iter()
            .enumerate()
            .filter(|(_, row)| reaches(row, error) && can_be_run(row));
        let fastest = able.min_by(|(_, a), (_, b)| a.time_s.total_cmp(&b.time_s));
        Recommended {
            target,
            row: fastest.map(|(index, _)| index),
        }
    };
    TARGETS.iter().map(|target| best(*target)).collect()
}

/// The rows that no other row beats in both time and error, by increasing time.
pub fn pareto(rows: &[StudyRow]) -> Vec<usize> {
    let total = |i: usize| rows[i].error.rms + rows[i].model_error_m;
    let mut order: Vec<usize> = (0..rows.len())
        .filter(|i| rows[*i].status != Status::Diverged)
        .collect();
    order.sort_by(|a, b| {
        rows[*a]
            .time_s
            .total_cmp(&rows[*b].time_s)
            .then(total(*a).total_cmp(&total(*b)))
    });
    let mut least = f64::INFINITY;
    order.retain(|i| {
        let better = total(*i) < least;
        if better {
            least = total(*i);
        }
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::FrameDistance;
    use crate::accuracy::candidates::Candidate;
    use crate::scene::SolverQuestion;

    fn row(time_s: f64, rms: f64, model_error_m: f64, status: Status) -> StudyRow {
        let error = FrameDistance {
            rms,
            max: rms,
            frame: 1,
        };
        let candidate = Candidate::new(SolverQuestion::Motion.minimised(1, 1e-3), 1);
        StudyRow {
            error,
            uncertainty_m: 1e-4,
            model_error_m,
            time_s,
            ..StudyRow::new(candidate, status)
        }
    }

    #[test]
    fn the_fastest_that_reaches_a_target_is_recommended() {
        let rows = [
            row(1.0, 0.05, 0.0, Status::NotConverged),
            row(0.5, 0.001, 0.0, Status::Diverged),
            row(2.0, 0.005, 0.002, Status::Converged),
            row(1.5, 0.009, 0.002, Status::Converged),
            row(9.0, 0.0005, 0.0, Status::Converged),
            row(0.1, f64::NAN, 0.0, Status::NotConverged),
        ];
        let chosen = |rows: &[StudyRow]| {
            recommend(rows, 1.0)
                .iter()
                .map(|r| r.row)
                .collect::<Vec<_>>()
        };
        assert_eq!(chosen(&rows), [Some(0), Some(2), Some(4)]);
        let doubtful = rows.map(|row| StudyRow {
            uncertainty_m: 0.002,
            ..row
        });
        assert_eq!(
            chosen(&doubtful),
            [Some(0), Some(2), None],
            "the reference is not certain enough"
        );
    }

    #[test]
    fn the_front_falls_with_time() {
        let rows = [
            row(1.0, 0.05, 0.0, Status::Converged),
            row(2.0, 0.06, 0.0, Status::Converged),
            row(3.0, 0.01, 0.0, Status::Converged),
            row(0.1, 0.001, 0.0, Status::Diverged),
            row(0.2, f64::NAN, 0.0, Status::Converged),
        ];
        assert_eq!(pareto(&rows), [0, 2]);
    }
}
