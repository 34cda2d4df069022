//! The planner's question: an implant at a place of a skin, and what it does there.

use nalgebra::{Isometry3, Point3, Vector3};

use super::areas::Areas;
use super::implant::{Implant, upper};
use super::layers::{Layers, Tissue};
use super::region::{REACH, Region, frame};
use super::settle::{Filled, Method, Model, Progress};
use super::{Shape, SkinError};
use crate::contact::Surface;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::greatest;
use crate::mesh::orientation::Orientation;
use crate::mesh::{Topology, TriangleMesh, refine};

/// Default edges are the base over this.
const FINE: f64 = 20.0;

/// Skin whose median edge is at most this many times the wanted one is taken as it is.
const ENOUGH: f64 = 1.25;

/// The patch that is refined reaches so much further than the region, in its radii.
const MARGIN: f64 = 1.25;

/// Most vertices in one layer of a region.
const MOST: f64 = 1e5;

/// Least vertices of a region that can move.
const LEAST: usize = 20;

/// The skin may turn so far from the normal of the middle within the region [degrees].
const TURN: f64 = 70.0;

/// A dome may be so many times as wide as its base.
const BULGE: f64 = 1.3;

/// Over an obstacle the lower layer takes at most this share of the room.
const ROOM: f64 = 0.98;

