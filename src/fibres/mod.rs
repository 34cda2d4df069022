//! Fibres of a muscle: decomposition of a muscle into fibres, and the anisotropic stiffness along
//! them.

pub(crate) mod anisotropy;
mod aponeurosis;
pub(crate) mod attachment;
pub(crate) mod binding;
pub(crate) mod carry;
pub(crate) mod fibre_measures;
pub mod harmonic;
pub(crate) mod method;
pub(crate) mod polyline;
pub mod quality;
pub(crate) mod slices;
pub(crate) mod smooth;
pub(crate) mod solid;
pub(crate) mod springs;
pub(crate) mod superficial;
pub(crate) mod template;

pub use attachment::{Area, AreaSource, Attachment, AttachmentError};
pub use binding::BoundLines;
pub use fibre_measures::{
    FibreMeasures, HOOK_DEG, Tendon, action, end_tilts, measure_fibres, median_tilt, turns_back,
};
pub use method::{FibreMethod, Fibres, MethodError, decompose_by};
pub use polyline::length;
pub use slices::SlicesError;
pub use smooth::Smoothing;
pub use springs::SpringsError;
pub use superficial::{RegisteredLines, register};
pub use template::Template;
