//! Small generated files of every format and dialect: the start of fuzzing and mutations.

use super::blocks::base64;
use crate::io::FORMATS;
use crate::scene::builtin::BUILTIN;

/// Two triangles that share an edge.
const POINTS: [[f32; 3]; 4] = [
    [0., 0., 0.],
    [1., 0., 0.25],
    [1., 1.5, -0.],
    [-1e-3, 1., 0.],
];

/// The same points as text.
const LINES: &str = "0 0 0\n1 0 .25\n1.0 15e-1 -0\n-1e-3 1 0\n";

/// Small files for a target of [`check_target`](super::check_target); empty for an unknown name.
pub fn seeds(target: &str) -> Vec<Vec<u8>> {
    match target {
        "obj" => obj(),
        "ply" => ply(),
        "stl" => stl(),
        "off" => off(),
        "vtk" => [vtk_text(), vtk_binary()].concat(),
        "vtp" => vtp(),
        "directx" => directx(),
        "medit" => medit(),
        "any" => {
            let mut targets: Vec<&str> = FORMATS.iter().map(|spec| spec.target).collect();
            targets.dedup();
            let all = targets.into_iter().flat_map(seeds);
            // OFF without its keyword is recognised by its name alone.
            all.filter(|seed| !seed[0].is_ascii_digit()).collect()
        }
        "blocks" => blocks(),
        "scene" => BUILTIN
            .iter()
            .map(|(_, text, _)| text.as_bytes().to_vec())
            .collect(),
        "write" => write(),
        "repair" => repair(),
        "state" => super::restoring::states(),
        "springs" => springs(),
        "pvd" => collections(),
        "opensim" => models(),
        _ => samples(target),
    }
}

/// The samples of the formats of a target.
fn samples(target: &str) -> Vec<Vec<u8>> {
    FORMATS
        .iter()
        .filter(|spec| spec.target == target && !spec.sample.is_empty())
        .map(|spec| spec.sample.to_vec())
        .collect()
}

fn springs() -> Vec<Vec<u8>> {
    texts([
        "3 2\n0 0 0 m\n1 0 0 m\n0 1 .5 i\n1\n0 1 2\n2\n0 1 1.5\n1 2 2\n1\n0 1\n1\n0\n1\n2\n"
            .to_owned(),
        "2 2\r\n\r\n1e3 0 0 m\r\n0 -1 0\tm\r\n0\r\n1\r\n1 0 4\r\n0\r\n0\r\n0".to_owned(),
    ])
}

fn models() -> Vec<Vec<u8>> {
    let joint = "<PinJoint name=\"j\"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>f</socket_child_frame>\
        <coordinates><Coordinate name=\"q\"><default_value>0.1</default_value></Coordinate></coordinates>\
        <frames><PhysicalOffsetFrame name=\"f\"><socket_parent>/bodyset/b</socket_parent><translation>0 1 2</translation>\
        </PhysicalOffsetFrame></frames></PinJoint>";
    texts([
        format!(
            "<OpenSimDocument Version=\"40600\"><Model name=\"m\"><BodySet name=\"bodyset\"><objects><Body name=\"b\"/></objects></BodySet>\
             <JointSet name=\"jointset\"><objects>{joint}</objects></JointSet></Model></OpenSimDocument>"
        ),
        "name\ninDegrees=yes\nendheader\ntime\tq\n0\t1\n0.5\t-2e1\n".to_owned(),
        "Coordinates\nnRows=1\nendheader\ntime /jointset/j/q/value\n0 1\n".to_owned(),
    ])
}

fn collections() -> Vec<Vec<u8>> {
    texts([
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n  <Collection>\n    \
         <DataSet timestep=\"0.0\" group=\"\" part=\"0\" name=\"a &amp; b\" file=\"frames/a_b_0000.vtp\"/>\n    \
         <DataSet timestep=\"0.04\" group=\"\" part=\"1\" name=\"bone_c\" file=\"frames/bone_c_0001.vtp\"/>\n  \
         </Collection>\n</VTKFile>\n"
            .to_owned(),
        "<VTKFile type='Collection'><!-- c --><Collection><DataSet timestep='-1e-3' file='./a.vtp'></DataSet></Collection></VTKFile>"
            .to_owned(),
    ])
}

