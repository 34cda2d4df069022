#![doc = include_str!("../README.md")]
//!
//! # The crate
//!
//! The data flow one way: a [`scene`] is read and checked, a plan says which effects it calls for, a simulation
//! runs only those, and writers turn frames and measures into files. A module imports only what stands above it
//! in this list.
#![forbid(unsafe_code)]
#![warn(missing_docs)]
// Units are written in brackets, [m], which rustdoc would take for links.
#![allow(rustdoc::broken_intra_doc_links)]
// `!(error <= bound)` is meant: it also catches NaN.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

// In the order in which they may import each other, not by letter: `reorder_modules` is off.
pub mod format;
pub mod mesh;
pub mod io;
pub mod state;
pub mod particles;
mod random;
pub mod simd;
pub mod constraints;
pub mod contact;
pub mod springs;
pub mod solvers;
pub mod morph;
pub mod fibres;
pub mod skin;
pub mod scene;
pub mod geometric;
pub mod simulation;
pub mod moment_arms;
pub mod accuracy;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
