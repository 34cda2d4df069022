//! A defect of a surface: code, place and repair.

use std::fmt;

use super::{Health, Parts};
use crate::format::counted;
use crate::mesh::{TriangleMesh, nesting};

/// Kinds of defects. `E`: a simulation rejects the surface; `W`: a warning only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum FindingKind {
    /// No triangle at all.
    NoTriangles,
    /// An edge with more than two triangles.
    NonManifoldEdge,
    /// Neighbouring triangles have opposite orientations.
    InconsistentOrientation,
    /// An edge with one triangle.
    OpenBoundary,
    /// The enclosed volume is not positive.
    InsideOut,
    /// A triangle repeats another one.
    DuplicateTriangles,
    /// A vertex has no triangle.
    UnusedVertices,
    /// Vertices coincide.
    DuplicateVertices,
    /// Triangles intersect where they are not joined.
    SelfIntersection,
    /// Triangles with an angle below 1 degree.
    Slivers,
    /// The corners of a triangle are collinear.
    ZeroArea,
    /// Surfaces that touch in a point.
    NonManifoldVertex,
    /// The surface has more than one component.
    SeveralComponents,
}

impl FindingKind {
    /// All kinds, in the order of the report.
    pub const ALL: [Self; 13] = [
        Self::NoTriangles,
        Self::NonManifoldEdge,
        Self::InconsistentOrientation,
        Self::OpenBoundary,
        Self::InsideOut,
        Self::DuplicateTriangles,
        Self::UnusedVertices,
        Self::DuplicateVertices,
        Self::SelfIntersection,
        Self::Slivers,
        Self::ZeroArea,
        Self::NonManifoldVertex,
        Self::SeveralComponents,
    ];

    /// The code, as in `docs/formats.md`.
    pub fn code(self) -> &'static str {
        match self {
            Self::NoTriangles => "E046",
            Self::NonManifoldEdge => "E030",
            Self::InconsistentOrientation => "E031",
            Self::OpenBoundary => "E032",
            Self::InsideOut => "E038",
            Self::DuplicateTriangles => "W004",
            Self::UnusedVertices => "W005",
            Self::DuplicateVertices => "W006",
            Self::SelfIntersection => "W007",
            Self::Slivers => "W009",
            Self::ZeroArea => "W011",
            Self::NonManifoldVertex => "W012",
            Self::SeveralComponents => "W013",
        }
    }

    /// True if a simulation rejects a muscle with this defect.
    pub fn refuses(self) -> bool {
        self.code().starts_with('E')
    }

    /// The repair of this defect.
    pub fn repair(self) -> Repair {
        match self {
            Self::NoTriangles => Repair::ByHand("export the surface with its triangles"),
            Self::NonManifoldEdge => Repair::Automatic("takes the surfaces apart there"),
            Self::InconsistentOrientation => Repair::Automatic("turns the fewer triangles round"),
            Self::OpenBoundary => Repair::CloseHoles,
            Self::InsideOut => Repair::Automatic("turns every closed piece outward"),
            Self::DuplicateTriangles => {
                Repair::Automatic("keeps one of each, and none where two face each other")
            }
            Self::UnusedVertices => Repair::Automatic("drops them"),
            Self::DuplicateVertices => {
                Repair::Automatic("joins those on rims; the others belong to surfaces that touch")
            }
            Self::SelfIntersection => Repair::ByHand(
                "move the parts apart in a mesh editor; a simulation takes it as it is",
            ),
            Self::Slivers => Repair::ByHand("a simulation with `edge_length` remeshes them"),
            Self::ZeroArea => {
                Repair::Automatic("flips or collapses them away, which moves nothing")
            }
            Self::NonManifoldVertex => {
                Repair::Automatic("gives each surface a vertex of its own there")
            }
            Self::SeveralComponents => Repair::KeepLargest,
        }
    }
}

/// The repair of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repair {
    /// [`repair`](crate::mesh::repair::repair) does this.
    Automatic(&'static str),
    /// Repair joins rims whose vertices coincide; with the option to close holes it closes the others.
    CloseHoles,
    /// Repair with the option to keep the largest piece.
    KeepLargest,
    /// A person has to do this.
    ByHand(&'static str),
}

impl fmt::Display for Repair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Automatic(does) => write!(f, "repair {does}"),
            Self::CloseHoles => f.write_str(
                "repair joins rims whose vertices coincide; closing holes closes the others",
            ),
            Self::KeepLargest => f.write_str("keeping the largest piece drops all others"),
            Self::ByHand(what) => f.write_str(what),
        }
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for FindingKind {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.code())
    }
}

