//! Files that appear only when they are complete.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::mesh::TriangleMesh;

/// Writes to `NAME.part` and renames it to `NAME` at the end, so that an interrupted run leaves no
/// incomplete file.
///
/// A link stays a link: the file that it names is replaced. A device or a pipe is written as it is,
/// because a rename would put an ordinary file in its place.
///
/// # Errors
/// Errors of `fill` and of the operating system; the partial file is removed.
pub fn write_whole(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    let Ok(real) = fs::canonicalize(path) else {
        return replace(path, fill);
    };
    let kind = fs::metadata(&real)?.file_type();
    if kind.is_file() || kind.is_dir() {
        return replace(&real, fill);
    }
    fill_to_the_end(OpenOptions::new().write(true).open(&real)?, fill)
}

fn replace(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    let Some(name) = path.file_name() else {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "a path that ends in a file name is needed",
        ));
    };
    let mut part_name = name.to_owned();
    part_name.push(".part");
    let part = path.with_file_name(part_name);
    let done = File::create(&part)
        .and_then(|file| fill_to_the_end(file, fill))
        .and_then(|()| fs::rename(&part, path));
    if done.is_err() {
        // The first error is reported; a failure to remove the partial file adds nothing.
        let _ = fs::remove_file(&part);
    }
    done
}

fn fill_to_the_end(
    file: File,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    let mut writer = BufWriter::new(file);
    fill(&mut writer)?;
    writer.flush()
}

/// An error for invalid data of the caller.
pub(super) fn invalid(what: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, what.into())
}

/// Rejects an index that a reader of the file would reject.
pub(super) fn check_indices(
    count: usize,
    triangles: &[[u32; 3]],
    lines: &[Vec<u32>],
) -> io::Result<()> {
    let used = triangles.iter().flatten().chain(lines.iter().flatten());
    match used.copied().find(|&i| i as usize >= count) {
        Some(i) => Err(invalid(format!(
            "vertex index {i} is out of range: there are {count} vertices"
        ))),
        None => Ok(()),
    }
}

/// Rejects a mesh that a reader of the file would reject.
pub(crate) fn check_mesh(mesh: &TriangleMesh, lines: &[Vec<u32>]) -> io::Result<()> {
    check_indices(mesh.vertices.len(), &mesh.triangles, lines)?;
    if let Some(i) = mesh
        .vertices
        .iter()
        .position(|v| !v.coords.iter().all(|c| c.is_finite()))
    {
        return Err(invalid(format!(
            "vertex {i} has a coordinate that is not finite"
        )));
    }
    match lines.iter().position(|line| line.len() < 2) {
        Some(i) => Err(invalid(format!("line {i} has fewer than two vertices"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Scratch;

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let path = Scratch::file("old.txt");
        write_whole(&path, |w| w.write_all(b"old")).unwrap();
        let failed = write_whole(&path, |w| {
            w.write_all(b"ne")?;
            Err(invalid("stop"))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&*path).unwrap(), b"old");
        assert!(!path.with_extension("txt.part").exists());
        assert!(write_whole(Path::new("/"), |_| Ok(())).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link_and_a_pipe_a_pipe() {
        use std::os::unix::fs::{FileTypeExt, symlink};

        let folder = Scratch::folder();
        let (file, link) = (folder.join("file.txt"), folder.join("link.txt"));
        fs::write(&file, "old").unwrap();
        symlink(&file, &link).unwrap();
        write_whole(&link, |w| w.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());

        let pipe = folder.join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).unwrap()
        });
        write_whole(&pipe, |w| w.write_all(b"through")).unwrap();
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        assert_eq!(reader.join().unwrap(), b"through");
    }
}
