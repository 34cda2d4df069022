//! Several numbers at once in the lanes of a vector register of `pulp`, with the width chosen at
//! run time.
//!
//! There are two contracts, each with the same bits at every width:
//!
//! * [`Lane`], for constraints: only the operations of IEEE 754, each rounded once, none fused. One
//!   lane is plain `f64`.
//! * [`FusedLane`], for lattices: multiply-add is fused at every width, and the module computes
//!   the reciprocal root itself.

mod fused;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::fmt;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Sub};

pub use fused::{FusedLane, FusedWork, Number};

use crate::particles::Slot;

/// One number or several side by side. Each operation acts on every lane.
pub trait Register<F>: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Proof that the processor has these lanes.
    type Machine: Copy + Send + Sync;
    /// `value` in every lane.
    fn splat(machine: Self::Machine, value: F) -> Self;
}

/// Double precision numbers in lanes without fused operations: any number of lanes gives the bits
/// of plain `f64`.
pub trait Lane: Register<f64> + Div<Output = Self> + Neg<Output = Self> {
    /// A boolean per lane.
    type Mask: Copy + BitAnd<Output = Self::Mask> + BitOr<Output = Self::Mask>;
    /// Number of lanes.
    const COUNT: usize;

    /// `value(l)` in lane `l`.
    fn each(machine: Self::Machine, value: impl Fn(usize) -> f64) -> Self;
    /// The first numbers of `from`, one per lane.
    fn load(machine: Self::Machine, from: &[f64]) -> Self;
    /// Writes the lanes to the first numbers of `to`.
    fn store(self, to: &mut [f64]);
    /// The four columns of the slots `slot(l)`, lane `l` from slot `slot(l)`.
    fn gather(machine: Self::Machine, slots: &[Slot], slot: impl Fn(usize) -> u32) -> [Self; 4];
    /// Writes four columns to the slots `slot(l)`: the opposite of [`Self::gather`].
    fn scatter(columns: [Self; 4], slots: &mut [Slot], slot: impl Fn(usize) -> u32);
    /// Square root.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The absolute value of `self` with the sign of `sign`.
    fn copysign(self, sign: Self) -> Self;
    /// Where `self < other`; false where one is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// Where `self <= other`; false where one is NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `yes` where `mask` is true, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Bit `l` is lane `l` of `mask`.
    fn bits(mask: Self::Mask) -> u32;
    /// Whether `mask` is true in every lane.
    #[inline(always)]
    fn all(mask: Self::Mask) -> bool {
        Self::bits(mask) == (1 << Self::COUNT) - 1
    }
}

impl Lane for f64 {
    type Mask = bool;
    const COUNT: usize = 1;

    #[inline(always)]
    fn each((): (), value: impl Fn(usize) -> f64) -> Self {
        value(0)
    }
    #[inline(always)]
    fn load((): (), from: &[f64]) -> Self {
        from[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[0] = self;
    }
    #[inline(always)]
    fn gather((): (), slots: &[Slot], slot: impl Fn(usize) -> u32) -> [Self; 4] {
        slots[slot(0) as usize].0
    }
    #[inline(always)]
    fn scatter(columns: [Self; 4], slots: &mut [Slot], slot: impl Fn(usize) -> u32) {
        slots[slot(0) as usize].0 = columns;
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        f64::copysign(self, sign)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self <= other
    }
    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    #[inline(always)]
    fn bits(mask: bool) -> u32 {
        u32::from(mask)
    }
}

/// The number of constraints or numbers computed at once. It changes no bit of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SimdWidth {
    /// One at a time.
    One,
    /// Four at a time, with AVX2.
    Four,
    /// Eight at a time, with AVX-512.
    Eight,
}

impl SimdWidth {
    /// All widths of this processor in ascending order; the first is [`SimdWidth::One`].
    pub fn available() -> &'static [Self] {
        const ALL: [SimdWidth; 3] = [SimdWidth::One, SimdWidth::Four, SimdWidth::Eight];
        let count = ALL.iter().take_while(|w| w.is_available()).count();
        &ALL[..count]
    }

    /// The greatest width of this processor.
    pub fn best() -> Self {
        *Self::available().last().unwrap_or(&Self::One)
    }

    /// The number of lanes.
    pub fn lanes(self) -> usize {
        match self {
            Self::One => 1,
            Self::Four => 4,
            Self::Eight => 8,
        }
    }

    fn is_available(self) -> bool {
        match self {
            Self::One => true,
            #[cfg(target_arch = "x86_64")]
            Self::Four => pulp::x86::V3::try_new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Eight => pulp::x86::V4::try_new().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }
}

impl fmt::Display for SimdWidth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::One => "1 lane",
            Self::Four => "4 lanes",
            Self::Eight => "8 lanes",
        })
    }
}

/// Work for any number of lanes.
pub(crate) trait InLanes {
    /// Runs the work.
    fn run<N: Lane>(self, machine: N::Machine);
}

/// Runs the work with lanes of the given width, or one by one if the processor does not have it.
pub(crate) fn run(width: SimdWidth, work: impl InLanes) {
    #[cfg(target_arch = "x86_64")]
    {
        if let (SimdWidth::Eight, Some(machine)) = (width, pulp::x86::V4::try_new()) {
            return machine.vectorize(x86::Plain::<x86::F64x8, _>(machine, work));
        }
        if let (SimdWidth::Four | SimdWidth::Eight, Some(machine)) =
            (width, pulp::x86::V3::try_new())
        {
            return machine.vectorize(x86::Plain::<x86::F64x4, _>(machine, work));
        }
    }
    work.run::<f64>(());
}

/// A vector or a point of space in lanes.
pub(crate) type Triple<N> = [N; 3];

#[inline(always)]
pub(crate) fn sub<N: Lane>(a: Triple<N>, b: Triple<N>) -> Triple<N> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(crate) fn scale<N: Lane>(a: Triple<N>, by: N) -> Triple<N> {
    [a[0] * by, a[1] * by, a[2] * by]
}

#[inline(always)]
pub(crate) fn neg<N: Lane>(a: Triple<N>) -> Triple<N> {
    [-a[0], -a[1], -a[2]]
}

/// The sum of the products in the order of `nalgebra`.
#[inline(always)]
pub(crate) fn dot<N: Lane>(a: Triple<N>, b: Triple<N>) -> N {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(crate) fn cross<N: Lane>(a: Triple<N>, b: Triple<N>) -> Triple<N> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