/// Systems with more unknown vertices than this are solved with a constant factor.
const LARGE: usize = 25_000;

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
    beds: Vec<TriangleMesh>,
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
        let (centre, seed) = middle(skin, order)?;
        let (patch, outside) = patch(skin, seed, &centre, radius * MARGIN, edge, obstacles)?;
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
        check_region(&region, &patch, &topology, &frame)?;
        let inward = inward(&region.mesh, order.tissue.depth, obstacles);
        let layers = Layers::new(&region, &order.tissue, &inward);
        let free = layers.held.iter().filter(|held| !**held).count() / 2;
        if free < LEAST {
            return Err(SkinError::TooCoarse { vertices: free });
        }
        let beds = if obstacles.is_empty() { vec![layers.bed()] } else { obstacles.to_vec() };
        Ok(Self { order: order.clone(), patch, outside, region, layers, frame, beds })
    }

    /// Brings the skin to rest over the implant filled with `volume` [m^3].
    ///
    /// # Errors
    /// An implant that is larger than the region, equations without a solution, [`SkinError::Stopped`].
    pub fn insert(&self, volume: f64, watch: impl FnMut(&Progress) -> bool) -> Result<Inserted, SkinError> {
        let (model, mut x) = self.model(volume)?;
        let progress = model.settle(&mut x, watch)?;
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

    /// The model of an implant of this volume, and where all starts: the skin as a dome over the implant.
    fn model(&self, volume: f64) -> Result<(Model, Vec<Point3<f64>>), SkinError> {
        let implant = Implant { volume, ..self.order.implant };
        let dome = implant.dome(self.layers.edge)?;
        let bulge = implant.bulge(&dome);
        let too_large = |ratio| SkinError::TooLarge { volume_cc: volume * 1e6, ratio };
        if bulge > BULGE {
            return Err(too_large(bulge));
        }
        let bed = Surface::new(&self.layers.bed());
        let down = self.frame * -Vector3::z();
        let over = 4.0 * self.order.implant.base + self.order.tissue.depth;
        let mut shell = dome.clone();
        for p in &mut shell.vertices {
            // Over the bed as it is, by as much as over a plane.
            let from = self.frame * Point3::new(p.x, p.y, over);
            let (t, w) = bed.first_hit(&from, &down).ok_or(too_large(bulge))?;
            let corners = bed.triangles()[t as usize].map(|v| bed.positions()[v as usize]);
            let foot = corners[0] + (corners[1] - corners[0]) * w[1] + (corners[2] - corners[0]) * w[2];
            *p = foot - down * p.z;
        }
        let lift = self.lift(&dome, &implant);
        let first = 2 * self.layers.count() as u32;
        let (springs, stiffness) = implant.springs(&shell, first);
        let rings = rings_of(dome.vertices.len());
        let pocket = (upper(rings)..dome.vertices.len() as u32).map(|v| v + first).collect();
        let mut x: Vec<Point3<f64>> = self.layers.rest.iter().zip(&lift).map(|(p, h)| p - down * *h).collect();
        x.extend(&shell.vertices);
        let method = if x.len() > LARGE { Method::QuasiStatic } else { Method::Newton };
        let filled = Filled { mesh: shell, springs, stiffness, volume, pocket };
        let model = Model {
            layers: self.layers.clone(),
            membrane: self.order.tissue.membrane(),
            implant: Some(filled),
            beds: self.beds.iter().map(Surface::new).collect(),
            ball: None,
            base: self.order.implant.base,
            method,
        };
        Ok((model, x))
    }

    /// How far each vertex of both layers starts above where it rests [m]: a dome that clears the implant.
    fn lift(&self, dome: &TriangleMesh, implant: &Implant) -> Vec<f64> {
        let profile = |p: &Point3<f64>| {
            let reach = implant.shape.reach(p.xy(), implant.base) / REACH;
            (1.0 - reach * reach).max(0.0)
        };
        let height = greatest(dome.vertices.iter().map(|p| p.z / profile(p).max(0.1)));
        let n = self.layers.count();
        let at = |v: usize| {
            let p = self.frame.inverse_transform_point(&self.layers.rest[v % n]);
            if self.layers.held[v] { 0.0 } else { height * profile(&p) }
        };
        (0..2 * n).map(at).collect()
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

/// Rings of a dome with so many vertices: 2 (1 + 3 n (n + 1)) - 6 n = 2 + 6 n^2.
fn rings_of(vertices: usize) -> u32 {
    (((vertices - 2) / 6) as f64).sqrt().round() as u32
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

fn nearest_vertex(mesh: &TriangleMesh, at: &Point3<f64>) -> u32 {
    let far = |v: &u32| (mesh.vertices[*v as usize] - at).norm_squared();
    (0..mesh.vertices.len() as u32).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0)
}

fn normal_of(mesh: &TriangleMesh, t: &[u32; 3]) -> Vector3<f64> {
    let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
    (b - a).cross(&(c - a))
}

/// The skin about the implant and somewhat beyond, oriented, refined where it is coarse; and all triangles besides.
fn patch(
    skin: &TriangleMesh,
    seed: u32,
    centre: &Point3<f64>,
    radius: f64,
    edge: f64,
    obstacles: &[TriangleMesh],
) -> Result<(TriangleMesh, Vec<u32>), SkinError> {
    let topology = Topology::new(skin);
    let near = |p: &Point3<f64>| (p - centre).norm() <= radius + 2.0 * edge;
    let part = Region::around(skin, &topology, seed, near);
    let mut mesh = part.mesh;
    let topology = Topology::new(&mesh);
    let (edges, vertices) = (topology.non_manifold_edges().len(), topology.non_manifold_vertices(&mesh).len());
    if edges + vertices > 0 {
        return Err(SkinError::NotManifold { edges, vertices });
    }
    let orientation = Orientation::new(&topology, &mesh.triangles);
    if orientation.one_sided.is_some() {
        return Err(SkinError::OneSided);
    }
    let turn = mesh.triangles.iter_mut().zip(&orientation.turn).filter(|(_, turn)| **turn);
    turn.for_each(|(t, _)| t.swap(1, 2));
    if looks_inward(&mesh, centre, obstacles) {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    if mesh.median_edge_length(&topology).is_some_and(|median| median > ENOUGH * edge) {
        mesh = refine(&mesh, edge)?.mesh;
    }
    let mut inside = vec![false; skin.triangles.len()];
    part.triangles.iter().for_each(|t| inside[*t as usize] = true);
    Ok((mesh, (0..skin.triangles.len() as u32).filter(|t| !inside[*t as usize]).collect()))
}

/// Whether the normals look towards the obstacle that is nearest to the middle.
fn looks_inward(mesh: &TriangleMesh, centre: &Point3<f64>, obstacles: &[TriangleMesh]) -> bool {
    let nearest =
        obstacles.iter().filter_map(|o| SurfaceTree::new(&o.vertices, &o.triangles).closest(centre, f64::INFINITY));
    let Some(nearest) = nearest.min_by(|a, b| a.distance.total_cmp(&b.distance)) else { return false };
    let normal = mesh.vertex_normals()[nearest_vertex(mesh, centre) as usize];
    normal.dot(&(nearest.point - centre)) > 0.0
}

/// The region by the rule: every triangle with a vertex within [`REACH`] times the base's outline.
fn around(mesh: &TriangleMesh, topology: &Topology, seed: u32, order: &Order, frame: &Isometry3<f64>) -> Region {
    let Implant { shape, base, .. } = order.implant;
    // Rounding must not decide about vertices just at the limit.
    let inside = |p: &Point3<f64>| shape.reach(frame.inverse_transform_point(p).xy(), base) <= REACH * (1.0 + 1e-9);
    Region::around(mesh, topology, seed, inside)
}

fn check_region(
    region: &Region,
    patch: &TriangleMesh,
    topology: &Topology,
    frame: &Isometry3<f64>,
) -> Result<(), SkinError> {
    let mut sides = vec![false; topology.edges.len()];
    region
        .triangles
        .iter()
        .for_each(|t| topology.triangle_edges[*t as usize].iter().for_each(|e| sides[*e as usize] = true));
    let edges = topology.boundary_edges().into_iter().filter(|e| sides[*e as usize]).count();
    if edges > 0 {
        return Err(SkinError::AtBorder { edges });
    }
    let z = frame * Vector3::z();
    let angle = |t: &u32| {
        let normal = normal_of(patch, &patch.triangles[*t as usize]);
        libm::atan2(normal.cross(&z).norm(), normal.dot(&z)).to_degrees()
    };
    let degrees = greatest(region.triangles.iter().map(angle));
    if degrees > TURN { Err(SkinError::TooCurved { degrees }) } else { Ok(()) }
}

/// From each vertex to the one under it [m]: by `depth`, but not into an obstacle.
fn inward(mesh: &TriangleMesh, depth: f64, obstacles: &[TriangleMesh]) -> Vec<Vector3<f64>> {
    let surfaces: Vec<SurfaceTree> = obstacles.iter().map(|o| SurfaceTree::new(&o.vertices, &o.triangles)).collect();
    let room = |p: &Point3<f64>| {
        let each = surfaces.iter().filter_map(|s| s.closest(p, 2.0 * depth)).map(|c| c.distance);
        each.fold(f64::INFINITY, f64::min)
    };
    let each = mesh.vertices.iter().zip(mesh.vertex_normals());
    each.map(|(p, n)| -n * depth.min(ROOM * room(p)).max(0.02 * depth)).collect()
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
