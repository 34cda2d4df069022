//! A frame of a muscle beside a bone, one sweep by lanes and threads, and the growth of both
//! solvers with the mesh.
//!
//! The frame is what a run computes between two pictures: three sweeps over edges, hinges, contact and volume,
//! with and without what settles contact and volume at its end. What takes turns is printed as ratios; nothing is asserted of a time.

mod measured;

use std::time::Duration;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use measured::scene::{PRESSED, Scene};
use measured::turned::Turned;
use measured::{
    Body, compare, exponent, in_turn, pool, quick, result, seconds, volume_error, with_threads,
};
use pliant::Particles;
use pliant::constraints::SweepOrder;
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::tube;
use pliant::testing::internals::constraints::SimdWidth;

/// Sweeps after which two orders are compared.
const SWEEPS: usize = 100;

/// A frame with contact, with and without settling, and the share of each effect in the frame
/// without.
fn frame(c: &mut Criterion) {
    let mut scene = if quick() {
        Scene::new(24, 24)
    } else {
        Scene::new(88, 81)
    };
    let count = scene.mesh.vertices.len();
    assert!(
        quick() || (9_800..10_000).contains(&count),
        "{count} vertices"
    );
    let pool = pool(1);
    let whole = |scene: &mut Scene| {
        scene.step();
        scene.settle();
    };
    pool.install(|| (0..PRESSED + if quick() { 4 } else { 32 }).for_each(|_| whole(&mut scene)));
    scene.check();
    let mut group = c.benchmark_group("step");
    group
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    scene.system.clock.effects.clear();
    let (mut frames, mut time) = (0, 0.0);
    group.bench_function("a frame of three sweeps with contact, 1 thread", |b| {
        pool.install(|| {
            b.iter_custom(|count| {
                let all = seconds(|| (0..count).for_each(|_| scene.step()));
                frames += count;
                time += all;
                Duration::from_secs_f64(all)
            });
        });
    });
    let effects = scene.system.clock.effects.clone();
    group.bench_function("a frame settled at its end, 1 thread", |b| {
        pool.install(|| b.iter(|| whole(&mut scene)));
    });
    group.finish();
    scene.check();
    let mut rest = time;
    for (effect, (time, _)) in &effects {
        result(
            &format!("step.frame.{effect}"),
            time / frames as f64 * 1e3,
            "ms",
        );
        rest -= time;
    }
    result("step.frame.rest", rest / frames as f64 * 1e3, "ms");
    result("step.frame.mean", time / frames as f64 * 1e3, "ms");
}

/// Both orders satisfy the constraints equally well; widths and threads change no bit.
fn check(body: &Body) {
    let solved = |order: SweepOrder, width: SimdWidth, threads: usize| {
        with_threads(threads, || {
            let (mut all, mut particles) = (body.sweep(order, width), body.start.clone());
            all.sweep(&mut particles);
            (1..SWEEPS).for_each(|_| all.again(&mut particles));
            let off = volume_error(&body.mesh, &particles.position);
            assert!(off.abs() <= 1e-12, "volume off by {off:e}");
            (all.residuals(&particles), particles)
        })
    };
    let (stored, _) = solved(SweepOrder::Stored, SimdWidth::One, 1);
    let (coloured, one) = solved(SweepOrder::Coloured, SimdWidth::One, 1);
    for (c, s) in coloured.iter().zip(&stored) {
        assert!(
            *s > 0.0 && *c <= 1.1 * s,
            "residuals [m]: coloured {coloured:?}, stored {stored:?}"
        );
    }
    for &width in SimdWidth::available() {
        for threads in [1, 2] {
            assert!(
                solved(SweepOrder::Coloured, width, threads).1 == one,
                "other bits: {width}, {threads} threads"
            );
        }
    }
}

/// One sweep over all constraints by width, and scalar code against lanes alternately.
fn sweeps(c: &mut Criterion) {
    let body = Body::of(tube(0.25, 2.0, if quick() { 24 } else { 88 }));
    assert_eq!(body.edges.0.len(), body.hinges.0.len());
    assert!(
        quick() || body.edges.0.len() == 29_832,
        "{} edges",
        body.edges.0.len()
    );
    check(&body);
    let mut group = c.benchmark_group("sweep");
    group
        .sample_size(15)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(800));
    let pool = pool(1);
    for (name, order, widths) in [
        ("coloured", SweepOrder::Coloured, SimdWidth::available()),
        (
            "stored order",
            SweepOrder::Stored,
            &SimdWidth::available()[..1],
        ),
    ] {
        for &width in widths {
            let mut all = body.sweep(order, width);
            group.bench_function(
                format!("edges, hinges and volume, {name}, {width}, 1 thread"),
                |b| {
                    let sweep = |particles: &mut Particles| all.sweep(particles);
                    pool.install(|| {
                        b.iter_batched_ref(|| body.start.clone(), sweep, BatchSize::LargeInput)
                    });
                },
            );
        }
    }
    group.finish();
    let (mut scalar, mut lanes) = (
        body.sweep(SweepOrder::Coloured, SimdWidth::One),
        body.sweep(SweepOrder::Coloured, SimdWidth::best()),
    );
    let (mut a, mut b) = (body.start.clone(), body.start.clone());
    let times = pool.install(|| {
        in_turn(
            if quick() { 1 } else { 300 },
            || restarted(&body, &mut a, &mut scalar),
            || {
                restarted(&body, &mut b, &mut lanes);
            },
        )
    });
    assert!(a == b, "lanes left other bits");
    compare("step.sweep", ["scalar", "lanes"], &times);
    measured::note("step.sweep.width", SimdWidth::best());
}

