//! Remeshing to uniform, well-shaped triangles of a target edge length on the same surface.
//!
//! Each round has the four usual operations: split of long edges, collapse of short edges, edge
//! flips towards larger angles and valence 6, and tangential smoothing. An operation is rejected if
//! the new triangles would leave the original surface, or if points of the original (its vertices
//! and points of its folded edges) would leave the new surface.

mod apart;
mod working;

use std::f64::consts::TAU;

use super::closest::SurfaceTree;
use super::topology::{NONE, Topology};
use super::{MeshError, TriangleMesh};
use crate::progress::{Progress, Silent};
use apart::Outcome;
use working::{Limits, Working, smallest_sine};

/// Longest edge after a split, in target edge lengths.
const LONG: f64 = 4.0 / 3.0;
/// Edges shorter than this are collapsed, in target edge lengths.
const SHORT: f64 = 0.8;
/// Longest edge after a flip or a repair, in target edge lengths.
const LONGEST: f64 = 1.5;
/// Edges shorter than this are repaired even at the cost of deviation, in target edge lengths.
const SHORTEST: f64 = 0.4;
/// Allowed deviation in rounds, in target edge lengths.
const DEVIATION: f64 = 0.05;
/// Allowed deviation in each pass of repair, in target edge lengths.
const REPAIR_DEVIATIONS: [f64; 8] = [0.05, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1, 0.1];
/// Triangles with a smaller sine of their smallest angle are repaired: 25 degrees.
const REPAIR_SINE: f64 = 0.422_618;
/// Least sine of triangles after the collapse of an edge that is far too short: 17 degrees.
const LEAST_SINE: f64 = 0.292_372;
/// A vertex this near to its smoothed position stays, in target edge lengths.
const SETTLED: f64 = 0.03;
/// Edges shorter than this are collapsed at the end at a greater cost of deviation, in target edge lengths:
/// such as what is left of a hair. Steps follow the shortest edges of a mesh.
const TINY: f64 = 0.25;
/// Allowed deviation in each pass of that, in target edge lengths.
const TINY_DEVIATIONS: [f64; 3] = [0.15, 0.25, 0.5];
/// Least sine of triangles after such a collapse: 6 degrees.
const TINY_SINE: f64 = 0.104_528;
/// What is thinner than a ring of this length is a hair, in target edge lengths, and its end is cut off, of
/// at most this area, in their squares.
const HAIR: f64 = 1.0;
const HAIR_AREA: f64 = 1.0;
/// Rounds end when there is less than one change per this number of triangles; repair does the
/// rest.
const ENOUGH: usize = 200;
/// Greatest number of rounds of all four operations.
const ROUNDS: usize = 6;
/// Greatest number of triangles [1]; a mesh of this size needs about 2 GB during remeshing.
const MOST_TRIANGLES: f64 = 8e6;
/// Greatest number of times that places which cross are cut out.
const CUTS: usize = 3;
/// Number of edges, vertices or triangles between two checks for cancellation.
const QUERIES: usize = 1000;

/// A remeshed surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// The new mesh.
    pub mesh: TriangleMesh,
    /// Measures of the result.
    pub report: RefineReport,
}

/// Measures of a remeshed surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineReport {
    /// Longest edge [m].
    pub max_edge: f64,
    /// Shortest edge [m].
    pub min_edge: f64,
    /// Smallest angle of a triangle [rad].
    pub min_angle: f64,
    /// Largest distance between the two surfaces, in both directions [m].
    ///
    /// It is measured from samples of the new surface to the original, and from vertices and folded
    /// edges of the original to the new surface.
    pub deviation: f64,
    /// Relative change of the enclosed volume; zero for an open mesh.
    pub volume_change: f64,
}

