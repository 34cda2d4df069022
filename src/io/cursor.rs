//! A position in the bytes of a file with its line number, for readers of text and of binary data.

use super::error::{A_NUMBER, FilePlace, ReadError, ReadProblem, quote};

/// Greatest line length of formats that are read by lines [bytes]: enough for a million corners,
/// too little for a damaged file.
pub(crate) const MAX_LINE_BYTES: usize = 1 << 20;

/// The bytes of a file with the read position.
///
/// `mark` and `mark_line` are the start of the last item, so that an error names that item and not
/// the following one.
#[derive(Clone, Copy)]
pub(crate) struct Cursor<'a> {
    name: &'a str,
    bytes: &'a [u8],
    position: usize,
    line: usize,
    mark: usize,
    mark_line: usize,
    /// If true, errors name an offset instead of a line.
    pub(crate) binary: bool,
}

impl<'a> Cursor<'a> {
    /// Starts at the beginning of a text.
    pub(crate) fn new(name: &'a str, bytes: &'a [u8]) -> Self {
        Self {
            name,
            bytes,
            position: 0,
            line: 1,
            mark: 0,
            mark_line: 1,
            binary: false,
        }
    }

    /// The unread bytes.
    pub(crate) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.position..).unwrap_or_default()
    }

    /// Number of bytes read.
    pub(crate) fn position(&self) -> usize {
        self.position
    }

    fn set_mark(&mut self) {
        self.mark = self.position;
        self.mark_line = self.line;
    }

    /// Moves past one byte; a lone CR, a lone LF and the pair each end one line.
    fn step(&mut self) {
        let here = self.bytes.get(self.position).copied();
        let next = self.bytes.get(self.position + 1).copied();
        if here == Some(b'\n') || (here == Some(b'\r') && next != Some(b'\n')) {
            self.line += 1;
        }
        self.position += 1;
    }

    /// The next line without its end; `None` at the end of the file.
    pub(crate) fn next_line(&mut self) -> Option<&'a [u8]> {
        self.set_mark();
        let rest = self.rest();
        if rest.is_empty() {
            return None;
        }
        let length = rest
            .iter()
            .position(|&b| b == b'\n' || b == b'\r')
            .unwrap_or(rest.len());
        self.position += length;
        match rest.get(length..length + 2) {
            Some(b"\r\n") => self.position += 2,
            _ if length < rest.len() => self.position += 1,
            _ => {}
        }
        self.line += 1;
        Some(&rest[..length])
    }

    /// The same as [`Self::next_line`], for lines with content: rejects bytes that no text
    /// contains.
    pub(crate) fn text_line(&mut self) -> Result<Option<&'a [u8]>, ReadError> {
        let Some(line) = self.next_line() else {
            return Ok(None);
        };
        let (bytes, limit) = (line.len(), MAX_LINE_BYTES);
        if bytes > limit {
            return Err(self.fail(ReadProblem::LineTooLong { bytes, limit }, line));
        }
        // Much faster than a search for the position, which hardly any file needs.
        if !line.contains(&0) {
            return Ok(Some(line));
        }
        let at = line.iter().position(|&b| b == 0).unwrap_or(0);
        Err(self.fail(ReadProblem::NulByte, &line[at..]))
    }

    /// The next word between white space; `None` at the end of the file.
    pub(crate) fn token(&mut self) -> Option<&'a [u8]> {
        while self.rest().first().is_some_and(u8::is_ascii_whitespace) {
            self.step();
        }
        self.set_mark();
        let rest = self.rest();
        let length = rest
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(rest.len());
        self.position += length;
        if length == 0 {
            None
        } else {
            Some(&rest[..length])
        }
    }

    /// Skips words; the last one is the item of the next error.
    pub(crate) fn skip_tokens(&mut self, count: usize) {
        for _ in 0..count {
            if self.token().is_none() {
                return;
            }
        }
    }

    /// Skips lines.
    pub(crate) fn skip_lines(&mut self, count: usize) {
        for _ in 0..count {
            if self.next_line().is_none() {
                return;
            }
        }
    }

    /// The next word, without reading it.
    pub(crate) fn peek(&self) -> Option<&'a [u8]> {
        let mut ahead = *self;
        ahead.token()
    }

    /// The next `count` bytes of binary data.
    pub(crate) fn take(&mut self, count: usize, what: &'static str) -> Result<&'a [u8], ReadError> {
        self.set_mark();
        match self.rest().get(..count) {
            Some(bytes) => {
                self.position += count;
                Ok(bytes)
            }
            None => Err(self.fail(ReadProblem::Truncated { what }, b"")),
        }
    }

    /// Moves the mark to an offset for the next error.
    pub(crate) fn mark_at(&mut self, offset: usize) {
        self.mark = offset;
    }

    /// Place of the last item.
    pub(crate) fn place(&self) -> FilePlace {
        if self.binary {
            FilePlace::Offset(self.mark)
        } else {
            FilePlace::Line(self.mark_line)
        }
    }

    /// An error at the last item.
    pub(crate) fn fail(&self, problem: ReadProblem, found: &[u8]) -> ReadError {
        self.fail_at(self.place(), problem, found)
    }

    /// An error at a place.
    pub(crate) fn fail_at(
        &self,
        place: FilePlace,
        problem: ReadProblem,
        found: &[u8],
    ) -> ReadError {
        let column = if matches!(place, FilePlace::Line(_)) {
            self.column(found)
        } else {
            None
        };
        let (file, within, found) = (self.name.into(), "".into(), quote(found).into());
        ReadError::Content {
            file,
            place,
            column,
            read_as: None,
            problem,
            within,
            found,
        }
    }

    /// An error at an offset of text or, where `text` is false, of binary data.
    pub(crate) fn fail_at_offset(
        &self,
        offset: usize,
        text: bool,
        problem: ReadProblem,
        found: &[u8],
    ) -> ReadError {
        self.fail_at(self.place_of(offset, text), problem, found)
    }

    /// The place of an offset of text or, where `text` is false, of binary data.
    pub(crate) fn place_of(&self, offset: usize, text: bool) -> FilePlace {
        if !text {
            return FilePlace::Offset(offset);
        }
        let mut ahead = Cursor::new(self.name, &self.bytes[..offset.min(self.bytes.len())]);
        while ahead.position < ahead.bytes.len() {
            ahead.step();
        }
        FilePlace::Line(ahead.line)
    }

    /// Offset of a part of the file; `None` for bytes outside the file.
    pub(crate) fn offset_of(&self, part: &[u8]) -> Option<usize> {
        let offset = (part.as_ptr() as usize).checked_sub(self.bytes.as_ptr() as usize)?;
        (!part.is_empty() && offset + part.len() <= self.bytes.len()).then_some(offset)
    }

    /// Start column of a part of the file, in characters from 1.
    fn column(&self, part: &[u8]) -> Option<u32> {
        let before = &self.bytes[..self.offset_of(part)?];
        let start = before
            .iter()
            .rposition(|&b| b == b'\n' || b == b'\r')
            .map_or(0, |i| i + 1);
        // A continuation byte of UTF-8 does not start a character.
        u32::try_from(
            before[start..]
                .iter()
                .filter(|&&b| b & 0xc0 != 0x80)
                .count()
                + 1,
        )
        .ok()
    }
}

