//! Detection of possible contacts: the lower layer and each implant in both directions, implants
//! with each other, and all of them with the surfaces below.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::contact::{On, Over, Touch, Touching};
use super::settle::SkinSystem;
use super::support_surface::SupportSurface;
use crate::contact::Surface;
use crate::contact::edges::{FacingEdges, OrientedEdges, facing_edges};
use crate::mesh::measures::{Aabb, max_or_nan, triangle_areas};
use crate::mesh::{Topology, TriangleMesh};

/// Contact stiffness [N/m^3] times the square of the base, relative to the skin's in-plane
/// stiffness. Under a tension that stretches skin by a third, the penetration is then less than a
/// thousandth of the base.
pub(super) const PENALTY: f64 = 2_000.0;

/// Gap at which contact begins to press, relative to the base. The quadratic force from there to
/// the same depth inside informs Newton's method of an approaching contact.
const SOFT: f64 = 3e-3;

/// Distance that skin, implants and obstacles keep from each other, relative to the base: what
/// touches at its vertices does not cross between them.
const CLEAR: f64 = 1.5e-3;

/// Contacts nearer than this share of the distance kept are offset to twice of it, if anything
/// crosses.
const NEAR: f64 = 0.25;

/// Factor by which the offset of a contact that stays too near grows faster each time: the forces
/// of others wait for it.
const FASTER: f64 = 1.5;

/// Stiffness of a contact between edges, relative to that of a vertex of the same area.
const EDGES: f64 = 0.5;

/// Edges that cross by more than this share of an edge of the skin are not tested.
const DEEPEST_EDGE: f64 = 0.25;

/// Vertices farther apart than this share of the base are not tested.
const LOOK: f64 = 0.15;

/// Radius of the surface that defines the tangential stiffness of a contact, relative to the base:
/// smaller than the least real radius, so that no round diverges, and large enough for fast rounds.
pub(super) const BENDS: f64 = 0.1;

/// Greatest penetration at equilibrium, relative to the base.
const DEEP: f64 = 1e-3;

/// If the penetration at equilibrium is greater, contacts deeper than this share of the limit are
/// offset by their depth: the edge of an implant carries all its pressure on a line, where springs
/// are too soft.
const LIFTED: f64 = 0.5;

/// Greatest penetration at equilibrium [m], for a base [m].
pub fn deepest(base: f64) -> f64 {
    DEEP * base
}

/// Finds possible contacts.
pub(super) struct Detector<'a> {
    pub model: &'a SkinSystem,
    /// Rest area of each unknown vertex [m^2].
    areas: Vec<f64>,
    /// Each implant with its first vertex.
    implants: Vec<(Surface, u32)>,
    /// Topology of the lower layer.
    lower: Arc<Topology>,
    /// The edges of the lower layer, of each implant and of each obstacle.
    edges: Vec<Edges>,
    soft: f64,
    pub lifts: Lifts,
}

/// The offsets of contacts, by their keys.
pub(super) type Lifts = BTreeMap<(On, [u32; 2]), Lift>;

/// Offset of the contacts of a vertex or an edge with a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lift {
    /// The offset [m].
    by: f64,
    /// The next increase, relative to what is missing.
    factor: f64,
}

/// The edges of a body.
struct Edges {
    body: On,
    /// Its vertices among the unknowns; `None` for an obstacle.
    vertices: Option<std::ops::Range<usize>>,
    /// Each edge and the tips of its triangles, in its own numbers, outward.
    hinges: Vec<[u32; 4]>,
    /// A third of the area of both triangles at rest [m^2].
    areas: Vec<f64>,
}

impl Edges {
    fn new(body: On, mesh: &TriangleMesh, topology: &Topology, first: Option<usize>) -> Self {
        let area = |&[a, b, c, d]: &[u32; 4]| {
            let beside = triangle_areas(&mesh.vertices, &[[a, b, c], [b, a, d]]);
            beside.iter().sum::<f64>() / 3.0
        };
        let areas = topology.hinges.iter().map(area).collect();
        let vertices = first.map(|first| first..first + mesh.vertices.len());
        Self {
            body,
            vertices,
            hinges: topology.hinges.clone(),
            areas,
        }
    }

    fn at<'a>(&'a self, x: &'a [Point3<f64>], model: &'a SkinSystem) -> OrientedEdges<'a> {
        let x = match (&self.vertices, self.body) {
            (Some(own), _) => &x[own.clone()],
            (None, On::Support(k)) => &model.supports[k as usize].mesh().vertices,
            (None, _) => &[],
        };
        OrientedEdges {
            x,
            hinges: &self.hinges,
        }
    }

    /// The ends of an edge among the unknowns.
    fn ends(&self, hinge: usize) -> Option<[u32; 2]> {
        let first = self.vertices.as_ref()?.start as u32;
        let [a, b, ..] = self.hinges[hinge];
        Some([first + a, first + b])
    }
}