/// Error of [`refine`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RefineError {
    /// The target edge length is not a positive number.
    #[error("the target edge length must be a positive number, not {0}")]
    EdgeLength(f64),
    /// The mesh has no triangles.
    #[error("the mesh has no triangles")]
    Empty,
    /// An index or a coordinate is invalid.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Edges with more than two triangles, or vertices where surfaces touch.
    #[error(
        "the mesh is not manifold: {edges} edges have more than two triangles, {vertices} vertices join surfaces"
    )]
    NotManifold {
        /// Number of such edges.
        edges: usize,
        /// Number of such vertices.
        vertices: usize,
    },
    /// Neighbouring triangles have opposite orientations.
    #[error("the triangles of the mesh are not consistently oriented")]
    NotOriented,
    /// The target edge length is too small for the size of the surface.
    #[error("about {triangles:.3e} triangles would be needed, the most allowed is {most:.0e}")]
    TooManyTriangles {
        /// Estimated number.
        triangles: f64,
        /// Largest allowed number.
        most: f64,
    },
    /// The caller stopped the remeshing.
    #[error("stopped")]
    Stopped,
}

/// Remeshes a manifold, oriented surface to edges of about `edge_length` [m].
///
/// A closed mesh stays closed. A boundary keeps its vertices: its edges are split, never collapsed.
/// Orientation, components and Euler characteristic are unchanged. The surface keeps shorter edges
/// at details that triangles of this edge length cannot follow within a tenth of it; edges below a quarter
/// of it may deviate by half of it, and are collapsed where they can be. Where two sides of a
/// thin part would cross, they are drawn apart by up to a fifth of an edge, and what is thinner still is
/// cut off, as a hair; the deviation tells it. The result is deterministic.
///
/// # Errors
/// A bad edge length, an empty, non-manifold or inconsistently oriented mesh, too many triangles.
pub fn refine(mesh: &TriangleMesh, edge_length: f64) -> Result<Refined, RefineError> {
    refine_with(mesh, edge_length, &Silent)
}

/// The same as [`refine`]; calls `go_on` every thousand edges, vertices or triangles and stops when
/// it returns false.
///
/// # Errors
/// Those of [`refine`], or [`RefineError::Stopped`].
pub fn refine_with(
    mesh: &TriangleMesh,
    edge_length: f64,
    progress: &dyn Progress,
) -> Result<Refined, RefineError> {
    refine_patch(mesh, edge_length, progress).map(|(refined, _)| refined)
}

/// The same as [`refine_while`], and for each vertex of the result the equal vertex of the
/// original's boundary, or [`NONE`]. A patch cut out of a surface can thus be put back. Vertices
/// between two of these lie on the straight edge that they split.
pub(crate) fn refine_patch(
    mesh: &TriangleMesh,
    edge_length: f64,
    progress: &dyn Progress,
) -> Result<(Refined, Vec<u32>), RefineError> {
    let topology = checked(mesh, edge_length)?;
    let original = SurfaceTree::new(&mesh.vertices, &mesh.triangles);
    let (mut refined, names, mut drift) =
        remeshed(mesh, &topology, &original, edge_length, progress)?;
    // What crosses in the original is a finding about it, and stays.
    let is_new = apart::crosses(&refined) && !apart::crosses(mesh);
    for _ in 0..if is_new { CUTS } else { 0 } {
        match apart::part(&mut refined, edge_length) {
            Outcome::Clear => break,
            Outcome::Parted => {}
            Outcome::Left => {
                let Some(cut) = apart::without(&refined, edge_length) else {
                    break;
                };
                let topology = Topology::new(&cut);
                let tree = SurfaceTree::new(&cut.vertices, &cut.triangles);
                (refined, _, _) = remeshed(&cut, &topology, &tree, edge_length, progress)?;
            }
        }
        drift = apart::farthest(mesh, &refined);
    }
    let report = measure(mesh, &original, &refined, drift, edge_length, progress)
        .ok_or(RefineError::Stopped)?;
    let mut origin = vec![NONE; refined.vertices.len()];
    for v in topology
        .boundary_edges()
        .into_iter()
        .flat_map(|e| topology.edges[e as usize])
    {
        if let Some(kept) = origin.get_mut(names[v as usize] as usize) {
            *kept = v;
        }
    }
    Ok((
        Refined {
            mesh: refined,
            report,
        },
        origin,
    ))
}

/// The new mesh, the name of each vertex of the working one in it, and the greatest deviation of the
/// original's points.
type Remeshed = (TriangleMesh, Vec<u32>, f64);

