//! Impulses compared with the laws of collision, and the counter-examples of errata B06 and B12.

use nalgebra::Vector3;
use pliant::testing::Draw;
use pliant::testing::internals::springs::contact::{ContactPart, Response, ResponseError, impulse};
use proptest::prelude::*;

fn on_line(mass: f64, velocity: f64) -> ContactPart<1> {
    ContactPart {
        weights: [1.0],
        inverse_mass: [1.0 / mass],
        velocity: [Vector3::x() * velocity],
    }
}

#[test]
fn b06_bodies_part_with_the_restitution_s_share_of_their_approach() {
    let (m, v) = ([1.0, 3.0], [2.0, -1.0]);
    let energy = |u: [f64; 2]| 0.5 * (m[0] * u[0] * u[0] + m[1] * u[1] * u[1]);
    for (e, parts, left, printed_left, printed_energy) in [
        (0.0, 0.0, 0.125, -6.0, 13.625),
        (0.5, 1.5, 0.96875, -7.5, 21.21875),
        (1.0, 3.0, 3.5, -9.0, 30.5),
    ] {
        let (one, two) = (on_line(m[0], v[0]), on_line(m[1], v[1]));
        let response = Response::new(e, 0.0).expect("in range");
        let j = impulse(&Vector3::x(), &one, &two, response).expect("they approach");
        let after = [one.after(&-j)[0].x, two.after(&j)[0].x];
        assert!((after[1] - after[0] - parts).abs() <= 1e-15, "{after:?}");
        assert!(
            (m[0] * after[0] + m[1] * after[1] + 1.0).abs() <= 1e-15,
            "momentum"
        );
        assert!(
            (energy(after) - left).abs() <= 1e-15 && energy(after) <= energy(v) + 1e-15,
            "{after:?}"
        );
        // Control: the printed signs drive them into each other, with the same momentum and more
        // energy.
        let printed = [one.after(&j)[0].x, two.after(&-j)[0].x];
        assert!(
            (printed[1] - printed[0] - printed_left).abs() <= 1e-14,
            "{printed:?}"
        );
        assert!((m[0] * printed[0] + m[1] * printed[1] + 1.0).abs() <= 1e-14);
        assert!((energy(printed) - printed_energy).abs() <= 1e-14 && energy(printed) > 3.5);
        // Only for an approach: the printed form lacks this test and would attract separating
        // bodies.
        assert_eq!(impulse(&-Vector3::x(), &one, &two, response), None);
        assert_eq!(
            impulse(
                &Vector3::x(),
                &on_line(1.0, -1.0),
                &on_line(1.0, 1.0),
                response
            ),
            None
        );
    }
}

/// Normal velocities of an edge and a triangle from the erratum; n from the edge to the triangle.
fn erratum_b12() -> (ContactPart<2>, ContactPart<3>) {
    let x = |v: f64| Vector3::new(0.0, 0.0, v);
    let edge = ContactPart {
        weights: [0.7, 0.3],
        inverse_mass: [1.0, 0.5],
        velocity: [x(1.0), x(0.5)],
    };
    let triangle = ContactPart {
        weights: [0.2, 0.3, 0.5],
        inverse_mass: [1.0, 1.0, 0.25],
        velocity: [x(-1.0), x(0.0), x(-0.5)],
    };
    (edge, triangle)
}

fn momentum<const N: usize>(part: &ContactPart<N>, velocity: &[Vector3<f64>; N]) -> Vector3<f64> {
    part.inverse_mass
        .iter()
        .zip(velocity)
        .filter(|(w, _)| **w > 0.0)
        .map(|(w, v)| v / *w)
        .sum()
}

