//! Where a scene was read from, kept so that what is only found in its meshes can still name its line.

use std::fmt;
use std::sync::Arc;

use super::error::{Problem, SceneError};
use super::tree::{Node, Sources, Span, Value};

/// The texts that a scene was read from; none for a scene made by code.
#[derive(Clone, Default)]
pub struct Origin(Option<Arc<Written>>);

struct Written {
    document: Node,
    sources: Sources,
}

impl Origin {
    pub(super) fn new(document: Node, sources: Sources) -> Self {
        Self(Some(Arc::new(Written { document, sources })))
    }

    /// An error at a key such as `muscle.0.mesh`, or at the last part of it that was written.
    #[must_use]
    pub fn error(&self, problem: Problem, key: &str) -> SceneError {
        match self.0.as_deref() {
            Some(Written { document, sources }) => {
                SceneError::new(problem, key, &span_of(document, key), sources)
            }
            None => SceneError::nowhere(problem, key),
        }
    }
}

/// The place of a value, or of the last that encloses it.
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

/// Two scenes are alike whatever text says so.
impl PartialEq for Origin {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl fmt::Debug for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() {
            "Origin(text)"
        } else {
            "Origin(code)"
        })
    }
}
