//! Lattices of points with springs: fast, since they need no list of springs.
//!
//! Each point of a box of `nx * ny * nz` points has springs to its 6 nearest neighbours, to 18, or to all
//! 26. A step is explicit (Verlet, damping by a backward difference, (3.8) of the source):
//!
//! ```text
//! x(t + dt) = 2 x(t) - x(t - dt) + dt^2/m (F_ext + sum_j D (1 - l0/l) (x_j - x) - c (x(t) - x(t - dt))/dt)
//! ```
//!
//! The caller chooses any consistent units; the source's lattices have none. With metres, kilograms
//! and seconds D is in N/m, m in kg, c in N s/m.
//!
//! # What a step costs
//! Rows along x are stored as runs of x, y and z. Several points are computed side by side, and
//! each spring once. Forces on later rows are stored in one or two planes that stay in the cache.
//! Each thread computes a slab of planes. [`Lattice::run`] makes two steps in one pass through
//! memory. The bits are the same for any number of threads, any [`Width`], and single or paired
//! steps.
//!
//! # Limitations
//! The method is explicit: steps above [`stability_limit`] diverge, and [`Lattice::new`] rejects
//! them. The limit is that of the lattice at rest; springs compressed below half their length have
//! a greater transverse stiffness. The reciprocal length has the relative error
//! [`Number::ROOT_ERROR`] and is not correctly rounded: at rest lengths forces are of that size
//! times `D l0`, not zero. A spring shorter than about 1e-19 (f32) or 1e-154 (f64) has no direction
//! and a negligible force.

mod advance;
mod aligned;
mod error;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
mod kernel;
mod measure;
mod rest;
mod shape;
pub(crate) mod stability;

use std::collections::HashMap;

use aligned::Aligned;
pub use error::LatticeError;
use error::value;
use kernel::{Carried, Frame, Sloped, Spring};
pub(crate) use measure::LatticeMotion;
pub use rest::LatticeRestSettings;
pub use shape::LatticeShape;
pub(crate) use stability::{largest_stiffness, stability_limit};

use super::damping::{self, DampedBody};
use super::neighbours::Neighbours;
use crate::simd::{Number, SimdWidth};

/// Names of the devices that can compute a lattice.
pub const DEVICES: [&str; 2] = ["cpu", "gpu"];

/// Names of the methods on a graphics card: forces and motion in one pass; each point gathers its forces, then each
/// moves; each spring stores its force, then each point takes those of its springs.
pub const GPU_METHODS: [&str; 3] = ["single", "point", "edge"];

/// Stiffness D of a spring as a function of its rest length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stiffness {
    /// `D = 1/l0`: preserves ratios of lengths. The source's default.
    Reciprocal,
    /// The same D for all springs \[N/m\].
    Uniform(f64),
}

impl Stiffness {
    /// D of a spring of this rest length \[N/m\].
    pub fn of(self, rest: f64) -> f64 {
        match self {
            Self::Reciprocal => 1.0 / rest,
            Self::Uniform(value) => value,
        }
    }
}

/// Springs, mass, damping and time step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatticeSettings {
    /// Number of neighbours.
    pub neighbours: Neighbours,
    /// Stiffness D.
    pub stiffness: Stiffness,
    /// Factor of D for springs along more than one axis.
    pub diagonal: f64,
    /// Mass m of a point \[kg\].
    pub mass: f64,
    /// Damping c of a point \[N s/m\]; `None` means [`LatticeSettings::damping_estimate`].
    pub damping: Option<f64>,
    /// Time step dt \[s\]; `None` means half of [`stability_limit`].
    pub time_step: Option<f64>,
}

impl LatticeSettings {
    /// `D = 1/l0`, mass 1, estimated damping and time step.
    pub fn new(neighbours: Neighbours) -> Self {
        Self {
            neighbours,
            stiffness: Stiffness::Reciprocal,
            diagonal: 1.0,
            mass: 1.0,
            damping: None,
            time_step: None,
        }
    }

