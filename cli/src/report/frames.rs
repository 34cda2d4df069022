//! The frames of a run as files for ParaView, written by a thread during the computation of the
//! next frame.

use std::io::Write;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use nalgebra::{Isometry3, Point3, Vector3};

use super::folder::{CHECKPOINT, Folder, FolderError};
use pliant::TriangleMesh;
use pliant::io::pvd::{Collection, Entry};
use pliant::io::vtp::{self, PolyData};
use pliant::simulation::{BodyDescription, FrameState, SceneDescription, strain_at_vertices};

/// Greatest number of frames in the queue of the writer; more would only use memory.
const WAITING: usize = 4;

/// The file that shows a body in a frame.
pub fn file_at(body: &BodyDescription, frame: usize) -> String {
    format!("frames/{}_{frame:04}.vtp", body.file)
}

/// Mean absolute strain of a body's edges at each vertex, at positions `x`.
pub fn stretch(body: &BodyDescription, x: &[Point3<f64>]) -> Vec<f64> {
    strain_at_vertices(&body.edges, x)
}

/// The files of each frame, as determined by the poses of the bones alone.
#[derive(Clone, Debug)]
pub struct Listing {
    /// The files so far, for ParaView.
    pub collection: Collection,
    /// The last pose of each bone, and its file.
    bones: Vec<Option<(Isometry3<f64>, String)>>,
}

/// The files of one frame: of each muscle and its fibres, if any, and of the bones that moved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Files {
    /// File of each muscle, and of its fibres.
    pub muscles: Vec<(String, Option<String>)>,
    /// File of each bone; `None` if an earlier file shows it.
    pub bones: Vec<Option<String>>,
}

impl Files {
    /// All files.
    pub fn all(&self) -> impl Iterator<Item = &String> {
        let muscles = self
            .muscles
            .iter()
            .flat_map(|(muscle, fibres)| [Some(muscle), fibres.as_ref()]);
        muscles
            .chain(self.bones.iter().map(Option::as_ref))
            .flatten()
    }
}

impl Listing {
    /// The listing before the first frame.
    pub fn new(cast: &SceneDescription) -> Self {
        Self {
            collection: Collection::new(),
            bones: vec![None; cast.bones.len()],
        }
    }

    /// Adds the next frame, at `time` [s] with bones at `poses`. Returns its files.
    pub fn add(
        &mut self,
        cast: &SceneDescription,
        frame: usize,
        time: f64,
        poses: &[Isometry3<f64>],
    ) -> Files {
        let Self { collection, bones } = self;
        let mut part = 0;
        let mut list = |name: &str, file: &str| {
            collection.push(Entry {
                time,
                part,
                name: name.to_owned(),
                file: file.to_owned(),
            });
            part += 1;
        };
        let mut files = Files {
            muscles: Vec::new(),
            bones: Vec::new(),
        };
        for actor in &cast.bodies {
            let file = file_at(actor, frame);
            list(&actor.file, &file);
            let fibres = (!actor.fibres.is_empty())
                .then(|| format!("frames/{}_{frame:04}.vtp", actor.fibre_file));
            fibres.iter().for_each(|file| list(&actor.fibre_file, file));
            files.muscles.push((file, fibres));
        }
        for (((name, _), pose), last) in cast.bones.iter().zip(poses).zip(bones) {
            // A bone that has not moved is not written again.
            let file = match last {
                Some((before, file)) if before == pose => {
                    list(name, file);
                    None
                }
                _ => {
                    let file = format!("frames/{name}_{frame:04}.vtp");
                    list(name, &file);
                    *last = Some((*pose, file.clone()));
                    Some(file)
                }
            };
            files.bones.push(file);
        }
        files
    }
}

/// A task of the writer thread.
enum Job {
    Frame(Arc<FrameState>),
    /// A checkpoint, written after all earlier frames.
    Checkpoint(Vec<u8>),
}

/// Writes frames, and checkpoints between them, in its own thread.
pub struct FrameWriter {
    sender: SyncSender<Job>,
    thread: JoinHandle<Written>,
}

/// What the writer has written.
#[derive(Debug)]
pub struct Written {
    /// The files of all frames that are complete.
    pub collection: Collection,
    /// The error that ended the writing.
    pub error: Option<FolderError>,
}

impl FrameWriter {
    /// Starts the thread; `listing` contains the existing frames.
    pub fn start(folder: Arc<Folder>, cast: Arc<SceneDescription>, listing: Listing) -> Self {
        let (sender, receiver) = sync_channel(WAITING);
        let thread = std::thread::spawn(move || write_all(&folder, &cast, &receiver, listing));
        Self { sender, thread }
    }

    /// Passes a frame to the writer; waits if the queue is full. Returns false after an error of
    /// the writer: the caller should then end the run and call [`Self::finish`] for the error.
    pub fn push(&self, snapshot: Arc<FrameState>) -> bool {
        self.sender.send(Job::Frame(snapshot)).is_ok()
    }

    /// Passes a checkpoint to the writer, for writing after all earlier frames; otherwise as
    /// [`Self::push`].
    pub fn push_checkpoint(&self, bytes: Vec<u8>) -> bool {
        self.sender.send(Job::Checkpoint(bytes)).is_ok()
    }

