//! The meshes that a scene names, read, scaled, refined.

use nalgebra::Point3;

use crate::io::{self, MeshFile, ReadError};
use crate::mesh::topology::Topology;
use crate::mesh::{TriangleMesh, refine, repair, shapes};
use crate::scene::{Area, Scene, Source};

/// A muscle as read.
#[derive(Clone, Debug)]
pub struct MuscleAsset {
    /// Its surface, refined if that was asked for; no triangles for a body of edges alone.
    pub mesh: TriangleMesh,
    /// Edges of a body without triangles.
    pub edges: Vec<[u32; 2]>,
    /// Polylines along its fibres [m].
    pub fibres: Vec<Vec<Point3<f64>>>,
    /// What reading and refining changed, in words.
    pub notes: Vec<String>,
}

/// Every mesh of a scene.
#[derive(Clone, Debug)]
pub struct Assets {
    /// Bones, in the scene's order.
    pub bones: Vec<TriangleMesh>,
    /// What reading and repairing changed in each bone, in words.
    pub bone_notes: Vec<Vec<String>>,
    /// Muscles, in the scene's order.
    pub muscles: Vec<MuscleAsset>,
    /// Attachment patches, for each muscle and each attachment; `None` where the area is no patch.
    pub patches: Vec<Vec<Option<TriangleMesh>>>,
}

/// Why a scene's meshes cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// A file cannot be read as a mesh.
    #[error("{0}")]
    Read(#[from] ReadError),
    /// A mesh has no triangles, but what it is for needs some.
    #[error("{what}: {file} holds no triangles")]
    NoTriangles {
        /// Which part of the scene.
        what: String,
        /// The file or shape.
        file: String,
    },
    /// A mesh file has no polylines.
    #[error("{what}: {file} holds no lines; fibres are read from LINES of a legacy VTK file or `l` of an OBJ file")]
    NoLines {
        /// Which part of the scene.
        what: String,
        /// The file.
        file: String,
    },
    /// The wanted edge length cannot be had.
    #[error("{what}: cannot refine to the wanted edge length: {why}")]
    Refine {
        /// Which part of the scene.
        what: String,
        /// Why.
        why: String,
    },
    /// A volume is to be kept, but the surface encloses none.
    #[error(
        "{what}: {found}; the volume effect needs a closed surface with triangles turned outward: repair the mesh, or leave [effects.volume] out"
    )]
    NotClosed {
        /// Which muscle.
        what: String,
        /// What is wrong.
        found: String,
    },
    /// An index list names a vertex that the muscle does not have.
    #[error("{what}: vertex {index} does not exist: the muscle has {count} vertices{}", if *.refined { " after refinement, which renumbers them; leave `edge_length` out or attach by nearness" } else { "" })]
    NoSuchVertex {
        /// Which part of the scene.
        what: String,
        /// The index.
        index: u32,
        /// Number of vertices.
        count: usize,
        /// Whether the mesh was refined.
        refined: bool,
    },
    /// A patch has fewer components than asked for.
    #[error("{what}: {file} has no component {wanted} (components are counted from 0, by falling area)")]
    NoSuchComponent {
        /// Which attachment.
        what: String,
        /// The patch.
        file: String,
        /// The component.
        wanted: usize,
    },
    /// An attachment found no vertex.
    #[error(
        "{what}: no vertex of the muscle is that near; the nearest is {nearest_mm:.2} mm away: check that muscle, bone and patch belong together and each `unit` is right, or raise `near` or `within`"
    )]
    NothingAttached {
        /// Which attachment.
        what: String,
        /// Distance of the nearest vertex [mm].
        nearest_mm: f64,
    },
    /// More of a muscle is held than can be.
    #[error("{what}: {held} of {count} vertices are held, more than 10 %: lower `limit` or the distances")]
    TooManyAttached {
        /// Which muscle.
        what: String,
        /// Vertices held.
        held: usize,
        /// Vertices in all.
        count: usize,
    },
}

fn name_of(source: &Source) -> String {
    match source {
        Source::File { path, .. } => path.display().to_string(),
        Source::Shape(name) => format!("shape {name}"),
    }
}

fn read_scaled(source: &Source) -> Result<MeshFile, LoadError> {
    match source {
        Source::File { path, scale } => {
            let mut file = io::read(path)?;
            file.mesh.vertices.iter_mut().for_each(|v| v.coords *= *scale);
            Ok(file)
        }
        Source::Shape(name) => {
            let mesh = shapes::make(name).map(|s| s.mesh).unwrap_or_default();
            Ok(MeshFile { mesh, ..MeshFile::default() })
        }
    }
}

fn surface(source: &Source, what: &str) -> Result<TriangleMesh, LoadError> {
    let mesh = read_scaled(source)?.mesh;
    if mesh.triangles.is_empty() {
        return Err(LoadError::NoTriangles { what: what.into(), file: name_of(source) });
    }
    Ok(mesh)
}

