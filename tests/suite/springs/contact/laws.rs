//! Laws of whole steps of bodies, and invalid bodies.

use nalgebra::{Point3, Vector3};
use pliant::mesh::{TriangleMesh, shapes};
use pliant::springs::integrators::StepError;
use pliant::springs::{SpringSystem, SystemError};
use pliant::testing::Draw;
use pliant::testing::internals::springs::contact::{
    Bodies, BodyError, CollidingBody, Drive, Response, StepContacts,
};

use super::bodies::{filled, two_balls};
use super::{moved, sphere};

/// A surface of free points: only contact changes their velocities. Masses vary over a decade.
fn loose(mesh: &TriangleMesh, draw: &mut Draw, velocity: Vector3<f64>) -> CollidingBody {
    let masses = mesh
        .vertices
        .iter()
        .map(|_| draw.decades(-4.0, -3.0))
        .collect();
    let mut system = SpringSystem::new(mesh.vertices.clone(), masses).expect("a system");
    system
        .velocity
        .iter_mut()
        .for_each(|v| *v = velocity + draw.direction() * 0.1);
    CollidingBody::soft(system, &mesh.triangles).expect("a body")
}

/// Quantities that contact conserves: energy [J], momentum, angular momentum; and magnitudes for
/// rounding.
struct Kept {
    energy: f64,
    momentum: Vector3<f64>,
    spin: Vector3<f64>,
    size: f64,
    reach: f64,
}

fn kept(all: &Bodies) -> Kept {
    let mut sum = Kept {
        energy: 0.0,
        momentum: Vector3::zeros(),
        spin: Vector3::zeros(),
        size: 0.0,
        reach: 0.0,
    };
    for s in all.bodies.iter().map(|b| &b.system) {
        for ((m, v), x) in s.mass().iter().zip(&s.velocity).zip(&s.position) {
            sum.energy += 0.5 * m * v.norm_squared();
            sum.momentum += v * *m;
            sum.spin += x.coords.cross(v) * *m;
            sum.size += m * v.norm();
            sum.reach = sum.reach.max(x.coords.norm());
        }
    }
    sum
}

/// The laws that a step violated. Friction acts at the depth of a penetrating vertex, so only
/// without friction is angular momentum conserved.
fn broken(before: &Kept, after: &Kept, e: f64, mu: f64) -> Vec<&'static str> {
    let small = 1e-13 * before.size;
    let (taken, rounding) = (before.energy - after.energy, 1e-13 * before.energy);
    let checks = [
        ("energy gained", taken >= -rounding),
        ("energy lost", !(e == 1.0 && mu == 0.0) || taken <= rounding),
        (
            "momentum",
            (after.momentum - before.momentum).norm() <= small,
        ),
        (
            "spin",
            mu > 0.0 || (after.spin - before.spin).norm() <= small * before.reach,
        ),
    ];
    checks
        .into_iter()
        .filter(|(_, holds)| !holds)
        .map(|(law, _)| law)
        .collect()
}

#[test]
fn contact_alone_gains_no_energy_and_keeps_momentum_and_spin() {
    let mut impulses = 0;
    for (seed, (e, mu)) in [
        (0.0, 0.0),
        (0.5, 0.0),
        (1.0, 0.0),
        (0.0, 0.4),
        (1.0, 0.4),
        (1.0, 5.0),
    ]
    .into_iter()
    .enumerate()
    {
        let mut draw = Draw::new(seed as u64);
        let ball = shapes::icosphere(0.01, 2);
        let one = loose(&ball, &mut draw, Vector3::x() * 0.5);
        let two = loose(
            &moved(&ball, Vector3::new(0.0203, 0.004, 0.002)),
            &mut draw,
            Vector3::x() * -0.5,
        );
        let mut all = Bodies::new(vec![one, two]);
        all.response = Response::new(e, mu).expect("in range");
        all.put_out = 0.0;
        let (mut met, begin) = (StepContacts::default(), kept(&all).energy);
        for step in 0..80 {
            let before = kept(&all);
            let found = all.step(1e-4).expect("a step");
            met.impulses += found.impulses;
            met.inside += found.inside;
            met.crossings += found.crossings;
            assert_eq!(
                broken(&before, &kept(&all), e, mu),
                Vec::<&str>::new(),
                "e {e}, mu {mu}, step {step}"
            );
        }
        assert!(
            met.impulses > 10 && met.inside > 1 && met.crossings > 50,
            "e {e}, mu {mu}: {met:?}"
        );
        impulses += met.impulses;
        let taken = 1.0 - kept(&all).energy / begin;
        assert!(
            if e == 1.0 && mu == 0.0 {
                taken.abs() <= 1e-11
            } else {
                taken > 1e-6
            },
            "{taken} taken"
        );
    }
    assert!(impulses > 200, "{impulses}");
}

