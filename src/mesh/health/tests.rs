use super::*;
use crate::mesh::shapes::{box_surface, icosphere};
use proptest::prelude::*;

fn codes(mesh: &TriangleMesh) -> Vec<&'static str> {
    Health::of(mesh)
        .findings
        .iter()
        .map(|f| f.kind.code())
        .collect()
}

#[test]
fn a_sound_surface_has_no_finding() {
    for mesh in [icosphere(0.1, 3), box_surface([1.0, 2.0, 3.0], 0.5)] {
        let health = Health::of(&mesh);
        assert!(
            health.findings.is_empty() && health.is_fit(),
            "{:?}",
            health.findings
        );
        assert_eq!(
            (health.genus, health.components, health.boundary_loops),
            (Some(0), 1, 0)
        );
        assert!(health.self_intersections_complete);
    }
}

/// Spheres with one defect each, and all codes that the defect must give.
fn ailing() -> Vec<(&'static str, TriangleMesh, Vec<&'static str>)> {
    let sphere = || icosphere(1.0, 2);
    let with = |change: &dyn Fn(&mut TriangleMesh)| {
        let mut mesh = sphere();
        change(&mut mesh);
        mesh
    };
    let fin = |m: &mut TriangleMesh| {
        let [a, b, _] = m.triangles[0];
        m.vertices.push(m.vertices[a as usize] * 1.5);
        m.triangles.push([a, b, m.vertices.len() as u32 - 1]);
    };
    let needle = |m: &mut TriangleMesh| {
        let [a, b, _] = m.triangles[0];
        m.vertices[a as usize] = m.vertices[b as usize];
    };
    let dent = |m: &mut TriangleMesh| m.vertices[0] *= -1.2;
    let second = |m: &mut TriangleMesh| {
        let count = m.vertices.len() as u32;
        let far = sphere();
        m.vertices.extend(
            far.vertices
                .iter()
                .map(|p| p + nalgebra::Vector3::x() * 5.0),
        );
        m.triangles
            .extend(far.triangles.iter().map(|t| t.map(|v| v + count)));
    };
    let touching = |m: &mut TriangleMesh| {
        second(m);
        let half = m.triangles.len() / 2;
        let (near, other) = (m.triangles[0][0], m.triangles[half][0]);
        m.triangles
            .iter_mut()
            .flatten()
            .filter(|v| **v == other)
            .for_each(|v| *v = near);
    };
    vec![
        ("hole", with(&|m| m.triangles.truncate(319)), vec!["E032"]),
        ("fin", with(&fin), vec!["E030", "E032"]),
        (
            "one turned",
            with(&|m| m.triangles[5].swap(0, 1)),
            vec!["E031"],
        ),
        (
            "inside out",
            with(&|m| m.triangles.iter_mut().for_each(|t| t.swap(0, 1))),
            vec!["E038"],
        ),
        (
            "unused",
            with(&|m| m.vertices.push(nalgebra::Point3::new(9.0, 0.0, 0.0))),
            vec!["W005"],
        ),
        (
            "duplicate",
            with(&|m| m.triangles.push(m.triangles[3])),
            vec!["E030", "W004"],
        ),
        (
            "needle",
            with(&needle),
            vec!["W006", "W007", "W009", "W011"],
        ),
        ("dent", with(&dent), vec!["W007", "W009"]),
        ("two", with(&second), vec!["W013"]),
        (
            "touching",
            with(&touching),
            vec!["W005", "W007", "W009", "W012"],
        ),
        ("nothing", TriangleMesh::default(), vec!["E046"]),
    ]
}

