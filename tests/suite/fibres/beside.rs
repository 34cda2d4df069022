//! Areas along which fibres run: round the ends of a tendon, or along a side.

use nalgebra::Point3;
use pliant::fibres::harmonic::HarmonicOptions;
use pliant::fibres::quality::measure;
use pliant::fibres::{
    AreaSource, Attachment, FibreMethod, HOOK_DEG, Smoothing, decompose_by, median_tilt, turns_back,
};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::tube;
use pliant::progress::Silent;

use crate::fibres::AT_AREA;

/// A tube with an area over the part `share` of its length at each end, where `is_on` is true.
fn with_areas(
    (radius, length): (f64, f64),
    share: [f64; 2],
    is_on: impl Fn(&Point3<f64>) -> bool,
) -> (TriangleMesh, Attachment) {
    let mesh = tube(radius, length, 32);
    let area = |from: f64, to: f64| -> Vec<u32> {
        let within = |x: f64| (from..=to).contains(&(x / length + 0.5));
        let on = |v: &u32| {
            let p = &mesh.vertices[*v as usize];
            within(p.x) && is_on(p)
        };
        (0..mesh.vertices.len() as u32).filter(on).collect()
    };
    let (origin, insertion) = (area(-1.0, share[0]), area(1.0 - share[1], 2.0));
    let areas = Attachment::new(
        &mesh,
        AreaSource::Vertices(&origin),
        AreaSource::Vertices(&insertion),
    );
    let areas = areas.expect("areas");
    (mesh, areas)
}

/// Fibres that keep their order and end without hooks, and cover `coverage` of the muscle.
fn check((mesh, areas): &(TriangleMesh, Attachment), coverage: f64) {
    let made = decompose_by(
        mesh,
        areas,
        FibreMethod::Harmonic,
        HarmonicOptions::default(),
        Smoothing::default(),
        &Silent,
    )
    .expect("fibres");
    let jacobian = made.jacobian(mesh, areas);
    let q = measure(mesh, &made.closed, areas, &made.lines, jacobian);
    println!("{q:?}");
    assert!(q.outside == 0 && q.jacobian_min > 0.0, "{q:?}");
    assert!(
        q.end_distance_max_m <= AT_AREA && q.coverage >= coverage,
        "{q:?}"
    );
    let courses = made.courses();
    let tilt = median_tilt(&courses);
    assert!(
        tilt.to_degrees() <= HOOK_DEG,
        "{} degrees",
        tilt.to_degrees()
    );
    assert!(!courses.iter().any(|course| turns_back(course)));
}

#[test]
fn fibres_end_along_areas_round_a_thin_tendon() {
    // When a streamline beside an area went on in one step, neighbours changed places there; the fibres that
    // were taken at last ended in hooks of 75 degrees.
    check(&with_areas((0.01, 0.3), [0.25, 0.1], |_| true), 0.95);
}

#[test]
fn fibres_between_areas_on_one_side_do_not_turn_back() {
    // Of the fibres that cover most, four turn back.
    check(&with_areas((0.02, 0.15), [0.45, 0.2], |p| p.y >= 0.0), 0.95);
}
