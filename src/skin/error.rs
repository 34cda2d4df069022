//! Why skin cannot be laid over an implant, and what to change.

/// A number with three digits that are worth something.
fn shown(number: f64) -> String {
    crate::format::number(number)
}

/// A length in a unit that suits it.
fn length(metres: f64) -> String {
    let (factor, unit) = match metres.abs() {
        size if size >= 1.0 => (1.0, "m"),
        size if size >= 1e-2 => (1e2, "cm"),
        _ => (1e3, "mm"),
    };
    format!("{} {unit}", shown(metres * factor))
}

/// Two digits, cut off below, so that what is said to be possible is.
fn at_most(number: f64) -> String {
    two_digits(number, f64::floor)
}

/// Two digits, cut off above.
fn at_least(number: f64) -> String {
    two_digits(number, f64::ceil)
}

fn two_digits(number: f64, round: fn(f64) -> f64) -> String {
    if !(number > 0.0 && number.is_finite()) {
        return shown(number);
    }
    let digits = 1 - number.log10().floor() as i32;
    let unit = 10f64.powi(-digits);
    format!("{:.*}", digits.max(0) as usize, round(number / unit) * unit)
}

/// The base that fits beside a border.
fn fitting(metres: f64) -> String {
    // Less than a tenth of a millimetre is no base of any implant.
    if metres >= 1e-4 {
        format!("a base of {} cm would fit there", at_most(metres * 1e2))
    } else {
        "the place lies at the border itself".to_owned()
    }
}

