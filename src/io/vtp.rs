//! VTK XML polydata (`.vtp`): reader, and writer of appended raw data, little-endian doubles, 64-bit counts.

mod read;

use std::io::{self, Write};
use std::path::Path;

use nalgebra::Point3;

use super::part::{check_indices, invalid, write_whole};
pub(super) use read::{point_data, read};

/// A surface, lines and numbers at their points, borrowed for writing.
#[derive(Clone, Debug, Default)]
pub struct PolyData<'a> {
    /// Positions [m], shape `[point_count]`.
    pub points: &'a [Point3<f64>],
    /// Point indices of each triangle.
    pub triangles: &'a [[u32; 3]],
    /// Point indices of each polyline.
    pub lines: &'a [Vec<u32>],
    /// Names and values, shape `[point_count]` or `[point_count * components]` with the components of a point together.
    pub point_data: Vec<(&'a str, Vec<f64>)>,
}

/// Writes `data` to `path` through `NAME.part`, so that an interrupted run leaves no incomplete
/// file.
///
/// # Errors
/// An index out of range, point data whose length is no multiple of the number of points, and
/// errors of the operating system.
pub fn write(path: &Path, data: &PolyData<'_>) -> io::Result<()> {
    write_with_cells(path, data, &[])
}

/// Approximate size of the file of [`write()`] [bytes]: its numbers, without the text around them.
#[must_use]
pub fn bytes(data: &PolyData<'_>) -> u64 {
    Layout::of(data).cell_data
}

/// The same as [`write()`], with numbers at each polyline and then at each triangle: names and
/// values, shape `[line_count + triangle_count]`.
///
/// # Errors
/// Those of [`write()`]; cell data of another length.
pub fn write_with_cells(
    path: &Path,
    data: &PolyData<'_>,
    cell_data: &[(&str, Vec<f64>)],
) -> io::Result<()> {
    check_indices(data.points.len(), data.triangles, data.lines)?;
    let cells = data.lines.len() + data.triangles.len();
    if let Some((name, values)) = cell_data.iter().find(|(_, values)| values.len() != cells) {
        return Err(invalid(format!(
            "'{name}' has {} values for {cells} cells",
            values.len()
        )));
    }
    let components = data
        .point_data
        .iter()
        .map(|(name, values)| components(name, values, data.points.len()));
    let components = components.collect::<io::Result<Vec<usize>>>()?;
    let layout = Layout::of(data);
    write_whole(path, |w| {
        header(w, data, &components, &layout, cell_data)?;
        floats(
            w,
            data.points.iter().flat_map(|p| [p.x, p.y, p.z]),
            3 * data.points.len(),
        )?;
        for (_, values) in &data.point_data {
            floats(w, values.iter().copied(), values.len())?;
        }
        let line_corners: usize = data.lines.iter().map(Vec::len).sum();
        integers(
            w,
            data.lines.iter().flatten().map(|&i| u64::from(i)),
            line_corners,
        )?;
        let mut end = 0;
        let ends = data.lines.iter().map(|line| {
            end += line.len() as u64;
            end
        });
        integers(w, ends, data.lines.len())?;
        integers(
            w,
            data.triangles.iter().flatten().map(|&i| u64::from(i)),
            3 * data.triangles.len(),
        )?;
        integers(
            w,
            (1..=data.triangles.len() as u64).map(|i| 3 * i),
            data.triangles.len(),
        )?;
        for (_, values) in cell_data {
            floats(w, values.iter().copied(), values.len())?;
        }
        write!(w, "\n  </AppendedData>\n</VTKFile>\n")
    })
}

/// The number of values at each point.
fn components(name: &str, values: &[f64], points: usize) -> io::Result<usize> {
    match values.len().checked_div(points) {
        Some(each) if each > 0 && each * points == values.len() => Ok(each),
        None if values.is_empty() => Ok(1),
        _ => Err(invalid(format!(
            "'{name}' has {} values for {points} points",
            values.len()
        ))),
    }
}

/// Offsets of the blocks in the appended data [bytes]; each block is a 64-bit count of bytes and 8-byte numbers.
struct Layout {
    point_data: Vec<u64>,
    line_corners: u64,
    line_ends: u64,
    triangle_corners: u64,
    triangle_ends: u64,
    /// Offset of the cell data; its arrays follow each other.
    cell_data: u64,
}

