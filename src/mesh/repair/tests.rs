use super::*;
use crate::mesh::Health;
use crate::mesh::health::FindingKind;
use crate::mesh::shapes::{box_surface, icosphere};
use crate::testing::Draw;
use nalgebra::{Point3, Vector3};
use proptest::prelude::*;

fn steps(repaired: &Repaired) -> Vec<RepairStep> {
    repaired.changes.iter().map(|c| c.step).collect()
}

fn plain(mesh: &TriangleMesh) -> Repaired {
    repair(mesh, &[], &RepairOptions::default())
}

fn append(mesh: &mut TriangleMesh, other: &TriangleMesh, by: Vector3<f64>) {
    let count = mesh.vertices.len() as u32;
    mesh.vertices.extend(other.vertices.iter().map(|p| p + by));
    mesh.triangles
        .extend(other.triangles.iter().map(|t| t.map(|v| v + count)));
}

/// Merges all coincident vertices.
fn weld(mesh: &mut TriangleMesh) {
    let first = crate::mesh::coincident::first_in_place(&mesh.vertices);
    mesh.triangles
        .iter_mut()
        .flatten()
        .for_each(|v| *v = first[*v as usize]);
}

fn cube() -> TriangleMesh {
    box_surface([1.0, 1.0, 1.0], 1.0)
}

#[test]
fn a_sound_surface_keeps_its_bits() {
    for mesh in [icosphere(0.1, 3), cube()] {
        let repaired = repair(
            &mesh,
            &[vec![0, 1]],
            &RepairOptions {
                close_holes: 99,
                keep_largest: true,
                ..RepairOptions::default()
            },
        );
        assert_eq!(
            (repaired.mesh, repaired.changes, repaired.lines),
            (mesh, Vec::new(), vec![vec![0, 1]])
        );
    }
}

#[test]
fn seams_are_joined() {
    // Every triangle has its own vertices, as in STL.
    let whole = icosphere(1.0, 2);
    let soup = TriangleMesh {
        vertices: (0..whole.triangles.len())
            .flat_map(|t| whole.corners(t))
            .collect(),
        triangles: (0..whole.triangles.len() as u32)
            .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
            .collect(),
    };
    let repaired = plain(&soup);
    assert_eq!(
        steps(&repaired),
        [RepairStep::MergedVertices, RepairStep::DroppedVertices]
    );
    assert_eq!(
        (repaired.mesh.vertices.len(), repaired.moved),
        (whole.vertices.len(), 0.0)
    );
    assert!(Health::of(&repaired.mesh).is_fit());
    // Slightly apart, they are joined only within the given distance.
    let mut draw = Draw::new(4);
    let apart: Vec<_> = soup
        .vertices
        .iter()
        .map(|p| p + draw.direction() * 1e-4)
        .collect();
    let apart = TriangleMesh {
        vertices: apart,
        ..soup
    };
    assert!(!Health::of(&plain(&apart).mesh).is_fit());
    let repaired = repair(
        &apart,
        &[],
        &RepairOptions {
            merge_within: 3e-4,
            ..RepairOptions::default()
        },
    );
    assert!(Health::of(&repaired.mesh).is_fit());
    assert!(
        repaired.moved > 1e-5 && repaired.moved <= 3e-4,
        "{}",
        repaired.moved
    );
    let away = deviation(&apart, &repaired.mesh);
    assert!(away.lost.is_some_and(|d| d > 1e-6 && d <= 3e-4), "{away:?}");
}

#[test]
fn two_cubes_on_one_edge_come_apart() {
    let mut mesh = cube();
    append(&mut mesh, &cube(), Vector3::new(1.0, 1.0, 0.0));
    weld(&mut mesh);
    assert_eq!(Health::of(&mesh).non_manifold_edges, 1);
    let repaired = plain(&mesh);
    let health = Health::of(&repaired.mesh);
    assert_eq!(
        (health.components, health.is_fit(), health.volume),
        (2, true, 2.0),
        "{:?}",
        repaired.changes
    );
    // The same with random directions of all triangles.
    let mut draw = Draw::new(11);
    mesh.triangles
        .iter_mut()
        .for_each(|t| t.rotate_left(draw.index(3)));
    mesh.triangles
        .iter_mut()
        .filter(|_| draw.index(2) == 0)
        .for_each(|t| t.swap(0, 1));
    let health = Health::of(&plain(&mesh).mesh);
    assert_eq!(
        (health.non_manifold_edges, health.inconsistent_edges),
        (0, 0)
    );
}

