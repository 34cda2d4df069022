//! The planner's question: an implant at a place of a skin, and what it does there.

use std::sync::OnceLock;

use nalgebra::{Isometry3, Point3, Vector3};

use super::areas::Areas;
use super::implant::Implant;
use super::layers::{Layers, Tissue};
use super::patch::{Patch, nearest_vertex, normal_of, patch};
use super::region::{REACH, Region, frame};
use super::settle::{Method, Model, Progress};
use super::sheet::Sheet;
use super::whole::rim;
use super::{Shape, SkinError};
use crate::contact::Surface;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::greatest;
use crate::mesh::{Topology, TriangleMesh};

/// Default edges are the base over this.
const FINE: f64 = 20.0;

/// The patch that is refined reaches so much further than the region, in its radii.
const MARGIN: f64 = 1.25;

/// Most vertices in one layer of a region.
const MOST: f64 = 1e5;

/// Bases that are tried in search of one that fits, each so many times the one before.
const TRIES: u32 = 10;
const SMALLER: f64 = 0.85;

/// Least vertices of a region that can move.
const LEAST: usize = 20;

/// The region ends where the skin turns further than this from the normal of the middle [degrees]: there it is no longer
/// over the implant.
const TURN: f64 = 70.0;

/// The region does not end nearer to the base than this, in its outlines.
const NEAR: f64 = 1.1;

/// So much of the skin over the implant may turn further than that.
const FOLDED: f64 = 0.05;

/// A dome may be so many times as wide as its base.
pub(super) const BULGE: f64 = 1.3;

/// Over an obstacle the lower layer takes at most this share of the room.
const ROOM: f64 = 0.98;

