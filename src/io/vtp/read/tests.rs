use crate::io::read_bytes;
use crate::testing::block_file;

const PIECE: &str = "<Piece NumberOfPoints=\"4\" NumberOfVerts=\"0\" NumberOfLines=\"1\" NumberOfStrips=\"1\" NumberOfPolys=\"2\">\n\
        <PointData><DataArray type=\"Float32\" Name=\"offsets\" format=\"ascii\">x</DataArray></PointData>\n\
        <Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">\n0 0 0 1 0 0\n1 1 0 0 1 0\n</DataArray></Points>\n\
        <Verts/><Lines><DataArray type=\"Int32\" Name=\"connectivity\">0 2</DataArray>\n\
        <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">2</DataArray></Lines>\n\
        <Strips><DataArray type=\"Int32\" Name=\"connectivity\">0 1 3 2</DataArray><DataArray type=\"Int32\" Name=\"offsets\">4</DataArray></Strips>\n\
        <Polys><DataArray type=\"UInt8\" Name=\"connectivity\" format=\"binary\">BwAAAAABAgABAgM=</DataArray>\n\
        <DataArray type=\"Int16\" Name=\"offsets\" format=\"binary\">BAAAAA==AwAHAA==</DataArray></Polys>\n</Piece>\n";

fn file(pieces: usize) -> String {
    format!(
        "<VTKFile type=\"PolyData\">\n<PolyData>\n{}</PolyData></VTKFile>",
        PIECE.repeat(pieces)
    )
}

#[test]
fn pieces_text_and_base64() {
    let one = read_bytes(file(1).as_bytes(), "a").unwrap();
    let triangles = [[0, 1, 3], [3, 1, 2], [0, 1, 2], [0, 1, 2], [0, 2, 3]];
    assert_eq!(
        (one.mesh.triangles.as_slice(), one.lines.as_slice()),
        (&triangles[..], &[vec![0, 2]][..])
    );
    let two = read_bytes(file(2).as_bytes(), "a").unwrap();
    assert_eq!(
        (
            two.mesh.vertices.len(),
            two.mesh.triangles[5],
            &two.lines[1]
        ),
        (8, [4, 5, 7], &vec![4, 6])
    );
}

#[test]
fn what_is_wrong_is_named_with_its_place() {
    let error = |from: &str, to: &str| {
        assert!(file(1).contains(from));
        read_bytes(file(1).replacen(from, to, 1).as_bytes(), "a")
            .unwrap_err()
            .terse()
    };
    assert!(error("1 1 0 0 1 0", "1 1 x 0 1 0").starts_with(
        "a:7:5: error[E011]: expected a number, in the array of Points of piece 1 (found 'x')"
    ));
    assert!(error("1 1 0 0 1 0", "1 1 0 0 inf 0").contains("error[E012]: vertex 3 has"));
    assert!(
        error("1 1 0 0 1 0", "1 1 0")
            .contains("the number of points does not fit: 4 declared, 3 used")
    );
    assert!(
        error(">0 1 3 2<", ">0 1 3 4<")
            .contains("a:11: error[E020]: vertex index 4 is out of range")
    );
    assert!(error(">4<", ">5<").contains("expected offsets that rise"));
    assert!(
        error(">4<", ">3<")
            .contains("the connectivity of the cells does not fit: 4 declared, 3 used")
    );
    assert!(
        error("Strips=\"1\"", "Strips=\"2\"")
            .contains("the number of cells does not fit: 2 declared, 1 used")
    );
    let binary = error("BwAAAAAB", "CAAAAAAB");
    assert!(
        binary.contains(": offset 0x")
            && binary.contains(", in the connectivity of Polys of piece 1;"),
        "{binary}"
    );
    let second = file(2)
        .rsplit_once(">4<")
        .map(|(a, b)| format!("{a}>5<{b}"))
        .unwrap();
    let second = read_bytes(second.as_bytes(), "a").unwrap_err().terse();
    assert!(
        second.contains(", in the offsets of Strips of piece 2 (found '5')"),
        "{second}"
    );
    assert!(error("BwAAAAAB", "Bw*AAAAB").contains("expected base64"));
    assert!(
        error("type=\"PolyData\"", "type=\"ImageData\"")
            .contains("VTK XML of another type than PolyData")
    );
    assert!(error("<VTKFile type", "<?xml?><svg type").contains("XML other than VTK's"));
    assert!(error("UInt8", "String").contains("expected a type such as"));
    assert!(error("</PolyData>", "").contains("the element PolyData"));
    assert!(
        error(
            "\"Int16\" Name=\"offsets\" format=\"binary\"",
            "\"Int16\" Name=\"offsets\" format=\"appended\""
        )
        .contains("expected an offset")
    );
    assert!(
        error(
            "Name=\"offsets\" format=\"binary\"",
            "Name=\"o\" format=\"binary\""
        )
        .contains("both connectivity and offsets")
    );
}

