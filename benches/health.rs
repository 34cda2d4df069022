//! Examination, repair and inside tests of a dirty surface of 20,000 triangles.

mod measured;

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Point3;
use pliant::mesh::shapes::icosphere;
use pliant::mesh::{Health, Inside, RepairOptions, TriangleMesh, deviation, repair};
use pliant::testing::Draw;
use pliant::testing::internals::mesh::{WindingTree, winding_number_direct};

/// A sphere with holes, reversed triangles, duplicates and triangles with their own vertices.
fn dirty() -> TriangleMesh {
    let mut mesh = icosphere(1.0, 5);
    let count = mesh.triangles.len();
    for t in (0..count).step_by(50) {
        match t / 50 % 3 {
            0 => mesh.triangles[t].swap(0, 1),
            1 => mesh.triangles.push(mesh.triangles[t]),
            _ => {
                let next = mesh.vertices.len() as u32;
                mesh.vertices.extend(mesh.corners(t));
                mesh.triangles[t] = [next, next + 1, next + 2];
            }
        }
    }
    mesh.triangles.drain(10_000..10_003);
    mesh
}

/// Query points near the surface for the inside test.
fn points(count: usize) -> Vec<Point3<f64>> {
    let mut draw = Draw::new(3);
    (0..count)
        .map(|_| (draw.direction() * draw.between(0.9, 1.1)).into())
        .collect()
}

fn health(c: &mut Criterion) {
    let mesh = dirty();
    let mut group = c.benchmark_group("health");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    let pool = measured::pool(1);
    let sick = Health::of(&mesh);
    assert!(!sick.is_fit() && sick.self_intersections_complete);
    group.bench_function("examined, 1 thread", |b| {
        pool.install(|| b.iter(|| Health::of(black_box(&mesh))))
    });
    let options = RepairOptions {
        close_holes: 20,
        ..RepairOptions::default()
    };
    let mended = repair(&mesh, &[], &options).mesh;
    assert!(Health::of(&mended).is_fit());
    group.bench_function("repaired, 1 thread", |b| {
        pool.install(|| b.iter(|| repair(black_box(&mesh), &[], &options)))
    });
    let away = deviation(&mesh, &mended);
    assert!(away.lost.is_some_and(|d| d <= 1e-12), "{away:?}");
    group.bench_function("distance before and after, 1 thread", |b| {
        pool.install(|| b.iter(|| deviation(black_box(&mesh), &mended)));
    });
    group.finish();
}

fn winding(c: &mut Criterion) {
    let (mesh, closed) = (dirty(), icosphere(1.0, 5));
    let (all, few) = (points(1000), points(20));
    let tree = WindingTree::new(&mesh);
    let worst = few
        .iter()
        .map(|p| (tree.number(p) - winding_number_direct(&mesh, p)).abs());
    assert!(
        worst.into_iter().all(|d| d <= 1e-11),
        "the tree sums something else"
    );
    let inside = Inside::new(&closed.vertices, &closed.triangles);
    let exact = WindingTree::new(&closed);
    let agree = |p: &Point3<f64>| (exact.number(p).round() as i32) == inside.winding(p);
    assert!(
        all.iter().all(agree),
        "two ways to tell inside from outside disagree"
    );
    let mut group = c.benchmark_group("winding numbers, 20,000 triangles");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    group.bench_function("dirty: the tree is built", |b| {
        b.iter(|| WindingTree::new(black_box(&mesh)))
    });
    group.bench_function("dirty: 1000 points by the tree", |b| {
        b.iter(|| all.iter().map(|p| tree.number(black_box(p))).sum::<f64>());
    });
    group.bench_function("dirty: 20 points by the plain sum", |b| {
        b.iter(|| {
            few.iter()
                .map(|p| winding_number_direct(black_box(&mesh), p))
                .sum::<f64>()
        });
    });
    group.bench_function("closed: 1000 points by exact crossings", |b| {
        b.iter(|| {
            all.iter()
                .map(|p| inside.winding(black_box(p)))
                .sum::<i32>()
        });
    });
    group.finish();
}

criterion_group!(benches, health, winding);
criterion_main!(benches);
