//! The planner's question: an implant at a place of a skin, and what it does there.

use std::sync::OnceLock;

use nalgebra::{Isometry3, Point3, Vector3};

use super::areas::Areas;
use super::implant::Implant;
use super::layers::{Layers, Tissue};
use super::patch::{EVEN, MARGIN, Patch, TakenOut};
use super::region::{REACH, Region, frame};
use super::settle::{Method, Model, Progress};
use super::sheet::Sheet;
use super::{Shape, SkinError};
use crate::contact::Surface;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::greatest;
use crate::mesh::{Topology, TriangleMesh};

/// Default edges are the base over this.
pub(super) const FINE: f64 = 20.0;

/// Most vertices in one layer of a region.
pub(super) const MOST: f64 = 1e5;

/// Least vertices of a region that can move.
const LEAST: usize = 20;

/// The region ends where the skin turns further than this from the normal of the middle [degrees]: there it is no longer
/// over the implant.
const TURN: f64 = 70.0;

/// The region does not end nearer to the base than this, in its outlines.
const NEAR: f64 = 1.1;

/// So much of the skin over the implant may turn further than that.
const FOLDED: f64 = 0.05;

/// Over an obstacle the lower layer takes at most this share of the room.
const ROOM: f64 = 0.98;

/// An obstacle under an implant is at most so many bases below the skin.
const DEEPEST: f64 = 2.0;

/// A smaller base is said to fit with so much to spare.
const SURELY: f64 = 0.95;

/// Where an implant goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// Under a vertex.
    Vertex(usize),
    /// Under the point of the skin nearest to this one [m].
    Point(Point3<f64>),
}

/// An implant and where it goes.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    /// Where.
    pub place: Place,
    /// What.
    pub implant: Implant,
    /// Direction of its longer side, as far as it is along the skin.
    pub long: Option<Vector3<f64>>,
    /// The skin over it.
    pub tissue: Tissue,
    /// Wanted edge length [m]; `None`: the base over 20.
    pub edge: Option<f64>,
}

impl Order {
    /// A round implant under skin as assumed by default.
    pub fn round(place: Place, base: f64, volume: f64) -> Self {
        let implant = Implant { shape: Shape::Round, base, volume, membrane: super::implant::SILICONE };
        Self { place, implant, long: None, tissue: Tissue::default(), edge: None }
    }
}

/// Skin made ready for an implant of any volume.
#[derive(Clone, Debug)]
pub struct Ready {
    /// The order.
    pub order: Order,
    /// The part of the skin that was taken out and refined.
    pub patch: TriangleMesh,
    /// Triangles of the skin that are not in the patch.
    pub outside: Vec<u32>,
    /// The region within the patch.
    pub region: Region,
    /// Both layers.
    pub layers: Layers,
    /// Frame of the implant: z out of the body.
    pub frame: Isometry3<f64>,
    /// How equilibrium is sought; `None`: by the number of unknowns.
    pub method: Option<Method>,
    pub(super) obstacles: Vec<Sheet>,
    pub(super) coarser: OnceLock<Option<Box<Ready>>>,
}

/// Skin over an implant.
#[derive(Clone, Debug)]
pub struct Inserted {
    /// Positions of both layers, then of the implant [m].
    pub x: Vec<Point3<f64>>,
    /// Triangles of the implant, from 0.
    pub implant_triangles: Vec<[u32; 3]>,
    /// Its volume [m^3].
    pub implant_volume: f64,
    /// What was measured.
    pub areas: Areas,
    /// How it was found.
    pub progress: Progress,
}

/// Inserts one implant.
///
/// # Errors
/// See [`SkinError`].
pub fn insert(
    skin: &TriangleMesh,
    order: &Order,
    obstacles: &[TriangleMesh],
    watch: impl FnMut(&Progress) -> bool,
) -> Result<(Ready, Inserted), SkinError> {
    let ready = Ready::new(skin, order, obstacles)?;
    let inserted = ready.insert(order.implant.volume, watch)?;
    Ok((ready, inserted))
}

impl Ready {
    /// Chooses the region, refines it, builds both layers. Without obstacles the implant rests on what was under the
    /// lower layer before.
    ///
    /// # Errors
    /// See [`SkinError`].
    pub fn new(skin: &TriangleMesh, order: &Order, obstacles: &[TriangleMesh]) -> Result<Self, SkinError> {
        Self::new_while(skin, order, obstacles, &|| true)
    }

