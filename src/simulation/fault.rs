//! Errors of the meshes and attachments of a scene, with the line of the scene that causes them.

use super::springs::SpringsModelError;
use crate::contact::apart::Inseparable;
use crate::io::ReadError;
use crate::scene::{Scene, SceneError, SceneOrigin, SceneProblem};
use crate::skin::SkinError;
use crate::springs::lattice::LatticeError;

/// Kinds of errors of a mesh or an attachment.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// E020: an index list contains a vertex that the muscle does not have.
    #[error("vertex {index} does not exist: the muscle has {count} vertices{}", if *.refined { " after refinement, which renumbers them" } else { "" })]
    NoSuchVertex {
        /// The index.
        index: u32,
        /// Number of vertices.
        count: usize,
        /// True if the mesh was refined.
        refined: bool,
    },
    /// E030: an edge with more than two triangles, with a volume constraint.
    #[error("edges with more than two triangles: {count}, the first between the vertices {} and {}", .edge[0], .edge[1])]
    NonManifoldEdge {
        /// Number of such edges.
        count: usize,
        /// The vertices of the first such edge.
        edge: [u32; 2],
    },
    /// E031: two neighbours with opposite orientations, with a volume constraint.
    #[error("neighbours that do not agree in orientation: {count} pairs, the first the triangles {} and {}", .triangles[0], .triangles[1])]
    InconsistentOrientation {
        /// Number of such pairs.
        count: usize,
        /// The first pair.
        triangles: [u32; 2],
    },
    /// E032: an edge with one triangle, with a volume constraint.
    #[error("edges with only one triangle: {count}, the first between the vertices {} and {}", .edge[0], .edge[1])]
    OpenBoundary {
        /// Number of such edges.
        count: usize,
        /// The vertices of the first such edge.
        edge: [u32; 2],
    },
    /// E038: a surface that is inside out, with a volume constraint.
    #[error("the enclosed volume is {volume:e} m3: triangles turn inward")]
    InsideOut {
        /// The signed volume [m^3].
        volume: f64,
    },
    /// E046: a mesh without triangles where some are needed.
    #[error("{file} holds no triangles")]
    NoTriangles {
        /// Name of the file or shape.
        file: String,
    },
    /// E047: a mesh file without polylines as a source of fibres.
    #[error("{file} holds no lines")]
    NoLines {
        /// Name of the file.
        file: String,
    },
    /// E070: a remeshed bone would have another shape.
    #[error("it would be {deviation_mm} mm from the surface as read, of {most_mm} mm allowed")]
    TooCoarse {
        /// Distance from the surface as read, in millimetres.
        deviation_mm: String,
        /// Greatest distance, in millimetres.
        most_mm: String,
    },
    /// E070: the target edge length is impossible.
    #[error("cannot refine to this edge length: {why}")]
    Refine {
        /// The cause.
        why: String,
    },
    /// E071: a patch has fewer components than the index requires.
    #[error("{file} has no component {index} (components are counted from 0, by falling area)")]
    NoSuchComponent {
        /// File of the patch.
        file: String,
        /// Index of the component.
        index: usize,
    },
    /// E072: an attachment contains no vertex.
    #[error("no vertex of the muscle is that near; the nearest is {nearest_mm:.2} mm away")]
    NothingAttached {
        /// Distance of the nearest vertex [mm].
        nearest_mm: f64,
    },
    /// E072: vertices are near, but the limit of an attachment is below one vertex.
    #[error(
        "{near} of {count} vertices are near enough, but {percent} % of {count} is less than one vertex"
    )]
    LimitedToNothing {
        /// Number of vertices within the distance.
        near: usize,
        /// Number of vertices of the muscle.
        count: usize,
        /// The limit, as a share of the vertices [%].
        percent: f64,
    },
    /// E073: too many vertices of a muscle are attached, and too much of its area.
    #[error("{held} of {count} vertices are held, more than 10 %, and of the area as well")]
    TooManyAttached {
        /// Number of attached vertices.
        held: usize,
        /// Number of all vertices.
        count: usize,
    },
    /// E074: a part of a muscle has no attachment, so its equilibrium is not unique.
    #[error("a part of it is held by nothing, so its equilibrium has no place of its own")]
    Unheld,
    /// E075: the matrix factor of the muscle does not fit into memory.
    #[error("a factor of {bytes} bytes does not fit into memory")]
    FactorTooLarge {
        /// Size of the factor [bytes].
        bytes: usize,
    },
    /// E076: an implant or a ball does not fit under the skin.
    #[error(transparent)]
    Skin(#[from] SkinError),
    /// E077: a lattice cannot be built.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// E079: a spring system cannot run to rest.
    #[error(transparent)]
    Springs(#[from] SpringsModelError),
    /// E079: bodies of springs cannot move as asked.
    #[error("{why}")]
    SpringBodies {
        /// The cause, with what to change.
        why: String,
    },
    /// E081: fibres cannot be computed between the attachments.
    #[error("no fibres between its attachments: {why}")]
    NoFibres {
        /// The cause.
        why: String,
    },
    /// E082: a tone that stretches the surface too much.
    #[error("a tone of {stress} Pa stretches its fibres by {percent:.1} %, more than {most} %")]
    TooMuchTone {
        /// The stress [Pa].
        stress: f64,
        /// The stretch [%].
        percent: f64,
        /// The greatest one [%].
        most: f64,
    },
    /// E083: an attachment whose vertices the motion carries into another bone.
    #[error(
        "the motion carries every vertex that is that near into `{bone}`, the first in frame {frame}"
    )]
    CarriedInto {
        /// Name of the other bone.
        bone: String,
        /// Frame in which the nearest vertex enters it.
        frame: usize,
    },
    /// E080: two surfaces that cannot be parted at the start.
    #[error(transparent)]
    Inseparable(#[from] Inseparable),
}

