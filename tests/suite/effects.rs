//! An omitted effect makes no call, uses no byte, and changes no bit, for every kind of
//! omission.

use std::collections::BTreeMap;
use std::hash::{Hash, Hasher};
use std::path::PathBuf;
use std::sync::OnceLock;

use pliant::io::Encoding;
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::{box_surface, icosphere};
use pliant::scene::{Surroundings, parse_with};
use pliant::simulation::Simulation;
use pliant::testing::internals::io::vtk::write;
use proptest::prelude::*;

use crate::bodies::bits;

/// Form in which a scene requests an effect. Several forms of an effect without influence are
/// numbered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Asked {
    /// Omitted.
    Absent,
    /// With a strength of zero, or out of reach.
    Void,
    /// With influence.
    On,
}
use Asked::{Absent, On, Void};

#[derive(Clone, Copy, Debug)]
struct Wish {
    stretch: Asked,
    bending: Asked,
    volume: Asked,
    anisotropy: Asked,
    tone: Asked,
    contact: Asked,
    fascia: Asked,
    gravity: Asked,
    damping: Asked,
    fibres: bool,
}

/// No effect at all.
const NOTHING: Wish = Wish {
    stretch: Absent,
    bending: Absent,
    volume: Absent,
    anisotropy: Absent,
    tone: Absent,
    contact: Absent,
    fascia: Absent,
    gravity: Absent,
    damping: Absent,
    fibres: false,
};

/// A ball of 2 cm, a plate 1 mm below it, a box far from both, and fibres in the ball.
fn folder() -> &'static PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("effects");
        std::fs::create_dir_all(&folder).expect("the folder of tests can be written");
        let put = |name: &str, mesh: &TriangleMesh, lines: &[Vec<u32>]| {
            write(&folder.join(name), mesh, lines, Encoding::Text)
                .expect("the folder of tests can be written");
        };
        let down = |mut mesh: TriangleMesh, by: f64| {
            mesh.vertices.iter_mut().for_each(|v| v.y -= by);
            mesh
        };
        put("ball.vtk", &icosphere(0.01, 2), &[]);
        put(
            "plate.vtk",
            &down(box_surface([0.1, 0.01, 0.1], 0.05), 0.016),
            &[],
        );
        put("far.vtk", &down(box_surface([0.1; 3], 0.05), 1.0), &[]);
        put("other.vtk", &down(box_surface([0.1; 3], 0.05), 2.0), &[]);
        let points = (-4..=4)
            .map(|i| nalgebra::Point3::new(0.002 * f64::from(i), 0.0, 0.004))
            .collect();
        put(
            "fibres.vtk",
            &TriangleMesh {
                vertices: points,
                triangles: Vec::new(),
            },
            &[(0..9).collect()],
        );
        folder
    })
}

fn scene(wish: &Wish) -> String {
    let bone = |name: &str| format!("[[bone]]\nname = '{name}'\nmesh = '{name}.vtk'\nunit = 'm'\n");
    let stiffness = |asked: Asked, on: &'static str| if asked == Void { "0" } else { on };
    let mut toml = format!(
        "frames = 2\nframe_rate = '60 Hz'\n{}{}",
        bone("far"),
        bone("other")
    );
    if wish.contact == On {
        toml += &bone("plate");
    }
    toml += "[[muscle]]\nname = 'ball'\nmesh = 'ball.vtk'\nunit = 'm'\n[muscle.material]\n";
    let (stretch, bending) = (
        stiffness(wish.stretch, "300"),
        stiffness(wish.bending, "1e-4"),
    );
    toml += &format!("stretch = '{stretch} N/m'\nbending = '{bending} N m'\n");
    toml += "[[muscle.attachment]]\nbone = 'far'\nvertices = [0, 1]\n";
    toml += "[[muscle.attachment]]\nbone = 'other'\nvertices = [2]\n";
    if wish.fibres {
        toml += "[muscle.fibres]\nlines = 'fibres.vtk'\nunit = 'm'\n";
    }
    let mut effect = |asked: Asked, name: &str, void: &str, on: &str| {
        if asked != Absent {
            toml += &format!(
                "[effects.{name}]\n{}\n",
                if asked == Void { void } else { on }
            );
        }
    };
    effect(wish.stretch, "stretch", "", "");
    effect(wish.bending, "bending", "", "");
    effect(wish.volume, "volume", "", "");
    effect(
        wish.anisotropy,
        "anisotropy",
        "strength = 0",
        "strength = 0.5",
    );
    effect(wish.tone, "tone", "stress = '0 Pa'", "stress = '1 kPa'");
    effect(
        wish.contact,
        "contact",
        "thickness = '1 mm'\nbetween = ['bones']",
        "thickness = '1 mm'",
    );
    effect(
        wish.fascia,
        "fascia",
        "stiffness = '0 N/m3'",
        "stiffness = '1e7 N/m3'",
    );
    let gravity = |g: &str| format!("acceleration = ['0 m/s2', '{g} m/s2', '0 m/s2']");
    effect(wish.gravity, "gravity", &gravity("0"), &gravity("-9.81"));
    effect(wish.damping, "damping", "rate = '0 1/s'", "rate = '5 1/s'");
    // Only the classic solver has a volume of no stiffness.
    if wish.volume == Void {
        let on = |asked: Asked| u8::from(asked == On);
        let (stretch, bending) = (on(wish.stretch), on(wish.bending));
        toml += &format!(
            "[solver.pbd]\nstretch = {stretch}\nbending = {bending}\nvolume = 0\nvelocity_damping = 1\n"
        );
    }
    toml
}

