//! Generated mesh files for benches: one torus in every format and encoding.

use std::fmt::Write;

/// A file with its expected content.
pub struct File {
    pub name: &'static str,
    pub bytes: Vec<u8>,
    /// Expected number of vertices.
    pub vertices: usize,
    /// Expected number of triangles.
    pub triangles: usize,
}

/// A torus of `2 n n` triangles; coordinates are singles, as in most files.
pub struct Torus {
    pub points: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

impl Torus {
    pub fn new(n: usize) -> Self {
        let angle = |i: usize| std::f64::consts::TAU * i as f64 / n as f64;
        let point = |i: usize| {
            let (u, v) = (angle(i / n), angle(i % n));
            let across = 1.0 + 0.3 * v.cos();
            [across * u.cos(), across * u.sin(), 0.3 * v.sin()].map(|c| c as f32)
        };
        let at = |i: usize, j: usize| (i % n * n + j % n) as u32;
        let quad = |k: usize| {
            let (i, j) = (k / n, k % n);
            [
                [at(i, j), at(i + 1, j), at(i + 1, j + 1)],
                [at(i, j), at(i + 1, j + 1), at(i, j + 1)],
            ]
        };
        Self {
            points: (0..n * n).map(point).collect(),
            triangles: (0..n * n).flat_map(quad).collect(),
        }
    }

    fn file(&self, name: &'static str, bytes: Vec<u8>) -> File {
        File {
            name,
            bytes,
            vertices: self.points.len(),
            triangles: self.triangles.len(),
        }
    }

    /// The points, one per line, each after the text `begin`.
    fn points_text(&self, begin: &str) -> String {
        let mut text = String::new();
        for [x, y, z] in &self.points {
            writeln!(text, "{begin}{x} {y} {z}").expect("memory");
        }
        text
    }

    /// The triangles, one per line, each after the text `begin`, with indices from `first`.
    fn triangles_text(&self, begin: &str, first: u32) -> String {
        let mut text = String::new();
        for [a, b, c] in self.triangles.iter().map(|t| t.map(|i| i + first)) {
            writeln!(text, "{begin}{a} {b} {c}").expect("memory");
        }
        text
    }

    fn numbers<const N: usize>(
        &self,
        point: fn(f32) -> [u8; 4],
        index: fn(u32) -> [u8; 4],
        count: [u8; N],
    ) -> Vec<u8> {
        let mut bytes: Vec<u8> = self
            .points
            .iter()
            .flatten()
            .flat_map(|&c| point(c))
            .collect();
        for triangle in &self.triangles {
            bytes.extend(count);
            bytes.extend(triangle.iter().flat_map(|&i| index(i)));
        }
        bytes
    }

    pub fn obj(&self) -> File {
        self.file(
            "OBJ",
            (self.points_text("v ") + &self.triangles_text("f ", 1)).into_bytes(),
        )
    }

    /// As written by most programs: texture coordinates, normals, and both at each corner.
    pub fn obj_with_normals(&self) -> File {
        let mut text = self.points_text("v ");
        text += &"vt 0.25 0.75\n".repeat(self.points.len());
        text += &self.points_text("vn ");
        for [a, b, c] in self.triangles.iter().map(|t| t.map(|i| i + 1)) {
            writeln!(text, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}").expect("memory");
        }
        self.file("OBJ with normals", text.into_bytes())
    }

    /// Doubles with all their digits.
    pub fn obj_with_all_digits(&self) -> File {
        let mut text = String::new();
        for p in &self.points {
            let [x, y, z] = p.map(|c| f64::from(c) / 3.0);
            writeln!(text, "v {x} {y} {z}").expect("memory");
        }
        self.file(
            "OBJ, 17 digits",
            (text + &self.triangles_text("f ", 1)).into_bytes(),
        )
    }

    fn ply_head(&self, encoding: &str) -> String {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            self.points.len(),
            self.triangles.len()
        )
    }

    pub fn ply_text(&self) -> File {
        let text = self.ply_head("ascii") + &self.points_text("") + &self.triangles_text("3 ", 0);
        self.file("PLY text", text.into_bytes())
    }

    pub fn ply_little(&self) -> File {
        let body = self.numbers(f32::to_le_bytes, u32::to_le_bytes, [3]);
        self.file(
            "PLY little-endian",
            [self.ply_head("binary_little_endian").into_bytes(), body].concat(),
        )
    }

