//! The language of README and book: short sentences, plain words, sources with author and year, terms in the glossary.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;

use crate::{files, root};

/// Greatest number of words of a sentence.
const LONGEST: usize = 30;

/// Words that `CONTRIBUTING.md` refuses: each has a plainer or a more exact one.
const REFUSED: [&str; 17] = [
    "told",
    "laid",
    "met",
    "asked",
    "wanted",
    "so many",
    "way",
    "ways",
    "remedy",
    "guard",
    "guards",
    "travel",
    "travels",
    "goes on",
    "honest",
    "honestly",
    "stands still",
];

/// Names of a work without author and year.
const NAMELESS: [&str; 8] = [
    "the source",
    "the sources",
    "the source's",
    "the thesis",
    "the thesis's",
    "the theses",
    "first source",
    "second source",
];

/// Terms of the field that the book uses. The glossary has each.
const TERMS: [&str; 44] = [
    "activation",
    "aponeurosis",
    "area gain",
    "attachment",
    "audit",
    "bond",
    "certificate",
    "checkpoint",
    "compliance",
    "contact plane",
    "converge",
    "coordinate",
    "coverage",
    "crossing",
    "digest",
    "effect",
    "equilibrium",
    "expander",
    "fascia",
    "fibre",
    "fold",
    "frame",
    "insertion",
    "interval",
    "jitter",
    "lane",
    "Latin hypercube",
    "lift-off",
    "moment arm",
    "multiplier",
    "obstacle",
    "optimal fibre length",
    "origin",
    "pennation",
    "physiological cross-section",
    "pocket",
    "quasi-static",
    "residual",
    "substep",
    "tendon slack length",
    "tone",
    "winding number",
    "wrap surface",
    "XPBD",
];

/// README and the pages of the book.
fn book() -> Vec<PathBuf> {
    let mut all = files(&root().join("docs"), "md");
    all.push(root().join("README.md"));
    all
}

/// The paragraphs, list items, headings and cells of a text without code, links and comments.
fn paragraphs(text: &str) -> Vec<String> {
    let (mut all, mut now) = (Vec::new(), String::new());
    let (mut in_code, mut in_comment) = (false, false);
    for line in text.lines().map(str::trim) {
        if line.starts_with("```") {
            in_code = !in_code;
        }
        in_comment |= line.starts_with("<!--");
        let skipped = in_code || in_comment || line.starts_with("```");
        in_comment &= !line.contains("-->");
        let is_item = line.starts_with("- ")
            || line
                .split_once(". ")
                .is_some_and(|(n, _)| n.parse::<u32>().is_ok());
        let is_cells = line.starts_with('|');
        if skipped || line.is_empty() || is_item || is_cells || line.starts_with('#') {
            all.push(std::mem::take(&mut now));
        }
        if skipped {
            continue;
        }
        if is_cells {
            all.extend(line.trim_matches('|').split(" | ").map(str::to_owned));
        } else {
            now.push_str(line);
            now.push(' ');
            if line.starts_with('#') {
                all.push(std::mem::take(&mut now));
            }
        }
    }
    all.push(now);
    all.iter()
        .map(|paragraph| without_code(paragraph))
        .collect()
}

/// A paragraph with `code` for each piece of code, and without the targets of links.
fn without_code(paragraph: &str) -> String {
    let mut plain = String::new();
    for (k, part) in paragraph.split('`').enumerate() {
        plain.push_str(if k % 2 == 0 { part } else { "code" });
    }
    let mut text = String::new();
    let mut rest = plain.as_str();
    while let Some(start) = rest.find("](") {
        text.push_str(&rest[..start]);
        rest = rest[start..]
            .find(')')
            .map_or("", |end| &rest[start + end + 1..]);
    }
    text + rest
}

