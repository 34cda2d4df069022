//! Scene files: every built-in and example scene can be read, and overrides change the values
//! that they name. `refused` has the exact message of every kind of mistake; `mutations` has the
//! texts that must not make the reader panic.

mod mutations;
mod refused;

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use pliant::scene::Minimisation;
use pliant::scene::builtin::{BUILTIN, builtin, load, load_content, load_with};
use pliant::scene::{
    self, Accuracy, AreaSpec, Content, Mass, Scene, SceneError, Solver, Source, Support,
    Surroundings, SweepOrder, parse_content,
};
use pliant::skin::{ImplantPlace, SILICONE, Tissue};
use pliant::springs::Neighbours;

/// The smallest scene, the basis of scenes with mistakes.
const SMALL: &str = r#"frames = 3
frame_rate = "60 Hz"
[[bone]]
name = "femur"
shape = "hip-femur"
[[muscle]]
name = "calf"
shape = "tetrahedron"
"#;

/// A folder with the files that the layout names, all empty.
fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("scene");
    std::fs::create_dir_all(&folder).expect("the folder of tests can be written");
    for name in [
        "femur.obj",
        "gluteus.obj",
        "patch.obj",
        "fibres.vtk",
        "skin.obj",
        "ribs.obj",
    ] {
        std::fs::write(folder.join(name), "").expect("the folder of tests can be written");
    }
    folder
}

/// The only variable is `HERE`, the folder of the tests.
fn variable(name: &str) -> Option<OsString> {
    (name == "HERE").then(|| folder().into_os_string())
}

fn read_with(text: &str, overrides: &[&str]) -> Result<Scene, SceneError> {
    let overrides: Vec<String> = overrides.iter().map(|&o| o.to_owned()).collect();
    let folder = folder();
    let around = Surroundings {
        variable: &variable,
        overrides: &overrides,
        ..Surroundings::of(&folder)
    };
    scene::parse_with(text, "s.toml", &around)
}

fn read(text: &str) -> Result<Scene, SceneError> {
    read_with(text, &[])
}

/// The one-line message of a scene that must be rejected.
fn terse(text: &str) -> String {
    match read(text) {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(error) => error.terse(),
    }
}

/// The small scene with a replaced text, which must occur.
fn spoilt(from: &str, to: &str) -> String {
    assert!(SMALL.contains(from), "{from}");
    SMALL.replacen(from, to, 1)
}

/// The small scene with a text appended.
fn with(more: &str) -> String {
    format!("{SMALL}{more}")
}

#[test]
fn the_layout_of_the_documentation_is_a_scene() {
    let scene = read(include_str!("../../src/scene/layout.toml")).expect("the layout is a scene");
    assert_eq!(
        (scene.name.as_str(), scene.frames, scene.frame_rate),
        ("right-hip", 300, 60.0)
    );
    assert_eq!(scene.bones[0].motion.keys.len(), 4);
    assert_eq!(scene.capsules[0].radius, 0.03);
    let muscle = &scene.muscles[0];
    assert_eq!(
        muscle.surface,
        Source::File {
            path: folder().join("gluteus.obj"),
            scale: 1e-3
        }
    );
    assert_eq!(
        (muscle.edge_length, muscle.material.bulk),
        (Some(0.004), Some(20e3))
    );
    assert_eq!(
        (muscle.material.mass, muscle.material.stretch),
        (Mass::Density(1060.0), 300.0)
    );
    let areas: Vec<&AreaSpec> = muscle.attachments.iter().map(|a| &a.area).collect();
    assert!(matches!(
        areas[..],
        [
            AreaSpec::Near(_),
            AreaSpec::Patch {
                component: Some(0),
                ..
            },
            AreaSpec::Vertices(_)
        ]
    ));
    assert_eq!(
        muscle
            .attachments
            .iter()
            .map(|a| a.limit)
            .collect::<Vec<_>>(),
        [0.05, 0.1, 0.1]
    );
    assert_eq!(scene.effects.gravity.map(|g| g.y), Some(-9.81));
    assert_eq!(
        scene.effects.anisotropy.map(|a| (a.strength, a.power)),
        Some((0.5, 1.0))
    );
    // A limit of the scene replaces the default, also where they agree.
    assert_eq!(scene.limits.hinge, Some(60_f64.to_radians()));
    assert_eq!(scene.limits.lift_off, Some(3e-3));
    // The layout states the defaults of the solver.
    let default = read(SMALL).expect("the small scene is one");
    assert_eq!(default.solver, scene.solver);
    assert_eq!(
        (default.name.as_str(), default.effects),
        ("s", scene::Effects::default())
    );
}

