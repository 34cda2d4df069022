//! Checkpoints: a simulation between two frames as bytes, from which it goes on with the same bits.
//!
//! | part | bytes |
//! |---|---|
//! | magic | `PLIANTCP` |
//! | version of the format | 32 bits, little-endian, as all numbers |
//! | version of the crate | length (64 bits), UTF-8 |
//! | length of all but the checksum | 64 bits |
//! | fingerprint | a list of names and 128-bit hashes |
//! | state | length, bytes: frame, notes, muscle by muscle what later steps depend on |
//! | beside | length, bytes that the caller gave, for what it gathered itself |
//! | checksum | FNV-1a of all before, 128 bits |
//!
//! Threads and lanes are no part of it, since no bit depends on them; nor is the clock.

mod fingerprint;

pub use fingerprint::Fingerprint;

use super::Simulation;
use crate::state::{DecodeError, Hash, Reader, State, Writer};

const MAGIC: &[u8; 8] = b"PLIANTCP";

/// Counts up whenever bytes get another meaning.
const FORMAT: u32 = 1;

/// The version of the crate that wrote a checkpoint: others may compute other bits.
const CRATE: &str = env!("CARGO_PKG_VERSION");

const CHECKSUM: usize = 16;

/// A longer text is no version.
const LONGEST_VERSION: usize = 64;

/// Why a simulation cannot go on from some bytes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// The bytes begin otherwise.
    #[error("it is no checkpoint: it does not begin with `PLIANTCP`")]
    NoCheckpoint,
    /// Another version wrote it.
    #[error(
        "it was written by pliant {by} (format {format}); this is pliant {CRATE} (format {FORMAT})"
    )]
    Version {
        /// Version of the crate that wrote it.
        by: String,
        /// Version of its format.
        format: u32,
    },
    /// Bytes are missing or more than there should be.
    #[error("it is damaged: {found} bytes where {wanted} are wanted")]
    Length {
        /// Bytes there are.
        found: usize,
        /// Bytes that it says it has; `None` where not even that is there.
        wanted: Wanted,
    },
    /// Some byte changed.
    #[error("it is damaged: its checksum is not that of its bytes")]
    Checksum,
    /// It is of something else.
    #[error("it is of another simulation, which differs in {}", list(.0))]
    Differs(Vec<String>),
    /// It is of a later frame than the last that is wanted.
    #[error("it is of frame {frame}, beyond the last wanted, {frames}")]
    Beyond {
        /// Its frame.
        frame: usize,
        /// The last frame of the scene.
        frames: usize,
    },
    /// The bytes are as they were written, but make no sense.
    #[error("it is damaged: {0}")]
    Corrupt(#[from] DecodeError),
}

/// A number of bytes, as far as it is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted(Option<u64>);

impl std::fmt::Display for Wanted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            Some(count) => write!(f, "{count}"),
            None => f.write_str("more"),
        }
    }
}

/// The first few of some names.
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

/// The checkpoint of a simulation, with bytes to be kept `beside` it.
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

/// Puts the checksum behind bytes.
#[must_use]
pub fn seal(mut bytes: Vec<u8>) -> Vec<u8> {
    let hash = Hash::of(&bytes);
    bytes.extend_from_slice(&hash.to_le_bytes());
    bytes
}

/// A checkpoint whose version and checksum are right.
#[derive(Clone, Debug)]
pub struct Checkpoint<'a> {
    fingerprint: Fingerprint,
    state: &'a [u8],
    /// What was kept beside it.
    pub beside: &'a [u8],
}

impl<'a> Checkpoint<'a> {
    /// Looks at bytes.
    ///
    /// # Errors
    /// They are no checkpoint, or that of another version, or damaged.
    pub fn open(bytes: &'a [u8]) -> Result<Self, Refused> {
        let body = bytes.strip_prefix(MAGIC).ok_or(Refused::NoCheckpoint)?;
        let short = |wanted| Refused::Length {
            found: bytes.len(),
            wanted: Wanted(wanted),
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
        let wanted = length.saturating_add(CHECKSUM as u64);
        if wanted != bytes.len() as u64 {
            return Err(short(Some(wanted)));
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

    /// The frame after which it was written.
    ///
    /// # Errors
    /// There is none in it.
    pub fn frame(&self) -> Result<usize, Refused> {
        Ok(Reader::new(self.state).take()?)
    }

    /// Puts a simulation made from the same scene, of which this is the `fingerprint`, where it was.
    ///
    /// # Errors
    /// It is of another scene, of a frame that is not wanted, or makes no sense; in the last case `simulation` is of no use
    /// any more.
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
