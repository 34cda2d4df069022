//! The tests of the package in Python, on the library that this build has made. They say skipped where
//! Python or one of its packages is missing.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Packages without which nothing can be tested.
const NEEDED: &str = "import numpy, pytest";

/// The folder of compiled files, in which this test is.
fn built() -> PathBuf {
    let own = std::env::current_exe().expect("a path");
    own.parent()
        .and_then(Path::parent)
        .expect("a folder")
        .to_owned()
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name");
        if path.is_file() && path.extension().is_none_or(|e| e != "pyc") {
            fs::copy(&path, to.join(name)).expect("copied");
        }
    }
}

#[test]
fn the_package_passes_its_tests() {
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has = Command::new(&python).args(["-c", NEEDED]).output();
    let library = ["lib_pliant.so", "deps/lib_pliant.so"]
        .map(|name| built().join(name))
        .into_iter()
        .find(|path| path.exists());
    let (Ok(true), Some(library)) = (has.map(|done| done.status.success()), library) else {
        println!("skipped: no Python with numpy and pytest, or no library for it");
        return;
    };
    let folder = built().join("python");
    let _ = fs::remove_dir_all(&folder);
    let package = folder.join("pliant");
    let source = Path::new(env!("CARGO_MANIFEST_DIR"));
    copy(&source.join("pliant"), &package);
    copy(&source.join("tests"), &folder.join("tests"));
    copy(&source.join("notebooks"), &folder.join("notebooks"));
    copy(&source.join("cluster"), &folder.join("cluster"));
    fs::copy(&library, package.join("_pliant.abi3.so")).expect("copied");
    let done = Command::new(&python)
        .args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"])
        .current_dir(&folder)
        .env("PYTHONPATH", &folder)
        .output()
        .expect("pytest runs");
    let text = String::from_utf8_lossy(&done.stdout);
    println!("{text}");
    assert!(done.status.success(), "{text}");
}
