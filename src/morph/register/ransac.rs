//! Start of a registration: pairs of points with normals that are similar on both surfaces.
//!
//! Two points p, q with normals m, n have three angles that no similarity changes: of m and of n to
//! q - p, and between the two about this line. A pair on each surface with equal angles determines
//! the whole motion with its scale. The search keeps the motion with the most points on the other
//! surface. It needs two good points; without normals it would need three.

use std::collections::HashMap;

use nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, Similarity3, Translation3, UnitQuaternion, Vector3,
};

use rayon::prelude::*;

use super::fit::{FitMotion, draws_needed};
use super::icp::Select;
use super::{Icp, RegisterError, RegistrationSurface};
use crate::mesh::Aabb;
use crate::progress::{Progress, Silent};
use crate::random::Random;

/// Settings of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ransac {
    /// Whether size may change.
    pub motion: FitMotion,
    /// Least share of the moving surface's points that correspond to the other surface.
    pub good: f64,
    /// Probability of drawing at least one pair of good points.
    pub sure: f64,
    /// Number of draws relative to the theoretical number: normals of different samples differ, and
    /// some good pairs are not recognised.
    pub patience: f64,
    /// Distance to the other surface at which a point agrees, relative to the size of the smaller
    /// surface.
    pub near: f64,
    /// Least and greatest scale.
    pub scales: [f64; 2],
    /// Number of points of the fixed surface whose pairs are listed.
    pub listed: usize,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for Ransac {
    fn default() -> Self {
        Self {
            motion: FitMotion::Rigid,
            good: 0.3,
            sure: 0.99,
            patience: 5.0,
            near: 0.01,
            scales: [0.2, 5.0],
            listed: 400,
            seed: 1,
        }
    }
}

/// Number of bins of each of the three angles.
const BINS: f64 = 24.0;
/// Number of points in a first test, and the share of the required agreement that they must have.
const FIRST: usize = 24;

/// Number of searches, each with other points, until enough points agree.
const ATTEMPTS: usize = 4;

/// Number of distinct motions that are refined slightly, and of the best ones that are refined
/// further.
const KEPT: usize = 60;
const BEST: usize = 6;
/// Two motions are alike if their difference is within this distance at all points, relative to the
/// size of the fixed surface.
const ALIKE: f64 = 0.04;
/// Reliable part of the share of agreeing points: some agree by chance.
const BELIEVED: f64 = 0.8;
/// Distance of agreement after refining, relative to that before.
const CLOSER: f64 = 0.2;

/// Two points with normals.
type Oriented = [(Point3<f64>, Vector3<f64>); 2];

/// Cosines of both normals with the line, and the angle between the normals about the line.
fn angles([(p, m), (q, n)]: &Oriented) -> Option<[f64; 3]> {
    let d = (q - p).try_normalize(0.0)?;
    let (a, b) = (m - d * m.dot(&d), n - d * n.dot(&d));
    // A normal along the line has no direction about it.
    if !(a.norm() > 0.2 && b.norm() > 0.2) {
        return None;
    }
    let about = libm::atan2(d.dot(&a.cross(&b)), a.dot(&b));
    Some([m.dot(&d), n.dot(&d), about])
}

fn bin(angles: &[f64; 3]) -> [i32; 3] {
    let [a, b, c] = *angles;
    [
        (a * BINS / 2.0).floor() as i32,
        (b * BINS / 2.0).floor() as i32,
        (c * BINS / std::f64::consts::TAU).floor() as i32,
    ]
}

/// The motion that takes one pair to another.
fn motion(from: &Oriented, to: &Oriented, kind: FitMotion) -> Option<Similarity3<f64>> {
    let frame = |[(p, m), (q, n)]: &Oriented| {
        let d = (q - p).try_normalize(0.0)?;
        let side = (m - d * m.dot(&d)).normalize() + (n - d * n.dot(&d)).normalize();
        let across = (side - d * side.dot(&d)).try_normalize(1e-3)?;
        Some(Matrix3::from_columns(&[d, across, d.cross(&across)]))
    };
    // The sum of the two normals is the same on both sides, since they form the same angle.
    let rotation = frame(to)? * frame(from)?.transpose();
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let lengths = [from, to].map(|pair| (pair[1].0 - pair[0].0).norm());
    let scale = if kind == FitMotion::Similarity {
        lengths[1] / lengths[0]
    } else {
        1.0
    };
    let middles = [from, to].map(|pair| (pair[0].0.coords + pair[1].0.coords) * 0.5);
    let shift = middles[1] - rotation * middles[0] * scale;
    Some(Similarity3::from_isometry(
        Isometry3::from_parts(Translation3::from(shift), rotation),
        scale,
    ))
}

