//! An error of a mesh file with the source line, read again from the file, for the terminal.

use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;

use miette::{
    Diagnostic, LabeledSpan, MietteError, MietteSpanContents, SourceCode, SourceSpan, SpanContents,
};

use pliant::io::{FilePlace, MAX_FILE_BYTES, ReadError};

/// Greatest number of displayed characters of a line, around the column if known.
const SHOWN_CHARACTERS: usize = 100;

/// Greatest number of displayed bytes of binary data.
const SHOWN_BYTES: usize = 16;

/// An error of reading with its source, if it can be read again.
#[derive(Debug)]
pub(super) struct Excerpt<'a> {
    error: &'a ReadError,
    line: Option<Line>,
    bytes: Option<String>,
}

impl<'a> Excerpt<'a> {
    /// Reads the source of an error again, without unreadable parts.
    pub(super) fn of(error: &'a ReadError) -> Self {
        let mut excerpt = Self {
            error,
            line: None,
            bytes: None,
        };
        if let ReadError::Content {
            file,
            place,
            column,
            found,
            ..
        } = error
        {
            match *place {
                FilePlace::Whole => {}
                FilePlace::Line(line) => {
                    excerpt.line = Line::read(file, line, *column, found).ok().flatten()
                }
                FilePlace::Offset(offset) => {
                    excerpt.bytes = hexadecimal(Path::new(&**file), offset as u64).ok()
                }
            }
        }
        excerpt
    }
}

impl fmt::Display for Excerpt<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.line, &self.bytes) {
            // The line shows the place and the bytes found.
            (Some(_), _) => f.write_str(&self.error.message()),
            (None, Some(bytes)) => write!(f, "{}\n{bytes}", self.error),
            (None, None) => self.error.fmt(f),
        }
    }
}

impl std::error::Error for Excerpt<'_> {}

impl Diagnostic for Excerpt<'_> {
    fn code<'b>(&'b self) -> Option<Box<dyn fmt::Display + 'b>> {
        Some(Box::new(self.error.code()))
    }

    fn help<'b>(&'b self) -> Option<Box<dyn fmt::Display + 'b>> {
        Some(Box::new(self.error.help()))
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.line.as_ref().map(|line| line as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let line = self.line.as_ref()?;
        let label = LabeledSpan::new_with_span(Some("here".to_owned()), line.span.clone());
        Some(Box::new(std::iter::once(label)))
    }
}

/// A line of a file, cut around a column, printable.
#[derive(Debug)]
struct Line {
    file: String,
    text: String,
    /// Line number, from 1.
    number: usize,
    /// First character of the label, from 1, in the line of the file.
    column: usize,
    /// The label, in bytes of `text`.
    span: Range<usize>,
}

impl Line {
    /// Reads a line, counted like the readers of meshes; `None` if the file has fewer lines, or the
    /// line is empty.
    fn read(
        file: &str,
        number: usize,
        column: Option<u32>,
        found: &str,
    ) -> io::Result<Option<Self>> {
        let mut reader = open(Path::new(file))?;
        let column = column.map(|c| c as usize);
        let first = column.map_or(0, |c| c.saturating_sub(SHOWN_CHARACTERS / 2));
        if !skip_lines(&mut reader, number - 1)? {
            return Ok(None);
        }
        let (bytes, more) = characters(&mut reader, first..first + SHOWN_CHARACTERS)?;
        // A control character occupies one column, so that the label stays under its word.
        let printable = |c: char| {
            if c == '\t' {
                ' '
            } else if c.is_control() {
                '\u{fffd}'
            } else {
                c
            }
        };
        let body: String = String::from_utf8_lossy(&bytes)
            .chars()
            .map(printable)
            .collect();
        let (before, after) = (
            if first > 0 { "…" } else { "" },
            if more { "…" } else { "" },
        );
        let text = format!("{before}{body}{after}");
        if body.trim().is_empty() {
            return Ok(None);
        }
        let whole = found.trim_end_matches('…');
        let start = match column {
            Some(column) => body
                .char_indices()
                .nth(column - 1 - first)
                .map(|(at, _)| at),
            // The location of an index that was checked later is known only from its text.
            None => body.find(whole).filter(|_| !whole.is_empty()),
        };
        let length = match start {
            Some(at) if !whole.is_empty() && body[at..].starts_with(whole) => whole.len(),
            Some(at) => body[at..].chars().next().map_or(0, char::len_utf8),
            None => body.len(),
        };
        let start = start.unwrap_or(0);
        let column = first + body[..start].chars().count() + 1;
        let span = before.len() + start..before.len() + start + length;
        Ok(Some(Self {
            file: file.to_owned(),
            text,
            number,
            column,
            span,
        }))
    }
}

