//! Published moment arms, read from tables, and the comparison of a computed curve with them.
//!
//! The header decides between two layouts. In the first, a row is an angle and each curve has a
//! column, as in tables of OpenSim's tools and in digitised figures. In the second, a row is a
//! point of a bound: `muscle,coordinate,bound,angle_deg,moment_arm_cm`. Lines that begin with `#`
//! are comments. Angles are in degrees unless their column name ends in `_rad`. The unit of a
//! length is the ending of its column name (`_m`, `_cm`, `_mm`), or a comment names it as in
//! `cm moment arm`.

use std::path::{Path, PathBuf};

use super::curve::extremes;
use super::names::means;

/// A polyline of points `(angle [rad], moment arm [m])`, ascending in angle.
type Curve = Vec<(f64, f64)>;

/// Curves of one muscle in one file.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceCurve {
    /// Column names in the file.
    pub names: Vec<String>,
    curves: Vec<Curve>,
}

/// Error of [`Table::read`] and [`Table::of`].
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    /// The file cannot be read.
    #[error("cannot read `{}`: {source}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A row does not match the header.
    #[error("`{}`: {message}", .path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// The error and its line.
        message: String,
    },
    /// The header has no known layout.
    #[error(
        "`{}` has no column for the angle: the first must be `angle_deg`, a coordinate such as `hip_flexion`, or there are \
         columns `muscle`, `coordinate`, `bound`, `angle_deg` and a moment arm",
        .0.display()
    )]
    Header(PathBuf),
    /// The unit of a column is missing.
    #[error(
        "`{}` does not tell the unit of column `{column}`: end its name in _m, _cm or _mm, or say so in a comment, as in \
         `# cm moment arm`",
        .path.display()
    )]
    Unit {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
    },
}

/// A table as read from its file.
#[derive(Clone, Debug)]
pub struct Table {
    path: PathBuf,
    comments: String,
    header: Vec<String>,
    /// Line number in the file and fields of each row.
    rows: Vec<(u64, Vec<String>)>,
}

