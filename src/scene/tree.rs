//! The scene file as a tree of values, each with its place in the text.
//!
//! A scene can come from several texts (the file and overrides of the command line). All are
//! concatenated in [`Sources`], so that one range of bytes identifies text, line and column.

use std::ops::Range;
use std::sync::Arc;

use toml::de::{DeTable, DeValue};
use toml::{Spanned, de::DeInteger};

use super::error::{SceneError, SceneProblem};
use crate::spelling::shown;

/// Greatest depth of nested values.
const DEEPEST: usize = 64;

/// A range of bytes in [`Sources`].
pub(super) type Span = Range<usize>;

/// One text of a scene.
#[derive(Clone, Debug)]
struct Piece {
    name: Arc<str>,
    text: Arc<str>,
    start: usize,
}

/// All texts of a scene.
#[derive(Clone, Debug)]
pub(super) struct Sources {
    first: Piece,
    more: Vec<Piece>,
}

impl Sources {
    /// The scene's own text only.
    pub(super) fn new(name: &str, text: &str) -> Self {
        Self {
            first: Piece {
                name: name.into(),
                text: text.into(),
                start: 0,
            },
            more: Vec::new(),
        }
    }

    /// Adds a text and returns its start.
    pub(super) fn add(&mut self, name: &str, text: &str) -> usize {
        let last = self.more.last().unwrap_or(&self.first);
        // One byte apart, so that the end of one text is not the start of the next.
        let start = last.start + last.text.len() + 1;
        self.more.push(Piece {
            name: name.into(),
            text: text.into(),
            start,
        });
        start
    }

    /// Name and text of a span, the span within that text, and whether it is the scene's own text.
    pub(super) fn locate(&self, span: &Span) -> (Arc<str>, Arc<str>, Span, bool) {
        let piece = self
            .more
            .iter()
            .rev()
            .find(|p| p.start <= span.start)
            .unwrap_or(&self.first);
        let within = |at: usize| at.saturating_sub(piece.start).min(piece.text.len());
        let span = within(span.start)..within(span.end.max(span.start));
        (
            piece.name.clone(),
            piece.text.clone(),
            span,
            piece.start == 0,
        )
    }
}

/// A value with its place.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) span: Span,
    pub(super) value: Value,
}

/// A TOML value.
#[derive(Clone, Debug)]
pub(super) enum Value {
    Text(String),
    Integer(i64),
    Float(f64),
    Boolean(bool),
    Date,
    List(Vec<Node>),
    Table(Table),
}

impl Value {
    /// Name of the kind in messages.
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Self::Text(_) => "a text",
            Self::Integer(_) => "a whole number",
            Self::Float(_) => "a number",
            Self::Boolean(_) => "true or false",
            Self::Date => "a date or time",
            Self::List(_) => "a list",
            Self::Table(_) => "a table",
        }
    }
}

/// Keys and values in the order of the text.
#[derive(Clone, Debug, Default)]
pub(super) struct Table {
    pub(super) entries: Vec<Entry>,
}

/// A key, its place, its value.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) key: String,
    pub(super) span: Span,
    pub(super) node: Node,
}

impl Table {
    pub(super) fn get(&self, key: &str) -> Option<&Entry> {
        self.entries.iter().find(|e| e.key == key)
    }

    pub(super) fn get_mut(&mut self, key: &str) -> Option<&mut Entry> {
        self.entries.iter_mut().find(|e| e.key == key)
    }

    /// Sets the value of a key; replaces an existing one.
    pub(super) fn set(&mut self, key: &str, span: Span, node: Node) -> &mut Node {
        let at = match self.entries.iter().position(|e| e.key == key) {
            Some(at) => {
                self.entries[at] = Entry {
                    key: key.to_owned(),
                    span,
                    node,
                };
                at
            }
            None => {
                self.entries.push(Entry {
                    key: key.to_owned(),
                    span,
                    node,
                });
                self.entries.len() - 1
            }
        };
        &mut self.entries[at].node
    }

    pub(super) fn remove(&mut self, key: &str) {
        self.entries.retain(|e| e.key != key);
    }
}

