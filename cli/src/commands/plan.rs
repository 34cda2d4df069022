//! `pliant plan`: the plan of a run.

use serde::Serialize;

use super::failure::Failure;
use super::options::Printing;
use super::{DONE, environment, say_json};
use crate::report::Table;
use pliant::scene::Content;
use pliant::simulation::{Assets, LeftOut, Plan, Planned, scenario};

/// Show which effects a scene runs, on how many elements, and which ones are left out and why
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant plan hip
  pliant plan expander
  pliant plan examples/right-hip.toml --set effects.contact=off --json")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene
    #[arg(default_value = "hip")]
    scene: String,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
    #[command(flatten)]
    printing: Printing,
}

#[derive(Serialize)]
struct Report<'a> {
    scene: &'a str,
    frames: usize,
    run: &'a [Planned],
    left_out: &'a [LeftOut],
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let content = environment::load_content(&arguments.scene, &arguments.set)?;
    let (plan, head) = match &content {
        Content::Muscles(scene) => {
            let assets = Assets::load(scene)?;
            (
                Plan::new(scene, &assets),
                format!("{} frames at {} Hz", scene.frames, scene.frame_rate),
            )
        }
        other => (
            scenario(other)?.plan().clone(),
            format!("{} frames", content.frames()),
        ),
    };
    let scene = content.name();
    if arguments.printing.json {
        say_json(&Report {
            scene,
            frames: content.frames(),
            run: &plan.run,
            left_out: &plan.left_out,
        });
        return Ok(DONE);
    }
    let of = if matches!(content, Content::Muscles(_)) {
        "muscle"
    } else {
        "part"
    };
    let mut text = format!("{scene}: {head}\n\nWill run\n");
    text.push_str(&runs(&plan, of));
    if !plan.left_out.is_empty() {
        text.push_str("\nLeft out\n");
        let mut left_out = Table::new("", [of, "effect", "why"]);
        for l in &plan.left_out {
            left_out.row([all(&l.muscle), l.effect.clone(), l.why.clone()]);
        }
        text.push_str(&left_out.to_text());
    }
    arguments.printing.say(&text);
    Ok(DONE)
}

/// A note without a muscle is about all muscles.
fn all(muscle: &str) -> String {
    if muscle.is_empty() {
        "(all)".to_owned()
    } else {
        muscle.to_owned()
    }
}

fn runs(plan: &Plan, of: &str) -> String {
    let mut table = Table::new("", [of, "effect", "elements", "bytes", "ms/frame"]);
    for p in &plan.run {
        table.row([
            all(&p.muscle),
            p.effect.clone(),
            p.elements.to_string(),
            p.bytes.to_string(),
            format!("{:.2}", p.ms_per_frame),
        ]);
    }
    let bytes: usize = plan.run.iter().map(|p| p.bytes).sum();
    let ms: f64 = plan.run.iter().map(|p| p.ms_per_frame).sum();
    table.row([
        "total".to_owned(),
        String::new(),
        String::new(),
        bytes.to_string(),
        format!("{ms:.2}"),
    ]);
    table.to_text()
}
