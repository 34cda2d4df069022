//! Elements of an XML document of OpenSim, with the place of each in the file.

use std::path::Path;

use roxmltree::{Document, Node, ParsingOptions};

use crate::spelling::shown;

/// Greatest number of nodes of a document: models have some 10^4.
const MOST_NODES: u32 = 4_000_000;

/// Greatest depth of nested elements: models have some 20.
const DEEPEST: usize = 100;

/// Error of a model, a motion or a set of paths of OpenSim, with its place.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{file}:{}{message}", place(*line, *column))]
pub struct ModelError {
    /// The file name as given by the caller.
    pub file: String,
    /// Line, from 1; 0 for the file as a whole.
    pub line: u32,
    /// Column, in characters from 1; 0 where it is unknown.
    pub column: u32,
    /// The code of the kind, as in `docs/formats.md`.
    pub code: &'static str,
    /// The problem.
    pub message: String,
    /// Advice for the user.
    pub help: &'static str,
}

fn place(line: u32, column: u32) -> String {
    match (line, column) {
        (0, _) => " ".to_owned(),
        (line, 0) => format!("{line}: "),
        (line, column) => format!("{line}:{column}: "),
    }
}

/// The kinds of errors: code and advice.
pub(super) type Kind = (&'static str, &'static str);

/// The file cannot be read.
const UNREADABLE: Kind = ("E060", "check the path and whether you may read it");
/// No well-formed XML.
const NOT_XML: Kind = (
    "E090",
    "the file is cut off, damaged or no model: save it again in OpenSim",
);
/// A version before 4.0.
const OLD: Kind = (
    "E091",
    "open the model in OpenSim 4 and save it: it is then written in the present format",
);
/// An element or a value that is missing or malformed.
pub(super) const MALFORMED: Kind = (
    "E092",
    "save the model again in OpenSim 4, or correct the value there",
);
/// A kind of joint, function or constraint that is not read.
pub(super) const UNKNOWN_KIND: Kind = (
    "E093",
    "replace it in OpenSim by one that is read: docs/opensim.md lists them",
);
/// A name that nothing has.
pub(super) const UNKNOWN_NAME: Kind = ("E094", "check the spelling of the name");
/// Bones or joints of a scene that do not fit the model.
pub(super) const NO_FIT: Kind = (
    "E096",
    "name bones of bodies with a joint between them, and first the coordinate about the axis of the scene's joint",
);
/// A table of a motion.
pub(super) const TABLE: Kind = (
    "E095",
    "a table has a header that ends with `endheader`, then a line of column names that begins with `time`",
);

/// The text with control characters escaped: a message can quote bytes of the file.
fn printable(text: &str) -> String {
    let escaped = |c: char| match c.is_control() {
        true => c.escape_default().collect::<String>(),
        false => c.to_string(),
    };
    text.chars().map(escaped).collect()
}

impl ModelError {
    /// An error without a place in the file.
    pub(super) fn whole(file: &str, (code, help): Kind, message: impl Into<String>) -> Self {
        Self::at(file, [0, 0], (code, help), message)
    }

    /// An error at a line and a column.
    pub(super) fn at(
        file: &str,
        [line, column]: [u32; 2],
        (code, help): Kind,
        message: impl Into<String>,
    ) -> Self {
        Self {
            file: file.to_owned(),
            line,
            column,
            code,
            message: printable(&message.into()),
            help,
        }
    }

    /// Code, place, problem and help, on one line.
    pub fn terse(&self) -> String {
        let Self {
            file,
            line,
            column,
            code,
            message,
            help,
        } = self;
        format!(
            "{file}:{}error[{code}]: {message}; {help}",
            place(*line, *column)
        )
    }
}

/// The text of a file of at most a gibibyte.
pub(super) fn text_of(path: &Path) -> Result<String, ModelError> {
    let name = path.display().to_string();
    let failed = |e: std::io::Error| ModelError::whole(&name, UNREADABLE, e.to_string());
    let length = std::fs::metadata(path).map_err(failed)?.len();
    if length > 1 << 30 {
        let message = format!(
            "the file has {length} bytes, more than the limit of {}",
            1u64 << 30
        );
        return Err(ModelError::whole(&name, NOT_XML, message));
    }
    let bytes = std::fs::read(path).map_err(failed)?;
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let before = &error.as_bytes()[..at];
        let line = before.iter().filter(|b| **b == b'\n').count() + 1;
        let line = u32::try_from(line).unwrap_or(0);
        ModelError::at(&name, [line, 0], NOT_XML, "the text is not UTF-8")
    })
}

/// A parsed file.
pub(super) struct Parsed<'a> {
    file: &'a str,
    document: Document<'a>,
}

/// An element with its file.
#[derive(Clone, Copy)]
pub(super) struct Element<'p> {
    file: &'p str,
    node: Node<'p, 'p>,
}