fn remeshed(
    mesh: &TriangleMesh,
    topology: &Topology,
    original: &SurfaceTree,
    edge_length: f64,
    progress: &dyn Progress,
) -> Result<Remeshed, RefineError> {
    let mut working = Working::new(mesh, topology, original, edge_length, progress);
    remesh(&mut working, edge_length);
    if working.is_stopped() {
        return Err(RefineError::Stopped);
    }
    let has_cut = working.has_cut;
    let (refined, names, drift) = working.finish();
    let drift = if has_cut {
        apart::farthest(mesh, &refined)
    } else {
        drift
    };
    Ok((refined, names, drift))
}

fn remesh(working: &mut Working<'_>, edge_length: f64) {
    split_long(working, LONG * edge_length);
    for _ in 0..ROUNDS {
        let mut changes = split_long(working, LONG * edge_length);
        changes += collapse_short(working, edge_length);
        changes += flip_for_angles(working, edge_length);
        changes += flip_for_valence(working, edge_length);
        smooth(working, edge_length);
        flip_for_angles(working, edge_length);
        smooth(working, edge_length);
        if changes < working.triangles.len() / ENOUGH || working.is_stopped() {
            break;
        }
    }
    repair(working, edge_length);
    collapse_tiny(working, edge_length);
}

fn checked(mesh: &TriangleMesh, edge_length: f64) -> Result<Topology, RefineError> {
    if !(edge_length.is_finite() && edge_length > 0.0) {
        return Err(RefineError::EdgeLength(edge_length));
    }
    if mesh.triangles.is_empty() {
        return Err(RefineError::Empty);
    }
    TriangleMesh::new(mesh.vertices.clone(), mesh.triangles.clone())?;
    let triangles = mesh.area() / (0.25 * 3f64.sqrt() * edge_length * edge_length);
    if triangles > MOST_TRIANGLES {
        return Err(RefineError::TooManyTriangles {
            triangles,
            most: MOST_TRIANGLES,
        });
    }
    let topology = Topology::new(mesh);
    let (edges, vertices) = (
        topology.non_manifold_edges().len(),
        topology.non_manifold_vertices(mesh).len(),
    );
    if edges + vertices > 0 {
        return Err(RefineError::NotManifold { edges, vertices });
    }
    if !topology.is_oriented() {
        return Err(RefineError::NotOriented);
    }
    Ok(topology)
}

fn limits(edge_length: f64) -> Limits {
    Limits {
        deviation: DEVIATION * edge_length,
        longest: LONG * edge_length,
        sine: REPAIR_SINE,
    }
}

/// Splits edges longer than `longest`, longest first, until there are none. Returns the number of
/// splits.
fn split_long(working: &mut Working<'_>, longest: f64) -> usize {
    let mut splits = 0;
    loop {
        let edges = working.edges_by_length(|length| length > longest);
        if edges.is_empty() {
            return splits;
        }
        splits += edges.len();
        // A split changes no other edge, so the list stays valid.
        for &(_, a, b) in edges.iter().rev() {
            if !working.goes_on() {
                return splits;
            }
            working.split(a, b);
        }
    }
}

fn collapse_short(working: &mut Working<'_>, edge_length: f64) -> usize {
    let mut collapses = 0;
    let limits = limits(edge_length);
    for (length, a, b) in working.edges_by_length(|length| length < SHORT * edge_length) {
        if !working.goes_on() {
            break;
        }
        // An earlier collapse can remove the edge or move its ends apart; `collapse` checks the
        // former.
        if working.length(a, b) <= length.max(SHORT * edge_length) {
            collapses += usize::from(working.collapse(a, b, &limits));
        }
    }
    collapses
}

fn flip_for_angles(working: &mut Working<'_>, edge_length: f64) -> usize {
    let mut total = 0;
    let limits = Limits {
        longest: LONGEST * edge_length,
        ..limits(edge_length)
    };
    for _ in 0..4 {
        let mut flips = 0;
        for (_, a, b) in working.edges_by_length(|_| true).into_iter().rev() {
            if !working.goes_on() {
                return total;
            }
            // Requires a clear gain, so that equal diagonals do not alternate.
            flips += usize::from(working.flip(a, b, &limits, |_, _, old, new| new > 1.01 * old));
        }
        total += flips;
        if flips == 0 {
            break;
        }
    }
    total
}

