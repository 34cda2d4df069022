//! How two maps lie to each other where nothing is named: turned so that places that are near each other on the bodies are near
//! on the sphere as well.

use nalgebra::{Matrix3, Point3, UnitQuaternion, Vector3};

use super::align::rotation_of;
use super::locate::Locator;
use super::sphere::SphereMap;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;

/// Vertices of the first body that are asked.
const ASKED: usize = 600;
/// Turns of the body and of the map, one after the other.
const ROUNDS: usize = 6;
/// The axes must lay the bodies onto each other so much better than they lie: a body that is nearly round or flat has no axes,
/// and where somebody placed it is right.
const BETTER: f64 = 0.7;

/// From what the turn of a map was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Bodies as they are placed, moved and scaled onto each other.
    Placed,
    /// Bodies turned by their principal axes.
    Axes,
    /// Features that were named.
    Features,
}

impl Start {
    /// As in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Placed => "placed",
            Self::Axes => "axes",
            Self::Features => "pairs",
        }
    }
}

/// The turn of the first map after which like parts of the bodies lie on like parts of the sphere.
///
/// Bodies are moved and scaled onto each other, as they are and by their principal axes; each vertex of the first is matched with
/// the nearest place of the second that faces the same way, and both maps are turned to match \[kabsch1976\]; then the body is
/// turned to where the maps say, and so on. The least sum of squared distances wins.
pub fn by_shape(maps: [&SphereMap; 2], meshes: [&TriangleMesh; 2]) -> (UnitQuaternion<f64>, Start) {
    let matching = Matching::new(maps, meshes);
    let [from, to] = meshes.map(axes);
    let (mut least, mut turn) = matching.best(UnitQuaternion::identity());
    let mut start = Start::Placed;
    for signs in [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]] {
        let by = rotation_of(&(to * Matrix3::from_diagonal(&Vector3::from(signs)) * from.transpose()));
        let (cost, found) = matching.best(by);
        let wanted = if start == Start::Placed { BETTER * least } else { least };
        if cost < wanted {
            (least, turn, start) = (cost, found, Start::Axes);
        }
    }
    (turn, start)
}

/// Principal axes of a surface, the longest first, right-handed, as columns.
pub fn axes(mesh: &TriangleMesh) -> Matrix3<f64> {
    let middle = mesh.surface_centroid().unwrap_or_default();
    let mut spread = Matrix3::zeros();
    for (p, area) in mesh.vertices.iter().zip(mesh.vertex_areas()) {
        spread += (p - middle) * (p - middle).transpose() * area;
    }
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
    let [a, b] = [order[0], order[1]].map(|k| eigen.eigenvectors.column(k).into_owned());
    Matrix3::from_columns(&[a, b, a.cross(&b)])
}

struct Matching<'a> {
    maps: [&'a SphereMap; 2],
    meshes: [&'a TriangleMesh; 2],
    middles: [Point3<f64>; 2],
    scale: f64,
    asked: Vec<usize>,
    areas: Vec<f64>,
    normals: Vec<Vector3<f64>>,
    tree: SurfaceTree,
    locator: Locator<'a>,
}

impl<'a> Matching<'a> {
    fn new(maps: [&'a SphereMap; 2], meshes: [&'a TriangleMesh; 2]) -> Self {
        let count = meshes[0].vertices.len();
        let ratio = meshes[1].area() / meshes[0].area();
        Self {
            maps,
            meshes,
            middles: meshes.map(|m| m.surface_centroid().unwrap_or_default()),
            scale: if ratio > 0.0 && ratio.is_finite() { ratio.sqrt() } else { 1.0 },
            asked: (0..count).step_by((count / ASKED).max(1)).collect(),
            areas: meshes[0].vertex_areas(),
            normals: meshes[0].vertex_normals(),
            tree: SurfaceTree::new(&meshes[1].vertices, &meshes[1].triangles),
            locator: Locator::new(maps[1]),
        }
    }

    /// From a turn of the body on: cost and turn of the map.
    fn best(&self, mut by: UnitQuaternion<f64>) -> (f64, UnitQuaternion<f64>) {
        let mut best = (f64::INFINITY, UnitQuaternion::identity());
        for _ in 0..ROUNDS {
            let turn = self.turn(&by);
            let (cost, next) = self.judged(&by, &turn);
            if cost < best.0 {
                best = (cost, turn);
            }
            by = next;
        }
        best
    }

    fn moved(&self, v: usize, by: &UnitQuaternion<f64>) -> Point3<f64> {
        self.middles[1] + by * (self.meshes[0].vertices[v] - self.middles[0]) * self.scale
    }

    /// The turn of the map that matches nearest places.
    fn turn(&self, by: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let mut product = Matrix3::zeros();
        for &v in &self.asked {
            let (p, normal) = (self.moved(v, by), by * self.normals[v]);
            let facing = self.tree.closest_facing(&p, &normal, 0.0, f64::INFINITY);
            let Some(near) = facing.or_else(|| self.tree.closest(&p, f64::INFINITY)) else { continue };
            let [a, b, c] = self.meshes[1].corners(near.triangle as usize);
            let part = |q: &Point3<f64>, r: &Point3<f64>| (q - near.point).cross(&(r - near.point)).norm();
            let weights = [part(&b, &c), part(&c, &a), part(&a, &b)];
            let corners = self.meshes[1].triangles[near.triangle as usize];
            let at: Vector3<f64> =
                corners.iter().zip(weights).map(|(&v, w)| self.maps[1].points()[v as usize].coords * w).sum();
            if let Some(at) = at.try_normalize(0.0) {
                product += at * self.maps[0].points()[v].coords.transpose() * self.areas[v];
            }
        }
        rotation_of(&product)
    }

    /// Mean square of the distances between what a turn of the map matches, and the turn of the body that fits it best.
    fn judged(&self, by: &UnitQuaternion<f64>, turn: &UnitQuaternion<f64>) -> (f64, UnitQuaternion<f64>) {
        let (mut sum, mut total, mut product) = (0.0, 0.0, Matrix3::zeros());
        for &v in &self.asked {
            let Some(found) = self.locator.locate(&(turn * self.maps[0].points()[v].coords)) else { continue };
            let there = found.of(self.maps[1].triangles(), &self.meshes[1].vertices);
            sum += self.areas[v] * (self.moved(v, by) - there).norm_squared();
            total += self.areas[v];
            let from = self.meshes[0].vertices[v] - self.middles[0];
            product += (there - self.middles[1]) * from.transpose() * self.areas[v];
        }
        (if total > 0.0 { sum / total } else { f64::INFINITY }, rotation_of(&product))
    }
}
