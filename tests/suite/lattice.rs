//! Lattices: one step compared with a plain list of springs, equal bits for all settings of the
//! computation, the source's tables.
//!
//! The source's lattices have no units, and neither have the lattices here.

use std::collections::HashMap;

use nalgebra::{DMatrix, Vector3};

use pliant::springs::Neighbours;
use pliant::springs::lattice::{
    Lattice, LatticeError, LatticeRestSettings, LatticeSettings, LatticeShape, Stiffness,
};
use pliant::testing::Draw;
use pliant::testing::internals::simd::{Number, SimdWidth};
use pliant::testing::internals::springs::lattice::{largest_stiffness, stability_limit};

use crate::tolerances::worst;

mod plain;
mod tables;

use plain::{Plain, springs};

const ALL: [Neighbours; 3] = Neighbours::ALL;

/// Shapes whose rows are shorter than, equal to and longer than registers; sheets, chains and a
/// single point.
const SHAPES: [[usize; 3]; 11] = [
    [1, 1, 1],
    [2, 1, 1],
    [1, 6, 1],
    [1, 1, 5],
    [9, 7, 1],
    [1, 4, 5],
    [5, 5, 5],
    [8, 3, 4],
    [16, 4, 3],
    [17, 3, 2],
    [34, 4, 5],
];

fn shape(points: [usize; 3]) -> LatticeShape {
    LatticeShape {
        points,
        origin: [0.3, -0.2, 0.1],
        spacing: [0.1, 0.13, 0.07],
    }
}

fn settings(neighbours: Neighbours) -> LatticeSettings {
    let (damping, time_step) = (Some(2.0), Some(0.01));
    LatticeSettings {
        stiffness: Stiffness::Reciprocal,
        diagonal: 0.7,
        damping,
        time_step,
        ..LatticeSettings::new(neighbours)
    }
}

/// A lattice displaced randomly by up to a fifth of its least spacing. Every seventh point is
/// pinned, and forces act on some points.
fn shaken<F: Number>(points: [usize; 3], neighbours: Neighbours, width: SimdWidth) -> Lattice<F> {
    let shape = shape(points);
    let mut lattice = Lattice::<F>::new(shape, settings(neighbours))
        .expect("a stable lattice")
        .with_width(width);
    let mut draw = Draw::new(77);
    for (p, point) in shape.each().enumerate() {
        let at = Vector3::from(shape.at(point)) + draw.direction() * 0.014;
        lattice.place(point, at.into());
        if p % 7 == 3 {
            lattice.pin(point);
        }
        if p % 5 == 1 {
            lattice.set_force(point, [0.1, -0.2, 0.05]);
        }
    }
    lattice
}

fn bits<F: Number>(lattice: &Lattice<F>) -> Vec<[u64; 3]> {
    lattice
        .positions()
        .iter()
        .map(|x| x.map(f64::to_bits))
        .collect()
}

/// The largest distance between the points of a lattice and of a plain list after some steps,
/// divided by the largest coordinate.
fn apart<F: Number>(points: [usize; 3], neighbours: Neighbours, spoil: impl Fn(&mut Plain)) -> f64 {
    let mut lattice = shaken::<F>(points, neighbours, SimdWidth::best());
    let mut plain = Plain::of(&lattice);
    spoil(&mut plain);
    for _ in 0..60 {
        lattice.step().expect("a stable lattice");
        plain.step();
    }
    let size = worst(plain.current.iter().map(|x| x.amax()));
    let both = lattice.positions().into_iter().zip(&plain.current);
    worst(both.map(|(a, b)| (Vector3::from(a) - b).norm())) / size
}

/// Each step rounds positions, and each rounding error continues as a velocity: at most
/// `60^2 / 2` of them.
const DOUBLE: f64 = 1800.0 * f64::EPSILON;
const SINGLE: f64 = 1800.0 * f32::EPSILON as f64;

#[test]
fn a_step_is_that_of_a_plain_list_of_springs() {
    for points in SHAPES {
        for neighbours in ALL {
            let (double, single) = (
                apart::<f64>(points, neighbours, |_| ()),
                apart::<f32>(points, neighbours, |_| ()),
            );
            println!("{points:?} {neighbours:?}: {double:e} in f64, {single:e} in f32");
            assert!(
                double <= DOUBLE,
                "{points:?} {neighbours:?} f64: {double:e}"
            );
            assert!(
                single <= SINGLE,
                "{points:?} {neighbours:?} f32: {single:e}"
            );
        }
    }
}

