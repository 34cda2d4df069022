//! Origin of a scene's text, so that errors found in its meshes can name the line.

use std::fmt;
use std::sync::Arc;

use super::error::{SceneError, SceneProblem};
use super::tree::{Node, Sources, Span, Value};

/// The texts of a scene; none for a scene from code.
#[derive(Clone, Default)]
pub struct SceneOrigin(Option<Arc<Written>>);

struct Written {
    document: Node,
    sources: Sources,
}

impl SceneOrigin {
    pub(super) fn new(document: Node, sources: Sources) -> Self {
        Self(Some(Arc::new(Written { document, sources })))
    }

    /// An error at a key such as `muscle.0.mesh`, or at its last part that the text contains.
    #[must_use]
    pub fn error(&self, problem: SceneProblem, key: &str) -> SceneError {
        match self.0.as_deref() {
            Some(Written { document, sources }) => {
                SceneError::new(problem, key, &span_of(document, key), sources)
            }
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
