//! `--checkpoint-every` and `--resume`: a resumed run leaves the files of an uninterrupted run.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::{Scratch, json, pliant, run_into, shown, text, turntable};

/// Every file below a folder, by its relative path.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
        let name = entry.file_name().unwrap().to_str().unwrap().to_owned();
        if entry.is_dir() {
            all.extend(
                files(&entry)
                    .into_iter()
                    .map(|(below, bytes)| (format!("{name}/{below}"), bytes)),
            );
        } else {
            all.insert(name, fs::read(&entry).unwrap());
        }
    }
    all
}

/// Files that contain times.
const TIMED: [&str; 4] = [
    "times.csv",
    "summary.json",
    "report.html",
    "checkpoint.pliant",
];

/// The turn-table of a run's page, which contains no times, unlike the rest of the page.
fn turned(folder: &Path) -> String {
    turntable(&fs::read_to_string(folder.join("report.html")).unwrap()).0
}

/// Whether two folders of results are equal except for times.
fn same(a: &Path, b: &Path) -> bool {
    let (fa, fb) = (files(a), files(b));
    assert!(fa.keys().eq(fb.keys()), "{:?}\n{:?}", fa.keys(), fb.keys());
    let timeless = |folder: &Path| {
        let mut summary = json(&folder.join("summary.json"));
        for key in ["time_s", "times", "provenance"] {
            assert!(summary.as_object_mut().unwrap().remove(key).is_some());
        }
        summary
    };
    let rows = |folder: &Path| {
        fs::read_to_string(folder.join("times.csv"))
            .unwrap()
            .lines()
            .count()
    };
    let differs = |name: &&String| !TIMED.contains(&name.as_str()) && fa[*name] != fb[*name];
    fa.keys().find(differs).is_none()
        && turned(a) == turned(b)
        && timeless(a) == timeless(b)
        && rows(a) == rows(b)
}

#[test]
fn a_run_that_goes_on_leaves_the_files_of_one_that_never_stopped() {
    let scratch = Scratch::folder();
    let [whole, again, earlier] = ["whole", "again", "earlier"].map(|name| scratch.join(name));
    // Two moving bones, so that several frames name some of their files. Fibres have files of
    // their own.
    let joint = [
        "bone.0.motion.centre=['0 m','0 m','0 m']",
        "bone.0.motion.axis=[-1,0,0]",
    ];
    let keys = "bone.0.motion.keys=[{frame=3,angle='0 rad'},{frame=9,angle='1 rad'}]";
    let scene = [
        "distance", "--set", joint[0], "--set", joint[1], "--set", keys,
    ];
    let go = |folder: &Path, more: &[&str]| run_into(folder, &[&scene[..], more].concat());
    go(
        &whole,
        &[
            "--frames",
            "14",
            "--checkpoint-every",
            "5",
            "--animate",
            "gif",
        ],
    );
    let list = fs::read_to_string(whole.join("pliant-files.txt")).unwrap();
    assert!(list.contains("\ncheckpoint.pliant\n"), "{list}");

    // Finished, then extended.
    go(&again, &["--frames", "7", "--checkpoint-every", "5"]);
    assert!(!again.join("distance.gif").exists());
    go(&again, &["--frames", "14", "--resume", "--animate", "gif"]);
    assert!(same(&whole, &again));

    // Killed after frame 11. The last checkpoint is at 5, so there are extra frames, half a
    // file, and no tables.
    go(&earlier, &["--frames", "5", "--checkpoint-every", "5"]);
    go(&again, &["--frames", "11", "--animate", "gif"]);
    fs::copy(
        earlier.join("checkpoint.pliant"),
        again.join("checkpoint.pliant"),
    )
    .unwrap();
    fs::write(again.join("frames/muscle_0012.vtp.part"), "half").unwrap();
    let list = fs::read_to_string(again.join("pliant-files.txt")).unwrap();
    fs::write(
        again.join("pliant-files.txt"),
        list + "checkpoint.pliant\nframes/muscle_0012.vtp\n",
    )
    .unwrap();
    fs::remove_file(again.join("summary.json")).unwrap();
    go(&again, &["--frames", "14", "--resume", "--animate", "gif"]);
    assert!(same(&whole, &again));

    // A finished run is only written again; without --animate the animation is removed.
    go(&again, &["--frames", "14", "--resume"]);
    assert!(!again.join("distance.gif").exists());
    go(&again, &["--frames", "14", "--resume", "--animate", "gif"]);
    assert!(same(&whole, &again));

    // Controls: other frames give another turn-table, and another frame gives another file.
    assert_ne!(turned(&whole), turned(&earlier));
    let frame = again.join("frames/muscle_0004.vtp");
    fs::copy(again.join("frames/muscle_0005.vtp"), frame).unwrap();
    assert!(!same(&whole, &again));
}