#[test]
fn a_list_that_is_wrong_in_one_spring_or_one_point_is_told_apart() {
    for neighbours in ALL {
        let spoils: [fn(&mut Plain); 4] = [
            |plain| plain.springs.truncate(plain.springs.len() - 1),
            |plain| plain.springs[7].rest *= 1.02,
            |plain| plain.force[1].y = 0.0,
            |plain| plain.pinned[3] = false,
        ];
        for (which, spoil) in spoils.into_iter().enumerate() {
            let (double, single) = (
                apart::<f64>([8, 3, 4], neighbours, spoil),
                apart::<f32>([8, 3, 4], neighbours, spoil),
            );
            assert!(
                double > 100.0 * DOUBLE && single > SINGLE,
                "{neighbours:?} {which}: {double:e}, {single:e}"
            );
        }
    }
}

fn same_bits<F: Number>() {
    for neighbours in ALL {
        // The last shapes are divided into slabs of 8 planes, and of 5 with a single plane left.
        for points in [[5, 5, 5], [17, 3, 2], [9, 4, 1], [33, 20, 30], [40, 26, 31]] {
            let after = |width: SimdWidth, threads: usize, pairs: bool, spoil: bool| {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .expect("a pool");
                let mut lattice = shaken::<F>(points, neighbours, width);
                if spoil {
                    let [x, y, z] = lattice.position([0, 0, 0]);
                    lattice.place([0, 0, 0], [x + 1e-6, y, z]);
                }
                let together = if pairs { 5 } else { 1 };
                let run = |_| lattice.run(together).expect("a stable lattice");
                let moves: Vec<f64> = pool.install(|| (0..5 / together).map(run).collect());
                assert!(moves.iter().all(|m| *m > 0.0));
                bits(&lattice)
            };
            let one = after(SimdWidth::One, 1, false, false);
            for &width in SimdWidth::available() {
                for (threads, pairs) in [1, 2, 3, 8]
                    .into_iter()
                    .flat_map(|n| [(n, false), (n, true)])
                {
                    let same = after(width, threads, pairs, false) == one;
                    assert!(
                        same,
                        "{points:?} {neighbours:?} {width} {threads} threads, in pairs: {pairs}"
                    );
                }
            }
            assert!(
                after(SimdWidth::best(), 2, true, true) != one,
                "what is compared does not depend on the start"
            );
        }
    }
}

#[test]
fn threads_and_widths_leave_the_same_bits() {
    same_bits::<f32>();
    same_bits::<f64>();
}

#[test]
fn moves_of_pairs_are_those_of_single_steps() {
    for neighbours in ALL {
        for points in [[5, 5, 5], [33, 20, 30]] {
            let (mut pairs, mut single) = (
                shaken::<f64>(points, neighbours, SimdWidth::best()),
                shaken(points, neighbours, SimdWidth::best()),
            );
            for _ in 0..4 {
                let two = pairs.measured_pair().expect("stable");
                assert_eq!(
                    two,
                    [
                        single.measured_step().expect("stable"),
                        single.measured_step().expect("stable")
                    ]
                );
                assert!(two[0] > 0.0 && two[0] != two[1]);
            }
            assert_eq!((pairs.steps(), pairs.run(0)), (single.steps(), Ok(0.0)));
            let point = [1, 2, 3];
            assert_eq!(
                pairs.previous_position(point),
                single.previous_position(point)
            );
            // The run ends at the same step, whatever the position of that step in a pair.
            for quiet in [6, 7] {
                let rest = LatticeRestSettings {
                    threshold: 2e-5,
                    quiet,
                    limit: 1001,
                };
                let slowly = |lattice: &mut Lattice<f64>| {
                    let (mut step, mut last) = (0, 0);
                    while step < rest.limit && step - last < quiet {
                        step += 1;
                        last = if lattice.measured_step().expect("stable") >= rest.threshold {
                            step
                        } else {
                            last
                        };
                    }
                    (last, step - last == quiet)
                };
                let settled = pairs.until_rest(&rest).expect("stable");
                assert_eq!((settled.steps, settled.at_rest), slowly(&mut single));
                assert!(bits(&pairs) == bits(&single) && pairs.steps() == single.steps());
            }
        }
    }
}

