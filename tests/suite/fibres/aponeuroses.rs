//! Aponeuroses: fibres from plate to plate, as long as the plates leave them.

use nalgebra::{Point3, Vector3};
use pliant::fibres::harmonic::{HarmonicOptions, decompose};
use pliant::fibres::quality::{Quality, measure};
use pliant::fibres::{
    AreaSource, Attachment, FibreMethod, Smoothing, decompose_by, end_tilts, length, turns_back,
};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::box_surface;

use crate::fibres::{AT_AREA, ends};

/// A muscle 200 mm long along x, 50 mm wide along y and 20 mm thick along z.
const SIZE: [f64; 3] = [0.2, 0.05, 0.02];
const SHARE: f64 = 0.75;

/// The muscle with areas at its ends. The origin takes in some of the lower face, so that it looks
/// down.
fn muscle() -> (TriangleMesh, Attachment) {
    let mesh = box_surface(SIZE, 0.005);
    let [mut origin, insertion] = ends(&mesh, SIZE[0]);
    let below = |v: &Point3<f64>| v.x <= -0.0899 && v.z <= -0.0099;
    origin.extend((0..mesh.vertices.len() as u32).filter(|v| below(&mesh.vertices[*v as usize])));
    let areas = Attachment::new(
        &mesh,
        AreaSource::Vertices(&origin),
        AreaSource::Vertices(&insertion),
    )
    .expect("two ends");
    (mesh, areas)
}

fn fibres(mesh: &TriangleMesh, areas: &Attachment) -> (Vec<Vec<Point3<f64>>>, Quality) {
    let found = decompose(mesh, areas, HarmonicOptions::default()).expect("fibres");
    let jacobian = found.jacobian(mesh, areas);
    let q = measure(mesh, &found.closed, areas, &found.fibres, jacobian);
    println!("{q:?}");
    (found.fibres, q)
}

/// Median length [m].
fn middle(fibres: &[Vec<Point3<f64>>]) -> f64 {
    pliant::mesh::measures::median(fibres.iter().map(|f| length(f)).collect()).expect("fibres")
}

#[test]
fn fibres_are_as_long_as_their_plates_leave_them() {
    let (mesh, areas) = muscle();
    let (plain, q) = fibres(&mesh, &areas);
    // Control: without plates they are as long as the muscle.
    assert!(
        middle(&plain) > 0.18 && q.pennation_mean_rad < 0.15,
        "{q:?}"
    );
    let plates = areas.with_aponeuroses(&mesh, SHARE, false);
    let (pennate, q) = fibres(&mesh, &plates);
    // From one face to the other, 20 mm, while they pass 50 mm along the muscle.
    let slant = f64::hypot(0.05, 0.02);
    let ratio = middle(&pennate) / slant;
    assert!((0.9..=1.1).contains(&ratio), "{ratio}");
    // Fibres from the ends of the muscle are less oblique.
    let angle = q.pennation_mean_rad / f64::atan2(0.02, 0.05);
    assert!((0.7..=1.1).contains(&angle), "{angle}");
    assert!(q.outside == 0 && q.jacobian_min > 0.0, "{q:?}");
    assert!(
        q.coverage >= 0.95 && q.end_distance_max_m <= AT_AREA,
        "{q:?}"
    );
    // Fibres side by side are parallel: from below to above, none straight across.
    let away = pennate.iter().filter(|f| {
        let along = f[14] - f[0];
        !(along.x > 0.3 * along.norm() && along.z > 0.0)
    });
    assert!(away.count() <= pennate.len() / 20);
}

#[test]
fn a_plate_in_the_middle_makes_two_sets_of_fibres() {
    let (mesh, areas) = muscle();
    let plates = areas.with_aponeuroses(&mesh, SHARE, true);
    let sheet = plates.origin.sheet.as_ref().expect("a sheet");
    assert!(
        sheet
            .vertices
            .iter()
            .all(|p| p.y.abs() <= 1e-9 && p.x <= 0.05 + 0.005)
    );
    let (both, q) = fibres(&mesh, &plates);
    assert!(q.outside == 0 && q.jacobian_min > 0.0, "{q:?}");
    assert!(
        q.coverage >= 0.95 && q.end_distance_max_m <= AT_AREA,
        "{q:?}"
    );
    // Half of the width in each set, while they pass 50 mm along the muscle.
    let ratio = middle(&both) / f64::hypot(0.05, 0.025);
    assert!((0.8..=1.2).contains(&ratio), "{ratio}");
    let sides = [-1.0, 1.0].map(|side| {
        let to = |f: &&Vec<Point3<f64>>| side * (f[14].y - f[0].y) > 0.005;
        both.iter().filter(to).count()
    });
    assert!(sides.iter().all(|count| *count >= 30), "{sides:?}");
}

