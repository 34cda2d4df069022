//! `pliant moment-arms`: files, numbers, refusals.

use std::fs;

use super::{Scratch, json, measures, names_in, run, shown, text};

/// Without `--joint`: the scene has one.
const SMALL: [&str; 10] = [
    "moment-arms",
    "hip",
    "--from=-4deg",
    "--to",
    "8deg",
    "--step",
    "2deg",
    "--count",
    "10",
    "--smooth=0",
];

#[test]
fn the_built_in_hip() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let table = scratch.join("others.csv");
    fs::write(
        &table,
        "# mm moment arm\nangle_deg,gluteus1_mm,gluteus2_mm\n-10,-100,0\n60,-100,0\n",
    )
    .expect("written");
    let done = run(&[
        &SMALL[..],
        &["--json", "--compare", shown(&table), "--out", shown(&out)],
        &[
            "--opensim",
            "/jointset/hip_r/hip_flexion_r",
            "--forces",
            "gluteus=glmax1_r",
        ],
    ]
    .concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let said: serde_json::Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert_eq!(said, json(&out.join("summary.json")));
    let said = measures(&said);
    let muscle = &said["muscles"][0];
    let number = |key: &str| muscle[key].as_f64().unwrap_or(f64::NAN);
    assert_eq!(
        (said["values"].as_u64(), muscle["fibres"].as_u64()),
        (Some(7), Some(10))
    );
    assert!(
        number("moment_arm_greatest_m") < 0.0 && number("moment_arm_least_m") > -0.1,
        "an extensor: {muscle}"
    );
    assert!(
        number("volume_error_max") <= 1e-9 && number("points_in_bone") == 0.0,
        "{muscle}"
    );
    let compared = &muscle["compared"][0];
    assert_eq!(
        (compared["reference"].as_str(), compared["overlap"].as_f64()),
        (Some("others"), Some(1.0)),
        "{compared}"
    );
    let names = names_in(&out);
    for name in [
        "fibres.csv",
        "fibres.pvd",
        "gluteus.svg",
        "moment_arms.csv",
        "picture_0.png",
        "report.html",
    ] {
        assert!(
            names.iter().any(|n| n == name),
            "{name} is not in {names:?}"
        );
    }
    let rows = |file: &str| {
        fs::read_to_string(out.join(file))
            .expect("a table")
            .lines()
            .count()
    };
    assert_eq!((rows("moment_arms.csv"), rows("fibres.csv")), (8, 71));
    // A polynomial for OpenSim is that of the tables beside it, up to the errors that it states.
    let path = &said["opensim"][0];
    assert_eq!(path["force"], "/forceset/glmax1_r");
    let coefficients: Vec<f64> =
        serde_json::from_value(path["coefficients"].clone()).expect("numbers");
    let table = |name: &str| -> Vec<Vec<f64>> {
        let text = fs::read_to_string(out.join(format!("hip_{name}.sto"))).expect("a table");
        let (head, body) = text.split_once("endheader\n").expect("a header");
        assert!(head.contains("inDegrees=no"));
        let rows = body.lines().skip(1);
        rows.map(|row| {
            row.split('\t')
                .map(|cell| cell.parse().expect("a number"))
                .collect()
        })
        .collect()
    };
    let (lengths, arms) = (table("path_lengths"), table("moment_arms"));
    // The normal equations of least squares over lengths and moment arms.
    let mut sums = vec![(0.0, 0.0); coefficients.len()];
    for (k, row) in table("coordinate_values").iter().enumerate() {
        let q = row[1];
        let power = |(i, c): (usize, &f64)| c * q.powi(i as i32);
        let length: f64 = coefficients.iter().enumerate().map(power).sum();
        let slope: f64 = (1..coefficients.len())
            .map(|i| i as f64 * coefficients[i] * q.powi(i as i32 - 1))
            .sum();
        assert!(
            (length - lengths[k][1]).abs() <= 1e-3,
            "{length} {}",
            lengths[k][1]
        );
        assert!(
            (-slope - arms[k][1]).abs() <= 5e-3,
            "{slope} {}",
            arms[k][1]
        );
        let (off, turn) = (length - lengths[k][1], -slope - arms[k][1]);
        for (i, (sum, size)) in sums.iter_mut().enumerate() {
            let by_length = off * q.powi(i as i32);
            let by_arm = turn * -(i as f64) * q.powi(i as i32 - 1);
            let by_arm = if i == 0 { 0.0 } else { by_arm };
            *sum += by_length + by_arm;
            *size += by_length.abs() + by_arm.abs();
        }
    }
    for (i, (sum, size)) in sums.iter().enumerate() {
        // Rounding of numbers of a tenth of a metre beside residuals of a hundredth of a millimetre.
        assert!(
            size > &0.0 && sum.abs() <= 1e-6 * size,
            "{i}: {sum} of {size}"
        );
    }
    let set = fs::read_to_string(out.join("hip_FunctionBasedPathSet.xml")).expect("a set");
    for text in [
        "<FunctionBasedPath name=\"/forceset/glmax1_r\">",
        "<coordinate_paths>/jointset/hip_r/hip_flexion_r</coordinate_paths>",
        &format!("<order>{}</order>", coefficients.len() - 1),
    ] {
        assert!(set.contains(text), "{text} is not in {set}");
    }
}

