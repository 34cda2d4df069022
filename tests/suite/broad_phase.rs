//! All methods of contact search find the same; the bit grid keeps its bounds.

use nalgebra::{Point3, Vector3};
use pliant::contact::{Obstacle, Surface};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::{box_surface, icosphere, tube};
use pliant::testing::Draw;
use pliant::testing::internals::contact::broad_phase::{
    BitGrid, BruteForce, Fill, METHODS, NearestTriangle, Searched,
};

use crate::tolerances::{T1, cases};

/// Number of kinds of random meshes.
const KINDS: usize = 6;

/// A bumpy sphere, a long box of large triangles, a tube with flat ends, an open patch, separate
/// triangles, a single one; rotated, scaled and translated.
fn drawn(draw: &mut Draw, kind: usize) -> TriangleMesh {
    let mut mesh = match kind {
        0 => icosphere(1.0, 2),
        1 => box_surface([0.05, 1.0, 2.0], 1.0),
        2 => tube(0.25, 2.0, 12),
        3 => icosphere(1.0, 2),
        4 => TriangleMesh {
            vertices: draw.shape(6),
            triangles: Vec::new(),
        },
        _ => TriangleMesh {
            vertices: draw.shape(3),
            triangles: vec![[0, 1, 2]],
        },
    };
    match kind {
        0 => mesh
            .vertices
            .iter_mut()
            .for_each(|v| v.coords *= draw.between(0.7, 1.0)),
        3 => mesh.triangles.truncate(180),
        4 => {
            let corner = |draw: &mut Draw| draw.index(6) as u32;
            while mesh.triangles.len() < 12 {
                let t = [corner(draw), corner(draw), corner(draw)];
                if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] {
                    mesh.triangles.push(t);
                }
            }
        }
        _ => {}
    }
    let (turn, scale) = (draw.rotation(), draw.decades(-3.0, 3.0));
    let to = draw.direction() * draw.between(0.0, 10.0);
    mesh.vertices
        .iter_mut()
        .for_each(|v| *v = Point3::from((turn * v.coords + to) * scale));
    mesh
}

/// A point near a vertex, anywhere around, or far away.
fn point_near(draw: &mut Draw, mesh: &TriangleMesh) -> Point3<f64> {
    let bounds = mesh.bounding_box();
    let size = bounds.extents().norm();
    let vertex = mesh.vertices[draw.index(mesh.vertices.len())];
    match draw.index(4) {
        0 => vertex,
        1 => vertex + draw.direction() * (size * draw.decades(-6.0, -1.0)),
        2 => bounds.center() + draw.direction() * (size * draw.between(0.0, 0.6)),
        _ => bounds.center() + draw.direction() * (size * draw.decades(0.0, 2.0)),
    }
}

/// Greatest error of distances, signs included, relative to the coordinates: of a method compared
/// with the default one.
fn error(mesh: &TriangleMesh, found: &dyn Obstacle, draw: &mut Draw, points: usize) -> f64 {
    let known = Surface::new(mesh);
    let mut worst = 0.0_f64;
    // Also the centre of each triangle: none may be missed.
    let middle = |t: usize| {
        Point3::from(
            mesh.corners(t)
                .iter()
                .map(|c| c.coords)
                .sum::<Vector3<f64>>()
                / 3.0,
        )
    };
    let middles: Vec<Point3<f64>> = (0..mesh.triangles.len()).map(middle).collect();
    for k in 0..points + middles.len() {
        let p = if k < points {
            point_near(draw, mesh)
        } else {
            middles[k - points]
        };
        let scale = mesh.vertices[0].coords.norm() + p.coords.norm();
        let (a, b) = (
            found.closest(&p).expect("triangles"),
            known.closest(&p).expect("triangles"),
        );
        // The distance to the returned point matches, and any hint gives the same point.
        let there = (a.point - p).norm() - a.distance.abs();
        let again = found
            .closest_from(&p, &mesh.vertices[draw.index(mesh.vertices.len())])
            .expect("triangles");
        for error in [a.distance - b.distance, there, again.distance - a.distance] {
            // On the surface both signs are valid.
            worst = worst.max(error.abs() / scale);
        }
        assert!((a.normal.norm() - 1.0).abs() <= T1, "{:?}", a.normal);
    }
    worst
}