#[test]
fn attributes_and_arrays_that_do_not_fit_are_named() {
    let error = |from: &str, to: &str| {
        assert!(file(1).contains(from));
        read_bytes(file(1).replacen(from, to, 1).as_bytes(), "a")
            .unwrap_err()
            .terse()
    };
    let root = |attribute: &str| {
        error(
            "type=\"PolyData\"",
            &format!("type=\"PolyData\" {attribute}"),
        )
    };
    let wrong = root("byte_order=\"Big\"");
    assert!(
        wrong.starts_with("a:1:38: error[E042]: expected LittleEndian or BigEndian (found 'Big')"),
        "{wrong}"
    );
    let wrong = root("header_type=\"UInt16\"");
    assert!(
        wrong.starts_with("a:1:39: error[E042]: expected UInt32 or UInt64 (found 'UInt16')"),
        "{wrong}"
    );
    let wrong = root("compressor=\"zip\"");
    assert!(
        wrong.contains("expected the compressor of VTK for zlib, lz4 or LZMA (found 'zip')"),
        "{wrong}"
    );
    let wrong = error("format=\"ascii\">\n0", "format=\"raw\">\n0");
    assert!(
        wrong.contains("expected ascii, binary or appended (found 'raw')"),
        "{wrong}"
    );
    let wrong = error("<Points>", "<Other>");
    assert!(
        wrong.contains("error[E043]: the number of points does not fit: 4 declared, 0 used"),
        "{wrong}"
    );
    let wrong = error("BAAAAA==AwAHAA==", "AwAAAA==AwAH");
    let fit = "bytes of an array and of its type does not fit: 3 declared, 2 used, in the offsets of Polys of piece 1";
    assert!(
        wrong.contains("a: offset 0x") && wrong.contains(fit),
        "{wrong}"
    );
    let place = file(1).find("BwAAAA").unwrap();
    let wrong = error("AgM=", "AgQ=");
    let out = "error[E020]: vertex index 4 is out of range: there are 4 vertices, in the connectivity of Polys of piece 1";
    assert!(
        wrong.starts_with(&format!("a: offset {place:#x}: {out} (found '4')")),
        "{wrong}"
    );
}

#[test]
fn appended_data_that_do_not_fit_are_named() {
    let appended = |offset: &str, tail: &str| {
        let text = file(1).replacen(
            "format=\"ascii\">\n0",
            &format!("format=\"appended\" offset=\"{offset}\">\n0"),
            1,
        );
        read_bytes(text.replace("</VTKFile>", tail).as_bytes(), "a")
            .unwrap_err()
            .terse()
    };
    let wrong = appended("0", "");
    let none = "expected AppendedData for an array with an offset, in the array of Points of piece 1 (found 'DataArray')";
    assert!(
        wrong.starts_with("a:5:10: error[E042]: ") && wrong.contains(none),
        "{wrong}"
    );
    let wrong = appended("0", "\n<AppendedData encoding=\"hex\">_");
    assert!(
        wrong.starts_with("a:16:25: error[E042]: expected raw or base64 as encoding (found 'hex')"),
        "{wrong}"
    );
    let wrong = appended("0", "\n<AppendedData>_");
    assert!(
        wrong.starts_with("a:16:2: error[E042]: expected raw or base64 as encoding (found 'App"),
        "{wrong}"
    );
    let wrong = appended("0", "\n<AppendedData encoding=\"raw\"> 1");
    assert!(
        wrong.starts_with("a:16: error[E042]: expected an underscore before the appended data;"),
        "{wrong}"
    );
    let wrong = appended("5", "<AppendedData encoding=\"raw\">_1234");
    assert!(
        wrong.contains("expected an offset within the appended data, in the array of Points"),
        "{wrong}"
    );
    let wrong = appended("4", "<AppendedData encoding=\"raw\">_1234");
    assert!(
        wrong.contains("error[E041]: the file ends too early, in an array, in the array of Points"),
        "{wrong}"
    );
}

type Encode = fn(f64) -> Vec<u8>;

/// The types of numbers, in little-endian order.
const KINDS: [(&str, Encode); 10] = [
    ("Int8", |x| (x as i8).to_le_bytes().into()),
    ("Int16", |x| (x as i16).to_le_bytes().into()),
    ("Int32", |x| (x as i32).to_le_bytes().into()),
    ("Int64", |x| (x as i64).to_le_bytes().into()),
    ("UInt8", |x| (x as u8).to_le_bytes().into()),
    ("UInt16", |x| (x as u16).to_le_bytes().into()),
    ("UInt32", |x| (x as u32).to_le_bytes().into()),
    ("UInt64", |x| (x as u64).to_le_bytes().into()),
    ("Float32", |x| (x as f32).to_le_bytes().into()),
    ("Float64", |x| x.to_le_bytes().into()),
];