#[test]
fn springs_are_counted() {
    assert_eq!(
        [5, 10, 100].map(|n| Neighbours::Six.springs([n; 3])),
        [300, 2700, 2_970_000]
    );
    assert_eq!(
        [5, 10, 100].map(|n| Neighbours::TwentySix.springs([n; 3])),
        [1036, 10_476, 12_731_796]
    );
    for neighbours in ALL {
        for points in SHAPES {
            assert_eq!(
                neighbours.springs(points),
                springs(&shape(points), &settings(neighbours)).len(),
                "{points:?}"
            );
        }
    }
}

/// Springs between coincident points have no direction, so no step may pull there.
#[test]
fn springs_without_length_pull_nowhere() {
    fn met<F: Number>(width: SimdWidth) -> Vec<[u64; 3]> {
        let mut lattice = shaken::<F>([18, 3, 3], Neighbours::TwentySix, width);
        let shape = *lattice.shape();
        for point in shape.each().filter(|p| p[0] < 9) {
            lattice.place(point, [0.5; 3]);
        }
        for _ in 0..20 {
            lattice.step().expect("finite positions");
        }
        assert!(lattice.positions().iter().flatten().all(|x| x.is_finite()));
        bits(&lattice)
    }
    for &width in SimdWidth::available() {
        assert!(
            met::<f32>(width) == met::<f32>(SimdWidth::One)
                && met::<f64>(width) == met::<f64>(SimdWidth::One),
            "{width}"
        );
    }
    // Two coincident points and nothing else: nothing moves, where a plain quotient would be
    // 0/0.
    let mut two =
        Lattice::<f32>::new(shape([2, 1, 1]), settings(Neighbours::Six)).expect("a stable lattice");
    two.place([1, 0, 0], two.position([0, 0, 0]));
    let start = bits(&two);
    two.step().expect("finite positions");
    assert_eq!(bits(&two), start);
}

#[test]
fn a_free_lattice_keeps_its_centre() {
    for neighbours in ALL {
        let free = LatticeSettings {
            damping: Some(0.0),
            ..settings(neighbours)
        };
        let shape = shape([6, 5, 4]);
        let mut lattice = Lattice::<f64>::new(shape, free).expect("a stable lattice");
        let mut draw = Draw::new(5);
        for point in shape.each() {
            lattice.place(
                point,
                (Vector3::from(shape.at(point)) + draw.direction() * 0.02).into(),
            );
        }
        let centre = |l: &Lattice<f64>| {
            l.positions()
                .iter()
                .map(|x| Vector3::from(*x))
                .sum::<Vector3<f64>>()
                / 120.0
        };
        let (start, first) = (centre(&lattice), lattice.positions());
        (0..500).for_each(|_| lattice.step().expect("a stable lattice"));
        let moved = (centre(&lattice) - start).norm();
        assert!(moved <= 1e-13, "{neighbours:?}: the centre went {moved:e}");
        let far = worst(
            first
                .iter()
                .zip(lattice.positions())
                .map(|(a, b)| (Vector3::from(*a) - Vector3::from(b)).norm()),
        );
        assert!(far > 1e-3, "nothing moved");
    }
}

/// A column of points hangs from its first point. Each spring is longer by the weight below it
/// divided by D.
#[test]
fn a_hanging_column_is_as_long_as_it_must_be() {
    let shape = LatticeShape {
        points: [1, 1, 12],
        origin: [0.0; 3],
        spacing: [0.1; 3],
    };
    let stiffness = Stiffness::Uniform(50.0);
    let mut hanging = Lattice::<f64>::new(
        shape,
        LatticeSettings {
            stiffness,
            ..LatticeSettings::new(Neighbours::Six)
        },
    )
    .expect("stable");
    hanging.pin([0, 0, 0]);
    shape
        .each()
        .for_each(|point| hanging.set_force(point, [0.0, 0.0, 0.02]));
    let settled = hanging
        .until_rest(&LatticeRestSettings {
            threshold: 1e-15,
            quiet: 2000,
            limit: 2_000_000,
        })
        .expect("no explosion");
    assert!(settled.at_rest, "{settled:?}");
    for k in 1..12 {
        let length = hanging.position([0, 0, k])[2] - hanging.position([0, 0, k - 1])[2];
        let exact = 0.1 + 0.02 * (12 - k) as f64 / 50.0;
        assert!(
            (length - exact).abs() <= 1e-11,
            "spring {k}: {length} instead of {exact}"
        );
    }
}