#[test]
fn each_ailment_is_found() {
    for (name, mesh, expected) in ailing() {
        let found = codes(&mesh);
        // A vertex far from its place gives slivers and intersections besides the intended defect.
        let rest: Vec<_> = found.iter().filter(|c| !expected.contains(c)).collect();
        assert!(
            rest.is_empty(),
            "{name}: {found:?} has more than {expected:?}"
        );
        let needed = expected
            .iter()
            .filter(|c| !["W007", "W009"].contains(*c) || name == "dent" && **c == "W007");
        assert!(
            needed.into_iter().all(|c| found.contains(c)),
            "{name}: {found:?} lacks some of {expected:?}"
        );
    }
}

#[test]
fn findings_name_their_place() {
    let mut mesh = icosphere(1.0, 1);
    let [a, b, _] = mesh.triangles[0];
    mesh.triangles[0].swap(0, 1);
    let health = Health::of(&mesh);
    let finding = &health.findings[0];
    assert_eq!((finding.count, finding.place.triangles.len()), (3, 2));
    let text = &finding.message;
    assert!(text.starts_with(
        "3 edges run the same way by both triangles, 1 triangle to be turned round; the first: "
    ));
    assert!(
        finding
            .place
            .vertices
            .iter()
            .all(|v| [a, b, mesh.triangles[0][2]].contains(v)),
        "{text}"
    );
    assert!(
        finding.place.point.is_some() && text.contains(" at ("),
        "{text}"
    );
}

#[test]
fn a_vertex_far_away_has_no_say() {
    for far in [1e120, 1e200, 1.7e308] {
        let mut mesh = icosphere(1.0, 2);
        mesh.vertices.push(Point3::new(far, 0.0, 0.0));
        assert_eq!(codes(&mesh), ["W005"], "{far}");
    }
}

#[test]
fn codes_are_told_apart() {
    let mut codes: Vec<_> = FindingKind::ALL.iter().map(|k| k.code()).collect();
    codes.sort_unstable();
    codes.dedup();
    assert_eq!(codes.len(), FindingKind::ALL.len());
    assert!(FindingKind::ALL.windows(2).all(|w| w[0] < w[1]));
}

#[test]
fn a_heap_of_triangles_is_not_searched_for_ever() {
    // 20,000 triangles at one position would give 200 million pairs.
    let count = 20_000u32;
    let mut draw = crate::testing::Draw::new(8);
    let vertices = (0..3 * count).map(|_| draw.direction().into()).collect();
    let triangles = (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let health = Health::of(&TriangleMesh {
        vertices,
        triangles,
    });
    assert!(!health.self_intersections_complete && health.self_intersections > 1000);
    let said = health
        .findings
        .iter()
        .find(|f| f.kind == FindingKind::SelfIntersection)
        .expect("crossings");
    assert!(said.message.starts_with("at least "), "{}", said.message);
}

proptest! {
    #[test]
    fn crossings_are_those_of_a_search_of_all_pairs(seed in any::<u64>()) {
        let mut draw = crate::testing::Draw::new(seed);
        let vertices: Vec<Point3<f64>> = (0..12).map(|_| (draw.direction() * draw.between(0.0, 1.0)).into()).collect();
        let mut corner = || draw.index(12) as u32;
        let triangles: Vec<[u32; 3]> = (0..30).map(|_| [corner(), corner(), corner()]).filter(|[a, b, c]| a != b && b != c && c != a).collect();
        let names: Vec<u32> = (0..12).collect();
        let skipped = vec![false; triangles.len()];
        let mesh = TriangleMesh { vertices, triangles };
        let found = crossings(&mesh, &names, &skipped);
        let TriangleMesh { vertices, triangles } = mesh;
        let mut expected = Vec::new();
        for s in 0..triangles.len() {
            for t in s + 1..triangles.len() {
                if predicates::intersect(triangles[s], triangles[t], |v| vertices[v as usize]) {
                    expected.push([s as u32, t as u32]);
                }
            }
        }
        prop_assert_eq!(found.count, expected.len());
        expected.truncate(100);
        prop_assert_eq!(found.pairs, expected);
        prop_assert!(found.complete);
    }
}
