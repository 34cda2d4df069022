//! VTK XML polydata (`.vtp`): reader, and writer of appended raw data, little-endian, 64-bit counts, compressed as `.xz`.

mod compressed;
mod read;

use std::io::{self, Write};
use std::path::Path;

use nalgebra::Point3;

use super::part::{check_indices, invalid};
pub use compressed::SeriesWriter;
use compressed::{Array, Kind, POINTS};
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
    /// True for a third of the size: positions are written as Float32, which changes a coordinate by at most 2^-24 of
    /// itself, and point data are rounded to 2^-13 of the greatest value of their array. False for all bits.
    pub compact: bool,
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
    SeriesWriter::new().write_with_cells(path, data, cell_data)
}

/// Size of the file of [`write()`] [bytes].
///
/// # Errors
/// Those of the data, as in [`write()`].
pub fn bytes(data: &PolyData<'_>) -> io::Result<u64> {
    let mut count = Count(0);
    Blocks::of(&mut SeriesWriter::new(), data, &[])?.write(&mut count, data)?;
    Ok(count.0)
}

/// Counts what is written to it.
struct Count(u64);

impl Write for Count {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The arrays of a file in the order of its data.
struct Blocks {
    points: Array,
    point_data: Vec<Array>,
    cell_data: Vec<Array>,
    lines: [Array; 2],
    triangles: [Array; 2],
}

impl Blocks {
    fn of(
        series: &mut SeriesWriter,
        data: &PolyData<'_>,
        cell_data: &[(&str, Vec<f64>)],
    ) -> io::Result<Self> {
        check_indices(data.points.len(), data.triangles, data.lines)?;
        let cells = data.lines.len() + data.triangles.len();
        if let Some((name, values)) = cell_data.iter().find(|(_, values)| values.len() != cells) {
            let message = format!("'{name}' has {} values for {cells} cells", values.len());
            return Err(invalid(message));
        }
        let kind = Kind::of(data.compact);
        let points = data.points.iter().flat_map(|p| [p.x, p.y, p.z]);
        let points = Array::reals(POINTS, 3, kind, points)?;
        let mut point_data = Vec::with_capacity(data.point_data.len());
        for (name, values) in &data.point_data {
            let components = components(name, values, data.points.len())?;
            let step = if data.compact {
                compressed::step(values)
            } else {
                0.0
            };
            let rounded = values.iter().map(|value| compressed::rounded(*value, step));
            point_data.push(Array::reals(name, components, kind, rounded)?);
        }
        let cell_data = cell_data.iter();
        let cell_data = cell_data
            .map(|(name, values)| Array::reals(name, 1, Kind::Float64, values.iter().copied()))
            .collect::<io::Result<Vec<Array>>>()?;
        let mut end = 0;
        let ends = data.lines.iter().map(|line| {
            end += line.len() as u64;
            end
        });
        let ends: Vec<u64> = ends.collect();
        let corners = data.lines.iter().flatten().map(|&i| u64::from(i));
        let of_lines = [
            series.indices("connectivity", corners)?,
            series.indices("offsets", ends.into_iter())?,
        ];
        let corners = data.triangles.iter().flatten().map(|&i| u64::from(i));
        let ends = (1..=data.triangles.len() as u64).map(|i| 3 * i);
        let of_triangles = [
            series.indices("connectivity", corners)?,
            series.indices("offsets", ends)?,
        ];
        Ok(Self {
            points,
            point_data,
            cell_data,
            lines: of_lines,
            triangles: of_triangles,
        })
    }

    fn write(&self, w: &mut impl Write, data: &PolyData<'_>) -> io::Result<()> {
        let (points, lines, triangles) =
            (data.points.len(), data.lines.len(), data.triangles.len());
        let compressor = compressed::ATTRIBUTE;
        writeln!(w, "<?xml version=\"1.0\"?>")?;
        writeln!(
            w,
            "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\"{compressor}>\n  <PolyData>"
        )?;
        writeln!(
            w,
            "    <Piece NumberOfPoints=\"{points}\" NumberOfVerts=\"0\" NumberOfLines=\"{lines}\" NumberOfStrips=\"0\" \
             NumberOfPolys=\"{triangles}\">"
        )?;
        let mut next = 0;
        // VTK expects the sections in this order; the data follow in the same order.
        let mut section = |w: &mut dyn Write, name: &str, arrays: &[&Array]| {
            writeln!(w, "      <{name}>")?;
            for array in arrays {
                array.declare(w, next)?;
                next += array.bytes.len() as u64;
            }
            writeln!(w, "      </{name}>")
        };
        section(w, "PointData", &self.point_data.iter().collect::<Vec<_>>())?;
        if !self.cell_data.is_empty() {
            section(w, "CellData", &self.cell_data.iter().collect::<Vec<_>>())?;
        }
        section(w, "Points", &[&self.points])?;
        section(w, "Lines", &self.lines.iter().collect::<Vec<_>>())?;
        section(w, "Polys", &self.triangles.iter().collect::<Vec<_>>())?;
        writeln!(w, "    </Piece>\n  </PolyData>")?;
        // The data begin directly after the underscore.
        write!(w, "  <AppendedData encoding=\"raw\">\n   _")?;
        let fields = self.point_data.iter().chain(&self.cell_data);
        let geometry = [&self.points]
            .into_iter()
            .chain(&self.lines)
            .chain(&self.triangles);
        for array in fields.chain(geometry) {
            w.write_all(&array.bytes)?;
        }
        write!(w, "\n  </AppendedData>\n</VTKFile>\n")
    }
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
    use crate::io::xml::unescaped;
    use crate::testing::Scratch;

