//! The result of a command as data, and the one writer of `summary.json`, CSV files, pictures and
//! `report.html`.
//!
//! `docs/summary.md` explains the summary, `docs/summary.schema.json` is its schema.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::folder::{Folder, FolderError};
use super::provenance::Provenance;
use super::{LinePlot, Report, Table, Turntable};
use pliant::format::number;
use pliant::simulation::Plan;

/// Version of the format of summaries. It increases when a key changes its name or its meaning.
pub const FORMAT: u32 = 2;

/// The result of one check.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The checked property, in words.
    pub name: String,
    /// The measured value; `None` if the property has no number.
    pub value: Option<f64>,
    /// The greatest or least permitted value.
    pub limit: Option<f64>,
    /// Unit of value and limit; `None` for a pure number.
    pub unit: Option<&'static str>,
    /// Whether the property holds.
    pub passed: bool,
    /// The checked part of the result, and the location of the value.
    #[serde(rename = "where")]
    pub place: Option<String>,
    /// Advice for the user after a failure.
    pub what_to_do: Option<String>,
    /// The frame and point of the value, if it has one.
    #[serde(rename = "at")]
    pub spot: Option<Spot>,
}

/// A point in a frame of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spot {
    /// Index of the frame.
    pub frame: usize,
    /// The point, in the coordinates of the scene [m].
    pub point_m: [f64; 3],
}

impl Verdict {
    /// A verdict on a property without a number.
    pub fn new(name: impl Into<String>, passed: bool) -> Self {
        Self {
            name: name.into(),
            value: None,
            limit: None,
            unit: None,
            passed,
            place: None,
            what_to_do: None,
            spot: None,
        }
    }

    /// A value that must not exceed a limit; NaN fails.
    pub fn at_most(name: impl Into<String>, value: f64, limit: f64) -> Self {
        let passed = value <= limit;
        Self::new(name, passed).with_value(value).with_limit(limit)
    }

    /// A value that must not fall below a limit; NaN fails.
    pub fn at_least(name: impl Into<String>, value: f64, limit: f64) -> Self {
        let passed = value >= limit;
        Self::new(name, passed).with_value(value).with_limit(limit)
    }

    /// A count that must be zero.
    pub fn none(name: impl Into<String>, count: usize) -> Self {
        Self::at_most(name, count as f64, 0.0)
    }

    /// Adds the measured value.
    pub fn with_value(self, value: f64) -> Self {
        Self {
            value: Some(value),
            ..self
        }
    }

    /// Adds the permitted value.
    pub fn with_limit(self, limit: f64) -> Self {
        Self {
            limit: Some(limit),
            ..self
        }
    }

    /// Adds the unit of value and limit.
    pub fn in_unit(self, unit: &'static str) -> Self {
        Self {
            unit: Some(unit),
            ..self
        }
    }

    /// Adds the checked part of the result.
    pub fn at(self, place: impl Into<String>) -> Self {
        Self {
            place: Some(place.into()),
            ..self
        }
    }

    /// Adds advice for the user if the verdict failed. A verdict that passed has no advice.
    pub fn else_do(self, what: impl Into<String>) -> Self {
        let what_to_do = (!self.passed).then(|| what.into());
        Self { what_to_do, ..self }
    }

    /// Adds the frame and point of the value.
    pub fn seen(self, spot: Option<Spot>) -> Self {
        Self { spot, ..self }
    }

    /// Value and limit as text; empty without a value.
    pub fn found(&self) -> String {
        let Some(value) = self.value else {
            return String::new();
        };
        let limit = self.limit.map_or(String::new(), |limit| {
            format!(" (limit {})", with_unit(limit, self.unit))
        });
        format!("{}{limit}", with_unit(value, self.unit))
    }

    /// The verdict as one line of text.
    pub fn to_text(&self) -> String {
        let place = self.place.iter().map(String::clone);
        let found = Some(self.found()).filter(|found| !found.is_empty());
        let parts = place.chain([self.name.clone()]).chain(found);
        parts.collect::<Vec<_>>().join(": ")
    }
}

/// A value as text; lengths in mm.
fn with_unit(value: f64, unit: Option<&'static str>) -> String {
    match unit {
        Some("m") => format!("{} mm", number(value * 1e3)),
        Some(unit) => format!("{} {unit}", number(value)),
        None => number(value),
    }
}

