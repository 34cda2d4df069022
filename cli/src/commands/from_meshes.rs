//! A scene from meshes on the command line, without a scene file.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::failure::Failure;
use super::scene_text::name_after;
use super::{environment, length_unit};
use crate::draft::{Body, Draft};
use pliant::scene::{Scene, Surroundings, parse_with};
use pliant::simulation::Assets;

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
    let mut draft = Draft {
        name: muscles
            .first()
            .map_or("meshes", |m| m.name.as_str())
            .to_owned(),
        unit: unit.clone(),
        muscles,
        bones,
        fibres: fibres.into_iter().map(|file| file.path).collect(),
        ..Draft::default()
    };
    examine(&mut draft, changes)?;
    let toml = draft.toml();
    Ok((parse(&toml, HERE, changes)?, toml))
}

/// Finds the attachments of a draft, with these changes of its scene. Only the unchanged meshes show
/// which bones a muscle is attached to.
pub(super) fn examine(draft: &mut Draft, changes: &[String]) -> Result<(), Failure> {
    let assets = Assets::load(&parse(&draft.toml(), HERE, changes)?).map_err(Failure::of_meshes)?;
    draft.examine(&assets);
    Ok(())
}

/// The working folder.
pub(super) const HERE: &str = ".";

/// The scene of a text, with paths that start in a folder.
pub(super) fn parse(
    toml: &str,
    folder: impl AsRef<Path>,
    changes: &[String],
) -> Result<Scene, Failure> {
    let surroundings = Surroundings {
        variable: &environment::variable,
        overrides: changes,
        ..Surroundings::of(folder.as_ref())
    };
    Ok(parse_with(toml, "scene.toml", &surroundings)?)
}

/// Names the bodies after the stems of their files, each name once, with absolute paths.
pub(super) fn named(paths: &[PathBuf], used: &mut HashSet<String>) -> Result<Vec<Body>, Failure> {
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
        all.push(Body {
            name,
            path: text.to_owned(),
            ..Body::default()
        });
    }
    Ok(all)
}
