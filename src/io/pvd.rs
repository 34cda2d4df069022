//! The ParaView collection (`.pvd`): the file of each part at each time.

use std::io::{self, Write};
use std::path::{Component, Path};

use super::cursor::{count, number};
use super::error::{ReadError, ReadProblem};
use super::part::{invalid, write_whole};
use super::vtp::escape;
use super::xml::{Tag, Xml, unescaped};
use super::{MAX_FILE_BYTES, bytes_of};

/// The expected start of a collection.
const ROOT: &str = "a collection of ParaView, VTKFile of type Collection";

/// One file of a collection.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Time [s].
    pub time: f64,
    /// Index of the part, from 0.
    pub part: usize,
    /// Name of the part.
    pub name: String,
    /// The file, relative to the folder of the collection, with `/` between folders.
    pub file: String,
}

/// The files of a run, for ParaView; the collection can be rewritten after each frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Collection {
    entries: Vec<Entry>,
}

impl Collection {
    /// A collection without files.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a file.
    pub fn push(&mut self, entry: Entry) {
        self.entries.push(entry);
    }

    /// The files added so far, in order.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Keeps only the first `count` files.
    pub fn truncate(&mut self, count: usize) {
        self.entries.truncate(count);
    }

    /// Writes all entries to `path` through `NAME.part`, so that ParaView never reads an incomplete
    /// file.
    ///
    /// # Errors
    /// A time that is not finite, and errors of the operating system.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        if let Some(entry) = self.entries.iter().find(|e| !e.time.is_finite()) {
            return Err(invalid(format!(
                "the time of {} is {}, which is not finite",
                entry.file, entry.time
            )));
        }
        write_whole(path, |w| self.write_to(w))
    }

    /// The entries of each time, in order.
    pub fn times(&self) -> impl Iterator<Item = &[Entry]> {
        self.entries.chunk_by(|a, b| a.time == b.time)
    }

    /// Writes all entries; their times must be finite.
    pub(crate) fn write_to(&self, w: &mut impl Write) -> io::Result<()> {
        writeln!(w, "<?xml version=\"1.0\"?>")?;
        writeln!(
            w,
            "<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n  <Collection>"
        )?;
        for Entry {
            time,
            part,
            name,
            file,
        } in &self.entries
        {
            let (name, file) = (escape(name), escape(file));
            writeln!(
                w,
                "    <DataSet timestep=\"{time:?}\" group=\"\" part=\"{part}\" name=\"{name}\" file=\"{file}\"/>"
            )?;
        }
        writeln!(w, "  </Collection>\n</VTKFile>")
    }
}

/// Writes a multi-block file (`.vtm`) of the parts at one time, whose files are in `folder` beside it
/// (`frames/`), or anywhere if this is empty. ParaView shows the names of its blocks, and none of a
/// collection.
///
/// # Errors
/// Those of `w`.
pub fn write_blocks(entries: &[Entry], folder: &str, w: &mut impl Write) -> io::Result<()> {
    writeln!(w, "<?xml version=\"1.0\"?>")?;
    writeln!(
        w,
        "<VTKFile type=\"vtkMultiBlockDataSet\" version=\"1.0\" byte_order=\"LittleEndian\">\n  <vtkMultiBlockDataSet>"
    )?;
    for (index, Entry { name, file, .. }) in entries.iter().enumerate() {
        let file = file.strip_prefix(folder).unwrap_or(file);
        let (name, file) = (escape(name), escape(file));
        writeln!(
            w,
            "    <DataSet index=\"{index}\" name=\"{name}\" file=\"{file}\"/>"
        )?;
    }
    writeln!(w, "  </vtkMultiBlockDataSet>\n</VTKFile>")
}

/// Reads a collection, without its files.
///
/// # Errors
/// A file that cannot be read or is no collection, a time that is not finite, a file outside the
/// folder of the collection.
pub fn read(path: &Path) -> Result<Collection, ReadError> {
    read_bytes(
        &bytes_of(path, MAX_FILE_BYTES)?,
        &path.display().to_string(),
    )
}