fn texts<const N: usize>(texts: [String; N]) -> Vec<Vec<u8>> {
    texts.map(String::into_bytes).to_vec()
}

fn obj() -> Vec<Vec<u8>> {
    let points: String = LINES.lines().map(|line| format!("v {line}\n")).collect();
    texts([
        format!(
            "# a\no b\ng c\nmtllib d.mtl\n{points}vt 0 1\nvn 0 0 1\nusemtl e\ns off\nf 1/1/1 2//1 3/1\nf 2 3 4 1\nl 1 2 3\np 1\n"
        ),
        format!("{points}f -4 -3 -2 -1\nf 1 2 \\\n 3\r\nl -1 -2\r"),
        format!("f 1 3 4\n{points}v 1 2 3 0.5 0.5 0.5\nv 1 2 3 1\nf 5/1/ 6 1\nf 1 1 2 # twice\n"),
    ])
}

fn ply_head(encoding: &str, faces: &str) -> String {
    format!(
        "ply\nformat {encoding} 1.0\ncomment c\nobj_info i\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\nelement face 2\nproperty list uchar {faces}\nend_header\n"
    )
}

fn ply() -> Vec<Vec<u8>> {
    let text = ply_head("ascii", "int vertex_indices") + LINES + "3 0 1 2\n3 0 2 3\n";
    let more = "ply\nformat ascii 1.0\nelement camera 1\nproperty double a\nproperty list uchar short b\nelement vertex 3\n\
        property double x\nproperty uchar red\nproperty int y\nproperty int8 z\nelement face 1\nproperty float q\n\
        property list uint32 uint16 vertex_index\nproperty list int8 float64 t\nelement edge 0\nend_header\n\
        1.5 2 3 4\n0 255 0 0\n1 0 0 0\n0 0 1 1\n0.5 3 0 1 2 2 0.5 0.25\n";
    let mut all = texts([text, more.to_owned()]);
    for (encoding, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
        let mut bytes = ply_head(encoding, "ushort vertex_index").into_bytes();
        bytes.extend(POINTS.iter().flatten().flat_map(|c| {
            if big {
                c.to_be_bytes()
            } else {
                c.to_le_bytes()
            }
        }));
        for face in [&[0u16, 1, 2][..], &[0, 1, 2, 3]] {
            bytes.push(face.len() as u8);
            bytes.extend(face.iter().flat_map(|i| {
                if big {
                    i.to_be_bytes()
                } else {
                    i.to_le_bytes()
                }
            }));
        }
        all.push(bytes);
    }
    all
}

fn stl() -> Vec<Vec<u8>> {
    let facets = [[0, 1, 2], [0, 2, 3]].map(|t: [usize; 3]| t.map(|i| POINTS[i]));
    let mut text = String::from("solid a b\n");
    for facet in facets {
        text += "facet normal 0 0 1\nouter loop\n";
        facet
            .iter()
            .for_each(|[x, y, z]| text += &format!(" vertex {x} {y:e} {z:?}\n"));
        text += "endloop\nendfacet\n";
    }
    text += "endsolid a b\n";
    let mut binary = b"solid of no text".to_vec();
    binary.resize(80, 0);
    binary.extend(2u32.to_le_bytes());
    for facet in facets {
        binary.extend([0; 12]);
        binary.extend(facet.iter().flatten().flat_map(|c| c.to_le_bytes()));
        binary.extend([0, 0]);
    }
    let quad = "SOLID\r\nOUTER LOOP\r\nVERTEX 0 0 0\r\nVERTEX 1 0 0\r\nVERTEX 1 1 0\r\nVERTEX 0 1 0\r\nENDLOOP\r\nENDSOLID\r\nsolid\nendsolid";
    vec![text.into_bytes(), binary, quad.into()]
}

