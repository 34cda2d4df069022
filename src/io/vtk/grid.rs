//! Surfaces of unstructured grids: the cell types that are part of a surface.

use super::read::{Cells, Numbers};
use crate::io::error::{FilePlace, ReadError, ReadProblem};
use crate::io::surface::Surface;

/// The types of the cells, as numbers of VTK.
pub(super) struct CellTypes<'a>(pub(super) Numbers<'a>);

/// The error for a cell that fills a volume.
const VOLUME: ReadProblem = ReadProblem::NoSurface {
    what: "a cell of a surface, not of a volume",
};

/// The error for a cell with curved sides.
const CURVED: ReadProblem = ReadProblem::NoSurface {
    what: "a cell with straight edges, not a curved one",
};

/// The error for any other number.
const UNKNOWN: ReadProblem = ReadProblem::Expected {
    what: "a cell type of VTK: line, triangle, strip, polygon, pixel or quad (3 to 9)",
};

/// Adds each cell according to its type.
///
/// # Errors
/// Another number of types than cells; a cell that is no part of a surface; an index out of range;
/// too few corners.
pub(super) fn add_cells(
    surface: &mut Surface,
    cells: &Cells<'_>,
    types: &CellTypes<'_>,
) -> Result<(), ReadError> {
    let (declared, used) = (types.0.values.len(), cells.ranges.len());
    if declared != used {
        let what = "the number of cell types";
        let problem = ReadProblem::SizeMismatch {
            what,
            declared: declared as u64,
            used: used as u64,
        };
        return Err(types.0.fail(declared.min(used), problem));
    }
    let mut corners = Vec::new();
    for (i, &range) in cells.ranges.iter().enumerate() {
        cells.corners(surface, range, &mut corners)?;
        let at: &dyn Fn() -> FilePlace = &|| cells.place(range);
        let added = match types.0.values[i] {
            // Points, and the empty cell of VTK.
            0..=2 => Ok(()),
            3 | 4 => surface.line(&corners),
            5 => exactly(3, &corners).and_then(|()| surface.polygon(&corners, at)),
            6 => surface.strip(&corners, at),
            7 => surface.polygon(&corners, at),
            8 => {
                // The corners of a pixel are in row order, those of a polygon in cyclic order.
                exactly(4, &corners).and_then(|()| {
                    corners.swap(2, 3);
                    surface.polygon(&corners, at)
                })
            }
            9 => exactly(4, &corners).and_then(|()| surface.polygon(&corners, at)),
            10..=16 | 24..=27 | 29 | 32 | 33 | 37 | 39 | 40 | 42 => {
                return Err(refused(types, i, VOLUME));
            }
            21..=23 | 28 | 30 | 31 | 34..=36 | 41 | 51..=80 => {
                return Err(refused(types, i, CURVED));
            }
            _ => return Err(refused(types, i, UNKNOWN)),
        };
        added.map_err(|problem| cells.numbers.fail(range.0.max(1) - 1, problem))?;
    }
    Ok(())
}

fn refused(types: &CellTypes<'_>, i: usize, problem: ReadProblem) -> ReadError {
    types.0.fail(i, problem)
}

fn exactly(expected: usize, corners: &[u32]) -> Result<(), ReadProblem> {
    let got = corners.len();
    match got.cmp(&expected) {
        std::cmp::Ordering::Equal => Ok(()),
        std::cmp::Ordering::Less => Err(ReadProblem::TooFewCorners { got, expected }),
        std::cmp::Ordering::Greater => {
            let (what, declared) = (
                "the number of corners and the type of a cell",
                expected as u64,
            );
            Err(ReadProblem::SizeMismatch {
                what,
                declared,
                used: got as u64,
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::io::read_bytes;

    const POINTS: &str = "# vtk DataFile Version 4.2\ntitle\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 1 1 0\n";

    fn error(tail: &str) -> String {
        read_bytes(format!("{POINTS}{tail}").as_bytes(), "a")
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn each_cell_of_a_surface_is_added() {
        let cells = "CELLS 7 31\n3 0 1 2\n4 0 1 2 3\n4 0 1 3 2\n4 0 1 2 3\n4 0 1 3 2\n2 0 3\n1 2\n\
            CELL_TYPES 7\n5 6 7 8 9 3 1\nPOINT_DATA 4\nanything";
        let file = read_bytes(
            format!("{POINTS}{}", cells.replace("7 31", "7 29")).as_bytes(),
            "",
        )
        .unwrap();
        let quad = [[0, 1, 3], [0, 3, 2]];
        let mut expected = vec![[0, 1, 2], [0, 1, 2], [2, 1, 3]];
        (0..3).for_each(|_| expected.extend(quad));
        assert_eq!(file.mesh.triangles, expected);
        assert_eq!(file.lines, [[0, 3]]);
    }

    #[test]
    fn the_layout_of_version_5() {
        let cells = "CELLS 3 7\nOFFSETS vtktypeint64\n0 3 7\nCONNECTIVITY vtktypeint64\n0 1 2 0 1 3 2\nCELL_TYPES 2\n5\n9\n";
        let file = read_bytes(format!("{POINTS}{cells}").as_bytes(), "").unwrap();
        assert_eq!(file.mesh.triangles, [[0, 1, 2], [0, 1, 3], [0, 3, 2]]);
    }

    #[test]
    fn what_is_no_surface_is_named_with_its_line() {
        let one = |kind: &str| error(&format!("CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n{kind}\n"));
        assert!(
            one("10").starts_with("a:10: expected a cell of a surface, not of a volume"),
            "{}",
            one("10")
        );
        assert!(one("22").contains("a:10: expected a cell with straight edges"));
        assert!(one("-1").contains("a:10: expected a cell type of VTK"));
        assert!(one("5").contains(
            "a:8: the number of corners and the type of a cell does not fit: 3 declared, 4 used"
        ));
        assert!(
            error("CELLS 1 3\n2 0 1\nCELL_TYPES 1\n9\n")
                .contains("a:8: too few corners: 2, at least 4")
        );
        assert!(
            error("CELLS 1 5\n4 0 1 2 4\nCELL_TYPES 1\n9\n")
                .contains("a:8: vertex index 4 is out of range")
        );
        assert!(
            error("CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 2\n9 9\n")
                .contains("the number of cell types does not fit")
        );
        assert!(error("CELLS 1 5\n4 0 1 2 3\n").contains("expected CELL_TYPES behind CELLS"));
        assert!(error("CELL_TYPES 1\n5\n").contains("expected CELLS before CELL_TYPES"));
        assert!(error("POLYGONS 1 5\n").contains("a:7: expected POINTS, CELLS, CELL_TYPES"));
    }
}
