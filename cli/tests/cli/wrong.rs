//! Results that are wrong: each turns the check red that is made for it, and the exit code is 1.
//!
//! `docs/verification.md` lists them. Each case has a control: the same without the mistake passes
//! that check.

use std::fs;
use std::path::Path;

use pliant::io::{self, Encoding};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::{box_surface, icosphere};
use serde_json::Value;

use super::init::measured;
use super::{Scratch, run, shown, text};

/// One way of being wrong.
struct Case {
    what: &'static str,
    /// The arguments of the command; `{}` is the folder of the meshes.
    arguments: &'static [&'static str],
    /// What is added to be wrong.
    wrong: &'static [&'static str],
    /// The check that turns red.
    check: &'static str,
}

/// Forty frames of the hip with long edges.
const COARSE_HIP: &[&str] = &[
    "run",
    "hip",
    "--frames",
    "40",
    "--set",
    "muscle.0.edge_length=12 mm",
];

/// Runs of scenes.
const RUNS: &[Case] = &[
    Case {
        what: "too few sweeps",
        arguments: &["run", "chain"],
        wrong: &["--set", "solver.pbd.tolerance=0.01"],
        check: "frames that did not converge",
    },
    Case {
        what: "steps that are too long for the motion",
        arguments: COARSE_HIP,
        wrong: &["--set", "solver.xpbd.substeps=1"],
        check: "frames that did not converge",
    },
    Case {
        what: "contact that leaves bones out",
        arguments: COARSE_HIP,
        wrong: &["--set", "effects.contact.between=['muscles']"],
        check: "crossings of a soft and a rigid surface",
    },
    Case {
        what: "no equilibrium: only angles are kept under a load",
        arguments: &["run", "shape", "--frames", "3"],
        wrong: &["--set", "solver=quasi_static"],
        check: "all numbers are finite",
    },
    Case {
        what: "a frame rate that no motion has",
        arguments: &["run", "{}/pulled.toml"],
        wrong: &["--set", "frame_rate=1e9 Hz"],
        check: "velocities that were cut",
    },
    Case {
        what: "a file in metres that is read in millimetres",
        arguments: &[
            "run",
            "--muscles",
            "{}/ball.obj",
            "--frames",
            "1",
            "--unit",
            "m",
        ],
        wrong: &["--unit", "mm"],
        check: "its length is that of a part of a body",
    },
    Case {
        what: "a file in millimetres that is read in metres",
        arguments: &[
            "run",
            "--muscles",
            "{}/ball-in-mm.obj",
            "--frames",
            "1",
            "--unit",
            "mm",
        ],
        wrong: &["--unit", "m"],
        check: "its length is that of a part of a body",
    },
    Case {
        what: "bones that tear an edge between their attachments",
        arguments: &["run", "{}/pulled.toml"],
        wrong: &[
            "--set",
            "bone.0.mesh={}/left.obj",
            "--set",
            "bone.1.mesh={}/right.obj",
            "--set",
            "bone.1.motion.keys.1.translation=['60 mm','0 mm','0 mm']",
        ],
        check: "greatest length of an edge between attachments",
    },
    Case {
        what: "a bone that leaves with its attachment",
        arguments: &["run", "{}/pulled.toml"],
        wrong: &[
            "--set",
            "bone.1.motion.keys.1.translation=['0 mm','400 mm','0 mm']",
        ],
        check: "greatest strain of an edge",
    },
    Case {
        what: "a motion that drives a bone into another",
        arguments: &[
            "run",
            "{}/pulled.toml",
            "--set",
            "bone.0.mesh={}/left.obj",
            "--set",
            "bone.1.mesh={}/right.obj",
        ],
        wrong: &[
            "--set",
            "bone.1.motion.keys.1.translation=['-4 mm','-5 mm','0 mm']",
        ],
        check: "growth of the depth of two rigid surfaces",
    },
    Case {
        what: "muscles that share most of their space in the files",
        arguments: &["run", "{}/two.toml"],
        wrong: &["--set", "muscle.1.mesh={}/ball-inside.obj"],
        check: "motion that parted overlapping surfaces at the start",
    },
    Case {
        what: "a fold: a muscle without bending between closing plates",
        arguments: &["run", "{}/pulled.toml"],
        wrong: &[
            "--set",
            "bone.1.motion.keys.1.translation=['0 mm','-40 mm','0 mm']",
            "--set",
            "effects.bending=off",
        ],
        check: "greatest angle of a fold",
    },
    Case {
        what: "a muscle that is pressed flat",
        arguments: &["run", "{}/pulled.toml"],
        wrong: &[
            "--set",
            "bone.1.motion.keys.1.translation=['0 mm','170 mm','0 mm']",
            "--set",
            "effects.volume=off",
        ],
        check: "least thickness, relative to that at rest",
    },
    Case {
        what: "a motion that jerks",
        arguments: &["run", "{}/pulled.toml"],
        wrong: &[
            "--set",
            "effects.gravity.acceleration=['0 m/s2','0 m/s2','100 m/s2']",
        ],
        check: "jitter while bones move steadily",
    },
    Case {
        what: "a free vertex that is thrown",
        arguments: &["run", "{}/pulled.toml"],
        wrong: &[
            "--set",
            "effects.gravity.acceleration=['0 m/s2','0 m/s2','60 m/s2']",
        ],
        check: "greatest speed, relative to the attachments",
    },
    Case {
        what: "a muscle that nothing stretches back",
        arguments: COARSE_HIP,
        wrong: &[
            "--set",
            "muscle.0.material.stretch=1e-6 N/m",
            "--set",
            "muscle.0.material.bending=1e-9 N m",
        ],
        check: "greatest angle of a fold",
    },
    Case {
        what: "a weight that no muscle has",
        arguments: COARSE_HIP,
        wrong: &[
            "--set",
            "effects.gravity.acceleration=['0 m/s2','-9810 m/s2','0 m/s2']",
        ],
        check: "all numbers are finite",
    },
    Case {
        what: "a contact thicker than the muscle",
        arguments: COARSE_HIP,
        wrong: &["--set", "effects.contact.thickness=30 mm"],
        check: "velocities that were cut",
    },
    Case {
        what: "a muscle as light as air in a vacuum",
        arguments: COARSE_HIP,
        wrong: &["--set", "muscle.0.material.density=1e-3 kg/m3"],
        check: "frames that did not converge",
    },
    Case {
        what: "a tolerance that steps do not reach",
        arguments: COARSE_HIP,
        wrong: &["--set", "solver.xpbd.tolerance=1e-9"],
        check: "frames that did not converge",
    },
    Case {
        what: "a muscle that wants twice its volume",
        arguments: COARSE_HIP,
        wrong: &["--set", "effects.volume.pressure=2"],
        check: "jitter while bones move steadily",
    },
    Case {
        what: "a muscle that no bone holds",
        arguments: COARSE_HIP,
        wrong: &["--set", "muscle.0.attachment=off"],
        check: "lift-off from bones",
    },
    Case {
        what: "fibres of another muscle",
        arguments: &[
            "run",
            "{}/pulled.toml",
            "--set",
            "muscle.0.fibres={ lines = '{}/fibres.vtk', unit = 'm' }",
        ],
        wrong: &["--set", "muscle.0.fibres.lines={}/fibres-beside.vtk"],
        check: "distance of the fibres from the muscle",
    },
    Case {
        what: "an end that the bone on the other side of a joint holds, as a mesh without its tendon",
        arguments: &["run", "{}/pulled.toml"],
        wrong: &[
            "--set",
            "muscle.0.attachment=[{ bone = 'high', patch = '{}/low.obj', unit = 'm', within = '13 mm' }]",
        ],
        check: "distance of an end from the bone that holds it across a joint",
    },
];

