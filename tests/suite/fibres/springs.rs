//! Decomposition by springs.

use nalgebra::{Point3, Vector3};
use pliant::fibres::SpringsError;
use pliant::fibres::quality::measure;
use pliant::fibres::{Attachment, Template};
use pliant::mesh::TriangleMesh;
use pliant::morph::SphereError;
use pliant::springs::damping::{DampedBody, estimate};
use pliant::springs::integrators::{Integrator, Verlet};
use pliant::springs::{
    Hooke, Neighbours, RestEnd, RestSettings, SpringSystem, Springs, limit, settle, stiffest,
};
use pliant::testing::internals::fibres::springs::{SpringOptions, decompose, grid, rest, springs};
use pliant::testing::internals::fibres::{Closed, Grid, Sampling};

use super::{made, ring_torus, star};
use crate::tolerances::{T1, worst};

fn plain(mesh: &TriangleMesh, areas: &Attachment) -> Grid {
    grid(mesh, areas, Template::Parallel, SpringOptions::default()).expect("fibres")
}

#[test]
fn a_cylinder_has_nearly_straight_fibres_that_end_on_its_caps() {
    let (mesh, areas) = made(|p| *p);
    let found = plain(&mesh, &areas);
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
    // Ends are on triangles of the areas.
    assert!(q.end_distance_max_m <= 1e-12, "{q:?}");
    assert!(q.coverage >= 0.95, "{q:?}");
    // Lines follow a map with triangles as long as an eighth of the circumference. Fibres wind by
    // at most that, a chord of 15 mm over 200 mm, which makes them 0.3 % longer.
    let drift = fibres.iter().map(|f| (f[14].yz() - f[0].yz()).norm());
    println!("drift {:e}", worst(drift.clone()));
    assert!(worst(drift) <= 0.015);
    assert!(
        (q.length_mean_m / 0.2 - 1.0).abs() <= 0.01 && q.pennation_mean_rad <= 0.075,
        "{q:?}"
    );
}

#[test]
fn inner_points_are_in_the_middle_of_their_springs() {
    let (mesh, areas) = made(|p| *p);
    let found = plain(&mesh, &areas);
    let net = springs(&found.sampling, Template::Parallel);
    let held = found.sampling.on_surface();
    let forces = |points: &[Point3<f64>]| {
        let mut force = vec![Vector3::zeros(); points.len()];
        for (ends, rest) in &net {
            let [a, b] = ends.map(|p| p as usize);
            let pull = (points[b] - points[a]) / *rest;
            force[a] += pull;
            force[b] -= pull;
        }
        worst(
            force
                .iter()
                .zip(&held)
                .filter(|(_, held)| !**held)
                .map(|(f, _)| f.norm()),
        )
    };
    // A spring as long as the tube pulls with 0.2 times 14.
    let scale = 0.2 * 14.0;
    assert!(
        forces(&found.points) <= 1e-12 * scale,
        "{}",
        forces(&found.points)
    );
    let mut moved = found.points.clone();
    moved[found.sampling.number([4, 4, 7])].x += 1e-6;
    assert!(forces(&moved) > 1e-6 * scale, "control");
}

#[test]
fn newton_and_the_damped_way_in_time_end_in_the_same_place() {
    let (mesh, areas) = made(|p| Point3::new(p.x, p.y + 2.0 * p.x * p.x, p.z));
    // Long enough to differ from zero: the cube has a side of 2 mm.
    let options = SpringOptions {
        count: 25,
        points: 5,
        side: 0.01,
    };
    let found = grid(&mesh, &areas, Template::Parallel, options).expect("fibres");
    let side = options.side * mesh.length();
    let net = springs(&found.sampling, Template::Parallel);
    let law = |&(ends, rest): &([u32; 2], f64)| {
        let (rest, stiffness) = (side * rest, 1.0 / (side * rest));
        (ends, Hooke { rest, stiffness })
    };
    let free = grid(
        &mesh,
        &areas,
        Template::Parallel,
        SpringOptions {
            side: 0.0,
            ..options
        },
    )
    .expect("fibres");
    let mut system =
        SpringSystem::new(free.points.clone(), vec![1.0; free.points.len()]).expect("a system");
    system
        .add(Springs::new(free.points.len(), net.iter().map(law)).expect("springs"))
        .expect("springs");
    system.pin(
        (0..)
            .zip(found.sampling.on_surface())
            .filter(|(_, held)| *held)
            .map(|(p, _)| p),
    );
    // (7.2) for this size: springs with stiffness 1/l0 have a tension of 1 N per strain.
    let body = DampedBody {
        mass: 1.0,
        tension: 1.0,
        side,
        spacing: side / 4.0,
    };
    system.damping = estimate(Neighbours::Six, body);
    let mut verlet = Verlet::default();
    let dt = 0.5 * limit(&verlet, &stiffest(&system));
    let rest = RestSettings::share_of(&system, 1e-11);
    let settled = settle(
        &mut system,
        &mut verlet as &mut dyn Integrator,
        dt,
        rest,
        20_000,
        |_, _| true,
    );
    assert_eq!(settled.end, RestEnd::Rest, "{settled:?}");
    let apart = worst(
        system
            .position
            .iter()
            .zip(&found.points)
            .map(|(a, b)| (a - b).norm()),
    );
    let moved = worst(
        free.points
            .iter()
            .zip(&found.points)
            .map(|(a, b)| (a - b).norm()),
    );
    println!(
        "{} steps, {apart:e} m apart, {moved:e} m from springs without length",
        settled.steps
    );
    // Forces are below 1e-11 of the scale; the softest mode has a tenth of the stiffness.
    assert!(apart <= 1e-9 * mesh.length(), "{apart}");
    assert!(
        moved > 100.0 * apart,
        "control: rest lengths do not matter, {moved}"
    );
    // With the thesis's 0.003 the effect is small.
    let thesis = grid(
        &mesh,
        &areas,
        Template::Parallel,
        SpringOptions {
            side: 0.003,
            ..options
        },
    )
    .expect("fibres");
    let change = worst(
        free.points
            .iter()
            .zip(&thesis.points)
            .map(|(a, b)| (a - b).norm()),
    );
    assert!(change <= 0.003 * mesh.length(), "{change}");
}

