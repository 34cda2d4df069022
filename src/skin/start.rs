//! Where an equilibrium is begun: the skin on the implant, what a coarser skin came to, or an earlier result.

use nalgebra::{Isometry3, Point2, Point3, Vector3};

use super::SkinError;
use super::implant::{BULGE, Implant, upper};
use super::levels::Carried;
use super::place::downs;
use super::plan::{Inserted, Order, Place, Ready};
use super::region::REACH;
use super::settle::{Filled, Method, Model, Progress};
use super::sheet::Sheet;
use crate::contact::Surface;
use crate::mesh::{TriangleMesh, refine};
use crate::progress::Silent;

/// Systems with more unknown vertices than this are solved with a constant factor.
const LARGE: usize = 25_000;

/// A region in which more vertices than this can move is brought to rest with longer edges first.
const COARSE: usize = 400;

/// Greatest slope of the skin at the start.
const STEEP: f64 = 4.0;

/// Where an equilibrium may be begun.
#[derive(Default)]
pub(super) struct Begin {
    /// Positions [m], if any are known.
    pub likely: Option<Vec<Point3<f64>>>,
    /// Iterations that finding them took.
    pub iterations: u32,
    /// What a coarser skin gained [m^2].
    pub coarse_gain: Option<f64>,
}

impl Ready {
    /// How a system of so many unknown vertices is solved.
    pub(super) fn method_for(&self, unknown: usize) -> Method {
        self.method.unwrap_or(if unknown > LARGE {
            Method::QuasiStatic
        } else {
            Method::Newton
        })
    }

