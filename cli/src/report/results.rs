//! The results of a run of muscles, gathered frame by frame, with checkpoints.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

use super::audit::RunAudit;
use super::folder::{Folder, FolderError};
use super::frames::{Listing, Stored};
use super::gathered::{self, Gathered};
use super::muscles;
use super::places;
use super::quality::RunQuality;
use super::record::Record;
use super::run::{Finished, Frames, end_unless};
use super::shots::Shots;
use pliant::mesh::measures::max_or_nan;
use pliant::simulation::checkpoint::{self, Fingerprint};
use pliant::simulation::{Ended, FrameState, Measures, Observer, Scenario, Simulation};

/// Results during a run.
pub struct Results {
    frames: Frames,
    record: Record,
    audit: RunAudit,
    quality: RunQuality,
    /// Contents of the files of frames, for checkpoints.
    stored: Stored,
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
    pub fn begin(
        folder: Folder,
        simulation: &Simulation,
        stored: Stored,
        animate: bool,
        begun: Instant,
    ) -> Self {
        let scene = simulation.description();
        let (listing, shots) = (Listing::new(&scene), Shots::new(animate));
        let with = (listing, stored.clone());
        let frames = Frames::start(folder, scene, with, shots, begun, Default::default());
        Self {
            frames,
            stored,
            record: Record::default(),
            audit: RunAudit::new(),
            quality: RunQuality::default(),
            checkpoints: None,
        }
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
        mut gathered: Gathered,
        first: FrameState,
        animate: bool,
        begun: Instant,
    ) -> Result<Self, FolderError> {
        let scene = simulation.description();
        let audit = gathered.audit(simulation, &first);
        let quality = std::mem::take(&mut gathered.quality);
        let stored = gathered.stored.clone();
        let shots = gathered.shots(&scene, simulation, root, first, animate)?;
        let (listing, files) = gathered::listing(&scene, simulation);
        let folder = Folder::resume(root, &files, |file| {
            !animate && file.ends_with(".gif") || places::is_picture(file)
        })?;
        let (total, prepared) = gathered.times_s;
        let earlier = (seconds(total), seconds(prepared));
        Ok(Self {
            frames: Frames::start(
                folder,
                scene,
                (listing, stored.clone()),
                shots,
                begun,
                earlier,
            ),
            stored,
            record: gathered.record(simulation),
            audit,
            quality,
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
        let Some(due) = &mut self.checkpoints else {
            return true;
        };
        if due.last == Some(frame) || !(end || frame.is_multiple_of(due.every)) {
            return true;
        }
        due.last = Some(frame);
        let spent = self.frames.spent();
        let beside = gathered::save(
            simulation,
            &self.record,
            &self.audit.summary,
            &self.quality,
            (due.every, &self.stored),
            spent,
        );
        let bytes = checkpoint::save(simulation, &due.fingerprint, &beside);
        self.frames.add_checkpoint(bytes)
    }

    /// Adds the frame that `simulation` has just computed in `step`, measures it, and passes it to
    /// the writer. Returns false after an error of the writer: [`Self::finish`] then returns the
    /// error.
    pub fn frame(&mut self, simulation: &Simulation, step: Duration) -> bool {
        let before = Instant::now();
        let measures = simulation.measure();
        self.audit.frame(simulation);
        self.quality.frame(simulation);
        let audit = before.elapsed();
        let severity = severity(&measures);
        self.record.add(simulation, measures, step, audit);
        self.frames.add(simulation.state(), severity)
    }

    /// Writes a text into the folder.
    ///
    /// # Errors
    /// An error of writing.
    pub fn write(&self, file: &str, text: &str) -> Result<(), FolderError> {
        self.frames.write(file, text)
    }

    /// Measures of the last frame, for each muscle.
    pub fn last(&self) -> &[Measures] {
        let all = &self.record.measures;
        &all[all.len().saturating_sub(self.frames.scene.bodies.len())..]
    }

    /// Ends the run. `settings` are names and values for the report.
    ///
    /// # Errors
    /// An error of writing.
    pub fn finish(
        mut self,
        simulation: &Simulation,
        settings: &[(String, String)],
        ended: &Ended,
    ) -> Result<Finished<'static>, FolderError> {
        self.audit.finish(simulation);
        self.quality.finish(simulation);
        let judged = (&self.audit, &self.quality);
        let own = muscles::output(simulation, self.record, judged);
        self.frames.finish(simulation, own, ended, settings)
    }
}

/// The severity of a frame, as [`Scenario::severity`].
pub(super) fn severity(measures: &[Measures]) -> f64 {
    max_or_nan(measures.iter().map(|m| m.edge_stretch_rms))
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

/// A stored time; an invalid one counts as zero.
fn seconds(kept: f64) -> Duration {
    Duration::try_from_secs_f64(kept).unwrap_or_default()
}
