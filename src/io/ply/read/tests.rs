use super::*;
use crate::io::{Format, Warning, read_bytes};

const LIST: &str = "property list uchar int vertex_indices\n";

fn head(encoding: &str, vertices: &str, faces: &str) -> String {
    let axes =
        "property float x\nproperty double y\nproperty short z\nproperty list uchar char odd\n";
    format!(
        "ply\nformat {encoding} 1.0\ncomment c\nelement vertex {vertices}\n{axes}element face {faces}\n{LIST}end_header\n"
    )
}

const VERTICES: [(f32, f64, i16); 4] = [(0., 0., 0), (1., 0.1, 0), (0., 1., -3), (1., 1., 0)];
const FACES: [&[i32]; 2] = [&[0, 1, 2], &[0, 1, 3, 2]];

fn text() -> String {
    let mut text = head("ascii", "4", "2");
    for (x, y, z) in VERTICES {
        text += &format!("{x} {y} {z} 2 1 -1\n");
    }
    text + "3 0 1 2\n\n4 0 1 3 2"
}

fn binary(big: bool) -> Vec<u8> {
    let encoding = if big {
        "binary_big_endian"
    } else {
        "binary_little_endian"
    };
    let mut bytes = head(encoding, "4", "2").into_bytes();
    let mut push = |little: &[u8]| {
        let mut number = little.to_vec();
        if big {
            number.reverse();
        }
        bytes.extend(number);
    };
    for (x, y, z) in VERTICES {
        push(&x.to_le_bytes());
        push(&y.to_le_bytes());
        push(&z.to_le_bytes());
        push(&[1]);
        push(&[0x0a]);
    }
    for face in FACES {
        push(&[face.len() as u8]);
        face.iter().for_each(|i| push(&i.to_le_bytes()));
    }
    bytes
}

#[test]
fn text_and_both_byte_orders_are_the_same_mesh() {
    let file = read_bytes(text().as_bytes(), "a.ply").unwrap();
    assert_eq!(file.mesh.triangles, [[0, 1, 2], [0, 1, 3], [0, 3, 2]]);
    assert_eq!(file.mesh.vertices[2], Point3::new(0., 1., -3.));
    let little = read_bytes(&binary(false), "").unwrap();
    assert_eq!((&file.mesh, file.format), (&little.mesh, Some(Format::Ply)));
    // The square is bent; only the place of the warning differs.
    let bent = Warning::NotFlatOrConvex;
    assert_eq!(
        (file.warnings.count(bent), little.warnings.count(bent)),
        (1, 1)
    );
    assert_eq!(little.mesh, read_bytes(&binary(true), "").unwrap().mesh);
    let crlf = text().replace('\n', "\r\n");
    assert_eq!(file, read_bytes(crlf.as_bytes(), "").unwrap());
}

/// Records without lists are read as a whole; each type is read in both byte orders.
#[test]
fn every_type_of_number_is_read() {
    let head = |encoding: &str, x: &str| {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex 3\nproperty uchar r\nproperty {x} x\nproperty double y\n\
                 property float z\nelement face 1\nproperty list uchar uchar vertex_index\nend_header\n"
        )
    };
    let one: [(&str, &[u8]); 10] = [
        ("char", &[0xff]),
        ("uchar", &[0xff]),
        ("short", &[0xfe, 0xff]),
        ("ushort", &[0xfe, 0xff]),
        ("int", &[0xfe, 0xff, 0xff, 0xff]),
        ("uint", &[0xfe, 0xff, 0xff, 0xff]),
        ("int64", &[0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff]),
        ("uint64", &[0xfe, 0xff, 0, 0, 0, 0, 0, 0]),
        ("float", &[0, 0, 0x20, 0xc0]),
        ("double", &[0, 0, 0, 0, 0, 0, 4, 0xc0]),
    ];
    let values = [
        -1.,
        255.,
        -2.,
        65534.,
        -2.,
        4294967294.,
        -2.,
        65534.,
        -2.5,
        -2.5,
    ];
    for ((kind, little), value) in one.into_iter().zip(values) {
        for (encoding, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
            let ordered = |bytes: &[u8]| -> Vec<u8> {
                if big {
                    bytes.iter().rev().copied().collect()
                } else {
                    bytes.to_vec()
                }
            };
            let mut bytes = head(encoding, kind).into_bytes();
            for i in 0..3u8 {
                bytes.push(9);
                bytes.extend(ordered(little));
                bytes.extend(ordered(&f64::from(i).to_le_bytes()));
                bytes.extend(ordered(&f32::from(i * i).to_le_bytes()));
            }
            bytes.extend([3, 0, 1, 2]);
            let file = read_bytes(&bytes, "").unwrap();
            assert_eq!(
                file.mesh.vertices[2],
                Point3::new(value, 2., 4.),
                "{kind} {encoding}"
            );
            for length in 0..bytes.len() {
                let error = read_bytes(&bytes[..length], "").unwrap_err().code();
                assert!(
                    ["E001", "E002", "E003", "E040", "E041", "E042"].contains(&error),
                    "{length}: {error}"
                );
            }
        }
    }
}

