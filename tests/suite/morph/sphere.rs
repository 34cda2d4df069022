//! Maps to the sphere: no reversed triangle for any topological sphere, typed errors for other
//! surfaces, the errata.

use std::path::{Path, PathBuf};

use nalgebra::{Point3, Vector3};
use pliant::mesh::{Inside, TriangleMesh, measures, shapes};
use pliant::morph::{Distortion, SphereError};
use pliant::morph::{Relaxation, flipped};
use pliant::testing::Draw;
use pliant::testing::internals::morph::SphereMap;
use pliant::testing::internals::morph::sphere::{bounding_sphere, check, inside_near, solid_angle};

use super::{bent, stretched, tube};
use crate::tolerances::{T1, T9, T18, cases};

/// Properties of every map.
fn assert_covers_once(name: &str, map: &SphereMap) {
    assert_eq!(flipped(map.points(), map.triangles()), [0u32; 0], "{name}");
    let faces = map.triangles().len() as f64;
    let angle = solid_angle(map.points(), map.triangles());
    assert!(
        (angle - 4.0 * std::f64::consts::PI).abs() <= T18 * faces,
        "{name}: {angle}"
    );
    assert!(
        map.points()
            .iter()
            .all(|p| (p.coords.norm() - 1.0).abs() <= T1),
        "{name}"
    );
}

fn mapped(name: &str, mesh: &TriangleMesh) -> SphereMap {
    let map = SphereMap::robust(mesh).unwrap_or_else(|e| panic!("{name}: {e}"));
    assert_covers_once(name, &map);
    assert_eq!(map.triangles(), mesh.triangles, "{name}");
    map
}

/// Median over the triangles of the ratio of their relative areas on the sphere and on the surface.
fn median_share(map: &SphereMap, mesh: &TriangleMesh) -> f64 {
    let on_sphere = measures::triangle_areas(map.points(), map.triangles());
    let on_surface = measures::triangle_areas(&mesh.vertices, &mesh.triangles);
    let whole = on_sphere.iter().sum::<f64>() / on_surface.iter().sum::<f64>();
    measures::median(
        on_sphere
            .iter()
            .zip(&on_surface)
            .map(|(s, m)| s / m / whole)
            .collect(),
    )
    .expect("triangles")
}

#[test]
fn shapes_made_by_code_are_mapped() {
    for name in [
        "tetrahedron",
        "icosphere",
        "tube",
        "box",
        "press-plate",
        "hip-femur",
        "soft-ball",
        "skull",
    ] {
        mapped(name, &shapes::make(name).expect("a shape").mesh);
    }
    // The case in which relaxation fails: length over radius 70, evenly triangulated.
    let long = tube(16, 200, 70.0);
    assert_eq!(
        (long.vertices.len(), long.triangles.len()),
        (3202, 6400),
        "as in the digest"
    );
    let map = mapped("a tube of 70 radii", &long);
    assert!(
        median_share(&map, &long) > 0.05,
        "its middle has room: {}",
        median_share(&map, &long)
    );
    mapped("a ball stretched by 100", &stretched(3, 100.0));
}

/// A regular mesh has no shortest edge. If the order of vertices decides, a tube is removed from
/// one end, and its vertices find no room when they return. 24 times 120 vertices on 20 radii was
/// the first failure.
#[test]
fn regular_tubes_of_any_length_have_room() {
    for length in [5.0, 20.0, 70.0] {
        for (segments, rings) in [
            (12, 30),
            (12, 120),
            (16, 60),
            (24, 30),
            (24, 120),
            (48, 30),
            (48, 120),
        ] {
            let mesh = tube(segments, rings, length);
            let name = format!("a tube of {segments} times {rings} vertices and {length} radii");
            let map = mapped(&name, &mesh);
            let d = Distortion::of(&mesh.vertices, map.points(), &mesh.triangles);
            println!(
                "{name}: area {:.2} and {:.0}, shape {:.2}",
                d.area_median, d.area_max, d.conformal_median
            );
            // It was up to 3e7 in the median.
            assert!(d.area_median < 6.0, "{name}: {}", d.area_median);
        }
    }
}

