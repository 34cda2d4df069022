//! The part of a skin that an implant needs, taken out of it and refined.

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

/// The patch that is refined reaches so much further than the region, in its radii.
pub(super) const MARGIN: f64 = 1.25;

/// Skin whose median edge is at most this many times the wanted one is taken as it is.
const ENOUGH: f64 = 1.25;

/// Skin lies about its middle if its normals point so much away from it, as a share of what they would of a sphere.
const ROUND: f64 = 0.02;

/// Area for each vertex of even triangles, over the square of their edges.
pub(super) const EVEN: f64 = 0.866;

/// A patch may have so many times the vertices of a region: it reaches 1.25 times as far, and by as much as the triangles that
/// were there before, which [`super::coarse`] keeps to half of a region's radius: (1.25 + 0.5)^2 = 3.1 times, and folds.
const LARGER: f64 = 4.0;

/// What is taken out of a skin.
pub(super) struct Patch<'a> {
    pub skin: &'a TriangleMesh,
    /// For each implant a vertex near its middle, the middle [m], and how far the patch reaches at least [m].
    pub places: Vec<(u32, Point3<f64>, f64)>,
    /// Wanted edges [m].
    pub edge: f64,
    pub obstacles: &'a [TriangleMesh],
}

/// A part of a skin by itself.
pub(super) struct TakenOut {
    pub mesh: TriangleMesh,
    /// All triangles of the skin besides.
    pub outside: Vec<u32>,
    /// The vertex of the skin that each of its vertices is, [`NONE`] for one that is of the patch only.
    pub origin: Vec<u32>,
    /// Edges of the skin with one triangle only, each with the lower end first: the rest of its rim is where it was cut off.
    pub border: BTreeSet<[u32; 2]>,
}

impl Patch<'_> {
    /// The skin about the implant and somewhat beyond, oriented, refined where it is coarse.
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
        // Of the skin, not of the part: where that was cut off it may touch itself.
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

/// With even triangles of the wanted edges, unless there would be too many: they are counted before they are made.
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

/// Whether the normals look into the body: towards the obstacle that is nearest to the middle, or, without any, into what the
/// whole skin goes around. As it is where that cannot be told, as of a flat sheet.
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
    // How the skin lies about its middle, as it winds; the patch may have been turned since.
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