    /// Waits for the last frame.
    pub fn finish(self) -> Written {
        drop(self.sender);
        self.thread.join().unwrap_or(Written {
            collection: Collection::new(),
            error: Some(FolderError::WriterEnded),
        })
    }
}

fn write_all(
    folder: &Folder,
    cast: &SceneDescription,
    jobs: &Receiver<Job>,
    mut listing: Listing,
) -> Written {
    let mut error = None;
    for job in jobs {
        let complete = listing.collection.entries().len();
        let done = match job {
            Job::Frame(snapshot) => write_frame(folder, cast, &snapshot, &mut listing),
            // The data of a checkpoint must be safe on the disk.
            Job::Checkpoint(bytes) => folder.write(CHECKPOINT, |w| {
                w.write_all(&bytes)?;
                w.flush()?;
                w.get_ref().sync_data()
            }),
        };
        error = done.err();
        if error.is_some() {
            listing.collection.truncate(complete);
            break;
        }
    }
    Written {
        collection: listing.collection,
        error,
    }
}

fn write_frame(
    folder: &Folder,
    cast: &SceneDescription,
    snapshot: &FrameState,
    listing: &mut Listing,
) -> Result<(), FolderError> {
    let files = listing.add(cast, snapshot.frame, snapshot.time, &snapshot.bones);
    let written = write_files(folder, cast, snapshot, &files);
    if written.is_err() {
        // Without half a frame a full disk has room for the index of the others.
        files.all().for_each(|file| folder.discard(file));
    }
    written
}

fn write_files(
    folder: &Folder,
    cast: &SceneDescription,
    snapshot: &FrameState,
    Files { muscles, bones }: &Files,
) -> Result<(), FolderError> {
    for ((actor, (x, v)), (file, fibres)) in cast.bodies.iter().zip(&snapshot.bodies).zip(muscles) {
        put(folder, file, &muscle_data(actor, x, v))?;
        if let Some(file) = fibres {
            put_lines(folder, file, &actor.fibres.at(x))?;
        }
    }
    for (((_, mesh), pose), file) in cast.bones.iter().zip(&snapshot.bones).zip(bones) {
        if let Some(file) = file {
            let points: Vec<Point3<f64>> = mesh.vertices.iter().map(|p| pose * p).collect();
            put(
                folder,
                file,
                &PolyData {
                    points: &points,
                    triangles: &mesh.triangles,
                    ..PolyData::default()
                },
            )?;
        }
    }
    Ok(())
}

/// Approximate sizes of the files of a frame [bytes].
pub struct FrameBytes {
    /// Of all muscles and their fibres.
    pub muscles: u64,
    /// Of each bone.
    pub bones: Vec<u64>,
}

/// The sizes of the files of a frame.
pub fn bytes(cast: &SceneDescription, snapshot: &FrameState) -> FrameBytes {
    let bodies = cast.bodies.iter().zip(&snapshot.bodies);
    let muscles = bodies.map(|(actor, (x, v))| {
        let fibres = lines_data(&actor.fibres.at(x), vtp::bytes);
        vtp::bytes(&muscle_data(actor, x, v)) + if actor.fibres.is_empty() { 0 } else { fibres }
    });
    let of_bone = |mesh: &TriangleMesh| {
        vtp::bytes(&PolyData {
            points: &mesh.vertices,
            triangles: &mesh.triangles,
            ..PolyData::default()
        })
    };
    FrameBytes {
        muscles: muscles.sum(),
        bones: cast.bones.iter().map(|(_, mesh)| of_bone(mesh)).collect(),
    }
}

fn muscle_data<'a>(
    actor: &'a BodyDescription,
    x: &'a [Point3<f64>],
    v: &[Vector3<f64>],
) -> PolyData<'a> {
    let moved = x
        .iter()
        .zip(&actor.rest.vertices)
        .flat_map(|(now, rest)| <[f64; 3]>::from(now - rest));
    PolyData {
        points: x,
        triangles: &actor.rest.triangles,
        lines: &actor.lines,
        point_data: vec![
            ("displacement_m", moved.collect()),
            ("edge_stretch", stretch(actor, x)),
            ("speed_m_s", v.iter().map(Vector3::norm).collect()),
            ("attached", actor.attached.clone()),
        ],
    }
}

fn put(folder: &Folder, file: &str, data: &PolyData<'_>) -> Result<(), FolderError> {
    let path = folder.claim(file)?;
    vtp::write(&path, data).map_err(|source| FolderError::Io { path, source })
}

fn put_lines(folder: &Folder, file: &str, lines: &[Vec<Point3<f64>>]) -> Result<(), FolderError> {
    lines_data(lines, |data| put(folder, file, data))
}

/// Passes polylines as data of a file to `with`.
fn lines_data<T>(lines: &[Vec<Point3<f64>>], with: impl FnOnce(&PolyData<'_>) -> T) -> T {
    let points: Vec<Point3<f64>> = lines.iter().flatten().copied().collect();
    let mut numbers = 0u32..;
    let lines: Vec<Vec<u32>> = lines
        .iter()
        .map(|line| numbers.by_ref().take(line.len()).collect())
        .collect();
    with(&PolyData {
        points: &points,
        lines: &lines,
        ..PolyData::default()
    })
}
