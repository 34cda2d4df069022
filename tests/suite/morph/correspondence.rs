//! Correspondence of two surfaces: ends, point data, pairs, alignment of the maps, rejections.

use nalgebra::{Point3, UnitQuaternion, Vector3};
use pliant::mesh::{Topology, TriangleMesh, measures, shapes};
use pliant::morph::AlignError;
use pliant::morph::blend::{Path, hermite, turning};
use pliant::morph::{
    Correspondence, CorrespondenceError, CorrespondenceMethod, CorrespondenceSettings, Shared,
};
use pliant::morph::{Relaxation, SphereError, flipped};
use pliant::testing::internals::morph::{Alike, Start};

use super::{bent, stretched, tube};
use crate::tolerances::{T9, T18, worst};

fn between(
    first: &TriangleMesh,
    second: &TriangleMesh,
    pairs: &[[u32; 2]],
    settings: &CorrespondenceSettings,
) -> Correspondence {
    Correspondence::new([first, second], pairs, settings, &pliant::progress::Silent)
        .unwrap_or_else(|e| panic!("{e}"))
}

/// A body without symmetry, long enough for distinct axes.
fn lopsided(subdivisions: u32) -> TriangleMesh {
    let mut mesh = shapes::icosphere(1.0, subdivisions);
    for v in &mut mesh.vertices {
        let bump = 0.5 * (-4.0 * (*v - Point3::new(0.8, 0.6, 0.0)).norm_squared()).exp();
        *v = Point3::from(v.coords.component_mul(&Vector3::new(2.0, 1.0, 0.7)) * (1.0 + bump));
    }
    mesh
}

#[test]
fn both_ends_are_met_and_numbers_are_carried() {
    let (first, second) = (bent(2, 6.0, 2.0), tube(12, 20, 12.0));
    let both = between(&first, &second, &[], &CorrespondenceSettings::default());
    let counts = [first.vertices.len(), second.vertices.len()];
    assert_eq!(both.places[0][..counts[0]], first.vertices);
    assert_eq!(
        both.places[1][counts[0]..counts[0] + counts[1]],
        second.vertices
    );
    let topology = Topology::of_triangles(both.kinds.len(), &both.triangles);
    assert!(topology.is_closed() && topology.is_oriented() && topology.euler_characteristic() == 2);
    for (map, mesh) in both.maps.iter().zip([&first, &second]) {
        assert!(flipped(map.points(), map.triangles()).is_empty());
        assert_eq!(map.triangles(), mesh.triangles);
    }
    for (places, mesh) in both.places.iter().zip([&first, &second]) {
        let volume = measures::volume(places, &both.triangles);
        assert!(
            (volume - mesh.volume()).abs() <= T18 * mesh.length().powi(3),
            "{volume}"
        );
    }
    // A field that is linear in space is linear on each triangle: the carried value equals the
    // position.
    for side in 0..2 {
        let mesh = [&first, &second][side];
        let values: Vec<f64> = mesh.vertices.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
        let carried = both.carried(side, &values, 3);
        let off = both.places[side]
            .iter()
            .zip(carried.chunks(3))
            .map(|(p, c)| (p - Point3::new(c[0], c[1], c[2])).norm());
        assert!(worst(off) <= T18 * mesh.length());
    }
    // A NaN stays at its vertex and where its weight is positive.
    let mut values = vec![1.0; counts[0]];
    values[3] = f64::NAN;
    let carried = both.carried(0, &values, 1);
    assert!(carried[3].is_nan() && carried[..counts[0]].iter().filter(|v| v.is_nan()).count() == 1);
    assert!(carried.iter().all(|v| v.is_nan() || (v - 1.0).abs() <= T18));
}

#[test]
fn the_first_topology_loses_what_the_merged_one_keeps() {
    let (first, second) = (shapes::box_surface([1.0; 3], 1.0), lopsided(2));
    let own = between(
        &first,
        &second,
        &[],
        &CorrespondenceSettings {
            shared: Shared::First,
            ..CorrespondenceSettings::default()
        },
    );
    assert_eq!(
        (own.places[0].as_slice(), own.triangles.as_slice()),
        (&first.vertices[..], &first.triangles[..])
    );
    let all = between(&first, &second, &[], &CorrespondenceSettings::default());
    let volume =
        |b: &Correspondence| measures::volume(&b.places[1], &b.triangles) / second.volume();
    assert!(
        (volume(&all) - 1.0).abs() <= T18 && volume(&own) < 0.8,
        "{} {}",
        volume(&all),
        volume(&own)
    );
}

