//! Vertices that stand far off their neighbours, and normals that they do not spoil.
//!
//! Of vertices thrown about at random a fifth is enough to turn the normal of nearly every vertex. So what stands far off the
//! middle of its neighbours is left out, and of the triangles that are left those that face another way than most count little.

use nalgebra::{Point3, Vector3};

use crate::mesh::measures::median;
use crate::mesh::{Topology, TriangleMesh};

/// A vertex so many times further from the middle of its neighbours than they are is an outlier. At the tip of a cone it is half
/// as much for an opening of 53 degrees.
const OFF: f64 = 2.0;
/// Rounds of weighing triangles by how they agree.
const ROUNDS: usize = 4;

/// Middle of some points, by medians of coordinates; of none the origin.
fn middle(points: &[Point3<f64>]) -> Point3<f64> {
    let along = |k: usize| median(points.iter().map(|p| p[k]).collect()).unwrap_or(0.0);
    Point3::new(along(0), along(1), along(2))
}

/// Which vertices are outliers; none where more than half would be, for then the mesh is like that.
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

/// Unit normals of the vertices; zero for outliers, and where all triangles have one for a corner.
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
            let weight = |n: &Vector3<f64>| n.dot(&found).max(0.0).powi(4);
            found = units
                .iter()
                .map(|n| n * weight(n))
                .sum::<Vector3<f64>>()
                .try_normalize(0.0)?;
        }
        // By area, of what faces that way.
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
        // One in the midst of others that were thrown alike does not stand off.
        let missed = thrown.clone().filter(|v| !off[*v]).count();
        assert!(
            missed * 20 < thrown.count() && found < 160,
            "{missed} missed, {found} found"
        );
        let kept = normals(&ball, &topology, &off);
        let wrong = (0..642)
            .filter(|v| kept[*v] != Vector3::zeros() && kept[*v].angle(&clean[*v]) > 0.3)
            .count();
        // The plain ones are spoilt.
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
