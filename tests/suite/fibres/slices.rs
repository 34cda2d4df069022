//! Decomposition by slices, and its limits.

use nalgebra::{Point2, Point3, Vector3};
use pliant::fibres::SlicesError;
use pliant::fibres::quality::measure;
use pliant::fibres::{AreaSource, Attachment, Template};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::box_surface;
use pliant::testing::internals::fibres::Closed;
use pliant::testing::internals::fibres::slices::{
    Outline, SliceOptions, Slicer, decompose, grid, on_square,
};

use super::{made, ring_torus, star};
use crate::tolerances::{T1, worst};

#[test]
fn a_cylinder_has_straight_parallel_fibres() {
    let (mesh, areas) = made(|p| *p);
    let found = grid(&mesh, &areas, Template::Parallel, SliceOptions::default()).expect("fibres");
    let fibres = found.fibres();
    let q = measure(
        &mesh,
        &Closed::new(&mesh),
        &areas,
        &fibres,
        found.jacobian(),
    );
    println!("{q:?}");
    assert_eq!((q.fibres, q.points, q.outside), (100, 1500, 0), "{q:?}");
    assert!(q.jacobian_min > 0.0 && q.coverage >= 0.99, "{q:?}");
    // Contours have 24 corners at rings and 48 in between, where diagonals are cut: the sagitta of
    // a 24th of the circle.
    let sagitta = 0.02 * (1.0 - (std::f64::consts::PI / 24.0).cos());
    let drift = fibres
        .iter()
        .flat_map(|f| f.iter().map(|p| (p.yz() - f[7].yz()).norm()));
    assert!(worst(drift) <= sagitta * (1.0 + 1e-6));
    // The first and the last slice are a millionth of the length from the ends.
    assert!(
        q.end_distance_max_m <= 1.001e-6 * 0.2 && (q.length_mean_m / 0.2 - 1.0).abs() <= 1e-5,
        "{q:?}"
    );
}

#[test]
fn points_of_star_shaped_muscles_are_inside() {
    for amount in [0.0, 0.5, 1.0] {
        let (mesh, areas) = star(amount);
        let found =
            grid(&mesh, &areas, Template::Parallel, SliceOptions::default()).expect("fibres");
        let q = measure(
            &mesh,
            &Closed::new(&mesh),
            &areas,
            &found.fibres(),
            found.jacobian(),
        );
        println!("{amount}: {q:?}");
        assert!(q.outside == 0 && q.coverage >= 0.95, "{amount}: {q:?}");
    }
}

#[test]
fn where_a_muscle_ends_in_a_point_all_fibres_do_and_it_is_measured() {
    // A tube that narrows to a thousandth towards its insertion, with a band before the tip as the
    // area.
    let (mesh, areas) = made(|p| {
        let width = 0.5 - 4.99 * p.x;
        Point3::new(p.x, p.y * width, p.z * width)
    });
    let found = grid(&mesh, &areas, Template::Parallel, SliceOptions::default()).expect("fibres");
    let ends = found
        .fibres()
        .iter()
        .map(|f| (f[14] - Point3::new(0.1, 0.0, 0.0)).norm())
        .fold(0.0, f64::max);
    assert!(ends <= 3e-5, "{ends}");
    let q = measure(
        &mesh,
        &Closed::new(&mesh),
        &areas,
        &found.fibres(),
        found.jacobian(),
    );
    let (wide, other) = made(|p| *p);
    let open = grid(&wide, &other, Template::Parallel, SliceOptions::default()).expect("fibres");
    let of_wide = measure(
        &wide,
        &Closed::new(&wide),
        &other,
        &open.fibres(),
        open.jacobian(),
    );
    assert!(
        q.spacing_min_m < 0.2 * of_wide.spacing_min_m,
        "{q:?} {of_wide:?}"
    );
    // The fibres do not reach an area on the side, and the distance shows it.
    let side: Vec<u32> = (0..wide.vertices.len() as u32)
        .filter(|&v| wide.vertices[v as usize].x.abs() < 0.02)
        .collect();
    let first = &other.origin.vertices;
    let areas = Attachment::new(
        &wide,
        AreaSource::Vertices(first),
        AreaSource::Vertices(&side),
    )
    .expect("areas");
    let found = grid(&wide, &areas, Template::Parallel, SliceOptions::default()).expect("fibres");
    let q = measure(
        &wide,
        &Closed::new(&wide),
        &areas,
        &found.fibres(),
        found.jacobian(),
    );
    assert!(q.end_distance_max_m > 0.05, "{q:?}");
}