#[test]
fn a_turned_copy_is_found_and_one_as_it_is_placed() {
    let first = lopsided(2);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.2, 0.1, 1.9));
    let turned = TriangleMesh {
        vertices: first
            .vertices
            .iter()
            .map(|p| turn * p * 3.0 + Vector3::new(5.0, 0.0, 0.0))
            .collect(),
        ..first.clone()
    };
    for second in [&turned, &first] {
        let both = between(
            &first,
            second,
            &[],
            &CorrespondenceSettings {
                shared: Shared::First,
                ..CorrespondenceSettings::default()
            },
        );
        let off = worst(
            both.places[1]
                .iter()
                .zip(&second.vertices)
                .map(|(p, q)| (p - q).norm()),
        ) / second.length();
        println!("{:?}: {off:e} of the size from the same vertex", both.start);
        // The map of a rotated copy differs, since some steps use coordinate axes; the map of the
        // same surface is the same.
        if second == &first {
            assert!(
                both.start == Start::Placed && off <= T9,
                "{:?} {off}",
                both.start
            );
        } else {
            assert!(off <= 0.05, "{off}");
        }
    }
}

#[test]
fn pairs_meet_exactly() {
    let (first, second) = (stretched(2, 2.0), bent(2, 4.0, 1.0));
    let vertex = |mesh: &TriangleMesh, along: Vector3<f64>| {
        let high = |v: &u32| mesh.vertices[*v as usize].coords.dot(&along);
        (0..mesh.vertices.len() as u32)
            .max_by(|a, b| high(a).total_cmp(&high(b)))
            .expect("vertices")
    };
    let pair = |a: Vector3<f64>, b: Vector3<f64>| [vertex(&first, a), vertex(&second, b)];
    let pairs = [
        pair(Vector3::x(), Vector3::x()),
        pair(Vector3::z(), Vector3::z()),
        pair(-Vector3::x(), -Vector3::x()),
    ];
    for count in 1..=3 {
        for shared in [Shared::First, Shared::Merged] {
            let both = between(
                &first,
                &second,
                &pairs[..count],
                &CorrespondenceSettings {
                    shared,
                    ..CorrespondenceSettings::default()
                },
            );
            // Two coincident vertices are no general position: the overlay rotates a map slightly.
            let within = if shared == Shared::First {
                T18
            } else {
                1e3 * both.turned
            };
            for [a, b] in &pairs[..count] {
                let there = (both.places[1][*a as usize] - second.vertices[*b as usize]).norm();
                assert!(there <= within * second.length(), "{count} pairs: {there}");
            }
            assert!(within <= 1e-3 && both.start == Start::Features);
            assert!(
                both.maps
                    .iter()
                    .all(|m| flipped(m.points(), m.triangles()).is_empty())
            );
        }
    }
}

#[test]
fn what_cannot_be_brought_together_is_refused() {
    let ball = stretched(1, 1.0);
    let refused =
        |meshes: [&TriangleMesh; 2], pairs: &[[u32; 2]], settings: &CorrespondenceSettings| {
            Correspondence::new(meshes, pairs, settings, &pliant::progress::Silent)
                .expect_err("refused")
        };
    let mut out = ball.clone();
    out.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let plain = CorrespondenceSettings::default();
    assert!(
        matches!(refused([&ball, &out], &[], &plain), CorrespondenceError::InsideOut { side: 1, volume } if volume < -3.0)
    );
    let open = TriangleMesh {
        triangles: ball.triangles[1..].to_vec(),
        ..ball.clone()
    };
    let error = refused([&open, &ball], &[], &plain);
    assert!(
        matches!(
            error,
            CorrespondenceError::Surface {
                side: 0,
                error: SphereError::Open { edges: 3, .. }
            }
        ),
        "{error}"
    );
    let far = AlignError::Vertex {
        vertex: 42,
        count: 42,
    };
    assert_eq!(
        refused([&ball, &ball], &[[0, 0], [42, 1]], &plain),
        CorrespondenceError::Align(far)
    );
    let same = AlignError::Same {
        first: 0,
        second: 1,
    };
    assert_eq!(
        refused([&ball, &ball], &[[0, 0], [0, 1]], &plain),
        CorrespondenceError::Align(same)
    );
    let relaxed = Relaxation {
        sweeps: 200,
        attempts: 1,
        threshold: 1e-6,
        ..Relaxation::default()
    };
    let long = CorrespondenceSettings {
        method: CorrespondenceMethod::Relaxation(relaxed),
        ..plain
    };
    let error = refused([&ball, &tube(16, 200, 70.0)], &[], &long);
    assert!(
        matches!(error, CorrespondenceError::Surface { side: 1, .. })
            && error.to_string().contains("robust"),
        "{error}"
    );
    let stopped = Correspondence::new(
        [&ball, &ball],
        &[],
        &plain,
        &|_: &str, _: usize, _: usize| std::ops::ControlFlow::Break(()),
    );
    assert_eq!(stopped.map(|b| b.turned), Err(CorrespondenceError::Stopped));
}

