//! Sine and cosine by ring operations, the same for one number and for lanes.
//!
//! Reduction by n π/2 in three parts (Cody and Waite): x − n P₁ is exact with a fused multiplication, and what n P₂ and
//! n P₃ leave below the last bit is carried along. On |r| ≤ π/4 the polynomials are those of FreeBSD's libm (msun,
//! k_sin.c and k_cos.c), of degree 13 and 14. Error below 0.6 units in the last place up to |x| = 1e9; beyond that each
//! lane asks the standard library.

use crate::Scalar;

/// Beyond it the standard library answers: n would not fit its bits.
const LIMIT: f64 = 1e9;

/// 1.5 × 2⁵²: added to a number it leaves the nearest integer in the last bits.
const SHIFT: f64 = 6_755_399_441_055_744.0;

/// π/2 in three parts.
const HALF_PI: [f64; 3] =
    [std::f64::consts::FRAC_PI_2, 6.123_233_995_736_766e-17, -1.497_384_904_859_169_8e-33];

/// Coefficients of r³, r⁵, … of the sine.
const SINE: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];

/// Coefficients of r⁴, r⁶, … of the cosine.
const COSINE: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// What the selection of quadrants needs from a type with lanes.
pub(crate) trait Quadrants: Scalar {
    /// Chooses, by the integer n in the last bits of `n + SHIFT`, (sin, cos) of r + n π/2 from those of r.
    fn turn(shifted: Self, sin: Self, cos: Self) -> (Self, Self);
    /// True if every lane is below `limit` in size; false for NaN.
    fn within(self, limit: f64) -> bool;
    /// Sine and cosine by the standard library, lane by lane, where a lane is beyond `limit`; elsewhere those given.
    fn by_library(self, limit: f64, sin: Self, cos: Self) -> (Self, Self);
}

#[inline(always)]
fn polynomial<T: Scalar>(z: T, coefficients: &[f64; 6]) -> T {
    let [c0, c1, c2, c3, c4, c5] = coefficients;
    let c = [T::splat(*c0), T::splat(*c1), T::splat(*c2), T::splat(*c3), T::splat(*c4), T::splat(*c5)];
    // Two halves side by side: half the latency of Horner's rule.
    let z2 = z * z;
    let (low, high) = (c[1].fma(z, c[0]), c[3].fma(z, c[2]));
    c[5].fma(z, c[4]).fma(z2, high).fma(z2, low)
}

#[inline(always)]
pub(crate) fn sin_cos<T: Quadrants>(x: T) -> (T, T) {
    let shifted = x.fma(T::splat(std::f64::consts::FRAC_2_PI), T::splat(SHIFT));
    let n = shifted - T::splat(SHIFT);
    let [first, second, third] = [T::splat(HALF_PI[0]), T::splat(HALF_PI[1]), T::splat(HALF_PI[2])];
    let exact = n.fma(-first, x);
    let product = n * second;
    let r = exact - product;
    let below = ((exact - r) - product) - n.fma(second, -product);
    let below = n.fma(-third, below);
    let z = r * r;
    let half = T::splat(0.5) * z;
    let flat = T::one() - half;
    let sin = r + (z * r).fma(polynomial(z, &SINE), below * flat);
    let cos = flat + ((T::one() - flat) - half + (z * z).fma(polynomial(z, &COSINE), -(r * below)));
    let (s, c) = T::turn(shifted, sin, cos);
    if x.within(LIMIT) { (s, c) } else { x.by_library(LIMIT, s, c) }
}