/// The layout of one of the scenes without muscles.
fn without_muscles(text: &str) -> Content {
    let (folder, variable) = (folder(), |_: &str| None);
    let around = Surroundings {
        variable: &variable,
        ..Surroundings::of(&folder)
    };
    match parse_content(text, "s.toml", &around).unwrap_or_else(|e| panic!("{e:?}")) {
        Content::Muscles(_) => panic!("a scene of muscles"),
        content => content,
    }
}

#[test]
fn the_layouts_of_skin_and_of_a_lattice_are_scenes() {
    let Content::Skin(scene) = without_muscles(include_str!("../../src/scene/layout-skin.toml"))
    else {
        panic!("no skin")
    };
    assert_eq!(
        (scene.name.as_str(), scene.frames, scene.obstacles.len()),
        ("flat", 3, 1)
    );
    let Support::Implants(implants) = &scene.under else {
        panic!("no implants")
    };
    let volumes = |k: usize| [1, 2, 3].map(|frame| (implants[k].volume_at(frame) * 1e7).round());
    assert_eq!(
        (volumes(0), volumes(1)),
        ([333.0, 667.0, 1000.0], [100.0, 250.0, 400.0])
    );
    // It states the defaults.
    let [tissue, default] = [implants[0].order.tissue, Tissue::default()];
    assert_eq!(
        (tissue, implants[0].order.implant.membrane),
        (default, SILICONE)
    );
    assert_eq!(implants[1].order.place, ImplantPlace::Vertex(911));
    let Content::Lattice(scene) =
        without_muscles(include_str!("../../src/scene/layout-lattice.toml"))
    else {
        panic!("no lattice")
    };
    assert_eq!(
        (scene.points, scene.neighbours, scene.release),
        ([12; 3], Neighbours::TwentySix, 30)
    );
    let Content::Geometric(scene) =
        without_muscles(include_str!("../../src/scene/layout-geometric.toml"))
    else {
        panic!("no geometric muscle")
    };
    assert_eq!(scene.shape.radii[4], 0.01);
    assert_eq!((scene.frames, scene.insert), (60, 0));
    assert!(
        scene
            .fixed_length
            .is_some_and(|length| (length - 0.21).abs() <= 1e-15)
    );
}

#[test]
fn a_key_of_the_only_element_needs_no_number() {
    let volume = |change: &str| {
        let Content::Skin(scene) =
            load_content("flat-implant", &[change.to_owned()]).expect("a scene")
        else {
            panic!("no skin")
        };
        let Support::Implants(implants) = &scene.under else {
            panic!("no implants")
        };
        implants[0].order.implant.volume
    };
    for change in [
        "implant.volume=50cc",
        "implant.0.volume=50 cc",
        "implant.*.volume=0.05 l",
    ] {
        assert!((volume(change) - 50e-6).abs() <= 1e-18, "{change}");
    }
    // With two bones the override must name one.
    let error = load_content("hip", &["bone.shape=hip-femur".to_owned()]).expect_err("two bones");
    assert!(
        error.terse().contains("there is no element `shape`")
            || error.terse().contains("is a section"),
        "{error:?}"
    );
}

#[test]
fn a_scene_without_muscles_is_none_of_muscles() {
    let error = load("flat-implant", &[]).expect_err("no muscles");
    assert!(
        error
            .terse()
            .ends_with("error[E055]: `muscle` is missing; add a section [[muscle]]"),
        "{error:?}"
    );
}

#[test]
fn the_defaults_of_classic_pbd_are_those_of_the_layout() {
    let stated = "[solver.pbd]\nsubsteps = 1\niterations = 3\nstretch = 1\nbending = 0.9\nvolume = 1\n\
                  velocity_damping = 0.99\norder = 'coloured'\ntolerance = 0.01\n";
    let layout = include_str!("../../src/scene/layout.toml").replace("\n# ", " ");
    for line in stated.lines().skip(1) {
        assert!(layout.contains(&line.replace('\'', "\"")), "{line}");
    }
    let read = |text: &str| read(&with(text)).expect("a scene").solver;
    assert_eq!(read("[solver.pbd]\n"), read(stated));
}

