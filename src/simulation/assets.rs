//! The meshes of a scene: read, scaled, repaired, refined.

use std::sync::Arc;

use nalgebra::Point3;
use rayon::prelude::*;

use super::fault::{Fault, LoadError, all_of, both};
use super::ready::Ready;
use crate::format::number;
use crate::io::{self, MeshFile};
use crate::mesh::topology::Topology;
use crate::mesh::{TriangleMesh, nesting, refine, repair, shapes};
use crate::scene::{AreaSpec, Scene, Source};

/// A muscle as read from its source.
#[derive(Clone, Debug)]
pub struct MuscleAsset {
    /// Surface, refined if the scene requires it; without triangles for a body of edges alone.
    pub mesh: TriangleMesh,
    /// Edges of a body without triangles.
    pub edges: Vec<[u32; 2]>,
    /// Polylines along the fibres [m].
    pub fibres: Vec<Vec<Point3<f64>>>,
    /// Notes on the changes by reading and refining.
    pub notes: Vec<String>,
}

/// All meshes of a scene.
#[derive(Clone, Debug)]
pub struct Assets {
    /// Bones, in the scene's order.
    pub bones: Vec<TriangleMesh>,
    /// Notes on the changes of each bone by reading and repair.
    pub bone_notes: Vec<Vec<String>>,
    /// Muscles, in the scene's order.
    pub muscles: Vec<MuscleAsset>,
    /// Attachment patches of each muscle and attachment; `None` where the area is no patch.
    pub patches: Vec<Vec<Option<TriangleMesh>>>,
    /// Data derived from the meshes, shared by all copies.
    pub(super) ready: Arc<Ready>,
}

pub(super) fn name_of(source: &Source) -> String {
    match source {
        Source::File { path, .. } => path.display().to_string(),
        Source::Shape(name) => format!("shape {name}"),
        Source::Given { name, .. } => name.clone(),
    }
}

pub(super) fn read_scaled(source: &Source) -> Result<MeshFile, LoadError> {
    match source {
        Source::File { path, scale } => Ok(scaled(io::read(path).map_err(Box::new)?, *scale)),
        Source::Given { mesh, scale, .. } => Ok(scaled(of_mesh(TriangleMesh::clone(mesh)), *scale)),
        Source::Shape(name) => {
            let mesh = shapes::make(name).map(|s| s.mesh).unwrap_or_default();
            Ok(of_mesh(mesh))
        }
    }
}

fn of_mesh(mesh: TriangleMesh) -> MeshFile {
    MeshFile {
        mesh,
        ..MeshFile::default()
    }
}

fn scaled(mut file: MeshFile, scale: f64) -> MeshFile {
    let vertices = file.mesh.vertices.iter_mut();
    vertices.for_each(|v| v.coords *= scale);
    file
}

/// A mesh that must have triangles. `key` is the section of the mesh, `from` the key of its file.
fn surface(
    scene: &Scene,
    source: &Source,
    key: &str,
    from: &str,
    part: String,
) -> Result<TriangleMesh, LoadError> {
    let mesh = read_scaled(source)?.mesh;
    if mesh.triangles.is_empty() {
        let fault = Fault::NoTriangles {
            file: name_of(source),
        };
        return Err(LoadError::new(
            scene,
            &named_at(source, key, from),
            part,
            fault,
        ));
    }
    Ok(mesh)
}

