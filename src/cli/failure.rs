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
        error: LoadError,
        /// Whether a person wrote the scene that names it.
        written: bool,
    },
    /// The results cannot be written.
    Folder(FolderError),
    /// Wrong input whose message says what to do.
    #[cfg(feature = "viewer")]
    Told(String),
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
        Self::Load {
            error,
            written: true,
        }
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
        Self::Usage {
            message: message.into(),
            hint: hint.into(),
        }
    }

    /// A mesh named on the command line that cannot be used.
    pub(super) fn of_meshes(error: LoadError) -> Self {
        Self::Load {
            error,
            written: false,
        }
    }

    /// The exit code.
    pub(super) fn code(&self) -> u8 {
        match self {
            Self::Folder(
                FolderError::Io { .. } | FolderError::Picture(_) | FolderError::WriterEnded,
            ) => FAILED,
            _ => BAD_INPUT,
        }
    }

    /// Says it on standard error: with the source and a caret to a person, in one line to a pipe.
    pub(super) fn show(&self) {
        match self {
            Self::Scene(error) => say_with_source(error, &self.terse()),
            Self::Load { error, written } => match (error, written) {
                // An error of reading names its own file.
                (LoadError::Read(read), _) => say_with_source(&Excerpt::of(read), &self.terse()),
                (LoadError::Unfit(unfit), true) => {
                    say_with_source(unfit.diagnostic(), &self.terse())
                }
                (LoadError::Unfit(_), false) => warn(&self.terse()),
            },
            #[cfg(feature = "viewer")]
            Self::Told(_) => warn(&self.terse()),
            Self::Folder(_) | Self::Usage { .. } => warn(&self.terse()),
        }
    }

    /// In one line.
    pub(super) fn terse(&self) -> String {
        match self {
            Self::Scene(error) => error.terse(),
            Self::Load { error, written } => match (error, written) {
                (LoadError::Unfit(unfit), false) => unfit.without_place(),
                _ => error.terse(),
            },
            Self::Folder(error) => format!("error: {error}"),
            #[cfg(feature = "viewer")]
            Self::Told(message) => format!("error: {message}"),
            Self::Usage { message, hint } => format!("error: {message}; {hint}"),
        }
    }
}

/// With the source to a person, in one line to a pipe.
fn say_with_source(error: &dyn Diagnostic, terse: &str) {
    let text = if std::io::stderr().is_terminal() {
        graphical(error, &GraphicalReportHandler::new())
    } else {
        None
    };
    warn(text.as_deref().unwrap_or(terse));
}

/// An error as a person sees it; `None` if it cannot be shown like that.
pub(super) fn graphical(
    error: &dyn Diagnostic,
    handler: &GraphicalReportHandler,
) -> Option<String> {
    let mut text = String::new();
    handler.render_report(&mut text, error).ok()?;
    Some(text.trim_end().to_owned())
}