#[test]
fn an_error_has_its_place_in_the_text() {
    let error = read(&with("[effects.contact]\ntickness = '1 mm'\n")).expect_err("refused");
    assert_eq!(
        (error.key(), error.place(), error.problem().code()),
        ("effects.contact", Some((10, 1)), "E052")
    );
    assert_eq!(error.source_name(), "s.toml");
    assert_eq!(&error.source_text()[error.span()], "tickness");
}

/// The message of an override of a built-in scene that must be rejected.
fn refused_override(name: &str, text: &str) -> String {
    match load(name, &[text.to_owned()]) {
        Ok(_) => panic!("accepted: {text}"),
        Err(error) => error.terse(),
    }
}

/// A built-in scene with overrides.
fn changed(name: &str, overrides: &[&str]) -> Scene {
    let overrides: Vec<String> = overrides.iter().map(|&o| o.to_owned()).collect();
    load(name, &overrides).expect("the overrides are good")
}

#[test]
fn overrides_change_what_they_name() {
    let accuracy = |text: &str| changed("hip", &[text]).accuracy;
    assert_eq!(
        accuracy("accuracy=2 % of motion"),
        Some(Accuracy::OfMotion(0.02))
    );
    assert_eq!(accuracy("accuracy=2 %"), Some(Accuracy::Share(0.02)));
    assert_eq!(accuracy("accuracy=2 mm"), Some(Accuracy::Length(2e-3)));
    // Not 200 %.
    assert!(refused_override("hip", "accuracy=2 of motion").contains("accuracy"));
    let friction = |overrides: &[&str]| {
        changed("hip", overrides)
            .effects
            .contact
            .map(|c| c.friction)
    };
    assert_eq!(friction(&[]), Some(0.0));
    assert_eq!(friction(&["effects.contact.friction=0.3"]), Some(0.3));
    assert_eq!(
        friction(&["contact.friction = 0.3", "contact.friction=0.4"]),
        Some(0.4)
    );
    assert_eq!(friction(&["effects.contact=none"]), None);
    assert_eq!(friction(&["contact=off"]), None);
    assert_eq!(
        friction(&["contact=off", "contact.thickness=1 mm"]),
        Some(0.0)
    );
    for path in ["0", "gluteus", "*", "\"gluteus\"", "'gluteus'"] {
        let scene = changed("hip", &[&format!("muscle.{path}.edge_length=3 mm")]);
        assert_eq!(scene.muscles[0].edge_length, Some(0.003), "{path}");
    }
    assert_eq!(
        changed("hip", &["muscle.0.edge_length=\"3 mm\""]).muscles[0].edge_length,
        Some(0.003)
    );
    assert_eq!(changed("hip", &["name=7"]).name, "7");
    assert_eq!(changed("hip", &["frames=7"]).frames, 7);
    let y = changed(
        "hip",
        &["gravity.acceleration=['0 m/s2', '-1 m/s2', '0 m/s2']"],
    )
    .effects
    .gravity
    .map(|g| g.y);
    assert_eq!(y, Some(-1.0));
    assert!(changed("shape", &["stretch=on"]).effects.stretch);
    assert!(
        changed("hip", &["muscle.0.fibres=off"]).muscles[0]
            .fibres
            .is_none()
    );
    // An element of a list is removed by its name, number or all at once.
    for path in ["gluteus", "0", "*"] {
        let left = refused_override("hip", &format!("muscle.{path}=off"));
        assert!(left.contains("muscle"), "{path}: {left}");
    }
    let one = changed("hip", &["muscle.0.attachment.1=off"]);
    assert_eq!(one.muscles[0].attachments.len(), 1);
    let whole = changed("hip", &[]);
    assert_eq!(
        one.muscles[0].attachments[0],
        whole.muscles[0].attachments[0]
    );
    let both = changed("hip", &["muscle.0.attachment.*.limit=2 %"]);
    assert!(both.muscles[0].attachments.iter().all(|a| a.limit == 0.02));
}

