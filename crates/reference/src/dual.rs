//! Dual numbers: a value and its derivative along one direction.

use core::cmp::Ordering;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};
use num_traits::{One, Zero};
use phipsi_spatial::{Real, Scalar};

/// x + ẋ ε with ε² = 0. Equality and order are those of x, as of functions close to one point.
#[derive(Clone, Copy, Debug)]
pub struct Dual<T> {
    /// x.
    pub value: T,
    /// ẋ.
    pub rate: T,
}

impl<T: Real> Dual<T> {
    /// From a value and its derivative.
    pub fn new(value: T, rate: T) -> Self {
        Dual { value, rate }
    }
    /// A number that does not change.
    pub fn fixed(value: T) -> Self {
        Dual::new(value, T::zero())
    }
}

impl<T: Real> Add for Dual<T> {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Dual::new(self.value + b.value, self.rate + b.rate)
    }
}
impl<T: Real> Sub for Dual<T> {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Dual::new(self.value - b.value, self.rate - b.rate)
    }
}
impl<T: Real> Mul for Dual<T> {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        Dual::new(self.value * b.value, self.rate * b.value + self.value * b.rate)
    }
}
impl<T: Real> Div for Dual<T> {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let value = self.value / b.value;
        Dual::new(value, (self.rate - value * b.rate) / b.value)
    }
}
impl<T: Real> Neg for Dual<T> {
    type Output = Self;
    fn neg(self) -> Self {
        Dual::new(-self.value, -self.rate)
    }
}
impl<T: Real> AddAssign for Dual<T> {
    fn add_assign(&mut self, b: Self) {
        *self = *self + b;
    }
}
impl<T: Real> SubAssign for Dual<T> {
    fn sub_assign(&mut self, b: Self) {
        *self = *self - b;
    }
}
impl<T: Real> MulAssign for Dual<T> {
    fn mul_assign(&mut self, b: Self) {
        *self = *self * b;
    }
}
impl<T: Real> DivAssign for Dual<T> {
    fn div_assign(&mut self, b: Self) {
        *self = *self / b;
    }
}
impl<T: Real> Zero for Dual<T> {
    fn zero() -> Self {
        Dual::fixed(T::zero())
    }
    fn is_zero(&self) -> bool {
        self.value.is_zero() && self.rate.is_zero()
    }
}
impl<T: Real> One for Dual<T> {
    fn one() -> Self {
        Dual::fixed(T::one())
    }
}
impl<T: Real> PartialEq for Dual<T> {
    fn eq(&self, b: &Self) -> bool {
        self.value == b.value
    }
}
impl<T: Real> PartialOrd for Dual<T> {
    fn partial_cmp(&self, b: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&b.value)
    }
}

impl<T: Real> Scalar for Dual<T> {
    type Constant = Self;
    type Abreast = Self;
    const LANES: usize = 1;
    const EPSILON: f64 = T::EPSILON;
    phipsi_spatial::arithmetic_is_self!();
    fn splat(x: f64) -> Self {
        Dual::fixed(T::splat(x))
    }
    fn constant(x: Self) -> Self {
        x
    }
    fn fma(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    fn recip(self) -> Self {
        let value = self.value.recip();
        Dual::new(value, -(value * value * self.rate))
    }
    fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Dual::new(value, self.rate / (value + value))
    }
    fn sin_cos(self) -> (Self, Self) {
        let (s, c) = self.value.sin_cos();
        (Dual::new(s, c * self.rate), Dual::new(c, -(s * self.rate)))
    }
    fn is_positive(self) -> bool {
        self.value.is_positive()
    }
    fn min_lane(self) -> f64 {
        self.value.min_lane()
    }
    fn first_lane(self) -> Self {
        self
    }
}

impl<T: Real> Real for Dual<T> {
    fn to_f64(self) -> f64 {
        self.value.to_f64()
    }
    fn atan2(self, x: Self) -> Self {
        let square = self.value * self.value + x.value * x.value;
        let rate = (self.rate * x.value - self.value * x.rate) / square;
        Dual::new(self.value.atan2(x.value), rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// f(x) = sin x cos x/√(1 + x²) at x = 0.7 against its derivative by hand.
    #[test]
    fn a_function_of_every_operation() {
        let x = 0.7f64;
        let d = Dual::new(x, 1.0);
        let (s, c) = d.sin_cos();
        let root = (Dual::one() + d * d).sqrt();
        let f = s * c / root;
        let want = (x + x).cos() / root.value - 0.5 * (x + x).sin() * x / (1.0 + x * x).powf(1.5);
        assert!((f.rate - want).abs() < 4.0 * f64::EPSILON, "{} {want}", f.rate);
        let g = s * c * root.recip();
        assert!((g.rate - want).abs() < 4.0 * f64::EPSILON, "{} {want}", g.rate);
        assert!((s.atan2(c).rate - 1.0).abs() < 4.0 * f64::EPSILON);
    }
}