/// Distances between points separated by these steps, relative to those at rest: the largest
/// error.
fn strained(lattice: &Lattice<f64>, steps: &[[i32; 3]]) -> f64 {
    let shape = *lattice.shape();
    let known: HashMap<[usize; 3], Vector3<f64>> = shape
        .each()
        .map(|point| (point, Vector3::from(lattice.position(point))))
        .collect();
    let mut errors = Vec::new();
    for point in shape.each() {
        for step in steps {
            let other = [0, 1, 2].map(|c| (point[c] as i64 + i64::from(step[c])) as usize);
            if let Some(there) = known.get(&other) {
                let rest = (Vector3::from(shape.at(other)) - Vector3::from(shape.at(point))).norm();
                errors.push(((there - known[&point]).norm() / rest - 1.0).abs());
            }
        }
    }
    assert!(!errors.is_empty());
    worst(errors)
}

/// The source drags a corner and releases it several times.
#[test]
fn twenty_six_neighbours_return_to_shape_and_six_keep_lengths_only() {
    let dragged = |neighbours: Neighbours| {
        let mut lattice =
            Lattice::<f64>::new(LatticeShape::unit_cube(5), LatticeSettings::new(neighbours))
                .expect("stable");
        for way in [[0.9, 0.6, -0.4], [-0.3, 0.8, 0.7], [0.5, -0.9, 0.6]] {
            let at = lattice.position([4, 4, 4]);
            lattice.place([4, 4, 4], [0, 1, 2].map(|c| at[c] + way[c]));
            lattice.pin([4, 4, 4]);
            (0..200).for_each(|_| lattice.step().expect("stable"));
            lattice.release([4, 4, 4]);
            let rest = LatticeRestSettings {
                threshold: 1e-9,
                quiet: 500,
                limit: 400_000,
            };
            assert!(lattice.until_rest(&rest).expect("stable").at_rest);
        }
        lattice
    };
    let springs = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    let across = [
        [4, 4, 0],
        [4, 0, 4],
        [0, 4, 4],
        [4, -4, 0],
        [4, 4, 4],
        [4, -4, 4],
    ];
    let (six, all) = (dragged(Neighbours::Six), dragged(Neighbours::TwentySix));
    let moved = Vector3::from(all.position([0, 0, 0])) - Vector3::from(all.shape().at([0, 0, 0]));
    println!(
        "lengths, six: {:e}, across {:e}",
        strained(&six, &springs),
        strained(&six, &across)
    );
    println!(
        "lengths, all: {:e}, across {:e}; moved {}",
        strained(&all, &springs),
        strained(&all, &across),
        moved.norm()
    );
    assert!(strained(&six, &springs) <= 1e-3 && strained(&six, &across) > 0.02);
    assert!(strained(&all, &springs) <= 1e-5 && strained(&all, &across) <= 1e-5);
    assert!(moved.norm() > 0.02, "the body stayed where it was");
}

/// The largest eigenvalue of the stiffness matrix, written out.
fn exact_stiffness(shape: &LatticeShape, settings: &LatticeSettings) -> f64 {
    let mut matrix = DMatrix::<f64>::zeros(3 * shape.count(), 3 * shape.count());
    let at: Vec<_> = shape
        .each()
        .map(|point| Vector3::from(shape.at(point)))
        .collect();
    for spring in springs(shape, settings) {
        let [a, b] = spring.ends;
        let n = (at[b] - at[a]).normalize();
        let block = n * n.transpose() * spring.stiffness;
        for (p, q, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
            let mut part = matrix.fixed_view_mut::<3, 3>(3 * p, 3 * q);
            part += block * sign;
        }
    }
    matrix.symmetric_eigenvalues().max()
}