    /// Parameters for the estimate of the damping; `None` for a single point.
    pub fn body(&self, shape: &LatticeShape) -> Option<DampedBody> {
        let (side, spacing) = shape.longest()?;
        Some(DampedBody {
            mass: self.mass,
            tension: self.stiffness.of(spacing) * spacing,
            side,
            spacing,
        })
    }

    /// Estimated damping for the fastest approach to rest \[N s/m\]: [`damping::estimate`]; 0 for a
    /// single point.
    pub fn damping_estimate(&self, shape: &LatticeShape) -> f64 {
        self.body(shape)
            .map_or(0.0, |body| damping::estimate(self.neighbours, body))
    }

    /// The greatest row sum of the stiffness matrix at rest: twice the stiffness of all springs of an inner
    /// point \[N/m\].
    pub(crate) fn row_sum(&self, shape: &LatticeShape) -> f64 {
        let inner = shape.points.map(|n| n / 2);
        let all = stability::directions(shape, self);
        let both = all.iter().flat_map(|d| [(d, 1), (d, -1)]);
        let sum = both.filter(|(d, sign)| {
            (0..3).all(|c| {
                let at = inner[c] as i64 + sign * i64::from(d.step[c]);
                (0..shape.points[c] as i64).contains(&at)
            })
        });
        sum.map(|(d, _)| 2.0 * d.stiffness).sum()
    }

    fn check(&self) -> Result<(), LatticeError> {
        if let Stiffness::Uniform(d) = self.stiffness {
            value("the stiffness", d, false)?;
        }
        value("the factor of diagonal stiffness", self.diagonal, true)?;
        value("the mass", self.mass, false)?;
        self.damping
            .map_or(Ok(()), |c| value("the damping", c, true))?;
        self.time_step
            .map_or(Ok(()), |dt| value("the time step", dt, false))
    }
}

/// A lattice of points with springs, computed in `f32` or `f64`.
#[derive(Clone, Debug)]
pub struct Lattice<F> {
    shape: LatticeShape,
    settings: LatticeSettings,
    damping: f64,
    time_step: f64,
    frame: Frame<F>,
    /// dt^2 / m.
    gain: F,
    current: Aligned<F>,
    previous: Aligned<F>,
    /// Pinned points of each row.
    pinned: Vec<bool>,
    /// True if the patterns of pinned points are out of date.
    patterns_due: bool,
    /// Carried forces of each slab and each of two steps.
    carried: Vec<[Carried<F>; 2]>,
    /// Copies of planes between slabs.
    seams: Vec<F>,
    width: SimdWidth,
    steps: u64,
}

impl<F: Number> Lattice<F> {
    /// Creates a lattice at rest without pinned points.
    ///
    /// # Errors
    /// [`LatticeError`] for an invalid number, or for a time step above [`stability_limit`].
    pub fn new(shape: LatticeShape, settings: LatticeSettings) -> Result<Self, LatticeError> {
        let lattice = Self::unchecked(shape, settings)?;
        let (limit, time_step) = (lattice.stability_limit(), lattice.time_step);
        if time_step < limit {
            return Ok(lattice);
        }
        let (mass, damping, stiffness) = (
            settings.mass,
            lattice.damping,
            largest_stiffness(&shape, &settings),
        );
        Err(LatticeError::Unstable {
            time_step,
            limit,
            mass,
            damping,
            stiffness,
        })
    }

