//! The built-in scenes, and the choice between a file and a built-in scene.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::error::{SceneError, SceneProblem};
use super::parse::{Surroundings, changed, parse_content, parse_with, unknown_name};
use super::{Content, Scene, Variables, no_variables, tree};
use crate::spelling::shown_path;

/// Largest size of a scene file [bytes].
const LARGEST: u64 = 4 << 20;

/// Each built-in scene: name, TOML text, and a description in one line.
pub const BUILTIN: &[(&str, &str, &str)] = &[
    (
        "hip",
        include_str!("builtin/hip.toml"),
        "a gluteus-like muscle over a turning femur",
    ),
    (
        "press",
        include_str!("builtin/press.toml"),
        "a muscle between two plates that close to 10 % and open again",
    ),
    (
        "distance",
        include_str!("builtin/distance.toml"),
        "a tetrahedron that swings about an edge, distance only",
    ),
    (
        "shape",
        include_str!("builtin/shape.toml"),
        "a tetrahedron that grows evenly, bending only",
    ),
    (
        "volume",
        include_str!("builtin/volume.toml"),
        "a tetrahedron that flattens, volume only",
    ),
    (
        "chain",
        include_str!("builtin/chain.toml"),
        "six points on a line, the order of a sweep",
    ),
    (
        "cube",
        include_str!("builtin/cube.toml"),
        "a soft cube that a ball presses, its volume kept",
    ),
    (
        "sheet",
        include_str!("builtin/sheet.toml"),
        "a square of skin that a ball lifts from below",
    ),
    (
        "flat-implant",
        include_str!("builtin/flat-implant.toml"),
        "flat skin over an implant of 100 cc",
    ),
    (
        "expander",
        include_str!("builtin/expander.toml"),
        "an expander under a scalp, filled in five steps",
    ),
    (
        "lattice",
        include_str!("builtin/lattice.toml"),
        "a box of points on springs, dragged and let go",
    ),
    (
        "jelly",
        include_str!("builtin/jelly.toml"),
        "two soft cubes of springs thrown at each other above a table",
    ),
];

/// The TOML of a built-in scene.
///
/// ```
/// assert!(pliant::scene::builtin::builtin("hip").is_some_and(|toml| toml.contains("hip-gluteus")));
/// ```
#[must_use]
pub fn builtin(name: &str) -> Option<&'static str> {
    BUILTIN
        .iter()
        .find(|(known, ..)| *known == name)
        .map(|&(_, toml, _)| toml)
}

/// Reads a scene of muscles by name or path, with overrides. If a file exists, or the name ends in
/// `.toml`, it is a file; otherwise it is a built-in scene, whose relative paths start in the
/// working folder.
///
/// # Errors
/// No such file or scene, a file that cannot be read, or an error in the scene.
///
/// ```
/// use pliant::scene::{Solver, builtin::load};
/// let scene = load("hip", &["substeps=40".to_owned()]).unwrap();
/// assert!(matches!(scene.solver, Solver::Xpbd(s) if s.substeps == 40));
/// ```
pub fn load(name_or_path: &str, overrides: &[String]) -> Result<Scene, SceneError> {
    load_with(name_or_path, overrides, no_variables)
}

/// The same as [`load`], with variables at the start of paths.
///
/// # Errors
/// Those of [`load`].
pub fn load_with(
    name_or_path: &str,
    overrides: &[String],
    variables: Variables,
) -> Result<Scene, SceneError> {
    let Written { text, name, folder } = find(name_or_path)?;
    let surroundings = Surroundings {
        variable: &variables,
        overrides,
        ..Surroundings::of(&folder)
    };
    parse_with(&text, &name, &surroundings)
}

/// The same as [`load`] for a scene of any kind.
///
/// # Errors
/// Those of [`load`].
///
/// ```
/// let scene = pliant::scene::builtin::load_content("flat-implant", &["implant.volume=50cc".to_owned()]).unwrap();
/// assert_eq!((scene.name(), scene.frames()), ("flat-implant", 1));
/// ```
pub fn load_content(name_or_path: &str, overrides: &[String]) -> Result<Content, SceneError> {
    load_content_with(name_or_path, overrides, no_variables)
}

