//! A function has at most two named closures.

use std::fs;

use crate::{root, sources, test_module};

/// Folders with the sources to read.
const FOLDERS: &[&str] = &["src", "render/src", "cli/src", "viewer/src"];

/// A folder of sources that are not read.
const LEFT_OUT: &str = "cli/src/commands/springs";

/// Greatest number of named closures in a function.
const MOST: usize = 2;

/// A function of a source.
#[derive(Debug, PartialEq)]
struct Function {
    name: String,
    line: usize,
    indent: usize,
    closures: usize,
}

/// The name of the function that a line begins.
fn name(line: &str) -> Option<&str> {
    let (head, rest) = line.trim_start().split_once("fn ")?;
    let is_qualifier = |word: &str| {
        word.starts_with("pub") || word.ends_with(')') || ["const", "async"].contains(&word)
    };
    let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_'))?;
    (end > 0 && head.split_whitespace().all(is_qualifier)).then_some(&rest[..end])
}

/// True if a line gives a closure a name. A closure can begin on the next line.
fn names_closure(line: &str, next: &str) -> bool {
    let binding = line.trim_start().strip_prefix("let ");
    let Some((_, value)) = binding.and_then(|rest| rest.split_once(" =")) else {
        return false;
    };
    let mut value = if value.is_empty() { next } else { value };
    for before in ["&", "mut ", "move "] {
        value = value.trim_start();
        value = value.strip_prefix(before).unwrap_or(value);
    }
    value.trim_start().starts_with('|')
}

/// The functions of a source without its test module. A function ends at a brace with its indent.
fn functions(source: &str) -> Vec<Function> {
    let lines: Vec<&str> = source[..test_module(source)].lines().collect();
    let (mut all, mut open): (Vec<Function>, Vec<usize>) = (Vec::new(), Vec::new());
    for (i, line) in lines.iter().enumerate() {
        let indent = line.len() - line.trim_start().len();
        let name = name(line);
        if name.is_some() || line.trim() == "}" {
            open.retain(|f| all[*f].indent < indent);
        }
        if let Some(name) = name {
            open.push(all.len());
            all.push(Function {
                name: name.to_owned(),
                line: i + 1,
                indent,
                closures: 0,
            });
        }
        let next = lines.get(i + 1).copied().unwrap_or_default();
        if let Some(f) = open.last().filter(|_| names_closure(line, next)) {
            all[*f].closures += 1;
        }
    }
    all
}

#[test]
fn functions_have_at_most_two_named_closures() {
    let (mut found, mut seen, mut closures) = (Vec::new(), 0, 0);
    for path in FOLDERS.iter().flat_map(|folder| sources(folder)) {
        if path.ends_with("tests.rs") || path.starts_with(root().join(LEFT_OUT)) {
            continue;
        }
        let source = fs::read_to_string(&path).expect("a source");
        let inside = path.strip_prefix(root()).expect("a source").display();
        for function in functions(&source) {
            seen += 1;
            closures += function.closures;
            if function.closures > MOST {
                let Function {
                    name,
                    line,
                    closures,
                    ..
                } = function;
                found.push(format!("{inside}:{line}: {name} names {closures} closures"));
            }
        }
    }
    assert!(seen > 2000, "only {seen} functions were read");
    assert!(closures > 500, "only {closures} closures were read");
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn a_third_named_closure_is_found() {
    let source = "\
impl A {
    fn few(&self) -> usize;
    pub(in crate::a) const fn many(&self) -> usize {
        let a = |x: usize| x == 1;
        let mut b: Box<u8> =
            move || 2;
        fn inner() {
            let c = |x| x;
        }
        if a(1) {
            let d = &mut |(x, y): &(usize, usize)| x | y;
        }
        let e = 1 | 2;
        let Some(f) = all.iter().map(|x| x).next() else { return };
    }
}

fn none() {
    // let g = |x| x;
    call(|x| x);
}

#[cfg(test)]
mod tests {
    fn test() {
        let h = |x| x;
    }
}
";
    let found = functions(source);
    let counts: Vec<(&str, usize, usize)> = found
        .iter()
        .map(|f| (f.name.as_str(), f.line, f.closures))
        .collect();
    let expected = [
        ("few", 2, 0),
        ("many", 3, 3),
        ("inner", 7, 1),
        ("none", 18, 0),
    ];
    assert_eq!(counts, expected);
}