impl Fault {
    /// The code, equal for all faults of one kind.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::NoSuchVertex { .. } => "E020",
            Self::NonManifoldEdge { .. } => "E030",
            Self::InconsistentOrientation { .. } => "E031",
            Self::OpenBoundary { .. } => "E032",
            Self::InsideOut { .. } => "E038",
            Self::NoTriangles { .. } => "E046",
            Self::NoLines { .. } => "E047",
            Self::Refine { .. } | Self::TooCoarse { .. } => "E070",
            Self::NoSuchComponent { .. } => "E071",
            Self::NothingAttached { .. } | Self::LimitedToNothing { .. } => "E072",
            Self::TooManyAttached { .. } => "E073",
            Self::Unheld => "E074",
            Self::FactorTooLarge { .. } => "E075",
            Self::Skin(_) => "E076",
            Self::Lattice(_) => "E077",
            Self::Springs(_) | Self::SpringBodies { .. } => "E079",
            Self::Inseparable(_) => "E080",
            Self::NoFibres { .. } => "E081",
            Self::TooMuchTone { .. } => "E082",
            Self::CarriedInto { .. } => "E083",
        }
    }

    /// Advice for the user.
    #[must_use]
    pub fn help(&self) -> String {
        match self {
            Self::NoSuchVertex { refined: true, .. } => "leave `edge_length` out or attach by nearness".to_owned(),
            Self::NoSuchVertex { count, .. } => format!("give indices from 0 to {}", count.saturating_sub(1)),
            Self::NonManifoldEdge { .. }
            | Self::InconsistentOrientation { .. }
            | Self::OpenBoundary { .. }
            | Self::InsideOut { .. } => "the volume effect needs a closed surface with triangles turned outward: \
                `repair = true` below its `mesh` may mend it (`pliant check` tells), or leave [effects.volume] out"
                .to_owned(),
            Self::NoTriangles { file } => match file.strip_prefix("shape ") {
                Some(shape) => format!("this version cannot make the shape `{shape}`"),
                None => "name a file with a surface".to_owned(),
            },
            Self::NoLines { .. } => "fibres are read from LINES of a legacy VTK file or `l` of an OBJ file".to_owned(),
            Self::Refine { .. } => "ask for a longer edge length".to_owned(),
            Self::TooCoarse { .. } => "ask for a shorter edge length".to_owned(),
            Self::NoSuchComponent { .. } => "name another number behind `#`, or none".to_owned(),
            Self::NothingAttached { .. } => "check that muscle, bone and patch belong together and each `unit` is \
                right, or raise `near` or `within`"
                .to_owned(),
            Self::LimitedToNothing { .. } => "raise `limit`, give `edge_length` for a finer mesh, or list \
                `vertices`"
                .to_owned(),
            Self::TooManyAttached { .. } => "lower `limit` or the distances".to_owned(),
            Self::Unheld => "attach every piece of it to a bone, or let it move: [solver.xpbd]".to_owned(),
            Self::CarriedInto { .. } => "check the joint's `centre` and `axis` and the range of the motion, \
                or hold the muscle elsewhere"
                .to_owned(),
            Self::FactorTooLarge { .. } => "ask for a longer `edge_length`, or use [solver.xpbd]".to_owned(),
            Self::Skin(error) => error.help().to_owned(),
            Self::Lattice(_) => "change `stiffness`, `mass`, `damping` or `frame_rate`".to_owned(),
            Self::Springs(error) => error.help().to_owned(),
            Self::SpringBodies { .. } => "`pliant scenes explain` tells the keys of a scene".to_owned(),
            Self::NoFibres { .. } => "give lines along the fibres (`lines = \"FILE\"`), or correct the attachments"
                .to_owned(),
            Self::TooMuchTone { .. } => "lower `stress` in [effects.tone], or raise `stretch` in [muscle.material]".to_owned(),
            Self::Inseparable(_) => "check that both meshes belong together and their units are right (`pliant check A B` \
                shows where they overlap), or leave [effects.contact] out".to_owned(),
        }
    }
}

