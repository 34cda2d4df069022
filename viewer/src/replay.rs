//! The frames of a finished run in a session: any frame, forwards and backwards.
//!
//! Only the collection is read at the start. A frame is read for its display and cached while there
//! is memory. Rigid bodies get a pose computed from their vertices.
//!
//! *Limitations.* A run that ended before it wrote its collection cannot be played. Stretch, depth
//! and speed are those of the files: no file of `pliant run` contains the depth of a vertex.

mod files;
mod run_metadata;
mod timeline;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::panel::Control;
use super::recipe::{Refused, check_index};
use super::session::Command;
use super::snapshot::{
    BodyShot, BoneShot, Probe, Reading, Shot, Stage, StageBody, Steering, Tissue,
};
use super::subject::{Advanced, Subject, Watch};
use files::{Deformed, Files, Origin, Shown, is_rigid, plain_name};
use pliant::io::{LIST, ReadError, file_name, pvd};
use pliant::mesh::measures::max_or_nan;
use run_metadata::{Kind, Measured, RunMetadata};
use timeline::{Timeline, USUAL_RATE};

/// Greatest size of the cache of frames [bytes].
const ROOM: usize = 256 << 20;

/// Greatest number of damaged frames that are reported separately.
const REPORTED_ONE_BY_ONE: usize = 5;

/// The answer of a finished run to a change.
const ONLY_PLAYED: &str =
    "a finished run is only played; run the scene to change it: pliant view SCENE";

/// The reason why a run cannot be played, with advice.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The path does not exist.
    #[error("there is no folder `{0}`; name one that `pliant run` wrote, such as pliant-out/hip")]
    NoFolder(PathBuf),
    /// The path is a file, but no collection.
    #[error("`{0}` is no folder and no .pvd; name the folder that `pliant run` wrote")]
    NotAFolder(PathBuf),
    /// The folder contains no frames of a run.
    #[error(
        "`{0}` has no .pvd, so there are no frames to play; name a folder that `pliant run` wrote"
    )]
    NoCollection(PathBuf),
    /// The list of the frames does not exist yet.
    #[error(
        "`{0}` has no .pvd yet: its run goes on, or was killed; wait for its end, or finish it: resume a run \
         with checkpoints, run any other again"
    )]
    Unfinished(PathBuf),
    /// There are several collections.
    #[error("`{folder}` has {} collections; name one of them: {}", files.len(), files.join(", "))]
    Several {
        /// The folder.
        folder: PathBuf,
        /// Names of the collections.
        files: Vec<String>,
    },
    /// The folder cannot be read.
    #[error("`{folder}` cannot be read: {source}; check whether you may read it")]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The collection is damaged.
    #[error("{}", .0.terse())]
    Collection(Box<ReadError>),
    /// The collection is empty.
    #[error("`{0}` lists no frames; run the scene again")]
    Empty(PathBuf),
    /// No frame can be read.
    #[error("none of the {frames} frames can be shown; frame {first}: {why}")]
    NoFrame {
        /// Number of frames.
        frames: usize,
        /// Index of the first frame.
        first: usize,
        /// The error of the first frame, with advice.
        why: String,
    },
}

/// The contents of a frame: the index of each part, and its file's content.
type Scenery = Vec<(usize, Arc<Shown>)>;

/// A finished run in a session.
pub struct Replay {
    timeline: Timeline,
    files: Files,
    metadata: RunMetadata,
    rate: f64,
    /// Index of the displayed moment, and its contents.
    at: usize,
    now: Scenery,
    stage: Arc<Stage>,
    backwards: bool,
    probe: Option<(usize, usize)>,
    /// Errors of frames, by the index of their moment.
    damaged: BTreeMap<usize, String>,
    controls: Arc<Vec<Control>>,
}

