//! A cost model: expected time and error of settings in a scene, fitted to sweeps over other scenes
//! and corrected by measurements in this one.
//!
//! Within a family of settings, the logarithms of time and error are linear in those of the steps
//! per frame and of the varied setting. A part of the time is independent of the steps: a fitted
//! number of extra steps represents it. Scenes and machines differ by factors, which cancel in the
//! fit; a first run of the family gives them.

use nalgebra::{DMatrix, DVector};

use super::candidates::Candidate;
use super::study::{Status, Study, StudyRow};
use crate::constraints::SweepOrder;
use crate::scene::solvers::{ENOUGH_ITERATIONS, SOLVERS};
use crate::scene::{SolverQuestion, SolverSpec};

/// The sweeps of the shipped model's fit, as written by `pliant accuracy`; `docs/accuracy.md` lists
/// them.
const SWEEPS: &str = include_str!("sweeps.csv");

/// Settings whose times and errors follow one law: those of one solver. Equilibria with limited
/// iterations are a separate family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Family {
    solver: &'static str,
    is_limited: bool,
}

impl Family {
    /// The family of a solver's settings, and the setting that varies in it; `None` for settings
    /// that no model describes.
    fn of(
        spec: &SolverSpec,
        iterations: f64,
        order: &str,
        tolerance: Option<f64>,
    ) -> Option<(Self, f64)> {
        let question = spec.question?;
        let solver = spec.key;
        let Some(tolerance) = tolerance else {
            let family = Self {
                solver,
                is_limited: false,
            };
            return (order == SweepOrder::Coloured.name()).then_some((family, iterations));
        };
        let is_limited =
            question == SolverQuestion::Equilibrium && iterations < f64::from(ENOUGH_ITERATIONS);
        let setting = if is_limited {
            iterations
        } else {
            1.0 / tolerance
        };
        Some((Self { solver, is_limited }, setting))
    }

    /// Every family that may have runs.
    fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for spec in &SOLVERS {
            for is_limited in [false, true] {
                all.push(Self {
                    solver: spec.key,
                    is_limited,
                });
            }
        }
        all
    }
}

/// Steps per frame, and the varied setting.
type Features = [f64; 2];

/// Candidate numbers of extra steps.
const EXTRA: [f64; 8] = [0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];

/// A run as known to the model.
#[derive(Clone, Debug, PartialEq)]
struct Known {
    scene: String,
    family: Family,
    features: Features,
    /// Logarithm of the time per frame and vertex [s].
    time: f64,
    /// Logarithm of the error relative to the motion of the vertices; not finite if unknown.
    error: f64,
}

/// A linear function of the logarithms of the features.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Line {
    at_zero: f64,
    slopes: [f64; 2],
    /// Number of extra steps.
    extra: f64,
    /// Root mean square of the differences between scenes.
    spread: f64,
}

/// Expected result of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Time of all compared frames [s].
    pub time_s: f64,
    /// RMS error of the worst frame [m].
    pub error_m: f64,
    /// Plausible factor of the error.
    pub doubt: f64,
    /// True if a measured error in this scene has corrected the expectation.
    pub is_corrected: bool,
}

/// The model for one scene.
#[derive(Clone, Debug)]
pub struct Model {
    lines: Vec<(Family, Line, Line)>,
    vertices: f64,
    moved_m: f64,
    learned: Vec<Known>,
}

fn family(candidate: &Candidate) -> Option<(Family, Features)> {
    let solver = candidate.solver;
    let tolerance = solver.minimisation().map(|s| s.tolerance);
    let iterations = f64::from(solver.iterations());
    let (family, setting) =
        Family::of(solver.spec(), iterations, solver.order().name(), tolerance)?;
    Some((family, [f64::from(solver.substeps()), setting]))
}

impl Model {
    /// The shipped model for the scene of a study.
    pub fn shipped(study: &Study) -> Self {
        Self::fitted(&read(SWEEPS), study)
    }

    fn fitted(known: &[Known], study: &Study) -> Self {
        let mut lines = Vec::new();
        for family in Family::all() {
            let time = line_of(known, family, &EXTRA, time);
            let error = line_of(known, family, &[0.0], error);
            lines.push((family, time, error));
        }
        let work = study.vertices as f64 * study.frames as f64;
        Self {
            lines,
            vertices: work,
            moved_m: study.moved_m,
            learned: Vec::new(),
        }
    }

    /// Expected time and error; `None` for settings without a family.
    pub fn expect(&self, candidate: &Candidate) -> Option<Expected> {
        let (family, features) = family(candidate)?;
        let (_, time, error) = self.lines.iter().find(|(f, ..)| *f == family)?;
        let own = self.learned.iter().filter(|k| k.family == family);
        let nearest = own
            .min_by(|a, b| apart(&a.features, &features).total_cmp(&apart(&b.features, &features)));
        // The speed of a machine is assumed to be the same factor in all families.
        let speed = nearest
            .map(|k| k.time - time.at(&k.features))
            .unwrap_or_else(|| self.speed());
        let found = nearest.filter(|k| k.error.is_finite());
        let off = found.map_or(0.0, |k| k.error - error.at(&k.features));
        let doubt = found.map_or(error.spread, |k| {
            NEAR * (1.0 + apart(&k.features, &features)).min(FURTHEST)
        });
        Some(Expected {
            time_s: libm::exp(time.at(&features) + speed) * self.vertices,
            error_m: libm::exp(error.at(&features) + off) * self.moved_m,
            doubt: libm::exp(doubt),
            is_corrected: found.is_some(),
        })
    }

