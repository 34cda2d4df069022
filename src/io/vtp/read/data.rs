//! Numbers at the points of VTK XML polydata, of all types except strings.

use super::{Array, Reader, Slot};
use crate::io::error::{ReadError, ReadProblem};
use crate::io::xml::unescaped;
use crate::io::{PointData, cursor};

/// An array of a piece before it is read.
struct Found<'a> {
    name: String,
    components: usize,
    array: Array<'a>,
    points: u64,
}

/// Reads the arrays of `PointData` that all pieces have, joined over the pieces.
///
/// # Errors
/// Another XML file, or an array that is damaged or of another size than declared.
pub(in crate::io) fn point_data(
    bytes: &[u8],
    name: &str,
    limit: u64,
) -> Result<Vec<PointData>, ReadError> {
    let mut reader = Reader::new(bytes, name, limit);
    let pieces = found(&mut reader)?;
    let mut all: Vec<PointData> = Vec::new();
    for (k, piece) in pieces.into_iter().enumerate() {
        let mut here = Vec::new();
        for Found {
            name,
            components,
            array,
            points,
        } in piece
        {
            let numbers = reader.numbers(array, true)?;
            let (declared, used) = (
                points.saturating_mul(components as u64),
                numbers.len() as u64,
            );
            if declared != used {
                let problem = ReadProblem::SizeMismatch {
                    what: "the number of values at the points",
                    declared,
                    used,
                };
                return Err(reader.fail_in(&numbers, problem, b""));
            }
            let values: Vec<f64> = (0..numbers.len()).map(|i| numbers.real(i)).collect();
            here.push(PointData {
                name,
                components,
                values,
            });
        }
        if k == 0 {
            all = here;
            continue;
        }
        // An array that one piece lacks has no value at its points.
        all.retain_mut(|array| {
            let more = here
                .iter()
                .find(|h| h.name == array.name && h.components == array.components);
            array
                .values
                .extend(more.iter().flat_map(|h| h.values.iter().copied()));
            more.is_some()
        });
    }
    Ok(all)
}

/// The arrays of each piece; the first of two with the same name.
fn found<'a>(reader: &mut Reader<'a>) -> Result<Vec<Vec<Found<'a>>>, ReadError> {
    let mut pieces: Vec<(u64, Vec<Found<'a>>)> = Vec::new();
    let (mut begun, mut inside) = (false, false);
    while let Some(tag) = reader.xml.tag()? {
        if !begun {
            reader.root(&tag)?;
            begun = true;
            continue;
        }
        match tag.name {
            b"Piece" if !tag.closes => {
                pieces.push((reader.new_piece(&tag)?.point_count.unwrap_or(0), Vec::new()));
            }
            b"AppendedData" if !tag.closes => {
                reader.appended = Some(reader.appended_data(&tag)?);
                break;
            }
            b"PointData" => inside = !(tag.closes || tag.empty),
            b"DataArray" if inside && !tag.closes && tag.attribute("type") != Some(b"String") => {
                let number = pieces.len();
                let Some((points, arrays)) = pieces.last_mut() else {
                    continue;
                };
                let name = unescaped(tag.attribute("Name").unwrap_or_default());
                let components = match tag.attribute("NumberOfComponents") {
                    None => 1,
                    Some(word) => cursor::count(word.trim_ascii(), "a number of components")
                        .map_err(|problem| reader.xml.fail(problem, word))?,
                };
                if name.is_empty() || components == 0 || arrays.iter().any(|a| a.name == name) {
                    continue;
                }
                let array = reader.stored(&tag, Slot::Data, number)?;
                arrays.push(Found {
                    name,
                    components: components as usize,
                    array,
                    points: *points,
                });
            }
            _ => {}
        }
    }
    Ok(pieces.into_iter().map(|(_, arrays)| arrays).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::vtp::{PolyData, write};
    use crate::mesh::shapes::tetrahedron;
    use crate::testing::Scratch;

    fn file(data: &str, pieces: usize) -> String {
        let piece = format!(
            "<Piece NumberOfPoints=\"3\" NumberOfPolys=\"1\"><PointData>{data}</PointData><Points>\
             <DataArray type=\"Float64\" NumberOfComponents=\"3\">0 0 0 1 0 0 0 1 0</DataArray></Points><Polys>\
             <DataArray type=\"Int8\" Name=\"connectivity\">0 1 2</DataArray>\
             <DataArray type=\"Int8\" Name=\"offsets\">3</DataArray></Polys></Piece>"
        );
        format!(
            "<VTKFile type=\"PolyData\"><PolyData>{}</PolyData></VTKFile>",
            piece.repeat(pieces)
        )
    }

    #[test]
    fn arrays_are_read_as_they_were_written() {
        let mesh = tetrahedron();
        let values = vec![1.5, f64::NAN, -0.0, 4e300];
        let flow: Vec<f64> = (0..12).map(f64::from).collect();
        let path = Scratch::file("point-data.vtp");
        let data = PolyData {
            points: &mesh.vertices,
            triangles: &mesh.triangles,
            lines: &[],
            point_data: vec![("a \"<&>\"", values.clone()), ("flow", flow.clone())],
            ..Default::default()
        };
        write(&path, &data).unwrap();
        let found = crate::io::read_point_data(&path).unwrap();
        let bits = |v: &[f64]| v.iter().map(|x| x.to_bits()).collect::<Vec<u64>>();
        assert_eq!(
            (found[0].name.as_str(), found[0].components),
            ("a \"<&>\"", 1)
        );
        assert_eq!(bits(&found[0].values), bits(&values));
        assert_eq!(
            (
                found[1].name.as_str(),
                found[1].components,
                &found[1].values
            ),
            ("flow", 3, &flow)
        );
    }

    #[test]
    fn pieces_are_joined_and_texts_left_out() {
        let data = "<DataArray type=\"Int8\" Name=\"n\">1 2 3</DataArray><DataArray type=\"String\" Name=\"s\">9</DataArray>";
        let found = point_data(file(data, 2).as_bytes(), "a", 1 << 20).unwrap();
        let expected = PointData {
            name: "n".into(),
            components: 1,
            values: vec![1.0, 2.0, 3.0, 1.0, 2.0, 3.0],
        };
        assert_eq!(found, [expected]);
        let lacking = file(data, 2).replacen("\"n\"", "\"m\"", 1);
        assert_eq!(point_data(lacking.as_bytes(), "a", 1 << 20).unwrap(), []);
        assert_eq!(
            point_data(file("", 1).as_bytes(), "a", 1 << 20).unwrap(),
            []
        );
    }

    #[test]
    fn wrong_arrays_are_named() {
        let error = |data: &str| {
            point_data(file(data, 1).as_bytes(), "a", 1 << 20)
                .unwrap_err()
                .terse()
        };
        let few = error("<DataArray type=\"Int8\" Name=\"n\">1 2</DataArray>");
        assert!(
            few.contains("the number of values at the points does not fit: 3 declared, 2 used"),
            "{few}"
        );
        assert!(few.contains("an array of PointData of piece 1"), "{few}");
        let none = error("<DataArray type=\"Float32\" Name=\"n\">1 2 x</DataArray>");
        assert!(none.contains("expected a number"), "{none}");
        let kind = error("<DataArray type=\"Bool\" Name=\"n\">1 2 3</DataArray>");
        assert!(kind.contains("expected a type such as"), "{kind}");
    }
}
