//! Every key of a scene with an example, what it takes and what it means.
//!
//! Examples and meanings are those of the layouts, which the library documents and tests. What a key
//! takes is asked of the reader itself: its error for a value of a wrong type, and for one out of range.

use std::collections::HashMap;
use std::path::Path;

use pliant::scene::{Content, LAYOUTS, SOLVERS, SceneError, Surroundings, parse_content};

use crate::report::Table;

/// The files that the layouts name. They need not be there: another file stands for them.
const FILES: [&str; 8] = [
    "$PLIANT_DATA/body/bones/Femur.r.obj",
    "femur.obj",
    "gluteus.obj",
    "patch.obj",
    "fibres.vtk",
    "skin.obj",
    "ribs.obj",
    "ball.obj",
];

/// Sections that the layouts have in a remark, and what makes the layout a scene that has them.
const OTHERS: [(&str, &[&str]); 3] = [
    (
        "sheet",
        &[
            "skin.0.mesh=off",
            "skin.0.unit=off",
            "skin.0.repair=off",
            "skin.0.shape=sheet",
            "sheet={ side = '20 cm', cells = 64 }",
        ],
    ),
    (
        "ball",
        &["implant=off", "obstacle=off", "ball={ radius = '2.5 mm' }"],
    ),
    (
        "lattice.rest",
        &["lattice.drag=off", "lattice.release=off", "lattice.rest=on"],
    ),
];

/// A key, or a section.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Explained {
    /// The kind of scenes that has it.
    pub kind: &'static str,
    /// Its path, without the numbers of list elements.
    pub path: String,
    /// An example; empty for a section.
    pub example: String,
    /// What it takes; empty for a section.
    pub takes: String,
    /// The value without it; "needed" for a key that must be there; empty for a section.
    pub default: String,
    /// What it means.
    pub about: String,
}

/// Every key of every kind of scene, in the order of the layouts.
pub(super) fn all() -> Vec<Explained> {
    let mut all = Vec::new();
    for (kind, layout) in LAYOUTS {
        let mut of_kind = Reading::new(kind, layout).read();
        if of_kind.iter().any(|key| key.path.starts_with("solver.")) {
            of_kind.extend(of_solvers(kind, layout, &of_kind));
        }
        all.extend(of_kind);
    }
    all
}

/// The settings of the solvers that the layout does not show.
fn of_solvers(kind: &'static str, layout: &str, known: &[Explained]) -> Vec<Explained> {
    let mut all = Vec::new();
    for solver in SOLVERS.iter() {
        let shown = format!("solver.{}", solver.key);
        if known.iter().any(|key| key.path == shown) {
            continue;
        }
        all.push(Explained {
            kind,
            path: shown.clone(),
            example: String::new(),
            takes: String::new(),
            default: String::new(),
            about: solver.help.to_owned(),
        });
        for (key, default) in solver.default.settings() {
            let path = format!("{shown}.{}", key.key);
            let before = format!("solver={}", solver.key);
            all.push(Explained {
                kind,
                takes: takes(layout, &[before], &path),
                path,
                example: format!("{} = {default}", key.key),
                default: default.to_string(),
                about: key.help.to_owned(),
            });
        }
    }
    all
}

/// The reading of a layout.
struct Reading<'a> {
    kind: &'static str,
    layout: &'a str,
    /// The section, with and without the numbers of its elements.
    section: (String, String),
    counts: HashMap<String, usize>,
    found: Vec<Explained>,
}

impl<'a> Reading<'a> {
    fn new(kind: &'static str, layout: &'a str) -> Self {
        Self {
            kind,
            layout,
            section: (String::new(), String::new()),
            counts: HashMap::new(),
            found: Vec::new(),
        }
    }

