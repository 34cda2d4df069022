//! A simulation resumed from a checkpoint has the same bytes as an uninterrupted simulation
//! (P44).

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use pliant::scene::{Scene, builtin::load, parse};
use pliant::simulation::checkpoint::{Checkpoint, Fingerprint, Refused, save, seal};
use pliant::simulation::{Assets, Plan, Simulation};
use pliant::state::{State, Writer};
use pliant::testing::Draw;

/// Bytes of the checksum.
const CHECKSUM: usize = 16;

fn scene(name: &str, overrides: &[&str]) -> Scene {
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    load(name, &overrides).unwrap_or_else(|e| panic!("{}", e.terse()))
}

/// Meshes by their source: creating them takes longer than running a few frames.
static MESHES: Mutex<BTreeMap<String, Assets>> = Mutex::new(BTreeMap::new());

fn made(scene: &Scene) -> Simulation {
    let bones = scene.bones.iter().map(|b| &b.surface).collect::<Vec<_>>();
    let muscles = scene
        .muscles
        .iter()
        .map(|m| (&m.surface, m.edge_length, &m.fibres))
        .collect::<Vec<_>>();
    let key = format!("{bones:?} {muscles:?}");
    let mut all = MESHES.lock().unwrap_or_else(PoisonError::into_inner);
    let load = || Assets::load(scene).unwrap_or_else(|e| panic!("{}", e.terse()));
    let assets = all.entry(key).or_insert_with(load).clone();
    drop(all);
    let plan = Plan::new(scene, &assets);
    Simulation::with(scene.clone(), assets, plan).unwrap_or_else(|e| panic!("{}", e.terse()))
}

fn bytes_of(simulation: &Simulation) -> Vec<u8> {
    let mut writer = Writer::default();
    simulation.save(&mut writer);
    writer.bytes
}

fn checkpoint(simulation: &Simulation) -> Vec<u8> {
    save(simulation, &Fingerprint::of(simulation), b"beside")
}

/// A fresh simulation of `scene` in the state of the checkpoint.
fn resumed(scene: &Scene, bytes: &[u8]) -> Result<Simulation, Refused> {
    let mut simulation = made(scene);
    let fingerprint = Fingerprint::of(&simulation);
    Checkpoint::open(bytes)?.restore(&mut simulation, &fingerprint)?;
    Ok(simulation)
}

/// Runs to the end and keeps the state after each frame; then runs again from a checkpoint at a
/// random frame. Returns the run.
fn check(scene: &Scene, seed: u64) -> Simulation {
    let mut draw = Draw::new(seed);
    let stop = draw.index(scene.frames);
    let mut straight = made(scene);
    let mut states = vec![bytes_of(&straight)];
    let mut kept = (stop == 0).then(|| checkpoint(&straight));
    while straight.frame() < scene.frames {
        straight.step_frame();
        states.push(bytes_of(&straight));
        if straight.frame() == stop {
            kept = Some(checkpoint(&straight));
        }
    }
    let places = |s: &Simulation| {
        s.bodies
            .iter()
            .map(|b| b.system.particles.position.clone())
            .collect::<Vec<_>>()
    };
    assert_ne!(
        places(&straight),
        places(&made(scene)),
        "nothing moves: the test would show little"
    );
    let kept = kept.expect("the frame of the checkpoint");
    let mut again =
        resumed(scene, &kept).unwrap_or_else(|e| panic!("{}, seed {seed}: {e}", scene.name));
    assert_eq!(again.frame(), stop);
    assert!(
        checkpoint(&again) == kept,
        "{}, seed {seed}: saved, loaded and saved again it differs",
        scene.name
    );
    for (frame, state) in states.iter().enumerate().skip(stop + 1) {
        again.step_frame();
        assert!(
            bytes_of(&again) == *state,
            "{}, seed {seed}: from {stop}, frame {frame} differs",
            scene.name
        );
    }
    let numbers = |s: &Simulation| format!("{:?}", s.measure());
    assert_eq!(numbers(&again), numbers(&straight), "{}", scene.name);
    straight
}

#[test]
fn p44_tetrahedra_and_the_chain() {
    for seed in 0..2 {
        check(&scene("distance", &["frames=12"]), seed);
        check(
            &scene(
                "distance",
                &["frames=12", "solver=xpbd", "effects.damping.rate=1 1/s"],
            ),
            seed,
        );
        check(&scene("shape", &["frames=12"]), seed);
        check(&scene("volume", &["frames=12"]), seed);
        check(
            &scene("chain", &["frames=6", "pbd.velocity_damping=0.9"]),
            seed,
        );
    }
}

