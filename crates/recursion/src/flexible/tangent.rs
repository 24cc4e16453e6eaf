//! Derivatives of forward and inverse dynamics of trees with flexible bodies: the sweeps themselves on dual numbers.
//!
//! x + ẋ ε, ε² = 0, through the kernels of this folder: one pass for every direction, O(n) each, exact to rounding. There are no
//! analytic derivatives of flexible trees here.

use super::motions::ground;
use super::{Composite, Filter, NewtonEuler, gather_loads};
use crate::error::DynamicsError;
use crate::hinge::Hinge;
use crate::layout::Layout;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};
use num_traits::{One, Zero};
use phipsi_spatial::{Quaternion, Scalar, Vec3, Wrench};

/// A number and its derivative along one direction; constants of a model do not change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tangent<T> {
    pub(crate) value: T,
    pub(crate) rate: T,
}

impl<T: Scalar> Tangent<T> {
    pub(crate) fn new(value: T, rate: T) -> Self {
        Tangent { value, rate }
    }
    pub(crate) fn fixed(value: T) -> Self {
        Tangent::new(value, T::zero())
    }
}

impl<T: Scalar> Add for Tangent<T> {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Tangent::new(self.value + b.value, self.rate + b.rate)
    }
}
impl<T: Scalar> Sub for Tangent<T> {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Tangent::new(self.value - b.value, self.rate - b.rate)
    }
}
impl<T: Scalar> Mul for Tangent<T> {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        Tangent::new(self.value * b.value, self.value * b.rate + self.rate * b.value)
    }
}
impl<T: Scalar> Div for Tangent<T> {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let value = self.value / b.value;
        Tangent::new(value, (self.rate - value * b.rate) / b.value)
    }
}
impl<T: Scalar> Neg for Tangent<T> {
    type Output = Self;
    fn neg(self) -> Self {
        Tangent::new(-self.value, -self.rate)
    }
}
macro_rules! assigning {
    ($($trait:ident $function:ident $operator:tt),*) => {$(
        impl<T: Scalar> $trait for Tangent<T> {
            fn $function(&mut self, b: Self) {
                *self = *self $operator b;
            }
        }
    )*};
}
assigning!(AddAssign add_assign +, SubAssign sub_assign -, MulAssign mul_assign *, DivAssign div_assign /);
impl<T: Scalar> Zero for Tangent<T> {
    fn zero() -> Self {
        Tangent::fixed(T::zero())
    }
    fn is_zero(&self) -> bool {
        self.value.is_zero() && self.rate.is_zero()
    }
}
impl<T: Scalar> One for Tangent<T> {
    fn one() -> Self {
        Tangent::fixed(T::one())
    }
}

impl<T: Scalar> Scalar for Tangent<T> {
    type Constant = T::Constant;
    type Abreast = T::Abreast;
    const LANES: usize = T::LANES;
    const EPSILON: f64 = T::EPSILON;
    phipsi_spatial::arithmetic_is_self!();
    fn splat(x: f64) -> Self {
        Tangent::fixed(T::splat(x))
    }
    fn constant(x: T::Constant) -> Self {
        Tangent::fixed(T::constant(x))
    }
    fn fma(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    fn recip(self) -> Self {
        let value = self.value.recip();
        Tangent::new(value, -(value * value * self.rate))
    }
    fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Tangent::new(value, self.rate / (value + value))
    }
    fn sin_cos(self) -> (Self, Self) {
        let (s, c) = self.value.sin_cos();
        (Tangent::new(s, c * self.rate), Tangent::new(c, -(s * self.rate)))
    }
    fn is_positive(self) -> bool {
        self.value.is_positive()
    }
    fn min_lane(self) -> f64 {
        self.value.min_lane()
    }
    fn first_lane(self) -> T::Constant {
        self.value.first_lane()
    }
}

/// Which of the two maps is differentiated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Map {
    /// (q, v, τ) to accelerations.
    Forward,
    /// (q, v, a) to τ.
    Inverse,
}

