//! A projection agrees with the formula, conserves momentum, and has no wrong dependence (P9 to
//! P18).

use nalgebra::{Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{
    Bending, Bond, Constraint, Distance, KINDS, Project, Scalar, SweepOrder, TetrahedronVolume,
    TriangleContact, for_each_kind,
};
use pliant::constraints::{ForEachKind, Parameter, Spec};
use pliant::mesh::shapes::icosphere;
use pliant::solvers::System;
use pliant::testing::internals::constraints::{Direction, FibreDistance};
use pliant::testing::{Draw, Dual};

use crate::bodies::{batch, bits, chain, edges, elastic, finite, settings};
use crate::tolerances::{T1, T2, T3, T5, T8, T9, cases, worst};

/// The volume formula as printed: value with 1/6, gradient without (errata A06, A07).
#[derive(Clone, Copy)]
struct SixfoldVolume(TetrahedronVolume);

impl Constraint<4> for SixfoldVolume {
    const NAME: &'static str = "sixfold volume";
    fn points(&self) -> [u32; 4] {
        self.0.points
    }
    fn value<S: Scalar>(&self, x: &[Point3<S>; 4]) -> S {
        self.0.value(x)
    }
    fn value_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        self.0
            .value_and_gradient(x)
            .map(|(c, g)| (c, g.map(|g| g * 6.0)))
    }
}

impl Spec<4> for SixfoldVolume {
    const DEGREE: i32 = 3;
    const PARAMETERS: &'static [Parameter] = &[Parameter::Volume];
    fn from_parameters(points: [u32; 4], p: &[f64]) -> Self {
        Self(TetrahedronVolume::from_parameters(points, p))
    }
}

/// A distance without its second point: momentum is lost.
#[derive(Clone, Copy)]
struct OneSided(Distance);

impl Constraint<2> for OneSided {
    const NAME: &'static str = "one-sided distance";
    fn points(&self) -> [u32; 2] {
        self.0.points
    }
    fn value<S: Scalar>(&self, x: &[Point3<S>; 2]) -> S {
        self.0.value(x)
    }
    fn value_and_gradient(&self, x: &[Point3<f64>; 2]) -> Option<(f64, [Vector3<f64>; 2])> {
        self.0
            .value_and_gradient(x)
            .map(|(c, g)| (c, [g[0], Vector3::zeros()]))
    }
}

fn corners<const K: usize>(x: &[Point3<f64>]) -> [Point3<f64>; K] {
    std::array::from_fn(|k| x[k])
}

/// Value and gradient in another order of the points, compared with `sign` times those in the first order.
fn permuted<C: Constraint<K>, const K: usize>(
    (kind, other): (C, C),
    x: &[Point3<f64>],
    order: [usize; K],
    sign: f64,
) -> Result<(), String> {
    let (c, g) = kind.value_and_gradient(&corners(x)).ok_or("undefined")?;
    let (d, h) = other
        .value_and_gradient(&order.map(|k| x[k]))
        .ok_or("undefined")?;
    let duals: [Point3<Dual>; K] = std::array::from_fn(|k| x[k].map(Dual::of));
    let bound = T2 * (1.0 + kind.value(&duals).real.error);
    let steep: f64 = g.iter().map(|g| g.norm()).sum();
    let turned = worst((0..K).map(|k| (h[k] - g[order[k]] * sign).norm()));
    // 16: the gradient of a hinge divides by heights of at least a quarter.
    let ok = (d - sign * c).abs() <= bound && turned <= 16.0 * T2 * (1.0 + steep * steep);
    if ok {
        Ok(())
    } else {
        Err(format!(
            "{}: {order:?}: {c} and {d}, {g:?} and {h:?}",
            C::NAME
        ))
    }
}

/// All orders of four with their sign.
fn orders() -> Vec<([usize; 4], f64)> {
    let mut all = Vec::new();
    for code in 0..256usize {
        let o = [code & 3, code >> 2 & 3, code >> 4 & 3, code >> 6];
        if (0..4).all(|k| o.contains(&k)) {
            let swaps = (0..4)
                .flat_map(|i| (0..i).map(move |j| (j, i)))
                .filter(|&(j, i)| o[j] > o[i])
                .count();
            all.push((o, if swaps % 2 == 0 { 1.0 } else { -1.0 }));
        }
    }
    all
}

