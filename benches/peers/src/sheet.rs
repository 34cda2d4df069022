//! A hanging sheet for comparison with programs outside of Rust: `benches/peers/pbd.py` talks to this one.
//!
//! The argument is a folder: the sheet is written there (`sheet.txt`). Then each line of the standard
//! input is `substeps sweeps frames`. The sheet starts at rest and falls for that number of frames, on
//! one thread. The answer is the time [s]. The positions are in `pliant.bin` (f64, x y z of each vertex).

use std::io::{BufRead, Write};
use std::path::Path;
use std::time::Instant;

use nalgebra::{Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{Batch, SweepOrder};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::{StepSettings, System, stiffness};

/// Time of a frame [s].
const FRAME: f64 = 0.01;
/// Inverse mass of a particle [1/kg].
const INVERSE_MASS: f64 = 1e3;
/// Stiffness of an edge [N/m].
const STIFFNESS: f64 = 500.0;

/// A square of `side` by `side` vertices and 1 m in the plane x, y.
fn sheet(side: u32) -> TriangleMesh {
    let place = |k: u32| f64::from(k) / f64::from(side - 1);
    let vertices = (0..side * side).map(|v| Point3::new(place(v % side), -place(v / side), 0.0)).collect();
    let corner = |x: u32, y: u32| y * side + x;
    let cells = (0..side - 1).flat_map(|y| (0..side - 1).map(move |x| (x, y)));
    let triangles = cells.flat_map(|(x, y)| {
        let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
        // Alternate diagonals: the sheet has no direction of its own.
        if (x + y) % 2 == 0 { [[a, d, c], [a, c, b]] } else { [[a, d, b], [b, d, c]] }
    });
    TriangleMesh { vertices, triangles: triangles.collect() }
}

fn system(mesh: &TriangleMesh, sweeps: u32) -> System {
    let inverse_mass = mesh.vertices.iter().map(|p| if p.y > -1e-9 { 0.0 } else { INVERSE_MASS }).collect();
    let settings = StepSettings {
        iterations: sweeps,
        gravity: Vector3::new(0.0, -9.81, 0.0),
        velocity_factor: 1.0,
        force_factor: 1.0,
        speed_limit: f64::INFINITY,
    };
    let mut system = System::new(Particles::at_rest(mesh.vertices.clone(), inverse_mass), settings);
    let (edges, _) = stiffness::edges(mesh, &Topology::new(mesh), 1.0);
    let compliance = vec![1.0 / STIFFNESS; edges.len()];
    let springs = Batch::new(edges, compliance, SweepOrder::Coloured, mesh.vertices.len(), &[]);
    system.elastic.push(Box::new(springs));
    system
}

/// The sheet as text: a line of three numbers for each vertex, then one for each triangle.
fn write(mesh: &TriangleMesh, path: &Path) -> std::io::Result<()> {
    let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
    let mut text = format!("{vertices} {triangles} {FRAME} {INVERSE_MASS} {STIFFNESS}\n");
    mesh.vertices.iter().for_each(|p| text += &format!("{} {} {}\n", p.x, p.y, p.z));
    mesh.triangles.iter().for_each(|t| text += &format!("{} {} {}\n", t[0], t[1], t[2]));
    std::fs::write(path, text)
}

fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (Some(folder), side) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: sheet FOLDER [VERTICES-OF-A-SIDE]");
        std::process::exit(2);
    };
    let mesh = sheet(side.and_then(|side| side.parse().ok()).unwrap_or(100));
    let folder = Path::new(&folder);
    write(&mesh, &folder.join("sheet.txt"))?;
    println!("ready");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let words: Vec<u32> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let &[substeps, sweeps, frames] = &words[..] else { break };
        let mut system = system(&mesh, sweeps);
        let begin = Instant::now();
        pool.install(|| {
            for _ in 0..frames * substeps {
                system.step(&[], FRAME / f64::from(substeps)).expect("finite");
            }
        });
        let seconds = begin.elapsed().as_secs_f64();
        let bytes = |p: &Point3<f64>| [p.x, p.y, p.z].map(f64::to_le_bytes).concat();
        let all: Vec<u8> = system.particles.position.iter().flat_map(bytes).collect();
        std::fs::write(folder.join("pliant.bin"), all)?;
        println!("{seconds}");
        std::io::stdout().flush()?;
    }
    Ok(())
}
