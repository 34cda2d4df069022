//! The library writes nothing to a terminal, reads no environment variable, replaces no global hook
//! and contains no path of a workplace.

use crate::library;

/// Texts that no source of the library may contain, with the reason.
const BARRED: &[(&str, &str)] = &[
    ("println!", "it writes to the terminal"),
    ("print!", "it writes to the terminal"),
    ("dbg!", "it writes to the terminal"),
    ("stdout()", "it writes to the terminal"),
    ("stderr()", "it writes to the terminal"),
    ("env::var", "it reads the environment"),
    ("env::current_dir", "it reads the environment"),
    ("env::current_exe", "it reads the environment"),
    ("set_hook", "it swaps a global hook"),
    ("set_var", "it changes the environment"),
    ("process::exit", "it ends the process"),
    ("shared/data", "it knows a folder of a workplace"),
    ("\"shared\"", "it knows a folder of a workplace"),
];

/// The reasons why a source is not quiet.
fn loud(source: &str) -> Vec<&'static str> {
    let found = BARRED.iter().filter(|(text, _)| source.contains(text));
    found.map(|&(_, why)| why).collect()
}

#[test]
fn the_library_is_quiet() {
    let mut problems = Vec::new();
    for (path, text) in library() {
        for why in loud(&text) {
            problems.push(format!("{}: {why}", path.display()));
        }
    }
    assert!(problems.is_empty(), "{problems:#?}");
}

#[test]
fn a_loud_source_is_seen() {
    for (text, _) in BARRED {
        assert!(!loud(&format!("let x = {text};")).is_empty(), "{text}");
    }
    assert!(loud("writeln!(out, \"x\")").is_empty());
}
