//! Several states at once in the lanes of SIMD registers, chosen for the processor when the program runs.
//!
//! [`Fused`] is one f64 that multiplies and adds in one rounding; the lanes of the wider types do exactly the same
//! operations, so that a state's result does not depend on the width it was computed in, nor on the processor.
//!
//! | level | lanes of f64 | processors |
//! |---|---|---|
//! | [`Level::Avx512`] | 8 | x86-64 with AVX-512F |
//! | [`Level::Avx2`] | 4 | x86-64 with AVX2 and FMA |
//! | [`Level::Scalar`] | 1 | all; without a fused instruction each costs a library call, some ten times more |
//!
//! A kernel is entered through [`crate::Scalar::dispatch`], which compiles it for the instructions of its scalar;
//! everything between there and the operators is inlined. A closure that `map` or `from_fn` of arrays is given may not be: it is then
//! compiled for any processor, and slower by a factor of ten, so that kernels have loops instead. The types with lanes have no public
//! name: a value of them exists only inside [`at_level`], after the processor was asked.

// The one place with unsafe code: intrinsics, and one view of f64 as Fused.
#![allow(unsafe_code)]

use crate::ordered::Ordered;
use crate::sin_cos::{Quadrants, sin_cos};
use crate::wide::{Wide, WideKernel, With};
use crate::{Kernel, Scalar};
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};
use num_traits::{One, Zero};
use std::sync::OnceLock;

/// The environment variable that forces a level: `avx512`, `avx2` or `scalar`.
pub const LEVEL_VARIABLE: &str = "PHIPSI_SIMD";

/// Instructions that kernels on several states use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// One state at a time.
    Scalar,
    /// Four states.
    Avx2,
    /// Eight states.
    Avx512,
}

impl Level {
    /// All levels, narrowest first.
    pub const ALL: [Level; 3] = [Level::Scalar, Level::Avx2, Level::Avx512];
    /// Its name, as in [`LEVEL_VARIABLE`].
    pub fn name(self) -> &'static str {
        match self {
            Level::Scalar => "scalar",
            Level::Avx2 => "avx2",
            Level::Avx512 => "avx512",
        }
    }
    /// True if this processor has its instructions.
    pub fn is_available(self) -> bool {
        match self {
            Level::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => {
                Level::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }
    /// The widest level of this processor, or the narrower one that [`LEVEL_VARIABLE`] names; asked once.
    pub fn best() -> Level {
        static BEST: OnceLock<Level> = OnceLock::new();
        *BEST.get_or_init(|| {
            let wanted = std::env::var(LEVEL_VARIABLE).unwrap_or_default();
            let limit = Level::ALL.into_iter().find(|l| l.name() == wanted).unwrap_or(Level::Avx512);
            let fits = |l: &Level| *l <= limit && l.is_available();
            Level::ALL.into_iter().rev().find(fits).unwrap_or(Level::Scalar)
        })
    }
}

/// A scalar whose lanes are f64 states.
pub trait Lanes: Scalar<Constant = f64, Arithmetic = Self> + Wide<Fused> + Ordered {
    /// Lane i is `f(i)`.
    fn from_lanes(f: impl FnMut(usize) -> f64) -> Self;
    /// Lane i.
    fn lane(self, i: usize) -> f64;
    /// The numbers in memory: lane after lane, then the next of `x`.
    fn numbers(x: &[Self]) -> &[f64];
    /// Lane i of each of `out` becomes a number of row i: as many rows as lanes, each with as many numbers as `out` has.
    /// With fewer, `out` is left alone.
    fn pack(rows: &[&[f64]], out: &mut [Self]);
    /// The reverse of [`Lanes::pack`], to rows that follow each other: as many as `out` has, at most as many as lanes.
    fn unpack(x: &[Self], out: &mut [f64]);
}

/// Work that is generic over the number of lanes.
pub trait Visitor {
    /// What it returns.
    type Output;
    /// The work, with lanes of type `T`.
    fn visit<T: Lanes>(self) -> Self::Output;
}

/// Does the work with the lanes of a level; `None` if this processor does not have it.
pub fn at_level<V: Visitor>(level: Level, visitor: V) -> Option<V::Output> {
    if !level.is_available() {
        return None;
    }
    Some(match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => visitor.visit::<x86::F64x8>(),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => visitor.visit::<x86::F64x4>(),
        _ => visitor.visit::<Fused>(),
    })
}

/// Does the work with the lanes of [`Level::best`].
pub fn widest<V: Visitor>(visitor: V) -> V::Output {
    match Level::best() {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => visitor.visit::<x86::F64x8>(),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => visitor.visit::<x86::F64x4>(),
        _ => visitor.visit::<Fused>(),
    }
}

/// An f64 whose [`Scalar::fma`] rounds once: what kernels on f64 compute with.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct Fused(pub f64);