/// A coordinate of vertex `vertex` in a text; rejects NaN, infinities and overflow.
pub(crate) fn coordinate(token: &[u8], vertex: usize) -> Result<f64, ReadProblem> {
    let value = number(token)?;
    if value.is_infinite() && beyond_double(token, value) {
        return Err(ReadProblem::Overflow { vertex });
    }
    finite(value, vertex)
}

/// Rejects NaN and infinities.
pub(crate) fn finite(value: f64, vertex: usize) -> Result<f64, ReadProblem> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(ReadProblem::NotFinite { vertex })
    }
}

/// True if a number of text is outside the range of a double: its value became infinite or 0.
pub(crate) fn beyond_double(token: &[u8], value: f64) -> bool {
    let mut mantissa = token.iter().take_while(|b| !b.eq_ignore_ascii_case(&b'e'));
    (value == 0.0 || value.is_infinite()) && mantissa.any(|b| (b'1'..=b'9').contains(b))
}

/// A real number in a text.
pub(crate) fn number(token: &[u8]) -> Result<f64, ReadProblem> {
    let text = std::str::from_utf8(token).map_err(|_| ReadProblem::Expected { what: A_NUMBER })?;
    text.parse()
        .map_err(|_| match text.replacen(',', ".", 1).parse::<f64>() {
            _ if token.contains(&0) => ReadProblem::NulByte,
            Ok(_) => ReadProblem::DecimalComma,
            Err(_) => ReadProblem::Expected { what: A_NUMBER },
        })
}

/// An integer in a text; an integer beyond 64 bits is an error, never wrapped.
pub(crate) fn integer(token: &[u8]) -> Result<i64, ReadProblem> {
    // Nearly all integers are short and have no sign; eighteen digits stay below 2^63.
    if (1..=18).contains(&token.len()) && token.iter().all(u8::is_ascii_digit) {
        return Ok(token.iter().fold(0, |n, b| 10 * n + i64::from(b - b'0')));
    }
    let text = std::str::from_utf8(token).unwrap_or_default();
    text.parse().map_err(|_| {
        let digits = token
            .strip_prefix(b"-")
            .or(token.strip_prefix(b"+"))
            .unwrap_or(token);
        match digits {
            // The only possible defect is the number of digits.
            [_, ..] if digits.iter().all(u8::is_ascii_digit) => ReadProblem::IntegerTooLarge,
            _ if digits.contains(&0) => ReadProblem::NulByte,
            _ => ReadProblem::Expected {
                what: "a whole number",
            },
        }
    })
}

