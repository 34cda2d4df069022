//! Parameter studies: all combinations of lists of values over a scene, each run once, stored, and
//! compared in one table and on one sheet of pictures.
//!
//! A [`StudyFile`](pliant::scene::StudyFile) is the file as written. [`Combinations`] are its
//! scenes, all checked before any run. [`execute`] runs those without an [`Outcome`] in the folder,
//! and [`Findings`] compare them.

pub mod combinations;
pub mod findings;
pub mod key;
pub mod outcome;
pub mod running;
pub mod sheet;

pub use combinations::{Combination, Combinations, Role, Subject};
pub use findings::Findings;
pub use outcome::Outcome;
pub use running::execute;
