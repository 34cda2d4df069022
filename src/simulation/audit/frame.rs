//! The audit of one frame: crossings, vertices inside, shared and changed volumes, of any surfaces.

use std::collections::BTreeMap;

use nalgebra::Point3;
use rayon::prelude::*;
use serde::Serialize;

use super::rigid::{Depths, Rigid};
use super::{DEPTH, depths};
use crate::mesh::coincident::{first_in_place, same_corners};
use crate::mesh::crossings::{Crossed, Crossings, crossings_between, self_crossings};
use crate::mesh::inside::Inside;
use crate::mesh::measures::{Aabb, max_or_nan, volume};
use crate::mesh::overlap::{box_of_pairs, shared_volume};
use crate::mesh::predicates::{crossing_point, is_flat};
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceTree, TriangleMesh};

/// A surface in one frame.
#[derive(Clone, Copy, Debug)]
pub struct AuditedSurface<'a> {
    /// Name, unique in its frame; frames are compared by name.
    pub name: &'a str,
    /// True for a bone or an obstacle, false for a muscle, skin or another soft body.
    pub rigid: bool,
    /// Vertex positions [m], shape `[vertex_count]`.
    pub vertices: &'a [Point3<f64>],
    /// Triangles, shape `[triangle_count]`, with valid indices.
    pub triangles: &'a [[u32; 3]],
    /// Of a soft surface, the index in the list of surfaces of the rigid one that holds each vertex,
    /// shape `[vertex_count]`; empty if this is not known.
    pub held: &'a [Option<usize>],
}

/// Numbers of pairs of triangles that cross.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct CrossingCounts {
    /// Of two soft surfaces.
    pub soft_soft: usize,
    /// Of a soft and a rigid surface.
    pub soft_rigid: usize,
    /// Of one soft surface.
    #[serde(rename = "self")]
    pub self_: usize,
    /// All of these.
    pub all: usize,
}

/// Findings at a pair of surfaces, or of one surface with itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct AuditedPair {
    /// Names of the surfaces, equal for one surface with itself.
    pub surfaces: [String; 2],
    /// True if the second surface is rigid.
    pub with_rigid: bool,
    /// Number of pairs of triangles that cross.
    pub crossings: usize,
    /// Number of vertices of each surface inside the other one; in a rigid surface deeper than 0.01 mm.
    pub vertices_inside: [usize; 2],
    /// Greatest depth of such a vertex below the surface of the other one [m].
    pub depth_m: f64,
    /// Shared volume of two soft surfaces [m3].
    pub shared_volume_m3: f64,
    /// The first pair of triangles that cross, by index.
    pub triangles: Option<[u32; 2]>,
    /// A point where they cross [m]; without crossings a vertex inside.
    pub point_m: Option<[f64; 3]>,
}

/// Result of the audit of one frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FrameAudit {
    /// Pairs of triangles that cross.
    pub crossings: CrossingCounts,
    /// Crossings of a soft and a rigid surface at a triangle with a vertex that this rigid surface
    /// holds; `None` if held vertices are not known.
    pub crossings_held: Option<usize>,
    /// True if all pairs of triangles were tested; false if too many lie in one place.
    pub complete: bool,
    /// Vertices of soft surfaces deeper than 0.01 mm in rigid ones, free or held.
    pub vertices_inside_bones: usize,
    /// Vertices of rigid surfaces inside soft ones.
    pub bone_vertices_inside: usize,
    /// Vertices of soft surfaces inside other soft ones.
    pub vertices_inside_muscles: usize,
    /// Greatest shared volume of two soft surfaces [m3].
    pub shared_volume_m3: f64,
    /// Greatest change of the enclosed volume of a soft surface since its first frame, relative.
    pub volume_error: f64,
    /// The soft surface with this change.
    pub volume_error_of: Option<String>,
    /// Greatest growth of the depth of two rigid surfaces in each other since their first frame,
    /// relative to the longest side of the smaller one's box in that frame.
    pub rigid_depth: f64,
    /// The two rigid surfaces.
    pub rigid_depth_of: Option<[String; 2]>,
    /// Surfaces with a coordinate that is not finite, and the first such vertex. They are in no
    /// other test.
    pub not_finite: Vec<(String, usize)>,
    /// Surfaces that are not closed. They contain nothing and have no volume.
    pub open: Vec<String>,
    /// Number of triangles without area, which are in no test of crossings.
    pub flat: usize,
    /// Pairs of surfaces with findings.
    pub pairs: Vec<AuditedPair>,
}