#[test]
fn every_way_finds_what_the_hierarchy_finds() {
    let sorted: Vec<(
        String,
        usize,
        &pliant::testing::internals::contact::broad_phase::BroadPhase,
    )> = METHODS
        .iter()
        .flat_map(|k| {
            k.sizes
                .iter()
                .map(move |&s| (format!("{} {s}", k.name), s, k))
        })
        .collect();
    assert!(sorted.len() >= 8);
    let mut draw = Draw::new(91);
    for case in 0..cases(12) {
        let mesh = drawn(&mut draw, case % KINDS);
        for (name, size, kind) in sorted.iter().filter(|(_, size, _)| *size <= 32) {
            let found = Searched::new(&mesh, (kind.sort)(&mesh, *size));
            let error = error(&mesh, &found, &mut draw, 40);
            assert!(
                error <= T1,
                "seed {}, case {case}, {name}: {error:e}",
                draw.seed
            );
        }
    }
}

#[test]
fn sizes_that_nobody_would_choose_are_exact_as_well() {
    let mut draw = Draw::new(92);
    for case in 0..KINDS {
        let mesh = drawn(&mut draw, case);
        for (kind, size) in METHODS.iter().flat_map(|k| [0, 1, 2, 3, 5].map(|s| (k, s))) {
            let found = Searched::new(&mesh, (kind.sort)(&mesh, size));
            let error = error(&mesh, &found, &mut draw, 30);
            assert!(error <= T1, "case {case}, {} {size}: {error:e}", kind.name);
        }
    }
    let empty = TriangleMesh::default();
    for (kind, size) in METHODS
        .iter()
        .flat_map(|k| k.sizes.iter().map(move |&s| (k, s)))
    {
        assert!(
            Searched::new(&empty, (kind.sort)(&empty, size))
                .closest(&Point3::origin())
                .is_none()
        );
    }
    assert!(
        BitGrid::new(&empty, 4, Fill::Touch)
            .closest(&Point3::origin())
            .is_none()
    );
}

/// Omits one triangle.
struct Forgetful(u32);

impl NearestTriangle for Forgetful {
    fn nearest(&self, mesh: &TriangleMesh, point: &Point3<f64>, reach: f64) -> Option<u32> {
        let mut less = mesh.clone();
        less.triangles.remove(self.0 as usize);
        BruteForce
            .nearest(&less, point, reach)
            .map(|t| if t >= self.0 { t + 1 } else { t })
    }
    fn bytes(&self) -> usize {
        0
    }
}

/// Returns the triangle with the nearest corner.
struct NearestCorner;

impl NearestTriangle for NearestCorner {
    fn nearest(&self, mesh: &TriangleMesh, point: &Point3<f64>, reach: f64) -> Option<u32> {
        let of = |t: usize| {
            mesh.corners(t)
                .iter()
                .map(|c| (c - point).norm())
                .fold(f64::MAX, f64::min)
        };
        let all = (0..mesh.triangles.len()).filter(|t| of(*t) <= reach.max(of(0)));
        all.min_by(|a, b| of(*a).total_cmp(&of(*b)))
            .map(|t| t as u32)
    }
    fn bytes(&self) -> usize {
        0
    }
}

#[test]
fn a_way_that_leaves_out_a_triangle_is_rejected() {
    let mut draw = Draw::new(93);
    for (kind, points) in [(0, 100), (1, 100), (2, 100)] {
        let mesh = drawn(&mut draw, kind);
        let wrong: [Box<dyn NearestTriangle>; 2] =
            [Box::new(Forgetful(7)), Box::new(NearestCorner)];
        for way in wrong {
            let error = error(&mesh, &Searched::new(&mesh, way), &mut draw, points);
            assert!(!(error <= T1), "control: kind {kind} passes with {error:e}");
        }
        assert!(
            error(
                &mesh,
                &Searched::new(&mesh, Box::new(BruteForce)),
                &mut draw,
                50
            ) <= T1
        );
    }
}

