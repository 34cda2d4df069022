//! Scene files: every kind of mistake has its exact message, every built-in and example scene is one, and no text
//! whatever makes the reader panic.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use pliant::scene::builtin::{BUILTIN, builtin, load};
use pliant::scene::{self, Area, Mass, Order, Scene, SceneError, Solver, Source, Surroundings};
use proptest::prelude::*;

/// The smallest scene, to be spoilt.
const SMALL: &str = r#"frames = 3
frame_rate = "60 Hz"
[[bone]]
name = "femur"
shape = "hip-femur"
[[muscle]]
name = "calf"
shape = "tetrahedron"
"#;

/// A folder with the files that the layout names, all of them empty.
fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("scene");
    std::fs::create_dir_all(&folder).expect("the folder of tests can be written");
    for name in ["femur.obj", "gluteus.obj", "patch.obj", "fibres.vtk"] {
        std::fs::write(folder.join(name), "").expect("the folder of tests can be written");
    }
    folder
}

/// No variable is set but `HERE`, the folder of the tests.
fn variable(name: &str) -> Option<OsString> {
    (name == "HERE").then(|| folder().into_os_string())
}

fn read_with(text: &str, overrides: &[&str]) -> Result<Scene, SceneError> {
    let overrides: Vec<String> = overrides.iter().map(|&o| o.to_owned()).collect();
    let folder = folder();
    let around = Surroundings { folder: &folder, variable: &variable, overrides: &overrides };
    scene::parse_with(text, "s.toml", &around)
}

fn read(text: &str) -> Result<Scene, SceneError> {
    read_with(text, &[])
}

/// The one-line message of a scene that must be refused.
fn terse(text: &str) -> String {
    match read(text) {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(error) => error.terse(),
    }
}

/// The small scene with a text replaced, which must be there.
fn spoilt(from: &str, to: &str) -> String {
    assert!(SMALL.contains(from), "{from}");
    SMALL.replacen(from, to, 1)
}

/// The small scene with a text behind it.
fn with(more: &str) -> String {
    format!("{SMALL}{more}")
}

#[test]
fn the_layout_of_the_documentation_is_a_scene() {
    let scene = read(include_str!("../src/scene/layout.toml")).expect("the layout is a scene");
    assert_eq!((scene.name.as_str(), scene.frames, scene.frame_rate), ("right-hip", 300, 60.0));
    assert_eq!(scene.bones[0].motion.keys.len(), 4);
    assert_eq!(scene.capsules[0].radius, 0.03);
    let muscle = &scene.muscles[0];
    assert_eq!(muscle.surface, Source::File { path: folder().join("gluteus.obj"), scale: 1e-3 });
    assert_eq!((muscle.edge_length, muscle.material.bulk), (Some(0.004), Some(20e3)));
    assert_eq!((muscle.material.mass, muscle.material.stretch), (Mass::Density(1060.0), 300.0));
    let areas: Vec<&Area> = muscle.attachments.iter().map(|a| &a.area).collect();
    assert!(matches!(areas[..], [Area::Near(_), Area::Patch { component: Some(0), .. }, Area::Vertices(_)]));
    assert_eq!(muscle.attachments.iter().map(|a| a.limit).collect::<Vec<_>>(), [0.05, 0.1, 0.1]);
    assert_eq!(scene.effects.gravity.map(|g| g.y), Some(-9.81));
    assert_eq!(scene.effects.anisotropy.map(|a| (a.strength, a.power)), Some((0.5, 1.0)));
    // The layout states the defaults of the solver.
    let default = read(SMALL).expect("the small scene is one");
    assert_eq!(default.solver, scene.solver);
    assert_eq!((default.name.as_str(), default.effects), ("s", scene::Effects::default()));
}

#[test]
fn the_defaults_of_classic_pbd_are_those_of_the_layout() {
    let stated = "[solver.pbd]\nsubsteps = 1\niterations = 3\nstretch = 1\nbending = 0.9\nvolume = 1\n\
                  velocity_damping = 0.99\norder = 'coloured'\ntolerance = 0.01\n";
    let layout = include_str!("../src/scene/layout.toml").replace("\n# ", " ");
    for line in stated.lines().skip(1) {
        assert!(layout.contains(&line.replace('\'', "\"")), "{line}");
    }
    let read = |text: &str| read(&with(text)).expect("a scene").solver;
    assert_eq!(read("[solver.pbd]\n"), read(stated));
}

/// Each mistake and its whole message.
macro_rules! refused {
    ($($name:ident: $text:expr => $message:expr;)*) => {
        $(#[test]
        fn $name() {
            assert_eq!(terse(&$text), $message);
        })*
    };
}

