//! Tags of XML in sequence, without nesting in memory, so that no file can exhaust the stack.

use super::cursor::Cursor;
use super::error::{ReadError, ReadProblem};

/// The content between `<` and `>`.
#[derive(Clone, Copy)]
pub(super) struct Tag<'a> {
    pub(super) name: &'a [u8],
    attributes: &'a [u8],
    /// True if the tag begins with a slash.
    pub(super) closes: bool,
    /// True if the tag ends with a slash.
    pub(super) empty: bool,
    /// Offset of the byte after the tag.
    pub(super) end: usize,
}

impl<'a> Tag<'a> {
    /// The value of an attribute as written.
    pub(super) fn attribute(&self, name: &str) -> Option<&'a [u8]> {
        let mut rest = self.attributes;
        loop {
            let equals = rest.iter().position(|&b| b == b'=')?;
            let (key, value) = (
                rest[..equals].trim_ascii(),
                rest[equals + 1..].trim_ascii_start(),
            );
            let (&quote, value) = value.split_first()?;
            if quote != b'"' && quote != b'\'' {
                return None;
            }
            let length = value.iter().position(|&b| b == quote)?;
            if key == name.as_bytes() {
                return Some(&value[..length]);
            }
            rest = &value[length + 1..];
        }
    }
}

/// The bytes of an XML file with the read position.
pub(super) struct Xml<'a> {
    pub(super) cursor: Cursor<'a>,
    pub(super) bytes: &'a [u8],
    position: usize,
}

impl<'a> Xml<'a> {
    pub(super) fn new(name: &'a str, bytes: &'a [u8]) -> Self {
        Self {
            cursor: Cursor::new(name, bytes),
            bytes,
            position: 0,
        }
    }

    /// An error in the text of the file, at the given bytes or at the read position.
    pub(super) fn fail(&self, problem: ReadProblem, found: &[u8]) -> ReadError {
        let offset = self.cursor.offset_of(found).unwrap_or(self.position);
        self.cursor.fail_at_offset(offset, true, problem, found)
    }

    /// The next tag; declarations and comments are skipped, text between tags too.
    pub(super) fn tag(&mut self) -> Result<Option<Tag<'a>>, ReadError> {
        loop {
            let rest = &self.bytes[self.position..];
            let Some(start) = rest.iter().position(|&b| b == b'<') else {
                self.position = self.bytes.len();
                return Ok(None);
            };
            self.position += start;
            let rest = &rest[start..];
            let skipped = match rest {
                [b'<', b'?', ..] => find(rest, b"?>"),
                [b'<', b'!', b'-', b'-', ..] => {
                    rest.get(4..).and_then(|r| find(r, b"-->")).map(|n| n + 4)
                }
                [b'<', b'!', ..] => {
                    let what = "an element; document types and CDATA are not read";
                    return Err(
                        self.fail(ReadProblem::Expected { what }, &rest[..rest.len().min(9)])
                    );
                }
                _ => return self.element(rest).map(Some),
            };
            match skipped {
                Some(length) => self.position += length,
                None => {
                    return Err(self.fail(
                        ReadProblem::Truncated {
                            what: "a comment or declaration",
                        },
                        b"",
                    ));
                }
            }
        }
    }

    fn element(&mut self, rest: &'a [u8]) -> Result<Tag<'a>, ReadError> {
        let mut quote = None;
        let length = rest.iter().position(|&b| {
            match quote {
                Some(q) if q == b => quote = None,
                None if b == b'"' || b == b'\'' => quote = Some(b),
                _ => {}
            }
            quote.is_none() && b == b'>'
        });
        let Some(length) = length else {
            return Err(self.fail(ReadProblem::Truncated { what: "a tag" }, b""));
        };
        let inside = &rest[1..length];
        let (closes, inside) = inside
            .strip_prefix(b"/")
            .map_or((false, inside), |rest| (true, rest));
        let (empty, inside) = inside
            .strip_suffix(b"/")
            .map_or((false, inside), |rest| (true, rest));
        let name_length = inside
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(inside.len());
        self.position += length + 1;
        let (name, attributes) = inside.split_at(name_length);
        Ok(Tag {
            name,
            attributes,
            closes,
            empty,
            end: self.position,
        })
    }

    /// The text between a tag and the next one.
    pub(super) fn text_behind(&self, tag: &Tag<'_>) -> &'a [u8] {
        let rest = &self.bytes[tag.end..];
        &rest[..rest.iter().position(|&b| b == b'<').unwrap_or(rest.len())]
    }
}

/// The text of an attribute without the escapes of XML.
pub(super) fn unescaped(value: &[u8]) -> String {
    let mut text = String::from_utf8_lossy(value).into_owned();
    for (escape, character) in [
        ("&lt;", "<"),
        ("&gt;", ">"),
        ("&quot;", "\""),
        ("&apos;", "'"),
        ("&amp;", "&"),
    ] {
        text = text.replace(escape, character);
    }
    text
}

/// The offset after the first occurrence of `end`.
fn find(bytes: &[u8], end: &[u8]) -> Option<usize> {
    bytes
        .windows(end.len())
        .position(|w| w == end)
        .map(|n| n + end.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_attributes_and_comments() {
        let text = b"<?xml a='<'?><!-- <b> --><a x = \"1>2\" y='\"'>text<c/></a>";
        let mut xml = Xml::new("", text);
        let a = xml.tag().unwrap().unwrap();
        assert_eq!(
            (a.name, a.attribute("x"), a.attribute("y")),
            (&b"a"[..], Some(&b"1>2"[..]), Some(&b"\""[..]))
        );
        assert_eq!(
            (a.attribute("z"), xml.text_behind(&a)),
            (None, &b"text"[..])
        );
        let c = xml.tag().unwrap().unwrap();
        assert!(c.empty && !c.closes && c.name == b"c");
        assert!(xml.tag().unwrap().unwrap().closes);
        assert!(xml.tag().unwrap().is_none());
        let bare = Xml::new("", b"<a x=1 y='1'>").tag().unwrap().unwrap();
        assert_eq!(
            (bare.attribute("x"), bare.attribute("y")),
            (None, None),
            "a value without quotes"
        );
        for wrong in ["<a", "<a x=\">", "<!-- x", "<?xml", "<!DOCTYPE a>"] {
            assert!(Xml::new("", wrong.as_bytes()).tag().is_err(), "{wrong}");
        }
    }

    #[test]
    fn nesting_costs_nothing() {
        let deep = "<a>".repeat(200_000);
        let mut xml = Xml::new("", deep.as_bytes());
        let mut count = 0;
        while xml.tag().unwrap().is_some() {
            count += 1;
        }
        assert_eq!(count, 200_000);
    }
}
