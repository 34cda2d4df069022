//! Skin over implants: the second source's sheets and flat implants, its exact region, and its
//! areas compared with other solutions.

#[path = "skin/axisymmetric.rs"]
mod axisymmetric;
#[path = "skin/cap.rs"]
mod cap;
#[path = "skin/real.rs"]
mod real;
#[path = "skin/shapes.rs"]
mod shapes;
#[path = "skin/together.rs"]
mod together;

use nalgebra::{Point3, Vector3};
use pliant::contact::Surface;
use pliant::mesh::measures::{area, max_or_nan};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::skin::{
    Filling, ImplantPlace, ImplantSpec, Inserted, Layers, PreparedPatch, SILICONE, Schedule,
    SettleMethod, SettleProgress, Shell, SkinError, Tissue, halved_near, insert,
};
use pliant::testing::internals::skin::{
    FilledImplant, SkinSystem, SupportSurface, over_ball, springs_of,
};

use axisymmetric::Membrane;
use shapes::{cube, sheet, sphere};

const CENTRE: ImplantPlace = ImplantPlace::Point(Point3::new(0.0, 0.0, 0.0));

/// Depth of the lower layer, or of the shell of another implant, inside an implant [m], for the
/// positions `x`. The depth is the signed distance to the shell as a separate surface, independent
/// of the solved contact.
fn sunk(ready: &PreparedPatch, done: &Inserted, x: &[Point3<f64>]) -> f64 {
    let n = ready.layers.count();
    let into = |own: &Shell| {
        let vertices = x[own.vertices.clone()].to_vec();
        let surface = Surface::new(&TriangleMesh {
            vertices,
            triangles: own.triangles.clone(),
        });
        let lower = (n..2 * n).filter(|v| !ready.layers.held[*v]);
        let others = done
            .shells
            .iter()
            .filter(|o| o.vertices != own.vertices)
            .flat_map(|o| o.vertices.clone());
        let depth = |v: usize| {
            surface
                .nearest(&x[v], f64::MAX)
                .map_or(f64::NAN, |on| (-on.closest.distance).max(0.0))
        };
        max_or_nan(lower.chain(others).map(depth))
    };
    max_or_nan(done.shells.iter().map(into))
}

/// The region over a sphere of 2.5 mm under a sheet of 1 cm.
fn small_sheet(n: u32) -> PreparedPatch {
    let tissue = Tissue {
        depth: 1e-4,
        ..Tissue::default()
    };
    let order = ImplantSpec {
        tissue,
        edge: Some(2.5e-4),
        ..ImplantSpec::round(CENTRE, 5e-3, 1e-8)
    };
    PreparedPatch::new(&sheet(n, 0.01), &order, &[]).expect("a region")
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
        let found = [
            2 * layers.count(),
            2 * layers.triangles.len(),
            layers.springs.len(),
        ];
        assert_eq!(found, counts, "{n} cells");
        let cm2 = area(&layers.rest[..layers.count()], &layers.triangles) * 1e4;
        // Half of the last printed digit.
        assert!((cm2 - before).abs() <= 5e-5, "{n} cells: {cm2} cm2");
    }
}

/// Layers of skin and their positions [m].
type Lying = (Layers, Vec<Point3<f64>>);

/// Skin over a sphere that has arrived at the sheet, started from a solution with longer edges;
/// area [cm2] halfway between its layers.
fn over_sphere(n: u32, coarser: Option<&Lying>) -> (f64, SettleProgress, Lying) {
    let ready = small_sheet(n);
    let radius = 2.5e-3;
    let method = if n > 64 {
        SettleMethod::QuasiStatic
    } else {
        SettleMethod::Newton
    };
    let model = over_ball(
        ready.layers,
        ready.order.tissue.membrane(),
        Point3::origin(),
        radius,
        method,
    );
    let mut x = match coarser {
        Some((layers, x)) => model.layers.follow(layers, x),
        None => lifted(&model, radius),
    };
    let progress = model.settle(&mut x, |_| true).expect("at rest");
    let count = model.layers.count();
    let middle: Vec<Point3<f64>> = (0..count)
        .map(|v| nalgebra::center(&x[v], &x[v + count]))
        .collect();
    (
        area(&middle, &model.layers.triangles) * 1e4,
        progress,
        (model.layers, x),
    )
}