/// A second joint, of a bone that rests.
const OTHER_JOINT: &str = "bone.0.motion={ joint=\"jaw\", centre=[\"0 m\", \"0 m\", \"0 m\"], \
                           axis=[1, 0, 0], keys=[{ frame=0 }] }";

#[test]
fn what_cannot_be_is_refused() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let no_unit = scratch.join("no-unit.csv");
    fs::write(&no_unit, "angle_deg,gluteus\n0,1\n").expect("written");
    for (arguments, expected) in [
        (
            &["hip", "--joint", "knee"][..],
            "no joint `knee`; known: hip",
        ),
        (
            &["hip", "--joint", "hip", "--from", "20deg", "--to", "10deg"],
            "the first angle must be below the last; `pliant moment-arms --help`",
        ),
        (&["hip", "--joint", "hip", "--to", "60"], "no unit"),
        (
            &["hip", "--joint", "hip", "--to", "200deg"],
            "at most 180 degrees",
        ),
        (
            &["hip", "--joint", "hip", "--step", "0deg"],
            "no or too many values",
        ),
        (
            &["hip", "--joint", "hip", "--step", "20deg"],
            "too few to smooth over",
        ),
        (
            &["hip", "--joint", "hip", "--count", "100000"],
            "too many to carry",
        ),
        (
            &["hip", "--joint", "hip", "--opensim", "hip_flexion_r"],
            "expected an absolute path",
        ),
        (
            &[
                "hip",
                "--joint",
                "hip",
                "--opensim",
                "/j/q",
                "--forces",
                "a",
            ],
            "expected MUSCLE=FORCE",
        ),
        (
            &[
                "hip",
                "--joint",
                "hip",
                "--opensim",
                "/j/q",
                "--forces",
                "nobody=f",
            ],
            "no muscle `nobody` crosses the joint",
        ),
        (
            &["hip", "--joint", "hip", "--axis", "0,0"],
            "expected three numbers",
        ),
        (
            &["hip", "--joint", "hip", "--compare", "nothing.csv"],
            "cannot read `nothing.csv`",
        ),
        (&["lattice", "--joint", "hip"], "this scene has none"),
        (&["press"], "which make a joint"),
        (&["hip", "--set", OTHER_JOINT], "several joints: jaw, hip"),
    ] {
        let done = run(&[&["moment-arms"], arguments, &["--out", shown(&out)]].concat());
        assert_eq!(
            done.status.code(),
            Some(2),
            "{arguments:?}: {}",
            text(&done.stderr)
        );
        assert!(
            text(&done.stderr).contains(expected),
            "{arguments:?}: {}",
            text(&done.stderr)
        );
        assert!(!out.exists(), "{arguments:?}");
    }
    let done = run(&[
        &SMALL[..],
        &["--compare", shown(&no_unit), "--out", shown(&out)],
    ]
    .concat());
    assert_eq!(done.status.code(), Some(2));
    assert!(
        text(&done.stderr).contains("does not tell the unit of column `gluteus`"),
        "{}",
        text(&done.stderr)
    );
}

