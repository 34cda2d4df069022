//! The frames of a run as files for ParaView, written by a thread during the computation of the
//! next frame.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use nalgebra::{Isometry3, Point3, Vector3};

use super::folder::{CHECKPOINT, Folder, FolderError};
use pliant::TriangleMesh;
use pliant::io::pvd::{Collection, Entry};
use pliant::io::vtp::{self, PolyData, SeriesWriter};
use pliant::simulation::{BodyDescription, FrameState, SceneDescription, strain_at_vertices};

/// Greatest number of frames in the queue of the writer; more would only use memory.
const WAITING: usize = 4;

/// The file that shows a body in a frame.
pub fn file_at(body: &BodyDescription, frame: usize) -> String {
    format!("frames/{}_{frame:04}.vtp", body.file)
}

/// Adds the bodies to a frame with bones alone, from its files in the folder `root`. They contain no
/// velocities, and no picture shows any.
///
/// # Errors
/// A file is missing or changed.
pub fn with_bodies(
    cast: &SceneDescription,
    root: &Path,
    mut state: FrameState,
) -> Result<FrameState, FolderError> {
    for body in &cast.bodies {
        let path = root.join(file_at(body, state.frame));
        if !path.is_file() {
            return Err(FolderError::Missing(path));
        }
        let count = body.rest.vertices.len();
        match pliant::io::read(&path) {
            Ok(file) if file.mesh.vertices.len() == count => {
                let still = vec![Vector3::zeros(); count];
                state.bodies.push((file.mesh.vertices, still));
            }
            _ => return Err(FolderError::Changed(path)),
        }
    }
    Ok(state)
}

/// The numbers at the points of a body that frames can have.
pub const FIELDS: [&str; 4] = ["displacement_m", "edge_stretch", "speed_m_s", "attached"];

/// Contents of the files of frames.
#[derive(Clone, Debug)]
pub struct Stored {
    /// Names of the numbers at points, some of [`FIELDS`].
    pub fields: Vec<&'static str>,
    /// True for all digits, false for files of a third of the size ([`PolyData::compact`]).
    pub exact: bool,
}

impl Default for Stored {
    fn default() -> Self {
        Self {
            fields: FIELDS.to_vec(),
            exact: false,
        }
    }
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
    /// The poses of all bones in each frame so far, with its number and its time [s].
    poses: Vec<(usize, f64, Vec<Isometry3<f64>>)>,
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
            poses: Vec::new(),
        }
    }

    /// Keeps only the frames whose files are among the first `files`.
    fn truncate(&mut self, files: usize) {
        self.collection.truncate(files);
        let last = self.collection.entries().last().map(|entry| entry.time);
        let complete = self
            .poses
            .iter()
            .take_while(|(_, time, _)| last.is_some_and(|t| *time <= t));
        let complete = complete.count();
        self.poses.truncate(complete);
    }

    /// Writes the poses of bones as a table: from the points of the mesh [m] to the scene, a rotation by a unit quaternion
    /// and then a translation, with all digits.
    ///
    /// # Errors
    /// Those of `w`.
    pub fn write_poses(&self, cast: &SceneDescription, w: &mut impl Write) -> std::io::Result<()> {
        writeln!(w, "frame,time_s,bone,x_m,y_m,z_m,qw,qx,qy,qz")?;
        for (frame, time, poses) in &self.poses {
            for ((name, _), pose) in cast.bones.iter().zip(poses) {
                let (t, q) = (pose.translation.vector, pose.rotation.coords);
                write!(w, "{frame},{time},{name}")?;
                for number in [t.x, t.y, t.z, q.w, q.x, q.y, q.z] {
                    write!(w, ",{number}")?;
                }
                writeln!(w)?;
            }
        }
        Ok(())
    }

    /// A frame so far, from its files in the folder `root`; `None` if it has none.
    ///
    /// # Errors
    /// A file is missing or changed.
    pub fn read(
        &self,
        cast: &SceneDescription,
        root: &Path,
        frame: usize,
    ) -> Result<Option<FrameState>, FolderError> {
        let found = self.poses.iter().find(|(of, _, _)| *of == frame);
        let bones = found.map(|(_, time, poses)| FrameState {
            frame,
            time: *time,
            bodies: Vec::new(),
            bones: poses.clone(),
        });
        bones
            .map(|state| with_bodies(cast, root, state))
            .transpose()
    }

    /// Adds the next frame, at `time` [s] with bones at `poses`. Returns its files.
    pub fn add(
        &mut self,
        cast: &SceneDescription,
        frame: usize,
        time: f64,
        poses: &[Isometry3<f64>],
    ) -> Files {
        self.poses.push((frame, time, poses.to_vec()));
        let Self {
            collection, bones, ..
        } = self;
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
    pub listing: Option<Listing>,
    /// The error that ended the writing.
    pub error: Option<FolderError>,
}