impl Table {
    /// Reads a table from a file.
    ///
    /// # Errors
    /// A file that cannot be read or is no table.
    pub fn read(path: &Path) -> Result<Self, ReferenceError> {
        let text = std::fs::read_to_string(path).map_err(|source| ReferenceError::Read {
            path: path.to_owned(),
            source,
        })?;
        let comments = text
            .lines()
            .filter(|l| l.starts_with('#'))
            .collect::<Vec<_>>()
            .join("\n");
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let row = |e: csv::Error| ReferenceError::Row {
            path: path.to_owned(),
            message: e.to_string(),
        };
        let header: Vec<String> = reader
            .headers()
            .map_err(row)?
            .iter()
            .map(str::to_owned)
            .collect();
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(row)?;
            let line = record.position().map_or(0, csv::Position::line);
            rows.push((line, record.iter().map(str::to_owned).collect()));
        }
        let first = header.first().map_or("", String::as_str);
        if !(first.starts_with("angle")
            || first.contains('_')
            || header.iter().any(|h| h == "bound"))
        {
            return Err(ReferenceError::Header(path.to_owned()));
        }
        Ok(Self {
            path: path.to_owned(),
            comments,
            header,
            rows,
        })
    }

    /// The name of the file without its extension.
    pub fn name(&self) -> String {
        self.path
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
    }

    /// The curves of a muscle over a coordinate such as `hip_flexion`; `None` if the table has
    /// none.
    ///
    /// # Errors
    /// A field that is no number, or a column without a unit.
    pub fn of(
        &self,
        muscle: &str,
        coordinate: &str,
    ) -> Result<Option<ReferenceCurve>, ReferenceError> {
        let found = match self.column("bound") {
            Some(_) => self.bounds(muscle, coordinate)?,
            None => self.wide(muscle, coordinate)?,
        };
        Ok(Some(found).filter(|r| !r.curves.is_empty()))
    }

    fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|h| h == name)
    }

    fn number(
        &self,
        (line, fields): &(u64, Vec<String>),
        column: usize,
    ) -> Result<Option<f64>, ReferenceError> {
        let text = fields.get(column).map_or("", String::as_str);
        if text.is_empty() {
            return Ok(None);
        }
        text.parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .map(Some)
            .ok_or_else(|| ReferenceError::Row {
                path: self.path.clone(),
                message: format!(
                    "line {line}: `{text}` in column `{}` is no number",
                    self.header[column]
                ),
            })
    }

    /// Unit of a column [m].
    fn scale(&self, column: usize) -> Result<f64, ReferenceError> {
        let units = [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)];
        let name = &self.header[column];
        let by_name = units
            .iter()
            .find(|(unit, _)| name.ends_with(&format!("_{unit}")));
        let by_comment = || {
            units
                .iter()
                .find(|(unit, _)| self.comments.contains(&format!(" {unit} moment arm")))
        };
        let found = by_name.or_else(by_comment).map(|(_, scale)| *scale);
        found.ok_or_else(|| ReferenceError::Unit {
            path: self.path.clone(),
            column: name.clone(),
        })
    }

    fn curve(
        &self,
        rows: &[&(u64, Vec<String>)],
        angle: usize,
        column: usize,
    ) -> Result<Curve, ReferenceError> {
        let turn = if self.header[angle].ends_with("_rad") {
            1.0
        } else {
            std::f64::consts::PI / 180.0
        };
        let scale = self.scale(column)?;
        let mut curve = Vec::new();
        for row in rows {
            if let (Some(q), Some(r)) = (self.number(row, angle)?, self.number(row, column)?) {
                curve.push((q * turn, r * scale));
            }
        }
        curve.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(curve)
    }

    fn wide(&self, muscle: &str, coordinate: &str) -> Result<ReferenceCurve, ReferenceError> {
        let rows: Vec<_> = self.rows.iter().collect();
        let (mut names, mut curves) = (Vec::new(), Vec::new());
        // In a file of several coordinates each column name contains its coordinate.
        let about = coordinate.rsplit('_').next().unwrap_or(coordinate);
        let other = |name: &str| {
            let kinds = [
                ("flex", "flexion"),
                ("add", "adduction"),
                ("int_rot", "rotation"),
            ];
            kinds
                .iter()
                .any(|(end, kind)| name.ends_with(&format!("_{end}")) && *kind != about)
        };
        for (c, name) in self.header.iter().enumerate().skip(1) {
            if name.contains("path_length") || other(name) || !means(name, muscle) {
                continue;
            }
            names.push(name.clone());
            curves.push(self.curve(&rows, 0, c)?);
        }
        Ok(ReferenceCurve { names, curves })
    }

    fn bounds(&self, muscle: &str, coordinate: &str) -> Result<ReferenceCurve, ReferenceError> {
        let header = || ReferenceError::Header(self.path.clone());
        let need = |name: &str| self.column(name).ok_or_else(header);
        let [of, about, bound] = [need("muscle")?, need("coordinate")?, need("bound")?];
        let angle = self
            .header
            .iter()
            .position(|h| h.starts_with("angle"))
            .ok_or_else(header)?;
        let arm = self
            .header
            .iter()
            .position(|h| h.starts_with("moment_arm"))
            .ok_or_else(header)?;
        let (mut names, mut curves) = (Vec::new(), Vec::new());
        for side in ["lb", "ub"] {
            let mut rows: Vec<_> = self.rows.iter().collect();
            rows.retain(|row| {
                means(text(row, of), muscle)
                    && text(row, about) == coordinate
                    && text(row, bound) == side
            });
            if let Some(first) = rows.first() {
                names.push(format!("{} {side}", text(first, of)));
                curves.push(self.curve(&rows, angle, arm)?);
            }
        }
        Ok(ReferenceCurve { names, curves })
    }
}

