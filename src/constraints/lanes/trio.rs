//! Vectors of space with their components side by side, for sums that visit one vertex after another.

use std::ops::{Add, Mul, Sub};

use super::Width;
#[cfg(target_arch = "x86_64")]
use super::x86;
use crate::particles::Slot;

/// A vector of space; the fourth component of what it is read from or written to means nothing.
pub(crate) trait Trio: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Proof that the processor has the instructions.
    type Machine: Copy;
    /// Reads the first three components.
    fn read(machine: Self::Machine, slot: &Slot) -> Self;
    /// Three times the same.
    fn splat(machine: Self::Machine, value: f64) -> Self;
    /// Components y, z, x.
    fn turned(self) -> Self;
    /// The components, and anything.
    fn slot(self) -> Slot;
}

/// Three numbers without vector instructions.
#[derive(Clone, Copy)]
pub(crate) struct Plain([f64; 3]);

macro_rules! operators {
    ($($operator:ident::$method:ident $sign:tt),*) => {
        $(impl $operator for Plain {
            type Output = Self;
            #[inline(always)]
            fn $method(self, Self([x, y, z]): Self) -> Self {
                Self([self.0[0] $sign x, self.0[1] $sign y, self.0[2] $sign z])
            }
        })*
    };
}

operators!(Add::add +, Sub::sub -, Mul::mul *);

impl Trio for Plain {
    type Machine = ();
    #[inline(always)]
    fn read((): (), &Slot([x, y, z, _]): &Slot) -> Self {
        Self([x, y, z])
    }
    #[inline(always)]
    fn splat((): (), value: f64) -> Self {
        Self([value; 3])
    }
    #[inline(always)]
    fn turned(self) -> Self {
        let [x, y, z] = self.0;
        Self([y, z, x])
    }
    #[inline(always)]
    fn slot(self) -> Slot {
        let [x, y, z] = self.0;
        Slot([x, y, z, 0.0])
    }
}

/// Work that can be done with vectors of any make.
pub(crate) trait InTrios {
    /// Does it.
    fn run<P: Trio>(self, machine: P::Machine);
}

/// Does the work with vector instructions unless `width` is one lane or the processor has none.
pub(crate) fn run_in_trios(width: Width, work: impl InTrios) {
    #[cfg(target_arch = "x86_64")]
    if let (Width::Four | Width::Eight, Some(machine)) = (width, pulp::x86::V3::try_new()) {
        return machine.vectorize(x86::Trios(machine, work));
    }
    work.run::<Plain>(());
}
