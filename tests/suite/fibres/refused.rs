//! Areas and muscles that are rejected, each with its place.

use nalgebra::{Point3, Vector3};
use pliant::fibres::harmonic::{DecompositionError, HarmonicOptions, decompose, decompose_with};
use pliant::fibres::{
    AreaSource, Attachment, AttachmentError, FibreMethod, MethodError, Smoothing, decompose_by,
};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::{box_surface, icosphere};
use pliant::testing::internals::fibres::MuscleEnd;

fn muscle() -> TriangleMesh {
    box_surface([0.2, 0.04, 0.04], 0.01)
}

fn refused(origin: AreaSource<'_>, insertion: AreaSource<'_>) -> AttachmentError {
    Attachment::new(&muscle(), origin, insertion).expect_err("refused")
}

fn beyond(x: f64, mesh: &TriangleMesh) -> Vec<u32> {
    let on = |v: &Point3<f64>| v.x * x.signum() >= x.abs();
    (0..mesh.vertices.len())
        .filter(|&v| on(&mesh.vertices[v]))
        .map(|v| v as u32)
        .collect()
}

#[test]
fn areas() {
    let mesh = muscle();
    let (low, high) = (beyond(-0.0999, &mesh), beyond(0.0999, &mesh));
    let good = AreaSource::Vertices(&high);
    assert_eq!(
        refused(AreaSource::Vertices(&[]), good),
        AttachmentError::Empty {
            end: MuscleEnd::Origin
        }
    );
    let nothing = TriangleMesh::default();
    assert_eq!(
        refused(good, AreaSource::Patch(&nothing)),
        AttachmentError::Empty {
            end: MuscleEnd::Insertion
        }
    );
    let error = refused(AreaSource::Vertices(&[100_000]), good);
    assert_eq!(
        error,
        AttachmentError::NoSuchVertex {
            end: MuscleEnd::Origin,
            vertex: 100_000,
            count: mesh.vertices.len()
        }
    );
    let error = refused(good, good);
    assert!(
        matches!(error, AttachmentError::Overlapping { count, .. } if count == high.len()),
        "{error}"
    );
    let mut away = icosphere(0.01, 1);
    away.vertices
        .iter_mut()
        .for_each(|v| *v += Vector3::new(3.0, 0.0, 0.0));
    let error = refused(AreaSource::Patch(&away), AreaSource::Vertices(&low));
    assert!(
        matches!(error, AttachmentError::OffSurface { distance, .. } if (distance - 2.89).abs() <= 0.01),
        "{error}"
    );
    let error = refused(AreaSource::Near(&away, 0.005), AreaSource::Vertices(&low));
    assert!(
        matches!(error, AttachmentError::NothingNear { distance, .. } if distance > 2.8),
        "{error}"
    );
    assert!(error.to_string().contains("greater distance"));
}

#[test]
fn an_area_near_a_bone_is_what_lies_near_it() {
    let mesh = muscle();
    let mut bone = icosphere(0.03, 2);
    bone.vertices
        .iter_mut()
        .for_each(|v| *v += Vector3::new(-0.12, 0.0, 0.0));
    let high = beyond(0.0999, &mesh);
    let areas = Attachment::new(
        &mesh,
        AreaSource::Near(&bone, 0.002),
        AreaSource::Vertices(&high),
    )
    .expect("areas");
    let distance = |v: u32| {
        ((mesh.vertices[v as usize] - Point3::new(-0.12, 0.0, 0.0)).norm() - 0.03).max(0.0)
    };
    assert!(areas.origin.vertices.iter().all(|&v| distance(v) <= 0.0025));
    assert!(areas.origin.vertices.len() > 5 && areas.origin.vertices.len() < 40);
    assert!(areas.origin.patch.is_none());
}

#[test]
fn a_patch_further_away_has_tendons() {
    let mesh = muscle();
    let mut patch = box_surface([0.001, 0.02, 0.02], 0.01);
    patch
        .vertices
        .iter_mut()
        .for_each(|v| *v += Vector3::new(-0.13, 0.0, 0.0));
    let high = beyond(0.0999, &mesh);
    let areas = Attachment::new(
        &mesh,
        AreaSource::Patch(&patch),
        AreaSource::Vertices(&high),
    )
    .expect("areas");
    assert!(areas.origin.patch.is_some());
    let made = decompose(&mesh, &areas, HarmonicOptions::default()).expect("fibres");
    let q = pliant::fibres::quality::measure(&mesh, &made.closed, &areas, &made.fibres, [1.0]);
    assert!(
        q.tendon_length_max_m >= 0.029 && q.tendon_length_max_m <= 0.035,
        "{q:?}"
    );
    let tendons = pliant::fibres::quality::tendons(&areas.origin, &[made.fibres[0][0]]);
    assert!((tendons[0][1].x + 0.1295).abs() <= 1e-9, "{tendons:?}");
}