/// Audits frames one after another. It keeps one hierarchy for each surface.
#[derive(Debug)]
pub struct Audit {
    kept: BTreeMap<String, Kept>,
    /// Of rigid surfaces.
    depths: Depths,
    /// Length of the unit of positions [m].
    unit: f64,
}

/// A surface as it was in its last frame.
#[derive(Debug)]
pub(super) struct Kept {
    pub vertices: Vec<Point3<f64>>,
    /// Whether this is its first frame, or a vertex is elsewhere than in the frame before.
    pub moved: bool,
    /// Longest side of its box in the first frame.
    pub extent: f64,
    triangles: Vec<[u32; 3]>,
    tree: SurfaceTree,
    /// Lowest vertex at the position of each vertex in the first frame.
    joined: Vec<u32>,
    /// The same among the vertices that are still at one position.
    names: Vec<u32>,
    flat: Vec<bool>,
    /// Groups of triangles with the same three corners.
    doubled: Vec<Vec<u32>>,
    closed: bool,
    pub bounds: Aabb,
    /// Enclosed volume in the first frame [m3].
    volume: f64,
}

impl Kept {
    fn new(surface: &AuditedSurface<'_>) -> Self {
        let (vertices, triangles) = (surface.vertices.to_vec(), surface.triangles.to_vec());
        let joined = first_in_place(&vertices);
        let corners = |t: &[u32; 3]| t.map(|v| joined[v as usize]);
        let whole = TriangleMesh {
            triangles: triangles.iter().map(corners).collect(),
            vertices,
        };
        let doubled = same_corners(&whole.triangles);
        let closed = Topology::new(&whole).is_cycle();
        let vertices = whole.vertices;
        let mut kept = Self {
            moved: true,
            extent: Aabb::of_points(&vertices).extents().max(),
            tree: SurfaceTree::new(&vertices, &triangles),
            names: joined.clone(),
            joined,
            flat: Vec::new(),
            doubled,
            bounds: Aabb::EMPTY,
            volume: if closed {
                volume(&vertices, &triangles)
            } else {
                0.0
            },
            closed,
            vertices,
            triangles,
        };
        kept.examine();
        kept
    }

    /// Takes the positions of a frame; returns false if the triangles are others.
    fn follow(&mut self, surface: &AuditedSurface<'_>) -> bool {
        let same = self.vertices.len() == surface.vertices.len();
        if !same || self.triangles != surface.triangles {
            return false;
        }
        self.moved = self.vertices != surface.vertices;
        if self.moved {
            self.vertices.copy_from_slice(surface.vertices);
            self.tree.refit(&self.vertices, &self.triangles);
            self.name();
            self.examine();
        }
        true
    }

    /// Joins the vertices that were at one position in the first frame and are at one now. A vertex
    /// that comes to the position of another one only now touches it.
    fn name(&mut self) {
        let mut shared = vec![false; self.joined.len()];
        for (v, &j) in self.joined.iter().enumerate() {
            shared[j as usize] |= j as usize != v;
        }
        if !shared.contains(&true) {
            return;
        }
        let key = |v: usize| self.vertices[v].coords.map(|c| (c + 0.0).to_bits());
        let mut first = BTreeMap::new();
        for (v, &j) in self.joined.iter().enumerate() {
            if shared[j as usize] {
                let place = (j, <[u64; 3]>::from(key(v)));
                self.names[v] = *first.entry(place).or_insert(v as u32);
            }
        }
        let named = |t: &[u32; 3]| t.map(|v| self.names[v as usize]);
        let named: Vec<[u32; 3]> = self.triangles.iter().map(named).collect();
        self.doubled = same_corners(&named);
    }

    fn examine(&mut self) {
        let corners = |t: &[u32; 3]| t.map(|v| self.vertices[v as usize]);
        let flat = self.triangles.par_iter().with_min_len(1024);
        self.flat = flat.map(|t| is_flat(&corners(t))).collect();
        self.bounds = Aabb::of_points(&self.vertices);
    }

