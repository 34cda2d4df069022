//! Whether the cost model finds the fastest setting. The setting that the model chooses for 10,
//! 1 and 0.1 % of the length is compared with all possible settings, in scenes that the model was
//! not fitted on.
//!
//! Each scene is as short as its study, so that both use the same frames. The chosen setting
//! and the fastest setting of the full sweep that keeps the target are run again alternately. The
//! least time of each counts.

use std::time::Duration;

use pliant::accuracy::{self, FrameDistance, Reference, Study, StudyOptions, StudyRow};
use pliant::progress::Silent;
use pliant::scene::SolverQuestion;
use pliant::scene::{Accuracy, Scene, builtin};
use pliant::simulation::Assets;
use pliant::testing::internals::accuracy::{Candidate, Trajectory};

/// A press that touches its muscle from the first frame, with friction. The fit contains a
/// press without friction and of another material.
const PRESSED: [&str; 6] = [
    "frames=8",
    "muscle.0.material.stretch=400 N/m",
    "bone.0.motion.keys.0.translation=[\"0 mm\", \"29.5 mm\", \"0 mm\"]",
    "bone.1.motion.keys.0.translation=[\"0 mm\", \"-29.5 mm\", \"0 mm\"]",
    "bone.0.motion.keys.1.frame=40",
    "bone.1.motion.keys.1.frame=40",
];

/// Scenes that `src/accuracy/sweeps.csv` does not contain. The first two need the measured
/// data.
const SCENES: [(&str, &[&str]); 4] = [
    ("examples/right-hip-gluteus-maximus.toml", &["frames=6"]),
    ("examples/right-hip.toml", &["frames=5"]),
    ("press", &PRESSED),
    (
        "hip",
        &[
            "frames=8",
            "solver=quasi_static",
            "muscle.0.edge_length=5.5mm",
            "muscle.0.material.stretch=600 N/m",
        ],
    ),
];

fn load(name: &str, changes: &[&str]) -> Option<(Scene, Assets)> {
    let changes: Vec<String> = changes.iter().map(|c| (*c).to_owned()).collect();
    let scene = builtin::load_with(name, &changes, |name| std::env::var_os(name)).ok()?;
    let assets = Assets::load(&scene).ok()?;
    Some((scene, assets))
}

fn total(row: &StudyRow) -> f64 {
    row.error.rms + row.model_error_m + row.uncertainty_m
}

/// Repeats of the chosen setting and of the fastest setting, alternately. The least time of
/// each counts.
const REPEATS: usize = 3;

/// Least times [s] of two settings over all frames, and the distance of the first from the
/// reference of its question [m], with the parts and the uncertainty of that distance [m].
fn compared(
    scene: &Scene,
    assets: &Assets,
    study: &Study,
    pair: [&Candidate; 2],
) -> ([f64; 2], f64) {
    let mut least = [f64::INFINITY; 2];
    let mut error = f64::NAN;
    for _ in 0..REPEATS {
        for (k, candidate) in pair.into_iter().enumerate() {
            let run = Trajectory::of(scene, assets, candidate, scene.frames, &mut |_, _| true)
                .expect("it ran before");
            least[k] = least[k].min(run.time_s);
            if k == 0 {
                let own = SolverQuestion::of(&candidate.solver) == Some(study.question);
                let reference = if own {
                    Some(&study.reference)
                } else {
                    study.other.as_ref()
                };
                let left_out = if own { 0.0 } else { study.model_distance_m };
                let off = |r: &Reference| {
                    FrameDistance::between(r.frames(), &run.frames).rms + r.uncertainty.rms
                };
                error = reference.map_or(f64::NAN, off) + left_out;
            }
        }
    }
    (least, error)
}

fn compare(name: &str, scene: &Scene, assets: &Assets, budget: Duration, threads: usize) {
    let options = StudyOptions {
        budget: 4 * budget,
        frames: Some(scene.frames),
        threads,
    };
    let study = accuracy::measure(scene, assets, options, &Silent).expect("a reference");
    assert!(
        study.rows.len() > 3,
        "{name}: only {} settings measured",
        study.rows.len()
    );
    for target in [0.1, 0.01, 0.001] {
        let target_m = target * study.length;
        let able = study
            .rows
            .iter()
            .filter(|row| row.candidate.broad_phase.is_none() && total(row) <= target_m);
        let Some(fastest) = able.min_by(|a, b| a.time_s.total_cmp(&b.time_s)) else {
            println!(
                "ROW choice | {name} | {} % | – | – | – | none keeps it | – |",
                target * 100.0
            );
            continue;
        };
        let wished = Accuracy::Share(target);
        let chosen =
            accuracy::choose(scene, assets, wished, budget, threads, &Silent).expect("a choice");
        let words = |c: &Candidate| format!("{}, {}", c.solver_key(), c.in_words());
        let ([own, least], error) = compared(
            scene,
            assets,
            &study,
            [&chosen.candidate, &fastest.candidate],
        );
        println!(
            "ROW choice | {name} | {} % | {} | {:.3} % | {own:.3} | {} | {least:.3} | {:.2} |",
            target * 100.0,
            words(&chosen.candidate),
            error / study.length * 100.0,
            words(&fastest.candidate),
            own / least
        );
        println!(
            "RESULT choice.{}.{} {:.3} ratio",
            name.replace(' ', "-"),
            target,
            own / least
        );
    }
}

fn main() {
    let quick = std::env::args().any(|a| a == "--test");
    let threads = std::thread::available_parallelism().map_or(1, Into::into);
    if quick {
        let (scene, assets) =
            load("hip", &["frames=3", "muscle.0.edge_length=12mm"]).expect("the built-in hip");
        compare("hip", &scene, &assets, Duration::from_secs(3), threads);
        return;
    }
    for (name, changes) in SCENES {
        match load(name, changes) {
            Some((scene, assets)) => compare(
                &scene.name.clone(),
                &scene,
                &assets,
                Duration::from_secs(25),
                threads,
            ),
            None => println!("skipped: {name}, its data are absent"),
        }
    }
}
