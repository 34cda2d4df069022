//! Lanes of x86 by AVX2 and AVX-512. `pulp` provides the intrinsics as safe methods of a value that
//! exists only if the processor supports them.

use std::arch::x86_64::{__m256, __m256d, __m512, __m512d};
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Sub};

use pulp::NullaryFnOnce;
use pulp::cast;
use pulp::x86::{V3, V4};

use super::fused::{FusedLane, FusedWork, MAGIC_32, MAGIC_64, double_root, refine, single_root};
use super::{InLanes, Lane, Register};
use crate::particles::Slot;

/// Work of [`Lane`] to be compiled for the machine of the lanes `L`.
pub struct Plain<L: Register<f64>, W>(pub L::Machine, pub W);

impl<L: Lane, W: InLanes> NullaryFnOnce for Plain<L, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.1.run::<L>(self.0);
    }
}

/// Work of [`FusedLane`] to be compiled for a machine `M`, with the lanes `L`.
pub struct Fused<F, L: Register<F>, W>(pub L::Machine, pub W);

impl<F, L: FusedLane<F>, W: FusedWork<F>> NullaryFnOnce for Fused<F, L, W> {
    type Output = W::Output;

    #[inline(always)]
    fn call(self) -> W::Output {
        self.1.run::<L>(self.0)
    }
}

/// Sixteen numbers of single precision.
#[derive(Clone, Copy)]
pub struct F32x16(V4, __m512);

/// Eight numbers of single precision.
#[derive(Clone, Copy)]
pub struct F32x8(V3, __m256);

/// Eight numbers of double precision.
#[derive(Clone, Copy)]
pub struct F64x8(V4, __m512d);

/// Four numbers of double precision.
#[derive(Clone, Copy)]
pub struct F64x4(V3, __m256d);

/// Four booleans; all bits of a lane are equal.
#[derive(Clone, Copy)]
pub struct Mask4(V3, __m256d);

/// Eight booleans.
#[derive(Clone, Copy)]
pub struct Mask8(u8);

macro_rules! operators {
    ($kind:ident, $set:ident: $($operator:ident::$method:ident = $intrinsic:ident),*) => {
        $(impl $operator for $kind {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0, self.0.$set.$intrinsic(self.1, other.1))
            }
        })*
    };
}

macro_rules! registers {
    ($($kind:ident, $machine:ident, $number:ty, $set:ident: $set1:ident, $add:ident, $sub:ident, $mul:ident;)*) => {
        $(operators!($kind, $set: Add::add = $add, Sub::sub = $sub, Mul::mul = $mul);

        impl Register<$number> for $kind {
            type Machine = $machine;

            #[inline(always)]
            fn splat(machine: $machine, value: $number) -> Self {
                Self(machine, machine.$set.$set1(value))
            }
        })*
    };
}

registers!(
    F32x16, V4, f32, avx512f: _mm512_set1_ps, _mm512_add_ps, _mm512_sub_ps, _mm512_mul_ps;
    F64x8, V4, f64, avx512f: _mm512_set1_pd, _mm512_add_pd, _mm512_sub_pd, _mm512_mul_pd;
    F32x8, V3, f32, avx: _mm256_set1_ps, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps;
    F64x4, V3, f64, avx: _mm256_set1_pd, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd;
);
operators!(F64x4, avx: Div::div = _mm256_div_pd);
operators!(F64x8, avx512f: Div::div = _mm512_div_pd);
operators!(Mask4, avx: BitAnd::bitand = _mm256_and_pd, BitOr::bitor = _mm256_or_pd);

impl Neg for F64x4 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(
            self.0,
            self.0
                .avx
                ._mm256_xor_pd(self.1, self.0.avx._mm256_set1_pd(-0.0)),
        )
    }
}

impl Neg for F64x8 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(
            self.0,
            self.0
                .avx512dq
                ._mm512_xor_pd(self.1, self.0.avx512f._mm512_set1_pd(-0.0)),
        )
    }
}

impl BitAnd for Mask8 {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOr for Mask8 {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// The first numbers of a slice as an array.
#[inline(always)]
fn first<const W: usize>(from: &[f64]) -> [f64; W] {
    *from.first_chunk().expect("as many numbers as lanes")
}

// Less than, and less or equal. Both are false for NaN, without an exception.
const LT: i32 = 0x11;
const LE: i32 = 0x12;

impl Lane for F64x4 {
    type Mask = Mask4;
    const COUNT: usize = 4;