    /// The arrays of a file that this module wrote, in the order of their elements: section and name, type, and the bits of
    /// the numbers, by the offsets in the text and the reader's decompression.
    fn arrays(path: &Path) -> Vec<(String, String, Vec<u64>)> {
        let bytes = std::fs::read(path).unwrap();
        assert!(bytes.ends_with(b"\n  </AppendedData>\n</VTKFile>\n"));
        let begin = bytes.windows(2).position(|w| w == b" _").unwrap() + 2;
        let text = std::str::from_utf8(&bytes[..begin]).unwrap();
        let word =
            |at: usize| u64::from_le_bytes(bytes[begin + at..begin + at + 8].try_into().unwrap());
        let (mut section, mut found, mut end) = ("", Vec::new(), 0);
        for line in text.lines().map(str::trim) {
            let value = |key: &str| {
                let tail = line.split_once(&format!(" {key}=\"")).unwrap().1;
                tail.split_once('"').unwrap().0.to_owned()
            };
            if !line.starts_with("<DataArray") {
                section = line;
                continue;
            }
            let at: usize = value("offset").parse().unwrap();
            assert_eq!(at, end, "arrays follow each other");
            let mut raw = Vec::new();
            if cfg!(feature = "compression") {
                let blocks = word(at) as usize;
                end = at + 24 + 8 * blocks;
                for block in 0..blocks {
                    let size = word(at + 24 + 8 * block) as usize;
                    let packed = &bytes[begin + end..begin + end + size];
                    let last = word(at + 16) as usize;
                    let whole = if block + 1 < blocks || last == 0 {
                        word(at + 8) as usize
                    } else {
                        last
                    };
                    let lzma = crate::io::encoded::Compressor::Lzma;
                    raw.extend(crate::io::decompress::decompress(lzma, packed, whole).unwrap());
                    end += size;
                }
            } else {
                end = at + 8 + word(at) as usize;
                raw.extend_from_slice(&bytes[begin + at + 8..begin + end]);
            }
            let kind = value("type");
            let numbers = match kind.as_str() {
                "Float64" | "Int64" => raw
                    .chunks_exact(8)
                    .map(|b| u64::from_le_bytes(b.try_into().unwrap()))
                    .collect(),
                "Float32" => raw
                    .chunks_exact(4)
                    .map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap())).to_bits())
                    .collect(),
                _ => raw
                    .chunks_exact(4)
                    .map(|b| u64::from(u32::from_le_bytes(b.try_into().unwrap())))
                    .collect(),
            };
            let name = unescaped(value("Name").as_bytes());
            found.push((format!("{section} {name}"), kind, numbers));
        }
        assert_eq!(
            bytes.len(),
            begin + end + "\n  </AppendedData>\n</VTKFile>\n".len()
        );
        found
    }

    fn bits(values: impl IntoIterator<Item = f64>) -> Vec<u64> {
        values.into_iter().map(f64::to_bits).collect()
    }

    const POINTS: [[f64; 3]; 4] = [
        [0.1, -0.0, 1e-300],
        [1., 0., 0.],
        [0., 1., 0.],
        [1., 1., 5.],
    ];

    #[test]
    fn the_blocks_stand_where_the_header_says() {
        let path = Scratch::file("two.vtp");
        let points = POINTS.map(Point3::from);
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
            compact: false,
        };
        write(&path, &data).unwrap();
        assert!(!path.with_extension("vtp.part").exists());
        let flat = bits(POINTS.concat());
        let expected = [
            (
                "<PointData> strain <1>",
                "Float64",
                bits([1., 2., 3., f64::NAN]),
            ),
            ("<PointData> force", "Float64", bits([0.5; 12])),
            ("<Points> Points", "Float64", flat.clone()),
            ("<Lines> connectivity", "Int32", vec![0, 1, 3, 3, 2]),
            ("<Lines> offsets", "Int32", vec![3, 5]),
            ("<Polys> connectivity", "Int32", vec![0, 1, 2, 1, 3, 2]),
            ("<Polys> offsets", "Int32", vec![3, 6]),
        ];
        let expected = expected.map(|(name, kind, bits)| (name.to_owned(), kind.to_owned(), bits));
        assert_eq!(arrays(&path), expected);
        let file = crate::io::read(&path).unwrap();
        let read = bits(file.mesh.vertices.iter().flat_map(|p| [p.x, p.y, p.z]));
        assert_eq!(
            (read, file.mesh.triangles, file.lines),
            (flat, data.triangles.to_vec(), lines.to_vec())
        );
    }

    #[test]
    fn compact_files_keep_the_promised_digits() {
        let path = Scratch::file("compact.vtp");
        let points: Vec<Point3<f64>> = (0..500)
            .map(|i| {
                Point3::new(
                    f64::from(i).sin(),
                    0.3 + 1e-9 * f64::from(i),
                    -7.0 / f64::from(i + 1),
                )
            })
            .collect();
        let speed: Vec<f64> = (0..500).map(|i| 0.123 / f64::from(i + 1)).collect();
        let data = PolyData {
            points: &points,
            point_data: vec![
                ("speed", speed.clone()),
                ("none", vec![0.0; 500]),
                ("nan", vec![f64::NAN; 500]),
            ],
            compact: true,
            ..Default::default()
        };
        write(&path, &data).unwrap();
        let found = crate::io::read_point_data(&path).unwrap();
        for (value, read) in speed.iter().zip(&found[0].values) {
            assert!((value - read).abs() <= 0.123 / 8192.0, "{value} {read}");
        }
        assert_ne!(found[0].values, speed);
        assert_eq!(found[1].values, vec![0.0; 500]);
        assert!(found[2].values.iter().all(|v| v.is_nan()));
        let all = arrays(&path);
        let (_, kind, coordinates) = all
            .iter()
            .find(|(name, ..)| name == "<Points> Points")
            .unwrap();
        assert_eq!(kind, "Float32");
        let given = points.iter().flat_map(|p| [p.x, p.y, p.z]);
        for (given, read) in given.zip(coordinates) {
            let error = (given - f64::from_bits(*read)).abs();
            assert!(error <= given.abs() / f64::from(1 << 24), "{given}");
        }
    }

    #[test]
    fn a_series_writes_the_same_files_as_single_writers() {
        let points = POINTS.map(Point3::from);
        let mut series = SeriesWriter::new();
        for (k, triangles) in [[[0, 1, 2]], [[1, 3, 2]], [[0, 1, 2]]].iter().enumerate() {
            let data = PolyData {
                points: &points,
                triangles,
                ..Default::default()
            };
            let [alone, together] =
                ["alone", "series"].map(|name| Scratch::file(&format!("{name}-{k}.vtp")));
            write(&alone, &data).unwrap();
            series.write(&together, &data).unwrap();
            assert_eq!(
                std::fs::read(&*alone).unwrap(),
                std::fs::read(&*together).unwrap()
            );
        }
    }

    #[test]
    fn arrays_of_several_blocks_are_read_back() {
        let path = Scratch::file("blocks.vtp");
        let whole = (1 << 20) / 24;
        // A block that is full, one that is cut, and exactly two.
        for count in [whole, whole + 5, 1 << 18] {
            let points: Vec<Point3<f64>> = (0..count)
                .map(|i| Point3::new(i as f64, 0.0, 1.0))
                .collect();
            let data = PolyData {
                points: &points,
                triangles: &[[0, 1, 2]],
                point_data: vec![("x", points.iter().map(|p| p.x).collect())],
                ..Default::default()
            };
            write(&path, &data).unwrap();
            assert_eq!(crate::io::read(&path).unwrap().mesh.vertices, points);
            assert_eq!(
                crate::io::read_point_data(&path).unwrap()[0].values,
                data.point_data[0].1
            );
        }
    }

    #[test]
    fn cell_data_stand_behind_the_point_data() {
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
        let found = arrays(&path);
        for ((name, values), found) in cells.iter().zip(&found) {
            let expected = (
                format!("<CellData> {name}"),
                "Float64".to_owned(),
                bits(values.clone()),
            );
            assert_eq!(*found, expected);
        }
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