#[test]
fn given_plates_do_as_found_ones() {
    let (mesh, areas) = muscle();
    let face = |z: f64, from: f64, to: f64| TriangleMesh {
        vertices: vec![
            Point3::new(from, -0.025, z),
            Point3::new(to, -0.025, z),
            Point3::new(to, 0.025, z),
            Point3::new(from, 0.025, z),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    let faces = [face(-0.01, -0.1, 0.05), face(0.01, -0.05, 0.1)];
    let given = areas.with_plates(&mesh, &faces).expect("plates");
    assert!(given.origin.sheet.is_none() && given.insertion.sheet.is_none());
    let ratio = middle(&fibres(&mesh, &given).0) / f64::hypot(0.05, 0.02);
    assert!((0.9..=1.1).contains(&ratio), "{ratio}");
    // A sheet inside: from its middle the insertion's fibres lead to both faces of the origin.
    let mut sheet = face(0.0, -0.05, 0.095);
    sheet.vertices.iter_mut().for_each(|p| p.y *= 0.9);
    let inside = areas.with_plates(&mesh, &[sheet]).expect("a sheet");
    assert_eq!(
        inside.insertion.sheet.as_ref().map(|s| s.triangles.len()),
        Some(2)
    );
    assert!(inside.origin.sheet.is_none());
    // A plate that belongs to something else is refused.
    let mut far = face(0.5, -0.1, 0.1);
    far.vertices.iter_mut().for_each(|p| p.z += 1.0);
    let error = areas
        .with_plates(&mesh, &[far])
        .expect_err("off the muscle");
    assert!(error.to_string().contains("off the muscle"), "{error}");
}

#[test]
fn hooks_and_turns_are_seen() {
    let at = |x: f64, y: f64| Point3::new(x, y, 0.0);
    let straight = vec![at(0.0, 0.0), at(1.0, 0.0)];
    assert_eq!(end_tilts(&straight), Some([0.0, 0.0]));
    assert!(!turns_back(&straight));
    // A hook of 0.5 % at one end.
    let hook = vec![at(0.0, 0.0), at(0.995, 0.0), at(0.995, 0.005)];
    let [first, last] = end_tilts(&hook).expect("a line").map(f64::to_degrees);
    assert!(
        first <= 1.0 && (60.0..=91.0).contains(&last),
        "{first} {last}"
    );
    assert!(!turns_back(&hook));
    let there_and_back = vec![at(0.0, 0.0), at(1.0, 0.0), at(1.0, 0.1), at(0.0, 0.1)];
    assert!(turns_back(&there_and_back));
    let corner = vec![at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0)];
    assert!(!turns_back(&corner));
    assert_eq!(end_tilts(&[at(0.0, 0.0), at(0.0, 0.0)]), None);
}

#[test]
fn smoothing_keeps_what_fibres_cover() {
    let (mesh, areas) = muscle();
    // A bent muscle: smoothing that shrinks draws its fibres to the inner side.
    let bent = |p: &Point3<f64>| Point3::from(p.coords + Vector3::z() * (4.0 * p.x * p.x));
    let mesh = TriangleMesh {
        vertices: mesh.vertices.iter().map(bent).collect(),
        triangles: mesh.triangles,
    };
    let covered = |steps: u32| {
        let smoothing = Smoothing { steps, factor: 0.5 };
        let options = HarmonicOptions::default();
        let made = decompose_by(
            &mesh,
            &areas,
            FibreMethod::Harmonic,
            options,
            smoothing,
            &pliant::progress::Silent,
        )
        .expect("fibres");
        let jacobian = made.jacobian(&mesh, &areas);
        measure(&mesh, &made.closed, &areas, &made.lines, jacobian).coverage
    };
    let (before, after) = (covered(0), covered(20));
    assert!(before - after <= 0.005, "{before} {after}");
}
