//! Start of an equilibrium: the skin on the implant, the result of a coarser skin, or an earlier
//! result.

use nalgebra::{Isometry3, Point2, Point3, Vector3};

use super::SkinError;
use super::implant::{BULGE, Implant, upper};
use super::place::downs;
use super::plan::{ImplantPlace, ImplantSpec, Inserted, PreparedPatch};
use super::prolongation::Prolongation;
use super::region::REACH;
use super::settle::{FilledImplant, SettleMethod, SettleProgress, SkinSystem};
use super::support_surface::SupportSurface;
use crate::contact::Surface;
use crate::mesh::{TriangleMesh, refine};
use crate::progress::Silent;

/// Systems with more unknown vertices use a constant factor.
const LARGE: usize = 25_000;

/// Regions with more free vertices are first solved with longer edges.
const COARSE: usize = 400;

/// Greatest slope of the skin at the start.
const STEEP: f64 = 4.0;

/// A possible start of an equilibrium.
#[derive(Default)]
pub(super) struct Begin {
    /// Positions [m], if known.
    pub likely: Option<Vec<Point3<f64>>>,
    /// Number of iterations to find them.
    pub iterations: u32,
    /// Gain of a coarser skin [m^2].
    pub coarse_gain: Option<f64>,
}

impl PreparedPatch {
    /// The solver for this number of unknown vertices.
    pub(super) fn method_for(&self, unknown: usize) -> SettleMethod {
        self.method.unwrap_or(if unknown > LARGE {
            SettleMethod::QuasiStatic
        } else {
            SettleMethod::Newton
        })
    }

    /// The same skin with edges twice as long; `None` for few free vertices, or if the coarser skin
    /// cannot be prepared.
    fn coarser(&self) -> Option<&Self> {
        let make = || {
            if self.layers.held.iter().filter(|held| !**held).count() / 2 <= COARSE {
                return None;
            }
            let edge = 2.0 * self.layers.edge;
            let skin = refine(&self.patch, edge).ok()?.mesh;
            let order = |(order, frame): (&ImplantSpec, &Isometry3<f64>)| {
                let place = ImplantPlace::Point(Point3::from(frame.translation.vector));
                ImplantSpec {
                    place,
                    edge: Some(edge),
                    ..order.clone()
                }
            };
            let orders: Vec<ImplantSpec> = self.sites().map(order).collect();
            let obstacles: Vec<TriangleMesh> =
                self.obstacles.iter().map(|o| o.mesh().clone()).collect();
            let coarser =
                Self::together(&skin, &orders[0], &orders[1..], &obstacles, &Silent).ok()?;
            Some(Box::new(Self {
                method: self.method,
                ..coarser
            }))
        };
        self.coarser.get_or_init(make).as_deref()
    }

    /// Adds the displacement of an earlier result to `start`.
    pub(super) fn further(
        &self,
        earlier: &Inserted,
        start: &[Point3<f64>],
    ) -> Result<Vec<Point3<f64>>, SkinError> {
        let (_, from) = self.model(&earlier.volumes())?;
        let moved = earlier.x.iter().zip(&from).map(|(to, from)| to - from);
        Ok(start
            .iter()
            .zip(moved)
            .map(|(x, moved)| x + moved)
            .collect())
    }

    /// Computes the gain with edges twice as long if a result lacks it; leaves it empty on failure,
    /// or if `watch` stops it.
    pub fn compare(&self, done: &mut Inserted, mut watch: impl FnMut(&SettleProgress) -> bool) {
        if done.coarse_gain.is_some() || done.shells.is_empty() {
            return;
        }
        let coarse = self
            .coarser()
            .and_then(|coarser| coarser.begun(None, &done.volumes(), &mut watch).ok());
        done.coarse_gain = coarse
            .filter(|coarse| coarse.progress.converged)
            .map(|coarse| coarse.areas.gain());
    }

