//! Time a constraint by kind, order, lanes and threads, and how it grows with the mesh.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Point3, Vector3};
use pliant::constraints::{Batch, Bending, Constraint, Distance, EnclosedVolume, Order, Project, Width};
use pliant::mesh::shapes::icosphere;
use pliant::mesh::{Topology, TriangleMesh, order};
use pliant::particles::{Packed, Particles};
use pliant::solvers::stiffness;

const DT: f64 = 1e-3;
/// Refinements of the sphere: 2,562, 10,242, 40,962 and 163,842 vertices.
const LEVELS: [u32; 4] = [4, 5, 6, 7];

struct Body {
    mesh: TriangleMesh,
    edges: (Vec<Distance>, Vec<f64>),
    hinges: (Vec<Bending>, Vec<f64>),
    start: Particles,
}

impl Body {
    /// A sphere in cache-friendly numbering, held at one end, bent and stretched by up to a twentieth.
    fn new(level: u32) -> Self {
        let sphere = icosphere(1.0, level);
        let mesh = order::apply(&sphere, &order::permutation(&Topology::new(&sphere)));
        let topology = Topology::new(&mesh);
        let bent = |p: &Point3<f64>| p + Vector3::new(0.05 * p.x, 0.05 * p.x * p.x, 0.01 * (9.0 * p.x).sin());
        let position = mesh.vertices.iter().map(bent).collect();
        let inverse_mass = mesh.vertices.iter().map(|p| if p.x < -0.98 { 0.0 } else { 1e3 }).collect();
        let (edges, edge_stiffness) = stiffness::edges(&mesh, &topology, 1e3);
        let (hinges, hinge_stiffness) = stiffness::hinges(&mesh, &topology, 1e-3);
        Self {
            edges: (edges, stiffness::compliance(&edge_stiffness)),
            hinges: (hinges, stiffness::compliance(&hinge_stiffness)),
            start: Particles::at_rest(position, inverse_mass),
            mesh,
        }
    }

    fn volume(&self, width: Width) -> EnclosedVolume {
        EnclosedVolume::new(&self.mesh.triangles, self.mesh.vertices.len(), self.mesh.volume(), 0.0).with_width(width)
    }

    fn packed(&self) -> Packed {
        let mut packed = Packed::default();
        packed.read(&self.start);
        packed
    }
}

fn batch<C: Constraint<K>, const K: usize>(
    (all, compliance): &(Vec<C>, Vec<f64>),
    order: Order,
    width: Width,
    count: usize,
) -> Batch<C, K> {
    Batch::new(all.clone(), compliance.clone(), order, count, &[]).with_width(width)
}

fn with_threads<T: Send>(threads: usize, deed: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads").install(deed)
}

/// All widths and one or two threads leave the same bits, and the sweeps bring edges and volume nearer to rest.
fn check(body: &Body) {
    let run = |width: Width, threads: usize| {
        with_threads(threads, || {
            let count = body.start.len();
            let mut particles = body.start.clone();
            let mut edges = batch(&body.edges, Order::Coloured, width, count);
            let mut hinges = batch(&body.hinges, Order::Coloured, width, count);
            let mut volume = body.volume(width);
            let before = edges.residual(&particles, DT).rms;
            for _ in 0..5 {
                edges.project(&mut particles, DT);
                hinges.project(&mut particles, DT);
                volume.project(&mut particles, DT).expect("a sphere can be inflated");
            }
            assert!(edges.residual(&particles, DT).rms < 0.5 * before);
            let moved = TriangleMesh { vertices: particles.position.clone(), triangles: body.mesh.triangles.clone() };
            assert!((moved.volume() / body.mesh.volume() - 1.0).abs() < 1e-9);
            particles
        })
    };
    let one = run(Width::One, 1);
    assert!(one.first_non_finite().is_none() && one != body.start);
    for &width in Width::available() {
        assert!(run(width, 1) == one && run(width, 2) == one, "{width}");
    }
}

/// One sweep of a batch, by name.
fn bench(c: &mut Criterion, name: &str, what: String, body: &Body, mut batch: impl Project, threads: usize) {
    let mut group = c.benchmark_group(name);
    group.sample_size(10).warm_up_time(Duration::from_millis(100)).measurement_time(Duration::from_millis(300));
    group.throughput(Throughput::Elements(batch.len() as u64));
    let start = body.packed();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
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
    let body = Body::new(5);
    check(&body);
    let count = body.start.len();
    for &width in Width::available() {
        let what = format!("coloured, {width}");
        bench(c, "edges", what.clone(), &body, batch(&body.edges, Order::Coloured, width, count), 1);
        bench(c, "hinges", what, &body, batch(&body.hinges, Order::Coloured, width, count), 1);
        let mut group = c.benchmark_group("volume");
        group.sample_size(10).warm_up_time(Duration::from_millis(100)).measurement_time(Duration::from_millis(300));
        let mut volume = body.volume(width);
        group.bench_function(width.to_string(), |b| {
            let project = |x: &mut Particles| volume.project(black_box(x), DT).expect("a sphere can be inflated");
            b.iter_batched_ref(|| body.start.clone(), project, BatchSize::LargeInput);
        });
        group.finish();
    }
    bench(c, "edges", "stored order".into(), &body, batch(&body.edges, Order::Stored, Width::One, count), 1);
    bench(c, "hinges", "stored order".into(), &body, batch(&body.hinges, Order::Stored, Width::One, count), 1);
    let large = Body::new(7);
    for threads in [1, 2] {
        let sweep = batch(&large.hinges, Order::Coloured, Width::One, large.start.len());
        bench(c, "hinges of 163,842 vertices", format!("1 lane, threads: {threads}"), &large, sweep, threads);
    }
}

/// Least time [ns a constraint] of a few sweeps.
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

/// Prints the least time a constraint for each size, and the exponent of growth from the first size to the last.
fn growth(_: &mut Criterion) {
    if std::env::args().any(|a| a == "--test") {
        return;
    }
    let bodies = LEVELS.map(Body::new);
    for &width in Width::available() {
        let edges = bodies.each_ref().map(|b| least(b, batch(&b.edges, Order::Coloured, width, b.start.len())));
        let hinges = bodies.each_ref().map(|b| least(b, batch(&b.hinges, Order::Coloured, width, b.start.len())));
        for (kind, times) in [("edges", edges), ("hinges", hinges)] {
            let sizes = bodies.each_ref().map(|b| b.start.len() as f64);
            let exponent = 1.0 + (times[3] / times[0]).ln() / (sizes[3] / sizes[0]).ln();
            println!("{kind}, {width}, ns each at {sizes:?} vertices: {times:.1?}, growth: n^{exponent:.2}");
            assert!(exponent < 1.5, "the time must go about with the size");
        }
    }
}

criterion_group!(benches, kinds, growth);
criterion_main!(benches);