/// Fibres of a bent muscle.
const ARC: &[&str] = &[
    "fibres",
    "{}/arc.obj",
    "--unit",
    "m",
    "--origin",
    "vertices:{}/first.txt",
    "--insertion",
    "vertices:{}/last.txt",
];

/// Other commands.
const OTHERS: &[Case] = &[
    Case {
        what: "pairs that turn a body half round: halfway it is a line",
        arguments: &[
            "morph",
            "{}/ball.obj",
            "{}/ball.obj",
            "--unit",
            "m",
            "--frames",
            "5",
        ],
        wrong: &["--pairs", "{}/turned.txt"],
        check: "least volume on the way",
    },
    Case {
        what: "fibres that go down a muscle and come back",
        arguments: ARC,
        wrong: &["{}/arc.obj => {}/round.obj"],
        check: "fibres that turn back by more than 120 degrees",
    },
    Case {
        what: "fibres across the line of action",
        arguments: ARC,
        wrong: &["{}/arc.obj => {}/round.obj"],
        check: "mean angle between fibres and line of action",
    },
    Case {
        what: "bodies thinner than the cells of their distance fields",
        arguments: &[
            "morph",
            "{}/low.obj",
            "{}/high.obj",
            "--unit",
            "m",
            "--frames",
            "3",
            "--method",
            "volume",
            "--cells",
            "32",
        ],
        wrong: &["32 => 8"],
        check: "distance of A and B from the shapes at their ends",
    },
    Case {
        what: "a muscle that goes round, such as two that were joined at an end",
        arguments: ARC,
        wrong: &["{}/arc.obj => {}/round.obj"],
        check: "length of a fibre, relative to the distance of its ends",
    },
    Case {
        what: "a lattice that is stopped on its way",
        arguments: &["springs", "--lattice", "4x4x5"],
        wrong: &["--steps", "3"],
        check: "the system is at rest",
    },
    Case {
        what: "a lattice without damping, which swings on",
        arguments: &["springs", "--lattice", "4x4x5"],
        wrong: &["--damping", "0"],
        check: "the system is at rest",
    },
    Case {
        what: "one piece of a mesh inside out, its volume the smaller one",
        arguments: &["check", "{}/apart.obj", "--unit", "m"],
        wrong: &["{}/apart-inside-out.obj"],
        check: "a simulation accepts the mesh",
    },
];