/// Verdicts as a table for a terminal.
pub fn verdict_table(verdicts: &[Verdict]) -> Table {
    let mut table = Table::default();
    for v in verdicts {
        table.row([
            if v.passed { "pass" } else { "FAIL" }.to_owned(),
            v.place.clone().unwrap_or_default(),
            v.name.clone(),
            v.found(),
            v.what_to_do.clone().unwrap_or_default(),
        ]);
    }
    table
}

/// A picture of the page, PNG or GIF.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// File name in the folder of the results.
    pub file: String,
    /// What it shows.
    pub caption: String,
    /// The bytes of the file.
    pub bytes: Vec<u8>,
    /// Whether it needs the whole width of the page.
    pub wide: bool,
}

/// A plot of the page.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// SVG file in the folder of the results; `None` for a plot that is only on the page.
    pub file: Option<String>,
    /// The plot.
    pub plot: LinePlot,
}

/// A CSV file. Each row is made when it is written.
pub struct DataFile<'a> {
    /// File name in the folder of the results.
    pub file: &'static str,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// A cell for each column.
    pub rows: Box<dyn Iterator<Item = Vec<String>> + 'a>,
}

impl<'a> DataFile<'a> {
    /// A file with these columns and rows.
    pub fn new(
        file: &'static str,
        columns: impl IntoIterator<Item = impl Into<String>>,
        rows: impl IntoIterator<Item = Vec<String>, IntoIter: 'a>,
    ) -> Self {
        Self {
            file,
            columns: columns.into_iter().map(Into::into).collect(),
            rows: Box::new(rows.into_iter()),
        }
    }

    /// Writes the file as CSV.
    ///
    /// # Errors
    /// An error of the operating system; a row whose number of cells differs from the number of
    /// columns.
    pub fn write(self, to: impl Write) -> io::Result<()> {
        let mut writer = csv::Writer::from_writer(to);
        writer.write_record(&self.columns)?;
        for row in self.rows {
            writer.write_record(&row)?;
        }
        writer.flush()
    }
}

/// A function that writes a file of another format to a path.
pub type Fill<'a> = Box<dyn FnOnce(&Path) -> io::Result<()> + 'a>;

/// A file of another format, such as a mesh.
pub struct OutputFile<'a> {
    /// File name in the folder of the results, with `/` between folders.
    pub name: String,
    /// Writes the file.
    pub fill: Fill<'a>,
}

impl<'a> OutputFile<'a> {
    /// A file with the function that writes it.
    pub fn new(name: impl Into<String>, fill: impl FnOnce(&Path) -> io::Result<()> + 'a) -> Self {
        Self {
            name: name.into(),
            fill: Box::new(fill),
        }
    }
}

/// The part of a result that only the run of a scene has.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneRun {
    /// Number of frames computed after the start.
    pub frames: usize,
    /// Number of frames of the scene.
    pub frames_in_scene: usize,
    /// Whether every frame converged, or came to rest.
    pub converged: bool,
    /// The reason of an end before the last frame; `None` after Ctrl-C.
    pub stopped: Option<String>,
    /// Wall times.
    pub times: Times,
    /// Effects that ran and did not run, from [`effects`].
    pub effects: Value,
}

/// Wall times of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Times {
    /// Reading and preparation of the scene and its meshes [s].
    pub prepare_s: f64,
    /// All frames, without their audit [s].
    pub frames_s: f64,
    /// Median of a frame, without its audit [s].
    pub frame_median_s: f64,
    /// Audit of all frames [s]; `None` for a scene without one.
    pub audit_s: Option<f64>,
    /// Each effect, summed over muscles, frames and threads [s].
    pub effects_s: BTreeMap<&'static str, f64>,
    /// After the last frame: waiting frames and the animation [s].
    pub finish_s: f64,
}

/// The effects of a plan, as in summaries.
pub fn effects(plan: &Plan) -> Value {
    let run = plan.run.iter().map(|p| {
        json!({
            "part": p.muscle,
            "effect": p.effect,
            "elements": p.elements,
            "bytes": p.bytes,
            "frame_s": p.ms_per_frame * 1e-3,
        })
    });
    let left_out = plan.left_out.iter();
    let left_out = left_out.map(|l| json!({"part": l.muscle, "effect": l.effect, "why": l.why}));
    json!({"run": run.collect::<Vec<_>>(), "left_out": left_out.collect::<Vec<_>>()})
}

