//! The area-median hierarchy of Monkin (2016) compared with parry's, on the same triangles in one run:
//! construction, refit for a motion, and all pairs of triangles whose boxes intersect. `--test`
//! uses small meshes.
//!
//! Both get the same boxes and must find the same pairs; otherwise nothing is reported.

mod measured;

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use measured::{compare, in_turn, key, note, quartiles, quick, result, seconds};
use nalgebra::{Point3, Vector3};
use parry3d_f64::bounding_volume::Aabb as ParryAabb;
use parry3d_f64::math::Vector as Glam;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::icosphere;
use pliant::testing::internals::springs::contact::Hierarchy;

/// The source's sheet: an n by n grid of side 1, reduced to the triangles with a vertex within
/// 0.375 of the centre.
fn region(n: u32) -> TriangleMesh {
    let at = |i: u32| f64::from(i) / f64::from(n) - 0.5;
    let vertices: Vec<_> = (0..=n)
        .flat_map(|i| (0..=n).map(move |j| Point3::new(at(i), at(j), 0.0)))
        .collect();
    let square = |a: u32| [[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]];
    let triangles = (0..n).flat_map(|i| (0..n).flat_map(move |j| square(i * (n + 1) + j)));
    let near = |v: &u32| vertices[*v as usize].coords.norm_squared() <= 0.375 * 0.375;
    TriangleMesh {
        triangles: triangles.filter(|t| t.iter().any(near)).collect(),
        vertices,
    }
}

fn bounds(mesh: &TriangleMesh, t: usize) -> ParryAabb {
    let [a, b, c] = mesh.corners(t);
    let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
    ParryAabb::new(
        Glam::new(low.x, low.y, low.z),
        Glam::new(high.x, high.y, high.z),
    )
}

/// parry's hierarchy as [`pliant::contact::Surface`] uses it.
struct Peer {
    bvh: Bvh,
    workspace: BvhWorkspace,
}

impl Peer {
    fn new(mesh: &TriangleMesh) -> Self {
        let leaves: Vec<ParryAabb> = (0..mesh.triangles.len()).map(|t| bounds(mesh, t)).collect();
        Self {
            bvh: Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves),
            workspace: BvhWorkspace::default(),
        }
    }

    fn update(&mut self, mesh: &TriangleMesh) {
        for t in 0..mesh.triangles.len() {
            self.bvh
                .insert_or_update_partially(bounds(mesh, t), t as u32, 0.0);
        }
    }

    /// Updates the boxes, and sorts the nodes.
    fn refit(&mut self, mesh: &TriangleMesh) {
        self.update(mesh);
        self.bvh.refit(&mut self.workspace);
    }

    /// Updates the boxes without sorting the nodes.
    fn refit_in_place(&mut self, mesh: &TriangleMesh) {
        self.update(mesh);
        self.bvh.refit_without_opt();
    }

    fn pairs(&self, other: &Self) -> Vec<[u32; 2]> {
        self.bvh
            .leaf_pairs(&other.bvh, |a, b| a.intersects(b))
            .map(|(s, t)| [s, t])
            .collect()
    }
}

fn pairs(one: &Hierarchy, other: &Hierarchy) -> Vec<[u32; 2]> {
    let mut found = Vec::new();
    one.pairs(other, |s, t| found.push([s, t]));
    found
}

/// Two surfaces that intersect; the first one oscillates.
struct Task {
    name: &'static str,
    frames: Vec<TriangleMesh>,
    other: TriangleMesh,
}

impl Task {
    fn new(name: &'static str, mesh: &TriangleMesh, other: TriangleMesh, wave: f64) -> Self {
        let frame = |k: u32| {
            let phase = f64::from(k) * 0.7;
            let by = |p: &Point3<f64>| {
                Vector3::new(0.0, 0.2, 1.0)
                    * (wave * libm::sin(9.0 * p.x + phase) * libm::cos(7.0 * p.y - phase))
            };
            TriangleMesh {
                vertices: mesh.vertices.iter().map(|p| p + by(p)).collect(),
                ..mesh.clone()
            }
        };
        Self {
            name,
            frames: (0..4).map(frame).collect(),
            other,
        }
    }

    /// Prints a row of the table with its numbers: ours and parry's.
    fn report(&self, what: &str, times: &[Vec<f64>; 2]) {
        compare(
            &format!("hierarchy.{}.{}", key(self.name), key(what)),
            ["ours", "parry"],
            times,
        );
        let [ours, peer] = times.clone().map(|all| quartiles(all)[1] * 1e3);
        let [low, ratio, high] =
            quartiles(times[0].iter().zip(&times[1]).map(|(a, b)| a / b).collect());
        let (own, other) = (self.frames[0].triangles.len(), self.other.triangles.len());
        println!(
            "ROW hierarchy | {}, {own} and {other} triangles | {what} | {ours:.4} | {peer:.4} | {ratio:.2}, {low:.2} to {high:.2} |",
            self.name
        );
    }

