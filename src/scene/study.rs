//! The file of a parameter study: a scene, fixed changes, lists of values, compared frames.
//!
//! Keys of `[set]`, `[vary]` and `[reference]` are those of [`overrides`](super::overrides), in
//! quotes or as dotted keys. A value is the text after the `=` of `--set`: numbers, lists and
//! tables as in TOML, anything else as a text: `"off"`, `"1 mm"`, `"pbd"`.

mod combine;

use std::path::{Path, PathBuf};

use super::Content;
use super::builtin::{self, Written};
use super::error::{SceneError, SceneProblem};
use super::interval::Intervals;
use super::parse::{Surroundings, checked_name, name_fault, parse_content, unknown_name};
use super::paths::Variables;
use super::reader::{Context, Item, Section};
use super::schema::{Kind, Schema};
use super::tree::{self, Node, Sources, Span, Table, Value};
use crate::spelling::{shown, shown_path};

pub use combine::Combine;

/// Greatest number of combinations of a study, without references.
pub const MOST_COMBINATIONS: usize = 10_000;

/// Greatest number of compared frames of a study.
pub const MOST_FRAMES: usize = 24;

const STUDY: Schema = Schema::Listed(&[
    ("name", Kind::Text),
    ("scene", Kind::Text),
    ("frames", Kind::Plain),
    ("measures", Kind::Plain),
    ("combine", Kind::Text),
    ("subjects", Kind::Text),
    ("set", Kind::Table(&ANY)),
    ("vary", Kind::Table(&ANY)),
    ("reference", Kind::Table(&ANY)),
]);

/// The varied key of subjects, and in capital letters the variable at the start of a path.
const SUBJECT: &str = "subject";

/// Not checked here: the scene decides which keys exist.
const ANY: Schema = Schema::Listed(&[]);

/// One change of the scene, `KEY=VALUE` as after `--set`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StudyChange {
    /// The key.
    pub key: String,
    /// The value, in one line.
    pub value: String,
    span: Span,
}

impl StudyChange {
    fn text(&self) -> String {
        format!("{}={}", self.key, self.value)
    }
}

/// A key with its list of values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Varied {
    /// The key.
    pub key: String,
    /// At least one value, without duplicates.
    pub values: Vec<StudyChange>,
}

/// A study file, checked as far as possible without the scene's meshes.
#[derive(Clone, Debug)]
pub struct StudyFile {
    /// The key `name`, or the file's name without its extension.
    pub name: String,
    /// The scene as named in the file.
    pub scene: String,
    /// Compared frames, sorted; `None` if the file does not define them.
    pub frames: Option<Vec<usize>>,
    /// Measures to display, in the file's order; `None` for all.
    pub measures: Option<Vec<String>>,
    /// Rule to combine the lists.
    pub combine: Combine,
    /// Changes of every combination.
    pub set: Vec<StudyChange>,
    /// Varied keys, at least one.
    pub vary: Vec<Varied>,
    /// Changes of each combination that give its reference run; empty for no comparison.
    pub reference: Vec<StudyChange>,
    /// The folder with a folder for each subject.
    subjects: Option<PathBuf>,
    /// Changes from the command line, applied after those of `set`.
    more: Vec<String>,
    /// What paths of the scene may begin with.
    variables: Variables,
    written: Written,
    sources: Sources,
    at: Places,
}

/// Places of values in the file.
#[derive(Clone, Debug)]
struct Places {
    scene: Span,
    frames: Span,
    vary: Span,
}

type Read<T> = Result<T, SceneError>;

impl StudyFile {
    /// Reads a study file and its scene's text, and checks the scene with the fixed changes. `more`
    /// are changes from the command line; `measures` are the valid names of the key `measures`.
    ///
    /// # Errors
    /// The first error with its place.
    pub fn read(
        path: &str,
        more: &[String],
        measures: &[&str],
        variables: Variables,
    ) -> Read<Self> {
        let file = Path::new(path);
        let text = builtin::read(file).map_err(|reason| {
            let hint = "name a study file";
            SceneError::of_name(
                SceneProblem::MissingFile {
                    path: shown_path(file),
                    reason,
                    hint,
                },
                path,
            )
        })?;
        let folder = file
            .parent()
            .filter(|f| !f.as_os_str().is_empty())
            .unwrap_or(Path::new("."));
        Self::parse(&text, path, folder, more, measures, variables)
    }

