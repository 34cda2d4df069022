//! Hierarchies, voxels and crossings compared with brute force, and the counter-examples of errata
//! B07 and B08.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, Point3, Vector3};
use pliant::contact::Surface;
use pliant::mesh::measures::Aabb;
use pliant::mesh::{Topology, TriangleMesh, shapes};
use pliant::testing::Draw;
use pliant::testing::internals::springs::contact::{
    BoundKind, Edge, EdgeOwners, Found, Hierarchy, Sheet, VoxelError, VoxelGrid, crossing,
    crossings_of,
};
use proptest::prelude::*;

use super::{moved, region, soup};

fn tree(mesh: &TriangleMesh) -> Hierarchy {
    Hierarchy::new(&mesh.vertices, &mesh.triangles)
}

fn box_of(mesh: &TriangleMesh, t: u32) -> Aabb {
    Aabb::of_points(&mesh.corners(t as usize))
}

#[test]
fn b11_one_layer_of_the_coarse_sheet_has_the_published_nodes() {
    let coarse = region(64);
    let found = tree(&coarse);
    assert_eq!((coarse.triangles.len(), found.len()), (3752, 7503));
    assert_eq!(found.levels()[6..9], [64, 128, 256]);
    assert_eq!(found.levels().iter().sum::<usize>(), 7503);
    assert_eq!(tree(&region(128)).len(), 2 * 14_756 - 1);
    // Control: with two layers, as counted in the table, the numbers differ.
    let mut two = coarse.clone();
    two.triangles.extend(coarse.triangles.iter());
    assert_ne!(tree(&two).len(), 7503);
}

/// Checks that each triangle occurs once and each box is the least around its content.
fn check_tree(found: &Hierarchy, mesh: &TriangleMesh) -> Result<(), String> {
    let mut seen = vec![0; mesh.triangles.len()];
    for node in 0..found.len() as u32 {
        let (bounds, kind) = found.node(node);
        let least = match kind {
            BoundKind::Leaf(t) => {
                seen[t as usize] += 1;
                box_of(mesh, t)
            }
            BoundKind::Inner([a, b]) if a > node && b > node => {
                found.node(a).0.union(found.node(b).0)
            }
            BoundKind::Inner(_) => return Err(format!("a child before node {node}")),
        };
        if *bounds != least {
            return Err(format!("node {node} has {bounds:?} and not {least:?}"));
        }
    }
    if seen.iter().all(|n| *n == 1) {
        Ok(())
    } else {
        Err("a triangle is missing or twice there".into())
    }
}

fn brute_force(a: &TriangleMesh, b: &TriangleMesh) -> Vec<[u32; 2]> {
    let meets = |s: u32, t: u32| box_of(a, s).intersects(&box_of(b, t));
    let with = |s: u32| {
        (0..b.triangles.len() as u32)
            .filter(move |&t| meets(s, t))
            .map(move |t| [s, t])
    };
    (0..a.triangles.len() as u32).flat_map(with).collect()
}

fn pairs(a: &Hierarchy, b: &Hierarchy) -> Vec<[u32; 2]> {
    let mut found = Vec::new();
    a.pairs(b, |s, t| found.push([s, t]));
    found.sort_unstable();
    found
}

