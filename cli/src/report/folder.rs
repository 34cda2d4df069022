//! The folder of a run's results: lists its own files, and changes no others.

use std::collections::HashSet;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::Mutex;

use pliant::io::{LIST, write_whole};
use pliant_render::PictureError;

/// The file from which a run resumes.
pub const CHECKPOINT: &str = "checkpoint.pliant";

/// First line of the list; a file without it belongs to others.
const HEADER: &str =
    "# Written by pliant. The next run into this folder removes the files listed here.";

/// Extensions of files that a run writes: no other file is ever removed, for any content of the
/// list.
const ENDINGS: &[&str] = &[
    "vtp", "pvd", "csv", "json", "html", "gif", "png", "svg", "toml", "obj", "pliant", "xml",
    "sto", "osim", "springs", "vtm", "series",
];

/// Subfolders that a run creates.
const FOLDERS: &[&str] = &["frames", "runs"];

/// The reason why results cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// The path exists and is no folder.
    #[error("`{0}` is not a folder; name another with --out")]
    NotAFolder(PathBuf),
    /// Another run writes to the folder.
    #[error("another run writes to `{0}`; wait for its end, or name another folder with --out")]
    InUse(PathBuf),
    /// A file that pliant did not write has the name of a result.
    #[error(
        "`{0}` is there and was not written by pliant; move it, or name another folder with --out"
    )]
    Foreign(PathBuf),
    /// A file is missing without which a run cannot resume.
    #[error("`{0}` is missing, and the run cannot go on without it; begin anew without --resume")]
    Missing(PathBuf),
    /// A file of an earlier frame has changed.
    #[error(
        "`{0}` is not as pliant wrote it, and the run cannot go on without it; begin anew without --resume"
    )]
    Changed(PathBuf),
    /// The folder is not writable; checked before any computation.
    #[error("`{path}` cannot be written to ({source}); name another folder with --out")]
    Unwritable {
        /// The folder, or its nearest existing parent.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// An error of the operating system.
    #[error("cannot write `{path}`: {source}")]
    Io {
        /// The path to be written.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// A picture cannot be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Picture(#[from] PictureError),
    /// The thread that writes frames ended early.
    #[error("the writer of frames ended before its time")]
    WriterEnded,
}

/// The current folder for an empty path.
fn or_here(path: &Path) -> &Path {
    if path.as_os_str().is_empty() {
        Path::new(".")
    } else {
        path
    }
}

fn refused(path: &Path) -> impl FnOnce(io::Error) -> FolderError + '_ {
    |source| FolderError::Io {
        path: path.to_owned(),
        source,
    }
}

/// Locks a folder against other runs until the returned file is closed: at the latest with the
/// process, so that a kill leaves no lock. Where the file system has no locks there is none.
fn lock(root: &Path) -> Result<Option<File>, FolderError> {
    let Ok(folder) = File::open(root) else {
        return Ok(None);
    };
    match folder.try_lock() {
        Err(TryLockError::WouldBlock) => Err(FolderError::InUse(root.to_owned())),
        Err(TryLockError::Error(_)) => Ok(None),
        Ok(()) => Ok(Some(folder)),
    }
}

/// A folder of results, locked against other runs.
#[derive(Debug)]
pub struct Folder {
    root: PathBuf,
    _lock: Option<File>,
    claimed: Mutex<Claimed>,
}

#[derive(Debug)]
struct Claimed {
    list: File,
    files: HashSet<String>,
}

impl Folder {
    /// Creates the folder, or takes an existing one and removes the files of an earlier run.
    ///
    /// # Errors
    /// A path that is no folder, or an error of the operating system.
    pub fn open(root: &Path) -> Result<Self, FolderError> {
        Self::open_keeping(root, &|_| false)
    }

