//! References of the documents to files, keys and errata exist. The book: its language, its links.

mod book;
mod language;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)
        .expect("a folder")
        .map(|e| e.expect("an entry").path())
    {
        if entry.is_dir() {
            found.extend(files(&entry, ending));
        } else if entry.extension().is_some_and(|e| e == ending) {
            found.push(entry);
        }
    }
    found
}

/// The sources of all packages.
fn sources() -> Vec<PathBuf> {
    ["src", "render/src", "viewer/src", "cli/src"]
        .iter()
        .flat_map(|folder| files(&root().join(folder), "rs"))
        .collect()
}

fn documents() -> Vec<PathBuf> {
    let mut all = files(&root().join("docs"), "md");
    all.extend(["README.md", "CONTRIBUTING.md", "CHANGELOG.md"].map(|name| root().join(name)));
    all
}

/// Created by a command, only an example, or beside the repository.
const NOT_KEPT: &[&str] = &[
    "pliant-out/hip",
    "pliant-out/hip/report.html",
    "pliant-out/hip/hip.pvd",
    "arms/report.html",
    "look/overview.png",
    "src/constraints/NAME.rs",
    "src/io/NAME.rs",
    "src/scene/content/NAME.rs",
    "src/simulation/scenario/NAME.rs",
    "../shared/data",
];

/// Paths in backticks.
fn paths(text: &str) -> BTreeSet<String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "./_-".contains(c);
    let inside = text.split('`').skip(1).step_by(2);
    let is_path = |s: &&str| !s.is_empty() && s.contains('/') && s.chars().all(plain);
    inside.filter(is_path).map(String::from).collect()
}

/// Reference keys: a name and a year.
fn keys(text: &str) -> BTreeSet<String> {
    let words = text.split(|c: char| !c.is_ascii_alphanumeric());
    let is_key = |w: &&str| {
        let (name, year) = w.split_at(w.len().saturating_sub(4));
        name.len() > 3
            && name.chars().all(|c| c.is_ascii_lowercase())
            && (year.starts_with("19") || year.starts_with("20"))
            && year.chars().all(|c| c.is_ascii_digit())
    };
    words
        .filter(|w| w.is_ascii())
        .filter(is_key)
        .map(String::from)
        .collect()
}

#[test]
fn every_path_exists() {
    let (mut seen, mut excused) = (0, BTreeSet::new());
    for document in documents() {
        let text = fs::read_to_string(&document).expect("a document");
        for path in paths(&text) {
            if NOT_KEPT.contains(&path.as_str()) {
                excused.insert(path);
                continue;
            }
            assert!(
                root().join(&path).exists(),
                "{} names {path}",
                document.display()
            );
            seen += 1;
        }
    }
    assert!(seen > 20, "only {seen} paths seen");
    assert_eq!(
        excused.len(),
        NOT_KEPT.len(),
        "an excuse that no document needs: {excused:?} are needed"
    );
    assert!(paths("`a/b.rs` and `c d/e`").contains("a/b.rs"));
}

#[test]
fn every_reference_is_listed() {
    let listed = keys(&fs::read_to_string(root().join("docs/references.bib")).expect("references"));
    let mut used = BTreeSet::new();
    for file in sources().into_iter().chain(documents()) {
        used.extend(keys(&fs::read_to_string(&file).expect("a file")));
    }
    let missing: Vec<_> = used.difference(&listed).collect();
    assert!(
        missing.is_empty(),
        "not in docs/references.bib: {missing:?}"
    );
    assert!(used.len() >= 10, "only {} keys seen", used.len());
    assert!(
        keys("as [nobody1999] says, in 2007").contains("nobody1999"),
        "control: a key is not seen"
    );
    assert!(!listed.contains("nobody1999"));
}

/// Numbers such as A05 at the start of names of tests.
fn errata_of_tests() -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for file in files(&root().join("tests"), "rs")
        .into_iter()
        .chain(sources())
    {
        for name in fs::read_to_string(&file)
            .expect("a file")
            .split("#[test]")
            .skip(1)
        {
            let name = name.split("fn ").nth(1).unwrap_or_default();
            let number = name.split('_').next().unwrap_or_default();
            if number.len() == 3
                && number.starts_with('a')
                && number[1..].chars().all(|c| c.is_ascii_digit())
            {
                found.insert(number.to_uppercase());
            }
        }
    }
    found
}

/// A row of the errata names its evidence: a test with its number, or a file that mentions it.
#[test]
fn every_erratum_is_shown_where_its_row_says() {
    let text = fs::read_to_string(root().join("docs/errata.md")).expect("the errata");
    let tests = errata_of_tests();
    let mut rows = 0;
    for line in text.lines().filter(|l| l.starts_with("| A")) {
        let cells: Vec<&str> = line.split(" | ").collect();
        let file = paths(line)
            .into_iter()
            .next_back()
            .unwrap_or_else(|| panic!("no file in: {line}"));
        let shown =
            fs::read_to_string(root().join(&file)).unwrap_or_else(|e| panic!("{file}: {e}"));
        for number in cells[0].trim_start_matches("| ").split(", ") {
            let test =
                tests.contains(number) && shown.contains(&format!("fn {}_", number.to_lowercase()));
            assert!(
                test || (shown.contains(number) && shown.contains("#[test]")),
                "{file} does not show {number}"
            );
            rows += 1;
        }
    }
    assert!(rows >= 10, "only {rows} rows");
    assert!(!tests.contains("A99"), "control: any number is found");
}