impl SourceCode for Line {
    fn read_span<'a>(
        &'a self,
        span: &SourceSpan,
        lines_before: usize,
        lines_after: usize,
    ) -> Result<Box<dyn SpanContents<'a> + 'a>, MietteError> {
        let own = self.text.read_span(span, lines_before, lines_after)?;
        let (line, column, count) = (self.number - 1, self.column - 1, own.line_count());
        Ok(Box::new(MietteSpanContents::new_named(
            self.file.clone(),
            own.data(),
            *own.span(),
            line,
            column,
            count,
        )))
    }
}

/// Opens a file for a second reading. Other kinds of files can be read only once.
fn open(path: &Path) -> io::Result<BufReader<io::Take<File>>> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(io::Error::other("no plain file"));
    }
    let mut reader = BufReader::new(File::open(path)?.take(MAX_FILE_BYTES));
    // The byte order mark of UTF-8 is not part of the first line.
    if reader.fill_buf()?.starts_with(b"\xef\xbb\xbf") {
        reader.consume(3);
    }
    Ok(reader)
}

/// Skips lines; a lone CR, a lone LF and the pair each end one. Returns false if there are fewer.
fn skip_lines(reader: &mut impl BufRead, mut count: usize) -> io::Result<bool> {
    let mut after_return = false;
    loop {
        let buffer = reader.fill_buf()?;
        let (mut used, length) = (0, buffer.len());
        for &byte in buffer {
            let second_half = after_return && byte == b'\n';
            if count == 0 && !second_half {
                break;
            }
            if matches!(byte, b'\r' | b'\n') && !second_half {
                count -= 1;
            }
            after_return = byte == b'\r';
            used += 1;
        }
        reader.consume(used);
        if length == 0 || used < length {
            return Ok(count == 0);
        }
    }
}

/// The bytes of a range of characters of a line, and whether the line continues.
fn characters(reader: &mut impl BufRead, range: Range<usize>) -> io::Result<(Vec<u8>, bool)> {
    let (mut bytes, mut count) = (Vec::new(), 0);
    loop {
        let buffer = reader.fill_buf()?;
        for &byte in buffer {
            if matches!(byte, b'\r' | b'\n') {
                return Ok((bytes, false));
            }
            // A continuation byte of UTF-8 starts no character. A file of only such bytes must not
            // fill the memory.
            count += usize::from(byte & 0xc0 != 0x80);
            if count > range.end || bytes.len() > 4 * SHOWN_CHARACTERS {
                return Ok((bytes, true));
            }
            if count > range.start {
                bytes.push(byte);
            }
        }
        let length = buffer.len();
        if length == 0 {
            return Ok((bytes, false));
        }
        reader.consume(length);
    }
}