    /// Checks that results can be written, before any computation and without leaving a file.
    ///
    /// # Errors
    /// A path that is no folder, a foreign file at the path of one of `files`, a folder that is not
    /// writable, or one to which another run writes.
    pub fn check(root: &Path, files: &[String]) -> Result<(), FolderError> {
        // A symbolic link without a target is no folder either.
        let is_there = |p: &&Path| p.symlink_metadata().is_ok();
        let Some(nearest) = root.ancestors().map(or_here).find(is_there) else {
            return Ok(());
        };
        if !nearest.is_dir() {
            return Err(FolderError::NotAFolder(nearest.to_owned()));
        }
        lock(root)?;
        let own = listed(&root.join(LIST)).map_err(|error| match error {
            FolderError::Io { path, source } => FolderError::Unwritable { path, source },
            other => other,
        })?;
        let own: HashSet<String> = own.into_iter().flatten().collect();
        let foreign =
            |file: &&String| !own.contains(*file) && root.join(file).symlink_metadata().is_ok();
        if let Some(file) = files.iter().find(foreign) {
            return Err(FolderError::Foreign(root.join(file)));
        }
        let trial = nearest.join(format!(".pliant-{}", std::process::id()));
        let tried = OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(&trial)
            .and_then(|_| fs::remove_file(&trial));
        tried.map_err(|source| FolderError::Unwritable {
            path: nearest.to_owned(),
            source,
        })
    }

    /// The same as [`Self::open`], but files of an earlier run for which `keep` is true, by their
    /// relative paths, stay in the list.
    ///
    /// # Errors
    /// A path that is no folder, or an error of the operating system.
    pub fn open_keeping(root: &Path, keep: &dyn Fn(&str) -> bool) -> Result<Self, FolderError> {
        // A folder cannot lie below another kind of file.
        if let Some(taken) = root
            .ancestors()
            .find(|p| p.exists())
            .filter(|p| !p.is_dir())
        {
            return Err(FolderError::NotAFolder(taken.to_owned()));
        }
        fs::create_dir_all(root).map_err(refused(root))?;
        let lock = lock(root)?;
        let list_path = root.join(LIST);
        let old = listed(&list_path)?;
        let (kept, gone): (Vec<String>, Vec<String>) = old
            .iter()
            .flatten()
            .cloned()
            .partition(|r| keep(r) && root.join(r).is_file());
        remove(root, &gone)?;
        // The list always contains the kept files: after a kill here they would otherwise belong to
        // nobody.
        let lines = || std::iter::once(HEADER).chain(kept.iter().map(String::as_str));
        let write = |w: &mut dyn Write| lines().try_for_each(|line| writeln!(w, "{line}"));
        match old {
            Some(_) => write_whole(&list_path, |w| write(w)),
            None => OpenOptions::new()
                .write(true)
                .create_new(true)
                .open(&list_path)
                .and_then(|mut w| write(&mut w)),
        }
        .map_err(refused(&list_path))?;
        let list = OpenOptions::new()
            .append(true)
            .open(&list_path)
            .map_err(refused(&list_path))?;
        let files = kept.into_iter().collect();
        Ok(Self {
            root: root.to_owned(),
            _lock: lock,
            claimed: Mutex::new(Claimed { list, files }),
        })
    }

    /// Opens the folder of a run that resumes: `frames` must exist, later frames are removed, and
    /// so are the other files for which `replaced` is true. Nothing changes before all necessary
    /// files are found.
    ///
    /// # Errors
    /// No folder of results, a missing frame, or an error of the operating system.
    pub fn resume(
        root: &Path,
        frames: &HashSet<String>,
        replaced: impl Fn(&str) -> bool,
    ) -> Result<Self, FolderError> {
        let lock = lock(root)?;
        let list_path = root.join(LIST);
        let Some(listed) = listed(&list_path)? else {
            return Err(FolderError::Missing(list_path));
        };
        let known: HashSet<&String> = listed.iter().collect();
        let mut required: Vec<&String> = frames.iter().collect();
        required.sort_unstable();
        if let Some(missing) = required
            .into_iter()
            .find(|f| !known.contains(f) || !root.join(f).is_file())
        {
            return Err(FolderError::Missing(root.join(missing)));
        }
        let is_kept = |file: &String| {
            if file.starts_with("frames/") {
                frames.contains(file)
            } else {
                !replaced(file)
            }
        };
        let replaced: Vec<String> = listed
            .iter()
            .filter(|file| !is_kept(file))
            .cloned()
            .collect();
        remove(root, &replaced)?;
        let files: HashSet<String> = listed.into_iter().filter(is_kept).collect();
        write_list(&list_path, &files)?;
        let list = OpenOptions::new()
            .append(true)
            .open(&list_path)
            .map_err(refused(&list_path))?;
        Ok(Self {
            root: root.to_owned(),
            _lock: lock,
            claimed: Mutex::new(Claimed { list, files }),
        })
    }