/// Data that are constant over all draws.
struct Search<'a> {
    settings: &'a Ransac,
    moving: &'a RegistrationSurface<'a>,
    fixed: &'a RegistrationSurface<'a>,
    listed: Vec<u32>,
    pairs: HashMap<[i32; 3], Vec<[u32; 2]>>,
    tried: Vec<u32>,
    /// Vertices of the moving surface with a normal, and the diagonal of their box.
    with: Vec<u32>,
    size: f64,
    required: usize,
}

impl Ransac {
    /// Finds a motion of `moving` for which at least the share [`Self::good`] of its points agrees
    /// with `fixed`.
    ///
    /// # Errors
    /// No motion was found.
    pub fn start(
        &self,
        moving: &RegistrationSurface<'_>,
        fixed: &RegistrationSurface<'_>,
    ) -> Result<Similarity3<f64>, RegisterError> {
        let found = self.best(moving, fixed, &[], &Silent)?;
        if found.inliers >= found.required {
            Ok(found.motion)
        } else {
            Err(found.too_few())
        }
    }

    /// The best motion of the draws and of `others`, for any number of agreeing points.
    ///
    /// # Errors
    /// No motion was found, or `progress` stopped the search.
    pub fn best(
        &self,
        moving: &RegistrationSurface<'_>,
        fixed: &RegistrationSurface<'_>,
        others: &[Similarity3<f64>],
        progress: &dyn Progress,
    ) -> Result<InitialAlignment, RegisterError> {
        let mut draws = Random::new(self.seed);
        let mut best: Option<(usize, InitialAlignment)> = None;
        for _ in 0..ATTEMPTS {
            let search = Search::new(self, moving, fixed, &mut draws);
            let next = self.once(&search, others, &mut draws, progress)?;
            let drawn = next.1.draws + best.as_ref().map_or(0, |b| b.1.draws);
            let (score, begun) = best.filter(|b| b.0 >= next.0).unwrap_or(next);
            let begun = InitialAlignment {
                draws: drawn,
                ..begun
            };
            if begun.inliers >= begun.required {
                return Ok(begun);
            }
            best = Some((score, begun));
        }
        let none = RegisterError::NoStart {
            draws: 0,
            inliers: 0,
            of: 0,
            required: 0,
        };
        best.map(|b| b.1).ok_or(none)
    }

    /// One search among listed points. Returns the motion with the most agreeing points, and its
    /// score.
    fn once(
        &self,
        search: &Search<'_>,
        others: &[Similarity3<f64>],
        draws: &mut Random,
        progress: &dyn Progress,
    ) -> Result<(usize, InitialAlignment), RegisterError> {
        let needed = (self.patience
            * draws_needed(
                self.good.clamp(0.01, 0.99),
                2,
                self.sure.clamp(0.0, 0.999_999),
            ))
        .ceil();
        let mut best: Vec<(usize, Similarity3<f64>)> = Vec::new();
        let (mut required, mut count) = (needed.max(1.0) as usize, 0);
        while count < required {
            if progress.is_stopped() {
                return Err(RegisterError::Stopped);
            }
            count += 1;
            let Some(from) = search.draw(draws) else {
                continue;
            };
            let least = if best.len() < KEPT {
                0
            } else {
                best[KEPT - 1].0
            };
            let judge = |motion: Similarity3<f64>| {
                (search.agreeing(&motion, Some(least), self.near), motion)
            };
            let judged: Vec<(usize, Similarity3<f64>)> = search
                .candidates(&from)
                .into_par_iter()
                .map(judge)
                .filter(|(agreeing, _)| *agreeing > least)
                .collect();
            best.extend(judged);
            best.sort_by_key(|b| std::cmp::Reverse(b.0));
            search.keep_different(&mut best);
            // The number of draws for the observed share of good points.
            let seen = best
                .first()
                .map_or(0.0, |b| BELIEVED * b.0 as f64 / search.tried.len() as f64);
            let enough = (self.patience
                * draws_needed(seen.clamp(0.01, 0.99), 2, self.sure.clamp(0.0, 0.999_999)))
            .ceil();
            required = required.min(enough.max(1.0) as usize);
        }
        let starts: Vec<Similarity3<f64>> = others
            .iter()
            .copied()
            .chain(best.iter().map(|(_, motion)| *motion))
            .collect();
        let mut first = search.refined(&starts, 8);
        first.sort_by_key(|f| std::cmp::Reverse(f.0));
        first.truncate(BEST);
        let starts: Vec<Similarity3<f64>> = first.iter().map(|f| f.2).collect();
        let (of, required) = (search.tried.len(), search.required);
        let found = search
            .refined(&starts, 30)
            .into_iter()
            .reduce(|best, next| if next.0 > best.0 { next } else { best });
        let none = RegisterError::NoStart {
            draws: count,
            inliers: 0,
            of,
            required,
        };
        let (score, inliers, motion) = found.ok_or(none)?;
        Ok((
            score,
            InitialAlignment {
                motion,
                draws: count,
                inliers,
                of,
                required,
            },
        ))
    }
}

