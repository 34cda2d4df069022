//! The frames of a run as files for ParaView, written by a thread during the computation of the
//! next frame.

use std::collections::HashSet;
use std::io::Write;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use nalgebra::{Isometry3, Point3, Vector3};

use super::folder::{CHECKPOINT, Folder, FolderError};
use pliant::constraints::distance::Distance;
use pliant::fibres::binding::BoundLines;
use pliant::io::names::file_name;
use pliant::io::pvd::{Collection, Entry};
use pliant::io::vtp::{self, PolyData};
use pliant::mesh::TriangleMesh;
use pliant::simulation::Simulation;
use pliant::simulation::measures::strain_at_vertices;

/// Greatest number of frames in the queue of the writer; more would only use memory.
const WAITING: usize = 4;

/// Constant data of a run for the writers of frames and pictures.
#[derive(Debug)]
pub struct Cast {
    /// Muscles, in the scene's order.
    pub muscles: Vec<Actor>,
    /// File names of the bones, and their meshes in their own frame.
    pub bones: Vec<(String, TriangleMesh)>,
}

/// A muscle of the cast.
#[derive(Debug)]
pub struct Actor {
    /// Name of its files.
    pub file: String,
    /// Name of the files of its fibres.
    pub fibre_file: String,
    /// Name in the scene.
    pub name: String,
    /// Surface at rest.
    pub rest: TriangleMesh,
    /// Edges with rest lengths.
    pub edges: Vec<Distance>,
    /// Edges without a triangle, drawn as lines.
    pub lines: Vec<Vec<u32>>,
    /// Fibres bound to the muscle.
    pub fibres: BoundLines,
    /// 1 for an attached vertex, otherwise 0.
    pub attached: Vec<f64>,
}

/// Positions [m] and velocities [m/s] of a muscle's vertices.
pub type State = (Vec<Point3<f64>>, Vec<Vector3<f64>>);

/// State of one frame.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Frame.
    pub frame: usize,
    /// Time since the start [s].
    pub time: f64,
    /// Positions [m] and velocities [m/s] of each muscle.
    pub muscles: Vec<State>,
    /// Pose of each bone.
    pub bones: Vec<Isometry3<f64>>,
}

impl Snapshot {
    /// The last frame of a simulation.
    pub fn of(simulation: &Simulation) -> Self {
        let frame = simulation.frame();
        let state = |p: &pliant::particles::Particles| (p.position.clone(), p.velocity.clone());
        Self {
            frame,
            time: frame as f64 / simulation.scene.frame_rate,
            muscles: simulation
                .bodies
                .iter()
                .map(|b| state(&b.system.particles))
                .collect(),
            bones: (0..simulation.bones.len())
                .map(|b| simulation.pose(b, frame as f64))
                .collect(),
        }
    }
}

/// A file name different from all earlier ones, independent of case.
pub(super) fn unused(name: &str, used: &mut HashSet<String>) -> String {
    let name = file_name(name);
    let mut chosen = name.clone();
    let mut next = 2;
    while !used.insert(chosen.to_lowercase()) {
        chosen = format!("{name}-{next}");
        next += 1;
    }
    chosen
}

impl Cast {
    /// The cast of a simulation.
    pub fn of(simulation: &Simulation) -> Self {
        let mut used = HashSet::new();
        let mut actors = Vec::new();
        for body in &simulation.bodies {
            let mut attached = vec![0.0; body.rest.vertices.len()];
            body.attached
                .iter()
                .for_each(|&(v, _)| attached[v as usize] = 1.0);
            let bare = body.rest.triangles.is_empty();
            actors.push(Actor {
                file: unused(&body.name, &mut used),
                fibre_file: unused(&format!("{}_fibres", body.name), &mut used),
                name: body.name.clone(),
                rest: body.rest.clone(),
                edges: body.edges.clone(),
                lines: if bare {
                    body.edges.iter().map(|e| e.points.to_vec()).collect()
                } else {
                    Vec::new()
                },
                fibres: body.fibres.clone(),
                attached,
            });
        }
        let bones = simulation.scene.bones.iter().zip(&simulation.bones);
        let bones = bones
            .map(|(b, mesh)| (unused(&format!("bone_{}", b.name), &mut used), mesh.clone()))
            .collect();
        Self {
            muscles: actors,
            bones,
        }
    }
}

impl Actor {
    /// The file of the muscle in a frame.
    pub fn file_at(&self, frame: usize) -> String {
        format!("frames/{}_{frame:04}.vtp", self.file)
    }

