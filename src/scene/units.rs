//! Quantities with units, such as `"0.5 mm"` or `"20 kPa"`, converted to SI units.
//!
//! Each [`Dimension`] has a fixed list of units. Products use a space, `*` or `·`, powers a digit,
//! `^` or a superscript. Decimal prefixes shift the decimal exponent of the text before its
//! conversion, so `"83.56 mm"` has the same bits as `0.08356`.

use std::fmt;

/// Dimension of a quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Dimension {
    /// Length \[m\].
    Length,
    /// Area [m^2].
    Area,
    /// Volume [m^3].
    Volume,
    /// Angle \[rad\].
    Angle,
    /// Time \[s\].
    Time,
    /// Rate or frequency [1/s].
    Rate,
    /// Mass \[kg\].
    Mass,
    /// Density [kg/m^3].
    Density,
    /// Force \[N\].
    Force,
    /// In-plane stiffness of a surface [N/m].
    Stiffness,
    /// Stiffness of a bond of two surfaces for each area [N/m^3].
    BondStiffness,
    /// Damping of a point: force over velocity [N s/m].
    Damping,
    /// Moment, or bending stiffness of a surface [N m].
    Moment,
    /// Pressure or modulus \[Pa\].
    Pressure,
    /// Velocity [m/s].
    Velocity,
    /// Acceleration [m/s^2].
    Acceleration,
    /// Ratio without a dimension; the only one with an optional unit.
    Ratio,
}

/// One unit: its spellings (the first is displayed), its power of ten, and a factor for other
/// units.
struct Unit {
    names: &'static [&'static str],
    power: i32,
    factor: f64,
}

const fn unit(names: &'static [&'static str], power: i32) -> Unit {
    Unit {
        names,
        power,
        factor: 1.0,
    }
}

const fn scaled(names: &'static [&'static str], factor: f64) -> Unit {
    Unit {
        names,
        power: 0,
        factor,
    }
}

const LENGTH: &[Unit] = &[
    unit(&["m"], 0),
    unit(&["dm"], -1),
    unit(&["cm"], -2),
    unit(&["mm"], -3),
    unit(&["um", "µm", "μm"], -6),
    unit(&["km"], 3),
    scaled(&["in"], 0.0254),
];
const AREA: &[Unit] = &[
    unit(&["m2"], 0),
    unit(&["dm2"], -2),
    unit(&["cm2"], -4),
    unit(&["mm2"], -6),
];
const VOLUME: &[Unit] = &[
    unit(&["m3"], 0),
    unit(&["cc", "cm3", "ml", "mL"], -6),
    unit(&["l", "L", "dm3"], -3),
    unit(&["mm3"], -9),
];
const ANGLE: &[Unit] = &[
    unit(&["rad"], 0),
    scaled(&["deg", "°"], std::f64::consts::PI / 180.0),
    unit(&["mrad"], -3),
];
const TIME: &[Unit] = &[
    unit(&["s"], 0),
    unit(&["ms"], -3),
    unit(&["us", "µs", "μs"], -6),
    scaled(&["min"], 60.0),
];
const RATE: &[Unit] = &[
    unit(&["1/s", "/s", "s-1"], 0),
    unit(&["Hz"], 0),
    unit(&["kHz"], 3),
    unit(&["1/ms", "/ms", "ms-1"], 3),
];
const MASS: &[Unit] = &[
    unit(&["kg"], 0),
    unit(&["g"], -3),
    unit(&["mg"], -6),
    unit(&["t"], 3),
];
const DENSITY: &[Unit] = &[
    unit(&["kg/m3", "kg*m-3"], 0),
    unit(&["g/cm3", "g*cm-3"], 3),
    unit(&["g/ml", "g/mL"], 3),
    unit(&["kg/l", "kg/L"], 3),
];
const FORCE: &[Unit] = &[
    unit(&["N"], 0),
    unit(&["mN"], -3),
    unit(&["uN", "µN", "μN"], -6),
    unit(&["kN"], 3),
];
const STIFFNESS: &[Unit] = &[
    unit(&["N/m"], 0),
    unit(&["kN/m"], 3),
    unit(&["mN/m"], -3),
    unit(&["N/mm"], 3),
    unit(&["N/cm"], 2),
    unit(&["mN/mm"], 0),
];
const BOND_STIFFNESS: &[Unit] = &[
    unit(&["N/m3", "Pa/m"], 0),
    unit(&["kN/m3", "kPa/m", "Pa/mm"], 3),
    unit(&["MN/m3", "MPa/m", "kPa/mm"], 6),
    unit(&["N/mm3", "GN/m3", "MPa/mm"], 9),
    unit(&["N/cm3"], 6),
];
const DAMPING: &[Unit] = &[
    unit(&["N*s/m", "Ns/m", "kg/s"], 0),
    unit(&["mN*s/m", "g/s"], -3),
];
const MOMENT: &[Unit] = &[
    unit(&["N*m", "Nm", "J"], 0),
    unit(&["N*mm", "Nmm", "mN*m", "mNm", "mJ"], -3),
    unit(&["N*cm", "Ncm"], -2),
    unit(&["uN*m", "µN*m", "μN*m", "mN*mm", "uJ"], -6),
    unit(&["kN*m", "kNm"], 3),
];
const PRESSURE: &[Unit] = &[
    unit(&["Pa", "N/m2"], 0),
    unit(&["kPa"], 3),
    unit(&["MPa", "N/mm2"], 6),
    unit(&["GPa"], 9),
    unit(&["N/cm2"], 4),
    unit(&["hPa", "mbar"], 2),
    unit(&["bar"], 5),
];
const VELOCITY: &[Unit] = &[
    unit(&["m/s", "m*s-1"], 0),
    unit(&["mm/s"], -3),
    unit(&["cm/s"], -2),
];
const ACCELERATION: &[Unit] = &[
    unit(&["m/s2", "m*s-2"], 0),
    unit(&["mm/s2"], -3),
    unit(&["cm/s2"], -2),
];
const RATIO: &[Unit] = &[unit(&["%"], -2), unit(&["1", ""], 0)];

