//! `pliant morph`: interpolation between two closed surfaces.

mod mending;
mod pairs;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::failure::Failure;
use super::options::Output;
use super::progress::if_raised;
use super::run::stop_on_interrupt;
use super::{interrupted, length_unit, warn};
use crate::report::folder::{Folder, FolderError};
use crate::report::morph::volume::VolumeMorph;
use crate::report::morph::{Carried, Morph, Shape};
use mending::{Mended, mended, nearest_vertices};
use pliant::io::{self, PointData};
use pliant::mesh::TriangleMesh;
use pliant::morph::blend::{self, BlendError, Laplacian};
use pliant::morph::{AlignError, by_volume};
use pliant::morph::{
    Correspondence, CorrespondenceError, CorrespondenceMethod, CorrespondenceSettings, Shared,
};
use pliant::morph::{Relaxation, SphereError};
use pliant::simulation::LoadError;

/// Number of cells along the longest side of two bodies.
const CELLS: u16 = 64;

/// Blend two closed surfaces: their correspondence, intermediate shapes and intermediate point data
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant morph neutral.obj smile.obj
  pliant morph left.vtp right.vtp --unit mm --pairs pairs.txt --blend laplacian --frames 48
  pliant morph a.obj b.obj --topology first --method relaxation --json > summary.json
  pliant morph hip_bone.obj sacrum.obj --unit m --method volume --cells 96

Both surfaces must be closed, in one piece and without handles. One that is not is mended first: coincident vertices are merged, holes
closed, small pieces left out, handles cut. The result says so, and ends at the mended surface. Each is
spread over a sphere without folds, the first is turned and deformed until like parts lie over each other, and with `--topology merged`
the surface in between has the vertices and edges of both, so that both ends are reproduced exactly; with `first` it has those of A.

--method volume blends the signed distances of both bodies in place of their surfaces, in a frame that moves and stretches from A to
B: for bodies with handles and pieces, which appear and vanish on the way. It has no pairs, blends, topologies and numbers at vertices;
frames are surfaces of their own, and measures.csv has pieces and handles.

PAIRS is a text file with a line `VERTEX_OF_A VERTEX_OF_B` for each pair that must meet, vertices counted from 0 as in the files,
or six coordinates `X Y Z X Y Z` in the unit of the files, each of which means the nearest vertex; # begins a comment.

Numbers at the vertices are read from .vtp files. Arrays of one name in both are blended, others carried along; frames also
hold `origin` (0: a vertex of A, 1: of B, 2: a crossing of edges) and `displacement` (how far the vertex moves).

