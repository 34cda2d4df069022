//! Reads checked values from the tree; each invalid value becomes an error with its place and key.

use nalgebra::{Unit, Vector3};

use super::error::{Gathered, SceneError, SceneProblem};
use super::interval::{Intervals, has_interval};
pub(super) use super::keys::Limit;
use super::parse::Surroundings;
use super::schema::{Kind, Schema};
use super::tree::{Entry, Node, Sources, Span, Table, Value};
use super::units::{self, Dimension};
use crate::spelling::{nearest, shown};

/// Context of the reader.
#[derive(Clone, Copy)]
pub(super) struct Context<'a> {
    pub(super) sources: &'a Sources,
    pub(super) surroundings: &'a Surroundings<'a>,
    pub(super) intervals: &'a Intervals<'a>,
}

/// A value with its key and context.
#[derive(Clone)]
pub(super) struct Item<'a> {
    pub(super) context: Context<'a>,
    pub(super) node: &'a Node,
    pub(super) key: String,
}

/// A table whose keys are all known.
#[derive(Clone)]
pub(super) struct Section<'a> {
    context: Context<'a>,
    table: &'a Table,
    schema: &'static Schema,
    span: Span,
    pub(super) key: String,
}

impl Limit {
    pub(super) fn allows(self, value: f64) -> bool {
        match self {
            Self::Any => value.is_finite(),
            Self::Positive => value.is_finite() && value > 0.0,
            Self::NotNegative => value.is_finite() && value >= 0.0,
            Self::Within(low, high) => (low..=high).contains(&value),
        }
    }

    pub(super) fn describe(self, what: &str, unit: &str) -> String {
        match self {
            Self::Any => format!("a finite {what}"),
            Self::Positive => format!("{} greater than zero", with_article(what)),
            Self::NotNegative => format!("{} of at least zero", with_article(what)),
            Self::Within(low, high) => {
                let range = format!("{} from {low} to {high} {unit}", with_article(what));
                range.trim_end().to_owned()
            }
        }
    }
}

/// A noun with its indefinite article: an area, a length.
fn with_article(noun: &str) -> String {
    let article = if noun.starts_with(['a', 'e', 'i', 'o']) {
        "an"
    } else {
        "a"
    };
    format!("{article} {noun}")
}

type Read<T> = Result<T, SceneError>;

impl<'a> Item<'a> {
    /// An error at this value.
    pub(super) fn fail<T>(&self, problem: SceneProblem) -> Read<T> {
        Err(self.error(problem))
    }

    pub(super) fn error(&self, problem: SceneProblem) -> SceneError {
        SceneError::new(problem, &self.key, &self.node.span, self.context.sources)
    }

    fn wrong_type<T>(&self, expected: impl Into<String>) -> Read<T> {
        self.fail(SceneProblem::WrongType {
            expected: expected.into(),
            found: self.node.value.kind().to_owned(),
        })
    }

    pub(super) fn is_text(&self) -> bool {
        matches!(self.node.value, Value::Text(_))
    }

