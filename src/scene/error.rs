//! Errors of a scene, with their places and advice.

use std::fmt;
use std::sync::Arc;

use super::tree::{Sources, Span};
use super::units::{Dimension, UnitError};
use crate::spelling::shown;

/// Kinds of errors in a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneProblem {
    /// E050: a quantity, or a mesh, without its unit.
    #[error("{found} has no unit")]
    UnitsRequired {
        /// The value found.
        found: String,
        /// An example of the right form.
        example: String,
        /// Dimension of the quantity.
        dimension: Dimension,
    },
    /// E051: a number outside the allowed range, or NaN or infinity.
    #[error("{found} is not allowed here")]
    OutOfRange {
        /// The number as written.
        found: String,
        /// The allowed range.
        allowed: String,
    },
    /// E052: an unknown key.
    #[error("unknown key `{key}`{}", meant(.nearest.as_deref()))]
    UnknownKey {
        /// The key as written.
        key: String,
        /// The most similar known key.
        nearest: Option<String>,
        /// All keys known there.
        known: String,
    },
    /// E053: a duplicate key or section.
    #[error("`{key}` is given twice")]
    DuplicateKey {
        /// The key as written.
        key: String,
    },
    /// E054: a value of another type.
    #[error("expected {expected}, found {found}")]
    WrongType {
        /// The expected type, with an example.
        expected: String,
        /// The type found.
        found: String,
    },
    /// E055: a required part is missing.
    #[error("{what} is missing")]
    Missing {
        /// What is missing.
        what: String,
        /// The text to add.
        add: String,
    },
    /// E056: two parts that exclude each other.
    #[error("`{first}` and `{second}` exclude each other")]
    Conflict {
        /// The first part.
        first: String,
        /// The second part.
        second: String,
    },
    /// E057: not TOML.
    #[error("{message}")]
    Syntax {
        /// Message of the TOML reader.
        message: String,
    },
    /// E058: a text that is no quantity.
    #[error(transparent)]
    Quantity(#[from] UnitError),
    /// E059: key frames, or angles of a path, that are not in ascending order.
    #[error("{what} {frame} does not come after {what} {before}")]
    KeysOutOfOrder {
        /// What orders the keys: frames, or angles \[rad\].
        what: &'static str,
        /// Frame of the later key.
        frame: f64,
        /// Frame of the previous key.
        before: f64,
    },
    /// E060: a file that does not exist or cannot be read.
    #[error("{}", missing(path, reason.as_deref()))]
    MissingFile {
        /// The resolved path.
        path: String,
        /// The reason why it cannot be read.
        reason: Option<String>,
        /// Advice, which depends on the start of the path.
        hint: &'static str,
    },
    /// E061: a relative path that leaves the scene's folder.
    #[error("`{path}` lies outside the scene's folder")]
    OutsideFolder {
        /// The path as written.
        path: String,
    },
    /// E062: a variable in a path that is not set.
    #[error("the variable `{name}` is not set")]
    UnsetVariable {
        /// Name of the variable, without the `$`.
        name: String,
    },
    /// E063: an unknown name.
    #[error("there is no {what} `{name}`{}", meant(.nearest.as_deref()))]
    UnknownName {
        /// Kind of the named object.
        what: &'static str,
        /// The name as written.
        name: String,
        /// The most similar known name.
        nearest: Option<String>,
        /// All known names.
        known: String,
    },
    /// E064: a duplicate name.
    #[error("the name `{name}` is given twice")]
    DuplicateName {
        /// The name.
        name: String,
    },
    /// E065: a list without elements.
    #[error("the list is empty")]
    EmptyList {
        /// The required content.
        expected: String,
    },
    /// E066: a vertex held by two bones.
    #[error("vertex {vertex} is already held by the bone `{bone}`")]
    HeldTwice {
        /// Index of the vertex.
        vertex: u32,
        /// The other bone.
        bone: String,
    },
    /// E067: values nested too deep.
    #[error("values are nested deeper than {deepest}")]
    TooDeep {
        /// Deepest nesting accepted.
        deepest: usize,
    },
    /// E068: an override that is not `path.key=value`, or with an unknown path.
    #[error("{message}")]
    Override {
        /// The error.
        message: String,
        /// Advice.
        hint: String,
    },
    /// E020 to E099: an unusable mesh, attachment or muscle, see `simulation::fault`; or a model or a motion of OpenSim.
    #[error("{message}")]
    Unfit {
        /// The code of the fault.
        code: &'static str,
        /// The error.
        message: String,
        /// Advice.
        help: String,
    },
    /// E069: an ambiguous rotation between two key frames.
    #[error("the motion from the previous key to this one is ambiguous: {why}")]
    UnclearTurn {
        /// The reason.
        why: &'static str,
    },
}

