//! Arrays aligned to cache lines.

use std::ops::{Deref, DerefMut};

/// Size of a cache line, and of the widest register [bytes].
const LINE: usize = 64;

/// An array whose first number begins a cache line, so that no register load crosses two lines.
#[derive(Debug)]
pub(super) struct Aligned<F> {
    numbers: Vec<F>,
    first: usize,
    length: usize,
}

impl<F> Aligned<F> {
    /// Start index for the alignment; any start if it cannot be determined.
    fn begin(numbers: &[F]) -> usize {
        numbers
            .as_ptr()
            .align_offset(LINE)
            .min(LINE / size_of::<F>())
    }
}

impl<F: Copy + Default> Aligned<F> {
    /// Creates `length` zeros.
    pub fn zeros(length: usize) -> Self {
        let numbers = vec![F::default(); length + LINE / size_of::<F>()];
        Self {
            first: Self::begin(&numbers),
            numbers,
            length,
        }
    }
}

impl<F> Deref for Aligned<F> {
    type Target = [F];

    fn deref(&self) -> &[F] {
        &self.numbers[self.first..][..self.length]
    }
}

impl<F> DerefMut for Aligned<F> {
    fn deref_mut(&mut self) -> &mut [F] {
        &mut self.numbers[self.first..][..self.length]
    }
}

impl<F: Clone> Clone for Aligned<F> {
    fn clone(&self) -> Self {
        let mut numbers = self.numbers.clone();
        let first = Self::begin(&numbers);
        // The copy has another offset in its cache line.
        numbers.rotate_left(self.first);
        numbers.rotate_right(first);
        Self {
            numbers,
            first,
            length: self.length,
        }
    }
}
