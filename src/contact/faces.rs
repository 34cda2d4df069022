//! The triangles of an obstacle with the data for the signs of distances, for any method of search.

use nalgebra::{Point3, Vector3};

use super::Projection;
use super::nearest::{Feature, angle_at, area_normal, on_triangle, point_at};
use crate::constraints::bending::dihedral;
use crate::mesh::TriangleMesh;
use crate::mesh::topology::Topology;
use crate::mesh::winding::WindingTree;

/// A point on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnTriangle {
    /// The triangle.
    pub triangle: u32,
    /// Barycentric weights.
    pub weights: [f64; 3],
    /// Signed distance, normal and point.
    pub closest: Projection,
}

/// Least angle of a ridge [rad], and spacing of the points along it relative to the median edge.
const RIDGE: f64 = 0.35;
const SPACING: f64 = 0.5;

/// The vertices, and points along convex edges: a muscle fold across a ridge between two of its
/// vertices would touch neither.
fn contact_samples_of(mesh: &TriangleMesh, topology: &Topology) -> Vec<Point3<f64>> {
    let mut points = mesh.vertices.clone();
    let spacing = SPACING * mesh.median_edge_length(topology).unwrap_or(0.0);
    for hinge in &topology.hinges {
        let x = hinge.map(|v| mesh.vertices[v as usize]);
        if dihedral(&x) > RIDGE && spacing > 0.0 {
            let along = x[1] - x[0];
            let parts = (along.norm() / spacing).ceil().min(32.0) as u32;
            points.extend((1..parts).map(|k| x[0] + along * (f64::from(k) / f64::from(parts))));
        }
    }
    points
}

/// A triangle mesh with its topology, its sample points and the sign of its sides.
#[derive(Clone)]
pub(super) struct Faces {
    /// Positions [m] and triangles.
    pub mesh: TriangleMesh,
    /// Points that must stay out of a muscle's triangles: vertices, and points along ridges [m].
    pub contact_samples: Vec<Point3<f64>>,
    topology: Topology,
    /// Decides the sign if the mesh is not closed and oriented.
    winding: Option<WindingTree>,
}

impl Faces {
    /// Copies the mesh and tests whether it is closed and oriented.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let topology = Topology::new(mesh);
        let sound = topology.is_closed() && topology.is_oriented() && mesh.volume() > 0.0;
        Self {
            mesh: mesh.clone(),
            contact_samples: contact_samples_of(mesh, &topology),
            winding: (!sound).then(|| WindingTree::new(mesh)),
            topology,
        }
    }

    /// True if the mesh is closed and consistently oriented.
    pub fn is_sound(&self) -> bool {
        self.winding.is_none()
    }

    /// Corners of a triangle with positions `x` [m].
    pub fn corners(&self, triangle: u32, x: &[Point3<f64>]) -> [Point3<f64>; 3] {
        self.mesh.triangles[triangle as usize].map(|v| x[v as usize])
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        (self.mesh.vertices.capacity() + self.contact_samples.capacity()) * 24
            + self.mesh.triangles.capacity() * 12
            + self.topology.bytes()
            + self.winding.as_ref().map_or(0, WindingTree::bytes)
    }

    /// The point of a triangle nearest to `point`, for positions `x` [m]. For a closed and
    /// consistently oriented mesh the sign comes from angle-weighted pseudo-normals
    /// \[baerentzen2005\]; this is correct for the nearest of all triangles. For another mesh it
    /// comes from the generalised winding number \[jacobson2013\].
    pub fn on(&self, point: &Point3<f64>, triangle: u32, x: &[Point3<f64>]) -> OnTriangle {
        let t = self.corners(triangle, x);
        let (weights, feature) = on_triangle(point, &t);
        let nearest = point_at(&t, &weights);
        let away = point - nearest;
        let pseudo = pseudo_normal(&self.mesh.triangles, &self.topology, x, triangle, feature);
        let outside = match &self.winding {
            Some(winding) => winding.number(point).abs() < 0.5,
            None => away.dot(&pseudo) >= 0.0,
        };
        let sign = if outside { 1.0 } else { -1.0 };
        let distance = away.norm();
        // At a smaller distance the direction is rounding error; the size of the triangle is the
        // length scale.
        let size = (t[1] - t[0]).norm() + (t[2] - t[0]).norm();
        let normal = if distance > 1e-9 * size {
            away * (sign / distance)
        } else {
            pseudo
        };
        OnTriangle {
            triangle,
            weights,
            closest: Projection {
                distance: sign * distance,
                normal,
                point: nearest,
            },
        }
    }
}

/// Unit pseudo-normal of a feature of a triangle; that of the face where neighbours cancel it.
pub(crate) fn pseudo_normal(
    triangles: &[[u32; 3]],
    topology: &Topology,
    x: &[Point3<f64>],
    triangle: u32,
    feature: Feature,
) -> Vector3<f64> {
    let corners = |t: u32| triangles[t as usize].map(|v| x[v as usize]);
    let unit = |t: u32| {
        area_normal(&corners(t))
            .try_normalize(0.0)
            .unwrap_or_else(Vector3::zeros)
    };
    let face = area_normal(&corners(triangle))
        .try_normalize(0.0)
        .unwrap_or_else(Vector3::z);
    let sum = match feature {
        Feature::Face => face,
        Feature::Side(k) => {
            let beside = topology.neighbours_of_triangle(triangle as usize)[k];
            face + beside.map_or_else(Vector3::zeros, unit)
        }
        Feature::Corner(k) => {
            let v = triangles[triangle as usize][k];
            topology
                .triangles_of_vertex(v as usize)
                .iter()
                .fold(Vector3::zeros(), |sum, &other| {
                    let corner = triangles[other as usize]
                        .iter()
                        .position(|&c| c == v)
                        .unwrap_or(0);
                    sum + unit(other) * angle_at(&corners(other), corner)
                })
        }
    };
    sum.try_normalize(1e-6).unwrap_or(face)
}
