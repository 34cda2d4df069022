//! Skin over implants: the second source's sheets and flat implants, its region exact, its areas against what is solved
//! otherwise.

#[path = "skin/axisymmetric.rs"]
mod axisymmetric;

use nalgebra::{Point3, Vector3};
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::area;
use pliant::skin::layers::Tissue;
use pliant::skin::plan::{Place, Ready, over_ball};
use pliant::skin::settle::{Method, Progress};
use pliant::skin::{Order, SkinError, insert};

use axisymmetric::Membrane;

/// A square sheet of `n` by `n` cells about the origin, all diagonals alike, looking along z.
fn sheet(n: u32, side: f64) -> TriangleMesh {
    let at = |k: u32| side * (f64::from(k) / f64::from(n) - 0.5);
    let vertices = (0..=n).flat_map(|i| (0..=n).map(move |j| Point3::new(at(i), at(j), 0.0))).collect();
    let mut triangles = Vec::new();
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let a = i * (n + 1) + j;
        triangles.extend([[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]]);
    }
    TriangleMesh { vertices, triangles }
}

const CENTRE: Place = Place::Point(Point3::new(0.0, 0.0, 0.0));

/// The region over a sphere of 2.5 mm under a sheet of 1 cm.
fn small_sheet(n: u32) -> Ready {
    let tissue = Tissue { depth: 1e-4, ..Tissue::default() };
    let order = Order { tissue, edge: Some(2.5e-4), ..Order::round(CENTRE, 5e-3, 1e-8) };
    Ready::new(&sheet(n, 0.01), &order, &[]).expect("a region")
}

#[test]
fn region_of_the_sheets_is_that_of_the_source() {
    let table = [
        (64, [3922, 7504, 22176], 0.4580),
        (128, [15090, 29512, 87872], 0.4503),
        (256, [59154, 116_984, 349_632], 0.4463),
    ];
    for (n, counts, before) in table {
        let layers = small_sheet(n).layers;
        let found = [2 * layers.count(), 2 * layers.triangles.len(), layers.springs.len()];
        assert_eq!(found, counts, "{n} cells");
        let cm2 = area(&layers.rest[..layers.count()], &layers.triangles) * 1e4;
        // Half of the last digit given.
        assert!((cm2 - before).abs() <= 5e-5, "{n} cells: {cm2} cm2");
    }
}

/// Area [cm2] halfway between the layers over a sphere that has arrived at the sheet, and how it was found.
fn over_sphere(n: u32, method: Method) -> (f64, Progress) {
    let ready = small_sheet(n);
    let (radius, layers) = (2.5e-3, ready.layers);
    let model = over_ball(layers, ready.order.tissue.membrane(), Point3::origin(), radius, method);
    let lift =
        |p: &Point3<f64>| 1.1 * radius * (1.0 - p.coords.xy().norm_squared() / (2.25 * radius * radius)).max(0.0);
    let held = model.layers.held.clone();
    let mut x = model.rest();
    x.iter_mut().zip(&held).filter(|(_, held)| !**held).for_each(|(p, _)| p.z += lift(p));
    let progress = model.settle(&mut x, |_| true).expect("at rest");
    let count = model.layers.count();
    let middle: Vec<Point3<f64>> = (0..count).map(|v| nalgebra::center(&x[v], &x[v + count])).collect();
    (area(&middle, &model.layers.triangles) * 1e4, progress)
}

#[test]
fn sheet_over_a_sphere_has_the_area_of_an_axisymmetric_membrane() {
    let (found, progress) = over_sphere(64, Method::Newton);
    // Both layers together are one membrane halfway between them: half of the depth further from the sphere, and its rim
    // as much below the sheet.
    let rim = (0.4580f64 * 1e-4 / std::f64::consts::PI).sqrt();
    let (wanted, left) = axisymmetric::area(Membrane { rim, sphere: 2.5e-3 + 5e-5, height: 5e-5 });
    assert!(left <= 1e-4, "{left}");
    assert!(progress.converged, "{progress:?}");
    assert!((found / (wanted * 1e4) - 1.0).abs() <= 0.02, "{found} cm2, axisymmetric {} cm2", wanted * 1e4);
}