/// The sentences of a paragraph. A colon or a semicolon before a capital letter also ends one.
fn sentences(paragraph: &str) -> Vec<String> {
    let mut all = vec![String::new()];
    let words: Vec<&str> = paragraph.split_whitespace().collect();
    for (k, word) in words.iter().enumerate() {
        if let Some(last) = all.last_mut() {
            last.push_str(word);
            last.push(' ');
        }
        let bare = word.trim_end_matches([')', '"', '*']);
        let next_is_large = words.get(k + 1).is_some_and(|next| {
            next.starts_with(|c: char| c.is_uppercase() || "(*[".contains(c)) || *next == "code"
        });
        if bare.ends_with(['.', '?', '!']) || (bare.ends_with([':', ';']) && next_is_large) {
            all.push(String::new());
        }
    }
    all
}

/// The number of words, of what has a letter or a digit.
fn length(sentence: &str) -> usize {
    sentence
        .split_whitespace()
        .filter(|word| word.chars().any(char::is_alphanumeric))
        .count()
}

/// Whether a text has the words of `name`, as whole words.
fn has(text: &str, name: &str) -> bool {
    let lower = text.to_lowercase();
    let is_letter = |c: char| c.is_alphanumeric();
    lower
        .match_indices(&name.to_lowercase())
        .any(|(at, found)| {
            let before = lower[..at].chars().next_back().is_some_and(is_letter);
            let after = lower[at + found.len()..]
                .chars()
                .next()
                .is_some_and(is_letter);
            !before && !after
        })
}

#[test]
fn sentences_are_short() {
    let mut long = Vec::new();
    let mut seen = 0;
    for page in book() {
        let text = fs::read_to_string(&page).expect("a page");
        for sentence in paragraphs(&text).iter().flat_map(|p| sentences(p)) {
            seen += 1;
            if length(&sentence) > LONGEST {
                let name = page
                    .file_name()
                    .unwrap_or_default()
                    .to_string_lossy()
                    .into_owned();
                long.push(format!("{name}, {} words: {sentence}", length(&sentence)));
            }
        }
    }
    assert!(seen > 4000, "only {seen} sentences seen");
    assert!(
        long.is_empty(),
        "{} sentences of more than {LONGEST} words:\n{}",
        long.len(),
        long.join("\n")
    );
    let control = format!("A {}end.", "word ".repeat(40));
    assert!(
        sentences(&paragraphs(&control)[0])
            .iter()
            .any(|s| length(s) > LONGEST),
        "control: a long one passes"
    );
}

#[test]
fn words_are_plain_and_works_have_an_author() {
    let mut found = Vec::new();
    for page in book() {
        let text = fs::read_to_string(&page).expect("a page");
        let name = page
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        for paragraph in paragraphs(&text) {
            for word in REFUSED.iter().chain(&NAMELESS) {
                if has(&paragraph, word) {
                    found.push(format!("{name}: `{word}` in: {paragraph}"));
                }
            }
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
    assert!(
        has("He goes a long way.", "way") && !has("always away", "way"),
        "control"
    );
    assert!(has("as in the source's table", "the source"), "control");
}

/// The names of the glossary: first cells of its rows, and names after commas.
fn glossary() -> BTreeSet<String> {
    let text = fs::read_to_string(root().join("docs/notation.md")).expect("the glossary");
    let rows = text.lines().filter_map(|line| line.strip_prefix("| "));
    let names = rows.filter_map(|row| row.split(" | ").next());
    names
        .flat_map(|name| name.split(", "))
        .map(|name| name.trim().to_lowercase())
        .collect()
}

#[test]
fn the_glossary_has_every_term() {
    let glossary = glossary();
    let glossary_page = root().join("docs/notation.md");
    let pages: Vec<String> = book()
        .iter()
        .filter(|page| **page != glossary_page)
        .map(|page| fs::read_to_string(page).expect("a page").to_lowercase())
        .collect();
    for term in TERMS {
        let term = term.to_lowercase();
        assert!(
            glossary.contains(&term),
            "docs/notation.md has no row for `{term}`"
        );
        let uses = pages
            .iter()
            .filter(|page| has(page, &term) || has(page, &format!("{term}s")))
            .count();
        assert!(uses >= 1, "no page uses `{term}`");
    }
    assert!(!glossary.contains("no such term"), "control");
}