#[test]
fn overrides_change_the_solver() {
    let steps = |name: &str, overrides: &[&str]| match changed(name, overrides).solver {
        Solver::Xpbd(x) => ("xpbd", x.substeps, x.iterations, x.order),
        Solver::Pbd(p) => ("pbd", p.substeps, p.iterations, p.order),
        Solver::ImplicitEuler(q) => (
            "implicit_euler",
            q.substeps,
            q.iterations,
            SweepOrder::default(),
        ),
        Solver::QuasiStatic(q) => (
            "quasi_static",
            q.substeps,
            q.iterations,
            SweepOrder::default(),
        ),
    };
    assert_eq!(
        steps("hip", &["substeps=40"]),
        ("xpbd", 40, 1, SweepOrder::Coloured)
    );
    assert_eq!(
        steps("hip", &["solver.xpbd.substeps=40"]),
        ("xpbd", 40, 1, SweepOrder::Coloured)
    );
    assert_eq!(
        steps("chain", &["order=stored"]),
        ("pbd", 1, 1, SweepOrder::Stored)
    );
    assert_eq!(
        steps("hip", &["solver=pbd"]),
        ("pbd", 1, 3, SweepOrder::Coloured)
    );
    assert_eq!(
        steps("hip", &["solver=pbd", "iterations=10"]),
        ("pbd", 1, 10, SweepOrder::Coloured)
    );
    assert_eq!(
        steps("chain", &["solver=none"]),
        ("xpbd", 20, 1, SweepOrder::Coloured)
    );
    assert_eq!(
        steps("hip", &["solver.xpbd=none", "pbd.iterations=5"]),
        ("pbd", 1, 5, SweepOrder::Coloured)
    );
    let rest = changed(
        "hip",
        &["solver=quasi_static", "iterations=7", "tolerance=0.001"],
    )
    .solver;
    assert_eq!(
        rest,
        Solver::QuasiStatic(Minimisation {
            substeps: 1,
            iterations: 7,
            tolerance: 0.001
        })
    );
    let steps = changed("hip", &["solver=implicit_euler", "substeps=4"]).solver;
    assert_eq!(
        steps,
        Solver::ImplicitEuler(Minimisation {
            substeps: 4,
            iterations: 500,
            tolerance: 2e-4
        })
    );
}

#[test]
fn wrong_overrides_name_themselves() {
    let cases = [
        (
            "effects.contact.frction=0.3",
            "error[E052]: effects.contact: unknown key `frction`, did you mean `friction`?; \
          known keys here: thickness, friction, between",
        ),
        (
            "effect.contact.friction=0.3",
            "error[E052]: unknown key `effect`, did you mean `effects`?; \
          known keys here: name, frames, frame_rate, accuracy, mesh_error, up, limits, bone, opensim, capsule, muscle, interface, effects, solver, \
          skin, sheet, implant, ball, obstacle, lattice, radii, grow_mults, length, unit, frame, \
         min_part, max_part, insert, caps, fixed_length, spring_body, rigid_body, acceleration, collision",
        ),
        (
            "contact.friction=-1",
            "error[E051]: effects.contact.friction: `-1` is not allowed here; \
          give a number of at least zero",
        ),
        (
            "contact.thickness=2",
            "error[E050]: effects.contact.thickness: `2` has no unit; \
          write \"2 mm\"; known units of length: m, dm, cm, mm, um, km, in",
        ),
        (
            "contact",
            "error[E068]: there is no `=`; write PATH=VALUE, for example effects.contact.friction=0.3",
        ),
        (
            "=3",
            "error[E068]: the path is not one; write PATH=VALUE, for example effects.contact.friction=0.3",
        ),
        (
            "a..b=3",
            "error[E068]: the path is not one; write PATH=VALUE, for example effects.contact.friction=0.3",
        ),
        (
            "frames= ",
            "error[E068]: there is no value; write PATH=VALUE, for example effects.contact.friction=0.3",
        ),
        (
            "contact=0.3",
            "error[E068]: effects.contact: `effects.contact` is a section, not a value; \
          give a key below it, or `on`, or `off` to remove it",
        ),
        (
            "frames.x=3",
            "error[E068]: frames: `frames` is a single value; nothing is below it; write frames=VALUE",
        ),
        (
            "muscle.1.edge_length=3 mm",
            "error[E051]: muscle: the number 1 is not allowed here; \
          give a number below 1, they are counted from 0",
        ),
        (
            "muscle.gluteos.edge_length=3 mm",
            "error[E063]: muscle: there is no element `gluteos`, \
          did you mean `gluteus`?; there are: gluteus",
        ),
        (
            "muscle.0=3",
            "error[E068]: muscle: `muscle.0` is a section, not a value; name one of its keys: name, mesh, \
          shape, unit, repair, close_holes, cut_handles, keep_largest, merge_within, edge_length, material, attachment, fibres, activation, force, displace",
        ),
        (
            "capsule.0.radius=3 mm",
            "error[E068]: capsule: the scene has no `capsule`; add [[capsule]] to it",
        ),
        (
            "solver.pbd=on",
            "error[E056]: solver.pbd: `xpbd` and `pbd` exclude each other; keep either `xpbd` or `pbd`",
        ),
        (
            "gravity=on",
            "error[E055]: effects.gravity: `acceleration` is missing; \
          add `acceleration = [\"0 m/s2\", \"-9.81 m/s2\", \"0 m/s2\"]`",
        ),
    ];
    for (text, message) in cases {
        assert_eq!(
            refused_override("hip", text),
            format!("change {text}: {message}")
        );
    }
    // An error of the file has its place in the file, whatever the overrides.
    let error = read_with(
        &spoilt("frames = 3", "frames = 0"),
        &["contact.thickness=1 mm"],
    )
    .expect_err("refused");
    assert!(
        error.terse().starts_with("s.toml:1:10: error[E051]"),
        "{error:?}"
    );
}