    /// Adds a measured run.
    pub fn learn(&mut self, row: &StudyRow) {
        let Some((family, features)) = family(&row.candidate) else {
            return;
        };
        let time = libm::log(row.time_s / self.vertices);
        let error = if row.status == Status::Diverged {
            f64::NAN
        } else {
            libm::log(row.error.rms / self.moved_m)
        };
        if time.is_finite() {
            self.learned.push(Known {
                scene: String::new(),
                family,
                features,
                time,
                error,
            });
        }
    }

    fn speed(&self) -> f64 {
        let off = |k: &Known| {
            let line = self.lines.iter().find(|(f, ..)| *f == k.family);
            k.time - line.map_or(k.time, |(_, time, _)| time.at(&k.features))
        };
        self.learned.iter().map(off).sum::<f64>() / self.learned.len().max(1) as f64
    }
}

/// Logarithm of the plausible factor of an error corrected by a near measurement, and its multiple
/// for settings far from any measurement.
const NEAR: f64 = 0.25;
const FURTHEST: f64 = 4.0;

impl Line {
    fn at(&self, features: &Features) -> f64 {
        let [steps, setting] = logarithms(features, self.extra);
        self.at_zero + self.slopes[0] * steps + self.slopes[1] * setting
    }
}

fn logarithms([steps, setting]: &Features, extra: f64) -> [f64; 2] {
    [libm::log(steps + extra), libm::log(*setting)]
}

fn apart(a: &Features, b: &Features) -> f64 {
    let (a, b) = (logarithms(a, 0.0), logarithms(b, 0.0));
    (a[0] - b[0]).abs() + (a[1] - b[1]).abs()
}

fn time(known: &Known) -> f64 {
    known.time
}

fn error(known: &Known) -> f64 {
    known.error
}

/// The best line of a family for the given numbers of extra steps.
fn line_of(known: &[Known], family: Family, extra: &[f64], of: fn(&Known) -> f64) -> Line {
    let these: Vec<&Known> = known
        .iter()
        .filter(|k| k.family == family && of(k).is_finite())
        .collect();
    let lines = extra.iter().map(|extra| fit(&these, *extra, of));
    lines
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(Line::default(), |(line, _)| line)
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    values.for_each(|v| (sum, count) = (sum + v, count + 1));
    sum / f64::from(count.max(1))
}

/// Least squares with a separate constant for each scene, whose mean is `at_zero`. Returns also the
/// residual sum of squares.
fn fit(known: &[&Known], extra: f64, of: fn(&Known) -> f64) -> (Line, f64) {
    let mut scenes: Vec<&str> = known.iter().map(|k| k.scene.as_str()).collect();
    scenes.sort_unstable();
    scenes.dedup();
    let of_scene = |scene: &str| {
        known
            .iter()
            .copied()
            .filter(|k| k.scene == scene)
            .collect::<Vec<_>>()
    };
    let (mut rows, mut right_side) = (Vec::new(), Vec::new());
    let mut centres = Vec::new();
    for scene in scenes {
        let these = of_scene(scene);
        let centre = [0, 1].map(|i| mean(these.iter().map(|k| logarithms(&k.features, extra)[i])));
        let height = mean(these.iter().map(|k| of(k)));
        for k in these {
            let features = logarithms(&k.features, extra);
            rows.extend([features[0] - centre[0], features[1] - centre[1]]);
            right_side.push(of(k) - height);
        }
        centres.push((centre, height));
    }
    if centres.is_empty() {
        return (Line::default(), 0.0);
    }
    // A feature that never varies gets the slope of least norm.
    let (matrix, right_side) = (
        DMatrix::from_row_slice(right_side.len(), 2, &rows),
        DVector::from_vec(right_side),
    );
    let svd = matrix.clone().svd(true, true);
    let least = 1e-9 * svd.singular_values.max();
    let slopes = svd
        .solve(&right_side, least)
        .map_or([0.0; 2], |s| [s[0], s[1]]);
    let left = (matrix * DVector::from_row_slice(&slopes) - right_side).norm_squared();
    let constant =
        |(centre, height): &([f64; 2], f64)| height - slopes[0] * centre[0] - slopes[1] * centre[1];
    let at_zero = mean(centres.iter().map(constant));
    let spread = mean(centres.iter().map(|c| (constant(c) - at_zero).powi(2))).sqrt();
    (
        Line {
            at_zero,
            slopes,
            extra,
            spread,
        },
        left,
    )
}

/// The runs of a table of `pliant accuracy`, without those that diverged or vary lanes, orders or
/// methods of contact search.
fn read(csv: &str) -> Vec<Known> {
    let mut lines = csv.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    lines.filter_map(|line| known(&header, line)).collect()
}

