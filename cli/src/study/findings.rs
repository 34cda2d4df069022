//! The results of a study: one row per combination, as a table, a CSV, JSON and a page.

use std::io::Write;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::combinations::{Combination, Combinations, Role};
use super::outcome::{Outcome, Positions};
use super::sheet;
use crate::report::Table;
use crate::report::folder::{Folder, FolderError};
use crate::report::output::{DataFile, Picture, RunOutput, Verdict};
use pliant::accuracy::FrameDistance;
use pliant::format::number;
use pliant::scene::{Content, Measure};

/// The names of all measures of any scene.
pub fn names() -> Vec<&'static str> {
    let mut all: Vec<&str> = Vec::new();
    for (name, ..) in Content::all_measures() {
        if !all.contains(name) {
            all.push(name);
        }
    }
    all
}

/// One row.
#[derive(Clone, Debug)]
pub struct Row {
    /// Purpose of the run.
    pub role: Role,
    /// Label of the run.
    pub label: String,
    /// The value of each varied key; `None` for that of the scene.
    pub values: Vec<Option<String>>,
    /// `None` if the run does not exist.
    pub outcome: Option<Outcome>,
    /// Distance to the reference at each compared frame; `None` without one.
    pub errors: Vec<Option<FrameDistance>>,
}

impl Row {
    /// Result of the run.
    pub fn status(&self) -> &'static str {
        self.outcome.as_ref().map_or("not run", Outcome::status)
    }

    fn number(&self, measure: &str) -> f64 {
        self.outcome
            .as_ref()
            .map_or(f64::NAN, |o| o.number(measure))
    }
}

/// All rows of a study.
#[derive(Clone, Debug)]
pub struct Findings<'a> {
    study: &'a Combinations,
    /// Rows in the order of the study; their outcomes lack the positions.
    pub rows: Vec<Row>,
    /// True if a run is missing.
    pub interrupted: bool,
    notes: Vec<String>,
    /// Runs that were stopped.
    stopped: Vec<String>,
}

/// A number for CSV: the shortest text that reads back to the same bits; empty if it is not finite.
fn cell(value: f64) -> String {
    if value.is_finite() {
        format!("{value:?}")
    } else {
        String::new()
    }
}

/// RMS and greatest distance of all vertices; `None` for different meshes.
fn distance(a: &Positions, b: &Positions) -> Option<FrameDistance> {
    let alike = a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.len() == b.len());
    alike.then(|| FrameDistance::between(&[a.concat()], &[b.concat()]))
}

impl<'a> Findings<'a> {
    /// Reads the existing results of a study from its folder.
    pub fn of(study: &'a Combinations, folder: &Path) -> Self {
        let (mut notes, mut stopped) = (study.notes.clone(), Vec::new());
        let mut rows = Vec::new();
        for combination in &study.all {
            let outcome = Outcome::read(&folder.join(combination.file()), &combination.key);
            let reference = combination.reference.map(|r| &study.all[r]);
            let reference = reference.and_then(|r| Outcome::read(&folder.join(r.file()), &r.key));
            let errors = match (&outcome, &reference) {
                (Some(outcome), Some(reference)) => errors(&study.frames, outcome, reference),
                _ => vec![None; study.frames.len()],
            };
            let both = outcome
                .iter()
                .zip(&reference)
                .flat_map(|(a, b)| a.positions.iter().zip(&b.positions));
            if both
                .into_iter()
                .any(|((_, a), (_, b))| distance(a, b).is_none())
            {
                notes.push(format!(
                    "{}: its mesh is not that of its reference, so there is no error",
                    combination.label
                ));
            }
            stopped.extend(outcome.iter().filter_map(|o| {
                Some(format!(
                    "{}: stopped by {}",
                    combination.label,
                    o.stopped.as_ref()?
                ))
            }));
            // The positions of all runs together can exceed the memory.
            let outcome = outcome.map(|o| Outcome {
                positions: Vec::new(),
                ..o
            });
            let Combination {
                role,
                label,
                values,
                ..
            } = combination.clone();
            rows.push(Row {
                role,
                label,
                values,
                outcome,
                errors,
            });
        }
        let interrupted = rows.iter().any(|r| r.outcome.is_none());
        Self {
            study,
            rows,
            interrupted,
            notes,
            stopped,
        }
    }

    fn has_errors(&self) -> bool {
        self.study.all.iter().any(|c| c.reference.is_some())
    }

    fn measures(&self) -> impl Iterator<Item = &'static Measure> + '_ {
        let is_selected = |name: &str| {
            self.study
                .measures
                .as_ref()
                .is_none_or(|all| all.iter().any(|m| m == name))
        };
        let all = self
            .study
            .all
            .first()
            .map_or(&[][..], Combination::measures);
        all.iter().filter(move |(name, ..)| is_selected(name))
    }