#[test]
fn broken_laws_are_noticed() {
    let mut all = two_balls(0.0);
    let before = kept(&all);
    assert_eq!(broken(&before, &kept(&all), 1.0, 0.0), Vec::<&str>::new());
    // Slightly faster, slower than at the start, and rotated about the centre.
    all.bodies[0]
        .system
        .velocity
        .iter_mut()
        .for_each(|v| *v *= 1.0 + 1e-12);
    assert_eq!(
        broken(&before, &kept(&all), 1.0, 0.0),
        ["energy gained", "momentum"]
    );
    all.bodies[0]
        .system
        .velocity
        .iter_mut()
        .for_each(|v| *v *= 1.0 - 2e-12);
    assert_eq!(
        broken(&before, &kept(&all), 1.0, 0.0),
        ["energy lost", "momentum"]
    );
    let mut all = two_balls(0.0);
    let system = &mut all.bodies[0].system;
    let turn = Vector3::z() * 1e-7;
    system
        .velocity
        .iter_mut()
        .zip(&system.position)
        .for_each(|(v, x)| *v += turn.cross(&x.coords));
    assert_eq!(broken(&before, &kept(&all), 1.0, 0.0), ["spin"]);
    all.bodies[0].system.velocity[0] *= f64::NAN;
    assert_eq!(broken(&before, &kept(&all), 1.0, 0.0).len(), 4);
}

#[test]
fn many_vertices_in_one_triangle_move_it_as_far_as_the_deepest() {
    // A fine ball that penetrates two large triangles.
    let mut draw = Draw::new(3);
    let block = loose(
        &shapes::box_surface([0.1; 3], 0.1),
        &mut draw,
        Vector3::zeros(),
    );
    let ball = moved(
        &sphere(24, 23, 0.02),
        Vector3::new(0.011, 0.007, 0.05 + 0.02 - 0.003),
    );
    let mut all = Bodies::new(vec![
        block,
        CollidingBody::rigid(&ball, Drive::still()).expect("a ball"),
    ]);
    all.bodies[0]
        .system
        .velocity
        .iter_mut()
        .for_each(|v| *v = Vector3::zeros());
    let before = all.bodies[0].system.position.clone();
    let met = all.step(1e-4).expect("a step");
    let share = all.put_out;
    assert!(
        met.inside > 20 && (met.depth - 0.003).abs() <= 1e-9,
        "{met:?}"
    );
    let farthest = |all: &Bodies| {
        let now = &all.bodies[0].system.position;
        now.iter()
            .zip(&before)
            .map(|(x, from)| (x - from).norm())
            .fold(0.0, f64::max)
    };
    // A corner moves farther than the point between corners: by b/(sum b^2), which is below 1.4.
    let far = farthest(&all);
    assert!(
        far > 0.3 * share * met.depth && far <= 2.0 * share * met.depth,
        "{far}"
    );
    // Control: if each vertex moved it separately, it would move farther by their number.
    let each: f64 = ball
        .vertices
        .iter()
        .map(|p| share * (0.05 - p.z).max(0.0))
        .sum();
    assert!(each > 10.0 * far, "{each}");
    let steps = 60;
    let mut last = met.depth;
    for _ in 0..steps {
        let depth = all.step(1e-4).expect("a step").depth;
        assert!(depth <= last * (1.0 + 1e-9), "{depth} after {last}");
        last = depth;
    }
    assert!(last <= 1e-3 * met.depth, "{last}");
}

