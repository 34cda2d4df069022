//! Error against time of every solver on a small scene: a tube fixed at both ends, one of which
//! rotates by 20 degrees.
//!
//! The scene has both questions, the motion and the equilibrium. Each uses its own refined
//! reference. The bench asserts that the reference is certain, that errors fall with work, and that
//! they fall to the reference.

mod measured;

use std::time::Duration;

use measured::{quick, result};
use nalgebra::Point3;
use pliant::accuracy::{Status, Study, StudyOptions, StudyRow, measure};
use pliant::io::Encoding;
use pliant::mesh::shapes::tube;
use pliant::progress::Silent;
use pliant::scene::SolverQuestion;
use pliant::scene::{Scene, Solver, parse};
use pliant::simulation::Assets;

/// The reference must be certain to this share of the length. A trial has less time for it.
const CERTAIN: [f64; 2] = [2e-3, 1e-2];

/// A tube of 100 mm. Scenes read meshes from files, so it is written to one.
fn scene(solver: &str) -> (Scene, Assets) {
    let folder = std::env::temp_dir().join(format!("pliant-work-precision-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for the mesh");
    let muscle = tube(0.012, 0.1, 24);
    pliant::io::write(&folder.join("tube.obj"), &muscle, &[], Encoding::Text).expect("written");
    let ends = |wanted: fn(&Point3<f64>) -> bool| {
        let all = muscle
            .vertices
            .iter()
            .enumerate()
            .filter(|(_, p)| wanted(p))
            .map(|(v, _)| v.to_string());
        all.collect::<Vec<_>>().join(", ")
    };
    let (low, high) = (ends(|p| p.x < -0.049), ends(|p| p.x > 0.049));
    let text = format!(
        "frames = 6\nframe_rate = '60 Hz'\n\
         [[bone]]\nname = 'fixed'\nshape = 'tetrahedron'\n\
         [[bone]]\nname = 'moving'\nshape = 'tetrahedron'\n\
         [bone.motion]\ncentre = ['0 m', '0 m', '0 m']\naxis = [0, 1, 0]\n\
         keys = [{{ frame = 0 }}, {{ frame = 6, angle = '20deg' }}]\n\
         [[muscle]]\nname = 'tube'\nmesh = 'tube.obj'\nunit = 'm'\n\
         [muscle.material]\ndensity = '1060 kg/m3'\nstretch = '300 N/m'\nbending = '2e-4 N m'\n\
         [[muscle.attachment]]\nbone = 'fixed'\nvertices = [{low}]\nlimit = '50 %'\n\
         [[muscle.attachment]]\nbone = 'moving'\nvertices = [{high}]\nlimit = '50 %'\n\
         [effects.stretch]\n[effects.bending]\n[effects.volume]\n[effects.damping]\nrate = '5 1/s'\n{solver}"
    );
    let scene = parse(&text, "tube.toml", &folder).unwrap_or_else(|e| panic!("{}", e.terse()));
    let assets = Assets::load(&scene).expect("a mesh that can be read");
    let _: Result<(), _> = std::fs::remove_dir_all(&folder);
    (scene, assets)
}

fn of<'a>(study: &'a Study, solver: &'a str) -> impl Iterator<Item = &'a StudyRow> {
    study
        .rows
        .iter()
        .filter(move |row| row.candidate.solver_key() == solver)
}

/// Errors [m] of rows with increasing work.
fn falling(study: &Study) -> Vec<f64> {
    let mut rows: Vec<(f64, f64)> = match study.question {
        SolverQuestion::Motion => of(study, "xpbd")
            .filter(|r| {
                r.candidate.solver.iterations() == 1
                    && [4, 16, 64].contains(&r.candidate.solver.substeps())
            })
            .map(|r| (f64::from(r.candidate.solver.substeps()), r.error.rms))
            .collect(),
        SolverQuestion::Equilibrium => of(study, "quasi_static")
            .filter_map(|r| match r.candidate.solver {
                Solver::QuasiStatic(s) if s.iterations > 100 => Some((-s.tolerance, r.error.rms)),
                _ => None,
            })
            .collect(),
    };
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    rows.into_iter().map(|(_, error)| error).collect()
}

fn check(study: &Study) {
    let certain = study.reference.uncertainty.rms;
    assert!(
        certain <= CERTAIN[usize::from(quick())] * study.length,
        "{certain:e} m: {:?}",
        study.reference.steps
    );
    let errors = falling(study);
    let (first, last) = (errors[0], errors[errors.len() - 1]);
    assert!(
        errors.len() >= 3 && last <= 0.5 * first,
        "errors do not fall with work: {errors:?}"
    );
    let own = |r: &&StudyRow| {
        SolverQuestion::of(&r.candidate.solver) == Some(study.question)
            && r.status != Status::Diverged
    };
    let least = study
        .rows
        .iter()
        .filter(own)
        .map(|r| r.error.rms)
        .fold(f64::INFINITY, f64::min);
    // The remaining error is at most the uncertainty of the reference, or a part of the first
    // error. A trial has no time for the finest level.
    let part = if quick() { 0.25 } else { 0.1 };
    assert!(
        least <= part * first + certain,
        "errors do not fall to the reference: {least:e} of {first:e}, {certain:e}"
    );
    for row in &study.rows {
        assert!(
            row.status == Status::Diverged || row.volume_error <= 1e-6,
            "{row:?}"
        );
    }
}

fn report(name: &str, study: &Study) {
    let percent = |length: f64| length / study.length * 100.0;
    result(
        &format!("work_precision.{name}.uncertainty"),
        percent(study.reference.uncertainty.rms),
        "%",
    );
    result(
        &format!("work_precision.{name}.vertices"),
        study.vertices as f64,
        "1",
    );
    result(
        &format!("work_precision.{name}.frames"),
        study.frames as f64,
        "1",
    );
    let mut front: Vec<&StudyRow> = study.front.iter().map(|&r| &study.rows[r]).collect();
    front.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    for row in front {
        let total = percent(row.error.rms + row.model_error_m);
        let a_frame = row.time_s / study.frames as f64 * 1e3;
        println!(
            "ROW work_precision.{name} | {} | {} | {a_frame:.2} | {total:.3} | {:.0e} |",
            row.candidate.solver_key(),
            row.candidate.in_words(),
            row.volume_error
        );
    }
    for recommended in &study.recommended {
        if let Some(row) = recommended.row {
            let a_frame = study.rows[row].time_s / study.frames as f64 * 1e3;
            result(
                &format!("work_precision.{name}.within-{:e}", recommended.target),
                a_frame,
                "ms",
            );
        }
    }
}

fn main() {
    let budget = Duration::from_secs(if quick() { 6 } else { 25 });
    for (name, solver) in [
        ("motion", "[solver.xpbd]\nsubsteps = 20\n"),
        ("equilibrium", "[solver.quasi_static]\n"),
    ] {
        let (scene, assets) = scene(solver);
        let options = StudyOptions {
            budget,
            frames: Some(if quick() { 2 } else { 4 }),
            threads: 1,
        };
        let study = measure(&scene, &assets, options, &Silent).expect("a study");
        check(&study);
        report(name, &study);
    }
}
