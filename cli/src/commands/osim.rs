//! `pliant osim`: a scene from a model of OpenSim and meshes of muscles.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::failure::Failure;
use super::options::Output;
use super::{DONE, init, length_unit, note};
use nalgebra::{Isometry3, Point3};
use pliant::io::{self, Encoding, file_name};
use pliant::mesh::{Aabb, TriangleMesh};
use pliant::moment_arms::means;
use pliant::opensim::{Model, ModelBody, ModelMuscle};

/// A body counts as a bone of the scene where it comes this near to a muscle [m].
const NEAR: f64 = 0.03;

/// Write a scene from a model of OpenSim and a folder of muscle meshes
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant osim subject.osim --muscles scans
  pliant osim subject.osim --muscles scans --unit mm --geometry Geometry --motion walk.mot

Muscles have the pose of the model at the defaults of its coordinates, in its ground. Bones are the meshes of the
model's bodies, from the files that it names: beside the model, in a folder Geometry there, or in --geometry. Bodies
within 30 mm of a muscle become bones of the scene, or those of --bodies. Attachments are guessed as `pliant init`
does. NAME.toml moves the bones by the model, and ends with the call of `pliant moment-arms` whose forces have
the names of the muscles. Then the first ten frames are run.")]
pub(super) struct Arguments {
    /// A model of OpenSim 4
    model: PathBuf,
    /// Meshes of muscles, or folders of them
    #[arg(long, value_name = "MESH", required = true, num_args = 1..)]
    muscles: Vec<PathBuf>,
    /// Length unit of the muscle meshes
    #[arg(long, value_name = "UNIT", default_value = "m")]
    unit: String,
    /// Folders of the files that the model names
    #[arg(long, value_name = "DIR", num_args = 1..)]
    geometry: Vec<PathBuf>,
    /// Bodies that become bones [default: those near a muscle]
    #[arg(long, value_name = "NAME", num_args = 1..)]
    bodies: Vec<String>,
    /// Motion of the coordinates (.mot, .sto)
    #[arg(long, value_name = "FILE")]
    motion: Option<PathBuf>,
    /// The scene file to write [default: named after the model]
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Overwrite an existing scene file
    #[arg(long)]
    force: bool,
    /// Write the scene, and run no frame
    #[arg(long)]
    no_trial: bool,
    #[command(flatten)]
    output: Output,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let scale = length_unit(&arguments.unit)?;
    let model = Model::read(&arguments.model).map_err(|e| Failure::usage(e.to_string(), e.help))?;
    let muscles = init::mesh_files(&arguments.muscles)?;
    let bodies = bones(arguments, &model)?;
    let chosen = chosen(arguments, &bodies, &muscles, scale)?;
    let stem = arguments
        .model
        .file_stem()
        .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let scene = arguments.scene.clone();
    let scene = scene.unwrap_or_else(|| PathBuf::from(format!("{}.toml", file_name(&stem))));
    if scene.exists() && !arguments.force {
        let message = format!("{} is there already", scene.display());
        return Err(Failure::usage(
            message,
            "name another file with --scene, or add --force",
        ));
    }
    let folder = scene.with_extension("bones");
    let mut files = Vec::new();
    for (name, mesh) in chosen {
        let file = folder.join(format!("{}.obj", file_name(&name)));
        let mut mesh = mesh.clone();
        mesh.vertices.iter_mut().for_each(|v| *v /= scale);
        let written = std::fs::create_dir_all(&folder)
            .map_err(|e| e.to_string())
            .and_then(|()| io::write(&file, &mesh, &[], Encoding::Text).map_err(|e| e.to_string()));
        written.map_err(|e| {
            Failure::usage(
                format!("{}: {e}", file.display()),
                "name another file with --scene",
            )
        })?;
        files.push((name, file));
    }
    let draft = init::Arguments::of_files(
        &files
            .iter()
            .map(|(_, file)| file.clone())
            .collect::<Vec<_>>(),
        &muscles,
        (&arguments.unit, &scene),
        arguments.output.clone(),
    );
    init::run(&draft)?;
    append(&scene, &section(arguments, &model, &files, &muscles))?;
    if arguments.no_trial {
        return Ok(DONE);
    }
    init::trial(&draft, &scene)
}

/// The meshes of all bodies that have some, in the ground [m].
fn bones(arguments: &Arguments, model: &Model) -> Result<BTreeMap<String, TriangleMesh>, Failure> {
    let beside = arguments.model.parent().unwrap_or(Path::new("")).to_owned();
    let folders: Vec<PathBuf> = [beside.clone(), beside.join("Geometry")]
        .into_iter()
        .chain(arguments.geometry.iter().cloned())
        .collect();
    let poses = model.poses(&model.defaults());
    let (mut found, mut missing) = (BTreeMap::new(), Vec::new());
    for (body, pose) in model.bodies.iter().zip(poses) {
        let mesh = meshes(body, &pose, &folders, &mut missing)?;
        if !mesh.triangles.is_empty() {
            found.insert(body.name.clone(), mesh);
        }
    }
    if found.is_empty() {
        let message = format!(
            "none of the {} files of the model's geometry is there",
            missing.len()
        );
        let first = missing.first().map_or("", String::as_str);
        return Err(Failure::usage(
            message,
            format!("name the folder of {first} with --geometry"),
        ));
    }
    if !missing.is_empty() {
        note(&format!(
            "note: not there, and left out: {}",
            missing.join(", ")
        ));
    }
    Ok(found)
}

