//! The keys of effects and solvers. One declaration of each key defines schema, reader, help and
//! panel.

use std::fmt;

use nalgebra::Vector3;

use super::error::SceneError;
use super::parse::unknown_name;
use super::reader::{Item, Section};
use super::schema::Kind;
use super::units::Dimension;
use crate::constraints::SweepOrder;

/// The permitted range of a number in a scene. Every number must be finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// Any number.
    Any,
    /// Greater than zero.
    Positive,
    /// Zero or greater.
    NotNegative,
    /// From the first to the second number, both included.
    Within(f64, f64),
}

/// The value of a key, in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KeyValue {
    /// A plain number or a quantity.
    Number(f64),
    /// A whole number.
    Whole(u32),
    /// Three quantities.
    Vector(Vector3<f64>),
    /// The order of a sweep.
    Order(SweepOrder),
    /// Some of several names; bit k is set for name k.
    Names(&'static [&'static str], u32),
}

impl fmt::Display for KeyValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Whole(number) => write!(f, "{number}"),
            Self::Vector(v) => write!(f, "[{}, {}, {}]", v.x, v.y, v.z),
            Self::Order(order) => f.write_str(order.name()),
            Self::Names(names, chosen) => {
                let chosen = (0..names.len()).filter(|k| chosen >> k & 1 == 1);
                let quoted: Vec<String> = chosen.map(|k| format!("\"{}\"", names[k])).collect();
                write!(f, "[{}]", quoted.join(", "))
            }
        }
    }
}

/// The type of a key's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KeyKind {
    /// A plain number.
    Number(Limit),
    /// A number with its unit.
    Quantity(Dimension, Limit),
    /// Three numbers with their units.
    Vector(Dimension),
    /// A whole number from 1 to this one.
    Whole(u32),
    /// The name of an order of sweeps.
    Order,
    /// A list of some of these names.
    Names(&'static [&'static str]),
}

/// The range of a slider of a panel, in the unit of the panel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Slider {
    /// Between two numbers, on a linear scale.
    Even(f64, f64),
    /// Between two positive numbers, on a logarithmic scale.
    Factors(f64, f64),
    /// From 1/`span` to `span` times the value at the start. From 0 to `otherwise` if that value is
    /// not positive.
    About {
        /// Greatest factor.
        span: f64,
        /// Upper end if the value at the start is not positive.
        otherwise: f64,
    },
    /// From 0 to `span` times the value at the start, and at least to `least`.
    UpTo {
        /// Greatest factor.
        span: f64,
        /// Least upper end.
        least: f64,
    },
}

/// The declaration of a key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeySpec {
    /// Name in a scene file.
    pub key: &'static str,
    /// Name in a panel.
    pub label: &'static str,
    /// Description in one sentence.
    pub help: &'static str,
    /// Type of the value.
    pub kind: KeyKind,
    /// The value of an absent key; `None` for a required key.
    pub default: Option<KeyValue>,
    /// An example value as in a scene file, for the message about a missing key.
    pub example: &'static str,
    /// The unit of a panel, and the number of these units in one SI unit.
    pub unit: (&'static str, f64),
    /// The slider of a panel.
    pub slider: Slider,
}

impl KeySpec {
    /// A required key with a slider from 0 to 1.
    pub(super) const fn new(key: &'static str, kind: KeyKind, help: &'static str) -> Self {
        Self {
            key,
            label: key,
            help,
            kind,
            default: None,
            example: "",
            unit: ("", 1.0),
            slider: Slider::Even(0.0, 1.0),
        }
    }

    /// The least and the greatest value of a plain number, if it has both.
    pub fn range(&self) -> Option<(f64, f64)> {
        match self.kind {
            KeyKind::Number(Limit::Within(least, greatest)) => Some((least, greatest)),
            _ => None,
        }
    }

    pub(super) const fn labelled(mut self, label: &'static str) -> Self {
        self.label = label;
        self
    }

