//! Three methods to decompose a muscle into fibres, and a change of length of the geometric muscle.
//!
//! A spindle is always measured; real muscles only with the measured data.

mod measured;

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Point3;
use pliant::fibres::quality::{Quality, measure};
use pliant::fibres::{AreaSource, Attachment, Template, harmonic};
use pliant::geometric::{Chain, ChainShape};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::tube;
use pliant::simulation::component;
use pliant::testing::internals::fibres::{Closed, slices, springs};
use pliant::testing::internals::geometric::Caps;

/// Muscles, their origins and insertions: a file of patches, with `#` a part of it, or a bone and a distance [m].
const MUSCLES: &[[&str; 3]] = &[
    [
        "muscles/Adductor_magnus.r",
        "adductor_magnus#1",
        "adductor_magnus#0",
    ],
    [
        "muscles/Gluteus_maximus_muscle.r",
        "gluteus_maximus#1",
        "gluteus_maximus#0",
    ],
    [
        "muscles-fine/gluteus_maximus",
        "gluteus_maximus#1",
        "gluteus_maximus#0",
    ],
    [
        "muscles/Gluteus_medius_muscle.r",
        "gluteus_medius#0",
        "gluteus_medius#1",
    ],
    [
        "muscles-fine/gluteus_medius",
        "gluteus_medius#0",
        "gluteus_medius#1",
    ],
    ["muscles/Iliacus_muscle.r", "iliacus", "Femur.r,0.005"],
    ["muscles-fine/iliacus", "iliacus", "Femur.r,0.005"],
    ["muscles/Pectineus_muscle.r", "pectineus#0", "pectineus#1"],
    [
        "muscles/Rectus_femoris.r",
        "rectus_femoris#0",
        "Patella.r,0.03",
    ],
    [
        "muscles-fine/rectus_femoris",
        "rectus_femoris#0",
        "Patella.r,0.005",
    ],
    [
        "muscles/Semimembranosus_muscle.r",
        "semimembranosus#0",
        "semimembranosus#1",
    ],
    [
        "muscles-fine/semimembranosus",
        "semimembranosus#0",
        "semimembranosus#1",
    ],
    [
        "muscles/Short_head_of_biceps_brachii.r",
        "short_head_of_biceps_brachii",
        "biceps_brachii",
    ],
    [
        "muscles/Vastus_lateralis_muscle.r",
        "vastus_lateralis",
        "Patella.r,0.04",
    ],
    [
        "muscles/Brachialis_muscle.r",
        "Humerus.r,0.002",
        "Ulna.r,0.005",
    ],
    [
        "muscles/Infraspinatus_muscle.r",
        "Scapula.r,0.001",
        "Humerus.r,0.001",
    ],
    [
        "muscles/Subscapularis_muscle.r",
        "Scapula.r,0.001",
        "Humerus.r,0.001",
    ],
    [
        "muscles/Medial_head_of_gastrocnemius.r",
        "Femur.r,0.01",
        "Fibula.r,0.035",
    ],
    ["muscles/Soleus_muscle.r", "Fibula.r,0.005", "Tibia.r,0.002"],
    ["muscles/Gracilis_muscle.r", "gracilis#1", "gracilis#0"],
    [
        "muscles/Long_head_of_biceps_femoris.r",
        "long_head_of_biceps_femoris",
        "Fibula.r,0.02",
    ],
    ["muscles-fine/psoas_major", "Sacrum,0.03", "Femur.r,0.01"],
    [
        "muscles/Long_head_of_biceps_brachii.r",
        "long_head_of_biceps_brachii",
        "biceps_brachii",
    ],
    ["muscles/Psoas_major.r", "Sacrum,0.03", "Femur.r,0.01"],
];

/// A spindle of about 1,000 vertices, 0.2 m long and up to 40 mm thick; the areas are its flat
/// ends.
fn spindle() -> (TriangleMesh, Attachment) {
    let mut mesh = tube(0.02, 0.2, 24);
    let at = |sign: f64, mesh: &TriangleMesh| -> Vec<u32> {
        let end = |v: &u32| sign * mesh.vertices[*v as usize].x >= 0.1 * (1.0 - 1e-9);
        (0..mesh.vertices.len() as u32).filter(end).collect()
    };
    let (low, high) = (at(-1.0, &mesh), at(1.0, &mesh));
    for p in &mut mesh.vertices {
        let width = 0.3 + 0.7 * libm::cos(std::f64::consts::PI * p.x / 0.2);
        *p = Point3::new(p.x, p.y * width, p.z * width);
    }
    assert!(
        (800..1200).contains(&mesh.vertices.len()),
        "{} vertices",
        mesh.vertices.len()
    );
    let areas = Attachment::new(
        &mesh,
        AreaSource::Vertices(&low),
        AreaSource::Vertices(&high),
    )
    .expect("two ends");
    (mesh, areas)
}

const METHODS: [&str; 3] = ["harmonic", "springs", "slices"];

/// Fibres and Jacobians.
type Made = (Vec<Vec<Point3<f64>>>, Vec<f64>);

/// 100 fibres of 15 points by a method, with the Jacobians if requested, or the error.
fn decompose(
    method: &str,
    muscle: &TriangleMesh,
    areas: &Attachment,
    jacobian: bool,
) -> Result<Made, String> {
    let grid = match method {
        "springs" => springs::grid(
            muscle,
            areas,
            Template::Parallel,
            springs::SpringOptions::default(),
        )
        .map_err(|e| e.to_string()),
        "slices" => slices::grid(
            muscle,
            areas,
            Template::Parallel,
            slices::SliceOptions::default(),
        )
        .map_err(|e| e.to_string()),
        _ => {
            let made = harmonic::decompose(muscle, areas, harmonic::HarmonicOptions::default())
                .map_err(|e| e.to_string())?;
            let numbers = if jacobian {
                made.jacobian(muscle, areas)
            } else {
                Vec::new()
            };
            return Ok((made.fibres, numbers));
        }
    }?;
    Ok((
        grid.fibres(),
        if jacobian {
            grid.jacobian()
        } else {
            Vec::new()
        },
    ))
}