#[test]
fn a_fin_and_a_wall_come_off() {
    let mut finned = icosphere(1.0, 2);
    let sound = finned.triangles.len();
    let [a, b, _] = finned.triangles[0];
    finned.vertices.push(finned.vertices[a as usize] * 1.5);
    finned
        .triangles
        .push([a, b, finned.vertices.len() as u32 - 1]);
    let repaired = repair(
        &finned,
        &[],
        &RepairOptions {
            keep_largest: true,
            ..RepairOptions::default()
        },
    );
    assert_eq!(
        (
            repaired.mesh.triangles.len(),
            Health::of(&repaired.mesh).is_fit()
        ),
        (sound, true)
    );
    // Two cubes side by side with their common wall, which is two triangles.
    let mut walled = cube();
    append(&mut walled, &cube(), Vector3::x());
    weld(&mut walled);
    let repaired = plain(&walled);
    let health = Health::of(&repaired.mesh);
    // The wall is present twice, once per cube, and both cubes are closed without it.
    assert_eq!(
        (health.is_fit(), health.volume),
        (true, 2.0),
        "{:?} {:?}",
        repaired.changes,
        health.findings
    );
    // The wall once: it is separated, and the rest is closed.
    let mut once = plain(&walled).mesh;
    let on_wall = |p: &Point3<f64>| p.x == 0.5;
    let wall: Vec<u32> = (0..once.vertices.len() as u32)
        .filter(|v| on_wall(&once.vertices[*v as usize]))
        .collect();
    let is_at = |v: &&u32, y: f64, z: f64| once.vertices[**v as usize] == Point3::new(0.5, y, z);
    let find = |y: f64, z: f64| *wall.iter().find(|v| is_at(v, y, z)).expect("corner");
    let [p, q, r, s] = [
        find(-0.5, -0.5),
        find(0.5, -0.5),
        find(0.5, 0.5),
        find(-0.5, 0.5),
    ];
    once.triangles.extend([[p, q, r], [p, r, s]]);
    assert_eq!(Health::of(&once).non_manifold_edges, 4);
    let repaired = repair(
        &once,
        &[],
        &RepairOptions {
            keep_largest: true,
            ..RepairOptions::default()
        },
    );
    let health = Health::of(&repaired.mesh);
    assert_eq!(
        (health.is_fit(), health.volume),
        (true, 2.0),
        "{:?}",
        repaired.changes
    );
}

#[test]
fn triangles_without_area_are_cut_and_nothing_moves() {
    let mut mesh = box_surface([1.0, 1.0, 1.0], 0.25);
    let (volume, area) = (mesh.volume(), mesh.area());
    // A cap: a side is divided for one of its triangles alone, and a triangle without area fills the slit.
    let [a, b, c] = mesh.triangles[0];
    let middle = mesh.vertices.len() as u32;
    mesh.vertices.push(nalgebra::center(
        &mesh.vertices[a as usize],
        &mesh.vertices[b as usize],
    ));
    mesh.triangles[0] = [a, middle, c];
    mesh.triangles.extend([[middle, b, c], [a, b, middle]]);
    // A needle: a vertex is doubled along two edges of its ring.
    let v = mesh.triangles[40][0];
    let copy = mesh.vertices.len() as u32;
    mesh.vertices.push(mesh.vertices[v as usize]);
    let topology = Topology::new(&mesh);
    let ring: Vec<u32> = topology.triangles_of_vertex(v as usize).to_vec();
    let [start, next] = [ring[0], ring[0]].map(|t| mesh.triangles[t as usize]);
    let k = start.iter().position(|w| *w == v).expect("of the ring");
    let (p, q) = (start[(k + 1) % 3], next[(k + 2) % 3]);
    mesh.triangles[ring[0] as usize][k] = copy;
    mesh.triangles.extend([[v, p, copy], [v, copy, q]]);
    let sick = Health::of(&mesh);
    assert_eq!(
        (sick.zero_area, sick.is_fit()),
        (3, true),
        "{:?}",
        sick.findings
    );
    let repaired = plain(&mesh);
    let health = Health::of(&repaired.mesh);
    assert_eq!(
        (health.zero_area, health.is_fit(), repaired.moved),
        (0, true, 0.0),
        "{:?}",
        repaired.changes
    );
    assert!((health.volume - volume).abs() <= 1e-15 && (health.area - area).abs() <= 1e-14);
    let away = deviation(&mesh, &repaired.mesh);
    assert!(
        away.lost.is_some_and(|d| d <= 1e-15) && away.added.is_some_and(|d| d <= 1e-15),
        "{away:?}"
    );
}