/// The result of a command.
#[derive(Default)]
pub struct RunOutput<'a> {
    /// The kind of job: the key of `measures` in the summary.
    pub kind: &'static str,
    /// Name of the job.
    pub name: String,
    /// Measures, an object.
    pub measures: Value,
    /// Frames and times, for the run of a scene.
    pub scene: Option<SceneRun>,
    /// The audit of the frames of a run.
    pub audit: Option<Value>,
    /// Counts that certify that nothing crossed in a run.
    pub certificate: Option<Value>,
    /// Pairs of surfaces that were parted before the start of a run.
    pub start: Option<Value>,
    /// Checks.
    pub verdicts: Vec<Verdict>,
    /// Observations that are neither right nor wrong.
    pub findings: Vec<String>,
    /// Information that a reader of this result needs.
    pub notes: Vec<String>,
    /// Whether the user stopped the job, so that a part of the result is missing.
    pub interrupted: bool,
    /// Wall time of the whole job [s].
    pub time_s: f64,
    /// Heading of the page.
    pub title: String,
    /// The line below the heading.
    pub subtitle: String,
    /// First lines on the terminal.
    pub text: String,
    /// Number of tables that a terminal shows, from the first.
    pub tables_of_text: usize,
    /// Tables directly below the checks of the page, such as the error of the result.
    pub lead: Vec<Table>,
    /// Tables of the page.
    pub tables: Vec<Table>,
    /// Heading over the plots.
    pub plots_title: String,
    /// Plots of the page.
    pub plots: Vec<Plot>,
    /// Pictures of the places where checks failed.
    pub places: Vec<Picture>,
    /// Pictures of the page.
    pub pictures: Vec<Picture>,
    /// Pictures of the page with a slider.
    pub turntable: Option<Turntable>,
    /// Explanations at the end of the page, equal for all results of this kind.
    pub explanations: Vec<String>,
    /// CSV files.
    pub data: Vec<DataFile<'a>>,
    /// Files of other formats.
    pub files: Vec<OutputFile<'a>>,
    /// Files written during the job.
    pub written: Vec<String>,
}

impl RunOutput<'_> {
    /// Whether all checks passed.
    pub fn passed(&self) -> bool {
        self.verdicts.iter().all(|v| v.passed)
    }

    /// The content of `summary.json`. A number that is not finite is null.
    pub fn summary(&self) -> Value {
        let mut files = self.written.clone();
        files.extend(self.files.iter().map(|f| f.name.clone()));
        files.extend(self.data.iter().map(|d| d.file.to_owned()));
        files.extend(self.plots.iter().filter_map(|p| p.file.clone()));
        let pictures = self.places.iter().chain(&self.pictures);
        files.extend(pictures.map(|p| p.file.clone()));
        files.extend(["report.html", "summary.json"].map(str::to_owned));
        files.retain(|name| !name.starts_with("frames/"));
        self.with_files(&files)
    }

    /// The summary of a result that has no folder: its only files are those written during the job.
    pub fn summary_without_folder(&self) -> Value {
        self.with_files(&self.written)
    }

    fn with_files(&self, files: &[String]) -> Value {
        let mut all = Map::new();
        for (key, value) in [
            ("format", json!(FORMAT)),
            ("kind", json!(self.kind)),
            ("name", json!(self.name)),
            ("passed", json!(self.passed() && !self.interrupted)),
            ("interrupted", json!(self.interrupted)),
            ("time_s", json!(self.time_s)),
            ("verdicts", json!(self.verdicts)),
            ("findings", json!(self.findings)),
            ("notes", json!(self.notes)),
            ("files", json!(files)),
            (self.kind, self.measures.clone()),
        ] {
            all.insert(key.to_owned(), value);
        }
        for (key, value) in [
            ("audit", &self.audit),
            ("certificate", &self.certificate),
            ("start", &self.start),
        ] {
            if let Some(value) = value {
                all.insert(key.to_owned(), value.clone());
            }
        }
        if let Value::Object(scene) = json!(self.scene) {
            all.extend(scene);
        }
        Value::Object(all)
    }

    /// The result for a terminal.
    pub fn to_text(&self) -> String {
        let mut text = self.text.clone();
        for table in self.tables.iter().take(self.tables_of_text) {
            text += &format!("\n{}", table.to_text());
        }
        if !self.findings.is_empty() || !self.notes.is_empty() {
            text.push('\n');
        }
        for found in &self.findings {
            text += &format!("found: {found}\n");
        }
        for note in &self.notes {
            text += &format!("note: {note}\n");
        }
        text
    }

    /// Writes all files, `summary.json` last. Returns its content.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(mut self, folder: &Folder) -> Result<Value, FolderError> {
        let mut summary = self.summary();
        let provenance = Provenance::now();
        summary["provenance"] = json!(provenance);
        self.tables.push(provenance.table());
        for file in std::mem::take(&mut self.files) {
            let path = folder.claim(&file.name)?;
            (file.fill)(&path).map_err(|source| FolderError::Io { path, source })?;
        }
        for data in std::mem::take(&mut self.data) {
            folder.write(data.file, |w| data.write(w))?;
        }
        for picture in self.places.iter().chain(&self.pictures) {
            folder.write(&picture.file, |w| w.write_all(&picture.bytes))?;
        }
        for Plot { file, plot } in &self.plots {
            if let Some(file) = file {
                folder.write(file, |w| w.write_all(plot.to_svg().as_bytes()))?;
            }
        }
        folder.write("report.html", |w| {
            w.write_all(self.page().to_html().as_bytes())
        })?;
        let text = json_text(&summary);
        folder.write("summary.json", |w| w.write_all(text.as_bytes()))?;
        folder.close()?;
        Ok(summary)
    }

    /// The page.
    fn page(self) -> Report {
        let (sheets, pictures): (Vec<_>, Vec<_>) = self.pictures.into_iter().partition(|p| p.wide);
        let shown = |pictures: Vec<Picture>| {
            let pictures = pictures.into_iter();
            pictures.map(|p| (p.caption, p.bytes)).collect()
        };
        Report {
            title: self.title,
            subtitle: self.subtitle,
            verdict: self.verdicts,
            lead: self.lead,
            findings: self.findings,
            places: shown(self.places),
            pictures: shown(pictures),
            sheets: shown(sheets),
            turntable: self.turntable,
            plots_title: self.plots_title,
            plots: self.plots.into_iter().map(|p| p.plot).collect(),
            tables: self.tables,
            notes: [self.explanations, self.notes].concat(),
        }
    }
}

