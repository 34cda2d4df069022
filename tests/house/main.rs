//! The rules of the code base that a machine can check: permitted imports, forbidden operations of
//! the library, numbers of files and of packages.

mod closures;
mod flags;
mod order;
mod packages;
mod quiet;
mod surface;
mod touched;

use std::fs;
use std::path::{Path, PathBuf};

/// The root of the workspace.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every Rust source below a folder of the workspace, sorted.
fn sources(folder: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![root().join(folder)];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).expect("a folder of the workspace") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                found.push(path);
            }
        }
    }
    found.sort();
    assert!(!found.is_empty(), "no sources in {folder}");
    found
}

/// The shipped part of a source: without its test module, which is last, and without comments.
fn shipped(source: &str) -> String {
    let lines = source[..test_module(source)].lines();
    lines
        .filter(|line| !line.trim_start().starts_with("//"))
        .map(|line| format!("{line}\n"))
        .collect()
}

/// Where the test module of a source begins, or the length of the source.
fn test_module(source: &str) -> usize {
    let marks = source.match_indices("#[cfg(test)]\n");
    let begins = |(at, mark): &(usize, &str)| {
        let next = source[at + mark.len()..].lines().next();
        next.is_some_and(|line| line.contains("mod ") && line.ends_with('{'))
    };
    marks
        .map(|mark| (mark, begins(&mark)))
        .find(|(_, begins)| *begins)
        .map_or(source.len(), |((at, _), _)| at)
}

/// The shipped sources of the library with their text. Conformance checks and test modules are not
/// shipped.
fn library() -> Vec<(PathBuf, String)> {
    sources("src")
        .into_iter()
        .filter(|path| !path.ends_with("tests.rs"))
        .filter(|path| !path.starts_with(root().join("src/testing")))
        .map(|path| {
            let text = fs::read_to_string(&path).expect("a source");
            (path, shipped(&text))
        })
        .collect()
}

#[test]
fn comments_and_test_modules_do_not_ship() {
    let source =
        "use a;\n// eprintln!\n    /// println!\nfn f() {}\n#[cfg(test)]\nmod tests {\n    x\n}\n";
    assert_eq!(shipped(source), "use a;\nfn f() {}\n");
    let shared = "fn f() {}\n#[cfg(test)]\npub(super) mod tests {\n    x\n}\n";
    assert_eq!(shipped(shared), "fn f() {}\n");
    let kept = "#[cfg(test)]\nmod tests;\nfn f() {}\n";
    assert!(shipped(kept).contains("fn f"), "a declaration ends nothing");
}
