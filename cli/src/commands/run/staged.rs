//! `pliant run` for a scene without muscles.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use super::Arguments;
use crate::commands::failure::Failure;
use crate::commands::progress::Stoppable;
use crate::commands::{DONE, FAILED, INTERRUPTED, say_json};
use crate::report::folder::Folder;
use crate::report::output::verdict_table;
use crate::report::run::{Performed, Wanted, perform};
use pliant::io::file_name;
use pliant::scene::Content;
use pliant::simulation::{Scenario, scenario};

/// Runs to the last frame or to Ctrl-C.
pub(super) fn run(
    arguments: &Arguments,
    scene: &Content,
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
    let mut scenario = scenario(scene)?;
    let scenario = scenario.as_mut();
    let out = arguments.output.folder(scenario.name(), "");
    let wanted = Wanted {
        animate: arguments.animate.is_some(),
        begun,
        settings: super::settings(arguments),
    };
    let said = Stoppable::new(scenario.frames(), stop);
    let ended = perform(scenario, Folder::open(&out)?, &wanted, &said)?;
    said.bar.end();
    if arguments.output.printing.json {
        say_json(&ended.summary);
    }
    let text = in_words(scenario, &ended, &out, begun.elapsed());
    arguments.output.printing.say(&text);
    Ok(match (ended.interrupted, ended.converged) {
        (true, _) => INTERRUPTED,
        (false, true) => DONE,
        (false, false) => FAILED,
    })
}

/// The final message for the user.
fn in_words(scenario: &dyn Scenario, ended: &Performed, folder: &Path, took: Duration) -> String {
    let interrupted = if ended.interrupted {
        ", interrupted"
    } else {
        ""
    };
    let (frames, wanted, seconds) = (scenario.frame(), scenario.frames(), took.as_secs_f64());
    let mut text = format!(
        "{}: {frames} of {wanted} frames in {seconds:.1} s{interrupted}\n\n",
        scenario.name()
    );
    text.push_str(&verdict_table(&ended.account.verdicts).to_text());
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
        file(&format!("{}.pvd", file_name(scenario.name())))
    ));
    text
}