refused! {
    e050_bare_number: with("[effects.contact]\nthickness = 0.5\n") =>
        "s.toml:10:13: error[E050]: effects.contact.thickness: `0.5` has no unit; \
         write \"0.5 m\"; known units of length: m, dm, cm, mm, um, km, in";
    e050_bare_text: spoilt("60 Hz", "60") =>
        "s.toml:2:14: error[E050]: frame_rate: `60` has no unit; \
         write \"60 1/s\"; known units of rate: 1/s, Hz, kHz, 1/ms";
    e050_mesh_without_unit: spoilt("shape = \"hip-femur\"", "mesh = \"femur.obj\"") =>
        "s.toml:5:8: error[E050]: bone.0.mesh: `femur.obj` has no unit; \
         write `unit = \"m\"`, \"cm\" or \"mm\" below it; known units of length: m, dm, cm, mm, um, km, in";
    e050_patch_without_unit: with("[[muscle.attachment]]\nbone = 'femur'\npatch = 'patch.obj#0'\nwithin = '5 mm'\n") =>
        "s.toml:11:9: error[E050]: muscle.0.attachment.0.patch: `patch.obj` has no unit; \
         write `unit = \"m\"`, \"cm\" or \"mm\" below it; known units of length: m, dm, cm, mm, um, km, in";
    e051_pressure: with("[effects.volume]\npressure = 2.5\n") =>
        "s.toml:10:12: error[E051]: effects.volume.pressure: `2.5` is not allowed here; give a number from 0.5 to 2";
    e051_negative_mass: with("[muscle.material]\nvertex_mass = '-1 kg'\n") =>
        "s.toml:10:15: error[E051]: muscle.0.material.vertex_mass: `-1 kg` is not allowed here; \
         give a mass greater than zero";
    e051_zero_density: with("[muscle.material]\ndensity = '0 kg/m3'\n") =>
        "s.toml:10:11: error[E051]: muscle.0.material.density: `0 kg/m3` is not allowed here; \
         give a density greater than zero";
    e051_negative_stiffness: with("[muscle.material]\nstretch = '-1 N/m'\n") =>
        "s.toml:10:11: error[E051]: muscle.0.material.stretch: `-1 N/m` is not allowed here; \
         give a surface stiffness of at least zero";
    e051_zero_bulk: with("[muscle.material]\nbulk = '0 Pa'\n") =>
        "s.toml:10:8: error[E051]: muscle.0.material.bulk: `0 Pa` is not allowed here; \
         give a pressure greater than zero";
    e051_nan: with("[effects.contact]\nthickness = '1 mm'\nfriction = nan\n") =>
        "s.toml:11:12: error[E051]: effects.contact.friction: `NaN` is not allowed here; give a number of at least zero";
    e051_infinite: with("[effects.damping]\nrate = 'inf 1/s'\n") =>
        "s.toml:10:8: error[E051]: effects.damping.rate: `inf 1/s` is not a finite number; write a finite number";
    e051_overflow: with("[effects.damping]\nrate = '1e999 1/s'\n") =>
        "s.toml:10:8: error[E051]: effects.damping.rate: `1e999 1/s` is too large or too small to be represented; \
         write a finite number";
    e051_no_substeps: with("[solver.xpbd]\nsubsteps = 0\n") =>
        "s.toml:10:12: error[E051]: solver.xpbd.substeps: `0` is not allowed here; \
         give a whole number from 1 to 1000000";
    e051_no_frames: spoilt("frames = 3", "frames = -3") =>
        "s.toml:1:10: error[E051]: frames: `-3` is not allowed here; give a whole number from 1 to 10000000";
    e051_no_time: spoilt("60 Hz", "0 Hz") =>
        "s.toml:2:14: error[E051]: frame_rate: `0 Hz` is not allowed here; give a rate greater than zero";
    e051_large_integer: spoilt("frames = 3", "frames = 99999999999999999999") =>
        "s.toml:1:10: error[E051]: `99999999999999999999` is not allowed here; \
         give a whole number of at most 63 bits";
    e051_no_direction: spoilt("[[muscle]]", "[bone.motion]\naxis = [0, 0.0, -0]\nkeys = []\n[[muscle]]") =>
        "s.toml:7:8: error[E051]: bone.0.motion.axis: `[0, 0, 0]` is not allowed here; \
         give a direction, one of whose numbers is not zero";
    e051_limit: with("[[muscle.attachment]]\nbone = 'femur'\nnear = '1 mm'\nlimit = '101 %'\n") =>
        "s.toml:12:9: error[E051]: muscle.0.attachment.0.limit: `101 %` is not allowed here; \
         give a ratio greater than zero and at most 100 %";
    e051_component: with("[[muscle.attachment]]\nbone = 'femur'\npatch = 'patch.obj#-1'\n") =>
        "s.toml:11:9: error[E051]: muscle.0.attachment.0.patch: `#-1` is not allowed here; \
         give the number of a component behind the `#`, 0 for the largest";
    e051_vertex_twice: with("[[muscle.force]]\nvertices = [3, 3]\nforce = ['0 N', '1 N', '0 N']\n") =>
        "s.toml:10:16: error[E051]: muscle.0.force.0.vertices.1: `3` is not allowed here; give each vertex once";
    e051_name: spoilt("\"calf\"", "'../calf'") =>
        "s.toml:7:8: error[E051]: muscle.0.name: `../calf` is not allowed here; \
         give a name without / \\ : * ? \" < > | that does not begin with a dot";
    e051_empty_name: spoilt("\"calf\"", "''") =>
        "s.toml:7:8: error[E051]: muscle.0.name: `` is not allowed here; \
         give a name of 1 to 100 bytes without space at its ends";
    e051_fibres_of_no_shape: with("[muscle.fibres]\nshape = true\n") =>
        "s.toml:10:9: error[E051]: muscle.0.fibres.shape: this is not allowed here; \
         give a text; only muscles of the shape hip-gluteus have fibres of their own";
    e052_misspelt: with("[effects.contact]\ntickness = '1 mm'\n") =>
        "s.toml:10:1: error[E052]: effects.contact: unknown key `tickness`, did you mean `thickness`?; \
         known keys here: thickness, friction";
    e052_unknown: with("[gravity]\n") =>
        "s.toml:9:2: error[E052]: unknown key `gravity`; \
         known keys here: name, frames, frame_rate, bone, capsule, muscle, effects, solver";
    e052_nothing_known: with("[effects.stretch]\nstiffness = 1\n") =>
        "s.toml:10:1: error[E052]: effects.stretch: unknown key `stiffness`; known keys here: none";
    e053_duplicate_key: spoilt("frames = 3", "frames = 3\nframes = 4") =>
        "s.toml:2:1: error[E053]: `frames` is given twice; keep one of the two";
    e053_duplicate_section: with("[effects.volume]\n[effects.volume]\n") =>
        "s.toml:10:10: error[E053]: `volume` is given twice; keep one of the two";
    e054_text_for_number: spoilt("frames = 3", "frames = '3'") =>
        "s.toml:1:10: error[E054]: frames: expected a whole number from 1 to 10000000, found a text; \
         write a whole number from 1 to 10000000";
    e054_section_for_list: SMALL.replace("[[muscle]]", "[muscle]") =>
        "s.toml:6:1: error[E054]: muscle: expected a list of sections [[muscle]], found a table; \
         write a list of sections [[muscle]]";
    e054_list_for_quantity: with("[effects.damping]\nrate = [1]\n") =>
        "s.toml:10:8: error[E054]: effects.damping.rate: expected a rate such as \"5 1/s\", found a list; \
         write a rate such as \"5 1/s\"";
    e054_two_for_three: with("[effects.gravity]\nacceleration = ['0 m/s2', '1 m/s2']\n") =>
        "s.toml:10:16: error[E054]: effects.gravity.acceleration: \
         expected a list of three: [\"9.81 m/s2\", \"9.81 m/s2\", \"9.81 m/s2\"], found a list of 2; \
         write a list of three: [\"9.81 m/s2\", \"9.81 m/s2\", \"9.81 m/s2\"]";
    e052_key_behind_a_section: with("effects = 3\n") =>
        "s.toml:9:1: error[E052]: muscle.0: unknown key `effects`; known keys here: name, mesh, shape, unit, \
         edge_length, material, attachment, fibres, force, displace";
    e054_true_for_section: with("[effects]\nstretch = true\n") =>
        "s.toml:10:11: error[E054]: effects.stretch: expected a section [effects.stretch], found true or false; \
         write a section [effects.stretch]";
    e055_no_frames: spoilt("frames = 3", "") =>
        "s.toml:1:1: error[E055]: `frames` is missing; add `frames = 300`";
    e055_no_muscle: "frames = 3\nframe_rate = '60 Hz'\n" =>
        "s.toml:1:1: error[E055]: `muscle` is missing; add a section [[muscle]]";
    e055_no_surface: spoilt("shape = \"hip-femur\"\n", "") =>
        "s.toml:3:1: error[E055]: bone.0: the surface is missing; \
         add `mesh = \"FILE\"` with its `unit`, or `shape = \"NAME\"`";
    e055_no_area: with("[[muscle.attachment]]\nbone = 'femur'\n") =>
        "s.toml:9:1: error[E055]: muscle.0.attachment.0: the area of the attachment is missing; \
         add `near = \"3 mm\"`, `patch = \"FILE\"` or `vertices = [0, 1]`";
    e055_no_within: with("[[muscle.attachment]]\nbone = 'femur'\npatch = 'patch.obj'\nunit = 'm'\n") =>
        "s.toml:9:1: error[E055]: muscle.0.attachment.0: `within` is missing; add `within = \"0.5 mm\"`";
    e055_no_thickness: with("[effects.contact]\n") =>
        "s.toml:9:1: error[E055]: effects.contact: `thickness` is missing; add `thickness = \"0.5 mm\"`";
    e055_no_centre: spoilt("[[muscle]]", "[bone.motion]\naxis = [1, 0, 0]\nkeys = [{ frame = 0, angle = '1 rad' }]\n[[muscle]]") =>
        "s.toml:6:1: error[E055]: bone.0.motion: `centre` is missing; add `centre = [\"0 mm\", \"0 mm\", \"0 mm\"]`";
    e055_no_axis: spoilt("[[muscle]]", "[bone.motion]\nkeys = [{ frame = 0, slide = '1 mm' }]\n[[muscle]]") =>
        "s.toml:7:9: error[E055]: bone.0.motion.keys.0: `axis` is missing; add `axis = [-1, 0, 0]` to the motion";
    e056_mesh_and_shape: spoilt("shape = \"hip-femur\"", "shape = \"hip-femur\"\nmesh = \"femur.obj\"") =>
        "s.toml:5:9: error[E056]: bone.0.shape: `mesh` and `shape` exclude each other; \
         keep either `mesh` or `shape`";
    e056_unit_of_shape: spoilt("shape = \"hip-femur\"", "shape = \"hip-femur\"\nunit = \"m\"") =>
        "s.toml:6:8: error[E056]: bone.0.unit: `shape` and `unit` exclude each other; keep either `shape` or `unit`";
    e056_two_areas: with("[[muscle.attachment]]\nbone = 'femur'\nnear = '1 mm'\nvertices = [0]\n") =>
        "s.toml:12:12: error[E056]: muscle.0.attachment.0.vertices: `near` and `vertices` exclude each other; \
         keep either `near` or `vertices`";
    e056_within_without_patch: with("[[muscle.attachment]]\nbone = 'femur'\nnear = '1 mm'\nwithin = '1 mm'\n") =>
        "s.toml:12:10: error[E056]: muscle.0.attachment.0.within: `near` and `within` exclude each other; \
         keep either `near` or `within`";
    e056_two_solvers: with("[solver.xpbd]\n[solver.pbd]\n") =>
        "s.toml:10:1: error[E056]: solver.pbd: `xpbd` and `pbd` exclude each other; keep either `xpbd` or `pbd`";
    e057_syntax: spoilt("frames = 3", "frames = ") =>
        "s.toml:1:10: error[E057]: string values must be quoted, expected literal string; \
         write the scene as TOML, see https://toml.io";
    e058_unknown_unit: with("[effects.contact]\nthickness = '1 furlong'\n") =>
        "s.toml:10:13: error[E058]: effects.contact.thickness: `furlong` is not a known unit of length; \
         known units of length: m, dm, cm, mm, um, km, in";
    e058_wrong_dimension: with("[effects.contact]\nthickness = '1 kg'\n") =>
        "s.toml:10:13: error[E058]: effects.contact.thickness: `kg` is a unit of mass, not of length; \
         known units of length: m, dm, cm, mm, um, km, in";
    e058_mesh_unit: spoilt("shape = \"hip-femur\"", "mesh = \"femur.obj\"\nunit = \"M\"") =>
        "s.toml:6:8: error[E058]: bone.0.unit: `M` is not a known unit of length; \
         known units of length: m, dm, cm, mm, um, km, in";
    e058_no_number: with("[effects.contact]\nthickness = 'thin'\n") =>
        "s.toml:10:13: error[E058]: effects.contact.thickness: `thin` does not begin with a number; \
         write a length as in \"0.5 mm\"";
    e059_order_of_keys: spoilt("[[muscle]]", "[bone.motion]\nkeys = [{ frame = 5 },\n{ frame = 5 }]\n[[muscle]]") =>
        "s.toml:8:11: error[E059]: bone.0.motion.keys.1.frame: frame 5 does not come after frame 5; \
         sort the keys by frame, each frame once";
    e061_outside: spoilt("shape = \"hip-femur\"", "mesh = \"../x\"\nunit = \"m\"") =>
        "s.toml:5:8: error[E061]: bone.0.mesh: `../x` lies outside the scene's folder; \
         write an absolute path, or one that begins with a variable such as $PLIANT_DATA";
    e062_variable: spoilt("shape = \"hip-femur\"", "mesh = \"$NOWHERE/x.obj\"\nunit = \"m\"") =>
        "s.toml:5:8: error[E062]: bone.0.mesh: the variable `NOWHERE` is not set; set it: export NOWHERE=FOLDER";
    e063_unknown_bone: with("[[muscle.attachment]]\nbone = 'femr'\nnear = '1 mm'\n") =>
        "s.toml:10:8: error[E063]: muscle.0.attachment.0.bone: there is no bone `femr`, did you mean `femur`?; \
         there are: femur";
    e063_unknown_shape: spoilt("tetrahedron", "cube") =>
        "s.toml:8:9: error[E063]: muscle.0.shape: there is no shape `cube`; there are: tetrahedron, chain, \
         press-muscle, press-plate, hip-socket, hip-femur, hip-gluteus";
    e063_unknown_order: with("[solver.xpbd]\norder = 'colored'\n") =>
        "s.toml:10:9: error[E063]: solver.xpbd.order: there is no order `colored`, did you mean `coloured`?; \
         there are: stored, reversed, from-loaded-end, coloured";
    e064_two_muscles: with("[[muscle]]\nname = 'calf'\nshape = 'chain'\n") =>
        "s.toml:10:8: error[E064]: muscle.1.name: the name `calf` is given twice; give each its own name";
    e064_capsule_as_bone: with("[[capsule]]\nname = 'femur'\n") =>
        "s.toml:10:8: error[E064]: capsule.0.name: the name `femur` is given twice; give each its own name";
    e065_no_vertices: with("[[muscle.attachment]]\nbone = 'femur'\nvertices = []\n") =>
        "s.toml:11:12: error[E065]: muscle.0.attachment.0.vertices: the list is empty; \
         give at least one vertex, or leave the key out";
    e065_no_keys: spoilt("[[muscle]]", "[bone.motion]\nkeys = []\n[[muscle]]") =>
        "s.toml:7:8: error[E065]: bone.0.motion.keys: the list is empty; give at least one key, or leave the key out";
    e066_held_twice: with("[[muscle.attachment]]\nbone = 'femur'\nvertices = [0, 1]\n\
                           [[muscle.attachment]]\nbone = 'femur'\nvertices = [1, 2]\n") =>
        "s.toml:14:12: error[E066]: muscle.0.attachment.1.vertices: vertex 1 is already held by the bone `femur`; \
         name each vertex in one attachment";
    e067_nested: format!("x = {}{}", "[".repeat(70), "]".repeat(70)) =>
        "s.toml:1:69: error[E067]: values are nested deeper than 64; a scene needs no more than a few levels";
    e067_nested_beyond_the_reader: format!("x = {}{}", "[".repeat(100_000), "]".repeat(100_000)) =>
        "s.toml:1:85: error[E067]: values are nested deeper than 64; a scene needs no more than a few levels";
    e069_unclear_turn: spoilt("[[muscle]]", "[bone.motion]\ncentre = ['0 m', '0 m', '0 m']\naxis = [1, 0, 0]\n\
        keys = [\n{ frame = 0, angle = '90deg' },\n{ frame = 9, angle = '4 rad', axis = [0, 1, 0] }]\n[[muscle]]") =>
        "s.toml:11:1: error[E069]: bone.0.motion.keys.1: the way from the key before to this one is not clear: \
         the axis changes and the turn is near half a turn or more; add key frames between the two";
}

