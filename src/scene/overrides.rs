//! Changes of a scene from the command line, `--set path.key=value`, applied to the TOML before the
//! checks.
//!
//! Every key has a path. An element of a list is its index from 0, its `name`, or `*` for all:
//! `muscle.0.edge_length=3 mm`, `muscle.biceps.edge_length=3 mm`,
//! `muscle.*.material.density=1 g/cm3`. The only element of a list needs no name:
//! `implant.volume=100cc`. A path that begins with a key of `effects`, of the solver in use or of
//! `solver` can omit the part before it: `contact.friction=0.3`, `substeps=40`. The value is TOML,
//! but texts need no quotes. `none` or `off` removes a key, a whole section or an element of a list,
//! `on` adds a section without required keys, and `solver=pbd` changes the solver.

use super::effects::EffectSpec;
use super::error::{SceneError, SceneProblem};
use super::reader::unknown_key;
use super::schema::{Kind, ROOT, Schema};
use super::solvers::{SOLVERS, SolverSpec};
use super::tree::{self, Entry, Node, Sources, Span, Table, Value};
use crate::spelling::{listed, nearest, shown};

/// One segment of a path.
struct Segment {
    text: String,
    span: Span,
    /// True for a quoted segment, which is neither a number nor `*`.
    quoted: bool,
}

/// An override in progress.
struct Change<'a> {
    sources: &'a Sources,
    whole: Span,
    value: &'a str,
    value_start: usize,
}

type Done = Result<(), SceneError>;

/// Applies one override `path.key=value` to the document.
pub(super) fn apply(text: &str, document: &mut Node, sources: &mut Sources) -> Done {
    let start = sources.add(&format!("change {}", shown(text)), text);
    let whole = start..start + text.len();
    let sources = &*sources;
    let malformed = |message: &str| {
        let hint = "write PATH=VALUE, for example effects.contact.friction=0.3".to_owned();
        SceneError::new(
            SceneProblem::Override {
                message: message.to_owned(),
                hint,
            },
            "",
            &whole,
            sources,
        )
    };
    let equals = equals_sign(text).ok_or_else(|| malformed("there is no `=`"))?;
    let path = segments(&text[..equals], start).ok_or_else(|| malformed("the path is not one"))?;
    let value = text[equals + 1..].trim_start();
    let value_start = start + text.len() - value.len();
    let value = value.trim_end();
    if value.is_empty() {
        return Err(malformed("there is no value"));
    }
    let Value::Table(root) = &mut document.value else {
        return Ok(());
    };
    let path = in_full(path, root);
    Change {
        sources,
        whole: whole.clone(),
        value,
        value_start,
    }
    .table(root, &ROOT, &path, "")
}

/// The first `=` outside quotes.
fn equals_sign(text: &str) -> Option<usize> {
    let mut quote = None;
    for (at, c) in text.char_indices() {
        match (quote, c) {
            (None, '=') => return Some(at),
            (None, '"' | '\'') => quote = Some(c),
            (Some(open), _) if open == c => quote = None,
            _ => {}
        }
    }
    None
}

/// Splits a path at its dots outside quotes; `None` for an empty segment or an open quote.
fn segments(path: &str, start: usize) -> Option<Vec<Segment>> {
    let mut out = Vec::new();
    let mut quote = None;
    let mut begin = 0;
    for (at, c) in path.char_indices().chain([(path.len(), '.')]) {
        match (quote, c) {
            (None, '.') => {
                out.push(segment(path.get(begin..at)?, start + begin)?);
                begin = at + 1;
            }
            (None, '"' | '\'') => quote = Some(c),
            (Some(open), _) if open == c && at < path.len() => quote = None,
            _ => {}
        }
    }
    quote.is_none().then_some(out)
}

fn segment(written: &str, start: usize) -> Option<Segment> {
    let trimmed = written.trim();
    let start = start + (written.len() - written.trim_start().len());
    let span = start..start + trimmed.len();
    let inner = ['"', '\'']
        .iter()
        .find_map(|&q| trimmed.strip_prefix(q)?.strip_suffix(q));
    let text = inner.unwrap_or(trimmed).to_owned();
    (!text.is_empty()).then_some(Segment {
        text,
        span,
        quoted: inner.is_some(),
    })
}