impl Layout {
    fn of(data: &PolyData<'_>) -> Self {
        let mut next = 0;
        let mut block = |numbers: usize| {
            let start = next;
            next += 8 + 8 * numbers as u64;
            start
        };
        // The points are first, at offset 0.
        block(3 * data.points.len());
        Self {
            point_data: data
                .point_data
                .iter()
                .map(|(_, values)| block(values.len()))
                .collect(),
            line_corners: block(data.lines.iter().map(Vec::len).sum()),
            line_ends: block(data.lines.len()),
            triangle_corners: block(3 * data.triangles.len()),
            triangle_ends: block(data.triangles.len()),
            cell_data: block(0),
        }
    }
}

fn header(
    w: &mut impl Write,
    data: &PolyData<'_>,
    components: &[usize],
    layout: &Layout,
    cell_data: &[(&str, Vec<f64>)],
) -> io::Result<()> {
    let (points, lines, triangles) = (data.points.len(), data.lines.len(), data.triangles.len());
    writeln!(w, "<?xml version=\"1.0\"?>")?;
    writeln!(
        w,
        "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n  <PolyData>"
    )?;
    writeln!(
        w,
        "    <Piece NumberOfPoints=\"{points}\" NumberOfVerts=\"0\" NumberOfLines=\"{lines}\" NumberOfStrips=\"0\" \
         NumberOfPolys=\"{triangles}\">"
    )?;
    writeln!(w, "      <PointData>")?;
    for (((name, _), components), offset) in data
        .point_data
        .iter()
        .zip(components)
        .zip(&layout.point_data)
    {
        array(w, "Float64", &escape(name), *components, *offset)?;
    }
    writeln!(w, "      </PointData>")?;
    if !cell_data.is_empty() {
        writeln!(w, "      <CellData>")?;
        for (k, (name, values)) in cell_data.iter().enumerate() {
            let offset = layout.cell_data + k as u64 * (8 + 8 * values.len() as u64);
            array(w, "Float64", &escape(name), 1, offset)?;
        }
        writeln!(w, "      </CellData>")?;
    }
    writeln!(w, "      <Points>")?;
    array(w, "Float64", "Points", 3, 0)?;
    writeln!(w, "      </Points>\n      <Lines>")?;
    array(w, "Int64", "connectivity", 1, layout.line_corners)?;
    array(w, "Int64", "offsets", 1, layout.line_ends)?;
    writeln!(w, "      </Lines>\n      <Polys>")?;
    array(w, "Int64", "connectivity", 1, layout.triangle_corners)?;
    array(w, "Int64", "offsets", 1, layout.triangle_ends)?;
    writeln!(w, "      </Polys>\n    </Piece>\n  </PolyData>")?;
    // The data begin directly after the underscore.
    write!(w, "  <AppendedData encoding=\"raw\">\n   _")
}

fn array(
    w: &mut impl Write,
    kind: &str,
    name: &str,
    components: usize,
    offset: u64,
) -> io::Result<()> {
    writeln!(
        w,
        "        <DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" \
         offset=\"{offset}\"/>"
    )
}

fn floats(w: &mut impl Write, values: impl Iterator<Item = f64>, count: usize) -> io::Result<()> {
    integers(w, values.map(f64::to_bits), count)
}

fn integers(w: &mut impl Write, values: impl Iterator<Item = u64>, count: usize) -> io::Result<()> {
    w.write_all(&(8 * count as u64).to_le_bytes())?;
    for value in values {
        w.write_all(&value.to_le_bytes())?;
    }
    Ok(())
}