#[test]
fn surfaces_that_are_none_are_cut_all_the_same() {
    let (mesh, areas) = made(|p| *p);
    let whole =
        decompose(&mesh, &areas, Template::Parallel, SliceOptions::default()).expect("fibres");
    let length = |fibres: &[Vec<Point3<f64>>]| {
        fibres
            .iter()
            .map(|f| pliant::fibres::length(f))
            .sum::<f64>()
            / fibres.len() as f64
    };
    // Open, with reversed triangles, with one triangle three times, of genus 1.
    let mut broken = mesh.clone();
    broken.triangles.remove(mesh.triangles.len() / 2);
    broken
        .triangles
        .iter_mut()
        .step_by(3)
        .for_each(|t| t.swap(0, 1));
    broken.triangles.extend([mesh.triangles[40]; 2]);
    let ends = [&areas.origin, &areas.insertion].map(|a| AreaSource::Vertices(&a.vertices));
    let again = Attachment::new(&broken, ends[0], ends[1]).expect("areas");
    let found =
        decompose(&broken, &again, Template::Parallel, SliceOptions::default()).expect("fibres");
    assert_eq!(found.len(), 100);
    assert!(
        (length(&found) / length(&whole) - 1.0).abs() <= 0.05,
        "{}",
        length(&found)
    );
    let (ring, ends) = ring_torus();
    assert_eq!(
        decompose(&ring, &ends, Template::Parallel, SliceOptions::default())
            .expect("fibres")
            .len(),
        100
    );
    // Two separate components have no slice between them.
    let mut two = mesh.clone();
    let count = two.vertices.len() as u32;
    two.vertices.extend(
        mesh.vertices
            .iter()
            .map(|v| v + Vector3::new(0.5, 0.0, 0.0)),
    );
    two.triangles
        .extend(mesh.triangles.iter().map(|t| t.map(|v| v + count)));
    let far: Vec<u32> = areas.insertion.vertices.iter().map(|v| v + count).collect();
    let across = Attachment::new(
        &two,
        AreaSource::Vertices(&areas.origin.vertices),
        AreaSource::Vertices(&far),
    );
    let error = decompose(
        &two,
        &across.expect("areas"),
        Template::Parallel,
        SliceOptions::default(),
    )
    .expect_err("refused");
    assert!(
        matches!(error, SlicesError::NoContour { share, .. } if (0.2..0.8).contains(&share)),
        "{error}"
    );
}

#[test]
fn what_has_no_axis_or_no_grid_is_refused() {
    let (mesh, areas) = made(|p| *p);
    for (count, points) in [(0, 15), (100, 1)] {
        let error = decompose(
            &mesh,
            &areas,
            Template::Parallel,
            SliceOptions { count, points },
        )
        .expect_err("refused");
        assert_eq!(error, SlicesError::TooFew { count, points });
    }
    // Both bands are around the middle of the tube: one of two halves, one between.
    let pick = |low: f64, high: f64| -> Vec<u32> {
        let at = |v: &Point3<f64>| (low..high).contains(&v.x.abs());
        (0..mesh.vertices.len() as u32)
            .filter(|&v| at(&mesh.vertices[v as usize]))
            .collect()
    };
    let (inner, outer) = (pick(0.0, 0.03), pick(0.06, 0.08));
    let both = Attachment::new(
        &mesh,
        AreaSource::Vertices(&inner),
        AreaSource::Vertices(&outer),
    )
    .expect("areas");
    let error = decompose(&mesh, &both, Template::Parallel, SliceOptions::default());
    if let Err(error) = &error {
        assert!(
            matches!(error, SlicesError::NoAxis { distance, .. } if *distance <= 1e-9),
            "{error}"
        );
    } else {
        // The diagonals of the tube are not symmetric, so the centres can be slightly apart.
        assert_eq!(error.expect("fibres").len(), 100);
    }
}