/// Random tubes, bent, rotated and renumbered: vertices around, rings, length and bend are random,
/// and a third of them have positions perturbed along the surface.
#[test]
fn tubes_that_are_drawn_have_room() {
    for seed in 0..cases(30) as u64 {
        let mut draw = Draw::new(seed);
        let segments = 8 + draw.index(41) as u32;
        let rings = 2 + draw.index((10 * segments).min(120) as usize) as u32;
        let length = draw.decades(0.0, 2.0);
        let mut mesh = tube(segments, rings, length);
        let (bend, thrown) = (
            draw.between(0.01, 4.0),
            if draw.index(3) == 0 { 0.2 } else { 0.0 },
        );
        // Less than half a spacing, and a bend that leaves room for the radius.
        let step = thrown * (length / f64::from(rings)).min(6.0 / f64::from(segments));
        let radius = (length / bend).max(2.0);
        for v in &mut mesh.vertices {
            v.x += step * draw.between(-1.0, 1.0);
            let (turn, r) = (v.x / radius, radius + v.y);
            *v = Point3::new(r * turn.sin(), r * turn.cos() - radius, v.z);
        }
        let turn = draw.rotation();
        let count = mesh.vertices.len();
        let mut order: Vec<u32> = (0..count as u32).collect();
        (1..count).for_each(|i| order.swap(i, draw.index(i + 1)));
        let mut renumbered = mesh.clone();
        for (&to, p) in order.iter().zip(&mesh.vertices) {
            renumbered.vertices[to as usize] = turn * p;
        }
        renumbered
            .triangles
            .iter_mut()
            .for_each(|t| *t = t.map(|v| order[v as usize]));
        mapped(
            &format!("seed {seed}: {segments} times {rings} vertices, {length} radii"),
            &renumbered,
        );
    }
}

#[test]
fn a_map_is_the_same_each_time() {
    let mesh = bent(2, 10.0, 2.0);
    assert_eq!(mapped("bent", &mesh), mapped("bent", &mesh));
}

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    let mut entries: Vec<_> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            files(&path, found)
        } else {
            found.push(path)
        }
    }
}

#[test]
fn every_closed_surface_of_the_data_is_mapped() {
    let data = std::env::var("PLIANT_DATA").unwrap_or_else(|_| "../shared/data".into());
    let mut all = Vec::new();
    files(Path::new(&data), &mut all);
    if all.is_empty() {
        println!("skipped: no {data}");
        return;
    }
    let (mut done, mut refused) = (0, 0);
    for path in all {
        // One mesh in several encodings counts once.
        let name = path
            .strip_prefix(&data)
            .unwrap_or(&path)
            .display()
            .to_string();
        let Ok(file) = pliant::io::read(&path) else {
            continue;
        };
        if name.contains("gmed_") || file.mesh.triangles.is_empty() {
            continue;
        }
        match check(&file.mesh) {
            Ok(_) => {
                let map = mapped(&name, &file.mesh);
                let share = median_share(&map, &file.mesh);
                println!(
                    "{name}: {} vertices, median share of area {share:.2}",
                    file.mesh.vertices.len()
                );
                done += 1;
            }
            Err(error) => {
                assert_eq!(SphereMap::robust(&file.mesh), Err(error), "{name}");
                refused += 1;
            }
        }
    }
    println!("{done} mapped, {refused} refused as they are no spheres");
    assert!(done >= 40 && refused >= 10, "{done} {refused}");
}