#[test]
fn e060_missing_file_and_folder() {
    let mesh = |path: &str| spoilt("shape = \"hip-femur\"", &format!("mesh = \"{path}\"\nunit = \"m\""));
    let folder = folder();
    let wanted = |path: &Path, why: &str| {
        let path = path.display();
        format!(
            "s.toml:5:8: error[E060]: bone.0.mesh: no file `{path}`{why}; \
             check the path; it is relative to the scene's folder"
        )
    };
    assert_eq!(terse(&mesh("no.obj")), wanted(&folder.join("no.obj"), ""));
    assert_eq!(terse(&mesh("$HERE/a/../no.obj")), wanted(&folder.join("a/../no.obj"), ""));
    assert_eq!(terse(&mesh("$HERE/.")), wanted(&folder.join("."), ": it is a folder"));
    assert!(read(&mesh("$HERE/femur.obj")).is_ok());
    assert!(read(&mesh("${HERE}/femur.obj")).is_ok());
    assert!(read(&mesh("a/../femur.obj")).is_ok());
}

#[test]
fn on_a_terminal_an_error_shows_its_line_and_a_caret() {
    let error = read(&with("[effects.contact]\ntickness = '1 mm'\n")).expect_err("refused");
    let mut shown = String::new();
    let handler = miette::GraphicalReportHandler::new_themed(miette::GraphicalTheme::none());
    handler.render_report(&mut shown, &error).expect("a text can be written");
    let wanted = "E052

  x unknown key `tickness`, did you mean `thickness`?
    ,-[s.toml:10:1]
  9 | [effects.contact]
 10 | tickness = '1 mm'
    : ^^^^|^^^
    :     `-- effects.contact
    `----
  help: known keys here: thickness, friction
";
    assert_eq!(shown, wanted);
    assert_eq!((error.key(), error.place(), error.problem().code()), ("effects.contact", Some((10, 1)), "E052"));
}