    fn read(mut self) -> Vec<Explained> {
        let mut lines = self.layout.lines();
        while let Some(line) = lines.next() {
            let (mut code, mut about) = parted(line);
            // A list goes on until its bracket closes.
            while code.matches('[').count() > code.matches(']').count() {
                let Some((more, note)) = lines.next().map(parted) else {
                    break;
                };
                code = format!("{code} {more}");
                about = [about, note]
                    .into_iter()
                    .filter(|a| !a.is_empty())
                    .collect::<Vec<_>>()
                    .join("; ");
            }
            self.line(&code, about, line.starts_with(' '));
        }
        self.found
    }

    fn line(&mut self, code: &str, about: String, is_indented: bool) {
        if code.is_empty() {
            // An indented remark goes on with that of the key above.
            if let Some(last) = self.found.last_mut().filter(|_| is_indented) {
                last.about = format!("{} {about}", last.about).trim().to_owned();
            }
        } else if let Some(name) = code.strip_prefix("[[").and_then(|c| c.strip_suffix("]]")) {
            let number = self.number(name);
            self.section = (format!("{}.{number}", self.within(name)), name.to_owned());
            self.add(
                name.to_owned(),
                String::new(),
                [String::new(), String::new()],
                about,
            );
        } else if let Some(name) = code.strip_prefix('[').and_then(|c| c.strip_suffix(']')) {
            self.section = (self.within(name), name.to_owned());
            self.add(
                name.to_owned(),
                String::new(),
                [String::new(), String::new()],
                about,
            );
        } else if let Some((key, value)) = code.split_once(" = ") {
            let below = |section: &str| match section {
                "" => key.to_owned(),
                section => format!("{section}.{key}"),
            };
            let (numbered, path) = (below(&self.section.0), below(&self.section.1));
            let other = OTHERS.iter().find(|(name, _)| *name == self.section.1);
            let before = other.map_or(&[][..], |(_, changes)| changes);
            let before: Vec<String> = before.iter().map(|change| (*change).to_owned()).collect();
            let takes = takes(self.layout, &before, &numbered);
            let (about, bracket) = with_default(&about);
            let default = match bracket {
                Some(default) => default,
                None if is_needed(self.layout, &before, &numbered) => "needed".to_owned(),
                None => value.trim_matches('"').to_owned(),
            };
            self.add(path, code.to_owned(), [takes, default], about);
        }
    }

    /// The number of a further element of a list.
    fn number(&mut self, name: &str) -> usize {
        let path = self.within(name);
        let next = self.counts.entry(path).or_insert(0);
        *next += 1;
        *next - 1
    }

    /// A section by its name, within the present element of its list.
    fn within(&self, name: &str) -> String {
        let Some((parent, last)) = name.rsplit_once('.') else {
            return name.to_owned();
        };
        let element = self.counts.get(parent).map(|count| count - 1);
        let element = element.map_or_else(String::new, |element| format!(".{element}"));
        format!("{parent}{element}.{last}")
    }

    /// Adds a key, or a remark to one that is known.
    fn add(&mut self, path: String, example: String, [takes, default]: [String; 2], about: String) {
        match self.found.iter_mut().find(|key| key.path == path) {
            None => self.found.push(Explained {
                kind: self.kind,
                path,
                example,
                takes,
                default,
                about,
            }),
            Some(known) if known.about.is_empty() => known.about = about,
            Some(_) => {}
        }
    }
}

/// A line as its code and its remark. A commented key or section counts as code.
fn parted(line: &str) -> (String, String) {
    let is_code = |text: &str| {
        let key = match text.split(" = ").collect::<Vec<_>>()[..] {
            [key, value] if !value.ends_with('[') => key,
            _ => "",
        };
        text.starts_with('[')
            || !key.is_empty() && key.chars().all(|c| c.is_ascii_lowercase() || c == '_')
    };
    let line = match line.strip_prefix("# ") {
        Some(rest) if is_code(rest.trim()) => rest,
        _ => line,
    };
    let mut is_text = false;
    let at = line.char_indices().find(|(_, c)| {
        is_text ^= *c == '"';
        *c == '#' && !is_text
    });
    let (code, about) = at.map_or((line, ""), |(at, _)| line.split_at(at));
    let about = about.trim_start_matches('#').trim();
    (code.trim().to_owned(), about.to_owned())
}