    fn crossed(&self) -> Crossed<'_> {
        Crossed {
            vertices: &self.vertices,
            triangles: &self.triangles,
            names: &self.names,
            skipped: &self.flat,
            tree: &self.tree,
        }
    }

    /// Crossings with itself. Two triangles with the same three corners lie on each other.
    fn self_crossings(&self) -> Crossings {
        let mut found = self_crossings(self.crossed(), self.triangles.len());
        for group in &self.doubled {
            let group: Vec<u32> = group
                .iter()
                .copied()
                .filter(|t| !self.flat[*t as usize])
                .collect();
            found.count += group.len() * group.len().saturating_sub(1) / 2;
            if let [one, other, ..] = group[..] {
                found.pairs.push([one, other]);
            }
        }
        found
    }

    fn corners(&self, t: u32) -> [Point3<f64>; 3] {
        self.triangles[t as usize].map(|v| self.vertices[v as usize])
    }

    /// Distance of a point to the surface.
    pub fn depth(&self, p: &Point3<f64>) -> f64 {
        let closest = self.tree.closest(p, f64::INFINITY);
        closest.map_or(0.0, |c| c.distance)
    }
}

/// A surface during the audit of a frame.
struct Examined<'a> {
    surface: &'a AuditedSurface<'a>,
    kept: &'a Kept,
    inside: Option<Inside<'a>>,
}

impl Examined<'_> {
    fn rigid(&self) -> Option<Rigid<'_>> {
        self.surface.rigid.then_some(Rigid {
            name: self.surface.name,
            kept: self.kept,
            inside: self.inside.as_ref(),
        })
    }
}

/// What two surfaces, or one with itself, add to a frame.
struct Found {
    pair: AuditedPair,
    class: Class,
    held: usize,
    complete: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Class {
    SoftSoft,
    /// The first surface is the soft one.
    SoftRigid,
    OneItself,
}

impl Default for Audit {
    fn default() -> Self {
        Self::new()
    }
}

impl Audit {
    /// An audit before its first frame; positions are in metres.
    pub fn new() -> Self {
        Self::in_unit(1.0)
    }

    /// The same for positions in a `unit` of this length [m]. Positions are never scaled, because
    /// that would round them; results are.
    pub fn in_unit(unit: f64) -> Self {
        Self {
            kept: BTreeMap::new(),
            depths: Depths::default(),
            unit,
        }
    }