    /// Sorts the list at the end of a run, so that it does not depend on the order of writing or on
    /// the number of resumes.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn close(&self) -> Result<(), FolderError> {
        let mut claimed = self
            .claimed
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        let path = self.root.join(LIST);
        write_list(&path, &claimed.files)?;
        claimed.list = OpenOptions::new()
            .append(true)
            .open(&path)
            .map_err(refused(&path))?;
        Ok(())
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        &self.root
    }

    /// Writes a complete file of the folder; `relative` has `/` between folders.
    ///
    /// # Errors
    /// A foreign file of that name, or an error of the operating system.
    pub fn write(
        &self,
        relative: &str,
        fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), FolderError> {
        let path = self.claim(relative)?;
        write_whole(&path, fill).map_err(refused(&path))
    }

    /// The path of a file that the caller then writes through a temporary file; adds it to the
    /// list.
    ///
    /// # Errors
    /// A foreign file of that name, or an error of the operating system.
    pub fn claim(&self, relative: &str) -> Result<PathBuf, FolderError> {
        let path = self.root.join(relative);
        // The next run could not remove it, and would refuse the folder.
        debug_assert!(
            is_own(Path::new(relative)),
            "{relative} has no known ending"
        );
        // A thread that panicked with the lock left at worst a surplus name in the list.
        let mut claimed = self
            .claimed
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        if claimed.files.contains(relative) {
            return Ok(path);
        }
        if path.symlink_metadata().is_ok() {
            return Err(FolderError::Foreign(path));
        }
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(refused(folder))?;
        }
        // In the list before it exists, so that the next run can remove it even after a kill.
        let written = writeln!(claimed.list, "{relative}");
        written.map_err(refused(&self.root.join(LIST)))?;
        claimed.files.insert(relative.to_owned());
        Ok(path)
    }

    /// Takes a file into the list that another program has written into the folder.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn adopt(&self, relative: &str) -> Result<(), FolderError> {
        let mut claimed = self
            .claimed
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        if claimed.files.insert(relative.to_owned()) {
            let written = writeln!(claimed.list, "{relative}");
            written.map_err(refused(&self.root.join(LIST)))?;
        }
        Ok(())
    }

    /// Removes a file of this run, if it is there.
    pub(super) fn discard(&self, relative: &str) {
        let mut claimed = self
            .claimed
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        if claimed.files.remove(relative) {
            // A file that stays is no loss, and the error before it is the one to report.
            let _ = fs::remove_file(self.root.join(relative));
        }
    }
}

/// The paths in the list of an earlier run that a run may write; `None` without a list.
fn listed(list_path: &Path) -> Result<Option<Vec<String>>, FolderError> {
    let text = match fs::read_to_string(list_path) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => {
            return Err(FolderError::Io {
                path: list_path.to_owned(),
                source: e,
            });
        }
    };
    let mut lines = text.lines();
    if lines.next() != Some(HEADER) {
        return Err(FolderError::Foreign(list_path.to_owned()));
    }
    Ok(Some(
        lines
            .filter(|line| is_own(Path::new(line)))
            .map(str::to_owned)
            .collect(),
    ))
}

/// Removes files of the list and their temporary files.
fn remove(root: &Path, files: &[String]) -> Result<(), FolderError> {
    for relative in files {
        let path = root.join(relative);
        let mut part = path.clone().into_os_string();
        part.push(".part");
        gone(&path)?;
        gone(Path::new(&part))?;
    }
    for folder in FOLDERS {
        // Removes the folder only if it is empty, as intended.
        let _ = fs::remove_dir(root.join(folder));
    }
    Ok(())
}