/// The recursion as printed in the source: leaf against leaf, otherwise all children with all
/// children.
fn printed(a: &Hierarchy, i: u32, b: &Hierarchy, j: u32) -> usize {
    let ((n, of_n), (m, of_m)) = (a.node(i), b.node(j));
    match (of_n, of_m) {
        (BoundKind::Leaf(_), BoundKind::Leaf(_)) => usize::from(n.intersects(m)),
        (BoundKind::Inner(x), BoundKind::Inner(y)) if n.intersects(m) => x
            .iter()
            .flat_map(|&k| y.iter().map(move |&l| [k, l]))
            .map(|[k, l]| printed(a, k, b, l))
            .sum(),
        _ => 0,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn hierarchies_find_what_brute_force_finds_also_after_motion(seed in any::<u64>(), n in 1usize..60, m in 1usize..60) {
        let mut draw = Draw::new(seed);
        let (mut a, b) = (soup(&mut draw, n), soup(&mut draw, m));
        let (mut tree_a, tree_b) = (tree(&a), tree(&b));
        prop_assert_eq!(tree_a.len(), 2 * n - 1);
        prop_assert_eq!(check_tree(&tree_a, &a), Ok(()));
        prop_assert_eq!(pairs(&tree_a, &tree_b), brute_force(&a, &b));
        let size = draw.decades(-2.0, 1.0);
        let still = a.clone();
        a.vertices.iter_mut().for_each(|p| *p += draw.direction() * size);
        let before = pairs(&tree_a, &tree_b);
        tree_a.refit(&a.vertices, &a.triangles);
        prop_assert_eq!(check_tree(&tree_a, &a), Ok(()));
        let all = brute_force(&a, &b);
        prop_assert_eq!(&pairs(&tree_a, &tree_b), &all);
        prop_assert_eq!(pairs(&tree_b, &tree_a).len(), all.len());
        // The surfaces that bodies use find the same, also after a refit.
        let (mut surface, other) = (Surface::new(&still), Surface::new(&b));
        prop_assert_eq!(&surface.pairs(&other), &before);
        surface.refit(&a.vertices);
        prop_assert_eq!(&surface.pairs(&other), &all);
        let within = box_of(&b, 0);
        let mut met = Vec::new();
        tree_a.meeting(&within, |t| met.push(t));
        met.sort_unstable();
        let expected: Vec<u32> = (0..n as u32).filter(|&t| box_of(&a, t).intersects(&within)).collect();
        prop_assert_eq!(met, expected);
        // Control: the printed recursion never finds more.
        prop_assert!(printed(&tree_a, 0, &tree_b, 0) <= all.len() && before.len() <= n * m);
    }
}

#[test]
fn boxes_that_do_not_follow_are_noticed() {
    let mut draw = Draw::new(4);
    let (a, b) = (soup(&mut draw, 50), soup(&mut draw, 50));
    let (tree_a, tree_b) = (tree(&a), tree(&b));
    let by = moved(&a, Vector3::new(0.1, 0.0, 0.0));
    assert!(check_tree(&tree_a, &by).is_err());
    assert_ne!(pairs(&tree_a, &tree_b), brute_force(&by, &b));
}

#[test]
fn trees_of_triangles_that_differ_by_powers_stay_shallow() {
    let mut mesh = TriangleMesh::default();
    for k in 0..64 {
        let (size, at) = (libm::exp2(f64::from(k) * 0.5), f64::from(k) * 1e9);
        mesh.vertices
            .extend([[at, 0.0, 0.0], [at + size, 0.0, 0.0], [at, size, 0.0]].map(Point3::from));
        mesh.triangles.push([3 * k, 3 * k + 1, 3 * k + 2]);
    }
    // Splits by half of the area alone would separate the last triangle 63 times.
    let levels = tree(&mesh).levels();
    assert!(levels.len() <= 32, "{levels:?}");
    // Half of the area, where the least shares allow it: of 3 small triangles and one of three
    // times their area, the one.
    let four = TriangleMesh {
        vertices: [
            [0.0, 0.0],
            [1.0, 0.0],
            [0.0, 1.0],
            [3.0, 0.0],
            [4.0, 0.0],
            [3.0, 1.0],
        ]
        .into_iter()
        .chain([
            [6.0, 0.0],
            [7.0, 0.0],
            [6.0, 1.0],
            [9.0, 0.0],
            [12.0, 0.0],
            [9.0, 1.0],
        ])
        .map(|[x, y]| Point3::new(x, y, 0.0))
        .collect(),
        triangles: (0..4).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
    };
    let found = tree(&four);
    let (_, BoundKind::Inner([_, second])) = found.node(0) else {
        panic!("a leaf")
    };
    assert_eq!(
        found.node(second).1,
        BoundKind::Leaf(3),
        "a median of counts has two on each side"
    );
    // No triangle, one, and triangles without area.
    assert!(Hierarchy::new(&[], &[]).is_empty() && Hierarchy::new(&[], &[]).bounds().is_empty());
    assert!(
        pairs(&Hierarchy::default(), &found).is_empty()
            && pairs(&found, &Hierarchy::default()).is_empty()
    );
    let flat = TriangleMesh {
        vertices: vec![Point3::origin(); 3],
        triangles: vec![[0, 1, 2]; 9],
    };
    assert_eq!(check_tree(&tree(&flat), &flat), Ok(()));
    assert_eq!(pairs(&tree(&flat), &tree(&flat)).len(), 81);
}

/// Thin triangles over intervals of the x axis.
fn stretches(of: impl IntoIterator<Item = [f64; 2]>) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for [low, high] in of {
        let first = mesh.vertices.len() as u32;
        mesh.vertices
            .extend([[low, 0.0, 0.0], [high, 0.0, 0.0], [low, 1.0, 0.0]].map(Point3::from));
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh
}

#[test]
fn b08_a_leaf_against_a_node_is_not_dropped() {
    let one = tree(&stretches([[2.2, 2.4]]));
    let eight = tree(&stretches(
        (0..8).map(|i| [f64::from(i), f64::from(i) + 1.0]),
    ));
    let five = tree(&stretches(
        (0..5).map(|i| [f64::from(i) + 0.5, f64::from(i) + 0.9]),
    ));
    assert_eq!(
        (pairs(&one, &eight), pairs(&eight, &one)),
        (vec![[0, 2]], vec![[2, 0]])
    );
    assert_eq!(
        pairs(&five, &eight),
        (0..5).map(|i| [i, i]).collect::<Vec<_>>()
    );
    // Control, the erratum's counter-example: 0 of 1, and 2 of 5 are found.
    assert_eq!(printed(&one, 0, &eight, 0), 0);
    assert_eq!(printed(&five, 0, &eight, 0), 2);
}

fn at(points: &[Point3<f64>], weights: &[f64]) -> Point3<f64> {
    Point3::from(
        points
            .iter()
            .zip(weights)
            .map(|(p, w)| p.coords * *w)
            .sum::<Vector3<f64>>(),
    )
}

/// Both sides give one point, with weights that are shares.
fn is_one_point(edge: [Point3<f64>; 2], triangle: [Point3<f64>; 3]) -> Option<f64> {
    let found = crossing(edge, triangle)?;
    for weights in [&found.edge[..], &found.triangle[..]] {
        assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)), "{found:?}");
        assert!(
            (weights.iter().sum::<f64>() - 1.0).abs() <= 1e-14,
            "{found:?}"
        );
    }
    Some((at(&edge, &found.edge) - at(&triangle, &found.triangle)).norm())
}

