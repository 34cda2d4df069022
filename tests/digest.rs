//! The digest of the library depends on every source file and on the lock file, and on nothing
//! else.

use std::fs;
use std::path::{Path, PathBuf};

include!("../src/digest.rs");

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of the library") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            collect(&path, files);
        } else {
            files.push(path);
        }
    }
}

/// The input of the build script: the library's sources, the lock file, the version.
fn sources() -> Vec<(String, Vec<u8>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths = Vec::new();
    collect(&root.join("src"), &mut paths);
    let lock = root.join("Cargo.lock");
    if lock.is_file() {
        paths.push(lock);
    }
    let mut files = Vec::new();
    for path in paths {
        let name = path.strip_prefix(root).expect("below the root");
        let name = name.to_str().expect("UTF-8").replace('\\', "/");
        files.push((name, fs::read(&path).expect("a file of the library")));
    }
    files.sort();
    let version = env!("CARGO_PKG_VERSION").as_bytes().to_vec();
    files.insert(0, ("version".to_owned(), version));
    files
}

fn of(files: &[(String, Vec<u8>)]) -> String {
    let named = files
        .iter()
        .map(|(name, bytes)| (name.as_str(), bytes.as_slice()));
    format!("{:032x}", digest(named))
}

#[test]
fn the_digest_is_that_of_the_sources_and_of_no_command() {
    let files = sources();
    assert_eq!(of(&files), pliant::DIGEST);
    assert!(files.iter().any(|(name, _)| name == "src/lib.rs"));
    let is_physics =
        |name: &str| name.starts_with("src/") || ["version", "Cargo.lock"].contains(&name);
    assert!(files.iter().all(|(name, _)| is_physics(name)));
}

#[test]
fn every_file_counts_and_so_does_its_name() {
    let files = sources();
    let whole = of(&files);
    for k in 0..files.len() {
        let mut changed = files.clone();
        changed[k].1.push(b' ');
        assert_ne!(of(&changed), whole, "{}", files[k].0);
    }
    let mut renamed = files.clone();
    renamed[1].0.push('x');
    assert_ne!(of(&renamed), whole);
    let mut fewer = files.clone();
    fewer.pop();
    assert_ne!(of(&fewer), whole);
    // A byte that moves from one file to the next does not change the concatenated bytes.
    let mut moved = files;
    let byte = moved[1].1.pop().expect("no empty file");
    moved[2].1.insert(0, byte);
    assert_ne!(of(&moved), whole);
}
