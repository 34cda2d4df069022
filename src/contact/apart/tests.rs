//! What the parting knows of sides.

use nalgebra::Vector3;

use super::*;
use crate::mesh::shapes::icosphere;

#[test]
fn surfaces_that_do_not_cross_are_parted_whatever_side_was_given() {
    let mut other = icosphere(0.05, 2);
    // Their boxes overlap, the spheres do not.
    let by = Vector3::new(0.075, 0.075, 0.0);
    other.vertices.iter_mut().for_each(|v| *v += by);
    let meshes = [icosphere(0.05, 2), other];
    let surfaces = meshes.each_ref().map(Surface::new);
    let body = |k: usize| SoftBody {
        name: "",
        mesh: &meshes[k],
        surface: &surfaces[k],
        held: Vec::new(),
        fixed: false,
    };
    let gaps = Gaps {
        to_bones: 1e-3,
        between: 1e-4,
    };
    let mut scene = Scene::new(&[body(0), body(1)], &[], gaps);
    // The side beyond the other sphere: a vertex that has gone around it may still have it.
    let beyond = Some(Vector3::new(1.0, 1.0, 0.0).normalize());
    scene.sides[1] = vec![beyond; meshes[0].vertices.len()];
    let with_sides = scene.pair([0, 1]).of_vertices(&mut Watch::default());
    assert!(with_sides.1 > 0.0, "control: such a side looks like depth");
    assert!(scene.look(false).is_clear());
}