    pub fn ply_big(&self) -> File {
        let body = self.numbers(f32::to_be_bytes, u32::to_be_bytes, [3]);
        self.file(
            "PLY big-endian",
            [self.ply_head("binary_big_endian").into_bytes(), body].concat(),
        )
    }

    pub fn stl_text(&self) -> File {
        let mut text = String::from("solid torus\n");
        for triangle in &self.triangles {
            text += "facet normal 0 0 1\n outer loop\n";
            for [x, y, z] in triangle.map(|i| self.points[i as usize]) {
                writeln!(text, "  vertex {x} {y} {z}").expect("memory");
            }
            text += " endloop\nendfacet\n";
        }
        self.file("STL text", (text + "endsolid torus\n").into_bytes())
    }

    pub fn stl_binary(&self) -> File {
        let mut bytes = vec![b' '; 80];
        bytes.extend((self.triangles.len() as u32).to_le_bytes());
        for triangle in &self.triangles {
            bytes.extend([0; 12]);
            bytes.extend(
                triangle
                    .iter()
                    .flat_map(|&i| self.points[i as usize])
                    .flat_map(f32::to_le_bytes),
            );
            bytes.extend([0; 2]);
        }
        self.file("STL binary", bytes)
    }

    pub fn off(&self) -> File {
        let text = format!("OFF\n{} {} 0\n", self.points.len(), self.triangles.len());
        self.file(
            "OFF",
            (text + &self.points_text("") + &self.triangles_text("3 ", 0)).into_bytes(),
        )
    }

    fn vtk_head(&self, encoding: &str) -> String {
        format!(
            "# vtk DataFile Version 4.2\nt\n{encoding}\nDATASET POLYDATA\nPOINTS {} float\n",
            self.points.len()
        )
    }

    pub fn vtk_text(&self) -> File {
        let count = self.triangles.len();
        let text = self.vtk_head("ASCII")
            + &self.points_text("")
            + &format!("POLYGONS {count} {}\n", 4 * count);
        self.file(
            "VTK text",
            (text + &self.triangles_text("3 ", 0)).into_bytes(),
        )
    }

    pub fn vtk_binary(&self) -> File {
        let body = self.numbers(f32::to_be_bytes, u32::to_be_bytes, [0, 0, 0, 3]);
        let (points, cells) = body.split_at(12 * self.points.len());
        let head = format!(
            "\nPOLYGONS {} {}\n",
            self.triangles.len(),
            4 * self.triangles.len()
        );
        self.file(
            "VTK binary",
            [
                self.vtk_head("BINARY").as_bytes(),
                points,
                head.as_bytes(),
                cells,
            ]
            .concat(),
        )
    }

    pub fn directx(&self) -> File {
        let mut text = format!("xof 0302txt 0064\nMesh {{\n{};\n", self.points.len());
        for [x, y, z] in &self.points {
            writeln!(text, "{x};{y};{z};,").expect("memory");
        }
        writeln!(text, ";\n{};", self.triangles.len()).expect("memory");
        for [a, b, c] in &self.triangles {
            writeln!(text, "3;{a},{b},{c};,").expect("memory");
        }
        self.file("DirectX text", (text + ";}\n").into_bytes())
    }
}

/// Encoding of the arrays of a VTP file.
#[derive(Clone, Copy, PartialEq)]
pub enum Arrays {
    Text,
    Base64,
    Raw,
    Zlib,
    Lz4,
}

