//! Insertion of an implant at a point of a skin, and its result.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::OnceLock;

use nalgebra::{Isometry3, Point3, Vector3};

use super::areas::Areas;
use super::detector::Lifts;
use super::implant::Implant;
use super::layers::{Layers, Tissue};
use super::patch::{EVEN, MARGIN, Patch, TakenOut};
use super::place::{advised, apart, downs, inward, lies_below, middle, placed};
use super::region::{REACH, Region};
use super::settle::{self, FilledImplant, SettleMethod, Settled, SkinSystem};
use super::start::Begin;
use super::support_surface::SupportSurface;
use super::{BaseShape, SkinError};
use crate::mesh::measures::{max_or_nan, volume};
use crate::mesh::{Topology, TriangleMesh};
use crate::progress::{Progress, Silent};

/// Ratio of the base to the default edge length.
pub(super) const FINE: f64 = 20.0;

/// Greatest number of vertices in one layer of a region.
pub(super) const MOST: f64 = 1e5;

/// Least number of free vertices of a region.
const LEAST: usize = 20;

/// Place of an implant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImplantPlace {
    /// Under a vertex.
    Vertex(usize),
    /// Under the point of the skin nearest to this point [m].
    Point(Point3<f64>),
}

impl std::fmt::Display for ImplantPlace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Vertex(vertex) => write!(f, "vertex {vertex}"),
            Self::Point(at) => {
                let [x, y, z] = [at.x, at.y, at.z].map(|c| crate::format::number(c * 1e3));
                write!(f, "({x}, {y}, {z}) mm")
            }
        }
    }
}

/// An implant with its place.
#[derive(Clone, Debug, PartialEq)]
pub struct ImplantSpec {
    /// Place of the implant.
    pub place: ImplantPlace,
    /// The implant.
    pub implant: Implant,
    /// Direction of the longer side, projected onto the skin.
    pub long: Option<Vector3<f64>>,
    /// Material of the skin over the implant.
    pub tissue: Tissue,
    /// Target edge length [m]; `None` means the base over 20.
    pub edge: Option<f64>,
}

