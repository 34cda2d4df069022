//! The command `pliant`: what it reads from the command line, the pages and pictures it writes, and parameter studies.
#![forbid(unsafe_code)]
#![warn(missing_docs)]
// Units are written in brackets, [m], which rustdoc would take for links.
#![allow(rustdoc::broken_intra_doc_links)]
// `!(error <= bound)` is meant: it also catches NaN.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod report;
pub mod study;
pub mod commands;

pub use commands::main;
