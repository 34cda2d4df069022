//! Paths of muscles as polynomials of coordinates (`FunctionBasedPath`), fitted to lengths and
//! moment arms, and tables with the column names of OpenSim's own fitter.
//!
//! OpenSim differentiates the length for the moment arm, so that both always agree.

use std::io::{self, Write};
use std::path::Path;

use nalgebra::{DMatrix, DVector};

use super::document::{MALFORMED, ModelError, Parsed, UNKNOWN_NAME};
use super::model::path_of;
use super::parameters::MuscleParameters;
use crate::format::number;
use crate::io::write_whole;
use crate::mesh::measures::max_or_nan;
use crate::spelling::shown;

/// Root mean square error of lengths and of moment arms that a polynomial has to meet at samples
/// that it has not seen [m]: that of OpenSim's own fitter.
pub const TOLERANCE: f64 = 1e-4;
/// Greatest order of a polynomial that OpenSim's own fitter uses.
pub const MOST_ORDER: usize = 9;
/// Least order.
const LEAST_ORDER: usize = 2;
/// A moment arm below this share of the length is none: the coordinate does not move the muscle.
const NO_ARM: f64 = 1e-9;
/// Singular values below this, of a matrix with columns of length 1, count as zero.
const SINGULAR: f64 = 1e-12;

/// Lengths and moment arms of a muscle at some poses.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PathSamples {
    /// Absolute path of the force, such as `/forceset/glmax1_r`.
    pub force: String,
    /// Absolute paths of the coordinates.
    pub coordinates: Vec<String>,
    /// Values of the coordinates in each pose \[rad or m\].
    pub values: Vec<Vec<f64>>,
    /// Length in each pose [m].
    pub lengths: Vec<f64>,
    /// Moment arm about each coordinate in each pose [m].
    pub arms: Vec<Vec<f64>>,
}

/// A polynomial of the coordinates with its errors at poses that it has not seen [m].
#[derive(Clone, Debug, PartialEq)]
pub struct FittedPath {
    /// Absolute path of the force.
    pub force: String,
    /// Absolute paths of the coordinates that move the muscle.
    pub coordinates: Vec<String>,
    /// Order of the polynomial.
    pub order: usize,
    /// Coefficients in the order of [`exponents`].
    pub coefficients: Vec<f64>,
    /// Root mean square and greatest error of the length [m].
    pub length_error: [f64; 2],
    /// Root mean square and greatest error of the moment arms [m].
    pub arm_error: [f64; 2],
    /// Least and greatest value of each coordinate among the poses \[rad or m\].
    pub ranges: Vec<[f64; 2]>,
    exponents: Vec<Vec<i32>>,
}

/// Exponents of all terms of a polynomial: those whose sum is at most `order`, in lexicographic
/// order, the last argument fastest.
///
/// ```
/// use pliant::opensim::paths::exponents;
/// assert_eq!(exponents(2, 1), [[0, 0], [0, 1], [1, 0]]);
/// ```
pub fn exponents(dimension: usize, order: usize) -> Vec<Vec<i32>> {
    let mut all = vec![Vec::new()];
    for _ in 0..dimension {
        let longer = |one: &Vec<i32>| -> Vec<Vec<i32>> {
            let left = order as i32 - one.iter().sum::<i32>();
            (0..=left)
                .map(|e| one.iter().copied().chain([e]).collect())
                .collect()
        };
        all = all.iter().flat_map(longer).collect();
    }
    all
}

/// The value of a polynomial.
pub(super) fn value(coefficients: &[f64], exponents: &[Vec<i32>], at: &[f64]) -> f64 {
    let terms = coefficients.iter().zip(exponents);
    terms.map(|(c, powers)| c * term(powers, at)).sum()
}

fn term(powers: &[i32], at: &[f64]) -> f64 {
    powers.iter().zip(at).map(|(e, x)| x.powi(*e)).product()
}

/// The derivative of a term by coordinate `k`.
fn slope(powers: &[i32], at: &[f64], k: usize) -> f64 {
    if powers[k] == 0 {
        return 0.0;
    }
    let mut lower = powers.to_vec();
    lower[k] -= 1;
    f64::from(powers[k]) * term(&lower, at)
}