#[test]
fn p10_permuted_points_give_the_same_constraint() {
    let mut draw = Draw::new(10);
    assert_eq!(orders().len(), 24);
    for _ in 0..cases(64) {
        let x = draw.shape(4);
        let distance = Distance {
            points: [0, 1],
            rest: 0.3,
        };
        permuted((distance, distance), &x, [1, 0], 1.0).unwrap();
        let fibre = FibreDistance::new(distance, 0.6).shortened(0.2);
        permuted((fibre, fibre), &x, [1, 0], 1.0).unwrap();
        let along = Direction::from_parameters([0, 1], &draw.parameters(Direction::PARAMETERS));
        permuted((along, along), &x, [1, 0], 1.0).unwrap();
        let volume = TetrahedronVolume {
            points: [0, 1, 2, 3],
            rest: 0.0,
        };
        for (order, sign) in orders() {
            permuted((volume, volume), &x, order, sign).unwrap();
        }
        let hinge = Bending::new([0, 1, 2, 3], 0.0);
        for (order, sign) in [
            ([1, 0, 3, 2], 1.0),
            ([1, 0, 2, 3], -1.0),
            ([0, 1, 3, 2], -1.0),
        ] {
            permuted((hinge, hinge), &x, order, sign).unwrap();
        }
        let contact = TriangleContact::from_parameters(
            [0, 1, 2],
            &draw.parameters(TriangleContact::PARAMETERS),
        );
        for order in [
            [0, 1, 2],
            [1, 2, 0],
            [2, 0, 1],
            [1, 0, 2],
            [0, 2, 1],
            [2, 1, 0],
        ] {
            let other = TriangleContact {
                weights: order.map(|k| contact.weights[k]),
                ..contact
            };
            permuted((contact, other), &x, order, 1.0).unwrap();
        }
        let bond = Bond::from_parameters([0, 1, 2, 3], &draw.parameters(Bond::PARAMETERS));
        for (order, sign) in orders().into_iter().filter(|(order, _)| order[0] == 0) {
            // The other side of the triangle is the negative height.
            let other = Bond {
                weights: [1, 2, 3].map(|k| bond.weights[order[k] - 1]),
                height: sign * bond.height,
                ..bond
            };
            permuted((bond, other), &x, order, 1.0).unwrap();
        }
        // Control: the wrong sign of a permutation is detected.
        assert!(permuted((volume, volume), &x, [1, 0, 2, 3], 1.0).is_err());
        assert!(permuted((hinge, hinge), &x, [1, 0, 3, 2], -1.0).is_err());
    }
    // Anchor and plane contact have one point. A new kind must be added above.
    let known = [
        "distance",
        "fibre distance",
        "direction",
        "bending",
        "tetrahedron volume",
        "anchor",
        "plane contact",
        "triangle contact",
        "bond",
    ];
    assert_eq!(KINDS, known);
}

/// Remaining share of C = `t` after one full-stiffness projection; `None` where the kind has no
/// rest value.
fn left<C: Spec<K>, const K: usize>(
    x: &[Point3<f64>],
    w: &[f64],
    t: f64,
    draw: &mut Draw,
) -> Option<f64> {
    let is_rest =
        |p: &Parameter| matches!(p, Parameter::Length | Parameter::Angle | Parameter::Volume);
    let rest = C::PARAMETERS.iter().position(is_rest)?;
    let points = std::array::from_fn(|k| k as u32);
    let mut parameters = draw.parameters(C::PARAMETERS);
    parameters[rest] = 0.0;
    parameters[rest] = C::from_parameters(points, &parameters).value(&corners::<K>(x)) - t;
    let kind = C::from_parameters(points, &parameters);
    let mut particles = Particles::at_rest(x[..K].to_vec(), w[..K].to_vec());
    let mut one = batch(vec![kind], 0.0, SweepOrder::Stored, K);
    one.project(&mut particles, 0.01);
    assert!(finite(&particles));
    Some(kind.value(&corners::<K>(&particles.position)).abs() / t)
}

