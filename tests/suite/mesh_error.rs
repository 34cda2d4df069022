//! The error of a mesh: that against the same scene on triangles a quarter as large.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use pliant::accuracy::FrameDistance;
use pliant::mesh::TriangleMesh;
use pliant::scene::{Accuracy, Scene, Solver, Source, builtin};
use pliant::simulation::{Assets, Scenario, Simulation};

fn scene(name: &str, changes: &[&str]) -> Scene {
    let changes: Vec<String> = changes.iter().map(|&c| c.to_owned()).collect();
    builtin::load(name, &changes).expect("a scene")
}

/// Each triangle as four, by a search of each midpoint: another method than that of the library.
fn in_quarters(mesh: &TriangleMesh) -> TriangleMesh {
    let mut vertices = mesh.vertices.clone();
    let mut triangles = Vec::new();
    let first = vertices.len();
    for &corners in &mesh.triangles {
        let [a, b, c] = corners;
        let middle = [[a, b], [b, c], [c, a]].map(|[p, q]| {
            let at = nalgebra::center(&mesh.vertices[p as usize], &mesh.vertices[q as usize]);
            let known = vertices[first..].iter().position(|v| *v == at);
            known.map_or_else(
                || {
                    vertices.push(at);
                    vertices.len() - 1
                },
                |k| first + k,
            ) as u32
        });
        let [ab, bc, ca] = middle;
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// The first `count` vertices of the only muscle in each frame.
fn frames(scene: &Scene, count: usize) -> (Vec<Vec<Point3<f64>>>, Simulation) {
    let mut run = Simulation::new(scene.clone()).expect("meshes");
    let frames = (0..scene.frames).map(|_| {
        run.step_frame();
        run.bodies[0].system.particles.position[..count].to_vec()
    });
    (frames.collect(), run)
}

fn with_error(scene: &Scene) -> Scene {
    Scene {
        mesh_error: true,
        ..scene.clone()
    }
}

#[test]
fn the_stated_error_is_twice_the_distance_from_a_run_on_the_finer_mesh() {
    let coarse = scene("cube", &["frames=4", "solver.xpbd.substeps=8"]);
    let mesh = Assets::load(&coarse).expect("meshes").muscles[0]
        .mesh
        .clone();
    let count = mesh.vertices.len();
    let mut finer = coarse.clone();
    finer.muscles[0].surface = Source::Given {
        name: "quarters".to_owned(),
        mesh: Arc::new(in_quarters(&mesh)),
        scale: 1.0,
    };
    finer.muscles[0].edge_length = None;
    if let Solver::Xpbd(xpbd) = &mut finer.solver {
        xpbd.substeps = 16;
    }
    let (at, _) = frames(&coarse, count);
    let (exact, _) = frames(&finer, count);
    let distance = FrameDistance::between(&exact, &at).rms;
    let (beside, run) = frames(&with_error(&coarse), count);
    assert_eq!(at, beside, "a second run changes nothing");
    let stated = run.mesh_error().expect("an error");
    // The meshes have the same triangles in another order, and sweeps follow it.
    let unequal = (stated - 2.0 * distance).abs();
    assert!(unequal <= 1e-2 * stated, "{stated} {distance}");
    assert!(stated > 1e-6, "{stated}");
    assert_eq!(run.mesh_error_of(0), Some(stated));
    assert_eq!(frames(&coarse, count).1.mesh_error(), None);
}

#[test]
fn the_error_of_a_mesh_is_near_the_real_one() {
    let hip = scene("hip", &["muscle.0.edge_length=16mm", "frames=5"]);
    let mut finest = hip.clone();
    let mesh = Assets::load(&hip).expect("meshes").muscles[0].mesh.clone();
    let count = mesh.vertices.len();
    finest.muscles[0].surface = Source::Given {
        name: "sixteenths".to_owned(),
        mesh: Arc::new(in_quarters(&in_quarters(&mesh))),
        scale: 1.0,
    };
    finest.muscles[0].edge_length = None;
    let (exact, _) = frames(&finest, count);
    let (at, run) = frames(&with_error(&hip), count);
    let real = FrameDistance::between(&exact, &at).rms;
    let stated = run.mesh_error().expect("an error");
    assert!(
        stated >= 0.5 * real && stated <= 4.0 * real,
        "{stated} {real}"
    );
}

#[test]
fn a_state_has_the_run_on_the_finer_mesh_too() {
    let short = with_error(&scene("cube", &["frames=4", "solver.xpbd.substeps=6"]));
    for scene in [
        short.clone(),
        Scene {
            accuracy: Some(Accuracy::Share(0.05)),
            ..short
        },
    ] {
        let mut whole = Simulation::new(scene.clone()).expect("meshes");
        whole.step_frame();
        whole.step_frame();
        let state = whole.save_state().expect("a state");
        let mut again = Simulation::new(scene).expect("meshes");
        again.restore_state(&state).expect("the same scene");
        for run in [&mut whole, &mut again] {
            run.step_frame();
            run.step_frame();
        }
        assert_eq!(whole.mesh_error(), again.mesh_error());
        assert_eq!(
            whole.attained().map(|a| a.error_m),
            again.attained().map(|a| a.error_m)
        );
        let positions = [&whole, &again].map(|run| &run.bodies[0].system.particles.position);
        assert_eq!(positions[0], positions[1]);
    }
}

#[test]
fn what_is_moved_by_hand_has_no_error_of_the_mesh() {
    let mut run =
        Simulation::new(with_error(&scene("cube", &["solver.xpbd.substeps=4"]))).expect("meshes");
    run.step_frame();
    assert!(run.mesh_error().is_some());
    let to = run.bodies[0].system.particles.position[0] + Vector3::new(0.0, 1e-3, 0.0);
    run.drag(0, 0, to, 100.0);
    run.step_frame();
    assert_eq!(run.mesh_error(), None);
    assert!(run.notes.iter().any(|note| note.contains("by hand")));
}

#[test]
fn a_muscle_that_stops_on_the_finer_mesh_leaves_no_error() {
    // Forces that tear the muscle apart stop both runs.
    let mut torn = with_error(&scene("cube", &["frames=2"]));
    let count = Assets::load(&torn).expect("meshes").muscles[0]
        .mesh
        .vertices
        .len();
    torn.muscles[0].forces.push(pliant::scene::AtVertices {
        vertices: (0..count as u32).collect(),
        vector: Vector3::new(0.0, 1e308, 0.0),
    });
    let (_, run) = frames(&torn, 1);
    assert!(run.bodies[0].stopped.is_some());
    assert!(run.mesh_error().is_some_and(f64::is_nan));
}