/// Removes a file if it exists.
fn gone(path: &Path) -> Result<(), FolderError> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(FolderError::Io {
            path: path.to_owned(),
            source: e,
        }),
        _ => Ok(()),
    }
}

fn write_list(path: &Path, files: &HashSet<String>) -> Result<(), FolderError> {
    let mut sorted: Vec<&String> = files.iter().collect();
    sorted.sort_unstable();
    let written = write_whole(path, |w| {
        writeln!(w, "{HEADER}")?;
        sorted
            .into_iter()
            .try_for_each(|file| writeln!(w, "{file}"))
    });
    written.map_err(refused(path))
}

/// True if a path of the list can belong to a run: below the folder, with a known extension.
fn is_own(path: &Path) -> bool {
    let below = path.components().all(|c| matches!(c, Component::Normal(_)));
    let ending = path.extension().and_then(|e| e.to_str());
    below && ending.is_some_and(|e| ENDINGS.contains(&e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::testing::Scratch;

    fn text(words: &'static str) -> impl FnOnce(&mut BufWriter<File>) -> io::Result<()> {
        move |w| w.write_all(words.as_bytes())
    }

    #[test]
    fn a_second_run_removes_what_the_first_wrote_and_nothing_else() {
        let root = Scratch::folder();
        let folder = Folder::open(&root).unwrap();
        folder.write("frames/a_0001.vtp", text("old")).unwrap();
        folder.write("summary.json", text("{}")).unwrap();
        fs::write(root.join("frames/mine.vtp"), "mine").unwrap();
        drop(folder);
        let folder = Folder::open(&root).unwrap();
        assert!(!root.join("frames/a_0001.vtp").exists() && !root.join("summary.json").exists());
        assert_eq!(fs::read(root.join("frames/mine.vtp")).unwrap(), b"mine");
        assert!(matches!(
            folder.write("frames/mine.vtp", text("x")),
            Err(FolderError::Foreign(_))
        ));
        assert_eq!(fs::read(root.join("frames/mine.vtp")).unwrap(), b"mine");
    }

    #[test]
    fn what_is_to_be_kept_stays_and_stays_our_own() {
        let root = Scratch::folder();
        let folder = Folder::open(&root).unwrap();
        folder.write("runs/a.json", text("a")).unwrap();
        folder.write("runs/b.json", text("b")).unwrap();
        folder.write("table.csv", text("old")).unwrap();
        fs::write(root.join("runs/mine.json"), "mine").unwrap();
        drop(folder);
        let folder =
            Folder::open_keeping(&root, &|r| r == "runs/a.json" || r == "runs/mine.json").unwrap();
        assert!(root.join("runs/a.json").exists() && !root.join("runs/b.json").exists());
        assert!(!root.join("table.csv").exists());
        folder.write("runs/a.json", text("new")).unwrap();
        // Kept or not: the file was never ours.
        assert!(matches!(
            folder.write("runs/mine.json", text("x")),
            Err(FolderError::Foreign(_))
        ));
        drop(folder);
        Folder::open(&root).unwrap();
        assert!(
            !root.join("runs/a.json").exists(),
            "a file that was kept once is removed by a run that keeps nothing"
        );
        assert_eq!(fs::read(root.join("runs/mine.json")).unwrap(), b"mine");
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn a_run_that_goes_on_keeps_its_frames_and_no_later_ones() {
        let root = Scratch::folder();
        let frames: HashSet<String> = ["frames/a_0000.vtp", "frames/a_0001.vtp"]
            .map(str::to_owned)
            .into();
        assert!(matches!(
            Folder::resume(&root, &frames, |_| false),
            Err(FolderError::Missing(_))
        ));
        let folder = Folder::open(&root).unwrap();
        for file in [
            "frames/a_0002.vtp",
            "frames/a_0001.vtp",
            "frames/a_0000.vtp",
            "a.gif",
            "summary.json",
        ] {
            folder.write(file, text("old")).unwrap();
        }
        drop(folder);
        // After a rejection nothing is lost.
        let more: HashSet<String> = frames
            .iter()
            .cloned()
            .chain(["frames/a_0003.vtp".to_owned()])
            .collect();
        let missing = Folder::resume(&root, &more, |_| true).unwrap_err();
        assert!(matches!(missing, FolderError::Missing(path) if path.ends_with("a_0003.vtp")));
        assert!(root.join("frames/a_0002.vtp").exists() && root.join("a.gif").exists());
        let folder = Folder::resume(&root, &frames, |file| file.ends_with(".gif")).unwrap();
        assert!(!root.join("frames/a_0002.vtp").exists() && !root.join("a.gif").exists());
        folder.write("frames/a_0002.vtp", text("new")).unwrap();
        folder.write("summary.json", text("new")).unwrap();
        folder.close().unwrap();
        folder
            .write("b.gif", text("after the list was sorted"))
            .unwrap();
        let list = fs::read_to_string(root.join(LIST)).unwrap();
        let rest = "frames/a_0000.vtp\nframes/a_0001.vtp\nframes/a_0002.vtp\nsummary.json\nb.gif\n";
        assert_eq!(list, format!("{HEADER}\n{rest}"));
    }

    #[test]
    fn a_look_at_a_folder_leaves_nothing_behind() {
        let root = Scratch::file("out");
        let files = ["summary.json".to_owned(), "skin.vtp".to_owned()];
        Folder::check(&root.join("deep/er"), &files).unwrap();
        assert!(!root.exists(), "it was made");
        fs::create_dir_all(&root).unwrap();
        Folder::check(&root, &files).unwrap();
        assert_eq!(fs::read_dir(&root).unwrap().count(), 0);
        fs::write(root.join("skin.vtp"), "mine").unwrap();
        assert!(
            matches!(Folder::check(&root, &files), Err(FolderError::Foreign(path)) if path.ends_with("skin.vtp"))
        );
        Folder::check(&root, &files[..1]).unwrap();
        let below = Folder::check(&root.join("skin.vtp/out"), &files);
        assert!(matches!(below, Err(FolderError::NotAFolder(path)) if path.ends_with("skin.vtp")));
        assert_eq!(fs::read_dir(&root).unwrap().count(), 1);
        fs::remove_file(root.join("skin.vtp")).unwrap();
        // Files of an earlier run are no obstacle.
        Folder::open(&root)
            .unwrap()
            .write("skin.vtp", text("old"))
            .unwrap();
        Folder::check(&root, &files).unwrap();
        assert!(root.join("skin.vtp").exists());
    }

    #[cfg(unix)]
    #[test]
    fn two_runs_do_not_write_to_one_folder() {
        let root = Scratch::folder();
        let folder = Folder::open(&root).unwrap();
        folder.write("measures.csv", text("first")).unwrap();
        let frames = HashSet::new();
        let refused = [
            Folder::check(&root, &[]).err(),
            Folder::open(&root).err(),
            Folder::resume(&root, &frames, |_| true).err(),
        ];
        for error in refused {
            assert!(matches!(error, Some(FolderError::InUse(path)) if path == *root));
        }
        assert_eq!(fs::read(root.join("measures.csv")).unwrap(), b"first");
        drop(folder);
        Folder::open(&root).unwrap();
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_folder_that_nothing_can_be_written_to_is_known_before() {
        // Not even root can write there.
        let refused = Folder::check(Path::new("/proc/pliant/out"), &[]);
        assert!(
            matches!(refused, Err(FolderError::Unwritable { path, .. }) if path == Path::new("/proc"))
        );
    }

    #[test]
    fn a_list_cannot_lead_out_of_the_folder() {
        for path in ["../a.vtp", "/etc/a.json", "a.rs", "frames", ""] {
            assert!(!is_own(Path::new(path)), "{path}");
        }
        let root = Scratch::file("out");
        fs::write(&root, "a file").unwrap();
        for path in [root.to_path_buf(), root.join("below/it")] {
            assert!(
                matches!(Folder::open(&path), Err(FolderError::NotAFolder(taken)) if taken == *root)
            );
        }
        fs::remove_file(&root).unwrap();
        fs::create_dir_all(&root).unwrap();
        fs::write(root.join(LIST), "something else").unwrap();
        assert!(matches!(Folder::open(&root), Err(FolderError::Foreign(_))));
    }
}