    /// The same with any time step, to demonstrate instability.
    ///
    /// # Errors
    /// [`LatticeError`] for an invalid number.
    pub fn unchecked(shape: LatticeShape, settings: LatticeSettings) -> Result<Self, LatticeError> {
        shape.check()?;
        settings.check()?;
        let damping = settings
            .damping
            .unwrap_or_else(|| settings.damping_estimate(&shape));
        let time_step = settings.time_step.unwrap_or_else(|| {
            let limit =
                stability_limit(largest_stiffness(&shape, &settings), settings.mass, damping);
            if limit.is_finite() { limit / 2.0 } else { 1.0 }
        });
        let frame = frame(&shape, &settings, damping * time_step / settings.mass);
        let gain = F::from_f64(time_step * time_step / settings.mass);
        let numbers = shape.points[2] * frame.plane();
        let mut lattice = Self {
            shape,
            settings,
            damping,
            time_step,
            frame,
            gain,
            current: Aligned::zeros(numbers),
            previous: Aligned::zeros(numbers),
            pinned: vec![false; shape.count()],
            patterns_due: true,
            carried: Vec::new(),
            seams: Vec::new(),
            width: SimdWidth::best(),
            steps: 0,
        };
        shape
            .each()
            .for_each(|point| lattice.place(point, shape.at(point)));
        Ok(lattice)
    }

    /// Sets the SIMD width; no bit of a result depends on it. A width of four or eight doubles in
    /// `f32`.
    pub fn with_width(mut self, width: SimdWidth) -> Self {
        self.width = width;
        self
    }

    /// The points at rest.
    pub fn shape(&self) -> &LatticeShape {
        &self.shape
    }

    /// The settings of the lattice.
    pub fn settings(&self) -> &LatticeSettings {
        &self.settings
    }

    /// Damping c in use \[N s/m\].
    pub fn damping(&self) -> f64 {
        self.damping
    }

    /// Time step dt in use \[s\].
    pub fn time_step(&self) -> f64 {
        self.time_step
    }

    /// Number of steps so far.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Number of springs.
    pub fn spring_count(&self) -> usize {
        self.settings.neighbours.springs(self.shape.points)
    }

    /// The time step above which this lattice diverges \[s\].
    pub fn stability_limit(&self) -> f64 {
        stability_limit(
            largest_stiffness(&self.shape, &self.settings),
            self.settings.mass,
            self.damping,
        )
    }

    /// Indices of the coordinates of a point.
    fn index(&self, [i, j, k]: [usize; 3]) -> [usize; 3] {
        let [nx, ny, nz] = self.shape.points;
        assert!(
            i < nx && j < ny && k < nz,
            "no point {i}, {j}, {k} in a lattice of {nx} x {ny} x {nz}"
        );
        let row = k * self.frame.plane() + j * self.frame.row();
        [0, 1, 2].map(|c| row + c * self.frame.run + i)
    }

    fn number(&self, point: [usize; 3]) -> usize {
        self.shape.index(point) as usize
    }

    /// Position of a point \[m\].
    ///
    /// # Panics
    /// If the point does not exist; so do all functions with a point as argument.
    pub fn position(&self, point: [usize; 3]) -> [f64; 3] {
        self.index(point).map(|at| self.current[at].to_f64())
    }

    /// Position of a point in the previous step \[m\].
    pub fn previous_position(&self, point: [usize; 3]) -> [f64; 3] {
        self.index(point).map(|at| self.previous[at].to_f64())
    }

    /// Positions of all points \[m\], x first.
    pub fn positions(&self) -> Vec<[f64; 3]> {
        self.shape
            .each()
            .map(|point| self.position(point))
            .collect()
    }

    /// Moves a point to a position, with velocity zero.
    pub fn place(&mut self, point: [usize; 3], position: [f64; 3]) {
        for (at, x) in self.index(point).into_iter().zip(position) {
            self.current[at] = F::from_f64(x);
            self.previous[at] = self.current[at];
        }
    }

    /// Moves a point to a position, with a velocity \[m/s\].
    pub fn launch(&mut self, point: [usize; 3], position: [f64; 3], velocity: [f64; 3]) {
        for ((at, x), v) in self.index(point).into_iter().zip(position).zip(velocity) {
            self.current[at] = F::from_f64(x);
            self.previous[at] = F::from_f64(x - v * self.time_step);
        }
    }

