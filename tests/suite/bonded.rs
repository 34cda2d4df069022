//! Bonds between muscles: they hold in shear, keep the momentum, cross nothing, and resume.

use nalgebra::{Point3, Vector3};
use pliant::mesh::shapes::box_surface;
use pliant::scene::{Scene, parse};
use pliant::simulation::Simulation;
use pliant::simulation::checkpoint::{Checkpoint, Fingerprint, save};

use crate::soft::{Soft, bits, crossings, mean, moved, scene, simulation, text};

const EFFECTS: &str = "[effects.stretch]\n[effects.bending]\n[effects.volume]\n\
    [effects.contact]\nthickness = '0.5 mm'\n[effects.damping]\nrate = '5 1/s'\n";

/// The force on each vertex of the upper slab [N].
const FORCE: f64 = 2e-3;

/// Two slabs of 60 x 60 x 10 mm, 0.1 mm apart. The lower one is held below; the upper one is pulled to
/// the side.
fn slabs(force: [f64; 3]) -> Vec<Soft> {
    let slab = box_surface([0.06, 0.06, 0.01], 0.01);
    let mut lower = Soft::new("lower", slab.clone());
    let is_low = |v: &u32| slab.vertices[*v as usize].z < 0.0;
    lower.held = (0..slab.vertices.len() as u32).filter(is_low).collect();
    let mut upper = Soft::new("upper", moved(slab, [0.0, 0.0, 0.0101]));
    upper.force = force;
    vec![lower, upper]
}

fn interface(more: &str) -> String {
    format!("[[interface]]\nbetween = ['upper', 'lower']\n{more}\n{EFFECTS}")
}

fn scene_of(bodies: &[Soft], frames: usize, more: &str) -> Scene {
    scene(&text(bodies, frames, more))
}

/// The upper slab after `frames`, and how far it slid [m].
fn slid(frames: usize, more: &str) -> (Simulation, f64) {
    let bodies = slabs([FORCE, 0.0, 0.0]);
    let scene = scene_of(&bodies, frames, more);
    let mut run = simulation(&scene, &bodies);
    let before = mean(&run, 1);
    for _ in 0..frames {
        run.step_frame();
        assert_eq!(crossings(&run).all, 0);
    }
    assert_eq!(run.certificate().open, 0);
    let by = (mean(&run, 1) - before).x;
    (run, by)
}

#[test]
fn what_is_bonded_does_not_slide() {
    let frames = 30;
    let (_, without) = slid(frames, EFFECTS);
    let (_, sliding) = slid(frames, &interface("kind = 'sliding'"));
    assert_eq!(without.to_bits(), sliding.to_bits());
    let (run, bonded) = slid(frames, &interface("kind = 'bonded'"));
    println!(
        "sliding {sliding:e} m, bonded {bonded:e} m, ratio {:e}",
        bonded / sliding
    );
    assert!(sliding > 10e-3, "{sliding}");
    assert!(bonded <= 0.01 * sliding, "{bonded} of {sliding}");
    assert!(
        run.notes.iter().all(|note| !note.contains("bonded")),
        "{:?}",
        run.notes
    );
    let planned = run.plan.run.iter().find(|p| p.effect == "bond with lower");
    assert!(planned.is_some_and(|p| p.muscle == "upper" && p.elements > 90));
}

#[test]
fn the_stiffness_of_a_bond_is_for_its_area() {
    // At rest the force is stiffness x area x shear: 98 vertices, and 60 x 60 mm.
    let stiffness = 2e5;
    let more = format!("kind = 'bonded'\nstiffness = '{stiffness} N/m3'");
    let heavy = "[solver.xpbd]\nsubsteps = 20\n";
    let text = interface(&more).replace("'5 1/s'", "'40 1/s'") + heavy;
    let (run, _) = slid(40, &text);
    let count = run.bodies[1].rest.vertices.len() as f64;
    let by = shear(&run);
    let ratio = by * stiffness * 0.06 * 0.06 / (FORCE * count);
    println!("shear {by:e} m, of the expected {ratio}");
    assert!((0.97..=1.03).contains(&ratio), "{ratio}");
}