/// Skin on a sphere and from there straight to the boundary loop.
fn lifted(model: &SkinSystem, radius: f64) -> Vec<Point3<f64>> {
    let rim = 1.5 * radius;
    let lift = |p: &Point3<f64>| {
        let out = p.coords.xy().norm();
        let straight = (rim - out).max(0.0) * radius / (rim * rim - radius * radius).sqrt();
        if out < radius * radius / rim {
            (radius * radius - out * out).sqrt()
        } else {
            straight
        }
    };
    let mut x = model.rest();
    let free = x
        .iter_mut()
        .zip(&model.layers.held)
        .filter(|(_, held)| !**held);
    free.for_each(|(p, _)| p.z += lift(p));
    x
}

#[test]
fn sheets_over_a_sphere_have_the_area_of_an_axisymmetric_membrane() {
    let mut found = Vec::new();
    let mut coarser = None;
    for (n, before) in [(64, 0.4580f64), (128, 0.4503), (256, 0.4463)] {
        let (after, progress, lying) = over_sphere(n, coarser.as_ref());
        assert!(progress.converged, "{n} cells: {progress:?}");
        // Both layers together are one membrane halfway between them: half of the depth further
        // from the sphere, with its boundary loop at the same depth below the sheet.
        let rim = (before * 1e-4 / std::f64::consts::PI).sqrt();
        let (expected, left) = axisymmetric::area(Membrane {
            rim,
            sphere: 2.5e-3 + 5e-5,
            height: 5e-5,
        });
        println!(
            "{n} cells: before {before} cm2, after {after:.4}, axisymmetric {:.4}; {progress:?}",
            expected * 1e4
        );
        assert!(left <= 1e-4, "{left}");
        assert!(
            (after / (expected * 1e4) - 1.0).abs() <= 0.02,
            "{n} cells: {after} cm2, axisymmetric {expected} m2"
        );
        found.push(after);
        coarser = Some(lying);
    }
    let spread = max_or_nan(found.iter().copied())
        / found.iter().copied().fold(f64::INFINITY, f64::min)
        - 1.0;
    assert!(spread <= 0.04, "{found:?}");
}

#[test]
fn flat_implants_gain_what_geometry_allows() {
    let skin = sheet(64, 0.2);
    for (volume, least, most) in [
        (50e-6, 4.0, 16.3),
        (100e-6, 14.5, 44.3),
        (150e-6, 27.9, 72.2),
    ] {
        // Away from a vertex the numbers equal those of the source.
        let order = ImplantSpec::round(
            ImplantPlace::Point(Point3::new(0.0014, 0.0, 0.0)),
            0.07,
            volume,
        );
        let (ready, done) = insert(&skin, &order, &[], |_| true).expect("settled");
        assert_eq!(
            [2 * ready.layers.count(), ready.layers.springs.len()],
            [2016, 11140]
        );
        let gain = done.areas.gain() * 1e4;
        assert!(done.progress.converged);
        assert!((least..=most).contains(&gain), "{gain} cm2");
        assert!(
            done.areas.volume_difference >= 0.995 * volume,
            "{}",
            done.areas.volume_difference
        );
        assert!((done.volume() / volume - 1.0).abs() <= 1e-9);
        assert!(
            done.progress.depth <= 1e-3 * 0.07,
            "{}",
            done.progress.depth
        );
    }
}

