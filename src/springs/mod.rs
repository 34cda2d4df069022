//! Points on springs.

pub mod lattice;
