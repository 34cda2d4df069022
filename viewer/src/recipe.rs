//! A scene with the changes made during the session.

use std::path::PathBuf;

use crate::biceps::Biceps;
use crate::lattice::Lattice;
use crate::muscles::Muscles;
use crate::running::{Plain, Running};
use crate::skin::Skin;
use crate::subject::Subject;
use pliant::format::number;
use pliant::scene::builtin::{self, Written};
use pliant::scene::{
    AreaSpec, Content, Muscle, Scene, SceneError, Source, Surroundings, Variables, no_variables,
    parse_content, parse_with,
};
use pliant::simulation::{Assets, LoadError, Simulation};

/// The reason why a scene cannot be displayed.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The scene is invalid.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// The meshes of the scene cannot be used.
    #[error("{0}")]
    Load(#[from] LoadError),
    /// The system could not start a thread.
    #[error(
        "the simulation cannot have a thread of its own: {0}; end other programs and try again"
    )]
    Thread(#[from] std::io::Error),
}

/// The reason why a change was rejected; the simulation is unchanged.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// The scene would be invalid.
    #[error("{}", .0.terse())]
    Scene(SceneError),
    /// The meshes are not suitable for the changed scene.
    #[error("{}", .0.terse())]
    Load(LoadError),
    /// The value has another kind.
    #[error("`{path}` cannot be `{value}`; give {expected}")]
    Value {
        /// Path of the change.
        path: String,
        /// The value.
        value: String,
        /// The required kind.
        expected: &'static str,
    },
    /// A finite number is out of its range.
    #[error(
        "{what} cannot be {} {unit}; it can be from {} to {} {unit}",
        number(*value), number(*low), number(*high)
    )]
    Outside {
        /// Name of the quantity.
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
    /// The change requires other meshes.
    #[error(
        "`{path}` changes {what}, which is made before the start; start again with another `{path}`"
    )]
    Meshes {
        /// Path of the change.
        path: String,
        /// The changed part.
        what: &'static str,
    },
    /// The object does not exist.
    #[error("there is no {what} {index}; the scene has {count}, counted from 0")]
    Nothing {
        /// Kind of the object.
        what: &'static str,
        /// Index of the object.
        index: usize,
        /// Number of objects.
        count: usize,
    },
    /// The vertex cannot be fixed or dragged.
    #[error("vertex {vertex} is held by a bone; choose one that is free")]
    Held {
        /// The vertex.
        vertex: usize,
    },
    /// The bone has no joint.
    #[error("bone `{bone}` has no joint to turn about; give its motion a centre and an axis")]
    NoJoint {
        /// Name of the bone.
        bone: String,
    },
    /// A number is not finite, or not positive where it must be.
    #[error("{what} cannot be {value}; give a finite{} number", if *.positive { ", positive" } else { "" })]
    Number {
        /// Name of the number.
        what: &'static str,
        /// The number.
        value: f64,
        /// True if the number must be positive.
        positive: bool,
    },
    /// The subject does not support this.
    #[error("{0}")]
    NotHere(&'static str),
    /// A frame of a finished run cannot be read.
    #[error("frame {frame} cannot be shown: {why}")]
    Damaged {
        /// Index of the frame.
        frame: usize,
        /// The error in the file, with advice.
        why: String,
    },
    /// The simulation cannot continue.
    #[error("{0}; reset it first")]
    Failed(String),
    /// The preparation panicked.
    #[error("with this change it cannot be made: {0}")]
    Panicked(String),
}

