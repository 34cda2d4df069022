//! A map to the sphere, an intermediate shape and a registration.
//!
//! The bent belly always runs. Real muscles run only with the measured data.

mod measured;

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Point3, Similarity3, Vector3};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::tube;
use pliant::morph::blend::Path as Way;
use pliant::morph::flipped;
use pliant::morph::register::{self, FitMotion, RegistrationSurface, register_surfaces};
use pliant::morph::{Correspondence, CorrespondenceSettings, Distortion};
use pliant::testing::internals::morph::SphereMap;
use pliant::testing::internals::morph::sphere::check;

/// A belly 0.3 m long and up to 60 mm wide, flat, bent by half a radian, with `around` vertices around it.
fn belly(around: u32) -> TriangleMesh {
    let mut mesh = tube(0.03, 0.3, around);
    let radius = 0.6;
    for p in &mut mesh.vertices {
        let width = 0.35 + 0.65 * libm::cos(std::f64::consts::PI * p.x / 0.3);
        // Thicker towards one end and on one side, so that the shape has no symmetry.
        let (y, z) = (
            p.y * width * (1.0 + 1.5 * p.x),
            0.6 * p.z * width * (1.0 + 8.0 * p.y),
        );
        let angle = p.x / radius;
        *p = Point3::new(
            (radius + y) * libm::sin(angle),
            (radius + y) * libm::cos(angle) - radius,
            z,
        );
    }
    mesh
}

/// Number of vertices around the belly that gives 7,500 in total.
const AROUND: u32 = 68;

/// A row of the table of `docs/benchmarks.md`: the least time of three, and the distortion of
/// triangles by the map.
fn row(name: &str, mesh: &TriangleMesh) {
    let mut least = f64::INFINITY;
    let mut made = None;
    for _ in 0..3 {
        let begin = Instant::now();
        made = Some(SphereMap::robust(black_box(mesh)).unwrap_or_else(|e| panic!("{name}: {e}")));
        least = least.min(begin.elapsed().as_secs_f64());
    }
    let Some(map) = made else { return };
    let bad = flipped(map.points(), map.triangles()).len();
    let d = Distortion::of(&mesh.vertices, map.points(), &mesh.triangles);
    println!(
        "ROW morph | {name} | {} | {:.0} | {bad} | {:.1} | {:.0} | {:.1} | {:.0} |",
        mesh.vertices.len(),
        1e3 * least,
        d.conformal_median,
        d.conformal_max,
        d.area_median,
        d.area_max
    );
    assert_eq!(bad, 0, "{name}");
}

fn folder() -> Option<PathBuf> {
    let root = std::env::var_os("PLIANT_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    Some(root.join("body")).filter(|body| body.is_dir())
}

/// All muscles and bones that are spheres. Returns their number and the number of other
/// surfaces.
fn bodies() -> [usize; 2] {
    let mut found = [0, 0];
    let Some(body) = folder() else {
        println!("skipped: all real bodies, because there is no measured data");
        return found;
    };
    for part in ["muscles", "muscles-fine", "bones"] {
        let entries = std::fs::read_dir(body.join(part))
            .into_iter()
            .flatten()
            .filter_map(|e| Some(e.ok()?.path()));
        let mut files: Vec<PathBuf> = entries
            .filter(|p| p.extension().is_some_and(|e| e == "obj"))
            .collect();
        files.sort();
        for file in files {
            let name = format!(
                "{part}/{}",
                file.file_stem().unwrap_or_default().to_string_lossy()
            );
            let mesh = pliant::io::read(&file)
                .unwrap_or_else(|e| panic!("{name}: {e}"))
                .mesh;
            if let Err(why) = check(&mesh) {
                println!("skipped: {name}: {why}");
                found[1] += 1;
                continue;
            }
            row(&name, &mesh);
            found[0] += 1;
        }
    }
    found
}

fn maps(c: &mut Criterion) {
    let body = belly(AROUND);
    assert!(
        (7_200..7_800).contains(&body.vertices.len()),
        "{} vertices",
        body.vertices.len()
    );
    let map = SphereMap::robust(&body).expect("a map");
    assert!(
        flipped(map.points(), map.triangles()).is_empty(),
        "no triangle is turned over"
    );
    let mut group = c.benchmark_group("morph");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2));
    group.bench_function("map of 7500 vertices", |b| {
        b.iter(|| SphereMap::robust(black_box(&body)).expect("a map"))
    });

    let mut other = belly(24);
    other.vertices.iter_mut().for_each(|p| p.y *= 1.3);
    let both = Correspondence::new(
        [&body, &other],
        &[],
        &CorrespondenceSettings::default(),
        &pliant::progress::Silent,
    )
    .expect("two spheres");
    let ends = [both.places[0].as_slice(), &both.places[1]];
    let mut way = Way::Linear;
    for (t, end) in [(0.0, ends[0]), (1.0, ends[1])] {
        let shape = way.at(ends, t).expect("a shape");
        let off = shape
            .iter()
            .zip(end)
            .map(|(p, q)| (p - q).norm())
            .fold(0.0, f64::max);
        assert!(off <= 1e-12 * body.length(), "an end is missed by {off} m");
    }
    group.bench_function("a shape of all vertices", |b| {
        b.iter(|| way.at(ends, black_box(0.4)).expect("a shape"))
    });
    group.finish();
    measured::result("morph.common", both.kinds.len() as f64, "1");
    measured::result("morph.vertices", body.vertices.len() as f64, "1");
    row("belly", &body);
    if !measured::quick() {
        let [mapped, skipped] = bodies();
        measured::result("morph.bodies", mapped as f64, "1");
        measured::result("morph.skipped", skipped as f64, "1");
    }
}

fn registration(c: &mut Criterion) {
    let (fixed, mut moving) = (belly(40), belly(24));
    let known = Similarity3::new(
        Vector3::new(0.2, -0.1, 0.3),
        Vector3::new(0.4, 1.1, -0.7),
        1.25,
    );
    moving
        .vertices
        .iter_mut()
        .for_each(|p| *p = known.inverse() * *p);
    let [from, to] = [&moving, &fixed].map(|m| RegistrationSurface::new(m).expect("a surface"));
    let how = register::RegistrationSettings {
        motion: FitMotion::Similarity,
        ..register::RegistrationSettings::default()
    };
    let laid = register_surfaces(&from, &to, &how, &pliant::progress::Silent).expect("a motion");
    let off = laid
        .points
        .iter()
        .zip(&moving.vertices)
        .map(|(p, q)| (p - known * q).norm())
        .fold(0.0, f64::max);
    // The issue requires this for partial surfaces. Here the surface is complete.
    assert!(off <= 1e-3 * fixed.length(), "{off} m from where it was");
    measured::result("morph.registered", off / fixed.length(), "1");
    let mut group = c.benchmark_group("morph");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2));
    group.bench_function("registration", |b| {
        b.iter(|| register_surfaces(&from, &to, &how, &pliant::progress::Silent).expect("a motion"))
    });
    group.finish();
}

criterion_group!(benches, maps, registration);
criterion_main!(benches);