/// Traces of a run of two frames.
#[derive(Debug, PartialEq)]
struct Traces {
    /// Effects of the plan and their bytes.
    planned: BTreeMap<String, usize>,
    /// Calls of effects that were timed.
    calls: BTreeMap<&'static str, u64>,
    /// Bytes held by effects.
    bytes: usize,
    gravity: [f64; 3],
    velocity_factor: f64,
    obstacles: usize,
    fibres: usize,
    /// A digest of the bits of all positions and velocities.
    state: u64,
}

fn traces(wish: &Wish) -> Traces {
    let around = Surroundings {
        ..Surroundings::of(folder())
    };
    let parsed = parse_with(&scene(wish), "effects.toml", &around);
    let mut sim = Simulation::new(parsed.unwrap_or_else(|e| panic!("{}", e.terse())))
        .expect("a scene that runs");
    (0..2).for_each(|_| sim.step_frame());
    let body = &sim.bodies[0];
    let system = &body.system;
    let mut digest = std::hash::DefaultHasher::new();
    bits(&system.particles).hash(&mut digest);
    let held = [
        system.volume.as_ref().map_or(0, |v| v.bytes()),
        system.contacts.as_ref().map_or(0, |c| c.bytes()),
    ];
    Traces {
        planned: sim
            .plan
            .run
            .iter()
            .map(|p| (p.effect.clone(), p.bytes))
            .collect(),
        calls: system
            .clock
            .effects
            .iter()
            .map(|(name, (_, calls))| (*name, *calls))
            .collect(),
        bytes: system
            .elastic
            .iter()
            .map(|b| b.usage().bytes)
            .chain(held)
            .sum(),
        gravity: system.settings.gravity.into(),
        velocity_factor: system.settings.velocity_factor,
        obstacles: system.contacts.as_ref().map_or(0, |c| c.obstacles().len()),
        fibres: body.fibres.len(),
        state: digest.finish(),
    }
}

fn asked() -> impl Strategy<Value = Asked> {
    prop::sample::select(vec![Absent, Void, On])
}

fn wish() -> impl Strategy<Value = Wish> {
    let effects = (
        asked(),
        asked(),
        asked(),
        asked(),
        asked(),
        asked(),
        asked(),
        asked(),
        asked(),
        any::<bool>(),
    );
    effects.prop_map(
        |(
            stretch,
            bending,
            volume,
            anisotropy,
            tone,
            contact,
            fascia,
            gravity,
            damping,
            fibres,
        )| Wish {
            stretch,
            bending,
            volume,
            anisotropy,
            tone,
            contact,
            fascia,
            gravity,
            damping,
            fibres,
        },
    )
}

