//! A module imports only modules that stand above it in `docs/architecture.md`.

use std::collections::BTreeSet;
use std::fs;

use crate::{library, root};

/// The modules of the library in the order of the page, from its rows `` | `src/NAME/`, ... | ``.
fn order(page: &str) -> Vec<String> {
    let mut found = Vec::new();
    for row in page.lines().filter(|line| line.starts_with("| `src/")) {
        let cell = row.split('|').nth(1).unwrap_or_default();
        for path in cell.split('`').filter(|part| part.starts_with("src/")) {
            let name = path["src/".len()..].trim_end_matches('/');
            found.push(name.trim_end_matches(".rs").to_owned());
        }
    }
    found
}

/// The modules of the library that a source imports.
fn imports(source: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (at, _) in source.match_indices("crate::") {
        let rest = &source[at + "crate::".len()..];
        let before = source[..at].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_') {
            continue;
        }
        if let Some(group) = rest.strip_prefix('{') {
            for part in group.split(['{', '}', ',', '\n']) {
                found.extend(first_word(part.trim()));
            }
        } else {
            found.extend(first_word(rest));
        }
    }
    found
}

fn first_word(text: &str) -> Option<String> {
    let end = text.find(|c: char| !(c.is_alphanumeric() || c == '_'));
    let word = &text[..end.unwrap_or(text.len())];
    let is_module = word.chars().next().is_some_and(|c| c.is_ascii_lowercase());
    is_module.then(|| word.to_owned())
}

/// The faults of the imports of a source in a module; empty if the order is correct.
fn wrong(order: &[String], module: &str, source: &str) -> Vec<String> {
    let place = |name: &str| order.iter().position(|m| m == name);
    let Some(own) = place(module) else {
        return vec![format!("{module} is not on the page")];
    };
    imports(source)
        .iter()
        .filter(|name| place(name).is_some_and(|other| other > own))
        .map(|name| format!("{module} imports {name}, which stands below it"))
        .collect()
}

#[test]
fn modules_import_what_stands_above_them() {
    let page = fs::read_to_string(root().join("docs/architecture.md")).expect("the page");
    let order = order(&page);
    let mut seen = BTreeSet::new();
    let mut problems = Vec::new();
    for (path, text) in library() {
        let inside = path.strip_prefix(root().join("src")).expect("a source");
        let first = inside.iter().next().expect("a name").to_string_lossy();
        let module = first.trim_end_matches(".rs").to_owned();
        if module == "lib" {
            continue;
        }
        for problem in wrong(&order, &module, &text) {
            problems.push(format!("{}: {problem}", inside.display()));
        }
        seen.insert(module);
    }
    assert!(problems.is_empty(), "{problems:#?}");
    let listed: BTreeSet<String> = order.iter().cloned().collect();
    let gone: Vec<_> = listed
        .difference(&seen)
        .filter(|m| *m != "testing")
        .collect();
    assert!(gone.is_empty(), "on the page, but not in src/: {gone:?}");
    assert_eq!(
        listed.len(),
        order.len(),
        "a module stands twice on the page"
    );
}

#[test]
fn an_import_of_what_stands_below_is_seen() {
    let order = order("| `src/a/`, `src/b.rs` | x |\n| `src/c/` | y |\n| `cli/` | z |\n");
    assert_eq!(order, ["a", "b", "c"]);
    assert!(wrong(&order, "b", "use crate::a::X;\nuse crate::b::Y;").is_empty());
    assert_eq!(wrong(&order, "a", "use crate::c::X;").len(), 1);
    assert_eq!(wrong(&order, "a", "use crate::{a::X, c::{Y, Z}};").len(), 1);
    assert_eq!(wrong(&order, "a", "let x = crate::b::f();").len(), 1);
    assert_eq!(wrong(&order, "d", "").len(), 1, "a folder that is missing");
}