/// Greatest departures from the bounds of [`BitGrid`], in diagonals: too far in, too far out, above
/// the distance.
fn departures(mesh: &TriangleMesh, k: usize, fill: Fill, draw: &mut Draw) -> [f64; 3] {
    let grid = BitGrid::new(mesh, k, fill);
    let known = Surface::new(mesh);
    let mut worst = [f64::MIN; 3];
    for _ in 0..400 {
        let p = point_near(draw, mesh);
        let d = known.closest(&p).expect("triangles").distance;
        let found = grid.closest(&p).expect("bone");
        let e = found.distance;
        assert_eq!(e < 0.0 || (e == 0.0 && grid.holds(&p)), grid.holds(&p));
        assert!((found.normal.norm() - 1.0).abs() <= T1);
        assert!(
            !grid.holds(&(found.point + found.normal * (1e-6 * grid.diagonal()))),
            "{found:?} does not lead out"
        );
        if e > 0.0 {
            let diagonal = grid.diagonal();
            let all = [
                -d / diagonal - 1.0,
                (d - e) / diagonal - 1.0,
                (e - d) / diagonal,
            ];
            (0..3).for_each(|i| worst[i] = worst[i].max(all[i]));
        }
    }
    worst
}

#[test]
fn the_grid_of_bits_keeps_its_bounds() {
    let mut draw = Draw::new(94);
    let (mut above, mut nearer) = (f64::MIN, f64::MIN);
    for case in 0..cases(9) {
        let mesh = drawn(&mut draw, case % 3);
        // Rounding of coordinates up to a thousand boxes away.
        let doubt = 1e-9;
        let touch = departures(&mesh, 16, Fill::Touch, &mut draw);
        assert!(touch.iter().all(|d| *d <= doubt), "case {case}: {touch:?}");
        let centre = departures(&mesh, 16, Fill::Centre, &mut draw);
        assert!(
            centre[..2].iter().all(|d| *d <= doubt),
            "case {case}: {centre:?}"
        );
        above = above.max(centre[2]);
        nearer = nearer.max(touch[1]);
    }
    assert!(
        above > 0.01,
        "control: by their middles boxes do not lose bone: {above}"
    );
    assert!(
        nearer > -0.9,
        "control: the bound is much too wide: {nearer}"
    );
}

#[test]
fn walks_end_free_and_on_the_way() {
    let mesh = icosphere(1.0, 2);
    let grid = BitGrid::new(&mesh, 24, Fill::Touch);
    let mut draw = Draw::new(95);
    let mut seen = [0; 3];
    for _ in 0..2000 {
        let [x, p] = [0, 1].map(|_| Point3::from(draw.direction() * draw.between(0.0, 2.0)));
        let on_the_way = |end: &Point3<f64>| {
            let along: Vector3<f64> = p - x;
            let off = (end - x) - along * ((end - x).dot(&along) / along.norm_squared());
            off.norm() <= 1e-12
        };
        match (grid.walk(&x, &p), grid.walk_back(&x, &p)) {
            (Some(end), Some(back)) => {
                assert!(
                    !grid.holds(&end)
                        && !grid.holds(&back)
                        && on_the_way(&end)
                        && on_the_way(&back)
                );
                // No box before the end is bone.
                let free = (0..200).all(|i| !grid.holds(&(x + (end - x) * (f64::from(i) / 200.0))));
                assert!(free, "seed {}: {x} to {p} ends at {end}", draw.seed);
                seen[usize::from(end != p)] += 1;
            }
            (None, _) => {
                assert!(grid.holds(&x), "only a begin in bone has no walk");
                seen[2] += 1;
            }
            (Some(_), None) => panic!("a free begin is a free box on the way back"),
        }
    }
    assert!(seen.iter().all(|s| *s > 100), "{seen:?}");
}
