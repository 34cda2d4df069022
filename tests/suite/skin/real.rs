//! Real skins of the data set: a whole body, a scalp over its skull, a face.

use std::path::{Path, PathBuf};

use nalgebra::Point3;
use pliant::contact::Surface;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::simulation::{Audit, AuditedSurface};
use pliant::skin::{
    BaseShape, ImplantPlace, ImplantSpec, Inserted, PreparedPatch, SkinError, Whole, insert,
};
use pliant::testing::internals::skin::MovedSurface;

/// A mesh of the data set in metres; `None`, with a printed message, where it is missing.
fn read(name: &str, unit: f64) -> Option<TriangleMesh> {
    let root = std::env::var_os("PLIANT_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let path = root.join("skin").join(name);
    if !path.is_file() {
        println!("skipped: 1 test, because there is no {}", path.display());
        return None;
    }
    let mut mesh = pliant::io::read(&path)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()))
        .mesh;
    mesh.vertices.iter_mut().for_each(|v| v.coords *= unit);
    Some(mesh)
}

fn settled(
    skin: &TriangleMesh,
    order: &ImplantSpec,
    obstacles: &[TriangleMesh],
) -> (PreparedPatch, Inserted) {
    let (ready, done) = insert(skin, order, obstacles, |_| true).expect("settled");
    let volume = order.implant.volume;
    println!(
        "{} vertices a layer, {:?}, {:?}",
        ready.layers.count(),
        done.progress,
        done.areas
    );
    assert!(done.progress.converged, "{:?}", done.progress);
    assert!((done.volume() / volume - 1.0).abs() <= 1e-9);
    assert!(
        done.areas.volume_difference >= 0.995 * volume,
        "{} m3",
        done.areas.volume_difference
    );
    assert!(
        done.areas.stretch_max > 1.0 && done.areas.stretch_max <= 4.0,
        "{}",
        done.areas.stretch_max
    );
    // The documented values.
    assert!(
        done.progress.depth <= 1e-3 * order.implant.base,
        "{} m",
        done.progress.depth
    );
    // The depth is found without the solver, and it is detected if the implant is raised into
    // the skin.
    let sunk = |x: &[Point3<f64>]| super::sunk(&ready, &done, x);
    assert!(
        sunk(&done.x) <= 1e-3 * order.implant.base,
        "{} m",
        sunk(&done.x)
    );
    let mut raised = done.x.clone();
    let up = ready.frame * nalgebra::Vector3::z() * (0.1 * order.implant.base);
    raised[2 * ready.layers.count()..]
        .iter_mut()
        .for_each(|p| *p += up);
    assert!(
        sunk(&raised) > 0.01 * order.implant.base,
        "control: {} m",
        sunk(&raised)
    );
    (ready, done)
}

#[test]
fn a_breast_takes_an_implant_of_fourteen_centimetres() {
    let Some(body) = read("body/body_quads.obj", 0.1) else {
        return;
    };
    let order = ImplantSpec::round(
        ImplantPlace::Point(Point3::new(0.070, 0.377, 0.160)),
        0.14,
        300e-6,
    );
    let (ready, _) = settled(&body, &order, &[]);
    // The body is closed, also with the refined patch.
    let whole = Topology::new(&Whole::of(&body, &[&ready]).mesh);
    assert!(whole.is_closed() && whole.is_oriented());
    assert!(!Topology::new(&ready.patch).is_closed());
}

/// Where skin folds, the boundary loop of an implant bears its pressure on a line. Springs
/// alone let it penetrate by five times the tolerance.
#[test]
fn in_a_fold_nothing_sinks_into_anything() {
    let Some(body) = read("body/body_quads.obj", 0.1) else {
        return;
    };
    let groin = ImplantSpec::round(
        ImplantPlace::Point(Point3::new(0.02, -0.05, 0.05)),
        0.05,
        50e-6,
    );
    settled(&body, &groin, &[]);
    let Some(face) = read("fran_cut.vtk", 1.0) else {
        return;
    };
    let mut crescent = ImplantSpec::round(ImplantPlace::Vertex(900), 0.025, 3e-6);
    crescent.implant.shape = BaseShape::Crescent;
    crescent.tissue.depth = 2e-3;
    settled(&face, &crescent, &[]);
}

/// How far a free vertex is under an obstacle at most [m].
fn depth_in(ready: &PreparedPatch, obstacles: &[TriangleMesh], x: &[Point3<f64>]) -> f64 {
    let mut deepest = 0.0_f64;
    for surface in obstacles.iter().map(Surface::new) {
        for (v, p) in x.iter().enumerate() {
            let is_held = ready.layers.held.get(v).copied().unwrap_or(false);
            if is_held {
                continue;
            }
            if let Some(on) = surface.nearest(p, ready.order.implant.base) {
                assert!(on.closest.distance.is_finite());
                deepest = deepest.max(-on.closest.distance);
            }
        }
    }
    deepest
}

