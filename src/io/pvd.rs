//! The ParaView collection (`.pvd`): which file shows which part at which time.

use std::io::{self, Write};
use std::path::Path;

use super::part::{invalid, write_whole};
use super::vtp::escape;

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

/// The files of a run, for ParaView; it may be written again after each frame.
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

    /// Writes all entries to `path`, by way of `NAME.part`, so that ParaView never sees half a file.
    ///
    /// # Errors
    /// A time that is not finite, and what the operating system refuses.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        if let Some(entry) = self.entries.iter().find(|e| !e.time.is_finite()) {
            return Err(invalid(format!("the time of {} is {}, which is not finite", entry.file, entry.time)));
        }
        write_whole(path, |w| {
            writeln!(w, "<?xml version=\"1.0\"?>")?;
            writeln!(w, "<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n  <Collection>")?;
            for Entry { time, part, name, file } in &self.entries {
                let (name, file) = (escape(name), escape(file));
                writeln!(
                    w,
                    "    <DataSet timestep=\"{time:?}\" group=\"\" part=\"{part}\" name=\"{name}\" file=\"{file}\"/>"
                )?;
            }
            writeln!(w, "  </Collection>\n</VTKFile>")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::part::tests::scratch;

    #[test]
    fn the_text_is_complete_after_each_write() {
        let path = scratch("run.pvd");
        let mut collection = Collection::new();
        for frame in 0..3 {
            let file = format!("a/b_{frame:04}.vtp");
            collection.push(Entry { time: 0.1 * f64::from(frame), part: 0, name: "a<b & \"c\"".into(), file });
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
    fn a_time_that_is_not_finite_is_refused() {
        let mut collection = Collection::new();
        collection.push(Entry { time: f64::NAN, part: 0, name: String::new(), file: "a.vtp".into() });
        assert!(collection.write(&scratch("nan.pvd")).is_err());
    }
}