    pub(super) fn text(&self, example: &str) -> Read<&'a str> {
        match &self.node.value {
            Value::Text(text) => Ok(text),
            _ => self.wrong_type(format!("a text such as \"{example}\"")),
        }
    }

    /// A plain number within a limit.
    pub(super) fn number(&self, limit: Limit) -> Read<f64> {
        let value = match &self.node.value {
            // Beyond 2^53 the nearest number is sufficient.
            Value::Integer(number) => *number as f64,
            Value::Float(number) => *number,
            Value::Text(text) if has_interval(text) => {
                return self.quantity(Dimension::Ratio, limit);
            }
            _ => return self.wrong_type(limit.describe("number", "")),
        };
        self.limited(value, limit, "number", "")
    }

    fn limited(&self, value: f64, limit: Limit, what: &str, unit: &str) -> Read<f64> {
        if limit.allows(value) {
            // Minus zero would appear as `-0` in reports and change the sign of products.
            return Ok(value + 0.0);
        }
        let found = match &self.node.value {
            Value::Text(text) => format!("`{}`", shown(text)),
            _ => format!("`{value}`"),
        };
        self.fail(SceneProblem::OutOfRange {
            found,
            allowed: limit.describe(what, unit),
        })
    }

    pub(super) fn flag(&self) -> Read<bool> {
        match self.node.value {
            Value::Boolean(flag) => Ok(flag),
            _ => self.wrong_type("true or false"),
        }
    }

    pub(super) fn whole(&self, low: u32, high: u32) -> Read<u32> {
        let allowed = format!("a whole number from {low} to {high}");
        match self.node.value {
            Value::Integer(number) => match u32::try_from(number)
                .ok()
                .filter(|n| (low..=high).contains(n))
            {
                Some(number) => Ok(number),
                None => self.fail(SceneProblem::out_of_range(&number.to_string(), &allowed)),
            },
            _ => self.wrong_type(allowed),
        }
    }

    /// A quantity with its unit, within a limit, in SI units.
    pub(super) fn quantity(&self, dimension: Dimension, limit: Limit) -> Read<f64> {
        let number = match &self.node.value {
            Value::Text(text) => {
                let intervals = self.context.intervals;
                let value = intervals.read(&self.key, text, dimension);
                let value = value.map_err(|e| self.error(e.into()))?;
                return self.limited(value, limit, &dimension.to_string(), &dimension.base());
            }
            Value::Integer(number) => number.to_string(),
            Value::Float(number) => number.to_string(),
            _ => {
                let named = with_article(&dimension.to_string());
                let example = dimension.example();
                return self.wrong_type(format!("{named} such as \"{example}\""));
            }
        };
        if dimension == Dimension::Ratio {
            return self.number(limit);
        }
        self.fail(units::UnitError::Bare { number, dimension }.into())
    }

    /// Three quantities.
    pub(super) fn vector(&self, dimension: Dimension) -> Read<Vector3<f64>> {
        let example = dimension.example();
        let [x, y, z] = self.three(&format!(
            "a list of three: [\"{example}\", \"{example}\", \"{example}\"]"
        ))?;
        Ok(Vector3::new(
            x.quantity(dimension, Limit::Any)?,
            y.quantity(dimension, Limit::Any)?,
            z.quantity(dimension, Limit::Any)?,
        ))
    }

    /// A direction of three plain numbers, of any positive length.
    pub(super) fn direction(&self) -> Read<Unit<Vector3<f64>>> {
        let [x, y, z] = self.three("a list of three numbers such as [-1, 0, 0]")?;
        let vector = Vector3::new(
            x.number(Limit::Any)?,
            y.number(Limit::Any)?,
            z.number(Limit::Any)?,
        );
        let largest = vector.amax();
        if largest == 0.0 {
            return self.fail(SceneProblem::OutOfRange {
                found: "`[0, 0, 0]`".to_owned(),
                allowed: "a direction, one of whose numbers is not zero".to_owned(),
            });
        }
        // Scaled first, because squares of numbers above 1e154 are infinite.
        Ok(Unit::new_normalize(vector / largest))
    }

    fn three(&self, expected: &str) -> Read<[Self; 3]> {
        let found = match &self.node.value {
            Value::List(list) => match <[Self; 3]>::try_from(self.elements(list)) {
                Ok(three) => return Ok(three),
                Err(_) => format!("a list of {}", list.len()),
            },
            other => other.kind().to_owned(),
        };
        self.fail(SceneProblem::WrongType {
            expected: expected.to_owned(),
            found,
        })
    }

    fn elements(&self, list: &'a [Node]) -> Vec<Self> {
        let item = |(at, node)| Item {
            context: self.context,
            node,
            key: format!("{}.{at}", self.key),
        };
        list.iter().enumerate().map(item).collect()
    }

    /// The elements of a list.
    pub(super) fn list(&self, expected: &str) -> Read<Vec<Self>> {
        match &self.node.value {
            Value::List(list) => Ok(self.elements(list)),
            _ => self.wrong_type(expected),
        }
    }

    /// Vertex indices: at least one, without duplicates.
    pub(super) fn vertices(&self) -> Read<Vec<u32>> {
        let items = self.list("a list of vertices such as [0, 1]")?;
        if items.is_empty() {
            return self.fail(SceneProblem::EmptyList {
                expected: "at least one vertex".to_owned(),
            });
        }
        let mut seen = std::collections::HashSet::new();
        let mut vertices = Vec::with_capacity(items.len());
        for item in items {
            let vertex = item.whole(0, u32::MAX)?;
            if !seen.insert(vertex) {
                return item.fail(SceneProblem::out_of_range(
                    &vertex.to_string(),
                    "each vertex once",
                ));
            }
            vertices.push(vertex);
        }
        Ok(vertices)
    }

    /// A table, after a check of all its keys against the schema.
    pub(super) fn section(&self, schema: &'static Schema) -> Read<Section<'a>> {
        let Value::Table(table) = &self.node.value else {
            return self.wrong_type(format!("a section [{}]", self.key));
        };
        let section = Section {
            context: self.context,
            table,
            schema,
            span: self.node.span.clone(),
            key: self.key.clone(),
        };
        let mut all = Gathered::default();
        let known = |entry: &&Entry| schema.get(&entry.key).is_some();
        for entry in table.entries.iter().filter(|entry| !known(entry)) {
            let (problem, of) = (unknown_key(&entry.key, schema), self.context.sources);
            all.keep::<()>(Err(SceneError::new(problem, &self.key, &entry.span, of)));
        }
        all.end()?;
        Ok(section)
    }
}