fn unit() -> [Point3<f64>; 3] {
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]
    #[test]
    fn crossings_are_those_of_a_linear_solve(seed in any::<u64>(), decade in -3i32..=3) {
        let mut draw = Draw::new(seed);
        let (size, off) = (10_f64.powi(decade), draw.direction() * draw.between(0.0, 10.0));
        let shape = draw.shape(3);
        let t: [Point3<f64>; 3] = std::array::from_fn(|k| shape[k]);
        let e = [0; 2].map(|_| Point3::from(draw.direction() * draw.between(0.1, 1.5)));
        let place = |p: Point3<f64>| Point3::from((p.coords + off) * size);
        let (e, t) = (e.map(place), t.map(place));
        let n = (t[1] - t[0]).cross(&(t[2] - t[0]));
        let (d, f) = ((e[0] - t[0]).dot(&n), (e[1] - t[0]).dot(&n));
        let m = Matrix3::from_columns(&[t[1] - t[0], t[2] - t[0], n]);
        let meet = e[0] + (e[1] - e[0]) * (d / (d - f)) - t[0];
        let s = m.try_inverse().expect("a triangle") * meet;
        let inside = [s.x, s.y, 1.0 - s.x - s.y, -d * f / (d * d + f * f)];
        // Cases within rounding are left to the exact predicates.
        prop_assume!(inside.iter().all(|v| v.abs() > 1e-9));
        let found = is_one_point(e, t);
        prop_assert_eq!(found.is_some(), inside.iter().all(|v| *v > 0.0));
        // Where they are nearly parallel, rounding moves the point along the edge.
        let slope = (d - f).abs() / (n.norm() * (e[1] - e[0]).norm());
        prop_assert!(found.is_none_or(|gap| gap * slope <= 1e-12 * size), "{:?}", found);
    }
}

