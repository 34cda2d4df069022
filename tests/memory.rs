//! Memory of the readers: at most 64 bytes per byte of the file plus 1 MiB, for any declaration in
//! the file.
//!
//! A separate binary with a single test, because the allocator counts all threads.

use peak_alloc::PeakAlloc;
use pliant::io::{read_bytes, read_bytes_within};
use pliant::testing::block_file;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Reads a file and checks its use of memory. Returns true for a mesh.
fn check(bytes: &[u8], name: &str) -> bool {
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let is_mesh = read_bytes(bytes, name).is_ok();
    let used = ALLOCATOR.peak_usage().saturating_sub(before);
    let allowed = 64 * bytes.len() + (1 << 20);
    if bytes.len() > 500_000 {
        println!(
            "{name}: {:.1} bytes a byte",
            used as f64 / bytes.len() as f64
        );
    }
    assert!(
        used <= allowed,
        "{name}: {used} bytes were used for a file of {}",
        bytes.len()
    );
    is_mesh
}

/// Files whose meshes need as much memory per byte as their format allows.
fn dense() -> Vec<(&'static str, Vec<u8>)> {
    let count = 1 << 20;
    let mut ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty char x\nproperty char y\n\
        property char z\nelement face 10\nproperty list uint uchar vertex_index\nend_header\n"
        .to_vec();
    ply.extend([0, 0, 0, 1, 0, 0, 0, 1, 0]);
    // Polygons with the greatest number of corners.
    for _ in 0..10 {
        ply.extend(100_000u32.to_le_bytes());
        ply.extend((0..100_000).map(|i| (i % 3) as u8));
    }
    let mut edges = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty char x\nproperty char y\n\
        property char z\nelement edge 500000\nproperty uchar vertex1\nproperty uchar vertex2\nend_header\n"
        .to_vec();
    edges.extend([0, 0, 0, 1, 0, 0, 0, 1, 0]);
    edges.extend((0..500_000).flat_map(|_| [0, 1]));
    let points = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let vtk = "# vtk DataFile Version 5.1\nt\nBINARY\nDATASET POLYDATA\nPOINTS 3 char\n";
    let mut strip = vtk.as_bytes().to_vec();
    strip.extend([0, 0, 0, 1, 0, 0, 0, 1, 0]);
    strip.extend(format!("\nTRIANGLE_STRIPS 2 {count}\nOFFSETS int\n").bytes());
    strip.extend([0, count as i32].iter().flat_map(|i| i.to_be_bytes()));
    strip.extend(b"\nCONNECTIVITY unsigned_char\n");
    strip.extend((0..count).map(|i| (i % 3) as u8));
    let pieces = format!(
        "<VTKFile type='PolyData'><PolyData>{}</PolyData></VTKFile>",
        "<Piece>".repeat(100_000)
    );
    vec![
        ("list.ply", ply),
        ("edges.ply", edges),
        ("strip.vtk", strip),
        (
            "polygon.obj",
            format!(
                "{points}{}",
                format!("f {}\n", "1 2 3 ".repeat(33_333)).repeat(6)
            )
            .into_bytes(),
        ),
        (
            "lines.obj",
            format!("{points}{}", "l 1 2\n".repeat(count / 6)).into_bytes(),
        ),
        (
            "forward.obj",
            format!(
                "f {}\n{points}",
                (4..99_999).map(|i| format!("{i} ")).collect::<String>()
            )
            .into_bytes(),
        ),
        (
            "points.off",
            format!("OFF\n{0} 0 0\n{1}", count / 6, "0 0 0\n".repeat(count / 6)).into_bytes(),
        ),
        (
            "facets.stl",
            format!(
                "solid\n{}endsolid\n",
                "outer loop\nvertex 0 0 0\nvertex 0 0 1\nvertex 0 1 0\nendloop\n".repeat(9999)
            )
            .into_bytes(),
        ),
        ("pieces.vtp", pieces.into_bytes()),
    ]
}

/// Headers that declare missing content.
const LIARS: [(&str, &str); 7] = [
    (
        "a.ply",
        "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n",
    ),
    (
        "b.ply",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uint int vertex_index\nend_header\n0 0 0\n4000000000 1 2\n",
    ),
    (
        "a.vtk",
        "# vtk DataFile Version 3.0\nt\nBINARY\nDATASET POLYDATA\nPOINTS 4000000000 double\n",
    ),
    (
        "b.vtk",
        "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 1 float\n0 0 0\nCELLS 4000000000 4\n3 0 0 0\n",
    ),
    ("a.off", "OFF\n4000000000 4000000000 0\n"),
    ("b.off", "OFF\n1 1 0\n0 0 0\n4000000000 0 0\n"),
    ("a.x", "xof 0302txt 0064 Mesh { 4000000000; 0;0;0;, "),
];

/// `hello pliant` 20 times, in an LZMA stream whose header requests a dictionary of 4 GiB.
const LARGE_DICTIONARY: &[u8] = b"\xfd\x37\x7a\x58\x5a\x00\x00\x01\x69\x22\xde\x36\x02\x00\x21\x01\x28\x00\x00\x00\xe6\xa0\x11\xb3\xe0\x00\xef\x00\x13\x5d\x00\x34\x19\x49\xee\x8d\xe9\x15\x9f\xb1\x1a\xf5\x63\x23\x6b\xd5\x55\x28\x00\x00\x00\x00\x92\xdf\x64\xe2\x00\x01\x2b\xf0\x01\x00\x00\x00\x10\x16\xb6\x5e\x3e\x30\x0d\x8b\x02\x00\x00\x00\x00\x01\x59\x5a";

