//! Contact detection: edges that cross triangles, and points inside.

use std::sync::Arc;

use nalgebra::Vector3;

use super::body::CollidingBody;
use super::edges::{Edge, Found, crossings_of};
use crate::contact::Obstacle;
use crate::mesh::measures::max_or_nan;

/// A contact of a point of one body with a point of another, or of an obstacle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    /// The body with the edge or the vertex.
    pub first: usize,
    /// Ends of the edge; a vertex has two equal ends.
    pub ends: [u32; 2],
    pub end_weights: [f64; 2],
    /// The body with the triangle; `None` for a fixed obstacle.
    pub second: Option<usize>,
    pub corners: [u32; 3],
    pub corner_weights: [f64; 3],
    /// Unit vector from the first body to the second.
    pub normal: Vector3<f64>,
    /// Depth of a vertex inside [m]; 0 for a crossing.
    pub depth: f64,
}

/// All contacts, in an order that depends on the bodies and their positions alone; refits the
/// surfaces of bodies whose boxes meet.
pub(super) fn find(bodies: &mut [CollidingBody], obstacles: &[Arc<dyn Obstacle>]) -> Vec<Contact> {
    let mut near = Vec::new();
    for i in 0..bodies.len() {
        for j in i + 1..bodies.len() {
            let both_driven = bodies[i].drive().is_some() && bodies[j].drive().is_some();
            if !both_driven && bodies[i].bounds().intersects(&bodies[j].bounds()) {
                near.push([i, j]);
            }
        }
    }
    let mut near_bodies: Vec<usize> = near.iter().flatten().copied().collect();
    near_bodies.sort_unstable();
    near_bodies.dedup();
    near_bodies.iter().for_each(|&i| bodies[i].refit());
    let bodies = &*bodies;
    let mut contacts = Vec::new();
    for [i, j] in near {
        for pair in bodies[i].surface().pairs(bodies[j].surface()) {
            crossings_of(pair, bodies[i].sheet(), bodies[j].sheet(), |found| {
                let (first, second) = if found.which == Edge::OfFirst {
                    (i, j)
                } else {
                    (j, i)
                };
                contacts.extend(crossed(bodies, first, second, &found));
            });
        }
        vertices(bodies, i, j, &mut contacts);
        vertices(bodies, j, i, &mut contacts);
    }
    for (first, body) in bodies
        .iter()
        .enumerate()
        .filter(|(_, b)| b.drive().is_none())
    {
        obstacles
            .iter()
            .for_each(|o| against(first, body, &**o, &mut contacts));
    }
    contacts
}

/// The normal is that of the triangle or of the edge, whichever gives the shorter exit. Otherwise a
/// floor edge that passes through the side of a resting body, by the depth of a contact, would stop
/// it from sliding.
fn crossed(
    bodies: &[CollidingBody],
    first: usize,
    second: usize,
    found: &Found,
) -> Option<Contact> {
    let (one, two) = (
        &bodies[first].system.position,
        &bodies[second].system.position,
    );
    let corners = bodies[second].triangles()[found.triangle as usize];
    let [p, q] = found.edge.map(|v| one[v as usize]);
    let corner = corners.map(|v| two[v as usize]);
    let outward = bodies[second].normal(found.triangle)?;
    let [above, below] = [p, q].map(|end| outward.dot(&(end - corner[0])));
    // A sheet has no outside: the edge comes from the side with its longer part.
    let turned = bodies[second].inside().is_none() && above + below < 0.0;
    let (mut normal, depth) = if turned {
        (outward, above.max(below))
    } else {
        (-outward, -above.min(below))
    };
    if let Some(out_of_edge) = bodies[first].normal_of_side(found.side) {
        let deepest = max_or_nan(
            corner
                .iter()
                .map(|c| -out_of_edge.dot(&(c - p)))
                .filter(|d| !(*d <= 0.0)),
        );
        if deepest < depth {
            normal = out_of_edge;
        }
    }
    Some(Contact {
        first,
        ends: found.edge,
        end_weights: found.at.edge,
        second: Some(second),
        corners,
        corner_weights: found.at.triangle,
        normal,
        depth: 0.0,
    })
}

/// Vertices of one body inside another. A flat side inside another body has crossing edges only at
/// its boundary, and its interior would sink deeper.
fn vertices(bodies: &[CollidingBody], first: usize, second: usize, contacts: &mut Vec<Contact>) {
    let Some(surface) = bodies[second].inside() else {
        return;
    };
    let bounds = bodies[second].bounds();
    for &v in bodies[first].points() {
        let p = &bodies[first].system.position[v as usize];
        if !bounds.contains(p) {
            continue;
        }
        if let Some(on) = surface
            .nearest(p, f64::MAX)
            .filter(|on| on.closest.distance < 0.0)
        {
            contacts.push(Contact {
                first,
                ends: [v; 2],
                end_weights: [1.0, 0.0],
                second: Some(second),
                corners: bodies[second].triangles()[on.triangle as usize],
                corner_weights: on.weights,
                normal: -on.closest.normal,
                depth: -on.closest.distance,
            });
        }
    }
}

fn against(
    first: usize,
    body: &CollidingBody,
    obstacle: &dyn Obstacle,
    contacts: &mut Vec<Contact>,
) {
    let bounds = obstacle.bounding_box();
    if !body.bounds().intersects(&bounds) {
        return;
    }
    for &v in body.points() {
        let p = &body.system.position[v as usize];
        if !bounds.contains(p) {
            continue;
        }
        if let Some(closest) = obstacle.closest(p).filter(|c| c.distance < 0.0) {
            contacts.push(Contact {
                first,
                ends: [v; 2],
                end_weights: [1.0, 0.0],
                second: None,
                corners: [0; 3],
                corner_weights: [1.0, 0.0, 0.0],
                normal: -closest.normal,
                depth: -closest.distance,
            });
        }
    }
}
