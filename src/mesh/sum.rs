//! Sums over a fixed tree: the bits of a result depend on the numbers alone, not on threads.

use rayon::prelude::*;

/// Numbers in one leaf of the tree. The bits of a sum depend on this constant.
pub(crate) const LEAF: usize = 4096;
/// Partial sums in a leaf, added in turn. The bits of a sum depend on this constant.
pub(crate) const LEAF_PARTS: usize = 8;
/// Number of leaves from which several threads sum them. The bits of a sum do not depend on it.
const PARALLEL_LEAVES: usize = 8;

/// Sum of `values` over a fixed tree; the same bits for any number of threads.
///
/// The rounding error grows as `n / 8` within 4096 numbers and as `log n` above. The sum of no
/// numbers is zero.
pub fn tree_sum(values: &[f64]) -> f64 {
    tree_sum_by(values.len(), |i| values[i])
}

/// Sum of `value(i)` for `i` in `0..count` over the tree of [`tree_sum`].
pub fn tree_sum_by(count: usize, value: impl Fn(usize) -> f64 + Sync) -> f64 {
    let leaves = count.div_ceil(LEAF);
    let leaf = |b: usize| leaf_sum(b * LEAF, ((b + 1) * LEAF).min(count), &value);
    match leaves {
        0 => 0.0,
        1 => leaf(0),
        _ if leaves < PARALLEL_LEAVES => pairwise(&(0..leaves).map(leaf).collect::<Vec<_>>()),
        _ => pairwise(&(0..leaves).into_par_iter().map(leaf).collect::<Vec<_>>()),
    }
}

/// A compensated sum of numbers that arrive one by one \[neumaier1974\].
#[derive(Clone, Copy, Debug, Default)]
pub struct NeumaierSum {
    sum: f64,
    lost: f64,
}

impl NeumaierSum {
    /// Adds a number.
    #[inline]
    pub fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.lost += if self.sum.abs() >= value.abs() {
            (self.sum - sum) + value
        } else {
            (value - sum) + self.sum
        };
        self.sum = sum;
    }

    /// The sum so far.
    pub fn total(&self) -> f64 {
        self.sum + self.lost
    }
}

fn leaf_sum(start: usize, end: usize, value: &impl Fn(usize) -> f64) -> f64 {
    let mut lanes = [0.0; LEAF_PARTS];
    let whole = start + (end - start) / LEAF_PARTS * LEAF_PARTS;
    for base in (start..whole).step_by(LEAF_PARTS) {
        for (k, lane) in lanes.iter_mut().enumerate() {
            *lane += value(base + k);
        }
    }
    for (lane, i) in lanes.iter_mut().zip(whole..end) {
        *lane += value(i);
    }
    pairwise(&lanes)
}

/// The sum of the sums of leaves.
pub(crate) fn pairwise(values: &[f64]) -> f64 {
    match values {
        [] => 0.0,
        [one] => *one,
        _ => {
            let (left, right) = values.split_at(values.len().next_power_of_two() / 2);
            pairwise(left) + pairwise(right)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn small_counts() {
        assert_eq!(tree_sum(&[]), 0.0);
        assert_eq!(tree_sum(&[3.5]), 3.5);
        for count in [2, 7, 8, 9, 4095, 4096, 4097, 8192, 12_345, 70_000] {
            // Sums of whole numbers are exact, so each number must be counted exactly once.
            let exact = (count * (count - 1) / 2) as f64;
            assert_eq!(tree_sum_by(count, |i| i as f64), exact, "{count}");
        }
    }

    #[test]
    fn is_better_than_adding_in_turn() {
        let count = 1_000_000;
        let error = |sum: f64| (sum - 1e5).abs();
        let in_turn: f64 = std::iter::repeat_n(0.1, count).sum();
        assert!(error(tree_sum_by(count, |_| 0.1)) < 1e-2 * error(in_turn));
    }

    #[test]
    fn a_compensated_sum_keeps_what_cancels() {
        let mut sum = NeumaierSum::default();
        [1e16, 1.0, -1e16, 0.5].into_iter().for_each(|v| sum.add(v));
        assert_eq!(sum.total(), 1.5);
        assert_ne!([1e16, 1.0, -1e16, 0.5].into_iter().sum::<f64>(), 1.5);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn same_bits_for_any_number_of_threads(seed in any::<u64>(), count in 60_000usize..150_000) {
            let value = |i: usize| {
                let h = (i as u64 ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                ((h >> 11) as f64 / (1u64 << 53) as f64 - 0.5) * 10f64.powi((h % 13) as i32)
            };
            let values: Vec<f64> = (0..count).map(value).collect();
            let reference = tree_sum(&values).to_bits();
            for threads in [1, 2, 8] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
                prop_assert_eq!(pool.install(|| tree_sum_by(count, value)).to_bits(), reference);
            }
            let plain: f64 = values.iter().sum();
            let size: f64 = values.iter().map(|v| v.abs()).sum();
            prop_assert!((f64::from_bits(reference) - plain).abs() <= 1e-12 * size);
        }
    }
}