    #[inline(always)]
    fn each(machine: V3, value: impl Fn(usize) -> f64) -> Self {
        Self(
            machine,
            machine
                .avx
                ._mm256_setr_pd(value(0), value(1), value(2), value(3)),
        )
    }
    #[inline(always)]
    fn load(machine: V3, from: &[f64]) -> Self {
        Self(machine, cast(first::<4>(from)))
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        *to.first_chunk_mut::<4>().expect("as many numbers as lanes") = cast(self.1);
    }
    #[inline(always)]
    fn gather(machine: V3, slots: &[Slot], slot: impl Fn(usize) -> u32) -> [Self; 4] {
        let [a, b, c, d]: [__m256d; 4] = [
            cast(slots[slot(0) as usize].0),
            cast(slots[slot(1) as usize].0),
            cast(slots[slot(2) as usize].0),
            cast(slots[slot(3) as usize].0),
        ];
        let [x, y, z, w] = transposed(machine, [a, b, c, d]);
        [
            Self(machine, x),
            Self(machine, y),
            Self(machine, z),
            Self(machine, w),
        ]
    }
    #[inline(always)]
    fn scatter([x, y, z, w]: [Self; 4], slots: &mut [Slot], slot: impl Fn(usize) -> u32) {
        let [a, b, c, d] = transposed(x.0, [x.1, y.1, z.1, w.1]);
        slots[slot(0) as usize].0 = cast(a);
        slots[slot(1) as usize].0 = cast(b);
        slots[slot(2) as usize].0 = cast(c);
        slots[slot(3) as usize].0 = cast(d);
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0, self.0.avx._mm256_sqrt_pd(self.1))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(
            self.0,
            self.0
                .avx
                ._mm256_andnot_pd(self.0.avx._mm256_set1_pd(-0.0), self.1),
        )
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        let (set, bit) = (self.0.avx, self.0.avx._mm256_set1_pd(-0.0));
        Self(
            self.0,
            set._mm256_or_pd(
                set._mm256_andnot_pd(bit, self.1),
                set._mm256_and_pd(bit, sign.1),
            ),
        )
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask4 {
        Mask4(self.0, self.0.avx._mm256_cmp_pd::<LT>(self.1, other.1))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Mask4 {
        Mask4(self.0, self.0.avx._mm256_cmp_pd::<LE>(self.1, other.1))
    }
    #[inline(always)]
    fn select(mask: Mask4, yes: Self, no: Self) -> Self {
        Self(yes.0, yes.0.avx._mm256_blendv_pd(no.1, yes.1, mask.1))
    }
    #[inline(always)]
    fn bits(mask: Mask4) -> u32 {
        mask.0.avx._mm256_movemask_pd(mask.1) as u32
    }
}

/// Transposes rows and columns.
#[inline(always)]
fn transposed(machine: V3, [a, b, c, d]: [__m256d; 4]) -> [__m256d; 4] {
    let set = machine.avx;
    let (ab0, ab1) = (set._mm256_unpacklo_pd(a, b), set._mm256_unpackhi_pd(a, b));
    let (cd0, cd1) = (set._mm256_unpacklo_pd(c, d), set._mm256_unpackhi_pd(c, d));
    [
        set._mm256_permute2f128_pd::<0x20>(ab0, cd0),
        set._mm256_permute2f128_pd::<0x20>(ab1, cd1),
        set._mm256_permute2f128_pd::<0x31>(ab0, cd0),
        set._mm256_permute2f128_pd::<0x31>(ab1, cd1),
    ]
}

/// Two slots side by side.
// Not a closure: closures and the functions that they call are not always inlined.
#[inline(always)]
fn two(machine: V4, low: [f64; 4], high: [f64; 4]) -> __m512d {
    let set = machine.avx512f;
    set._mm512_insertf64x4::<1>(set._mm512_castpd256_pd512(cast(low)), cast(high))
}

impl Lane for F64x8 {
    type Mask = Mask8;
    const COUNT: usize = 8;