    /// Equilibrium of a coarser skin with its implants, and its effort.
    pub(super) fn coarsely(
        &self,
        volumes: &[f64],
        start: &[Point3<f64>],
        watch: &mut dyn FnMut(&SettleProgress) -> bool,
    ) -> Result<Begin, SkinError> {
        let Some(coarser) = self.coarser() else {
            return Ok(Begin::default());
        };
        match coarser.begun(None, volumes, watch) {
            Ok(done) if done.progress.converged => Ok(Begin {
                likely: Some(self.follow(coarser, &done, start)?),
                iterations: done.progress.iterations,
                coarse_gain: Some(done.areas.gain()),
            }),
            // A coarser skin without equilibrium is no better than its start.
            Ok(done) => Ok(Begin {
                iterations: done.progress.iterations,
                ..Begin::default()
            }),
            Err(SkinError::Stopped) => Err(SkinError::Stopped),
            // This skin can have a solution where a coarser one has none.
            Err(_) => Ok(Begin::default()),
        }
    }

    /// The start from the equilibrium of a coarser skin with its implants.
    fn follow(
        &self,
        coarser: &Self,
        done: &Inserted,
        start: &[Point3<f64>],
    ) -> Result<Vec<Point3<f64>>, SkinError> {
        let mut x = self.layers.follow(&coarser.layers, &done.x);
        let (_, from) = coarser.model(&done.volumes())?;
        let own = self.model(&done.volumes())?.0;
        for ((shell, implant), first) in done.shells.iter().zip(&own.implants).zip(own.firsts()) {
            let from = from[shell.vertices.clone()].to_vec();
            let moved: Vec<Vector3<f64>> = done
                .shell_at(shell)
                .iter()
                .zip(&from)
                .map(|(to, from)| to - from)
                .collect();
            let carried = Prolongation::new(
                TriangleMesh {
                    vertices: from,
                    triangles: shell.triangles.clone(),
                },
                &moved,
            );
            let first = first as usize;
            let places = &start[first..first + implant.mesh.vertices.len()];
            x.extend(places.iter().map(|p| p + carried.at(p)));
        }
        Ok(x)
    }

    /// The model of implants with these volumes, and the start: the skin as a dome over each.
    pub(super) fn model(
        &self,
        volumes: &[f64],
    ) -> Result<(SkinSystem, Vec<Point3<f64>>), SkinError> {
        let (mut implants, mut lift) = (Vec::new(), vec![0.0; self.layers.rest.len()]);
        let (support, mut first) = (Surface::new(&self.layers.support()), lift.len() as u32);
        for ((order, frame), volume) in self.sites().zip(volumes) {
            let implant = Implant {
                volume: *volume,
                ..order.implant
            };
            let dome = implant.dome(self.layers.edge)?;
            let own = self.lift(&dome, &implant, frame);
            lift.iter_mut()
                .zip(own)
                .for_each(|(lift, own)| *lift = f64::max(*lift, own));
            let filled = self.filled(&implant, dome, &support, frame, first)?;
            first += filled.mesh.vertices.len() as u32;
            implants.push(filled);
        }
        let n = self.layers.count();
        let sites: Vec<(&ImplantSpec, &Isometry3<f64>)> = self.sites().collect();
        let downs = downs(&self.layers.rest[..n], &sites);
        let risen = self
            .layers
            .rest
            .iter()
            .zip(downs.iter().chain(&downs))
            .zip(&lift);
        let mut x: Vec<Point3<f64>> = risen.map(|((p, down), lift)| p - down * *lift).collect();
        x.extend(implants.iter().flat_map(|implant| &implant.mesh.vertices));
        let supports = match &self.obstacles[..] {
            [] => vec![SupportSurface::new(self.layers.support())],
            some => some.to_vec(),
        };
        let model = SkinSystem {
            layers: self.layers.clone(),
            membrane: self.order.tissue.membrane(),
            implants,
            supports,
            has_obstacles: !self.obstacles.is_empty(),
            ball: None,
            base: self
                .sites()
                .map(|(order, _)| order.implant.base)
                .fold(f64::INFINITY, f64::min),
            method: self.method_for(x.len()),
        };
        Ok((model, x))
    }

