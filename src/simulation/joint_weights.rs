//! The share of a joint's angle by which each vertex of a muscle turns. A vertex on a bone moves
//! with that bone; between bones the rotation varies smoothly.

use crate::contact::Obstacle;
use crate::mesh::{Topology, TriangleMesh};
use crate::solvers::sparse::{Factor, FactorError};

/// Least distance to a bone, relative to an edge: a triangle mesh does not resolve a surface more
/// finely.
const NEAREST: f64 = 0.1;

/// Distances of a vertex from the resting and from the turning bones \[m\]; infinite where there
/// are none.
pub type Distances = [f64; 2];

/// Distances of all vertices of a mesh from obstacles. The flag is true for a turning obstacle. The
/// distance of a vertex inside an obstacle is 0.
pub fn distances(mesh: &TriangleMesh, bones: &[(&dyn Obstacle, bool)]) -> Vec<Distances> {
    let from = |v: &nalgebra::Point3<f64>| {
        let each = bones.iter();
        nearest(each.filter_map(|(bone, turns)| Some((bone.closest(v)?.distance, *turns))))
    };
    mesh.vertices.iter().map(from).collect()
}

/// Distances of a vertex from its signed distances \[m\] to obstacles, each with whether it turns.
pub fn nearest(all: impl Iterator<Item = (f64, bool)>) -> Distances {
    let mut found = [f64::INFINITY; 2];
    for (distance, turns) in all {
        let least = &mut found[usize::from(turns)];
        // The factorisation reports a NaN; `f64::min` would hide it.
        if !(distance >= *least) {
            *least = if distance < 0.0 { 0.0 } else { distance };
        }
    }
    found
}

