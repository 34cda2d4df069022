//! Parameters of muscles for a model, from volume and fibres.

use super::model::{Model, ModelMuscle};

/// Specific tension of muscle \[Pa\]: least, usual and greatest. The usual one is that of the model of
/// \[rajagopal2016\], the least that of isolated muscles \[powell1984\], the greatest that of a model
/// of the leg \[arnold2010\].
pub const SPECIFIC_TENSION: [f64; 3] = [0.225e6, 0.60e6, 0.61e6];
/// Lengths of fibres at rest relative to the optimal ones, where nothing tells more: those of
/// sarcomeres of leg muscles are 0.8 to 1.2 \[ward2009\].
const AT_REST: [f64; 2] = [0.8, 1.2];
/// Least range of normalised lengths over the samples of a mapping.
const LEAST_RANGE: f64 = 0.05;
/// Standard errors of an interval that contains 95 %.
const TWO_SIDED: f64 = 1.96;

/// Parameters of a muscle, each as the lower end of its interval, its value and the upper end.
#[derive(Clone, Debug, PartialEq)]
pub struct MuscleParameters {
    /// Absolute path of the force.
    pub force: String,
    /// Maximum isometric force \[N\].
    pub max_isometric_force: [f64; 3],
    /// Optimal fibre length [m].
    pub optimal_fibre_length: [f64; 3],
    /// Tendon slack length [m] for a path that has the length of the fibres; `None` where nothing
    /// tells it.
    pub tendon_slack_length: Option<[f64; 3]>,
    /// Mean pennation angle of the fibres at rest \[rad\].
    pub pennation: f64,
}

impl MuscleParameters {
    /// Parameters of a force whose fibres have a physiological cross-sectional area [m2], lengths at
    /// rest [m] and a mean pennation angle \[rad\]. `mapped` are mean lengths of the fibres [m] in some
    /// samples, each with the normalised length of the model's own muscle there, see
    /// [`normalised_lengths`]: optimal fibre length and tendon slack length are those with which the
    /// fibres have the same normalised lengths, by least squares \[modenese2016\]. Without
    /// samples, fibres are taken to have 0.8 to 1.2 of their optimal length at rest.
    pub fn new(
        force: &str,
        area: f64,
        at_rest: &[f64],
        pennation: f64,
        mapped: &[(f64, f64)],
    ) -> Self {
        let mean = at_rest.iter().sum::<f64>() / at_rest.len() as f64;
        let line = line(mapped).filter(|([slope, _], _)| *slope > 0.0);
        let by_rest = [mean / AT_REST[1], mean, mean / AT_REST[0]];
        let around =
            |value: f64, error: f64| [value - TWO_SIDED * error, value, value + TWO_SIDED * error];
        Self {
            force: force.to_owned(),
            max_isometric_force: SPECIFIC_TENSION.map(|tension| tension * area),
            optimal_fibre_length: line.map_or(by_rest, |([slope, _], [e, _])| around(slope, e)),
            tendon_slack_length: line.map(|([_, constant], [_, e])| around(constant, e)),
            pennation,
        }
    }

    /// True if lengths are mapped from a muscle of the model.
    pub fn is_mapped(&self) -> bool {
        self.tendon_slack_length.is_some()
    }
}