#[test]
fn holes_are_closed_by_choice() {
    let mut mesh = icosphere(1.0, 2);
    mesh.triangles
        .retain(|t| !t.contains(&3) && !t.contains(&100));
    let rims = |mesh: &TriangleMesh| Health::of(mesh).boundary_loops;
    assert_eq!((rims(&mesh), rims(&plain(&mesh).mesh)), (2, 2));
    let of = |close_holes| {
        repair(
            &mesh,
            &[],
            &RepairOptions {
                close_holes,
                ..RepairOptions::default()
            },
        )
    };
    assert_eq!(
        [rims(&of(4).mesh), rims(&of(5).mesh), rims(&of(6).mesh)],
        [2, 1, 0]
    );
    let repaired = of(6);
    assert!(
        Health::of(&repaired.mesh).is_fit(),
        "{:?}",
        Health::of(&repaired.mesh).findings
    );
    assert_eq!(
        repaired.changes[0].message,
        "closed 2 holes with 7 triangles"
    );
    assert_eq!(repaired.mesh.volume(), of(500).mesh.volume());
}

#[test]
fn pieces_face_outward_and_keep_what_they_are_within() {
    let turned = |mut mesh: TriangleMesh| {
        mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        mesh
    };
    let small = TriangleMesh {
        vertices: cube().vertices.iter().map(|p| p * 0.5).collect(),
        ..cube()
    };
    // A cavity stays a cavity and a body inside stays a body; both are reversed together with their
    // container.
    for (inner, volume) in [(turned(small.clone()), 0.875), (small, 1.125)] {
        let mut mesh = cube();
        append(&mut mesh, &inner, Vector3::zeros());
        assert_eq!(plain(&mesh).mesh, mesh);
        assert!(Health::of(&mesh).is_fit());
        let mesh = turned(mesh);
        assert!(!Health::of(&mesh).is_fit());
        let repaired = plain(&mesh);
        assert!(Health::of(&repaired.mesh).is_fit());
        assert_eq!(repaired.mesh.volume(), volume);
    }
    let mut apart = cube();
    append(&mut apart, &turned(cube()), Vector3::x() * 3.0);
    // Volumes that cancel, or nearly: each piece is judged on its own.
    let health = Health::of(&apart);
    assert_eq!(health.volume, 0.0);
    let found: Vec<_> = health.findings.iter().map(|f| f.kind.code()).collect();
    assert_eq!(found, ["E038", "W013"], "{}", health.findings[0].message);
    append(&mut apart, &cube(), Vector3::x() * 6.0);
    let health = Health::of(&apart);
    assert!(health.volume > 0.9 && !health.is_fit());
    let message = "1 of 3 closed pieces turned inward, the first with a volume of -1e0 at (";
    assert!(
        health.findings[0].message.starts_with(message),
        "{}",
        health.findings[0].message
    );
    let mut apart = cube();
    append(&mut apart, &turned(cube()), Vector3::x() * 3.0);
    let repaired = plain(&apart);
    assert_eq!(
        (repaired.mesh.volume(), repaired.changes[0].count),
        (2.0, 12)
    );
    assert_eq!(repaired.changes[0].elements, (12..24).collect::<Vec<u32>>());
}

#[test]
fn a_moebius_strip_stays_one_sided() {
    let strip: Vec<[u32; 3]> = (0..7u32).map(|k| [k, (k + 1) % 7, (k + 2) % 7]).collect();
    let mut draw = Draw::new(2);
    let mesh = TriangleMesh {
        vertices: (0..7).map(|_| draw.direction().into()).collect(),
        triangles: strip,
    };
    let health = Health::of(&plain(&mesh).mesh);
    assert!(!health.orientable && !health.is_fit());
}

/// One side of a surface has points on an edge that the other side lacks, and a fan without area
/// connects them.
#[test]
fn a_row_of_flat_triangles_is_cut_whole() {
    for count in [1, 5, 50, 300] {
        let mut mesh = cube();
        let [a, z, c] = mesh.triangles[0];
        let (p, q) = (mesh.vertices[a as usize], mesh.vertices[z as usize]);
        let first = mesh.vertices.len() as u32;
        // Dyadic shares of a side of length 1 lie on it exactly.
        mesh.vertices
            .extend((1..=count).map(|k| p + (q - p) * (f64::from(k) / 512.0)));
        let chain: Vec<u32> = [a]
            .into_iter()
            .chain(first..first + count)
            .chain([z])
            .collect();
        mesh.triangles.swap_remove(0);
        mesh.triangles
            .extend(chain.windows(2).map(|w| [w[0], w[1], c]));
        mesh.triangles
            .extend(chain[1..].windows(2).map(|w| [a, w[1], w[0]]));
        let sick = Health::of(&mesh);
        assert_eq!(
            (sick.zero_area as u32, sick.is_fit()),
            (count, true),
            "{:?}",
            sick.findings
        );
        let repaired = plain(&mesh);
        let health = Health::of(&repaired.mesh);
        assert_eq!(
            (
                health.zero_area,
                health.is_fit(),
                repaired.changes[0].count as u32
            ),
            (0, true, count)
        );
        assert!((health.volume - 1.0).abs() <= 1e-13);
    }
}

