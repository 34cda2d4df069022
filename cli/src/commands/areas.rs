//! Areas of a muscle from the command line, with their meshes.

use std::path::{Path, PathBuf};

use super::failure::Failure;
use pliant::fibres::AreaSource;
use pliant::io::{self, MeshFile};
use pliant::mesh::TriangleMesh;
use pliant::scene::units::{Dimension, UnitError, parse};
use pliant::simulation::{LoadError, component};

/// The text of an area.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Written {
    /// A patch, or one of its components.
    Patch(PathBuf, Option<usize>),
    /// Vertices of the muscle.
    Vertices(Vec<u32>),
    /// Vertices of the muscle in a text file.
    VerticesOf(PathBuf),
    /// All vertices within this distance [m] of a bone.
    Near(PathBuf, f64),
}

/// Error of a text that is no area.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(super) enum WrittenError {
    /// The text is empty, or a file name is missing.
    #[error("`{0}` names no file")]
    NoFile(String),
    /// `near:` without a comma.
    #[error("`{0}` has no distance behind a comma, as near:BONE.obj,5mm")]
    NoDistance(String),
    /// The distance is invalid.
    #[error("the distance in `{0}`: {1}")]
    Distance(String, UnitError),
    /// The distance is negative.
    #[error("the distance in `{0}` is negative")]
    Negative(String),
    /// The text after `#` is no number.
    #[error("`#{0}` is no component: give a number behind the `#`, 0 for the largest")]
    Component(String),
    /// The list has no end.
    #[error("`{0}` begins a list that no `]` ends, as in [0,1,2]")]
    Open(String),
    /// A word of a list is no number.
    #[error("`{word}` in line {line} is no vertex: vertices are whole numbers, counted from 0")]
    Vertex {
        /// The word.
        word: String,
        /// Its line, from 1.
        line: usize,
    },
}

impl WrittenError {
    fn help(&self) -> String {
        match self {
            Self::Distance(_, error) => error.help(),
            _ => "`pliant fibres --help` tells how areas are written".to_owned(),
        }
    }
}

impl std::str::FromStr for Written {
    type Err = WrittenError;

    fn from_str(text: &str) -> Result<Self, WrittenError> {
        let whole = || text.to_owned();
        let file = |name: &str| {
            if name.trim().is_empty() {
                Err(WrittenError::NoFile(whole()))
            } else {
                Ok(PathBuf::from(name))
            }
        };
        if let Some(list) = text.strip_prefix('[') {
            let list = list
                .trim_end()
                .strip_suffix(']')
                .ok_or_else(|| WrittenError::Open(whole()))?;
            return Ok(Self::Vertices(vertices(list)?));
        }
        if let Some(name) = text.strip_prefix("vertices:") {
            return Ok(Self::VerticesOf(file(name)?));
        }
        if let Some(rest) = text.strip_prefix("near:") {
            let (bone, distance) = rest
                .rsplit_once(',')
                .ok_or_else(|| WrittenError::NoDistance(whole()))?;
            let within = parse(distance, Dimension::Length)
                .map_err(|e| WrittenError::Distance(whole(), e))?;
            return if within >= 0.0 {
                Ok(Self::Near(file(bone)?, within))
            } else {
                Err(WrittenError::Negative(whole()))
            };
        }
        match text.rsplit_once('#') {
            None => Ok(Self::Patch(file(text)?, None)),
            Some((name, number)) => {
                let number = number
                    .parse()
                    .map_err(|_| WrittenError::Component(number.to_owned()))?;
                Ok(Self::Patch(file(name)?, Some(number)))
            }
        }
    }
}

/// Vertices in a text, separated by spaces, commas or lines; `#` starts a comment.
fn vertices(text: &str) -> Result<Vec<u32>, WrittenError> {
    let mut all = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        for word in line
            .split(|c: char| c.is_whitespace() || c == ',')
            .filter(|word| !word.is_empty())
        {
            let number = word.parse().ok().filter(|n| *n < u32::MAX);
            all.push(number.ok_or_else(|| WrittenError::Vertex {
                word: word.to_owned(),
                line: k + 1,
            })?);
        }
    }
    Ok(all)
}

/// A mesh file in metres.
pub(super) fn read_file(path: &Path, unit: f64) -> Result<MeshFile, Failure> {
    let mut file = io::read(path).map_err(|e| Failure::of_meshes(LoadError::from(Box::new(e))))?;
    file.mesh.vertices.iter_mut().for_each(|v| v.coords *= unit);
    Ok(file)
}

/// A mesh with triangles, in metres.
pub(super) fn read_mesh(path: &Path, unit: f64) -> Result<TriangleMesh, Failure> {
    let mesh = read_file(path, unit)?.mesh;
    if mesh.triangles.is_empty() {
        return Err(Failure::usage(
            format!("{} has no triangles", path.display()),
            "give a triangle mesh",
        ));
    }
    Ok(mesh)
}