/// Median order at which the residual of one projection falls with C, minus one for the
/// division by C.
fn newton<C: Spec<K>, const K: usize>(seed: u64) -> Result<(), String> {
    let (mut slopes, mut linear) = (Vec::new(), 0);
    let count = cases(101);
    for case in 0..count {
        let mut draw = Draw::new(seed + case as u64);
        let x = draw.shape(K);
        let mut w: Vec<f64> = (0..K).map(|_| draw.decades(-1.0, 1.0)).collect();
        if K > 1 {
            w[draw.index(K)] = 0.0;
        }
        // A near-singular hinge rotates fast, so the changes must be small compared with it.
        let t = 2f64.powi(-10);
        let share = |t: f64| left::<C, K>(&x, &w, t, &mut Draw::new(seed));
        let (Some(a), Some(b)) = (share(t), share(t / 2.0)) else {
            return Ok(());
        };
        if a * t <= T1 * 8.0 {
            linear += 1;
        } else if b * t > 1e3 * T1 {
            slopes.push((a / b).log2() + 1.0);
        }
    }
    slopes.sort_by(f64::total_cmp);
    let median = slopes.get(slopes.len() / 2).copied();
    let second = median.is_some_and(|m| (m - 2.0).abs() <= T3);
    if linear == count || second {
        Ok(())
    } else {
        Err(format!("{}: {linear} linear, order {median:?}", C::NAME))
    }
}

struct Newton;
impl ForEachKind for Newton {
    fn visit<C: Spec<K>, const K: usize>(&mut self) {
        newton::<C, K>(11).unwrap();
    }
}

#[test]
fn p11_a_projection_leaves_a_residual_of_second_order() {
    for_each_kind(&mut Newton);
    // Control: the printed formula leaves 5/6 of the error.
    assert!(newton::<SixfoldVolume, 4>(11).is_err());
    let mut draw = Draw::new(11);
    let x = draw.shape(4);
    let share = left::<SixfoldVolume, 4>(&x, &[1.0; 4], 1e-6, &mut draw).expect("a rest volume");
    assert!((share - 5.0 / 6.0).abs() <= 1e-4, "left {share}");
}

#[test]
fn p12_an_update_goes_downhill_in_its_merit() {
    let mut draw = Draw::new(12);
    for case in 0..cases(500) {
        let x = vec![
            Point3::origin(),
            Point3::from(draw.direction() * draw.decades(-3.0, 3.0)),
        ];
        let w = vec![draw.decades(-3.0, 3.0), draw.decades(-3.0, 3.0)];
        let (alpha, dt) = (draw.decades(-9.0, 3.0), draw.decades(-5.0, 0.0));
        let edge = Distance {
            points: [0, 1],
            rest: (x[1] - x[0]).norm() * draw.decades(-1.0, 1.0),
        };
        let mut particles = Particles::at_rest(x.clone(), w.clone());
        let mut one = batch(vec![edge], alpha, SweepOrder::Stored, 2);
        let before = edge.value(&corners(&x));
        one.project(&mut particles, dt);
        let after = edge.value(&corners(&particles.position));
        // Elastic energy plus the inertia of the correction: the function that the update
        // minimises.
        let moved: f64 = (0..2)
            .map(|k| (particles.position[k] - x[k]).norm_squared() / w[k])
            .sum();
        let merit = |c: f64, inertia: f64| 0.5 * c * c / alpha + 0.5 * inertia / (dt * dt);
        let size = x[1].coords.norm().max(edge.rest);
        let rounding = T1 * size * (before.abs() + size * f64::EPSILON) / alpha;
        let (m0, m1) = (merit(before, 0.0), merit(after, moved));
        assert!(
            m1 <= m0 * (1.0 + T1) + rounding,
            "case {case} of seed {}: {m0} to {m1}",
            draw.seed
        );
        assert!(
            one.multipliers()[0] * before <= 0.0 && after.abs() <= before.abs() + T1 * size,
            "case {case}"
        );
    }
}

