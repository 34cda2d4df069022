//! The environment of the command: the variables at the beginning of a scene's paths.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

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
pub(super) fn load_content(
    name_or_path: &str,
    overrides: &[String],
) -> Result<Content, SceneError> {
    builtin::load_content_with(name_or_path, overrides, variable)
}
