//! Runs of scenes of any kind: their frames, their files, and the common parts of their results.

use std::io::Write;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::folder::{Folder, FolderError};
use super::frames::{FrameWriter, Listing, Stored, Written};
use super::output::{
    Picture, RunOutput, SceneRun, Times, Verdict, effects, json_text, verdict_table,
};
use super::pictures::Painter;
use super::shots::Shots;
use super::{Table, lattice, measured, places, skin, springs};
use pliant::format::number;
use pliant::io::file_name;
use pliant::io::pvd::{Collection, write_blocks};
use pliant::mesh::measures::median;
use pliant::progress::Progress;
use pliant::scene::Content;
use pliant::simulation::{
    BodyDescription, Ended, FrameState, Observer, Plan, Scenario, ScenarioKind, SceneDescription,
    run,
};
use pliant_render::{PictureError, to_gif};
use serde_json::json;

/// Options of a run besides the scene.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Kind of the job, the key of the measures; `None` is the kind of the scene.
    pub kind: Option<&'static str>,
    /// True for an animation.
    pub animate: bool,
    /// Contents of the files of frames.
    pub stored: Stored,
    /// Start of the run including all reading.
    pub begun: Instant,
    /// Names and values for the report.
    pub settings: Vec<(String, String)>,
}

/// The main files of every run.
pub const FILES: [&str; 3] = ["report.html", "summary.json", "measures.csv"];

/// The poses of bones in each frame.
const POSES: &str = "bones.csv";

/// The names of the main files of a run, to be checked before it.
pub fn files(scene: &Content) -> Vec<String> {
    let common = FILES.map(str::to_owned);
    let own = match scene {
        Content::Skin(scene) => skin::files(scene),
        _ => Vec::new(),
    };
    common.into_iter().chain(own).collect()
}

/// The frames of a run: writes each, and keeps those of the pictures.
pub struct Frames {
    folder: Arc<Folder>,
    /// The bodies and bones.
    pub(super) scene: Arc<SceneDescription>,
    writer: FrameWriter,
    shots: Shots,
    begun: Instant,
    prepared: Duration,
    /// Time before a resume, and the part for the preparation.
    earlier: (Duration, Duration),
}

impl Frames {
    /// Starts to write frames after those of `listing` and `shots`. `begun` is the start of the run
    /// including all reading; `earlier` is the time before a resume, and the part for the
    /// preparation.
    pub(super) fn start(
        folder: Folder,
        scene: SceneDescription,
        (listing, stored): (Listing, Stored),
        shots: Shots,
        begun: Instant,
        earlier: (Duration, Duration),
    ) -> Self {
        let (folder, scene) = (Arc::new(folder), Arc::new(scene));
        Self {
            writer: FrameWriter::start(folder.clone(), scene.clone(), listing, stored),
            folder,
            scene,
            shots,
            begun,
            prepared: begun.elapsed(),
            earlier,
        }
    }

    /// The frames of a run from its start.
    fn of(scenario: &dyn Scenario, folder: Folder, options: &RunOptions) -> Self {
        let scene = scenario.description();
        let (listing, shots) = (Listing::new(&scene), Shots::new(options.animate));
        Self::start(
            folder,
            scene,
            (listing, options.stored.clone()),
            shots,
            options.begun,
            Default::default(),
        )
    }

    /// Passes a frame to the writer. Returns false after an error of the writer, which turns a verdict
    /// of [`Self::finish`] red.
    pub(super) fn add(&mut self, state: FrameState, severity: f64) -> bool {
        let state = Arc::new(state);
        self.shots.add(&state, severity);
        self.writer.push(state)
    }

    /// Passes a checkpoint to the writer; otherwise as [`Self::add`].
    pub(super) fn add_checkpoint(&self, bytes: Vec<u8>) -> bool {
        self.writer.push_checkpoint(bytes)
    }

    /// Writes a text into the folder.
    ///
    /// # Errors
    /// An error of writing.
    pub(super) fn write(&self, file: &str, text: &str) -> Result<(), FolderError> {
        self.folder.write(file, |w| w.write_all(text.as_bytes()))
    }