fn off() -> Vec<Vec<u8>> {
    let faces = "3 0 1 2\n4 0 1 2 3 255 0 0\n2 0 1\n1 3\n";
    let colours: String = LINES
        .lines()
        .map(|line| format!("{line} 255 0 0 255\n"))
        .collect();
    texts([
        format!("OFF\n4 4 0\n{LINES}{faces}"),
        format!("# a\nOFF 4 4 # b\n\n{LINES}{faces}"),
        format!("COFF\r\n4 4 0\r\n{colours}{faces}"),
        format!("STCNOFF\n4 4 0\n{colours}{faces}"),
        format!("4 4 0\n{LINES}{faces}"),
    ])
}

fn vtk_text() -> Vec<Vec<u8>> {
    let head = |version: &str, set: &str| {
        format!("# vtk DataFile Version {version}\ntitle\nASCII\nDATASET {set}\n")
    };
    let points = format!("POINTS 4 float\n{LINES}");
    texts([
        format!(
            "{}{points}POLYGONS 2 9\n3 0 1 2\n4 0 1 2 3\nTRIANGLE_STRIPS 1 5\n4 0 1 3 2\nLINES 1 4\n3 0 2 3\nVERTICES 1 2\n1 0\n\
             POINT_DATA 4\nSCALARS s float\nLOOKUP_TABLE default\n0 1 2 3\n",
            head("3.0", "POLYDATA")
        ),
        format!(
            "{}FIELD f 2\nTime 1 1 double\n0.5\nnames 1 2 string\na\nb%20c\nPOINTS 4 double\n{LINES}METADATA\nINFORMATION 1\nNAME L2 LOCATION v\n\n\
             POLYGONS 2 3\nOFFSETS vtktypeint64\n0 3\nCONNECTIVITY vtktypeint64\n0 1 2\nCELL_DATA 1\n",
            head("5.1", "POLYDATA")
        ),
        format!(
            "{}{points}CELLS 6 26\n3 0 1 2\n4 0 1 3 2\n4 0 1 2 3\n2 0 3\n4 0 1 3 2\n3 0 1 2\nCELL_TYPES 6\n5 8 9 3 6 7\n",
            head("2.0", "UNSTRUCTURED_GRID")
        ),
        format!(
            "{}{points}CELLS 3 5\nOFFSETS vtktypeint64\n0 3 5\nCONNECTIVITY vtktypeint64\n0 1 2 0 3\nCELL_TYPES 2\n5\n4\n",
            head("5.0", "UNSTRUCTURED_GRID")
        ),
    ])
}

fn vtk_binary() -> Vec<Vec<u8>> {
    let points: Vec<u8> = POINTS
        .iter()
        .flatten()
        .flat_map(|c| c.to_be_bytes())
        .collect();
    let whole =
        |numbers: &[i32]| -> Vec<u8> { numbers.iter().flat_map(|i| i.to_be_bytes()).collect() };
    let long = [0i64, 3].map(i64::to_be_bytes).concat();
    let head = |set: &str, version: &str| {
        format!("# vtk DataFile Version {version}\nt\nBINARY\nDATASET {set}\n").into_bytes()
    };
    let old = [
        &head("POLYDATA", "4.2"),
        &b"POINTS 4 float\n"[..],
        &points,
        b"\nLINES 1 4\n",
        &whole(&[3, 0, 1, 2]),
        b"\nPOLYGONS 2 9\n",
        &whole(&[3, 0, 1, 2, 4, 0, 1, 2, 3]),
        b"\nPOINT_DATA 4\n",
    ];
    let new = [
        &head("POLYDATA", "5.1"),
        &b"FIELD f 2\nnames 1 2 string\n"[..],
        &[0xc1, b'a', 0x80, 2, b'b', b'c'],
        b"\nbits 1 9 bit\n\xff\x80\nPOINTS 4 float\n",
        &points,
        b"\nMETADATA\nINFORMATION 0\n\nPOLYGONS 2 3\nOFFSETS vtktypeint64\n",
        &long,
        b"\nCONNECTIVITY unsigned_char\n\x00\x01\x02\n",
    ];
    let grid = [
        &head("UNSTRUCTURED_GRID", "4.2"),
        &b"POINTS 4 float\n"[..],
        &points,
        b"\nCELLS 2 9\n",
        &whole(&[3, 0, 1, 2, 4, 0, 1, 3, 2]),
        b"\nCELL_TYPES 2\n",
        &whole(&[5, 8]),
    ];
    vec![old.concat(), new.concat(), grid.concat()]
}