/// A cube of 2 cm on a floor with conserved volume, under a sphere of 1 cm that reaches down to
/// a height [m]; and the greatest penetration of the sphere.
fn pressed_cube(x: &mut Vec<Point3<f64>>, low: f64) -> (SkinSystem, SettleProgress) {
    let mesh = cube(8, 0.02);
    if x.is_empty() {
        x.clone_from(&mesh.vertices);
    }
    let (springs, stiffness) = springs_of(&mesh, &Topology::new(&mesh), SILICONE);
    let pocket = (0..mesh.vertices.len() as u32)
        .filter(|v| mesh.vertices[*v as usize].z == 0.0)
        .collect();
    let volume = mesh.volume();
    let ball = sphere(12, 11, 0.01, Point3::new(0.01, 0.01, low + 0.01));
    let model = SkinSystem {
        layers: Layers::none(0.0025),
        membrane: SILICONE,
        implants: vec![FilledImplant {
            mesh,
            springs,
            stiffness,
            volume,
            pocket,
        }],
        supports: vec![
            SupportSurface::new(sheet(4, 0.2)),
            SupportSurface::new(ball),
        ],
        has_obstacles: false,
        ball: None,
        base: 0.02,
        method: SettleMethod::Newton,
    };
    let progress = model.settle(x, |_| true).expect("settled");
    (model, progress)
}

#[test]
fn a_cube_pressed_by_a_sphere_keeps_its_volume() {
    let (mesh, ball) = (cube(8, 0.02), sphere(12, 11, 0.01, Point3::origin()));
    // The numbers of the source.
    assert_eq!([mesh.vertices.len(), mesh.triangles.len()], [386, 768]);
    assert_eq!([ball.vertices.len(), ball.triangles.len()], [134, 264]);
    assert!((mesh.volume() - 8e-6).abs() <= 1e-18 && (ball.volume() - 3.932e-6).abs() <= 5e-10);
    let mut x = Vec::new();
    for step in 1..=8 {
        let (model, progress) = pressed_cube(&mut x, 0.02 - 0.0005 * f64::from(step));
        let volume = TriangleMesh {
            vertices: x.clone(),
            triangles: mesh.triangles.clone(),
        }
        .volume();
        // The source loses 0.4 and 0.5 %.
        assert!((volume / 8e-6 - 1.0).abs() <= 1e-9, "step {step}: {volume}");
        assert!(
            progress.converged && progress.depth <= 1e-3 * model.base,
            "step {step}: {progress:?}"
        );
    }
    // The cube is not rigid: it yields under the sphere and bulges elsewhere. Without friction
    // the middle slides off the lowest point of the sphere but stays on the sphere: between its
    // circle and its facets, 3.4 % of the radius further in.
    let pressed = mesh
        .vertices
        .iter()
        .position(|p| *p == Point3::new(0.01, 0.01, 0.02))
        .expect("a middle");
    let out = (x[pressed] - Point3::new(0.01, 0.01, 0.026)).norm() / 0.01;
    assert!(
        (0.965..=1.005).contains(&out) && x[pressed].z <= 0.017,
        "{out}, {}",
        x[pressed]
    );
    let widest = max_or_nan(x.iter().map(|p| (p.x - 0.01).abs().max((p.y - 0.01).abs())));
    assert!(widest >= 0.0105, "{widest}");
}

#[test]
fn implants_are_filled_by_a_schedule_to_where_they_come_at_once() {
    let (skin, order) = (sheet(40, 0.2), ImplantSpec::round(CENTRE, 0.07, 80e-6));
    let order = ImplantSpec {
        edge: Some(0.005),
        ..order
    };
    let ready = PreparedPatch::new(&skin, &order, &[]).expect("a region");
    let filling = |day, volume| Filling { day, volume };
    let schedule = Schedule::new(vec![
        filling(0.0, 30e-6),
        filling(7.0, 60e-6),
        filling(14.0, 80e-6),
    ])
    .expect("rising");
    let mut filled: Vec<Inserted> = Vec::new();
    for filling in schedule.fillings() {
        let next = ready.insert_after(filled.last(), &[filling.volume], |_| true);
        filled.push(next.expect("settled"));
    }
    let gains: Vec<f64> = filled.iter().map(|done| done.areas.gain()).collect();
    assert!(
        filled.iter().all(|done| done.progress.converged),
        "{:?}",
        filled.iter().map(|d| d.progress).collect::<Vec<_>>()
    );
    assert!(gains[0] < gains[1] && gains[1] < gains[2], "{gains:?}");
    let at_once = ready.insert(80e-6, |_| true).expect("settled").areas.gain();
    // Both are at rest to a thousandth of the area, which is about fifteen times the gain.
    assert!(
        (gains[2] / at_once - 1.0).abs() <= 0.01,
        "{} and {at_once} m2",
        gains[2]
    );
}

