//! Verified, fast deformation of soft tissue.
//!
//! The data flow one way: a [`scene`] is read and checked, a plan says which effects it calls for, a simulation
//! runs only those, and writers turn frames and measures into files. A module imports only what stands above it
//! in this list.
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod io;
pub mod mesh;
pub mod render;
pub mod report;
pub mod scene;
