//! Why skin cannot be laid over an implant, and what to change.

/// Why an implant cannot be inserted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SkinError {
    /// A length, volume or stiffness that is no positive number.
    #[error("{what} must be more than 0 and finite, not {value}")]
    NotPositive {
        /// What it is.
        what: &'static str,
        /// What was given, SI.
        value: f64,
    },
    /// The mesh has no triangles.
    #[error("the skin has no triangles (E046)")]
    Empty,
    /// Not a mesh, or coordinates that are not finite.
    #[error("the skin is no mesh: {0}")]
    Mesh(#[from] crate::mesh::MeshError),
    /// More than two triangles at an edge, or surfaces that touch in a vertex, near the implant.
    #[error(
        "the skin is not manifold: {edges} edges have more than two triangles (E030), {vertices} vertices join surfaces (W012)"
    )]
    NotManifold {
        /// Such edges.
        edges: usize,
        /// Such vertices.
        vertices: usize,
    },
    /// The skin has one side only.
    #[error("the skin around the implant has one side only (E031)")]
    OneSided,
    /// No such vertex, or none that a triangle names.
    #[error("there is no vertex {vertex} of a triangle: the skin has {count} vertices")]
    NoVertex {
        /// Which was asked for.
        vertex: usize,
        /// How many there are.
        count: usize,
    },
    /// The place is not on the skin.
    #[error("the place is {distance:.3} m away from the skin, more than half of the base")]
    FarAway {
        /// How far [m].
        distance: f64,
    },
    /// Obstacles are given, but none lies under the implant.
    #[error("no obstacle lies under the implant, within two bases below the skin")]
    NothingBelow,
    /// The region of the implant reaches the border of the skin.
    #[error("the region of the implant reaches the border of the skin: {edges} of its edges lie on it")]
    AtBorder {
        /// How many edges of the skin's border it has.
        edges: usize,
    },
    /// The skin goes round the body within the outline of the implant.
    #[error(
        "a base of {:.1} cm is too large for this place: under it the skin turns away and goes round the body{}",
        base * 1e2,
        fitting(*fits)
    )]
    WrapsAround {
        /// The base [m].
        base: f64,
        /// A smaller base that fits there [m], if one was found.
        fits: Option<f64>,
    },
    /// Too few triangles move.
    #[error("only {vertices} vertices of the skin around the implant can move")]
    TooCoarse {
        /// How many.
        vertices: usize,
    },
    /// The implant is wider than the region.
    #[error(
        "the implant is larger than the region: {volume_cc:.0} cc on this base bulge {ratio:.2} times as far as its rim"
    )]
    TooLarge {
        /// Its volume [cm^3].
        volume_cc: f64,
        /// Greatest width over that of the base.
        ratio: f64,
    },
    /// The skin turns away beside the implant.
    #[error("the skin bends too much beside the implant: it turns away by {degrees:.0} degrees{}", fitting(*fits))]
    TooCurved {
        /// Greatest angle to the normal of its middle.
        degrees: f64,
        /// A smaller base that fits there [m], if one was found.
        fits: Option<f64>,
    },
    /// Too much for a consultation.
    #[error("about {vertices:.1e} vertices would be needed in the region, the most allowed is {most:.0e}")]
    TooFine {
        /// Estimate.
        vertices: f64,
        /// Limit.
        most: f64,
    },
    /// The skin could not be remeshed.
    #[error("the skin cannot be refined: {0}")]
    Refine(#[from] crate::mesh::RefineError),
    /// Two implants share skin.
    #[error("the regions of implants {first} and {second} overlap")]
    Overlap {
        /// The one, from 1.
        first: usize,
        /// The other.
        second: usize,
    },
    /// The equations could not be solved.
    #[error("the skin could not be settled: {0}")]
    Solver(String),
    /// The wanted area is out of reach.
    #[error("no volume up to {most_cc:.0} cc gives {wanted_cm2:.1} cm2; that volume gives {reached_cm2:.1} cm2")]
    OutOfReach {
        /// Gain wanted [cm^2].
        wanted_cm2: f64,
        /// Greatest volume tried [cm^3].
        most_cc: f64,
        /// Gain there [cm^2].
        reached_cm2: f64,
    },
    /// Fillings that are no schedule.
    #[error("filling {step}: {what}")]
    Schedule {
        /// Which filling, from 1.
        step: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// Stopped from outside.
    #[error("stopped")]
    Stopped,
}

/// What is said of a base that fits [m].
fn fitting(fits: Option<f64>) -> String {
    fits.map_or(String::new(), |fits| format!("; a base of {:.1} cm fits", fits * 1e2))
}

impl SkinError {
    /// What to change.
    pub fn help(&self) -> &'static str {
        match self {
            Self::NotPositive { .. } => "give a positive number with its unit",
            Self::Empty => "name a file with triangles",
            Self::Mesh(_) | Self::NotManifold { .. } | Self::OneSided => {
                "see `pliant check`, and repair the mesh with --repair"
            }
            Self::NoVertex { .. } => "count vertices from 0, or give a place with --at",
            Self::FarAway { .. } => "check --at and --unit: both are in the unit of the file",
            Self::NothingBelow => "check the obstacles and their unit, which is that of the skin; or leave them out",
            Self::AtBorder { .. } => "move the implant away from the border, or make its base smaller",
            Self::WrapsAround { .. } => "make the base smaller, or choose a flatter place",
            Self::TooCoarse { .. } => "make --edge smaller or the base larger",
            Self::TooLarge { .. } => "make the volume smaller or the base larger",
            Self::TooCurved { .. } => {
                "make the base smaller, or choose a flatter place or another direction with --long"
            }
            Self::TooFine { .. } => "make --edge larger or the base smaller",
            Self::Refine(_) => "see `pliant check`, or give another --edge",
            Self::Overlap { .. } => "move them apart: regions reach 1.5 times as far as the base",
            Self::Solver(_) => "make the volume smaller, or --edge larger",
            Self::OutOfReach { .. } => "make the base larger, or use several implants",
            Self::Schedule { .. } => "give days that rise and volumes that do not fall, as in 0:30cc,7:60cc,14:100cc",
            Self::Stopped => "run it again",
        }
    }

    /// Checks that a number is positive and finite.
    pub(super) fn positive(what: &'static str, value: f64) -> Result<(), Self> {
        if value > 0.0 && value.is_finite() { Ok(()) } else { Err(Self::NotPositive { what, value }) }
    }
}
