//! Stable time steps: the stiffest mode of a system, and the limit of an integrator for it.

use nalgebra::Vector3;

use super::integrators::Integrator;
use super::system::SpringSystem;
use crate::mesh::measures::max_or_nan;
use crate::mesh::sum::tree_sum_by;

/// Greatest number of steps of the search for the stiffest mode.
const MOST: usize = 120;
/// The search ends when the value increased by less than this share in the last few steps.
const SETTLED: f64 = 1e-7;
/// Number of steps between two tests of the value.
const BETWEEN: usize = 6;

/// A mode of a system, `x'' + damping_rate x' + angular_frequency_squared x = 0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Stiffness over mass, the square of the angular frequency [1/s2].
    pub angular_frequency_squared: f64,
    /// Damping over mass [1/s].
    pub damping_rate: f64,
}

impl Mode {
    /// The mode of one mass [kg] on one spring [N/m] with damping [N s/m].
    pub fn of(stiffness: f64, damping: f64, mass: f64) -> Self {
        Self {
            angular_frequency_squared: stiffness / mass,
            damping_rate: damping / mass,
        }
    }
}

/// The limits on the time step of a system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffest {
    /// The stiffest mode at the present positions, with the strongest damping of a point.
    pub mode: Mode,
    /// A bound on its squared frequency, from row sums (Gershgorin) [1/s2].
    pub bound: f64,
    /// Number of products with the stiffness matrix.
    pub products: usize,
}

/// The stiffest mode of a system at its present positions: the greatest eigenvalue of
/// `M^-1/2 K M^-1/2`, by the Lanczos method from a fixed start.
///
/// The value is approached from below, to about 1e-6. Different masses give different damping per
/// mass; the greatest is used, so limits of damped systems are slightly too short.
pub fn stiffest(system: &SpringSystem) -> Stiffest {
    let free = || (0..system.len()).filter(|&i| !system.pinned()[i]);
    let lightest = free()
        .map(|i| system.mass()[i])
        .fold(f64::INFINITY, f64::min);
    let mut sums = vec![0.0; system.len()];
    system
        .forces()
        .iter()
        .for_each(|f| f.add_row_sums(&system.position, &mut sums));
    let bound = max_or_nan(free().map(|i| row_bound(system, &sums, i)));
    let damping_rate = system.damping / lightest;
    let (angular_frequency_squared, products) = lanczos(system);
    Stiffest {
        mode: Mode {
            angular_frequency_squared,
            damping_rate,
        },
        bound,
        products,
    }
}

/// `M^-1 K` has the same eigenvalues; row sums of K over the point's own mass bound them.
fn row_bound(system: &SpringSystem, sums: &[f64], i: usize) -> f64 {
    sums[i] / system.mass()[i]
}

/// The longest stable step [s] of an integrator for a system at its present positions; 0 for none.
///
/// The test uses the stiffest mode and one without stiffness: between them the limits of all
/// integrators here are longer.
pub fn limit(integrator: &dyn Integrator, stiffest: &Stiffest) -> f64 {
    let rigid = Mode {
        angular_frequency_squared: 0.0,
        ..stiffest.mode
    };
    integrator.limit(stiffest.mode).min(integrator.limit(rigid))
}

/// The eigenvalue of greatest magnitude, and the number of products.
fn lanczos(system: &SpringSystem) -> (f64, usize) {
    let count = system.len();
    let root: Vec<f64> = system.mass().iter().map(|m| m.sqrt()).collect();
    let dot = |a: &[Vector3<f64>], b: &[Vector3<f64>]| tree_sum_by(count, |i| a[i].dot(&b[i]));
    let mut v: Vec<Vector3<f64>> = (0..count).map(|i| start(i, system.pinned()[i])).collect();
    let norm = dot(&v, &v).sqrt();
    if !(norm > 0.0) {
        return (0.0, 0);
    }
    v.iter_mut().for_each(|v| *v /= norm);
    let mut before = vec![Vector3::zeros(); count];
    let (mut diagonal, mut beside): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let (mut free, mut product) = (Vec::new(), Vec::new());
    let mut last = 0.0;
    for step in 1..=MOST {
        let scaled: Vec<Vector3<f64>> = v.iter().zip(&root).map(|(v, r)| v / *r).collect();
        system.product(&system.position, &scaled, false, &mut free, &mut product);
        product.iter_mut().zip(&root).for_each(|(p, r)| *p /= *r);
        let own = dot(&product, &v);
        let beta_before = beside.last().copied().unwrap_or(0.0);
        for i in 0..count {
            product[i] -= v[i] * own + before[i] * beta_before;
        }
        diagonal.push(own);
        let beta = dot(&product, &product).sqrt();
        let scale = max_or_nan(diagonal.iter().chain(&beside).map(|v| v.abs()));
        // The remainder is rounding error: the whole space of the start is explored.
        let ends = !(beta > 1e-12 * scale) || step == MOST;
        if ends || step % BETWEEN == 0 {
            let value = extreme(&diagonal, &beside);
            if ends || (value - last).abs() <= SETTLED * value {
                return (value, step);
            }
            last = value;
        }
        beside.push(beta);
        std::mem::swap(&mut before, &mut v);
        v = product.iter().map(|p| p / beta).collect();
    }
    (last, MOST)
}

/// A start without the symmetry of any mesh: fixed numbers in irregular order.
fn start(i: usize, pinned: bool) -> Vector3<f64> {
    if pinned {
        return Vector3::zeros();
    }
    Vector3::from_fn(|k, _| {
        let mut h = (3 * i as u64 + k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h = (h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((h ^ (h >> 32)) >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    })
}

/// Number of eigenvalues below a value of a symmetric tridiagonal matrix, by Sturm's sequence;
/// `reach` bounds all eigenvalues.
fn count_below(value: f64, diagonal: &[f64], beside: &[f64], reach: f64) -> usize {
    let (mut count, mut q) = (0, 1.0);
    for (i, d) in diagonal.iter().enumerate() {
        let b = if i > 0 { beside[i - 1] } else { 0.0 };
        q = d - value - b * b / q;
        if q == 0.0 {
            q = f64::EPSILON * reach;
        }
        count += usize::from(q < 0.0);
    }
    count
}

/// The eigenvalue of greatest magnitude of a symmetric tridiagonal matrix, by bisection with Sturm
/// counts.
fn extreme(diagonal: &[f64], beside: &[f64]) -> f64 {
    let around = |i: usize| {
        let left = if i > 0 { beside[i - 1].abs() } else { 0.0 };
        left + beside.get(i).map_or(0.0, |b| b.abs())
    };
    let reach = max_or_nan((0..diagonal.len()).map(|i| diagonal[i].abs() + around(i)));
    if !(reach.is_finite() && reach > 0.0) {
        return reach;
    }
    let bisect = |rank: usize| {
        let (mut low, mut high) = (-reach, reach);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if count_below(middle, diagonal, beside, reach) >= rank {
                high = middle
            } else {
                low = middle
            }
        }
        0.5 * (low + high)
    };
    bisect(1).abs().max(bisect(diagonal.len()).abs())
}