/// Reads a collection from the bytes of a file; `name` appears in errors.
///
/// # Errors
/// Those of [`read`] without those of the file system.
pub fn read_bytes(bytes: &[u8], name: &str) -> Result<Collection, ReadError> {
    let mut xml = Xml::new(name, bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes));
    let mut collection = Collection::new();
    let (mut begun, mut ended) = (false, false);
    while let Some(tag) = xml.tag()? {
        if !begun {
            let kind = tag.attribute("type").unwrap_or_default();
            if tag.name != b"VTKFile" || kind != b"Collection" {
                let found = if kind.is_empty() { tag.name } else { kind };
                return Err(xml.fail(ReadProblem::Expected { what: ROOT }, found));
            }
            begun = true;
        }
        match tag.name {
            b"DataSet" if !tag.closes => collection.push(entry(&xml, &tag)?),
            b"Collection" if tag.closes || tag.empty => ended = true,
            _ => {}
        }
    }
    match (begun, ended) {
        (true, true) => Ok(collection),
        (true, false) => Err(xml.fail(
            ReadProblem::Truncated {
                what: "the element Collection",
            },
            b"",
        )),
        (false, _) if xml.bytes.is_empty() => Err(xml.fail(ReadProblem::Empty, b"")),
        (false, _) => Err(xml.fail(ReadProblem::Expected { what: ROOT }, b"")),
    }
}

fn entry(xml: &Xml<'_>, tag: &Tag<'_>) -> Result<Entry, ReadError> {
    let expected = |what, found: &[u8]| xml.fail(ReadProblem::Expected { what }, found);
    let (Some(time_word), Some(file_word)) = (tag.attribute("timestep"), tag.attribute("file"))
    else {
        return Err(expected(
            "a DataSet with the attributes timestep and file",
            tag.name,
        ));
    };
    let time_word = time_word.trim_ascii();
    let time = number(time_word).map_err(|problem| xml.fail(problem, time_word))?;
    if !time.is_finite() {
        return Err(expected("a time that is finite", time_word));
    }
    let part = match tag.attribute("part").map(<[u8]>::trim_ascii) {
        None | Some(b"") => 0,
        Some(word) => {
            let part =
                count(word, "the number of a part").map_err(|problem| xml.fail(problem, word))?;
            usize::try_from(part).map_err(|_| xml.fail(ReadProblem::IntegerTooLarge, word))?
        }
    };
    let file = unescaped(file_word);
    if !is_below(&file) {
        return Err(expected(
            "a file below the folder of the collection",
            file_word,
        ));
    }
    // Both in XML escapes and as written.
    let name = unescaped(tag.attribute("name").unwrap_or_default()).replace(char::is_control, " ");
    Ok(Entry {
        time,
        part,
        name,
        file,
    })
}