/// The mesh after the repair of the scene, if any, with notes on every change.
pub(super) fn mended(
    mesh: TriangleMesh,
    options: Option<&repair::RepairOptions>,
    notes: &mut Vec<String>,
) -> TriangleMesh {
    let Some(options) = options else { return mesh };
    let repaired = repair::repair(&mesh, &[], options);
    if repaired.changes.is_empty() {
        notes.push("repair: nothing needed".to_owned());
        return mesh;
    }
    notes.extend(
        repaired
            .changes
            .iter()
            .map(|change| format!("repair: {}", change.message)),
    );
    let away = repair::deviation(&mesh, &repaired.mesh);
    let mm = |distance: Option<f64>| {
        distance.map_or_else(|| "nothing".to_owned(), |d| format!("{:.3} mm", d * 1e3))
    };
    notes.push(format!(
        "repair: vertices moved by at most {:.3} mm; the surface as read is at most {} from the repaired one, which is at \
         most {} from it",
        repaired.moved * 1e3,
        mm(away.lost),
        mm(away.added)
    ));
    repaired.mesh
}

/// The key of a mesh.
pub(super) fn named_at(source: &Source, key: &str, from: &str) -> String {
    match source {
        Source::File { .. } | Source::Given { .. } => format!("{key}.{from}"),
        Source::Shape(_) => format!("{key}.shape"),
    }
}

impl Assets {
    /// Reads all meshes of `scene`.
    ///
    /// # Errors
    /// Every file that cannot be read, or that lacks something the scene needs.
    pub fn load(scene: &Scene) -> Result<Self, LoadError> {
        let bones = || {
            (0..scene.bones.len())
                .into_par_iter()
                .map(|b| load_bone(scene, b))
                .collect::<Vec<_>>()
        };
        let muscles = || {
            (0..scene.muscles.len())
                .into_par_iter()
                .map(|m| load_muscle(scene, m))
                .collect::<Vec<_>>()
        };
        let (muscles, bones) = rayon::join(muscles, bones);
        let patches = all_of((0..scene.muscles.len()).map(|m| load_patches(scene, m)));
        // In the order of the scene, independent of timing.
        let meshes = both(all_of(bones), all_of(muscles));
        let ((bones, muscles), patches) = both(meshes, patches)?;
        let (bones, bone_notes): (Vec<_>, Vec<_>) = bones.into_iter().unzip();
        let surfaces = bones.len() + patches.iter().flatten().flatten().count();
        let ready = Arc::new(Ready::new(muscles.len(), scene.capsules.len(), surfaces));
        Ok(Self {
            bones,
            bone_notes,
            muscles,
            patches,
            ready,
        })
    }

    /// The same meshes without derived data.
    #[must_use]
    pub fn unprepared(&self) -> Self {
        Self {
            ready: Arc::new(self.ready.emptied()),
            ..self.clone()
        }
    }

    /// Checks that these meshes are suitable for `scene`, which has the same meshes and possibly
    /// other effects than the scene for which they were read.
    ///
    /// # Errors
    /// A volume constraint on a surface that encloses no volume.
    pub fn suit(&self, scene: &Scene) -> Result<(), LoadError> {
        for (m, (muscle, asset)) in scene.muscles.iter().zip(&self.muscles).enumerate() {
            if scene.effects.volume.is_some() && asset.edges.is_empty() {
                let key = named_at(&muscle.surface, &format!("muscle.{m}"), "mesh");
                let unfit =
                    |fault| LoadError::new(scene, &key, format!("muscle `{}`", muscle.name), fault);
                check_closed(&asset.mesh, &self.ready.rest(&asset.mesh).topology())
                    .map_err(unfit)?;
            }
        }
        Ok(())
    }
}

/// How far a remeshed bone may be from the surface as read, relative to its longest side: muscles would slide on
/// another bone, and no check of a run compares the two.
const BONE_DEVIATION: f64 = 0.01;

fn load_bone(scene: &Scene, b: usize) -> Result<(TriangleMesh, Vec<String>), LoadError> {
    let bone = &scene.bones[b];
    let mesh = surface(
        scene,
        &bone.surface,
        &format!("bone.{b}"),
        "mesh",
        format!("bone `{}`", bone.name),
    )?;
    let mut notes = Vec::new();
    let mesh = mended(mesh, bone.repair.as_ref(), &mut notes);
    let unfit = |fault| {
        let key = format!("bone.{b}.edge_length");
        LoadError::new(scene, &key, format!("bone `{}`", bone.name), fault)
    };
    let most = BONE_DEVIATION * mesh.bounding_box().extents().max();
    let mesh = remeshed(mesh, bone.edge_length, most, &mut notes).map_err(unfit)?;
    Ok((mesh, notes))
}

