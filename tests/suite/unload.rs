//! Shapes at rest of scans under gravity.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use pliant::accuracy::FrameDistance;
use pliant::mesh::TriangleMesh;
use pliant::progress::Silent;
use pliant::scene::{Content, Scene, SolverQuestion, Source, builtin};
use pliant::simulation::{Assets, SensitivityError, Simulation, unload};

/// A soft cube on a table, under ten times the gravity: it sags by a twentieth of its height.
fn cube() -> Scene {
    let changes = [
        "frames=2",
        "effects.gravity.acceleration=['0 m/s2', '-98.1 m/s2', '0 m/s2']",
    ];
    let mut scene = builtin::load("cube", &changes.map(str::to_owned)).expect("a scene");
    scene.solver = SolverQuestion::Equilibrium.minimised(1, 1e-6);
    scene
}

/// The same scene with another mesh.
fn with(scene: &Scene, mesh: TriangleMesh) -> Scene {
    let mut scene = scene.clone();
    scene.muscles[0].surface = Source::Given {
        name: "scan".to_owned(),
        mesh: Arc::new(mesh),
        scale: 1.0,
    };
    scene
}

fn rest(scene: &Scene) -> TriangleMesh {
    Assets::load(scene).expect("meshes").muscles[0].mesh.clone()
}

/// The equilibrium of frame 1.
fn scanned(scene: &Scene) -> TriangleMesh {
    let mut run = Simulation::new(scene.clone()).expect("meshes");
    run.step_frame();
    TriangleMesh {
        vertices: run.bodies[0].system.particles.position.clone(),
        ..rest(scene)
    }
}

fn apart(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    FrameDistance::between(&[a.to_vec()], &[b.to_vec()]).max
}

#[test]
fn what_sagged_is_found_as_it_was() {
    let scene = cube();
    let (before, scan) = (rest(&scene), scanned(&scene));
    let sag = apart(&before.vertices, &scan.vertices);
    assert!(sag > 3e-4, "control: {sag} m");
    let of_scan = with(&scene, scan.clone());
    let content = Content::Muscles(Box::new(of_scan.clone()));
    let found = unload(&content, 1, 5e-6, &Silent).expect("shapes");
    let (_, shape, left) = &found.bodies[0];
    assert!(left.iter().all(|left| *left <= 5e-6), "{:?}", found.rounds);
    // The first round says how far a scan sags that is taken for the shape at rest.
    assert!(found.rounds[0] > 0.3 * sag, "{:?}", found.rounds);
    let off = apart(&before.vertices, &shape.vertices);
    assert!(off <= 0.05 * sag, "{off} of {sag} m, {:?}", found.rounds);
    assert!((shape.volume() / before.volume() - 1.0).abs() <= 1e-3);
    // Recomputed: a run that begins with the shape found ends with the scan.
    let again = scanned(&with(&scene, shape.clone()));
    assert!(apart(&again.vertices, &scan.vertices) <= 5e-6);
    // Control: the reverse load on the scan leads elsewhere.
    let mut reversed = of_scan;
    reversed.effects.gravity = Some(Vector3::new(0.0, 98.1, 0.0));
    let wrong = scanned(&reversed);
    assert!(apart(&wrong.vertices, &before.vertices) > 3.0 * off);
}

#[test]
fn without_a_load_a_scan_is_its_own_shape_at_rest() {
    let mut scene = cube();
    scene.effects.gravity = None;
    let content = Content::Muscles(Box::new(scene.clone()));
    let found = unload(&content, 1, 1e-5, &Silent).expect("shapes");
    assert_eq!(found.rounds.len(), 1);
    assert_eq!(found.bodies[0].1, rest(&scene));
}

#[test]
fn overlap_is_told_and_what_cannot_be_unloaded() {
    let skin = builtin::load_content("flat-implant", &[]).expect("a scene");
    assert!(matches!(
        unload(&skin, 1, 1e-5, &Silent),
        Err(SensitivityError::NotSupported("skin"))
    ));
    // A cube that lies in the table.
    let scene = cube();
    let mut low = rest(&scene);
    low.vertices.iter_mut().for_each(|v| v.y -= 1e-3);
    let content = Content::Muscles(Box::new(with(&scene, low)));
    let found = unload(&content, 1, 1e-5, &Silent).expect("shapes");
    assert!(
        found.parted > 5e-4 && found.parted < 3e-3,
        "{}",
        found.parted
    );
    // Control: one that does not.
    let content = Content::Muscles(Box::new(scene));
    let found = unload(&content, 1, 1e-5, &Silent).expect("shapes");
    assert!(found.parted <= 1e-9, "{}", found.parted);
}