/// Sum of impulses and of their torques about the first point, relative to the sum of sizes.
fn impulse_error<C: Constraint<K>, const K: usize>(kind: C, x: &[Point3<f64>], w: &[f64]) -> f64 {
    let (_, g) = kind.value_and_gradient(&corners(x)).expect("a gradient");
    let mut one = batch(vec![kind], 0.0, SweepOrder::Stored, K);
    one.project(
        &mut Particles::at_rest(x[..K].to_vec(), w[..K].to_vec()),
        1.0,
    );
    let impulse = g.map(|g| g * one.multipliers()[0]);
    let arm = |k: usize| x[k] - x[0];
    let sizes: f64 = impulse.iter().map(|p| p.norm()).sum();
    let levers: f64 = (0..K).map(|k| arm(k).norm() * impulse[k].norm()).sum();
    let torque: Vector3<f64> = (0..K).map(|k| arm(k).cross(&impulse[k])).sum();
    worst([
        impulse.iter().sum::<Vector3<f64>>().norm() / sizes,
        torque.norm() / levers,
    ])
}

#[test]
fn p13_momentum_of_one_constraint() {
    let mut draw = Draw::new(13);
    for case in 0..cases(300) {
        let offset = Vector3::repeat(if case % 2 == 0 { 0.0 } else { 1e8 });
        let x: Vec<Point3<f64>> = draw.shape(4).iter().map(|p| p + offset).collect();
        let w: Vec<f64> = (0..4).map(|_| draw.decades(-12.0, 0.0)).collect();
        let points = [0, 1, 2, 3];
        let errors = [
            impulse_error(
                Distance {
                    points: [0, 1],
                    rest: 0.3,
                },
                &x,
                &w,
            ),
            impulse_error(Bending::new(points, 0.2), &x, &w),
            impulse_error(TetrahedronVolume { points, rest: 0.1 }, &x, &w),
            impulse_error(
                Bond {
                    points,
                    weights: [0.2, 0.3, 0.5],
                    height: 0.1,
                },
                &x,
                &w,
            ),
        ];
        assert!(
            worst(errors) <= T8,
            "case {case} of seed {}: {errors:?}",
            draw.seed
        );
        let control = impulse_error(
            OneSided(Distance {
                points: [0, 1],
                rest: 0.3,
            }),
            &x,
            &w,
        );
        assert!(!(control <= T8), "a forgotten point was accepted");
    }
}

#[test]
fn p13_momentum_of_a_sweep() {
    let mut draw = Draw::new(131);
    for offset in [0.0, 1e3, 1e8] {
        let mut mesh = icosphere(1.0, 2);
        let all = edges(&mesh);
        mesh.vertices
            .iter_mut()
            .for_each(|p| *p = *p * draw.between(0.8, 1.2) + Vector3::repeat(offset));
        let count = mesh.vertices.len();
        let mass: Vec<f64> = (0..count).map(|_| draw.decades(0.0, 12.0)).collect();
        let mut particles = Particles::at_rest(
            mesh.vertices.clone(),
            mass.iter().map(|m| 1.0 / m).collect(),
        );
        batch(all, 0.0, SweepOrder::Coloured, count).project(&mut particles, 1.0);
        let moved: Vec<Vector3<f64>> = particles
            .position
            .iter()
            .zip(&mesh.vertices)
            .zip(&mass)
            .map(|((a, b), m)| (a - b) * *m)
            .collect();
        let sum: Vector3<f64> = moved.iter().sum();
        // Each of up to six visits rounds the stored position once in each axis; the difference is exact.
        let ulp = (offset + 2.0) * f64::EPSILON;
        let bound: f64 = mass.iter().map(|m| m * 6.0 * 3.0_f64.sqrt() * ulp).sum();
        let size: f64 = moved.iter().map(|p| p.norm()).sum();
        assert!(
            sum.norm() <= bound + T8 * size,
            "offset {offset}: {} of {bound}",
            sum.norm()
        );
        assert!(
            offset > 1e3 || size > 1e3 * bound,
            "offset {offset}: the check would see nothing"
        );
    }
}

