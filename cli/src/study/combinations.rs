//! The scenes of a study: every combination of its values, and their reference runs.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

use rayon::prelude::*;

use super::key::{Contents, key_of, name_of};
use pliant::format::number;
use pliant::scene::{
    Combine, Content, Effects, Material, Measure, OF_MUSCLES, Scene, SceneError, Solver,
    StudyChange, StudyFile,
};
use pliant::simulation::{Assets, LoadError, Plan, Scenario, Simulation, scenario};

/// Purpose of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A row of the study.
    Combination,
    /// A reference only.
    Reference,
}

impl Role {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Combination => "combination",
            Self::Reference => "reference",
        }
    }
}

/// The subject of a run.
#[derive(Clone, Debug)]
pub enum Subject {
    /// Muscles.
    Muscles {
        /// The scene.
        scene: Box<Scene>,
        /// Meshes, shared with other combinations if they are equal.
        assets: Arc<Assets>,
    },
    /// A scene of another kind, and the time that its plan expects it to take [s].
    Other(Content, f64),
}

impl Subject {
    /// Makes the scene ready to run.
    ///
    /// # Errors
    /// What keeps it from running.
    pub fn scenario(&self) -> Result<Box<dyn Scenario>, LoadError> {
        match self {
            Self::Muscles { scene, assets } => Ok(Box::new(muscles(scene, assets)?)),
            Self::Other(content, _) => scenario(content),
        }
    }
}

/// Muscles with their meshes at hand, ready to run.
///
/// # Errors
/// What keeps them from running.
pub fn muscles(scene: &Scene, assets: &Assets) -> Result<Simulation, LoadError> {
    let plan = Plan::new(scene, assets);
    Simulation::with(scene.clone(), assets.clone(), plan)
}

/// One scene of a study.
#[derive(Clone, Debug)]
pub struct Combination {
    /// Purpose of the run.
    pub role: Role,
    /// Label that distinguishes it from the others.
    pub label: String,
    /// The value of each varied key; `None` for the value of the scene with its fixed changes.
    pub values: Vec<Option<String>>,
    /// Changes besides the fixed ones.
    pub changes: Vec<StudyChange>,
    /// The subject of the run.
    pub subject: Subject,
    /// All inputs of its result, as text.
    pub key: String,
    /// Index of its reference run.
    pub reference: Option<usize>,
    /// Its row in the list of all choices of values; `None` for a reference.
    pub row: Option<usize>,
}

impl Combination {
    /// Name of the result: a hash of all inputs, and of the library.
    pub fn name(&self) -> String {
        name_of(&self.key)
    }

    /// The file of the result in the study's folder.
    pub fn file(&self) -> String {
        format!("runs/{}.json", self.name())
    }

    /// Time as estimated by the plan [s].
    pub fn expected_s(&self) -> f64 {
        match &self.subject {
            Subject::Muscles { scene, assets } => seconds(&Plan::new(scene, assets), scene.frames),
            Subject::Other(_, expected) => *expected,
        }
    }

    /// Number of frames of the scene.
    pub fn frames(&self) -> usize {
        match &self.subject {
            Subject::Muscles { scene, .. } => scene.frames,
            Subject::Other(content, _) => content.frames(),
        }
    }

    /// The measures of its runs.
    pub fn measures(&self) -> &'static [Measure] {
        match &self.subject {
            Subject::Muscles { .. } => OF_MUSCLES,
            Subject::Other(content, _) => content.measures(),
        }
    }
}

/// Greatest number of combinations of which each is created before any run.
const ALL_CHECKED: usize = 200;

/// Estimated time of `frames` frames of a plan [s].
fn seconds(plan: &Plan, frames: usize) -> f64 {
    plan.run.iter().map(|p| p.ms_per_frame).sum::<f64>() * 1e-3 * frames as f64
}

/// All scenes of a study, checked.
#[derive(Clone, Debug)]
pub struct Combinations {
    /// Name of the study.
    pub name: String,
    /// Name of the scene.
    pub scene: String,
    /// Rule of the combination.
    pub combine: Combine,
    /// The varied keys, with their names in labels.
    pub varied: Vec<(String, String)>,
    /// Compared frames, sorted.
    pub frames: Vec<usize>,
    /// Displayed measures; `None` for all.
    pub measures: Option<Vec<String>>,
    /// Combinations in the order of the file, then references.
    pub all: Vec<Combination>,
    /// Notes for the reader.
    pub notes: Vec<String>,
}

/// A choice of values: one of each varied key, or none.
type Choice<'a> = Vec<Option<&'a StudyChange>>;