/// An array of a file: type and name as attributes, and the text between its tags.
fn array(attributes: &str, text: &str) -> String {
    format!("<DataArray {attributes}>{text}</DataArray>\n")
}

fn vtp_file(root: &str, points: &str, polys: &str, tail: &str) -> Vec<u8> {
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" {root}>\n<PolyData>\n<Piece NumberOfPoints=\"4\" NumberOfPolys=\"2\">\n\
         <PointData></PointData>\n<Points>\n{points}</Points>\n<Polys>\n{polys}</Polys>\n</Piece>\n</PolyData>\n{tail}</VTKFile>\n"
    )
    .into_bytes()
}

/// The three arrays of a file as little-endian bytes: points, corners of the polygons, their ends.
fn arrays() -> [Vec<u8>; 3] {
    let whole = |numbers: &[i32]| numbers.iter().flat_map(|i| i.to_le_bytes()).collect();
    [
        POINTS
            .iter()
            .flatten()
            .flat_map(|c| c.to_le_bytes())
            .collect(),
        whole(&[0, 1, 2, 0, 1, 2, 3]),
        whole(&[3, 7]),
    ]
}

/// The LZMA2 chunks of stored, uncompressed bytes.
fn stored(bytes: &[u8]) -> Vec<u8> {
    let length = (bytes.len() - 1) as u16;
    [&[1][..], &length.to_be_bytes(), bytes, &[0]].concat()
}

/// Types and names of the arrays.
const ATTRIBUTES: [(&str, &str); 3] = [
    ("Float32", "NumberOfComponents=\"3\""),
    ("Int32", "Name=\"connectivity\""),
    ("Int32", "Name=\"offsets\""),
];

/// The arrays of the polygons with their texts.
fn polygons(texts: [String; 2], how: &str) -> String {
    let each = ATTRIBUTES[1..].iter().zip(texts);
    each.map(|((kind, name), text)| array(&format!("type=\"{kind}\" {name} {how}"), &text))
        .collect()
}

/// A function that compresses bytes.
type Pack = fn(&[u8]) -> Vec<u8>;

fn vtp() -> Vec<Vec<u8>> {
    let ascii = vtp_file(
        "",
        &array(
            "type=\"Float64\" NumberOfComponents='3' format=\"ascii\"",
            LINES,
        ),
        &polygons(["0 1 2 0 1 2 3".into(), "3\n7".into()], "format=\"ascii\""),
        "",
    );
    let cells = "<Piece NumberOfPoints='4' NumberOfLines='1' NumberOfStrips='1'><Points><DataArray type='Float32'>\
        0 0 0 1 0 0 1 1 0 0 1 0</DataArray></Points><Lines><DataArray type='UInt8' Name='connectivity'>0 2</DataArray>\
        <DataArray type='UInt8' Name='offsets'>2</DataArray></Lines><!-- - --><Strips><DataArray type='Int64' Name='connectivity'>\
        0 1 3 2</DataArray><DataArray type='Int64' Name='offsets'>4</DataArray></Strips><Polys/></Piece>";
    let pieces = format!(
        "<VTKFile type='PolyData' byte_order='BigEndian'><PolyData>{cells}{cells}</PolyData></VTKFile>"
    );
    let pack: [(&str, Pack); 4] = [
        ("", <[u8]>::to_vec),
        ("vtkZLibDataCompressor", |b| {
            miniz_oxide::deflate::compress_to_vec_zlib(b, 6)
        }),
        ("vtkLZ4DataCompressor", lz4_flex::compress),
        ("vtkLZMADataCompressor", |b| super::blocks::xz(&stored(b))),
    ];
    let mut all = vec![ascii, pieces.into_bytes()];
    all.extend(
        pack.iter()
            .flat_map(|&(name, pack)| [inline(name, pack), appended(name, pack)]),
    );
    all
}