#[test]
fn what_is_put_out_keeps_the_centre_of_mass() {
    let mut draw = Draw::new(8);
    let ball = shapes::icosphere(0.01, 2);
    let mut all = Bodies::new(vec![
        loose(&ball, &mut draw, Vector3::zeros()),
        loose(
            &moved(&ball, Vector3::new(0.018, 0.002, 0.001)),
            &mut draw,
            Vector3::zeros(),
        ),
    ]);
    all.bodies.iter_mut().for_each(|b| {
        b.system
            .velocity
            .iter_mut()
            .for_each(|v| *v = Vector3::zeros())
    });
    let moment = |all: &Bodies| {
        let of = |s: &SpringSystem| {
            s.mass()
                .iter()
                .zip(&s.position)
                .map(|(m, x)| x.coords * *m)
                .sum::<Vector3<f64>>()
        };
        all.bodies
            .iter()
            .map(|b| of(&b.system))
            .sum::<Vector3<f64>>()
    };
    let total: f64 = all.bodies.iter().flat_map(|b| b.system.mass()).sum();
    let (before, first) = (moment(&all), all.step(1e-4).expect("a step"));
    let last = (0..40)
        .map(|_| all.step(1e-4).expect("a step"))
        .last()
        .expect("steps");
    assert!(
        first.inside > 4 && last.depth <= 0.01 * first.depth,
        "{first:?} {last:?}"
    );
    assert!((moment(&all) - before).norm() <= 1e-13 * total * 0.03);
    // Control: a motion of one side alone would be detected.
    all.bodies[0].system.position[0].x += 1e-9;
    assert!((moment(&all) - before).norm() > 1e-13 * total * 0.03);
}

#[test]
fn large_bodies_leave_the_same_bits_for_any_number_of_threads() {
    let mesh = shapes::icosphere(0.01, 6);
    // Below this number one thread computes forces and velocities, and nothing would be tested.
    assert!(mesh.vertices.len() >= 16_384, "{}", mesh.vertices.len());
    let run = |threads: usize, factor: f64| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| {
            let mut system = filled(&mesh, 1000.0, 50.0, 1e5);
            system.velocity.iter_mut().for_each(|v| v.x = 0.5 * factor);
            let small = moved(
                &shapes::icosphere(0.01, 2),
                Vector3::new(0.0199, 0.001, 0.0005),
            );
            let other = CollidingBody::soft(filled(&small, 1000.0, 50.0, 1e5), &small.triangles)
                .expect("a body");
            let mut all = Bodies::new(vec![
                CollidingBody::soft(system, &mesh.triangles).expect("a body"),
                other,
            ]);
            let met: usize = (0..8)
                .map(|_| all.step(2e-6).expect("a step").impulses)
                .sum();
            assert!(met > 10, "{met}");
            let bits = |b: &CollidingBody| {
                b.system
                    .position
                    .iter()
                    .flat_map(|p| p.coords.map(f64::to_bits).data.0[0])
                    .collect::<Vec<_>>()
            };
            all.bodies.iter().flat_map(bits).collect::<Vec<u64>>()
        })
    };
    let one = run(1, 1.0);
    assert!(one == run(2, 1.0) && one == run(8, 1.0));
    // Control: the last digit matters.
    assert!(one != run(1, 1.0 + f64::EPSILON));
}