Results in pliant-out/A-B-morph: frames/*.vtp, A-B.pvd, A-B.gif, sheet.png, spheres.png, measures.csv (volume and area over t),
summary.json, report.html.

Exit codes: 0 done; 1 an end is not reproduced, or files could not be written;
2 bad usage or input; 130 or 143 interrupted, with nothing
written.")]
pub(super) struct Arguments {
    /// The surface at t = 0
    a: PathBuf,
    /// The surface at t = 1
    b: PathBuf,
    /// Length unit of both files, such as mm; results are then in metres [default: results in the
    /// unit of the files]
    #[arg(long, value_name = "UNIT")]
    unit: Option<String>,
    /// File of pairs of vertices that must coincide
    #[arg(long, value_name = "FILE")]
    pairs: Option<PathBuf>,
    /// Method: maps to the sphere, or distance fields (volume)
    #[arg(long, value_name = "NAME", default_value = "robust", value_parser = ["robust", "relaxation", "volume"])]
    method: String,
    /// Number of cells along the longest side, for --method volume [default: 64]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(8..=256))]
    cells: Option<u16>,
    /// Method of the blend
    #[arg(long, value_name = "NAME", default_value = "linear", value_parser = ["linear", "hermite", "laplacian"])]
    blend: String,
    /// Number of shapes, including both ends
    #[arg(long, value_name = "N", default_value = "25", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    frames: u32,
    /// Vertices and triangles of intermediate shapes: of both surfaces, or of A
    #[arg(long, value_name = "WHICH", default_value = "merged", value_parser = ["merged", "first"])]
    topology: String,
    #[command(flatten)]
    output: Output,
}

/// A surface from the command line, in the unit of the results.
pub(super) struct Given {
    pub(super) mesh: TriangleMesh,
    pub(super) data: Vec<PointData>,
}

/// Reads a surface with the numbers at its vertices.
pub(super) fn read(path: &Path, scale: f64) -> Result<Given, Failure> {
    let failed = |e| Failure::of_meshes(LoadError::from(Box::new(e)));
    let mut mesh = io::read(path).map_err(failed)?.mesh;
    if mesh.triangles.is_empty() {
        return Err(Failure::usage(
            format!("{}: no triangles", path.display()),
            "give a surface",
        ));
    }
    mesh.vertices.iter_mut().for_each(|v| v.coords *= scale);
    if let Some(vertex) = mesh
        .vertices
        .iter()
        .position(|v| !v.coords.iter().all(|c| c.is_finite()))
    {
        let message = format!(
            "{}: vertex {vertex} is too far away for a double in metres",
            path.display()
        );
        return Err(Failure::usage(message, "choose another --unit"));
    }
    Ok(Given {
        mesh,
        data: io::read_point_data(path).map_err(failed)?,
    })
}

/// The common name of two files.
pub(super) fn name_of(paths: [&Path; 2]) -> String {
    let stem = |p: &Path| {
        p.file_stem()
            .map_or("surface".into(), |s| s.to_string_lossy().into_owned())
    };
    format!("{}-{}", stem(paths[0]), stem(paths[1]))
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let stop = stop_on_interrupt("stopping; nothing will be written");
    let scale = arguments.unit.as_deref().map_or(Ok(1.0), length_unit)?;
    let paths = [arguments.a.as_path(), &arguments.b];
    let name = name_of(paths);
    let out = arguments.output.folder(&name, "morph");
    arguments.output.threads.start();
    let files = match arguments.method.as_str() {
        "volume" => VolumeMorph::files(&name),
        _ => Morph::files(&name),
    };
    Folder::check(&out, &files)?;
    of_method(arguments)?;
    let given = [read(paths[0], scale)?, read(paths[1], scale)?];
    let as_read = given.each_ref().map(|one| one.mesh.clone());
    let mut pairs = arguments.pairs.as_ref().map_or(Ok(Vec::new()), |file| {
        pairs::read(file, as_read.each_ref(), paths, scale)
    })?;
    let by_volume = arguments.method == "volume";
    let Mended {
        surfaces: [a, b],
        notes,
        handles_cut,
    } = mended(given, paths, by_volume);
    if by_volume {
        let volume = VolumeMorph {
            files: paths.map(|p| p.display().to_string()),
            meshes: [&a.mesh, &b.mesh],
            shapes: Vec::new(),
            cells: usize::from(arguments.cells.unwrap_or(CELLS)),
            notes,
            unit: arguments.unit.as_ref().map(|_| "m"),
            time_s: 0.0,
            name,
        };
        return run_by_volume(arguments, volume, paths, &out, begun, &stop);
    }
    let meshes = [&a.mesh, &b.mesh];
    for side in [0, 1] {
        if meshes[side].vertices != as_read[side].vertices {
            let nearest = nearest_vertices(&as_read[side], meshes[side]);
            pairs
                .iter_mut()
                .for_each(|pair| pair[side] = nearest[pair[side] as usize]);
        }
    }
    let read_s = begun.elapsed().as_secs_f64();
    let settings = settings(arguments);
    let progress = |_: &str, _: usize, _: usize| if_raised(&stop);
    let between = match Correspondence::new(meshes, &pairs, &settings, &progress) {
        Err(CorrespondenceError::Stopped) => return Ok(nothing_written()),
        other => other.map_err(|error| refused(&error, paths, meshes, arguments))?,
    };
    let blending = Instant::now();
    let Some(shapes) = shapes(arguments, &between, &stop)
        .map_err(|e| Failure::usage(e.to_string(), "take --blend linear"))?
    else {
        return Ok(nothing_written());
    };
    let data = Carried::of(&between, [&a.data, &b.data]).map_err(|array| {
        let message = format!(
            "the array `{array}` has another number of components in {}",
            paths[1].display()
        );
        Failure::usage(message, "rename one of the two, or leave it out")
    })?;
    let word = |text: &str, known: &[&'static str]| {
        known
            .iter()
            .copied()
            .find(|k| *k == text)
            .unwrap_or_default()
    };
    let morph = Morph {
        files: paths.map(|p| p.display().to_string()),
        meshes,
        between: &between,
        pairs: &pairs,
        shapes,
        data,
        words: [
            word(&arguments.method, &["robust", "relaxation"]),
            word(&arguments.blend, &["linear", "hermite", "laplacian"]),
            word(&arguments.topology, &["merged", "first"]),
        ],
        notes,
        handles_cut,
        unit: arguments.unit.as_ref().map(|_| "m"),
        seconds: [read_s, blending.elapsed().as_secs_f64()],
        time_s: begun.elapsed().as_secs_f64(),
        name,
    };
    let output = morph.output().map_err(FolderError::from)?;
    arguments.output.finish(&Folder::open(&out)?, output)
}

/// Refuses options of another method.
fn of_method(arguments: &Arguments) -> Result<(), Failure> {
    let (is_volume, cells) = (arguments.method == "volume", arguments.cells.is_some());
    if is_volume && arguments.pairs.is_some() {
        return Err(Failure::usage(
            "--pairs is given, but distance fields know no pairs",
            "leave it out, or take --method robust",
        ));
    }
    let defaults = arguments.blend == "linear" && arguments.topology == "merged";
    if is_volume && !defaults {
        return Err(Failure::usage(
            "--blend or --topology is given, but distance fields have neither",
            "leave them out, or take --method robust",
        ));
    }
    if cells && !is_volume {
        return Err(Failure::usage(
            "--cells is given, but only --method volume has cells",
            "add --method volume",
        ));
    }
    Ok(())
}

/// Shapes by distance fields.
fn run_by_volume(
    arguments: &Arguments,
    mut volume: VolumeMorph<'_>,
    paths: [&Path; 2],
    out: &Path,
    begun: Instant,
    stop: &AtomicBool,
) -> Result<u8, Failure> {
    let meshes = volume.meshes;
    let heard = |_: &str, _: usize, _: usize| if_raised(stop);
    let shape = by_volume(meshes, volume.cells, &heard)
        .map_err(|error| refused(&error, paths, meshes, arguments))?;
    for k in 0..arguments.frames {
        let t = f64::from(k) / f64::from(arguments.frames - 1);
        volume.shapes.push((t, shape(t)));
        if stop.load(Ordering::Relaxed) {
            return Ok(nothing_written());
        }
    }
    volume.time_s = begun.elapsed().as_secs_f64();
    let output = volume.output().map_err(FolderError::from)?;
    arguments.output.finish(&Folder::open(out)?, output)
}

fn settings(arguments: &Arguments) -> CorrespondenceSettings {
    CorrespondenceSettings {
        method: if arguments.method == "robust" {
            CorrespondenceMethod::Robust
        } else {
            CorrespondenceMethod::Relaxation(Relaxation::default())
        },
        shared: if arguments.topology == "merged" {
            Shared::Merged
        } else {
            Shared::First
        },
        ..CorrespondenceSettings::default()
    }
}

pub(super) fn nothing_written() -> u8 {
    warn("interrupted: nothing is written");
    interrupted()
}

/// All shapes; `None` after Ctrl-C.
fn shapes(
    arguments: &Arguments,
    between: &Correspondence,
    stop: &AtomicBool,
) -> Result<Option<Vec<Shape>>, BlendError> {
    let ends = [between.places[0].as_slice(), &between.places[1]];
    let mut path = match arguments.blend.as_str() {
        "hermite" => blend::Path::Hermite(Box::new(blend::turning(ends)?)),
        "laplacian" => blend::Path::Laplacian(Box::new(Laplacian::new(
            ends[0],
            ends[1],
            &between.triangles,
        )?)),
        _ => blend::Path::Linear,
    };
    let mut all = Vec::new();
    for k in 0..arguments.frames {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let t = f64::from(k) / f64::from(arguments.frames - 1);
        all.push(Shape {
            t,
            places: path.at(ends, t)?,
        });
    }
    Ok(Some(all))
}

/// A rejection, with its file and advice.
fn refused(
    error: &CorrespondenceError,
    paths: [&Path; 2],
    meshes: [&TriangleMesh; 2],
    arguments: &Arguments,
) -> Failure {
    match error {
        CorrespondenceError::Surface { side, error } => {
            let path = paths[*side].display();
            Failure::usage(
                format!("{path}: {error}{}", place(error, meshes[*side])),
                mend(error, paths[*side]),
            )
        }
        CorrespondenceError::InsideOut { side, .. } => {
            let path = paths[*side].display();
            Failure::usage(
                format!("{path}: {error}"),
                format!("`pliant check {path} --repair DIR` turns them"),
            )
        }
        CorrespondenceError::Align(AlignError::Stuck { feature, left, .. }) => {
            let file = arguments
                .pairs
                .as_ref()
                .map(|p| p.display().to_string())
                .unwrap_or_default();
            let message = format!(
                "{file}: pair {} cannot be brought together without folding the map: {:.1} degrees are left",
                feature + 1,
                left.to_degrees()
            );
            Failure::usage(
                message,
                "leave it out, or choose pairs that lie alike on both surfaces",
            )
        }
        CorrespondenceError::Align(error) => {
            Failure::usage(error.to_string(), "change the file of --pairs")
        }
        CorrespondenceError::Turn(_) => Failure::usage(
            error.to_string(),
            "turn one of the surfaces a little, or coarsen it",
        ),
        CorrespondenceError::Overlay(_) => {
            Failure::usage(error.to_string(), "take --topology first")
        }
        CorrespondenceError::Stopped => Failure::usage(error.to_string(), "run it again"),
    }
}

/// Position of the first vertex of an error.
fn place(error: &SphereError, mesh: &TriangleMesh) -> String {
    let vertex = match error {
        SphereError::Open { first, .. } => first[0],
        SphereError::Edge { edge, .. } | SphereError::Turned { edge, .. } => edge[0],
        SphereError::Vertex { vertex }
        | SphereError::Unused { vertex, .. }
        | SphereError::Pieces { vertex, .. }
        | SphereError::Crowded { vertex, .. } => *vertex,
        _ => return String::new(),
    };
    mesh.vertices
        .get(vertex as usize)
        .map_or(String::new(), |p| {
            let [x, y, z] = [p.x, p.y, p.z].map(pliant::format::number);
            format!(" (vertex {vertex} is at {x}, {y}, {z})")
        })
}

/// Advice for a surface that is no topological sphere.
fn mend(error: &SphereError, path: &Path) -> String {
    let check = format!("`pliant check {} --repair DIR", path.display());
    match error {
        SphereError::Open { .. } => format!("{check} --close-holes` closes small holes"),
        SphereError::Pieces { .. } => format!("{check} --keep-largest` keeps the largest"),
        SphereError::Genus { .. } => {
            "cut its handles and close the holes; `pliant check` tells of each surface".to_owned()
        }
        SphereError::Edge { .. }
        | SphereError::Turned { .. }
        | SphereError::Vertex { .. }
        | SphereError::Unused { .. }
        | SphereError::Mesh(_) => format!("{check}` mends it"),
        SphereError::Collapsed { .. }
        | SphereError::Flipped { .. }
        | SphereError::Centre { .. } => "take --method robust".to_owned(),
        SphereError::TooFew { .. } => "give a closed surface".to_owned(),
        _ => "coarsen the surface, or look at it with `pliant check`".to_owned(),
    }
}
