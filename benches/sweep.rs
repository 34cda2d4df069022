//! One sweep over all distance, bending and enclosed volume constraints of a closed mesh of about 10,000 vertices.

use std::hint::black_box;
use std::time::Duration;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::{Point3, Vector3};
use pliant::constraints::bending::Bending;
use pliant::constraints::distance::Distance;
use pliant::constraints::{Batch, EnclosedVolume, Order, Project};
use pliant::mesh::shapes::tube;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::particles::Particles;
use pliant::solvers::stiffness;

const DT: f64 = 1e-3;
/// Sweeps after which two orders are compared.
const SWEEPS: usize = 100;

struct Body {
    mesh: TriangleMesh,
    edges: Batch<Distance, 2>,
    hinges: Batch<Bending, 4>,
    volume: EnclosedVolume,
    start: Particles,
}

impl Body {
    /// A tube 2 m long, held at one end, bent and stretched from its rest shape by up to a twentieth.
    fn new(order: Order) -> Self {
        let mesh = tube(0.25, 2.0, 88);
        let topology = Topology::new(&mesh);
        let count = mesh.vertices.len();
        assert!((9_900..10_100).contains(&count), "{count} vertices");
        let (edges, edge_stiffness) = stiffness::edges(&mesh, &topology, 1e3);
        let (hinges, hinge_stiffness) = stiffness::hinges(&mesh, &topology, 1e-3);
        assert_eq!(edges.len(), hinges.len());
        let bent = |p: &Point3<f64>| p + Vector3::new(0.05 * p.x, 0.05 * p.x * p.x, 0.01 * (9.0 * p.x).sin());
        let position = mesh.vertices.iter().map(bent).collect();
        let inverse_mass = mesh.vertices.iter().map(|p| if p.x < -0.98 { 0.0 } else { 1e3 }).collect();
        Self {
            edges: Batch::new(edges, stiffness::compliance(&edge_stiffness), order, count, &[]),
            hinges: Batch::new(hinges, stiffness::compliance(&hinge_stiffness), order, count, &[]),
            volume: EnclosedVolume::new(&mesh.triangles, count, mesh.volume(), 0.0),
            start: Particles::at_rest(position, inverse_mass),
            mesh,
        }
    }

    fn begin(&mut self) {
        self.edges.begin_step();
        self.hinges.begin_step();
        self.volume.begin_step();
    }

    fn sweep(&mut self, particles: &mut Particles) {
        self.edges.project(particles, DT);
        self.hinges.project(particles, DT);
        self.volume.project(particles, DT).expect("a tube can be inflated");
    }

    /// Root mean square residuals of edges [m] and hinges [m] and the relative error of the volume after all sweeps.
    fn solved(&mut self) -> ([f64; 2], f64, Particles) {
        let mut particles = self.start.clone();
        self.begin();
        (0..SWEEPS).for_each(|_| self.sweep(&mut particles));
        let residuals = [self.edges.residual(&particles, DT).rms, self.hinges.residual(&particles, DT).rms];
        let moved = TriangleMesh { vertices: particles.position.clone(), triangles: self.mesh.triangles.clone() };
        (residuals, moved.volume() / self.mesh.volume() - 1.0, particles)
    }
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads")
}

/// Both orders satisfy the constraints equally well, and any number of threads gives the same bits.
fn check() {
    let (one, two) = (pool(1), pool(2));
    let (stored, volume, _) = one.install(|| Body::new(Order::Stored).solved());
    assert!(volume.abs() <= 1e-12, "stored order: volume off by {volume:e}");
    let (coloured, volume, particles) = one.install(|| Body::new(Order::Coloured).solved());
    assert!(volume.abs() <= 1e-12, "coloured order: volume off by {volume:e}");
    for (c, s) in coloured.iter().zip(&stored) {
        assert!(*s > 0.0 && *c <= 1.1 * s, "residuals [m]: coloured {coloured:?}, stored {stored:?}");
    }
    let (_, _, again) = two.install(|| Body::new(Order::Coloured).solved());
    assert!(particles.position == again.position, "two threads gave other bits");
}

fn sweeps(c: &mut Criterion) {
    check();
    let mut group = c.benchmark_group("sweep");
    group.sample_size(15).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_millis(1500));
    let runs = [
        ("coloured, 1 thread", Order::Coloured, 1),
        ("coloured, 2 threads", Order::Coloured, 2),
        ("stored, 1 thread", Order::Stored, 1),
    ];
    for (name, order, threads) in runs {
        let mut body = Body::new(order);
        let start = body.start.clone();
        let pool = pool(threads);
        let mut time = |stage: &str, deed: fn(&mut Body, &mut Particles)| {
            group.bench_function(format!("{stage}, {name}"), |b| {
                pool.install(|| {
                    b.iter_batched_ref(
                        || start.clone(),
                        |particles| deed(black_box(&mut body), particles),
                        BatchSize::PerIteration,
                    );
                });
            });
        };
        time("all", |body, x| {
            body.begin();
            body.sweep(x);
        });
        time("edges", |body, x| {
            body.edges.begin_step();
            body.edges.project(x, DT);
        });
        time("hinges", |body, x| {
            body.hinges.begin_step();
            body.hinges.project(x, DT);
        });
        time("volume", |body, x| body.volume.project(x, DT).expect("a tube can be inflated"));
    }
    group.finish();
}

criterion_group!(benches, sweeps);
criterion_main!(benches);