/// Start of a registration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InitialAlignment {
    /// Motion of the moving surface to near the fixed one.
    pub motion: Similarity3<f64>,
    /// Number of draws.
    pub draws: usize,
    /// Number of tested points that agree.
    pub inliers: usize,
    /// Number of tested points.
    pub of: usize,
    /// Required number of agreeing points.
    pub required: usize,
}

impl InitialAlignment {
    /// The error for too few agreeing points.
    pub fn too_few(&self) -> RegisterError {
        let Self {
            draws,
            inliers,
            of,
            required,
            ..
        } = *self;
        RegisterError::NoStart {
            draws,
            inliers,
            of,
            required,
        }
    }
}

impl<'a> Search<'a> {
    fn new(
        settings: &'a Ransac,
        moving: &'a RegistrationSurface<'a>,
        fixed: &'a RegistrationSurface<'a>,
        draws: &mut Random,
    ) -> Self {
        let sample = |count: usize, of: usize, draws: &mut Random| -> Vec<u32> {
            let mut all: Vec<u32> = (0..of as u32).collect();
            for i in 0..count.min(of) {
                let j = i + draws.index(of - i);
                all.swap(i, j);
            }
            all.truncate(count);
            all
        };
        let listed = sample(settings.listed, fixed.points().len(), draws);
        // A point without a normal agrees with nothing.
        let with: Vec<u32> = (0..moving.points().len() as u32)
            .filter(|&v| moving.normals()[v as usize] != Vector3::zeros())
            .collect();
        let tried: Vec<u32> = sample(300, with.len(), draws)
            .into_iter()
            .map(|i| with[i as usize])
            .collect();
        // Two thirds of the expected good points, since some lie at boundaries.
        let required = ((settings.good * tried.len() as f64 * 2.0 / 3.0).ceil() as usize).max(3);
        let size = Aabb::of_points(with.iter().map(|&v| &moving.points()[v as usize]))
            .extents()
            .norm();
        let mut search = Self {
            settings,
            moving,
            fixed,
            listed,
            pairs: HashMap::new(),
            tried,
            with,
            size,
            required,
        };
        for &i in &search.listed {
            for &j in &search.listed {
                let pair = oriented(search.fixed, [i, j]);
                let apart = (pair[1].0 - pair[0].0).norm();
                if apart < 0.1 * search.fixed.size() {
                    continue;
                }
                if let Some(angles) = angles(&pair) {
                    search.pairs.entry(bin(&angles)).or_default().push([i, j]);
                }
            }
        }
        search
    }

    /// Two points of the moving surface that are far apart.
    fn draw(&self, draws: &mut Random) -> Option<Oriented> {
        if self.with.is_empty() {
            return None;
        }
        for _ in 0..50 {
            let mut any = || self.with[draws.index(self.with.len())];
            let pair = oriented(self.moving, [any(), any()]);
            let apart = (pair[1].0 - pair[0].0).norm();
            if apart > 0.15 * self.size && angles(&pair).is_some() {
                return Some(pair);
            }
        }
        None
    }