/// The meshes of a body as one, in the ground [m].
fn meshes(
    body: &ModelBody,
    pose: &Isometry3<f64>,
    folders: &[PathBuf],
    missing: &mut Vec<String>,
) -> Result<TriangleMesh, Failure> {
    let mut whole = TriangleMesh::default();
    for mesh in &body.meshes {
        let candidates = folders.iter().map(|folder| folder.join(&mesh.file));
        let Some(path) = candidates.into_iter().find(|path| path.is_file()) else {
            missing.push(mesh.file.clone());
            continue;
        };
        let read = io::read(&path).map_err(|error| Failure::of_meshes(Box::new(error).into()))?;
        let first = whole.vertices.len() as u32;
        let place =
            |v: &Point3<f64>| pose * mesh.pose * Point3::from(v.coords.component_mul(&mesh.scale));
        whole.vertices.extend(read.mesh.vertices.iter().map(place));
        let moved = read.mesh.triangles.iter().map(|t| t.map(|v| v + first));
        whole.triangles.extend(moved);
    }
    Ok(whole)
}

/// The bodies that become bones.
fn chosen<'b>(
    arguments: &Arguments,
    bodies: &'b BTreeMap<String, TriangleMesh>,
    muscles: &[PathBuf],
    scale: f64,
) -> Result<Vec<(String, &'b TriangleMesh)>, Failure> {
    let known = bodies.keys().cloned().collect::<Vec<_>>().join(", ");
    if let Some(name) = arguments
        .bodies
        .iter()
        .find(|name| !bodies.contains_key(*name))
    {
        let message = format!("--bodies: no body `{name}` has a mesh");
        return Err(Failure::usage(
            message,
            format!("bodies with meshes: {known}"),
        ));
    }
    let mut boxes = Vec::new();
    for file in muscles {
        let read = io::read(file).map_err(|error| Failure::of_meshes(Box::new(error).into()))?;
        let bounds = read.mesh.bounding_box();
        boxes.push(Aabb::of_points(&[bounds.min * scale, bounds.max * scale]).inflate(NEAR));
    }
    let is_near = |mesh: &TriangleMesh| {
        let inside = |p: &Point3<f64>| boxes.iter().any(|b| b.contains(p));
        mesh.vertices.iter().any(inside)
    };
    let chosen: Vec<(String, &TriangleMesh)> = bodies
        .iter()
        .filter(|(name, mesh)| match arguments.bodies.is_empty() {
            true => is_near(mesh),
            false => arguments.bodies.contains(name),
        })
        .map(|(name, mesh)| (name.clone(), mesh))
        .collect();
    if chosen.len() < 2 {
        let message = format!(
            "{} of the model's bodies come within 30 mm of a muscle; a scene needs two",
            chosen.len()
        );
        let hint = format!(
            "check --unit, and that muscles have the pose of the model at its defaults; or name --bodies: {known}"
        );
        return Err(Failure::usage(message, hint));
    }
    Ok(chosen)
}

/// A text of TOML.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// The section `[opensim]`, and the call of `pliant moment-arms`.
fn section(
    arguments: &Arguments,
    model: &Model,
    files: &[(String, PathBuf)],
    muscles: &[PathBuf],
) -> String {
    let whole = |path: &Path| {
        let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        path.display().to_string()
    };
    let bones = files.iter().map(|(name, file)| {
        let bone = file
            .file_stem()
            .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        format!("{} = {}", quoted(&bone), quoted(name))
    });
    let bones: Vec<String> = bones.collect();
    let mut text = format!(
        "\n[opensim]\nmodel = {}\nbones = {{ {} }}\n",
        quoted(&whole(&arguments.model)),
        bones.join(", ")
    );
    match &arguments.motion {
        Some(motion) => {
            let _ = writeln!(text, "motion = {}", quoted(&whole(motion)));
        }
        None => {
            text += "# motion = \"walk.mot\"          # or `pliant run SCENE --motion walk.mot`\n"
        }
    }
    let mut forces = Vec::new();
    for file in muscles {
        let name = file
            .file_stem()
            .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        let own = model
            .muscles
            .iter()
            .filter(|m| means(&m.name, &name.replace(['_', '.'], " ")));
        // Of both sides, those that the bones of the scene hold.
        let is_held = |m: &&ModelMuscle| {
            let ends = [m.points.first(), m.points.last()].into_iter().flatten();
            let names = ends.map(|(body, _)| &model.bodies[*body].name);
            names
                .into_iter()
                .all(|name| files.iter().any(|(chosen, _)| chosen == name))
        };
        let own: Vec<&str> = own.filter(is_held).map(|m| m.name.as_str()).collect();
        if !own.is_empty() {
            forces.push(format!("{name}={}", own.join("+")));
        }
    }
    let _ = write!(
        text,
        "\n# Moment arms over the model's coordinates:\n# pliant moment-arms SCENE --osim {} --coordinate NAME,... --forces '{}' --splice\n",
        arguments.model.display(),
        forces.join(",")
    );
    text
}

/// Appends a text to the scene file, if both are a scene.
fn append(scene: &Path, section: &str) -> Result<(), Failure> {
    let failed = |e: std::io::Error| {
        Failure::usage(
            format!("{}: {e}", scene.display()),
            "name another file with --scene",
        )
    };
    let text = std::fs::read_to_string(scene).map_err(failed)? + section;
    let folder = scene.parent().unwrap_or(Path::new(""));
    super::from_meshes::parse(&text, folder, &[])?;
    pliant::io::write_whole(scene, |w| std::io::Write::write_all(w, text.as_bytes()))
        .map_err(failed)
}
