//! The intervals of a result that follow from the intervals of a scene's values.
//!
//! Each value with an interval moves the equilibrium of a frame, at first order by the derivative of
//! [`Tangent`]. The change of its equations by a value is a difference of the scene with the value
//! above and below: any value of a scene is a parameter, whether it is a stiffness, a thickness, a
//! volume or a load. Where another value makes other vertices, as the base of an implant does, two whole
//! runs at the ends of the interval tell the change.
//!
//! A derivative does not know that a muscle folds in another way, or that something else touches, within
//! an interval. A run with the value at its upper end tells it: of the change by the derivative and that
//! of the run, the greater one counts.
//!
//! The values are independent: the square of half of a measure's interval is the sum of the squares that
//! each value contributes.
//!
//! *Limitations.* Between the ends of an interval nothing is looked at, and values change one at a time.

mod fit;
mod muscles;
mod skin;
mod unload;

pub use fit::{Combination, FitTarget, Fitted, FittedValue, fit};
pub use unload::{Unloaded, unload};

use std::ops::Range;

use nalgebra::{Point3, Vector3};

use super::LoadError;
use crate::mesh::TriangleMesh;
use crate::progress::Progress;
use crate::scene::{Content, SceneError, Uncertain, Variables};
use crate::solvers::{Energy, FactorError, Tangent};

/// Step of a difference, relative to half of the interval.
const STEP: f64 = 1e-3;

/// The greatest residual of a linear system that counts as solved, relative.
const SOLVED: f64 = 1e-6;

/// The greatest residual of an equilibrium, relative to the force of unit strain.
const AT_REST: f64 = 1e-3;

/// A change of a measure below this share of its value is rounding.
const NEGLIGIBLE: f64 = 1e-6;

/// Greatest number of Newton's steps from an equilibrium to a nearer one.
const POLISHES: usize = 4;

/// Why there are no intervals of a result.
#[derive(Debug, thiserror::Error)]
pub enum SensitivityError {
    /// No value of the scene has an interval.
    #[error("no value of the scene has an interval")]
    NoInterval,
    /// What was measured does not belong to the scene.
    #[error("{0}")]
    NoTarget(String),
    /// Scenes of this kind have no equilibrium.
    #[error("a scene of the kind `{0}` has no equilibrium")]
    NotSupported(&'static str),
    /// A value at an end of its interval is not allowed.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A scene with another value cannot be prepared.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// An equilibrium was not found.
    #[error("{0}")]
    Failed(String),
    /// The progress ended it.
    #[error("interrupted")]
    Interrupted,
}

/// A measure of a result with its interval.
#[derive(Clone, Debug, PartialEq)]
pub struct UncertainMeasure {
    /// The body, of a measure of one of several.
    pub body: String,
    /// Name, with its unit at the end.
    pub name: &'static str,
    /// The value.
    pub value: f64,
    /// The derivative by each parameter.
    pub slopes: Vec<f64>,
    /// The change by a run with each parameter at its upper end; NaN without a run.
    pub changes: Vec<f64>,
}

/// How much is computed beside the derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ByRuns {
    /// No run.
    Never,
    /// One run for each value, at its upper end.
    #[default]
    Check,
    /// Two runs for each value in place of the derivative.
    Instead,
}

/// The intervals of a result.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sensitivities {
    /// Index of the frame.
    pub frame: usize,
    /// The values with an interval.
    pub parameters: Vec<Uncertain>,
    /// Whether each was followed by two whole runs, and not by a derivative.
    pub by_runs: Vec<bool>,
    /// The measures.
    pub measures: Vec<UncertainMeasure>,
    /// The surface of each body at equilibrium, with half of the interval of the position of each vertex
    /// [m].
    pub bodies: Vec<(String, TriangleMesh, Vec<f64>)>,
    /// Greatest residual of a linear system, relative to its right side.
    pub residual: f64,
    /// Residual of the equilibrium, relative to the force of unit strain.
    pub left: f64,
}

impl Sensitivities {
    /// What each parameter contributes to half of the interval of a measure: the greater one of the
    /// changes by its derivative and by its run.
    pub fn parts<'a>(&'a self, of: &'a UncertainMeasure) -> impl Iterator<Item = f64> + 'a {
        let halves = self.parameters.iter().map(|parameter| parameter.half);
        let each = of.slopes.iter().zip(halves).zip(&of.changes);
        each.map(|((slope, half), change)| {
            let linear = slope * half;
            if change.abs() > linear.abs() {
                *change
            } else {
                linear
            }
        })
    }

