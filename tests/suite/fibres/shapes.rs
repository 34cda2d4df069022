//! Shapes with known fibres.

use nalgebra::{Point3, Vector3};
use pliant::fibres::length;
use pliant::fibres::quality::measure;

use crate::fibres::{assert_good, made, measured};
use crate::tolerances::{T17, worst};

#[test]
fn a_cylinder_has_straight_fibres_and_a_linear_field() {
    let (mesh, areas) = made(|p| *p);
    let (found, q) = measured(&mesh, &areas);
    println!("{q:?}");
    assert_good("cylinder", &q);
    assert!(q.coverage >= 0.95 && q.tendon_length_max_m == 0.0, "{q:?}");
    // Away from ends and wall the field is linear along the cylinder and constant across it.
    let at = |x: f64, y: f64| {
        found
            .field
            .at(&Point3::new(x, y, 0.0))
            .expect("inside")
            .value
    };
    let slope = (at(0.05, 0.0) - at(-0.05, 0.0)) / 0.1;
    let off = (-8..=8).map(|k| {
        let x = 0.01 * f64::from(k);
        (at(x, 0.004) - at(0.0, 0.0) - slope * x).abs()
    });
    assert!(worst(off) <= 0.05 * slope * 0.16, "{slope}");
    assert!(slope > 0.0);
    // Straight up to a cell, the resolution of the grid.
    let side = found.field.cells.side;
    let drift = found.fibres.iter().flat_map(|f| {
        let middle = f[7];
        f.iter()
            .skip(1)
            .take(13)
            .map(move |p| (p.yz() - middle.yz()).norm())
    });
    assert!(worst(drift) <= 1.5 * side, "side {side}");
    assert!(
        (q.length_mean_m / 0.2 - 1.0).abs() <= 0.02,
        "{}",
        q.length_mean_m
    );
    assert!(q.pennation_mean_rad <= 0.1, "{}", q.pennation_mean_rad);
}

#[test]
fn a_tapered_tube_narrows_its_fibres_alike() {
    // Radius 20 mm at the origin, 10 mm at the insertion.
    let radius = |x: f64| 0.75 - 2.5 * x;
    let (mesh, areas) = made(|p| Point3::new(p.x, p.y * radius(p.x), p.z * radius(p.x)));
    let (found, q) = measured(&mesh, &areas);
    println!("{q:?}");
    assert_good("tapered", &q);
    assert!(q.coverage >= 0.95, "{q:?}");
    // Each fibre keeps its share of the radius, so all keep their shares of the volume.
    let side = found.field.cells.side;
    let share = |p: &Point3<f64>| p.yz().coords.norm() / (0.02 * radius(p.x));
    let off = found
        .fibres
        .iter()
        .map(|f| (share(&f[2]) - share(&f[12])).abs() * 0.01);
    assert!(worst(off) <= side, "side {side}");
}

#[test]
fn a_bent_tube_has_arcs_as_long_as_their_radius() {
    // Bent to a quarter turn about an axis at a distance of 0.2 / (pi/2).
    let turn = std::f64::consts::FRAC_PI_2;
    let bend = 0.2 / turn;
    let (mesh, areas) = made(|p| {
        let (angle, r) = (p.x / bend, bend + p.y);
        Point3::new(r * angle.sin(), r * angle.cos(), p.z)
    });
    let (found, q) = measured(&mesh, &areas);
    println!("{q:?}");
    assert_good("bent", &q);
    assert!(q.coverage >= 0.95, "{q:?}");
    let side = found.field.cells.side;
    // Across the tube lengths differ by a third; a fibre can deviate by a cell.
    let off = found
        .fibres
        .iter()
        .map(|f| (length(f) - turn * f[7].xy().coords.norm()).abs());
    assert!(worst(off) <= turn * side, "side {side}");
    let lengths: Vec<f64> = found.fibres.iter().map(|f| length(f)).collect();
    let (least, most) = (
        lengths.iter().copied().fold(f64::INFINITY, f64::min),
        worst(lengths),
    );
    assert!(most / least > 1.2, "control: {least} to {most}");
}

#[test]
fn what_is_measured_sees_what_is_wrong() {
    let (mesh, areas) = made(|p| *p);
    let (found, q) = measured(&mesh, &areas);
    let again = |fibres: &[Vec<Point3<f64>>], jacobian: &[f64]| {
        measure(
            &mesh,
            &found.closed,
            &areas,
            fibres,
            jacobian.iter().copied(),
        )
    };
    // A point 5 mm outside.
    let mut moved = found.fibres.clone();
    moved[3][7] = Point3::new(0.0, 0.0, 0.025);
    let out = again(&moved, &[1.0]);
    assert_eq!(out.outside, 1);
    // The wall of the tube is a polygon of 24 sides: up to 1 - cos(pi/24) inside the circle.
    assert!(
        out.outside_max_m >= 0.005 * (1.0 - T17) && out.outside_max_m <= 0.0052,
        "{out:?}"
    );
    // An end off its area.
    let mut moved = found.fibres.clone();
    moved[5][0].x += 0.001;
    assert!((again(&moved, &[1.0]).end_distance_max_m - 0.001).abs() <= 1e-5);
    // A Jacobian that is negative, or NaN, somewhere.
    assert_eq!(again(&found.fibres, &[1.0, -0.5, 2.0]).jacobian_min, -0.5);
    assert!(again(&found.fibres, &[1.0, f64::NAN]).jacobian_min.is_nan());
    // Two fibres in one place.
    let mut twice = found.fibres.clone();
    twice[1] = twice[0].clone();
    assert_eq!(again(&twice, &[1.0]).spacing_min_m, 0.0);
    // Half of the muscle without fibres.
    let mut half: Vec<_> = found.fibres.clone();
    half.retain(|f| f[7].y > 0.0);
    let bare = again(&half, &[1.0]).coverage;
    assert!(bare < 0.8 && q.coverage > 0.95, "{bare}");
    // It is impossible to rotate all fibres by a right angle to their line of action; a zigzag is
    // detected.
    let mut zigzag = found.fibres.clone();
    zigzag.iter_mut().for_each(|f| {
        f.iter_mut()
            .skip(1)
            .step_by(2)
            .for_each(|p| *p += Vector3::z() * 0.01)
    });
    assert!(again(&zigzag, &[1.0]).pennation_mean_rad > q.pennation_mean_rad + 0.2);
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let (mesh, areas) = made(|p| Point3::new(p.x, p.y + 2.0 * p.x * p.x, p.z));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| measured(&mesh, &areas).0.fibres)
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(8));
}

#[test]
fn inside_out_and_open_is_the_same_muscle() {
    let (mesh, areas) = made(|p| *p);
    let mut broken = mesh.clone();
    broken.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    // A hole in the side; the areas are the last triangles.
    let hole: Vec<usize> = (0..4).map(|k| mesh.triangles.len() / 2 - 60 + k).collect();
    broken.triangles = (0..broken.triangles.len())
        .filter(|t| !hole.contains(t))
        .map(|t| broken.triangles[t])
        .collect();
    let again = pliant::fibres::Attachment::new(
        &broken,
        pliant::fibres::AreaSource::Vertices(&areas.origin.vertices),
        pliant::fibres::AreaSource::Vertices(&areas.insertion.vertices),
    );
    let (_, q) = measured(&broken, &again.expect("areas"));
    assert_good("broken", &q);
    assert!(q.coverage >= 0.95, "{q:?}");
}