/// Completes an abbreviated path.
fn in_full(path: Vec<Segment>, root: &Table) -> Vec<Segment> {
    let Some(first) = path.first() else {
        return path;
    };
    let span = first.span.start..first.span.start;
    let put = |names: &[&str], path: Vec<Segment>| {
        let before = names.iter().map(|n| Segment {
            text: (*n).to_owned(),
            span: span.clone(),
            quoted: false,
        });
        before.chain(path).collect()
    };
    let key = first.text.as_str();
    if ROOT.get(key).is_some() {
        return path;
    }
    if EffectSpec::named(key).is_some() {
        return put(&["effects"], path);
    }
    if SolverSpec::named(key).is_some() {
        return put(&["solver"], path);
    }
    let in_use = match root.get("solver").map(|e| &e.node.value) {
        Some(Value::Table(solver)) => SOLVERS
            .iter()
            .find(|spec| solver.get(spec.key).is_some())
            .unwrap_or(&SOLVERS[0]),
        _ => &SOLVERS[0],
    };
    if in_use.schema.get(key).is_some() {
        put(&["solver", in_use.key], path)
    } else {
        path
    }
}

impl Change<'_> {
    fn fail(&self, problem: SceneProblem, key: &str, span: &Span) -> Done {
        Err(SceneError::new(problem, key, span, self.sources))
    }

    fn nowhere(&self, message: String, hint: String, key: &str, span: &Span) -> Done {
        self.fail(SceneProblem::Override { message, hint }, key, span)
    }

    /// Follows the path into a table.
    fn table(&self, table: &mut Table, schema: &Schema, path: &[Segment], above: &str) -> Done {
        let Some((first, rest)) = path.split_first() else {
            return Ok(());
        };
        let key = first.text.as_str();
        let Some(kind) = schema.get(key) else {
            return self.fail(unknown_key(key, schema), above, &first.span);
        };
        let here = if above.is_empty() {
            key.to_owned()
        } else {
            format!("{above}.{key}")
        };
        if rest.is_empty() {
            return self.put(table, first, kind, &here);
        }
        match kind {
            Kind::Table(schema) => {
                let node = match table.get_mut(key) {
                    Some(entry) => &mut entry.node,
                    None => table.set(key, first.span.clone(), self.empty_table()),
                };
                match &mut node.value {
                    Value::Table(table) => self.table(table, schema, rest, &here),
                    // The reader reports the error.
                    _ => Ok(()),
                }
            }
            Kind::List(schema) => self.list(table.get_mut(key), schema, rest, &here, &first.span),
            Kind::Text | Kind::Plain => {
                let span = &rest[0].span;
                if let Some(entry) = table.get_mut(key)
                    && let Value::List(list) = &mut entry.node.value
                    && rest.len() == 1
                {
                    return self.element(list, &rest[0], &here);
                }
                let message = format!("`{here}` is a single value; nothing is below it");
                self.nowhere(message, format!("write {here}=VALUE"), &here, span)
            }
        }
    }

    /// Follows the path into one element of a list, or into all elements.
    fn list(
        &self,
        entry: Option<&mut Entry>,
        schema: &Schema,
        path: &[Segment],
        here: &str,
        span: &Span,
    ) -> Done {
        let Some((first, rest)) = path.split_first() else {
            return Ok(());
        };
        let Some(Node {
            value: Value::List(list),
            ..
        }) = entry.map(|e| &mut e.node)
        else {
            return self.nowhere(
                format!("the scene has no `{here}`"),
                format!("add [[{here}]] to it"),
                here,
                span,
            );
        };
        let only = list.len() == 1 && !first.quoted && schema.get(&first.text).is_some();
        // The name of an element takes precedence over a key of the same name.
        if only
            && list.iter().all(|node| name(node) != Some(&first.text))
            && let Some(Node {
                value: Value::Table(table),
                ..
            }) = list.first_mut()
        {
            return self.table(table, schema, path, &format!("{here}.0"));
        }
        if rest.is_empty() {
            let number = first.text == "*" || first.text.parse::<usize>().is_ok();
            if list.len() == 1
                && !number
                && !first.quoted
                && list.iter().all(|node| name(node) != Some(&first.text))
            {
                return self.fail(unknown_key(&first.text, schema), here, &first.span);
            }
            if matches!(self.value, "none" | "off") {
                return self.remove(list, first, here);
            }
            let message = format!("`{here}.{}` is a section, not a value", shown(&first.text));
            let hint = format!("name one of its keys: {}", schema.known());
            return self.nowhere(message, hint, here, &first.span);
        }
        let chosen = match chosen(list, first) {
            Ok(chosen) => chosen,
            Err(problem) => return self.fail(problem, here, &first.span),
        };
        for index in chosen {
            if let Some(Node {
                value: Value::Table(table),
                ..
            }) = list.get_mut(index)
            {
                self.table(table, schema, rest, &format!("{here}.{index}"))?;
            }
        }
        Ok(())
    }

    /// Removes one element of a list, or all of them.
    fn remove(&self, list: &mut Vec<Node>, segment: &Segment, here: &str) -> Done {
        match chosen(list, segment) {
            // The last index first: the others keep theirs.
            Ok(chosen) => chosen
                .into_iter()
                .rev()
                .for_each(|index| drop(list.remove(index))),
            Err(problem) => return self.fail(problem, here, &segment.span),
        }
        Ok(())
    }

    /// Sets one element of a list of plain values, or all of them.
    fn element(&self, list: &mut [Node], segment: &Segment, here: &str) -> Done {
        let chosen = match chosen(list, segment) {
            Ok(chosen) => chosen,
            Err(problem) => return self.fail(problem, here, &segment.span),
        };
        for index in chosen {
            list[index] = self.node(Kind::Plain)?;
        }
        Ok(())
    }

    /// Sets or removes the value at the end of the path.
    fn put(&self, table: &mut Table, segment: &Segment, kind: Kind, here: &str) -> Done {
        let key = segment.text.as_str();
        let span = segment.span.clone();
        match (kind, self.value) {
            (_, "none" | "off") => table.remove(key),
            (Kind::Table(schema), "on") if !matches!(schema, Schema::Solvers) => {
                if table.get(key).is_none() {
                    table.set(key, span, self.empty_table());
                }
            }
            (Kind::Table(Schema::Solvers), name) if SolverSpec::named(name).is_some() => {
                let mut inner = Table::default();
                inner.set(name, span.clone(), self.empty_table());
                table.set(
                    key,
                    span,
                    Node {
                        span: self.value_span(),
                        value: Value::Table(inner),
                    },
                );
            }
            _ => {
                let node = self.node(kind)?;
                // The values of a section or a list are set one by one, so that a typing error
                // cannot drop the others.
                if matches!(kind, Kind::Table(_)) && !matches!(node.value, Value::Table(_)) {
                    let message = format!("`{here}` is a section, not a value");
                    let hint = "give a key below it, or `on`, or `off` to remove it".to_owned();
                    return self.nowhere(message, hint, here, &segment.span);
                }
                table.set(key, span, node);
            }
        }
        Ok(())
    }

    fn value_span(&self) -> Span {
        self.value_start..self.value_start + self.value.len()
    }

    fn empty_table(&self) -> Node {
        Node {
            span: self.whole.clone(),
            value: Value::Table(Table::default()),
        }
    }

    /// The value: TOML, or a text without quotes.
    fn node(&self, kind: Kind) -> Result<Node, SceneError> {
        let plain = || Node {
            span: self.value_span(),
            value: Value::Text(self.value.to_owned()),
        };
        let quoted = self.value.starts_with(['"', '\'']);
        // A value such as `7` or `true` is a text where a text is expected. A quantity without a
        // unit stays a number there, too, and is rejected for its unit.
        if matches!(kind, Kind::Text) && !quoted {
            return Ok(plain());
        }
        Ok(tree::value(self.value, self.value_start, self.sources)?.unwrap_or_else(plain))
    }
}

/// Indices of the elements of a segment.
fn chosen(list: &[Node], segment: &Segment) -> Result<Vec<usize>, SceneProblem> {
    let text = segment.text.as_str();
    if !segment.quoted {
        if text == "*" {
            return Ok((0..list.len()).collect());
        }
        if let Ok(index) = text.parse::<usize>() {
            if index < list.len() {
                return Ok(vec![index]);
            }
            return Err(SceneProblem::OutOfRange {
                found: format!("the number {index}"),
                allowed: format!("a number below {}, they are counted from 0", list.len()),
            });
        }
    }
    let names: Vec<Option<&str>> = list.iter().map(name).collect();
    match names.iter().position(|n| *n == Some(text)) {
        Some(index) => Ok(vec![index]),
        None => Err(SceneProblem::UnknownName {
            what: "element",
            name: shown(text),
            nearest: nearest(text, names.iter().copied().flatten()).map(shown),
            known: listed(names.into_iter().flatten()),
        }),
    }
}

fn name(node: &Node) -> Option<&str> {
    match &node.value {
        Value::Table(table) => match &table.get("name")?.node.value {
            Value::Text(name) => Some(name),
            _ => None,
        },
        _ => None,
    }
}