/// Reads a whole document from the first text of `sources`.
pub(super) fn document(sources: &Sources) -> Result<Node, SceneError> {
    let text = sources.first.text.clone();
    let parsed = DeTable::parse(&text).map_err(|e| syntax(&e, &text, sources))?;
    let mut span = parsed.span();
    // The document has no header; its first byte is the place of missing keys.
    span.end = span.start;
    let value = Value::Table(table(parsed.get_ref(), 0, 1, sources)?);
    Ok(Node { span, value })
}

/// Reads one TOML value; `None` if the text is none.
pub(super) fn value(
    text: &str,
    offset: usize,
    sources: &Sources,
) -> Result<Option<Node>, SceneError> {
    DeValue::parse(text)
        .ok()
        .map(|parsed| convert(&parsed, offset, 1, sources))
        .transpose()
}

/// A value without places; `None` for a date, which no scene has.
pub(super) fn plain(value: &Value) -> Option<toml::Value> {
    Some(match value {
        Value::Text(text) => text.clone().into(),
        Value::Integer(number) => (*number).into(),
        Value::Float(number) => (*number).into(),
        Value::Boolean(flag) => (*flag).into(),
        Value::Date => return None,
        Value::List(list) => {
            let each = list.iter().filter_map(|node| plain(&node.value));
            toml::Value::Array(each.collect())
        }
        Value::Table(table) => {
            let each = table.entries.iter();
            let each = each.filter_map(|e| Some((e.key.clone(), plain(&e.node.value)?)));
            toml::Value::Table(each.collect())
        }
    })
}

/// The error of the TOML reader in the terms of this crate.
fn syntax(error: &toml::de::Error, text: &str, sources: &Sources) -> SceneError {
    let span = error.span().unwrap_or(0..0);
    let found = text.get(span.clone()).unwrap_or_default();
    let problem = match error.message() {
        "duplicate key" => SceneProblem::DuplicateKey { key: shown(found) },
        message if message.contains("recursion") => SceneProblem::TooDeep { deepest: DEEPEST },
        message => SceneProblem::Syntax {
            message: message.to_owned(),
        },
    };
    SceneError::new(problem, "", &span, sources)
}

fn convert(
    from: &Spanned<DeValue<'_>>,
    offset: usize,
    depth: usize,
    sources: &Sources,
) -> Result<Node, SceneError> {
    let span = from.span().start + offset..from.span().end + offset;
    let fail = |problem| Err(SceneError::new(problem, "", &span, sources));
    if depth > DEEPEST {
        return fail(SceneProblem::TooDeep { deepest: DEEPEST });
    }
    let value = match from.get_ref() {
        DeValue::String(text) => Value::Text(text.to_string()),
        DeValue::Integer(number) => match whole(number) {
            Some(number) => Value::Integer(number),
            None => {
                return fail(SceneProblem::out_of_range(
                    &number.to_string(),
                    "a whole number of at most 63 bits",
                ));
            }
        },
        DeValue::Float(number) => match number.as_str().parse() {
            Ok(number) => Value::Float(number),
            Err(_) => return fail(SceneProblem::out_of_range(number.as_str(), "a number")),
        },
        DeValue::Boolean(flag) => Value::Boolean(*flag),
        DeValue::Datetime(_) => Value::Date,
        DeValue::Array(list) => Value::List(
            list.iter()
                .map(|v| convert(v, offset, depth + 1, sources))
                .collect::<Result<_, _>>()?,
        ),
        DeValue::Table(from) => Value::Table(table(from, offset, depth + 1, sources)?),
    };
    Ok(Node { span, value })
}

fn whole(number: &DeInteger<'_>) -> Option<i64> {
    i64::from_str_radix(number.as_str(), number.radix()).ok()
}

fn table(
    from: &DeTable<'_>,
    offset: usize,
    depth: usize,
    sources: &Sources,
) -> Result<Table, SceneError> {
    let mut entries = Vec::new();
    for (key, node) in from {
        let span = key.span().start + offset..key.span().end + offset;
        let node = convert(node, offset, depth, sources)?;
        entries.push(Entry {
            key: key.get_ref().to_string(),
            span,
            node,
        });
    }
    // The reader sorts keys by name; errors should name the first in the file.
    entries.sort_by_key(|e| e.span.start);
    Ok(Table { entries })
}
