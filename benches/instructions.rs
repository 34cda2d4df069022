//! Fixed work for a count of instructions: `benches/instructions.py` runs each task under
//! callgrind.
//!
//! `instructions TASK LANES` runs one task. Without arguments all tasks run, which shows that
//! they work. Only the calls of [`counted`] are counted.

mod measured;

use std::hint::black_box;

use measured::scene::{PRESSED, Scene};
use measured::turned::Turned;
use measured::{Body, pool};
use pliant::constraints::SweepOrder;
use pliant::contact::{Obstacle, Surface};
use pliant::mesh::shapes::tube;
use pliant::testing::internals::constraints::SimdWidth;

/// The counted work. callgrind finds it by the name of this function.
#[inline(never)]
fn counted(deed: &mut dyn FnMut()) {
    deed();
}

fn sweep(width: SimdWidth) {
    let body = Body::of(tube(0.25, 2.0, 44));
    let mut all = body.sweep(SweepOrder::Coloured, width);
    let mut particles = body.start.clone();
    all.sweep(&mut particles);
    counted(&mut || (0..5).for_each(|_| all.again(black_box(&mut particles))));
    assert!(particles != body.start);
}

fn step(width: SimdWidth) {
    let mut scene = Scene::new(32, 32).with_width(width);
    let frame = |scene: &mut Scene| {
        scene.step();
        scene.settle();
    };
    (0..PRESSED).for_each(|_| frame(&mut scene));
    counted(&mut || (0..2).for_each(|_| frame(&mut scene)));
    scene.check();
}

fn contact(_: SimdWidth) {
    let (bone, muscle) = (Surface::new(&tube(0.02, 0.4, 40)), tube(0.03, 0.24, 30));
    let mut sum = 0.0;
    counted(&mut || {
        sum = muscle
            .vertices
            .iter()
            .filter_map(|p| bone.closest(black_box(p)))
            .map(|c| c.distance.abs())
            .sum();
    });
    assert!(sum > 0.0);
}

fn factor(_: SimdWidth) {
    let mesh = tube(0.25, 2.0, 44);
    let turned = Turned::new(&mesh);
    let mut energy = Some(turned.energy());
    let mut solver = None;
    counted(&mut || solver = energy.take().map(|energy| turned.factored(energy)));
    assert!(solver.is_some_and(|solver| solver.entries() > 0));
}

fn solve(_: SimdWidth) {
    let mesh = tube(0.25, 2.0, 44);
    let turned = Turned::new(&mesh);
    let mut solver = turned.factored(turned.energy());
    counted(&mut || turned.solve(black_box(&mut solver)));
}

/// A name, the work, and whether the work accepts a number of lanes.
type Task = (&'static str, fn(SimdWidth), bool);

const TASKS: [Task; 5] = [
    ("sweep", sweep, true),
    ("step", step, true),
    ("contact", contact, false),
    ("factor", factor, false),
    ("solve", solve, false),
];

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .collect();
    let lanes = |width: &SimdWidth| {
        words
            .get(1)
            .is_none_or(|w| width.to_string().starts_with(w.as_str()))
    };
    let mut done = 0;
    for (name, task, in_lanes) in TASKS
        .into_iter()
        .filter(|(name, ..)| words.first().is_none_or(|w| w == name))
    {
        let widths: Vec<SimdWidth> = SimdWidth::available()
            .iter()
            .copied()
            .filter(lanes)
            .collect();
        for width in if in_lanes {
            widths
        } else {
            vec![SimdWidth::best()]
        } {
            pool(1).install(|| task(width));
            println!("done: {name}, {width}");
            done += 1;
        }
    }
    assert!(done > 0, "no such task, or no such lanes: {words:?}");
}