    /// Audits one frame. The first frame of a surface gives the volume with which later ones are
    /// compared, and the vertices that are one because their positions are equal.
    ///
    /// All tests read positions as stored, by exact predicates, and nothing else. Of two rigid
    /// surfaces it tells only how much deeper they are in each other than in the first frame; a
    /// rigid surface is not tested with itself.
    pub fn frame(&mut self, surfaces: &[AuditedSurface<'_>]) -> FrameAudit {
        let mut result = FrameAudit {
            complete: true,
            ..FrameAudit::default()
        };
        let mut audited = Vec::new();
        for (index, surface) in surfaces.iter().enumerate() {
            let mut vertices = surface.vertices.iter();
            match vertices.position(|p| !p.coords.iter().all(|c| c.is_finite())) {
                Some(vertex) => result.not_finite.push((surface.name.to_owned(), vertex)),
                None => audited.push((index, surface)),
            }
        }
        let mut kept: Vec<(usize, &AuditedSurface<'_>, Option<Kept>)> = Vec::new();
        for (index, surface) in audited {
            kept.push((index, surface, self.kept.remove(surface.name)));
        }
        let kept: Vec<(usize, &AuditedSurface<'_>, Kept)> = kept
            .into_par_iter()
            .map(|(index, surface, kept)| (index, surface, now(surface, kept)))
            .collect();
        let examined = examine_all(&kept);
        for (_, surface, kept) in &kept {
            result.add_surface(surface, kept);
        }
        let mut pairs = Vec::new();
        for (i, one) in examined.iter().enumerate() {
            pairs.extend((!one.surface.rigid).then_some((i, i)));
            for (j, other) in examined.iter().enumerate().skip(i + 1) {
                let meet = one.kept.bounds.intersects(&other.kept.bounds);
                match (one.surface.rigid, other.surface.rigid) {
                    (true, true) => {}
                    (true, false) if meet => pairs.push((j, i)),
                    (false, _) if meet => pairs.push((i, j)),
                    _ => {}
                }
            }
        }
        let mut all = surfaces.iter();
        result.crossings_held = all
            .all(|s| s.rigid || s.held.len() == s.vertices.len())
            .then_some(0);
        let found: Vec<Found> = pairs
            .par_iter()
            .map(|&(i, j)| match i == j {
                true => of_itself(&examined[i]),
                false => of_two(&examined[i], &examined[j], kept[j].0, DEPTH / self.unit),
            })
            .collect();
        for mut found in found {
            found.pair.scale(self.unit);
            result.add(found);
        }
        let rigid: Vec<Rigid<'_>> = examined.iter().filter_map(Examined::rigid).collect();
        (result.rigid_depth, result.rigid_depth_of) = self.depths.follow(&rigid);
        drop(examined);
        for (_, surface, kept) in kept {
            self.kept.insert(surface.name.to_owned(), kept);
        }
        result
    }
}

/// The surface at the positions of a frame.
fn now(surface: &AuditedSurface<'_>, kept: Option<Kept>) -> Kept {
    let Some(mut kept) = kept else {
        return Kept::new(surface);
    };
    if kept.follow(surface) {
        return kept;
    }
    // Another program may have meshed the body anew; its volume is still that of the first frame.
    let (was_closed, first) = (kept.closed, kept.volume);
    kept = Kept::new(surface);
    if was_closed && kept.closed {
        kept.volume = first;
    }
    kept
}

/// The surfaces with their tests for points inside, where such a test is needed.
fn examine_all<'a>(all: &'a [(usize, &'a AuditedSurface<'a>, Kept)]) -> Vec<Examined<'a>> {
    let examine = |(index, surface, kept): &'a (usize, &'a AuditedSurface<'a>, Kept)| {
        let needed = all.iter().any(|(other, with, near)| {
            let rest = with.rigid && surface.rigid && !near.moved && !kept.moved;
            other != index && !rest && near.bounds.intersects(&kept.bounds)
        });
        let inside = (kept.closed && needed).then(|| Inside::new(&kept.vertices, &kept.triangles));
        Examined {
            surface,
            kept,
            inside,
        }
    };
    all.par_iter().map(examine).collect()
}

fn of_itself(one: &Examined<'_>) -> Found {
    let crossings = one.kept.self_crossings();
    let mut pair = AuditedPair {
        surfaces: [one.surface.name, one.surface.name].map(str::to_owned),
        crossings: crossings.count,
        ..AuditedPair::default()
    };
    pair.place([one.kept, one.kept], &crossings);
    Found {
        pair,
        class: Class::OneItself,
        held: 0,
        complete: crossings.complete,
    }
}

/// Two surfaces, the first one soft; `index` is that of the second in the list of surfaces. A vertex
/// at a smaller depth than `touching` in a rigid surface is not inside it.
fn of_two(one: &Examined<'_>, other: &Examined<'_>, index: usize, touching: f64) -> Found {
    let kept = [one.kept, other.kept];
    let listed = kept[0].triangles.len() + kept[1].triangles.len();
    let crossings = crossings_between(kept[0].crossed(), kept[1].crossed(), listed);
    let deep = if other.surface.rigid { touching } else { 0.0 };
    let swallowed = [
        inside_of(kept[0], other, deep),
        inside_of(kept[1], one, 0.0),
    ];
    let depths = swallowed.iter().flatten().map(|(_, depth)| *depth);
    let mut pair = AuditedPair {
        surfaces: [one.surface.name, other.surface.name].map(str::to_owned),
        with_rigid: other.surface.rigid,
        crossings: crossings.count,
        vertices_inside: [swallowed[0].len(), swallowed[1].len()],
        depth_m: max_or_nan(depths),
        ..AuditedPair::default()
    };
    let class = match other.surface.rigid {
        true => Class::SoftRigid,
        false => Class::SoftSoft,
    };
    if let (Class::SoftSoft, Some(first), Some(second)) = (class, &one.inside, &other.inside) {
        let within = common_box(kept, &crossings, &swallowed);
        pair.shared_volume_m3 = shared_volume(first, second, &within);
    }
    pair.place(kept, &crossings);
    if pair.point_m.is_none() {
        let first = swallowed[0].first().map(|(v, _)| kept[0].vertices[*v]);
        let second = swallowed[1].first().map(|(v, _)| kept[1].vertices[*v]);
        pair.point_m = first.or(second).map(Into::into);
    }
    Found {
        held: at_held(one.surface, index, &crossings),
        pair,
        class,
        complete: crossings.complete,
    }
}

/// The vertices inside a closed surface that are deeper than `deep` [m], with their depths.
fn inside_of(points: &Kept, of: &Examined<'_>, deep: f64) -> Vec<(usize, f64)> {
    let Some(inside) = &of.inside else {
        return Vec::new();
    };
    let mut found = depths(&points.vertices, |_| true, inside, |p| of.kept.depth(p));
    // A depth that is no number counts.
    found.retain(|(_, depth)| deep == 0.0 || !(*depth <= deep));
    found
}

/// Number of crossings at a triangle of a soft surface with a vertex that the rigid surface of this
/// `index` holds.
fn at_held(soft: &AuditedSurface<'_>, index: usize, crossings: &Crossings) -> usize {
    let is_held = |&v: &u32| soft.held.get(v as usize) == Some(&Some(index));
    let at_held = |[t, _]: &&[u32; 2]| soft.triangles[*t as usize].iter().any(is_held);
    crossings.pairs.iter().filter(at_held).count()
}

/// A box around the common part of two surfaces: its corners are vertices inside and points where
/// triangles cross.
fn common_box(kept: [&Kept; 2], crossings: &Crossings, swallowed: &[Vec<(usize, f64)>; 2]) -> Aabb {
    if crossings.pairs.len() < crossings.count || !crossings.complete {
        let [one, other] = kept.map(|k| k.bounds);
        return one.intersection(&other);
    }
    let corners = |&[s, t]: &[u32; 2]| [kept[0].corners(s), kept[1].corners(t)];
    let mut within = box_of_pairs(crossings.pairs.iter().map(corners));
    for (of, swallowed) in kept.iter().zip(swallowed) {
        let points = swallowed.iter().map(|(v, _)| &of.vertices[*v]);
        within = within.union(&Aabb::of_points(points));
    }
    within
}

impl AuditedPair {
    /// Sets the first pair of triangles and a point where they cross.
    fn place(&mut self, kept: [&Kept; 2], crossings: &Crossings) {
        let Some(&[s, t]) = crossings.pairs.first() else {
            return;
        };
        let point = crossing_point(&kept[0].corners(s), &kept[1].corners(t));
        self.triangles = Some([s, t]);
        self.point_m = Some(point.into());
    }