impl Replay {
    /// Opens the results of a run at their first frame: a folder with one collection, or a
    /// collection.
    ///
    /// # Errors
    /// No such folder, no collection in it or several, a damaged one, or no readable frame.
    pub fn open(path: &Path) -> Result<Self, ReplayError> {
        let path = collection_of(path)?;
        let collection =
            pvd::read(&path).map_err(|error| ReplayError::Collection(Box::new(error)))?;
        let timeline = Timeline::of(&collection);
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let (rate, is_own) = timeline.rate();
        let mut metadata = RunMetadata::read(&folder);
        if !is_own && timeline.moments.len() > 1 {
            metadata.notes.push(format!(
                "the times of the frames make no film; {USUAL_RATE} frames a second are shown"
            ));
        }
        let mut replay = Self {
            files: Files::new(folder, timeline.parts.len(), ROOM),
            timeline,
            metadata,
            rate,
            at: 0,
            now: Vec::new(),
            stage: Arc::default(),
            backwards: false,
            probe: None,
            damaged: BTreeMap::new(),
            controls: Arc::default(),
        };
        let Some(first) = replay.timeline.moments.first().map(|moment| moment.frame) else {
            return Err(ReplayError::Empty(path));
        };
        let frames = replay.timeline.moments.len();
        replay.rewind().map_err(|error| ReplayError::NoFrame {
            frames,
            first,
            why: error.terse(),
        })?;
        Ok(replay)
    }

    /// Displays the first readable frame; the error is that of the very first frame.
    fn rewind(&mut self) -> Result<(), ReadError> {
        let mut first = None;
        for k in 0..self.timeline.moments.len() {
            match self.show(k) {
                Ok(()) => return Ok(()),
                Err(error) => first.get_or_insert(error),
            };
        }
        first.map_or(Ok(()), Err)
    }

    /// Displays a moment; if one of its files cannot be read, the display is unchanged.
    fn show(&mut self, k: usize) -> Result<(), ReadError> {
        let moment = &self.timeline.moments[k];
        let (parts, files) = (&self.timeline.parts, &mut self.files);
        let get = |&(part, file): &(usize, usize)| {
            let shown = files.get((part, &parts[part]), (file, &self.timeline.files[file]))?;
            Ok((part, shown))
        };
        match moment
            .shows
            .iter()
            .map(get)
            .collect::<Result<Scenery, ReadError>>()
        {
            Ok(now) => {
                // The file may have been rewritten.
                self.damaged.remove(&k);
                let is_same = now.len() == self.now.len()
                    && now.iter().zip(&self.now).all(|(a, b)| same_on_stage(a, b));
                (self.at, self.now) = (k, now);
                if !is_same {
                    self.stage = Arc::new(self.set());
                    self.probe = None;
                }
                Ok(())
            }
            Err(error) => {
                self.damaged.insert(k, error.terse());
                Err(error)
            }
        }
    }

    /// The moment after or before one.
    fn next(&self, k: usize) -> Option<usize> {
        let next = if self.backwards {
            k.checked_sub(1)
        } else {
            Some(k + 1)
        };
        next.filter(|k| *k < self.timeline.moments.len())
    }

    fn bodies(&self) -> impl Iterator<Item = (&str, &Deformed)> {
        let name = |part: usize| self.timeline.parts[part].as_str();
        self.now
            .iter()
            .filter_map(move |(part, shown)| match &**shown {
                Shown::Body(body) => Some((name(*part), body)),
                Shown::Bone { .. } => None,
            })
    }

    /// Bodies with edge strains: those of an implant have no rest lengths, and zeros in their
    /// files.
    fn stretched(&self) -> impl Iterator<Item = (&str, &Deformed)> {
        let is_implant =
            |name: &str, body: &Deformed| self.tissue(name, body.shape.origin) == Tissue::Implant;
        self.bodies()
            .filter(move |(name, body)| !body.stretch.is_empty() && !is_implant(name, body))
    }

    /// The stage of the displayed frame.
    fn set(&self) -> Stage {
        let body = |(name, body): (&str, &Deformed)| StageBody {
            name: plain_name(name).to_owned(),
            tissue: self.tissue(name, body.shape.origin),
            triangles: body.shape.triangles.clone(),
            edges: body.shape.edges.clone(),
            held: body.shape.held.clone(),
            fibres: Default::default(),
        };
        let bone = |(part, shown): &(usize, Arc<Shown>)| match &**shown {
            Shown::Bone { own, .. } => Some((
                plain_name(&self.timeline.parts[*part]).to_owned(),
                (**own).clone(),
            )),
            Shown::Body(_) => None,
        };
        Stage {
            bodies: self.bodies().map(body).collect(),
            bones: self.now.iter().filter_map(bone).collect(),
        }
    }

