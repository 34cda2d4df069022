//! Repair and remeshing of the meshes of a draft: what each needs, and why.

use pliant::format::counted;
use pliant::mesh::measures::Aabb;
use pliant::mesh::{
    FindingKind, Health, LONGEST_RIM, RepairChange, RepairOptions, RepairStep, Topology,
    TriangleMesh, refine, repair,
};

use super::mm;

/// A mesh is even if its shortest edges are not shorter than this share of the median one: one edge in
/// [`SHORTEST`].
const EVEN: f64 = 0.5;
const SHORTEST: usize = 20;

/// Number of vertices of an uneven or a fine mesh after remeshing: a muscle then runs for some ten seconds, and
/// the shape is kept to a tenth of an edge.
const REMESHED: f64 = 2500.0;

/// Segmentations have ten times as many vertices, at the distance of their voxels. What has more than
/// this many times [`REMESHED`] is remeshed.
const MANY: f64 = 2.0;

/// A piece beside the largest is a speck, as noise of a segmentation leaves it, if its longest side is below
/// this share of that of the largest.
const SPECK: f64 = 0.01;

/// Greatest length of a loop around a handle that is cut before remeshing, in edges after it. A loop of
/// three edges is the shortest that a mesh can have.
const HANDLE: f64 = 4.0;

/// The repair of a mesh.
#[derive(Debug)]
pub struct Mended {
    /// The defects.
    pub why: String,
    pub options: RepairOptions,
}

/// The repair of a mesh that a simulation does not accept as it is; `None` for a sound mesh.
///
/// # Errors
/// The defects that no repair ends.
pub fn mended(mesh: &TriangleMesh) -> Result<Option<Mended>, String> {
    let health = Health::of(mesh);
    if health.is_fit() {
        let options = RepairOptions {
            keep_largest: true,
            ..RepairOptions::default()
        };
        return Ok(specks(mesh).map(|why| Mended { why, options }));
    }
    let defects = |health: &Health| -> Vec<String> {
        let refused = health.findings.iter().filter(|f| f.kind.refuses());
        refused.map(|f| f.message.clone()).collect()
    };
    let why = defects(&health).join("; ");
    let is_open = health
        .findings
        .iter()
        .any(|f| f.kind == FindingKind::OpenBoundary);
    let holes = if is_open { LONGEST_RIM } else { 0 };
    let mut left = Vec::new();
    for keep_largest in [specks(mesh).is_some(), true] {
        let options = RepairOptions {
            close_holes: holes,
            keep_largest,
            ..RepairOptions::default()
        };
        let after = Health::of(&repair(mesh, &[], &options).mesh);
        if after.is_fit() {
            return Ok(Some(Mended { why, options }));
        }
        left = defects(&after);
    }
    Err(left.join("; "))
}

/// The specks beside the largest piece of a mesh, in words; `None` if there are none, or if another piece
/// is no speck.
fn specks(mesh: &TriangleMesh) -> Option<String> {
    let pieces = Topology::new(mesh).components();
    let mut corners = vec![Vec::new(); pieces.count];
    for t in &mesh.triangles {
        let piece = pieces.labels[t[0] as usize] as usize;
        corners[piece].extend(t.map(|v| mesh.vertices[v as usize]));
    }
    let sides = corners.iter().map(|of| Aabb::of_points(of).extents().max());
    let mut sides: Vec<f64> = sides.collect();
    sides.sort_by(f64::total_cmp);
    let (largest, others) = sides.split_last()?;
    let second = others.last().filter(|side| **side < SPECK * largest)?;
    let count = counted(others.len(), "speck", "specks");
    let share = 100.0 * second / largest;
    Some(format!("{count} of at most {share:.1e} % of its length"))
}

/// Why a mesh is remeshed, and to which edges [m]; `None` for an even mesh of a number of vertices with
/// which a run ends soon. The shortest edges of an uneven one would need the shortest steps, and its
/// longest ones bend in facets.
pub(super) fn remeshed(mesh: &TriangleMesh) -> Option<(String, f64)> {
    let edges = Edges::of(mesh)?;
    let [short, median] = [SHORTEST, 2].map(|part| edges.part(part));
    let count = mesh.vertices.len();
    let is_even = short >= EVEN * median;
    if is_even && count as f64 <= MANY * REMESHED {
        return None;
    }
    let edge = edge_of(mesh);
    let why = match is_even {
        true => many(count),
        false => format!(
            "the file has edges of {} to {} mm, half of them below {} mm; without this line they stay",
            mm(edges.0[0]),
            mm(edges.0[edges.0.len() - 1]),
            mm(median)
        ),
    };
    (edge > 0.0).then_some((why, edge))
}

/// The length of edges of a mesh after remeshing [m].
pub(super) fn edge_of(mesh: &TriangleMesh) -> f64 {
    // Of as many vertices in equilateral triangles.
    (2.0 * mesh.area() / (3.0_f64.sqrt() * REMESHED)).sqrt()
}

/// Why a bone is remeshed to edges of this length [m], and the length; `None` for one that has not many
/// more vertices.
pub(super) fn coarser(bone: &TriangleMesh, edge: f64) -> Option<(String, f64)> {
    Edges::of(bone)?;
    let count = bone.vertices.len();
    let after = 2.0 * bone.area() / (3.0_f64.sqrt() * edge * edge);
    let is_fine = count as f64 > MANY * after.max(REMESHED);
    (edge > 0.0 && edge.is_finite() && is_fine).then(|| (many(count), edge))
}

fn many(count: usize) -> String {
    format!(
        "the file has {count} vertices; without this line they stay, and a run takes the longer"
    )
}