fn not_manifold(edges: usize, vertices: usize) -> String {
    let edges = match edges {
        0 => None,
        1 => Some("1 edge has more than two triangles (E030)".to_owned()),
        n => Some(format!("{n} edges have more than two triangles (E030)")),
    };
    let vertices = match vertices {
        0 => None,
        1 => Some("1 vertex joins surfaces (W012)".to_owned()),
        n => Some(format!("{n} vertices join surfaces (W012)")),
    };
    edges
        .into_iter()
        .chain(vertices)
        .collect::<Vec<_>>()
        .join(", ")
}

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
    #[error("the skin is not manifold near the implant: {}", not_manifold(*edges, *vertices))]
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
    #[error(
        "the region of the implant reaches the border of the skin: {edges} of its edges lie on it; {}",
        fitting(*fits)
    )]
    AtBorder {
        /// How many edges of the skin's border it has.
        edges: usize,
        /// A base that would fit there [m].
        fits: f64,
    },
    /// The skin goes round the body within the outline of the implant.
    #[error(
        "a base of {:.1} cm is too large for this place: under it the skin turns away and goes round the body{}",
        base * 1e2,
        smaller(*fits)
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
        "the implant is larger than the region: {} cc bulge too far beyond a base of {} cm, which takes at most {} cc",
        shown(*volume_cc),
        shown(*base_cm),
        at_most(*most_cc)
    )]
    TooLarge {
        /// Its volume [cm^3].
        volume_cc: f64,
        /// The largest volume for this base [cm^3].
        most_cc: f64,
        /// The base [cm].
        base_cm: f64,
    },
    /// The dome of the implant hangs over what is under the skin.
    #[error(
        "the implant reaches beyond the skin that was taken: it bulges {bulge:.2} times as far as its rim"
    )]
    Beyond {
        /// Greatest width over that of the base.
        bulge: f64,
    },
    /// The implant is next to nothing.
    #[error(
        "a volume of {} cc is no implant on a base of {} cm: it would be less than a hundredth of the base high; at least {} cc",
        shown(*volume_cc),
        shown(*base_cm),
        at_least(*least_cc)
    )]
    TooFlat {
        /// Its volume [cm^3].
        volume_cc: f64,
        /// The least volume for this base [cm^3].
        least_cc: f64,
        /// The base [cm].
        base_cm: f64,
    },
    /// Skin as thick as the implant is wide.
    #[error(
        "the {what}, {}, is more than half of the base of {}: at most {}",
        length(*value),
        length(*base),
        length(*most)
    )]
    TooThick {
        /// Depth or thickness.
        what: &'static str,
        /// What was asked for [m].
        value: f64,
        /// The most [m].
        most: f64,
        /// The base [m].
        base: f64,
    },
    /// Edges that are too long for the base.
    #[error("edges of {} are too long for a base of {}: at most a quarter of it, {}", length(*edge), length(*base), length(*most))]
    TooLong {
        /// What was asked for [m].
        edge: f64,
        /// The most [m].
        most: f64,
        /// The base [m].
        base: f64,
    },
    /// A direction without a length.
    #[error("the direction of the longer side is none: its length must be more than 0 and finite")]
    NoDirection,
    /// An obstacle that lies in the skin.
    #[error("obstacle {obstacle} lies in the skin over the implant, as if it were the skin itself")]
    ObstacleIsSkin {
        /// Which, from 1.
        obstacle: usize,
    },
    /// The skin turns away beside the implant.
    #[error("the skin bends too much beside the implant: it turns away by {degrees:.0} degrees{}", smaller(*fits))]
    TooCurved {
        /// Greatest angle to the normal of its middle.
        degrees: f64,
        /// A smaller base that fits there [m], if one was found.
        fits: Option<f64>,
    },
    /// Too much for a consultation.
    #[error(
        "about {vertices:.1e} vertices would be needed in the region, the most allowed is {most:.0e}"
    )]
    TooFine {
        /// Estimate.
        vertices: f64,
        /// Limit.
        most: f64,
    },
    /// Too much skin would have to be refined.
    #[error(
        "about {vertices:.1e} vertices would be needed to refine the skin about the implant, the most allowed is {most:.0e}"
    )]
    TooLargePatch {
        /// Estimate.
        vertices: f64,
        /// Limit.
        most: f64,
    },
    /// The skin could not be remeshed.
    #[error("the skin cannot be refined: {0}")]
    Refine(#[from] crate::mesh::RefineError),
    /// Two implants would lie in one another.
    #[error("the bases of implants {first} and {second} overlap")]
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
    #[error(
        "no volume up to {most_cc:.0} cc gives {wanted_cm2:.1} cm2; that volume gives {reached_cm2:.1} cm2"
    )]
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
fn smaller(fits: Option<f64>) -> String {
    fits.map_or(String::new(), |fits| {
        format!("; a base of {:.1} cm fits", fits * 1e2)
    })
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
            Self::NothingBelow => {
                "check the obstacles and their unit, which is that of the skin; or leave them out"
            }
            Self::AtBorder { .. } => {
                "move the implant away from the border, or make its base smaller"
            }
            Self::Beyond { .. } => "make the volume smaller or the base larger",
            Self::TooFlat { .. } => {
                "make the volume larger or the base smaller, and check the unit"
            }
            Self::TooThick { .. } => "make it smaller or the base larger, and check the units",
            Self::TooLong { .. } => {
                "give shorter edges, or leave them out for a twentieth of the base"
            }
            Self::NoDirection => "give a direction along the skin, as in 0,1,0, or leave it out",
            Self::ObstacleIsSkin { .. } => {
                "name what lies under the skin, such as bones; or leave it out"
            }
            Self::TooLargePatch { .. } => {
                "make --edge larger or the base larger, or refine the mesh near the implant (`coarse::halved_near` does)"
            }
            Self::WrapsAround { .. } => "make the base smaller, or choose a flatter place",
            Self::TooCoarse { .. } => "make --edge smaller or the base larger",
            Self::TooLarge { .. } => "make the volume smaller or the base larger",
            Self::TooCurved { .. } => {
                "make the base smaller, or choose a flatter place or another direction with --long"
            }
            Self::TooFine { .. } => "make --edge larger or the base smaller",
            Self::Refine(_) => "see `pliant check`, or give another --edge",
            Self::Overlap { .. } => "move them apart: bases may touch, but not overlap",
            Self::Solver(_) => "make the volume smaller, or --edge larger",
            Self::OutOfReach { .. } => "make the base larger, or use several implants",
            Self::Schedule { .. } => {
                "give days that rise and volumes that do not fall, as in 0:30cc,7:60cc,14:100cc"
            }
            Self::Stopped => "run it again",
        }
    }

    /// Checks that a number is positive and finite.
    pub(super) fn positive(what: &'static str, value: f64) -> Result<(), Self> {
        if value > 0.0 && value.is_finite() {
            Ok(())
        } else {
            Err(Self::NotPositive { what, value })
        }
    }
}
