//! Lengths and moment arms of muscles for OpenSim 4.5 and later: paths as polynomials of a coordinate
//! (`FunctionBasedPath`), and tables (`.sto`) with the column names of its own fitter.
//!
//! The path length is the mean length of the fibres. A tendon adds a constant, which moment arms do
//! not see: the tendon slack length of the muscle takes it up.

use std::io::{self, Write};
use std::path::Path;

use nalgebra::{DMatrix, DVector};
use serde_json::{Value, json};

use super::super::Table;
use super::super::output::OutputFile;
use pliant::format::number;
use pliant::io::{file_name, write_whole};
use pliant::mesh::measures::max_or_nan;
use pliant::moment_arms::Arms;

/// Root mean square error of lengths and of moment arms that a polynomial has to meet at angles that
/// it has not seen [m]: that of OpenSim's own fitter.
const TOLERANCE: f64 = 1e-4;
/// Least and greatest order of a polynomial.
const ORDERS: [usize; 2] = [2, 9];

/// Names of a model.
#[derive(Clone, Debug)]
pub struct OpenSimNames {
    /// Absolute path of the coordinate, such as `/jointset/hip_r/hip_flexion_r`.
    pub coordinate: String,
    /// Names of muscles of the scene with the forces of the model.
    pub forces: Vec<(String, String)>,
}

/// A polynomial of the coordinate [rad] with its errors at angles that it has not seen [m].
pub struct FittedPath {
    muscle: String,
    force: String,
    coefficients: Vec<f64>,
    length_rms: f64,
    arm_rms: f64,
    length_max: f64,
    arm_max: f64,
    range: [f64; 2],
}

impl OpenSimNames {
    /// The absolute path of the force of a muscle.
    fn force(&self, muscle: &str) -> String {
        let named = self.forces.iter().find(|(name, _)| name == muscle);
        // A name of OpenSim has no spaces.
        let own = muscle.replace(char::is_whitespace, "_");
        let force = named.map_or(own.as_str(), |(_, force)| force.as_str());
        if force.starts_with('/') {
            force.to_owned()
        } else {
            format!("/forceset/{force}")
        }
    }

    /// The first force that two of these muscles have.
    pub fn shared<'m>(&self, muscles: impl IntoIterator<Item = &'m str>) -> Option<String> {
        let mut all = std::collections::BTreeSet::new();
        let mut forces = muscles.into_iter().map(|muscle| self.force(muscle));
        forces.find(|force| !all.insert(force.clone()))
    }

    /// The path of each muscle, and a finding for each without one.
    pub fn paths(&self, arms: &[Arms]) -> (Vec<FittedPath>, Vec<String>) {
        let (mut paths, mut findings) = (Vec::new(), Vec::new());
        for arms in arms {
            match fit(arms, &self.force(&arms.name)) {
                Some(path) => {
                    findings.extend(path.finding());
                    paths.push(path);
                }
                None => findings.push(format!(
                    "{}: no path for OpenSim, as {} angles are too few for a polynomial",
                    arms.name,
                    arms.angles.len()
                )),
            }
        }
        (paths, findings)
    }
}

/// Coefficients of a polynomial of this order over some angles [rad], by least squares over lengths
/// and moment arms with equal weights.
fn polynomial(arms: &Arms, angles: &[usize], order: usize) -> Option<Vec<f64>> {
    let rows = 2 * angles.len();
    let matrix = DMatrix::from_fn(rows, order + 1, |row, k| {
        let q = arms.angles[angles[row / 2]];
        if row % 2 == 0 {
            q.powi(k as i32)
        } else if k == 0 {
            0.0
        } else {
            -(k as f64) * q.powi(k as i32 - 1)
        }
    });
    let right = DVector::from_fn(rows, |row, _| {
        let k = angles[row / 2];
        if row % 2 == 0 {
            arms.length[k]
        } else {
            arms.mean[k]
        }
    });
    let solution = matrix.svd(true, true).solve(&right, 1e-14).ok()?;
    let all: Vec<f64> = solution.iter().copied().collect();
    all.iter().all(|c| c.is_finite()).then_some(all)
}

/// Length and moment arm of a polynomial at an angle [rad].
fn at(coefficients: &[f64], q: f64) -> [f64; 2] {
    let (mut length, mut slope) = (0.0, 0.0);
    for c in coefficients.iter().rev() {
        slope = slope * q + length;
        length = length * q + c;
    }
    [length, -slope]
}