/// An obstacle under an implant is at most so many bases below the skin.
const DEEPEST: f64 = 2.0;

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
    /// The vertex of the skin that each vertex of the patch is, `u32::MAX` for one that is of the patch only.
    pub origin: Vec<u32>,
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
        order.implant.check()?;
        order.tissue.check()?;
        let edge = order.edge.unwrap_or(order.implant.base / FINE);
        SkinError::positive("the edge length", edge)?;
        let radius = REACH * 0.5 * order.implant.base;
        let vertices = std::f64::consts::PI * radius * radius / (0.866 * edge * edge);
        if vertices > MOST {
            return Err(SkinError::TooFine { vertices, most: MOST });
        }
        let Placed { patch, region, frame } = placed(skin, order, edge, obstacles)?;
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
        let Patch { mesh: patch, outside, origin, .. } = patch;
        let order = order.clone();
        Ok(Self { order, patch, outside, origin, region, layers, frame, method: None, obstacles, coarser })
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
        let implant_triangles = model.implant.as_ref().map(|i| i.mesh.triangles.clone()).unwrap_or_default();
        let shell = &x[2 * self.layers.count()..];
        let implant_volume = crate::mesh::measures::volume(shell, &implant_triangles);
        let areas = Areas::of(&self.layers, &x);
        Ok(Inserted { implant_triangles, implant_volume, areas, progress, x })
    }

    /// The largest volume [m^3] whose dome does not bulge too far beyond its base.
    ///
    /// # Errors
    /// See [`Implant::dome`].
    pub fn largest(&self) -> Result<f64, SkinError> {
        let base = self.order.implant.base;
        let (mut low, mut high) = (0.0, 10.0 * base * base * base);
        for _ in 0..40 {
            let implant = Implant { volume: 0.5 * (low + high), ..self.order.implant };
            let fits = implant.bulge(&implant.dome(self.layers.edge)?) <= BULGE;
            if fits { low = implant.volume } else { high = implant.volume }
        }
        Ok(low)
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

/// A region and the patch that it is in.
struct Placed {
    patch: Patch,
    region: Region,
    frame: Isometry3<f64>,
}

/// Finds the region of an order in skin with edges of at most about `edge` [m].
fn placed(skin: &TriangleMesh, order: &Order, edge: f64, obstacles: &[TriangleMesh]) -> Result<Placed, SkinError> {
    match found(skin, order, edge, obstacles) {
        Err(SkinError::WrapsAround { base, .. }) => {
            Err(SkinError::WrapsAround { base, fits: fitting(skin, order, obstacles) })
        }
        Err(SkinError::TooCurved { degrees, .. }) => {
            Err(SkinError::TooCurved { degrees, fits: fitting(skin, order, obstacles) })
        }
        other => other,
    }
}

fn found(skin: &TriangleMesh, order: &Order, edge: f64, obstacles: &[TriangleMesh]) -> Result<Placed, SkinError> {
    let (centre, seed) = middle(skin, order)?;
    let patch = patch(skin, seed, &centre, REACH * 0.5 * order.implant.base * MARGIN, edge, obstacles)?;
    let topology = Topology::new(&patch.mesh);
    let seed = nearest_vertex(&patch.mesh, &centre);
    let normal = patch.mesh.vertex_normals()[seed as usize];
    let mut frame = frame(&centre, &normal, order.long.as_ref());
    let mut region = around(&patch.mesh, &topology, seed, order, &frame);
    // Once more with the mean normal of the region: that of one vertex is a matter of chance.
    let normals = region.mesh.triangles.iter().map(|t| normal_of(&region.mesh, t));
    let mean = normals.fold(Vector3::zeros(), |sum, n| sum + n);
    frame = self::frame(&centre, &mean, order.long.as_ref());
    region = around(&patch.mesh, &topology, seed, order, &frame);
    check_region(&region, &patch, &topology, order, &frame)?;
    Ok(Placed { patch, region, frame })
}

/// A smaller base of the same shape that goes there [m], in whole millimetres where it has some; `None` if none was found.
fn fitting(skin: &TriangleMesh, order: &Order, obstacles: &[TriangleMesh]) -> Option<f64> {
    let mut base = order.implant.base;
    for _ in 0..TRIES {
        base *= SMALLER;
        let round = (base * 1e3).floor() * 1e-3;
        let smaller = Order {
            implant: Implant { base: if round > 0.0 { round } else { base }, ..order.implant },
            ..order.clone()
        };
        let base = smaller.implant.base;
        if found(skin, &smaller, order.edge.unwrap_or(base / FINE), obstacles).is_ok() {
            return Some(base);
        }
    }
    None
}

/// The place on the skin and a vertex near it.
fn middle(skin: &TriangleMesh, order: &Order) -> Result<(Point3<f64>, u32), SkinError> {
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

fn check_region(
    region: &Region,
    Patch { mesh: patch, origin, border, .. }: &Patch,
    topology: &Topology,
    order: &Order,
    frame: &Isometry3<f64>,
) -> Result<(), SkinError> {
    let mut sides = vec![false; topology.edges.len()];
    region
        .triangles
        .iter()
        .for_each(|t| topology.triangle_edges[*t as usize].iter().for_each(|e| sides[*e as usize] = true));
    if topology.boundary_edges().into_iter().any(|e| sides[e as usize]) {
        let chains = rim(patch, topology, origin);
        let of_skin = chains.iter().filter(|c| border.contains(&[c.ends[0].min(c.ends[1]), c.ends[0].max(c.ends[1])]));
        let reached = |pair: &[u32]| topology.find_edge(pair[0], pair[1]).is_some_and(|e| sides[e as usize]);
        let edges = of_skin.flat_map(|c| c.vertices.windows(2)).filter(|pair| reached(pair)).count();
        // The rim of the patch is reached only by skin that goes down beside the implant.
        return Err(if edges > 0 {
            SkinError::AtBorder { edges }
        } else {
            SkinError::WrapsAround { base: order.implant.base, fits: None }
        });
    }
    // Under the implant the skin may have folds, but not turn away as a whole.
    let (reach, turn) = (reaches(patch, order, frame), turns(patch, frame));
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
        return Err(SkinError::TooCurved { degrees: areas.2, fits: None });
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
        implant: None,
        beds: Vec::new(),
        ball: Some((centre, radius)),
        base: 2.0 * radius,
        method,
    }
}
