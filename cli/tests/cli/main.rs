//! The command as a person or a script uses it: exit codes, messages, and the files of a run.

mod audit;
mod biceps;
#[cfg(unix)]
mod book;
mod check;
mod contact;
mod data;
mod fibres;
mod folder;
mod implant;
mod init;
mod intervals;
mod moment_arms;
mod morph;
#[cfg(unix)]
mod page;
mod plan;
mod recomputed;
mod register;
mod resume;
mod schema;
mod springs;
mod staged;
mod stress;
mod study;
mod verdicts;
mod view;
mod wrong;

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use pliant::io::{self, Encoding};
use pliant::mesh::measures::max_or_nan;
use pliant::mesh::shapes;
use pliant::testing::Scratch;
use serde_json::Value;

fn pliant() -> Command {
    Command::new(env!("CARGO_BIN_EXE_pliant"))
}

fn run(arguments: &[&str]) -> Output {
    pliant().args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn shown(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Runs a scene into a folder, expects success.
fn run_into(folder: &Path, arguments: &[&str]) -> Output {
    let done = pliant()
        .arg("run")
        .args(arguments)
        .args(["--out", shown(folder)])
        .output()
        .unwrap();
    assert_eq!(
        done.status.code(),
        Some(0),
        "{arguments:?}: {}",
        text(&done.stderr)
    );
    done
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// The measures of a summary, which has the form of the schema; they stand under the name of its kind.
fn measures(summary: &Value) -> Value {
    schema::assert_valid(summary);
    summary[summary["kind"].as_str().unwrap_or_default()].clone()
}

/// The turn-table of a page with its script, and the page without it.
fn turntable(page: &str) -> (String, String) {
    let at = page.find("<h2>Frame by frame</h2>").expect("a turn-table");
    let end = at + page[at..].find("</script>").expect("its script");
    (
        page[at..end].to_owned(),
        format!("{}{}", &page[..at], &page[end..]),
    )
}

/// The files that a collection refers to. Each file must exist.
fn referenced(folder: &Path, pvd: &str) -> Vec<String> {
    let text = fs::read_to_string(folder.join(pvd)).unwrap();
    assert!(text.ends_with("</VTKFile>\n"));
    let files: Vec<String> = text
        .split("file=\"")
        .skip(1)
        .map(|rest| rest.split('"').next().unwrap().to_owned())
        .collect();
    for file in &files {
        let bytes = fs::read(folder.join(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
        assert!(bytes.ends_with(b"</VTKFile>\n"), "{file} is not whole");
    }
    files
}

/// The surfaces among the files of a folder.
fn surfaces_in(folder: &Path) -> Vec<String> {
    let mut names = names_in(folder);
    names.retain(|file| file.ends_with(".vtp"));
    names
}

fn names_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn wrong_input_is_refused_with_code_2_and_a_way_out() {
    let scratch = Scratch::folder();
    let garbage = scratch.join("garbage.obj");
    fs::write(&garbage, "v 1 2\nf 1 2 9\n").unwrap();
    let scene = scratch.join("scene.toml");
    fs::write(&scene, "frames = 3\nfarme_rate = \"60 Hz\"\n").unwrap();
    let study = scratch.join("study.toml");
    fs::write(&study, "scene = \"chain\"\n[vary]\nframes = [1, 2]\n").unwrap();
    let (garbage, scene, study) = (shown(&garbage), shown(&scene), shown(&study));
    let below = scratch.join("scene.toml/below");
    let here = shown(&scratch);
    let cases: [(&[&str], &[&str]); 23] = [
        (
            &["run", garbage],
            &["is a mesh, not a scene", "pliant init"],
        ),
        (
            &["plan", study],
            &["is a study, not a scene", "pliant study"],
        ),
        (
            &["run", "hip", "--accuracy", "1"],
            &[
                "`1` has no unit",
                "\"1 %\" of a muscle's length, \"1 % of motion\", or \"1 mm\"",
            ],
        ),
        (
            &["plan", "hip", "--set", "bone.femur.motion.keys.1.angle=90"],
            &["write \"90 deg\""],
        ),
        (&["run", here], &["is a folder", "E060", "pliant scenes"]),
        (
            &["run", "distance", "--out", shown(&below)],
            &["scene.toml` is not a folder", "--out"],
        ),
        (
            &["run", "distance", "--threads", "0"],
            &["--threads", "1..=1024"],
        ),
        (
            &["run", "distance", "--set", "damping.rate=nan 1/s"],
            &["`nan 1/s` is not a finite number"],
        ),
        (
            &["run", "--muscles", "nowhere.obj", "--unit", "mm"],
            &["no file `nowhere.obj`; check the path"],
        ),
        (
            &["run", "distanse"],
            &[
                "there is no scene `distanse`, did you mean `distance`?",
                "E063",
            ],
        ),
        (&["run", "nowhere.toml"], &["no file `nowhere.toml`"]),
        (
            &["run", scene],
            &["scene.toml:2:1: error[E052]", "did you mean `frame_rate`?"],
        ),
        (
            &["run", "distance", "--set", "substep=3"],
            &["unknown key `substep`", "known keys"],
        ),
        (
            &["run", "--muscles", garbage],
            &["do not say their length unit", "--unit mm"],
        ),
        (
            &["run", "--muscles", garbage, "--unit", "mm"],
            &["garbage.obj"],
        ),
        (
            &["run", "--muscles", garbage, "--unit", "parsec"],
            &["`parsec` is no unit of length", "mm"],
        ),
        (
            &["run", "distance", "--out", garbage],
            &["is not a folder", "--out"],
        ),
        (&["run", "distance", "--frames", "0"], &["--frames"]),
        (
            &["run", "distance", "--accuracy", "1"],
            &["`1` has no unit", "E050"],
        ),
        (
            &["run", "distance", "--accuracy", "200 %"],
            &["at most 100 %", "E051"],
        ),
        (
            &["run", "distance", "--accuracy", "1 %"],
            &["classic PBD has no energy"],
        ),
        (
            &["accuracy", "distance", "--out", here],
            &["classic PBD has no energy", "--set solver=xpbd"],
        ),
        (
            &["accuracy", "distance", "--budget", "3 fortnights"],
            &["no unit of time", "ms, s, min, h"],
        ),
    ];
    for (arguments, expected) in cases {
        let done = run(arguments);
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {message}");
        for part in expected {
            assert!(
                message.contains(part),
                "{arguments:?}: `{part}` is not in: {message}"
            );
        }
        assert!(
            !message.contains("panicked") && !message.contains("RUST_BACKTRACE"),
            "{message}"
        );
        assert!(done.stdout.is_empty(), "{arguments:?}");
    }
    assert_eq!(fs::read_to_string(garbage).unwrap(), "v 1 2\nf 1 2 9\n");
}

#[test]
fn every_command_has_help_with_an_example() {
    for arguments in [
        &["--help"][..],
        &["run", "--help"],
        &["plan", "--help"],
        &["scenes", "--help"],
        &["data", "--help"],
        &["contact", "--help"],
        &["accuracy", "--help"],
        &["springs", "--help"],
        &["morph", "--help"],
        &["register", "--help"],
        &["study", "--help"],
    ] {
        let done = run(arguments);
        assert_eq!(done.status.code(), Some(0));
        let help = text(&done.stdout);
        assert!(
            help.contains("Example") && help.contains("  pliant "),
            "{arguments:?}: {help}"
        );
    }
    assert_eq!(run(&["scenes", "show", "--help"]).status.code(), Some(0));
    assert_eq!(run(&["--version"]).status.code(), Some(0));
}

#[test]
fn small_scenes_leave_whole_files() {
    for scene in ["distance", "shape", "volume", "chain"] {
        let scratch = Scratch::folder();
        let out = scratch.join("out");
        let done = run_into(&out, &[scene, "--frames", "5", "--json"]);
        let summary = json(&out.join("summary.json"));
        let printed: Value =
            serde_json::from_slice(&done.stdout).expect("nothing but JSON on standard output");
        assert_eq!(printed, summary);
        check_keys(&summary);
        assert_eq!(summary["name"], scene);
        assert_eq!(summary["frames"], 5);
        let files = referenced(&out, &format!("{scene}.pvd"));
        let bones = if scene == "chain" { 0 } else { 1 };
        assert_eq!(files.len(), 6 * (1 + bones), "{scene}");
        // The same frames as blocks with names.
        let blocks = names_in(&out.join("frames"));
        let blocks = blocks.iter().filter(|file| file.ends_with(".vtm"));
        let list = json(&out.join(format!("{scene}.vtm.series")));
        assert_eq!(
            (blocks.count(), list["files"].as_array().map(Vec::len)),
            (6, Some(6))
        );
        // A bone at rest is written once.
        assert_eq!(surfaces_in(&out.join("frames")).len(), 6 + bones, "{scene}");
        for (table, rows) in [("measures.csv", 6), ("times.csv", 5)] {
            let table = fs::read_to_string(out.join(table)).unwrap();
            assert_eq!(table.lines().count(), 1 + rows);
            let columns = table.lines().next().unwrap().split(',').count();
            assert!(table.lines().all(|l| l.split(',').count() == columns));
        }
        let (table, page) = turntable(&fs::read_to_string(out.join("report.html")).unwrap());
        // Of the attachments, too, where a bone holds vertices.
        assert_eq!(
            page.matches("data:image/png;base64,").count(),
            3 + bones,
            "{scene}"
        );
        assert_eq!(
            table.matches("src=\"data:image/png;base64,").count(),
            1,
            "{scene}"
        );
        assert!(table.contains("data-frames=\"0 1 2 3 4 5\""), "{scene}");
        assert_eq!(table.matches("type=\"radio\"").count(), 3, "{scene}");
        assert!(page.contains("Effects left out") && page.ends_with("</html>\n"));
    }
}

fn check_keys(summary: &Value) {
    for key in [
        "name",
        "frames",
        "converged",
        "muscles",
        "times",
        "effects",
        "notes",
    ] {
        assert!(summary.get(key).is_some(), "{key}");
    }
    for key in ["frames_s", "frame_median_s", "effects_s"] {
        assert!(summary["times"].get(key).is_some(), "{key}");
    }
    schema::assert_valid(summary);
    assert!(summary["effects"]["run"].is_array());
    for left in summary["effects"]["left_out"].as_array().unwrap() {
        assert!(left["effect"].is_string() && left["why"].is_string());
    }
    let numbers = [
        "vertices",
        "vertices_attached",
        "volume_error_max",
        "volume_error_end",
        "edge_stretch_rms_end",
        "edge_stretch_rms_worst",
        "penetration_max_m",
        "vertices_inside_bones_max",
        "bone_vertices_inside_max",
        "start_overlap_m",
        "distance_from_start_rms_m",
        "length_m",
        "vertices_pinched_max",
        "worst_frame",
    ];
    for muscle in summary["muscles"]["muscles"].as_array().unwrap() {
        assert!(muscle["name"].is_string() && muscle["stopped"].is_null());
        for key in numbers {
            assert!(muscle[key].is_number(), "{key}: {}", muscle[key]);
        }
    }
}

#[test]
fn a_shorter_run_leaves_no_frame_of_a_longer_one_and_no_foreign_file_is_touched() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    run_into(&out, &["distance", "--frames", "9"]);
    fs::write(out.join("mine.txt"), "mine").unwrap();
    run_into(&out, &["distance", "--frames", "2", "--animate", "gif"]);
    assert_eq!(surfaces_in(&out.join("frames")).len(), 3 + 1);
    assert_eq!(fs::read_to_string(out.join("mine.txt")).unwrap(), "mine");
    assert!(
        fs::read(out.join("distance.gif"))
            .unwrap()
            .starts_with(b"GIF89a")
    );
    // A folder with a foreign summary is not overwritten.
    let theirs = scratch.join("theirs");
    fs::create_dir_all(&theirs).unwrap();
    fs::write(theirs.join("summary.json"), "theirs").unwrap();
    let done = run(&["run", "distance", "--frames", "2", "--out", shown(&theirs)]);
    assert_eq!(done.status.code(), Some(2), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("was not written by pliant"));
    assert_eq!(
        fs::read_to_string(theirs.join("summary.json")).unwrap(),
        "theirs"
    );
}

#[test]
fn quiet_hides_everything_but_failures() {
    let scratch = Scratch::folder();
    let said = |scene: &str| {
        let out = scratch.join(scene);
        let set = ["--set", "solver.pbd.tolerance=0.01"];
        let strict: &[&str] = if scene == "chain" { &set } else { &[] };
        let first = [
            "run",
            scene,
            "--frames",
            "1",
            "--quiet",
            "--out",
            shown(&out),
        ];
        let done = run(&[&first, strict].concat());
        assert!(done.stdout.is_empty(), "{}", text(&done.stdout));
        text(&done.stderr)
    };
    assert_eq!(said("distance"), "");
    let failed = said("chain");
    assert!(failed.starts_with("FAIL  "), "{failed}");
    assert!(!failed.contains("frame 1/1"), "{failed}");
    let loud = run(&["run", "chain", "--frames", "1", "--out", shown(&scratch)]);
    assert!(text(&loud.stderr).contains("frame 1/1"), "control");
}

#[test]
fn scenes_speak_json() {
    let scenes: Value = serde_json::from_slice(&run(&["scenes", "--json"]).stdout).unwrap();
    for scene in measures(&scenes)["scenes"].as_array().unwrap() {
        let name = scene["name"].as_str().unwrap();
        let shown: Value =
            serde_json::from_slice(&run(&["scenes", "show", name, "--json"]).stdout).unwrap();
        assert_eq!(
            measures(&shown)["scenes"][0]["toml"],
            pliant::scene::builtin::builtin(name).unwrap()
        );
    }
    assert_eq!(run(&["scenes", "show", "hipp"]).status.code(), Some(2));
}

#[test]
fn a_reader_who_leaves_early_is_no_error() {
    let mut child = pliant()
        .args(["scenes", "show", "hip"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let done = child.wait_with_output().unwrap();
    assert_eq!(
        (done.status.code(), text(&done.stderr)),
        (Some(0), String::new())
    );
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_the_run_with_readable_files() {
    ends_with_readable_files("-INT", 130);
}

#[cfg(unix)]
#[test]
fn sigterm_ends_the_run_with_readable_files() {
    ends_with_readable_files("-TERM", 143);
}

#[cfg(unix)]
fn ends_with_readable_files(signal: &str, code: i32) {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let mut child = pliant()
        .args([
            "run",
            "distance",
            "--frames",
            "10000000",
            "--out",
            shown(&out),
        ])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let third = out.join("frames/muscle_0003.vtp");
    let begun = std::time::Instant::now();
    while !third.exists() && begun.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status()
        .unwrap();
    assert!(sent.success());
    assert_eq!(child.wait().unwrap().code(), Some(code));
    let summary = json(&out.join("summary.json"));
    assert_eq!(summary["interrupted"], true);
    let frames = summary["frames"].as_u64().unwrap() as usize;
    assert_eq!(referenced(&out, "distance.pvd").len(), 2 * (frames + 1));
    assert_eq!(surfaces_in(&out.join("frames")).len(), frames + 2);
    assert!(!names_in(&out).iter().any(|n| n.ends_with(".part")));
}

#[test]
fn a_mesh_that_cannot_be_used_says_what_to_do() {
    let scratch = Scratch::folder();
    let [ball, plate] = ball_and_box(&scratch);
    let whole = scratch.join("whole.vtk");
    let mesh = shapes::make("icosphere").unwrap().mesh;
    io::write(&whole, &mesh, &[], Encoding::Binary).unwrap();
    let bytes = fs::read(&whole).unwrap();
    let cut = scratch.join("cut.vtk");
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let far = scratch.join("far.toml");
    let source = |path: &str| format!("mesh = '{path}'\nunit = 'cm'\n");
    let text = format!(
        "frames = 1\nframe_rate = '60 Hz'\n[[bone]]\nname = 'plate'\n{}[[muscle]]\nname = 'ball'\n{}\
         [[muscle.attachment]]\nbone = 'plate'\nnear = '1 um'\n",
        source(&plate),
        source(&ball)
    );
    fs::write(&far, &text).unwrap();
    let out = scratch.join("out");
    let cases: [(&[&str], &[&str]); 3] = [
        (
            &["--muscles", shown(&cut), "--unit", "mm"],
            &["cut.vtk: offset 0x", "copy or export it again"],
        ),
        (
            &[
                "--muscles",
                &ball,
                "--fibre-lines",
                shown(&whole),
                "--unit",
                "mm",
            ],
            &["fibres of", "holds no lines"],
        ),
        (
            &[shown(&far)],
            &[
                "far.toml:13:8: error[E072]: muscle.0.attachment.0.near: attachment of muscle `ball` to `plate`",
                "the nearest is",
                "raise `near`",
            ],
        ),
    ];
    for (arguments, expected) in cases {
        let done = pliant()
            .arg("run")
            .args(arguments)
            .args(["--out", shown(&out)])
            .output()
            .unwrap();
        let message = text_of_refusal(&done);
        for part in expected {
            assert!(
                message.contains(part),
                "{arguments:?}: `{part}` is not in: {message}"
            );
        }
    }
    assert!(
        !out.exists(),
        "nothing is written for input that is refused"
    );
}

/// Output of a command on a terminal and its exit code; `None` without Python, with a message.
#[cfg(unix)]
fn on_a_terminal(arguments: &[&str]) -> Option<(String, Option<i32>)> {
    let script =
        "import os, pty, sys\nsys.exit(os.waitstatus_to_exitcode(pty.spawn(sys.argv[1:])))";
    let mut python = Command::new("python3");
    python
        .args(["-c", script, env!("CARGO_BIN_EXE_pliant")])
        .args(arguments);
    match python.env("NO_COLOR", "1").stdin(Stdio::null()).output() {
        Ok(done) => Some((text(&done.stdout), done.status.code())),
        Err(_) => {
            println!("skipped: 1 part of a test, because there is no python3");
            None
        }
    }
}

#[cfg(unix)]
#[test]
fn on_a_terminal_an_error_of_a_mesh_shows_its_line_or_its_bytes() {
    let scratch = Scratch::folder();
    let [line, bytes] = ["line.obj", "bytes.stl"].map(|name| scratch.join(name));
    fs::write(&line, "v 0 0 0\nv 1 0 0\nv 0 1 zero\nf 1 2 3\n").unwrap();
    fs::write(&bytes, [0xab; 134]).unwrap();
    let terse = "line.obj:3:7: error[E011]: expected a number (found 'zero'); the file is cut off";
    let cases: [(&Path, &str, &[&str]); 2] = [
        (
            &line,
            terse,
            &[
                " 3 | v 0 1 zero\r\n",
                "help: the file is cut off, damaged or of another dialect",
            ],
        ),
        (
            &bytes,
            "bytes.stl: offset 0x50: error[E040]: ",
            &["0x50: ab ab ab ab ab ab ab ab ab ab ab ab ab ab ab ab\r\n"],
        ),
    ];
    for (path, on_a_pipe, parts) in cases {
        let arguments = ["run", "--muscles", shown(path), "--unit", "mm"];
        let message = text_of_refusal(&run(&arguments));
        assert!(message.contains(on_a_pipe), "{message}");
        let Some((seen, code)) = on_a_terminal(&arguments) else {
            return;
        };
        assert_eq!(code, Some(2), "{seen}");
        for part in parts {
            // The lines of the theme depend on the terminal.
            let seen = seen.replace('│', "|");
            assert!(
                seen.contains(part) && !message.contains(part),
                "`{part}` is not in: {seen}"
            );
        }
    }
}

/// Message of a command that rejected its input.
fn text_of_refusal(done: &Output) -> String {
    let message = text(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{message}");
    assert!(
        done.stdout.is_empty() && message.lines().count() == 1,
        "{message}"
    );
    message
}

#[test]
fn a_stopped_body_ends_the_run_with_code_1_and_whole_files() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let run_with = |force: &str| {
        // 1e308 N at 1 g is an infinite velocity in the first step.
        let force = format!("muscle.0.force.0.force=['0 N', '0 N', '{force}']");
        let set = [
            "--set",
            &force,
            "--set",
            "muscle.0.material.vertex_mass=1 g",
        ];
        pliant()
            .args(["run", "distance", "--frames", "3", "--out", shown(&out)])
            .args(set)
            .output()
            .unwrap()
    };
    let done = run_with("1e308 N");
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    let words = text(&done.stdout);
    assert!(
        words.contains("FAIL") && words.contains("stopped at frame 1: motion at vertex 3"),
        "{words}"
    );
    let summary = json(&out.join("summary.json"));
    let stopped = &summary["muscles"]["muscles"][0]["stopped"];
    assert_eq!(
        (&stopped["frame"], &stopped["effect"], &stopped["particle"]),
        (&1.into(), &"motion".into(), &3.into())
    );
    assert_eq!(
        (&summary["converged"], &summary["frames"]),
        (&false.into(), &1.into())
    );
    assert_eq!(referenced(&out, "distance.pvd").len(), 2 * 2);
    // Control: a large finite force does not stop the run, which fails as it does not converge.
    let done = run_with("1e6 N");
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stdout));
    assert!(json(&out.join("summary.json"))["muscles"]["muscles"][0]["stopped"].is_null());
}

#[test]
fn velocities_that_were_limited_are_red() {
    let scratch = Scratch::folder();
    let fly = |force: &str| {
        let force = format!("muscle.0.force.0.force=['0 N', '0 N', '{force}']");
        // Without edges the vertex does not return.
        let set = ["--set", &force, "--set", "effects.stretch=off"];
        let out = scratch.join("out");
        let given = ["run", "distance", "--frames", "2", "--out", shown(&out)];
        let done = run(&[&given[..], &set].concat());
        (done.status.code(), text(&done.stderr))
    };
    let (code, words) = fly("1e6 N");
    assert_eq!(code, Some(1), "{words}");
    assert!(
        words.contains("muscle: velocities that were cut to") && words.contains("too large"),
        "{words}"
    );
    let (code, words) = fly("10 N");
    assert!(code == Some(0) && !words.contains("velocities"), "{words}");
}

/// The points of a frame that `pliant` wrote.
fn points_of(path: &Path) -> Vec<[f64; 3]> {
    let file = io::read(path).unwrap();
    file.mesh.vertices.iter().map(|p| [p.x, p.y, p.z]).collect()
}

/// A page without the table of its provenance, which has the date.
fn without_provenance(page: &str) -> String {
    let (before, table) = page
        .split_once("<h2>Provenance</h2>")
        .expect("a provenance");
    let (_, after) = table.split_once("</table></div>").expect("its end");
    format!("{before}{after}")
}

#[test]
fn fibre_lines_of_a_muscle_without_a_scene_follow_it_in_every_frame() {
    let scratch = Scratch::folder();
    let [ball, plate] = ball_and_box(&scratch);
    let lines = scratch.join("fibres.vtk");
    let text_of_lines = "# vtk DataFile Version 4.2\ntwo fibres\nASCII\nDATASET POLYDATA\nPOINTS 6 double\n\
        -0.5 0.1 0.2\n0 0.1 0.3\n0.5 0.1 0.2\n-0.5 -0.2 0\n0 -0.2 0\n0.5 -0.2 0\nLINES 2 8\n3 0 1 2\n3 3 4 5\n";
    fs::write(&lines, text_of_lines).unwrap();
    let out = scratch.join("out");
    let gravity = "effects.gravity.acceleration=['0 m/s2', '-9.81 m/s2', '0 m/s2']";
    let named = [
        "--muscles",
        &ball,
        "--bones",
        &plate,
        "--fibre-lines",
        shown(&lines),
        "--unit",
        "cm",
    ];
    run_into(
        &out,
        &[
            &named[..],
            &[
                "--frames",
                "8",
                "--set",
                gravity,
                "--animate",
                "gif",
                "--exact",
            ],
        ]
        .concat(),
    );
    let frames: Vec<Vec<[f64; 3]>> = (0..=8)
        .map(|f| points_of(&out.join(format!("frames/ball_fibres_{f:04}.vtp"))))
        .collect();
    assert!(frames.iter().all(|points| points.len() == 6));
    let apart = |a: &[[f64; 3]], b: &[[f64; 3]]| {
        max_or_nan(
            a.iter()
                .zip(b)
                .flat_map(|(a, b)| (0..3).map(|k| (a[k] - b[k]).abs())),
        )
    };
    // They begin as read, in metres, but for what binding to the nearest triangle of a coarse ball moves (its edges
    // are 2 mm long or more), and then move with the muscle from frame to frame.
    let read = [[-5e-3, 1e-3, 2e-3], [0.0, 1e-3, 3e-3], [5e-3, 1e-3, 2e-3]];
    assert!(apart(&frames[0][..3], &read) <= 2e-3, "{:?}", frames[0]);
    assert!(
        frames.windows(2).all(|f| apart(&f[0], &f[1]) > 0.0),
        "a frame whose fibres did not move"
    );
    assert!(
        apart(&frames[0], &frames[8]) > 1e-4,
        "{:?} {:?}",
        frames[0],
        frames[8]
    );
    assert!(referenced(&out, "ball.pvd").contains(&"frames/ball_fibres_0008.vtp".to_owned()));
    assert!(
        fs::read_to_string(out.join("report.html"))
            .unwrap()
            .contains("pale lines: fibres")
    );
    check_animation(&out.join("ball.gif"), 3);
}

/// A GIF that a decoder reads to its end, with this number of pictures, not all equal.
fn check_animation(path: &Path, pictures: usize) {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(fs::File::open(path).unwrap()).unwrap();
    let (width, height) = (decoder.width(), decoder.height());
    let mut seen = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        assert!(frame.left + frame.width <= width && frame.top + frame.height <= height);
        seen.push(frame.buffer.to_vec());
    }
    assert_eq!(seen.len(), pictures);
    assert!(seen.windows(2).any(|f| f[0] != f[1]), "nothing moves");
}

#[test]
fn json_is_one_object_with_nothing_beside_it() {
    let scratch = Scratch::folder();
    let [ball, plate] = ball_and_box(&scratch);
    let out = scratch.join("out");
    let named = [
        "--muscles",
        &ball,
        "--bones",
        &plate,
        "--unit",
        "cm",
        "--frames",
        "2",
        "--json",
    ];
    let done = run_into(&out, &named);
    let printed: Value = serde_json::from_slice(&done.stdout).expect("nothing but one object");
    assert!(printed.is_object() && !printed["muscles"]["muscles"].as_array().unwrap().is_empty());
    check_keys(&printed);
    assert!(
        serde_json::from_slice::<Value>(&run(&["scenes"]).stdout).is_err(),
        "control: words are not JSON"
    );
}

/// A ball of 1 cm 2 mm above a box, as files without a unit.
fn ball_and_box(scratch: &Scratch) -> [String; 2] {
    let write = |name: &str, shape: &str, down: f64| {
        let mesh = shapes::make(shape).unwrap().mesh;
        let mut obj = String::new();
        mesh.vertices
            .iter()
            .for_each(|v| obj.push_str(&format!("v {:?} {:?} {:?}\n", v.x, v.y - down, v.z)));
        mesh.triangles
            .iter()
            .for_each(|t| obj.push_str(&format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1)));
        let path = scratch.join(name);
        fs::write(&path, obj).unwrap();
        shown(&path).to_owned()
    };
    [
        write("ball.obj", "icosphere", 0.0),
        write("box.obj", "box", 1.7),
    ]
}

#[test]
fn meshes_without_a_scene_give_the_same_bytes_for_any_number_of_threads() {
    let scratch = Scratch::folder();
    let [ball, plate] = ball_and_box(&scratch);
    let outs = ["1", "2"].map(|threads| {
        let out = scratch.join(threads);
        let gravity = "effects.gravity.acceleration=['0 m/s2', '-9.81 m/s2', '0 m/s2']";
        let named = ["--muscles", &ball, "--bones", &plate, "--unit", "cm"];
        run_into(
            &out,
            &[
                &named[..],
                &["--frames", "4", "--threads", threads, "--set", gravity],
            ]
            .concat(),
        );
        out
    });
    let names = names_in(&outs[0].join("frames"));
    assert_eq!(names, names_in(&outs[1].join("frames")));
    for name in &names {
        let [one, two] = outs
            .each_ref()
            .map(|out| fs::read(out.join("frames").join(name)).unwrap());
        assert!(one == two, "{name} depends on the number of threads");
    }
    let [one, two] = outs
        .each_ref()
        .map(|out| turntable(&fs::read_to_string(out.join("report.html")).unwrap()).0);
    assert!(
        one == two,
        "the turn-table depends on the number of threads"
    );
    let summary = json(&outs[0].join("summary.json"));
    let muscle = &summary["muscles"]["muscles"][0];
    assert!(
        muscle["vertices_attached"].as_u64().unwrap() > 0,
        "held by the box that is 2 mm away"
    );
    assert!(
        muscle["distance_from_start_rms_m"].as_f64().unwrap() > 0.0,
        "it moves"
    );
    assert_eq!(muscle["vertices_inside_bones_max"], 0);
    // The scene built from the meshes also runs from a file.
    let again = scratch.join("again");
    run_into(
        &again,
        &[shown(&outs[0].join("scene.toml")), "--frames", "1"],
    );
}
