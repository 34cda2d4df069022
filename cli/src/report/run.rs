//! Runs of scenes without muscles, and their files.

use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

use nalgebra::Isometry3;
use serde_json::{Map, Value, json};

use super::folder::{Folder, FolderError};
use super::frames::{Cast, FrameWriter, Listing, Snapshot};
use super::page::{of_effects, pictures, turntable};
use super::pictures::Painter;
use super::results::Shots;
use super::summary::Verdict;
use super::{LinePlot, Report, Table};
use pliant::io::names::file_name;
use pliant::mesh::measures::median;
use pliant::scene::content::Staged;
use pliant::simulation::lattice::LatticeRun;
use pliant::simulation::skin::{SkinRun, Stepped};
use pliant::simulation::{LoadError, Plan};
use pliant_render::{PictureError, to_gif};

/// Results of a run.
#[derive(Clone, Debug, Default)]
pub struct Account {
    /// Measures for studies, by name.
    pub numbers: Vec<(&'static str, f64)>,
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

/// A running scene without muscles.
pub trait Run {
    /// Name of the scene.
    fn name(&self) -> &str;
    /// Number of frames of the scene.
    fn frames(&self) -> usize;
    /// The last computed frame; 0 is the start.
    fn frame(&self) -> usize;
    /// The effects that run.
    fn plan(&self) -> &Plan;
    /// The bodies on the pictures.
    fn cast(&self) -> Cast;
    /// State of the last frame.
    fn snapshot(&self) -> Snapshot;
    /// Poses of the bones of the cast at a frame.
    fn poses(&self, frame: usize) -> Vec<Isometry3<f64>>;
    /// Stretch of the last frame, to find the worst frame.
    fn stretch(&self) -> f64;
    /// Description of [`Run::stretch`].
    fn worst(&self) -> &'static str;
    /// Computes the next frame; `watch` receives the progress and stops it by returning false.
    fn step(&mut self, watch: &mut dyn FnMut(&str) -> bool) -> Stepped;
    /// True if every frame that must be at rest was.
    fn converged(&self) -> bool;
    /// The results after the last frame.
    fn account(&self) -> Account;
    /// Pictures besides those of the first, the worst and the last frame.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    fn pictures(&self) -> Result<Vec<(String, Vec<u8>)>, PictureError> {
        Ok(Vec::new())
    }
}

/// Prepares a scene without muscles.
///
/// # Errors
/// The scene cannot run.
pub fn ready(scene: &Staged) -> Result<Box<dyn Run>, LoadError> {
    Ok(match scene {
        Staged::Skin(scene) => Box::new(SkinRun::new((**scene).clone())?),
        Staged::Lattice(scene) => Box::new(LatticeRun::new((**scene).clone())?),
    })
}

/// Receives the progress of a run, and can stop it.
pub trait Listener {
    /// A frame is in progress; false stops the run.
    fn part(&mut self, text: &str) -> bool;
    /// A frame is complete.
    fn frame(&mut self, frame: usize, took: Duration);
    /// True to stop now.
    fn stops(&self) -> bool;
}

/// End of a run.
#[derive(Clone, Debug)]
pub struct Ended {
    /// `summary.json`.
    pub summary: Value,
    /// True if the run was interrupted.
    pub interrupted: bool,
    /// True if every frame that must be at rest was, and none failed.
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

/// Runs to the last frame, to Ctrl-C, or to a frame that fails, and writes everything,
/// `summary.json` last.
///
/// # Errors
/// An error of writing.
pub fn perform(
    run: &mut dyn Run,
    folder: Folder,
    wanted: &Wanted,
    listener: &mut dyn Listener,
) -> Result<Ended, FolderError> {
    let (folder, cast) = (Arc::new(folder), Arc::new(run.cast()));
    let writer = FrameWriter::start(folder.clone(), cast.clone(), Listing::new(&cast));
    let prepared = wanted.begun.elapsed();
    let mut told = Told {
        shots: Shots::new(wanted.animate),
        times: Vec::new(),
        failed: None,
    };
    let mut writing = told.show(run, &writer);
    let mut interrupted = false;
    while writing && run.frame() < run.frames() {
        let before = Instant::now();
        // A lattice checks between frames only.
        interrupted = listener.stops() || {
            match run.step(&mut |text| listener.part(text) && !listener.stops()) {
                Stepped::Done => false,
                Stepped::Interrupted => true,
                Stepped::Failed(why) => {
                    told.failed = Some(why);
                    break;
                }
            }
        };
        if interrupted {
            break;
        }
        told.times.push(before.elapsed().as_secs_f64());
        writing = told.show(run, &writer);
        listener.frame(run.frame(), before.elapsed());
    }
    let collection = writer.finish()?;
    let name = file_name(run.name());
    let path = folder.claim(&format!("{name}.pvd"))?;
    collection
        .write(&path)
        .map_err(|source| FolderError::Io { path, source })?;
    let account = run.account();
    let text = |file: &str, text: &str| folder.write(file, |w| w.write_all(text.as_bytes()));
    text("measures.csv", &account.measures)?;
    let encoded = |name: &str, error: PictureError| FolderError::Io {
        path: folder.path().join(name),
        source: std::io::Error::other(error),
    };
    if let Some(painter) = Painter::new(&cast, &told.shots).filter(|_| wanted.animate) {
        let name = format!("{name}.gif");
        let (pictures, seconds) = painter.animation(&told.shots);
        let gif = to_gif(&pictures, seconds).map_err(|e| encoded(&name, e))?;
        folder.write(&name, |w| w.write_all(&gif))?;
    }
    // An incomplete run has not come to rest.
    let converged = run.converged() && told.failed.is_none() && !interrupted;
    let time = json!({
        "total_s": wanted.begun.elapsed().as_secs_f64(),
        "prepare_s": prepared.as_secs_f64(),
        "frame_ms_median": median(told.times.clone()).unwrap_or(0.0) * 1e3,
    });
    let summary = summary(run, &account, &told, interrupted, time);
    let page = told
        .page(run, &cast, &account, wanted)
        .map_err(|e| encoded("report.html", e))?;
    text("report.html", &page.to_html())?;
    text(
        "summary.json",
        &serde_json::to_string_pretty(&summary).unwrap_or_default(),
    )?;
    folder.close()?;
    Ok(Ended {
        summary,
        interrupted,
        converged,
        account,
    })
}

/// Data accumulated during the run.
struct Told {
    shots: Shots,
    /// Wall time of each frame [s].
    times: Vec<f64>,
    failed: Option<String>,
}

impl Told {
    /// Passes the last frame to the writer; returns false after an error.
    fn show(&mut self, run: &dyn Run, writer: &FrameWriter) -> bool {
        let snapshot = Arc::new(run.snapshot());
        self.shots.add_stretched(&snapshot, run.stretch());
        writer.push(snapshot)
    }

