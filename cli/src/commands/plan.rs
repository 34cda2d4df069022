//! `pliant plan`: the plan of a run.

use std::time::Instant;

use serde_json::json;

use super::environment;
use super::failure::Failure;
use super::options::Printing;
use crate::report::output::{RunOutput, effects};
use crate::report::run::effect_tables;
use pliant::scene::Content;
use pliant::simulation::{Assets, Plan, scenario};

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

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let content = environment::load_content(&arguments.scene, &arguments.set)?;
    let (plan, of, rate) = match &content {
        Content::Muscles(scene) => {
            let plan = Plan::new(scene, &Assets::load(scene)?);
            (plan, "muscle", format!(" at {} Hz", scene.frame_rate))
        }
        other => (scenario(other)?.plan().clone(), "part", String::new()),
    };
    let bytes: usize = plan.run.iter().map(|p| p.bytes).sum();
    let ms: f64 = plan.run.iter().map(|p| p.ms_per_frame).sum();
    let [mut ran, left_out] = effect_tables(of, &plan);
    let (all_bytes, all_ms) = (bytes.to_string(), format!("{ms:.2}"));
    ran.row([
        "total".to_owned(),
        String::new(),
        String::new(),
        all_bytes,
        all_ms,
    ]);
    let mut tables = vec![ran, left_out];
    tables.retain(|table| !table.rows.is_empty());
    let name = content.name().to_owned();
    Ok(arguments.printing.finish(RunOutput {
        kind: "plan",
        measures: json!({
            "frames_in_scene": content.frames(),
            "effects": effects(&plan),
            "bytes": bytes,
            "frame_s": ms * 1e-3,
        }),
        time_s: begun.elapsed().as_secs_f64(),
        text: format!("{name}: {} frames{rate}\n", content.frames()),
        name,
        tables_of_text: tables.len(),
        tables,
        ..RunOutput::default()
    }))
}
