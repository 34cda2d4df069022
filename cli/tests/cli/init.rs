//! `pliant init`: a scene drafted from meshes, its guesses, and what it refuses.

use std::fs;
use std::path::{Path, PathBuf};

use super::check::code;
use super::{Scratch, pliant, shown, text};
use nalgebra::{Point3, Rotation3, Vector3};
use pliant::TriangleMesh;
use pliant::io::{self, Encoding};
use pliant::mesh::{refine, shapes};

/// The bones and the muscle of the built-in hip, with file names as from a hospital, in units of
/// `metres`.
fn hip(folder: &Path, metres: f64) {
    for (shape, name) in [
        ("hip-socket", "pelvis_right"),
        ("hip-femur", "Femur.r"),
        ("hip-gluteus", "Gluteus medius"),
    ] {
        let mut mesh = shapes::make(shape).expect("a shape").mesh;
        mesh.vertices.iter_mut().for_each(|v| v.coords /= metres);
        write(&folder.join(format!("{name}.obj")), &mesh);
    }
}

fn write(path: &Path, mesh: &TriangleMesh) {
    io::write(path, mesh, &[], Encoding::Text).expect("written");
}

/// Exit code, standard output and errors of `pliant init` in a folder.
fn init(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let done = pliant()
        .current_dir(folder)
        .arg("init")
        .args(arguments)
        .output()
        .expect("it runs");
    (code(&done), text(&done.stdout), text(&done.stderr))
}

/// The motion of a scene file: centre [mm] and axis.
fn motion(scene: &Path) -> (Point3<f64>, Vector3<f64>) {
    let scene: toml::Table = fs::read_to_string(scene)
        .expect("a scene")
        .parse()
        .expect("TOML");
    let bones = scene["bone"].as_array().expect("bones");
    let motion = bones
        .iter()
        .find_map(|bone| bone.get("motion"))
        .expect("a motion");
    let numbers = |key: &str| -> Vec<f64> {
        let each = motion[key].as_array().expect("a list").iter();
        each.map(|v| match v.as_str() {
            Some(length) => length.trim_end_matches(" mm").parse().expect("a length"),
            None => v.as_float().expect("a number"),
        })
        .collect()
    };
    (
        Point3::from_slice(&numbers("centre")),
        Vector3::from_column_slice(&numbers("axis")),
    )
}

