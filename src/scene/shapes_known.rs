//! Names of the generated shapes of a scene.

/// Every name of `shape = "..."`; the generated shapes are in metres.
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

/// The shapes of a skin; the section `sheet` describes the shape of that name.
pub const SKIN_SHAPES: &[&str] = &["sheet", "scalp"];

/// The shapes with polylines along their fibres.
pub const FIBRE_SHAPES: &[&str] = &["hip-gluteus"];
