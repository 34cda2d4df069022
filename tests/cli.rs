//! The command as a person or a script meets it: exit codes, messages, and the files of a run.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use pliant::mesh::shapes;
use serde_json::Value;

/// A folder of its own for one test, which goes with it.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("pliant-cli-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn join(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

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
    let done = pliant().arg("run").args(arguments).args(["--out", shown(folder)]).output().unwrap();
    assert_eq!(done.status.code(), Some(0), "{arguments:?}: {}", text(&done.stderr));
    done
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// The files that a collection refers to; each must be there.
fn referenced(folder: &Path, pvd: &str) -> Vec<String> {
    let text = fs::read_to_string(folder.join(pvd)).unwrap();
    assert!(text.ends_with("</VTKFile>\n"));
    let files: Vec<String> =
        text.split("file=\"").skip(1).map(|rest| rest.split('"').next().unwrap().to_owned()).collect();
    for file in &files {
        let bytes = fs::read(folder.join(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
        assert!(bytes.ends_with(b"</VTKFile>\n"), "{file} is not whole");
    }
    files
}

fn names_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn wrong_input_is_refused_with_code_2_and_a_way_out() {
    let scratch = Scratch::new("wrong");
    let garbage = scratch.join("garbage.obj");
    fs::write(&garbage, "v 1 2\nf 1 2 9\n").unwrap();
    let scene = scratch.join("scene.toml");
    fs::write(&scene, "frames = 3\nfarme_rate = \"60 Hz\"\n").unwrap();
    let (garbage, scene) = (shown(&garbage), shown(&scene));
    let cases: [(&[&str], &[&str]); 9] = [
        (&["run", "distanse"], &["there is no scene `distanse`, did you mean `distance`?", "E063"]),
        (&["run", "nowhere.toml"], &["no file `nowhere.toml`"]),
        (&["run", scene], &["scene.toml:2:1: error[E052]", "did you mean `frame_rate`?"]),
        (&["run", "distance", "--set", "substep=3"], &["unknown key `substep`", "known keys"]),
        (&["run", "--muscles", garbage], &["do not say their length unit", "--unit mm"]),
        (&["run", "--muscles", garbage, "--unit", "mm"], &["garbage.obj"]),
        (&["run", "--muscles", garbage, "--unit", "parsec"], &["`parsec` is no unit of length", "mm"]),
        (&["run", "distance", "--out", garbage], &["is not a folder", "--out"]),
        (&["run", "distance", "--frames", "0"], &["--frames"]),
    ];
    for (arguments, wanted) in cases {
        let done = run(arguments);
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {message}");
        for part in wanted {
            assert!(message.contains(part), "{arguments:?}: `{part}` is not in: {message}");
        }
        assert!(!message.contains("panicked") && !message.contains("RUST_BACKTRACE"), "{message}");
        assert!(done.stdout.is_empty(), "{arguments:?}");
    }
    assert_eq!(fs::read_to_string(garbage).unwrap(), "v 1 2\nf 1 2 9\n");
}

#[test]
fn every_command_has_help_with_an_example() {
    for arguments in [&["--help"][..], &["run", "--help"], &["plan", "--help"], &["scenes", "--help"]] {
        let done = run(arguments);
        assert_eq!(done.status.code(), Some(0));
        let help = text(&done.stdout);
        assert!(help.contains("Example") && help.contains("  pliant "), "{arguments:?}: {help}");
    }
    assert_eq!(run(&["scenes", "show", "--help"]).status.code(), Some(0));
    assert_eq!(run(&["--version"]).status.code(), Some(0));
}

#[test]
fn small_scenes_leave_whole_files() {
    for scene in ["distance", "shape", "volume", "chain"] {
        let scratch = Scratch::new(scene);
        let out = scratch.join("out");
        let done = run_into(&out, &[scene, "--frames", "5", "--json"]);
        let summary = json(&out.join("summary.json"));
        let printed: Value = serde_json::from_slice(&done.stdout).expect("nothing but JSON on standard output");
        assert_eq!(printed, summary);
        check_keys(&summary);
        assert_eq!(summary["scene"], scene);
        assert_eq!(summary["frames"], 5);
        let files = referenced(&out, &format!("{scene}.pvd"));
        let bones = if scene == "chain" { 0 } else { 1 };
        assert_eq!(files.len(), 6 * (1 + bones), "{scene}");
        // A bone at rest is written once.
        assert_eq!(names_in(&out.join("frames")).len(), 6 + bones, "{scene}");
        for (table, rows) in [("measures.csv", 6), ("times.csv", 5)] {
            let table = fs::read_to_string(out.join(table)).unwrap();
            assert_eq!(table.lines().count(), 1 + rows);
            let columns = table.lines().next().unwrap().split(',').count();
            assert!(table.lines().all(|l| l.split(',').count() == columns));
        }
        let page = fs::read_to_string(out.join("report.html")).unwrap();
        assert_eq!(page.matches("data:image/png;base64,").count(), 3, "{scene}");
        assert!(page.contains("Effects left out") && page.ends_with("</html>\n"));
    }
}

fn check_keys(summary: &Value) {
    for key in ["scene", "frames", "converged", "muscles", "time", "effects", "notes"] {
        assert!(summary.get(key).is_some(), "{key}");
    }
    for key in ["total_s", "frame_ms_median", "effects_s"] {
        assert!(summary["time"].get(key).is_some(), "{key}");
    }
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
    for muscle in summary["muscles"].as_array().unwrap() {
        assert!(muscle["name"].is_string() && muscle["stopped"].is_null());
        for key in numbers {
            assert!(muscle[key].is_number(), "{key}: {}", muscle[key]);
        }
    }
}

#[test]
fn a_shorter_run_leaves_no_frame_of_a_longer_one_and_no_foreign_file_is_touched() {
    let scratch = Scratch::new("again");
    let out = scratch.join("out");
    run_into(&out, &["distance", "--frames", "9"]);
    fs::write(out.join("mine.txt"), "mine").unwrap();
    run_into(&out, &["distance", "--frames", "2", "--animate", "gif"]);
    assert_eq!(names_in(&out.join("frames")).len(), 3 + 1);
    assert_eq!(fs::read_to_string(out.join("mine.txt")).unwrap(), "mine");
    assert!(fs::read(out.join("distance.gif")).unwrap().starts_with(b"GIF89a"));
    // A folder with somebody else's summary is not written over.
    let theirs = scratch.join("theirs");
    fs::create_dir_all(&theirs).unwrap();
    fs::write(theirs.join("summary.json"), "theirs").unwrap();
    let done = run(&["run", "distance", "--frames", "2", "--out", shown(&theirs)]);
    assert_eq!(done.status.code(), Some(2), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("was not written by pliant"));
    assert_eq!(fs::read_to_string(theirs.join("summary.json")).unwrap(), "theirs");
}

#[test]
fn strict_fails_a_run_that_is_not_converged() {
    let scratch = Scratch::new("strict");
    let out = scratch.join("out");
    let done = run(&["run", "chain", "--frames", "1", "--strict", "--out", shown(&out)]);
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stdout));
    assert_eq!(json(&out.join("summary.json"))["converged"], false);
}

