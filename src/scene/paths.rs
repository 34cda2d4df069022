//! Paths of a scene: relative to its folder and inside it, or absolute, or starting with a
//! variable.

use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

use super::error::SceneProblem;
use crate::spelling::{shown, shown_path};

/// Value of a variable at the start of a path in a scene. The library reads no environment; its
/// caller provides the values.
pub type Variables = fn(&str) -> Option<OsString>;

/// Defines no variables.
#[must_use]
pub fn no_variables(_: &str) -> Option<OsString> {
    None
}

/// The file of a path in a scene in `folder`; the file must exist.
pub(super) fn resolve(
    text: &str,
    folder: &Path,
    variable: &dyn Fn(&str) -> Option<OsString>,
) -> Result<PathBuf, SceneProblem> {
    let (path, hint) = match text.strip_prefix('$') {
        Some(rest) => (
            with_variable(rest, variable)?,
            "check the path and the value of the variable",
        ),
        None if Path::new(text).is_absolute() => (PathBuf::from(text), "check the path"),
        None => (
            inside(text, folder)?,
            "check the path; it is relative to the scene's folder",
        ),
    };
    let missing = |reason: Option<&str>| {
        let reason = reason.map(str::to_owned);
        SceneProblem::MissingFile {
            path: shown_path(&path),
            reason,
            hint,
        }
    };
    match std::fs::metadata(&path) {
        Ok(found) if found.is_dir() => Err(missing(Some("it is a folder"))),
        Ok(_) => Ok(path),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Err(missing(None)),
        Err(e) => Err(missing(Some(&e.to_string()))),
    }
}

/// Resolves `NAME/rest` or `{NAME}/rest`, the text after the `$`.
fn with_variable(
    rest: &str,
    variable: &dyn Fn(&str) -> Option<OsString>,
) -> Result<PathBuf, SceneProblem> {
    let (name, rest) = match rest.strip_prefix('{').and_then(|r| r.split_once('}')) {
        Some(split) => split,
        None => rest.split_at(rest.find('/').unwrap_or(rest.len())),
    };
    let word = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    // A name with `=` or NUL would cause another kind of error in the system.
    let value = if word { variable(name) } else { None };
    let Some(value) = value else {
        return Err(SceneProblem::UnsetVariable { name: shown(name) });
    };
    Ok(PathBuf::from(value).join(rest.trim_start_matches('/')))
}

/// A relative path that stays inside the folder, with any `..` in it.
fn inside(text: &str, folder: &Path) -> Result<PathBuf, SceneProblem> {
    let outside = || SceneProblem::OutsideFolder {
        path: shown_path(Path::new(text)),
    };
    let mut parts: Vec<&std::ffi::OsStr> = Vec::new();
    for part in Path::new(text).components() {
        match part {
            Component::Normal(name) => parts.push(name),
            Component::CurDir => {}
            // `..` is resolved here and not by the system, for which `link/..` can be another
            // folder.
            Component::ParentDir => {
                parts.pop().ok_or_else(outside)?;
            }
            Component::RootDir | Component::Prefix(_) => return Err(outside()),
        }
    }
    let mut path = folder.to_path_buf();
    path.extend(parts);
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> Result<PathBuf, SceneProblem> {
        inside(text, Path::new("scenes"))
    }

    #[test]
    fn relative_paths_stay_in_the_folder() {
        assert_eq!(at("a.obj"), Ok(PathBuf::from("scenes/a.obj")));
        assert_eq!(at("./b/../a.obj"), Ok(PathBuf::from("scenes/a.obj")));
        for text in ["../a.obj", "b/../../a.obj", ".."] {
            assert_eq!(
                at(text),
                Err(SceneProblem::OutsideFolder {
                    path: text.to_owned()
                })
            );
        }
    }

    #[test]
    fn variables_are_put_in() {
        let variable = |name: &str| (name == "HERE").then(|| OsString::from("/data"));
        for text in ["HERE/a.obj", "{HERE}/a.obj", "{HERE}a.obj", "HERE//a.obj"] {
            assert_eq!(
                with_variable(text, &variable),
                Ok(PathBuf::from("/data/a.obj")),
                "{text}"
            );
        }
        for (text, name) in [
            ("THERE/a.obj", "THERE"),
            ("", ""),
            ("/a", ""),
            ("A=B/a", "A=B"),
            ("{HERE/a", "{HERE"),
        ] {
            assert_eq!(
                with_variable(text, &variable),
                Err(SceneProblem::UnsetVariable {
                    name: name.to_owned()
                }),
                "{text}"
            );
        }
    }

    #[test]
    fn folders_and_missing_files_are_refused() {
        let none = |_: &str| None;
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        assert_eq!(
            resolve("Cargo.toml", here, &none),
            Ok(here.join("Cargo.toml"))
        );
        assert!(matches!(
            resolve("src", here, &none),
            Err(SceneProblem::MissingFile {
                reason: Some(_),
                ..
            })
        ));
        assert!(matches!(
            resolve("no.obj", here, &none),
            Err(SceneProblem::MissingFile { reason: None, .. })
        ));
        assert!(matches!(
            resolve("a\0b", here, &none),
            Err(SceneProblem::MissingFile { .. })
        ));
    }
}