/// Measures of the difference between a curve and a reference.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Comparison {
    /// Share of the common angles at which the curve lies in the envelope of the reference; `None`
    /// where the reference is a single curve and has no envelope.
    pub overlap: Option<f64>,
    /// First and last common angle \[rad\].
    pub range_rad: [f64; 2],
    /// Mean of the curve minus the middle of the reference [m].
    pub difference_mean_m: f64,
    /// Greatest distance of the curve to the middle of the reference [m].
    pub difference_max_m: f64,
    /// True if the reference has the opposite sign throughout and the comparison negates it.
    pub turned: bool,
}

impl ReferenceCurve {
    /// Lower and upper bound [m] at an angle \[rad\]; `None` outside the range of a curve.
    pub fn at(&self, angle: f64) -> Option<[f64; 2]> {
        let values: Vec<f64> = self
            .curves
            .iter()
            .map(|c| value(c, angle))
            .collect::<Option<_>>()?;
        extremes(values)
    }

    /// Number of curves.
    pub fn count(&self) -> usize {
        self.curves.len()
    }

    /// Points of each curve, as read: angles \[rad\] and moment arms [m].
    pub fn curves(&self) -> &[Curve] {
        &self.curves
    }

    /// Compares moment arms [m] at angles \[rad\]; `None` for fewer than two common angles.
    pub fn compare(&self, angles: &[f64], arms: &[f64]) -> Option<Comparison> {
        let found: Vec<(f64, f64, [f64; 2])> = angles
            .iter()
            .zip(arms)
            .filter_map(|(q, r)| Some((*q, *r, self.at(*q)?)))
            .collect();
        let (first, last) = (found.first()?.0, found.last()?.0);
        if found.len() < 2 {
            return None;
        }
        let turned = [1.0, -1.0].iter().any(|sign| {
            found.iter().all(|f| f.1 * sign > 0.0)
                && found.iter().flat_map(|f| f.2).all(|r| r * sign < 0.0)
        });
        let bounds = |[low, high]: [f64; 2]| if turned { [-high, -low] } else { [low, high] };
        let within = |f: &&(f64, f64, [f64; 2])| {
            let [low, high] = bounds(f.2);
            low <= f.1 && f.1 <= high
        };
        let differences: Vec<f64> = found
            .iter()
            .map(|f| f.1 - 0.5 * bounds(f.2).iter().sum::<f64>())
            .collect();
        Some(Comparison {
            overlap: (self.count() > 1)
                .then(|| found.iter().filter(within).count() as f64 / found.len() as f64),
            range_rad: [first, last],
            difference_mean_m: differences.iter().sum::<f64>() / differences.len() as f64,
            difference_max_m: crate::mesh::measures::max_or_nan(
                differences.iter().map(|d| d.abs()),
            ),
            turned,
        })
    }
}

/// A curve's value at an angle, on the straight line between its points.
fn value(curve: &[(f64, f64)], angle: f64) -> Option<f64> {
    // Conversion from degrees and the sweep's own angles differ by rounding.
    let slack = 1e-9;
    let next = curve.partition_point(|p| p.0 < angle - slack);
    let after = curve.get(next)?;
    if (after.0 - angle).abs() <= slack {
        return Some(after.1);
    }
    let before = curve.get(next.checked_sub(1)?)?;
    Some(before.1 + (after.1 - before.1) * (angle - before.0) / (after.0 - before.0))
}

