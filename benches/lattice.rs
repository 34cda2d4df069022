//! One step of a spring lattice: every size of the source's tables 7.1 and 7.2, both patterns,
//! both precisions, one and two threads; the share of the memory's speed; steps until rest.
//!
//! Least times of many steps, made in pairs as by `Lattice::run`; for the largest lattices also
//! of single steps. Every lattice moves, and its positions are checked before and after.

mod measured;

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use measured::{key, pool, quick, result, seconds};
use pliant::springs::Neighbours;
use pliant::springs::lattice::{Lattice, LatticeRestSettings, LatticeSettings, LatticeShape};
use pliant::testing::internals::constraints::SimdWidth;
use pliant::testing::internals::simd::Number;

/// Tables 7.1 and 7.2 of the source: points along a side, and milliseconds a step for 6 and for 26 neighbours, on the
/// processor (Core 2 Quad, 2.4 GHz) and on the better of its two programs for the graphics card (GeForce 9600 GT).
const SOURCE: [(usize, [[f64; 2]; 2]); 10] = [
    (10, [[0.25, 0.35], [0.83, 0.28]]),
    (20, [[2.13, 0.57], [7.52, 1.22]]),
    (30, [[7.58, 1.1], [25.61, 3.82]]),
    (40, [[17.64, 1.77], [61.94, 8.46]]),
    (50, [[34.47, 3.6], [124.36, 19.1]]),
    (60, [[59.42, 5.31], [215.06, 33.35]]),
    (70, [[94.61, 11.32], [344.3, 53.21]]),
    (80, [[141.34, 18.44], [493.94, f64::NAN]]),
    (90, [[203.69, 25.65], [683.57, f64::NAN]]),
    (100, [[274.12, 31.57], [907.32, f64::NAN]]),
];

/// A cube whose points are displaced randomly by up to a fortieth of their distance.
fn shaken<F: Number>(n: usize, neighbours: Neighbours) -> Lattice<F> {
    let shape = LatticeShape::unit_cube(n);
    let mut lattice =
        Lattice::<F>::new(shape, LatticeSettings::new(neighbours)).expect("a stable lattice");
    for (p, point) in shape.each().enumerate() {
        let by = |prime: usize| ((p * prime) % 1009) as f64 / 1009.0 - 0.5;
        let [x, y, z] = shape.at(point);
        let h = 0.05 * shape.spacing[0];
        lattice.place(
            point,
            [x + h * by(7919), y + h * by(104_729), z + h * by(1_299_709)],
        );
    }
    lattice
}

/// Least seconds per step, made alone or in pairs. Afterwards the lattice must be in place and
/// must have moved.
fn least<F: Number>(n: usize, neighbours: Neighbours, threads: usize, together: u64) -> f64 {
    let mut lattice = shaken::<F>(n, neighbours);
    let rounds = if quick() {
        3
    } else {
        (100_000_000 / n.pow(3)).clamp(60, 2000)
    };
    let start = lattice.positions();
    let time = pool(threads).install(|| {
        let mut largest = 0.0;
        let steps = |_| {
            seconds(|| largest = lattice.run(together).expect("a stable lattice")) / together as f64
        };
        (0..rounds).map(steps).fold(f64::INFINITY, f64::min)
    });
    let shape = *lattice.shape();
    let (mut off, mut moved) = (0.0, 0.0);
    for (point, (a, b)) in shape.each().zip(lattice.positions().iter().zip(&start)) {
        let rest = shape.at(point);
        let distance =
            |p: &[f64; 3], q: &[f64; 3]| (0..3).map(|c| (p[c] - q[c]).abs()).sum::<f64>();
        off += distance(a, &rest);
        moved += distance(a, b);
    }
    let mean = |sum: f64| sum / shape.count() as f64 / shape.spacing[0];
    assert!(
        mean(off) <= 0.1 && mean(moved) >= 1e-3,
        "off by {}, moved by {}",
        mean(off),
        mean(moved)
    );
    time
}

/// Bytes per second of a copy of arrays larger than every cache, reads and writes both counted:
/// the upper limit of a step.
fn copying() -> f64 {
    let from = vec![1.0_f64; if quick() { 1 << 16 } else { 48 << 20 }];
    let mut to = vec![0.0_f64; from.len()];
    let copy = |_| seconds(|| black_box(&mut to).copy_from_slice(black_box(&from)));
    let least = (0..if quick() { 2 } else { 12 })
        .map(copy)
        .fold(f64::INFINITY, f64::min);
    assert_eq!(to[from.len() - 1], 1.0);
    16.0 * from.len() as f64 / least
}

