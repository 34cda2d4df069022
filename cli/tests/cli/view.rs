//! `pliant view` on a machine without a display; tests/window uses the window itself.

use super::{run, text};

#[test]
fn a_build_without_a_window_says_how_to_get_one() {
    if cfg!(feature = "viewer") {
        println!("skipped: 1 test, because this build has a window");
        return;
    }
    for arguments in [
        &["view"][..],
        &["view", "hip", "--paused"],
        &["view", "--replay", "somewhere"],
    ] {
        let done = run(arguments);
        let said = text(&done.stderr);
        assert_eq!(
            (
                done.status.code(),
                said.lines().count(),
                text(&done.stdout).len()
            ),
            (Some(1), 1, 0),
            "{said}"
        );
        assert!(
            said.contains("--features viewer") && said.contains("pliant run"),
            "{said}"
        );
    }
}

#[test]
fn wrong_usage_is_refused_before_anything_opens() {
    for (arguments, says) in [
        (&["view", "hip", "--replay", "x"][..], "cannot be used with"),
        (
            &["view", "--set", "a=b", "--replay", "x"],
            "cannot be used with",
        ),
        (&["view", "--size", "12"], "such as 1280x800"),
        (&["view", "--size", "12x99999"], "200 to 16384"),
        (&["view", "--threads", "0"], "--threads"),
    ] {
        let done = run(arguments);
        let said = text(&done.stderr);
        assert!(
            done.status.code() == Some(2) && said.contains(says),
            "{arguments:?}: {said}"
        );
    }
}