/// A meaning without "optional", and the default in brackets at its end.
fn with_default(about: &str) -> (String, Option<String>) {
    let (text, default) = match about
        .strip_suffix(']')
        .and_then(|about| about.rsplit_once('['))
    {
        Some((text, default)) => (text.trim(), Some(default.to_owned())),
        None => (about, None),
    };
    let text = text
        .strip_prefix("optional")
        .map_or(text, |rest| rest.trim_start_matches([',', ':', ';', ' ']));
    (text.to_owned(), default)
}

/// Whether a layout without the key at a path is no scene.
fn is_needed(layout: &str, before: &[String], path: &str) -> bool {
    parsed(layout, before, &format!("{path}=off")).is_err()
}

/// What the reader takes at a path of the layout, after some changes.
fn takes(layout: &str, before: &[String], path: &str) -> String {
    let refused = |value: &str| problem(layout, before, path, value);
    let Some((code, expected)) = refused("true") else {
        return match refused("0.5") {
            Some((code, help)) if code == "E054" => help,
            _ => "a text".to_owned(),
        };
    };
    match code.as_str() {
        "E060" => return "a file".to_owned(),
        "E063" => return one_of(layout, &expected),
        _ => {}
    }
    // The example of a quantity has its unit.
    let example = [" such as ", " as in "]
        .iter()
        .find_map(|by| expected.split_once(by));
    let Some((named, example)) = example else {
        return expected;
    };
    if named == "a text" {
        return match refused("?") {
            Some((code, help)) if code == "E063" => one_of(layout, &help),
            _ => expected,
        };
    }
    let unit = example
        .trim_matches('"')
        .split_once(' ')
        .map_or("", |(_, unit)| unit);
    match refused(&format!("-1e30 {unit}")) {
        Some((code, range)) if code == "E051" => format!("{range}, such as {example}"),
        _ => format!("{named} such as {example}"),
    }
}

/// The names that a message lists; those of a scene are its own.
fn one_of(layout: &str, help: &str) -> String {
    let names = help.trim_start_matches("there are: ");
    let first = names.split(", ").next().unwrap_or_default();
    match layout.contains(&format!("name = \"{first}\"")) {
        true => "a name in the scene".to_owned(),
        false => format!("one of {names}"),
    }
}

/// The code and the advice of the error for a value at a path; `None` if the value is taken.
fn problem(layout: &str, before: &[String], path: &str, value: &str) -> Option<(String, String)> {
    let error = parsed(layout, before, &format!("{path}={value}")).err()?;
    let of_key = error.each().into_iter().find(|error| error.key() == path)?;
    let help = of_key.problem().help();
    let help = help
        .trim_start_matches("write ")
        .trim_start_matches("give ");
    Some((of_key.problem().code().to_owned(), help.to_owned()))
}

/// A layout as a scene after changes; a file that exists stands for each file that it names.
fn parsed(layout: &str, before: &[String], change: &str) -> Result<Content, SceneError> {
    let file = std::env::current_exe().unwrap_or_default();
    let mut text = layout.to_owned();
    for name in FILES {
        text = text.replace(name, &file.display().to_string());
    }
    let mut overrides = before.to_vec();
    overrides.push(change.to_owned());
    let surroundings = Surroundings {
        overrides: &overrides,
        ..Surroundings::of(Path::new("."))
    };
    parse_content(&text, "layout.toml", &surroundings)
}

/// A table of keys.
pub(super) fn table(keys: &[Explained]) -> Table {
    let mut table = Table::new("", ["key", "example", "takes", "default", "meaning"]);
    for key in keys {
        table.row(
            [
                &key.path,
                &key.example,
                &key.takes,
                &key.default,
                &key.about,
            ]
            .map(String::clone),
        );
    }
    table
}