impl Dimension {
    /// All dimensions, in the order above.
    pub const ALL: [Self; 17] = [
        Self::Length,
        Self::Area,
        Self::Volume,
        Self::Angle,
        Self::Time,
        Self::Rate,
        Self::Mass,
        Self::Density,
        Self::Force,
        Self::Stiffness,
        Self::BondStiffness,
        Self::Damping,
        Self::Moment,
        Self::Pressure,
        Self::Velocity,
        Self::Acceleration,
        Self::Ratio,
    ];

    fn units(self) -> &'static [Unit] {
        match self {
            Self::Length => LENGTH,
            Self::Area => AREA,
            Self::Volume => VOLUME,
            Self::Angle => ANGLE,
            Self::Time => TIME,
            Self::Rate => RATE,
            Self::Mass => MASS,
            Self::Density => DENSITY,
            Self::Force => FORCE,
            Self::Stiffness => STIFFNESS,
            Self::BondStiffness => BOND_STIFFNESS,
            Self::Damping => DAMPING,
            Self::Moment => MOMENT,
            Self::Pressure => PRESSURE,
            Self::Velocity => VELOCITY,
            Self::Acceleration => ACCELERATION,
            Self::Ratio => RATIO,
        }
    }

    /// The accepted units, as shown in messages.
    ///
    /// ```
    /// use pliant::scene::units::Dimension;
    /// assert_eq!(Dimension::Angle.known(), "rad, deg, mrad");
    /// ```
    #[must_use]
    pub fn known(self) -> String {
        let shown: Vec<String> = self
            .units()
            .iter()
            .map(|u| u.names[0].replace('*', " "))
            .collect();
        shown.join(", ")
    }

    /// The unit of the values that are read; empty for a ratio.
    pub(super) fn base(self) -> String {
        let is_base = |unit: &&Unit| unit.power == 0 && unit.factor == 1.0;
        let base = self.units().iter().find(is_base);
        base.filter(|_| self != Self::Ratio)
            .map_or(String::new(), |unit| unit.names[0].replace('*', " "))
    }

    /// An example of a quantity, for messages.
    #[must_use]
    pub fn example(self) -> &'static str {
        match self {
            Self::Length => "0.5 mm",
            Self::Area => "30 cm2",
            Self::Volume => "100 cc",
            Self::Angle => "30 deg",
            Self::Time => "10 ms",
            Self::Rate => "5 1/s",
            Self::Mass => "1 kg",
            Self::Density => "1060 kg/m3",
            Self::Force => "10 N",
            Self::Stiffness => "300 N/m",
            Self::BondStiffness => "2e7 N/m3",
            Self::Damping => "0.4 N s/m",
            Self::Moment => "2e-4 N m",
            Self::Pressure => "20 kPa",
            Self::Velocity => "1 m/s",
            Self::Acceleration => "9.81 m/s2",
            Self::Ratio => "5 %",
        }
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Length => "length",
            Self::Area => "area",
            Self::Volume => "volume",
            Self::Angle => "angle",
            Self::Time => "time",
            Self::Rate => "rate",
            Self::Mass => "mass",
            Self::Density => "density",
            Self::Force => "force",
            Self::Stiffness => "surface stiffness",
            Self::BondStiffness => "bond stiffness",
            Self::Damping => "damping",
            Self::Moment => "bending stiffness",
            Self::Pressure => "pressure",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Ratio => "ratio",
        })
    }
}

