use super::super::tests::written;
use crate::io::Encoding;
use crate::io::{MeshFile, read_bytes};
use crate::mesh::TriangleMesh;

const SQUARE: &str = "# vtk DataFile Version 2.0\ntitle\nascii\n\ndataset polydata\npoints 4 FLOAT\n\
        0 0 0 1 0 0\n1 1 0 0 1 0\n";

fn error(tail: &str) -> String {
    read_bytes(format!("{SQUARE}{tail}").as_bytes(), "a")
        .unwrap_err()
        .to_string()
}

#[test]
fn polygons_strips_lines_and_offsets() {
    let tail = "METADATA\nINFORMATION 0\n\nFIELD f 2\na%20b 1 2 int\n1 2\ns 1 1 string\nPOINTS 3\n\
            VERTICES 1 2\n1 0\nPOLYGONS 2 9\n3 0 1 2\n4 0 1 2 3\nTRIANGLE_STRIPS 1 5\n4 0 1 3 2\nLINES 1 3\n2 0 2\n\
            CELL_DATA 9\nanything";
    let file = read_bytes(format!("{SQUARE}{tail}").as_bytes(), "").unwrap();
    let triangles = [[0, 1, 2], [0, 1, 2], [0, 2, 3], [0, 1, 3], [3, 1, 2]];
    assert_eq!(file.mesh.triangles, triangles);
    assert_eq!(file.lines, [[0, 2]]);
    let tail =
        "POLYGONS 3 7\nOFFSETS vtktypeint64\n0 3 7\nCONNECTIVITY vtktypeint64\n0 1 2 0 1 2 3\n";
    let file = read_bytes(format!("{SQUARE}{tail}").as_bytes(), "").unwrap();
    assert_eq!(file.mesh.triangles, triangles[..3]);
}

#[test]
fn errors_name_the_line() {
    let out = "vertex index 4 is out of range: there are 4 vertices (found '4')";
    assert_eq!(
        error("POLYGONS 2 8\n3 0 1 2\n3 0 1 4\n"),
        format!("a:11: {out}")
    );
    assert!(error("POLYGONS 1 4\n3 0 1 -1\n").contains("a:10: vertex index -1"));
    assert!(error("POLYGONS 1 3\n2 0 1\n").contains("a:10: too few corners: 2, at least 3"));
    assert!(
        error("POLYGONS 1 4\n9 0 1 2\n").contains("a:10: expected the number of corners of a cell")
    );
    assert!(
        error("POLYGONS 1 8\n3 0 1 2\n3 0 1 2")
            .contains("a:11: the size of the cells does not fit: 8 declared, 4")
    );
    assert!(error("POLYGONS 2 4\n3 0 1 2\n").contains("expected the number of corners of a cell"));
    assert!(
        error("POLYGONS 1000000000000000000 4\n3 0 1 2\n")
            .contains("expected the number of corners")
    );
    assert!(
        error("POLYGONS 1 1000000000000000000\n3 0 1 2")
            .contains("1000000000000000000 items are declared")
    );
    assert!(error("POLYGONS -1 4").contains("a:9: expected the number of cells (found '-1')"));
    assert!(error("POLYGONS 1 4\n3 0 1 x").contains("a:10: expected a whole number"));
    assert!(
        error("POLYGONS 2 3\nOFFSETS int\n1 3\nCONNECTIVITY int\n0 1 2")
            .contains("a:11: expected offsets")
    );
    assert!(
        error("POLYGONS 2 2\nOFFSETS int\n0 2\nCONNECTIVITY int\n0 1").contains("too few corners")
    );
    assert!(error("POINTS 1000000000000000000 float\n0 0 0").contains("items are declared"));
    assert!(error("POINTS 1 float\n0 0,5 0").contains("a:10: not a number; decimal comma?"));
    assert!(
        error("POINTS 1 float\n0 nan 0")
            .contains("a:10: vertex 4 has a coordinate that is not finite")
    );
    assert!(error("POINTS 1 quad\n0 0 0").contains("a:9: expected a type such as"));
    assert!(error("hello").contains("a:9: expected POINTS, POLYGONS"));
    let unused = error("POLYGONS 2 4\nOFFSETS int\n0 3\nCONNECTIVITY int\n0 1 2 3\n");
    assert_eq!(
        unused,
        "a:13: the size of the cells does not fit: 4 declared, 3 used (found '3')"
    );
    let other = SQUARE.replace("polydata", "STRUCTURED_GRID");
    let text = read_bytes(other.as_bytes(), "a").unwrap_err().to_string();
    assert!(
        text.contains("a:5: expected POLYDATA or UNSTRUCTURED_GRID: other data sets"),
        "{text}"
    );
    let future = SQUARE.replace("2.0", "7.0");
    assert!(
        read_bytes(future.as_bytes(), "a")
            .unwrap_err()
            .to_string()
            .contains("a:1: expected a version")
    );
}