impl<'a> Parsed<'a> {
    /// Parses a text. The root has to be an `OpenSimDocument` of version 4.
    pub(super) fn new(text: &'a str, file: &'a str) -> Result<Self, ModelError> {
        let options = ParsingOptions {
            allow_dtd: false,
            nodes_limit: MOST_NODES,
            ..ParsingOptions::default()
        };
        let document = Document::parse_with_options(text, options).map_err(|error| {
            let at = error.pos();
            let message = error.to_string();
            // The text of the library ends with the place, which stands in front here.
            let message = message.split(" at ").next().unwrap_or_default().to_owned();
            ModelError::at(file, [at.row, at.col], NOT_XML, message)
        })?;
        let parsed = Self { file, document };
        let root = parsed.root();
        if root.tag() != "OpenSimDocument" {
            let message = format!("expected <OpenSimDocument>, found <{}>", root.tag());
            return Err(root.error(NOT_XML, message));
        }
        let version = root.node.attribute("Version").unwrap_or_default();
        if let Some(deep) = parsed.too_deep() {
            let message = format!("elements are nested deeper than {DEEPEST}");
            return Err(deep.error(NOT_XML, message));
        }
        match version.trim().parse::<u64>() {
            Ok(number) if number >= 40_000 => Ok(parsed),
            Ok(_) => {
                let message = format!("version {version} is older than OpenSim 4.0 (40000)");
                Err(root.error(OLD, message))
            }
            Err(_) => Err(root.error(MALFORMED, "the document has no version")),
        }
    }

    /// The first element that is nested too deep. Elements stand in the order of the file, so that the
    /// ends of those that are open tell the depth.
    fn too_deep(&self) -> Option<Element<'_>> {
        let mut open: Vec<usize> = Vec::new();
        for node in self.document.descendants().filter(|n| n.is_element()) {
            let range = node.range();
            while open.last().is_some_and(|end| *end <= range.start) {
                open.pop();
            }
            open.push(range.end);
            if open.len() > DEEPEST {
                return Some(self.root().with(node));
            }
        }
        None
    }

    pub(super) fn root(&self) -> Element<'_> {
        Element {
            file: self.file,
            node: self.document.root_element(),
        }
    }
}

impl<'p> Element<'p> {
    pub(super) fn tag(self) -> &'p str {
        self.node.tag_name().name()
    }

    /// The attribute `name`, or an empty text.
    pub(super) fn name(self) -> &'p str {
        self.node.attribute("name").unwrap_or_default()
    }

    fn with(self, node: Node<'p, 'p>) -> Self {
        Self { node, ..self }
    }

    /// Range of bytes in the file, with both tags.
    pub(super) fn range(self) -> std::ops::Range<usize> {
        self.node.range()
    }

    /// Elements inside, in the order of the file.
    pub(super) fn children(self) -> impl Iterator<Item = Self> {
        let elements = self.node.children().filter(|n| n.is_element());
        elements.map(move |node| self.with(node))
    }

    /// Elements inside at any depth.
    pub(super) fn descendants(self) -> impl Iterator<Item = Self> {
        let elements = self.node.descendants().skip(1).filter(|n| n.is_element());
        elements.map(move |node| self.with(node))
    }

    /// Elements inside at any depth that are components: those of `<defaults>` are not.
    pub(super) fn components(self) -> impl Iterator<Item = Self> {
        let mut skipped = 0;
        self.descendants().filter(move |e| {
            let range = e.range();
            let is_component = range.start >= skipped;
            if is_component && e.tag() == "defaults" {
                skipped = range.end;
            }
            is_component
        })
    }

    pub(super) fn parent(self) -> Option<Self> {
        self.node.parent_element().map(|node| self.with(node))
    }

    pub(super) fn child(self, tag: &str) -> Option<Self> {
        self.children().find(|e| e.tag() == tag)
    }

    pub(super) fn need(self, tag: &str) -> Result<Self, ModelError> {
        let missing = || {
            let message = format!("<{}>{} has no <{tag}>", self.tag(), self.named());
            self.error(MALFORMED, message)
        };
        self.child(tag).ok_or_else(missing)
    }

    /// The name in quotes after a space, or nothing.
    pub(super) fn named(self) -> String {
        match self.name() {
            "" => String::new(),
            name => format!(" `{}`", shown(name)),
        }
    }

    /// The text inside, without spaces at its ends.
    pub(super) fn text(self) -> &'p str {
        self.node.text().unwrap_or_default().trim()
    }

    /// The text of a child, or an empty text.
    pub(super) fn text_of(self, tag: &str) -> &'p str {
        self.child(tag).map_or("", Self::text)
    }

    /// The numbers inside.
    pub(super) fn numbers(self) -> Result<Vec<f64>, ModelError> {
        let words = self.text().split_ascii_whitespace();
        let number = |word: &str| {
            word.parse::<f64>()
                .ok()
                .filter(|v| v.is_finite())
                .ok_or_else(|| {
                    let message = format!("`{}` in <{}> is no number", shown(word), self.tag());
                    self.error(MALFORMED, message)
                })
        };
        words.map(number).collect()
    }

    /// Exactly this many numbers inside.
    pub(super) fn exactly<const N: usize>(self) -> Result<[f64; N], ModelError> {
        let all = self.numbers()?;
        let count = all.len();
        all.try_into().map_err(|_| {
            let message = format!("<{}> has {count} numbers instead of {N}", self.tag());
            self.error(MALFORMED, message)
        })
    }

    /// The numbers of a child, or a default where the child is absent or empty.
    pub(super) fn numbers_or<const N: usize>(
        self,
        tag: &str,
        default: [f64; N],
    ) -> Result<[f64; N], ModelError> {
        match self.child(tag) {
            Some(child) if !child.text().is_empty() => child.exactly(),
            _ => Ok(default),
        }
    }

    /// A truth value of a child, or a default.
    pub(super) fn flag_or(self, tag: &str, default: bool) -> bool {
        match self.text_of(tag) {
            "" => default,
            text => text.eq_ignore_ascii_case("true"),
        }
    }

    pub(super) fn error(self, kind: Kind, message: impl Into<String>) -> ModelError {
        let at = self.node.document().text_pos_at(self.node.range().start);
        ModelError::at(self.file, [at.row, at.col], kind, message)
    }
}
