//! Values of a scene from a measured shape: the Gauss-Newton method in their logarithms.
//!
//! The misfit is the sum of the squared distances of a body from its measured shape, in units of the
//! noise, of those of measured numbers, and of the logarithms of the values from the middle of their
//! intervals. Each round finds the equilibrium with the present values, and how it moves with each. The
//! inverse of the misfit's second derivative is the covariance of the logarithms.
//!
//! The singular values of the motions, in units of the noise and of the intervals, tell what a shape can
//! tell: a combination of values below one is known from its interval only. Where bones move as
//! prescribed and no force is known, all stiffnesses times a number give the same shape.

use nalgebra::{DMatrix, DVector, Point3, Vector3};

use super::{Balanced, BodyPart, SensitivityError, Settled, muscles, polish, skin, slopes};
use super::{SOLVED, STEP};
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;
use crate::progress::Progress;
use crate::scene::{Content, Uncertain, Variables};
use crate::solvers::Tangent;

/// Standard deviations in half of an interval that has a probability of 95 %.
const HALF: f64 = 1.959_963_984_540_054;

/// Greatest number of rounds.
const ROUNDS: usize = 30;

/// A step of all logarithms below this ends the fit.
const STILL: f64 = 1e-7;

/// A decrease of the misfit below this, relative to it, ends the fit.
const FLAT: f64 = 1e-10;

/// A step that promises less than this decrease of the misfit, a ten-thousandth of a standard deviation, ends
/// the fit.
const DONE: f64 = 1e-8;

/// Where no step helps, a fit has converged if the step promised less than this decrease of the misfit: a
/// tenth of a standard deviation.
const CLOSE: f64 = 0.01;

/// Greatest step of a logarithm in a round.
const LONGEST: f64 = 1.0;

/// Greatest number of halvings of a step.
const HALVINGS: usize = 8;

/// What was measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitTarget {
    /// The measured shape of a body, by its name: the same vertices in the same order, or another
    /// surface.
    pub shapes: Vec<(String, TriangleMesh)>,
    /// Standard deviation of each coordinate of a vertex [m]; `None`: what is left over tells it.
    pub noise: Option<f64>,
    /// Measured numbers: body and name of a measure, its value, and half of its interval.
    pub numbers: Vec<(String, String, f64, f64)>,
    /// Whether the intervals of the scene count as known beforehand.
    pub has_prior: bool,
}

/// A value that was fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedValue {
    /// The value of the scene with its interval.
    pub of: Uncertain,
    /// The fitted value.
    pub value: f64,
    /// Ends of its interval, with a probability of 95 %.
    pub interval: [f64; 2],
    /// Ratio of its interval to that of the scene, in logarithms: one if nothing was learned.
    pub share: f64,
}

/// A direction of all logarithms, and how well the shape tells it.
#[derive(Clone, Debug, PartialEq)]
pub struct Combination {
    /// Standard deviation of the interval of the scene over that by the measurement alone.
    pub known: f64,
    /// The exponent of each value.
    pub exponents: Vec<f64>,
}

/// The result of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fitted {
    /// The values.
    pub values: Vec<FittedValue>,
    /// Combinations of the values, the best known first.
    pub combinations: Vec<Combination>,
    /// Misfit after each round, in squared standard deviations.
    pub rounds: Vec<f64>,
    /// True if the last round moved nothing.
    pub converged: bool,
    /// Standard deviation of each coordinate [m], given or found.
    pub noise: f64,
    /// What is left of each coordinate, as a standard deviation [m].
    pub left: f64,
    /// The distance of each body from its measured shape: name, surface, distance of each vertex [m].
    pub bodies: Vec<(String, TriangleMesh, Vec<f64>)>,
    /// Measured numbers: body, name, measured, fitted.
    pub numbers: Vec<(String, String, f64, f64)>,
}

impl Fitted {
    /// The combinations of which the measurement tells less than the intervals of the scene.
    pub fn unknown(&self) -> impl Iterator<Item = &Combination> {
        self.combinations.iter().filter(|c| !(c.known >= 1.0))
    }
}