/// Shares from 0 to 1 that minimise
///
/// `sum over edges h w (s_a - s_b)^2 + sum over vertices A (s^2 / d_0 + (1 - s)^2 / d_1)`
///
/// with `w` two thirds of the area beside an edge over its squared length (the cotangent weight of
/// finite elements for equilateral triangles, and positive for all triangles), `h` the muscle's
/// volume over its area, `A` the area around a vertex and `d` its [`Distances`]. This is the
/// conduction of heat through a muscle of thickness 2 h between bones at 0 and 1, with soft tissue
/// of the same conductance between muscle and bones. The model has no free parameter. `held` gives
/// vertices with prescribed joint weights.
///
/// # Errors
/// A part of the mesh that nothing holds and no bone is near, or no memory.
pub fn joint_weights(
    mesh: &TriangleMesh,
    topology: &Topology,
    distances: &[Distances],
    held: &[(u32, f64)],
) -> Result<Vec<f64>, FactorError> {
    let count = mesh.vertices.len();
    let mut values = vec![None; count];
    held.iter()
        .for_each(|&(v, share)| values[v as usize] = Some(share));
    let pairs: Vec<[u32; 2]> = topology.edges.clone();
    let mut factor = Factor::<1>::new(count, &pairs)?;
    let mut rhs = vec![0.0; count];
    let lengths = topology.edge_lengths(mesh);
    let areas = crate::mesh::measures::triangle_areas(&mesh.vertices, &mesh.triangles);
    let thickness = mesh.volume().abs() / mesh.area();
    for (e, &[a, b]) in topology.edges.iter().enumerate() {
        let beside: f64 = topology
            .triangles_of_edge(e)
            .iter()
            .map(|&t| areas[t as usize])
            .sum();
        let conductance = thickness * 2.0 / 3.0 * beside / (lengths[e] * lengths[e]);
        for (v, other) in [(a, b), (b, a)] {
            if values[v as usize].is_none() {
                factor.add_diagonal(v, conductance);
                if let Some(share) = values[other as usize] {
                    rhs[v as usize] += conductance * share;
                }
            }
        }
        if values[a as usize].is_none() && values[b as usize].is_none() {
            factor.add(a.max(b), a.min(b), &[[-conductance]]);
        }
    }
    let nearest = NEAREST * crate::mesh::measures::median(lengths).unwrap_or(0.0);
    for (v, area) in mesh.vertex_areas().into_iter().enumerate() {
        match values[v] {
            Some(share) => {
                factor.add_diagonal(v as u32, 1.0);
                rhs[v] = share;
            }
            None => {
                let [resting, turning] =
                    distances[v].map(|d| area / if d < nearest { nearest } else { d });
                factor.add_diagonal(v as u32, resting + turning);
                rhs[v] += turning;
            }
        }
    }
    factor.factorise()?;
    factor.solve(&mut rhs, 1);
    Ok(rhs)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::contact::capsule::Capsule;
    use crate::mesh::shapes::tube;

    const LENGTH: f64 = 0.12;

    /// A muscle along an axis, held at its ends, and its joint weights; `bones` are beside its lower and
    /// upper half.
    fn found(bones: &[(&dyn Obstacle, bool)]) -> (TriangleMesh, Vec<f64>) {
        let mesh = tube(0.012, LENGTH, 24);
        let along = mesh.bounding_box().extents().iamax();
        let (low, high) = (
            mesh.bounding_box().min[along],
            mesh.bounding_box().max[along],
        );
        let at = |(v, p): (usize, &Point3<f64>)| match p[along] {
            y if y < low + 0.005 => Some((v as u32, 0.0)),
            y if y > high - 0.005 => Some((v as u32, 1.0)),
            _ => None,
        };
        let held: Vec<(u32, f64)> = mesh.vertices.iter().enumerate().filter_map(at).collect();
        let near = distances(&mesh, bones);
        let joint_weights =
            joint_weights(&mesh, &Topology::new(&mesh), &near, &held).expect("held");
        (mesh, joint_weights)
    }

    /// Mean share of the vertices around a position along the muscle, from 0 to 1.
    fn around((mesh, joint_weights): &(TriangleMesh, Vec<f64>), place: f64) -> f64 {
        let bounds = mesh.bounding_box();
        let along = bounds.extents().iamax();
        let wanted = bounds.min[along] + place * bounds.extents()[along];
        let near = |p: &(&Point3<f64>, &f64)| (p.0[along] - wanted).abs() < 0.05 * LENGTH;
        let both: Vec<f64> = mesh
            .vertices
            .iter()
            .zip(joint_weights)
            .filter(near)
            .map(|(_, s)| *s)
            .collect();
        both.iter().sum::<f64>() / both.len() as f64
    }

    #[test]
    fn without_bones_the_turn_spreads_evenly() {
        let even = found(&[]);
        // The ends are held over a part of the length; in the middle both have the same weight.
        assert!(
            (around(&even, 0.5) - 0.5).abs() <= 0.02,
            "{}",
            around(&even, 0.5)
        );
        assert!((around(&even, 0.3) + around(&even, 0.7) - 1.0).abs() <= 0.02);
        assert!(around(&even, 0.7) - around(&even, 0.3) > 0.2, "control");
        assert!(even.1.iter().all(|s| (0.0..=1.0).contains(s)));
    }

    #[test]
    fn what_lies_on_a_bone_goes_with_it() {
        let even = found(&[]);
        let bounds = tube(0.012, LENGTH, 24).bounding_box();
        let along = bounds.extents().iamax();
        let mut across = Vector3::zeros();
        across[(along + 1) % 3] = 0.012 + 0.01 + 0.0005;
        let mut reach = Vector3::zeros();
        reach[along] = 0.5 * LENGTH;
        let capsule = Capsule {
            ends: [bounds.center() + across - reach, bounds.center() + across],
            radius: 0.01,
        };
        let resting = found(&[(&capsule, false)]);
        assert!(
            around(&resting, 0.3) < 0.5 * around(&even, 0.3),
            "{}",
            around(&resting, 0.3)
        );
        let turning = found(&[(&capsule, true)]);
        assert!(
            around(&turning, 0.3) > 2.0 * around(&even, 0.3),
            "{}",
            around(&turning, 0.3)
        );
        for (_, joint_weights) in [&resting, &turning] {
            // A minimum of a network of conductances lies between the held values, up to rounding.
            assert!(
                joint_weights
                    .iter()
                    .all(|s| (-1e-12..=1.0 + 1e-12).contains(s))
            );
        }
    }
}
