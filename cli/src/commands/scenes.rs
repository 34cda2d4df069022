//! `pliant scenes`: the built-in scenes.

use serde::Serialize;

use super::failure::Failure;
use super::options::Printing;
use super::{DONE, say, say_json};
use crate::report::Table;
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

#[derive(Serialize)]
struct Listed {
    name: &'static str,
    about: &'static str,
}

#[derive(Serialize)]
struct Shown<'a> {
    name: &'a str,
    toml: &'static str,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    match &arguments.command {
        None if arguments.printing.json => {
            let listed = BUILTIN
                .iter()
                .map(|&(name, _, about)| Listed { name, about });
            say_json(&listed.collect::<Vec<_>>());
        }
        None => {
            let mut table = Table::default();
            BUILTIN
                .iter()
                .for_each(|(name, _, about)| table.row([*name, *about]));
            arguments.printing.say(&table.to_text());
        }
        Some(Command::Show { name }) => match builtin(name) {
            Some(toml) if arguments.printing.json => say_json(&Shown { name, toml }),
            Some(toml) => say(toml),
            // The error of the loader lists the existing scenes.
            None => {
                load(name, &[])?;
                let hint = "`pliant scenes` lists those that need no file";
                return Err(Failure::usage(
                    format!("`{name}` is a file, not a built-in scene"),
                    hint,
                ));
            }
        },
    }
    Ok(DONE)
}
