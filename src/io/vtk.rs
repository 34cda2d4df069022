//! Legacy VTK: reader of the surfaces of versions 1.0 to 5.1, text and binary, and writer of version 4.2.

mod grid;
mod read;

use std::io::{self, Write};
use std::path::Path;

use super::Encoding;
use super::part::{check_mesh, invalid, write_whole};
use crate::mesh::TriangleMesh;
pub(super) use read::read;

/// Writes a mesh and polylines as legacy VTK polydata of version 4.2 with doubles, through
/// `NAME.part`. Binary numbers are big-endian.
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
    let TriangleMesh {
        vertices,
        triangles,
    } = mesh;
    check_mesh(mesh, lines)?;
    let word = match encoding {
        Encoding::Text => "ASCII",
        Encoding::Binary => "BINARY",
    };
    write_whole(path, |w| {
        write!(
            w,
            "# vtk DataFile Version 4.2\npliant\n{word}\nDATASET POLYDATA\nPOINTS {} double\n",
            vertices.len()
        )?;
        for v in vertices {
            match encoding {
                Encoding::Text => writeln!(w, "{:?} {:?} {:?}", v.x, v.y, v.z)?,
                Encoding::Binary => v.iter().try_for_each(|c| w.write_all(&c.to_be_bytes()))?,
            }
        }
        if encoding == Encoding::Binary {
            writeln!(w)?;
        }
        write_cells(w, "LINES", lines.iter().map(Vec::as_slice), encoding)?;
        write_cells(
            w,
            "POLYGONS",
            triangles.iter().map(|t| t.as_slice()),
            encoding,
        )
    })
}

fn write_cells<'a>(
    w: &mut impl Write,
    keyword: &str,
    cells: impl Iterator<Item = &'a [u32]> + Clone,
    encoding: Encoding,
) -> io::Result<()> {
    let (count, size) = cells.clone().fold((0usize, 0usize), |(n, size), cell| {
        (n + 1, size + 1 + cell.len())
    });
    if count == 0 {
        return Ok(());
    }
    writeln!(w, "{keyword} {count} {size}")?;
    for cell in cells {
        match encoding {
            Encoding::Text => {
                write!(w, "{}", cell.len())?;
                cell.iter().try_for_each(|i| write!(w, " {i}"))?;
                writeln!(w)?;
            }
            Encoding::Binary => {
                // The format has only signed 32-bit indices.
                let signed = |i: usize| {
                    i32::try_from(i).map_err(|_| invalid(format!("{i} needs more than 31 bits")))
                };
                w.write_all(&signed(cell.len())?.to_be_bytes())?;
                for &i in cell {
                    w.write_all(&signed(i as usize)?.to_be_bytes())?;
                }
            }
        }
    }
    if encoding == Encoding::Binary {
        writeln!(w)
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::io::read_bytes;
    use crate::testing::Scratch;

    pub(super) fn sample() -> (TriangleMesh, Vec<Vec<u32>>) {
        let vertices = [
            [0.1, -0.0, 5e-324],
            [1.0 / 3.0, -1e300, 0.0],
            [0.0, 1.0, 1e-7],
            [1.0, 1e16, 123.456],
        ];
        let triangles = vec![[0, 1, 2], [1, 3, 2]];
        (
            TriangleMesh {
                vertices: vertices.map(Point3::from).to_vec(),
                triangles,
            },
            vec![vec![0, 1, 3], vec![2, 0]],
        )
    }

    pub(super) fn written(encoding: Encoding, name: &str) -> Vec<u8> {
        let (mesh, lines) = sample();
        let path = Scratch::file(name);
        write(&path, &mesh, &lines, encoding).unwrap();
        std::fs::read(&*path).unwrap()
    }

    #[test]
    fn what_is_written_is_read_with_the_same_bits() {
        let bits = |mesh: &TriangleMesh| -> Vec<[u64; 3]> {
            mesh.vertices
                .iter()
                .map(|v| [v.x, v.y, v.z].map(f64::to_bits))
                .collect()
        };
        let (mesh, lines) = sample();
        for (encoding, name) in [
            (Encoding::Text, "ascii.vtk"),
            (Encoding::Binary, "binary.vtk"),
        ] {
            let file = read_bytes(&written(encoding, name), name).unwrap();
            assert_eq!(bits(&file.mesh), bits(&mesh));
            assert_eq!(file.mesh.triangles, mesh.triangles);
            assert_eq!(file.lines, lines);
        }
        let only_lines = TriangleMesh {
            triangles: Vec::new(),
            ..mesh
        };
        let path = Scratch::file("lines.vtk");
        write(&path, &only_lines, &lines, Encoding::Text).unwrap();
        assert_eq!(crate::io::read(&path).unwrap().lines, lines);
    }

    #[test]
    fn wrong_meshes_are_not_written() {
        let (mesh, _) = sample();
        let path = Scratch::file("never.vtk");
        assert!(write(&path, &mesh, &[vec![0]], Encoding::Text).is_err());
        assert!(write(&path, &mesh, &[vec![0, 4]], Encoding::Text).is_err());
        let mut nan = mesh;
        nan.vertices[1].y = f64::NAN;
        assert!(write(&path, &nan, &[], Encoding::Binary).is_err());
        assert!(!path.exists());
    }
}
