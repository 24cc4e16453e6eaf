//! Four bodies of one state in a register of four numbers.

use super::F64x4;
use crate::abreast::Abreast;
use crate::lanes::Level;
use crate::{Scalar, arithmetic_is_self};
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};
use num_traits::{One, Zero};

/// A number of each of four bodies; also their constants.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct Four(F64x4);

macro_rules! operator {
    ($trait:ident, $method:ident) => {
        impl $trait for Four {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: Self) -> Self {
                Four($trait::$method(self.0, b.0))
            }
        }
    };
}
operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);
impl Neg for Four {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Four(-self.0)
    }
}
assigning_operators!(Four);

impl Scalar for Four {
    type Constant = Self;
    type Abreast = Self;
    const LANES: usize = 4;
    const EPSILON: f64 = f64::EPSILON;
    arithmetic_is_self!();
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Four(F64x4::from_array([x; 4]))
    }
    #[inline(always)]
    fn constant(x: Self) -> Self {
        x
    }
    #[inline(always)]
    fn fma(self, a: Self, b: Self) -> Self {
        Four(self.0.fma(a.0, b.0))
    }
    #[inline(always)]
    fn recip(self) -> Self {
        Four(self.0.recip())
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Four(self.0.sqrt())
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.0.sin_cos();
        (Four(sin), Four(cos))
    }
    #[inline(always)]
    fn is_positive(self) -> bool {
        self.0.is_positive()
    }
    fn min_lane(self) -> f64 {
        self.0.min_lane()
    }
    #[inline(always)]
    fn first_lane(self) -> Self {
        self
    }
}

impl Abreast<f64> for Four {
    const COUNT: usize = 4;
    #[inline(always)]
    fn is_fast() -> bool {
        Level::best() >= Level::Avx2
    }
    #[inline(always)]
    fn of(x: [f64; 4]) -> Self {
        Four(F64x4::from_array(x))
    }
    #[inline(always)]
    fn to_array(self) -> [f64; 4] {
        self.0.to_array()
    }
    #[inline(always)]
    fn sum<const N: usize>(self) -> f64 {
        let [a, b, c, d] = self.0.to_array();
        if N == 4 { (a + c) + (b + d) } else { (a + c) + b }
    }
}