/// The mesh after the repair that was asked for, if any; never silently.
fn mended(mesh: TriangleMesh, options: Option<&repair::Options>, notes: &mut Vec<String>) -> TriangleMesh {
    let Some(options) = options else { return mesh };
    let repaired = repair::repair(&mesh, &[], options);
    if repaired.changes.is_empty() {
        notes.push("repair: nothing needed".to_owned());
        return mesh;
    }
    notes.extend(repaired.changes.iter().map(|change| format!("repair: {}", change.message)));
    let away = repair::deviation(&mesh, &repaired.mesh);
    let mm = |distance: Option<f64>| distance.map_or_else(|| "nothing".to_owned(), |d| format!("{:.3} mm", d * 1e3));
    notes.push(format!(
        "repair: vertices moved by at most {:.3} mm; the surface as read is at most {} from the repaired one, which is at \
         most {} from it",
        repaired.moved * 1e3,
        mm(away.lost),
        mm(away.added)
    ));
    repaired.mesh
}

impl Assets {
    /// Reads everything that `scene` names.
    ///
    /// # Errors
    /// A file that cannot be read, or that does not hold what the scene needs.
    pub fn load(scene: &Scene) -> Result<Self, LoadError> {
        let (mut bones, mut bone_notes) = (Vec::new(), Vec::new());
        for bone in &scene.bones {
            let mesh = surface(&bone.surface, &format!("bone `{}`", bone.name))?;
            let mut notes = Vec::new();
            bones.push(mended(mesh, bone.repair.as_ref(), &mut notes));
            bone_notes.push(notes);
        }
        let muscles = scene.muscles.iter().map(|m| load_muscle(m, scene)).collect::<Result<_, _>>()?;
        let patches = scene.muscles.iter().map(load_patches).collect::<Result<_, _>>()?;
        Ok(Self { bones, bone_notes, muscles, patches })
    }
}

fn load_patches(muscle: &crate::scene::Muscle) -> Result<Vec<Option<TriangleMesh>>, LoadError> {
    let patch = |area: &Area| match area {
        Area::Patch { source, component, .. } => {
            let what = format!("attachment of muscle `{}`", muscle.name);
            let whole = surface(source, &what)?;
            let part = crate::muscles::attachments::component(&whole, *component);
            let missing = || LoadError::NoSuchComponent { what, file: name_of(source), wanted: component.unwrap_or(0) };
            part.ok_or_else(missing).map(Some)
        }
        Area::Near(_) | Area::Vertices(_) => Ok(None),
    };
    muscle.attachments.iter().map(|a| patch(&a.area)).collect()
}

fn load_muscle(muscle: &crate::scene::Muscle, scene: &Scene) -> Result<MuscleAsset, LoadError> {
    let what = format!("muscle `{}`", muscle.name);
    let mut notes = Vec::new();
    let (mut mesh, edges) = match &muscle.surface {
        Source::Shape(name) => {
            let shape = shapes::make(name).unwrap_or_default();
            (shape.mesh, shape.edges)
        }
        file => {
            let read = read_scaled(file)?;
            notes.extend(read.warnings.iter().map(|warned| warned.to_string()));
            (mended(read.mesh, muscle.repair.as_ref(), &mut notes), Vec::new())
        }
    };
    if mesh.triangles.is_empty() && edges.is_empty() {
        return Err(LoadError::NoTriangles { what, file: name_of(&muscle.surface) });
    }
    if let Some(length) = muscle.edge_length {
        let refined =
            refine::refine(&mesh, length).map_err(|e| LoadError::Refine { what: what.clone(), why: e.to_string() })?;
        notes.push(format!(
            "refined from {} to {} vertices (edges {:.2} to {:.2} mm), {:.3} mm from the surface as read",
            mesh.vertices.len(),
            refined.mesh.vertices.len(),
            refined.report.min_edge * 1e3,
            refined.report.max_edge * 1e3,
            refined.report.deviation * 1e3
        ));
        mesh = refined.mesh;
    }
    if scene.effects.volume.is_some() && edges.is_empty() {
        check_closed(&mesh, &what)?;
    }
    let fibres = match &muscle.fibres {
        None => Vec::new(),
        Some(Source::Shape(name)) => shapes::make(name).map(|s| s.fibres).unwrap_or_default(),
        Some(file) => {
            let read = read_scaled(file)?;
            if read.lines.is_empty() {
                return Err(LoadError::NoLines { what: format!("fibres of {what}"), file: name_of(file) });
            }
            let place = |v: &u32| read.mesh.vertices[*v as usize];
            read.lines.iter().map(|line| line.iter().map(place).collect()).collect()
        }
    };
    Ok(MuscleAsset { mesh, edges, fibres, notes })
}

fn check_closed(mesh: &TriangleMesh, what: &str) -> Result<(), LoadError> {
    let topology = Topology::new(mesh);
    let open = topology.boundary_edges().len();
    let found = if open > 0 {
        format!("{open} edges have only one triangle")
    } else if !topology.is_closed() {
        format!("{} edges have more than two triangles", topology.non_manifold_edges().len())
    } else if !topology.is_oriented() {
        "neighbouring triangles do not agree in orientation".to_string()
    } else if mesh.volume() <= 0.0 {
        format!("the enclosed volume is {:e} m3: triangles turn inward", mesh.volume())
    } else {
        return Ok(());
    };
    Err(LoadError::NotClosed { what: what.into(), found })
}
