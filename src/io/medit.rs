//! Medit, the mesh format of INRIA, as text (`.mesh`): MMG, CGAL, Gmsh and TetGen write it.

use nalgebra::Point3;

use super::MeshFile;
use super::cursor::{Cursor, count, integer};
use super::error::{ReadError, ReadProblem};
use super::surface::Surface;

/// First word of a file.
pub(super) const START: &[u8] = b"MeshVersionFormatted";

/// Sections of volume cells. A file with such cells alone has no surface.
const CELLS: [&[u8]; 4] = [b"Tetrahedra", b"Hexahedra", b"Prisms", b"Pyramids"];

struct Reader<'a> {
    cursor: Cursor<'a>,
    surface: Surface,
}

/// Reads vertices, triangles, quadrilaterals and edges. Each edge is a line of its own. Other
/// sections are skipped.
///
/// # Errors
/// Another dimension than 3, volume cells without their surface, counts beyond the size of the
/// file, a malformed number, an index out of range.
pub(super) fn read(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    let mut reader = Reader {
        cursor: Cursor::new(name, bytes),
        surface: Surface::default(),
    };
    let (mut faces, mut has_cells) = (0, false);
    while let Some(word) = reader.word()? {
        match word {
            b"End" => break,
            b"Dimension" => reader.dimension()?,
            b"Vertices" => reader.vertices()?,
            b"Edges" => faces += reader.items(2)?,
            b"Triangles" => faces += reader.items(3)?,
            b"Quadrilaterals" => faces += reader.items(4)?,
            // The numbers of any other section.
            _ => has_cells |= CELLS.contains(&word),
        }
    }
    if has_cells && faces == 0 {
        let what = "volume cells without their surface";
        return Err(reader.cursor.fail(ReadProblem::Unsupported { what }, b""));
    }
    reader.surface.finish(&reader.cursor)
}

impl<'a> Reader<'a> {
    /// The next word outside comments.
    fn word(&mut self) -> Result<Option<&'a [u8]>, ReadError> {
        while let Some(word) = self.cursor.token() {
            if word.contains(&0) {
                return Err(self.cursor.fail(ReadProblem::NulByte, word));
            }
            if !word.starts_with(b"#") {
                return Ok(Some(word));
            }
            self.cursor.next_line();
        }
        Ok(None)
    }

    /// The next word of a section.
    fn number(&mut self, what: &'static str) -> Result<&'a [u8], ReadError> {
        match self.word()? {
            Some(word) => Ok(word),
            None => Err(self.cursor.fail(ReadProblem::Truncated { what }, b"")),
        }
    }

    fn dimension(&mut self) -> Result<(), ReadError> {
        let word = self.number("the dimension")?;
        match word {
            b"3" => Ok(()),
            _ => {
                let what = "Medit of another dimension than 3";
                Err(self.cursor.fail(ReadProblem::Unsupported { what }, word))
            }
        }
    }

    /// The number of entries of a section; each has `numbers` numbers.
    fn count(&mut self, numbers: u64) -> Result<u64, ReadError> {
        let word = self.number("the number of entries")?;
        let declared = count(word, "the number of entries")
            .map_err(|problem| self.cursor.fail(problem, word))?;
        // A number takes at least two bytes; the last one needs no end.
        let possible = (self.cursor.rest().len() as u64 + 1) / (2 * numbers);
        if declared > possible {
            let problem = ReadProblem::CountExceedsFile { declared, possible };
            return Err(self.cursor.fail(problem, word));
        }
        Ok(declared)
    }

    /// Three coordinates and a reference number for each vertex.
    fn vertices(&mut self) -> Result<(), ReadError> {
        for _ in 0..self.count(4)? {
            let mut position = Point3::origin();
            for k in 0..3 {
                let word = self.number("the vertices")?;
                let value = self.surface.coordinate(word, &|| self.cursor.place());
                position[k] = value.map_err(|problem| self.cursor.fail(problem, word))?;
            }
            self.number("the vertices")?;
            self.surface.vertices.push(position);
        }
        Ok(())
    }

    /// The corners of edges or faces, from 1, with a reference number each. Returns their number.
    fn items(&mut self, corners: usize) -> Result<u64, ReadError> {
        let entries = self.count(corners as u64 + 1)?;
        let mut item = [0; 4];
        for _ in 0..entries {
            for corner in &mut item[..corners] {
                let word = self.number("the faces")?;
                *corner = integer(word)
                    .and_then(|index| self.corner(index))
                    .map_err(|problem| self.cursor.fail(problem, word))?;
            }
            let last = self.number("the faces")?;
            let item = &item[..corners];
            match corners {
                2 => self.surface.line(item),
                _ => self.surface.polygon(item, &|| self.cursor.place()),
            }
            .map_err(|problem| self.cursor.fail(problem, last))?;
        }
        Ok(entries)
    }

    /// Checks an index that starts at 1.
    fn corner(&self, index: i64) -> Result<u32, ReadProblem> {
        let count = self.surface.vertices.len();
        let out_of_range = ReadProblem::IndexOutOfRange {
            index,
            count,
            from_one: true,
        };
        let from_zero = index.checked_sub(1).ok_or(ReadProblem::IntegerTooLarge)?;
        self.surface.index(from_zero).map_err(|_| out_of_range)
    }
}

