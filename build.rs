//! Computes the digest of the library's sources and of the lock file: `pliant::DIGEST`.

use std::error::Error;
use std::fs;
use std::path::Path;

include!("src/digest.rs");

fn main() -> Result<(), Box<dyn Error>> {
    let root = std::env::var("CARGO_MANIFEST_DIR")?;
    let root = Path::new(&root);
    let mut files = Vec::new();
    collect(root, "src", &mut files)?;
    println!("cargo:rerun-if-changed=src");
    println!("cargo:rerun-if-changed=build.rs");
    // A published crate has no lock file.
    let lock = root.join("Cargo.lock");
    if lock.is_file() {
        println!("cargo:rerun-if-changed=Cargo.lock");
        files.push(("Cargo.lock".to_owned(), fs::read(lock)?));
    }
    files.sort();
    let version = std::env::var("CARGO_PKG_VERSION")?;
    let named = files
        .iter()
        .map(|(name, bytes)| (name.as_str(), bytes.as_slice()));
    let digest = digest([("version", version.as_bytes())].into_iter().chain(named));
    println!("cargo:rustc-env=PLIANT_DIGEST={digest:032x}");
    Ok(())
}

/// All files below a folder with their paths relative to the root, separated by `/` on every
/// system.
fn collect(
    root: &Path,
    folder: &str,
    files: &mut Vec<(String, Vec<u8>)>,
) -> Result<(), Box<dyn Error>> {
    for entry in fs::read_dir(root.join(folder))? {
        let entry = entry?;
        let name = entry.file_name();
        let path = format!(
            "{folder}/{}",
            name.to_str().ok_or("a file name is not UTF-8")?
        );
        if entry.file_type()?.is_dir() {
            collect(root, &path, files)?;
        } else {
            files.push((path, fs::read(entry.path())?));
        }
    }
    Ok(())
}