#[test]
fn three_meshes_become_a_scene_that_runs() {
    let scratch = Scratch::folder();
    let meshes = scratch.join("scans");
    fs::create_dir(&meshes).expect("a folder");
    hip(&meshes, 1e-3);
    fs::write(meshes.join("notes.txt"), "no mesh").expect("written");
    let (code, said, errors) = init(&scratch, &["scans"]);
    assert_eq!(code, Some(0), "{said}{errors}");
    for told in [
        "unit: mm",
        "bone Femur.r: by its name: femur",
        "bone pelvis_right: by its name: pelvis",
        "muscle Gluteus medius: by its name: gluteus; held by Femur.r, pelvis_right",
        "hip: flexion of Femur.r by 60 degrees",
        "a sphere of radius",
        "pliant run hip.toml",
    ] {
        assert!(said.contains(told), "{told}: {said}");
    }
    let scene = fs::read_to_string(scratch.join("hip.toml")).expect("a scene");
    assert!(
        scene.contains("method = \"harmonic\"\n") && scene.contains("[effects.tone]\n"),
        "it crosses the joint: {scene}"
    );
    // The head of this femur is a sphere about the origin.
    let (centre, axis) = motion(&scratch.join("hip.toml"));
    assert!(centre.coords.norm() <= 0.2, "{centre}");
    assert!((axis.norm() - 1.0).abs() <= 1e-4);
    // Ten frames were run.
    let results = scratch.join("pliant-out/hip");
    let summary = super::measures(&super::json(&results.join("summary.json")));
    assert!(summary.is_object());
    assert!(results.join("report.html").is_file());
    assert_eq!(super::json(&results.join("summary.json"))["frames"], 10);
    // The scene is a user's file: a second call keeps it.
    let (code, _, errors) = init(&scratch, &["scans"]);
    assert_eq!(code, Some(2));
    assert!(
        errors.contains("hip.toml is there already") && errors.contains("--force"),
        "{errors}"
    );
    let (code, said, errors) = init(
        &scratch,
        &["scans", "--force", "--no-trial", "--joint", "none"],
    );
    assert_eq!(code, Some(0), "{errors}");
    assert!((said + &errors).contains("no bone moves"), "{errors}");
    let rests = fs::read_to_string(scratch.join("meshes.toml")).expect("a scene");
    assert!(!rests.contains("[bone.motion]") && !rests.contains("[effects.tone]"));
    // A patch of the draft that is replaced goes with it; control: another file beside it stays.
    let parts = scratch.join("hip.meshes");
    fs::create_dir_all(&parts).expect("a folder");
    let of_draft = "old-1-on-Femur.obj";
    let own = ["own-1-on-Femur.obj", "own.obj"];
    for name in [of_draft, own[0], own[1]] {
        fs::write(parts.join(name), "").expect("written");
    }
    let named = [of_draft, own[1]].map(|name| format!("# patch = \"hip.meshes/{name}\"\n"));
    fs::write(scratch.join("hip.toml"), scene + &named.concat()).expect("written");
    let again = ["scans", "--force", "--no-trial", "--joint", "hip"];
    let (code, said, errors) = init(&scratch, &again);
    assert_eq!(code, Some(0), "{errors}");
    assert!(!(said + &errors).contains("no bone moves"), "control");
    assert!(!parts.join(of_draft).exists());
    assert!(own.iter().all(|name| parts.join(name).exists()));
    // Another scene than a draft owns no files.
    fs::write(parts.join(of_draft), "").expect("written");
    let by_hand = "# By hand.\n".to_owned() + &named.concat();
    fs::write(scratch.join("hip.toml"), by_hand).expect("written");
    let (code, _, errors) = init(&scratch, &again);
    assert_eq!(code, Some(0), "{errors}");
    assert!(parts.join(of_draft).exists());
}

#[test]
fn a_segmentation_with_the_edges_of_its_voxels_becomes_a_scene_that_can_run() {
    let scratch = Scratch::folder();
    let meshes = scratch.join("scans");
    fs::create_dir(&meshes).expect("a folder");
    hip(&meshes, 1e-3);
    // A name longer than most, of which the last words tell what it is.
    let name = "Segmentation of patient 0123, second visit, series 4 - gluteus medius right";
    let coarse = meshes.join("Gluteus medius.obj");
    let mesh = io::read(&coarse).expect("a mesh").mesh;
    let fine = refine(&mesh, 1.5).expect("finer").mesh;
    assert!(fine.vertices.len() > 10_000, "{}", fine.vertices.len());
    fs::remove_file(coarse).expect("removed");
    write(&meshes.join(format!("{name}.obj")), &fine);
    let (code, said, errors) = init(&scratch, &["scans", "--no-trial"]);
    assert_eq!(code, Some(0), "{said}{errors}");
    assert!(
        said.contains(&format!("muscle {name}: by its name: gluteus")),
        "{said}"
    );
    let scene = fs::read_to_string(scratch.join("hip.toml")).expect("a scene");
    let why = format!("# the file has {} vertices", fine.vertices.len());
    assert!(
        scene.contains(&why) && scene.contains("edge_length = "),
        "{scene}"
    );
    // What is held is at most a tenth: the scene is not refused.
    let planned = pliant()
        .current_dir(&*scratch)
        .args(["plan", "hip.toml"])
        .output()
        .expect("it runs");
    let all = text(&planned.stdout) + &text(&planned.stderr);
    assert_eq!(super::check::code(&planned), Some(0), "{all}");
}