#[test]
fn what_is_nowhere_is_told_and_does_not_spread() {
    type Spoil = fn(&mut SpringSystem);
    let spoil: [(&str, Spoil); 4] = [
        ("position", |s| s.position[7].y = f64::NAN),
        ("infinite", |s| s.position[7].y = f64::INFINITY),
        ("velocity", |s| s.velocity[7].z = f64::NAN),
        ("force", |s| {
            s.load = vec![Vector3::zeros(); s.len()];
            s.load[7].x = f64::NEG_INFINITY;
        }),
    ];
    for (what, spoil) in spoil {
        let mut both = two_balls(0.2);
        spoil(&mut both.bodies[1].system);
        let before = both.bodies[0].system.position.clone();
        assert_eq!(
            both.step(1e-5).err(),
            Some(StepError::NotFinite { point: 7, dt: 1e-5 }),
            "{what}"
        );
        assert_eq!(both.bodies[0].system.first_non_finite(), None, "{what}");
        assert_eq!(both.bodies[0].system.position, before, "{what}");
    }
    let mut both = two_balls(0.2);
    assert!(matches!(
        both.step(f64::NAN),
        Err(StepError::NotFinite { .. })
    ));
    let drive = Drive {
        angular: Vector3::new(f64::NAN, 0.0, 0.0),
        ..Drive::still()
    };
    let ball = CollidingBody::rigid(&shapes::icosphere(0.01, 1), drive).expect("a body");
    assert!(Bodies::new(vec![ball]).step(1e-5).is_err());
    // A NaN share removes no penetration.
    let mut both = two_balls(f64::NAN);
    (0..40).for_each(|_| assert!(both.step(1e-4).is_ok()));
}

#[test]
fn sizes_at_which_products_overflow_or_vanish_do_not_panic() {
    for size in [1e-300, 1e-160, 1e-80, 1e80, 1e160, 1e300] {
        let mesh = shapes::box_surface([size; 3], size);
        let of = |by: f64| {
            let mesh = moved(&mesh, Vector3::new(0.9, 0.3, 0.2) * (by * size));
            let count = mesh.vertices.len();
            CollidingBody::soft(
                SpringSystem::new(mesh.vertices, vec![1.0; count]).expect("a system"),
                &mesh.triangles,
            )
        };
        let mut all = Bodies::new(vec![of(0.0).expect("a body"), of(1.0).expect("a body")]);
        all.bodies[0]
            .system
            .velocity
            .iter_mut()
            .for_each(|v| v.x = size);
        // Either a step, or an error that names the point.
        let _ = all.step(0.01);
    }
}

#[test]
fn nothing_at_all_makes_steps() {
    let mut none = Bodies::new(Vec::new());
    assert_eq!(
        (none.step(1.0), none.limit()),
        (Ok(StepContacts::default()), f64::INFINITY)
    );
}

#[test]
fn bodies_that_make_no_sense_are_refused() {
    let mesh = shapes::icosphere(1.0, 0);
    let system = || SpringSystem::new(mesh.vertices.clone(), vec![1.0; 12]).expect("a system");
    assert!(matches!(
        CollidingBody::soft(system(), &[]),
        Err(BodyError::NoTriangles)
    ));
    let wrong = BodyError::OutOfRange {
        triangle: 1,
        point: 12,
        count: 12,
    };
    assert_eq!(
        CollidingBody::soft(system(), &[[0, 1, 2], [3, 12, 4]]).err(),
        Some(wrong)
    );
    for (corners, point) in [
        ([5, 5, 1], 5),
        ([1, 5, 5], 5),
        ([5, 1, 5], 5),
        ([4, 4, 4], 4),
    ] {
        let twice = BodyError::Twice { triangle: 1, point };
        assert_eq!(
            CollidingBody::soft(system(), &[[0, 1, 2], corners]).err(),
            Some(twice)
        );
    }
    let mut nowhere = system();
    nowhere.position[3].x = f64::NAN;
    let found = CollidingBody::soft(nowhere, &mesh.triangles).err();
    assert_eq!(
        found,
        Some(BodyError::System(SystemError::NotFinite { point: 3 }))
    );
    let nan = TriangleMesh {
        vertices: vec![Point3::new(f64::NAN, 0.0, 0.0); 12],
        triangles: mesh.triangles.clone(),
    };
    assert!(matches!(
        CollidingBody::rigid(&nan, Drive::still()),
        Err(BodyError::System(_))
    ));
    let mut soft = CollidingBody::soft(system(), &mesh.triangles).expect("a body");
    assert_eq!(
        (soft.set_drive(Drive::still()), soft.drive()),
        (Err(BodyError::Soft), None)
    );
    let mut rigid = CollidingBody::rigid(&mesh, Drive::still()).expect("a body");
    let on = Drive::along(Vector3::x());
    assert_eq!((rigid.set_drive(on), rigid.drive()), (Ok(()), Some(on)));
}