impl<'a> Detector<'a> {
    pub fn new(model: &'a SkinSystem) -> Self {
        let support = model.layers.support();
        let mut areas = vec![0.0; model.layers.count()];
        areas.extend(at_least_mean(support.vertex_areas()));
        areas.extend(
            model
                .implants
                .iter()
                .flat_map(|i| at_least_mean(i.mesh.vertex_areas())),
        );
        let implants = model
            .implants
            .iter()
            .map(|i| Surface::new(&i.mesh))
            .zip(model.firsts())
            .collect();
        let lower = Arc::new(Topology::new(&support));
        let mut edges = Vec::new();
        if model.ball.is_none() {
            // The side of the lower layer that faces an implant.
            let mut below = Edges::new(On::Skin, &support, &lower, Some(model.layers.count()));
            below
                .hinges
                .iter_mut()
                .for_each(|[a, b, ..]| std::mem::swap(a, b));
            edges.push(below);
            for (k, (implant, first)) in model.implants.iter().zip(model.firsts()).enumerate() {
                let body = On::Implant(k as u32);
                let topology = Topology::new(&implant.mesh);
                edges.push(Edges::new(
                    body,
                    &implant.mesh,
                    &topology,
                    Some(first as usize),
                ));
            }
            for (k, support) in model
                .supports
                .iter()
                .enumerate()
                .filter(|_| model.has_obstacles)
            {
                let body = On::Support(k as u32);
                edges.push(Edges::new(body, support.mesh(), support.topology(), None));
            }
        }
        Self {
            model,
            areas,
            implants,
            lower,
            edges,
            soft: SOFT * model.base,
            lifts: BTreeMap::new(),
        }
    }

    fn stiffness(&self, v: u32, share: f64) -> f64 {
        self.stiffness_of(self.areas[v as usize], share)
    }

    /// The stiffness of a contact [N/m] of an area [m^2].
    fn stiffness_of(&self, area: f64, share: f64) -> f64 {
        let SkinSystem { membrane, base, .. } = self.model;
        PENALTY * membrane / (base * base) * area * share
    }

    /// All possible contacts at positions `x`.
    pub fn touching(&mut self, x: &[Point3<f64>]) -> Touching {
        for (surface, first) in &mut self.implants {
            let first = *first as usize;
            let end = first + surface.positions().len();
            surface.refit(&x[first..end]);
        }
        let (n, look) = (self.model.layers.count(), LOOK * self.model.base);
        let lower = self.lower_layer();
        let mut touches = Vec::new();
        if let Some((centre, radius)) = self.model.ball {
            let over = Over::Ball(centre, radius);
            let touch = |&vertex: &u32| {
                Touch::of_vertex(
                    vertex,
                    On::Ball,
                    over,
                    self.stiffness(vertex, 1.0),
                    self.soft,
                )
            };
            touches.extend(lower.iter().map(touch));
        }
        let all = x.len() as u32;
        for k in 0..self.implants.len() {
            let others = (2 * n as u32..all).filter(|v| !self.own(k).contains(v));
            // Also those that are held: there the implant gives way.
            let layer = n as u32..2 * n as u32;
            touches.extend(
                layer
                    .chain(others)
                    .filter_map(|v| self.over_implant(k, v, x, look)),
            );
        }
        if n > 0 && (self.model.has_obstacles || !self.implants.is_empty()) {
            let triangles = self.model.layers.triangles.clone();
            let layer = TriangleMesh {
                vertices: x[n..2 * n].to_vec(),
                triangles,
            };
            let layer = SupportSurface::with(layer, self.lower.clone());
            touches.extend((2 * n as u32..all).filter_map(|v| self.under_skin(&layer, v, x)));
            if self.model.has_obstacles {
                touches.extend(self.over_vertices(&layer, x));
            }
        }
        for k in 0..self.model.supports.len() {
            let each = lower.iter().copied().chain(2 * n as u32..all);
            touches.extend(each.filter_map(|v| self.over_support(k, v, x, look)));
        }
        touches.extend(self.between_edges(x));
        let radius = BENDS * self.model.base;
        for t in &mut touches {
            let key = t.key;
            t.lift = self.clear(key.0) + self.lifts.get(&key).map_or(0.0, |lift| lift.by);
            *t = t.found(x, radius);
        }
        Touching { touches }
    }

    /// The distance that is kept from a body [m]. The lower layer lies on its own initial surface
    /// at the rim, so nothing is kept from there.
    fn clear(&self, on: On) -> f64 {
        match on {
            On::Implant(_) | On::Skin => CLEAR * self.model.base,
            On::Support(_) | On::VertexOf(_) if self.model.has_obstacles => CLEAR * self.model.base,
            On::Support(_) | On::VertexOf(_) | On::Ball => 0.0,
        }
    }

