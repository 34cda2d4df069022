//! Warnings of readers: accepted content that is possibly a mistake, counted, with the first place.

use std::fmt;

use super::Format;
use super::error::{FilePlace, placed};

/// Accepted content that is possibly a mistake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Warning {
    /// W001: a coordinate of text underflowed to 0 as a double.
    Underflow,
    /// W002: a polygon whose fan is only one of several surfaces with its outline;
    /// `docs/formats.md` describes the test.
    NotFlatOrConvex,
    /// W003: a triangle with a repeated vertex was left out: it encloses nothing and its edges
    /// cancel.
    RepeatedCorner,
    /// W010: the file name has the extension of another format than the content.
    OtherFormat {
        /// The format of the extension.
        promised: Format,
        /// The format of the content.
        found: Format,
    },
}

impl Warning {
    /// The code, equal for all warnings of one kind.
    pub fn code(&self) -> &'static str {
        match self {
            Warning::Underflow => "W001",
            Warning::NotFlatOrConvex => "W002",
            Warning::RepeatedCorner => "W003",
            Warning::OtherFormat { .. } => "W010",
        }
    }
}

impl Warning {
    /// Advice for the user.
    pub fn help(&self) -> &'static str {
        match self {
            Warning::Underflow => "give such coordinates a larger unit if they matter",
            Warning::NotFlatOrConvex => "export triangles if another split is meant",
            Warning::RepeatedCorner => "nothing is lost: it had no area",
            Warning::OtherFormat { .. } => "rename the file",
        }
    }
}

/// A warning with its count and first place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Warned {
    /// The kind of warning.
    pub warning: Warning,
    /// Number of occurrences.
    pub count: usize,
    /// Place of the first occurrence.
    pub first: FilePlace,
}

impl Warned {
    /// One line, `file:line: warning[W002]: 3 polygons are ...`.
    pub fn terse(&self, file: &str) -> String {
        format!(
            "{} warning[{}]: {self}",
            placed(file, &self.first, None),
            self.warning.code()
        )
    }
}

impl fmt::Display for Warned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.count;
        let say =
            |one: &str, many: &str| format!("{count} {}", if count == 1 { one } else { many });
        match self.warning {
            Warning::Underflow => f.write_str(&say(
                "coordinate too small for a double became 0",
                "coordinates too small for a double became 0",
            )),
            Warning::NotFlatOrConvex => f.write_str(&say(
                "polygon is not flat or not convex: its split is a fan around its first corner",
                "polygons are not flat or not convex: their split is a fan around the first corner",
            )),
            Warning::RepeatedCorner => f.write_str(&say(
                "triangle that names a vertex twice was left out",
                "triangles that name a vertex twice were left out",
            )),
            Warning::OtherFormat { promised, found } => {
                write!(
                    f,
                    "the name says {}, the content is {}",
                    promised.name(),
                    found.name()
                )
            }
        }
    }
}

/// The warnings of a file, each kind once, in the order of their codes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Warnings(Vec<Warned>);

impl Warnings {
    /// All warnings with occurrences.
    pub fn iter(&self) -> impl Iterator<Item = &Warned> {
        self.0.iter()
    }

    /// Number of occurrences of a warning.
    pub fn count(&self, warning: Warning) -> usize {
        self.0
            .iter()
            .find(|w| w.warning == warning)
            .map_or(0, |w| w.count)
    }

    /// True if there is no warning.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Counts a warning. The place is computed only for the first of its kind, because it can be a
    /// search.
    pub(super) fn note(&mut self, warning: Warning, place: &dyn Fn() -> FilePlace) {
        match self.0.iter_mut().find(|w| w.warning == warning) {
            Some(warned) => warned.count += 1,
            None => {
                let at = self
                    .0
                    .partition_point(|w| w.warning.code() < warning.code());
                self.0.insert(
                    at,
                    Warned {
                        warning,
                        count: 1,
                        first: place(),
                    },
                );
            }
        }
    }

    /// The same as [`Self::note`], for a place that can precede a known one.
    pub(super) fn note_late(&mut self, warning: Warning, place: FilePlace) {
        self.note(warning, &|| place);
        if let Some(warned) = self.0.iter_mut().find(|w| w.warning == warning) {
            warned.first = warned.first.min(place);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_counted_with_its_first_place() {
        let mut warnings = Warnings::default();
        let other = Warning::OtherFormat {
            promised: Format::Obj,
            found: Format::Ply,
        };
        warnings.note(other, &|| FilePlace::Whole);
        for line in [7, 3] {
            warnings.note(Warning::RepeatedCorner, &|| FilePlace::Line(line));
        }
        warnings.note(Warning::Underflow, &|| FilePlace::Offset(16));
        let lines: Vec<String> = warnings.iter().map(|w| w.terse("a.obj")).collect();
        let expected = [
            "a.obj: offset 0x10: warning[W001]: 1 coordinate too small for a double became 0",
            "a.obj:7: warning[W003]: 2 triangles that name a vertex twice were left out",
            "a.obj: warning[W010]: the name says OBJ, the content is PLY",
        ];
        assert_eq!(lines, expected);
        assert_eq!(
            (
                warnings.count(Warning::RepeatedCorner),
                warnings.count(Warning::NotFlatOrConvex)
            ),
            (2, 0)
        );
        let all = [
            Warning::Underflow,
            Warning::NotFlatOrConvex,
            Warning::RepeatedCorner,
            other,
        ];
        let help = [
            "give such coordinates a larger unit if they matter",
            "export triangles if another split is meant",
            "nothing is lost: it had no area",
            "rename the file",
        ];
        assert_eq!(all.map(|warning| warning.help()), help);
    }
}