impl ImplantSpec {
    /// A round implant under skin of the default material.
    pub fn round(place: ImplantPlace, base: f64, volume: f64) -> Self {
        let implant = Implant {
            shape: BaseShape::Round,
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
    pub order: ImplantSpec,
    /// Frame of the implant: z points out of the body.
    pub frame: Isometry3<f64>,
}

/// Skin prepared for an implant of any volume, or for several that share it.
#[derive(Clone, Debug)]
pub struct PreparedPatch {
    /// The order of the first implant.
    pub order: ImplantSpec,
    /// The extracted and refined part of the skin.
    pub patch: TriangleMesh,
    /// Triangles of the skin outside the patch.
    pub outside: Vec<u32>,
    /// The skin vertex of each vertex of the patch; `u32::MAX` for a vertex of the patch only.
    pub origin: Vec<u32>,
    /// The region within the patch.
    pub region: Region,
    /// Number of edges of the region on the border of the skin, which is held.
    pub at_border: usize,
    /// Both layers.
    pub layers: Layers,
    /// Frame of the first implant: z points out of the body.
    pub frame: Isometry3<f64>,
    /// The other implants.
    pub others: Vec<Site>,
    /// Method of the equilibrium; `None` selects it by the number of unknowns.
    pub method: Option<SettleMethod>,
    pub(super) obstacles: Vec<SupportSurface>,
    pub(super) coarser: OnceLock<Option<Box<PreparedPatch>>>,
}

/// The shell of an implant at equilibrium.
#[derive(Clone, Debug, PartialEq)]
pub struct Shell {
    /// Range of its vertices in the positions.
    pub vertices: Range<usize>,
    /// Triangles, indexed from 0.
    pub triangles: Vec<[u32; 3]>,
    /// Volume [m^3].
    pub volume: f64,
    /// Pressure inside [Pa].
    pub pressure: f64,
}

/// Skin over its implants, at equilibrium.
#[derive(Clone, Debug)]
pub struct Inserted {
    /// Positions of both layers, then of each implant [m].
    pub x: Vec<Point3<f64>>,
    /// Shell of each implant.
    pub shells: Vec<Shell>,
    /// Measured areas.
    pub areas: Areas,
    /// The gain with edges twice as long [m^2]; `None` if not computed.
    pub coarse_gain: Option<f64>,
    /// Effort and state of the solution.
    pub progress: settle::SettleProgress,
    /// The offsets of contacts.
    pub(super) lifts: Lifts,
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

    /// Uncertainty of the gain from the edge length [m^2]: the change from edges twice as long.
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
    order: &ImplantSpec,
    obstacles: &[TriangleMesh],
    watch: impl FnMut(&settle::SettleProgress) -> bool,
) -> Result<(PreparedPatch, Inserted), SkinError> {
    let ready = PreparedPatch::new(skin, order, obstacles)?;
    let inserted = ready.insert(order.implant.volume, watch)?;
    Ok((ready, inserted))
}

impl PreparedPatch {
    /// Chooses the region, refines it and creates both layers. Without obstacles the implant rests
    /// on the original surface below the lower layer.
    ///
    /// # Errors
    /// See [`SkinError`].
    pub fn new(
        skin: &TriangleMesh,
        order: &ImplantSpec,
        obstacles: &[TriangleMesh],
    ) -> Result<Self, SkinError> {
        Self::new_with(skin, order, obstacles, &Silent)
    }

    /// The same as [`Ready::new`]; stops when `go_on` returns false. Large skin takes seconds to
    /// refine, during which `go_on` is called.
    ///
    /// # Errors
    /// See [`SkinError`].
    pub fn new_with(
        skin: &TriangleMesh,
        order: &ImplantSpec,
        obstacles: &[TriangleMesh],
        progress: &dyn Progress,
    ) -> Result<Self, SkinError> {
        Self::together(skin, order, &[], obstacles, progress).map_err(|(_, error)| error)
    }

    /// The same for an implant and others that share skin with it: the region is the union of their
    /// regions.
    ///
    /// # Errors
    /// See [`SkinError`]; the error comes with the index of its implant, 0 for the first.
    pub fn together(
        skin: &TriangleMesh,
        first: &ImplantSpec,
        others: &[ImplantSpec],
        obstacles: &[TriangleMesh],
        progress: &dyn Progress,
    ) -> Result<Self, (usize, SkinError)> {
        let orders: Vec<&ImplantSpec> = [first].into_iter().chain(others).collect();
        orders
            .iter()
            .enumerate()
            .try_for_each(|(k, order)| order.check().map_err(|error| (k, error)))?;
        let edge = shared_edge(&orders);
        let radius = |order: &ImplantSpec| REACH * 0.5 * order.implant.base;
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
        // A region that reaches the cut of the patch is refused, so this is the border of the skin.
        let boundary = topology.boundary_edges().into_iter();
        let own = |e: &u32| {
            topology
                .triangles_of_edge(*e as usize)
                .iter()
                .any(|t| triangles.contains(t))
        };
        let at_border = boundary.filter(own).count();
        let region = Region::of(&taken.mesh, triangles.into_iter().collect());
        Self::over(taken, (region, at_border), sites, obstacles).map_err(|error| (0, error))
    }

    /// Creates both layers of a region over the surfaces below.
    fn over(
        TakenOut {
            mesh: patch,
            outside,
            origin,
            ..
        }: TakenOut,
        (region, at_border): (Region, usize),
        mut sites: Vec<Site>,
        obstacles: &[TriangleMesh],
    ) -> Result<Self, SkinError> {
        let each: Vec<(&ImplantSpec, &Isometry3<f64>)> =
            sites.iter().map(|s| (&s.order, &s.frame)).collect();
        let downs = downs(&region.mesh.vertices, &each);
        let tissue = sites[0].order.tissue;
        let mut layers = Layers::new(
            &region,
            &tissue,
            &inward(&region.mesh, &downs, tissue.depth, obstacles),
        );
        layers.join(&patch, &region, &tissue);
        layers.bond(tissue.bond, |p| {
            each.iter().all(|(order, frame)| {
                let place = frame.inverse_transform_point(p).xy();
                order.implant.shape.reach(place, order.implant.base) >= tissue.pocket
            })
        });
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
        let longest = max_or_nan(sites.iter().map(|s| s.order.implant.base));
        let facing =
            |o: &TriangleMesh| SupportSurface::facing(o.clone(), &layers.rest, 2.0 * longest);
        let obstacles = obstacles.iter().map(facing).collect();
        let Site { order, frame } = sites.remove(0);
        let (others, coarser) = (sites, OnceLock::new());
        Ok(Self {
            order,
            patch,
            outside,
            origin,
            region,
            at_border,
            layers,
            frame,
            others,
            method: None,
            obstacles,
            coarser,
        })
    }

    /// Each implant: order and frame.
    pub fn sites(&self) -> impl Iterator<Item = (&ImplantSpec, &Isometry3<f64>)> {
        [(&self.order, &self.frame)]
            .into_iter()
            .chain(self.others.iter().map(|s| (&s.order, &s.frame)))
    }

    /// The volume of each implant as ordered [m^3].
    pub fn volumes(&self) -> Vec<f64> {
        self.sites()
            .map(|(order, _)| order.implant.volume)
            .collect()
    }

    /// Brings the skin to equilibrium over the implant with `volume` [m^3].
    ///
    /// # Errors
    /// An implant larger than the region, equations without a solution, or [`SkinError::Stopped`].
    pub fn insert(
        &self,
        volume: f64,
        watch: impl FnMut(&settle::SettleProgress) -> bool,
    ) -> Result<Inserted, SkinError> {
        self.insert_after(None, &[volume], watch)
    }

    /// The same with a volume [m^3] for each implant, started from an earlier result of this skin
    /// with other volumes. Fewer rounds lead to the same result.
    ///
    /// # Errors
    /// See [`PreparedPatch::insert`].
    pub fn insert_after(
        &self,
        earlier: Option<&Inserted>,
        volumes: &[f64],
        mut watch: impl FnMut(&settle::SettleProgress) -> bool,
    ) -> Result<Inserted, SkinError> {
        self.begun(earlier, volumes, &mut watch)
    }

    pub(super) fn begun(
        &self,
        earlier: Option<&Inserted>,
        volumes: &[f64],
        watch: &mut dyn FnMut(&settle::SettleProgress) -> bool,
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
        let mut settled = model.settle_each(&mut x, &mut *watch)?;
        if fresh && !settled.progress.converged {
            // The start was too far away.
            x = start;
            let done = settled.progress.iterations;
            settled = model.settle_each(&mut x, watch)?;
            settled.progress.iterations += done;
        }
        let Settled {
            mut progress,
            pressures,
            lifts,
        } = settled;
        progress.iterations += iterations;
        let shell = |((implant, first), pressure): ((&FilledImplant, u32), f64)| {
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
            lifts,
        })
    }

    /// The largest volume [m^3] of the first implant whose dome does not overhang its base too far.
    pub fn largest(&self) -> f64 {
        self.order.implant.largest(self.layers.edge)
    }
}

/// Common edge length of all orders [m]: the longest one, but at most twice the shortest; otherwise
/// a small implant beside a large one would need many times the vertices.
fn shared_edge(orders: &[&ImplantSpec]) -> f64 {
    let all = || orders.iter().map(|order| order.edge());
    let (shortest, longest) = (all().fold(f64::INFINITY, f64::min), max_or_nan(all()));
    longest.min(2.0 * shortest)
}

/// A sheet over a rigid sphere that pushes from below.
pub fn over_ball(
    layers: Layers,
    membrane: f64,
    centre: Point3<f64>,
    radius: f64,
    method: SettleMethod,
) -> SkinSystem {
    SkinSystem {
        layers,
        membrane,
        implants: Vec::new(),
        supports: Vec::new(),
        has_obstacles: false,
        ball: Some((centre, radius)),
        base: 2.0 * radius,
        method,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn implants_share_the_longest_edge_that_the_smallest_can_have() {
        let of = |base: f64| ImplantSpec::round(ImplantPlace::Vertex(0), base, 1e-5);
        let (small, middle, large) = (of(0.04), of(0.07), of(0.2));
        let edge = |all: &[&ImplantSpec]| shared_edge(all) / small.edge();
        assert!((edge(&[&small]) - 1.0).abs() <= 1e-12);
        assert!((edge(&[&middle, &small]) - 1.75).abs() <= 1e-12);
        assert!((edge(&[&small, &large, &middle]) - 2.0).abs() <= 1e-12);
    }
}
