//! The files of a draft: the scene and the meshes beside it.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::Failure;
use crate::draft::Draft;
use pliant::io::{self, Encoding};
use pliant::mesh::TriangleMesh;

/// The first line of a draft.
const DRAFT: &str = "# A draft by `pliant init`.";

/// Advice for a file that cannot be written.
const SCENE: &str = "name another file with --scene";

/// The text at the head of the scene file.
pub(super) fn heading(path: &Path) -> String {
    let name = path.display();
    format!(
        "{DRAFT} Lines with a reason beside them are guesses: change what is wrong.\n\
         # Then `pliant plan {name}` and `pliant run {name}`. Number of steps and solver follow from the scene.\n"
    )
}

/// Refuses a scene file before the meshes are examined, which takes a while. Its name goes into comments
/// of the scene, which end with a line.
pub(super) fn can_be_written(path: &Path, folder: &Path) -> Result<(), Failure> {
    let refused = |text: String| Err(Failure::usage(text, SCENE));
    let name = path.to_string_lossy();
    if name.contains(char::is_control) {
        let text = format!("{name:?} has a line break or another control character");
        return refused(text);
    }
    if path.is_dir() {
        return refused(format!("{name} is a folder"));
    }
    if !folder.as_os_str().is_empty() && !folder.is_dir() {
        return refused(format!("{} is no folder", folder.display()));
    }
    Ok(())
}

/// Removes the meshes of the draft with the text `before` at `path` that the new `draft` does not write
/// again. They are files of the names that drafts give, which the old one names and this call does not
/// read.
pub(super) fn remove_replaced(before: &str, path: &Path, draft: &Draft, read: &[PathBuf]) {
    let Some(parts) = draft.parts.as_ref().filter(|_| before.starts_with(DRAFT)) else {
        return;
    };
    let read: Vec<PathBuf> = read.iter().filter_map(|f| f.canonicalize().ok()).collect();
    let entries = std::fs::read_dir(path.with_file_name(parts)).into_iter();
    for entry in entries.flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_of_draft = name.ends_with("-with-tendon.obj") || name.contains("-on-");
        let value = format!("= \"{}/{name}\"\n", parts.display());
        let is_written = draft.files().any(|(file, _)| *file == parts.join(&name));
        let is_read = entry
            .path()
            .canonicalize()
            .is_ok_and(|file| read.contains(&file));
        if is_of_draft && before.contains(&value) && !is_written && !is_read {
            // A mesh that stays is in nobody's way.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Writes a mesh of the draft, and its folder.
pub(super) fn write_mesh(file: &Path, mesh: &TriangleMesh) -> Result<(), Failure> {
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).map_err(|e| no_file(folder, &e))?;
    }
    let written = io::write(file, mesh, &[], Encoding::Text);
    written
        .map(|_| ())
        .map_err(|e| Failure::usage(e.to_string(), SCENE))
}

fn no_file(path: &Path, error: &std::io::Error) -> Failure {
    Failure::usage(
        format!("{}: cannot be written: {error}", path.display()),
        SCENE,
    )
}

/// Writes the scene, whole or not at all.
pub(super) fn write(path: &Path, text: &str) -> Result<(), Failure> {
    io::write_whole(path, |to| to.write_all(text.as_bytes())).map_err(|e| no_file(path, &e))
}
