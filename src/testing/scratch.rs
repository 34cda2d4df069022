//! Temporary folders for the files of one test.

use std::fs;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// Number of folders that this process has created.
static TAKEN: AtomicU32 = AtomicU32::new(0);

/// A unique folder or file name; the content is removed with this value.
#[derive(Debug)]
pub struct Scratch {
    folder: PathBuf,
    path: PathBuf,
}

impl Scratch {
    /// An empty folder.
    ///
    /// # Panics
    /// If the folder for temporary files is not writable.
    #[must_use]
    pub fn folder() -> Self {
        let name = format!(
            "pliant-test-{}-{}",
            std::process::id(),
            TAKEN.fetch_add(1, Ordering::Relaxed)
        );
        let folder = std::env::temp_dir().join(name);
        // Left from a killed process with the same number.
        let _ = fs::remove_dir_all(&folder);
        if let Err(error) = fs::create_dir_all(&folder) {
            panic!("{}: {error}", folder.display());
        }
        Self {
            path: folder.clone(),
            folder,
        }
    }

    /// The name of a file that does not exist yet, in its own folder.
    ///
    /// # Panics
    /// Those of [`Self::folder`].
    #[must_use]
    pub fn file(name: &str) -> Self {
        let mut place = Self::folder();
        place.path.push(name);
        place
    }
}

impl Deref for Scratch {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.path
    }
}

impl AsRef<Path> for Scratch {
    fn as_ref(&self) -> &Path {
        &self.path
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_differ_and_go_with_their_owners() {
        let (folder, file) = (Scratch::folder(), Scratch::file("a.txt"));
        fs::write(&file, "a").unwrap();
        fs::write(folder.join("a.txt"), "b").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"a");
        let paths = [folder.to_path_buf(), file.to_path_buf()];
        assert!(paths.iter().all(|p| p.exists()));
        drop((folder, file));
        assert!(paths.iter().all(|p| !p.exists()));
    }
}
