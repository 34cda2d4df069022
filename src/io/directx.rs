//! DirectX text (`.x`): the meshes of all frames, transformed by the matrices of their frames.
//!
//! Coordinates and the order of corners are unchanged. The format calls its axes left-handed; a
//! caller who needs a right-handed frame mirrors one axis. A mesh that a frame only references by
//! name stays where it is defined.

use nalgebra::{Matrix4, Point3};

use super::MeshFile;
use super::cursor::{Cursor, count, finite, integer, number};
use super::error::{ReadError, ReadProblem};
use super::surface::Surface;

/// Greatest depth of nested objects; real files nest to the depth of a skeleton.
const DEEPEST: usize = 256;

/// True for each byte that ends a word; a table, because every byte of a file is tested.
const ENDS_WORD: [bool; 256] = {
    let ends = b" \t\r\n\x0b\x0c;,{}\"#";
    let mut table = [false; 256];
    let mut i = 0;
    while i < ends.len() {
        table[ends[i] as usize] = true;
        i += 1;
    }
    table
};

struct Reader<'a> {
    cursor: Cursor<'a>,
    bytes: &'a [u8],
    position: usize,
    surface: Surface,
    /// The matrix of each open object; `None` is the identity, which must not change a bit.
    open: Vec<Option<Matrix4<f64>>>,
}

/// Reads the text variant of DirectX files.
///
/// # Errors
/// The binary and compressed variants, counts beyond the size of the file, a malformed number, an
/// index out of range, unbalanced braces.
pub(super) fn read(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    let mut reader = Reader {
        cursor: Cursor::new(name, bytes),
        bytes,
        position: 0,
        surface: Surface::default(),
        open: Vec::new(),
    };
    let header = reader.cursor.next_line().unwrap_or_default();
    let text = bytes.trim_ascii_start();
    if text.get(8..12) != Some(b"txt ") {
        let what = "another variant of DirectX files than text";
        return Err(reader
            .cursor
            .fail(ReadProblem::Unsupported { what }, header));
    }
    // The header ends with the size of a float: `xof 0302txt 0064`.
    reader.position = bytes.len() - text.len() + text.len().min(16);
    while let Some(token) = reader.token() {
        reader.object(token)?;
    }
    if !reader.open.is_empty() {
        return Err(reader.fail(
            ReadProblem::Truncated {
                what: "an object without its closing brace",
            },
            b"",
        ));
    }
    reader.surface.finish(&reader.cursor)
}

impl<'a> Reader<'a> {
    fn fail(&self, problem: ReadProblem, found: &[u8]) -> ReadError {
        let offset = self.cursor.offset_of(found).unwrap_or(self.position);
        self.cursor.fail_at_offset(offset, true, problem, found)
    }