    /// The same, as long as `go_on` says so: it is asked while skin is refined, which takes seconds where it is large.
    ///
    /// # Errors
    /// See [`SkinError`].
    pub fn new_while(
        skin: &TriangleMesh,
        order: &Order,
        obstacles: &[TriangleMesh],
        go_on: &dyn Fn() -> bool,
    ) -> Result<Self, SkinError> {
        order.check()?;
        let edge = order.edge();
        let radius = REACH * 0.5 * order.implant.base;
        let vertices = std::f64::consts::PI * radius * radius / (EVEN * edge * edge);
        if vertices > MOST {
            return Err(SkinError::TooFine { vertices, most: MOST });
        }
        let (centre, seed) = middle(skin, order)?;
        order.check_obstacles(skin, &centre, obstacles)?;
        let patch = Patch { skin, seed, centre, radius: radius * MARGIN, edge, obstacles };
        let TakenOut { mesh: patch, outside, at_border } = patch.taken_out(go_on)?;
        let topology = Topology::new(&patch);
        let seed = nearest_vertex(&patch, &centre);
        let normal = patch.vertex_normals()[seed as usize];
        let mut frame = frame(&centre, &normal, order.long.as_ref());
        let mut region = around(&patch, &topology, seed, order, &frame);
        // Once more with the mean normal of the region: that of one vertex is a matter of chance.
        let normals = region.mesh.triangles.iter().map(|t| normal_of(&region.mesh, t));
        let mean = normals.fold(Vector3::zeros(), |sum, n| sum + n);
        frame = self::frame(&centre, &mean, order.long.as_ref());
        region = around(&patch, &topology, seed, order, &frame);
        check_region(&region, &patch, &topology, order, &frame).map_err(|error| match error {
            // Of closed skin only what turns away reaches as far as where the patch was cut off.
            SkinError::AtBorder { .. } if !at_border => {
                SkinError::TooCurved { degrees: greatest(turns(&region.mesh, &frame)) }
            }
            other => other,
        })?;
        let inward = inward(&region.mesh, &(frame * -Vector3::z()), order.tissue.depth, obstacles);
        let layers = Layers::new(&region, &order.tissue, &inward);
        let free = layers.held.iter().filter(|held| !**held).count() / 2;
        if free < LEAST {
            return Err(SkinError::TooCoarse { vertices: free });
        }
        if !obstacles.is_empty() && !lies_below(&layers, &frame, order, obstacles) {
            return Err(SkinError::NothingBelow);
        }
        let facing = |o: &TriangleMesh| Sheet::facing(o.clone(), &layers.rest, 2.0 * order.implant.base);
        let obstacles = obstacles.iter().map(facing).collect();
        let coarser = OnceLock::new();
        Ok(Self { order: order.clone(), patch, outside, region, layers, frame, method: None, obstacles, coarser })
    }

    /// Brings the skin to rest over the implant filled with `volume` [m^3].
    ///
    /// # Errors
    /// An implant that is larger than the region, equations without a solution, [`SkinError::Stopped`].
    pub fn insert(&self, volume: f64, watch: impl FnMut(&Progress) -> bool) -> Result<Inserted, SkinError> {
        self.insert_after(None, volume, watch)
    }

    /// The same, begun from an earlier result of this skin with another volume: fewer rounds to the same place.
    ///
    /// # Errors
    /// See [`Ready::insert`].
    pub fn insert_after(
        &self,
        earlier: Option<&Inserted>,
        volume: f64,
        mut watch: impl FnMut(&Progress) -> bool,
    ) -> Result<Inserted, SkinError> {
        self.begun(earlier, volume, &mut watch)
    }

    pub(super) fn begun(
        &self,
        earlier: Option<&Inserted>,
        volume: f64,
        watch: &mut dyn FnMut(&Progress) -> bool,
    ) -> Result<Inserted, SkinError> {
        let (model, start) = self.model(volume)?;
        let (likely, before) = match earlier {
            Some(earlier) => (Some(self.further(earlier, &start)?), 0),
            None => self.coarsely(volume, &start, watch)?,
        };
        let fresh = likely.is_some();
        let mut x = likely.unwrap_or_else(|| start.clone());
        let mut progress = model.settle(&mut x, &mut *watch)?;
        if fresh && !progress.converged {
            // It began too far away.
            x = start;
            let done = progress.iterations;
            progress = model.settle(&mut x, watch)?;
            progress.iterations += done;
        }
        progress.iterations += before;
        let implant_triangles = model.implants.first().map(|i| i.mesh.triangles.clone()).unwrap_or_default();
        let shell = &x[2 * self.layers.count()..];
        let implant_volume = crate::mesh::measures::volume(shell, &implant_triangles);
        let areas = Areas::of(&self.layers, &x);
        Ok(Inserted { implant_triangles, implant_volume, areas, progress, x })
    }

