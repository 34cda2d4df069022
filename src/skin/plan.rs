//! The planner's question: an implant at a place of a skin, and what it does there.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::OnceLock;

use nalgebra::{Isometry3, Point2, Point3, Vector3};

use super::areas::Areas;
use super::implant::Implant;
use super::layers::{Layers, Tissue};
use super::patch::{EVEN, MARGIN, Patch, TakenOut};
use super::region::{REACH, Region, frame};
use super::settle::{Filled, Method, Model, Progress};
use super::sheet::Sheet;
use super::start::Begin;
use super::{Shape, SkinError};
use crate::contact::Surface;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::{greatest, volume};
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

/// Places on the outline of a base that are looked at.
const OUTLINE: u32 = 72;

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

/// An implant that shares skin with the first one.
#[derive(Clone, Debug)]
pub struct Site {
    /// The order.
    pub order: Order,
    /// Its frame: z out of the body.
    pub frame: Isometry3<f64>,
}

/// Skin made ready for an implant of any volume, or for several that share it.
#[derive(Clone, Debug)]
pub struct Ready {
    /// The order of the first implant.
    pub order: Order,
    /// The part of the skin that was taken out and refined.
    pub patch: TriangleMesh,
    /// Triangles of the skin that are not in the patch.
    pub outside: Vec<u32>,
    /// The region within the patch.
    pub region: Region,
    /// Both layers.
    pub layers: Layers,
    /// Frame of the first implant: z out of the body.
    pub frame: Isometry3<f64>,
    /// The other implants.
    pub others: Vec<Site>,
    /// How equilibrium is sought; `None`: by the number of unknowns.
    pub method: Option<Method>,
    pub(super) obstacles: Vec<Sheet>,
    pub(super) coarser: OnceLock<Option<Box<Ready>>>,
}

/// The shell of an implant as it came to lie.
#[derive(Clone, Debug, PartialEq)]
pub struct Shell {
    /// Its vertices among the positions.
    pub vertices: Range<usize>,
    /// Its triangles, from 0.
    pub triangles: Vec<[u32; 3]>,
    /// Its volume [m^3].
    pub volume: f64,
    /// The pressure in it [Pa].
    pub pressure: f64,
}

/// Skin over its implants.
#[derive(Clone, Debug)]
pub struct Inserted {
    /// Positions of both layers, then of each implant [m].
    pub x: Vec<Point3<f64>>,
    /// Each implant.
    pub shells: Vec<Shell>,
    /// What was measured.
    pub areas: Areas,
    /// The gain with edges twice as long [m^2]; `None` where that was not found on the way.
    pub coarse_gain: Option<f64>,
    /// How it was found.
    pub progress: Progress,
}

impl Inserted {
    /// Volume of all implants [m^3].
    pub fn volume(&self) -> f64 {
        self.shells.iter().map(|shell| shell.volume).sum()
    }

    /// Volume of each implant [m^3].
    pub fn volumes(&self) -> Vec<f64> {
        self.shells.iter().map(|shell| shell.volume).collect()
    }

    /// Positions of a shell [m].
    pub fn shell_at(&self, shell: &Shell) -> &[Point3<f64>] {
        &self.x[shell.vertices.clone()]
    }

