use super::*;
use crate::io::pvd::{Collection, Entry};
use crate::io::vtp::{PolyData, write};
use crate::mesh::shapes::icosphere;
use std::time::Instant;

#[test]
fn measured_now() {
    let folder = std::env::temp_dir().join("spr/measured");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(folder.join("frames")).unwrap();
    let mesh = icosphere(0.1, 5);
    let n = mesh.vertices.len();
    let files = 60;
    for k in 0..files {
        let points: Vec<_> = mesh.vertices.iter().map(|p| p * (1.0 + 0.001 * f64::from(k))).collect();
        let data = PolyData {
            points: &points,
            triangles: &mesh.triangles,
            lines: &[],
            point_data: vec![
                ("displacement_m", vec![0.1; 3 * n]),
                ("edge_stretch", vec![0.1; n]),
                ("speed_m_s", vec![0.1; n]),
                ("attached", vec![0.0; n]),
            ],
        };
        write(&folder.join(format!("frames/m_{k:04}.vtp")), &data).unwrap();
        write(&folder.join(format!("frames/bone_b_{k:04}.vtp")), &PolyData { point_data: vec![], ..data }).unwrap();
    }
    let mut c = Collection::new();
    for frame in 0..10_000 {
        let time = frame as f64 / 25.0;
        for m in 0..11 {
            c.push(Entry { time, part: m, name: format!("part{m}"), file: format!("frames/part{m}_{frame:04}.vtp") });
        }
    }
    c.write(&folder.join("long.pvd")).unwrap();
    let t = Instant::now();
    let c2 = pvd::read(&folder.join("long.pvd")).unwrap();
    let read = t.elapsed();
    let timeline = Timeline::of(&c2);
    println!(
        "10,000 frames of 11 parts: read {read:?}, with the timeline {:?}, {} moments",
        t.elapsed(),
        timeline.moments.len()
    );
    fs::remove_file(folder.join("long.pvd")).unwrap();
    let mut c = Collection::new();
    for frame in 0..files {
        c.push(Entry {
            time: f64::from(frame) / 25.0,
            part: 0,
            name: "m".into(),
            file: format!("frames/m_{frame:04}.vtp"),
        });
    }
    c.write(&folder.join("a.pvd")).unwrap();
    let t = Instant::now();
    let mut replay = Replay::open(&folder).unwrap();
    println!("open: {:?} ({n} vertices)", t.elapsed());
    for round in ["read", "kept"] {
        let t = Instant::now();
        for k in 1..files as usize {
            replay.seek(k).unwrap();
        }
        println!("{round}: {:?} a frame", t.elapsed() / (files as u32 - 1));
        replay.seek(0).unwrap();
    }
    let t = Instant::now();
    for _ in 0..50 {
        drop(replay.shot());
    }
    println!("shot {:?}", t.elapsed() / 50);
    let mut c = Collection::new();
    for frame in 0..files {
        c.push(Entry {
            time: f64::from(frame) / 25.0,
            part: 0,
            name: "bone_b".into(),
            file: format!("frames/bone_b_{frame:04}.vtp"),
        });
    }
    c.write(&folder.join("a.pvd")).unwrap();
    let mut replay = Replay::open(&folder).unwrap();
    let t = Instant::now();
    for k in 1..files as usize {
        replay.seek(k).unwrap();
    }
    println!("scaled bone (a body): {:?} a frame", t.elapsed() / (files as u32 - 1));
    let _ = fs::remove_dir_all(&folder);
}
