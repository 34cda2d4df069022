//! Lanes of x86 by AVX2 and AVX-512. `pulp` hands out the intrinsics as safe methods of a value that only exists where
//! the processor has them.

use std::arch::x86_64::{__m256, __m256d, __m512, __m512d};
use std::marker::PhantomData;

use pulp::NullaryFnOnce;
use pulp::cast;
use pulp::x86::{V3, V4};

use super::{InLanes, Lanes, MAGIC_32, MAGIC_64, double_root, refine, single_root};

/// Work to be compiled for a machine, with the lanes `L`.
pub struct Compiled<M, W, L> {
    machine: M,
    work: W,
    lanes: PhantomData<L>,
}

impl<M, W, L> Compiled<M, W, L> {
    pub fn new(machine: M, work: W) -> Self {
        Self {
            machine,
            work,
            lanes: PhantomData,
        }
    }
}

macro_rules! compiled {
    ($($lanes:ty, $number:ty);*) => {
        $(impl<W: InLanes<$number>> NullaryFnOnce
            for Compiled<<$lanes as Lanes<$number>>::Machine, W, $lanes>
        {
            type Output = W::Output;

            #[inline(always)]
            fn call(self) -> W::Output {
                self.work.run::<$lanes>(self.machine)
            }
        })*
    };
}
compiled!(F32x16, f32; F32x8, f32; F64x8, f64; F64x4, f64; f32, f32; f64, f64);

/// Sixteen single numbers.
#[derive(Clone, Copy)]
pub struct F32x16(V4, __m512);

/// Eight single numbers.
#[derive(Clone, Copy)]
pub struct F32x8(V3, __m256);

/// Eight double numbers.
#[derive(Clone, Copy)]
pub struct F64x8(V4, __m512d);

/// Four double numbers.
#[derive(Clone, Copy)]
pub struct F64x4(V3, __m256d);

macro_rules! lanes {
    (
        $kind:ident, $machine:ident, $number:ty, $count:literal, $root:ident,
        $set:ident: $set1:ident, $add:ident, $sub:ident, $mul:ident, $max:ident,
        $fused:ident: $fmadd:ident, $fnmadd:ident,
        |$m:ident, $q:ident| $guess:expr,
        |$now:ident, $before:ident| $up:expr
    ) => {
        impl Lanes<$number> for $kind {
            type Machine = $machine;
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
            fn splat(machine: $machine, value: $number) -> Self {
                Self(machine, machine.$set.$set1(value))
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
            fn add(self, other: Self) -> Self {
                Self(self.0, self.0.$set.$add(self.1, other.1))
            }
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                Self(self.0, self.0.$set.$sub(self.1, other.1))
            }
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                Self(self.0, self.0.$set.$mul(self.1, other.1))
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
                // The second one is what the instruction gives where one is not a number.
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

lanes!(
    F32x16, V4, f32, 16, single_root,
    avx512f: _mm512_set1_ps, _mm512_add_ps, _mm512_sub_ps, _mm512_mul_ps, _mm512_max_ps,
    avx512f: _mm512_fmadd_ps, _mm512_fnmadd_ps,
    |m, q| cast(m.avx512f._mm512_sub_epi32(
        m.avx512f._mm512_set1_epi32(MAGIC_32.cast_signed()),
        m.avx512f._mm512_srli_epi32::<1>(cast(q)),
    )),
    |now, before| cast(m.avx512f._mm512_alignr_epi32::<15>(cast(now), cast(before)))
);
lanes!(
    F64x8, V4, f64, 8, double_root,
    avx512f: _mm512_set1_pd, _mm512_add_pd, _mm512_sub_pd, _mm512_mul_pd, _mm512_max_pd,
    avx512f: _mm512_fmadd_pd, _mm512_fnmadd_pd,
    |m, q| cast(m.avx512f._mm512_sub_epi64(
        m.avx512f._mm512_set1_epi64(MAGIC_64.cast_signed()),
        m.avx512f._mm512_srli_epi64::<1>(cast(q)),
    )),
    |now, before| cast(m.avx512f._mm512_alignr_epi64::<7>(cast(now), cast(before)))
);
lanes!(
    F32x8, V3, f32, 8, single_root,
    avx: _mm256_set1_ps, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps, _mm256_max_ps,
    fma: _mm256_fmadd_ps, _mm256_fnmadd_ps,
    |m, q| cast(m.avx2._mm256_sub_epi32(
        m.avx._mm256_set1_epi32(MAGIC_32.cast_signed()),
        m.avx2._mm256_srli_epi32::<1>(cast(q)),
    )),
    // The upper half of what was and the lower half of what is, between them the lane that goes over.
    |now, before| cast(m.avx2._mm256_alignr_epi8::<12>(
        cast(now),
        cast(m.avx._mm256_permute2f128_ps::<0x21>(before, now)),
    ))
);
lanes!(
    F64x4, V3, f64, 4, double_root,
    avx: _mm256_set1_pd, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd, _mm256_max_pd,
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
