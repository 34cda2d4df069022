//! The lines that `benches/document.py` reads.
// Each bench uses a part of this module.
#![allow(dead_code)]

use std::fmt::Display;

/// True for a quick trial run in seconds.
pub fn quick() -> bool {
    std::env::args().any(|a| a == "--test")
}

/// A line for `benches/document.py`: a number by name.
pub fn result(key: &str, value: f64, unit: &str) {
    println!("RESULT {key} {value:.6e} {unit}");
}

/// The same for a short text.
pub fn note(key: &str, value: impl Display) {
    println!("NOTE {key} {value}");
}

/// Lower-case letters, digits and minus signs.
pub fn key(name: &str) -> String {
    let plain = |c: char| {
        if c.is_ascii_alphanumeric() {
            c.to_ascii_lowercase()
        } else {
            '-'
        }
    };
    let words: String = name.chars().map(plain).collect();
    words
        .split('-')
        .filter(|w| !w.is_empty())
        .collect::<Vec<_>>()
        .join("-")
}

/// Lower quartile, median and upper quartile of at least one number.
pub fn quartiles(mut numbers: Vec<f64>) -> [f64; 3] {
    numbers.sort_by(f64::total_cmp);
    [1, 2, 3].map(|k| numbers[k * (numbers.len() - 1) / 4])
}

/// Prints the least and the median time [ms] of each of two functions, and the median of their
/// ratios in a round.
pub fn compare(name: &str, [one, other]: [&str; 2], [a, b]: &[Vec<f64>; 2]) {
    for (who, times) in [(one, a), (other, b)] {
        let least = times.iter().copied().fold(f64::INFINITY, f64::min);
        result(&format!("{name}.{who}.least"), least * 1e3, "ms");
        result(
            &format!("{name}.{who}.median"),
            quartiles(times.clone())[1] * 1e3,
            "ms",
        );
    }
    let [low, median, high] = quartiles(a.iter().zip(b).map(|(a, b)| a / b).collect());
    result(&format!("{name}.ratio"), median, "1");
    result(&format!("{name}.ratio.low"), low, "1");
    result(&format!("{name}.ratio.high"), high, "1");
}