/// The run of one line; `None` if it is left out or incomplete.
fn known(header: &[&str], line: &str) -> Option<Known> {
    let fields: Vec<&str> = line.split(',').collect();
    let text = |name: &str| {
        let column = header.iter().position(|h| *h == name)?;
        fields.get(column).copied()
    };
    let value = |name: &str| text(name)?.parse::<f64>().ok();
    let (steps, iterations) = (value("substeps")?, value("iterations")?);
    let spec = SolverSpec::named(text("solver")?)?;
    let (family, setting) = Family::of(spec, iterations, text("order")?, value("tolerance"))?;
    if text("status")? == "diverged"
        || text("contact")? != super::candidates::HIERARCHY
        || text("lanes")? == "1"
    {
        return None;
    }
    let time = libm::log(value("time_s")? / (value("vertices")? * value("frames")?));
    let error = libm::log(value("rms_error_m")? / value("moved_m")?);
    // An error below the reference's uncertainty is meaningless.
    let error = if text("certain")? == "true" {
        error
    } else {
        f64::NAN
    };
    let features = [steps, setting];
    Some(Known {
        scene: text("scene")?.to_owned(),
        family,
        features,
        time,
        error,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SWEEPS_OF_XPBD: Family = Family {
        solver: "xpbd",
        is_limited: false,
    };

    /// Times with eight extra steps.
    fn known(scene: &str, features: Features, factor: f64) -> Known {
        let ([steps, setting], more) = (logarithms(&features, 0.0), libm::log(features[0] + 8.0));
        let time = 0.9 * more + 0.4 * setting + factor;
        let error = -1.1 * steps - 0.3 * setting - 2.0 * factor;
        Known {
            scene: scene.to_owned(),
            family: SWEEPS_OF_XPBD,
            features,
            time,
            error,
        }
    }

    #[test]
    fn slopes_are_found_whatever_the_scenes_differ_by() {
        let mut all = Vec::new();
        for (scene, factor) in [("a", -1.0), ("b", 2.0)] {
            for features in [[1.0, 1.0], [4.0, 1.0], [16.0, 3.0], [64.0, 2.0]] {
                all.push(known(scene, features, factor));
            }
        }
        let line = line_of(&all, SWEEPS_OF_XPBD, &EXTRA, time);
        assert!(
            (line.slopes[0] - 0.9).abs() <= 1e-12 && (line.slopes[1] - 0.4).abs() <= 1e-12,
            "{line:?}"
        );
        assert!(
            (line.at_zero - 0.5).abs() <= 1e-12 && (line.spread - 1.5).abs() <= 1e-12,
            "{line:?}"
        );
        assert_eq!(line.extra, 8.0);
        // Controls: without extra steps, or with one perturbed number, the slope differs.
        assert!((line_of(&all, SWEEPS_OF_XPBD, &[0.0], time).slopes[0] - 0.9).abs() > 0.01);
        all[5].time += 1.0;
        assert!((line_of(&all, SWEEPS_OF_XPBD, &[8.0], time).slopes[0] - 0.9).abs() > 0.01);
    }

    #[test]
    fn a_feature_that_never_varies_has_no_slope_and_nothing_has_no_line() {
        let all: Vec<Known> = [[1.0, 3.0], [2.0, 3.0], [4.0, 3.0]]
            .map(|f| known("a", f, 0.0))
            .to_vec();
        let line = line_of(&all, SWEEPS_OF_XPBD, &[0.0], error);
        assert!(
            (line.slopes[0] + 1.1).abs() <= 1e-12 && line.slopes[1] == 0.0,
            "{line:?}"
        );
        assert_eq!(line_of(&[], SWEEPS_OF_XPBD, &EXTRA, time), Line::default());
    }

    #[test]
    fn the_shipped_sweeps_are_of_several_scenes_and_more_work_takes_longer_and_errs_less() {
        let all = read(SWEEPS);
        let mut families: Vec<Family> = all.iter().map(|k| k.family).collect();
        families.dedup();
        families.sort_unstable_by_key(|f| (f.solver, f.is_limited));
        families.dedup();
        let limited = |f: &&Family| f.is_limited;
        assert_eq!(
            (families.len(), families.iter().filter(limited).count()),
            (4, 1)
        );
        for family in families {
            let these: Vec<&Known> = all
                .iter()
                .filter(|k| k.family == family && k.error.is_finite())
                .collect();
            let mut scenes: Vec<&str> = these.iter().map(|k| k.scene.as_str()).collect();
            scenes.dedup();
            assert!(
                scenes.len() >= 3 && these.len() >= 9,
                "{family:?}: {} of {scenes:?}",
                these.len()
            );
            let (time, error) = (
                line_of(&all, family, &EXTRA, time),
                line_of(&all, family, &[0.0], error),
            );
            assert!(
                time.slopes[1] > 0.0 && error.slopes[1] < 0.0,
                "{family:?}: {time:?} {error:?}"
            );
        }
    }
}