/// Fits the values of a scene that have an interval to what was measured in a frame.
///
/// # Errors
/// See [`SensitivityError`]; also a value that is not positive, a body or a measure of another name, and
/// a target without anything measured.
pub fn fit(
    content: &Content,
    frame: usize,
    target: &FitTarget,
    variables: Variables,
    progress: &dyn Progress,
) -> Result<Fitted, SensitivityError> {
    if content.uncertain().is_empty() {
        return Err(SensitivityError::NoInterval);
    }
    if target.shapes.is_empty() && target.numbers.is_empty() {
        return Err(SensitivityError::NoTarget(
            "nothing was measured".to_owned(),
        ));
    }
    if let Some(low) = content.uncertain().iter().find(|u| !(u.value > 0.0)) {
        let message = format!("{} is not positive, and a fit is in logarithms", low.key);
        return Err(SensitivityError::NoTarget(message));
    }
    match content {
        Content::Skin(_) => {
            Search::<skin::SettledSkin>::run(content, frame, target, variables, progress)
        }
        Content::Muscles(_) => {
            Search::<muscles::SettledMuscles>::run(content, frame, target, variables, progress)
        }
        other => Err(SensitivityError::NotSupported(other.kind())),
    }
}

/// A measured shape of a body.
enum Shape {
    /// The same vertices.
    Same(Vec<Point3<f64>>),
    /// Another surface.
    Surface(Box<SurfaceTree>),
}

/// A displacement of the vertices of a part.
type Field = Vec<Vector3<f64>>;

/// For each logarithm the displacement of each part, and the derivative of each measure.
type Motions = (Vec<Vec<Field>>, Vec<Vec<f64>>);

/// A fit on its way.
struct Search<'a, S> {
    content: &'a Content,
    target: &'a FitTarget,
    variables: Variables,
    progress: &'a dyn Progress,
    /// Each shape with the body among those of the scene.
    shapes: Vec<(usize, Shape)>,
    /// Each number with its measure.
    numbers: Vec<usize>,
    /// Logarithms of the values at the start, and standard deviations of their intervals.
    prior: Vec<(f64, f64)>,
    settled: S,
}

/// What is left at some values: shapes in metres, numbers in standard deviations; and its derivative by
/// each logarithm.
struct Left {
    shapes: DVector<f64>,
    shape_slopes: DMatrix<f64>,
    numbers: DVector<f64>,
    number_slopes: DMatrix<f64>,
}

impl Left {
    /// Standard deviation of what is left of each coordinate [m], after this number of values was fitted.
    fn deviation(&self, values: usize) -> f64 {
        let freedom = self.shapes.len().saturating_sub(values).max(1) as f64;
        (self.shapes.norm_squared() / freedom).sqrt()
    }
}