    fn tissue(&self, name: &str, origin: Origin) -> Tissue {
        match (&self.metadata.kind, origin) {
            _ if is_rigid(name) => Tissue::Bone,
            (Kind::Skin(skin), Origin::Scene) if file_name(skin) == name => Tissue::Skin,
            (Kind::Skin(_), Origin::Scene) => Tissue::Implant,
            (Kind::Muscles, Origin::Scene | Origin::Bare) => Tissue::Muscle,
            _ => Tissue::Plain,
        }
    }

    fn frame(&self) -> usize {
        self.timeline
            .moments
            .get(self.at)
            .map_or(0, |moment| moment.frame)
    }

    /// The measures of the displayed frame.
    fn measured(&self) -> &[Measured] {
        let measured = self.metadata.frames.get(&self.frame());
        measured.map(Vec::as_slice).unwrap_or_default()
    }

    /// The measures of a body by its name in files.
    fn measured_of(&self, name: &str) -> Option<&Measured> {
        self.measured()
            .iter()
            .find(|m| file_name(&self.metadata.bodies[m.body]) == name)
    }

    /// Volume error, stretch and depth, with the names and units of running muscles.
    fn readings(&self) -> Vec<Reading> {
        let measured = self.measured();
        let mut all = Vec::new();
        let mut add = |name, of: &str, unit, value| {
            all.push(Reading {
                name,
                of: of.to_owned(),
                unit,
                value,
            })
        };
        for m in measured {
            let of = self.metadata.bodies[m.body].as_str();
            if let Some(error) = m.volume_error {
                add("Volume error", of, "", error.abs());
            }
            for (_, body) in self.stretched().filter(|(name, _)| *name == file_name(of)) {
                add("Greatest stretch", of, "%", greatest_stretch(body));
            }
            if let Some(depth) = m.depth {
                add("Greatest depth", of, "mm", 1e3 * depth);
            }
        }
        for (name, body) in self.stretched() {
            if self.measured_of(name).is_some() {
                continue;
            }
            add("Greatest stretch", name, "%", greatest_stretch(body));
        }
        // A single body needs no name.
        if all.iter().all(|reading| reading.of == all[0].of) {
            all.iter_mut().for_each(|reading| reading.of.clear());
        }
        all
    }

    fn probed(&self) -> Option<Probe> {
        let (body, vertex) = self.probe?;
        let (_, shown) = self.bodies().nth(body)?;
        let fields = [
            ("stretch", &shown.stretch, 100.0, "%"),
            ("speed", &shown.speed, 1e3, "mm/s"),
            ("depth", &shown.depth, 1e3, "mm"),
        ];
        let value = |(name, field, factor, unit): (_, &Vec<f64>, f64, _)| {
            Some((name, factor * field.get(vertex)?, unit))
        };
        Some(Probe {
            body,
            vertex,
            values: fields.into_iter().filter_map(value).collect(),
        })
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = self.metadata.notes.clone();
        let each = self.damaged.iter().take(REPORTED_ONE_BY_ONE);
        notes.extend(
            each.map(|(k, why)| format!("frame {}: {why}", self.timeline.moments[*k].frame)),
        );
        if let Some(more @ 1..) = self.damaged.len().checked_sub(REPORTED_ONE_BY_ONE) {
            notes.push(format!("{more} more frames cannot be shown"));
        }
        notes
    }

    fn seek(&mut self, frame: usize) -> Result<(), Refused> {
        let last = self
            .timeline
            .moments
            .last()
            .map_or(0, |moment| moment.frame);
        check_index("frame", frame, last.saturating_add(1))?;
        match self.timeline.nearest(frame) {
            Some(k) if k != self.at => {
                let frame = self.timeline.moments[k].frame;
                self.show(k).map_err(|error| Refused::Damaged {
                    frame,
                    why: error.terse(),
                })
            }
            _ => Ok(()),
        }
    }
}

/// Greatest stretch of a body [%].
fn greatest_stretch(body: &Deformed) -> f64 {
    100.0 * max_or_nan(body.stretch.iter().copied())
}

/// True if two displayed parts need the same stage.
fn same_on_stage((a, shown): &(usize, Arc<Shown>), (b, before): &(usize, Arc<Shown>)) -> bool {
    a == b
        && match (&**shown, &**before) {
            (Shown::Bone { own: a, .. }, Shown::Bone { own: b, .. }) => Arc::ptr_eq(a, b),
            (Shown::Body(a), Shown::Body(b)) => {
                a.positions.len() == b.positions.len()
                    && (Arc::ptr_eq(&a.shape, &b.shape) || a.shape == b.shape)
            }
            _ => false,
        }
}