    /// The measures that a run moves much farther than the derivative says, each with its parameter: by
    /// more than half of the whole interval.
    pub fn jumps(&self) -> Vec<(&UncertainMeasure, &Uncertain)> {
        let mut all = Vec::new();
        for measure in &self.measures {
            let rounding = NEGLIGIBLE * measure.value.abs();
            let least = f64::max(0.5 * self.half(measure), rounding);
            let each = measure.slopes.iter().zip(&measure.changes);
            for ((slope, change), parameter) in each.zip(&self.parameters) {
                if (change - slope * parameter.half).abs() > least {
                    all.push((measure, parameter));
                }
            }
        }
        all
    }

    /// Half of the interval of a measure, with a probability of 95 % if those of the parameters have it.
    pub fn half(&self, of: &UncertainMeasure) -> f64 {
        self.parts(of).map(|part| part * part).sum::<f64>().sqrt()
    }

    /// True if the equilibrium was found.
    pub fn is_at_rest(&self) -> bool {
        self.left <= AT_REST
    }

    /// True if every linear system was solved.
    pub fn is_solved(&self) -> bool {
        self.residual <= SOLVED
    }
}

/// A body with its part, its vertices there, and its triangles among its vertices.
type BodyPart = (String, usize, Range<usize>, Vec<[u32; 3]>);

/// A part of a scene at equilibrium.
struct Balanced {
    energy: Energy,
    /// Positions [m].
    x: Vec<Point3<f64>>,
}

/// A scene at the equilibrium of a frame.
trait Settled: Sized {
    /// Brings a scene to the equilibrium of a frame.
    fn settle(
        content: &Content,
        frame: usize,
        progress: &dyn Progress,
    ) -> Result<Self, SensitivityError>;

    /// How each of its parts answers.
    fn tangents(&self) -> Result<Vec<Tangent>, SensitivityError>;

    /// Residual of its equilibrium, relative to the force of unit strain.
    fn left(&self) -> f64;

    /// The parts of a similar scene where this one is; `None` if its vertices are others.
    fn similar(&self, content: &Content) -> Result<Option<Vec<Balanced>>, SensitivityError>;

    /// A similar scene at its equilibrium near this one; `None` if its vertices are others.
    fn again(
        &self,
        content: &Content,
        progress: &dyn Progress,
    ) -> Result<Option<Self>, SensitivityError>;

    /// Moves the vertices of each part.
    fn shift(&mut self, motions: &[Vec<Vector3<f64>>]);

    /// Its own parts, and the pressures in their volumes [Pa].
    fn own(&self) -> Result<Vec<Balanced>, SensitivityError>;

