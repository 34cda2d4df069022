//! Time a constraint by kind, order, lanes and threads, and how it grows with the mesh.

mod measured;

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use measured::{
    Body, DT, batch, exponent, pool, quick, result, seconds, volume_error, with_threads,
};
use pliant::Particles;
use pliant::constraints::{Project, SweepOrder};
use pliant::mesh::Topology;
use pliant::mesh::shapes::icosphere;
use pliant::testing::internals::constraints::SimdWidth;
use pliant::testing::internals::mesh::order;

/// Refinements of the sphere: 2,562, 10,242, 40,962 and 163,842 vertices.
const LEVELS: [u32; 4] = [4, 5, 6, 7];

/// A sphere in cache-friendly numbering.
fn sphere(level: u32) -> Body {
    let sphere = icosphere(1.0, level);
    Body::of(order::apply(
        &sphere,
        &order::permutation(&Topology::new(&sphere)),
    ))
}

/// All widths and one or two threads give the same bits, and the sweeps reduce the errors of
/// edges and volume.
fn check(body: &Body) {
    let run = |width: SimdWidth, threads: usize| {
        with_threads(threads, || {
            let count = body.start.len();
            let mut particles = body.start.clone();
            let mut edges = batch(&body.edges, SweepOrder::Coloured, width, count);
            let mut hinges = batch(&body.hinges, SweepOrder::Coloured, width, count);
            let mut volume = body.volume(width);
            let before = edges.residual(&particles, DT).rms;
            for _ in 0..5 {
                edges.project(&mut particles, DT);
                hinges.project(&mut particles, DT);
                volume
                    .project(&mut particles, DT)
                    .expect("a sphere can be inflated");
            }
            assert!(edges.residual(&particles, DT).rms < 0.5 * before);
            assert!(volume_error(&body.mesh, &particles.position).abs() < 1e-9);
            particles
        })
    };
    let one = run(SimdWidth::One, 1);
    assert!(one.first_non_finite().is_none() && one != body.start);
    for &width in SimdWidth::available() {
        assert!(run(width, 1) == one && run(width, 2) == one, "{width}");
    }
}

/// One sweep of a batch, by name.
fn bench(
    c: &mut Criterion,
    name: &str,
    what: String,
    body: &Body,
    mut batch: impl Project,
    threads: usize,
) {
    let mut group = c.benchmark_group(name);
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(100))
        .measurement_time(Duration::from_millis(300));
    group.throughput(Throughput::Elements(batch.len() as u64));
    let start = body.packed();
    let pool = pool(threads);
    group.bench_function(BenchmarkId::from_parameter(what), |b| {
        pool.install(|| {
            b.iter_batched_ref(
                || start.clone(),
                |packed| {
                    batch.begin_step();
                    batch.project_packed(black_box(packed), DT);
                },
                BatchSize::LargeInput,
            );
        });
    });
    group.finish();
}

fn kinds(c: &mut Criterion) {
    let body = sphere(5);
    check(&body);
    let count = body.start.len();
    for &width in SimdWidth::available() {
        let what = format!("coloured, {width}");
        bench(
            c,
            "edges",
            what.clone(),
            &body,
            batch(&body.edges, SweepOrder::Coloured, width, count),
            1,
        );
        bench(
            c,
            "hinges",
            what,
            &body,
            batch(&body.hinges, SweepOrder::Coloured, width, count),
            1,
        );
        let mut group = c.benchmark_group("volume");
        group
            .sample_size(10)
            .warm_up_time(Duration::from_millis(100))
            .measurement_time(Duration::from_millis(300));
        let mut volume = body.volume(width);
        group.bench_function(width.to_string(), |b| {
            let project = |x: &mut Particles| {
                volume
                    .project(black_box(x), DT)
                    .expect("a sphere can be inflated")
            };
            b.iter_batched_ref(|| body.start.clone(), project, BatchSize::LargeInput);
        });
        group.finish();
    }
    bench(
        c,
        "edges",
        "stored order".into(),
        &body,
        batch(&body.edges, SweepOrder::Stored, SimdWidth::One, count),
        1,
    );
    bench(
        c,
        "hinges",
        "stored order".into(),
        &body,
        batch(&body.hinges, SweepOrder::Stored, SimdWidth::One, count),
        1,
    );
    let large = sphere(7);
    for threads in [1, 2] {
        let sweep = batch(
            &large.hinges,
            SweepOrder::Coloured,
            SimdWidth::One,
            large.start.len(),
        );
        bench(
            c,
            "hinges of 163,842 vertices",
            format!("1 lane, threads: {threads}"),
            &large,
            sweep,
            threads,
        );
    }
}

/// Least time [ns per constraint] of a few sweeps.
fn least(body: &Body, mut batch: impl Project) -> f64 {
    let start = body.packed();
    let mut packed = start.clone();
    let mut least = f64::INFINITY;
    for _ in 0..(2_000_000 / batch.len()).max(8) {
        packed.clone_from(&start);
        batch.begin_step();
        let begin = Instant::now();
        batch.project_packed(black_box(&mut packed), DT);
        least = least.min(begin.elapsed().as_secs_f64());
    }
    least * 1e9 / batch.len() as f64
}

/// Least time [s] of some projections of a volume.
fn least_of_volume(body: &Body, width: SimdWidth) -> f64 {
    let mut volume = body.volume(width);
    let mut particles = body.start.clone();
    let mut once = || {
        particles.position.copy_from_slice(&body.start.position);
        seconds(|| {
            volume
                .project(black_box(&mut particles), DT)
                .expect("a sphere can be inflated")
        })
    };
    (0..200).map(|_| once()).fold(f64::INFINITY, f64::min)
}

/// Prints the least time per constraint for each size, and the exponent of growth of the time
/// of a sweep.
fn growth(_: &mut Criterion) {
    if quick() {
        return;
    }
    let bodies = LEVELS.map(sphere);
    let sizes = bodies.each_ref().map(|b| b.start.len() as f64);
    for &width in SimdWidth::available() {
        let name = measured::key(&width.to_string());
        result(
            &format!("constraints.volume.{name}.{}", sizes[1]),
            least_of_volume(&bodies[1], width) * 1e3,
            "ms",
        );
        let edges = bodies.each_ref().map(|b| {
            least(
                b,
                batch(&b.edges, SweepOrder::Coloured, width, b.start.len()),
            )
        });
        let hinges = bodies.each_ref().map(|b| {
            least(
                b,
                batch(&b.hinges, SweepOrder::Coloured, width, b.start.len()),
            )
        });
        for (kind, times) in [("edge", edges), ("hinge", hinges)] {
            let name = format!("constraints.{kind}.{name}");
            for (size, time) in sizes.iter().zip(times) {
                result(&format!("{name}.{size}"), time, "ns");
            }
            let whole: Vec<f64> = sizes.iter().zip(times).map(|(n, t)| n * t).collect();
            let exponent = exponent(&sizes, &whole);
            result(&format!("{name}.exponent"), exponent, "1");
            assert!(exponent < 1.5, "the time must go about with the size");
        }
    }
}

criterion_group!(benches, kinds, growth);
criterion_main!(benches);