/// The hip, coarse.
const HIP: [&str; 3] = [
    "frames=8",
    "muscle.0.edge_length=9 mm",
    "bone.femur.motion.keys=[{frame=0,angle='0 rad'},{frame=8,angle='0.4 rad'}]",
];

fn hip(more: &[&str]) -> Scene {
    scene("hip", &[&HIP, more].concat())
}

fn touching(simulation: &Simulation) -> usize {
    simulation
        .measure()
        .iter()
        .map(|m| m.vertices_touching)
        .sum()
}

#[test]
fn p44_hip_by_small_steps() {
    assert!(touching(&check(&hip(&["substeps=10", "contact.friction=0.3"]), 1)) > 0);
    check(&hip(&["solver=pbd", "pbd.substeps=4"]), 2);
}

#[test]
fn p44_hip_at_equilibrium() {
    assert!(
        touching(&check(
            &hip(&["solver=quasi_static", "quasi_static.iterations=60"]),
            3
        )) > 0
    );
    assert!(
        touching(&check(
            &hip(&["solver=implicit_euler", "implicit_euler.iterations=40"]),
            4
        )) > 0
    );
}

#[test]
fn p44_press() {
    let keys = |sign: f64| {
        let key = |frame: u32, y: f64| {
            format!(
                "{{frame={frame},translation=['0 mm','{} mm','0 mm']}}",
                sign * y
            )
        };
        format!("[{},{}]", key(0, 32.0), key(8, 20.0))
    };
    let [upper, lower] = [("upper plate", 1.0), ("lower plate", -1.0)]
        .map(|(name, sign)| format!("bone.'{name}'.motion.keys={}", keys(sign)));
    let small = [
        "frames=8",
        "muscle.0.edge_length=14 mm",
        "substeps=12",
        &upper,
        &lower,
    ];
    assert!(touching(&check(&scene("press", &small), 7)) > 0);
    let small = [
        "frames=8",
        "muscle.0.edge_length=14 mm",
        "solver=implicit_euler",
        &upper,
        &lower,
    ];
    assert!(touching(&check(&scene("press", &small), 8)) > 0);
}

/// Two muscles. One is fixed by a plate; the other begins displaced, outside the planned box,
/// and meets it.
fn fallen(solver: &str) -> Scene {
    let count = {
        let text = two_muscles("", solver);
        let scene =
            parse(&text, "s.toml", Path::new(".")).unwrap_or_else(|e| panic!("{}", e.terse()));
        made(&scene).bodies[1].rest.vertices.len()
    };
    let all: Vec<u32> = (0..count as u32).collect();
    let moved =
        format!("[[muscle.displace]]\nvertices = {all:?}\nby = [\"0 mm\", \"-83 mm\", \"0 mm\"]\n");
    parse(&two_muscles(&moved, solver), "s.toml", Path::new("."))
        .unwrap_or_else(|e| panic!("{}", e.terse()))
}

fn two_muscles(displace: &str, solver: &str) -> String {
    format!(
        r#"
name = "two"
frames = 6
frame_rate = "60 Hz"
[[bone]]
name = "plate"
shape = "press-plate"
[bone.motion]
keys = [
    {{ frame = 0, translation = ["0 mm", "-120 mm", "0 mm"] }},
    {{ frame = 6, translation = ["0 mm", "-105 mm", "0 mm"] }},
]
[[capsule]]
name = "rod"
bone = "plate"
from = ["-50 mm", "100 mm", "0 mm"]
to = ["50 mm", "100 mm", "0 mm"]
radius = "5 mm"
[[muscle]]
name = "held"
shape = "press-muscle"
edge_length = "15 mm"
[muscle.material]
density = "1060 kg/m3"
stretch = "100 N/m"
bending = "2e-4 N m"
bulk = "20 kPa"
[[muscle.attachment]]
bone = "plate"
vertices = [0, 1, 2]
[[muscle]]
name = "moved"
shape = "press-muscle"
edge_length = "15 mm"
[muscle.material]
density = "1060 kg/m3"
stretch = "100 N/m"
bending = "2e-4 N m"
{displace}
[effects.stretch]
[effects.bending]
[effects.volume]
[effects.contact]
thickness = "0.5 mm"
friction = 0.2
between = ["bones", "self"]
[effects.damping]
rate = "5 1/s"
{solver}
"#
    )
}