fn write(path: &Path, mesh: &TriangleMesh) {
    io::write(path, mesh, &[], Encoding::Text).unwrap();
}

fn moved(mesh: &TriangleMesh, by: [f64; 3], scale: f64) -> TriangleMesh {
    let mut mesh = mesh.clone();
    for v in &mut mesh.vertices {
        *v = nalgebra::Point3::from(v.coords * scale + nalgebra::Vector3::from(by));
    }
    mesh
}

/// Meshes and scenes of the cases.
fn folder() -> Scratch {
    let scratch = Scratch::folder();
    let ball = icosphere(0.05, 3);
    write(&scratch.join("ball.obj"), &ball);
    write(
        &scratch.join("ball-in-mm.obj"),
        &moved(&ball, [0.0; 3], 1e3),
    );
    write(
        &scratch.join("ball-beside.obj"),
        &moved(&ball, [0.12, 0.0, 0.0], 1.0),
    );
    for (name, x) in [("fibres.vtk", 0.0), ("fibres-beside.vtk", 0.12)] {
        let line = [-0.04, 0.0, 0.04].map(|y| nalgebra::Point3::new(x, y, 0.0));
        let mesh = TriangleMesh {
            vertices: line.into(),
            triangles: Vec::new(),
        };
        let path = scratch.join(name);
        io::write(&path, &mesh, &[vec![0, 1, 2]], Encoding::Text).unwrap();
    }
    write(
        &scratch.join("ball-inside.obj"),
        &moved(&ball, [0.065, 0.0, 0.0], 1.0),
    );
    let mut apart = ball.clone();
    let small = moved(&ball, [0.2, 0.0, 0.0], 0.5);
    let first = apart.vertices.len() as u32;
    apart.vertices.extend(small.vertices);
    let all = small.triangles.iter().map(|t| t.map(|v| v + first));
    apart.triangles.extend(all);
    write(&scratch.join("apart.obj"), &apart);
    let turned = apart.triangles.iter_mut().filter(|t| t[0] >= first);
    turned.for_each(|t| t.swap(0, 1));
    write(&scratch.join("apart-inside-out.obj"), &apart);
    // Points of the ball, and where a half turn about z brings them.
    let nearest = |x: f64, y: f64| {
        let far = |v: &usize| (ball.vertices[*v] - nalgebra::Point3::new(x, y, 0.0)).norm();
        (0..first as usize)
            .min_by(|a, b| far(a).total_cmp(&far(b)))
            .unwrap()
    };
    let pair = |x: f64, y: f64| format!("{} {}\n", nearest(x, y), nearest(-x, -y));
    let pairs = [
        pair(0.05, 0.0),
        pair(-0.05, 0.0),
        pair(0.0, 0.05),
        pair(0.0, -0.05),
    ];
    fs::write(scratch.join("turned.txt"), pairs.concat()).unwrap();
    let (around, along) = (12, 40);
    write(&scratch.join("arc.obj"), &bent(90.0, [around, along]));
    write(&scratch.join("round.obj"), &bent(300.0, [around, along]));
    for (name, ring) in [("first.txt", 0), ("last.txt", along)] {
        let vertices = (0..around).map(|k| format!("{} ", ring * around + k));
        fs::write(scratch.join(name), vertices.collect::<String>()).unwrap();
    }
    let plate = box_surface([0.2, 0.02, 0.2], 0.02);
    write(
        &scratch.join("low.obj"),
        &moved(&plate, [0.0, -0.062, 0.0], 1.0),
    );
    write(
        &scratch.join("high.obj"),
        &moved(&plate, [0.0, 0.062, 0.0], 1.0),
    );
    for (name, x) in [("left.obj", -0.1005), ("right.obj", 0.1005)] {
        write(&scratch.join(name), &moved(&plate, [x, -0.062, 0.0], 1.0));
    }
    let effects = "[limits]\njitter = '0.5 mm'\n[effects.stretch]\n[effects.bending]\n[effects.volume]\n\
        [effects.contact]\nthickness = '0.5 mm'\n[effects.damping]\nrate = '5 1/s'\n";
    fs::write(
        scratch.join("pulled.toml"),
        format!(
            "frames = 12\nframe_rate = '60 Hz'\n\
             [[bone]]\nname = 'low'\nmesh = 'low.obj'\nunit = 'm'\n\
             [[bone]]\nname = 'high'\nmesh = 'high.obj'\nunit = 'm'\n[bone.motion]\n\
             keys = [{{ frame = 0 }}, {{ frame = 10, translation = ['0 mm', '5 mm', '0 mm'] }}]\n\
             [[muscle]]\nname = 'ball'\nmesh = 'ball.obj'\nunit = 'm'\n\
             [[muscle.attachment]]\nbone = 'low'\nnear = '6 mm'\n\
             [[muscle.attachment]]\nbone = 'high'\nnear = '6 mm'\n{effects}\
             [effects.gravity]\nacceleration = ['0 m/s2', '0 m/s2', '0 m/s2']\n"
        ),
    )
    .unwrap();
    fs::write(
        scratch.join("two.toml"),
        format!(
            "frames = 1\nframe_rate = '60 Hz'\n\
             [[muscle]]\nname = 'one'\nmesh = 'ball.obj'\nunit = 'm'\n\
             [[muscle]]\nname = 'two'\nmesh = 'ball-beside.obj'\nunit = 'm'\n{effects}"
        ),
    )
    .unwrap();
    scratch
}

