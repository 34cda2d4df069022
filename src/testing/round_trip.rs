//! Round trip of a mesh made from any bytes through every writer and reader: the same bits, or a
//! justified rejection.

use std::io;
use std::path::{Path, PathBuf};

use nalgebra::Point3;

use super::loaders::{Breach, LoadOutcome};
use crate::io::{Encoding, MeshFile, Warning, obj, ply, read, stl, vtk, vtp};
use crate::mesh::TriangleMesh;

/// Greatest number of vertices, so that an index is one byte.
const MOST_VERTICES: usize = 40;

/// A mesh and polylines.
type Drawing = (TriangleMesh, Vec<Vec<u32>>);

/// A writer with the properties of its format.
struct Writer {
    name: &'static str,
    write: fn(&Path, &Drawing) -> io::Result<()>,
    keeps_lines: bool,
    /// Change of a coordinate in a format of corners; `None` if vertices keep their bits and their
    /// order.
    corners: Option<fn(f64) -> f64>,
}

const WRITERS: [Writer; 9] = [
    Writer {
        name: "a.obj",
        write: |p, (m, l)| obj::write(p, m, l),
        keeps_lines: true,
        corners: None,
    },
    Writer {
        name: "t.vtk",
        write: |p, (m, l)| vtk::write(p, m, l, Encoding::Text),
        keeps_lines: true,
        corners: None,
    },
    Writer {
        name: "b.vtk",
        write: |p, (m, l)| vtk::write(p, m, l, Encoding::Binary),
        keeps_lines: true,
        corners: None,
    },
    Writer {
        name: "a.vtp",
        write: write_vtp,
        keeps_lines: true,
        corners: None,
    },
    Writer {
        name: "t.ply",
        write: |p, (m, _)| ply::write(p, m, &[], Encoding::Text),
        keeps_lines: false,
        corners: None,
    },
    Writer {
        name: "l.ply",
        write: |p, (m, _)| ply::write(p, m, &[], Encoding::Binary),
        keeps_lines: false,
        corners: None,
    },
    Writer {
        name: "b.ply",
        write: |p, (m, _)| ply::write_ply(p, m, &[], ply::PlyEncoding::Big),
        keeps_lines: false,
        corners: None,
    },
    Writer {
        name: "t.stl",
        write: |p, (m, _)| stl::write(p, m, Encoding::Text),
        keeps_lines: false,
        corners: Some(|c| c + 0.0),
    },
    Writer {
        name: "b.stl",
        write: |p, (m, _)| stl::write(p, m, Encoding::Binary),
        keeps_lines: false,
        corners: Some(|c| f64::from(c as f32) + 0.0),
    },
];

fn write_vtp(path: &Path, (mesh, lines): &Drawing) -> io::Result<()> {
    let data = vtp::PolyData {
        points: &mesh.vertices,
        triangles: &mesh.triangles,
        lines,
        ..Default::default()
    };
    vtp::write(path, &data)
}

/// Numbers from bytes; the bytes after the last one are 0.
struct Numbers<'a>(std::slice::Iter<'a, u8>);

impl Numbers<'_> {
    fn byte(&mut self) -> usize {
        usize::from(self.0.next().copied().unwrap_or(0))
    }

    /// Random bits are nearly always a number of extreme size; the first byte can select plain
    /// numbers instead.
    fn coordinate(&mut self) -> f64 {
        match self.byte() % 4 {
            0 => f64::from_be_bytes(std::array::from_fn(|_| self.byte() as u8)),
            1 => f64::from(f32::from_be_bytes(std::array::from_fn(|_| {
                self.byte() as u8
            }))),
            2 => self.byte() as f64 - 128.0,
            _ => f64::from(self.byte() as u32) * f64::MIN_POSITIVE / 16.0,
        }
    }

    fn index(&mut self, within: usize) -> u32 {
        (self.byte() % within) as u32
    }
}