    /// Gap up to which edges, and vertices of obstacles, are tested in either direction [m].
    fn reach(&self, on: On) -> f64 {
        self.clear(on) + 2.0 * self.soft
    }

    /// True for a vertex that does not move.
    fn is_held(&self, v: u32) -> bool {
        let held = &self.model.layers.held;
        held.get(v as usize).copied().unwrap_or(false)
    }

    /// Free vertices of the lower layer.
    fn lower_layer(&self) -> Vec<u32> {
        let n = self.model.layers.count() as u32;
        (n..2 * n)
            .filter(|v| !self.model.layers.held[*v as usize])
            .collect()
    }

    /// Vertices of an implant.
    fn own(&self, k: usize) -> std::ops::Range<u32> {
        let (surface, first) = &self.implants[k];
        *first..*first + surface.positions().len() as u32
    }

    /// Greatest penetration of one body into another [m], without a limit inside an implant.
    pub fn depth(&mut self, x: &[Point3<f64>]) -> f64 {
        let near = self.touching(x).depth(x);
        let n = self.model.layers.count() as u32;
        let inside = |k: usize| {
            let each = (n..x.len() as u32).filter(|v| !self.own(k).contains(v));
            let on = each.filter_map(|v| self.implants[k].0.nearest(&x[v as usize], f64::MAX));
            max_or_nan(on.map(|on| (-on.closest.distance).max(0.0)))
        };
        max_or_nan((0..self.implants.len()).map(inside).chain([near]))
    }

    /// Increases the offset of contacts that are too near until they keep a distance, and reduces
    /// offsets that are too great. Returns true if any contact was too near.
    pub fn lift(&mut self, x: &[Point3<f64>]) -> bool {
        // Of all contacts of a vertex or an edge with a body, the nearest one.
        let mut nearest = BTreeMap::new();
        for touch in self.touching(x).touches {
            let gap = touch.gap(x).unwrap_or(f64::INFINITY);
            let least = nearest.entry(touch.key).or_insert(gap);
            *least = gap.min(*least);
        }
        let mut any = false;
        for (key, gap) in nearest {
            let clear = self.clear(key.0);
            let is_near = match clear > 0.0 {
                true => gap < NEAR * clear,
                false => -gap > LIFTED * deepest(self.model.base),
            };
            if is_near || self.lifts.contains_key(&key) {
                let lift = self.lifts.entry(key).or_insert(Lift {
                    by: 0.0,
                    factor: 1.0,
                });
                if is_near {
                    lift.by += lift.factor * (2.0 * NEAR * clear - gap);
                    lift.factor *= FASTER;
                } else {
                    lift.by = (lift.by - (gap - clear).max(0.0)).max(0.0);
                    lift.factor = 1.0;
                }
            }
            any |= is_near;
        }
        any
    }

    /// Contact of a vertex of the lower layer, or of another implant, with the outside of an
    /// implant.
    fn over_implant(&self, k: usize, vertex: u32, x: &[Point3<f64>], look: f64) -> Option<Touch> {
        let (implant, first) = &self.implants[k];
        let on = implant.nearest(&x[vertex as usize], look)?;
        let corners = implant.triangles()[on.triangle as usize].map(|v| v + first);
        let over = Over::Carried(on.closest.normal);
        let (on_it, stiffness) = (On::Implant(k as u32), self.stiffness(vertex, 0.5));
        let touch = Touch::of_vertex(vertex, on_it, over, stiffness, self.soft);
        Some(touch.with_triangle(corners, on.weights))
    }

    /// Contact of a vertex of an implant with the lower layer above it.
    fn under_skin(&self, lower: &SupportSurface, vertex: u32, x: &[Point3<f64>]) -> Option<Touch> {
        let at = x[vertex as usize];
        let on = lower.nearest(&at, 2.0 * self.model.layers.edge)?;
        let first = self.model.layers.count() as u32;
        let (over, stiffness) = (Over::Carried(-on.away(&at)), self.stiffness(vertex, 0.5));
        let touch = Touch::of_vertex(vertex, On::Skin, over, stiffness, self.soft);
        Some(touch.with_triangle(on.corners.map(|v| v + first), on.weights))
    }

    /// Contact of a vertex with the surface below.
    fn over_support(
        &self,
        support: usize,
        vertex: u32,
        x: &[Point3<f64>],
        look: f64,
    ) -> Option<Touch> {
        let at = x[vertex as usize];
        let on = self.model.supports[support].nearest(&at, look)?;
        let over = Over::Plane(on.point, on.away(&at));
        let (on_it, stiffness) = (On::Support(support as u32), self.stiffness(vertex, 1.0));
        Some(Touch::of_vertex(vertex, on_it, over, stiffness, self.soft))
    }

