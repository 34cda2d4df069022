//! Closest points of a frame in which a bone moves by 1 mm: about 10,000 muscle vertices and
//! 42,000 triangles.

mod measured;

use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Isometry3, Point3};
use pliant::Particles;
use pliant::contact::{Contacts, Obstacle, PosedObstacle, Projection, Surface};
use pliant::mesh::measures::Aabb;
use pliant::mesh::shapes::tube;
use pliant::mesh::{TriangleMesh, closest_on_triangle};

const MILLIMETRE: f64 = 1e-3;

/// A bone whose sample points are ignored. Only the closest points of the muscle's vertices
/// remain.
struct Unguarded(Arc<Surface>);

impl Obstacle for Unguarded {
    fn closest(&self, point: &Point3<f64>) -> Option<Projection> {
        self.0.closest(point)
    }

    fn closest_from(&self, point: &Point3<f64>, known: &Point3<f64>) -> Option<Projection> {
        self.0.closest_from(point, known)
    }

    fn clearance(&self, point: &Point3<f64>, known: &Point3<f64>) -> (f64, Point3<f64>) {
        self.0.clearance(point, known)
    }

    fn bounding_box(&self) -> Aabb {
        self.0.bounding_box()
    }

    fn contact_samples(&self) -> &[Point3<f64>] {
        &[]
    }

    fn bytes(&self) -> usize {
        Obstacle::bytes(&*self.0)
    }
}

/// A shaft of 42,000 triangles and a muscle of 10,000 vertices that lies along the shaft from a
/// distance of 1 mm.
struct Frames {
    bone: Arc<Surface>,
    mesh: TriangleMesh,
    start: Particles,
}

impl Frames {
    fn new() -> Self {
        let bone = tube(0.02, 0.4, 81);
        let triangles = bone.triangles.len();
        assert!(
            (41_000..43_500).contains(&triangles),
            "{triangles} triangles"
        );
        let mut mesh = tube(0.03, 0.24, 88);
        mesh.vertices.iter_mut().for_each(|p| p.y += 0.051);
        let count = mesh.vertices.len();
        assert!((9_500..10_500).contains(&count), "{count} vertices");
        let start = Particles::at_rest(mesh.vertices.clone(), vec![1.0; count]);
        Self {
            bone: Arc::new(Surface::new(&bone)),
            mesh,
            start,
        }
    }

    /// The bone during frame `k`: it moves by 1 mm along the muscle and back.
    fn placed(&self, k: usize, guarded: bool) -> [PosedObstacle; 1] {
        let at =
            |k: usize| Isometry3::translation(if k % 2 == 1 { MILLIMETRE } else { 0.0 }, 0.0, 0.0);
        let obstacle: Arc<dyn Obstacle> = if guarded {
            self.bone.clone()
        } else {
            Arc::new(Unguarded(self.bone.clone()))
        };
        [PosedObstacle {
            name: "shaft".into(),
            obstacle,
            before: at(k),
            now: at(k + 1),
        }]
    }

    fn contacts(&self, guarded: bool) -> Contacts {
        Contacts::new(
            &self.mesh,
            &self.start,
            &self.placed(0, guarded),
            vec![0],
            0.2 * MILLIMETRE,
            0.0,
        )
    }
}

/// Lookups return the result of a search of all triangles.
fn check(frames: &Frames) {
    let (x, triangles) = (frames.bone.positions(), frames.bone.triangles());
    for p in frames.mesh.vertices.iter().step_by(199) {
        let found = frames.bone.closest(p).expect("a surface").distance;
        let corners = |t: &[u32; 3]| t.map(|v| x[v as usize]);
        let distance = |t| (closest_on_triangle(p, &corners(t)) - p).norm();
        let known = triangles.iter().map(distance).fold(f64::INFINITY, f64::min);
        assert!((found - known).abs() <= 1e-12, "{found} against {known}");
    }
}

fn closest(c: &mut Criterion) {
    let frames = Frames::new();
    check(&frames);
    let mut group = c.benchmark_group("closest points");
    group
        .sample_size(15)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_millis(1500));
    let pool = measured::pool(1);
    for (guarded, name) in [
        (false, "muscle vertices"),
        (true, "muscle vertices and bone points"),
    ] {
        let mut contacts = frames.contacts(guarded);
        let placed = [frames.placed(0, guarded), frames.placed(1, guarded)];
        let mut particles = frames.start.clone();
        let mut frame = 0_u64;
        let mut step = || {
            let placed = &placed[frame as usize % 2];
            contacts.begin_step(&particles.position);
            contacts.project(placed, black_box(&mut particles));
            contacts.end_step(placed, &mut particles, 1.0);
            frame += 1;
        };
        // The first frames look up all bone points once.
        pool.install(|| (0..4).for_each(|_| step()));
        group.bench_function(format!("a frame of 1 mm, {name}, 1 thread"), |b| {
            pool.install(|| b.iter(&mut step))
        });
        let lookups = contacts.counts(&particles.position).lookups;
        measured::result(
            &format!("closest.lookups.{}", measured::key(name)),
            (lookups / frame) as f64,
            "1",
        );
        // No vertex was near enough to be pushed, so the muscle has not moved.
        assert!(
            particles.position == frames.start.position,
            "a vertex 1 mm away was moved"
        );
    }
    group.bench_function("all vertices looked up, 1 thread", |b| {
        pool.install(|| {
            b.iter(|| {
                frames
                    .start
                    .position
                    .iter()
                    .filter_map(|p| frames.bone.closest(p))
                    .map(|c| c.distance)
                    .sum::<f64>()
            });
        });
    });
    group.finish();
}

criterion_group!(benches, closest);
criterion_main!(benches);
