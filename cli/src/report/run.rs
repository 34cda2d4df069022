//! Runs of scenes without muscles, and their files.

use std::io::Write;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};

use super::folder::{Folder, FolderError};
use super::frames::{FrameWriter, Listing};
use super::output::Verdict;
use super::page::{of_effects, pictures, turntable};
use super::pictures::Painter;
use super::results::{Shots, end_unless};
use super::{LinePlot, Report, Table, lattice, skin};
use pliant::io::file_name;
use pliant::mesh::measures::median;
use pliant::progress::Progress;
use pliant::simulation::{Ended, Observer, Scenario, ScenarioKind, SceneDescription, run};
use pliant_render::{PictureError, to_gif};

/// Results of a run.
#[derive(Clone, Debug, Default)]
pub struct Account {
    /// Entries of `summary.json` besides the common ones.
    pub summary: Map<String, Value>,
    /// Results of the checks.
    pub verdicts: Vec<Verdict>,
    /// Tables of the page.
    pub tables: Vec<Table>,
    /// Plots of the page.
    pub plots: Vec<LinePlot>,
    /// Content of `measures.csv`.
    pub measures: String,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// The report data of a scenario after its last frame. Empty for muscles, which have their own
/// report.
pub fn account(scenario: &dyn Scenario) -> Account {
    match scenario.kind() {
        ScenarioKind::Skin(run) => skin::account(run),
        ScenarioKind::Lattice(run) => lattice::account(run),
        ScenarioKind::Muscles(_) | ScenarioKind::Other => Account::default(),
    }
}

/// Pictures besides those of the first, the worst and the last frame.
fn own_pictures(scenario: &dyn Scenario) -> Result<Vec<(String, Vec<u8>)>, PictureError> {
    match scenario.kind() {
        ScenarioKind::Skin(run) => skin::pictures(run),
        ScenarioKind::Muscles(_) | ScenarioKind::Lattice(_) | ScenarioKind::Other => Ok(Vec::new()),
    }
}

/// End of a run.
#[derive(Clone, Debug)]
pub struct Performed {
    /// `summary.json`.
    pub summary: Value,
    /// True if the run was interrupted.
    pub interrupted: bool,
    /// True if every frame that must be at rest is at rest, and none failed.
    pub converged: bool,
    /// The results.
    pub account: Account,
}

/// Options of a run besides the scene.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// True for an animation.
    pub animate: bool,
    /// Start of the run including all reading.
    pub begun: Instant,
    /// Names and values for the report.
    pub settings: Vec<(String, String)>,
}

/// Runs until the last frame, Ctrl-C, or a failing frame, and writes all files, `summary.json`
/// last.
///
/// # Errors
/// A file cannot be written.
pub fn perform(
    scenario: &mut dyn Scenario,
    folder: Folder,
    wanted: &Wanted,
    progress: &dyn Progress,
) -> Result<Performed, FolderError> {
    let (folder, scene) = (Arc::new(folder), Arc::new(scenario.description()));
    let mut frames = Frames {
        writer: FrameWriter::start(folder.clone(), scene.clone(), Listing::new(&scene)),
        shots: Shots::new(wanted.animate),
        times: Vec::new(),
    };
    let prepared = wanted.begun.elapsed();
    let ended = run(scenario, &mut [&mut frames], progress);
    let Frames {
        writer,
        shots,
        times,
    } = frames;
    let collection = writer.finish()?;
    let name = file_name(scenario.name());
    let path = folder.claim(&format!("{name}.pvd"))?;
    collection
        .write(&path)
        .map_err(|source| FolderError::Io { path, source })?;
    let account = account(scenario);
    let text = |file: &str, text: &str| folder.write(file, |w| w.write_all(text.as_bytes()));
    text("measures.csv", &account.measures)?;
    let encoded = |name: &str, error: PictureError| FolderError::Io {
        path: folder.path().join(name),
        source: std::io::Error::other(error),
    };
    if let Some(painter) = Painter::new(&scene, &shots).filter(|_| wanted.animate) {
        let name = format!("{name}.gif");
        let (pictures, seconds) = painter.animation(&shots);
        let gif = to_gif(&pictures, seconds).map_err(|e| encoded(&name, e))?;
        folder.write(&name, |w| w.write_all(&gif))?;
    }
    let time = json!({
        "total_s": wanted.begun.elapsed().as_secs_f64(),
        "prepare_s": prepared.as_secs_f64(),
        "frame_ms_median": median(times).unwrap_or(0.0) * 1e3,
    });
    let told = Told {
        shots,
        interrupted: ended == Ended::Interrupted,
        // An incomplete run has not come to rest at its end.
        converged: scenario.converged() && ended == Ended::Finished,
        failed: match ended {
            Ended::Failed(why) => Some(why),
            Ended::Finished | Ended::Interrupted | Ended::ByObserver => None,
        },
    };
    let summary = summary(scenario, &account, &told, time);
    let page = told
        .page(scenario, &scene, &account, wanted)
        .map_err(|e| encoded("report.html", e))?;
    text("report.html", &page.to_html())?;
    text(
        "summary.json",
        &serde_json::to_string_pretty(&summary).unwrap_or_default(),
    )?;
    folder.close()?;
    Ok(Performed {
        summary,
        interrupted: told.interrupted,
        converged: told.converged,
        account,
    })
}