    #[inline(always)]
    fn each(machine: V4, v: impl Fn(usize) -> f64) -> Self {
        Self(
            machine,
            machine
                .avx512f
                ._mm512_setr_pd(v(0), v(1), v(2), v(3), v(4), v(5), v(6), v(7)),
        )
    }
    #[inline(always)]
    fn load(machine: V4, from: &[f64]) -> Self {
        Self(machine, cast(first::<8>(from)))
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        *to.first_chunk_mut::<8>().expect("as many numbers as lanes") = cast(self.1);
    }
    #[inline(always)]
    fn gather(machine: V4, slots: &[Slot], slot: impl Fn(usize) -> u32) -> [Self; 4] {
        let set = machine.avx512f;
        let at = |l: usize| slots[slot(l) as usize].0;
        // In this order the shuffles below produce ascending lanes.
        let (a, b) = (two(machine, at(0), at(2)), two(machine, at(1), at(3)));
        let (c, d) = (two(machine, at(4), at(6)), two(machine, at(5), at(7)));
        let (ab0, ab1) = (set._mm512_unpacklo_pd(a, b), set._mm512_unpackhi_pd(a, b));
        let (cd0, cd1) = (set._mm512_unpacklo_pd(c, d), set._mm512_unpackhi_pd(c, d));
        [
            Self(machine, set._mm512_shuffle_f64x2::<0x88>(ab0, cd0)),
            Self(machine, set._mm512_shuffle_f64x2::<0x88>(ab1, cd1)),
            Self(machine, set._mm512_shuffle_f64x2::<0xDD>(ab0, cd0)),
            Self(machine, set._mm512_shuffle_f64x2::<0xDD>(ab1, cd1)),
        ]
    }
    #[inline(always)]
    fn scatter([x, y, z, w]: [Self; 4], slots: &mut [Slot], slot: impl Fn(usize) -> u32) {
        let set = x.0.avx512f;
        // Even and odd lanes: x y of four lanes, z w of the same.
        let (xy0, xy1) = (
            set._mm512_unpacklo_pd(x.1, y.1),
            set._mm512_unpackhi_pd(x.1, y.1),
        );
        let (zw0, zw1) = (
            set._mm512_unpacklo_pd(z.1, w.1),
            set._mm512_unpackhi_pd(z.1, w.1),
        );
        let low = cast([0_u64, 1, 8, 9, 2, 3, 10, 11]);
        let high = cast([4_u64, 5, 12, 13, 6, 7, 14, 15]);
        let pairs = [
            (0, 2, set._mm512_permutex2var_pd(xy0, low, zw0)),
            (1, 3, set._mm512_permutex2var_pd(xy1, low, zw1)),
            (4, 6, set._mm512_permutex2var_pd(xy0, high, zw0)),
            (5, 7, set._mm512_permutex2var_pd(xy1, high, zw1)),
        ];
        for (low, high, both) in pairs {
            slots[slot(low) as usize].0 = cast(set._mm512_castpd512_pd256(both));
            slots[slot(high) as usize].0 = cast(set._mm512_extractf64x4_pd::<1>(both));
        }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0, self.0.avx512f._mm512_sqrt_pd(self.1))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(
            self.0,
            self.0
                .avx512dq
                ._mm512_andnot_pd(self.0.avx512f._mm512_set1_pd(-0.0), self.1),
        )
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        let (set, bit) = (self.0.avx512dq, self.0.avx512f._mm512_set1_pd(-0.0));
        Self(
            self.0,
            set._mm512_or_pd(
                set._mm512_andnot_pd(bit, self.1),
                set._mm512_and_pd(bit, sign.1),
            ),
        )
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask8 {
        Mask8(self.0.avx512f._mm512_cmp_pd_mask::<LT>(self.1, other.1))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Mask8 {
        Mask8(self.0.avx512f._mm512_cmp_pd_mask::<LE>(self.1, other.1))
    }
    #[inline(always)]
    fn select(mask: Mask8, yes: Self, no: Self) -> Self {
        Self(
            yes.0,
            yes.0.avx512f._mm512_mask_blend_pd(mask.0, no.1, yes.1),
        )
    }
    #[inline(always)]
    fn bits(mask: Mask8) -> u32 {
        u32::from(mask.0)
    }
}

macro_rules! fused {
    (
        $kind:ident, $machine:ident, $number:ty, $count:literal, $root:ident,
        $set:ident: $max:ident,
        $fused:ident: $fmadd:ident, $fnmadd:ident,
        |$m:ident, $q:ident| $guess:expr,
        |$now:ident, $before:ident| $up:expr
    ) => {
        impl FusedLane<$number> for $kind {
            type Chunk = [$number; $count];

            #[inline(always)]
            fn chunks(of: &[$number]) -> &[Self::Chunk] {
                of.as_chunks().0
            }
            #[inline(always)]
            fn chunks_mut(of: &mut [$number]) -> &mut [Self::Chunk] {
                of.as_chunks_mut().0
            }
            #[inline(always)]
            fn numbers(of: &[Self::Chunk]) -> &[$number] {
                of.as_flattened()
            }
            #[inline(always)]
            fn load(machine: $machine, from: &Self::Chunk) -> Self {
                Self(machine, cast(*from))
            }
            #[inline(always)]
            fn store(self) -> Self::Chunk {
                cast(self.1)
            }
            #[inline(always)]
            fn mul_add(self, by: Self, plus: Self) -> Self {
                Self(self.0, self.0.$fused.$fmadd(self.1, by.1, plus.1))
            }
            #[inline(always)]
            fn mul_sub_from(self, by: Self, from: Self) -> Self {
                Self(self.0, self.0.$fused.$fnmadd(self.1, by.1, from.1))
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                // The instruction returns the second operand if one operand is NaN.
                Self(self.0, self.0.$set.$max(other.1, self.1))
            }
            #[inline(always)]
            fn root_guess(self) -> Self {
                let ($m, $q) = (self.0, self.1);
                Self($m, $guess)
            }
            #[inline(always)]
            fn moved_up(self, before: Self) -> Self {
                let ($m, $now, $before) = (self.0, self.1, before.1);
                Self($m, $up)
            }
            $root!();
        }
    };
}

fused!(
    F32x16, V4, f32, 16, single_root,
    avx512f: _mm512_max_ps,
    avx512f: _mm512_fmadd_ps, _mm512_fnmadd_ps,
    |m, q| cast(m.avx512f._mm512_sub_epi32(
        m.avx512f._mm512_set1_epi32(MAGIC_32.cast_signed()),
        m.avx512f._mm512_srli_epi32::<1>(cast(q)),
    )),
    |now, before| cast(m.avx512f._mm512_alignr_epi32::<15>(cast(now), cast(before)))
);
fused!(
    F64x8, V4, f64, 8, double_root,
    avx512f: _mm512_max_pd,
    avx512f: _mm512_fmadd_pd, _mm512_fnmadd_pd,
    |m, q| cast(m.avx512f._mm512_sub_epi64(
        m.avx512f._mm512_set1_epi64(MAGIC_64.cast_signed()),
        m.avx512f._mm512_srli_epi64::<1>(cast(q)),
    )),
    |now, before| cast(m.avx512f._mm512_alignr_epi64::<7>(cast(now), cast(before)))
);
fused!(
    F32x8, V3, f32, 8, single_root,
    avx: _mm256_max_ps,
    fma: _mm256_fmadd_ps, _mm256_fnmadd_ps,
    |m, q| cast(m.avx2._mm256_sub_epi32(
        m.avx._mm256_set1_epi32(MAGIC_32.cast_signed()),
        m.avx2._mm256_srli_epi32::<1>(cast(q)),
    )),
    // The upper half of `before` and the lower half of `now`. Between them is the lane that changes
    // halves.
    |now, before| cast(m.avx2._mm256_alignr_epi8::<12>(
        cast(now),
        cast(m.avx._mm256_permute2f128_ps::<0x21>(before, now)),
    ))
);
fused!(
    F64x4, V3, f64, 4, double_root,
    avx: _mm256_max_pd,
    fma: _mm256_fmadd_pd, _mm256_fnmadd_pd,
    |m, q| cast(m.avx2._mm256_sub_epi64(
        m.avx._mm256_set1_epi64x(MAGIC_64.cast_signed()),
        m.avx2._mm256_srli_epi64::<1>(cast(q)),
    )),
    |now, before| cast(m.avx2._mm256_alignr_epi8::<8>(
        cast(now),
        cast(m.avx._mm256_permute2f128_pd::<0x21>(before, now)),
    ))
);
