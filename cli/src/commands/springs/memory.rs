//! The memory of a lattice.

use super::super::failure::Failure;
use pliant::springs::Neighbours;

/// Assumed memory if the operating system does not report it [bytes].
const MEMORY: u64 = 8 << 30;

/// Memory of a point and of a spring during construction and run, including the results [bytes].
const POINT_BYTES: u64 = 640;
const SPRING_BYTES: u64 = 200;

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
pub(super) fn check(points: [usize; 3], neighbours: Neighbours) -> Result<(), Failure> {
    // A lattice has at most 2^30 points and 13 springs each: neither product overflows.
    let count = points.iter().product::<usize>() as u64;
    let needed = count * POINT_BYTES + neighbours.springs(points) as u64 * SPRING_BYTES;
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
