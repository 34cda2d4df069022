//! `pliant contact`: responses to penetration and methods of detection, compared on a scene.

use std::sync::atomic::Ordering;
use std::time::Instant;

use super::environment;
use super::failure::Failure;
use super::options::{Printing, Threads};
use super::progress::Bar;
use super::run::stop_on_interrupt;
use crate::report::Table;
use crate::report::output::{RunOutput, Verdict, measures};
use pliant::format::number;
use pliant::scene::Content;
use pliant::simulation::{Simulation, compare_contact};

/// Compare the responses to vertices inside bones, and the methods that find them, on a scene
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant contact press
  pliant contact press --ahead 40 --json > contact.json
  pliant contact examples/right-hip.toml --frame 20 --ahead 10

The scene runs to --frame. Then the bones move --ahead frames at once and the muscles stay, so that bones swallow vertices. Each
response of Cervenka (2019) is applied once to every free vertex inside a bone. The scene itself uses none of them: it keeps
vertices out of bones before they are inside.

Columns: vertices inside before and after, vertices deeper than before, vertices pushed into another bone, vertices on the other
side of the bone (only where the vertex was outside before, so that its side is known), greatest remaining depth, greatest and
RMS motion, time relative to the fastest. The second table has the signed distance of every vertex in the box of a bone by each
method of detection. Times are measured once; on a busy machine two rows may be off by a factor of two.

Exit codes: 0 done; 1 no vertex is inside a bone, or an exact method has a wrong distance;
2 bad usage or input; 130 or 143 interrupted.")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene
    #[arg(default_value = "press")]
    scene: String,
    /// Frame of the muscles; 0 is the start
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=10_000_000))]
    frame: u32,
    /// Number of frames that the bones move at once
    #[arg(long, value_name = "K", default_value_t = 30, value_parser = clap::value_parser!(u32).range(0..=10_000_000))]
    ahead: u32,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
    #[command(flatten)]
    threads: Threads,
    #[command(flatten)]
    printing: Printing,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let Content::Muscles(scene) = environment::load_content(&arguments.scene, &arguments.set)?
    else {
        return Err(Failure::usage(
            "contact of muscles with bones is compared, and this scene has no muscles",
            "name a scene of muscles and bones; `pliant scenes` lists the built-in ones",
        ));
    };
    let (frames, last) = (arguments.frame as usize, scene.frames);
    if frames > last {
        return Err(Failure::usage(
            format!("--frame {frames} is after the last frame of the scene"),
            format!("give a frame from 0 to {last}"),
        ));
    }
    arguments.threads.start();
    let stop = stop_on_interrupt("stopping after this frame");
    let mut simulation = Simulation::new(*scene)?;
    let bar = Bar::of_parts(frames);
    while simulation.frame() < frames && !stop.load(Ordering::Relaxed) {
        simulation.step_frame();
        bar.reach(simulation.frame(), frames);
    }
    bar.end();
    let mut output = output(&simulation, arguments.ahead as usize);
    output.interrupted = simulation.frame() < frames;
    output.time_s = begun.elapsed().as_secs_f64();
    Ok(arguments.printing.finish(output))
}

/// A length in mm.
fn mm(length: f64) -> String {
    number(length * 1e3)
}

fn output(simulation: &Simulation, ahead: usize) -> RunOutput<'static> {
    let compared = compare_contact(simulation, ahead);
    let mut responses = Table::new(
        "Responses, applied once",
        [
            "response",
            "inside before",
            "inside after",
            "deeper",
            "in another bone",
            "wrong side",
            "greatest depth [mm]",
            "greatest motion [mm]",
            "RMS motion [mm]",
            "time",
        ],
    );
    for row in &compared.responses {
        let counts = [
            row.inside_before,
            row.inside,
            row.deeper,
            row.in_another_bone,
            row.wrong_side,
        ];
        let lengths = [row.depth_max_m, row.motion_max_m, row.motion_rms_m];
        let mut cells = vec![row.response.to_owned()];
        cells.extend(counts.map(|n| n.to_string()));
        cells.extend(lengths.map(mm));
        cells.push(format!("{:.1}", row.time_ratio));
        responses.row(cells);
    }
    let mut detection = Table::new(
        "Methods of detection",
        [
            "method",
            "preparation [ms]",
            "distance [us]",
            "time",
            "memory [MB]",
            "wrong side",
            "greatest error [mm]",
        ],
    );
    for row in &compared.detection {
        detection.row([
            row.method.clone(),
            format!("{:.1}", row.build_s * 1e3),
            format!("{:.2}", row.query_s * 1e6),
            format!("{:.1}", row.time_ratio),
            format!("{:.3}", row.bytes as f64 * 1e-6),
            row.misjudged.to_string(),
            mm(row.error_max_m),
        ]);
    }
    let wrong = compared.detection.iter().filter(|row| !row.kept);
    let wrong: Vec<&str> = wrong.map(|row| row.method.as_str()).collect();
    let mut agree = Verdict::new("exact methods of detection agree", wrong.is_empty());
    if !wrong.is_empty() {
        agree = agree.at(wrong.join(", "));
    }
    let (frame, name) = (compared.frame, simulation.scene.name.clone());
    RunOutput {
        kind: "contact",
        text: format!(
            "{name}: muscles at frame {frame}, bones {ahead} frames ahead: {} of {} free vertices inside a bone, up to {} mm \
             deep; the side of {} is known\n",
            compared.inside,
            compared.vertices,
            mm(compared.depth_max_m),
            compared.sides_known
        ),
        name,
        verdicts: vec![
            Verdict::new("at least one vertex is inside a bone", compared.inside > 0)
                .else_do("give a larger --ahead, or a --frame before the bones move"),
            agree,
        ],
        measures: measures(&compared),
        tables_of_text: 2,
        tables: vec![responses, detection],
        ..RunOutput::default()
    }
}