#[test]
fn numbers_that_make_no_sense_beside_the_base_are_refused() {
    let skin = sheet(32, 0.2);
    let order = ImplantSpec::round(CENTRE, 0.07, 1e-4);
    let made = |change: fn(&mut ImplantSpec)| {
        let mut order = order.clone();
        change(&mut order);
        order
            .check_edge()
            .and_then(|()| PreparedPatch::new(&skin, &order, &[]))
            .map(|_| ())
    };
    // Slightly within half of the base, and a quarter of it.
    for (within, beyond) in [
        (
            (|o| o.tissue.depth = 0.035) as fn(&mut ImplantSpec),
            (|o| o.tissue.depth = 0.0351) as fn(&mut ImplantSpec),
        ),
        (
            |o| o.tissue.thickness = 0.035,
            |o| o.tissue.thickness = 0.0351,
        ),
    ] {
        assert_eq!(made(within), Ok(()));
        assert!(matches!(made(beyond), Err(SkinError::TooThick { .. })));
    }
    assert_eq!(made(|o| o.edge = Some(0.0175)), Ok(()));
    assert!(matches!(
        made(|o| o.edge = Some(0.0176)),
        Err(SkinError::TooLong { .. })
    ));
    assert_eq!(
        made(|o| o.long = Some(Vector3::new(0.0, 1e-3, 0.0))),
        Ok(())
    );
    assert_eq!(
        made(|o| o.long = Some(Vector3::zeros())),
        Err(SkinError::NoDirection)
    );
    // The skin itself as the surface below it, and the same surface a depth further down.
    let own = |down: f64| {
        let mut below = skin.clone();
        below.vertices.iter_mut().for_each(|p| p.z -= down);
        PreparedPatch::new(
            &skin,
            &order,
            &[sphere(12, 11, 0.05, Point3::new(0.0, 0.0, -0.06)), below],
        )
        .map(|_| ())
    };
    assert_eq!(own(0.0), Err(SkinError::ObstacleIsSkin { obstacle: 2 }));
    assert_eq!(own(5e-3), Ok(()));
    // The reported largest volume fits; a slightly larger volume does not.
    let ready = PreparedPatch::new(&skin, &order, &[]).expect("a region");
    let largest = ready.largest();
    assert_eq!(ready.takes(&[largest]), Ok(()));
    assert!(
        matches!(ready.takes(&[1.01 * largest]), Err(SkinError::TooLarge { most_cc, .. }) if most_cc >= largest * 0.99e6)
    );
}

#[test]
fn large_triangles_are_refined_near_the_implant_only_or_refused_by_their_number() {
    // Six faces of two triangles each, of 40 cm.
    let skin = cube(1, 0.4);
    let at = Point3::new(0.25, 0.13, 0.4);
    let order = ImplantSpec {
        tissue: Tissue {
            depth: 2e-3,
            ..Tissue::default()
        },
        ..ImplantSpec::round(ImplantPlace::Point(at), 0.01, 2e-7)
    };
    let error = PreparedPatch::new(&skin, &order, &[]).expect_err("too much to refine");
    assert!(
        matches!(error, SkinError::TooLargePatch { vertices, most } if vertices > most),
        "{error}"
    );
    let halved = halved_near(skin, std::slice::from_ref(&order));
    let ready = PreparedPatch::new(&halved, &order, &[]).expect("a region");
    assert!(
        ready.patch.triangles.len() < 20_000,
        "{}",
        ready.patch.triangles.len()
    );
    let stop = |_: &str, _: usize, _: usize| std::ops::ControlFlow::Break(());
    // Refinement checks whether to continue. Its result is not needed here.
    let stopped = PreparedPatch::new_with(&halved, &order, &[], &stop).expect_err("stopped");
    assert_eq!(stopped, SkinError::Stopped);
    // At a corner the skin curves away, but it has no border near the implant.
    let corner = ImplantSpec {
        place: ImplantPlace::Vertex(0),
        ..order
    };
    let halved = halved_near(cube(1, 0.4), std::slice::from_ref(&corner));
    let error = PreparedPatch::new(&halved, &corner, &[]).expect_err("no place");
    assert!(matches!(error, SkinError::WrapsAround { .. }), "{error}");
}

