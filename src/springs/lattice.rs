//! Lattices of points on springs: fast because they need no list of springs.
//!
//! Each point of a box of `nx * ny * nz` points has springs to its 6 nearest neighbours or to all 26. A step is explicit
//! (Verlet, damping by a backward difference, (3.8) of the source):
//!
//! ```text
//! x(t + dt) = 2 x(t) - x(t - dt) + dt^2/m (F_ext + sum_j D (1 - l0/l) (x_j - x) - c (x(t) - x(t - dt))/dt)
//! ```
//!
//! Units are the caller's, any consistent set; the source's lattices are without units. With metres, kilograms and seconds
//! D is in N/m, m in kg, c in N s/m.
//!
//! # What a step costs
//! Rows along x lie as runs of x, y and z; several points are computed side by side, each spring once; forces on rows to come
//! wait in a plane or two that stay in the cache. Threads take slabs of planes. [`Lattice::run`] makes two steps in one pass
//! through memory. Any number of threads, any [`SimdWidth`], and steps one by one or in pairs give the same bits.
//!
//! # Limitations
//! Explicit: steps above [`stability_limit`] explode, which [`Lattice::new`] refuses; the limit is that of the lattice at rest, and
//! springs pressed to under half their length are stiffer than that sideways. The reciprocal length is computed
//! to [`Number::ROOT_ERROR`], not correctly rounded: at rest lengths forces are of that size times `D l0`, not zero. A spring
//! shorter than about 1e-19 (f32) or 1e-154 (f64) has no direction and pulls or pushes nothing to speak of.

mod advance;
mod aligned;
mod error;
mod kernel;
mod rest;
mod shape;
mod stability;

use std::collections::HashMap;

use aligned::Aligned;
pub use error::LatticeError;
use error::value;
use kernel::{Carried, Frame, Sloped, Spring};
pub use rest::{Rest, Settled};
pub use shape::Shape;
pub use stability::{largest_stiffness, stability_limit};

use super::damping::{self, Body};
use super::neighbours::Neighbours;
use crate::simd::{Number, SimdWidth};

/// D of a spring, from its length at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stiffness {
    /// `D = 1/l0`: keeps ratios of lengths. The source's default.
    Reciprocal,
    /// The same for all \[N/m\].
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
pub struct Settings {
    /// Which springs there are.
    pub neighbours: Neighbours,
    /// D.
    pub stiffness: Stiffness,
    /// Factor of D of springs that go along more than one axis.
    pub diagonal: f64,
    /// m of a point \[kg\].
    pub mass: f64,
    /// c of a point \[N s/m\]; nothing for [`Settings::damping_estimate`].
    pub damping: Option<f64>,
    /// dt \[s\]; nothing for half of [`stability_limit`].
    pub time_step: Option<f64>,
}

impl Settings {
    /// `D = 1/l0`, mass 1, damping and time step estimated.
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

    /// What the estimate of the damping needs to know of a lattice; nothing for a single point.
    pub fn body(&self, shape: &Shape) -> Option<Body> {
        let (side, spacing) = shape.longest()?;
        Some(Body {
            mass: self.mass,
            tension: self.stiffness.of(spacing) * spacing,
            side,
            spacing,
        })
    }

