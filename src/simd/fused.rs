//! Numbers in lanes with fused multiply-add, in single or double precision, for the kernels of
//! lattices.
//!
//! Every operation is one of IEEE 754, rounded once, or acts on bits. Multiply-add is fused at
//! every width. Therefore all widths give the same bits. The reciprocal root is computed by such
//! operations from a first guess by bits. Square roots and divisions of the processor would take
//! most of the time of a step. Its own approximations differ between manufacturers.

#[cfg(target_arch = "x86_64")]
use super::x86;
use super::{Register, SimdWidth};

/// Numbers in lanes with a fused multiply-add and a reciprocal root.
pub trait FusedLane<F>: Register<F> {
    /// An array with one number per lane.
    type Chunk: Copy;

    /// A slice as chunks, without the numbers that do not fill a chunk.
    fn chunks(of: &[F]) -> &[Self::Chunk];
    /// The same as [`Self::chunks`], mutable.
    fn chunks_mut(of: &mut [F]) -> &mut [Self::Chunk];
    /// The numbers of chunks.
    fn numbers(of: &[Self::Chunk]) -> &[F];
    /// The numbers of a chunk.
    fn load(machine: Self::Machine, from: &Self::Chunk) -> Self;
    /// The lanes as a chunk.
    fn store(self) -> Self::Chunk;
    /// `self * by + plus`, rounded once.
    fn mul_add(self, by: Self, plus: Self) -> Self;
    /// `from - self * by`, rounded once.
    fn mul_sub_from(self, by: Self, from: Self) -> Self;
    /// The larger number; `self` where they cannot be compared.
    fn max(self, other: Self) -> Self;
    /// A first guess of one over the square root from the halved bits, within 3.5 %; a large number
    /// for zero.
    fn root_guess(self) -> Self;
    /// Lane `l` from lane `l - 1`; the first lane from the last lane of `before`.
    fn moved_up(self, before: Self) -> Self;
    /// One over the square root within [`Number::ROOT_ERROR`]. For zero the result is a large
    /// number, never infinity.
    fn reciprocal_root(self, machine: Self::Machine) -> Self;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// The type of the numbers of a lattice: `f32` or `f64`.
pub trait Number:
    sealed::Sealed + Copy + Default + Send + Sync + PartialOrd + std::fmt::Debug + 'static
{
    /// The length of a row is rounded up to a multiple of this: the number of lanes of the widest
    /// register.
    const ROW: usize;
    /// Bound of the relative error of [`FusedLane::reciprocal_root`].
    const ROOT_ERROR: f64;
    /// The value rounded to this precision.
    fn from_f64(value: f64) -> Self;
    /// The exact value.
    fn to_f64(self) -> f64;
    /// Runs work with lanes of the given width, or of the next smaller width that the processor
    /// has.
    fn in_lanes<W: FusedWork<Self>>(width: SimdWidth, work: W) -> W::Output;
}

/// Work for any number of lanes.
pub trait FusedWork<F> {
    /// The result.
    type Output;
    /// Runs the work.
    fn run<L: FusedLane<F>>(self, machine: L::Machine) -> Self::Output;
}

/// Replaces `y` by `y (1 + e (c1 + e (c2 + ...)))` with `e = 1 - q y^2`. The coefficients are those
/// of the series of the reciprocal root, or of its best approximation over the errors of the guess.
macro_rules! refine {
    ($machine:ident, $number:ty, $q:ident, $y:ident, $($c:expr),+) => {{
        let e = ($q * $y).mul_sub_from($y, <Self as Register<$number>>::splat($machine, 1.0));
        ($y * e).mul_add(refine!(@ $machine, $number, e, $($c),+), $y)
    }};
    (@ $machine:ident, $number:ty, $e:ident, $last:expr) => { <Self as Register<$number>>::splat($machine, $last) };
    (@ $machine:ident, $number:ty, $e:ident, $c:expr, $($more:expr),+) => {
        $e.mul_add(refine!(@ $machine, $number, $e, $($more),+), <Self as Register<$number>>::splat($machine, $c))
    };
}

/// The polynomial of degree four that best approximates `(1 - e)^(-1/2)` over the errors of the
/// guess, 1 at 0, within 2.3e-8.
macro_rules! single_root {
    () => {
        #[inline(always)]
        fn reciprocal_root(self, machine: Self::Machine) -> Self {
            let (q, y) = (self, self.root_guess());
            refine!(
                machine,
                f32,
                q,
                y,
                0.499_998_33,
                0.375_000_36,
                0.313_935_34,
                0.274_079_32
            )
        }
    };
}

/// The polynomial of degree three, within 1.1e-6, and then three terms of the series, within 1e-17.
macro_rules! double_root {
    () => {
        #[inline(always)]
        fn reciprocal_root(self, machine: Self::Machine) -> Self {
            let (q, y) = (self, self.root_guess());
            let y = refine!(machine, f64, q, y, 0.500_000_66, 0.376_059_31, 0.312_900_47);
            refine!(machine, f64, q, y, 0.5, 0.375)
        }
    };
}
pub(super) use {double_root, refine, single_root};

/// This constant minus half of the bits of a number, read as a number, is a guess of one over the
/// square root.
pub(super) const MAGIC_32: u32 = 0x5f37_5a86;
pub(super) const MAGIC_64: u64 = 0x5fe6_eb50_c7b5_37a9;

macro_rules! scalar {
    ($number:ty, $magic:ident, $root:ident) => {
        impl Register<$number> for $number {
            type Machine = ();

            #[inline(always)]
            fn splat((): (), value: $number) -> Self {
                value
            }
        }

        impl FusedLane<$number> for $number {
            type Chunk = $number;

            #[inline(always)]
            fn chunks(of: &[$number]) -> &[$number] {
                of
            }
            #[inline(always)]
            fn chunks_mut(of: &mut [$number]) -> &mut [$number] {
                of
            }
            #[inline(always)]
            fn numbers(of: &[$number]) -> &[$number] {
                of
            }
            #[inline(always)]
            fn load((): (), from: &$number) -> Self {
                *from
            }
            #[inline(always)]
            fn store(self) -> $number {
                self
            }
            #[inline(always)]
            fn mul_add(self, by: Self, plus: Self) -> Self {
                <$number>::mul_add(self, by, plus)
            }
            #[inline(always)]
            fn mul_sub_from(self, by: Self, from: Self) -> Self {
                <$number>::mul_add(-self, by, from)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if other > self { other } else { self }
            }
            #[inline(always)]
            fn root_guess(self) -> Self {
                <$number>::from_bits($magic.wrapping_sub(self.to_bits() >> 1))
            }
            #[inline(always)]
            fn moved_up(self, before: Self) -> Self {
                before
            }
            $root!();
        }
    };
}
scalar!(f32, MAGIC_32, single_root);
scalar!(f64, MAGIC_64, double_root);

macro_rules! number {
    ($number:ty, $row:literal, $error:literal, $eight:ident, $four:ident) => {
        impl Number for $number {
            const ROW: usize = $row;
            const ROOT_ERROR: f64 = $error;

            fn from_f64(value: f64) -> Self {
                value as $number
            }
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            fn in_lanes<W: FusedWork<Self>>(width: SimdWidth, work: W) -> W::Output {
                #[cfg(target_arch = "x86_64")]
                {
                    if let (SimdWidth::Eight, Some(machine)) = (width, pulp::x86::V4::try_new()) {
                        return machine
                            .vectorize(x86::Fused::<$number, x86::$eight, _>(machine, work));
                    }
                    if let Some(machine) = pulp::x86::V3::try_new() {
                        if width == SimdWidth::One {
                            // Compiled for the fused multiply-add of the processor; otherwise each
                            // multiply-add would be a call.
                            return machine.vectorize(x86::Fused::<$number, $number, _>((), work));
                        }
                        return machine
                            .vectorize(x86::Fused::<$number, x86::$four, _>(machine, work));
                    }
                }
                let _ = width;
                work.run::<$number>(())
            }
        }
    };
}
number!(f32, 16, 1.5e-7, F32x16, F32x8);
number!(f64, 8, 3e-16, F64x8, F64x4);

#[cfg(test)]
mod tests {
    use super::*;

