//! Readers and writers, one file per format.
//!
//! [`read`] reads OBJ, PLY, STL, OFF, VTP, surfaces of legacy VTK, DirectX text and Medit; the content
//! decides on the format. [`write`] writes a mesh in the format of the extension. [`vtp::write`()]
//! writes frames for ParaView; [`pvd::Collection`] collects them and [`pvd::read`] reads a
//! collection. Numbers are those of the file: no scale is applied and no vertices are merged
//! (except by STL, see [`read`]).

pub(crate) mod cursor;
#[cfg(feature = "compression")]
mod decompress;
mod directx;
mod encoded;
pub(crate) mod error;
mod formats;
mod medit;
pub mod obj;
pub(crate) mod names;
mod off;
mod part;
pub(crate) mod ply;
pub mod pvd;
pub(crate) mod stl;
mod surface;
pub(crate) mod vtk;
pub mod vtp;
pub(crate) mod warning;
mod write;
mod xml;

pub use names::{LIST, file_name};

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::mesh::TriangleMesh;
use cursor::Cursor;
pub use error::{FilePlace, ReadError, ReadProblem};
use formats::Head;
pub use formats::{Encoding, FORMATS, Format, writable};
pub(crate) use part::check_mesh;
pub use part::write_whole;
pub use warning::{Warned, Warning, Warnings};
pub use write::{WriteError, write};

/// The largest file that is read [bytes].
pub const MAX_FILE_BYTES: u64 = 1 << 31;

/// Content of a mesh file, in the unit of the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshFile {
    /// Vertices and triangles; polygons are split as a fan around their first corner. A file with
    /// lines can have no triangle.
    pub mesh: TriangleMesh,
    /// Polylines of at least two indices into the vertices.
    pub lines: Vec<Vec<u32>>,
    /// The format of the content; `None` for a mesh from memory.
    pub format: Option<Format>,
    /// Accepted content that is possibly a mistake.
    pub warnings: Warnings,
}

/// Reads a mesh file. The content decides on the format, the extension only if the content is
/// ambiguous.
///
/// STL has no topology: corners with three bitwise equal coordinates are merged (-0 equals 0).
///
/// # Errors
/// A file that cannot be read or is larger than [`MAX_FILE_BYTES`], an unknown or unsupported
/// format, and content that is no mesh: see [`ReadProblem`].
pub fn read(path: &Path) -> Result<MeshFile, ReadError> {
    read_within(path, MAX_FILE_BYTES)
}

/// The same as [`read`], with the given limit instead of [`MAX_FILE_BYTES`] on the size of the file
/// and on the total size of its decompressed arrays [bytes].
///
/// # Errors
/// As [`read`].
pub fn read_within(path: &Path, limit: u64) -> Result<MeshFile, ReadError> {
    let limit = limit.min(MAX_FILE_BYTES);
    read_bytes_within(&bytes_of(path, limit)?, &path.display().to_string(), limit)
}

/// Numbers at the vertices of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct PointData {
    /// The name of the array.
    pub name: String,
    /// Number of components at each vertex.
    pub components: usize,
    /// Values with the components of a vertex together, shape `[vertex_count * components]`; those
    /// of the file, including NaN.
    pub values: Vec<f64>,
}

/// Reads the numbers at the vertices of a `.vtp` file; empty for other formats.
///
/// # Errors
/// Those of [`read`], and arrays of another size than declared.
pub fn read_point_data(path: &Path) -> Result<Vec<PointData>, ReadError> {
    let bytes = bytes_of(path, MAX_FILE_BYTES)?;
    let name = path.display().to_string();
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    match detect(text, &name) {
        Ok(Format::Vtp) => vtp::point_data(text, &name, MAX_FILE_BYTES),
        _ => Ok(Vec::new()),
    }
}

/// Reads a mesh and the numbers at its vertices; only `.vtp` files have numbers that are read.
///
/// # Errors
/// Those of [`read`] and [`read_point_data`].
pub fn read_with_point_data(path: &Path) -> Result<(MeshFile, Vec<PointData>), ReadError> {
    let bytes = bytes_of(path, MAX_FILE_BYTES)?;
    let name = path.display().to_string();
    let file = read_bytes(&bytes, &name)?;
    let data = match file.format {
        Some(Format::Vtp) => vtp::point_data(
            bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes),
            &name,
            MAX_FILE_BYTES,
        )?,
        _ => Vec::new(),
    };
    Ok((file, data))
}