/// A triangle whose last coordinate is `last`: points, corners and ends as appended bytes of these types.
fn triangle(types: [(&str, Encode); 3], big: bool, last: f64) -> Vec<u8> {
    let arrays = [
        &[0., 0., 0., 1., 0., 0., 0., 1., last][..],
        &[0., 1., 2.],
        &[3.],
    ];
    let ordered = |mut number: Vec<u8>| {
        if big {
            number.reverse();
        }
        number
    };
    let (mut data, mut tags) = (Vec::new(), Vec::new());
    for ((kind, encode), (numbers, name)) in
        types
            .into_iter()
            .zip(arrays.into_iter().zip(["", "connectivity", "offsets"]))
    {
        let bytes: Vec<u8> = numbers.iter().flat_map(|&x| ordered(encode(x))).collect();
        let offset = data.len();
        tags.push(format!(
            "<DataArray type='{kind}' Name='{name}' format='appended' offset='{offset}'/>"
        ));
        data.extend(ordered((bytes.len() as u32).to_le_bytes().into()));
        data.extend(bytes);
    }
    let order = if big { "BigEndian" } else { "LittleEndian" };
    let [points, corners, ends] = [&tags[0], &tags[1], &tags[2]];
    let head = format!(
        "<VTKFile type='PolyData' byte_order='{order}'><PolyData><Piece NumberOfPoints='3'><Points>{points}</Points>\
             <Polys>{corners}{ends}</Polys></Piece></PolyData><AppendedData encoding='raw'>_"
    );
    [head.as_bytes(), &data].concat()
}

#[test]
fn every_type_of_number_is_read_in_both_orders() {
    for (i, &kind) in KINDS.iter().enumerate() {
        let last = if kind.0.starts_with('U') { 254. } else { -2. };
        // Corners and ends take each integer type in turn.
        let types = [kind, KINDS[(i + 3) % 8], KINDS[(i + 6) % 8]];
        for big in [false, true] {
            let file = read_bytes(&triangle(types, big, last), "a").unwrap();
            assert_eq!(
                file.mesh.vertices[2],
                [0., 1., last].into(),
                "{} {big}",
                kind.0
            );
            assert_eq!(file.mesh.triangles, [[0, 1, 2]], "{} {big}", kind.0);
        }
    }
    let real = read_bytes(&triangle([KINDS[8]; 3], false, 0.), "a")
        .unwrap_err()
        .to_string();
    assert!(real.contains("expected offsets that rise"), "{real}");
    let real = read_bytes(&triangle([KINDS[8], KINDS[9], KINDS[0]], false, 0.), "a")
        .unwrap_err()
        .to_string();
    assert!(
        real.contains("vertex index 9223372036854775807 is out of range"),
        "{real}"
    );
    let nan = read_bytes(
        &triangle([KINDS[8], KINDS[0], KINDS[0]], true, f64::NAN),
        "a",
    )
    .unwrap_err()
    .to_string();
    assert!(
        nan.contains("vertex 2 has a coordinate that is not finite")
            && nan.contains("(found 'NaN')"),
        "{nan}"
    );
}

#[test]
fn headers_orders_and_encodings_of_appended_arrays() {
    let points = [0, 0, 0, 1, 0, 0, 0, 1, 0xfe];
    for choice in (0..8).map(|flags| 3 | flags << 2) {
        let file = read_bytes(&block_file(choice, 0, &points), "a").unwrap();
        assert_eq!(file.mesh.vertices[2], [0., 1., -2.].into(), "{choice}");
    }
}

#[test]
fn coordinates_too_small_for_a_double_are_counted() {
    let file = read_bytes(
        file(1)
            .replace("1 1 0 0 1 0", "1 1 1e-400 -1e-999 1 0")
            .as_bytes(),
        "a",
    )
    .unwrap();
    let lines: Vec<String> = file.warnings.iter().map(|w| w.terse("a")).collect();
    assert_eq!(
        lines,
        ["a:7: warning[W001]: 2 coordinates too small for a double became 0"]
    );
    assert_eq!(file.mesh.vertices[3].x.to_bits(), (-0.0f64).to_bits());
}

#[test]
fn arrays_before_the_first_piece_are_skipped() {
    let array = "<FieldData><DataArray type=\"Float64\" Name=\"TimeValue\" format=\"ascii\">x</DataArray></FieldData>";
    let with = file(1).replace("<PolyData>", &format!("<PolyData>{array}"));
    assert!(with.contains("TimeValue"));
    assert_eq!(
        read_bytes(with.as_bytes(), "a").unwrap(),
        read_bytes(file(1).as_bytes(), "a").unwrap()
    );
}

#[test]
fn arrays_that_share_bytes_are_refused_before_they_take_long() {
    let points = "<Piece NumberOfPoints=\"3000\"><Points><DataArray type=\"UInt8\" format=\"appended\" offset=\"0\"/></Points></Piece>";
    let mut bytes = format!(
        "<VTKFile type=\"PolyData\"><PolyData>{}</PolyData><AppendedData encoding=\"raw\">_",
        points.repeat(50)
    )
    .into_bytes();
    bytes.extend(9000u32.to_le_bytes());
    bytes.extend([1; 9000]);
    let text = read_bytes(&bytes, "a").unwrap_err().terse();
    assert!(
        text.contains("expected arrays that share no bytes"),
        "{text}"
    );
}

#[test]
fn every_truncation_is_an_error_or_a_mesh() {
    let whole = file(2);
    for length in 0..whole.len() {
        let _ = read_bytes(&whole.as_bytes()[..length], "a.vtp");
    }
}