/// A tube of 10 mm radius along an arc of some `degrees` with a radius of 50 mm: rings of vertices, and a
/// cap at each end.
fn bent(degrees: f64, [around, along]: [u32; 2]) -> TriangleMesh {
    let full = std::f64::consts::TAU;
    let place = |k: u32, ring: u32, inside: f64| {
        let turned = full * f64::from(ring) / f64::from(along) * degrees / 360.0;
        let angle = full * f64::from(k) / f64::from(around);
        let out = 0.05 + 0.01 * inside * angle.cos();
        nalgebra::Point3::new(
            out * turned.cos(),
            out * turned.sin(),
            0.01 * inside * angle.sin(),
        )
    };
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for ring in 0..=along {
        vertices.extend((0..around).map(|k| place(k, ring, 1.0)));
    }
    let rings = (0..along).flat_map(|ring| (0..around).map(move |k| (ring, k)));
    for (ring, k) in rings {
        let next = (k + 1) % around;
        let corner = |ring: u32, k: u32| ring * around + k;
        let [a, b] = [corner(ring, k), corner(ring, next)];
        let [c, d] = [corner(ring + 1, next), corner(ring + 1, k)];
        triangles.extend([[a, d, c], [a, c, b]]);
    }
    for (ring, turned) in [(0, false), (along, true)] {
        let middle = vertices.len() as u32;
        vertices.push(place(0, ring, 0.0));
        for k in 0..around {
            let (a, b) = (ring * around + k, ring * around + (k + 1) % around);
            triangles.push(if turned {
                [middle, b, a]
            } else {
                [middle, a, b]
            });
        }
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// The arguments, where an option of `more` replaces one of the same name, and `A => B` an argument;
/// `--set` adds to it.
fn together<'a>(arguments: &'a [String], more: &'a [String]) -> Vec<&'a str> {
    let mut given: Vec<&str> = arguments.iter().map(String::as_str).collect();
    for option in more.iter().filter(|a| a.starts_with("--") && *a != "--set") {
        if let Some(at) = given.iter().position(|a| a == option) {
            given.drain(at..at + 2);
        }
    }
    for change in more {
        match change.split_once(" => ") {
            None => given.push(change),
            Some((from, to)) => given
                .iter_mut()
                .filter(|a| **a == from)
                .for_each(|a| *a = to),
        }
    }
    given
}

/// The exit code, whether the check passed (`None` without it), and all that was said.
fn outcome(case: &Case, more: &[&str], folder: &Path) -> (Option<i32>, Option<bool>, String) {
    let out = folder.join("out");
    let placed = |all: &[&str]| -> Vec<String> {
        all.iter().map(|a| a.replace("{}", shown(folder))).collect()
    };
    let (base, more) = (placed(case.arguments), placed(more));
    let mut given = together(&base, &more);
    given.push("--json");
    if case.arguments[0] != "check" {
        given.extend(["--out", shown(&out)]);
    }
    let done = run(&given);
    let summary: Value = serde_json::from_slice(&done.stdout).unwrap_or_default();
    let verdicts = summary["verdicts"].as_array().cloned().unwrap_or_default();
    let is_of = |v: &&Value| {
        v["name"]
            .as_str()
            .is_some_and(|n| n.starts_with(case.check))
    };
    let mut of = verdicts.iter().filter(is_of).peekable();
    let passed = of.peek().is_some().then(|| of.all(|v| v["passed"] == true));
    (done.status.code(), passed, text(&done.stderr))
}

fn check_all(cases: &[Case]) {
    let scratch = folder();
    let mut faults = Vec::new();
    for case in cases {
        let (_, control, said) = outcome(case, &[], &scratch);
        if control == Some(false) {
            faults.push(format!("{}: the control is red: {said}", case.what));
        }
        let (code, passed, said) = outcome(case, case.wrong, &scratch);
        if (code, passed) != (Some(1), Some(false)) {
            faults.push(format!("{}: {code:?}, {passed:?}: {said}", case.what));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Number of cases of one test of runs: each runs twice, and a test lasts half a minute.
const HALF: usize = RUNS.len() / 2;

#[test]
fn wrong_runs_are_red() {
    check_all(&RUNS[..HALF]);
}

#[test]
fn more_wrong_runs_are_red() {
    check_all(&RUNS[HALF..]);
}

#[test]
fn wrong_results_of_other_commands_are_red() {
    check_all(OTHERS);
}

#[test]
fn a_moment_arm_that_leaves_straight_lines_is_red() {
    let Some(data) = measured() else {
        println!("skipped: 2 moment arms of measured muscles, because there are no data");
        return;
    };
    let scratch = Scratch::folder();
    let file = |name: &str| shown(&data).to_owned() + "/" + name + ".r.obj";
    let files = [
        "bones/Femur",
        "bones/Tibia",
        "bones/Fibula",
        "bones/Hip_bone",
    ]
    .into_iter()
    .chain([
        "muscles/Long_head_of_biceps_femoris",
        "muscles/Vastus_lateralis_muscle",
    ])
    .map(file);
    let files: Vec<String> = files.collect();
    let scene = scratch.join("knee.toml");
    let mut init = vec!["init"];
    init.extend(files.iter().map(String::as_str));
    init.extend(["--joint", "knee", "--no-trial", "--scene", shown(&scene)]);
    let done = run(&init);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let sweep = [
        "moment-arms",
        shown(&scene),
        "--joint",
        "knee",
        "--from",
        "-30deg",
        "--to",
        "30deg",
    ];
    let out = scratch.join("out");
    let how = [
        "--step",
        "5deg",
        "--count",
        "20",
        "--json",
        "--out",
        shown(&out),
    ];
    let done = run(&[&sweep[..], &how].concat());
    // In flexion the biceps shortens and should leave the femur; the spread rotation bends it along the
    // bone. In flexion the femur blocks straight lines of the vastus, and it has no such check. In
    // extension it has one.
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    let summary: Value = serde_json::from_slice(&done.stdout).unwrap();
    let of = |muscle: &str| {
        let verdicts = summary["verdicts"].as_array().unwrap().iter();
        let is_of = |v: &&Value| {
            let [name, at] = ["name", "where"].map(|key| v[key].as_str().unwrap_or_default());
            name.starts_with("difference from straight lines") && at.starts_with(muscle)
        };
        verdicts.clone().find(is_of).map(|v| v["passed"].clone())
    };
    assert_eq!(
        of("Long_head_of_biceps_femoris"),
        Some(Value::Bool(false)),
        "{summary:#}"
    );
    assert_eq!(of("Vastus_lateralis"), Some(Value::Bool(true)), "control");
}
