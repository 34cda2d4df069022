//! The number of packages that the library depends on, by features.

use std::collections::BTreeSet;
use std::process::Command;

/// The packages of a build, including the library.
fn packages(arguments: &[&str]) -> BTreeSet<String> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let tree = [
        "tree",
        "-e",
        "normal",
        "-p",
        "pliant",
        "--prefix",
        "none",
        "--offline",
    ];
    let done = Command::new(cargo)
        .args(tree)
        .args(arguments)
        .current_dir(crate::root())
        .output()
        .expect("cargo");
    let text = String::from_utf8_lossy(&done.stdout);
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    let name = |line: &str| line.split(" (").next().unwrap_or_default().to_owned();
    text.lines().map(name).filter(|n| !n.is_empty()).collect()
}

#[test]
fn the_library_pulls_in_few_packages() {
    let all = packages(&[]);
    assert!(all.len() <= 115, "{} packages: {all:?}", all.len());
    let bare = packages(&["--no-default-features"]);
    assert!(bare.len() <= 40, "{} packages: {bare:?}", bare.len());
    for package in ["parry3d-f64", "faer", "toml", "serde", "miniz_oxide"] {
        let has = |set: &BTreeSet<String>| set.iter().any(|p| p.split(' ').next() == Some(package));
        assert!(has(&all), "control: {package} is not seen at all");
        assert!(!has(&bare), "{package} is behind no feature");
    }
}

#[test]
fn the_library_knows_no_terminal_and_no_picture() {
    let all = packages(&[]);
    for package in [
        "clap",
        "miette",
        "indicatif",
        "ctrlc",
        "png",
        "gif",
        "kiss3d",
        "noto-sans-mono-bitmap",
    ] {
        assert!(
            !all.iter().any(|p| p.split(' ').next() == Some(package)),
            "{package}"
        );
    }
}