/// Error of a text that is no quantity of the required dimension.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnitError {
    /// The number has no unit.
    #[error("`{number}` has no unit")]
    Bare {
        /// The number as written.
        number: String,
        /// The required dimension.
        dimension: Dimension,
    },
    /// The unit does not belong to the required dimension.
    #[error("{}", wrong_unit(.unit, *.dimension, *.actual))]
    WrongUnit {
        /// The unit as written.
        unit: String,
        /// The required dimension.
        dimension: Dimension,
        /// The dimension of the unit, if any.
        actual: Option<Dimension>,
    },
    /// The text does not begin with a number.
    #[error("`{text}` does not begin with a number")]
    NoNumber {
        /// The text as written, shortened.
        text: String,
        /// The required dimension.
        dimension: Dimension,
    },
    /// The number is infinite or not a number.
    #[error("`{text}` is not a finite number")]
    NotFinite {
        /// The text as written, shortened.
        text: String,
    },
    /// The number overflows or underflows in double precision.
    #[error("`{text}` is too large or too small to be represented")]
    Overflow {
        /// The text as written, shortened.
        text: String,
    },
    /// No half of an interval after `+-`, or one that is not positive.
    #[error("`{text}` has no interval that is greater than zero")]
    NoInterval {
        /// The text as written, shortened.
        text: String,
        /// The required dimension.
        dimension: Dimension,
    },
}

impl UnitError {
    /// Advice for the user.
    #[must_use]
    pub fn help(&self) -> String {
        match self {
            Self::Bare { number, dimension } => {
                // A length of a scene is rather in mm than in m: the unit of the example.
                let example = dimension.example();
                let unit = example.split_once(' ').map_or(example, |(_, unit)| unit);
                format!(
                    "write \"{number} {unit}\"; known units of {dimension}: {}",
                    dimension.known()
                )
            }
            Self::WrongUnit { dimension, .. } => {
                format!("known units of {dimension}: {}", dimension.known())
            }
            Self::NoNumber { dimension, .. } => {
                let a = if dimension.to_string().starts_with('a') {
                    "an"
                } else {
                    "a"
                };
                format!("write {a} {dimension} as in \"{}\"", dimension.example())
            }
            Self::NotFinite { .. } | Self::Overflow { .. } => "write a finite number".to_owned(),
            Self::NoInterval { dimension, .. } => {
                let example = dimension.example();
                format!(
                    "write the value, then `+-` and half of its interval: \"{example} +- 10 %\""
                )
            }
        }
    }
}

fn wrong_unit(unit: &str, dimension: Dimension, actual: Option<Dimension>) -> String {
    match actual {
        Some(actual) => format!("`{unit}` is a unit of {actual}, not of {dimension}"),
        None => format!("`{unit}` is not a known unit of {dimension}"),
    }
}

/// Reads a quantity such as `"0.5 mm"` into the SI unit of its dimension.
///
/// # Errors
/// A number without a unit, an unknown unit or one of another dimension, no number, or a number
/// that is not finite.
///
/// ```
/// use pliant::scene::units::{Dimension, parse};
/// assert_eq!(parse("83.56 mm", Dimension::Length), Ok(0.08356));
/// assert!(parse("0.5", Dimension::Length).is_err());
/// ```
pub fn parse(text: &str, dimension: Dimension) -> Result<f64, UnitError> {
    let trimmed = text.trim();
    let (number, rest) = split_number(trimmed).ok_or_else(|| no_number(trimmed, dimension))?;
    let rest = rest.trim();
    if rest.is_empty() && dimension != Dimension::Ratio {
        return Err(UnitError::Bare {
            number: crate::spelling::shown(number),
            dimension,
        });
    }
    let unit = find(rest, dimension)?;
    let value = shifted(number, unit.power) * unit.factor;
    let vanished = value == 0.0 && mantissa(number).bytes().any(|b| (b'1'..=b'9').contains(&b));
    if !value.is_finite() || vanished {
        return Err(UnitError::Overflow {
            text: crate::spelling::shown(trimmed),
        });
    }
    Ok(value)
}