/// The polynomial of least order that meets the tolerance at every second angle, which it has not
/// seen; or the one with the least error. `None` for too few angles.
fn fit(arms: &Arms, force: &str) -> Option<FittedPath> {
    let count = arms
        .angles
        .len()
        .min(arms.length.len())
        .min(arms.mean.len());
    let seen: Vec<usize> = (0..count).step_by(2).collect();
    let whole: Vec<usize> = (0..count).collect();
    let mut best: Option<FittedPath> = None;
    for order in ORDERS[0]..=ORDERS[1] {
        // Twice as many numbers as coefficients.
        if seen.len() < order + 1 || count < 2 {
            break;
        }
        let both = polynomial(arms, &seen, order).zip(polynomial(arms, &whole, order));
        let Some((tried, coefficients)) = both else {
            break;
        };
        let [(length_rms, length_max), (arm_rms, arm_max)] =
            [0, 1].map(|which| errors(arms, &tried, count, which));
        let found = FittedPath {
            muscle: arms.name.clone(),
            force: force.to_owned(),
            coefficients,
            length_rms,
            arm_rms,
            length_max,
            arm_max,
            range: [arms.angles[0], arms.angles[count - 1]],
        };
        if found.meets() {
            return Some(found);
        }
        if best
            .as_ref()
            .is_none_or(|best| found.arm_rms < best.arm_rms)
        {
            best = Some(found);
        }
    }
    best
}

/// Root mean square and greatest error of lengths (0) or moment arms (1) at every second angle.
fn errors(arms: &Arms, coefficients: &[f64], count: usize, which: usize) -> (f64, f64) {
    let real = [&arms.length, &arms.mean][which];
    let off = |k: usize| (at(coefficients, arms.angles[k])[which] - real[k]).abs();
    let all: Vec<f64> = (1..count).step_by(2).map(off).collect();
    let square: f64 = all.iter().map(|e| e * e).sum();
    ((square / all.len() as f64).sqrt(), max_or_nan(all))
}

impl FittedPath {
    fn meets(&self) -> bool {
        self.length_rms <= TOLERANCE && self.arm_rms <= TOLERANCE
    }

    fn order(&self) -> usize {
        self.coefficients.len() - 1
    }

    /// A finding where no order meets the tolerance.
    fn finding(&self) -> Option<String> {
        (!self.meets()).then(|| {
            format!(
                "{}: no polynomial up to order {} meets {} mm: its moment arm is off by {} mm (RMS) where a muscle snaps or leaves a \
                 bone; see opensim in summary.json",
                self.muscle,
                ORDERS[1],
                1e3 * TOLERANCE,
                number(1e3 * self.arm_rms)
            )
        })
    }

    fn to_json(&self) -> Value {
        json!({
            "muscle": self.muscle,
            "force": self.force,
            "order": self.order(),
            "coefficients": self.coefficients,
            "length_rms_m": self.length_rms,
            "length_max_m": self.length_max,
            "moment_arm_rms_m": self.arm_rms,
            "moment_arm_max_m": self.arm_max,
            "meets": self.meets(),
        })
    }
}

/// The paths as JSON.
pub fn to_json(paths: &[FittedPath]) -> Value {
    paths.iter().map(FittedPath::to_json).collect()
}

/// The paths as a table.
pub fn table(paths: &[FittedPath]) -> Table {
    let columns = [
        "muscle",
        "force",
        "order",
        "length, RMS [mm]",
        "greatest [mm]",
        "moment arm, RMS [mm]",
        "greatest [mm]",
    ];
    let mut table = Table::new("Paths for OpenSim, at angles left out of the fit", columns);
    for path in paths {
        let mm = |m: f64| number(1e3 * m);
        table.row([
            path.muscle.clone(),
            path.force.clone(),
            path.order().to_string(),
            mm(path.length_rms),
            mm(path.length_max),
            mm(path.arm_rms),
            mm(path.arm_max),
        ]);
    }
    table
}

