//! Whether the cost model finds the fastest setting: what it chooses for 10, 1 and 0.1 % of the length beside all that
//! could have been chosen, in scenes that it was not fitted on.
//!
//! Each scene is as short as its study, so that both judge by the same frames. Times of the chosen setting and of the
//! fastest that keeps the target are both from the full sweep.

use std::time::Duration;

use pliant::accuracy::{self, Candidate, Options, Row, Study, Watch};
use pliant::scene::{Accuracy, Scene, builtin};
use pliant::simulation::Assets;

struct Silent;

impl Watch for Silent {
    fn part(&mut self, _: &str) {}
    fn stops(&self) -> bool {
        false
    }
}

/// A press that touches its muscle from the first frame on, with friction; the fit knows one without, of another material.
const PRESSED: [&str; 6] = [
    "frames=8",
    "muscle.0.material.stretch=400 N/m",
    "bone.0.motion.keys.0.translation=[\"0 mm\", \"29.5 mm\", \"0 mm\"]",
    "bone.1.motion.keys.0.translation=[\"0 mm\", \"-29.5 mm\", \"0 mm\"]",
    "bone.0.motion.keys.1.frame=40",
    "bone.1.motion.keys.1.frame=40",
];

/// Scenes that `src/accuracy/sweeps.csv` knows nothing of; the first two want the measured data.
const SCENES: [(&str, &[&str]); 4] = [
    ("examples/right-hip-gluteus-maximus.toml", &["frames=6"]),
    ("examples/right-hip.toml", &["frames=5"]),
    ("press", &PRESSED),
    ("hip", &["frames=8", "solver=quasi_static", "muscle.0.edge_length=5.5mm", "muscle.0.material.stretch=600 N/m"]),
];

fn load(name: &str, changes: &[&str]) -> Option<(Scene, Assets)> {
    let changes: Vec<String> = changes.iter().map(|c| (*c).to_owned()).collect();
    let scene = builtin::load(name, &changes).ok()?;
    let assets = Assets::load(&scene).ok()?;
    Some((scene, assets))
}

fn total(row: &Row) -> f64 {
    row.error.rms + row.model_error_m + row.uncertainty_m
}

/// Least time of a row that keeps the target, and that of a candidate [s].
fn times(study: &Study, target_m: f64, chosen: &Candidate) -> (Option<f64>, Option<f64>) {
    let able = study.rows.iter().filter(|row| row.candidate.way.is_none() && total(row) <= target_m);
    let fastest = able.map(|row| row.time_s).min_by(f64::total_cmp);
    let own =
        study.rows.iter().find(|row| row.candidate.solver == chosen.solver && row.candidate.width == chosen.width);
    (fastest, own.map(|row| row.time_s))
}

fn compare(name: &str, scene: &Scene, assets: &Assets, budget: Duration, threads: usize) {
    let options = Options { budget: 4 * budget, frames: Some(scene.frames), threads };
    let study = accuracy::measure(scene, assets, options, &mut Silent).expect("a reference");
    assert!(study.rows.len() > 3, "{name}: only {} settings measured", study.rows.len());
    for target in [0.1, 0.01, 0.001] {
        let target_m = target * study.length;
        let wished = Accuracy::Share(target);
        let chosen = accuracy::choose(scene, assets, wished, budget, threads, &mut Silent).expect("a choice");
        let (fastest, own) = times(&study, target_m, &chosen.candidate);
        let settings = format!("{}, {}", chosen.candidate.name(), chosen.candidate.in_words());
        let seconds = |time: Option<f64>| time.map_or("not measured".to_owned(), |s| format!("{s:.3}"));
        let ratio = fastest.zip(own).map(|(fastest, own)| own / fastest);
        println!(
            "ROW choice | {name} | {} % | {settings} | {} | {} | {} |",
            target * 100.0,
            seconds(own),
            seconds(fastest),
            ratio.map_or("–".to_owned(), |r| format!("{r:.2}"))
        );
        if let Some(ratio) = ratio {
            println!("RESULT choice.{}.{} {ratio:.3} ratio", name.replace(' ', "-"), target);
        }
    }
}

fn main() {
    let quick = std::env::args().any(|a| a == "--test");
    let threads = std::thread::available_parallelism().map_or(1, Into::into);
    if quick {
        let (scene, assets) = load("hip", &["frames=3", "muscle.0.edge_length=12mm"]).expect("the built-in hip");
        compare("hip", &scene, &assets, Duration::from_secs(3), threads);
        return;
    }
    for (name, changes) in SCENES {
        match load(name, changes) {
            Some((scene, assets)) => compare(&scene.name.clone(), &scene, &assets, Duration::from_secs(25), threads),
            None => println!("skipped: {name}, its data are absent"),
        }
    }
}
