//! The book: every page is listed, every link leads somewhere, every picture exists.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::{files, root};

/// A link of a document: target, without what stands in code.
fn links(text: &str) -> Vec<String> {
    let mut all = Vec::new();
    let mut in_code = false;
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            in_code = !in_code;
        }
        if in_code {
            continue;
        }
        let plain: String = line.split('`').step_by(2).collect();
        let mut rest = plain.as_str();
        while let Some(start) = rest.find("](") {
            rest = &rest[start + 2..];
            let Some(end) = rest.find(')') else { break };
            all.push(rest[..end].to_owned());
            rest = &rest[end..];
        }
    }
    all
}

/// The anchor of a heading, as GitHub and mdBook make it.
fn anchor(heading: &str) -> String {
    let lower = heading.trim().to_lowercase();
    let kept = lower
        .chars()
        .filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn anchors(page: &Path) -> BTreeSet<String> {
    let text = fs::read_to_string(page).expect("a page");
    let mut in_code = false;
    let mut headings = Vec::new();
    for line in text.lines() {
        in_code ^= line.starts_with("```");
        if !in_code && line.starts_with('#') {
            headings.push(line);
        }
    }
    headings
        .into_iter()
        .map(|line| anchor(line.trim_start_matches('#')))
        .collect()
}

fn pages() -> Vec<PathBuf> {
    let mut all = files(&root().join("docs"), "md");
    all.extend(["README.md", "CONTRIBUTING.md", "CHANGELOG.md"].map(|name| root().join(name)));
    all
}

#[test]
fn every_link_leads_somewhere() {
    let mut seen = 0;
    for page in pages() {
        let text = fs::read_to_string(&page).expect("a page");
        for link in links(&text) {
            if link.starts_with("https://") {
                continue;
            }
            let (file, place) = link.split_once('#').unwrap_or((&link, ""));
            let target = match file {
                "" => page.clone(),
                _ => page.parent().unwrap_or(root()).join(file),
            };
            assert!(target.exists(), "{}: {link} is not there", page.display());
            let is_page = target.extension().is_some_and(|e| e == "md");
            assert!(
                place.is_empty() || (is_page && anchors(&target).contains(place)),
                "{}: {link} has no such heading",
                page.display()
            );
            seen += 1;
        }
    }
    assert!(seen > 150, "only {seen} links seen");
    assert_eq!(links("[a](b.md#c) and `[d](e)`"), ["b.md#c"]);
    assert_eq!(
        anchor(" Tendons that the files lack"),
        "tendons-that-the-files-lack"
    );
}

#[test]
fn every_page_is_in_the_summary_once() {
    let summary = fs::read_to_string(root().join("docs/SUMMARY.md")).expect("the summary");
    let listed = links(&summary);
    let unique: BTreeSet<&String> = listed.iter().collect();
    assert_eq!(unique.len(), listed.len(), "a page is listed twice");
    for page in files(&root().join("docs"), "md") {
        let name = page
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        assert!(
            name == "SUMMARY.md" || unique.contains(&name),
            "docs/SUMMARY.md does not list {name}"
        );
    }
}

#[test]
fn pictures_have_a_text_and_are_small() {
    let mut seen = 0;
    for page in pages() {
        let text = fs::read_to_string(&page).expect("a page");
        for line in text.lines().filter(|line| line.starts_with("![")) {
            let words = line[2..].split(']').next().unwrap_or_default();
            assert!(
                words.split_whitespace().count() >= 3,
                "{}: {line}",
                page.display()
            );
            seen += 1;
        }
    }
    assert!(seen >= 5, "only {seen} pictures");
    for ending in ["png", "gif"] {
        for picture in files(&root().join("docs"), ending) {
            let size = fs::metadata(&picture).expect("a picture").len();
            assert!(size < 1_500_000, "{} has {size} bytes", picture.display());
        }
    }
}
