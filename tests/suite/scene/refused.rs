//! The exact message of every kind of error.

use std::path::Path;

use super::{SMALL, folder, read, spoilt, terse, with};

/// Each error with its whole message.
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
         write \"0.5 mm\"; known units of length: m, dm, cm, mm, um, km, in";
    e050_bare_text: spoilt("60 Hz", "60") =>
        "s.toml:2:14: error[E050]: frame_rate: `60` has no unit; \
         write \"60 1/s\"; known units of rate: 1/s, Hz, kHz, 1/ms";
    e050_mesh_without_unit: spoilt("shape = \"hip-femur\"", "mesh = \"femur.obj\"") =>
        "s.toml:5:8: error[E050]: bone.0.mesh: `femur.obj` has no unit; \
         write `unit = \"m\"`, \"cm\" or \"mm\" below it; known units of length: m, dm, cm, mm, um, km, in";
    e050_patch_without_unit: with("[[muscle.attachment]]\nbone = 'femur'\npatch = 'patch.obj#0'\nwithin = '5 mm'\n") =>
        "s.toml:11:9: error[E050]: muscle.0.attachment.0.patch: `patch.obj` has no unit; \
         write `unit = \"m\"`, \"cm\" or \"mm\" below it; known units of length: m, dm, cm, mm, um, km, in";
    e050_limit: with("[limits]\njitter = 0.1\n") =>
        "s.toml:10:10: error[E050]: limits.jitter: `0.1` has no unit; \
         write \"0.1 mm\"; known units of length: m, dm, cm, mm, um, km, in";
    e051_thickness: with("[limits]\nthickness = 2\n") =>
        "s.toml:10:13: error[E051]: limits.thickness: `2` is not allowed here; give a number from 0 to 1";
    e051_angle: with("[limits]\nhinge = '-5 deg'\n") =>
        "s.toml:10:9: error[E051]: limits.hinge: `-5 deg` is not allowed here; give an angle greater than zero";
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
    e051_more_than_the_motion: spoilt("frames = 3", "frames = 3\naccuracy = '101 % of motion'") =>
        "s.toml:2:12: error[E051]: accuracy: `101 %` is not allowed here; \
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
         known keys here: thickness, friction, between";
    e052_unknown: with("[gravity]\n") =>
        "s.toml:9:2: error[E052]: unknown key `gravity`; \
         known keys here: name, frames, frame_rate, accuracy, mesh_error, up, limits, bone, opensim, capsule, muscle, interface, effects, solver, \
         skin, sheet, implant, ball, obstacle, lattice, radii, grow_mults, length, unit, frame, \
         min_part, max_part, insert, caps, fixed_length, spring_body, rigid_body, acceleration, collision";
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
         repair, close_holes, cut_handles, keep_largest, merge_within, edge_length, material, attachment, fibres, activation, force, displace";
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
    e051_beyond_the_path: spoilt("[[muscle]]", "[bone.motion]\ncentre = ['0 m', '0 m', '0 m']\naxis = [1, 0, 0]\n\
        keys = [{ frame = 0 },\n{ frame = 5, angle = '2 rad' }]\npath = [{ at = '0 rad' }, { at = '1 rad' }]\n[[muscle]]") =>
        "s.toml:10:22: error[E051]: bone.0.motion.keys.1.angle: `2 rad` is not allowed here; give an angle from 0 to 1 rad";
    e056_path_and_translation: spoilt("[[muscle]]", "[bone.motion]\ncentre = ['0 m', '0 m', '0 m']\naxis = [1, 0, 0]\n\
        keys = [{ frame = 0, translation = ['0 m', '0 m', '1 m'] }]\npath = [{ at = '0 rad' }, { at = '1 rad' }]\n[[muscle]]") =>
        "s.toml:9:9: error[E056]: bone.0.motion.keys.0: `path` and `translation` exclude each other; keep either `path` or `translation`";
    e055_path_without_axis: spoilt("[[muscle]]", "[bone.motion]\nkeys = [{ frame = 0 }]\n\
        path = [{ at = '0 rad' }, { at = '1 rad' }]\n[[muscle]]") =>
        "s.toml:8:8: error[E055]: bone.0.motion.path: `centre` is missing; add `centre` and `axis` of the joint to the motion";
    e051_short_path: spoilt("[[muscle]]", "[bone.motion]\ncentre = ['0 m', '0 m', '0 m']\naxis = [1, 0, 0]\n\
        keys = [{ frame = 0 }]\npath = [{ at = '0 rad' }]\n[[muscle]]") =>
        "s.toml:10:8: error[E051]: bone.0.motion.path: a path of one pose is not allowed here; give poses at two angles at least";
    e051_turns_too_far: spoilt("[[muscle]]", "[bone.motion]\ncentre = ['0 m', '0 m', '0 m']\naxis = [1, 0, 0]\n\
        keys = [{ frame = 0 }]\npath = [{ at = '0 rad' }, { at = '1 rad', angle = '190 deg' }]\n[[muscle]]") =>
        "s.toml:10:51: error[E051]: bone.0.motion.path.1.angle: `190 deg` is not allowed here; \
         give an angle from -3.141592653589793 to 3.141592653589793 rad";
    e051_no_angle_on_the_path: spoilt("[[muscle]]", "[bone.motion]\ncentre = ['0 m', '0 m', '0 m']\naxis = [1, 0, 0]\n\
        keys = [{ frame = 0 }]\npath = [{ at = '0.5 rad' }, { at = '1 rad' }]\n[[muscle]]") =>
        "s.toml:9:9: error[E051]: bone.0.motion.keys.0: a pose without `angle`, which is 0 rad, is not allowed here; \
         give an angle from 0.5 to 1 rad";
    e059_order_of_path: spoilt("[[muscle]]", "[bone.motion]\ncentre = ['0 m', '0 m', '0 m']\naxis = [1, 0, 0]\n\
        keys = [{ frame = 0 }]\npath = [{ at = '1 rad' }, { at = '0 rad' }]\n[[muscle]]") =>
        "s.toml:10:34: error[E059]: bone.0.motion.path.1.at: angle [deg] 0 does not come after angle [deg] 57.29577951308232; \
         sort the keys by angle, each angle once";
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
         press-muscle, press-plate, hip-socket, hip-femur, hip-gluteus, soft-cube, soft-ball, soft-table, skull";
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
        "s.toml:11:1: error[E069]: bone.0.motion.keys.1: the motion from the previous key to this one is ambiguous: \
         the axis changes and the turn is near half a turn or more; add key frames between the two";
}

