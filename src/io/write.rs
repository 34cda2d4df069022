//! Writes a mesh in the format of its file extension.

use std::path::Path;

use super::{Format, obj, ply, stl, vtk, vtp};
use crate::mesh::TriangleMesh;

/// The extensions that [`write`] supports.
pub const WRITABLE: &str = ".obj, .ply, .stl, .vtk, .vtp";

/// Encoding of numbers for formats with a choice (PLY, STL and legacy VTK).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// As bytes.
    #[default]
    Binary,
    /// As text.
    Text,
}

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
    let binary = encoding == Encoding::Binary;
    let (done, lost) = match Format::from_name(&file) {
        Some(Format::Obj) => (obj::write(path, mesh, lines), 0),
        Some(Format::Ply) => {
            let encoding = if binary {
                ply::Encoding::Little
            } else {
                ply::Encoding::Text
            };
            (ply::write(path, mesh, lines, encoding), 0)
        }
        Some(Format::StlBinary) => {
            let encoding = if binary {
                stl::Encoding::Binary
            } else {
                stl::Encoding::Text
            };
            (stl::write(path, mesh, encoding), lines.len())
        }
        Some(Format::Vtk) => {
            let encoding = if binary {
                vtk::Encoding::Binary
            } else {
                vtk::Encoding::Ascii
            };
            (vtk::write(path, mesh, lines, encoding), 0)
        }
        Some(Format::Vtp) => {
            let (points, triangles) = (&mesh.vertices, &mesh.triangles);
            (
                vtp::write(
                    path,
                    &vtp::PolyData {
                        points,
                        triangles,
                        lines,
                        point_data: Vec::new(),
                    },
                ),
                0,
            )
        }
        _ => return Err(WriteError::UnknownEnding { file }),
    };
    done.map(|()| lost)
        .map_err(|source| WriteError::Io { file, source })
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