#[test]
fn a_draft_is_the_same_in_every_unit_and_place() {
    let scratch = Scratch::folder();
    let away = Vector3::new(0.4, -0.9, 0.6);
    let drafts = [
        (1e-3, Vector3::zeros()),
        (1.0, Vector3::zeros()),
        (1e-3, away),
    ]
    .map(|(metres, away)| {
        let name = format!("in-{metres}-{}", away.x);
        let folder = scratch.join(&name);
        fs::create_dir(&folder).expect("a folder");
        hip(&folder, metres);
        // What turns with the femur, and what does not.
        for (name, y) in [("Patella.r", -0.4), ("Skull", 0.7)] {
            let mut ball = shapes::icosphere(0.03, 2);
            let each = ball.vertices.iter_mut();
            each.for_each(|v| v.coords = (v.coords + Vector3::new(0.0, y, 0.0)) / metres);
            write(&folder.join(format!("{name}.obj")), &ball);
        }
        for file in fs::read_dir(&folder).expect("a folder") {
            let path = file.expect("a file").path();
            let mut mesh = io::read(&path).expect("a mesh").mesh;
            mesh.vertices.iter_mut().for_each(|v| *v += away / metres);
            write(&path, &mesh);
        }
        let scene = format!("{name}.toml");
        let arguments = [&*name, "--joint", "hip", "--no-trial", "--scene", &scene];
        let (code, _, errors) = init(&scratch, &arguments);
        assert_eq!(code, Some(0), "{errors}");
        let scene = scratch.join(scene);
        let text = fs::read_to_string(&scene).expect("a scene");
        let turns: Vec<&str> = text
            .split("[[bone]]")
            .filter(|bone| bone.contains("[bone.motion]"))
            .filter_map(|bone| bone.split('"').nth(1))
            .collect();
        assert_eq!(turns, ["Femur.r", "Patella.r"]);
        let (centre, axis) = motion(&scene);
        (centre - away * 1e3, axis)
    });
    for other in &drafts[1..] {
        // Rounded to a thousandth of a millimetre in the scene.
        assert!((drafts[0].0 - other.0).norm() <= 2e-3, "{drafts:?}");
        assert!((drafts[0].1 - other.1).norm() <= 2e-5, "{drafts:?}");
    }
}

#[test]
fn what_is_not_certain_is_refused_with_the_option_that_decides() {
    let scratch = Scratch::folder();
    let (scans, muscle) = (scratch.join("scans"), scratch.join("muscles"));
    for folder in [&scans, &muscle, &scratch.join("empty")] {
        fs::create_dir(folder).expect("a folder");
    }
    hip(&scans, 1e-3);
    let ball = shapes::icosphere(30.0, 2);
    write(&muscle.join("psoas.obj"), &ball);
    write(&scratch.join("segment_1.obj"), &ball);
    let mut far = ball.clone();
    far.vertices.iter_mut().for_each(|v| v.x += 500.0);
    write(&scratch.join("far psoas.obj"), &far);
    fs::write(scratch.join("femur.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\n").expect("written");
    let cases: [(&[&str], &[&str]); 17] = [
        (
            &["scans", "--joint", "hip", "--scene", "a\nb.toml"],
            &["line break", "--scene"],
        ),
        (
            &["scans", "--joint", "hip", "--scene", "nowhere/hip.toml"],
            &["nowhere is no folder", "--scene"],
        ),
        (&[], &["MESH"]),
        (&["empty"], &["no mesh in this folder"]),
        (&["nowhere.obj"], &["no file `nowhere.obj`"]),
        (
            &["scans", "--joint", "jaw"],
            &["`jaw` is no joint", "hip, knee, ankle, shoulder, elbow"],
        ),
        (
            &["scans", "--joint", "knee"],
            &["knee: no tibia among Femur.r, pelvis_right", "--between"],
        ),
        (
            &["scans", "--joint", "ankle"],
            &["ankle: no tibia or fibula among"],
        ),
        (
            &["scans", "--joint", "hip", "--between", "femur", "tibia"],
            &["no bone is named `tibia`"],
        ),
        (
            &["scans", "--joint", "hip", "--between", "femur", "Femur.r"],
            &["twice"],
        ),
        (
            &["scans", "segment_1.obj"],
            &["segment_1.obj: its name does not tell", "--bones segment_1"],
        ),
        (
            &["scans", "--without", "Gluteus medius"],
            &["none of the files is a muscle"],
        ),
        (
            &["scans", "--bones", "segment_2"],
            &["no file is named `segment_2`"],
        ),
        (
            &["scans", "--unit", "parsec"],
            &["`parsec` is no unit of length"],
        ),
        (&["muscles"], &["do not tell their unit", "--unit"]),
        (
            &["scans", "far psoas.obj"],
            &[
                "far psoas: no bone holds its end",
                "mm away",
                "--without 'far psoas'",
            ],
        ),
        (&["scans", "femur.obj"], &["femur.obj", "E046"]),
    ];
    for (arguments, told) in cases {
        let (code, _, errors) = init(&scratch, arguments);
        assert_eq!(code, Some(2), "{arguments:?}: {errors}");
        for told in told {
            assert!(errors.contains(told), "{arguments:?}, {told}: {errors}");
        }
    }
    assert!(!scratch.join("hip.toml").exists() && !scratch.join("meshes.toml").exists());
    // Control: the same file with the option.
    let (code, _, errors) = init(&scratch, &["scans", "--unit", "mm", "--no-trial"]);
    assert_eq!(code, Some(0), "{errors}");
}

/// The measured bones and muscles, if they are here.
pub(super) fn measured() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("PLIANT_DATA")
        .map_or(beside, PathBuf::from)
        .join("body");
    folder.is_dir().then_some(folder)
}