    /// Body, name and value of each measure, of parts at positions with pressures.
    fn measures(
        &self,
        parts: &[Balanced],
        pressures: &[Vec<f64>],
    ) -> Vec<(String, &'static str, f64)>;

    /// Each body.
    fn bodies(&self) -> Vec<BodyPart>;
}

/// The intervals of the result of a scene in a frame. Each value with an interval is read again by
/// [`Content::with_values`]; `variables` are those of its paths. `runs` says what is computed
/// beside the derivatives.
///
/// # Errors
/// See [`SensitivityError`].
pub fn sensitivities(
    content: &Content,
    frame: usize,
    runs: ByRuns,
    variables: Variables,
    progress: &dyn Progress,
) -> Result<Sensitivities, SensitivityError> {
    if content.uncertain().is_empty() {
        return Err(SensitivityError::NoInterval);
    }
    match content {
        Content::Skin(_) => found::<skin::SettledSkin>(content, frame, runs, variables, progress),
        Content::Muscles(_) => {
            found::<muscles::SettledMuscles>(content, frame, runs, variables, progress)
        }
        other => Err(SensitivityError::NotSupported(other.kind())),
    }
}

fn found<S: Settled>(
    content: &Content,
    frame: usize,
    runs: ByRuns,
    variables: Variables,
    progress: &dyn Progress,
) -> Result<Sensitivities, SensitivityError> {
    let settled = S::settle(content, frame, progress)?;
    let mut tangents = settled.tangents()?;
    let pressures: Vec<Vec<f64>> = tangents.iter().map(|r| r.pressures.clone()).collect();
    let bodies = settled.bodies();
    let mut squares: Vec<Vec<f64>> = bodies.iter().map(|b| vec![0.0; b.2.len()]).collect();
    let parts = settled.own()?;
    let own = settled.measures(&parts, &pressures);
    let mut all = Sensitivities {
        frame,
        left: settled.left(),
        parameters: content.uncertain().to_vec(),
        measures: own
            .into_iter()
            .map(|(body, name, value)| UncertainMeasure {
                body,
                name,
                value,
                slopes: Vec::new(),
                changes: Vec::new(),
            })
            .collect(),
        ..Sensitivities::default()
    };
    let count = content.uncertain().len();
    for (k, parameter) in content.uncertain().iter().enumerate() {
        if progress.report(&parameter.key, k, count).is_break() {
            return Err(SensitivityError::Interrupted);
        }
        let at = |value: f64| content.with_values(&[(&parameter.key, value)], variables);
        let step = STEP * parameter.half;
        let ends = [1.0, -1.0].map(|sign| at(parameter.value + sign * step));
        let similar = |end: Result<Content, SceneError>| match runs {
            ByRuns::Instead => Ok(None),
            _ => settled.similar(&end?),
        };
        let [above, below] = ends.map(similar);
        // A mesh changes by whole triangles: its derivative would be zero.
        let is_other = match at(parameter.value + parameter.half) {
            Ok(upper) => matches!(similar(Ok(upper)), Ok(None)),
            Err(_) => false,
        };
        let above = if is_other { Ok(None) } else { above };
        let (slopes, by_runs) = match (above, below) {
            (Ok(Some(above)), Ok(Some(below))) => {
                let ends = [above, below];
                let (slopes, motions) =
                    slopes(&settled, &mut tangents, ends, step, &mut all.residual);
                for ((_, part, range, _), squares) in bodies.iter().zip(&mut squares) {
                    let moved = motions[*part][range.clone()].iter();
                    let each = squares.iter_mut().zip(moved);
                    each.for_each(|(sum, x)| *sum += (x * parameter.half).norm_squared());
                }
                (slopes, false)
            }
            (Ok(_), Ok(_))
            | (Ok(None), _)
            | (Err(SensitivityError::Scene(_)), _)
            | (_, Err(SensitivityError::Scene(_))) => {
                let slopes = by_runs::<S>(&at, parameter, frame, progress)?;
                (slopes, true)
            }
            (Err(error), _) | (_, Err(error)) => return Err(error),
        };
        all.by_runs.push(by_runs);
        let each = all.measures.iter_mut().zip(slopes);
        each.for_each(|(measure, slope)| measure.slopes.push(slope));
        let upper = match at(parameter.value + parameter.half) {
            Ok(upper) if runs == ByRuns::Check && !by_runs => Some(upper),
            // Nothing can be run where the value is not allowed.
            _ => None,
        };
        let changed = upper
            .map(|upper| run::<S>(&upper, frame, progress))
            .transpose()?;
        for (m, measure) in all.measures.iter_mut().enumerate() {
            let value = changed.as_ref().map_or(f64::NAN, |changed| changed[m]);
            measure.changes.push(value - measure.value);
        }
    }
    for ((name, part, range, triangles), squares) in bodies.into_iter().zip(squares) {
        let vertices = parts[part].x[range].to_vec();
        let mesh = TriangleMesh {
            vertices,
            triangles,
        };
        let halves = squares.into_iter().map(f64::sqrt).collect();
        all.bodies.push((name, mesh, halves));
    }
    Ok(all)
}

/// The derivatives of the measures and of the positions of each part, between similar scenes with a
/// value above and below by `step`.
fn slopes<S: Settled>(
    settled: &S,
    tangents: &mut [Tangent],
    ends: [Vec<Balanced>; 2],
    step: f64,
    residual: &mut f64,
) -> (Vec<f64>, Vec<Vec<Vector3<f64>>>) {
    let [mut above, mut below] = ends;
    let mut motions = Vec::new();
    let (mut higher, mut lower) = (Vec::new(), Vec::new());
    for ((tangent, above), below) in tangents.iter_mut().zip(&mut above).zip(&mut below) {
        let more = tangent.balance(&above.energy, &above.x);
        let less = tangent.balance(&below.energy, &below.x);
        let mut motion = tangent.shift(&more.change_from(&less, 2.0 * step));
        // Not `f64::max`, which would hide a NaN.
        if !(motion.residual <= *residual) {
            *residual = motion.residual;
        }
        // Fixed vertices move with the value.
        let ends = motion
            .x
            .iter_mut()
            .zip(above.x.iter_mut().zip(&mut below.x));
        for (motion, (above, below)) in ends {
            let fixed = (*above - *below) / (2.0 * step);
            *above += *motion * step;
            *below -= *motion * step;
            *motion += fixed;
        }
        let at = |sign: f64| {
            let each = tangent.pressures.iter().zip(&motion.pressures);
            each.map(|(p, by)| p + sign * step * by).collect()
        };
        higher.push(at(1.0));
        lower.push(at(-1.0));
        motions.push(motion.x);
    }
    let above = settled.measures(&above, &higher);
    let below = settled.measures(&below, &lower);
    let each = above.iter().zip(&below);
    let slopes = each.map(|((.., a), (.., b))| (a - b) / (2.0 * step));
    (slopes.collect(), motions)
}

/// The derivatives of the measures by whole runs at the ends of the interval, nearer to each other where
/// an end is not allowed.
fn by_runs<S: Settled>(
    at: &dyn Fn(f64) -> Result<Content, SceneError>,
    parameter: &Uncertain,
    frame: usize,
    progress: &dyn Progress,
) -> Result<Vec<f64>, SensitivityError> {
    let mut half = parameter.half;
    let ends = loop {
        let ends = [1.0, -1.0].map(|sign| at(parameter.value + sign * half));
        match ends {
            [Ok(above), Ok(below)] => break [above, below],
            // A tenth of the interval must be allowed.
            [Err(error), _] | [_, Err(error)] if half <= 0.1 * parameter.half => {
                return Err(error.into());
            }
            _ => half *= 0.5,
        }
    };
    let [above, below] = ends.map(|content| run::<S>(&content, frame, progress));
    let (above, below) = (above?, below?);
    let each = above.iter().zip(&below);
    Ok(each.map(|(a, b)| (a - b) / (2.0 * half)).collect())
}

/// The measures of a scene in a frame.
fn run<S: Settled>(
    content: &Content,
    frame: usize,
    progress: &dyn Progress,
) -> Result<Vec<f64>, SensitivityError> {
    let settled = S::settle(content, frame, progress)?;
    let tangents = settled.tangents()?;
    let pressures: Vec<_> = tangents.into_iter().map(|r| r.pressures).collect();
    let measures = settled.measures(&settled.own()?, &pressures);
    Ok(measures.into_iter().map(|(.., value)| value).collect())
}

/// Steps of Newton's method towards the equilibrium, as long as less force is left; what touches stays.
/// Returns how each part answers there.
fn polish<S: Settled>(settled: &mut S) -> Result<Vec<Tangent>, SensitivityError> {
    let mut tangents = settled.tangents()?;
    let mut left = forces(settled, &tangents)?;
    for _ in 0..POLISHES {
        let own = settled.own()?;
        let parts = tangents.iter_mut().zip(&own);
        let steps: Vec<Vec<Vector3<f64>>> = parts
            .map(|(tangent, part)| tangent.shift(&tangent.balance(&part.energy, &part.x)).x)
            .collect();
        settled.shift(&steps);
        let next = settled.tangents()?;
        let now = forces(settled, &next)?;
        if !(now < left) {
            let back = |step: &Vec<Vector3<f64>>| step.iter().map(|x| -x).collect();
            settled.shift(&steps.iter().map(back).collect::<Vec<_>>());
            break;
        }
        (tangents, left) = (next, now);
    }
    Ok(tangents)
}

/// Sum over all parts of the squared force that is left on vertices [N^2], without what contact bears.
fn forces<S: Settled>(settled: &S, tangents: &[Tangent]) -> Result<f64, SensitivityError> {
    let own = settled.own()?;
    let each = tangents.iter().zip(&own);
    let left = each.map(|(tangent, part)| tangent.unbalanced(&part.energy, &part.x));
    Ok(left.sum())
}

fn unsolved(error: FactorError) -> SensitivityError {
    SensitivityError::Failed(format!("the equilibrium has no derivative: {error}"))
}