#[test]
fn b12_an_edge_against_a_triangle_keeps_momentum() {
    let (edge, triangle) = erratum_b12();
    let z = Vector3::z();
    let before = momentum(&edge, &edge.velocity) + momentum(&triangle, &triangle.velocity);
    let apart = |a: &ContactPart<2>, b: &ContactPart<3>| (b.at() - a.at()).z;
    assert!((apart(&edge, &triangle) + 1.3).abs() <= 1e-15 && (before.z + 1.0).abs() <= 1e-15);
    let j = impulse(
        &z,
        &edge,
        &triangle,
        Response::new(0.5, 0.0).expect("in range"),
    )
    .expect("they approach");
    let (a, b) = (edge.after(&-j), triangle.after(&j));
    let after = (
        ContactPart {
            velocity: a,
            ..edge
        },
        ContactPart {
            velocity: b,
            ..triangle
        },
    );
    assert!((apart(&after.0, &after.1) - 0.65).abs() <= 1e-15);
    assert!((momentum(&edge, &a) + momentum(&triangle, &b) - before).norm() <= 1e-15);
    // Control: the same impulse for all five points by their mean masses, as in the source.
    let j = 1.5 * 1.3 / (1.0 / 1.5 + 1.0 / 2.0);
    let same = |part: &[f64], sign: f64| part.iter().map(|w| sign * j * w).collect::<Vec<_>>();
    let (by_a, by_b) = (
        same(&edge.inverse_mass, -1.0),
        same(&triangle.inverse_mass, 1.0),
    );
    let a: [Vector3<f64>; 2] = std::array::from_fn(|i| edge.velocity[i] + z * by_a[i]);
    let b: [Vector3<f64>; 3] = std::array::from_fn(|i| triangle.velocity[i] + z * by_b[i]);
    let after = (
        ContactPart {
            velocity: a,
            ..edge
        },
        ContactPart {
            velocity: b,
            ..triangle
        },
    );
    assert!(
        (apart(&after.0, &after.1) - 1.165).abs() <= 5e-4,
        "the erratum's digits"
    );
    assert!(((momentum(&edge, &a) + momentum(&triangle, &b)).z - 0.671).abs() <= 5e-4);
    assert!((momentum(&edge, &a) + momentum(&triangle, &b) - before).norm() > 1.0);
}

#[test]
fn what_is_held_stays_and_what_is_held_on_both_sides_is_left_alone() {
    let (edge, triangle) = erratum_b12();
    let held = ContactPart {
        inverse_mass: [0.0; 3],
        ..triangle
    };
    let j = impulse(&Vector3::z(), &edge, &held, Response::default()).expect("they approach");
    assert_eq!(held.after(&j), held.velocity);
    let after = ContactPart {
        velocity: edge.after(&-j),
        ..edge
    };
    assert!(
        (held.at() - after.at()).norm() <= 1e-15,
        "without bounce it goes with what is held"
    );
    let both = ContactPart {
        inverse_mass: [0.0; 2],
        ..edge
    };
    assert_eq!(
        impulse(&Vector3::z(), &both, &held, Response::default()),
        None
    );
    let one = ContactPart {
        inverse_mass: [0.0, 0.5],
        ..edge
    };
    let j = impulse(&Vector3::z(), &one, &held, Response::default()).expect("an end is free");
    assert_eq!(one.after(&-j)[0], one.velocity[0]);
}

#[test]
fn responses_out_of_range_are_refused() {
    for e in [-0.1, 1.1, f64::INFINITY] {
        assert_eq!(Response::new(e, 0.0), Err(ResponseError::Restitution(e)));
    }
    for mu in [-0.1, f64::INFINITY] {
        assert_eq!(Response::new(0.5, mu), Err(ResponseError::Friction(mu)));
    }
    assert!(Response::new(f64::NAN, 0.0).is_err() && Response::new(0.0, f64::NAN).is_err());
    // Velocities that are not finite give no impulse.
    let mad = ContactPart {
        velocity: [Vector3::repeat(f64::INFINITY)],
        ..on_line(1.0, 1.0)
    };
    assert_eq!(
        impulse(&Vector3::x(), &mad, &on_line(1.0, 0.0), Response::default()),
        None
    );
}

/// An edge and a triangle with a common point, and all parameters of the collision.
#[derive(Debug)]
struct Collision {
    edge: ContactPart<2>,
    triangle: ContactPart<3>,
    ends: [Vector3<f64>; 2],
    corners: [Vector3<f64>; 3],
    normal: Vector3<f64>,
    response: Response,
}

