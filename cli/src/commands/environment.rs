//! The environment of the command: the variables at the beginning of a scene's paths.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::failure::Failure;
use pliant::io::FORMATS;
use pliant::scene::builtin;
use pliant::scene::{Content, SceneError};

/// The variable with the folder of measured data.
const DATA: &str = "PLIANT_DATA";

/// Value of an environment variable. If `PLIANT_DATA` is not set, the value is the folder
/// `shared/data` next to the working folder, or next to the repository of the package that cargo
/// runs, if it exists.
pub(super) fn variable(name: &str) -> Option<OsString> {
    let set = std::env::var_os(name).filter(|v| !v.is_empty());
    if set.is_some() || name != DATA {
        return set;
    }
    let package = std::env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from);
    // The package of the command is a folder of the repository.
    let repository = package.as_deref().and_then(Path::parent);
    let here = std::env::current_dir().ok();
    [here.as_deref(), package.as_deref(), repository]
        .into_iter()
        .flatten()
        .filter_map(|folder| Some(folder.parent()?.join("shared").join("data")))
        .find(|data| data.is_dir())
        .map(OsString::from)
}

/// A scene by its name or path, with overrides. Its paths can begin with environment variables.
/// The failure for a mesh or a study names the command that takes it.
pub(super) fn load_content(name_or_path: &str, overrides: &[String]) -> Result<Content, Failure> {
    let loaded = builtin::load_content_with(name_or_path, overrides, variable);
    loaded.map_err(|error| of_another_kind(name_or_path).unwrap_or(Failure::Scene(error)))
}

/// The same as [`load_content`], for cases of a scene that was loaded before.
pub(super) fn load_case(name_or_path: &str, overrides: &[String]) -> Result<Content, SceneError> {
    builtin::load_content_with(name_or_path, overrides, variable)
}

/// The failure for a file that is no scene, but that another command takes.
fn of_another_kind(name_or_path: &str) -> Option<Failure> {
    let path = Path::new(name_or_path);
    let ending = path.extension()?.to_str()?;
    let is_mesh = FORMATS
        .iter()
        .any(|format| format.ending.eq_ignore_ascii_case(ending));
    let is_study = || {
        let text = builtin::find(name_or_path).ok()?.text;
        Some(text.parse::<toml::Table>().ok()?.contains_key("vary"))
    };
    let (what, hint) = if is_mesh && path.is_file() {
        let hint = "write a scene of it with `pliant init`, or run it with `pliant run --muscles`";
        ("mesh", hint)
    } else if is_study() == Some(true) {
        ("study", "run it with `pliant study`")
    } else {
        return None;
    };
    let message = format!("`{name_or_path}` is a {what}, not a scene");
    Some(Failure::usage(message, hint))
}
