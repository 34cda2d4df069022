//! The results of a run, gathered frame by frame and written into a folder.

use std::io::Write;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::folder::{Folder, FolderError};
use super::frames::{FrameWriter, Listing};
use super::gathered::{self, Gathered};
use super::page;
use super::pictures::Painter;
use super::record::Record;
use super::summary::{Summary, Time};
use pliant::accuracy::Chosen;
use pliant::io::file_name;
use pliant::mesh::measures::max_or_nan;
use pliant::simulation::checkpoint::{self, Fingerprint};
use pliant::simulation::{FrameState, Measures, Observer, Scenario, SceneDescription, Simulation};
use pliant_render::{PictureError, to_gif};

/// Number of frames between two pictures of an animation.
const ANIMATION_STEP: usize = 4;

/// Greatest number of pictures of an animation; a longer run shows every second, and so on.
const MOST_PICTURES: usize = 500;

/// Greatest number of frames of the turntable, besides the last.
const MOST_TURNED: usize = 23;

/// Frames at equal distances, a bounded number for a run of any length.
#[derive(Clone, Debug)]
pub struct Evenly {
    /// The frames so far.
    pub shots: Vec<Arc<FrameState>>,
    /// Number of frames from one to the next; 0 for none at all.
    step: usize,
    /// Greatest number of frames; a longer run keeps every second, and so on.
    most: usize,
}

impl Evenly {
    /// An empty sample: every `step`-th frame, at most `most`.
    fn new(step: usize, most: usize) -> Self {
        Self {
            shots: Vec::new(),
            step,
            most,
        }
    }

    fn add(&mut self, snapshot: &Arc<FrameState>) {
        if self.step > 0 && snapshot.frame.is_multiple_of(self.step) {
            self.shots.push(snapshot.clone());
            if self.shots.len() > self.most {
                self.step = self.step.saturating_mul(2);
                let step = self.step;
                self.shots.retain(|s| s.frame.is_multiple_of(step));
            }
        }
    }
}

/// The frames of the pictures.
#[derive(Clone, Debug)]
pub struct Shots {
    /// The start.
    pub first: Option<Arc<FrameState>>,
    /// The frame with the greatest edge stretch, and the stretch.
    pub worst: Option<(f64, Arc<FrameState>)>,
    /// The last frame.
    pub last: Option<Arc<FrameState>>,
    /// Frames of the animation; none without one.
    pub animation: Evenly,
    /// Frames of the turntable, without the last.
    pub turned: Evenly,
}

impl Shots {
    /// Empty shots, with an animation if requested.
    pub(super) fn new(animate: bool) -> Self {
        Self {
            first: None,
            worst: None,
            last: None,
            animation: Evenly::new(if animate { ANIMATION_STEP } else { 0 }, MOST_PICTURES),
            turned: Evenly::new(1, MOST_TURNED),
        }
    }

    /// The frames of the turntable, including the first and the last.
    pub fn of_turntable(&self) -> Vec<Arc<FrameState>> {
        let mut all = self.turned.shots.clone();
        if let Some(last) = self
            .last
            .iter()
            .find(|last| all.last().is_none_or(|shown| shown.frame != last.frame))
        {
            all.push(last.clone());
        }
        all
    }

    /// All stored frames; a frame of several pictures appears several times.
    pub(super) fn all_mut(&mut self) -> impl Iterator<Item = &mut Arc<FrameState>> {
        let Self {
            first,
            worst,
            last,
            animation,
            turned,
        } = self;
        let single = first
            .iter_mut()
            .chain(worst.iter_mut().map(|(_, shot)| shot))
            .chain(last);
        single.chain(&mut animation.shots).chain(&mut turned.shots)
    }

    /// The same as [`Self::all_mut`].
    pub(super) fn all(&self) -> impl Iterator<Item = &Arc<FrameState>> {
        let single = self
            .first
            .iter()
            .chain(self.worst.iter().map(|(_, shot)| shot))
            .chain(&self.last);
        single
            .chain(&self.animation.shots)
            .chain(&self.turned.shots)
    }

    /// Adds a frame of muscles.
    pub(super) fn add(&mut self, snapshot: &Arc<FrameState>, measures: &[Measures]) {
        self.add_stretched(
            snapshot,
            max_or_nan(measures.iter().map(|m| m.edge_stretch_rms)),
        );
    }

    /// Adds a frame with a given edge stretch.
    pub(super) fn add_stretched(&mut self, snapshot: &Arc<FrameState>, stretch: f64) {
        self.first.get_or_insert_with(|| snapshot.clone());
        if self.worst.as_ref().is_none_or(|(most, _)| stretch > *most) {
            self.worst = Some((stretch, snapshot.clone()));
        }
        self.last = Some(snapshot.clone());
        self.animation.add(snapshot);
        self.turned.add(snapshot);
    }
}

/// Results during a run.
pub struct Results {
    folder: Arc<Folder>,
    cast: Arc<SceneDescription>,
    /// Present until the end of the run.
    writer: Option<FrameWriter>,
    record: Record,
    shots: Shots,
    begun: Instant,
    prepared: Duration,
    /// Time before the resume, and the part for the preparation.
    earlier: (Duration, Duration),
    name: String,
    checkpoints: Option<Checkpoints>,
}

