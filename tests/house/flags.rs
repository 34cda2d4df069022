//! The library never mentions an option of a command line.

use std::fs;

use crate::sources;

/// The index after the end of a block comment; block comments can be nested.
fn after_comment(text: &[char], mut k: usize) -> usize {
    let mut depth = 0;
    while k + 1 < text.len() {
        match (text[k], text[k + 1]) {
            ('/', '*') => (depth, k) = (depth + 1, k + 2),
            ('*', '/') => (depth, k) = (depth - 1, k + 2),
            _ => k += 1,
        }
        if depth == 0 {
            return k;
        }
    }
    text.len()
}

/// The string literals of a Rust source with their lines, without comments.
fn literals(source: &str) -> Vec<(usize, String)> {
    let text: Vec<char> = source.chars().collect();
    let at = |k: usize| text.get(k).copied().unwrap_or('\0');
    let (mut all, mut k, mut line) = (Vec::new(), 0, 1);
    while k < text.len() {
        let first = k;
        match at(k) {
            '/' if at(k + 1) == '/' => {
                while k < text.len() && at(k) != '\n' {
                    k += 1;
                }
            }
            '/' if at(k + 1) == '*' => k = after_comment(&text, k),
            'r' if at(k + 1) == '"' || (at(k + 1) == '#' && "\"#".contains(at(k + 2))) => {
                let mut hashes = 0;
                while at(k + 1 + hashes) == '#' {
                    hashes += 1;
                }
                let begin = k + 2 + hashes;
                k = begin;
                let ends = |k: usize| at(k) == '"' && (0..hashes).all(|h| at(k + 1 + h) == '#');
                while k < text.len() && !ends(k) {
                    k += 1;
                }
                all.push((line, text[begin..k.min(text.len())].iter().collect()));
                k += 1 + hashes;
            }
            '"' => {
                k += 1;
                let begin = k;
                while k < text.len() && at(k) != '"' {
                    k += if at(k) == '\\' { 2 } else { 1 };
                }
                all.push((line, text[begin..k.min(text.len())].iter().collect()));
                k += 1;
            }
            // A character literal. A lifetime has no second quote this close.
            '\'' if at(k + 1) == '\\' => {
                k += 3;
                while k < text.len() && at(k) != '\'' {
                    k += 1;
                }
                k += 1;
            }
            '\'' if at(k + 2) == '\'' => k += 3,
            _ => k += 1,
        }
        let end = k.min(text.len());
        line += text[first..end].iter().filter(|c| **c == '\n').count();
    }
    all
}

/// Whether a text mentions an option of a command line: `--` before a lower-case letter, at the
/// start of a word.
fn names_an_option(text: &str) -> bool {
    text.match_indices("--").any(|(at, _)| {
        let before = text[..at].chars().next_back();
        let after = text[at + 2..].chars().next();
        before.is_none_or(|c| c.is_whitespace() || "`'\"(=".contains(c))
            && after.is_some_and(|c| c.is_ascii_lowercase())
    })
}

#[test]
fn no_library_text_names_an_option_of_the_command() {
    let (mut found, mut seen) = (Vec::new(), 0);
    for folder in ["src", "render/src", "viewer/src"] {
        for path in sources(folder) {
            let source = fs::read_to_string(&path).expect("a source");
            for (line, text) in literals(&source) {
                seen += 1;
                if names_an_option(&text) {
                    found.push(format!("{}:{line}: {text}", path.display()));
                }
            }
        }
    }
    assert!(seen > 1000, "only {seen} texts were read");
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn an_option_is_found_where_there_is_one() {
    let source = r##"
        // a comment says "--no"
        fn f<'a>() -> char { '"' }
        let a = "give --damping";
        /* "--neither" */
        let b = r#"say "--steps""#;
        let c = "a -- b, x--y";
        let d = "`--repair` \" turns";
    "##;
    let all = literals(source);
    assert_eq!(all.len(), 4, "{all:?}");
    let found: Vec<usize> = all
        .iter()
        .filter(|(_, text)| names_an_option(text))
        .map(|(line, _)| *line)
        .collect();
    assert_eq!(found, [4, 6, 8]);
}
