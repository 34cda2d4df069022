//! Fibres that shorten: activation and tone in a muscle between two plates that approach each other.

use std::path::PathBuf;
use std::sync::OnceLock;

use pliant::io::{Encoding, write};
use pliant::mesh::shapes::{box_surface, tube};
use pliant::mesh::{TriangleMesh, measures::max_or_nan};
use pliant::scene::{Surroundings, parse_with};
use pliant::simulation::Simulation;
use pliant::simulation::checkpoint::{Checkpoint, Fingerprint, save};

/// Length and radius of the muscle, and depth of its bow [m].
const LENGTH: f64 = 0.1;
const RADIUS: f64 = 0.008;
const BOW: f64 = 0.004;

/// Frames of the approach, and its share of the length.
const FRAMES: usize = 60;
const APPROACH: f64 = 0.15;

/// A tube along x with a small bow, and a plate at each end.
fn folder() -> &'static PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("tone");
        std::fs::create_dir_all(&folder).expect("the folder of tests can be written");
        let put = |name: &str, mesh: &TriangleMesh| {
            write(&folder.join(name), mesh, &[], Encoding::Text).expect("a mesh");
        };
        let mut muscle = tube(RADIUS, LENGTH, 12);
        for x in &mut muscle.vertices {
            x.y += BOW * (std::f64::consts::PI * x.x / LENGTH).cos();
        }
        put("muscle.vtk", &muscle);
        put("plate.vtk", &box_surface([0.01, 0.04, 0.04], 0.02));
        folder
    })
}

/// The scene with other lines for the muscle, its effects and the solver.
fn scene(of_muscle: &str, others: &str) -> String {
    let at = LENGTH / 2.0 + 0.0051;
    let end = at - APPROACH * LENGTH;
    format!(
        "frames = {FRAMES}\nframe_rate = '60 Hz'
        [[bone]]\nname = 'low'\nmesh = 'plate.vtk'\nunit = 'm'
        [bone.motion]\nkeys = [{{ frame = 0, translation = ['-{at} m', '0 m', '0 m'] }}]
        [[bone]]\nname = 'high'\nmesh = 'plate.vtk'\nunit = 'm'
        [bone.motion]\nkeys = [{{ frame = 0, translation = ['{at} m', '0 m', '0 m'] }},
        {{ frame = {FRAMES}, translation = ['{end} m', '0 m', '0 m'] }}]
        [[muscle]]\nname = 'muscle'\nmesh = 'muscle.vtk'\nunit = 'm'
        [[muscle.attachment]]\nbone = 'low'\nnear = '0.2 mm'\nlimit = '20 %'
        [[muscle.attachment]]\nbone = 'high'\nnear = '0.2 mm'\nlimit = '20 %'
        {of_muscle}\n[effects.stretch]\n[effects.bending]\n[effects.volume]
        [effects.damping]\nrate = '5 1/s'\n{others}"
    )
}

const FIBRES: &str = "[muscle.fibres]\nmethod = 'harmonic'\ncount = 40";
const TONE: &str = "[effects.tone]\nstress = '1 kPa'";
const SOLVERS: [&str; 3] = [
    "[solver.xpbd]",
    "[solver.quasi_static]",
    "[solver.implicit_euler]",
];

fn simulation(of_muscle: &str, others: &str) -> Simulation {
    let around = Surroundings {
        ..Surroundings::of(folder())
    };
    let parsed = parse_with(&scene(of_muscle, others), "tone.toml", &around);
    let parsed = parsed.unwrap_or_else(|error| panic!("{}", error.terse()));
    Simulation::new(parsed).unwrap_or_else(|error| panic!("{error}"))
}

/// The state of a simulation: all bits of the particles of its muscle.
fn bits(sim: &Simulation) -> Vec<u64> {
    let particles = &sim.bodies[0].system.particles;
    let each = particles.position.iter().flat_map(|x| x.coords.iter());
    each.map(|x| x.to_bits()).collect()
}

/// The middle of the muscle [m].
fn middle(sim: &Simulation) -> nalgebra::Vector3<f64> {
    let body = &sim.bodies[0];
    let x = &body.system.particles.position;
    let middle = body.rest.vertices.iter().enumerate();
    let inner: Vec<usize> = middle
        .filter(|(_, x)| x.x.abs() < 0.1 * LENGTH)
        .map(|(v, _)| v)
        .collect();
    assert!(inner.len() > 6);
    let sum: nalgebra::Vector3<f64> = inner.iter().map(|&v| x[v].coords).sum();
    sum / inner.len() as f64
}

/// How far the middle of the muscle is from the line between the plates [m].
fn bow(sim: &Simulation) -> f64 {
    let centre = middle(sim);
    centre.y.hypot(centre.z)
}

/// The greatest bow over the approach [m].
fn greatest_bow(of_muscle: &str, others: &str) -> f64 {
    let mut sim = simulation(of_muscle, others);
    let bows = (0..FRAMES).map(|_| {
        sim.step_frame();
        assert_eq!(sim.bodies[0].stopped, None);
        bow(&sim)
    });
    max_or_nan(bows)
}

#[test]
fn a_muscle_under_tone_does_not_buckle() {
    for solver in SOLVERS {
        let found = greatest_bow(FIBRES, &format!("{TONE}\n{solver}"));
        assert!(found <= 1.25 * BOW, "{solver}: {found}");
        // Control: without tone it buckles.
        let control = greatest_bow(FIBRES, solver);
        assert!(control > 2.5 * BOW, "{solver}: {control}");
    }
}