#[test]
fn a_triangle_that_is_turned_in_is_found() {
    let ball = shapes::icosphere(1.0, 2);
    assert!(SphereMap::new(ball.vertices.clone(), ball.triangles.clone()).is_ok());
    // One vertex beyond an edge of its ring: at least one triangle is reversed.
    let mut folded = ball.clone();
    folded.vertices[20] = Point3::from(-folded.vertices[20].coords);
    assert!(!flipped(&folded.vertices, &folded.triangles).is_empty());
    let error = SphereMap::new(folded.vertices, folded.triangles).expect_err("a fold");
    assert!(matches!(error, SphereError::NotPositive { .. }), "{error}");
    // Two coincident neighbours: zero area is not positive either.
    let mut flat = ball.clone();
    let [a, b, _] = flat.triangles[0];
    flat.vertices[a as usize] = flat.vertices[b as usize];
    assert!(flipped(&flat.vertices, &flat.triangles).contains(&0));
    // Smaller than the rounding of a determinant of doubles.
    let [a, b] = [Vector3::new(1.0, 0.0, 0.0), Vector3::new(0.6, 0.8, 0.0)].map(Point3::from);
    let thin = |z: f64| [a, b, Point3::new(0.8, 0.6, z)];
    assert!(
        flipped(&thin(1e-300), &[[0, 1, 2]]).is_empty()
            && !flipped(&thin(-1e-300), &[[0, 1, 2]]).is_empty()
    );
    let mut long = ball.clone();
    long.vertices[5] *= 1.0 + 1e-9;
    let error = SphereMap::new(long.vertices, long.triangles).expect_err("off the sphere");
    assert!(
        matches!(error, SphereError::Radius { vertex: 5, .. }),
        "{error}"
    );
}

#[test]
fn a_map_that_goes_round_twice_is_found() {
    // Rings of eight points that go around twice: every triangle is still oriented outward.
    let mut points = vec![Point3::new(0.0, 0.0, -1.0), Point3::new(0.0, 0.0, 1.0)];
    for z in [-0.6f64, 0.6] {
        for j in 0..8 {
            let (angle, r) = (
                std::f64::consts::FRAC_PI_2 * f64::from(j),
                (1.0 - z * z).sqrt(),
            );
            points.push(Point3::from(
                Vector3::new(r * angle.cos(), r * angle.sin(), z).normalize(),
            ));
        }
    }
    let at = |ring: u32, j: u32| 2 + 8 * ring + j % 8;
    let around = |j: u32| {
        let [a, b, c, d] = [at(0, j), at(0, j + 1), at(1, j), at(1, j + 1)];
        [[0, b, a], [a, b, d], [a, d, c], [1, c, d]]
    };
    let triangles: Vec<[u32; 3]> = (0..8).flat_map(around).collect();
    assert!(flipped(&points, &triangles).is_empty());
    let error = SphereMap::new(points, triangles).expect_err("twice");
    assert!(
        matches!(error, SphereError::Covers { times } if (times - 2.0).abs() <= T9),
        "{error}"
    );
}

#[test]
fn what_is_no_sphere_is_refused_with_its_place() {
    let refused = |mesh: &TriangleMesh| SphereMap::robust(mesh).expect_err("no sphere");
    let ball = shapes::icosphere(1.0, 1);
    let with = |change: &dyn Fn(&mut TriangleMesh)| {
        let mut mesh = ball.clone();
        change(&mut mesh);
        refused(&mesh)
    };
    assert_eq!(
        refused(&TriangleMesh::default()),
        SphereError::TooFew {
            vertices: 0,
            triangles: 0
        }
    );
    let [a, b, _] = ball.triangles[79];
    let open = with(&|m| m.triangles.truncate(79));
    assert!(
        matches!(open, SphereError::Open { edges: 3, first } if first.contains(&a) || first.contains(&b)),
        "{open}"
    );
    let turned = with(&|m| m.triangles[7].swap(0, 1));
    assert!(
        matches!(turned, SphereError::Turned { triangles, .. } if triangles.contains(&7)),
        "{turned}"
    );
    let fin = with(&|m| {
        m.vertices.push(Point3::new(3.0, 0.0, 0.0));
        m.triangles.push([a, b, 42]);
    });
    assert_eq!(
        fin,
        SphereError::Edge {
            edge: [a.min(b), a.max(b)],
            triangles: 3
        }
    );
    assert_eq!(
        with(&|m| m.vertices.push(Point3::origin())),
        SphereError::Unused {
            vertex: 42,
            count: 1
        }
    );
    let two = with(&|m| {
        m.vertices.extend(ball.vertices.clone());
        m.triangles
            .extend(ball.triangles.iter().map(|t| t.map(|v| v + 42)));
    });
    assert_eq!(
        two,
        SphereError::Pieces {
            pieces: 2,
            vertex: 42
        }
    );
    let touching = with(&|m| {
        m.vertices.extend(ball.vertices[1..].iter().copied());
        m.triangles.extend(
            ball.triangles
                .iter()
                .map(|t| t.map(|v| if v == 0 { 0 } else { v + 41 })),
        );
    });
    assert_eq!(touching, SphereError::Vertex { vertex: 0 });
    let none = with(&|m| m.triangles[3][1] = 99);
    assert!(
        none.to_string().contains("triangle 3 names vertex 99"),
        "{none}"
    );
    let torus = refused(&torus(6, 5));
    assert_eq!(torus, SphereError::Genus { genus: 1, euler: 0 });
    assert!(
        torus.to_string().contains("1 handle (V - E + F = 0)"),
        "{torus}"
    );
}