    /// Contacts of the lower layer and of implants with vertices of obstacles.
    fn over_vertices(&self, lower: &SupportSurface, x: &[Point3<f64>]) -> Vec<Touch> {
        let first = self.model.layers.count();
        let mut touches = Vec::new();
        for (k, support) in self.model.supports.iter().enumerate() {
            let reach = self.reach(On::Support(k as u32));
            let near = Aabb::of_points(&x[first..]).inflate(reach);
            for (v, at) in support.mesh().vertices.iter().enumerate() {
                if !near.contains(at) {
                    continue;
                }
                let vertex = (k as u32, v as u32, *at);
                if let Some(on) = lower.nearest(at, reach) {
                    let corners = on.corners.map(|v| v + first as u32);
                    touches.extend(self.over_vertex(
                        vertex,
                        first as u32,
                        corners,
                        on.weights,
                        on.away(at),
                    ));
                }
                for (implant, first) in &self.implants {
                    if let Some(on) = implant.nearest(at, reach) {
                        let corners = implant.triangles()[on.triangle as usize].map(|v| v + first);
                        let away = -on.closest.normal;
                        touches.extend(self.over_vertex(vertex, *first, corners, on.weights, away));
                    }
                }
            }
        }
        touches
    }

    /// Contact of a place of a triangle with a vertex of an obstacle: obstacle, vertex and place.
    fn over_vertex(
        &self,
        (k, v, at): (u32, u32, Point3<f64>),
        body_first: u32,
        corners: [u32; 3],
        weights: [f64; 3],
        away: Vector3<f64>,
    ) -> Option<Touch> {
        if corners.iter().all(|v| self.is_held(*v)) {
            return None;
        }
        let areas = corners.map(|v| self.areas[v as usize]);
        let area = (0..3).map(|k| weights[k] * areas[k]).sum();
        let (on, over) = (On::VertexOf(k), Over::Plane(at, away));
        let touch = Touch::of_vertex(v, on, over, self.stiffness_of(area, 0.5), self.soft);
        Some(Touch {
            key: (on, [v, body_first]),
            ..touch.of_triangle(corners, weights)
        })
    }

    /// Contacts between edges of two bodies, of which the first one moves.
    fn between_edges(&self, x: &[Point3<f64>]) -> Vec<Touch> {
        let mut touches = Vec::new();
        for (k, one) in self.edges.iter().enumerate() {
            for other in self.edges[k + 1..]
                .iter()
                .filter(|_| one.vertices.is_some())
            {
                let at = [one, other].map(|edges| edges.at(x, self.model));
                let reach = [
                    self.reach(other.body),
                    DEEPEST_EDGE * self.model.layers.edge,
                ];
                let found = facing_edges(at[0], at[1], reach);
                touches.extend(
                    found
                        .iter()
                        .filter_map(|pair| self.edge_touch([one, other], pair)),
                );
            }
        }
        touches
    }

    /// Contact of an edge with one of another body.
    fn edge_touch(&self, [one, other]: [&Edges; 2], pair: &FacingEdges) -> Option<Touch> {
        let [s, t] = pair.hinges;
        let (ends @ [a, b], [u, w], n) = (one.ends(s)?, pair.places, pair.normal);
        if ends.iter().all(|v| self.is_held(*v)) {
            return None;
        }
        let (corners, weights, over, area) = match other.ends(t) {
            Some([c, d]) => {
                let area = 0.5 * (one.areas[s] + other.areas[t]);
                (
                    [a, b, c, d],
                    [1.0 - u, u, w - 1.0, -w],
                    Over::Carried(n),
                    area,
                )
            }
            None => {
                let at = other.at(&[], self.model);
                let [c, d] = [0, 1].map(|k| at.x[other.hinges[t][k] as usize]);
                let over = Over::Plane(c + (d - c) * w, n);
                ([a, b, a, a], [1.0 - u, u, 0.0, 0.0], over, one.areas[s])
            }
        };
        let stiffness = self.stiffness_of(area, EDGES);
        let touch = Touch::of_vertex(a, other.body, over, stiffness, self.soft);
        Some(Touch {
            key: (other.body, ends),
            corners,
            weights,
            ..touch
        })
    }
}

/// Areas, each at least their mean: a small triangle at a ridge can carry as much as others.
fn at_least_mean(areas: Vec<f64>) -> impl Iterator<Item = f64> {
    let mean = areas.iter().sum::<f64>() / areas.len().max(1) as f64;
    areas.into_iter().map(move |area| area.max(mean))
}