/// Joint, bones and muscles of the data, centre [mm], its tolerance [mm] and a direction of the axis.
type Case = (
    &'static str,
    &'static [&'static str],
    &'static [&'static str],
    [f64; 3],
    f64,
    [f64; 3],
);

/// The centre of the hip is that of the data's description, fitted by others; the others were fitted by a
/// program of their own in numpy. The data look to +z, up is +y, and x < 0 is the right side: a hip and
/// an elbow bend about -x, a knee about +x.
const CASES: [Case; 4] = [
    (
        "hip",
        &["Hip_bone.r", "Femur.r"],
        &["Iliacus_muscle.r", "Pectineus_muscle.r"],
        [-83.56, 860.46, -5.13],
        0.5,
        [-1.0, 0.0, 0.0],
    ),
    (
        "knee",
        &["Femur.r", "Tibia.r"],
        &[
            "Vastus_lateralis_muscle.r",
            "Medial_head_of_gastrocnemius.r",
        ],
        [-73.0, 455.0, -37.5],
        2.0,
        [1.0, 0.0, 0.0],
    ),
    (
        "shoulder",
        &["Scapula.r", "Humerus.r"],
        &["Infraspinatus_muscle.r", "Subscapularis_muscle.r"],
        [-167.8, 1383.2, -29.0],
        0.5,
        [-0.6, 0.0, -0.8],
    ),
    (
        "elbow",
        &["Humerus.r", "Ulna.r"],
        &["Brachialis_muscle.r", "Long_head_of_biceps_brachii.r"],
        [-216.5, 1103.5, -39.0],
        1.5,
        [-1.0, 0.0, 0.0],
    ),
];