#[test]
fn plan_and_scenes_speak_json() {
    let plan: Value = serde_json::from_slice(&run(&["plan", "distance", "--json"]).stdout).unwrap();
    assert_eq!(plan["run"][0]["effect"], "stretch");
    assert!(plan["left_out"].as_array().is_some_and(|l| !l.is_empty()));
    let table = text(&run(&["plan", "distance"]).stdout);
    assert!(table.contains("stretch") && table.contains("the scene has no [effects.contact]"));
    let scenes: Value = serde_json::from_slice(&run(&["scenes", "--json"]).stdout).unwrap();
    for scene in scenes.as_array().unwrap() {
        let name = scene["name"].as_str().unwrap();
        let shown: Value = serde_json::from_slice(&run(&["scenes", "show", name, "--json"]).stdout).unwrap();
        assert_eq!(shown["toml"], pliant::scene::builtin::builtin(name).unwrap());
    }
    assert_eq!(run(&["scenes", "show", "hipp"]).status.code(), Some(2));
}

#[test]
fn a_reader_who_leaves_early_is_no_error() {
    let mut child =
        pliant().args(["scenes", "show", "hip"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let done = child.wait_with_output().unwrap();
    assert_eq!((done.status.code(), text(&done.stderr)), (Some(0), String::new()));
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_the_run_with_readable_files() {
    let scratch = Scratch::new("interrupt");
    let out = scratch.join("out");
    let mut child = pliant()
        .args(["run", "distance", "--frames", "10000000", "--out", shown(&out)])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let third = out.join("frames/muscle_0003.vtp");
    let begun = std::time::Instant::now();
    while !third.exists() && begun.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let summary = json(&out.join("summary.json"));
    assert_eq!(summary["interrupted"], true);
    let frames = summary["frames"].as_u64().unwrap() as usize;
    assert_eq!(referenced(&out, "distance.pvd").len(), 2 * (frames + 1));
    assert_eq!(names_in(&out.join("frames")).len(), frames + 2);
    assert!(!names_in(&out).iter().any(|n| n.ends_with(".part")));
}

/// A ball of 1 cm over a box, 2 mm apart, as files without a unit.
fn ball_and_box(scratch: &Scratch) -> [String; 2] {
    let write = |name: &str, shape: &str, down: f64| {
        let mesh = shapes::make(shape).unwrap().mesh;
        let mut obj = String::new();
        mesh.vertices.iter().for_each(|v| obj.push_str(&format!("v {:?} {:?} {:?}\n", v.x, v.y - down, v.z)));
        mesh.triangles.iter().for_each(|t| obj.push_str(&format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1)));
        let path = scratch.join(name);
        fs::write(&path, obj).unwrap();
        shown(&path).to_owned()
    };
    [write("ball.obj", "icosphere", 0.0), write("box.obj", "box", 1.7)]
}

#[test]
fn meshes_without_a_scene_give_the_same_bytes_for_any_number_of_threads() {
    let scratch = Scratch::new("threads");
    let [ball, plate] = ball_and_box(&scratch);
    let outs = ["1", "2"].map(|threads| {
        let out = scratch.join(threads);
        let gravity = "effects.gravity.acceleration=['0 m/s2', '-9.81 m/s2', '0 m/s2']";
        let named = ["--muscles", &ball, "--bones", &plate, "--unit", "cm"];
        run_into(&out, &[&named[..], &["--frames", "4", "--threads", threads, "--set", gravity]].concat());
        out
    });
    let names = names_in(&outs[0].join("frames"));
    assert_eq!(names, names_in(&outs[1].join("frames")));
    for name in &names {
        let [one, two] = outs.each_ref().map(|out| fs::read(out.join("frames").join(name)).unwrap());
        assert!(one == two, "{name} depends on the number of threads");
    }
    let summary = json(&outs[0].join("summary.json"));
    let muscle = &summary["muscles"][0];
    assert!(muscle["vertices_attached"].as_u64().unwrap() > 0, "held by the box that is 2 mm away");
    assert!(muscle["distance_from_start_rms_m"].as_f64().unwrap() > 0.0, "it moves");
    assert_eq!(muscle["vertices_inside_bones_max"], 0);
    // The scene that was made of the meshes runs again as a file.
    let again = scratch.join("again");
    run_into(&again, &[shown(&outs[0].join("scene.toml")), "--frames", "1"]);
}