/// A mesh whose numbers come from the bytes: counts, coordinates of eight bytes, indices of one
/// byte, some of them out of range.
pub fn drawing(bytes: &[u8]) -> (TriangleMesh, Vec<Vec<u32>>) {
    let mut numbers = Numbers(bytes.iter());
    let vertices = numbers.byte() % (MOST_VERTICES + 1);
    let (triangles, lines) = (numbers.byte() % 64, numbers.byte() % 8);
    let vertices: Vec<Point3<f64>> = (0..vertices)
        .map(|_| Point3::from(std::array::from_fn(|_| numbers.coordinate())))
        .collect();
    let within = vertices.len().max(1) + usize::from(numbers.byte() == 77);
    let triangles = (0..triangles)
        .map(|_| std::array::from_fn(|_| numbers.index(within)))
        .collect();
    let mut polylines = Vec::new();
    for _ in 0..lines {
        let count = 1 + numbers.index(within) % 5;
        polylines.push((0..count).map(|_| numbers.index(within)).collect());
    }
    (
        TriangleMesh {
            vertices,
            triangles,
        },
        polylines,
    )
}

/// Writes a mesh made from bytes in every format, reads it again and compares.
///
/// # Errors
/// A different file, an error for a mesh that can be written, or no error for one that cannot.
pub fn check_round_trip(bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    let drawing = drawing(bytes);
    let mut outcome = LoadOutcome::Refused;
    for writer in &WRITERS {
        let path = scratch(writer.name);
        let done = (writer.write)(&path, &drawing);
        let result = compare(writer, &drawing, &path, done);
        // Not every mesh gives a file.
        let _ = std::fs::remove_file(&path);
        match result {
            Ok(LoadOutcome::Accepted) => outcome = LoadOutcome::Accepted,
            Ok(LoadOutcome::Refused) => {}
            Err(detail) => {
                return Err(Breach::Changed {
                    writer: writer.name,
                    detail,
                });
            }
        }
    }
    Ok(outcome)
}

/// A file name of this process and thread alone.
fn scratch(name: &str) -> PathBuf {
    let thread: String = format!("{:?}", std::thread::current().id())
        .chars()
        .filter(char::is_ascii_digit)
        .collect();
    std::env::temp_dir().join(format!(
        "pliant-round-{}-{thread}-{name}",
        std::process::id()
    ))
}

fn compare(
    writer: &Writer,
    drawing: &Drawing,
    path: &Path,
    done: io::Result<()>,
) -> Result<LoadOutcome, String> {
    let (mesh, lines) = drawing;
    let finite = |c: &f64| c.is_finite() && writer.corners.is_none_or(|of| of(*c).is_finite());
    let count = mesh.vertices.len();
    let within = |i: &u32| (*i as usize) < count;
    let lines: &[Vec<u32>] = if writer.keeps_lines { lines } else { &[] };
    let numbers = mesh.vertices.iter().flat_map(|v| v.iter()).all(finite);
    let indices = mesh
        .triangles
        .iter()
        .flatten()
        .chain(lines.iter().flatten())
        .all(within);
    let ends = lines.iter().all(|line| line.len() >= 2);
    if let Err(error) = done {
        let right = !(numbers && indices && ends);
        return if right && !path.exists() {
            Ok(LoadOutcome::Refused)
        } else {
            Err(format!("not written: {error}"))
        };
    }
    let expected = Expected::of(writer, mesh, lines);
    match read(path) {
        Ok(file) if numbers && indices && ends => expected
            .compare(&file, writer)
            .map(|()| LoadOutcome::Accepted),
        Ok(_) => Err("a mesh that is none was written and read".into()),
        // The writer of frames accepts any mesh; its readers reject an invalid one.
        Err(_) if !numbers || !ends || expected.is_empty() => Ok(LoadOutcome::Refused),
        Err(error) => Err(error.terse()),
    }
}

/// The expected result of a reader: triangles with a repeated vertex or corner are left out.
struct Expected {
    vertices: Vec<[u64; 3]>,
    triangles: Vec<[u32; 3]>,
    corners: Vec<[[u64; 3]; 3]>,
    lines: Vec<Vec<u32>>,
    degenerate: usize,
}

