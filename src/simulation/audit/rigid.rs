//! The depth of two rigid surfaces in each other.
//!
//! No solver moves a bone: a motion of the scene that is wrong, as about an axis of the wrong sense,
//! drives one bone into another. Bones of a scan may lie in each other a little from the start, so
//! that what counts is by how much the depth grows.

use std::collections::BTreeMap;

use super::depths;
use super::frame::Kept;
use crate::mesh::inside::Inside;
use crate::mesh::measures::max_or_nan;

/// A rigid surface with its test for points inside, if it is closed.
pub(super) struct Rigid<'a> {
    pub name: &'a str,
    pub kept: &'a Kept,
    pub inside: Option<&'a Inside<'a>>,
}

/// The greatest depth [unit of positions] of a vertex of each of two surfaces in the other; zero for
/// surfaces that contain nothing.
fn deepest(one: &Rigid<'_>, other: &Rigid<'_>) -> f64 {
    let common = one.kept.bounds.intersection(&other.kept.bounds);
    let of = |points: &Rigid<'_>, of: &Rigid<'_>| match of.inside {
        Some(inside) => {
            let vertices = &points.kept.vertices;
            let near = |v: usize| common.contains(&vertices[v]);
            let found = depths(vertices, near, inside, |p| of.kept.depth(p));
            max_or_nan(found.into_iter().map(|(_, depth)| depth))
        }
        None => 0.0,
    };
    max_or_nan([of(one, other), of(other, one)])
}

/// What is known of each pair of rigid surfaces.
#[derive(Debug, Default)]
pub(super) struct Depths(BTreeMap<[String; 2], Depth>);

#[derive(Clone, Copy, Debug)]
struct Depth {
    /// In the first frame of both.
    first: f64,
    /// In the last frame.
    last: f64,
}

impl Depths {
    /// Takes the positions of a frame. Returns the greatest growth of a depth since the first frame,
    /// relative to the lesser extent of the two surfaces, and their names in order.
    pub(super) fn follow(&mut self, all: &[Rigid<'_>]) -> (f64, Option<[String; 2]>) {
        let (mut greatest, mut of) = (0.0, None);
        for (i, one) in all.iter().enumerate() {
            for other in &all[i + 1..] {
                let growth = self.growth(one, other);
                // NaN stays.
                if !(growth <= greatest) && !f64::is_nan(greatest) {
                    let mut names = [one.name, other.name].map(str::to_owned);
                    names.sort();
                    (greatest, of) = (growth, Some(names));
                }
            }
        }
        (greatest, of)
    }

    fn growth(&mut self, one: &Rigid<'_>, other: &Rigid<'_>) -> f64 {
        let mut names = [one.name, other.name].map(str::to_owned);
        names.sort();
        let known = self.0.get(&names).copied();
        let now = match known {
            Some(depth) if !one.kept.moved && !other.kept.moved => depth.last,
            _ => deepest(one, other),
        };
        let first = known.map_or(now, |depth| depth.first);
        self.0.insert(names, Depth { first, last: now });
        match now <= first {
            true => 0.0,
            false => (now - first) / one.kept.extent.min(other.kept.extent),
        }
    }
}