/// The collection in a folder, or the path itself if it is a collection.
fn collection_of(path: &Path) -> Result<PathBuf, ReplayError> {
    let is_collection = |path: &Path| {
        path.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("pvd"))
    };
    if path.is_file() {
        return if is_collection(path) {
            Ok(path.to_owned())
        } else {
            Err(ReplayError::NotAFolder(path.to_owned()))
        };
    }
    let folder = |source| match source {
        ref error if std::io::Error::kind(error) == std::io::ErrorKind::NotFound => {
            ReplayError::NoFolder(path.to_owned())
        }
        source => ReplayError::Folder {
            folder: path.to_owned(),
            source,
        },
    };
    let mut found = Vec::new();
    for entry in fs::read_dir(path).map_err(folder)? {
        let file = entry.map_err(folder)?.path();
        if is_collection(&file) && file.is_file() {
            found.push(file);
        }
    }
    found.sort_unstable();
    match found.len() {
        0 if path.join(LIST).is_file() && path.join("frames").is_dir() => {
            Err(ReplayError::Unfinished(path.to_owned()))
        }
        0 => Err(ReplayError::NoCollection(path.to_owned())),
        1 => Ok(found.swap_remove(0)),
        _ => {
            let files = found
                .iter()
                .map(|file| file.display().to_string())
                .collect();
            Err(ReplayError::Several {
                folder: path.to_owned(),
                files,
            })
        }
    }
}

impl Subject for Replay {
    fn frame_rate(&self) -> f64 {
        self.rate
    }

    fn shot(&mut self) -> Shot {
        let body = |(name, body): (&str, &Deformed)| BodyShot {
            positions: body.positions.clone(),
            stretch: body.stretch.clone(),
            depth: body.depth.clone(),
            speed: body.speed.clone(),
            volume_error: self
                .measured_of(name)
                .and_then(|m| m.volume_error)
                .unwrap_or(0.0),
            ..BodyShot::default()
        };
        let bone = |(_, shown): &(usize, Arc<Shown>)| match &**shown {
            Shown::Bone { pose, .. } => Some(BoneShot {
                pose: *pose,
                angle: None,
                steering: Steering::Motion,
            }),
            Shown::Body(_) => None,
        };
        Shot {
            frame: self.frame(),
            last_frame: self
                .timeline
                .moments
                .last()
                .map_or(0, |moment| moment.frame),
            stage: self.stage.clone(),
            scene: None,
            controls: self.controls.clone(),
            bodies: self.bodies().map(body).collect(),
            bones: self.now.iter().filter_map(bone).collect(),
            handles: Vec::new(),
            readings: self.readings(),
            probe: self.probed(),
            effects: Vec::new(),
            notes: self.notes(),
        }
    }

    fn advance(&mut self, watch: Watch<'_>) -> Advanced {
        let mut k = self.at;
        while let Some(next) = self.next(k) {
            if self.show(next).is_ok() {
                return if self.next(next).is_some() {
                    Advanced::Running
                } else {
                    Advanced::Finished
                };
            }
            // Damaged frames are skipped.
            if watch.is_ended() {
                return Advanced::Interrupted;
            }
            k = next;
        }
        Advanced::Finished
    }

    fn apply(&mut self, command: &Command) -> Result<(), Refused> {
        match command {
            Command::Reset => {
                let frame = self
                    .timeline
                    .moments
                    .first()
                    .map_or(0, |moment| moment.frame);
                self.rewind().map_err(|error| Refused::Damaged {
                    frame,
                    why: error.terse(),
                })
            }
            Command::Seek { frame } => self.seek(*frame),
            Command::Backwards(backwards) => {
                self.backwards = *backwards;
                Ok(())
            }
            Command::Probe(None) => {
                self.probe = None;
                Ok(())
            }
            Command::Probe(Some((body, vertex))) => {
                let counts: Vec<usize> = self
                    .bodies()
                    .map(|(_, body)| body.positions.len())
                    .collect();
                check_index("body", *body, counts.len())?;
                check_index("vertex", *vertex, counts[*body])?;
                self.probe = Some((*body, *vertex));
                Ok(())
            }
            // The session handles these commands itself.
            Command::Pause | Command::Run | Command::Step | Command::Speed(_) => Ok(()),
            _ => Err(Refused::NotHere(ONLY_PLAYED)),
        }
    }
}
