//! The formats of mesh files. [`FORMATS`] declares each one once. Detection, reading, writing,
//! messages and fuzzing use it.

use std::io;
use std::path::Path;

use super::{MAX_FILE_BYTES, MeshFile, ReadError, directx, medit, obj, off, ply, stl, vtk, vtp};
use crate::mesh::TriangleMesh;

/// The formats that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// The Stanford polygon format, text or binary.
    Ply,
    /// STL as text.
    StlText,
    /// STL in binary.
    StlBinary,
    /// Legacy VTK, text or binary.
    Vtk,
    /// VTK XML polydata.
    Vtp,
    /// The object file format of Geomview.
    Off,
    /// DirectX text.
    DirectX,
    /// The text format of Medit.
    Medit,
}

/// Encoding of numbers in a format that permits two (PLY, STL and legacy VTK).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// As bytes, in the byte order of the format; PLY: little-endian.
    #[default]
    Binary,
    /// As text: the shortest that gives the same double.
    Text,
}

/// Writes a mesh and its polylines; returns the number of polylines that the format cannot hold.
type Write = fn(&Path, &TriangleMesh, &[Vec<u32>], Encoding) -> io::Result<usize>;

/// The declaration of a format.
#[derive(Debug)]
pub struct FormatSpec {
    /// The format.
    pub format: Format,
    /// Name in messages.
    pub name: &'static str,
    /// Name in the list of readable formats; empty for the second variant of a format.
    pub listed: &'static str,
    /// File name extension, without the dot.
    pub ending: &'static str,
    /// Name of its fuzz target, of the dictionary and of the seeds.
    pub target: &'static str,
    /// Possible beginnings of a file. Fuzzing puts the last one before other bytes, so that they
    /// reach this reader.
    pub starts: &'static [&'static [u8]],
    /// The smallest file with a triangle; empty if code generates one.
    pub sample: &'static [u8],
    /// Whether a file begins like a file of this format.
    pub(super) detect: fn(&Head<'_>) -> bool,
    /// Whether a file whose beginning matches no format can have this format, if its extension is
    /// that of the format.
    pub(super) is_possible: fn(&[u8]) -> bool,
    /// Reads the bytes of a file with the given name. Compressed arrays may decompress to at most
    /// the given number of bytes.
    pub(super) read: fn(&[u8], &str, u64) -> Result<MeshFile, ReadError>,
    /// `None` for a format that is read only.
    pub(super) write: Option<Write>,
}

/// The beginning of a file.
pub(super) struct Head<'a> {
    /// All bytes.
    pub bytes: &'a [u8],
    /// The bytes without leading white space.
    pub text: &'a [u8],
    /// The first word.
    pub word: &'a [u8],
}

impl<'a> Head<'a> {
    pub(super) fn of(bytes: &'a [u8]) -> Self {
        let text = bytes.trim_ascii_start();
        let word = text
            .split(u8::is_ascii_whitespace)
            .next()
            .unwrap_or_default();
        Self { bytes, text, word }
    }

    fn begins_with_any(&self, starts: &[&[u8]]) -> bool {
        starts.iter().any(|start| self.text.starts_with(start))
    }

    /// A text file has no zero byte. A binary STL file with a wrong size has one in its header or
    /// its first normal.
    fn has_zero(&self) -> bool {
        self.bytes[..self.bytes.len().min(256)].contains(&0)
    }

    fn is_solid(&self) -> bool {
        self.word.eq_ignore_ascii_case(b"solid")
    }
}

