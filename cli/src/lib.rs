//! The command `pliant`: its options, the pages and pictures that it writes, and parameter studies.
#![forbid(unsafe_code)]
#![warn(missing_docs)]
// Units are in brackets, [m], which rustdoc would read as links.
#![allow(rustdoc::broken_intra_doc_links)]
// `!(error <= bound)` is intentional: it also catches NaN.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod report;
pub mod study;
pub mod commands;

pub use commands::main;