fn root(compressor: &str) -> String {
    format!("byte_order=\"LittleEndian\" header_type=\"UInt32\" compressor=\"{compressor}\"")
}

/// The header of an array, and its bytes.
fn packed(compressor: &str, pack: Pack, bytes: &[u8]) -> [Vec<u8>; 2] {
    let packed = pack(bytes);
    let (size, length) = (bytes.len() as u32, packed.len() as u32);
    let words = if compressor.is_empty() {
        vec![length]
    } else {
        vec![1, size, 0, length]
    };
    [
        words.into_iter().flat_map(u32::to_le_bytes).collect(),
        packed,
    ]
}

/// Arrays in base64 between their tags.
fn inline(compressor: &str, pack: Pack) -> Vec<u8> {
    let [points, corners, ends] = arrays().map(|bytes| {
        let parts = packed(compressor, pack, &bytes);
        // Without a compressor header and bytes are one stream; with one each has its own padding.
        let letters = if compressor.is_empty() {
            base64(&parts.concat())
        } else {
            parts.map(|b| base64(&b)).concat()
        };
        String::from_utf8_lossy(&letters).into_owned()
    });
    let how = "format=\"binary\"";
    let points = array(
        &format!("type=\"Float32\" NumberOfComponents=\"3\" {how}"),
        &points,
    );
    vtp_file(
        &root(compressor),
        &points,
        &polygons([corners, ends], how),
        "",
    )
}

/// Raw arrays after all tags.
fn appended(compressor: &str, pack: Pack) -> Vec<u8> {
    let mut data = Vec::new();
    let offsets = arrays().map(|bytes| {
        let start = data.len();
        packed(compressor, pack, &bytes)
            .iter()
            .for_each(|part| data.extend(part));
        start
    });
    let tag = |((kind, name), offset): (&(&str, &str), usize)| {
        format!("<DataArray type=\"{kind}\" {name} format=\"appended\" offset=\"{offset}\"/>\n")
    };
    let tags: Vec<String> = ATTRIBUTES.iter().zip(offsets).map(tag).collect();
    let tail = "<AppendedData encoding=\"raw\">_@</AppendedData>";
    let whole = vtp_file(&root(compressor), &tags[0], &tags[1..].concat(), tail);
    let at = whole.iter().position(|&b| b == b'@').unwrap_or(whole.len());
    [&whole[..at], &data, &whole[at + 1..]].concat()
}

fn directx() -> Vec<Vec<u8>> {
    let points: String = LINES
        .lines()
        .map(|line| line.replace(' ', ";") + ";,\n")
        .collect();
    let mesh = format!(
        "Mesh m {{\n4;\n{points};\n2;\n3;0,1,2;,\n4;0,1,2,3;;\nMeshNormals {{ 1; 0;0;1;; 2; 3;0,0,0;, 4;0,0,0,0;; }}\n}}\n"
    );
    let matrix = "FrameTransformMatrix { 0,1,0,0, -1,0,0,0, 0,0,1,0, 5,0,0,1;; }";
    texts([
        format!("xof 0302txt 0064\n// a\n{mesh}"),
        format!(
            "xof 0303txt 0032\ntemplate T {{\n<3D82AB44-62DA-11cf-AB39-0020AF71E433>\nDWORD n;\n[...]\n}}\n\
             Frame a {{ {matrix} Frame b {{ {matrix} {mesh} }} }}\nMaterial {{ \"a{{b\"; {{m}} }} # end\n"
        ),
    ])
}

fn medit() -> Vec<Vec<u8>> {
    let points: String = LINES.lines().map(|line| line.to_owned() + " 0\n").collect();
    let faces = "Triangles\n1\n1 2 3 0\nQuadrilaterals\n1\n1 2 3 4 0\n";
    texts([
        format!("MeshVersionFormatted 1\nDimension\n3\nVertices\n4\n{points}{faces}End\n"),
        format!(
            "MeshVersionFormatted 2 # a\nDimension 3\nVertices 4\n{points}Corners 1\n1\n{faces}\
             Edges 2\n1 2 0\n2 3 1\nTetrahedra 1\n1 2 3 4 0\nEnd\n"
        ),
    ])
}