/// The factor from a unit's name, such as `"mm"`, to the SI unit of its dimension.
///
/// # Errors
/// [`UnitError::WrongUnit`] if the dimension has no such unit.
pub fn scale(name: &str, dimension: Dimension) -> Result<f64, UnitError> {
    let unit = find(name.trim(), dimension)?;
    Ok(shifted("1", unit.power) * unit.factor)
}

fn no_number(text: &str, dimension: Dimension) -> UnitError {
    let word = text.trim_start_matches(['+', '-']).to_ascii_lowercase();
    let text = crate::spelling::shown(text);
    if ["nan", "inf"].iter().any(|bad| word.starts_with(bad)) {
        UnitError::NotFinite { text }
    } else {
        UnitError::NoNumber { text, dimension }
    }
}

fn find(name: &str, dimension: Dimension) -> Result<&'static Unit, UnitError> {
    let plain = normalised(name);
    let among = |d: Dimension| d.units().iter().find(|u| u.names.contains(&plain.as_str()));
    among(dimension).ok_or_else(|| UnitError::WrongUnit {
        unit: crate::spelling::shown(name),
        dimension,
        actual: Dimension::ALL
            .into_iter()
            .find(|&d| !plain.is_empty() && among(d).is_some()),
    })
}

/// Normalises products and powers: `N m` and `N·m` become `N*m`, `m/s^2` and `m/s²` become `m/s2`.
fn normalised(name: &str) -> String {
    let mut plain = String::with_capacity(name.len());
    for word in name.split_whitespace() {
        // A space next to a sign that already joins two units is no product.
        let joined = plain.is_empty()
            || plain.ends_with(['*', '/'])
            || word.starts_with(['*', '·', '/', '^']);
        if !joined {
            plain.push('*');
        }
        for c in word.chars() {
            match c {
                '·' | '⋅' => plain.push('*'),
                '^' => {}
                '²' => plain.push('2'),
                '³' => plain.push('3'),
                '¹' => plain.push('1'),
                '⁻' | '−' => plain.push('-'),
                other => plain.push(other),
            }
        }
    }
    plain
}

/// Splits a text after its leading decimal number; `None` without one.
pub(super) fn split_number(text: &str) -> Option<(&str, &str)> {
    let bytes = text.as_bytes();
    let digits = |mut at: usize| {
        while bytes.get(at).is_some_and(u8::is_ascii_digit) {
            at += 1;
        }
        at
    };
    let sign = usize::from(matches!(bytes.first(), Some(b'+' | b'-')));
    let whole = digits(sign);
    let mut end = whole;
    let mut count = whole - sign;
    if bytes.get(end) == Some(&b'.') {
        end = digits(end + 1);
        count += end - whole - 1;
    }
    if count == 0 {
        return None;
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        let last = digits(end + 1 + sign);
        // Without a digit the `e` starts a unit.
        if last > end + 1 + sign {
            end = last;
        }
    }
    // All bytes before `end` are ASCII, so it is a boundary between characters.
    Some(text.split_at(end))
}

fn mantissa(number: &str) -> &str {
    number.split(['e', 'E']).next().unwrap_or(number)
}

