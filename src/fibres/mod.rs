//! Fibres carried by a muscle, and what their direction does to its stiffness.

pub mod anisotropy;
pub mod binding;
