//! Files that appear only when they are complete.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::mesh::TriangleMesh;

/// Writes to `NAME.part` and renames it to `NAME` at the end, so that an interrupted run leaves no
/// incomplete file.
///
/// # Errors
/// Errors of `fill` and of the operating system; the partial file is removed.
pub fn write_whole(
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
    let done = (|| {
        let mut writer = BufWriter::new(File::create(&part)?);
        fill(&mut writer)?;
        writer.flush()?;
        drop(writer);
        fs::rename(&part, path)
    })();
    if done.is_err() {
        // The first error is reported; a failure to remove the partial file adds nothing.
        let _ = fs::remove_file(&part);
    }
    done
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
pub(super) fn check_mesh(mesh: &TriangleMesh, lines: &[Vec<u32>]) -> io::Result<()> {
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
}