/// Text for XML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// The set of paths, and the tables of lengths, moment arms and coordinate.
pub fn files<'a>(
    name: &str,
    names: &'a OpenSimNames,
    paths: Vec<FittedPath>,
    arms: &'a [Arms],
) -> Vec<OutputFile<'a>> {
    let file = file_name(name);
    let short = names
        .coordinate
        .rsplit('/')
        .next()
        .unwrap_or_default()
        .to_owned();
    let force = |a: &Arms| names.force(&a.name);
    let columns = |what: &str| -> Vec<String> {
        arms.iter()
            .map(|a| format!("{}_{what}", force(a)))
            .collect()
    };
    let lengths = columns("length");
    let moment_arms = columns(&format!("moment_arm_{short}"));
    let value = vec![format!("{}/value", names.coordinate)];
    let count = arms.iter().map(|a| a.angles.len()).min().unwrap_or(0);
    vec![
        OutputFile::new(format!("{file}_FunctionBasedPathSet.xml"), move |path| {
            write_set(path, &names.coordinate, &paths)
        }),
        OutputFile::new(format!("{file}_path_lengths.sto"), move |path| {
            write_sto(path, "path_lengths", &lengths, count, |k, m| {
                arms[m].length[k]
            })
        }),
        OutputFile::new(format!("{file}_moment_arms.sto"), move |path| {
            write_sto(path, "moment_arms", &moment_arms, count, |k, m| {
                arms[m].mean[k]
            })
        }),
        OutputFile::new(format!("{file}_coordinate_values.sto"), move |path| {
            write_sto(path, "coordinate_values", &value, count, |k, _| {
                arms[0].angles[k]
            })
        }),
    ]
}

fn write_set(path: &Path, coordinate: &str, paths: &[FittedPath]) -> io::Result<()> {
    write_whole(path, |w| {
        writeln!(w, "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>")?;
        writeln!(w, "<OpenSimDocument Version=\"40600\">")?;
        writeln!(w, "\t<Set_FunctionBasedPath_>\n\t\t<objects>")?;
        for path in paths {
            let [from, to] = path.range.map(f64::to_degrees);
            writeln!(
                w,
                "\t\t\t<!-- {} to {} degrees; errors at angles left out of the fit: length {} mm, moment arm {} mm (RMS). The length is \
                 that of the fibres; a tendon adds a constant. -->",
                number(from),
                number(to),
                number(1e3 * path.length_rms),
                number(1e3 * path.arm_rms)
            )?;
            writeln!(
                w,
                "\t\t\t<FunctionBasedPath name=\"{}\">",
                escaped(&path.force)
            )?;
            writeln!(
                w,
                "\t\t\t\t<coordinate_paths>{}</coordinate_paths>",
                escaped(coordinate)
            )?;
            writeln!(
                w,
                "\t\t\t\t<length_function>\n\t\t\t\t\t<MultivariatePolynomialFunction>"
            )?;
            let all: Vec<String> = path.coefficients.iter().map(f64::to_string).collect();
            writeln!(
                w,
                "\t\t\t\t\t\t<coefficients>{}</coefficients>",
                all.join(" ")
            )?;
            writeln!(w, "\t\t\t\t\t\t<dimension>1</dimension>")?;
            writeln!(w, "\t\t\t\t\t\t<order>{}</order>", path.order())?;
            writeln!(
                w,
                "\t\t\t\t\t</MultivariatePolynomialFunction>\n\t\t\t\t</length_function>"
            )?;
            writeln!(w, "\t\t\t</FunctionBasedPath>")?;
        }
        writeln!(
            w,
            "\t\t</objects>\n\t\t<groups />\n\t</Set_FunctionBasedPath_>"
        )?;
        writeln!(w, "</OpenSimDocument>")
    })
}

/// A table with a row for each angle; the time is the index of the row.
fn write_sto(
    path: &Path,
    name: &str,
    columns: &[String],
    count: usize,
    value: impl Fn(usize, usize) -> f64,
) -> io::Result<()> {
    write_whole(path, |w| {
        writeln!(
            w,
            "{name}\ninDegrees=no\nDataType=double\nversion=3\nendheader"
        )?;
        writeln!(w, "time\t{}", columns.join("\t"))?;
        for k in 0..count {
            let row: Vec<String> = (0..columns.len())
                .map(|m| value(k, m).to_string())
                .collect();
            writeln!(w, "{k}\t{}", row.join("\t"))?;
        }
        Ok(())
    })
}