    /// Time so far, including reading, and the part for the preparation [s].
    pub(super) fn spent(&self) -> (f64, f64) {
        let (total, prepared) = self.earlier;
        (
            (total + self.begun.elapsed()).as_secs_f64(),
            (prepared + self.prepared).as_secs_f64(),
        )
    }

    /// Waits for the last frame, and writes the list of frames and the animation. Adds to the result
    /// `own` of a kind of scene the parts that all kinds have in common.
    ///
    /// # Errors
    /// An error of writing, or a picture that cannot be encoded.
    pub(super) fn finish<'a>(
        self,
        scenario: &dyn Scenario,
        mut own: RunOutput<'a>,
        ended: &Ended,
        settings: &[(String, String)],
    ) -> Result<Finished<'a>, FolderError> {
        let finishing = Instant::now();
        let (_, prepare_s) = self.spent();
        let earlier = self.earlier.0;
        let Self {
            folder,
            scene,
            writer,
            mut shots,
            begun,
            ..
        } = self;
        shots.round();
        let Written { listing, error } = writer.finish();
        let listing = listing.unwrap_or_else(|| Listing::new(&scene));
        let series = format!("{}.pvd", file_name(scenario.name()));
        let path = folder.claim(&series)?;
        listing
            .collection
            .write(&path)
            .map_err(|source| FolderError::Io { path, source })?;
        let named = write_named_blocks(&folder, scenario.name(), &listing.collection)?;
        let has_bones = !scene.bones.is_empty();
        if has_bones {
            folder.write(POSES, |w| listing.write_poses(&scene, w))?;
        }
        let animation = write_animation(scenario, &folder, &scene, &shots)?;
        let (finish_s, own_run) = (finishing.elapsed().as_secs_f64(), own.scene.take());
        let mut scene_run = scene_run(scenario, own_run, ended, (prepare_s, finish_s));
        let mut output = RunOutput {
            name: scenario.name().to_owned(),
            interrupted: *ended == Ended::Interrupted,
            time_s: (earlier + begun.elapsed()).as_secs_f64(),
            title: scenario.name().to_owned(),
            turntable: Painter::new(&scene, &shots)
                .map_or(Ok(None), |painter| painter.turntable(&shots))?,
            ..own
        };
        output.verdicts.extend(
            failure(ended).map(|why| Verdict::new("every frame can be computed", false).at(why)),
        );
        if let Some(error) = error {
            let why = format!("a frame is missing: {error}");
            output.verdicts.push(
                Verdict::new("every frame can be written", false)
                    .at(&why)
                    .else_do("the frames before it are complete, and the collection lists them"),
            );
            scene_run.stopped.get_or_insert(why);
        }
        output.subtitle = subtitle(&output, &scene_run);
        let checks = verdict_table(&output.verdicts).to_text();
        output.text = format!(
            "{}: {}\n\n{checks}{}",
            output.name, output.subtitle, output.text
        );
        output.pictures.extend(pictures(scenario, &scene, &shots)?);
        let read = |frame| listing.read(&scene, folder.path(), frame).ok().flatten();
        let (places, more) = places::pictures(&scene, &output.verdicts, read)?;
        output.places = places;
        output.notes.extend(more);
        output.tables.extend(
            tables_of(scenario, settings)
                .into_iter()
                .filter(|t| !t.rows.is_empty()),
        );
        let beside = |name: &String| format!("animation: {name}, beside this page");
        output.explanations.extend(animation.iter().map(beside));
        let poses = has_bones.then(|| POSES.to_owned());
        let more = [series, named].into_iter().chain(poses).chain(animation);
        output.written.extend(more);
        output.scene = Some(scene_run);
        Ok(Finished { folder, output })
    }
}

/// Adds to the frames and times of a kind of scene those that all kinds have in common. `times` are
/// the preparation and the end [s].
fn scene_run(
    scenario: &dyn Scenario,
    own: Option<SceneRun>,
    ended: &Ended,
    (prepare_s, finish_s): (f64, f64),
) -> SceneRun {
    let own = own.unwrap_or_default();
    SceneRun {
        frames: scenario.frame(),
        frames_in_scene: scenario.frames(),
        stopped: own.stopped.or_else(|| failure(ended)),
        times: Times {
            prepare_s,
            finish_s,
            ..own.times
        },
        effects: effects(scenario.plan()),
        ..own
    }
}