/// Place of the first occurrence; indices start at 0 in the order of the file.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FindingPlace {
    /// Vertices.
    pub vertices: Vec<u32>,
    /// Triangles.
    pub triangles: Vec<u32>,
    /// A point at the place, in the unit of the coordinates.
    pub point: Option<[f64; 3]>,
}

/// A defect with its place.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Finding {
    /// Kind of the defect.
    #[cfg_attr(feature = "serde", serde(rename = "code"))]
    pub kind: FindingKind,
    /// Number of occurrences.
    pub count: usize,
    /// Description with the place of the first occurrence.
    pub message: String,
    /// Place of the first occurrence.
    pub place: FindingPlace,
}

/// Greatest number of indices in a message.
const SHOWN: usize = 6;

fn list(indices: &[u32]) -> String {
    let shown: Vec<String> = indices.iter().take(SHOWN).map(u32::to_string).collect();
    let more = indices.len().saturating_sub(SHOWN);
    let rest = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    shown.join(", ") + &rest
}

/// All digits of a coordinate, without hundreds of zeros.
fn coordinate(c: f64) -> String {
    if c == 0.0 || (1e-6..1e16).contains(&c.abs()) {
        format!("{c}")
    } else {
        format!("{c:e}")
    }
}

struct Found<'a> {
    mesh: &'a TriangleMesh,
    findings: Vec<Finding>,
}

impl Found<'_> {
    /// Adds a finding if the count is positive; the message is `what`, then the place.
    fn add(
        &mut self,
        kind: FindingKind,
        count: usize,
        what: String,
        vertices: Vec<u32>,
        triangles: Vec<u32>,
    ) {
        if count == 0 {
            return;
        }
        let first = vertices
            .first()
            .copied()
            .or_else(|| Some(self.mesh.triangles[*triangles.first()? as usize][0]));
        let point: Option<[f64; 3]> = first.map(|v| self.mesh.vertices[v as usize].into());
        let at = point.map_or_else(String::new, |p| {
            format!(" at ({})", p.map(coordinate).join(", "))
        });
        let message = format!("{what}{at}");
        self.findings.push(Finding {
            kind,
            count,
            message,
            place: FindingPlace {
                vertices,
                triangles,
                point,
            },
        });
    }

    /// Adds a finding about edges.
    fn edges(&mut self, kind: FindingKind, parts: &Parts, edges: &[u32], what: &str) {
        let Some(&edge) = edges.first() else { return };
        let [a, b] = parts.topology.edges[edge as usize];
        let triangles = parts.topology.triangles_of_edge(edge as usize).to_vec();
        let many = counted(edges.len(), "edge", "edges");
        let text = format!(
            "{many} {what}; the first: {a}-{b} of triangles {}",
            list(&triangles)
        );
        self.add(kind, edges.len(), text, vec![a, b], triangles);
    }

    /// Adds a finding about triangles.
    fn triangles(&mut self, kind: FindingKind, triangles: &[u32], what: &str) {
        let many = counted(triangles.len(), "triangle", "triangles");
        let first: Vec<u32> = triangles.iter().take(1).copied().collect();
        self.add(
            kind,
            triangles.len(),
            format!("{many} {what}: {}", list(triangles)),
            Vec::new(),
            first,
        );
    }

    /// Adds a finding about vertices.
    fn vertices(&mut self, kind: FindingKind, vertices: &[u32], what: &str) {
        let many = counted(vertices.len(), "vertex", "vertices");
        let first: Vec<u32> = vertices.iter().take(1).copied().collect();
        self.add(
            kind,
            vertices.len(),
            format!("{many} {what}: {}", list(vertices)),
            first,
            Vec::new(),
        );
    }
}