impl<S: Settled> Search<'_, S> {
    fn run(
        content: &Content,
        frame: usize,
        target: &FitTarget,
        variables: Variables,
        progress: &dyn Progress,
    ) -> Result<Fitted, SensitivityError> {
        let mut settled = S::settle(content, frame, progress)?;
        let tangents = polish(&mut settled)?;
        let mut shapes = Vec::new();
        let bodies = settled.bodies();
        for (name, mesh) in &target.shapes {
            let is = |body: &BodyPart| body.0 == *name || name.is_empty() && bodies.len() == 1;
            let k = bodies.iter().position(is);
            let k = k.ok_or_else(|| {
                let known: Vec<&str> = bodies.iter().map(|body| body.0.as_str()).collect();
                let known = known.join(", ");
                SensitivityError::NoTarget(format!("no body `{name}`; known: {known}"))
            })?;
            let (.., range, triangles) = &bodies[k];
            let is_same = mesh.vertices.len() == range.len() && mesh.triangles == *triangles;
            shapes.push((
                k,
                match is_same {
                    true => Shape::Same(mesh.vertices.clone()),
                    false => {
                        let tree = SurfaceTree::new(&mesh.vertices, &mesh.triangles);
                        Shape::Surface(Box::new(tree))
                    }
                },
            ));
        }
        let pressures: Vec<_> = tangents.iter().map(|r| r.pressures.clone()).collect();
        let measures = settled.measures(&settled.own()?, &pressures);
        let numbers = placed(target, &measures)?;
        let prior = content.uncertain().iter();
        let prior = prior.map(|u| (u.value.ln(), (1.0 + u.half / u.value).ln() / HALF));
        let search = Search {
            content,
            target,
            variables,
            progress,
            shapes,
            numbers,
            prior: prior.collect(),
            settled,
        };
        search.found(tangents)
    }

    fn at(&self, logarithms: &[f64]) -> Result<Content, SensitivityError> {
        let keys = self.content.uncertain().iter().map(|u| u.key.as_str());
        let values: Vec<(&str, f64)> = keys.zip(logarithms.iter().map(|l| l.exp())).collect();
        Ok(self.content.with_values(&values, self.variables)?)
    }

    fn found(mut self, mut tangents: Vec<Tangent>) -> Result<Fitted, SensitivityError> {
        let mut now: Vec<f64> = self.prior.iter().map(|(middle, _)| *middle).collect();
        let mut fitted = Fitted::default();
        let mut left = self.left(&now, &mut tangents)?;
        let mut noise = self.noise(&left);
        for round in 0..ROUNDS {
            let misfit = self.misfit(&left, noise, &now);
            fitted.rounds.push(misfit);
            let stage = format!("round {}, misfit {misfit:.6e}", round + 1);
            if self.progress.report(&stage, round, ROUNDS).is_break() {
                return Err(SensitivityError::Interrupted);
            }
            let (matrix, right) = self.normal(&left, noise, &now);
            let step = solved(&matrix, &right);
            if right.dot(&step) <= DONE {
                fitted.converged = true;
                break;
            }
            let longest = step.amax();
            let mut share = if longest > LONGEST {
                LONGEST / longest
            } else {
                1.0
            };
            let mut better = None;
            for _ in 0..HALVINGS {
                let next: Vec<f64> = now.iter().zip(&step).map(|(l, s)| l + share * s).collect();
                if let Some(found) = self.tried(&next)? {
                    let (settled, mut answers) = found;
                    let before = std::mem::replace(&mut self.settled, settled);
                    let there = self.left(&next, &mut answers)?;
                    if self.misfit(&there, noise, &next) <= misfit {
                        better = Some((next, there, answers));
                        break;
                    }
                    self.settled = before;
                }
                share *= 0.5;
            }
            let Some((next, there, answers)) = better else {
                // No step lessens what is left: it is as good as the equilibrium is known.
                fitted.converged = right.dot(&step) <= CLOSE;
                break;
            };
            (now, left, tangents) = (next, there, answers);
            let after = self.misfit(&left, noise, &now);
            noise = self.noise(&left);
            if share * longest <= STILL || misfit - after <= FLAT * misfit {
                fitted.rounds.push(self.misfit(&left, noise, &now));
                fitted.converged = true;
                break;
            }
        }
        self.judge(&mut fitted, &now, &left, noise, &tangents)?;
        Ok(fitted)
    }

    /// The equilibrium at other values, near the present one; `None` where values are not allowed.
    fn tried(&self, values: &[f64]) -> Result<Option<(S, Vec<Tangent>)>, SensitivityError> {
        let content = match self.at(values) {
            Ok(content) => content,
            Err(SensitivityError::Scene(_)) => return Ok(None),
            Err(error) => return Err(error),
        };
        let again = self.settled.again(&content, self.progress)?;
        let Some(mut settled) = again else {
            let message =
                "with other values the scene has other vertices, and its shapes cannot be compared";
            return Err(SensitivityError::Failed(message.to_owned()));
        };
        let tangents = polish(&mut settled)?;
        Ok(Some((settled, tangents)))
    }

    /// The motion of each part by each logarithm, and the derivatives of the measures.
    fn motions(&self, now: &[f64], tangents: &mut [Tangent]) -> Result<Motions, SensitivityError> {
        let (mut motions, mut measured) = (Vec::new(), Vec::new());
        let mut residual = 0.0;
        for k in 0..now.len() {
            let at = |sign: f64| {
                let mut at = now.to_vec();
                at[k] += sign * STEP;
                self.settled.similar(&self.at(&at)?)
            };
            let (Some(above), Some(below)) = (at(1.0)?, at(-1.0)?) else {
                let key = &self.content.uncertain()[k].key;
                let message =
                    format!("another value of {key} makes other vertices: it cannot be fitted");
                return Err(SensitivityError::Failed(message));
            };
            let ends: [Vec<Balanced>; 2] = [above, below];
            let (slopes, moved) = slopes(&self.settled, tangents, ends, STEP, &mut residual);
            motions.push(moved);
            measured.push(slopes);
        }
        if !(residual <= SOLVED) {
            let message = format!("the equilibrium has no derivative: residual {residual:.1e}");
            return Err(SensitivityError::Failed(message));
        }
        Ok((motions, measured))
    }

    /// Distances from what was measured, with their derivatives.
    fn left(&self, now: &[f64], tangents: &mut [Tangent]) -> Result<Left, SensitivityError> {
        let own = self.settled.own()?;
        let pressures: Vec<_> = tangents.iter().map(|r| r.pressures.clone()).collect();
        let measures = self.settled.measures(&own, &pressures);
        let (motions, measured) = self.motions(now, tangents)?;
        let bodies = self.settled.bodies();
        let (mut distances, mut rows) = (Vec::new(), Vec::new());
        for (body, shape) in &self.shapes {
            let (_, part, range, _) = &bodies[*body];
            for v in range.clone() {
                let moves = |axis: &Vector3<f64>| -> Vec<f64> {
                    motions.iter().map(|m| m[*part][v].dot(axis)).collect()
                };
                let x = own[*part].x[v];
                match shape {
                    Shape::Same(to) => {
                        let apart = x - to[v - range.start];
                        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
                            distances.push(apart.dot(&axis));
                            rows.push(moves(&axis));
                        }
                    }
                    Shape::Surface(_) => {
                        let (apart, normal) = shape.distance(&x);
                        distances.push(apart);
                        rows.push(moves(&normal));
                    }
                }
            }
        }
        let numbers = self.numbers.iter().zip(&self.target.numbers);
        let off = numbers
            .clone()
            .map(|(m, (.., value, half))| (measures[*m].2 - value) * HALF / half);
        let slope = |(m, (.., half)): (&usize, &(String, String, f64, f64))| -> Vec<f64> {
            measured
                .iter()
                .map(|slopes| slopes[*m] * HALF / half)
                .collect()
        };
        let number_rows: Vec<Vec<f64>> = numbers.clone().map(slope).collect();
        Ok(Left {
            shapes: DVector::from_vec(distances),
            shape_slopes: matrix(&rows, now.len()),
            numbers: DVector::from_iterator(self.numbers.len(), off),
            number_slopes: matrix(&number_rows, now.len()),
        })
    }

    /// The noise of coordinates [m]: as given, otherwise what is left over.
    fn noise(&self, left: &Left) -> f64 {
        let found = left.deviation(self.prior.len());
        match self.target.noise {
            Some(noise) => noise,
            // An exact fit has no noise to divide by.
            None => found.max(f64::MIN_POSITIVE.sqrt()),
        }
    }

    fn misfit(&self, left: &Left, noise: f64, now: &[f64]) -> f64 {
        let shape = left.shapes.norm_squared() / (noise * noise);
        let prior = self.prior.iter().zip(now);
        let prior: f64 = prior.map(|((m, s), l)| ((l - m) / s).powi(2)).sum();
        shape + left.numbers.norm_squared() + if self.target.has_prior { prior } else { 0.0 }
    }

    /// Second derivative and negative gradient of half of the misfit.
    fn normal(&self, left: &Left, noise: f64, now: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let per = 1.0 / (noise * noise);
        let mut matrix = left.shape_slopes.tr_mul(&left.shape_slopes) * per
            + left.number_slopes.tr_mul(&left.number_slopes);
        let mut right = -(left.shape_slopes.tr_mul(&left.shapes) * per
            + left.number_slopes.tr_mul(&left.numbers));
        for (k, ((middle, deviation), at)) in self.prior.iter().zip(now).enumerate() {
            if self.target.has_prior {
                matrix[(k, k)] += 1.0 / (deviation * deviation);
                right[k] -= (at - middle) / (deviation * deviation);
            }
        }
        (matrix, right)
    }

    /// Intervals, combinations, and what is left.
    fn judge(
        &self,
        fitted: &mut Fitted,
        now: &[f64],
        left: &Left,
        noise: f64,
        tangents: &[Tangent],
    ) -> Result<(), SensitivityError> {
        fitted.noise = noise;
        fitted.left = left.deviation(now.len());
        let (matrix, _) = self.normal(left, noise, now);
        let covariance = matrix.clone().pseudo_inverse(0.0);
        let each = self.content.uncertain().iter().zip(now).zip(&self.prior);
        for (k, ((of, at), (_, deviation))) in each.enumerate() {
            let own = covariance
                .as_ref()
                .map_or(f64::INFINITY, |c| c[(k, k)].max(0.0).sqrt());
            fitted.values.push(FittedValue {
                of: of.clone(),
                value: at.exp(),
                interval: [-1.0, 1.0].map(|sign| (at + sign * HALF * own).exp()),
                share: own / deviation,
            });
        }
        // Without what was known beforehand.
        let scale = |c: usize| self.prior[c].1;
        let (s, n) = (&left.shape_slopes, &left.number_slopes);
        let known = DMatrix::from_fn(s.nrows() + n.nrows(), now.len(), |r, c| {
            let slope = if r < s.nrows() {
                s[(r, c)] / noise
            } else {
                n[(r - s.nrows(), c)]
            };
            slope * scale(c)
        });
        let split = known.tr_mul(&known).symmetric_eigen();
        for (value, vector) in split
            .eigenvalues
            .iter()
            .zip(split.eigenvectors.column_iter())
        {
            fitted.combinations.push(Combination {
                known: value.max(0.0).sqrt(),
                exponents: vector.iter().copied().collect(),
            });
        }
        fitted
            .combinations
            .sort_by(|a, b| b.known.total_cmp(&a.known));
        let own = self.settled.own()?;
        let bodies = self.settled.bodies();
        for (body, shape) in &self.shapes {
            let (name, part, range, triangles) = &bodies[*body];
            let vertices = own[*part].x[range.clone()].to_vec();
            let each = vertices.iter().enumerate();
            let distances = each.map(|(v, x)| match shape {
                Shape::Same(to) => (x - to[v]).norm(),
                Shape::Surface(_) => shape.distance(x).0.abs(),
            });
            let distances = distances.collect();
            let mesh = TriangleMesh {
                vertices,
                triangles: triangles.clone(),
            };
            fitted.bodies.push((name.clone(), mesh, distances));
        }
        let pressures: Vec<_> = tangents.iter().map(|r| r.pressures.clone()).collect();
        let measures = self.settled.measures(&own, &pressures);
        for (m, (body, name, value, _)) in self.numbers.iter().zip(&self.target.numbers) {
            let found = (body.clone(), name.clone(), *value, measures[*m].2);
            fitted.numbers.push(found);
        }
        Ok(())
    }
}

