//! Checkpoints: a simulation between two frames as bytes; it resumes with the same bits.
//!
//! | part | bytes |
//! |---|---|
//! | magic | `PLIANTCP` |
//! | version of the format | 32 bits, little-endian, as all numbers |
//! | version of the crate | length (64 bits), UTF-8 |
//! | length of all but the checksum | 64 bits |
//! | fingerprint | a list of names and 128-bit hashes |
//! | state | length, bytes: frame, notes, and for each muscle the data of later steps |
//! | beside | length, additional bytes of the caller |
//! | checksum | FNV-1a of all before, 128 bits |
//!
//! Threads, lanes and the clock are not part of a checkpoint, since no bit depends on them.

mod fingerprint;

pub use fingerprint::Fingerprint;

use super::Simulation;
use crate::state::{DecodeError, Hash, Reader, State, Writer};

const MAGIC: &[u8; 8] = b"PLIANTCP";

/// Format version, to be incremented whenever the meaning of bytes changes.
const FORMAT: u32 = 11;

/// Version of the crate that wrote a checkpoint: other versions can compute other bits.
const CRATE: &str = env!("CARGO_PKG_VERSION");

const CHECKSUM: usize = 16;

/// Greatest length of a version text [bytes].
const LONGEST_VERSION: usize = 64;

/// The reason why a checkpoint is rejected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// The first bytes are not those of a checkpoint.
    #[error("it is no checkpoint: it does not begin with `PLIANTCP`")]
    NoCheckpoint,
    /// Another version of the crate wrote it.
    #[error(
        "it was written by pliant {by} (format {format}); this is pliant {CRATE} (format {FORMAT})"
    )]
    Version {
        /// Version of the crate that wrote it.
        by: String,
        /// Version of its format.
        format: u32,
    },
    /// The number of bytes is wrong.
    #[error("it is damaged: {found} bytes where {} are necessary", bytes(.expected))]
    Length {
        /// Number of bytes present.
        found: usize,
        /// Number of bytes declared; `None` if that is missing too.
        expected: Option<u64>,
    },
    /// The checksum does not match.
    #[error("it is damaged: its checksum is not that of its bytes")]
    Checksum,
    /// The checkpoint belongs to another simulation.
    #[error("it is of another simulation, which differs in {}", list(.0))]
    Differs(Vec<String>),
    /// The frame of the checkpoint is after the last frame of the scene.
    #[error("it is of frame {frame}, but the run ends at frame {frames}")]
    Beyond {
        /// Frame of the checkpoint.
        frame: usize,
        /// The last frame of the scene.
        frames: usize,
    },
    /// The bytes match their checksum, but are invalid.
    #[error("it is damaged: {0}")]
    DecodeError(#[from] DecodeError),
}

/// A number of bytes, if known.
fn bytes(count: &Option<u64>) -> String {
    count.map_or("more".to_owned(), |count| count.to_string())
}

/// The first few names of a list.
fn list(names: &[String]) -> String {
    const SHOWN: usize = 4;
    let mut text = names
        .iter()
        .take(SHOWN)
        .cloned()
        .collect::<Vec<_>>()
        .join(", ");
    if names.len() > SHOWN {
        text.push_str(&format!(" and {} more", names.len() - SHOWN));
    }
    text
}

/// The checkpoint of a simulation, with additional bytes `beside`.
#[must_use]
pub fn save(simulation: &Simulation, fingerprint: &Fingerprint, beside: &[u8]) -> Vec<u8> {
    let mut writer = Writer::default();
    writer.bytes.extend_from_slice(MAGIC);
    writer.put(&FORMAT);
    writer.put(&CRATE.to_owned());
    let place = writer.bytes.len();
    writer.put(&0u64);
    writer.put(fingerprint);
    let state = writer.bytes.len();
    writer.put(&0u64);
    simulation.save(&mut writer);
    let end = writer.bytes.len();
    set(&mut writer.bytes, state, end - state - 8);
    writer.put(&beside.len());
    writer.bytes.extend_from_slice(beside);
    let length = writer.bytes.len();
    set(&mut writer.bytes, place, length);
    seal(writer.bytes)
}

fn set(bytes: &mut [u8], at: usize, number: usize) {
    bytes[at..at + 8].copy_from_slice(&(number as u64).to_le_bytes());
}

/// Appends the checksum to bytes.
#[must_use]
pub fn seal(mut bytes: Vec<u8>) -> Vec<u8> {
    let hash = Hash::of(&bytes);
    bytes.extend_from_slice(&hash.to_le_bytes());
    bytes
}

/// A checkpoint with the right version and checksum.
#[derive(Clone, Debug)]
pub struct Checkpoint<'a> {
    fingerprint: Fingerprint,
    state: &'a [u8],
    /// Additional bytes of the caller.
    pub beside: &'a [u8],
}

impl<'a> Checkpoint<'a> {
    /// Opens a checkpoint.
    ///
    /// # Errors
    /// Bytes that are no checkpoint, of another version, or damaged.
    pub fn open(bytes: &'a [u8]) -> Result<Self, Refused> {
        let body = bytes.strip_prefix(MAGIC).ok_or(Refused::NoCheckpoint)?;
        let short = |expected| Refused::Length {
            found: bytes.len(),
            expected,
        };
        let mut reader = Reader::new(body);
        let (format, by): (u32, String) = reader.take().map_err(|_| short(None))?;
        if by.len() > LONGEST_VERSION || by.chars().any(char::is_control) {
            return Err(Refused::Checksum);
        }
        if (format, by.as_str()) != (FORMAT, CRATE) {
            return Err(Refused::Version { by, format });
        }
        let length: u64 = reader.take().map_err(|_| short(None))?;
        let expected = length.saturating_add(CHECKSUM as u64);
        if expected != bytes.len() as u64 {
            return Err(short(Some(expected)));
        }
        let (before, checksum) = bytes.split_at(bytes.len() - CHECKSUM);
        if Hash::of(before).to_le_bytes() != checksum {
            return Err(Refused::Checksum);
        }
        let fingerprint = reader.take()?;
        let count = reader.take()?;
        let state = reader.slice(count)?;
        let count = reader.take()?;
        let beside = reader.slice(count)?;
        reader.slice(CHECKSUM)?;
        reader.end()?;
        Ok(Self {
            fingerprint,
            state,
            beside,
        })
    }

    /// The frame after which the checkpoint was written.
    ///
    /// # Errors
    /// The frame is missing.
    pub fn frame(&self) -> Result<usize, Refused> {
        Ok(Reader::new(self.state).take()?)
    }

    /// Restores the state of a simulation from the same scene; `fingerprint` is that of the scene.
    ///
    /// # Errors
    /// A checkpoint of another scene, of a frame after the last, or with an invalid state. After
    /// the last of these `simulation` must not be used.
    pub fn restore(
        &self,
        simulation: &mut Simulation,
        fingerprint: &Fingerprint,
    ) -> Result<(), Refused> {
        let differs = self.fingerprint.differs_from(fingerprint);
        if !differs.is_empty() {
            return Err(Refused::Differs(differs));
        }
        let (frame, frames) = (self.frame()?, simulation.scene.frames);
        if frame > frames {
            return Err(Refused::Beyond { frame, frames });
        }
        let mut reader = Reader::new(self.state);
        simulation.restore(&mut reader)?;
        Ok(reader.end()?)
    }
}
