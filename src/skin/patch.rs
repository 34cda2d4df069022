//! The part of a skin that an implant needs, extracted and refined.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};

use super::SkinError;
use super::plan::MOST;
use super::region::Region;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::orientation::Orientation;
use crate::mesh::topology::NONE;
use crate::mesh::{RefineError, Topology, TriangleMesh, refine_patch};
use crate::progress::Progress;

/// Radius of the refined patch relative to that of the region.
pub(super) const MARGIN: f64 = 1.25;

/// Skin is not refined if its median edge is at most this multiple of the target length.
const ENOUGH: f64 = 1.25;

/// Least alignment of normals away from the centre, relative to that of a sphere, for which skin
/// surrounds its centre.
const ROUND: f64 = 0.02;

/// Area per vertex of equilateral triangles, relative to the squared edge length.
pub(super) const EVEN: f64 = 0.866;

/// Greatest number of vertices of a patch relative to that of a region. The patch extends 1.25
/// times as far, plus the size of the original triangles, which [`super::coarse`] limits to half of
/// a region's radius: (1.25 + 0.5)^2 = 3.1 times, and folds.
const LARGER: f64 = 4.0;

/// Parameters of the extraction from a skin.
pub(super) struct Patch<'a> {
    pub skin: &'a TriangleMesh,
    /// For each implant a vertex near its centre, the centre [m], and the least radius of the patch
    /// [m].
    pub places: Vec<(u32, Point3<f64>, f64)>,
    /// Target edge length [m].
    pub edge: f64,
    pub obstacles: &'a [TriangleMesh],
}

/// An extracted part of a skin.
pub(super) struct TakenOut {
    pub mesh: TriangleMesh,
    /// All other triangles of the skin.
    pub outside: Vec<u32>,
    /// The skin vertex of each vertex; [`NONE`] for a vertex of the patch only.
    pub origin: Vec<u32>,
    /// Boundary edges of the skin, each with the lower end first; the rest of the part's boundary
    /// is the cut.
    pub border: BTreeSet<[u32; 2]>,
}

impl Patch<'_> {
    /// The skin about the implant with a margin, oriented, and refined where it is coarse.
    pub fn taken_out(&self, progress: &dyn Progress) -> Result<TakenOut, SkinError> {
        let Self {
            skin,
            places,
            edge,
            obstacles,
        } = self;
        let (skin, edge) = (*skin, *edge);
        let topology = Topology::new(skin);
        let mut all = BTreeSet::new();
        for (seed, centre, radius) in places {
            let near = |v: u32| (skin.vertices[v as usize] - centre).norm() <= radius + 2.0 * edge;
            all.extend(Region::around(skin, &topology, *seed, near).triangles);
        }
        let part = Region::of(skin, all.into_iter().collect());
        let centre = places[0].1;
        let (mut mesh, mut origin) = (part.mesh, part.vertices.clone());
        // Tests the skin, not the part: the cut of the part can touch itself.
        let has = |v: &u32| part.vertices.binary_search(v).is_ok();
        let edges = topology
            .non_manifold_edges()
            .iter()
            .filter(|e| topology.edges[**e as usize].iter().all(has))
            .count();
        let vertices = topology
            .non_manifold_vertices(skin)
            .iter()
            .filter(|v| has(v))
            .count();
        if edges + vertices > 0 {
            return Err(SkinError::NotManifold { edges, vertices });
        }
        let border = topology
            .boundary_edges()
            .into_iter()
            .map(|e| topology.edges[e as usize])
            .collect();
        let topology = Topology::new(&mesh);
        let orientation = Orientation::new(&topology, &mesh.triangles);
        if orientation.one_sided.is_some() {
            return Err(SkinError::OneSided);
        }
        let turn = mesh
            .triangles
            .iter_mut()
            .zip(&orientation.turn)
            .filter(|(_, turn)| **turn);
        turn.for_each(|(t, _)| t.swap(1, 2));
        let most_turned =
            2 * orientation.turn.iter().filter(|turn| **turn).count() > orientation.turn.len();
        if looks_inward(&mesh, skin, most_turned, &centre, obstacles) {
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        if mesh
            .median_edge_length(&topology)
            .is_some_and(|median| median > ENOUGH * edge)
        {
            let (refined, kept) = refined(&mesh, edge, progress)?;
            mesh = refined;
            origin = kept
                .iter()
                .map(|&v| if v == NONE { NONE } else { origin[v as usize] })
                .collect();
        }
        let mut inside = vec![false; skin.triangles.len()];
        part.triangles
            .iter()
            .for_each(|t| inside[*t as usize] = true);
        let outside = (0..skin.triangles.len() as u32)
            .filter(|t| !inside[*t as usize])
            .collect();
        Ok(TakenOut {
            mesh,
            outside,
            origin,
            border,
        })
    }
}

