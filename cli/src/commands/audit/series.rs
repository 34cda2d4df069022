//! The files of each frame: those of a ParaView collection, or of a folder by their names.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::commands::failure::Failure;
use pliant::io::{FORMATS, pvd};
use pliant::simulation::LoadError;

/// Beginnings of names of rigid surfaces, as a run writes them.
const RIGID: [&str; 2] = ["bone_", "obstacle_"];

/// True unless a folder of `pliant run` says that its scene does not keep enclosed volumes: an implant
/// is filled, springs may stretch.
pub(super) fn keeps_volumes(frames: &Path) -> bool {
    let folder = if frames.is_dir() {
        Some(frames)
    } else {
        frames.parent()
    };
    let summary = folder.and_then(|folder| std::fs::read(folder.join("summary.json")).ok());
    let Some(summary) = summary.and_then(|text| serde_json::from_slice::<Value>(&text).ok()) else {
        return true;
    };
    let run = summary["effects"]["run"].as_array();
    let keeps = |effect: &Value| effect["effect"] == "volume";
    run.is_none_or(|run| summary["kind"] == "muscles" && run.iter().any(keeps))
}

/// A surface of a frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Part {
    pub name: String,
    pub file: PathBuf,
    pub rigid: bool,
}

/// The frames in order.
#[derive(Debug)]
pub(super) struct Series {
    /// The surfaces of each frame.
    pub frames: Vec<Vec<Part>>,
}

impl Series {
    /// The frames of a folder or of a collection; `rigid` are names of rigid surfaces.
    pub fn of(path: &Path, rigid: &[String]) -> Result<Self, Failure> {
        let shown = path.display();
        if path.is_dir() {
            let collections = files_in(path, |ending| ending == "pvd")?;
            return match &collections[..] {
                [] => Self::of_folder(path, rigid),
                [one] => Self::of_collection(one, rigid),
                [one, ..] => Err(Failure::usage(
                    format!("{shown} has {} collections", collections.len()),
                    format!("name one of them, such as {}", one.display()),
                )),
            };
        }
        if !path.exists() {
            return Err(Failure::usage(
                format!("{shown} does not exist"),
                "name a folder of frames or a .pvd file",
            ));
        }
        if ending(path) == "pvd" {
            return Self::of_collection(path, rigid);
        }
        Err(Failure::usage(
            format!("{shown} is a file, but not a .pvd"),
            "name the folder that contains the frames; `pliant check` examines one file",
        ))
    }

    fn of_collection(path: &Path, rigid: &[String]) -> Result<Self, Failure> {
        let collection = pvd::read(path).map_err(|e| LoadError::from(Box::new(e)))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut entries: Vec<_> = collection.entries().iter().collect();
        // Stable: the parts of a frame stay in their order.
        entries.sort_by(|a, b| (a.time + 0.0).total_cmp(&(b.time + 0.0)));
        let mut frames = Vec::new();
        for entries in entries.chunk_by(|a, b| a.time == b.time) {
            let mut parts = Vec::new();
            for entry in entries {
                let name = match entry.name.as_str() {
                    "" => split(Path::new(&entry.file)).0,
                    name => name.to_owned(),
                };
                parts.push(Part {
                    rigid: is_rigid(&name, rigid),
                    name,
                    file: folder.join(&entry.file),
                });
            }
            frames.push(parts);
        }
        Self { frames }.checked(path, rigid)
    }

    fn of_folder(path: &Path, rigid: &[String]) -> Result<Self, Failure> {
        let mut files = files_in(path, is_mesh)?;
        let below = path.join("frames");
        if files.is_empty() && below.is_dir() {
            files = files_in(&below, is_mesh)?;
        }
        let mut groups: BTreeMap<String, BTreeMap<Option<u64>, PathBuf>> = BTreeMap::new();
        for file in files {
            let (name, number) = split(&file);
            let group = groups.entry(name.clone()).or_default();
            if let Some(other) = group.insert(number, file.clone()) {
                return Err(Failure::usage(
                    format!(
                        "{} and {} are the same frame of {name}",
                        other.display(),
                        file.display()
                    ),
                    "move one of them to another folder",
                ));
            }
        }
        let moving = groups.values().filter(|group| group.len() > 1);
        let numbers: BTreeSet<u64> = moving
            .flat_map(|group| group.keys().flatten().copied())
            .collect();
        // A single frame of surfaces at rest.
        let numbers = if numbers.is_empty() {
            BTreeSet::from([0])
        } else {
            numbers
        };
        let mut frames = Vec::new();
        for &number in &numbers {
            let mut parts = Vec::new();
            for (name, group) in &groups {
                let is_rigid = is_rigid(name, rigid);
                let file = match group.len() {
                    1 => group.values().next(),
                    // A bone that does not move is not written again.
                    _ if is_rigid => group
                        .range(..=Some(number))
                        .next_back()
                        .map(|(_, file)| file),
                    _ => group.get(&Some(number)),
                };
                let Some(file) = file else {
                    return Err(Failure::usage(
                        format!("{}: {name} has no file of frame {number}", path.display()),
                        "write all frames of each surface, or move the surface to another folder",
                    ));
                };
                parts.push(Part {
                    name: name.clone(),
                    file: file.clone(),
                    rigid: is_rigid,
                });
            }
            frames.push(parts);
        }
        Self { frames }.checked(path, rigid)
    }