    /// The next word, brace or quoted text; separators and comments are skipped.
    fn token(&mut self) -> Option<&'a [u8]> {
        loop {
            let rest = self.bytes.get(self.position..)?;
            match *rest.first()? {
                b'#' => self.skip_line(rest),
                b'/' if rest.get(1) == Some(&b'/') => self.skip_line(rest),
                b' ' | b'\t' | b'\r' | b'\n' | b';' | b',' | 0x0b | 0x0c => self.position += 1,
                _ => break,
            }
        }
        let rest = self.bytes.get(self.position..)?;
        let length = match rest.first()? {
            b'{' | b'}' => 1,
            b'"' => rest[1..]
                .iter()
                .position(|&b| b == b'"')
                .map_or(rest.len(), |n| n + 2),
            _ => rest
                .iter()
                .position(|&b| ENDS_WORD[usize::from(b)])
                .unwrap_or(rest.len())
                .max(1),
        };
        self.position += length;
        Some(&rest[..length])
    }

    fn skip_line(&mut self, rest: &[u8]) {
        self.position += rest
            .iter()
            .position(|&b| b == b'\n' || b == b'\r')
            .unwrap_or(rest.len());
    }

    fn object(&mut self, token: &[u8]) -> Result<(), ReadError> {
        match token {
            // A template declares the members of objects of its name; it has no data.
            b"template" => self.skip_braces(),
            b"{" => self.push(token),
            b"}" => match self.open.pop() {
                Some(_) => Ok(()),
                None => Err(self.fail(
                    ReadProblem::Expected {
                        what: "an opening brace before this one",
                    },
                    token,
                )),
            },
            b"FrameTransformMatrix" if self.opens()? => self.matrix(),
            b"Mesh" if self.opens()? => self.mesh(),
            _ => Ok(()),
        }
    }

    /// Reads the name of an object, if any, and its brace; `false` if the word is only a reference.
    fn opens(&mut self) -> Result<bool, ReadError> {
        let start = self.position;
        for _ in 0..2 {
            match self.token() {
                Some(b"{") => {
                    self.push(b"{")?;
                    return Ok(true);
                }
                Some(b"}") | None => break,
                Some(_) => {}
            }
        }
        self.position = start;
        Ok(false)
    }

    fn push(&mut self, found: &[u8]) -> Result<(), ReadError> {
        if self.open.len() == DEEPEST {
            return Err(self.fail(
                ReadProblem::Expected {
                    what: "at most 256 objects inside one another",
                },
                found,
            ));
        }
        let matrix = self.open.last().copied().flatten();
        self.open.push(matrix);
        Ok(())
    }

    fn skip_braces(&mut self) -> Result<(), ReadError> {
        let mut depth = 0usize;
        while let Some(token) = self.token() {
            match token {
                b"{" => depth += 1,
                b"}" if depth <= 1 => return Ok(()),
                b"}" => depth -= 1,
                _ => {}
            }
        }
        Err(self.fail(ReadProblem::Truncated { what: "a template" }, b""))
    }

    fn word(&mut self, what: &'static str) -> Result<&'a [u8], ReadError> {
        self.token()
            .ok_or_else(|| self.fail(ReadProblem::Truncated { what }, b""))
    }

    /// A matrix belongs to the frame around it and acts on row vectors.
    fn matrix(&mut self) -> Result<(), ReadError> {
        let mut local = Matrix4::zeros();
        for row in 0..4 {
            for column in 0..4 {
                let word = self.word("a matrix")?;
                let value = number(word).and_then(|v| finite(v, self.surface.vertices.len()));
                // The transpose acts on column vectors, the convention of this library.
                local[(column, row)] = value.map_err(|problem| self.fail(problem, word))?;
            }
        }
        let depth = self.open.len();
        // The last open object is the matrix itself, the one before is its frame, and the one
        // before that the parent frame.
        let parent = depth.checked_sub(3).and_then(|i| self.open[i]);
        if let Some(frame) = depth.checked_sub(2).and_then(|i| self.open.get_mut(i))
            && local != Matrix4::identity()
        {
            *frame = Some(parent.map_or(local, |parent| parent * local));
        }
        Ok(())
    }

    /// A count; an error if the rest of the file is too short for this number of items of
    /// `smallest` bytes.
    fn count(&mut self, what: &'static str, smallest: u64) -> Result<usize, ReadError> {
        let word = self.word(what)?;
        let declared = count(word, what).map_err(|problem| self.fail(problem, word))?;
        let possible = (self.bytes.len() - self.position) as u64 / smallest;
        match usize::try_from(declared) {
            Ok(count) if declared <= possible => Ok(count),
            _ => Err(self.fail(ReadProblem::CountExceedsFile { declared, possible }, word)),
        }
    }

    fn mesh(&mut self) -> Result<(), ReadError> {
        let matrix = self.open.last().copied().flatten();
        let first = self.surface.vertices.len();
        let count = self.count("the number of vertices", 6)?;
        for _ in 0..count {
            let mut position = Point3::origin();
            for axis in 0..3 {
                let word = self.word("the vertices")?;
                let value = self
                    .surface
                    .coordinate(word, &|| self.cursor.place_of(self.position, true));
                position[axis] = value.map_err(|problem| self.fail(problem, word))?;
            }
            if let Some(matrix) = matrix {
                position = matrix.transform_point(&position);
                for c in position.iter() {
                    finite(*c, self.surface.vertices.len())
                        .map_err(|problem| self.fail(problem, b""))?;
                }
            }
            self.surface.vertices.push(position);
        }
        let faces = self.count("the number of faces", 2)?;
        let mut corners = Vec::new();
        for _ in 0..faces {
            let start = self.position;
            let length = self.count("the number of corners of a face", 2)?;
            corners.clear();
            corners.reserve_exact(length);
            for _ in 0..length {
                let word = self.word("the faces")?;
                let index = integer(word).and_then(|index| {
                    let in_mesh = usize::try_from(index).is_ok_and(|i| i < count);
                    // A file of at most 2 GiB has fewer vertices than 32 bits count.
                    if in_mesh {
                        Ok(first as u32 + index as u32)
                    } else {
                        Err(out_of_range(index, count))
                    }
                });
                corners.push(index.map_err(|problem| self.fail(problem, word))?);
            }
            let place = || self.cursor.place_of(start, true);
            self.surface.polygon(&corners, &place).map_err(|problem| {
                let found = &self.bytes[start..self.position];
                let begin = found
                    .iter()
                    .position(|b| !b" \t\r\n;,".contains(b))
                    .unwrap_or(0);
                self.fail(problem, &found[begin..])
            })?;
        }
        Ok(())
    }
}

fn out_of_range(index: i64, count: usize) -> ReadProblem {
    ReadProblem::IndexOutOfRange {
        index,
        count,
        from_one: false,
    }
}

#[cfg(test)]
mod tests {
    use crate::io::read_bytes;