/// Remeshes to the target edge length, unless there would be too many triangles; their number is
/// estimated first.
fn refined(
    mesh: &TriangleMesh,
    edge: f64,
    progress: &dyn Progress,
) -> Result<(TriangleMesh, Vec<u32>), SkinError> {
    let (vertices, most) = (mesh.area() / (EVEN * edge * edge), LARGER * MOST);
    if !(vertices <= most) {
        return Err(SkinError::TooLargePatch { vertices, most });
    }
    match refine_patch(mesh, edge, progress) {
        Err(RefineError::Stopped) => Err(SkinError::Stopped),
        other => Ok(other.map(|(refined, kept)| (refined.mesh, kept))?),
    }
}

/// True if the normals point into the body: towards the obstacle nearest to the centre or, without
/// obstacles, into the inside of the whole skin. False where this is undefined, as for a flat
/// sheet.
fn looks_inward(
    mesh: &TriangleMesh,
    skin: &TriangleMesh,
    turned: bool,
    centre: &Point3<f64>,
    obstacles: &[TriangleMesh],
) -> bool {
    let own = nearest_vertex(mesh, centre);
    let normal = mesh.vertex_normals()[own as usize];
    let nearest = obstacles
        .iter()
        .filter_map(|o| SurfaceTree::new(&o.vertices, &o.triangles).closest(centre, f64::INFINITY));
    if let Some(nearest) = nearest.min_by(|a, b| a.distance.total_cmp(&b.distance)) {
        return normal.dot(&(nearest.point - centre)) > 0.0;
    }
    // Tests how the skin surrounds its centre in its own orientation; the orientation of the patch
    // can differ.
    let area: Vec<Vector3<f64>> = skin.triangles.iter().map(|t| normal_of(skin, t)).collect();
    let middles: Vec<Vector3<f64>> = skin
        .triangles
        .iter()
        .map(|t| {
            t.iter()
                .map(|v| skin.vertices[*v as usize].coords)
                .sum::<Vector3<f64>>()
                / 3.0
        })
        .collect();
    let all: f64 = area.iter().map(Vector3::norm).sum();
    let middle = area
        .iter()
        .zip(&middles)
        .fold(Vector3::zeros(), |sum, (a, m)| sum + m * a.norm())
        / all;
    let about: f64 = area
        .iter()
        .zip(&middles)
        .map(|(a, m)| a.dot(&(m - middle)))
        .sum();
    let size: f64 = area
        .iter()
        .zip(&middles)
        .map(|(a, m)| a.norm() * (m - middle).norm())
        .sum();
    (if turned { -about } else { about }) < -ROUND * size
}

pub(super) fn nearest_vertex(mesh: &TriangleMesh, at: &Point3<f64>) -> u32 {
    let far = |v: &u32| (mesh.vertices[*v as usize] - at).norm_squared();
    (0..mesh.vertices.len() as u32)
        .min_by(|a, b| far(a).total_cmp(&far(b)))
        .unwrap_or(0)
}

pub(super) fn normal_of(mesh: &TriangleMesh, t: &[u32; 3]) -> Vector3<f64> {
    let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
    (b - a).cross(&(c - a))
}
