//! Scenes made from the options of a command: their text, and errors in words of these options.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::path::{Component, Path};

use super::environment;
use super::failure::Failure;
pub(super) use crate::draft::quoted;
use pliant::scene::{Content, SceneError, Surroundings, parse_content};
use pliant::simulation::LoadError;

/// The text of a scene, with the option from which each of its keys comes.
#[derive(Debug, Default)]
pub(super) struct SceneText {
    text: String,
    /// Key of the present section, with a dot at its end; empty for the document.
    section: String,
    /// Keys with their options.
    options: Vec<(String, String)>,
    /// Words of advice about keys, with those of the command.
    words: &'static [(&'static str, &'static str)],
}

impl SceneText {
    /// A scene with this name. Advice replaces the first of each pair of `words` by the second.
    pub(super) fn new(name: &str, words: &'static [(&'static str, &'static str)]) -> Self {
        let mut made = Self {
            words,
            ..Self::default()
        };
        made.put("name", quoted(name), "");
        made
    }

    /// Begins a section with a header such as `[[implant]]`, whose keys are below `key`. `option`
    /// names the section in errors; it may be empty.
    pub(super) fn begin(&mut self, header: &str, key: &str, option: &str) {
        let _ = writeln!(self.text, "\n{header}");
        self.section = format!("{key}.");
        self.options.push((key.to_owned(), option.to_owned()));
    }

    /// Adds a key with its value in TOML, which comes from an option.
    pub(super) fn put(&mut self, key: &str, value: impl AsRef<str>, option: &str) {
        let _ = writeln!(self.text, "{key} = {}", value.as_ref());
        let key = format!("{}{key}", self.section);
        self.options.push((key, option.to_owned()));
    }

    /// Adds a key whose value is a text from an option `--NAME TEXT`.
    pub(super) fn put_text(&mut self, key: &str, option: &str, text: &str) {
        let text = text.trim();
        self.put(key, quoted(text), &format!("{option} {text}"));
    }

    /// The text.
    pub(super) fn text(&self) -> &str {
        &self.text
    }

    /// The scene, checked by the reader of scene files. Paths start in the working folder.
    pub(super) fn content(&self) -> Result<Content, Failure> {
        let surroundings = Surroundings {
            variable: &environment::variable,
            ..Surroundings::of(Path::new("."))
        };
        parse_content(&self.text, "scene.toml", &surroundings).map_err(|e| self.of_scene(&e))
    }

    /// The refusal of a value of this scene, in words of the command.
    pub(super) fn refused(&self, key: &str, message: &str, help: &str) -> Failure {
        let mut help = help.to_owned();
        for (key, option) in self.words {
            help = help.replace(key, option);
        }
        let message = match self.option_of(key) {
            Some(option) => format!("{option}: {message}"),
            None => message.to_owned(),
        };
        Failure::usage(message, help)
    }

    /// The refusal of a mesh or of a number in this scene.
    pub(super) fn of_load(&self, error: LoadError) -> Failure {
        match error {
            LoadError::Unfit(unfit) => {
                let (message, help) = (unfit.fault.to_string(), unfit.fault.help());
                self.refused(unfit.scene_error().key(), &message, &help)
            }
            read => Failure::of_meshes(read),
        }
    }

    fn of_scene(&self, error: &SceneError) -> Failure {
        let problem = error.problem();
        self.refused(error.key(), &problem.to_string(), &problem.help())
    }