/// A few bytes as `0x50: ff ff`.
fn hexadecimal(path: &Path, offset: u64) -> io::Result<String> {
    let mut file = open(path)?.into_inner().into_inner();
    file.seek(SeekFrom::Start(offset))?;
    let mut bytes = Vec::new();
    file.take(SHOWN_BYTES as u64).read_to_end(&mut bytes)?;
    if bytes.is_empty() {
        return Ok("the file ends there".to_owned());
    }
    let words: Vec<String> = bytes.iter().map(|b| format!("{b:02x}")).collect();
    Ok(format!("{offset:#x}: {}", words.join(" ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::failure::graphical;
    use pliant::testing::Scratch;

    /// The displayed error of a file with these bytes, without the folder.
    fn shown(name: &str, bytes: &[u8]) -> String {
        let path = Scratch::file(name);
        std::fs::write(&path, bytes).unwrap();
        let error = pliant::io::read(&path).unwrap_err();
        let handler = miette::GraphicalReportHandler::new_themed(miette::GraphicalTheme::none())
            .with_width(200);
        let text = graphical(&Excerpt::of(&error), &handler).unwrap();
        text.replace(&path.display().to_string(), name)
    }

    #[test]
    fn a_word_of_a_text_has_a_caret() {
        let expected = "E011

  x expected a number
   ,-[a.obj:3:5]
 3 | v 1 \u{e9} 2x 3
   :     |
   :     `-- here
   `----
  help: the file is cut off, damaged or of another dialect: export it again";
        let text = shown(
            "a.obj",
            "v 0 0 0\r\nv 1 0 0\rv 1 \u{e9} 2x 3\nf 1 2 3\n".as_bytes(),
        );
        assert_eq!(text, expected);
        // The byte order mark of UTF-8 and tabs do not move the caret; the content is described.
        let marked = shown("b.ply", "\u{feff}v\t0 0 0\nv\t1\t1,5 3\n".as_bytes());
        assert!(
            marked.contains("x not a number; decimal comma? Write a point; the content is OBJ"),
            "{marked}"
        );
        assert!(
            marked.contains(",-[b.ply:2:5]\n 2 | v 1 1,5 3\n   :     ^|^\n"),
            "{marked}"
        );
    }

    #[test]
    fn an_index_that_was_looked_up_later_is_found_in_its_line() {
        let text = shown("late.obj", b"v 0 0 0\nf 1 2 3\nv 1 0 0\n");
        assert!(
            text.contains(",-[late.obj:2:7]\n 2 | f 1 2 3\n   :       |\n"),
            "{text}"
        );
    }

    #[test]
    fn a_long_line_is_cut_around_its_column() {
        let long = format!(
            "v 0 0 0\n#{}\nf {}x 1\n",
            "-".repeat(9000),
            "1 ".repeat(9000)
        );
        let text = shown("long.obj", long.as_bytes());
        let line = text.lines().find(|l| l.starts_with(" 3 | ")).unwrap();
        assert!(
            line.starts_with(" 3 | … 1 1") && line.ends_with("1 x 1") && line.chars().count() < 120,
            "{text}"
        );
        assert!(text.contains(",-[long.obj:3:18003]"), "{text}");
    }

    #[test]
    fn binary_data_are_shown_as_bytes() {
        let mut stl = [b' '; 134];
        stl[80..84].copy_from_slice(&9u32.to_le_bytes());
        let text = shown("a.stl", &stl);
        let head = "E040

  x a.stl: offset 0x50: 9 items are declared, but the file has room for at most 1
  | 0x50: 09 00 00 00 20 20 20 20 20 20 20 20 20 20 20 20
  help: ";
        assert!(text.starts_with(head), "{text}");
    }

    #[test]
    fn what_has_no_line_names_its_file() {
        assert!(
            shown("none.obj", b"# nothing\n").contains("x none.obj: the file has no vertices\n")
        );
        let cut = shown("cut.off", b"OFF\n3 1 0\n0 0 0\n0 0 0\n0 0 0\n");
        assert!(
            cut.contains("x cut.off:6: the file ends too early, in the faces\n"),
            "{cut}"
        );
        let error = pliant::io::read(Path::new("no/such.obj")).unwrap_err();
        assert!(
            Excerpt::of(&error)
                .to_string()
                .starts_with("no/such.obj: cannot be read: ")
        );
        assert!(
            open(&std::env::temp_dir()).is_err(),
            "control: a folder is no plain file"
        );
    }
}