    /// Brings lengths and volumes from units of this length [m] into metres.
    fn scale(&mut self, unit: f64) {
        self.depth_m *= unit;
        self.shared_volume_m3 *= unit * unit * unit;
        self.point_m = self.point_m.map(|p| p.map(|c| c * unit));
    }

    fn is_clean(&self) -> bool {
        self.crossings == 0 && self.vertices_inside == [0, 0]
    }
}

impl FrameAudit {
    fn add_surface(&mut self, surface: &AuditedSurface<'_>, kept: &Kept) {
        self.flat += kept.flat.iter().filter(|flat| **flat).count();
        if !kept.closed {
            self.open.push(surface.name.to_owned());
        } else if !surface.rigid {
            let error = volume(&kept.vertices, &kept.triangles) / kept.volume - 1.0;
            // NaN stays.
            if !(error.abs() <= self.volume_error) && !self.volume_error.is_nan() {
                self.volume_error = error.abs();
                self.volume_error_of = Some(surface.name.to_owned());
            }
        }
    }

    fn add(&mut self, found: Found) {
        let Found {
            pair,
            class,
            held,
            complete,
        } = found;
        self.complete &= complete;
        self.crossings.all += pair.crossings;
        let [inside, swallowed] = pair.vertices_inside;
        match class {
            Class::SoftSoft => {
                self.crossings.soft_soft += pair.crossings;
                self.vertices_inside_muscles += inside + swallowed;
            }
            Class::SoftRigid => {
                self.crossings.soft_rigid += pair.crossings;
                self.vertices_inside_bones += inside;
                self.bone_vertices_inside += swallowed;
                self.crossings_held = self.crossings_held.map(|all| all + held);
            }
            Class::OneItself => self.crossings.self_ += pair.crossings,
        }
        self.shared_volume_m3 = max_or_nan([self.shared_volume_m3, pair.shared_volume_m3]);
        if !pair.is_clean() {
            self.pairs.push(pair);
        }
    }
}