/// Derivatives by increments of q, by v and by the third argument `x`, each nv×nv by rows. Allocates.
pub(crate) fn derivatives<T: Scalar>(
    map: Map,
    layout: &Layout<T::Constant>,
    (q, v, x): (&[T], &[T], &[T]),
    wrenches: Option<&[Wrench<T>]>,
    (by_q, by_v, by_x): (&mut [T], &mut [T], &mut [T]),
) -> Result<(), DynamicsError> {
    let Some(tree) = layout.flexible() else { return Ok(()) };
    let nv = layout.nv();
    let lift = |x: &[T]| x.iter().map(|x| Tangent::fixed(*x)).collect::<Vec<_>>();
    let (q0, v0, x0) = (lift(q), lift(v), lift(x));
    let loads = wrenches.map(|wrenches| {
        let wrenches: Vec<Wrench<Tangent<T>>> = wrenches.iter().map(|w| w.map(Tangent::fixed)).collect();
        let mut loads = vec![Wrench::zero(); tree.bodies.len()];
        gather_loads(layout, &wrenches, &mut loads);
        loads
    });
    let mut forward = Filter::<Tangent<T>>::new(tree);
    let mut inverse = NewtonEuler::<Tangent<T>>::new(tree);
    let mut column = x0.clone();
    let mut differentiate = |q: &[Tangent<T>],
                             v: &[Tangent<T>],
                             x: &[Tangent<T>],
                             j: usize,
                             out: &mut [T]| {
        match map {
            Map::Forward => {
                column.copy_from_slice(x);
                forward.run(layout, tree, ground(layout.gravity()), (q, v), loads.as_deref(), &mut column)?;
            }
            Map::Inverse => inverse.run(layout, tree, (q, v, x), loads.as_deref(), &mut column),
        }
        for (i, x) in column.iter().enumerate() {
            out[i * nv + j] = x.rate;
        }
        Ok(())
    };
    let mut moved = q0.clone();
    let joints = tree.bodies.iter().filter_map(|b| Some((b, b.hinge.as_ref()?)));
    for (body, hinge) in joints {
        for i in 0..hinge.nv() {
            turn(hinge, i, &q[body.q..], &mut moved[body.q..]);
            differentiate(&moved, &v0, &x0, body.v + i, by_q)?;
            moved.copy_from_slice(&q0);
        }
    }
    for modal in &tree.modal {
        for l in 0..modal.n {
            moved[modal.q + l].rate = T::one();
            differentiate(&moved, &v0, &x0, modal.v + l, by_q)?;
            moved.copy_from_slice(&q0);
        }
    }
    for j in 0..nv {
        let mut faster = v0.clone();
        faster[j].rate = T::one();
        differentiate(&q0, &faster, &x0, j, by_v)?;
    }
    match map {
        Map::Inverse => Composite::new(tree).run(tree, nv, q, by_x),
        Map::Forward => {
            for j in 0..nv {
                let mut pushed = x0.clone();
                pushed[j].rate = T::one();
                differentiate(&q0, &v0, &pushed, j, by_x)?;
            }
        }
    }
    Ok(())
}

/// Rates of a joint's coordinates as its i-th velocity is one: those of the model's increments.
fn turn<T: Scalar>(hinge: &Hinge<T::Constant>, i: usize, q: &[T], out: &mut [Tangent<T>]) {
    let half = T::splat(0.5);
    let unit = |i: usize| {
        let mut x = Vec3::zero();
        x.0[i] = T::one();
        x
    };
    // ½ q ∘ (ω, 0).
    let quaternion = |q: &[T], w: Vec3<T>, out: &mut [Tangent<T>]| {
        let u = Vec3([q[0], q[1], q[2]]);
        let vector = (w.scale(q[3]) + u.cross(w)).scale(half);
        (0..3).for_each(|k| out[k].rate = vector.0[k]);
        out[3].rate = -(u.dot(w) * half);
    };
    match hinge {
        Hinge::Spherical => quaternion(q, unit(i), out),
        Hinge::Free if i < 3 => quaternion(&q[3..], unit(i), &mut out[3..]),
        Hinge::Free => {
            let step = Quaternion([q[3], q[4], q[5], q[6]]).to_rotation() * unit(i - 3);
            (0..3).for_each(|k| out[k].rate = step.0[k]);
        }
        Hinge::Planar if i == 0 => out[2].rate = T::one(),
        Hinge::Planar => {
            let (s, c) = q[2].sin_cos();
            (out[0].rate, out[1].rate) = if i == 1 { (c, s) } else { (-s, c) };
        }
        _ => out[i].rate = T::one(),
    }
}