#[test]
fn muscles() {
    let mesh = muscle();
    let (low, high) = (beyond(-0.0999, &mesh), beyond(0.0999, &mesh));
    let areas = Attachment::new(
        &mesh,
        AreaSource::Vertices(&low),
        AreaSource::Vertices(&high),
    )
    .expect("areas");
    for (count, points) in [(0, 15), (100, 1)] {
        let error =
            decompose(&mesh, &areas, HarmonicOptions { count, points }).expect_err("refused");
        assert_eq!(error, DecompositionError::TooFew { count, points });
    }
    let mut flat = mesh.clone();
    flat.vertices.iter_mut().for_each(|v| v.y = 0.0);
    let error = decompose(&flat, &areas, HarmonicOptions::default()).expect_err("refused");
    assert!(
        matches!(error, DecompositionError::NoInside { .. }),
        "{error}"
    );
    // Two boxes with an area on each.
    let mut two = mesh.clone();
    let count = two.vertices.len() as u32;
    two.vertices.extend(
        mesh.vertices
            .iter()
            .map(|v| v + Vector3::new(0.0, 0.1, 0.0)),
    );
    two.triangles
        .extend(mesh.triangles.iter().map(|t| t.map(|v| v + count)));
    let other: Vec<u32> = high.iter().map(|v| v + count).collect();
    let areas = Attachment::new(
        &two,
        AreaSource::Vertices(&low),
        AreaSource::Vertices(&other),
    )
    .expect("areas");
    let error = decompose(&two, &areas, HarmonicOptions::default()).expect_err("refused");
    assert!(
        matches!(error, DecompositionError::NotJoined { .. }),
        "{error}"
    );
}

#[test]
fn what_is_stopped_says_so() {
    let mesh = muscle();
    let (low, high) = (beyond(-0.0999, &mesh), beyond(0.0999, &mesh));
    let areas = Attachment::new(
        &mesh,
        AreaSource::Vertices(&low),
        AreaSource::Vertices(&high),
    )
    .expect("areas");
    let options = HarmonicOptions {
        count: 40,
        points: 15,
    };
    let asked = std::cell::Cell::new(0);
    let free = decompose_with(
        &mesh,
        &areas,
        &[],
        options,
        &|_: &str, done: usize, of: usize| {
            asked.set(asked.get() + 1);
            goes_on(done <= of)
        },
    );
    assert_eq!(
        free.expect("fibres").fibres,
        decompose(&mesh, &areas, options).expect("fibres").fibres
    );
    assert!(asked.get() >= 40, "asked {} times", asked.get());
    // Stops at each check, with no check afterwards.
    for last in 0..asked.get() {
        let left = std::cell::Cell::new(last);
        let stopped = decompose_with(
            &mesh,
            &areas,
            &[],
            options,
            &|_: &str, _: usize, _: usize| {
                assert!(left.get() >= 0, "asked again");
                left.set(left.get() - 1);
                goes_on(left.get() >= 0)
            },
        );
        assert_eq!(
            stopped.err(),
            Some(DecompositionError::Stopped),
            "at {last}"
        );
    }
    let smoothing = Smoothing {
        steps: 1_000_000,
        factor: 0.5,
    };
    let made = decompose_by(
        &mesh,
        &areas,
        FibreMethod::Harmonic,
        options,
        smoothing,
        &|stage: &str, done: usize, _: usize| goes_on(stage != "passes of smoothing" || done < 600),
    );
    assert!(matches!(
        made,
        Err(MethodError::Flow(DecompositionError::Stopped))
    ));
}

/// What progress answers to a decomposition that goes on or not.
fn goes_on(it_does: bool) -> std::ops::ControlFlow<()> {
    match it_does {
        true => std::ops::ControlFlow::Continue(()),
        false => std::ops::ControlFlow::Break(()),
    }
}