#[test]
fn p14_held_particles_keep_their_bits() {
    let mesh = icosphere(1.0, 2);
    let mut draw = Draw::new(14);
    for _ in 0..cases(8) {
        let mut system = elastic(&mesh, 0.1, [1e-6, 1e-3, 0.0], 3);
        system.settings.gravity = Vector3::new(0.0, 0.0, -9.81);
        let held: Vec<usize> = (0..20).map(|_| draw.index(mesh.vertices.len())).collect();
        held.iter()
            .for_each(|&v| system.particles.inverse_mass[v] = 0.0);
        (0..20).for_each(|_| system.step(&[], 0.01).expect("finite"));
        for &v in &held {
            assert_eq!(
                system.particles.position[v], mesh.vertices[v],
                "seed {}",
                draw.seed
            );
            assert_eq!(system.particles.velocity[v], Vector3::zeros());
        }
        let free = (0..mesh.vertices.len())
            .filter(|&v| system.particles.position[v] != mesh.vertices[v])
            .count();
        assert!(free > 100, "nothing moved: the test would show nothing");
    }
    let mut all = elastic(&mesh, 0.1, [0.0; 3], 3);
    all.particles.inverse_mass.fill(0.0);
    all.particles.position.iter_mut().for_each(|p| *p *= 1.5);
    let before = bits(&all.particles);
    all.step(&[], 0.01).expect("finite");
    assert_eq!(bits(&all.particles), before);
    assert!(
        all.elastic
            .iter()
            .all(|b| b.usage().skipped == 3 * b.len() as u64)
    );
}

#[test]
fn p15_masses_times_a_power_of_two_change_no_bit() {
    let mesh = icosphere(1.0, 1);
    let run = |factor: f64| {
        let mut system = elastic(&mesh, 0.1 * factor, [0.0; 3], 2);
        system.settings.gravity = Vector3::new(0.0, 0.0, -9.81);
        system.particles.inverse_mass[0] = 0.0;
        (0..30).for_each(|_| system.step(&[], 0.01).expect("finite"));
        bits(&system.particles)
    };
    assert_eq!(run(1.0), run(1024.0));
    assert_eq!(run(1.0), run(1.0 / 4096.0));
    assert_ne!(
        run(1.0),
        run(3.0),
        "any factor would do: the test shows nothing"
    );
}

#[test]
fn p15_a_heavy_end_stretches_less_with_more_steps() {
    let stretch = |substeps: usize| {
        let mut system = chain(17, 0.1, |i| if i == 17 { 1000.0 } else { 1.0 }, 0.0, 1);
        system.settings.gravity = Vector3::new(0.0, 0.0, -9.81);
        (0..60 * substeps).for_each(|_| {
            system
                .step(&[], 1.0 / (60.0 * substeps as f64))
                .expect("finite")
        });
        system.particles.position[17].coords.norm() / 1.7 - 1.0
    };
    let all = [1, 10, 100].map(stretch);
    assert!(
        all[0] > all[1] && all[1] > all[2] && all[2].abs() <= 0.01,
        "{all:?}"
    );
}

#[test]
fn p16_from_rigid_to_absent() {
    let (w, c, dt) = (2.0, 0.5, 0.01);
    let moved = |alpha: f64| {
        let x = vec![Point3::origin(), Point3::new(1.5, 0.0, 0.0)];
        let mut particles = Particles::at_rest(x, vec![0.0, w]);
        let mut one = batch(
            vec![Distance {
                points: [0, 1],
                rest: 1.0,
            }],
            alpha,
            SweepOrder::Stored,
            2,
        );
        (0..3).for_each(|_| one.project(&mut particles, dt));
        assert!(
            finite(&particles) && one.multipliers()[0].is_finite(),
            "compliance {alpha}"
        );
        1.5 - particles.position[1].x
    };
    let mut last = c;
    for alpha in [0.0, 1e-300, 1e-12, 1e-6, 1e-3, 1.0, 1e12, 1e300, f64::MAX] {
        let (by, soft) = (moved(alpha), (alpha / (dt * dt)).min(f64::MAX));
        // Converged in the first projection, as C is linear: w c / (w + alpha/dt^2).
        assert!(
            (by - c * (w / (w + soft))).abs() <= T1,
            "compliance {alpha}: {by}"
        );
        assert!(by <= last + T1, "not monotone at {alpha}");
        last = by;
    }
    assert_eq!(last, 0.0);
}

