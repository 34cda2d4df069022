//! `pliant study`: the runs, the results reused from an earlier call, rejected input.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

use super::{Scratch, json, measures, names_in, pliant, run, shown, text};

/// A tetrahedron of a mesh file that swings, as the built-in scene `distance` does.
const SCENE: &str = "
frames = 12
frame_rate = \"60 Hz\"
[[muscle]]
name = \"muscle\"
mesh = \"muscle.obj\"
unit = \"m\"
[muscle.material]
vertex_mass = \"1 kg\"
[[muscle.force]]
vertices = [3]
force = [\"0 N\", \"-10 N\", \"0 N\"]
[effects.stretch]
[solver.pbd]
";
const MESH: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

/// Without times, which differ between runs.
const STUDY: &str = "
scene = \"scene.toml\"
frames = [0, 6, 12]
measures = [\"edge_stretch_rms_end\", \"distance_from_start_rms_m\"]
[vary]
\"solver.pbd.iterations\" = [1, 3]
\"solver.pbd.stretch\" = [0.5, 1]
[reference]
\"solver.pbd.iterations\" = 50
";

fn written(scratch: &Scratch, study: &str) -> String {
    fs::write(scratch.join("scene.toml"), SCENE).unwrap();
    fs::write(scratch.join("muscle.obj"), MESH).unwrap();
    fs::write(scratch.join("s.toml"), study).unwrap();
    shown(&scratch.join("s.toml")).to_owned()
}

fn study(file: &str, out: &Path, more: &[&str]) -> String {
    let done = pliant()
        .args(["study", file, "--out", shown(out)])
        .args(more)
        .output()
        .unwrap();
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    text(&done.stdout)
}

/// Number of runs that a dry run announces.
fn to_run(file: &str, out: &Path, more: &[&str]) -> usize {
    let said = study(file, out, &[&["--dry-run", "--json"], more].concat());
    let summary: Value = serde_json::from_str(&said).unwrap();
    measures(&summary)["rows"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|r| r["state"] == "to run")
        .count()
}

/// All files of a folder by name, except the runs, and the summary without its time.
fn results(out: &Path) -> BTreeMap<String, Vec<u8>> {
    let all = names_in(out)
        .into_iter()
        .filter(|n| n != "runs" && n != "pliant-files.txt");
    let bytes = |name: &str| {
        if name == "report.html" {
            let page = fs::read_to_string(out.join(name)).unwrap();
            return super::without_provenance(&page).into_bytes();
        }
        if name != "summary.json" {
            return fs::read(out.join(name)).unwrap();
        }
        let mut summary = json(&out.join(name));
        (summary["time_s"], summary["provenance"]) = (Value::Null, Value::Null);
        summary.to_string().into_bytes()
    };
    all.map(|n| (n.clone(), bytes(&n))).collect()
}

#[test]
fn a_study_has_a_row_for_each_combination_and_goes_on_where_it_was() {
    let scratch = Scratch::folder();
    let file = written(&scratch, STUDY);
    let out = scratch.join("out");
    let printed = study(&file, &out, &["--json", "--threads", "1"]);
    assert_eq!(
        names_in(&out),
        [
            "pliant-files.txt",
            "report.html",
            "runs",
            "sheet.png",
            "study.csv",
            "summary.json"
        ]
    );
    let table: Value = serde_json::from_str(&printed).unwrap();
    assert_eq!(table, json(&out.join("summary.json")));
    let table = measures(&table);
    let rows = table["rows"].as_array().unwrap();
    // Four combinations, and one reference for each stretch.
    assert_eq!(rows.len(), 6);
    assert_eq!(rows[1]["values"]["solver.pbd.iterations"], "1");
    assert_eq!(rows[1]["values"]["solver.pbd.stretch"], "1");
    assert_eq!(rows[1]["label"], "iterations = 1, stretch = 1");
    let listed = fs::read_to_string(out.join("pliant-files.txt")).unwrap();
    let listed: Vec<&str> = listed.lines().filter(|l| l.starts_with("runs/")).collect();
    assert!(listed.len() == 6 && listed.is_sorted(), "{listed:?}");
    let rms = |row: usize, frame: usize| rows[row]["errors"][frame]["rms_m"].as_f64().unwrap();
    assert_eq!(rms(0, 0), 0.0, "all start alike");
    assert!(
        rms(1, 2) > rms(3, 2) && rms(3, 2) > 0.0,
        "more iterations are nearer: {} {}",
        rms(1, 2),
        rms(3, 2)
    );
    let csv = fs::read_to_string(out.join("study.csv")).unwrap();
    assert_eq!(csv.lines().count(), 7);
    // Commas within quotes separate no columns.
    let columns = |l: &str| {
        l.split('"')
            .step_by(2)
            .map(|part| part.matches(',').count())
            .sum::<usize>()
    };
    let counts: Vec<usize> = csv.lines().map(columns).collect();
    assert!(
        counts.iter().all(|&c| c == counts[0] && c > 8),
        "{counts:?}\n{csv}"
    );
    let whole = results(&out);

    // Some runs are lost and a table is damaged. The intact runs are reused, the others run
    // again, and all bytes are equal.
    let runs = names_in(&out.join("runs"));
    assert_eq!((runs.len(), to_run(&file, &out, &[])), (6, 0));
    let kept = fs::metadata(out.join("runs").join(&runs[0]))
        .unwrap()
        .modified()
        .unwrap();
    for lost in &runs[3..] {
        fs::remove_file(out.join("runs").join(lost)).unwrap();
    }
    fs::write(out.join("runs").join(&runs[2]), "{\"key\": \"cut o").unwrap();
    fs::write(out.join("study.csv"), "").unwrap();
    assert_eq!(to_run(&file, &out, &[]), 4);
    study(&file, &out, &["--threads", "3"]);
    assert!(
        results(&out) == whole,
        "a study that went on has other bytes"
    );
    assert_eq!(
        fs::metadata(out.join("runs").join(&runs[0]))
            .unwrap()
            .modified()
            .unwrap(),
        kept,
        "was run again"
    );
    study(&file, &out, &["--fresh"]);
    assert!(results(&out) == whole && names_in(&out.join("runs")) == runs);
    assert!(
        fs::metadata(out.join("runs").join(&runs[0]))
            .unwrap()
            .modified()
            .unwrap()
            != kept,
        "was not run again"
    );
}

#[test]
fn nothing_that_has_changed_is_taken_from_an_old_result() {
    let scratch = Scratch::folder();
    let file = written(&scratch, STUDY);
    let out = scratch.join("out");
    study(&file, &out, &[]);
    let before = results(&out);
    assert_eq!(to_run(&file, &out, &[]), 0);
    assert_eq!(to_run(&file, &out, &["--fresh"]), 6);
    assert_eq!(
        to_run(&file, &out, &["--set", "solver.pbd.velocity_damping=0.98"]),
        6
    );
    // Another value: two combinations are new, the references are unchanged.
    fs::write(&file, STUDY.replace("[1, 3]", "[1, 4]")).unwrap();
    assert_eq!(to_run(&file, &out, &[]), 2);
    fs::write(&file, STUDY.replace("[0, 6, 12]", "[0, 7, 12]")).unwrap();
    assert_eq!(to_run(&file, &out, &[]), 6);
    fs::write(&file, STUDY).unwrap();
    // The contents of a mesh matter, not its age or length.
    fs::write(scratch.join("muscle.obj"), MESH).unwrap();
    assert_eq!(to_run(&file, &out, &[]), 0);
    fs::write(
        scratch.join("muscle.obj"),
        MESH.replace("v 0 0 1", "v 0 0 2"),
    )
    .unwrap();
    assert_eq!(to_run(&file, &out, &[]), 6);
    study(&file, &out, &[]);
    let after = results(&out);
    assert!(before["study.csv"] != after["study.csv"] && before["sheet.png"] != after["sheet.png"]);
}

#[test]
fn a_combination_that_is_stopped_is_a_row_and_foreign_files_stay() {
    let scratch = Scratch::folder();
    // 1e308 N is an infinite velocity at 1 g in the first step; at 1 kg it is cut, and the edges are torn.
    let vary = "[vary]\n\"muscle.0.material.vertex_mass\" = [\"1 g\", \"1 kg\"]\n\"muscle.0.force.0.force\" =";
    let forces = "[[\"0 N\", \"-10 N\", \"0 N\"], [\"0 N\", \"-1e308 N\", \"1e308 N\"]]";
    let file = written(
        &scratch,
        &format!("scene = \"scene.toml\"\nframes = [0, 12]\n{vary} {forces}\n"),
    );
    let out = scratch.join("out");
    let done = pliant()
        .args(["study", &file, "--out", shown(&out)])
        .output();
    let (code, said) = done
        .map(|done| (done.status.code(), text(&done.stderr)))
        .unwrap();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("FAIL  runs that did not converge"), "{said}");
    let rows = measures(&json(&out.join("summary.json")))["rows"].clone();
    let status = |row: usize| rows[row]["status"].as_str().unwrap();
    assert_eq!(
        (rows.as_array().unwrap().len(), status(1), status(3)),
        (4, "stopped", "diverged")
    );
    assert!(
        status(0).ends_with("converged") && status(2) == "converged",
        "controls: {rows}"
    );
    assert!(
        rows[1]["stopped"].as_str().unwrap().contains("in frame 1"),
        "{}",
        rows[1]
    );
    let mine = out.join("runs/mine.json");
    fs::write(&mine, "mine").unwrap();
    fs::write(out.join("mine.csv"), "mine").unwrap();
    study(&file, &out, &["--fresh", "--lenient"]);
    assert_eq!(fs::read(&mine).unwrap(), b"mine");
    assert_eq!(fs::read(out.join("mine.csv")).unwrap(), b"mine");
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_what_is_finished() {
    let scratch = Scratch::folder();
    let file = written(
        &scratch,
        "scene = \"scene.toml\"\nframes = [1]\n[vary]\n\"frames\" = [5, 10000000]\n",
    );
    let out = scratch.join("out");
    let mut child = pliant()
        .args(["study", &file, "--out", shown(&out), "--threads", "2"])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let begun = std::time::Instant::now();
    let finished = || {
        fs::read_dir(out.join("runs")).is_ok_and(|d| {
            d.flatten()
                .any(|e| e.path().extension().is_some_and(|x| x == "json"))
        })
    };
    while !finished() && begun.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = std::process::Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(sent.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let summary = json(&out.join("summary.json"));
    assert_eq!(summary["interrupted"], true);
    let table = measures(&summary);
    assert_eq!(table["rows"][0]["frames"], 5);
    assert_eq!(
        (
            table["rows"][1]["status"].as_str(),
            &table["rows"][1]["frames"]
        ),
        (Some("not run"), &Value::Null)
    );
    assert_eq!(to_run(&file, &out, &[]), 1);
}

#[test]
fn wrong_studies_are_refused_before_anything_runs() {
    let scratch = Scratch::folder();
    let good = written(&scratch, STUDY);
    let out = scratch.join("out");
    let cases: [(&str, &[&str]); 8] = [
        (
            "scene = \"nowhere.toml\"\n[vary]\niterations = [1]\n",
            &["s.toml:1:9: error[E060]", "nowhere.toml"],
        ),
        (
            "scene = \"scene.toml\"\n[vary]\niterations = [1, 0]\n",
            &["s.toml:3:18: error[E051]", "`0` is not allowed"],
        ),
        (
            "scene = \"scene.toml\"\n[vary]\niterations = []\n",
            &["s.toml:3:14: error[E065]", "the list is empty"],
        ),
        (
            "scene = \"scene.toml\"\nframes = [13]\n[vary]\niterations = [1]\n",
            &["s.toml:2:10: error[E051]", "0 to 12"],
        ),
        (
            "scene = \"scene.toml\"\n[varry]\niterations = [1]\n",
            &["s.toml:2:2: error[E052]", "did you mean `vary`"],
        ),
        (
            "scene = \"scene.toml\"\n[vary]\n\"muscle.0.force.0.vertices\" = [[3], [7]]\n",
            &[
                "s.toml:3:",
                "error[E068]",
                "E020",
                "the scene cannot be run",
            ],
        ),
        (
            "scene = \"scene.toml\"\n[vary]\n\"muscle.0.mesh\" = [\"muscle.obj\", \"s.toml\"]\n",
            &[
                "s.toml:3:",
                "error[E068]",
                "the scene cannot be run with muscle.0.mesh = s.toml",
            ],
        ),
        (
            "scene = \"distance\"\n[vary]\nframes = [5, 9]\n[set]\nframes = 7\n",
            &["s.toml:3:1: error[E053]"],
        ),
    ];
    for (study, expected) in cases {
        fs::write(&good, study).unwrap();
        let done = run(&["study", &good, "--out", shown(&out)]);
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{study}: {message}");
        for part in expected {
            assert!(
                message.contains(part),
                "{study}: `{part}` is not in: {message}"
            );
        }
        assert!(
            done.stdout.is_empty() && !message.contains("panicked"),
            "{message}"
        );
    }
    for arguments in [&["study", "nowhere.toml"][..], &["study", shown(&scratch)]] {
        let done = run(arguments);
        assert_eq!(done.status.code(), Some(2));
        assert!(
            text(&done.stderr).contains("E060"),
            "{}",
            text(&done.stderr)
        );
    }
    assert!(
        !out.exists(),
        "a study that is refused has written something"
    );
}

/// Parts that run beside each other give what one call gives, and belong to the folder afterwards.
#[test]
fn parts_of_a_study() {
    let scratch = Scratch::folder();
    let file = written(&scratch, STUDY);
    let (whole, parts) = (scratch.join("whole"), scratch.join("parts"));
    study(&file, &whole, &[]);
    let children: Vec<_> = ["1/3", "2/3", "3/3"]
        .map(|part| {
            let mut command = pliant();
            command.args([
                "study",
                &file,
                "--shard",
                part,
                "--quiet",
                "--out",
                shown(&parts),
            ]);
            command.spawn().expect("begun")
        })
        .into_iter()
        .collect();
    for mut child in children {
        assert_eq!(child.wait().expect("ended").code(), Some(0));
    }
    assert!(!parts.join("study.csv").exists(), "a part makes no table");
    assert_eq!(to_run(&file, &parts, &[]), 0);
    study(&file, &parts, &[]);
    for name in ["study.csv", "sheet.png"] {
        let [a, b] = [&whole, &parts].map(|folder| fs::read(folder.join(name)).expect("written"));
        assert!(a == b, "{name}");
    }
    // No partial file stays, and a fresh run may replace the runs of others.
    assert!(
        names_in(&parts.join("runs"))
            .iter()
            .all(|name| name.ends_with(".json"))
    );
    study(&file, &parts, &["--fresh"]);
    // One combination by its key.
    let listed = study(&file, &scratch.join("none"), &["--dry-run", "--json"]);
    let listed: Value = serde_json::from_str(&listed).expect("JSON");
    let key = listed["study"]["rows"][1]["key"]
        .as_str()
        .expect("a key")
        .to_owned();
    let one = scratch.join("one");
    let said = study(&file, &one, &["--only", &key, "--json"]);
    let said: Value = serde_json::from_str(&said).expect("JSON");
    assert_eq!(
        (
            said["kind"].as_str(),
            said["study_part"]["computed"].as_u64()
        ),
        (Some("study_part"), Some(1))
    );
    assert_eq!(names_in(&one.join("runs")), [format!("{key}.json")]);
    for (more, says) in [
        (["--shard", "4/3"], "I from 1 to N"),
        (["--only", "nothing"], "no run `nothing`"),
    ] {
        let done = pliant()
            .args(["study", &file, "--out", shown(&one)])
            .args(more)
            .output()
            .expect("run");
        assert_eq!(done.status.code(), Some(2));
        assert!(text(&done.stderr).contains(says), "{}", text(&done.stderr));
    }
}

/// A population: a folder of subjects through one scene, in one table; a row reads its own scene only.
#[test]
fn a_population_through_one_scene() {
    let scratch = Scratch::folder();
    let scene = SCENE.replace("mesh = \"muscle.obj\"", "mesh = \"$SUBJECT/muscle.obj\"");
    fs::write(scratch.join("scene.toml"), scene).expect("written");
    for (name, size) in [("anna", "1"), ("bert", "1.5"), (".hidden", "9")] {
        let folder = scratch.join("people").join(name);
        fs::create_dir_all(&folder).expect("a folder");
        fs::write(
            folder.join("muscle.obj"),
            MESH.replace("v 0 0 1", &format!("v 0 0 {size}")),
        )
        .expect("written");
    }
    let text = "scene = \"scene.toml\"\nframes = [0, 12]\nsubjects = \"people\"\nmeasures = [\"distance_from_start_rms_m\"]\n\
                [vary]\n\"solver.pbd.iterations\" = [1, 3]\n";
    let file = scratch.join("s.toml");
    fs::write(&file, text).expect("written");
    let out = scratch.join("out");
    study(shown(&file), &out, &["--lenient"]);
    let table = fs::read_to_string(out.join("study.csv")).expect("a table");
    assert_eq!(table.lines().count(), 5, "{table}");
    assert!(
        table.contains("anna") && table.contains("bert") && !table.contains("hidden"),
        "{table}"
    );
    // Without another varied key.
    fs::write(&file, text.split("[vary]").next().expect("a part")).expect("written");
    let alone = scratch.join("alone");
    study(shown(&file), &alone, &["--lenient", "--row", "1"]);
    assert_eq!(names_in(&alone.join("runs")).len(), 1);
    // A row needs no files of the others.
    fs::remove_file(scratch.join("people/bert/muscle.obj")).expect("removed");
    study(
        shown(&file),
        &scratch.join("one"),
        &["--lenient", "--row", "0"],
    );
    for (change, says) in [
        ("people", "muscle.obj"),
        ("nobody", "a folder for each subject"),
        ("people/bert", "a folder for each subject"),
    ] {
        fs::write(&file, text.replace("people", change)).expect("written");
        let done = pliant()
            .args(["study", shown(&file), "--out", shown(&out)])
            .output()
            .expect("run");
        assert_eq!(done.status.code(), Some(2), "{change}");
        assert!(
            text_of(&done).contains(says),
            "{change}: {}",
            text_of(&done)
        );
    }
}

fn text_of(done: &std::process::Output) -> String {
    text(&done.stderr)
}
