//! What all targets do: the check of the crate, and the memory that it took.

use std::path::PathBuf;

use peak_alloc::PeakAlloc;
use pliant::io::{FORMATS, Format};
use pliant::testing::{check_target, seeds};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Whether the files of a target are not made larger by decompression, so that the promise about memory is one about their
/// size.
fn is_plain(target: &str) -> bool {
    let is_format = FORMATS.iter().any(|spec| spec.target == target && spec.format != Format::Vtp);
    is_format || ["springs", "pvd"].contains(&target)
}

/// Writes the small files of a target into the folder that `PLIANT_SEEDS` names, which is then its corpus.
///
/// # Panics
/// Where the folder cannot be written.
pub fn begin(target: &str) {
    let Some(folder) = std::env::var_os("PLIANT_SEEDS").map(PathBuf::from) else { return };
    for (i, seed) in seeds(target).iter().enumerate() {
        std::fs::write(folder.join(format!("seed-{i}")), seed).expect("the folder can be written");
    }
}

/// Checks bytes, and that reading took at most 64 bytes a byte and 1 MiB.
///
/// # Panics
/// Where a promise is broken: that is how a fuzzer hears of it.
pub fn run(target: &str, bytes: &[u8]) {
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let result = check_target(target, bytes);
    let used = ALLOCATOR.peak_usage().saturating_sub(before);
    if let Err(breach) = result {
        panic!("{target}: {breach}");
    }
    let allowed = 64 * bytes.len() + (1 << 20);
    assert!(!is_plain(target) || used <= allowed, "{target}: {used} bytes for a file of {}", bytes.len());
}
