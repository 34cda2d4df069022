//! `pliant scenes`: the built-in scenes, and the keys of a scene.

mod explain;

use serde_json::json;

use explain::Explained;

use super::failure::Failure;
use super::options::Printing;
use crate::report::Table;
use crate::report::output::RunOutput;
use pliant::scene::builtin::{BUILTIN, builtin, load};

/// List the built-in scenes, show one, or explain the keys of a scene
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant scenes
  pliant scenes show hip > my.toml
  pliant scenes explain muscle.attachment")]
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
    /// Explain a key or a section of a scene file, or all
    #[command(
        after_help = "Examples:\n  pliant scenes explain\n  pliant scenes explain muscle.attachment\n  \
        pliant scenes explain effects.contact.friction"
    )]
    Explain {
        /// Key or section, such as `effects.contact`; all without it
        #[arg(conflicts_with = "page")]
        key: Option<String>,
        /// Print all keys as a page of Markdown, docs/scene.md
        #[arg(long)]
        page: bool,
    },
}

/// The keys at a path and below it; all without a path.
fn keys(path: Option<&str>) -> Result<Vec<Explained>, Failure> {
    let mut all = explain::all();
    let Some(path) = path else { return Ok(all) };
    // As in `--set`, elements of a list may have their number.
    let parts = path
        .split('.')
        .filter(|part| part.parse::<usize>().is_err());
    let path = parts.collect::<Vec<_>>().join(".");
    let below = format!("{path}.");
    let known: Vec<String> = all.iter().map(|key| key.path.clone()).collect();
    all.retain(|key| key.path == path || key.path.starts_with(&below));
    if all.is_empty() {
        let last = path.rsplit('.').next().unwrap_or_default();
        let alike = known
            .iter()
            .filter(|known| known.rsplit('.').next() == Some(last));
        let alike: Vec<&str> = alike.map(String::as_str).collect();
        let hint = match alike.is_empty() {
            true => "`pliant scenes explain` lists all keys".to_owned(),
            false => format!("did you mean {}?", alike.join(" or ")),
        };
        return Err(Failure::usage(format!("a scene has no key `{path}`"), hint));
    }
    Ok(all)
}

/// The keys of a scene, for a terminal and as JSON.
fn explained(key: Option<&str>, page: bool) -> Result<RunOutput<'static>, Failure> {
    let keys = keys(key)?;
    let json = keys.iter().map(|key| {
        json!({"kind": key.kind, "key": key.path, "example": key.example, "takes": key.takes, "default": key.default, "about": key.about})
    });
    Ok(RunOutput {
        kind: "scenes",
        name: "keys of a scene".to_owned(),
        measures: json!({"scenes": [], "keys": json.collect::<Vec<_>>()}),
        text: match page {
            true => explain::page(),
            false => explain::table(&keys).to_text(),
        },
        ..RunOutput::default()
    })
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    if let Some(Command::Explain { key, page }) = &arguments.command {
        return Ok(arguments.printing.finish(explained(key.as_deref(), *page)?));
    }
    let (name, scenes, text) = match &arguments.command {
        None | Some(Command::Explain { .. }) => {
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