    /// The damping that brings a lattice to rest soonest \[N s/m\], as far as is known: [`damping::estimate`]; 0 for a single point.
    pub fn damping_estimate(&self, shape: &Shape) -> f64 {
        self.body(shape)
            .map_or(0.0, |body| damping::estimate(self.neighbours, body))
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

/// A lattice of points on springs, computed in `f32` or `f64`.
#[derive(Clone, Debug)]
pub struct Lattice<F> {
    shape: Shape,
    settings: Settings,
    damping: f64,
    time_step: f64,
    frame: Frame<F>,
    /// dt^2 / m.
    gain: F,
    current: Aligned<F>,
    previous: Aligned<F>,
    /// Of each row, which points are pinned.
    pinned: Vec<bool>,
    /// Whether the patterns of pinned points are to be found anew.
    patterns_due: bool,
    /// For each slab and each of two steps.
    carried: Vec<[Carried<F>; 2]>,
    /// Copies of planes where slabs meet.
    seams: Vec<F>,
    width: SimdWidth,
    steps: u64,
}

impl<F: Number> Lattice<F> {
    /// A lattice at rest, nothing pinned.
    ///
    /// # Errors
    /// [`LatticeError`] if a number is no good, or if the time step is above [`stability_limit`].
    pub fn new(shape: Shape, settings: Settings) -> Result<Self, LatticeError> {
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

    /// The same with any time step, to show what an unstable one does.
    ///
    /// # Errors
    /// [`LatticeError`] if a number is no good.
    pub fn unchecked(shape: Shape, settings: Settings) -> Result<Self, LatticeError> {
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

    /// Computes with another width; no bit of a result depends on it. A width of four or eight is twice as wide in `f32`.
    pub fn with_width(mut self, width: SimdWidth) -> Self {
        self.width = width;
        self
    }

    /// The points at rest.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// What the lattice was built with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// c in use \[N s/m\].
    pub fn damping(&self) -> f64 {
        self.damping
    }

    /// dt in use \[s\].
    pub fn time_step(&self) -> f64 {
        self.time_step
    }

    /// Steps so far.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Number of springs.
    pub fn spring_count(&self) -> usize {
        self.settings.neighbours.springs(self.shape.points)
    }

    /// The time step from which on this lattice explodes \[s\].
    pub fn stability_limit(&self) -> f64 {
        stability_limit(
            largest_stiffness(&self.shape, &self.settings),
            self.settings.mass,
            self.damping,
        )
    }

    /// Where the numbers of a point are.
    fn index(&self, [i, j, k]: [usize; 3]) -> [usize; 3] {
        let [nx, ny, nz] = self.shape.points;
        assert!(
            i < nx && j < ny && k < nz,
            "no point {i}, {j}, {k} in a lattice of {nx} x {ny} x {nz}"
        );
        let row = k * self.frame.plane() + j * self.frame.row();
        [0, 1, 2].map(|c| row + c * self.frame.run + i)
    }

    fn number(&self, [i, j, k]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.shape.points;
        (k * ny + j) * nx + i
    }

    /// Position of a point \[m\].
    ///
    /// # Panics
    /// If there is no such point; so do all functions that take one.
    pub fn position(&self, point: [usize; 3]) -> [f64; 3] {
        self.index(point).map(|at| self.current[at].to_f64())
    }

    /// Position of a point one step ago \[m\].
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

    /// Puts a point somewhere, without speed.
    pub fn place(&mut self, point: [usize; 3], position: [f64; 3]) {
        for (at, x) in self.index(point).into_iter().zip(position) {
            self.current[at] = F::from_f64(x);
            self.previous[at] = self.current[at];
        }
    }

    /// Puts a point somewhere, with a velocity \[m/s\].
    pub fn launch(&mut self, point: [usize; 3], position: [f64; 3], velocity: [f64; 3]) {
        for ((at, x), v) in self.index(point).into_iter().zip(position).zip(velocity) {
            self.current[at] = F::from_f64(x);
            self.previous[at] = F::from_f64(x - v * self.time_step);
        }
    }

    /// Holds a point where it is.
    pub fn pin(&mut self, point: [usize; 3]) {
        self.place(point, self.position(point));
        self.set_pinned(point, true);
    }

    /// Lets a point go; it starts without speed.
    pub fn release(&mut self, point: [usize; 3]) {
        self.set_pinned(point, false);
    }

    /// Whether a point is held.
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

    /// Force on a point from outside \[N\], until another one is given.
    pub fn set_force(&mut self, point: [usize; 3], force: [f64; 3]) {
        if self.frame.external.is_empty() {
            self.frame.external = vec![F::default(); self.shape.points[2] * self.frame.plane()];
        }
        for (at, f) in self.index(point).into_iter().zip(force) {
            self.frame.external[at] = F::from_f64(f);
        }
    }

    /// Force on a point from outside \[N\].
    pub fn force(&self, point: [usize; 3]) -> [f64; 3] {
        self.index(point)
            .map(|at| self.frame.external.get(at).map_or(0.0, |f| f.to_f64()))
    }

    /// Each pattern of pinned points of a row once.
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

fn frame<F: Number>(shape: &Shape, settings: &Settings, lost: f64) -> Frame<F> {
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
        let masked = |value: F| {
            (0..run)
                .map(|i| if i + 1 < nx { value } else { F::default() })
                .collect()
        };
        Sloped {
            stiffness: masked(stiffness),
            tension: masked(tension),
        }
    };
    Frame {
        rows: ny,
        run,
        diagonal: settings.neighbours == Neighbours::TwentySix,
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
