//! The file of a geometric muscle: TOML with `radii`, `grow_mults`, `length`, `frame` and the
//! bounds of the length.
//!
//! ```toml
//! unit = "cm"                      # of all lengths; m where it is left out
//! radii = [1.0, 1.8, 2.6, 1.8, 1.0]
//! grow_mults = [0.0, 0.4, 1.0, 0.4, 0.0]
//! length = 20.0
//! frame = [3.0, 25.0, 5.0, 20.0]   # free end, muscle, joint, muscle, free end; may be left out
//! min_part = 0.6                   # shortest and longest, as shares of the length
//! max_part = 1.4
//! insert = 0                       # nodes between each two, on straight lines
//! caps = "out"                     # "in": the hemispheres at the ends belong to the volume
//! ```

use serde::Deserialize;

use super::chain::{Caps, Chain, ChainError, ChainShape};
use super::frame::{Frame, FrameError};

/// A muscle on its frame, with its range of lengths.
#[derive(Clone, Debug, PartialEq)]
pub struct GeometricMuscle {
    /// The chain at rest.
    pub chain: Chain,
    /// The bars; `None` without a frame.
    pub frame: Option<Frame>,
    /// Shortest and longest length \[m\]: the intersection of the ranges of the file, the frame and
    /// the radii.
    pub range: [f64; 2],
    /// The unit of the file \[m\].
    pub unit: f64,
}

/// Error of [`parse`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FileError {
    /// The text is no TOML, a key is unknown or missing, or a value has another type.
    #[error("line {line}, column {column}: {message}")]
    Text {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// The message of the TOML reader.
        message: String,
    },
    /// A value is out of its range.
    #[error("{key}: {message}")]
    Value {
        /// The key.
        key: &'static str,
        /// What is wrong and which values are allowed.
        message: String,
    },
    /// The chain is invalid.
    #[error(transparent)]
    Chain(#[from] ChainError),
    /// The frame is invalid.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

/// Greatest number of nodes of a chain; a greater number in a file is a mistake.
const MOST_NODES: usize = 1_000_000;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    #[serde(default)]
    unit: Option<String>,
    radii: Vec<f64>,
    grow_mults: Vec<f64>,
    length: f64,
    #[serde(default)]
    frame: Option<[f64; 4]>,
    #[serde(default = "least_part")]
    min_part: f64,
    #[serde(default = "most_part")]
    max_part: f64,
    #[serde(default)]
    insert: usize,
    #[serde(default)]
    caps: CapsKey,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum CapsKey {
    #[default]
    Out,
    In,
}

/// The source gives no bounds; this default is ours.
fn least_part() -> f64 {
    0.6
}

fn most_part() -> f64 {
    1.4
}

/// Line and column of a byte, both from 1.
fn place(text: &str, at: usize) -> (usize, usize) {
    let before = text.get(..at).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().unwrap_or("").chars().count() + 1;
    (line, column)
}

/// Reads a muscle from the text of a file.
///
/// # Errors
/// An invalid text or value: names line and column or the key, and what is allowed.
pub fn parse(text: &str) -> Result<GeometricMuscle, FileError> {
    let keys: Keys = toml::from_str(text).map_err(|error| {
        let (line, column) = place(text, error.span().map_or(0, |s| s.start));
        FileError::Text {
            line,
            column,
            message: error.message().trim().to_owned(),
        }
    })?;
    let unit = unit(keys.unit.as_deref().unwrap_or("m"))?;
    let parts = [keys.min_part, keys.max_part];
    if !(parts.iter().all(|p| p.is_finite() && *p > 0.0) && parts[0] <= 1.0 && parts[1] >= 1.0) {
        let message = format!(
            "from {} to {}; the first must be in (0, 1], the second at least 1",
            parts[0], parts[1]
        );
        return Err(FileError::Value {
            key: "min_part, max_part",
            message,
        });
    }
    let nodes = keys
        .radii
        .len()
        .saturating_mul(keys.insert.saturating_add(1));
    if nodes > MOST_NODES {
        let message = format!(
            "{} inserted nodes make {nodes}; at most {MOST_NODES} are allowed",
            keys.insert
        );
        return Err(FileError::Value {
            key: "insert",
            message,
        });
    }
    let caps = match keys.caps {
        CapsKey::Out => Caps::Out,
        CapsKey::In => Caps::In,
    };
    let radii = keys.radii.iter().map(|r| r * unit).collect();
    let shape = ChainShape {
        radii,
        growth: keys.grow_mults,
        length: keys.length * unit,
        caps,
    };
    // Errors of a shape name its nodes as in the file, so the check precedes the insertion.
    Chain::new(shape.clone())?;
    let chain = Chain::new(shape.refined(keys.insert))?;
    let frame = keys
        .frame
        .map(|lengths| Frame::new(lengths.map(|l| l * unit)))
        .transpose()?;
    if let Some(frame) = &frame {
        frame.place(chain.length())?;
    }
    let mut range = parts.map(|part| part * chain.length());
    if let Some([least, most]) = frame.map(|f| f.range()) {
        range = [range[0].max(least), range[1].min(most)];
    }
    range[1] = range[1].min(chain.longest());
    Ok(GeometricMuscle {
        chain,
        frame,
        range,
        unit,
    })
}

fn unit(name: &str) -> Result<f64, FileError> {
    use crate::scene::units::{Dimension, scale};
    scale(name, Dimension::Length).map_err(|_| FileError::Value {
        key: "unit",
        message: format!(
            "`{name}` is no unit of length; known: {}",
            Dimension::Length.known()
        ),
    })
}