    /// The same as [`Self::read`] from a text; `folder` is the start of the scene's path.
    ///
    /// # Errors
    /// The first error with its place.
    pub fn parse(
        text: &str,
        path: &str,
        folder: &Path,
        more: &[String],
        measures: &[&str],
        variables: Variables,
    ) -> Read<Self> {
        let sources = Sources::new(path, text);
        let document = tree::document(&sources)?;
        let context = Context {
            sources: &sources,
            surroundings: &Surroundings::of(folder),
            intervals: &Intervals::default(),
        };
        let root = Item {
            context,
            node: &document,
            key: String::new(),
        }
        .section(&STUDY)?;
        let stem = Path::new(path)
            .file_stem()
            .and_then(|s| s.to_str())
            .unwrap_or_default();
        let name = match root.get("name") {
            Some(item) => checked_name(&item)?,
            None if name_fault(stem).is_none() => stem.to_owned(),
            None => return root.fail(SceneProblem::missing("name", "`name = \"...\"`")),
        };
        let scene = root.need("scene", "\"press\"` or `scene = \"scene.toml\"")?;
        let frames = root.get("frames").map(|item| frames(&item)).transpose()?;
        let combine = root
            .get("combine")
            .map_or(Ok(Combine::All), |item| combine(&item))?;
        let set = changes(&root, "set")?;
        let subjects = root.get("subjects").map(|item| subjects(&item, folder));
        let (subjects, first) = match subjects.transpose()? {
            Some((path, varied)) => (Some(path), Some(varied)),
            None => (None, None),
        };
        let mut vary: Vec<Varied> = first.into_iter().collect();
        // A population needs no other varied key.
        if vary.is_empty() || root.get("vary").is_some() {
            let item = root.need("vary", "{ \"KEY\" = [VALUE, VALUE] }` or a section `[vary]")?;
            vary.extend(varied(&item, combine, &set)?);
        }
        let counted = root.get("vary").or_else(|| root.get("subjects"));
        if let Some(item) = &counted {
            count(item, combine, &vary)?;
        }
        let span_of = |key: &str| root.get(key).map_or(0..0, |item| item.node.span.clone());
        let study = Self {
            name,
            scene: scene.text("press")?.to_owned(),
            frames,
            measures: root
                .get("measures")
                .map(|item| known(&item, measures))
                .transpose()?,
            combine,
            set,
            reference: changes(&root, "reference")?,
            subjects,
            more: more.to_vec(),
            variables,
            written: find(&scene, folder)?,
            at: Places {
                scene: span_of("scene"),
                frames: span_of("frames"),
                vary: span_of("vary"),
            },
            vary,
            sources: sources.clone(),
        };
        study.check_more()?;
        study.base()?;
        Ok(study)
    }

    /// The scene with the fixed changes alone.
    fn base(&self) -> Read<Content> {
        let scene = self.parsed(&[]).map_err(|error| self.placed(error, &[]))?;
        if scene.accuracy().is_some() {
            let message =
                "the scene asks for an accuracy, but a study compares settings as they are"
                    .to_owned();
            let hint = "leave it out, with `accuracy = \"off\"` below [set]".to_owned();
            return Err(self.error(
                SceneProblem::Override { message, hint },
                "accuracy",
                &self.at.scene,
            ));
        }
        match self
            .frames
            .as_ref()
            .and_then(|f| f.last())
            .filter(|&&f| f > scene.frames() && !self.varies("frames"))
        {
            Some(&frame) => Err(self.beyond(frame, scene.frames())),
            None => Ok(scene),
        }
    }

    fn varies(&self, key: &str) -> bool {
        self.vary.iter().any(|v| v.key == key)
    }

    /// The scene with the fixed changes and these further changes, in order.
    ///
    /// # Errors
    /// The errors of the scene, with the place of the value in the study file.
    pub fn scene_with(&self, changes: &[&StudyChange]) -> Read<Content> {
        let scene = self
            .parsed(changes)
            .map_err(|error| self.placed(error, changes))?;
        match self.frames.as_ref().and_then(|f| f.last()) {
            Some(&frame) if frame > scene.frames() => Err(self.beyond(frame, scene.frames())),
            _ => Ok(scene),
        }
    }