#[test]
fn what_cannot_be_done_is_refused() {
    let skin = sheet(32, 0.2);
    let order = ImplantSpec::round(CENTRE, 0.07, 1e-4);
    let refused = |order: &ImplantSpec, skin: &TriangleMesh| {
        insert(skin, order, &[], |_| true).expect_err("an error")
    };
    let with = |change: fn(&mut ImplantSpec)| {
        let mut order = order.clone();
        change(&mut order);
        order
    };
    for (change, what) in [
        (
            (|o| o.implant.volume = -1e-6) as fn(&mut ImplantSpec),
            "the volume",
        ),
        (|o| o.implant.volume = f64::NAN, "the volume"),
        (|o| o.implant.base = 0.0, "the base"),
        (|o| o.tissue.thickness = 0.0, "the thickness of the skin"),
        (|o| o.tissue.depth = f64::INFINITY, "the depth"),
        (|o| o.edge = Some(-1.0), "the edge length"),
    ] {
        let error = refused(&with(change), &skin);
        assert!(
            matches!(error, SkinError::NotPositive { what: found, .. } if found == what),
            "{error}"
        );
    }
    let error = refused(
        &with(|o| o.place = ImplantPlace::Point(Point3::new(0.07, 0.0, 0.0))),
        &skin,
    );
    assert!(matches!(error, SkinError::AtBorder { .. }), "{error}");
    let error = refused(&with(|o| o.place = ImplantPlace::Vertex(5_000_000)), &skin);
    assert!(matches!(error, SkinError::NoVertex { .. }), "{error}");
    let error = refused(
        &with(|o| o.place = ImplantPlace::Point(Point3::new(0.0, 0.0, 1.0))),
        &skin,
    );
    assert!(matches!(error, SkinError::FarAway { .. }), "{error}");
    let error = refused(&with(|o| o.implant.volume = 1e-3), &skin);
    assert!(matches!(error, SkinError::TooLarge { .. }), "{error}");
    let error = refused(&order, &TriangleMesh::default());
    assert!(matches!(error, SkinError::Empty), "{error}");
    let beside = |by: Vector3<f64>| {
        let mut bone = sphere(12, 11, 0.05, Point3::new(0.0, 0.0, -0.06));
        bone.vertices.iter_mut().for_each(|p| *p += by);
        insert(&skin, &order, &[bone], |_| true)
    };
    // Beside the sheet, or further than two bases above or below it. Without a body around it, a
    // sheet is oriented to face away from bones.
    for away in [Vector3::x() * 0.3, Vector3::z() * 0.3, Vector3::z() * -0.3] {
        let error = beside(away).expect_err("nothing below");
        assert!(matches!(error, SkinError::NothingBelow), "{error}");
    }
    assert!(beside(Vector3::zeros()).is_ok());
    // A third triangle at an inner edge.
    let mut fin = skin.clone();
    let [a, b, _] = fin.triangles[2 * (16 * 32 + 16)];
    fin.vertices.push(
        nalgebra::center(&fin.vertices[a as usize], &fin.vertices[b as usize])
            + Vector3::z() * 0.01,
    );
    fin.triangles.push([a, b, fin.vertices.len() as u32 - 1]);
    let near = ImplantSpec {
        place: ImplantPlace::Vertex(a as usize),
        ..order.clone()
    };
    let error = refused(&near, &fin);
    assert!(matches!(error, SkinError::NotManifold { .. }), "{error}");
    let stopped = insert(&skin, &order, &[], |_| false).expect_err("stopped");
    assert!(matches!(stopped, SkinError::Stopped));
}