    /// The same skin with edges twice as long; `None` where few vertices move, or where that cannot be made ready.
    fn coarser(&self) -> Option<&Self> {
        let make = || {
            if self.layers.held.iter().filter(|held| !**held).count() / 2 <= COARSE {
                return None;
            }
            let edge = 2.0 * self.layers.edge;
            let skin = refine(&self.patch, edge).ok()?.mesh;
            let order = |(order, frame): (&Order, &Isometry3<f64>)| {
                let place = Place::Point(Point3::from(frame.translation.vector));
                Order {
                    place,
                    edge: Some(edge),
                    ..order.clone()
                }
            };
            let orders: Vec<Order> = self.sites().map(order).collect();
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

    /// As far from `start` as an earlier result came to lie from where it started.
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

    /// Finds what edges twice as long gain, where that is not known of a result yet; leaves it where that cannot be found, or
    /// `watch` says so.
    pub fn compare(&self, done: &mut Inserted, mut watch: impl FnMut(&Progress) -> bool) {
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

    /// Where a coarser skin and its implants came to rest, and what that took.
    pub(super) fn coarsely(
        &self,
        volumes: &[f64],
        start: &[Point3<f64>],
        watch: &mut dyn FnMut(&Progress) -> bool,
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
            // Not at rest, it is no better than where it began.
            Ok(done) => Ok(Begin {
                iterations: done.progress.iterations,
                ..Begin::default()
            }),
            Err(SkinError::Stopped) => Err(SkinError::Stopped),
            // What a coarser skin cannot do, this one may.
            Err(_) => Ok(Begin::default()),
        }
    }

    /// Where all begins, after a coarser skin and its implants have come to rest.
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
            let carried = Carried::new(
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

    /// The model of implants of these volumes, and where all starts: the skin as a dome over each.
    pub(super) fn model(&self, volumes: &[f64]) -> Result<(Model, Vec<Point3<f64>>), SkinError> {
        let (mut implants, mut lift) = (Vec::new(), vec![0.0; self.layers.rest.len()]);
        let (bed, mut first) = (Surface::new(&self.layers.bed()), lift.len() as u32);
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
            let filled = self.filled(&implant, dome, &bed, frame, first)?;
            first += filled.mesh.vertices.len() as u32;
            implants.push(filled);
        }
        let n = self.layers.count();
        let sites: Vec<(&Order, &Isometry3<f64>)> = self.sites().collect();
        let downs = downs(&self.layers.rest[..n], &sites);
        let risen = self
            .layers
            .rest
            .iter()
            .zip(downs.iter().chain(&downs))
            .zip(&lift);
        let mut x: Vec<Point3<f64>> = risen.map(|((p, down), lift)| p - down * *lift).collect();
        x.extend(implants.iter().flat_map(|implant| &implant.mesh.vertices));
        let beds = match &self.obstacles[..] {
            [] => vec![Sheet::new(self.layers.bed())],
            some => some.to_vec(),
        };
        let model = Model {
            layers: self.layers.clone(),
            membrane: self.order.tissue.membrane(),
            implants,
            beds,
            ball: None,
            base: self
                .sites()
                .map(|(order, _)| order.implant.base)
                .fold(f64::INFINITY, f64::min),
            method: self.method_for(x.len()),
        };
        Ok((model, x))
    }

    /// A dome over the bed as it is, with vertices from number `first` on.
    fn filled(
        &self,
        implant: &Implant,
        dome: TriangleMesh,
        bed: &Surface,
        frame: &Isometry3<f64>,
        first: u32,
    ) -> Result<Filled, SkinError> {
        let bulge = implant.bulge(&dome);
        if bulge > BULGE {
            return Err(implant.too_large(self.layers.edge));
        }
        let down = frame * -Vector3::z();
        let over = 4.0 * implant.base + self.order.tissue.depth;
        let mut mesh = dome;
        for p in &mut mesh.vertices {
            // By as much as over a plane.
            let from = frame * Point3::new(p.x, p.y, over);
            let (t, w) = bed
                .first_hit(&from, &down)
                .ok_or(SkinError::Beyond { bulge })?;
            let corners = bed.triangles()[t as usize].map(|v| bed.positions()[v as usize]);
            let foot =
                corners[0] + (corners[1] - corners[0]) * w[1] + (corners[2] - corners[0]) * w[2];
            *p = foot - down * p.z;
        }
        let (springs, stiffness) = implant.springs(&mesh, first);
        let count = mesh.vertices.len();
        let pocket = (upper(rings_of(count))..count as u32)
            .map(|v| v + first)
            .collect();
        Ok(Filled {
            mesh,
            springs,
            stiffness,
            volume: implant.volume,
            pocket,
        })
    }

    /// How far each vertex of both layers starts above where it rests [m]: on the implant, and from there straight to the rim
    /// of the region, as a taut sheet would lie.
    fn lift(&self, dome: &TriangleMesh, implant: &Implant, frame: &Isometry3<f64>) -> Vec<f64> {
        let rings = rings_of(dome.vertices.len());
        // Both are the same all along a ring.
        let ring = |k: u32| {
            let p = dome.vertices[if k == 0 { 0 } else { upper(k - 1) as usize }];
            (implant.shape.reach(p.xy(), implant.base), p.z)
        };
        let profile: Vec<(f64, f64)> = (0..=rings).map(ring).collect();
        let slope = |&(out, high): &(f64, f64)| high / (REACH - out);
        let last = (0..profile.len()).fold(0, |best, k| {
            if slope(&profile[k]) > slope(&profile[best]) {
                k
            } else {
                best
            }
        });
        // Further down a dome may overhang; the straight skin is above that.
        let (steepest, top) = (profile[last], &profile[..=last]);
        let implant_at = |reach: f64| {
            let next = top
                .partition_point(|p| p.0 <= reach)
                .clamp(1, top.len() - 1);
            let ((a, low), (b, high)) = (top[next - 1], top[next]);
            low + (high - low) * (reach - a) / (b - a)
        };
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
                return implant_at(reach);
            }
            // Where the region ends nearer than the rule says, no steeper than this.
            let away = rim
                .iter()
                .map(|p| (p - flat[v]).norm())
                .fold(f64::INFINITY, f64::min);
            let straight = slope(&steepest) * (REACH - reach).max(0.0);
            straight.min(STEEP * away)
        };
        let lift: Vec<f64> = (0..n).map(at).collect();
        [lift.clone(), lift].concat()
    }
}

/// Rings of a dome with so many vertices: 2 (1 + 3 n (n + 1)) - 6 n = 2 + 6 n^2.
fn rings_of(vertices: usize) -> u32 {
    (((vertices - 2) / 6) as f64).sqrt().round() as u32
}