fn flip_for_valence(working: &mut Working<'_>, edge_length: f64) -> usize {
    let mut flips = 0;
    let limits = limits(edge_length);
    for (_, a, b) in working.edges_by_length(|_| true).into_iter().rev() {
        if !working.goes_on() {
            break;
        }
        let better = |w: &Working<'_>, quad: [u32; 4], old: f64, new: f64| {
            excess(w, quad, [-1, -1, 1, 1]) < excess(w, quad, [0; 4]) && new >= 0.6 * old
        };
        flips += usize::from(working.flip(a, b, &limits, better));
    }
    flips
}

/// Sum of the squared differences of the valences from regular ones, after a change of the
/// valences.
fn excess(working: &Working<'_>, quad: [u32; 4], change: [i32; 4]) -> i32 {
    let mut sum = 0;
    for (v, change) in quad.into_iter().zip(change) {
        let regular = if working.boundary[v as usize] { 3 } else { 6 };
        sum += (working.rings[v as usize].len() as i32 + change - regular).pow(2);
    }
    sum
}

/// Moves each vertex towards the centroid of its ring, within the surface.
fn smooth(working: &mut Working<'_>, edge_length: f64) {
    let limits = limits(edge_length);
    for v in 0..working.points.len() as u32 {
        if !working.goes_on() {
            return;
        }
        if working.rings[v as usize].is_empty() || working.boundary[v as usize] {
            continue;
        }
        let (p, normal) = (working.points[v as usize], working.normal(v));
        let (mut sum, mut total) = (nalgebra::Vector3::zeros(), 0.0);
        for &t in &working.rings[v as usize] {
            let [a, b, c] = working.corners(t);
            let area = (b - a).cross(&(c - a)).norm();
            sum += ((a - p) + (b - p) + (c - p)) * (area / 3.0);
            total += area;
        }
        if total <= 0.0 {
            continue;
        }
        let step = sum / total;
        let step = step - normal * normal.dot(&step);
        if step.norm() < SETTLED * edge_length {
            continue;
        }
        for share in [1.0, 0.4] {
            let target = working.project(&(p + step * share), &normal);
            if target.is_some_and(|target| working.shift(v, target, &limits)) {
                break;
            }
        }
    }
}

/// Passes over triangles that are still thin or short, with increasing allowed deviation.
fn repair(working: &mut Working<'_>, edge_length: f64) {
    for deviation in REPAIR_DEVIATIONS {
        let limits = Limits {
            deviation: deviation * edge_length,
            longest: LONGEST * edge_length,
            sine: REPAIR_SINE,
        };
        let bad = |w: &Working<'_>, t: u32| w.is_alive(t) && is_bad(w, t, edge_length);
        let all: Vec<u32> = (0..working.triangles.len() as u32)
            .filter(|&t| bad(working, t))
            .collect();
        if all.is_empty() {
            return;
        }
        for t in all {
            if !working.goes_on() {
                return;
            }
            if bad(working, t) {
                repair_one(working, t, edge_length, &limits);
            }
        }
        split_long(working, LONGEST * edge_length);
        flip_for_angles(working, edge_length);
    }
}

/// Collapses edges that are far too short, and cuts off hairs, which have such edges around them.
fn collapse_tiny(working: &mut Working<'_>, edge_length: f64) {
    for deviation in TINY_DEVIATIONS {
        let limits = Limits {
            deviation: deviation * edge_length,
            longest: LONGEST * edge_length,
            sine: TINY_SINE,
        };
        let mut changes = 1;
        while changes > 0 {
            changes = 0;
            for (length, a, b) in working.edges_by_length(|length| length < TINY * edge_length) {
                if !working.goes_on() {
                    return;
                }
                let is_there = working.length(a, b) <= length;
                let (around, area) = (HAIR * edge_length, HAIR_AREA * edge_length * edge_length);
                let done = is_there
                    && (working.collapse(a, b, &limits) || working.cut_hair(a, b, around, area));
                changes += usize::from(done);
            }
        }
    }
}

fn is_bad(working: &Working<'_>, t: u32, edge_length: f64) -> bool {
    let [a, b, c] = working.triangles[t as usize];
    let shortest = working
        .length(a, b)
        .min(working.length(b, c))
        .min(working.length(c, a));
    smallest_sine(&working.corners(t)) < REPAIR_SINE || shortest < SHORTEST * edge_length
}