    /// Mean absolute strain of the edges at each vertex, for positions `x`.
    pub fn stretch(&self, x: &[Point3<f64>]) -> Vec<f64> {
        strain_at_vertices(&self.edges, x)
    }
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
    pub fn new(cast: &Cast) -> Self {
        Self {
            collection: Collection::new(),
            bones: vec![None; cast.bones.len()],
        }
    }

    /// Adds the next frame, at `time` [s] with bones at `poses`. Returns its files.
    pub fn add(&mut self, cast: &Cast, frame: usize, time: f64, poses: &[Isometry3<f64>]) -> Files {
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
        for actor in &cast.muscles {
            let file = actor.file_at(frame);
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
    Frame(Arc<Snapshot>),
    /// A checkpoint, written after all earlier frames.
    Checkpoint(Vec<u8>),
}

/// Writes frames, and checkpoints between them, in its own thread.
pub struct FrameWriter {
    sender: SyncSender<Job>,
    thread: JoinHandle<Result<Collection, FolderError>>,
}

impl FrameWriter {
    /// Starts the thread; `listing` contains the existing frames.
    pub fn start(folder: Arc<Folder>, cast: Arc<Cast>, listing: Listing) -> Self {
        let (sender, receiver) = sync_channel(WAITING);
        let thread = std::thread::spawn(move || write_all(&folder, &cast, &receiver, listing));
        Self { sender, thread }
    }

    /// Passes a frame to the writer; waits if the queue is full. Returns false after an error of
    /// the writer: the caller should then end the run and call [`Self::finish`] for the error.
    pub fn push(&self, snapshot: Arc<Snapshot>) -> bool {
        self.sender.send(Job::Frame(snapshot)).is_ok()
    }

    /// Passes a checkpoint to the writer, for writing after all earlier frames; otherwise as
    /// [`Self::push`].
    pub fn push_checkpoint(&self, bytes: Vec<u8>) -> bool {
        self.sender.send(Job::Checkpoint(bytes)).is_ok()
    }

    /// Waits for the last frame. Returns the list of files.
    ///
    /// # Errors
    /// The error of the writer.
    pub fn finish(self) -> Result<Collection, FolderError> {
        drop(self.sender);
        self.thread.join().unwrap_or(Err(FolderError::WriterEnded))
    }
}

fn write_all(
    folder: &Folder,
    cast: &Cast,
    jobs: &Receiver<Job>,
    mut listing: Listing,
) -> Result<Collection, FolderError> {
    for job in jobs {
        match job {
            Job::Frame(snapshot) => write_frame(folder, cast, &snapshot, &mut listing)?,
            // The data of a checkpoint must be safe on the disk.
            Job::Checkpoint(bytes) => folder.write(CHECKPOINT, |w| {
                w.write_all(&bytes)?;
                w.flush()?;
                w.get_ref().sync_data()
            })?,
        }
    }
    Ok(listing.collection)
}

fn write_frame(
    folder: &Folder,
    cast: &Cast,
    snapshot: &Snapshot,
    listing: &mut Listing,
) -> Result<(), FolderError> {
    let Files { muscles, bones } =
        listing.add(cast, snapshot.frame, snapshot.time, &snapshot.bones);
    for ((actor, (x, v)), (file, fibres)) in
        cast.muscles.iter().zip(&snapshot.muscles).zip(&muscles)
    {
        put(folder, file, &muscle_data(actor, x, v))?;
        if let Some(file) = fibres {
            put_lines(folder, file, &actor.fibres.at(x))?;
        }
    }
    for (((_, mesh), pose), file) in cast.bones.iter().zip(&snapshot.bones).zip(&bones) {
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

fn muscle_data<'a>(actor: &'a Actor, x: &'a [Point3<f64>], v: &[Vector3<f64>]) -> PolyData<'a> {
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
            ("edge_stretch", actor.stretch(x)),
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
    let points: Vec<Point3<f64>> = lines.iter().flatten().copied().collect();
    let mut numbers = 0u32..;
    let lines: Vec<Vec<u32>> = lines
        .iter()
        .map(|line| numbers.by_ref().take(line.len()).collect())
        .collect();
    put(
        folder,
        file,
        &PolyData {
            points: &points,
            lines: &lines,
            ..PolyData::default()
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_safe_and_unlike() {
        let mut used = HashSet::new();
        assert_eq!(unused("gluteus maximus", &mut used), "gluteus_maximus");
        assert_eq!(unused("Gluteus_maximus", &mut used), "Gluteus_maximus-2");
        assert_eq!(unused("a&b#c%", &mut used), "a_b_c_");
    }
}