/// The bytes of a file; an error if there are more than `limit`.
fn bytes_of(path: &Path, limit: u64) -> Result<Vec<u8>, ReadError> {
    let name = path.display().to_string();
    let too_large = |bytes| {
        let problem = ReadProblem::TooLarge { bytes, limit };
        Cursor::new(&name, b"").fail_at(FilePlace::Whole, problem, b"")
    };
    let io = |source| ReadError::Io {
        file: name.clone(),
        source,
    };
    let file = File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    if length > limit {
        return Err(too_large(length));
    }
    let mut bytes = Vec::new();
    // The length of a pipe or a growing file is unknown, hence the second limit.
    file.take(limit + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > limit {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}

/// Reads a mesh from the bytes of a file. `name` appears in errors, and its extension decides
/// ambiguous cases.
///
/// # Errors
/// Those of [`read`] without those of the file system.
pub fn read_bytes(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    read_bytes_within(bytes, name, MAX_FILE_BYTES)
}

/// The same as [`read_bytes`], with a limit on the total size of decompressed arrays [bytes].
///
/// # Errors
/// Those of [`read`] without those of the file system.
pub fn read_bytes_within(bytes: &[u8], name: &str, limit: u64) -> Result<MeshFile, ReadError> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let format = detect(bytes, name).map_err(|problem| {
        Cursor::new(name, bytes).fail_at(FilePlace::Whole, problem, &bytes[..bytes.len().min(8)])
    })?;
    let result = (format.spec().read)(bytes, name, limit);
    // `.stl` means either variant.
    let other = Format::from_name(name).filter(|promised| promised.name() != format.name());
    match (result, other) {
        (Ok(mut file), other) => {
            file.format = Some(format);
            if let Some(promised) = other {
                file.warnings.note(
                    Warning::OtherFormat {
                        promised,
                        found: format,
                    },
                    &|| FilePlace::Whole,
                );
            }
            Ok(file)
        }
        // The reader of the message assumes the format of the extension.
        (Err(error), Some(_)) => Err(error.with_format(format)),
        (Err(error), None) => Err(error),
    }
}

/// First bytes of known formats that are not supported.
const UNSUPPORTED: [(&str, &str); 5] = [
    ("glTF", "binary glTF"),
    ("$MeshFormat", "Gmsh"),
    ("PK\u{3}\u{4}", "a ZIP archive"),
    ("\u{1f}", "a compressed file"),
    ("{", "JSON (glTF or another)"),
];

/// Finds the format in the content.
fn detect(bytes: &[u8], name: &str) -> Result<Format, ReadProblem> {
    if bytes.is_empty() {
        return Err(ReadProblem::Empty);
    }
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(ReadProblem::Utf16);
    }
    // The size rule precedes "solid": many binary files begin with that word.
    if stl::has_binary_size(bytes) {
        return Ok(Format::StlBinary);
    }
    let head = Head::of(bytes);
    let of_content = FORMATS.iter().rev().find(|spec| (spec.detect)(&head));
    // A format with a characteristic first word precedes known formats that cannot be read; OBJ has
    // no such word.
    if let Some(spec) = of_content.filter(|spec| spec.format != Format::Obj) {
        return Ok(spec.format);
    }
    if let Some((_, what)) = UNSUPPORTED
        .iter()
        .find(|(start, _)| head.text.starts_with(start.as_bytes()))
    {
        return Err(ReadProblem::Unsupported { what });
    }
    if let Some(spec) = of_content {
        return Ok(spec.format);
    }
    // The other formats begin with their own words, which are missing here.
    Format::from_name(name)
        .filter(|format| (format.spec().is_possible)(bytes))
        .ok_or(ReadProblem::UnknownFormat)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

    fn error(bytes: &[u8], name: &str) -> String {
        read_bytes(bytes, name).unwrap_err().to_string()
    }

    #[test]
    fn the_content_decides() {
        let mesh = read_bytes(OBJ.as_bytes(), "no extension").unwrap();
        assert_eq!(
            (mesh.mesh.triangles.as_slice(), mesh.format),
            (&[[0, 1, 2]][..], Some(Format::Obj))
        );
        assert!(mesh.warnings.is_empty());
        assert_eq!(
            Ok(&mesh),
            read_bytes(OBJ.as_bytes(), "a.txt")
                .as_ref()
                .map_err(ReadError::terse),
            "no promise"
        );
        let mut misnamed = read_bytes(OBJ.as_bytes(), "wrong.ply").unwrap();
        let lines: Vec<String> = misnamed
            .warnings
            .iter()
            .map(|w| w.terse("wrong.ply"))
            .collect();
        assert_eq!(
            lines,
            ["wrong.ply: warning[W010]: the name says PLY, the content is OBJ"]
        );
        misnamed.warnings = Warnings::default();
        assert_eq!(mesh, misnamed);
        let with_mark = [b"\xef\xbb\xbf", OBJ.as_bytes()].concat();
        assert_eq!(mesh, read_bytes(&with_mark, "a.obj").unwrap());
    }

    #[test]
    fn an_error_says_that_the_content_is_of_another_format() {
        let terse = |name| read_bytes(b"v 0 0 0\nv 1 0 x\n", name).unwrap_err().terse();
        let help = "the file is cut off, damaged or of another dialect: export it again";
        assert_eq!(
            terse("a.obj"),
            format!("a.obj:2:7: error[E011]: expected a number (found 'x'); {help}")
        );
        let other = "the content is OBJ, whatever the name says";
        assert_eq!(
            terse("a.stl"),
            format!("a.stl:2:7: error[E011]: expected a number (found 'x'); {other}; {help}")
        );
        let mut stl = b"solid of something ".to_vec();
        stl.resize(200, 0);
        assert!(error(&stl, "a").contains("offset"), "{}", error(&stl, "a"));
    }

    #[test]
    fn a_limit_of_ones_own() {
        let path = crate::testing::Scratch::file("limit.obj");
        std::fs::write(&*path, OBJ).unwrap();
        assert!(read_within(&path, OBJ.len() as u64).is_ok());
        let text = read_within(&path, 10).unwrap_err().to_string();
        assert!(text.contains("bytes, more than the limit of 10"), "{text}");
    }

    /// A device reports no bytes and gives an unlimited number.
    #[cfg(unix)]
    #[test]
    fn the_limit_holds_where_the_length_is_not_known() {
        let text = read_within(Path::new("/dev/zero"), 10).unwrap_err().terse();
        assert!(
            text.starts_with(
                "/dev/zero: error[E044]: the file has 11 bytes, more than the limit of 10;"
            ),
            "{text}"
        );
    }

    #[test]
    fn what_is_no_mesh_is_named() {
        assert_eq!(error(b"", "a.obj"), "a.obj: the file is empty");
        let text = "a.obj: the text is UTF-16; save it as UTF-8 (found '\u{fffd}\u{fffd}v\\u{0}')";
        assert_eq!(error(b"\xff\xfev\0", "a.obj"), text);
        assert_eq!(
            error(b"plyy 1 2 3", "a.ply"),
            format!(
                "a.ply: unknown format; {} (found 'plyy 1 2')",
                formats::readable()
            )
        );
        assert!(error(b"OFFF\n3 1 0\n", "a.off").starts_with("a.off: unknown format; OBJ"));
        assert!(
            error(b"\x1f\x8b\x08", "a.obj")
                .starts_with("a.obj: a compressed file: format not supported yet; OBJ")
        );
        assert_eq!(
            error(b"# nothing\n", "a.obj"),
            "a.obj: the file has no vertices"
        );
        assert_eq!(
            error(b"v 1 2 3", "a"),
            "a: the file has 1 vertices, but no faces and no lines"
        );
    }

    #[test]
    fn a_missing_file_is_an_error() {
        let text = read(Path::new("no/such/file.obj")).unwrap_err().to_string();
        assert!(
            text.starts_with("no/such/file.obj: cannot be read: "),
            "{text}"
        );
        assert!(read(&std::env::temp_dir()).is_err());
    }
}