#[test]
fn pieces_that_touch_are_not_within_one_another() {
    // The first vertex of the second cube lies on a wall of the first.
    let mut mesh = cube();
    mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    append(&mut mesh, &cube(), Vector3::y());
    let repaired = plain(&mesh);
    assert_eq!(
        (repaired.mesh.volume(), repaired.changes[0].count),
        (2.0, 12)
    );
}

#[test]
fn gaps_around_a_triangle_that_hangs_by_its_corners_are_closed() {
    // Of four triangles that divide one, the corner ones are missing: the middle one is attached by
    // points only.
    let mut mesh = icosphere(1.0, 3);
    let whole = mesh.clone();
    mesh.triangles.drain(100..103);
    let before = mesh.triangles.clone();
    let mended = repair(
        &mesh,
        &[],
        &RepairOptions {
            close_holes: 3,
            ..RepairOptions::default()
        },
    );
    assert!(
        Health::of(&mended.mesh).is_fit(),
        "{:?}",
        Health::of(&mended.mesh).findings
    );
    assert_eq!(mended.mesh.triangles[..before.len()], before);
    let sorted = |mesh: &TriangleMesh| {
        let mut all: Vec<[u32; 3]> = mesh.triangles.clone();
        // From the lowest corner, so that the direction of rotation matters.
        all.iter_mut().for_each(|t| {
            (0..2).for_each(|_| {
                if t[0] > t[1] || t[0] > t[2] {
                    t.rotate_left(1)
                }
            })
        });
        all.sort_unstable();
        all
    };
    assert_eq!(
        sorted(&mended.mesh),
        sorted(&whole),
        "the same triangles as before they were removed"
    );
    assert_eq!(
        mended
            .changes
            .iter()
            .map(|c| (c.step, c.count))
            .collect::<Vec<_>>(),
        [(RepairStep::ClosedHoles, 3)]
    );
    // Without closing holes, the repair removes the triangle.
    let apart = repair(&mesh, &[], &RepairOptions::default());
    assert_eq!(Health::of(&apart.mesh).components, 2);
}

#[test]
fn a_loose_triangle_is_no_hole() {
    let mut mesh = cube();
    append(
        &mut mesh,
        &TriangleMesh {
            vertices: cube().vertices,
            triangles: vec![[0, 1, 2]],
        },
        Vector3::x() * 4.0,
    );
    let repaired = repair(
        &mesh,
        &[],
        &RepairOptions {
            close_holes: 9,
            ..RepairOptions::default()
        },
    );
    assert!(!Health::of(&repaired.mesh).is_fit());
}

/// Meshes for which a traversal around a vertex, an edge or a boundary loop, or along a ray, could
/// take quadratic time: this test would then run for hours.
#[test]
fn heaps_end() {
    let n = 30_000u32;
    let at = |k: u32, y: f64| Point3::new(f64::from(k), y, f64::from(k % 7));
    let line: Vec<Point3<f64>> = (0..n + 2)
        .map(|k| Point3::new(f64::from(k % 1000), 0.0, 0.0))
        .collect();
    let curve: Vec<Point3<f64>> = (0..2 * n + 2)
        .map(|k| at(k, f64::from(k * k % 101)))
        .collect();
    let mut stacked = TriangleMesh::default();
    let four = crate::mesh::shapes::tetrahedron();
    (0..n / 4).for_each(|k| append(&mut stacked, &four, Vector3::x() * f64::from(k)));
    let heaps = [
        (
            "flat triangles about a vertex",
            line.clone(),
            (0..n).map(|k| [0, k + 1, k + 2]).collect::<Vec<_>>(),
        ),
        (
            "flat triangles in a row",
            line,
            (0..n).map(|k| [k, k + 1, k + 2]).collect(),
        ),
        (
            "triangles about an edge",
            curve.clone(),
            (0..n).map(|k| [0, 1, k + 2]).collect(),
        ),
        (
            "triangles that touch in a vertex",
            curve.clone(),
            (0..n).map(|k| [0, 2 * k + 1, 2 * k + 2]).collect(),
        ),
        (
            "one long rim",
            curve,
            (0..n).map(|k| [k, k + 1, k + 2]).collect(),
        ),
        ("pieces in one line", stacked.vertices, stacked.triangles),
    ];
    for (name, vertices, triangles) in heaps {
        let mesh = TriangleMesh {
            vertices,
            triangles,
        };
        let repaired = repair(
            &mesh,
            &[],
            &RepairOptions {
                close_holes: 8,
                ..RepairOptions::default()
            },
        );
        assert_eq!(
            crate::testing::check_repaired(&mesh, &[], &repaired),
            Ok(()),
            "{name}"
        );
        assert!(
            deviation(&mesh, &repaired.mesh)
                .lost
                .is_none_or(f64::is_finite),
            "{name}"
        );
    }
}

