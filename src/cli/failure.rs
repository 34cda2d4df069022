//! Why a command could not do its work, and how that is said.

use std::io::IsTerminal;

use miette::{Diagnostic, GraphicalReportHandler};

use super::excerpt::Excerpt;
use super::{BAD_INPUT, FAILED, warn};
use crate::report::folder::FolderError;
use crate::scene::SceneError;
use crate::simulation::LoadError;

/// Why a command could not do its work.
#[derive(Debug)]
pub(super) enum Failure {
    /// The scene is wrong.
    Scene(SceneError),
    /// A mesh cannot be used.
    Load {
        /// Why.
        error: Box<LoadError>,
        /// The scene that names it; empty where there is none.
        scene: String,
    },
    /// The results cannot be written.
    Folder(FolderError),
    /// Anything else that is wrong with what was asked.
    Usage {
        /// What is wrong.
        message: String,
        /// What to do.
        hint: String,
    },
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self::Scene(error)
    }
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        Self::load(error, "")
    }
}

impl From<FolderError> for Failure {
    fn from(error: FolderError) -> Self {
        Self::Folder(error)
    }
}

impl Failure {
    /// An error of usage.
    pub(super) fn usage(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Usage { message: message.into(), hint: hint.into() }
    }

    /// A mesh of a scene that cannot be used.
    pub(super) fn load(error: LoadError, scene: &str) -> Self {
        Self::Load { error: error.into(), scene: scene.to_owned() }
    }

    /// The exit code.
    pub(super) fn code(&self) -> u8 {
        match self {
            Self::Folder(FolderError::Io { .. } | FolderError::WriterEnded) => FAILED,
            _ => BAD_INPUT,
        }
    }

    /// Says it on standard error: with the source and a caret to a person, in one line to a pipe.
    pub(super) fn show(&self) {
        match self {
            Self::Scene(error) => say_with_source(error, &self.terse()),
            Self::Load { error, .. } => match &**error {
                LoadError::Read(error) => say_with_source(&Excerpt::of(error), &self.terse()),
                _ => warn(&self.terse()),
            },
            Self::Folder(_) | Self::Usage { .. } => warn(&self.terse()),
        }
    }

    /// In one line.
    pub(super) fn terse(&self) -> String {
        match self {
            Self::Scene(error) => error.terse(),
            Self::Load { error, scene } => match &**error {
                // An error of reading names its own file.
                LoadError::Read(error) => error.terse(),
                error => {
                    let at = if scene.is_empty() { String::new() } else { format!("{scene}: ") };
                    let hint = hint(error).map_or_else(String::new, |h| format!("; {h}"));
                    format!("{at}error: {error}{hint}")
                }
            },
            Self::Folder(error) => format!("error: {error}"),
            Self::Usage { message, hint } => format!("error: {message}; {hint}"),
        }
    }
}

/// With the source to a person, in one line to a pipe.
fn say_with_source(error: &dyn Diagnostic, terse: &str) {
    let text = if std::io::stderr().is_terminal() { graphical(error, &GraphicalReportHandler::new()) } else { None };
    warn(text.as_deref().unwrap_or(terse));
}

/// An error as a person sees it; `None` if it cannot be shown like that.
pub(super) fn graphical(error: &dyn Diagnostic, handler: &GraphicalReportHandler) -> Option<String> {
    let mut text = String::new();
    handler.render_report(&mut text, error).ok()?;
    Some(text.trim_end().to_owned())
}

/// What to do about a mesh that cannot be used, where its message does not say so itself.
fn hint(error: &LoadError) -> Option<String> {
    match error {
        LoadError::NoTriangles { file, .. } => Some(match file.strip_prefix("shape ") {
            Some(shape) => format!("this version cannot make the shape `{shape}`"),
            None => "name a file with a surface".to_owned(),
        }),
        LoadError::Refine { .. } => Some("ask for a longer edge length".to_owned()),
        LoadError::NoSuchComponent { .. } => Some("name another number behind `#`, or none".to_owned()),
        LoadError::Read(_)
        | LoadError::NoLines { .. }
        | LoadError::NotClosed { .. }
        | LoadError::NoSuchVertex { .. }
        | LoadError::NothingAttached { .. }
        | LoadError::TooManyAttached { .. } => None,
    }
}