    fn parsed(&self, changes: &[&StudyChange]) -> Read<Content> {
        let mut overrides: Vec<String> = self.set.iter().map(StudyChange::text).collect();
        overrides.extend(self.more.iter().cloned());
        let is_subject = |c: &&StudyChange| self.subjects.is_some() && c.key == SUBJECT;
        overrides.extend(changes.iter().filter(|c| !is_subject(c)).map(|c| c.text()));
        // Without a choice, the first subject stands for all.
        let chosen = changes.iter().copied().find(is_subject);
        let chosen = chosen.or_else(|| self.vary.first()?.values.first());
        let subject = self.subjects.as_ref().zip(chosen);
        let subject = subject.map(|(folder, change)| folder.join(&change.value).into_os_string());
        let variable = |name: &str| match &subject {
            Some(path) if name.eq_ignore_ascii_case(SUBJECT) => Some(path.clone()),
            _ => (self.variables)(name),
        };
        let Written { text, name, folder } = &self.written;
        let surroundings = Surroundings {
            variable: &variable,
            overrides: &overrides,
            ..Surroundings::of(folder)
        };
        parse_content(text, name, &surroundings)
    }

    /// An error of a scene, moved to the value of this file that causes it, if known.
    fn placed(&self, error: SceneError, changes: &[&StudyChange]) -> SceneError {
        // Errors of the scene's own text that only appear with these changes name the changes.
        if error.place().is_some() && !changes.is_empty() {
            return self.refused(changes, &error.terse());
        }
        let mut all = self.set.iter().chain(changes.iter().copied());
        match all.find(|c| error.place().is_none() && c.text() == error.source_text()) {
            Some(change) => self.error(error.problem().clone(), error.key(), &change.span),
            None => error,
        }
    }

    /// The error of a combination that the scene or its meshes reject, at the first of its values.
    pub fn refused(&self, changes: &[&StudyChange], why: &str) -> SceneError {
        let span = changes.first().map_or(&self.at.vary, |c| &c.span);
        let all: Vec<String> = changes
            .iter()
            .map(|c| format!("{} = {}", c.key, shown(&c.value)))
            .collect();
        let with = if all.is_empty() {
            "as it is".to_owned()
        } else {
            format!("with {}", all.join(", "))
        };
        let message = format!("the scene cannot be run {with}: {why}");
        let hint = "change one of these values, or the scene".to_owned();
        self.error(SceneProblem::Override { message, hint }, "vary", span)
    }

    fn beyond(&self, frame: usize, last: usize) -> SceneError {
        let problem = SceneProblem::OutOfRange {
            found: format!("frame {frame}"),
            allowed: format!("frames from 0 to {last}, the last of the scene"),
        };
        self.error(problem, "frames", &self.at.frames)
    }

    fn error(&self, problem: SceneProblem, key: &str, span: &Span) -> SceneError {
        SceneError::new(problem, key, span, &self.sources)
    }

    /// Rejects a change from the command line if every run has its own value.
    fn check_more(&self) -> Read<()> {
        for text in self.more.iter().filter(|_| self.combine == Combine::All) {
            let key = text.split('=').next().unwrap_or_default().trim();
            if let Some(varied) = self.vary.iter().find(|v| v.key == key) {
                let span = varied.values.first().map_or(&self.at.vary, |c| &c.span);
                return Err(self.error(
                    SceneProblem::DuplicateKey { key: shown(key) },
                    "the changes and `vary`",
                    span,
                ));
            }
        }
        Ok(())
    }
}

/// The folder of subjects, and the varied key with their names: those of the folders in it.
fn subjects(item: &Item<'_>, folder: &Path) -> Read<(PathBuf, Varied)> {
    let text = item.text("subjects")?;
    let path = std::path::absolute(folder.join(text)).unwrap_or_else(|_| folder.join(text));
    let unreadable = |e: std::io::Error| {
        item.error(SceneProblem::MissingFile {
            path: shown_path(&path),
            reason: Some(e.to_string()),
            hint: "name a folder that has a folder for each subject; it is relative to that of the study",
        })
    };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&path).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        // A hidden folder is none of a subject.
        if entry.path().is_dir() && !name.starts_with('.') {
            names.push(name);
        }
    }
    names.sort();
    if names.is_empty() {
        return item.fail(SceneProblem::EmptyList {
            expected: format!("a folder for each subject in {}", shown_path(&path)),
        });
    }
    let value = |name: String| StudyChange {
        key: SUBJECT.to_owned(),
        value: name,
        span: item.node.span.clone(),
    };
    let varied = Varied {
        key: SUBJECT.to_owned(),
        values: names.into_iter().map(value).collect(),
    };
    Ok((path, varied))
}