    fn page(
        &self,
        run: &dyn Run,
        cast: &Cast,
        account: &Account,
        wanted: &Wanted,
    ) -> Result<Report, PictureError> {
        let mut shown = run.pictures()?;
        let own = |caption: String| caption.replace("greatest edge stretch rms", run.worst());
        shown.extend(
            pictures(cast, &self.shots)?
                .into_iter()
                .map(|(caption, png)| (own(caption), png)),
        );
        let mut set = Table::new("Settings", ["what", "value"]);
        wanted
            .settings
            .iter()
            .for_each(|(what, value)| set.row([what.clone(), value.clone()]));
        let mut tables = account.tables.clone();
        tables.extend(of_effects("part", &run.plan().run, &run.plan().left_out));
        tables.push(set);
        let verdict = |v: &Verdict| (format!("{}: {}: {}", v.muscle, v.promise, v.found), v.kept);
        let seconds = wanted.begun.elapsed().as_secs_f64();
        Ok(Report {
            title: run.name().to_owned(),
            subtitle: format!(
                "{} of {} frames in {seconds:.1} s",
                run.frame(),
                run.frames()
            ),
            verdict: account
                .verdicts
                .iter()
                .chain(&failed(self.failed.as_deref()))
                .map(verdict)
                .collect(),
            pictures: shown,
            turntable: turntable(cast, &self.shots)?,
            plots: account.plots.clone(),
            tables: tables.into_iter().filter(|t| !t.rows.is_empty()).collect(),
            notes: account.notes.clone(),
            ..Report::default()
        })
    }
}

/// The verdict of a frame that failed.
fn failed(why: Option<&str>) -> Option<Verdict> {
    let promise = "every frame can be computed".to_owned();
    why.map(|why| Verdict {
        muscle: "all".to_owned(),
        promise,
        found: why.to_owned(),
        kept: false,
    })
}

fn summary(run: &dyn Run, account: &Account, told: &Told, interrupted: bool, time: Value) -> Value {
    let mut all = json!({
        "scene": run.name(),
        "frames": run.frame(),
        "frames_wanted": run.frames(),
        "interrupted": interrupted,
        "converged": run.converged() && told.failed.is_none() && !interrupted,
        "stopped": told.failed,
    });
    let last = json!({
        "time": time,
        "effects": { "run": run.plan().run, "left_out": run.plan().left_out },
        "verdicts": account.verdicts.iter().cloned().chain(failed(told.failed.as_deref())).collect::<Vec<_>>(),
        "notes": account.notes,
    });
    if let (Some(all), Value::Object(last)) = (all.as_object_mut(), last) {
        all.extend(account.summary.clone());
        all.extend(last);
    }
    all
}