    /// A dome over the surface below, with vertices from index `first`.
    fn filled(
        &self,
        implant: &Implant,
        dome: TriangleMesh,
        support: &Surface,
        frame: &Isometry3<f64>,
        first: u32,
    ) -> Result<FilledImplant, SkinError> {
        let bulge = implant.bulge(&dome);
        if bulge > BULGE {
            return Err(implant.too_large(self.layers.edge));
        }
        let down = frame * -Vector3::z();
        let over = 4.0 * implant.base + self.order.tissue.depth;
        let mut mesh = dome;
        for p in &mut mesh.vertices {
            // The same height as over a plane.
            let from = frame * Point3::new(p.x, p.y, over);
            let (t, w) = support
                .first_hit(&from, &down)
                .ok_or(SkinError::Beyond { bulge })?;
            let corners = support.triangles()[t as usize].map(|v| support.positions()[v as usize]);
            let foot =
                corners[0] + (corners[1] - corners[0]) * w[1] + (corners[2] - corners[0]) * w[2];
            *p = foot - down * p.z;
        }
        let (springs, stiffness) = implant.springs(&mesh, first);
        let count = mesh.vertices.len();
        let pocket = (upper(rings_of(count))..count as u32)
            .map(|v| v + first)
            .collect();
        Ok(FilledImplant {
            mesh,
            springs,
            stiffness,
            volume: implant.volume,
            pocket,
        })
    }

    /// Initial height of each vertex of both layers above its rest position [m]: on the implant,
    /// and from there straight to the boundary of the region, like a taut sheet.
    fn lift(&self, dome: &TriangleMesh, implant: &Implant, frame: &Isometry3<f64>) -> Vec<f64> {
        let profile = profile(dome, implant);
        let last = (0..profile.len()).fold(0, |best, k| {
            if slope(profile[k]) > slope(profile[best]) {
                k
            } else {
                best
            }
        });
        // Farther down a dome can overhang; the straight skin is above that.
        let (steepest, top) = (profile[last], &profile[..=last]);
        let n = self.layers.count();
        let flat: Vec<Point2<f64>> = self.layers.rest[..n]
            .iter()
            .map(|p| frame.inverse_transform_point(p).xy())
            .collect();
        let rim: Vec<Point2<f64>> = (0..n)
            .filter(|v| self.layers.held[*v])
            .map(|v| flat[v])
            .collect();
        let at = |v: usize| {
            if self.layers.held[v] {
                return 0.0;
            }
            let reach = implant.shape.reach(flat[v], implant.base);
            if reach < steepest.0 {
                return height_at(top, reach);
            }
            // Where the region ends nearer than the rule says, the slope is limited.
            let away = rim
                .iter()
                .map(|p| (p - flat[v]).norm())
                .fold(f64::INFINITY, f64::min);
            let straight = slope(steepest) * (REACH - reach).max(0.0);
            straight.min(STEEP * away)
        };
        let lift: Vec<f64> = (0..n).map(at).collect();
        [lift.clone(), lift].concat()
    }
}

/// Number of rings of a dome with this number of vertices: 2 (1 + 3 n (n + 1)) - 6 n = 2 + 6 n^2.
fn rings_of(vertices: usize) -> u32 {
    (((vertices - 2) / 6) as f64).sqrt().round() as u32
}

/// Relative distance from the centre, 1 on the outline of the base, and height [m] of each ring of
/// a dome.
fn profile(dome: &TriangleMesh, implant: &Implant) -> Vec<(f64, f64)> {
    let mut profile = Vec::new();
    for k in 0..=rings_of(dome.vertices.len()) {
        // Both are constant on a ring.
        let p = dome.vertices[if k == 0 { 0 } else { upper(k - 1) as usize }];
        profile.push((implant.shape.reach(p.xy(), implant.base), p.z));
    }
    profile
}

/// Slope of the straight skin from a ring of a profile to the boundary of the region [m].
fn slope((out, high): (f64, f64)) -> f64 {
    high / (REACH - out)
}

/// Height of a profile at a relative distance from the centre, linear between its rings [m].
fn height_at(profile: &[(f64, f64)], reach: f64) -> f64 {
    let next = profile
        .partition_point(|p| p.0 <= reach)
        .clamp(1, profile.len() - 1);
    let ((a, low), (b, high)) = (profile[next - 1], profile[next]);
    low + (high - low) * (reach - a) / (b - a)
}
