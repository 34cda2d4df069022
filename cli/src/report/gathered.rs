//! The accumulated results of a run up to a frame, stored with its checkpoint so that tables,
//! pictures and times continue.

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use super::audit::RunAudit;
use super::folder::FolderError;
use super::frames::{FIELDS, Listing, Stored, with_bodies};
use super::quality::RunQuality;
use super::record::{FrameTimes, Record};
use super::results::severity;
use super::shots::Shots;
use pliant::simulation::{
    AuditSummary, FrameState, Measures, Scenario, SceneDescription, Simulation,
};
use pliant::solvers::effect_of_name;
use pliant::state::{DecodeError, Reader, Writer};

/// Seconds and calls of the effects on one muscle, by name.
type Clock = Vec<(String, (f64, u64))>;

/// Accumulated results up to the frame of a checkpoint.
#[derive(Debug)]
pub struct Gathered {
    /// Number of frames between checkpoints.
    pub every: usize,
    /// Contents of the files of frames.
    pub stored: Stored,
    /// Time so far, including reading, and the part for the preparation [s].
    pub times_s: (f64, f64),
    clocks: Vec<Clock>,
    measures: Vec<Measures>,
    times: Vec<FrameTimes>,
    audit: AuditSummary,
    pub(super) quality: RunQuality,
}

/// The bytes of the accumulated results, for [`Gathered::open`].
pub fn save(
    simulation: &Simulation,
    record: &Record,
    audit: &AuditSummary,
    quality: &RunQuality,
    (every, stored): (usize, &Stored),
    times_s: (f64, f64),
) -> Vec<u8> {
    let mut writer = Writer::default();
    writer.put(&every);
    writer.put(&stored.exact);
    writer.put(&FIELDS.map(|name| stored.fields.contains(&name)).to_vec());
    writer.put(&times_s);
    let clock = |name: &&'static str, spent: &(f64, u64)| ((*name).to_owned(), *spent);
    let clocks = simulation.bodies.iter().map(|b| {
        b.system
            .clock
            .effects
            .iter()
            .map(|(k, v)| clock(k, v))
            .collect()
    });
    writer.put(&clocks.collect::<Vec<Clock>>());
    writer.list(&record.measures);
    writer.list(&record.times);
    writer.put(audit);
    quality.save(&mut writer);
    writer.bytes
}

impl Gathered {
    /// Reads the bytes of [`save`]; `simulation` must be at the same frame as then.
    ///
    /// # Errors
    /// The bytes belong to another simulation or frame, or are damaged.
    pub fn open(bytes: &[u8], simulation: &Simulation) -> Result<Self, DecodeError> {
        let mut from = Reader::new(bytes);
        let every = from.take()?;
        let exact = from.take()?;
        let is_stored: Vec<bool> = from.take()?;
        from.check(is_stored.len() == FIELDS.len(), "other fields of frames")?;
        let fields = FIELDS.into_iter().zip(is_stored);
        let fields = fields.filter_map(|(name, is_stored)| is_stored.then_some(name));
        let fields = fields.collect();
        let times_s = from.take()?;
        let clocks: Vec<Clock> = from.take()?;
        let bodies = &simulation.bodies;
        from.check(clocks.len() == bodies.len(), "clocks of other muscles")?;
        let known = |(name, _): &(String, _)| effect_of_name(name).is_some();
        from.check(
            clocks.iter().flatten().all(known),
            "no effect has this name",
        )?;
        let measures: Vec<Measures> = from.take()?;
        let expected = (0..=simulation.frame())
            .flat_map(|frame| bodies.iter().map(move |body| (frame, &body.name)));
        from.check(
            measures.iter().map(|m| (m.frame, &m.muscle)).eq(expected),
            "measures of other frames or muscles",
        )?;
        let times: Vec<FrameTimes> = from.take()?;
        from.check(
            times.iter().map(|t| t.frame).eq(1..=simulation.frame()),
            "times of other frames",
        )?;
        let audit: AuditSummary = from.take()?;
        from.check(
            audit.frames == RunAudit::frames_at(simulation.frame()),
            "an audit of other frames",
        )?;
        let quality = RunQuality::open(&mut from, simulation)?;
        from.end()?;
        Ok(Self {
            every,
            stored: Stored { fields, exact },
            times_s,
            clocks,
            measures,
            times,
            audit,
            quality,
        })
    }

    /// The audit so far; `first` is the start of `simulation`.
    pub(super) fn audit(&mut self, simulation: &Simulation, first: &FrameState) -> RunAudit {
        RunAudit::resume(simulation, first, std::mem::take(&mut self.audit))
    }

    /// The record so far; the clocks of `simulation` continue from it.
    pub(super) fn record(self, simulation: &mut Simulation) -> Record {
        for (body, clock) in simulation.bodies.iter_mut().zip(self.clocks) {
            let known = clock
                .into_iter()
                .filter_map(|(name, spent)| Some((effect_of_name(&name)?, spent)));
            body.system.clock.effects = known.collect();
        }
        Record::going_on(simulation, self.measures, self.times)
    }

    /// The shots of the frames so far: the start and the last from memory, others from their files
    /// in `root`.
    pub(super) fn shots(
        &self,
        cast: &SceneDescription,
        simulation: &Simulation,
        root: &Path,
        first: FrameState,
        animate: bool,
    ) -> Result<Shots, FolderError> {
        let mut shots = Shots::new(animate);
        let count = simulation.bodies.len().max(1);
        for frame in 0..=simulation.frame() {
            let measures = &self.measures[(frame * count).min(self.measures.len())..];
            // The frame numbers and measures decide which frames are shown.
            shots.add(
                &Arc::new(simulation.state_of_bones(frame)),
                severity(&measures[..count.min(measures.len())]),
            );
        }
        let mut known: HashMap<usize, Arc<FrameState>> = HashMap::new();
        known.insert(simulation.frame(), Arc::new(simulation.state()));
        known.insert(0, Arc::new(first));
        for frame in shots.all().map(|shot| shot.frame).collect::<HashSet<_>>() {
            if let std::collections::hash_map::Entry::Vacant(place) = known.entry(frame) {
                let bones = simulation.state_of_bones(frame);
                place.insert(Arc::new(with_bodies(cast, root, bones)?));
            }
        }
        for shot in shots.all_mut() {
            if let Some(whole) = known.get(&shot.frame) {
                *shot = whole.clone();
            }
        }
        Ok(shots)
    }
}

/// The list of the frames so far, and all their files.
pub(super) fn listing(
    cast: &SceneDescription,
    simulation: &Simulation,
) -> (Listing, HashSet<String>) {
    let mut listing = Listing::new(cast);
    let mut files = HashSet::new();
    for frame in 0..=simulation.frame() {
        let FrameState { time, bones, .. } = simulation.state_of_bones(frame);
        files.extend(listing.add(cast, frame, time, &bones).all().cloned());
    }
    (listing, files)
}
