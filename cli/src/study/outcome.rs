//! The stored result of a run: its numbers and the positions at the compared frames, with all bits.

use std::io::{self, Write};
use std::path::Path;

use nalgebra::Point3;
use serde_json::{Map, Value, json};

/// Positions of all vertices [m], `[muscle][vertex]`.
pub type Positions = Vec<Vec<Point3<f64>>>;

/// The stored result of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Number of computed frames.
    pub frames: usize,
    /// Number of frames of muscles that did not converge.
    pub not_converged: usize,
    /// Place and cause of a stop.
    pub stopped: Option<String>,
    /// True if the run diverged.
    pub diverged: bool,
    /// Numbers by the name of their measure.
    pub numbers: Vec<(String, f64)>,
    /// Positions at each compared frame that was reached.
    pub positions: Vec<(usize, Positions)>,
    /// Least and greatest corner of the muscles in those frames [m].
    pub bounds: Option<[Point3<f64>; 2]>,
    /// A high quantile over the vertices of the mean absolute strain of their edges, in the worst
    /// of those frames.
    pub stretch: f64,
}

impl Outcome {
    /// The result of a run that cannot begin.
    pub fn stopped_by(why: String) -> Self {
        Self {
            frames: 0,
            not_converged: 0,
            stopped: Some(why),
            diverged: false,
            numbers: Vec::new(),
            positions: Vec::new(),
            bounds: None,
            stretch: 0.0,
        }
    }

    /// A number by its name; NaN if it does not exist.
    pub fn number(&self, name: &str) -> f64 {
        self.numbers
            .iter()
            .find(|(known, _)| known == name)
            .map_or(f64::NAN, |(_, value)| *value)
    }

    /// The positions at a frame, if it was reached.
    pub fn at(&self, frame: usize) -> Option<&Positions> {
        self.positions
            .iter()
            .find(|(known, _)| *known == frame)
            .map(|(_, x)| x)
    }

    /// Result for tables.
    pub fn status(&self) -> &'static str {
        match (&self.stopped, self.not_converged) {
            (Some(_), _) if self.diverged => "diverged",
            (Some(_), _) => "stopped",
            (None, 0) => "converged",
            (None, _) => "not converged",
        }
    }

    /// Writes the result with its key.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write(&self, key: &str, w: &mut impl Write) -> io::Result<()> {
        let numbers: Map<String, Value> = self
            .numbers
            .iter()
            .map(|(n, v)| (n.clone(), exact(*v)))
            .collect();
        let frame = |(frame, x): &(usize, Positions)| {
            let positions: Vec<String> = x.iter().map(|x| packed(x)).collect();
            json!({"frame": frame, "positions": positions})
        };
        let all = json!({
            "key": key,
            "frames": self.frames,
            "frames_not_converged": self.not_converged,
            "stopped": self.stopped,
            "diverged": self.diverged,
            "numbers": numbers,
            "bounds": self.bounds.map(|b| packed(&b)),
            "stretch": exact(self.stretch),
            "at": self.positions.iter().map(frame).collect::<Vec<_>>(),
        });
        serde_json::to_writer(w, &all).map_err(io::Error::from)
    }

    /// Reads a result with this key; `None` for a file that does not exist, is damaged, or has
    /// another key.
    pub fn read(path: &Path, key: &str) -> Option<Self> {
        let all: Value = serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()?;
        if all["key"].as_str()? != key {
            return None;
        }
        let whole = |name: &str| all[name].as_u64().and_then(|n| usize::try_from(n).ok());
        let at = |value: &Value| {
            let x: Option<Positions> = value["positions"]
                .as_array()?
                .iter()
                .map(|x| unpacked(x.as_str()?))
                .collect();
            Some((usize::try_from(value["frame"].as_u64()?).ok()?, x?))
        };
        Some(Self {
            frames: whole("frames")?,
            not_converged: whole("frames_not_converged")?,
            stopped: all["stopped"].as_str().map(str::to_owned),
            diverged: all["diverged"].as_bool()?,
            numbers: all["numbers"]
                .as_object()?
                .iter()
                .map(|(n, v)| Some((n.clone(), inexact(v)?)))
                .collect::<Option<_>>()?,
            positions: all["at"]
                .as_array()?
                .iter()
                .map(at)
                .collect::<Option<_>>()?,
            bounds: match &all["bounds"] {
                Value::Null => None,
                packed => Some(unpacked(packed.as_str()?)?.try_into().ok()?),
            },
            stretch: inexact(&all["stretch"])?,
        })
    }
}

/// A number as a text that reads back to the same bits, including NaN and infinity, which JSON
/// lacks.
fn exact(value: f64) -> Value {
    Value::String(format!("{value:?}"))
}

fn inexact(value: &Value) -> Option<f64> {
    value.as_str()?.parse().ok()
}

/// Coordinates as 16 hexadecimal digits of their bits each.
fn packed(points: &[Point3<f64>]) -> String {
    points
        .iter()
        .flat_map(|p| p.coords.iter().copied().collect::<Vec<f64>>())
        .map(|c| format!("{:016x}", c.to_bits()))
        .collect()
}

fn unpacked(text: &str) -> Option<Vec<Point3<f64>>> {
    if !text.is_ascii() || !text.len().is_multiple_of(48) {
        return None;
    }
    let number = |at: usize| {
        Some(f64::from_bits(
            u64::from_str_radix(text.get(at..at + 16)?, 16).ok()?,
        ))
    };
    (0..text.len() / 48)
        .map(|p| {
            Some(Point3::new(
                number(48 * p)?,
                number(48 * p + 16)?,
                number(48 * p + 32)?,
            ))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::testing::Scratch;

    fn outcome() -> Outcome {
        let x = vec![
            vec![
                Point3::new(0.1 + 0.2, -0.0, 5e-324),
                Point3::new(f64::MAX, 1.0 / 3.0, -1e-9),
            ],
            Vec::new(),
        ];
        Outcome {
            frames: 7,
            not_converged: 2,
            stopped: Some("stretch at vertex 3 in frame 7".to_owned()),
            diverged: false,
            numbers: vec![
                ("time_s".to_owned(), 0.1 + 0.2),
                ("volume_error".to_owned(), f64::INFINITY),
            ],
            positions: vec![(0, x.clone()), (7, x)],
            bounds: Some([Point3::origin(), Point3::new(1.0, 2.0, 3.0)]),
            stretch: 0.25,
        }
    }

    #[test]
    fn every_bit_comes_back_and_only_to_its_own_key() {
        let path = Scratch::file("outcome.json");
        let mut bytes = Vec::new();
        outcome().write("the key\n", &mut bytes).unwrap();
        std::fs::write(&path, &bytes).unwrap();
        let back = Outcome::read(&path, "the key\n").unwrap();
        assert_eq!(back, outcome());
        assert!(back.positions[0].1[0][0].y.is_sign_negative());
        assert_eq!(Outcome::read(&path, "the key"), None, "another key");
        // Truncated at any place it is no result.
        for length in (0..bytes.len()).step_by(37) {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert_eq!(Outcome::read(&path, "the key\n"), None, "cut at {length}");
        }
        let text = String::from_utf8(bytes).unwrap();
        for (from, to) in [
            ("\"3f", "\"3g"),
            ("\"frames\":7", "\"frames\":-7"),
            ("\"0.25\"", "\"much\""),
        ] {
            assert!(text.contains(from), "{from}");
            std::fs::write(&path, text.replace(from, to)).unwrap();
            assert_eq!(Outcome::read(&path, "the key\n"), None, "{to}");
        }
    }
}
