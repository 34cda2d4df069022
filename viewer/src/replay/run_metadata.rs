//! Metadata of a run beside its frames: `measures.csv` and `summary.json`.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde_json::Value;

/// Greatest size of a table or summary [bytes].
const MOST_BYTES: u64 = 1 << 28;

/// Greatest number of notes from the run.
const MOST_NOTES: usize = 50;

/// Kind of the scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) enum Kind {
    /// Muscles, or unknown.
    #[default]
    Muscles,
    /// Skin with a name, over implants.
    Skin(String),
    /// A lattice.
    Lattice,
}

/// Measures of one body in one frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Measured {
    /// Index of the body in [`RunMetadata::bodies`].
    pub body: usize,
    /// Volume over its target, minus 1.
    pub volume_error: Option<f64>,
    /// Greatest depth [m].
    pub depth: Option<f64>,
}

/// Metadata of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct RunMetadata {
    pub kind: Kind,
    /// Names of the bodies in the table.
    pub bodies: Vec<String>,
    /// Measures by frame.
    pub frames: HashMap<usize, Vec<Measured>>,
    /// Notes for the user.
    pub notes: Vec<String>,
    /// Muscles with the effects that did not run.
    left_out: HashSet<(String, String)>,
}

impl RunMetadata {
    /// Reads the metadata in a folder; a file that cannot be read gives a note.
    pub fn read(folder: &Path) -> Self {
        let mut metadata = Self::default();
        match contents(&folder.join("summary.json")) {
            Ok(Some(bytes)) => match serde_json::from_slice::<Value>(&bytes) {
                Ok(summary) => metadata.take(&summary),
                Err(error) => metadata
                    .notes
                    .push(format!("summary.json: {error}; its notes are left out")),
            },
            Ok(None) => {}
            Err(error) => metadata.notes.push(format!(
                "summary.json cannot be read: {error}; its notes are left out"
            )),
        }
        match contents(&folder.join("measures.csv")) {
            Ok(Some(bytes)) => {
                if let Err(error) = metadata.take_measures(&bytes) {
                    (metadata.bodies, metadata.frames) = Default::default();
                    metadata
                        .notes
                        .push(format!("measures.csv: {error}; its numbers are left out"));
                }
            }
            Ok(None) => {}
            Err(error) => metadata.notes.push(format!(
                "measures.csv cannot be read: {error}; its numbers are left out"
            )),
        }
        metadata
    }

    fn take(&mut self, summary: &Value) {
        let skin = ["skin", "implant"].map(|kind| summary[kind]["name"].as_str());
        if let Some(name) = skin.into_iter().flatten().next() {
            self.kind = Kind::Skin(name.to_owned());
        } else if !summary["lattice"].is_null() {
            self.kind = Kind::Lattice;
        }
        if summary["interrupted"] == true {
            let of = |key: &str| {
                summary[key]
                    .as_u64()
                    .map_or("?".to_owned(), |n| n.to_string())
            };
            self.notes.push(format!(
                "the run was interrupted at frame {} of {}",
                of("frames"),
                of("frames_in_scene")
            ));
        }
        for row in summary["effects"]["left_out"]
            .as_array()
            .into_iter()
            .flatten()
        {
            if let (Some(part), Some(effect)) = (row["part"].as_str(), row["effect"].as_str()) {
                self.left_out.insert((part.to_owned(), effect.to_owned()));
            }
        }
        let notes = summary["notes"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str);
        self.notes.extend(notes.take(MOST_NOTES).map(str::to_owned));
    }

    /// Reads the known columns; a table without frames has none.
    fn take_measures(&mut self, bytes: &[u8]) -> Result<(), String> {
        let mut table = csv::Reader::from_reader(bytes);
        let heads = table.headers().map_err(|e| e.to_string())?.clone();
        let Some(frame) = column(&heads, "frame") else {
            return Ok(());
        };
        let body = column(&heads, "muscle").or_else(|| column(&heads, "part"));
        let numbers = ["volume_error", "penetration_m"].map(|name| column(&heads, name));
        if numbers.iter().all(Option::is_none) {
            return Ok(());
        }
        for row in table.records() {
            let row = row.map_err(|e| e.to_string())?;
            let line = row.position().map_or(0, csv::Position::line);
            let word = |column: usize| row.get(column).unwrap_or_default();
            let wrong =
                |column: usize| format!("line {line}: `{}` is no {}", word(column), &heads[column]);
            let number = word(frame).parse::<usize>().map_err(|_| wrong(frame))?;
            let mut read = [None; 2];
            for (value, column) in read.iter_mut().zip(numbers) {
                if let Some(column) = column {
                    *value = Some(word(column).parse::<f64>().map_err(|_| wrong(column))?);
                }
            }
            let name = body.map_or("", word);
            // The table has zeros for values without a measurement.
            let [volume_error, depth] = [("volume", read[0]), ("contact", read[1])]
                .map(|(effect, value)| value.filter(|_| !self.does_without(name, effect)));
            let body = self.body(name);
            self.frames.entry(number).or_default().push(Measured {
                body,
                volume_error,
                depth,
            });
        }
        Ok(())
    }