#[test]
fn a_muscle_that_is_activated_as_it_shortens_does_not_buckle() {
    let keys = format!(
        "{FIBRES}\n[muscle.activation]\nkeys = [{{ frame = 0, shortening = '0 %' }}, \
         {{ frame = {FRAMES}, shortening = '17 %' }}]"
    );
    let solvers = [SOLVERS[0], SOLVERS[1], "[solver.pbd]\nbending = 0.5"];
    for solver in solvers {
        let found = greatest_bow(&keys, solver);
        assert!(found <= 1.25 * BOW, "{solver}: {found}");
        let control = greatest_bow(FIBRES, solver);
        assert!(control > 1.6 * BOW, "{solver}: {control}");
    }
}

#[test]
fn activation_of_nothing_changes_nothing() {
    let still =
        format!("{FIBRES}\n[muscle.activation]\nkeys = [{{ frame = 0, shortening = '0 %' }}]");
    let [mut with, mut without] = [still.as_str(), FIBRES].map(|m| simulation(m, SOLVERS[0]));
    for _ in 0..5 {
        with.step_frame();
        without.step_frame();
    }
    assert_eq!(bits(&with), bits(&without));
    // Control: a shortening of 1 % is seen.
    let mut short = simulation(&still.replace("0 %", "1 %"), SOLVERS[0]);
    (0..5).for_each(|_| short.step_frame());
    assert_ne!(bits(&short), bits(&without));
}

/// The force from the side that bows a muscle by as much is greater by that of a cord under tension.
#[test]
fn a_muscle_under_tone_yields_less_to_the_side_where_it_was_measured() {
    let load = "[effects.gravity]\nacceleration = ['0 m/s2', '0 m/s2', '-5 m/s2']";
    let sag = |tone: &str| {
        let mut sim = simulation(FIBRES, &format!("{tone}\n{load}\n[solver.quasi_static]"));
        let before = middle(&sim);
        // The plates have hardly moved.
        (0..2).for_each(|_| sim.step_frame());
        before.z - middle(&sim).z
    };
    let (found, control) = (sag(TONE), sag(""));
    assert!(found > 0.0 && found <= 0.9 * control, "{found} {control}");
}

#[test]
fn a_run_with_tone_goes_on_from_a_checkpoint_with_the_same_bits() {
    // In the second frame edges are kept in their directions; in the twentieth no more.
    for (solver, frames) in SOLVERS.into_iter().flat_map(|s| [(s, 2), (s, 20)]) {
        let others = format!("{TONE}\n{solver}");
        let mut whole = simulation(FIBRES, &others);
        (0..frames).for_each(|_| whole.step_frame());
        let system = &whole.bodies[0].system;
        let kept = system
            .elastic
            .iter()
            .find(|part| part.name() == "direction");
        let acts = kept.map(|part| part.residual(&system.particles, 1e-3).count > 0);
        assert!(
            acts.is_none_or(|acts| acts == (frames == 2)),
            "{solver} {frames}"
        );
        let saved = save(&whole, &Fingerprint::of(&whole), b"");
        let mut resumed = simulation(FIBRES, &others);
        let fingerprint = Fingerprint::of(&resumed);
        let opened = Checkpoint::open(&saved).expect("its own bytes");
        opened
            .restore(&mut resumed, &fingerprint)
            .expect("its own state");
        // Measures need the shortened lengths.
        let [here, there] = [&whole, &resumed].map(|sim| format!("{:?}", sim.measure()));
        assert_eq!(here, there, "{solver}");
        for sim in [&mut whole, &mut resumed] {
            (0..5).for_each(|_| sim.step_frame());
        }
        assert_eq!(bits(&whole), bits(&resumed), "{solver}");
    }
}

/// A scene in which nothing shortens for another reason: its plan says why, and it runs.
#[test]
fn tone_and_activation_that_cannot_act_are_left_out_with_a_reason() {
    let keys =
        format!("{FIBRES}\n[muscle.activation]\nkeys = [{{ frame = 0, shortening = '5 %' }}]");
    let without = |text: &str, part: &str| text.replace(part, "");
    let around = Surroundings {
        ..Surroundings::of(folder())
    };
    let reasons = |text: &str| {
        let parsed = parse_with(text, "tone.toml", &around).expect("a scene");
        let mut sim = Simulation::new(parsed).expect("meshes");
        sim.step_frame();
        let out = sim.plan.left_out.iter();
        let named = out.filter(|o| o.effect == "tone" || o.effect == "activation");
        named
            .map(|o| format!("{}: {}", o.effect, o.why))
            .collect::<Vec<_>>()
    };
    let whole = scene(&keys, TONE);
    assert_eq!(reasons(&whole), [""; 0]);
    let found = reasons(&without(&whole, "[effects.stretch]"));
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found.iter().all(|why| why.contains("stretch")), "{found:?}");
    let found = reasons(&scene(&keys, &format!("{TONE}\n[solver.pbd]")));
    assert!(
        found.len() == 1 && found[0].contains("classic PBD"),
        "{found:?}"
    );
    let lines = whole.replace(
        "method = 'harmonic'\ncount = 40",
        "method = 'harmonic'\ncount = 1",
    );
    assert_eq!(reasons(&lines), [""; 0]);
}