#[test]
fn a_regular_grid_is_at_rest_as_it_is() {
    for side in [0.0, 0.4] {
        let sampling = Sampling::new(36, 9).expect("a grid");
        let exact = sampling.positions(Template::Parallel);
        let mut points = exact.clone();
        let held = sampling.on_surface();
        points
            .iter_mut()
            .zip(&held)
            .filter(|(_, held)| !**held)
            .for_each(|(p, _)| *p = Point3::origin());
        rest(&sampling, Template::Parallel, side, &mut points).expect("at rest");
        assert!(
            worst(points.iter().zip(&exact).map(|(a, b)| (a - b).norm())) <= T1,
            "{side}"
        );
    }
}

#[test]
fn points_of_star_shaped_muscles() {
    for amount in [0.0, 0.5, 1.0] {
        let (mesh, areas) = star(amount);
        let found = plain(&mesh, &areas);
        let q = measure(
            &mesh,
            &Closed::new(&mesh),
            &areas,
            &found.fibres(),
            found.jacobian(),
        );
        println!("{amount}: {q:?}");
        assert!(
            q.end_distance_max_m <= 1e-12 && q.coverage >= 0.95,
            "{amount}: {q:?}"
        );
        // Springs keep inner points within the hull of the fixed ones: inside a convex muscle,
        // otherwise nearly.
        assert!(
            q.outside <= if amount == 0.0 { 0 } else { 5 },
            "{amount}: {q:?}"
        );
    }
}

#[test]
fn surfaces_that_are_no_sphere_are_refused_with_their_place() {
    let (mesh, areas) = made(|p| *p);
    let refused = |mesh: &TriangleMesh, areas: &Attachment| {
        decompose(mesh, areas, Template::Parallel, SpringOptions::default()).expect_err("refused")
    };
    let mut open = mesh.clone();
    open.triangles.remove(mesh.triangles.len() / 2);
    let error = refused(&open, &areas);
    assert!(
        matches!(
            error,
            SpringsError::Surface(SphereError::Open { edges: 3, .. })
        ),
        "{error}"
    );
    assert!(error.to_string().contains("between vertices"), "{error}");
    let mut two = mesh.clone();
    let count = two.vertices.len() as u32;
    two.vertices.extend(
        mesh.vertices
            .iter()
            .map(|v| v + Vector3::new(0.0, 0.1, 0.0)),
    );
    two.triangles
        .extend(mesh.triangles.iter().map(|t| t.map(|v| v + count)));
    let error = refused(&two, &areas);
    assert!(
        matches!(error, SpringsError::Surface(SphereError::Pieces { pieces: 2, vertex }) if vertex == count),
        "{error}"
    );
    let (ring, ends) = ring_torus();
    let error = refused(&ring, &ends);
    assert!(
        matches!(
            error,
            SpringsError::Surface(SphereError::Genus { genus: 1, euler: 0 })
        ),
        "{error}"
    );
    let mut inward = mesh.clone();
    inward.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let error = refused(&inward, &areas);
    assert!(
        matches!(error, SpringsError::InsideOut { volume } if volume < 0.0),
        "{error}"
    );
    let mut turned = mesh.clone();
    turned.triangles[5].swap(0, 1);
    let error = refused(&turned, &areas);
    assert!(
        matches!(error, SpringsError::Surface(SphereError::Turned { .. })),
        "{error}"
    );
    // M20: with a vertex without triangles V - F/2 is 3, as in table 7.7; the error contains its
    // index.
    let mut unused = mesh.clone();
    unused.vertices.push(Point3::origin());
    let error = refused(&unused, &areas);
    assert!(
        matches!(error, SpringsError::Surface(SphereError::Unused { vertex, .. }) if vertex == count),
        "{error}"
    );
}

#[test]
fn options_that_make_no_grid_are_refused() {
    let (mesh, areas) = made(|p| *p);
    let with = |options: SpringOptions| decompose(&mesh, &areas, Template::Curved, options);
    for (count, points) in [(0, 15), (100, 1)] {
        let error = with(SpringOptions {
            count,
            points,
            side: 0.0,
        })
        .expect_err("refused");
        assert_eq!(error, SpringsError::TooFew { count, points });
    }
    assert_eq!(
        with(SpringOptions {
            side: -1.0,
            ..SpringOptions::default()
        })
        .expect_err("refused"),
        SpringsError::Side(-1.0)
    );
    assert!(matches!(
        with(SpringOptions {
            side: f64::NAN,
            ..SpringOptions::default()
        }),
        Err(SpringsError::Side(_))
    ));
    assert_eq!(
        with(SpringOptions {
            count: 7,
            points: 3,
            side: 0.0
        })
        .expect("fibres")
        .len(),
        7
    );
    // Springs as long as the muscle are compressed and buckle.
    let error = with(SpringOptions {
        side: 1.0,
        ..SpringOptions::default()
    })
    .expect_err("refused");
    assert!(matches!(error, SpringsError::NotAtRest { .. }), "{error}");
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let (mesh, areas) = star(1.0);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| plain(&mesh, &areas).points)
    };
    assert_eq!(with(1), with(2));
}
