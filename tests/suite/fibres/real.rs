//! Real muscles of the data set.

use std::path::{Path, PathBuf};
use std::time::Instant;

use pliant::fibres::harmonic::{HarmonicOptions, decompose};
use pliant::fibres::{AreaSource, Attachment};
use pliant::mesh::TriangleMesh;
use pliant::simulation::component;

use crate::fibres::{assert_good, measured};

enum Given {
    Patch(&'static str, Option<usize>),
    Near(&'static str, f64),
    /// The origin of the psoas beside the vertebrae, which the data lack: a strip set by hand.
    Strip,
}
use Given::{Near, Patch, Strip};

/// A muscle with its areas and its least coverage: 0.95 where possible.
type Row = (&'static str, Given, Given, f64);

const ROWS: &[Row] = &[
    (
        "muscles/Adductor_magnus.r",
        Patch("adductor_magnus", Some(1)),
        Patch("adductor_magnus", Some(0)),
        0.95,
    ),
    (
        "muscles/Gluteus_maximus_muscle.r",
        Patch("gluteus_maximus", Some(1)),
        Patch("gluteus_maximus", Some(0)),
        0.95,
    ),
    (
        "muscles-fine/gluteus_maximus",
        Patch("gluteus_maximus", Some(1)),
        Patch("gluteus_maximus", Some(0)),
        0.95,
    ),
    (
        "muscles/Gluteus_medius_muscle.r",
        Patch("gluteus_medius", Some(0)),
        Patch("gluteus_medius", Some(1)),
        0.95,
    ),
    (
        "muscles-fine/gluteus_medius",
        Patch("gluteus_medius", Some(0)),
        Patch("gluteus_medius", Some(1)),
        0.95,
    ),
    (
        "muscles/Iliacus_muscle.r",
        Patch("iliacus", None),
        Near("Femur.r", 0.005),
        0.95,
    ),
    (
        "muscles-fine/iliacus",
        Patch("iliacus", None),
        Near("Femur.r", 0.005),
        0.95,
    ),
    (
        "muscles/Pectineus_muscle.r",
        Patch("pectineus", Some(0)),
        Patch("pectineus", Some(1)),
        0.95,
    ),
    (
        "muscles/Rectus_femoris.r",
        Patch("rectus_femoris", Some(0)),
        Near("Patella.r", 0.03),
        0.95,
    ),
    (
        "muscles-fine/rectus_femoris",
        Patch("rectus_femoris", Some(0)),
        Near("Patella.r", 0.005),
        0.95,
    ),
    (
        "muscles/Semimembranosus_muscle.r",
        Patch("semimembranosus", Some(0)),
        Patch("semimembranosus", Some(1)),
        0.95,
    ),
    (
        "muscles-fine/semimembranosus",
        Patch("semimembranosus", Some(0)),
        Patch("semimembranosus", Some(1)),
        0.95,
    ),
    (
        "muscles/Short_head_of_biceps_brachii.r",
        Patch("short_head_of_biceps_brachii", None),
        Patch("biceps_brachii", None),
        0.95,
    ),
    (
        "muscles/Vastus_lateralis_muscle.r",
        Patch("vastus_lateralis", None),
        Near("Patella.r", 0.04),
        0.95,
    ),
    (
        "muscles/Brachialis_muscle.r",
        Near("Humerus.r", 0.002),
        Near("Ulna.r", 0.005),
        0.95,
    ),
    (
        "muscles/Infraspinatus_muscle.r",
        Near("Scapula.r", 0.001),
        Near("Humerus.r", 0.001),
        0.95,
    ),
    (
        "muscles/Subscapularis_muscle.r",
        Near("Scapula.r", 0.001),
        Near("Humerus.r", 0.001),
        0.95,
    ),
    (
        "muscles/Medial_head_of_gastrocnemius.r",
        Near("Femur.r", 0.01),
        Near("Fibula.r", 0.035),
        0.95,
    ),
    (
        "muscles/Soleus_muscle.r",
        Near("Fibula.r", 0.005),
        Near("Tibia.r", 0.002),
        0.95,
    ),
    (
        "muscles/Gracilis_muscle.r",
        Patch("gracilis", Some(1)),
        Patch("gracilis", Some(0)),
        0.95,
    ),
    (
        "muscles/Long_head_of_biceps_femoris.r",
        Patch("long_head_of_biceps_femoris", None),
        Near("Fibula.r", 0.02),
        0.95,
    ),
    (
        "muscles-fine/psoas_major",
        Near("Sacrum", 0.03),
        Near("Femur.r", 0.01),
        0.6,
    ),
    (
        "muscles/Long_head_of_biceps_brachii.r",
        Patch("long_head_of_biceps_brachii", None),
        Patch("biceps_brachii", None),
        0.95,
    ),
    (
        "muscles/Psoas_major.r",
        Near("Sacrum", 0.03),
        Near("Femur.r", 0.01),
        0.6,
    ),
    (
        "muscles-fine/psoas_major",
        Strip,
        Near("Femur.r", 0.01),
        0.95,
    ),
    ("muscles/Psoas_major.r", Strip, Near("Femur.r", 0.01), 0.95),
];

fn folder() -> Option<PathBuf> {
    let root = std::env::var_os("PLIANT_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let body = root.join("body");
    if !body.is_dir() {
        println!("skipped: 1 test, because there is no {}", body.display());
        return None;
    }
    Some(body)
}

fn read(path: &Path) -> TriangleMesh {
    pliant::io::read(path)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()))
        .mesh
}

#[test]
fn all_muscles() {
    let Some(body) = folder() else { return };
    println!(
        "| muscle | vertices | ms | least Jacobian | coverage | length [m] | pennation [rad] | tendon [m] |"
    );
    for (name, origin, insertion, coverage) in ROWS {
        let muscle = read(&body.join(format!("{name}.obj")));
        let file = |given: &Given| match given {
            Patch(file, part) => {
                component(&read(&body.join(format!("attachments/{file}.obj"))), *part)
                    .expect("a part")
            }
            Near(bone, _) => read(&body.join(format!("bones/{bone}.obj"))),
            Strip => {
                let mut strip =
                    read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/lumbar-spine.obj"));
                strip.vertices.iter_mut().for_each(|v| v.coords *= 1e-3);
                strip
            }
        };
        let files = [file(origin), file(insertion)];
        let source = |k: usize, given: &Given| match given {
            Patch(..) | Strip => AreaSource::Patch(&files[k]),
            Near(_, within) => AreaSource::Near(&files[k], *within),
        };
        let areas = Attachment::new(&muscle, source(0, origin), source(1, insertion));
        let areas = areas.unwrap_or_else(|e| panic!("{name}: {e}"));
        let start = Instant::now();
        decompose(&muscle, &areas, HarmonicOptions::default()).expect("fibres");
        let time = start.elapsed().as_secs_f64();
        let (_, q) = measured(&muscle, &areas);
        println!(
            "| {name} | {} | {:.0} | {:.1e} | {:.3} | {:.4} | {:.2} | {:.4} |",
            muscle.vertices.len(),
            1e3 * time,
            q.jacobian_min,
            q.coverage,
            q.length_mean_m,
            q.pennation_mean_rad,
            q.tendon_length_max_m
        );
        assert_good(name, &q);
        assert!(q.coverage >= *coverage, "{name}: {q:?}");
    }
}