/// The source's tables beside the results of this crate.
fn sizes(_: &mut Criterion) {
    let bandwidth = copying();
    result("lattice.copy", bandwidth / 1e9, "GB/s");
    measured::note("lattice.width", SimdWidth::best());
    let all = if quick() { &SOURCE[..2] } else { &SOURCE[..] };
    for (which, neighbours, name) in [
        (0, Neighbours::Six, "six"),
        (1, Neighbours::TwentySix, "twenty-six"),
    ] {
        for (n, source) in all {
            let [cpu, gpu] = source[which];
            let [single, single_2] =
                [1, 2].map(|threads| least::<f32>(*n, neighbours, threads, 2) * 1e3);
            let [double, double_2] =
                [1, 2].map(|threads| least::<f64>(*n, neighbours, threads, 2) * 1e3);
            let gpu = if gpu.is_nan() {
                "–".to_owned()
            } else {
                format!("{gpu}")
            };
            let ours = [single, single_2, double, double_2]
                .map(|ms| format!("{ms:.3}"))
                .join(" | ");
            println!(
                "ROW lattice.{name} | {n}^3 | {cpu} | {gpu} | {ours} | {:.0} |",
                cpu / single
            );
            if *n == 100 || quick() && *n == 20 {
                let points = n.pow(3) as f64;
                for (kind, ms, bytes) in [
                    ("f32.1", single, 4.0),
                    ("f32.2", single_2, 4.0),
                    ("f64.1", double, 8.0),
                    ("f64.2", double_2, 8.0),
                ] {
                    result(&format!("lattice.{name}.{kind}"), ms, "ms");
                    let springs = neighbours.springs([*n; 3]) as f64;
                    result(
                        &format!("lattice.{name}.{kind}.spring"),
                        ms * 1e6 / springs,
                        "ns",
                    );
                    // Two steps read and write three numbers of both positions each.
                    let share = 12.0 / 2.0 * bytes * points / (ms * 1e-3) / bandwidth;
                    result(&format!("lattice.{name}.{kind}.share"), share, "1");
                }
                for (kind, ms) in [
                    ("f32.1", least::<f32>(*n, neighbours, 1, 1) * 1e3),
                    ("f32.2", least::<f32>(*n, neighbours, 2, 1) * 1e3),
                    ("f64.1", least::<f64>(*n, neighbours, 1, 1) * 1e3),
                    ("f64.2", least::<f64>(*n, neighbours, 2, 1) * 1e3),
                ] {
                    result(&format!("lattice.{name}.{kind}.alone"), ms, "ms");
                }
            }
        }
    }
}

/// Two steps of the largest lattice as criterion sees it, and 5^3 points until they rest.
fn steps(c: &mut Criterion) {
    let mut group = c.benchmark_group("lattice");
    group
        .sample_size(15)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    let n = if quick() { 20 } else { 100 };
    for neighbours in [Neighbours::Six, Neighbours::TwentySix] {
        let mut lattice = shaken::<f32>(n, neighbours);
        let name = key(&format!("{neighbours:?} f32 two steps 1 thread"));
        group.bench_function(&name, |b| {
            pool(1).install(|| b.iter(|| lattice.measured_pair().expect("a stable lattice")));
        });
    }
    group.bench_function("until rest", |b| {
        b.iter(|| {
            let settings = LatticeSettings {
                mass: 1.0,
                damping: Some(4.9),
                time_step: Some(0.01),
                ..LatticeSettings::new(Neighbours::Six)
            };
            let mut lattice = Lattice::<f64>::new(LatticeShape::unit_cube(5), settings)
                .expect("a stable lattice");
            let shape = *lattice.shape();
            for point in shape.each().filter(|&point| shape.on_surface(point)) {
                lattice.place(point, shape.at(point).map(|x| 0.98 * x));
                lattice.pin(point);
            }
            let rest = LatticeRestSettings {
                threshold: 6.3e-7,
                quiet: 300,
                limit: 10_000,
            };
            let settled = lattice.until_rest(&rest).expect("no explosion");
            assert!(
                settled.at_rest && settled.steps.abs_diff(223) <= 5,
                "{settled:?}"
            );
        });
    });
    group.finish();
}

criterion_group!(benches, sizes, steps);
criterion_main!(benches);