impl PathSamples {
    /// The same without coordinates that do not move the muscle.
    fn crossed(&self) -> Self {
        let scale = NO_ARM * self.lengths.first().copied().unwrap_or(0.0).abs();
        let moves = |k: &usize| !self.arms.iter().all(|arms| arms[*k].abs() <= scale);
        let kept: Vec<usize> = (0..self.coordinates.len()).filter(moves).collect();
        let of = |all: &Vec<f64>| -> Vec<f64> { kept.iter().map(|&k| all[k]).collect() };
        Self {
            force: self.force.clone(),
            coordinates: kept.iter().map(|&k| self.coordinates[k].clone()).collect(),
            values: self.values.iter().map(of).collect(),
            lengths: self.lengths.clone(),
            arms: self.arms.iter().map(of).collect(),
        }
    }

    /// The polynomial of least order that meets a tolerance at every second pose, which it has not
    /// seen; or the one with the least error of moment arms. Its coefficients are then fitted to all
    /// poses. `None` where no coordinate moves the muscle, or for too few poses.
    pub fn fit(&self, tolerance: f64, most_order: usize) -> Option<FittedPath> {
        let own = self.crossed();
        if own.coordinates.is_empty() {
            return None;
        }
        let count = own.values.len();
        let (seen, whole): (Vec<usize>, Vec<usize>) =
            ((0..count).step_by(2).collect(), (0..count).collect());
        let mut best: Option<FittedPath> = None;
        for order in LEAST_ORDER..=most_order.clamp(LEAST_ORDER, MOST_ORDER) {
            let exponents = exponents(own.coordinates.len(), order);
            // At least as many poses as coefficients; with the moment arms that is twice as many
            // numbers.
            if seen.len() < exponents.len() || count < 2 {
                break;
            }
            let both = own
                .solve(&seen, &exponents)
                .zip(own.solve(&whole, &exponents));
            let Some((tried, coefficients)) = both else {
                break;
            };
            let [length_error, arm_error] = own.errors(&tried, &exponents);
            let found = FittedPath {
                force: own.force.clone(),
                coordinates: own.coordinates.clone(),
                order,
                coefficients,
                length_error,
                arm_error,
                ranges: own.ranges(),
                exponents,
            };
            if found.meets(tolerance) {
                return Some(found);
            }
            if best
                .as_ref()
                .is_none_or(|best| found.arm_error[0] < best.arm_error[0])
            {
                best = Some(found);
            }
        }
        best
    }

    fn ranges(&self) -> Vec<[f64; 2]> {
        let extremes = |k: usize| {
            let all = self.values.iter().map(|v| v[k]);
            [-max_or_nan(all.clone().map(|v| -v)), max_or_nan(all)]
        };
        (0..self.coordinates.len()).map(extremes).collect()
    }

    /// Coefficients by least squares over lengths and moment arms of some poses, with equal weights.
    fn solve(&self, poses: &[usize], exponents: &[Vec<i32>]) -> Option<Vec<f64>> {
        let each = 1 + self.coordinates.len();
        let rows = poses.len() * each;
        let mut matrix = DMatrix::from_fn(rows, exponents.len(), |row, column| {
            let at = &self.values[poses[row / each]];
            match row % each {
                0 => term(&exponents[column], at),
                k => -slope(&exponents[column], at, k - 1),
            }
        });
        let right = DVector::from_fn(rows, |row, _| {
            let pose = poses[row / each];
            match row % each {
                0 => self.lengths[pose],
                k => self.arms[pose][k - 1],
            }
        });
        let unit = |norm: f64| if norm > 0.0 { 1.0 / norm } else { 0.0 };
        let scales: Vec<f64> = matrix.column_iter().map(|c| unit(c.norm())).collect();
        for (k, scale) in scales.iter().enumerate() {
            matrix.column_mut(k).scale_mut(*scale);
        }
        let solution = matrix.svd(true, true).solve(&right, SINGULAR).ok()?;
        let all: Vec<f64> = solution.iter().zip(&scales).map(|(c, s)| c * s).collect();
        all.iter().all(|c| c.is_finite()).then_some(all)
    }