/// A model of a hip for the built-in scene: two coordinates about axes that cross, and two muscles.
fn hip_model(folder: &std::path::Path) -> String {
    let path = folder.join("hip.osim");
    let muscle = |name: &str, z: f64| {
        format!(
            "<Thelen2003Muscle name=\"{name}\"><GeometryPath name=\"path\"><PathPointSet><objects>\
             <PathPoint name=\"a\"><socket_parent_frame>/bodyset/pelvis</socket_parent_frame><location>-0.05 0.05 {z}</location></PathPoint>\
             <PathPoint name=\"b\"><socket_parent_frame>/bodyset/femur</socket_parent_frame><location>0 -0.1 0</location></PathPoint>\
             </objects></PathPointSet></GeometryPath><max_isometric_force>1</max_isometric_force>\
             <optimal_fiber_length>0.1</optimal_fiber_length></Thelen2003Muscle>\n"
        )
    };
    let frame = |name: &str, body: &str| {
        format!(
            "<PhysicalOffsetFrame name=\"{name}\"><socket_parent>/bodyset/{body}</socket_parent>\
             <orientation>0 -1.5707963267948966 0</orientation></PhysicalOffsetFrame>"
        )
    };
    let text = format!(
        "<?xml version=\"1.0\"?>\n<OpenSimDocument Version=\"40600\">\n<Model name=\"hip\">\n\
         <BodySet name=\"bodyset\"><objects><Body name=\"pelvis\"/><Body name=\"femur\"/></objects></BodySet>\n\
         <JointSet name=\"jointset\"><objects>\
         <WeldJoint name=\"w\"><socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/pelvis</socket_child_frame></WeldJoint>\
         <UniversalJoint name=\"hip\"><socket_parent_frame>p</socket_parent_frame><socket_child_frame>f</socket_child_frame>\
         <coordinates><Coordinate name=\"flexion\"><range>-0.1 0.3</range></Coordinate><Coordinate name=\"adduction\"><range>-0.1 0.1</range></Coordinate></coordinates>\
         <frames>{}{}</frames></UniversalJoint></objects></JointSet>\n\
         <ForceSet name=\"forceset\"><objects>\n{}{}</objects></ForceSet>\n</Model>\n</OpenSimDocument>\n",
        frame("p", "pelvis"),
        frame("f", "femur"),
        muscle("front", 0.05),
        muscle("back", -0.05)
    );
    fs::write(&path, text).expect("written");
    shown(&path).to_owned()
}

/// Two coordinates, bundles, and the model with the paths in place: numbers of the tables are those of
/// the fit, and a second run into the folder replaces the first.
#[test]
fn over_two_coordinates_of_a_model() {
    let scratch = Scratch::folder();
    let (model, out) = (hip_model(&scratch), scratch.join("out"));
    let arguments = [
        "moment-arms",
        "hip",
        "--osim",
        &model,
        "--coordinate",
        "flexion=hip,adduction=hip",
        "--forces",
        "gluteus=front+back",
        "--set",
        "muscle.0.edge_length=16 mm",
        "--grid=4",
        "--count=10",
        "--splice",
        "--json",
        "--out",
        shown(&out),
    ];
    for _ in 0..2 {
        let done = run(&arguments);
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    }
    let said = json(&out.join("summary.json"));
    let said = &said["moment_arms_over_poses"];
    assert_eq!(
        (said["samples"].as_u64(), said["samples_done"].as_u64()),
        (Some(16), Some(16))
    );
    let paths = said["opensim"].as_array().expect("paths");
    assert_eq!(paths.len(), 2);
    for path in paths {
        assert_eq!(
            path["coordinates"].as_array().map(Vec::len),
            Some(2),
            "{path}"
        );
        // The gluteus extends: a negative moment arm about flexion.
        let error = path["length_rms_m"].as_f64().unwrap_or(f64::NAN);
        assert!(error <= 2e-3, "{path}");
    }
    let table = fs::read_to_string(out.join("moment_arms.csv")).expect("a table");
    let mut rows = table.lines();
    let head = rows.next().expect("a header");
    assert_eq!(
        head,
        "muscle,force,sample,flexion_deg,adduction_deg,length_mean_m,moment_arm_flexion_m,moment_arm_adduction_m"
    );
    let rows: Vec<Vec<&str>> = rows.map(|row| row.split(',').collect()).collect();
    assert_eq!(rows.len(), 32);
    assert!(
        rows.iter()
            .all(|row| row[6].parse::<f64>().is_ok_and(|arm| arm < 0.0)),
        "an extensor"
    );
    let spliced = fs::read_to_string(out.join("hip_model.osim")).expect("a model");
    assert_eq!(
        (
            spliced.matches("<FunctionBasedPath").count(),
            spliced.matches("<GeometryPath").count()
        ),
        (2, 0)
    );
    let set = fs::read_to_string(out.join("hip_FunctionBasedPathSet.xml")).expect("a set");
    assert!(set.contains(
        "<coordinate_paths>/jointset/hip/flexion /jointset/hip/adduction</coordinate_paths>"
    ));
    for (change, says) in [
        (
            ("flexion=hip,adduction=hip", "flexion=hip,adducton=hip"),
            "did you mean `adduction`?",
        ),
        (("flexion=hip,adduction=hip", "flexion"), "needs a joint"),
        (
            ("flexion=hip,adduction=hip", "flexion=knee"),
            "no joint `knee`",
        ),
        (
            ("flexion=hip,adduction=hip", "flexion=hip,flexion=hip"),
            "given twice",
        ),
        (
            ("--grid=4", "--range=flexion=20deg:10deg"),
            "range of `flexion`",
        ),
        (("--grid=4", "--range=flexion=20:30"), "20"),
        (("--grid=4", "--grid=99"), "too many"),
        (
            ("gluteus=front+back", "glutaeus=front"),
            "no muscle `glutaeus`",
        ),
    ] {
        let changed = arguments.map(|word| if word == change.0 { change.1 } else { word });
        let done = run(&changed);
        assert_eq!(
            done.status.code(),
            Some(2),
            "{}: {}",
            change.1,
            text(&done.stderr)
        );
        assert!(
            text(&done.stderr).contains(says),
            "{}: {}",
            change.1,
            text(&done.stderr)
        );
    }
}

