//! Several constraints at once, one a lane.

pub(crate) use crate::simd::{InLanes, Triple, cross, dot, neg, run, scale, sub};
pub use crate::simd::{Lane, SimdWidth};

/// Does the same for `k` from 0 to below `K`, at most 6, with `k` known to the compiler: a loop over arrays of lanes
/// that it does not unroll goes through memory.
macro_rules! unrolled {
    ($k:ident in $count:ident => $body:block) => {
        const { assert!($count <= 6, "a constraint has at most six points") };
        $crate::constraints::lanes::unrolled!(@ $k $count $body 0 1 2 3 4 5);
    };
    (@ $k:ident $count:ident $body:block $($value:literal)*) => {
        $(if $count > $value {
            let $k = $value;
            $body
        })*
    };
}
pub(crate) use unrolled;

/// Value and gradient of several constraints, one a lane.
#[derive(Clone, Copy, Debug)]
pub struct Several<N: Lane, const K: usize> {
    /// C.
    pub value: N,
    /// dC/dx_i.
    pub gradient: [[N; 3]; K],
    /// Where both are defined and hold to the bit; other lanes are computed one by one.
    pub usual: N::Mask,
}