#[test]
fn flat_implants_gain_what_geometry_allows() {
    let skin = sheet(64, 0.2);
    for (volume, least, most) in [(50e-6, 4.0, 16.3), (100e-6, 14.5, 44.3), (150e-6, 27.9, 72.2)] {
        // Not over a vertex: there the counts are the source's.
        let order = Order::round(Place::Point(Point3::new(0.0014, 0.0, 0.0)), 0.07, volume);
        let (ready, done) = insert(&skin, &order, &[], |_| true).expect("settled");
        assert_eq!([2 * ready.layers.count(), ready.layers.springs.len()], [2016, 11140]);
        let gain = done.areas.gain() * 1e4;
        assert!(done.progress.converged);
        assert!((least..=most).contains(&gain), "{gain} cm2");
        assert!(done.areas.volume_difference >= 0.995 * volume, "{}", done.areas.volume_difference);
        assert!((done.implant_volume / volume - 1.0).abs() <= 1e-9);
        assert!(done.progress.depth <= 1e-3 * 0.07, "{}", done.progress.depth);
    }
}

#[test]
fn what_cannot_be_done_is_refused() {
    let skin = sheet(32, 0.2);
    let order = Order::round(CENTRE, 0.07, 1e-4);
    let refused = |order: &Order, skin: &TriangleMesh| insert(skin, order, &[], |_| true).expect_err("an error");
    let with = |change: fn(&mut Order)| {
        let mut order = order.clone();
        change(&mut order);
        order
    };
    for (change, what) in [
        ((|o| o.implant.volume = -1e-6) as fn(&mut Order), "the volume"),
        (|o| o.implant.volume = f64::NAN, "the volume"),
        (|o| o.implant.base = 0.0, "the base"),
        (|o| o.tissue.thickness = 0.0, "the thickness of the skin"),
        (|o| o.tissue.depth = f64::INFINITY, "the depth"),
        (|o| o.edge = Some(-1.0), "the edge length"),
    ] {
        let error = refused(&with(change), &skin);
        assert!(matches!(error, SkinError::NotPositive { what: found, .. } if found == what), "{error}");
    }
    let error = refused(&with(|o| o.place = Place::Point(Point3::new(0.07, 0.0, 0.0))), &skin);
    assert!(matches!(error, SkinError::AtBorder { .. }), "{error}");
    let error = refused(&with(|o| o.place = Place::Vertex(5_000_000)), &skin);
    assert!(matches!(error, SkinError::NoVertex { .. }), "{error}");
    let error = refused(&with(|o| o.place = Place::Point(Point3::new(0.0, 0.0, 1.0))), &skin);
    assert!(matches!(error, SkinError::FarAway { .. }), "{error}");
    let error = refused(&with(|o| o.implant.volume = 1e-3), &skin);
    assert!(matches!(error, SkinError::TooLarge { .. }), "{error}");
    let error = refused(&order, &TriangleMesh::default());
    assert!(matches!(error, SkinError::Empty), "{error}");
    // A third triangle at an edge in the middle.
    let mut fin = skin.clone();
    let [a, b, _] = fin.triangles[2 * (16 * 32 + 16)];
    fin.vertices.push(nalgebra::center(&fin.vertices[a as usize], &fin.vertices[b as usize]) + Vector3::z() * 0.01);
    fin.triangles.push([a, b, fin.vertices.len() as u32 - 1]);
    let near = Order { place: Place::Vertex(a as usize), ..order.clone() };
    let error = refused(&near, &fin);
    assert!(matches!(error, SkinError::NotManifold { .. }), "{error}");
    let stopped = insert(&skin, &order, &[], |_| false).expect_err("stopped");
    assert!(matches!(stopped, SkinError::Stopped));
}