/// Properties of every repair.
fn assert_repaired(mesh: &TriangleMesh, repaired: &Repaired) {
    assert_eq!(
        crate::testing::check_repaired(mesh, &[], repaired),
        Ok(()),
        "{mesh:?}\n{:?}",
        repaired.changes
    );
    let health = Health::of(&repaired.mesh);
    let closed = health.boundary_edges == 0 && health.triangles > 0 && health.orientable;
    assert!(!closed || health.volume >= -1e-15, "{mesh:?}");
}

proptest! {
    #[test]
    fn any_heap_of_triangles_becomes_manifold(seed in any::<u64>(), corners in 4usize..14, count in 1usize..40, holes in 0usize..9) {
        let mut draw = Draw::new(seed);
        // On a coarse grid vertices coincide and triangles are flat or duplicate.
        let mut place = || Vector3::new(draw.between(0.0, 3.0).floor(), draw.between(0.0, 3.0).floor(), draw.between(0.0, 2.0).floor());
        let vertices: Vec<Point3<f64>> = (0..corners).map(|_| place().into()).collect();
        let mut corner = || draw.index(corners) as u32;
        let triangles: Vec<[u32; 3]> = (0..count).map(|_| [corner(), corner(), corner()]).filter(|[a, b, c]| a != b && b != c && c != a).collect();
        let mesh = TriangleMesh { vertices, triangles };
        let options = RepairOptions { close_holes: holes, ..RepairOptions::default() };
        let repaired = repair(&mesh, &[], &options);
        assert_repaired(&mesh, &repaired);
    }

    #[test]
    fn a_sphere_with_defects_is_a_sphere_again(seed in any::<u64>()) {
        let mut draw = Draw::new(seed);
        let sound = icosphere(1.0, 2);
        let mut mesh = sound.clone();
        let mut unharmed: Vec<usize> = (0..sound.triangles.len()).collect();
        for _ in 0..6 {
            let t = unharmed.swap_remove(draw.index(unharmed.len()));
            let [a, b, c] = mesh.triangles[t];
            match draw.index(5) {
                0 => mesh.triangles.push([b, c, a]),
                1 => mesh.triangles[t] = [b, a, c],
                2 => mesh.vertices.push(draw.direction().into()),
                3 => {
                    // A triangle with its own vertices.
                    let next = mesh.vertices.len() as u32;
                    mesh.vertices.extend([a, b, c].map(|v| mesh.vertices[v as usize]));
                    mesh.triangles[t] = [next, next + 1, next + 2];
                }
                _ => {
                    // A side divided for one triangle only; a triangle without area fills the gap.
                    let next = mesh.vertices.len() as u32;
                    mesh.vertices.push(mesh.vertices[a as usize]);
                    mesh.triangles[t] = [next, b, c];
                    mesh.triangles.extend([[a, b, next], [a, next, c]]);
                }
            }
        }
        let repaired = plain(&mesh);
        assert_repaired(&mesh, &repaired);
        let health = Health::of(&repaired.mesh);
        prop_assert!(health.is_fit(), "{:?}\n{:?}", health.findings, repaired.changes);
        prop_assert!((health.volume - sound.volume()).abs() <= 1e-13);
        prop_assert!(health.findings.iter().all(|f| matches!(f.kind, FindingKind::DuplicateVertices)), "{:?}", health.findings);
        let again = plain(&repaired.mesh);
        prop_assert!(again.changes.is_empty() && again.mesh == repaired.mesh);
    }
}