#[test]
fn every_truncation_is_an_error_or_a_mesh() {
    let offsets =
        format!("{SQUARE}POLYGONS 2 3\nOFFSETS int\n0 3\nCONNECTIVITY int\n0 1 2\n").into_bytes();
    for whole in [
        written(Encoding::Text, "a1.vtk"),
        written(Encoding::Binary, "b1.vtk"),
        offsets,
    ] {
        for length in 0..whole.len() {
            if let Ok(MeshFile { mesh, .. }) = read_bytes(&whole[..length], "a.vtk") {
                TriangleMesh::new(mesh.vertices, mesh.triangles).unwrap();
            }
        }
    }
}

#[test]
fn binary_errors_name_the_offset() {
    let mut bytes = written(Encoding::Binary, "b2.vtk");
    let start = bytes.windows(7).position(|w| w == b"double\n").unwrap() + 7;
    bytes[start + 8..start + 16].copy_from_slice(&f64::INFINITY.to_be_bytes());
    let text = read_bytes(&bytes, "a").unwrap_err().to_string();
    let expected = format!(
        "a: offset {:#x}: vertex 0 has a coordinate that is not finite (found 'inf')",
        start + 8
    );
    assert_eq!(text, expected);
}

const BINARY: &str = "# vtk DataFile Version 4.2\nt\nBINARY\nDATASET POLYDATA\n";

/// A triangle of points in a type of numbers; more white space than a line feed can follow the
/// type.
fn triangle(kind: &str, numbers: impl Fn(i8) -> Vec<u8>) -> Vec<u8> {
    let mut bytes = format!("{BINARY}POINTS 3 {kind} \t\r\n").into_bytes();
    bytes.extend([0, 0, 0, 1, 0, 0, 0, 1, -2].into_iter().flat_map(numbers));
    bytes.extend(b"\nPOLYGONS 1 4\n");
    bytes.extend([3i32, 0, 1, 2].iter().flat_map(|i| i.to_be_bytes()));
    bytes
}

#[test]
fn every_type_of_binary_numbers_is_read() {
    type Encode = fn(i8) -> Vec<u8>;
    let kinds: [(&str, Encode, f64); 15] = [
        ("char", |i| i.to_be_bytes().into(), -2.),
        ("signed_char", |i| i.to_be_bytes().into(), -2.),
        ("unsigned_char", |i| i.to_be_bytes().into(), 254.),
        ("short", |i| i16::from(i).to_be_bytes().into(), -2.),
        (
            "unsigned_short",
            |i| (i as u16).to_be_bytes().into(),
            65_534.,
        ),
        ("int", |i| i32::from(i).to_be_bytes().into(), -2.),
        ("vtkIdType", |i| i32::from(i).to_be_bytes().into(), -2.),
        (
            "unsigned_int",
            |i| (i as u32).to_be_bytes().into(),
            4_294_967_294.,
        ),
        ("long", |i| i64::from(i).to_be_bytes().into(), -2.),
        ("vtktypeint64", |i| i64::from(i).to_be_bytes().into(), -2.),
        // A number that needs 64 bits becomes the largest of 63 bits.
        (
            "unsigned_long",
            |i| (i as u64).to_be_bytes().into(),
            i64::MAX as f64,
        ),
        (
            "vtktypeuint64",
            |i| (i as u64).to_be_bytes().into(),
            i64::MAX as f64,
        ),
        ("float", |i| f32::from(i).to_be_bytes().into(), -2.),
        ("double", |i| f64::from(i).to_be_bytes().into(), -2.),
        (
            "DOUBLE",
            |i| (f64::from(i) / 4.0).to_be_bytes().into(),
            -0.5,
        ),
    ];
    for (kind, encode, last) in kinds {
        let file = read_bytes(&triangle(kind, encode), "a").unwrap();
        assert_eq!(file.mesh.vertices[2].z, last, "{kind}");
        assert_eq!(file.mesh.triangles, [[0, 1, 2]], "{kind}");
    }
}