#[cfg(test)]
mod tests {
    use crate::io::read_bytes;

    const HEAD: &str = "MeshVersionFormatted 2\n# by hand\nDimension\n3\n";
    const POINTS: &str = "Vertices 4\n0 0 0 1\n1 0 0 1\n1 1 0 1 # a corner\n0 1 0 2\n";

    #[test]
    fn triangles_quadrilaterals_edges_and_other_sections() {
        let faces = "Corners\n1\n2\nTriangles\n1\n1 2 3 7\nQuadrilaterals\n1\n1 2 3 4 0\nNormals\n1\n0 0 1\n\
                     Tetrahedra\n1\n1 2 3 4 0\nEdges\n1\n1 3 0\n\nEnd\nTriangles 1\n";
        let text = format!("{HEAD}{POINTS}{faces}");
        let file = read_bytes(text.as_bytes(), "no ending").unwrap();
        assert_eq!(file.mesh.triangles, [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);
        assert_eq!(file.lines, [[0, 2]]);
        assert_eq!(file.mesh.vertices.len(), 4);
    }

    #[test]
    fn errors_name_line_and_column() {
        let error = |text: String| read_bytes(text.as_bytes(), "a").unwrap_err().terse();
        let faces = |text: &str| error(format!("{HEAD}{POINTS}{text}"));
        for (text, expected) in [
            (
                "Triangles\n1\n1 2 5 0\n",
                "a:12:5: error[E020]: vertex index 5 is out of range: there are 4 vertices, counted from 1",
            ),
            (
                "Triangles\n1\n0 2 3 0\n",
                "a:12:1: error[E020]: vertex index 0",
            ),
            ("Triangles\n1\n1 2     \n", "error[E041]"),
            (
                "Triangles\n9\n1 2 3 0\n",
                "a:11:1: error[E040]: 9 items are declared",
            ),
            ("Triangles\nx\n", "expected the number of entries"),
            (
                "Tetrahedra\n1\n1 2 3 4 0\nEnd\n",
                "volume cells without their surface",
            ),
            ("", "E046"),
        ] {
            let found = faces(text);
            assert!(found.contains(expected), "{text:?}: {found}");
        }
        let flat = HEAD.replace("\n3\n", "\n2\n");
        assert!(error(format!("{flat}{POINTS}")).contains("another dimension"));
        let point = |text: &str| error(format!("{HEAD}Vertices\n1\n{text}\n"));
        assert!(point("0 0,5 0 0").contains("a:7:3: error[E011]"));
        assert!(point("0 0 nan 0").contains("E012"));
        assert!(point("0 0\0 0 0").contains("E006"));
    }
}
