//! Writes a mesh in the format of its file extension.

use std::path::Path;

use super::{Encoding, Format};
use crate::mesh::TriangleMesh;

/// Error of [`write`].
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The extension is none of [`WRITABLE`].
    #[error("{file}: the ending names no format that can be written")]
    UnknownEnding {
        /// The file name as given by the caller.
        file: String,
    },
    /// The mesh does not fit the format, or the operating system could not write the file.
    #[error("{file}: cannot be written: {source}")]
    Io {
        /// The file name as given by the caller.
        file: String,
        /// The cause.
        source: std::io::Error,
    },
}

/// Writes a mesh and its polylines. Returns the number of polylines that the format cannot store
/// (STL stores none). PLY stores edges: each segment of a polyline becomes a separate line.
///
/// All formats except binary STL keep every bit of a coordinate; STL drops vertices without
/// triangles.
///
/// # Errors
/// An unknown extension, a mesh that the format cannot store, or a file that cannot be written.
pub fn write(
    path: &Path,
    mesh: &TriangleMesh,
    lines: &[Vec<u32>],
    encoding: Encoding,
) -> Result<usize, WriteError> {
    let file = path.display().to_string();
    let format = Format::from_name(&file).and_then(|format| format.spec().write);
    match format {
        Some(write) => {
            write(path, mesh, lines, encoding).map_err(|source| WriteError::Io { file, source })
        }
        None => Err(WriteError::UnknownEnding { file }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::tetrahedron;
    use crate::testing::Scratch;

    #[test]
    fn the_ending_decides() {
        let mesh = tetrahedron();
        let line = vec![vec![0, 1, 2]];
        for (ending, format, lost) in [
            ("obj", Format::Obj, 0),
            ("PLY", Format::Ply, 0),
            ("stl", Format::StlBinary, 1),
            ("vtk", Format::Vtk, 0),
            ("vtp", Format::Vtp, 0),
        ] {
            let path = Scratch::file(&format!("write.{ending}"));
            for encoding in [Encoding::Binary, Encoding::Text] {
                assert_eq!(
                    write(&path, &mesh, &line, encoding).unwrap(),
                    lost,
                    "{ending}"
                );
                let read = crate::io::read(&path).unwrap();
                assert_eq!(
                    (read.format.map(Format::name), read.mesh.triangles.len()),
                    (Some(format.name()), 4)
                );
                let parts = if ending == "PLY" { 2 } else { 1 - lost };
                assert_eq!(read.lines.len(), parts, "{ending}");
            }
        }
        let path = Scratch::file("write.ply");
        write(&path, &mesh, &[], Encoding::Text).unwrap();
        assert!(
            !std::fs::read_to_string(&*path).unwrap().contains("edge"),
            "no element without its records"
        );
        let error = write(Path::new("a.off"), &mesh, &[], Encoding::Text)
            .unwrap_err()
            .to_string();
        assert_eq!(
            error,
            "a.off: the ending names no format that can be written"
        );
        let error = write(
            Path::new("no/such/folder/a.obj"),
            &mesh,
            &[],
            Encoding::Text,
        )
        .unwrap_err()
        .to_string();
        assert!(
            error.starts_with("no/such/folder/a.obj: cannot be written: "),
            "{error}"
        );
    }
}
