//! A scene with the changes that were made to it while it ran.

use std::path::PathBuf;

use crate::biceps::{Biceps, is_biceps};
use crate::lattice::Lattice;
use crate::muscles::Muscles;
use crate::skin::Skin;
use crate::subject::Subject;
use pliant::format::number;
use pliant::geometric::file::FileError;
use pliant::scene::builtin::{self, Written};
use pliant::scene::units::UnitError;
use pliant::scene::{
    Area, Content, Scene, SceneError, Source, Surroundings, Variables, no_variables, parse_content,
    parse_with,
};
use pliant::simulation::{Assets, LoadError, Simulation};

/// Why a scene cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The scene is wrong.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// Its meshes are.
    #[error("{0}")]
    Load(#[from] LoadError),
    /// The file of a geometric muscle is.
    #[error("{name}: {why}")]
    Muscle {
        /// The file.
        name: String,
        /// What is wrong with it or with a change.
        why: Box<Refused>,
    },
    /// The system gives no thread.
    #[error(
        "the simulation cannot have a thread of its own: {0}; end other programs and try again"
    )]
    Thread(#[from] std::io::Error),
}

/// Why a change was not made; the simulation is as it was.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// The scene would be wrong.
    #[error("{}", .0.terse())]
    Scene(SceneError),
    /// Its meshes do not do for it.
    #[error("{}", .0.terse())]
    Load(LoadError),
    /// The geometric muscle would be wrong.
    #[error("{0}")]
    Geometric(FileError),
    /// No quantity of the wanted kind.
    #[error("{0}; {help}", help = .0.help())]
    Unit(UnitError),
    /// A value of another kind.
    #[error("`{path}` cannot be `{value}`; give {wanted}")]
    Value {
        /// The path of the change.
        path: String,
        /// The value.
        value: String,
        /// What is wanted.
        wanted: &'static str,
    },
    /// A number that is finite, but out of what can be.
    #[error(
        "{what} cannot be {} {unit}; it can be from {} to {} {unit}",
        number(*value), number(*low), number(*high)
    )]
    Outside {
        /// What it is.
        what: String,
        /// The number.
        value: f64,
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
        /// The unit of all three.
        unit: &'static str,
    },
    /// A path that leads nowhere.
    #[error("there is no `{path}` to be changed; there are {known}")]
    NoPath {
        /// The path.
        path: String,
        /// Those that there are.
        known: &'static str,
    },
    /// It asks for other meshes.
    #[error(
        "`{path}` changes {what}, which is made before the start; start again with another `{path}`"
    )]
    Meshes {
        /// The path of the change.
        path: String,
        /// What it changes.
        what: &'static str,
    },
    /// Something that is not there.
    #[error("there is no {what} {index}; the scene has {count}, counted from 0")]
    Nothing {
        /// What was asked for.
        what: &'static str,
        /// Its number.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A vertex that cannot be fixed or dragged.
    #[error("vertex {vertex} is held by a bone; choose one that is free")]
    Held {
        /// The vertex.
        vertex: usize,
    },
    /// A bone without a joint.
    #[error("bone `{bone}` has no joint to turn about; give its motion a centre and an axis")]
    NoJoint {
        /// Its name.
        bone: String,
    },
    /// A number that is none, or not positive where it must be.
    #[error("{what} cannot be {value}; give a finite{} number", if *.positive { ", positive" } else { "" })]
    Number {
        /// What it is.
        what: &'static str,
        /// The number.
        value: f64,
        /// Whether it must be positive.
        positive: bool,
    },
    /// It has no such thing.
    #[error("{0}")]
    NotHere(&'static str),
    /// A frame of a finished run cannot be read.
    #[error("frame {frame} cannot be shown: {why}")]
    Damaged {
        /// Its number.
        frame: usize,
        /// What is wrong with its file, and what to do about it.
        why: String,
    },
    /// It cannot go on.
    #[error("{0}; reset it first")]
    Failed(String),
    /// The making of it panicked.
    #[error("with this change it cannot be made: {0}")]
    Panicked(String),
}

/// A scene as written and the changes to it, in their order.
#[derive(Clone, Debug)]
pub struct Recipe {
    text: String,
    name: String,
    folder: PathBuf,
    variables: Variables,
    given: Vec<String>,
    changes: Vec<(String, String)>,
}

impl Recipe {
    /// A scene by its name or path, as [`builtin::load`] takes it, with overrides from the command line. A file is read once.
    ///
    /// # Errors
    /// No such scene or file.
    pub fn find(name_or_path: &str, overrides: &[String]) -> Result<Self, SceneError> {
        let Written { text, name, folder } = builtin::find(name_or_path)?;
        Ok(Self {
            text,
            name,
            folder,
            variables: no_variables,
            given: overrides.to_vec(),
            changes: Vec::new(),
        })
    }

    /// The same with variables that paths of the scene may begin with.
    #[must_use]
    pub fn with_variables(self, variables: Variables) -> Self {
        Self { variables, ..self }
    }

    /// The scene with all changes.
    ///
    /// # Errors
    /// Whatever is wrong with it.
    pub fn scene(&self) -> Result<Scene, SceneError> {
        let mut overrides = self.given.clone();
        overrides.extend(self.changes());
        let surroundings = Surroundings {
            folder: &self.folder,
            variable: &self.variables,
            overrides: &overrides,
        };
        parse_with(&self.text, &self.name, &surroundings)
    }

    /// What the scene is of, ready to run.
    ///
    /// # Errors
    /// Whatever is wrong with the scene or its meshes.
    pub fn subject(self) -> Result<Box<dyn Subject>, StartError> {
        if is_biceps(&self.text) {
            return Ok(Box::new(Biceps::new(self)?));
        }
        Ok(match self.content()? {
            Content::Muscles(scene) => {
                Box::new(Muscles::new(self, *scene, Simulation::step_frame)?)
            }
            Content::Skin(scene) => Box::new(Skin::new(self, *scene)?),
            Content::Lattice(scene) => Box::new(Lattice::new(self, *scene)?),
        })
    }

    /// What was written.
    pub(super) fn text(&self) -> &str {
        &self.text
    }

    /// What it is called.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Path and value of each override from the command line.
    pub(super) fn given(&self) -> impl Iterator<Item = (&str, &str)> {
        self.given
            .iter()
            .map(|given| given.split_once('=').unwrap_or((given, "")))
    }

    /// Path and value of each change so far.
    pub(super) fn changed(&self) -> impl Iterator<Item = (&str, &str)> {
        self.changes
            .iter()
            .map(|(path, value)| (path.as_str(), value.as_str()))
    }

    /// The scene with all changes, of any kind.
    pub(super) fn content(&self) -> Result<Content, SceneError> {
        let mut overrides = self.given.clone();
        overrides.extend(self.changes());
        let surroundings = Surroundings {
            folder: &self.folder,
            variable: &self.variables,
            overrides: &overrides,
        };
        parse_content(&self.text, &self.name, &surroundings)
    }

    /// The changes so far, each as `--set` takes it.
    pub fn changes(&self) -> Vec<String> {
        self.changes
            .iter()
            .map(|(path, value)| format!("{path}={value}"))
            .collect()
    }

    /// The same with a value at a path, in place of an earlier one there. Another solver begins with its own settings.
    #[must_use]
    pub fn with(&self, path: &str, value: &str) -> Self {
        let mut changed = self.without(path);
        changed.changes.push((path.to_owned(), value.to_owned()));
        changed
    }

    /// The same with the value at a path as the scene was started with.
    #[must_use]
    pub fn without(&self, path: &str) -> Self {
        let below = format!("{path}.");
        // Settings of a solver that is not in use any more would call for that solver.
        let goes = |known: &str| known == path || path == "solver" && known.starts_with(&below);
        let mut changed = self.clone();
        changed.changes.retain(|(known, _)| !goes(known));
        changed
    }

    /// The scene after a change of the value at `path`, which must do with the meshes of the scene `before`.
    pub(super) fn checked(
        &self,
        path: &str,
        before: &Scene,
        assets: &Assets,
    ) -> Result<Scene, Refused> {
        let scene = self.scene().map_err(Refused::Scene)?;
        if let Some(what) = other_meshes(before, &scene) {
            return Err(Refused::Meshes {
                path: path.to_owned(),
                what,
            });
        }
        assets.suit(&scene).map_err(Refused::Load)?;
        Ok(scene)
    }
}

/// What of the meshes differs between two scenes.
fn other_meshes(a: &Scene, b: &Scene) -> Option<&'static str> {
    let patches = |scene: &Scene| -> Vec<Option<(Source, Option<usize>)>> {
        let areas = scene
            .muscles
            .iter()
            .flat_map(|m| m.attachments.iter().map(|a| &a.area));
        let patch = |area: &Area| match area {
            Area::Patch {
                source, component, ..
            } => Some((source.clone(), *component)),
            Area::Near(_) | Area::Vertices(_) => None,
        };
        areas.map(patch).collect()
    };
    let bones = |scene: &Scene| -> Vec<_> {
        scene
            .bones
            .iter()
            .map(|b| (b.name.clone(), b.surface.clone(), b.repair))
            .collect()
    };
    let muscles = |scene: &Scene| -> Vec<_> {
        let of = |m: &pliant::scene::Muscle| {
            (
                m.name.clone(),
                m.surface.clone(),
                m.repair,
                m.attachments.len(),
            )
        };
        scene.muscles.iter().map(of).collect()
    };
    let fibres =
        |scene: &Scene| -> Vec<_> { scene.muscles.iter().map(|m| m.fibres.clone()).collect() };
    let lengths =
        |scene: &Scene| -> Vec<_> { scene.muscles.iter().map(|m| m.edge_length).collect() };
    let differences = [
        (bones(a) != bones(b), "the bones"),
        (
            a.capsules.len() != b.capsules.len(),
            "the number of capsules",
        ),
        (muscles(a) != muscles(b), "the muscles"),
        (lengths(a) != lengths(b), "the mesh of a muscle"),
        (fibres(a) != fibres(b), "the fibres"),
        (patches(a) != patches(b), "the areas of attachment"),
    ];
    differences
        .into_iter()
        .find_map(|(differs, what)| differs.then_some(what))
}

/// An index that counts something there is.
pub(super) fn check_index(what: &'static str, index: usize, count: usize) -> Result<(), Refused> {
    if index < count {
        Ok(())
    } else {
        Err(Refused::Nothing { what, index, count })
    }
}

/// A number that is finite, and positive where it must be.
pub(super) fn check_number(what: &'static str, value: f64, positive: bool) -> Result<(), Refused> {
    let does = value.is_finite() && (value > 0.0 || !positive);
    if does {
        Ok(())
    } else {
        Err(Refused::Number {
            what,
            value,
            positive,
        })
    }
}

/// What a panic says.
pub(super) fn words(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or(panic.downcast_ref::<&str>().copied());
    text.unwrap_or("it gave no reason").to_owned()
}
