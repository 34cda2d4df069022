//! Where an equilibrium is begun: the skin on the implant, what a coarser skin came to, or an earlier result.

use nalgebra::{Point2, Point3, Vector3};

use super::SkinError;
use super::implant::{BULGE, Implant, upper};
use super::levels::Carried;
use super::plan::{Inserted, Order, Place, Ready};
use super::region::REACH;
use super::settle::{Filled, Method, Model, Progress};
use super::sheet::Sheet;
use crate::contact::Surface;
use crate::mesh::{TriangleMesh, refine};

/// Systems with more unknown vertices than this are solved with a constant factor.
const LARGE: usize = 25_000;

/// A region in which more vertices than this can move is brought to rest with longer edges first.
const COARSE: usize = 400;

/// Greatest slope of the skin at the start.
const STEEP: f64 = 4.0;

/// Where an equilibrium may be begun, if that is known, and the iterations that finding it took.
pub(super) type Begin = (Option<Vec<Point3<f64>>>, u32);

impl Ready {
    /// How a system of so many unknown vertices is solved.
    pub(super) fn method_for(&self, unknown: usize) -> Method {
        self.method.unwrap_or(if unknown > LARGE { Method::QuasiStatic } else { Method::Newton })
    }

    /// The same skin with edges twice as long; `None` where few vertices move, or where that cannot be made ready.
    fn coarser(&self) -> Option<&Self> {
        let make = || {
            if self.layers.held.iter().filter(|held| !**held).count() / 2 <= COARSE {
                return None;
            }
            let edge = 2.0 * self.layers.edge;
            let skin = refine(&self.patch, edge).ok()?.mesh;
            let place = Place::Point(Point3::from(self.frame.translation.vector));
            let order = Order { place, edge: Some(edge), ..self.order.clone() };
            let obstacles: Vec<TriangleMesh> = self.obstacles.iter().map(|o| o.mesh().clone()).collect();
            let coarser = Self::new(&skin, &order, &obstacles).ok()?;
            Some(Box::new(Self { method: self.method, ..coarser }))
        };
        self.coarser.get_or_init(make).as_deref()
    }

    /// As far from `start` as an earlier result came to lie from where it started.
    pub(super) fn further(&self, earlier: &Inserted, start: &[Point3<f64>]) -> Result<Vec<Point3<f64>>, SkinError> {
        let (_, from) = self.model(earlier.implant_volume)?;
        let moved = earlier.x.iter().zip(&from).map(|(to, from)| to - from);
        Ok(start.iter().zip(moved).map(|(x, moved)| x + moved).collect())
    }

    /// Where a coarser skin and its implant came to rest, and the iterations that took.
    pub(super) fn coarsely(
        &self,
        volume: f64,
        start: &[Point3<f64>],
        watch: &mut dyn FnMut(&Progress) -> bool,
    ) -> Result<Begin, SkinError> {
        let Some(coarser) = self.coarser() else { return Ok((None, 0)) };
        match coarser.begun(None, volume, watch) {
            Ok(done) if done.progress.converged => {
                Ok((Some(self.follow(coarser, &done, start)?), done.progress.iterations))
            }
            // Not at rest, it is no better than where it began.
            Ok(done) => Ok((None, done.progress.iterations)),
            Err(SkinError::Stopped) => Err(SkinError::Stopped),
            // What a coarser skin cannot do, this one may.
            Err(_) => Ok((None, 0)),
        }
    }

    /// Where all begins, after a coarser skin and its implant have come to rest.
    fn follow(&self, coarser: &Self, done: &Inserted, start: &[Point3<f64>]) -> Result<Vec<Point3<f64>>, SkinError> {
        let mut x = self.layers.follow(&coarser.layers, &done.x);
        let (_, from) = coarser.model(done.implant_volume)?;
        let first = 2 * coarser.layers.count();
        let moved: Vec<Vector3<f64>> = done.x[first..].iter().zip(&from[first..]).map(|(to, from)| to - from).collect();
        let shell = TriangleMesh { vertices: from[first..].to_vec(), triangles: done.implant_triangles.clone() };
        let carried = Carried::new(shell, &moved);
        x.extend(start[2 * self.layers.count()..].iter().map(|p| p + carried.at(p)));
        Ok(x)
    }

    /// The model of an implant of this volume, and where all starts: the skin as a dome over the implant.
    pub(super) fn model(&self, volume: f64) -> Result<(Model, Vec<Point3<f64>>), SkinError> {
        let implant = Implant { volume, ..self.order.implant };
        let dome = implant.dome(self.layers.edge)?;
        let bulge = implant.bulge(&dome);
        if bulge > BULGE {
            return Err(implant.too_large(self.layers.edge));
        }
        let bed = Surface::new(&self.layers.bed());
        let down = self.frame * -Vector3::z();
        let over = 4.0 * self.order.implant.base + self.order.tissue.depth;
        let mut shell = dome.clone();
        for p in &mut shell.vertices {
            // Over the bed as it is, by as much as over a plane.
            let from = self.frame * Point3::new(p.x, p.y, over);
            let (t, w) = bed.first_hit(&from, &down).ok_or(SkinError::Beyond { bulge })?;
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
        let method = self.method_for(x.len());
        let beds = match &self.obstacles[..] {
            [] => vec![Sheet::new(self.layers.bed())],
            some => some.to_vec(),
        };
        let filled = Filled { mesh: shell, springs, stiffness, volume, pocket };
        let model = Model {
            layers: self.layers.clone(),
            membrane: self.order.tissue.membrane(),
            implants: vec![filled],
            beds,
            ball: None,
            base: self.order.implant.base,
            method,
        };
        Ok((model, x))
    }

    /// How far each vertex of both layers starts above where it rests [m]: on the implant, and from there straight to the rim
    /// of the region, as a taut sheet would lie.
    fn lift(&self, dome: &TriangleMesh, implant: &Implant) -> Vec<f64> {
        let rings = rings_of(dome.vertices.len());
        // Both are the same all along a ring.
        let ring = |k: u32| {
            let p = dome.vertices[if k == 0 { 0 } else { upper(k - 1) as usize }];
            (implant.shape.reach(p.xy(), implant.base), p.z)
        };
        let profile: Vec<(f64, f64)> = (0..=rings).map(ring).collect();
        let slope = |&(out, high): &(f64, f64)| high / (REACH - out);
        let last =
            (0..profile.len()).fold(0, |best, k| if slope(&profile[k]) > slope(&profile[best]) { k } else { best });
        // Further down a dome may overhang; the straight skin is above that.
        let (steepest, top) = (profile[last], &profile[..=last]);
        let implant_at = |reach: f64| {
            let next = top.partition_point(|p| p.0 <= reach).clamp(1, top.len() - 1);
            let ((a, low), (b, high)) = (top[next - 1], top[next]);
            low + (high - low) * (reach - a) / (b - a)
        };
        let n = self.layers.count();
        let flat: Vec<Point2<f64>> =
            self.layers.rest[..n].iter().map(|p| self.frame.inverse_transform_point(p).xy()).collect();
        let rim: Vec<Point2<f64>> = (0..n).filter(|v| self.layers.held[*v]).map(|v| flat[v]).collect();
        let at = |v: usize| {
            if self.layers.held[v] {
                return 0.0;
            }
            let reach = implant.shape.reach(flat[v], implant.base);
            if reach < steepest.0 {
                return implant_at(reach);
            }
            // Where the region ends nearer than the rule says, no steeper than this.
            let away = rim.iter().map(|p| (p - flat[v]).norm()).fold(f64::INFINITY, f64::min);
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