fn draw(seed: u64, e: f64, mu: f64, held: u8) -> Collision {
    let mut draw = Draw::new(seed);
    let size = draw.decades(-2.0, 2.0);
    let weights = |draw: &mut Draw, n: usize| {
        // Some are exactly 0, as for a vertex.
        let all: Vec<f64> = (0..n)
            .map(|_| (draw.between(-0.3, 1.0)).max(0.0) + 1e-3)
            .collect();
        let sum: f64 = all.iter().sum();
        all.into_iter().map(|w| w / sum).collect::<Vec<_>>()
    };
    let (a, b) = (weights(&mut draw, 2), weights(&mut draw, 3));
    let mut mass = |k: u8| {
        if held >> k & 1 == 1 {
            0.0
        } else {
            1.0 / draw.decades(-2.0, 2.0)
        }
    };
    let inverse_mass = ([mass(0), mass(1)], [mass(2), mass(3), mass(4)]);
    let mut vector = |scale: f64| draw.direction() * (scale * draw.between(0.0, 1.0));
    let mut velocity = |w: f64| {
        if w > 0.0 {
            vector(size)
        } else {
            Vector3::zeros()
        }
    };
    let edge_velocity = inverse_mass.0.map(&mut velocity);
    let triangle_velocity = inverse_mass.1.map(&mut velocity);
    let ends = [vector(1.0), vector(1.0)];
    let mut corners = [vector(1.0), vector(1.0), vector(1.0)];
    // The third corner places the common point.
    let shared = ends[0] * a[0] + ends[1] * a[1];
    corners[2] = (shared - corners[0] * b[0] - corners[1] * b[1]) / b[2];
    Collision {
        edge: ContactPart {
            weights: [a[0], a[1]],
            inverse_mass: inverse_mass.0,
            velocity: edge_velocity,
        },
        triangle: ContactPart {
            weights: [b[0], b[1], b[2]],
            inverse_mass: inverse_mass.1,
            velocity: triangle_velocity,
        },
        ends,
        corners,
        normal: draw.direction(),
        response: Response::new(e, mu).expect("in range"),
    }
}

fn kinetic<const N: usize>(part: &ContactPart<N>, velocity: &[Vector3<f64>; N]) -> f64 {
    part.inverse_mass
        .iter()
        .zip(velocity)
        .filter(|(w, _)| **w > 0.0)
        .map(|(w, v)| 0.5 * v.norm_squared() / w)
        .sum()
}

fn spin<const N: usize>(
    part: &ContactPart<N>,
    x: &[Vector3<f64>; N],
    velocity: &[Vector3<f64>; N],
) -> Vector3<f64> {
    let free = (0..N).filter(|&i| part.inverse_mass[i] > 0.0);
    free.map(|i| x[i].cross(&velocity[i]) / part.inverse_mass[i])
        .sum()
}