#[test]
fn coplanar_edges_and_touching_ones_are_not_missed() {
    let p = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
    for (name, edge, expected) in [
        ("within", [p(0.1, 0.1, 0.0), p(0.3, 0.2, 0.0)], true),
        ("through", [p(-1.0, 0.25, 0.0), p(2.0, 0.25, 0.0)], true),
        ("one end within", [p(0.2, 0.2, 0.0), p(5.0, 3.0, 0.0)], true),
        ("along a side", [p(-1.0, 0.0, 0.0), p(0.5, 0.0, 0.0)], true),
        ("at a corner", [p(-1.0, 1.0, 0.0), p(1.0, 1.0, 0.0)], true),
        ("end at a side", [p(0.5, 0.5, 0.0), p(1.0, 1.0, 0.0)], true),
        (
            "end on the face",
            [p(0.25, 0.25, 0.0), p(0.25, 0.25, 1.0)],
            true,
        ),
        (
            "through a corner",
            [p(1.0, 0.0, -1.0), p(1.0, 0.0, 1.0)],
            true,
        ),
        (
            "in its plane beside",
            [p(1.0, 1.0, 0.0), p(2.0, 0.5, 0.0)],
            false,
        ),
        (
            "in line with a side",
            [p(1.5, 0.0, 0.0), p(2.0, 0.0, 0.0)],
            false,
        ),
        ("above", [p(0.1, 0.1, 1e-300), p(0.3, 0.2, 1.0)], false),
        ("past a side", [p(0.6, 0.6, -1.0), p(0.6, 0.6, 1.0)], false),
    ] {
        for (ends, corners) in [
            ([0, 1], [0, 1, 2]),
            ([1, 0], [1, 2, 0]),
            ([0, 1], [2, 1, 0]),
        ] {
            let found = is_one_point(ends.map(|k| edge[k]), corners.map(|k| unit()[k]));
            assert_eq!(found.is_some(), expected, "{name}");
            assert!(found.is_none_or(|gap| gap <= 1e-15), "{name}: {found:?}");
        }
    }
    // The midpoint of the common part.
    let through = crossing([p(-1.0, 0.25, 0.0), p(2.0, 0.25, 0.0)], unit()).expect("a crossing");
    assert!(
        (through.edge[1] - 1.375 / 3.0).abs() <= 1e-15,
        "{through:?}"
    );
    let flat = [p(0.0, 0.0, 0.0), p(1.0, 1.0, 1.0), p(2.0, 2.0, 2.0)];
    assert_eq!(crossing([p(0.0, 1.0, 0.0), p(2.0, 1.0, 2.0)], flat), None);
    // Magnitudes at which products of three coordinates underflow or overflow.
    for size in [1e-200, 1e100] {
        let found = is_one_point(
            [p(0.2, 0.2, -size), p(0.2, 0.2, size)].map(|q| p(q.x * size, q.y * size, q.z)),
            unit().map(|q| q * size),
        );
        assert!(found.is_some_and(|gap| gap <= 1e-15 * size), "{size}");
    }
}

/// Distance of the points from heights and from volumes alone, each accurate by itself: the control
/// of the next test.
fn gap_by_volumes([p, q]: [Point3<f64>; 2], [a, b, c]: [Point3<f64>; 3]) -> f64 {
    let at = |v: Point3<f64>| robust::Coord3D {
        x: v.x,
        y: v.y,
        z: v.z,
    };
    let side = |a, b, c, d| robust::orient3d(at(a), at(b), at(c), at(d)).abs();
    let shares = |of: &[f64]| {
        of.iter()
            .map(|v| v / of.iter().sum::<f64>())
            .collect::<Vec<_>>()
    };
    let ends = shares(&[side(a, b, c, q), side(a, b, c, p)]);
    let corners = shares(&[side(p, q, b, c), side(p, q, c, a), side(p, q, a, b)]);
    (self::at(&[p, q], &ends) - self::at(&[a, b, c], &corners)).norm()
}