/// Slope and constant of the line through some points `(y, x)` by least squares, and their standard
/// errors; `None` for too few points, or too small a range of `x`.
fn line(points: &[(f64, f64)]) -> Option<([f64; 2], [f64; 2])> {
    let n = points.len() as f64;
    let means = [
        points.iter().map(|p| p.1).sum::<f64>() / n,
        points.iter().map(|p| p.0).sum::<f64>() / n,
    ];
    let (mut square, mut both) = (0.0, 0.0);
    let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
    for (y, x) in points {
        square += (x - means[0]).powi(2);
        both += (x - means[0]) * (y - means[1]);
        [low, high] = [f64::min(low, *x), f64::max(high, *x)];
    }
    if points.len() < 3 || !(high - low >= LEAST_RANGE) || !(square > 0.0) {
        return None;
    }
    let slope = both / square;
    let constant = means[1] - slope * means[0];
    let left = points
        .iter()
        .map(|(y, x)| (y - constant - slope * x).powi(2));
    let variance = left.sum::<f64>() / (n - 2.0);
    let of_slope = (variance / square).sqrt();
    let of_constant = (variance * (1.0 / n + means[0] * means[0] / square)).sqrt();
    let found = ([slope, constant], [of_slope, of_constant]);
    found
        .0
        .iter()
        .chain(&found.1)
        .all(|v| v.is_finite())
        .then_some(found)
}

/// Length of a muscle's fibres along its tendon, relative to the optimal fibre length, in each pose of
/// a model, with a tendon that does not stretch. `None` for a muscle whose path is more than a polyline
/// through its points, for one without parameters, and where it is slack in a pose.
pub fn normalised_lengths(
    model: &Model,
    muscle: &ModelMuscle,
    poses: &[Vec<f64>],
) -> Option<Vec<f64>> {
    let usable = muscle.is_polyline && muscle.points.len() > 1 && muscle.optimal_fibre_length > 0.0;
    let of = |values: &Vec<f64>| {
        let length = model.straight_length(muscle, &model.poses(values));
        let along = (length - muscle.tendon_slack_length) / muscle.optimal_fibre_length;
        Some(along).filter(|along| *along > 0.0)
    };
    usable.then(|| poses.iter().map(of).collect())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_its_slope_its_constant_and_their_errors() {
        let points: Vec<(f64, f64)> = (0..20)
            .map(|k| {
                let x = 0.6 + 0.04 * f64::from(k);
                (0.02 + 0.11 * x + if k % 2 == 0 { 1e-4 } else { -1e-4 }, x)
            })
            .collect();
        let ([slope, constant], [e, f]) = line(&points).expect("a line");
        assert!((slope - 0.11).abs() <= 3.0 * e && (constant - 0.02).abs() <= 3.0 * f);
        assert!(e > 1e-5 && e < 1e-3 && f > 1e-5 && f < 1e-3, "{e} {f}");
        assert!(line(&points[..2]).is_none());
        let narrow: Vec<(f64, f64)> = points.iter().map(|(y, x)| (*y, 1.0 + 0.01 * x)).collect();
        assert!(line(&narrow).is_none());
    }

    #[test]
    fn lengths_are_mapped_where_samples_tell_and_else_by_rest() {
        let samples: Vec<(f64, f64)> = (0..10)
            .map(|k| {
                (
                    0.03 + 0.1 * (0.7 + 0.06 * f64::from(k)),
                    0.7 + 0.06 * f64::from(k),
                )
            })
            .collect();
        let mapped = MuscleParameters::new("/forceset/m", 1e-3, &[0.1, 0.12], 0.2, &samples);
        assert!(mapped.is_mapped() && (mapped.optimal_fibre_length[1] - 0.1).abs() <= 1e-12);
        assert!(
            mapped
                .tendon_slack_length
                .is_some_and(|l| (l[1] - 0.03).abs() <= 1e-12)
        );
        assert_eq!(mapped.max_isometric_force, [225.0, 600.0, 610.0]);
        let by_rest = MuscleParameters::new("/forceset/m", 1e-3, &[0.1, 0.12], 0.2, &[]);
        assert!(!by_rest.is_mapped() && (by_rest.optimal_fibre_length[1] - 0.11).abs() <= 1e-15);
        // A muscle that shortens where the model's lengthens maps to nothing.
        let turned: Vec<(f64, f64)> = samples.iter().map(|(y, x)| (-y, *x)).collect();
        assert!(!MuscleParameters::new("/forceset/m", 1e-3, &[0.1], 0.2, &turned).is_mapped());
    }
}