#[test]
fn e060_missing_file_and_folder() {
    let mesh = |path: &str| {
        spoilt(
            "shape = \"hip-femur\"",
            &format!("mesh = \"{path}\"\nunit = \"m\""),
        )
    };
    let (folder, variable) = (folder(), " and the value of the variable");
    let expected = |path: &Path, why: &str, hint: &str| {
        let path = path.display();
        format!(
            "s.toml:5:8: error[E060]: bone.0.mesh: {}; check the path{hint}",
            if why.is_empty() {
                format!("no file `{path}`")
            } else {
                format!("`{path}` cannot be read: {why}")
            }
        )
    };
    assert_eq!(
        terse(&mesh("no.obj")),
        expected(
            &folder.join("no.obj"),
            "",
            "; it is relative to the scene's folder"
        )
    );
    assert_eq!(
        terse(&mesh("$HERE/a/../no.obj")),
        expected(&folder.join("a/../no.obj"), "", variable)
    );
    assert_eq!(
        terse(&mesh("$HERE/.")),
        expected(&folder.join("."), "it is a folder", variable)
    );
    assert_eq!(
        terse(&mesh("/no.obj")),
        expected(Path::new("/no.obj"), "", "")
    );
    assert!(read(&mesh("$HERE/femur.obj")).is_ok());
    assert!(read(&mesh("${HERE}/femur.obj")).is_ok());
    assert!(read(&mesh("a/../femur.obj")).is_ok());
}
