//! Display of the user's texts, and the nearest known name of a misspelt one.

use strsim::osa_distance;

/// Greatest length of a text in a message [characters].
const SHOWN: usize = 64;

/// The text in a message: control characters escaped, at most 64 characters.
pub(crate) fn shown(text: &str) -> String {
    shortened(text, SHOWN)
}

/// The same as [`shown`] for paths, which are useless if truncated.
pub(crate) fn shown_path(path: &std::path::Path) -> String {
    shortened(&path.to_string_lossy(), 4096)
}

fn shortened(text: &str, most: usize) -> String {
    let mut out = String::new();
    for (count, c) in text.chars().enumerate() {
        if count == most {
            out.push('…');
            break;
        }
        if c.is_control() {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
    }
    out
}

/// Greatest number of names in a message.
const LISTED: usize = 12;

/// Names in sequence, at most the first twelve.
pub(crate) fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let mut names = names.fuse();
    let first: Vec<String> = names.by_ref().take(LISTED).map(shown).collect();
    let text = first.join(", ");
    match names.count() {
        0 => text,
        more => format!("{text} and {more} more"),
    }
}

/// The known name most similar to `name`, if it is similar enough.
pub(crate) fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // The text can have any length; beyond the longest key no distance is small.
    if name.chars().count() > SHOWN {
        return None;
    }
    let lower = name.to_lowercase();
    known
        .into_iter()
        .filter(|k| k.chars().count() <= SHOWN)
        .map(|k| (osa_distance(&lower, &k.to_lowercase()), k))
        .filter(|&(edits, k)| edits <= (k.chars().count().max(lower.chars().count()) / 3).max(1))
        .min_by_key(|&(edits, _)| edits)
        .map(|(_, k)| k)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_are_counted() {
        for (a, b, count) in [
            ("", "", 0),
            ("", "ab", 2),
            ("kitten", "sitting", 3),
            ("ab", "ba", 1),
            ("abc", "abc", 0),
        ] {
            assert_eq!(
                (osa_distance(a, b), osa_distance(b, a)),
                (count, count),
                "{a} {b}"
            );
        }
    }

    #[test]
    fn near_names_are_found_and_far_ones_are_not() {
        let known = ["thickness", "friction"];
        assert_eq!(nearest("tickness", known), Some("thickness"));
        assert_eq!(nearest("Firction", known), Some("friction"));
        assert_eq!(nearest("colour", known), None);
        assert_eq!(nearest(&"x".repeat(100_000), known), None);
    }

    #[test]
    fn long_lists_are_cut() {
        let names: Vec<String> = (1..=14).map(|i| format!("n{i}")).collect();
        let list = |count: usize| listed(names[..count].iter().map(String::as_str));
        assert_eq!((list(0).as_str(), list(2).as_str()), ("", "n1, n2"));
        assert!(list(12).ends_with("n11, n12"));
        assert!(list(13).ends_with("n11, n12 and 1 more"));
    }

    #[test]
    fn shown_texts_are_short_and_printable() {
        assert_eq!(shown("a\nb\u{1b}"), "a\\nb\\u{1b}");
        assert_eq!(shown(&"é".repeat(100)).chars().count(), 65);
    }
}
