//! The command `pliant`: what it reads from the command line, the pages and pictures it writes, and parameter studies.
#![cfg_attr(not(test), warn(clippy::unwrap_used))]

pub mod report;
pub mod study;
pub mod commands;

pub use commands::main;