/// Measures as a JSON object.
pub fn measures(of: &impl Serialize) -> Value {
    // Structures of texts, numbers and lists with text keys always have a JSON form.
    serde_json::to_value(of).unwrap_or_default()
}

/// A value as JSON text, as in a file.
pub fn json_text(value: &impl Serialize) -> String {
    let text = serde_json::to_string_pretty(value);
    format!("{}\n", text.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_has_its_eight_keys() {
        let verdict = Verdict::at_most("ends within 0.01 mm of their area", 2e-5, 1e-5)
            .in_unit("m")
            .at("psoas")
            .else_do("choose larger areas")
            .seen(Some(Spot {
                frame: 3,
                point_m: [0.0, 0.5, 1.0],
            }));
        assert_eq!(
            json!(verdict),
            json!({
                "name": "ends within 0.01 mm of their area", "value": 2e-5, "limit": 1e-5, "unit": "m", "passed": false,
                "where": "psoas", "what_to_do": "choose larger areas", "at": {"frame": 3, "point_m": [0.0, 0.5, 1.0]},
            })
        );
        assert_eq!(
            verdict.to_text(),
            "psoas: ends within 0.01 mm of their area: 0.02 mm (limit 0.01 mm)"
        );
        let green = Verdict::at_most("ends", 1e-6, 1e-5).else_do("choose larger areas");
        assert_eq!(
            green.what_to_do, None,
            "a verdict that passed has no advice"
        );
        let red = verdict_table(&[verdict]).to_text();
        assert!(
            red.contains("FAIL") && red.contains("choose larger areas"),
            "{red}"
        );
        assert!(!Verdict::at_most("a", f64::NAN, 1.0).passed);
        assert!(!Verdict::at_least("a", f64::NAN, 1.0).passed);
        assert!(json!(Verdict::at_most("a", f64::NAN, 1.0))["value"].is_null());
    }

    #[test]
    fn a_cell_with_a_comma_is_quoted() {
        let rows = vec![vec!["a, \"b\"".to_owned(), 0.1f64.to_string()]];
        let mut bytes = Vec::new();
        DataFile::new("a.csv", ["name", "x_m"], rows)
            .write(&mut bytes)
            .unwrap();
        assert_eq!(bytes, b"name,x_m\n\"a, \"\"b\"\"\",0.1\n");
        let short = vec![vec!["a".to_owned()]];
        let data = DataFile::new("a.csv", ["name", "x_m"], short);
        assert!(data.write(Vec::new()).is_err());
    }
}