/// A scene as written, with its changes in order.
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
    /// Finds a scene by its name or path, as [`builtin::load`] does, with overrides from the
    /// command line. A file is read once.
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
    /// Any error of the scene.
    pub fn scene(&self) -> Result<Scene, SceneError> {
        let mut overrides = self.given.clone();
        overrides.extend(self.changes());
        let surroundings = Surroundings {
            variable: &self.variables,
            overrides: &overrides,
            ..Surroundings::of(&self.folder)
        };
        parse_with(&self.text, &self.name, &surroundings)
    }

    /// The subject of the scene, ready to run.
    ///
    /// # Errors
    /// Any error of the scene or its meshes.
    pub fn subject(self) -> Result<Box<dyn Subject>, StartError> {
        Ok(match self.content()? {
            Content::Muscles(scene) => {
                Box::new(Muscles::new(self, *scene, Simulation::step_frame)?)
            }
            Content::Skin(scene) => Box::new(Skin::new(self, *scene)?),
            other => match other.kind() {
                "lattice" => Running::<Lattice>::start(self, &other)?,
                "geometric" => Running::<Biceps>::start(self, &other)?,
                _ => Running::<Plain>::start(self, &other)?,
            },
        })
    }

    /// The scene with all changes, of any kind.
    pub(super) fn content(&self) -> Result<Content, SceneError> {
        let mut overrides = self.given.clone();
        overrides.extend(self.changes());
        let surroundings = Surroundings {
            variable: &self.variables,
            overrides: &overrides,
            ..Surroundings::of(&self.folder)
        };
        parse_content(&self.text, &self.name, &surroundings)
    }

    /// The changes so far, each in the form of `--set`.
    pub fn changes(&self) -> Vec<String> {
        self.changes
            .iter()
            .map(|(path, value)| format!("{path}={value}"))
            .collect()
    }

    /// The recipe with a value at a path; replaces an earlier one. Another solver starts with its
    /// default settings.
    #[must_use]
    pub fn with(&self, path: &str, value: &str) -> Self {
        let mut changed = self.without(path);
        changed.changes.push((path.to_owned(), value.to_owned()));
        changed
    }

    /// The recipe with the start value at a path.
    #[must_use]
    pub fn without(&self, path: &str) -> Self {
        let below = format!("{path}.");
        // Settings of an unused solver would select that solver.
        let goes = |known: &str| known == path || path == "solver" && known.starts_with(&below);
        let mut changed = self.clone();
        changed.changes.retain(|(known, _)| !goes(known));
        changed
    }

    /// The scene after a change of the value at `path`; it must suit the meshes of the scene
    /// `before`.
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

/// The difference between the meshes of two scenes, if any.
fn other_meshes(a: &Scene, b: &Scene) -> Option<&'static str> {
    let differences = [
        (
            differ(&a.bones, &b.bones, |bone| {
                let surface = (bone.surface.clone(), bone.repair);
                (bone.name.clone(), surface, bone.edge_length)
            }),
            "the bones",
        ),
        (
            a.capsules.len() != b.capsules.len(),
            "the number of capsules",
        ),
        (
            differ(&a.muscles, &b.muscles, |m| {
                let surface = (m.surface.clone(), m.repair);
                (m.name.clone(), surface, m.attachments.len())
            }),
            "the muscles",
        ),
        (
            differ(&a.muscles, &b.muscles, |m| m.edge_length),
            "the mesh of a muscle",
        ),
        (
            differ(&a.muscles, &b.muscles, |m| m.fibres.clone()),
            "the fibres",
        ),
        (
            differ(&a.muscles, &b.muscles, patches),
            "the areas of attachment",
        ),
    ];
    differences
        .into_iter()
        .find_map(|(differs, what)| differs.then_some(what))
}

/// True if a property of two lists of parts differs.
fn differ<T, P: PartialEq>(a: &[T], b: &[T], property: impl Fn(&T) -> P) -> bool {
    a.iter().map(&property).ne(b.iter().map(&property))
}

/// File and component of each attachment of a muscle; `None` for an area without a file.
fn patches(muscle: &Muscle) -> Vec<Option<(Source, Option<usize>)>> {
    let areas = muscle.attachments.iter().map(|a| &a.area);
    areas
        .map(|area| match area {
            AreaSpec::Patch {
                source, component, ..
            } => Some((source.clone(), *component)),
            AreaSpec::Near(_) | AreaSpec::Vertices(_) => None,
        })
        .collect()
}

/// Checks an index.
pub(super) fn check_index(what: &'static str, index: usize, count: usize) -> Result<(), Refused> {
    if index < count {
        Ok(())
    } else {
        Err(Refused::Nothing { what, index, count })
    }
}

/// Checks that a number is finite, and positive where it must be.
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

/// The message of a panic.
pub(super) fn words(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or(panic.downcast_ref::<&str>().copied());
    text.unwrap_or("it gave no reason").to_owned()
}
