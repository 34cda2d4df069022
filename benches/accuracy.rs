//! What an accuracy costs: the run whose steps follow its error, beside the cheapest fixed number of steps
//! that keeps the same error.
//!
//! All runs have the same frames, and errors are those from a run with many more steps. The two that are
//! compared run alternately; the least time of each counts.

use nalgebra::Point3;
use pliant::accuracy::FrameDistance;
use pliant::scene::{Accuracy, Scene, Solver, builtin};
use pliant::simulation::{Assets, Attained, Plan, Simulation};
use std::time::Instant;

/// A scene with its changes, the accuracies, and the steps of the reference.
type Case = (&'static str, &'static [&'static str], &'static [f64], u32);

/// The second one needs the measured data.
const CASES: [Case; 3] = [
    ("hip", &["frames=120"], &[0.03, 0.01, 0.0025], 640),
    (
        "examples/right-hip.toml",
        &["frames=60"],
        &[0.01, 0.003],
        320,
    ),
    ("cube", &[], &[0.01, 0.003], 2560),
];

/// Fixed numbers of steps that are tried.
const STEPS: [u32; 13] = [4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256];

/// Number of alternating repeats.
const REPEATS: usize = 2;

struct Run {
    frames: Vec<Vec<Point3<f64>>>,
    time_s: f64,
    attained: Option<Attained>,
}

fn run(scene: &Scene, assets: &Assets) -> Run {
    let plan = Plan::new(scene, assets);
    let mut run = Simulation::with(scene.clone(), assets.clone(), plan).expect("a simulation");
    let begin = Instant::now();
    let frames = (0..scene.frames).map(|_| {
        run.step_frame();
        let bodies = run.bodies.iter();
        bodies
            .flat_map(|body| body.system.particles.position.iter().copied())
            .collect()
    });
    Run {
        frames: frames.collect(),
        time_s: begin.elapsed().as_secs_f64(),
        attained: run.attained().cloned(),
    }
}

fn fixed(scene: &Scene, steps: u32) -> Scene {
    let mut scene = scene.clone();
    scene.adapts_steps = false;
    if let Solver::Xpbd(xpbd) = &mut scene.solver {
        xpbd.substeps = steps;
    }
    scene
}

fn compare((name, changes, shares, reference): Case, repeats: usize) {
    let changes: Vec<String> = changes.iter().map(|&c| c.to_owned()).collect();
    let read = builtin::load_with(name, &changes, |name| std::env::var_os(name));
    let Some((scene, assets)) = read.ok().and_then(|scene| {
        let assets = Assets::load(&scene).ok()?;
        Some((scene, assets))
    }) else {
        println!("skipped: {name} (no measured data)");
        return;
    };
    let name = &scene.name;
    let exact = run(&fixed(&scene, reference), &assets).frames;
    let off = |run: &Run| FrameDistance::between(&exact, &run.frames).rms;
    let tried = STEPS.iter().filter(|&&steps| 2 * steps <= reference);
    let mut errors = Vec::new();
    for &steps in tried {
        let error = off(&run(&fixed(&scene, steps), &assets));
        errors.push((steps, error));
        let least = shares.iter().copied().fold(1.0, f64::min);
        let length = assets.muscles[0].mesh.length();
        if error <= 0.5 * least * length {
            break;
        }
    }
    for &share in shares {
        let asked = Scene {
            accuracy: Some(Accuracy::Share(share)),
            ..scene.clone()
        };
        let mut own = run(&asked, &assets);
        let attained = own.attained.take().expect("an accuracy");
        let (error, target) = (off(&own), attained.target_m);
        assert!(error <= target, "{name}: {error} of {target}");
        let Some(&(steps, _)) = errors.iter().find(|(_, error)| *error <= target) else {
            println!("{name}, {share}: no fixed number keeps it");
            continue;
        };
        let mut least = [own.time_s, f64::INFINITY];
        for _ in 0..repeats {
            least[1] = least[1].min(run(&fixed(&scene, steps), &assets).time_s);
            least[0] = least[0].min(run(&asked, &assets).time_s);
        }
        let [own_s, fixed_s] = least;
        println!(
            "ROW accuracy | {name} | {} %: {:.2} mm | {:.2} mm | {:.2} mm | {own_s:.1} | \
             {steps}: {fixed_s:.1} | {:.2} |",
            share * 100.0,
            target * 1e3,
            error * 1e3,
            attained.error_m * 1e3,
            own_s / fixed_s
        );
        let key = format!("accuracy.{}.{share}", name.replace(' ', "-"));
        println!("RESULT {key} {:.3} ratio", own_s / fixed_s);
        println!("RESULT {key}.told {:.3} ratio", attained.error_m / error);
    }
}

fn main() {
    if std::env::args().any(|a| a == "--test") {
        const QUICK: Case = (
            "hip",
            &["muscle.0.edge_length=14mm", "frames=8"],
            &[0.01],
            256,
        );
        compare(QUICK, 0);
        return;
    }
    for case in CASES {
        compare(case, REPEATS);
    }
}
