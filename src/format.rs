//! Numbers and counts as text.

/// A number as text: four significant digits, no trailing zeros, an exponent if it is much shorter.
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 {
            "0".into()
        } else {
            value.to_string()
        };
    }
    let scientific = format!("{value:.3e}");
    let (mantissa, power) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let trim = |text: &str| {
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text.to_owned()
        }
    };
    match power.parse::<i32>() {
        Ok(power @ -4..=5) => trim(&format!("{value:.*}", (3 - power).max(0) as usize)),
        _ => format!("{}e{power}", trim(mantissa)),
    }
}

/// `1 triangle`, `2 triangles`.
pub fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_for_people() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (f64::NEG_INFINITY, "-inf"),
            (1.0, "1"),
            (-0.5, "-0.5"),
            (123456.0, "123456"),
            (1234567.0, "1.235e6"),
            (1.5e-9, "1.5e-9"),
            (0.001, "0.001"),
            (0.033333333, "0.03333"),
            (100.0, "100"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}