#[test]
fn every_built_in_is_a_scene_of_its_name() {
    for &(name, text, line) in BUILTIN {
        let scene = load_content(name, &[]).unwrap_or_else(|e| panic!("{e:?}"));
        assert_eq!((scene.name(), builtin(name)), (name, Some(text)));
        assert!(!line.is_empty() && line.len() < 80);
    }
    let scene = changed("hip", &[]);
    let reach = scene.bones[1].motion.pose(100.0).rotation.scaled_axis();
    assert!((reach + nalgebra::Vector3::x()).norm() < 1e-15, "{reach}");
    assert_eq!(
        scene.bones[1].motion.pose(250.0),
        nalgebra::Isometry3::identity()
    );
    assert_eq!(
        scene.muscles[0].fibres,
        Some(Source::Shape("hip-gluteus".to_owned()))
    );
    let scene = changed("press", &[]);
    let gap = |frame: f64| {
        let y = |bone: usize| scene.bones[bone].motion.pose(frame).translation.y;
        y(0) - y(1) - 0.02
    };
    for (frame, expected) in [
        (0.0, 0.044),
        (50.0, 0.0242),
        (100.0, 0.0044),
        (200.0, 0.044),
        (300.0, 0.044),
    ] {
        assert!(
            (gap(frame) - expected).abs() < 1e-15,
            "{frame}: {}",
            gap(frame)
        );
    }
}

#[test]
fn a_name_is_a_file_or_a_built_in() {
    let terse = |name: &str| load(name, &[]).expect_err(name).terse();
    assert_eq!(
        terse("hop"),
        "hop: error[E063]: there is no scene `hop`, did you mean `hip`?; \
         there are: hip, press, distance, shape, volume, chain, cube, sheet, flat-implant, expander, lattice, jelly"
    );
    assert_eq!(
        terse("hip.toml"),
        "hip.toml: error[E060]: no file `hip.toml`; name a scene file, or one of the scenes that `pliant scenes` lists"
    );
    let file = folder().join("calf.toml");
    std::fs::write(&file, SMALL).expect("the folder of tests can be written");
    let name = file.to_str().expect("the folder of tests has a plain name");
    assert_eq!(
        load(name, &[]).map(|s| s.name).ok().as_deref(),
        Some("calf")
    );
    let binary = folder().join("binary.toml");
    std::fs::write(&binary, *b"name = \"caf\xe9\"").expect("the folder of tests can be written");
    let message = terse(
        binary
            .to_str()
            .expect("the folder of tests has a plain name"),
    );
    assert!(
        message.contains("cannot be read: byte 11 (0xe9) begins no character of UTF-8; save"),
        "{message}"
    );
}