/// Every format, in the order of messages. Detection compares a file with them from the last to the
/// first, because an OBJ file has no characteristic first word.
pub static FORMATS: [FormatSpec; 9] = [
    FormatSpec {
        format: Format::Obj,
        name: "OBJ",
        listed: "OBJ",
        ending: "obj",
        target: "obj",
        starts: &[b"v", b"f", b"l", b"o\n"],
        sample: b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        detect: |head| obj::looks_like(head.bytes),
        is_possible: |_| true,
        read: |bytes, name, _| obj::read(bytes, name),
        write: Some(|path, mesh, lines, _| obj::write(path, mesh, lines).map(|()| 0)),
    },
    FormatSpec {
        format: Format::Ply,
        name: "PLY",
        listed: "PLY",
        ending: "ply",
        target: "ply",
        starts: &[b"ply\n"],
        sample: b"",
        detect: |head| head.word == b"ply",
        is_possible: |_| false,
        read: |bytes, name, _| ply::read(bytes, name),
        write: Some(|path, mesh, lines, encoding| {
            ply::write(path, mesh, lines, encoding).map(|()| 0)
        }),
    },
    FormatSpec {
        format: Format::StlBinary,
        name: "STL",
        listed: "STL",
        ending: "stl",
        target: "stl",
        starts: &[b""],
        sample: b"",
        detect: |head| head.is_solid() && head.has_zero(),
        is_possible: |_| true,
        read: |bytes, name, _| stl::read_binary(bytes, name),
        write: Some(|path, mesh, lines, encoding| {
            stl::write(path, mesh, encoding).map(|()| lines.len())
        }),
    },
    FormatSpec {
        format: Format::StlText,
        name: "STL",
        listed: "",
        ending: "stl",
        target: "stl",
        starts: &[b""],
        sample: b"solid\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendsolid\n",
        detect: |head| head.is_solid() && !head.has_zero(),
        is_possible: |_| false,
        read: |bytes, name, _| stl::read_text(bytes, name),
        write: None,
    },
    FormatSpec {
        format: Format::Off,
        name: "OFF",
        listed: "OFF",
        ending: "off",
        target: "off",
        starts: &[b"#", b"ST", b"C", b"N", b"n", b"4", b"OFF"],
        sample: b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        detect: |head| off::looks_like(head.bytes),
        is_possible: off::begins_with_a_count,
        read: |bytes, name, _| off::read(bytes, name),
        write: None,
    },
    FormatSpec {
        format: Format::Vtp,
        name: "VTK XML",
        listed: "VTP",
        ending: "vtp",
        target: "vtp",
        starts: &[b"<?xml", b"<!--", b"<VTKFile"],
        sample: b"",
        detect: |head| head.begins_with_any(&[b"<?xml", b"<VTKFile", b"<!--"]),
        is_possible: |_| false,
        read: |bytes, name, limit| vtp::read(bytes, name, limit.min(MAX_FILE_BYTES)),
        write: Some(|path, mesh, lines, _| {
            let data = vtp::PolyData {
                points: &mesh.vertices,
                triangles: &mesh.triangles,
                lines,
                ..Default::default()
            };
            vtp::write(path, &data).map(|()| 0)
        }),
    },
    FormatSpec {
        format: Format::Vtk,
        name: "legacy VTK",
        listed: "surfaces of legacy VTK",
        ending: "vtk",
        target: "vtk",
        starts: &[b"# vtk DataFile Version "],
        sample: b"",
        detect: |head| {
            let start = b"# vtk DataFile";
            let begin = head.text.get(..start.len());
            begin.is_some_and(|begin| begin.eq_ignore_ascii_case(start))
        },
        is_possible: |_| false,
        read: |bytes, name, _| vtk::read(bytes, name),
        write: Some(|path, mesh, lines, encoding| {
            vtk::write(path, mesh, lines, encoding).map(|()| 0)
        }),
    },
    FormatSpec {
        format: Format::DirectX,
        name: "DirectX text",
        listed: "DirectX text",
        ending: "x",
        target: "directx",
        starts: &[b"xof "],
        sample: b"xof 0303txt 0032\nMesh {\n3;\n0;0;0;,\n1;0;0;,\n0;1;0;;\n1;\n3;0,1,2;;\n}\n",
        detect: |head| head.begins_with_any(&[b"xof "]),
        is_possible: |_| false,
        read: |bytes, name, _| directx::read(bytes, name),
        write: None,
    },
    FormatSpec {
        format: Format::Medit,
        name: "Medit",
        listed: "Medit",
        ending: "mesh",
        target: "medit",
        starts: &[b"MeshVersionFormatted "],
        sample: b"MeshVersionFormatted 2\nDimension 3\nVertices 3\n0 0 0 0\n1 0 0 0\n0 1 0 0\nTriangles 1\n1 2 3 0\nEnd\n",
        detect: |head| head.word == medit::START,
        is_possible: |_| false,
        read: |bytes, name, _| medit::read(bytes, name),
        write: None,
    },
];

impl FormatSpec {
    /// Whether meshes can be written in this format.
    #[must_use]
    pub fn is_written(&self) -> bool {
        self.write.is_some()
    }
}

impl Format {
    /// The declaration of this format.
    #[must_use]
    pub fn spec(self) -> &'static FormatSpec {
        FORMATS
            .iter()
            .find(|spec| spec.format == self)
            .unwrap_or(&FORMATS[0])
    }

    /// Name in messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.spec().name
    }

    /// The format for the extension of a file name. `.stl` does not determine which of the two
    /// variants it is.
    pub(super) fn from_name(name: &str) -> Option<Self> {
        let ending = Path::new(name).extension()?.to_string_lossy();
        FORMATS
            .iter()
            .find(|spec| ending.eq_ignore_ascii_case(spec.ending))
            .map(|spec| spec.format)
    }
}

/// The readable formats, for messages.
pub(super) fn readable() -> String {
    let names: Vec<&str> = FORMATS
        .iter()
        .map(|spec| spec.listed)
        .filter(|name| !name.is_empty())
        .collect();
    let (last, first) = names.split_last().unwrap_or((&"", &[]));
    format!("{} and {last} can be read", first.join(", "))
}

/// The extensions of the writable formats, for messages.
#[must_use]
pub fn writable() -> String {
    let mut endings = Vec::new();
    for spec in FORMATS.iter().filter(|spec| spec.is_written()) {
        endings.push(format!(".{}", spec.ending));
    }
    endings.sort();
    endings.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::read_bytes;

    #[test]
    fn a_sample_is_read_as_its_format_and_as_one_triangle() {
        let mut count = 0;
        for spec in FORMATS.iter().filter(|spec| !spec.sample.is_empty()) {
            let file = read_bytes(spec.sample, "no ending").expect(spec.name);
            assert_eq!(
                (file.format, file.mesh.triangles.len()),
                (Some(spec.format), 1)
            );
            count += 1;
        }
        assert_eq!(count, 5);
    }

    #[test]
    fn formats_are_named_in_messages() {
        let readable_now =
            "OBJ, PLY, STL, OFF, VTP, surfaces of legacy VTK, DirectX text and Medit can be read";
        assert_eq!(readable(), readable_now);
        assert_eq!(writable(), ".obj, .ply, .stl, .vtk, .vtp");
        assert!(
            FORMATS
                .iter()
                .all(|spec| spec.format.spec().name == spec.name)
        );
        assert_eq!(Format::from_name("a.STL"), Some(Format::StlBinary));
        assert_eq!(Format::from_name("a.stlx"), None);
    }
}