/// Choices and compressed bytes for [`check_blocks`](super::blocks::check_blocks).
fn blocks() -> Vec<Vec<u8>> {
    let points = [0, 0, 0, 1, 0, 0, 0, 1, 0].repeat(30);
    // The same bytes by liblzma, as raw LZMA2.
    let lzma =
        b"\xe0\x01\x0d\x00\x0b\x5d\x00\x00\x67\xfe\xc3\x0d\x70\xa4\x79\xc6\xe0\x00\x00".to_vec();
    let packed = [
        (0, miniz_oxide::deflate::compress_to_vec_zlib(&points, 6)),
        (1, lz4_flex::compress(&points)),
        (2, lzma),
        (2, stored(&points)),
        (3, points.clone()),
    ];
    let choices = packed
        .into_iter()
        .flat_map(|(kind, packed)| [(kind, packed.clone()), (kind | 28, packed)]);
    choices
        .map(|(choice, packed)| [&[choice, 16, 14], &packed[..]].concat())
        .collect()
}

/// Counts, coordinates and indices for [`check_round_trip`](super::round_trip::check_round_trip).
fn write() -> Vec<Vec<u8>> {
    let mut plain = vec![4, 2, 1];
    for c in [0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 3] {
        plain.extend([2, 128 + c]);
    }
    plain.extend([0, 0, 1, 2, 1, 3, 2, 1, 0, 3]);
    let mut hard = vec![3, 1, 0];
    for c in [
        0.1,
        -0.0,
        5e-324,
        1.0 / 3.0,
        -1e300,
        f64::MAX,
        1e16,
        123.456,
        1e-7,
    ] {
        hard.push(0);
        hard.extend(c.to_be_bytes());
    }
    hard.extend([0, 0, 1, 2]);
    vec![plain, hard]
}

/// Options, and a mesh for [`check_repair`](super::mending::check_repair).
fn repair() -> Vec<Vec<u8>> {
    // A cube on an integer grid, and many triangles over its corners.
    let corners = (0..8u8).flat_map(|k| [k & 1, k >> 1 & 1, k >> 2]);
    let cube: Vec<u8> = corners.flat_map(|c| [2, 128 + c]).collect();
    let faces = [
        0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2,
        1, 3, 7, 1, 7, 5,
    ];
    let heap: Vec<u8> = (0..20u8)
        .flat_map(|k| [k % 8, (k / 2 + 1) % 8, (k / 3 + 2 + k % 5) % 8])
        .collect();
    let mesh = |options: [u8; 2], indices: &[u8]| {
        [
            &options[..],
            &[8, (indices.len() / 3) as u8, 0],
            &cube,
            &[0],
            indices,
        ]
        .concat()
    };
    vec![
        mesh([0, 0], &faces),
        mesh([2, 8], &faces[3..]),
        mesh([1, 15], &heap),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::{LoadOutcome, check_target, loaders};
    use super::*;

    /// A seed that no reader accepts would only exercise rejections.
    #[test]
    fn every_seed_is_a_mesh_or_a_scene() {
        let others = ["blocks", "scene", "write", "repair", "state"];
        let loaders = loaders();
        assert_eq!(loaders.len(), 9);
        let readers = loaders.iter().map(|loader| loader.name);
        for target in readers.chain(others) {
            let seeds = seeds(target);
            assert!(!seeds.is_empty(), "{target}");
            for seed in seeds {
                let text = String::from_utf8_lossy(&seed);
                assert_eq!(
                    check_target(target, &seed),
                    Ok(LoadOutcome::Accepted),
                    "{target}: {text}"
                );
            }
        }
        assert!(seeds("nothing").is_empty());
        assert!(check_target("nothing", b"").is_err());
    }
}