    pub(super) const fn or(mut self, default: f64) -> Self {
        self.default = Some(KeyValue::Number(default));
        self
    }

    /// All names of the list, if the key is absent.
    pub(super) const fn or_all(mut self) -> Self {
        if let KeyKind::Names(names) = self.kind {
            self.default = Some(KeyValue::Names(names, (1 << names.len()) - 1));
        }
        self
    }

    pub(super) const fn such_as(mut self, example: &'static str) -> Self {
        self.example = example;
        self
    }

    pub(super) const fn over(mut self, slider: Slider) -> Self {
        self.slider = slider;
        self
    }

    /// Shows the value in `unit`; one SI unit has `per_si` of them.
    pub(super) const fn shown_in(mut self, unit: &'static str, per_si: f64) -> Self {
        self.unit = (unit, per_si);
        self
    }

    /// The entry of the schema.
    pub(super) fn schema(&self) -> Kind {
        match self.kind {
            KeyKind::Quantity(..) | KeyKind::Order => Kind::Text,
            KeyKind::Number(_) | KeyKind::Vector(_) | KeyKind::Whole(_) | KeyKind::Names(_) => {
                Kind::Plain
            }
        }
    }

    /// The value in a section, or the `default` if the key is absent.
    ///
    /// # Errors
    /// The value has another type or is outside of the limit; a required key is absent.
    pub(super) fn read(
        &self,
        section: &Section<'_>,
        default: Option<KeyValue>,
    ) -> Result<KeyValue, SceneError> {
        match (section.get(self.key), default) {
            (Some(item), _) => self.value(&item),
            (None, Some(value)) => Ok(value),
            (None, None) => self.value(&section.need(self.key, &self.shown_example())?),
        }
    }

    /// The value of an item.
    ///
    /// # Errors
    /// The value has another type or is outside of the limit.
    pub(super) fn value(&self, item: &Item<'_>) -> Result<KeyValue, SceneError> {
        Ok(match self.kind {
            KeyKind::Number(limit) => KeyValue::Number(item.number(limit)?),
            KeyKind::Quantity(dimension, limit) => {
                KeyValue::Number(item.quantity(dimension, limit)?)
            }
            KeyKind::Vector(dimension) => KeyValue::Vector(item.vector(dimension)?),
            KeyKind::Whole(most) => KeyValue::Whole(item.whole(1, most)?),
            KeyKind::Order => KeyValue::Order(order(item)?),
            KeyKind::Names(names) => KeyValue::Names(names, some_of(names, item)?),
        })
    }

    fn shown_example(&self) -> String {
        match self.kind {
            KeyKind::Quantity(dimension, _) if self.example.is_empty() => {
                format!("\"{}\"", dimension.example())
            }
            _ => self.example.to_owned(),
        }
    }
}

/// The values of several keys of a section.
///
/// # Errors
/// The error of the first key that cannot be read.
pub(super) fn read(keys: &[KeySpec], section: &Section<'_>) -> Result<Vec<KeyValue>, SceneError> {
    keys.iter()
        .map(|key| key.read(section, key.default))
        .collect()
}

fn some_of(names: &'static [&'static str], item: &Item<'_>) -> Result<u32, SceneError> {
    let mut chosen = 0;
    for item in item.list("a list of names")? {
        let name = item.text(names.first().unwrap_or(&""))?;
        match names.iter().position(|known| *known == name) {
            Some(k) => chosen |= 1 << k,
            None => return item.fail(unknown_name("surface", name, names.iter().copied())),
        }
    }
    Ok(chosen)
}

fn order(item: &Item<'_>) -> Result<SweepOrder, SceneError> {
    let name = item.text("coloured")?;
    let names = SweepOrder::NAMES.iter().map(|(known, _)| *known);
    match SweepOrder::NAMES.iter().find(|(known, _)| *known == name) {
        Some(&(_, order)) => Ok(order),
        None => item.fail(unknown_name("order", name, names)),
    }
}