/// The text of a field; empty if it is missing.
fn text(row: &(u64, Vec<String>), column: usize) -> &str {
    row.1.get(column).map_or("", String::as_str)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Scratch;

    fn table(name: &str, text: &str) -> Table {
        let path = Scratch::file(&format!("{name}.csv"));
        std::fs::write(&path, text).expect("a file");
        Table::read(&path).expect("a table")
    }

    const WIDE: &str = "angle_deg,glut_max1_r_moment_arm_m,glut_max1_r_path_length_m,glut_max2_r_moment_arm_m\n\
                        0,-0.04,0.2,-0.06\n90,-0.02,0.2,-0.06\n";

    #[test]
    fn several_columns_are_an_envelope() {
        let found = table("wide", WIDE)
            .of("gluteus maximus", "hip_flexion")
            .expect("read")
            .expect("some");
        assert_eq!(
            found.names,
            ["glut_max1_r_moment_arm_m", "glut_max2_r_moment_arm_m"]
        );
        let [low, high] = found.at(45f64.to_radians()).expect("within");
        assert!(
            (low + 0.06).abs() <= 1e-15 && (high + 0.03).abs() <= 1e-15,
            "{low} {high}"
        );
        assert_eq!(found.at(91f64.to_radians()), None);
        let angles = [0.0, 45f64.to_radians(), 90f64.to_radians(), 2.0];
        let compared = found
            .compare(&angles, &[-0.05, -0.05, -0.07, 1.0])
            .expect("common");
        assert_eq!(compared.overlap, Some(2.0 / 3.0));
        assert!((compared.difference_max_m - 0.03).abs() <= 1e-15 && !compared.turned);
        assert_eq!(found.compare(&[3.0], &[0.0]), None);
        assert_eq!(
            table("wide2", WIDE)
                .of("soleus", "hip_flexion")
                .expect("read"),
            None
        );
    }

    #[test]
    fn bounds_and_comments_with_units() {
        let text = "# b; cm moment arm\nmuscle,coordinate,bound,angle_deg,moment_arm_cm\nr_psoas,hip_flexion,ub,10,3\n\
                    r_psoas,hip_flexion,ub,0,2\nr_psoas,hip_flexion,lb,0,1\nr_psoas,hip_flexion,lb,10,1\n\
                    r_psoas,hip_rotation,lb,10,9\n";
        let found = table("bounds", text)
            .of("psoas", "hip_flexion")
            .expect("read")
            .expect("some");
        let [low, high] = found.at(5f64.to_radians()).expect("within");
        assert!((low - 0.01).abs() <= 1e-15 && (high - 0.025).abs() <= 1e-15);
        let text = "# angle deg; mm moment arm\nhip_flexion,glut_med_flex,glut_med_add\n0,10,99\n20,20,99\n";
        let found = table("mm", text)
            .of("gluteus medius", "hip_flexion")
            .expect("read")
            .expect("some");
        assert_eq!(found.names, ["glut_med_flex"]);
        let compared = found
            .compare(&[0.0, 10f64.to_radians()], &[-0.01, -0.02])
            .expect("common");
        assert!(
            compared.turned && compared.overlap.is_none(),
            "{compared:?}"
        );
        assert!(
            (compared.difference_max_m - 0.005).abs() <= 1e-15,
            "{compared:?}"
        );
    }

    #[test]
    fn tables_of_no_use_say_why() {
        let of = |text: &str| {
            table("bad", text)
                .of("psoas", "hip_flexion")
                .expect_err("an error")
                .to_string()
        };
        assert!(of("angle_deg,psoas\n0,1\n").contains("does not tell the unit of column `psoas`"));
        assert!(
            of("angle_deg,psoas_m\n0,1\n5,x\n")
                .contains("line 3: `x` in column `psoas_m` is no number")
        );
        let path = Scratch::file("ragged.csv");
        for (text, wanted) in [
            ("angle_deg,psoas_m\n0,1\n5\n", "line: 3"),
            ("a,b\n0,1\n", "no column for the angle"),
        ] {
            std::fs::write(&path, text).expect("a file");
            let error = Table::read(&path).expect_err("refused").to_string();
            assert!(error.contains(wanted), "{error}");
        }
        std::fs::remove_file(&path).expect("removed");
        assert!(matches!(
            Table::read(&path),
            Err(ReferenceError::Read { .. })
        ));
    }
}
