//! What a run gathered up to a frame: kept beside its checkpoint, so that tables, pictures and times go on where it stopped.

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use nalgebra::Vector3;

use super::folder::FolderError;
use super::frames::{Listing, file_at};
use super::record::{FrameTimes, Record};
use super::results::Shots;
use pliant::simulation::{FrameState, Measures, Scenario, SceneDescription, Simulation};
use pliant::solvers::effect_of_name;
use pliant::state::{DecodeError, Reader, Writer};

/// Seconds and calls of the effects on one muscle, by name.
type Clock = Vec<(String, (f64, u64))>;

/// What a run gathered up to the frame of its checkpoint.
#[derive(Clone, Debug)]
pub struct Gathered {
    /// Frames from one checkpoint to the next.
    pub every: usize,
    /// Time so far, with all reading, and of it that of making ready [s].
    pub times_s: (f64, f64),
    clocks: Vec<Clock>,
    measures: Vec<Measures>,
    times: Vec<FrameTimes>,
}

/// The bytes of what a run gathered, for [`Gathered::open`].
pub fn save(
    simulation: &Simulation,
    record: &Record,
    every: usize,
    times_s: (f64, f64),
) -> Vec<u8> {
    let mut writer = Writer::default();
    writer.put(&every);
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
    writer.bytes
}

impl Gathered {
    /// What [`save`] wrote when `simulation` was at the frame where it is now.
    ///
    /// # Errors
    /// It is of another simulation or another frame, or damaged.
    pub fn open(bytes: &[u8], simulation: &Simulation) -> Result<Self, DecodeError> {
        let mut from = Reader::new(bytes);
        let every = from.take()?;
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
        let wanted = (0..=simulation.frame())
            .flat_map(|frame| bodies.iter().map(move |body| (frame, &body.name)));
        from.check(
            measures.iter().map(|m| (m.frame, &m.muscle)).eq(wanted),
            "measures of other frames or muscles",
        )?;
        let times: Vec<FrameTimes> = from.take()?;
        from.check(
            times.iter().map(|t| t.frame).eq(1..=simulation.frame()),
            "times of other frames",
        )?;
        from.end()?;
        Ok(Self {
            every,
            times_s,
            clocks,
            measures,
            times,
        })
    }

    /// The record so far; clocks of `simulation` go on from where they were.
    pub(super) fn record(self, simulation: &mut Simulation) -> Record {
        for (body, clock) in simulation.bodies.iter_mut().zip(self.clocks) {
            let known = clock
                .into_iter()
                .filter_map(|(name, spent)| Some((effect_of_name(&name)?, spent)));
            body.system.clock.effects = known.collect();
        }
        Record::going_on(simulation, self.measures, self.times)
    }

    /// The shots of the frames so far: of the start and of the last as at hand, of others from their files in `root`.
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
            // Which frames are shown follows from their numbers and measures.
            shots.add(
                &Arc::new(simulation.state_of_bones(frame)),
                &measures[..count.min(measures.len())],
            );
        }
        let mut known: HashMap<usize, Arc<FrameState>> = HashMap::new();
        known.insert(simulation.frame(), Arc::new(simulation.state()));
        known.insert(0, Arc::new(first));
        for frame in shots.all().map(|shot| shot.frame).collect::<HashSet<_>>() {
            if let std::collections::hash_map::Entry::Vacant(place) = known.entry(frame) {
                place.insert(Arc::new(read(cast, simulation, root, frame)?));
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

/// A frame from its files. They hold no velocities, and no picture shows any.
fn read(
    cast: &SceneDescription,
    simulation: &Simulation,
    root: &Path,
    frame: usize,
) -> Result<FrameState, FolderError> {
    let mut snapshot = simulation.state_of_bones(frame);
    for actor in &cast.bodies {
        let path = root.join(file_at(actor, frame));
        if !path.is_file() {
            return Err(FolderError::Missing(path));
        }
        let count = actor.rest.vertices.len();
        match pliant::io::read(&path) {
            Ok(file) if file.mesh.vertices.len() == count => {
                snapshot
                    .bodies
                    .push((file.mesh.vertices, vec![Vector3::zeros(); count]));
            }
            _ => return Err(FolderError::Changed(path)),
        }
    }
    Ok(snapshot)
}

/// The list of the frames so far, and all files that show them.
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