/// The same wish without each part that has no influence. A wish for the classic solver stays
/// one, for comparison within that solver.
fn plain(wish: &Wish) -> Wish {
    let only = |asked: Asked| if asked == On { On } else { Absent };
    let along_fibres = |asked: Asked| match wish.fibres && wish.stretch == On {
        true => only(asked),
        false => Absent,
    };
    let anisotropy = along_fibres(wish.anisotropy);
    let volume = wish.volume;
    // The classic solver has no stiffness in N/m.
    let tone = if volume == Void {
        Absent
    } else {
        along_fibres(wish.tone)
    };
    let [stretch, bending] = [only(wish.stretch), only(wish.bending)];
    let [contact, gravity, damping] = [only(wish.contact), only(wish.gravity), only(wish.damping)];
    // It holds to the bones of contact, by a stiffness in N/m.
    let fascia = if volume == Void || contact == Absent {
        Absent
    } else {
        only(wish.fascia)
    };
    Wish {
        stretch,
        bending,
        volume,
        anisotropy,
        tone,
        contact,
        fascia,
        gravity,
        damping,
        fibres: wish.fibres,
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(48) })]
    #[test]
    fn an_effect_left_out_leaves_no_trace(wish in wish()) {
        let plain = plain(&wish);
        let found = traces(&wish);
        prop_assert_eq!(&found, &traces(&plain), "zero or out of reach is not the same as absent");
        let edges = if plain.tone == On { "fibre distance" } else { "distance" };
        let parts = [
            (plain.stretch, "stretch", edges),
            (plain.bending, "bending", "bending"),
            (plain.volume, "volume", "volume"),
            (plain.contact, "contact with plate", "contact"),
            (plain.fascia, "fascia", "fascia"),
            (plain.tone, "tone", "direction"),
        ];
        for (asked, in_plan, in_clock) in parts {
            prop_assert_eq!(found.planned.contains_key(in_plan), asked == On, "{} in {:?}", in_plan, found.planned);
            prop_assert_eq!(found.calls.contains_key(in_clock), asked == On, "{} in {:?}", in_clock, found.calls);
        }
        for (asked, name) in [(plain.anisotropy, "anisotropy"), (plain.gravity, "gravity"), (plain.damping, "damping")] {
            prop_assert_eq!(found.planned.contains_key(name), asked == On, "{} in {:?}", name, found.planned);
            prop_assert_eq!(found.planned.get(name).copied().unwrap_or(0), 0, "{} needs no memory", name);
        }
        prop_assert!(!found.planned.contains_key("contact with far"), "never in reach");
        prop_assert_eq!(found.obstacles, usize::from(plain.contact == On));
        prop_assert_eq!(found.gravity[1] != 0.0, plain.gravity == On);
        prop_assert_eq!(found.velocity_factor != 1.0, plain.damping == On);
        prop_assert_eq!(found.fibres, usize::from(wish.fibres));
        let any = parts.iter().any(|(asked, ..)| *asked == On);
        prop_assert_eq!(found.bytes > 0, any);
        prop_assert_eq!(found.planned.values().sum::<usize>() > 0, any);
    }
}

/// Negative control: each effect with influence leaves traces that the property would detect. Tone acts
/// where bones move: see `tone.rs`.
#[test]
fn an_effect_that_acts_leaves_a_trace() {
    let moving = Wish {
        gravity: On,
        stretch: On,
        fibres: true,
        ..NOTHING
    };
    let still = traces(&moving);
    // It acts on what lifts off: see `fascia.rs`.
    let on_bone = Wish {
        contact: On,
        ..moving
    };
    let tied = Wish {
        fascia: On,
        ..on_bone
    };
    assert_ne!(traces(&tied).calls, traces(&on_bone).calls);
    let with: [(&str, Wish); 6] = [
        (
            "bending",
            Wish {
                bending: On,
                ..moving
            },
        ),
        (
            "volume",
            Wish {
                volume: On,
                ..moving
            },
        ),
        (
            "anisotropy",
            Wish {
                anisotropy: On,
                ..moving
            },
        ),
        (
            "contact",
            Wish {
                contact: On,
                ..moving
            },
        ),
        (
            "damping",
            Wish {
                damping: On,
                ..moving
            },
        ),
        (
            "gravity",
            Wish {
                gravity: Absent,
                ..moving
            },
        ),
    ];
    for (name, wish) in with {
        let found = traces(&wish);
        assert_ne!(found.state, still.state, "{name} changes nothing");
        assert_ne!(found.planned, still.planned, "{name} is not in the plan");
    }
    // Without effects no effect is called, and the ball stays at rest without an error.
    let nothing = traces(&NOTHING);
    assert_eq!(
        (nothing.bytes, nothing.calls.len(), nothing.planned.len()),
        (0, 0, 0)
    );
}