/// The reason why a frame could not be computed.
fn failure(ended: &Ended) -> Option<String> {
    match ended {
        Ended::Failed(why) => Some(why.clone()),
        Ended::Finished | Ended::Interrupted | Ended::ByObserver => None,
    }
}

/// Frames and times in one line.
fn subtitle(output: &RunOutput<'_>, scene: &SceneRun) -> String {
    format!(
        "{} of {} frames in {:.1} s, {} ms a frame (median){}",
        scene.frames,
        scene.frames_in_scene,
        output.time_s,
        number(scene.times.frame_median_s * 1e3),
        if output.interrupted {
            "; interrupted"
        } else {
            ""
        }
    )
}

/// A run whose frames are written, with the result that remains to be written.
pub struct Finished<'a> {
    /// The folder of the results.
    pub folder: Arc<Folder>,
    /// The result.
    pub output: RunOutput<'a>,
}

/// Runs a scene other than muscles until its last frame, Ctrl-C, or a failing frame.
///
/// # Errors
/// A file cannot be written.
pub fn perform<'a>(
    scenario: &'a mut dyn Scenario,
    folder: Folder,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Finished<'a>, FolderError> {
    let mut steps = Steps {
        frames: Frames::of(scenario, folder, options),
        times_s: Vec::new(),
        measures: Vec::new(),
    };
    let ended = run(scenario, &mut [&mut steps], progress);
    let Steps {
        frames,
        times_s,
        measures,
    } = steps;
    let scenario: &'a dyn Scenario = scenario;
    let mut own = match scenario.kind() {
        ScenarioKind::Skin(run) => skin::output(run)?,
        ScenarioKind::Lattice(run) => lattice::output(run),
        ScenarioKind::Springs(run) => springs::output(run, measured::output(scenario, measures)),
        _ => measured::output(scenario, measures),
    };
    own.kind = options.kind.unwrap_or(own.kind);
    own.scene = Some(SceneRun {
        // An incomplete run has not come to rest at its end.
        converged: scenario.converged() && ended == Ended::Finished,
        times: Times {
            frames_s: times_s.iter().sum(),
            frame_median_s: median(times_s).unwrap_or(0.0),
            ..Times::default()
        },
        ..SceneRun::default()
    });
    frames.finish(scenario, own, &ended, &options.settings)
}

/// Writes each frame, and measures its time.
struct Steps {
    frames: Frames,
    /// Wall time of each frame [s].
    times_s: Vec<f64>,
    /// The measures of each frame.
    measures: Vec<measured::Frame>,
}