#[test]
fn errors_in_binary_numbers_name_their_offset() {
    let error = |bytes: &[u8]| read_bytes(bytes, "a").unwrap_err().to_string();
    let mut bytes = triangle("char", |i| i.to_be_bytes().into());
    let last = bytes.len() - 1;
    bytes[last] = 9;
    let out = "vertex index 9 is out of range: there are 3 vertices (found '9')";
    assert_eq!(error(&bytes), format!("a: offset {:#x}: {out}", last - 3));
    let start = BINARY.len();
    let text = error(format!("{BINARY}POINTS 3 float  x\n").as_bytes());
    assert_eq!(
        text,
        format!(
            "a: offset {:#x}: expected the end of the line (found 'x')",
            start + 16
        )
    );
    let text = error(format!("{BINARY}POINTS 3 bit\n\0\0").as_bytes());
    assert_eq!(
        text,
        format!(
            "a: offset {:#x}: expected numbers of another type here",
            start + 12
        )
    );
    let text =
        error(format!("{BINARY}POLYGONS 2 3\nOFFSETS double\n{}", "\0".repeat(16)).as_bytes());
    assert_eq!(
        text,
        format!(
            "a: offset {:#x}: expected numbers of another type here",
            start + 27
        )
    );
}

#[test]
fn metadata_between_the_arrays_of_a_field_are_skipped() {
    let metadata = "METADATA\nINFORMATION 1\nNAME L2 LOCATION v\n\n";
    let tail = format!(
        "FIELD f 2\na 1 1 int\n1\n{metadata}{metadata}b 1 1 int\n2\nPOLYGONS 1 4\n3 0 1 2\n"
    );
    let file = read_bytes(format!("{SQUARE}{tail}").as_bytes(), "").unwrap();
    assert_eq!(file.mesh.triangles, [[0, 1, 2]]);
    let cut = error("FIELD f 2\na 1 1 int\n1\nMETADATA\n");
    assert_eq!(cut, "a:13: expected the name of an array");
}

fn with_strings() -> Vec<u8> {
    let mut bytes =
        b"# vtk DataFile Version 5.1\nt\nBINARY\nDATASET POLYDATA\nFIELD f 2\nnames 1 3 string\n"
            .to_vec();
    bytes.extend([
        0xc2, b'a', b'\n', 0x80, 0x03, b'P', b'O', b'I', 0x40, 0, 0, 0,
    ]);
    bytes.extend(b"\nbits 1 9 bit\n\xff\x80\nPOINTS 3 double\n");
    for c in [0., 0., 0., 1., 0., 0., 0., 1., 0f64] {
        bytes.extend(c.to_be_bytes());
    }
    bytes.extend(b"\nMETADATA\nINFORMATION 0\n\nPOLYGONS 2 3\nOFFSETS vtktypeint64\n");
    [0, 3i64].iter().for_each(|i| bytes.extend(i.to_be_bytes()));
    bytes.extend(b"\nCONNECTIVITY unsigned_char\n\x00\x01\x02\nPOINT_DATA 3\nSCALARS s float\nLOOKUP_TABLE default\n");
    bytes
}

#[test]
fn strings_and_bits_before_binary_points_are_skipped() {
    let whole = with_strings();
    let file = read_bytes(&whole, "a").unwrap();
    assert_eq!(file.mesh.triangles, [[0, 1, 2]]);
    for length in 0..whole.len() {
        let _ = read_bytes(&whole[..length], "a");
    }
}