/// Bones of the skull.
fn bones() -> Vec<TriangleMesh> {
    let names = [
        "parietal_bone_left",
        "parietal_bone_right",
        "frontal_bone",
        "occipital_bone",
    ];
    names
        .iter()
        .map(|name| read(&format!("scalp/{name}.obj"), 1.0).expect("bones beside the scalp"))
        .collect()
}

#[test]
fn the_scalp_stays_outside_the_skull() {
    let Some(scalp) = read("scalp/parietal_region.obj", 1.0) else {
        return;
    };
    let bones = bones();
    let mut order = ImplantSpec::round(
        ImplantPlace::Point(Point3::new(0.035, 1.71, -0.03)),
        0.03,
        8e-6,
    );
    order.tissue.depth = 3e-3;
    let (ready, done) = settled(&scalp, &order, &bones);
    let depth = depth_in(&ready, &bones, &done.x);
    assert!(
        depth <= 1e-3 * order.implant.base,
        "{depth} m into the skull"
    );
    // Control: everything, moved into the head by a centimetre, is inside.
    let down = ready.frame * nalgebra::Vector3::z() * 0.01;
    let sunk: Vec<Point3<f64>> = done.x.iter().map(|p| p - down).collect();
    assert!(depth_in(&ready, &bones, &sunk) > 1e-3);
}

#[test]
fn over_a_suture_between_bones_the_scalp_stays_outside_both() {
    let Some(scalp) = read("scalp/parietal_region.obj", 1.0) else {
        return;
    };
    let bones = bones();
    // A centimetre away from the suture.
    let mut order = ImplantSpec::round(ImplantPlace::Vertex(60), 0.03, 8e-6);
    order.tissue.depth = 3e-3;
    let (ready, done) = settled(&scalp, &order, &bones);
    assert!(depth_in(&ready, &bones, &done.x) <= 1e-3 * order.implant.base);
}

#[test]
fn a_face_takes_an_implant_where_it_is_flat_enough() {
    let Some(face) = read("fran_cut.vtk", 1.0) else {
        return;
    };
    let cheek = ImplantSpec::round(
        ImplantPlace::Point(Point3::new(0.0893, -0.1536, -0.0409)),
        0.03,
        5e-6,
    );
    settled(&face, &cheek, &[]);
    // Over the nose the skin curves away beside the implant; the error names the remedy.
    let nose = ImplantSpec::round(ImplantPlace::Vertex(1007), 0.04, 5e-6);
    let error = insert(&face, &nose, &[], |_| true).expect_err("no place for it");
    assert!(matches!(error, SkinError::TooCurved { .. }), "{error}");
    assert!(error.help().contains("flatter place"));
}

/// The greatest fold of both layers that was not there before [degrees].
fn fold(ready: &PreparedPatch, x: &[Point3<f64>]) -> f64 {
    let (n, rest) = (ready.layers.count(), &ready.layers.rest);
    let steepest = |own: std::ops::Range<usize>| {
        let moved = MovedSurface {
            before: &rest[own.clone()],
            after: &x[own],
            triangles: &ready.layers.triangles,
        };
        moved.folds().1.to_degrees()
    };
    steepest(0..n).max(steepest(n..2 * n))
}

/// The audit reads positions alone.
fn crossings(ready: &PreparedPatch, done: &Inserted) -> usize {
    let (n, triangles) = (ready.layers.count(), &ready.layers.triangles);
    let shell = &done.shells[0];
    let surface = |name, vertices, triangles| AuditedSurface {
        name,
        rigid: false,
        vertices,
        triangles,
        held: &[],
    };
    let surfaces = [
        surface("upper", &done.x[..n], &triangles[..]),
        surface("lower", &done.x[n..2 * n], triangles),
        surface("implant", done.shell_at(shell), &shell.triangles),
    ];
    Audit::new().frame(&surfaces).crossings.all
}

#[test]
fn high_implants_neither_fold_nor_cross_the_skin() {
    let Some(body) = read("body/body_quads.obj", 0.1) else {
        return;
    };
    let at = |x, y, z| ImplantPlace::Point(Point3::new(x, y, z));
    let mut shoulder = ImplantSpec::round(at(0.19, 0.5, 0.04), 0.06, 60e-6);
    shoulder.implant.shape = BaseShape::Crescent;
    let Some(face) = read("fran_cut.vtk", 1.0) else {
        return;
    };
    let cheek = ImplantSpec::round(ImplantPlace::Vertex(2000), 0.02, 4e-6);
    for (skin, order) in [(&body, shoulder), (&face, cheek)] {
        let (ready, done) = settled(skin, &order, &[]);
        assert_eq!(crossings(&ready, &done), 0);
        let angle = fold(&ready, &done.x);
        assert!(angle <= 90.0, "{angle} degrees");
        // Control: an implant that is raised into the skin crosses it.
        let mut raised = done.clone();
        let up = ready.frame * nalgebra::Vector3::z() * (0.02 * order.implant.base);
        let first = 2 * ready.layers.count();
        raised.x[first..].iter_mut().for_each(|p| *p += up);
        assert!(crossings(&ready, &raised) > 0);
    }
}
