//! A minimum without a neighbour keeps its vertices out of bones by itself, in half the time that pairs
//! of triangles take. Each frame is examined. From the first one in which its surface crosses a
//! bone or itself, pairs of triangles keep it apart.

use nalgebra::Point3;

use super::body::{Body, Stepper};
use super::{Audit, AuditedSurface, Simulation};
use crate::contact::PosedObstacle;

/// A minimum without a neighbour, with what is known of its last frame.
pub(super) struct Lone {
    body: usize,
    audit: Audit,
    /// Number of pairs of triangles that crossed in the last frame.
    crossings: usize,
}

impl Simulation {
    /// Prepares the examination of the next frame.
    pub(super) fn watch_lone(&mut self) {
        let lone: Vec<usize> = self.lone().collect();
        let known = self.lone.iter().map(|lone| lone.body);
        if known.eq(lone.iter().copied()) {
            return;
        }
        let watched = lone.into_iter().map(|body| {
            let mut lone = Lone {
                body,
                audit: Audit::new(),
                crossings: 0,
            };
            lone.crossings = self.count_crossings(&mut lone.audit, body);
            lone
        });
        self.lone = watched.collect();
    }

    /// The bodies that crossed in this frame what they did not cross in the one before.
    pub(super) fn crossed_alone(&mut self) -> Vec<usize> {
        let mut all = std::mem::take(&mut self.lone);
        let mut crossed = Vec::new();
        for lone in &mut all {
            let now = self.count_crossings(&mut lone.audit, lone.body);
            if now > lone.crossings {
                crossed.push(lone.body);
            } else {
                lone.crossings = now;
            }
        }
        self.lone = all;
        crossed
    }

    /// Goes back to the saved start of the frame; from here on pairs keep these bodies apart.
    pub(super) fn keep_apart(&mut self, crossed: &[usize], start: Option<&[u8]>) {
        let frame = self.frame;
        self.undo(start);
        for &b in crossed {
            let body = &mut self.bodies[b];
            body.in_pairs = true;
            self.notes.push(format!(
                "{}: its minimum crosses a bone or itself in frame {frame}; from there on pairs of triangles \
                 keep it apart, which takes longer",
                body.name
            ));
        }
        self.gather();
        self.watch_lone();
    }

    /// Minima that no pairs keep apart from anything.
    fn lone(&self) -> impl Iterator<Item = usize> {
        let contact = self.scene.effects.contact;
        let is_kept = contact.is_some_and(|c| c.between.bones || c.between.itself);
        let groups = self.groups.iter().filter(|group| !group.has_meeting());
        let members = groups.flat_map(|group| group.members.iter().copied());
        let mut lone: Vec<usize> = members
            .filter(|&b| is_kept && is_lone(&self.bodies[b]))
            .collect();
        lone.sort_unstable();
        lone.into_iter()
    }

    fn count_crossings(&self, audit: &mut Audit, body: usize) -> usize {
        let Some(contact) = self.scene.effects.contact else {
            return 0;
        };
        let body = &self.bodies[body];
        let placed = |placed: &PosedObstacle, mesh: &crate::mesh::TriangleMesh| {
            let moved = mesh.vertices.iter().map(|x| placed.now * x);
            moved.collect::<Vec<Point3<f64>>>()
        };
        let bones = self.placed.iter().zip(&self.bones);
        let bones = bones.map(|(at, mesh)| (&at.name, placed(at, mesh), &mesh.triangles));
        let bones: Vec<_> = bones.filter(|_| contact.between.bones).collect();
        let mut surfaces = vec![AuditedSurface {
            name: "",
            rigid: false,
            vertices: &body.system.particles.position,
            triangles: &body.rest.triangles,
            held: &[],
        }];
        surfaces.extend(
            bones
                .iter()
                .map(|(name, vertices, triangles)| AuditedSurface {
                    name,
                    rigid: true,
                    vertices,
                    triangles,
                    held: &[],
                }),
        );
        let found = audit.frame(&surfaces).crossings;
        let with_itself = if contact.between.itself {
            found.self_
        } else {
            0
        };
        found.soft_rigid + with_itself
    }
}

/// Whether a body is a minimum whose surface pairs could keep apart.
fn is_lone(body: &Body) -> bool {
    let is_minimum = matches!(body.method, Stepper::Minimum(_));
    is_minimum && !body.in_pairs && body.stopped.is_none() && !body.rest.triangles.is_empty()
}