/// An area with its mesh or list.
#[derive(Clone, Debug)]
pub(super) enum Loaded {
    /// A patch.
    Patch(TriangleMesh),
    /// Vertices of the muscle.
    Vertices(Vec<u32>),
    /// All vertices within this distance [m] of a bone.
    Near(TriangleMesh, f64),
}

impl Written {
    /// Parses an area after `option`.
    pub(super) fn of(option: &str, text: &str) -> Result<Self, Failure> {
        text.parse().map_err(|error: WrittenError| {
            Failure::usage(format!("{option}: {error}"), error.help())
        })
    }

    /// Reads the files of the area, whose lengths are in `unit` [m].
    pub(super) fn load(&self, option: &str, unit: f64) -> Result<Loaded, Failure> {
        Ok(match self {
            Self::Vertices(list) => Loaded::Vertices(list.clone()),
            Self::VerticesOf(path) => {
                let shown = path.display();
                let text = std::fs::read_to_string(path).map_err(|error| {
                    Failure::usage(
                        format!("{option}: cannot read `{shown}`: {error}"),
                        "name a text file of vertices",
                    )
                })?;
                Loaded::Vertices(vertices(&text).map_err(|error| {
                    Failure::usage(
                        format!("{option}: {shown}: {error}"),
                        "a mesh is given without `vertices:`",
                    )
                })?)
            }
            Self::Near(path, within) => Loaded::Near(read_mesh(path, unit)?, *within),
            Self::Patch(path, number) => {
                let whole = read_mesh(path, unit)?;
                Loaded::Patch(
                    component(&whole, *number)
                        .ok_or_else(|| no_component(option, path, &whole, *number))?,
                )
            }
        })
    }
}

fn no_component(option: &str, path: &Path, whole: &TriangleMesh, number: Option<usize>) -> Failure {
    let count = pliant::mesh::Topology::new(whole).components().count;
    let (shown, number) = (path.display(), number.unwrap_or(0));
    let message = format!(
        "{option}: {shown} has no component {number}; it has {count}, counted from 0 by falling area"
    );
    Failure::usage(
        message,
        format!("give {shown}#0 for the largest, or {shown} for all"),
    )
}

impl Loaded {
    /// The area in the form of the library.
    pub(super) fn source(&self) -> AreaSource<'_> {
        match self {
            Self::Patch(patch) => AreaSource::Patch(patch),
            Self::Vertices(list) => AreaSource::Vertices(list),
            Self::Near(bone, within) => AreaSource::Near(bone, *within),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_way_to_write_an_area() {
        let patch = |name: &str, number| Written::Patch(name.into(), number);
        for (text, expected) in [
            ("area.obj", patch("area.obj", None)),
            ("a/b#c.obj#12", patch("a/b#c.obj", Some(12))),
            (
                "near:Femur.r.obj,5mm",
                Written::Near("Femur.r.obj".into(), 0.005),
            ),
            (
                "near:a,b.obj, 0.5 cm",
                Written::Near("a,b.obj".into(), 0.005),
            ),
            ("near:b.obj,0m", Written::Near("b.obj".into(), 0.0)),
            ("[0,1, 2]", Written::Vertices(vec![0, 1, 2])),
            ("[]", Written::Vertices(Vec::new())),
            ("vertices:list.txt", Written::VerticesOf("list.txt".into())),
        ] {
            assert_eq!(text.parse(), Ok(expected), "{text}");
        }
        assert_eq!(
            vertices("# ends\n1 2,3\n\n 4 # the last\n"),
            Ok(vec![1, 2, 3, 4])
        );
    }

    #[test]
    fn text_that_is_no_area_is_refused() {
        for (text, expected) in [
            ("", "names no file"),
            ("#0", "names no file"),
            ("vertices:", "names no file"),
            ("near:Femur.obj", "no distance behind a comma"),
            ("near:Femur.obj,5", "`5` has no unit"),
            ("near:Femur.obj,", "does not begin with a number"),
            ("near:Femur.obj,5 kg", "kg"),
            ("near:Femur.obj,-5mm", "is negative"),
            ("near:,5mm", "names no file"),
            ("area.obj#largest", "`#largest` is no component"),
            ("area.obj#-1", "`#-1` is no component"),
            ("[0,1", "no `]` ends"),
            ("[0,one]", "`one` in line 1"),
            ("[0,-1]", "`-1` in line 1"),
            ("[0,1.5]", "`1.5` in line 1"),
            ("[4294967295]", "`4294967295`"),
        ] {
            let error = text.parse::<Written>().expect_err(text);
            assert!(error.to_string().contains(expected), "{text}: {error}");
            assert!(!error.help().is_empty());
        }
        let error = vertices("1\n2 v 3\n").expect_err("a word");
        assert_eq!(
            error,
            WrittenError::Vertex {
                word: "v".into(),
                line: 2
            }
        );
    }
}