#[test]
fn edges_are_lines() {
    let head = "element edge 2\nproperty uchar red\nproperty int vertex1\nproperty ushort vertex2\nend_header";
    let with_edges = |edges: &str| format!("{}\n{edges}", text().replace("end_header", head));
    let file = read_bytes(with_edges("7 0 1\n7 3 2\n").as_bytes(), "a").unwrap();
    assert_eq!(file.lines, [[0, 1], [3, 2]]);
    let error = |edges: &str| {
        read_bytes(with_edges(edges).as_bytes(), "a")
            .unwrap_err()
            .to_string()
    };
    assert!(
        error("7 0 1\n7 3 4\n").contains("a:24: vertex index 4 is out of range"),
        "{}",
        error("7 0 1\n7 3 4\n")
    );
    let other = with_edges("7 0 1\n7 3 4\n").replace("vertex2", "other");
    assert!(read_bytes(other.as_bytes(), "a").unwrap().lines.is_empty());
    let real = with_edges("7 0 1\n7 3 2\n").replace("ushort", "float");
    assert!(
        read_bytes(real.as_bytes(), "a")
            .unwrap_err()
            .to_string()
            .contains("whole numbers as vertex indices")
    );
}

#[test]
fn every_truncation_is_an_error() {
    for whole in [text().into_bytes(), binary(false), binary(true)] {
        for length in 0..whole.len() {
            // A truncated last number of a text can be valid; here it is a single digit.
            read_bytes(&whole[..length], "a.ply").unwrap_err();
        }
    }
}

#[test]
fn counts_that_the_file_cannot_hold_are_refused() {
    let big = "1000000000000000000";
    for encoding in ["ascii", "binary_little_endian"] {
        let error = read_bytes(head(encoding, big, "1").as_bytes(), "a")
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("1000000000000000000 items are declared"),
            "{error}"
        );
    }
    let empty = format!("ply\nformat ascii 1.0\nelement nothing {big}\nend_header\n");
    assert_eq!(
        read_bytes(empty.as_bytes(), "a").unwrap_err().to_string(),
        "a: the file has no vertices"
    );
    let mut long = binary(false);
    let list = long.len() - 17;
    long[list] = 255;
    let error = read_bytes(&long, "a").unwrap_err().to_string();
    assert!(
        error.contains("offset") && error.contains("255 items are declared"),
        "{error}"
    );
}

#[test]
fn errors_name_the_line() {
    let error = |from: &str, to: &str| {
        read_bytes(text().replace(from, to).as_bytes(), "a")
            .unwrap_err()
            .to_string()
    };
    assert_eq!(
        error("3 0 1 2", "3 0 1 4"),
        "a:16: vertex index 4 is out of range: there are 4 vertices (found '3 0 1 4')"
    );
    assert_eq!(
        error("3 0 1 2", "3 0 1"),
        "a:16: too few numbers: 3 of 4 (found '3 0 1')"
    );
    assert_eq!(
        error("3 0 1 2", "2 0 1"),
        "a:16: too few corners: 2, at least 3 are needed (found '2 0 1')"
    );
    assert!(error("3 0 1 2", "3 0 1 -1").contains("a:16: vertex index -1 is out of range"));
    assert!(error("3 0 1 2", "-3 0 1 2").contains("a:16: expected a whole number of list items"));
    assert_eq!(
        error("1 0.1 0", "1 0,1 0"),
        "a:13: not a number; decimal comma? Write a point (found '0,1')"
    );
    assert!(
        error("1 0.1 0", "1 -1e400 0")
            .contains("a:13: vertex 1 has a coordinate that is too large for a double")
    );
    assert!(
        error("1 0.1 0", "1 nan 0").contains("a:13: vertex 1 has a coordinate that is not finite")
    );
    assert!(error("float x", "half x").contains("a:5: expected a type such as"));
    assert!(error("ascii", "utf8").contains("a:2: expected ascii, binary_little_endian"));
    assert!(error("format ascii 1.0", "comment").contains("expected 'format' before 'end_header'"));
    assert!(error("element vertex 4", "").contains("a:5: expected 'element' before 'property'"));
    assert!(error("comment c", "hello").contains("a:3: expected format, comment, element"));
    assert!(error("property float x", "property float u").contains("properties x, y and z"));
    assert!(error("vertex_indices", "indices").contains("a list vertex_indices"));
    assert!(
        error("property float x", "property list uchar float x")
            .contains("expected numbers x, y and z, not lists")
    );
}

#[test]
fn coordinates_too_small_for_a_double_are_counted() {
    let file = read_bytes(
        text().replace("1 0.1 0", "-1e-400 1e-999 0").as_bytes(),
        "a",
    )
    .unwrap();
    let lines: Vec<String> = file.warnings.iter().map(|w| w.terse("a")).collect();
    assert_eq!(
        lines[0],
        "a:13: warning[W001]: 2 coordinates too small for a double became 0"
    );
    let vertex = file.mesh.vertices[1];
    assert_eq!(
        [vertex.x, vertex.y].map(f64::to_bits),
        [-0.0f64, 0.0].map(f64::to_bits)
    );
}