    /// Root mean square and greatest error of lengths and of moment arms at every second pose.
    fn errors(&self, coefficients: &[f64], exponents: &[Vec<i32>]) -> [[f64; 2]; 2] {
        let mut off = [Vec::new(), Vec::new()];
        for pose in (1..self.values.len()).step_by(2) {
            let at = &self.values[pose];
            off[0].push(value(coefficients, exponents, at) - self.lengths[pose]);
            for (k, arm) in self.arms[pose].iter().enumerate() {
                let slopes = coefficients.iter().zip(exponents);
                let sum: f64 = slopes.map(|(c, e)| c * slope(e, at, k)).sum();
                off[1].push(-sum - arm);
            }
        }
        off.map(|all| {
            let square: f64 = all.iter().map(|e| e * e).sum();
            let mean = (square / all.len() as f64).sqrt();
            [mean, max_or_nan(all.iter().map(|e| e.abs()))]
        })
    }
}

impl FittedPath {
    /// Length [m], and the moment arm about each coordinate [m].
    pub fn at(&self, values: &[f64]) -> (f64, Vec<f64>) {
        let terms = || self.coefficients.iter().zip(&self.exponents);
        let arm = |k: usize| -> f64 { -terms().map(|(c, e)| c * slope(e, values, k)).sum::<f64>() };
        let arms = (0..self.coordinates.len()).map(arm).collect();
        (value(&self.coefficients, &self.exponents, values), arms)
    }

    /// True if lengths and moment arms keep the tolerance [m].
    pub fn meets(&self, tolerance: f64) -> bool {
        self.length_error[0] <= tolerance && self.arm_error[0] <= tolerance
    }

    /// The element of the path, with a remark that tells ranges and errors.
    fn element(&self, name: &str, indent: &str) -> String {
        let range = |(path, [low, high]): (&String, &[f64; 2])| {
            let short = path.rsplit('/').next().unwrap_or_default();
            format!("{short} {} to {}", number(*low), number(*high))
        };
        let ranges: Vec<String> = self
            .coordinates
            .iter()
            .zip(&self.ranges)
            .map(range)
            .collect();
        let [length, arm] = [self.length_error[0], self.arm_error[0]].map(|e| number(1e3 * e));
        let remark = format!(
            "Valid for {} [rad or m]. Errors at poses left out of the fit: length {length} mm, moment arm {arm} mm (RMS). The length is \
             that of the fibres; a tendon adds a constant.",
            ranges.join(", ")
        );
        let coefficients: Vec<String> = self.coefficients.iter().map(f64::to_string).collect();
        let lines = [
            // Two hyphens would end a comment of XML.
            format!("<!-- {} -->", remark.replace("--", "- -")),
            format!("<FunctionBasedPath name=\"{}\">", escaped(name)),
            format!(
                "\t<coordinate_paths>{}</coordinate_paths>",
                escaped(&self.coordinates.join(" "))
            ),
            "\t<length_function>".to_owned(),
            "\t\t<MultivariatePolynomialFunction>".to_owned(),
            format!(
                "\t\t\t<coefficients>{}</coefficients>",
                coefficients.join(" ")
            ),
            format!("\t\t\t<dimension>{}</dimension>", self.coordinates.len()),
            format!("\t\t\t<order>{}</order>", self.order),
            "\t\t</MultivariatePolynomialFunction>".to_owned(),
            "\t</length_function>".to_owned(),
            "</FunctionBasedPath>".to_owned(),
        ];
        lines.join(&format!("\n{indent}"))
    }
}