    fn does_without(&self, muscle: &str, effect: &str) -> bool {
        // Notes on all muscles have no name.
        ["", muscle].iter().any(|name| {
            self.left_out
                .contains(&((*name).to_owned(), effect.to_owned()))
        })
    }

    fn body(&mut self, name: &str) -> usize {
        self.bodies
            .iter()
            .position(|known| known == name)
            .unwrap_or_else(|| {
                self.bodies.push(name.to_owned());
                self.bodies.len() - 1
            })
    }
}

/// The number of a column of a table.
fn column(heads: &csv::StringRecord, name: &str) -> Option<usize> {
    heads.iter().position(|head| head == name)
}

/// The bytes of a file; `None` if it does not exist.
fn contents(path: &Path) -> Result<Option<Vec<u8>>, String> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error.to_string()),
    };
    let mut bytes = Vec::new();
    file.take(MOST_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MOST_BYTES {
        Err(format!("more than {MOST_BYTES} bytes"))
    } else {
        Ok(Some(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measures(text: &str) -> (RunMetadata, Result<(), String>) {
        let mut metadata = RunMetadata::default();
        let effects =
            r#"{"effects": {"left_out": [{"part": "a,b", "effect": "volume"}, {"part": "c"}, 3]}}"#;
        metadata.take(&serde_json::from_str(effects).unwrap_or_default());
        let result = metadata.take_measures(text.as_bytes());
        (metadata, result)
    }

    #[test]
    fn measures_are_found_by_frame_and_body() {
        let table = "frame,time_s,muscle,volume_error,penetration_m\n0,0,\"a,b\",0.0,1e-3\n0,0,c,1e-7,0\n7,1,c,-2e-7,0.5\n";
        let (metadata, result) = measures(table);
        assert_eq!(
            (result, metadata.bodies.as_slice()),
            (Ok(()), &["a,b".to_owned(), "c".to_owned()][..])
        );
        assert_eq!(
            metadata.frames[&7],
            [Measured {
                body: 1,
                volume_error: Some(-2e-7),
                depth: Some(0.5)
            }]
        );
        assert_eq!(
            metadata.frames[&0][0],
            Measured {
                body: 0,
                volume_error: None,
                depth: Some(1e-3)
            },
            "none was kept"
        );
        // Other commands write other tables.
        for other in ["step,time_s\n1,2\n", "frame,moved_m\n1,2\n", ""] {
            let (metadata, result) = measures(other);
            assert_eq!(
                (metadata.frames.len(), metadata.bodies.len(), result),
                (0, 0, Ok(())),
                "{other}"
            );
        }
        let (skin, _) = measures("frame,part,penetration_m\n1,left,2\n");
        assert_eq!(
            skin.frames[&1],
            [Measured {
                body: 0,
                volume_error: None,
                depth: Some(2.0)
            }]
        );
    }

    #[test]
    fn a_damaged_table_is_reported_with_its_line() {
        let head = "frame,muscle,volume_error\n";
        for (row, says) in [
            ("0,a,0.5\nx,a,1\n", "line 3: `x` is no frame"),
            ("0,a,0.5\n1,a,one\n", "line 3: `one` is no volume_error"),
            ("0,a\n", "found record with 2 fields"),
            ("-1,a,1\n", "line 2: `-1` is no frame"),
        ] {
            let error = measures(&format!("{head}{row}")).1.expect_err(row);
            assert!(error.contains(says), "{error}");
        }
    }

    #[test]
    fn summaries_tell_what_was_run() {
        let of = |text: &str| {
            let mut metadata = RunMetadata::default();
            metadata.take(&serde_json::from_str(text).unwrap_or_default());
            metadata
        };
        assert_eq!(
            of(r#"{"implant": {"name": "sheet"}}"#).kind,
            Kind::Skin("sheet".to_owned())
        );
        assert_eq!(of(r#"{"lattice": {"points": 8}}"#).kind, Kind::Lattice);
        let interrupted =
            of(r#"{"interrupted": true, "frames": 3, "frames_in_scene": 9, "notes": ["n", 5]}"#);
        assert_eq!(
            interrupted.notes,
            ["the run was interrupted at frame 3 of 9", "n"]
        );
        assert_eq!(of("[]"), RunMetadata::default());
    }
}
