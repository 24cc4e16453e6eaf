//! Comparison, choice by lanes, and the elementary functions of sums over pairs: the same to the last bit for one number and
//! for lanes.
//!
//! | function | method | largest error, units in the last place |
//! |---|---|---|
//! | [`Ordered::reciprocal_root`] | halved exponent as a first guess, two steps of fourth order | 1.5 |
//! | [`Ordered::exp`] | x = n ln 2 + r, Taylor's polynomial of degree 13 in r, \|r\| ≤ ½ ln 2 | 1.5 |
//! | [`Ordered::ln`] | x = 2ᵏ m, √½ ≤ m < √2, s = (m − 1)/(m + 1), polynomial in s² of FreeBSD's libm (msun, e_log.c) | 1 |
//!
//! They hold on the positive normal numbers (the exponential: below 709), and are not asked about others.

use crate::Scalar;
use std::f64::consts::LOG2_E;

/// 1.5 × 2⁵²: added to a number it leaves the nearest integer in the last bits.
const SHIFT: f64 = 6_755_399_441_055_744.0;

/// ln 2 in two parts; the first has 32 zeros at its end, so that n times it is exact.
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];

/// Below it the exponential is that of it, 3e-308.
const LEAST: f64 = -708.0;

/// 1/k! from k = 13 down to 2.
const EXPONENTIAL: [f64; 12] = [
    1.0 / 6_227_020_800.0,
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
];

/// Those of s¹⁴, s¹², … s² in −R.
const LOGARITHM: [f64; 7] = [
    -1.479_819_860_511_658_6e-1,
    -1.531_383_769_920_937_3e-1,
    -1.818_357_216_161_805e-1,
    -2.222_219_843_214_978_4e-1,
    -2.857_142_874_366_239e-1,
    -3.999_999_999_940_942e-1,
    -6.666_666_666_666_735e-1,
];

/// Numbers with an order, lane by lane.
pub trait Ordered: Scalar {
    /// |x|.
    fn abs(self) -> Self;
    /// The larger one; `other` where either is not a number.
    fn larger(self, other: Self) -> Self;
    /// `yes` in the lanes where `self < bound`, elsewhere `no`.
    fn below(self, bound: Self, yes: Self, no: Self) -> Self;
    /// This in the lanes whose bit is set, elsewhere `other`; lane 0 is the lowest bit.
    fn choose(self, bits: u32, other: Self) -> Self;
    /// A number within 3.5 % of 1/√x, by its bits; of zero, a large one.
    fn reciprocal_root_guess(self) -> Self;
    /// x 2ⁿ, with n in the last bits of `shifted` = n + 1.5 × 2⁵²; both x and the result are normal numbers.
    fn times_power_of_two(self, shifted: Self) -> Self;
    /// (m, k) with x = 2ᵏ m, √½ ≤ m < √2.
    fn mantissa_and_exponent(self) -> (Self, Self);

    /// 1/√x. Of 0 and of subnormal numbers it is a number above 1e154, whose square overflows.
    #[inline(always)]
    fn reciprocal_root(self) -> Self {
        let mut y = self.reciprocal_root_guess();
        for _ in 0..2 {
            // 1/√x = y (1 + h)^(−½), h = x y² − 1.
            let h = (self * y).fma(y, Self::splat(-1.0));
            let series = h.fma(Self::splat(-0.3125), Self::splat(0.375)).fma(h, Self::splat(-0.5));
            y = (y * h).fma(series, y);
        }
        y
    }
    /// eˣ.
    #[inline(always)]
    fn exp(self) -> Self {
        // In this order NaN stays NaN.
        let x = Self::splat(LEAST).larger(self);
        let shifted = x.fma(Self::splat(LOG2_E), Self::splat(SHIFT));
        let n = shifted - Self::splat(SHIFT);
        let r = n.fma(Self::splat(-LN_2[1]), n.fma(Self::splat(-LN_2[0]), x));
        let mut sum = Self::splat(EXPONENTIAL[0]);
        for k in 1..EXPONENTIAL.len() {
            sum = sum.fma(r, Self::splat(EXPONENTIAL[k]));
        }
        (r * r).fma(sum, r + Self::one()).times_power_of_two(shifted)
    }
    /// The natural logarithm.
    #[inline(always)]
    fn ln(self) -> Self {
        let (m, k) = self.mantissa_and_exponent();
        let f = m - Self::one();
        let minus_s = f / (Self::splat(-1.0) - m);
        let z = minus_s * minus_s;
        let mut sum = Self::splat(LOGARITHM[0]);
        for i in 1..LOGARITHM.len() {
            sum = sum.fma(z, Self::splat(LOGARITHM[i]));
        }
        // ln(1 + f) = f − s (f − R), −R = z Σ; the large part f is exact.
        let small = minus_s.fma(z.fma(sum, f), k * Self::splat(LN_2[1]));
        k.fma(Self::splat(LN_2[0]), f + small)
    }
}