/// Text for XML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// Writes a set of paths, which `ModOpReplacePathsWithFunctionBasedPaths` of OpenSim 4.5 and later
/// puts into a model.
///
/// # Errors
/// The file cannot be written.
pub fn write_set(path: &Path, paths: &[FittedPath]) -> io::Result<()> {
    write_whole(path, |w| {
        writeln!(w, "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>")?;
        writeln!(w, "<OpenSimDocument Version=\"40600\">")?;
        writeln!(w, "\t<Set_FunctionBasedPath_>\n\t\t<objects>")?;
        for path in paths {
            writeln!(w, "\t\t\t{}", path.element(&path.force, "\t\t\t"))?;
        }
        writeln!(
            w,
            "\t\t</objects>\n\t\t<groups />\n\t</Set_FunctionBasedPath_>"
        )?;
        writeln!(w, "</OpenSimDocument>")
    })
}

/// Writes a table (`.sto`) with a row for each pose; the time is the index of the row. Angles are in
/// radians.
///
/// # Errors
/// The file cannot be written.
pub fn write_table(
    path: &Path,
    name: &str,
    columns: &[String],
    rows: impl Iterator<Item = Vec<f64>> + Clone,
) -> io::Result<()> {
    write_whole(path, |w| {
        writeln!(
            w,
            "{name}\ninDegrees=no\nDataType=double\nversion=3\nendheader"
        )?;
        writeln!(w, "time\t{}", columns.join("\t"))?;
        for (k, row) in rows.clone().enumerate() {
            let row: Vec<String> = row.iter().map(f64::to_string).collect();
            writeln!(w, "{k}\t{}", row.join("\t"))?;
        }
        Ok(())
    })
}

/// The text of a model with these paths in place of those of the same forces, and with the values of
/// parameters. Every other byte is the same. `file` appears in messages.
///
/// Lengths are replaced only where they are mapped, see [`MuscleParameters::new`].
///
/// # Errors
/// A text that is no model, a force that it does not have, or a force without a path.
pub fn splice(
    text: &str,
    file: &str,
    paths: &[FittedPath],
    parameters: &[MuscleParameters],
) -> Result<String, ModelError> {
    let parsed = Parsed::new(text, file)?;
    let model = parsed.root().need("Model")?;
    let mut changes = Vec::new();
    let named = |path: &str| {
        let short = path.rsplit('/').next().unwrap_or_default();
        let mut all = model.components();
        let found = all.find(|e| e.name() == short && path_of(*e) == path);
        found.ok_or_else(|| {
            let message = format!("the model has no force `{}`", shown(path));
            ModelError::whole(file, UNKNOWN_NAME, message)
        })
    };
    for own in parameters {
        let force = named(&own.force)?;
        let mut values = vec![
            ("max_isometric_force", own.max_isometric_force[1]),
            ("pennation_angle_at_optimal", own.pennation),
        ];
        if let Some(slack) = own.tendon_slack_length.filter(|slack| slack[1] > 0.0) {
            values.push(("optimal_fiber_length", own.optimal_fibre_length[1]));
            values.push(("tendon_slack_length", slack[1]));
        }
        for (tag, value) in values {
            if let Some(old) = force.child(tag) {
                changes.push((old.range(), format!("<{tag}>{value}</{tag}>")));
            }
        }
    }
    for path in paths {
        let force = named(&path.force)?;
        let is_path = |tag: &str| {
            tag == "GeometryPath" || tag.ends_with("BasedPath") || tag == "Scholz2015GeometryPath"
        };
        let Some(old) = force.children().find(|e| is_path(e.tag())) else {
            let message = format!("the force{} has no path", force.named());
            return Err(force.error(MALFORMED, message));
        };
        let start = old.range().start;
        let line = text[..start].rfind('\n').map_or(0, |at| at + 1);
        // The path keeps the column of the one that it replaces.
        let indent: String = text[line..start]
            .chars()
            .take_while(|c| c.is_whitespace())
            .collect();
        changes.push((old.range(), path.element("path", &indent)));
    }
    changes.sort_by_key(|(range, _)| range.start);
    let mut spliced = String::with_capacity(text.len());
    let mut at = 0;
    for (range, element) in changes {
        if range.start < at {
            return Err(ModelError::whole(
                file,
                MALFORMED,
                "two paths for one force",
            ));
        }
        spliced.push_str(&text[at..range.start]);
        spliced.push_str(&element);
        at = range.end;
    }
    spliced.push_str(&text[at..]);
    Ok(spliced)
}
