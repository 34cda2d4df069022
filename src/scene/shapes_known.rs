//! Names of the shapes that a scene may ask for instead of a file.

/// Every name that `shape = "..."` accepts; the shapes are made by code, in metres.
pub const SHAPES: &[&str] = &[
    "tetrahedron",
    "chain",
    "press-muscle",
    "press-plate",
    "hip-socket",
    "hip-femur",
    "hip-gluteus",
    "soft-cube",
    "soft-ball",
    "soft-table",
    "skull",
];

/// The shapes that a skin may have; `sheet` is described by the section of that name.
pub const SKIN_SHAPES: &[&str] = &["sheet", "scalp"];

/// The shapes that also have polylines along their fibres.
pub const FIBRE_SHAPES: &[&str] = &["hip-gluteus"];
