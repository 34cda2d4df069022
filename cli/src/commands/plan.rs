//! `pliant plan`: everything that a run does before its first frame, and what its frames will do.

use std::path::PathBuf;
use std::time::Instant;

use serde_json::json;

use super::environment;
use super::failure::Failure;
use super::options::Printing;
use crate::report::output::{RunOutput, effects};
use crate::report::plan::Prepared;
use crate::report::run::effect_tables;
use pliant::io::write_whole;
use pliant::scene::Content;
use pliant::simulation::{Plan, Simulation, scenario};

/// Prepare a scene as a run does, and show its attachments, its overlaps and which effects it runs
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant plan hip
  pliant plan expander
  pliant plan my-knee.toml --preview knee.png
  pliant plan examples/right-hip.toml --set effects.contact=off --json

Nothing is simulated. All mistakes of a scene are reported at once. Exit code 1: a check of the start fails, which
`pliant run` would repeat.")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene
    #[arg(default_value = "hip")]
    scene: String,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
    /// Write a picture of the start from three sides, with the vertices that bones hold in colour
    #[arg(long, value_name = "FILE.png")]
    preview: Option<PathBuf>,
    #[command(flatten)]
    printing: Printing,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let is_png = |path: &PathBuf| {
        path.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("png"))
    };
    if let Some(path) = arguments.preview.as_ref().filter(|path| !is_png(path)) {
        // A name by mistake, such as that of the scene, would be written over.
        let message = format!("--preview `{}` does not end in .png", path.display());
        return Err(Failure::usage(
            message,
            "name the picture, such as start.png",
        ));
    }
    let content = environment::load_content(&arguments.scene, &arguments.set)?;
    let name = content.name().to_owned();
    let frames = content.frames();
    let mut output = match content {
        Content::Muscles(scene) => {
            let at = format!("{name}: {frames} frames at {} Hz\n", scene.frame_rate);
            let simulation = Simulation::new(*scene)?;
            of_muscles(&simulation, arguments, at)?
        }
        _ if arguments.preview.is_some() => {
            return Err(Failure::usage(
                "a preview shows where bones hold muscles, and this scene has none",
                "leave --preview out",
            ));
        }
        other => {
            let scenario = scenario(&other)?;
            let plan = scenario.plan();
            RunOutput {
                text: format!("{name}: {frames} frames\n"),
                ..of_plan("part", plan, frames)
            }
        }
    };
    output.name = name;
    output.time_s = begun.elapsed().as_secs_f64();
    output.tables.retain(|table| !table.rows.is_empty());
    output.tables_of_text = output.tables.len();
    Ok(arguments.printing.finish(output))
}

/// The result for a scene of muscles; `at` is its first line.
fn of_muscles(
    simulation: &Simulation,
    arguments: &Arguments,
    at: String,
) -> Result<RunOutput<'static>, Failure> {
    let prepared = Prepared::new(simulation);
    let mut output = of_plan("muscle", &simulation.plan, simulation.scene.frames);
    let tables = output.tables;
    output.tables = prepared.tables().into_iter().chain(tables).collect();
    output.verdicts = prepared.verdicts();
    output.notes = prepared.notes();
    output.start = Some(prepared.start());
    output.measures["attachments"] = prepared.attachments();
    output.measures["disk_bytes"] = json!(prepared.bytes_on_disk());
    output.text = at;
    if let Some(path) = &arguments.preview {
        let unwritable = |error: &dyn std::fmt::Display| {
            let message = format!("`{}` cannot be written: {error}", path.display());
            Failure::usage(message, "name another file with --preview")
        };
        let png = prepared.preview().map_err(|error| unwritable(&error))?;
        write_whole(path, |w| std::io::Write::write_all(w, &png))
            .map_err(|error| unwritable(&error))?;
        output.written.push(path.display().to_string());
        output.text += &format!("picture: {}\n", path.display());
    }
    Ok(output)
}

/// The effects of a plan; `of` is what they act on.
fn of_plan(of: &str, plan: &Plan, frames: usize) -> RunOutput<'static> {
    let bytes: usize = plan.run.iter().map(|p| p.bytes).sum();
    let ms: f64 = plan.run.iter().map(|p| p.ms_per_frame).sum();
    let [mut ran, left_out] = effect_tables(of, plan);
    let (all_bytes, all_ms) = (bytes.to_string(), format!("{ms:.2}"));
    ran.row([
        "total".to_owned(),
        String::new(),
        String::new(),
        all_bytes,
        all_ms,
    ]);
    RunOutput {
        kind: "plan",
        measures: json!({
            "frames_in_scene": frames,
            "effects": effects(plan),
            "bytes": bytes,
            "frame_s": ms * 1e-3,
        }),
        tables: vec![ran, left_out],
        ..RunOutput::default()
    }
}