#[test]
fn p17_stiffness_of_xpbd_does_not_depend_on_iterations() {
    let end = |system: &mut System| {
        system.settings.gravity = Vector3::new(0.0, 0.0, -9.81);
        system.step(&[], 0.05).expect("finite");
        system.particles.position[1].z
    };
    let xpbd = |n: u32| end(&mut chain(5, 0.1, |_| 0.1, 1e-2, n));
    let pbd = |n: u32| {
        let mut system = chain(5, 0.1, |_| 0.1, 0.0, n);
        let all: Vec<Distance> = (0..5)
            .map(|i| Distance {
                points: [i, i + 1],
                rest: 0.1,
            })
            .collect();
        system.elastic[0] =
            Box::new(batch(all, 0.0, SweepOrder::Stored, 6).with_relaxation(&[0.1; 5]));
        end(&mut system)
    };
    let (few, many) = (xpbd(400), xpbd(1600));
    assert!((few - many).abs() <= T9 * 0.5, "{few} and {many}");
    assert!(
        (pbd(3) - pbd(12)).abs() > 1e-3,
        "classic stiffness should depend on iterations"
    );
}

/// End position after `time` with steps of `time / n`.
fn end(mut system: System, time: f64, n: usize) -> Vector3<f64> {
    (0..n).for_each(|_| system.step(&[], time / n as f64).expect("finite"));
    system.particles.position.last().expect("particles").coords
}

#[test]
fn p18_substeps_converge_with_order_one() {
    let spring = || {
        let mut system = chain(1, 1.0, |_| 1.0, 1.0 / 40.0, 1);
        system.particles.position[1].z = -1.2;
        system
    };
    let pendulum = || {
        let mut system = chain(1, 1.0, |_| 1.0, 0.0, 1);
        system.particles.position[1] = Point3::new(1.0, 0.0, 0.0);
        system.settings.gravity = Vector3::new(0.0, 0.0, -9.81);
        system
    };
    for (name, make) in [
        ("spring", &spring as &dyn Fn() -> System),
        ("pendulum", &pendulum),
    ] {
        let n = 400;
        let reference = end(make(), 0.7, 64 * 4 * n);
        let error = |n: usize| (end(make(), 0.7, n) - reference).norm();
        let [a, b, c] = [error(n), error(2 * n), error(4 * n)];
        assert!(c > 1e-9, "{name}: no error to measure");
        let orders = [(a / b).log2(), (b / c).log2()];
        // The reference itself has an error of 1/64 of the finest error, which raises the order
        // by the same share.
        assert!(
            worst(orders.map(|o| (o - 1.0).abs())) <= T5,
            "{name}: orders {orders:?}"
        );
    }
}

#[test]
fn p9_another_unit_of_time_changes_no_bit() {
    let mesh = icosphere(1.0, 1);
    let run = |k: i32, wrong: f64| {
        let s = 2f64.powi(k);
        let mut system = elastic(
            &mesh,
            0.1,
            [1e-5 * s * s * wrong, 1e-4 * s * s, 1e-6 * s * s],
            2,
        );
        system.settings = settings(2);
        system.settings.gravity = Vector3::new(0.3, 0.0, -9.81) / (s * s);
        system.particles.inverse_mass[3] = 0.0;
        system.forces = vec![(5, Vector3::new(0.0, 1.0, 0.0) / (s * s))];
        system
            .particles
            .velocity
            .iter_mut()
            .for_each(|v| *v = Vector3::new(0.1, 0.2, 0.0) / s);
        (0..30).for_each(|_| system.step(&[], 0.01 * s).expect("finite"));
        system.particles.velocity.iter_mut().for_each(|v| *v *= s);
        bits(&system.particles)
    };
    for k in [-12, -1, 3, 10] {
        assert_eq!(run(0, 1.0), run(k, 1.0), "2^{k}");
    }
    assert_ne!(
        run(0, 1.0),
        run(3, 1.001),
        "a compliance that does not scale must be seen"
    );
}