#[test]
fn p44_several_muscles_and_contact_that_the_plan_did_not_foresee() {
    let scene = fallen("[solver.xpbd]\nsubsteps = 10");
    let before: Vec<usize> = made(&scene).plan.muscles[1].obstacles.clone();
    for seed in 0..2 {
        let end = check(&scene, 40 + seed);
        let after = end.bodies[1]
            .system
            .contacts
            .as_ref()
            .map_or(&[][..], |c| c.obstacles());
        assert!(
            before.len() < after.len(),
            "{before:?} {after:?}: no contact came up"
        );
        assert!(end.notes.iter().any(|note| note.contains("left the box")));
    }
    check(&fallen("[solver.implicit_euler]\niterations = 30"), 50);
}

#[test]
fn p44_a_stopped_muscle_stays_stopped() {
    let force = "muscle.0.force.0.force=['0 N', '0 N', '1e308 N']";
    let scene = scene(
        "distance",
        &["frames=3", force, "muscle.0.material.vertex_mass=1 g"],
    );
    let mut simulation = made(&scene);
    simulation.step_frame();
    let stopped = simulation.bodies[0].stopped.clone();
    assert!(stopped.is_some(), "control: it runs");
    let mut again = resumed(&scene, &checkpoint(&simulation)).expect("its own checkpoint");
    assert_eq!(again.bodies[0].stopped, stopped);
    simulation.step_frame();
    again.step_frame();
    assert!(bytes_of(&again) == bytes_of(&simulation));
}

#[test]
fn p44_lanes_and_threads_do_not_matter() {
    let scene = hip(&["substeps=6"]);
    let mut straight = made(&scene);
    (0..2).for_each(|_| straight.step_frame());
    let kept = checkpoint(&straight);
    straight.step_frame();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(3)
        .build()
        .expect("a pool");
    let mut again = resumed(&scene, &kept).expect("its own checkpoint");
    let batches = again.bodies.iter_mut().flat_map(|b| &mut b.system.elastic);
    batches
        .for_each(|batch| batch.set_width(pliant::testing::internals::constraints::SimdWidth::One));
    pool.install(|| again.step_frame());
    assert!(bytes_of(&again) == bytes_of(&straight));
}

/// What was run before matters, and equal bytes are no accident.
#[test]
fn p44_control_what_is_forgotten_or_changed_shows() {
    let scene = hip(&["substeps=10"]);
    let mut straight = made(&scene);
    (0..5).for_each(|_| straight.step_frame());
    let kept = checkpoint(&straight);
    let particles = straight.bodies[0].system.particles.clone();
    straight.step_frame();
    let expected = bytes_of(&straight);
    // Everything but the memory of contact, which is that of the start.
    let mut forgetful = resumed(&scene, &kept).expect("its own checkpoint");
    forgetful.bodies[0].system.contacts = made(&scene).bodies.remove(0).system.contacts;
    forgetful.step_frame();
    assert!(
        bytes_of(&forgetful) != expected,
        "contact was forgotten and nothing differs"
    );
    // A low bit of one position, large enough to survive the rounding of a step, with a matching
    // checksum.
    let x = straight_position(&kept, &particles);
    let mut changed = kept[..kept.len() - CHECKSUM].to_vec();
    changed[x + 1] ^= 1;
    assert!(matches!(
        resumed(&scene, &[&changed, &kept[kept.len() - CHECKSUM..]].concat()),
        Err(Refused::Checksum)
    ));
    let mut other = resumed(&scene, &seal(changed)).expect("a state as good as any");
    other.step_frame();
    assert!(
        bytes_of(&other) != expected,
        "a changed position leads to the same bytes"
    );
}

/// Offset of the first coordinate of the first free vertex.
fn straight_position(kept: &[u8], particles: &pliant::Particles) -> usize {
    let free = particles
        .inverse_mass
        .iter()
        .position(|w| *w > 0.0)
        .expect("a free vertex");
    let bits = particles.position[free].x.to_le_bytes();
    kept.windows(8).position(|w| w == bits).expect("its bits")
}

