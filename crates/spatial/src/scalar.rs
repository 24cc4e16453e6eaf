//! The numbers that kernels compute with.
//!
//! [`Scalar`] is what a sweep needs: ring operations, division, square root, sine and cosine, and constants of the
//! model broadcast from [`Scalar::Constant`]. Lanes of a SIMD register and dual numbers can be scalars; they have
//! no order. [`Real`] adds what code with branches needs: comparison and inverse trigonometry.

use crate::abreast::Abreast;
use crate::lanes::{Fused, fused, fused_mut};
use crate::six_lanes::SixLanes;
use crate::wide::{WideKernel, With};
use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};
use num_traits::{One, Zero};

/// A number that the sweeps compute with.
pub trait Scalar:
    'static
    + Copy
    + PartialEq
    + Debug
    + Send
    + Sync
    + Zero
    + One
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
{
    /// The number type in which constants of the model (masses, lengths) are kept for this scalar.
    type Constant: Scalar<Constant = Self::Constant, Abreast = Self::Abreast>;
    /// What kernels on this scalar compute with: for f64 the same numbers with fused multiplications
    /// ([`crate::lanes::Fused`]), for all others the type itself ([`crate::arithmetic_is_self`]).
    type Arithmetic: Scalar<Constant = Self::Constant, Arithmetic = Self::Arithmetic, Abreast = Self::Abreast>;
    /// Six-vectors of this scalar in lanes of their own.
    type Six: SixLanes<Self>;
    /// Numbers of several bodies that are alike, in lanes, and their constants too.
    type Abreast: Abreast<Self::Constant>;
    /// States carried at once: 1 for plain numbers.
    const LANES: usize;
    /// Unit roundoff times two: the distance from 1 to the next number.
    const EPSILON: f64;
    /// The number, to compute with.
    fn to_arithmetic(self) -> Self::Arithmetic;
    /// The number that was computed.
    fn from_arithmetic(x: Self::Arithmetic) -> Self;
    /// The same numbers, to compute with.
    fn arithmetic(x: &[Self]) -> &[Self::Arithmetic];
    /// The same numbers, to compute with.
    fn arithmetic_mut(x: &mut [Self]) -> &mut [Self::Arithmetic];
    /// Runs a kernel compiled for the instructions that this scalar's operations need.
    #[inline(always)]
    fn dispatch<K: Kernel>(kernel: K) -> K::Output {
        kernel.run()
    }
    /// Runs what only one state by itself can do, on numbers that come with lanes for parts of it; compiled for those alone.
    #[inline(always)]
    fn lone<K: Kernel>(_: K) -> Option<K::Output> {
        None
    }
    /// Runs a kernel with the widest register for numbers of this type that lie side by side.
    #[inline(always)]
    fn dispatch_wide<K: WideKernel<Self>>(kernel: K) -> K::Output {
        Self::dispatch(With::<Self, Self, K>::new(kernel))
    }
    /// The same for a kernel most of whose work is on single numbers: with registers of 32 bytes at most. After an operation on 64 bytes, some
    /// processors do without one of two units for single numbers for 40 ns (Sapphire Rapids, measured).
    #[inline(always)]
    fn dispatch_beside_numbers<K: WideKernel<Self>>(kernel: K) -> K::Output {
        Self::dispatch_wide(kernel)
    }
    /// The most numbers of this type that [`Scalar::dispatch_wide`] puts side by side on any processor.
    const COLUMNS: usize = 1;
    /// The same f64 in every lane, exactly.
    fn splat(x: f64) -> Self;
    /// A constant of the model, in every lane.
    fn constant(x: Self::Constant) -> Self;
    /// `self * a + b`, fused only where that is fast.
    fn fma(self, a: Self, b: Self) -> Self;
    /// 1 / x.
    fn recip(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Sine and cosine.
    fn sin_cos(self) -> (Self, Self);
    /// Sine and cosine of many numbers: the same values, several at once where one number has no lanes of its own. The other slices are as
    /// long or longer; with room for the next multiple of [`Scalar::COLUMNS`], which is written, what is read next need not wait for a
    /// part of a register.
    #[inline(always)]
    fn sin_cos_all(x: &[Self], sin: &mut [Self], cos: &mut [Self]) {
        for ((x, s), c) in x.iter().zip(sin).zip(cos) {
            (*s, *c) = x.sin_cos();
        }
    }
    /// True if every lane is finite and greater than zero: the test of a pivot.
    fn is_positive(self) -> bool;
    /// The smallest lane, rounded to f64: what an error message prints.
    fn min_lane(self) -> f64;
    /// The number in the first lane.
    fn first_lane(self) -> Self::Constant;
}

/// A calculation to be compiled for the instructions of its scalar. `run` and everything that it calls down to the scalar's
/// operators must be `#[inline(always)]`: a function left out of line is compiled without them, right but many times slower.
/// (A closure would do in place of a type, but cannot be made to inline.)
pub trait Kernel {
    /// What it returns.
    type Output;
    /// The calculation.
    fn run(self) -> Self::Output;
}

/// Inside an implementation of [`Scalar`]: kernels compute with the type itself.
#[macro_export]
macro_rules! arithmetic_is_self {
    () => {
        $crate::arithmetic_is_self!($crate::six_lanes::Eight<Self>);
    };
    ($six:ty) => {
        type Arithmetic = Self;
        type Six = $six;
        #[inline(always)]
        fn to_arithmetic(self) -> Self {
            self
        }
        #[inline(always)]
        fn from_arithmetic(x: Self) -> Self {
            x
        }
        #[inline(always)]
        fn arithmetic(x: &[Self]) -> &[Self] {
            x
        }
        #[inline(always)]
        fn arithmetic_mut(x: &mut [Self]) -> &mut [Self] {
            x
        }
    };
}

/// An ordered real scalar.
pub trait Real: Scalar<Constant = Self> + PartialOrd {
    /// Nearest f64.
    fn to_f64(self) -> f64;
    /// |x|.
    fn abs(self) -> Self {
        if self < Self::zero() { -self } else { self }
    }
    /// The angle of the point (x, y) with y = `self`.
    fn atan2(self, x: Self) -> Self;
    /// True for finite numbers.
    fn is_finite(self) -> bool {
        self.to_f64().is_finite()
    }
    /// The larger one.
    fn larger(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
}

macro_rules! float_scalar {
    ($t:ty, $($arithmetic:tt)*) => {
        impl Scalar for $t {
            type Constant = $t;
            const LANES: usize = 1;
            const EPSILON: f64 = <$t>::EPSILON as f64;
            $($arithmetic)*
            #[inline(always)]
            fn splat(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn constant(x: $t) -> Self {
                x
            }
            // `mul_add` without the processor's instruction is a library call: `lanes::Fused` is for kernels.
            #[inline(always)]
            fn fma(self, a: Self, b: Self) -> Self {
                self * a + b
            }
            #[inline(always)]
            fn recip(self) -> Self {
                1.0 / self
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                <$t>::sqrt(self)
            }
            #[inline(always)]
            fn sin_cos(self) -> (Self, Self) {
                <$t>::sin_cos(self)
            }
            #[inline(always)]
            fn is_positive(self) -> bool {
                self > 0.0 && self <= <$t>::MAX
            }
            fn min_lane(self) -> f64 {
                self as f64
            }
            #[inline(always)]
            fn first_lane(self) -> Self {
                self
            }
        }
        impl Real for $t {
            fn to_f64(self) -> f64 {
                self as f64
            }
            fn atan2(self, x: Self) -> Self {
                <$t>::atan2(self, x)
            }
        }
    };
}
float_scalar! { f32, type Abreast = Self; crate::arithmetic_is_self!(); }
float_scalar! {
    f64,
    type Abreast = crate::lanes::Four;
    type Arithmetic = Fused;
    type Six = crate::six_lanes::Eight<f64>;
    #[inline(always)]
    fn to_arithmetic(self) -> Fused {
        Fused(self)
    }
    #[inline(always)]
    fn from_arithmetic(x: Fused) -> f64 {
        x.0
    }
    #[inline(always)]
    fn arithmetic(x: &[f64]) -> &[Fused] {
        fused(x)
    }
    #[inline(always)]
    fn arithmetic_mut(x: &mut [f64]) -> &mut [Fused] {
        fused_mut(x)
    }
    #[inline(always)]
    fn lone<K: Kernel>(kernel: K) -> Option<K::Output> {
        Some(kernel.run())
    }
}
