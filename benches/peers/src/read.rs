//! Readers of pliant compared with tobj, ply-rs-bw and stl_io, on the same bytes in one process,
//! alternately, one thread.

#[path = "../../read/files.rs"]
// The peers read fewer formats than there are files.
#[allow(dead_code)]
mod files;

use std::hint::black_box;
use std::io::Cursor;
use std::time::Instant;

use files::{File, Torus};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::DefaultElement;

const ROUNDS: usize = 15;

/// Numbers of vertices and triangles.
type Counts = (usize, usize);

fn ours(bytes: &[u8]) -> Counts {
    let mesh = pliant::io::read_bytes(bytes, "").expect("a mesh").mesh;
    (mesh.vertices.len(), mesh.triangles.len())
}

fn by_tobj(bytes: &[u8]) -> Counts {
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let found = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, |_| tobj::load_mtl_buf(&mut Cursor::new(b"")));
    let models = found.expect("a mesh").0;
    let mesh = &models[0].mesh;
    (mesh.positions.len() / 3, mesh.indices.len() / 3)
}

fn by_ply(bytes: &[u8]) -> Counts {
    let file = Parser::<DefaultElement>::new().read_ply(&mut Cursor::new(bytes)).expect("a mesh");
    (file.payload["vertex"].len(), file.payload["face"].len())
}

fn by_stl(bytes: &[u8]) -> Counts {
    let mesh = stl_io::read_stl(&mut Cursor::new(bytes)).expect("a mesh");
    (mesh.vertices.len(), mesh.faces.len())
}

fn seconds(file: &File, read: fn(&[u8]) -> Counts, name: &str) -> f64 {
    let begin = Instant::now();
    let counts = read(black_box(&file.bytes));
    let time = begin.elapsed().as_secs_f64();
    assert_eq!(counts, (file.vertices, file.triangles), "{name} on {}", file.name);
    time
}

/// Writes the files that `read.py` gives to other programs, with our best times.
fn write(folder: &std::path::Path, torus: &Torus) -> std::io::Result<()> {
    let endings = [("OBJ", "obj"), ("PLY", "ply"), ("STL", "stl"), ("OFF", "off"), ("VTK", "vtk"), ("VTP", "vtp")];
    let mut times = String::from("file,bytes,seconds\n");
    for file in torus.files() {
        let Some((_, ending)) = endings.iter().find(|(start, _)| file.name.starts_with(start)) else { continue };
        let name = format!("{}.{ending}", file.name.replace([' ', ','], "-"));
        std::fs::write(folder.join(&name), &file.bytes)?;
        let path = folder.join(&name);
        let best = (0..7).map(|_| {
            let begin = Instant::now();
            let mesh = pliant::io::read(&path).expect("a mesh").mesh;
            let time = begin.elapsed().as_secs_f64();
            assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (file.vertices, file.triangles));
            time
        });
        times += &format!("{name},{},{}\n", file.bytes.len(), best.fold(f64::INFINITY, f64::min));
    }
    std::fs::write(folder.join("pliant.csv"), times)
}

fn main() -> std::io::Result<()> {
    if let Some(folder) = std::env::args().nth(1) {
        return write(std::path::Path::new(&folder), &Torus::new(316));
    }
    compare();
    Ok(())
}

/// A file, a peer, and its reader.
type Pair = (File, &'static str, fn(&[u8]) -> Counts);

fn compare() {
    let torus = Torus::new(316);
    let pairs: [Pair; 6] = [
        (torus.obj(), "tobj", by_tobj),
        (torus.obj_with_all_digits(), "tobj", by_tobj),
        (torus.ply_text(), "ply-rs-bw", by_ply),
        (torus.ply_little(), "ply-rs-bw", by_ply),
        (torus.stl_text(), "stl_io", by_stl),
        (torus.stl_binary(), "stl_io", by_stl),
    ];
    for (file, name, theirs) in pairs {
        let mut ratios = Vec::new();
        let mut best = f64::INFINITY;
        for round in 0..ROUNDS + 2 {
            let a = seconds(&file, ours, "pliant");
            let b = seconds(&file, theirs, name);
            if round >= 2 {
                ratios.push(b / a);
                best = best.min(a);
            }
        }
        ratios.sort_by(f64::total_cmp);
        let [low, median, high] = [1, 2, 3].map(|k| ratios[k * ROUNDS / 4]);
        let speed = file.bytes.len() as f64 / best / 1e6;
        println!("ROW peers.readers | {} | {name} | {median:.2} ({low:.2} to {high:.2}) | {speed:.0} |", file.name);
    }
}