#[test]
fn contours_of_a_box_are_rectangles() {
    let mesh: TriangleMesh = box_surface([2.0, 1.0, 0.5], 0.25);
    let axes = [Vector3::y(), Vector3::z(), Vector3::x()];
    let slicer = Slicer::new(&mesh, &axes);
    for height in [-0.93, 0.0, 0.25, 0.71] {
        let contour = slicer.cut(height).expect("a contour");
        let area: f64 = (0..contour.len())
            .map(|k| {
                contour[k]
                    .coords
                    .perp(&contour[(k + 1) % contour.len()].coords)
            })
            .sum::<f64>()
            / 2.0;
        assert!((area - 0.5).abs() <= T1, "{height}: {area}");
    }
    assert!(slicer.cut(1.01).is_none() && slicer.cut(-1.01).is_none());
}

#[test]
fn coordinates_reproduce_lines_and_the_sides() {
    // A square contour that is the square itself, with irregular points on its sides: the map is
    // the identity.
    let corners = [
        (0.0, 0.0),
        (0.3, 0.0),
        (1.0, 0.0),
        (1.0, 0.2),
        (1.0, 0.9),
        (1.0, 1.0),
        (0.4, 1.0),
        (0.0, 1.0),
        (0.0, 0.5),
    ];
    let square: Vec<Point2<f64>> = corners.iter().map(|&(x, y)| Point2::new(x, y)).collect();
    let outline = Outline::new(&square);
    let mut off = Vec::new();
    for (x, y) in
        (0..=10).flat_map(|i| (0..=10).map(move |j| (0.1 * f64::from(i), 0.1 * f64::from(j))))
    {
        off.push((outline.of(&Point2::new(x, y)) - Point2::new(x, y)).norm());
    }
    assert!(worst(off) <= T1);
    // Affine maps are reproduced.
    let map = |p: &Point2<f64>| Point2::new(3.0 + 2.0 * p.x + 0.5 * p.y, 1.0 + p.y);
    let sheared: Vec<Point2<f64>> = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
        .iter()
        .map(|&(x, y)| Point2::new(4.0 * x, 2.0 * y))
        .collect();
    let outline = Outline::new(&sheared);
    // By arc length a rectangle's corners do not map to those of the square: only the perimeter is
    // preserved.
    let quarter = outline.of(&Point2::new(1.0, 0.0));
    assert!((quarter - Point2::new(3.0, 0.0)).norm() <= T1, "{quarter}");
    let bent: Vec<Point2<f64>> = square.iter().map(map).collect();
    assert!(
        Outline::new(&bent)
            .of(&Point2::new(0.5, 0.5))
            .coords
            .iter()
            .all(|v| v.is_finite())
    );
    for (share, place) in [
        (0.0, (0.0, 0.0)),
        (0.125, (0.5, 0.0)),
        (0.5, (1.0, 1.0)),
        (0.875, (0.0, 0.5)),
        (1.0, (0.0, 0.0)),
    ] {
        assert!(
            (on_square(share) - Point2::new(place.0, place.1)).norm() <= T1,
            "{share}"
        );
    }
}

#[test]
fn turned_and_moved_muscles_have_turned_and_moved_fibres() {
    let (mesh, areas) = star(0.7);
    let turn = nalgebra::Isometry3::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.4, 0.9, -0.7));
    let mut moved = mesh.clone();
    moved.vertices.iter_mut().for_each(|p| *p = turn * *p);
    let [one, other] = [&mesh, &moved]
        .map(|m| decompose(m, &areas, Template::Pennate, SliceOptions::default()).expect("fibres"));
    let off = one
        .iter()
        .flatten()
        .zip(other.iter().flatten())
        .map(|(a, b)| (turn * a - b).norm());
    // 2.3 m from the origin, with principal axes of nearly equal variance.
    assert!(worst(off) <= 1e-8);
}