impl Torus {
    pub fn vtp(&self, how: Arrays) -> File {
        let compressor = match how {
            Arrays::Zlib => "vtkZLibDataCompressor",
            Arrays::Lz4 => "vtkLZ4DataCompressor",
            _ => "",
        };
        let points: Vec<u8> = self
            .points
            .iter()
            .flatten()
            .flat_map(|c| c.to_le_bytes())
            .collect();
        let corners: Vec<u8> = self
            .triangles
            .iter()
            .flatten()
            .flat_map(|&i| i64::from(i).to_le_bytes())
            .collect();
        let ends: Vec<u8> = (1..=self.triangles.len())
            .flat_map(|i| (3 * i as i64).to_le_bytes())
            .collect();
        let texts = [
            self.points_text(""),
            self.triangles_text("", 0),
            (1..=self.triangles.len()).fold(String::new(), |t, i| t + &format!("{} ", 3 * i)),
        ];
        let mut data = Vec::new();
        let mut array = |i: usize, bytes: &[u8], attributes: &str| match how {
            Arrays::Text => format!(
                "<DataArray {attributes} format=\"ascii\">\n{}</DataArray>\n",
                texts[i]
            ),
            Arrays::Base64 => {
                format!(
                    "<DataArray {attributes} format=\"binary\">{}</DataArray>\n",
                    base64(&stored(bytes))
                )
            }
            _ => {
                let tag = format!(
                    "<DataArray {attributes} format=\"appended\" offset=\"{}\"/>\n",
                    data.len()
                );
                data.extend(if how == Arrays::Raw {
                    stored(bytes)
                } else {
                    blocks(bytes, how)
                });
                tag
            }
        };
        let tags = [
            array(0, &points, "type=\"Float32\" NumberOfComponents=\"3\""),
            array(1, &corners, "type=\"Int64\" Name=\"connectivity\""),
            array(2, &ends, "type=\"Int64\" Name=\"offsets\""),
        ];
        let (name, tail) = match how {
            Arrays::Text => ("VTP text", ""),
            Arrays::Base64 => ("VTP base64", ""),
            Arrays::Raw => ("VTP raw", "<AppendedData encoding=\"raw\">_"),
            Arrays::Zlib => ("VTP zlib", "<AppendedData encoding=\"raw\">_"),
            Arrays::Lz4 => ("VTP lz4", "<AppendedData encoding=\"raw\">_"),
        };
        let head = format!(
            "<VTKFile type=\"PolyData\" byte_order=\"LittleEndian\" header_type=\"UInt32\" compressor=\"{compressor}\"><PolyData>\
             <Piece NumberOfPoints=\"{}\" NumberOfPolys=\"{}\"><Points>\n{}</Points>\n<Polys>\n{}{}</Polys></Piece></PolyData>{tail}",
            self.points.len(),
            self.triangles.len(),
            tags[0],
            tags[1],
            tags[2]
        );
        let end = if tail.is_empty() {
            "</VTKFile>"
        } else {
            "</AppendedData></VTKFile>"
        };
        self.file(name, [head.as_bytes(), &data, end.as_bytes()].concat())
    }

    /// The torus in every format and encoding.
    pub fn files(&self) -> Vec<File> {
        let mut all = vec![
            self.obj(),
            self.obj_with_normals(),
            self.obj_with_all_digits(),
        ];
        all.extend([
            self.ply_text(),
            self.ply_little(),
            self.ply_big(),
            self.stl_text(),
            self.stl_binary(),
            self.off(),
        ]);
        all.extend([self.vtk_text(), self.vtk_binary(), self.directx()]);
        all.extend(
            [
                Arrays::Text,
                Arrays::Base64,
                Arrays::Raw,
                Arrays::Zlib,
                Arrays::Lz4,
            ]
            .map(|how| self.vtp(how)),
        );
        all
    }
}

/// An array after the number of its bytes.
fn stored(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

/// Compressed blocks of 32 KiB, as written by VTK, after their sizes.
fn blocks(bytes: &[u8], how: Arrays) -> Vec<u8> {
    const SIZE: usize = 32768;
    let pack = |block: &[u8]| match how {
        Arrays::Zlib => miniz_oxide::deflate::compress_to_vec_zlib(block, 6),
        _ => lz4_flex::compress(block),
    };
    let packed: Vec<Vec<u8>> = bytes.chunks(SIZE).map(pack).collect();
    let words = [packed.len(), SIZE, bytes.len() % SIZE]
        .into_iter()
        .chain(packed.iter().map(Vec::len));
    let mut whole: Vec<u8> = words.flat_map(|n| (n as u32).to_le_bytes()).collect();
    packed.iter().for_each(|block| whole.extend(block));
    whole
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let word = group
            .iter()
            .chain(&[0, 0])
            .take(3)
            .fold(0u32, |word, &b| word << 8 | u32::from(b));
        let letter = |k: usize| char::from(LETTERS[(word >> (18 - 6 * k)) as usize & 63]);
        text.extend((0..4).map(|k| if k <= group.len() { letter(k) } else { '=' }));
    }
    text
}