#[test]
fn the_largest_stiffness_is_the_matrix_s() {
    for neighbours in ALL {
        for points in [[5, 5, 5], [4, 3, 2], [6, 1, 3], [2, 1, 1]] {
            let (shape, settings) = (shape(points), settings(neighbours));
            let (found, exact) = (
                largest_stiffness(&shape, &settings),
                exact_stiffness(&shape, &settings),
            );
            assert!(
                (found / exact - 1.0).abs() <= 1e-3,
                "{points:?} {neighbours:?}: {found} instead of {exact}"
            );
        }
    }
    let of = |n, neighbours| {
        largest_stiffness(
            &LatticeShape::unit_cube(n),
            &LatticeSettings::new(neighbours),
        )
    };
    for (n, printed) in [(5, 14.47), (10, 35.12), (20, 75.53)] {
        assert!((of(n, Neighbours::Six) - printed).abs() <= 0.01);
    }
    for (n, printed) in [(5, 42.86), (10, 109.5)] {
        assert!(
            (of(n, Neighbours::TwentySix) / printed - 1.0).abs() <= 1e-3,
            "{}",
            of(n, Neighbours::TwentySix)
        );
    }
    // The bound of large lattices is greater than that of the smaller lattices, and close to it.
    let (small, large) = (
        of(16, Neighbours::TwentySix) / 15.0,
        of(17, Neighbours::TwentySix) / 16.0,
    );
    assert!(large >= small && large <= 1.03 * small, "{small}, {large}");
    assert_eq!(of(1, Neighbours::TwentySix), 0.0);
}

/// The growth of a small disturbance over many steps of `times` times the stability limit.
fn growth(n: usize, neighbours: Neighbours, mass: f64, times: f64) -> f64 {
    let shape = LatticeShape::unit_cube(n);
    let settings = LatticeSettings {
        mass,
        ..LatticeSettings::new(neighbours)
    };
    let limit = stability_limit(
        largest_stiffness(&shape, &settings),
        mass,
        settings.damping_estimate(&shape),
    );
    let settings = LatticeSettings {
        time_step: Some(times * limit),
        ..settings
    };
    assert_eq!(Lattice::<f64>::new(shape, settings).is_ok(), times < 1.0);
    let mut lattice = Lattice::<f64>::unchecked(shape, settings).expect("numbers that will do");
    let mut draw = Draw::new(9);
    for point in shape.each() {
        lattice.place(
            point,
            (Vector3::from(shape.at(point)) + draw.direction() * 1e-8).into(),
        );
    }
    let moves = |l: &mut Lattice<f64>, steps| {
        (0..steps)
            .map(|_| l.measured_step().expect("finite"))
            .last()
            .expect("a step")
    };
    let first = moves(&mut lattice, 1);
    moves(&mut lattice, 400) / first
}

#[test]
fn steps_explode_above_the_limit_and_not_below() {
    for (n, neighbours, mass) in [
        (5, Neighbours::Six, 0.0088),
        (5, Neighbours::TwentySix, 0.5),
        (8, Neighbours::TwentySix, 2.0),
    ] {
        let (below, above) = (
            growth(n, neighbours, mass, 0.95),
            growth(n, neighbours, mass, 1.05),
        );
        assert!(
            below <= 0.1 && above >= 10.0,
            "{n} {neighbours:?}: {below:e} below, {above:e} above"
        );
    }
    let limit = |n: usize, mass: f64| {
        let settings = LatticeSettings {
            mass,
            ..LatticeSettings::new(Neighbours::Six)
        };
        Lattice::<f32>::new(LatticeShape::unit_cube(n), settings)
            .expect("stable")
            .stability_limit()
    };
    let (five, twenty) = (limit(5, 0.0088), limit(20, 1.375e-4));
    assert!(
        (five / 0.0269 - 1.0).abs() <= 0.01 && (twenty / 0.00212 - 1.0).abs() <= 0.01,
        "{five}, {twenty}"
    );
    // No springs and no damping: any step is stable.
    assert!(stability_limit(0.0, 1.0, 0.0).is_infinite());
}