/// The message of an override of a built-in scene that must be refused.
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
    let friction = |overrides: &[&str]| changed("hip", overrides).effects.contact.map(|c| c.friction);
    assert_eq!(friction(&[]), Some(0.0));
    assert_eq!(friction(&["effects.contact.friction=0.3"]), Some(0.3));
    assert_eq!(friction(&["contact.friction = 0.3", "contact.friction=0.4"]), Some(0.4));
    assert_eq!(friction(&["effects.contact=none"]), None);
    assert_eq!(friction(&["contact=off"]), None);
    assert_eq!(friction(&["contact=off", "contact.thickness=1 mm"]), Some(0.0));
    for path in ["0", "gluteus", "*", "\"gluteus\"", "'gluteus'"] {
        let scene = changed("hip", &[&format!("muscle.{path}.edge_length=3 mm")]);
        assert_eq!(scene.muscles[0].edge_length, Some(0.003), "{path}");
    }
    assert_eq!(changed("hip", &["muscle.0.edge_length=\"3 mm\""]).muscles[0].edge_length, Some(0.003));
    assert_eq!(changed("hip", &["name=7"]).name, "7");
    assert_eq!(changed("hip", &["frames=7"]).frames, 7);
    let y = changed("hip", &["gravity.acceleration=['0 m/s2', '-1 m/s2', '0 m/s2']"]).effects.gravity.map(|g| g.y);
    assert_eq!(y, Some(-1.0));
    assert!(changed("shape", &["stretch=on"]).effects.stretch);
    assert!(changed("hip", &["muscle.0.fibres=off"]).muscles[0].fibres.is_none());
    let both = changed("hip", &["muscle.0.attachment.*.limit=2 %"]);
    assert!(both.muscles[0].attachments.iter().all(|a| a.limit == 0.02));
}

