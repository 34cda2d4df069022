//! A scene from meshes on the command line, without a scene file.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::failure::Failure;
use super::scene_text::{name_after, quoted};
use super::{environment, length_unit};
use pliant::contact::{Obstacle, Surface};
use pliant::mesh::TriangleMesh;
use pliant::scene::{EFFECTS, Scene, Surroundings, parse_with};
use pliant::simulation::Assets;

/// Distance from a bone within which a muscle is attached [mm].
const NEAR_MM: f64 = 3.0;

/// Greatest share of a muscle that is attached to one bone [%]; for all bones together twice as
/// much.
const LIMIT_PERCENT: f64 = 5.0;

/// Meshes to run without a scene file.
#[derive(Debug, Default, clap::Args)]
pub(super) struct Meshes {
    /// Muscle meshes to run without a scene file; requires --unit
    #[arg(long, value_name = "FILE", num_args = 1.., help_heading = "Without a scene file")]
    muscles: Vec<PathBuf>,
    /// Bone meshes; bones do not move, and a muscle is attached to a bone within 3 mm
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "muscles", help_heading = "Without a scene file")]
    bones: Vec<PathBuf>,
    /// Lines along the fibres of the muscles: one file of legacy VTK LINES, or of OBJ `l`, per
    /// muscle in the same order
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "muscles", help_heading = "Without a scene file")]
    fibre_lines: Vec<PathBuf>,
    /// Length unit of all these files, such as mm
    #[arg(
        long,
        value_name = "UNIT",
        requires = "muscles",
        help_heading = "Without a scene file"
    )]
    unit: Option<String>,
}

/// A muscle or bone of the scene.
struct Named {
    name: String,
    path: String,
}

impl Meshes {
    /// True if meshes are given.
    pub(super) fn are_given(&self) -> bool {
        !self.muscles.is_empty()
    }
}

/// The scene of these meshes with the changes of the command line, and its TOML text without them.
pub(super) fn scene(meshes: &Meshes, changes: &[String]) -> Result<(Scene, String), Failure> {
    let Some(unit) = &meshes.unit else {
        let hint = "add the unit of their coordinates, for example --unit mm";
        return Err(Failure::usage(
            "mesh files do not say their length unit",
            hint,
        ));
    };
    length_unit(unit)?;
    if meshes.fibre_lines.len() > meshes.muscles.len() {
        let (fibres, muscles) = (meshes.fibre_lines.len(), meshes.muscles.len());
        let message = format!("{fibres} files of fibre lines for {muscles} muscles");
        return Err(Failure::usage(
            message,
            "give at most one for each muscle, in their order",
        ));
    }
    let mut used = HashSet::new();
    let muscles = named(&meshes.muscles, &mut used)?;
    let bones = named(&meshes.bones, &mut used)?;
    let fibres = named(&meshes.fibre_lines, &mut HashSet::new())?;
    let base = Written {
        unit,
        muscles,
        bones,
        fibres,
    };
    // Only the unchanged meshes show which bones a muscle is attached to.
    let free = base.toml(&[]);
    let assets = Assets::load(&parse(&free, changes)?).map_err(Failure::of_meshes)?;
    let toml = base.toml(&holders(&assets));
    Ok((parse(&toml, changes)?, toml))
}

fn parse(toml: &str, changes: &[String]) -> Result<Scene, Failure> {
    let surroundings = Surroundings {
        folder: Path::new("."),
        variable: &environment::variable,
        overrides: changes,
    };
    Ok(parse_with(toml, "scene.toml", &surroundings)?)
}

/// Names the bodies after the stems of their files, each name once, with absolute paths.
fn named(paths: &[PathBuf], used: &mut HashSet<String>) -> Result<Vec<Named>, Failure> {
    let mut all = Vec::new();
    for path in paths {
        let shown = path.display();
        let absolute = path.canonicalize().map_err(|e| {
            let why = if e.kind() == std::io::ErrorKind::NotFound {
                String::new()
            } else {
                format!(": {e}")
            };
            let from = if path.is_absolute() {
                "check the path"
            } else {
                "check the path; it is relative to the working folder"
            };
            Failure::usage(format!("no file `{shown}`{why}"), from)
        })?;
        let Some(text) = absolute.to_str() else {
            return Err(Failure::usage(
                format!("the name of `{shown}` is not UTF-8"),
                "rename it",
            ));
        };
        let name = name_after(path, used)?;
        all.push(Named {
            name,
            path: text.to_owned(),
        });
    }
    Ok(all)
}

/// The bones near each muscle.
fn holders(assets: &Assets) -> Vec<Vec<usize>> {
    let surfaces: Vec<Surface> = assets.bones.iter().map(Surface::new).collect();
    let near = |muscle: &TriangleMesh, bone: &Surface| {
        muscle.vertices.iter().any(|v| {
            bone.closest(v)
                .is_some_and(|c| c.distance.abs() <= NEAR_MM * 1e-3)
        })
    };
    let of = |mesh| {
        (0..surfaces.len())
            .filter(|&b| near(mesh, &surfaces[b]))
            .collect()
    };
    assets.muscles.iter().map(|m| of(&m.mesh)).collect()
}

struct Written<'a> {
    unit: &'a str,
    muscles: Vec<Named>,
    bones: Vec<Named>,
    fibres: Vec<Named>,
}

impl Written<'_> {
    /// The scene as TOML; `holders` are the bones that each muscle is attached to.
    fn toml(&self, holders: &[Vec<usize>]) -> String {
        let text = quoted;
        let unit = text(self.unit);
        let scene = self.muscles.first().map_or("meshes", |m| m.name.as_str());
        let mut toml = format!(
            "name = {}\nframes = 300\nframe_rate = \"60 Hz\"\n",
            text(scene)
        );
        for bone in &self.bones {
            let (name, path) = (text(&bone.name), text(&bone.path));
            toml.push_str(&format!(
                "\n[[bone]]\nname = {name}\nmesh = {path}\nunit = {unit}\n"
            ));
        }
        for (m, muscle) in self.muscles.iter().enumerate() {
            let (name, path) = (text(&muscle.name), text(&muscle.path));
            toml.push_str(&format!(
                "\n[[muscle]]\nname = {name}\nmesh = {path}\nunit = {unit}\n"
            ));
            let held = holders.get(m).map_or(&[][..], Vec::as_slice);
            // All bones together can fix a tenth of a muscle's vertices.
            let limit = LIMIT_PERCENT.min(2.0 * LIMIT_PERCENT / held.len().max(1) as f64);
            for &b in held {
                let bone = text(&self.bones[b].name);
                toml.push_str(&format!(
                    "[[muscle.attachment]]\nbone = {bone}\nnear = \"{NEAR_MM} mm\"\nlimit = \"{limit} %\"\n"
                ));
            }
            if let Some(fibres) = self.fibres.get(m) {
                toml.push_str(&format!(
                    "[muscle.fibres]\nlines = {}\nunit = {unit}\n",
                    text(&fibres.path)
                ));
            }
        }
        toml.push_str(&usual_effects());
        toml
    }
}

/// Every effect that a muscle usually has, as in the built-in hip.
fn usual_effects() -> String {
    let mut toml = "\n".to_owned();
    for effect in &EFFECTS {
        if let Some(keys) = effect.usual {
            toml.push_str(&format!("[effects.{}]\n{keys}", effect.key));
        }
    }
    toml
}
