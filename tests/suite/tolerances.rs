//! The table of tolerances in `docs/verification.md` equals [`pliant::testing::tolerances`].

pub use pliant::testing::tolerances::*;

/// The value of a row's third column: `64 eps` or a number.
fn written(row: &str) -> Option<(&str, f64)> {
    let mut columns = row.split('|').map(str::trim).skip(1);
    let (id, value) = (columns.next()?, columns.nth(1)?);
    let number = match value.strip_suffix(" eps") {
        Some(times) => times.parse::<f64>().ok()? * f64::EPSILON,
        None => value.parse().ok()?,
    };
    id.starts_with('T').then_some((id, number))
}

#[test]
fn the_table_of_the_document_is_the_one_used() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/verification.md");
    let text = std::fs::read_to_string(path).expect("docs/verification.md");
    let table: Vec<(&str, f64)> = text.lines().filter_map(written).collect();
    assert_eq!(table, ALL);
}

#[test]
fn a_nan_is_the_worst_error() {
    assert!(worst([1.0, f64::NAN, 2.0]).is_nan());
    assert_eq!(worst([1.0, 3.0, 2.0]), 3.0);
    assert_eq!(
        written("| T9 | what | 2 eps | why |"),
        Some(("T9", 2.0 * f64::EPSILON))
    );
    assert_eq!(written("| P9 | what | 2 | why |"), None);
}
