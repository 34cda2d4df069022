//! Failures of commands, with their display.

use std::fmt;
use std::io::IsTerminal;

use miette::{Diagnostic, GraphicalReportHandler, LabeledSpan, NamedSource, SourceCode};

use super::excerpt::Excerpt;
use super::{BAD_INPUT, FAILED, warn};
use crate::report::folder::FolderError;
use pliant::scene::SceneError;
use pliant::simulation::LoadError;

/// The reason why a command failed.
#[derive(Debug)]
pub(super) enum Failure {
    /// The scene is invalid.
    Scene(SceneError),
    /// A mesh cannot be used.
    Load {
        /// The error.
        error: LoadError,
        /// True if the user wrote the scene.
        written: bool,
    },
    /// The results cannot be written.
    Folder(FolderError),
    /// Invalid input; the message contains the advice.
    #[cfg(feature = "viewer")]
    Message(String),
    /// Any other invalid input.
    Usage {
        /// The error.
        message: String,
        /// Advice.
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

    /// A mesh from the command line cannot be used.
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

    /// Prints the failure on standard error: with the source and a caret on a terminal, in one line
    /// on a pipe.
    pub(super) fn show(&self) {
        match self {
            Self::Scene(error) => {
                let all = error.each().into_iter();
                all.for_each(|each| say_with_source(&SceneDiagnostic::new(each), &each.terse()));
            }
            Self::Load { error, written } => {
                let all = error.each().into_iter();
                all.for_each(|each| show_unfit(each, *written));
            }
            #[cfg(feature = "viewer")]
            Self::Message(_) => warn(&self.terse()),
            Self::Folder(_) | Self::Usage { .. } => warn(&self.terse()),
        }
    }

    /// The failure in one line.
    pub(super) fn terse(&self) -> String {
        match self {
            Self::Scene(error) => {
                let all = error.each().into_iter().map(SceneError::terse);
                all.collect::<Vec<_>>().join("\n")
            }
            Self::Load { error, written } => {
                let all = error.each().into_iter().map(|each| terse(each, *written));
                all.collect::<Vec<_>>().join("\n")
            }
            Self::Folder(error) => format!("error: {error}"),
            #[cfg(feature = "viewer")]
            Self::Message(message) => format!("error: {message}"),
            Self::Usage { message, hint } => format!("error: {message}; {hint}"),
        }
    }
}

/// One line for a mesh that cannot be used; with its place in the scene if the user wrote one.
fn terse(error: &LoadError, written: bool) -> String {
    match error {
        LoadError::Unfit(unfit) if !written => unfit.without_place(),
        _ => error.terse(),
    }
}

/// Prints one error of a mesh, with its place in the file or in a scene that the user wrote.
fn show_unfit(error: &LoadError, written: bool) {
    let terse = terse(error, written);
    match error {
        // An error of reading contains the name of its file.
        LoadError::Read(read) => say_with_source(&Excerpt::of(read), &terse),
        LoadError::Unfit(unfit) if written => {
            say_with_source(&SceneDiagnostic::new(unfit.scene_error()), &terse)
        }
        LoadError::Unfit(_) | LoadError::Several(_) => warn(&terse),
    }
}

/// An error of a scene with the source line and a caret.
#[derive(Debug)]
struct SceneDiagnostic<'a> {
    error: &'a SceneError,
    source: NamedSource<String>,
}

impl<'a> SceneDiagnostic<'a> {
    fn new(error: &'a SceneError) -> Self {
        let source = NamedSource::new(error.source_name(), error.source_text().to_owned());
        Self { error, source }
    }
}

impl fmt::Display for SceneDiagnostic<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.error.fmt(f)
    }
}

impl std::error::Error for SceneDiagnostic<'_> {}

impl Diagnostic for SceneDiagnostic<'_> {
    fn code<'b>(&'b self) -> Option<Box<dyn fmt::Display + 'b>> {
        Some(Box::new(self.error.problem().code()))
    }

    fn help<'b>(&'b self) -> Option<Box<dyn fmt::Display + 'b>> {
        Some(Box::new(self.error.problem().help()))
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        Some(&self.source)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let key = self.error.key();
        let label = if key.is_empty() { "here" } else { key }.to_owned();
        let span = LabeledSpan::new_with_span(Some(label), self.error.span());
        Some(Box::new(std::iter::once(span)))
    }
}

/// Prints with the source on a terminal, in one line on a pipe.
fn say_with_source(error: &dyn Diagnostic, terse: &str) {
    let text = if std::io::stderr().is_terminal() {
        graphical(error, &GraphicalReportHandler::new())
    } else {
        None
    };
    warn(text.as_deref().unwrap_or(terse));
}

/// The error for a terminal; `None` if it cannot be displayed in that form.
pub(super) fn graphical(
    error: &dyn Diagnostic,
    handler: &GraphicalReportHandler,
) -> Option<String> {
    let mut text = String::new();
    handler.render_report(&mut text, error).ok()?;
    Some(text.trim_end().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_of_a_scene_shows_its_line_and_a_caret() {
        let text = "frames = 3\nframe_rate = \"60 Hz\"\n\
            [[bone]]\nname = \"femur\"\nshape = \"hip-femur\"\n\
            [[muscle]]\nname = \"calf\"\nshape = \"tetrahedron\"\n\
            [effects.contact]\ntickness = '1 mm'\n";
        let error =
            pliant::scene::parse(text, "s.toml", std::path::Path::new(".")).expect_err("refused");
        let handler = GraphicalReportHandler::new_themed(miette::GraphicalTheme::none());
        let expected = "E052

  x unknown key `tickness`, did you mean `thickness`?
    ,-[s.toml:10:1]
  9 | [effects.contact]
 10 | tickness = '1 mm'
    : ^^^^|^^^
    :     `-- effects.contact
    `----
  help: known keys here: thickness, friction, between";
        let shown = graphical(&SceneDiagnostic::new(&error), &handler);
        assert_eq!(shown.as_deref(), Some(expected));
    }

    proptest::proptest! {
        /// An error of a built-in scene with a piece put in or taken out can be shown.
        #[test]
        fn every_error_of_a_scene_can_be_shown(
            scene in 0..pliant::scene::builtin::BUILTIN.len(),
            at in proptest::prelude::any::<proptest::sample::Index>(),
            length in 0..12_usize,
            piece in proptest::prelude::any::<String>(),
        ) {
            let mut text: Vec<char> = pliant::scene::builtin::BUILTIN[scene].1.chars().collect();
            let at = at.index(text.len() + 1);
            let end = (at + length).min(text.len());
            text.splice(at..end, piece.chars());
            let text: String = text.into_iter().collect();
            let folder = std::path::Path::new(".");
            if let Err(error) = pliant::scene::parse(&text, "s.toml", folder) {
                let handler = GraphicalReportHandler::new();
                proptest::prop_assert!(graphical(&SceneDiagnostic::new(&error), &handler).is_some());
            }
        }
    }
}