impl Observer<dyn Scenario + '_> for Steps {
    fn start(&mut self, scenario: &(dyn Scenario + '_)) -> ControlFlow<()> {
        self.measures.push(scenario.measures());
        end_unless(self.frames.add(scenario.state(), scenario.severity()))
    }

    fn frame(&mut self, scenario: &(dyn Scenario + '_), took: Duration) -> ControlFlow<()> {
        self.times_s.push(took.as_secs_f64());
        self.measures.push(scenario.measures());
        end_unless(self.frames.add(scenario.state(), scenario.severity()))
    }
}

/// Ends a run unless `goes_on` is true.
pub(super) fn end_unless(goes_on: bool) -> ControlFlow<()> {
    if goes_on {
        return ControlFlow::Continue(());
    }
    ControlFlow::Break(())
}

/// Writes the frames as blocks with names, and the list of them with their times. Returns its name.
fn write_named_blocks(
    folder: &Folder,
    name: &str,
    collection: &Collection,
) -> Result<String, FolderError> {
    let mut files = Vec::new();
    for (k, entries) in collection.times().enumerate() {
        let file = format!("frames/{}_{k:04}.vtm", file_name(name));
        folder.write(&file, |w| write_blocks(entries, "frames/", w))?;
        let time = entries.first().map_or(0.0, |entry| entry.time);
        files.push(json!({"name": file, "time": time}));
    }
    let list = format!("{}.vtm.series", file_name(name));
    let text = json_text(&json!({"file-series-version": "1.0", "files": files}));
    folder.write(&list, |w| w.write_all(text.as_bytes()))?;
    Ok(list)
}

/// Writes the animation if requested. Returns its name.
fn write_animation(
    scenario: &dyn Scenario,
    folder: &Folder,
    scene: &SceneDescription,
    shots: &Shots,
) -> Result<Option<String>, FolderError> {
    let painter = Painter::new(scene, shots).filter(|_| !shots.animation.shots.is_empty());
    let Some(painter) = painter else {
        return Ok(None);
    };
    let name = format!("{}.gif", file_name(scenario.name()));
    let (pictures, seconds) = painter.animation(shots);
    let gif = to_gif(&pictures, seconds)?;
    folder.write(&name, |w| w.write_all(&gif))?;
    Ok(Some(name))
}

/// Pictures of the first, the worst and the last frame.
fn pictures(
    scenario: &dyn Scenario,
    scene: &SceneDescription,
    shots: &Shots,
) -> Result<Vec<Picture>, PictureError> {
    let Some(painter) = Painter::new(scene, shots) else {
        return Ok(Vec::new());
    };
    let fibres = if scene.bodies.iter().any(|m| !m.fibres.is_empty()) {
        "; pale lines: fibres"
    } else {
        ""
    };
    let severity = scenario.severity_name();
    let worst = shots.worst.as_ref().map(|(_, shot)| shot);
    let mut pictures = Vec::new();
    for (file, caption, shot) in [
        ("first.png", "First frame".to_owned(), shots.first.as_ref()),
        ("worst.png", format!("Worst frame ({severity})"), worst),
        ("last.png", "Last frame".to_owned(), shots.last.as_ref()),
    ] {
        if let Some(shot) = shot {
            pictures.push(Picture {
                file: file.to_owned(),
                caption: format!("{caption}, {}{fibres}", shot.frame),
                bytes: painter.picture(shot).to_png()?,
                wide: false,
            });
        }
    }
    let is_muscle = matches!(scenario.kind(), ScenarioKind::Muscles(_));
    let is_held =
        |body: &BodyDescription| is_muscle && body.attached.iter().any(|&held| held > 0.0);
    if let Some(first) = shots
        .first
        .as_ref()
        .filter(|_| scene.bodies.iter().any(is_held))
    {
        pictures.push(Picture {
            file: "attachments.png".to_owned(),
            caption: "The start, and where bones hold the muscles".to_owned(),
            bytes: painter.of_attachments(first).to_png()?,
            wide: true,
        });
    }
    Ok(pictures)
}

/// Tables that runs of all kinds have in common.
fn tables_of(scenario: &dyn Scenario, settings: &[(String, String)]) -> Vec<Table> {
    let of = match scenario.kind() {
        ScenarioKind::Muscles(_) => "muscle",
        _ => "part",
    };
    let mut set = Table::new("Settings", ["what", "value"]);
    settings
        .iter()
        .for_each(|(what, value)| set.row([what.clone(), value.clone()]));
    let [ran, left_out] = effect_tables(of, scenario.plan());
    vec![ran, left_out, set]
}

/// The tables of effects that run and do not run; `of` is the header of the first column.
pub fn effect_tables(of: &str, plan: &Plan) -> [Table; 2] {
    // An effect without a part is one of all parts.
    let all = |part: &str| match part {
        "" => "(all)".to_owned(),
        part => part.to_owned(),
    };
    let heads = [of, "effect", "elements", "bytes", "estimated ms a frame"];
    let mut ran = Table::new("Effects", heads);
    for p in &plan.run {
        let ms = format!("{:.2}", p.ms_per_frame);
        ran.row([
            all(&p.muscle),
            p.effect.clone(),
            p.elements.to_string(),
            p.bytes.to_string(),
            ms,
        ]);
    }
    let mut left_out = Table::new(
        "Effects left out: no memory, no time",
        [of, "effect", "why"],
    );
    for l in &plan.left_out {
        left_out.row([all(&l.muscle), l.effect.clone(), l.why.clone()]);
    }
    [ran, left_out]
}