/// The reason why a scene's meshes cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// A file is no readable mesh.
    #[error("{0}")]
    Read(#[from] Box<ReadError>),
    /// A part of the scene is unusable.
    #[error("{0}")]
    Unfit(Box<Unfit>),
    /// Several of these.
    #[error("{}", lines(.0, ToString::to_string))]
    Several(Vec<LoadError>),
}

/// Both values, or the errors of both.
pub(super) fn both<A, B>(
    a: Result<A, LoadError>,
    b: Result<B, LoadError>,
) -> Result<(A, B), LoadError> {
    match (a, b) {
        (Ok(a), Ok(b)) => Ok((a, b)),
        (Err(a), Err(b)) => Err(LoadError::Several(vec![a, b])),
        (Err(error), Ok(_)) | (Ok(_), Err(error)) => Err(error),
    }
}

fn lines(all: &[LoadError], text: impl Fn(&LoadError) -> String) -> String {
    let all: Vec<String> = all.iter().map(text).collect();
    all.join("\n")
}

/// The values of all parts, or the errors of all parts that have one.
pub(super) fn all_of<T>(
    parts: impl IntoIterator<Item = Result<T, LoadError>>,
) -> Result<Vec<T>, LoadError> {
    let (mut values, mut errors) = (Vec::new(), Vec::new());
    for part in parts {
        match part {
            Ok(value) => values.push(value),
            Err(error) => errors.push(error),
        }
    }
    match (errors.pop(), errors.is_empty()) {
        (None, _) => Ok(values),
        (Some(only), true) => Err(only),
        (Some(last), false) => {
            errors.push(last);
            Err(LoadError::Several(errors))
        }
    }
}

/// An unusable part of a scene.
#[derive(Debug, thiserror::Error)]
#[error("{part}: {fault}")]
pub struct Unfit {
    /// Name of the part.
    pub part: String,
    /// The fault of the part.
    pub fault: Fault,
    placed: SceneError,
}

impl LoadError {
    /// A fault of the part at `key` in the scene's text.
    pub(super) fn new(scene: &Scene, key: &str, part: String, fault: Fault) -> Self {
        Self::at(&scene.origin, key, part, fault)
    }

    /// A fault of the part at `key` in the text of this origin.
    pub(super) fn at(origin: &SceneOrigin, key: &str, part: String, fault: Fault) -> Self {
        let message = format!("{part}: {fault}");
        let problem = SceneProblem::Unfit {
            code: fault.code(),
            message,
            help: fault.help(),
        };
        let placed = origin.error(problem, key);
        Self::Unfit(Box::new(Unfit {
            part,
            fault,
            placed,
        }))
    }

    /// One line with the place, for pipes and logs: the place in the mesh file, or in the scene. A
    /// line for each of several errors.
    #[must_use]
    pub fn terse(&self) -> String {
        match self {
            Self::Read(error) => error.terse(),
            Self::Unfit(unfit) => unfit.placed.terse(),
            Self::Several(all) => lines(all, Self::terse),
        }
    }

    /// This error, or each of several.
    #[must_use]
    pub fn each(&self) -> Vec<&Self> {
        match self {
            Self::Read(_) | Self::Unfit(_) => vec![self],
            Self::Several(all) => all.iter().flat_map(Self::each).collect(),
        }
    }
}

impl Unfit {
    /// The error at its line of the scene.
    #[must_use]
    pub fn scene_error(&self) -> &SceneError {
        &self.placed
    }

    /// One line without a place, for a scene without a text.
    #[must_use]
    pub fn without_place(&self) -> String {
        format!(
            "error[{}]: {self}; {}",
            self.fault.code(),
            self.fault.help()
        )
    }
}
