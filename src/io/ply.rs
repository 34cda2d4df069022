//! PLY (Stanford polygon format): text and both byte orders.

mod read;

use std::io::{self, Write};
use std::path::Path;

use super::Encoding;
use super::part::{check_mesh, write_whole};
use crate::mesh::TriangleMesh;
pub(super) use read::read;

/// Encoding of the numbers of a PLY file, with both byte orders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlyEncoding {
    /// As text: the shortest that gives the same double.
    Text,
    /// As little-endian binary numbers.
    Little,
    /// As big-endian binary numbers.
    Big,
}

/// Writes a mesh with coordinates of type `double` through `NAME.part`. Polylines become edges, one
/// per pair of successive vertices. Binary numbers are little-endian.
///
/// # Errors
/// A coordinate that is not finite, an index out of range, a polyline of fewer than two vertices,
/// and errors of the operating system.
pub fn write(
    path: &Path,
    mesh: &TriangleMesh,
    lines: &[Vec<u32>],
    encoding: Encoding,
) -> io::Result<()> {
    let encoding = match encoding {
        Encoding::Binary => PlyEncoding::Little,
        Encoding::Text => PlyEncoding::Text,
    };
    write_ply(path, mesh, lines, encoding)
}

/// The same as [`write()`], in either byte order.
///
/// # Errors
/// See [`write()`].
pub fn write_ply(
    path: &Path,
    mesh: &TriangleMesh,
    lines: &[Vec<u32>],
    encoding: PlyEncoding,
) -> io::Result<()> {
    check_mesh(mesh, lines)?;
    let word = match encoding {
        PlyEncoding::Text => "ascii",
        PlyEncoding::Little => "binary_little_endian",
        PlyEncoding::Big => "binary_big_endian",
    };
    let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
    let edges: usize = lines.iter().map(|line| line.len() - 1).sum();
    write_whole(path, |w| {
        write!(
            w,
            "ply\nformat {word} 1.0\nelement vertex {vertices}\nproperty double x\nproperty double y\n\
             property double z\nelement face {triangles}\nproperty list uchar uint vertex_indices\n"
        )?;
        if edges > 0 {
            write!(
                w,
                "element edge {edges}\nproperty uint vertex1\nproperty uint vertex2\n"
            )?;
        }
        writeln!(w, "end_header")?;
        for v in &mesh.vertices {
            match encoding {
                PlyEncoding::Text => writeln!(w, "{:?} {:?} {:?}", v.x, v.y, v.z)?,
                PlyEncoding::Little => v.iter().try_for_each(|c| w.write_all(&c.to_le_bytes()))?,
                PlyEncoding::Big => v.iter().try_for_each(|c| w.write_all(&c.to_be_bytes()))?,
            }
        }
        for triangle in &mesh.triangles {
            w.write_all(if encoding == PlyEncoding::Text {
                b"3 "
            } else {
                &[3]
            })?;
            write_indices(w, triangle, encoding)?;
        }
        lines
            .iter()
            .flat_map(|line| line.windows(2))
            .try_for_each(|edge| write_indices(w, edge, encoding))
    })
}

/// The rest of a record, which contains only indices.
fn write_indices(w: &mut impl Write, indices: &[u32], encoding: PlyEncoding) -> io::Result<()> {
    for (k, i) in indices.iter().enumerate() {
        match encoding {
            PlyEncoding::Text if k == 0 => write!(w, "{i}")?,
            PlyEncoding::Text => write!(w, " {i}")?,
            PlyEncoding::Little => w.write_all(&i.to_le_bytes())?,
            PlyEncoding::Big => w.write_all(&i.to_be_bytes())?,
        }
    }
    if encoding == PlyEncoding::Text {
        writeln!(w)
    } else {
        Ok(())
    }
}