    /// The table for the user.
    pub fn table(&self) -> Table {
        let mut heads = vec!["run".to_owned(), "status".to_owned(), "frames".to_owned()];
        heads.extend(self.measures().map(|(_, head, _)| (*head).to_owned()));
        if self.has_errors() {
            heads.extend(self.study.frames.iter().map(|f| format!("error {f} [mm]")));
        }
        let mut table = Table::new("Runs", heads);
        for row in &self.rows {
            let frames = row.outcome.as_ref().map_or(0, |o| o.frames);
            let mut cells = vec![
                row.label.clone(),
                row.status().to_owned(),
                frames.to_string(),
            ];
            let shown = |value: f64| {
                if value.is_finite() {
                    short(value)
                } else {
                    "-".to_owned()
                }
            };
            cells.extend(
                self.measures()
                    .map(|(name, _, scale)| shown(row.number(name) * scale)),
            );
            if self.has_errors() {
                cells.extend(
                    row.errors
                        .iter()
                        .map(|e| e.map_or("-".to_owned(), |e| shown(e.rms * 1e3))),
                );
            }
            table.row(cells);
        }
        table
    }

    /// `study.csv`: a row for each run.
    fn data(&self) -> DataFile<'_> {
        let mut heads = vec!["label".to_owned(), "run".to_owned()];
        heads.extend(self.study.varied.iter().map(|(key, _)| key.clone()));
        heads.extend(["status", "converged", "frames", "frames_not_converged"].map(str::to_owned));
        heads.extend(self.measures().map(|(name, ..)| (*name).to_owned()));
        if self.has_errors() {
            heads.extend(
                self.study
                    .frames
                    .iter()
                    .flat_map(|f| [format!("rms_error_m_{f}"), format!("max_error_m_{f}")]),
            );
        }
        DataFile::new(
            "study.csv",
            heads,
            self.rows.iter().map(|row| self.cells(row)),
        )
    }

    fn cells(&self, row: &Row) -> Vec<String> {
        let mut cells = vec![row.label.clone(), row.role.name().to_owned()];
        cells.extend(row.values.iter().map(|v| v.clone().unwrap_or_default()));
        cells.push(row.status().to_owned());
        match &row.outcome {
            Some(o) => cells.extend([
                (row.status() == "converged").to_string(),
                o.frames.to_string(),
                o.not_converged.to_string(),
            ]),
            None => cells.extend(["", "", ""].map(str::to_owned)),
        }
        cells.extend(self.measures().map(|(name, ..)| cell(row.number(name))));
        if self.has_errors() {
            let both =
                |e: &Option<FrameDistance>| e.map_or([f64::NAN; 2], |e| [e.rms, e.max]).map(cell);
            cells.extend(row.errors.iter().flat_map(both));
        }
        cells
    }

    fn measures_json(&self) -> Value {
        let rows: Vec<Value> = self.rows.iter().map(|row| self.row_json(row)).collect();
        json!({
            "scene": self.study.scene,
            "combine": self.study.combine.name(),
            "frames": self.study.frames,
            "rows": rows,
        })
    }

    fn row_json(&self, row: &Row) -> Value {
        let values = self
            .study
            .varied
            .iter()
            .zip(&row.values)
            .map(|((key, _), v)| (key.clone(), json!(v)));
        let error = |(frame, e): (&usize, &Option<FrameDistance>)| {
            let [rms, max] = [e.map(|e| e.rms), e.map(|e| e.max)];
            json!({"frame": frame, "rms_m": rms, "max_m": max})
        };
        let mut all = json!({
            "label": row.label,
            "run": row.role.name(),
            "values": values.collect::<Map<_, _>>(),
            "status": row.status(),
            "converged": row.outcome.as_ref().map(|o| o.status() == "converged"),
            "frames": row.outcome.as_ref().map(|o| o.frames),
            "frames_not_converged": row.outcome.as_ref().map(|o| o.not_converged),
            "stopped": row.outcome.as_ref().and_then(|o| o.stopped.clone()),
        });
        for (name, ..) in self.measures() {
            all[name] = json!(row.number(name));
        }
        if self.has_errors() {
            all["errors"] = self
                .study
                .frames
                .iter()
                .zip(&row.errors)
                .map(error)
                .collect();
        }
        all
    }

    /// Whether every finished run converged.
    fn ended(&self) -> Verdict {
        let outcomes = self.rows.iter().filter_map(|row| row.outcome.as_ref());
        let is_wrong = |outcome: &&Outcome| outcome.stopped.is_some() || outcome.not_converged > 0;
        let wrong = outcomes.filter(is_wrong).count();
        Verdict::none("runs that did not converge, stopped or diverged", wrong)
            .else_do("the table names them; leave their values out, or use `--lenient`")
    }

    /// The result. Writes the sheets that the page does not show into the folder. `time_s` is the
    /// wall time of this call of the command.
    ///
    /// # Errors
    /// A file that cannot be written, or a picture that cannot be encoded.
    pub fn output(&self, folder: &Folder, time_s: f64) -> Result<RunOutput<'_>, FolderError> {
        let study = self.study;
        let of_runs = study.all.iter().zip(&self.rows);
        let of_runs = of_runs.filter(|(_, row)| row.outcome.is_some());
        let mut written: Vec<String> = of_runs.map(|(run, _)| run.file()).collect();
        let ran = written.len();
        written.sort_unstable();
        written.dedup();
        let (pictures, beside) = self.sheets(folder)?;
        let mut notes = self.notes.clone();
        if !beside.is_empty() {
            let (shown, all) = (pictures.len(), pictures.len() + beside.len());
            notes.push(format!(
                "the first {shown} of {all} sheets are shown; the others are beside this page"
            ));
        }
        written.extend(beside);
        if self.interrupted {
            notes.push("not complete: the same command goes on where this one stopped".to_owned());
        }
        let times = "times are those of steps alone, while other combinations ran beside";
        Ok(RunOutput {
            kind: "study",
            name: study.name.clone(),
            measures: self.measures_json(),
            verdicts: vec![self.ended()],
            findings: self.stopped.clone(),
            notes,
            interrupted: self.interrupted,
            time_s,
            title: format!("{}: a study of {}", study.name, study.scene),
            subtitle: format!(
                "{ran} of {} runs; combined: {}{}",
                self.rows.len(),
                study.combine.name(),
                if self.interrupted {
                    "; not complete"
                } else {
                    ""
                }
            ),
            tables_of_text: 1,
            tables: vec![self.table()],
            pictures,
            explanations: vec![times.to_owned()],
            data: vec![self.data()],
            written,
            ..RunOutput::default()
        })
    }

    /// The sheets of the page, and the names of the others, which are written at once: a page with
    /// hundreds of sheets is too large for browsers.
    fn sheets(&self, folder: &Folder) -> Result<(Vec<Picture>, Vec<String>), FolderError> {
        let (mut shown, mut beside) = (Vec::new(), Vec::new());
        let pages = sheet::pages(self.study, &self.rows);
        for (k, rows) in pages.iter().enumerate() {
            let file = match pages.len() {
                1 => "sheet.png".to_owned(),
                _ => format!("sheet-{}.png", k + 1),
            };
            let Some(sheet) = sheet::draw(self.study, &self.rows, rows, folder.path()) else {
                continue;
            };
            let bytes = sheet.to_png()?;
            if k >= MOST_SHOWN {
                folder.write(&file, |w| w.write_all(&bytes))?;
                beside.push(file);
                continue;
            }
            let caption = format!(
                "{file}: same camera and colours in all pictures{}",
                self.explained()
            );
            shown.push(Picture {
                file,
                caption,
                bytes,
                wide: true,
            });
        }
        Ok((shown, beside))
    }

    fn explained(&self) -> &'static str {
        if self.has_errors() {
            "; below each its distance to its reference, root mean square and greatest"
        } else {
            ""
        }
    }
}