#[test]
fn what_cannot_go_on_is_refused_and_nothing_is_lost() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let refuse = |arguments: &[&str], expected: &[&str]| {
        let before = out.exists().then(|| files(&out));
        let done = pliant()
            .arg("run")
            .args(arguments)
            .args(["--out", shown(&out)])
            .output()
            .unwrap();
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {message}");
        for part in expected {
            assert!(
                message.contains(part),
                "{arguments:?}: `{part}` is not in: {message}"
            );
        }
        assert!(
            !message.contains("panicked") && message.contains("error: "),
            "{message}"
        );
        assert!(
            before == out.exists().then(|| files(&out)),
            "{arguments:?}: files changed"
        );
    };
    refuse(
        &["distance", "--resume"],
        &["there is no checkpoint", "--checkpoint-every N", "--out"],
    );
    refuse(
        &["distance", "--checkpoint-every", "0"],
        &["--checkpoint-every", "1..=10000000"],
    );
    run_into(
        &out,
        &["distance", "--frames", "4", "--checkpoint-every", "2"],
    );
    let resume = ["distance", "--frames", "6", "--resume"];
    let with = |more: &[&'static str]| [&resume[..], more].concat();
    refuse(
        &with(&["--set", "iterations=7"]),
        &["another simulation, which differs in `solver`; ", "--set"],
    );
    refuse(
        &["volume", "--frames", "6", "--resume"],
        &["the name of the scene", "without --resume"],
    );
    refuse(
        &["distance", "--frames", "3", "--resume"],
        &["of frame 4, but the run ends at frame 3", "--frames"],
    );
    let frame = out.join("frames/muscle_0002.vtp");
    let kept = fs::read(&frame).unwrap();
    fs::remove_file(&frame).unwrap();
    refuse(
        &resume,
        &["muscle_0002.vtp` is missing", "without --resume"],
    );
    fs::write(&frame, &kept).unwrap();
    let checkpoint = out.join("checkpoint.pliant");
    let kept = fs::read(&checkpoint).unwrap();
    let mut damaged = kept.clone();
    damaged[kept.len() / 2] ^= 4;
    for (bytes, expected) in [
        (damaged, "is damaged: its checksum is not that of its bytes"),
        (kept[..kept.len() - 9].to_vec(), "is damaged: "),
        (Vec::new(), "it is no checkpoint"),
        (b"solid\n".to_vec(), "it is no checkpoint"),
    ] {
        fs::write(&checkpoint, bytes).unwrap();
        refuse(
            &resume,
            &[expected, "checkpoint.pliant", "begin anew without --resume"],
        );
    }
    let version = kept
        .windows(5)
        .position(|w| w == env!("CARGO_PKG_VERSION").as_bytes())
        .unwrap();
    let mut older = kept.clone();
    older[version] = b'X';
    fs::write(&checkpoint, older).unwrap();
    refuse(&resume, &["written by pliant X", "go on with that version"]);
    fs::remove_file(&checkpoint).unwrap();
    fs::create_dir(&checkpoint).unwrap();
    let done = pliant()
        .arg("run")
        .args(resume)
        .args(["--out", shown(&out)])
        .output()
        .unwrap();
    assert_eq!(done.status.code(), Some(2));
    fs::remove_dir(&checkpoint).unwrap();
    // Control: the unchanged checkpoint resumes.
    fs::write(&checkpoint, kept).unwrap();
    run_into(&out, &resume);
    // A new run removes it.
    run_into(&out, &["distance", "--frames", "1"]);
    assert!(!checkpoint.exists());
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_a_checkpoint_of_the_last_frame() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let mut child = pliant()
        .args([
            "run",
            "distance",
            "--frames",
            "10000000",
            "--checkpoint-every",
            "10000000",
            "--out",
            shown(&out),
        ])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let third = out.join("frames/muscle_0003.vtp");
    let begun = std::time::Instant::now();
    while !third.exists() && begun.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    assert!(
        super::Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status()
            .unwrap()
            .success()
    );
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let last = json(&out.join("summary.json"))["frames"].as_u64().unwrap();
    let frames = (last + 2).to_string();
    run_into(&out, &["distance", "--frames", &frames, "--resume"]);
    let whole = scratch.join("whole");
    run_into(
        &whole,
        &[
            "distance",
            "--frames",
            &frames,
            "--checkpoint-every",
            "10000000",
        ],
    );
    assert!(same(&whole, &out));
}