    fn measure(&self, rounds: usize) {
        let first = &self.frames[0];
        let (mut ours, mut peer) = (
            Hierarchy::new(&first.vertices, &first.triangles),
            Peer::new(first),
        );
        let (other, peer_other) = (
            Hierarchy::new(&self.other.vertices, &self.other.triangles),
            Peer::new(&self.other),
        );
        let name = |what: &str| format!("hierarchy.{}.{what}", key(self.name));
        result(&name("triangles"), first.triangles.len() as f64, "1");
        result(&name("others"), self.other.triangles.len() as f64, "1");
        let mut found = 0;
        for frame in &self.frames {
            ours.refit(&frame.vertices, &frame.triangles);
            peer.refit_in_place(frame);
            let mut both = [pairs(&ours, &other), peer.pairs(&peer_other)];
            both.iter_mut().for_each(|p| p.sort_unstable());
            assert!(
                both[0] == both[1],
                "{} and {} pairs",
                both[0].len(),
                both[1].len()
            );
            peer.refit(frame);
            let mut ordered = peer.pairs(&peer_other);
            ordered.sort_unstable();
            assert!(ordered == both[0], "what was put in order finds others");
            found += both[0].len();
        }
        assert!(found > self.frames.len() * 50, "{found} pairs");
        result(&name("pairs"), found as f64 / self.frames.len() as f64, "1");
        let build = in_turn(
            rounds.div_ceil(8),
            || drop(black_box(Hierarchy::new(&first.vertices, &first.triangles))),
            || drop(black_box(Peer::new(first))),
        );
        self.report("built", &build);
        let (mut k, mut l) = (0, 0);
        let next = |k: &mut usize| {
            *k += 1;
            &self.frames[*k % self.frames.len()]
        };
        let refit = in_turn(
            rounds,
            || {
                let frame = next(&mut k);
                ours.refit(&frame.vertices, &frame.triangles);
            },
            || peer.refit(next(&mut l)),
        );
        self.report("refitted, parry's put in order", &refit);
        let mut in_place = Peer::new(first);
        let refit = in_turn(
            rounds,
            || {
                let frame = next(&mut k);
                ours.refit(&frame.vertices, &frame.triangles);
            },
            || in_place.refit_in_place(next(&mut l)),
        );
        self.report("refitted in place", &refit);
        let last = &self.frames[3];
        ours.refit(&last.vertices, &last.triangles);
        peer.refit(last);
        let query = in_turn(
            rounds,
            || drop(black_box(pairs(&ours, &other))),
            || drop(black_box(peer.pairs(&peer_other))),
        );
        self.report("pairs", &query);
    }
}

fn moved(mesh: &TriangleMesh, by: Vector3<f64>) -> TriangleMesh {
    TriangleMesh {
        vertices: mesh.vertices.iter().map(|p| p + by).collect(),
        triangles: mesh.triangles.clone(),
    }
}

fn tasks() -> Vec<Task> {
    let (grids, balls) = if quick() {
        ([16, 32], [2, 3])
    } else {
        ([64, 256], [3, 5])
    };
    let dent = |n: u32| moved(&icosphere(0.25, n), Vector3::new(0.01, 0.02, -0.22));
    let ball = |n: u32| moved(&icosphere(0.5, n), Vector3::new(0.81, 0.13, 0.07));
    vec![
        Task::new("coarse sheet", &region(grids[0]), dent(balls[0]), 0.004),
        Task::new("fine sheet", &region(grids[1]), dent(balls[0]), 0.004),
        Task::new("balls", &icosphere(0.5, balls[1]), ball(balls[1]), 0.004),
    ]
}

/// Ours and parry's, alternately.
fn beside(_: &mut Criterion) {
    note("hierarchy.peer", "parry3d-f64 0.31");
    for task in tasks() {
        // The number of rounds in one or two seconds.
        let frame = &task.frames[0];
        let once = seconds(|| drop(black_box(Peer::new(frame))));
        task.measure(if quick() {
            3
        } else {
            ((0.5 / once) as usize).clamp(16, 400)
        });
    }
}

/// A step of the coarse sheet for criterion: refit, then all pairs.
fn follow(c: &mut Criterion) {
    let mut group = c.benchmark_group("hierarchy");
    group
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    let task = tasks().swap_remove(0);
    let frame = &task.frames[1];
    let (mut ours, mut peer) = (
        Hierarchy::new(&frame.vertices, &frame.triangles),
        Peer::new(frame),
    );
    let (other, peer_other) = (
        Hierarchy::new(&task.other.vertices, &task.other.triangles),
        Peer::new(&task.other),
    );
    let expected = pairs(&ours, &other).len();
    group.bench_function("follow and meet, ours", |b| {
        b.iter(|| {
            ours.refit(&frame.vertices, &frame.triangles);
            assert_eq!(pairs(&ours, &other).len(), expected);
        });
    });
    group.bench_function("follow and meet, parry", |b| {
        b.iter(|| {
            peer.refit(frame);
            assert_eq!(peer.pairs(&peer_other).len(), expected);
        });
    });
    group.finish();
}

criterion_group!(benches, beside, follow);
criterion_main!(benches);