/// Settings of the checkpoints.
struct Checkpoints {
    every: usize,
    fingerprint: Fingerprint,
    /// Frame of the last checkpoint.
    last: Option<usize>,
}

impl Results {
    /// Starts with the first state of `simulation`; `begun` is the start of the run including all
    /// reading.
    ///
    /// # Errors
    /// The folder cannot be used.
    pub fn begin(
        folder: Folder,
        simulation: &Simulation,
        animate: bool,
        begun: Instant,
    ) -> Result<Self, FolderError> {
        let folder = Arc::new(folder);
        let cast = Arc::new(simulation.description());
        let writer = Some(FrameWriter::start(
            folder.clone(),
            cast.clone(),
            Listing::new(&cast),
        ));
        let shots = Shots::new(animate);
        Ok(Self {
            folder,
            cast,
            writer,
            record: Record::default(),
            shots,
            begun,
            prepared: begun.elapsed(),
            earlier: Default::default(),
            name: simulation.scene.name.clone(),
            checkpoints: None,
        })
    }

    /// Continues with the results in the folder `root`; `gathered` are their contents at the
    /// present frame of `simulation`, and `first` is its start. Later frames in the folder are
    /// removed. The pictures read earlier frames from their files. Without a new animation that of
    /// the earlier run is removed.
    ///
    /// # Errors
    /// A file of an earlier frame is missing or changed, and nothing was touched; or the folder
    /// cannot be used.
    pub fn resume(
        root: &Path,
        simulation: &mut Simulation,
        gathered: Gathered,
        first: FrameState,
        animate: bool,
        begun: Instant,
    ) -> Result<Self, FolderError> {
        let cast = Arc::new(simulation.description());
        let shots = gathered.shots(&cast, simulation, root, first, animate)?;
        let (listing, files) = gathered::listing(&cast, simulation);
        let folder = Arc::new(Folder::resume(root, &files, |file| {
            !animate && file.ends_with(".gif")
        })?);
        let writer = Some(FrameWriter::start(folder.clone(), cast.clone(), listing));
        let [total, prepared] = <[f64; 2]>::from(gathered.times_s).map(seconds);
        Ok(Self {
            folder,
            cast,
            writer,
            record: gathered.record(simulation),
            shots,
            begun,
            prepared: begun.elapsed(),
            earlier: (total, prepared),
            name: simulation.scene.name.clone(),
            checkpoints: None,
        })
    }

    /// Sets the interval of checkpoints, with another one at the end, for simulations with this
    /// `fingerprint`; 0 for none.
    pub fn keep_every(&mut self, every: usize, fingerprint: Fingerprint) {
        self.checkpoints = (every > 0).then_some(Checkpoints {
            every,
            fingerprint,
            last: None,
        });
    }

    /// Passes a checkpoint of the last frame to the writer if one is due, or at the `end` if it is
    /// missing; otherwise as [`Self::frame`].
    pub fn checkpoint(&mut self, simulation: &Simulation, end: bool) -> bool {
        let frame = simulation.frame();
        let Some(wanted) = &mut self.checkpoints else {
            return true;
        };
        if wanted.last == Some(frame) || !(end || frame.is_multiple_of(wanted.every)) {
            return true;
        }
        wanted.last = Some(frame);
        let (total, prepared) = self.earlier;
        let spent = (
            (total + self.begun.elapsed()).as_secs_f64(),
            (prepared + self.prepared).as_secs_f64(),
        );
        let beside = gathered::save(simulation, &self.record, wanted.every, spent);
        let bytes = checkpoint::save(simulation, &wanted.fingerprint, &beside);
        self.writer
            .as_ref()
            .is_some_and(|w| w.push_checkpoint(bytes))
    }

    /// Adds the frame that `simulation` has just computed in `step`, measures it, and passes it to
    /// the writer. Returns false after an error of the writer: [`Self::finish`] then returns the
    /// error.
    pub fn frame(&mut self, simulation: &Simulation, step: Duration) -> bool {
        let before = Instant::now();
        let measures = simulation.measure();
        let audit = before.elapsed();
        let snapshot = Arc::new(simulation.state());
        self.shots.add(&snapshot, &measures);
        self.record.add(simulation, measures, step, audit);
        self.writer.as_ref().is_some_and(|w| w.push(snapshot))
    }

    /// Writes a text into the folder.
    ///
    /// # Errors
    /// An error of writing.
    pub fn write(&self, file: &str, text: &str) -> Result<(), FolderError> {
        self.folder.write(file, |w| w.write_all(text.as_bytes()))
    }

    /// Measures of the last frame, for each muscle.
    pub fn last(&self) -> &[Measures] {
        let all = &self.record.measures;
        &all[all.len().saturating_sub(self.cast.bodies.len())..]
    }

