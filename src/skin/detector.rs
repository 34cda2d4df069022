//! Detection of possible contacts: the lower layer and each implant in both directions, implants
//! with each other, and all of them with the surfaces below.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::Point3;

use super::contact::{On, Over, Touch, Touching};
use super::settle::SkinSystem;
use super::support_surface::SupportSurface;
use crate::contact::Surface;
use crate::mesh::measures::max_or_nan;
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

/// First increase of the distance beside a crossing, relative to the distance kept; every further
/// increase doubles it. Between vertices, coarse surfaces bulge by more than the distance kept.
const STEP: f64 = 0.5;

/// Vertices farther apart than this share of the base are not tested.
const LOOK: f64 = 0.15;

/// Radius of the surface that defines the tangential stiffness of a contact, relative to the base:
/// smaller than the least real radius, so that no round diverges, and large enough for fast rounds.
const BENDS: f64 = 0.1;

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
    soft: f64,
    /// Offsets of contacts [m].
    lifts: BTreeMap<(On, u32), f64>,
    /// Distances kept beside crossings beyond the usual one [m].
    apart: BTreeMap<(On, u32), f64>,
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
        let (lifts, apart) = Default::default();
        let lower = Arc::new(Topology::new(&support));
        Self {
            model,
            areas,
            implants,
            lower,
            soft: SOFT * model.base,
            lifts,
            apart,
        }
    }

    fn stiffness(&self, v: u32, share: f64) -> f64 {
        let SkinSystem { membrane, base, .. } = self.model;
        PENALTY * membrane / (base * base) * self.areas[v as usize] * share
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
                Touch::new(
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
            touches.extend(
                lower
                    .iter()
                    .copied()
                    .chain(others)
                    .filter_map(|v| self.over_implant(k, v, x, look)),
            );
        }
        if n > 0 && !self.implants.is_empty() {
            let triangles = self.model.layers.triangles.clone();
            let layer = TriangleMesh {
                vertices: x[n..2 * n].to_vec(),
                triangles,
            };
            let layer = SupportSurface::with(layer, self.lower.clone());
            touches.extend((2 * n as u32..all).filter_map(|v| self.under_skin(&layer, v, x)));
        }
        for k in 0..self.model.supports.len() {
            let each = lower.iter().copied().chain(2 * n as u32..all);
            touches.extend(each.filter_map(|v| self.over_support(k, v, x, look)));
        }
        let radius = BENDS * self.model.base;
        for t in &mut touches {
            let key = (t.on, t.vertex);
            t.lift = self.kept(key) + self.lifts.get(&key).unwrap_or(&0.0);
            *t = t.found(x, radius);
        }
        Touching { touches }
    }

    /// The distance that is kept from a body [m]. The lower layer lies on its own initial surface
    /// at the rim, so nothing is kept from there.
    fn clear(&self, on: On) -> f64 {
        match on {
            On::Implant(_) | On::Skin => CLEAR * self.model.base,
            On::Support(_) if self.model.has_obstacles => CLEAR * self.model.base,
            On::Support(_) | On::Ball => 0.0,
        }
    }

    /// The distance that a vertex keeps from a body [m].
    fn kept(&self, key: (On, u32)) -> f64 {
        self.clear(key.0) + self.apart.get(&key).unwrap_or(&0.0)
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
        let (lower, n) = (self.lower_layer(), self.model.layers.count() as u32);
        let inside = |k: usize| {
            let others = (2 * n..x.len() as u32).filter(|v| !self.own(k).contains(v));
            let each = lower.iter().copied().chain(others);
            let on = each.filter_map(|v| self.implants[k].0.nearest(&x[v as usize], f64::MAX));
            max_or_nan(on.map(|on| (-on.closest.distance).max(0.0)))
        };
        max_or_nan((0..self.implants.len()).map(inside).chain([near]))
    }

    /// Increases the offset of contacts that are too deep by their depth, and the distance that
    /// contacts of `crossed` vertices keep. Reduces offsets that are too great. Returns true if any
    /// contact was too deep or of a crossed vertex.
    pub fn lift(&mut self, x: &[Point3<f64>], crossed: &BTreeSet<u32>) -> bool {
        let deep = LIFTED * deepest(self.model.base);
        let mut any = false;
        for touch in self.touching(x).touches {
            let (Some(gap), key) = (touch.gap(x), (touch.on, touch.vertex)) else {
                continue;
            };
            let (clear, over) = (self.clear(touch.on), gap - self.kept(key));
            let is_deep = -gap > deep;
            if is_deep || self.lifts.contains_key(&key) {
                let lift = self.lifts.entry(key).or_insert(0.0);
                *lift = (*lift - if is_deep { gap } else { over.max(0.0) }).max(0.0);
            }
            let is_near = clear > 0.0 && over < 2.0 * self.soft;
            let is_crossed = is_near && crossed.contains(&touch.vertex);
            if is_crossed {
                let apart = self.apart.entry(key).or_insert(0.0);
                *apart = (2.0 * *apart)
                    .max(*apart + over + STEP * clear)
                    .max(STEP * clear);
            }
            any |= is_deep || is_crossed;
        }
        any
    }

    /// Contact of a vertex of the lower layer, or of another implant, with the outside of an
    /// implant.
    fn over_implant(&self, k: usize, vertex: u32, x: &[Point3<f64>], look: f64) -> Option<Touch> {
        let (implant, first) = &self.implants[k];
        let on = implant.nearest(&x[vertex as usize], look)?;
        let corners = implant.triangles()[on.triangle as usize].map(|v| v + first);
        let over = Over::Carried(corners, on.weights, on.closest.normal);
        Some(Touch::new(
            vertex,
            On::Implant(k as u32),
            over,
            self.stiffness(vertex, 0.5),
            self.soft,
        ))
    }

    /// Contact of a vertex of an implant with the lower layer above it.
    fn under_skin(&self, lower: &SupportSurface, vertex: u32, x: &[Point3<f64>]) -> Option<Touch> {
        let at = x[vertex as usize];
        let on = lower.nearest(&at, 2.0 * self.model.layers.edge)?;
        let first = self.model.layers.count() as u32;
        let over = Over::Carried(on.corners.map(|v| v + first), on.weights, -on.away(&at));
        Some(Touch::new(
            vertex,
            On::Skin,
            over,
            self.stiffness(vertex, 0.5),
            self.soft,
        ))
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
        Some(Touch::new(
            vertex,
            On::Support(support as u32),
            over,
            self.stiffness(vertex, 1.0),
            self.soft,
        ))
    }
}

/// Areas, each at least their mean: a small triangle at a ridge can carry as much as others.
fn at_least_mean(areas: Vec<f64>) -> impl Iterator<Item = f64> {
    let mean = areas.iter().sum::<f64>() / areas.len().max(1) as f64;
    areas.into_iter().map(move |area| area.max(mean))
}