    const MESH: &str = "Mesh body {\n 4;\n 0.0;0.0;0.0;,\n 1.0;0;0;,\n 1;1;0;,\n 0;1;0;;\n 2;\n 3;0,1,2;,\n 4;0,1,2,3;;\n\
        MeshNormals { 1; 0;0;1;; 2; 3;0,0,0;, 4;0,0,0,0;; }\n}\n";

    fn error(text: &str) -> String {
        read_bytes(text.as_bytes(), "a.x").unwrap_err().terse()
    }

    #[test]
    fn meshes_frames_and_templates() {
        let template = "template Mesh {\n <3D82AB44-62DA-11cf-AB39-0020AF71E433>\n DWORD nVertices;\n array Vector v[nVertices]; [...]\n}\n";
        let text = format!(
            "xof 0302txt 0064\n// note {{\n{template}# note }}\n{MESH}Material m {{ \"a{{b\"; {{Mesh}} }}"
        );
        let file = read_bytes(text.as_bytes(), "a").unwrap();
        assert_eq!(file.mesh.vertices.len(), 4);
        assert_eq!(file.mesh.triangles, [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);
        let moved = "FrameTransformMatrix { 0,1,0,0, -1,0,0,0, 0,0,1,0, 5,0,0,1;; }";
        let text =
            format!("xof 0303txt 0032 Frame a {{ {moved} Frame b {{ {moved} {MESH} }} }} {MESH}");
        let file = read_bytes(text.as_bytes(), "a").unwrap();
        // Turned by a right angle about z and then moved by 5 along x, twice.
        let corner = file.mesh.vertices[1];
        assert_eq!([corner.x, corner.y, corner.z], [4., 5., 0.]);
        assert_eq!(file.mesh.vertices[5].x, 1.0);
        assert_eq!(file.mesh.triangles[3], [4, 5, 6]);
    }

    #[test]
    fn braces_inside_a_template_are_part_of_it() {
        let template = "template T { { Mesh } [ { a } ] Mesh }";
        let file = read_bytes(
            format!("xof 0302txt 0064 {template} {MESH}").as_bytes(),
            "a",
        )
        .unwrap();
        assert_eq!(
            (file.mesh.vertices.len(), file.mesh.triangles.len()),
            (4, 3)
        );
        let cut = error("xof 0302txt 0064\ntemplate T { { a }\n");
        assert!(
            cut.starts_with("a.x:3: error[E041]: the file ends too early, in a template;"),
            "{cut}"
        );
    }

    #[test]
    fn an_identity_changes_no_bit() {
        let mesh = MESH.replace(" 0.0;0.0;0.0;,", " -0.0;0.1;1e-320;,");
        let matrix = "FrameTransformMatrix { 1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1;; }";
        let text = format!("xof 0302txt 0064 Frame {{ {matrix} {mesh} }}");
        let corner = read_bytes(text.as_bytes(), "a").unwrap().mesh.vertices[0];
        assert_eq!(
            [corner.x, corner.y, corner.z].map(f64::to_bits),
            [-0.0f64, 0.1, 1e-320].map(f64::to_bits)
        );
        // Outside all frames no matrix acts.
        let text = format!(
            "xof 0302txt 0064 {} {MESH}",
            matrix.replace("0,0,0,1;;", "5,0,0,1;;")
        );
        assert_eq!(
            read_bytes(text.as_bytes(), "a").unwrap().mesh.vertices[1].x,
            1.0
        );
    }

    #[test]
    fn what_is_wrong_is_named() {
        let whole = format!("xof 0302txt 0064\n{MESH}");
        let wrong = error(&whole.replace("3;0,1,2;,\n", "3;0,1,4;,\n"));
        assert!(
            wrong.starts_with("a.x:9:8: error[E020]: vertex index 4 is out of range: there are 4"),
            "{wrong}"
        );
        assert!(error(&whole.replace("3;0,1,2;,\n", "2;0,1;,\n")).contains("a.x:9:2: error[E024]"));
        assert!(
            error(&whole.replace(" 4;\n", " 400;\n"))
                .contains("a.x:3:2: error[E040]: 400 items are declared")
        );
        assert!(error(&whole.replace(" 1.0;0", " 1.x;0")).contains("a.x:5:2: error[E011]"));
        assert!(error("xof 0302bin 0064").contains("another variant of DirectX files than text"));
        assert!(error(&format!("{whole}}}")).contains("an opening brace before this one"));
        assert!(error(&whole[..whole.len() - 3]).contains("without its closing brace"));
        assert!(
            error(&format!("xof 0302txt 0064 {}", "A {".repeat(300)))
                .contains("at most 256 objects")
        );
        for length in 0..whole.len() {
            let _ = read_bytes(&whole.as_bytes()[..length], "a.x");
        }
    }
}
