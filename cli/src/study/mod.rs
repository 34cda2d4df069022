//! Parameter studies: every combination of lists of values over a scene, run once, kept, compared in one table and on
//! one sheet of pictures.
//!
//! A [`StudyFile`](pliant::scene::StudyFile) is what was written. [`Combinations`] are its scenes, all checked before
//! anything runs. [`execute`] runs those whose [`Outcome`] is not in the folder yet, and [`Findings`] compare them.

pub mod combinations;
pub mod findings;
pub mod key;
pub mod outcome;
pub mod running;
pub mod sheet;

pub use combinations::{Combination, Combinations, Role, Subject};
pub use findings::{Findings, OF_LATTICES, OF_MUSCLES, OF_SKIN};
pub use outcome::Outcome;
pub use running::execute;