impl Combinations {
    /// Creates all scenes of a study: each is parsed, and its meshes are read. [`Self::check`] does
    /// the rest.
    ///
    /// # Errors
    /// The first combination that cannot run, at its value in the study file.
    pub fn of(file: &StudyFile) -> Result<Self, SceneError> {
        Self::of_rows(file, None)
    }

    /// Number of combinations of a study, without references.
    pub fn count(file: &StudyFile) -> usize {
        choices(file).len()
    }

    /// The same as [`Self::of`] for some rows only, each with its reference. Other scenes are not
    /// read, except where the study names no frames: those follow from all scenes.
    ///
    /// # Errors
    /// See [`Self::of`].
    pub fn of_rows(file: &StudyFile, rows: Option<&[usize]>) -> Result<Self, SceneError> {
        let mut choices = choices(file);
        let short = short_names(file);
        let read = |all: &[Choice<'_>]| -> Result<Vec<Content>, SceneError> {
            all.par_iter().map(|c| file.scene_with(&given(c))).collect()
        };
        let mut frames = file.frames.clone();
        if let Some(rows) = rows {
            if frames.is_none() {
                frames = Some(looked_at(&read(&choices)?));
            }
            choices = rows
                .iter()
                .filter_map(|&row| choices.get(row).cloned())
                .collect();
        }
        let scenes = read(&choices)?;
        let scene_name = scenes.first().map(|s| s.name().to_owned());
        let mut meshes = Meshes::default();
        let mut contents = Contents::default();
        let frames = frames.unwrap_or_else(|| looked_at(&scenes));
        let mut made = Making {
            file,
            frames: &frames,
            meshes: &mut meshes,
            contents: &mut contents,
        };
        let mut all: Vec<Combination> = Vec::new();
        let mut notes = Vec::new();
        let mut same: HashMap<String, usize> = HashMap::new();
        for (place, (choice, scene)) in choices.iter().zip(scenes).enumerate() {
            let mut found = made.make(
                Role::Combination,
                label(&short, choice),
                choice,
                &given(choice),
                scene,
            )?;
            found.row = Some(rows.map_or(place, |rows| rows[place]));
            // A single value that the scene already has gives the scene itself.
            if file.combine == Combine::OneAtATime
                && rows.is_none()
                && let Some(base) = all.first_mut().filter(|base| base.key == found.key)
            {
                base.values
                    .iter_mut()
                    .zip(&found.values)
                    .for_each(|(to, from)| *to = to.take().or_else(|| from.clone()));
                continue;
            }
            match same.entry(found.key.clone()) {
                Entry::Occupied(first) => {
                    let first: &Combination = &all[*first.get()];
                    notes.push(format!(
                        "`{}` is the same scene as `{}`",
                        found.label, first.label
                    ));
                }
                Entry::Vacant(new) => {
                    new.insert(all.len());
                }
            }
            all.push(found);
        }
        if rows.is_none() {
            name_base(&mut all, &short, file.combine);
        }
        if !file.reference.is_empty() {
            let chosen = choices.iter().map(|c| given(c)).collect::<Vec<_>>();
            let merged = file.combine == Combine::OneAtATime && rows.is_none();
            made.references(&mut all, &chosen, merged)?;
        }
        check_measures(file, &all)?;
        let varied = file.vary.iter().map(|v| v.key.clone()).zip(short).collect();
        let scene = scene_name.unwrap_or_default();
        let (name, combine) = (file.name.clone(), file.combine);
        Ok(Self {
            name,
            scene,
            combine,
            varied,
            frames,
            measures: file.measures.clone(),
            all,
            notes,
        })
    }

    /// Creates the muscles of some combinations once, so that errors of attachments and of factors
    /// appear before any run.
    ///
    /// # Errors
    /// The first combination that cannot run, at its value in the study file.
    pub fn check(&self, file: &StudyFile, selected: &[usize]) -> Result<(), SceneError> {
        selected.par_iter().try_for_each(|&k| {
            let c = &self.all[k];
            // A scene without muscles was prepared for its plan.
            let Subject::Muscles { scene, assets } = &c.subject else {
                return Ok(());
            };
            match muscles(scene, assets) {
                Ok(_) => Ok(()),
                Err(error) => {
                    Err(file.refused(&c.changes.iter().collect::<Vec<_>>(), &error.terse()))
                }
            }
        })
    }

    /// Combinations that have each value of each varied key at least once: all of a small study, and
    /// of a large one those that differ from the first in one value, and the references of these.
    pub fn covering(&self) -> Vec<usize> {
        let all = 0..self.all.len();
        if self.all.len() <= ALL_CHECKED {
            return all.collect();
        }
        let first = &self.all[0].values;
        let differs = |c: &Combination| c.values.iter().zip(first).filter(|(a, b)| a != b).count();
        let rows =
            all.filter(|&k| self.all[k].role == Role::Combination && differs(&self.all[k]) <= 1);
        let rows: Vec<usize> = rows.collect();
        let references = rows.iter().filter_map(|&k| self.all[k].reference);
        let mut both: Vec<usize> = rows.iter().copied().chain(references).collect();
        both.sort_unstable();
        both.dedup();
        both
    }