/// The error for an unknown key of a table.
pub(super) fn unknown_key(key: &str, schema: &Schema) -> SceneProblem {
    let names = schema.names();
    let known = if names.is_empty() {
        "none".to_owned()
    } else {
        schema.known()
    };
    SceneProblem::UnknownKey {
        key: shown(key),
        nearest: nearest(key, names).map(str::to_owned),
        known,
    }
}

impl<'a> Section<'a> {
    /// An error at a key of the table, or of the table as a whole without it.
    pub(super) fn error_at(&self, key: &str, problem: SceneProblem) -> SceneError {
        match self.get(key) {
            Some(item) => item.error(problem),
            None => SceneError::new(problem, &self.key, &self.span, self.context.sources),
        }
    }

    /// An error of the table as a whole.
    pub(super) fn fail<T>(&self, problem: SceneProblem) -> Read<T> {
        Err(SceneError::new(
            problem,
            &self.key,
            &self.span,
            self.context.sources,
        ))
    }

    fn below(&self, key: &str) -> String {
        if self.key.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.key)
        }
    }

    fn item(&self, entry: &'a Entry) -> Item<'a> {
        Item {
            context: self.context,
            node: &entry.node,
            key: self.below(&entry.key),
        }
    }

    /// The value at an optional key.
    pub(super) fn get(&self, key: &str) -> Option<Item<'a>> {
        // A key outside the schema would always be absent, since `section` rejects it.
        debug_assert!(self.schema.get(key).is_some(), "{key} is not in the schema");
        self.table.get(key).map(|entry| self.item(entry))
    }

    /// The value at a required key; `example` is the text to add.
    pub(super) fn need(&self, key: &str, example: &str) -> Read<Item<'a>> {
        match self.get(key) {
            Some(item) => Ok(item),
            None => self.fail(SceneProblem::missing(key, format!("`{key} = {example}`"))),
        }
    }

    /// All values, in the order of the text.
    pub(super) fn items(&self) -> impl Iterator<Item = (&'a str, Item<'a>)> {
        let entries = self.table.entries.iter();
        entries.map(|entry| (entry.key.as_str(), self.item(entry)))
    }

    /// The section at an optional key.
    pub(super) fn section(&self, key: &str) -> Read<Option<Section<'a>>> {
        match (self.get(key), self.schema.get(key)) {
            (Some(item), Some(Kind::Table(schema))) => item.section(schema).map(Some),
            _ => Ok(None),
        }
    }

    /// The sections of a list `[[key]]`, none if it is absent.
    pub(super) fn sections(&self, key: &str) -> Read<Vec<Section<'a>>> {
        self.each_section(key).into_iter().collect()
    }

    /// The same as [`Self::sections`], each with its own error.
    pub(super) fn each_section(&self, key: &str) -> Vec<Read<Section<'a>>> {
        match (self.get(key), self.schema.get(key)) {
            (Some(item), Some(Kind::List(schema))) => {
                let expected = format!("a list of sections [[{}]]", self.below(key));
                match item.list(&expected) {
                    Ok(items) => items.iter().map(|i| i.section(schema)).collect(),
                    Err(error) => vec![Err(error)],
                }
            }
            _ => Vec::new(),
        }
    }

    /// A quantity, or its default.
    pub(super) fn quantity_or(
        &self,
        key: &str,
        dimension: Dimension,
        limit: Limit,
        default: f64,
    ) -> Read<f64> {
        self.get(key)
            .map_or(Ok(default), |item| item.quantity(dimension, limit))
    }

    /// A required quantity.
    pub(super) fn need_quantity(&self, key: &str, dimension: Dimension, limit: Limit) -> Read<f64> {
        self.need(key, &format!("\"{}\"", dimension.example()))?
            .quantity(dimension, limit)
    }

    /// A plain number, or its default.
    pub(super) fn number_or(&self, key: &str, limit: Limit, default: f64) -> Read<f64> {
        self.get(key).map_or(Ok(default), |item| item.number(limit))
    }

    /// Rejects the second of two keys that exclude each other.
    pub(super) fn exclusive(&self, first: &str, second: &str) -> Read<()> {
        match (self.get(first), self.get(second)) {
            (Some(_), Some(item)) => item.fail(SceneProblem::Conflict {
                first: first.to_owned(),
                second: second.to_owned(),
            }),
            _ => Ok(()),
        }
    }
}
