//! `pliant scenes`: the built-in scenes.

use serde_json::json;

use super::failure::Failure;
use super::options::Printing;
use crate::report::Table;
use crate::report::output::RunOutput;
use pliant::scene::builtin::{BUILTIN, builtin, load};

/// List the built-in scenes, or show one
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant scenes
  pliant scenes show hip > my.toml")]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    printing: Printing,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Print the TOML of a built-in scene
    #[command(after_help = "Example:\n  pliant scenes show hip > my.toml")]
    Show {
        /// Name of the scene
        name: String,
    },
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let (name, scenes, text) = match &arguments.command {
        None => {
            let mut table = Table::default();
            let each = BUILTIN.iter().map(|(name, _, about)| {
                table.row([*name, *about]);
                json!({"name": name, "about": about})
            });
            let scenes: Vec<_> = each.collect();
            ("built-in scenes", scenes, table.to_text())
        }
        Some(Command::Show { name }) => {
            let Some(toml) = builtin(name) else {
                // The error of the loader lists the existing scenes.
                load(name, &[])?;
                let hint = "`pliant scenes` lists those that need no file";
                return Err(Failure::usage(
                    format!("`{name}` is a file, not a built-in scene"),
                    hint,
                ));
            };
            let about = BUILTIN.iter().find(|(known, ..)| known == name);
            let about = about.map(|(_, _, about)| about);
            let scene = json!({"name": name, "about": about, "toml": toml});
            (name.as_str(), vec![scene], toml.to_owned())
        }
    };
    Ok(arguments.printing.finish(RunOutput {
        kind: "scenes",
        name: name.to_owned(),
        measures: json!({"scenes": scenes}),
        text,
        ..RunOutput::default()
    }))
}