/// The text of the scene: a file beside the study, otherwise a built-in scene.
fn find(item: &Item<'_>, folder: &Path) -> Read<Written> {
    let name = item.text("press")?;
    let beside = folder.join(name);
    let ends_in_toml = beside
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let path = if beside.is_file() || ends_in_toml {
        beside.to_string_lossy().into_owned()
    } else {
        name.to_owned()
    };
    builtin::find(&path).map_err(|error| item.error(error.problem().clone()))
}

fn frames(item: &Item<'_>) -> Read<Vec<usize>> {
    let items = item.list("a list of frames such as [1, 50, 100]")?;
    if items.is_empty() {
        return item.fail(SceneProblem::EmptyList {
            expected: "at least one frame".to_owned(),
        });
    }
    if items.len() > MOST_FRAMES {
        return item.fail(SceneProblem::OutOfRange {
            found: format!("a list of {} frames", items.len()),
            allowed: format!("at most {MOST_FRAMES}: each is a column of the sheet"),
        });
    }
    let mut frames = Vec::new();
    for item in items {
        let frame = item.whole(0, 10_000_000)? as usize;
        if frames.contains(&frame) {
            return item.fail(SceneProblem::out_of_range(
                &frame.to_string(),
                "each frame once",
            ));
        }
        frames.push(frame);
    }
    frames.sort_unstable();
    Ok(frames)
}

fn known(item: &Item<'_>, measures: &[&str]) -> Read<Vec<String>> {
    let mut chosen = Vec::new();
    for item in item.list("a list of measures such as [\"time_s\"]")? {
        let name = item.text("time_s")?;
        if !measures.contains(&name) {
            return item.fail(unknown_name("measure", name, measures.iter().copied()));
        }
        if chosen.iter().any(|c| c == name) {
            return item.fail(SceneProblem::DuplicateName {
                name: name.to_owned(),
            });
        }
        chosen.push(name.to_owned());
    }
    Ok(chosen)
}

fn combine(item: &Item<'_>) -> Read<Combine> {
    let name = item.text(Combine::All.name())?;
    let found = Combine::ALL.into_iter().find(|c| c.name() == name);
    found.map_or_else(
        || {
            item.fail(unknown_name(
                "way to combine",
                name,
                Combine::ALL.iter().map(|c| c.name()),
            ))
        },
        Ok,
    )
}

/// The changes of a section with possibly dotted keys.
fn changes(root: &Section<'_>, key: &str) -> Read<Vec<StudyChange>> {
    let Some(item) = root.get(key) else {
        return Ok(Vec::new());
    };
    let leaf = |node: &Node| !matches!(&node.value, Value::Table(t) if !t.entries.is_empty());
    let mut all: Vec<StudyChange> = Vec::new();
    for (key, span, node) in leaves(&item, &leaf)? {
        let item = Item {
            key: format!("{}.{key}", item.key),
            node,
            ..item.clone()
        };
        if all.iter().any(|c| c.key == key) {
            return Err(SceneError::new(
                SceneProblem::DuplicateKey { key: shown(&key) },
                &item.key,
                &span,
                item.context.sources,
            ));
        }
        all.push(change(key, &item)?);
    }
    Ok(all)
}

fn varied(item: &Item<'_>, combine: Combine, set: &[StudyChange]) -> Read<Vec<Varied>> {
    let leaf = |node: &Node| !matches!(node.value, Value::Table(_));
    let mut all: Vec<Varied> = Vec::new();
    for (key, span, node) in leaves(item, &leaf)? {
        let list = Item {
            key: format!("{}.{key}", item.key),
            node,
            ..item.clone()
        };
        // With one change at a time, the fixed value is that of all other runs.
        let fixed = combine == Combine::All && set.iter().any(|c| c.key == key);
        if fixed || all.iter().any(|v| v.key == key) {
            let problem = SceneProblem::DuplicateKey { key: shown(&key) };
            return Err(SceneError::new(
                problem,
                &list.key,
                &span,
                item.context.sources,
            ));
        }
        let items = list.list("a list of values such as [1, 3, 10]")?;
        if items.is_empty() {
            return list.fail(SceneProblem::EmptyList {
                expected: "at least one value".to_owned(),
            });
        }
        let mut values: Vec<StudyChange> = Vec::new();
        for value in items {
            let change = change(key.clone(), &value)?;
            if values.iter().any(|v| v.value == change.value) {
                return value.fail(SceneProblem::out_of_range(&change.value, "each value once"));
            }
            values.push(change);
        }
        all.push(Varied { key, values });
    }
    if all.is_empty() {
        return item.fail(SceneProblem::missing(
            "vary",
            "a key with its values: `\"KEY\" = [VALUE, VALUE]`",
        ));
    }
    Ok(all)
}