/// A non-negative count in a text; `what` describes the expected item in the error.
pub(crate) fn count(token: &[u8], what: &'static str) -> Result<u64, ReadProblem> {
    match integer(token) {
        Ok(count) => u64::try_from(count).map_err(|_| ReadProblem::Expected { what }),
        Err(ReadProblem::IntegerTooLarge) => Err(ReadProblem::IntegerTooLarge),
        Err(_) => Err(ReadProblem::Expected { what }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_line_ends_count_once() {
        let mut cursor = Cursor::new("", b"a\rb\r\nc\nd");
        for (line, text) in [b"a", b"b", b"c", b"d"].iter().enumerate() {
            assert_eq!(cursor.next_line(), Some(&text[..]));
            assert_eq!(cursor.place(), FilePlace::Line(line + 1));
        }
        assert_eq!(cursor.next_line(), None);
        let mut cursor = Cursor::new("", b"a\rb\r\nc\n \n d");
        let places: Vec<FilePlace> =
            std::iter::from_fn(|| cursor.token().is_some().then(|| cursor.place())).collect();
        assert_eq!(places, [1, 2, 3, 5].map(FilePlace::Line));
    }

    #[test]
    fn what_is_skipped_ends_with_the_file() {
        let mut cursor = Cursor::new("", b"a b\nc\nd");
        cursor.skip_tokens(2);
        assert_eq!(cursor.peek(), Some(&b"c"[..]));
        cursor.skip_lines(2);
        assert_eq!(cursor.peek(), Some(&b"d"[..]));
        let mut lines = cursor;
        cursor.skip_tokens(usize::MAX);
        lines.skip_lines(usize::MAX);
        assert_eq!(
            [cursor, lines].map(|c| (c.position(), c.place())),
            [(7, FilePlace::Line(3)), (7, FilePlace::Line(4))]
        );
    }

    #[test]
    fn a_part_of_the_file_has_a_column() {
        let text = "v 1\n\u{e9} x 2";
        let cursor = Cursor::new("a", text.as_bytes());
        let error = cursor.fail_at_offset(7, true, ReadProblem::NulByte, &text.as_bytes()[7..8]);
        assert!(
            error.terse().starts_with("a:2:3: error[E006]"),
            "{}",
            error.terse()
        );
        let elsewhere = cursor.fail_at_offset(7, true, ReadProblem::NulByte, b"x");
        assert!(
            elsewhere.terse().starts_with("a:2: error[E006]"),
            "{}",
            elsewhere.terse()
        );
        assert_eq!(cursor.offset_of(b""), None);
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        assert_eq!(coordinate(b"1,5", 0), Err(ReadProblem::DecimalComma));
        assert_eq!(
            coordinate(b"nan", 3),
            Err(ReadProblem::NotFinite { vertex: 3 })
        );
        assert_eq!(
            coordinate(b"1e400", 3),
            Err(ReadProblem::Overflow { vertex: 3 })
        );
        assert_eq!(
            coordinate(b"-inf", 3),
            Err(ReadProblem::NotFinite { vertex: 3 })
        );
        assert_eq!(coordinate(b"1e-400", 0), Ok(0.0));
        assert_eq!(coordinate(b"-2.e1", 0), Ok(-20.0));
        assert!(coordinate(b"x", 0).is_err());
        for (token, beyond) in [
            (&b"1e-400"[..], true),
            (b"0e-400", false),
            (b"-0", false),
            (b"0.0001E-400", true),
        ] {
            assert_eq!(beyond_double(token, 0.0), beyond);
        }
        assert_eq!(
            integer(b"-99999999999999999999"),
            Err(ReadProblem::IntegerTooLarge)
        );
        assert_eq!(integer(b"1\0"), Err(ReadProblem::NulByte));
        for token in [&[0xff][..], b"", b"-", b"1.0"] {
            assert_eq!(
                integer(token),
                Err(ReadProblem::Expected {
                    what: "a whole number"
                })
            );
        }
        assert_eq!(
            count(b"99999999999999999999", "x"),
            Err(ReadProblem::IntegerTooLarge)
        );
        assert_eq!(count(b"-1", "x"), Err(ReadProblem::Expected { what: "x" }));
    }
}