#[test]
fn an_explosion_is_an_error_and_says_when() {
    let settings = LatticeSettings {
        mass: 0.0088,
        time_step: Some(0.030),
        ..LatticeSettings::new(Neighbours::Six)
    };
    let refused =
        Lattice::<f32>::new(LatticeShape::unit_cube(5), settings).expect_err("an unstable step");
    assert!(
        matches!(refused, LatticeError::Unstable { limit, .. } if (limit - 0.0269).abs() <= 5e-4),
        "{refused}"
    );
    assert!(
        refused.to_string().contains("give a step below 2.6"),
        "{refused}"
    );
    let settings = LatticeSettings {
        time_step: Some(0.05),
        ..settings
    };
    let mut lattice = Lattice::<f32>::unchecked(LatticeShape::unit_cube(5), settings)
        .expect("numbers that will do");
    lattice.place([4, 4, 4], [0.6, 0.5, 0.5]);
    let rest = LatticeRestSettings {
        threshold: 1e-9,
        quiet: 100,
        limit: 100_000,
    };
    let error = lattice.until_rest(&rest).expect_err("an explosion");
    assert!(
        matches!(error, LatticeError::Diverged { step } if step > 10),
        "{error}"
    );
    // A pinned point without a position spoils its neighbours.
    let mut lattice = Lattice::<f64>::new(
        LatticeShape::unit_cube(5),
        LatticeSettings::new(Neighbours::Six),
    )
    .expect("stable");
    lattice.place([2, 2, 2], [f64::NAN, 0.0, 0.0]);
    assert_eq!(
        lattice.clone().step(),
        Err(LatticeError::Diverged { step: 1 })
    );
    assert_eq!(lattice.run(3), Err(LatticeError::Diverged { step: 1 }));
}

#[test]
fn bad_numbers_are_refused() {
    let good = LatticeSettings::new(Neighbours::Six);
    let cube = LatticeShape::unit_cube(3);
    let bad = |shape: LatticeShape, settings: LatticeSettings, words: &str| {
        let error = Lattice::<f32>::new(shape, settings)
            .expect_err(words)
            .to_string();
        assert!(error.contains(words), "{error} instead of {words}");
    };
    assert!(Lattice::<f32>::new(cube, good).is_ok());
    bad(
        LatticeShape {
            points: [3, 0, 3],
            ..cube
        },
        good,
        "3 x 0 x 3",
    );
    bad(
        LatticeShape {
            points: [usize::MAX, 2, 2],
            ..cube
        },
        good,
        "at most 1073741824",
    );
    bad(
        LatticeShape {
            spacing: [0.1, 0.0, 0.1],
            ..cube
        },
        good,
        "a spacing is 0e0: give a finite number above 0",
    );
    bad(
        LatticeShape {
            origin: [0.0, f64::NAN, 0.0],
            ..cube
        },
        good,
        "an origin is NaN",
    );
    bad(
        cube,
        LatticeSettings { mass: -1.0, ..good },
        "the mass is -1e0",
    );
    bad(
        cube,
        LatticeSettings {
            damping: Some(f64::INFINITY),
            ..good
        },
        "the damping is inf: give a finite number of at least 0",
    );
    bad(
        cube,
        LatticeSettings {
            time_step: Some(0.0),
            ..good
        },
        "the time step is 0e0",
    );
    bad(
        cube,
        LatticeSettings {
            diagonal: f64::NAN,
            ..good
        },
        "the factor of diagonal stiffness is NaN",
    );
    bad(
        cube,
        LatticeSettings {
            stiffness: Stiffness::Uniform(0.0),
            ..good
        },
        "the stiffness is 0e0",
    );
    let mut lattice = Lattice::<f32>::new(cube, good).expect("stable");
    let rest = LatticeRestSettings {
        threshold: 0.0,
        quiet: 1,
        limit: 1,
    };
    assert!(lattice.until_rest(&rest).is_err());
}

#[test]
fn what_is_pinned_stays_and_what_is_released_goes() {
    let mut lattice = shaken::<f32>([17, 3, 3], Neighbours::TwentySix, SimdWidth::best());
    let (held, free) = ([3, 0, 0], [4, 1, 1]);
    assert!(lattice.is_pinned(held) && !lattice.is_pinned(free));
    let before = [lattice.position(held), lattice.position(free)];
    (0..10).for_each(|_| lattice.step().expect("stable"));
    assert!(lattice.position(held) == before[0] && lattice.position(free) != before[1]);
    lattice.release(held);
    lattice.pin(free);
    let there = lattice.position(free);
    assert_eq!(lattice.previous_position(free), there);
    (0..10).for_each(|_| lattice.step().expect("stable"));
    assert!(lattice.position(held) != before[0] && lattice.position(free) == there);
    assert_eq!(lattice.steps(), 20);
}
