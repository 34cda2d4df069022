//! Bytes per second of each reader on one thread, and the growth of its time with the size of the
//! file.

#[path = "files.rs"]
mod files;
#[path = "../measured/mod.rs"]
mod measured;

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use files::{File, Torus};
use pliant::io::read_bytes;

/// Sides of the tori: 12,482, 49,928 and 199,712 triangles.
const SIDES: [usize; 3] = [79, 158, 316];

/// Greatest ratio of the times per byte for 16 times the size that counts as linear.
const LINEAR: f64 = 3.0;

/// The time to read a file [s]; the result must match the file.
fn seconds(file: &File) -> f64 {
    let begin = Instant::now();
    let found = read_bytes(black_box(&file.bytes), "").expect("a mesh");
    let time = begin.elapsed().as_secs_f64();
    assert_eq!(
        (found.mesh.vertices.len(), found.mesh.triangles.len()),
        (file.vertices, file.triangles),
        "{}",
        file.name
    );
    time
}

fn read(c: &mut Criterion) {
    let mut group = c.benchmark_group("read");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(1000));
    for file in Torus::new(SIDES[2]).files() {
        group.throughput(Throughput::Bytes(file.bytes.len() as u64));
        seconds(&file);
        group.bench_function(file.name, |b| {
            b.iter(|| read_bytes(black_box(&file.bytes), "").expect("a mesh"))
        });
    }
    group.finish();
}

/// Nanoseconds per byte at three sizes, the best of several readings each, and the ratio of the
/// last to the first.
fn linear(_: &mut Criterion) {
    let rounds = if measured::quick() { 1 } else { 7 };
    let sizes = SIDES.map(|side| Torus::new(side).files());
    for (i, file) in sizes[0].iter().enumerate() {
        let times = [0, 1, 2].map(|k| {
            let file = &sizes[k][i];
            let best = (0..rounds)
                .map(|_| seconds(file))
                .fold(f64::INFINITY, f64::min);
            best / file.bytes.len() as f64 * 1e9
        });
        let ratio = times[2] / times[0];
        let [a, b, c] = times;
        let verdict = if ratio <= LINEAR { "" } else { " NOT LINEAR" };
        let speed = 1e3 / c;
        println!(
            "ROW read.files | {} | {speed:.0} | {a:.2}, {b:.2}, {c:.2} | {ratio:.2}{verdict} |",
            file.name
        );
    }
}

criterion_group!(benches, read, linear);
criterion_main!(benches);