/// A scene from a model, its geometry and muscles; a motion moves it.
#[test]
fn a_scene_from_a_model_of_opensim() {
    use pliant::mesh::shapes::icosphere;
    let scratch = Scratch::folder();
    let folder = scratch.join("Geometry");
    fs::create_dir_all(&folder).expect("a folder");
    let write = |name: &str, mesh: &pliant::TriangleMesh| {
        pliant::io::write(&scratch.join(name), mesh, &[], pliant::io::Encoding::Text)
            .expect("written");
    };
    write("Geometry/ball.obj", &icosphere(1.0, 2));
    let mut muscle = icosphere(0.03, 3);
    muscle
        .vertices
        .iter_mut()
        .for_each(|v| *v = nalgebra::Point3::new(v.x + 0.055, 2.0 * v.y, v.z) * 1e3);
    fs::create_dir_all(scratch.join("muscles")).expect("a folder");
    write("muscles/soleus.obj", &muscle);
    let body = |name: &str| {
        format!(
            "<Body name=\"{name}\"><attached_geometry><Mesh name=\"g\"><scale_factors>0.03 0.03 0.03</scale_factors>\
             <mesh_file>ball.obj</mesh_file></Mesh></attached_geometry></Body>"
        )
    };
    let model = scratch.join("m.osim");
    let text_of_model = format!(
        "<OpenSimDocument Version=\"40600\"><Model name=\"m\"><BodySet name=\"bodyset\"><objects>{}{}</objects></BodySet>\
         <JointSet name=\"jointset\"><objects><WeldJoint name=\"w\"><socket_parent_frame>/ground</socket_parent_frame>\
         <socket_child_frame>/bodyset/upper</socket_child_frame></WeldJoint><PinJoint name=\"knee\"><socket_parent_frame>p</socket_parent_frame>\
         <socket_child_frame>c</socket_child_frame><coordinates><Coordinate name=\"q\"><default_value>0</default_value></Coordinate></coordinates><frames>\
         <PhysicalOffsetFrame name=\"p\"><socket_parent>/bodyset/upper</socket_parent><translation>0 -0.04 0</translation></PhysicalOffsetFrame>\
         <PhysicalOffsetFrame name=\"c\"><socket_parent>/bodyset/lower</socket_parent><translation>0 0.04 0</translation></PhysicalOffsetFrame>\
         </frames></PinJoint></objects></JointSet></Model></OpenSimDocument>",
        body("upper"),
        body("lower")
    );
    fs::write(&model, text_of_model).expect("written");
    fs::write(
        scratch.join("bend.mot"),
        "inDegrees=yes\nendheader\ntime\tq\n0\t0\n1\t20\n",
    )
    .expect("written");
    let scene = scratch.join("scene.toml");
    let (muscles, motion) = (scratch.join("muscles"), scratch.join("bend.mot"));
    let arguments = [
        "osim",
        shown(&model),
        "--muscles",
        shown(&muscles),
        "--unit",
        "mm",
        "--scene",
        shown(&scene),
        "--no-trial",
    ];
    let done = run(&arguments);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let written = fs::read_to_string(&scene).expect("a scene");
    assert!(
        written.contains("[opensim]") && written.contains("\"lower\" = \"lower\""),
        "{written}"
    );
    let out = scratch.join("out");
    let moved = run(&[
        "run",
        shown(&scene),
        "--motion",
        shown(&motion),
        "--frames=12",
        "--json",
        "--lenient",
        "--out",
        shown(&out),
    ]);
    assert_eq!(moved.status.code(), Some(0), "{}", text(&moved.stderr));
    let first = fs::read(out.join("frames/bone_lower_0000.vtp")).expect("a frame");
    let last = fs::read(out.join("frames/bone_lower_0012.vtp")).expect("a frame");
    assert!(first != last, "the bone moves");
    for (more, says) in [
        (vec!["--bodies", "middle"], "no body `middle`"),
        (vec!["--bodies", "upper", "--force"], "a scene needs two"),
        (vec![], "is there already"),
    ] {
        let done = run(&[&arguments[..], &more].concat());
        assert_eq!(done.status.code(), Some(2), "{}", text(&done.stderr));
        assert!(text(&done.stderr).contains(says), "{}", text(&done.stderr));
    }
    fs::remove_file(folder.join("ball.obj")).expect("removed");
    let done = run(&[&arguments[..], &["--force"]].concat());
    assert!(
        text(&done.stderr).contains("--geometry"),
        "{}",
        text(&done.stderr)
    );
}
