//! The public surface of the library: numbers of types and modules, and one name for each type.
//!
//! Sources are read from `src/lib.rs` along `pub mod` and `pub use`. Modules of tests and benches
//! (`pliant::testing`) do not count.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use crate::{root, shipped};

/// Greatest number of public types. A type inside a public setting or error has a name, because a
/// program makes it or matches on it.
const TYPES: usize = 329;
/// Greatest number of public modules.
const MODULES: usize = 40;

/// A public module: its path and the types that it exports.
#[derive(Debug, PartialEq)]
struct Module {
    path: String,
    types: BTreeSet<String>,
}

/// True for the name of a type; functions have no capital letter, constants no small one.
fn is_type(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_uppercase()) && name.contains(|c: char| c.is_lowercase())
}

/// The names of a `use` tree, as the importing module sees them.
fn names(tree: &str) -> Vec<String> {
    let words = tree.split(['{', '}', ',']).map(str::trim);
    let last = words.filter_map(|word| word.rsplit("::").next());
    last.filter(|name| !name.is_empty())
        .map(|name| name.rsplit(" as ").next().unwrap_or(name).to_owned())
        .collect()
}

/// The types that a source exports: those that it defines and those of `pub use`. Types of another
/// room are that room's.
fn exported(source: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for kind in ["struct", "enum", "union", "trait", "type"] {
        for (at, start) in source.match_indices(&format!("\npub {kind} ")) {
            let rest = &source[at + start.len()..];
            let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_'));
            found.insert(rest[..end.unwrap_or(rest.len())].to_owned());
        }
    }
    for (at, start) in source.match_indices("\npub use ") {
        let tree = source[at + start.len()..].split(';').next();
        let tree = tree.filter(|tree| !tree.starts_with("crate::"));
        found.extend(names(tree.unwrap_or_default()));
    }
    found.retain(|name| is_type(name));
    found
}

/// The names of the public modules of a source.
fn submodules(source: &str) -> Vec<&str> {
    let lines = source.lines();
    let modules = lines.filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';'));
    modules.filter(|name| *name != "testing").collect()
}

/// The file of a module whose parent has its submodules in `folder`.
fn file(folder: &Path, name: &str) -> PathBuf {
    let flat = folder.join(format!("{name}.rs"));
    if flat.exists() {
        flat
    } else {
        folder.join(name).join("mod.rs")
    }
}

/// Adds the public modules below the one of `source`.
fn collect(folder: &Path, path: &str, source: &str, found: &mut Vec<Module>) {
    for name in submodules(source) {
        let text = fs::read_to_string(file(folder, name)).expect("a module");
        // Conformance checks that only `testing` exports have an attribute of their own.
        let text = format!("\n{}", shipped(&text)).replace(
            "#[cfg(any(test, feature = \"testing\"))]\npub ",
            "#[testing]\npub(crate) ",
        );
        let path = format!("{path}::{name}");
        let types = exported(&text);
        found.push(Module {
            path: path.clone(),
            types,
        });
        collect(&folder.join(name), &path, &text, found);
    }
}

fn surface() -> (BTreeSet<String>, Vec<Module>) {
    let source = fs::read_to_string(root().join("src/lib.rs")).expect("the root");
    let source = format!("\n{}", shipped(&source));
    let mut modules = Vec::new();
    collect(&root().join("src"), "pliant", &source, &mut modules);
    (exported(&source), modules)
}

#[test]
fn the_surface_is_small_and_each_type_has_a_name_of_its_own() {
    let (at_root, modules) = surface();
    let mut rooms: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for module in &modules {
        for name in &module.types {
            rooms.entry(name).or_default().push(&module.path);
        }
    }
    // A room may export the types of its own modules.
    let is_twin = |paths: &[&str]| paths.windows(2).any(|two| !two[1].starts_with(two[0]));
    let twins: Vec<_> = rooms.iter().filter(|(_, paths)| is_twin(paths)).collect();
    assert!(twins.is_empty(), "one name for two types: {twins:?}");
    let mut types: BTreeSet<&str> = rooms.keys().copied().collect();
    types.extend(at_root.iter().map(String::as_str));
    println!(
        "{} types, {} of them at the root; {} modules",
        types.len(),
        at_root.len(),
        modules.len()
    );
    assert!(types.len() <= TYPES, "{} public types", types.len());
    assert!(modules.len() <= MODULES, "{} public modules", modules.len());
    // Nothing is counted where nothing is read.
    assert!(types.len() > TYPES - 50 && modules.len() > MODULES - 10);
    assert!(at_root.contains("QuasiStatic") && types.contains("Stencil"));
}

#[test]
fn names_of_a_tree_and_of_a_source() {
    assert_eq!(
        names("a::{B, c::D as E, self}"),
        ["B", "E", "self"].map(String::from)
    );
    let source = "\npub struct Two;\npub(crate) struct Hidden;\npub use a::{Three, three, THREE};\n\
                  pub use crate::other::Four;\npub(crate) use b::Five;\npub type Six<T> = Two;\n";
    let expected = ["Six", "Three", "Two"].map(String::from);
    assert_eq!(exported(source), expected.into());
    assert_eq!(submodules("pub mod a;\nmod b;\npub mod testing;\n"), ["a"]);
}
