//! Six-vectors: motions (ω, v) and wrenches (n, f), with the two cross products of soa.md 3.0.

use crate::{Scalar, Vec3};
use core::ops::{Add, AddAssign, Neg, Sub, SubAssign};

/// A spatial velocity or acceleration: angular part first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion<T> {
    /// ω, rad/s (or its rate).
    pub angular: Vec3<T>,
    /// Velocity of the frame's origin, m/s (or its rate).
    pub linear: Vec3<T>,
}

/// A spatial force or momentum: moment about the frame's origin first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrench<T> {
    /// Moment about the origin, N·m.
    pub moment: Vec3<T>,
    /// Force, N.
    pub force: Vec3<T>,
}

macro_rules! six_vector {
    ($name:ident, $top:ident, $bottom:ident) => {
        impl<T: Scalar> $name<T> {
            /// From the angular and the linear part.
            #[inline(always)]
            pub fn new($top: Vec3<T>, $bottom: Vec3<T>) -> Self {
                $name { $top, $bottom }
            }
            /// The zero vector.
            #[inline(always)]
            pub fn zero() -> Self {
                Self::new(Vec3::zero(), Vec3::zero())
            }
            /// The i-th coordinate vector, angular first.
            #[inline(always)]
            pub fn unit(i: usize) -> Self {
                if i < 3 {
                    Self::new(Vec3::unit(i), Vec3::zero())
                } else {
                    Self::new(Vec3::zero(), Vec3::unit(i - 3))
                }
            }
            /// The i-th component, angular first.
            #[inline(always)]
            pub fn get(&self, i: usize) -> T {
                if i < 3 { self.$top.0[i] } else { self.$bottom.0[i - 3] }
            }
            /// Adds x to the i-th component.
            #[inline(always)]
            pub fn add_to(&mut self, i: usize, x: T) {
                if i < 3 {
                    self.$top.0[i] += x;
                } else {
                    self.$bottom.0[i - 3] += x;
                }
            }
            /// s times the vector.
            #[inline(always)]
            pub fn scale(self, s: T) -> Self {
                Self::new(self.$top.scale(s), self.$bottom.scale(s))
            }
            /// s times the vector, plus b.
            #[inline(always)]
            pub fn scale_add(self, s: T, b: Self) -> Self {
                Self::new(self.$top.scale_add(s, b.$top), self.$bottom.scale_add(s, b.$bottom))
            }
            /// Each component by `f`.
            #[inline(always)]
            pub fn map<U: Scalar>(self, f: impl Fn(T) -> U) -> $name<U> {
                let ([a, b, c], [d, e, g]) = (self.$top.0, self.$bottom.0);
                $name { $top: Vec3([f(a), f(b), f(c)]), $bottom: Vec3([f(d), f(e), f(g)]) }
            }
            /// The six components, angular first.
            #[inline(always)]
            pub fn to_array(self) -> [T; 6] {
                let ([a, b, c], [d, e, f]) = (self.$top.0, self.$bottom.0);
                [a, b, c, d, e, f]
            }
            /// From six components, angular first.
            #[inline(always)]
            pub fn from_array(a: [T; 6]) -> Self {
                Self::new(Vec3([a[0], a[1], a[2]]), Vec3([a[3], a[4], a[5]]))
            }
        }
        impl<T: Scalar> Add for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn add(self, b: Self) -> Self {
                Self::new(self.$top + b.$top, self.$bottom + b.$bottom)
            }
        }
        impl<T: Scalar> Sub for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn sub(self, b: Self) -> Self {
                Self::new(self.$top - b.$top, self.$bottom - b.$bottom)
            }
        }
        impl<T: Scalar> Neg for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self::new(-self.$top, -self.$bottom)
            }
        }
        impl<T: Scalar> AddAssign for $name<T> {
            #[inline(always)]
            fn add_assign(&mut self, b: Self) {
                *self = *self + b;
            }
        }
        impl<T: Scalar> SubAssign for $name<T> {
            #[inline(always)]
            fn sub_assign(&mut self, b: Self) {
                *self = *self - b;
            }
        }
    };
}
six_vector!(Motion, angular, linear);
six_vector!(Wrench, moment, force);

impl<T: Scalar> Motion<T> {
    /// Power of a wrench on this motion: ω·n + v·f.
    #[inline(always)]
    pub fn dot(self, f: Wrench<T>) -> T {
        let ([a, b, c], [d, e, g]) = (self.angular.0, self.linear.0);
        let ([x, y, z], [u, v, w]) = (f.moment.0, f.force.0);
        a.fma(x, b.fma(y, c * z)) + d.fma(u, e.fma(v, g * w))
    }
    /// Motion cross product `crm(V) X`: the rate of a motion X that is constant in a frame moving with V.
    #[inline(always)]
    pub fn cross_motion(self, x: Self) -> Self {
        Motion::new(
            self.angular.cross(x.angular),
            self.linear.cross(x.angular) + self.angular.cross(x.linear),
        )
    }
    /// Force cross product `V~ f`: the rate of a wrench f that is constant in a frame moving with V.
    #[inline(always)]
    pub fn cross_wrench(self, f: Wrench<T>) -> Wrench<T> {
        Wrench::new(self.angular.cross(f.moment) + self.linear.cross(f.force), self.angular.cross(f.force))
    }
}