/// True if a path leads to a file in the folder or below it: a collection must not make a program
/// read elsewhere.
pub(crate) fn is_below(file: &str) -> bool {
    let plain = !file.chars().any(char::is_control);
    let mut parts = Path::new(file).components();
    plain
        && parts.all(|c| matches!(c, Component::Normal(_) | Component::CurDir))
        && Path::new(file).file_name().is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Scratch;

    #[test]
    fn the_text_is_complete_after_each_write() {
        let path = Scratch::file("run.pvd");
        let mut collection = Collection::new();
        for frame in 0..3 {
            let file = format!("a/b_{frame:04}.vtp");
            collection.push(Entry {
                time: 0.1 * f64::from(frame),
                part: 0,
                name: "a<b & \"c\"".into(),
                file,
            });
            collection.write(&path).unwrap();
            let text = std::fs::read_to_string(&*path).unwrap();
            assert_eq!(text.matches("<DataSet ").count(), frame as usize + 1);
            assert!(text.ends_with("</VTKFile>\n"));
        }
        let text = std::fs::read_to_string(&*path).unwrap();
        let line = "timestep=\"0.2\" group=\"\" part=\"0\" name=\"a&lt;b &amp; &quot;c&quot;\" file=\"a/b_0002.vtp\"/>";
        assert!(text.contains(line), "{text}");
        assert_eq!(collection.entries().len(), 3);
    }

    #[test]
    fn blocks_have_the_names_of_their_parts() {
        let mut collection = Collection::new();
        for (time, name, file) in [
            (0.0, "muscle", "frames/muscle_0000.vtp"),
            (0.0, "a<b", "frames/bone.vtp"),
            (0.5, "muscle", "frames/muscle_0001.vtp"),
        ] {
            collection.push(Entry {
                time,
                part: 0,
                name: name.into(),
                file: file.into(),
            });
        }
        let times: Vec<&[Entry]> = collection.times().collect();
        assert_eq!(times.iter().map(|of| of.len()).collect::<Vec<_>>(), [2, 1]);
        let mut bytes = Vec::new();
        write_blocks(times[0], "frames/", &mut bytes).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        let blocks = "<DataSet index=\"0\" name=\"muscle\" file=\"muscle_0000.vtp\"/>\n    \
                      <DataSet index=\"1\" name=\"a&lt;b\" file=\"bone.vtp\"/>";
        assert!(text.contains(blocks), "{text}");
        assert!(text.starts_with("<?xml") && text.ends_with("</VTKFile>\n"));
    }

    #[test]
    fn a_time_that_is_not_finite_is_refused() {
        let mut collection = Collection::new();
        collection.push(Entry {
            time: f64::NAN,
            part: 0,
            name: String::new(),
            file: "a.vtp".into(),
        });
        assert!(collection.write(&Scratch::file("nan.pvd")).is_err());
    }

    /// A collection with one tag.
    fn with(tag: &str) -> String {
        format!(
            "<?xml version='1.0'?><!-- c --><VTKFile type=\"Collection\"><Collection>{tag}</Collection></VTKFile>"
        )
    }

    #[test]
    fn what_was_written_is_read() {
        let path = Scratch::file("read.pvd");
        let mut collection = Collection::new();
        for (time, part, name) in [
            (-0.0, 0, "a<b & \"c\" &lt;"),
            (1.0 / 3.0, 7, ""),
            (1e300, usize::MAX / 2, "\u{e9}'"),
        ] {
            let file = format!("frames/{}.vtp", name.replace('/', "_"));
            collection.push(Entry {
                time,
                part,
                name: name.into(),
                file,
            });
        }
        collection.write(&path).unwrap();
        let found = read(&path).unwrap();
        assert_eq!(found, collection);
        let bits = |c: &Collection| {
            c.entries()
                .iter()
                .map(|e| e.time.to_bits())
                .collect::<Vec<_>>()
        };
        assert_eq!(bits(&found), bits(&collection));
        let short =
            read_bytes(with("<DataSet timestep='2' file='a.vtp'/>").as_bytes(), "a").unwrap();
        assert_eq!(
            short.entries(),
            [Entry {
                time: 2.0,
                part: 0,
                name: String::new(),
                file: "a.vtp".into()
            }]
        );
        assert!(
            read_bytes(with("").as_bytes(), "a")
                .unwrap()
                .entries()
                .is_empty()
        );
    }

    #[test]
    fn what_is_no_collection_is_told_with_its_place() {
        let error = |text: &str| read_bytes(text.as_bytes(), "a.pvd").unwrap_err().terse();
        for (tag, says) in [
            (
                "<DataSet file='a.vtp'/>",
                "a.pvd:1:72: error[E042]: expected a DataSet with the attributes timestep and file",
            ),
            (
                "<DataSet timestep='1'/>",
                "expected a DataSet with the attributes timestep and file",
            ),
            ("<DataSet timestep='1,5' file='a.vtp'/>", "decimal comma"),
            (
                "<DataSet timestep='nan' file='a.vtp'/>",
                "expected a time that is finite (found 'nan')",
            ),
            (
                "<DataSet timestep='1e999' file='a.vtp'/>",
                "expected a time that is finite",
            ),
            (
                "<DataSet timestep='1' part='-1' file='a.vtp'/>",
                "expected the number of a part (found '-1')",
            ),
            (
                "<DataSet timestep='1' part='99999999999999999999' file='a.vtp'/>",
                "more than 63 bits",
            ),
            (
                "<DataSet timestep='1' file=''/>",
                "expected a file below the folder",
            ),
            (
                "<DataSet timestep='1' file='../a.vtp'/>",
                "expected a file below the folder of the collection (found '../a.vtp')",
            ),
            (
                "<DataSet timestep='1' file='/etc/passwd'/>",
                "expected a file below the folder",
            ),
            (
                "<DataSet timestep='1' file='a\nb.vtp'/>",
                "expected a file below the folder",
            ),
        ] {
            let text = error(&with(tag));
            assert!(text.contains(says), "{tag}: {text}");
        }
        assert!(error("").contains("the file is empty"));
        for other in [
            "v 1 2 3",
            "<svg/>",
            "<VTKFile type='PolyData'><PolyData/></VTKFile>",
        ] {
            assert!(
                error(other).contains("expected a collection of ParaView"),
                "{other}"
            );
        }
        let whole = with("<DataSet timestep='1' file='a.vtp'/>");
        for end in 0..whole.find("</Collection>").unwrap() {
            assert!(
                read_bytes(&whole.as_bytes()[..end], "a.pvd").is_err(),
                "{end}"
            );
        }
    }
}
