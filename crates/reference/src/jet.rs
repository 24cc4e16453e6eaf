//! Numbers with their first two derivatives by time: products and sines by the rules of differentiation.

use core::ops::{Add, Mul, Sub};
use phipsi_spatial::Real;

/// x(t), ẋ(t) and ẍ(t) at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet<T> {
    /// x.
    pub value: T,
    /// ẋ.
    pub rate: T,
    /// ẍ.
    pub second: T,
}

impl<T: Real> Jet<T> {
    /// From value, first and second derivative.
    pub fn new(value: T, rate: T, second: T) -> Self {
        Jet { value, rate, second }
    }
    /// A number that does not change.
    pub fn constant(value: T) -> Self {
        Jet::new(value, T::zero(), T::zero())
    }
    /// s x for a constant s.
    pub fn scale(self, s: T) -> Self {
        Jet::new(self.value * s, self.rate * s, self.second * s)
    }
    /// Sine and cosine.
    pub fn sin_cos(self) -> (Self, Self) {
        let (s, c) = self.value.sin_cos();
        let square = self.rate * self.rate;
        (
            Jet::new(s, c * self.rate, c * self.second - s * square),
            Jet::new(c, -(s * self.rate), -(s * self.second) - c * square),
        )
    }
}

impl<T: Real> Add for Jet<T> {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Jet::new(self.value + b.value, self.rate + b.rate, self.second + b.second)
    }
}
impl<T: Real> Sub for Jet<T> {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Jet::new(self.value - b.value, self.rate - b.rate, self.second - b.second)
    }
}
impl<T: Real> Mul for Jet<T> {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        let cross = self.rate * b.rate;
        Jet::new(
            self.value * b.value,
            self.rate * b.value + self.value * b.rate,
            self.second * b.value + cross + cross + self.value * b.second,
        )
    }
}