/// The lengths of all edges [m] of a mesh that can be remeshed, sorted.
pub(super) struct Edges(Vec<f64>);

impl Edges {
    pub(super) fn of(mesh: &TriangleMesh) -> Option<Self> {
        let topology = Topology::new(mesh);
        let is_fit = topology.is_oriented() && topology.non_manifold_vertices(mesh).is_empty();
        let mut lengths = topology.edge_lengths(mesh);
        if !is_fit || lengths.is_empty() || !lengths.iter().all(|l| l.is_finite()) {
            return None;
        }
        lengths.sort_by(f64::total_cmp);
        Some(Self(lengths))
    }

    /// A quantile: one edge in `part` is shorter.
    pub(super) fn part(&self, part: usize) -> f64 {
        self.0[self.0.len() / part]
    }
}

/// The surface that a run simulates, of a mesh that is remeshed to such edges [m] after handles within loops
/// of some length [m] are cut. `None` if it cannot be remeshed.
pub(super) fn simulated(mesh: &TriangleMesh, edge: f64, cut: Option<f64>) -> Option<TriangleMesh> {
    let options = RepairOptions {
        cut_handles: cut.unwrap_or_default(),
        ..RepairOptions::default()
    };
    let repaired = cut.map(|_| repair(mesh, &[], &options).mesh);
    let refined = refine(repaired.as_ref().unwrap_or(mesh), edge);
    refined.ok().map(|refined| refined.mesh)
}

/// What is cut of a mesh before it is remeshed to such edges [m], and how long loops around it may be [m]:
/// handles that so long edges cannot follow. `None` if there are none.
pub(super) fn cut(mesh: &TriangleMesh, edge: f64) -> Option<(String, f64)> {
    let length = HANDLE * edge;
    let options = RepairOptions {
        cut_handles: length,
        ..RepairOptions::default()
    };
    let repaired = repair(mesh, &[], &options);
    let is_cut = |change: &&RepairChange| change.step == RepairStep::CutHandles;
    let count = repaired.changes.iter().find(is_cut)?.count;
    let handles = counted(count, "handle", "handles");
    let why = format!("{handles}, as noise leaves them, with edges too long to follow them");
    Health::of(&repaired.mesh).is_fit().then_some((why, length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use pliant::mesh::shapes::icosphere;

    #[test]
    fn an_uneven_or_a_fine_mesh_is_remeshed_and_another_is_not() {
        let even = icosphere(0.02, 3);
        assert_eq!(remeshed(&even), None);
        // As fine as a segmentation.
        let (why, edge) = remeshed(&icosphere(0.02, 5)).expect("fine");
        let vertices = 2.0 * even.area() / (3.0_f64.sqrt() * edge * edge);
        assert!((vertices / REMESHED - 1.0).abs() <= 0.01, "{vertices}");
        assert!(why.starts_with("the file has 10242 vertices"), "{why}");
        // One side is drawn together: triangles of a tenth of the size.
        let mut drawn = even.clone();
        for v in drawn.vertices.iter_mut().filter(|v| v.z > 0.012) {
            (v.x, v.y) = (0.1 * v.x, 0.1 * v.y);
        }
        let (why, edge) = remeshed(&drawn).expect("uneven");
        let vertices = 2.0 * drawn.area() / (3.0_f64.sqrt() * edge * edge);
        assert!((vertices - REMESHED).abs() <= 1e-9 * REMESHED, "{vertices}");
        assert!(why.contains("without this line"), "{why}");
        // Control: what no remeshing can take stays as it is.
        drawn.triangles.push(drawn.triangles[0]);
        assert_eq!(remeshed(&drawn), None);
    }

    #[test]
    fn a_bone_as_fine_as_a_scan_gets_the_edges_of_the_finest_muscle() {
        let mut bone = icosphere(0.05, 6);
        let (why, edge) = coarser(&bone, 2e-3).expect("40,962 vertices");
        assert!(
            edge == 2e-3 && why.starts_with("the file has 40962"),
            "{why}"
        );
        // Controls: almost as fine as the muscles, few vertices, no muscle with edges, and what no
        // remeshing takes.
        assert_eq!(coarser(&bone, 9e-4), None);
        assert_eq!(coarser(&icosphere(0.05, 4), 2e-2), None);
        assert_eq!(coarser(&bone, f64::INFINITY), None);
        bone.triangles[0].swap(0, 1);
        assert_eq!(coarser(&bone, 2e-3), None);
    }

    #[test]
    fn a_mesh_is_mended_as_little_as_it_needs() {
        let whole = icosphere(0.02, 2);
        assert!(mended(&whole).expect("sound").is_none());
        let mut open = whole.clone();
        open.triangles.pop();
        let options = mended(&open).expect("closed").expect("a repair").options;
        assert!(options.close_holes > 0 && !options.keep_largest);
        assert!(mended(&TriangleMesh::default()).is_err(), "nothing to mend");
        // A speck goes; a second belly stays.
        let with_another = |radius: f64| {
            let mut both = whole.clone();
            let (other, first) = (icosphere(radius, 1), both.vertices.len() as u32);
            let away = Vector3::new(0.05, 0.0, 0.0);
            both.vertices
                .extend(other.vertices.iter().map(|v| v + away));
            both.triangles
                .extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
            mended(&both).expect("sound")
        };
        let speck = with_another(1e-5).expect("a speck");
        assert!(
            speck.options.keep_largest && speck.why.starts_with("1 speck of at most 5.0e-2 %"),
            "{}",
            speck.why
        );
        assert!(with_another(0.005).is_none());
    }
}
