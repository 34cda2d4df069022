//! Conformance checks and generators of hard cases; the one room that may know all others.
//!
//! Available to this crate's tests, and to others with the feature `testing`.

mod conformance;
mod controls;
mod draw;
mod dual;
mod subject;

pub use conformance::{Failure, check, check_constraint};
pub use controls::{Broken, CONTROLS};
pub use draw::Draw;
pub use dual::{Dual, Tracked};
pub use subject::{Subject, Volume};
