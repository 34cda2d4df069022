//! Fascia: muscles do not lift off from the bones on which they lie, and slide on them.

use std::path::PathBuf;
use std::sync::OnceLock;

use pliant::Simulation;
use pliant::io::{Encoding, write};
use pliant::mesh::measures::max_or_nan;
use pliant::mesh::shapes::box_surface;
use pliant::scene::{Surroundings, parse_with};

/// Acceleration away from the bone [m/s^2].
const AWAY: f64 = 5.0;
/// Stiffness of the fascia [N/m^3].
const STIFFNESS: f64 = 1e6;
const SIZE: [f64; 3] = [0.06, 0.008, 0.03];
/// Density [kg/m^3].
const DENSITY: f64 = 1060.0;

/// A slab on a plate, and a block that holds an end of the slab.
fn folder() -> &'static PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("fascia");
        std::fs::create_dir_all(&folder).expect("the folder of tests can be written");
        let put = |name: &str, size: [f64; 3], edge: f64, [x, y]: [f64; 2]| {
            let mut mesh = box_surface(size, edge);
            for p in &mut mesh.vertices {
                (p.x, p.y) = (p.x + x, p.y + y);
            }
            write(&folder.join(name), &mesh, &[], Encoding::Text).expect("a mesh");
        };
        let beside = 0.5 * (SIZE[0] + 0.01) + 1e-4;
        put("slab.vtk", SIZE, 0.005, [0.0, 0.0]);
        put("plate.vtk", [0.2, 0.01, 0.1], 0.05, [0.0, -0.0095]);
        put("block.vtk", [0.01, 0.008, 0.03], 0.01, [beside, 0.0]);
        folder
    })
}

fn simulation(solver: &str, fascia: &str, plate: &str, held: bool) -> Simulation {
    let away = "[bone.motion]\nkeys = [{ frame = 0, translation = ['50 mm', '0 m', '0 m'] }]";
    let (block, attachment) = match held {
        true => (
            "",
            "[[muscle.attachment]]\nbone = 'block'\nnear = '0.2 mm'\nlimit = '20 %'\n",
        ),
        false => (away, ""),
    };
    let text = format!(
        "frames = 90\nframe_rate = '60 Hz'
        [[bone]]\nname = 'plate'\nmesh = 'plate.vtk'\nunit = 'm'\n{plate}
        [[bone]]\nname = 'block'\nmesh = 'block.vtk'\nunit = 'm'\n{block}
        [[muscle]]\nname = 'slab'\nmesh = 'slab.vtk'\nunit = 'm'
        [muscle.material]\ndensity = '{DENSITY} kg/m3'\nstretch = '60 N/m'\nbending = '1e-4 N m'
        {attachment}[effects.stretch]\n[effects.bending]\n[effects.volume]
        [effects.contact]\nthickness = '0.5 mm'\n{fascia}
        [effects.gravity]\nacceleration = ['0 m/s2', '{AWAY} m/s2', '0 m/s2']
        [effects.damping]\nrate = '40 1/s'\n{solver}"
    );
    let around = Surroundings {
        ..Surroundings::of(folder())
    };
    let parsed = parse_with(&text, "fascia.toml", &around);
    let parsed = parsed.unwrap_or_else(|error| panic!("{}", error.terse()));
    Simulation::new(parsed).unwrap_or_else(|error| panic!("{error}"))
}

fn fascia() -> String {
    format!("[effects.fascia]\nstiffness = '{STIFFNESS} N/m3'")
}

/// Vertices of the side on the plate, their areas [m^2] and their lifts [m].
fn lifts(sim: &Simulation) -> Vec<(usize, f64, f64)> {
    let body = &sim.bodies[0];
    let lowest = -0.5 * SIZE[1] + 1e-4;
    let areas = body.rest.vertex_areas();
    let below = body.rest.vertices.iter().enumerate();
    let x = &body.system.particles.position;
    below
        .filter(|(_, rest)| rest.y < lowest)
        .map(|(v, rest)| (v, areas[v], x[v].y - rest.y))
        .collect()
}

