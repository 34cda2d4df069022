//! Readers and writers, one file a format.
//!
//! [`read`] takes OBJ, PLY, STL and legacy VTK polydata and finds the format in the content. The legacy VTK writer is
//! [`vtk::write`], frames for ParaView are written by [`vtp::write`] and collected by [`pvd::Collection`].
//! Numbers are passed on as they stand in the file: no scale is applied, no vertices are merged (but see [`read`] on STL).

mod cursor;
mod error;
mod obj;
mod part;
mod ply;
pub mod pvd;
mod stl;
mod surface;
pub mod vtk;
pub mod vtp;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::mesh::TriangleMesh;
use cursor::Cursor;
pub use error::{Place, Problem, ReadError};
pub(crate) use part::write_whole;

/// The largest file that is read [bytes].
pub const MAX_FILE_BYTES: u64 = 1 << 31;

/// What a mesh file holds, in the unit of the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshFile {
    /// Vertices and triangles; polygons are split as a fan around their first corner. With lines it may have no triangle.
    pub mesh: TriangleMesh,
    /// Polylines of at least two indices into the vertices.
    pub lines: Vec<Vec<u32>>,
    /// Number of triangles that named a vertex twice and were left out: they enclose nothing and their edges cancel.
    pub degenerate: usize,
}

/// The formats that can be read.
#[derive(Clone, Copy, PartialEq)]
enum Format {
    Obj,
    Ply,
    StlText,
    StlBinary,
    Vtk,
}

/// Reads a mesh file; the content decides on the format, the extension only where the content is silent.
///
/// STL has no topology: its corners are merged where all three coordinates are equal bit for bit (-0 counted as 0).
///
/// # Errors
/// A file that cannot be read or is larger than [`MAX_FILE_BYTES`], a format that is unknown or not supported, and
/// content that is no mesh: see [`Problem`].
pub fn read(path: &Path) -> Result<MeshFile, ReadError> {
    let name = path.display().to_string();
    let too_large = |bytes| {
        let problem = Problem::TooLarge { bytes, limit: MAX_FILE_BYTES };
        Cursor::new(&name, b"").fail_at(Place::Whole, problem, b"")
    };
    let io = |source| ReadError::Io { file: name.clone(), source };
    let file = File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    if length > MAX_FILE_BYTES {
        return Err(too_large(length));
    }
    let mut bytes = Vec::new();
    // A pipe or a file that grows says nothing useful of its length, hence the second limit.
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(too_large(bytes.len() as u64));
    }
    read_bytes(&bytes, &name)
}

/// Reads a mesh from the bytes of a file; `name` stands in errors and its extension breaks ties.
///
/// # Errors
/// As [`read`], but for those of the file system.
pub fn read_bytes(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let format = detect(bytes, name)
        .map_err(|problem| Cursor::new(name, bytes).fail_at(Place::Whole, problem, &bytes[..bytes.len().min(8)]))?;
    match format {
        Format::Obj => obj::read(bytes, name),
        Format::Ply => ply::read(bytes, name),
        Format::StlText => stl::read_text(bytes, name),
        Format::StlBinary => stl::read_binary(bytes, name),
        Format::Vtk => vtk::read(bytes, name),
    }
}

/// The first words of formats that are known but not read.
const UNSUPPORTED: [(&str, &str); 9] = [
    ("<?xml", "XML (VTP or another)"),
    ("<VTKFile", "VTK XML (VTP)"),
    ("OFF", "OFF"),
    ("COFF", "OFF with colours"),
    ("NOFF", "OFF with normals"),
    ("STOFF", "OFF with texture coordinates"),
    ("glTF", "binary glTF"),
    ("$MeshFormat", "Gmsh"),
    ("PK\u{3}\u{4}", "a ZIP archive"),
];

/// Finds the format in the content.
fn detect(bytes: &[u8], name: &str) -> Result<Format, Problem> {
    if bytes.is_empty() {
        return Err(Problem::Empty);
    }
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(Problem::Utf16);
    }
    // The size rule comes before "solid": many binary files begin with that word.
    if stl::has_binary_size(bytes) {
        return Ok(Format::StlBinary);
    }
    let text = bytes.trim_ascii_start();
    let word = text.split(u8::is_ascii_whitespace).next().unwrap_or_default();
    if starts_with_ignoring_case(text, b"# vtk DataFile") {
        return Ok(Format::Vtk);
    }
    if word == b"ply" {
        return Ok(Format::Ply);
    }
    if word.eq_ignore_ascii_case(b"solid") {
        return Ok(Format::StlText);
    }
    if let Some((_, what)) = UNSUPPORTED.iter().find(|(start, _)| word == start.as_bytes() || is_tag(text, start)) {
        return Err(Problem::Unsupported { what });
    }
    if obj::looks_like(bytes) {
        return Ok(Format::Obj);
    }
    match Path::new(name).extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).as_deref() {
        Some("obj") => Ok(Format::Obj),
        Some("stl") => Ok(Format::StlBinary),
        _ => Err(Problem::UnknownFormat),
    }
}

/// Whether a start that is no plain word (a tag, a signature) opens the text.
fn is_tag(text: &[u8], start: &str) -> bool {
    !start.ends_with("OFF") && text.starts_with(start.as_bytes())
}

fn starts_with_ignoring_case(text: &[u8], start: &[u8]) -> bool {
    text.get(..start.len()).is_some_and(|t| t.eq_ignore_ascii_case(start))
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
        let mesh = read_bytes(OBJ.as_bytes(), "wrong.ply").unwrap();
        assert_eq!(mesh, read_bytes(OBJ.as_bytes(), "no extension").unwrap());
        assert_eq!(mesh.mesh.triangles, [[0, 1, 2]]);
        let with_mark = [b"\xef\xbb\xbf", OBJ.as_bytes()].concat();
        assert_eq!(mesh, read_bytes(&with_mark, "a.obj").unwrap());
    }

    #[test]
    fn what_is_no_mesh_is_named() {
        assert_eq!(error(b"", "a.obj"), "a.obj: the file is empty");
        let text = "a.obj: the text is UTF-16; save it as UTF-8 (found '\u{fffd}\u{fffd}v\\u{0}')";
        assert_eq!(error(b"\xff\xfev\0", "a.obj"), text);
        assert_eq!(
            error(b"plyy 1 2 3", "a.ply"),
            format!("a.ply: unknown format; {} (found 'plyy 1 2')", error::READABLE)
        );
        assert!(error(b"OFF\n3 1 0", "a.off").starts_with("a.off: OFF: format not supported yet; OBJ, PLY, STL"));
        assert!(error(b"<VTKFile type=", "a.vtp").starts_with("a.vtp: VTK XML (VTP): format not supported yet"));
        assert_eq!(error(b"# nothing\n", "a.obj"), "a.obj: the file has no vertices");
        assert_eq!(error(b"v 1 2 3", "a"), "a: the file has 1 vertices, but no faces and no lines");
    }

    #[test]
    fn a_missing_file_is_an_error() {
        let text = read(Path::new("no/such/file.obj")).unwrap_err().to_string();
        assert!(text.starts_with("no/such/file.obj: cannot be read: "), "{text}");
        assert!(read(&std::env::temp_dir()).is_err());
    }
}
