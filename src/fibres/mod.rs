//! Fibres carried by a muscle, how a muscle is decomposed into them, and what their direction does to its stiffness.

pub mod anisotropy;
pub mod attachment;
pub mod binding;
pub mod harmonic;
pub mod polyline;
pub mod quality;
pub mod slices;
pub mod solid;
pub mod springs;
pub mod template;