/// Rejects too many combinations; the count cannot overflow.
fn count(item: &Item<'_>, combine: Combine, vary: &[Varied]) -> Read<()> {
    let lengths = vary.iter().map(|v| v.values.len());
    let found = match combine {
        Combine::All => lengths.fold(1, usize::saturating_mul),
        Combine::OneAtATime => lengths.fold(1, usize::saturating_add),
    };
    if found <= MOST_COMBINATIONS {
        return Ok(());
    }
    let found = if found == usize::MAX {
        "more combinations than can be counted".to_owned()
    } else {
        format!("{found} combinations")
    };
    let allowed = format!(
        "lists with at most {MOST_COMBINATIONS} combinations, or `combine = \"one at a time\"`"
    );
    item.fail(SceneProblem::OutOfRange { found, allowed })
}

/// A key, its place, and the value at it.
type Leaf<'a> = (String, Span, &'a Node);

/// The values of a section with their complete keys.
fn leaves<'a>(item: &Item<'a>, is_leaf: &dyn Fn(&Node) -> bool) -> Read<Vec<Leaf<'a>>> {
    let Value::Table(table) = &item.node.value else {
        return item.fail(SceneProblem::WrongType {
            expected: format!("a section [{}]", item.key),
            found: item.node.value.kind().to_owned(),
        });
    };
    let mut found = Vec::new();
    gather(table, "", is_leaf, &mut found);
    Ok(found)
}

/// The reader bounds the depth.
fn gather<'a>(
    table: &'a Table,
    above: &str,
    is_leaf: &dyn Fn(&Node) -> bool,
    found: &mut Vec<Leaf<'a>>,
) {
    for entry in &table.entries {
        let key = if above.is_empty() {
            entry.key.clone()
        } else {
            format!("{above}.{}", entry.key)
        };
        match &entry.node.value {
            Value::Table(below) if !is_leaf(&entry.node) => gather(below, &key, is_leaf, found),
            _ => found.push((key, entry.span.clone(), &entry.node)),
        }
    }
}

fn change(key: String, item: &Item<'_>) -> Read<StudyChange> {
    let value = match &item.node.value {
        Value::Text(text) => text.trim().to_owned(),
        other => match toml_of(other) {
            Some(text) => text,
            None => {
                let expected = "a number, a text, true or false, a list, or a table".to_owned();
                return item.fail(SceneProblem::WrongType {
                    expected,
                    found: "a date or time".to_owned(),
                });
            }
        },
    };
    if value.is_empty() || value.chars().any(char::is_control) {
        return item.fail(SceneProblem::out_of_range(
            &value,
            "a text of one line that is not empty",
        ));
    }
    Ok(StudyChange {
        key,
        value,
        span: item.node.span.clone(),
    })
}

/// A key as TOML, quoted where it must be.
fn toml_key(key: &str) -> Option<String> {
    let is_bare = key
        .chars()
        .all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if is_bare && !key.is_empty() {
        Some(key.to_owned())
    } else {
        serde_json::to_string(key).ok()
    }
}

/// A value as TOML in one line; `None` if it contains a date.
fn toml_of(value: &Value) -> Option<String> {
    Some(match value {
        // The escapes of JSON are valid in TOML.
        Value::Text(text) => serde_json::to_string(text).ok()?,
        Value::Integer(number) => number.to_string(),
        // The shortest text that reads back to the same bits.
        Value::Float(number) => format!("{number:?}").replace("NaN", "nan"),
        Value::Boolean(flag) => flag.to_string(),
        Value::Date => return None,
        Value::List(list) => {
            let all: Option<Vec<String>> = list.iter().map(|node| toml_of(&node.value)).collect();
            format!("[{}]", all?.join(", "))
        }
        Value::Table(table) => {
            let pair = |e: &tree::Entry| {
                Some(format!(
                    "{} = {}",
                    toml_key(&e.key)?,
                    toml_of(&e.node.value)?
                ))
            };
            let all: Option<Vec<String>> = table.entries.iter().map(pair).collect();
            format!("{{{}}}", all?.join(", "))
        }
    })
}

#[cfg(test)]
mod tests;