    /// Refuses a series without surfaces, with a surface twice in a frame or missing in one, and
    /// names of rigid surfaces that it does not have.
    fn checked(self, path: &Path, rigid: &[String]) -> Result<Self, Failure> {
        let shown = path.display();
        let Some(first) = self.frames.first().filter(|first| !first.is_empty()) else {
            let mut formats: Vec<&str> = FORMATS.iter().map(|f| f.name).collect();
            formats.dedup();
            return Err(Failure::usage(
                format!("{shown} has no surfaces"),
                format!(
                    "name a folder or a collection of files in one of: {}",
                    formats.join(", ")
                ),
            ));
        };
        let names: BTreeSet<&str> = first.iter().map(|p| p.name.as_str()).collect();
        for (number, parts) in self.frames.iter().enumerate() {
            let mut seen = BTreeSet::new();
            for part in parts {
                if !seen.insert(part.name.as_str()) {
                    return Err(Failure::usage(
                        format!("{shown}: {} is in frame {number} twice", part.name),
                        "give each surface a name of its own",
                    ));
                }
            }
            if let Some(other) = names.symmetric_difference(&seen).next() {
                return Err(Failure::usage(
                    format!(
                        "{shown}: {other} is not in all frames (frame {number} of {})",
                        self.frames.len()
                    ),
                    "write all frames of each surface",
                ));
            }
        }
        if let Some(unknown) = rigid.iter().find(|name| !names.contains(name.as_str())) {
            let known: Vec<&str> = names.into_iter().collect();
            return Err(Failure::usage(
                format!("{shown} has no surface `{unknown}`"),
                format!("its surfaces are {}", known.join(", ")),
            ));
        }
        Ok(self)
    }

    /// The indices of every `k`th frame and of the last.
    pub fn every(&self, k: usize) -> Vec<usize> {
        let last = self.frames.len().saturating_sub(1);
        let mut chosen: Vec<usize> = (0..self.frames.len()).step_by(k.max(1)).collect();
        if chosen.last() != Some(&last) {
            chosen.push(last);
        }
        chosen
    }
}

fn is_rigid(name: &str, rigid: &[String]) -> bool {
    rigid.iter().any(|given| given == name) || RIGID.iter().any(|begin| name.starts_with(begin))
}

fn ending(path: &Path) -> String {
    let ending = path
        .extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase());
    ending.unwrap_or_default()
}

fn is_mesh(ending: &str) -> bool {
    FORMATS.iter().any(|format| format.ending == ending)
}

/// The files of a folder whose ending is one of those, by name.
fn files_in(folder: &Path, is_one: impl Fn(&str) -> bool) -> Result<Vec<PathBuf>, Failure> {
    let refused = |e: std::io::Error| {
        Failure::usage(
            format!("{}: cannot be read: {e}", folder.display()),
            "name another folder",
        )
    };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(refused)? {
        let path = entry.map_err(refused)?.path();
        if path.is_file() && is_one(&ending(&path)) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// The name of a surface and the number of its frame, from `NAME_0001.vtp`, `NAME.0001.obj` or
/// `NAME-1.ply`.
fn split(file: &Path) -> (String, Option<u64>) {
    let stem = file
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let before = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    let name = before.trim_end_matches(['_', '.', '-']);
    let number = stem[before.len()..].parse().ok();
    match number {
        Some(number) if name.len() < before.len() && !name.is_empty() => {
            (name.to_owned(), Some(number))
        }
        _ => (stem, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_numbers_of_files() {
        for (file, name, number) in [
            ("medius_0012.vtp", "medius", Some(12)),
            ("medius.0012.obj", "medius", Some(12)),
            ("a/medius-3.ply", "medius", Some(3)),
            ("L4.obj", "L4", None),
            ("L4_7.obj", "L4", Some(7)),
            ("medius.obj", "medius", None),
            ("_7.obj", "_7", None),
            ("0007.obj", "0007", None),
            (
                "a_99999999999999999999999.obj",
                "a_99999999999999999999999",
                None,
            ),
        ] {
            assert_eq!(split(Path::new(file)), (name.to_owned(), number), "{file}");
        }
    }

    #[test]
    fn every_frame_and_the_last() {
        let series = Series {
            frames: vec![Vec::new(); 8],
        };
        assert_eq!(series.every(3), [0, 3, 6, 7]);
        assert_eq!(series.every(7), [0, 7]);
        assert_eq!(series.every(100), [0, 7]);
        assert_eq!(series.every(1).len(), 8);
    }
}