/// A sweep from the start; its copy is a hundredth of the time.
fn restarted(body: &Body, particles: &mut Particles, all: &mut measured::Swept) {
    particles.position.copy_from_slice(&body.start.position);
    all.sweep(particles);
}

/// Two threads against one alternately, on 50,000 vertices.
fn threads(_: &mut Criterion) {
    let body = Body::of(tube(0.25, 2.0, if quick() { 24 } else { 198 }));
    assert!(
        quick() || (49_000..51_000).contains(&body.start.len()),
        "{} vertices",
        body.start.len()
    );
    let (one, two) = (pool(1), pool(2));
    for (name, width) in [
        ("step.threads.lanes", SimdWidth::best()),
        ("step.threads.scalar", SimdWidth::One),
    ] {
        let mut sets = [
            body.sweep(SweepOrder::Coloured, width),
            body.sweep(SweepOrder::Coloured, width),
        ];
        let [first, second] = &mut sets;
        let (mut a, mut b) = (body.start.clone(), body.start.clone());
        let times = in_turn(
            if quick() { 1 } else { 40 },
            || one.install(|| restarted(&body, &mut a, first)),
            || two.install(|| restarted(&body, &mut b, second)),
        );
        assert!(a == b, "two threads left other bits");
        compare(name, ["one", "two"], &times);
    }
}

/// The least time of a sweep, and of the factor and four iterations of the equilibrium, for
/// meshes of increasing size.
fn growth(_: &mut Criterion) {
    let all: &[u32] = if quick() {
        &[12, 24]
    } else {
        &[28, 62, 125, 198, 396]
    };
    let (mut sizes, mut sweeps, mut factors, mut solves) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let pool = pool(1);
    for &size in all {
        let body = Body::of(tube(0.25, 2.0, size));
        let count = body.start.len();
        let mut lanes = body.sweep(SweepOrder::Coloured, SimdWidth::best());
        let mut particles = body.start.clone();
        let rounds = if quick() {
            1
        } else {
            (2_000_000 / count).clamp(8, 300)
        };
        let least = |deed: &mut dyn FnMut() -> f64| {
            (0..rounds).map(|_| deed()).fold(f64::INFINITY, f64::min)
        };
        sweeps.push(
            pool.install(|| {
                least(&mut || seconds(|| restarted(&body, &mut particles, &mut lanes)))
            }),
        );
        let [factor, solve] = pool.install(|| equilibrium(&body.mesh));
        factors.push(factor);
        solves.push(solve);
        sizes.push(count as f64);
        result(
            &format!("step.growth.sweep.{count}"),
            sweeps[sweeps.len() - 1] * 1e3,
            "ms",
        );
        result(
            &format!("step.growth.factor.{count}"),
            factors[factors.len() - 1] * 1e3,
            "ms",
        );
        result(
            &format!("step.growth.solve.{count}"),
            solves[solves.len() - 1] * 1e3,
            "ms",
        );
    }
    let both: Vec<f64> = factors.iter().zip(&solves).map(|(a, b)| a + b).collect();
    for (name, times) in [
        ("sweep", &sweeps),
        ("factor", &factors),
        ("factor-and-solve", &both),
    ] {
        result(
            &format!("step.exponent.{name}"),
            exponent(&sizes, times),
            "1",
        );
    }
    // The slope of a known power, as a check of the exponent.
    assert!(
        (exponent(
            &sizes,
            &sizes.iter().map(|n| n.powf(1.25)).collect::<Vec<_>>()
        ) - 1.25)
            .abs()
            <= 1e-12
    );
}

/// Least time of two rounds [s], for the factor and for a solve.
fn equilibrium(mesh: &TriangleMesh) -> [f64; 2] {
    let turned = Turned::new(mesh);
    let mut least = [f64::INFINITY; 2];
    for _ in 0..2 {
        let energy = turned.energy();
        let mut solver = None;
        let factor = seconds(|| solver = Some(turned.factored(energy)));
        let mut solver = solver.expect("a solver");
        let solve = seconds(|| turned.solve(&mut solver));
        least = [least[0].min(factor), least[1].min(solve)];
    }
    least
}

criterion_group!(benches, frame, sweeps, threads, growth);
criterion_main!(benches);
