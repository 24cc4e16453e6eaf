//! Double-double numbers: about 32 digits, for references, error measurement and ill-conditioned scenes.
//!
//! A value is the unevaluated sum `hi + lo` with |lo| ≤ ½ ulp(hi). Sums and products are the error-free
//! transformations of Dekker (1971) and Knuth, corrected once; relative error of × ÷ √ sin cos: about 2.5e-32.

use crate::{Real, Scalar};
use core::cmp::Ordering;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};
use num_traits::{One, Zero};

/// A double-double number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dd {
    /// The nearest f64.
    pub hi: f64,
    /// What `hi` lacks.
    pub lo: f64,
}

/// π/2 in three parts, the first two exact to their last bit.
const HALF_PI: [f64; 3] = [std::f64::consts::FRAC_PI_2, 6.123_233_995_736_766e-17, -1.497_384_904_859_17e-33];

fn two_sum(a: f64, b: f64) -> Dd {
    let s = a + b;
    let bb = s - a;
    Dd { hi: s, lo: (a - (s - bb)) + (b - bb) }
}

fn quick_two_sum(a: f64, b: f64) -> Dd {
    let s = a + b;
    Dd { hi: s, lo: b - (s - a) }
}

fn split(a: f64) -> (f64, f64) {
    let t = 134_217_729.0 * a; // 2²⁷ + 1
    let hi = t - (t - a);
    (hi, a - hi)
}

fn two_product(a: f64, b: f64) -> Dd {
    let p = a * b;
    let ((ah, al), (bh, bl)) = (split(a), split(b));
    Dd { hi: p, lo: ((ah * bh - p) + ah * bl + al * bh) + al * bl }
}

impl Dd {
    /// From an f64, exactly.
    pub const fn from_f64(x: f64) -> Self {
        Dd { hi: x, lo: 0.0 }
    }
    /// π.
    pub const PI: Dd = Dd { hi: 2.0 * HALF_PI[0], lo: 2.0 * HALF_PI[1] };

    /// Sine and cosine of |x| ≤ π/4, by Taylor series.
    fn sin_cos_small(self) -> (Self, Self) {
        let x2 = self * self;
        let (mut s, mut c) = (Dd::one(), Dd::one());
        for k in (1..=14).rev() {
            let n = 2.0 * k as f64;
            c = Dd::one() - x2 * c / Dd::from_f64((n - 1.0) * n);
            s = Dd::one() - x2 * s / Dd::from_f64(n * (n + 1.0));
        }
        (s * self, c)
    }
}

impl Add for Dd {
    type Output = Dd;
    fn add(self, b: Dd) -> Dd {
        let (s, t) = (two_sum(self.hi, b.hi), two_sum(self.lo, b.lo));
        let v = quick_two_sum(s.hi, s.lo + t.hi);
        quick_two_sum(v.hi, v.lo + t.lo)
    }
}
impl Neg for Dd {
    type Output = Dd;
    fn neg(self) -> Dd {
        Dd { hi: -self.hi, lo: -self.lo }
    }
}
impl Sub for Dd {
    type Output = Dd;
    fn sub(self, b: Dd) -> Dd {
        self + -b
    }
}
impl Mul for Dd {
    type Output = Dd;
    fn mul(self, b: Dd) -> Dd {
        let p = two_product(self.hi, b.hi);
        quick_two_sum(p.hi, p.lo + (self.hi * b.lo + self.lo * b.hi))
    }
}
impl Div for Dd {
    type Output = Dd;
    fn div(self, b: Dd) -> Dd {
        let q1 = self.hi / b.hi;
        let r = self - b * Dd::from_f64(q1);
        let q2 = r.hi / b.hi;
        let r = r - b * Dd::from_f64(q2);
        let q = quick_two_sum(q1, q2);
        q + Dd::from_f64(r.hi / b.hi)
    }
}
impl AddAssign for Dd {
    fn add_assign(&mut self, b: Dd) {
        *self = *self + b;
    }
}
impl SubAssign for Dd {
    fn sub_assign(&mut self, b: Dd) {
        *self = *self - b;
    }
}
impl MulAssign for Dd {
    fn mul_assign(&mut self, b: Dd) {
        *self = *self * b;
    }
}
impl DivAssign for Dd {
    fn div_assign(&mut self, b: Dd) {
        *self = *self / b;
    }
}
impl Zero for Dd {
    fn zero() -> Self {
        Dd::from_f64(0.0)
    }
    fn is_zero(&self) -> bool {
        self.hi == 0.0
    }
}
impl One for Dd {
    fn one() -> Self {
        Dd::from_f64(1.0)
    }
}
impl PartialOrd for Dd {
    fn partial_cmp(&self, b: &Dd) -> Option<Ordering> {
        match self.hi.partial_cmp(&b.hi) {
            Some(Ordering::Equal) => self.lo.partial_cmp(&b.lo),
            order => order,
        }
    }
}