/// [`Lanes::numbers`] of a type that is nothing but its lanes.
macro_rules! numbers_in_memory {
    () => {
        #[inline(always)]
        fn numbers(x: &[Self]) -> &[f64] {
            // SAFETY: the type is transparent over its lanes of f64, and aligned for them.
            unsafe { core::slice::from_raw_parts(x.as_ptr().cast(), x.len() * Self::LANES) }
        }
    };
}

/// The operators that follow from the binary ones.
macro_rules! assigning_operators {
    ($t:ty) => {
        impl AddAssign for $t {
            #[inline(always)]
            fn add_assign(&mut self, b: Self) {
                *self = *self + b;
            }
        }
        impl SubAssign for $t {
            #[inline(always)]
            fn sub_assign(&mut self, b: Self) {
                *self = *self - b;
            }
        }
        impl MulAssign for $t {
            #[inline(always)]
            fn mul_assign(&mut self, b: Self) {
                *self = *self * b;
            }
        }
        impl DivAssign for $t {
            #[inline(always)]
            fn div_assign(&mut self, b: Self) {
                *self = *self / b;
            }
        }
        impl Zero for $t {
            #[inline(always)]
            fn zero() -> Self {
                <$t>::splat(0.0)
            }
            #[inline(always)]
            fn is_zero(&self) -> bool {
                *self == Self::zero()
            }
        }
        impl One for $t {
            #[inline(always)]
            fn one() -> Self {
                <$t>::splat(1.0)
            }
        }
    };
}

macro_rules! fused_operator {
    ($trait:ident, $method:ident, $op:tt) => {
        impl $trait for Fused {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: Self) -> Self {
                Fused(self.0 $op b.0)
            }
        }
    };
}
fused_operator!(Add, add, +);
fused_operator!(Sub, sub, -);
fused_operator!(Mul, mul, *);
fused_operator!(Div, div, /);
impl Neg for Fused {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Fused(-self.0)
    }
}
assigning_operators!(Fused);

impl Scalar for Fused {
    type Constant = f64;
    type Abreast = Four;
    const LANES: usize = 1;
    const EPSILON: f64 = f64::EPSILON;
    #[cfg(target_arch = "x86_64")]
    crate::arithmetic_is_self!(x86::Halves);
    #[cfg(not(target_arch = "x86_64"))]
    crate::arithmetic_is_self!();
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Fused(x)
    }
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Fused(x)
    }
    #[inline(always)]
    fn fma(self, a: Self, b: Self) -> Self {
        Fused(self.0.mul_add(a.0, b.0))
    }
    #[inline(always)]
    fn recip(self) -> Self {
        Fused(1.0 / self.0)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Fused(self.0.sqrt())
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self)
    }
    #[inline(always)]
    fn sin_cos_all(x: &[Self], sin: &mut [Self], cos: &mut [Self]) {
        Self::dispatch_beside_numbers(SinCosAll { x, sin, cos });
    }
    #[inline(always)]
    fn is_positive(self) -> bool {
        // Compared with infinity, this would become a test of bits, twice as long as two comparisons.
        self.0 > 0.0 && self.0 <= f64::MAX
    }
    fn min_lane(self) -> f64 {
        self.0
    }
    #[inline(always)]
    fn first_lane(self) -> f64 {
        self.0
    }
    #[inline(always)]
    fn dispatch<K: Kernel>(kernel: K) -> K::Output {
        // AVX-512 has twice the registers, also for one number.
        #[cfg(target_arch = "x86_64")]
        if Level::best() == Level::Avx512 {
            // SAFETY: the processor has AVX-512.
            return unsafe { x86::with_avx512(kernel) };
        } else if Level::Avx2.is_available() {
            // SAFETY: the processor has AVX2 and FMA.
            return unsafe { x86::with_fma(kernel) };
        }
        kernel.run()
    }
    const COLUMNS: usize = crate::wide::WIDEST;
    #[inline(always)]
    fn dispatch_wide<K: WideKernel<Self>>(kernel: K) -> K::Output {
        match Level::best() {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => x86::F64x8::dispatch(With::<Self, x86::F64x8, K>::new(kernel)),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => x86::F64x4::dispatch(With::<Self, x86::F64x4, K>::new(kernel)),
            _ => Self::dispatch(With::<Self, Self, K>::new(kernel)),
        }
    }
    #[inline(always)]
    fn dispatch_beside_numbers<K: WideKernel<Self>>(kernel: K) -> K::Output {
        match Level::best() {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 | Level::Avx2 => Self::dispatch(With::<Self, x86::F64x4, K>::new(kernel)),
            _ => Self::dispatch(With::<Self, Self, K>::new(kernel)),
        }
    }
}

/// [`Scalar::sin_cos_all`] in lanes.
struct SinCosAll<'a> {
    x: &'a [Fused],
    sin: &'a mut [Fused],
    cos: &'a mut [Fused],
}

