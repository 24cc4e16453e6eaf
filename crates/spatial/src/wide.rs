//! Several numbers of one state side by side: lanes for the columns of a matrix.
//!
//! A [`WideKernel`] is written once for a scalar `T` and a register `W` of several `T`. On one f64 state, `W` has the lanes of
//! the processor's level ([`crate::lanes`]); all other scalars, those whose lanes are states among them, are their own `W`,
//! one number wide. The arithmetic of a column is the same in all.

use crate::{Kernel, Scalar};
use core::marker::PhantomData;

/// [`Wide::COUNT`] numbers `T` side by side.
pub trait Wide<T: Scalar>: Scalar<Constant = T::Constant> {
    /// How many; a divisor of [`WIDEST`].
    const COUNT: usize;
    /// The same number in all places.
    fn broadcast(x: T) -> Self;
    /// The first numbers of a slice, which has as many.
    fn load(x: &[T]) -> Self;
    /// The first numbers of a slice, as many as it has, at most all; zero in the other places.
    fn load_first(x: &[T]) -> Self;
    /// Written to the first numbers of a slice, which has as many.
    fn store(self, out: &mut [T]);
    /// The first numbers, as many as the slice has, at most all.
    fn store_first(self, out: &mut [T]);
    /// The numbers from place `first` on, to the first numbers of a slice, which has as many.
    fn store_from(self, first: usize, out: &mut [T]);
    /// The numbers from place `from` on and before place `to`, neither beyond [`Wide::COUNT`], to their places in the first numbers of a
    /// slice, which has as many as there are places.
    fn store_between(self, from: usize, to: usize, out: &mut [T]);
    /// As many registers as one has numbers, from the first numbers of rows that begin at multiples of `stride` of a slice, which is checked
    /// once; zero in others.
    fn load_rows(stride: usize, x: &[T]) -> [Self; WIDEST];
    /// Written to the same.
    fn store_rows(tile: &[Self; WIDEST], stride: usize, out: &mut [T]);
    /// With another number in one place.
    fn with(self, place: usize, x: T) -> Self;
    /// The numbers before place `place`, and those of `others` from there on.
    fn up_to(self, place: usize, others: Self) -> Self;
    /// Zero before place `from` and from place `to` on, neither beyond [`Wide::COUNT`].
    fn between(self, from: usize, to: usize) -> Self;
    /// Number j of register i becomes number i of register j, of the first [`Wide::COUNT`] registers.
    fn transpose(tile: &mut [Self; WIDEST]);
}

/// The largest [`Wide::COUNT`].
pub const WIDEST: usize = 8;

impl<T: Scalar> Wide<T> for T {
    const COUNT: usize = 1;
    #[inline(always)]
    fn broadcast(x: T) -> Self {
        x
    }
    #[inline(always)]
    fn load(x: &[T]) -> Self {
        x[0]
    }
    #[inline(always)]
    fn load_first(x: &[T]) -> Self {
        if let [first, ..] = x { *first } else { T::zero() }
    }
    #[inline(always)]
    fn store(self, out: &mut [T]) {
        out[0] = self;
    }
    #[inline(always)]
    fn store_first(self, out: &mut [T]) {
        if let [first, ..] = out {
            *first = self;
        }
    }
    #[inline(always)]
    fn store_from(self, first: usize, out: &mut [T]) {
        if first == 0 {
            out[0] = self;
        }
    }
    #[inline(always)]
    fn store_between(self, from: usize, to: usize, out: &mut [T]) {
        if from == 0 && to == 1 {
            out[0] = self;
        }
    }
    #[inline(always)]
    fn load_rows(_: usize, x: &[T]) -> [Self; WIDEST] {
        let mut tile = [T::zero(); WIDEST];
        tile[0] = x[0];
        tile
    }
    #[inline(always)]
    fn store_rows(tile: &[Self; WIDEST], _: usize, out: &mut [T]) {
        out[0] = tile[0];
    }
    #[inline(always)]
    fn with(self, _: usize, x: T) -> Self {
        x
    }
    #[inline(always)]
    fn up_to(self, place: usize, others: Self) -> Self {
        if place == 0 { others } else { self }
    }
    #[inline(always)]
    fn between(self, from: usize, to: usize) -> Self {
        if from == 0 && to == 1 { self } else { T::zero() }
    }
    #[inline(always)]
    fn transpose(_: &mut [Self; WIDEST]) {}
}

/// A [`Kernel`] that is generic over the register, too.
pub trait WideKernel<T: Scalar> {
    /// What it returns.
    type Output;
    /// The calculation, `#[inline(always)]` as [`Kernel::run`].
    fn run<W: Wide<T>>(self) -> Self::Output;
}

/// A wide kernel with its register chosen.
pub(crate) struct With<T, W, K> {
    kernel: K,
    of: PhantomData<(T, W)>,
}

impl<T, W, K> With<T, W, K> {
    #[inline(always)]
    pub(crate) fn new(kernel: K) -> Self {
        With { kernel, of: PhantomData }
    }
}

impl<T: Scalar, W: Wide<T>, K: WideKernel<T>> Kernel for With<T, W, K> {
    type Output = K::Output;
    #[inline(always)]
    fn run(self) -> K::Output {
        self.kernel.run::<W>()
    }
}