fn bits(point: &Point3<f64>, of: Option<fn(f64) -> f64>) -> [u64; 3] {
    [point.x, point.y, point.z].map(|c| of.map_or(c, |of| of(c)).to_bits())
}

fn differ<T: PartialEq>([a, b, c]: &[T; 3]) -> bool {
    a != b && b != c && c != a
}

impl Expected {
    fn of(writer: &Writer, mesh: &TriangleMesh, lines: &[Vec<u32>]) -> Self {
        let vertices: Vec<[u64; 3]> = mesh
            .vertices
            .iter()
            .map(|v| bits(v, writer.corners))
            .collect();
        let place = |i: u32| vertices.get(i as usize).copied().unwrap_or_default();
        let kept = |t: &&[u32; 3]| {
            if writer.corners.is_some() {
                differ(&t.map(place))
            } else {
                differ(t)
            }
        };
        let triangles: Vec<[u32; 3]> = mesh.triangles.iter().filter(kept).copied().collect();
        let corners = triangles.iter().map(|t| t.map(place)).collect();
        let degenerate = mesh.triangles.len() - triangles.len();
        Self {
            corners,
            degenerate,
            triangles,
            lines: lines.to_vec(),
            vertices,
        }
    }

    /// True if no reader accepts the mesh.
    fn is_empty(&self) -> bool {
        self.vertices.is_empty() || self.triangles.is_empty() && self.lines.is_empty()
    }

    fn compare(&self, file: &MeshFile, writer: &Writer) -> Result<(), String> {
        let vertices: Vec<[u64; 3]> = file.mesh.vertices.iter().map(|v| bits(v, None)).collect();
        let same = if writer.corners.is_some() {
            let corners = |t: &[u32; 3]| t.map(|i| vertices[i as usize]);
            file.mesh
                .triangles
                .iter()
                .map(corners)
                .eq(self.corners.iter().copied())
        } else {
            vertices == self.vertices && file.mesh.triangles == self.triangles
        };
        if same
            && file.lines == self.lines
            && file.warnings.count(Warning::RepeatedCorner) == self.degenerate
        {
            return Ok(());
        }
        Err(format!(
            "{} triangles and {} lines were read",
            file.mesh.triangles.len(),
            file.lines.len()
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles and a line over four points with plain coordinates.
    fn plain() -> Vec<u8> {
        let mut bytes = vec![4, 2, 1];
        bytes.extend([
            2, 128, 2, 128, 2, 128, 2, 129, 2, 128, 2, 128, 2, 128, 2, 129, 2, 128, 2, 129, 2, 129,
            2, 131,
        ]);
        bytes.extend([0, 0, 1, 2, 1, 3, 2, 1, 0, 3]);
        bytes
    }

    #[test]
    fn a_plain_mesh_comes_back() {
        let (mesh, lines) = drawing(&plain());
        assert_eq!(
            (mesh.vertices[3], mesh.triangles.len(), lines),
            (Point3::new(1., 1., 3.), 2, vec![vec![0, 3]])
        );
        assert_eq!(check_round_trip(&plain()), Ok(LoadOutcome::Accepted));
        assert_eq!(check_round_trip(b""), Ok(LoadOutcome::Refused));
    }

    #[test]
    fn a_writer_that_changes_a_bit_is_seen() {
        let deed = |path: &Path, drawing: &Drawing| {
            let mut changed = drawing.clone();
            changed.0.vertices[3].x = f64::from_bits(changed.0.vertices[3].x.to_bits() + 1);
            obj::write(path, &changed.0, &changed.1)
        };
        let broken = Writer {
            name: "broken.obj",
            write: deed,
            keeps_lines: true,
            corners: None,
        };
        let silent = Writer {
            name: "silent.obj",
            write: |_, _| Err(io::Error::other("no")),
            ..broken
        };
        let drawing = drawing(&plain());
        for writer in [broken, silent] {
            let path = scratch(writer.name);
            let done = (writer.write)(&path, &drawing);
            let result = compare(&writer, &drawing, &path, done);
            let _ = std::fs::remove_file(&path);
            assert!(result.is_err(), "{}", writer.name);
        }
    }
}
