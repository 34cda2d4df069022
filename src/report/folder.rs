//! The folder of a run's results: knows which files in it are its own, and touches no others.

use std::collections::HashSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::Mutex;

use crate::io::write_whole;

/// The file that lists what was written, a relative path a line.
pub const LIST: &str = "pliant-files.txt";

/// First line of the list; a file that begins otherwise is not ours.
const HEADER: &str = "# Written by pliant. The next run into this folder removes the files listed here.";

/// Endings of files that a run writes: nothing else is ever removed, whatever the list says.
const ENDINGS: &[&str] = &["vtp", "pvd", "csv", "json", "html", "gif", "png", "svg", "toml"];

/// Why results cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// The path is taken by something else.
    #[error("`{0}` is not a folder; name another with --out")]
    NotAFolder(PathBuf),
    /// A file of somebody else is in the way.
    #[error("`{0}` is there and was not written by pliant; move it, or name another folder with --out")]
    Foreign(PathBuf),
    /// The operating system refuses.
    #[error("cannot write `{path}`: {source}")]
    Io {
        /// What was to be written.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// The thread that writes frames ended early.
    #[error("the writer of frames ended before its time")]
    WriterEnded,
}

fn refused(path: &Path) -> impl FnOnce(io::Error) -> FolderError + '_ {
    |source| FolderError::Io { path: path.to_owned(), source }
}

/// A folder of results.
#[derive(Debug)]
pub struct Folder {
    root: PathBuf,
    claimed: Mutex<Claimed>,
}

#[derive(Debug)]
struct Claimed {
    list: File,
    files: HashSet<String>,
}

impl Folder {
    /// Makes the folder, or takes an old one and removes what an earlier run wrote into it.
    ///
    /// # Errors
    /// Something that is no folder, or what the operating system refuses.
    pub fn open(root: &Path) -> Result<Self, FolderError> {
        // Nor can a folder lie below something that is none.
        if let Some(taken) = root.ancestors().find(|p| p.exists()).filter(|p| !p.is_dir()) {
            return Err(FolderError::NotAFolder(taken.to_owned()));
        }
        fs::create_dir_all(root).map_err(refused(root))?;
        let list_path = root.join(LIST);
        remove_old(root, &list_path)?;
        let begun = OpenOptions::new().write(true).create_new(true).open(&list_path);
        let mut list = begun.map_err(refused(&list_path))?;
        writeln!(list, "{HEADER}").map_err(refused(&list_path))?;
        Ok(Self { root: root.to_owned(), claimed: Mutex::new(Claimed { list, files: HashSet::new() }) })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.root
    }

    /// Writes a file of the folder whole; `relative` has `/` between folders.
    ///
    /// # Errors
    /// A foreign file of that name, or what the operating system refuses.
    pub fn write(
        &self,
        relative: &str,
        fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), FolderError> {
        let path = self.claim(relative)?;
        write_whole(&path, fill).map_err(refused(&path))
    }

    /// The path of a file that the caller then writes by way of a part file; it is in the list from here on.
    ///
    /// # Errors
    /// A foreign file of that name, or what the operating system refuses.
    pub fn claim(&self, relative: &str) -> Result<PathBuf, FolderError> {
        let path = self.root.join(relative);
        // A thread that panicked while it held the lock left at worst a name too many in the list.
        let mut claimed = self.claimed.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if claimed.files.contains(relative) {
            return Ok(path);
        }
        if path.symlink_metadata().is_ok() {
            return Err(FolderError::Foreign(path));
        }
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(refused(folder))?;
        }
        // Listed before it exists, so that even a killed run can be cleaned up by the next.
        let written = writeln!(claimed.list, "{relative}");
        written.map_err(refused(&self.root.join(LIST)))?;
        claimed.files.insert(relative.to_owned());
        Ok(path)
    }
}

/// Removes what the list of an earlier run names, and the list.
fn remove_old(root: &Path, list_path: &Path) -> Result<(), FolderError> {
    let text = match fs::read_to_string(list_path) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(FolderError::Io { path: list_path.to_owned(), source: e }),
    };
    let mut lines = text.lines();
    if lines.next() != Some(HEADER) {
        return Err(FolderError::Foreign(list_path.to_owned()));
    }
    for relative in lines.map(Path::new).filter(|p| is_own(p)) {
        let path = root.join(relative);
        let mut part = path.clone().into_os_string();
        part.push(".part");
        for path in [path, part.into()] {
            match fs::remove_file(&path) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => {
                    return Err(FolderError::Io { path, source: e });
                }
                _ => {}
            }
        }
    }
    // Goes only if it is empty, which is wanted.
    let _ = fs::remove_dir(root.join("frames"));
    fs::remove_file(list_path).map_err(refused(list_path))
}

/// Whether a path of the list can be one of ours: below the folder, with an ending that a run writes.
fn is_own(path: &Path) -> bool {
    let below = path.components().all(|c| matches!(c, Component::Normal(_)));
    let ending = path.extension().and_then(|e| e.to_str());
    below && ending.is_some_and(|e| ENDINGS.contains(&e))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scratch(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("pliant-folder-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        path
    }

    fn text(words: &'static str) -> impl FnOnce(&mut BufWriter<File>) -> io::Result<()> {
        move |w| w.write_all(words.as_bytes())
    }

    #[test]
    fn a_second_run_removes_what_the_first_wrote_and_nothing_else() {
        let root = scratch("second");
        let folder = Folder::open(&root).unwrap();
        folder.write("frames/a_0001.vtp", text("old")).unwrap();
        folder.write("summary.json", text("{}")).unwrap();
        fs::write(root.join("frames/mine.vtp"), "mine").unwrap();
        drop(folder);
        let folder = Folder::open(&root).unwrap();
        assert!(!root.join("frames/a_0001.vtp").exists() && !root.join("summary.json").exists());
        assert_eq!(fs::read(root.join("frames/mine.vtp")).unwrap(), b"mine");
        assert!(matches!(folder.write("frames/mine.vtp", text("x")), Err(FolderError::Foreign(_))));
        assert_eq!(fs::read(root.join("frames/mine.vtp")).unwrap(), b"mine");
        fs::remove_dir_all(&root).unwrap();
    }

    #[test]
    fn a_list_cannot_lead_out_of_the_folder() {
        for path in ["../a.vtp", "/etc/a.json", "a.rs", "frames", ""] {
            assert!(!is_own(Path::new(path)), "{path}");
        }
        let root = scratch("file");
        fs::write(&root, "a file").unwrap();
        for path in [root.clone(), root.join("below/it")] {
            assert!(matches!(Folder::open(&path), Err(FolderError::NotAFolder(taken)) if taken == root));
        }
        fs::remove_file(&root).unwrap();
        fs::create_dir_all(&root).unwrap();
        fs::write(root.join(LIST), "something else").unwrap();
        assert!(matches!(Folder::open(&root), Err(FolderError::Foreign(_))));
        fs::remove_dir_all(&root).unwrap();
    }
}
