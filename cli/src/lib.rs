//! The command `pliant`: its options, the pages and pictures that it writes, and parameter studies.
#![cfg_attr(not(test), warn(clippy::unwrap_used))]

pub mod report;
pub mod study;
pub mod stress;
pub mod commands;
mod draft;

pub use commands::{main, main_with};