/// Text for an XML attribute; control characters, which XML excludes, become spaces.
pub(super) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            c if c.is_control() => escaped.push(' '),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Scratch;

    /// The value of an attribute of the first array with a name, from the position of `from`.
    fn offset_of(text: &str, from: &str, name: &str) -> usize {
        let tail = &text[text.find(from).unwrap()..];
        let tail = &tail[tail.find(&format!("Name=\"{name}\"")).unwrap()..];
        let tail = &tail[tail.find("offset=\"").unwrap() + 8..];
        tail[..tail.find('"').unwrap()].parse().unwrap()
    }

    fn block(raw: &[u8], offset: usize) -> Vec<u64> {
        let word = |at: usize| u64::from_le_bytes(raw[at..at + 8].try_into().unwrap());
        (0..word(offset) as usize / 8)
            .map(|i| word(offset + 8 + 8 * i))
            .collect()
    }

    #[test]
    fn the_blocks_stand_where_the_header_says() {
        let path = Scratch::file("two.vtp");
        let points = [
            [0.1, -0.0, 1e-300],
            [1., 0., 0.],
            [0., 1., 0.],
            [1., 1., 5.],
        ]
        .map(Point3::from);
        let lines = [vec![0, 1, 3], vec![3, 2]];
        let point_data = vec![
            ("strain <1>", vec![1., 2., 3., f64::NAN]),
            ("force", vec![0.5; 12]),
        ];
        let data = PolyData {
            points: &points,
            triangles: &[[0, 1, 2], [1, 3, 2]],
            lines: &lines,
            point_data,
        };
        write(&path, &data).unwrap();
        assert!(!path.with_extension("vtp.part").exists());
        let bytes = std::fs::read(&*path).unwrap();
        let begin = bytes.windows(2).position(|w| w == b" _").unwrap() + 2;
        let text = std::str::from_utf8(&bytes[..begin]).unwrap();
        let get = |from, name| block(&bytes[begin..], offset_of(text, from, name));
        let flat: Vec<u64> = points
            .iter()
            .flat_map(|p| [p.x, p.y, p.z])
            .map(f64::to_bits)
            .collect();
        assert_eq!(get("<Points>", "Points"), flat);
        assert_eq!(get("<PointData>", "strain &lt;1&gt;")[2], 3f64.to_bits());
        assert_eq!(get("<PointData>", "force").len(), 12);
        assert_eq!(get("<Lines>", "connectivity"), [0, 1, 3, 3, 2]);
        assert_eq!(get("<Lines>", "offsets"), [3, 5]);
        assert_eq!(get("<Polys>", "connectivity"), [0, 1, 2, 1, 3, 2]);
        assert_eq!(get("<Polys>", "offsets"), [3, 6]);
        assert!(bytes.ends_with(b"\n  </AppendedData>\n</VTKFile>\n"));
        let file = crate::io::read(&path).unwrap();
        let bits: Vec<u64> = file
            .mesh
            .vertices
            .iter()
            .flat_map(|p| [p.x, p.y, p.z])
            .map(f64::to_bits)
            .collect();
        assert_eq!(
            (bits, file.mesh.triangles, file.lines),
            (flat, data.triangles.to_vec(), lines.to_vec())
        );
    }

    #[test]
    fn cell_data_stand_behind_the_cells() {
        let path = Scratch::file("cells.vtp");
        let points = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]].map(Point3::from);
        let data = PolyData {
            points: &points,
            triangles: &[[0, 1, 2]],
            lines: &[vec![0, 1, 2], vec![2, 0]],
            ..Default::default()
        };
        let cells = [
            ("fibre", vec![0., 1., -1.]),
            ("length_m", vec![0.25, 0.5, f64::NAN]),
        ];
        write_with_cells(&path, &data, &cells).unwrap();
        let bytes = std::fs::read(&*path).unwrap();
        let begin = bytes.windows(2).position(|w| w == b" _").unwrap() + 2;
        let text = std::str::from_utf8(&bytes[..begin]).unwrap();
        for (name, values) in &cells {
            let bits: Vec<u64> = values.iter().map(|v| v.to_bits()).collect();
            assert_eq!(
                block(&bytes[begin..], offset_of(text, "<CellData>", name)),
                bits,
                "{name}"
            );
        }
        assert!(bytes.ends_with(b"\n  </AppendedData>\n</VTKFile>\n"));
        assert_eq!(crate::io::read(&path).unwrap().lines, data.lines.to_vec());
        assert!(write_with_cells(&path, &data, &[("short", vec![0.0; 2])]).is_err());
    }

    #[test]
    fn wrong_data_are_refused() {
        let path = Scratch::file("bad.vtp");
        let points = [Point3::origin(); 3];
        let base = PolyData {
            points: &points,
            triangles: &[[0, 1, 3]],
            ..Default::default()
        };
        assert!(write(&path, &base).is_err());
        let short = PolyData {
            points: &points,
            point_data: vec![("a", vec![1.0; 4])],
            ..Default::default()
        };
        assert!(write(&path, &short).is_err());
        let none = PolyData {
            points: &points,
            point_data: vec![("a", Vec::new())],
            ..Default::default()
        };
        assert!(write(&path, &none).is_err());
        assert!(!path.exists());
        let path = Scratch::file("empty.vtp");
        write(
            &path,
            &PolyData {
                point_data: vec![("a", Vec::new())],
                ..Default::default()
            },
        )
        .unwrap();
        let text = std::fs::read_to_string(&*path).unwrap();
        assert!(
            text.contains("Name=\"a\" NumberOfComponents=\"1\""),
            "{text}"
        );
    }
}