/// All keys as a page.
pub(super) fn page() -> String {
    let mut page = String::from(PREFACE);
    let mut kind = "";
    for key in all() {
        if key.kind != kind {
            kind = key.kind;
            page += &format!(
                "\n## {kind}\n\n| key | example | takes | default | meaning |\n|---|---|---|---|---|\n"
            );
        }
        let code = |text: &str| match text {
            "" => String::new(),
            text => format!("`{}`", text.replace('|', "\\|")),
        };
        let plain = |text: &str| text.replace('|', "\\|");
        page += &format!(
            "| {} | {} | {} | {} | {} |\n",
            code(&key.path),
            code(&key.example),
            plain(&key.takes),
            plain(&key.default),
            plain(&key.about)
        );
    }
    page
}

const PREFACE: &str = "# Keys of a scene

`pliant scenes explain --page` writes this page. `pliant scenes explain KEY` shows a key, or a section with what is below it.

Quantities are texts with their unit, such as `\"0.5 mm\"`, and can have an interval: `\"2 mm +- 10 %\"`
([intervals.md](intervals.md)). Numbers without a dimension are plain. A file is relative to the
folder of the scene, or has an absolute path or one that begins with a variable. The column \"takes\" has units and range. A key that is
\"needed\" is there, or one that its meaning names in its place; any other has its default. `[[name]]` begins an element of a list; it has the keys `name.KEY`.
";

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene as text, without its file name.
    fn encoded(content: &Content) -> String {
        pliant::text_of("scene", content)
    }

    /// Keys whose default cannot be written: a limit that is named counts as named, and the others need another key.
    const OTHERWISE: [&str; 3] = ["limits.", "lattice.rest.method", "spring_body.neighbours"];

    /// A default that is the example of the layout is what the reader takes without the key.
    #[test]
    fn a_default_is_the_value_without_the_key() {
        let (mut wrong, mut seen) = (Vec::new(), 0);
        for (kind, layout) in LAYOUTS {
            for key in Reading::new(kind, layout).read() {
                let Some((_, value)) = key.example.split_once(" = ") else {
                    continue;
                };
                if OTHERWISE.iter().any(|other| key.path.starts_with(other)) {
                    continue;
                }
                if key.default != value.trim_matches('"') || key.default == "needed" {
                    continue;
                }
                let other = OTHERS
                    .iter()
                    .find(|(name, _)| key.path.starts_with(&format!("{name}.")));
                let before: Vec<String> = other
                    .map_or(&[][..], |(_, changes)| changes)
                    .iter()
                    .map(|c| (*c).to_owned())
                    .collect();
                // The first element of each list stands for all.
                let numbered = numbered(layout, &key.path);
                let [without, with] = ["off", value.trim_matches('"')]
                    .map(|v| parsed(layout, &before, &format!("{numbered}={v}")));
                seen += 1;
                match (without, with) {
                    (Ok(without), Ok(with)) if encoded(&without) == encoded(&with) => {}
                    (without, with) => wrong.push(format!(
                        "{kind}: {} = {} (without {}, with {})",
                        key.path,
                        value,
                        without.map_or_else(|e| e.terse(), |_| "read".to_owned()),
                        with.map_or_else(|e| e.terse(), |_| "read".to_owned())
                    )),
                }
            }
        }
        assert!(seen > 40, "only {seen} defaults seen");
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }

    /// A path with the number of the first element after each list.
    fn numbered(layout: &str, path: &str) -> String {
        let mut all = String::new();
        let mut so_far = String::new();
        for part in path.split('.') {
            if !so_far.is_empty() {
                so_far.push('.');
                all.push('.');
            }
            so_far.push_str(part);
            all.push_str(part);
            if layout.contains(&format!("[[{so_far}]]")) {
                all.push_str(".0");
            }
        }
        all
    }
}