impl FrameWriter {
    /// Starts the thread; `listing` contains the existing frames.
    pub fn start(
        folder: Arc<Folder>,
        cast: Arc<SceneDescription>,
        listing: Listing,
        stored: Stored,
    ) -> Self {
        let (sender, receiver) = sync_channel(WAITING);
        let files = FrameFiles {
            folder,
            cast,
            stored,
            series: SeriesWriter::new(),
        };
        let thread = std::thread::spawn(move || write_all(files, &receiver, listing));
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
            listing: None,
            error: Some(FolderError::WriterEnded),
        })
    }
}

fn write_all(mut files: FrameFiles, jobs: &Receiver<Job>, mut listing: Listing) -> Written {
    let mut error = None;
    for job in jobs {
        let complete = listing.collection.entries().len();
        let done = match job {
            Job::Frame(snapshot) => files.write(&snapshot, &mut listing),
            // The data of a checkpoint must be safe on the disk.
            Job::Checkpoint(bytes) => files.folder.write(CHECKPOINT, |w| {
                w.write_all(&bytes)?;
                w.flush()?;
                w.get_ref().sync_data()
            }),
        };
        error = done.err();
        if error.is_some() {
            listing.truncate(complete);
            break;
        }
    }
    Written {
        listing: Some(listing),
        error,
    }
}

/// Writes the files of frames.
struct FrameFiles {
    folder: Arc<Folder>,
    cast: Arc<SceneDescription>,
    stored: Stored,
    series: SeriesWriter,
}

impl FrameFiles {
    fn write(&mut self, snapshot: &FrameState, listing: &mut Listing) -> Result<(), FolderError> {
        let files = listing.add(&self.cast, snapshot.frame, snapshot.time, &snapshot.bones);
        let written = self.write_files(snapshot, &files);
        if written.is_err() {
            // Without half a frame a full disk has room for the index of the others.
            files.all().for_each(|file| self.folder.discard(file));
        }
        written
    }

    fn write_files(&mut self, snapshot: &FrameState, files: &Files) -> Result<(), FolderError> {
        let cast = self.cast.clone();
        let bodies = cast.bodies.iter().zip(&snapshot.bodies).zip(&files.muscles);
        for ((actor, (x, v)), (file, fibres)) in bodies {
            let data = muscle_data(actor, x, v, &self.stored);
            self.put(file, &data)?;
            if let Some(file) = fibres {
                let compact = !self.stored.exact;
                lines_data(&actor.fibres.at(x), compact, |data| self.put(file, data))?;
            }
        }
        for (((_, mesh), pose), file) in cast.bones.iter().zip(&snapshot.bones).zip(&files.bones) {
            if let Some(file) = file {
                let points: Vec<Point3<f64>> = mesh.vertices.iter().map(|p| pose * p).collect();
                self.put(
                    file,
                    &PolyData {
                        points: &points,
                        triangles: &mesh.triangles,
                        compact: !self.stored.exact,
                        ..PolyData::default()
                    },
                )?;
            }
        }
        Ok(())
    }