    /// The rows of the study, without references.
    pub fn rows(&self) -> impl Iterator<Item = &Combination> {
        self.all.iter().filter(|c| c.role == Role::Combination)
    }
}

/// The default compared frames: start, middle and end.
fn looked_at(scenes: &[Content]) -> Vec<usize> {
    let last = scenes.iter().map(Content::frames).min().unwrap_or(0);
    let mut frames = vec![0, last / 2, last];
    frames.dedup();
    frames
}

fn given<'a>(choice: &Choice<'a>) -> Vec<&'a StudyChange> {
    choice.iter().copied().flatten().collect()
}

/// Every combination, the last key varying fastest; or the scene itself and each value separately.
fn choices(file: &StudyFile) -> Vec<Choice<'_>> {
    let none = vec![None; file.vary.len()];
    match file.combine {
        Combine::OneAtATime => {
            let alone = |(k, value)| {
                let mut choice = none.clone();
                choice[k] = Some(value);
                choice
            };
            let each = file
                .vary
                .iter()
                .enumerate()
                .flat_map(|(k, v)| v.values.iter().map(move |value| (k, value)));
            std::iter::once(none.clone())
                .chain(each.map(alone))
                .collect()
        }
        Combine::All => {
            let mut all: Vec<Choice<'_>> = vec![Vec::new()];
            for varied in &file.vary {
                let mut longer = Vec::with_capacity(all.len() * varied.values.len());
                for choice in &all {
                    longer.extend(varied.values.iter().map(|v| {
                        choice
                            .iter()
                            .copied()
                            .chain([Some(v)])
                            .collect::<Choice<'_>>()
                    }));
                }
                all = longer;
            }
            all
        }
    }
}

/// The last part of each key, or the whole key if two end alike.
fn short_names(file: &StudyFile) -> Vec<String> {
    let last = |key: &str| key.rsplit('.').next().unwrap_or(key).to_owned();
    let ends: Vec<String> = file.vary.iter().map(|v| last(&v.key)).collect();
    let unique = |end: &String| ends.iter().filter(|e| *e == end).count() == 1;
    file.vary
        .iter()
        .zip(&ends)
        .map(|(v, end)| {
            if unique(end) {
                end.clone()
            } else {
                v.key.clone()
            }
        })
        .collect()
}

fn label(short: &[String], choice: &Choice<'_>) -> String {
    let pairs = short
        .iter()
        .zip(choice)
        .filter_map(|(name, value)| Some(format!("{name} = {}", value.as_ref()?.value)));
    pairs.collect::<Vec<_>>().join(", ")
}

/// Labels the scene itself, with its values of the varied keys.
fn name_base(all: &mut [Combination], short: &[String], combine: Combine) {
    let Some(base) = all.first_mut().filter(|_| combine == Combine::OneAtATime) else {
        return;
    };
    let pairs = short
        .iter()
        .zip(&base.values)
        .filter_map(|(name, v)| Some(format!("{name} = {}", v.as_ref()?)));
    let pairs: Vec<String> = pairs.collect();
    base.label = if pairs.is_empty() {
        "base".to_owned()
    } else {
        format!("base ({})", pairs.join(", "))
    };
}

struct Making<'a> {
    file: &'a StudyFile,
    frames: &'a [usize],
    meshes: &'a mut Meshes,
    contents: &'a mut Contents,
}