#[test]
fn edges_almost_in_the_plane_name_one_point_on_both_sides() {
    let mut draw = Draw::new(77);
    let (mut seen, mut worst) = (0, 0.0_f64);
    for case in 0..40_000 {
        let size = draw.decades(-3.0, 3.0);
        let turn = draw.rotation();
        let place = |x: f64, y: f64, z: f64, off: Vector3<f64>| {
            Point3::from((turn * Vector3::new(x, y, z) + off) * size)
        };
        let off = draw.direction() * draw.between(0.0, 10.0);
        // Heights over the plane down to rounding; every second edge also along a side.
        let mut height = || draw.decades(-18.0, 0.0);
        let (low, high) = (-height(), height());
        let beside = if case % 2 == 0 {
            draw.between(-0.2, 0.4)
        } else {
            draw.decades(-18.0, -10.0)
        };
        let tilt = if case % 2 == 0 {
            draw.between(-0.5, 0.5)
        } else {
            draw.decades(-18.0, -10.0)
        };
        let (from, to) = (draw.between(-2.0, 0.4), draw.between(0.3, 2.0));
        let edge = [
            place(from, beside - tilt, low, off),
            place(to, beside + tilt, high, off),
        ];
        let triangle = [
            place(0.0, 0.0, 0.0, off),
            place(1.0, 0.0, 0.0, off),
            place(0.3, 0.8, 0.0, off),
        ];
        if let Some(gap) = is_one_point(edge, triangle) {
            seen += 1;
            worst = worst.max(gap_by_volumes(edge, triangle) / size);
            // Coordinates have a magnitude of 12 at most, with a few roundings.
            assert!(
                gap <= 1e-13 * size,
                "seed {} case {case}: {:e} of {size}",
                draw.seed,
                gap
            );
        }
    }
    assert!(seen > 5000, "{seen}");
    assert!(worst > 1e-3, "control: {worst}");
}

#[test]
fn what_is_no_number_crosses_nothing() {
    let p = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
    let edge = [p(0.2, 0.2, -1.0), p(0.2, 0.2, 1.0)];
    assert!(crossing(edge, unit()).is_some());
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for k in 0..5 {
            for axis in 0..3 {
                let (mut e, mut t) = (edge, unit());
                if k < 2 {
                    e[k][axis] = wrong
                } else {
                    t[k - 2][axis] = wrong
                }
                if let Some(found) = crossing(e, t) {
                    let weights = found.edge.iter().chain(&found.triangle);
                    assert!(
                        weights.clone().all(|w| (0.0..=1.0).contains(w)),
                        "{k} {axis} {wrong}: {found:?}"
                    );
                }
                if wrong.is_nan() {
                    assert_eq!(crossing(e, t), None, "{k} {axis}");
                }
            }
        }
    }
    // An edge without length, and one between two coincident points.
    assert_eq!(crossing([p(0.2, 0.2, 1.0); 2], unit()), None);
    let on = crossing([p(0.2, 0.2, 0.0); 2], unit()).expect("it lies on it");
    assert_eq!(on.edge, [0.5; 2]);
    // Trees and voxels accept points that are not finite, and terminate.
    let mut draw = Draw::new(5);
    let (mut a, b) = (soup(&mut draw, 40), soup(&mut draw, 40));
    let (sound, before) = (tree(&a), pairs(&tree(&a), &tree(&b)));
    for k in 0..10 {
        a.vertices[7 * k] = p(f64::NAN, f64::NAN, f64::NAN);
    }
    let mut refitted = sound.clone();
    refitted.refit(&a.vertices, &a.triangles);
    let untouched = |s: u32| a.corners(s as usize).iter().all(|c| !c.x.is_nan());
    for found in [pairs(&refitted, &tree(&b)), pairs(&tree(&a), &tree(&b))] {
        let missing = before
            .iter()
            .find(|[s, t]| untouched(*s) && !found.contains(&[*s, *t]));
        assert_eq!(missing, None);
    }
    let voxels = VoxelGrid::new(&a.vertices, &a.triangles, 0.2).expect("voxels");
    // Bodies refuse such points before any search.
    let crossed = crossings_among(&pairs(&tree(&a), &tree(&b)), &a, &b);
    assert!(crossed.len() > 3);
    let listed: BTreeSet<[u32; 2]> = voxels
        .pairs(&tree(&b), &b.vertices, &b.triangles)
        .into_iter()
        .collect();
    assert!(crossed.iter().all(|f| listed.contains(&triangles_of(f))));
    a.vertices[1].x = f64::INFINITY;
    assert!(matches!(
        VoxelGrid::new(&a.vertices, &a.triangles, 0.2),
        Err(VoxelError::TooSmall { .. })
    ));
}