    /// Of motions sorted by their number of agreeing points, those that differ from every better
    /// one, at most [`KEPT`].
    fn keep_different(&self, best: &mut Vec<(usize, Similarity3<f64>)>) {
        let probes: Vec<Point3<f64>> = self
            .tried
            .iter()
            .take(4)
            .map(|&v| self.moving.points()[v as usize])
            .collect();
        let within = ALIKE * self.fixed.size();
        let mut kept: Vec<(usize, Similarity3<f64>)> = Vec::with_capacity(KEPT);
        for (agreeing, motion) in best.iter() {
            let alike = |(_, other): &(usize, Similarity3<f64>)| {
                probes
                    .iter()
                    .all(|p| (motion * p - other * p).norm() <= within)
            };
            if !kept.iter().any(alike) {
                kept.push((*agreeing, *motion));
            }
            if kept.len() == KEPT {
                break;
            }
        }
        *best = kept;
    }

    /// Motions after some rounds of closest points, each with its number of points that agree
    /// closely and less closely together, and closely alone. A correct motion improves by refining
    /// and then agrees more closely; one that agrees by chance does not.
    fn refined(
        &self,
        starts: &[Similarity3<f64>],
        rounds: usize,
    ) -> Vec<(usize, usize, Similarity3<f64>)> {
        let settings = self.settings;
        let icp = Icp {
            motion: settings.motion,
            select: Select::About(400),
            rounds,
            ..Icp::default()
        };
        let [low, high] = settings.scales;
        let refine = |start: &Similarity3<f64>| {
            let motion = icp.run(self.moving, self.fixed, start).ok()?.motion;
            if settings.motion == FitMotion::Similarity && !(low..=high).contains(&motion.scaling())
            {
                return None;
            }
            let closely = self.agreeing(&motion, None, CLOSER * settings.near);
            Some((
                closely + self.agreeing(&motion, None, settings.near),
                closely,
                motion,
            ))
        };
        starts.par_iter().filter_map(refine).collect()
    }

    /// Motions to all similar listed pairs.
    fn candidates(&self, from: &Oriented) -> Vec<Similarity3<f64>> {
        let Some(own) = angles(from) else {
            return Vec::new();
        };
        let middle = bin(&own);
        let length = (from[1].0 - from[0].0).norm();
        let tolerance = [2.0 / BINS, 2.0 / BINS, std::f64::consts::TAU / BINS].map(|t| 0.7 * t);
        let mut found = Vec::new();
        for (a, b, c) in
            (-1..=1).flat_map(|a| (-1..=1).flat_map(move |b| (-1..=1).map(move |c| (a, b, c))))
        {
            let key = [middle[0] + a, middle[1] + b, middle[2] + c];
            for &pair in self.pairs.get(&key).into_iter().flatten() {
                let to = oriented(self.fixed, pair);
                let scale = (to[1].0 - to[0].0).norm() / length;
                let fits = match self.settings.motion {
                    FitMotion::Rigid => (scale - 1.0).abs() < 0.1,
                    FitMotion::Similarity => {
                        scale >= self.settings.scales[0] && scale <= self.settings.scales[1]
                    }
                };
                let alike =
                    |theirs: [f64; 3]| (0..3).all(|k| (theirs[k] - own[k]).abs() <= tolerance[k]);
                if fits && angles(&to).is_some_and(alike) {
                    found.extend(motion(from, &to, self.settings.motion));
                }
            }
        }
        found
    }

    /// Number of tested points near the other surface with a similar normal; 0 where it can hardly
    /// exceed `least`.
    fn agreeing(&self, motion: &Similarity3<f64>, least: Option<usize>, near: f64) -> usize {
        // Relative to the smaller of the two: otherwise a surface that shrinks to a point would
        // agree with any.
        let moved = motion.scaling() * self.size;
        let within = near * self.fixed.size().min(moved);
        let agrees = |&&v: &&u32| {
            let at = motion * self.moving.points()[v as usize];
            let normal = motion.isometry.rotation * self.moving.normals()[v as usize];
            self.fixed.tree().is_near_facing(&at, &normal, 0.7, within)
        };
        let first = self.tried.iter().take(FIRST).filter(agrees).count();
        if let Some(least) = least {
            let share = self.required.max(least) as f64 / self.tried.len() as f64;
            if (first as f64) < 0.5 * share * FIRST as f64 {
                return 0;
            }
        }
        first + self.tried.iter().skip(FIRST).filter(agrees).count()
    }
}

fn oriented(surface: &RegistrationSurface<'_>, pair: [u32; 2]) -> Oriented {
    pair.map(|v| (surface.points()[v as usize], surface.normals()[v as usize]))
}