/// Greatest number of sheets on the page.
const MOST_SHOWN: usize = 12;

/// Three digits, the width of table columns.
fn short(value: f64) -> String {
    let digits = if value == 0.0 {
        0
    } else {
        (2 - value.abs().log10().floor() as i64).clamp(0, 12) as i32
    };
    let scale = libm::pow(10.0, f64::from(digits));
    if value.abs() < 1e-3 && value != 0.0 {
        format!("{value:.1e}")
    } else {
        number((value * scale).round() / scale)
    }
}

fn errors(frames: &[usize], outcome: &Outcome, reference: &Outcome) -> Vec<Option<FrameDistance>> {
    frames
        .iter()
        .map(|&f| distance(outcome.at(f)?, reference.at(f)?))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn another_mesh_has_no_distance_and_a_number_that_is_none_is_not_hidden() {
        let x = |c: f64| vec![vec![Point3::new(c, 0.0, 0.0), Point3::origin()]];
        let found = distance(&x(3.0), &x(0.0)).unwrap();
        assert!((found.rms - 4.5_f64.sqrt()).abs() <= 1e-15 && found.max == 3.0);
        assert!(distance(&x(f64::NAN), &x(0.0)).unwrap().rms.is_nan());
        assert!(distance(&x(0.0), &vec![vec![Point3::origin()]]).is_none());
        assert!(distance(&x(0.0), &Vec::new()).is_none());
        assert_eq!(
            (cell(f64::NAN), cell(0.1 + 0.2)),
            (String::new(), "0.30000000000000004".to_owned())
        );
    }

    #[test]
    fn numbers_of_tables_have_three_digits() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (12.345, "12.3"),
            (0.01234, "0.0123"),
            (123.9, "124"),
            (1.2e-8, "1.2e-8"),
        ] {
            assert_eq!(short(value), text);
        }
    }
}
