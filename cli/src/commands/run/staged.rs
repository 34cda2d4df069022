//! `pliant run` for a scene without muscles.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::Arguments;
use crate::commands::failure::Failure;
use crate::commands::progress::Rounds;
use crate::commands::{DONE, FAILED, INTERRUPTED, columns, say, say_json};
use crate::report::folder::Folder;
use crate::report::run::{Ended, Listener, Run, Wanted, perform, ready};
use crate::report::summary::Verdict;
use pliant::io::names::file_name;
use pliant::scene::content::Staged;

/// Prints the progress; Ctrl-C stops the run.
struct Said<'a> {
    stop: &'a AtomicBool,
    rounds: Rounds,
}

impl Listener for Said<'_> {
    fn part(&mut self, text: &str) -> bool {
        self.rounds.part(text);
        true
    }

    fn frame(&mut self, frame: usize, took: Duration) {
        self.rounds.frame(frame, took);
    }

    fn stops(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Runs to the last frame or to Ctrl-C.
pub(super) fn run(
    arguments: &Arguments,
    scene: &Staged,
    begun: Instant,
    stop: &AtomicBool,
) -> Result<u8, Failure> {
    if arguments.resume || arguments.checkpoint_every.is_some() {
        let message = "checkpoints are for scenes of muscles";
        return Err(Failure::usage(
            message,
            "leave --checkpoint-every and --resume out: this scene runs from its start",
        ));
    }
    let mut run = ready(scene)?;
    let run = run.as_mut();
    let out = arguments
        .out
        .clone()
        .unwrap_or_else(|| PathBuf::from("pliant-out").join(file_name(run.name())));
    let wanted = Wanted {
        animate: arguments.animate.is_some(),
        begun,
        settings: super::settings(arguments),
    };
    let mut said = Said {
        stop,
        rounds: Rounds::new(run.frames()),
    };
    let ended = perform(run, Folder::open(&out)?, &wanted, &mut said)?;
    said.rounds.end();
    if arguments.json {
        say_json(&ended.summary);
    } else {
        say(&in_words(run, &ended, &out, begun.elapsed()));
    }
    Ok(match (ended.interrupted, ended.converged) {
        (true, _) => INTERRUPTED,
        (false, true) => DONE,
        (false, false) => FAILED,
    })
}

/// The final message for the user.
fn in_words(run: &dyn Run, ended: &Ended, folder: &Path, took: Duration) -> String {
    let interrupted = if ended.interrupted {
        ", interrupted"
    } else {
        ""
    };
    let (frames, wanted, seconds) = (run.frame(), run.frames(), took.as_secs_f64());
    let mut text = format!(
        "{}: {frames} of {wanted} frames in {seconds:.1} s{interrupted}\n\n",
        run.name()
    );
    let row = |v: &Verdict| {
        let mark = if v.kept { "pass" } else { "FAIL" };
        vec![
            mark.to_owned(),
            v.muscle.clone(),
            v.promise.clone(),
            v.found.clone(),
        ]
    };
    text.push_str(&columns(
        &ended.account.verdicts.iter().map(row).collect::<Vec<_>>(),
        &[],
    ));
    if let Some(why) = ended.summary["stopped"].as_str() {
        text.push_str(&format!("  FAIL  {why}\n"));
    }
    ended
        .account
        .tables
        .iter()
        .for_each(|table| text.push_str(&format!("\n{}", table.to_text())));
    ended
        .account
        .notes
        .iter()
        .for_each(|note| text.push_str(&format!("  note: {note}\n")));
    let file = |name: &str| folder.join(name).display().to_string();
    text.push_str(&format!(
        "\nResults in {}\n  open {} in a browser\n  open {} in ParaView\n",
        folder.display(),
        file("report.html"),
        file(&format!("{}.pvd", file_name(run.name())))
    ));
    text
}