/// How far the upper slab slid on the lower one where they face each other \[m\].
fn shear(run: &Simulation) -> f64 {
    let (lower, upper) = (&run.bodies[0], &run.bodies[1]);
    // Vertices of the rim have half the area.
    let shear = |body: &pliant::simulation::Body, z: f64| -> f64 {
        let (mut sum, mut areas) = (0.0, 0.0);
        let all = body
            .rest
            .vertices
            .iter()
            .zip(&body.system.particles.position);
        for (rest, x) in all.filter(|(rest, _)| (rest.z - z).abs() < 1e-3) {
            let is_rim = [rest.x, rest.y].map(|c| c.abs() > 0.029);
            let area: f64 = is_rim
                .map(|rim| if rim { 0.5 } else { 1.0 })
                .iter()
                .product();
            sum += area * (x.x - rest.x);
            areas += area;
        }
        sum / areas
    };
    shear(upper, 0.0051) - shear(lower, 0.005)
}

#[test]
fn a_minimum_of_energy_has_the_bonds() {
    let stiffness = 2e5;
    let bonded = interface(&format!("kind = 'bonded'\nstiffness = '{stiffness} N/m3'"));
    let bonded = bonded.replace("'5 1/s'", "'40 1/s'");
    let rested = |bodies: &[Soft], frames: usize, solver: &str, text: &str| {
        let text = format!("{text}[solver.{solver}]\n");
        let mut run = simulation(&scene_of(bodies, frames, &text), bodies);
        for _ in 0..frames {
            run.step_frame();
            assert_eq!(crossings(&run).all, 0);
        }
        shear(&run)
    };
    // The upper slab holds by its bonds alone.
    let bodies = slabs([FORCE, 0.0, 0.0]);
    let count = bodies[1].mesh.vertices.len() as f64;
    let by = rested(&bodies, 25, "implicit_euler", &bonded);
    let ratio = by * stiffness * 0.06 * 0.06 / (FORCE * count);
    println!("of the expected shear {ratio}");
    assert!((0.97..=1.03).contains(&ratio), "{ratio}");
    // An equilibrium needs something that is held: here its upper side.
    let mut bodies = slabs([3.0 * FORCE, 0.0, 0.0]);
    let upper = &mut bodies[1];
    let is_high = |v: &u32| upper.mesh.vertices[*v as usize].z > 0.015;
    upper.held = (0..count as u32).filter(is_high).collect();
    let still = rested(&bodies, 1, "quasi_static", &bonded);
    let moving = rested(&bodies, 6, "implicit_euler", &bonded);
    let sliding = rested(&bodies, 1, "quasi_static", &interface("kind = 'sliding'"));
    println!("equilibrium {still:e} m, after a motion {moving:e} m, sliding {sliding:e} m");
    // Forces are known to 2e-4 of that of unit strain, 2.7 N: 9 % of the 6 mN on a vertex.
    assert!(
        (still - moving).abs() <= 0.05 * still,
        "{still} and {moving}"
    );
    assert!(still <= 0.9 * sliding, "control: {still} of {sliding}");
}

/// Ten frames of two free slabs, the upper one moving, `gap` \[m\] apart. Returns the momentum that
/// was lost, that which passed from one to the other, a bound from rounding [kg m/s], and the number
/// of vertices that the guarantee took back.
fn pushed(gap: f64, within: &str) -> ([f64; 3], u64) {
    let mut bodies = slabs([0.0; 3]);
    bodies[0].held.clear();
    bodies[1].mesh = moved(bodies[0].mesh.clone(), [0.0, 0.0, 0.01 + gap]);
    let more = interface(&format!("kind = 'bonded'\nwithin = '{within}'"));
    let more = more.replace("[effects.damping]\nrate = '5 1/s'\n", "");
    let mut run = simulation(&scene_of(&bodies, 10, &more), &bodies);
    for v in &mut run.bodies[1].system.particles.velocity {
        *v = Vector3::new(0.1, -0.03, 0.01);
    }
    let momentum = |run: &Simulation, body: usize| -> Vector3<f64> {
        let particles = &run.bodies[body].system.particles;
        let each = particles.velocity.iter().zip(&particles.inverse_mass);
        each.map(|(v, w)| v / *w).sum()
    };
    let before = [0, 1].map(|b| momentum(&run, b));
    (0..10).for_each(|_| run.step_frame());
    let after = [0, 1].map(|b| momentum(&run, b));
    let lost = (after[0] + after[1] - before[0] - before[1]).norm();
    let passed = (after[0] - before[0]).norm();
    // Positions of 0.05 m are rounded in each of 200 steps of 1/1200 s, by a dozen sweeps.
    let masses = run
        .bodies
        .iter()
        .flat_map(|b| &b.system.particles.inverse_mass);
    let mass: f64 = masses.map(|w| 1.0 / w).sum();
    let bound = mass * 0.05 * f64::EPSILON * 1200.0 * 200.0;
    ([lost, passed, bound], run.certificate().truncated)
}