#[test]
fn overrides_change_the_solver() {
    let steps = |name: &str, overrides: &[&str]| match changed(name, overrides).solver {
        Solver::Xpbd(x) => ("xpbd", x.substeps, x.iterations, x.order),
        Solver::Pbd(p) => ("pbd", p.substeps, p.iterations, p.order),
    };
    assert_eq!(steps("hip", &["substeps=40"]), ("xpbd", 40, 1, Order::Coloured));
    assert_eq!(steps("hip", &["solver.xpbd.substeps=40"]), ("xpbd", 40, 1, Order::Coloured));
    assert_eq!(steps("chain", &["order=stored"]), ("pbd", 1, 1, Order::Stored));
    assert_eq!(steps("hip", &["solver=pbd"]), ("pbd", 1, 3, Order::Coloured));
    assert_eq!(steps("hip", &["solver=pbd", "iterations=10"]), ("pbd", 1, 10, Order::Coloured));
    assert_eq!(steps("chain", &["solver=none"]), ("xpbd", 20, 1, Order::Coloured));
    assert_eq!(steps("hip", &["solver.xpbd=none", "pbd.iterations=5"]), ("pbd", 1, 5, Order::Coloured));
}

#[test]
fn wrong_overrides_name_themselves() {
    let cases = [
        (
            "effects.contact.frction=0.3",
            "error[E052]: effects.contact: unknown key `frction`, did you mean `friction`?; \
          known keys here: thickness, friction",
        ),
        (
            "effect.contact.friction=0.3",
            "error[E052]: unknown key `effect`, did you mean `effects`?; \
          known keys here: name, frames, frame_rate, bone, capsule, muscle, effects, solver",
        ),
        (
            "contact.friction=-1",
            "error[E051]: effects.contact.friction: `-1` is not allowed here; \
          give a number of at least zero",
        ),
        (
            "contact.thickness=2",
            "error[E050]: effects.contact.thickness: `2` has no unit; \
          write \"2 m\"; known units of length: m, dm, cm, mm, um, km, in",
        ),
        ("contact", "error[E068]: there is no `=`; write PATH=VALUE, for example effects.contact.friction=0.3"),
        ("=3", "error[E068]: the path is not one; write PATH=VALUE, for example effects.contact.friction=0.3"),
        ("a..b=3", "error[E068]: the path is not one; write PATH=VALUE, for example effects.contact.friction=0.3"),
        ("frames= ", "error[E068]: there is no value; write PATH=VALUE, for example effects.contact.friction=0.3"),
        (
            "contact=0.3",
            "error[E068]: effects.contact: `effects.contact` is a section, not a value; \
          give a key below it, or `on`, or `off` to remove it",
        ),
        ("frames.x=3", "error[E068]: frames: `frames` is a single value; nothing is below it; write frames=VALUE"),
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
          shape, unit, edge_length, material, attachment, fibres, force, displace",
        ),
        ("capsule.0.radius=3 mm", "error[E068]: capsule: the scene has no `capsule`; add [[capsule]] to it"),
        ("solver.pbd=on", "error[E056]: solver.pbd: `xpbd` and `pbd` exclude each other; keep either `xpbd` or `pbd`"),
        (
            "gravity=on",
            "error[E055]: effects.gravity: `acceleration` is missing; \
          add `acceleration = [\"0 m/s2\", \"-9.81 m/s2\", \"0 m/s2\"]`",
        ),
    ];
    for (text, message) in cases {
        assert_eq!(refused_override("hip", text), format!("--set {text}: {message}"));
    }
    // An error of the file is placed in the file, whatever is overridden.
    let error = read_with(&spoilt("frames = 3", "frames = 0"), &["contact.thickness=1 mm"]).expect_err("refused");
    assert!(error.terse().starts_with("s.toml:1:10: error[E051]"), "{error:?}");
}