/// The same as [`load_content`], with variables at the start of paths.
///
/// # Errors
/// Those of [`load`].
pub fn load_content_with(
    name_or_path: &str,
    overrides: &[String],
    variables: Variables,
) -> Result<Content, SceneError> {
    let Written { text, name, folder } = find(name_or_path)?;
    let surroundings = Surroundings {
        variable: &variables,
        overrides,
        ..Surroundings::of(&folder)
    };
    parse_content(&text, &name, &surroundings)
}

/// The text of a scene, its name in messages, and the folder of its relative paths.
#[derive(Clone, Debug)]
pub struct Written {
    /// The text of the scene.
    pub text: String,
    /// The name of the scene.
    pub name: String,
    /// The folder that relative paths of the scene start from.
    pub folder: PathBuf,
}

/// The keys and values of a scene with overrides, as they are written.
///
/// # Errors
/// No such file or scene, a text that is no TOML, or an override that does not fit.
pub fn table(name_or_path: &str, overrides: &[String]) -> Result<toml::Table, SceneError> {
    let Written { text, name, .. } = find(name_or_path)?;
    let (document, _) = changed(&text, &name, overrides)?;
    let plain = tree::plain(&document.value);
    Ok(plain
        .and_then(|value| value.as_table().cloned())
        .unwrap_or_default())
}

/// The text of a file or of a built-in scene.
pub fn find(name_or_path: &str) -> Result<Written, SceneError> {
    let path = Path::new(name_or_path);
    let here = Path::new(".");
    let folder = path
        .parent()
        .filter(|f| !f.as_os_str().is_empty())
        .unwrap_or(here);
    let ends_in_toml = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    if path.is_file() || ends_in_toml || (path.is_dir() && builtin(name_or_path).is_none()) {
        let text = read(path).map_err(|reason| {
            let problem = SceneProblem::MissingFile {
                path: shown_path(path),
                reason,
                hint: NO_SCENE,
            };
            SceneError::of_name(problem, name_or_path)
        })?;
        return Ok(Written {
            text,
            name: name_or_path.to_owned(),
            folder: folder.to_owned(),
        });
    }
    let Some(text) = builtin(name_or_path) else {
        let problem = unknown_name(
            "scene",
            name_or_path,
            BUILTIN.iter().map(|&(name, ..)| name),
        );
        return Err(SceneError::of_name(problem, name_or_path));
    };
    Ok(Written {
        text: text.to_owned(),
        name: format!("{name_or_path}.toml"),
        folder: here.to_owned(),
    })
}

/// Advice if there is no scene file.
const NO_SCENE: &str = "name a scene file, or one of the scenes that `pliant scenes` lists";

/// The text of a file, or the reason why it cannot be read (`None` if it does not exist).
pub(super) fn read(path: &Path) -> Result<String, Option<String>> {
    let reason =
        |e: std::io::Error| (e.kind() != std::io::ErrorKind::NotFound).then(|| e.to_string());
    if path.is_dir() {
        return Err(Some("it is a folder".to_owned()));
    }
    let file = std::fs::File::open(path).map_err(reason)?;
    let mut bytes = Vec::new();
    // Limited by the size read, not by the length that the system reports, which is wrong for
    // pipes.
    file.take(LARGEST + 1)
        .read_to_end(&mut bytes)
        .map_err(reason)?;
    if bytes.len() as u64 > LARGEST {
        return Err(Some("it is larger than 4 MiB and so no scene".to_owned()));
    }
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        let found = e.as_bytes().get(at).copied().unwrap_or_default();
        Some(format!(
            "byte {at} (0x{found:02x}) begins no character of UTF-8; save it as text in UTF-8"
        ))
    })
}
