//! What the parting knows of sides.

use nalgebra::Vector3;

use super::*;
use crate::mesh::shapes::icosphere;

/// Two free surfaces that keep a gap of 0.1 mm.
fn of_two(meshes: &[TriangleMesh; 2]) -> Scene {
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
    Scene::new(&[body(0), body(1)], &[], gaps)
}

#[test]
fn surfaces_that_do_not_cross_are_parted_whatever_side_was_given() {
    let mut other = icosphere(0.05, 2);
    // Their boxes overlap, the spheres do not.
    let by = Vector3::new(0.075, 0.075, 0.0);
    other.vertices.iter_mut().for_each(|v| *v += by);
    let meshes = [icosphere(0.05, 2), other];
    let mut scene = of_two(&meshes);
    // The side beyond the other sphere: a vertex that has gone around it may still have it.
    let beyond = Some(Vector3::new(1.0, 1.0, 0.0).normalize());
    scene.sides[1] = vec![beyond; meshes[0].vertices.len()];
    let with_sides = scene.pair([0, 1]).of_vertices(&mut Watch::default());
    assert!(with_sides.1 > 0.0, "control: such a side looks like depth");
    assert!(scene.look(false).is_clear());
}

#[test]
fn a_push_knows_how_deep_its_point_is() {
    let (deep, radius) = (0.01, 0.05);
    let mut other = icosphere(radius, 3);
    other
        .vertices
        .iter_mut()
        .for_each(|v| v.x += 2.0 * radius - deep);
    let meshes = [icosphere(radius, 3), other];
    let mut scene = of_two(&meshes);
    let seen = scene.look(false);
    let all = seen.pushes.iter().map(|push| push.distance(&scene.all));
    let (mut most, mut count) = (0.0_f64, 0);
    for distance in all {
        // Nothing is deeper than the lens that the balls share, nor farther away than the gap.
        assert!((-1.01 * deep..=1.1e-4).contains(&distance), "{distance}");
        most = most.min(distance);
        count += 1;
    }
    assert!(count > 10 && most <= -0.8 * deep, "{count} {most}");
}

/// A muscle and a bone with a gap of 1 mm; the bone is a small ball that looks out of the muscle.
fn of_a_ball_in_a_muscle() -> Scene {
    let muscle = icosphere(0.05, 4);
    let mut ball = icosphere(0.006, 3);
    ball.vertices.iter_mut().for_each(|v| v.x += 0.049);
    let surfaces = [&muscle, &ball].map(Surface::new);
    let soft = SoftBody {
        name: "muscle",
        mesh: &muscle,
        surface: &surfaces[0],
        held: Vec::new(),
        fixed: false,
    };
    let rigid = RigidBody {
        name: "bone",
        surface: &surfaces[1],
        pose: Isometry3::identity(),
    };
    let gaps = Gaps {
        to_bones: 1e-3,
        between: 1e-4,
    };
    Scene::new(&[soft], &[rigid], gaps)
}

#[test]
fn parted_muscles_have_fewer_slivers_and_kinks_after_they_are_evened_out() {
    let mut scene = of_a_ball_in_a_muscle();
    assert!(scene.push_apart(&ATTEMPTS[0]).is_empty());
    scene.settle_back();
    let before = scene.unevenness()[0];
    assert!(before > 1.0, "control: pushes leave some: {before}");
    let rms = scene.all[0].moved().rms;
    scene.even_out();
    assert!(scene.look(false).is_clear() && scene.is_sound());
    let after = scene.unevenness()[0];
    assert!(after <= 0.2 * before, "{after} of {before}");
    let moved = scene.all[0].moved().rms;
    assert!(moved <= even::FARTHER * rms, "{moved} {rms}");
}
