//! The planner's question: an implant at a place of a skin, and what it does there.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::OnceLock;

use nalgebra::{Isometry3, Point3, Vector3};

use super::areas::Areas;
use super::implant::Implant;
use super::layers::{Layers, Tissue};
use super::patch::{EVEN, MARGIN, Patch, TakenOut};
use super::place::{advised, apart, downs, inward, lies_below, middle, placed};
use super::region::{REACH, Region};
use super::settle::{self, Filled, Method, Model};
use super::sheet::Sheet;
use super::start::Begin;
use super::{Shape, SkinError};
use crate::contact::Surface;
use crate::mesh::measures::{greatest, volume};
use crate::mesh::{Topology, TriangleMesh};
use crate::progress::{Progress, Silent};

/// Default edges are the base over this.
pub(super) const FINE: f64 = 20.0;

/// Most vertices in one layer of a region.
pub(super) const MOST: f64 = 1e5;

/// Least vertices of a region that can move.
const LEAST: usize = 20;

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
        let implant = Implant {
            shape: Shape::Round,
            base,
            volume,
            membrane: super::implant::SILICONE,
        };
        Self {
            place,
            implant,
            long: None,
            tissue: Tissue::default(),
            edge: None,
        }
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
    /// The vertex of the skin that each vertex of the patch is, `u32::MAX` for one that is of the patch only.
    pub origin: Vec<u32>,
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
    pub progress: settle::Progress,
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
        self.coarse_gain
            .map(|coarse| (self.areas.gain() - coarse).abs())
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
    watch: impl FnMut(&settle::Progress) -> bool,
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
    pub fn new(
        skin: &TriangleMesh,
        order: &Order,
        obstacles: &[TriangleMesh],
    ) -> Result<Self, SkinError> {
        Self::new_with(skin, order, obstacles, &Silent)
    }

    /// The same; `progress` hears of the refinement of the skin, which takes seconds where it is large, and may end it.
    ///
    /// # Errors
    /// See [`SkinError`].
    pub fn new_with(
        skin: &TriangleMesh,
        order: &Order,
        obstacles: &[TriangleMesh],
        progress: &dyn Progress,
    ) -> Result<Self, SkinError> {
        Self::together(skin, order, &[], obstacles, progress).map_err(|(_, error)| error)
    }

    /// The same for an implant and others that share skin with it: the region is all that one of them needs.
    ///
    /// # Errors
    /// See [`SkinError`]; with the implant that it is about, 0 the first.
    pub fn together(
        skin: &TriangleMesh,
        first: &Order,
        others: &[Order],
        obstacles: &[TriangleMesh],
        progress: &dyn Progress,
    ) -> Result<Self, (usize, SkinError)> {
        let orders: Vec<&Order> = [first].into_iter().chain(others).collect();
        orders
            .iter()
            .enumerate()
            .try_for_each(|(k, order)| order.check().map_err(|error| (k, error)))?;
        let edge = shared_edge(&orders);
        let radius = |order: &Order| REACH * 0.5 * order.implant.base;
        let area: f64 = orders
            .iter()
            .map(|order| std::f64::consts::PI * radius(order) * radius(order))
            .sum();
        let vertices = area / (EVEN * edge * edge);
        if vertices > MOST {
            return Err((
                0,
                SkinError::TooFine {
                    vertices,
                    most: MOST,
                },
            ));
        }
        let mut places = Vec::new();
        for (k, order) in orders.iter().enumerate() {
            let (centre, seed) = middle(skin, order).map_err(|error| (k, error))?;
            order
                .check_obstacles(skin, &centre, obstacles)
                .map_err(|error| (k, error))?;
            places.push((seed, centre, radius(order) * MARGIN));
        }
        let patch = Patch {
            skin,
            places,
            edge,
            obstacles,
        };
        let centres: Vec<Point3<f64>> = patch.places.iter().map(|(_, centre, _)| *centre).collect();
        let taken = patch.taken_out(progress).map_err(|error| (0, error))?;
        let topology = Topology::new(&taken.mesh);
        let (mut sites, mut triangles) = (Vec::new(), BTreeSet::new());
        for (k, (order, centre)) in orders.into_iter().zip(&centres).enumerate() {
            let (region, frame) = placed(&taken, &topology, order, centre)
                .map_err(|error| (k, advised(error, skin, order, obstacles)))?;
            triangles.extend(region.triangles);
            sites.push(Site {
                order: order.clone(),
                frame,
            });
        }
        apart(&sites).map_err(|error| (0, error))?;
        let region = Region::of(&taken.mesh, triangles.into_iter().collect());
        Self::over(taken, region, sites, obstacles).map_err(|error| (0, error))
    }

    /// Both layers of a region, over what lies below.
    fn over(
        TakenOut {
            mesh: patch,
            outside,
            origin,
            ..
        }: TakenOut,
        region: Region,
        mut sites: Vec<Site>,
        obstacles: &[TriangleMesh],
    ) -> Result<Self, SkinError> {
        let each: Vec<(&Order, &Isometry3<f64>)> =
            sites.iter().map(|s| (&s.order, &s.frame)).collect();
        let downs = downs(&region.mesh.vertices, &each);
        let tissue = sites[0].order.tissue;
        let layers = Layers::new(
            &region,
            &tissue,
            &inward(&region.mesh, &downs, tissue.depth, obstacles),
        );
        let free = layers.held.iter().filter(|held| !**held).count() / 2;
        if free < LEAST {
            return Err(SkinError::TooCoarse { vertices: free });
        }
        if !obstacles.is_empty()
            && !sites
                .iter()
                .all(|s| lies_below(&layers, &s.frame, &s.order, obstacles))
        {
            return Err(SkinError::NothingBelow);
        }
        let longest = greatest(sites.iter().map(|s| s.order.implant.base));
        let facing = |o: &TriangleMesh| Sheet::facing(o.clone(), &layers.rest, 2.0 * longest);
        let obstacles = obstacles.iter().map(facing).collect();
        let Site { order, frame } = sites.remove(0);
        let (others, coarser) = (sites, OnceLock::new());
        Ok(Self {
            order,
            patch,
            outside,
            origin,
            region,
            layers,
            frame,
            others,
            method: None,
            obstacles,
            coarser,
        })
    }

    /// Each implant: its order and its frame.
    pub fn sites(&self) -> impl Iterator<Item = (&Order, &Isometry3<f64>)> {
        [(&self.order, &self.frame)]
            .into_iter()
            .chain(self.others.iter().map(|s| (&s.order, &s.frame)))
    }

    /// The volume of each implant, as ordered [m^3].
    pub fn volumes(&self) -> Vec<f64> {
        self.sites()
            .map(|(order, _)| order.implant.volume)
            .collect()
    }

    /// Brings the skin to rest over the implant filled with `volume` [m^3].
    ///
    /// # Errors
    /// An implant that is larger than the region, equations without a solution, [`SkinError::Stopped`].
    pub fn insert(
        &self,
        volume: f64,
        watch: impl FnMut(&settle::Progress) -> bool,
    ) -> Result<Inserted, SkinError> {
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
        mut watch: impl FnMut(&settle::Progress) -> bool,
    ) -> Result<Inserted, SkinError> {
        self.begun(earlier, volumes, &mut watch)
    }

    pub(super) fn begun(
        &self,
        earlier: Option<&Inserted>,
        volumes: &[f64],
        watch: &mut dyn FnMut(&settle::Progress) -> bool,
    ) -> Result<Inserted, SkinError> {
        let (model, start) = self.model(volumes)?;
        let Begin {
            likely,
            iterations,
            coarse_gain,
        } = match earlier {
            Some(earlier) => Begin {
                likely: Some(self.further(earlier, &start)?),
                ..Begin::default()
            },
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
            Shell {
                volume: volume(&x[vertices.clone()], &triangles),
                vertices,
                triangles,
                pressure,
            }
        };
        let shells = model
            .implants
            .iter()
            .zip(model.firsts())
            .zip(pressures)
            .map(shell)
            .collect();
        let areas = Areas::of(&self.layers, &x);
        Ok(Inserted {
            shells,
            areas,
            progress,
            coarse_gain,
            x,
        })
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
            let each = surfaces
                .iter()
                .filter_map(|s| s.nearest(&x[v], self.order.implant.base));
            greatest(each.map(|on| (-on.closest.distance).max(0.0)))
        };
        greatest(free.map(depth))
    }
}

/// Edges that serve all orders [m]: the longest asked for, but at most twice the shortest, or a small implant beside a large one
/// would ask for many times the vertices.
fn shared_edge(orders: &[&Order]) -> f64 {
    let all = || orders.iter().map(|order| order.edge());
    let (shortest, longest) = (all().fold(f64::INFINITY, f64::min), greatest(all()));
    longest.min(2.0 * shortest)
}

/// A sheet that a rigid sphere pushes from below.
pub fn over_ball(
    layers: Layers,
    membrane: f64,
    centre: Point3<f64>,
    radius: f64,
    method: Method,
) -> Model {
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