/// A VTP file with these 240 bytes as its points.
fn large_dictionary() -> Vec<u8> {
    let mut bytes =
        b"<VTKFile type='PolyData' compressor='vtkLZMADataCompressor'><PolyData><Piece NumberOfPoints='80'>\
        <Points><DataArray type='UInt8' format='appended' offset='0'/></Points></Piece></PolyData>\
        <AppendedData encoding='raw'>_"
            .to_vec();
    let header = [1, 240, 0, LARGE_DICTIONARY.len() as u32];
    bytes.extend(header.iter().flat_map(|word| word.to_le_bytes()));
    bytes.extend(LARGE_DICTIONARY);
    bytes
}

/// 65,536 zeros by liblzma, as an independent chunk of LZMA2.
const ZEROS: &[u8] = b"\xe0\xff\xff\x00\x4c\x5d\x00\x00\x6f\xfd\xff\xff\xa3\xb7\xff\x47\x3e\x48\x15\x72\x39\x61\x51\xb8\x92\x28\xe6\xa3\x86\x07\xf9\xee\xe4\x1e\x82\xd3\x2f\xc5\x3a\x3c\x01\x4b\xb1\x7e\xc9\x8a\x8a\x4d\x2f\xa3\x0d\xd9\x7f\xa6\xe3\x8c\x23\x11\x53\xe0\x59\x18\xc5\x75\x8a\xe2\x77\xf8\xb6\x94\x7f\x0c\x6a\xc0\xde\x74\x49\x64\x5c\x9e\x3a\xd1\x00";

/// Files of few bytes with a large output, declared or not; memory may be proportional to the
/// output.
fn check_bombs() {
    const COUNT: usize = 96 * 65_536;
    let zeros = vec![0; COUNT];
    let packed = [
        miniz_oxide::deflate::compress_to_vec_zlib(&zeros, 6),
        lz4_flex::compress(&zeros),
        [&ZEROS.repeat(COUNT / 65_536), &[0][..]].concat(),
    ];
    drop(zeros);
    let used = |bytes: &[u8], limit: usize| {
        let before = ALLOCATOR.current_usage();
        ALLOCATOR.reset_peak_usage();
        let code = read_bytes_within(bytes, "a.vtp", limit as u64)
            .err()
            .map(|error| error.code());
        (code, ALLOCATOR.peak_usage().saturating_sub(before))
    };
    let mut noise = 1u32;
    let garbage: Vec<u8> = std::iter::repeat_with(|| {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (noise >> 24) as u8
    })
    .take(1 << 16)
    .collect();
    for (choice, packed) in (0u8..).zip(&packed) {
        let file = block_file(choice, COUNT as u64, packed);
        assert!(
            200 * file.len() < COUNT,
            "control: {} bytes are no bomb",
            file.len()
        );
        let (code, most) = used(&file, COUNT);
        assert!(
            code.is_none() && most <= 64 * COUNT + (1 << 20),
            "{choice}: {code:?}, {most} bytes"
        );
        let (code, most) = used(&file, COUNT - 1);
        assert!(
            code == Some("E044") && most <= 64 * file.len() + (1 << 20),
            "{choice}: {code:?}, {most} bytes"
        );
        // The output exceeds the declaration: reading ends there.
        let (code, most) = used(&block_file(choice, 3 << 14, packed), COUNT);
        assert!(
            code == Some("E042") && most <= 64 * (3 << 14) + (1 << 20),
            "{choice}: {code:?}, {most} bytes"
        );
        // The declaration is as large as the format permits, without any output.
        let file = block_file(choice, 255 * garbage.len() as u64, &garbage);
        let (code, most) = used(&file, usize::MAX);
        assert!(
            code == Some("E042") && most <= 64 * file.len() + (1 << 20),
            "{choice}: {code:?}, {most} bytes"
        );
    }
}

#[test]
fn memory_is_bounded_by_the_size_of_the_file() {
    ALLOCATOR.reset_peak_usage();
    let before = ALLOCATOR.current_usage();
    drop(std::hint::black_box(Vec::<u8>::with_capacity(2 << 20)));
    assert!(
        ALLOCATOR.peak_usage() >= before + (2 << 20),
        "control: the allocator does not count"
    );
    let mut meshes = 0;
    for (name, bytes) in dense() {
        meshes += usize::from(check(&bytes, name));
    }
    assert!(meshes >= 5, "only {meshes} dense files are meshes");
    for (name, text) in LIARS {
        assert!(!check(text.as_bytes(), name), "{name}");
        let mut changed = text.as_bytes().to_vec();
        for bit in 0..8 * changed.len() {
            changed[bit / 8] ^= 1 << (bit % 8);
            check(&changed, name);
            changed[bit / 8] ^= 1 << (bit % 8);
        }
    }
    check_bombs();
    let bytes = large_dictionary();
    check(&bytes, "dictionary.vtp");
    let text = read_bytes(&bytes, "a").unwrap_err().to_string();
    assert_eq!(
        text, "a: the file has 80 vertices, but no faces and no lines",
        "control: the stream is not read"
    );
    let root = std::env::var_os("PLIANT_DATA").unwrap_or_else(|| "../shared/data".into());
    let folder = std::path::Path::new(&root).join("vtk/one-mesh-many-encodings");
    match std::fs::read_dir(folder) {
        Err(_) => println!("skipped: 1 part of a test, because the measured data are absent"),
        Ok(entries) => {
            for path in entries.flatten().map(|e| e.path()) {
                let bytes = std::fs::read(&path).unwrap_or_default();
                assert!(check(&bytes, &path.to_string_lossy()), "{}", path.display());
            }
        }
    }
}
