//! `pliant completions` and `pliant man`: files for shells and for `man`, and the page of all commands.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::{Arg, Command, CommandFactory};
use clap_complete::Shell;

use super::failure::Failure;
use super::say;

/// Print a script with which a shell completes the names of commands and options
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant completions bash > ~/.local/share/bash-completion/completions/pliant
  pliant completions zsh > ~/.zfunc/_pliant
  pliant completions fish > ~/.config/fish/completions/pliant.fish")]
pub(super) struct Completions {
    /// The shell
    shell: Shell,
}

/// Write a man page for each command into a folder
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  pliant man ~/.local/share/man/man1")]
pub(super) struct Man {
    /// Folder of the pages, made if it is absent
    #[arg(required_unless_present = "page", conflicts_with = "page")]
    folder: Option<PathBuf>,
    /// Print all commands and options as a page of Markdown, docs/commands.md
    #[arg(long)]
    page: bool,
}

pub(super) fn completions(arguments: &Completions) -> u8 {
    let mut script = Vec::new();
    clap_complete::generate(
        arguments.shell,
        &mut super::Arguments::command(),
        "pliant",
        &mut script,
    );
    say(&String::from_utf8_lossy(&script));
    super::DONE
}

pub(super) fn man(arguments: &Man) -> Result<u8, Failure> {
    let Some(folder) = &arguments.folder else {
        say(&page());
        return Ok(super::DONE);
    };
    let refused = |error: std::io::Error| {
        Failure::usage(
            format!(
                "cannot write man pages into `{}`: {error}",
                folder.display()
            ),
            "name a folder that can be written to",
        )
    };
    std::fs::create_dir_all(folder).map_err(refused)?;
    clap_mangen::generate_to(super::Arguments::command(), folder).map_err(refused)?;
    Ok(super::DONE)
}

/// All commands and their options as Markdown.
fn page() -> String {
    let mut text = "\
# Commands

`pliant man --page` writes this page. `pliant COMMAND --help` shows the same with examples.

| exit code | meaning |
|---|---|
| 0 | every check passes |
| 1 | a check of the result fails (0 with `--lenient`), or files could not be written |
| 2 | bad usage or input |
| 130, 143 | after Ctrl-C or SIGTERM, with every file closed and readable |
"
    .to_owned();
    let mut root = super::Arguments::command();
    root.build();
    for command in root.get_subcommands_mut() {
        write_command(&mut text, command);
    }
    text
}

/// Appends a command and those below it.
fn write_command(text: &mut String, command: &mut Command) {
    if command.is_hide_set() || command.get_name() == "help" {
        return;
    }
    let usage = command.render_usage().to_string();
    let usage = usage.trim_start_matches("Usage: ").replace('\n', " ");
    let about = command
        .get_about()
        .map(ToString::to_string)
        .unwrap_or_default();
    let name = usage
        .split([' '])
        .take_while(|word| word.starts_with(|c: char| c.is_lowercase()));
    let name = name.collect::<Vec<_>>().join(" ");
    let usage = usage.split_whitespace().collect::<Vec<_>>().join(" ");
    let _ = write!(
        text,
        "\n## {name}\n\n{about}.\n\n`{usage}`\n\n| option | meaning |\n|---|---|\n"
    );
    let shown = |argument: &&Arg| {
        let is_general = ["help", "version"].contains(&argument.get_id().as_str());
        !argument.is_hide_set() && !is_general
    };
    for argument in command.get_arguments().filter(shown) {
        let _ = writeln!(text, "| {} | {} |", spelled(argument), meaning(argument));
    }
    for below in command.get_subcommands_mut() {
        write_command(text, below);
    }
}

/// An option with its values as code.
fn spelled(argument: &Arg) -> String {
    let values: Vec<String> = argument
        .get_value_names()
        .unwrap_or_default()
        .iter()
        .map(ToString::to_string)
        .collect();
    let takes = argument.get_action().takes_values();
    let values = if takes {
        values.join(" ")
    } else {
        String::new()
    };
    match argument.get_long() {
        Some(long) if values.is_empty() => format!("`--{long}`"),
        Some(long) => format!("`--{long} {values}`"),
        None => format!("`{values}`"),
    }
}

/// The help of an option in one line, with its possible values and its default.
fn meaning(argument: &Arg) -> String {
    let help = argument
        .get_help()
        .map(ToString::to_string)
        .unwrap_or_default();
    let mut text = help.replace('|', "\\|").replace('\n', " ");
    let possible = argument.get_possible_values();
    let named: Vec<&str> = possible
        .iter()
        .filter(|v| !v.is_hide_set())
        .map(|v| v.get_name())
        .collect();
    if argument.get_action().takes_values() && !named.is_empty() {
        let _ = write!(text, "; one of {}", named.join(", "));
    }
    let defaults = argument
        .get_default_values()
        .iter()
        .map(|value| value.to_string_lossy());
    let defaults = defaults.collect::<Vec<_>>().join(", ");
    if argument.get_action().takes_values() && !defaults.is_empty() {
        let _ = write!(text, " [default: {defaults}]");
    }
    text
}