/// The violated laws after a collision; empty if all hold.
fn faults(c: &Collision, a: &[Vector3<f64>; 2], b: &[Vector3<f64>; 3]) -> Vec<&'static str> {
    let mut faults = Vec::new();
    let mut want = |holds: bool, what: &'static str| {
        if !holds {
            faults.push(what)
        }
    };
    let after = (
        ContactPart {
            velocity: *a,
            ..c.edge
        },
        ContactPart {
            velocity: *b,
            ..c.triangle
        },
    );
    let (before, now) = (c.triangle.at() - c.edge.at(), after.1.at() - after.0.at());
    let speed = c
        .edge
        .velocity
        .iter()
        .chain(&c.triangle.velocity)
        .map(|v| v.norm())
        .sum::<f64>();
    let small = 1e-12 * speed;
    let (u, v) = (before.dot(&c.normal), now.dot(&c.normal));
    want(
        (v + c.response.restitution() * u).abs() <= small,
        "restitution",
    );
    let energy = kinetic(&c.edge, &c.edge.velocity) + kinetic(&c.triangle, &c.triangle.velocity);
    want(
        kinetic(&c.edge, a) + kinetic(&c.triangle, b) <= energy * (1.0 + 1e-12),
        "energy",
    );
    let free = c
        .edge
        .inverse_mass
        .iter()
        .chain(&c.triangle.inverse_mass)
        .all(|w| *w > 0.0);
    if free {
        let before =
            momentum(&c.edge, &c.edge.velocity) + momentum(&c.triangle, &c.triangle.velocity);
        let mass: f64 = c
            .edge
            .inverse_mass
            .iter()
            .chain(&c.triangle.inverse_mass)
            .map(|w| 1.0 / w)
            .sum();
        want(
            (momentum(&c.edge, a) + momentum(&c.triangle, b) - before).norm() <= small * mass,
            "momentum",
        );
        let before = spin(&c.edge, &c.ends, &c.edge.velocity)
            + spin(&c.triangle, &c.corners, &c.triangle.velocity);
        let reach = 1.0 + c.corners[2].norm();
        let now = spin(&c.edge, &c.ends, a) + spin(&c.triangle, &c.corners, b);
        want(
            (now - before).norm() <= small * mass * reach,
            "angular momentum",
        );
    }
    let held = |w: &f64, v: &Vector3<f64>, before: &Vector3<f64>| *w > 0.0 || v == before;
    want(
        (0..2).all(|i| held(&c.edge.inverse_mass[i], &a[i], &c.edge.velocity[i])),
        "held",
    );
    want(
        (0..3).all(|i| held(&c.triangle.inverse_mass[i], &b[i], &c.triangle.velocity[i])),
        "held",
    );
    // Sliding keeps its direction, and friction is within its limit.
    let (before, now) = (before - c.normal * u, now - c.normal * v);
    let mu = c.response.friction();
    let most = mu * (1.0 + c.response.restitution()) * -u;
    want(
        now.norm() <= before.norm() + small && now.dot(&before) >= -small * before.norm(),
        "turned",
    );
    want(
        (before - now).norm() <= most + small,
        "more friction than mu allows",
    );
    want(
        now.norm() <= small || (before - now).norm() >= most - small,
        "less friction than there is",
    );
    faults
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1024))]
    #[test]
    fn collisions_obey_the_laws(seed in any::<u64>(), e in prop_oneof![Just(0.0), Just(1.0), 0.0..=1.0f64], mu in prop_oneof![Just(0.0), 0.0..2.0f64], held in 0u8..32) {
        // Half of them without fixed points.
        let c = draw(seed, e, mu, if seed % 2 == 0 { 0 } else { held });
        let approach = (c.triangle.at() - c.edge.at()).dot(&c.normal);
        let Some(j) = impulse(&c.normal, &c.edge, &c.triangle, c.response) else {
            let movable = c.edge.inverse_mass.iter().chain(&c.triangle.inverse_mass).any(|w| *w > 0.0);
            prop_assert!(approach >= 0.0 || !movable);
            return Ok(());
        };
        prop_assert!(approach < 0.0);
        let (a, b) = (c.edge.after(&-j), c.triangle.after(&j));
        prop_assert_eq!(faults(&c, &a, &b), Vec::<&str>::new());
        // Controls: the printed sign, half an impulse, one side omitted.
        let printed = faults(&c, &c.edge.after(&j), &c.triangle.after(&-j));
        prop_assert!(printed.contains(&"restitution"), "{:?}", printed);
        prop_assert!(!faults(&c, &c.edge.after(&(-0.5 * j)), &c.triangle.after(&(0.5 * j))).is_empty());
        if c.edge.inverse_mass.iter().chain(&c.triangle.inverse_mass).all(|w| *w > 0.0) {
            prop_assert!(faults(&c, &c.edge.after(&-j), &c.triangle.velocity).contains(&"momentum"));
            let beside = Collision { ends: c.ends.map(|x| x + c.normal.cross(&Vector3::new(0.3, 0.5, 0.7))), ..c };
            prop_assert!(faults(&beside, &a, &b).contains(&"angular momentum"));
        }
    }
}

#[test]
fn friction_stops_what_is_slow_and_slows_what_is_fast() {
    let floor = ContactPart {
        weights: [1.0],
        inverse_mass: [0.0],
        velocity: [Vector3::zeros()],
    };
    let slide = |along: f64| {
        let body = ContactPart {
            weights: [1.0],
            inverse_mass: [2.0],
            velocity: [Vector3::new(along, 0.0, -1.0)],
        };
        let j = impulse(
            &-Vector3::z(),
            &body,
            &floor,
            Response::new(0.0, 0.5).expect("in range"),
        )
        .expect("it falls");
        body.after(&-j)[0]
    };
    assert!((slide(0.3)).norm() <= 1e-15, "within the cone it sticks");
    assert!(
        (slide(2.0) - Vector3::new(1.5, 0.0, 0.0)).norm() <= 1e-15,
        "mu times the speed that was stopped"
    );
}
