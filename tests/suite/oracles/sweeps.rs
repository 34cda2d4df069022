//! Number of sweeps for each visiting order (P41): a report, and the one claim that holds.

use nalgebra::Point3;
use pliant::Particles;
use pliant::constraints::{Batch, Distance, Project, SweepOrder};
use pliant::testing::Draw;

/// Links of the rope.
const LINKS: u32 = 40;
/// Relative errors at which sweeps are counted.
const SHARES: [f64; 3] = [1e-2, 1e-4, 1e-6];

/// Visiting orders of the links; alternating ones take turns.
fn visits() -> Vec<(&'static str, Vec<Batch<Distance, 2>>)> {
    let links: Vec<Distance> = (0..LINKS)
        .map(|i| Distance {
            points: [i, i + 1],
            rest: 1.0,
        })
        .collect();
    let make = |all: &[Distance], order: SweepOrder| {
        Batch::<Distance, 2>::new(
            all.to_vec(),
            vec![0.0; all.len()],
            order,
            LINKS as usize + 1,
            &[],
        )
    };
    let mut shuffled = links.clone();
    let mut draw = Draw::new(41);
    (1..shuffled.len())
        .rev()
        .for_each(|i| shuffled.swap(i, draw.index(i + 1)));
    let driven = make(&links, SweepOrder::Stored);
    let free = make(&links, SweepOrder::Reversed);
    vec![
        ("from the driven end", vec![driven.clone()]),
        ("from the free end", vec![free.clone()]),
        ("coloured", vec![make(&links, SweepOrder::Coloured)]),
        ("random", vec![make(&shuffled, SweepOrder::Stored)]),
        ("alternating", vec![driven, free]),
    ]
}

/// Number of sweeps until no link of a straight rope, whose fixed end is moved by 1 m, deviates by
/// more than each share of 1 m.
fn sweeps(batches: &mut [Batch<Distance, 2>], mass: &dyn Fn(u32) -> f64) -> [usize; 3] {
    let mut position: Vec<Point3<f64>> = (0..=LINKS)
        .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
        .collect();
    position[0].x -= 1.0;
    let inverse = (0..=LINKS)
        .map(|i| if i == 0 { 0.0 } else { 1.0 / mass(i) })
        .collect();
    let mut particles = Particles::at_rest(position, inverse);
    let mut count = 0;
    SHARES.map(|share| {
        loop {
            let off = particles
                .position
                .windows(2)
                .map(|x| ((x[1] - x[0]).norm() - 1.0).abs());
            let off = crate::tolerances::worst(off);
            assert!(off.is_finite(), "after {count} sweeps");
            if off <= share {
                return count;
            }
            let turn = count % batches.len();
            batches[turn].project(&mut particles, 1.0);
            count += 1;
            assert!(count < 1_000_000, "it does not converge");
        }
    })
}

#[test]
fn p41_sweeps_of_each_order() {
    type Mass = fn(u32) -> f64;
    let profiles: [(&str, Mass); 3] = [
        ("even", |_| 1.0),
        ("100 times as heavy at the free end", |i| {
            if i == LINKS { 100.0 } else { 1.0 }
        }),
        ("falling by 1.3 a link to the free end", |i| {
            1.3f64.powi(-(i as i32))
        }),
    ];
    let mut table = Vec::new();
    for (profile, mass) in profiles {
        for (order, mut batches) in visits() {
            let found = sweeps(&mut batches, &mass);
            println!(
                "| {profile} | {order} | {} | {} | {} |",
                found[0], found[1], found[2]
            );
            table.push(found);
        }
    }
    let [even, heavy, falling] = [0, 1, 2].map(|k| &table[5 * k..5 * k + 5]);
    assert!(
        falling[0][0] as f64 <= 0.8 * falling[1][0] as f64,
        "{falling:?}"
    );
    assert!(
        !(even[0][0] as f64 <= 0.8 * even[1][0] as f64),
        "control: the gain is there for any masses"
    );
    for profile in [even, heavy, falling] {
        assert!(
            profile[0][0] <= profile[2][0],
            "in turn is no faster than by colours: {profile:?}"
        );
    }
}