/// Tries flips of the longest edge, a collapse of the shortest, then shifts of the corners.
fn repair_one(working: &mut Working<'_>, t: u32, edge_length: f64, limits: &Limits) {
    let corners = working.triangles[t as usize];
    let mut sides = [0, 1, 2].map(|k| (corners[k], corners[(k + 1) % 3]));
    sides.sort_by(|&(a, b), &(c, d)| working.length(a, b).total_cmp(&working.length(c, d)));
    let (a, b) = sides[0];
    let freer = Limits {
        sine: LEAST_SINE,
        ..*limits
    };
    if working.length(a, b) < SHORTEST * edge_length && working.collapse(a, b, &freer) {
        return;
    }
    for &(a, b) in sides.iter().rev() {
        if working.flip(a, b, limits, |_, _, old, new| new > 1.01 * old) {
            return;
        }
    }
    for &(a, b) in &sides {
        if working.length(a, b) < SHORT * edge_length && working.collapse(a, b, limits) {
            return;
        }
    }
    for v in corners {
        improve_vertex(working, v, edge_length, limits);
    }
}

/// Moves a vertex to the best of several nearby positions, by the smallest angle of its triangles.
fn improve_vertex(working: &mut Working<'_>, v: u32, edge_length: f64, limits: &Limits) {
    if working.boundary[v as usize] {
        return;
    }
    let normal = working.normal(v);
    let Some(across) = normal.cross(&least_axis(&normal)).try_normalize(0.0) else {
        return;
    };
    let along = normal.cross(&across);
    for radius in [0.3, 0.15, 0.08, 0.04] {
        let p = working.points[v as usize];
        let now = working.sine_with(v, &p);
        let mut places: Vec<_> = (0..8)
            .filter_map(|k| {
                let angle = TAU * f64::from(k) / 8.0;
                let step =
                    (across * libm::cos(angle) + along * libm::sin(angle)) * (radius * edge_length);
                working.project(&(p + step), &normal)
            })
            .map(|q| (working.sine_with(v, &q), q))
            .filter(|&(sine, _)| sine > now)
            .collect();
        places.sort_by(|x, y| y.0.total_cmp(&x.0));
        for (_, q) in places {
            if working.shift(v, q, limits) {
                break;
            }
        }
    }
}

fn least_axis(normal: &nalgebra::Vector3<f64>) -> nalgebra::Vector3<f64> {
    let mut axis = nalgebra::Vector3::zeros();
    axis[normal.iamin()] = 1.0;
    axis
}

fn measure(
    mesh: &TriangleMesh,
    original: &SurfaceTree,
    refined: &TriangleMesh,
    drift: f64,
    edge_length: f64,
    progress: &dyn Progress,
) -> Option<RefineReport> {
    let topology = Topology::new(refined);
    let lengths = topology.edge_lengths(refined);
    let mut deviation = drift;
    for t in 0..refined.triangles.len() {
        if t % QUERIES == 0 && progress.is_stopped() {
            return None;
        }
        let [a, b, c] = refined.corners(t);
        for k in 0..=4 {
            for j in 0..=4 - k {
                let p = a + (b - a) * (f64::from(k) / 4.0) + (c - a) * (f64::from(j) / 4.0);
                // Within one target length the search is short and nearly always sufficient.
                let near = original
                    .closest(&p, edge_length)
                    .or_else(|| original.closest(&p, f64::INFINITY));
                deviation = deviation.max(near.map_or(0.0, |c| c.distance));
            }
        }
    }
    let before = mesh.volume();
    let volume_change = if topology.is_closed() && before != 0.0 {
        (refined.volume() - before) / before
    } else {
        0.0
    };
    Some(RefineReport {
        max_edge: lengths.iter().copied().fold(0.0, f64::max),
        min_edge: lengths.iter().copied().fold(f64::INFINITY, f64::min),
        min_angle: refined
            .smallest_angles()
            .into_iter()
            .fold(f64::INFINITY, f64::min),
        deviation,
        volume_change,
    })
}

#[cfg(test)]
mod tests;
