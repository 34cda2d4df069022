//! Errors of skin simulations, with the possible repairs.

/// A number with three significant digits.
fn shown(number: f64) -> String {
    crate::format::number(number)
}

/// A length in a suitable unit.
fn length(metres: f64) -> String {
    let (factor, unit) = match metres.abs() {
        size if size >= 1.0 => (1.0, "m"),
        size if size >= 1e-2 => (1e2, "cm"),
        _ => (1e3, "mm"),
    };
    format!("{} {unit}", shown(metres * factor))
}

/// Two digits, rounded down, so that a stated limit is possible.
fn at_most(number: f64) -> String {
    two_digits(number, f64::floor)
}

/// Two digits, rounded up.
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

/// The text about a base that fits beside a border.
fn fitting(metres: f64) -> String {
    // No implant has a base of less than a tenth of a millimetre.
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

/// The reason why an implant cannot be inserted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SkinError {
    /// A length, volume or stiffness is no positive number.
    #[error("{what} must be more than 0 and finite, not {value}")]
    NotPositive {
        /// Name of the quantity.
        what: &'static str,
        /// The given value, in SI units.
        value: f64,
    },
    /// The mesh has no triangles.
    #[error("the skin has no triangles (E046)")]
    Empty,
    /// The mesh is invalid, or coordinates are not finite.
    #[error("the skin is no mesh: {0}")]
    Mesh(#[from] crate::mesh::MeshError),
    /// Edges with more than two triangles, or surfaces that touch in a vertex, are near the
    /// implant.
    #[error("the skin is not manifold near the implant: {}", not_manifold(*edges, *vertices))]
    NotManifold {
        /// Number of such edges.
        edges: usize,
        /// Number of such vertices.
        vertices: usize,
    },
    /// The skin is one-sided.
    #[error("the skin around the implant has one side only (E031)")]
    OneSided,
    /// The vertex does not exist or has no triangle.
    #[error("there is no vertex {vertex} of a triangle: the skin has {count} vertices")]
    NoVertex {
        /// The given vertex.
        vertex: usize,
        /// Number of vertices.
        count: usize,
    },
    /// The place is not on the skin.
    #[error("the place is {distance:.3} m away from the skin, more than half of the base")]
    FarAway {
        /// Distance of the point from the skin [m].
        distance: f64,
    },
    /// Obstacles are given, but none is under the implant.
    #[error("no obstacle lies under the implant, within two bases below the skin")]
    NothingBelow,
    /// The region of the implant reaches the border of the skin.
    #[error(
        "the region of the implant reaches the border of the skin: {edges} of its edges lie on it; {}",
        fitting(*fits)
    )]
    AtBorder {
        /// Number of border edges of the skin in the region.
        edges: usize,
        /// A base that would fit [m].
        fits: f64,
    },
    /// The skin turns around the body within the outline of the implant.
    #[error(
        "a base of {:.1} cm is too large for this place: under it the skin turns away and goes round the body{}",
        base * 1e2,
        smaller(*fits)
    )]
    WrapsAround {
        /// The base [m].
        base: f64,
        /// A smaller base that fits [m], if the search found one.
        fits: Option<f64>,
    },
    /// The region has too few free vertices.
    #[error("only {vertices} vertices of the skin around the implant can move")]
    TooCoarse {
        /// Number of free vertices.
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
        /// Volume of the implant [cm^3].
        volume_cc: f64,
        /// The largest volume for this base [cm^3].
        most_cc: f64,
        /// The base [cm].
        base_cm: f64,
    },
    /// The dome of the implant overhangs its base too far.
    #[error(
        "the implant reaches beyond the skin that was taken: it bulges {bulge:.2} times as far as its rim"
    )]
    Beyond {
        /// Greatest width relative to that of the base.
        bulge: f64,
    },
    /// The volume is too small for an implant.
    #[error(
        "a volume of {} cc is no implant on a base of {} cm: it would be less than a hundredth of the base high; at least {} cc",
        shown(*volume_cc),
        shown(*base_cm),
        at_least(*least_cc)
    )]
    TooFlat {
        /// Volume of the implant [cm^3].
        volume_cc: f64,
        /// The least volume for this base [cm^3].
        least_cc: f64,
        /// The base [cm].
        base_cm: f64,
    },
    /// Depth or thickness of the skin is too great relative to the base.
    #[error(
        "the {what}, {}, is more than half of the base of {}: at most {}",
        length(*value),
        length(*base),
        length(*most)
    )]
    TooThick {
        /// Depth or thickness, as text.
        what: &'static str,
        /// The given value [m].
        value: f64,
        /// Greatest possible value [m].
        most: f64,
        /// The base [m].
        base: f64,
    },
    /// The edge length is too great for the base.
    #[error("edges of {} are too long for a base of {}: at most a quarter of it, {}", length(*edge), length(*base), length(*most))]
    TooLong {
        /// The given edge length [m].
        edge: f64,
        /// Greatest possible edge length [m].
        most: f64,
        /// The base [m].
        base: f64,
    },
    /// The direction is zero or not finite.
    #[error("the direction of the longer side is none: its length must be more than 0 and finite")]
    NoDirection,
    /// An obstacle is part of the skin.
    #[error("obstacle {obstacle} lies in the skin over the implant, as if it were the skin itself")]
    ObstacleIsSkin {
        /// Index of the obstacle, from 1.
        obstacle: usize,
    },
    /// The skin is too curved beside the implant.
    #[error("the skin bends too much beside the implant: it turns away by {degrees:.0} degrees{}", smaller(*fits))]
    TooCurved {
        /// Greatest angle to the normal of its centre [degrees].
        degrees: f64,
        /// A smaller base that fits [m], if the search found one.
        fits: Option<f64>,
    },
    /// The region would have too many vertices.
    #[error(
        "about {vertices:.1e} vertices would be needed in the region, the most allowed is {most:.0e}"
    )]
    TooFine {
        /// Estimated number.
        vertices: f64,
        /// Greatest number.
        most: f64,
    },
    /// The refined patch would have too many vertices.
    #[error(
        "about {vertices:.1e} vertices would be needed to refine the skin about the implant, the most allowed is {most:.0e}"
    )]
    TooLargePatch {
        /// Estimated number.
        vertices: f64,
        /// Greatest number.
        most: f64,
    },
    /// The remeshing of the skin failed.
    #[error("the skin cannot be refined: {0}")]
    Refine(#[from] crate::mesh::RefineError),
    /// Two implants would overlap.
    #[error("the bases of implants {first} and {second} overlap")]
    Overlap {
        /// Index of the first implant, from 1.
        first: usize,
        /// Index of the second implant, from 1.
        second: usize,
    },
    /// The equations have no solution.
    #[error("the skin could not be settled: {0}")]
    Solver(String),
    /// No volume gives the requested area.
    #[error(
        "no volume up to {most_cc:.0} cc gives {target_cm2:.1} cm2; that volume gives {reached_cm2:.1} cm2"
    )]
    OutOfReach {
        /// Requested gain [cm^2].
        target_cm2: f64,
        /// Greatest volume of the search [cm^3].
        most_cc: f64,
        /// Gain at that volume [cm^2].
        reached_cm2: f64,
    },
    /// The fillings are no valid schedule.
    #[error("filling {step}: {what}")]
    Schedule {
        /// Index of the filling, from 1.
        step: usize,
        /// The error.
        what: &'static str,
    },
    /// The caller stopped the simulation.
    #[error("stopped")]
    Stopped,
}