/// The places of the measured numbers among the measures.
fn placed(
    target: &FitTarget,
    measures: &[(String, &'static str, f64)],
) -> Result<Vec<usize>, SensitivityError> {
    let name_of = |m: &(String, &str, f64)| match m.0.as_str() {
        "" => m.1.to_owned(),
        body => format!("{body}:{}", m.1),
    };
    let mut numbers = Vec::new();
    for (body, name, ..) in &target.numbers {
        let found = measures.iter().position(|m| m.0 == *body && m.1 == name);
        let known: Vec<String> = measures.iter().map(name_of).collect();
        let known = known.join(", ");
        let unknown = SensitivityError::NoTarget(format!("no measure `{name}`; known: {known}"));
        numbers.push(found.ok_or(unknown)?);
    }
    Ok(numbers)
}

impl Shape {
    /// Signed distance of a point from a surface [m], and the direction in which it grows.
    fn distance(&self, x: &Point3<f64>) -> (f64, Vector3<f64>) {
        let Self::Surface(tree) = self else {
            return (0.0, Vector3::zeros());
        };
        let Some(nearest) = tree.closest(x, f64::MAX) else {
            return (0.0, Vector3::zeros());
        };
        let away = x - nearest.point;
        let distance = away.norm();
        match distance > 0.0 {
            true => (distance, away / distance),
            false => (0.0, Vector3::zeros()),
        }
    }
}

fn matrix(rows: &[Vec<f64>], columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns, |r, c| rows[r][c])
}

/// The solution of a positive semi-definite system, of least length where it is singular.
fn solved(matrix: &DMatrix<f64>, right: &DVector<f64>) -> DVector<f64> {
    let split = matrix.clone().symmetric_eigen();
    let least = split.eigenvalues.amax() * f64::EPSILON * matrix.nrows() as f64;
    let mut step = DVector::zeros(right.len());
    for (value, vector) in split
        .eigenvalues
        .iter()
        .zip(split.eigenvectors.column_iter())
    {
        if *value > least {
            step += vector * (vector.dot(right) / value);
        }
    }
    step
}