    /// Reciprocal roots of all numbers of a list, with one number at a time or several.
    struct Roots<'a, F>(&'a [F]);

    impl<F: Number> FusedWork<F> for Roots<'_, F> {
        type Output = Vec<F>;

        #[inline(always)]
        fn run<L: FusedLane<F>>(self, machine: L::Machine) -> Vec<F> {
            let mut all = Vec::new();
            for chunk in L::chunks(self.0) {
                all.push(L::load(machine, chunk).reciprocal_root(machine).store());
            }
            L::numbers(&all).to_vec()
        }
    }

    /// The largest relative error over many numbers of all sizes. Asserts that all widths give the
    /// same bits.
    fn roots<F: Number>(sizes: i32) -> f64 {
        let sixteenths = |k: i32| 2f64.powf(f64::from(k) / 64.0 * 1.000_731);
        let numbers: Vec<F> = (-64 * sizes..64 * sizes)
            .map(|k| F::from_f64(sixteenths(k)))
            .collect();
        let one = F::in_lanes(SimdWidth::One, Roots(&numbers));
        assert_eq!(one.len(), numbers.len());
        for &width in SimdWidth::available() {
            let same = F::in_lanes(width, Roots(&numbers))
                .iter()
                .zip(&one)
                .all(|(a, b)| a.to_f64() == b.to_f64());
            assert!(same, "{width}");
        }
        let error = |(q, y): (&F, &F)| (y.to_f64() * q.to_f64().sqrt() - 1.0).abs();
        numbers
            .iter()
            .zip(&one)
            .map(error)
            .fold(0.0, |worst, e| if e <= worst { worst } else { e })
    }

    #[test]
    fn reciprocal_roots_are_as_exact_as_they_say() {
        let (single, double) = (roots::<f32>(120), roots::<f64>(1000));
        println!("{single:e} in f32, {double:e} in f64");
        assert!(single > 0.0 && single <= f32::ROOT_ERROR, "{single:e}");
        // The comparison itself rounds three times.
        assert!(
            double > 0.0 && double <= f64::ROOT_ERROR + 3.0 * f64::EPSILON / 2.0,
            "{double:e}"
        );
        // One step fewer would not suffice.
        let guess = 3f32.root_guess() * 3f32.sqrt() - 1.0;
        assert!(
            guess.abs() > 100.0 * f32::ROOT_ERROR as f32 && guess.abs() <= 0.035,
            "{guess:e}"
        );
    }

    #[test]
    fn zero_has_a_finite_root() {
        assert!(0f32.reciprocal_root(()).is_finite() && 0f64.reciprocal_root(()).is_finite());
        assert!(f32::MIN_POSITIVE.reciprocal_root(()) > 9.2e18);
        assert!(f32::NAN.reciprocal_root(()).is_nan() && f64::NAN.reciprocal_root(()).is_nan());
    }
}
