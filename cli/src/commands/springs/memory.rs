//! The memory of a lattice.

use super::super::failure::Failure;
use pliant::scene::LatticeScene;

/// Assumed memory if the operating system does not report it [bytes].
const MEMORY: u64 = 8 << 30;

/// Memory of a point and of a spring with a list of springs, during construction and run, including the
/// results [bytes].
const POINT_BYTES: u64 = 640;
const SPRING_BYTES: u64 = 200;

/// Memory of a spring that is shown as a line, and of a triangle of the faces [bytes].
const LINE_BYTES: u64 = 80;
const FACE_BYTES: u64 = 24;

/// Memory of a point by rows: its two positions, and what the results need of it.
const RESULT_BYTES: u64 = 140;

/// Available memory [bytes].
fn memory() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"));
    let kilobytes = line.and_then(|rest| rest.split_whitespace().next()?.parse::<u64>().ok());
    kilobytes
        .and_then(|k| k.checked_mul(1024))
        .unwrap_or(MEMORY)
}

/// Rejects a lattice that does not fit into memory.
pub(super) fn check(scene: &LatticeScene) -> Result<(), Failure> {
    let course = scene.rest.clone().unwrap_or_default();
    // A lattice has at most 2^30 points and 13 springs each: neither product overflows.
    let count = scene.points.iter().product::<usize>() as u64;
    let [nx, ny, nz] = scene.points.map(|n| n as u64);
    let springs = scene.neighbours.springs(scene.points) as u64;
    // All of a small lattice, or those of a plane.
    let [along_x, _, along_z] = scene.points;
    let of_plane = scene.neighbours.springs([along_x, 1, along_z]) as u64;
    let lines = springs.min(1_000_000).max(of_plane);
    let shown = lines * LINE_BYTES + 4 * (nx * ny + ny * nz + nz * nx) * FACE_BYTES;
    let needed = match (course.is_by_rows(), course.is_single) {
        (true, true) => count * (RESULT_BYTES + 24) + shown,
        (true, false) => count * (RESULT_BYTES + 48) + shown,
        (false, _) => count * POINT_BYTES + springs * SPRING_BYTES,
    };
    let memory = memory();
    if needed <= memory {
        return Ok(());
    }
    let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
    Err(Failure::usage(
        format!(
            "such a lattice needs {:.1} GiB of memory, {:.1} are free",
            gib(needed),
            gib(memory)
        ),
        "give another --lattice, such as 50x50x50, or --side",
    ))
}