    /// The largest volume [m^3] whose dome does not bulge too far beyond its base.
    pub fn largest(&self) -> f64 {
        self.order.implant.largest(self.layers.edge)
    }

    /// Whether something of the lower layer or of the implant is under an obstacle, and how far [m].
    pub fn depth_in(&self, obstacles: &[TriangleMesh], x: &[Point3<f64>]) -> f64 {
        let surfaces: Vec<Surface> = obstacles.iter().map(Surface::new).collect();
        let free = (0..x.len()).filter(|v| !self.layers.held.get(*v).copied().unwrap_or(false));
        let depth = |v: usize| {
            let each = surfaces.iter().filter_map(|s| s.nearest(&x[v], self.order.implant.base));
            greatest(each.map(|on| (-on.closest.distance).max(0.0)))
        };
        greatest(free.map(depth))
    }
}

/// The place on the skin and a vertex near it.
pub(super) fn middle(skin: &TriangleMesh, order: &Order) -> Result<(Point3<f64>, u32), SkinError> {
    if skin.triangles.is_empty() {
        return Err(SkinError::Empty);
    }
    let count = skin.vertices.len();
    match order.place {
        Place::Vertex(vertex) => {
            let used = vertex < count && skin.triangles.iter().flatten().any(|v| *v as usize == vertex);
            let at = skin.vertices.get(vertex).filter(|_| used).ok_or(SkinError::NoVertex { vertex, count })?;
            Ok((*at, vertex as u32))
        }
        Place::Point(point) => {
            if !point.coords.iter().all(|c| c.is_finite()) {
                return Err(SkinError::NotPositive { what: "the distance of --at to the skin", value: f64::NAN });
            }
            let tree = SurfaceTree::new(&skin.vertices, &skin.triangles);
            let closest = tree.closest(&point, f64::INFINITY).ok_or(SkinError::Empty)?;
            if closest.distance > 0.5 * order.implant.base {
                return Err(SkinError::FarAway { distance: closest.distance });
            }
            let corners = skin.triangles[closest.triangle as usize];
            let far = |v: u32| (skin.vertices[v as usize] - closest.point).norm();
            let near = corners.into_iter().min_by(|a, b| far(*a).total_cmp(&far(*b)));
            Ok((closest.point, near.unwrap_or(corners[0])))
        }
    }
}

pub(super) fn nearest_vertex(mesh: &TriangleMesh, at: &Point3<f64>) -> u32 {
    let far = |v: &u32| (mesh.vertices[*v as usize] - at).norm_squared();
    (0..mesh.vertices.len() as u32).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0)
}

pub(super) fn normal_of(mesh: &TriangleMesh, t: &[u32; 3]) -> Vector3<f64> {
    let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
    (b - a).cross(&(c - a))
}

/// The region by the rule: every triangle with a vertex within [`REACH`] times the base's outline; beyond [`NEAR`] times only as
/// far as the skin does not turn away.
fn around(mesh: &TriangleMesh, topology: &Topology, seed: u32, order: &Order, frame: &Isometry3<f64>) -> Region {
    let (reach, turn) = (reaches(mesh, order, frame), turns(mesh, frame));
    // Rounding must not decide about vertices just at the limit.
    let within = |v: usize| reach[v] <= REACH * (1.0 + 1e-9);
    let mut inside: Vec<bool> = (0..reach.len()).map(|v| within(v) && (turn[v] <= TURN || reach[v] <= NEAR)).collect();
    // What turns away but is joined to nothing beyond is a fold within the region.
    let mut beyond: Vec<bool> = (0..reach.len()).map(|v| !within(v)).collect();
    let mut open: Vec<usize> = (0..reach.len()).filter(|v| beyond[*v]).collect();
    while let Some(v) = open.pop() {
        for w in topology.triangles_of_vertex(v).iter().flat_map(|t| mesh.triangles[*t as usize]) {
            if !inside[w as usize] && !std::mem::replace(&mut beyond[w as usize], true) {
                open.push(w as usize);
            }
        }
    }
    inside.iter_mut().zip(beyond).for_each(|(inside, beyond)| *inside |= !beyond);
    Region::around(mesh, topology, seed, |v| inside[v as usize])
}

/// How far each vertex is from the middle, 1 on the outline of the base.
fn reaches(mesh: &TriangleMesh, order: &Order, frame: &Isometry3<f64>) -> Vec<f64> {
    let Implant { shape, base, .. } = order.implant;
    mesh.vertices.iter().map(|p| shape.reach(frame.inverse_transform_point(p).xy(), base)).collect()
}