/// The mesh after the remeshing of the scene, if any, with a note on it. It is at most `most` [m] from the
/// surface as read.
fn remeshed(
    mesh: TriangleMesh,
    edge_length: Option<f64>,
    most: f64,
    notes: &mut Vec<String>,
) -> Result<TriangleMesh, Fault> {
    let Some(length) = edge_length else {
        return Ok(mesh);
    };
    let refined =
        refine::refine(&mesh, length).map_err(|e| Fault::Refine { why: e.to_string() })?;
    let deviation = refined.report.deviation;
    if !(deviation <= most) {
        let [deviation_mm, most_mm] = [deviation, most].map(|length| number(length * 1e3));
        return Err(Fault::TooCoarse {
            deviation_mm,
            most_mm,
        });
    }
    notes.push(format!(
        "remeshed from {} to {} vertices (edges {:.2} to {:.2} mm), {:.3} mm from the surface as read",
        mesh.vertices.len(),
        refined.mesh.vertices.len(),
        refined.report.min_edge * 1e3,
        refined.report.max_edge * 1e3,
        deviation * 1e3
    ));
    Ok(refined.mesh)
}

fn load_patches(scene: &Scene, m: usize) -> Result<Vec<Option<TriangleMesh>>, LoadError> {
    let areas = scene.muscles[m].attachments.iter().map(|a| &a.area);
    all_of(
        areas
            .enumerate()
            .map(|(a, area)| load_patch(scene, m, a, area)),
    )
}

/// The patch of area `a` of muscle `m`; `None` for an area without a patch.
fn load_patch(
    scene: &Scene,
    m: usize,
    a: usize,
    area: &AreaSpec,
) -> Result<Option<TriangleMesh>, LoadError> {
    let (source, component) = match area {
        AreaSpec::Patch {
            source, component, ..
        } => (source, *component),
        AreaSpec::Near(_) | AreaSpec::Vertices(_) => return Ok(None),
    };
    let part = format!("attachment of muscle `{}`", scene.muscles[m].name);
    let key = format!("muscle.{m}.attachment.{a}");
    let whole = surface(scene, source, &key, "patch", part.clone())?;
    if let Some(patch) = super::attachments::component(&whole, component) {
        return Ok(Some(patch));
    }
    let fault = Fault::NoSuchComponent {
        file: name_of(source),
        index: component.unwrap_or(0),
    };
    Err(LoadError::new(scene, &format!("{key}.patch"), part, fault))
}