fn meant(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |n| format!(", did you mean `{n}`?"))
}

fn missing(path: &str, reason: Option<&str>) -> String {
    reason.map_or_else(
        || format!("no file `{path}`"),
        |r| format!("`{path}` cannot be read: {r}"),
    )
}

impl SceneProblem {
    pub(super) fn out_of_range(found: &str, allowed: &str) -> Self {
        Self::OutOfRange {
            found: format!("`{}`", shown(found)),
            allowed: allowed.to_owned(),
        }
    }

    pub(super) fn missing(key: &str, add: impl Into<String>) -> Self {
        Self::Missing {
            what: format!("`{key}`"),
            add: add.into(),
        }
    }

    /// The code of the kind, `E050` to `E069` except for meshes; it stays the same when messages
    /// change.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::UnitsRequired { .. } => "E050",
            Self::OutOfRange { .. } => "E051",
            Self::UnknownKey { .. } => "E052",
            Self::DuplicateKey { .. } => "E053",
            Self::WrongType { .. } => "E054",
            Self::Missing { .. } => "E055",
            Self::Conflict { .. } => "E056",
            Self::Syntax { .. } => "E057",
            Self::Quantity(UnitError::Bare { .. }) => "E050",
            Self::Quantity(
                UnitError::NotFinite { .. }
                | UnitError::Overflow { .. }
                | UnitError::NoInterval { .. },
            ) => "E051",
            Self::Quantity(_) => "E058",
            Self::KeysOutOfOrder { .. } => "E059",
            Self::MissingFile { .. } => "E060",
            Self::OutsideFolder { .. } => "E061",
            Self::UnsetVariable { .. } => "E062",
            Self::UnknownName { .. } => "E063",
            Self::DuplicateName { .. } => "E064",
            Self::EmptyList { .. } => "E065",
            Self::HeldTwice { .. } => "E066",
            Self::TooDeep { .. } => "E067",
            Self::Override { .. } => "E068",
            Self::UnclearTurn { .. } => "E069",
            Self::Unfit { code, .. } => code,
        }
    }

    /// Advice for the user.
    #[must_use]
    pub fn help(&self) -> String {
        match self {
            Self::UnitsRequired {
                example, dimension, ..
            } => {
                format!(
                    "write {example}; known units of {dimension}: {}",
                    dimension.known()
                )
            }
            Self::OutOfRange { allowed, .. } => format!("give {allowed}"),
            Self::UnknownKey { known, .. } => format!("known keys here: {known}"),
            Self::DuplicateKey { .. } => "keep one of the two".to_owned(),
            Self::WrongType { expected, .. } => format!("write {expected}"),
            Self::Missing { add, .. } => format!("add {add}"),
            Self::Conflict { first, second } => format!("keep either `{first}` or `{second}`"),
            Self::Syntax { .. } => "write the scene as TOML, see https://toml.io".to_owned(),
            Self::Quantity(error) => error.help(),
            Self::KeysOutOfOrder { what, .. } => {
                let of = what.split(" [").next().unwrap_or(what);
                format!("sort the keys by {of}, each {of} once")
            }
            Self::MissingFile { hint, .. } => (*hint).to_owned(),
            Self::OutsideFolder { .. } => {
                "write an absolute path, or one that begins with a variable such as $PLIANT_DATA"
                    .to_owned()
            }
            Self::UnsetVariable { name } => format!("set it: export {name}=FOLDER"),
            Self::UnknownName { known, .. } if known.is_empty() => "there are none yet".to_owned(),
            Self::UnknownName { known, .. } => format!("there are: {known}"),
            Self::DuplicateName { .. } => "give each its own name".to_owned(),
            Self::EmptyList { expected } => format!("give {expected}, or leave the key out"),
            Self::HeldTwice { .. } => "name each vertex in one attachment".to_owned(),
            Self::TooDeep { .. } => "a scene needs no more than a few levels".to_owned(),
            Self::Override { hint, .. } => hint.clone(),
            Self::Unfit { help, .. } => help.clone(),
            Self::UnclearTurn { .. } => "add key frames between the two".to_owned(),
        }
    }
}