#[test]
fn every_built_in_is_a_scene_of_its_name() {
    for &(name, text, line) in BUILTIN {
        let scene = load(name, &[]).unwrap_or_else(|e| panic!("{e:?}"));
        assert_eq!((scene.name.as_str(), builtin(name)), (name, Some(text)));
        assert!(!line.is_empty() && line.len() < 80);
    }
    let scene = changed("hip", &[]);
    let reach = scene.bones[1].motion.pose(100.0).rotation.scaled_axis();
    assert!((reach + nalgebra::Vector3::x()).norm() < 1e-15, "{reach}");
    assert_eq!(scene.bones[1].motion.pose(250.0), nalgebra::Isometry3::identity());
    assert_eq!(scene.muscles[0].fibres, Some(Source::Shape("hip-gluteus".to_owned())));
    let scene = changed("press", &[]);
    let gap = |frame: f64| {
        let y = |bone: usize| scene.bones[bone].motion.pose(frame).translation.y;
        y(0) - y(1) - 0.02
    };
    for (frame, wanted) in [(0.0, 0.044), (50.0, 0.0242), (100.0, 0.0044), (200.0, 0.044), (300.0, 0.044)] {
        assert!((gap(frame) - wanted).abs() < 1e-15, "{frame}: {}", gap(frame));
    }
}