fn load_muscle(scene: &Scene, m: usize) -> Result<MuscleAsset, LoadError> {
    let muscle = &scene.muscles[m];
    let (key, part) = (format!("muscle.{m}"), format!("muscle `{}`", muscle.name));
    let unfit = |key: &str, fault| LoadError::new(scene, key, part.clone(), fault);
    let mesh_key = named_at(&muscle.surface, &key, "mesh");
    let mut notes = Vec::new();
    let mut own_fibres = None;
    let (mut mesh, edges) = match &muscle.surface {
        Source::Shape(name) => {
            let shape = shapes::make(name).unwrap_or_default();
            own_fibres = Some(shape.fibres);
            (shape.mesh, shape.edges)
        }
        file => {
            let read = read_scaled(file)?;
            notes.extend(read.warnings.iter().map(|warned| warned.to_string()));
            (
                mended(read.mesh, muscle.repair.as_ref(), &mut notes),
                Vec::new(),
            )
        }
    };
    if mesh.triangles.is_empty() && edges.is_empty() {
        return Err(unfit(
            &mesh_key,
            Fault::NoTriangles {
                file: name_of(&muscle.surface),
            },
        ));
    }
    // The checks of a run compare its volume with that of the file.
    mesh = remeshed(mesh, muscle.edge_length, f64::INFINITY, &mut notes)
        .map_err(|fault| unfit(&format!("{key}.edge_length"), fault))?;
    if scene.effects.volume.is_some() && edges.is_empty() {
        check_closed(&mesh, &Topology::new(&mesh)).map_err(|fault| unfit(&mesh_key, fault))?;
    }
    let fibres = match &muscle.fibres {
        None => Vec::new(),
        Some(source @ Source::Shape(name)) => match own_fibres {
            Some(fibres) if *source == muscle.surface => fibres,
            _ => shapes::make(name).map(|s| s.fibres).unwrap_or_default(),
        },
        Some(file) => {
            let read = read_scaled(file)?;
            if read.lines.is_empty() {
                let fault = Fault::NoLines {
                    file: name_of(file),
                };
                return Err(LoadError::new(
                    scene,
                    &format!("{key}.fibres.lines"),
                    format!("fibres of {part}"),
                    fault,
                ));
            }
            let place = |v: &u32| read.mesh.vertices[*v as usize];
            read.lines
                .iter()
                .map(|line| line.iter().map(place).collect())
                .collect()
        }
    };
    Ok(MuscleAsset {
        mesh,
        edges,
        fibres,
        notes,
    })
}

/// Checks that a surface encloses a volume.
fn check_closed(mesh: &TriangleMesh, topology: &Topology) -> Result<(), Fault> {
    if let edges @ [first, ..] = topology.boundary_edges().as_slice() {
        return Err(Fault::OpenBoundary {
            count: edges.len(),
            edge: topology.edges[*first as usize],
        });
    }
    if let edges @ [first, ..] = topology.non_manifold_edges().as_slice() {
        return Err(Fault::NonManifoldEdge {
            count: edges.len(),
            edge: topology.edges[*first as usize],
        });
    }
    if let edges @ [first, ..] = topology.inconsistent_edges().as_slice() {
        let triangles = topology.triangles_of_edge(*first as usize);
        return Err(Fault::InconsistentOrientation {
            count: edges.len(),
            triangles: [triangles[0], triangles[1]],
        });
    }
    // Each piece on its own: volumes of two of them can cancel.
    let inward = nesting::inward(&mesh.vertices, &mesh.triangles, topology);
    if let Some(piece) = inward.first() {
        let volume = piece.volume;
        return Err(Fault::InsideOut { volume });
    }
    match mesh.volume() {
        volume if volume > 0.0 => Ok(()),
        // Also NaN: coordinates whose cubes overflow.
        volume => Err(Fault::InsideOut { volume }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin::load;

    #[test]
    fn a_bone_is_remeshed_as_a_muscle_is() {
        let read = |edge: &str| {
            let change = format!("bone.0.edge_length={edge}");
            let scene = load("hip", &[change]).expect("a scene");
            Assets::load(&scene)
        };
        let whole = read("off").expect("shapes");
        let fine = read("'2 mm'").expect("remeshed");
        let count = fine.bones[0].vertices.len();
        assert!(count > whole.bones[0].vertices.len(), "{count}");
        let note = format!("to {count} vertices");
        assert!(
            fine.bone_notes[0][0].contains(&note),
            "{:?}",
            fine.bone_notes
        );
        // Controls: another bone stays, and a length for which there is no memory is refused by its key.
        assert_eq!(fine.bones[1], whole.bones[1]);
        let error = read("'1 um'").expect_err("too many triangles").terse();
        assert!(error.contains("bone.0.edge_length"), "{error}");
        // Edges as long as the bone leave little of it.
        let error = read("'50 mm'").expect_err("another shape").terse();
        assert!(
            error.contains("bone.0.edge_length") && error.contains("from the surface as read"),
            "{error}"
        );
    }
}