    /// Writes all remaining files, `summary.json` last. `settings` are names and values for the
    /// report; `chosen` is the selection for a requested accuracy.
    ///
    /// # Errors
    /// An error of writing.
    pub fn finish(
        mut self,
        simulation: &Simulation,
        settings: &[(String, String)],
        interrupted: bool,
        chosen: Option<&Chosen>,
    ) -> Result<Summary, FolderError> {
        let finishing = Instant::now();
        let collection = match self.writer.take() {
            Some(writer) => writer.finish()?,
            None => return Err(FolderError::WriterEnded),
        };
        let pvd = format!("{}.pvd", file_name(&simulation.scene.name));
        let path = self.folder.claim(&pvd)?;
        collection
            .write(&path)
            .map_err(|source| FolderError::Io { path, source })?;
        let record = &self.record;
        self.folder
            .write("measures.csv", |w| record.write_measures(w))?;
        self.folder.write("times.csv", |w| record.write_times(w))?;
        let animated = self.write_animation()?;
        let [total, prepared, finished] = [
            self.earlier.0 + self.begun.elapsed(),
            self.earlier.1 + self.prepared,
            finishing.elapsed(),
        ]
        .map(|time| time.as_secs_f64());
        let time = Time::of(record, total, prepared, finished);
        let summary = Summary::of(simulation, record, interrupted, time, chosen);
        self.write_report(&summary, settings, animated)?;
        let json = summary.to_json();
        self.folder
            .write("summary.json", |w| w.write_all(json.as_bytes()))?;
        self.folder.close()?;
        Ok(summary)
    }

    /// Writes the animation if requested. Returns its name.
    fn write_animation(&self) -> Result<Option<String>, FolderError> {
        let Some(painter) = Painter::new(&self.cast, &self.shots)
            .filter(|_| !self.shots.animation.shots.is_empty())
        else {
            return Ok(None);
        };
        let name = format!("{}.gif", file_name(&self.name));
        let (pictures, seconds) = painter.animation(&self.shots);
        let gif = to_gif(&pictures, seconds).map_err(|e| self.picture_error(&name, e))?;
        self.folder.write(&name, |w| w.write_all(&gif))?;
        Ok(Some(name))
    }

    fn write_report(
        &self,
        summary: &Summary,
        settings: &[(String, String)],
        animated: Option<String>,
    ) -> Result<(), FolderError> {
        let page = page::report(summary, &self.record, &self.cast, &self.shots, settings);
        let mut page = page.map_err(|e| self.picture_error("report.html", e))?;
        page.notes
            .extend(animated.map(|name| format!("animation: {name}, beside this page")));
        self.folder
            .write("report.html", |w| w.write_all(page.to_html().as_bytes()))
    }

    fn picture_error(&self, name: &str, error: PictureError) -> FolderError {
        FolderError::Io {
            path: self.folder.path().join(name),
            source: std::io::Error::other(error),
        }
    }
}

impl Observer<Simulation> for Results {
    fn start(&mut self, simulation: &Simulation) -> ControlFlow<()> {
        // A resumed run has its last frame already.
        let goes_on = !self.last().is_empty() || self.frame(simulation, Duration::ZERO);
        end_unless(goes_on)
    }

    fn frame(&mut self, simulation: &Simulation, took: Duration) -> ControlFlow<()> {
        let goes_on = Self::frame(self, simulation, took) && self.checkpoint(simulation, false);
        end_unless(goes_on)
    }
}

/// Ends a run unless `goes_on` is true.
pub(super) fn end_unless(goes_on: bool) -> ControlFlow<()> {
    if goes_on {
        return ControlFlow::Continue(());
    }
    ControlFlow::Break(())
}

/// A stored time; an invalid one counts as zero.
fn seconds(kept: f64) -> Duration {
    Duration::try_from_secs_f64(kept).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(shots: &[Arc<FrameState>]) -> Vec<usize> {
        shots.iter().map(|s| s.frame).collect()
    }

    #[test]
    fn a_run_of_any_length_keeps_few_frames_evenly_apart() {
        let mut shots = Shots::new(true);
        let mut most = 0;
        for frame in 0..=100_000 {
            let snapshot = FrameState {
                frame,
                time: frame as f64,
                bodies: Vec::new(),
                bones: Vec::new(),
            };
            shots.add_stretched(&Arc::new(snapshot), 0.0);
            let turned = frames(&shots.of_turntable());
            most = most.max(turned.len());
            assert!(
                turned.first() == Some(&0) && turned.last() == Some(&frame),
                "{turned:?}"
            );
            assert!(
                shots.turned.shots.len() <= MOST_TURNED
                    && turned.len() >= (frame + 1).min(MOST_TURNED / 2)
            );
            // All except the last have the distance of the first two.
            let even = |pair: &[usize]| pair[1] - pair[0] == turned[1];
            assert!(
                turned
                    .split_last()
                    .is_some_and(|(_, all)| all.windows(2).all(even)),
                "{turned:?}"
            );
        }
        assert_eq!(most, MOST_TURNED + 1);
        assert!(shots.animation.shots.len() <= MOST_PICTURES);
        assert_eq!(frames(&shots.animation.shots)[..3], [0, 256, 512]);
        assert!(
            Shots::new(false).animation.shots.is_empty()
                && Shots::new(false).of_turntable().is_empty()
        );
    }
}