    /// What the gain may be off because edges are as long as they are [m^2]: as much as it changed from edges twice as long.
    pub fn gain_uncertainty(&self) -> Option<f64> {
        self.coarse_gain.map(|coarse| (self.areas.gain() - coarse).abs())
    }
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
        Self::together(skin, order, &[], obstacles, go_on)
    }

    /// The same for an implant and others that share skin with it: the region is all that one of them needs.
    ///
    /// # Errors
    /// See [`SkinError`].
    pub fn together(
        skin: &TriangleMesh,
        first: &Order,
        others: &[Order],
        obstacles: &[TriangleMesh],
        go_on: &dyn Fn() -> bool,
    ) -> Result<Self, SkinError> {
        let orders: Vec<&Order> = [first].into_iter().chain(others).collect();
        orders.iter().try_for_each(|order| order.check())?;
        let edge = shared_edge(&orders);
        let radius = |order: &Order| REACH * 0.5 * order.implant.base;
        let area: f64 = orders.iter().map(|order| std::f64::consts::PI * radius(order) * radius(order)).sum();
        let vertices = area / (EVEN * edge * edge);
        if vertices > MOST {
            return Err(SkinError::TooFine { vertices, most: MOST });
        }
        let mut places = Vec::new();
        for order in &orders {
            let (centre, seed) = middle(skin, order)?;
            order.check_obstacles(skin, &centre, obstacles)?;
            places.push((seed, centre, radius(order) * MARGIN));
        }
        let patch = Patch { skin, places, edge, obstacles };
        let centres: Vec<Point3<f64>> = patch.places.iter().map(|(_, centre, _)| *centre).collect();
        let taken = patch.taken_out(go_on)?;
        let topology = Topology::new(&taken.mesh);
        let (mut sites, mut triangles) = (Vec::new(), BTreeSet::new());
        for (order, centre) in orders.into_iter().zip(&centres) {
            let (region, frame) = placed(&taken, &topology, order, centre)?;
            triangles.extend(region.triangles);
            sites.push(Site { order: order.clone(), frame });
        }
        apart(&sites)?;
        let region = Region::of(&taken.mesh, triangles.into_iter().collect());
        Self::over(taken, region, sites, obstacles)
    }

    /// Both layers of a region, over what lies below.
    fn over(
        TakenOut { mesh: patch, outside, .. }: TakenOut,
        region: Region,
        mut sites: Vec<Site>,
        obstacles: &[TriangleMesh],
    ) -> Result<Self, SkinError> {
        let each: Vec<(&Order, &Isometry3<f64>)> = sites.iter().map(|s| (&s.order, &s.frame)).collect();
        let downs = downs(&region.mesh.vertices, &each);
        let tissue = sites[0].order.tissue;
        let layers = Layers::new(&region, &tissue, &inward(&region.mesh, &downs, tissue.depth, obstacles));
        let free = layers.held.iter().filter(|held| !**held).count() / 2;
        if free < LEAST {
            return Err(SkinError::TooCoarse { vertices: free });
        }
        if !obstacles.is_empty() && !sites.iter().all(|s| lies_below(&layers, &s.frame, &s.order, obstacles)) {
            return Err(SkinError::NothingBelow);
        }
        let longest = greatest(sites.iter().map(|s| s.order.implant.base));
        let facing = |o: &TriangleMesh| Sheet::facing(o.clone(), &layers.rest, 2.0 * longest);
        let obstacles = obstacles.iter().map(facing).collect();
        let Site { order, frame } = sites.remove(0);
        let (others, coarser) = (sites, OnceLock::new());
        Ok(Self { order, patch, outside, region, layers, frame, others, method: None, obstacles, coarser })
    }

    /// Each implant: its order and its frame.
    pub fn sites(&self) -> impl Iterator<Item = (&Order, &Isometry3<f64>)> {
        [(&self.order, &self.frame)].into_iter().chain(self.others.iter().map(|s| (&s.order, &s.frame)))
    }

    /// The volume of each implant, as ordered [m^3].
    pub fn volumes(&self) -> Vec<f64> {
        self.sites().map(|(order, _)| order.implant.volume).collect()
    }

    /// Brings the skin to rest over the implant filled with `volume` [m^3].
    ///
    /// # Errors
    /// An implant that is larger than the region, equations without a solution, [`SkinError::Stopped`].
    pub fn insert(&self, volume: f64, watch: impl FnMut(&Progress) -> bool) -> Result<Inserted, SkinError> {
        self.insert_after(None, &[volume], watch)
    }

    /// The same with a volume [m^3] for each implant, begun from an earlier result of this skin with others: fewer rounds to
    /// the same place.
    ///
    /// # Errors
    /// See [`Ready::insert`].
    pub fn insert_after(
        &self,
        earlier: Option<&Inserted>,
        volumes: &[f64],
        mut watch: impl FnMut(&Progress) -> bool,
    ) -> Result<Inserted, SkinError> {
        self.begun(earlier, volumes, &mut watch)
    }

    pub(super) fn begun(
        &self,
        earlier: Option<&Inserted>,
        volumes: &[f64],
        watch: &mut dyn FnMut(&Progress) -> bool,
    ) -> Result<Inserted, SkinError> {
        let (model, start) = self.model(volumes)?;
        let Begin { likely, iterations, coarse_gain } = match earlier {
            Some(earlier) => Begin { likely: Some(self.further(earlier, &start)?), ..Begin::default() },
            None => self.coarsely(volumes, &start, watch)?,
        };
        let fresh = likely.is_some();
        let mut x = likely.unwrap_or_else(|| start.clone());
        let (mut progress, mut pressures) = model.settle_each(&mut x, &mut *watch)?;
        if fresh && !progress.converged {
            // It began too far away.
            x = start;
            let done = progress.iterations;
            (progress, pressures) = model.settle_each(&mut x, watch)?;
            progress.iterations += done;
        }
        progress.iterations += iterations;
        let shell = |((implant, first), pressure): ((&Filled, u32), f64)| {
            let first = first as usize;
            let vertices = first..first + implant.mesh.vertices.len();
            let triangles = implant.mesh.triangles.clone();
            Shell { volume: volume(&x[vertices.clone()], &triangles), vertices, triangles, pressure }
        };
        let shells = model.implants.iter().zip(model.firsts()).zip(pressures).map(shell).collect();
        let areas = Areas::of(&self.layers, &x);
        Ok(Inserted { shells, areas, progress, coarse_gain, x })
    }

    /// The largest volume [m^3] of the first implant whose dome does not bulge too far beyond its base.
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