    fn put(&mut self, file: &str, data: &PolyData<'_>) -> Result<(), FolderError> {
        let path = self.folder.claim(file)?;
        let written = self.series.write(&path, data);
        written.map_err(|source| FolderError::Io { path, source })
    }
}

/// Approximate sizes of the files of a frame [bytes].
pub struct FrameBytes {
    /// Of all muscles and their fibres.
    pub muscles: u64,
    /// Of each bone.
    pub bones: Vec<u64>,
}

/// Bytes of a number at a point after the compression, compact and exact, measured on the built-in scenes: at the start
/// most of these numbers are zero, and their size is not that of later frames.
const OF_NUMBER: [u64; 2] = [17, 72];

/// The sizes of the files of a frame like `snapshot`, the start. Tenths of [`OF_NUMBER`] count for numbers at points.
pub fn bytes(cast: &SceneDescription, snapshot: &FrameState, stored: &Stored) -> FrameBytes {
    let compact = !stored.exact;
    let bodies = cast.bodies.iter().zip(&snapshot.bodies);
    let muscles = bodies.map(|(actor, (x, v))| {
        let shapes = Stored {
            fields: Vec::new(),
            ..stored.clone()
        };
        let varying = stored.fields.iter().filter(|name| **name != "attached");
        let numbers: usize = varying
            .map(|name| if *name == "displacement_m" { 3 } else { 1 })
            .sum();
        let of_numbers = (numbers * x.len()) as u64 * OF_NUMBER[usize::from(stored.exact)] / 10;
        let fibres = match actor.fibres.is_empty() {
            true => 0,
            false => lines_data(&actor.fibres.at(x), compact, size),
        };
        size(&muscle_data(actor, x, v, &shapes)) + of_numbers + fibres
    });
    let of_bone = |mesh: &TriangleMesh| {
        size(&PolyData {
            points: &mesh.vertices,
            triangles: &mesh.triangles,
            compact,
            ..PolyData::default()
        })
    };
    FrameBytes {
        muscles: muscles.sum(),
        bones: cast.bones.iter().map(|(_, mesh)| of_bone(mesh)).collect(),
    }
}

/// The size of a file; zero for data that cannot be written, which the writer reports.
fn size(data: &PolyData<'_>) -> u64 {
    vtp::bytes(data).unwrap_or(0)
}

fn muscle_data<'a>(
    actor: &'a BodyDescription,
    x: &'a [Point3<f64>],
    v: &[Vector3<f64>],
    stored: &Stored,
) -> PolyData<'a> {
    let values = |name: &str| match name {
        "displacement_m" => {
            let moved = x.iter().zip(&actor.rest.vertices);
            moved
                .flat_map(|(now, rest)| <[f64; 3]>::from(now - rest))
                .collect()
        }
        "edge_stretch" => stretch(actor, x),
        "speed_m_s" => v.iter().map(Vector3::norm).collect(),
        _ => actor.attached.clone(),
    };
    PolyData {
        points: x,
        triangles: &actor.rest.triangles,
        lines: &actor.lines,
        point_data: stored
            .fields
            .iter()
            .map(|name| (*name, values(name)))
            .collect(),
        compact: !stored.exact,
    }
}

/// Passes polylines as data of a file to `with`.
fn lines_data<T>(
    lines: &[Vec<Point3<f64>>],
    compact: bool,
    with: impl FnOnce(&PolyData<'_>) -> T,
) -> T {
    let points: Vec<Point3<f64>> = lines.iter().flatten().copied().collect();
    let mut numbers = 0u32..;
    let lines: Vec<Vec<u32>> = lines
        .iter()
        .map(|line| numbers.by_ref().take(line.len()).collect())
        .collect();
    with(&PolyData {
        points: &points,
        lines: &lines,
        compact,
        ..PolyData::default()
    })
}
