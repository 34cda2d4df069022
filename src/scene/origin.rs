//! Origin of a scene's text, so that errors found in its meshes can name the line.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use super::error::{SceneError, SceneProblem};
use super::tree::{Node, Sources, Span, Value};
use super::{Content, Surroundings, Uncertain, Variables, parse};
use crate::mesh::TriangleMesh;

/// The texts of a scene; none for a scene from code.
#[derive(Clone, Default)]
pub struct SceneOrigin(Option<Arc<Written>>);

struct Written {
    document: Node,
    sources: Sources,
    name: String,
    folder: PathBuf,
    meshes: BTreeMap<String, Arc<TriangleMesh>>,
    uncertain: Vec<Uncertain>,
}

impl SceneOrigin {
    pub(super) fn new(
        document: Node,
        sources: Sources,
        name: &str,
        around: &Surroundings<'_>,
        uncertain: Vec<Uncertain>,
    ) -> Self {
        Self(Some(Arc::new(Written {
            document,
            sources,
            name: name.to_owned(),
            folder: around.folder.to_owned(),
            meshes: around.meshes.clone(),
            uncertain,
        })))
    }

    /// The values with an interval.
    pub fn uncertain(&self) -> &[Uncertain] {
        self.0.as_ref().map_or(&[], |written| &written.uncertain)
    }

    /// The scene of the texts with values in place of some with an interval, by their keys and in SI
    /// units; `None` for a scene from code.
    pub fn with_values(
        &self,
        values: &[(&str, f64)],
        variables: Variables,
    ) -> Option<Result<Content, SceneError>> {
        let written = self.0.as_ref()?;
        let around = Surroundings {
            variable: &variables,
            meshes: &written.meshes,
            ..Surroundings::of(&written.folder)
        };
        let (document, sources) = (written.document.clone(), written.sources.clone());
        Some(parse::read(
            document,
            sources,
            &written.name,
            &around,
            values,
        ))
    }

    /// An error at a key such as `muscle.0.mesh`, or at its last part that the text contains.
    #[must_use]
    pub fn error(&self, problem: SceneProblem, key: &str) -> SceneError {
        match self.0.as_deref() {
            Some(Written {
                document, sources, ..
            }) => SceneError::new(problem, key, &span_of(document, key), sources),
            None => SceneError::nowhere(problem, key),
        }
    }
}

/// The place of a value, or of the innermost one that contains it.
fn span_of(document: &Node, key: &str) -> Span {
    let mut node = document;
    for part in key.split('.') {
        let next = match &node.value {
            Value::Table(table) => table.get(part).map(|entry| &entry.node),
            Value::List(list) => part.parse::<usize>().ok().and_then(|at| list.get(at)),
            _ => None,
        };
        match next {
            Some(next) => node = next,
            None => break,
        }
    }
    node.span.clone()
}

/// Two scenes are equal for any texts.
impl PartialEq for SceneOrigin {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl fmt::Debug for SceneOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() {
            "Origin(text)"
        } else {
            "Origin(code)"
        })
    }
}