    /// The option of a key or of the longest part of it that has one.
    fn option_of(&self, key: &str) -> Option<&str> {
        let is_above = |above: &str| {
            key.strip_prefix(above)
                .is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        let options = self.options.iter().filter(|(above, _)| is_above(above));
        let longest = options.max_by_key(|(above, _)| above.len());
        longest
            .map(|(_, option)| option.as_str())
            .filter(|option| !option.is_empty())
    }
}

/// A number in TOML.
pub(super) fn number(value: f64) -> String {
    toml::Value::Float(value).to_string()
}

/// The path of a file in a scene: as given, or absolute if it leaves the working folder.
pub(super) fn path(given: &Path) -> Result<String, Failure> {
    let text = |path: &Path| path.to_str().map(str::to_owned);
    let not_text = || {
        let message = format!("the name of `{}` is not UTF-8", given.display());
        Failure::usage(message, "rename it")
    };
    let leaves = given.components().any(|c| c == Component::ParentDir);
    // A scene replaces a variable at the start of a path.
    let is_variable = given.to_str().is_some_and(|text| text.starts_with('$'));
    if !leaves && !is_variable {
        return text(given).ok_or_else(not_text);
    }
    let absolute = given.canonicalize().map_err(|e| {
        Failure::usage(
            format!("no file `{}`: {e}", given.display()),
            "check the path",
        )
    })?;
    text(&absolute).ok_or_else(not_text)
}

/// Greatest length of a name after a file [bytes]: file systems allow 255 for a file.
const LONGEST_NAME: usize = 120;

/// A name for a scene or a body after the stem of a file, different from all earlier ones.
pub(super) fn name_after(file: &Path, used: &mut HashSet<String>) -> Result<String, Failure> {
    let Some(stem) = file.file_stem().and_then(|s| s.to_str()) else {
        return Err(Failure::usage(
            format!("the name of `{}` is not UTF-8", file.display()),
            "rename it",
        ));
    };
    // Replaces characters that a scene does not accept in a name.
    let safe = |c: char| {
        if c.is_control() || r#"/\:*?"<>|"#.contains(c) {
            '_'
        } else {
            c
        }
    };
    let clean: String = stem.chars().map(safe).collect();
    // Files of a run are named after it, with more before and behind.
    let end = clean.floor_char_boundary(LONGEST_NAME);
    let clean = clean[..end].trim().trim_start_matches('.');
    let first = if clean.is_empty() { "mesh" } else { clean };
    let mut name = first.to_owned();
    let mut next = 2;
    while !used.insert(name.clone()) {
        name = format!("{first} {next}");
        next += 1;
    }
    Ok(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_names_the_option_of_its_key() {
        let mut made = SceneText::new("a", &[("`edge_length`", "--edge")]);
        made.begin("[[skin]]", "skin.0", "");
        made.put("shape", "\"scalp\"", "");
        made.put_text("edge_length", "--edge", "3 furlong");
        let said = made.content().expect_err("no length").terse();
        assert!(
            said.starts_with("error: --edge 3 furlong: `furlong` is not"),
            "{said}"
        );
        let said = |key: &str| made.refused(key, "no", "change `edge_length`").terse();
        assert_eq!(
            said("skin.0.edge_length.1"),
            "error: --edge 3 furlong: no; change --edge"
        );
        assert_eq!(said("skin.0.edge"), "error: no; change --edge");
        assert_eq!(said("skin.0.shape"), "error: no; change --edge");
    }

    #[test]
    fn a_name_has_no_character_that_a_scene_refuses() {
        let mut used = HashSet::new();
        let mut of = |file: &str| name_after(Path::new(file), &mut used).expect("UTF-8");
        let names = ["scans/vastus:left.stl", "a\tb.obj", "a_b.obj", " été.obj"].map(&mut of);
        assert_eq!(names, ["vastus_left", "a_b", "a_b 2", "été"]);
        assert_eq!(of("...obj"), "mesh", "nothing is left");
        assert_eq!(of(&"é".repeat(100)), "é".repeat(60), "at most 120 bytes");
    }

    #[test]
    fn paths_stay_as_given_unless_they_leave_the_folder() {
        let of = |text: &str| path(Path::new(text)).ok();
        assert_eq!(of("a/b.obj").as_deref(), Some("a/b.obj"));
        assert_eq!(of("/a/b.obj").as_deref(), Some("/a/b.obj"));
        let own = of("src/../Cargo.toml").expect("a file");
        assert!(Path::new(&own).is_absolute(), "{own}");
        assert_eq!(of("../no-such-file"), None);
    }
}