#[test]
fn a_bond_keeps_the_momentum() {
    let ([lost, passed, bound], truncated) = pushed(4e-3, "5 mm");
    println!("lost {lost:e} of {passed:e} passed on, bound {bound:e} kg m/s");
    assert_eq!(truncated, 0);
    assert!(passed > 1e9 * bound, "control: the bond passes momentum on");
    assert!(lost <= bound, "{lost} of {bound}");
    // What the guarantee takes back is an impulse on one of two parts, with or without a bond.
    let ([lost, passed, _], truncated) = pushed(1e-4, "1 mm");
    println!("nearly touching: lost {lost:e} of {passed:e}, {truncated} vertices taken back");
}

#[test]
fn a_turned_pair_has_no_stress() {
    let bodies = slabs([0.0; 3]);
    let bodies: Vec<Soft> = bodies
        .into_iter()
        .map(|b| Soft {
            held: Vec::new(),
            ..b
        })
        .collect();
    let scene = scene_of(
        &bodies,
        20,
        &interface("kind = 'bonded'\nstiffness = '1 GN/m3'"),
    );
    let mut run = simulation(&scene, &bodies);
    let turn = nalgebra::UnitQuaternion::from_euler_angles(0.4, 1.1, -0.3);
    let turned: Vec<Vec<Point3<f64>>> = run
        .bodies
        .iter()
        .map(|b| b.rest.vertices.iter().map(|x| turn * x).collect())
        .collect();
    for (body, x) in run.bodies.iter_mut().zip(&turned) {
        body.system.particles.position.clone_from(x);
    }
    (0..20).for_each(|_| run.step_frame());
    let mut most = 0.0_f64;
    for (body, x) in run.bodies.iter().zip(&turned) {
        for (a, b) in body.system.particles.position.iter().zip(x) {
            let by = (a - b).norm();
            assert!(by.is_finite());
            most = most.max(by);
        }
    }
    println!("moved by {most:e} m");
    assert!(most <= 1e-9, "{most}");
}

#[test]
fn a_bonded_pair_resumes_with_the_same_bits_on_any_number_of_threads() {
    let bodies = slabs([FORCE, 0.0, 0.0]);
    let scene = scene_of(&bodies, 8, &interface("kind = 'bonded'"));
    let made = || simulation(&scene, &bodies);
    let mut straight = made();
    (0..4).for_each(|_| straight.step_frame());
    let kept = save(&straight, &Fingerprint::of(&straight), b"");
    (0..4).for_each(|_| straight.step_frame());
    for threads in [1, 2, 8] {
        let mut again = made();
        let print = Fingerprint::of(&again);
        let checkpoint = Checkpoint::open(&kept).expect("a checkpoint");
        checkpoint
            .restore(&mut again, &print)
            .expect("its own checkpoint");
        again.set_threads(threads);
        (0..4).for_each(|_| again.step_frame());
        assert!(bits(&again) == bits(&straight), "{threads} threads");
    }
    // Control: without the bond the checkpoint is of another simulation.
    let other = simulation(&scene_of(&bodies, 8, EFFECTS), &bodies);
    let differs = Fingerprint::of(&other);
    let mut other = other;
    let refused = Checkpoint::open(&kept)
        .expect("a checkpoint")
        .restore(&mut other, &differs);
    assert!(refused.is_err_and(|e| e.to_string().contains("`interface`")));
}

