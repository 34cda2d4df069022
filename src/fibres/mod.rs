//! Fibres of a muscle: decomposition of a muscle into fibres, and the anisotropic stiffness along
//! them.

pub mod anisotropy;
pub mod attachment;
pub mod binding;
pub mod carry;
pub mod fibre_measures;
pub mod harmonic;
pub mod method;
pub mod polyline;
pub mod quality;
pub mod slices;
pub mod smooth;
pub mod solid;
pub mod springs;
pub mod superficial;
pub mod template;
