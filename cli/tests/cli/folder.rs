//! Where results go: a folder that another run has, a frame that cannot be written, a full output.

use std::fs;

use super::{Scratch, json, names_in, pliant, referenced, run, run_into, shown, text};

#[cfg(unix)]
#[test]
fn a_folder_has_one_run_at_a_time() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    run_into(&out, &["chain"]);
    let before = fs::read(out.join("measures.csv")).unwrap();
    let other = fs::File::open(&out).unwrap();
    other.lock().unwrap();
    for more in [&[][..], &["--resume"], &["--frames", "2"]] {
        let given = ["run", "chain", "--out", shown(&out)];
        let done = run(&[&given[..], more].concat());
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{said}");
        assert!(said.contains("another run writes to"), "{said}");
    }
    assert_eq!(fs::read(out.join("measures.csv")).unwrap(), before);
    drop(other);
    run_into(&out, &["chain"]);
}

#[test]
fn a_frame_that_cannot_be_written_ends_a_run_with_what_came_before() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    fs::create_dir_all(out.join("frames/muscle_0003.vtp")).unwrap();
    let done = run(&["run", "distance", "--frames", "5", "--out", shown(&out)]);
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(
        said.contains("every frame can be written") && said.contains("muscle_0003.vtp"),
        "{said}"
    );
    let files = referenced(&out, "distance.pvd");
    assert_eq!(files.len(), 6, "{files:?}");
    let summary = json(&out.join("summary.json"));
    assert_eq!(summary["passed"], false);
    let stopped = summary["stopped"].as_str().unwrap();
    assert!(stopped.contains("muscle_0003.vtp"), "{stopped}");
    let names = names_in(&out);
    assert!(names.contains(&"measures.csv".to_owned()), "{names:?}");
    assert!(names.contains(&"report.html".to_owned()), "{names:?}");
}

#[cfg(target_os = "linux")]
#[test]
fn an_output_that_takes_nothing_is_an_error() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let full = || fs::File::options().write(true).open("/dev/full").unwrap();
    let commands: [&[&str]; 4] = [
        &[
            "run",
            "chain",
            "--frames",
            "1",
            "--json",
            "--out",
            shown(&out),
        ],
        &["scenes", "show", "hip"],
        &["plan", "chain"],
        &["--help"],
    ];
    for arguments in commands {
        let done = pliant().args(arguments).stdout(full()).output().unwrap();
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(1), "{arguments:?}: {said}");
        assert!(said.contains("standard output"), "{arguments:?}: {said}");
    }
    assert_eq!(json(&out.join("summary.json"))["passed"], true);
}