    /// Fixes a point at its position.
    pub fn pin(&mut self, point: [usize; 3]) {
        self.place(point, self.position(point));
        self.set_pinned(point, true);
    }

    /// Releases a point with velocity zero.
    pub fn release(&mut self, point: [usize; 3]) {
        self.set_pinned(point, false);
    }

    /// True if a point is fixed.
    pub fn is_pinned(&self, point: [usize; 3]) -> bool {
        let _ = self.index(point);
        self.pinned[self.number(point)]
    }

    fn set_pinned(&mut self, point: [usize; 3], pinned: bool) {
        let _ = self.index(point);
        let number = self.number(point);
        self.pinned[number] = pinned;
        self.patterns_due = true;
    }

    /// Sets the external force on a point \[N\].
    pub fn set_force(&mut self, point: [usize; 3], force: [f64; 3]) {
        if self.frame.external.is_empty() {
            self.frame.external = vec![F::default(); self.shape.points[2] * self.frame.plane()];
        }
        for (at, f) in self.index(point).into_iter().zip(force) {
            self.frame.external[at] = F::from_f64(f);
        }
    }

    /// External force on a point \[N\].
    pub fn force(&self, point: [usize; 3]) -> [f64; 3] {
        self.index(point)
            .map(|at| self.frame.external.get(at).map_or(0.0, |f| f.to_f64()))
    }

    /// Finds the distinct patterns of pinned points in rows.
    fn find_patterns(&mut self) {
        if !std::mem::take(&mut self.patterns_due) {
            return;
        }
        let (nx, run) = (self.shape.points[0], self.frame.run);
        let mut known: HashMap<&[bool], u32> = HashMap::new();
        let (mut patterns, mut of_rows) = (Vec::new(), Vec::with_capacity(self.pinned.len() / nx));
        for row in self.pinned.chunks_exact(nx) {
            let next = known.len() as u32;
            let pattern = *known.entry(row).or_insert(next);
            of_rows.push(pattern);
            if pattern == next && patterns.len() == next as usize * run {
                patterns.extend(
                    row.iter()
                        .map(|&pinned| if pinned { F::default() } else { self.gain }),
                );
                patterns.resize((next as usize + 1) * run, F::default());
            }
        }
        self.frame.patterns = patterns;
        self.frame.pattern = of_rows;
    }
}

/// The value for each point of a row with a next point, 0 for the other places of the row.
fn masked<F: Number>(value: F, points: usize, run: usize) -> Vec<F> {
    (0..run)
        .map(|i| if i + 1 < points { value } else { F::default() })
        .collect()
}

fn frame<F: Number>(shape: &LatticeShape, settings: &LatticeSettings, lost: f64) -> Frame<F> {
    let [nx, ny, _] = shape.points;
    let run = nx.next_multiple_of(F::ROW);
    let all = stability::directions(shape, settings);
    let spring = |step: [i32; 3]| {
        let found = all.iter().find(|d| d.step == step);
        let [stiffness, tension] = found.map_or([0.0; 2], |d| [d.stiffness, d.stiffness * d.rest]);
        Spring {
            stiffness: F::from_f64(stiffness),
            tension: F::from_f64(tension),
        }
    };
    let sloped = |step| {
        let Spring { stiffness, tension } = spring(step);
        Sloped {
            stiffness: masked(stiffness, nx, run),
            tension: masked(tension, nx, run),
        }
    };
    Frame {
        rows: ny,
        run,
        // With 18 neighbours the springs along xyz have no stiffness.
        diagonal: settings.neighbours != Neighbours::Six,
        straight: [spring([0, 1, 0]), spring([0, 0, 1]), spring([0, 1, 1])],
        sloped: [
            sloped([1, 0, 0]),
            sloped([1, 1, 0]),
            sloped([1, 0, 1]),
            sloped([1, 1, 1]),
        ],
        kept: F::from_f64(1.0 - lost),
        patterns: Vec::new(),
        pattern: Vec::new(),
        external: Vec::new(),
    }
}
