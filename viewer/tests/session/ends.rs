//! Moves controls to both ends.

use pliant_viewer::panel::Control;
use pliant_viewer::{Command, Session, Snapshot};

use super::{answer_to, done};

fn now(shot: &Snapshot, like: &Control) -> Option<Control> {
    shot.controls
        .iter()
        .find(|c| (&c.group, &c.label) == (&like.group, &like.label))
        .cloned()
}

/// Moves each control that `is_meant` selects to both ends and back; `settled` checks the
/// result. Returns the rejected moves.
pub fn at_both_ends(
    session: &Session,
    is_meant: impl Fn(&Control) -> bool,
    mut settled: impl FnMut(&Session, &str),
) -> Vec<String> {
    let mut refused = Vec::new();
    let controls: Vec<Control> = session
        .latest()
        .controls
        .iter()
        .filter(|c| is_meant(c))
        .cloned()
        .collect();
    assert!(
        !controls.is_empty(),
        "no control: the test would show nothing"
    );
    for control in controls {
        for share in [0.0, 1.0] {
            let context = format!("{}/{} at {share}", control.group, control.label);
            let command = control
                .command(control.at(share))
                .unwrap_or_else(|e| panic!("{context}: {e}"));
            let before = session.latest().refused.clone();
            let shot = answer_to(session, command);
            if shot.refused != before {
                let (_, why) = shot.refused.clone().unwrap_or_default();
                assert!(why.len() > 20, "{context}: {why}");
                refused.push(format!("{context}: {why}"));
                continue;
            }
            if let Some(moved) = now(&shot, &control) {
                assert!(
                    (moved.share() - share).abs() < 1e-9,
                    "{context}: it shows {}",
                    moved.share()
                );
            }
            settled(session, &context);
        }
        if let Some(path) = control.path() {
            let back = done(
                session,
                Command::Restore {
                    path: path.to_owned(),
                },
            );
            let shown = now(&back, &control).map_or(control.share(), |c| c.share());
            assert!(
                (shown - control.share()).abs() < 1e-9,
                "{}: restored to {shown}",
                control.label
            );
        }
    }
    refused
}
