//! Outlier vertices, far from their neighbours, and normals without their influence.
//!
//! If a fifth of the vertices are displaced at random, the normal of nearly every vertex is wrong.
//! Vertices far from the centre of their neighbours are therefore left out. Of the remaining
//! triangles, those whose normal differs from most have small weights.

use nalgebra::{Point3, Vector3};

use crate::mesh::measures::median;
use crate::mesh::{Topology, TriangleMesh};

/// A vertex is an outlier if its distance to the centre of its neighbours is this multiple of
/// theirs. At the tip of a cone the ratio is half as great for an opening of 53 degrees.
const OFF: f64 = 2.0;
/// Number of rounds that weight triangles by their agreement.
const ROUNDS: usize = 4;

/// Centre of some points, by medians of coordinates; the origin for no points.
fn middle(points: &[Point3<f64>]) -> Point3<f64> {
    let along = |k: usize| median(points.iter().map(|p| p[k]).collect()).unwrap_or(0.0);
    Point3::new(along(0), along(1), along(2))
}

/// Outlier vertices; none if more than half would be, since the mesh itself is then irregular.
pub(super) fn outliers(mesh: &TriangleMesh, topology: &Topology) -> Vec<bool> {
    let (start, neighbours) = topology.vertex_neighbours();
    let is_off = |v: usize| {
        let ring = &neighbours[start[v] as usize..start[v + 1] as usize];
        let ring: Vec<Point3<f64>> = ring.iter().map(|&n| mesh.vertices[n as usize]).collect();
        if ring.len() < 3 {
            return false;
        }
        let middle = middle(&ring);
        let around = median(ring.iter().map(|p| (p - middle).norm()).collect()).unwrap_or(0.0);
        (mesh.vertices[v] - middle).norm() > OFF * around
    };
    let found: Vec<bool> = (0..mesh.vertices.len()).map(is_off).collect();
    let count = found.iter().filter(|off| **off).count();
    if 2 * count > found.len() {
        vec![false; found.len()]
    } else {
        found
    }
}

/// Unit normals of the vertices; zero for outliers, and where each triangle has an outlier as a
/// corner.
pub(super) fn normals(mesh: &TriangleMesh, topology: &Topology, off: &[bool]) -> Vec<Vector3<f64>> {
    let faces: Vec<Vector3<f64>> = (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t);
            (b - a).cross(&(c - a))
        })
        .collect();
    let clean = |t: &&u32| {
        mesh.triangles[**t as usize]
            .iter()
            .all(|&v| !off[v as usize])
    };
    let normal = |v: usize| {
        let own: Vec<Vector3<f64>> = topology
            .triangles_of_vertex(v)
            .iter()
            .filter(clean)
            .map(|&t| faces[t as usize])
            .collect();
        let units: Vec<Vector3<f64>> = own.iter().filter_map(|n| n.try_normalize(0.0)).collect();
        let mut found = units.iter().sum::<Vector3<f64>>().try_normalize(0.0)?;
        for _ in 0..ROUNDS {
            found = units
                .iter()
                .map(|n| n * n.dot(&found).max(0.0).powi(4))
                .sum::<Vector3<f64>>()
                .try_normalize(0.0)?;
        }
        // Area-weighted mean over triangles with a similar normal.
        let facing = own.iter().filter(|n| n.dot(&found) > 0.5 * n.norm());
        facing.sum::<Vector3<f64>>().try_normalize(0.0)
    };
    (0..mesh.vertices.len())
        .map(|v| normal(v).unwrap_or_default())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn a_thrown_vertex_is_found_and_spoils_no_normal() {
        let mut ball = icosphere(1.0, 3);
        let topology = Topology::new(&ball);
        assert!(outliers(&ball, &topology).iter().all(|off| !off));
        let clean = normals(&ball, &topology, &vec![false; 642]);
        for v in (0..642).step_by(5) {
            ball.vertices[v] += Vector3::new(0.3, -0.4, 0.5);
        }
        let off = outliers(&ball, &topology);
        let (found, thrown) = (off.iter().filter(|off| **off).count(), (0..642).step_by(5));
        // An outlier among displaced neighbours is not detected.
        let missed = thrown.clone().filter(|v| !off[*v]).count();
        assert!(
            missed * 20 < thrown.count() && found < 160,
            "{missed} missed, {found} found"
        );
        let kept = normals(&ball, &topology, &off);
        let wrong = (0..642)
            .filter(|v| kept[*v] != Vector3::zeros() && kept[*v].angle(&clean[*v]) > 0.3)
            .count();
        // The plain normals are wrong.
        let plain = ball.vertex_normals();
        let spoilt = (0..642)
            .filter(|v| plain[*v].angle(&clean[*v]) > 0.3)
            .count();
        assert!(spoilt > 200 && wrong * 10 < spoilt, "{wrong} of {spoilt}");
    }

    #[test]
    fn a_mesh_of_spikes_is_taken_as_it_is() {
        let mut ball = icosphere(1.0, 2);
        (0..162)
            .filter(|v| *v >= 42)
            .for_each(|v| ball.vertices[v] *= 30.0);
        let topology = Topology::new(&ball);
        let off = outliers(&ball, &topology);
        assert!(2 * off.iter().filter(|off| **off).count() <= 162);
    }
}