fn torus(m: u32, n: u32) -> TriangleMesh {
    let at = |i: u32, j: u32| (i % m) * n + j % n;
    let pair = |i: u32, j: u32| {
        [
            [at(i, j), at(i + 1, j), at(i + 1, j + 1)],
            [at(i, j), at(i + 1, j + 1), at(i, j + 1)],
        ]
    };
    let triangles = (0..m * n).flat_map(|k| pair(k / n, k % n)).collect();
    let vertices = (0..m * n)
        .map(|k| Point3::new(f64::from(k / n), f64::from(k % n), 0.0))
        .collect();
    TriangleMesh {
        vertices,
        triangles,
    }
}

#[test]
fn relaxation_does_as_the_digest_says() {
    // 642 vertices, stretched 3:1 and 10:1 and bent, threshold 1e-3: no reversed triangle.
    for (name, mesh) in [
        ("3:1", stretched(3, 3.0)),
        ("10:1", stretched(3, 10.0)),
        ("bent", bent(3, 10.0, 2.0)),
    ] {
        let (map, effort) = Relaxation::default()
            .map(&mesh)
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_covers_once(name, &map);
        println!("{name}: {effort:?}");
        assert!(
            (50..400).contains(&effort.first) && (20..200).contains(&effort.second),
            "{name}: {effort:?}"
        );
    }
    // An even tube collapses into two clusters: the middle half of its rings takes nearly all of
    // the sphere (M21).
    let ten = tube(16, 30, 10.0);
    assert_eq!(ten.vertices.len(), 482);
    let fine = Relaxation {
        threshold: 1e-6,
        ..Relaxation::default()
    };
    let (map, effort) = fine.map(&ten).expect("a map");
    println!("tube of 10 radii: {effort:?}");
    let middle = |map: &SphereMap| {
        let of = |t: &&[u32; 3]| {
            t.iter()
                .all(|&v| v < 480 && (ten.vertices[v as usize].x).abs() <= 2.5 + 1e-9)
        };
        let chosen: Vec<[u32; 3]> = map.triangles().iter().filter(of).copied().collect();
        solid_angle(map.points(), &chosen) / (4.0 * std::f64::consts::PI)
    };
    assert!(middle(&map) > 0.95, "{}", middle(&map));
    let even = middle(&mapped("even", &ten));
    assert!(
        even < 0.8,
        "the robust map leaves room for the ends: {even}"
    );
}

#[test]
fn relaxation_of_a_long_tube_says_that_it_failed() {
    let long = Relaxation {
        threshold: 1e-6,
        sweeps: 500,
        attempts: 1,
        ..Relaxation::default()
    };
    let error = long.map(&tube(16, 200, 70.0)).expect_err("too long");
    assert!(
        matches!(error, SphereError::Flipped { flipped, triangles: 6400, .. } if flipped > 100),
        "{error}"
    );
    assert!(error.to_string().contains("use the robust map"), "{error}");
}