#[test]
fn a_bond_that_cannot_be_is_a_finding() {
    let bodies = slabs([0.0; 3]);
    let left = |more: &str| {
        let run = simulation(&scene_of(&bodies, 2, more), &bodies);
        let left = run
            .plan
            .left_out
            .iter()
            .find(|l| l.effect == "bond with lower");
        (left.map(|l| l.why.clone()).unwrap_or_default(), run.notes)
    };
    let bonded = interface("kind = 'bonded'");
    assert_eq!(left(&bonded), (String::new(), Vec::new()));
    let (why, _) = left(&bonded.replace("[effects.contact]\nthickness = '0.5 mm'\n", ""));
    assert!(why.contains("[effects.contact]"), "{why}");
    let (why, _) = left(&bonded.replace("'0.5 mm'\n", "'0.5 mm'\nbetween = ['bones', 'self']\n"));
    assert!(why.contains("between"), "{why}");
    let (why, notes) = left(&interface("kind = 'bonded'\nwithin = '0.01 mm'"));
    assert_eq!(why, "");
    assert!(
        notes
            .iter()
            .any(|n| n.contains("0.01 mm") && n.contains("lower")),
        "{notes:?}"
    );
}

#[test]
fn wrong_interfaces_are_refused_with_their_line() {
    let told = |interface: &str| {
        let text = text(
            &slabs([0.0; 3]),
            2,
            &format!("[[interface]]\n{interface}\n"),
        );
        let start = text
            .lines()
            .position(|line| line == "[[interface]]")
            .expect("the section")
            + 1;
        let error = parse(&text, "s.toml", std::path::Path::new(".")).expect_err(interface);
        let place = error.place().expect("a place");
        (
            error
                .terse()
                .split_once("error")
                .expect("an error")
                .1
                .to_owned(),
            place.0 - start,
        )
    };
    let cases = [
        (
            "between = ['uper', 'lower']\nkind = 'bonded'",
            "[E063]: interface.0.between.0: there is no muscle `uper`, did you mean `upper`?; there are: lower, upper",
            1,
        ),
        (
            "between = ['upper', 'upper']\nkind = 'bonded'",
            "[E051]: interface.0.between.1: `upper twice` is not allowed here; give the names of two different muscles",
            1,
        ),
        (
            "between = ['upper']\nkind = 'bonded'",
            "[E051]: interface.0.between: `1 names` is not allowed here; give the names of two muscles",
            1,
        ),
        (
            "between = ['upper', 'lower']\nkind = 'bondd'",
            "[E063]: interface.0.kind: there is no kind `bondd`, did you mean `bonded`?; there are: sliding, bonded",
            2,
        ),
        (
            "between = ['upper', 'lower']\nkind = 'bonded'\nstifness = '1 N/m3'",
            "[E052]: interface.0: unknown key `stifness`, did you mean `stiffness`?; known keys here: between, kind, stiffness, within",
            3,
        ),
        (
            "between = ['upper', 'lower']\nkind = 'bonded'\nstiffness = '1 N/m'",
            "[E058]: interface.0.stiffness: `N/m` is a unit of surface stiffness, not of bond stiffness; known units of bond stiffness: N/m3, kN/m3, MN/m3, N/mm3, N/cm3",
            3,
        ),
        (
            "between = ['upper', 'lower']\nkind = 'sliding'\nwithin = '1 mm'",
            "[E056]: interface.0.within: `kind = \"sliding\"` and `within` exclude each other; keep either `kind = \"sliding\"` or `within`",
            3,
        ),
    ];
    for (interface, message, line) in cases {
        let (found, at) = told(interface);
        assert_eq!(found, message);
        assert_eq!(at, line, "{message}");
    }
    let twice = "between = ['upper', 'lower']\nkind = 'bonded'\n[[interface]]\nbetween = ['lower', 'upper']\nkind = 'sliding'";
    assert!(
        told(twice)
            .0
            .contains("`interface.0` and `interface.1` exclude each other")
    );
}