/// The greatest lift after a second and a half [m].
fn greatest(solver: &str, fascia: &str) -> f64 {
    let mut sim = simulation(solver, fascia, "", true);
    (0..90).for_each(|_| sim.step_frame());
    assert_eq!(sim.bodies[0].stopped, None);
    max_or_nan(lifts(&sim).into_iter().map(|(_, _, lift)| lift))
}

#[test]
fn a_muscle_stays_on_its_bone_under_every_solver() {
    // What lifts off by this much is pulled back with the weight of the slab.
    let even = DENSITY * SIZE[1] * AWAY / STIFFNESS;
    for solver in [
        "[solver.xpbd]",
        "[solver.quasi_static]",
        "[solver.implicit_euler]",
    ] {
        let found = greatest(solver, &fascia());
        // Away from its end the slab is bent a little.
        assert!(
            found > 0.5 * even && found <= 2.0 * even,
            "{solver} {found} {even}"
        );
        let control = greatest(solver, "");
        assert!(control > 20.0 * even, "{solver} {control}");
    }
}

/// The pull on the side that lies on the plate, if its stiffness is [`STIFFNESS`] [N].
fn pull_of(sim: &Simulation) -> f64 {
    let each = lifts(sim).into_iter();
    each.map(|(_, area, lift)| {
        if lift < 0.0 {
            0.0
        } else {
            STIFFNESS * area * lift
        }
    })
    .sum()
}

#[test]
fn the_pull_is_the_weight_of_what_hangs_from_it() {
    // The volume is projected after the fascia, so that a long step leaves a part of the lift.
    let mut sim = simulation("[solver.xpbd]\nsubsteps = 400", &fascia(), "", false);
    (0..90).for_each(|_| sim.step_frame());
    let pull = pull_of(&sim);
    let particles = &sim.bodies[0].system.particles;
    let mass: f64 = particles.inverse_mass.iter().map(|w| 1.0 / w).sum();
    let weight = mass * AWAY;
    assert!((pull / weight - 1.0).abs() <= 0.02, "{pull} {weight}");
    // Control: fascia of another stiffness, in the same formula.
    let stiffer = fascia().replace("1000000", "2000000");
    let mut sim = simulation("[solver.xpbd]\nsubsteps = 400", &stiffer, "", false);
    (0..90).for_each(|_| sim.step_frame());
    let control = pull_of(&sim);
    assert!((control / weight - 1.0).abs() > 0.3, "{control} {weight}");
}

#[test]
fn it_slides_without_force() {
    // The plate moves below the slab, whose end the resting block holds.
    let moves = "[bone.motion]\nkeys = [{ frame = 0, translation = ['0 m', '0 m', '0 m'] },
        { frame = 60, translation = ['30 mm', '0 m', '0 m'] }]";
    let mut sim = simulation("[solver.xpbd]", &fascia(), moves, true);
    (0..60).for_each(|_| sim.step_frame());
    let body = &sim.bodies[0];
    let pairs = body
        .system
        .particles
        .position
        .iter()
        .zip(&body.rest.vertices);
    let along = max_or_nan(pairs.map(|(x, rest)| (x.x - rest.x).abs()));
    assert!(along <= 3e-4, "{along}");
}

#[test]
fn a_scene_in_which_nothing_lies_on_a_bone_says_so() {
    let far = "[bone.motion]\nkeys = [{ frame = 0, translation = ['0 m', '-3 mm', '0 m'] }]";
    let named = |sim: &Simulation| {
        sim.notes
            .iter()
            .any(|note| note.contains("fascia holds no"))
    };
    assert!(named(&simulation("[solver.xpbd]", &fascia(), far, false)));
    assert!(!named(&simulation("[solver.xpbd]", &fascia(), "", false)));
    let sim = simulation("[solver.pbd]", &fascia(), "", false);
    let out = sim.plan.left_out.iter();
    assert!(out.map(|o| &o.effect).any(|effect| effect == "fascia"));
}