/// The angle of the skin at each vertex to the normal of the middle [degrees].
fn turns(mesh: &TriangleMesh, frame: &Isometry3<f64>) -> Vec<f64> {
    let z = frame * Vector3::z();
    let turn = |n: &Vector3<f64>| libm::atan2(n.cross(&z).norm(), n.dot(&z)).to_degrees();
    mesh.vertex_normals().iter().map(turn).collect()
}

/// The longest base of which the region does not touch the border of the skin, over the present one: no triangle at the border
/// has a vertex inside.
fn fits(patch: &TriangleMesh, topology: &Topology, reach: &[f64]) -> f64 {
    let at_border = topology.boundary_edges();
    let triangles = at_border.iter().flat_map(|e| topology.triangles_of_edge(*e as usize));
    let nearest = triangles.flat_map(|t| patch.triangles[*t as usize]).map(|v| reach[v as usize]);
    // Finer triangles, as a smaller base asks for, lie nearer to the border; the rest is for the mean normal, which changes.
    SURELY * nearest.fold(f64::INFINITY, f64::min) / REACH
}

fn check_region(
    region: &Region,
    patch: &TriangleMesh,
    topology: &Topology,
    order: &Order,
    frame: &Isometry3<f64>,
) -> Result<(), SkinError> {
    let mut sides = vec![false; topology.edges.len()];
    region
        .triangles
        .iter()
        .for_each(|t| topology.triangle_edges[*t as usize].iter().for_each(|e| sides[*e as usize] = true));
    let edges = topology.boundary_edges().into_iter().filter(|e| sides[*e as usize]).count();
    let (reach, turn) = (reaches(patch, order, frame), turns(patch, frame));
    if edges > 0 {
        return Err(SkinError::AtBorder { edges, fits: fits(patch, topology, &reach) * order.implant.base });
    }
    // Under the implant the skin may have folds, but not turn away as a whole.
    let mut areas = (0.0, 0.0, 0.0f64);
    for t in region
        .triangles
        .iter()
        .map(|t| patch.triangles[*t as usize])
        .filter(|t| t.iter().all(|v| reach[*v as usize] <= NEAR))
    {
        let area = normal_of(patch, &t).norm();
        let degrees = greatest(t.iter().map(|v| turn[*v as usize]));
        areas = (areas.0 + area, areas.1 + if degrees > TURN { area } else { 0.0 }, areas.2.max(degrees));
    }
    if areas.1 > FOLDED * areas.0 {
        return Err(SkinError::TooCurved { degrees: areas.2 });
    }
    Ok(())
}

/// From each vertex to the one under it [m]: by `depth` along one direction for all, so that nothing folds, but not into an
/// obstacle.
fn inward(mesh: &TriangleMesh, down: &Vector3<f64>, depth: f64, obstacles: &[TriangleMesh]) -> Vec<Vector3<f64>> {
    let surfaces: Vec<SurfaceTree> = obstacles.iter().map(|o| SurfaceTree::new(&o.vertices, &o.triangles)).collect();
    let room = |p: &Point3<f64>| {
        let each = surfaces.iter().filter_map(|s| s.closest(p, 2.0 * depth)).map(|c| c.distance);
        each.fold(f64::INFINITY, f64::min)
    };
    mesh.vertices.iter().map(|p| down * depth.min(ROOM * room(p)).max(0.02 * depth)).collect()
}

/// Whether an obstacle is under the skin over the implant, at most two bases down: one that is elsewhere would bear nothing,
/// and the implant would sink into the body.
fn lies_below(layers: &Layers, frame: &Isometry3<f64>, order: &Order, obstacles: &[TriangleMesh]) -> bool {
    let Implant { shape, base, .. } = order.implant;
    let down = frame * -Vector3::z();
    let skin = &layers.rest[..layers.count()];
    let over = |p: &&Point3<f64>| shape.reach(frame.inverse_transform_point(p).xy(), base) <= 1.0;
    obstacles.iter().map(Surface::new).any(|o| {
        let hit = |p: &Point3<f64>| {
            let (t, w) = o.first_hit(p, &down)?;
            let corners = o.triangles()[t as usize].map(|v| o.positions()[v as usize].coords);
            let place = corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
            Some((place - p.coords).norm())
        };
        skin.iter().filter(over).filter_map(hit).any(|far| far <= DEEPEST * base)
    })
}

/// A sheet that a rigid sphere pushes from below.
pub fn over_ball(layers: Layers, membrane: f64, centre: Point3<f64>, radius: f64, method: Method) -> Model {
    Model {
        layers,
        membrane,
        implants: Vec::new(),
        beds: Vec::new(),
        ball: Some((centre, radius)),
        base: 2.0 * radius,
        method,
    }
}