/// The same bones as of a left side, lying on a scanner's table, in millimetres: the same joints.
fn another_subject(scratch: &Path, data: &Path) {
    let turn = Rotation3::from_euler_angles(1.2, -0.4, 2.5);
    for (joint, bones, muscles, ..) in CASES {
        let folder = scratch.join(format!("left {joint}"));
        fs::create_dir(&folder).expect("a folder");
        let bones = bones.iter().map(|name| ("bones", name));
        for (of, name) in bones.chain(muscles.iter().map(|name| ("muscles", name))) {
            let file = data.join(of).join(format!("{name}.obj"));
            let mut mesh = io::read(&file).expect("a mesh").mesh;
            for v in &mut mesh.vertices {
                *v = turn * Point3::new(-v.x, v.y, v.z) * 1e3 + Vector3::new(300.0, -80.0, 9.0);
            }
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
            write(
                &folder.join(format!("{}.obj", name.trim_end_matches(".r"))),
                &mesh,
            );
        }
        let (scene, given) = (format!("left {joint}.toml"), format!("left {joint}"));
        let arguments = [&given, "--joint", joint, "--no-trial", "--scene", &scene];
        let (code, said, errors) = init(scratch, &arguments);
        assert_eq!(code, Some(0), "{joint}: {errors}");
        assert!(said.contains("unit: mm"), "{said}");
        let (centre, axis) = motion(&scratch.join(&scene));
        let (right, about) = motion(&scratch.join(format!("scenes/{joint}.toml")));
        let there =
            turn * Point3::new(-right.x, right.y, right.z) + Vector3::new(300.0, -80.0, 9.0);
        assert!((centre - there).norm() <= 0.02, "{joint}: {centre} {there}");
        // A sense of turning is mirrored the other way round.
        let same = turn * Vector3::new(about.x, -about.y, -about.z);
        assert!((axis - same).norm() <= 1e-3, "{joint}: {axis:?} {same:?}");
        let held = |path: &Path| {
            let text = fs::read_to_string(path).expect("a scene");
            text.matches("[[muscle.attachment]]").count()
        };
        let of_right = held(&scratch.join(format!("scenes/{joint}.toml")));
        assert_eq!(held(&scratch.join(&scene)), of_right, "{joint}");
        // Without a patella the vastus lacks its tendon, and the biceps that to the forearm.
        let added = said
            .matches("which the file lacks and the draft adds")
            .count();
        let lacking = usize::from(["knee", "elbow"].contains(&joint));
        assert_eq!(added, lacking, "{joint}: {said}");
    }
}

#[test]
fn joints_of_measured_bones() {
    let Some(data) = measured() else {
        println!("skipped: 5 joints of measured bones, because there are no data");
        return;
    };
    let scratch = Scratch::folder();
    fs::create_dir(scratch.join("scenes")).expect("a folder");
    let file = |folder: &str, name: &str| data.join(folder).join(format!("{name}.obj"));
    for (joint, bones, muscles, centre, tolerance, axis) in CASES {
        let bones = bones.iter().map(|name| file("bones", name));
        let files: Vec<PathBuf> = bones
            .chain(muscles.iter().map(|name| file("muscles", name)))
            .collect();
        let mut arguments: Vec<&str> = files.iter().map(|file| shown(file)).collect();
        // Each pair of bones has one joint, so that its name need not be given. Meshes beside a scene are
        // found from its folder.
        let scene = format!("scenes/{joint}.toml");
        arguments.extend(["--no-trial", "--scene", &scene]);
        let (code, said, errors) = init(&scratch, &arguments);
        assert_eq!(code, Some(0), "{joint}: {errors}");
        assert!(
            said.contains("unit: m") && said.contains(&format!("{joint}: ")),
            "{said}"
        );
        let (found, about) = motion(&scratch.join(&scene));
        let off = (found - Point3::from(centre)).norm();
        assert!(off <= tolerance, "{joint}: {off} mm");
        // Within 15 degrees, in this sense.
        assert!(
            about.dot(&Vector3::from(axis)) >= 0.966,
            "{joint}: {about:?}"
        );
        // What is drafted passes every check before the first frame.
        let planned = pliant()
            .current_dir(&*scratch)
            .args(["plan", &scene])
            .output();
        assert_eq!(code, planned.expect("it runs").status.code());
    }
    another_subject(&scratch, &data);
    let files = [
        file("bones", "Tibia.r"),
        file("bones", "Fibula.r"),
        file("muscles", "Soleus_muscle.r"),
    ];
    let mut arguments: Vec<&str> = files.iter().map(|file| shown(file)).collect();
    arguments.extend(["--joint", "ankle"]);
    let (code, _, errors) = init(&scratch, &arguments);
    assert_eq!(code, Some(2));
    assert!(
        errors.contains("no talus or foot or calcaneus among Tibia.r, Fibula.r"),
        "{errors}"
    );
}