/// Equal numbers of bones and muscles, each muscle fixed to its own bone.
fn crowd(count: usize) -> String {
    let mut text = "frames = 3\nframe_rate = '60 Hz'\n".to_owned();
    (0..count).for_each(|i| text += &format!("[[bone]]\nname = 'bone {i}'\nshape = 'hip-femur'\n"));
    let held = |i| format!("[[muscle.attachment]]\nbone = 'bone {i}'\nvertices = [0]\n");
    (0..count).for_each(|i| {
        text += &format!(
            "[[muscle]]\nname = 'muscle {i}'\nshape = 'chain'\n{}",
            held(i)
        )
    });
    text
}

// A search of all names for each name would take 10^8 comparisons of texts here.
#[test]
fn names_are_told_apart_and_found_among_20_000() {
    let text = crowd(10_000);
    let scene = read(&text).expect("a scene");
    assert_eq!((scene.bones.len(), scene.muscles.len()), (10_000, 10_000));
    assert!(
        scene
            .muscles
            .iter()
            .enumerate()
            .all(|(i, m)| m.attachments[0].bone == i)
    );
    let misspelt = terse(&text.replacen("bone = 'bone 7'", "bone = 'bonne 7'", 1));
    assert!(
        misspelt.ends_with("bone 10, bone 11 and 9988 more") && misspelt.len() < 300,
        "{misspelt}"
    );
    let lines = text.lines().count();
    assert_eq!(
        terse(&format!(
            "{text}[[muscle]]\nname = 'muscle 9999'\nshape = 'chain'\n"
        )),
        format!(
            "s.toml:{}:8: error[E064]: muscle.10000.name: the name `muscle 9999` is given twice; \
             give each its own name",
            lines + 2
        )
    );
    // A muscle may have the name of a bone, but a capsule may not.
    let small = crowd(2);
    assert!(read(&small.replace("'muscle 1'", "'bone 1'")).is_ok());
    assert!(terse(&format!("{small}[[capsule]]\nname = 'bone 1'\n")).contains("E064"));
    assert!(
        terse(&small.replace("'bone 1'\nvertices", "'bone 2'\nvertices"))
            .contains("there is no bone `bone 2`")
    );
}

#[test]
fn a_wide_turn_about_one_axis_is_followed_all_the_way() {
    let keys = "[bone.motion]\ncentre = ['1 m', '0 m', '0 m']\naxis = [0, 0, 2]\ninterpolation = 'linear'\n\
                keys = [{ frame = 10, angle = '0 rad' }, \
                { frame = 20, angle = '720deg', slide = '8 mm' }]\n[[muscle]]";
    let motion = &read(&spoilt("[[muscle]]", keys)).expect("a scene").bones[0].motion;
    // A quarter of the duration is half a turn about the centre, and a quarter of the slide.
    let point = motion.pose(12.5) * nalgebra::Point3::origin();
    assert!(
        (point - nalgebra::Point3::new(2.0, 0.0, 0.002)).norm() < 1e-14,
        "{point}"
    );
    let eighth = motion.pose(11.25) * nalgebra::Point3::origin();
    assert!(
        (eighth - nalgebra::Point3::new(1.0, -1.0, 0.001)).norm() < 1e-14,
        "{eighth}"
    );
    // Half of a smooth motion is a whole turn. It begins slowly, and is steady from one part of the
    // wide turn to the next.
    let keys = keys.replace("'linear'", "'smooth'");
    let smooth = &read(&spoilt("[[muscle]]", &keys)).expect("a scene").bones[0].motion;
    let half = smooth.pose(15.0) * nalgebra::Point3::origin();
    assert!(
        (half - nalgebra::Point3::new(0.0, 0.0, 0.004)).norm() < 1e-14,
        "{half}"
    );
    let begun = smooth.pose(10.1) * nalgebra::Point3::origin();
    assert!(begun.coords.norm() < 1e-3, "{begun}");
    let [before, after] = [14.0, 16.0].map(|f| smooth.pose(f) * nalgebra::Point3::origin());
    assert!(
        (before.x - after.x).abs() < 1e-14 && (before.y + after.y).abs() < 1e-14,
        "{before} {after}"
    );
}

