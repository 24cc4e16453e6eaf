//! Several bodies of one state side by side: what limbs that are alike offer to SIMD where there are no other states.
//!
//! Lanes of states share the constants of one model. Bodies side by side have constants of their own, so that here a constant is a
//! register too.

use crate::Scalar;

/// A number of each of several bodies.
///
/// Everything is only to be called where [`Abreast::is_fast`] is true: elsewhere a processor may meet instructions that it does
/// not have.
pub trait Abreast<C>: Scalar<Constant = Self, Arithmetic = Self, Abreast = Self> {
    /// How many bodies; 1 where a number has no lanes.
    const COUNT: usize;
    /// True where the processor works on all lanes at once.
    fn is_fast() -> bool;
    /// The numbers of four bodies, or of the first of them.
    fn of(x: [C; 4]) -> Self;
    /// The numbers; past [`Abreast::COUNT`] the last again.
    fn to_array(self) -> [C; 4];
    /// The sum over the first bodies, as many as `N`.
    fn sum<const N: usize>(self) -> C;
}

impl<C: Scalar<Constant = C, Arithmetic = C, Abreast = C>> Abreast<C> for C {
    const COUNT: usize = 1;
    fn is_fast() -> bool {
        false
    }
    #[inline(always)]
    fn of([x, ..]: [C; 4]) -> Self {
        x
    }
    #[inline(always)]
    fn to_array(self) -> [C; 4] {
        [self; 4]
    }
    #[inline(always)]
    fn sum<const N: usize>(self) -> C {
        self
    }
}