/// Triangles of a soup share no edge, so the triangle of an edge is known.
fn triangles_of(f: &Found) -> [u32; 2] {
    if f.which == Edge::OfFirst {
        [f.edge[0] / 3, f.triangle]
    } else {
        [f.triangle, f.edge[0] / 3]
    }
}

#[test]
fn voxels_find_the_crossings_of_hierarchies() {
    let (fine, coarse) = (
        shapes::icosphere(1.0, 4),
        moved(&shapes::icosphere(0.8, 1), Vector3::new(0.6, 0.31, 0.2)),
    );
    let (tree, voxels) = (
        tree(&coarse),
        VoxelGrid::new(&fine.vertices, &fine.triangles, 0.07).expect("voxels"),
    );
    let owners = [&fine, &coarse].map(|m| EdgeOwners::new(m.vertices.len(), &m.triangles));
    let first = Sheet {
        x: &fine.vertices,
        triangles: &fine.triangles,
        owners: &owners[0],
    };
    let second = Sheet {
        x: &coarse.vertices,
        triangles: &coarse.triangles,
        owners: &owners[1],
    };
    let key = |f: &Found| (f.which == Edge::OfFirst, f.edge, f.triangle);
    let mut all = Vec::new();
    for pair in voxels.pairs(&tree, &coarse.vertices, &coarse.triangles) {
        crossings_of(pair, first, second, |f| all.push(key(&f)));
    }
    let keys: BTreeSet<_> = all.iter().copied().collect();
    let expected: BTreeSet<_> = found(&fine, &coarse).iter().map(key).collect();
    assert!(expected.len() > 60 && keys.len() == all.len());
    assert_eq!(keys, expected);
    // Control: half of the cubes miss some pairs.
    let some = voxels
        .pairs(&tree, &coarse.vertices, &coarse.triangles)
        .into_iter()
        .step_by(2);
    let mut fewer = 0;
    some.for_each(|pair| crossings_of(pair, first, second, |_| fewer += 1));
    assert!(fewer < expected.len());
}

/// The crossings by the surfaces that bodies use.
fn found(a: &TriangleMesh, b: &TriangleMesh) -> Vec<Found> {
    crossings_among(&Surface::new(a).pairs(&Surface::new(b)), a, b)
}

fn crossings_among(pairs: &[[u32; 2]], a: &TriangleMesh, b: &TriangleMesh) -> Vec<Found> {
    let owners = [a, b].map(|m| EdgeOwners::new(m.vertices.len(), &m.triangles));
    let meshes = [a, b];
    let sheet = |k: usize| Sheet {
        x: &meshes[k].vertices,
        triangles: &meshes[k].triangles,
        owners: &owners[k],
    };
    let mut all = Vec::new();
    for &pair in pairs {
        crossings_of(pair, sheet(0), sheet(1), |f| all.push(f));
    }
    all
}

#[test]
fn b07_a_tip_that_pierces_a_large_triangle_is_found_either_way() {
    let big = TriangleMesh {
        vertices: [[-5.0, -5.0, 0.0], [5.0, -5.0, 0.0], [0.0, 5.0, 0.0]]
            .map(Point3::from)
            .to_vec(),
        triangles: vec![[0, 1, 2]],
    };
    let tip = TriangleMesh {
        vertices: [[0.0, 0.0, -0.2], [0.3, 0.0, 0.4], [-0.3, 0.0, 0.4]]
            .map(Point3::from)
            .to_vec(),
        triangles: vec![[0, 1, 2]],
    };
    for (a, b, tips) in [(&tip, &big, Edge::OfFirst), (&big, &tip, Edge::OfSecond)] {
        let all = found(a, b);
        assert_eq!(all.len(), 2);
        // Control: the edges of the big triangle alone have none.
        assert!(all.iter().all(|f| f.which == tips));
    }
}