#[test]
fn a_bone_glides_on_a_path_as_its_joint_turns() {
    let motion = |path: &str| {
        let keys = format!(
            "[bone.motion]\ncentre = ['0 m', '1 m', '0 m']\naxis = [0, 0, 1]\n\
             keys = [{{ frame = 0 }}, {{ frame = 10, angle = '1 rad' }}, {{ frame = 30, angle = '1 rad' }}, \
             {{ frame = 40, angle = '-0.5 rad' }}]\n{path}\n[[muscle]]"
        );
        let scene = read(&spoilt("[[muscle]]", &keys)).expect("a scene");
        scene.bones[0].motion.clone()
    };
    let (turns, glides) = (
        motion(""),
        motion(
            "path = [{ at = '-1 rad', angle = '-0.2 rad', translation = ['0 m', '0 m', '-1 mm'] }, { at = '0 rad' }, \
             { at = '0.5 rad', angle = '0.2 rad', translation = ['0 m', '0 m', '0.125 mm'] }, \
             { at = '2 rad', angle = '0.9 rad', translation = ['0 m', '0 m', '8 mm'] }]",
        ),
    );
    let joint = glides.joint.as_ref().expect("a joint");
    assert_eq!(joint.path_range(), Some([-1.0, 2.0]));
    let angle = |frame: f64| turns.pose(frame).rotation.scaled_axis().z;
    for frame in 0..=40 {
        let frame = f64::from(frame);
        let there = joint.pose(angle(frame));
        let off = glides.pose(frame).translation.vector - there.translation.vector;
        assert!(off.norm() <= 1e-15, "{frame}: {off}");
    }
    // Between two frames it is off by at most a thousandth of the greatest turn of a frame, 0.19 rad.
    for step in 0..400 {
        let frame = 0.1 * f64::from(step) + 0.05;
        let off = glides
            .pose(frame)
            .rotation
            .angle_to(&joint.pose(angle(frame)).rotation);
        assert!(off <= 1.9e-4, "{frame}: {off}");
    }
    // A path passes its poses, and keeps its speed through them and at its ends.
    assert_eq!(joint.pose(0.0), nalgebra::Isometry3::identity());
    assert_eq!(joint.pose(3.0), joint.pose(2.0));
    let height = |angle: f64| joint.pose(angle).translation.z;
    let speed = |at: f64, step: f64| (height(at + step) - height(at)) / step;
    for at in [0.0, 0.5] {
        let [before, after] = [-1e-6, 1e-6].map(|step| speed(at, step));
        assert!((before - after).abs() <= 1e-5, "{at}: {before} {after}");
    }
    // The angle of the joint is found again from a pose.
    for at in [-0.8, 0.0, 0.31, 1.7] {
        let found = joint.angle_of(&joint.pose(at));
        assert!((found - at).abs() <= 1e-6, "{at}: {found}");
        let turned = turns.joint.as_ref().expect("a joint");
        let found = turned.angle_of(&turned.pose(at));
        assert!((found - at).abs() <= 1e-15, "{at}: {found}");
    }
    // A cubic through four poses is followed to its end, which is no rest.
    for at in [-0.9, 0.2, 1.3, 1.999] {
        let off = height(at) - 1e-3 * at * at * at;
        assert!(off.abs() <= 1e-15, "{at}: {off}");
    }
}

#[test]
fn the_examples_are_scenes_where_the_data_are() {
    let data = crate::measured_data("PLIANT_DATA").filter(|d| Path::new(d).join("body").is_dir());
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let (mut read, mut skipped) = (0, 0);
    for (name, bones, muscles) in [
        ("right-hip-gluteus-maximus", 3, 1),
        ("right-hip", 3, 3),
        ("right-hip-muscles", 3, 4),
        ("right-thigh", 5, 9),
    ] {
        let path = examples.join(name).with_extension("toml");
        if data.is_none() {
            skipped += 1;
            continue;
        }
        let scene = load_with(
            path.to_str().expect("a plain name"),
            &[],
            crate::measured_data,
        )
        .unwrap_or_else(|e| panic!("{e:?}"));
        assert_eq!(
            (scene.name.as_str(), scene.bones.len(), scene.muscles.len()),
            (name, bones, muscles)
        );
        for muscle in &scene.muscles {
            assert!(
                muscle.attachments.iter().map(|a| a.limit).sum::<f64>() <= 0.1 + 1e-12,
                "{}",
                muscle.name
            );
        }
        read += 1;
    }
    eprintln!("examples read: {read}, skipped without data: {skipped}");
}