fn quality(method: &str, muscle: &TriangleMesh, areas: &Attachment) -> Result<Quality, String> {
    let (fibres, jacobian) = decompose(method, muscle, areas, true)?;
    Ok(measure(
        muscle,
        &Closed::new(muscle),
        areas,
        &fibres,
        jacobian,
    ))
}

/// A row of the table of `docs/benchmarks.md`.
fn row(name: &str, muscle: &TriangleMesh, areas: &Attachment) {
    for method in METHODS {
        let begin = Instant::now();
        let made = decompose(method, muscle, areas, false);
        let time = begin.elapsed().as_secs_f64() * 1e3;
        match made.and_then(|_| quality(method, muscle, areas)) {
            Err(why) => {
                // The cause of the error, without the rest of the message.
                let short = why
                    .split(" sphere: ")
                    .last()
                    .and_then(|s| s.split([';', ',']).next())
                    .unwrap_or("");
                println!("ROW fibres | {name} | {method} | – | refused: {short} | | | | | | |");
            }
            Ok(q) => println!(
                "ROW fibres | {name} | {method} | {time:.0} | {} | {:.2} | {:.3} | {:.0e} | {:.3} | {:.3} | {:.4} |",
                q.outside,
                1e3 * q.outside_max_m,
                1e3 * q.end_distance_max_m,
                q.jacobian_min,
                1e3 * q.spacing_min_m,
                q.coverage,
                q.length_mean_m
            ),
        }
    }
}

fn folder() -> Option<PathBuf> {
    let root = std::env::var_os("PLIANT_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    Some(root.join("body")).filter(|body| body.is_dir())
}

/// All muscles of the table. Returns the number of available ones.
fn muscles() -> usize {
    let Some(body) = folder() else {
        println!(
            "skipped: {} real muscles, because there is no measured data",
            MUSCLES.len()
        );
        return 0;
    };
    let read = |file: String| {
        pliant::io::read(&body.join(&file))
            .unwrap_or_else(|e| panic!("{file}: {e}"))
            .mesh
    };
    for [name, origin, insertion] in MUSCLES {
        let muscle = read(format!("{name}.obj"));
        let given = [origin, insertion].map(|given| match given.split_once(',') {
            Some((bone, within)) => (
                read(format!("bones/{bone}.obj")),
                within.parse::<f64>().ok(),
            ),
            None => {
                let (file, part) = given
                    .split_once('#')
                    .map_or((*given, None), |(f, p)| (f, p.parse().ok()));
                (
                    component(&read(format!("attachments/{file}.obj")), part).expect("a part"),
                    None,
                )
            }
        });
        let [o, i] = [0, 1].map(|k| match given[k].1 {
            Some(within) => AreaSource::Near(&given[k].0, within),
            None => AreaSource::Patch(&given[k].0),
        });
        let areas = Attachment::new(&muscle, o, i).unwrap_or_else(|e| panic!("{name}: {e}"));
        row(name, &muscle, &areas);
    }
    MUSCLES.len()
}

fn fibres(c: &mut Criterion) {
    let (muscle, areas) = spindle();
    let mut group = c.benchmark_group("fibres");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    for method in METHODS {
        let q = quality(method, &muscle, &areas).expect("fibres");
        assert_eq!(
            (q.fibres, q.points, q.outside),
            (100, 1500, 0),
            "{method}: {q:?}"
        );
        assert!(
            q.end_distance_max_m <= 1e-5 && q.coverage >= 0.95,
            "{method}: {q:?}"
        );
        assert!(
            (q.length_mean_m / 0.2 - 1.0).abs() <= 0.05,
            "{method}: {q:?}"
        );
        group.bench_function(format!("{method}, 1000 vertices"), |b| {
            b.iter(|| decompose(method, black_box(&muscle), &areas, false).expect("fibres"));
        });
    }
    group.finish();
    row("spindle", &muscle, &areas);
    if !measured::quick() {
        measured::result("fibres.muscles", muscles() as f64, "1");
    }
}

fn geometric(c: &mut Criterion) {
    let bump = |k: usize| libm::sin(std::f64::consts::PI * (k as f64 + 0.5) / 50.0);
    let shape = ChainShape {
        radii: (0..50).map(|k| 0.005 + 0.02 * bump(k)).collect(),
        growth: (0..50).map(bump).collect(),
        length: 0.3,
        caps: Caps::Out,
    };
    let mut group = c.benchmark_group("geometric muscle");
    group
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    for (name, caps) in [("frusta", Caps::Out), ("frusta and round ends", Caps::In)] {
        let mut chain = Chain::new(ChainShape {
            caps,
            ..shape.clone()
        })
        .expect("a chain");
        let volume = chain.volume();
        let mut step = 0_u64;
        group.bench_function(format!("50 nodes, a change of length, {name}"), |b| {
            b.iter(|| {
                step = step.wrapping_add(1);
                // Within 20 % of the rest length, never the same length twice in a row.
                let length = 0.3 * (0.8 + 0.4 * (step * 7919 % 1000) as f64 / 1000.0);
                chain.set_length(black_box(length)).expect("a length");
            });
        });
        assert!(
            (chain.volume_now() / volume - 1.0).abs() <= 1e-12,
            "the volume is not kept"
        );
    }
    group.finish();
}

criterion_group!(benches, fibres, geometric);
criterion_main!(benches);