#[test]
fn b12_each_edge_meets_each_triangle_once() {
    let (a, b) = (
        shapes::icosphere(1.0, 2),
        moved(&shapes::icosphere(0.9, 2), Vector3::new(0.7, 0.31, 0.2)),
    );
    let all = found(&a, &b);
    let key = |f: &Found| {
        (
            f.which == Edge::OfFirst,
            f.edge[0].min(f.edge[1]),
            f.edge[0].max(f.edge[1]),
            f.triangle,
        )
    };
    let keys: BTreeSet<_> = all.iter().map(key).collect();
    assert_eq!(keys.len(), all.len(), "an edge twice");
    let (mut expected, mut by_sides) = (BTreeSet::new(), 0);
    for (first, of, other) in [(true, &a, &b), (false, &b, &a)] {
        let topology = Topology::new(of);
        for (e, &[p, q]) in topology.edges.iter().enumerate() {
            for t in 0..other.triangles.len() {
                if crossing([p, q].map(|v| of.vertices[v as usize]), other.corners(t)).is_some() {
                    expected.insert((first, p, q, t as u32));
                    by_sides += topology.triangles_of_edge(e).len();
                }
            }
        }
    }
    assert!(expected.len() > 40, "{}", expected.len());
    assert_eq!(keys, expected);
    // Control: by the sides of triangles each inner edge would be tested twice.
    assert_eq!(by_sides, 2 * expected.len());
}

#[test]
fn voxels_know_what_a_surface_meets() {
    let mut draw = Draw::new(9);
    for (side, count) in [(0.05, 20), (0.31, 40), (5.0, 30)] {
        let (own, other) = (soup(&mut draw, count), soup(&mut draw, count));
        let voxels = VoxelGrid::new(&own.vertices, &own.triangles, side).expect("voxels");
        let tree = tree(&other);
        let met: BTreeSet<[u32; 2]> = voxels
            .pairs_with(&tree, &other.vertices, &other.triangles)
            .into_iter()
            .collect();
        let mut sampled = 0;
        for _ in 0..4000 {
            let mut point = |of: &TriangleMesh| {
                let t = draw.index(of.triangles.len());
                let (u, v) = (draw.between(0.0, 1.0), draw.between(0.0, 1.0));
                let (u, v) = if u + v > 1.0 {
                    (1.0 - u, 1.0 - v)
                } else {
                    (u, v)
                };
                (t as u32, at(&of.corners(t), &[1.0 - u - v, u, v]))
            };
            let holds = |p: &Point3<f64>| {
                voxels
                    .cells()
                    .iter()
                    .position(|&c| voxels.bounds(c).contains(p))
            };
            // Each point of the surface is in a cube that has its triangle.
            let (t, p) = point(&own);
            let cell = holds(&p).expect("a cube");
            assert!(voxels.triangles(cell).contains(&t), "{side}: {p} of {t}");
            let (t, p) = point(&other);
            if let Some(cell) = holds(&p) {
                sampled += 1;
                assert!(met.contains(&[cell as u32, t]), "{side}: {p} of {t}");
            }
        }
        assert!(sampled > 50, "{sampled}");
        assert!(
            met.len() < voxels.cells().len() * count || side > 1.0,
            "control: everything meets everything"
        );
        let pairs: BTreeSet<[u32; 2]> = voxels
            .pairs(&tree, &other.vertices, &other.triangles)
            .into_iter()
            .collect();
        let crossed = found(&own, &other);
        assert!(crossed.len() > 3, "{}", crossed.len());
        for f in crossed {
            assert!(pairs.contains(&triangles_of(&f)), "{side}: {f:?}");
        }
    }
}

#[test]
fn voxels_that_make_no_sense_are_refused() {
    let mesh = shapes::icosphere(1.0, 1);
    let of = |side: f64| VoxelGrid::new(&mesh.vertices, &mesh.triangles, side);
    for side in [0.0, -1.0, f64::INFINITY] {
        assert_eq!(of(side).unwrap_err(), VoxelError::Side(side));
    }
    assert!(matches!(of(f64::NAN), Err(VoxelError::Side(_))));
    for side in [1e-6, 1e-300] {
        assert_eq!(of(side).unwrap_err(), VoxelError::TooSmall { side });
    }
    assert!(
        VoxelGrid::new(&[], &[], 1.0)
            .expect("nothing")
            .cells()
            .is_empty()
    );
    assert_eq!(of(100.0).expect("one").cells().len(), 1);
}