/// All defects, in the order of [`FindingKind::ALL`].
pub(super) fn all(parts: &Parts, mesh: &TriangleMesh, health: &Health) -> Vec<Finding> {
    let mut found = Found {
        mesh,
        findings: Vec::new(),
    };
    let none = usize::from(mesh.triangles.is_empty());
    found.add(
        FindingKind::NoTriangles,
        none,
        "there are no triangles".into(),
        Vec::new(),
        Vec::new(),
    );
    let topology = &parts.topology;
    found.edges(
        FindingKind::NonManifoldEdge,
        parts,
        &topology.non_manifold_edges(),
        "with more than two triangles",
    );
    orientation(&mut found, parts);
    rims(&mut found, parts);
    inside_out(&mut found, parts, health);
    let extra: Vec<u32> = parts
        .duplicates
        .iter()
        .flat_map(|g| g[1..].iter().copied())
        .collect();
    found.triangles(
        FindingKind::DuplicateTriangles,
        &extra,
        "with the same corners as another",
    );
    found.vertices(
        FindingKind::UnusedVertices,
        &parts.unused,
        "that no triangle names",
    );
    let twice = |v: &u32| parts.first_in_place[*v as usize] != *v;
    let doubled: Vec<u32> = (0..mesh.vertices.len() as u32).filter(twice).collect();
    found.vertices(
        FindingKind::DuplicateVertices,
        &doubled,
        "in the place of another",
    );
    crossing(&mut found, parts);
    found.triangles(
        FindingKind::Slivers,
        &parts.slivers,
        "with an angle below 1 degree",
    );
    found.triangles(FindingKind::ZeroArea, &parts.zero_area, "without area");
    found.vertices(
        FindingKind::NonManifoldVertex,
        &parts.non_manifold_vertices,
        "in which surfaces touch",
    );
    if health.components > 1 {
        let what = format!("{} separate pieces", health.components);
        found.add(
            FindingKind::SeveralComponents,
            health.components,
            what,
            Vec::new(),
            Vec::new(),
        );
    }
    found.findings
}

fn orientation(found: &mut Found<'_>, parts: &Parts) {
    let turned = parts.orientation.turn.iter().filter(|t| **t).count();
    let turned = counted(turned, "triangle", "triangles");
    let what = match parts.orientation.one_sided {
        Some(_) => "run the same way by both triangles, on a surface with one side only".to_owned(),
        None => format!("run the same way by both triangles, {turned} to be turned round"),
    };
    found.edges(
        FindingKind::InconsistentOrientation,
        parts,
        &parts.inconsistent,
        &what,
    );
}

fn rims(found: &mut Found<'_>, parts: &Parts) {
    let Some(first) = parts.rims.first() else {
        return;
    };
    let edges: usize = parts
        .rims
        .iter()
        .map(|r| r.vertices.len() - usize::from(!r.closed))
        .sum();
    let what = format!(
        "{} with one triangle, in {}; the first rim has {}, from vertex {}",
        counted(edges, "edge", "edges"),
        counted(parts.rims.len(), "rim", "rims"),
        counted(first.vertices.len(), "vertex", "vertices"),
        first.vertices[0],
    );
    found.add(
        FindingKind::OpenBoundary,
        edges,
        what,
        first.vertices.iter().take(SHOWN).copied().collect(),
        Vec::new(),
    );
}

fn inside_out(found: &mut Found<'_>, parts: &Parts, health: &Health) {
    // The volume is an inside only for a closed, consistently oriented surface.
    let decided = parts.topology.is_closed() && parts.topology.is_oriented();
    if !decided {
        return;
    }
    let mesh = found.mesh;
    let inward = nesting::inward(&mesh.vertices, &mesh.triangles, &parts.topology);
    if let (Some(piece), true) = (inward.first(), health.components > 1) {
        let what = format!(
            "{} of {} closed pieces turned inward, the first with a volume of {:e}",
            inward.len(),
            health.components,
            piece.volume,
        );
        let triangles = piece.triangles.iter().take(1).map(|t| *t as u32).collect();
        found.add(
            FindingKind::InsideOut,
            inward.len(),
            what,
            Vec::new(),
            triangles,
        );
        return;
    }
    if health.volume <= 0.0 || health.volume.is_nan() {
        let what = match health.volume {
            volume if volume < 0.0 => {
                format!("the enclosed volume is {volume:e}: triangles are turned inward")
            }
            _ => "it encloses no volume".to_owned(),
        };
        found.add(FindingKind::InsideOut, 1, what, Vec::new(), Vec::new());
    }
}

fn crossing(found: &mut Found<'_>, parts: &Parts) {
    let crossings = &parts.crossings;
    let least = if crossings.complete { "" } else { "at least " };
    let many = counted(
        crossings.count,
        "pair of triangles meets",
        "pairs of triangles meet",
    );
    let unfinished =
        "too many triangles lie in one place to search for crossings among all of them".to_owned();
    match crossings.pairs.first() {
        Some(&[s, t]) => {
            let what = format!("{least}{many} where not joined; the first: {s} and {t}");
            found.add(
                FindingKind::SelfIntersection,
                crossings.count,
                what,
                Vec::new(),
                vec![s, t],
            );
        }
        None if !crossings.complete => found.add(
            FindingKind::SelfIntersection,
            1,
            unfinished,
            Vec::new(),
            Vec::new(),
        ),
        None => {}
    }
}