/// Writes each frame, and keeps the frames for the pictures.
struct Frames {
    writer: FrameWriter,
    shots: Shots,
    /// Wall time of each frame [s].
    times: Vec<f64>,
}

impl Frames {
    /// Passes the last frame to the writer. Ends the run after an error of the writer.
    fn take(&mut self, scenario: &dyn Scenario) -> ControlFlow<()> {
        let state = Arc::new(scenario.state());
        self.shots.add_stretched(&state, scenario.severity());
        end_unless(self.writer.push(state))
    }
}

impl Observer<dyn Scenario + '_> for Frames {
    fn start(&mut self, scenario: &(dyn Scenario + '_)) -> ControlFlow<()> {
        self.take(scenario)
    }

    fn frame(&mut self, scenario: &(dyn Scenario + '_), took: Duration) -> ControlFlow<()> {
        self.times.push(took.as_secs_f64());
        self.take(scenario)
    }
}

/// The data of the summary after the last frame.
struct Told {
    shots: Shots,
    interrupted: bool,
    converged: bool,
    failed: Option<String>,
}

impl Told {
    fn page(
        &self,
        scenario: &dyn Scenario,
        scene: &SceneDescription,
        account: &Account,
        wanted: &Wanted,
    ) -> Result<Report, PictureError> {
        let mut shown = own_pictures(scenario)?;
        shown.extend(pictures(scene, &self.shots, scenario.severity_name())?);
        let mut set = Table::new("Settings", ["what", "value"]);
        wanted
            .settings
            .iter()
            .for_each(|(what, value)| set.row([what.clone(), value.clone()]));
        let mut tables = account.tables.clone();
        tables.extend(of_effects(
            "part",
            &scenario.plan().run,
            &scenario.plan().left_out,
        ));
        tables.push(set);
        let seconds = wanted.begun.elapsed().as_secs_f64();
        Ok(Report {
            title: scenario.name().to_owned(),
            subtitle: format!(
                "{} of {} frames in {seconds:.1} s",
                scenario.frame(),
                scenario.frames()
            ),
            verdict: account
                .verdicts
                .iter()
                .cloned()
                .chain(failed(self.failed.as_deref()))
                .collect(),
            pictures: shown,
            turntable: turntable(scene, &self.shots)?,
            plots: account.plots.clone(),
            tables: tables.into_iter().filter(|t| !t.rows.is_empty()).collect(),
            notes: account.notes.clone(),
            ..Report::default()
        })
    }
}

/// The verdict of a frame that failed.
fn failed(why: Option<&str>) -> Option<Verdict> {
    why.map(|why| Verdict::new("every frame can be computed", false).at(why))
}

fn summary(scenario: &dyn Scenario, account: &Account, told: &Told, time: Value) -> Value {
    let mut all = json!({
        "scene": scenario.name(),
        "frames": scenario.frame(),
        "frames_wanted": scenario.frames(),
        "interrupted": told.interrupted,
        "converged": told.converged,
        "stopped": told.failed,
    });
    let last = json!({
        "time": time,
        "effects": { "run": scenario.plan().run, "left_out": scenario.plan().left_out },
        "verdicts": account.verdicts.iter().cloned().chain(failed(told.failed.as_deref())).collect::<Vec<_>>(),
        "notes": account.notes,
    });
    if let (Some(all), Value::Object(last)) = (all.as_object_mut(), last) {
        all.extend(account.summary.clone());
        all.extend(last);
    }
    all
}
