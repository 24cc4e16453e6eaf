//! Numbers that begin at a cache line, so that no register of them lies in two.

use core::ops::{Deref, DerefMut};
use phipsi_spatial::Scalar;

/// Bytes of a cache line.
const LINE: usize = 64;

/// A slice whose first number begins a cache line, where numbers have [`Scalar::COLUMNS`] to a register.
#[derive(Clone, Debug)]
pub(crate) struct Aligned<T> {
    /// With room for those before the line.
    numbers: Vec<T>,
    count: usize,
}

impl<T: Scalar> Aligned<T> {
    /// Zeros.
    pub(crate) fn new(count: usize) -> Self {
        Aligned { numbers: vec![T::zero(); count + T::COLUMNS - 1], count }
    }
    /// A copy lies elsewhere: asked whenever the numbers are.
    #[inline(always)]
    fn start(&self) -> usize {
        self.numbers.as_ptr().align_offset(LINE).min(self.numbers.len() - self.count)
    }
}

impl<T: Scalar> Deref for Aligned<T> {
    type Target = [T];
    #[inline(always)]
    fn deref(&self) -> &[T] {
        let start = self.start();
        &self.numbers[start..start + self.count]
    }
}

impl<T: Scalar> DerefMut for Aligned<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        let start = self.start();
        &mut self.numbers[start..start + self.count]
    }
}