/// The text about a base that fits [m].
fn smaller(fits: Option<f64>) -> String {
    fits.map_or(String::new(), |fits| {
        format!("; a base of {:.1} cm fits", fits * 1e2)
    })
}

impl SkinError {
    /// Advice for the user.
    pub fn help(&self) -> &'static str {
        match self {
            Self::NotPositive { .. } => "give a positive number with its unit",
            Self::Empty => "name a file with triangles",
            Self::Mesh(_) | Self::NotManifold { .. } | Self::OneSided => {
                "repair the mesh: `repair = true` below it in a scene"
            }
            Self::NoVertex { .. } => "count vertices from 0, or give a place with `at`",
            Self::FarAway { .. } => "check `at` and `unit`: both are in the unit of the file",
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
                "make `edge_length` larger or the base larger, or refine the mesh near the implant (`coarse::halved_near` does)"
            }
            Self::WrapsAround { .. } => "make the base smaller, or choose a flatter place",
            Self::TooCoarse { .. } => "make `edge_length` smaller or the base larger",
            Self::TooLarge { .. } => "make the volume smaller or the base larger",
            Self::TooCurved { .. } => {
                "make the base smaller, or choose a flatter place or another direction"
            }
            Self::TooFine { .. } => "make `edge_length` larger or the base smaller",
            Self::Refine(_) => "check the mesh, or give another `edge_length`",
            Self::Overlap { .. } => "move them apart: bases may touch, but not overlap",
            Self::Solver(_) => "make the volume smaller, or `edge_length` larger",
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

    /// Checks a number that must not be negative.
    pub(super) fn not_negative(what: &'static str, value: f64) -> Result<(), Self> {
        if value == 0.0 {
            return Ok(());
        }
        Self::positive(what, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_have_two_digits_and_are_possible() {
        let of = |number: f64| [at_most(number), at_least(number)];
        assert_eq!(of(0.012_34), ["0.012", "0.013"]);
        assert_eq!(of(8.0), ["8.0", "8.0"]);
        assert_eq!(of(127.0), ["120", "130"]);
        assert_eq!(of(0.0), ["0", "0"]);
        assert_eq!(of(f64::INFINITY), ["inf", "inf"]);
    }
}