/// `number * 10^power`, rounded once.
fn shifted(number: &str, power: i32) -> f64 {
    let exponent = number.split(['e', 'E']).nth(1).unwrap_or("0");
    // Beyond i32 the value is infinite or zero for any power, except for mantissas of millions of
    // digits.
    let exponent: i64 = exponent
        .parse::<i32>()
        .unwrap_or(if exponent.starts_with('-') {
            i32::MIN
        } else {
            i32::MAX
        })
        .into();
    let text = format!("{}e{}", mantissa(number), exponent + i64::from(power));
    text.parse().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn the_quantities_of_the_manual_are_read() {
        let cases = [
            ("0.5 mm", Dimension::Length, 0.0005),
            ("83.56 mm", Dimension::Length, 0.083_56),
            ("-5.13mm", Dimension::Length, -0.005_13),
            ("1 rad", Dimension::Angle, 1.0),
            ("20 kPa", Dimension::Pressure, 20e3),
            ("300 N/m", Dimension::Stiffness, 300.0),
            ("2e-4 N m", Dimension::Moment, 2e-4),
            ("2e-4 N·m", Dimension::Moment, 2e-4),
            ("2E-4Nm", Dimension::Moment, 2e-4),
            ("1060 kg/m3", Dimension::Density, 1060.0),
            ("1.06 g/cm^3", Dimension::Density, 1060.0),
            ("9.81 m/s2", Dimension::Acceleration, 9.81),
            ("9.81 m / s²", Dimension::Acceleration, 9.81),
            ("5 1/s", Dimension::Rate, 5.0),
            ("5 s⁻¹", Dimension::Rate, 5.0),
            ("60 Hz", Dimension::Rate, 60.0),
            ("5 %", Dimension::Ratio, 0.05),
            ("0.25", Dimension::Ratio, 0.25),
            ("1 kg", Dimension::Mass, 1.0),
            ("-10 N", Dimension::Force, -10.0),
            ("+.5e1 ms", Dimension::Time, 0.005),
            ("2 min", Dimension::Time, 120.0),
            ("100cc", Dimension::Volume, 1e-4),
            ("0.1 l", Dimension::Volume, 1e-4),
            ("30 cm²", Dimension::Area, 3e-3),
        ];
        for (text, dimension, expected) in cases {
            assert_eq!(
                parse(text, dimension).map(f64::to_bits),
                Ok(f64::to_bits(expected)),
                "{text}"
            );
        }
        assert_relative_eq!(
            parse("30deg", Dimension::Angle).unwrap_or(0.0),
            0.5_f64.asin(),
            max_relative = 1e-15
        );
        assert_eq!(scale("mm", Dimension::Length), Ok(1e-3));
        assert_eq!(scale("in", Dimension::Length), Ok(0.0254));
    }

    #[test]
    fn each_error_says_what_was_found_and_what_to_do() {
        let cases = [
            (
                "0.5",
                Dimension::Length,
                "`0.5` has no unit",
                "write \"0.5 mm\"; known units of length: m, dm, cm, mm, um, km, in",
            ),
            (
                "0.5 furlong",
                Dimension::Length,
                "`furlong` is not a known unit of length",
                "known units of length: m, dm, cm, mm, um, km, in",
            ),
            (
                "5 kg",
                Dimension::Angle,
                "`kg` is a unit of mass, not of angle",
                "known units of angle: rad, deg, mrad",
            ),
            (
                "5 m N",
                Dimension::Force,
                "`m N` is not a known unit of force",
                "known units of force: N, mN, uN, kN",
            ),
            (
                "long",
                Dimension::Length,
                "`long` does not begin with a number",
                "write a length as in \"0.5 mm\"",
            ),
            (
                "",
                Dimension::Rate,
                "`` does not begin with a number",
                "write a rate as in \"5 1/s\"",
            ),
            (
                "-inf m",
                Dimension::Length,
                "`-inf m` is not a finite number",
                "write a finite number",
            ),
            (
                "NaN",
                Dimension::Ratio,
                "`NaN` is not a finite number",
                "write a finite number",
            ),
            (
                "1e400 m",
                Dimension::Length,
                "`1e400 m` is too large or too small to be represented",
                "write a finite number",
            ),
            (
                "1e-400 m",
                Dimension::Length,
                "`1e-400 m` is too large or too small to be represented",
                "write a finite number",
            ),
            (
                "1e99999999999999999999 m",
                Dimension::Length,
                "`1e99999999999999999999 m` is too large or too small to be represented",
                "write a finite number",
            ),
        ];
        for (text, dimension, message, help) in cases {
            let error = parse(text, dimension).expect_err(text);
            assert_eq!(
                (error.to_string().as_str(), error.help().as_str()),
                (message, help),
                "{text}"
            );
        }
    }

    #[test]
    fn examples_are_quantities_and_no_name_means_two_units() {
        for dimension in Dimension::ALL {
            assert!(parse(dimension.example(), dimension).is_ok(), "{dimension}");
            let mut names: Vec<&str> = dimension
                .units()
                .iter()
                .flat_map(|u| u.names.iter().copied())
                .collect();
            let count = names.len();
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), count, "{dimension}");
            for name in names {
                assert_eq!(normalised(name), name, "spelling never reached");
            }
        }
    }

    #[test]
    fn zero_with_any_exponent_is_zero() {
        assert_eq!(parse("0e99999999999 m", Dimension::Length), Ok(0.0));
        assert_eq!(parse("0e-99999999999 m", Dimension::Length), Ok(0.0));
    }
}