impl Scalar for Dd {
    type Constant = Dd;
    type Abreast = Dd;
    const LANES: usize = 1;
    const EPSILON: f64 = 4.93e-32;
    crate::arithmetic_is_self!();
    fn splat(x: f64) -> Self {
        Dd::from_f64(x)
    }
    fn constant(x: Dd) -> Self {
        x
    }
    fn fma(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    fn recip(self) -> Self {
        Dd::one() / self
    }
    fn sqrt(self) -> Self {
        if self.hi == 0.0 {
            return self;
        }
        // One Newton step from the f64 root doubles its digits.
        let x = Dd::from_f64(self.hi.sqrt());
        x + (self - x * x) / (x + x)
    }
    fn sin_cos(self) -> (Self, Self) {
        let k = (self.hi / HALF_PI[0]).round();
        let r = HALF_PI.iter().fold(self, |r, &p| r - two_product(k, p));
        let (s, c) = r.sin_cos_small();
        match k.rem_euclid(4.0) as u8 {
            0 => (s, c),
            1 => (c, -s),
            2 => (-s, -c),
            _ => (-c, s),
        }
    }
    fn is_positive(self) -> bool {
        self.hi > 0.0 && self.hi < f64::INFINITY
    }
    fn min_lane(self) -> f64 {
        self.hi
    }
    fn first_lane(self) -> Dd {
        self
    }
}

impl Real for Dd {
    fn to_f64(self) -> f64 {
        self.hi
    }
    fn atan2(self, x: Self) -> Self {
        let start = Dd::from_f64(self.hi.atan2(x.hi));
        let r = (x * x + self * self).sqrt();
        if r.hi == 0.0 {
            return start;
        }
        // sin(θ − θ₀) = (y cos θ₀ − x sin θ₀)/r is below 1e-15, so its cube is lost.
        let (s, c) = start.sin_cos();
        start + (self * c - x * s) / r
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn division_and_root_reach_thirty_one_digits() {
        let third = Dd::one() / Dd::from_f64(3.0);
        assert!((third * Dd::from_f64(3.0) - Dd::one()).hi.abs() < 4.0 * Dd::EPSILON);
        let two = Dd::from_f64(2.0);
        assert!((two.sqrt() * two.sqrt() - two).hi.abs() < 8.0 * Dd::EPSILON);
    }

    #[test]
    fn sine_of_known_angles() {
        let (s, c) = (Dd::PI / Dd::from_f64(6.0)).sin_cos();
        assert!((s - Dd::from_f64(0.5)).hi.abs() < 4.0 * Dd::EPSILON);
        assert!((c * c - Dd::from_f64(0.75)).hi.abs() < 8.0 * Dd::EPSILON);
        for k in [-7.0, 3.0, 1000.0] {
            let x = Dd::from_f64(0.3) + Dd::from_f64(k) * Dd::PI * Dd::from_f64(2.0);
            let (a, b) = (x.sin_cos(), Dd::from_f64(0.3).sin_cos());
            assert!((a.0 - b.0).hi.abs() < 1e-31 * (1.0 + k.abs()), "k = {k}");
        }
    }

    #[test]
    fn arc_tangent_inverts_sine_and_cosine() {
        for x in [-3.1, -1.0, 1e-9, 0.7, 2.9] {
            let (s, c) = Dd::from_f64(x).sin_cos();
            assert!((s.atan2(c) - Dd::from_f64(x)).hi.abs() < 16.0 * Dd::EPSILON, "x = {x}");
        }
    }
}