#[test]
fn a_name_is_a_file_or_a_built_in() {
    let terse = |name: &str| load(name, &[]).expect_err(name).terse();
    assert_eq!(
        terse("hop"),
        "SCENE: error[E063]: there is no scene `hop`, did you mean `hip`?; \
         there are: hip, press, distance, shape, volume, chain"
    );
    assert_eq!(
        terse("hip.toml"),
        "SCENE: error[E060]: no file `hip.toml`; check the path; it is relative to the scene's folder"
    );
    let file = folder().join("calf.toml");
    std::fs::write(&file, SMALL).expect("the folder of tests can be written");
    let name = file.to_str().expect("the folder of tests has a plain name");
    assert_eq!(load(name, &[]).map(|s| s.name).ok().as_deref(), Some("calf"));
    let binary = folder().join("binary.toml");
    std::fs::write(&binary, [0xff, 0xfe]).expect("the folder of tests can be written");
    let message = terse(binary.to_str().expect("the folder of tests has a plain name"));
    assert!(message.contains(": it is not text in UTF-8; "), "{message}");
}

#[test]
fn a_wide_turn_about_one_axis_is_followed_all_the_way() {
    let motion = "[bone.motion]\ncentre = ['1 m', '0 m', '0 m']\naxis = [0, 0, 2]\n\
                  keys = [{ frame = 10, angle = '0 rad' }, { frame = 20, angle = '720deg', slide = '8 mm' }]\n[[muscle]]";
    let motion = &read(&spoilt("[[muscle]]", motion)).expect("a scene").bones[0].motion;
    // A quarter of the way is half a turn about the centre, and a quarter of the slide.
    let point = motion.pose(12.5) * nalgebra::Point3::origin();
    assert!((point - nalgebra::Point3::new(2.0, 0.0, 0.002)).norm() < 1e-14, "{point}");
    let eighth = motion.pose(11.25) * nalgebra::Point3::origin();
    assert!((eighth - nalgebra::Point3::new(1.0, -1.0, 0.001)).norm() < 1e-14, "{eighth}");
}