impl Making<'_> {
    fn make(
        &mut self,
        role: Role,
        label: String,
        choice: &Choice<'_>,
        changes: &[&StudyChange],
        scene: Content,
    ) -> Result<Combination, SceneError> {
        let refused = |error: LoadError| self.file.refused(changes, &error.terse());
        let key = key_of(&scene, self.frames, self.contents);
        let key = key.map_err(|error| self.file.refused(changes, &error.to_string()));
        let frames = scene.frames();
        let subject = match scene {
            Content::Muscles(scene) => {
                let assets = self.meshes.of(&scene).map_err(refused)?;
                Subject::Muscles { scene, assets }
            }
            other => {
                let expected = seconds(scenario(&other).map_err(refused)?.plan(), frames);
                Subject::Other(other, expected)
            }
        };
        let key = key?;
        let values = choice.iter().map(|c| c.map(|c| c.value.clone())).collect();
        let changes = changes.iter().map(|&c| c.clone()).collect();
        Ok(Combination {
            role,
            label,
            values,
            changes,
            subject,
            key,
            reference: None,
            row: None,
        })
    }

    /// The reference run of each combination: itself with the changes of `[reference]`.
    fn references(
        &mut self,
        all: &mut Vec<Combination>,
        chosen: &[Vec<&StudyChange>],
        merged: bool,
    ) -> Result<(), SceneError> {
        let none = vec![None; self.file.vary.len()];
        let mut known: HashMap<String, usize> = HashMap::new();
        // Rows that were merged with the first have the same reference.
        let rows: Vec<(usize, &Vec<&StudyChange>)> = match merged {
            false => chosen.iter().enumerate().collect(),
            true => {
                let text = |c: &StudyChange| (c.key.clone(), c.value.clone());
                let of = |row: &Combination| {
                    let set = self
                        .file
                        .vary
                        .iter()
                        .zip(&row.values)
                        .filter_map(|(v, x)| Some((v.key.clone(), x.clone()?)));
                    let set: Vec<_> = set.collect();
                    chosen
                        .iter()
                        .find(|c| c.iter().map(|c| text(c)).eq(set.iter().cloned()))
                };
                let rest = all
                    .iter()
                    .enumerate()
                    .skip(1)
                    .filter_map(|(k, row)| Some((k, of(row)?)));
                chosen
                    .first()
                    .map(|c| (0, c))
                    .into_iter()
                    .chain(rest)
                    .collect()
            }
        };
        for (k, changes) in rows {
            let changes: Vec<&StudyChange> = changes
                .iter()
                .copied()
                .chain(&self.file.reference)
                .collect();
            let scene = self.file.scene_with(&changes)?;
            let made = self.make(
                Role::Reference,
                format!("reference of {}", all[k].label),
                &none,
                &changes,
                scene,
            )?;
            let at = match known.get(&made.key) {
                Some(&at) => at,
                None => {
                    known.insert(made.key.clone(), all.len());
                    all.push(made);
                    all.len() - 1
                }
            };
            all[k].reference = Some(at);
        }
        Ok(())
    }
}

/// Meshes read so far, with the parts of the scene that determine them.
#[derive(Default)]
struct Meshes(Vec<(Scene, Arc<Assets>)>);

impl Meshes {
    fn of(&mut self, scene: &Scene) -> Result<Arc<Assets>, pliant::simulation::LoadError> {
        let shape = shape_of(scene);
        if let Some((_, assets)) = self.0.iter().find(|(known, _)| *known == shape) {
            return Ok(assets.clone());
        }
        let assets = Arc::new(Assets::load(scene)?);
        self.0.push((shape, assets.clone()));
        Ok(assets)
    }
}

/// A scene without the parts that do not affect its meshes.
fn shape_of(scene: &Scene) -> Scene {
    let mut shape = scene.clone();
    let volume = scene
        .effects
        .volume
        .map(|_| pliant::scene::Volume { pressure: 1.0 });
    shape.effects = Effects {
        volume,
        ..Effects::default()
    };
    (shape.frames, shape.frame_rate, shape.accuracy) = (0, 0.0, None);
    shape.mesh_error = false;
    shape.solver = Solver::default();
    shape
        .bones
        .iter_mut()
        .for_each(|bone| bone.motion = Default::default());
    for muscle in &mut shape.muscles {
        muscle.material = Material::default();
    }
    shape
}

/// Rejects a measure that the scene does not have.
fn check_measures(file: &StudyFile, all: &[Combination]) -> Result<(), SceneError> {
    let (Some(requested), Some(first)) = (&file.measures, all.first()) else {
        return Ok(());
    };
    let known: Vec<&str> = first.measures().iter().map(|(name, ..)| *name).collect();
    match requested
        .iter()
        .find(|name| !known.contains(&name.as_str()))
    {
        None => Ok(()),
        Some(name) => Err(file.refused(
            &[],
            &format!(
                "it has no measure `{name}`; there are: {}",
                known.join(", ")
            ),
        )),
    }
}

/// A time as text.
pub fn in_words(seconds: f64) -> String {
    match seconds {
        s if s < 0.1 => "less than 0.1 s".to_owned(),
        s if s < 120.0 => format!("{} s", number((s * 10.0).round() / 10.0)),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_told_in_the_unit_that_suits_them() {
        for (seconds, told) in [
            (0.01, "less than 0.1 s"),
            (1.26, "1.3 s"),
            (119.0, "119 s"),
            (7190.0, "120 min"),
            (7210.0, "2.0 h"),
            (13_000.0, "3.6 h"),
        ] {
            assert_eq!(in_words(seconds), told);
        }
    }
}