#[test]
fn p44_every_cut_and_every_flipped_bit_is_refused() {
    let scene = scene("distance", &["frames=3"]);
    let mut simulation = made(&scene);
    simulation.step_frame();
    let kept = checkpoint(&simulation);
    assert!(
        resumed(&scene, &kept).is_ok(),
        "control: the bytes as they are"
    );
    for end in 0..kept.len() {
        assert!(Checkpoint::open(&kept[..end]).is_err(), "cut at {end}");
    }
    let longer = [&kept[..], &[0]].concat();
    assert!(matches!(
        Checkpoint::open(&longer),
        Err(Refused::Length { .. })
    ));
    for at in 0..kept.len() {
        for bit in 0..8 {
            let mut flipped = kept.clone();
            flipped[at] ^= 1 << bit;
            assert!(
                Checkpoint::open(&flipped).is_err(),
                "bit {bit} of byte {at}"
            );
        }
    }
    // A large scene, at random places.
    let hip = hip(&[
        "solver=quasi_static",
        "quasi_static.iterations=20",
        "frames=2",
    ]);
    let mut simulation = made(&hip);
    simulation.step_frame();
    let kept = checkpoint(&simulation);
    let mut draw = Draw::new(44);
    for _ in 0..8 {
        let mut flipped = kept.clone();
        flipped[draw.index(kept.len())] ^= 1 << draw.index(8);
        assert!(Checkpoint::open(&flipped).is_err(), "seed {}", draw.seed);
        assert!(
            Checkpoint::open(&kept[..draw.index(kept.len())]).is_err(),
            "seed {}",
            draw.seed
        );
    }
}

#[test]
fn p44_other_versions_and_other_scenes_are_refused_by_name() {
    let scene_of = |more: &[&str]| scene("distance", &[&["frames=3"], more].concat());
    let of = |scene: &Scene| checkpoint(&made(scene));
    let base = scene_of(&[]);
    let kept = of(&base);
    assert_eq!(
        Checkpoint::open(b"# vtk DataFile").unwrap_err(),
        Refused::NoCheckpoint
    );
    // An older crate, and an older format.
    let version = env!("CARGO_PKG_VERSION");
    let at = kept
        .windows(version.len())
        .position(|w| w == version.as_bytes())
        .expect("the version");
    let mut older = kept[..kept.len() - CHECKSUM].to_vec();
    older[at + version.len() - 1] = b'~';
    let text = Checkpoint::open(&seal(older)).unwrap_err().to_string();
    assert!(
        text.contains("was written by pliant 0.1.~")
            && text.contains(&format!("this is pliant {version}")),
        "{text}"
    );
    let mut older = kept[..kept.len() - CHECKSUM].to_vec();
    older[8] = 0;
    let text = Checkpoint::open(&seal(older)).unwrap_err().to_string();
    assert!(
        text.contains("(format 0)") && text.contains("(format 11)"),
        "{text}"
    );
    // A longer run counts as the same run; a shorter run lacks the frame.
    assert!(resumed(&scene_of(&["frames=9"]), &kept).is_ok());
    let mut later = made(&base);
    (0..2).for_each(|_| later.step_frame());
    let error = resumed(&scene_of(&["frames=1"]), &checkpoint(&later)).err();
    assert_eq!(
        error,
        Some(Refused::Beyond {
            frame: 2,
            frames: 1
        })
    );
    let differs = |scene: &Scene, kept: &[u8]| match resumed(scene, kept) {
        Err(Refused::Differs(names)) => names.join("; "),
        other => panic!("{:?}", other.err()),
    };
    let others = [
        ("iterations=9", "`solver`"),
        ("solver=xpbd", "`solver`"),
        ("frame_rate=61 Hz", "`frame_rate`"),
        ("name=other", "the name of the scene"),
        ("effects.damping.rate=2 1/s", "`effects`"),
        (
            "muscle.0.material.vertex_mass=2 g",
            "the material of muscle `muscle`",
        ),
        (
            "muscle.0.force.0.force=['0 N', '0 N', '1 N']",
            "the forces on muscle `muscle`",
        ),
    ];
    for (change, name) in others {
        let found = differs(&scene_of(&[change]), &kept);
        assert!(found.contains(name), "{change}: {found}");
    }
    let hip = |more: &str| {
        scene(
            "hip",
            &[
                "frames=100",
                "muscle.0.edge_length=12 mm",
                "substeps=2",
                more,
            ],
        )
    };
    let kept = of(&hip("iterations=1"));
    let others = [
        ("contact.thickness=0.6 mm", "`effects`"),
        ("muscle.0.edge_length=11 mm", "the mesh of muscle `gluteus`"),
        (
            "bone.femur.motion.axis=[1,0,0]",
            "the motion of bone `femur`",
        ),
        (
            "muscle.0.attachment.0.near=6 mm",
            "the attachments of muscle `gluteus`",
        ),
    ];
    for (change, name) in others {
        let found = differs(&hip(change), &kept);
        assert!(found.contains(name), "{change}: {found}");
    }
}
