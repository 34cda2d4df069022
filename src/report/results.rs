//! The results of a run, gathered frame by frame and written into a folder.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::folder::{Folder, FolderError};
use super::frames::{Cast, FrameWriter, Snapshot, file_name};
use super::record::Record;
use super::summary::Summary;
use crate::simulation::{Measures, Simulation};

/// An animation shows every so many frames.
const ANIMATION_STEP: usize = 4;

/// Pictures of an animation at most; a longer run shows every second, and so on.
const MOST_PICTURES: usize = 500;

/// The frames that pictures are made of.
#[derive(Clone, Debug, Default)]
pub struct Shots {
    /// The start.
    pub first: Option<Arc<Snapshot>>,
    /// The frame with the greatest edge stretch, and that stretch.
    pub worst: Option<(f64, Arc<Snapshot>)>,
    /// The last frame.
    pub last: Option<Arc<Snapshot>>,
    /// Frames of the animation; none unless one is wanted.
    pub animation: Vec<Arc<Snapshot>>,
    /// An animation shows every so many frames; 0 for no animation.
    pub step: usize,
}

impl Shots {
    fn add(&mut self, snapshot: &Arc<Snapshot>, measures: &[Measures]) {
        self.first.get_or_insert_with(|| snapshot.clone());
        let stretch = measures.iter().map(|m| m.edge_stretch_rms).fold(0.0, f64::max);
        if self.worst.as_ref().is_none_or(|(most, _)| stretch > *most) {
            self.worst = Some((stretch, snapshot.clone()));
        }
        self.last = Some(snapshot.clone());
        if self.step > 0 && snapshot.frame.is_multiple_of(self.step) {
            self.animation.push(snapshot.clone());
            if self.animation.len() > MOST_PICTURES {
                self.step = self.step.saturating_mul(2);
                let step = self.step;
                self.animation.retain(|s| s.frame.is_multiple_of(step));
            }
        }
    }
}

/// Results that are being gathered.
pub struct Results {
    folder: Arc<Folder>,
    cast: Arc<Cast>,
    writer: FrameWriter,
    record: Record,
    shots: Shots,
    begun: Instant,
}

impl Results {
    /// Begins with the start of `simulation`; `begun` is when the run began, with all its reading.
    ///
    /// # Errors
    /// The folder cannot be used.
    pub fn begin(folder: Folder, simulation: &Simulation, animate: bool, begun: Instant) -> Result<Self, FolderError> {
        let folder = Arc::new(folder);
        let cast = Arc::new(Cast::of(simulation));
        let writer = FrameWriter::start(folder.clone(), cast.clone());
        let shots = Shots { step: if animate { ANIMATION_STEP } else { 0 }, ..Shots::default() };
        Ok(Self { folder, cast, writer, record: Record::default(), shots, begun })
    }

    /// Takes the frame that `simulation` has just computed in `step`, measures it, and hands it to the writer.
    /// False once frames cannot be written any more: [`Self::finish`] then tells why.
    pub fn frame(&mut self, simulation: &Simulation, step: Duration) -> bool {
        let before = Instant::now();
        let measures = simulation.measure();
        let audit = before.elapsed();
        let snapshot = Arc::new(Snapshot::of(simulation));
        self.shots.add(&snapshot, &measures);
        self.record.add(simulation, measures, step, audit);
        self.writer.push(snapshot)
    }

    /// Measures of the last frame, muscle by muscle.
    pub fn last(&self) -> &[Measures] {
        let all = &self.record.measures;
        &all[all.len().saturating_sub(self.cast.muscles.len())..]
    }

    /// Writes all that is not written yet, `summary.json` last.
    ///
    /// # Errors
    /// What kept a file from being written.
    pub fn finish(self, simulation: &Simulation, interrupted: bool) -> Result<Summary, FolderError> {
        let collection = self.writer.finish()?;
        let pvd = format!("{}.pvd", file_name(&simulation.scene.name));
        let path = self.folder.claim(&pvd)?;
        collection.write(&path).map_err(|source| FolderError::Io { path, source })?;
        let record = &self.record;
        self.folder.write("measures.csv", |w| record.write_measures(w))?;
        self.folder.write("times.csv", |w| record.write_times(w))?;
        let summary = Summary::of(simulation, record, interrupted, self.begun.elapsed().as_secs_f64());
        let json = summary.to_json();
        self.folder.write("summary.json", |w| std::io::Write::write_all(w, json.as_bytes()))?;
        Ok(summary)
    }
}