#[test]
fn tangents_of_a_turn_follow_its_arc() {
    let first = stretched(2, 3.0);
    let axis = Vector3::new(0.0, 0.0, 1.0);
    let turned = |angle: f64| -> Vec<Point3<f64>> {
        let turn = UnitQuaternion::from_scaled_axis(axis * angle);
        first.vertices.iter().map(|p| turn * p).collect()
    };
    let end = turned(1.0);
    let ends = [first.vertices.as_slice(), &end];
    let tangents = turning(ends).expect("shapes");
    let middle = hermite(ends, &tangents[0], &tangents[1], 0.5).expect("shapes");
    let off = |x: &[Point3<f64>]| {
        worst(x.iter().zip(turned(0.5)).map(|(p, q)| (p - q).norm())) / first.length()
    };
    let straight = Path::Linear.at(ends, 0.5).expect("shapes");
    // A cubic follows an arc of one radian to (1/24 - 1/32 - ...) of it; a straight line deviates
    // by 1 - cos(1/2).
    assert!(
        off(&middle) < 2e-3 && off(&straight) > 0.05,
        "{} {}",
        off(&middle),
        off(&straight)
    );
    let mut by_path = Path::Hermite(Box::new(tangents));
    assert_eq!(by_path.at(ends, 0.5).expect("shapes"), middle);
    assert_eq!(by_path.at(ends, 0.0).expect("shapes"), first.vertices);
}

/// A tube of radius `radius`, bent by `angle` \[rad\] from end to end.
fn curved(segments: u32, rings: u32, length: f64, radius: f64, angle: f64) -> TriangleMesh {
    let mut mesh = tube(segments, rings, length);
    let about = length / angle;
    for v in &mut mesh.vertices {
        let (turn, r) = (v.x / about, about + radius * v.y);
        *v = Point3::new(r * turn.sin(), r * turn.cos() - about, radius * v.z);
    }
    mesh
}

/// Volume and area at the midpoint, relative to those of a body of the mean size of both. A match
/// with the opposite side of the body reduces the volume, and every fold of the match reduces the
/// area.
fn halfway(
    first: &TriangleMesh,
    second: &TriangleMesh,
    alike: Alike,
) -> ([f64; 2], Correspondence) {
    let both = between(
        first,
        second,
        &[],
        &CorrespondenceSettings {
            alike,
            ..CorrespondenceSettings::default()
        },
    );
    assert!(
        both.maps
            .iter()
            .all(|m| flipped(m.points(), m.triangles()).is_empty())
    );
    let ends = [both.places[0].as_slice(), &both.places[1]];
    let middle = TriangleMesh {
        vertices: Path::Linear.at(ends, 0.5).expect("shapes"),
        triangles: both.triangles.clone(),
    };
    let volume = (0.5 * (first.volume().cbrt() + second.volume().cbrt())).powi(3);
    let area = (0.5 * (first.area().sqrt() + second.area().sqrt())).powi(2);
    ([middle.volume() / volume, middle.area() / area], both)
}

#[test]
fn long_bodies_keep_their_volume_halfway_without_pairs() {
    let straight = tube(16, 60, 20.0);
    for (name, second) in [
        ("another sample", tube(24, 80, 20.0)),
        ("bent", curved(20, 50, 20.0, 1.0, 1.0)),
        (
            "thinner, shorter and bent the other way",
            curved(14, 70, 16.0, 0.7, -0.8),
        ),
    ] {
        let ([volume, area], both) = halfway(&straight, &second, Alike::Drawn);
        let ([less, folded], turned) = halfway(&straight, &second, Alike::Turned);
        println!(
            "{name}: volume {volume:.3}, area {area:.3}; by a turn alone {less:.3}, {folded:.3}"
        );
        assert!(
            both.start == Start::Placed && both.drawn > 0.05 && turned.drawn == 0.0,
            "{name}"
        );
        assert!(
            (volume - 1.0).abs() < 0.03 && area > 0.96,
            "{name}: {volume} {area}"
        );
        // Control: a rotation of the whole map is not sufficient.
        assert!(less < 0.96 && folded < area, "{name}: {less} {folded}");
    }
}

#[test]
fn real_long_bodies_keep_their_volume_halfway_without_pairs() {
    let data = std::env::var("PLIANT_DATA").unwrap_or_else(|_| "../shared/data".into());
    let body = std::path::PathBuf::from(data).join("body");
    let read = |name: &str| {
        Some(
            pliant::io::read(&body.join(format!("{name}.obj")))
                .ok()?
                .mesh,
        )
    };
    for (first, second, within) in [
        ("bones/Femur.r", "bones/Tibia.r", 0.03),
        ("bones/Tibia.r", "bones/Femur.r", 0.03),
        ("bones/Radius.r", "bones/Ulna.r", 0.03),
        // One has its belly at the position of the other's tendon.
        (
            "muscles/Short_head_of_biceps_brachii.r",
            "muscles/Gracilis_muscle.r",
            0.09,
        ),
    ] {
        let (Some(a), Some(b)) = (read(first), read(second)) else {
            println!("skipped: no {first} or {second} in {}", body.display());
            continue;
        };
        let ([volume, area], _) = halfway(&a, &b, Alike::Drawn);
        let ([less, folded], _) = halfway(&a, &b, Alike::Turned);
        println!(
            "{first} to {second}: volume {volume:.3}, area {area:.3}; by a turn alone {less:.3}, {folded:.3}"
        );
        assert!(
            (volume - 1.0).abs() < within && area > 0.95,
            "{first} to {second}: {volume} {area}"
        );
        assert!(
            folded < area - 0.02 && less < volume,
            "{first} to {second}: {less} {folded}"
        );
    }
}