impl WideKernel<Fused> for SinCosAll<'_> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<Fused>>(self) {
        let SinCosAll { x, sin, cos } = self;
        let count = x.len();
        let groups = x.chunks(W::COUNT).zip(sin.chunks_mut(W::COUNT)).zip(cos.chunks_mut(W::COUNT));
        for (i, ((x, sin), cos)) in groups.enumerate() {
            let (s, c) = W::load_first(x).sin_cos();
            if sin.len() == W::COUNT && cos.len() == W::COUNT {
                s.store(sin);
                c.store(cos);
                continue;
            }
            let rest = W::COUNT.min(count - i * W::COUNT);
            s.store_first(&mut sin[..rest]);
            c.store_first(&mut cos[..rest]);
        }
    }
}

impl Lanes for Fused {
    #[inline(always)]
    fn from_lanes(mut f: impl FnMut(usize) -> f64) -> Self {
        Fused(f(0))
    }
    #[inline(always)]
    fn lane(self, _: usize) -> f64 {
        self.0
    }
    numbers_in_memory!();
    #[inline(always)]
    fn pack(rows: &[&[f64]], out: &mut [Self]) {
        for row in rows {
            for (to, x) in out.iter_mut().zip(*row) {
                *to = Fused(*x);
            }
        }
    }
    #[inline(always)]
    fn unpack(x: &[Self], out: &mut [f64]) {
        for (to, x) in out.iter_mut().zip(x) {
            *to = x.0;
        }
    }
}

impl Quadrants for Fused {
    #[inline(always)]
    fn turn(shifted: Self, sin: Self, cos: Self) -> (Self, Self) {
        let n = shifted.0.to_bits();
        let (s, c) = if n & 1 == 0 { (sin.0, cos.0) } else { (cos.0, sin.0) };
        let flip = |x: f64, n: u64| f64::from_bits(x.to_bits() ^ ((n & 2) << 62));
        (Fused(flip(s, n)), Fused(flip(c, n.wrapping_add(1))))
    }
    #[inline(always)]
    fn within(self, limit: f64) -> bool {
        self.0.abs() < limit
    }
    #[cold]
    #[inline(never)]
    fn by_library(self, _: f64, _: Self, _: Self) -> (Self, Self) {
        let (s, c) = self.0.sin_cos();
        (Fused(s), Fused(c))
    }
}

/// The bits of √½, of 1, and of 2⁵².
const BITS: [u64; 3] = [0x3fe6_a09e_667f_3bcd, 0x3ff0_0000_0000_0000, 0x4330_0000_0000_0000];
/// 2⁵² and the offset of exponents.
const EXPONENT_ZERO: f64 = 4_503_599_627_370_496.0 + 1023.0;
/// Less half the bits of x it is near 1/√x.
const ROOT_BITS: u64 = 0x5fe6_eb50_c7b5_37a9;

impl Ordered for Fused {
    #[inline(always)]
    fn abs(self) -> Self {
        Fused(self.0.abs())
    }
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        if self.0 > other.0 { self } else { other }
    }
    #[inline(always)]
    fn below(self, bound: Self, yes: Self, no: Self) -> Self {
        if self.0 < bound.0 { yes } else { no }
    }
    #[inline(always)]
    fn choose(self, bits: u32, other: Self) -> Self {
        if bits & 1 == 1 { self } else { other }
    }
    #[inline(always)]
    fn reciprocal_root_guess(self) -> Self {
        Fused(f64::from_bits(ROOT_BITS.wrapping_sub(self.0.to_bits() >> 1)))
    }
    #[inline(always)]
    fn times_power_of_two(self, shifted: Self) -> Self {
        Fused(f64::from_bits(self.0.to_bits().wrapping_add(shifted.0.to_bits() << 52)))
    }
    #[inline(always)]
    fn mantissa_and_exponent(self) -> (Self, Self) {
        let bits = self.0.to_bits();
        let biased = bits.wrapping_add(BITS[1] - BITS[0]) >> 52;
        let m = f64::from_bits(bits.wrapping_sub(biased << 52).wrapping_add(BITS[1]));
        (Fused(m), Fused(f64::from_bits(biased | BITS[2]) - EXPONENT_ZERO))
    }
}

/// The same numbers, seen as [`Fused`].
#[inline(always)]
pub(crate) fn fused(x: &[f64]) -> &[Fused] {
    // SAFETY: Fused is a transparent f64.
    unsafe { core::slice::from_raw_parts(x.as_ptr().cast(), x.len()) }
}

/// The same numbers, seen as [`Fused`].
#[inline(always)]
pub(crate) fn fused_mut(x: &mut [f64]) -> &mut [Fused] {
    // SAFETY: Fused is a transparent f64.
    unsafe { core::slice::from_raw_parts_mut(x.as_mut_ptr().cast(), x.len()) }
}

/// Numbers of four bodies of one state.
#[cfg(target_arch = "x86_64")]
pub use x86::Four;
/// Numbers of bodies of one state: one, where there are no registers for more.
#[cfg(not(target_arch = "x86_64"))]
pub type Four = f64;

#[cfg(target_arch = "x86_64")]
mod x86;

#[cfg(test)]
mod tests;