/// A problem in a scene with its place.
#[derive(Clone)]
pub struct SceneError(Box<Placed>);

#[derive(Clone)]
struct Placed {
    problem: SceneProblem,
    key: String,
    /// Name and text of the file or of the override.
    source: (Arc<str>, Arc<str>),
    span: Span,
    /// Line and column, both from 1; `None` if the text is no file (an override, a name).
    place: Option<(usize, usize)>,
    /// Errors of other parts of the scene.
    others: Vec<SceneError>,
}

/// The errors of the parts of a scene, so that all are reported at once.
#[derive(Debug, Default)]
pub(super) struct Gathered(Vec<SceneError>);

impl Gathered {
    /// The value of a part; `None` if it has an error, which is kept.
    pub fn keep<T>(&mut self, part: Result<T, SceneError>) -> Option<T> {
        part.map_err(|error| self.0.push(error)).ok()
    }

    /// Number of errors so far.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// All errors as one.
    pub fn end(&mut self) -> Result<(), SceneError> {
        let mut all = std::mem::take(&mut self.0).into_iter();
        let Some(mut first) = all.next() else {
            return Ok(());
        };
        first.0.others.extend(all);
        Err(first)
    }
}

impl SceneError {
    pub(super) fn new(problem: SceneProblem, key: &str, span: &Span, sources: &Sources) -> Self {
        let (name, text, span, own) = sources.locate(span);
        let before = text.get(..span.start).unwrap_or(&text);
        let column = before
            .rsplit('\n')
            .next()
            .unwrap_or_default()
            .chars()
            .count()
            + 1;
        // The text of an override is also its name and needs no place.
        let place = own.then(|| (before.matches('\n').count() + 1, column));
        let source = (name, text);
        Self(Box::new(Placed {
            problem,
            key: key.to_owned(),
            source,
            span,
            place,
            others: Vec::new(),
        }))
    }

    /// An error of a name or a path outside any file.
    pub(super) fn of_name(problem: SceneProblem, name: &str) -> Self {
        let source = (Arc::from(name), Arc::from(name));
        Self(Box::new(Placed {
            problem,
            key: String::new(),
            source,
            span: 0..name.len(),
            place: None,
            others: Vec::new(),
        }))
    }

    /// An error in a scene without text.
    pub(super) fn nowhere(problem: SceneProblem, key: &str) -> Self {
        let source = (Arc::from("scene"), Arc::from(""));
        Self(Box::new(Placed {
            problem,
            key: key.to_owned(),
            source,
            span: 0..0,
            place: None,
            others: Vec::new(),
        }))
    }

    /// This error, and those of other parts of the scene.
    #[must_use]
    pub fn each(&self) -> Vec<&Self> {
        let others = self.0.others.iter().flat_map(Self::each);
        std::iter::once(self).chain(others).collect()
    }

    /// The problem.
    #[must_use]
    pub fn problem(&self) -> &SceneProblem {
        &self.0.problem
    }

    /// The key with the problem, such as `muscle.0.material.density`; empty for the document
    /// itself.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.0.key
    }

    /// Line and column in the file, both from 1; `None` for an override or the name of a scene.
    #[must_use]
    pub fn place(&self) -> Option<(usize, usize)> {
        self.0.place
    }

    /// Name of the text with the problem: a path, a name, or an override.
    #[must_use]
    pub fn source_name(&self) -> &str {
        &self.0.source.0
    }

    /// The text with the problem: the whole file, or the override.
    #[must_use]
    pub fn source_text(&self) -> &str {
        &self.0.source.1
    }

    /// The problem's bytes within [`source_text`](Self::source_text).
    #[must_use]
    pub fn span(&self) -> Span {
        self.0.span.clone()
    }

    /// One line, `file:line:column: error[E052]: key: problem; advice`, for pipes and logs.
    #[must_use]
    pub fn terse(&self) -> String {
        let at = match self.0.place {
            Some((line, column)) => format!("{}:{line}:{column}", self.source_name()),
            None => self.source_name().to_owned(),
        };
        let key = if self.0.key.is_empty() {
            String::new()
        } else {
            format!("{}: ", self.0.key)
        };
        format!(
            "{at}: error[{}]: {key}{}; {}",
            self.0.problem.code(),
            self.0.problem,
            self.0.problem.help()
        )
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.problem.fmt(f)
    }
}

impl fmt::Debug for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.terse())
    }
}

impl std::error::Error for SceneError {}