/// M5: with the centre outside, the map never becomes valid, and the printed test of collapse does
/// not detect it.
#[test]
fn m05_collapse_is_found_by_a_limit_that_can_be_exceeded() {
    let body = bent(3, 10.0, 2.0);
    let centre = bounding_sphere(&body.vertices).0;
    assert_eq!(
        Inside::new(&body.vertices, &body.triangles).winding(&centre),
        0,
        "the centre is outside"
    );
    let outside = Relaxation {
        centre: Some(centre),
        sweeps: 2000,
        attempts: 3,
        ..Relaxation::default()
    };
    let printed = Relaxation {
        gap: (8.0f64 / 3.0).sqrt(),
        ..outside
    };
    let error = printed.map(&body).expect_err("never valid");
    assert!(
        matches!(error, SphereError::Flipped { flipped, .. } if flipped > 100),
        "passed the printed test: {error}"
    );
    let error = outside.map(&body).expect_err("never valid");
    assert!(
        matches!(error, SphereError::Collapsed { attempts: 3, gap, .. } if gap > 0.5),
        "{error}"
    );
}

/// M6, M7: the crossings of a ray that count.
#[test]
fn m06_m07_inside_is_told_for_faces_of_any_side_and_only_ahead() {
    let mut cube = shapes::box_surface([1.0; 3], 1.0);
    cube.vertices
        .iter_mut()
        .for_each(|v| *v += Vector3::repeat(1.5));
    let inside = Inside::new(&cube.vertices, &cube.triangles);
    assert_eq!(
        inside.winding(&Point3::new(0.0, 1.4, 1.55)),
        0,
        "in at one side, out at the other"
    );
    assert_eq!(inside.winding(&Point3::new(1.2, 1.4, 1.55)), 1);
    let behind = [[3.0, -1.0, -1.0], [-5.0, 1.5, -1.0], [-5.0, -1.0, 1.5]].map(Point3::from);
    let one = |x: f64| Inside::new(&behind, &[[0, 1, 2]]).winding(&Point3::new(x, 0.0, 0.0));
    assert_eq!(one(0.0), 0, "the hit at x = -3.4 is behind");
    assert_ne!(one(-4.0), 0);
}

/// M8: a point just behind the nearest vertex can still be outside.
#[test]
fn m08_the_centre_is_half_the_thickness_behind_the_nearest_place() {
    let mut block = shapes::box_surface([1.0, 2.0, 2.0], 0.5);
    block.vertices.iter_mut().for_each(|v| v.x += 1.5);
    let inside = Inside::new(&block.vertices, &block.triangles);
    let corner = Vector3::new(1.0, -1.0, -1.0);
    assert_eq!(
        inside.winding(&Point3::from(corner + 0.01 * corner.normalize())),
        0,
        "the printed rule"
    );
    let found = inside_near(&block, &Point3::origin()).expect("a centre");
    assert!(
        (found - Point3::new(1.5, 0.0, 0.0)).norm() <= T18,
        "{found}"
    );
    let mut out = block.clone();
    out.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let error = inside_near(&out, &Point3::origin()).expect_err("inside out");
    assert!(matches!(error, SphereError::Centre { .. }), "{error}");
}

#[test]
fn the_bounding_sphere_holds_all_and_is_little_larger_than_needed() {
    let (centre, radius) = bounding_sphere(&shapes::box_surface([2.0; 3], 2.0).vertices);
    let over = radius / 3f64.sqrt() - 1.0;
    assert!(
        centre.coords.norm() < 0.5 && (0.0..0.14).contains(&over),
        "13.5 % in the digest: {over}"
    );
    let mut draw = Draw::new(3);
    for _ in 0..100 {
        let cloud: Vec<Point3<f64>> = (0..200)
            .map(|_| Point3::from(draw.direction() * draw.between(0.0, 2.0)))
            .collect();
        let (centre, radius) = bounding_sphere(&cloud);
        assert!(cloud.iter().all(|p| (p - centre).norm() <= radius) && radius < 2.3);
    }
    assert_eq!(bounding_sphere(&[]), (Point3::origin(), 0.0));
}