#[test]
fn the_examples_are_scenes_where_the_data_are() {
    let data = scene::environment("PLIANT_DATA").filter(|d| Path::new(d).join("body").is_dir());
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let (mut read, mut skipped) = (0, 0);
    for (name, muscles) in [("right-hip-gluteus-maximus", 1), ("right-hip", 3)] {
        let path = examples.join(name).with_extension("toml");
        if data.is_none() {
            skipped += 1;
            continue;
        }
        let scene = load(path.to_str().expect("a plain name"), &[]).unwrap_or_else(|e| panic!("{e:?}"));
        assert_eq!((scene.name.as_str(), scene.bones.len(), scene.muscles.len()), (name, 3, muscles));
        for muscle in &scene.muscles {
            assert!(muscle.attachments.iter().map(|a| a.limit).sum::<f64>() <= 0.1 + 1e-12, "{}", muscle.name);
        }
        read += 1;
    }
    eprintln!("examples read: {read}, skipped without data: {skipped}");
}

/// The parts that a mutated scene is put together from.
fn piece() -> impl Strategy<Value = String> {
    let tokens = [
        "[",
        "]",
        "[[",
        "]]",
        "{",
        "}",
        "=",
        ".",
        ",",
        "#",
        "\"",
        "'",
        "\n",
        "\\u0000",
        "0",
        "-1",
        "1e999",
        "nan",
        "inf",
        "true",
        "none",
        "\"1 mm\"",
        "\"-1 mm\"",
        "\"$HERE/femur.obj\"",
        "\"../x\"",
        "1979-05-27",
        "é",
        "\u{0}",
        "[[muscle]]",
        "[effects.contact]",
        "[solver.pbd]",
        "[bone.motion]",
        "frames",
        "name",
        "shape",
        "keys",
    ];
    prop_oneof![prop::sample::select(tokens.map(str::to_owned).to_vec()), any::<String>()]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    /// A built-in scene with pieces put in, taken out, and lines swapped is a scene or an error with its place.
    #[test]
    fn no_mutation_makes_the_reader_panic(
        scene in 0..BUILTIN.len(),
        cuts in prop::collection::vec((any::<prop::sample::Index>(), 0..12_usize, piece()), 1..6),
        swap in any::<(prop::sample::Index, prop::sample::Index)>(),
    ) {
        let mut lines: Vec<&str> = BUILTIN[scene].1.lines().collect();
        let count = lines.len();
        lines.swap(swap.0.index(count), swap.1.index(count));
        let mut text: Vec<char> = lines.join("\n").chars().collect();
        for (at, length, piece) in cuts {
            let at = at.index(text.len() + 1);
            let end = (at + length).min(text.len());
            text.splice(at..end, piece.chars());
        }
        let text: String = text.into_iter().collect();
        if let Err(error) = read(&text) {
            prop_assert!(error.place().is_some());
            let mut shown = String::new();
            let rendered = miette::GraphicalReportHandler::new().render_report(&mut shown, &error);
            prop_assert!(rendered.is_ok());
            prop_assert!(!error.terse().contains('\n'), "{}", error.terse());
        }
    }

    /// Nor does a text of any kind, nor an override.
    #[test]
    fn no_text_makes_the_reader_panic(pieces in prop::collection::vec(piece(), 0..40), value in any::<String>()) {
        let text = pieces.concat();
        let _ = read(&text);
        for change in [text, format!("effects.contact.friction={value}"), format!("muscle.{value}.edge_length=1 mm")] {
            if let Err(error) = read_with(SMALL, &[&change]) {
                prop_assert!(error.terse().starts_with("--set "), "{}", error.terse());
            }
        }
    }
}
