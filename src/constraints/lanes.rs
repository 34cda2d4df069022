//! Several constraints at once, one per lane.

pub(crate) use crate::simd::{InLanes, Triple, cross, dot, neg, run, scale, sub};
pub use crate::simd::{Lane, SimdWidth};

/// Repeats an expression for `k` from 0 to `K` - 1, with `k` known to the compiler; `K` is at most
/// 6. A loop over arrays of lanes that the compiler does not unroll would use memory instead of
/// registers.
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

/// Value and gradient of several constraints, one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Several<N: Lane, const K: usize> {
    /// C.
    pub value: N,
    /// dC/dx_i.
    pub gradient: [[N; 3]; K],
    /// The branch that a periodic constraint stores; C for another one.
    pub branch: N,
    /// The lanes where both are defined and have the exact bits. The other lanes are computed one
    /// by one.
    pub usual: N::Mask,
}