/// Edges that serve all orders [m]: the longest asked for, but at most twice the shortest, or a small implant beside a large one
/// would ask for many times the vertices.
fn shared_edge(orders: &[&Order]) -> f64 {
    let all = || orders.iter().map(|order| order.edge());
    let (shortest, longest) = (all().fold(f64::INFINITY, f64::min), greatest(all()));
    longest.min(2.0 * shortest)
}

/// The region of an implant in a patch, and its frame.
fn placed(
    taken: &TakenOut,
    topology: &Topology,
    order: &Order,
    centre: &Point3<f64>,
) -> Result<(Region, Isometry3<f64>), SkinError> {
    let patch = &taken.mesh;
    let seed = nearest_vertex(patch, centre);
    let normal = patch.vertex_normals()[seed as usize];
    let mut frame = frame(centre, &normal, order.long.as_ref());
    let mut region = around(patch, topology, seed, order, &frame);
    // Once more with the mean normal of the region: that of one vertex is a matter of chance.
    let normals = region.mesh.triangles.iter().map(|t| normal_of(&region.mesh, t));
    let mean = normals.fold(Vector3::zeros(), |sum, n| sum + n);
    frame = self::frame(centre, &mean, order.long.as_ref());
    region = around(patch, topology, seed, order, &frame);
    check_region(&region, patch, topology, order, &frame).map_err(|error| match error {
        // Of closed skin only what turns away reaches as far as where the patch was cut off.
        SkinError::AtBorder { .. } if !taken.at_border => {
            SkinError::TooCurved { degrees: greatest(turns(&region.mesh, &frame)) }
        }
        other => other,
    })?;
    Ok((region, frame))
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

/// Refuses implants that would begin in one another: the outline of one base reaches into another.
fn apart(sites: &[Site]) -> Result<(), SkinError> {
    let into = |a: &Site, b: &Site| {
        let (own, other) = (a.order.implant, b.order.implant);
        (0..OUTLINE).any(|k| {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(OUTLINE);
            let at = own.shape.place(Point2::new(libm::cos(angle), libm::sin(angle)), own.base);
            let at = b.frame.inverse_transform_point(&(a.frame * Point3::new(at.x, at.y, 0.0)));
            // One far below or above is on another side of the body.
            at.z.abs() <= 0.5 * other.base && other.shape.reach(at.xy(), other.base) < 1.0 - 1e-9
        })
    };
    for (k, b) in sites.iter().enumerate() {
        if let Some(j) = sites[..k].iter().position(|a| into(a, b) || into(b, a)) {
            return Err(SkinError::Overlap { first: j + 1, second: k + 1 });
        }
    }
    Ok(())
}

/// Which way is down at each place: along one direction for all of an implant's skin, so that nothing folds; between several
/// implants that of the nearer one counts more, by the fourth power of how near.
pub(super) fn downs(places: &[Point3<f64>], sites: &[(&Order, &Isometry3<f64>)]) -> Vec<Vector3<f64>> {
    let down = |frame: &Isometry3<f64>| frame * -Vector3::z();
    if let [(_, frame)] = sites {
        return vec![down(frame); places.len()];
    }
    let at = |p: &Point3<f64>| {
        let weighted = sites.iter().map(|(order, frame)| {
            let Implant { shape, base, .. } = order.implant;
            // Not without bound in the middle.
            let reach = shape.reach(frame.inverse_transform_point(p).xy(), base).max(0.1);
            down(frame) / reach.powi(4)
        });
        let sum = weighted.fold(Vector3::zeros(), |sum, d| sum + d);
        sum.try_normalize(0.0).unwrap_or_else(|| down(sites[0].1))
    };
    places.iter().map(at).collect()
}

/// From each vertex to the one under it [m]: by `depth`, but not into an obstacle.
fn inward(mesh: &TriangleMesh, downs: &[Vector3<f64>], depth: f64, obstacles: &[TriangleMesh]) -> Vec<Vector3<f64>> {
    let surfaces: Vec<SurfaceTree> = obstacles.iter().map(|o| SurfaceTree::new(&o.vertices, &o.triangles)).collect();
    let room = |p: &Point3<f64>| {
        let each = surfaces.iter().filter_map(|s| s.closest(p, 2.0 * depth)).map(|c| c.distance);
        each.fold(f64::INFINITY, f64::min)
    };
    mesh.vertices.iter().zip(downs).map(|(p, down)| down * depth.min(ROOM * room(p)).max(0.02 * depth)).collect()
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
